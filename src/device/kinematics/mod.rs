//! Kinematics: from joint angles to the grip, and from a wrench at the grip to joint torques.
//!
//! Data in: joint angles, rad (m for sliding joints). Data out: a [`Configuration`]: the pose of the grip in the arm's native frame, and the columns
//! of the geometric Jacobian there. τ = JᵀW needs no inverse, so no singularity can blow up a force (devices reference, section 6).

use super::protocol::MAX_AXES;
use crate::spatial::{Pose, Twist, Wrench};

/// Where the grip is, and how each joint moves it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Configuration {
    /// Grip in the native frame. The orientation of an arm that senses none is the identity.
    pub native_from_grip: Pose,
    /// Motion of the grip point per unit rate of each joint, native axes: columns of J.
    pub columns: [Twist; MAX_AXES],
}

impl Configuration {
    /// Joint torques that hold a wrench: τ = JᵀW. `wrench_native`: native axes, reduced at the grip point.
    ///
    /// RT: safe.
    pub fn torques(&self, wrench_native: &Wrench) -> [f64; MAX_AXES] {
        self.columns.map(|column| wrench_native.power(column))
    }
}
