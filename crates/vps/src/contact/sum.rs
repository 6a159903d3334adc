//! The sum over touching blocks, sixteen lanes at a time.
//!
//! A few blocks are added up in `f32`, eight lane sums per quantity (lane n and lane n + 8 of a block together), then these sums in `f64`.
//! One generic source, with an instance that takes lanes one by one and one that takes eight at once; both give the same bits.

use glam::DVec3;

use super::contact_block::ContactBlock;
use crate::pointshell::shell::{LANES, Lanes, Lanes3};
use crate::spatial::Mat6;

/// Lanes that are summed apart.
pub(super) const APART: usize = LANES / 2;
/// Force, moment, the upper triangle of the stiffness, depth, depth × arm, effective count.
const QUANTITIES: usize = 3 + 3 + 21 + 1 + 3 + 1;
/// Blocks that are added up in `f32`: sixteen numbers per lane, which takes no more from them than the rounding of positions does.
const BLOCKS_PER_PART: u32 = 8;

/// Eight numbers.
pub(super) trait Eight: Copy {
    fn splat(value: f32) -> Self;
    fn add(self, other: Self) -> Self;
    fn sub(self, other: Self) -> Self;
    fn mul(self, other: Self) -> Self;
    /// The lesser; the second where either is not a number.
    fn min(self, other: Self) -> Self;
    /// Half of sixteen, the second where `high`; 0 where the bit of the lane is not set.
    fn load(lanes: &[f32; LANES], high: bool, wanted: u16) -> Self;
    /// Adds to a lane sum.
    fn add_to(self, sum: &mut [f32; APART]);
    /// Moves a part into the sums.
    fn settle(part: &mut [f32; APART], sum: &mut [f64; APART]);
}

/// What one face adds, tool axes, metres instead of newtons (stiffness is multiplied in later).
#[derive(Clone, Copy, Debug)]
pub(super) struct Sums {
    part: [[f32; APART]; QUANTITIES],
    n_blocks_in_part: u32,
    lanes: [[f64; APART]; QUANTITIES],
}

/// How a point's depth becomes force.
#[derive(Clone, Copy, Debug)]
pub(super) struct Weighting {
    per_half_voxel: f32,
    per_quarter_voxel: f32,
    spatial: bool,
}

impl Weighting {
    /// `spatial`: stage S, smooth entry over the first half voxel.
    pub(super) fn new(voxel_size_m: f32, spatial: bool) -> Self {
        Self { per_half_voxel: 2.0 / voxel_size_m, per_quarter_voxel: 4.0 / voxel_size_m, spatial }
    }
}

/// What eight lanes add: the columns of w = (n, r × n), and their factors.
#[derive(Clone, Copy)]
struct Half<E> {
    columns: [E; 6],
    arm: [E; 3],
    depth: E,
    force: E,
    stiffness: E,
    effective: E,
}

impl<E: Eight> Half<E> {
    #[inline(always)]
    fn of(
        touched: &ContactBlock,
        (positions, normals): (&Lanes3, &Lanes3),
        weights: Option<&Lanes>,
        by: Weighting,
        high: bool,
    ) -> Self {
        let wanted = touched.lanes;
        let (one, counts) = (E::splat(1.0), E::splat(touched.weight));
        let stands_for = match weights {
            Some(weights) => E::load(&weights.0, high, wanted),
            None => counts,
        };
        let depth = E::load(&touched.depths_m, high, wanted);
        let (nx, ny, nz) =
            (E::load(&normals.x.0, high, wanted), E::load(&normals.y.0, high, wanted), E::load(&normals.z.0, high, wanted));
        let (rx, ry, rz) =
            (E::load(&positions.x.0, high, wanted), E::load(&positions.y.0, high, wanted), E::load(&positions.z.0, high, wanted));
        let moment = [ry.mul(nz).sub(rz.mul(ny)), rz.mul(nx).sub(rx.mul(nz)), rx.mul(ny).sub(ry.mul(nx))];
        // Lanes without contact have a depth of 0, and a normal and an arm of 0: whatever their factors are, they add nothing.
        let (share, slope) = if by.spatial {
            // w = t²(3 − 2t), d·w' = 6t²(1 − t), with t = d/(s/2) up to 1: the entry weight of stage S.
            let t = depth.mul(E::splat(by.per_half_voxel)).min(one);
            let squared = t.mul(t);
            let smooth = squared.mul(E::splat(3.0).sub(t.add(t)));
            (smooth, smooth.add(squared.mul(E::splat(6.0)).mul(one.sub(t))))
        } else {
            (one, one)
        };
        let depth_weighted = depth.mul(stands_for);
        Self {
            columns: [nx, ny, nz, moment[0], moment[1], moment[2]],
            arm: [rx, ry, rz],
            depth: depth_weighted,
            force: depth_weighted.mul(share),
            stiffness: slope.mul(stands_for),
            // Our smooth count: a contact counts fully from a quarter voxel on, so that normalisation has no steps.
            effective: depth.mul(E::splat(by.per_quarter_voxel)).min(one).mul(counts),
        }
    }
}

impl Sums {
    pub(super) const ZERO: Self = Self { part: [[0.0; APART]; QUANTITIES], n_blocks_in_part: 0, lanes: [[0.0; APART]; QUANTITIES] };

    /// Adds the lanes of a block that touch, each by its own weight where these are given.
    #[inline(always)]
    pub(super) fn add<E: Eight>(&mut self, touched: &ContactBlock, at: (&Lanes3, &Lanes3), weights: Option<&Lanes>, by: Weighting) {
        let low = Half::<E>::of(touched, at, weights, by, false);
        let high = Half::<E>::of(touched, at, weights, by, true);
        let mut sums = self.part.iter_mut();
        let ([a, b, c, d, e, f], [g, h, i, j, k, l]) = (low.columns, high.columns);
        put(&mut sums, (low.force, high.force), low.columns, high.columns);
        // Row by row, as loops of a length that the compiler knows.
        let by_row = |low_first: E, high_first: E| (low.stiffness.mul(low_first), high.stiffness.mul(high_first));
        put(&mut sums, by_row(a, g), [a, b, c, d, e, f], [g, h, i, j, k, l]);
        put(&mut sums, by_row(b, h), [b, c, d, e, f], [h, i, j, k, l]);
        put(&mut sums, by_row(c, i), [c, d, e, f], [i, j, k, l]);
        put(&mut sums, by_row(d, j), [d, e, f], [j, k, l]);
        put(&mut sums, by_row(e, k), [e, f], [k, l]);
        put(&mut sums, by_row(f, l), [f], [l]);
        put(&mut sums, (E::splat(1.0), E::splat(1.0)), [low.depth], [high.depth]);
        put(&mut sums, (low.depth, high.depth), low.arm, high.arm);
        put(&mut sums, (E::splat(1.0), E::splat(1.0)), [low.effective], [high.effective]);
        self.n_blocks_in_part += 1;
        if self.n_blocks_in_part == BLOCKS_PER_PART {
            self.settle::<E>();
        }
    }

    /// Adds the part to the sums.
    #[inline(always)]
    fn settle<E: Eight>(&mut self) {
        for (sums, parts) in self.lanes.iter_mut().zip(&mut self.part) {
            E::settle(parts, sums);
        }
        self.n_blocks_in_part = 0;
    }

    /// The totals.
    pub(super) fn total(mut self) -> Total {
        self.settle::<[f32; APART]>();
        let mut totals = self.lanes.iter().map(|[a, b, c, d, e, f, g, h]| ((a + b) + (c + d)) + ((e + f) + (g + h)));
        let mut next = || totals.next().unwrap_or(0.0);
        let mut vector = || DVec3::new(next(), next(), next());
        let (depth_normal, depth_moment) = (vector(), vector());
        let mut stiffness = Mat6::ZERO;
        for row in 0..6 {
            for column in row..6 {
                let value = next();
                for (i, j) in [(row, column), (column, row)] {
                    if let Some(entry) = stiffness.0.get_mut(i).and_then(|row| row.get_mut(j)) {
                        *entry = value;
                    }
                }
            }
        }
        let depth = next();
        let depth_arm = DVec3::new(next(), next(), next());
        Total { depth_normal, depth_moment, stiffness, depth, depth_arm, effective: next() }
    }
}

/// Adds factor · column, low and high lanes together, to the next sums. No closure: it could not be compiled for AVX2 apart from what it
/// stands in.
#[inline(always)]
fn put<'a, E: Eight, const N: usize>(
    sums: &mut impl Iterator<Item = &'a mut [f32; APART]>,
    (low_factor, high_factor): (E, E),
    low: [E; N],
    high: [E; N],
) {
    for ((low, high), sum) in low.into_iter().zip(high).zip(sums) {
        low_factor.mul(low).add(high_factor.mul(high)).add_to(sum);
    }
}

/// Sums over all contacts of one face.
#[derive(Clone, Copy, Debug)]
pub(super) struct Total {
    pub(super) depth_normal: DVec3,
    pub(super) depth_moment: DVec3,
    pub(super) stiffness: Mat6,
    pub(super) depth: f64,
    pub(super) depth_arm: DVec3,
    pub(super) effective: f64,
}

impl Eight for [f32; APART] {
    #[inline(always)]
    fn splat(value: f32) -> Self {
        [value; APART]
    }
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        lane_by_lane(self, other, |a, b| a + b)
    }
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        lane_by_lane(self, other, |a, b| a - b)
    }
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        lane_by_lane(self, other, |a, b| a * b)
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        lane_by_lane(self, other, |a, b| if a < b { a } else { b })
    }
    #[inline(always)]
    fn load(lanes: &[f32; LANES], high: bool, wanted: u16) -> Self {
        let first = if high { APART } else { 0 };
        core::array::from_fn(|k| if wanted >> (first + k) & 1 == 1 { lanes.get(first + k).copied().unwrap_or(0.0) } else { 0.0 })
    }
    #[inline(always)]
    fn add_to(self, sum: &mut [f32; APART]) {
        *sum = Eight::add(*sum, self);
    }
    #[inline(always)]
    fn settle(part: &mut [f32; APART], sum: &mut [f64; APART]) {
        for (sum, part) in sum.iter_mut().zip(part) {
            *sum += f64::from(core::mem::take(part));
        }
    }
}

#[inline(always)]
fn lane_by_lane(mut a: [f32; APART], b: [f32; APART], of: impl Fn(f32, f32) -> f32) -> [f32; APART] {
    for (a, b) in a.iter_mut().zip(b) {
        *a = of(*a, b);
    }
    a
}
