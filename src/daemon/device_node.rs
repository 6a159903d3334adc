//! The loop beside the arm: `hapticd device-node`.
//!
//! It does what the servo does for a tick, with [`Node::step`] in its place: absolute deadlines, a
//! thread of its own under SCHED_FIFO where the system allows it, and a zero on every way out. It
//! has no scene, and knows nothing of what the force is for.

use core::time::Duration;
use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use crossbeam::channel::{Receiver, Sender, bounded};

use super::{PrepareError, RealArmNode};
use arms::Device;
use arms::attached::nodes::Selector;
use arms::attached::open::{self, LinkNews, OpenOptions};
use arms::profile::Profile;
use arms::protocol::DeclaredLimits;
use arms::remote::command_hold::HoldTiming;
use arms::remote::figures::{LinkPhase, NodeReport};
use arms::remote::{Node, NodeFigures, NodeParameters};
use arms::simulated::{HandParameters, SimArm, SimParameters};
use engine::servo::{Control, DeadlineGrid, StopGuard};
use rt::clock::{Clock as _, RealClock};
use rt::preflight::PreflightReport;
use rt::realtime::{self, Entered};
use rt::schedule::ThreadRequest;

/// How often the loop is looked at.
const LOOK: Duration = Duration::from_millis(20);

/// What a node reports while it runs.
#[derive(Debug)]
pub enum NodeNotice<'a> {
    /// A new phase, with what was counted so far.
    Phase(LinkPhase, NodeReport),
    /// What the machine offers the loop.
    Preflight(&'a PreflightReport),
    /// What became of the link of a real arm.
    Link(&'a LinkNews),
}

/// Everything that a node takes.
pub struct NodeJob {
    /// The arm's side of the link.
    pub node: Node,
    /// The open arm.
    pub arm: Box<dyn Device>,
    /// What becomes of the link of a real one.
    pub news: Option<Receiver<LinkNews>>,
    /// One period, s.
    pub period_s: f64,
    /// Scheduling of the loop.
    pub request: ThreadRequest,
    /// End after this; `None`: when the control says so.
    pub duration: Option<Duration>,
}

/// How a node ended.
#[derive(Clone, Copy, Debug)]
pub struct NodeOutcome {
    /// What was counted.
    pub report: NodeReport,
    /// Periods done.
    pub periods: u64,
    /// Deadlines that passed without one.
    pub missed_periods: u64,
    /// The loop stopped on an internal error; the arm got zero.
    pub panicked: bool,
    /// What the thread obtained; `None`: it panicked.
    pub entered: Option<Entered>,
}

/// What the node reports of its arm to a host, and holds the host to. A real arm with unverified
/// signs gets no more here than there.
pub fn node_parameters(
    profile: &Profile,
    name: &str,
    period_s: f64,
    timing: HoldTiming,
) -> NodeParameters {
    let limits = profile.limits_now();
    NodeParameters {
        name: name.to_owned(),
        sensed: profile.sensed,
        actuated: profile.actuated,
        period_s,
        force_limit_n: limits.force_n,
        torque_limit_nm: limits.torque_nm,
        workspace_radius_m: limits.workspace_radius_m,
        timing,
        deadman: profile.real.as_ref().and_then(|real| real.deadman_button),
        starts_with_host: profile.real.is_none(),
    }
}

/// The arm of a device node.
pub struct NodeArm {
    /// Ready for the loop.
    pub device: Box<dyn Device>,
    /// Of a real one.
    pub attached: Option<RealArmNode>,
    /// The limits that it declares itself.
    pub declared: Option<DeclaredLimits>,
}

/// Opens the arm of a profile, with that program as its [guard](arms::guard), or makes the
/// simulated one with that hand.
///
/// # Errors
/// The arm cannot be opened, or not be simulated.
pub fn open_arm(
    profile: &Profile,
    hand: Option<HandParameters>,
    selector: Option<Selector>,
    period_s: f64,
    request: ThreadRequest,
    guard: Option<PathBuf>,
) -> Result<NodeArm, PrepareError> {
    if profile.real.is_some() {
        let io_request = Some(request.below());
        let opened = open::open(profile, &OpenOptions { selector, io_request, period_s, guard })?;
        let declared = opened.arm.declared();
        let attached = RealArmNode { node: opened.path, news: opened.news, link: None };
        return Ok(NodeArm { device: Box::new(opened.arm), attached: Some(attached), declared });
    }
    let device = Box::new(SimArm::new(SimParameters::of(profile, hand, period_s))?);
    Ok(NodeArm { device, attached: None, declared: None })
}

/// Runs the loop until `control` or its time ends it. The arm gets zero last, whatever happens.
///
/// # Errors
/// The thread cannot be started.
pub fn run_node(
    job: NodeJob,
    control: &Arc<Control>,
    mut notify: impl FnMut(NodeNotice<'_>),
) -> io::Result<NodeOutcome> {
    let NodeJob { node, arm, news, period_s, request, duration } = job;
    let figures = node.figures();
    let (entered_sender, entered) = bounded(1);
    let thread = {
        let control = control.clone();
        std::thread::Builder::new()
            .name("device-node".to_owned())
            .spawn(move || turn(node, arm, period_s, request, &entered_sender, &control))?
    };
    let entered = entered.recv().ok();
    if let Some(entered) = entered {
        notify(NodeNotice::Preflight(&entered.judge()));
    }
    watch(&figures, news.as_ref(), duration, &thread, &mut notify);
    control.stop();
    let (periods, missed_periods, panicked) = thread.join().unwrap_or((0, 0, true));
    Ok(NodeOutcome { report: figures.report(), periods, missed_periods, panicked, entered })
}

type Turned = (u64, u64, bool);

fn turn(
    mut node: Node,
    arm: Box<dyn Device>,
    period_s: f64,
    request: ThreadRequest,
    entered: &Sender<Entered>,
    control: &Control,
) -> Turned {
    let realtime = realtime::enter(request);
    // Who started this thread waits for it.
    let _ = entered.send(realtime.entered());
    // Writes zero while a panic unwinds, too.
    let mut arm = StopGuard::new(arm);
    let mut periods = 0;
    let mut missed = 0;
    let outcome = catch_unwind(AssertUnwindSafe(|| {
        let mut clock = RealClock;
        let start_ns = clock.now_ns();
        let begin_ns = clock.elapsed_ns();
        let mut deadlines = DeadlineGrid::new(start_ns, (period_s * 1e9).round() as i64);
        // A node has no ramp of its own: the first order to end is the last period.
        while !control.is_ending() {
            let due = deadlines.wait(&mut clock);
            missed += due.missed;
            periods += 1;
            // A suspend of this machine is silence of the host.
            node.step((clock.elapsed_ns() - begin_ns) as f64 * 1e-9, &mut **arm);
        }
    }));
    node.stop(&mut **arm);
    (periods, missed, outcome.is_err())
}

/// Reports what changes until it is time to end.
fn watch<T>(
    figures: &NodeFigures,
    news: Option<&Receiver<LinkNews>>,
    duration: Option<Duration>,
    thread: &std::thread::JoinHandle<T>,
    notify: &mut impl FnMut(NodeNotice<'_>),
) {
    let begin = Instant::now();
    let mut reported = LinkPhase::Silent;
    let mut losses = 0;
    while !thread.is_finished() && duration.is_none_or(|duration| begin.elapsed() < duration) {
        let phase = figures.phase();
        let report = figures.report();
        // A host that is quick to disable again must not hide that the link was lost.
        if report.link_losses > losses && phase != LinkPhase::Tripped {
            notify(NodeNotice::Phase(LinkPhase::Tripped, report));
        }
        if phase != reported || report.link_losses > losses {
            (reported, losses) = (phase, report.link_losses);
            notify(NodeNotice::Phase(phase, report));
        }
        for news in news.into_iter().flat_map(Receiver::try_iter) {
            notify(NodeNotice::Link(&news));
        }
        std::thread::sleep(LOOK);
    }
}
