//! Output stage: the last thing between the renderer and the arm, steps 10 to 13 of the
//! [tick](crate::tick).
//!
//! Data in: the wrench that coupling and passivity want on the hand. Data out: a wrench that an arm
//! may be given. Force and torque have limits of their own and keep their directions.
//!
//! Slew before magnitude is safe: both outputs lie in the ball of the magnitude limit, and scaling
//! a vector back into a ball never moves it further from a point inside, so the clamp cannot turn
//! an allowed step into a larger one.
//!
//! A slew limit shapes rises and delays no fall. Let c be the largest force that the earlier rules
//! ask for from some tick on, and F the command: √(F² − c²) falls by the limit · T/10 ms in every
//! tick, or faster. So 10 ms later no more than c is left, whatever the slew limit is and however
//! the direction changes meanwhile; with c = 0 the command itself falls at that rate.

use glam::DVec3;

use super::LimitParameters;
use vps::spatial::{Twist, Wrench};

/// What the output stage makes of one wrench.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Limited {
    /// The wrench on the hand, within all limits; zero when anything was not finite.
    pub(super) wrench: Wrench,
    /// False when the wanted wrench or the twist was not finite: the tick faults with `NON_FINITE`.
    pub(super) finite: bool,
}

/// Power, slew and magnitude limits with the last output as state.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Limiter {
    /// The last output.
    pub(super) last: Wrench,
}

impl Limiter {
    /// One tick. `wanted` is the wrench on the hand, `twist` the motion of the same point in the
    /// same frame.
    ///
    /// - Power: with W·V > P (the wrench drives the hand along its own motion) force and torque are
    ///   scaled by P/(W·V).
    /// - Slew: the output moves straight towards the wanted force by R T per tick. Where R is less
    ///   than the limit within [`FALL_S`](LimitParameters::FALL_S), what is not wanted any more goes
    ///   at that rate all the same. It comes after the power limit and wins over it: a drop of the
    ///   force is a step in the hand like any other.
    /// - Magnitude: |F| and |τ| are scaled back to their limits. A limit lowered below the last
    ///   output acts at once, before slew.
    /// - Finite: anything else gives zero, and the state starts again from zero.
    ///
    /// A zero wrench out of a zero state stays zero bit for bit. RT: safe, O(1).
    pub(super) fn apply(
        &mut self,
        wanted: Wrench,
        twist: Twist,
        limits: &LimitParameters,
        period_s: f64,
    ) -> Limited {
        let powered = wanted * power_scale(wanted.power(twist), limits.power_w);
        let slewed = Wrench {
            force: slewed(
                self.last.force,
                powered.force,
                limits.slew_n_per_s * period_s,
                limits.force_n / LimitParameters::FALL_S * period_s,
            ),
            torque: slewed(
                self.last.torque,
                powered.torque,
                limits.slew_nm_per_s * period_s,
                limits.torque_nm / LimitParameters::FALL_S * period_s,
            ),
        };
        let bounded = Wrench {
            force: shortened(slewed.force, limits.force_n),
            torque: shortened(slewed.torque, limits.torque_nm),
        };

        // The input is judged as well as the result: a limit of zero or a huge slew step would hide
        // a NaN or an infinity.
        let finite = wanted.is_finite() && twist.is_finite() && bounded.is_finite();
        // A sum with +0 turns −0 into +0, so that "zero" has one bit pattern.
        self.last = if finite { bounded + Wrench::ZERO } else { Wrench::ZERO };
        Limited { wrench: self.last, finite }
    }

    /// Zero from now on, without slew: for a fault, and when the drive is disabled.
    pub(super) fn reset(&mut self) {
        *self = Self::default();
    }
}

/// Gain of the output between 0 and 1, linear in time: rises after enable, falls on a stop request
/// and while samples are stale.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Ramp {
    pub(super) gain: f64,
}

impl Ramp {
    /// One tick towards 1 (`up`) or towards 0. A full rise or fall takes `ramp_s`; at once when
    /// that is not positive.
    ///
    /// RT: safe.
    pub(super) fn advance(&mut self, up: bool, ramp_s: f64, period_s: f64) -> f64 {
        let step = if ramp_s > 0.0 { period_s / ramp_s } else { 1.0 };
        let gain = if up { self.gain + step } else { self.gain - step };
        // The ends are met exactly, however the steps were rounded: a hundred steps of 0.01 make
        // 1.0000000000000007.
        self.gain = if gain >= 1.0 - 1e-9 {
            1.0
        } else if gain > 1e-9 {
            gain
        } else {
            0.0
        };
        self.gain
    }

    /// Down to 0 at once: for a fault.
    pub(super) fn reset(&mut self) {
        *self = Self::default();
    }
}

/// Factor in 0..=1 that brings the power to its limit; 0 for a power that is not a number.
fn power_scale(power_w: f64, limit_w: f64) -> f64 {
    // `max` drops the NaN; a negative limit takes all of the force.
    if power_w <= limit_w { 1.0 } else { (limit_w / power_w).max(0.0) }
}

/// `last` moved straight towards `wanted` by `step`. Where that is less than `fall`, the rest of it
/// takes away what is not wanted any more: it moves the result towards the nearest part of `wanted`,
/// which is a share of it from 0 to 1.
fn slewed(last: DVec3, wanted: DVec3, step: f64, fall: f64) -> DVec3 {
    let stepped = stepped_towards(last, wanted, step);
    if fall > step {
        stepped_towards(stepped, nearest_part(stepped, wanted), fall - step)
    } else {
        stepped
    }
}

/// The point nearest to `vector` between zero and `whole`.
fn nearest_part(vector: DVec3, whole: DVec3) -> DVec3 {
    let share = vector.dot(whole) / whole.length_squared();
    // A NaN, of a `whole` without length, is no share.
    if share > 0.0 { whole * share.min(1.0) } else { DVec3::ZERO }
}

/// `from` moved straight towards `to` by at most `step`; `to` itself, bit for bit, when that is
/// enough.
fn stepped_towards(from: DVec3, to: DVec3, step: f64) -> DVec3 {
    let change = to - from;
    let length = change.length();
    if length <= step { to } else { from + change * (step / length).max(0.0) }
}

/// `vector` scaled back to at most `limit`, direction kept.
fn shortened(vector: DVec3, limit: f64) -> DVec3 {
    let length = vector.length();
    if length <= limit { vector } else { vector * (limit / length).max(0.0) }
}

#[cfg(test)]
#[expect(clippy::disallowed_macros, reason = "test code")]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::testing::parameters;

    const PERIOD_S: f64 = 1e-3;
    const RATES_HZ: &[f64] = &[100.0, 1000.0, 10_000.0];

    /// 10 N and 0.2 N·m, a hundred times as much a second, 5 W.
    fn typical() -> LimitParameters {
        parameters().limits
    }

    fn bits(wrench: Wrench) -> [u64; 6] {
        let ([a, b, c], [d, e, f]) = (wrench.force.to_array(), wrench.torque.to_array());
        [a, b, c, d, e, f].map(f64::to_bits)
    }

    fn wrench(range: f64) -> impl Strategy<Value = Wrench> {
        prop::array::uniform6(-range..range).prop_map(|[a, b, c, d, e, f]| {
            Wrench::new(DVec3::new(a, b, c), DVec3::new(d, e, f) * 0.02)
        })
    }

    fn twist() -> impl Strategy<Value = Twist> {
        wrench(2.0).prop_map(|w| Twist { linear: w.force, angular: w.torque * 100.0 })
    }

    /// Any bit pattern, with the awkward ones often.
    fn any_number() -> impl Strategy<Value = f64> {
        prop_oneof![
            any::<f64>(),
            any::<u64>().prop_map(f64::from_bits),
            prop::sample::select(
                &[
                    0.0,
                    -0.0,
                    f64::NAN,
                    f64::INFINITY,
                    f64::NEG_INFINITY,
                    f64::MAX,
                    f64::MIN_POSITIVE,
                    5e-324,
                    1.0
                ][..]
            ),
        ]
    }

    fn any_wrench() -> impl Strategy<Value = Wrench> {
        let six =
            (any_number(), any_number(), any_number(), any_number(), any_number(), any_number());
        six.prop_map(|(a, b, c, d, e, f)| Wrench::new(DVec3::new(a, b, c), DVec3::new(d, e, f)))
    }

    proptest! {
        #[test]
        fn magnitude_and_slew_hold_on_every_tick(steps in prop::collection::vec((wrench(50.0), twist()), 1..80)) {
            let limits = typical();
            let mut limiter = Limiter::default();
            let mut before = Wrench::ZERO;
            for (wanted, twist) in steps {
                let limited = limiter.apply(wanted, twist, &limits, PERIOD_S);
                prop_assert!(limited.finite);
                let now = limited.wrench;
                prop_assert!(now.force.length() <= limits.force_n * (1.0 + 1e-14));
                prop_assert!(now.torque.length() <= limits.torque_nm * (1.0 + 1e-14));
                prop_assert!((now.force - before.force).length() <= limits.slew_n_per_s * PERIOD_S * (1.0 + 1e-12));
                prop_assert!((now.torque - before.torque).length() <= limits.slew_nm_per_s * PERIOD_S * (1.0 + 1e-12));
                before = now;
            }
        }

        #[test]
        fn the_magnitude_limit_keeps_direction_and_force_and_torque_apart(wanted in wrench(50.0)) {
            let limits = LimitParameters { force_n: 3.0, torque_nm: 0.1, ..LimitParameters::NONE };
            let limited = Limiter::default().apply(wanted, Twist::ZERO, &limits, PERIOD_S).wrench;
            for (now, raw, limit) in [(limited.force, wanted.force, 3.0), (limited.torque, wanted.torque, 0.1)] {
                if raw.length() <= limit {
                    prop_assert_eq!(now, raw);
                } else {
                    prop_assert!((now.length() - limit).abs() <= 1e-14 * limit);
                    prop_assert!((now.normalize() - raw.normalize()).length() < 1e-14);
                }
            }
        }

        #[test]
        fn the_power_limit_scales_the_whole_wrench_and_leaves_resisting_wrenches_alone(wanted in wrench(50.0), twist in twist(), power_w in 0.0_f64..10.0) {
            let limits = LimitParameters { power_w, ..LimitParameters::NONE };
            let limited = Limiter::default().apply(wanted, twist, &limits, PERIOD_S).wrench;
            let wanted_w = wanted.power(twist);
            if wanted_w <= power_w {
                prop_assert_eq!(limited, wanted);
            } else {
                prop_assert!((limited.power(twist) - power_w).abs() <= 1e-12 * wanted_w);
                prop_assert!((limited - wanted * (power_w / wanted_w)).force.length() <= 1e-12 * wanted.force.length());
                prop_assert!((limited - wanted * (power_w / wanted_w)).torque.length() <= 1e-12 * wanted.torque.length());
            }
        }

        /// Whatever the slew limit is and whatever is wanted of at most c: √(F² − c²) falls by the
        /// limit · T/10 ms, no step is larger than that or the slew, no rise larger than the slew.
        /// And no more work than that of an even fall in 10 ms is done on a hand that goes along.
        #[test]
        fn no_slew_limit_delays_a_fall(
            start in wrench(1.0),
            share in -9.0_f64..2.0,
            most in 0.0_f64..1.0,
            turns in prop::collection::vec((wrench(1.0), 0.0_f64..=1.0), 1..30),
            rate_hz in prop::sample::select(RATES_HZ),
        ) {
            let period_s: f64 = 1.0 / rate_hz;
            let share = 10.0_f64.powf(share);
            let typical = typical();
            let limits = LimitParameters {
                slew_n_per_s: share * typical.force_n / 0.01,
                slew_nm_per_s: share * typical.torque_nm / 0.01,
                ..typical
            };
            let parts = |wrench: Wrench| [(wrench.force, 10.0), (wrench.torque, 0.2)];
            let sized = |wrench: Wrench, share: f64| {
                let [force, torque] = parts(wrench).map(|(part, limit)| {
                    part.normalize_or_zero() * (limit * share)
                });
                Wrench::new(force, torque)
            };
            let mut limiter = Limiter { last: sized(start, 1.0) };
            let n_ticks = f64::ceil(0.01 * rate_hz) as usize;
            for (turn, of_most) in turns.iter().cycle().take(n_ticks.max(turns.len())) {
                let before = limiter.last;
                let wanted = sized(*turn, most * of_most);
                let now = limiter.apply(wanted, Twist::ZERO, &limits, period_s).wrench;
                for ((before, limit), (now, _)) in parts(before).into_iter().zip(parts(now)) {
                    let c = most * limit;
                    let fall = limit / 0.01 * period_s;
                    let beyond = |part: DVec3| (part.length_squared() - c * c).max(0.0).sqrt();
                    // The root of what rounding leaves.
                    prop_assert!(beyond(now) <= (beyond(before) - fall).max(0.0) + 1e-7 * limit);
                    prop_assert!(now.length() <= before.length() + share * fall + 1e-12 * limit);
                    prop_assert!((now - before).length() <= fall.max(share * fall) + 1e-12 * limit);
                }
            }
            for (part, limit) in parts(limiter.last) {
                prop_assert!(part.length() <= (most + 1e-6) * limit);
            }

            // From here on nothing is wanted.
            let [(force, force_n), _] = parts(limiter.last);
            let along = Twist { linear: force.normalize_or_zero() * 0.2, angular: DVec3::ZERO };
            let most_j = 0.5 * force.length_squared() / force_n * 0.01 * 0.2;
            let mut given_j = 0.0;
            for _ in 0..n_ticks {
                let limited = limiter.apply(Wrench::ZERO, along, &limits, period_s);
                given_j += limited.wrench.power(along) * period_s;
            }
            prop_assert!(given_j <= most_j * (1.0 + 1e-9) + 1e-15, "{given_j} of {most_j} J");
            // One tick of grace for the rounding of n equal steps.
            limiter.apply(Wrench::ZERO, along, &limits, period_s);
            prop_assert_eq!(bits(limiter.last), [0; 6]);
        }

        /// What is wanted no more in another direction goes too: within 20 ms only a share of what
        /// is wanted is left.
        #[test]
        fn an_old_direction_is_gone_within_twice_the_fall(
            start in wrench(1.0),
            wanted in wrench(10.0),
            share in -9.0_f64..0.0,
        ) {
            let share = 10.0_f64.powf(share);
            let slew_n_per_s = share * 1000.0;
            let limits = LimitParameters { slew_n_per_s, ..typical() };
            let wanted = Wrench::new(wanted.force.clamp_length_max(10.0), DVec3::ZERO);
            let start = Wrench::new(start.force.normalize_or_zero() * 10.0, DVec3::ZERO);
            let mut limiter = Limiter { last: start };
            for _ in 0..21 {
                limiter.apply(wanted, Twist::ZERO, &limits, PERIOD_S);
            }
            let force = limiter.last.force;
            let share = force.dot(wanted.force) / wanted.force.length_squared();
            prop_assert!((0.0..=1.0 + 1e-9).contains(&share), "{share}");
            prop_assert!((force - wanted.force * share).length() < 1e-6, "{force}");
        }

        /// With the slew limit that scenes have by default the command goes straight to what is
        /// wanted, as it did in version 0.1.0, bit for bit.
        #[test]
        fn the_default_slew_moves_straight(
            force_n in 0.01_f64..100.0,
            wanted in prop::collection::vec(wrench(100.0), 1..40),
        ) {
            let slew_n_per_s = force_n / 0.01;
            let limits = LimitParameters { force_n, slew_n_per_s, ..LimitParameters::NONE };
            let mut limiter = Limiter::default();
            let mut straight = DVec3::ZERO;
            for wanted in wanted {
                let change = wanted.force - straight;
                let step = slew_n_per_s * PERIOD_S;
                let length = change.length();
                straight =
                    if length <= step { wanted.force } else { straight + change * (step / length) };
                let length = straight.length();
                if length > force_n {
                    straight *= force_n / length;
                }
                let now = limiter.apply(wanted, Twist::ZERO, &limits, PERIOD_S).wrench.force;
                prop_assert_eq!(now.to_array().map(f64::to_bits), straight.to_array().map(f64::to_bits));
            }
        }

        #[test]
        fn no_input_brings_out_anything_that_is_not_finite_or_beyond_the_limits(
            inputs in prop::collection::vec((any_wrench(), any_wrench()), 1..20),
        ) {
            let limits = typical();
            let mut limiter = Limiter::default();
            for (wanted, motion) in inputs {
                let twist = Twist { linear: motion.force, angular: motion.torque };
                let limited = limiter.apply(wanted, twist, &limits, PERIOD_S);
                prop_assert!(limited.wrench.is_finite());
                prop_assert!(limited.wrench.force.length() <= limits.force_n * (1.0 + 1e-14));
                prop_assert!(limited.wrench.torque.length() <= limits.torque_nm * (1.0 + 1e-14));
                if !(wanted.is_finite() && twist.is_finite()) {
                    prop_assert!(!limited.finite);
                    prop_assert_eq!(limiter, Limiter::default());
                }
                if !limited.finite {
                    prop_assert_eq!(bits(limited.wrench), [0; 6]);
                }
            }
        }

        #[test]
        fn zero_stays_zero_bit_for_bit(twist in twist(), negative in any::<bool>()) {
            let zero = if negative { -Wrench::ZERO } else { Wrench::ZERO };
            let limited = Limiter::default().apply(zero, twist, &typical(), PERIOD_S);
            prop_assert!(limited.finite);
            prop_assert_eq!(bits(limited.wrench), [0; 6]);
        }
    }

    #[test]
    fn a_lowered_limit_acts_at_once() {
        let mut limiter = Limiter { last: Wrench::new(DVec3::X * 10.0, DVec3::ZERO) };
        let limits = LimitParameters { force_n: 0.5, ..typical() };
        let limited = limiter.apply(limiter.last, Twist::ZERO, &limits, PERIOD_S).wrench;
        assert!((limited.force.x - 0.5).abs() < 1e-15);
    }

    #[test]
    fn the_ramp_is_linear_and_meets_its_ends_exactly() {
        let mut ramp = Ramp::default();
        for tick_idx in 1..=100 {
            let gain = ramp.advance(true, 0.1, PERIOD_S);
            assert!((gain - f64::from(tick_idx) / 100.0).abs() < 1e-9);
        }
        assert_eq!(ramp.gain, 1.0);
        assert_eq!(ramp.advance(true, 0.1, PERIOD_S), 1.0);
        for _ in 0..50 {
            ramp.advance(false, 0.1, PERIOD_S);
        }
        assert!((ramp.gain - 0.5).abs() < 1e-9);
        for _ in 0..50 {
            ramp.advance(false, 0.1, PERIOD_S);
        }
        assert_eq!(ramp.gain.to_bits(), 0);
        assert_eq!(ramp.advance(true, 0.0, PERIOD_S), 1.0);
        assert_eq!(ramp.advance(false, f64::NAN, PERIOD_S), 0.0);
        ramp.advance(true, 0.1, f64::NAN);
        assert_eq!(ramp.gain, 0.0);
    }
}
