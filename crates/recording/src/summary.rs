//! What a run came to: latency histograms and extremes, and their JSON form.

use std::sync::{Arc, Mutex, PoisonError};

use hdrhistogram::Histogram;
use serde::Serialize;

use super::{Subscriber, TickRecord};
use haptics::Faults;
use vps::spatial::{NamedPose, Pose, SampleStatus, Wrench};

/// Largest latency that is distinguished, ns: ten seconds. Longer ones count as this long.
const LONGEST_NS: u64 = 10_000_000_000;
/// Significant digits of a latency.
const LATENCY_DIGITS: u8 = 3;

impl Totals {
    /// The deepest contact, in words.
    pub fn deepest(&self) -> String {
        format!("deepest {}{:.4} mm", at_least(self.depth_is_bound), self.max_depth_m * 1e3)
    }
}

/// Before a depth: where the distances of a part end it is known as a bound only.
pub fn at_least(depth_is_bound: bool) -> &'static str {
    if depth_is_bound { "at least " } else { "" }
}

/// Statistics of a run while it goes on.
#[derive(Clone, Debug)]
pub struct Summary {
    wakeup_ns: Histogram<u64>,
    compute_ns: Histogram<u64>,
    device_ns: Histogram<u64>,
    n_ticks: u64,
    first_time_ns: i64,
    last_time_ns: i64,
    max_force_n: f64,
    max_torque_nm: f64,
    max_depth_m: f64,
    depth_is_bound: bool,
    contact_ticks: u64,
    points_left_out: u32,
    lowest_energy_j: f64,
    passivity_ticks: u64,
    delay_ticks: u32,
    stale_samples: u64,
    rendered: Rendered,
    /// What the record before commanded, and what the motors made of it.
    last_sent: Option<(Wrench, Wrench)>,
    corrupt_packets: u64,
    lost_packets: u64,
    final_pose: Pose,
    faults: Faults,
    object_work_j: f64,
    swaps: Vec<SwapSummary>,
}

impl Summary {
    /// Before the first record; allocates all histogram buckets.
    pub fn new() -> Self {
        Self {
            wakeup_ns: latency_histogram(),
            compute_ns: latency_histogram(),
            device_ns: latency_histogram(),
            n_ticks: 0,
            first_time_ns: 0,
            last_time_ns: 0,
            max_force_n: 0.0,
            max_torque_nm: 0.0,
            max_depth_m: 0.0,
            depth_is_bound: false,
            contact_ticks: 0,
            points_left_out: 0,
            lowest_energy_j: 0.0,
            passivity_ticks: 0,
            delay_ticks: 0,
            stale_samples: 0,
            rendered: Rendered::default(),
            last_sent: None,
            corrupt_packets: 0,
            lost_packets: 0,
            final_pose: Pose::IDENTITY,
            faults: Faults::NONE,
            object_work_j: 0.0,
            swaps: Vec::new(),
        }
    }

    /// Takes one record.
    pub fn add(&mut self, record: &TickRecord) {
        let output = &record.output;
        if self.n_ticks == 0 {
            self.first_time_ns = record.time_ns;
        }
        self.n_ticks += 1;
        self.last_time_ns = record.time_ns;
        self.wakeup_ns.saturating_record(record.wakeup_ns);
        self.compute_ns.saturating_record(record.compute_ns);
        self.device_ns.saturating_record(record.device_ns);
        self.max_force_n = self.max_force_n.max(output.command_device.force.length());
        self.max_torque_nm = self.max_torque_nm.max(output.command_device.torque.length());
        self.max_depth_m = self.max_depth_m.max(output.max_depth_m);
        self.depth_is_bound |= output.depth_is_bound;
        self.contact_ticks += u64::from(output.contacts > 0);
        self.points_left_out = self.points_left_out.max(output.points_left_out);
        self.lowest_energy_j = self.lowest_energy_j.min(output.energy_j);
        self.passivity_ticks += u64::from(output.passivity_active);
        self.delay_ticks = self.delay_ticks.max(output.delay_ticks);
        self.stale_samples += u64::from(record.input.sample.status != SampleStatus::Fresh);
        self.rendered.add(record, self.last_sent.as_ref());
        self.last_sent = Some((output.command_device, record.rendered_device));
        self.corrupt_packets += u64::from(record.input.sample.corrupt_packets);
        self.lost_packets += u64::from(record.input.sample.lost_packets);
        self.final_pose = output.world_from_tool;
        self.faults |= output.faults;
        self.object_work_j = self.object_work_j.max(output.object_work_j);
        if record.scene_idx > self.swaps.last().map_or(0, |swap| swap.scene_idx) {
            let at_s = record.time_ns as f64 * 1e-9;
            self.swaps.push(SwapSummary { scene_idx: record.scene_idx, tick: record.tick, at_s });
        }
    }

    /// When scenes were swapped.
    pub fn swaps(&self) -> &[SwapSummary] {
        &self.swaps
    }

    /// Records so far.
    pub(super) fn ticks(&self) -> u64 {
        self.n_ticks
    }

    /// The result of a run, from the records and what the servo itself counted.
    pub fn totals(&self, counted: LoopCounts) -> Totals {
        let period_s = 1.0 / f64::from(counted.rate_hz);
        let duration_s = if self.n_ticks == 0 {
            0.0
        } else {
            (self.last_time_ns - self.first_time_ns) as f64 * 1e-9 + period_s
        };
        Totals {
            ticks: counted.ticks,
            duration_s,
            rate_hz: counted.rate_hz,
            clock: counted.clock,
            missed_deadlines: counted.missed_deadlines,
            dropped_records: counted.dropped_records,
            stale_samples: self.stale_samples,
            corrupt_packets: self.corrupt_packets,
            lost_packets: self.lost_packets,
            wakeup_us: LatencySummary::of(&self.wakeup_ns),
            compute_us: LatencySummary::of(&self.compute_ns),
            device_us: LatencySummary::of(&self.device_ns),
            histograms_us: Histograms {
                wakeup: bins(&self.wakeup_ns),
                compute: bins(&self.compute_ns),
            },
            max_force_n: self.max_force_n,
            max_torque_nm: self.max_torque_nm,
            rendered: self.rendered,
            max_depth_m: self.max_depth_m,
            depth_is_bound: self.depth_is_bound,
            contact_ticks: self.contact_ticks,
            contact_budget_points: counted.contact_budget_points,
            points_left_out: self.points_left_out,
            lowest_energy_j: self.lowest_energy_j,
            passivity_ticks: self.passivity_ticks,
            object_work_j: self.object_work_j,
            delay_ticks: self.delay_ticks,
            faults: (self.faults | counted.faults).names().collect(),
            realtime: counted.realtime,
            final_pose: self.final_pose.into(),
        }
    }
}

impl Default for Summary {
    fn default() -> Self {
        Self::new()
    }
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "as serde asks")]
fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

/// The summary of one run while it goes on.
#[derive(Debug, Default)]
pub struct SharedSummary(Arc<Mutex<Summary>>);

impl SharedSummary {
    /// What has come in; empty from then on.
    pub fn take(&self) -> Summary {
        core::mem::take(&mut *self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

/// The summary of one run, and the subscriber that fills it.
pub fn summary_subscriber() -> (SharedSummary, Subscriber) {
    let summary = SharedSummary::default();
    let filled = summary.0.clone();
    let subscriber = Box::new(move |record: &TickRecord| {
        filled.lock().unwrap_or_else(PoisonError::into_inner).add(record);
        true
    });
    (summary, subscriber)
}

/// One scene that took the place of another.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SwapSummary {
    /// Number of the scene; the first one, which replaced none, is 0.
    pub scene_idx: u32,
    /// Its first tick, counted from the start of the run.
    pub tick: u64,
    /// Loop time of that tick, s.
    pub at_s: f64,
}

/// What the servo counts itself, as records can be lost.
#[derive(Clone, Copy, Debug)]
pub struct LoopCounts {
    /// Ticks done.
    pub ticks: u64,
    /// Configured rate, Hz.
    pub rate_hz: u32,
    /// Name of the clock.
    pub clock: &'static str,
    /// Deadlines that passed without a tick.
    pub missed_deadlines: u64,
    /// Records that found the ring full.
    pub dropped_records: u64,
    /// What a contact query might look at; `None`: everything.
    pub contact_budget_points: Option<u32>,
    /// Every fault of the run.
    pub faults: Faults,
    /// How the loop was scheduled.
    pub realtime: RealtimeSummary,
}

/// `wakeup_us`, `compute_us`, `device_us`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct LatencySummary {
    /// Median, µs.
    pub p50: f64,
    /// 99th percentile, µs.
    pub p99: f64,
    /// 99.9th percentile, µs.
    pub p999: f64,
    /// Largest, µs.
    pub max: f64,
}

impl LatencySummary {
    fn of(histogram_ns: &Histogram<u64>) -> Self {
        // Divided: 3453 ns is 3.453 µs and not 3.4530000000000003.
        let us = |ns: u64| ns as f64 / 1e3;
        Self {
            p50: us(histogram_ns.value_at_quantile(0.5)),
            p99: us(histogram_ns.value_at_quantile(0.99)),
            p999: us(histogram_ns.value_at_quantile(0.999)),
            max: us(histogram_ns.max()),
        }
    }
}

/// Ticks by how late they were and how long they took: pairs of an upper bound (1, 2, 5, 10 … µs)
/// and the ticks at or below it and above the bound before, up to the longest.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Histograms {
    /// Lateness.
    pub wakeup: Vec<[u64; 2]>,
    /// Duration of the tick.
    pub compute: Vec<[u64; 2]>,
}

fn bins(histogram_ns: &Histogram<u64>) -> Vec<[u64; 2]> {
    let bounds_us = (0..=7).flat_map(|power| [1, 2, 5].map(|factor| factor * 10_u64.pow(power)));
    let mut bins: Vec<[u64; 2]> = bounds_us.map(|bound_us| [bound_us, 0]).collect();
    for value in histogram_ns.iter_recorded() {
        let bin = bins.partition_point(|[bound_us, _]| bound_us * 1000 < value.value_iterated_to());
        if let Some([_, count]) = bins.get_mut(bin) {
            *count += value.count_at_value();
        }
    }
    let n_used = bins.iter().rposition(|[_, count]| *count > 0).map_or(0, |last| last + 1);
    bins.truncate(n_used);
    bins
}

/// How the loop was scheduled.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct RealtimeSummary {
    /// `fifo` or `other`.
    pub policy: &'static str,
    /// Real-time priority; 0 under `other`.
    pub priority: u8,
    /// Processor that the loop was pinned to.
    pub cpu: Option<usize>,
    /// Every page was locked.
    pub memory_locked: bool,
    /// The kernel is built with PREEMPT_RT.
    pub kernel_rt: bool,
}

/// What the motors made, of the command and beside it. An arm with three motors drops the torque,
/// and a motor at its limit weakens all of them together.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Rendered {
    /// Largest |F| that the motors made, all of it together, N.
    pub max_force_n: f64,
    /// Largest |τ| that the motors made, all of it together, N·m.
    pub max_torque_nm: f64,
    /// Largest |F| of it beside the command, N: gravity compensation and damping of joints.
    pub max_beside_force_n: f64,
    /// Largest |τ| of it beside the command, N·m.
    pub max_beside_torque_nm: f64,
    /// Largest torque that was computed for the hand and that no motor makes, N·m.
    pub max_dropped_torque_nm: f64,
    /// Largest force that was computed for the hand and that no motor makes, N.
    pub max_dropped_force_n: f64,
    /// Ticks in which the limits of the motors weakened the command: their own, and the caps of the
    /// profile.
    pub weakened_ticks: u64,
    /// Ticks whose command did not go out: the motors kept an older one, or the link refused it.
    pub unsent_ticks: u64,
}

impl Rendered {
    /// A command counts as weakened below this share of it: above lies rounding to the units of the
    /// wire.
    const WEAKENED: f64 = 0.999;

    /// `last`: the record before this one.
    fn add(&mut self, record: &TickRecord, last: Option<&(Wrench, Wrench)>) {
        let rendered = record.rendered_device;
        let command = record.output.command_device;
        let commanded = record.output.commanded_device;
        let beside = record.beside_device;
        let made = rendered + beside;
        self.max_force_n = self.max_force_n.max(made.force.length());
        self.max_torque_nm = self.max_torque_nm.max(made.torque.length());
        self.max_beside_force_n = self.max_beside_force_n.max(beside.force.length());
        self.max_beside_torque_nm = self.max_beside_torque_nm.max(beside.torque.length());
        // Against what the renderer wanted on the axes without a motor; what the motors' limits
        // take is counted apart.
        self.max_dropped_force_n =
            self.max_dropped_force_n.max((commanded.force - command.force).length());
        self.max_dropped_torque_nm =
            self.max_dropped_torque_nm.max((commanded.torque - command.torque).length());
        // A driver that could not send in time answers with what the motors still make; one whose
        // link refused it, with nothing.
        let kept = last.is_some_and(|(last_command, last_rendered)| {
            rendered == *last_rendered && command != *last_command
        });
        let refused = rendered == Wrench::ZERO && command != Wrench::ZERO;
        let weakened = rendered.force.length() < Self::WEAKENED * command.force.length()
            || rendered.torque.length() < Self::WEAKENED * command.torque.length();
        self.weakened_ticks += u64::from(weakened && !kept && !refused);
        self.unsent_ticks += u64::from(kept && weakened || refused);
    }
}

/// The result of a run: the object of `run --json`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Totals {
    /// Ticks done.
    pub ticks: u64,
    /// Loop time from the first tick to the end of the last one, s.
    pub duration_s: f64,
    /// Configured rate, Hz.
    pub rate_hz: u32,
    /// `real` or `virtual`.
    pub clock: &'static str,
    /// Deadlines that passed without a tick.
    pub missed_deadlines: u64,
    /// Records that found the ring full; the extremes below do not know of them.
    pub dropped_records: u64,
    /// Ticks without a fresh sample.
    pub stale_samples: u64,
    /// Reports that were short, garbled or failed their check.
    pub corrupt_packets: u64,
    /// Reports that the arm's own counter says were lost.
    pub lost_packets: u64,
    /// Lateness of the ticks.
    pub wakeup_us: LatencySummary,
    /// Duration of the ticks.
    pub compute_us: LatencySummary,
    /// Duration of reading and writing.
    pub device_us: LatencySummary,
    /// The first two in full.
    pub histograms_us: Histograms,
    /// Largest |F| of the command.
    pub max_force_n: f64,
    /// Largest |τ| of the command.
    pub max_torque_nm: f64,
    /// What the motors made of it.
    pub rendered: Rendered,
    /// Deepest penetration, m; 0 without contact.
    pub max_depth_m: f64,
    /// It was so deep at least: the field of an object ends there.
    pub depth_is_bound: bool,
    /// Ticks with at least one contact.
    pub contact_ticks: u64,
    /// Points that a contact query might look at in one tick, of `contact.time_budget_us`; `None`:
    /// as many as it takes.
    pub contact_budget_points: Option<u32>,
    /// Most points that this left out in one tick; others stood for them.
    pub points_left_out: u32,
    /// Lowest energy that the arm has taken from the hand, J: below 0 when it gave more than it
    /// took.
    pub lowest_energy_j: f64,
    /// Ticks in which the passivity controller injected damping.
    pub passivity_ticks: u64,
    /// Most energy that moving objects have put into the hand since an enable, J: `lowest_energy_j`
    /// may be lower by so much. Left out of a report where none has.
    #[serde(skip_serializing_if = "is_zero")]
    pub object_work_j: f64,
    /// Longest measured round trip, ticks; 0 where the arm does not measure it.
    pub delay_ticks: u32,
    /// Names of the faults.
    pub faults: Vec<&'static str>,
    /// How the loop was scheduled.
    pub realtime: RealtimeSummary,
    /// Tool in the world at the end.
    pub final_pose: NamedPose,
}

fn latency_histogram() -> Histogram<u64> {
    match Histogram::new_with_bounds(1, LONGEST_NS, LATENCY_DIGITS) {
        Ok(histogram) => histogram,
        // True invariant: the bounds are constants of this file that every test run exercises.
        Err(error) => unreachable!("fixed histogram bounds: {error}"),
    }
}

#[cfg(test)]
#[expect(clippy::float_cmp, reason = "values that are copied, not computed")]
mod tests;
