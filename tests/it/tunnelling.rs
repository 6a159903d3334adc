//! Nothing goes through a plate, however fast the hand is: acceptance test 14 under its number.

use glam::{DMat3, DQuat, DVec3};
use haptics::{
    CouplingMode, DriveRequest, Faults, Inertia, LimitParameters, RenderScene, State, TickInput,
    Tool, tick,
};
use vps::contact::Obstacle;
use vps::mesh::primitives::Shape;
use vps::pointshell;
use vps::spatial::testing::Random;
use vps::spatial::{DeviceSample, Pose, SampleStatus, Twist};

use super::rig;

const T: f64 = 1e-3;
/// s, m.
const S: f64 = 1e-3;
const PLATE_M: f64 = 3.0 * S;
const RADIUS_M: f64 = 6e-3;

/// A ball above a plate of three voxels, which is so wide that no way leads around it.
fn scene(mode: CouplingMode) -> RenderScene {
    let plate = Shape::Box { size_m: DVec3::new(0.16, 0.16, PLATE_M) }.tessellate(1e-5);
    let ball = Shape::Sphere { radius_m: RADIUS_M }.tessellate(1e-5);
    let shell = pointshell::build(&ball, &rig::volume(&ball, S, 8), DVec3::ZERO).0;
    let least_kg_m2 = 1e-6;
    let mut parameters = rig::unlimited();
    parameters.coupling.mode = mode;
    parameters.limits = LimitParameters {
        force_n: 10.0,
        torque_nm: 0.2,
        speed_m_per_s: 20.0,
        ramp_s: T,
        ..parameters.limits
    };
    parameters.mapping.start = Pose::from_translation(DVec3::Z * 0.03);
    RenderScene {
        parameters,
        obstacles: vec![Obstacle {
            field: rig::volume(&plate, S, 8).field(&plate, false),
            world_from_map: Pose::IDENTITY,
        }],
        clay: None,
        tool: Tool {
            shell,
            inertia: Inertia {
                mass_kg: 0.05,
                body_kg_m2: DMat3::IDENTITY * least_kg_m2,
                least_kg_m2,
            },
            center_of_mass_tool: DVec3::ZERO,
        },
    }
}

/// Sends the hand along a straight line and then holds it there for a while; returns the height of
/// the tool at the end, and whether any tick touched.
fn throw(scene: &RenderScene, velocity: DVec3, spin_rad_per_s: f64, way_m: f64) -> (f64, bool) {
    let mut state = State::new(scene);
    let mut pose = Pose::IDENTITY;
    let mut height_m = 0.0;
    let mut touched = false;
    let n_moving = (way_m / (velocity.length() * T)).ceil() as u64;
    for sequence in 1..=n_moving + 100 {
        let moves = sequence > 2 && sequence <= n_moving + 2;
        let twist = if moves {
            Twist { linear: velocity, angular: DVec3::X * spin_rad_per_s }
        } else {
            Twist::ZERO
        };
        pose = Pose::new(
            DQuat::from_scaled_axis(twist.angular * T) * pose.rotation,
            pose.translation + twist.linear * T,
        );
        let sample = DeviceSample {
            pose,
            twist,
            sequence,
            status: SampleStatus::Fresh,
            ..DeviceSample::default()
        };
        let output = tick(
            scene,
            &mut state,
            &TickInput { sample, request: DriveRequest::Enable, ..TickInput::default() },
        );
        assert_eq!(output.faults, Faults::NONE, "tick {sequence}");
        assert!(
            output.command_device.force.length() <= scene.parameters.limits.force_n * (1.0 + 1e-12)
        );
        (height_m, touched) =
            (output.world_from_tool.translation.z, touched || output.contacts > 0);
    }
    (height_m, touched)
}

#[test]
fn acceptance_14_no_hand_is_fast_enough_to_go_through_a_plate_of_three_voxels() {
    let mut random = Random(14);
    for mode in [CouplingMode::Implicit, CouplingMode::Constraint, CouplingMode::Direct] {
        let scene = scene(mode);
        for speed_m_per_s in [0.3, 1.0, 5.0, 15.0] {
            for run in 0..12 {
                let mut signed = || random.signed();
                let down = DVec3::new(0.7 * signed(), 0.7 * signed(), -1.0).normalize();
                let (height_m, touched) =
                    throw(&scene, down * speed_m_per_s, 30.0 * signed(), 0.05);
                let what = format!("{mode:?}, {speed_m_per_s} m/s along {down}, run {run}");
                assert!(touched, "{what}: not noticed");
                // Without a virtual tool the shell goes where the hand goes.
                if mode != CouplingMode::Direct {
                    assert!(
                        height_m > 0.0,
                        "{what}: the tool is at {height_m} m, on the other side"
                    );
                }
            }
        }
    }
}
