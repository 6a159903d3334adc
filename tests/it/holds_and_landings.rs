//! Random holds and landings on the virtual clock, on every simulated arm at any rate: a hand
//! presses a tool on an obstacle and holds still, or brings it down on a face. Numbers make them,
//! as in `scene_search`; `HAPTICD_SEARCH_HOLDS` and `HAPTICD_SEARCH_LANDINGS` say how many.

use std::time::Instant;

use glam::{DQuat, DVec3};
use rayon::prelude::*;

use super::rig;
use super::scene_search::{
    AnyArm, BAD, Dice, Kind, MODES, Scenario, Verdict, count, hand, judge_watched, numbers, parts,
    write_trace,
};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Action {
    Hold,
    Land,
}

/// How the tool came down.
#[derive(Clone, Copy, Debug, Default)]
struct Touchdown {
    /// Least force along the outward normal that was commanded before it pushed, N.
    pull_n: f64,
    /// Largest published contact over the largest force that the hand felt.
    peak: f64,
    /// Deepest point then, m.
    peak_depth_m: f64,
    /// How long nothing touched after the first contact, s, and how far away the tool was then, m.
    in_air_s: f64,
    hop_m: f64,
    /// What a step of the encoder is for the spring of the coupling, N.
    step_n: f64,
}

const HARD: [Kind<(Verdict, Touchdown)>; 3] = [
    ("pull < -0.02 N", |(_, of)| of.pull_n < -0.02),
    ("contact > 2 times what is felt", |(v, of)| v.mode == "Implicit" && of.peak > 2.0),
    ("bounce", |(_, of)| of.in_air_s > 0.0),
];

impl Touchdown {
    /// Within one step of the encoder it is not known whether the hand moves or stands; a hop of two
    /// is less than a hand feels.
    fn assert_soft(&self, verdict: &Verdict) {
        let Verdict { seed, what, .. } = verdict;
        assert!(self.pull_n >= -self.step_n.max(0.02), "{seed} pulls: {self:?} {what}");
        assert!(self.hop_m <= 1e-4, "{seed} bounces: {self:?} {what}");
    }
}

/// A shape, and how far it reaches down from its centre in an attitude, mm.
fn tool(dice: &mut Dice, turn: DQuat) -> (String, f64) {
    let r = dice.between(3.0, 7.0);
    let up = (turn * DVec3::Z).z;
    let across = (1.0 - up * up).max(0.0).sqrt();
    match dice.pick(&[0, 0, 1, 2, 3, 4, 5]) {
        0 => {
            let edges = DVec3::new(1.2, 1.5, 1.0) * r;
            let down = 0.5 * (turn.inverse() * DVec3::Z).abs().dot(edges);
            (format!("box_mm = [{:?}, {:?}, {:?}]", edges.x, edges.y, edges.z), down)
        }
        1 => (format!("sphere_mm = {r:?}"), r),
        2 => {
            let (radius, half) = (0.6 * r, 0.75 * r);
            let down = radius * across + half * up.abs();
            (format!("cylinder_mm = [{radius:?}, {:?}]", 2.0 * half), down)
        }
        3 => {
            let (radius, half) = (0.8 * r, 0.75 * r);
            let down = (half * up + radius * across).max(-half * up);
            (format!("cone_mm = [{radius:?}, {:?}]", 2.0 * half), down)
        }
        4 => {
            let (radius, half) = (0.5 * r, 0.6 * r);
            (format!("capsule_mm = [{radius:?}, {:?}]", 2.0 * half), radius + half * up.abs())
        }
        _ => (format!("torus_mm = [{r:?}, {:?}]", 0.4 * r), 0.4 * r + r * across),
    }
}

fn scenario(action: Action, seed: u64) -> Scenario {
    let mut dice = Dice::of(seed + if action == Action::Hold { 1 << 20 } else { 1 << 21 });
    let lands = action == Action::Land;
    let AnyArm { profile, axes, rate_hz } = AnyArm::of(&mut dice);
    let mode = dice.pick(&MODES);
    let turn = if lands && dice.pick(&[true, false]) {
        DQuat::from_rotation_z(dice.between(0.0, 3.0))
    } else {
        DQuat::from_axis_angle(dice.direction(), dice.between(0.0, 3.0))
    };
    let (shape, down_mm) = tool(&mut dice, turn);
    let voxel_mm = dice.pick(&[0.3, 0.5, 0.5, 1.0]);
    let (place, statics) = match dice.pick(&[0, 1, 2]) {
        0 if lands => (
            "face",
            format!(
                "[[static]]\nshape = {{ plane_mm = [60.0, 60.0] }}\nvoxel_size_mm = {voxel_mm}\n"
            ),
        ),
        1 | 2 if !lands => parts(&mut dice, down_mm),
        _ => (
            "block",
            format!(
                "[[static]]\nshape = {{ box_mm = [30.0, 30.0, 20.0] }}\nvoxel_size_mm = \
                    {voxel_mm}\nposition_mm = [0.0, 0.0, -10.0]\n"
            ),
        ),
    };
    let friction = dice.pick(&[0.0, 0.0, 0.1, 0.3, 0.6]);
    let contact = dice.pick(&[None, Some(2.0), Some(8.0), Some(80.0)]);
    let contact = if mode == "direct" { None } else { contact };
    let delay = dice.pick(&[None, None, None, Some(0), Some(2), Some(4)]);
    let [n_per_m, n_s_per_m, mass_g] =
        [dice.scaled(100.0, 2000.0), dice.scaled(1.0, 20.0), dice.scaled(50.0, 250.0)];
    let speed_mm_per_s = if lands { dice.scaled(0.5, 100.0) } else { dice.scaled(5.0, 200.0) };
    // The hand is up to its speed there.
    let gap_mm = if lands { 0.3 + 0.1 * speed_mm_per_s } else { 1.5 };
    let start_mm = DVec3::Z * (down_mm + gap_mm);
    let [x, y, z, w] = turn.to_array();
    let mut text = format!(
        "version = 1\n[rendering]\nrate_hz = {rate_hz}\ncoupling = \"{mode}\"\n{statics}[tool]\nshape \
            = {{ {shape} }}\nvoxel_size_mm = 0.5\nmass_g = 100.0\nstart_position_mm = [0.0, 0.0, \
            {:?}]\nstart_orientation_xyzw = [{x:?}, {y:?}, {z:?}, {w:?}]\n[device]\nprofile = \
            \"{profile}\"\n{axes}[device.sim]\nhand_stiffness_n_per_m = \
            {n_per_m:?}\nhand_damping_n_s_per_m = {n_s_per_m:?}\nhand_mass_g = {mass_g:?}\n",
        start_mm.z
    );
    if let Some(delay) = delay {
        text += &format!("delay_ticks = {delay}\n");
    }
    text += "[contact]\n";
    if friction > 0.0 {
        text += &format!("friction = {{ static = {friction}, dynamic = {} }}\n", 0.8 * friction);
    }
    if let Some(contact) = contact {
        text += &format!("stiffness_n_per_mm3 = {contact}\n");
    }
    let config = rig::written(&text);

    // A share of the arm's force, through the hand's own spring.
    let press_n = dice.between(0.1, 0.8) * config.parameters.limits.force_n;
    let depth_mm = (press_n / n_per_m * 1e3 + dice.between(0.2, 1.5)).min(25.0);
    let depth_mm = if lands { depth_mm.min(0.3 + 3.0 * speed_mm_per_s) } else { depth_mm };
    let aside = if lands || place == "slot" { 0.0 } else { 0.4 };
    let into = (DVec3::NEG_Z + dice.direction() * aside).normalize();
    let way_mm = gap_mm + depth_mm;
    let end_s = 0.3 + way_mm / speed_mm_per_s;
    let deep_mm = start_mm + into * way_mm;
    let path = hand(turn, &[(0.0, start_mm), (0.3, start_mm), (end_s, deep_mm)]);
    let what = format!(
        "{mode} {profile} {rate_hz} Hz {place} {voxel_mm} mm, {shape} {down_mm:.2} mm above, \
            {speed_mm_per_s:.1} mm/s, {depth_mm:.1} mm deep, mu {friction}, hand {n_per_m:.0} N/m \
            {n_s_per_m:.1} N.s/m {mass_g:.0} g, contact {contact:?}, delay {delay:?}, {:.0} N/m",
        config.parameters.coupling.stiffness_n_per_m
    );
    Scenario { seed, what, config, path, end_s }
}

/// A tool that begins inside of a wall waits there, without a force: another number then.
fn play(action: Action, seed: u64) -> (Verdict, Touchdown) {
    (0..).find_map(|again| play_from_outside(&scenario(action, seed + (again << 32)))).expect("one")
}

fn play_from_outside(scenario: &Scenario) -> Option<(Verdict, Touchdown)> {
    let parameters = &scenario.config.parameters;
    let plant = &scenario.config.device.profile.plant;
    let mut of = Touchdown {
        step_n: plant.encoder_step_m * parameters.coupling.stiffness_n_per_m,
        ..Touchdown::default()
    };
    let (mut contact_n, mut felt_n, mut has_pushed, mut first_m) = (0.0_f64, 0.0_f64, false, None);
    let mut is_inside = false;
    let verdict = judge_watched(scenario, |n, _, output| {
        is_inside |= n == 0 && output.contacts > 0;
        let felt = parameters.mapping.world_from_device.rotation * output.commanded_device.force;
        has_pushed |= felt.z > 0.02;
        if !has_pushed {
            of.pull_n = of.pull_n.min(felt.z);
        }
        let force_n = output.contact_world.force.length();
        let stands_m = output.world_from_tool.translation.z;
        if force_n > 0.0 {
            first_m = first_m.or(Some(stands_m));
        } else if let Some(first_m) = first_m {
            of.in_air_s += parameters.period_s;
            of.hop_m = of.hop_m.max(stands_m - first_m);
        }
        if force_n > contact_n {
            (contact_n, of.peak_depth_m) = (force_n, output.max_depth_m);
        }
        felt_n = felt_n.max(felt.length());
    });
    of.peak = contact_n / felt_n.max(0.05);
    (!is_inside).then_some((verdict, of))
}

/// Plays so many, and says what is counted of them.
fn search(action: Action, runs: &str) -> Vec<(Verdict, Touchdown)> {
    let seeds = numbers(runs, 40);
    write_trace(&scenario(action, seeds.start));
    let begun = Instant::now();
    let (verdicts, touchdowns): (Vec<Verdict>, Vec<Touchdown>) =
        seeds.into_par_iter().map(|seed| play(action, seed)).unzip();
    eprintln!("{action:?}: {} in {:.0} s", verdicts.len(), begun.elapsed().as_secs_f64());
    count(&verdicts, |verdict| verdict.seed, &BAD);
    let runs: Vec<(Verdict, Touchdown)> = verdicts.into_iter().zip(touchdowns).collect();
    if action == Action::Land {
        count(&runs, |(verdict, _)| verdict.seed, &HARD);
    }
    for (verdict, touchdown) in &runs {
        eprintln!("{touchdown:?} {verdict:?}");
    }
    runs
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn random_tools_that_are_held_on_random_obstacles_rest_there() {
    for (verdict, _) in search(Action::Hold, "HAPTICD_SEARCH_HOLDS") {
        if verdict.is_damped {
            verdict.assert_good();
            let Verdict { mode, share, seed, what, .. } = verdict;
            let is_whole = (share - 1.0).abs() <= 0.05;
            assert!(is_whole || mode != "Implicit", "{seed} keeps force back, {share}: {what}");
        }
    }
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn random_tools_land_on_faces_without_pull_or_bounce() {
    let mut runs = search(Action::Land, "HAPTICD_SEARCH_LANDINGS");
    runs.retain(|(verdict, _)| verdict.is_damped);
    for (verdict, touchdown) in &runs {
        verdict.assert_good();
        touchdown.assert_soft(verdict);
    }
    // Where a step is taken again with what touches at its end, that may be the rim of a face which
    // then goes deeper (1 of 185).
    let (_, is_blow) = HARD[1];
    let n_blows = runs.iter().filter(|run| is_blow(run)).count();
    assert!(n_blows * 100 <= runs.len(), "{n_blows} of {}", runs.len());
}

/// A step of the encoder had set it into the face, which threw it out again and published ten
/// times what the hand felt.
#[test]
fn a_tool_that_a_step_of_the_encoder_sets_into_a_face_stays_there() {
    let (verdict, of) = play(Action::Land, 4);
    eprintln!("{of:?} {verdict:?}");
    assert!(of.pull_n == 0.0 && of.peak < 1.2 && of.in_air_s == 0.0, "{of:?}");
}

/// The direct coupling softened by the stiffness alone, which ends where the field does: a cone at
/// 5 mm went to and fro with 14 N and gave 1.6 J (362), another 36 mJ (154).
#[test]
fn without_a_virtual_tool_force_ends_where_the_field_does_and_does_not_grow() {
    for seed in [154, 362] {
        let (verdict, _) = play(Action::Hold, seed);
        eprintln!("{verdict:?}");
        verdict.assert_good();
        assert!(verdict.is_still(), "{verdict:?}");
    }
}
