//! The thread: takes tool states and orders, updates the clay, shows it.

use core::time::Duration;
use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::thread::JoinHandle;
use std::time::Instant;

use crossbeam::channel::Receiver;

use super::handle::{HandleEnd, ViewCell, WaitingOrder};
use super::{DutyCycle, FailedOrder, ScriptedOrder, SculptOutcome, SculptPlan, SculptReport};
use crate::config::setting_names::KEYS;
use clay::Cancel;
use clay::boolean::Boolean;
use clay::engine::{EngineError, HoldOutcome, SculptEngine, SculptOrder, ToolMotion};
use engine::servo::{DensityFeed, FramePublishError, ToolState, Waiting};
use rt::clock::ClockKind;
use rt::control::Control;
use vps::density::DensityFrame;

/// Time from one view to the next, at least.
const VIEW_PERIOD: Duration = Duration::from_micros(33_333);
/// What copies of the samples for views may take of the time.
const COPY_SHARE: f64 = 0.1;
/// Failed orders and troubles that are kept for the report.
const KEPT_MAX: usize = 200;

/// No frame can be made that the loop would take: the engine is of no use any more.
#[derive(Debug)]
struct Unshowable(FramePublishError);

/// Where an order came from.
#[derive(Clone, Copy)]
struct Asker {
    tick: u64,
    is_scripted: bool,
    line: Option<usize>,
}

struct Worker<'s> {
    engine: &'s mut SculptEngine,
    report: &'s mut SculptReport,
    feed: DensityFeed,
    /// The caller that waits for the thread has given the loop up.
    is_reported_over: Arc<AtomicBool>,
    orders: Receiver<WaitingOrder>,
    /// How often work was cancelled, and how often it had been when what is done now began.
    cancels: Arc<AtomicU64>,
    cancels_before: Arc<AtomicU64>,
    view: Arc<ViewCell>,
    plan: SculptPlan,
    /// The next of the script.
    next: usize,
    /// The last hold of the script, until it is known what it grabbed.
    hold: Option<Asker>,
    /// The last one that was taken.
    tick: u64,
    update_s: f64,
    began: Instant,
    views: DutyCycle,
    copies: DutyCycle,
    has_viewed: bool,
}

/// What the thread shares with others.
pub(super) struct Ends {
    pub(super) feed: DensityFeed,
    /// The caller that waits for the thread has given the loop up.
    pub(super) is_over: Arc<AtomicBool>,
    pub(super) control: Arc<Control>,
    pub(super) handle: HandleEnd,
}

pub(super) fn spawn(
    mut engine: SculptEngine,
    ends: Ends,
    mut plan: SculptPlan,
) -> std::io::Result<JoinHandle<SculptOutcome>> {
    let Ends { feed, is_over, control, handle: HandleEnd { orders, cancels, view } } = ends;
    let cancels_before = Arc::new(AtomicU64::new(0));
    engine.cancel_when({
        let is_over = is_over.clone();
        let cancels = cancels.clone();
        let before = cancels_before.clone();
        let clock = plan.clock;
        Cancel::when(move || {
            control.is_ending()
                || clock == ClockKind::Real && is_over.load(Ordering::Relaxed)
                || cancels.load(Ordering::Relaxed) != before.load(Ordering::Relaxed)
        })
    });
    // Stable: equal ticks keep their order.
    plan.script.sort_by_key(|scripted| scripted.tick);
    std::thread::Builder::new().name("clay".to_owned()).spawn(move || {
        let mut report = SculptReport {
            samples_before: engine.model().points().len(),
            ..SculptReport::default()
        };
        let shown = view.clone();
        let work = AssertUnwindSafe(|| {
            let mut worker = Worker {
                engine: &mut engine,
                report: &mut report,
                feed,
                is_reported_over: is_over,
                orders,
                cancels,
                cancels_before,
                view,
                plan,
                next: 0,
                hold: None,
                tick: 0,
                update_s: 0.0,
                began: Instant::now(),
                views: DutyCycle::new(1.0, VIEW_PERIOD),
                copies: DutyCycle::new(COPY_SHARE, VIEW_PERIOD),
                has_viewed: false,
            };
            worker.look();
            let result = match worker.plan.clock {
                ClockKind::Virtual => worker.follow_ticks(),
                ClockKind::Real => worker.follow_time(),
            };
            let never_due = worker.plan.script.get(worker.next..).unwrap_or_default();
            // The end of a hold is the same stroke as its beginning.
            worker.report.left_over = never_due
                .iter()
                .filter(|left| !matches!(left.order, SculptOrder::Hold(false)))
                .count();
            worker.engine.finish();
            worker.note_problem();
            result
        });
        // The feed goes with the closure: the loop learns at once that there will be no more
        // frames.
        report.broken = match catch_unwind(work) {
            Ok(Ok(())) => None,
            Ok(Err(Unshowable(error))) => Some(error.to_string()),
            Err(panic) => Some(words_of(&*panic)),
        };
        // What is saved behind the end is finished.
        engine.cancel_when(Cancel::default());
        if let Some(why) = &report.broken {
            shown.end(why);
            rescue_stroke(&mut engine);
        }
        report.updates = engine.updates();
        report.strokes = engine.model().strokes();
        report.taken_back = engine.model().history().1;
        report.samples = engine.model().points().len();
        SculptOutcome { report, engine }
    })
}

/// So that what was done before can be saved: a stroke that brought the engine down may do so again
/// when it ends, and is given up then.
fn rescue_stroke(engine: &mut SculptEngine) {
    let has_ended = catch_unwind(AssertUnwindSafe(|| engine.finish())).is_ok();
    if !has_ended {
        let _ = catch_unwind(AssertUnwindSafe(|| engine.give_up_stroke("sculpting has ended")));
    }
}

fn words_of(panic: &(dyn Any + Send)) -> String {
    let words = panic.downcast_ref::<&str>().map(|words| (*words).to_owned());
    words
        .or_else(|| panic.downcast_ref::<String>().cloned())
        .unwrap_or_else(|| "a panic without words".to_owned())
}

impl Worker<'_> {
    fn is_over(&self) -> bool {
        self.feed.is_over() || self.is_reported_over.load(Ordering::Relaxed)
    }

    fn period_s(&self) -> f64 {
        self.plan.update_ticks as f64 * self.plan.tick_s
    }

    /// Simulated time: one update for every `update_ticks` states, and one frame, which the loop
    /// waits for.
    fn follow_ticks(&mut self) -> Result<(), Unshowable> {
        let mut n_heard = 0;
        let waiting = Waiting::new();
        loop {
            // Before the states: orders from before the end are still carried out.
            let is_over = self.is_over();
            while let Some(state) = self.feed.next_state() {
                waiting.reset();
                self.take_state(&state);
                n_heard += 1;
                if n_heard == self.plan.update_ticks {
                    n_heard = 0;
                    self.take_orders();
                    self.begin_work(self.cancels.load(Ordering::Relaxed));
                    self.engine.advance(self.period_s());
                    self.note_problem();
                    self.show_and_wait()?;
                    self.look();
                }
            }
            if is_over {
                return Ok(());
            }
            self.look();
            waiting.pause();
        }
    }

    fn show_and_wait(&mut self) -> Result<(), Unshowable> {
        let waiting = Waiting::new();
        loop {
            if let Some(frame) = self.feed.spare() {
                return self.show(frame);
            }
            if self.is_over() {
                return Ok(());
            }
            waiting.pause();
        }
    }

    /// Real time: an update when it is due; those that would come too late are left out.
    fn follow_time(&mut self) -> Result<(), Unshowable> {
        let period = Duration::from_secs_f64(self.period_s());
        let mut due = Instant::now() + period;
        loop {
            let is_over = self.is_over();
            while let Some(state) = self.feed.next_state() {
                self.take_state(&state);
            }
            self.take_orders();
            let begin = Instant::now();
            self.begin_work(self.cancels.load(Ordering::Relaxed));
            let has_changed = self.engine.advance(self.period_s());
            self.note_problem();
            // A frame that finds no spare waits for the next update: what it would have shown is in
            // that one as well.
            if has_changed {
                match self.feed.spare() {
                    Some(frame) => self.show(frame)?,
                    None => self.engine.show_again(),
                }
            }
            self.update_s = begin.elapsed().as_secs_f64();
            self.look();
            if is_over {
                return Ok(());
            }
            let now = Instant::now();
            match due.checked_duration_since(now) {
                Some(early) => std::thread::sleep(early),
                None => {
                    let n_late =
                        (now.duration_since(due).as_nanos() / period.as_nanos().max(1)) as u32;
                    self.report.late += u64::from(n_late);
                    due += period * n_late;
                }
            }
            due += period;
        }
    }

    /// One tick's news, behind the orders of the script that are due before it.
    fn take_state(&mut self, state: &ToolState) {
        self.tick = state.tick;
        while let Some(ScriptedOrder { tick, order, line }) =
            self.plan.script.get(self.next).filter(|next| next.tick <= state.tick)
        {
            let order = order.clone();
            let asker = Asker { tick: *tick, is_scripted: true, line: *line };
            self.next += 1;
            if let SculptOrder::Hold(true) = order {
                self.hold = Some(asker);
            }
            self.begin_work(self.cancels.load(Ordering::Relaxed));
            // The report names it.
            let _ = self.carry_out(order, asker);
        }
        self.engine.take_motion(&ToolMotion {
            map_from_tool: state.map_from_tool,
            force_map: state.force_map,
            rope_map: state.rope_map,
            touches: state.contacts > 0,
            is_held: state.buttons & 1 != 0,
            has_force: state.has_force,
        });
    }

    /// What is done from now on ends when work is cancelled once more than so often.
    fn begin_work(&self, cancels: u64) {
        self.cancels_before.store(cancels, Ordering::Relaxed);
    }

    fn take_orders(&mut self) {
        // Those that are there now: a client that asks without end holds nothing up.
        for _ in 0..self.orders.len() {
            let Ok(waiting) = self.orders.try_recv() else { return };
            self.begin_work(waiting.cancels);
            let result = self.carry_out(
                waiting.order.clone(),
                Asker { tick: self.tick, is_scripted: false, line: None },
            );
            // Before the answer: a client that looks after it sees what it asked for.
            self.publish();
            waiting.answer(result.map_err(Into::into));
        }
    }

    fn carry_out(&mut self, order: SculptOrder, asker: Asker) -> Result<(), EngineError> {
        let what = name_of(&order);
        let writes = order.writes().map(|(what, file)| (what, file.to_owned()));
        if !matches!(order, SculptOrder::Hold(_) | SculptOrder::SavePoints(_)) {
            self.slacken();
        }
        let result = self.engine.order(order);
        match &result {
            Ok(()) => self.note_file(writes),
            Err(error) => self.note_failure(asker, what, format!("{error}; {}", error.hint(&KEYS))),
        }
        result
    }

    /// Lets the hand go before something that ends its pull and may take long: the loop would not
    /// learn meanwhile that it is to let go. Simulated time waits for whatever it is.
    fn slacken(&mut self) {
        if self.plan.clock == ClockKind::Real
            && self.engine.slacken()
            && let Some(frame) = self.feed.spare()
        {
            // If it cannot be shown now, the next update says so again.
            let _ = self.show(frame);
        }
    }

    fn note_file(&mut self, written: Option<(&'static str, PathBuf)>) {
        let Some((what, file)) = written else { return };
        self.report.files.retain(|(_, earlier)| *earlier != file);
        if self.report.files.len() < KEPT_MAX {
            self.report.files.push((what, file));
        }
    }

    fn note_failure(&mut self, Asker { tick, is_scripted, line }: Asker, what: &str, why: String) {
        if self.report.failed.len() < KEPT_MAX {
            self.report.failed.push(FailedOrder {
                tick,
                is_scripted,
                line,
                what: what.to_owned(),
                why,
            });
        }
    }

    /// What went wrong by itself; where a hold of the script took hold of nothing, that stroke has
    /// failed.
    fn note_problem(&mut self) {
        let grip = self.engine.grip();
        let missed = if grip == HoldOutcome::None { None } else { self.hold.take() }
            .filter(|_| grip == HoldOutcome::Missed);
        let trouble = self.engine.trouble().clone();
        if let Some(asker) = missed {
            return self.note_failure(asker, "hold", trouble.to_string());
        }
        let is_new = !trouble.is_empty()
            && self.report.troubles.iter().all(|known| **known != *trouble)
            && self.report.failed.iter().all(|failed| *failed.why != *trouble);
        if is_new && self.report.troubles.len() < KEPT_MAX {
            self.report.troubles.push(trouble.to_string());
        }
    }

    /// A stroke whose densities cannot be touched has never been; what was there before it can.
    fn show(&mut self, mut frame: Box<DensityFrame>) -> Result<(), Unshowable> {
        self.engine.show(&mut frame);
        let (error, mut frame) = match self.feed.publish(frame) {
            Err((FramePublishError::Frame(error), frame)) => (error, frame),
            _ => return Ok(()),
        };
        self.engine.give_up_stroke(&error.to_string());
        self.note_problem();
        self.engine.show(&mut frame);
        match self.feed.publish(frame) {
            Err((error @ FramePublishError::Frame(_), _)) => Err(Unshowable(error)),
            _ => Ok(()),
        }
    }

    /// A view for clients that look.
    fn look(&mut self) {
        let begin = self.began.elapsed();
        if self.has_viewed && !(self.view.is_watched() && self.views.is_due(begin)) {
            return;
        }
        let copies = self.engine.has_new_samples() && self.copies.is_due(begin);
        if copies {
            self.engine.copy_samples();
        }
        self.publish();
        let end = self.began.elapsed();
        self.has_viewed = true;
        self.views.worked(begin, end);
        if copies {
            self.copies.worked(begin, end);
        }
    }

    fn publish(&mut self) {
        let mut view = self.engine.view();
        if self.plan.clock == ClockKind::Real {
            view.update_s = self.update_s;
        }
        view.late = self.report.late;
        // Frees the samples of the view before, unless a client still looks at them.
        self.view.publish(view);
    }
}

/// For reports.
fn name_of(order: &SculptOrder) -> &'static str {
    match order {
        SculptOrder::Take(_) | SculptOrder::Adjust(_) => "take",
        SculptOrder::Hold(_) => "hold",
        SculptOrder::Undo => "undo",
        SculptOrder::Redo => "redo",
        SculptOrder::Region { .. } => "region",
        SculptOrder::Combine { boolean: Boolean::Union, .. } => "union",
        SculptOrder::Combine { boolean: Boolean::Intersection, .. } => "intersection",
        SculptOrder::Combine { boolean: Boolean::Difference, .. } => "difference",
        SculptOrder::Emboss { depth_m, .. } if *depth_m < 0.0 => "engrave",
        SculptOrder::Emboss { .. } => "emboss",
        SculptOrder::Lay { .. } => "lay",
        SculptOrder::Draw(_) => "draw",
        SculptOrder::Pull { .. } => "pull",
        SculptOrder::SavePoints(_) => "save-points",
        SculptOrder::SaveSession(_) => "save-session",
        SculptOrder::Export(_) => "export",
    }
}
