//! How simulated time waits.

use std::time::Duration;

use crossbeam::utils::Backoff;

const PAUSE: Duration = Duration::from_micros(50);

/// A wait of simulated time for another thread of the run: by turns at first, then asleep, so that
/// the other one has the processor.
#[derive(Debug, Default)]
pub struct Waiting(Backoff);

impl Waiting {
    /// A wait that begins.
    pub fn new() -> Self {
        Self(Backoff::new())
    }

    /// What it waits for has not happened yet. Never called on the real clock: it sleeps.
    #[expect(
        clippy::disallowed_methods,
        reason = "simulated time: nothing is due at a time of the clock"
    )]
    pub fn pause(&self) {
        if self.0.is_completed() { std::thread::sleep(PAUSE) } else { self.0.snooze() }
    }

    /// It has.
    pub fn reset(&self) {
        self.0.reset();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_wait_is_spent_asleep_and_the_next_one_begins_awake() {
        let waiting = Waiting::new();
        (0..20).for_each(|_| waiting.pause());
        assert!(waiting.0.is_completed());
        waiting.reset();
        assert!(!waiting.0.is_completed());
    }
}
