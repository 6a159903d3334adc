//! Turns of the loop with an arm, a clock and ticks that do what their test says, to the
//! nanosecond.
#![expect(
    clippy::disallowed_types,
    clippy::expect_used,
    reason = "test code outside the loop, which notes what it sees"
)]

use core::cell::{Cell, RefCell};
use std::sync::Arc;

use glam::DVec3;
use rtrb::{Consumer, RingBuffer};

use super::{Ending, RunPlan, ServoLoop, Step, TickFunction};
use crate::record::TickRecord;
use crate::servo::testing::blocks_and_plate;
use crate::servo::{CommandQueue, Control, LoadedScene, ObjectPaths, SceneControls};
use arms::simulated::hand::HandPath;
use arms::{Capabilities, Device, DeviceError};
use document::poses::TimedPose;
use haptics::testing::{empty_scene, parameters};
use haptics::{
    Drive, DriveRequest, Faults, Placement, RenderScene, State, TickInput, TickOutput, tick,
};
use rt::clock::{Clock, ClockKind};
use vps::spatial::{DeviceSample, Pose, SampleStatus, Wrench};

/// When a test begins: no time from here is a time from 0.
const START_NS: i64 = 7_000_000_123;
const READ_NS: i64 = 300;
const WRITE_NS: i64 = 70;
const PUSH: Wrench = Wrench::new(DVec3::X, DVec3::ZERO);

thread_local! {
    static NOW_NS: Cell<i64> = const { Cell::new(START_NS) };
    /// What a tick takes.
    static TICK_NS: Cell<i64> = const { Cell::new(0) };
    /// How many ticks were asked for no force.
    static N_STOPPING: Cell<u32> = const { Cell::new(0) };
    /// What ticks were given, and where the tool stood in them.
    static NOTED: RefCell<Vec<(TickInput, Pose)>> = const { RefCell::new(Vec::new()) };
}

fn pass(ns: i64) {
    NOW_NS.set(NOW_NS.get() + ns);
}

/// Stands still but for what the arm and the ticks take, and for the loop's sleep.
struct SharedClock;

impl Clock for SharedClock {
    fn kind(&self) -> ClockKind {
        ClockKind::Real
    }

    fn now_ns(&mut self) -> i64 {
        NOW_NS.get()
    }

    fn sleep_until(&mut self, deadline_ns: i64) {
        NOW_NS.set(NOW_NS.get().max(deadline_ns));
    }

    fn stopwatch_ns(&self) -> i64 {
        NOW_NS.get()
    }
}

/// An arm of which some reads and writes fail, by number from 0; notes which orders it gets.
#[derive(Debug, Default)]
struct ScriptedArm {
    bad_reads: Vec<(usize, DeviceError)>,
    bad_writes: Vec<(usize, DeviceError)>,
    /// In each read that does not fail.
    corrupt_packets: u16,
    n_reads: usize,
    written: Vec<Wrench>,
    enabled: Vec<bool>,
}

fn answer(bad: &[(usize, DeviceError)], n: usize) -> Result<(), DeviceError> {
    bad.iter().find(|(bad, _)| *bad == n).map_or(Ok(()), |(_, error)| Err(*error))
}

impl Device for ScriptedArm {
    fn capabilities(&self) -> Capabilities {
        Capabilities::default()
    }

    fn read(&mut self) -> Result<DeviceSample, DeviceError> {
        pass(READ_NS);
        self.n_reads += 1;
        answer(&self.bad_reads, self.n_reads - 1)?;
        Ok(DeviceSample {
            sequence: self.n_reads as u64,
            status: SampleStatus::Fresh,
            corrupt_packets: self.corrupt_packets,
            ..DeviceSample::default()
        })
    }

    fn write(&mut self, wrench_device: &Wrench) -> Result<Wrench, DeviceError> {
        pass(WRITE_NS);
        self.written.push(*wrench_device);
        answer(&self.bad_writes, self.written.len() - 1)?;
        Ok(*wrench_device)
    }

    fn set_enabled(&mut self, enabled: bool) {
        self.enabled.push(enabled);
    }

    fn stop(&mut self) {}
}

/// Pushes while it may; off at once otherwise.
fn pushing(_: &RenderScene, _: &mut State, input: &TickInput) -> TickOutput {
    pass(TICK_NS.get());
    if input.request == DriveRequest::Enable {
        TickOutput { command_device: PUSH, drive: Drive::Enabled, ..TickOutput::default() }
    } else {
        TickOutput::default()
    }
}

/// The same, but comes to rest in four ticks: drive and command do not go together.
fn slowing(scene: &RenderScene, state: &mut State, input: &TickInput) -> TickOutput {
    if input.request == DriveRequest::Enable {
        return pushing(scene, state, input);
    }
    let (drive, command_device) = match N_STOPPING.replace(N_STOPPING.get() + 1) {
        0 => (Drive::Stopping, PUSH),
        1 => (Drive::Stopping, Wrench::ZERO),
        2 => (Drive::Disabled, PUSH),
        _ => (Drive::Disabled, Wrench::ZERO),
    };
    TickOutput { command_device, drive, ..TickOutput::default() }
}

/// Has a fault until it is disabled.
fn failing(_: &RenderScene, _: &mut State, input: &TickInput) -> TickOutput {
    if input.request == DriveRequest::Disable {
        TickOutput::default()
    } else {
        TickOutput { drive: Drive::Fault, faults: Faults::STALE, ..TickOutput::default() }
    }
}

fn aside() -> Pose {
    Pose::from_translation(DVec3::X * 0.1)
}

/// Is off, with the tool beside its start.
fn resting_aside(_: &RenderScene, _: &mut State, _: &TickInput) -> TickOutput {
    TickOutput { world_from_tool: aside(), ..TickOutput::default() }
}

/// Notes what it is given, and does not move the tool.
fn noting(scene: &RenderScene, state: &mut State, input: &TickInput) -> TickOutput {
    pass(TICK_NS.get());
    let without_force = TickInput { request: DriveRequest::Disable, ..*input };
    let output = tick(scene, state, &without_force);
    NOTED.with_borrow_mut(|noted| noted.push((*input, output.world_from_tool)));
    output
}

struct Bench {
    servo: ServoLoop<ScriptedArm, SharedClock>,
    records: Consumer<TickRecord>,
    control: Arc<Control>,
}

impl Bench {
    /// Force is allowed; not warmed up.
    fn cold(scene: Arc<RenderScene>, arm: ScriptedArm, plan: RunPlan, tick: TickFunction) -> Self {
        NOW_NS.set(START_NS);
        TICK_NS.set(0);
        N_STOPPING.set(0);
        NOTED.set(Vec::new());
        let (producer, records) = RingBuffer::new(64);
        let control = Arc::new(Control::enabled());
        let servo = ServoLoop::new(scene, arm, SharedClock, control.clone(), plan, producer);
        Self { servo: servo.with_tick(tick), records, control }
    }

    /// Without objects, ready to step.
    fn new(arm: ScriptedArm, plan: RunPlan, tick: TickFunction) -> Self {
        let mut bench = Self::cold(empty_scene(), arm, plan, tick);
        bench.servo.warm_up();
        bench
    }

    fn with_commands(self, commands: CommandQueue) -> Self {
        Self { servo: self.servo.with_commands(commands), ..self }
    }

    fn steps(&mut self, n_steps: usize) {
        assert!((0..n_steps).all(|_| self.servo.step() == Step::Continue));
    }

    fn records(&mut self) -> Vec<TickRecord> {
        std::iter::from_fn(|| self.records.pop().ok()).collect()
    }

    /// What each tick was asked for, by its first letter, and the scene that it was in.
    fn asked(&mut self) -> [String; 2] {
        let records = self.records();
        let request = |record: &TickRecord| match record.input.request {
            DriveRequest::Enable => 'E',
            DriveRequest::Disable => 'D',
            DriveRequest::Stop => 'S',
        };
        let scene = |record: &TickRecord| record.scene_idx.to_string();
        [records.iter().map(request).collect(), records.iter().map(scene).collect()]
    }
}

#[test]
fn a_warm_up_goes_between_free_space_and_contact_for_ten_milliseconds_or_eight_ticks() {
    let scene = blocks_and_plate(0);
    // The time is over where more than ten milliseconds are.
    for (tick_ns, n_ticks) in [(0, 256), (625_000, 17), (6_000_000, 8)] {
        let arm = ScriptedArm::default();
        let mut bench = Bench::cold(scene.clone(), arm, RunPlan::default(), noting);
        TICK_NS.set(tick_ns);
        bench.servo.warm_up();
        let noted = NOTED.take();
        assert_eq!(noted.len(), n_ticks);
        for (sequence, (input, _)) in (1..).zip(&noted) {
            let sample =
                DeviceSample { sequence, status: SampleStatus::Fresh, ..DeviceSample::default() };
            let expected =
                TickInput { sample, request: DriveRequest::Enable, ..TickInput::default() };
            assert_eq!(*input, expected);
        }
        // Every second tick stands at another place of contact, the one after it is there too.
        let places = noted.iter().map(|(_, world_from_tool)| world_from_tool);
        for (n, (before, now)) in (1..).zip(places.clone().zip(places.skip(1))) {
            assert_eq!(before != now, n % 2 == 1, "{tick_ns} ns, tick {n}");
        }
        assert_eq!(bench.servo.device().n_reads, 0);
    }
}

#[test]
fn a_record_counts_from_the_start_of_the_loop_and_tells_the_arm_from_the_tick() {
    let mut bench = Bench::new(ScriptedArm::default(), RunPlan::default(), pushing);
    TICK_NS.set(5000);
    bench.steps(2);
    let times: Vec<_> = bench
        .records()
        .iter()
        .map(|record| (record.time_ns, record.wakeup_ns, record.compute_ns, record.device_ns))
        .collect();
    assert_eq!(times, [(1_000_000, 0, 5000, 370), (2_000_000, 0, 5000, 370)]);
    let report = bench.servo.finish();
    assert_eq!(report.first_tick_ns, Some(START_NS + 1_000_000));
    assert_eq!(report.missed_deadlines, 0);
}

#[test]
fn a_command_is_replaced_by_zero_once_it_is_older_than_a_stall() {
    for (beyond_ns, written) in [(0, PUSH), (1, Wrench::ZERO)] {
        let mut bench = Bench::new(ScriptedArm::default(), RunPlan::default(), pushing);
        TICK_NS.set(50_000_000 - READ_NS + beyond_ns);
        bench.steps(1);
        assert_eq!(bench.servo.device().written, [written]);
    }
}

#[test]
fn the_arm_is_told_once_each_time_that_force_may_flow_or_not() {
    let mut bench = Bench::new(ScriptedArm::default(), RunPlan::default(), pushing);
    bench.steps(2);
    bench.control.disable();
    bench.steps(2);
    bench.control.enable(bench.control.permit());
    bench.steps(2);
    assert_eq!(bench.servo.device().enabled, [true, false, true]);
}

#[test]
fn a_stop_is_over_when_the_drive_is_off_and_its_command_is_zero() {
    let plan = RunPlan { stop_at_tick: Some(2), ..RunPlan::default() };
    let mut bench = Bench::new(ScriptedArm::default(), plan, slowing);
    bench.steps(5);
    assert_eq!(bench.servo.step(), Step::End);
    let report = bench.servo.finish();
    assert_eq!((report.ticks, report.ending), (6, Ending::Stopped));
}

#[test]
fn another_scene_is_taken_when_the_drive_is_off_and_its_command_is_zero() {
    let (mut controls, commands) = SceneControls::new(&parameters(), Vec::new());
    let mut bench =
        Bench::new(ScriptedArm::default(), RunPlan::default(), slowing).with_commands(commands);
    let next = Box::new(LoadedScene::new(empty_scene()).at_tick(3));
    assert!(controls.offer(next, Vec::new()).is_ok());
    bench.steps(9);
    assert_eq!(bench.asked(), ["EEESSSSEE", "000000011"]);
}

#[test]
fn without_force_another_scene_waits_for_its_tick_and_its_tool_stands_as_it_says() {
    let scene = empty_scene();
    for (starts_anew, world_from_tool) in [(false, aside()), (true, Pose::IDENTITY)] {
        let (mut controls, commands) = SceneControls::new(&parameters(), Vec::new());
        let mut bench = Bench::new(ScriptedArm::default(), RunPlan::default(), resting_aside)
            .with_commands(commands);
        bench.control.disable();
        let next = LoadedScene::new(scene.clone()).at_tick(3).starting_anew(starts_anew);
        assert!(controls.offer(Box::new(next), Vec::new()).is_ok());
        bench.steps(6);
        assert_eq!(bench.asked(), ["DDDDDD", "000011"]);
        // Without objects it stays where it is.
        let stands = bench.servo.rendered.state.clone().move_into_contact(&scene, 0);
        assert_eq!(stands, world_from_tool);
    }
}

#[test]
fn another_scene_waits_until_a_fault_is_acknowledged_and_changes_no_order() {
    let (mut controls, commands) = SceneControls::new(&parameters(), Vec::new());
    let plan = RunPlan { outlives_faults: true, ..RunPlan::default() };
    let mut bench = Bench::new(ScriptedArm::default(), plan, failing).with_commands(commands);
    let next = Box::new(LoadedScene::new(empty_scene()).at_tick(2));
    assert!(controls.offer(next, Vec::new()).is_ok());
    bench.steps(4);
    bench.control.disable();
    bench.steps(3);
    assert_eq!(bench.asked(), ["EEEEDDD", "0000001"]);
}

#[test]
fn a_command_that_the_driver_refused_takes_force_away_until_a_disable() {
    for (error, fault) in
        [(DeviceError::NonFinite, Faults::NON_FINITE), (DeviceError::Stalled, Faults::OVERRUN)]
    {
        let arm = ScriptedArm { bad_writes: Vec::from([(1, error)]), ..ScriptedArm::default() };
        let plan = RunPlan { outlives_faults: true, ..RunPlan::default() };
        let mut bench = Bench::new(arm, plan, pushing);
        bench.steps(4);
        bench.control.disable();
        bench.steps(1);
        bench.control.enable(bench.control.permit());
        bench.steps(1);
        assert_eq!(bench.asked(), ["EEDDDE", "000000"]);
        let report = bench.servo.finish();
        assert_eq!((report.faults, report.first_fault_tick), (fault, Some(1)));
    }
}

#[test]
fn what_a_link_garbles_is_counted_and_what_it_loses_is_told_to_the_tick() {
    use SampleStatus::{Fresh, LinkLost, Lost, Stale};
    let arm = ScriptedArm {
        bad_reads: Vec::from([
            (1, DeviceError::Packet),
            (2, DeviceError::NonFinite),
            (3, DeviceError::Stalled),
            (5, DeviceError::Link),
            (6, DeviceError::Lost),
        ]),
        bad_writes: Vec::from([
            (1, DeviceError::Packet),
            (7, DeviceError::Link),
            (8, DeviceError::Os(5)),
        ]),
        corrupt_packets: 2,
        ..ScriptedArm::default()
    };
    let mut bench = Bench::new(arm, RunPlan::default(), pushing);
    bench.steps(10);
    let samples: Vec<_> = bench.records().iter().map(|record| record.input.sample).collect();
    let status: Vec<_> = samples.iter().map(|sample| sample.status).collect();
    assert_eq!(status, [Fresh, Stale, Stale, Stale, Fresh, LinkLost, Lost, Fresh, LinkLost, Lost]);
    let garbled: Vec<_> = samples.iter().map(|sample| sample.corrupt_packets).take(5).collect();
    assert_eq!(garbled, [2, 1, 1, 1, 2]);
    // Five reads with two each, three that failed, one write.
    assert_eq!(bench.servo.finish().packet_errors, 14);
}

#[test]
fn an_object_is_asked_along_its_path_at_the_time_of_the_tick() {
    let at = |time_s: f64| TimedPose {
        time_s,
        pose: Pose::from_translation(DVec3::X * time_s),
        line: 0,
    };
    let path = HandPath::from_poses(&[at(0.0), at(1.0)], "x.csv".as_ref()).expect("it rises");
    let objects = [("plate".to_owned(), true)];
    let paths =
        ObjectPaths::new(&objects, [("plate".to_owned(), path.clone())]).expect("it may move");
    let mut bench = Bench::new(ScriptedArm::default(), RunPlan::default(), pushing)
        .with_commands(CommandQueue::default().with_paths(paths));
    bench.steps(4);
    for (n, record) in (0_u32..).zip(bench.records()) {
        let world_from_map = path.sample(f64::from(n) * 1e-3);
        assert_eq!(record.input.place, Some(Placement { obstacle_idx: 0, world_from_map }));
    }
}
