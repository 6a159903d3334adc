//! Two clocks and the ways between them.
//!
//! ```text
//!   host   t1 ────── there ──────►╲                    ╱──── back ──────► t4
//!   node                            t2 ── age ── t3 ──
//! ```
//! From one exchange: there + back = (t4 − t1) − (t3 − t2), exact. Which share belongs to which way
//! no clock can tell; the exchange that took least had the least to wait for on either, so half of
//! *its* difference is taken for the offset of the clocks.
//!
//! # Source
//! The clock filter of NTP (RFC 5905, section 10): the offset of the sample with the least delay.
//! One window of seconds instead of its eight samples is ours. What a way is longer than the other
//! one at rest is not seen, and halved between both.

/// Length of one of the two windows, s: drifting clocks (100 ppm) part by 0.2 ms meanwhile.
const WINDOW_S: f64 = 2.0;

/// Times of one exchange, s; t1 and t4 by the host's clock, t2 and t3 by the node's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Exchange {
    /// The command left.
    pub(super) t1: f64,
    /// It came.
    pub(super) t2: f64,
    /// The arm was measured.
    pub(super) t3: f64,
    /// The state came.
    pub(super) t4: f64,
}

impl Exchange {
    /// Both ways together, s.
    pub(super) fn trip_s(&self) -> f64 {
        (self.t4 - self.t1) - (self.t3 - self.t2)
    }

    /// What the node's clock is ahead, s, if both ways took the same time.
    fn offset_s(&self) -> f64 {
        0.5 * ((self.t2 - self.t1) + (self.t3 - self.t4))
    }
}

/// How long the ways take, s.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Ways {
    /// From the host to the node.
    pub(super) there_s: f64,
    /// From the node to the host.
    pub(super) back_s: f64,
}

#[derive(Clone, Copy, Debug)]
struct ClockWindow {
    begin_s: f64,
    least_trip_s: f64,
    offset_s: f64,
    longest: Ways,
}

impl ClockWindow {
    const fn at(begin_s: f64) -> Self {
        Self {
            begin_s,
            least_trip_s: f64::INFINITY,
            offset_s: 0.0,
            longest: Ways { there_s: 0.0, back_s: 0.0 },
        }
    }
}

/// Estimates the offset of the node's clock and the two ways, over the last two to four seconds.
/// RT: safe.
#[derive(Clone, Copy, Debug)]
pub(super) struct LinkClock {
    now: ClockWindow,
    before: ClockWindow,
}

impl Default for LinkClock {
    fn default() -> Self {
        Self { now: ClockWindow::at(f64::NEG_INFINITY), before: ClockWindow::at(f64::NEG_INFINITY) }
    }
}

impl LinkClock {
    /// Takes an exchange, and says how long its ways took. Times that are no numbers, and ways that
    /// end before they begin, tell nothing.
    pub(super) fn observe(&mut self, exchange: &Exchange) -> Option<Ways> {
        let trip_s = exchange.trip_s();
        if !(trip_s.is_finite() && trip_s >= 0.0 && exchange.offset_s().is_finite()) {
            return None;
        }
        if exchange.t4 - self.now.begin_s > WINDOW_S {
            self.before = self.now;
            self.now = ClockWindow::at(exchange.t4);
        }
        if trip_s < self.now.least_trip_s {
            (self.now.least_trip_s, self.now.offset_s) = (trip_s, exchange.offset_s());
        }
        let offset_s = self.offset_s();
        let ways = Ways {
            there_s: exchange.t2 - exchange.t1 - offset_s,
            back_s: exchange.t4 - exchange.t3 + offset_s,
        };
        let longest = &mut self.now.longest;
        longest.there_s = longest.there_s.max(ways.there_s);
        longest.back_s = longest.back_s.max(ways.back_s);
        Some(ways)
    }

    /// What the node's clock is ahead of the host's, s; 0 before the first exchange.
    pub(super) fn offset_s(&self) -> f64 {
        if self.before.least_trip_s < self.now.least_trip_s {
            self.before.offset_s
        } else {
            self.now.offset_s
        }
    }

    /// The longest ways of the last seconds.
    pub(super) fn longest(&self) -> Ways {
        let a = self.now.longest;
        let b = self.before.longest;
        Ways { there_s: a.there_s.max(b.there_s), back_s: a.back_s.max(b.back_s) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::split_mix::SplitMix64;

    /// Exchanges every ms with these ways and that offset of the clocks.
    fn play(
        clock: &mut LinkClock,
        from_s: f64,
        n: usize,
        ways: impl Fn(&mut SplitMix64) -> (f64, f64),
        offset_s: f64,
    ) {
        let mut random = SplitMix64::new(3);
        for idx in 0..n {
            let t1 = from_s + idx as f64 * 1e-3;
            let (there, back) = ways(&mut random);
            let age = 0.7e-3;
            let t2 = t1 + there + offset_s;
            clock.observe(&Exchange { t1, t2, t3: t2 + age, t4: t1 + there + age + back });
        }
    }

    #[test]
    fn the_offset_is_that_of_the_quickest_exchange_and_the_ways_follow() {
        let mut clock = LinkClock::default();
        play(
            &mut clock,
            0.0,
            2000,
            |random| (10e-3 + 1e-3 * random.unit(), 10e-3 + 1e-3 * random.unit()),
            123.456,
        );
        // The quickest of 2000 waited for next to nothing on both ways.
        assert!((clock.offset_s() - 123.456).abs() < 0.1e-3, "{}", clock.offset_s());
        let Ways { there_s, back_s } = clock.longest();
        assert!(
            (there_s - 11e-3).abs() < 0.2e-3 && (back_s - 11e-3).abs() < 0.2e-3,
            "{there_s} {back_s}"
        );
    }

    #[test]
    fn a_clock_that_drifts_is_followed_and_old_delays_are_forgotten() {
        let mut clock = LinkClock::default();
        play(&mut clock, 0.0, 1000, |_| (1e-3, 1e-3), -5.0);
        play(&mut clock, 1.0, 6000, |_| (20e-3, 20e-3), -4.0);
        assert!((clock.offset_s() + 4.0).abs() < 1e-9, "{}", clock.offset_s());
        play(&mut clock, 7.0, 6000, |_| (1e-3, 1e-3), -4.0);
        let Ways { there_s, back_s } = clock.longest();
        assert!((there_s - 1e-3).abs() < 1e-9 && (back_s - 1e-3).abs() < 1e-9);
    }

    #[test]
    fn numbers_that_are_none_tell_nothing() {
        let mut clock = LinkClock::default();
        for exchange in [
            Exchange { t1: f64::NAN, t2: 0.0, t3: 0.0, t4: 1.0 },
            Exchange { t1: 1.0, t2: 0.0, t3: 0.0, t4: 0.5 },
            Exchange { t1: 0.0, t2: f64::INFINITY, t3: 0.0, t4: 0.5 },
        ] {
            assert_eq!(clock.observe(&exchange), None);
        }
        assert_eq!((clock.offset_s(), clock.longest()), (0.0, Ways::default()));
    }
}
