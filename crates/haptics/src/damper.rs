//! A damper on the arm, from a velocity that is only known to within a step of its encoder.

use glam::DVec3;

use super::params::ArmParameters;
use vps::spatial::{Twist, Wrench};

/// Damping of a brake, N·s/m, where the arm takes so much (devices reference, safety rule 13).
const BRAKE_N_S_PER_M: f64 = 10.0;

/// The same in rotation, N·m·s/rad: in the proportion in which six-axis arms declare the two (30
/// N·s/m and 0.07 N·m·s/rad).
const BRAKE_NM_S_PER_RAD: f64 = 0.02;

/// The velocity as far as it is certain: each component counts only as far as it exceeds what one
/// step of the encoder makes of it. Below, it says nothing of the direction, and a damper that
/// follows it drives the arm.
pub(super) fn certain(twist: Twist, arm: &ArmParameters) -> Twist {
    Twist {
        linear: beyond(twist.linear, arm.velocity_step_m_per_s),
        angular: beyond(twist.angular, arm.velocity_step_rad_per_s),
    }
}

/// The wrench of a brake: a damper as strong as is safe and the arm takes.
pub(super) fn brake(twist: Twist, arm: &ArmParameters) -> Wrench {
    let Twist { linear, angular } = certain(twist, arm);
    Wrench::new(
        linear * -arm.injected_n_s_per_m.min(BRAKE_N_S_PER_M),
        angular * -arm.injected_nm_s_per_rad.min(BRAKE_NM_S_PER_RAD),
    )
}

/// The strongest damper that the arm takes, times a share.
pub(super) fn strongest(twist: Twist, arm: &ArmParameters, share: f64) -> Wrench {
    let Twist { linear, angular } = certain(twist, arm);
    Wrench::new(
        linear * (-arm.injected_n_s_per_m * share),
        angular * (-arm.injected_nm_s_per_rad * share),
    )
}

/// False for an arm that takes no damping: it cannot be braked, only let go, and is not watched.
pub(super) fn can_damp(arm: &ArmParameters) -> bool {
    arm.injected_n_s_per_m > 0.0 || arm.injected_nm_s_per_rad > 0.0
}

/// What is left of each component when it is known only to within `step`. Written so that a NaN
/// stays one.
fn beyond(velocity: DVec3, step: f64) -> DVec3 {
    velocity - velocity.clamp(DVec3::splat(-step), DVec3::splat(step))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_brake_takes_energy_out_and_is_no_stronger_than_the_arm_allows() {
        let arm = |injected_n_s_per_m| ArmParameters {
            injected_n_s_per_m,
            injected_nm_s_per_rad: 0.01,
            velocity_step_m_per_s: 0.1,
            ..ArmParameters::default()
        };
        let twist = Twist { linear: DVec3::new(0.6, -1.1, 0.05), angular: DVec3::Z };
        let wrench = brake(twist, &arm(30.0));
        assert!(
            (wrench.force - DVec3::new(-5.0, 10.0, 0.0)).length() < 1e-12
                && wrench.torque == DVec3::Z * -0.01
        );
        assert!((brake(twist, &arm(4.0)).force - DVec3::new(-2.0, 4.0, 0.0)).length() < 1e-12);
        assert!(wrench.power(twist) < 0.0);
        assert!(!can_damp(&ArmParameters::default()) && can_damp(&arm(0.0)));
        assert!(brake(Twist { linear: DVec3::NAN, ..twist }, &arm(1.0)).force.is_nan());
    }

    #[test]
    fn the_strongest_damper_resists_force_and_torque_by_its_share() {
        let arm = ArmParameters {
            injected_n_s_per_m: 30.0,
            injected_nm_s_per_rad: 0.07,
            velocity_step_m_per_s: 0.1,
            velocity_step_rad_per_s: 0.2,
            ..ArmParameters::default()
        };
        let linear = DVec3::new(0.6, -1.1, 0.05);
        let angular = DVec3::new(-1.2, 0.1, 2.2);
        let wrench = strongest(Twist { linear, angular }, &arm, 0.4);
        let force = DVec3::new(0.5, -1.0, 0.0) * (-30.0 * 0.4);
        let torque = DVec3::new(-1.0, 0.0, 2.0) * (-0.07 * 0.4);
        assert!((wrench.force - force).length() < 1e-12, "{wrench:?}");
        assert!((wrench.torque - torque).length() < 1e-12, "{wrench:?}");
        let turns = ArmParameters { injected_n_s_per_m: 0.0, ..arm };
        assert!(can_damp(&turns) && can_damp(&arm));
        let slides = ArmParameters { injected_nm_s_per_rad: 0.0, ..arm };
        assert!(can_damp(&slides));
    }
}
