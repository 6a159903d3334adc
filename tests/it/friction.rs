//! Friction: what stands on a slope stays, what slides gains the speed that Coulomb says.

use glam::{DMat3, DQuat, DVec3};
use haptics::{
    ContactParameters, CouplingMode, Drive, DriveRequest, Faults, FreeSpace, FrictionParameters,
    Inertia, RenderScene, State, TickInput, TickOutput, Tool, tick,
};
use vps::contact::Obstacle;
use vps::mesh::primitives::Shape;
use vps::pointshell::{self, Points, shell::Shell};
use vps::spatial::{DeviceSample, Pose, SampleStatus, Twist};
use vps::voxmap::field::FieldKind;

use super::rig;

pub(super) const T: f64 = 1e-3;
/// Voxel edge of the slope, m.
pub(super) const S: f64 = 5e-4;
pub(super) const SLOPE_RAD: f64 = 10.0 * core::f64::consts::PI / 180.0;
const G: f64 = 9.81;
pub(super) const MASS_KG: f64 = 0.1;
const STIFFNESS_N_PER_M: f64 = 2000.0;
/// Half the edge of the block, m.
pub(super) const HALF_M: f64 = 5e-3;

fn block(size_m: DVec3) -> Shell {
    let mesh = Shape::Box { size_m }.tessellate(1e-5);
    pointshell::build_with(Points::Facets, &mesh, &rig::volume(&mesh, 1e-3, 8), DVec3::ZERO).0
}

/// A slab whose top goes through the origin, turned about y.
fn slope(angle_rad: f64) -> Obstacle {
    let slab = Shape::Plane { x_m: 0.08, y_m: 0.08, thickness_m: 0.03 }.tessellate(1e-5);
    let field = rig::volume(&slab, S, 8).field(&slab, false);
    Obstacle { field, world_from_map: Pose::new(DQuat::from_rotation_y(angle_rad), DVec3::ZERO) }
}

fn contact(coefficient: f64) -> ContactParameters {
    ContactParameters {
        field: FieldKind::Trilinear,
        stiffness_n_per_m: STIFFNESS_N_PER_M,
        damping_ratio: 0.7,
        friction: FrictionParameters {
            r#static: coefficient,
            dynamic: coefficient,
            stiffness_n_per_m: 10.0 * STIFFNESS_N_PER_M,
        },
        ..ContactParameters::PLAIN
    }
}

/// A block that no hand holds, on a slope.
pub(super) fn scene(coefficient: f64) -> RenderScene {
    let half_m = HALF_M;
    let up = DQuat::from_rotation_y(SLOPE_RAD);
    let inertia_kg_m2 = MASS_KG * (2.0 * half_m) * (2.0 * half_m) / 6.0;
    let mut parameters = rig::unlimited();
    parameters.gravity_m_per_s2 = DVec3::NEG_Z * G;
    parameters.contact = contact(coefficient);
    // A hand that is not there.
    (parameters.coupling.stiffness_n_per_m, parameters.coupling.stiffness_nm_per_rad) =
        (1e-9, 1e-12);
    parameters.mapping.start = Pose::new(up, up * DVec3::Z * half_m);
    RenderScene {
        parameters,
        obstacles: vec![slope(SLOPE_RAD)],
        clay: None,
        tool: Tool {
            shell: block(DVec3::splat(2.0 * half_m)),
            inertia: Inertia {
                mass_kg: MASS_KG,
                body_kg_m2: DMat3::IDENTITY * inertia_kg_m2,
                least_kg_m2: inertia_kg_m2,
            },
            center_of_mass_tool: DVec3::ZERO,
        },
    }
}

/// Where the block is after each tick.
pub(super) fn slide(scene: &RenderScene, n_ticks: u64) -> impl Iterator<Item = Pose> {
    let mut state = State::new(scene);
    (1..=n_ticks).map(move |sequence| {
        let sample =
            DeviceSample { sequence, status: SampleStatus::Fresh, ..DeviceSample::default() };
        let output = tick(
            scene,
            &mut state,
            &TickInput { sample, request: DriveRequest::Enable, ..TickInput::default() },
        );
        assert_eq!(output.faults, Faults::NONE, "tick {sequence}");
        assert_ne!(output.drive, Drive::Disabled);
        output.world_from_tool
    })
}

/// Each tick of a hand that goes down at `down_m_per_s` until `down_s`, waits for
/// half as long, and goes along `way`, as encoders of this step see it.
fn pulled(
    scene: &RenderScene,
    down_m_per_s: f64,
    down_s: f64,
    (way, along_m_per_s): (DVec3, f64),
    encoder_m: f64,
    n_ticks: u64,
) -> Vec<TickOutput> {
    let mut state = State::new(scene);
    let mut last_m = DVec3::ZERO;
    (1..=n_ticks)
        .map(|sequence| {
            let time_s = sequence as f64 * T;
            let along_s = (time_s - 1.5 * down_s).max(0.0);
            let at_m = DVec3::NEG_Z * (down_m_per_s * time_s.min(down_s))
                + way * (along_m_per_s * along_s);
            let twist = Twist { linear: (at_m - last_m) / T, angular: DVec3::ZERO };
            last_m = at_m;
            let sample = DeviceSample {
                pose: Pose::from_translation((at_m / encoder_m).round() * encoder_m),
                twist,
                sequence,
                status: SampleStatus::Fresh,
                ..DeviceSample::default()
            };
            let input = TickInput { sample, request: DriveRequest::Enable, ..TickInput::default() };
            let output = tick(scene, &mut state, &input);
            assert_eq!(output.faults, Faults::NONE, "tick {sequence}");
            output
        })
        .collect()
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn a_block_on_a_slope_holds_for_ten_minutes() {
    let scene = scene(0.3);
    let mut settled = None;
    let mut farthest_m: f64 = 0.0;
    for (tick, pose) in slide(&scene, 600_000).enumerate() {
        if tick == 1000 {
            settled = Some(pose.translation);
        }
        if let Some(from) = settled {
            farthest_m = farthest_m.max(pose.translation.distance(from));
        }
    }
    assert!(farthest_m < S, "crept by {farthest_m} m, a voxel is {S} m");
}

#[test]
fn a_block_that_slides_gains_the_speed_that_coulomb_says() {
    let coefficient = 0.1;
    let scene = scene(coefficient);
    let down = DQuat::from_rotation_y(SLOPE_RAD) * DVec3::X;
    let gone: Vec<f64> = slide(&scene, 221).map(|pose| pose.translation.dot(down)).collect();
    let speed = |tick: usize| (gone[tick + 10] - gone[tick - 10]) / (20.0 * T);
    let measured = (speed(210) - speed(60)) / (150.0 * T);
    let expected = G * (SLOPE_RAD.sin() - coefficient * SLOPE_RAD.cos());
    assert!((measured / expected - 1.0).abs() < 0.03, "{measured} m/s², expected {expected}");
}

#[test]
fn it_breaks_away_at_the_static_coefficient_and_goes_on_at_the_dynamic_one() {
    let tool = |shape: &Shape| {
        let mesh = shape.tessellate(1e-5);
        pointshell::build_with(Points::Facets, &mesh, &rig::volume(&mesh, 1e-3, 8), DVec3::ZERO).0
    };
    let shapes = [
        (Shape::Box { size_m: DVec3::splat(0.01) }, 5e-3),
        (Shape::Box { size_m: DVec3::new(0.02, 5e-3, 5e-3) }, 2.5e-3),
        (Shape::Sphere { radius_m: 5e-3 }, 5e-3),
    ];
    let modes = [CouplingMode::Implicit, CouplingMode::Constraint];
    for ((shape, half_m), mode) in shapes.iter().flat_map(|shape| modes.map(|mode| (shape, mode))) {
        for sticks in [0.1, 0.3, 0.9] {
            let mut scene = scene(sticks);
            scene.parameters.coupling.mode = mode;
            scene.tool.shell = tool(shape);
            scene.obstacles = vec![slope(0.0)];
            // 20 N/mm³, as of scenes that say nothing else.
            scene.parameters.contact.stiffness_n_per_m = 2e4;
            scene.parameters.contact.friction.stiffness_n_per_m = 2e5;
            scene.parameters.contact.friction.dynamic = 0.8 * sticks;
            (
                scene.parameters.coupling.stiffness_n_per_m,
                scene.parameters.coupling.stiffness_nm_per_rad,
            ) = (4000.0, 2.0);
            scene.parameters.coupling.free_space = FreeSpace::Zero;
            scene.parameters.gravity_m_per_s2 = DVec3::ZERO;
            scene.parameters.mapping.start = Pose::from_translation(DVec3::Z * (half_m + 5e-4));
            // Down by 2 mm in 0.4 s, at rest until 0.6 s, then along at 1 mm/s.
            let ticks = pulled(&scene, 5e-3, 0.4, (DVec3::X, 1e-3), 1e-9, 3000);
            let shares: Vec<f64> = ticks
                .iter()
                .skip(600)
                .map(|tick| -tick.contact_world.force.x / tick.contact_world.force.z)
                .collect();
            let most = shares.iter().copied().fold(0.0, f64::max);
            let after = shares[2000..].iter().sum::<f64>() / 400.0;
            assert!(
                (most / sticks - 1.0).abs() < 0.01 && (after / (0.8 * sticks) - 1.0).abs() < 0.01,
                "{shape:?}, {mode:?}, {sticks}: {most} at most, then {after}"
            );
        }
    }
}

/// Each step of an encoder jerks the tool. A face that held within such a tick held any force: a
/// cube that was pressed with 0.45 N was dragged with 0.81 N at a coefficient of 0.4.
#[test]
fn encoders_drag_a_face_no_harder_than_its_cone() {
    let mesh = Shape::Box { size_m: DVec3::splat(0.02) }.tessellate(1e-5);
    let shell =
        pointshell::build_with(Points::Facets, &mesh, &rig::volume(&mesh, 1e-3, 8), DVec3::ZERO).0;
    let modes = [CouplingMode::Implicit, CouplingMode::Constraint];
    for (coefficient, mode) in [0.1, 0.4].into_iter().flat_map(|of| modes.map(|mode| (of, mode))) {
        for along_m_per_s in [5e-3, 10e-3, 20e-3] {
            let mut scene = scene(coefficient);
            scene.parameters.coupling.mode = mode;
            scene.tool.shell = shell.clone();
            scene.obstacles = vec![slope(0.0)];
            scene.parameters.contact.stiffness_n_per_m = 2e4;
            scene.parameters.contact.friction.stiffness_n_per_m = 2e5;
            (
                scene.parameters.coupling.stiffness_n_per_m,
                scene.parameters.coupling.stiffness_nm_per_rad,
            ) = (4000.0, 1.0);
            scene.parameters.coupling.free_space = FreeSpace::Zero;
            scene.parameters.gravity_m_per_s2 = DVec3::ZERO;
            scene.parameters.mapping.start = Pose::from_translation(DVec3::Z * 10.5e-3);
            let pull = (DVec3::X, along_m_per_s);
            // It ends where the block is still a millimetre and more from the slab's rim.
            let ticks = pulled(&scene, 3e-3, 0.2, pull, 40e-6, 1700);
            let [along, pressed] = [DVec3::NEG_X, DVec3::Z].map(|axis| {
                ticks.iter().skip(800).map(|tick| tick.command_device.force.dot(axis)).sum::<f64>()
            });
            assert!(
                pressed > 100.0 && (along / pressed / coefficient - 1.0).abs() < 0.03,
                "{mode:?}, {coefficient}, {along_m_per_s} m/s: {} of the force",
                along / pressed
            );
        }
    }
}

#[test]
fn friction_of_a_hand_that_slides_stands_against_its_way() {
    let modes = [CouplingMode::Implicit, CouplingMode::Constraint];
    let ways = [0.0, 0.4, 1.1, 2.7];
    for (direction_rad, mode) in ways.into_iter().flat_map(|way| modes.map(|mode| (way, mode))) {
        let mut scene = scene(0.25);
        scene.parameters.coupling.mode = mode;
        scene.obstacles = vec![slope(0.0)];
        (
            scene.parameters.coupling.stiffness_n_per_m,
            scene.parameters.coupling.stiffness_nm_per_rad,
        ) = (4000.0, 2.0);
        scene.parameters.coupling.free_space = FreeSpace::Zero;
        scene.parameters.gravity_m_per_s2 = DVec3::ZERO;
        scene.parameters.mapping.start = Pose::from_translation(DVec3::Z * (HALF_M + 5e-4));
        let way = DVec3::new(f64::cos(direction_rad), f64::sin(direction_rad), 0.0);
        // Down by 2 mm in 0.2 s, then along at 10 mm/s.
        let ticks = pulled(&scene, 10e-3, 0.2, (way, 0.01), 1e-9, 1500);
        for (n, tick) in ticks.iter().enumerate().skip(700) {
            let force = tick.command_device.force;
            let along = -force.dot(way) / force.z;
            let across = force.dot(DVec3::Z.cross(way)) / force.z;
            assert!(
                force.z > 1.0 && (along - 0.25).abs() < 0.01 && across.abs() < 0.005,
                "{mode:?}, {direction_rad} rad, tick {n}: {along:.4} along and \
                    {across:.4} across of {force}"
            );
        }
    }
}
