//! Sample check: may this sample of the arm be rendered?
//!
//! Data in: one device sample per tick. Data out: faults, and whether the wrench has to ramp down because samples are late.

use super::{Faults, LimitParameters};
use crate::spatial::{DeviceSample, Pose, SampleStatus};

/// A pose may move this many times further between two samples than the speed limit allows. Below the fault for speed lies
/// measurement noise: one late or early sample, or two counts of an encoder, look like several times the true speed.
const JUMP_SPEEDS: f64 = 5.0;

/// A move of up to this many metres is never a jump: slow limits would otherwise fault on the resolution of a coarse arm.
const JUMP_FLOOR_M: f64 = 5e-3;

/// A turn of more than this many radians per tick is a jump: 500 rad/s at 1 kHz, some twenty times what a wrist does, and far less than
/// the half turn that a flipped frame or a wrong axis order makes. There is no limit of angular speed to derive it from.
const JUMP_TURN_RAD: f64 = 0.5;

/// A quaternion whose squared length is further from 1 is not a rotation; `f32` on the wire stays within 1e-6.
const NORM_TOLERANCE: f64 = 1e-3;

/// What the check makes of one sample.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SampleCheck {
    /// Faults of this sample. With any of them its values are not to be used.
    pub faults: Faults,
    /// Too many ticks without a fresh sample: the output ramps down until one comes.
    pub ramp_down: bool,
    /// Ticks since the last fresh sample; 0 with a fresh one.
    pub stale_ticks: u32,
}

/// Watches the samples of one arm.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct SampleMonitor {
    previous: Option<Pose>,
    stale_ticks: u32,
}

impl SampleMonitor {
    /// Judges the sample of this tick.
    ///
    /// | finding | result |
    /// |---|---|
    /// | device lost | `DEVICE_LOST` at once |
    /// | pose, twist or grip not finite, or the quaternion not of unit length | `NON_FINITE` |
    /// | speed of the grip above the limit, or a turn of more than 0.5 rad per tick | `SPEED` |
    /// | fresh pose further from the last one than max(5 × speed limit × T, 5 mm) or 0.5 rad, per tick since then | `POSITION_JUMP` |
    /// | more than `stale_ticks_max` ticks without a fresh sample | ramp down |
    /// | more than `stale_fault_ticks` such ticks | `STALE` |
    ///
    /// Whether a fault latches (the drive may be disabled) is the caller's decision. After a jump the new pose is the one to
    /// compare with, so the operator can enable again where the arm is. RT: safe, total on every bit pattern.
    pub fn check(&mut self, sample: &DeviceSample, limits: &LimitParameters, period_s: f64) -> SampleCheck {
        if sample.status == SampleStatus::Lost {
            self.previous = None;
            self.stale_ticks = self.stale_ticks.saturating_add(1);
            return SampleCheck { faults: Faults::DEVICE_LOST, ramp_down: true, stale_ticks: self.stale_ticks };
        }
        let mut faults = Faults::NONE;
        let sound = is_sound(sample);
        if !sound {
            faults |= Faults::NON_FINITE;
        } else if sample.twist.linear.length() > limits.speed_m_per_s || sample.twist.angular.length() * period_s > JUMP_TURN_RAD {
            faults |= Faults::SPEED;
        }
        if sample.status == SampleStatus::Fresh {
            let n_ticks = f64::from(self.stale_ticks.saturating_add(1));
            self.stale_ticks = 0;
            if sound {
                if self.previous.is_some_and(|previous| is_jump(previous, sample.pose, n_ticks, limits, period_s)) {
                    faults |= Faults::POSITION_JUMP;
                }
                self.previous = Some(sample.pose);
            }
        } else {
            self.stale_ticks = self.stale_ticks.saturating_add(1);
            if self.stale_ticks > limits.stale_fault_ticks {
                faults |= Faults::STALE;
            }
        }
        SampleCheck { faults, ramp_down: self.stale_ticks > limits.stale_ticks_max, stale_ticks: self.stale_ticks }
    }
}

fn is_sound(sample: &DeviceSample) -> bool {
    let norm_error = sample.pose.rotation.length_squared() - 1.0;
    // Written so that a NaN is refused as well.
    sample.pose.is_finite() && sample.twist.is_finite() && sample.grip_rad.is_finite() && norm_error.abs() <= NORM_TOLERANCE
}

fn is_jump(previous: Pose, pose: Pose, n_ticks: f64, limits: &LimitParameters, period_s: f64) -> bool {
    let moved_m = (pose.translation - previous.translation).length();
    let allowed_m = n_ticks * (JUMP_SPEEDS * limits.speed_m_per_s * period_s).max(JUMP_FLOOR_M);
    // cos of half the turn; q and −q are the same rotation. Normalised, as each of them may be off by the tolerance.
    let norms = (previous.rotation.length_squared() * pose.rotation.length_squared()).sqrt();
    let half_turn_cos = previous.rotation.dot(pose.rotation).abs() / norms;
    let allowed_half_turn_rad = (0.5 * n_ticks * JUMP_TURN_RAD).min(core::f64::consts::FRAC_PI_2);
    moved_m > allowed_m || half_turn_cos < allowed_half_turn_rad.cos()
}

#[cfg(test)]
#[expect(clippy::disallowed_macros, reason = "test code")]
mod tests {
    use glam::{DQuat, DVec3};
    use proptest::prelude::*;

    use super::*;
    use crate::spatial::Twist;

    const PERIOD_S: f64 = 1e-3;

    fn limits() -> LimitParameters {
        LimitParameters {
            force_n: 10.0,
            torque_nm: 0.2,
            speed_m_per_s: 1.0,
            slew_n_per_s: 1000.0,
            slew_nm_per_s: 20.0,
            power_w: 5.0,
            ramp_s: 0.1,
            stale_ticks_max: 3,
            stale_fault_ticks: 20,
            overrun_fault_ticks: 10,
        }
    }

    fn fresh(x_m: f64) -> DeviceSample {
        DeviceSample { pose: Pose::from_translation(DVec3::X * x_m), status: SampleStatus::Fresh, ..DeviceSample::default() }
    }

    fn faults_of(sample: &DeviceSample) -> Faults {
        let mut monitor = SampleMonitor::default();
        monitor.check(&fresh(0.0), &limits(), PERIOD_S);
        monitor.check(sample, &limits(), PERIOD_S).faults
    }

    #[test]
    fn ordinary_samples_pass() {
        let mut monitor = SampleMonitor::default();
        for tick_idx in 0..100 {
            let mut sample = fresh(1e-3 * f64::from(tick_idx));
            sample.twist.linear.x = 0.999;
            sample.pose.rotation = DQuat::from_rotation_z(0.4 * f64::from(tick_idx));
            if tick_idx % 2 == 0 {
                sample.pose.rotation = -sample.pose.rotation;
            }
            assert_eq!(monitor.check(&sample, &limits(), PERIOD_S), SampleCheck::default());
        }
    }

    #[test]
    fn what_is_not_a_pose_is_refused() {
        let broken: [fn(&mut DeviceSample); 8] = [
            |s| s.pose.translation.y = f64::NAN,
            |s| s.pose.translation.z = f64::INFINITY,
            |s| s.pose.rotation.w = f64::NAN,
            |s| s.pose.rotation = DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0),
            |s| s.pose.rotation = DQuat::from_xyzw(0.0, 0.0, 0.0, 1.01),
            |s| s.twist.linear.x = f64::NAN,
            |s| s.twist.angular.z = f64::NEG_INFINITY,
            |s| s.grip_rad = f64::NAN,
        ];
        for (idx, breaks) in broken.into_iter().enumerate() {
            let mut sample = fresh(0.0);
            breaks(&mut sample);
            assert_eq!(faults_of(&sample), Faults::NON_FINITE, "case {idx}");
            sample.status = SampleStatus::Stale;
            assert_eq!(faults_of(&sample), Faults::NON_FINITE, "case {idx}, stale");
        }
    }

    #[test]
    fn speed_and_jumps_fault_on_their_own() {
        let mut fast = fresh(0.0);
        fast.twist.linear = DVec3::new(0.8, 0.8, 0.0);
        assert_eq!(faults_of(&fast), Faults::SPEED);
        assert_eq!(faults_of(&fresh(4.9e-3)), Faults::NONE);
        assert_eq!(faults_of(&fresh(5.1e-3)), Faults::POSITION_JUMP);
        let turned = |angle_rad| DeviceSample { pose: Pose::new(DQuat::from_rotation_y(angle_rad), DVec3::ZERO), ..fresh(0.0) };
        assert_eq!(faults_of(&turned(0.49)), Faults::NONE);
        assert_eq!(faults_of(&turned(0.51)), Faults::POSITION_JUMP);
        assert_eq!(faults_of(&turned(core::f64::consts::PI)), Faults::POSITION_JUMP);
        // The first sample has nothing to jump from, and after a jump the new place is the reference.
        let mut monitor = SampleMonitor::default();
        assert_eq!(monitor.check(&fresh(3.0), &limits(), PERIOD_S).faults, Faults::NONE);
        assert_eq!(monitor.check(&fresh(0.0), &limits(), PERIOD_S).faults, Faults::POSITION_JUMP);
        assert_eq!(monitor.check(&fresh(0.0), &limits(), PERIOD_S).faults, Faults::NONE);
    }

    #[test]
    fn a_gap_of_stale_ticks_allows_the_way_that_the_arm_went_meanwhile() {
        let mut monitor = SampleMonitor::default();
        monitor.check(&fresh(0.0), &limits(), PERIOD_S);
        for _ in 0..2 {
            monitor.check(&DeviceSample { status: SampleStatus::Stale, ..fresh(0.0) }, &limits(), PERIOD_S);
        }
        assert_eq!(monitor.check(&fresh(14.9e-3), &limits(), PERIOD_S).faults, Faults::NONE);
        assert_eq!(monitor.check(&fresh(0.0), &limits(), PERIOD_S).faults, Faults::POSITION_JUMP);
    }

    #[test]
    fn stale_samples_ramp_down_then_fault_and_a_fresh_one_recovers() {
        let mut monitor = SampleMonitor::default();
        monitor.check(&fresh(0.0), &limits(), PERIOD_S);
        let stale = DeviceSample { status: SampleStatus::Stale, ..fresh(0.0) };
        for tick_idx in 1..=25 {
            let check = monitor.check(&stale, &limits(), PERIOD_S);
            assert_eq!(check.stale_ticks, tick_idx);
            assert_eq!(check.ramp_down, tick_idx > 3);
            assert_eq!(check.faults, if tick_idx > 20 { Faults::STALE } else { Faults::NONE });
        }
        assert_eq!(monitor.check(&fresh(0.0), &limits(), PERIOD_S), SampleCheck::default());
    }

    #[test]
    fn a_lost_device_faults_at_once_whatever_its_values_are() {
        let mut lost = fresh(f64::NAN);
        lost.status = SampleStatus::Lost;
        let check = SampleMonitor::default().check(&lost, &limits(), PERIOD_S);
        assert_eq!((check.faults, check.ramp_down), (Faults::DEVICE_LOST, true));
    }

    proptest! {
        #[test]
        fn a_sample_without_faults_is_usable_for_every_bit_pattern(words in prop::array::uniform14(any::<u64>()), scale_idx in 0_usize..14) {
            let mut v = words.map(f64::from_bits);
            // Mostly sound values with one wild entry, so that every single check is reached.
            for (idx, value) in v.iter_mut().enumerate() {
                if idx != scale_idx {
                    *value = if idx == 3 { 1.0 } else { 0.0 };
                }
            }
            let [x, y, z, w, qx, qy, qz, vx, vy, vz, wx, wy, wz, grip_rad] = v;
            let sample = DeviceSample {
                pose: Pose::new(DQuat::from_xyzw(qx, qy, qz, w), DVec3::new(x, y, z)),
                twist: Twist { linear: DVec3::new(vx, vy, vz), angular: DVec3::new(wx, wy, wz) },
                grip_rad,
                ..fresh(0.0)
            };
            if faults_of(&sample).is_empty() {
                prop_assert!(sample.pose.is_finite() && sample.twist.is_finite() && grip_rad.is_finite());
                prop_assert!((sample.pose.rotation.length() - 1.0).abs() < 1e-3);
                prop_assert!(sample.twist.linear.length() <= 1.0 && sample.pose.translation.length() <= 5e-3);
            }
        }
    }
}
