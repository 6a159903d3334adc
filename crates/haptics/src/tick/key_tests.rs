//! Every key that says how a scene feels reaches the hand, in the amount that a second, slower
//! account of a tick says: at values that are neither 0 nor 1, about axes that are skew, from a
//! start and a grip that are turned.

use std::collections::BTreeSet;

use glam::{DMat3, DQuat, DVec3};

use super::*;
use crate::coupling::on_diagonal;
use crate::passivity_control::LENT_FREELY_J;
use crate::testing::{parameters, product, skew_block, skew_scene, skew_start};
use crate::virtual_tool::tests as virtual_tool;
use crate::{
    ContactParameters, CouplingParameters, DeviceMapping, FilterParameters, FreeSpace,
    FrictionParameters, SpringClamp,
};
use vps::contact::{Normalization, Patch};
use vps::spatial::{Axes, Mat6, SampleStatus};
use vps::voxmap::field::FieldKind;

/// What proves that a key does what it says.
enum Proof {
    /// A tick in contact, with this change, gives what the account says, and other than without.
    InContact(fn(&mut Parameters)),
    /// The same in free space.
    InFreeSpace(fn(&mut Parameters)),
    /// The same in contact without a virtual tool.
    Directly(fn(&mut Parameters)),
    /// With this change every tick is the same.
    Nothing(fn(&mut Parameters)),
    /// A test of its own.
    Test(fn()),
}
use Proof::{Directly, InContact, InFreeSpace, Nothing, Test};

/// The keys of `[contact]`, `[coupling]` and `[filter]`, those of `world_from_device`, and the field.
const PROOFS: [(&str, Proof); 24] = [
    ("contact.stiffness_n_per_mm3", InContact(|p| p.contact.stiffness_n_per_m *= 1.1)),
    ("contact.damping_ratio", InContact(|p| p.contact.damping_ratio = 0.45)),
    ("contact.damping_n_s_per_m", InContact(|p| p.contact.damping_n_s_per_m = 60.0)),
    ("contact.damping_n_s_per_m", InContact(|p| p.contact.damping_n_s_per_m = 3e3)),
    ("contact.braking", Test(virtual_tool::a_brake_acts_along_the_way_out_of_what_is_ahead)),
    ("contact.normalize", InContact(|p| p.contact.normalization = Normalization::Average)),
    ("contact.time_budget_us", Test(a_budget_bounds_what_a_tick_looks_at)),
    ("rendering.field", InContact(|p| p.contact.field = FieldKind::Layers)),
    ("contact.friction", InContact(|p| p.contact.friction.r#static = 5.0)),
    ("contact.friction", InContact(|p| p.contact.friction.dynamic = 0.05)),
    ("contact.friction", InContact(|p| p.contact.friction.stiffness_n_per_m *= 1.2)),
    ("coupling.translation_n_per_mm", InContact(|p| p.coupling.stiffness_n_per_m *= 1.1)),
    ("coupling.rotation_nm_per_rad", InContact(|p| p.coupling.stiffness_nm_per_rad *= 1.1)),
    ("coupling.translation_n_per_mm", Directly(|p| p.coupling.bound_n_per_m = 900.0)),
    ("coupling.rotation_nm_per_rad", Directly(|p| p.coupling.bound_nm_per_rad = 0.03)),
    ("coupling.damping_n_s_per_m", InContact(|p| p.coupling.felt_damping_n_s_per_m *= 1.5)),
    ("coupling.damping_nm_s_per_rad", InContact(|p| p.coupling.felt_damping_nm_s_per_rad *= 1.5)),
    ("coupling.clamp", InContact(|p| p.coupling.clamp = SpringClamp::HalfVoxel)),
    ("coupling.free_space", InFreeSpace(|p| p.coupling.free_space = FreeSpace::Zero)),
    ("filter.cutoff_hz", InContact(|p| p.filter.cutoff_hz[0] = 150.0)),
    ("filter.cutoff_hz", InContact(|p| p.filter.cutoff_hz = [20.0, 25.0])),
    ("world_from_device.position_mm", Nothing(|p| p.mapping.world_from_device.translation.y = 3.0)),
    (
        "world_from_device.orientation_xyzw",
        InContact(|p| p.mapping.world_from_device.rotation *= turn(0.1, -0.2, 0.3)),
    ),
    ("world_from_device.scale", InContact(|p| p.mapping.scale = 2.8)),
];

fn turn(x: f64, y: f64, z: f64) -> DQuat {
    DQuat::from_scaled_axis(DVec3::new(x, y, z))
}

/// Parameters of which none is 0, 1 or unbounded where it says how a scene feels.
fn generic() -> Parameters {
    let mut p = parameters();
    p.gravity_m_per_s2 = DVec3::new(1.5, -2.5, -9.0);
    p.contact = ContactParameters {
        field: FieldKind::Trilinear,
        stiffness_n_per_m: 440.0,
        damping_ratio: 0.35,
        normalization: Normalization::None,
        friction: FrictionParameters { r#static: 0.06, dynamic: 0.04, stiffness_n_per_m: 9e3 },
        damping_n_s_per_m: 45.0,
        braking: false,
    };
    p.coupling = CouplingParameters {
        mode: CouplingMode::Implicit,
        stiffness_n_per_m: 1300.0,
        stiffness_nm_per_rad: 0.45,
        felt_damping_n_s_per_m: 3.7,
        felt_damping_nm_s_per_rad: 0.013,
        clamp: SpringClamp::Saturate,
        free_space: FreeSpace::Drag,
        bound_n_per_m: 2e3,
        bound_nm_per_rad: 0.07,
    };
    p.filter = FilterParameters { cutoff_hz: [60.0, 220.0] };
    p.mapping = DeviceMapping {
        world_from_device: Pose::new(turn(-0.5, 0.8, 0.3), DVec3::new(0.2, 0.3, -0.1)),
        scale: 2.5,
        start: skew_start(0.0),
        ..DeviceMapping::PLAIN
    };
    p.limits = crate::LimitParameters {
        force_n: 40.0,
        torque_nm: 0.6,
        ramp_s: 1e-3,
        ..crate::LimitParameters::NONE
    };
    p
}

/// A new parameter does not compile here before it is named, and so is asked for its row.
#[test]
fn the_account_starts_from_values_that_are_neither_0_nor_1_and_from_skew_rotations() {
    let p = generic();
    let ContactParameters {
        field: _,
        stiffness_n_per_m: contact,
        damping_ratio,
        normalization: _,
        friction: FrictionParameters { r#static, dynamic, stiffness_n_per_m: rubs },
        damping_n_s_per_m,
        braking: _,
    } = p.contact;
    let CouplingParameters {
        mode: _,
        stiffness_n_per_m: linear,
        stiffness_nm_per_rad: angular,
        felt_damping_n_s_per_m,
        felt_damping_nm_s_per_rad,
        clamp: _,
        free_space: _,
        bound_n_per_m,
        bound_nm_per_rad,
    } = p.coupling;
    let FilterParameters { cutoff_hz: [low, high] } = p.filter;
    let DeviceMapping { world_from_device, scale, sensed: _, actuated: _, start } = p.mapping;
    for value in [
        contact,
        damping_ratio,
        r#static,
        dynamic,
        rubs,
        damping_n_s_per_m,
        linear,
        angular,
        felt_damping_n_s_per_m,
        felt_damping_nm_s_per_rad,
        bound_n_per_m,
        bound_nm_per_rad,
        low,
        high,
        scale,
    ] {
        assert!(value.is_finite() && value != 0.0 && value != 1.0, "{value}");
    }
    for pose in [world_from_device, start, samples()[0].pose] {
        let axis = pose.rotation.to_scaled_axis();
        assert!(axis.abs().min_element() > 0.05, "{axis}");
    }
}

#[test]
fn every_key_of_the_default_file_has_a_row() {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../config/default.toml");
    let text = std::fs::read_to_string(path).expect("the file of defaults");
    let is_word =
        |key: &str| key.chars().all(|c| c == '_' || c.is_ascii_lowercase() || c.is_ascii_digit());
    let mut section = "";
    let mut found = BTreeSet::new();
    for line in text.lines() {
        if let Some(head) = line.strip_prefix('[') {
            section = head.split(']').next().expect("a part");
        }
        if let Some(table) = line.strip_prefix("world_from_device = {") {
            let keys = table.split(" = ").filter_map(|part| part.split([' ', ',']).next_back());
            found.extend(
                keys.filter(|key| is_word(key) && !key.is_empty())
                    .map(|key| format!("world_from_device.{key}")),
            );
        }
        let Some((key, _)) = line.trim_start_matches("# ").split_once('=') else { continue };
        if is_word(key.trim()) && ["contact", "coupling", "filter"].contains(&section) {
            found.insert(format!("{section}.{}", key.trim()));
        }
    }
    let proven: BTreeSet<_> = PROOFS
        .iter()
        .map(|(name, _)| *name)
        .filter(|name| !name.starts_with("rendering."))
        .collect();
    assert!(found.iter().map(|name| &**name).eq(proven.iter().copied()), "{found:?}, {proven:?}");
}

#[test]
fn every_key_reaches_the_hand_as_the_account_says() {
    let base = |change: fn(&mut Parameters), scenario: fn(&mut Parameters)| {
        let mut p = generic();
        scenario(&mut p);
        change(&mut p);
        p
    };
    let nothing: fn(&mut Parameters) = |_| ();
    let free_space: fn(&mut Parameters) = |p| p.mapping.start = skew_start(4e-3);
    let directly: fn(&mut Parameters) = |p| p.coupling.mode = CouplingMode::Direct;
    for (key, proof) in &PROOFS {
        let (change, scenario, differs) = match proof {
            InContact(change) => (*change, nothing, true),
            InFreeSpace(change) => (*change, free_space, true),
            Directly(change) => (*change, directly, true),
            Nothing(change) => (*change, nothing, false),
            Test(test) => {
                test();
                continue;
            }
        };
        let without = commanded(&base(nothing, scenario));
        let with = commanded(&base(change, scenario));
        let expected = account(&base(change, scenario));
        let off = |one: Wrench, other: Wrench| {
            let differs = one - other;
            differs.force.length() + 50.0 * differs.torque.length()
        };
        assert!(off(with, expected) < 1e-8, "{key}: {with:?}, by the account {expected:?}");
        let changes = off(with, without) > 1e-3;
        assert_eq!(changes, differs, "{key}: {with:?}, without the change {without:?}");
    }
}

/// Enabled askew, then pressed into the face while it slides and turns.
fn samples() -> [DeviceSample; 4] {
    let zero = Pose::new(turn(0.8, 0.3, -0.5), DVec3::new(0.02, -0.01, 0.03));
    let axes = generic().mapping.world_from_device.rotation.conjugate() * skew_block().rotation;
    core::array::from_fn(|n| {
        let n = n as f64;
        let moved = axes * DVec3::new(0.3e-3, -0.2e-3, -0.1e-3) * n;
        let pose = Pose::new(
            turn(0.01 * n, -0.02 * n, 0.03 * n) * zero.rotation,
            zero.translation + moved,
        );
        let twist = Twist {
            linear: DVec3::new(0.03, -0.02, 0.05) * n,
            angular: DVec3::new(0.4, 0.7, -0.5) * n,
        };
        DeviceSample {
            pose,
            twist,
            sequence: 1 + n as u64,
            status: SampleStatus::Fresh,
            ..DeviceSample::default()
        }
    })
}

/// A scene that is asked to render, sample by sample.
struct Rig {
    scene: RenderScene,
    state: State,
}

impl Rig {
    fn new(p: Parameters) -> Self {
        Self::of(skew_scene(p))
    }

    fn of(scene: RenderScene) -> Self {
        Self { state: State::new(&scene), scene }
    }

    fn tick(&mut self, sample: DeviceSample) -> TickOutput {
        self.tick_placing(sample, None)
    }

    fn tick_placing(&mut self, sample: DeviceSample, place: Option<Placement>) -> TickOutput {
        let request = DriveRequest::Enable;
        let input = TickInput { sample, request, place, ..TickInput::default() };
        tick(&self.scene, &mut self.state, &input)
    }
}

/// What the tick gives for the last of the samples.
fn rendered(p: &Parameters) -> TickOutput {
    let mut rig = Rig::new(*p);
    let mut output = TickOutput::default();
    for sample in samples() {
        output = rig.tick(sample);
        assert!(output.faults.is_empty() && output.drive == Drive::Enabled, "{output:?}");
    }
    output
}

fn commanded(p: &Parameters) -> Wrench {
    rendered(p).command_device
}

/// The same by another account: the state at the end of a tick is solved for, contact is summed
/// point by point, rotations are matrices.
fn account(p: &Parameters) -> Wrench {
    let scene = skew_scene(*p);
    let shell = &scene.tool.shell;
    let inertia = &scene.tool.inertia;
    let period_s = p.period_s;
    let axes = DMat3::from_quat(p.mapping.world_from_device.rotation);
    let start = p.mapping.start;
    let zero = samples()[0].pose;
    let mut body = start;
    let mut twist = Twist::ZERO;
    let mut filtered: Option<Wrench> = None;
    let mut rubs = Rubs::default();
    let mut felt = Wrench::ZERO;
    for sample in samples() {
        let moved = axes * (sample.pose.translation - zero.translation) * p.mapping.scale;
        let turned =
            DMat3::from_quat(sample.pose.rotation) * DMat3::from_quat(zero.rotation).transpose();
        let rotation = axes * turned * axes.transpose() * DMat3::from_quat(start.rotation);
        let target = Pose::new(DQuat::from_mat3(&rotation).normalize(), start.translation + moved);
        let target_twist = Twist {
            linear: axes * sample.twist.linear * p.mapping.scale,
            angular: axes * sample.twist.angular,
        };
        let is_direct = p.coupling.mode == CouplingMode::Direct;
        if is_direct {
            (body, twist) = (target, target_twist);
        }
        let touch = |pose| ContactSum::flat(&scene.obstacles, shell, pose, p.force_law());
        let first = touch(body);
        let rubbing = rubs.tick(&first, body, &p.contact.friction);
        let tool_axes = body.rotation_matrix();
        let inertia_world = Mat6::from_blocks(
            DMat3::IDENTITY * inertia.mass_kg,
            DMat3::ZERO,
            DMat3::ZERO,
            tool_axes * inertia.body_kg_m2 * tool_axes.transpose(),
        );
        let pole_rad_per_s = |contact: &ContactSum, own_rad_per_s: f64| {
            let normal = contact.wrench.force.normalize_or_zero();
            let at = twist.linear + twist.angular.cross(contact.arm_world);
            let speed = (at - normal * normal.dot(at)).length();
            let cutoff_hz = (0.3 * speed / contact.voxel_size_m)
                .max(p.filter.cutoff_hz[0])
                .min(p.filter.cutoff_hz[1]);
            (core::f64::consts::TAU * cutoff_hz).max(own_rad_per_s)
        };
        if is_direct {
            let alpha = filtered.map_or(0.0, |_| (-pole_rad_per_s(&first, 0.0) * period_s).exp());
            let held = first.stiffness.positive_part(&inertia_world).expect("finite");
            let (along, about) = held.plus_scaled(1.0, &rubbing.1).bounds();
            let share = (p.coupling.bound_n_per_m / along)
                .min(p.coupling.bound_nm_per_rad / about)
                .min(1.0);
            let now = first.wrench * share;
            let shaped = filtered.unwrap_or(now) * alpha + now * (1.0 - alpha);
            filtered = Some(shaped);
            felt = shaped + rubbing.0 * share;
            continue;
        }
        let before = filtered;
        // The end of the tick by the contact at `way` from its start.
        let mut end = |contact: &ContactSum, way: Twist| {
            let stiffness = contact.stiffness.positive_part(&inertia_world).expect("finite");
            let (along, about) = stiffness.bounds();
            let own_rad_per_s = (along / inertia.mass_kg).max(about / inertia.least_kg_m2).sqrt();
            let alpha =
                before.map_or(0.0, |_| (-pole_rad_per_s(contact, own_rad_per_s) * period_s).exp());
            let met = contact.wrench + product(&stiffness, way);
            let shaped = before.unwrap_or(met) * alpha + met * (1.0 - alpha);
            filtered = (contact.contacts > 0).then_some(shaped);
            let damping_s = if along > 0.0 {
                2.0 * p.contact.damping_ratio * (inertia.mass_kg / along).sqrt()
            } else {
                0.0
            };
            let spring = spring(p, shell.radius_m(), body, target);
            let critical = |mass: f64, stiffness: f64| 2.0 * (mass * stiffness).sqrt();
            let damper = on_diagonal(
                critical(inertia.mass_kg, p.coupling.stiffness_n_per_m),
                critical(inertia.least_kg_m2, p.coupling.stiffness_nm_per_rad),
            );
            let mass = Mat6::ZERO.plus_scaled(1.0 / period_s, &inertia_world);
            let weight = Wrench::new(p.gravity_m_per_s2 * inertia.mass_kg, DVec3::ZERO);
            let step = |rubbing: &(Wrench, Mat6)| {
                let held =
                    Mat6::ZERO.plus_scaled(1.0 - alpha, &stiffness).plus_scaled(1.0, &rubbing.1);
                let damped = stiffness.plus_scaled(1.0, &rubbing.1);
                let pushes = product(&mass, twist)
                    + spring.0
                    + product(&damper, target_twist)
                    + weight
                    + shaped
                    + rubbing.0;
                let solved = |faces: &Mat6| {
                    let (linear, angular) = mass
                        .plus_scaled(1.0, &damper)
                        .plus_scaled(period_s, &spring.1)
                        .plus_scaled(period_s, &held)
                        .plus_scaled(damping_s, &damped)
                        .plus_scaled(1.0, faces)
                        .solve_spd(pushes)
                        .expect("positive definite");
                    Twist { linear, angular }
                };
                // A face that leaves is damped by no more than what it still presses with.
                let undamped = solved(&Mat6::ZERO);
                let mut faces = Mat6::ZERO;
                for patch in contact.patches() {
                    let leaves = goes_out(patch, undamped);
                    let gives_way_n = (period_s + damping_s) * patch.stiffness_n_per_m * leaves;
                    let pressed_n = patch.force_n + patch.stiffness_n_per_m * goes_out(patch, way);
                    let most = if leaves > 0.0 {
                        (pressed_n - gives_way_n).max(0.0) / leaves
                    } else {
                        f64::INFINITY
                    };
                    let moment = patch.arm_world.cross(patch.normal_world);
                    faces.add_outer(
                        p.contact.damping_n_s_per_m.min(most),
                        patch.normal_world,
                        moment,
                    );
                }
                solved(&faces)
            };
            let mut rubbing = rubbing;
            let mut twist = step(&rubbing);
            let passes = if met.force.length() > 0.0 {
                shaped.force.dot(met.force) / met.force.length_squared()
            } else {
                0.0
            };
            for _ in 0..8 {
                let held_s = (1.0 - alpha) * period_s + damping_s;
                rubs.press(contact, (way, twist), (passes, held_s, p.contact.damping_n_s_per_m));
                let over = rubs.over(twist, period_s, &p.contact.friction);
                if is_near(&over, &rubbing) {
                    break;
                }
                rubbing = over;
                twist = step(&rubbing);
            }
            twist
        };
        let there = end(&first, Twist::ZERO);
        let way = Twist { linear: there.linear * period_s, angular: there.angular * period_s };
        let contact = touch(body.stepped(way.linear, way.angular));
        twist = end(&contact, way);
        let Twist { linear, angular } = twist;
        let reach_m = (linear.length() + angular.length() * shell.radius_m()) * period_s;
        assert!(reach_m < contact.step_limit_m);
        body = body.stepped(linear * period_s, angular * period_s);
        let slip = twist - target_twist;
        felt = Wrench::new(
            slip.linear * p.coupling.felt_damping_n_s_per_m,
            slip.angular * p.coupling.felt_damping_nm_s_per_rad,
        ) - self::spring(p, shell.radius_m(), body, target).0;
        if contact.contacts == 0 && p.coupling.free_space == FreeSpace::Zero {
            felt = Wrench::ZERO;
        }
    }
    Wrench::new(axes.transpose() * felt.force, axes.transpose() * felt.torque)
}

/// How fast, or how far, the middle of a face goes out of what it touches.
fn goes_out(patch: &Patch, way: Twist) -> f64 {
    patch.normal_world.dot(way.linear + way.angular.cross(patch.arm_world))
}

/// The spring on the tool and its secant stiffness.
fn spring(p: &Parameters, radius_m: f64, body: Pose, target: Pose) -> (Wrench, Mat6) {
    // Voxels are kept in single precision.
    let half_voxel_m = 0.5 * f64::from(1e-3_f32);
    let mut bounds = [p.limits.force_n, p.limits.torque_nm];
    if p.coupling.clamp == SpringClamp::HalfVoxel {
        bounds[0] = bounds[0].min(p.coupling.stiffness_n_per_m * half_voxel_m);
        bounds[1] = bounds[1].min(p.coupling.stiffness_nm_per_rad * half_voxel_m / radius_m);
    }
    let saturated = |stiffness: f64, stretch: DVec3, most: f64| {
        let length = stretch.length();
        if length < 1e-12 { stiffness } else { most * (stiffness * length / most).tanh() / length }
    };
    let way = target.translation - body.translation;
    let turn = (target.rotation * body.rotation.conjugate()).to_scaled_axis();
    let linear = saturated(p.coupling.stiffness_n_per_m, way, bounds[0]);
    let angular = saturated(p.coupling.stiffness_nm_per_rad, turn, bounds[1]);
    (Wrench::new(way * linear, turn * angular), on_diagonal(linear, angular))
}

/// Friction of the one face of the tool.
#[derive(Default)]
struct Rubs {
    before: Option<Pose>,
    stretch: DVec3,
    turned: f64,
    slips: bool,
    /// Normal, arm, radius and force of the face.
    face: Option<(DVec3, DVec3, f64, f64)>,
    /// What presses it at the end of the step.
    pressed_n: Option<f64>,
}

/// The same to a thousandth.
fn is_near(one: &(Wrench, Mat6), other: &(Wrench, Mat6)) -> bool {
    let apart = one.0 - other.0;
    let differ = |a: f64, b: f64| (a - b).abs() > 1e-3 * (a.abs() + b.abs());
    let ((along, about), (other_along, other_about)) = (one.1.traces(), other.1.traces());
    apart.force.length() <= 1e-3 * one.0.force.length()
        && apart.torque.length() <= 1e-3 * one.0.torque.length()
        && !differ(along, other_along)
        && !differ(about, other_about)
}

impl Rubs {
    fn press(
        &mut self,
        contact: &ContactSum,
        (way, twist): (Twist, Twist),
        (passes, held_s, damping): (f64, f64, f64),
    ) {
        self.pressed_n = Some(contact.patches().next().map_or(0.0, |patch| {
            let k = patch.stiffness_n_per_m;
            let met_n = passes * (patch.force_n + k * goes_out(patch, way));
            (met_n - (k * held_s + damping) * goes_out(patch, twist)).max(0.0)
        }));
    }

    /// Over a step: what the end of it is stretched by is cut by the cone.
    fn over(&self, twist: Twist, period_s: f64, friction: &FrictionParameters) -> (Wrench, Mat6) {
        let mut stiffness = Mat6::ZERO;
        let Some((normal, arm, radius_m, force_n)) = self.face else {
            return (Wrench::ZERO, stiffness);
        };
        let point = (twist.linear + twist.angular.cross(arm)) * period_s;
        let ends = (
            self.stretch + point - normal * normal.dot(point),
            radius_m * (self.turned + period_s * twist.angular.dot(normal)),
        );
        let k = friction.stiffness_n_per_m;
        let length = ends.0.length().hypot(ends.1);
        let pressed_n = self.pressed_n.unwrap_or(force_n);
        let most = if self.slips { friction.dynamic } else { friction.r#static };
        let slides = k * length > most * pressed_n;
        let share = if slides { friction.dynamic * pressed_n / (k * length) } else { 1.0 };
        let one = normal.any_orthonormal_vector();
        for along in [one, normal.cross(one)] {
            stiffness.add_outer(k * share, along, arm.cross(along));
        }
        stiffness.add_outer(k * share, DVec3::ZERO, normal * radius_m);
        let (stretch, turned_m) = if slides {
            let along = ends.0 / length;
            let moment = arm.cross(along) + normal * (ends.1 / length * radius_m);
            stiffness.add_outer(-k * share, along, moment);
            (ends.0 * share, ends.1 * share)
        } else {
            (self.stretch, self.turned * radius_m)
        };
        let force = stretch * -k;
        let mut wrench = Wrench::new(force, arm.cross(force) - normal * (k * radius_m * turned_m));
        if slides {
            let way = Twist { linear: twist.linear * period_s, angular: twist.angular * period_s };
            wrench = wrench + product(&stiffness, way);
        }
        (wrench, stiffness)
    }

    fn tick(
        &mut self,
        contact: &ContactSum,
        body: Pose,
        friction: &FrictionParameters,
    ) -> (Wrench, Mat6) {
        let before = self.before.replace(body);
        let mut stiffness = Mat6::ZERO;
        let Some(patch) = contact.patches().next() else {
            *self = Self { before: self.before, ..Self::default() };
            return (Wrench::ZERO, stiffness);
        };
        assert_eq!(contact.patches().count(), 1);
        let (normal, arm, radius_m) = (patch.normal_world, patch.arm_world, patch.radius_m);
        let old = (self.stretch, self.turned * radius_m);
        if let Some(before) = before {
            let turn = (body.rotation * before.rotation.conjugate()).to_scaled_axis();
            self.stretch += body.translation - before.translation + turn.cross(arm);
            self.turned += turn.dot(normal);
        }
        self.stretch -= normal * normal.dot(self.stretch);
        let k = friction.stiffness_n_per_m;
        let load_n = k * self.stretch.length().hypot(radius_m * self.turned);
        let most = if self.slips { friction.dynamic } else { friction.r#static };
        let pressed_n = self.pressed_n.take().unwrap_or(patch.force_n);
        self.face = Some((normal, arm, radius_m, patch.force_n));
        self.slips = load_n > most * pressed_n;
        let share = if self.slips { friction.dynamic * pressed_n / load_n } else { 1.0 };
        self.stretch *= share;
        self.turned *= share;
        // Two ways along the wall and the turn about its normal, as a length; sliding takes the
        // direction of the slide out of it.
        let one = normal.any_orthonormal_vector();
        for along in [one, normal.cross(one)] {
            stiffness.add_outer(k * share, along, arm.cross(along));
        }
        stiffness.add_outer(k * share, DVec3::ZERO, normal * radius_m);
        let turns_m = self.turned * radius_m;
        let goes_on = old.0.dot(self.stretch) + old.1 * turns_m >= 0.0;
        if self.slips && share > 0.0 {
            assert!(goes_on, "it slides on");
            let length = self.stretch.length().hypot(turns_m);
            let along = self.stretch / length;
            let moment = arm.cross(along) + normal * (turns_m / length * radius_m);
            stiffness.add_outer(-k * share, along, moment);
        }
        let force = self.stretch * -k;
        let torque = arm.cross(force) - normal * (k * radius_m * turns_m);
        (Wrench::new(force, torque), stiffness)
    }
}

/// A key of the loop, which gives it to the state.
fn a_budget_bounds_what_a_tick_looks_at() {
    let looked_at = |budget: Budget| {
        let scene = skew_scene(generic());
        let mut state = State::new(&scene);
        state.set_budget(budget);
        assert_eq!(state.budget(), budget);
        tick(&scene, &mut state, &TickInput::default()).points_left_out
    };
    let scene = skew_scene(generic());
    assert!(State::new(&scene).rehearse(&scene, 0) > 1);
    assert_eq!(looked_at(Budget::default()), 0);
    assert!(looked_at(Budget::Points(4)) > 0);
}

/// An arm with these motors gets its part of the same wrench.
#[test]
fn what_the_arm_cannot_actuate_is_dropped_and_reported() {
    let mut p = generic();
    let whole = commanded(&p);
    p.mapping.actuated = Axes::TRANSLATION;
    let output = rendered(&p);
    assert_eq!(output.command_device, Wrench::new(whole.force, DVec3::ZERO));
    let differs = output.commanded_device - whole;
    assert!(differs.torque.length() < 1e-12 && differs.force.length() < 1e-12);
    assert!(whole.torque.length() > 1e-3);
}

/// A tool that nothing moves, on a spring to a scaled arm that is turned.
fn anchored(injected_n_s_per_m: f64, actuated: Axes) -> RenderScene {
    let mut p = generic();
    p.mapping.actuated = actuated;
    p.gravity_m_per_s2 = DVec3::ZERO;
    p.coupling.felt_damping_n_s_per_m = 0.0;
    p.coupling.felt_damping_nm_s_per_rad = 0.0;
    p.limits.force_n = f64::INFINITY;
    p.limits.torque_nm = f64::INFINITY;
    p.mapping.start = skew_start(0.1);
    p.arm.injected_n_s_per_m = injected_n_s_per_m;
    let mut scene = skew_scene(p);
    scene.tool.inertia.mass_kg = 1e9;
    scene.tool.inertia.body_kg_m2 = DMat3::IDENTITY * 1e6;
    scene.tool.inertia.least_kg_m2 = 1e6;
    scene
}

/// Energies count at the arm, whose ways are shorter than those of the tool by the scale.
#[test]
fn a_scaled_arm_is_pulled_pays_and_counts_by_its_own_way() {
    for names in [&["x", "y", "z", "rx", "ry", "rz"][..], &["x", "y", "rx", "rz"]] {
        let axes = names.iter().filter_map(|name| Axes::from_name(name));
        pulls_and_pays(axes.fold(Axes::NONE, Axes::union));
    }
}

fn pulls_and_pays(actuated: Axes) {
    let injected = 30.0;
    let mut rig = Rig::of(anchored(injected, actuated));
    let [mut sample, ..] = samples();
    rig.tick(sample);
    // One leap of the grip: its spring holds energy that no hand has put in.
    let way = DVec3::new(1e-3, -2e-3, 0.5e-3);
    sample.pose.translation += way;
    sample.twist = Twist { linear: way / 1e-3, angular: DVec3::ZERO };
    let turned = DVec3::new(0.05, -0.02, 0.04);
    sample.pose.rotation = DQuat::from_scaled_axis(turned) * sample.pose.rotation;
    let first = rig.tick(sample);
    let pull = way * (-1300.0 * 2.5);
    // Of both energies the share that the motors give back.
    let share = |masked: DVec3, whole: DVec3| masked.length_squared() / whole.length_squared();
    let held_j = 0.5
        * 1300.0
        * 2.5
        * way.length_squared()
        * share(way * actuated.linear_mask(), way)
        + 0.5 * 0.45 * turned.length_squared() * share(turned * actuated.angular_mask(), turned);
    let damper = sample.twist.linear * -injected;
    let takes_j = 1e-3 * injected * sample.twist.linear.length_squared();
    let share = (held_j - LENT_FREELY_J) / takes_j;
    assert!(share > 0.01 && share < 1.0, "{share}");
    let expected = (pull + damper * share) * actuated.linear_mask();
    let differs = first.command_device.force - expected;
    assert!(first.passivity_active && differs.length() < 1e-4, "{first:?} {expected}");
    // The command acts over the next way of the grip.
    let next = DVec3::new(-0.3e-3, 0.2e-3, 0.4e-3);
    sample.pose.translation += next;
    let second = rig.tick(sample);
    let energy_j = -first.command_device.force.dot(next);
    assert!((second.energy_j - energy_j).abs() < 1e-15, "{} {energy_j}", second.energy_j);
}

#[test]
fn a_scaled_arm_gets_back_less_of_the_spring_at_its_force_limit() {
    let mut p = generic();
    p.limits.force_n = 6.0;
    // 6 N over 1300 N/m stretch by 4.6 mm in the world, and by 1.8 mm at the arm.
    let stretch_m = 6.0 / 1300.0 / 2.5;
    assert!((spring_at_limit_j(&p) - 0.5 * 6.0 * stretch_m).abs() < 1e-15);
}

/// What an obstacle that moves does to the hand is counted apart, at the arm.
#[test]
fn an_obstacle_under_way_works_on_a_scaled_arm_by_its_way_over_the_scale() {
    let mut p = generic();
    p.coupling.mode = CouplingMode::Direct;
    p.limits.speed_m_per_s = 2.0;
    let mut rig = Rig::new(p);
    let [sample, ..] = samples();
    let block = skew_block();
    let to =
        block.stepped(block.transform_vector(DVec3::new(1e-3, 2e-3, -0.2e-3)), DVec3::splat(0.02));
    let place = Some(Placement { obstacle_idx: 0, world_from_map: to });
    let mut before = rig.tick_placing(sample, place);
    assert!(before.command_device.force.length() > 0.1, "{before:?}");
    let back = p.mapping.world_from_device.rotation.conjugate();
    let mut work_j = 0.0;
    for _ in 0..5 {
        let output = rig.tick(sample);
        let pose = rig.state.traversal.obstacle_poses().pose(0).expect("one");
        let center = skew_start(0.0).translation;
        let linear = back * pose.moved.at(center) / 2.5;
        let angular = back * pose.moved.angular;
        work_j +=
            before.command_device.force.dot(linear) + before.command_device.torque.dot(angular);
        assert!((output.object_work_j - work_j).abs() < 1e-12, "{} {work_j}", output.object_work_j);
        assert_eq!(output.objects_moving, 1);
        let reported = output.object.expect("it is under way");
        assert_eq!((reported.obstacle_idx, reported.world_from_map), (0, pose.world_from_map));
        before = output;
    }
    assert!(work_j.abs() > 1e-9, "{work_j}");
}

#[test]
fn a_tick_reports_what_it_found_and_what_it_gave() {
    let p = generic();
    let mut rig = Rig::new(p);
    let scene = skew_scene(p);
    let [sample, ..] = samples();
    let found =
        ContactSum::flat(&scene.obstacles, &scene.tool.shell, skew_start(0.0), p.force_law());
    let input = TickInput { sample, ..TickInput::default() };
    let disabled = tick(&scene, &mut rig.state, &input);
    assert_eq!((disabled.contacts, disabled.points_left_out), (24, 0));
    assert_eq!(disabled.contact_world, found.wrench);
    assert_eq!(
        (disabled.max_depth_m, disabled.clearance_m),
        (found.max_value_m, -found.max_value_m)
    );
    assert_eq!(disabled.world_from_tool.translation, skew_start(0.0).translation);
    assert_eq!(disabled.commanded_device, Wrench::ZERO);
    let late = samples().map(|sample| DeviceSample { delay_ticks: 3, ..sample });
    let mut before = TickOutput::default();
    for sample in late {
        before = rig.tick(sample);
        assert_eq!((before.delay_ticks, before.off_cause), (3, OffCause::None));
    }
    let at = rig.state.indexed(&scene);
    assert_eq!(at.0, samples()[0].pose);
    assert!((at.1.translation - skew_start(0.0).translation).length() < 1e-15);
    assert_eq!((before.objects_moving, before.object), (0, None));
    // Sliding: what is reported is the contact at the end of the tick, along the normal, with its
    // friction across.
    let shell = &scene.tool.shell;
    let [.., sample] = late;
    let next = rig.tick(sample);
    let stands = next.world_from_tool;
    let found = ContactSum::flat(&scene.obstacles, shell, stands, p.force_law());
    let normal = found.wrench.force.normalize();
    let pressed_n = next.contact_world.force.dot(normal);
    assert!((pressed_n / found.wrench.force.length() - 1.0).abs() < 1e-3, "{pressed_n}");
    let friction = next.contact_world.force - normal * pressed_n;
    assert!(friction.length() > 0.01, "{friction}");
    let slides = stands.translation - skew_start(0.0).translation;
    assert!(friction.dot(slides) < 0.0, "{friction} {slides}");
    let center =
        crate::Tool { center_of_mass_tool: DVec3::new(1e-3, 2e-3, 3e-3), ..skew_scene(p).tool };
    let off_center = RenderScene { tool: center, ..skew_scene(p) };
    let mut state = State::new(&off_center);
    let output = tick(&off_center, &mut state, &TickInput::default());
    // The tool's own frame stands where the scene says, its axes' middle beside it.
    assert!((output.world_from_tool.translation - skew_start(0.0).translation).length() < 1e-12);
    let (_, indexed) = state.indexed(&off_center);
    assert!((indexed.translation - skew_start(0.0).translation).length() < 1e-12);
}

/// Deadman let go with the tool in the block by so much, and held again.
#[test]
fn a_tool_stays_where_the_deadman_left_it_unless_it_stands_in_an_obstacle() {
    for (raised_m, stays) in [(0.3e-3, true), (-0.4e-3, false)] {
        let mut p = generic();
        p.coupling.mode = CouplingMode::Direct;
        p.safety.deadman = Some(2);
        p.mapping.scale = 1.5;
        let mut rig = Rig::new(p);
        let [mut sample, ..] = samples();
        let back = p.mapping.world_from_device.rotation.conjugate();
        let mut run = |buttons: u32, moved: DVec3, n_ticks: u32| {
            let mut output = TickOutput::default();
            for _ in 0..n_ticks {
                sample.buttons = buttons;
                sample.sequence += 1;
                sample.pose.translation += back * moved / (1.5 * f64::from(n_ticks));
                output = rig.tick(sample);
            }
            output
        };
        let moved = skew_block().transform_vector(DVec3::new(2e-3, 1e-3, raised_m));
        assert_eq!(run(0b100, DVec3::ZERO, 3).drive, Drive::Enabled);
        run(0b100, moved, 10);
        let off = run(0, DVec3::ZERO, 20);
        assert_eq!((off.drive, off.off_cause), (Drive::Disabled, OffCause::Deadman));
        let again = run(0b100, DVec3::ZERO, 1);
        assert_eq!(again.drive, Drive::Enabled, "{again:?}");
        let expected = skew_start(0.0).translation + if stays { moved } else { DVec3::ZERO };
        let differs = again.world_from_tool.translation - expected;
        assert!(differs.length() < 1e-6, "{raised_m}: {differs}");
    }
}

/// A scene that takes the place of another goes on where the tool stood, if it has room there.
#[test]
fn a_tool_resumes_where_it_stood_unless_an_obstacle_of_the_new_scene_is_there() {
    for (raised_m, resumes) in [(2e-3, true), (-0.5e-3, false)] {
        let mut rig = Rig::new(generic());
        assert_eq!(rig.state.world_from_map(0), Some(skew_block()));
        assert_eq!(rig.state.world_from_map(1), None);
        let stood = skew_start(raised_m);
        rig.state.resume_at(&rig.scene, Some(stood), Handover { must_release: false });
        let [sample, ..] = samples();
        let tries = rig.tick(sample);
        assert_eq!((tries.drive, tries.contacts), (Drive::Disabled, 0));
        let output = rig.tick(sample);
        assert!(output.drive.renders(), "{output:?}");
        let (_, started) = rig.state.indexed(&rig.scene);
        let expected = if resumes { stood } else { skew_start(0.0) };
        assert!((started.translation - expected.translation).length() < 1e-12, "{raised_m}");
    }
}

/// The velocity of a component at rest is that of its steps, none.
#[test]
fn a_hand_at_rest_feels_no_damper_from_the_noise_of_its_velocity() {
    let mut p = generic();
    p.mapping.start = skew_start(0.1);
    p.gravity_m_per_s2 = DVec3::ZERO;
    p.arm.encoder_step_m = 4e-5;
    p.arm.encoder_step_rad = 1e-3;
    let mut rig = Rig::new(p);
    let [mut sample, ..] = samples();
    sample.twist = Twist { linear: DVec3::new(0.1, -0.2, 0.1), angular: DVec3::ONE };
    let mut output = TickOutput::default();
    for n in 0..600 {
        sample.sequence = 1 + n;
        output = rig.tick(sample);
        assert!(n != 50 || output.command_device.force.length() > 0.5, "{output:?}");
    }
    assert!(output.command_device.force.length() < 1e-6, "{output:?}");
}

/// What has to be paid of a spring is the part of it that the hand gets, while the force rises and
/// while energy is owed.
#[test]
fn a_spring_is_paid_by_the_share_of_it_that_is_felt() {
    let injected = 30.0;
    let mut scene = anchored(injected, Axes::SIX);
    scene.parameters.limits.ramp_s = 4e-3;
    let mut rig = Rig::of(scene);
    let [mut sample, ..] = samples();
    rig.tick(sample);
    let way = DVec3::new(1e-3, -2e-3, 0.5e-3);
    sample.pose.translation += way;
    let pulls = rig.tick(sample).command_device.force;
    // The spring draws the hand back by so much: that energy is owed.
    let back = way * -0.09;
    sample.pose.translation += back;
    let velocity = way * 500.0;
    sample.twist.linear = velocity;
    let output = rig.tick(sample);
    // All of the wrench up to half a millijoule, none of it at twice as much; the third of the
    // ramp's four ticks.
    let owed_j = pulls.dot(back);
    let share = 1.0 - (owed_j - 5e-4) / 5e-4;
    let gain = 0.75;
    assert!(share > 0.3 && share < 0.7, "{share}");
    let stretch = way * 0.91;
    let held_j = 0.5 * 1300.0 * 2.5 * stretch.length_squared() * share * gain;
    let takes_j = 1e-3 * injected * velocity.length_squared();
    let damps = (held_j - LENT_FREELY_J + owed_j) / takes_j;
    assert!(damps > 0.01 && damps < 1.0, "{damps}");
    let pull = stretch * (-1300.0 * 2.5 * share);
    let damper = velocity * -injected;
    // The hand is steadied by what the ramp still keeps from it.
    let expected = (pull + damper * damps) * gain + damper * (1.0 - gain);
    let differs = output.command_device.force - expected;
    assert!(differs.length() < 1e-3, "{:?}, expected {expected}", output.command_device);
}

/// K (T/2 + t_d + t_f) is what the arm can take, with the filter's lag t_f = T α/(1 − α).
#[test]
fn without_a_virtual_tool_the_lag_of_the_filter_counts_as_delay() {
    let mut p = generic();
    p.coupling.mode = CouplingMode::Direct;
    p.coupling.bound_nm_per_rad = f64::INFINITY;
    p.contact.friction = FrictionParameters::NONE;
    p.arm.stiffness_lag_n_s_per_m = 2.0;
    let mut rig = Rig::new(p);
    let [sample, ..] = samples();
    let output = rig.tick(DeviceSample { delay_ticks: 3, ..sample });
    let scene = &rig.scene;
    let found =
        ContactSum::flat(&scene.obstacles, &scene.tool.shell, skew_start(0.0), p.force_law());
    let alpha = (-core::f64::consts::TAU * 60.0 * 1e-3).exp();
    let bound_n_per_m = 2.0 / (3.5e-3 + 1e-3 * alpha / (1.0 - alpha));
    let mass = scene.tool.inertia.in_world(skew_start(0.0).rotation_matrix());
    let (along, _) = found.stiffness.positive_part(&mass).expect("finite").bounds();
    assert!(bound_n_per_m < 0.5 * along, "{bound_n_per_m} {along}");
    let share = output.command_device.force.length() / found.wrench.force.length();
    assert!((share / (bound_n_per_m / along) - 1.0).abs() < 1e-6, "{share}");
}

/// Of two steps of the encoder, between which a hand rests, one is followed.
#[test]
fn a_tool_does_not_go_back_and_forth_with_one_step_of_the_encoder() {
    let mut p = generic();
    p.mapping.start = skew_start(0.1);
    p.coupling.mode = CouplingMode::Direct;
    p.arm.encoder_step_m = 4e-5;
    let mut rig = Rig::new(p);
    let [mut sample, ..] = samples();
    let mut stood = DVec3::ZERO;
    let mut went_m = 0.0;
    for n in 0..300 {
        sample.sequence = 1 + n;
        sample.pose.translation.x += if n % 2 == 0 { 4e-5 } else { -4e-5 };
        let output = rig.tick(sample);
        assert!(output.drive.renders(), "{output:?}");
        let stands = output.world_from_tool.translation;
        went_m = (stands - stood).length();
        stood = stands;
    }
    assert!(went_m < 1e-12, "{went_m} m");
}

/// 2.9 voxels, less the quarter that an obstacle under way may always go.
#[test]
fn a_tool_without_mass_goes_less_far_in_a_tick_while_an_obstacle_is_under_way() {
    let block = skew_block();
    let out = block.transform_vector(DVec3::Z);
    let to = block.stepped(out * -0.1, DVec3::ZERO);
    let under_way = Some(Placement { obstacle_idx: 0, world_from_map: to });
    for (place, most_m) in [(None, 2.9e-3), (under_way, 2.65e-3)] {
        let mut p = generic();
        p.coupling.mode = CouplingMode::Direct;
        let mut rig = Rig::new(p);
        let [mut sample, ..] = samples();
        rig.tick_placing(sample, place);
        // Away from the face, by 50 mm in the world.
        let back = p.mapping.world_from_device.rotation.conjugate();
        sample.pose.translation += back * out * 20e-3;
        let output = rig.tick(sample);
        assert!(output.drive.renders(), "{output:?}");
        let went_m = (output.world_from_tool.translation - skew_start(0.0).translation).length();
        assert!((went_m - most_m).abs() < 1e-9, "{went_m} m");
    }
}
