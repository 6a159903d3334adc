//! The patches nearest to the cells of a cube, searched exactly.

use super::kernel::{Cube, NearestOfEight, offsets};
use super::patches::Patch;
use crate::parallel;
use crate::simd::{F32x8, I32s, LANES};
use crate::voxmap::surface::bits;

/// Added to every box, cells: more than `f32` coordinates are rounded by on the largest grid.
const SLACK_CELLS: f32 = 0.02;
/// Nodes that can wait at most: seven siblings on each of the levels that 2³² patches make.
const WAITING_MAX: usize = 7 * 11 + 1;

/// Eight boxes, coordinate by coordinate, in centre coordinates (the centre of cell `[i, j, k]` is
/// (i, j, k)).
#[derive(Clone, Copy, Debug)]
struct Boxes {
    low: [[f32; LANES]; 3],
    high: [[f32; LANES]; 3],
}

impl Boxes {
    /// Boxes that nothing is in, infinitely far from everything.
    const EMPTY: Self =
        Self { low: [[f32::INFINITY; LANES]; 3], high: [[f32::NEG_INFINITY; LANES]; 3] };

    /// The box around all eight.
    fn hull(&self) -> ([f32; 3], [f32; 3]) {
        let fold = |lanes: &[f32; LANES], start: f32, choose: fn(f32, f32) -> f32| {
            lanes.iter().copied().fold(start, choose)
        };
        (
            self.low.each_ref().map(|lanes| fold(lanes, f32::INFINITY, f32::min)),
            self.high.each_ref().map(|lanes| fold(lanes, f32::NEG_INFINITY, f32::max)),
        )
    }

    /// For each box the least squared distance of a point that comes closer to it than to its own
    /// nearest patch, cells²; infinite where none does, and no bit is set. `nearest`: of each
    /// point, cells².
    #[inline(always)]
    fn bounds<L: F32x8>(
        &self,
        points: &[[f32; LANES]; 3],
        nearest: &[f32; LANES],
        bounds: &mut [f32; LANES],
    ) -> u8 {
        let zero = L::splat(0.0);
        let infinite = L::splat(f32::INFINITY);
        let mut least = infinite;
        for lane in 0..LANES {
            let mut squared = zero;
            #[expect(
                clippy::needless_range_loop,
                reason = "three arrays are read at the same place"
            )]
            for axis in 0..3 {
                let point = L::splat(points[axis][lane]);
                let away = (L::load(&self.low[axis]) - point)
                    .max(point - L::load(&self.high[axis]))
                    .max(zero);
                squared = squared + away * away;
            }
            least = L::select(squared.lt(L::splat(nearest[lane])), squared, infinite).min(least);
        }
        least.store(bounds);
        least.lt(infinite).byte()
    }

    fn set(&mut self, lane: usize, (low, high): ([f32; 3], [f32; 3])) {
        for axis in 0..3 {
            (self.low[axis][lane], self.high[axis][lane]) = (low[axis], high[axis]);
        }
    }
}

/// A complete tree of eight children a node over patches that are in the order of a space-filling
/// curve.
pub(super) struct PatchTree<'a> {
    patches: &'a [Patch],
    /// Boxes of the patches, eight in a row a node; then of those nodes, and so on up to one node.
    levels: Vec<Vec<Boxes>>,
}

impl<'a> PatchTree<'a> {
    /// `patches` in the order of [`Patches`](super::patches::Patches), and not empty. Cost:
    /// O(patches); memory 28 bytes per patch.
    pub(super) fn new(patches: &'a [Patch]) -> Self {
        let mut below =
            parallel::map(patches.len(), 1, |patch_idx| patches[patch_idx].bounds(SLACK_CELLS));
        let mut levels = Vec::new();
        loop {
            let level = parallel::map_chunks(&below, LANES, |children| {
                let mut boxes = Boxes::EMPTY;
                children.iter().enumerate().for_each(|(lane, child)| boxes.set(lane, *child));
                boxes
            });
            below = parallel::map(level.len(), 1, |node| level[node].hull());
            levels.push(level);
            if below.len() == 1 {
                return Self { patches, levels };
            }
        }
    }

    /// Finds the nearest patches of all eight cells of a cube, whatever they have found before.
    #[inline(always)]
    pub(super) fn search<L: F32x8>(&self, cube: Cube, nearest: &mut NearestOfEight<L>) {
        let offsets = offsets::<L::Int>(cube.step);
        let mut points = [[0.0; LANES]; 3];
        for axis in 0..3 {
            L::of_int(offsets[axis] + L::Int::splat(cube.base[axis])).store(&mut points[axis]);
        }
        let mut waiting = [(0.0_f32, 0_u32, 0_u8); WAITING_MAX];
        waiting[0] = (0.0, 0, self.levels.len() as u8);
        let mut n_waiting = 1;
        let mut farthest = nearest.squared.max_lane();
        while n_waiting > 0 {
            n_waiting -= 1;
            let (bound, node, height) = waiting[n_waiting];
            if bound >= farthest {
                continue;
            }
            let Some(level) = usize::from(height).checked_sub(1) else {
                nearest.measure_cube(&self.patches[node as usize], node, cube);
                farthest = nearest.squared.max_lane();
                continue;
            };
            let mut squared = [0.0; LANES];
            nearest.squared.store(&mut squared);
            let mut bounds = [0.0; LANES];
            let hits =
                self.levels[level][node as usize].bounds::<L>(&points, &squared, &mut bounds);
            let first = n_waiting;
            for lane in bits(hits.into()) {
                let bound = bounds[lane as usize];
                // The nearest last, so that it is the next; equal ones in the order of the tree.
                let mut place = n_waiting;
                while place > first && waiting[place - 1].0 <= bound {
                    waiting[place] = waiting[place - 1];
                    place -= 1;
                }
                waiting[place] = (bound, node * LANES as u32 + lane, level as u8);
                n_waiting += 1;
            }
        }
    }
}
