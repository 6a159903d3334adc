//! Arms whose readings need no geometry: a pose, one axis, or rates.

use glam::{DQuat, DVec3};

use super::Configuration;
use crate::axes::MAX_AXES;
use vps::spatial::{Pose, Twist};

/// The pose in the readings of an arm that reports one; its commands are the components of a
/// wrench, so the columns are unit twists.
pub(super) fn pose(joints: &[f64; MAX_AXES]) -> Option<Configuration> {
    let [x, y, z, qx, qy, qz, qw, _] = *joints;
    let quaternion = DQuat::from_xyzw(qx, qy, qz, qw);
    // A quaternion on a wire of few digits is off 1 a little; one that is far off is no
    // orientation.
    if !(0.5..=2.0).contains(&quaternion.length_squared()) {
        return None;
    }
    let mut configuration = Configuration {
        native_from_grip: Pose::new(quaternion.normalize(), DVec3::new(x, y, z)),
        ..Configuration::default()
    };
    for (idx, axis) in DVec3::AXES.into_iter().enumerate() {
        configuration.columns[idx] = Twist { linear: axis, angular: DVec3::ZERO };
        configuration.columns[idx + 3] = Twist { linear: DVec3::ZERO, angular: axis };
    }
    Some(configuration)
}

/// A handle that moves along the native x axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct OneAxis {
    /// Way of the handle per radian of the joint, m; 1 for a joint whose reading is a way in m.
    pub(crate) m_per_rad: f64,
}

impl OneAxis {
    pub(super) fn solve(&self, joints: &[f64; MAX_AXES]) -> Configuration {
        let mut configuration = Configuration {
            native_from_grip: Pose::from_translation(DVec3::X * (self.m_per_rad * joints[0])),
            ..Configuration::default()
        };
        configuration.columns[0].linear = DVec3::X * self.m_per_rad;
        configuration
    }
}

/// A rate input: readings x, y, z, rx, ry, rz, which say how fast and not where.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Rate {
    /// Reading at full deflection.
    pub(crate) full_scale: f64,
    /// Readings up to this mean rest; above it they start from zero.
    pub(crate) dead_band: f64,
    /// Speed at full deflection, m/s.
    pub(crate) linear_m_per_s: f64,
    /// Angular speed at full deflection, rad/s.
    pub(crate) angular_rad_per_s: f64,
}

impl Rate {
    fn deflection(&self, reading: f64) -> f64 {
        if !reading.is_finite() {
            return 0.0;
        }
        ((reading.abs() - self.dead_band).max(0.0) / (self.full_scale - self.dead_band))
            .min(1.0)
            .copysign(reading)
    }

    pub(super) fn twist(&self, joints: &[f64; MAX_AXES]) -> Twist {
        let [x, y, z, rx, ry, rz, ..] = joints.map(|reading| self.deflection(reading));
        Twist {
            linear: DVec3::new(x, y, z) * self.linear_m_per_s,
            angular: DVec3::new(rx, ry, rz) * self.angular_rad_per_s,
        }
    }

    pub(super) fn joints(&self, twist_native: &Twist) -> [f64; MAX_AXES] {
        let reading = |deflection: f64| match deflection.clamp(-1.0, 1.0) {
            rest if rest.abs() < 1e-12 => 0.0,
            deflection => (self.dead_band + deflection.abs() * (self.full_scale - self.dead_band))
                .copysign(deflection),
        };
        let [x, y, z] = (twist_native.linear / self.linear_m_per_s).to_array().map(reading);
        let [rx, ry, rz] = (twist_native.angular / self.angular_rad_per_s).to_array().map(reading);
        [x, y, z, rx, ry, rz, 0.0, 0.0]
    }
}
