//! What every tick of a stress is held against.

use super::super::super::Row;
use engine::servo::LoopReport;
use haptics::{LimitParameters, TickOutput};
use recording::{LoopCounts, RealtimeSummary, Summary, TickRecord};
use vps::spatial::SampleStatus;

/// One tick may round a limit up by this share.
const ROUNDING: f64 = 1.0 + 1e-12;
/// From here on a force is at its limit.
const AT_LIMIT: f64 = 0.99;

/// Counts over all ticks of a run.
pub(super) struct Judge {
    limits: LimitParameters,
    summary: Summary,
    next_tick: u64,
    lost: u64,
    not_finite: u64,
    beyond_limits: u64,
    faulted: u64,
    at_limit: u64,
    short_of_points: u64,
    most_contacts: u32,
    fastest_m_per_s: f64,
}

fn is_finite(output: &TickOutput) -> bool {
    let numbers = [output.max_depth_m, output.clearance_m, output.energy_j];
    output.command_device.is_finite()
        && output.commanded_device.is_finite()
        && output.contact_world.is_finite()
        && output.world_from_tool.is_finite()
        && numbers.iter().all(|number| number.is_finite())
}

impl Judge {
    pub(super) fn new(limits: LimitParameters) -> Self {
        Self {
            limits,
            summary: Summary::new(),
            next_tick: 0,
            lost: 0,
            not_finite: 0,
            beyond_limits: 0,
            faulted: 0,
            at_limit: 0,
            short_of_points: 0,
            most_contacts: 0,
            fastest_m_per_s: 0.0,
        }
    }

    pub(super) fn see(&mut self, record: &TickRecord) {
        let output = &record.output;
        let limits = &self.limits;
        self.summary.add(record);
        self.lost += u64::from(record.tick != self.next_tick);
        self.next_tick = record.tick + 1;
        self.not_finite += u64::from(!is_finite(output));
        let force_n = output.command_device.force.length();
        let torque_nm = output.command_device.torque.length();
        // Written so that a NaN is beyond.
        let within =
            force_n <= limits.force_n * ROUNDING && torque_nm <= limits.torque_nm * ROUNDING;
        self.beyond_limits += u64::from(!within);
        self.faulted += u64::from(!output.faults.is_empty());
        self.at_limit += u64::from(
            force_n > AT_LIMIT * limits.force_n || torque_nm > AT_LIMIT * limits.torque_nm,
        );
        self.short_of_points += u64::from(output.points_left_out > 0);
        self.most_contacts = self.most_contacts.max(output.contacts);
        if record.input.sample.status == SampleStatus::Fresh {
            self.fastest_m_per_s =
                self.fastest_m_per_s.max(record.input.sample.twist.linear.length());
        }
    }

    /// The figures of a run of `long_s`.
    pub(super) fn rows(
        &self,
        report: &LoopReport,
        n_points: usize,
        is_real: bool,
        long_s: f64,
    ) -> Vec<Row> {
        let clock = if is_real { "real" } else { "virtual" };
        let group = format!(
            "stress: a nut of {n_points} points on its bolt, {long_s} s on the {clock} clock"
        );
        let count = |what: &str, n: u64| Row::new(&group, what, n as f64, "");
        let totals = self.summary.totals(LoopCounts {
            ticks: report.ticks,
            rate_hz: 1000,
            clock,
            missed_deadlines: report.missed_deadlines,
            dropped_records: report.dropped_records,
            contact_budget_points: report.contact_budget_points,
            faults: report.faults,
            realtime: RealtimeSummary::default(),
        });
        let faults = report.faults.names().collect::<Vec<_>>().join(", ");
        let what = match report.first_fault_tick {
            Some(tick) => format!("faults ({faults} in tick {tick})"),
            None => "faults".to_owned(),
        };
        let mut rows = vec![
            count("ticks", totals.ticks),
            count(&what, self.faulted + u64::from(report.first_fault_tick.is_some())).at_most(0.0),
            count("ticks with a value that is not finite", self.not_finite).at_most(0.0),
            count("ticks with a command beyond the limits", self.beyond_limits).at_most(0.0),
            count("records lost", self.lost + totals.dropped_records).at_most(0.0),
            Row::new(&group, "largest force", totals.max_force_n, "N")
                .at_most(self.limits.force_n * ROUNDING),
            Row::new(&group, "largest torque", totals.max_torque_nm, "N·m")
                .at_most(self.limits.torque_nm * ROUNDING),
            count("ticks with force or torque at the limit", self.at_limit),
            count("ticks in contact", totals.contact_ticks),
            count("most points in contact", u64::from(self.most_contacts)),
            count("ticks in which the budget left points out", self.short_of_points),
            Row::new(&group, "deepest point", totals.max_depth_m * 1e3, "mm"),
            Row::new(&group, "fastest grip", self.fastest_m_per_s, "m/s")
                .at_most(self.limits.speed_m_per_s),
            count("ticks in which the passivity controller damped", totals.passivity_ticks),
            Row::new(&group, "lowest energy of the port", totals.lowest_energy_j * 1e3, "mJ"),
            Row::new(&group, "tick compute, p50", totals.compute_us.p50, "µs"),
            Row::new(&group, "tick compute, p99.9", totals.compute_us.p999, "µs"),
            Row::new(&group, "tick compute, max", totals.compute_us.max, "µs"),
        ];
        if is_real {
            rows.push(Row::new(&group, "wake-up, p99.9", totals.wakeup_us.p999, "µs"));
            rows.push(count("missed deadlines", totals.missed_deadlines));
        } else {
            let n_ticks = (long_s * 1e3).round();
            rows.push(
                Row::new(
                    &group,
                    "share of the planned ticks done",
                    totals.ticks as f64 / n_ticks,
                    "",
                )
                .at_least(1.0),
            );
        }
        rows
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use haptics::Faults;
    use vps::spatial::Wrench;

    #[test]
    fn what_must_not_happen_is_counted() {
        let limits = LimitParameters { force_n: 10.0, torque_nm: 0.2, ..LimitParameters::NONE };
        let pushing = |force_n: f64| TickOutput {
            command_device: Wrench::new(DVec3::X * force_n, DVec3::ZERO),
            ..TickOutput::default()
        };
        let mut judge = Judge::new(limits);
        let faulted = TickOutput { faults: Faults::SPEED, ..TickOutput::default() };
        let poisoned = TickOutput { energy_j: f64::NAN, ..TickOutput::default() };
        let ticks = [
            (0, pushing(10.0)),
            (1, pushing(10.1)),
            (3, pushing(f64::NAN)),
            (4, faulted),
            (5, poisoned),
        ];
        for (tick, output) in ticks {
            judge.see(&TickRecord { tick, output, ..TickRecord::default() });
        }
        assert_eq!(
            (judge.lost, judge.not_finite, judge.beyond_limits, judge.faulted, judge.at_limit),
            (1, 2, 2, 1, 2)
        );
    }
}
