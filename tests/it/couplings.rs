//! Every coupling in every situation: free, resting on a plane, pressed into a corner, a peg in its
//! hole; three arms, two hands, more and less delay. Nothing may shake itself up, sink in or leave
//! the limits.

use std::path::Path;

use arms::Device;
use arms::profile::Plant;
use arms::simulated::hand::{GripPath, HandPath};
use arms::simulated::{HandParameters, SimArm, SimParameters};
use document::poses::TimedPose;
use glam::DVec3;
use hapticd::config::SceneConfig;
use hapticd::daemon::prepare;
use haptics::filter::low_pass_alpha;
use haptics::stability::SampledWall;
use haptics::{
    ArmParameters, CouplingMode, DriveRequest, Faults, FilterParameters, RenderScene, State,
    TickInput, tick,
};
use vps::spatial::{Axes, Pose, Wrench};

use super::rest::{self, ARMS, HANDS, MORE_DELAY, Outcome, Still, T};
use super::rig;

/// When the hand has come to its last pose, s.
const HAND_S: f64 = 0.5;
const N_TICKS: usize = 1500;
/// The ticks at the end in which everything has to be at rest.
const N_REST: usize = 300;

const MODES: [&str; 3] = ["implicit", "constraint", "direct"];

/// Static objects and tool of a situation, and where the hand wants the tool to end.
struct Situation {
    name: &'static str,
    statics: &'static str,
    tool: &'static str,
    start_mm: DVec3,
    end_mm: DVec3,
    /// Rotation vector of the last pose, rad.
    turn: DVec3,
}

const FLOOR: &str =
    "[[static]]\nname = \"floor\"\nshape = { plane_mm = [40, 40] }\nvoxel_size_mm = 0.5\n";
const CUBE: &str = "shape = { box_mm = [10, 10, 10] }\nvoxel_size_mm = 1.0\n";

const SITUATIONS: [Situation; 4] = [
    Situation {
        name: "free",
        statics: FLOOR,
        tool: CUBE,
        start_mm: DVec3::new(0.0, 0.0, 15.0),
        end_mm: DVec3::new(5.0, -3.0, 18.0),
        turn: DVec3::new(0.1, 0.2, -0.1),
    },
    Situation {
        name: "plane",
        statics: FLOOR,
        tool: CUBE,
        start_mm: DVec3::new(0.0, 0.0, 7.0),
        end_mm: DVec3::new(3.0, 1.0, 3.5),
        turn: DVec3::ZERO,
    },
    Situation {
        name: "corner",
        statics: "[[static]]\nname = \"floor\"\nshape = { plane_mm = [40, 40] }\nvoxel_size_mm = \
            0.5\n[[static]]\nname = \"wall x\"\nshape = { box_mm = [6, 30, 12] }\nvoxel_size_mm = \
            0.5\nposition_mm = [9, 0, 6]\n[[static]]\nname = \"wall y\"\nshape = { box_mm = [30, \
            6, 12] }\nvoxel_size_mm = 0.5\nposition_mm = [0, 9, 6]\n",
        tool: CUBE,
        start_mm: DVec3::new(-1.0, -1.5, 7.0),
        end_mm: DVec3::new(2.0, 2.5, 3.5),
        turn: DVec3::new(0.03, 0.02, 0.08),
    },
    Situation {
        name: "peg",
        statics: "[[static]]\nname = \"floor\"\nshape = { plane_mm = [40, 40] }\nvoxel_size_mm = \
            0.5\n[[static]]\nname = \"+x\"\nshape = { box_mm = [6, 22, 12] }\nvoxel_size_mm = \
            0.4\nposition_mm = [8.1, 0, 6]\n[[static]]\nname = \"-x\"\nshape = { box_mm = [6, 22, \
            12] }\nvoxel_size_mm = 0.4\nposition_mm = [-8.1, 0, 6]\n[[static]]\nname = \
            \"+y\"\nshape = { box_mm = [22, 6, 12] }\nvoxel_size_mm = 0.4\nposition_mm = [0, 8.1, \
            6]\n[[static]]\nname = \"-y\"\nshape = { box_mm = [22, 6, 12] }\nvoxel_size_mm = \
            0.4\nposition_mm = [0, -8.1, 6]\n",
        tool: "shape = { box_mm = [10, 10, 20] }\nvoxel_size_mm = 1.0\n",
        start_mm: DVec3::new(0.0, 0.0, 16.0),
        end_mm: DVec3::new(0.6, -0.4, 8.8),
        turn: DVec3::new(0.02, 0.0, 0.03),
    },
];

impl Situation {
    fn config(
        &self,
        mode: &str,
        profile: &str,
        hand: [f64; 3],
        delay_ticks: u32,
        more: &str,
    ) -> SceneConfig {
        let [stiffness, damping, mass_g] = hand;
        let start = self.start_mm;
        rig::written(&format!(
            "version = 1\n[rendering]\ncoupling = \"{mode}\"\n{statics}[tool]\n{tool}mass_g = \
                100\nstart_position_mm = [{}, {}, {}]\n[device]\nprofile = \
                \"{profile}\"\n[device.sim]\nhand_stiffness_n_per_m = \
                {stiffness}\nhand_damping_n_s_per_m = {damping}\nhand_mass_g = \
                {mass_g}\ndelay_ticks = {delay_ticks}\n{more}",
            start.x,
            start.y,
            start.z,
            statics = self.statics,
            tool = self.tool,
        ))
    }

    fn bake(&self) -> RenderScene {
        prepare(&self.config("implicit", "sim-sigma7", HANDS[0].1, 1, ""), |_| ())
            .expect("prepared")
            .0
            .scene
    }

    /// The hand's path: smooth from the start to the end, as timed poses.
    fn path(&self) -> HandPath {
        let poses: Vec<TimedPose> = (0..=50)
            .map(|n| {
                let share = f64::from(n) / 50.0;
                let smooth = share * share * (3.0 - 2.0 * share);
                let position = self.start_mm.lerp(self.end_mm, smooth) * 1e-3;
                let pose = Pose::new(glam::DQuat::from_scaled_axis(self.turn * smooth), position);
                TimedPose { time_s: 0.1 + (HAND_S - 0.1) * share, pose, line: n as usize + 1 }
            })
            .collect();
        HandPath::from_poses(&poses, Path::new("hand")).expect("increasing times")
    }
}

/// Runs all of a situation and holds every run against what a coupling promises at rest.
fn comes_to_rest(situation: &Situation) {
    comes_to_rest_with(situation, &MODES, "");
}

/// The same in some couplings, with more keys.
fn comes_to_rest_with(situation: &Situation, modes: &[&str], more: &str) {
    let mut scene = situation.bake();
    let mut n_damped = 0;
    for mode in modes {
        for profile in ARMS {
            for (hand_name, hand) in HANDS {
                for more_delay in MORE_DELAY {
                    let config = situation.config(mode, profile, hand, 1 + more_delay, more);
                    let outcome =
                        rest::play(&mut scene, &config, &situation.path(), N_TICKS, N_REST);
                    let what = format!(
                        "{:6} {mode:13} {profile:18} {hand_name} +{more_delay}",
                        situation.name
                    );
                    eprintln!("{what}: {outcome}");
                    outcome.assert_at_rest(&what, situation, &config, hand_name == "loose");
                    n_damped += outcome.damped_ticks;
                }
            }
        }
    }
    eprintln!("{}: {n_damped} ticks damped", situation.name);
}

impl Outcome {
    fn assert_at_rest(
        &self,
        what: &str,
        situation: &Situation,
        config: &SceneConfig,
        is_loose: bool,
    ) {
        let coupling = &config.parameters.coupling;
        self.assert_still(what, &Still::on(config));
        if situation.name == "free" {
            assert!(
                self.last.contacts == 0 && self.force_n == 0.0 && self.damped_ticks == 0,
                "{what}: {self}"
            );
            return;
        }
        assert!(self.last.contacts > 0 && self.rest_force_n > 0.01, "{what} let go: {self}");
        // A loose hand bounces first, and what is owed when contact is left stays owed.
        assert!(
            is_loose || self.last.energy_j > 0.0,
            "{what}: a hand that leans on a spring has put energy into it: {self}"
        );
        // What is published of the contact is what the hand feels of it; `direct` makes it softer.
        let published = self.last.contact_world;
        let felt = self.last.commanded_device;
        assert!(
            coupling.mode == CouplingMode::Direct
                || (published.force - felt.force).length() < 0.02 + 0.02 * felt.force.length(),
            "{what}: contact {published:?}, felt {felt:?}"
        );
        let voxel_m = 5e-4;
        match coupling.mode {
            // Never sinks in, however hard it is pressed: a tenth of a voxel, and a voxel's half
            // for one tick on the way.
            CouplingMode::Constraint => {
                assert!(
                    self.rest_depth_m < 0.12 * voxel_m && self.deepest_m < 0.5 * voxel_m,
                    "{what} sinks in: {self}"
                );
            }
            CouplingMode::Direct => {}
            _ => assert!(self.deepest_m < voxel_m, "{what} sinks in: {self}"),
        }
    }
}

#[test]
fn every_coupling_is_nothing_in_free_space() {
    comes_to_rest(&SITUATIONS[0]);
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn every_coupling_comes_to_rest_on_a_plane() {
    comes_to_rest(&SITUATIONS[1]);
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn every_coupling_comes_to_rest_in_a_corner() {
    comes_to_rest(&SITUATIONS[2]);
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn every_coupling_comes_to_rest_with_a_peg_in_its_hole() {
    comes_to_rest(&SITUATIONS[3]);
}

/// Dampers act on the virtual tool; what the arm feels stays as passive as it was.
#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn with_dampers_everything_comes_to_rest_as_well() {
    for situation in &SITUATIONS {
        comes_to_rest_with(situation, &["implicit"], "[contact]\ndamping_n_s_per_m = 20\n");
    }
}

/// A brake holds the tool back before anything is felt, so the spring is stretched when contact
/// begins; with "drag" the hand has done that work. The peg is left out: in a gap narrower than a
/// voxel everything is just ahead of contact, and it takes longer to go in than this test lasts.
#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn with_brakes_everything_comes_to_rest_as_well() {
    for situation in &SITUATIONS[1..3] {
        comes_to_rest_with(
            situation,
            &["implicit"],
            "[contact]\nbraking = true\n[coupling]\nfree_space = \"drag\"\n",
        );
    }
}

/// One axis of an arm without friction or encoder steps on the floor, pressed by a soft hand: what
/// the stability rules are about. The delay of `extra_ticks` lies between servo and arm; `reported`
/// says whether samples tell of it.
fn shaken_m(
    scene: &mut RenderScene,
    mode: CouplingMode,
    stiffness: f64,
    cutoff_hz: f64,
    extra_ticks: u32,
    reported: bool,
) -> f64 {
    const MASS_KG: f64 = 0.1;
    const B: f64 = 1.5;
    const HAND_N_PER_M: f64 = 40.0;
    let config =
        SITUATIONS[1].config("implicit", "sim-premium15-6dof", [HAND_N_PER_M, 0.0, 0.0], 0, "");
    let p = &mut scene.parameters;
    *p = config.parameters;
    p.coupling.mode = mode;
    (p.coupling.stiffness_n_per_m, p.coupling.bound_n_per_m) = (stiffness, stiffness);
    // In `direct` the wall is the stiffness asked for, from the first micrometre; elsewhere the
    // contact is that of any scene.
    let direct = mode == CouplingMode::Direct;
    p.contact.stiffness_n_per_m = if direct { 1e5 } else { 5e3 };
    p.filter = FilterParameters { cutoff_hz: [cutoff_hz; 2] };
    (p.limits.slew_n_per_s, p.limits.power_w) = (f64::INFINITY, f64::INFINITY);
    (p.mapping.sensed, p.mapping.actuated) = (Axes::TRANSLATION, Axes::TRANSLATION);
    p.arm = ArmParameters { stiffness_lag_n_s_per_m: 0.8 * B, ..ArmParameters::default() };
    // It lands slowly, 2 mm below, and then leans on: what is asked is whether contact stays, not
    // how a light arm bounces.
    let leaning = |time_s: f64, z_m: f64| TimedPose {
        time_s,
        pose: Pose::from_translation(DVec3::Z * z_m),
        line: 1,
    };
    let path =
        [leaning(0.0, 0.0), leaning(0.5, -1.9e-3), leaning(1.5, -2.3e-3), leaning(3.0, -1.2e-2)];
    let down = HandPath::from_poses(&path, Path::new("hand")).expect("increasing times");
    let mut arm = SimArm::new(SimParameters {
        plant: Plant {
            mass_kg: MASS_KG,
            damping_n_s_per_m: B,
            delay_ticks: extra_ticks,
            ..SimParameters::ideal(T).plant
        },
        hand: Some(HandParameters {
            stiffness_n_per_m: HAND_N_PER_M,
            damping_n_s_per_m: 0.0,
            mass_kg: 0.0,
            path: Some(GripPath::in_device_frame(down)),
            ..HandParameters::default()
        }),
        sensed: Axes::TRANSLATION,
        actuated: Axes::TRANSLATION,
        ..SimParameters::ideal(T)
    })
    .expect("an arm");
    let mut state = State::new(scene);
    let mut low = f64::INFINITY;
    let mut high = f64::NEG_INFINITY;
    for n in 0..6000 {
        let mut sample = arm.read().expect("a sample");
        assert_eq!(sample.delay_ticks, extra_ticks, "the arm measures its own delay");
        if !reported {
            sample.delay_ticks = 0;
        }
        let output = tick(
            scene,
            &mut state,
            &TickInput { sample, request: DriveRequest::Enable, ..TickInput::default() },
        );
        assert_eq!(output.faults, Faults::NONE);
        arm.write(&output.command_device).expect("a command");
        if n >= 5500 {
            let z_m = arm.true_pose().translation.z;
            (low, high) = (low.min(z_m), high.max(z_m));
        }
    }
    high - low
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn acceptance_22_the_automatic_limit_keeps_a_delayed_loop_stable() {
    let situation = &SITUATIONS[1];
    let mut scene = situation.bake();
    for mode in [CouplingMode::Direct, CouplingMode::Constraint, CouplingMode::Implicit] {
        for cutoff_hz in [f64::INFINITY, 100.0] {
            // The filter lies in the arm's loop in `direct` only.
            if cutoff_hz.is_finite() && mode != CouplingMode::Direct {
                continue;
            }
            for extra_ticks in [1, 2, 5] {
                let wall = SampledWall {
                    mass_kg: 0.1,
                    damping_n_s_per_m: 1.5,
                    wall_damping_n_s_per_m: 0.0,
                    period_s: T,
                    delay_ticks: extra_ticks,
                    filter_alpha: low_pass_alpha(cutoff_hz, T),
                };
                // Half above what the delayed arm can take, and fine without the delay.
                let stiffness = 1.5 * wall.max_stiffness();
                let unaware_m =
                    shaken_m(&mut scene, mode, stiffness, cutoff_hz, extra_ticks, false);
                let limited_m = shaken_m(&mut scene, mode, stiffness, cutoff_hz, extra_ticks, true);
                let what =
                    format!("{mode:?}, {cutoff_hz} Hz, {extra_ticks} ticks, {stiffness:.0} N/m");
                eprintln!(
                    "{what}: without the limit {:.3} mm, with it {:.6} mm",
                    unaware_m * 1e3,
                    limited_m * 1e3
                );
                assert!(unaware_m > 1e-4, "{what}: moves by {unaware_m} m without the limit");
                assert!(limited_m < 1e-5, "{what}: moves by {limited_m} m with it");
            }
        }
    }
}

/// Stretch of a free simulated arm on a sampled spring, 50 µm at first: the largest of the last
/// quarter over that of the second.
fn growth(delay_ticks: u32, stiffness_n_per_m: f64) -> f64 {
    let plant = Plant {
        mass_kg: 0.3,
        damping_n_s_per_m: 7.5,
        delay_ticks,
        ..SimParameters::ideal(T).plant
    };
    let parameters = SimParameters {
        plant,
        hand: None,
        force_limit_n: 1e9,
        watchdog_ms: None,
        ..SimParameters::ideal(T)
    };
    let mut arm = SimArm::new(parameters).expect("an arm");
    let n_ticks = 4000;
    let mut largest = [0.0_f64; 4];
    for n in 0..n_ticks {
        let stretch_m = arm.read().expect("a sample").pose.translation.x - 5e-5;
        largest[n * 4 / n_ticks] = largest[n * 4 / n_ticks].max(stretch_m.abs());
        arm.write(&Wrench::new(DVec3::X * (-stiffness_n_per_m * stretch_m), DVec3::ZERO))
            .expect("finite");
    }
    largest[3] / largest[1]
}

#[test]
fn a_simulated_arm_is_stable_up_to_the_exact_boundary_of_the_rule() {
    for delay_ticks in 0..4 {
        let wall = SampledWall {
            mass_kg: 0.3,
            damping_n_s_per_m: 7.5,
            wall_damping_n_s_per_m: 0.0,
            period_s: T,
            delay_ticks,
            filter_alpha: 0.0,
        };
        let exact = wall.max_stiffness();
        let mut stable = 0.5 * exact;
        let mut unstable = 2.0 * exact;
        for _ in 0..20 {
            let middle = 0.5 * (stable + unstable);
            if growth(delay_ticks, middle) < 1.0 {
                stable = middle;
            } else {
                unstable = middle;
            }
        }
        let share = stable / exact;
        eprintln!(
            "delay {delay_ticks}: {stable:.0} N/m measured, {exact:.0} N/m exactly: {share:.4}"
        );
        assert!(
            (share - 1.0).abs() < 0.02,
            "delay {delay_ticks}: {stable} N/m measured, {exact} N/m exactly"
        );
    }
}
