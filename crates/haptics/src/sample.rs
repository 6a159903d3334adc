//! Sample check: may this sample of the arm be rendered?
//!
//! Data in: one device sample per tick. Data out: faults, and whether the wrench has to ramp down
//! because samples are late.

use super::packets::{GarbledPackets, LinkState};
use super::stuck::StuckWatch;
use super::{Faults, LimitParameters, OffCause, SafetyParameters};
use vps::spatial::{DeviceSample, Pose, SampleStatus};

/// A pose may move this many times further between two samples than the speed limit allows. Below
/// the fault for speed lies measurement noise: one late or early sample, or two counts of an
/// encoder, look like several times the true speed.
const JUMP_SPEEDS: f64 = 5.0;

/// A move of up to this many metres is never a jump: slow limits would otherwise fault on the
/// resolution of a coarse arm.
const JUMP_FLOOR_M: f64 = 5e-3;

/// A turn of more than this many radians per tick is a jump: 500 rad/s at 1 kHz, some twenty times
/// what a wrist does, and far less than the half turn that a flipped frame or a wrong axis order
/// makes. There is no limit of angular speed to derive it from.
pub(super) const MOST_TURN_RAD: f64 = 0.5;

/// A quaternion whose squared length is further from 1 is not a rotation; `f32` on the wire stays
/// within 1e-6.
const NORM_TOLERANCE: f64 = 1e-3;

/// What the check makes of one sample.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct SampleCheck {
    /// Faults of this sample. With any of them its values are not to be used.
    pub(super) faults: Faults,
    /// `Stale` or `Protocol`: the output ramps down until samples are good again. `None`: they are.
    pub(super) ramp_down: OffCause,
}

/// Watches the samples of one arm.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct SampleMonitor {
    previous: Option<Pose>,
    stale_ticks: u32,
    stuck: StuckWatch,
    packets: GarbledPackets,
}

impl SampleMonitor {
    /// Judges the sample of this tick.
    ///
    /// | finding | result |
    /// |---|---|
    /// | device lost | `DEVICE_LOST` at once |
    /// | the network to it silent | `LINK` at once |
    /// | pose, twist or grip not finite, or the quaternion not of unit length | `NON_FINITE` |
    /// | speed of the grip above the limit, or a turn of more than 0.5 rad per tick | `SPEED` |
    /// | fresh pose further from the last one than max(5 × speed limit × T, 5 mm) or 0.5 rad, per tick since then | `POSITION_JUMP` |
    /// | more than `stale_ticks_max` ticks without a fresh sample, or a gap as long in the arm's own count | ramp down |
    /// | more than `stale_fault_ticks` such ticks | `STALE` |
    /// | `stale_fault_ticks` or more samples lost in one gap of the arm's own count | `SEQUENCE_GAP` |
    /// | five or more fresh samples that repeat a pose out of a motion ([`stuck`](super::stuck)) | stale from the first repeat |
    /// | more than `stale_fault_ticks` of them | `STUCK` |
    /// | more than 5 garbled packets in 100 ms | ramp down |
    /// | more than 10 | `PROTOCOL` |
    /// | the arm reports an error | `DEVICE_ERROR` |
    ///
    /// Garbled packets are those of this read and count whatever the status is; lost ones count
    /// with the fresh sample that shows the gap.
    ///
    /// Whether a fault becomes active (the drive may be disabled) is the caller's decision. After a
    /// jump the new pose is the one to compare with, so the operator can enable again where the arm
    /// is. RT: safe, total on every bit pattern.
    pub(super) fn check(
        &mut self,
        sample: &DeviceSample,
        limits: &LimitParameters,
        safety: &SafetyParameters,
        period_s: f64,
    ) -> SampleCheck {
        if sample.status.is_gone() {
            *self = Self { stale_ticks: self.stale_ticks.saturating_add(1), ..Self::default() };
            let (faults, ramp_down) = match sample.status {
                SampleStatus::LinkLost => (Faults::LINK, OffCause::Link),
                _ => (Faults::DEVICE_LOST, OffCause::Disconnected),
            };
            return SampleCheck { faults, ramp_down };
        }
        let mut faults = Faults::NONE;
        let sound = is_sound(sample);
        if !sound {
            faults |= Faults::NON_FINITE;
        } else if sample.twist.linear.length() > limits.speed_m_per_s
            || sample.twist.angular.length() * period_s > MOST_TURN_RAD
        {
            faults |= Faults::SPEED;
        }
        if sample.device_error != 0 {
            faults |= Faults::DEVICE_ERROR;
        }
        let link = self.packets.count(sample.corrupt_packets, period_s);
        if link == LinkState::Broken {
            faults |= Faults::PROTOCOL;
        }
        // What this tick is worth: a gap that ends now still was one.
        let worthless_ticks;
        if sample.status == SampleStatus::Fresh {
            let lost_ticks = u32::from(sample.lost_packets);
            let gap_ticks = self.stale_ticks.max(lost_ticks);
            let n_ticks = f64::from(gap_ticks.saturating_add(1));
            self.stale_ticks = 0;
            if lost_ticks >= limits.stale_fault_ticks {
                faults |= Faults::SEQUENCE_GAP;
            }
            let mut stuck_ticks = 0;
            if sound && let Some(previous) = self.previous.replace(sample.pose) {
                stuck_ticks = self.stuck.fresh(
                    previous,
                    sample.pose,
                    n_ticks,
                    safety.stuck_move_m,
                    safety.stuck_turn_rad,
                );
                if is_jump(previous, sample.pose, n_ticks, limits, period_s) {
                    faults |= Faults::POSITION_JUMP;
                }
            }
            if stuck_ticks > limits.stale_fault_ticks {
                faults |= Faults::STUCK;
            }
            worthless_ticks = stuck_ticks.max(lost_ticks);
        } else {
            self.stale_ticks = self.stale_ticks.saturating_add(1);
            if self.stale_ticks > limits.stale_fault_ticks {
                faults |= Faults::STALE;
            }
            worthless_ticks = self.stale_ticks.max(self.stuck.stale());
        }
        let ramp_down = if worthless_ticks > limits.stale_ticks_max {
            OffCause::Stale
        } else if link == LinkState::Sound {
            OffCause::None
        } else {
            OffCause::Protocol
        };
        SampleCheck { faults, ramp_down }
    }
}

fn is_sound(sample: &DeviceSample) -> bool {
    let norm_error = sample.pose.rotation.length_squared() - 1.0;
    // Written so that a NaN is refused as well.
    sample.pose.is_finite()
        && sample.twist.is_finite()
        && sample.grip_rad.is_finite()
        && norm_error.abs() <= NORM_TOLERANCE
}

fn is_jump(
    previous: Pose,
    pose: Pose,
    n_ticks: f64,
    limits: &LimitParameters,
    period_s: f64,
) -> bool {
    let moved_m = (pose.translation - previous.translation).length();
    let allowed_m = n_ticks * (JUMP_SPEEDS * limits.speed_m_per_s * period_s).max(JUMP_FLOOR_M);
    // cos of half the turn; q and −q are the same rotation. Normalised, as each of them may be off
    // by the tolerance.
    let norms = (previous.rotation.length_squared() * pose.rotation.length_squared()).sqrt();
    let half_turn_cos = previous.rotation.dot(pose.rotation).abs() / norms;
    let allowed_half_turn_rad = (0.5 * n_ticks * MOST_TURN_RAD).min(core::f64::consts::FRAC_PI_2);
    moved_m > allowed_m || half_turn_cos < allowed_half_turn_rad.cos()
}

#[cfg(test)]
#[expect(clippy::disallowed_macros, reason = "test code")]
mod tests {
    use glam::{DQuat, DVec3};
    use proptest::prelude::*;

    use super::*;
    use crate::testing::parameters;
    use vps::spatial::Twist;

    const PERIOD_S: f64 = 1e-3;

    fn limits() -> LimitParameters {
        parameters().limits
    }

    fn fresh(x_m: f64) -> DeviceSample {
        DeviceSample {
            pose: Pose::from_translation(DVec3::X * x_m),
            status: SampleStatus::Fresh,
            ..DeviceSample::default()
        }
    }

    fn safety() -> SafetyParameters {
        SafetyParameters {
            stuck_move_m: 1.2e-4,
            stuck_turn_rad: 0.018,
            ..SafetyParameters::default()
        }
    }

    fn check(monitor: &mut SampleMonitor, sample: &DeviceSample) -> SampleCheck {
        monitor.check(sample, &limits(), &safety(), PERIOD_S)
    }

    fn faults_of(sample: &DeviceSample) -> Faults {
        let mut monitor = SampleMonitor::default();
        check(&mut monitor, &fresh(0.0));
        check(&mut monitor, sample).faults
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
            assert_eq!(check(&mut monitor, &sample), SampleCheck::default());
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
        let turned = |angle_rad| DeviceSample {
            pose: Pose::new(DQuat::from_rotation_y(angle_rad), DVec3::ZERO),
            ..fresh(0.0)
        };
        assert_eq!(faults_of(&turned(0.49)), Faults::NONE);
        assert_eq!(faults_of(&turned(0.51)), Faults::POSITION_JUMP);
        assert_eq!(faults_of(&turned(core::f64::consts::PI)), Faults::POSITION_JUMP);
        // The first sample has nothing to jump from, and after a jump the new place is the
        // reference.
        let mut monitor = SampleMonitor::default();
        assert_eq!(check(&mut monitor, &fresh(3.0)).faults, Faults::NONE);
        assert_eq!(check(&mut monitor, &fresh(0.0)).faults, Faults::POSITION_JUMP);
        assert_eq!(check(&mut monitor, &fresh(0.0)).faults, Faults::NONE);
    }

    #[test]
    fn a_gap_of_stale_ticks_allows_the_way_that_the_arm_went_meanwhile() {
        let mut monitor = SampleMonitor::default();
        check(&mut monitor, &fresh(0.0));
        for _ in 0..2 {
            check(&mut monitor, &DeviceSample { status: SampleStatus::Stale, ..fresh(0.0) });
        }
        assert_eq!(check(&mut monitor, &fresh(14.9e-3)).faults, Faults::NONE);
        assert_eq!(check(&mut monitor, &fresh(0.0)).faults, Faults::POSITION_JUMP);
    }

    #[test]
    fn stale_samples_ramp_down_then_fault_and_a_fresh_one_recovers() {
        let mut monitor = SampleMonitor::default();
        check(&mut monitor, &fresh(0.0));
        let stale = DeviceSample { status: SampleStatus::Stale, ..fresh(0.0) };
        for tick_idx in 1..=25 {
            let check = check(&mut monitor, &stale);
            assert_eq!(
                check.ramp_down,
                if tick_idx > 3 { OffCause::Stale } else { OffCause::None }
            );
            assert_eq!(check.faults, if tick_idx > 20 { Faults::STALE } else { Faults::NONE });
        }
        assert_eq!(check(&mut monitor, &fresh(0.0)), SampleCheck::default());
    }

    #[test]
    fn a_lost_device_faults_at_once_whatever_its_values_are() {
        let mut lost = fresh(f64::NAN);
        lost.status = SampleStatus::Lost;
        let check = check(&mut SampleMonitor::default(), &lost);
        assert_eq!((check.faults, check.ramp_down), (Faults::DEVICE_LOST, OffCause::Disconnected));
        lost.status = SampleStatus::LinkLost;
        let check = SampleMonitor::default().check(&lost, &limits(), &safety(), PERIOD_S);
        assert_eq!((check.faults, check.ramp_down), (Faults::LINK, OffCause::Link));
    }

    #[test]
    fn ticks_without_an_arm_count_as_those_without_a_fresh_sample_do() {
        let mut monitor = SampleMonitor::default();
        check(&mut monitor, &fresh(0.0));
        for (status, stale_ticks) in [
            (SampleStatus::Stale, 1),
            (SampleStatus::Lost, 2),
            (SampleStatus::LinkLost, 3),
            (SampleStatus::Stale, 4),
        ] {
            check(&mut monitor, &DeviceSample { status, ..fresh(0.0) });
            assert_eq!(monitor.stale_ticks, stale_ticks);
        }
    }

    #[test]
    fn samples_that_the_arm_counts_as_lost_are_stale_ticks_and_many_are_a_fault() {
        for (lost_packets, ramp_down, faults) in [
            (3, OffCause::None, Faults::NONE),
            (4, OffCause::Stale, Faults::NONE),
            (19, OffCause::Stale, Faults::NONE),
            (20, OffCause::Stale, Faults::SEQUENCE_GAP),
            (u16::MAX, OffCause::Stale, Faults::SEQUENCE_GAP),
        ] {
            let mut monitor = SampleMonitor::default();
            check(&mut monitor, &fresh(0.0));
            // Over a gap of n samples an arm may go n + 1 times as far.
            let x_m = 4.9e-3 * (f64::from(lost_packets) + 1.0);
            let found = check(&mut monitor, &DeviceSample { lost_packets, ..fresh(x_m) });
            assert_eq!(found, SampleCheck { faults, ramp_down });
            assert_eq!(check(&mut monitor, &fresh(x_m)), SampleCheck::default());
            // A late sample repeats what was said before.
            let late = DeviceSample { lost_packets, status: SampleStatus::Stale, ..fresh(x_m) };
            assert_eq!(check(&mut monitor, &late), SampleCheck::default());
        }
    }

    #[test]
    fn garbled_packets_ramp_down_then_fault_whether_or_not_a_sample_came_through() {
        for status in [SampleStatus::Fresh, SampleStatus::Stale] {
            let mut monitor = SampleMonitor::default();
            for n in 1..=11 {
                let found =
                    check(&mut monitor, &DeviceSample { corrupt_packets: 1, status, ..fresh(0.0) });
                assert_eq!(found.faults.contains(Faults::PROTOCOL), n == 11, "{n}");
                assert_eq!(found.ramp_down != OffCause::None, n > 5, "{n}");
                check(&mut monitor, &fresh(0.0));
            }
        }
    }

    #[test]
    fn an_error_of_the_arm_is_a_fault_as_long_as_it_lasts() {
        for status in [SampleStatus::Fresh, SampleStatus::Stale] {
            let sample = DeviceSample { device_error: 3, status, ..fresh(0.0) };
            assert_eq!(faults_of(&sample), Faults::DEVICE_ERROR, "{status:?}");
        }
    }

    #[test]
    fn a_pose_that_freezes_out_of_a_motion_is_stale_from_its_first_repeat_then_stuck() {
        let mut monitor = SampleMonitor::default();
        for n in 0..=5 {
            assert_eq!(check(&mut monitor, &fresh(2e-4 * f64::from(n))), SampleCheck::default());
        }
        for repeat in 1..=30 {
            let found = check(&mut monitor, &fresh(1e-3));
            assert_eq!(found.ramp_down, if repeat < 5 { OffCause::None } else { OffCause::Stale });
            assert_eq!(found.faults, if repeat > 20 { Faults::STUCK } else { Faults::NONE });
        }
        assert_eq!(check(&mut monitor, &fresh(1.04e-3)), SampleCheck::default());
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

    #[test]
    fn a_jump_is_further_than_five_times_the_speed_or_half_a_radian_per_tick() {
        let turned = |rad: f64| Pose::new(DQuat::from_rotation_y(rad), DVec3::ZERO);
        let moved = |m: f64| Pose::from_translation(DVec3::Z * m);
        let fast = LimitParameters { speed_m_per_s: 3.0, ..limits() };
        let slow = LimitParameters { speed_m_per_s: 0.2, ..limits() };
        for (limits, allowed_m) in [(fast, 15e-3), (slow, 5e-3)] {
            for n_ticks in [1.0, 2.0, 3.0] {
                let jumps = |pose| is_jump(Pose::IDENTITY, pose, n_ticks, &limits, 1e-3);
                assert!(!jumps(moved(n_ticks * allowed_m * 0.999)));
                assert!(jumps(moved(n_ticks * allowed_m * 1.001)));
                assert!(!jumps(turned(n_ticks * 0.499)) && jumps(turned(n_ticks * 0.501)));
            }
            // Half a turn is never more than a turn can be.
            let half_turn = turned(0.999 * core::f64::consts::PI);
            assert!(!is_jump(Pose::IDENTITY, half_turn, 9.0, &limits, 1e-3));
        }
    }

    #[test]
    fn a_turn_is_judged_whatever_the_length_of_the_quaternions() {
        let turned = |rad: f64| {
            let rotation = DQuat::from_rotation_y(rad) * 1.0004;
            Pose::new(rotation, DVec3::ZERO)
        };
        let jumps = |rad: f64| is_jump(turned(0.0), turned(rad), 1.0, &limits(), 1e-3);
        assert!(!jumps(0.4999) && jumps(0.5001));
    }

    #[test]
    fn a_turn_of_more_than_half_a_radian_per_tick_is_too_fast() {
        for (rad_per_s, faults) in [(499.0, Faults::NONE), (501.0, Faults::SPEED)] {
            let mut sample = fresh(0.0);
            sample.twist.angular = DVec3::new(0.6, 0.0, -0.8) * rad_per_s;
            assert_eq!(faults_of(&sample), faults, "{rad_per_s}");
        }
    }
}
