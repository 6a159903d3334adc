//! How late the machine wakes a loop: a thread that asks for the place of the servo, sleeps to a
//! grid of deadlines and does nothing else.

use core::sync::atomic::{AtomicBool, Ordering};
use core::time::Duration;

use hdrhistogram::Histogram;

use super::clock::{Clock, RealClock};
use super::realtime::{self, Entered};
use super::schedule::ThreadRequest;

/// Longest lateness that is distinguished, ns; anything longer counts as this.
const LONGEST_NS: u64 = 10_000_000_000;

/// Lateness of wake-ups.
#[derive(Clone, Debug)]
pub struct WakeupTest {
    /// What the thread got.
    pub entered: Entered,
    /// Deadlines that were kept, or not.
    pub wakeups: u64,
    /// Deadlines that passed before the thread was awake: ticks that a servo would have missed.
    pub missed: u64,
    /// Lateness, ns.
    pub late_ns: Histogram<u64>,
}

impl WakeupTest {
    /// Lateness at a quantile, µs.
    pub fn quantile_us(&self, quantile: f64) -> f64 {
        self.late_ns.value_at_quantile(quantile) as f64 * 1e-3
    }

    /// Wake-ups that were late by more than the bound before and at most each bound, µs; the last
    /// entry: by more than all of them.
    pub fn bins(&self, bounds_us: &[u64]) -> Vec<u64> {
        let mut bins = vec![0; bounds_us.len() + 1];
        for value in self.late_ns.iter_recorded() {
            let idx =
                bounds_us.partition_point(|bound_us| bound_us * 1000 < value.value_iterated_to());
            bins[idx] += value.count_at_value();
        }
        bins
    }

    /// Largest lateness, µs.
    pub fn max_us(&self) -> f64 {
        self.late_ns.max() as f64 * 1e-3
    }
}

fn histogram() -> Histogram<u64> {
    match Histogram::new_with_bounds(1, LONGEST_NS, 2) {
        Ok(histogram) => histogram,
        // True invariant: the bounds are constants of this file that every test run exercises.
        Err(error) => unreachable!("fixed histogram bounds: {error}"),
    }
}

/// Sleeps for `duration` in steps of `period`, in a thread of its own; ends early when `quit` is
/// set. Memory is unlocked again at the end.
///
/// # Errors
/// The thread could not be started, or died.
pub fn measure(
    request: ThreadRequest,
    period: Duration,
    duration: Duration,
    quit: &AtomicBool,
) -> std::io::Result<WakeupTest> {
    std::thread::scope(|scope| {
        let thread = std::thread::Builder::new().name("wake-up test".to_owned()).spawn_scoped(
            scope,
            || {
                let thread = realtime::enter(request);
                let period_ns = (period.as_nanos() as i64).max(1);
                let n = duration.as_nanos() as i64 / period_ns;
                let mut late_ns = histogram();
                let mut clock = RealClock;
                let mut wakeups = 0;
                let mut missed = 0;
                let start_ns = clock.now_ns() + period_ns;
                let mut k = 0;
                while k < n && !quit.load(Ordering::Relaxed) {
                    let deadline_ns = start_ns + k * period_ns;
                    clock.sleep_until(deadline_ns);
                    let late = (clock.now_ns() - deadline_ns).max(0);
                    late_ns.saturating_record(late.unsigned_abs());
                    wakeups += 1;
                    let skipped = late / period_ns;
                    missed += skipped.unsigned_abs();
                    k += 1 + skipped;
                }
                WakeupTest { entered: thread.entered(), wakeups, missed, late_ns }
            },
        )?;
        thread.join().map_err(|_| std::io::Error::other("the thread of the wake-up test died"))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_deadline_is_kept_or_counted() {
        let request = ThreadRequest { cpu: crate::schedule::loop_cpu(None), priority: 1 };
        let quit = AtomicBool::new(false);
        let test = measure(request, Duration::from_millis(1), Duration::from_millis(50), &quit)
            .expect("thread");
        assert!(test.wakeups + test.missed >= 50 && test.wakeups > 0, "{test:?}");
        assert_eq!(test.late_ns.len(), test.wakeups);
        assert_eq!(test.bins(&[10, 100, 1000]).iter().sum::<u64>(), test.wakeups);
        assert!(test.quantile_us(0.5) <= test.max_us());
        quit.store(true, Ordering::Relaxed);
        assert_eq!(
            measure(request, Duration::from_millis(1), Duration::from_secs(60), &quit)
                .expect("thread")
                .wakeups,
            0
        );
    }
}
