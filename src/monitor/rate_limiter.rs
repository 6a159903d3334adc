//! How often a client may ask.

use std::collections::HashMap;
use std::net::IpAddr;
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

/// Requests of one machine a second, and at once.
const MOST_PER_S: f64 = 100.0;
const MOST_AT_ONCE: f64 = 400.0;
/// Machines whose requests are counted apart.
const MOST_MACHINES: usize = 256;

/// So many at once, and so many a second.
#[derive(Debug)]
pub(super) struct TokenBucket {
    per_s: f64,
    most: f64,
    left: f64,
    at: Instant,
}

impl TokenBucket {
    pub(super) fn new(per_s: f64, most: f64) -> Self {
        Self { per_s, most, left: most, at: Instant::now() }
    }

    /// Takes one if it is there.
    pub(super) fn try_take(&mut self) -> bool {
        let now = Instant::now();
        let more = now.duration_since(self.at).as_secs_f64() * self.per_s;
        self.left = (self.left + more).min(self.most);
        self.at = now;
        let is_there = self.left >= 1.0;
        if is_there {
            self.left -= 1.0;
        }
        is_there
    }
}

/// Counts the requests of each machine.
#[derive(Debug, Default)]
pub(super) struct RateLimiter(Mutex<HashMap<IpAddr, TokenBucket>>);

impl RateLimiter {
    /// True when one more request of this machine may be done.
    pub(super) fn allows(&self, machine: IpAddr) -> bool {
        let mut buckets = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if buckets.len() >= MOST_MACHINES && !buckets.contains_key(&machine) {
            buckets.clear();
        }
        buckets
            .entry(machine)
            .or_insert_with(|| TokenBucket::new(MOST_PER_S, MOST_AT_ONCE))
            .try_take()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_there_at_once_comes_back_with_time() {
        let mut bucket = TokenBucket::new(0.001, 3.0);
        assert_eq!((0..5).filter(|_| bucket.try_take()).count(), 3);
        let an_hour = core::time::Duration::from_secs(3600);
        bucket.at = bucket.at.checked_sub(an_hour).expect("a clock that can go back so far");
        assert_eq!((0..9).filter(|_| bucket.try_take()).count(), 3, "one in a thousand seconds");
    }

    #[test]
    fn machines_are_counted_apart_and_not_for_ever() {
        let limiter = RateLimiter::default();
        let machine = |n: u32| IpAddr::from(n.to_be_bytes());
        while limiter.allows(machine(1)) {}
        assert!(limiter.allows(machine(2)));
        for n in 0..10 * MOST_MACHINES as u32 {
            limiter.allows(machine(n));
        }
        assert!(limiter.0.lock().expect("whole").len() <= MOST_MACHINES);
    }
}
