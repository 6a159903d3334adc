//! Samples that repeat one pose although the arm was moving: encoders that hang while the counter
//! runs on.
//!
//! A hand that rests repeats a pose as well, and so does an arm that is slower than a step of its
//! encoder per tick. What neither does is to stand still from one tick to the next: that takes more
//! than an arm and a hand can do. So a pose that repeats is suspicious only when each of the three
//! intervals before it showed a move of at least [`least_move_m`] along one axis, or a turn of at
//! least [`least_turn_rad`].
//!
//! With T the tick, e the encoder's step and a the strongest deceleration: a move measured as d was
//! truly d − e or more, so at its end the speed was (d − e)/T − a T/2 or more, and from there it
//! takes v²/(2a) to stand still. The pose can repeat only when that is less than e:
//!
//! ```text
//! d > e + a T²/2 + T √(2 a e)
//! ```
//!
//! is never followed by a natural stop within one step of the encoder. What is no natural stop is a
//! blow against a hard end of the arm's travel, held there for 20 ms.
//!
//! Not seen: one encoder of several that hangs (the pose still changes), and anything below that
//! speed.

use vps::spatial::Pose;

/// Repeats before they count: a report that comes late is repeated by some arms.
const REPEATS_MIN: u32 = 5;

/// Intervals that must have shown the motion: one alone may be a jump, or a late report after a
/// gap.
const MOVING_TICKS: u32 = 3;

/// Strongest deceleration of an arm in a hand, m/s²: more than twice the motors' of any shipped
/// profile with the lightest hand.
const STRONGEST_M_PER_S2: f64 = 100.0;
/// The same of a turn, rad/s²: a wrist that stops 25 rad/s within a hundredth of a second.
const STRONGEST_RAD_PER_S2: f64 = 2500.0;
/// Slowest motion that is worth to be suspicious of, and the number of encoder steps per tick.
const SLOWEST_M_PER_S: f64 = 0.1;
const SLOWEST_RAD_PER_S: f64 = 1.0;
const LEAST_STEPS: f64 = 3.0;

/// Smallest move per tick out of which a pose that repeats is suspicious, m; of an arm with this
/// encoder.
pub fn least_move_m(step_m: f64, period_s: f64) -> f64 {
    least(step_m, period_s, SLOWEST_M_PER_S, STRONGEST_M_PER_S2)
}

/// The same for a turn, rad.
pub fn least_turn_rad(step_rad: f64, period_s: f64) -> f64 {
    least(step_rad, period_s, SLOWEST_RAD_PER_S, STRONGEST_RAD_PER_S2)
}

fn least(step: f64, period_s: f64, slowest: f64, strongest: f64) -> f64 {
    let unnatural =
        step + 0.5 * strongest * period_s * period_s + period_s * (2.0 * strongest * step).sqrt();
    (slowest * period_s).max(LEAST_STEPS * step).max(unnatural)
}

/// Watches one arm's poses.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct StuckWatch {
    moving_ticks: u32,
    /// Ticks with the pose of `previous`, since it stood still out of a motion.
    repeats: u32,
    is_suspicious: bool,
}

impl StuckWatch {
    /// Takes a fresh pose, `n_ticks` after `previous`; returns for how many ticks the samples have
    /// been worthless, 0 for sound ones. They count from the first repeat once there are five. RT:
    /// safe, total.
    pub(super) fn fresh(
        &mut self,
        previous: Pose,
        pose: Pose,
        n_ticks: f64,
        move_m: f64,
        turn_rad: f64,
    ) -> u32 {
        if bits(previous) == bits(pose) {
            if self.repeats == 0 {
                self.is_suspicious = self.moving_ticks >= MOVING_TICKS;
            }
            self.repeats = self.repeats.saturating_add(1);
            self.moving_ticks = 0;
        } else {
            let moved_m = (pose.translation - previous.translation).abs().max_element();
            let turned_rad = previous.rotation_to(pose).abs().max_element();
            let moves = moved_m >= n_ticks * move_m || turned_rad >= n_ticks * turn_rad;
            self.moving_ticks = if moves { self.moving_ticks.saturating_add(1) } else { 0 };
            (self.repeats, self.is_suspicious) = (0, false);
        }
        self.worthless_ticks()
    }

    /// Takes note of a tick without a fresh sample.
    pub(super) fn stale(&mut self) -> u32 {
        if self.repeats > 0 {
            self.repeats = self.repeats.saturating_add(1);
        }
        self.worthless_ticks()
    }

    fn worthless_ticks(&self) -> u32 {
        if self.is_suspicious && self.repeats >= REPEATS_MIN { self.repeats } else { 0 }
    }
}

fn bits(pose: Pose) -> [u64; 7] {
    let ([x, y, z], [qx, qy, qz, qw]) = (pose.translation.to_array(), pose.rotation.to_array());
    [x, y, z, qx, qy, qz, qw].map(f64::to_bits)
}

#[cfg(test)]
#[expect(clippy::disallowed_macros, reason = "test code")]
mod tests {
    use glam::{DQuat, DVec3};
    use proptest::prelude::*;

    use super::*;

    const T: f64 = 1e-3;

    /// As the configuration makes them.
    fn thresholds(step_m: f64, step_rad: f64, period_s: f64) -> (f64, f64) {
        (least_move_m(step_m, period_s), least_turn_rad(step_rad, period_s))
    }

    fn worst(poses: impl IntoIterator<Item = Pose>, (move_m, turn_rad): (f64, f64)) -> u32 {
        let mut watch = StuckWatch::default();
        let mut previous = None;
        let mut worst = 0;
        for pose in poses {
            if let Some(previous) = previous.replace(pose) {
                worst = worst.max(watch.fresh(previous, pose, 1.0, move_m, turn_rad));
            }
        }
        worst
    }

    fn at(x_m: f64) -> Pose {
        Pose::from_translation(DVec3::X * x_m)
    }

    /// Takes a fresh pose a tick after another, of an arm with steps of 0.04 mm and 6 mrad.
    fn sees(watch: &mut StuckWatch, previous: Pose, pose: Pose) -> u32 {
        let (move_m, turn_rad) = thresholds(4e-5, 6e-3, T);
        watch.fresh(previous, pose, 1.0, move_m, turn_rad)
    }

    #[test]
    fn a_frozen_encoder_counts_from_its_first_repeat_once_there_are_five() {
        let mut watch = StuckWatch::default();
        for n in (0..10).map(f64::from) {
            assert_eq!(sees(&mut watch, at(2e-4 * n), at(2e-4 * (n + 1.0))), 0);
        }
        let frozen = at(2e-3);
        let counts = [(); 8].map(|()| sees(&mut watch, frozen, frozen));
        assert_eq!(counts, [0, 0, 0, 0, 5, 6, 7, 8]);
        assert_eq!(watch.stale(), 9);
        assert_eq!(sees(&mut watch, frozen, at(2.04e-3)), 0);
        assert_eq!(watch.stale(), 0);
        let turned = |n: u32| Pose::new(DQuat::from_rotation_y(0.02 * f64::from(n)), DVec3::ZERO);
        assert_eq!(worst((0..10).chain([9; 20]).map(turned), thresholds(4e-5, 6e-3, T)), 20);
    }

    #[test]
    fn a_tick_without_a_sample_between_motion_and_repeats_changes_nothing() {
        let mut watch = StuckWatch::default();
        for [from_m, to_m] in [[0.0, 2e-4], [2e-4, 4e-4], [4e-4, 6e-4]] {
            assert_eq!(sees(&mut watch, at(from_m), at(to_m)), 0);
        }
        assert_eq!(watch.stale(), 0);
        let frozen = at(6e-4);
        let counts = [(); 6].map(|()| sees(&mut watch, frozen, frozen));
        assert_eq!(counts, [0, 0, 0, 0, 5, 6]);
    }

    #[test]
    fn rest_teleports_and_slow_motion_are_not_suspicious() {
        let thresholds = thresholds(4e-5, 6e-3, T);
        assert_eq!(worst([at(1.0); 1000], thresholds), 0);
        // A single leap, as of a test that puts the arm somewhere.
        assert_eq!(worst([at(0.0), at(4e-3)].into_iter().chain([at(4e-3); 100]), thresholds), 0);
        // 0.1 m/s is below three steps of 0.04 mm per tick.
        assert_eq!(
            worst((0..50).map(|n| at(1e-4 * f64::from(n))).chain([at(4.9e-3); 100]), thresholds),
            0
        );
        // Reports at half the rate repeat each pose once.
        assert_eq!(worst((0..200).map(|n| at(4e-4 * f64::from(n / 2))), thresholds), 0);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2000))]

        /// Along any direction, from any speed, with any deceleration that a motor and a hand can
        /// bring about, at any step of the encoder.
        #[test]
        fn an_arm_that_slows_down_to_rest_is_never_stuck(
            direction in prop::array::uniform3(-1.0_f64..1.0),
            offset in prop::array::uniform3(0.0_f64..1.0),
            speed in 0.0_f64..1.0,
            deceleration in 0.5_f64..95.0,
            step_um in prop::sample::select(&[0.0, 5.0, 24.0, 40.0, 100.0, 500.0][..]),
            period_s in prop::sample::select(&[2.5e-4, 1e-3, 2e-3][..]),
        ) {
            let step_m = step_um * 1e-6;
            let direction = DVec3::from_array(direction).normalize_or(DVec3::X);
            let stop_s = speed / deceleration;
            let poses = (0..400).map(|n| {
                let t = (f64::from(n) * period_s - 0.02).min(stop_s);
                let way_m = if t < 0.0 { speed * t } else { speed * t - 0.5 * deceleration * t * t };
                let true_m = direction * way_m + DVec3::from_array(offset) * step_m;
                let measured = if step_m > 0.0 { (true_m / step_m).round() * step_m } else { true_m };
                Pose::from_translation(measured)
            });
            prop_assert_eq!(worst(poses, thresholds(step_m, 6e-3, period_s)), 0);
        }

        /// The same in rotation, up to 2400 rad/s².
        #[test]
        fn a_turn_that_slows_down_to_rest_is_never_stuck(
            axis in prop::array::uniform3(-1.0_f64..1.0),
            speed in 0.0_f64..25.0,
            deceleration in 10.0_f64..2400.0,
            step_mrad in prop::sample::select(&[0.0, 0.1, 1.5, 6.0][..]),
        ) {
            let step_rad = step_mrad * 1e-3;
            let axis = DVec3::from_array(axis).normalize_or(DVec3::X);
            let stop_s = speed / deceleration;
            let poses = (0..400).map(|n| {
                let t = (f64::from(n) * T - 0.02).min(stop_s);
                let angle = if t < 0.0 { speed * t } else { speed * t - 0.5 * deceleration * t * t };
                let vector = axis * angle;
                let measured = if step_rad > 0.0 { (vector / step_rad).round() * step_rad } else { vector };
                Pose::new(DQuat::from_scaled_axis(measured), DVec3::ZERO)
            });
            prop_assert_eq!(worst(poses, thresholds(4e-5, step_rad, T)), 0);
        }

        /// A hand that trembles about a place, and rests at any time.
        #[test]
        fn a_trembling_hand_is_never_stuck(amplitude_mm in 0.0_f64..5.0, hertz in 0.5_f64..12.0, rest_from in 0_u32..400, step_um in 0.0_f64..100.0) {
            let step_m = step_um * 1e-6;
            let omega = core::f64::consts::TAU * hertz;
            let poses = (0..500_u32).map(|n| {
                // It comes to rest over a hundredth of a second.
                let fade = (1.0 - f64::from(n.saturating_sub(rest_from)) / 100.0).max(0.0);
                let x = amplitude_mm * 1e-3 * fade * fade * (omega * f64::from(n) * T).sin();
                at(if step_m > 0.0 { (x / step_m).round() * step_m } else { x })
            });
            prop_assert_eq!(worst(poses, thresholds(step_m, 6e-3, T)), 0);
        }
    }

    #[test]
    fn the_least_move_is_the_largest_of_the_three() {
        // d > e + a T²/2 + T √(2 a e), with 100 m/s²; 0.1 m/s; three steps.
        let natural = 1e-5 + 5e-5 + 1e-3 * (2.0 * 100.0 * 1e-5_f64).sqrt();
        assert!((least_move_m(1e-5, T) - natural).abs() < 1e-15 && natural > 1e-4);
        assert!((least_move_m(1e-7, T) - 1e-4).abs() < 1e-15);
        assert!((least_move_m(1e-3, T) - 3e-3).abs() < 1e-15);
        let natural = 1e-4 + 0.5 * 2500.0 * 1e-6 + 1e-3 * (2.0 * 2500.0 * 1e-4_f64).sqrt();
        assert!((least_turn_rad(1e-4, T) - natural).abs() < 1e-15 && natural > 1e-3);
    }
}
