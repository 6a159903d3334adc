//! Work that is done again and again, and may take a share of the time only.

use core::time::Duration;

/// When something may be done again so that it takes no more than a share of the time, however long
/// it takes. Pure: the caller says what time it is, as the time since some beginning.
#[derive(Clone, Copy, Debug)]
pub struct DutyCycle {
    /// Rest after each second of work, s.
    rest_s: f64,
    period: Duration,
    next: Duration,
}

impl DutyCycle {
    /// Work that takes at most `share` (above 0, at most 1) of the time, and begins at most once in
    /// a `period`.
    pub fn new(share: f64, period: Duration) -> Self {
        Self { rest_s: (1.0 / share - 1.0).max(0.0), period, next: Duration::ZERO }
    }

    /// It may be done now.
    pub fn is_due(&self, now: Duration) -> bool {
        now >= self.next
    }

    /// It was done, from one time to another.
    pub fn worked(&mut self, begin: Duration, end: Duration) {
        // A share so small that the rest is longer than all time is never due again.
        let rest =
            Duration::try_from_secs_f64(end.saturating_sub(begin).as_secs_f64() * self.rest_s)
                .unwrap_or(Duration::MAX);
        self.next = begin.saturating_add(self.period).max(end.saturating_add(rest));
    }

    /// Whatever was done is not done again before this time.
    pub fn rest_until(&mut self, time: Duration) {
        self.next = self.next.max(time);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// How often it is done in a minute by a caller that asks every millisecond, when each time
    /// takes so many, and how many that is of 60,000.
    fn in_a_minute(mut duty: DutyCycle, cost_ms: u64) -> (u64, u64) {
        let mut now_ms = 0;
        let mut times = 0;
        let mut worked_ms = 0;
        while now_ms < 60_000 {
            let now = Duration::from_millis(now_ms);
            if duty.is_due(now) {
                now_ms += cost_ms;
                duty.worked(now, Duration::from_millis(now_ms));
                (times, worked_ms) = (times + 1, worked_ms + cost_ms);
            }
            now_ms += 1;
        }
        (times, worked_ms)
    }

    #[test]
    fn what_takes_long_is_done_seldom_and_what_takes_none_once_in_a_period() {
        let duty = DutyCycle::new(0.1, Duration::from_millis(50));
        assert_eq!(in_a_minute(duty, 0).0, 1200);
        for cost_ms in [1, 4, 6, 40, 700] {
            let (times, worked_ms) = in_a_minute(duty, cost_ms);
            assert!(worked_ms <= 6000 + cost_ms, "{cost_ms} ms: {worked_ms} of 60,000");
            assert!(times >= 1200.min(5900 / cost_ms), "{cost_ms} ms: {times} times");
        }
    }

    #[test]
    fn all_of_the_time_and_next_to_none_of_it_are_shares_too() {
        assert_eq!(in_a_minute(DutyCycle::new(1.0, Duration::ZERO), 9).0, 6000);
        assert_eq!(in_a_minute(DutyCycle::new(f64::MIN_POSITIVE, Duration::ZERO), 9).0, 1);
        let mut duty = DutyCycle::new(1.0, Duration::ZERO);
        duty.rest_until(Duration::from_secs(3));
        duty.rest_until(Duration::from_secs(2));
        assert!(!duty.is_due(Duration::from_millis(2999)) && duty.is_due(Duration::from_secs(3)));
    }
}
