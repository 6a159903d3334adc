//! Layers: how many voxels is a cell away from the surface?
//!
//! # Source
//! Sagardia2008: values grow by one per layer, negative outside, positive inside, 0 on the surface, up to a chosen number of
//! layers. The metric is ours: 26 neighbours, so a cell on layer q is at least (q − ½)·s away from the surface (its Chebyshev
//! distance in cells is exactly q), which is the bound that culling needs.

use std::sync::Arc;

use rayon::prelude::*;

use super::fill::Sides;
use super::grid::{BRICK_CELLS, BRICK_EDGE, Grid};
use super::surface::{Mask, Surface, bits};

/// Marks a brick of the top grid that holds no band cell and lies outside.
pub const FAR_OUTSIDE: u32 = u32::MAX;
/// Marks a brick of the top grid that holds no band cell and lies inside.
pub const DEEP_INSIDE: u32 = u32::MAX - 1;

/// Layer values, sparse: only bricks that the band touches are stored.
#[derive(Debug)]
pub struct Layers {
    /// The grid.
    pub grid: Grid,
    /// `[n_bricks of the grid]`: slot in `bricks` and `values`, or [`FAR_OUTSIDE`], or [`DEEP_INSIDE`].
    pub top: Vec<u32>,
    /// `[n_slots]`, ascending: number of the brick in the grid.
    pub bricks: Vec<u32>,
    /// `[n_slots][512]`, z fastest: 0 surface, −q outside, +q inside, ±(n_layers + 1) beyond the band. Shared with the field.
    pub values: Arc<Vec<[i8; BRICK_CELLS]>>,
    /// Layers on each side.
    pub n_layers: u32,
}

impl Layers {
    /// Grows `n_layers` (at most 126) on both sides of the surface. Cost: O(band bricks · layers), word-wide.
    pub fn grow(surface: &Surface, sides: &Sides, n_layers: u32) -> Self {
        let grid = surface.grid;
        let beyond = n_layers as i8 + 1;
        // One frontier, reached-mask and value array per slot; `top` finds the slot of a brick.
        let mut top = vec![FAR_OUTSIDE; grid.n_bricks()];
        let mut bricks = surface.bricks.clone();
        let mut frontier = surface.masks.clone();
        let mut reached = surface.masks.clone();
        let mut values: Vec<[i8; BRICK_CELLS]> = Vec::with_capacity(bricks.len());
        for (slot, brick) in bricks.iter().enumerate() {
            top[*brick as usize] = slot as u32;
            let mut cells = unreached(&sides.outside_mask(surface, *brick as usize), beyond);
            for_each_cell(&surface.masks[slot], |inside| cells[inside] = 0);
            values.push(cells);
        }
        let mut active: Vec<u32> = bricks.clone();

        for layer in 1..=n_layers {
            let mut candidates: Vec<u32> = active
                .par_iter()
                .flat_map_iter(|brick| {
                    let coord = grid.brick_coord(*brick as usize);
                    let slot = top[*brick as usize] as usize;
                    neighbours_reached(&frontier[slot])
                        .filter_map(move |offset| grid.brick_neighbour(coord, offset).map(|n| n as u32))
                })
                .collect();
            candidates.par_sort_unstable();
            candidates.dedup();
            let grown: Vec<(u32, Mask)> = candidates
                .par_iter()
                .filter_map(|brick| {
                    let mut new = dilated(&grid, &top, &frontier, *brick as usize);
                    if let Some(slot) = slot_of(&top, *brick as usize) {
                        new.iter_mut().zip(&reached[slot]).for_each(|(word, old)| *word &= !old);
                    }
                    new.iter().any(|word| *word != 0).then_some((*brick, new))
                })
                .collect();
            for brick in &active {
                frontier[top[*brick as usize] as usize] = [0; BRICK_EDGE];
            }
            active.clear();
            for (brick, new) in grown {
                let outside = sides.outside_mask(surface, brick as usize);
                let slot = slot_of(&top, brick as usize).unwrap_or_else(|| {
                    let slot = bricks.len();
                    top[brick as usize] = slot as u32;
                    bricks.push(brick);
                    frontier.push([0; BRICK_EDGE]);
                    reached.push([0; BRICK_EDGE]);
                    values.push(unreached(&outside, beyond));
                    slot
                });
                for x in 0..BRICK_EDGE {
                    reached[slot][x] |= new[x];
                }
                frontier[slot] = new;
                let cells = &mut values[slot];
                for_each_cell(&new, |inside| {
                    let is_outside = outside[inside >> 6] >> (inside & 63) & 1 == 1;
                    cells[inside] = if is_outside { -(layer as i8) } else { layer as i8 };
                });
                active.push(brick);
            }
        }

        // Slots in grid order: the map does not show the order in which bricks were reached.
        let mut order: Vec<u32> = (0..bricks.len() as u32).collect();
        order.sort_unstable_by_key(|slot| bricks[*slot as usize]);
        let sorted_values = order.iter().map(|slot| values[*slot as usize]).collect();
        let sorted_bricks: Vec<u32> = order.iter().map(|slot| bricks[*slot as usize]).collect();
        for (brick, entry) in top.iter_mut().enumerate() {
            *entry = if sides.is_outside_brick(brick) { FAR_OUTSIDE } else { DEEP_INSIDE };
        }
        for (slot, brick) in sorted_bricks.iter().enumerate() {
            top[*brick as usize] = slot as u32;
        }
        Self { grid, top, bricks: sorted_bricks, values: Arc::new(sorted_values), n_layers }
    }

    /// Layer value of a cell; cells beyond the grid saturate outside.
    pub fn value(&self, cell: [i32; 3]) -> i8 {
        let beyond = self.n_layers as i8 + 1;
        if !self.grid.contains(cell) {
            return -beyond;
        }
        let (brick, inside) = self.grid.locate(cell);
        match self.top[brick] {
            FAR_OUTSIDE => -beyond,
            DEEP_INSIDE => beyond,
            slot => self.values[slot as usize][inside],
        }
    }

    /// Slot of a brick that the band touches.
    pub fn slot(&self, brick: usize) -> Option<usize> {
        slot_of(&self.top, brick)
    }
}

fn slot_of(top: &[u32], brick: usize) -> Option<usize> {
    (top[brick] < DEEP_INSIDE).then_some(top[brick] as usize)
}

fn unreached(outside: &Mask, beyond: i8) -> [i8; BRICK_CELLS] {
    let mut cells = [beyond; BRICK_CELLS];
    for_each_cell(outside, |inside| cells[inside] = -beyond);
    cells
}

fn for_each_cell(mask: &Mask, mut visit: impl FnMut(usize)) {
    for (x, word) in mask.iter().enumerate() {
        for bit in bits(*word) {
            visit(x << 6 | bit as usize);
        }
    }
}

/// Offsets of the bricks that the cells of a mask have neighbours in, the brick itself included.
fn neighbours_reached(mask: &Mask) -> impl Iterator<Item = [i32; 3]> + use<> {
    const FIRST_Y: u64 = 0xff;
    const LAST_Y: u64 = 0xff << 56;
    const FIRST_Z: u64 = 0x0101_0101_0101_0101;
    const LAST_Z: u64 = FIRST_Z << 7;
    let mask = *mask;
    (0..27).filter_map(move |idx| {
        let offset = [idx / 9 - 1, idx / 3 % 3 - 1, idx % 3 - 1];
        let words = match offset[0] {
            -1 => &mask[..1],
            1 => &mask[BRICK_EDGE - 1..],
            _ => &mask[..],
        };
        let y = [FIRST_Y, u64::MAX, LAST_Y][(offset[1] + 1) as usize];
        let z = [FIRST_Z, u64::MAX, LAST_Z][(offset[2] + 1) as usize];
        words.iter().any(|word| word & y & z != 0).then_some(offset)
    })
}

/// Cells of a brick that have a frontier cell among their 26 neighbours (or are one).
fn dilated(grid: &Grid, top: &[u32], frontier: &[Mask], brick: usize) -> Mask {
    let coord = grid.brick_coord(brick);
    let mut around: [Option<&Mask>; 27] = [None; 27];
    for (idx, entry) in around.iter_mut().enumerate() {
        let offset = [idx as i32 / 9 - 1, idx as i32 / 3 % 3 - 1, idx as i32 % 3 - 1];
        *entry = grid.brick_neighbour(coord, offset).and_then(|n| slot_of(top, n)).map(|slot| &frontier[slot]);
    }
    // rows[x][y]: ten cells along z (one before and one after the brick), already spread along z and cut back to eight.
    let mut rows = [[0_u8; BRICK_EDGE + 2]; BRICK_EDGE + 2];
    for (x, plane) in rows.iter_mut().enumerate() {
        let (bx, wx) = split(x);
        for (y, row) in plane.iter_mut().enumerate() {
            let (by, wy) = split(y);
            let byte = |bz: usize| around[bx * 9 + by * 3 + bz].map_or(0, |mask| u32::from((mask[wx] >> (8 * wy)) as u8));
            let ten = byte(0) >> 7 | byte(1) << 1 | (byte(2) & 1) << 9;
            *row = ((ten | ten << 1 | ten >> 1) >> 1) as u8;
        }
    }
    let mut mask = [0; BRICK_EDGE];
    for (x, word) in mask.iter_mut().enumerate() {
        for y in 0..BRICK_EDGE {
            let row = (x..x + 3).flat_map(|x| (y..y + 3).map(move |y| (x, y))).fold(0, |all, (x, y)| all | rows[x][y]);
            *word |= u64::from(row) << (8 * y);
        }
    }
    mask
}

/// Which neighbour (0 before, 1 own, 2 after) and which row in it the padded index 0..10 means.
fn split(padded: usize) -> (usize, usize) {
    match padded {
        0 => (0, BRICK_EDGE - 1),
        i if i <= BRICK_EDGE => (1, i - 1),
        _ => (2, 0),
    }
}
