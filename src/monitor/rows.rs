//! What happened between two states: one row of every tick, or of many ticks their extremes.

use serde::{Serialize, Serializer};

use recording::TickRecord;

/// What a plot needs of one tick: time s, force N, depth mm, computing µs, wake-up µs.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct HistoryRow {
    pub(super) time_s: f64,
    /// Force, depth, computing, wake-up.
    pub(super) values: [f32; 4],
}

impl HistoryRow {
    pub(super) fn of(record: &TickRecord) -> Self {
        let us = |ns: u64| (ns as f64 * 1e-3) as f32;
        Self {
            time_s: record.time_ns as f64 * 1e-9,
            values: [
                record.rendered_device.force.length() as f32,
                (record.output.max_depth_m * 1e3) as f32,
                us(record.compute_ns),
                us(record.wakeup_ns),
            ],
        }
    }
}

impl Serialize for HistoryRow {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        // Steps that no plot shows: digits that no reader needs are most of the bytes.
        let step = |value: f32, per_one: f64| (f64::from(value) * per_one).round() / per_one;
        let [force_n, depth_mm, compute_us, wakeup_us] = self.values;
        let row =
            [step(force_n, 1e4), step(depth_mm, 1e5), step(compute_us, 1e2), step(wakeup_us, 1e2)];
        ((self.time_s * 1e6).round() / 1e6, row[0], row[1], row[2], row[3]).serialize(serializer)
    }
}

/// Rows for one message: at most `most`; of more, the smallest and the largest values of some
/// stretches each.
pub(super) fn reduced(rows: &[HistoryRow], most: usize) -> Vec<HistoryRow> {
    if rows.len() <= most {
        return rows.to_vec();
    }
    let stretch = rows.len().div_ceil(most / 2);
    let envelope = |rows: &[HistoryRow], pick: fn(f32, f32) -> f32, time_s: f64| {
        let values = rows
            .iter()
            .map(|row| row.values)
            .reduce(|a, b| core::array::from_fn(|n| pick(a[n], b[n])));
        values.map(|values| HistoryRow { time_s, values })
    };
    let both = |rows: &[HistoryRow]| {
        let first = rows.first().map_or(0.0, |row| row.time_s);
        let last = rows.last().map_or(0.0, |row| row.time_s);
        envelope(rows, f32::min, first)
            .into_iter()
            .chain(envelope(rows, f32::max, last))
            .collect::<Vec<_>>()
    };
    rows.chunks(stretch).flat_map(both).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn many_rows_become_few_that_keep_the_extremes() {
        let row = |n: usize| HistoryRow {
            time_s: n as f64,
            values: [if n == 501 { 9.0 } else { 1.0 }, n as f32, 0.0, 0.0],
        };
        let rows: Vec<_> = (0..1000).map(row).collect();
        assert_eq!(reduced(&rows[..100], 100), rows[..100]);
        let few = reduced(&rows, 100);
        assert!(few.len() <= 100 && few.windows(2).all(|pair| pair[0].time_s <= pair[1].time_s));
        let most = |n: usize| few.iter().map(|row| row.values[n]).fold(0.0, f32::max);
        assert_eq!((most(0), most(1)), (9.0, 999.0));
    }
}
