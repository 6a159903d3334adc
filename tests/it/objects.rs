//! Many objects, objects that move, and scenes that take each other's place while the loop runs.

use std::sync::Arc;

use engine::servo::{Control, Ending, LoadedScene, RunPlan, SceneControls, ServoLoop, Step};
use glam::{DMat3, DQuat, DVec3};
use hapticd::daemon::prepare;
use haptics::{
    CouplingMode, Drive, DriveRequest, Faults, FrictionParameters, Inertia, LimitParameters,
    Parameters, Placement, RenderScene, State, TickInput, TickOutput, Tool, tick,
};
use recording::TickRecord;
use rt::clock::VirtualClock;
use vps::contact::{ContactSum, ForceLaw, Obstacle, SimdLevel, Traversal, TraversalMode};
use vps::mesh::primitives::Shape;
use vps::pointshell::{self, shell::Shell};
use vps::spatial::testing::Random;
use vps::spatial::{DeviceSample, Pose, SampleStatus, Wrench};
use vps::voxmap::field::FieldKind;

use super::rig;

const T: f64 = 1e-3;
/// s, m.
const S: f64 = 1e-3;
const BALL_M: f64 = 6e-3;
const MODES: [CouplingMode; 3] =
    [CouplingMode::Implicit, CouplingMode::Constraint, CouplingMode::Direct];

fn obstacle(shape: Shape, world_from_map: Pose) -> Obstacle {
    let mesh = shape.tessellate(1e-5);
    Obstacle { field: rig::volume(&mesh, S, 8).field(&mesh, false), world_from_map }
}

fn ball() -> Shell {
    let mesh = Shape::Sphere { radius_m: BALL_M }.tessellate(1e-5);
    pointshell::build(&mesh, &rig::volume(&mesh, S, 8), DVec3::ZERO).0
}

/// Three voxels thick, and so wide that no way leads around it.
fn plate(world_from_map: Pose) -> Obstacle {
    obstacle(Shape::Box { size_m: DVec3::new(0.12, 0.12, 3.0 * S) }, world_from_map)
}

fn parameters(mode: CouplingMode) -> Parameters {
    let mut p = rig::unlimited();
    p.coupling.mode = mode;
    p.limits = LimitParameters {
        force_n: 10.0,
        torque_nm: 0.2,
        speed_m_per_s: 1.0,
        slew_n_per_s: 1000.0,
        slew_nm_per_s: 20.0,
        power_w: 5.0,
        ramp_s: 0.01,
        ..p.limits
    };
    p.mapping.start = Pose::from_translation(DVec3::Z * 0.03);
    p
}

fn scene(mode: CouplingMode, obstacles: Vec<Obstacle>, shell: Shell) -> RenderScene {
    let least_kg_m2 = 1e-6;
    let inertia = Inertia { mass_kg: 0.05, body_kg_m2: DMat3::IDENTITY * least_kg_m2, least_kg_m2 };
    let tool = Tool { shell, inertia, center_of_mass_tool: DVec3::ZERO };
    RenderScene { parameters: parameters(mode), obstacles, clay: None, tool }
}

/// A hand that holds still, or that goes along a given path, and a loop that asks obstacles to
/// move.
struct Play<'a> {
    scene: &'a RenderScene,
    state: State,
    hand: Pose,
    sequence: u64,
    last: TickOutput,
}

impl<'a> Play<'a> {
    /// Enabled, and the ramp is over.
    fn new(scene: &'a RenderScene) -> Self {
        let start = TickOutput::default();
        let mut play = Self {
            scene,
            state: State::new(scene),
            hand: Pose::IDENTITY,
            sequence: 0,
            last: start,
        };
        for _ in 0..20 {
            play.tick(None);
        }
        assert_eq!(play.last.drive, Drive::Enabled);
        play
    }

    fn tick(&mut self, place: Option<Placement>) -> TickOutput {
        self.sequence += 1;
        let sample = DeviceSample {
            pose: self.hand,
            sequence: self.sequence,
            status: SampleStatus::Fresh,
            ..DeviceSample::default()
        };
        let before = self.last.command_device;
        self.last = tick(
            self.scene,
            &mut self.state,
            &TickInput { sample, request: DriveRequest::Enable, place, ..TickInput::default() },
        );
        // What holds in every tick whatever moves: no fault, force within its limits, and never a
        // jump.
        let now = self.last.command_device;
        let limits = &self.scene.parameters.limits;
        assert_eq!(self.last.faults, Faults::NONE, "tick {}", self.sequence);
        assert!(
            now.is_finite() && now.force.length() <= limits.force_n * (1.0 + 1e-12),
            "tick {}",
            self.sequence
        );
        let jump_n = (now.force - before.force).length();
        assert!(
            jump_n <= limits.slew_n_per_s * T * (1.0 + 1e-9),
            "tick {}: a jump of {jump_n} N",
            self.sequence
        );
        self.last
    }

    fn place(&self, obstacle_idx: usize) -> Pose {
        self.state.world_from_map(obstacle_idx).expect("an obstacle")
    }
}

fn wish(obstacle_idx: u32, world_from_map: Pose) -> Option<Placement> {
    Some(Placement { obstacle_idx, world_from_map })
}

/// But for the rounding of a quaternion's length.
fn same(one: Pose, other: Pose) -> bool {
    one.translation == other.translation && one.rotation_to(other).length() < 1e-12
}

fn bits(sum: &ContactSum) -> Vec<u64> {
    let mut numbers = Vec::new();
    numbers.extend(sum.wrench.force.to_array());
    numbers.extend(sum.wrench.torque.to_array());
    numbers.extend(sum.stiffness.0.as_flattened());
    numbers.extend(sum.arm_world.to_array());
    numbers.extend([sum.voxel_size_m, f64::from(sum.contacts)]);
    numbers.into_iter().map(f64::to_bits).collect()
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn passing_over_what_is_far_away_changes_no_bit() {
    let mut random = Random(40);
    let mut vector = || DVec3::new(random.signed(), random.signed(), random.signed());
    let shapes = [
        Shape::Box { size_m: DVec3::new(0.02, 0.012, 0.008) },
        Shape::Sphere { radius_m: 7e-3 },
        Shape::Torus { major_m: 0.012, minor_m: 3e-3 },
        Shape::Cylinder { radius_m: 4e-3, height_m: 0.03 },
    ];
    let obstacles: Vec<Obstacle> = (0..40)
        .map(|n| {
            obstacle(
                shapes[n % 4],
                Pose::new(DQuat::from_scaled_axis(vector() * 3.0), vector() * 0.05),
            )
        })
        .collect();
    let shell = ball();
    let law = parameters(CouplingMode::Implicit).force_law();
    let mut n_near = 0;
    let mut n_touching = 0;
    let mut n_free = 0;
    for kind in [FieldKind::Trilinear, FieldKind::Layers, FieldKind::Octant] {
        let law = ForceLaw { field: kind, ..law };
        for mode in [TraversalMode::Tree, TraversalMode::Flat] {
            let make = |on| {
                Traversal::new(SimdLevel::best(), mode, &obstacles, &shell).with_broad_phase(on)
            };
            let mut with = make(true);
            let mut without = make(false);
            let mut pose = Pose::from_translation(DVec3::ZERO);
            for n in 0..1500 {
                // A wander at all speeds, with leaps, some of them absurd.
                let size_m = 10_f64.powf(-2.5 + 1.5 * vector().x);
                pose = pose.stepped(vector() * size_m - pose.translation * 0.02, vector() * 0.3);
                match n % 100 {
                    50 => pose.translation = vector() * 0.12,
                    70 => pose.translation = DVec3::X * 1e6,
                    71 => pose.translation = DVec3::splat(f64::NAN),
                    72 => pose = Pose::from_translation(vector() * 0.1),
                    _ => {}
                }
                let ask = |traversal: &mut Traversal| {
                    ContactSum::of(traversal, &obstacles, &shell, pose, law, None)
                };
                let sums = [
                    ask(&mut with),
                    ask(&mut without),
                    ContactSum::flat(&obstacles, &shell, pose, law),
                ];
                let [culled, whole, flat] = &sums;
                assert_eq!(bits(culled), bits(flat), "{kind:?}, {mode:?}, pose {n}");
                assert_eq!(bits(whole), bits(flat), "{kind:?}, {mode:?}, pose {n}");
                // The specification looks at every point: no clearance, and no step, is longer than
                // what it gives.
                assert!(
                    !pose.is_finite()
                        || (culled.max_value_m >= flat.max_value_m
                            && culled.step_limit_m <= flat.step_limit_m),
                    "{kind:?}, pose {n}"
                );
                n_near += with.n_near();
                n_touching += usize::from(flat.contacts > 0);
                n_free += usize::from(flat.contacts == 0);
            }
        }
    }
    assert!(n_touching > 500 && n_free > 500, "{n_touching} touch, {n_free} do not");
    assert!(n_near < 9000 * 40 / 8, "{n_near} of {} were asked", 9000 * 40);
}

#[test]
fn an_object_goes_where_it_is_asked_to_and_no_point_of_it_faster_than_it_may() {
    let scene = scene(CouplingMode::Implicit, vec![plate(Pose::IDENTITY)], ball());
    let corners: Vec<DVec3> = (0..8)
        .map(|n| DVec3::new(f64::from(n & 1) - 0.5, f64::from(n >> 1 & 1) - 0.5, 0.0) * 0.12)
        .collect();
    let mut play = Play::new(&scene);
    let mut random = Random(3);
    for _ in 0..6 {
        let mut vector = || DVec3::new(random.signed(), random.signed(), random.signed());
        // Far below, where the tool is not.
        let target =
            Pose::new(DQuat::from_scaled_axis(vector()), DVec3::NEG_Z * 0.2 + vector() * 0.05);
        let mut place = wish(0, target);
        let mut n_ticks = 0;
        while !same(play.place(0), target) {
            let before = play.place(0);
            play.tick(place.take());
            let farthest_m = corners
                .iter()
                .map(|corner| {
                    (play.place(0).transform_point(*corner) - before.transform_point(*corner))
                        .length()
                })
                .fold(0.0, f64::max);
            assert!(
                farthest_m <= scene.parameters.limits.speed_m_per_s * T * 1.001,
                "{farthest_m} m in one tick"
            );
            n_ticks += 1;
            assert!(n_ticks < 3000, "it does not arrive");
        }
        play.tick(None);
        play.tick(None);
        assert!(same(play.place(0), target) && play.last.objects_moving == 0);
    }
}

#[test]
fn a_pose_that_is_none_moves_nothing() {
    let scene = scene(CouplingMode::Implicit, vec![plate(Pose::IDENTITY)], ball());
    let mut play = Play::new(&scene);
    let at = |x: f64| Pose::from_translation(DVec3::splat(x));
    for (obstacle_idx, pose) in [
        (0, at(f64::NAN)),
        (0, at(f64::INFINITY)),
        (0, at(1e9)),
        (0, Pose::new(DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0), DVec3::ZERO)),
        (0, Pose::new(DQuat::from_xyzw(0.0, 0.0, 0.0, 2.0), DVec3::ZERO)),
        (0, Pose::new(DQuat::from_xyzw(0.0, f64::NAN, 0.0, 1.0), DVec3::ZERO)),
        (1, at(0.01)),
        (u32::MAX, at(0.01)),
    ] {
        for _ in 0..5 {
            let output = play.tick(wish(obstacle_idx, pose));
            assert_eq!((output.objects_moving, play.place(0)), (0, Pose::IDENTITY), "{pose:?}");
        }
    }
}

/// Acceptance 14 with the roles exchanged: the hand holds still, or comes the other way, and the
/// plate is set across it.
#[test]
fn no_object_goes_through_the_tool_wherever_it_is_asked_to_go() {
    let mut random = Random(14);
    let shell_points = ball().len();
    assert!(shell_points > 300);
    for mode in MODES {
        let mut scene = scene(mode, vec![plate(Pose::IDENTITY)], ball());
        // So hard that a quarter of a voxel outweighs what the hand can hold.
        scene.parameters.contact.stiffness_n_per_m = 2e4;
        for run in 0..8 {
            let mut play = Play::new(&scene);
            let mut signed = || random.signed();
            // From below to far above, aslant and turning.
            let turn = DQuat::from_scaled_axis(DVec3::new(signed(), signed(), signed()) * 0.3);
            let target = Pose::new(turn, DVec3::new(0.01 * signed(), 0.01 * signed(), 0.08));
            let hand_m_per_s = 0.3 * signed().abs();
            let mut touched = false;
            let mut deepest_m: f64 = 0.0;
            for n in 0..1500 {
                // Without a virtual tool the shell goes where the hand goes, so there it holds
                // still.
                if run % 2 == 1 && n < 200 && mode != CouplingMode::Direct {
                    play.hand.translation.z -= hand_m_per_s * T;
                }
                let output = play.tick(wish(0, target).filter(|_| n == 0));
                touched |= output.contacts > 0;
                deepest_m = deepest_m.max(output.max_depth_m);
            }
            let what = format!("{mode:?}, run {run}");
            assert!(touched, "{what}: not noticed");
            // The side of the plate that the middle of the ball is on.
            let height_m =
                play.place(0).inverse().transform_point(play.last.world_from_tool.translation).z;
            assert!(
                height_m > 0.0,
                "{what}: the ball is {height_m} m from the plate's middle, deepest {deepest_m} m"
            );
            if mode == CouplingMode::Direct {
                assert!(
                    play.last.objects_moving == 1,
                    "{what}: an arm that does not give way makes it wait"
                );
            } else {
                assert!(same(play.place(0), target), "{what}: the tool gives way");
            }
            // Half a voxel at which it waits, a quarter that it may go meanwhile, half a voxel of
            // the tool's own.
            assert!(deepest_m <= 1.25 * S, "{what}: {deepest_m} m deep");
        }
    }
}

#[test]
fn a_tool_that_is_jammed_makes_an_object_wait_and_letting_go_makes_it_come_back() {
    for mode in [CouplingMode::Implicit, CouplingMode::Constraint] {
        // The ball is 12 mm thick, and between roof and plate are 20 mm.
        let roof = plate(Pose::from_translation(DVec3::Z * (0.03 + 10e-3 + 1.5 * S)));
        let scene = scene(
            mode,
            vec![roof, plate(Pose::from_translation(DVec3::Z * (0.02 - 1.5 * S)))],
            ball(),
        );
        let mut play = Play::new(&scene);
        let mut deepest_m: f64 = 0.0;
        for n in 0..2000 {
            deepest_m = deepest_m.max(
                play.tick(wish(1, Pose::from_translation(DVec3::Z * 0.1)).filter(|_| n == 0))
                    .max_depth_m,
            );
        }
        let stands_m = play.place(1).translation.z;
        let output = play.last;
        assert!(
            output.objects_moving == 1 && output.contacts > 0,
            "{mode:?}: it waits at {stands_m} m"
        );
        assert!(deepest_m < 1.25 * S, "{mode:?}: {deepest_m} m deep");
        // At rest: waiting does not tremble.
        let mut moved_m: f64 = 0.0;
        for _ in 0..200 {
            play.tick(None);
            moved_m = moved_m.max((play.place(1).translation.z - stands_m).abs());
        }
        assert!(moved_m < 0.05 * S, "{mode:?}: it moved by {moved_m} m while it waited");
        let home = Pose::from_translation(DVec3::ZERO);
        for n in 0..1000 {
            play.tick(wish(1, home).filter(|_| n == 0));
        }
        assert_eq!(
            (play.place(1), play.last.contacts, play.last.objects_moving),
            (home, 0, 0),
            "{mode:?}"
        );
        assert!(rig::is_bit_zero(play.last.command_device), "{mode:?}");
    }
}

#[test]
fn a_table_turns_and_slides_under_what_presses_deep_into_it() {
    let mut random = Random(0x7461_626c);
    for mode in MODES {
        for _ in 0..3 {
            // Its grid lies askew to the table, and the table to the world.
            let [up, askew] = [0, 1].map(|_| DQuat::from_scaled_axis(random.in_box(-2.0, 2.0)));
            let mut mesh = Shape::Box { size_m: DVec3::new(0.08, 0.08, 0.02) }.tessellate(1e-5);
            for vertex in &mut mesh.vertices {
                *vertex = askew * *vertex;
            }
            let field = rig::volume(&mesh, S, 8).field(&mesh, false);
            let stands = |turn: f64, aside_m: f64| {
                let turned = up * DQuat::from_rotation_z(turn) * askew.inverse();
                Pose::new(turned, up * DVec3::new(aside_m, 0.0, -0.01))
            };
            let table = Obstacle { field, world_from_map: stands(0.0, 0.0) };
            let mut scene = scene(mode, vec![table], ball());
            // So soft that it goes in deeper than where a table waits.
            scene.parameters.contact.stiffness_n_per_m = 20.0;
            scene.parameters.mapping.start = Pose::new(up, up * DVec3::Z * (BALL_M + S));
            let mut play = Play::new(&scene);
            for _ in 0..400 {
                play.hand.translation += up * DVec3::NEG_Z * (4e-3 / 400.0);
                play.tick(None);
            }
            // The third hardly sinks in.
            let is_deep = play.last.max_depth_m > 0.5 * S;
            assert!(is_deep || mode == CouplingMode::Constraint, "{mode:?}: {:?}", play.last);
            for (turn, aside_m) in [(1.0, 0.0), (1.0, 5e-3)] {
                let target = stands(turn, aside_m);
                for n in 0..1500 {
                    play.tick(wish(0, target).filter(|_| n == 0));
                }
                let place = play.place(0);
                assert!(
                    same(place, target),
                    "{mode:?}: it stands {} m and {} rad off",
                    place.translation.distance(target.translation),
                    place.rotation_to(target).length()
                );
            }
        }
    }
}

#[test]
fn what_lies_on_a_plate_goes_with_it_by_friction() {
    let friction = FrictionParameters { r#static: 0.5, dynamic: 0.4, stiffness_n_per_m: 2e4 };
    for (friction, goes) in [(friction, true), (FrictionParameters::NONE, false)] {
        let slab = obstacle(
            Shape::Box { size_m: DVec3::new(0.12, 0.12, 0.02) },
            Pose::from_translation(DVec3::Z * 0.013),
        );
        let block = Shape::Box { size_m: DVec3::new(0.01, 0.01, 0.01) }.tessellate(1e-5);
        let shell = pointshell::build(&block, &rig::volume(&block, S, 8), DVec3::ZERO).0;
        let mut scene = scene(CouplingMode::Implicit, vec![slab], shell);
        scene.parameters.contact.friction = friction;
        // A soft hand that presses: 3 mm at 400 N/m.
        scene.parameters.coupling.stiffness_n_per_m = 400.0;
        let mut play = Play::new(&scene);
        for _ in 0..300 {
            play.hand.translation.z -= 3e-3 / 300.0 + 2e-3 / 300.0;
            play.tick(None);
        }
        for _ in 0..200 {
            play.tick(None);
        }
        assert!(play.last.contacts > 0);
        let before = play.last.world_from_tool.translation;
        // 0.5 mm against a hand of 400 N/m: 0.2 N, well inside the cone of 1 N.
        let aside = Pose::from_translation(DVec3::new(5e-4, 0.0, 0.013));
        for n in 0..400 {
            play.tick(wish(0, aside).filter(|_| n == 0));
        }
        assert_eq!(play.place(0), aside);
        let gone_m = play.last.world_from_tool.translation.x - before.x;
        let expected_m = if goes { 5e-4 } else { 0.0 };
        assert!(
            (gone_m - expected_m).abs() < 1e-4,
            "friction {goes}: the block went by {gone_m} m"
        );
    }
}

#[test]
fn the_same_wishes_give_the_same_bits() {
    let scene = scene(CouplingMode::Implicit, vec![plate(Pose::IDENTITY)], ball());
    let run = || {
        let mut play = Play::new(&scene);
        (0..600_u32)
            .map(|n| {
                let z_m = 0.03 + 0.02 * (0.01 * f64::from(n)).sin();
                let output = play
                    .tick(wish(0, Pose::from_translation(DVec3::Z * z_m)).filter(|_| n % 7 == 0));
                (output, play.place(0))
            })
            .collect::<Vec<_>>()
    };
    assert_eq!(run(), run());
}

/// A block on a plate that may move, on a shipped arm; the hand holds the block half a millimetre
/// below the surface.
const LIFT: &str = r#"version = 1
[[static]]
name = "plate"
shape = { box_mm = [40.0, 40.0, 10.0] }
voxel_size_mm = 1.0
layers = 6
position_mm = [0, 0, -5]
movable = true
[tool]
shape = { box_mm = [10.0, 10.0, 10.0] }
voxel_size_mm = 1.0
mass_g = 100.0
start_position_mm = [0, 0, 6.0]
[contact]
stiffness_n_per_mm3 = 5.0
[device]
profile = "sim-sigma7"
"#;

fn stage(text: &str) -> (RenderScene, Box<dyn arms::Device>) {
    let (prepared, _) =
        prepare(&rig::written(text), |_| ()).unwrap_or_else(|error| panic!("{error}"));
    (prepared.scene, prepared.device)
}

/// Runs to the end, calling between the ticks; gives the records and how the run ended.
fn play_servo<D: arms::Device>(
    mut servo: ServoLoop<D, VirtualClock>,
    mut records: rtrb::Consumer<TickRecord>,
    mut between: impl FnMut(u64),
) -> (Vec<TickRecord>, Faults, Ending) {
    servo.warm_up();
    let mut all = Vec::new();
    loop {
        let step = servo.step();
        while let Ok(record) = records.pop() {
            all.push(record);
        }
        between(all.len() as u64);
        if step == Step::End {
            let report = servo.finish();
            assert_eq!((report.missed_deadlines, report.dropped_records), (0, 0));
            return (all, report.faults, report.ending);
        }
    }
}

type Loop = ServoLoop<Box<dyn arms::Device>, VirtualClock>;

fn servo(
    text: &str,
    n_ticks: u64,
) -> (Loop, rtrb::Consumer<TickRecord>, SceneControls, Arc<Control>) {
    let (scene, device) = stage(text);
    let (controls, commands) =
        SceneControls::new(&scene.parameters, vec![("plate".to_owned(), true)]);
    let (producer, records) = rtrb::RingBuffer::new(64);
    let control = Arc::new(Control::enabled());
    let plan = RunPlan { stop_at_tick: Some(n_ticks), ..RunPlan::default() };
    let servo = ServoLoop::new(
        Arc::new(scene),
        device,
        VirtualClock::default(),
        control.clone(),
        plan,
        producer,
    );
    (servo.with_commands(commands), records, controls, control)
}

#[test]
fn a_plate_lifts_the_hand_and_its_work_is_no_debt_of_the_arm() {
    let (servo, records, mut controls, _) = servo(LIFT, 4000);
    // Up by 15 mm and down again, ten times: a hand that holds with 500 N/m is pushed by some
    // newtons.
    let (all, faults, ending) = play_servo(servo, records, |n| {
        if n >= 300 && n % 4 == 0 {
            let z_m = 7.5e-3 * (1.0 - (0.012 * (n - 300) as f64).cos());
            controls.place("plate", Pose::from_translation(DVec3::Z * (z_m - 5e-3))).expect("room");
        }
    });
    assert_eq!((faults, ending), (Faults::NONE, Ending::Stopped));
    let highest_m =
        all.iter().map(|record| record.output.world_from_tool.translation.z).fold(0.0, f64::max);
    assert!(highest_m > 0.015, "the tool was lifted to {highest_m} m only");
    let pressed_n =
        all.iter().map(|record| record.output.command_device.force.length()).fold(0.0, f64::max);
    assert!(pressed_n > 2.0, "{pressed_n} N");
    let lowest_j = all.iter().map(|record| record.output.energy_j).fold(0.0, f64::min);
    let balance_j = all
        .iter()
        .map(|record| record.output.energy_j + record.output.object_work_j)
        .fold(0.0, f64::min);
    let damped = all.iter().filter(|record| record.output.passivity_active).count();
    eprintln!(
        "lift: {pressed_n:.2} N, lowest energy {lowest_j:.5} J, with the work of the plate \
            {balance_j:.5} J, damped {damped} ticks"
    );
    // Without the plate's work the port would count as active for good.
    assert!(lowest_j < -1e-3, "{lowest_j} J: the plate did no work");
    assert!(balance_j > -0.1 * lowest_j.abs(), "{balance_j} J are not the plate's");
    assert!(damped < all.len() / 20, "damped {damped} of {} ticks", all.len());
}

const OTHER: &str = "shape = { box_mm = [40.0, 40.0, 10.0] }";

/// A scene to go over to from a tick on.
fn loaded(text: &str, at_tick: u64) -> Box<LoadedScene> {
    Box::new(LoadedScene::new(Arc::new(stage(text).0)).at_tick(at_tick))
}

fn scenes_that_swap() -> [String; 2] {
    [LIFT.to_owned(), LIFT.replace(OTHER, "shape = { cylinder_mm = [20.0, 10.0] }")]
}

#[test]
fn scenes_take_each_others_place_at_zero_force_and_no_tick_is_missed() {
    let [first, second] = scenes_that_swap();
    let (servo, records, mut controls, _) = servo(&first, 3000);
    let mut n_back = 0;
    let (all, faults, ending) = play_servo(servo, records, |n| {
        if n == 800 || n == 1600 {
            let text = if n == 800 { &second } else { &first };
            assert!(controls.offer(loaded(text, 0), Vec::new()).is_ok());
        }
        n_back += usize::from(controls.take_replaced().is_some());
    });
    assert_eq!((faults, ending, n_back), (Faults::NONE, Ending::Stopped, 2));
    assert!(controls.is_over());
    let changes: Vec<usize> =
        (1..all.len()).filter(|n| all[*n].scene_idx != all[n - 1].scene_idx).collect();
    assert_eq!(changes.len(), 2);
    for change in changes {
        let last = &all[change - 1].output;
        let first = &all[change].output;
        assert_eq!((last.drive, last.command_device), (Drive::Disabled, Wrench::ZERO));
        assert_eq!((first.drive, first.command_device), (Drive::Disabled, Wrench::ZERO));
        // The tool stays where it stands: nothing is in its way.
        assert!(
            (last.world_from_tool.translation - first.world_from_tool.translation).length() < 1e-12
        );
        let states: Vec<Drive> =
            all[change - 150..change + 200].iter().map(|record| record.output.drive).collect();
        let mut seen = states.clone();
        seen.dedup();
        assert_eq!(
            seen,
            [Drive::Enabled, Drive::Stopping, Drive::Disabled, Drive::Enabling, Drive::Enabled]
        );
        assert!(
            all[change + 200]
                .output
                .world_from_tool
                .translation
                .distance(last.world_from_tool.translation)
                < 1e-3
        );
    }
    for pair in all.windows(2) {
        assert_eq!(pair[1].tick, pair[0].tick + 1);
        let jump_n =
            (pair[1].output.command_device.force - pair[0].output.command_device.force).length();
        assert!(jump_n < 2.5, "tick {}: a jump of {jump_n} N", pair[1].tick);
    }
}

#[test]
fn a_scene_without_room_for_the_tool_begins_at_its_own_start() {
    // A second scene whose plate is where the tool stands.
    let second = LIFT
        .replace("position_mm = [0, 0, -5]", "position_mm = [0, 0, 5]")
        .replace("[0, 0, 6.0]", "[0, 0, 20.0]");
    let (servo, records, mut controls, _) = servo(LIFT, 1500);
    assert!(controls.offer(loaded(&second, 700), Vec::new()).is_ok());
    let (all, faults, _) = play_servo(servo, records, |_| ());
    assert_eq!(faults, Faults::NONE);
    let change = all.iter().position(|record| record.scene_idx == 1).expect("swapped");
    assert!((700..900).contains(&change), "tick {change}");
    let height_m = all[change + 5].output.world_from_tool.translation.z;
    assert!((height_m - 0.02).abs() < 1e-3, "the tool stands at {height_m} m");
    assert!(all.iter().skip(change).all(|record| record.output.max_depth_m < 0.01));
}

#[test]
fn a_fault_or_a_stop_in_a_swap_is_zero_force_and_no_swap() {
    for (text, stop) in [
        (format!("{LIFT}[device.sim]\nfault = \"unplug@0.75s\"\n"), false),
        (LIFT.to_owned(), true),
    ] {
        let (servo, records, mut controls, control) = servo(&text, 3000);
        assert!(controls.offer(loaded(LIFT, 700), Vec::new()).is_ok());
        let (all, faults, ending) = play_servo(servo, records, |n| {
            if stop && n == 750 {
                control.stop();
            }
        });
        assert_eq!(ending, if stop { Ending::Stopped } else { Ending::Faulted });
        assert_eq!(faults, if stop { Faults::NONE } else { Faults::DEVICE_LOST });
        assert!(all.iter().all(|record| record.scene_idx == 0), "it went on to the other scene");
        assert!(rig::is_bit_zero(all.last().expect("records").output.command_device));
        assert!(controls.take_replaced().is_none() && controls.is_over());
    }
}
