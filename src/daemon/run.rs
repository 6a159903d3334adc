//! One run with its summary.

use std::sync::Arc;

use crate::error::Exit;
use engine::servo::{Control, Ending, LoopReport};
use engine::supervisor::{LiveChannels, Notice, RenderJob, RunError, RunOutcome, Supervisor};
use recording::{LoopCounts, RealtimeSummary, SwapSummary, Totals, summary_subscriber};
use rt::clock::ClockKind;
use rt::preflight::PreflightReport;

/// How a run ended, and what it came to.
#[derive(Debug)]
pub struct RunSummary {
    /// When scenes were swapped.
    pub swaps: Vec<SwapSummary>,
    /// The result, as `--json` has it.
    pub totals: Totals,
    /// What the servo had to say, with the flight recorder.
    pub report: LoopReport,
    /// What the machine offered.
    pub preflight: PreflightReport,
}

impl RunSummary {
    /// The exit code of the run.
    pub fn exit(&self) -> Exit {
        if !self.report.faults.is_empty() {
            Exit::Fault
        } else if self.report.ending == Ending::StopTimedOut {
            Exit::Internal
        } else {
            Exit::Ok
        }
    }
}

/// The exit code of a run that did not come to an outcome.
pub const fn exit_of(error: &RunError) -> Exit {
    match error {
        RunError::Refused(_) => Exit::RealtimeRefused,
        RunError::NoOperator => Exit::Device,
        RunError::Thread(_) | RunError::Servo(_) => Exit::Internal,
    }
}

/// Renders as [`Supervisor::render_live`] does, and sums up every record. `rate_hz`: ticks per
/// second.
///
/// # Errors
/// As there.
pub fn render<N: FnMut(Notice<'_>)>(
    supervisor: &mut Supervisor<N>,
    job: RenderJob,
    rate_hz: u32,
    live: LiveChannels,
    control: &Arc<Control>,
) -> Result<RunSummary, RunError> {
    let (summary, subscriber) = summary_subscriber();
    live.subscribers.add(subscriber);
    let clock = job.clock;
    let RunOutcome { report, preflight } = supervisor.render_live(job, live, control)?;
    let summary = summary.take();
    let totals = summary.totals(counted(&report, &preflight, rate_hz, clock));
    Ok(RunSummary { swaps: summary.swaps().to_vec(), totals, report, preflight })
}

fn counted(
    report: &LoopReport,
    preflight: &PreflightReport,
    rate_hz: u32,
    clock: ClockKind,
) -> LoopCounts {
    LoopCounts {
        ticks: report.ticks,
        rate_hz,
        clock: clock.name(),
        missed_deadlines: report.missed_deadlines,
        dropped_records: report.dropped_records,
        contact_budget_points: report.contact_budget_points,
        faults: report.faults,
        realtime: RealtimeSummary {
            policy: if preflight.standing.fifo { "fifo" } else { "other" },
            priority: preflight.standing.priority,
            cpu: preflight.standing.cpu,
            memory_locked: preflight.memory_locked,
            kernel_rt: preflight.kernel_rt,
        },
    }
}
