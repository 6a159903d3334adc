//! Facets over the creases of their obstacle, cut where one of its faces takes over from another.
//!
//! On a facet, c + u·a + v·b with u, v from −1 to 1, the depth below a plane is linear in (u, v); a
//! patch that curves is taken as its plane at the facet's middle. Of several the least depth
//! counts, at inner edges the greatest: what belongs to each is a convex polygon, and so is what of
//! it is immersed. A polygon is a fan of triangles, and three points in the middle of their sides,
//! a third of the area each, have the integrals of depth, of depth times place and of place of a
//! triangle: those points press in place of the facet, exactly as it does.
//!
//! # Source
//! Ours. Sutherland and Hodgman's clipping; the midpoints are Strang's and Fix's rule of degree 2.

use glam::{Vec2, Vec3};

use super::contact_block::ContactBlock;
use super::immersion::FacetRange;
use super::kernel::Place;
use crate::pointshell::shell::{LANES, Lanes3};
use crate::voxmap::field::Field;
use crate::voxmap::field::brick_bounds::BrickBounds;
use crate::voxmap::field::creases::{Creases, PLANES};

/// The creases of an obstacle, seen from a tool that stands there.
#[derive(Clone, Copy, Debug)]
pub(super) struct CreasesAt<'a> {
    creases: &'a Creases,
    brick_dims: [i32; 3],
    voxel_size_m: f32,
    place: &'a Place,
}

impl<'a> CreasesAt<'a> {
    pub(super) fn new(field: &'a Field, place: &'a Place) -> Self {
        Self {
            creases: field.creases(),
            brick_dims: field.brick_dims().map(|n| n as i32),
            voxel_size_m: field.voxel_size_m(),
            place,
        }
    }

    /// The same by the bounds of its field.
    pub(super) fn of(bounds: &'a BrickBounds, place: &'a Place) -> Self {
        Self {
            creases: bounds.creases(),
            brick_dims: bounds.dims(),
            voxel_size_m: bounds.voxel_size_m(),
            place,
        }
    }

    /// Puts what the planes about the middle of a facet say of it into `over`; false where there
    /// are none. RT: safe.
    #[inline(always)]
    pub(super) fn over(&self, middle: Vec3, [a, b]: [Vec3; 2], over: &mut OverPlanes) -> bool {
        over.n = 0;
        let cells = self.place.cells(middle);
        let Some(crease) = self.creases.at(self.brick_dims, cells) else { return false };
        over.is_inner = crease.is_inner();
        for (side, (depth_cells, gradient)) in over.sides.iter_mut().zip(crease.sides()) {
            // A place has cells per metre.
            let gradient = self.place.gradient(gradient) * self.voxel_size_m;
            side.depth_m = depth_cells * self.voxel_size_m;
            side.along = Vec2::new(gradient.dot(a), gradient.dot(b));
            side.gradient = gradient;
            over.n += 1;
            // Nothing of it is immersed: the others do not count.
            if side.most_m() <= 0.0 && !over.is_inner {
                break;
            }
        }
        true
    }

    /// How a facet meets the planes about its middle; `None` where there are none. RT: safe.
    #[inline(always)]
    pub(super) fn meet(
        &self,
        middle: Vec3,
        half_axes: [Vec3; 2],
        limit_m: f32,
        over: &mut OverPlanes,
    ) -> Option<Met> {
        if !self.over(middle, half_axes, over) {
            return None;
        }
        // The facet as a whole is said to be where its middle is.
        let own = over.at_middle();
        let Side { depth_m, gradient, .. } = own;
        let is_clipped = !over.counts_all_over(&own);
        let mut reaches = over.sides().map(|side| side.most_m() > 0.0);
        let reaches = if over.is_inner { reaches.any(|it| it) } else { reaches.all(|it| it) };
        let touches = match reaches {
            false => false,
            true if is_clipped => depth_m > 0.0 || (0..over.n).any(|k| !over.piece(k).is_empty()),
            true => FacetRange::of(Some(half_axes), gradient, limit_m).touches(depth_m),
        };
        Some(Met { touches, is_clipped, depth_m, gradient })
    }
}

impl CreasesAt<'_> {
    /// The same of those lanes of a block that are `near`: what the planes say replaces what
    /// interpolation has found. The largest depth, m. RT: safe.
    #[inline(always)]
    pub(super) fn meet_all(
        &self,
        near: u16,
        positions: &Lanes3,
        [a, b]: &[Lanes3; 2],
        touched: &mut ContactBlock,
    ) -> f32 {
        let mut over = OverPlanes::NONE;
        for lane in (0..LANES).filter(|lane| near >> lane & 1 == 1) {
            let half_axes = [a.get(lane), b.get(lane)];
            let met = self.meet(positions.get(lane), half_axes, touched.limit_m, &mut over);
            let (Some(met), Some(depth_m)) = (met, touched.depths_m.get_mut(lane)) else {
                continue;
            };
            let bit = 1 << lane;
            if !met.touches {
                touched.lanes &= !bit;
                *depth_m = depth_m.min(0.0);
                continue;
            }
            *depth_m = met.depth_m;
            touched.lanes |= bit;
            touched.clipped |= if met.is_clipped { bit } else { 0 };
            touched.gradients.set(lane, met.gradient);
            touched.set_shortfalls(lane, [0.0; 2]);
        }
        // What is not a number does not count.
        touched.depths_m.into_iter().fold(f32::NEG_INFINITY, f32::max)
    }
}

/// How a facet meets planes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Met {
    /// Some of it is immersed.
    pub(super) touches: bool,
    /// More than one of the planes counts somewhere on it.
    pub(super) is_clipped: bool,
    /// At its middle, m, and how it grows there, m/m, tool axes.
    pub(super) depth_m: f32,
    pub(super) gradient: Vec3,
}

/// What one plane says of a facet.
#[derive(Clone, Copy, Debug)]
struct Side {
    /// At its middle, m.
    depth_m: f32,
    /// By how much more at the ends of its half axes, m.
    along: Vec2,
    /// m/m, tool axes.
    gradient: Vec3,
}

impl Side {
    const NONE: Self = Self { depth_m: f32::INFINITY, along: Vec2::ZERO, gradient: Vec3::ZERO };

    /// At the deepest of its corners.
    fn most_m(&self) -> f32 {
        self.depth_m + self.along.x.abs() + self.along.y.abs()
    }

    fn depth_at_m(&self, at: Vec2) -> f32 {
        self.depth_m + self.along.dot(at)
    }
}

/// What planes say of a facet.
#[derive(Clone, Copy, Debug)]
pub(super) struct OverPlanes {
    sides: [Side; PLANES],
    pub(super) n: usize,
    /// The greatest of their depths counts, and not the least.
    is_inner: bool,
}

const CORNERS: [Vec2; 4] =
    [Vec2::new(-1.0, -1.0), Vec2::new(1.0, -1.0), Vec2::new(1.0, 1.0), Vec2::new(-1.0, 1.0)];

impl OverPlanes {
    pub(super) const NONE: Self = Self { sides: [Side::NONE; PLANES], n: 0, is_inner: false };

    fn sides(&self) -> impl Iterator<Item = &Side> {
        self.sides.iter().take(self.n)
    }

    /// By how much a plane is deeper than another one where it is to count, m, at the middle and
    /// along the half axes: below zero, it does not.
    fn spare(&self, own: &Side, other: &Side) -> (f32, Vec2) {
        let spare = (other.depth_m - own.depth_m, other.along - own.along);
        if self.is_inner { (-spare.0, -spare.1) } else { spare }
    }

    /// The plane that counts at its middle.
    fn at_middle(&self) -> Side {
        let counting = |a: &Side, b: &Side| self.spare(a, b).0 >= 0.0;
        let first = self.sides().next().copied().unwrap_or(Side::NONE);
        self.sides().fold(first, |a, b| if counting(&a, b) { a } else { *b })
    }

    /// True of a plane that counts on all of the facet: at its corners, as depths are linear.
    fn counts_all_over(&self, own: &Side) -> bool {
        self.sides().all(|other| {
            let (spare_m, along) = self.spare(own, other);
            spare_m >= along.x.abs() + along.y.abs()
        })
    }

    /// What of the facet is immersed and where the k-th plane counts.
    pub(super) fn piece(&self, k: usize) -> Polygon {
        let mut polygon = Polygon::WHOLE;
        let Some(own) = self.sides.get(k) else { return Polygon::EMPTY };
        for (n, other) in self.sides().enumerate().filter(|(n, _)| *n != k) {
            let (spare_m, along) = self.spare(own, other);
            // A facet midway between two planes belongs to the first.
            if n < k && spare_m == 0.0 && along == Vec2::ZERO {
                return Polygon::EMPTY;
            }
            polygon = polygon.clipped(spare_m, along);
        }
        polygon.clipped(own.depth_m, own.along)
    }

    /// A point of the k-th piece: how deep, m, and how that grows, m/m, tool axes.
    pub(super) fn depth_and_gradient(&self, k: usize, at: Vec2) -> (f32, Vec3) {
        self.sides
            .get(k)
            .map_or((0.0, Vec3::ZERO), |side| (side.depth_at_m(at).max(0.0), side.gradient))
    }

    /// What presses on the facet as a whole.
    pub(super) fn pressed(&self) -> Pressed {
        let mut pressed = Pressed::default();
        for k in 0..self.n {
            let piece = self.piece(k);
            for triangle in piece.triangles() {
                for at in midpoints(triangle) {
                    let (depth_m, _) = self.depth_and_gradient(k, at);
                    let share = share_of_point(triangle) * depth_m;
                    pressed.mean_depth_m += share;
                    pressed.at += at * share;
                }
                for corner in triangle {
                    let (depth_m, gradient) = self.depth_and_gradient(k, corner);
                    if depth_m > pressed.deepest_m {
                        pressed.gradient = gradient;
                        pressed.deepest_m = depth_m;
                        pressed.deepest_at = corner;
                    }
                }
            }
        }
        pressed.at /= pressed.mean_depth_m.max(f32::MIN_POSITIVE);
        pressed
    }
}

/// What presses on a facet; places in half axes from its middle.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Pressed {
    pub(super) mean_depth_m: f32,
    /// The middle of what presses.
    pub(super) at: Vec2,
    pub(super) deepest_m: f32,
    pub(super) deepest_at: Vec2,
    /// How depth grows there, m/m, tool axes.
    pub(super) gradient: Vec3,
}

/// Corners of a convex polygon: those of the facet, and one more for each cut at most.
const MOST_CORNERS: usize = 4 + PLANES;

#[derive(Clone, Copy, Debug)]
pub(super) struct Polygon {
    corners: [Vec2; MOST_CORNERS],
    n: usize,
}

impl Polygon {
    const EMPTY: Self = Self { corners: [Vec2::ZERO; MOST_CORNERS], n: 0 };
    const WHOLE: Self = {
        let mut whole = Self::EMPTY;
        let mut n = 0;
        while n < CORNERS.len() {
            whole.corners[n] = CORNERS[n];
            n += 1;
        }
        whole.n = CORNERS.len();
        whole
    };

    /// What of it lies where `value` + `slope` · place is not below zero.
    fn clipped(self, value: f32, slope: Vec2) -> Self {
        if value >= slope.x.abs() + slope.y.abs() {
            return self;
        }
        let mut kept = Self::EMPTY;
        let value_at = |at: Vec2| value + slope.dot(at);
        let Some(mut last) = self.n.checked_sub(1).and_then(|last| self.corners.get(last)) else {
            return kept;
        };
        let mut last_value = value_at(*last);
        for corner in self.corners.iter().take(self.n) {
            let corner_value = value_at(*corner);
            if (last_value < 0.0) != (corner_value < 0.0) {
                kept.push(last.lerp(*corner, last_value / (last_value - corner_value)));
            }
            if corner_value >= 0.0 {
                kept.push(*corner);
            }
            last = corner;
            last_value = corner_value;
        }
        kept
    }

    fn push(&mut self, corner: Vec2) {
        if let Some(next) = self.corners.get_mut(self.n) {
            *next = corner;
            self.n += 1;
        }
    }

    /// True where it has no area.
    fn is_empty(&self) -> bool {
        self.triangles().map(share_of_point).sum::<f32>() <= 0.0
    }

    /// A fan.
    pub(super) fn triangles(&self) -> impl Iterator<Item = [Vec2; 3]> + '_ {
        let corners = self.corners.get(..self.n).unwrap_or(&[]);
        let first = corners.first().copied().unwrap_or_default();
        corners.iter().skip(1).zip(corners.iter().skip(2)).map(move |(b, c)| [first, *b, *c])
    }
}

/// Middles of the sides.
pub(super) fn midpoints([a, b, c]: [Vec2; 3]) -> [Vec2; 3] {
    [(a + b) * 0.5, (b + c) * 0.5, (c + a) * 0.5]
}

/// Share of the facet that each of them stands for: a third of the triangle's, of four.
pub(super) fn share_of_point([a, b, c]: [Vec2; 3]) -> f32 {
    (b - a).perp_dot(c - a).abs() * (1.0 / 24.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spatial::testing::Random;

    /// A facet with these depths at its middle, and by how much they grow along its half axes.
    fn over(planes: &[(f32, Vec2)]) -> OverPlanes {
        let mut over = OverPlanes::NONE;
        for (side, (depth_m, along)) in over.sides.iter_mut().zip(planes) {
            *side = Side { depth_m: *depth_m, along: *along, gradient: along.extend(1.0) };
            over.n += 1;
        }
        over
    }

    fn share_of(piece: &Polygon) -> f32 {
        3.0 * piece.triangles().map(share_of_point).sum::<f32>()
    }

    #[test]
    fn pieces_have_the_area_and_the_depth_of_what_is_immersed_once() {
        const N: u16 = 200;
        let mut random = Random(31);
        for n in 0..200 {
            let planes: Vec<(f32, Vec2)> = (0..1 + n % PLANES)
                .map(|_| {
                    (random.signed() as f32 + 0.5, random.in_box(-1.0, 1.0).as_vec3().truncate())
                })
                .collect();
            let over = over(&planes);
            let [mut area, mut depth, mut moment] = [0.0, 0.0, 0.0];
            for (x, y) in (0..N).flat_map(|x| (0..N).map(move |y| (x, y))) {
                let at = (Vec2::new(x.into(), y.into()) + 0.5) * (2.0 / f32::from(N)) - 1.0;
                let least = planes.iter().map(|(depth_m, along)| depth_m + along.dot(at));
                let least = f64::from(least.fold(f32::INFINITY, f32::min).max(0.0));
                area += if least > 0.0 { 1.0 } else { 0.0 };
                depth += least;
                moment += least * f64::from(at.x);
            }
            let found = (0..over.n).map(|k| share_of(&over.piece(k))).sum::<f32>();
            let pressed = over.pressed();
            let cells = f64::from(N) * f64::from(N);
            let off = [
                f64::from(found) - area / cells,
                f64::from(pressed.mean_depth_m) - depth / cells,
                f64::from(pressed.mean_depth_m * pressed.at.x) - moment / cells,
            ];
            // The area is counted by squares of a hundredth of a half axis.
            assert!(
                off[0].abs() < 2e-2 && off[1].abs() < 1e-4 && off[2].abs() < 1e-4,
                "{off:?} of {planes:?}"
            );
        }
    }

    #[test]
    fn a_facet_midway_between_two_planes_counts_once() {
        let along = Vec2::new(0.25, -0.5);
        // A third one takes over at one side.
        let over = over(&[(0.5, along), (0.5, along), (0.75, Vec2::new(-0.5, 0.0))]);
        let shares = [0, 1, 2].map(|k| share_of(&over.piece(k)));
        assert!(shares[0] > 0.1 && shares[1] == 0.0 && shares[2] > 0.1, "{shares:?}");
        assert!(shares.iter().sum::<f32>() < 1.0 + 1e-6, "{shares:?}");
    }
}
