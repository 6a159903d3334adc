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

#[cfg(test)]
mod tests {
    use glam::DMat3;

    use super::*;

    fn turn(x: f64, y: f64, z: f64) -> DQuat {
        DQuat::from_scaled_axis(DVec3::new(x, y, z))
    }

    fn axes(names: &[&str]) -> Axes {
        names.iter().filter_map(|name| Axes::from_name(name)).fold(Axes::NONE, Axes::union)
    }

    fn mapping() -> DeviceMapping {
        DeviceMapping {
            world_from_device: Pose::new(turn(0.4, -0.9, 0.6), DVec3::new(0.5, -0.2, 0.3)),
            scale: 2.5,
            ..DeviceMapping::PLAIN
        }
    }

    /// The world's axes of the device, as a matrix.
    fn device_axes() -> DMat3 {
        DMat3::from_quat(mapping().world_from_device.rotation)
    }

    const MOVED: DVec3 = DVec3::new(3e-3, -2e-3, 5e-3);
    const TURNED: DVec3 = DVec3::new(0.1, -0.2, 0.15);

    fn grip_at_enable() -> Pose {
        Pose::new(turn(0.8, 0.3, -0.5), DVec3::new(0.02, -0.01, 0.03))
    }

    fn start() -> Pose {
        Pose::new(turn(-0.2, 1.1, 0.4), DVec3::new(-0.3, 0.2, 0.1))
    }

    /// A grip that has moved and turned in the device's axes since enable.
    fn sample() -> DeviceSample {
        let zero = grip_at_enable();
        let pose =
            Pose::new(DQuat::from_scaled_axis(TURNED) * zero.rotation, zero.translation + MOVED);
        let linear = DVec3::new(0.1, 0.2, -0.3);
        let angular = DVec3::new(1.0, -2.0, 0.5);
        DeviceSample { pose, twist: Twist { linear, angular }, ..DeviceSample::default() }
    }

    fn target(mapping: &DeviceMapping) -> (Pose, Twist) {
        let at_enable = DeviceSample { pose: grip_at_enable(), ..DeviceSample::default() };
        let indexing = Indexing::indexed(&at_enable);
        assert_eq!(indexing.zero(), grip_at_enable());
        indexing.target(&sample(), mapping, start())
    }

    fn assert_turned(pose: Pose, device_turn: DVec3) {
        let axes = device_axes();
        let turn = DMat3::from_quat(DQuat::from_scaled_axis(device_turn));
        let expected = axes * turn * axes.transpose() * DMat3::from_quat(start().rotation);
        let differs = DMat3::from_quat(pose.rotation) - expected;
        assert!(differs.to_cols_array().iter().all(|entry| entry.abs() < 1e-12), "{differs}");
    }

    #[test]
    fn a_grip_that_is_turned_at_enable_turns_and_moves_the_tool_along_the_axes_of_the_world() {
        let (pose, twist) = target(&mapping());
        let axes = device_axes();
        assert_turned(pose, TURNED);
        let translation = start().translation + axes * MOVED * 2.5;
        assert!((pose.translation - translation).length() < 1e-15);
        let Twist { linear, angular } = sample().twist;
        assert!((twist.linear - axes * linear * 2.5).length() < 1e-15);
        assert!((twist.angular - axes * angular).length() < 1e-15);
    }

    #[test]
    fn axes_that_are_not_sensed_move_nothing_and_axes_that_are_not_actuated_get_nothing() {
        let some = axes(&["x", "z", "ry"]);
        let mapping = DeviceMapping { sensed: some, actuated: some, ..mapping() };
        let (pose, twist) = target(&mapping);
        assert_turned(pose, DVec3::Y * TURNED.y);
        let moved = DVec3::new(MOVED.x, 0.0, MOVED.z);
        let translation = start().translation + device_axes() * moved * 2.5;
        assert!((pose.translation - translation).length() < 1e-15);
        let linear = device_axes() * DVec3::new(0.1, 0.0, -0.3) * 2.5;
        assert!((twist.linear - linear).length() < 1e-15);
        assert!((twist.angular - device_axes() * DVec3::new(0.0, -2.0, 0.0)).length() < 1e-15);
        let wrench = Wrench::new(DVec3::new(1.5, 2.5, 3.5), DVec3::new(4.5, 5.5, 6.5));
        let part = Wrench::new(DVec3::new(1.5, 0.0, 3.5), DVec3::new(0.0, 5.5, 0.0));
        assert_eq!(mapping.actuated_part(wrench), part);
    }

    #[test]
    fn wrenches_go_back_by_the_rotation_and_ways_by_the_scale_too() {
        let mapping = mapping();
        let back = device_axes().transpose();
        let one = DVec3::new(1.5, -2.5, 0.5);
        let other = DVec3::new(-0.2, 0.7, 0.3);
        let wrench = mapping.wrench_device(Wrench::new(one, other));
        assert!((wrench.force - back * one).length() < 1e-15);
        assert!((wrench.torque - back * other).length() < 1e-15);
        let (linear, angular) = mapping.way_device(one, other);
        assert!((linear - back * one / 2.5).length() < 1e-15);
        assert!((angular - back * other).length() < 1e-15);
    }
}
