//! Values over time: the smallest and the largest of each stretch, so that nothing that was there
//! is missing from the picture.

use crate::TickRecord;

/// Stretches that a picture shows at most: more than it has columns.
const MOST: usize = 1600;

/// What is drawn over time: first of each.
pub(super) const CONTACT_FORCE: usize = 0;
pub(super) const COMMAND_FORCE: usize = 3;
pub(super) const CONTACT_TORQUE: usize = 6;
pub(super) const COMMAND_TORQUE: usize = 9;
pub(super) const DEPTH: usize = 12;
pub(super) const CLEARANCE: usize = 13;
pub(super) const COMPUTE: usize = 14;
pub(super) const WAKEUP: usize = 15;
const N_VALUES: usize = 16;

/// A stretch of time.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stretch {
    pub(super) time_s: f64,
    pub(super) least: [f64; N_VALUES],
    pub(super) most: [f64; N_VALUES],
}

/// Stretches of equal numbers of ticks.
#[derive(Debug)]
pub(super) struct Trace {
    pub(super) stretches: Vec<Stretch>,
    ticks_each: u64,
    ticks_in_last: u64,
}

impl Default for Trace {
    fn default() -> Self {
        Self { stretches: Vec::new(), ticks_each: 1, ticks_in_last: 1 }
    }
}

impl Trace {
    pub(super) fn add(&mut self, record: &TickRecord) {
        let output = &record.output;
        let [contact, command] = [output.contact_world, output.command_device];
        let mut values = [0.0; N_VALUES];
        for (first, components) in [
            (CONTACT_FORCE, contact.force),
            (COMMAND_FORCE, command.force),
            (CONTACT_TORQUE, contact.torque * 1e3),
            (COMMAND_TORQUE, command.torque * 1e3),
        ] {
            values[first..first + 3].copy_from_slice(&components.to_array());
        }
        values[DEPTH] = output.max_depth_m * 1e3;
        values[CLEARANCE] = output.clearance_m * 1e3;
        values[COMPUTE] = record.compute_ns as f64 * 1e-3;
        values[WAKEUP] = record.wakeup_ns as f64 * 1e-3;
        let time_s = record.time_ns as f64 * 1e-9;
        match self.stretches.last_mut().filter(|_| self.ticks_in_last < self.ticks_each) {
            Some(last) => {
                last.join(&Stretch { time_s, least: values, most: values });
                self.ticks_in_last += 1;
            }
            None => {
                self.stretches.push(Stretch { time_s, least: values, most: values });
                self.ticks_in_last = 1;
            }
        }
        if self.stretches.len() > MOST {
            self.halve();
        }
    }

    /// One of the values: when, least and most.
    pub(super) fn rows(&self, value: usize) -> Vec<[f64; 3]> {
        self.stretches
            .iter()
            .map(|stretch| [stretch.time_s, stretch.least[value], stretch.most[value]])
            .collect()
    }

    /// Joins every two stretches.
    fn halve(&mut self) {
        let is_odd = !self.stretches.len().is_multiple_of(2);
        let joined = self.stretches.chunks(2).map(|pair| {
            let mut pair = pair.iter().copied();
            let mut first = pair.next().unwrap_or(Stretch {
                time_s: 0.0,
                least: [f64::NAN; N_VALUES],
                most: [f64::NAN; N_VALUES],
            });
            pair.for_each(|second| first.join(&second));
            first
        });
        self.stretches = joined.collect();
        self.ticks_in_last += if is_odd { 0 } else { self.ticks_each };
        self.ticks_each *= 2;
    }
}

impl Stretch {
    fn join(&mut self, next: &Self) {
        // What is not a number gives way to what is.
        for (least, other) in self.least.iter_mut().zip(next.least) {
            *least = least.min(other);
        }
        for (most, other) in self.most.iter_mut().zip(next.most) {
            *most = most.max(other);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn however_long_it_is_no_peak_is_lost() {
        let mut trace = Trace::default();
        let n_ticks = 10 * MOST as u64 + 37;
        for tick in 0..n_ticks {
            let mut record =
                TickRecord { tick, time_ns: tick as i64 * 1_000_000, ..TickRecord::default() };
            record.output.max_depth_m = if tick == 12_345 { 7e-3 } else { 1e-3 };
            trace.add(&record);
        }
        assert!(trace.stretches.len() <= MOST && trace.stretches.len() > MOST / 3);
        let peaks: Vec<f64> = trace
            .stretches
            .iter()
            .filter(|stretch| stretch.most[DEPTH] > 6.0)
            .map(|stretch| stretch.time_s)
            .collect();
        assert!(peaks.len() == 1 && (peaks[0] - 12.345).abs() < 0.1, "{peaks:?}");
        assert!(trace.stretches.iter().all(|stretch| stretch.least[DEPTH] == 1.0));
        assert!(trace.stretches.is_sorted_by(|a, b| a.time_s < b.time_s));
    }
}
