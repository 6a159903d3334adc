//! The serial capstan arm: a base that turns and two links in its plane, both driven from the base
//! (devices reference, 6.1).
//!
//! ```text
//! r = Lb·sinθB + Lc·sinθC
//! x = cosθA·r − ox        y = sinθA·r − oy        z = La + Lb·cosθB − Lc·cosθC − oz
//! ```
//! The angles of both links are absolute: C does not ride on B. Singular where r = 0 or sin(θB +
//! θC) = 0; its columns are finite everywhere.

use core::f64::consts::FRAC_PI_2;

use glam::{DQuat, DVec3};

use super::gimbal::Gimbal;
use super::{Configuration, GRAVITY_M_PER_S2};
use crate::axes::MAX_AXES;
use vps::spatial::{Pose, Twist};

/// Geometry of a serial capstan arm.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Capstan {
    /// Lengths La (height of the shoulder), Lb, Lc, m.
    pub(crate) length_m: [f64; 3],
    /// Centre of the workspace, m: the native origin.
    pub(crate) origin_m: DVec3,
    /// Wrist; `None`: orientation is not sensed.
    pub(crate) gimbal: Option<Gimbal>,
    /// Gravity of the links is compensated when given.
    pub(crate) links: Option<CapstanLinks>,
}

/// Masses of the two links.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct CapstanLinks {
    /// Of B and C, kg.
    pub(crate) mass_kg: [f64; 2],
    /// Distance of the centre of mass from the joint, m.
    pub(crate) center_m: [f64; 2],
}

impl Capstan {
    pub(super) fn solve(&self, joints: &[f64; MAX_AXES]) -> Configuration {
        let [a, b, c, ..] = *joints;
        let [length_a, length_b, length_c] = self.length_m;
        let ((sin_a, cos_a), (sin_b, cos_b), (sin_c, cos_c)) =
            (a.sin_cos(), b.sin_cos(), c.sin_cos());
        let r = length_b * sin_b + length_c * sin_c;
        let height = length_a + length_b * cos_b - length_c * cos_c;
        let mut configuration = Configuration {
            native_from_grip: Pose::from_translation(
                DVec3::new(cos_a * r, sin_a * r, height) - self.origin_m,
            ),
            ..Configuration::default()
        };
        let turns = if self.gimbal.is_some() { 1.0 } else { 0.0 };
        // Without a wrist nothing is known of the orientation, so no joint is said to change it.
        configuration.columns[0] =
            Twist { linear: DVec3::new(-sin_a * r, cos_a * r, 0.0), angular: DVec3::Z * turns };
        configuration.columns[1] = Twist {
            linear: DVec3::new(
                cos_a * length_b * cos_b,
                sin_a * length_b * cos_b,
                -length_b * sin_b,
            ),
            angular: DVec3::ZERO,
        };
        configuration.columns[2] = Twist {
            linear: DVec3::new(
                cos_a * length_c * cos_c,
                sin_a * length_c * cos_c,
                length_c * sin_c,
            ),
            angular: DVec3::new(sin_a, -cos_a, 0.0) * turns,
        };
        if let Some(gimbal) = self.gimbal {
            gimbal.apply(self.native_from_link(joints), joints, &mut configuration);
        }
        configuration
    }

    /// Orientation of the last link.
    pub(super) fn native_from_link(&self, joints: &[f64; MAX_AXES]) -> DQuat {
        let [a, _, c, ..] = *joints;
        DQuat::from_rotation_z(a) * DQuat::from_rotation_y(FRAC_PI_2 - c)
    }

    /// Angles A, B, C of a position on the branch that the arms are built on, 0 < θB + θC < π and
    /// r > 0; `None`: out of reach.
    pub(super) fn angles(&self, position_native: DVec3) -> Option<[f64; 3]> {
        let [length_a, length_b, length_c] = self.length_m;
        let point = position_native + self.origin_m;
        let r = point.x.hypot(point.y);
        let height = point.z - length_a;
        let cos_sum = (length_b * length_b + length_c * length_c - r * r - height * height)
            / (2.0 * length_b * length_c);
        if cos_sum.is_nan() || cos_sum.abs() > 1.0 {
            return None;
        }
        let sum = cos_sum.acos();
        let b = r.atan2(height) - (length_c * sum.sin()).atan2(length_b - length_c * cos_sum);
        Some([point.y.atan2(point.x), b, sum - b])
    }

    pub(super) fn gravity_torques(&self, joints: &[f64; MAX_AXES]) -> [f64; MAX_AXES] {
        let mut torques_nm = [0.0; MAX_AXES];
        if let Some(CapstanLinks { mass_kg: [mass_b, mass_c], center_m: [center_b, center_c] }) =
            self.links
        {
            let [_, b, c, ..] = *joints;
            torques_nm[1] =
                -GRAVITY_M_PER_S2 * (mass_b * center_b + mass_c * self.length_m[1]) * b.sin();
            torques_nm[2] = GRAVITY_M_PER_S2 * mass_c * center_c * c.sin();
        }
        torques_nm
    }
}
