//! Garbled packets: a few are dropped and counted, many are a fault.
//!
//! A packet that is thrown away costs a sample, and samples that are missing are judged elsewhere.
//! What is judged here is a link that goes bad while enough still gets through.

/// Time over which garbled packets are counted, s: a burst of interference lasts some milliseconds,
/// a loose plug for as long as it moves.
const WINDOW_S: f64 = 0.1;

/// More than so many within the window are a fault: a tenth of what an arm sends at 1 kHz. A USB or
/// serial link that is sound has none in an hour.
const MOST: usize = 10;

/// More than so many, and the force ramps down until they are fewer.
const MANY: usize = 5;

/// What the link is like.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum LinkState {
    #[default]
    Sound,
    /// The force has to go down.
    Bad,
    /// A fault.
    Broken,
}

/// When the last garbled packets came.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct GarbledPackets {
    tick: u64,
    /// Newest first.
    at_tick: [Option<u64>; MOST + 1],
}

impl GarbledPackets {
    /// Takes note of one tick's garbled packets. RT: safe, O(1).
    pub(super) fn count(&mut self, n_garbled: u16, period_s: f64) -> LinkState {
        self.tick += 1;
        for _ in 0..usize::from(n_garbled).min(MOST + 1) {
            self.at_tick.rotate_right(1);
            if let Some(newest) = self.at_tick.first_mut() {
                *newest = Some(self.tick);
            }
        }
        let window_ticks = (WINDOW_S / period_s).round() as u64;
        let more_than = |n: usize| {
            self.at_tick
                .get(n)
                .copied()
                .flatten()
                .is_some_and(|tick| self.tick - tick < window_ticks)
        };
        if more_than(MOST) {
            LinkState::Broken
        } else if more_than(MANY) {
            LinkState::Bad
        } else {
            LinkState::Sound
        }
    }
}

#[cfg(test)]
#[expect(clippy::disallowed_types, reason = "test code")]
mod tests {
    use super::*;

    #[test]
    fn eleven_within_a_tenth_of_a_second_are_too_many() {
        let mut packets = GarbledPackets::default();
        let links: Vec<LinkState> = (0..11).map(|_| packets.count(1, 1e-3)).collect();
        assert!(links.iter().take(5).all(|link| *link == LinkState::Sound), "{links:?}");
        assert!(links.iter().skip(5).take(5).all(|link| *link == LinkState::Bad), "{links:?}");
        assert_eq!(links.last(), Some(&LinkState::Broken));
        // The first of the eleven is 100 ticks old after 89 more.
        let sound: Vec<LinkState> = (0..100).map(|_| packets.count(0, 1e-3)).collect();
        assert_eq!(sound.iter().position(|link| *link != LinkState::Broken), Some(89));
        assert_eq!(sound.iter().position(|link| *link == LinkState::Sound), Some(94));
    }

    #[test]
    fn the_window_is_a_time_not_a_number_of_ticks() {
        let trips = |period_s: f64, every: u32| {
            let mut packets = GarbledPackets::default();
            (0..10_000)
                .any(|n| packets.count(u16::from(n % every == 0), period_s) == LinkState::Broken)
        };
        // One in ten is ten in a window of 100 at 1 kHz, forty in one of 400 at 4 kHz, and five in
        // one of 50 at 500 Hz.
        assert!(!trips(1e-3, 10) && trips(1e-3, 9));
        assert!(trips(2.5e-4, 10) && !trips(2.5e-4, 40) && !trips(2e-3, 5) && trips(2e-3, 4));
        assert_eq!(GarbledPackets::default().count(u16::MAX, 1e-3), LinkState::Broken);
        assert_eq!(GarbledPackets::default().count(1, f64::NAN), LinkState::Sound);
    }
}
