//! One turn of the loop.

use std::sync::Arc;

use rtrb::{Producer, PushError};

use super::density::frame_in_use;
use super::waiting::Waiting;
use super::{CommandQueue, Control, DeadlineGrid, DensitySlot, LoadedScene, Order, StopGuard};
use crate::record::{FlightRecorder, TickRecord};
use arms::{Device, DeviceError};
use haptics::{self, Drive, DriveRequest, Faults, RenderScene, State, TickInput, TickOutput};
use rt::clock::{Clock, ClockKind};
use vps::spatial::{DeviceSample, SampleStatus, Wrench};

/// The tick. Always [`haptics::tick`] in the program; tests of the loop bring their own, to panic
/// or fault on demand.
pub type TickFunction = fn(&RenderScene, &mut State, &TickInput) -> TickOutput;

/// Ticks that are run on a copy of the state before the first real one: enough to touch every page
/// and teach the branch predictors.
const WARM_UP_TICKS: u32 = 256;
/// No more of them than fit into this, but [`WARM_UP_TICKS_MIN`]: with a large shell the start
/// would wait for nothing but repetition, ns.
const WARM_UP_NS: i64 = 10_000_000;
/// At least so many: the first one touches the pages, the others the branches.
const WARM_UP_TICKS_MIN: u32 = 8;

/// How a run is to end by itself. Counted in ticks, so that two runs under the virtual clock end on
/// the same bit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RunPlan {
    /// From this tick on the loop stops: ramps down, then ends. `None`: until the control says so.
    pub stop_at_tick: Option<u64>,
    /// A fault does not end the loop: it goes on with zero force until the operator has enabled
    /// again or stops it.
    pub outlives_faults: bool,
}

/// Why the loop ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Ending {
    /// It has not.
    #[default]
    Running,
    /// Ramped down after a stop, planned or ordered.
    Stopped,
    /// A fault; the command had gone to zero.
    Faulted,
    /// The ramp-down did not reach zero in its time; the guard wrote the zero.
    StopTimedOut,
    /// Ordered to end at once.
    Quit,
    /// The tick or the driver panicked.
    Panicked,
}

/// Whether there is a next step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// There is.
    Continue,
    /// There is not; [`ServoLoop::finish`] gives the report.
    End,
}

/// What the loop has to say when it is over.
#[derive(Debug)]
pub struct LoopReport {
    /// Ticks done.
    pub ticks: u64,
    /// When the first tick began, stopwatch time, ns.
    pub first_tick_ns: Option<i64>,
    /// Deadlines that passed without a tick.
    pub missed_deadlines: u64,
    /// Records that found the ring full.
    pub dropped_records: u64,
    /// Packets that the driver refused.
    pub packet_errors: u64,
    /// What a contact query might look at in one tick; `None`: everything. A recording that is to
    /// be replayed has to know it.
    pub contact_budget_points: Option<u32>,
    /// Every fault of the run.
    pub faults: Faults,
    /// Tick of the first fault.
    pub first_fault_tick: Option<u64>,
    /// Why it ended.
    pub ending: Ending,
    /// What the last tick gave.
    pub last: TickOutput,
    /// The last ticks, or those before the first fault.
    pub flight: FlightRecorder,
}

/// The loop. Runs in a thread of its own (`supervisor`), or step by step in a test.
///
/// ```text
///        ┌────────────────────────────────────────────────────────────────┐
///        ▼                                                                │
///  wait ──► read ──► tick ──► write ──► publish ──► ended? ──no───────────┘
///    │        │ error           │ error                └─yes─► zero command, report
///    │        └► stale or lost  └► lost: the next tick sees it
///    └ late: count, skip; too late with force on: the tick faults
/// ```
#[derive(Debug)]
pub struct ServoLoop<D: Device, C: Clock> {
    #[expect(
        clippy::disallowed_types,
        reason = "made and freed on the cold side, exchanged as a pointer"
    )]
    rendered: Box<LoadedScene>,
    commands: CommandQueue,
    tick_function: TickFunction,
    time_budget_s: Option<f64>,
    device: StopGuard<D>,
    clock: C,
    deadlines: DeadlineGrid,
    start_ns: i64,
    control: Arc<Control>,
    plan: RunPlan,
    records: Producer<TickRecord>,
    flight: FlightRecorder,

    tick: u64,
    /// How many scenes were rendered before this one.
    scene_idx: u32,
    /// Tick by which a stop or a fault must have led to zero; set when it begins.
    end_by_tick: Option<u64>,
    stop_ticks: u64,
    sample: DeviceSample,
    /// The arm refused the last command: the next sample counts as lost, whatever it says.
    device_lost: Option<SampleStatus>,
    /// A fault that only the driver knows of, until the operator acknowledges it with a disable.
    /// The tick holds its own.
    driver_fault: bool,
    enabled: bool,
    missed_deadlines: u64,
    dropped_records: u64,
    packet_errors: u64,
    faults: Faults,
    first_fault_tick: Option<u64>,
    first_tick_ns: Option<i64>,
    ending: Ending,
    last: TickOutput,
    /// When the last command was written, elapsed time of the clock, ns.
    commanded_ns: Option<i64>,
    /// The motors were commanded to make something then, if only to hold the links of the arm.
    has_force: bool,
}

impl<D: Device, C: Clock> ServoLoop<D, C> {
    /// A loop that is ready to step. Allocates; RT: start-up only.
    pub fn new(
        scene: Arc<RenderScene>,
        device: D,
        clock: C,
        control: Arc<Control>,
        plan: RunPlan,
        records: Producer<TickRecord>,
    ) -> Self {
        let period_s = scene.parameters.period_s;
        #[expect(clippy::disallowed_types, reason = "start-up")]
        let rendered = Box::new(LoadedScene::new(scene));
        Self {
            stop_ticks: rendered.stop_ticks(),
            rendered,
            commands: CommandQueue::default(),
            tick_function: haptics::tick,
            time_budget_s: None,
            device: StopGuard::new(device),
            clock,
            deadlines: DeadlineGrid::new(0, (period_s * 1e9).round() as i64),
            start_ns: 0,
            control,
            plan,
            records,
            flight: FlightRecorder::new(FlightRecorder::DEFAULT_TICKS),
            tick: 0,
            scene_idx: 0,
            end_by_tick: None,
            sample: DeviceSample::default(),
            device_lost: None,
            driver_fault: false,
            enabled: false,
            missed_deadlines: 0,
            dropped_records: 0,
            packet_errors: 0,
            faults: Faults::NONE,
            first_fault_tick: None,
            first_tick_ns: None,
            ending: Ending::Running,
            last: TickOutput::default(),
            commanded_ns: None,
            has_force: false,
        }
    }

    /// The same loop with another tick.
    #[must_use]
    pub fn with_tick(mut self, tick_function: TickFunction) -> Self {
        self.tick_function = tick_function;
        self
    }

    /// The same loop with a limit for the contact query, s; [`Self::warm_up`] turns it into a
    /// count.
    #[must_use]
    pub fn with_time_budget(mut self, time_budget_s: Option<f64>) -> Self {
        self.time_budget_s = time_budget_s;
        self
    }

    /// The same loop with commands that change its scene, or bring another one of the same period
    /// and arm.
    #[must_use]
    pub fn with_commands(mut self, commands: CommandQueue) -> Self {
        self.commands = commands;
        self
    }

    /// The same loop with a slot for frames of densities.
    #[must_use]
    pub fn with_density(mut self, density: DensitySlot) -> Self {
        self.rendered.density = Some(density);
        self
    }

    /// The arm.
    pub fn device(&mut self) -> &mut D {
        &mut self.device
    }

    /// Runs the tick on a copy of the state, in free space and in contact, without the arm, then sets the first deadline one
    /// period from now. Call once, in the thread of the loop, before the first step.
    pub fn warm_up(&mut self) {
        if let Some(time_budget_s) = self.time_budget_s {
            self.rendered.calibrate(&self.clock, time_budget_s);
        }
        let mut rehearsal = self.rendered.state.clone();
        let begin_ns = self.clock.stopwatch_ns();
        for n in 0..WARM_UP_TICKS {
            if n >= WARM_UP_TICKS_MIN && self.clock.stopwatch_ns() - begin_ns > WARM_UP_NS {
                break;
            }
            let sample = DeviceSample {
                sequence: u64::from(n) + 1,
                status: SampleStatus::Fresh,
                ..DeviceSample::default()
            };
            let input = TickInput { sample, request: DriveRequest::Enable, ..TickInput::default() };
            // What the first contact needs is not to be fetched in it.
            if n % 2 == 1 {
                rehearsal.move_into_contact(&self.rendered.scene, n as usize);
            }
            core::hint::black_box((self.tick_function)(
                &self.rendered.scene,
                &mut rehearsal,
                &input,
            ));
            core::hint::black_box((self.clock.elapsed_ns(), self.clock.stopwatch_ns()));
        }
        self.flight.note(&TickRecord::default());
        self.flight.clear();
        self.start_ns = self.clock.now_ns();
        self.deadlines = DeadlineGrid::new(self.start_ns, self.deadlines.period_ns());
    }

    /// One turn: wait → read → tick → write → publish. After [`Step::End`] it does nothing more.
    /// RT: safe.
    pub fn step(&mut self) -> Step {
        if self.ending != Ending::Running {
            return Step::End;
        }
        let wanted = self.wanted();
        if wanted == Order::Quit {
            self.device.stop();
            self.ending = Ending::Quit;
            return Step::End;
        }

        let due = self.deadlines.wait(&mut self.clock);
        self.missed_deadlines += due.missed;
        // A suspend of the machine does not show in loop time, and is a stall.
        let woken_ns = self.clock.elapsed_ns();
        let stall_ns = (self.rendered.scene.parameters.limits.stall_s * 1e9) as i64;
        let is_late = |last_ns: i64| woken_ns - last_ns > stall_ns;
        let stalled = self.clock.kind() == ClockKind::Real
            && self.has_force
            && self.commanded_ns.is_some_and(is_late);
        self.commands.receive(&mut self.rendered, self.scene_idx);
        // Before the clock of the tick starts: simulated time may wait here for a bake.
        let swaps = self.swap_is_due(wanted);
        self.exchange_density();

        let begin_ns = self.clock.stopwatch_ns();
        self.first_tick_ns.get_or_insert(begin_ns);
        let sample = self.read();
        let read_ns = self.clock.stopwatch_ns();
        self.commands.note_read(read_ns);
        let request = if swaps && wanted == Order::Enable {
            DriveRequest::Stop
        } else {
            self.request(wanted)
        };
        let time_s = self.tick as f64 * self.rendered.scene.parameters.period_s;
        let place = self.commands.next_placement(&mut self.rendered, time_s);
        let parameter_change = self.commands.next_change();
        let frame = frame_in_use(self.rendered.density.as_ref(), &self.rendered.state);
        let input = TickInput {
            sample,
            request,
            overrun: due.missed > 0,
            stalled,
            place,
            parameter_change,
            clay: frame,
        };
        let output = (self.tick_function)(&self.rendered.scene, &mut self.rendered.state, &input);
        let computed_ns = self.clock.stopwatch_ns();
        if output.drive.has_force() != self.enabled {
            self.enabled = output.drive.has_force();
            self.device.set_enabled(self.enabled);
            if self.enabled
                && let Some(hand) = self.device.hand()
            {
                let (device_from_grip, world_from_tool) =
                    self.rendered.state.indexed(&self.rendered.scene);
                hand.index(device_from_grip, world_from_tool);
            }
        }
        self.commands.guide_hand(self.device.hand(), output.world_from_tool);
        // The machine may have stood still since the sample was read: what it asked for then is not
        // for now. The arm gets zero, and the next tick the fault.
        self.commanded_ns = Some(woken_ns);
        let is_old =
            self.clock.kind() == ClockKind::Real && self.clock.elapsed_ns() - woken_ns > stall_ns;
        let rendered_device =
            self.write(if is_old { &Wrench::ZERO } else { &output.command_device });
        let written_ns = self.clock.stopwatch_ns();
        let beside_device = self.device.beside_device();
        self.has_force = [output.command_device, rendered_device, beside_device]
            .iter()
            .any(|wrench| *wrench != Wrench::ZERO);

        self.last = output;
        self.publish(&TickRecord {
            tick: self.tick,
            scene_idx: self.scene_idx,
            time_ns: due.now_ns - self.start_ns,
            wakeup_ns: due.late_ns,
            compute_ns: elapsed_ns(read_ns, computed_ns),
            device_ns: elapsed_ns(begin_ns, read_ns) + elapsed_ns(computed_ns, written_ns),
            input,
            output,
            rendered_device,
            beside_device,
            contact_budget_points: self.rendered.budget_points(),
        });
        if let LoadedScene { density: Some(density), state, .. } = &mut *self.rendered {
            density.tell(self.tick, sample.buttons, state, &output, self.clock.kind());
        }
        let step = self.conclude(wanted, &output);
        if swaps && step == Step::Continue {
            self.swap_at_zero(&output);
        }
        step
    }

    /// Takes the newest frame of densities. An end of the loop from outside does not wait for one.
    fn exchange_density(&mut self) {
        let control = &self.control;
        let clock = self.clock.kind();
        if let LoadedScene { density: Some(density), state, .. } = &mut *self.rendered {
            density.exchange(state, clock, || control.is_ending());
        }
    }

    /// True when the force is to go to zero for another scene. A stop and a fault that is not
    /// acknowledged go first.
    fn swap_is_due(&mut self, wanted: Order) -> bool {
        let now = (self.tick, self.scene_idx);
        let clock = self.clock.kind();
        let control = &self.control;
        let may = matches!(wanted, Order::Enable | Order::Disable)
            && self.last.faults.is_empty()
            && !self.driver_fault;
        may && self.commands.is_scene_due(&mut self.rendered, now, clock, || control.is_ending())
    }

    /// Exchanges the scenes once no force is left. The tool stays where it stands, if it is free in
    /// the new scene.
    fn swap_at_zero(&mut self, output: &TickOutput) {
        let at_zero = output.drive == Drive::Disabled && output.command_device == Wrench::ZERO;
        let before = self.rendered.state.handover();
        if at_zero
            && output.faults.is_empty()
            && !self.driver_fault
            && self.commands.exchange(&mut self.rendered)
        {
            let LoadedScene { scene, state, hand, starts_anew, .. } = &mut *self.rendered;
            state.resume_at(scene, (!*starts_anew).then_some(output.world_from_tool), before);
            if let Some(own) = self.device.hand() {
                own.exchange(hand);
            }
            self.stop_ticks = self.rendered.stop_ticks();
            self.scene_idx += 1;
        }
    }

    /// What the supervisor wants, or the stop that the plan foresees.
    fn wanted(&mut self) -> Order {
        let order = self.control.order();
        if order == Order::Disable {
            self.driver_fault = false;
        }
        let planned_stop =
            self.plan.stop_at_tick.is_some_and(|stop_at_tick| self.tick >= stop_at_tick);
        if planned_stop && order != Order::Quit { Order::Stop } else { order }
    }

    /// What the tick gets of it: after a fault that it does not know of, such as a command that the
    /// driver refused, zero now and no ramp.
    fn request(&self, wanted: Order) -> DriveRequest {
        match wanted {
            _ if self.driver_fault => DriveRequest::Disable,
            Order::Disable => DriveRequest::Disable,
            Order::Enable => DriveRequest::Enable,
            // Force was taken away, and stays away also on the way to the end.
            Order::Stop if !self.control.allows_force() => DriveRequest::Disable,
            Order::Stop | Order::Quit => DriveRequest::Stop,
        }
    }

    fn read(&mut self) -> DeviceSample {
        match self.device.read() {
            Ok(sample) => {
                self.packet_errors += u64::from(sample.corrupt_packets);
                self.sample = sample;
            }
            Err(DeviceError::Packet | DeviceError::NonFinite | DeviceError::Stalled) => {
                self.packet_errors += 1;
                (self.sample.corrupt_packets, self.sample.lost_packets) = (1, 0);
                self.sample.status = SampleStatus::Stale;
            }
            Err(DeviceError::Lost | DeviceError::Os(_)) => self.sample.status = SampleStatus::Lost,
            Err(DeviceError::Link) => self.sample.status = SampleStatus::LinkLost,
        }
        if let Some(lost) = self.device_lost.take() {
            self.sample.status = lost;
        }
        self.sample
    }

    fn write(&mut self, command_device: &Wrench) -> Wrench {
        match self.device.write(command_device) {
            Ok(rendered_device) => return rendered_device,
            // The tick's own finite check comes first, so this is a second check; the driver sent
            // zero.
            Err(DeviceError::NonFinite) => {
                self.driver_fault = true;
                self.note_faults(Faults::NON_FINITE);
            }
            Err(DeviceError::Stalled) => {
                self.driver_fault = true;
                self.note_faults(Faults::OVERRUN);
            }
            Err(DeviceError::Packet) => self.packet_errors += 1,
            Err(DeviceError::Lost | DeviceError::Os(_)) => {
                self.device_lost = Some(SampleStatus::Lost)
            }
            Err(DeviceError::Link) => self.device_lost = Some(SampleStatus::LinkLost),
        }
        Wrench::ZERO
    }

    fn publish(&mut self, record: &TickRecord) {
        self.flight.note(record);
        let mut record = *record;
        let waiting = Waiting::new();
        loop {
            match self.records.push(record) {
                Ok(()) => return,
                // Simulated time can wait for the drain, so that nothing is lost and two runs give
                // the same records. A drain that has gone will not take anything out.
                Err(PushError::Full(back))
                    if self.clock.kind() == ClockKind::Virtual && !self.records.is_abandoned() =>
                {
                    record = back;
                    waiting.pause();
                }
                Err(PushError::Full(_)) => {
                    self.dropped_records += 1;
                    return;
                }
            }
        }
    }

    fn note_faults(&mut self, faults: Faults) {
        if !faults.is_empty() {
            self.faults |= faults;
            self.first_fault_tick.get_or_insert(self.tick);
            self.flight.freeze();
        }
    }

    /// Decides whether this was the last tick, and counts it.
    fn conclude(&mut self, wanted: Order, output: &TickOutput) -> Step {
        self.note_faults(output.faults);
        let faulted = !self.faults.is_empty() && !self.plan.outlives_faults;
        if wanted == Order::Stop || faulted {
            let end_by_tick =
                *self.end_by_tick.get_or_insert(self.tick.saturating_add(self.stop_ticks));
            let at_rest = matches!(output.drive, Drive::Disabled | Drive::Fault)
                && output.command_device == Wrench::ZERO;
            if at_rest {
                self.ending = if faulted { Ending::Faulted } else { Ending::Stopped };
            } else if self.tick >= end_by_tick {
                self.ending = if faulted { Ending::Faulted } else { Ending::StopTimedOut };
            }
        }
        self.tick += 1;
        if self.ending == Ending::Running {
            Step::Continue
        } else {
            self.device.stop();
            Step::End
        }
    }

    /// Takes note of a panic that was caught at the edge of the thread: zero command first, then
    /// the fault.
    pub fn panicked(&mut self) {
        self.device.stop();
        self.note_faults(Faults::PANIC);
        self.ending = Ending::Panicked;
    }

    /// Ends the loop: the arm gets zero, the ring's producer goes, the report comes out.
    pub fn finish(self) -> LoopReport {
        LoopReport {
            ticks: self.tick,
            missed_deadlines: self.missed_deadlines,
            dropped_records: self.dropped_records,
            packet_errors: self.packet_errors,
            contact_budget_points: self.rendered.budget_points(),
            faults: self.faults,
            first_fault_tick: self.first_fault_tick,
            first_tick_ns: self.first_tick_ns,
            ending: self.ending,
            last: self.last,
            flight: self.flight,
        }
    }
}

fn elapsed_ns(from_ns: i64, to_ns: i64) -> u64 {
    (to_ns - from_ns).max(0).unsigned_abs()
}

#[cfg(test)]
mod tests;
