//! Solids of files as people write them, and of one body in random parts.

use std::f64::consts::PI;

use glam::{DQuat, DVec3};
use proptest::prelude::*;

use super::*;
use crate::mesh::TriangleMesh;
use crate::mesh::closest_point::TriangleProjector;
use crate::mesh::edges::edge_uses;
use crate::mesh::primitives::Shape;
use crate::mesh::weld::weld_within;

const MM: f64 = 1e-3;
const MM3: f64 = 1e-9;

/// A block between two corners, mm.
fn block(low: [f64; 3], high: [f64; 3]) -> TriangleMesh {
    let (low, high) = (DVec3::from_array(low) * MM, DVec3::from_array(high) * MM);
    moved(Shape::Box { size_m: high - low }.tessellate(1e-4), 0.5 * (low + high))
}

fn cube(half_mm: f64) -> TriangleMesh {
    block([-half_mm; 3], [half_mm; 3])
}

fn ball(radius_mm: f64, center_mm: [f64; 3]) -> TriangleMesh {
    let mesh = Shape::Sphere { radius_m: radius_mm * MM }.tessellate(0.02 * MM);
    moved(mesh, DVec3::from_array(center_mm) * MM)
}

fn moved(mut mesh: TriangleMesh, by: DVec3) -> TriangleMesh {
    mesh.vertices.iter_mut().for_each(|vertex| *vertex += by);
    mesh
}

/// Turned about a skew axis and moved, as parts of an assembly are.
fn askew(mut mesh: TriangleMesh) -> TriangleMesh {
    let turn = DQuat::from_axis_angle(DVec3::new(1.0, 2.0, -0.7).normalize(), 0.83);
    let by = DVec3::new(0.013, -0.021, 0.007);
    mesh.vertices.iter_mut().for_each(|vertex| *vertex = turn * *vertex + by);
    mesh
}

fn inside_out(mut mesh: TriangleMesh) -> TriangleMesh {
    mesh.triangles.iter_mut().for_each(|corners| corners.swap(0, 1));
    mesh
}

/// All of them in one file.
fn together(meshes: impl IntoIterator<Item = TriangleMesh>) -> TriangleMesh {
    let mut all = TriangleMesh::default();
    for mesh in meshes {
        let first = all.vertices.len() as u32;
        all.vertices.extend(mesh.vertices);
        let triangles = mesh.triangles.into_iter();
        all.triangles.extend(triangles.map(|corners| corners.map(|vertex| vertex + first)));
    }
    all
}

fn solid(mesh: &TriangleMesh) -> Solid {
    Solid::of(mesh, &SolidOptions::default())
}

/// With no more than rounding between what counts as touching.
fn exactly(mesh: &TriangleMesh) -> Solid {
    Solid::of(mesh, &SolidOptions { tolerance_m: Some(1e-12) })
}

fn volume(mesh: &TriangleMesh) -> f64 {
    let origin = mesh.vertices.first().copied().unwrap_or_default();
    let six_fold = (0..mesh.triangles.len()).map(|idx| {
        let [a, b, c] = mesh.corners(idx).map(|corner| corner - origin);
        a.dot(b.cross(c))
    });
    six_fold.sum::<f64>() / 6.0
}

/// Distance to the nearest triangle, less than 0 where the winding number is more than ½; both by
/// loops over all triangles.
fn signed_distance(mesh: &TriangleMesh, point: DVec3) -> f64 {
    let mut distance_squared = f64::INFINITY;
    let mut angle = 0.0;
    for idx in 0..mesh.triangles.len() {
        let corners = mesh.corners(idx);
        let nearest = TriangleProjector::new(&corners).project(point).point;
        distance_squared = distance_squared.min(nearest.distance_squared(point));
        let [a, b, c] = corners.map(|corner| corner - point);
        let (x, y, z) = (a.length(), b.length(), c.length());
        let below = x * y * z + a.dot(b) * z + b.dot(c) * x + c.dot(a) * y;
        angle += 2.0 * a.dot(b.cross(c)).atan2(below);
    }
    let is_inside = angle / (4.0 * PI) > 0.5;
    distance_squared.sqrt() * if is_inside { -1.0 } else { 1.0 }
}

/// Every edge of the border has as many triangles in one direction as in the other.
fn assert_closed(mesh: &TriangleMesh) {
    let welded = weld_within(&mesh.vertices, 0.0);
    let triangles: Vec<[u32; 3]> =
        mesh.triangles.iter().map(|corners| corners.map(|v| welded[v as usize])).collect();
    let uses = edge_uses(&triangles, mesh.vertices.len());
    assert!(uses.pairs.iter().all(|pair| !pair.same_direction));
    for fan in uses.fans {
        let balance: i32 = fan.triangles.iter().map(|(_, way)| if *way { 1 } else { -1 }).sum();
        assert_eq!(balance, 0, "{fan:?}");
    }
}

/// The same volume and the same signed distance everywhere.
fn assert_same(found: &TriangleMesh, expected: &TriangleMesh, seed: u64) {
    assert_closed(found);
    let (low, high) = expected.bounds().unwrap();
    let (volume, right) = (volume(found), volume(expected));
    assert!((volume / right - 1.0).abs() < 1e-9, "{volume} instead of {right}");
    let mut state = seed;
    let mut random = || random(&mut state);
    for _ in 0..60 {
        let share = DVec3::new(random(), random(), random()) * 1.4 - 0.2;
        let point = low + share * (high - low);
        let (found, right) = (signed_distance(found, point), signed_distance(expected, point));
        assert!((found - right).abs() < 1e-9, "{found} instead of {right} at {point}");
    }
}

fn assert_volume(mesh: &TriangleMesh, right_mm3: f64) {
    let found = volume(mesh) / MM3;
    assert!((found / right_mm3 - 1.0).abs() < 1e-9, "{found} instead of {right_mm3}");
}

#[test]
fn a_clean_file_is_its_own_border_bit_for_bit() {
    for mesh in [
        cube(20.0),
        ball(10.0, [1.0, 2.0, 3.0]),
        Shape::Torus { major_m: 0.02, minor_m: 0.004 }.tessellate(1e-5),
    ] {
        let found = solid(&mesh);
        assert_eq!(found.border.vertices, mesh.vertices);
        assert_eq!(found.border.triangles, mesh.triangles);
        assert!(found.skins.triangles.is_empty());
        assert!(found.report.warnings().is_empty(), "{:?}", found.report.warnings());
        assert_eq!((found.report.pieces, found.report.bodies), (1, 1));
        assert!((found.report.mass.volume_m3 / volume(&mesh) - 1.0).abs() < 1e-12);
    }
}

#[test]
fn an_inner_shell_that_faces_inward_is_an_empty_hollow() {
    // 40³ − 30³; no box meets another's face, so no triangle is cut.
    let mesh = askew(together([cube(20.0), inside_out(cube(15.0))]));
    let found = solid(&mesh);
    assert_volume(&found.border, 64_000.0 - 27_000.0);
    assert_eq!(found.border.triangles, mesh.triangles);
    assert_eq!(found.report.bodies, 1);
    assert!((found.report.cavities[0].volume_m3 / MM3 - 27_000.0).abs() < 1e-6);
    assert_eq!(found.report.warnings(), ["a hollow of 27000 mm³ is empty"]);
    let middle = askew(TriangleMesh { vertices: vec![DVec3::ZERO], triangles: vec![] }).vertices[0];
    assert!((signed_distance(&found.border, middle) - 0.015).abs() < 1e-12);
}

#[test]
fn a_body_in_a_body_adds_nothing() {
    let outer = ball(10.0, [0.0; 3]);
    let mesh = askew(together([outer.clone(), ball(6.0, [1.0, 0.5, 0.0])]));
    let found = solid(&mesh);
    assert_eq!(found.border.triangles, outer.triangles);
    assert_eq!((found.report.bodies, found.report.cavities.len()), (2, 0));
    assert!(found.report.inside_area_m2 > 0.0);
    // The block inside of the plate, 1 mm below its top.
    let plate = block([-20.0, -20.0, -10.0], [20.0, 20.0, 0.0]);
    let mesh = together([plate.clone(), block([-3.0, -3.0, -6.0], [3.0, 3.0, -1.0])]);
    assert_eq!(solid(&mesh).border.triangles, plate.triangles);
}

#[test]
fn two_overlapping_boxes_are_one_body() {
    let one = block([0.0; 3], [20.0, 10.0, 10.0]);
    for (other, right) in [
        (block([12.0, 2.0, 3.0], [32.0, 8.0, 8.0]), 2000.0 + 600.0 - 8.0 * 30.0),
        (block([12.0, -4.0, 3.0], [32.0, 14.0, 8.0]), 2000.0 + 1800.0 - 8.0 * 50.0),
        (block([-5.0, 2.0, 3.0], [32.0, 8.0, 8.0]), 2000.0 + 37.0 * 30.0 - 20.0 * 30.0),
        // A common face plane.
        (block([12.0, 2.0, 0.0], [32.0, 8.0, 8.0]), 2000.0 + 960.0 - 8.0 * 48.0),
        // The same cross-section.
        (block([12.0, 0.0, 0.0], [32.0, 10.0, 10.0]), 3200.0),
    ] {
        for mesh in [together([one.clone(), other.clone()]), together([other, one.clone()])] {
            let straight = solid(&mesh);
            assert_closed(&straight.border);
            assert_volume(&straight.border, right);
            let found = solid(&askew(mesh));
            assert_closed(&found.border);
            assert_volume(&found.border, right);
            assert_eq!(found.report.bodies, 2);
        }
    }
}

#[test]
fn stacked_blocks_are_one_whether_their_faces_match_or_not() {
    let whole = block([0.0; 3], [20.0, 10.0, 10.0]);
    for (parts, right) in [
        (
            vec![block([0.0; 3], [8.0, 10.0, 10.0]), block([8.0, 0.0, 0.0], [20.0, 10.0, 10.0])],
            Some(whole.clone()),
        ),
        // Three in an L.
        (
            vec![
                block([0.0; 3], [8.0, 10.0, 10.0]),
                block([8.0, 0.0, 0.0], [20.0, 4.0, 10.0]),
                block([8.0, 4.0, 0.0], [20.0, 10.0, 10.0]),
            ],
            Some(whole),
        ),
        // On a part of a face, and beyond it.
        (vec![block([0.0; 3], [8.0, 10.0, 10.0]), block([8.0, 3.0, 3.0], [20.0, 7.0, 7.0])], None),
        (
            vec![block([0.0; 3], [8.0, 10.0, 10.0]), block([8.0, 5.0, 6.0], [20.0, 15.0, 12.0])],
            None,
        ),
    ] {
        let sum: f64 = parts.iter().map(volume).sum();
        for mesh in [together(parts.clone()), askew(together(parts))] {
            let found = solid(&mesh);
            assert_closed(&found.border);
            assert_volume(&found.border, sum / MM3);
            assert!(found.report.inside_area_m2 > 0.0 || found.report.repeated_triangles > 0);
            if let Some(right) = &right
                && mesh.vertices[0] == right.vertices[0]
            {
                assert_same(&found.border, right, 1);
            }
        }
    }
}

#[test]
fn triangles_that_stand_twice_count_once() {
    let one = askew(cube(10.0));
    for other in [one.clone(), inside_out(one.clone())] {
        let mut twice = together([one.clone(), other]);
        let found = solid(&twice);
        assert_eq!(found.border.triangles, one.triangles);
        assert_eq!(found.report.repeated_triangles, 12);
        // Every triangle beside its copy.
        for k in 0..12 {
            twice.triangles.swap(2 * k + 1, 12 + k);
        }
        assert_volume(&solid(&twice).border, 8000.0);
    }
    let mut with_double_side = one.clone();
    with_double_side.triangles.push(one.triangles[0]);
    let [a, b, c] = one.triangles[3];
    with_double_side.triangles.push([b, a, c]);
    let found = solid(&with_double_side);
    assert_eq!(found.border.triangles, one.triangles);
    assert_eq!((found.report.repeated_triangles, found.report.skins), (2, 0));
}

#[test]
fn a_body_in_a_cavity_is_a_body() {
    let mesh = askew(together([cube(20.0), inside_out(cube(15.0)), ball(5.0, [1.0, 2.0, 0.0])]));
    let found = solid(&mesh);
    assert_eq!(found.border.triangles, mesh.triangles);
    assert_eq!((found.report.bodies, found.report.cavities.len()), (2, 1));
    // On the floor of the cavity.
    let mesh = askew(together([
        cube(20.0),
        inside_out(cube(15.0)),
        block([-3.0, -3.0, -15.0], [3.0, 4.0, -9.0]),
    ]));
    let found = solid(&mesh);
    assert_closed(&found.border);
    assert_volume(&found.border, 37_000.0 + 6.0 * 7.0 * 6.0);
}

#[test]
fn what_faces_inward_outside_of_every_body_is_turned() {
    let mesh = together([cube(5.0), inside_out(moved(cube(4.0), DVec3::X * 0.05))]);
    let found = solid(&mesh);
    assert_volume(&found.border, 1000.0 + 512.0);
    assert_eq!((found.report.turned_pieces, found.report.inside_out), (1, false));
    assert_eq!(found.report.warnings().len(), 1);
    // Half in a body is not inside of it.
    let mesh = askew(together([cube(5.0), inside_out(block([0.0, -2.0, -2.0], [9.0, 2.0, 2.0]))]));
    let found = solid(&mesh);
    assert_volume(&found.border, 1000.0 + 4.0 * 16.0);

    let mesh = inside_out(together([cube(5.0), moved(cube(4.0), DVec3::X * 0.05)]));
    let found = solid(&mesh);
    assert_volume(&found.border, 1512.0);
    assert_eq!((found.report.turned_pieces, found.report.inside_out), (0, true));
}

#[test]
fn inconsistent_winding_is_repaired_by_piece() {
    let mut mesh = askew(together([cube(20.0), inside_out(cube(15.0))]));
    for triangle in [3, 7, 15] {
        mesh.triangles[triangle].swap(0, 2);
    }
    let found = solid(&mesh);
    assert_eq!(found.report.inconsistent_triangles, 3);
    assert_volume(&found.border, 37_000.0);
    let mut half = ball(10.0, [0.0; 3]);
    let right = volume(&half);
    half.triangles.iter_mut().step_by(2).for_each(|corners| corners.swap(0, 1));
    assert!((volume(&solid(&half).border) / right - 1.0).abs() < 1e-12);
}

#[test]
fn a_sheet_beside_a_body_is_a_skin_and_the_body_stays_solid() {
    let sheet = |low: [f64; 3], high: [f64; 3]| {
        let mut mesh = block(low, high);
        mesh.triangles.retain(|corners| {
            corners.iter().all(|vertex| mesh.vertices[*vertex as usize].z < (low[2] + 1e-6) * MM)
        });
        mesh
    };
    let part = cube(10.0);
    let apart = solid(&together([part.clone(), sheet([20.0, 0.0, 0.0], [26.0, 6.0, 1.0])]));
    assert_eq!(apart.border.triangles, part.triangles);
    assert!((apart.report.skin_area_m2 - 36e-6).abs() < 1e-12);
    // Half inside: what is inside adds nothing.
    let mesh = askew(together([part.clone(), sheet([4.0, -3.0, 0.0], [16.0, 3.0, 1.0])]));
    let across = solid(&mesh);
    assert_eq!(across.border.triangles, part.triangles);
    assert!((across.report.skin_area_m2 - 36e-6).abs() < 1e-12, "{:?}", across.report);
    let inside = solid(&together([part, sheet([-3.0, -3.0, 0.0], [3.0, 3.0, 1.0])]));
    assert!(inside.skins.triangles.is_empty() && inside.report.skins == 1);
}

#[test]
fn a_fin_of_no_thickness_is_a_skin_and_its_body_stays_solid() {
    let mut mesh = cube(10.0);
    let body = mesh.triangles.clone();
    // On an edge of the block, with one side and with both.
    let [a, b, _] = mesh.triangles[0];
    let far = mesh.vertices[a as usize] * 1.5;
    mesh.vertices.push(far);
    mesh.triangles.push([a, b, 8]);
    for n_sides in 1..=2 {
        let found = solid(&askew(mesh.clone()));
        assert_eq!(found.border.triangles, body, "{n_sides}");
        assert_eq!(found.report.skins, 1, "{:?}", found.report);
        assert!(found.report.skin_area_m2 > 1e-5);
        mesh.triangles.push([b, a, 8]);
    }
}

#[test]
fn a_ball_in_a_ball_and_two_overlapping_balls_have_the_volume_of_their_union() {
    let ball_volume = volume(&ball(10.0, [0.0; 3]));
    let found = solid(&askew(together([ball(10.0, [0.0; 3]), ball(10.0, [9.0, 3.0, 1.0])])));
    assert_closed(&found.border);
    let apart = DVec3::new(9.0, 3.0, 1.0).length() * MM;
    let r: f64 = 10.0 * MM;
    let lens = PI * (4.0 * r + apart) * (2.0 * r - apart).powi(2) / 12.0;
    let right = 2.0 * ball_volume - lens;
    let found = volume(&found.border);
    // The lens of the facets is a little smaller than that of the balls.
    assert!((found / right - 1.0).abs() < 5e-3, "{found} instead of {right}");
}

#[test]
fn bodies_that_touch_in_a_corner_or_along_an_edge_stay_whole() {
    let one = cube(5.0);
    for by in [[10.0, 10.0, 10.0], [10.0, 10.0, 0.0], [10.0, 10.0, 3.0]] {
        let other = moved(one.clone(), DVec3::from_array(by) * MM);
        let mesh = together([one.clone(), other]);
        let found = solid(&mesh);
        assert_closed(&found.border);
        assert_volume(&found.border, 2000.0);
        assert_volume(&solid(&askew(mesh)).border, 2000.0);
        assert_eq!(found.report.bodies, 2);
    }
}

#[test]
fn faces_as_far_apart_as_single_precision_rounds_still_touch() {
    let mut mesh = askew(together([
        block([0.0; 3], [8.0, 10.0, 10.0]),
        block([8.0, 2.0, 3.0], [20.0, 12.0, 12.0]),
    ]));
    mesh.vertices.iter_mut().for_each(|vertex| *vertex = vertex.as_vec3().as_dvec3());
    let found = solid(&mesh);
    assert_closed(&found.border);
    assert!((volume(&found.border) / MM3 / (800.0 + 1080.0) - 1.0).abs() < 1e-5);
    assert!((found.report.inside_area_m2 * 1e6 - 2.0 * 8.0 * 7.0).abs() < 1e-2);
}

/// Numbers below 1.
fn random(state: &mut u64) -> f64 {
    *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    (*state >> 11) as f64 / (1_u64 << 53) as f64
}

/// Boxes of a few millimetres in random attitudes, within a cube of 20 mm.
fn many_boxes(n: usize) -> Vec<TriangleMesh> {
    let mut state = 5;
    let mut vector = || DVec3::new(random(&mut state), random(&mut state), random(&mut state));
    (0..n)
        .map(|_| {
            let mesh = Shape::Box { size_m: (1.0 + 4.0 * vector()) * MM }.tessellate(1e-4);
            let turn = DQuat::from_axis_angle((vector() - 0.5).normalize(), 6.0 * vector().x);
            let at = 20.0 * MM * vector();
            let vertices = mesh.vertices.iter().map(|vertex| turn * *vertex + at).collect();
            TriangleMesh { vertices, ..mesh }
        })
        .collect()
}

#[test]
fn inside_of_many_overlapping_boxes_is_inside_of_any_of_them() {
    let boxes = many_boxes(300);
    let found = exactly(&together(boxes.clone()));
    assert_closed(&found.border);
    let mut state = 11;
    for _ in 0..300 {
        let point = DVec3::new(random(&mut state), random(&mut state), random(&mut state));
        let point = 20.0 * MM * point;
        let is_inside = boxes.iter().any(|of| signed_distance(of, point) < 0.0);
        assert_eq!(signed_distance(&found.border, point) < 0.0, is_inside, "{point}");
    }
}

#[test]
fn the_border_has_the_same_bits_for_any_number_of_threads() {
    let mesh = together(many_boxes(150).into_iter().chain([ball(7.0, [10.0; 3])]));
    let on_threads = |n_threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().unwrap();
        pool.install(|| solid(&mesh))
    };
    let one = on_threads(1);
    for n_threads in [2, 5] {
        let other = on_threads(n_threads);
        assert_eq!(other.border.triangles, one.border.triangles);
        assert_eq!(other.border.vertices, one.border.vertices);
        assert_eq!(other.report.mass, one.report.mass);
    }
}

#[test]
fn nothing_and_triangles_without_area_have_no_border() {
    assert!(solid(&TriangleMesh::default()).border.triangles.is_empty());
    let mesh = TriangleMesh {
        vertices: vec![DVec3::ZERO, DVec3::X, DVec3::new(0.5, 0.0, 0.0)],
        triangles: vec![[0, 0, 1], [0, 1, 2], [2, 2, 2]],
    };
    let found = solid(&mesh);
    assert!(found.border.triangles.is_empty());
    assert_eq!(found.report.degenerate_triangles, 2);
}

/// A convex body: polygons, counter-clockwise from outside.
#[derive(Clone, Debug)]
struct Convex(Vec<Vec<DVec3>>);

impl Convex {
    fn of(mesh: &TriangleMesh) -> Self {
        Self((0..mesh.triangles.len()).map(|idx| mesh.corners(idx).to_vec()).collect())
    }

    /// The part where `normal · x ≤ offset`; `None` when nothing is left.
    fn below(&self, normal: DVec3, offset: f64) -> Option<Self> {
        let height = |p: DVec3| p.dot(normal) - offset;
        let mut faces = Vec::new();
        let mut rim = Vec::new();
        for face in &self.0 {
            let mut kept = Vec::new();
            for k in 0..face.len() {
                let (from, to) = (face[k], face[(k + 1) % face.len()]);
                let (h, g) = (height(from), height(to));
                if h <= 0.0 {
                    kept.push(from);
                }
                if (h <= 0.0) != (g <= 0.0) {
                    // The same point for both faces of the edge.
                    let ((from, h), (to, g)) = if from.to_array() < to.to_array() {
                        ((from, h), (to, g))
                    } else {
                        ((to, g), (from, h))
                    };
                    let at = from.lerp(to, h / (h - g));
                    kept.push(at);
                    rim.push(at);
                }
            }
            if kept.len() >= 3 {
                faces.push(kept);
            }
        }
        if faces.is_empty() {
            return None;
        }
        if !rim.is_empty() {
            let center = rim.iter().sum::<DVec3>() / rim.len() as f64;
            let u = normal.any_orthonormal_vector();
            let v = normal.cross(u);
            let angle = |p: &DVec3| (*p - center).dot(v).atan2((*p - center).dot(u));
            rim.sort_by(|one, other| angle(one).total_cmp(&angle(other)));
            rim.dedup();
            faces.push(rim);
        }
        Some(Self(faces))
    }

    /// Triangles of each face from its first corner, or from its middle. From a corner there are
    /// triangles without area where corners lie on one line.
    fn mesh(&self, from_middle: bool) -> TriangleMesh {
        let mut mesh = TriangleMesh::default();
        for face in &self.0 {
            let first = mesh.vertices.len() as u32;
            mesh.vertices.extend(face);
            let n = face.len() as u32;
            if from_middle && n > 3 {
                mesh.vertices.push(face.iter().sum::<DVec3>() / f64::from(n));
                mesh.triangles.extend((0..n).map(|k| [first + n, first + k, first + (k + 1) % n]));
            } else {
                mesh.triangles.extend((2..n).map(|k| [first, first + k - 1, first + k]));
            }
        }
        mesh
    }
}

fn plane() -> impl Strategy<Value = (DVec3, f64)> {
    let axis = (-1.0..1.0_f64, -1.0..1.0_f64, -1.0..1.0_f64)
        .prop_map(|(x, y, z)| DVec3::new(x, y, z + 1e-3).normalize());
    // Planes along faces are common.
    let axis =
        prop_oneof![2 => axis, 1 => Just(DVec3::X), 1 => Just(DVec3::Y), 1 => Just(DVec3::Z)];
    (axis, -0.008..0.008_f64)
}

#[derive(Clone, Debug)]
struct Parts {
    whole: usize,
    cuts: Vec<(DVec3, f64, f64)>,
    extra: Vec<Vec<(DVec3, f64)>>,
    repeats: Vec<usize>,
    flips: Vec<usize>,
    is_turned: bool,
}

fn parts() -> impl Strategy<Value = Parts> {
    let overlap = prop_oneof![Just(0.0), 0.0..0.003_f64];
    let cut = (plane(), overlap).prop_map(|((normal, offset), overlap)| (normal, offset, overlap));
    let extra = proptest::collection::vec(plane(), 0..4);
    (
        0..3_usize,
        proptest::collection::vec(cut, 1..4),
        proptest::collection::vec(extra, 0..3),
        proptest::collection::vec(0..8_usize, 0..3),
        proptest::collection::vec(0..8_usize, 0..3),
        any::<bool>(),
    )
        .prop_map(|(whole, cuts, extra, repeats, flips, is_turned)| Parts {
            whole,
            cuts,
            extra,
            repeats,
            flips,
            is_turned,
        })
}

/// The whole body and a file that has it in parts.
fn in_parts(parts: &Parts) -> (TriangleMesh, TriangleMesh) {
    let whole = match parts.whole {
        0 => cube(10.0),
        1 => block([-12.0, -9.0, -4.0], [10.0, 7.0, 11.0]),
        _ => Shape::Sphere { radius_m: 0.01 }.tessellate(0.4e-3),
    };
    let whole = if parts.is_turned { askew(whole) } else { whole };
    let (low, high) = whole.bounds().unwrap();
    let middle = 0.5 * (low + high);
    let body = Convex::of(&whole);
    let mut pieces = vec![body.clone()];
    for (normal, offset, overlap) in &parts.cuts {
        let offset = offset + normal.dot(middle);
        pieces = pieces
            .iter()
            .flat_map(|piece| {
                [piece.below(*normal, offset + overlap), piece.below(-*normal, -offset)]
            })
            .flatten()
            .collect();
    }
    let overlaps = parts.cuts.iter().any(|(_, _, overlap)| *overlap > 0.0);
    let n_parts = pieces.len();
    for planes in &parts.extra {
        let inner = planes.iter().try_fold(body.clone(), |inner, (normal, offset)| {
            inner.below(*normal, offset + normal.dot(middle))
        });
        pieces.extend(inner);
    }
    for repeat in &parts.repeats {
        pieces.push(pieces[repeat % n_parts].clone());
    }
    let flips = !parts.flips.is_empty();
    let mut meshes: Vec<TriangleMesh> = pieces.iter().map(|piece| piece.mesh(flips)).collect();
    // A part that faces inward and lies in others is a cavity, rightly; beside others it is turned.
    if !overlaps && parts.extra.is_empty() && parts.repeats.is_empty() {
        for flip in &parts.flips {
            let flip = flip % n_parts;
            meshes[flip] = inside_out(std::mem::take(&mut meshes[flip]));
        }
    }
    (whole, together(meshes))
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 96, ..ProptestConfig::default() })]

    #[test]
    fn any_parts_of_one_body_are_that_body(parts in parts(), seed in any::<u64>()) {
        let (whole, mesh) = in_parts(&parts);
        let found = exactly(&mesh);
        prop_assert!(!found.report.tangled && found.skins.triangles.is_empty(), "{:?}", found.report);
        assert_same(&found.border, &whole, seed);
    }

    #[test]
    fn no_triangles_make_a_panic(
        vertices in proptest::collection::vec(
            (0..6_i32, 0..6_i32, 0..6_i32, 0..4_i32),
            3..40,
        ),
        triangles in proptest::collection::vec((any::<u16>(), any::<u16>(), any::<u16>()), 0..80),
        n_boxes in 0..5_usize,
    ) {
        let near = [0.0, 1e-9, -3e-7, 1e-5];
        let vertices: Vec<DVec3> = vertices
            .iter()
            .map(|(x, y, z, near_idx)| {
                DVec3::new(f64::from(*x), f64::from(*y), f64::from(*z)) + near[*near_idx as usize]
            })
            .collect();
        let n = vertices.len() as u16;
        let triangles = triangles
            .iter()
            .map(|(a, b, c)| [a, b, c].map(|vertex| u32::from(vertex % n)))
            .collect();
        let soup = TriangleMesh { vertices, triangles };
        let boxes = (0..n_boxes).map(|k| {
            let at = DVec3::new(k as f64, 0.5 * k as f64, 1.0);
            moved(Shape::Box { size_m: DVec3::new(2.0, 3.0, 1.0 + k as f64) }.tessellate(1.0), at)
        });
        let mesh = together([soup].into_iter().chain(boxes));
        let found = solid(&mesh);
        let n = found.border.vertices.len() as u32;
        prop_assert!(found.border.triangles.as_flattened().iter().all(|vertex| *vertex < n));
    }
}
