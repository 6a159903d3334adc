//! Primitive shapes of the scene file, tessellated.
//!
//! Data in: a [`Shape`] and how far the triangles may be from it. Data out: a closed
//! [`TriangleMesh`], outward, with shared vertices. Round shapes are inscribed: vertices lie on the
//! surface, faces inside it (on the inner half of a torus outside), so the volume is a little too
//! small. Extents along the axes are exact, as every circle has a vertex on each half axis.

use std::f64::consts::{FRAC_PI_2, PI};

use glam::{DVec2, DVec3};

use super::TriangleMesh;

/// A primitive shape, metres; centre at the origin, axis z.
///
/// # Examples
/// ```
/// # use vps::{Mesh, Shape};
/// let pin = Mesh::from_shape(&Shape::Capsule { radius_m: 5e-3, height_m: 20e-3 }, 1e-5)?;
/// let (low, high) = pin.bounds();
/// assert_eq!((low.z, high.x), (-15e-3, 5e-3));
/// # Ok::<(), vps::Error>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    /// Full edges.
    Box {
        /// Full edge lengths, m.
        size_m: DVec3,
    },
    /// Sphere.
    Sphere {
        /// Radius, m.
        radius_m: f64,
    },
    /// Ellipsoid along the axes.
    Ellipsoid {
        /// Half of its extents along x, y and z, m.
        radii_m: DVec3,
    },
    /// Cylinder.
    Cylinder {
        /// Radius, m.
        radius_m: f64,
        /// Height, m.
        height_m: f64,
    },
    /// Cone, apex at +z.
    Cone {
        /// Radius of the base, m.
        radius_m: f64,
        /// Height, m.
        height_m: f64,
    },
    /// Cylinder with half-sphere caps.
    Capsule {
        /// Radius, m.
        radius_m: f64,
        /// Height of the cylinder without the caps, m.
        height_m: f64,
    },
    /// Torus around z.
    Torus {
        /// Radius of the centre line, m.
        major_m: f64,
        /// Radius of the tube, m.
        minor_m: f64,
    },
    /// Slab whose top face is z = 0, thicker than the band.
    Plane {
        /// Edge along x, m.
        x_m: f64,
        /// Edge along y, m.
        y_m: f64,
        /// Thickness, m.
        thickness_m: f64,
    },
}

/// A circle never has more segments: a sphere then has a million triangles.
const MAX_SEGMENTS: usize = 1024;
/// Nor fewer, whatever the tolerance.
const MIN_SEGMENTS: usize = 16;

impl Shape {
    /// All lengths that it is made of, m.
    pub(crate) fn sizes_m(&self) -> Vec<f64> {
        match *self {
            Self::Box { size_m } => size_m.to_array().to_vec(),
            Self::Sphere { radius_m } => vec![radius_m],
            Self::Ellipsoid { radii_m } => radii_m.to_array().to_vec(),
            Self::Cylinder { radius_m, height_m }
            | Self::Cone { radius_m, height_m }
            | Self::Capsule { radius_m, height_m } => {
                vec![radius_m, height_m]
            }
            Self::Torus { major_m, minor_m } => vec![major_m, minor_m],
            Self::Plane { x_m, y_m, thickness_m } => vec![x_m, y_m, thickness_m],
        }
    }

    /// Triangles no farther than `tolerance_m` from the shape, unless that takes more than about
    /// two million of them (1024 segments in a circle). A tolerance that is not positive asks for
    /// that limit.
    ///
    /// Callers pass a small part of the voxel edge, such as a twentieth.
    #[doc(hidden)]
    pub fn tessellate(&self, tolerance_m: f64) -> TriangleMesh {
        let shape = *self;
        match shape {
            Self::Box { size_m } => slab(-0.5 * size_m, 0.5 * size_m),
            Self::Plane { x_m, y_m, thickness_m } => slab(
                DVec3::new(-0.5 * x_m, -0.5 * y_m, -thickness_m),
                DVec3::new(0.5 * x_m, 0.5 * y_m, 0.0),
            ),
            Self::Sphere { radius_m } => {
                // Two directions of bending share the tolerance.
                let n = segments(radius_m, 0.5 * tolerance_m);
                let profile: Vec<DVec2> = (0..=n / 2).map(|k| radius_m * direction(k, n)).collect();
                revolve(&profile, n)
            }
            Self::Ellipsoid { radii_m } => {
                // A sphere around it, pressed: no point of a face goes farther from it than it was
                // from the sphere.
                let radius_m = radii_m.max_element();
                let mut mesh = Self::Sphere { radius_m }.tessellate(tolerance_m);
                mesh.vertices.iter_mut().for_each(|at| *at *= radii_m / radius_m);
                mesh
            }
            Self::Capsule { radius_m, height_m } => {
                let n = segments(radius_m, 0.5 * tolerance_m);
                let quarter = n / 4;
                let lift = |k: usize, z: f64| radius_m * direction(k, n) + DVec2::new(0.0, z);
                let lower = (0..=quarter).map(|k| lift(k, -0.5 * height_m));
                // A capsule without a cylinder is a sphere: no second ring at the same place.
                let skip = if height_m > 0.0 { quarter } else { quarter + 1 };
                let upper = (skip..=2 * quarter).map(|k| lift(k, 0.5 * height_m));
                revolve(&lower.chain(upper).collect::<Vec<_>>(), n)
            }
            Self::Cylinder { radius_m, height_m } => {
                let z = 0.5 * height_m;
                let profile = [(0.0, -z), (radius_m, -z), (radius_m, z), (0.0, z)].map(DVec2::from);
                revolve(&profile, segments(radius_m, tolerance_m))
            }
            Self::Cone { radius_m, height_m } => {
                let z = 0.5 * height_m;
                let profile = [(0.0, -z), (radius_m, -z), (0.0, z)].map(DVec2::from);
                revolve(&profile, segments(radius_m, tolerance_m))
            }
            Self::Torus { major_m, minor_m } => {
                let n = segments(minor_m, 0.5 * tolerance_m);
                let profile: Vec<DVec2> =
                    (0..n).map(|k| DVec2::new(major_m, 0.0) + minor_m * direction(k, n)).collect();
                revolve_ring(&profile, segments(major_m + minor_m, 0.5 * tolerance_m))
            }
        }
    }
}

/// Segments of a circle whose chords stay within `tolerance_m` of it; a multiple of four.
fn segments(radius_m: f64, tolerance_m: f64) -> usize {
    // Height of a chord over half a segment: r (1 - cos(pi / n)).
    let half_segment = (1.0 - (tolerance_m / radius_m).clamp(0.0, 1.0)).acos();
    let wanted = (PI / half_segment).ceil();
    // Not a number and infinity both end at the limit.
    let wanted = if wanted < MAX_SEGMENTS as f64 { wanted as usize } else { MAX_SEGMENTS };
    wanted.next_multiple_of(4).clamp(MIN_SEGMENTS, MAX_SEGMENTS)
}

/// Point k of n on the unit circle of a profile (distance from the axis, z), counted from the south
/// pole; exact on the axes.
fn direction(k: usize, n: usize) -> DVec2 {
    let quarter = n / 4;
    let (sin, cos) = (FRAC_PI_2 * (k % quarter) as f64 / quarter as f64).sin_cos();
    match (k / quarter) % 4 {
        0 => DVec2::new(sin, -cos),
        1 => DVec2::new(cos, sin),
        2 => DVec2::new(-sin, cos),
        _ => DVec2::new(-cos, -sin),
    }
}

/// The ring of vertices that one point of a profile sweeps.
fn ring(point: DVec2, n: usize) -> impl Iterator<Item = DVec3> {
    (0..n).map(move |k| {
        let on_circle = direction(k, n);
        DVec3::new(point.x * on_circle.x, point.x * on_circle.y, point.y)
    })
}

/// Two triangles between neighbours on two rings, the second one farther along the profile.
fn band(below: u32, above: u32, n: usize, triangles: &mut Vec<[u32; 3]>) {
    let n = n as u32;
    for k in 0..n {
        let next = (k + 1) % n;
        triangles.push([below + k, below + next, above + next]);
        triangles.push([below + k, above + next, above + k]);
    }
}

/// Turns a profile around z. It begins and ends on the axis, and has the inside of the body on its
/// left.
fn revolve(profile: &[DVec2], n: usize) -> TriangleMesh {
    let mut mesh = TriangleMesh::default();
    let [first, middle @ .., last] = profile else { return mesh };
    mesh.vertices.push(DVec3::new(0.0, 0.0, first.y));
    mesh.vertices.extend(middle.iter().flat_map(|point| ring(*point, n)));
    mesh.vertices.push(DVec3::new(0.0, 0.0, last.y));
    let ring_start = |k: usize| (1 + k * n) as u32;
    let top = ring_start(middle.len());
    for k in 0..n as u32 {
        let next = (k + 1) % n as u32;
        mesh.triangles.push([0, 1 + next, 1 + k]);
    }
    for k in 1..middle.len() {
        band(ring_start(k - 1), ring_start(k), n, &mut mesh.triangles);
    }
    let last_ring = ring_start(middle.len() - 1);
    for k in 0..n as u32 {
        let next = (k + 1) % n as u32;
        mesh.triangles.push([last_ring + k, last_ring + next, top]);
    }
    mesh
}

/// Turns a closed profile that does not touch the axis around z; counter-clockwise in (distance
/// from the axis, z).
fn revolve_ring(profile: &[DVec2], n: usize) -> TriangleMesh {
    let mut mesh = TriangleMesh::default();
    mesh.vertices.extend(profile.iter().flat_map(|point| ring(*point, n)));
    for k in 0..profile.len() {
        let next = (k + 1) % profile.len();
        band((k * n) as u32, (next * n) as u32, n, &mut mesh.triangles);
    }
    mesh
}

/// An axis-aligned box.
fn slab(low: DVec3, high: DVec3) -> TriangleMesh {
    let vertices = (0..8)
        .map(|k| DVec3::select(glam::BVec3::new(k & 1 != 0, k & 2 != 0, k & 4 != 0), high, low))
        .collect();
    let quads =
        [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let triangles = quads.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).collect();
    TriangleMesh { vertices, triangles }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::super::validate::inspect;
    use super::*;

    const R: f64 = 0.02;
    const H: f64 = 0.05;

    fn shapes() -> [(Shape, f64, f64, DVec3, DVec3); 8] {
        let tall = |z: f64| DVec3::new(R, R, z);
        [
            (
                Shape::Box { size_m: DVec3::new(0.1, 0.2, 0.3) },
                0.006,
                0.22,
                DVec3::new(-0.05, -0.1, -0.15),
                DVec3::new(0.05, 0.1, 0.15),
            ),
            (
                Shape::Sphere { radius_m: R },
                4.0 / 3.0 * PI * R * R * R,
                4.0 * PI * R * R,
                -tall(R),
                tall(R),
            ),
            // Twice as long as wide: an area of 2π (R² + R H / e asin e), with e² = 1 − R²/H² and H
            // half of its length.
            (
                Shape::Ellipsoid { radii_m: DVec3::new(R, R, 2.0 * R) },
                8.0 / 3.0 * PI * R * R * R,
                TAU * R * R * (1.0 + 2.0 / 0.75_f64.sqrt() * 0.75_f64.sqrt().asin()),
                -tall(2.0 * R),
                tall(2.0 * R),
            ),
            (
                Shape::Cylinder { radius_m: R, height_m: H },
                PI * R * R * H,
                TAU * R * (R + H),
                -tall(H / 2.0),
                tall(H / 2.0),
            ),
            (
                Shape::Cone { radius_m: R, height_m: H },
                PI * R * R * H / 3.0,
                PI * R * (R + R.hypot(H)),
                -tall(H / 2.0),
                tall(H / 2.0),
            ),
            (
                Shape::Capsule { radius_m: R, height_m: H },
                PI * R * R * (H + 4.0 / 3.0 * R),
                TAU * R * (H + 2.0 * R),
                -tall(H / 2.0 + R),
                tall(H / 2.0 + R),
            ),
            (
                Shape::Torus { major_m: H, minor_m: R },
                TAU * PI * H * R * R,
                TAU * TAU * H * R,
                -DVec3::new(H + R, H + R, R),
                DVec3::new(H + R, H + R, R),
            ),
            (
                Shape::Plane { x_m: 0.2, y_m: 0.1, thickness_m: 0.01 },
                2e-4,
                0.046,
                DVec3::new(-0.1, -0.05, -0.01),
                DVec3::new(0.1, 0.05, 0.0),
            ),
        ]
    }

    #[test]
    fn shapes_are_closed_outward_and_have_their_volume() {
        for (shape, volume, area, low, high) in shapes() {
            let report = inspect(&shape.tessellate(1e-6));
            assert!(report.closed, "{shape:?}: {report:?}");
            assert_eq!(
                (
                    report.degenerate_triangles,
                    report.duplicate_triangles,
                    report.inconsistent_edges
                ),
                (0, 0, 0),
                "{shape:?}"
            );
            assert!(
                (report.signed_volume_m3 / volume - 1.0).abs() < 2e-3,
                "{shape:?}: {} {volume}",
                report.signed_volume_m3
            );
            assert!(
                (report.area_m2 / area - 1.0).abs() < 2e-3,
                "{shape:?}: {} {area}",
                report.area_m2
            );
            let (found_low, found_high) = report.bounds_m.unwrap();
            assert!(
                found_low.distance(low) < 1e-16 && found_high.distance(high) < 1e-16,
                "{shape:?}: {found_low} {found_high}"
            );
        }
    }

    #[test]
    fn faces_stay_within_the_tolerance() {
        for tolerance in [1e-3, 1e-4, 1e-5] {
            for (shape, ..) in shapes() {
                // Distance to the surface of the round shapes, signs dropped.
                let distance = |p: DVec3| match shape {
                    Shape::Sphere { radius_m } => (p.length() - radius_m).abs(),
                    // Of the sphere around it, which is no less.
                    Shape::Ellipsoid { radii_m } => {
                        radii_m.max_element() * ((p / radii_m).length() - 1.0).abs()
                    }
                    Shape::Capsule { radius_m, height_m } => {
                        (p - DVec3::Z * p.z.clamp(-0.5 * height_m, 0.5 * height_m)).length()
                            - radius_m
                    }
                    .abs(),
                    Shape::Torus { major_m, minor_m } => {
                        (DVec2::new(p.truncate().length() - major_m, p.z).length() - minor_m).abs()
                    }
                    Shape::Cylinder { radius_m, height_m } if p.z.abs() < 0.499 * height_m => {
                        radius_m - p.truncate().length()
                    }
                    _ => 0.0,
                };
                let mesh = shape.tessellate(tolerance);
                for k in 0..mesh.triangles.len() {
                    let [a, b, c] = mesh.corners(k);
                    for point in [(a + b + c) / 3.0, (a + b) / 2.0, (b + c) / 2.0, (c + a) / 2.0] {
                        assert!(
                            distance(point) <= tolerance,
                            "{shape:?} {tolerance}: {}",
                            distance(point)
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn odd_arguments_keep_the_count_in_bounds() {
        for tolerance in [0.0, -1.0, f64::NAN, 1e-300, f64::INFINITY, 10.0] {
            for (shape, ..) in shapes() {
                let mesh = shape.tessellate(tolerance);
                assert!((12..=2 * MAX_SEGMENTS * MAX_SEGMENTS).contains(&mesh.triangles.len()));
            }
        }
        let ball = Shape::Capsule { radius_m: R, height_m: 0.0 }.tessellate(1e-4);
        assert_eq!(
            ball.triangles.len(),
            Shape::Sphere { radius_m: R }.tessellate(1e-4).triangles.len()
        );
        assert!(inspect(&ball).closed);
    }
}
