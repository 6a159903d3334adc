//! Sixty-four cells that look for their nearest patches together.
//!
//! Cells side by side have few patches to choose from, and mostly the same: what may be the nearest
//! of some is found once for a block of 4³ cells, and measured against eight of them at a time.

use super::kernel::{Cube, NearestOfEight, WidePatch, offsets};
use super::patches::{NONE, Patch};
use crate::simd::{F32x8, I32s, LANES};
use crate::voxmap::surface::bits;

/// Cubes of eight cells in a block.
pub(super) const CUBES: usize = 8;
/// From the middle of a block to the centres of its outermost cells along an axis, cells.
pub(super) const HALF_SPAN_CELLS: f32 = 1.5;
/// The squares of the ways along an axis from the middle of a block to its 64 cells, summed up.
const SPREAD_CELLS_SQUARED: f32 = 80.0;

/// A block of eight cubes and what their cells have found.
#[derive(Clone, Copy)]
pub(super) struct Block<L: F32x8> {
    /// The first cell.
    base: [i32; 3],
    /// `[CUBES]`: nearest patches of the cells of [`Self::cube`].
    pub(super) nearest: [NearestOfEight<L>; CUBES],
    /// `[CUBES]`: cells that count, one bit each.
    wanted: [u8; CUBES],
    /// The patches that were on offer, [`NONE`] in place of repetitions.
    offered: [u32; LANES],
}

impl<L: F32x8> Block<L> {
    #[inline(always)]
    pub(super) fn new() -> Self {
        Self {
            base: [0; 3],
            nearest: [NearestOfEight::none(); CUBES],
            wanted: [0; CUBES],
            offered: [NONE; LANES],
        }
    }

    /// Turns to the 4³ cells from `base` on and forgets everything. `wanted`: cells that count, by
    /// cube.
    #[inline(always)]
    pub(super) fn restart(&mut self, base: [i32; 3], wanted: [u8; CUBES]) {
        (self.base, self.wanted) = (base, wanted);
        self.nearest = [NearestOfEight::none(); CUBES];
        self.offered = [NONE; LANES];
    }

    /// True when a cell counts.
    #[inline(always)]
    pub(super) fn is_wanted(&self) -> bool {
        self.wanted != [0; CUBES]
    }

    /// Leaves the cells of a cube that do not count as they are, so that no search goes on for
    /// their sake.
    #[inline(always)]
    pub(super) fn only_wanted(&mut self, cube: usize) {
        self.nearest[cube].squared =
            self.nearest[cube].squared.only(L::Int::mask(self.wanted[cube].into()));
    }

    /// Cube x·4 + y·2 + z of the block.
    #[inline(always)]
    pub(super) fn cube(&self, cube: usize) -> Cube {
        let [x, y, z] = self.base;
        let along = along(cube).map(|along| 2 * along as i32);
        Cube { base: [x + along[0], y + along[1], z + along[2]], step: 1 }
    }

    /// Measures these patches, in order; [`NONE`] and repetitions are let pass.
    #[inline(always)]
    pub(super) fn offer(&mut self, patches: &[Patch], offered: &[u32; LANES]) {
        for (lane, patch_idx) in offered.iter().enumerate() {
            if *patch_idx != NONE && !offered[..lane].contains(patch_idx) {
                self.offered[lane] = *patch_idx;
                let patch = WidePatch::<L>::new(&patches[*patch_idx as usize]);
                self.measure(&patch, *patch_idx, u8::MAX);
            }
        }
    }

    /// True for what was on offer.
    #[inline(always)]
    pub(super) fn knows(&self, patch_idx: u32) -> bool {
        !L::Int::load(&self.offered).eq(L::Int::splat(patch_idx as i32)).is_zero()
    }

    /// Measures the cells of these cubes against a patch.
    #[inline(always)]
    pub(super) fn measure(&mut self, patch: &WidePatch<L>, patch_idx: u32, cubes: u8) {
        let first = patch.place(self.base, offsets(1));
        let steps = patch.steps(offsets(2));
        for cube in bits(cubes.into()) {
            let cube = cube as usize % CUBES;
            let mut places = first;
            for axis in 0..3 {
                places[axis] = first[axis] + L::splat(steps[axis][cube]);
            }
            self.nearest[cube].measure(patch, patch_idx, places);
        }
    }

    /// A bound on what the cells have found.
    #[inline(always)]
    pub(super) fn limit(&self) -> Limit {
        let mut at_middle = [f32::NEG_INFINITY; CUBES];
        if !self.is_wanted() {
            return Limit { slope: [0.0; 3], at_middle, farthest: 0.0 };
        }
        let [x, y, z] = offsets::<L::Int>(1);
        let half = L::splat(HALF_SPAN_CELLS);
        let first = [L::of_int(x) - half, L::of_int(y) - half, L::of_int(z) - half];
        let mut distances = [L::splat(0.0); CUBES];
        let mut moments = [L::splat(0.0); 3];
        let mut farthest = L::splat(0.0);
        for (cube, distance_of) in distances.iter_mut().enumerate() {
            let distance = self.nearest[cube].squared.sqrt();
            *distance_of = distance;
            farthest = farthest.max(distance.only(L::Int::mask(self.wanted[cube].into())));
            for axis in 0..3 {
                let place = first[axis] + L::splat((2 * along(cube)[axis]) as f32);
                moments[axis] = moments[axis] + distance * place;
            }
        }
        // The slope of the plane of least squares; any other would be right, but not as tight.
        let mut slope = [0.0; 3];
        for axis in 0..3 {
            let mut lanes = [0.0; LANES];
            moments[axis].store(&mut lanes);
            slope[axis] = lanes.iter().sum::<f32>() / SPREAD_CELLS_SQUARED;
        }
        for (cube, mut rest) in distances.into_iter().enumerate() {
            for axis in 0..3 {
                let place = first[axis] + L::splat((2 * along(cube)[axis]) as f32);
                rest = rest - L::splat(slope[axis]) * place;
            }
            let wanted = L::Int::mask(self.wanted[cube].into());
            at_middle[cube] = L::select(wanted, rest, L::splat(f32::NEG_INFINITY)).max_lane();
        }
        Limit { slope, at_middle, farthest: farthest.max_lane() }
    }

    /// Middle of the block, in centre coordinates.
    #[inline(always)]
    pub(super) fn middle(&self) -> [f32; 3] {
        let [x, y, z] = self.base;
        [x as f32 + HALF_SPAN_CELLS, y as f32 + HALF_SPAN_CELLS, z as f32 + HALF_SPAN_CELLS]
    }
}

/// Where a cube is in its block: 0 or 1 along x, y, z.
#[inline(always)]
const fn along(cube: usize) -> [usize; 3] {
    [cube >> 2, cube >> 1 & 1, cube & 1]
}

/// How far the cells of a block that count are from what they have found, at most: a cell of cube k
/// at a way w from the middle of the block `at_middle[k]` + `slope`·w, none more than `farthest`.
#[derive(Clone, Copy)]
pub(super) struct Limit {
    /// Cells per cell.
    pub(super) slope: [f32; 3],
    /// `[CUBES]`: cells; −∞ where no cell counts.
    pub(super) at_middle: [f32; CUBES],
    /// Cells.
    pub(super) farthest: f32,
}
