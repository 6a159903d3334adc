//! One task owns all state changes.

use core::time::Duration;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Instant;

use crossbeam::channel::{Receiver, Sender, after, bounded, never, select_biased, unbounded};
use rtrb::RingBuffer;

use crate::config::scene::RealtimeConfig;
use crate::device::Device;
use crate::device::attached::open::LinkNews;
use crate::error::Exit;
use crate::haptics::{Drive, OffCause, RenderScene};
use crate::rt::clock::{Clock, ClockKind, RealClock, VirtualClock};
use crate::rt::preflight::{KernelFacts, Report};
use crate::rt::schedule::{self, ThreadRequest, ThreadStanding};
use crate::servo::{ClaySlot, Control, Ending, LoopReport, Order, RunPlan, ServoLoop, StopGuard, SwapSlot, Wishes, run_to_end};
use crate::telemetry::{Counted, Drained, RealtimeSummary, SwapSummary, Taps, TickRecord, Totals, Watch, drain};

/// Records under way between servo and drain: four seconds at 1 kHz.
const RING_RECORDS: usize = 4096;

/// Beyond its ramp, how long the servo may take to end after a stop before it is told to quit.
const STOP_PATIENCE: Duration = Duration::from_secs(2);
/// The same under the virtual clock, where a tick takes as long as it takes.
const STOP_PATIENCE_VIRTUAL: Duration = Duration::from_secs(60);
/// How long an enable stays a disable first, so that the loop has seen it: some tens of ticks.
const ACKNOWLEDGE: Duration = Duration::from_millis(50);
/// How long it may take to quit before it is given up.
const QUIT_PATIENCE: Duration = Duration::from_secs(2);

/// Where the program stands; see the picture in [`crate::daemon`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// Nothing read yet.
    Init,
    /// Reading, checking and generating the scene.
    Baking,
    /// Loop ready or running, zero force.
    Disabled,
    /// Ramping up.
    Enabling,
    /// Rendering.
    Enabled,
    /// Ramping down.
    Stopping,
    /// A damper without stiffness.
    Braking,
    /// Zero force after a fault.
    Fault,
    /// At rest, done.
    Stopped,
}

impl Phase {
    /// For people.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Init => "init",
            Self::Baking => "baking",
            Self::Disabled => "disabled",
            Self::Enabling => "enabling",
            Self::Enabled => "enabled",
            Self::Stopping => "stopping",
            Self::Braking => "braking",
            Self::Fault => "fault",
            Self::Stopped => "stopped",
        }
    }

    const fn of(drive: Drive) -> Self {
        match drive {
            Drive::Disabled => Self::Disabled,
            Drive::Enabling => Self::Enabling,
            Drive::Enabled => Self::Enabled,
            Drive::Stopping => Self::Stopping,
            Drive::Braking => Self::Braking,
            Drive::Fault => Self::Fault,
        }
    }
}

/// What the supervisor tells while it works.
#[derive(Debug)]
pub enum Notice<'a> {
    /// A new phase.
    Phase(Phase),
    /// What the machine offers; told before the first tick.
    Preflight(&'a Report),
    /// The newest tick, about ten times a second.
    Status(&'a TickRecord),
    /// The tick in which a fault appeared.
    Fault(&'a TickRecord),
    /// The first tick of another scene.
    Scene(&'a TickRecord),
    /// What became of the link of a real arm.
    Link(&'a LinkNews),
    /// Force is wanted and does not flow: something that an operator can mend is in the way.
    Waiting(OffCause),
}

/// Everything that rendering takes.
pub struct RenderJob {
    /// The scene, everything allocated.
    pub scene: Arc<RenderScene>,
    /// The open arm.
    pub device: Box<dyn Device>,
    /// What to ask of the operating system.
    pub realtime: RealtimeConfig,
    /// Ticks per second, for the summary.
    pub rate_hz: u32,
    /// What a contact query may take, s; `None`: as long as it takes.
    pub time_budget_s: Option<f64>,
    /// Which time the run follows.
    pub clock: ClockKind,
    /// Loop time after which the ramp-down begins; `None`: until a signal.
    pub duration: Option<Duration>,
}

/// What may change while a run goes on.
#[derive(Debug, Default)]
pub struct Live {
    /// Poses of movable objects.
    pub wishes: Wishes,
    /// Other scenes; the cold end is the caller's.
    pub swaps: Option<SwapSlot>,
    /// Frames of the scene's clay; the cold end is a [`studio`](super::studio).
    pub clay: Option<ClaySlot>,
    /// Who says when force may flow.
    pub operator: Operator,
    /// What becomes of the link of a real arm.
    pub news: Option<Receiver<LinkNews>>,
    /// Who wants every record.
    pub taps: Taps,
}

/// What an operator asks for while a run goes on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OperatorOrder {
    /// Force on, from zero. After a fault this acknowledges it.
    Enable,
    /// Force off, at once.
    Disable,
    /// Ramp down and end.
    Stop,
}

/// Who says when force may flow. A simulated arm has nobody to hurt and is enabled from the start, unless everybody is held back.
#[derive(Debug, Default)]
pub struct Operator {
    /// Force flows from the start; with a deadman, while it is held.
    pub enables_at_start: bool,
    /// After a fault the loop goes on with zero force and waits for an order; else it ends.
    pub waits_after_fault: bool,
    /// No arm is enabled before somebody says so, not even a simulated one.
    pub holds_back: bool,
    /// Orders as they come; `None`: nobody gives any.
    pub orders: Option<Receiver<OperatorOrder>>,
}

/// How a run ended.
#[derive(Debug)]
pub struct Outcome {
    /// When scenes were swapped.
    pub swaps: Vec<SwapSummary>,
    /// The result, as `--json` has it.
    pub totals: Totals,
    /// What the servo had to say, with the flight recorder.
    pub report: LoopReport,
    /// What the machine offered.
    pub preflight: Report,
}

impl Outcome {
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

/// Why a run did not come to an outcome.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// `enforce`, and a preflight check failed. The report was told as a notice.
    #[error("real-time preflight refused: {} check(s) failed and the mode is `enforce`", .0.failed().count())]
    Refused(Report),
    /// A real arm, and nobody who could let force flow.
    #[error("this is a real arm, and nobody may let force flow")]
    NobodyEnables,
    /// A thread could not be started.
    #[error("cannot start a thread: {0}")]
    Thread(#[from] std::io::Error),
    /// The servo did not end, or died outside its own net. The arm's own watchdog is the last resort.
    #[error("the servo thread {0}")]
    Servo(&'static str),
}

impl RunError {
    /// The exit code.
    pub const fn exit(&self) -> Exit {
        match self {
            Self::Refused(_) => Exit::RealtimeRefused,
            Self::NobodyEnables => Exit::Device,
            Self::Thread(_) | Self::Servo(_) => Exit::Internal,
        }
    }
}

/// Owns the phase. Everything it learns goes to `notify`.
pub struct Supervisor<N: FnMut(Notice<'_>)> {
    phase: Phase,
    /// Told last.
    waits_for: OffCause,
    notify: N,
}

struct Servo {
    thread: JoinHandle<Option<LoopReport>>,
    /// What the thread obtained; sent once.
    standing: Receiver<ThreadStanding>,
    /// A message starts the loop; dropping the sender ends the thread without a tick.
    go: Sender<()>,
    /// Never sends: it disconnects when the thread has ended, however it did.
    ended: Receiver<()>,
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
    pub fn render(&mut self, job: RenderJob, interrupts: &Receiver<()>) -> Result<Outcome, RunError> {
        self.render_live(job, Live::default(), interrupts)
    }

    /// Preflight, enable, render, stop. Blocks until the arm is at rest; each message of `interrupts` asks for a stop, a second one for a stop
    /// at once.
    ///
    /// # Errors
    /// See [`RunError`]; no tick was rendered then, except under [`RunError::Servo`].
    pub fn render_live(&mut self, job: RenderJob, live: Live, interrupts: &Receiver<()>) -> Result<Outcome, RunError> {
        let capabilities = job.device.capabilities();
        let Operator { enables_at_start, waits_after_fault, holds_back, orders } = live.operator;
        let enabled = !holds_back && (capabilities.simulated || enables_at_start);
        if !enabled && orders.is_none() {
            // Zero on every failed start.
            drop(StopGuard::new(job.device));
            return Err(RunError::NobodyEnables);
        }
        let control = Arc::new(Control::new(if enabled { Order::Enable } else { Order::Disable }));
        let period_s = job.scene.parameters.period_s;
        let plan = RunPlan {
            stop_at_tick: job.duration.map(|duration| (duration.as_secs_f64() / period_s).round() as u64),
            outlives_faults: waits_after_fault,
        };
        let news = live.news.unwrap_or_else(never);
        let taps = live.taps.clone();
        let live = Live { operator: Operator::default(), news: None, ..live };
        let stop_patience = match job.clock {
            ClockKind::Real => STOP_PATIENCE,
            ClockKind::Virtual => STOP_PATIENCE_VIRTUAL,
        } + Duration::try_from_secs_f64(job.scene.parameters.limits.ramp_s).unwrap_or_default();

        let request =
            ThreadRequest { cpu: job.realtime.cpu.unwrap_or_else(schedule::default_cpu), priority: job.realtime.priority };
        let memory_lock = MemoryLock::take(job.clock);
        let (producer, consumer) = RingBuffer::new(RING_RECORDS);
        let (events_sender, events) = unbounded();
        let servo = match job.clock {
            ClockKind::Real => {
                let servo = ServoLoop::new(job.scene, job.device, RealClock, control.clone(), plan, producer);
                spawn_servo(with_live(servo.with_time_budget(job.time_budget_s), live), Some(request))?
            }
            ClockKind::Virtual => {
                let servo = ServoLoop::new(job.scene, job.device, VirtualClock::default(), control.clone(), plan, producer);
                spawn_servo(with_live(servo.with_time_budget(job.time_budget_s), live), None)?
            }
        };

        let _quit_on_unwind = QuitOnUnwind { control: &control, ended: servo.ended.clone() };
        let standing = servo.standing.recv().map_err(|_| RunError::Servo("ended before it began"))?;
        let kernel = KernelFacts::read(request.cpu);
        let preflight = match &memory_lock.outcome {
            Some(outcome) => Report::judge(&kernel, request, standing, *outcome),
            None => Report::virtual_clock(&kernel),
        };
        (self.notify)(Notice::Preflight(&preflight));
        if job.realtime.enforce && !preflight.passed() {
            drop(servo.go);
            // Ends without a tick; the guard writes zero.
            let _ = servo.thread.join();
            return Err(RunError::Refused(preflight));
        }
        let drain_thread = spawn_drain(consumer, taps, events_sender)?;
        servo.go.send(()).map_err(|_| RunError::Servo("ended before it began"))?;

        let orders = orders.unwrap_or_else(never);
        self.watch_until_ended(&servo, &control, &events, (interrupts, &orders, &news), stop_patience)?;
        let report = servo.thread.join().ok().flatten().ok_or(RunError::Servo("died outside its own net"))?;
        let drained = drain_thread.join().map_err(|_| RunError::Servo("lost its drain"))?;
        for event in events.try_iter() {
            self.tell(&event);
        }
        // A fault that was acknowledged and stopped after is over.
        let at_fault = matches!(report.ending, Ending::Faulted | Ending::Panicked) || report.last.drive == Drive::Fault;
        self.enter(if at_fault { Phase::Fault } else { Phase::Stopped });
        let totals = drained.summary.totals(counted(&report, &preflight, job.rate_hz, job.clock));
        Ok(Outcome { swaps: drained.summary.swaps().to_vec(), totals, report, preflight })
    }

    /// Passes on what is told and turns signals into orders, until the servo thread has ended.
    fn watch_until_ended(
        &mut self,
        servo: &Servo,
        control: &Control,
        events: &Receiver<Watch>,
        (interrupts, orders, news): (&Receiver<()>, &Receiver<OperatorOrder>, &Receiver<LinkNews>),
        stop_patience: Duration,
    ) -> Result<(), RunError> {
        let mut patience: Receiver<Instant> = never();
        let mut acknowledged: Receiver<Instant> = never();
        let mut events = events.clone();
        let (mut interrupts, mut orders, mut news) = (interrupts.clone(), orders.clone(), news.clone());
        loop {
            select_biased! {
                recv(interrupts) -> message => match message {
                    Ok(()) if control.order() == Order::Stop => {
                        control.give(Order::Quit);
                        patience = after(QUIT_PATIENCE);
                    }
                    Ok(()) => {
                        control.give(Order::Stop);
                        patience = after(stop_patience);
                    }
                    // Nobody will interrupt: a caller without signals.
                    Err(_) => interrupts = never(),
                },
                recv(patience) -> _ => {
                    if control.order() == Order::Quit {
                        return Err(RunError::Servo("did not end; the arm may still hold its last command"));
                    }
                    control.give(Order::Quit);
                    patience = after(QUIT_PATIENCE);
                }
                recv(servo.ended) -> _ => return Ok(()),
                // A stop under way is not taken back.
                recv(orders) -> message => match message {
                    Ok(_) if matches!(control.order(), Order::Stop | Order::Quit) => {}
                    // Force flows already: nothing is to begin again at zero.
                    Ok(OperatorOrder::Enable)
                        if control.order() == Order::Enable && matches!(self.phase, Phase::Enabling | Phase::Enabled) => {}
                    Ok(OperatorOrder::Enable) => {
                        // Off first: a fault is acknowledged that way, and force starts from zero.
                        control.give(Order::Disable);
                        acknowledged = after(ACKNOWLEDGE);
                    }
                    Ok(OperatorOrder::Disable) => {
                        acknowledged = never();
                        control.give(Order::Disable);
                    }
                    Ok(OperatorOrder::Stop) => {
                        control.give(Order::Stop);
                        patience = after(stop_patience);
                    }
                    Err(_) => orders = never(),
                },
                recv(acknowledged) -> _ => {
                    acknowledged = never();
                    if control.order() == Order::Disable {
                        control.give(Order::Enable);
                    }
                }
                recv(news) -> message => match message {
                    Ok(message) => (self.notify)(Notice::Link(&message)),
                    Err(_) => news = never(),
                },
                recv(events) -> event => match event {
                    Ok(event) => self.tell(&event),
                    Err(_) => events = never(),
                },
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
                if core::mem::replace(&mut self.waits_for, cause) != cause && !cause.advice().is_empty() {
                    (self.notify)(Notice::Waiting(cause));
                }
                (self.notify)(Notice::Status(record));
            }
        }
    }
}

/// A panic in whoever is told must not leave the loop alone: a process that ends takes its threads with it, stop guard or not.
struct QuitOnUnwind<'c> {
    control: &'c Control,
    ended: Receiver<()>,
}

impl Drop for QuitOnUnwind<'_> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            self.control.give(Order::Quit);
            let _ = self.ended.recv_timeout(QUIT_PATIENCE);
        }
    }
}

fn with_live<C: Clock>(servo: ServoLoop<Box<dyn Device>, C>, live: Live) -> ServoLoop<Box<dyn Device>, C> {
    let servo = servo.with_wishes(live.wishes);
    let servo = match live.swaps {
        Some(swaps) => servo.with_swaps(swaps),
        None => servo,
    };
    match live.clay {
        Some(clay) => servo.with_clay(clay),
        None => servo,
    }
}

fn spawn_servo<C: Clock + 'static>(
    servo: ServoLoop<Box<dyn Device>, C>,
    request: Option<ThreadRequest>,
) -> Result<Servo, std::io::Error> {
    let (standing_sender, standing) = bounded(1);
    let (go, go_receiver) = bounded(1);
    let (ended_sender, ended) = bounded(1);
    let thread = std::thread::Builder::new().name("servo".to_owned()).spawn(move || {
        let _ended_sender = ended_sender;
        let obtained = request.map_or_else(ThreadStanding::default, schedule::enter_realtime);
        // Channels end here: from `run_to_end` on, the thread only touches atomics and the ring.
        standing_sender.send(obtained).ok()?;
        go_receiver.recv().ok()?;
        Some(run_to_end(servo))
    })?;
    Ok(Servo { thread, standing, go, ended })
}

fn spawn_drain(
    records: rtrb::Consumer<TickRecord>,
    taps: Taps,
    events: Sender<Watch>,
) -> Result<JoinHandle<Drained>, std::io::Error> {
    std::thread::Builder::new().name("drain".to_owned()).spawn(move || {
        drain(records, &taps, |watch| {
            // The supervisor outlives the drain; if it has given up, nobody listens.
            let _ = events.send(watch);
        })
    })
}

fn counted(report: &LoopReport, preflight: &Report, rate_hz: u32, clock: ClockKind) -> Counted {
    Counted {
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

/// Locked memory for the length of a run.
struct MemoryLock {
    /// `None`: not asked for.
    outcome: Option<Result<(), schedule::MemoryLockRefusal>>,
}

impl MemoryLock {
    fn take(clock: ClockKind) -> Self {
        Self { outcome: (clock == ClockKind::Real).then(schedule::lock_memory) }
    }
}

impl Drop for MemoryLock {
    fn drop(&mut self) {
        if matches!(self.outcome, Some(Ok(()))) {
            schedule::unlock_memory();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::device::Capabilities;
    use crate::device::simulated::{SimArm, SimParameters};
    use crate::haptics::Faults;
    use crate::servo::testing::{CountingArm, empty_scene};

    fn job(device: Box<dyn Device>, clock: ClockKind, duration_ms: u64) -> RenderJob {
        RenderJob {
            scene: empty_scene(),
            device,
            realtime: RealtimeConfig { enforce: false, cpu: None, priority: 10 },
            rate_hz: 1000,
            time_budget_s: None,
            clock,
            duration: Some(Duration::from_millis(duration_ms)),
        }
    }

    fn ideal() -> Box<dyn Device> {
        Box::new(SimArm::new(SimParameters::ideal(1e-3)).expect("valid"))
    }

    #[test]
    fn a_virtual_run_ends_by_itself_and_gives_a_summary() {
        let mut phases = Vec::new();
        let mut preflights = 0;
        let mut supervisor = Supervisor::new(|notice| match notice {
            Notice::Phase(phase) => phases.push(phase),
            Notice::Preflight(_) => preflights += 1,
            _ => {}
        });
        let prepared: Result<RenderJob, ()> = supervisor.bake(|| Ok(job(ideal(), ClockKind::Virtual, 20_000)));
        let outcome = supervisor.render(prepared.expect("prepared"), &never()).expect("an outcome");
        assert_eq!(outcome.exit(), Exit::Ok);
        assert!(outcome.totals.ticks > 20_000);
        assert_eq!((outcome.totals.missed_deadlines, outcome.totals.dropped_records), (0, 0));
        assert!((outcome.totals.duration_s - outcome.totals.ticks as f64 * 1e-3).abs() < 1e-9);
        assert_eq!(outcome.report.ending, Ending::Stopped);
        assert_eq!(preflights, 1);
        assert_eq!(phases.first(), Some(&Phase::Baking));
        assert_eq!(phases.last(), Some(&Phase::Stopped));
    }

    #[test]
    fn two_virtual_runs_agree_in_every_bit_but_the_measured_times() {
        let run = || {
            let outcome = Supervisor::new(|_| {}).render(job(ideal(), ClockKind::Virtual, 3000), &never()).expect("an outcome");
            let flight: Vec<_> =
                outcome.report.flight.records().map(|r| (r.tick, r.time_ns, r.wakeup_ns, r.input, r.output)).collect();
            (outcome.totals.ticks, outcome.totals.final_pose, outcome.report.last, flight)
        };
        assert_eq!(run(), run());
    }

    #[test]
    fn a_real_run_of_a_fifth_of_a_second_comes_to_its_end() {
        let outcome = Supervisor::new(|_| {}).render(job(ideal(), ClockKind::Real, 200), &never()).expect("an outcome");
        assert_eq!(outcome.exit(), Exit::Ok);
        assert!(outcome.totals.ticks > 200);
        assert_eq!(outcome.report.packet_errors, 0);
        assert!(outcome.preflight.rows.len() > 1);
    }

    #[test]
    fn a_real_arm_that_nobody_may_enable_is_refused() {
        let arm =
            CountingArm { capabilities: Capabilities { simulated: false, ..Capabilities::default() }, ..CountingArm::default() };
        let log = arm.log.clone();
        let refused = Supervisor::new(|_| {}).render(job(Box::new(arm), ClockKind::Virtual, 100), &never());
        assert!(matches!(refused, Err(RunError::NobodyEnables)));
        assert_eq!(log.writes.load(core::sync::atomic::Ordering::SeqCst), 0);
        assert_eq!(log.stops.load(core::sync::atomic::Ordering::SeqCst), 1, "zero on a failed start too");
    }

    #[test]
    fn after_a_fault_force_waits_for_the_operator_and_the_run_still_counts_as_faulted() {
        let arm = CountingArm { lost_from_read: Some(60), back_from_read: Some(120), ..CountingArm::default() };
        let log = arm.log.clone();
        let (order, orders) = bounded(4);
        let live = Live {
            operator: Operator { enables_at_start: true, waits_after_fault: true, holds_back: false, orders: Some(orders) },
            ..Live::default()
        };
        let mut job = job(Box::new(arm), ClockKind::Real, 0);
        job.duration = None;
        let wait_for = {
            let log = log.clone();
            move |n_reads| {
                while log.reads.load(core::sync::atomic::Ordering::SeqCst) < n_reads {
                    std::thread::sleep(Duration::from_millis(1));
                }
            }
        };
        let operator = std::thread::spawn(move || {
            wait_for(200);
            order.send(OperatorOrder::Enable).expect("the supervisor listens");
            wait_for(400);
            // Force flows: this one changes nothing.
            order.send(OperatorOrder::Enable).expect("the supervisor listens");
            wait_for(600);
            order.send(OperatorOrder::Stop).expect("the supervisor listens");
        });
        let mut phases = Vec::new();
        let mut supervisor = Supervisor::new(|notice| {
            if let Notice::Phase(phase) = notice {
                phases.push(phase);
            }
        });
        let outcome = supervisor.render_live(job, live, &never()).expect("an outcome");
        operator.join().expect("no panic");
        assert_eq!((outcome.exit(), outcome.report.ending), (Exit::Fault, Ending::Stopped));
        assert_eq!(outcome.report.faults, Faults::DEVICE_LOST);
        let of_interest: Vec<_> = phases.iter().filter(|phase| !matches!(phase, Phase::Stopping)).collect();
        use Phase::{Disabled, Enabled, Enabling, Fault, Stopped};
        // The fault was acknowledged, and the exit code remembers it.
        assert_eq!(of_interest, [&Enabling, &Fault, &Disabled, &Enabling, &Enabled, &Disabled, &Stopped], "{phases:?}");
    }

    #[test]
    fn an_interrupt_is_a_safe_stop() {
        let (sender, interrupts) = bounded(1);
        let arm =
            CountingArm { capabilities: Capabilities { simulated: true, ..Capabilities::default() }, ..CountingArm::default() };
        let log = arm.log.clone();
        let mut job = job(Box::new(arm), ClockKind::Real, 0);
        job.duration = None;
        let running = log.clone();
        let interrupter = std::thread::spawn(move || {
            while running.reads.load(core::sync::atomic::Ordering::SeqCst) < 20 {
                std::thread::sleep(Duration::from_millis(1));
            }
            sender.send(()).expect("the supervisor listens");
        });
        let outcome = Supervisor::new(|_| {}).render(job, &interrupts).expect("an outcome");
        interrupter.join().expect("no panic");
        assert_eq!((outcome.exit(), outcome.report.ending), (Exit::Ok, Ending::Stopped));
        assert!(log.stops.load(core::sync::atomic::Ordering::SeqCst) >= 1);
    }

    #[test]
    fn enforce_refuses_a_machine_that_fails_a_check_before_any_tick() {
        let arm =
            CountingArm { capabilities: Capabilities { simulated: true, ..Capabilities::default() }, ..CountingArm::default() };
        let log = arm.log.clone();
        let mut job = job(Box::new(arm), ClockKind::Real, 100);
        // No machine has this processor, so the affinity row fails everywhere.
        job.realtime = RealtimeConfig { enforce: true, cpu: Some(1_000_000), priority: 10 };
        let error = Supervisor::new(|_| {}).render(job, &never()).expect_err("refused");
        assert_eq!(error.exit(), Exit::RealtimeRefused);
        assert_eq!(log.reads.load(core::sync::atomic::Ordering::SeqCst), 0);
        assert!(log.stops.load(core::sync::atomic::Ordering::SeqCst) >= 1, "zero on a failed start too");
    }

    #[test]
    fn a_listener_that_panics_does_not_leave_the_loop_alone() {
        let sim = SimArm::new(SimParameters::ideal(1e-3)).expect("valid");
        let capabilities = sim.capabilities();
        let arm = CountingArm { capabilities, ..CountingArm::default() };
        let log = arm.log.clone();
        let job = RenderJob { duration: None, ..job(Box::new(arm), ClockKind::Real, 0) };
        let rendered = std::panic::catch_unwind(core::panic::AssertUnwindSafe(|| {
            Supervisor::new(|notice| assert!(!matches!(notice, Notice::Phase(Phase::Enabling)), "a panic on purpose"))
                .render(job, &never())
        }));
        assert!(rendered.is_err());
        assert!(log.stops.load(core::sync::atomic::Ordering::SeqCst) >= 1, "zero before the panic goes on");
    }

    #[test]
    fn a_panic_of_the_driver_is_a_fault_with_its_exit_code() {
        #[derive(Debug)]
        struct Exploding(SimArm);
        impl Device for Exploding {
            fn capabilities(&self) -> Capabilities {
                self.0.capabilities()
            }
            fn read(&mut self) -> Result<crate::spatial::DeviceSample, crate::device::DeviceError> {
                let sample = self.0.read()?;
                assert!(sample.sequence < 50, "a driver that panics on purpose");
                Ok(sample)
            }
            fn write(&mut self, wrench: &crate::spatial::Wrench) -> Result<crate::spatial::Wrench, crate::device::DeviceError> {
                self.0.write(wrench)
            }
            fn stop(&mut self) {
                self.0.stop();
            }
        }
        let arm = Exploding(SimArm::new(SimParameters::ideal(1e-3)).expect("valid"));
        let mut supervisor = Supervisor::new(|_| {});
        let outcome = supervisor.render(job(Box::new(arm), ClockKind::Virtual, 1000), &never()).expect("an outcome");
        assert_eq!(supervisor.phase(), Phase::Fault);
        assert_eq!(outcome.exit(), Exit::Fault);
        assert_eq!(outcome.totals.faults, ["panic"]);
        assert_eq!(outcome.report.flight.records().count(), 49);
    }
}
