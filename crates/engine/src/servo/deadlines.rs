//! When the next tick is due, and what became of the ones that were not done in time.
//!
//! ```text
//!  deadlines   |         |         |         |         |
//!  in time     ^tick     ^tick     ^tick
//!  long tick   ^----------tick---------^  (x)          ^tick     one missed: the next one waits for the grid
//!  late wake   ^tick     (x)       (x)  ^tick          ^tick     two missed: one tick now, the rest never
//! ```
//!
//! Deadlines stay on one grid, k·T after the start. A deadline that passed is counted and skipped:
//! ticks are never made up in a burst, which would feed the arm two commands at once.

use rt::clock::Clock;

/// How a tick comes to be due.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TickTiming {
    /// Loop time when it began, ns.
    pub now_ns: i64,
    /// How late after the deadline that it waited for, ns.
    pub late_ns: u64,
    /// Deadlines that passed without a tick since the last one.
    pub missed: u64,
}

/// The grid of deadlines.
#[derive(Clone, Copy, Debug)]
pub struct DeadlineGrid {
    period_ns: i64,
    next_ns: i64,
}

impl DeadlineGrid {
    /// A grid whose first deadline is one period after `now_ns`. A period below 1 ns becomes 1 ns.
    pub const fn new(now_ns: i64, period_ns: i64) -> Self {
        let period_ns = if period_ns < 1 { 1 } else { period_ns };
        Self { period_ns, next_ns: now_ns.saturating_add(period_ns) }
    }

    /// The period, ns.
    pub const fn period_ns(&self) -> i64 {
        self.period_ns
    }

    /// Sleeps to the next deadline that is still ahead. RT: safe; one system call.
    pub fn wait(&mut self, clock: &mut impl Clock) -> TickTiming {
        let before_ns = clock.now_ns();
        let mut missed = 0;
        if before_ns > self.next_ns {
            // The tick before took too long: these deadlines are gone, wait for the first one
            // ahead.
            missed += self.skip((before_ns - self.next_ns) / self.period_ns + 1);
        }
        clock.sleep_until(self.next_ns);
        let now_ns = clock.now_ns();
        let late_ns = (now_ns - self.next_ns).max(0);
        // A wake-up that is whole periods late has slept through deadlines.
        missed += self.skip(late_ns / self.period_ns);
        self.next_ns = self.next_ns.saturating_add(self.period_ns);
        TickTiming { now_ns, late_ns: late_ns.unsigned_abs(), missed }
    }

    fn skip(&mut self, n_periods: i64) -> u64 {
        self.next_ns = self.next_ns.saturating_add(n_periods.saturating_mul(self.period_ns));
        n_periods.unsigned_abs()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::servo::testing::ScriptedClock;

    const T: i64 = 1_000_000;

    #[test]
    fn a_loop_in_time_misses_nothing() {
        let mut clock = ScriptedClock::default();
        let mut grid = DeadlineGrid::new(0, T);
        for k in 1..=5 {
            clock.now_ns += 300_000;
            assert_eq!(grid.wait(&mut clock), TickTiming { now_ns: k * T, late_ns: 0, missed: 0 });
        }
    }

    #[test]
    fn a_tick_that_ends_on_the_next_deadline_has_not_missed_it() {
        let mut clock = ScriptedClock::default();
        let mut grid = DeadlineGrid::new(0, T);
        grid.wait(&mut clock);
        clock.now_ns += T;
        assert_eq!(grid.wait(&mut clock), TickTiming { now_ns: 2 * T, late_ns: 0, missed: 0 });
    }

    #[test]
    fn a_small_lateness_is_measured_and_not_counted_as_a_miss() {
        let mut clock = ScriptedClock::late_by(&[70_000, 0]);
        let mut grid = DeadlineGrid::new(0, T);
        assert_eq!(
            grid.wait(&mut clock),
            TickTiming { now_ns: T + 70_000, late_ns: 70_000, missed: 0 }
        );
        assert_eq!(
            grid.wait(&mut clock),
            TickTiming { now_ns: 2 * T, late_ns: 0, missed: 0 },
            "back on the grid"
        );
    }

    #[test]
    fn a_long_tick_skips_the_deadlines_it_ran_over() {
        let mut clock = ScriptedClock::default();
        let mut grid = DeadlineGrid::new(0, T);
        grid.wait(&mut clock);
        clock.now_ns += T + T / 2; // from 1 T to 2.5 T: the deadline at 2 T is gone
        assert_eq!(grid.wait(&mut clock), TickTiming { now_ns: 3 * T, late_ns: 0, missed: 1 });
        clock.now_ns += 3 * T + 1; // from 3 T to just over 6 T: 4, 5 and 6 are gone
        assert_eq!(grid.wait(&mut clock), TickTiming { now_ns: 7 * T, late_ns: 0, missed: 3 });
    }

    #[test]
    fn a_late_wake_up_is_one_tick_and_never_a_burst() {
        let mut clock = ScriptedClock::late_by(&[2 * T + T / 2, 0, 0]);
        let mut grid = DeadlineGrid::new(0, T);
        assert_eq!(
            grid.wait(&mut clock),
            TickTiming { now_ns: 3 * T + T / 2, late_ns: 2_500_000, missed: 2 }
        );
        assert_eq!(grid.wait(&mut clock), TickTiming { now_ns: 4 * T, late_ns: 0, missed: 0 });
        assert_eq!(grid.wait(&mut clock), TickTiming { now_ns: 5 * T, late_ns: 0, missed: 0 });
    }
}
