//! How much of a facet is immersed, where it does not lie in its obstacle as a whole.
//!
//! A facet counts as the rectangle with its second moment of area, half axes a and b. By the depth d
//! and its gradient g at the centroid, with α = a·g, β = b·g, the depth ranges by w = √(α² + β²) to
//! both sides, deepest on the way y = (aα + bβ)/w from the centroid. It is taken as spread evenly
//! along this way, linear from the centroid, d, to both ends, d ± w. Of what is above zero on a half
//! that goes from p to q, with P, Q these where they are above zero and else 0,
//!
//! ```text
//!   L = (P + Q) / (|p| + |q|)            its share
//!   L (P + Q)/2                          mean depth
//!   L (P L + Q (3 − L))/6 · y            first moment
//! ```
//! and the facet has the mean of both halves, m, t = ∂m/∂d and the moment. For d ± w that is w t² with
//! t = (d/w + 1)/2: exact for a rectangle whose side lies along the surface, and off by 0.0143 w at
//! most for a square. A point has no extent: w = 0, and t is 0 or 1.
//!
//! Beside an edge of the obstacle the gradient promises more than there is: a face that lies over the
//! rim of a block would stand on what is beside it. So while the surface is near the depth is
//! looked up at both ends, and where it is less, that counts: the *shortfall*.
//!
//! # Source
//! Ours.

use glam::Vec3;

use crate::pointshell::shell::{LANES, Lanes3, STEEPEST, Shell};
use crate::simd::F32s;
use crate::voxmap::field::{Field, FieldKind};

/// Share of what is known of a field outside its object that facets may reach: beyond, far and near
/// look alike.
const KNOWN_SHARE: f32 = 0.99;

/// The largest w that counts in a field, m. Only interpolation gives gradients with its depths: with
/// other look-ups facets count as points do.
pub(super) fn limit_m(field: &Field, kind: FieldKind) -> f32 {
    if kind == FieldKind::Trilinear {
        (KNOWN_SHARE * field.known_outside_m()).max(0.0)
    } else {
        0.0
    }
}

/// By how much less interpolation may say than the planes of an obstacle's creases do, m; 0 where
/// facets count as points do.
pub(super) fn slack_m(field: &Field, kind: FieldKind) -> f32 {
    match kind {
        FieldKind::Trilinear => field.creases().slack_cells() * field.voxel_size_m(),
        _ => 0.0,
    }
}

/// Depth below which no facet of such a reach touches is minus this, m.
#[inline(always)]
pub(super) fn with_slack_m(reach_m: f32, slack_m: f32, limit_m: f32) -> f32 {
    let slack_m = if meets_planes(reach_m, slack_m) { slack_m } else { 0.0 };
    reach_m.max(reach_m / STEEPEST + slack_m).min(limit_m)
}

/// Planes are known about a cell as far as this many slacks: see `LISTED_CELLS` of the creases.
const KNOWN_SLACKS: f32 = 4.0;

/// True of facets that reach no farther than the planes of a cell are known about it.
#[inline(always)]
fn meets_planes(reach_m: f32, slack_m: f32) -> bool {
    reach_m > 0.0 && reach_m / STEEPEST < KNOWN_SLACKS * slack_m
}

/// The extents of the facets of a shell, as a look-up in a field needs them.
#[derive(Clone, Copy, Debug)]
pub(super) struct Extents<'a> {
    half_axes: &'a [[Lanes3; 2]],
    reaches_m: &'a [f32],
    limit_m: f32,
    slack_m: f32,
}

impl<'a> Extents<'a> {
    /// Of points without extent.
    pub(super) const NONE: Self =
        Self { half_axes: &[], reaches_m: &[], limit_m: 0.0, slack_m: 0.0 };

    /// Of a shell, with the limit of [`limit_m`] and the slack of [`slack_m`].
    pub(super) fn of(shell: &'a Shell, limit_m: f32, slack_m: f32) -> Self {
        Self::new(shell.half_axes(), shell.reaches_m(), limit_m, slack_m)
    }

    /// Of blocks given one by one.
    pub(super) fn new(
        half_axes: &'a [[Lanes3; 2]],
        reaches_m: &'a [f32],
        limit_m: f32,
        slack_m: f32,
    ) -> Self {
        Self { half_axes, reaches_m, limit_m, slack_m }
    }

    pub(super) fn limit_m(&self) -> f32 {
        self.limit_m
    }

    /// Depth below which no facet of a block touches by interpolation is minus this, m.
    #[inline(always)]
    pub(super) fn reach_m(&self, block: usize) -> f32 {
        self.reaches_m.get(block).copied().unwrap_or(0.0).min(self.limit_m)
    }

    /// The same by interpolation or by planes.
    #[inline(always)]
    pub(super) fn whole_reach_m(&self, block: usize) -> f32 {
        let reach_m = self.reaches_m.get(block);
        reach_m.map_or(0.0, |reach_m| with_slack_m(*reach_m, self.slack_m, self.limit_m))
    }

    /// True of a block whose facets count by the planes of the obstacle's convex edges where it has
    /// some.
    #[inline(always)]
    pub(super) fn meets_planes(&self, block: usize) -> bool {
        self.reaches_m.get(block).is_some_and(|reach_m| meets_planes(*reach_m, self.slack_m))
    }

    #[inline(always)]
    pub(super) fn half_axes(&self, block: usize) -> Option<&'a [Lanes3; 2]> {
        self.half_axes.get(block)
    }
}

/// Shortfalls count in full up to a depth of w, and no more from this many w on: there the whole
/// facet is inside, and what its mean is off by at a crease is of second order.
const LOOKED_UP_HALVES: f32 = 2.0;
/// Facets over which the depth ranges by less than this have no way along which it does, m.
const LEAST_RANGE_M: f32 = 1e-12;

/// Of facets side by side, how far the depth ranges over them.
pub(super) struct Range<L> {
    /// y, from the centroid to the deepest place, m.
    pub(super) way: [L; 3],
    /// w, m.
    pub(super) half_m: L,
}

impl<L: F32s<LANES>> Range<L> {
    #[inline(always)]
    pub(super) fn of([a, b]: &[Lanes3; 2], [gx, gy, gz]: [L; 3], limit_m: L) -> Self {
        let [ax, ay, az] = [L::load(&a.x.0), L::load(&a.y.0), L::load(&a.z.0)];
        let [bx, by, bz] = [L::load(&b.x.0), L::load(&b.y.0), L::load(&b.z.0)];
        let alpha = ax * gx + ay * gy + az * gz;
        let beta = bx * gx + by * gy + bz * gz;
        let whole_m = (alpha * alpha + beta * beta).sqrt();
        let half_m = whole_m.min(limit_m);
        let ranges = L::splat(LEAST_RANGE_M).lt(whole_m);
        let per = (half_m / (whole_m * whole_m)).only(ranges);
        let way = [
            (ax * alpha + bx * beta) * per,
            (ay * alpha + by * beta) * per,
            (az * alpha + bz * beta) * per,
        ];
        Self { way, half_m }
    }

    /// Lanes of which the ends are to be looked up.
    #[inline(always)]
    pub(super) fn near(&self, depth: L) -> L::Int {
        let zero = L::splat(0.0);
        (zero - self.half_m).lt(depth) & depth.lt(self.half_m * L::splat(LOOKED_UP_HALVES))
    }

    /// By how much a depth `found` at the end is less than the gradient says, m; none in other lanes
    /// than those `near`.
    #[inline(always)]
    pub(super) fn shortfall(&self, near: L::Int, depth: L, (sign, found): (f32, L)) -> L {
        let promised = depth + self.half_m * L::splat(sign);
        let fade = (L::splat(LOOKED_UP_HALVES) - depth / self.half_m).min(L::splat(1.0));
        ((found - promised).min(L::splat(0.0)) * fade).only(near)
    }

    /// What of the facets is immersed.
    #[inline(always)]
    pub(super) fn immersed(&self, depth: L, [near, far]: [L; 2]) -> Immersed<L> {
        let outward = Half::of(depth, depth - self.half_m + near);
        let inward = Half::of(depth, depth + self.half_m + far);
        let third = (inward.lever - outward.lever) * L::splat(1.0 / 12.0);
        Immersed {
            mean: (inward.sum + outward.sum) * L::splat(0.25),
            share: (inward.share + outward.share) * L::splat(0.5),
            lever: [self.way[0] * third, self.way[1] * third, self.way[2] * third],
        }
    }

    /// The depth at the deepest place.
    #[inline(always)]
    pub(super) fn deepest(&self, depth: L, far: L) -> L {
        depth.max(depth + self.half_m + far)
    }
}

/// What is above zero on a half of the way, from p at the centroid to q.
struct Half<L> {
    share: L,
    /// Twice the mean.
    sum: L,
    /// Six times the first moment.
    lever: L,
}

impl<L: F32s<LANES>> Half<L> {
    #[inline(always)]
    fn of(p: L, q: L) -> Self {
        let zero = L::splat(0.0);
        let p_above = p.max(zero);
        let q_above = q.max(zero);
        let above = p_above + q_above;
        let below = (p_above - p) + (q_above - q);
        // Of a point at depth 0 this is not a number, which the limit makes 0.
        let share = (above / (above + below)).max(zero);
        let lever = share * (p_above * share + q_above * (L::splat(3.0) - share));
        Self { share, sum: share * above, lever }
    }
}

/// What of facets side by side is immersed.
pub(super) struct Immersed<L> {
    /// m: mean depth over the facet, m.
    pub(super) mean: L,
    /// t: its slope with depth.
    pub(super) share: L,
    /// Mean over the facet of depth times the way from the centroid, m².
    pub(super) lever: [L; 3],
}

/// The same of one facet, to the bit.
#[derive(Clone, Copy, Debug)]
pub(super) struct FacetRange {
    /// y, m.
    pub(super) way: Vec3,
    /// w, m.
    half_m: f32,
    /// At the ends −y and y, m.
    shortfalls_m: [f32; 2],
}

impl FacetRange {
    #[inline]
    pub(super) fn of(half_axes: Option<[Vec3; 2]>, gradient: Vec3, limit_m: f32) -> Self {
        let [a, b] = half_axes.unwrap_or_default();
        let alpha = a.dot(gradient);
        let beta = b.dot(gradient);
        let whole_m = (alpha * alpha + beta * beta).sqrt();
        let half_m = whole_m.min(limit_m);
        let per = if whole_m > LEAST_RANGE_M { half_m / (whole_m * whole_m) } else { 0.0 };
        Self { way: (a * alpha + b * beta) * per, half_m, shortfalls_m: [0.0; 2] }
    }

    #[inline]
    pub(super) fn with_shortfalls(self, shortfalls_m: [f32; 2]) -> Self {
        Self { shortfalls_m, ..self }
    }

    /// True where the ends are to be looked up.
    #[inline]
    pub(super) fn is_near(&self, depth_m: f32) -> bool {
        depth_m > -self.half_m && depth_m < self.half_m * LOOKED_UP_HALVES
    }

    /// By how much a depth found at the end −y (`sign` −1) or y (1) is less than the gradient says.
    #[inline]
    pub(super) fn shortfall_m(&self, depth_m: f32, (sign, found_m): (f32, f32)) -> f32 {
        let promised_m = depth_m + self.half_m * sign;
        let fade = (LOOKED_UP_HALVES - depth_m / self.half_m).min(1.0);
        (found_m - promised_m).min(0.0) * fade
    }

    /// True where the facet is immersed, be it in part.
    #[inline]
    pub(super) fn touches(&self, depth_m: f32) -> bool {
        depth_m.max(self.ends_m(depth_m)[1]) > 0.0
    }

    fn ends_m(&self, depth_m: f32) -> [f32; 2] {
        let [near, far] = self.shortfalls_m;
        [depth_m - self.half_m + near, depth_m + self.half_m + far]
    }

    fn halves(&self, depth_m: f32) -> [HalfRange; 2] {
        self.ends_m(depth_m).map(|end_m| HalfRange::of(depth_m, end_m))
    }

    /// m, m.
    #[inline]
    pub(super) fn mean_depth_m(&self, depth_m: f32) -> f32 {
        let [outward, inward] = self.halves(depth_m);
        (inward.sum + outward.sum) * 0.25
    }

    /// How deep it is where that is asked, and the way there from the centroid, m: at the centroid
    /// where it is immersed, else at the deepest place.
    pub(super) fn depth_there(&self, depth_m: f32) -> (f32, Vec3) {
        if depth_m > 0.0 || self.half_m <= 0.0 {
            return (depth_m, Vec3::ZERO);
        }
        (self.ends_m(depth_m)[1], self.way)
    }

    /// From the centroid to the middle of what presses, m.
    pub(super) fn lever_m(&self, depth_m: f32) -> Vec3 {
        let [outward, inward] = self.halves(depth_m);
        let mean_m = (inward.sum + outward.sum) * 0.25;
        if mean_m <= 0.0 {
            return self.depth_there(depth_m).1;
        }
        self.way * ((inward.lever - outward.lever) / (12.0 * mean_m))
    }
}

/// [`Half`] of one facet.
#[derive(Clone, Copy, Debug)]
struct HalfRange {
    sum: f32,
    lever: f32,
}

impl HalfRange {
    fn of(p: f32, q: f32) -> Self {
        let p_above = p.max(0.0);
        let q_above = q.max(0.0);
        let above = p_above + q_above;
        let below = (p_above - p) + (q_above - q);
        let share = if above > 0.0 { above / (above + below) } else { 0.0 };
        let lever = share * (p_above * share + q_above * (3.0 - share));
        Self { sum: share * above, lever }
    }
}

#[cfg(test)]
#[expect(clippy::indexing_slicing, reason = "test code")]
mod tests {
    use glam::{DVec2, DVec3};

    use super::*;
    use crate::simd::{F32x8, Kernel, SimdLevel};
    use crate::spatial::testing::Random;

    /// m and φ Cg of facets side by side.
    struct Lanewise<'a> {
        half_axes: &'a [Lanes3; 2],
        gradients: &'a Lanes3,
        depths_m: &'a [f32; LANES],
        shortfalls_m: [&'a [f32; LANES]; 2],
    }

    impl Kernel for Lanewise<'_> {
        type Output = ([f32; LANES], [f32; LANES], Lanes3);

        #[inline(always)]
        fn run<L: F32x8>(self) -> Self::Output {
            let Lanes3 { x, y, z } = self.gradients;
            let gradient = [L::Wide::load(&x.0), L::Wide::load(&y.0), L::Wide::load(&z.0)];
            let range = Range::of(self.half_axes, gradient, L::Wide::splat(1e3));
            let depth = L::Wide::load(self.depths_m);
            let shortfalls = self.shortfalls_m.map(L::Wide::load);
            let Immersed { mean, share, lever } = range.immersed(depth, shortfalls);
            let mut found = ([0.0; LANES], [0.0; LANES], Lanes3::ZERO);
            mean.store(&mut found.0);
            share.store(&mut found.1);
            lever[0].store(&mut found.2.x.0);
            lever[1].store(&mut found.2.y.0);
            lever[2].store(&mut found.2.z.0);
            found
        }
    }

    /// Mean over a rectangle of the depth that is above zero, and of that times the place; in units
    /// of the half axes, by midpoints.
    fn integrated(depth: f64, slopes: DVec2) -> (f64, DVec2) {
        const N: i32 = 400;
        let mut mean = 0.0;
        let mut first = DVec2::ZERO;
        for (x, y) in (0..N * N).map(|n| (n % N, n / N)) {
            let at = (DVec2::new(x.into(), y.into()) + 0.5) * (2.0 / f64::from(N)) - 1.0;
            let above = (depth + slopes.dot(at)).max(0.0);
            mean += above;
            first += at * above;
        }
        (mean / f64::from(N * N), first / f64::from(N * N))
    }

    #[test]
    fn a_rectangle_along_the_surface_is_exact_and_a_square_askew_nearly() {
        let mut random = Random(14);
        for n in 0..60 {
            let a = random.in_box(-1.0, 1.0);
            let b = a.cross(random.in_box(-1.0, 1.0)).normalize() * a.length();
            let is_along = n % 2 == 0;
            let gradient = if is_along { a.normalize() } else { random.in_box(-1.0, 1.0) };
            let slopes = DVec2::new(a.dot(gradient), b.dot(gradient));
            let w = slopes.length();
            let mut half_axes = [Lanes3::ZERO; 2];
            let mut gradients = Lanes3::ZERO;
            let mut depths_m = [0.0; LANES];
            for (lane, depth_m) in depths_m.iter_mut().enumerate() {
                half_axes[0].set(lane, a.as_vec3());
                half_axes[1].set(lane, b.as_vec3());
                gradients.set(lane, gradient.as_vec3());
                *depth_m = (w * (lane as f64 / 6.0 - 1.2)) as f32;
            }
            for level in SimdLevel::available() {
                let kernel = Lanewise {
                    half_axes: &half_axes,
                    gradients: &gradients,
                    depths_m: &depths_m,
                    shortfalls_m: [&[0.0; LANES]; 2],
                };
                let (means, shares, levers) = level.run(kernel);
                for (lane, depth_m) in depths_m.iter().enumerate() {
                    let range =
                        FacetRange::of(Some([a.as_vec3(), b.as_vec3()]), gradient.as_vec3(), 1e3);
                    assert_eq!(range.mean_depth_m(*depth_m).to_bits(), means[lane].to_bits());
                    assert_eq!(range.touches(*depth_m), means[lane] > 0.0);
                    let pressed = range.lever_m(*depth_m) * means[lane];
                    assert!((pressed - levers.get(lane)).length() < 1e-5, "{pressed}");
                    let (mean, first) = integrated(f64::from(*depth_m), slopes);
                    let off = (f64::from(means[lane]) - mean).abs() / w;
                    // Askew by half a right angle and half immersed 1/4 − √2/6.
                    assert!(off < if is_along { 1e-4 } else { 0.0144 }, "{off} at {depth_m}");
                    let first: DVec3 = a * first.x + b * first.y;
                    let off = (levers.get(lane).as_dvec3() - first).length();
                    assert!(off < if is_along { 1e-4 } else { 0.03 } * w * a.length(), "{off}");
                    assert!((0.0..=1.0).contains(&shares[lane]));
                }
            }
        }
    }

    #[test]
    fn a_point_is_in_or_out_and_a_limit_holds_what_counts() {
        let point = FacetRange::of(None, Vec3::Z, 1.0);
        for (depth_m, touches) in [(-1e-9, false), (0.0, false), (1e-9, true)] {
            assert_eq!(point.touches(depth_m), touches);
            assert_eq!(point.mean_depth_m(depth_m), depth_m.max(0.0));
            assert_eq!(point.depth_there(depth_m), (depth_m, Vec3::ZERO));
        }
        let facet = |limit_m| FacetRange::of(Some([Vec3::Z * 2.0, Vec3::X]), Vec3::Z, limit_m);
        assert!(facet(3.0).touches(-1.9) && !facet(3.0).touches(-2.1));
        assert!(facet(0.5).touches(-0.4) && !facet(0.5).touches(-0.6));
        // Its corner is 2 deeper than its centroid.
        assert_eq!(facet(3.0).depth_there(-0.5), (1.5, Vec3::Z * 2.0));
        assert!(!facet(0.0).touches(0.0));
    }
}
