//! How far away an arm is, measured while it is used.
//!
//! Data in: when frames left and when reports came, in ticks. Data out: the round trip that 95 of
//! 100 exchanges did not exceed; over a network 99. Not the longest: one hiccup of the system would
//! cost the coupling its stiffness for the rest of the session, and what is that late is judged as
//! stale anyway.

/// Exchanges that are remembered: a quarter of a second at 1 kHz.
const WINDOW: usize = 256;
/// Longest round trip that is distinguished, ticks.
const LONGEST: usize = 255;
/// Share of the exchanges that may be later.
const LATE_SHARE: f64 = 0.05;
/// The same over a network, whose jitter is no hiccup.
const LATE_SHARE_OVER_NETWORK: f64 = 0.01;

/// Round trips of the last exchanges. RT: safe.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RoundTrip {
    /// `[WINDOW]`, ring of round trips, ticks.
    ring: [u8; WINDOW],
    /// How many of each length lie in the ring.
    counts: [u16; LONGEST + 1],
    n_seen: usize,
    sent_at: Option<u64>,
    assumed_ticks: u32,
    late_share: f64,
}

impl RoundTrip {
    /// Nothing measured; `assumed_ticks` stands until the window is full.
    pub(crate) fn starting_at(assumed_ticks: u32) -> Self {
        Self {
            ring: [0; WINDOW],
            counts: [0; LONGEST + 1],
            n_seen: 0,
            sent_at: None,
            assumed_ticks,
            late_share: LATE_SHARE,
        }
    }

    /// The same for an arm on another machine.
    pub(super) fn over_network(assumed_ticks: u32) -> Self {
        Self { late_share: LATE_SHARE_OVER_NETWORK, ..Self::starting_at(assumed_ticks) }
    }

    /// A frame left in this tick.
    pub(crate) fn sent(&mut self, tick: u64) {
        self.sent_at = Some(tick);
    }

    /// A report came in this tick. `commands_behind`: how many commands left after the one that the
    /// arm had seen, where it says so; else the report answers the last frame. Ticks are counted
    /// from the write to the read; commands that are behind left a tick apart.
    pub(super) fn received(&mut self, tick: u64, commands_behind: Option<u16>) {
        let ticks = match (commands_behind, self.sent_at.take()) {
            (Some(behind), Some(sent_at)) => {
                u64::from(behind) + tick.saturating_sub(sent_at).max(1)
            }
            (Some(behind), None) => u64::from(behind) + 1,
            (None, Some(sent_at)) => tick.saturating_sub(sent_at),
            (None, None) => return,
        };
        let ticks = usize::try_from(ticks).unwrap_or(LONGEST).min(LONGEST);
        let slot = self.n_seen % WINDOW;
        if let Some(entry) = self.ring.get_mut(slot) {
            if self.n_seen >= WINDOW
                && let Some(count) = self.counts.get_mut(usize::from(*entry))
            {
                *count = count.saturating_sub(1);
            }
            *entry = ticks as u8;
        }
        if let Some(count) = self.counts.get_mut(ticks) {
            *count += 1;
        }
        self.n_seen += 1;
    }

    /// The round trip, ticks.
    pub(crate) fn ticks(&self) -> u32 {
        if self.n_seen < WINDOW {
            return self.assumed_ticks;
        }
        let mut later = WINDOW as f64;
        for (ticks, count) in self.counts.iter().enumerate() {
            later -= f64::from(*count);
            if later <= self.late_share * WINDOW as f64 {
                return ticks as u32;
            }
        }
        LONGEST as u32
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rare_hiccups_do_not_count_and_a_slow_arm_does() {
        let mut trip = RoundTrip::starting_at(2);
        let mut tick = 0;
        let mut exchange = |trip: &mut RoundTrip, ticks: u64| {
            trip.sent(tick);
            tick += ticks;
            trip.received(tick, None);
        };
        for n in 0..300 {
            assert!(n >= WINDOW || trip.ticks() == 2, "assumed until enough was seen");
            exchange(&mut trip, if n % 50 == 0 { 12 } else { 1 });
        }
        assert_eq!(trip.ticks(), 1);
        for _ in 0..WINDOW {
            exchange(&mut trip, 3);
        }
        assert_eq!(trip.ticks(), 3);
        for _ in 0..WINDOW {
            exchange(&mut trip, 1000);
        }
        assert_eq!(trip.ticks(), LONGEST as u32);
    }

    #[test]
    fn an_arm_that_echoes_is_believed() {
        let mut trip = RoundTrip::starting_at(0);
        for tick in 0..WINDOW as u64 {
            trip.sent(tick);
            trip.received(tick + 1, Some(4));
        }
        assert_eq!(trip.ticks(), 5);
        // One command at a time, and three ticks until it is answered.
        for tick in 0..WINDOW as u64 {
            trip.sent(10 * tick);
            trip.received(10 * tick + 3, Some(0));
        }
        assert_eq!(trip.ticks(), 3);
    }
}
