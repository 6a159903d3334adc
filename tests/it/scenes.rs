//! Every shipped scene is a test: it runs as it is shipped and ends as its comment promises.

use core::f64::consts::PI;

use arms::simulated::hand::HandPath;
use glam::DVec3;
use recording::TickRecord;
use vps::spatial::Pose;

use super::rig::{self, Run};

const MM: f64 = 1e-3;
/// What the edge of the peg's tip is cut off, along its axis.
const CHAMFER_MM: f64 = 1.0;
/// The tool's voxel.
const FACET_MM: f64 = 0.4;

/// Angle between the tool's z axis and the world's, degrees.
fn tilt_deg(pose: Pose) -> f64 {
    (pose.rotation * DVec3::Z).angle_between(DVec3::Z).to_degrees()
}

/// Turn about z, −180°..180°.
fn turn_deg(pose: Pose) -> f64 {
    let x = pose.rotation * DVec3::X;
    x.y.atan2(x.x).to_degrees()
}

fn assert_within(name: &str, what: &str, value: f64, low: f64, high: f64) {
    assert!((low..=high).contains(&value), "{name}: {what} is {value}, expected {low} to {high}");
}

fn run(name: &str) -> Run {
    let run = rig::run(&rig::load(&rig::shipped(name)));
    run.assert_sound(name);
    run
}

#[test]
fn every_shipped_scene_has_its_test() {
    let mut names: Vec<String> = std::fs::read_dir(rig::folder_of_scenes())
        .expect("the scenes")
        .map(|entry| entry.expect("an entry").path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "toml"))
        .map(|path| path.file_stem().expect("a name").to_string_lossy().into_owned())
        .collect();
    names.sort();
    assert_eq!(
        names,
        ["block-on-plane", "gear-on-shaft", "lift-with-block", "nut-on-bolt", "peg-in-hole"],
        "a scene without a test below"
    );
}

#[test]
fn block_on_plane_slides_on_the_surface_and_lifts_off() {
    let run = run("block-on-plane");
    // The hand wants 8.5 mm while it slides. Look wherever it has been down for a while.
    let mut sliding = 0;
    let mut sum = DVec3::ZERO;
    for record in &run.records[..run.stop_at_tick] {
        let output = &record.output;
        let height_mm = output.world_from_tool.translation.z / MM;
        assert_within("block", "height", height_mm, 9.9, 15.01);
        if output.contacts > 100 && output.contact_world.force.z > 0.3 {
            sliding += 1;
            sum += output.contact_world.force;
            assert_within("block", "height while pressed", height_mm, 9.9, 10.0);
            let force = output.contact_world.force;
            // 14 points on an edge, not symmetric on the grid: the tilted normals of the rim leave
            // some per cent sideways in a light touch; on the whole of the slide, below, it is
            // under a degree.
            assert!(
                force.angle_between(DVec3::Z).to_degrees() < 3.0,
                "tick {}: the plane pushes along {force}",
                record.tick
            );
        }
    }
    assert!(sliding > 1000, "{sliding} ticks of sliding");
    assert!(
        sum.angle_between(DVec3::Z).to_degrees() < 1.0,
        "on the whole the plane pushes along {sum}"
    );
    let end = run.final_pose();
    // 0.1 N of friction in the arm hold the hand back by 0.2 mm; the encoder counts in 0.04 mm.
    assert!(
        (end.translation / MM - DVec3::new(10.0, 0.0, 15.0)).length() < 0.24,
        "{}",
        end.translation
    );
    assert_within("block", "tilt", tilt_deg(end), 0.0, 0.4);
    assert!(rig::is_bit_zero(run.at_end().output.commanded_device), "lifted off");
}

#[test]
fn lift_with_block_goes_up_and_down_with_it_and_lifts_off() {
    let still = run("lift-with-block");
    let path = HandPath::read(&rig::folder_of_scenes().join("moves/lift.csv"))
        .expect("the path of the lift");
    let lifted = rig::run_moving(&rig::load(&rig::shipped("lift-with-block")), [("lift", path)]);
    lifted.assert_sound("lift-with-block, moving");
    // At 2.3 s the lift is up, and the block on it.
    let heights =
        [&still, &lifted].map(|run| run.records[2300].output.world_from_tool.translation.z / MM);
    assert_within("block", "height on the lift at rest", heights[0], 9.9, 10.0);
    assert_within("block", "height on the lift when it is up", heights[1], 13.8, 14.0);
    // While the part moves, contact is what the hand feels, but for a tick.
    let most_n =
        |force: fn(&TickRecord) -> f64| lifted.records.iter().map(force).fold(0.0, f64::max);
    let felt_n = most_n(|record| record.output.commanded_device.force.length());
    let contact_n = most_n(|record| record.output.contact_world.force.length());
    assert!(contact_n < 1.5 * felt_n, "contact {contact_n} N beside {felt_n} N on the hand");
    for run in [&still, &lifted] {
        let end = run.final_pose();
        assert!(
            (end.translation / MM - DVec3::new(10.0, 0.0, 15.0)).length() < 0.24,
            "{}",
            end.translation
        );
        assert!(rig::is_bit_zero(run.at_end().output.commanded_device), "lifted off");
    }
    let work_j =
        lifted.records.iter().map(|record| record.output.object_work_j).fold(0.0, f64::max);
    assert!(work_j > 1e-3, "the lift did {work_j} J of work");
}

#[test]
fn peg_goes_into_the_hole() {
    let run = run("peg-in-hole");
    let end = run.final_pose();
    let [x, y, z] = (end.translation / MM).to_array();
    assert_within("peg", "z", z, -20.15, -19.85);
    // What the clearance allows and not more: 0.05 mm to the side and 0.1 mm over 18 mm of wall,
    // each plus the depth in the wall, which is that in the middle of a facet.
    let depth_mm = run.at_end().output.max_depth_m / MM;
    assert_within("peg", "depth at rest", depth_mm, 0.0, 0.05);
    // The tip face is as wide as its chamfer leaves it, and leans: the wall ends a chamfer above.
    let leans_mm = tilt_deg(end).to_radians() * CHAMFER_MM;
    assert_within("peg", "offset", x.hypot(y), 0.0, 0.05 + depth_mm + leans_mm);
    assert_within(
        "peg",
        "tilt",
        tilt_deg(end),
        0.0,
        ((0.1 + 2.0 * depth_mm) / (18.0 - FACET_MM)).atan().to_degrees(),
    );
}

#[test]
fn peg_stays_out_of_a_plugged_hole() {
    let run = rig::run(&rig::rewritten("peg-in-hole", &[("block-hole.obj", "block-plugged.obj")]));
    run.assert_sound("peg, plugged");
    for record in &run.records {
        assert_within(
            "peg, plugged",
            "z",
            record.output.world_from_tool.translation.z / MM,
            -0.2,
            16.0,
        );
    }
}

#[test]
fn gear_seats_on_its_shaft_and_meshes() {
    let run = run("gear-on-shaft");
    let end = run.final_pose();
    let [x, y, z] = (end.translation / MM).to_array();
    assert_within("gear", "z", z, 3.9, 4.0);
    assert!(x.abs() < 0.11 && y.abs() < 0.11, "gear: {x}, {y}");
    assert_within("gear", "turn", turn_deg(end), -0.5, 0.5);
    assert_within("gear", "tilt", tilt_deg(end), 0.0, 0.2);
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn nut_follows_the_thread_when_it_is_turned() {
    let run = run("nut-on-bolt");
    let end = run.final_pose();
    let [x, y, z] = (end.translation / MM).to_array();
    assert_within("nut", "z", z, 30.85, 31.15);
    assert!(x.abs() < 0.16 && y.abs() < 0.16, "nut: {x}, {y}");
    assert_within("nut", "turn", turn_deg(end).abs(), 179.0, 180.0);
    // All the way down the height follows the turn: 2 mm for each, clockwise is down.
    let mut turned = 0.0;
    let mut before = 0.0;
    for record in &run.records[..run.stop_at_tick] {
        let pose = record.output.world_from_tool;
        let now = turn_deg(pose).to_radians();
        turned += (now - before + PI).rem_euclid(2.0 * PI) - PI;
        before = now;
        let led_mm = 34.0 + 2.0 * turned / (2.0 * PI);
        let height_mm = pose.translation.z / MM;
        assert!(
            (height_mm - led_mm).abs() < 0.15,
            "tick {}: {height_mm} mm, the thread leads to {led_mm} mm",
            record.tick
        );
    }
    assert!((turned.to_degrees() + 540.0).abs() < 1.0, "turned by {}°", turned.to_degrees());
}

/// The pressed nut, with more text before `[device]`.
fn pressed_nut(extra: &str) -> Run {
    let before_device = format!("{extra}\n[device]");
    let press = ("hand = \"hands/nut-on-bolt.csv\"", "hand = \"hands/nut-press.csv\"");
    rig::run(&rig::rewritten("nut-on-bolt", &[press, ("[device]", &before_device)]))
}

/// The last 0.9 s before the stop: lowest and highest z in mm, and how often contact came or went.
fn held(run: &Run) -> (f64, f64, usize) {
    let hold = &run.records[run.stop_at_tick - 900..run.stop_at_tick];
    let heights = hold.iter().map(|record| record.output.world_from_tool.translation.z / MM);
    let (low, high) = heights
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), z| (low.min(z), high.max(z)));
    let touches = |record: &TickRecord| record.output.contacts > 0;
    (low, high, hold.windows(2).filter(|pair| touches(&pair[0]) != touches(&pair[1])).count())
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn nut_that_is_only_pressed_is_held_by_the_thread() {
    let run = pressed_nut("");
    run.assert_sound("nut, pressed");
    let lowest = run.records[..run.stop_at_tick]
        .iter()
        .map(|r| r.output.world_from_tool.translation.z / MM)
        .fold(f64::INFINITY, f64::min);
    // Without turning, a nut that came loose would sink by millimetres.
    assert_within("nut, pressed", "lowest z", lowest, 33.85, 34.0);
    assert_within("nut, pressed", "turn", turn_deg(run.final_pose()), -1.0, 1.0);
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn nut_that_is_only_pressed_rests_when_the_low_pass_is_off() {
    let run = pressed_nut("[filter]\ncutoff_hz = \"off\"\n");
    run.assert_sound("nut, pressed, low-pass off");
    let (low, high, changes) = held(&run);
    assert_within("nut, pressed", "z", low, 33.85, 33.95);
    assert!(
        high - low < 1e-3 && changes == 0,
        "nut, pressed: z {low} to {high} mm, contact came or went {changes} times"
    );
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn nut_that_is_only_pressed_rests_as_shipped() {
    let (low, high, changes) = held(&pressed_nut(""));
    assert_within("nut, pressed", "z", low, 33.85, 33.95);
    assert!(
        high - low < 1e-2 && changes == 0,
        "nut, pressed: z {low} to {high} mm, contact came or went {changes} times"
    );
}
