//! What was asked of the winding numbers, so that no cell is asked twice.

use crate::voxmap::grid::{BRICK_CELLS, Grid, cell_of};

/// Winding numbers at the centres of some cells, brick by brick.
pub(super) struct WindingCache {
    grid: Grid,
    /// `[n_bricks of the grid]`: 1 + slot of the brick, or 0.
    slots: Vec<u32>,
    /// `[n_slots]`: number of the brick.
    bricks: Vec<u32>,
    /// `[n_slots]`: [`Self::UNKNOWN`], [`Self::ASKED`] or the winding number.
    windings: Vec<[f32; BRICK_CELLS]>,
}

impl WindingCache {
    const UNKNOWN: f32 = f32::NAN;
    const ASKED: f32 = f32::INFINITY;

    /// Cost: 4 bytes per brick of the grid.
    pub(super) fn new(grid: &Grid) -> Self {
        Self {
            grid: *grid,
            slots: vec![0; grid.n_bricks()],
            bricks: Vec::new(),
            windings: Vec::new(),
        }
    }

    pub(super) fn get(&self, cell: [i32; 3]) -> Option<f64> {
        if !self.grid.contains(cell) {
            return None;
        }
        let (brick, inside) = self.grid.locate(cell);
        let slot = (self.slots[brick] as usize).checked_sub(1)?;
        Some(self.windings[slot][inside]).filter(|winding| winding.is_finite()).map(f64::from)
    }

    pub(super) fn set(&mut self, cell: [i32; 3], winding: f32) {
        let (brick, inside) = self.grid.locate(cell);
        if self.slots[brick] == 0 {
            self.bricks.push(brick as u32);
            self.windings.push([Self::UNKNOWN; BRICK_CELLS]);
            self.slots[brick] = self.bricks.len() as u32;
        }
        self.windings[self.slots[brick] as usize - 1][inside] = winding;
    }

    /// The cells of the grid that were not asked for before; from now on they are asked for.
    pub(super) fn ask(&mut self, cells: impl Iterator<Item = [i32; 3]>) -> Vec<[i32; 3]> {
        cells
            .filter(|cell| {
                if !self.grid.contains(*cell) {
                    return false;
                }
                let (brick, inside) = self.grid.locate(*cell);
                let slot = self.slots[brick] as usize;
                let is_new = slot == 0 || self.windings[slot - 1][inside].is_nan();
                if is_new {
                    self.set(*cell, Self::ASKED);
                }
                is_new
            })
            .collect()
    }

    pub(super) fn cells(&self) -> impl Iterator<Item = ([i32; 3], f32)> + '_ {
        self.bricks.iter().zip(&self.windings).flat_map(|(brick, windings)| {
            let coord = self.grid.brick_coord(*brick as usize);
            let known = windings.iter().enumerate().filter(|(_, winding)| winding.is_finite());
            known.map(move |(inside, winding)| (cell_of(coord, inside), *winding))
        })
    }
}
