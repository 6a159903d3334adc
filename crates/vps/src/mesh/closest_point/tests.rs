use proptest::prelude::*;

use super::*;

/// SplitMix64: seeded, so that a failure can be run again.
struct Random(u64);

impl Random {
    fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut bits = self.0;
        bits = (bits ^ (bits >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        bits = (bits ^ (bits >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        bits ^ (bits >> 31)
    }

    /// Uniform in [-1, 1).
    fn signed(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }

    fn vector(&mut self) -> DVec3 {
        DVec3::new(self.signed(), self.signed(), self.signed())
    }

    /// Between 1 and 10^-digits, evenly in the exponent.
    fn small(&mut self, digits: f64) -> f64 {
        10_f64.powf(-digits * (0.5 + 0.5 * self.signed()))
    }
}

fn random_triangle(random: &mut Random, kind: u64) -> [DVec3; 3] {
    let first = random.vector();
    let along = random.vector();
    let mut corners = match kind % 8 {
        // Caps: three corners almost on one line, down to a thickness of 1e-14.
        0 => [
            first,
            first + along,
            first + along * (0.5 + 0.4 * random.signed()) + random.vector() * random.small(14.0),
        ],
        // Needles: one edge far shorter than the others.
        1 => [first, first + along, first + along + random.vector() * random.small(14.0)],
        // Collinear up to the last bit, two equal corners, one point.
        2 => [first, first + along, first + along * random.signed() * 2.0],
        3 => [first, first, first + along],
        4 if kind % 16 == 4 => [first; 3],
        _ => [first, random.vector(), random.vector()],
    };
    corners.rotate_left((random.bits() % 3) as usize);
    if random.bits() & 1 == 0 {
        corners.swap(0, 1);
    }
    corners
}

fn random_point(random: &mut Random, corners: &[DVec3; 3]) -> DVec3 {
    let s = random.signed() * 1.5 + 0.5;
    let t = random.signed() * 1.5 + 0.5;
    let in_plane = corners[0] + (corners[1] - corners[0]) * s + (corners[2] - corners[0]) * t;
    match random.bits() % 6 {
        0 => random.vector() * 1e3,
        1 => in_plane,
        2 => corners[(random.bits() % 3) as usize],
        3 => in_plane + random.vector() * random.small(12.0),
        4 => corners[0] + (corners[1] - corners[0]) * (0.5 + 0.5 * s),
        _ => random.vector() * 2.0,
    }
}

/// The smallest distance over the seven candidates, each made feasible first; nothing is shared
/// with the tested code.
fn exhaustive_distance(corners: &[DVec3; 3], point: DVec3) -> f64 {
    let mut smallest = f64::INFINITY;
    for k in 0..3 {
        let from = corners[k];
        let to = corners[(k + 1) % 3];
        smallest = smallest.min(point.distance(from));
        let edge = to - from;
        let length = from.distance(to);
        if length > 0.0 {
            let share = ((edge / length).dot(point - from) / length).clamp(0.0, 1.0);
            smallest = smallest.min(point.distance(from + edge * share));
        }
    }
    // Interior, from an orthonormal frame of the plane at every corner in turn: the best of three
    // is good for any shape.
    for k in 0..3 {
        let [p, q, r] = [0, 1, 2].map(|j| corners[(k + j) % 3]);
        let e0 = q - p;
        let e1 = r - p;
        let x = e0.normalize_or_zero();
        let height = e1 - x * x.dot(e1);
        let height = height - x * x.dot(height);
        let tall = height.length();
        if x == DVec3::ZERO || tall < 1e-15 {
            continue;
        }
        let y = height / tall;
        let mut foot = p;
        let mut s = 0.0;
        let mut t = 0.0;
        for _ in 0..3 {
            let rest = point - foot;
            let dt = y.dot(rest) / tall;
            t += dt;
            s += (x.dot(rest) - dt * x.dot(e1)) / e0.length();
            foot = p + e0 * s + e1 * t;
        }
        if s >= 0.0 && t >= 0.0 && s + t <= 1.0 {
            smallest = smallest.min(point.distance(foot));
        }
    }
    smallest
}

fn scale_of(corners: &[DVec3; 3], distance: f64) -> f64 {
    let span = (0..3).map(|k| corners[k].distance(corners[(k + 1) % 3])).fold(0.0, f64::max);
    // Corners of order 1 carry their own rounding, whatever the size of the triangle.
    distance.max(span).max(1.0)
}

#[test]
#[expect(clippy::print_stdout, reason = "reports the margin")]
fn acceptance_5_agrees_with_exhaustive_search_and_covers_all_regions() {
    let mut random = Random(2008);
    let mut seen = [0_u32; 7];
    let mut worst: f64 = 0.0;
    for kind in 0..400_000 {
        let corners = random_triangle(&mut random, kind);
        let point = random_point(&mut random, &corners);
        let found = TriangleProjector::new(&corners).project(point);
        let distance = found.distance_squared.sqrt();
        let expected = exhaustive_distance(&corners, point);
        let error = (distance - expected).abs() / scale_of(&corners, expected);
        worst = worst.max(error);
        assert!(
            error <= 1e-12,
            "{corners:?} {point:?}: {distance:e} instead of {expected:e}, {:?}",
            found.feature
        );
        if kind % 8 > 4 {
            seen[match found.feature {
                TriangleFeature::Interior => 0,
                TriangleFeature::Edge(k) => 1 + usize::from(k),
                TriangleFeature::Vertex(k) => 4 + usize::from(k),
            }] += 1;
        }
    }
    println!(
        "worst relative error {worst:.2e}, interior/edges/vertices of ordinary triangles {seen:?}"
    );
    assert!(seen.iter().all(|count| *count > 1000), "{seen:?}");
}

#[test]
fn region_names_the_feature_that_holds_the_point() {
    let mut random = Random(7);
    for kind in 0..100_000 {
        let corners = random_triangle(&mut random, kind);
        let point = random_point(&mut random, &corners);
        for found in [
            TriangleProjector::new(&corners).project(point),
            project_by_voronoi_clamp(&corners, point),
        ] {
            match found.feature {
                TriangleFeature::Vertex(k) => assert_eq!(found.point, corners[usize::from(k)]),
                TriangleFeature::Edge(k) => {
                    let (from, to) = (corners[usize::from(k)], corners[usize::from((k + 1) % 3)]);
                    let gap =
                        found.point.distance(from) + found.point.distance(to) - from.distance(to);
                    assert!(gap.abs() < 1e-14, "{gap:e}");
                }
                TriangleFeature::Interior => {}
            }
        }
    }
}

#[test]
fn both_methods_agree_on_ordinary_triangles() {
    let mut random = Random(37);
    for _ in 0..100_000 {
        let corners = random_triangle(&mut random, 5);
        let point = random_point(&mut random, &corners);
        let b = TriangleProjector::new(&corners).project(point);
        let a = project_by_voronoi_clamp(&corners, point);
        let scale = scale_of(&corners, b.distance_squared.sqrt());
        let thin = (corners[1] - corners[0]).cross(corners[2] - corners[0]).length();
        if thin > 1e-3 {
            assert!(
                a.point.distance(b.point) <= 1e-9 * scale,
                "{corners:?} {point:?}: {a:?} {b:?}"
            );
        }
    }
}

#[test]
fn known_triangle_gives_each_region() {
    let corners = [DVec3::ZERO, DVec3::X, DVec3::Y];
    let projector = TriangleProjector::new(&corners);
    let cases = [
        ((0.25, 0.25, 3.0), (0.25, 0.25, 0.0), TriangleFeature::Interior),
        ((0.5, -2.0, 1.0), (0.5, 0.0, 0.0), TriangleFeature::Edge(0)),
        ((1.0, 1.0, 0.0), (0.5, 0.5, 0.0), TriangleFeature::Edge(1)),
        ((-1.0, 0.5, 0.0), (0.0, 0.5, 0.0), TriangleFeature::Edge(2)),
        ((-1.0, -1.0, 0.0), (0.0, 0.0, 0.0), TriangleFeature::Vertex(0)),
        ((3.0, 0.0, 0.0), (1.0, 0.0, 0.0), TriangleFeature::Vertex(1)),
        ((0.0, 5.0, 1.0), (0.0, 1.0, 0.0), TriangleFeature::Vertex(2)),
    ];
    for ((px, py, pz), (fx, fy, fz), feature) in cases {
        let point = DVec3::new(px, py, pz);
        for found in [projector.project(point), project_by_voronoi_clamp(&corners, point)] {
            assert_eq!(found.feature, feature);
            assert!(found.point.distance(DVec3::new(fx, fy, fz)) < 1e-15);
            assert!((found.distance_squared - point.distance_squared(found.point)).abs() < 1e-15);
        }
    }
    assert!(TriangleFeature::Interior.is_interior() && !TriangleFeature::Edge(0).is_interior());
}

#[test]
fn huge_and_tiny_finite_input_never_gives_nan() {
    let sizes = [0.0, 5e-324, 1e-200, 1e-160, 1e-80, 1.0, 1e80, 1e160, 1e200, 1e300, f64::MAX];
    let mut random = Random(99);
    for size in sizes {
        for distance in sizes {
            for kind in 0..64 {
                let corners = random_triangle(&mut random, kind)
                    .map(|corner| (corner * 0.5).clamp(-DVec3::ONE, DVec3::ONE) * size);
                let point = random.vector() * distance;
                let found = TriangleProjector::new(&corners).project(point);
                assert!(
                    found.point.is_finite() && !found.distance_squared.is_nan(),
                    "{corners:?} {point:?}: {found:?}"
                );
            }
        }
    }
}

#[test]
fn overflowing_coordinates_keep_the_region_names() {
    let corners = [DVec3::ZERO, DVec3::X * 1e200, DVec3::Y * 1e200];
    let found = TriangleProjector::new(&corners).project(DVec3::new(0.5e200, -1e200, 0.0));
    assert_eq!(found.feature, TriangleFeature::Edge(0));
    assert!((found.point.x - 0.5e200).abs() < 1e186 && found.point.y == 0.0);
}

proptest! {
    #[test]
    fn never_panics_on_any_bits(bits in prop::array::uniform12(any::<u64>())) {
        let number = |k: usize| f64::from_bits(bits[k]);
        let vector = |k: usize| DVec3::new(number(k), number(k + 1), number(k + 2));
        let corners = [vector(0), vector(3), vector(6)];
        let found = TriangleProjector::new(&corners).project(vector(9));
        if corners.iter().all(|corner| corner.is_finite()) && vector(9).is_finite() {
            prop_assert!(found.point.is_finite());
            prop_assert!(!found.distance_squared.is_nan());
        }
    }

    #[test]
    fn closest_point_is_a_fixed_point(
        corners in prop::array::uniform3(prop::array::uniform3(-1.0..1.0_f64)),
        point in prop::array::uniform3(-2.0..2.0_f64),
    ) {
        let corners = corners.map(DVec3::from_array);
        let projector = TriangleProjector::new(&corners);
        let found = projector.project(DVec3::from_array(point));
        prop_assert!(projector.project(found.point).distance_squared <= 1e-24);
    }
}
