//! Closest point of a triangle to a point, exact, with the feature of the triangle on which it
//! lies.
//!
//! Two methods, as in the paper that this crate follows:
//! - B, [`TriangleProjector`], used everywhere: a constrained quadratic minimum with seven
//!   Karush-Kuhn-Tucker candidates;
//! - A, [`project_by_voronoi_clamp`], kept as an independent reference: projection on the plane,
//!   then a clamp to the boundary.
//!
//! Invariant: neither panics nor gives NaN for finite input, however thin the triangle is.
//! Degenerate triangles (collinear or coincident corners) have no interior: their points lie on
//! edges and vertices.
//!
//! # Source
//! Sagardia2008, section 4 (pointshell generation, methods A and B). The paper gives the problem;
//! the closed forms of the candidates, the division-free form of the multiplier signs and the care
//! for thin triangles are ours. With `T(s,t) = B + s E0 + t E1`, `r = B - P`, `a = E0·E0`, `b =
//! E0·E1`, `c = E1·E1`, `d = E0·r`, `e = E1·r`, `Δ = ac - b²`, `S = be - cd` and `U = bd - ae`, the
//! candidates and their multipliers are
//!
//! | candidate | s, t | multipliers ≥ 0 |
//! |---|---|---|
//! | interior | S/Δ, U/Δ | none: S ≥ 0, U ≥ 0, S + U ≤ Δ |
//! | edge t = 0 | -d/a, 0 | λ₂ = -2U/a |
//! | edge s = 0 | 0, -e/c | λ₁ = -2S/c |
//! | edge s + t = 1 | (c+e-b-d)/(a-2b+c), 1-s | λ₃ = -2(Δ-S-U)/(a-2b+c) |
//! | vertex 0 | 0, 0 | λ₁ = 2d, λ₂ = 2e |
//! | vertex 1 | 1, 0 | λ₃ = -2(a+d), λ₂ = 2(b+e-a-d) |
//! | vertex 2 | 0, 1 | λ₃ = -2(c+e), λ₁ = 2(b+d-c-e) |

use glam::DVec3;

/// Feature of a triangle on which a closest point lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum TriangleFeature {
    /// Inside the triangle, or on its border by rounding only.
    Interior,
    /// On edge k, which runs from corner k to corner k + 1 (modulo 3).
    Edge(u8),
    /// At corner k.
    Vertex(u8),
}

impl TriangleFeature {
    /// True for the interior: the points that phase 1 of the pointshell keeps.
    pub fn is_interior(self) -> bool {
        self == Self::Interior
    }
}

/// A closest point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Projection {
    /// The point of the triangle, same frame and unit as the corners.
    pub point: DVec3,
    /// Where on the triangle it lies.
    pub feature: TriangleFeature,
    /// Squared distance to the projected point; infinite where the square is out of range.
    pub distance_squared: f64,
}

/// Squared sine of the angle at the base corner below which the closed forms lose digits and the
/// careful path is taken.
///
/// The rounding error of `S/Δ` grows like ε/sin², so this keeps it near 2e-14. The base corner has
/// the largest angle: only angles above 174.3° fall below.
const THIN_SIN_SQUARED: f64 = 1e-2;

/// Squared sine below which the computed normal of a triangle is rounding noise: the triangle is a
/// segment.
const FLAT_SIN_SQUARED: f64 = 1e-28;

/// Products of four lengths below this are near the underflow of `f64`: the triangle takes the
/// careful path.
const TINY_FOURTH_POWER: f64 = 1e-200;

/// Method B: one triangle, prepared so that many points can be projected on it cheaply.
///
/// The base corner B of the parametrisation is the one with the largest angle (opposite the longest
/// edge), which keeps the two by two system well conditioned for needle-shaped triangles; regions
/// are reported in the caller's corner order.
#[derive(Clone, Debug)]
pub struct TriangleProjector {
    /// B, B + E0, B + E1: the caller's corners, rotated so that the base corner comes first.
    corners: [DVec3; 3],
    edge0: DVec3,
    edge1: DVec3,
    a: f64,
    b: f64,
    c: f64,
    delta: f64,
    inverse_a: f64,
    inverse_c: f64,
    inverse_delta: f64,
    /// 1 / (a - 2b + c), the inverse squared length of the edge opposite B.
    inverse_opposite: f64,
    /// Caller's number of each rotated corner, and of the edge that starts there.
    names: [u8; 3],
    /// The closed forms may be used.
    well_shaped: bool,
}

impl TriangleProjector {
    /// Prepares a triangle; any three corners will do, degenerate ones included.
    pub fn new(corners: &[DVec3; 3]) -> Self {
        let edges_squared = [0, 1, 2].map(|k| (corners[(k + 1) % 3] - corners[k]).length_squared());
        // Edge k + 1 is opposite corner k. Ties keep the lowest corner, so that the result does not
        // depend on the platform.
        let mut base = 0;
        for k in 1..3 {
            if edges_squared[(k + 1) % 3] > edges_squared[(base + 1) % 3] {
                base = k;
            }
        }
        let order = [base, (base + 1) % 3, (base + 2) % 3];
        let corners = order.map(|k| corners[k]);
        let edge0 = corners[1] - corners[0];
        let edge1 = corners[2] - corners[0];
        let a = edge0.length_squared();
        let b = edge0.dot(edge1);
        let c = edge1.length_squared();
        let delta = a * c - b * b;
        let well_shaped =
            delta > THIN_SIN_SQUARED * a * c && delta > TINY_FOURTH_POWER && delta.is_finite();
        Self {
            corners,
            edge0,
            edge1,
            a,
            b,
            c,
            delta,
            inverse_a: a.recip(),
            inverse_c: c.recip(),
            inverse_delta: delta.recip(),
            inverse_opposite: (corners[2] - corners[1]).length_squared().recip(),
            names: order.map(|k| k as u8),
            well_shaped,
        }
    }

    /// Closest point of the triangle to `point`.
    ///
    /// Cost: no heap, no square root, at most one multiplication by a stored inverse. A non-finite
    /// `point` gives a corner and a distance that is not a number.
    #[inline]
    pub fn project(&self, point: DVec3) -> Projection {
        if !self.well_shaped {
            return self.project_carefully(point);
        }
        let Self { a, b, c, delta, .. } = *self;
        let r = self.corners[0] - point;
        let d = self.edge0.dot(r);
        let e = self.edge1.dot(r);
        let s_delta = b * e - c * d;
        let t_delta = b * d - a * e;

        if s_delta >= 0.0 && t_delta >= 0.0 && s_delta + t_delta <= delta {
            let s = s_delta * self.inverse_delta;
            let t = t_delta * self.inverse_delta;
            return finish(
                point,
                self.corners[0] + self.edge0 * s + self.edge1 * t,
                TriangleFeature::Interior,
            );
        }
        if t_delta <= 0.0 && d < 0.0 && -d < a {
            return finish(
                point,
                self.corners[0] + self.edge0 * (-d * self.inverse_a),
                TriangleFeature::Edge(self.names[0]),
            );
        }
        if s_delta <= 0.0 && e < 0.0 && -e < c {
            return finish(
                point,
                self.corners[0] + self.edge1 * (-e * self.inverse_c),
                TriangleFeature::Edge(self.names[2]),
            );
        }
        // Along the opposite edge the squared distance changes by these amounts at its two ends.
        let from_second = c + e - b - d;
        let from_first = a + d - b - e;
        if s_delta + t_delta >= delta && from_second > 0.0 && from_first > 0.0 {
            // Counted from the nearer corner, so that the result does not leave the edge by
            // cancellation.
            let s = from_second * self.inverse_opposite;
            return finish(
                point,
                self.corners[2] + (self.corners[1] - self.corners[2]) * s.min(1.0),
                TriangleFeature::Edge(self.names[1]),
            );
        }
        if d >= 0.0 && e >= 0.0 {
            return finish(point, self.corners[0], TriangleFeature::Vertex(self.names[0]));
        }
        if a + d <= 0.0 && from_first <= 0.0 {
            return finish(point, self.corners[1], TriangleFeature::Vertex(self.names[1]));
        }
        if c + e <= 0.0 && from_second <= 0.0 {
            return finish(point, self.corners[2], TriangleFeature::Vertex(self.names[2]));
        }
        // In exact arithmetic one candidate holds. Rounding can refuse all of them on a border
        // between two regions.
        self.project_carefully(point)
    }

    /// The same answer by comparing distances: for thin and degenerate triangles, borders, and
    /// overflow.
    #[cold]
    fn project_carefully(&self, point: DVec3) -> Projection {
        let mut best = finish(point, self.corners[0], TriangleFeature::Vertex(self.names[0]));
        for k in 0..3 {
            let next = (k + 1) % 3;
            let candidate = project_on_segment(
                self.corners[k],
                self.corners[next],
                [self.names[k], self.names[next]],
                point,
            );
            if candidate.distance_squared < best.distance_squared {
                best = candidate;
            }
        }
        let normal = self.edge0.cross(self.edge1);
        let normal_squared = normal.length_squared();
        if normal_squared > FLAT_SIN_SQUARED * self.a * self.c && normal_squared > 0.0 {
            let s_axis = self.edge1.cross(normal) / normal_squared;
            let t_axis = normal.cross(self.edge0) / normal_squared;
            let mut s = 0.0;
            let mut t = 0.0;
            let mut foot = self.corners[0];
            // Two steps of iterative refinement: the first solution of a thin triangle is off by
            // ε·length/thickness along it.
            for _ in 0..3 {
                let rest = point - foot;
                s += s_axis.dot(rest);
                t += t_axis.dot(rest);
                foot = self.corners[0] + self.edge0 * s + self.edge1 * t;
            }
            if s >= 0.0 && t >= 0.0 && s + t <= 1.0 {
                let candidate = finish(point, foot, TriangleFeature::Interior);
                if candidate.distance_squared <= best.distance_squared {
                    best = candidate;
                }
            }
        }
        if best.distance_squared.is_finite() { best } else { self.project_scaled(point) }
    }

    /// The same problem in units in which nothing overflows.
    #[cold]
    fn project_scaled(&self, point: DVec3) -> Projection {
        let largest = self.corners.iter().fold(point.abs().max_element(), |largest, corner| {
            largest.max(corner.abs().max_element())
        });
        let corner = finish(point, self.corners[0], TriangleFeature::Vertex(self.names[0]));
        // Below this size a squared distance cannot have overflowed: some input was not a number.
        if !largest.is_finite() || largest < 1e100 {
            return corner;
        }
        // Halved before the division: the inverse of the largest numbers is not normal.
        let scale = 0.5 * largest;
        let mut scaled =
            Self::new(&self.corners.map(|corner| corner / scale)).project(point / scale);
        let names = &self.names;
        scaled.feature = match scaled.feature {
            TriangleFeature::Interior => TriangleFeature::Interior,
            TriangleFeature::Edge(k) => TriangleFeature::Edge(names[usize::from(k)]),
            TriangleFeature::Vertex(k) => TriangleFeature::Vertex(names[usize::from(k)]),
        };
        let limit = DVec3::splat(f64::MAX);
        Projection {
            point: (scaled.point * scale).clamp(-limit, limit),
            feature: scaled.feature,
            distance_squared: scaled.distance_squared * scale * scale,
        }
    }
}

/// Method A: projection on the plane of the triangle, then the nearest point of the boundary when
/// that falls outside.
///
/// Kept as a reference for [`TriangleProjector`]; thin triangles lose digits here.
///
/// # Source
/// Sagardia2008, section 4, method A.
pub fn project_by_voronoi_clamp(corners: &[DVec3; 3], point: DVec3) -> Projection {
    let edge0 = corners[1] - corners[0];
    let edge1 = corners[2] - corners[0];
    let normal = edge0.cross(edge1);
    let normal_squared = normal.length_squared();
    let flat = normal_squared <= FLAT_SIN_SQUARED * edge0.length_squared() * edge1.length_squared();
    let foot = if flat {
        point
    } else {
        point - normal * (normal.dot(point - corners[0]) / normal_squared)
    };

    let mut best: Option<Projection> = None;
    for k in 0..3_u8 {
        let (from, to) = (corners[usize::from(k)], corners[usize::from((k + 1) % 3)]);
        let outside = flat || (to - from).cross(foot - from).dot(normal) < 0.0;
        if outside {
            let candidate = project_on_segment(from, to, [k, (k + 1) % 3], point);
            if best.is_none_or(|best| candidate.distance_squared < best.distance_squared) {
                best = Some(candidate);
            }
        }
    }
    best.unwrap_or_else(|| finish(point, foot, TriangleFeature::Interior))
}

/// Closest point of a segment; `names` are the numbers of its two corners, the first also names the
/// edge.
fn project_on_segment(from: DVec3, to: DVec3, names: [u8; 2], point: DVec3) -> Projection {
    let edge = to - from;
    let length_squared = edge.length_squared();
    let along = edge.dot(point - from);
    if !(length_squared > 0.0 && along > 0.0) {
        finish(point, from, TriangleFeature::Vertex(names[0]))
    } else if along >= length_squared {
        finish(point, to, TriangleFeature::Vertex(names[1]))
    } else {
        finish(point, from + edge * (along / length_squared), TriangleFeature::Edge(names[0]))
    }
}

/// A projection with its distance measured at the point that is returned, not taken from the
/// quadratic form.
#[inline]
fn finish(point: DVec3, foot: DVec3, feature: TriangleFeature) -> Projection {
    Projection { point: foot, feature, distance_squared: (point - foot).length_squared() }
}

#[cfg(test)]
mod tests;
