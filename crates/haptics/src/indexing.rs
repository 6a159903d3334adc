//! Between the arm's coordinates and the world's.
//!
//! At enable the tool stands at its start pose and the arm's present pose is its zero (indexing),
//! so no spring is stretched at the start. From then on the grip's motion, scaled, moves the tool's
//! centre of mass. Forces are not scaled: the arm feels scale · K.

use glam::{DQuat, DVec3};

use super::params::DeviceMapping;
use vps::spatial::{Axes, DeviceSample, Pose, Twist, Wrench};

/// The zero of the indexing: `device_from_grip` at enable.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Indexing {
    zero: Pose,
}

impl Indexing {
    /// Takes the arm's present pose as zero.
    pub fn indexed(sample: &DeviceSample) -> Self {
        Self { zero: sample.pose }
    }

    /// The arm's pose that is zero, `device_from_grip`.
    pub fn zero(&self) -> Pose {
        self.zero
    }

    /// Where the arm wants the tool's body axes (at the centre of mass), and how fast they move;
    /// world. `start` is where they stood at enable. Axes that the arm does not sense stay at their
    /// start value.
    pub fn target(
        &self,
        sample: &DeviceSample,
        mapping: &DeviceMapping,
        start: Pose,
    ) -> (Pose, Twist) {
        let axes = mapping.world_from_device.rotation;
        let moved_device = keep(sample.pose.translation - self.zero.translation, mapping.sensed, 0);
        let velocity_device = keep(sample.twist.linear, mapping.sensed, 0);
        let turn_device = sample.pose.rotation * self.zero.rotation.conjugate();
        let turn_device = if mapping.sensed.contains(Axes::ROTATION) {
            turn_device
        } else {
            // Some axes only, or none: the part of the rotation vector along them.
            DQuat::from_scaled_axis(keep(turn_device.to_scaled_axis(), mapping.sensed, 3))
        };
        let turn_world = axes * turn_device * axes.conjugate();
        let spin_world = axes * keep(sample.twist.angular, mapping.sensed, 3);
        let pose = Pose {
            rotation: (turn_world * start.rotation).normalize(),
            translation: start.translation + axes * moved_device * mapping.scale,
        };
        (pose, Twist { linear: axes * velocity_device * mapping.scale, angular: spin_world })
    }
}

impl DeviceMapping {
    /// A wrench at the grip point, from world to device axes.
    pub(super) fn wrench_device(&self, wrench_world: Wrench) -> Wrench {
        let back = self.world_from_device.rotation.conjugate();
        Wrench::new(back * wrench_world.force, back * wrench_world.torque)
    }

    /// The motion of the grip that goes with a small motion of the tool's centre of mass (m, rad;
    /// world axes), device axes.
    pub(super) fn way_device(&self, linear_world: DVec3, angular_world: DVec3) -> (DVec3, DVec3) {
        let back = self.world_from_device.rotation.conjugate();
        (back * linear_world / self.scale, back * angular_world)
    }

    /// What is left of a wrench (device axes) on the axes that the arm actuates.
    pub(super) fn actuated_part(&self, wrench: Wrench) -> Wrench {
        Wrench::new(keep(wrench.force, self.actuated, 0), keep(wrench.torque, self.actuated, 3))
    }
}

/// Zeroes the components whose axis (numbered from `first`) is not in the set.
fn keep(vector: DVec3, axes: Axes, first: usize) -> DVec3 {
    let one = |component: f64, idx: usize| if axes.has(first + idx) { component } else { 0.0 };
    DVec3::new(one(vector.x, 0), one(vector.y, 1), one(vector.z, 2))
}
