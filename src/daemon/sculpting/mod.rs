//! Sculpting: the thread of the clay, beside the loop.
//!
//! ```text
//!  servo ──ToolState──► thread `clay`: SculptEngine ──DensityFrame──► servo
//!                           ▲               │
//!  page ──► ClayHandle ─────┤               └──► ClayView ──► ClayHandle ──► page
//!  script ──────────────────┘
//! ```
//! Real time: an update every so many milliseconds, late ones are left out and counted. Simulated
//! time: one update, and one frame, for every so many states; two runs give the same bits.
//!
//! An order may take long: the loop goes on with the frames that it has. The end of the run cancels
//! it, and so does a client that controls the run and is lost; the clay is as it was before.
//!
//! An engine that panics takes nothing along: its slot is abandoned, the tick goes on with the last
//! frame and lets go of the rope, and the clay comes back with what had been done until then.

mod duty_cycle;
mod handle;
mod thread;

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;

use serde::Serialize;

pub use duty_cycle::DutyCycle;
pub use handle::{ClayHandle, OrderError, Reply};

use clay::engine::{SculptEngine, SculptOrder};
use engine::servo::DensitySlot;
use haptics::clay::Clay;
use rt::clock::ClockKind;
use rt::control::Control;

/// How the clay is worked.
#[derive(Clone, Debug)]
pub struct SculptPlan {
    /// Of the loop, s.
    pub tick_s: f64,
    /// Ticks from one update of the material to the next, at least 1.
    pub update_ticks: u64,
    /// Which time the loop follows.
    pub clock: ClockKind,
    /// What is asked for by itself, each before the state of the tick with its number is taken; in
    /// any order, equal ticks keep theirs.
    pub script: Vec<ScriptedOrder>,
}

/// An order of a script.
#[derive(Clone, Debug)]
pub struct ScriptedOrder {
    /// The tick before which it is due.
    pub tick: u64,
    /// What is asked for.
    pub order: SculptOrder,
    /// Where the script says so; `None`: it is no file.
    pub line: Option<usize>,
}

impl From<(u64, SculptOrder)> for ScriptedOrder {
    fn from((tick, order): (u64, SculptOrder)) -> Self {
        Self { tick, order, line: None }
    }
}

/// An order that was not carried out.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct FailedOrder {
    /// The tick before which it was due, or that was taken last when a client asked.
    pub tick: u64,
    /// It came from the script.
    #[serde(rename = "scripted")]
    pub is_scripted: bool,
    /// The line of the script.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub line: Option<usize>,
    /// What was asked for, a word or two.
    pub what: String,
    /// Why not, and what would help.
    pub why: String,
}

/// What there is to say of the work when it is over.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct SculptReport {
    /// Updates of the material.
    pub updates: u64,
    /// Updates that were left out because they would have come too late.
    pub late: u64,
    /// Strokes that were made, those that were taken back among them.
    pub strokes: u64,
    /// Strokes that stand taken back at the end, and could be done again.
    pub taken_back: usize,
    /// Samples of the clay at the start.
    pub samples_before: usize,
    /// And at the end.
    pub samples: usize,
    /// Orders that were not carried out.
    pub failed: Vec<FailedOrder>,
    /// Script orders whose tick never came; a hold is one.
    pub left_over: usize,
    /// Files that orders wrote while the loop ran, each once: what ([`SculptOrder::writes`]), and
    /// where.
    #[serde(skip)]
    pub files: Vec<(&'static str, PathBuf)>,
    /// What went wrong by itself, such as a stroke that made no surface; each once.
    pub troubles: Vec<String>,
    /// Why sculpting ended before the loop did: a defect of the program.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub broken: Option<String>,
}

/// An engine whose thread has ended.
#[derive(Debug)]
pub struct SculptOutcome {
    /// What it has to say.
    pub report: SculptReport,
    /// The clay, the tool and the past, for saving: [`SculptEngine::order`] still works.
    pub engine: SculptEngine,
}

/// The thread of the clay.
#[derive(Debug)]
pub struct SculptThread {
    thread: JoinHandle<SculptOutcome>,
    /// The loop is over, even if its thread never gave the slot back.
    is_over: Arc<AtomicBool>,
}

impl SculptThread {
    /// Orders the thread to end, as it does by itself when the loop is over. In real time an order
    /// that is carried out is cancelled; in simulated time it is finished, so that two runs are the
    /// same, unless the run was ended from outside.
    pub fn end(&self) {
        // Relaxed: no other data depends on it.
        self.is_over.store(true, Ordering::Relaxed);
    }

    /// The thread has ended.
    pub fn has_ended(&self) -> bool {
        self.thread.is_finished()
    }

    /// Waits until the thread has ended, by itself or because of [`Self::end`].
    ///
    /// # Errors
    /// The thread panicked.
    pub fn join(self) -> Result<SculptOutcome, &'static str> {
        self.thread.join().map_err(|_| "the thread of the clay panicked")
    }
}

/// Begins to work the clay of a scene: the slot goes to the loop ([`engine::supervisor::LiveChannels::density`]),
/// the handle to clients.
///
/// `clay.frame` is to show the clay of the engine as it is (`ClayModel::frame`). Once `control`
/// says that the run ends, an order that is carried out is cancelled.
///
/// # Errors
/// The thread could not be started.
pub fn begin(
    engine: SculptEngine,
    clay: &Clay,
    plan: SculptPlan,
    control: Arc<Control>,
) -> std::io::Result<(DensitySlot, ClayHandle, SculptThread)> {
    let update_ticks = plan.update_ticks.max(1);
    let (feed, slot) = DensitySlot::new(&clay.frame, &clay.world_from_map, update_ticks);
    let (handle, handle_end) = handle::pair();
    let is_over = Arc::new(AtomicBool::new(false));
    let thread = thread::spawn(
        engine,
        thread::Ends { feed, is_over: is_over.clone(), control, handle: handle_end },
        SculptPlan { update_ticks, ..plan },
    )?;
    Ok((slot, handle, SculptThread { thread, is_over }))
}
