//! The force at the arm between two commands, and after the last one.
//!
//! ```text
//!   force  ─────────────╮ last command came
//!                       │ hold ├── fade ──┤
//!          ─────────────┴──────╲
//!                                ╲________  0, and until the host has said *disabled*
//! ```
//! Commands come a tick apart, with jitter and gaps. Each new one is approached exponentially, E ←
//! α E + (1 − α) F, so that a late or lost packet makes no step; without a new one E goes on to the
//! last. It is held for so long, then fades to zero linearly. The end is counted from when the
//! command may have come at the earliest (one period before it was seen) to when the last change
//! reaches the motors (the arm's own delay), so that hold and fade together bound what the hand
//! feels.
//!
//! # Source
//! Guo2004 for the exponential weighting between updates of a slower process. Hold and fade are
//! ours.

use vps::spatial::Wrench;

/// α: half of what is new is felt at once, nine tenths after four ticks.
const WEIGHT: f64 = 0.5;
/// Lag of that average on a force that changes slowly, α/(1 − α), ticks: part of the delay that the
/// node reports to the host.
pub(super) const LAG_TICKS: u32 = 1;
/// Less of a difference is none, N and N·m.
const ARRIVED: f64 = 1e-6;

/// How long a force outlives its command.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HoldTiming {
    /// Held so long, s.
    pub hold_s: f64,
    /// Then gone within, s.
    pub fade_s: f64,
}

/// The force between commands. RT: safe.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct CommandHold {
    wanted: Wrench,
    average: Wrench,
    felt: Wrench,
    since_s: f64,
}

impl CommandHold {
    /// Takes a command. Zero is taken at once: free space stays free.
    pub(super) fn take(&mut self, wanted: Wrench, now_s: f64) {
        let average = if wanted == Wrench::ZERO { Wrench::ZERO } else { self.felt };
        *self = Self { wanted, average, felt: self.felt, since_s: now_s };
    }

    /// The force of this period; `None` when it is over. `arm_s`: what a change takes from here to
    /// the motors, one period included.
    pub(super) fn next(&mut self, now_s: f64, timing: &HoldTiming, arm_s: f64) -> Option<Wrench> {
        let left_s = timing.hold_s + timing.fade_s - arm_s - (now_s - self.since_s);
        // Written so that a NaN ends it. Half a microsecond: times are sums of periods.
        let lasts = left_s > 5e-7;
        if !lasts {
            *self = Self::default();
            return None;
        }
        self.average = self.average * WEIGHT + self.wanted * (1.0 - WEIGHT);
        let rest = self.wanted - self.average;
        if rest.force.length() < ARRIVED && rest.torque.length() < ARRIVED {
            self.average = self.wanted;
        }
        self.felt = self.average * (left_s / timing.fade_s).min(1.0);
        Some(self.felt)
    }

    /// No force, and nothing remembered.
    pub(super) fn clear(&mut self) {
        *self = Self::default();
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;

    const T: f64 = 1e-3;
    const TIMING: HoldTiming = HoldTiming { hold_s: 10e-3, fade_s: 20e-3 };

    fn push(force_n: f64) -> Wrench {
        Wrench::new(DVec3::X * force_n, DVec3::Z * 0.01 * force_n)
    }

    #[test]
    fn a_force_is_approached_held_faded_and_gone_in_time() {
        for arm_ticks in [1, 2, 5] {
            let mut hold = CommandHold::default();
            hold.take(push(4.0), 0.0);
            let forces: Vec<f64> = (0..40)
                .map(|n| {
                    hold.next(f64::from(n) * T, &TIMING, f64::from(arm_ticks) * T)
                        .map_or(-1.0, |wrench| wrench.force.x)
                })
                .collect();
            assert!((forces[0] - 2.0).abs() < 1e-12 && forces[3] > 0.9 * 4.0);
            let end = 30 - arm_ticks as usize;
            assert!(
                forces[end - 1] > 0.0 && forces[end..].iter().all(|force| *force < 0.0),
                "{forces:?}"
            );
            // The fade: equal steps down, once the average has arrived.
            for n in end - 17..end {
                assert!((forces[n - 1] - forces[n] - 0.2).abs() < 2e-2, "{n}: {forces:?}");
            }
        }
    }

    #[test]
    fn a_command_in_the_fade_goes_on_from_what_is_felt_and_zero_is_zero_at_once() {
        let mut hold = CommandHold::default();
        hold.take(push(4.0), 0.0);
        let mut felt = 0.0;
        for n in 0..22 {
            felt = hold.next(f64::from(n) * T, &TIMING, T).expect("lasts").force.x;
        }
        hold.take(push(4.0), 22.0 * T);
        let next = hold.next(22.0 * T, &TIMING, T).expect("lasts").force.x;
        assert!((next - 0.5 * (felt + 4.0)).abs() < 1e-12, "{felt} {next}");
        hold.take(Wrench::ZERO, 23.0 * T);
        assert_eq!(hold.next(23.0 * T, &TIMING, T), Some(Wrench::ZERO));
    }

    #[test]
    fn a_time_that_is_no_number_is_the_end() {
        let mut hold = CommandHold::default();
        hold.take(push(1.0), f64::NAN);
        assert_eq!(hold.next(0.0, &TIMING, T), None);
    }
}
