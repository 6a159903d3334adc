//! Solids of files as people write them, and of one body in random parts.

use std::f64::consts::PI;

use glam::{DQuat, DVec3};
use proptest::prelude::*;

use super::cut::Limits;
use super::*;
use crate::mesh::TriangleMesh;
use crate::mesh::closest_point::TriangleProjector;
use crate::mesh::edges::edge_uses;
use crate::mesh::primitives::Shape;
use crate::mesh::weld::weld_within;

const MM: f64 = 1e-3;
const MM3: f64 = 1e-9;

/// A block between two corners, mm.
pub(super) fn block(low: [f64; 3], high: [f64; 3]) -> TriangleMesh {
    let low = DVec3::from_array(low) * MM;
    let high = DVec3::from_array(high) * MM;
    moved(Shape::Box { size_m: high - low }.tessellate(1e-4), 0.5 * (low + high))
}

pub(super) fn cube(half_mm: f64) -> TriangleMesh {
    block([-half_mm; 3], [half_mm; 3])
}

fn ball(radius_mm: f64, center_mm: [f64; 3]) -> TriangleMesh {
    let mesh = Shape::Sphere { radius_m: radius_mm * MM }.tessellate(0.02 * MM);
    moved(mesh, DVec3::from_array(center_mm) * MM)
}

pub(super) fn moved(mut mesh: TriangleMesh, by: DVec3) -> TriangleMesh {
    mesh.vertices.iter_mut().for_each(|vertex| *vertex += by);
    mesh
}

/// Turned about a skew axis and moved, as parts of an assembly are.
pub(super) fn askew(mut mesh: TriangleMesh) -> TriangleMesh {
    let turn = DQuat::from_axis_angle(DVec3::new(1.0, 2.0, -0.7).normalize(), 0.83);
    let by = DVec3::new(0.013, -0.021, 0.007);
    mesh.vertices.iter_mut().for_each(|vertex| *vertex = turn * *vertex + by);
    mesh
}

pub(super) fn inside_out(mut mesh: TriangleMesh) -> TriangleMesh {
    mesh.triangles.iter_mut().for_each(|corners| corners.swap(0, 1));
    mesh
}

/// All of them in one file.
pub(super) fn together(meshes: impl IntoIterator<Item = TriangleMesh>) -> TriangleMesh {
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
    Solid::of(mesh, &SolidOptions::resolved_by(None))
}

/// With no more than rounding between what counts as touching.
pub(super) fn exactly(mesh: &TriangleMesh) -> Solid {
    Solid::of(mesh, &SolidOptions { tolerance_m: Some(1e-12), ..SolidOptions::resolved_by(None) })
}

pub(super) fn volume(mesh: &TriangleMesh) -> f64 {
    let origin = mesh.vertices.first().copied().unwrap_or_default();
    let six_fold = (0..mesh.triangles.len()).map(|idx| {
        let [a, b, c] = mesh.corners(idx).map(|corner| corner - origin);
        a.dot(b.cross(c))
    });
    six_fold.sum::<f64>() / 6.0
}

/// Distance to the nearest triangle, less than 0 where the winding number is more than ½; both by
/// loops over all triangles.
pub(super) fn signed_distance(mesh: &TriangleMesh, point: DVec3) -> f64 {
    let mut distance_squared = f64::INFINITY;
    let mut angle = 0.0;
    for idx in 0..mesh.triangles.len() {
        let corners = mesh.corners(idx);
        let nearest = TriangleProjector::new(&corners).project(point).point;
        distance_squared = distance_squared.min(nearest.distance_squared(point));
        let [a, b, c] = corners.map(|corner| corner - point);
        let x = a.length();
        let y = b.length();
        let z = c.length();
        let below = x * y * z + a.dot(b) * z + b.dot(c) * x + c.dot(a) * y;
        angle += 2.0 * a.dot(b.cross(c)).atan2(below);
    }
    let is_inside = angle / (4.0 * PI) > 0.5;
    distance_squared.sqrt() * if is_inside { -1.0 } else { 1.0 }
}

/// Every edge of the border has as many triangles in one direction as in the other.
pub(super) fn assert_closed(mesh: &TriangleMesh) {
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
pub(super) fn assert_same(found: &TriangleMesh, expected: &TriangleMesh, seed: u64) {
    assert_closed(found);
    let (low, high) = expected.bounds().unwrap();
    let (volume, right) = (volume(found), volume(expected));
    assert!((volume / right - 1.0).abs() < 1e-9, "{volume} instead of {right}");
    let mut state = seed;
    let mut random = || random(&mut state);
    for _ in 0..60 {
        let share = DVec3::new(random(), random(), random()) * 1.4 - 0.2;
        let point = low + share * (high - low);
        let found = signed_distance(found, point);
        let right = signed_distance(expected, point);
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
    assert_eq!(found.report.warnings(), ["a hollow of 27000 mm³: empty"]);
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
    assert_eq!((found.report.repeated_triangles, found.report.open_pieces), (2, 0));
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
fn hollows_that_overlap_are_both_empty() {
    let one = block([-5.0, -3.0, -3.0], [2.0, 3.0, 3.0]);
    let other = block([-1.0, -4.0, -1.0], [6.0, 2.0, 5.0]);
    let found = solid(&askew(together([cube(10.0), inside_out(one), inside_out(other)])));
    assert_closed(&found.border);
    // Both, less what they have in common.
    let hollow = 7.0 * 36.0 + 7.0 * 36.0 - 3.0 * 5.0 * 4.0;
    assert_volume(&found.border, 8000.0 - hollow);
    assert_eq!((found.report.turned_pieces, found.report.cavities.len()), (0, 2));
}

#[test]
fn a_hollow_part_that_was_written_inside_out_keeps_its_hollow() {
    let hollow = || together([cube(10.0), inside_out(cube(6.0))]);
    let screw = || ball(3.0, [0.5, 0.2, 0.0]);
    let screw_mm3 = volume(&screw()) / MM3;
    let beside = moved(hollow(), DVec3::X * 30.0 * MM);
    for (mesh, right_mm3, turned) in [
        (inside_out(hollow()), 8000.0 - 1728.0, 2),
        // What lies in the hollow faces as it should, or not.
        (together([inside_out(hollow()), screw()]), 8000.0 - 1728.0 + screw_mm3, 2),
        (inside_out(together([hollow(), screw()])), 8000.0 - 1728.0 + screw_mm3, 3),
        (together([beside, inside_out(hollow())]), 2.0 * (8000.0 - 1728.0), 2),
    ] {
        let found = solid(&askew(mesh));
        assert_closed(&found.border);
        assert_volume(&found.border, right_mm3);
        assert_eq!(found.report.turned_pieces, turned, "{:?}", found.report);
    }
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
    assert!((apart.report.open_area_m2 - 36e-6).abs() < 1e-12);
    // Half inside: what is inside adds nothing.
    let mesh = askew(together([part.clone(), sheet([4.0, -3.0, 0.0], [16.0, 3.0, 1.0])]));
    let across = solid(&mesh);
    assert_eq!(across.border.triangles, part.triangles);
    assert!((across.report.open_area_m2 - 36e-6).abs() < 1e-12, "{:?}", across.report);
    let inside = solid(&together([part, sheet([-3.0, -3.0, 0.0], [3.0, 3.0, 1.0])]));
    assert!(inside.skins.triangles.is_empty() && inside.report.open_pieces == 1);
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
        assert_eq!(found.report.open_pieces, 1, "{:?}", found.report);
        assert!(found.report.open_area_m2 > 1e-5);
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
pub(super) fn random(state: &mut u64) -> f64 {
    *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    (*state >> 11) as f64 / (1_u64 << 53) as f64
}

/// Boxes of a few millimetres in random attitudes, within a cube of 20 mm.
fn many_boxes(n: usize) -> Vec<TriangleMesh> {
    many_boxes_from(n, 5)
}

fn many_boxes_from(n: usize, seed: u64) -> Vec<TriangleMesh> {
    let mut state = seed;
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
fn the_border_of_bodies_in_each_other_by_chance_is_closed_and_without_guesses() {
    for (tolerance_m, seed) in [(1e-12, 5), (1e-8, 6), (1e-7, 7), (1e-6, 8)] {
        let mesh = together(many_boxes_from(400, seed));
        let options =
            SolidOptions { tolerance_m: Some(tolerance_m), ..SolidOptions::resolved_by(None) };
        let found = Solid::of(&mesh, &options);
        assert_closed(&found.border);
        // Faces of 1 mm that cross at less than 7° are within four tolerances of each other farther
        // than the slivers are wide that count as none.
        let n_allowed = if tolerance_m < 1e-6 { 0 } else { 8 };
        assert!(found.report.open_edges <= n_allowed, "{tolerance_m} {:?}", found.report);
        let right = volume(&exactly(&mesh).border);
        let area: f64 = (0..found.border.triangles.len())
            .map(|idx| {
                let [a, b, c] = found.border.corners(idx);
                0.5 * (b - a).cross(c - a).length()
            })
            .sum();
        let off = (volume(&found.border) - right).abs();
        assert!(off <= area * tolerance_m + 1e-12 * right, "{tolerance_m} {off}");
    }
}

#[test]
fn more_meetings_than_the_limits_are_not_cut_and_said() {
    let mesh = together(many_boxes(40));
    let options = SolidOptions::resolved_by(None);
    let none = Limits { pairs: usize::MAX, lines: usize::MAX, crossings: usize::MAX };
    let whole = Solid::within(&mesh, &options, none);
    assert!(!whole.report.tangled && whole.report.cut_triangles > 100);
    let lows = [Limits { pairs: 100, ..none }, Limits { lines: 100, ..none }];
    for limits in lows.into_iter().chain([Limits { crossings: 10, ..none }]) {
        let found = Solid::within(&mesh, &options, limits);
        assert!(found.report.tangled, "{limits:?}");
        assert_eq!(found.border.triangles, mesh.triangles);
        assert_eq!(found.border.vertices, mesh.vertices);
        assert!(found.report.warnings().iter().any(|said| said.contains("too many places")));
    }
}

/// A tube of square section along a path in a plane, with ends: one closed piece.
fn tube(path_mm: &[[f64; 2]], side_mm: f64, heights_mm: &[f64]) -> TriangleMesh {
    let mut mesh = TriangleMesh::default();
    let at = |k: usize| DVec3::new(path_mm[k][0], path_mm[k][1], heights_mm[k]);
    let n = path_mm.len();
    for k in 0..n {
        let flat = |from: usize, to: usize| (at(to) - at(from)).with_z(0.0).normalize();
        let before = if k > 0 { flat(k - 1, k) } else { flat(k, k + 1) };
        let after = if k + 1 < n { flat(k, k + 1) } else { before };
        // The mitre of two legs.
        let to_side = DVec3::Z.cross(before + after).normalize();
        let to_side = to_side / to_side.dot(DVec3::Z.cross(before));
        for (u, v) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
            let corner = at(k) + 0.5 * side_mm * (u * to_side + v * DVec3::Z);
            mesh.vertices.push(corner * MM);
        }
    }
    for k in 0..n as u32 - 1 {
        for side in 0..4 {
            let [a, b] = [4 * k + side, 4 * k + (side + 1) % 4];
            mesh.triangles.extend([[a, b + 4, b], [a, a + 4, b + 4]]);
        }
    }
    let last = 4 * (n as u32 - 1);
    mesh.triangles.extend([[0, 1, 2], [0, 2, 3]]);
    mesh.triangles.extend([[last, last + 2, last + 1], [last, last + 3, last + 2]]);
    if volume(&mesh) < 0.0 { inside_out(mesh) } else { mesh }
}

#[test]
fn a_piece_that_passes_through_itself_is_inside_once() {
    // The last leg crosses the first, at half its height, and in one plane with it.
    let path = [[0.0, 0.0], [40.0, 0.0], [40.0, 30.0], [15.0, 30.0], [15.0, -20.0]];
    for (lift, overlap) in [(3.0, 7.0), (0.0, 10.0)] {
        let heights = [0.0, 0.0, 0.5 * lift, lift, lift];
        let knot = tube(&path, 10.0, &heights);
        assert_closed(&knot);
        for mesh in [knot.clone(), askew(knot)] {
            let found = solid(&mesh);
            assert_eq!((found.report.pieces, found.report.bodies), (1, 1));
            assert_closed(&found.border);
            let right = volume(&mesh) / MM3 - overlap * 100.0;
            assert_volume(&found.border, right);
            assert!(found.report.inside_area_m2 > 0.0 && found.report.open_edges == 0);
        }
    }
    // The same without meeting itself is its own border.
    let path = [[0.0, 0.0], [40.0, 0.0], [40.0, 30.0], [15.0, 30.0], [15.0, 10.0]];
    let hook = askew(tube(&path, 8.0, &[0.0; 5]));
    let found = solid(&hook);
    assert_eq!(found.border.triangles, hook.triangles);
    assert_eq!(found.border.vertices, hook.vertices);
}

#[test]
fn a_ball_pushed_through_its_own_far_side_is_found_in_any_order_of_triangles() {
    // A finger from one pole passes out of the other side of a fine ball.
    let mut mesh = Shape::Sphere { radius_m: 10.0 * MM }.tessellate(0.005 * MM);
    for vertex in &mut mesh.vertices {
        if vertex.z > 9.5 * MM {
            vertex.z -= 25.0 * MM * ((vertex.z / MM - 9.5) / 0.5);
        }
    }
    let n = mesh.triangles.len();
    let mut shuffled = mesh.clone();
    for k in 0..n {
        shuffled.triangles[k] = mesh.triangles[k * 7919 % n];
    }
    assert!(!n.is_multiple_of(7919));
    for mesh in [mesh, shuffled] {
        let found = solid(&mesh);
        assert_closed(&found.border);
        assert!(found.report.cut_triangles > 0 && found.report.open_edges == 0);
        // What hangs out below is turned inside out: empty, with winding number −1.
        let [below, middle] = [-12.0, -5.0].map(|z| DVec3::new(0.0, 0.0, z * MM));
        assert!(signed_distance(&found.border, below) > 0.0);
        assert!(signed_distance(&found.border, middle) > 0.0);
        assert!(signed_distance(&found.border, DVec3::X * 5.0 * MM) < 0.0);
    }
}

#[test]
fn bodies_that_touch_and_face_opposite_ways_are_two_bodies() {
    let one = block([0.0; 3], [8.0, 10.0, 10.0]);
    let other = block([8.0, 0.0, 0.0], [20.0, 10.0, 10.0]);
    let same_size = block([8.0, 0.0, 0.0], [16.0, 10.0, 10.0]);
    for (other, right) in [(other, 2000.0), (same_size, 1600.0)] {
        for parts in [
            [one.clone(), inside_out(other.clone())],
            [inside_out(one.clone()), other.clone()],
            [inside_out(other.clone()), one.clone()],
            [other.clone(), inside_out(one.clone())],
            [inside_out(other), inside_out(one.clone())],
        ] {
            let found = solid(&askew(together(parts)));
            assert!(found.skins.triangles.is_empty() && found.report.bodies > 0);
            assert_closed(&found.border);
            assert_volume(&found.border, right);
        }
    }
}

#[test]
fn a_hollow_is_what_the_bodies_in_it_leave_empty() {
    let shell = [cube(20.0), inside_out(cube(15.0))];
    let reported = |inner: Vec<TriangleMesh>| {
        let found = solid(&askew(together(shell.iter().cloned().chain(inner))));
        assert_closed(&found.border);
        found.report.cavities.iter().map(|of| of.volume_m3 / MM3).collect::<Vec<_>>()
    };
    let near = |found: Vec<f64>, right: f64| {
        assert!(found.len() == 1 && (found[0] / right - 1.0).abs() < 1e-9, "{found:?} {right}");
    };
    near(reported(vec![]), 27_000.0);
    // Free in it; on its floor; through a wall; two that overlap.
    near(reported(vec![cube(5.0)]), 26_000.0);
    near(reported(vec![block([-3.0, -3.0, -15.0], [3.0, 4.0, -9.0])]), 27_000.0 - 252.0);
    near(reported(vec![block([5.0, -3.0, -3.0], [30.0, 4.0, 5.0])]), 27_000.0 - 560.0);
    let two = vec![cube(5.0), block([0.0; 3], [10.0, 4.0, 4.0])];
    near(reported(two), 26_000.0 - 5.0 * 16.0);
    // Full; half full, in two parts.
    assert!(reported(vec![cube(15.0)]).is_empty());
    let half =
        vec![block([-15.0; 3], [15.0, 15.0, -5.0]), block([-15.0, -15.0, -5.0], [15.0, 15.0, 0.0])];
    near(reported(half), 13_500.0);
}

#[test]
fn a_brick_that_faces_inward_is_turned_unless_others_wall_it_in() {
    let brick = |place: usize| {
        let low = [place % 3, place / 3 % 3, place / 9].map(|k| 10.0 * k as f64);
        block(low, low.map(|x| x + 10.0))
    };
    for (inward, cavity_mm3) in [(0, 0.0), (4, 0.0), (13, 1000.0)] {
        let bricks = (0..27).map(brick).enumerate();
        let wall = together(bricks.map(|(k, of)| if k == inward { inside_out(of) } else { of }));
        // Turned, the corners of neighbours differ by what was rounded.
        for mesh in [wall.clone(), askew(wall)] {
            let found = solid(&mesh);
            assert_closed(&found.border);
            assert_volume(&found.border, 27_000.0 - cavity_mm3);
            let cavities: f64 = found.report.cavities.iter().map(|of| of.volume_m3 / MM3).sum();
            assert!((cavities - cavity_mm3).abs() < 1e-6, "{inward} {cavities}");
        }
    }
}

/// A block in sheets: each face by itself, in its own triangles.
fn in_sheets(size_mm: [f64; 3], n_parts: [u32; 6], gap_mm: f64) -> TriangleMesh {
    let [x, y, z] = size_mm;
    let corner = |k: usize| DVec3::new([0.0, x][k & 1], [0.0, y][k >> 1 & 1], [0.0, z][k >> 2 & 1]);
    let faces =
        [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let mut mesh = TriangleMesh::default();
    for (place, (face, n)) in faces.into_iter().zip(n_parts).enumerate() {
        let [a, b, c, d] = face.map(corner);
        let outward = (b - a).cross(c - a).normalize();
        let first = mesh.vertices.len() as u32;
        // A fan from the middle, with `n` parts on every side.
        let shift = outward * gap_mm * if place % 2 == 0 { 1.0 } else { 0.5 };
        let rim = [[a, b], [b, c], [c, d], [d, a]];
        for [from, to] in rim {
            mesh.vertices
                .extend((0..n).map(|k| (from.lerp(to, f64::from(k) / f64::from(n)) + shift) * MM));
        }
        mesh.vertices.push((0.25 * (a + b + c + d) + shift) * MM);
        mesh.triangles
            .extend((0..4 * n).map(|k| [first + k, first + (k + 1) % (4 * n), first + 4 * n]));
    }
    mesh
}

#[test]
fn cracks_between_sheets_are_joined_up_to_their_width() {
    let size = [20.0, 10.0, 8.0];
    let with = |mesh: &TriangleMesh, crack_mm: f64| {
        Solid::of(mesh, &SolidOptions { crack_m: crack_mm * MM, ..SolidOptions::resolved_by(None) })
    };
    // Alike; corners beside edges; corners of both sides beside edges of the other.
    for n_parts in [[1; 6], [1, 2, 4, 1, 3, 2], [2, 3, 5, 7, 2, 3]] {
        let mesh = askew(in_sheets(size, n_parts, 0.01));
        let open = with(&mesh, 0.005);
        assert!(
            open.border.triangles.is_empty() && open.report.open_pieces == 6,
            "{:?}",
            open.report
        );
        assert_eq!(open.report.joined_cracks, 0);
        let found = with(&mesh, 0.05);
        assert_eq!((found.report.bodies, found.report.open_pieces), (1, 0), "{:?}", found.report);
        // Every edge of a rim.
        let n_edges: u32 = n_parts.iter().map(|n| 4 * n).sum();
        assert_eq!(found.report.joined_cracks, n_edges as usize);
        assert!(found.report.warnings().iter().any(|said| said.contains("joined")));
        assert_closed(&found.border);
        let found = volume(&found.border) / MM3;
        assert!((found / 1600.0 - 1.0).abs() < 0.01, "{found}");
    }
}

#[test]
fn corners_on_edges_of_the_same_plane_are_joined_and_holes_are_not() {
    // A corner in the middle of an edge of the other triangle, 2 µm off it.
    let mut mesh = cube(10.0);
    let [a, b, c] = mesh.triangles[0];
    let right = volume(&mesh);
    let middle = 0.5 * (mesh.vertices[a as usize] + mesh.vertices[b as usize]);
    let off = 2e-3 * MM * (mesh.vertices[c as usize] - middle).normalize();
    let new = mesh.vertices.len() as u32;
    mesh.vertices.push(middle + off);
    mesh.triangles.splice(0..1, [[a, new, c], [new, b, c]]);
    let options = SolidOptions { crack_m: 0.01 * MM, ..SolidOptions::resolved_by(None) };
    let tolerance_m = Some(1e-9);
    let found = Solid::of(&mesh, &SolidOptions { tolerance_m, ..options });
    assert_eq!((found.report.bodies, found.report.joined_cracks), (1, 3), "{:?}", found.report);
    assert_closed(&found.border);
    // The edge of the other face is led through the corner, which takes a third of the slit, 10 mm
    // long and 2 µm wide in its middle, times 10 mm off that face.
    let taken = 0.5 * 10.0 * 2e-3 * 10.0 / 3.0 / 1000.0;
    let found_share = volume(&found.border) / right;
    assert!((1.0 - found_share).abs() < 1.01 * taken, "{found_share}");
    // Without a triangle there is a hole, whose corners are not near each other.
    mesh.triangles.pop();
    let found = Solid::of(&mesh, &SolidOptions { tolerance_m, ..options });
    assert_eq!((found.report.bodies, found.report.open_pieces), (0, 1));
}

#[test]
fn a_closed_file_is_not_changed_by_joining_cracks() {
    // Parts nearer to each other than a crack is wide.
    let mesh = together([cube(5.0), moved(cube(5.0), DVec3::X * 10.01 * MM)]);
    let found =
        Solid::of(&mesh, &SolidOptions { crack_m: 0.1 * MM, ..SolidOptions::resolved_by(None) });
    assert_eq!(found.border.triangles, mesh.triangles);
    assert_eq!(found.border.vertices, mesh.vertices);
    assert_eq!(found.report.joined_cracks, 0);
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
                let from = face[k];
                let to = face[(k + 1) % face.len()];
                let h = height(from);
                let g = height(to);
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
pub(super) struct Parts {
    pub(super) whole: usize,
    pub(super) cuts: Vec<(DVec3, f64, f64)>,
    pub(super) extra: Vec<Vec<(DVec3, f64)>>,
    pub(super) repeats: Vec<usize>,
    pub(super) flips: Vec<usize>,
    pub(super) inward_repeats: Vec<usize>,
    pub(super) is_inward: bool,
    pub(super) is_turned: bool,
}

pub(super) fn parts() -> impl Strategy<Value = Parts> {
    let overlap = prop_oneof![Just(0.0), 0.0..0.003_f64];
    let cut = (plane(), overlap).prop_map(|((normal, offset), overlap)| (normal, offset, overlap));
    let extra = proptest::collection::vec(plane(), 0..4);
    (
        0..3_usize,
        proptest::collection::vec(cut, 1..4),
        proptest::collection::vec(extra, 0..3),
        proptest::collection::vec(0..8_usize, 0..3),
        proptest::collection::vec(0..8_usize, 0..3),
        proptest::collection::vec(0..8_usize, 0..2),
        prop_oneof![4 => Just(false), 1 => Just(true)],
        any::<bool>(),
    )
        .prop_map(
            |(whole, cuts, extra, repeats, flips, inward_repeats, is_inward, is_turned)| Parts {
                whole,
                cuts,
                extra,
                repeats,
                flips,
                inward_repeats,
                is_inward,
                is_turned,
            },
        )
}

/// The whole body and a file that has it in parts.
pub(super) fn in_parts(parts: &Parts) -> (TriangleMesh, TriangleMesh) {
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
    if parts.is_inward {
        // All of them, with what lies in them and what stands twice.
        meshes = meshes.into_iter().map(inside_out).collect();
    } else if !overlaps && parts.extra.is_empty() && parts.repeats.is_empty() {
        // A part that faces inward and lies in others is a cavity, rightly; beside others it is
        // turned.
        for flip in &parts.flips {
            let flip = flip % n_parts;
            meshes[flip] = inside_out(std::mem::take(&mut meshes[flip]));
        }
    }
    // What lies in the body and stands once more, facing inward, adds nothing.
    let n_inner = pieces.len() - n_parts - parts.repeats.len();
    for inner in parts.inward_repeats.iter().filter(|_| n_inner > 0) {
        let inner = meshes[n_parts + inner % n_inner].clone();
        meshes.push(inside_out(inner));
    }
    (whole, together(meshes))
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 500, ..ProptestConfig::default() })]

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
        crack_m in prop_oneof![Just(0.0), Just(2e-5), 0.05..3.0_f64],
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
        let found = Solid::of(&mesh, &SolidOptions { crack_m, ..SolidOptions::resolved_by(None) });
        let n = found.border.vertices.len() as u32;
        prop_assert!(found.border.triangles.as_flattened().iter().all(|vertex| *vertex < n));
    }
}
