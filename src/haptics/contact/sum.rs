//! The sum over touching blocks, sixteen lanes at a time.
//!
//! Four lane sums in `f64` per quantity; points are added in their order, lane n mod 4. One generic source, with an instance that
//! takes lanes one by one and one that takes four at once; both give the same bits.

use glam::DVec3;

use super::touched::Touched;
use crate::pointshell::shell::{LANES, Lanes3};
use crate::spatial::Mat6;

/// Lanes that are summed apart.
const APART: usize = 4;
/// Force, moment, the upper triangle of the stiffness, depth, depth × arm, effective count.
const QUANTITIES: usize = 3 + 3 + 21 + 1 + 3 + 1;

/// Four numbers.
pub(super) trait Four: Copy {
    fn splat(value: f64) -> Self;
    fn add(self, other: Self) -> Self;
    fn sub(self, other: Self) -> Self;
    fn mul(self, other: Self) -> Self;
    /// The lesser; the second where either is not a number.
    fn min(self, other: Self) -> Self;
    /// Four of sixteen, from lane 4 · `quarter` on; 0 where the bit of the lane is not set.
    fn load(lanes: &[f32; LANES], quarter: usize, wanted: u16) -> Self;
    /// Adds to a lane sum.
    fn add_to(self, sum: &mut [f64; APART]);
}

/// What one face adds, tool axes, metres instead of newtons (stiffness is multiplied in later).
#[derive(Clone, Copy, Debug)]
pub(super) struct Sums {
    lanes: [[f64; APART]; QUANTITIES],
}

/// How a point's depth becomes force.
#[derive(Clone, Copy, Debug)]
pub(super) struct Weighting {
    pub(super) voxel_size_m: f64,
    /// Stage S: smooth entry over the first half voxel.
    pub(super) spatial: bool,
}

impl Sums {
    pub(super) const ZERO: Self = Self { lanes: [[0.0; APART]; QUANTITIES] };

    /// Adds the lanes of a block that touch.
    #[inline(always)]
    pub(super) fn add<F: Four>(&mut self, touched: &Touched, positions: &Lanes3, normals: &Lanes3, by: Weighting) {
        let (one, stands_for) = (F::splat(1.0), F::splat(f64::from(touched.weight)));
        let per_half_voxel = F::splat(2.0 / by.voxel_size_m);
        let per_quarter_voxel = F::splat(4.0 / by.voxel_size_m);
        for quarter in 0..LANES / APART {
            if touched.lanes >> (APART * quarter) & 15 == 0 {
                continue;
            }
            let wanted = touched.lanes;
            let depth = F::load(&touched.depths_m, quarter, wanted);
            let normal = [
                F::load(&normals.x.0, quarter, wanted),
                F::load(&normals.y.0, quarter, wanted),
                F::load(&normals.z.0, quarter, wanted),
            ];
            let arm = [
                F::load(&positions.x.0, quarter, wanted),
                F::load(&positions.y.0, quarter, wanted),
                F::load(&positions.z.0, quarter, wanted),
            ];
            let [[nx, ny, nz], [rx, ry, rz]] = [normal, arm];
            let moment = [ry.mul(nz).sub(rz.mul(ny)), rz.mul(nx).sub(rx.mul(nz)), rx.mul(ny).sub(ry.mul(nx))];
            // Lanes without contact have a depth of 0, and a normal and an arm of 0: whatever their factors are, they add nothing.
            let (share, slope) = if by.spatial {
                // w = t²(3 − 2t), d·w' = 6t²(1 − t), with t = d/(s/2) up to 1: the entry weight of stage S.
                let t = depth.mul(per_half_voxel).min(one);
                let squared = t.mul(t);
                let smooth = squared.mul(F::splat(3.0).sub(t.add(t)));
                (smooth, smooth.add(squared.mul(F::splat(6.0)).mul(one.sub(t))))
            } else {
                (one, one)
            };
            let depth_weighted = depth.mul(stands_for);
            let force = depth_weighted.mul(share);
            let stiffness = slope.mul(stands_for);
            let columns = [nx, ny, nz, moment[0], moment[1], moment[2]];
            let mut sums = self.lanes.iter_mut();
            for column in columns {
                put(&mut sums, force.mul(column));
            }
            for (row, first) in columns.into_iter().enumerate() {
                let scaled = stiffness.mul(first);
                for second in columns.into_iter().skip(row) {
                    put(&mut sums, scaled.mul(second));
                }
            }
            put(&mut sums, depth_weighted);
            for arm in arm {
                put(&mut sums, depth_weighted.mul(arm));
            }
            // Our smooth count: a contact counts fully from a quarter voxel on, so that normalisation has no steps.
            put(&mut sums, depth.mul(per_quarter_voxel).min(one).mul(stands_for));
        }
    }

    /// The totals.
    pub(super) fn total(&self) -> Total {
        let mut totals = self.lanes.iter().map(|[a, b, c, d]| (a + b) + (c + d));
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

/// Adds to the next sum. No closure: it could not be compiled for AVX2 apart from what it stands in.
#[inline(always)]
fn put<'a, F: Four>(sums: &mut impl Iterator<Item = &'a mut [f64; APART]>, value: F) {
    if let Some(sum) = sums.next() {
        value.add_to(sum);
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

impl Four for [f64; APART] {
    #[inline(always)]
    fn splat(value: f64) -> Self {
        [value; APART]
    }
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        let ([a, b, c, d], [e, f, g, h]) = (self, other);
        [a + e, b + f, c + g, d + h]
    }
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        let ([a, b, c, d], [e, f, g, h]) = (self, other);
        [a - e, b - f, c - g, d - h]
    }
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        let ([a, b, c, d], [e, f, g, h]) = (self, other);
        [a * e, b * f, c * g, d * h]
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        let least = |a: f64, b: f64| if a < b { a } else { b };
        let ([a, b, c, d], [e, f, g, h]) = (self, other);
        [least(a, e), least(b, f), least(c, g), least(d, h)]
    }
    #[inline(always)]
    fn load(lanes: &[f32; LANES], quarter: usize, wanted: u16) -> Self {
        core::array::from_fn(|k| {
            let lane = APART * quarter + k;
            if wanted >> lane & 1 == 1 { lanes.get(lane).copied().map_or(0.0, f64::from) } else { 0.0 }
        })
    }
    #[inline(always)]
    fn add_to(self, sum: &mut [f64; APART]) {
        *sum = Four::add(*sum, self);
    }
}
