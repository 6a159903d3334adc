//! A serial chain of up to seven joints, as a product of exponentials: each joint is an axis and a
//! point on it at zero angle (devices reference, 6.5).
//!
//! Columns of J about the grip point p: linear â × (p − o), angular â, both in the current pose; a
//! sliding joint has linear â.

use glam::{DQuat, DVec3};

use super::Configuration;
use crate::axes::MAX_AXES;
use vps::spatial::{Pose, Twist};

/// One joint, and the link that it carries.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct ChainJoint {
    /// Unit axis at zero angles, native axes.
    pub(crate) axis: DVec3,
    /// A point on the axis at zero angles, m, native frame.
    pub(crate) point_m: DVec3,
    /// The joint slides along its axis instead of turning about it.
    pub(crate) slides: bool,
    /// Mass that moves with this joint and not with the next, kg; 0: no gravity compensation for
    /// it.
    pub(crate) mass_kg: f64,
    /// Its centre at zero angles, m, native frame.
    pub(crate) center_m: DVec3,
    /// Damping that is added to the motor's torque, N·m·s/rad.
    pub(crate) damping_nm_s_per_rad: f64,
    /// Angle near the middle of the workspace.
    pub(crate) home_rad: f64,
}

/// A chain of joints from the base to the grip.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Chain {
    /// `[MAX_AXES]`, the first `n` of them in use.
    joints: [ChainJoint; MAX_AXES],
    n: usize,
    /// Grip at zero angles.
    native_from_grip_at_zero: Pose,
    /// Acceleration of gravity, m/s², native axes; zero: no compensation.
    gravity_native: DVec3,
}

impl Chain {
    /// A chain of these joints; `None` when they are more than [`MAX_AXES`]. The pose of the grip
    /// is that at zero angles. `gravity_native` points down, in m/s²; zero compensates nothing.
    pub(crate) fn new(
        joints: &[ChainJoint],
        native_from_grip_at_zero: Pose,
        gravity_native: DVec3,
    ) -> Option<Self> {
        let mut chain =
            Self { native_from_grip_at_zero, gravity_native, n: joints.len(), ..Self::default() };
        chain.joints.get_mut(..joints.len())?.copy_from_slice(joints);
        Some(chain)
    }

    /// How many joints.
    pub(crate) fn n_joints(&self) -> usize {
        self.n
    }

    pub(super) fn home(&self) -> [f64; MAX_AXES] {
        self.joints.map(|joint| joint.home_rad)
    }

    /// Calls `visit` with each joint, its current axis and point, and the motion of everything
    /// behind it from its place at zero angles.
    fn walk(
        &self,
        angles: &[f64; MAX_AXES],
        mut visit: impl FnMut(usize, &ChainJoint, DVec3, DVec3, Pose),
    ) -> Pose {
        let mut moved = Pose::IDENTITY;
        for (idx, (joint, angle)) in self.joints.iter().zip(angles).take(self.n).enumerate() {
            let axis = moved.transform_vector(joint.axis);
            let point = moved.transform_point(joint.point_m);
            let step = if joint.slides {
                Pose::from_translation(*angle * joint.axis)
            } else {
                let turn = DQuat::from_axis_angle(joint.axis, *angle);
                Pose::new(turn, joint.point_m - turn * joint.point_m)
            };
            moved = moved * step;
            visit(idx, joint, axis, point, moved);
        }
        moved
    }

    pub(super) fn solve(&self, angles: &[f64; MAX_AXES]) -> Configuration {
        let mut lines = [(DVec3::ZERO, DVec3::ZERO, false); MAX_AXES];
        let moved = self
            .walk(angles, |idx, joint, axis, point, _| lines[idx] = (axis, point, joint.slides));
        let mut native_from_grip = moved * self.native_from_grip_at_zero;
        native_from_grip.rotation = native_from_grip.rotation.normalize();
        let columns = lines.map(|(axis, point, slides)| match slides {
            true => Twist { linear: axis, angular: DVec3::ZERO },
            false => {
                Twist { linear: axis.cross(native_from_grip.translation - point), angular: axis }
            }
        });
        Configuration { native_from_grip, columns }
    }

    /// Gravity of the links, and damping of the joints.
    pub(super) fn extra_torques(
        &self,
        angles: &[f64; MAX_AXES],
        rates: &[f64; MAX_AXES],
    ) -> [f64; MAX_AXES] {
        let mut lines = [(DVec3::ZERO, DVec3::ZERO, false); MAX_AXES];
        let mut torques_nm = [0.0; MAX_AXES];
        self.walk(angles, |idx, joint, axis, point, moved| {
            lines[idx] = (axis, point, joint.slides);
            torques_nm[idx] -= joint.damping_nm_s_per_rad * rates[idx];
            if joint.mass_kg > 0.0 {
                let center = moved.transform_point(joint.center_m);
                let held = -joint.mass_kg * self.gravity_native;
                for (torque_nm, (axis, point, slides)) in
                    torques_nm.iter_mut().zip(lines).take(idx + 1)
                {
                    *torque_nm +=
                        if slides { axis.dot(held) } else { axis.cross(center - point).dot(held) };
                }
            }
        });
        torques_nm
    }
}
