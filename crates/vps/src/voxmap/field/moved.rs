//! Samples moved by what interpolation errs in the mean.
//!
//! Data in: exact distances at the centres of cells. Data out: the samples that the field
//! interpolates, and by how much each was moved.
//!
//! Between exact samples of a curved surface trilinear interpolation errs to one side: by
//! Σ h² u (1 − u)/2 · ∂²d/∂x², u the place between two samples in cells, h their distance, which is
//! h²/12 · Δd in the mean. A ball of eight voxels pushed one of ten with 8 % less force half a voxel
//! deep, and with 15 % less a quarter deep; now 0.5 and 1 % off, with points of half a voxel.
//!
//! Each sample is moved by as much the other way where the samples around it are those of one smooth
//! patch: at creases, between walls, where the band ends and farther outside it stays. What is flat
//! keeps its bits.
//!
//! Second differences reach two cells: with fewer than five layers samples a voxel deep stay.
//!
//! Invariant: no sample is moved by more than [`MOST_MOVED_CELLS`]. Cost: two passes over the band.
//!
//! # Source
//! CondatBlu2005: the quasi-interpolation of second order for linear B-splines, without its filter's
//! second pass; where it stops at creases is ours.

use super::{APRON_CELLS, BRICK_CELLS, fill_aprons};
use crate::parallel;
use crate::voxmap::distance::sample_of;
use crate::voxmap::grid::BRICK_EDGE;
use crate::voxmap::layers::Layers;

/// What a sample is moved by at most, cells: as where the distance is that from a ball of 3.3 voxels.
pub(crate) const MOST_MOVED_CELLS: f32 = 0.05;
/// Moves are whole multiples of this, cells.
pub(super) const STEP_CELLS: f32 = 1.0 / 2048.0;
/// Second differences along the axes are those of one smooth patch up to the first, of none from the
/// second on, per cell: a ball of 3.3 voxels, or an edge of 17°; a ball of 2.5, or an edge of 23°.
pub(super) const ONE_PATCH: f32 = 0.3;
const NO_PATCH: f32 = 0.4;
/// Samples farther outside stay, cells: beside an edge distances are round where the part is not.
const OUTSIDE_CELLS: f32 = 1.0;

/// `[n_slots][9³]`: by how many steps each sample was moved; empty if none was.
pub(super) type Moves = Vec<[i8; APRON_CELLS]>;

/// Moves the samples, whose aprons it neither reads nor writes. Cold.
pub(super) fn move_samples(
    layers: &Layers,
    band_m: f32,
    samples_m: &mut [[f32; APRON_CELLS]],
) -> Moves {
    let cell_m = layers.grid.voxel_size_m as f32;
    let exact_m: &[_] = samples_m;
    let bends = parallel::map(exact_m.len(), 16, |slot| {
        let brick = Around::new(layers, exact_m, slot);
        core::array::from_fn(|inside| brick.bend(inside, band_m, cell_m))
    });
    let mut moves: Moves = parallel::map(exact_m.len(), 16, |slot| {
        let brick = Around::new(layers, &bends, slot);
        let mut moves = [0; APRON_CELLS];
        for inside in 0..BRICK_CELLS {
            if let Some(steps) = moves.get_mut(sample_of(inside)) {
                *steps = brick.steps(inside);
            }
        }
        moves
    });
    if moves.iter().all(|brick| brick.iter().all(|steps| *steps == 0)) {
        return Vec::new();
    }
    parallel::map_mut(samples_m, 16, |slot, brick| {
        for (sample_m, steps) in brick.iter_mut().zip(moves.get(slot).into_iter().flatten()) {
            *sample_m -= cell_m * STEP_CELLS * f32::from(*steps);
        }
    });
    fill_aprons(layers, [0, 0], &mut moves);
    moves
}

/// What the second differences about a sample say.
#[derive(Clone, Copy)]
struct Bend {
    /// By how much it is too large for an interpolation if all around it is one patch.
    steps: i8,
    /// How far all is one patch: 255 where it is smooth, 0 at a crease.
    share: u8,
}

/// What a brick has for each of its cells, and the six beside it.
struct Around<'a, B> {
    own: Option<&'a B>,
    /// Before and behind along x, y, z; `None` beyond the band.
    beside: [[Option<&'a B>; 2]; 3],
}

impl<'a, B> Around<'a, B> {
    fn new(layers: &Layers, bricks: &'a [B], slot: usize) -> Self {
        let coord =
            layers.grid.brick_coord(layers.bricks.get(slot).map_or(0, |brick| *brick as usize));
        let beside = |axis: usize, towards: i32| {
            let offset = core::array::from_fn(|k| if k == axis { towards } else { 0 });
            let brick = layers.grid.brick_neighbour(coord, offset)?;
            // The marks of what is uniform are beyond the last.
            bricks.get(*layers.top.get(brick)? as usize)
        };
        Self {
            own: bricks.get(slot),
            beside: core::array::from_fn(|axis| [beside(axis, -1), beside(axis, 1)]),
        }
    }

    /// What the cells before and behind one have along an axis.
    fn next<T>(
        &self,
        inside: usize,
        axis: usize,
        of: impl Fn(&B, usize) -> Option<T>,
    ) -> Option<[T; 2]> {
        const LAST: usize = BRICK_EDGE - 1;
        let shift = 6 - 3 * axis;
        let at = inside >> shift & LAST;
        let [before, behind] = *self.beside.get(axis)?;
        let before = match at {
            0 => of(before?, inside | LAST << shift),
            _ => of(self.own?, inside - (1 << shift)),
        };
        let behind = match at {
            LAST => of(behind?, inside & !(LAST << shift)),
            _ => of(self.own?, inside + (1 << shift)),
        };
        Some([before?, behind?])
    }
}

fn distance(brick: &[f32; APRON_CELLS], inside: usize) -> Option<f32> {
    brick.get(sample_of(inside)).copied()
}

impl Around<'_, [f32; APRON_CELLS]> {
    /// Second differences along x, y, z, m; `None` where one reaches beyond the band.
    fn second_differences(&self, inside: usize, band_m: f32) -> Option<[f32; 3]> {
        let middle = distance(self.own?, inside)?;
        let mut found = [0.0; 3];
        for (axis, difference) in found.iter_mut().enumerate() {
            let [before, behind] = self.next(inside, axis, distance)?;
            if before.abs().max(behind.abs()).max(middle.abs()) >= band_m {
                return None;
            }
            *difference = before - 2.0 * middle + behind;
        }
        Some(found)
    }

    fn bend(&self, inside: usize, band_m: f32, cell_m: f32) -> Bend {
        let none = Bend { steps: 0, share: 0 };
        let value_m = self.own.and_then(|brick| distance(brick, inside));
        // What stays, and what stays beside it.
        if value_m.is_none_or(|value_m| value_m < -(OUTSIDE_CELLS + 1.0) * cell_m) {
            return none;
        }
        let Some(found) = self.second_differences(inside, band_m) else { return none };
        let largest = found.into_iter().map(f32::abs).fold(0.0, f32::max) / cell_m;
        let share = ((NO_PATCH - largest) / (NO_PATCH - ONE_PATCH)).clamp(0.0, 1.0);
        let is_near = value_m.is_some_and(|value_m| value_m > -OUTSIDE_CELLS * cell_m);
        let cells = if is_near { found.into_iter().sum::<f32>() / (12.0 * cell_m) } else { 0.0 };
        let cells = cells.clamp(-MOST_MOVED_CELLS, MOST_MOVED_CELLS);
        Bend { steps: (cells / STEP_CELLS).round() as i8, share: (255.0 * share) as u8 }
    }
}

impl Around<'_, [Bend; BRICK_CELLS]> {
    /// By how many steps a sample is moved: as far as it and the six beside it are those of one
    /// patch. A crease between two samples shows at one of them, or at the next.
    fn steps(&self, inside: usize) -> i8 {
        let of = |brick: &[Bend; BRICK_CELLS], inside: usize| brick.get(inside).copied();
        let Some(own) = self.own.and_then(|brick| of(brick, inside)) else { return 0 };
        if own.steps == 0 || own.share == 0 {
            return 0;
        }
        let least = (0..3).try_fold(own.share, |least, axis| {
            let [before, behind] = self.next(inside, axis, of)?;
            Some(least.min(before.share).min(behind.share))
        });
        (f32::from(own.steps) * f32::from(least.unwrap_or(0)) / 255.0).round() as i8
    }
}
