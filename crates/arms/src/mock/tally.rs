//! What a mock arm measured, for tests to judge a host by.

use glam::DVec3;
use serde::Serialize;

use crate::simulated::fault::FaultPlan;
use vps::spatial::{NamedPose, Wrench};

/// Below this a force is none: less than a count of any arm's drive, N.
const NO_FORCE_N: f64 = 0.005;
/// The same of a torque, N·m.
const NO_TORQUE_NM: f64 = 5e-4;

/// What came of one injected fault. Ticks are periods of the arm.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FaultReport {
    /// The fault, as it was asked for.
    pub fault: String,
    /// When it began, s of the arm's time.
    pub began_s: f64,
    /// Force of the motors in the period before, N.
    pub force_before_n: f64,
    /// Periods from its beginning until the motors made no wrench; null: they never stopped.
    pub zero_after_ticks: Option<u64>,
    /// Largest force from its beginning on, N.
    pub largest_force_n: f64,
    /// Largest torque from its beginning on, N·m.
    pub largest_torque_nm: f64,
    /// Periods from its beginning until the motors made a wrench again after they had stopped.
    pub force_again_after_ticks: Option<u64>,
}

/// A wrench with its names.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
#[expect(missing_docs, reason = "the names say it: device axes, at the grip point")]
pub struct NamedWrench {
    pub fx_n: f64,
    pub fy_n: f64,
    pub fz_n: f64,
    pub tx_nm: f64,
    pub ty_nm: f64,
    pub tz_nm: f64,
}

impl From<Wrench> for NamedWrench {
    fn from(wrench: Wrench) -> Self {
        let ([fx_n, fy_n, fz_n], [tx_nm, ty_nm, tz_nm]) =
            (wrench.force.to_array(), wrench.torque.to_array());
        Self { fx_n, fy_n, fz_n, tx_nm, ty_nm, tz_nm }
    }
}

impl From<NamedWrench> for Wrench {
    fn from(named: NamedWrench) -> Self {
        let NamedWrench { fx_n, fy_n, fz_n, tx_nm, ty_nm, tz_nm } = named;
        Self { force: DVec3::new(fx_n, fy_n, fz_n), torque: DVec3::new(tx_nm, ty_nm, tz_nm) }
    }
}

/// What it measured from its start to its end.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct MockReport {
    /// Periods of the plant.
    pub periods: u64,
    /// Of them, those that began more than half a period late: the machine's doing, not the host's.
    pub late_periods: u64,
    /// Reads that brought something; of a HID link: reports.
    pub frames_received: u64,
    /// Bytes of them.
    pub bytes_received: u64,
    /// Frames that went out.
    pub frames_sent: u64,
    /// Frames that did not: the host did not take them, or a fault kept them.
    pub frames_lost: u64,
    /// Longest time between two frames of the host, ms.
    pub longest_gap_ms: f64,
    /// Times that more than three periods lay between two frames of the host.
    pub gaps: u64,
    /// Largest force of the motors, N.
    pub largest_force_n: f64,
    /// Largest torque, N·m.
    pub largest_torque_nm: f64,
    /// Times that the motors stopped without a word of the host.
    pub watchdog_trips: u64,
    /// Each injected fault that has begun.
    pub faults: Vec<FaultReport>,
    /// Wrench of the motors at the end.
    pub last_command: NamedWrench,
    /// Where the grip was at the end.
    pub final_pose: NamedPose,
}

/// Keeps count.
#[derive(Clone, Debug, Default)]
pub(super) struct Tally {
    pub(super) report: MockReport,
    /// Which plan each fault report belongs to, and in which period it began.
    began: Vec<(usize, u64)>,
    last_force_n: f64,
    last_frame_s: Option<f64>,
}

fn is_none(force_n: f64, torque_nm: f64) -> bool {
    force_n < NO_FORCE_N && torque_nm < NO_TORQUE_NM
}

impl Tally {
    pub(super) fn frame(&mut self, n_bytes: usize, now_s: f64, period_s: f64) {
        self.report.frames_received += 1;
        self.report.bytes_received += n_bytes as u64;
        if let Some(last_s) = self.last_frame_s.replace(now_s) {
            self.report.longest_gap_ms = self.report.longest_gap_ms.max((now_s - last_s) * 1e3);
            self.report.gaps += u64::from(now_s - last_s > 3.0 * period_s);
        }
    }

    /// One period with what the motors did in it.
    pub(super) fn period(
        &mut self,
        felt: &Wrench,
        plans: &[(String, FaultPlan)],
        now_s: f64,
        period_s: f64,
    ) {
        let force_n = felt.force.length();
        let torque_nm = felt.torque.length();
        let report = &mut self.report;
        report.largest_force_n = report.largest_force_n.max(force_n);
        report.largest_torque_nm = report.largest_torque_nm.max(torque_nm);
        for (idx, (text, plan)) in plans.iter().enumerate() {
            let is_known = self.began.iter().any(|(known, _)| *known == idx);
            if !is_known && plan.active(now_s, period_s).is_some() {
                self.began.push((idx, report.periods));
                report.faults.push(FaultReport {
                    fault: text.clone(),
                    began_s: now_s,
                    force_before_n: self.last_force_n,
                    zero_after_ticks: None,
                    largest_force_n: 0.0,
                    largest_torque_nm: 0.0,
                    force_again_after_ticks: None,
                });
            }
        }
        for ((_, began), fault) in self.began.iter().zip(&mut report.faults) {
            let ticks = report.periods - began;
            fault.largest_force_n = fault.largest_force_n.max(force_n);
            fault.largest_torque_nm = fault.largest_torque_nm.max(torque_nm);
            match (fault.zero_after_ticks, is_none(force_n, torque_nm)) {
                (None, true) => fault.zero_after_ticks = Some(ticks),
                (Some(_), false) if fault.force_again_after_ticks.is_none() => {
                    fault.force_again_after_ticks = Some(ticks)
                }
                _ => {}
            }
        }
        self.last_force_n = force_n;
        report.periods += 1;
        report.last_command = (*felt).into();
    }
}
