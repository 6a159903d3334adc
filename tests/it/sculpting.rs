//! A hand that works clay through the whole loop, and an engine that breaks under it.

use std::sync::{Arc, mpsc};

use arms::{Capabilities, Device, DeviceError};
use clay::boolean::Boolean;
use clay::clay_model::{ClayModel, Settings};
use clay::engine::{SculptEngine, SculptOrder, SculptTool, ToolBody, ToolSettings};
use clay::falloff::Falloff;
use clay::material_map::{MaterialPlace, Painted};
use clay::{PointSet, SolidSource, sample};
use engine::servo::{Control, RunPlan, ServoLoop, Step};
use glam::{DMat3, DVec3};
use hapticd::daemon::sculpting::{OrderError, SculptOutcome, SculptPlan, begin};
use haptics::clay::{Clay, Rope};
use haptics::{CouplingMode, Faults, Inertia, LimitParameters, RenderScene, Tool};
use recording::TickRecord;
use rt::clock::{Clock, RealClock, VirtualClock};
use vps::mesh::primitives::Shape;
use vps::pointshell::shell::Shell;
use vps::spatial::{DeviceSample, Pose, SampleStatus, Wrench};

use super::rig;

const R: f64 = 0.02;
const UPDATE_TICKS: u64 = 4;
const FORCE_N: f64 = 6.0;
/// The force limit within 10 ms, which is how fast a force may fall.
const SLEW_N_PER_S: f64 = FORCE_N / LimitParameters::FALL_S;

fn ball() -> PointSet {
    sample(&Shape::Sphere { radius_m: R }.tessellate(2e-5), 1.2e-3).expect("a spacing that fits")
}

fn engine(kind: SculptTool) -> SculptEngine {
    let settings = Settings {
        region_map: Some((DVec3::new(-0.012, -0.012, 0.008), DVec3::new(0.012, 0.012, 0.032))),
        raster: [21; 3],
        ..Settings::default()
    };
    let model = ClayModel::new(ball(), settings).expect("a clay model");
    SculptEngine::new(
        model,
        ToolSettings { kind, brush_m: 5e-3, ..ToolSettings::default() },
        ToolBody::default(),
    )
}

fn scene(engine: &SculptEngine) -> RenderScene {
    let mut parameters = rig::unlimited();
    parameters.coupling.mode = CouplingMode::Direct;
    parameters.limits.slew_n_per_s = SLEW_N_PER_S;
    parameters.limits.force_n = FORCE_N;
    parameters.mapping.start = Pose::from_translation(DVec3::Z * (R + 6e-3));
    let clay = Clay {
        world_from_map: Pose::IDENTITY,
        frame: engine.model().frame().expect("a sound frame"),
        smoothing: Clay::smoothing_between(UPDATE_TICKS as f64 * 1e-3, 1e-3),
        rope: Rope { stiffness_n_per_m: 800.0, force_n: 4.0 },
    };
    let inertia = Inertia { mass_kg: 0.05, body_kg_m2: DMat3::IDENTITY * 1e-6, least_kg_m2: 1e-6 };
    let tool = Tool {
        shell: Shell::new(&[(DVec3::ZERO, DVec3::Z)], 1e-3),
        inertia,
        center_of_mass_tool: DVec3::ZERO,
    };
    RenderScene { parameters, obstacles: Vec::new(), clay: Some(clay), tool }
}

/// An arm that is led: down into the clay, up, down to the surface, and with the button held up
/// again.
#[derive(Debug, Default)]
struct Led {
    sequence: u64,
}

impl Device for Led {
    fn capabilities(&self) -> Capabilities {
        Capabilities::default()
    }

    fn read(&mut self) -> Result<DeviceSample, DeviceError> {
        self.sequence += 1;
        let path: [(f64, f64); 8] = [
            (0.0, 0.0),
            (0.2, 0.0),
            (0.6, -8e-3),
            (0.9, -8e-3),
            (1.1, 0.0),
            (1.4, -5e-3),
            (1.6, -5e-3),
            (2.2, 0.0),
        ];
        let time_s = self.sequence as f64 * 1e-3;
        let leg = path.windows(2).find(|leg| time_s <= leg[1].0).map_or((1.0, 0.0, 0.0), |leg| {
            ((time_s - leg[0].0) / (leg[1].0 - leg[0].0), leg[0].1, leg[1].1)
        });
        let pose = Pose::from_translation(DVec3::Z * (leg.1 + (leg.2 - leg.1) * leg.0));
        let buttons = u32::from((1.5..2.3).contains(&time_s));
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

fn pull() -> SculptOrder {
    SculptOrder::Take(ToolSettings {
        kind: SculptTool::Pull,
        brush_m: 5e-3,
        ..ToolSettings::default()
    })
}

fn run(
    clock: impl Clock,
    n_ticks: u64,
    script: Vec<(u64, SculptOrder)>,
) -> (Vec<TickRecord>, SculptOutcome) {
    let engine = engine(SculptTool::Push);
    let scene = scene(&engine);
    let plan = SculptPlan {
        tick_s: 1e-3,
        update_ticks: UPDATE_TICKS,
        clock: clock.kind(),
        script: script.into_iter().map(Into::into).collect(),
    };
    let control = Arc::new(Control::enabled());
    let (slot, handle, thread) =
        begin(engine, scene.clay.as_ref().expect("clay"), plan, control.clone()).expect("a thread");
    assert!(handle.view().is_none_or(|view| view.version == 1));
    let (producer, mut consumer) = rtrb::RingBuffer::new(n_ticks as usize + 400);
    let plan = RunPlan { stop_at_tick: Some(n_ticks), ..RunPlan::default() };
    let mut servo = ServoLoop::new(Arc::new(scene), Led::default(), clock, control, plan, producer)
        .with_density(slot);
    servo.warm_up();
    while servo.step() == Step::Continue {}
    drop(servo);
    let ended = thread.join().expect("joined");
    let (reported, hears) = mpsc::channel();
    handle.ask(SculptOrder::Undo, Box::new(move |result| reported.send(result).expect("heard")));
    assert!(matches!(hears.recv(), Ok(Err(OrderError::Over))), "asked behind the end");
    let last = handle.view().expect("a view");
    assert_eq!(
        ended.report.broken.is_some(),
        last.trouble.contains("sculpting has ended"),
        "{}",
        last.trouble
    );
    (std::iter::from_fn(|| consumer.pop().ok()).collect(), ended)
}

/// The largest step of the force from one tick to the next, N.
fn largest_step_n(records: &[TickRecord]) -> f64 {
    let step = |pair: &[TickRecord]| {
        (pair[1].output.command_device.force - pair[0].output.command_device.force).length()
    };
    records.windows(2).map(step).fold(0.0, f64::max)
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn a_hand_pushes_and_pulls_clay_through_the_loop_the_same_way_twice() {
    let script = || {
        vec![
            (1200, pull()),
            (2500, SculptOrder::SavePoints("/no/such/folder/points.ply".into())),
            (9999, SculptOrder::Undo),
        ]
    };
    let ((first, ended), (second, again)) = (
        run(VirtualClock::default(), 2600, script()),
        run(VirtualClock::default(), 2600, script()),
    );
    assert!(first.len() >= 2600);
    assert_eq!(first.len(), second.len());
    for (one, other) in first.iter().zip(&second) {
        assert_eq!((one.input, one.output), (other.input, other.output), "tick {}", one.tick);
        let expected = one.tick / UPDATE_TICKS;
        assert_eq!(
            one.input.clay.map(|clay| (clay.sequence, clay.is_last)),
            Some((expected, false)),
            "tick {}",
            one.tick
        );
    }
    assert_eq!(ended.report, again.report);
    assert_eq!(ended.engine.model().points(), again.engine.model().points());
    assert_eq!(ended.engine.model().base().values_m(), again.engine.model().base().values_m());

    let report = &ended.report;
    assert_eq!(
        (report.updates, report.late, report.left_over, &report.broken),
        (first.len() as u64 / UPDATE_TICKS, 0, 1, &None)
    );
    assert_eq!((report.strokes, ended.engine.model().history()), (2, (2, 0)), "{report:?}");
    let [failed] = &*report.failed else { panic!("{report:?}") };
    assert_eq!((failed.tick, failed.is_scripted, &*failed.what), (2500, true, "save-points"));
    assert!(
        failed.why.contains("/no/such/folder/points.ply")
            && failed.why.contains("folder that exists"),
        "{}",
        failed.why
    );

    assert!(first.iter().all(|record| record.output.faults == Faults::NONE));
    let pushed_n = first[600].output.command_device.force.z;
    let pulled_n = first[2100].output.command_device.force.z;
    assert!(pushed_n > 0.2 && pulled_n < -0.2, "{pushed_n} N, {pulled_n} N");
    assert!(
        largest_step_n(&first) <= SLEW_N_PER_S * 1e-3 * (1.0 + 1e-9),
        "{} N",
        largest_step_n(&first)
    );
}

#[test]
fn painting_material_is_felt_no_more_than_touching_is() {
    let take = |kind| {
        vec![(
            0,
            SculptOrder::Take(ToolSettings { kind, brush_m: 5e-3, ..ToolSettings::default() }),
        )]
    };
    let (touched, _) = run(VirtualClock::default(), 1100, take(SculptTool::Touch));
    let (painted, ended) = run(VirtualClock::default(), 1100, take(SculptTool::Material));
    for (one, other) in touched.iter().zip(&painted) {
        assert_eq!(one.output, other.output, "tick {}", one.tick);
    }
    assert!(touched[700].output.command_device.force.z > 0.2);
    let model = ended.engine.model();
    assert_eq!(model.history(), (1, 0));
    let top = model.material_at(DVec3::Z * R);
    let far = model.material_at(-DVec3::Z * R);
    assert!(top.stiffness_n_per_m > 5.0 * far.stiffness_n_per_m, "{top:?} {far:?}");
    assert_eq!(far, model.settings().material);
}

#[test]
fn in_real_time_the_loop_goes_on_and_updates_that_are_late_are_counted() {
    let (records, ended) = run(RealClock, 700, Vec::new());
    let report = &ended.report;
    assert!(report.broken.is_none() && report.updates > 0, "{report:?}");
    assert!(records.iter().all(|record| !record.input.clay.is_some_and(|clay| clay.is_last)));
    assert_eq!(report.samples_before, ball().len());
}

#[test]
fn a_studio_ends_when_it_is_ordered_to_though_the_loop_keeps_its_slot() {
    for clock in [VirtualClock::default().kind(), RealClock.kind()] {
        let engine = engine(SculptTool::Push);
        let scene = scene(&engine);
        let plan =
            SculptPlan { tick_s: 1e-3, update_ticks: UPDATE_TICKS, clock, script: Vec::new() };
        let control = Arc::new(Control::enabled());
        let (slot, _handle, thread) =
            begin(engine, scene.clay.as_ref().expect("clay"), plan, control).expect("a thread");
        assert!(!thread.has_ended());
        thread.end();
        assert!(thread.join().expect("joined").report.broken.is_none());
        drop(slot);
    }
}

#[test]
fn an_end_cancels_a_boolean_and_the_session_is_whole() {
    for is_by_order in [true, false] {
        let engine = engine(SculptTool::Push);
        let scene = scene(&engine);
        let plan = SculptPlan {
            tick_s: 1e-3,
            update_ticks: UPDATE_TICKS,
            clock: RealClock.kind(),
            script: Vec::new(),
        };
        let control = Arc::new(Control::enabled());
        let (slot, handle, thread) =
            begin(engine, scene.clay.as_ref().expect("clay"), plan, control.clone())
                .expect("a thread");
        let (reported, hears) = mpsc::channel();
        let ask = |order| {
            let reported = reported.clone();
            let answer = move |result: Result<(), OrderError>| {
                reported.send(result).expect("the test listens");
            };
            handle.ask(order, Box::new(answer));
        };
        let painted = Painted { mass_kg: Some(3e-4), ..Painted::default() };
        ask(SculptOrder::Lay { painted, place: MaterialPlace::Everywhere });
        // Work of ten seconds and more; the order before it is answered when its turn comes.
        let ball = Shape::Sphere { radius_m: 0.08 };
        ask(SculptOrder::Combine {
            boolean: Boolean::Union,
            with: Arc::new(SolidSource::Shape(ball, DVec3::ONE)),
            map_from_body: Pose::IDENTITY,
            is_sharp: true,
        });
        assert!(matches!(hears.recv(), Ok(Ok(()))));
        if is_by_order {
            control.stop();
        } else {
            thread.end();
        }
        let Ok(Err(error)) = hears.recv() else { panic!("it was carried out") };
        assert!(error.to_string().contains("the work was cancelled"), "{error}");
        thread.end();
        let SculptOutcome { report, mut engine } = thread.join().expect("joined");
        assert!(report.broken.is_none() && report.strokes == 1, "{report:?}");
        drop(slot);
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("clay.session");
        engine.order(SculptOrder::SaveSession(path.clone())).expect("saved");
        let model = ClayModel::load_session(&path).expect("a whole session");
        assert_eq!((model.points().len(), model.history()), (self::ball().len(), (1, 0)));
        assert_eq!(model.settings().material.mass_kg, 3e-4);
    }
}

#[test]
fn a_studio_that_breaks_lets_go_of_the_hand_and_leaves_the_loop_and_the_clay() {
    // A table that no constructor gives: the engine panics when it is pulled with.
    let broken = || {
        let tool = ToolSettings {
            kind: SculptTool::Pull,
            brush_m: 5e-3,
            falloff: Falloff::Table(Vec::new()),
            ..ToolSettings::default()
        };
        vec![(0, SculptOrder::Take(tool))]
    };
    let sound = || vec![(0, pull())];
    let ((records, ended), (held, _)) =
        (run(VirtualClock::default(), 2200, broken()), run(VirtualClock::default(), 2200, sound()));
    assert!(ended.report.broken.is_some(), "{:?}", ended.report);
    assert!(
        records.len() >= 2200 && records.iter().all(|record| record.output.faults == Faults::NONE)
    );
    let gone = records
        .iter()
        .position(|record| record.input.clay.is_some_and(|clay| clay.is_last))
        .expect("noticed");
    assert!((1500..1700).contains(&gone), "{gone}");
    // With a sound one the rope pulls all the way up; here the hand is free within what the slew
    // limit takes.
    assert!(held[2100].output.command_device.force.z < -0.2);
    assert!(records[gone + 50..].iter().all(|record| record.output.command_device.force.z >= 0.0));
    assert!(
        largest_step_n(&records) <= SLEW_N_PER_S * 1e-3 * (1.0 + 1e-9),
        "{} N",
        largest_step_n(&records)
    );
    // What had been done until then can be saved.
    let mut engine = ended.engine;
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("rescued.ply");
    engine.order(SculptOrder::SavePoints(path.clone())).expect("saved");
    assert_eq!(
        clay::load(&path, 1.0, None).map(|loaded| loaded.points.len()).ok(),
        Some(ball().len())
    );
}
