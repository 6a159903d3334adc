//! Sixty-four cells that look for their nearest patches together.
//!
//! Cells side by side have few patches to choose from, and mostly the same: the list is kept once
//! for a block of 4³, which takes the search for repetitions off the single cell, and a patch is
//! measured against eight cells at a time. Where it is the nearest so far and the closest point
//! lies on one of its edges, the patch across that edge is next.

use super::kernel::{Cube, NearestOfEight, WidePatch, offsets};
use super::patches::{NONE, Patches};
use crate::simd::{F32x8, I32s, LANES};

/// Patches that a block looks at, at most. More are worth a search: the mesh is much finer than the
/// voxels, or made of slivers. Half as many cut the walks beside the lids of the Stanford bunny
/// short at 1,024 voxels, and the searches in their place took 7 % of the distances' time.
const TRIED_MAX: usize = 128;
/// Cubes of eight cells in a block.
pub(super) const CUBES: usize = 8;

/// A block of eight cubes and what their cells have found. One serves many blocks, as it is too
/// large to be made anew for each.
pub(super) struct Block<L: F32x8> {
    /// The first cell.
    base: [i32; 3],
    /// `[CUBES]`: nearest patches of the cells of [`Self::cube`].
    pub(super) nearest: [NearestOfEight<L>; CUBES],
    /// `[CUBES]`: cells that lead on to other patches, one bit each.
    wanted: [u8; CUBES],
    tried: [u32; TRIED_MAX],
    n_tried: usize,
    n_measured: usize,
    /// `[n_measured][CUBES]`: squared distances to the patches, cells².
    squared: [[L; CUBES]; TRIED_MAX],
    /// `[n_measured][3][CUBES]`: cells whose closest point of the patch lies on an edge of it, one
    /// bit each.
    on_edge: [[[u8; CUBES]; 3]; TRIED_MAX],
    /// Cubes for which a patch could not be looked at, one bit each.
    cut_short: u8,
}

impl<L: F32x8> Block<L> {
    #[inline(always)]
    pub(super) fn new() -> Self {
        Self {
            base: [0; 3],
            nearest: [NearestOfEight::none(); CUBES],
            wanted: [0; CUBES],
            tried: [NONE; TRIED_MAX],
            n_tried: 0,
            n_measured: 0,
            squared: [[L::splat(0.0); CUBES]; TRIED_MAX],
            on_edge: [[[0; CUBES]; 3]; TRIED_MAX],
            cut_short: 0,
        }
    }

    /// Turns to the 4³ cells from `base` on and forgets everything. `wanted`: cells that count, by
    /// cube.
    #[inline(always)]
    pub(super) fn restart(&mut self, base: [i32; 3], wanted: [u8; CUBES]) {
        (self.base, self.wanted) = (base, wanted);
        self.nearest = [NearestOfEight::none(); CUBES];
        (self.n_tried, self.n_measured, self.cut_short) = (0, 0, 0);
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
        let along = [cube >> 2, cube >> 1 & 1, cube & 1];
        Cube {
            base: core::array::from_fn(|axis| self.base[axis] + 2 * along[axis] as i32),
            step: 1,
        }
    }

    /// Puts those patches on the list for which a bit is set, in order; [`NONE`] and known ones are
    /// let pass.
    #[inline(always)]
    pub(super) fn consider(&mut self, patches: &[u32; LANES], which: u8) {
        let all = L::Int::load(patches);
        let mut left = which & !all.eq(L::Int::splat(NONE as i32)).byte();
        for known in &self.tried[..self.n_tried] {
            left &= !all.eq(L::Int::splat(*known as i32)).byte();
        }
        while left != 0 {
            let patch_idx = patches[left.trailing_zeros() as usize % LANES];
            left &= !all.eq(L::Int::splat(patch_idx as i32)).byte();
            self.push(patch_idx, u8::MAX);
        }
    }

    /// Puts an unknown patch on the list, for the sake of these cubes.
    #[inline(always)]
    fn push(&mut self, patch_idx: u32, cubes: u8) {
        match self.tried.get_mut(self.n_tried) {
            Some(next) => {
                *next = patch_idx;
                self.n_tried += 1;
            }
            None => self.cut_short |= cubes,
        }
    }

    /// Measures the patches on the list, and those to which they lead. Returns the cubes of which a
    /// way ended early, one bit each: at an edge with nothing known across, or because there were
    /// too many patches.
    #[inline(always)]
    pub(super) fn settle(&mut self, patches: &Patches) -> u8 {
        let first_cube = offsets::<L::Int>(1);
        let cubes = offsets::<L::Int>(2);
        while self.n_measured < self.n_tried {
            let round = self.n_measured..self.n_tried;
            self.n_measured = self.n_tried;
            for idx in round.clone() {
                let patch_idx = self.tried[idx];
                let patch = WidePatch::<L>::new(&patches.all[patch_idx as usize]);
                let first = patch.place(self.base, first_cube);
                let steps = patch.steps(cubes);
                #[expect(
                    clippy::needless_range_loop,
                    reason = "four arrays are read or written at the same place"
                )]
                for cube in 0..CUBES {
                    let mut places = first;
                    for axis in 0..3 {
                        places[axis] = first[axis] + L::splat(steps[axis][cube]);
                    }
                    let found = self.nearest[cube].measure(&patch, patch_idx, places);
                    self.squared[idx][cube] = found.squared;
                    for edge in 0..3 {
                        self.on_edge[idx][edge][cube] = found.on_edge[edge].byte();
                    }
                }
            }
            let mut plateau = [L::splat(0.0); CUBES];
            for (limit, nearest) in plateau.iter_mut().zip(&self.nearest) {
                *limit = nearest.plateau();
            }
            for idx in round {
                let mut near = [0; CUBES];
                for cube in 0..CUBES {
                    near[cube] =
                        self.squared[idx][cube].le(plateau[cube]).byte() & self.wanted[cube];
                }
                let near = u64::from_ne_bytes(near);
                if near == 0 {
                    continue;
                }
                for edge in 0..3 {
                    let leads_on = u64::from_ne_bytes(self.on_edge[idx][edge]) & near;
                    let across = patches.across(self.tried[idx])[edge];
                    if leads_on == 0 || self.tried[..self.n_tried].contains(&across) {
                        continue;
                    }
                    let cubes = leads_on
                        .to_ne_bytes()
                        .iter()
                        .rev()
                        .fold(0, |cubes, cells| cubes << 1 | u8::from(*cells != 0));
                    if across == NONE {
                        self.cut_short |= cubes;
                    } else {
                        self.push(across, cubes);
                    }
                }
            }
        }
        self.cut_short
    }
}
