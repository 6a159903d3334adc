//! One obstacle that stands askew, step by step.

use glam::DQuat;

use super::*;
use crate::RenderScene;
use crate::testing::{parameters, skew_block, skew_scene};
use crate::tick::traversal;
use vps::contact::{Obstacle, Traversal};

/// 2 m/s at 1 kHz: what an obstacle may go in a tick, m.
const RESERVE_M: f64 = 2e-3;
const VOXEL_M: f64 = 1e-3;

struct Rig {
    scene: RenderScene,
    traversal: Traversal,
    moving: MovingObstacles,
}

impl Rig {
    fn new() -> Self {
        let mut p = parameters();
        p.limits.speed_m_per_s = 2.0;
        let scene = skew_scene(p);
        let mut rig = Self { moving: MovingObstacles::new(1), traversal: traversal(&scene), scene };
        // Half a metre from the tool, and its middle not at its origin.
        let pose = rig.traversal.obstacle_poses_mut().pose_mut(0).expect("one");
        pose.max_value_m = -0.5;
        pose.center_map = DVec3::new(0.01, -0.02, 0.015);
        rig
    }

    fn advance(&mut self, to: Option<Pose>, with_force: bool) {
        let command = to.map(|world_from_map| Placement { obstacle_idx: 0, world_from_map });
        let p = self.scene.parameters;
        self.moving.advance(self.traversal.obstacle_poses_mut(), command, with_force, &p);
    }

    fn pose(&self) -> vps::contact::obstacle_poses::ObstaclePose {
        *self.traversal.obstacle_poses().pose(0).expect("one")
    }
}

/// The pose whose middle is `way` and `turn` from the start's.
fn away(rig: &Rig, way: DVec3, turn: DVec3) -> Pose {
    let from = rig.pose();
    let rotation = DQuat::from_scaled_axis(turn) * skew_block().rotation;
    Pose::new(rotation, from.center_world() + way - rotation * from.center_map)
}

const WAY: DVec3 = DVec3::new(1e-3, -2e-3, 3e-3);
const TURN: DVec3 = DVec3::new(0.01, 0.02, -0.03);

#[test]
fn an_obstacle_follows_its_target_as_a_critically_damped_spring_about_its_middle() {
    let mut rig = Rig::new();
    let start = rig.pose();
    let to = away(&rig, WAY, TURN);
    rig.advance(Some(to), true);
    assert_eq!((rig.moving.n_under_way(), rig.pose().world_from_map), (1, skew_block()));
    assert_eq!(rig.pose().reserve_m, RESERVE_M);
    // x″ = r² (target − x) − 2 r x′ by backward Euler, r T = 0.1.
    let followed = |last: DVec3, left: DVec3| (last + left * 0.01) / 1.21;
    let first = (followed(DVec3::ZERO, WAY), followed(DVec3::ZERO, TURN));
    let second = (followed(first.0, WAY - first.0), followed(first.1, TURN - first.1));
    let mut center = start.center_world();
    let mut rotation = skew_block().rotation;
    for (linear, angular) in [first, second] {
        rig.advance(None, true);
        let pose = rig.pose();
        assert!((pose.moved.linear - linear).length() < 1e-12, "{:?} {linear}", pose.moved);
        assert!((pose.moved.angular - angular).length() < 1e-8, "{:?} {angular}", pose.moved);
        assert!((pose.moved.center - center).length() < 1e-12);
        center += linear;
        rotation = DQuat::from_scaled_axis(angular) * rotation;
        assert!((pose.center_world() - center).length() < 1e-12);
        let differs = Pose::new(rotation, center).rotation_to(pose.world_from_map);
        assert!(differs.length() < 1e-8, "{differs}");
        let reported = rig.moving.reported.expect("it is under way");
        assert_eq!(reported.world_from_map, pose.world_from_map);
    }
    for _ in 0..400 {
        rig.advance(None, true);
    }
    let pose = rig.pose();
    assert_eq!((rig.moving.n_under_way(), rig.moving.reported), (0, None));
    let arrived = Pose::new(to.rotation.normalize(), to.translation);
    assert_eq!((pose.world_from_map, pose.reserve_m), (arrived, 0.0));
    assert!(pose.moved.is_none());
}

#[test]
fn no_point_goes_further_than_the_room_allows() {
    // Half of what lies between it and the tool, less what that may be overstated by; a quarter of
    // a voxel always; no more than the speed limit.
    for (clearance_m, most_m) in
        [(3e-3, 0.5e-3), (2.2e-3, 0.25e-3), (1e-4, 0.25e-3), (0.1, RESERVE_M)]
    {
        let mut rig = Rig::new();
        rig.traversal.obstacle_poses_mut().pose_mut(0).expect("one").max_value_m = -clearance_m;
        let to = away(&rig, WAY * 1e3, TURN * 10.0);
        rig.advance(Some(to), false);
        rig.advance(None, false);
        let pose = rig.pose();
        let went_m = pose.moved.linear.length() + pose.moved.angular.length() * pose.reach_m;
        assert!((went_m / most_m - 1.0).abs() < 1e-6, "{clearance_m}: {went_m} m");
        // Cut together.
        let ratio = pose.moved.linear.length() / pose.moved.angular.length();
        assert!((ratio / (WAY.length() * 1e3 / (TURN.length() * 10.0)) - 1.0).abs() < 1e-6);
    }
}

#[test]
fn with_force_an_obstacle_goes_no_deeper_into_the_tool_than_half_a_voxel() {
    let out = DVec3::new(2.0, -1.0, 2.0) / 3.0;
    let arm = DVec3::new(0.01, 0.03, -0.02);
    for (with_force, depth_m, waits) in
        [(true, 0.4 * VOXEL_M, true), (false, 0.4 * VOXEL_M, false), (true, 0.6 * VOXEL_M, true)]
    {
        let mut rig = Rig::new();
        let to = away(&rig, out * 1.0, TURN * 10.0);
        let center = rig.pose().center_world();
        let pose = rig.traversal.obstacle_poses_mut().pose_mut(0).expect("one");
        pose.deepest_world = Some((center + arm, out));
        pose.max_value_m = depth_m;
        rig.advance(Some(to), with_force);
        rig.advance(None, with_force);
        let moved = rig.pose().moved;
        let deeper_m = (moved.linear + moved.angular.cross(arm)).dot(out);
        let room_m = (0.5 * VOXEL_M - depth_m).max(0.0);
        if waits {
            assert!((deeper_m - room_m).abs() < 1e-9, "{deeper_m} m, room for {room_m} m");
        } else {
            assert!(deeper_m > 2.0 * room_m, "{deeper_m} m");
        }
    }
}

#[test]
fn a_pose_is_sound_when_it_can_be_gone_to() {
    let sound = |rotation: DQuat, translation: DVec3| {
        Placement { obstacle_idx: 0, world_from_map: Pose::new(rotation, translation) }.is_sound()
    };
    let turn = skew_block().rotation;
    assert!(sound(turn, DVec3::ONE) && sound(turn, DVec3::splat(-999.0)));
    assert!(sound(turn * 1.0004, DVec3::ONE) && sound(turn * 0.9996, DVec3::ONE));
    assert!(!sound(turn * 1.0006, DVec3::ONE) && !sound(turn * 0.9994, DVec3::ONE));
    assert!(!sound(turn, DVec3::Y * 1001.0) && !sound(turn, DVec3::Z * -1001.0));
    assert!(!sound(turn, DVec3::NAN) && !sound(DQuat::NAN, DVec3::ONE));
}

#[test]
fn an_obstacle_arrives_when_a_ten_thousandth_of_a_voxel_is_left() {
    for (way_m, arrives) in [(0.9e-7, true), (1.1e-7, false)] {
        let mut rig = Rig::new();
        let to = away(&rig, DVec3::Y * way_m, DVec3::ZERO);
        rig.advance(Some(to), true);
        rig.advance(None, true);
        let gone = rig.pose().moved.linear.length();
        assert!((gone - if arrives { way_m } else { way_m * 0.01 / 1.21 }).abs() < 1e-12, "{gone}");
        // It stands there for a tick before it is no longer under way.
        assert_eq!(rig.moving.n_under_way(), 1);
        rig.advance(None, true);
        assert_eq!(rig.moving.n_under_way(), u32::from(!arrives));
    }
}

#[test]
fn obstacles_under_way_are_reported_turn_by_turn_and_each_has_one_target() {
    let mut scene = skew_scene(parameters());
    let field = scene.obstacles.first().expect("one").field.clone();
    scene.obstacles.push(Obstacle { field, world_from_map: Pose::from_translation(DVec3::X) });
    let mut traversal = traversal(&scene);
    let mut moving = MovingObstacles::new(2);
    let to = |obstacle_idx: u32, z_m: f64| {
        Some(Placement { obstacle_idx, world_from_map: Pose::from_translation(DVec3::Z * z_m) })
    };
    // A command is followed from the next tick on; none of them arrives.
    for (command, n_under_way, reported) in [
        (to(0, 0.5), 1, None),
        (to(1, 0.5), 2, Some(0)),
        (None, 2, Some(1)),
        (to(1, 0.7), 2, Some(0)),
        (None, 2, Some(1)),
        (None, 2, Some(0)),
    ] {
        moving.advance(traversal.obstacle_poses_mut(), command, false, &scene.parameters);
        let found = moving.reported.map(|placement| placement.obstacle_idx);
        assert_eq!((moving.n_under_way(), found), (n_under_way, reported));
    }
}
