//! The tick driven directly, sample by sample: acceptance tests 11 and 12 under their numbers, then
//! what keeps a hand safe.

use glam::{DMat3, DQuat, DVec3};
use hapticd::config;
use hapticd::config::LoadOptions;
use hapticd::daemon::prepare;
use haptics::{
    CouplingMode, Drive, DriveRequest, Faults, FreeSpace, Inertia, Parameters, RenderScene,
    SpringClamp, State, TickInput, TickOutput, Tool, tick,
};
use vps::contact::Obstacle;
use vps::mesh::primitives::Shape;
use vps::pointshell::{self, shell::Shell};
use vps::spatial::{Axes, DeviceSample, Pose, SampleStatus, Twist, Wrench};

use super::rig;

const T: f64 = 1e-3;
/// k_T, N/m.
const K: f64 = 2000.0;
/// k_R, N·m/rad.
const K_R: f64 = 0.5;
/// Voxel edge of the slab, m.
const S: f64 = 5e-4;
const RAMP_S: f64 = 0.1;
const RAMP_TICKS: u32 = 100;
/// Half the edge of the cube in the hand, m.
const HALF: f64 = 5e-3;

/// Every limit out of the way: what is seen is the coupling.
fn parameters() -> Parameters {
    let mut p = rig::unlimited();
    p.contact.stiffness_n_per_m = 2000.0;
    (p.coupling.stiffness_n_per_m, p.coupling.stiffness_nm_per_rad) = (K, K_R);
    p.filter.cutoff_hz = [f64::INFINITY; 2];
    p.limits.ramp_s = RAMP_S;
    p
}

fn coupling_with(change: impl FnOnce(&mut Parameters)) -> Parameters {
    let mut parameters = parameters();
    change(&mut parameters);
    parameters
}

fn cube() -> Shell {
    let mesh = Shape::Box { size_m: DVec3::splat(2.0 * HALF) }.tessellate(1e-5);
    pointshell::build(&mesh, &rig::volume(&mesh, 1e-3, 8), DVec3::ZERO).0
}

/// A tool over a slab whose top is z = 0, its start at a height.
fn scene(mut parameters: Parameters, shell: Shell, start_z_m: f64) -> RenderScene {
    parameters.mapping.start = at(0.0, 0.0, start_z_m);
    let slab = Shape::Plane { x_m: 0.06, y_m: 0.06, thickness_m: 0.03 }.tessellate(1e-5);
    let field = rig::volume(&slab, S, 8).field(&slab, false);
    let least_kg_m2 = 1.7e-6;
    let inertia = Inertia { mass_kg: 0.1, body_kg_m2: DMat3::IDENTITY * least_kg_m2, least_kg_m2 };
    RenderScene {
        parameters,
        obstacles: vec![Obstacle { field, world_from_map: Pose::IDENTITY }],
        clay: None,
        tool: Tool { shell, inertia, center_of_mass_tool: DVec3::ZERO },
    }
}

fn at(x_m: f64, y_m: f64, z_m: f64) -> Pose {
    Pose::from_translation(DVec3::new(x_m, y_m, z_m))
}

fn smooth(t: f64) -> f64 {
    let t = t.clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// An arm of which the test says where it is.
struct Arm {
    scene: RenderScene,
    state: State,
    last: DeviceSample,
}

impl Arm {
    fn new(scene: RenderScene) -> Self {
        let state = State::new(&scene);
        Self { scene, state, last: DeviceSample::default() }
    }

    fn give(&mut self, sample: DeviceSample, request: DriveRequest) -> TickOutput {
        tick(&self.scene, &mut self.state, &TickInput { sample, request, ..TickInput::default() })
    }

    fn request(&mut self, pose: Pose, request: DriveRequest) -> TickOutput {
        let before = if self.last.sequence == 0 { pose } else { self.last.pose };
        let twist = Twist {
            linear: (pose.translation - before.translation) / T,
            angular: before.rotation_to(pose) / T,
        };
        let sequence = self.last.sequence + 1;
        self.last = DeviceSample {
            pose,
            twist,
            sequence,
            status: SampleStatus::Fresh,
            ..DeviceSample::default()
        };
        self.give(self.last, request)
    }

    fn enable(&mut self, pose: Pose) -> TickOutput {
        self.request(pose, DriveRequest::Enable)
    }

    /// Enables at the zero pose and waits for the end of the ramp; a shipped scene begins it with
    /// the fourth tick.
    fn ramped(mut self) -> Self {
        let mut last = TickOutput::default();
        for _ in 0..=RAMP_TICKS + 3 {
            last = self.enable(Pose::IDENTITY);
        }
        assert_eq!(last.drive, Drive::Enabled);
        self
    }
}

fn is_zero(wrench: Wrench) -> bool {
    rig::is_bit_zero(wrench)
}

#[test]
fn acceptance_11_the_half_voxel_clamp_bounds_what_is_felt_and_how_far_the_tool_sinks() {
    let point = || Shell::new(&[(DVec3::new(0.0, 0.0, -HALF), DVec3::Z)], S);
    // The worst case of the rule: one point, its contact as soft as the coupling. The full spring
    // then sinks it by s/2.
    for (what, shell, contact_n_per_m) in [("cube", cube(), 2000.0), ("one point", point(), K)] {
        let mode = CouplingMode::Implicit;
        for free_space in [FreeSpace::Zero, FreeSpace::Drag] {
            let parameters = coupling_with(|p| {
                p.coupling.clamp = SpringClamp::HalfVoxel;
                p.coupling.mode = mode;
                p.coupling.free_space = free_space;
                p.contact.stiffness_n_per_m = contact_n_per_m;
            });
            let radius_m = shell.radius_m();
            let copy = Shell::new(
                &shell.points().map(|(p, n)| (p.as_dvec3(), n.as_dvec3())).collect::<Vec<_>>(),
                S,
            );
            let mut arm = Arm::new(scene(parameters, copy, HALF + 1e-3)).ramped();
            let mut last = TickOutput::default();
            for n in 0..1200 {
                // Down by 21 mm, 20 mm into the slab, with a wobble, then still.
                let share = smooth(f64::from(n) / 500.0);
                let wobble = if n < 700 { (f64::from(n) * 0.05).sin() } else { 0.0 };
                let turn = DQuat::from_rotation_x(0.3 * wobble);
                last = arm.enable(Pose::new(turn, DVec3::new(2e-3 * wobble, 0.0, -0.021 * share)));
                let felt = last.commanded_device;
                // The voxel edge is an `f32` in the field.
                assert!(
                    felt.force.length() <= K * 0.5 * S * (1.0 + 1e-7),
                    "{what}, {mode:?}, tick {n}: {felt:?}"
                );
                let torque_max_nm = K_R * 0.5 * S / radius_m;
                assert!(
                    felt.torque.length() <= torque_max_nm * (1.0 + 1e-7),
                    "{what}, {mode:?}, tick {n}: {felt:?}"
                );
            }
            let sunk_m = HALF - last.world_from_tool.translation.z;
            assert!(
                sunk_m > 0.0 && sunk_m <= 0.5 * S * 1.001,
                "{what}, {mode:?}, {free_space:?}: sinks {sunk_m} m"
            );
            assert!(
                last.max_depth_m <= 0.5 * S * 1.001,
                "{what}, {mode:?}: {} m deep",
                last.max_depth_m
            );
            assert!(
                (last.commanded_device.force.z / (K * 0.5 * S) - 1.0).abs() < 1e-3,
                "{what}: pressed with all of the spring"
            );
        }
    }
}

#[test]
fn acceptance_12_free_space_is_zero_to_the_bit_or_drags_with_the_whole_coupling() {
    // 20 mm above the slab, moved fast in every axis: the spring is stretched in every tick.
    let path = |n: u32| {
        let t = f64::from(n) * T;
        let shift = DVec3::new((9.0 * t).sin(), (7.0 * t).sin(), (11.0 * t).sin()) * 8e-3;
        Pose::new(DQuat::from_scaled_axis(DVec3::new(0.2, -0.1, 0.3) * (8.0 * t).sin()), shift)
    };
    let mode = CouplingMode::Implicit;
    let start_z_m = 0.02 + HALF;
    let with = |free_space| {
        let p = coupling_with(|p| (p.coupling.mode, p.coupling.free_space) = (mode, free_space));
        Arm::new(scene(p, cube(), start_z_m)).ramped()
    };
    let mut zero = with(FreeSpace::Zero);
    let mut drag = with(FreeSpace::Drag);
    let mut strongest_n = 0.0_f64;
    for n in 0..1500 {
        let pose = path(n);
        let free = zero.enable(pose);
        let felt = drag.enable(pose);
        assert_eq!((free.contacts, felt.contacts), (0, 0));
        assert!(is_zero(free.contact_world) && is_zero(felt.contact_world), "{mode:?}, tick {n}");
        assert!(
            is_zero(free.commanded_device) && is_zero(free.command_device),
            "{mode:?}, tick {n}: {free:?}"
        );
        // The spring between where the arm wants the tool and where it is.
        let target = DVec3::Z * start_z_m + pose.translation;
        // A mass that is not felt does not lag.
        let stands = free.world_from_tool;
        assert!(
            (stands.translation - target).length() < 1e-15,
            "{mode:?}, tick {n}: {stands:?}, not {target}"
        );
        assert!(
            stands.rotation_to(pose).length() < 1e-12,
            "{mode:?}, tick {n}: {stands:?}, not {pose:?}"
        );
        let expected = (felt.world_from_tool.translation - target) * K;
        assert!(
            (felt.commanded_device.force - expected).length() < 1e-9,
            "{mode:?}, tick {n}: {felt:?}"
        );
        let turn = felt.world_from_tool.rotation_to(Pose::new(pose.rotation, target));
        assert!(
            (felt.commanded_device.torque + turn * K_R).length() < 1e-9,
            "{mode:?}, tick {n}: {felt:?}"
        );
        strongest_n = strongest_n.max(expected.length());
    }
    assert!(strongest_n > 0.3, "{mode:?}: the spring was hardly stretched, {strongest_n} N");
    // No virtual tool, no spring.
    let p = coupling_with(|p| p.coupling.mode = CouplingMode::Direct);
    let mut direct = Arm::new(scene(p, cube(), 0.02 + HALF)).ramped();
    for n in 0..1500 {
        let output = direct.enable(path(n));
        assert!(is_zero(output.contact_world) && is_zero(output.commanded_device), "tick {n}");
    }
}

#[test]
fn acceptance_12_first_contact_is_felt_at_once_and_what_was_unfelt_comes_in_over_five_ticks() {
    // Weight pulls the tool down: the coupling carries it in free space, which the hand does not
    // feel.
    for weight_n in [0.0, 0.981] {
        let p = coupling_with(|p| p.gravity_m_per_s2 = DVec3::Z * -weight_n / 0.1);
        let mut zero = Arm::new(scene(p, cube(), HALF + 1.5e-3)).ramped();
        let mut touching = 0;
        for n in 0..200 {
            let down_m = -5e-5 * f64::from(n);
            let output = zero.enable(at(0.0, 0.0, down_m));
            let felt = output.commanded_device;
            if output.contacts == 0 {
                assert!(is_zero(felt) && touching == 0, "tick {n}");
                continue;
            }
            touching += 1;
            let stretch = output.world_from_tool.translation - DVec3::Z * (HALF + 1.5e-3 + down_m);
            let unfelt = DVec3::Z * -weight_n * (1.0 - f64::from(touching.min(5)) / 5.0);
            let expected = stretch * K - unfelt;
            assert!(
                (felt.force - expected).length() < 1e-9,
                "{weight_n} N, tick {n}: {felt:?}, not {expected}"
            );
            // No step at first contact: what the hand goes in by in a tick or two, a fifth of what
            // was not felt, and no more.
            assert!(
                touching > 1 || felt.force.length() < 2.0 * K * 5e-5 + weight_n / 5.0,
                "{weight_n} N, tick {n}: {felt:?}"
            );
        }
        assert!(touching > 50, "{touching} ticks in contact");
    }
}

/// Direct coupling, the cube held still 0.3 mm deep: the wanted wrench is the same in every tick.
fn pressed(change: impl FnOnce(&mut Parameters)) -> Arm {
    let p = coupling_with(|p| {
        p.coupling.mode = CouplingMode::Direct;
        change(p);
    });
    Arm::new(scene(p, cube(), HALF - 3e-4))
}

#[test]
fn enabling_ramps_up_from_zero() {
    let mut arm = pressed(|_| ());
    let disabled = arm.request(Pose::IDENTITY, DriveRequest::Disable);
    assert!(
        is_zero(disabled.command_device)
            && disabled.contacts > 0
            && disabled.drive == Drive::Disabled
    );
    let whole_n = disabled.contact_world.force.length();
    assert!(whole_n > 1.0, "{whole_n} N");
    for n in 1..=RAMP_TICKS {
        let output = arm.enable(Pose::IDENTITY);
        let expected_n = whole_n * f64::from(n) / f64::from(RAMP_TICKS);
        assert!(
            (output.commanded_device.force.length() - expected_n).abs() < 1e-9 * whole_n,
            "tick {n}: {output:?}"
        );
        assert_eq!(
            output.drive,
            if n < RAMP_TICKS { Drive::Enabling } else { Drive::Enabled },
            "tick {n}"
        );
    }
    assert_eq!(
        arm.enable(Pose::IDENTITY).commanded_device,
        disabled.contact_world,
        "then all of it"
    );
}

#[test]
fn a_coupled_tool_also_ramps_up_without_a_step_back() {
    // Gravity: the tool sags into the spring, so that there is a force without contact.
    let p = coupling_with(|p| {
        p.coupling.free_space = FreeSpace::Drag;
        p.gravity_m_per_s2 = DVec3::Z * -9.81;
    });
    let mut arm = Arm::new(scene(p, cube(), 0.03));
    let mut before_n = 0.0;
    for n in 1..=300 {
        let force = arm.enable(Pose::IDENTITY).commanded_device.force;
        assert!(
            force.length() >= before_n - 1e-12 && -force.z == force.length(),
            "tick {n}: {force} after {before_n} N"
        );
        assert!(
            force.length() <= 0.981 * (f64::from(n) / f64::from(RAMP_TICKS)).min(1.0) + 1e-9,
            "tick {n}: {force}"
        );
        before_n = force.length();
    }
    assert!((before_n - 0.981).abs() < 1e-6, "the weight of the tool: {before_n} N");
}

#[test]
fn the_magnitude_clamp_keeps_direction() {
    let tilted = DVec3::new(0.5, -0.3, 1.0).normalize();
    let points =
        [(DVec3::new(4e-3, 3e-3, -HALF), tilted), (DVec3::new(-2e-3, 4e-3, -HALF), DVec3::Z)];
    let p = coupling_with(|p| {
        p.coupling.mode = CouplingMode::Direct;
        p.contact.stiffness_n_per_m = 20_000.0;
        (p.limits.force_n, p.limits.torque_nm) = (3.0, 0.005);
    });
    let mut arm = Arm::new(scene(p, Shell::new(&points, S), HALF - 8e-4)).ramped();
    let output = arm.enable(Pose::IDENTITY);
    let felt = output.commanded_device;
    let contact = output.contact_world;
    assert!(contact.force.length() > 15.0 && contact.torque.length() > 0.05, "{contact:?}");
    assert!(
        (felt.force.length() - 3.0).abs() < 1e-12 && (felt.torque.length() - 0.005).abs() < 1e-15,
        "{felt:?}"
    );
    assert!((felt.force.normalize() - contact.force.normalize()).length() < 1e-12);
    assert!((felt.torque.normalize() - contact.torque.normalize()).length() < 1e-12);
}

#[test]
fn a_sample_that_is_not_a_number_is_zero_force_at_once_and_stays_a_fault_until_disabled() {
    let poisons: [fn(&mut DeviceSample); 6] = [
        |sample| sample.pose.translation.x = f64::NAN,
        |sample| sample.pose.translation.z = f64::INFINITY,
        |sample| sample.pose.rotation.w = f64::NAN,
        |sample| sample.pose.rotation = DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0),
        |sample| sample.twist.angular.y = f64::NAN,
        |sample| sample.twist.linear.y = f64::NEG_INFINITY,
    ];
    for (which, poison) in poisons.into_iter().enumerate() {
        for mode in [CouplingMode::Implicit, CouplingMode::Direct] {
            let p = coupling_with(|p| p.coupling.mode = mode);
            let mut arm = Arm::new(scene(p, cube(), HALF - 3e-4)).ramped();
            assert!(arm.enable(at(0.0, 0.0, -5e-4)).commanded_device.force.z > 0.1, "{mode:?}");
            let mut sample = arm.last;
            sample.sequence += 1;
            poison(&mut sample);
            let output = arm.give(sample, DriveRequest::Enable);
            assert!(
                is_zero(output.command_device) && is_zero(output.commanded_device),
                "poison {which}, {mode:?}: {output:?}"
            );
            assert_eq!(
                (output.drive, output.faults),
                (Drive::Fault, Faults::NON_FINITE),
                "poison {which}, {mode:?}"
            );
            assert!(
                output.world_from_tool.is_finite() && output.contact_world.is_finite(),
                "poison {which}, {mode:?}"
            );
            for request in [DriveRequest::Enable, DriveRequest::Stop, DriveRequest::Enable] {
                for _ in 0..50 {
                    let output = arm.request(Pose::IDENTITY, request);
                    assert!(is_zero(output.command_device), "poison {which}, {mode:?}");
                    assert_eq!(
                        (output.drive, output.faults),
                        (Drive::Fault, Faults::NON_FINITE),
                        "poison {which}, {mode:?}"
                    );
                }
            }
            let output = arm.request(Pose::IDENTITY, DriveRequest::Disable);
            assert_eq!(
                (output.drive, output.faults),
                (Drive::Disabled, Faults::NONE),
                "poison {which}, {mode:?}"
            );
            let again = arm.enable(Pose::IDENTITY);
            assert_eq!(
                (again.drive, again.faults),
                (Drive::Enabling, Faults::NONE),
                "poison {which}, {mode:?}"
            );
            let force_n = again.commanded_device.force.length();
            let whole_n = again.contact_world.force.length();
            assert!(
                force_n <= whole_n * 1.001 / f64::from(RAMP_TICKS),
                "poison {which}, {mode:?}: {force_n} N of {whole_n} N at once"
            );
        }
    }
}

#[test]
fn a_stop_ramps_down_to_exactly_zero_and_then_disables() {
    let mut arm = pressed(|_| ()).ramped();
    let mut before_n = arm.enable(Pose::IDENTITY).commanded_device.force.length();
    for n in 1..=RAMP_TICKS {
        let output = arm.request(Pose::IDENTITY, DriveRequest::Stop);
        let force_n = output.commanded_device.force.length();
        assert!(force_n < before_n, "tick {n}: {force_n} N after {before_n} N");
        before_n = force_n;
        if n < RAMP_TICKS {
            assert_eq!(output.drive, Drive::Stopping, "tick {n}");
        } else {
            assert!(
                output.drive == Drive::Disabled && is_zero(output.command_device),
                "{output:?}"
            );
        }
    }
    for _ in 0..50 {
        let output = arm.request(Pose::IDENTITY, DriveRequest::Stop);
        assert!(
            output.drive == Drive::Disabled
                && is_zero(output.command_device)
                && output.contacts > 0,
            "{output:?}"
        );
    }
}

#[test]
fn enabling_anywhere_is_without_force() {
    for free_space in [FreeSpace::Zero, FreeSpace::Drag] {
        let p = coupling_with(|p| {
            p.coupling.free_space = free_space;
            p.mapping.scale = 2.5;
            p.mapping.world_from_device = Pose::new(
                DQuat::from_scaled_axis(DVec3::new(0.4, 0.9, -1.1)),
                DVec3::new(0.3, 0.1, -0.2),
            );
        });
        let mut arm = Arm::new(scene(p, cube(), 0.03));
        for n in 0..20 {
            let n = f64::from(n);
            let somewhere = Pose::new(
                DQuat::from_scaled_axis(
                    DVec3::new((1.3 * n).sin(), (2.1 * n).cos(), n.sin()) * 1.5,
                ),
                DVec3::new((0.7 * n).cos(), (1.9 * n).sin(), (0.3 * n).cos()) * 0.07,
            );
            // Let go, moved away, enabled again.
            arm.last.sequence = 0;
            arm.state = State::new(&arm.scene);
            arm.request(somewhere, DriveRequest::Disable);
            for _ in 0..150 {
                let output = arm.enable(somewhere);
                let felt = output.commanded_device;
                assert!(
                    felt.force.length() < 1e-12 && felt.torque.length() < 1e-12,
                    "{somewhere:?}: {felt:?}"
                );
                assert!(free_space == FreeSpace::Drag || is_zero(felt));
                assert!(
                    (output.world_from_tool.translation - DVec3::Z * 0.03).length() < 1e-12,
                    "{:?}",
                    output.world_from_tool
                );
                assert!(output.world_from_tool.rotation.angle_between(DQuat::IDENTITY) < 1e-6);
            }
        }
    }
}

#[test]
fn torque_that_an_arm_has_no_motors_for_is_reported_and_dropped() {
    let options = LoadOptions { device: Some("sim-touch".to_owned()), ..LoadOptions::default() };
    let config = config::load_with(&rig::shipped("block-on-plane"), &options)
        .unwrap_or_else(|errors| panic!("{errors}"));
    let (prepared, _) = prepare(&config, |_| ()).expect("prepared");
    let mut arm = Arm::new(prepared.scene).ramped();
    let mut last = TickOutput::default();
    for n in 0..800 {
        // Tilted and pressed onto one edge.
        let share = smooth(f64::from(n) / 400.0);
        last =
            arm.enable(Pose::new(DQuat::from_rotation_y(0.15 * share), DVec3::Z * (-6e-3 * share)));
        assert!(last.command_device.torque == DVec3::ZERO, "tick {n}: {:?}", last.command_device);
        assert_eq!(last.command_device.force, last.commanded_device.force, "tick {n}");
    }
    assert!(last.contacts > 0 && last.commanded_device.torque.length() > 1e-4, "{last:?}");
}

#[test]
fn scale_multiplies_the_way_and_not_the_force() {
    const SCALE: f64 = 3.0;
    let p = coupling_with(|p| p.mapping.scale = SCALE);
    let mut arm = Arm::new(scene(p, cube(), 0.03)).ramped();
    let mut last = TickOutput::default();
    for n in 0..600 {
        last = arm.enable(at(2e-3 * smooth(f64::from(n) / 200.0), 0.0, 0.0));
    }
    assert!(
        (last.world_from_tool.translation - DVec3::new(6e-3, 0.0, 0.03)).length() < 1e-6,
        "{:?}",
        last.world_from_tool
    );
    for n in 0..900 {
        // 10 mm of the arm are 30 mm of the tool: 5 mm deeper than the slab allows.
        last = arm.enable(at(2e-3, 0.0, -0.010 * smooth(f64::from(n) / 600.0)));
    }
    let stretch_m = last.world_from_tool.translation.z;
    assert!((stretch_m - HALF).abs() < 2e-4, "on the slab: {:?}", last.world_from_tool);
    assert!(
        (last.commanded_device.force.z - K * stretch_m).abs() < 1e-6,
        "the world's stiffness times the world's stretch: {last:?}"
    );
}

#[test]
fn forces_come_back_in_the_axes_of_the_arm() {
    for axis in [
        DVec3::new(0.0, 0.0, 1.57),
        DVec3::new(1.2, 0.0, 0.0),
        DVec3::new(0.7, -1.4, 2.0),
        DVec3::new(3.0, 0.5, 0.1),
    ] {
        for mode in [CouplingMode::Implicit, CouplingMode::Direct] {
            let rotation = DQuat::from_scaled_axis(axis);
            let p = coupling_with(|p| {
                p.coupling.mode = mode;
                p.mapping.world_from_device = Pose::new(rotation, DVec3::new(0.2, -0.1, 0.5));
            });
            let mut arm = Arm::new(scene(p, cube(), HALF + 1e-3)).ramped();
            let push_device = rotation.conjugate() * DVec3::NEG_Z;
            let mut last = TickOutput::default();
            for n in 0..500 {
                last = arm.enable(Pose::from_translation(
                    push_device * (1.8e-3 * smooth(f64::from(n) / 300.0)),
                ));
            }
            let felt = last.commanded_device.force;
            assert!(felt.length() > 0.5, "{axis}, {mode:?}: {last:?}");
            let away = felt.normalize().dot(-push_device);
            assert!(
                away > 0.999,
                "{axis}, {mode:?}: the wall pushes along {felt}, the hand along {push_device}"
            );
            // The same wrench in the world's axes is the contact's, once the tool rests.
            assert!(
                (rotation * felt - last.contact_world.force).length() < 0.01 * felt.length(),
                "{axis}, {mode:?}: {last:?}"
            );
        }
    }
}

#[test]
fn direct_contact_is_that_of_the_pose_of_the_same_tick() {
    // A tick of delay that the stability bound does not know of would halve what an arm can take.
    let direct = coupling_with(|parameters| parameters.coupling.mode = CouplingMode::Direct);
    let mut arm = Arm::new(scene(direct, cube(), HALF + 1e-3)).ramped();
    let apart = arm.request(at(0.0, 0.0, 0.0), DriveRequest::Enable);
    assert!(apart.contacts == 0 && is_zero(apart.command_device));
    let pressed = arm.request(at(0.0, 0.0, -1.4e-3), DriveRequest::Enable);
    assert!((pressed.max_depth_m - 4e-4).abs() < 1e-6, "{} m deep", pressed.max_depth_m);
    assert!(pressed.command_device.force.z > 0.0);
    assert!((pressed.world_from_tool.translation.z - (HALF - 4e-4)).abs() < 1e-12);
}

#[test]
fn power_counts_only_what_has_motors() {
    // A torque without motors, on a hand that turns against it, must not make room for more power
    // along the force.
    let arm_of = |actuated: Axes| {
        let parameters = coupling_with(|parameters| {
            parameters.limits.power_w = 0.5;
            parameters.mapping.actuated = actuated;
        });
        let mut arm = Arm::new(scene(parameters, cube(), HALF)).ramped();
        let mut sample = DeviceSample {
            pose: at(0.0, 0.0, -2e-3),
            sequence: 500,
            status: SampleStatus::Fresh,
            ..arm.last
        };
        let mut largest_n = 0_f64;
        for spin in [0.0, -30.0] {
            sample.pose.rotation = DQuat::from_rotation_x(-0.3);
            sample.twist = Twist { linear: DVec3::Z, angular: DVec3::X * spin };
            for _ in 0..20 {
                sample.sequence += 1;
                let output = arm.give(sample, DriveRequest::Enable);
                assert!(output.faults.is_empty());
                let rendered = output.command_device;
                largest_n = largest_n.max(rendered.force.z);
                assert!(
                    rendered.power(sample.twist) <= 0.5 + 1e-9,
                    "{rendered:?} gives {} W",
                    rendered.power(sample.twist)
                );
            }
        }
        largest_n
    };
    assert!(arm_of(Axes::TRANSLATION) > 0.1, "the limit must be met by a force");
}
