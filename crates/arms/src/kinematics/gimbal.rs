//! The passive wrist of capstan arms: three measured joints without a motor, whose axes meet in the
//! grip point.
//!
//! ```text
//! native_from_grip = Rz(θA) · Ry(φ) · R_first(θD) · Ry(θE) · Rx(θF)
//! ```
//! with φ the pitch of the last link: −λ of the five-link, π/2 − θC of a serial arm.

use core::f64::consts::TAU;

use glam::{DMat3, DQuat, DVec3};

use super::Configuration;
use crate::axes::MAX_AXES;
use vps::spatial::Twist;

/// About which axis of the last link the first wrist joint turns.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Gimbal {
    /// x, along the link: Polhem.
    #[default]
    Roll,
    /// z, across it: the vintage arm.
    Yaw,
}

impl Gimbal {
    fn first_axis(self) -> DVec3 {
        match self {
            Self::Roll => DVec3::X,
            Self::Yaw => DVec3::Z,
        }
    }

    /// Sets the orientation and the columns of joints 3 to 5. `native_from_link`: orientation of
    /// the last link.
    pub(super) fn apply(
        self,
        native_from_link: DQuat,
        joints: &[f64; MAX_AXES],
        configuration: &mut Configuration,
    ) {
        let [_, _, _, d, e, f, ..] = *joints;
        let after_d = native_from_link * DQuat::from_axis_angle(self.first_axis(), d);
        let after_e = after_d * DQuat::from_rotation_y(e);
        let angular = |axis: DVec3| Twist { linear: DVec3::ZERO, angular: axis };
        configuration.columns[3] = angular(native_from_link * self.first_axis());
        configuration.columns[4] = angular(after_d * DVec3::Y);
        configuration.columns[5] = angular(after_e * DVec3::X);
        configuration.native_from_grip.rotation = (after_e * DQuat::from_rotation_x(f)).normalize();
    }

    /// Wrist angles of an orientation, the solution nearest to `near`. Where the first and last
    /// axis coincide, the first stays.
    pub(super) fn angles(self, link_from_grip: DQuat, near: [f64; 3]) -> [f64; 3] {
        // Columns of the matrix: r.x_axis.y is row y of column x.
        let r = DMat3::from_quat(link_from_grip);
        let solutions = match self {
            // Rx(d) Ry(e) Rx(f): first column (cos e, sin d sin e, −cos d sin e), first row (cos e,
            // sin e sin f, sin e cos f).
            Self::Roll => {
                let sin_e = r.x_axis.y.hypot(r.x_axis.z);
                if sin_e < 1e-9 {
                    // Only d ± f is determined: Ry(0 or π) between two turns about x.
                    let is_folded = r.x_axis.x < 0.0;
                    let turn = r.y_axis.z.atan2(r.y_axis.y);
                    let f = if is_folded { near[0] - turn } else { turn - near[0] };
                    let e = if is_folded { core::f64::consts::PI } else { 0.0 };
                    [[near[0], e, f]; 2]
                } else {
                    let up = |sign: f64| {
                        [
                            (sign * r.x_axis.y).atan2(-sign * r.x_axis.z),
                            (sign * sin_e).atan2(r.x_axis.x),
                            (sign * r.y_axis.x).atan2(sign * r.z_axis.x),
                        ]
                    };
                    [up(1.0), up(-1.0)]
                }
            }
            // Rz(d) Ry(e) Rx(f): first column (cos d cos e, sin d cos e, −sin e), last row (−sin e,
            // cos e sin f, cos e cos f).
            Self::Yaw => {
                let cos_e = r.x_axis.x.hypot(r.x_axis.y);
                if cos_e < 1e-9 {
                    let e = (-r.x_axis.z).atan2(0.0);
                    // Rz(d) Ry(±π/2) Rx(f): the second column is (sin(±f − d), cos(±f − d), 0).
                    let turn = r.y_axis.x.atan2(r.y_axis.y);
                    let f = e.signum() * (turn + near[0]);
                    [[near[0], e, f]; 2]
                } else {
                    let up = |sign: f64| {
                        [
                            (sign * r.x_axis.y).atan2(sign * r.x_axis.x),
                            (-r.x_axis.z).atan2(sign * cos_e),
                            (sign * r.y_axis.z).atan2(sign * r.z_axis.z),
                        ]
                    };
                    [up(1.0), up(-1.0)]
                }
            }
        };
        let unwrapped = solutions.map(|solution| {
            let mut angles = solution;
            for (angle, near) in angles.iter_mut().zip(near) {
                *angle += TAU * ((near - *angle) / TAU).round();
            }
            angles
        });
        let distance = |angles: &[f64; 3]| {
            angles.iter().zip(near).map(|(angle, near)| (angle - near).powi(2)).sum::<f64>()
        };
        let [first, second] = unwrapped;
        if distance(&second) < distance(&first) { second } else { first }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn forward(gimbal: Gimbal, [d, e, f]: [f64; 3]) -> DQuat {
        DQuat::from_axis_angle(gimbal.first_axis(), d)
            * DQuat::from_rotation_y(e)
            * DQuat::from_rotation_x(f)
    }

    #[test]
    fn wrist_angles_come_back_and_coinciding_axes_keep_the_first() {
        use core::f64::consts::{FRAC_PI_2, PI};
        for gimbal in [Gimbal::Roll, Gimbal::Yaw] {
            for angles in [
                [0.3, 0.4, -0.5],
                [-2.0, -0.7, 2.5],
                [4.0, 1.2, -3.5],
                [0.2, 0.0, 0.1],
                [0.5, PI, 0.3],
                [0.5, FRAC_PI_2, 0.3],
            ] {
                let near = angles.map(|angle| angle + 0.05);
                let found = gimbal.angles(forward(gimbal, angles), near);
                let error = forward(gimbal, found).conjugate() * forward(gimbal, angles);
                assert!(error.xyz().length() < 1e-8, "{gimbal:?} {angles:?} -> {found:?}");
            }
            for angles in [[0.3, 0.4, -0.5], [-2.0, -0.7, 2.5]] {
                let found =
                    gimbal.angles(forward(gimbal, angles), angles.map(|angle| angle + 0.05));
                for (found, angle) in found.iter().zip(angles) {
                    assert!((found - angle).abs() < 1e-12, "{gimbal:?} {angles:?}");
                }
            }
        }
    }
}
