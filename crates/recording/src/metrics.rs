//! A run in the text format of Prometheus.
//!
//! Data in: every [`TickRecord`], through a [`Subscriber`], and what only others know
//! ([`Metrics::set_clients`], [`Metrics::set_recording`]). Data out: [`Metrics::text`]. Base units
//! throughout, as that format asks: seconds, newtons, metres.
//!
//! Counters begin at 0 with the run and never go back; a largest value is that of the run so far.

use std::fmt::{self, Write as _};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::{Subscriber, TickRecord};
use haptics::{Drive, Faults};

/// Content type of [`Metrics::text`].
pub const CONTENT_TYPE: &str = "text/plain; version=0.0.4; charset=utf-8";

/// Upper bounds of the latency buckets, µs. Fixed, so that several machines can be added up; 1 ms
/// is the period of the default rate.
const BOUNDS_US: [u64; 13] = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10_000];

/// States of the drive, in the order in which a run goes through them.
const PHASES: [(Drive, &str); 6] = [
    (Drive::Disabled, "disabled"),
    (Drive::Enabling, "enabling"),
    (Drive::Enabled, "enabled"),
    (Drive::Stopping, "stopping"),
    (Drive::Braking, "braking"),
    (Drive::Fault, "fault"),
];

/// The figures of one run, and the subscriber that fills them. `rate_hz` is that of the scene.
pub fn metrics_subscriber(rate_hz: u32) -> (Metrics, Subscriber) {
    let metrics = Metrics(Arc::new(Mutex::new(Counts { rate_hz, ..Counts::default() })));
    let filled = metrics.clone();
    let subscriber = Box::new(move |record: &TickRecord| {
        filled.counts().add(record);
        true
    });
    (metrics, subscriber)
}

/// The figures of one run. Clones share them.
#[derive(Clone, Debug)]
pub struct Metrics(Arc<Mutex<Counts>>);

/// How a recording goes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RecordingCounts {
    /// Records that are in it.
    pub records: u64,
    /// Records that the disk was too slow or too full for.
    pub dropped: u64,
}

impl Metrics {
    /// Clients that are connected now.
    pub fn set_clients(&self, n_clients: usize) {
        self.counts().n_clients = n_clients;
    }

    /// The recording that is under way, if one is.
    pub fn set_recording(&self, recording: Option<RecordingCounts>) {
        self.counts().recording = recording;
    }

    /// The whole exposition, [`CONTENT_TYPE`].
    pub fn text(&self) -> String {
        // Copied: the drain waits for no formatting.
        let counts = self.counts().clone();
        let mut page = Page(String::with_capacity(8192));
        // True invariant: writing to a string cannot fail.
        let _ = counts.write(&mut page);
        page.0
    }

    fn counts(&self) -> MutexGuard<'_, Counts> {
        // Numbers that a panic left half-way are still numbers.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[derive(Clone, Debug, Default)]
struct Counts {
    rate_hz: u32,
    last: Option<TickRecord>,
    ticks: u64,
    missed_deadlines: u64,
    dropped_records: u64,
    contact_ticks: u64,
    passivity_ticks: u64,
    stale_samples: u64,
    corrupt_packets: u64,
    lost_packets: u64,
    /// In the order of [`Faults::TABLE`].
    faults: [u64; Faults::TABLE.len()],
    max_force_n: f64,
    max_torque_nm: f64,
    max_depth_m: f64,
    wakeup: Latency,
    compute: Latency,
    device: Latency,
    n_clients: usize,
    recording: Option<RecordingCounts>,
}

#[derive(Clone, Debug, Default)]
struct Latency {
    /// Values at or below each bound and above the one before; the last takes what is longer.
    buckets: [u64; BOUNDS_US.len() + 1],
    sum_ns: u64,
}

impl Latency {
    fn add(&mut self, ns: u64) {
        let bucket = BOUNDS_US.partition_point(|bound_us| bound_us * 1000 < ns);
        if let Some(count) = self.buckets.get_mut(bucket) {
            *count += 1;
        }
        self.sum_ns = self.sum_ns.saturating_add(ns);
    }
}

impl Counts {
    fn add(&mut self, record: &TickRecord) {
        let TickRecord { input, output, .. } = record;
        self.ticks = record.tick + 1;
        if let Some(last) = &self.last {
            self.dropped_records += record.tick.saturating_sub(last.tick + 1);
            self.missed_deadlines += missed(last, record, self.rate_hz);
        }
        self.contact_ticks += u64::from(output.contacts > 0);
        self.passivity_ticks += u64::from(output.passivity_active);
        self.stale_samples += u64::from(input.sample.status != vps::spatial::SampleStatus::Fresh);
        self.corrupt_packets += u64::from(input.sample.corrupt_packets);
        self.lost_packets += u64::from(input.sample.lost_packets);
        let known = self.last.map_or(Faults::NONE, |last| last.output.faults);
        for ((fault, ..), count) in Faults::TABLE.into_iter().zip(&mut self.faults) {
            *count += u64::from(output.faults.contains(fault) && !known.contains(fault));
        }
        self.max_force_n = self.max_force_n.max(output.command_device.force.length());
        self.max_torque_nm = self.max_torque_nm.max(output.command_device.torque.length());
        self.max_depth_m = self.max_depth_m.max(output.max_depth_m);
        self.wakeup.add(record.wakeup_ns);
        self.compute.add(record.compute_ns);
        self.device.add(record.device_ns);
        self.last = Some(*record);
    }

    fn write(&self, page: &mut Page) -> fmt::Result {
        let last = self.last.unwrap_or_default();
        page.family("hapticd_build_info", "gauge", "Version of the program.")?;
        writeln!(page.0, "hapticd_build_info{{version=\"{}\"}} 1", env!("CARGO_PKG_VERSION"))?;
        page.family("hapticd_phase", "gauge", "1 for the state of the drive, 0 for the others.")?;
        for (drive, name) in PHASES {
            let is_now = self.last.is_some_and(|last| last.output.drive == drive);
            writeln!(page.0, "hapticd_phase{{phase=\"{name}\"}} {}", u8::from(is_now))?;
        }
        page.gauge(
            "hapticd_rate_hertz",
            "Ticks per second that the scene asks for.",
            f64::from(self.rate_hz),
        )?;
        page.gauge(
            "hapticd_scene_index",
            "Number of the scene: 0 the first, one more after each switch.",
            f64::from(last.scene_idx),
        )?;
        page.gauge(
            "hapticd_loop_seconds",
            "Loop time of the newest tick.",
            last.time_ns as f64 / 1e9,
        )?;

        page.counter("hapticd_ticks_total", "Ticks done.", self.ticks)?;
        page.counter(
            "hapticd_missed_deadlines_total",
            "Deadlines that passed without a tick.",
            self.missed_deadlines,
        )?;
        page.counter(
            "hapticd_dropped_records_total",
            "Ticks whose record found the ring full.",
            self.dropped_records,
        )?;
        page.counter(
            "hapticd_contact_ticks_total",
            "Ticks with at least one contact.",
            self.contact_ticks,
        )?;
        page.counter(
            "hapticd_passivity_ticks_total",
            "Ticks in which the passivity controller damped.",
            self.passivity_ticks,
        )?;
        page.counter(
            "hapticd_stale_samples_total",
            "Ticks without a fresh sample of the arm.",
            self.stale_samples,
        )?;
        page.counter(
            "hapticd_corrupt_packets_total",
            "Packets of the arm that were short or garbled.",
            self.corrupt_packets,
        )?;
        page.counter(
            "hapticd_lost_packets_total",
            "Packets that the arm's own counter says were lost.",
            self.lost_packets,
        )?;
        page.family("hapticd_faults_total", "counter", "Times that each fault appeared.")?;
        for ((_, name, _), count) in Faults::TABLE.into_iter().zip(self.faults) {
            writeln!(page.0, "hapticd_faults_total{{fault=\"{name}\"}} {count}")?;
        }

        let command = last.output.command_device;
        page.gauge(
            "hapticd_force_newtons",
            "Force of the newest command.",
            command.force.length(),
        )?;
        page.gauge(
            "hapticd_force_max_newtons",
            "Largest force of a command so far.",
            self.max_force_n,
        )?;
        page.gauge(
            "hapticd_torque_newton_metres",
            "Torque of the newest command.",
            command.torque.length(),
        )?;
        page.gauge(
            "hapticd_torque_max_newton_metres",
            "Largest torque of a command so far.",
            self.max_torque_nm,
        )?;
        page.gauge(
            "hapticd_depth_metres",
            "Depth of the deepest contact now.",
            last.output.max_depth_m,
        )?;
        page.gauge(
            "hapticd_depth_max_metres",
            "Depth of the deepest contact so far.",
            self.max_depth_m,
        )?;
        page.gauge("hapticd_contacts", "Points in contact now.", f64::from(last.output.contacts))?;

        page.histogram(
            "hapticd_wakeup_seconds",
            "How late ticks began after their deadline.",
            &self.wakeup,
        )?;
        page.histogram("hapticd_compute_seconds", "Duration of ticks.", &self.compute)?;
        page.histogram(
            "hapticd_device_seconds",
            "Duration of reading from and writing to the arm in a tick.",
            &self.device,
        )?;

        page.gauge("hapticd_clients", "Clients that are connected.", self.n_clients as f64)?;
        page.gauge(
            "hapticd_recording_active",
            "1 while a recording is written.",
            f64::from(u8::from(self.recording.is_some())),
        )?;
        let RecordingCounts { records, dropped } = self.recording.unwrap_or_default();
        page.gauge(
            "hapticd_recording_records",
            "Records in the recording that is under way.",
            records as f64,
        )?;
        page.gauge(
            "hapticd_recording_dropped",
            "Records that it lost, as the disk was too slow or too full.",
            dropped as f64,
        )
    }
}

/// Deadlines between two records that passed without a tick. A deadline is the beginning of a tick
/// less its lateness; where the arm sets the rate, the next one is a period after the last
/// beginning, which the last lateness accounts for.
fn missed(last: &TickRecord, record: &TickRecord, rate_hz: u32) -> u64 {
    let period_ns = 1_000_000_000 / u64::from(rate_hz.max(1));
    let late = |record: &TickRecord| record.wakeup_ns / period_ns;
    let due_ns = |record: &TickRecord| record.time_ns.saturating_sub_unsigned(record.wakeup_ns);
    let periods = due_ns(record).saturating_sub(due_ns(last)).max(0).unsigned_abs() / period_ns;
    periods.saturating_sub(record.tick.saturating_sub(last.tick) + late(last)) + late(record)
}

/// The text as it grows.
struct Page(String);

impl Page {
    fn family(&mut self, name: &str, kind: &str, help: &str) -> fmt::Result {
        writeln!(self.0, "# HELP {name} {help}\n# TYPE {name} {kind}")
    }

    fn gauge(&mut self, name: &str, help: &str, value: f64) -> fmt::Result {
        self.family(name, "gauge", help)?;
        // What is not a number is written as the format has it.
        match value {
            value if value.is_nan() => writeln!(self.0, "{name} NaN"),
            value if value.is_infinite() => {
                writeln!(self.0, "{name} {}Inf", if value > 0.0 { '+' } else { '-' })
            }
            value => writeln!(self.0, "{name} {value}"),
        }
    }

    fn counter(&mut self, name: &str, help: &str, count: u64) -> fmt::Result {
        self.family(name, "counter", help)?;
        writeln!(self.0, "{name} {count}")
    }

    fn histogram(&mut self, name: &str, help: &str, latency: &Latency) -> fmt::Result {
        self.family(name, "histogram", help)?;
        let mut below = 0;
        for (bound_us, count) in BOUNDS_US.into_iter().zip(latency.buckets) {
            below += count;
            writeln!(self.0, "{name}_bucket{{le=\"{}\"}} {below}", bound_us as f64 / 1e6)?;
        }
        let all: u64 = latency.buckets.iter().sum();
        writeln!(
            self.0,
            "{name}_bucket{{le=\"+Inf\"}} {all}\n{name}_sum {}\n{name}_count {all}",
            latency.sum_ns as f64 / 1e9
        )
    }
}

#[cfg(test)]
mod tests {
    use std::collections::{BTreeMap, BTreeSet};

    use super::*;
    use engine::servo::DeadlineGrid;
    use haptics::TickOutput;
    use rt::clock::{Clock, ClockKind};

    /// One sample: name, labels as written, value.
    type Sample = (String, String, f64);

    /// Reads an exposition and refuses what Prometheus would refuse: families in one piece, each
    /// with HELP and TYPE before its samples, names of the right letters, no series twice,
    /// histograms that add up.
    fn parse(text: &str) -> BTreeMap<String, (String, Vec<Sample>)> {
        assert!(text.ends_with('\n'), "the last line ends");
        let is_name = |name: &str| {
            let letter = |c: char| c.is_ascii_lowercase() || c == '_';
            name.starts_with(letter) && name.chars().all(|c| letter(c) || c.is_ascii_digit())
        };
        let mut families: BTreeMap<String, (String, Vec<Sample>)> = BTreeMap::new();
        let mut helped = String::new();
        let mut current = String::new();
        let mut seen = BTreeSet::new();
        for line in text.lines() {
            if let Some(rest) = line.strip_prefix("# HELP ") {
                let (name, help) = rest.split_once(' ').expect("a name and a text");
                assert!(is_name(name) && !help.is_empty(), "{line}");
                helped = name.to_owned();
            } else if let Some(rest) = line.strip_prefix("# TYPE ") {
                let (name, kind) = rest.split_once(' ').expect("a name and a type");
                assert!(
                    name == helped && ["gauge", "counter", "histogram"].contains(&kind),
                    "{line}"
                );
                assert_eq!(name.ends_with("_total"), kind == "counter", "{line}");
                assert!(
                    families.insert(name.to_owned(), (kind.to_owned(), Vec::new())).is_none(),
                    "{name} twice"
                );
                current = name.to_owned();
            } else {
                let (series, value) = line.rsplit_once(' ').expect("a series and a value");
                assert!(seen.insert(series.to_owned()), "{series} twice");
                let (name, labels) = match series.split_once('{') {
                    Some((name, labels)) => (name, labels.strip_suffix('}').expect("a bracket")),
                    None => (series, ""),
                };
                for label in labels.split(',').filter(|label| !label.is_empty()) {
                    let (name, value) = label.split_once('=').expect("a label");
                    assert!(
                        is_name(name)
                            && value.len() >= 2
                            && value.starts_with('"')
                            && value.ends_with('"'),
                        "{line}"
                    );
                }
                let (kind, samples) = families.get_mut(&current).expect("a TYPE before");
                let suffix = name.strip_prefix(current.as_str()).expect("of the family before");
                let allowed: &[&str] =
                    if kind == "histogram" { &["_bucket", "_sum", "_count"] } else { &[""] };
                assert!(allowed.contains(&suffix), "{line}");
                samples.push((
                    name.to_owned(),
                    labels.to_owned(),
                    value.parse().expect("a number"),
                ));
            }
        }
        for (name, (kind, samples)) in &families {
            assert!(!samples.is_empty(), "{name} is empty");
            if kind != "histogram" {
                continue;
            }
            let buckets: Vec<(f64, f64)> = samples
                .iter()
                .filter_map(|(_, labels, value)| {
                    let bound = labels.strip_prefix("le=\"")?.strip_suffix('"')?;
                    Some((
                        if bound == "+Inf" {
                            f64::INFINITY
                        } else {
                            bound.parse().expect("a bound")
                        },
                        *value,
                    ))
                })
                .collect();
            assert!(buckets.is_sorted_by(|a, b| a.0 < b.0 && a.1 <= b.1), "{name}: {buckets:?}");
            let count = samples
                .iter()
                .find(|(sample, ..)| *sample == format!("{name}_count"))
                .expect("a count");
            assert_eq!(buckets.last(), Some(&(f64::INFINITY, count.2)), "{name}");
        }
        families
    }

    fn value(metrics: &Metrics, series: &str) -> f64 {
        let text = metrics.text();
        let line = text
            .lines()
            .find(|line| line.strip_prefix(series).is_some_and(|rest| rest.starts_with(' ')));
        let line = line.unwrap_or_else(|| panic!("no {series} in\n{text}"));
        line.rsplit_once(' ').expect("a value").1.parse().expect("a number")
    }

    fn record(tick: u64, time_ns: i64) -> TickRecord {
        TickRecord { tick, time_ns, ..TickRecord::default() }
    }

    #[test]
    fn the_text_is_an_exposition_before_and_after_the_first_tick() {
        let (metrics, mut subscriber) = metrics_subscriber(1000);
        let before = parse(&metrics.text());
        assert!(subscriber(&record(0, 0)));
        let after = parse(&metrics.text());
        assert_eq!(
            before.keys().collect::<Vec<_>>(),
            after.keys().collect::<Vec<_>>(),
            "families neither come nor go"
        );
        assert_eq!(after["hapticd_phase"].1.iter().map(|(.., value)| value).sum::<f64>(), 1.0);
        assert_eq!(after["hapticd_faults_total"].1.len(), Faults::TABLE.len());
    }

    #[test]
    fn what_happened_is_counted_once() {
        let (metrics, mut subscriber) = metrics_subscriber(1000);
        let output = |faults, contacts, max_depth_m| TickOutput {
            faults,
            contacts,
            max_depth_m,
            ..TickOutput::default()
        };
        for (tick, output) in [
            output(Faults::NONE, 0, 0.0),
            output(Faults::NONE, 3, 2e-4),
            output(Faults::STALE, 1, 1e-4),
            output(Faults::STALE | Faults::SPEED, 0, 0.0),
            output(Faults::NONE, 0, 0.0),
            output(Faults::STALE, 0, 0.0),
        ]
        .into_iter()
        .enumerate()
        {
            subscriber(&TickRecord { output, ..record(tick as u64, tick as i64 * 1_000_000) });
        }
        let text = metrics.text();
        parse(&text);
        for (series, expected) in [
            ("hapticd_ticks_total", 6.0),
            ("hapticd_contact_ticks_total", 2.0),
            ("hapticd_faults_total{fault=\"stale\"}", 2.0),
            ("hapticd_faults_total{fault=\"speed\"}", 1.0),
            ("hapticd_faults_total{fault=\"panic\"}", 0.0),
            ("hapticd_depth_metres", 0.0),
            ("hapticd_depth_max_metres", 2e-4),
            ("hapticd_missed_deadlines_total", 0.0),
        ] {
            assert_eq!(value(&metrics, series), expected, "{series} in\n{text}");
        }
    }

    #[test]
    fn latencies_lie_in_the_bucket_that_ends_above_them() {
        let (metrics, mut subscriber) = metrics_subscriber(1000);
        for (tick, compute_ns) in [0, 1000, 1001, 180_000, 50_000_000].into_iter().enumerate() {
            subscriber(&TickRecord { compute_ns, ..record(tick as u64, tick as i64 * 1_000_000) });
        }
        for (series, expected) in [
            ("hapticd_compute_seconds_bucket{le=\"0.000001\"}", 2.0),
            ("hapticd_compute_seconds_bucket{le=\"0.000002\"}", 3.0),
            ("hapticd_compute_seconds_bucket{le=\"0.0002\"}", 4.0),
            ("hapticd_compute_seconds_bucket{le=\"0.01\"}", 4.0),
            ("hapticd_compute_seconds_bucket{le=\"+Inf\"}", 5.0),
            ("hapticd_compute_seconds_sum", 0.050182001),
            ("hapticd_wakeup_seconds_count", 5.0),
        ] {
            assert_eq!(value(&metrics, series), expected, "{series}");
        }
    }

    #[test]
    fn a_record_that_was_lost_is_no_missed_deadline() {
        let (metrics, mut subscriber) = metrics_subscriber(1000);
        subscriber(&record(0, 0));
        subscriber(&record(5, 5_000_000));
        assert_eq!(value(&metrics, "hapticd_dropped_records_total"), 4.0);
        assert_eq!(value(&metrics, "hapticd_missed_deadlines_total"), 0.0);
    }

    #[test]
    fn what_others_know_is_shown() {
        let (metrics, _tap) = metrics_subscriber(1000);
        metrics.set_clients(3);
        metrics.set_recording(Some(RecordingCounts { records: 12, dropped: 1 }));
        for (series, expected) in [
            ("hapticd_clients", 3.0),
            ("hapticd_recording_active", 1.0),
            ("hapticd_recording_records", 12.0),
            ("hapticd_recording_dropped", 1.0),
        ] {
            assert_eq!(value(&metrics, series), expected);
        }
    }

    /// A clock whose n-th sleep ends late by the n-th entry.
    struct LateClock {
        now_ns: i64,
        late_ns: std::vec::IntoIter<i64>,
    }

    impl Clock for LateClock {
        fn kind(&self) -> ClockKind {
            ClockKind::Real
        }

        fn now_ns(&mut self) -> i64 {
            self.now_ns
        }

        fn sleep_until(&mut self, deadline_ns: i64) {
            self.now_ns = self.now_ns.max(deadline_ns) + self.late_ns.next().unwrap_or(0);
        }
    }

    #[test]
    fn missed_deadlines_of_the_metrics_are_those_that_the_grid_counts() {
        const T: i64 = 1_000_000;
        let (metrics, mut subscriber) = metrics_subscriber(1000);
        let late_ns = vec![0, 2 * T + T / 2, 70_000, 0, 0].into_iter();
        let mut clock = LateClock { now_ns: 0, late_ns };
        let mut grid = DeadlineGrid::new(0, T);
        let mut missed = 0;
        for (tick, busy_ns) in (0..).zip([0, 300_000, 0, T + T / 2, 0]) {
            clock.now_ns += busy_ns;
            let due = grid.wait(&mut clock);
            missed += due.missed;
            subscriber(&TickRecord {
                tick,
                time_ns: due.now_ns,
                wakeup_ns: due.late_ns,
                ..TickRecord::default()
            });
        }
        assert_eq!(missed, 3);
        assert!(metrics.text().lines().any(|line| line == "hapticd_missed_deadlines_total 3"));
    }
}
