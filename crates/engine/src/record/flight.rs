//! The flight recorder: the last ticks before a fault.

use super::TickRecord;

/// A ring of the last records, allocated up front, that stops at the first fault.
#[derive(Clone, Debug)]
pub struct FlightRecorder {
    /// `[capacity]`, ring in tick order once it has wrapped.
    ring: Box<[TickRecord]>,
    n_noted: usize,
    frozen: bool,
}

impl FlightRecorder {
    /// Ticks that are kept by default: one second.
    pub const DEFAULT_TICKS: usize = 1000;

    /// A recorder of the last `n_ticks` ticks, its pages touched. RT: start-up only.
    pub fn new(n_ticks: usize) -> Self {
        // Not `vec![default; n]` alone: a record of zero bits could come from untouched zero pages.
        let mut ring = vec![TickRecord::default(); n_ticks.max(1)].into_boxed_slice();
        core::hint::black_box(&mut ring[..])
            .fill(TickRecord { tick: u64::MAX, ..TickRecord::default() });
        Self { ring, n_noted: 0, frozen: false }
    }

    /// Takes a record; ignored once frozen. RT: safe, constant time.
    pub fn note(&mut self, record: &TickRecord) {
        if self.frozen {
            return;
        }
        let capacity = self.ring.len();
        if let Some(slot) = self.ring.get_mut(self.n_noted % capacity) {
            *slot = *record;
            self.n_noted += 1;
        }
    }

    /// Forgets everything and takes records again. RT: safe.
    pub fn clear(&mut self) {
        self.n_noted = 0;
        self.frozen = false;
    }

    /// Keeps what is there from now on. RT: safe.
    pub fn freeze(&mut self) {
        self.frozen = true;
    }

    /// True after [`FlightRecorder::freeze`].
    pub fn is_frozen(&self) -> bool {
        self.frozen
    }

    /// The records, oldest first.
    pub fn records(&self) -> impl Iterator<Item = &TickRecord> {
        let capacity = self.ring.len();
        let oldest = self.n_noted.saturating_sub(capacity);
        (oldest..self.n_noted).filter_map(move |idx| self.ring.get(idx % capacity))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(tick: u64) -> TickRecord {
        TickRecord { tick, ..TickRecord::default() }
    }

    fn ticks(recorder: &FlightRecorder) -> Vec<u64> {
        recorder.records().map(|record| record.tick).collect()
    }

    #[test]
    fn the_last_records_are_kept_in_order() {
        let mut recorder = FlightRecorder::new(3);
        assert!(ticks(&recorder).is_empty());
        recorder.note(&record(0));
        assert_eq!(ticks(&recorder), [0]);
        (1..8).for_each(|tick| recorder.note(&record(tick)));
        assert_eq!(ticks(&recorder), [5, 6, 7]);
    }

    #[test]
    fn a_frozen_recorder_takes_nothing_more() {
        let mut recorder = FlightRecorder::new(3);
        (0..5).for_each(|tick| recorder.note(&record(tick)));
        recorder.freeze();
        recorder.note(&record(5));
        assert_eq!(ticks(&recorder), [2, 3, 4]);
    }
}
