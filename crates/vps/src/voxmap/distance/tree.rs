//! The patches nearest to the cells of a cube, or of a brick, searched exactly.

use super::block::{Block, HALF_SPAN_CELLS};
use super::kernel::{Cube, NearestOfEight, WidePatch, offsets};
use super::patches::Patch;
use crate::parallel;
use crate::simd::{F32x8, I32s, LANES};
use crate::voxmap::surface::bits;

/// Added to every box, cells: more than `f32` coordinates are rounded by on the largest grid.
const SLACK_CELLS: f32 = 0.02;
/// Nodes that can wait at most: seven siblings on each of the levels that 2³² patches make.
const WAITING_MAX: usize = 7 * 11 + 1;

/// Added to all limits, cells: the next constant, and more than rounding may be worth.
const LIMIT_SLACK_CELLS: f32 = 0.02;
/// Ways from a patch shorter than this have no direction, cells.
const DIRECTED_CELLS: f32 = 0.01;

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

    /// For each box the least squared distance of a point that comes closer to it than to `share` of
    /// its own nearest patch, cells²; infinite where none does, and no bit is set. `nearest`: of
    /// each point, cells².
    #[inline(always)]
    fn bounds<L: F32x8>(
        &self,
        points: &[[f32; LANES]; 3],
        nearest: &[f32; LANES],
        share: f32,
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
            least = L::select(squared.lt(L::splat(share * nearest[lane])), squared, infinite)
                .min(least);
        }
        least.store(bounds);
        least.lt(infinite).byte()
    }

    /// One bit for each box with a point that is nearer than this to a point between `low` and
    /// `high`; `squared` in cells².
    #[inline(always)]
    fn near<L: F32x8>(&self, low: &[f32; 3], high: &[f32; 3], squared: f32) -> u8 {
        let mut gap_squared = L::splat(0.0);
        for axis in 0..3 {
            let gap = (L::load(&self.low[axis]) - L::splat(high[axis]))
                .max(L::splat(low[axis]) - L::load(&self.high[axis]))
                .max(L::splat(0.0));
            gap_squared = gap_squared + gap * gap;
        }
        gap_squared.lt(L::splat(squared)).byte()
    }

    /// The ways from the closest points of a box to points in centre coordinates, cells.
    #[inline(always)]
    fn ways<L: F32x8>(&self, lane: usize, points: &[L; 3]) -> [L; 3] {
        let zero = L::splat(0.0);
        let mut away = [zero; 3];
        for axis in 0..3 {
            let below = (L::splat(self.low[axis][lane]) - points[axis]).max(zero);
            let above = (points[axis] - L::splat(self.high[axis][lane])).max(zero);
            away[axis] = above - below;
        }
        away
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

    /// Finds the nearest patches of all eight cells of a cube, whatever they have found before; with
    /// a `share` below 1 patches of which that share of the squared distance is no more than the
    /// least.
    #[inline(always)]
    pub(super) fn search<L: F32x8>(&self, cube: Cube, share: f32, nearest: &mut NearestOfEight<L>) {
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
            if bound >= share * farthest {
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
            let hits = self.levels[level][node as usize].bounds::<L>(
                &points,
                &squared,
                share,
                &mut bounds,
            );
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
    /// Measures every patch that may be nearer to a cell of the blocks of a brick than what the
    /// block has found: after this each of their cells has its nearest patch.
    ///
    /// Cost: a test of each box that is as near to the brick as its farthest cell is to the surface.
    /// On the Stanford bunny at 256 voxels these are 330 boxes and 150 patches a brick.
    #[inline(always)]
    pub(super) fn complete<L: F32x8>(&self, blocks: &mut [Block<L>; LANES]) {
        let limits = Limits::new(blocks);
        let mut waiting = [(0_u32, 0_u8); WAITING_MAX];
        waiting[0] = (0, self.levels.len() as u8);
        let mut n_waiting = 1;
        while n_waiting > 0 {
            n_waiting -= 1;
            let (node, height) = waiting[n_waiting];
            let Some(level) = usize::from(height).checked_sub(1) else {
                let patch = WidePatch::<L>::new(&self.patches[node as usize]);
                let gaps = Gaps::new(&limits, patch.ways(&limits.middle));
                for block in bits(gaps.are_below(limits.at_middle).into()) {
                    let block_idx = block as usize % LANES;
                    let block = &mut blocks[block_idx];
                    if !block.knows(node) {
                        block.measure(&patch, node, gaps.near_cubes(&limits, block_idx));
                    }
                }
                continue;
            };
            let boxes = &self.levels[level][node as usize];
            let hits = boxes.near::<L>(&limits.low, &limits.high, limits.farthest_squared);
            for lane in bits(hits.into()) {
                let gaps = Gaps::new(&limits, boxes.ways(lane as usize, &limits.middle));
                if gaps.are_below(limits.at_middle) != 0 {
                    waiting[n_waiting] = (node * LANES as u32 + lane, level as u8);
                    n_waiting += 1;
                }
            }
        }
    }
}

/// The [`Limit`](super::block::Limit)s of eight blocks, one a lane.
struct Limits<L> {
    /// Of the blocks, in centre coordinates.
    middle: [L; 3],
    slope: [L; 3],
    /// The largest of the cubes.
    at_middle: L,
    /// `[LANES]`: of each block those of its cubes, one a lane.
    at_cubes: [L; LANES],
    /// Around the cells of all, in centre coordinates.
    low: [f32; 3],
    high: [f32; 3],
    /// The largest of all, cells².
    farthest_squared: f32,
}

impl<L: F32x8> Limits<L> {
    #[inline(always)]
    fn new(blocks: &[Block<L>; LANES]) -> Self {
        let mut middles = [[0.0; LANES]; 3];
        let mut slopes = [[0.0; LANES]; 3];
        let mut at_middle = [f32::NEG_INFINITY; LANES];
        let mut at_cubes = [L::splat(f32::NEG_INFINITY); LANES];
        let mut low = [f32::INFINITY; 3];
        let mut high = [f32::NEG_INFINITY; 3];
        let mut farthest = 0.0_f32;
        for (lane, block) in blocks.iter().enumerate().filter(|(_, block)| block.is_wanted()) {
            let limit = block.limit();
            at_cubes[lane] = L::load(&limit.at_middle) + L::splat(LIMIT_SLACK_CELLS);
            at_middle[lane] = at_cubes[lane].max_lane();
            farthest = farthest.max(limit.farthest);
            let middle = block.middle();
            for axis in 0..3 {
                middles[axis][lane] = middle[axis];
                slopes[axis][lane] = limit.slope[axis];
                low[axis] = low[axis].min(middle[axis] - HALF_SPAN_CELLS);
                high[axis] = high[axis].max(middle[axis] + HALF_SPAN_CELLS);
            }
        }
        let [x, y, z] = middles;
        let [along_x, along_y, along_z] = slopes;
        Self {
            middle: [L::load(&x), L::load(&y), L::load(&z)],
            slope: [L::load(&along_x), L::load(&along_y), L::load(&along_z)],
            at_middle: L::load(&at_middle),
            at_cubes,
            low,
            high,
            farthest_squared: farthest * farthest,
        }
    }
}

/// How far eight blocks are from something convex, one a lane.
///
/// The distance from something convex is a convex function: nowhere less than what its value at the
/// middle and its slope there, a unit vector, make of it. So at a way w from the middle it is above
/// a limit l + s·w as long as `distance` − `differing`·w is above l.
struct Gaps<L> {
    /// Of the middles, cells.
    distance: L,
    /// The slope of the limit less that of the distance.
    differing: [L; 3],
    /// The sum of their magnitudes.
    steepest: L,
}

impl<L: F32x8> Gaps<L> {
    /// `away`: from there to the middles, cells.
    #[inline(always)]
    fn new(limits: &Limits<L>, away: [L; 3]) -> Self {
        let zero = L::splat(0.0);
        let distance = (away[0] * away[0] + away[1] * away[1] + away[2] * away[2]).sqrt();
        let is_directed = L::splat(DIRECTED_CELLS).lt(distance);
        let inverse = (L::splat(1.0) / distance).only(is_directed);
        let mut differing = [zero; 3];
        let mut steepest = zero;
        for axis in 0..3 {
            differing[axis] = limits.slope[axis] - away[axis] * inverse;
            steepest = steepest + differing[axis].max(zero - differing[axis]);
        }
        Self { distance, differing, steepest }
    }

    /// One bit for each block to a cell of which it may come nearer than these limits.
    #[inline(always)]
    fn are_below(&self, at_middle: L) -> u8 {
        (self.distance - self.steepest * L::splat(HALF_SPAN_CELLS)).lt(at_middle).byte()
    }

    /// The same for the cubes of one block, whose middles are one cell away from that of the block
    /// along each axis, and half a cell from those of their cells.
    #[inline(always)]
    fn near_cubes(&self, limits: &Limits<L>, block: usize) -> u8 {
        let one = L::splat(1.0);
        let mut numbers = [[0.0; LANES]; 5];
        self.distance.store(&mut numbers[0]);
        self.steepest.store(&mut numbers[1]);
        for axis in 0..3 {
            self.differing[axis].store(&mut numbers[2 + axis]);
        }
        let mut distance = L::splat(numbers[0][block] - 0.5 * numbers[1][block]);
        let offsets = offsets::<L::Int>(2);
        for axis in 0..3 {
            distance =
                distance - L::splat(numbers[2 + axis][block]) * (L::of_int(offsets[axis]) - one);
        }
        distance.lt(limits.at_cubes[block]).byte()
    }
}
