//! Random scenes on the virtual clock, judged for what no scene that `check` accepts may do: give
//! the hand more energy than it took, go on moving in a hand that is still, burst out, leave the
//! limits.
//!
//! Every scene is made of a number, so that a bad one can be run again: `HAPTICD_SEARCH_SEED=17`
//! runs that one alone. `HAPTICD_SEARCH_RUNS=2000` searches for longer, `HAPTICD_SEARCH_FROM=1000`
//! begins elsewhere; from 1000 on scenes have any simulated arm and rate. `HAPTICD_SEARCH_CSV=FILE`
//! writes what every tick of the first of them measured and commanded.

use core::fmt::Write as _;
use std::fs;
use std::path::Path;
use std::time::Instant;

use arms::Device;
use arms::simulated::hand::{HandMapping, HandPath};
use arms::simulated::{HandParameters, SimArm, SimParameters};
use document::poses::TimedPose;
use glam::{DQuat, DVec3};
use hapticd::config::{self, SceneConfig};
use hapticd::daemon::prepare;
use haptics::{Drive, DriveRequest, Faults, State, TickInput, TickOutput, tick};
use rayon::prelude::*;
use vps::spatial::testing::Random;
use vps::spatial::{Pose, Wrench};

use super::rig;

/// How long the hand stays still at the end, s.
const STILL_S: f64 = 5.0;
/// How long after its last move nothing is expected of it yet, s.
const SETTLE_S: f64 = 1.5;
/// At the end, s: rest is judged here.
const REST_S: f64 = 0.5;

/// A scene, and what the hand does in it.
pub(crate) struct Scenario {
    pub(crate) seed: u64,
    pub(crate) what: String,
    pub(crate) config: SceneConfig,
    pub(crate) path: HandPath,
    pub(crate) end_s: f64,
}

/// What it came to.
#[derive(Clone, Debug)]
pub(crate) struct Verdict {
    pub(crate) seed: u64,
    pub(crate) what: String,
    pub(crate) mode: String,
    /// Lowest energy of the port by the true motion of the grip, J; and as the tick counted it.
    pub(crate) lowest_j: f64,
    pub(crate) counted_j: f64,
    /// Peak to peak of the command at the end, N and N·m.
    pub(crate) ripple_n: f64,
    pub(crate) ripple_nm: f64,
    /// Peak to peak of |F| from some time after the last move on, N.
    pub(crate) burst_n: f64,
    /// |F| of the command (axes without a motor as well) over |F| of the contact at the end; 1 where
    /// nothing touches.
    pub(crate) share: f64,
    pub(crate) faults: Faults,
    pub(crate) force_n: f64,
    /// The largest debt that is known to be left, J.
    pub(crate) most_owed_j: f64,
    /// The arm has damping of its own; the one for tests has none.
    pub(crate) is_damped: bool,
}

impl Verdict {
    pub(crate) fn is_still(&self) -> bool {
        self.ripple_n <= 1e-4 && self.ripple_nm <= 1e-5
    }

    /// What no scene may do.
    pub(crate) fn assert_good(&self) {
        let Self { seed, what, lowest_j, faults, most_owed_j, .. } = self;
        assert_eq!(*faults, Faults::NONE, "{seed}: {what}");
        assert!(*lowest_j >= -most_owed_j, "{seed} gives {} mJ: {what}", -lowest_j * 1e3);
        self.assert_rests();
    }

    fn assert_rests(&self) {
        let Self { seed, what, burst_n, ripple_n, ripple_nm, .. } = self;
        assert!(*burst_n <= 0.5, "{seed} moves by {burst_n} N in a still hand: {what}");
        assert!(
            *ripple_n <= 0.1 && *ripple_nm <= 5e-3,
            "{seed} trembles by {ripple_n} N, {ripple_nm} N·m: {what}"
        );
    }
}

pub(crate) struct Dice(Random);

impl Dice {
    /// The same for a number, and unlike those of its neighbours (SplitMix64).
    pub(crate) fn of(number: u64) -> Self {
        let mut mixed = (number + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        Self(Random(mixed ^ (mixed >> 31)))
    }

    pub(crate) fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * 0.5 * (self.0.signed() + 1.0)
    }

    /// By factors: as likely between 1 and 2 as between 10 and 20.
    pub(crate) fn scaled(&mut self, low: f64, high: f64) -> f64 {
        low * (high / low).powf(self.between(0.0, 1.0))
    }

    pub(crate) fn pick<V: Copy>(&mut self, of: &[V]) -> V {
        of[(self.between(0.0, of.len() as f64) as usize).min(of.len() - 1)]
    }

    pub(crate) fn direction(&mut self) -> DVec3 {
        DVec3::new(self.0.signed(), self.0.signed(), self.0.signed()).normalize_or(DVec3::X)
    }
}

/// Arms that give torque come up as often as the others.
const ARMS: [&str; 12] = [
    "sim-sigma7",
    "sim-lambda7",
    "sim-premium15-6dof",
    "sim-premium30-6dof",
    "sim-sigma7",
    "sim-premium15-6dof",
    "sim-omega6",
    "sim-touch",
    "sim-falcon",
    "sim-inverse3",
    "sim-polhem",
    "sim-woodenhaptics",
];

/// From this number on a scene has any arm and any rate.
const FROM_ANY_ARM: u64 = 1000;

/// A simulated arm, where its x axis points if not along the world's, and a rate.
pub(crate) struct AnyArm {
    pub(crate) profile: &'static str,
    pub(crate) axes: &'static str,
    pub(crate) rate_hz: u32,
}

impl AnyArm {
    pub(crate) fn of(dice: &mut Dice) -> Self {
        let simulated: Vec<&str> =
            arms::profile::names().filter(|name| name.starts_with("sim-")).collect();
        let profile = dice.pick(&simulated);
        // It moves in a plane: stood upright, so that it comes down.
        let axes = if profile == "sim-2diy" {
            "[device.world_from_device]\norientation_xyzw = [0.0, -0.7071067811865476, 0.0, 0.7071067811865476]\n"
        } else {
            ""
        };
        Self { profile, axes, rate_hz: dice.pick(&[500, 1000, 2000, 4000]) }
    }
}

/// Eight, in this order: with another number of them every seed is another scene.
pub(crate) const MODES: [&str; 8] = [
    "implicit",
    "implicit",
    "implicit",
    "implicit",
    "implicit",
    "implicit",
    "constraint",
    "direct",
];

/// Fixed parts, with the place above which the tool starts and the way into them.
pub(crate) fn parts(dice: &mut Dice, tool_mm: f64) -> (&'static str, String) {
    let plane = |name: &str, voxel_mm: f64, about_y: f64| {
        let half = 0.5 * about_y;
        format!(
            "[[static]]\nname = \"{name}\"\nshape = {{ plane_mm = [60.0, 60.0] }}\nvoxel_size_mm = \
                {voxel_mm:.2}\norientation_xyzw = [0.0, {:?}, 0.0, {:?}]\n",
            half.sin(),
            half.cos()
        )
    };
    let voxel_mm = dice.pick(&[0.3, 0.5, 0.5, 1.0]);
    match dice.pick(&[0, 0, 1, 1, 2, 3, 4]) {
        0 => ("plane", plane("floor", voxel_mm, 0.0)),
        1 => {
            let slope = dice.between(0.3, 0.9);
            ("groove", plane("a", voxel_mm, slope) + &plane("b", voxel_mm, -slope))
        }
        2 => {
            let gap_mm = 2.0 * tool_mm + dice.between(0.1, 1.0);
            let wall = |name: &str, side: f64| {
                format!(
                    "[[static]]\nname = \"{name}\"\nshape = {{ box_mm = [10.0, 40.0, 20.0] \
                        }}\nvoxel_size_mm = {voxel_mm:.2}\nposition_mm = [{:?}, 0.0, -10.0]\n",
                    side * (0.5 * gap_mm + 5.0)
                )
            };
            ("slot", wall("a", 1.0) + &wall("b", -1.0))
        }
        3 => {
            let radius_mm = dice.between(6.0, 20.0);
            let object = format!(
                "[[static]]\nname = \"ball\"\nshape = {{ sphere_mm = {radius_mm:.2} \
                    }}\nvoxel_size_mm = {voxel_mm:.2}\nposition_mm = [0.0, 0.0, {:.3}]\n",
                -radius_mm
            );
            ("ball", object)
        }
        _ => {
            let radius_mm = dice.between(6.0, 15.0);
            let object = format!(
                "[[static]]\nname = \"rod\"\nshape = {{ cylinder_mm = [{radius_mm:.2}, 50.0] \
                    }}\nvoxel_size_mm = {voxel_mm:.2}\nposition_mm = [0.0, 0.0, \
                    {:.3}]\norientation_xyzw = [0.7071067811865476, 0.0, 0.0, \
                    0.7071067811865476]\n",
                -radius_mm
            );
            ("rod", object)
        }
    }
}

fn scenario(seed: u64) -> Scenario {
    let mut dice = Dice(Random(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1));
    for _ in 0..8 {
        dice.0.signed();
    }
    if seed >= FROM_ANY_ARM {
        dice = Dice::of(seed);
    }
    let radius_mm = dice.between(3.0, 7.0);
    let (shape, tool_mm) = match dice.pick(&[0, 0, 1, 2]) {
        0 => {
            let edges = [1.2, 1.5, 1.0].map(|share| share * radius_mm);
            (
                format!("box_mm = [{:.2}, {:.2}, {:.2}]", edges[0], edges[1], edges[2]),
                DVec3::from_array(edges).length() * 0.5,
            )
        }
        1 => (format!("sphere_mm = {radius_mm:.2}"), radius_mm),
        _ => (format!("cylinder_mm = [{:.2}, {:.2}]", 0.6 * radius_mm, 1.5 * radius_mm), radius_mm),
    };
    let (place, statics) = parts(&mut dice, tool_mm);
    let mut arm = AnyArm { profile: dice.pick(&ARMS), axes: "", rate_hz: 1000 };
    if seed >= FROM_ANY_ARM {
        arm = AnyArm::of(&mut dice);
    }
    let AnyArm { profile, axes, rate_hz } = arm;
    let mode = dice.pick(&MODES);
    let friction = dice.pick(&[0.0, 0.0, 0.1, 0.2, 0.3, 0.6]);
    let hand = (dice.scaled(100.0, 2000.0), dice.scaled(1.0, 20.0), dice.scaled(50.0, 250.0));
    let contact =
        if mode == "direct" { None } else { dice.pick(&[None, Some(2.0), Some(8.0), Some(80.0)]) };
    let delay = dice.pick(&[None, None, None, Some(0), Some(2), Some(4)]);
    let softer = dice.pick(&[None, None, Some(0.6), Some(0.3)]);
    let action = dice.pick(&["tap", "tap", "hold", "hold", "slide", "twist"]);
    let turn = DQuat::from_axis_angle(
        dice.direction(),
        if place == "slot" { 0.0 } else { dice.between(0.0, 3.0) },
    );
    let [x, y, z, w] = turn.to_array();
    let start_mm = DVec3::Z * (tool_mm + 1.5);
    let text = |stiffness: Option<(f64, f64)>| {
        let mut text = format!(
            "version = 1\n[rendering]\nrate_hz = {rate_hz}\ncoupling = \"{mode}\"\n{statics}"
        );
        let _ = write!(
            text,
            "[tool]\nshape = {{ {shape} }}\nvoxel_size_mm = 0.5\nmass_g = 100.0\nstart_position_mm \
                = [0.0, 0.0, {:?}]\nstart_orientation_xyzw = [{x:?}, {y:?}, {z:?}, \
                {w:?}]\n[contact]\n",
            start_mm.z
        );
        if friction > 0.0 {
            let _ = writeln!(
                text,
                "friction = {{ static = {friction}, dynamic = {} }}",
                0.8 * friction
            );
        }
        if let Some(contact) = contact {
            let _ = writeln!(text, "stiffness_n_per_mm3 = {contact}");
        }
        if let Some((n_per_m, nm_per_rad)) = stiffness {
            let _ = writeln!(
                text,
                "[coupling]\ntranslation_n_per_mm = {:?}\nrotation_nm_per_rad = {nm_per_rad:?}",
                n_per_m * 1e-3
            );
        }
        let _ = writeln!(
            text,
            "[device]\nprofile = \"{profile}\"\n{axes}[device.sim]\nhand_stiffness_n_per_m = \
                {:?}\nhand_damping_n_s_per_m = {:?}\nhand_mass_g = {:?}",
            hand.0, hand.1, hand.2
        );
        if let Some(delay) = delay {
            let _ = writeln!(text, "delay_ticks = {delay}");
        }
        text
    };
    let mut config = rig::written(&text(None));
    if let Some(softer) = softer {
        let coupling = config.parameters.coupling;
        config = rig::written(&text(Some((
            softer * coupling.stiffness_n_per_m,
            softer * coupling.stiffness_nm_per_rad,
        ))));
    }

    let force_n = config.parameters.limits.force_n;
    // As far inside as the hand needs for a share of the arm's force, through the hand's own
    // spring.
    let depth_mm = ((dice.between(0.1, 0.8) * force_n / hand.0) * 1e3).min(25.0)
        + dice.between(0.2, 1.5)
        + 1.5;
    let speed_mm_per_s = dice.scaled(40.0, 400.0);
    let into =
        (DVec3::NEG_Z + dice.direction() * 0.4 * f64::from(u8::from(place != "slot"))).normalize();
    let mut poses =
        vec![TimedPose { line: 0, time_s: 0.0, pose: Pose::new(turn, start_mm * 1e-3) }];
    let go = |poses: &mut Vec<TimedPose>, to_mm: DVec3, turned: DQuat, least_s: f64| {
        let last = poses[poses.len() - 1];
        let way_mm = (to_mm * 1e-3 - last.pose.translation).length() * 1e3;
        let time_s = last.time_s + (way_mm / speed_mm_per_s).max(least_s);
        poses.push(TimedPose { line: 0, time_s, pose: Pose::new(turned, to_mm * 1e-3) });
    };
    go(&mut poses, start_mm, turn, 0.2);
    let deep_mm = start_mm + into * depth_mm;
    match action {
        "tap" => {
            for _ in 0..4 {
                go(&mut poses, deep_mm, turn, 0.0);
                go(&mut poses, start_mm, turn, 0.0);
                go(&mut poses, start_mm, turn, 0.05);
            }
            go(&mut poses, deep_mm, turn, 0.0);
        }
        "slide" => {
            go(&mut poses, deep_mm, turn, 0.0);
            let along =
                into.cross(dice.direction()).normalize_or(DVec3::X) * dice.between(1.0, 6.0);
            for side in [1.0, -1.0, 1.0, 0.0] {
                go(&mut poses, deep_mm + along * side, turn, 0.1);
            }
        }
        "twist" => {
            go(&mut poses, deep_mm, turn, 0.0);
            let about = dice.direction() * dice.between(0.05, 0.4);
            for side in [1.0, -1.0, 1.0, 0.0] {
                go(&mut poses, deep_mm, DQuat::from_scaled_axis(about * side) * turn, 0.25);
            }
        }
        _ => go(&mut poses, deep_mm, turn, 0.0),
    }
    let end_s = poses[poses.len() - 1].time_s;
    let path = HandPath::from_poses(&poses, Path::new("search.csv"))
        .unwrap_or_else(|error| panic!("{seed}: {error}"));
    let what = format!(
        "{mode} {profile} {rate_hz} Hz {place} {shape} {action} {speed_mm_per_s:.0} mm/s, mu {friction}, hand {:.0} \
            N/m {:.1} N.s/m {:.0} g, contact {contact:?}, delay {delay:?}, softer {softer:?}, \
            {:.0} N/m",
        hand.0, hand.1, hand.2, config.parameters.coupling.stiffness_n_per_m
    );
    Scenario { seed, what, config, path, end_s }
}

/// Half a millijoule is free, and the damper that pays the rest acts on a velocity that is late: 1
/// mJ. At four ticks of delay it is that much later. Where `check` says that the arm takes too
/// little damping, the force is weakened after the fact.
fn most_owed_j(config: &SceneConfig) -> f64 {
    if config::plausibility_warnings(config)
        .iter()
        .any(|doubt| doubt.to_string().contains("to give no energy"))
    {
        2.5e-3
    } else if config.device.sim.delay_ticks >= Some(4) {
        1.5e-3
    } else {
        1e-3
    }
}

/// A line for every tick: what was measured, where the tool stands, what it touches and what the
/// arm is sent.
struct Trace(String);

impl Trace {
    const COLUMNS: &str = "tick,x_m,y_m,z_m,rx_rad,ry_rad,rz_rad,tool_x_m,tool_y_m,tool_z_m,tool_rx_rad,tool_ry_rad,tool_rz_rad,\
                           contact_x_n,contact_y_n,contact_z_n,fx_n,fy_n,fz_n,tx_nm,ty_nm,tz_nm,contacts,depth_m";

    fn add(&mut self, tick: usize, measured: Pose, output: &TickOutput) {
        let turn = |pose: Pose| Pose::IDENTITY.rotation_to(pose);
        let tool = output.world_from_tool;
        let command = output.command_device;
        let vectors = [
            measured.translation,
            turn(measured),
            tool.translation,
            turn(tool),
            output.contact_world.force,
        ];
        let _ = write!(self.0, "\n{tick}");
        for value in vectors
            .into_iter()
            .chain([command.force, command.torque])
            .flat_map(|vector| vector.to_array())
        {
            let _ = write!(self.0, ",{value:e}");
        }
        let _ = write!(self.0, ",{},{:e}", output.contacts, output.max_depth_m);
    }
}

/// Where it is asked for.
pub(crate) fn write_trace(scenario: &Scenario) {
    let Some(path) = std::env::var_os("HAPTICD_SEARCH_CSV") else { return };
    let mut trace = Trace(Trace::COLUMNS.to_owned());
    judge_watched(scenario, |n, measured, output| trace.add(n, measured, output));
    fs::write(&path, trace.0).expect("HAPTICD_SEARCH_CSV can be written");
}

fn judge(scenario: &Scenario) -> Verdict {
    judge_watched(scenario, |_, _, _| ())
}

/// `watch` gets every tick: its number, what was measured, what came of it.
pub(crate) fn judge_watched(
    scenario: &Scenario,
    mut watch: impl FnMut(usize, Pose, &TickOutput),
) -> Verdict {
    let Scenario { config, path, end_s, .. } = scenario;
    let period_s = config.parameters.period_s;
    let (prepared, _) =
        prepare(config, |_| ()).unwrap_or_else(|error| panic!("{}: {error}", scenario.seed));
    let scene = prepared.scene;
    let mut profile = config.device.profile.clone();
    profile.plant.delay_ticks = config.device.sim.delay_ticks.unwrap_or(profile.plant.delay_ticks);
    let mapping = &config.parameters.mapping;
    let sim = &config.device.sim;
    let hand_mapping = HandMapping {
        world_from_device: mapping.world_from_device,
        scale: mapping.scale,
        start: mapping.start,
        grip_tool: scene.tool.center_of_mass_tool,
    };
    let hand = HandParameters {
        stiffness_n_per_m: sim.hand_stiffness_n_per_m,
        damping_n_s_per_m: sim.hand_damping_n_s_per_m,
        mass_kg: sim.hand_mass_kg,
        path: Some(path.to_device(hand_mapping)),
        ..HandParameters::default()
    };
    let mut arm = SimArm::new(SimParameters::of(&profile, Some(hand), period_s))
        .expect("a hand that the plant can follow");
    let mut state = State::new(&scene);
    let delay = profile.plant.delay_ticks as usize;
    let mut held = vec![Wrench::ZERO; delay + 1];
    let n_ticks = ((end_s + STILL_S) / period_s) as usize;
    let from_settled = ((end_s + SETTLE_S) / period_s) as usize;
    let from_rest = n_ticks - (REST_S / period_s) as usize;
    let mut energy_j = 0.0_f64;
    let mut lowest_j = 0.0_f64;
    let mut counted_j = 0.0_f64;
    let mut faults = Faults::NONE;
    let mut low = [DVec3::INFINITY; 2];
    let mut high = [DVec3::NEG_INFINITY; 2];
    let mut least_n = f64::INFINITY;
    let mut most_n = 0.0_f64;
    let mut share = 1.0;
    let mut force_n = 0.0_f64;
    let mut before = arm.true_pose();
    for n in 0..n_ticks {
        let sample = arm.read().expect("a sample");
        let now = arm.true_pose();
        // What acted since the last sample was written `delay` ticks before the newest command.
        let acted = held[(n + 2 * (delay + 1) - 1 - delay) % (delay + 1)];
        energy_j -= acted.force.dot(now.translation - before.translation)
            + acted.torque.dot(before.rotation_to(now));
        lowest_j = lowest_j.min(energy_j);
        before = now;
        let output = tick(
            &scene,
            &mut state,
            &TickInput { sample, request: DriveRequest::Enable, ..TickInput::default() },
        );
        watch(n, sample.pose, &output);
        held[n % (delay + 1)] = arm.write(&output.command_device).expect("a finite command");
        counted_j = counted_j.min(output.energy_j);
        faults |= output.faults;
        let command = output.command_device;
        force_n = force_n.max(command.force.length());
        let limits = config.parameters.limits;
        assert!(
            command.force.length() <= limits.force_n * (1.0 + 1e-12),
            "{}: {}",
            scenario.seed,
            scenario.what
        );
        assert!(
            command.torque.length() <= limits.torque_nm * (1.0 + 1e-12),
            "{}: {}",
            scenario.seed,
            scenario.what
        );
        if n >= from_settled {
            (least_n, most_n) =
                (least_n.min(command.force.length()), most_n.max(command.force.length()));
        }
        if n >= from_rest {
            for (part, value) in [command.force, command.torque].into_iter().enumerate() {
                (low[part], high[part]) = (low[part].min(value), high[part].max(value));
            }
        }
        if n + 1 == n_ticks {
            // A hand that has left the workspace waits at a gate.
            assert!(
                matches!(output.drive, Drive::Enabled | Drive::Enabling) || !faults.is_empty(),
                "{}: {output:?}",
                scenario.seed
            );
            let contact_n = output.contact_world.force.length();
            share = if contact_n > 0.05 {
                output.commanded_device.force.length() / contact_n
            } else {
                1.0
            };
        }
    }
    Verdict {
        seed: scenario.seed,
        what: scenario.what.clone(),
        mode: format!("{:?}", config.parameters.coupling.mode),
        lowest_j,
        counted_j,
        ripple_n: (high[0] - low[0]).max_element(),
        ripple_nm: (high[1] - low[1]).max_element(),
        burst_n: most_n - least_n,
        share,
        faults,
        force_n,
        most_owed_j: most_owed_j(config),
        is_damped: profile.plant.damping_n_s_per_m > 0.0,
    }
}

/// What is counted, and whether a run is one of it.
pub(crate) type Kind<Run> = (&'static str, fn(&Run) -> bool);

/// How many there are of each kind, and which: a row of the table in `docs/reference/measured.md`.
pub(crate) fn count<Run>(runs: &[Run], seed: fn(&Run) -> u64, kinds: &[Kind<Run>]) {
    for (name, is) in kinds {
        let seeds: Vec<u64> = runs.iter().filter(|run| is(run)).map(seed).collect();
        eprintln!("  {name}: {} of {}, {seeds:?}", seeds.len(), runs.len());
    }
}

pub(crate) const BAD: [Kind<Verdict>; 7] = [
    ("energy < -1 mJ", |v| v.lowest_j < -1e-3),
    ("ripple at rest > 20 mN or 2 mN m", |v| v.ripple_n > 0.02 || v.ripple_nm > 2e-3),
    ("not still to 0.1 mN and 0.01 mN m", |v| !v.is_still()),
    ("outburst > 0.5 N", |v| v.burst_n > 0.5),
    ("share not 0.95 to 1.05", |v| v.mode == "Implicit" && (v.share - 1.0).abs() > 0.05),
    ("faults", |v| !v.faults.is_empty()),
    ("of the arm without damping, for tests", |v| !v.is_damped),
];

/// The worst ten by a number, with how many are above a bound.
fn tell(verdicts: &[Verdict], name: &str, of: impl Fn(&Verdict) -> f64, bound: f64) -> usize {
    let mut sorted: Vec<&Verdict> = verdicts.iter().collect();
    sorted.sort_by(|a, b| of(b).total_cmp(&of(a)));
    let n_beyond = verdicts.iter().filter(|verdict| of(verdict) > bound).count();
    eprintln!("{name}: {n_beyond} of {} above {bound}", verdicts.len());
    for verdict in sorted.iter().take(10) {
        let Verdict { seed, what, share, faults, force_n, counted_j, .. } = verdict;
        eprintln!(
            "  {:.5}  seed {seed}: {what}; share {share:.2}, largest {force_n:.2} N, counted {:.3} mJ, {faults:?}",
            of(verdict),
            counted_j * 1e3
        );
    }
    n_beyond
}

fn from_environment(name: &str) -> Option<u64> {
    std::env::var(name)
        .ok()
        .map(|value| value.parse().unwrap_or_else(|_| panic!("{name} is not a number: {value}")))
}

/// The seed that is asked for, or as many from the first on as the variable says.
pub(crate) fn numbers(runs: &str, usual: u64) -> core::ops::Range<u64> {
    let (from, runs) = match from_environment("HAPTICD_SEARCH_SEED") {
        Some(seed) => (seed, 1),
        None => (
            from_environment("HAPTICD_SEARCH_FROM").unwrap_or(0),
            from_environment(runs).unwrap_or(usual),
        ),
    };
    from..from + runs
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn no_random_scene_gives_energy_trembles_or_bursts() {
    let seeds = numbers("HAPTICD_SEARCH_RUNS", 200);
    write_trace(&scenario(seeds.start));
    let begun = Instant::now();
    let mut verdicts: Vec<Verdict> =
        seeds.into_par_iter().map(|seed| judge(&scenario(seed))).collect();
    eprintln!("{} scenes in {:.1} s", verdicts.len(), begun.elapsed().as_secs_f64());
    count(&verdicts, |verdict| verdict.seed, &BAD);
    for mode in ["Implicit", "Constraint", "Direct"] {
        let of: Vec<&Verdict> = verdicts.iter().filter(|verdict| verdict.mode == mode).collect();
        let count = |is: &dyn Fn(&Verdict) -> bool| of.iter().filter(|verdict| is(verdict)).count();
        eprintln!(
            "{mode}: {} scenes; energy < -1 mJ {}; still to 0.1 mN and 0.01 mN m {}; above 20 mN \
                or 2 mN m {}; bursts > 0.5 N {}; share < 0.7 {}; faults {}",
            of.len(),
            count(&|v| v.lowest_j < -1e-3),
            count(&|v| v.is_still()),
            count(&|v| v.ripple_n > 0.02 || v.ripple_nm > 2e-3),
            count(&|v| v.burst_n > 0.5),
            count(&|v| v.share < 0.7),
            count(&|v| !v.faults.is_empty()),
        );
    }
    // `direct` divides its force by its stiffness, on purpose.
    let coupled: Vec<Verdict> =
        verdicts.iter().filter(|verdict| verdict.mode != "Direct").cloned().collect();
    tell(&verdicts, "energy given beyond what was taken, mJ", |v| -v.lowest_j * 1e3, 1.0);
    tell(&verdicts, "force at rest, peak to peak, mN", |v| v.ripple_n * 1e3, 0.1);
    tell(&verdicts, "torque at rest, peak to peak, mN m", |v| v.ripple_nm * 1e3, 0.01);
    tell(&verdicts, "change of |F| in a still hand, N", |v| v.burst_n, 0.5);
    tell(&coupled, "force kept back at the end", |v| 1.0 - v.share, 0.3);
    verdicts.retain(|verdict| verdict.is_damped);
    for verdict in &verdicts {
        // Slow loops with four ticks of delay give more in a hard landing: see the known limits.
        if verdict.seed < FROM_ANY_ARM {
            verdict.assert_good();
        } else {
            verdict.assert_rests();
        }
    }
    let moving: Vec<u64> =
        verdicts.iter().filter(|verdict| !verdict.is_still()).map(|verdict| verdict.seed).collect();
    assert!(moving.is_empty(), "not still: {moving:?}");
}

/// The worst scenes that the search has found, each for what it did: energy in taps (36, 60, 193),
/// also of a tool that lagged in free space (108), tremble of the wrist (83), a burst (30).
#[test]
fn the_worst_scenes_that_were_found_stay_good() {
    for seed in [30, 36, 60, 83, 108, 193] {
        let verdict = judge(&scenario(seed));
        eprintln!("{verdict:?}");
        verdict.assert_good();
        assert!(verdict.share > 0.7, "{seed} keeps force back: {verdict:?}");
    }
}

/// A hand that goes along a path of lines (s, mm) without turning.
pub(crate) fn hand(turn: DQuat, knots: &[(f64, DVec3)]) -> HandPath {
    let pose = |(time_s, at_mm): &(f64, DVec3)| TimedPose {
        line: 0,
        time_s: *time_s,
        pose: Pose::new(turn, *at_mm * 1e-3),
    };
    let poses: Vec<TimedPose> = knots.iter().map(pose).collect();
    HandPath::from_poses(&poses, Path::new("hand.csv")).expect("a path")
}

/// Found by an independent program in version 0.1.0: the wrist trembles by one encoder step, and
/// after seven seconds of a hand that stands still the force went from 0.07 to 11.7 N and back, 18
/// times a second.
#[test]
fn a_box_in_a_groove_rests_for_good_in_a_hand_that_stands_still() {
    let plane = |name: &str, y: f64| {
        format!(
            "[[static]]\nname = \"{name}\"\nshape = {{ plane_mm = [80.0, 80.0] }}\nvoxel_size_mm = \
                0.3\norientation_xyzw = [0.0, {y:?}, 0.0, 0.9483668389316362]\n"
        )
    };
    let turn = [-0.2959424907447386, 0.12013494055737553, -0.839634404196564, -0.43931731757379705];
    let text = format!(
        "version = 1\n{}{}[tool]\nshape = {{ box_mm = [10.0, 12.0, 8.0] }}\nvoxel_size_mm = \
            0.5\nstart_position_mm = [0.0, 0.0, 26.0]\nstart_orientation_xyzw = \
            {turn:?}\n[contact]\nfriction = {{ static = 0.3, dynamic = 0.24 }}\n[device]\nprofile \
            = \"sim-sigma7\"\n",
        plane("a", 0.31717556465594254),
        plane("b", -0.31717556465594254)
    );
    let start_mm = DVec3::Z * 26.0;
    let deep_mm = DVec3::new(0.578228396889, -0.275561968736, -2.89134555197);
    let path = hand(
        DQuat::from_array(turn).normalize(),
        &[(0.0, start_mm), (0.15, start_mm), (0.55, deep_mm), (7.0, deep_mm)],
    );
    let scenario = Scenario {
        seed: 0,
        what: "a box in a groove".to_owned(),
        config: rig::written(&text),
        path,
        end_s: 7.0,
    };
    let verdict = judge(&scenario);
    verdict.assert_good();
    assert!(
        verdict.is_still()
            && verdict.burst_n < 1e-3
            && verdict.share > 0.95
            && verdict.lowest_j > -1e-4,
        "{verdict:?}"
    );
}
