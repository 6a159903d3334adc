//! The supervisor: takes an arm from its first tick to rest. One task owns all state changes.
//!
//! ```text
//!  ┌──────┐  file read  ┌────────┐  baked  ┌──────────┐  enable  ┌──────────┐  ramp up  ┌─────────┐
//!  │ Init ├────────────►│ Baking ├────────►│ Disabled ├─────────►│ Enabling ├──────────►│ Enabled │
//!  └──┬───┘             └───┬────┘         └────┬─────┘          └────┬─────┘           └────┬────┘
//!     │ 3 configuration     │ 3, 4 asset        │ 5 no operator       │ stop, signal,        │
//!     │                     │                   │ 6 refused           │ duration             │
//!     ▼                     ▼                   ▼                     ▼                      ▼
//!   exit                  exit                exit              ┌──────────┐ ◄───────────────┤
//!                                                               │ Stopping │ ramp down       │
//!                                                               └────┬─────┘                 │ any fault, from
//!                                                                    ▼                       ▼ any state above
//!                                                               ┌─────────┐             ┌───────┐
//!                                                  exit 0 ◄─────┤ Stopped │             │ Fault ├──► exit 7
//!                                                               └─────────┘             └───────┘
//! ```
//!
//! While it renders, movable objects take poses and a swap goes once around: Enabled, Stopping,
//! Disabled with zero force, where the scenes are exchanged, Enabling, Enabled. The phases tell it
//! as it is.
//!
//! Force flows in Enabling, Enabled and Stopping only, and in Braking that of a damper. Every way out, drawn or not, passes the
//! servo's stop guard: the last thing that the arm gets is a zero command.
//!
//! Data in: a prepared [`RenderJob`]. Data out: [`Notice`]s while it runs, one [`RunOutcome`] at
//! the end. Invariant: prints nothing.

mod job;
mod phase;
#[cfg(test)]
mod tests;
mod threads;

use core::time::Duration;
use std::sync::Arc;
use std::time::Instant;

use crossbeam::channel::{Receiver, after, never, select_biased, tick, unbounded};
use rtrb::RingBuffer;

pub use self::job::{Enable, LiveChannels, Operator, RenderJob, RunError, RunOutcome};
pub use self::phase::{Notice, Phase};
use self::threads::{ServoThread, spawn_drain, spawn_servo, with_live};
use crate::record::Watch;
use crate::servo::{Control, Ending, Order, Permit, RunPlan, ServoLoop, StopGuard};
use arms::attached::open::LinkNews;
use haptics::{Drive, OffCause};
use rt::clock::{ClockKind, RealClock, VirtualClock};
use rt::preflight::{KernelFacts, PreflightReport};
use rt::schedule::{self, ThreadRequest};
use rt::signals;

/// Records under way between servo and drain: four seconds at 1 kHz.
const RING_RECORDS: usize = 4096;

/// Beyond its ramp, how long the servo may take to end after a stop before the supervisor orders it
/// to quit.
const STOP_PATIENCE: Duration = Duration::from_secs(2);
/// The same under the virtual clock, where a tick takes as long as it takes.
const STOP_PATIENCE_VIRTUAL: Duration = Duration::from_secs(60);
/// How long an enable stays a disable first, so that the loop has seen it: some tens of ticks.
const ACKNOWLEDGE: Duration = Duration::from_millis(50);
/// How long it may take to quit before it is given up: an arm may take three seconds to close a link
/// that was lost, long after its zero.
const QUIT_PATIENCE: Duration = Duration::from_secs(4);
/// How often the control word is looked at for ends that others asked for.
const LOOK: Duration = Duration::from_millis(20);
/// How long the process goes on after Ctrl-Z: the zero command has left by then, as a disable takes
/// a tick.
const BEFORE_SUSPEND: Duration = Duration::from_millis(60);

/// Owns the phase. Everything it learns goes to `notify`.
pub struct Supervisor<N: FnMut(Notice<'_>)> {
    phase: Phase,
    /// The last one that was passed on.
    waits_for: OffCause,
    notify: N,
}

impl<N: FnMut(Notice<'_>)> Supervisor<N> {
    /// A supervisor in [`Phase::Init`].
    pub fn new(notify: N) -> Self {
        Self { phase: Phase::Init, waits_for: OffCause::None, notify }
    }

    /// Where it stands.
    pub fn phase(&self) -> Phase {
        self.phase
    }

    /// Runs the preparation of a scene as [`Phase::Baking`].
    ///
    /// # Errors
    /// Those of `prepare`.
    pub fn bake<T, E>(&mut self, prepare: impl FnOnce() -> Result<T, E>) -> Result<T, E> {
        self.enter(Phase::Baking);
        let prepared = prepare()?;
        self.enter(Phase::Disabled);
        Ok(prepared)
    }

    fn enter(&mut self, phase: Phase) {
        if self.phase != phase {
            self.phase = phase;
            (self.notify)(Notice::Phase(phase));
        }
    }

    /// Preflight, enable, render, stop, with nothing that changes. See [`Self::render_live`].
    ///
    /// # Errors
    /// As there.
    pub fn render(
        &mut self,
        job: RenderJob,
        control: &Arc<Control>,
    ) -> Result<RunOutcome, RunError> {
        self.render_live(job, LiveChannels::default(), control)
    }

    /// Preflight, enable, render, stop. Blocks until the arm is at rest. Every holder of `control`
    /// can take force away or end the run through it, at any time, before this call as well: force
    /// that was taken away then is not given at the start.
    ///
    /// # Errors
    /// See [`RunError`]; no tick was rendered then, except under [`RunError::Servo`].
    pub fn render_live(
        &mut self,
        job: RenderJob,
        live: LiveChannels,
        control: &Arc<Control>,
    ) -> Result<RunOutcome, RunError> {
        let capabilities = job.device.capabilities();
        let Operator { enables_at_start, waits_after_fault, holds_back, enables } = live.operator;
        let enabled = !holds_back && (capabilities.simulated || enables_at_start);
        if !enabled && enables.is_none() {
            // Zero on every failed start.
            drop(StopGuard::new(job.device));
            return Err(RunError::NoOperator);
        }
        if enabled {
            control.enable(Permit::FIRST);
        }
        // Without an operator a simulated arm could not be enabled again after Ctrl-Z.
        let goes_on_after_suspend = enabled && capabilities.simulated && enables.is_none();
        let period_s = job.scene.parameters.period_s;
        let plan = RunPlan {
            stop_at_tick: job
                .duration
                .map(|duration| (duration.as_secs_f64() / period_s).round() as u64),
            outlives_faults: waits_after_fault,
        };
        let news = live.news.unwrap_or_else(never);
        let subscribers = live.subscribers.clone();
        let live = LiveChannels { operator: Operator::default(), news: None, ..live };
        let ramp_down_s = job.scene.parameters.limits.ramp_down_s();
        let stop_patience = match job.clock {
            ClockKind::Real => STOP_PATIENCE,
            ClockKind::Virtual => STOP_PATIENCE_VIRTUAL,
        } + Duration::try_from_secs_f64(ramp_down_s).unwrap_or_default();

        let (producer, consumer) = RingBuffer::new(RING_RECORDS);
        let (events_sender, events) = unbounded();
        let servo = match job.clock {
            ClockKind::Real => {
                let servo = ServoLoop::new(
                    job.scene,
                    job.device,
                    RealClock,
                    control.clone(),
                    plan,
                    producer,
                );
                let request = ThreadRequest {
                    cpu: schedule::loop_cpu(job.realtime.cpu),
                    priority: job.realtime.priority,
                };
                spawn_servo(
                    with_live(servo.with_time_budget(job.time_budget_s), live),
                    Some(request),
                )?
            }
            ClockKind::Virtual => {
                let servo = ServoLoop::new(
                    job.scene,
                    job.device,
                    VirtualClock::default(),
                    control.clone(),
                    plan,
                    producer,
                );
                spawn_servo(with_live(servo.with_time_budget(job.time_budget_s), live), None)?
            }
        };

        let _quit_on_unwind = QuitOnUnwind { control, ended: servo.ended.clone() };
        let entered = servo.entered.recv().map_err(|_| RunError::Servo("ended before it began"))?;
        let preflight = entered.map_or_else(
            || PreflightReport::virtual_clock(&KernelFacts::read(0)),
            |entered| entered.judge(),
        );
        (self.notify)(Notice::Preflight(&preflight));
        if job.realtime.enforce && !preflight.passed() {
            drop(servo.go);
            // Ends without a tick; the guard writes zero.
            let _ = servo.thread.join();
            return Err(RunError::Refused(preflight));
        }
        let drain_thread = spawn_drain(consumer, subscribers, events_sender)?;
        servo.go.send(()).map_err(|_| RunError::Servo("ended before it began"))?;

        let enables = enables.unwrap_or_else(never);
        self.watch_until_ended(
            &servo,
            control,
            &events,
            (&enables, &news),
            (stop_patience, goes_on_after_suspend),
        )?;
        let report =
            servo.thread.join().ok().flatten().ok_or(RunError::Servo("ended without a report"))?;
        drain_thread.join().map_err(|_| {
            RunError::Servo("ended, and the thread that drains its records panicked")
        })?;
        for event in events.try_iter() {
            self.tell(&event);
        }
        // A fault that was acknowledged and stopped after is over.
        let at_fault = matches!(report.ending, Ending::Faulted | Ending::Panicked)
            || report.last.drive == Drive::Fault;
        self.enter(if at_fault { Phase::Fault } else { Phase::Stopped });
        Ok(RunOutcome { report, preflight })
    }

    /// Passes on notices, lets force flow when asked to, and watches over the end, until the servo
    /// thread has ended.
    fn watch_until_ended(
        &mut self,
        servo: &ServoThread,
        control: &Control,
        events: &Receiver<Watch>,
        (enables, news): (&Receiver<Enable>, &Receiver<LinkNews>),
        (stop_patience, goes_on_after_suspend): (Duration, bool),
    ) -> Result<(), RunError> {
        let look = tick(LOOK);
        let mut patience: Receiver<Instant> = never();
        let mut ending = None;
        let mut acknowledged: Receiver<Instant> = never();
        let mut permit = control.permit();
        let mut suspends_at: Option<Instant> = None;
        let mut events = events.clone();
        let mut enables = enables.clone();
        let mut news = news.clone();
        loop {
            let order = control.order();
            if control.is_ending() && ending != Some(order) {
                ending = Some(order);
                patience = after(if order == Order::Quit { QUIT_PATIENCE } else { stop_patience });
            }
            if signals::take_suspend() {
                suspends_at = Some(Instant::now() + BEFORE_SUSPEND);
            }
            if suspends_at.take_if(|at| Instant::now() >= *at).is_some() {
                // An order that was taken meanwhile would give force to an arm while the process is
                // stopped.
                control.disable();
                acknowledged = never();
                signals::stop_process();
                if goes_on_after_suspend {
                    control.enable(control.permit());
                }
            }
            select_biased! {
                recv(patience) -> _ => {
                    if control.order() == Order::Quit {
                        return Err(RunError::Servo("did not end; the arm may still hold its last \
                            command"));
                    }
                    control.quit();
                }
                recv(servo.ended) -> _ => return Ok(()),
                recv(enables) -> message => match message {
                    // Force flows already: nothing is to begin again at zero.
                    Ok(_) if control.order() == Order::Enable && matches!(self.phase, Phase::Enabling | Phase::Enabled) => {}
                    // Off first: a fault is acknowledged that way, and force starts from zero.
                    Ok(Enable(asked)) => if let Some(renewed) = control.renew(asked) {
                        permit = renewed;
                        acknowledged = after(ACKNOWLEDGE);
                    }
                    Err(_) => enables = never(),
                },
                recv(acknowledged) -> _ => {
                    acknowledged = never();
                    control.enable(permit);
                }
                recv(news) -> message => match message {
                    Ok(message) => (self.notify)(Notice::Link(&message)),
                    Err(_) => news = never(),
                },
                recv(events) -> event => match event {
                    Ok(event) => self.tell(&event),
                    Err(_) => events = never(),
                },
                recv(look) -> _ => {}
            }
        }
    }

    fn tell(&mut self, watch: &Watch) {
        match watch {
            Watch::Drive(record) => self.enter(Phase::of(record.output.drive)),
            Watch::Fault(record) => (self.notify)(Notice::Fault(record)),
            Watch::Scene(record) => (self.notify)(Notice::Scene(record)),
            Watch::Snapshot(record) => {
                let cause = record.output.off_cause;
                if core::mem::replace(&mut self.waits_for, cause) != cause
                    && !cause.advice().is_empty()
                {
                    (self.notify)(Notice::Waiting(cause));
                }
                (self.notify)(Notice::Status(record));
            }
        }
    }
}

/// A panic in a handler of notices must not leave the loop alone: a process that ends takes its
/// threads with it, stop guard or not.
struct QuitOnUnwind<'c> {
    control: &'c Control,
    ended: Receiver<()>,
}

impl Drop for QuitOnUnwind<'_> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            self.control.quit();
            let _ = self.ended.recv_timeout(QUIT_PATIENCE);
        }
    }
}
