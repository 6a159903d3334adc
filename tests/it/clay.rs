//! Clay inside the tick: forces in closed form, friction, and rope.

use std::sync::Arc;

use glam::{DMat3, DQuat, DVec3};
use hapticd::daemon::{ReplayError, replay};
use haptics::clay::{Clay, Rope};
use haptics::{
    CouplingMode, DriveRequest, Faults, FilterParameters, FrameInUse, FrictionParameters, Inertia,
    RenderScene, State, TickInput, TickOutput, Tool, tick,
};
use recording::file::Recorder;
use recording::{RecordSubscribers, TickRecord, drain};
use vps::contact::Obstacle;
use vps::density::{DensityFrame, Lattice, Raster};
use vps::pointshell::shell::Shell;
use vps::spatial::{DeviceSample, Pose, SampleStatus, Wrench};

use super::rig;

/// Distance of the nodes, m.
const H: f64 = 1e-3;
const STIFFNESS_N_PER_M: f64 = 1000.0;

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

/// The same density in the base and in a region of 10 mm around the origin.
fn frame(density_m: impl Fn(DVec3) -> f64) -> DensityFrame {
    let region = Lattice { origin_map: LATTICE.position([15; 3]), dims: [11; 3], ..LATTICE };
    let base = Arc::new(raster(LATTICE, &density_m));
    let region = raster(region, &density_m);
    let mut frame = DensityFrame { sequence: 0, base, region, rope_map: None, is_leap: false };
    frame.make_ready(None).expect("a sound frame");
    frame
}

fn point() -> Shell {
    Shell::new(&[(DVec3::ZERO, DVec3::Z)], H)
}

/// 500 points evenly on a ball.
fn ball(radius_m: f64) -> Shell {
    let golden_rad = core::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
    let normal = |n: u32| {
        let z = 1.0 - (2.0 * f64::from(n) + 1.0) / 500.0;
        let (sin, cos) = (golden_rad * f64::from(n)).sin_cos();
        DVec3::new(cos * (1.0 - z * z).sqrt(), sin * (1.0 - z * z).sqrt(), z)
    };
    let points: Vec<(DVec3, DVec3)> =
        (0..500).map(|n| (normal(n) * radius_m, -normal(n))).collect();
    Shell::new(&points, H)
}

/// A tool that stands where the hand is, with the force as it is: no filter between.
fn scene(frame: DensityFrame, shell: Shell) -> RenderScene {
    let mut parameters = rig::unlimited();
    parameters.coupling.mode = CouplingMode::Direct;
    parameters.filter = FilterParameters { cutoff_hz: [f64::INFINITY; 2] };
    parameters.contact.stiffness_n_per_m = STIFFNESS_N_PER_M;
    parameters.limits.speed_m_per_s = 1e3;
    let rope = Rope { stiffness_n_per_m: 300.0, force_n: 2.0 };
    RenderScene {
        parameters,
        obstacles: Vec::new(),
        clay: Some(Clay { world_from_map: Pose::IDENTITY, frame, smoothing: 0.0, rope }),
        tool: Tool {
            shell,
            inertia: Inertia {
                mass_kg: 0.05,
                body_kg_m2: DMat3::IDENTITY * 1e-6,
                least_kg_m2: 1e-6,
            },
            center_of_mass_tool: DVec3::ZERO,
        },
    }
}

/// A hand that holds the tool at a given pose.
struct Hand<'s> {
    scene: &'s RenderScene,
    state: State,
    sequence: u64,
}

impl<'s> Hand<'s> {
    /// Enabled where the scene begins: that is the arm's zero.
    fn new(scene: &'s RenderScene) -> Self {
        let mut hand = Self { scene, state: State::new(scene), sequence: 0 };
        hand.at(scene.parameters.mapping.start.translation);
        hand
    }

    /// One tick with the hand there.
    fn at(&mut self, place: DVec3) -> TickOutput {
        self.sequence += 1;
        let from = self.scene.parameters.mapping.start.translation;
        let pose = Pose::from_translation(place - from);
        let sample = DeviceSample {
            sequence: self.sequence,
            status: SampleStatus::Fresh,
            pose,
            ..DeviceSample::default()
        };
        let input = TickInput { sample, request: DriveRequest::Enable, ..TickInput::default() };
        let output = tick(self.scene, &mut self.state, &input);
        assert_eq!(output.faults, Faults::NONE, "tick {}", self.sequence);
        output
    }

    /// As many ticks as it takes to stand there.
    fn go(&mut self, place: DVec3) -> TickOutput {
        for _ in 0..100 {
            let output = self.at(place);
            if output.world_from_tool.translation.distance(place) < 1e-12 {
                return self.at(place);
            }
        }
        panic!("the tool does not come to {place}");
    }
}

/// Outward normals of planes through the origin.
fn tilted() -> [DVec3; 3] {
    [DVec3::Z, DVec3::new(0.3, -0.2, 0.9).normalize(), DVec3::new(-1.0, 0.7, 0.1).normalize()]
}

#[test]
fn a_point_is_pushed_out_of_a_plane_with_stiffness_times_depth() {
    // A density need not be a distance: what counts is where it is zero and which way it falls.
    let densities: [fn(f64) -> f64; 3] = [|d| d, |d| 3.0 * d, |d| 0.4 * d + 60.0 * d * d.abs()];
    for normal in tilted() {
        for (kind, density) in densities.into_iter().enumerate() {
            let scene = scene(frame(|place| density(-place.dot(normal))), point());
            let mut hand = Hand::new(&scene);
            // Inside of the region, across its border, and in the base.
            for depth_m in [0.05 * H, 0.3 * H, H, 2.7 * H, 4.6 * H, 9.3 * H] {
                let output = hand.go(-normal * depth_m);
                let expected = normal * (STIFFNESS_N_PER_M * depth_m);
                let error_m = (output.contact_world.force - expected).length() / STIFFNESS_N_PER_M;
                // Interpolation of what is bent moves the surface a little.
                let bound_m = if kind == 2 { 0.05 * H } else { 1e-4 * H };
                assert!(
                    error_m < bound_m,
                    "{normal}, {kind}, {depth_m} m: {:?}",
                    output.contact_world.force
                );
                assert!(
                    (output.max_depth_m - depth_m).abs() < bound_m && output.contacts == 1,
                    "{output:?}"
                );
                assert!((output.clearance_m + output.max_depth_m).abs() < 1e-12);
            }
            let output = hand.go(normal * 0.1 * H);
            assert_eq!(
                (output.contact_world, output.contacts, output.max_depth_m),
                (Wrench::ZERO, 0, 0.0)
            );
            assert!(output.clearance_m >= 0.0 && output.clearance_m <= 0.1001 * H, "{output:?}");
        }
    }
}

#[test]
fn a_ball_of_clay_pushes_along_its_radius() {
    let radius_m = 8.3e-3;
    let center = DVec3::new(1e-3, -0.4e-3, 0.7e-3);
    let mut scene = scene(frame(|place| radius_m - place.distance(center)), point());
    // Where the clay stands and how it is turned makes no difference.
    let world_from_map =
        Pose::new(DQuat::from_scaled_axis(DVec3::new(0.4, -1.1, 0.3)), DVec3::new(0.1, 0.2, -0.05));
    if let Some(clay) = &mut scene.clay {
        clay.world_from_map = world_from_map;
    }
    scene.parameters.mapping.start = world_from_map;
    for n in 0..60_u32 {
        let t = f64::from(n);
        let way = DVec3::new((1.3 * t).sin(), (0.7 * t).cos(), (2.1 * t).sin()).normalize();
        let depth_m = H * (0.2 + 2.0 * (t * 0.37).fract());
        let place = world_from_map.transform_point(center + way * (radius_m - depth_m));
        let output = Hand::new(&scene).go(place);
        let force = output.contact_world.force;
        let way_world = world_from_map.transform_vector(way);
        let angle_deg = force.angle_between(way_world).to_degrees();
        assert!(angle_deg < 1.5, "{n}: {angle_deg}° off");
        assert!(
            (output.max_depth_m - depth_m).abs() < 0.06 * H,
            "{n}: {} of {depth_m} m",
            output.max_depth_m
        );
        assert!((force.length() / (STIFFNESS_N_PER_M * output.max_depth_m) - 1.0).abs() < 1e-6);
    }
}

#[test]
fn clearance_is_never_more_than_there_is_and_depth_never_less() {
    let clay_m = 7e-3;
    let tool_m = 4e-3;
    let scene = scene(frame(|place| 1.7 * (clay_m - place.length())), ball(tool_m));
    let mut reported_something = 0;
    for n in 0..200_u32 {
        let t = f64::from(n);
        let way = DVec3::new((1.3 * t).sin(), (0.7 * t).cos(), (2.1 * t).sin()).normalize();
        let place = way * (clay_m + tool_m - 1e-3 + 0.03 * (t * 0.618).fract());
        let mut hand = Hand::new(&scene);
        hand.at(place);
        let output = hand.go(place);
        // Points, not the ball between them: the shell is coarser than the ball.
        let gap_m = scene
            .tool
            .shell
            .points()
            .map(|(arm, _)| (place + arm.as_dvec3()).length() - clay_m)
            .fold(f64::INFINITY, f64::min);
        if output.contacts == 0 {
            assert!(
                output.clearance_m <= gap_m + 0.05 * H && gap_m > -0.06 * H,
                "{} m of {gap_m} m",
                output.clearance_m
            );
            reported_something += u32::from(output.clearance_m > 0.1 * gap_m);
        } else {
            assert!(
                (output.max_depth_m + gap_m).abs() < 0.08 * H,
                "{} m deep, {gap_m} m",
                output.max_depth_m
            );
        }
    }
    assert!(reported_something > 100, "{reported_something} times more than next to nothing");
}

#[test]
fn a_tool_in_the_middle_of_clay_gets_a_finite_force_or_none() {
    for (what, density) in
        [("flat", (|_| 1e-3) as fn(DVec3) -> f64), ("ball", |place| 0.015 - place.length())]
    {
        for shell in [point(), ball(3e-3)] {
            let scene = scene(frame(density), shell);
            let output = Hand::new(&scene).at(DVec3::ZERO);
            assert!(
                output.contact_world.is_finite() && output.max_depth_m.is_finite(),
                "{what}: {output:?}"
            );
        }
    }
}

#[test]
fn a_broken_frame_that_comes_past_the_check_is_no_force() {
    let scene = scene(frame(|place| -place.z), ball(4e-3));
    let mut hand = Hand::new(&scene);
    assert!(hand.go(DVec3::Z * 3e-3).contacts > 0);
    let mut broken = frame(|place| -place.z);
    broken.region.values_m_mut().fill(f32::NAN);
    broken.base = Arc::new(raster(LATTICE, |_| f64::NAN));
    hand.state.exchange(Box::new(broken));
    for _ in 0..3 {
        let output = hand.at(DVec3::Z * 3e-3);
        assert_eq!((output.contact_world, output.contacts), (Wrench::ZERO, 0));
    }
}

#[test]
fn friction_holds_the_contact_point_up_to_the_cone() {
    let mut scene = scene(frame(|place| -place.z), point());
    scene.parameters.contact.friction =
        FrictionParameters { r#static: 0.5, dynamic: 0.4, stiffness_n_per_m: 5000.0 };
    let mut hand = Hand::new(&scene);
    let normal_n = hand.go(DVec3::NEG_Z * 2e-3).contact_world.force.z;
    assert!((normal_n - 2.0).abs() < 1e-3);
    let mut most = 0.0_f64;
    for n in 1..=100_u32 {
        let force = hand.at(DVec3::new(1e-5 * f64::from(n), 0.0, -2e-3)).contact_world.force;
        assert!((force.z - normal_n).abs() < 1e-3 && force.x <= 0.0, "{force}");
        most = most.max(-force.x / force.z);
        if n < 20 {
            assert!((force.x + 5000.0 * 1e-5 * f64::from(n)).abs() < 1e-6, "it holds: {force}");
        }
        if n > 30 {
            assert!((force.x + 0.4 * force.z).abs() < 1e-6, "it slides: {force}");
        }
    }
    assert!(most <= 0.5 + 1e-9 && most > 0.45, "{most}");
}

#[test]
fn a_rope_pulls_towards_its_anchor_and_is_no_contact() {
    let anchor = DVec3::new(2e-3, 1e-3, -5e-3);
    for mode in [CouplingMode::Direct, CouplingMode::Implicit] {
        let mut scene = scene(
            DensityFrame { rope_map: Some(anchor), ..frame(|place| -0.015 - place.z) },
            point(),
        );
        scene.parameters.coupling.mode = mode;
        let mut hand = Hand::new(&scene);
        let place = DVec3::new(2e-3, 1e-3, 0.0);
        let output = (0..400).map(|_| hand.at(place)).last().expect("ticks");
        assert_eq!(output.contacts, 0);
        let stretch = anchor - output.world_from_tool.translation;
        let bounded_n = 2.0 * (300.0 * stretch.length() / 2.0).tanh();
        let force = output.contact_world.force;
        assert!(
            (force - stretch.normalize() * bounded_n).length() < 1e-6,
            "{mode:?}: {force}, {stretch}"
        );
        // The hand feels all of it: the tool is at rest.
        assert!(
            (output.command_device.force - force).length() < 0.02,
            "{mode:?}: {:?}",
            output.command_device
        );
        assert!(hand.state.clay_forces().rope_world.distance(force) < 1e-12);
        hand.state
            .exchange(Box::new(DensityFrame { rope_map: None, ..frame(|place| -0.015 - place.z) }));
        let output = hand.at(place);
        assert_eq!(
            (output.contact_world, output.command_device),
            (Wrench::ZERO, Wrench::ZERO),
            "{mode:?}"
        );
    }
}

#[test]
fn a_surface_that_leaps_over_the_tool_pushes_it_out_slowly() {
    let air = frame(|place| -5e-3 - place.z);
    let around = frame(|place| 3e-3 - place.z);
    let scene = scene(air, point());
    let felt_n = |is_leap: bool, is_overtaken: bool| {
        let mut hand = Hand::new(&scene);
        hand.go(DVec3::ZERO);
        hand.state.exchange(Box::new(DensityFrame { sequence: 1, is_leap, ..around.clone() }));
        if is_overtaken {
            // No tick has touched the frame that leapt.
            hand.state.exchange(Box::new(DensityFrame { sequence: 2, ..around.clone() }));
        }
        (0..1000).map(|_| hand.at(DVec3::ZERO).contact_world.force.z).collect::<Vec<_>>()
    };
    let at_once = felt_n(false, false);
    assert!(at_once.iter().all(|force_n| (force_n - 3.0).abs() < 1e-6), "{:?}", &at_once[..3]);
    for is_overtaken in [false, true] {
        let slow = felt_n(true, is_overtaken);
        let steepest = slow.windows(2).map(|pair| pair[1] - pair[0]).fold(slow[0], f64::max);
        assert!(steepest < 0.03 && slow.is_sorted(), "{steepest} N in a tick");
        // Nine tenths after 0.3 s, and then all.
        assert!(
            (slow[299] - 2.7).abs() < 0.01 && (slow[999] - 3.0).abs() < 1e-6,
            "{} N, {} N",
            slow[299],
            slow[999]
        );
    }
}

#[test]
fn every_coupling_that_takes_clay_feels_it() {
    for mode in [CouplingMode::Implicit, CouplingMode::Direct, CouplingMode::Constraint] {
        let mut scene = scene(frame(|place| -place.z), point());
        scene.parameters.coupling.mode = mode;
        let mut hand = Hand::new(&scene);
        let outputs: Vec<TickOutput> = (0..1000_u32)
            .map(|n| hand.at(DVec3::NEG_Z * (4e-3 * (f64::from(n) / 400.0).min(1.0))))
            .collect();
        let felt_n = outputs[999].command_device.force.z;
        // Two springs of the same stiffness in a row, or one alone.
        let expected_n = match mode {
            CouplingMode::Direct => 4.0,
            CouplingMode::Constraint => 0.0,
            _ => 2.0,
        };
        assert!((felt_n - expected_n).abs() < 0.02, "{mode:?}: {felt_n} N");
        assert_eq!(mode.feels_clay(), felt_n > 0.1);
    }
}

#[test]
fn clay_adds_to_a_rigid_obstacle_and_takes_nothing_from_it() {
    use vps::mesh::primitives::Shape;
    use vps::mesh::validate::inspect;
    use vps::voxmap::inside_test::InsideTest;
    use vps::voxmap::{Options, Volume};

    let slab = Shape::Plane { x_m: 0.04, y_m: 0.04, thickness_m: 0.02 }.tessellate(1e-5);
    let options = Options { voxel_size_m: H, layers: 8, navigation: None, sides: InsideTest::Auto };
    let obstacle = || {
        let mut map =
            Volume::build(&slab, &inspect(&slab), &options, |_| ()).expect("a grid that fits");
        Obstacle { field: map.field(&slab, false), world_from_map: Pose::IDENTITY }
    };
    let place = DVec3::Z * 3.5e-3;
    let of = |rigid: bool, top_m: Option<f64>| {
        let mut scene = scene(frame(|place| top_m.unwrap_or(-1.0) - place.z), ball(4e-3));
        scene.obstacles.extend(rigid.then(obstacle));
        if top_m.is_none() {
            scene.clay = None;
        }
        Hand::new(&scene).go(place)
    };
    let rigid = of(true, None);
    let far = of(true, Some(-0.01));
    assert!(rigid.contacts > 0);
    assert_eq!(
        (rigid.contact_world, rigid.contacts),
        (far.contact_world, far.contacts),
        "bit for bit"
    );
    let clay = of(false, Some(0.3e-3));
    let both = of(true, Some(0.3e-3));
    assert_eq!(both.contacts, rigid.contacts + clay.contacts);
    let error = both.contact_world.force - rigid.contact_world.force - clay.contact_world.force;
    assert!(error.length() < 1e-9, "{error}");
    assert!((both.max_depth_m - rigid.max_depth_m.max(clay.max_depth_m)).abs() < 1e-12);
}

/// The key `smoothing` is what the tick gets.
#[test]
fn the_pace_of_updates_is_that_of_the_scene() {
    let dir = tempfile::tempdir().expect("a folder");
    let file = dir.path().join("scene.toml");
    for alpha in [0.0_f64, 0.5, 0.9] {
        let text = format!(
            "version = 1\n[sculpt]\nshape = {{ sphere_mm = 10 }}\nspacing_mm = 2\nraster = [12, \
                12, 12]\nsmoothing = {alpha}\n[tool]\nshape = {{ sphere_mm = 2 }}\nvoxel_size_mm = \
                0.5\n[device]\nprofile = \"sim-sigma7\"\n"
        );
        std::fs::write(&file, text).expect("a scene");
        let config = hapticd::config::load_with(&file, &hapticd::config::LoadOptions::default())
            .expect("a sound scene");
        assert_eq!(config.sculpt.expect("clay").smoothing, Some(alpha));
    }
}

#[test]
fn a_recording_on_clay_says_that_it_cannot_be_run_again() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("clay.mcap");
    let recorder = Recorder::new(RecordSubscribers::default(), true);
    let handle =
        recorder.start(&path, false, Box::new(|error| panic!("{error}"))).expect("started");
    let (mut producer, ring) = rtrb::RingBuffer::new(20);
    for tick in 0..20 {
        let clay = Some(FrameInUse { sequence: tick / 4, is_last: false });
        let input = TickInput { clay, ..TickInput::default() };
        producer.push(TickRecord { tick, input, ..TickRecord::default() }).expect("room");
    }
    drop(producer);
    drain(ring, recorder.subscribers(), |_| ());
    assert_eq!(handle.stop().records, 20);
    let error = replay(&path, |_| panic!("nothing is baked")).expect_err("refused");
    assert!(matches!(error, ReplayError::Clay { tick: 0 }), "{error}");
    assert!(error.to_string().contains("frames are not recorded"), "{error}");
}
