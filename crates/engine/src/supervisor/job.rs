//! What a run takes, and how it ends.

use core::time::Duration;
use std::sync::Arc;

use crossbeam::channel::Receiver;

use crate::record::RecordSubscribers;
use crate::servo::{CommandQueue, DensitySlot, LoopReport};
use arms::Device;
use arms::attached::open::LinkNews;
use haptics::RenderScene;
use rt::clock::ClockKind;
use rt::control::Permit;
use rt::preflight::PreflightReport;
use rt::schedule::RealtimeConfig;

/// Everything that rendering takes.
pub struct RenderJob {
    /// The scene, everything allocated.
    pub scene: Arc<RenderScene>,
    /// The open arm.
    pub device: Box<dyn Device>,
    /// What to ask of the operating system.
    pub realtime: RealtimeConfig,
    /// What a contact query may take, s; `None`: as long as it takes.
    pub time_budget_s: Option<f64>,
    /// Which time the run follows.
    pub clock: ClockKind,
    /// Loop time after which the ramp-down begins; `None`: until a signal.
    pub duration: Option<Duration>,
}

/// What may change while a run goes on.
#[derive(Debug, Default)]
pub struct LiveChannels {
    /// Parameters, poses of movable objects and other scenes; the cold end is
    /// [`SceneControls`](crate::servo::SceneControls).
    pub commands: CommandQueue,
    /// Frames of densities; the cold end is [`DensityFeed`](crate::servo::DensityFeed).
    pub density: Option<DensitySlot>,
    /// The source that says when force may flow.
    pub operator: Operator,
    /// What becomes of the link of a real arm.
    pub news: Option<Receiver<LinkNews>>,
    /// Subscribers to every record.
    pub subscribers: RecordSubscribers,
}

/// An operator asks for force, from zero. After a fault this acknowledges it. Everything that takes
/// force away goes to the [`Control`](crate::servo::Control) itself and waits for no thread; the
/// client that asks draws the permit, so that force which was taken away after that stays away,
/// however long this waits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Enable(pub Permit);

/// The source that says when force may flow. A simulated arm can hurt no person and is enabled from
/// the start, unless every arm is held back.
#[derive(Debug, Default)]
pub struct Operator {
    /// Force flows from the start; with a deadman, while it is held.
    pub enables_at_start: bool,
    /// After a fault the loop goes on with zero force and waits for an order; else it ends.
    pub waits_after_fault: bool,
    /// No arm is enabled before an operator says so, not even a simulated one.
    pub holds_back: bool,
    /// Orders to enable as they come; `None`: there are none.
    pub enables: Option<Receiver<Enable>>,
}

/// How a run ended.
#[derive(Debug)]
pub struct RunOutcome {
    /// What the servo had to say, with the flight recorder.
    pub report: LoopReport,
    /// What the machine offered.
    pub preflight: PreflightReport,
}

/// Why a run did not come to an outcome.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// `enforce`, and a preflight check failed. The report was sent as a notice.
    #[error("real-time preflight refused: {} check(s) failed and the mode is `enforce`", .0.failed().count())]
    Refused(PreflightReport),
    /// A real arm, and no operator that could let force flow.
    #[error("this is a real arm, and no operator can let force flow")]
    NoOperator,
    /// A thread could not be started.
    #[error("cannot start a thread: {0}")]
    Thread(#[from] std::io::Error),
    /// The servo thread did not end, or ended without a report. The arm's own watchdog is the last
    /// resort.
    #[error("the servo thread {0}")]
    Servo(&'static str),
}
