//! How what touches carries the tool, and what is noted of it.
#![expect(
    clippy::disallowed_macros,
    clippy::expect_used,
    clippy::indexing_slicing,
    reason = "test code"
)]

use glam::{DQuat, DVec3, Vec3};

use super::kernel::Place;
use super::obstacle_poses::PoseStep;
use super::{
    Contact, ContactSum, ForceLaw, Normalization, Obstacle, ObstacleMotion, SimdLevel, Traversal,
    TraversalMode, visit,
};
use crate::mesh::primitives::Shape;
use crate::mesh::validate::inspect;
use crate::pointshell::{self, shell::Shell};
use crate::spatial::Pose;
use crate::voxmap::field::FieldKind;
use crate::voxmap::inside_test::InsideTest;
use crate::voxmap::{Options, Volume};

const TOOL_EDGE_M: f64 = 0.02;
const PLATE_M: f64 = 4e-3;
/// What the plate goes by in the tick, m and rad.
const MOVED: PoseStep = PoseStep {
    center: DVec3::ZERO,
    linear: DVec3::new(1e-5, -2e-5, 3e-5),
    angular: DVec3::new(2e-4, 1e-4, -3e-4),
};

pub(super) fn block(size_m: DVec3, voxel_size_m: f64) -> (crate::mesh::TriangleMesh, Volume) {
    let mesh = Shape::Box { size_m }.tessellate(1e-5);
    let options = Options { voxel_size_m, layers: 8, navigation: None, sides: InsideTest::Auto };
    let map = Volume::build(&mesh, &inspect(&mesh), &options, |_| ()).expect("a grid that fits");
    (mesh, map)
}

fn cube(voxel_size_m: f64) -> Shell {
    let (mesh, map) = block(DVec3::splat(TOOL_EDGE_M), voxel_size_m);
    pointshell::build(&mesh, &map, DVec3::ZERO).0
}

/// Its upper side is at z = 0.
pub(super) fn plate() -> Obstacle {
    let (mesh, mut map) = block(DVec3::new(0.06, 0.06, PLATE_M), 1e-3);
    Obstacle {
        field: map.field(&mesh, false),
        world_from_map: Pose::from_translation(DVec3::Z * (-0.5 * PLATE_M)),
    }
}

/// The sum of a cube so turned whose lowest point is so deep under the upper side of a plate that
/// moves.
fn pressed(
    shell: &Shell,
    plates: &[Obstacle],
    level: SimdLevel,
    mode: TraversalMode,
    turn: DQuat,
    depth_m: f64,
) -> (ContactSum, Pose) {
    let lowest_m =
        shell.points().map(|(point, _)| (turn * point.as_dvec3()).z).fold(f64::INFINITY, f64::min);
    let body = Pose::new(turn, DVec3::Z * (-lowest_m - depth_m));
    let mut traversal = Traversal::new(level, mode, plates, shell);
    for (obstacle_idx, plate) in plates.iter().enumerate() {
        traversal.obstacle_poses_mut().put(obstacle_idx, plate.world_from_map, MOVED, 1e-3);
    }
    (ContactSum::of(&mut traversal, plates, shell, body, ForceLaw::PLAIN, None), body)
}

fn turns() -> [(&'static str, DQuat); 3] {
    let on_edge = DQuat::from_rotation_x(core::f64::consts::FRAC_PI_4);
    let on_corner = DQuat::from_rotation_arc(DVec3::ONE.normalize(), DVec3::NEG_Z);
    [("side", DQuat::IDENTITY), ("edge", on_edge), ("corner", on_corner)]
}

fn assert_same(carried: &ObstacleMotion, wanted: &ObstacleMotion, what: &str) {
    let off = (carried.linear - wanted.linear).length() / wanted.linear.length();
    let turned_off = (carried.angular - wanted.angular).length() / wanted.angular.length();
    // Depths are added up in `f32`.
    assert!(
        off < 1e-5 && turned_off < 1e-5,
        "{what}: carried by {carried:?}, the plate goes by {wanted:?}"
    );
}

#[test]
fn a_side_an_edge_and_a_corner_are_carried_as_far_as_the_plate_goes() {
    let shell = cube(1e-3);
    let plates = [plate()];
    for (name, turn) in turns() {
        for depth_m in [2e-4, 1e-3, 1.8e-3] {
            for (level, mode) in [
                (SimdLevel::Portable, TraversalMode::Flat),
                (SimdLevel::Portable, TraversalMode::Tree),
                (SimdLevel::best(), TraversalMode::Tree),
            ] {
                let (sum, body) = pressed(&shell, &plates, level, mode, turn, depth_m);
                assert!(sum.contacts > 0, "{name} {depth_m}: nothing touches");
                let wanted =
                    ObstacleMotion { linear: MOVED.at(body.translation), angular: MOVED.angular };
                assert_same(
                    &sum.obstacle_motion,
                    &wanted,
                    &format!("{name}, {depth_m} m deep, {level:?} {mode:?}"),
                );
                let faces = sum.carried_faces().expect("what touches moves");
                for patch in sum.patches() {
                    let carried = &faces[usize::from(patch.face)];
                    assert_same(
                        carried,
                        &wanted,
                        &format!("{name}, {depth_m} m deep, face {}", patch.face),
                    );
                }
            }
        }
    }
}

#[test]
fn clay_that_presses_as_hard_halves_what_the_tool_is_carried_by() {
    let shell = cube(1e-3);
    let plates = [plate()];
    for (name, turn) in turns() {
        let pressed =
            || pressed(&shell, &plates, SimdLevel::best(), TraversalMode::Tree, turn, 1e-3).0;
        let half = pressed().with_clay(&pressed());
        let wanted = ObstacleMotion {
            linear: pressed().obstacle_motion.linear * 0.5,
            angular: pressed().obstacle_motion.angular * 0.5,
        };
        assert_same(&half.obstacle_motion, &wanted, name);
        let faces = half.carried_faces().expect("what touches moves");
        half.patches()
            .for_each(|patch| assert_same(&faces[usize::from(patch.face)], &wanted, name));
    }
}

#[test]
fn what_goes_so_far_in_a_tick_has_the_velocity_of_its_way_over_the_period() {
    let motion =
        ObstacleMotion { linear: DVec3::new(1.0, -2.0, 3.0), angular: DVec3::new(4.0, 5.0, -6.0) };
    // Δx / T and Δθ / T, T = ½ s.
    let velocity = motion.over(0.5);
    assert_eq!(velocity.linear, DVec3::new(2.0, -4.0, 6.0));
    assert_eq!(velocity.angular, DVec3::new(8.0, 10.0, -12.0));
}

#[test]
fn a_contact_leaves_a_plate_along_its_surface_s_normal_and_its_own_where_there_is_none() {
    let plate = plate();
    let world_from_map = Pose::new(DQuat::from_rotation_x(0.7), DVec3::new(0.1, -0.2, 0.3));
    let world_from_body = Pose::new(DQuat::from_rotation_y(-0.4), DVec3::new(-0.3, 0.1, 0.2));
    let way_out = |point_map: DVec3| {
        let arm =
            world_from_body.inverse().transform_point(world_from_map.transform_point(point_map));
        let contact = Contact::of_point(0, 5e-4, arm.as_vec3(), Vec3::X);
        plate.way_out_world(world_from_map, world_from_body, &contact)
    };
    let under_the_upper_side = way_out(DVec3::new(5e-3, -7e-3, 0.5 * PLATE_M - 5e-4));
    let upwards = world_from_map.transform_vector(DVec3::Z);
    assert!((under_the_upper_side - upwards).length() < 1e-3, "{under_the_upper_side}");
    assert_eq!(way_out(DVec3::Z), world_from_body.transform_vector(DVec3::X));
}

#[test]
fn depth_and_deepest_contact_are_noted_of_an_obstacle_under_way_and_of_none_that_stands() {
    let shell = cube(1e-3);
    let plates = [plate()];
    // A corner of the cube points down.
    let (_, turn) = turns()[2];
    let lowest_m =
        shell.points().map(|(point, _)| (turn * point.as_dvec3()).z).fold(f64::INFINITY, f64::min);
    let depth_m = 1e-3;
    for (reserve_m, height_m) in [(0.0, -depth_m), (1e-3, -depth_m), (0.0, 0.5), (1e-3, 0.5)] {
        let level = SimdLevel::best();
        let mut traversal = Traversal::new(level, TraversalMode::Tree, &plates, &shell);
        traversal.obstacle_poses_mut().pose_mut(0).expect("a plate").reserve_m = reserve_m;
        let body = Pose::new(turn, DVec3::Z * (height_m - lowest_m));
        let sum = ContactSum::of(&mut traversal, &plates, &shell, body, ForceLaw::PLAIN, None);
        assert_eq!(sum.carried_faces(), None, "nothing moved in this tick");
        let noted = traversal.obstacle_poses().pose(0).expect("a plate");
        if reserve_m == 0.0 {
            assert_eq!((noted.max_value_m, noted.deepest_world), (f64::NEG_INFINITY, None));
        } else if height_m > 0.0 {
            let outside_m = f64::from(plates[0].field.outside_m());
            assert_eq!((noted.max_value_m, noted.deepest_world), (outside_m, None));
        } else {
            assert_eq!(noted.max_value_m, sum.max_value_m);
            let (point, way_out) = noted.deepest_world.expect("a corner that touches");
            assert!(
                (point.z + depth_m).abs() < 1e-6 && (way_out - DVec3::Z).length() < 1e-3,
                "{point} {way_out}"
            );
        }
    }
}

#[test]
fn at_an_overlapping_pose_a_point_lies_in_the_middle_of_a_brick_of_the_surface() {
    let plates = [plate()];
    let shell = cube(1e-3);
    let traversal = Traversal::new(SimdLevel::Portable, TraversalMode::Tree, &plates, &shell);
    let field = &plates[0].field;
    let voxel_size_m = f64::from(field.voxel_size_m());
    let mut points_met = Vec::new();
    let mut bricks_met = Vec::new();
    for turn in 0..20 {
        let pose = traversal.overlapping_pose(&plates, &shell, turn).expect("surface and points");
        let map_from_body = plates[0].world_from_map.inverse() * pose;
        let in_a_middle = shell.points().enumerate().find_map(|(idx, (point, _))| {
            let place_m = map_from_body.transform_point(point.as_dvec3());
            let cells = (place_m - field.origin_map().as_dvec3()) / voxel_size_m;
            let brick = (cells / 8.0).floor();
            let off = (cells - 8.0 * brick - 4.0).abs().max_element();
            (off < 1e-3).then_some((idx, brick.as_ivec3(), place_m))
        });
        let (point, brick, place_m) = in_a_middle.expect("a point in a middle");
        let half_m = DVec3::new(0.03, 0.03, 0.5 * PLATE_M);
        let beyond_m = (place_m.abs() - half_m).max(DVec3::ZERO).length();
        let depth_m = (half_m - place_m.abs()).min_element().max(0.0);
        // Half the diagonal of a brick of 8³.
        assert!(beyond_m.max(depth_m) <= 4.0 * 3.0_f64.sqrt() * voxel_size_m, "turn {turn}");
        points_met.push(point);
        bricks_met.push(brick.to_array());
    }
    points_met.sort_unstable();
    points_met.dedup();
    bricks_met.sort_unstable();
    bricks_met.dedup();
    // Another one each turn.
    assert!(points_met.len() > 15 && bricks_met.len() > 15, "{points_met:?} {bricks_met:?}");
}

fn of(
    shell: &Shell,
    plates: &[Obstacle],
    mode: TraversalMode,
    body: Pose,
    law: ForceLaw,
) -> ContactSum {
    let mut traversal = Traversal::new(SimdLevel::Portable, mode, plates, shell);
    ContactSum::of(&mut traversal, plates, shell, body, law, None)
}

#[test]
fn a_sum_says_where_it_presses_and_how_wide() {
    let shell = cube(1e-3);
    let plates = [plate()];
    let half_m = 0.5 * TOOL_EDGE_M;
    for mode in [TraversalMode::Flat, TraversalMode::Tree] {
        // Its lower side lies on the plate as a whole, then with its half of less x: the border of
        // the plate is at 30 mm.
        for (x_m, arm_x_m, width_m) in [(0.0, 0.0, TOOL_EDGE_M), (0.03, -0.5 * half_m, half_m)] {
            let body = Pose::from_translation(DVec3::new(x_m, 0.0, half_m - 1.5e-3));
            let law = ForceLaw { stiffness_n_per_m: 700.0, ..ForceLaw::PLAIN };
            let sum = of(&shell, &plates, mode, body, law);
            let pressed_n: DVec3 =
                sum.patches().map(|patch| patch.normal_world * patch.force_n).sum();
            // At its border the plate is round to the voxels, and sides of the tool that stand along
            // it press askew: of their force what goes along the normal counts.
            let share = (pressed_n - sum.wrench.force).length() / pressed_n.length();
            assert!(x_m != 0.0 || share < 1e-6, "{share}");
            assert!(pressed_n.dot(DVec3::Z) > 0.9 * sum.wrench.force.z, "{pressed_n}");
            let arm = sum.arm_world;
            let off = (arm - DVec3::new(arm_x_m, 0.0, -half_m)).length();
            assert!(off < 0.04 * TOOL_EDGE_M, "{arm} for {arm_x_m}");
            let strongest = sum.patches().max_by(|a, b| a.force_n.total_cmp(&b.force_n));
            let patch = strongest.expect("a face that presses");
            assert!((patch.arm_world - arm).length() < 0.1 * TOOL_EDGE_M, "{patch:?}");
            // Of an even rectangle: the root of (a² + b²) / 12; faces beside it have the border.
            let radius_m = ((TOOL_EDGE_M.powi(2) + width_m.powi(2)) / 12.0).sqrt();
            let share = patch.radius_m / radius_m;
            assert!((0.5..1.0).contains(&share), "{patch:?} for {radius_m}");
        }
    }
}

#[test]
fn in_free_space_a_sum_knows_the_voxels_and_how_far_it_may_step() {
    let shell = cube(1e-3);
    let plates = [plate()];
    let gap_m = 4e-3;
    let body = Pose::from_translation(DVec3::Z * (0.5 * TOOL_EDGE_M + gap_m));
    // By how much a clearance may be overstated, voxels of 1 mm: half a diagonal and a moved sample.
    for (field, overstated) in
        [(FieldKind::Trilinear, 0.5 * 3.0_f64.sqrt() + 0.05), (FieldKind::Layers, 2.0)]
    {
        let sum =
            of(&shell, &plates, TraversalMode::Flat, body, ForceLaw { field, ..ForceLaw::PLAIN });
        assert_eq!(sum.contacts, 0);
        assert!((sum.voxel_size_m - 1e-3).abs() < 1e-9, "{}", sum.voxel_size_m);
        let clearance_m = -sum.max_value_m;
        assert!((clearance_m - gap_m).abs() < 1.1e-3, "{clearance_m}");
        let step_m = clearance_m - overstated * 1e-3;
        assert!((sum.step_limit_m - step_m).abs() < 1e-8, "{} for {step_m}", sum.step_limit_m);
    }
}

#[test]
fn a_flat_traversal_finds_what_the_specification_finds_near_and_far() {
    let shell = cube(2e-3);
    let plates = [plate()];
    let law = ForceLaw::PLAIN;
    for level in [SimdLevel::Portable, SimdLevel::best()] {
        let mut traversal = Traversal::new(level, TraversalMode::Flat, &plates, &shell);
        for ((name, turn), share) in turns().into_iter().zip([1.0, 2.0_f64.sqrt(), 3.0_f64.sqrt()])
        {
            // From contact, in steps of half a voxel, to beyond the band of eight voxels.
            for step in -3..20 {
                let height_m = 0.5 * TOOL_EDGE_M * share + 5e-4 * f64::from(step);
                let body = Pose::new(turn, DVec3::Z * height_m);
                let found = ContactSum::of(&mut traversal, &plates, &shell, body, law, None);
                let expected = ContactSum::flat(&plates, &shell, body, law);
                let numbers = |sum: &ContactSum| (sum.contacts, sum.max_value_m, sum.wrench);
                assert_eq!(numbers(&found), numbers(&expected), "{level:?}, {name}, step {step}");
            }
        }
    }
}

/// A corner of the cube in the plate, and no axis of it along one of the plate's.
fn askew() -> Pose {
    let turn = DQuat::from_scaled_axis(DVec3::new(0.4, -0.7, 0.5));
    let shell = cube(1e-3);
    let heights = shell.points().map(|(point, _)| (turn * point.as_dvec3()).z);
    let lowest_m = heights.fold(f64::INFINITY, f64::min);
    Pose::new(turn, DVec3::new(2e-3, -3e-3, -lowest_m - 1.7e-3))
}

#[test]
fn a_point_is_as_deep_as_the_field_says_of_its_place_and_of_its_normal_in_map_axes() {
    let shell = cube(1e-3);
    let plate = plate();
    let map_from_body = plate.world_from_map.inverse() * askew();
    let place = Place::new(&plate.field, map_from_body);
    for kind in [FieldKind::Layers, FieldKind::Octant, FieldKind::Trilinear] {
        let depths_m = shell.points().map(|(point, normal)| {
            let normal_map = map_from_body.transform_vector(normal.as_dvec3());
            plate.field.value(kind, place.cells(point), normal_map.as_vec3())
        });
        let depths_m: Vec<f32> = depths_m.collect();
        let mut found = Vec::new();
        let most_m = visit(&plate.field, kind, &shell, map_from_body, |contact| {
            found.push((contact.point_idx as usize, contact.depth_m));
        });
        // A normal that is turned in `f32` is off by some of its last bits.
        let off_m = |a: f32, b: f32| (a - b).abs();
        for (point_idx, depth_m) in &found {
            assert!(off_m(*depth_m, depths_m[*point_idx]) < 1e-8, "{kind:?}: {point_idx}");
        }
        let n_touching = depths_m.iter().filter(|depth_m| **depth_m > 0.0).count();
        assert!(found.len() == n_touching && n_touching > 10, "{kind:?}: {n_touching}");
        assert!(off_m(most_m, depths_m.into_iter().fold(f32::MIN, f32::max)) < 1e-8, "{kind:?}");
    }
}

#[test]
fn what_no_walk_interpolates_is_looked_up_as_the_specification_does() {
    let shell = cube(1e-3);
    let plates = [plate()];
    let interpolated = ContactSum::flat(&plates, &shell, askew(), ForceLaw::PLAIN);
    for field in [FieldKind::Layers, FieldKind::Octant] {
        let law = ForceLaw { field, ..ForceLaw::PLAIN };
        let expected = ContactSum::flat(&plates, &shell, askew(), law);
        assert_ne!(expected.wrench, interpolated.wrench, "{field:?}");
        for mode in [TraversalMode::Flat, TraversalMode::Tree] {
            let found = of(&shell, &plates, mode, askew(), law);
            let numbers = |sum: &ContactSum| (sum.contacts, sum.max_value_m, sum.wrench);
            assert_eq!(numbers(&found), numbers(&expected), "{field:?}, {mode:?}");
        }
    }
}

#[test]
fn the_voxels_of_a_sum_are_those_of_what_touches_and_the_smallest_where_nothing_does() {
    let shell = cube(2e-3);
    let gap_m = 4e-3;
    let (mesh, mut map) = block(DVec3::new(0.06, 0.06, PLATE_M), 5e-4);
    let height_m = TOOL_EDGE_M + gap_m + 0.5 * PLATE_M;
    let world_from_map = Pose::from_translation(DVec3::Z * height_m);
    let plates = [plate(), Obstacle { field: map.field(&mesh, false), world_from_map }];
    // The tool touches the plate below it, of voxels of 1 mm, and then none of both.
    for (height_m, voxel_m) in [(-1e-3, 1e-3), (0.5 * gap_m, 5e-4)] {
        let body = Pose::from_translation(DVec3::Z * (0.5 * TOOL_EDGE_M + height_m));
        for mode in [TraversalMode::Flat, TraversalMode::Tree] {
            let sum = of(&shell, &plates, mode, body, ForceLaw::PLAIN);
            assert_eq!(sum.contacts > 0, height_m < 0.0);
            assert!((sum.voxel_size_m - voxel_m).abs() < 1e-9, "{} {mode:?}", sum.voxel_size_m);
        }
    }
}

#[test]
fn what_presses_in_free_space_is_zero_without_a_sign() {
    let shell = cube(2e-3);
    let plates = [plate()];
    // On its corner: z of the world has a negative share of each axis of the tool.
    let (_, turn) = turns()[2];
    let body = Pose::new(turn, DVec3::Z * (TOOL_EDGE_M + 1e-3));
    let sum = of(&shell, &plates, TraversalMode::Tree, body, ForceLaw::PLAIN);
    assert!(sum.contacts == 0 && sum.looked_at > 0);
    for vector in [sum.wrench.force, sum.wrench.torque, sum.arm_world] {
        assert_eq!(vector.to_array().map(f64::to_bits), [0; 3], "{sum:?}");
    }
}

#[test]
fn an_average_over_more_than_ten_contacts_is_the_force_of_ten() {
    let shell = cube(1e-3);
    let plates = [plate()];
    let at = |x_m: f64| {
        let body = Pose::from_translation(DVec3::new(x_m, 0.0, 0.5 * TOOL_EDGE_M - 1.5e-3));
        let law = |normalization| ForceLaw { normalization, ..ForceLaw::PLAIN };
        let by = |normalization| of(&shell, &plates, TraversalMode::Flat, body, law(normalization));
        let [whole, average] = [Normalization::None, Normalization::Average].map(by);
        (whole.contacts, whole.wrench.force.z, average.wrench.force.z)
    };
    let (contacts, whole_n, average_n) = at(0.0);
    // Each of one s², a quarter voxel deep or more.
    let expected = 10.0 / f64::from(contacts);
    assert!(contacts > 300 && (average_n / whole_n / expected - 1.0).abs() < 0.01, "{average_n}");
    let far = at(0.1);
    assert_eq!(far.0, 0);
}

#[test]
fn an_average_shortens_force_and_moment_by_the_same_share() {
    let shell = cube(1e-3);
    let plates = [plate()];
    // Its lower side overlaps a corner of the plate, and does not lie on it flatly.
    let turn = DQuat::from_scaled_axis(DVec3::new(0.02, -0.03, 0.4));
    let body = Pose::new(turn, DVec3::new(0.027, 0.025, 0.5 * TOOL_EDGE_M - 1.5e-3));
    let wrench = |normalization| {
        let law = ForceLaw { normalization, stiffness_n_per_m: 700.0, ..ForceLaw::PLAIN };
        of(&shell, &plates, TraversalMode::Flat, body, law).wrench
    };
    let [whole, average] = [Normalization::None, Normalization::Average].map(wrench);
    let share = average.force.length() / whole.force.length();
    assert!((0.01..0.5).contains(&share) && whole.torque.length() > 1e-3, "{share}: {whole:?}");
    let off_nm = (average.torque - whole.torque * share).length();
    assert!(off_nm < 1e-9 * average.torque.length(), "{average:?} and not {share} of {whole:?}");
}

#[test]
fn what_is_forgotten_is_looked_at_again() {
    let shell = cube(1e-3);
    let plates = [plate()];
    let body = Pose::from_translation(DVec3::Z * (TOOL_EDGE_M + 1e-3));
    let mut traversal = Traversal::new(SimdLevel::Portable, TraversalMode::Tree, &plates, &shell)
        .with_broad_phase(false);
    let looked_at = |traversal: &mut Traversal| {
        ContactSum::of(traversal, &plates, &shell, body, ForceLaw::PLAIN, None).looked_at
    };
    let first = looked_at(&mut traversal);
    assert!(looked_at(&mut traversal) < first);
    traversal.forget();
    assert_eq!(looked_at(&mut traversal), first);
}

#[test]
fn a_depth_is_a_bound_where_the_field_ends() {
    let shell = cube(1e-3);
    let (mesh, _) = block(DVec3::splat(0.06), 1e-3);
    let options =
        Options { voxel_size_m: 1e-3, layers: 3, navigation: None, sides: InsideTest::Auto };
    let mut map = Volume::build(&mesh, &inspect(&mesh), &options, |_| ()).expect("a grid");
    let obstacle = Obstacle { field: map.field(&mesh, false), world_from_map: Pose::IDENTITY };
    for (depth_m, is_bound) in [(-0.01, false), (1e-3, false), (2.4e-3, false), (2.6e-3, true)] {
        let body = Pose::from_translation(DVec3::Z * (0.03 + 0.5 * TOOL_EDGE_M - depth_m));
        for mode in [TraversalMode::Tree, TraversalMode::Flat] {
            for level in [SimdLevel::Portable, SimdLevel::best()] {
                let obstacles = core::slice::from_ref(&obstacle);
                let mut traversal = Traversal::new(level, mode, obstacles, &shell);
                let sum =
                    ContactSum::of(&mut traversal, obstacles, &shell, body, ForceLaw::PLAIN, None);
                assert_eq!(sum.depth_is_bound, is_bound, "{depth_m}, {mode:?}: {sum:?}");
            }
        }
    }
}
