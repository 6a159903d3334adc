//! Obstacles that move: where they are asked to go, and how far they go in a tick.
//!
//! Data in: at most one [`Placement`] per tick. Data out: the poses of the obstacles, moved a
//! little. A pose is a target, never a jump:
//!
//! - an obstacle follows its target as `FOLLOW_PER_S` says, along a straight line and the shortest
//!   turn of its box's middle;
//! - no point of its box goes faster than the grip may (`limits.speed`), nor further in one tick
//!   than half of what lies between it and the tool; a quarter of a voxel is always allowed. What
//!   it may go was taken off the tool's step limit the tick before, so that what the two do
//!   together still cannot be missed;
//! - while force flows it presses no deeper into the tool than `WAIT_VOXELS`: a tool that is
//!   jammed, or an arm that will not give way, makes it wait, slowing down smoothly. Nothing is
//!   passed through, and it goes on when its way is free. Along its own face it goes on.
//!
//! # Source
//! Ours.

#![expect(clippy::disallowed_types, reason = "sized when the scene is made ready, never resized")]

use glam::DVec3;

use super::params::Parameters;
use vps::contact::obstacle_poses::{OWN_SHARE, ObstaclePoses, PoseStep};
use vps::spatial::Pose;

/// An obstacle follows its target like a critically damped spring of this rate, 1/s: it starts and
/// ends without a jerk, poses that come sixty times a second make one smooth motion, and it lags by
/// 2/rate.
const FOLLOW_PER_S: f64 = 100.0;
/// Way that is left at which an obstacle has arrived, voxels.
const ARRIVED_VOXELS: f64 = 1e-4;
/// What an obstacle may always go in one tick, voxels.
pub(super) const ALWAYS_VOXELS: f64 = 0.25;
/// Depth at which an obstacle that presses into the tool waits, voxels.
const WAIT_VOXELS: f64 = 0.5;
/// What presses deeper by no more than this share of its way moves along its face: the gradient is
/// rounded.
const ALONG_SHARE: f64 = 1e-3;
/// By how much a clearance may be overstated by the worst look-up, voxels.
const OVERSTATED_VOXELS: f64 = 2.0;
/// A pose further from the world's origin is a mistake, m.
const FARTHEST_M: f64 = 1e3;
/// A quaternion whose squared length is further from 1 is not a rotation.
const NORM_TOLERANCE: f64 = 1e-3;

/// Where an obstacle is asked to go.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Placement {
    /// Number of the obstacle in its scene.
    pub obstacle_idx: u32,
    /// The pose that it is to have.
    pub world_from_map: Pose,
}

impl Placement {
    /// True when the pose can be gone to: finite, of unit length, within a kilometre of the world's
    /// origin. The tick ignores any other.
    pub fn is_sound(&self) -> bool {
        let Pose { rotation, translation } = self.world_from_map;
        // Written so that a NaN is refused as well.
        (rotation.length_squared() - 1.0).abs() <= NORM_TOLERANCE
            && translation.abs().max_element() <= FARTHEST_M
            && rotation.is_finite()
            && translation.is_finite()
    }
}

/// The obstacles that are under way.
#[derive(Clone, Debug)]
pub(super) struct MovingObstacles {
    /// Numbers and targets; capacity for every obstacle.
    under_way: Vec<Placement>,
    turn: usize,
    /// Where one of them stands after this tick, turn by turn: enough for a viewer.
    pub(super) reported: Option<Placement>,
}

impl MovingObstacles {
    /// No obstacle is under way. Cold.
    pub(super) fn new(n_obstacles: usize) -> Self {
        Self { under_way: Vec::with_capacity(n_obstacles), turn: 0, reported: None }
    }

    /// How many are under way.
    pub(super) fn n_under_way(&self) -> u32 {
        self.under_way.len() as u32
    }

    /// One tick: moves the obstacles under way, then takes a new command, which is followed from
    /// the next tick on. `with_force`: an obstacle may press the user. RT: safe; O(obstacles under
    /// way).
    pub(super) fn advance(
        &mut self,
        obstacle_poses: &mut ObstaclePoses,
        command: Option<Placement>,
        with_force: bool,
        p: &Parameters,
    ) {
        self.turn = if self.turn + 1 < self.under_way.len() { self.turn + 1 } else { 0 };
        let reported = self.under_way.get(self.turn).map(|target| target.obstacle_idx);
        self.under_way.retain(|target| step(obstacle_poses, target, with_force, p));
        self.reported = reported.and_then(|obstacle_idx| {
            let pose = obstacle_poses.pose(obstacle_idx as usize)?;
            Some(Placement { obstacle_idx, world_from_map: pose.world_from_map })
        });
        let Some(command) = command.filter(Placement::is_sound) else { return };
        let Some(pose) = obstacle_poses.pose_mut(command.obstacle_idx as usize) else { return };
        pose.reserve_m = p.limits.speed_m_per_s * p.period_s;
        let Pose { rotation, translation } = command.world_from_map;
        let command =
            Placement { world_from_map: Pose::new(rotation.normalize(), translation), ..command };
        match self.under_way.iter_mut().find(|target| target.obstacle_idx == command.obstacle_idx) {
            Some(target) => *target = command,
            None => self.under_way.push(command),
        }
    }
}

/// Moves one obstacle towards its target; false when it stands there, and stood in this tick.
fn step(
    obstacle_poses: &mut ObstaclePoses,
    target: &Placement,
    with_force: bool,
    p: &Parameters,
) -> bool {
    let obstacle_idx = target.obstacle_idx as usize;
    let Some(pose) = obstacle_poses.pose_mut(obstacle_idx) else { return false };
    let from = pose.world_from_map;
    let to = target.world_from_map;
    let center = pose.center_world();
    let way = to.transform_point(pose.center_map) - center;
    let turn = from.rotation_to(to);
    let way_m = way.length() + turn.length() * pose.reach_m;
    if from == to || !way_m.is_finite() {
        (pose.moved, pose.reserve_m) = (PoseStep::default(), 0.0);
        return false;
    }
    let clearance_m = -pose.max_value_m - OVERSTATED_VOXELS * pose.voxel_size_m;
    let allowed_m =
        (OWN_SHARE * clearance_m).max(ALWAYS_VOXELS * pose.voxel_size_m).min(pose.reserve_m);
    // Backward Euler on x″ = r² (target − x) − 2 r x′; what it went in the last tick is its
    // velocity.
    let rate = FOLLOW_PER_S * p.period_s;
    let followed = |last: DVec3, left: DVec3| (last + left * (rate * rate)) / (1.0 + rate).powi(2);
    let mut linear = followed(pose.moved.linear, way);
    let mut angular = followed(pose.moved.angular, turn);
    let step_m = |linear: DVec3, angular: DVec3| linear.length() + angular.length() * pose.reach_m;
    let arrived_m = (ARRIVED_VOXELS * pose.voxel_size_m).min(allowed_m);
    let arrives = way_m <= arrived_m && step_m(linear, angular) <= arrived_m;
    if arrives {
        (linear, angular) = (way, turn);
    }
    // Cut together, and what is cut is not stored.
    let mut share = (allowed_m / step_m(linear, angular)).min(1.0);
    if let Some((point, way_out)) = pose.deepest_world.filter(|_| with_force) {
        let way_there = PoseStep { center, linear, angular }.at(point) * share;
        let deeper_m = way_there.dot(way_out);
        let room_m = (WAIT_VOXELS * pose.voxel_size_m - pose.max_value_m).max(0.0);
        if deeper_m > room_m.max(ALONG_SHARE * way_there.length()) {
            share *= room_m / deeper_m;
        }
    }
    let moved = PoseStep { center, linear: linear * share, angular: angular * share };
    let pose = if arrives && share >= 1.0 {
        to
    } else {
        let turned = from.stepped(DVec3::ZERO, moved.angular).rotation;
        Pose::new(turned, center + moved.linear - turned * pose.center_map)
    };
    let moved_m = step_m(moved.linear, moved.angular);
    obstacle_poses.put(obstacle_idx, pose, moved, moved_m);
    true
}

#[cfg(test)]
#[expect(clippy::expect_used, reason = "test code")]
mod tests;
