//! The edge of the servo's thread.

use std::panic::{AssertUnwindSafe, catch_unwind};

use super::{LoopReport, ServoLoop, Step};
use arms::Device;
use rt::clock::Clock;

/// Warms up, then steps to the end. A panic of the tick or the driver ends here: the arm gets zero,
/// and the report names the fault and keeps the flight recorder.
pub fn run_to_end<D: Device, C: Clock>(mut servo: ServoLoop<D, C>) -> LoopReport {
    // Unwind-safe: after a panic only the arm's `stop`, counters and the flight recorder are used,
    // and each of them is whole between any two statements of `step`.
    let outcome = catch_unwind(AssertUnwindSafe(|| {
        servo.warm_up();
        while servo.step() == Step::Continue {}
    }));
    if outcome.is_err() {
        servo.panicked();
    }
    servo.finish()
}

#[cfg(test)]
#[expect(
    clippy::panic,
    clippy::expect_used,
    clippy::disallowed_types,
    reason = "tests panic on purpose and collect"
)]
mod tests {
    use std::sync::Arc;
    use std::sync::atomic::Ordering;

    use glam::DVec3;
    use rtrb::{Consumer, RingBuffer};

    use super::*;
    use crate::record::TickRecord;
    use crate::servo::testing::{ArmLog, CountingArm, ScriptedClock};
    use crate::servo::{Control, Ending, LoadedScene, RunPlan, SceneControls, TickFunction};
    use arms::simulated::{SimArm, SimParameters};
    use haptics::testing::empty_scene;
    use haptics::{Drive, DriveRequest, Faults, RenderScene, State, TickInput, TickOutput};
    use rt::clock::{RealClock, VirtualClock};
    use vps::spatial::{SampleStatus, Wrench};

    /// Pushes with 1 N while enabled; stops at once on the order to stop.
    fn pushing(_: &RenderScene, _: &mut State, input: &TickInput) -> TickOutput {
        if input.request == DriveRequest::Enable {
            let command_device = Wrench::new(DVec3::X, DVec3::ZERO);
            TickOutput { command_device, drive: Drive::Enabled, ..TickOutput::default() }
        } else {
            TickOutput::default()
        }
    }

    /// Warm-up ticks see sequences from 1 too, but never an over-run; `overrun` marks the ticks of
    /// the loop.
    fn panicking_when_overrun(
        scene: &RenderScene,
        state: &mut State,
        input: &TickInput,
    ) -> TickOutput {
        assert!(!input.overrun, "a tick that panics on purpose");
        pushing(scene, state, input)
    }

    fn faulting_when_lost(scene: &RenderScene, state: &mut State, input: &TickInput) -> TickOutput {
        if input.sample.status == SampleStatus::Lost {
            TickOutput { drive: Drive::Fault, faults: Faults::DEVICE_LOST, ..TickOutput::default() }
        } else {
            pushing(scene, state, input)
        }
    }

    /// Never comes to rest.
    fn stubborn(_: &RenderScene, _: &mut State, _: &TickInput) -> TickOutput {
        let command_device = Wrench::new(DVec3::X, DVec3::ZERO);
        TickOutput { command_device, drive: Drive::Stopping, ..TickOutput::default() }
    }

    struct Bench<C: Clock> {
        servo: ServoLoop<CountingArm, C>,
        records: Consumer<TickRecord>,
        log: Arc<ArmLog>,
        control: Arc<Control>,
    }

    fn bench<C: Clock>(
        clock: C,
        arm: CountingArm,
        stop_at_tick: Option<u64>,
        ring: usize,
        tick: TickFunction,
    ) -> Bench<C> {
        let (producer, records) = RingBuffer::new(ring);
        let control = Arc::new(Control::enabled());
        let log = arm.log.clone();
        let servo = ServoLoop::new(
            empty_scene(),
            arm,
            clock,
            control.clone(),
            RunPlan { stop_at_tick, ..RunPlan::default() },
            producer,
        )
        .with_tick(tick);
        Bench { servo, records, log, control }
    }

    #[test]
    fn the_plan_ends_the_loop_on_its_tick_and_the_arm_hears_zero() {
        let bench = bench(VirtualClock::default(), CountingArm::default(), Some(50), 64, pushing);
        let report = run_to_end(bench.servo);
        assert_eq!((report.ticks, report.ending), (51, Ending::Stopped));
        assert_eq!((report.missed_deadlines, report.dropped_records), (0, 0));
        assert!(report.faults.is_empty() && !report.flight.is_frozen());
        assert_eq!(bench.log.reads.load(Ordering::SeqCst), 51, "warm-up does not touch the arm");
        assert!(bench.log.stops.load(Ordering::SeqCst) >= 1);
    }

    #[test]
    fn a_panic_in_the_tick_leaves_the_arm_with_zero_and_a_named_fault() {
        let clock = ScriptedClock::late_by(&[0, 0, 0, 5_000_000]);
        let bench = bench(clock, CountingArm::default(), None, 64, panicking_when_overrun);
        let report = run_to_end(bench.servo);
        assert_eq!(report.ending, Ending::Panicked);
        assert_eq!(report.faults, Faults::PANIC);
        assert_eq!(report.first_fault_tick, Some(3));
        assert!(report.flight.is_frozen());
        assert_eq!(
            report.flight.records().map(|record| record.tick).collect::<Vec<_>>(),
            [0, 1, 2]
        );
        assert!(
            bench.log.writes.load(Ordering::SeqCst) == 3
                && bench.log.stops.load(Ordering::SeqCst) >= 1
        );
        assert!(bench.log.held_force_x() == 0.0);
    }

    #[test]
    fn the_guard_alone_stops_the_arm_while_a_panic_unwinds() {
        let mut bench = bench(VirtualClock::default(), CountingArm::default(), None, 64, pushing);
        let log = bench.log.clone();
        let outcome = catch_unwind(AssertUnwindSafe(move || {
            bench.servo.warm_up();
            bench.servo.step();
            assert!(bench.log.held_force_x() > 0.0 && bench.log.stops.load(Ordering::SeqCst) == 0);
            let _owned = bench.servo;
            panic!("on purpose");
        }));
        assert!(outcome.is_err());
        assert!(log.held_force_x() == 0.0 && log.stops.load(Ordering::SeqCst) == 1);
    }

    #[test]
    fn a_lost_arm_is_a_fault_that_freezes_the_flight_recorder_and_ends_the_loop() {
        let arm = CountingArm { lost_from_read: Some(30), ..CountingArm::default() };
        let bench = bench(VirtualClock::default(), arm, None, 64, faulting_when_lost);
        let report = run_to_end(bench.servo);
        assert_eq!((report.ending, report.faults), (Ending::Faulted, Faults::DEVICE_LOST));
        assert_eq!((report.ticks, report.first_fault_tick), (31, Some(30)));
        assert!(report.flight.is_frozen());
        let last = report.flight.records().last().expect("records");
        assert_eq!((last.tick, last.output.faults), (30, Faults::DEVICE_LOST));
    }

    #[test]
    fn once_a_fault_is_acknowledged_scenes_take_each_others_place_again() {
        let arm = CountingArm {
            lost_from_read: Some(30),
            back_from_read: Some(60),
            ..CountingArm::default()
        };
        let (producer, mut records) = RingBuffer::new(4096);
        let control = Arc::new(Control::enabled());
        let (mut controls, commands) = SceneControls::new(&empty_scene().parameters, Vec::new());
        let plan = RunPlan { stop_at_tick: Some(1500), outlives_faults: true };
        let servo = ServoLoop::new(
            empty_scene(),
            arm,
            VirtualClock::default(),
            control.clone(),
            plan,
            producer,
        );
        let mut servo = servo.with_commands(commands);
        servo.warm_up();
        for n in 0.. {
            match n {
                // Offered while the fault is active: it waits.
                100 => assert!(
                    controls.offer(Box::new(LoadedScene::new(empty_scene())), Vec::new()).is_ok()
                ),
                300 => control.disable(),
                400 => control.enable(control.permit()),
                _ => {}
            }
            if servo.step() == Step::End {
                break;
            }
        }
        let report = servo.finish();
        assert_eq!((report.faults, report.ending), (Faults::DEVICE_LOST, Ending::Stopped));
        let mut changed = None;
        while let Ok(record) = records.pop() {
            if record.scene_idx == 1 {
                changed.get_or_insert(record.tick);
            }
            assert!(record.scene_idx == 0 || record.output.faults.is_empty());
        }
        assert!(changed.is_some_and(|tick| (300..700).contains(&tick)), "{changed:?}");
        assert!(controls.take_replaced().is_some());
    }

    #[test]
    fn a_disable_ends_the_ramp_of_a_stop() {
        let steps_after_stop = |is_disabled: bool| {
            let (producer, _records) = RingBuffer::new(4096);
            let control = Arc::new(Control::enabled());
            let plan = RunPlan::default();
            let arm = CountingArm::default();
            let mut servo = ServoLoop::new(
                empty_scene(),
                arm,
                VirtualClock::default(),
                control.clone(),
                plan,
                producer,
            );
            servo.warm_up();
            assert!((0..400).all(|_| servo.step() == Step::Continue));
            control.stop();
            assert!((0..10).all(|_| servo.step() == Step::Continue), "it ramps");
            if is_disabled {
                control.disable();
            }
            let steps = (0..1000).take_while(|_| servo.step() == Step::Continue).count();
            assert_eq!(servo.finish().ending, Ending::Stopped);
            steps
        };
        assert_eq!(steps_after_stop(true), 0, "the next tick is the last one");
        assert!(steps_after_stop(false) > 10);
    }

    #[test]
    fn a_refused_command_makes_the_next_sample_lost() {
        let arm = CountingArm { refuse_write_from: Some(10), ..CountingArm::default() };
        let bench = bench(VirtualClock::default(), arm, None, 64, faulting_when_lost);
        let report = run_to_end(bench.servo);
        assert_eq!((report.faults, report.first_fault_tick), (Faults::DEVICE_LOST, Some(11)));
    }

    #[test]
    fn over_runs_are_counted_ordered_to_the_tick_and_skipped() {
        let mut bench = bench(
            ScriptedClock::late_by(&[0, 2_500_000, 0, 0]),
            CountingArm::default(),
            Some(3),
            64,
            pushing,
        );
        bench.servo.warm_up();
        while bench.servo.step() == Step::Continue {}
        let report = bench.servo.finish();
        assert_eq!((report.ticks, report.missed_deadlines), (4, 2));
        let mut seen = Vec::new();
        while let Ok(record) = bench.records.pop() {
            seen.push((record.time_ns, record.wakeup_ns, record.input.overrun));
        }
        let expected = [
            (1_000_000, 0, false),
            (4_500_000, 2_500_000, true),
            (5_000_000, 0, false),
            (6_000_000, 0, false),
        ];
        assert_eq!(seen, expected);
    }

    /// Like the real tick: a stall while it pushes is a fault.
    fn faulting_when_stalled(
        scene: &RenderScene,
        state: &mut State,
        input: &TickInput,
    ) -> TickOutput {
        if input.stalled {
            TickOutput { drive: Drive::Fault, faults: Faults::OVERRUN, ..TickOutput::default() }
        } else {
            pushing(scene, state, input)
        }
    }

    #[test]
    fn a_machine_that_stood_still_while_nothing_was_on_the_motors_goes_on() {
        fn free(scene: &RenderScene, state: &mut State, input: &TickInput) -> TickOutput {
            assert!(!input.stalled);
            TickOutput { command_device: Wrench::ZERO, ..pushing(scene, state, input) }
        }
        let bench = bench(
            ScriptedClock::late_by(&[0, 0, 80_000_000, 0]),
            CountingArm::default(),
            Some(99),
            256,
            free,
        );
        assert!(run_to_end(bench.servo).faults.is_empty());
    }

    #[test]
    fn a_machine_that_stood_still_is_ordered_to_the_tick_by_time_whatever_the_number_of_ticks() {
        let limit_ns = 50_000_000;
        for (late_ns, is_stall) in [(limit_ns - 1_000_000, false), (limit_ns, true)] {
            let mut bench = bench(
                ScriptedClock::late_by(&[0, 0, late_ns, 0]),
                CountingArm::default(),
                Some(99),
                256,
                faulting_when_stalled,
            );
            let report = run_to_end(bench.servo);
            assert_eq!(report.faults.contains(Faults::OVERRUN), is_stall, "{late_ns} ns");
            let mut stalled = Vec::new();
            while let Ok(record) = bench.records.pop() {
                stalled.extend(record.input.stalled.then_some(record.tick));
            }
            assert_eq!(stalled.as_slice(), if is_stall { &[2_u64][..] } else { &[] });
        }
    }

    #[test]
    fn after_a_suspend_of_the_machine_the_first_command_is_zero_and_the_fault_has_a_name() {
        const HOUR_NS: i64 = 3_600_000_000_000;
        let clock = || ScriptedClock::suspended_for(&[0, 0, HOUR_NS]);
        let mut bench =
            bench(clock(), CountingArm::default(), Some(99), 256, faulting_when_stalled);
        bench.servo.warm_up();
        assert!((0..2).all(|_| bench.servo.step() == Step::Continue));
        assert!(bench.log.held_force_x() > 0.0, "it pushes when the machine is suspended");
        assert_eq!(bench.servo.step(), Step::End);
        assert!(bench.log.held_force_x() == 0.0);
        let report = bench.servo.finish();
        // Loop time does not show it: no deadline is missed.
        assert_eq!((report.faults, report.missed_deadlines), (Faults::OVERRUN, 0));
        assert_eq!(report.first_fault_tick, Some(2));
    }

    #[test]
    fn a_command_that_took_too_long_to_compute_is_replaced_by_zero() {
        fn slow(scene: &RenderScene, state: &mut State, input: &TickInput) -> TickOutput {
            if input.sample.sequence == 12 {
                let begin = std::time::Instant::now();
                while begin.elapsed().as_millis() < 80 {}
            }
            pushing(scene, state, input)
        }
        let mut bench = bench(RealClock, CountingArm::default(), None, 1024, slow);
        bench.servo.warm_up();
        let mut forces = Vec::new();
        for _ in 0..13 {
            bench.servo.step();
            forces.push(bench.log.held_force_x());
        }
        // The warm-up has samples of its own, the loop's begin at 1.
        assert_eq!(forces.get(10..12), Some(&[1.0, 0.0][..]), "{forces:?}");
        let mut stalled = Vec::new();
        while let Ok(record) = bench.records.pop() {
            stalled.extend(record.input.stalled.then_some(record.tick));
        }
        assert!(stalled.contains(&12), "the next tick knows of it: {stalled:?}");
    }

    #[test]
    fn a_full_ring_drops_and_counts_under_the_real_clock() {
        let bench = bench(ScriptedClock::default(), CountingArm::default(), Some(19), 8, pushing);
        let report = run_to_end(bench.servo);
        assert_eq!((report.ticks, report.dropped_records), (20, 12));
        assert_eq!(bench.records.slots(), 8);
        assert_eq!(report.flight.records().count(), 20, "the flight recorder has them all");
    }

    #[test]
    fn simulated_time_waits_for_the_drain_and_not_for_one_that_has_gone() {
        let mut ended =
            bench(VirtualClock::default(), CountingArm::default(), Some(999), 8, pushing);
        let drain = std::thread::spawn(move || {
            let mut n_records = 0;
            while !ended.records.is_abandoned() || !ended.records.is_empty() {
                n_records += u64::from(ended.records.pop().is_ok());
            }
            n_records
        });
        let report = run_to_end(ended.servo);
        assert_eq!((report.ticks, report.dropped_records), (1000, 0));
        assert_eq!(drain.join().expect("no panic"), 1000);

        let Bench { servo, records, .. } =
            bench(VirtualClock::default(), CountingArm::default(), Some(99), 8, pushing);
        drop(records);
        assert_eq!(run_to_end(servo).ticks, 100);
    }

    #[test]
    fn a_drive_that_will_not_rest_is_ended_after_the_ramp_and_its_grace() {
        let bench =
            bench(VirtualClock::default(), CountingArm::default(), Some(10), 1024, stubborn);
        let report = run_to_end(bench.servo);
        assert_eq!(report.ending, Ending::StopTimedOut);
        assert_eq!(report.ticks, 10 + 350 + 1);
        assert!(bench.log.held_force_x() == 0.0);
    }

    #[test]
    fn quit_ends_without_another_tick() {
        let mut bench = bench(VirtualClock::default(), CountingArm::default(), None, 64, pushing);
        bench.servo.warm_up();
        assert_eq!(bench.servo.step(), Step::Continue);
        bench.control.quit();
        assert_eq!(bench.servo.step(), Step::End);
        assert_eq!(bench.servo.step(), Step::End);
        assert_eq!(bench.log.writes.load(Ordering::SeqCst), 1);
        assert!(bench.log.held_force_x() == 0.0);
        assert_eq!(bench.servo.finish().ending, Ending::Quit);
    }

    #[test]
    fn two_runs_on_the_simulated_arm_give_the_same_records() {
        let run = || {
            let (producer, mut records) = RingBuffer::new(4096);
            let arm = SimArm::new(SimParameters::ideal(1e-3)).expect("valid");
            let control = Arc::new(Control::enabled());
            let plan = RunPlan { stop_at_tick: Some(2000), ..RunPlan::default() };
            let servo = ServoLoop::new(
                empty_scene(),
                arm,
                VirtualClock::default(),
                control,
                plan,
                producer,
            )
            .with_tick(pushing);
            let report = run_to_end(servo);
            let mut seen = Vec::new();
            while let Ok(record) = records.pop() {
                seen.push((
                    record.tick,
                    record.time_ns,
                    record.wakeup_ns,
                    record.input,
                    record.output,
                ));
            }
            (report.ticks, seen)
        };
        let (ticks, seen) = run();
        assert_eq!(ticks, 2001);
        assert_eq!((ticks, seen), run());
    }

    #[test]
    fn the_real_clock_drives_the_same_loop() {
        let bench = bench(RealClock, CountingArm::default(), Some(200), 1024, pushing);
        let report = run_to_end(bench.servo);
        assert_eq!((report.ticks, report.ending), (201, Ending::Stopped));
        assert!(report.faults.is_empty());
    }
}
