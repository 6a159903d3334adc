//! Frames of densities through the loop: from a simulation into the ticks, and back.

use core::time::Duration;
use std::sync::Arc;

use arms::{Capabilities, Device, DeviceError};
use engine::record::TickRecord;
use engine::servo::{
    Control, DensityFeed, DensitySlot, FramePublishError, RunPlan, ServoLoop, Step,
};
use glam::{DMat3, DVec3};
use haptics::clay::{Clay, Rope};
use haptics::{CouplingMode, FilterParameters, FrameInUse, Inertia, Parameters, RenderScene, Tool};
use rt::clock::{Clock, RealClock, VirtualClock};
use vps::density::{DensityFrame, FrameError, Lattice, Raster};
use vps::pointshell::shell::Shell;
use vps::spatial::{DeviceSample, Pose, SampleStatus, Wrench};

/// Distance of the nodes, m.
const H: f64 = 1e-3;
/// A box around the origin, 40 mm wide.
const LATTICE: Lattice = Lattice { origin_map: DVec3::splat(-0.02), spacing_m: H, dims: [41; 3] };

fn raster(lattice: Lattice, density_m: impl Fn(DVec3) -> f64) -> Raster {
    let mut raster = Raster::uniform(lattice, 0.0);
    let [nx, ny, nz] = lattice.dims;
    for node in (0..nx).flat_map(|x| (0..ny).flat_map(move |y| (0..nz).map(move |z| [x, y, z]))) {
        raster.values_m_mut()[lattice.index(node)] = density_m(lattice.position(node)) as f32;
    }
    raster.measure();
    raster
}

/// A half space below z = 0: the base, and a region of 10 mm around the origin.
fn half_space() -> DensityFrame {
    let region = Lattice { origin_map: LATTICE.position([15; 3]), dims: [11; 3], ..LATTICE };
    let base = Arc::new(raster(LATTICE, |place| -place.z));
    let region = raster(region, |place| -place.z);
    let mut frame = DensityFrame { sequence: 0, base, region, rope_map: None, is_leap: false };
    frame.make_ready(None).expect("a sound frame");
    frame
}

/// Moves the surface of the region.
fn set_top(frame: &mut DensityFrame, top_m: f64) {
    let lattice = *frame.region.lattice();
    let [_, ny, nz] = lattice.dims;
    for (n, value_m) in frame.region.values_m_mut().iter_mut().enumerate() {
        *value_m = (top_m - lattice.position([n / (ny * nz), n / nz % ny, n % nz]).z) as f32;
    }
}

/// A point that stands where the hand is, with the force as it is: no filter between.
fn scene(smoothing: f64) -> RenderScene {
    let mut parameters = Parameters::unlimited(1e-3);
    parameters.coupling.mode = CouplingMode::Direct;
    parameters.filter = FilterParameters { cutoff_hz: [f64::INFINITY; 2] };
    parameters.limits.speed_m_per_s = 1e3;
    let rope = Rope { stiffness_n_per_m: 300.0, force_n: 2.0 };
    let frame = half_space();
    RenderScene {
        parameters,
        obstacles: Vec::new(),
        clay: Some(Clay { world_from_map: Pose::IDENTITY, frame, smoothing, rope }),
        tool: Tool {
            shell: Shell::new(&[(DVec3::ZERO, DVec3::Z)], H),
            inertia: Inertia {
                mass_kg: 0.05,
                body_kg_m2: DMat3::IDENTITY * 1e-6,
                least_kg_m2: 1e-6,
            },
            center_of_mass_tool: DVec3::ZERO,
        },
    }
}

#[test]
fn a_frame_that_cannot_be_touched_is_refused_and_comes_back() {
    let sound = half_space;
    let (mut feed, slot) = DensitySlot::new(&sound(), &Pose::IDENTITY, 4);
    let mut refused =
        |frame: DensityFrame| feed.publish(Box::new(frame)).expect_err("refused").0.to_string();
    let shifted = Lattice { origin_map: DVec3::splat(-4.7e-3), dims: [11; 3], ..LATTICE };
    let thin = Lattice { dims: [11, 1, 11], ..LATTICE };
    for (frame, says) in [
        (DensityFrame { region: raster(shifted, |_| 0.0), ..sound() }, "whole nodes of the base"),
        (
            DensityFrame {
                region: raster(Lattice { spacing_m: 2.0 * H, ..shifted }, |_| 0.0),
                ..sound()
            },
            "its spacing",
        ),
        (DensityFrame { region: raster(thin, |_| 0.0), ..sound() }, "at least 2"),
        (
            DensityFrame {
                region: raster(Lattice { spacing_m: 0.0, ..shifted }, |_| 0.0),
                ..sound()
            },
            "above 0",
        ),
        (
            DensityFrame { region: raster(*sound().region.lattice(), |_| f64::NAN), ..sound() },
            "halve the step",
        ),
        (DensityFrame { rope_map: Some(DVec3::NAN), ..sound() }, "anchor"),
        (
            DensityFrame { base: Arc::new(Raster::uniform(LATTICE, f32::INFINITY)), ..sound() },
            "not finite",
        ),
        (
            DensityFrame {
                base: Arc::new({
                    let mut base = raster(LATTICE, |_| 0.0);
                    base.values_m_mut()[0] = 1.0;
                    base
                }),
                ..sound()
            },
            "Raster::measure",
        ),
    ] {
        let message = refused(frame);
        assert!(message.contains(says), "{message}");
    }
    let error = DensityFrame { region: raster(thin, |_| 0.0), ..sound() }
        .make_ready(None)
        .expect_err("refused");
    assert_eq!(error, FrameError::Dims { which: "region", dims: [11, 1, 11] });
    // All that may be under way, then no more.
    while let Some(spare) = feed.spare() {
        feed.publish(spare).expect("room");
    }
    for _ in 0..5 {
        feed.publish(Box::new(sound())).expect("room");
    }
    assert_eq!(feed.publish(Box::new(sound())).expect_err("full").0, FramePublishError::Full);
    drop(slot);
    assert_eq!(feed.publish(Box::new(sound())).expect_err("over").0, FramePublishError::Over);
}

/// An arm that presses a point into the clay and draws circles.
#[derive(Debug, Default)]
struct Circling {
    sequence: u64,
}

impl Device for Circling {
    fn capabilities(&self) -> Capabilities {
        Capabilities::default()
    }

    fn read(&mut self) -> Result<DeviceSample, DeviceError> {
        self.sequence += 1;
        let angle = 5e-3 * self.sequence as f64;
        let depth_m = 3e-3 * (self.sequence as f64 / 300.0).min(1.0);
        let pose =
            Pose::from_translation(DVec3::new(2e-3 * angle.sin(), 2e-3 * angle.cos(), -depth_m));
        let buttons = (self.sequence / 100 % 2) as u32;
        Ok(DeviceSample {
            sequence: self.sequence,
            status: SampleStatus::Fresh,
            pose,
            buttons,
            ..DeviceSample::default()
        })
    }

    fn write(&mut self, wrench_device: &Wrench) -> Result<Wrench, DeviceError> {
        Ok(*wrench_device)
    }

    fn stop(&mut self) {}
}

const UPDATE_TICKS: u64 = 4;

/// Clay that gives way by what presses on it: one frame for every so many states.
fn simulate(mut feed: DensityFeed) -> u64 {
    let mut top_m = 0.0;
    let mut n_states = 0_u64;
    let mut n_frames = 0_u64;
    loop {
        while let Some(state) = feed.next_state() {
            assert_eq!((state.tick, state.dropped), (n_states, 0));
            n_states += 1;
            top_m -= 1e-6 * state.force_map.z;
            if !n_states.is_multiple_of(UPDATE_TICKS) {
                continue;
            }
            let mut next = loop {
                match feed.spare() {
                    Some(next) => break next,
                    None if feed.is_over() => return n_frames,
                    None => std::thread::yield_now(),
                }
            };
            n_frames += 1;
            set_top(&mut next, top_m);
            next.sequence = n_frames;
            if let Err((error, _)) = feed.publish(next) {
                assert_eq!(error, FramePublishError::Over);
                return n_frames;
            }
        }
        if feed.is_over() {
            return n_frames;
        }
        std::thread::yield_now();
    }
}

fn sculpting(
    clock: impl Clock,
    n_ticks: u64,
) -> (ServoLoop<Circling, impl Clock>, DensityFeed, rtrb::Consumer<TickRecord>) {
    smoothed(clock, n_ticks, Clay::smoothing_between(UPDATE_TICKS as f64 * 1e-3, 1e-3))
}

fn smoothed<C: Clock>(
    clock: C,
    n_ticks: u64,
    alpha: f64,
) -> (ServoLoop<Circling, C>, DensityFeed, rtrb::Consumer<TickRecord>) {
    let scene = scene(alpha);
    let clay = scene.clay.as_ref().expect("clay");
    let (feed, slot) = DensitySlot::new(&clay.frame, &clay.world_from_map, UPDATE_TICKS);
    let (producer, consumer) = rtrb::RingBuffer::new(n_ticks as usize + 200);
    let control = Arc::new(Control::enabled());
    let plan = RunPlan { stop_at_tick: Some(n_ticks), ..RunPlan::default() };
    let mut servo =
        ServoLoop::new(Arc::new(scene), Circling::default(), clock, control, plan, producer)
            .with_density(slot);
    servo.warm_up();
    (servo, feed, consumer)
}

fn records(consumer: &mut rtrb::Consumer<TickRecord>) -> Vec<TickRecord> {
    std::iter::from_fn(|| consumer.pop().ok()).collect()
}

#[test]
fn under_simulated_time_two_runs_of_clay_are_the_same() {
    let run = || {
        let (mut servo, feed, mut consumer) = sculpting(VirtualClock::default(), 1500);
        let simulation = std::thread::spawn(|| simulate(feed));
        while servo.step() == Step::Continue {}
        drop(servo);
        (records(&mut consumer), simulation.join().expect("no panic"))
    };
    let ((first, n_first), (second, n_second)) = (run(), run());
    assert!(first.len() >= 1500 && n_first.abs_diff(n_second) <= 1);
    for (one, other) in first.iter().zip(&second) {
        let expected = FrameInUse { sequence: one.tick / UPDATE_TICKS, is_last: false };
        assert_eq!(
            (one.input.clay, other.input.clay),
            (Some(expected), Some(expected)),
            "tick {}",
            one.tick
        );
        assert_eq!(one.output, other.output, "tick {}", one.tick);
    }
    // The clay gave way: less than at the first touch, more than nothing.
    let force_n = first[1450].output.contact_world.force.z;
    assert!(force_n > 0.1 && force_n < 2.5, "{force_n} N");
}

#[test]
fn a_simulation_that_goes_leaves_its_last_frame_and_is_missed() {
    let (mut servo, mut feed, mut consumer) = sculpting(VirtualClock::default(), 400);
    let mut next = feed.spare().expect("a spare");
    next.sequence = 77;
    feed.publish(next).expect("room");
    drop(feed);
    while servo.step() == Step::Continue {}
    let records = records(&mut consumer);
    assert!(records.len() >= 400, "{} ticks: the loop did not wait", records.len());
    let first =
        |wanted: FrameInUse| records.iter().position(|record| record.input.clay == Some(wanted));
    assert_eq!(
        first(FrameInUse { sequence: 0, is_last: false }),
        Some(0),
        "one frame is still to come"
    );
    assert_eq!(first(FrameInUse { sequence: 77, is_last: true }), Some(UPDATE_TICKS as usize));
    assert!(records[390].output.contact_world.force.z > 2.0, "{:?}", records[390].output);
}

#[test]
fn in_real_time_the_newest_frame_wins_and_all_others_come_back() {
    let (mut servo, mut feed, mut consumer) = sculpting(RealClock, 40);
    for sequence in 1..=3 {
        let mut next = feed.spare().expect("a spare");
        next.sequence = sequence;
        feed.publish(next).expect("room");
    }
    assert!(feed.spare().is_none());
    servo.step();
    // Two that were never touched, and the one that the tick held before its first.
    let back: Vec<u64> = std::iter::from_fn(|| feed.spare()).map(|frame| frame.sequence).collect();
    assert_eq!(back, [1, 2, 0]);
    while servo.step() == Step::Continue {}
    let records = records(&mut consumer);
    assert!(
        records
            .iter()
            .all(|record| record.input.clay == Some(FrameInUse { sequence: 3, is_last: false }))
    );
    let states: Vec<_> = std::iter::from_fn(|| feed.next_state()).take(1000).collect();
    assert_eq!(states.len(), records.len());
    for (state, record) in states.iter().zip(&records) {
        assert_eq!(
            (state.tick, state.sequence, state.buttons),
            (record.tick, 3, record.input.sample.buttons)
        );
        assert_eq!(state.map_from_tool, record.output.world_from_tool);
        assert!((state.force_map - record.output.contact_world.force).length() < 1e-12);
        assert_eq!(state.has_force, record.output.drive.has_force());
    }
}

/// Frames 1 to 8, which the simulation has made itself: it needs no spares.
fn publish_own(feed: &mut DensityFeed) {
    let frame = half_space();
    for sequence in 1..=8 {
        let own = DensityFrame { sequence, ..frame.clone() };
        feed.publish(Box::new(own)).expect("room");
    }
}

#[test]
fn in_real_time_a_frame_waits_for_a_place_for_what_it_sends_back() {
    let (mut servo, mut feed, mut consumer) = sculpting(RealClock, 40);
    publish_own(&mut feed);
    servo.step();
    servo.step();
    // Next to the spares of the beginning there was room for five.
    let back = |feed: &mut DensityFeed| -> Vec<u64> {
        std::iter::from_fn(|| feed.spare()).map(|frame| frame.sequence).collect()
    };
    assert_eq!(back(&mut feed), [0, 0, 0, 1, 2, 3, 4, 0]);
    servo.step();
    assert_eq!(back(&mut feed), [6, 7, 0]);
    let touched: Vec<_> = records(&mut consumer)
        .iter()
        .filter_map(|record| record.input.clay)
        .map(|frame| frame.sequence)
        .collect();
    assert_eq!(touched, [5, 5, 8]);
}

#[test]
fn simulated_time_waits_for_a_place_for_what_comes_back_while_there_is_a_simulation() {
    for is_gone in [false, true] {
        let (mut servo, mut feed, mut consumer) = sculpting(VirtualClock::default(), 60);
        publish_own(&mut feed);
        let simulation = std::thread::spawn(move || {
            if is_gone {
                return;
            }
            // Five frames fill the ring; the tick after this one is owed the sixth.
            let last = 6 * UPDATE_TICKS - 1;
            while feed.next_state().is_none_or(|state| state.tick < last) {
                std::thread::yield_now();
            }
            std::thread::sleep(Duration::from_millis(20));
            assert_eq!(feed.next_state(), None, "it waits");
            while feed.spare().is_some() {}
        });
        while servo.step() == Step::Continue {}
        simulation.join().expect("no panic");
        let most = if is_gone { 5 } else { 8 };
        let records = records(&mut consumer);
        assert!(records.last().is_some_and(|record| {
            record.input.clay.is_some_and(|frame| frame.is_last) && record.tick > 8 * UPDATE_TICKS
        }));
        for record in records {
            assert_eq!(
                record.input.clay.map(|frame| frame.sequence),
                Some((record.tick / UPDATE_TICKS).min(most)),
                "tick {}",
                record.tick
            );
        }
    }
}

#[test]
fn a_feed_knows_the_base_of_its_last_frame_and_no_other() {
    let first = half_space();
    let (mut feed, _slot) = DensitySlot::new(&first, &Pose::IDENTITY, UPDATE_TICKS);
    let before = Arc::strong_count(&first.base);
    let second = half_space();
    let base = second.base.clone();
    feed.publish(Box::new(second)).expect("room");
    assert_eq!(Arc::strong_count(&base), 3, "here, in the frame, and known to the feed");
    assert_eq!(Arc::strong_count(&first.base), before - 1);
}

#[test]
fn a_leap_in_a_frame_that_came_with_the_next_one_is_still_felt_slowly() {
    let grown_n = |leaps: [bool; 2]| {
        let (mut servo, mut feed, mut consumer) = sculpting(RealClock, 400);
        (0..200).for_each(|_| _ = servo.step());
        for (sequence, is_leap) in (1..).zip(leaps) {
            let mut next = feed.spare().expect("a spare");
            set_top(&mut next, 2e-3);
            (next.sequence, next.is_leap) = (sequence, is_leap);
            feed.publish(next).expect("room");
        }
        (0..20).for_each(|_| _ = servo.step());
        let forces_n: Vec<f64> = records(&mut consumer)
            .iter()
            .map(|record| record.output.contact_world.force.z)
            .collect();
        forces_n[219] - forces_n[199]
    };
    let [at_once, slow] = [[false, false], [true, false]].map(grown_n);
    assert!(at_once > 1.5 && slow < 0.7, "{at_once} N, {slow} N");
}

/// What an update changes of the force, ΔF, is felt as ΔF (1 − αⁿ) after n ticks.
#[test]
fn an_update_is_felt_at_the_pace_that_the_scene_asks_for() {
    for alpha in [0.0_f64, 0.5, 0.9] {
        let (mut servo, mut feed, mut consumer) = smoothed(RealClock, 500, alpha);
        (0..400).for_each(|_| _ = servo.step());
        // The surface rises by 0.2 mm: 0.2 N more at 1 N/mm.
        let mut next = feed.spare().expect("a spare");
        for value_m in next.region.values_m_mut() {
            *value_m += 2e-4;
        }
        next.sequence = 1;
        feed.publish(next).expect("room");
        (0..40).for_each(|_| _ = servo.step());
        let forces_n: Vec<f64> = records(&mut consumer)
            .iter()
            .map(|record| record.output.contact_world.force.z)
            .collect();
        for n in 1..=40 {
            let expected_n = forces_n[399] + 0.2 * (1.0 - alpha.powi(n));
            let felt_n = forces_n[399 + n as usize];
            assert!(
                (felt_n - expected_n).abs() < 1e-5,
                "α = {alpha}, tick {n}: {felt_n} N, expected {expected_n} N"
            );
        }
    }
}

#[test]
fn states_that_are_not_taken_are_dropped_and_counted() {
    let (mut servo, mut feed, _records) = sculpting(RealClock, 1200);
    for _ in 0..1100 {
        servo.step();
    }
    let kept: Vec<_> = std::iter::from_fn(|| feed.next_state()).take(1100).collect();
    assert!(kept.len() < 1100 && kept.iter().all(|state| state.dropped == 0));
    servo.step();
    let next = feed.next_state().expect("room again");
    assert_eq!((next.tick, next.dropped), (1100, 1100 - kept.len() as u64));
}
