//! Eight cells at the corners of a cube that look for their nearest patches together.
//!
//! Cells side by side have few patches to choose from, and mostly the same. One patch is measured against all eight at once; where
//! it is the nearest so far and the closest point lies on one of its edges, the patch across that edge is next.

use super::kernel::{Cube, Measured, NearestOfEight, OfCube, OnPlateau};
use super::patches::{NONE, Patches};
use crate::simd::{LANES, SimdLevel};

/// Patches that a group looks at, at most. More are worth a search: the mesh is much finer than the voxels, or made of slivers.
const TRIED_MAX: usize = 32;

/// Eight cells and what they have found. One group serves many cubes, as it is too large to be made anew for each.
pub(super) struct Group {
    simd_level: SimdLevel,
    pub(super) cube: Cube,
    pub(super) nearest: NearestOfEight,
    /// Cells that lead on to other patches.
    wanted: u8,
    tried: [u32; TRIED_MAX],
    n_tried: usize,
    n_measured: usize,
    /// A patch could not be looked at.
    is_cut_short: bool,
    /// `[n_measured]`: what measuring them gave.
    found: [Measured; TRIED_MAX],
}

impl Group {
    pub(super) fn new(simd_level: SimdLevel) -> Self {
        Self {
            simd_level,
            cube: Cube { base: [0; 3], step: 1 },
            nearest: NearestOfEight { squared: [f32::INFINITY; LANES], patch_idx: [NONE; LANES] },
            wanted: 0,
            tried: [NONE; TRIED_MAX],
            n_tried: 0,
            n_measured: 0,
            is_cut_short: false,
            found: [Measured::default(); TRIED_MAX],
        }
    }

    /// Turns to other cells and forgets everything. `wanted`: cells that count, one bit each.
    pub(super) fn restart(&mut self, cube: Cube, wanted: u8) {
        (self.cube, self.wanted) = (cube, wanted);
        self.nearest = NearestOfEight { squared: [f32::INFINITY; LANES], patch_idx: [NONE; LANES] };
        (self.n_tried, self.n_measured, self.is_cut_short) = (0, 0, false);
    }

    /// Leaves the cells that do not count as they are, so that no search goes on for their sake.
    pub(super) fn only_wanted(&mut self) {
        for lane in (0..LANES).filter(|lane| self.wanted >> lane & 1 == 0) {
            self.nearest.squared[lane] = 0.0;
        }
    }

    /// Puts a patch on the list; [`NONE`] and known ones are let pass.
    #[inline]
    pub(super) fn consider(&mut self, patch_idx: u32) {
        if patch_idx == NONE || self.tried[..self.n_tried].contains(&patch_idx) {
            return;
        }
        if self.n_tried == TRIED_MAX {
            self.is_cut_short = true;
            return;
        }
        self.tried[self.n_tried] = patch_idx;
        self.n_tried += 1;
    }

    /// Measures the patches on the list, and those to which they lead. False when a way ended early: at an edge with nothing known
    /// across, or because there were too many patches.
    pub(super) fn settle(&mut self, patches: &Patches) -> bool {
        while self.n_measured < self.n_tried {
            let round = self.n_measured..self.n_tried;
            self.n_measured = self.n_tried;
            for idx in round.clone() {
                let patch_idx = self.tried[idx];
                let patch = &patches.all[patch_idx as usize];
                // Written in place: a copy of bytes just written one by one would stall the processor.
                let (nearest, measured) = (&mut self.nearest, &mut self.found[idx]);
                self.simd_level.run(OfCube { patch, patch_idx, cube: self.cube, nearest, measured });
            }
            for idx in round {
                let Measured { squared, on_edge } = &self.found[idx];
                let near = self.simd_level.run(OnPlateau { squared, nearest: &self.nearest }) & self.wanted;
                if near == 0 {
                    continue;
                }
                let on_edge = *on_edge;
                let across = patches.across(self.tried[idx]);
                for edge in 0..3 {
                    if on_edge[edge] & near != 0 {
                        self.is_cut_short |= across[edge] == NONE;
                        self.consider(across[edge]);
                    }
                }
            }
        }
        !self.is_cut_short
    }
}
