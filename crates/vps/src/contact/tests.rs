//! How what touches carries the tool.
#![expect(
    clippy::disallowed_macros,
    clippy::expect_used,
    clippy::indexing_slicing,
    reason = "test code"
)]

use glam::{DQuat, DVec3};

use super::obstacle_poses::PoseStep;
use super::{
    ContactSum, FACES, ForceLaw, Obstacle, ObstacleMotion, SimdLevel, Traversal, TraversalMode,
};
use crate::mesh::primitives::Shape;
use crate::mesh::validate::inspect;
use crate::pointshell::{self, shell::Shell};
use crate::spatial::Pose;
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

fn block(size_m: DVec3, voxel_size_m: f64) -> (crate::mesh::TriangleMesh, Volume) {
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
fn plate() -> Obstacle {
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
    (
        ContactSum::of(
            &mut traversal,
            plates,
            shell,
            body,
            ForceLaw { smooth_entry: true, ..ForceLaw::PLAIN },
            None,
        ),
        body,
    )
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

/// An edge or a corner that has gone past the middle of a plate would be pushed further through: it
/// has no share in the sum.
#[test]
fn points_without_a_share_carry_nothing_and_divide_by_nothing() {
    let shell = cube(5e-3);
    let plates = [plate()];
    for (name, turn) in turns().into_iter().skip(1) {
        let (sum, _) =
            pressed(&shell, &plates, SimdLevel::best(), TraversalMode::Tree, turn, 0.65 * PLATE_M);
        assert!(sum.contacts > 0, "{name}: nothing touches");
        assert_eq!(sum.patches().count(), 0, "{name}: some point has a share");
        assert_eq!(sum.obstacle_motion, ObstacleMotion::default(), "{name}");
        assert_eq!(sum.carried_faces(), Some(&[ObstacleMotion::default(); FACES]), "{name}");
        assert!(sum.wrench.is_finite() && sum.arm_world.is_finite(), "{name}");
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
