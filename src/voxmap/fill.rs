//! Which cells are outside? A flood from a corner of the grid, eight rows of eight cells at a time.
//!
//! # Source
//! Sagardia2008, section 3: flood fill with a LIFO stack from a corner voxel; what is neither reached nor surface is inside.
//! Connectivity is ours: 6 neighbours, which a supercover surface stops. We flood bricks, not voxels: a brick without surface is
//! filled at once, a brick with surface by word-wide shifts until nothing changes. The set reached is the same.

use super::grid::{BRICK_EDGE, Grid};
use super::surface::{Mask, Surface};

/// All cells of a brick.
pub(crate) const FULL: Mask = [u64::MAX; BRICK_EDGE];

/// Every z = 0 cell of one x-layer of a brick.
const FIRST_Z: u64 = 0x0101_0101_0101_0101;

/// Outside and inside, per brick.
#[derive(Debug)]
pub struct Sides {
    /// One bit per brick of the grid: a brick without surface that the fill reached.
    outside_bricks: Vec<u64>,
    /// `[n_slots of the surface]`: outside cells of bricks that hold surface.
    outside_masks: Vec<Mask>,
}

/// What a cell is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// The surface passes through it.
    Surface,
    /// Reached by the fill.
    Outside,
    /// Not reached.
    Inside,
}

impl Sides {
    /// Floods from the corner cell `[0, 0, 0]`, which the padding keeps free. Cost: O(bricks + surface bricks · passes).
    pub fn flood(surface: &Surface) -> Self {
        let grid = &surface.grid;
        let mut sides = Self {
            outside_bricks: vec![0; grid.n_bricks().div_ceil(64)],
            outside_masks: vec![[0; BRICK_EDGE]; surface.masks.len()],
        };
        let mut stack = vec![(0_usize, corner_seed())];
        while let Some((brick, entering)) = stack.pop() {
            let grown = match surface.slot(brick) {
                None => {
                    if sides.is_outside_brick(brick) {
                        continue;
                    }
                    sides.outside_bricks[brick / 64] |= 1 << (brick % 64);
                    FULL
                }
                Some(slot) => {
                    let outside = &mut sides.outside_masks[slot];
                    if !spread(outside, &entering, &surface.masks[slot]) {
                        continue;
                    }
                    *outside
                }
            };
            let coord = grid.brick_coord(brick);
            for (axis, direction) in (0..3).flat_map(|axis| [(axis, -1), (axis, 1)]) {
                let mut offset = [0; 3];
                offset[axis] = direction;
                let Some(neighbour) = grid.brick_neighbour(coord, offset) else { continue };
                if surface.slot(neighbour).is_none() && sides.is_outside_brick(neighbour) {
                    continue;
                }
                let crossing = across_face(&grown, axis, direction);
                if crossing.iter().any(|word| *word != 0) {
                    stack.push((neighbour, crossing));
                }
            }
        }
        sides
    }

    /// The same map with nothing inside: a thin skin.
    pub(crate) fn without_inside(surface: &Surface) -> Self {
        let mut sides = Self {
            outside_bricks: vec![u64::MAX; surface.grid.n_bricks().div_ceil(64)],
            outside_masks: surface.masks.iter().map(|mask| mask.map(|word| !word)).collect(),
        };
        for brick in &surface.bricks {
            sides.outside_bricks[*brick as usize / 64] &= !(1 << (*brick % 64));
        }
        sides
    }

    /// True for a brick without surface that the fill reached.
    pub fn is_outside_brick(&self, brick: usize) -> bool {
        self.outside_bricks[brick / 64] >> (brick % 64) & 1 == 1
    }

    /// Outside cells of any brick.
    pub(crate) fn outside_mask(&self, surface: &Surface, brick: usize) -> Mask {
        match surface.slot(brick) {
            Some(slot) => self.outside_masks[slot],
            None if self.is_outside_brick(brick) => FULL,
            None => [0; BRICK_EDGE],
        }
    }

    /// What a cell is; cells beyond the grid are outside.
    pub fn side(&self, surface: &Surface, cell: [i32; 3]) -> Side {
        let grid: &Grid = &surface.grid;
        if !grid.contains(cell) {
            return Side::Outside;
        }
        let (brick, inside) = grid.locate(cell);
        let (word, bit) = (inside >> 6, inside & 63);
        let set = |mask: &Mask| mask[word] >> bit & 1 == 1;
        match surface.slot(brick) {
            Some(slot) if set(&surface.masks[slot]) => Side::Surface,
            Some(slot) if set(&self.outside_masks[slot]) => Side::Outside,
            None if self.is_outside_brick(brick) => Side::Outside,
            _ => Side::Inside,
        }
    }

    /// Cells that are neither surface nor outside.
    pub fn count_inside(&self, surface: &Surface) -> u64 {
        let grid = &surface.grid;
        let cells = super::grid::BRICK_CELLS as u64;
        let uniform =
            (0..grid.n_bricks()).filter(|brick| surface.slot(*brick).is_none() && !self.is_outside_brick(*brick)).count() as u64;
        let mixed: u64 = surface
            .masks
            .iter()
            .zip(&self.outside_masks)
            .flat_map(|(surface, outside)| surface.iter().zip(outside))
            .map(|(surface, outside)| u64::from((!(surface | outside)).count_ones()))
            .sum();
        // The padding keeps cells beyond `dims` in the last bricks outside, so no clipping is needed.
        uniform * cells + mixed
    }
}

fn corner_seed() -> Mask {
    let mut seed = [0; BRICK_EDGE];
    seed[0] = 1;
    seed
}

/// Adds to `outside` what `entering` reaches through free cells; false when nothing is new.
fn spread(outside: &mut Mask, entering: &Mask, surface: &Mask) -> bool {
    let mut changed_once = false;
    for x in 0..BRICK_EDGE {
        let added = entering[x] & !surface[x] & !outside[x];
        outside[x] |= added;
        changed_once |= added != 0;
    }
    if !changed_once {
        return false;
    }
    loop {
        let mut changed = false;
        for x in 0..BRICK_EDGE {
            let row = outside[x];
            let mut grown = row | (row << 8) | (row >> 8) | ((row << 1) & !FIRST_Z) | ((row & !FIRST_Z) >> 1);
            if x > 0 {
                grown |= outside[x - 1];
            }
            if x + 1 < BRICK_EDGE {
                grown |= outside[x + 1];
            }
            grown &= !surface[x];
            changed |= grown != row;
            outside[x] = grown;
        }
        if !changed {
            return true;
        }
    }
}

/// The cells of one face, moved to the opposite face of the neighbour across it.
fn across_face(mask: &Mask, axis: usize, direction: i32) -> Mask {
    let mut moved = [0; BRICK_EDGE];
    match (axis, direction > 0) {
        (0, true) => moved[0] = mask[BRICK_EDGE - 1],
        (0, false) => moved[BRICK_EDGE - 1] = mask[0],
        (1, true) => moved.iter_mut().zip(mask).for_each(|(to, from)| *to = from >> 56),
        (1, false) => moved.iter_mut().zip(mask).for_each(|(to, from)| *to = from << 56),
        (_, true) => moved.iter_mut().zip(mask).for_each(|(to, from)| *to = (from >> 7) & FIRST_Z),
        (_, false) => moved.iter_mut().zip(mask).for_each(|(to, from)| *to = (from & FIRST_Z) << 7),
    }
    moved
}
