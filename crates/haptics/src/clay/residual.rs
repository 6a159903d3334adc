//! Force extrapolation: no step of the force when an update of the clay arrives.
//!
//! The paper averages the force exponentially, E_(i+1) = α E_i + (1−α) F_i. That hides the steps
//! between updates, but the tool's own motion is felt late as well. Here only what the *update*
//! changed is averaged: at the pose of that tick the contact is looked up in the frame before and
//! in the new one, the difference goes into a residual, and the residual fades by α per tick. For a
//! tool at rest both are the same numbers; a tool that moves against clay at rest feels it without
//! any lag.
//!
//! # Units and frames
//! World axes, about the tool's centre of mass.
//!
//! # Source
//! Guo2004 (force extrapolation between updates of the simulation); the residual is ours.

use vps::spatial::Wrench;

/// Less of a residual is none, N and N·m.
const FORGOTTEN: f64 = 1e-9;
/// Of a leap so much is left when updates are smoothed as usual again.
const LEAP_IS_OVER: f64 = 1e-3;

/// What updates have changed and the hand does not feel yet.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Residual {
    left: Wrench,
    leap: Leap,
}

/// A surface that has gone elsewhere at once.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Leap {
    /// α until it is over.
    alpha: f64,
    /// Share that the hand does not feel yet.
    left: f64,
}

impl Residual {
    /// The update of this tick is no motion of the material but a leap: it fades by this α. RT:
    /// safe.
    pub(super) fn leap(&mut self, alpha: f64) {
        self.leap = Leap { alpha, left: 1.0 };
    }

    /// One tick: the wrench that is felt where the newest frame gives `now`. `before`: what the
    /// frame before gives at the same pose, in the tick in which a new one arrived. RT: safe.
    ///
    /// Without contact (`now` is exactly zero) nothing is felt and nothing remembered. The sum
    /// never pulls into the clay: as much of the residual counts as leaves no force against that of
    /// the newest frame.
    pub(super) fn felt(&mut self, before: Option<Wrench>, now: Wrench, alpha: f64) -> Wrench {
        if now == Wrench::ZERO {
            *self = Self::default();
            return now;
        }
        if let Some(before) = before {
            self.left = self.left + before - now;
        }
        let alpha = if self.leap.left > LEAP_IS_OVER { alpha.max(self.leap.alpha) } else { alpha };
        self.leap.left *= self.leap.alpha;
        self.left = self.left * alpha;
        // A pass-through returns the very bits, and no number that is none stays here.
        let is_left = self.left.force.length() > FORGOTTEN || self.left.torque.length() > FORGOTTEN;
        if !(is_left && self.left.is_finite()) {
            self.left = Wrench::ZERO;
            return now;
        }
        let along = now.force.length_squared();
        let against = -self.left.force.dot(now.force);
        let share = if against > along { along / against } else { 1.0 };
        now + self.left * share
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    fn push(force_n: f64) -> Wrench {
        Wrench::new(DVec3::Z * force_n, DVec3::X * (0.01 * force_n))
    }

    /// Acceptance test 30.
    #[test]
    fn acceptance_30_a_step_is_felt_to_nine_tenths_after_as_many_ticks_as_the_average_takes() {
        for alpha in [0.1, 0.3, 0.5335, 0.8, 0.871, 0.95] {
            let mut residual = Residual::default();
            assert_eq!(residual.felt(None, push(1.0), alpha), push(1.0));
            let n_ticks = (0.1_f64.ln() / f64::ln(alpha)).ceil() as usize;
            let mut averaged = 1.0;
            for n in 1..=n_ticks {
                let felt = residual.felt((n == 1).then(|| push(1.0)), push(3.0), alpha);
                averaged = alpha * averaged + (1.0 - alpha) * 3.0;
                assert!(
                    (felt.force.z - averaged).abs() < 1e-12,
                    "α = {alpha}, tick {n}: the paper's average is {averaged}"
                );
                assert!((felt.torque.x - 0.01 * averaged).abs() < 1e-12);
                assert_eq!(
                    felt.force.z >= 2.8 - 1e-12,
                    n == n_ticks,
                    "α = {alpha}, tick {n}: {felt:?}"
                );
            }
        }
    }

    #[test]
    fn without_smoothing_every_bit_passes_through() {
        let mut residual = Residual::default();
        let odd = push(0.1 + 0.2);
        assert_eq!(residual.felt(Some(push(7.0)), odd, 0.0), odd);
        assert_eq!(residual, Residual::default());
    }

    #[test]
    fn free_space_is_zero_at_once_and_forgets() {
        let mut residual = Residual::default();
        residual.felt(Some(push(5.0)), push(1.0), 0.9);
        assert_eq!(residual.felt(Some(push(1.0)), Wrench::ZERO, 0.9), Wrench::ZERO);
        assert_eq!(residual.felt(None, push(1.0), 0.9), push(1.0));
    }

    #[test]
    fn it_never_pulls() {
        let mut residual = Residual::default();
        // The clay came to a tool that had next to no contact: the force rises from nothing ...
        let felt = residual.felt(Some(Wrench::ZERO), push(4.0), 0.9);
        assert!((felt.force.z - 0.4).abs() < 1e-12, "{felt:?}");
        // ... and a tool that goes away from there is not held back.
        let mut last = felt.force.z;
        for force_n in [3.0, 2.0, 1.0, 0.1] {
            let felt = residual.felt(None, push(force_n), 0.99);
            assert!(felt.force.z >= 0.0 && felt.force.z <= last.max(0.41), "{felt:?}");
            last = felt.force.z;
        }
        assert_eq!(last, 0.0);
    }

    #[test]
    fn a_leap_comes_slowly_and_what_follows_as_usual() {
        let mut residual = Residual::default();
        residual.leap(0.99);
        let mut before = Some(push(1.0));
        let mut n_slow = 0;
        let mut last = 1.0;
        loop {
            let felt = residual.felt(before.take(), push(11.0), 0.5).force.z;
            assert!(felt >= last && felt - last < 0.11, "tick {n_slow}: {last} N, then {felt} N");
            last = felt;
            n_slow += 1;
            if felt > 10.999 {
                break;
            }
        }
        assert!((680..710).contains(&n_slow), "{n_slow} ticks");
        let felt = residual.felt(Some(push(11.0)), push(13.0), 0.5).force.z;
        assert!((felt - 12.0).abs() < 1e-3, "{felt}");
    }

    #[test]
    fn what_is_not_a_number_does_not_stay() {
        let mut residual = Residual::default();
        assert!(
            !residual.felt(None, push(f64::NAN), 0.5).is_finite(),
            "the tick's finite check has to see it"
        );
        assert!(!residual.felt(Some(push(1.0)), push(f64::NAN), 0.5).is_finite());
        assert_eq!(residual.felt(None, push(1.0), 0.5), push(1.0));
    }

    #[test]
    fn a_change_of_force_alone_and_of_torque_alone_both_come_in_by_the_average() {
        for (before, now) in [
            (Wrench::new(DVec3::Z, DVec3::X), Wrench::new(DVec3::Z * 3.0, DVec3::X)),
            (Wrench::new(DVec3::Z, DVec3::X), Wrench::new(DVec3::Z, DVec3::X * 3.0)),
        ] {
            let felt = Residual::default().felt(Some(before), now, 0.75);
            let expected = before * 0.75 + now * 0.25;
            assert!((felt - expected).force.length() < 1e-12, "{felt:?}");
            assert!((felt - expected).torque.length() < 1e-12, "{felt:?}");
        }
    }

    #[test]
    fn less_than_a_nanonewton_that_is_left_is_forgotten() {
        let mut residual = Residual::default();
        // 0.1 nN of which half would be left.
        assert_eq!(residual.felt(Some(push(1.0 + 1e-10)), push(1.0), 0.5), push(1.0));
        assert_eq!(residual, Residual::default());
    }
}
