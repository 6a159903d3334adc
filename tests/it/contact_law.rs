//! What contact does through the whole loop, on simulated arms: no drag where there is no friction,
//! no blow where a face lands flat, the same force at any rate.

use std::fmt::Write as _;

use glam::{DQuat, DVec3};
use rayon::prelude::*;

use super::program::hapticd;
use super::rig::{self, Run};

/// Where the hand is, s and mm from the tool's start.
type Way = [(f64, DVec3)];

/// A scene whose hand goes so and stays a second more; START and HAND stand in its text for the
/// tool's start (mm) and for the file of the hand.
fn play(text: &str, (start_mm, start): (DVec3, DQuat), way: &Way) -> Run {
    let turned = start.to_array().map(|component| format!("{component:?}")).join(", ");
    let folder = tempfile::tempdir().expect("a temporary folder");
    let mut lines = "t_s,x_m,y_m,z_m,qx,qy,qz,qw\n".to_owned();
    for (time_s, at_mm) in way {
        let at_m = (start_mm + *at_mm) * 1e-3;
        writeln!(lines, "{time_s},{},{},{},{turned}", at_m.x, at_m.y, at_m.z).expect("a string");
    }
    let path = folder.path().join("hand.csv");
    std::fs::write(&path, lines).expect("written");
    let [x, y, z] = start_mm.to_array();
    let start =
        format!("start_position_mm = [{x:?}, {y:?}, {z:?}]\nstart_orientation_xyzw = [{turned}]");
    let text = text.replace("START", &start).replace("HAND", &path.display().to_string());
    let run = rig::run(&rig::written(&text));
    assert!(run.records.iter().all(|record| record.output.faults.is_empty()), "{text}");
    run
}

/// Mean over records.
fn mean(of: impl Iterator<Item = f64>) -> f64 {
    let (sum, n) = of.fold((0.0, 0.0), |(sum, n), value| (sum + value, n + 1.0));
    sum / n
}

#[test]
fn no_tool_is_dragged_over_a_plane_without_friction() {
    // Tip, rim and edge down, 8 mm above the middle.
    let tools = [
        ("cone", "cone_mm = [2.0, 20.0]", DVec3::X, core::f64::consts::PI, 10.0),
        ("rod", "cylinder_mm = [3.0, 20.0]", DVec3::X, 0.5, 9.1),
        ("box on its corner", "box_mm = [8.0, 8.0, 8.0]", DVec3::new(1.0, -1.0, 0.0), 0.8, 7.0),
        ("ball", "sphere_mm = 5.0", DVec3::X, 0.0, 5.0),
    ];
    for (name, shape, axis, angle_rad, low_mm) in tools {
        for speed_mm_per_s in [10.0_f64, 50.0, 200.0, 500.0] {
            let turn = DQuat::from_axis_angle(axis.normalize(), angle_rad);
            let start_mm = DVec3::new(-60.0, 0.0, low_mm + 0.5);
            let text = format!(
                "version = 1\n[[static]]\nname = \"floor\"\nshape = {{ plane_mm = [150.0, 30.0] \
                    }}\nvoxel_size_mm = 0.5\n[tool]\nshape = {{ {shape} }}\nvoxel_size_mm = \
                    0.5\nSTART\n[device]\nprofile = \"sim-sigma7\"\nhand = \
                    \"HAND\"\n[device.sim]\nhand_stiffness_n_per_m = \
                    2000.0\nhand_damping_n_s_per_m = 20.0\n"
            );
            let slides_s = (100.0 / speed_mm_per_s).min(1.0);
            let down = DVec3::new(0.0, 0.0, -2.5);
            let along = down + DVec3::X * (speed_mm_per_s * slides_s);
            let way = [(0.0, DVec3::ZERO), (0.5, down), (1.0, down), (1.0 + slides_s, along)];
            let run = play(&text, (start_mm, turn), &way);
            // The second half of the way: the first has to set the hand in motion.
            let first = (1000.0 * (1.0 + 0.5 * slides_s)) as usize;
            let slides = &run.records[first..(1000.0 * (1.0 + slides_s)) as usize];
            let across_n = mean(slides.iter().map(|record| record.output.contact_world.force.x));
            let along_n = mean(slides.iter().map(|record| record.output.contact_world.force.z));
            let felt_n = mean(slides.iter().map(|record| record.output.command_device.force.x));
            let share = across_n / along_n;
            eprintln!(
                "{name} at {speed_mm_per_s} mm/s: contact {share:.4} of {along_n:.2} N, felt \
                    {:.4}",
                felt_n / along_n
            );
            assert!(along_n > 0.3 && share.abs() < 0.03, "{name} at {speed_mm_per_s} mm/s");
        }
    }
}

/// Its upright sides stand in the plane by a fraction of a micrometre.
#[test]
fn a_block_that_slides_is_dragged_by_its_friction_and_by_nothing_else() {
    let friction = "damping_ratio = 0.7\nfriction = { static = 0.3, dynamic = 0.25 }";
    let config = rig::rewritten("block-on-plane", &[("damping_ratio = 0.7", friction)]);
    let run = rig::run_ticks(&config, 3000);
    // Until the hand slows down: then it holds with less.
    let slides = &run.records[1500..2250];
    let across_n = mean(slides.iter().map(|record| record.output.command_device.force.x));
    let along_n = mean(slides.iter().map(|record| record.output.command_device.force.z));
    let share = -across_n / along_n;
    eprintln!("the block is dragged by {share:.4} of {along_n:.3} N");
    assert!(along_n > 0.3 && (share / 0.25 - 1.0).abs() < 0.05, "{share}");
}

#[test]
fn a_face_that_lands_flat_publishes_no_more_than_twice_what_the_hand_presses() {
    // Its lower side is 1000 mm².
    for stiffness_n_per_mm3 in [10.0, 100.0] {
        let text = format!(
            "version = 1\n[[static]]\nname = \"floor\"\nshape = {{ plane_mm = [60.0, 60.0] \
                }}\nvoxel_size_mm = 0.5\n[tool]\nshape = {{ box_mm = [31.6, 31.6, 10.0] \
                }}\nvoxel_size_mm = 0.5\nSTART\n[contact]\nstiffness_n_per_mm3 = \
                {stiffness_n_per_mm3}\n[device]\nprofile = \
                \"sim-sigma7\"\nhand = \"HAND\"\n[device.sim]\nhand_stiffness_n_per_m = \
                2000.0\nhand_damping_n_s_per_m = 20.0\n"
        );
        // 0.1 m/s, from 10 mm above to 2 mm below.
        let way = [(0.0, DVec3::ZERO), (0.3, DVec3::ZERO), (0.42, DVec3::Z * -12.0)];
        let run = play(&text, (DVec3::Z * 15.0, DQuat::IDENTITY), &way);
        let peak = |of: fn(&recording::TickRecord) -> DVec3| {
            run.records.iter().map(|record| of(record).length()).fold(0.0, f64::max)
        };
        let contact_n = peak(|record| record.output.contact_world.force);
        let felt_n = peak(|record| record.output.command_device.force);
        eprintln!("{stiffness_n_per_mm3} N/mm³: contact {contact_n:.2} N, felt {felt_n:.2} N");
        assert!(felt_n > 1.0 && contact_n < 2.0 * felt_n, "{contact_n} N for {felt_n} N");
    }
}

/// A square peg, larger than its hole by as much on each side, over voxels of up to 80 times that.
#[test]
fn a_peg_that_is_too_large_goes_in_under_the_force_of_the_law_and_no_other() {
    const HALF_MM: f64 = 5.0;
    // Overlap on each side, contact modulus, voxel.
    let cases = [
        (0.005, 20.0, 0.4),
        (0.005, 1000.0, 0.4),
        (0.02, 125.0, 0.4),
        (0.02, 125.0, 0.2),
        (0.05, 20.0, 0.4),
        (0.02, 1000.0, 0.4),
        (0.1, 125.0, 0.4),
    ];
    cases.par_iter().for_each(|&(overlap_mm, n_per_mm3, voxel_mm)| {
        let mut text = String::from("version = 1\n");
        for (name, x, y) in
            [("+x", 1.0, 0.0), ("-x", -1.0, 0.0), ("+y", 0.0, 1.0), ("-y", 0.0, -1.0)]
        {
            let wide = if x == 0.0 { 22.0 } else { 6.0 };
            let deep = 28.0 - wide;
            writeln!(
                text,
                "[[static]]\nname = \"{name}\"\nshape = {{ box_mm = [{wide:?}, {deep:?}, 12.0] \
                    }}\nvoxel_size_mm = {voxel_mm}\nposition_mm = [{:?}, {:?}, -6.0]",
                x * (HALF_MM + 3.0),
                y * (HALF_MM + 3.0)
            )
            .expect("a string");
        }
        let wide_mm = 2.0 * (HALF_MM + overlap_mm);
        write!(
            text,
            "[tool]\nshape = {{ box_mm = [{wide_mm}, {wide_mm}, 20.0] }}\nvoxel_size_mm = \
                {}\nSTART\n[contact]\nstiffness_n_per_mm3 = {n_per_mm3}\n[device]\nprofile = \
                \"sim-sigma7\"\nhand = \"HAND\"\n[device.sim]\nhand_stiffness_n_per_m = 500.0\n",
            2.0 * voxel_mm
        )
        .expect("a string");
        // 8 mm deep, if it goes in.
        let way = [(0.0, DVec3::ZERO), (4.0, DVec3::Z * -9.0)];
        let run = play(&text, (DVec3::Z * 11.0, DQuat::IDENTITY), &way);
        let law_n = 0.5 * n_per_mm3 * overlap_mm * overlap_mm * 4.0 * wide_mm;
        let reached_m = run.records[4000].output.world_from_tool.translation.z;
        let way_in = &run.records[2000..3500];
        let contact_n = mean(way_in.iter().map(|record| record.output.contact_world.force.z));
        eprintln!(
            "{overlap_mm} mm, {n_per_mm3} N/mm³, voxels of {voxel_mm} mm: {contact_n:.4} N, by \
                the law {law_n:.4} N; at the end {:.2} mm",
            reached_m * 1e3
        );
        let what = format!("{overlap_mm} mm, {n_per_mm3} N/mm³, voxels of {voxel_mm} mm");
        // 500 N/m and 9 mm are 4.5 N.
        if law_n < 3.0 {
            assert!((contact_n / law_n - 1.0).abs() < 0.01, "{what}: {contact_n} N of {law_n} N");
            assert!(reached_m < 6e-3, "{what} stays out");
        } else {
            assert!(reached_m > 9e-3, "{what} goes in, to {reached_m} m");
        }
    });
}

#[test]
fn a_press_has_the_same_force_at_any_voxel_size() {
    const AREA_MM2: f64 = 20.0 * 20.0;
    let dir = tempfile::tempdir().expect("a temporary folder");
    let write = |name: &str, text: String| {
        std::fs::write(dir.path().join(name), text).expect("written");
    };
    let depths_mm = [0.1, 0.3];
    let poses = depths_mm.map(|depth_mm| format!("0,0,0,{},0,0,0,1\n", 5.0 - depth_mm)).concat();
    write("poses.csv", format!("t_s,x_mm,y_mm,z_mm,qx,qy,qz,qw\n{poses}"));
    for (n_per_mm3, contact) in [(20.0, ""), (3.0, "stiffness_n_per_mm3 = 3.0")] {
        for voxel_mm in [0.25, 0.5, 1.0] {
            write(
                "scene.toml",
                format!(
                    "version = 1\n[[static]]\nshape = {{ plane_mm = [40, 40] }}\nvoxel_size_mm = \
                        0.5\n[tool]\nshape = {{ box_mm = [20, 20, 10] }}\nvoxel_size_mm = \
                        {voxel_mm}\n[contact]\n{contact}\n"
                ),
            );
            let ended = hapticd(
                dir.path(),
                "eval scene.toml --poses poses.csv --out - --cache off --quiet",
            );
            assert_eq!(ended.code, Some(0), "{}", ended.stderr);
            for (line, depth_mm) in ended.stdout.lines().skip(1).zip(depths_mm) {
                let force_n: f64 =
                    line.split(',').nth(3).and_then(|text| text.parse().ok()).expect("a force");
                let expected_n = n_per_mm3 * AREA_MM2 * depth_mm;
                assert!(
                    (force_n / expected_n - 1.0).abs() < 0.01,
                    "{n_per_mm3} N/mm³ at {voxel_mm} mm, {depth_mm} mm deep: {force_n} N, expected \
                        {expected_n} N"
                );
            }
        }
    }
}

/// Contact force at rest, N, of a block that a hand presses onto a plane, and slides there. No tick
/// is without contact once it lies.
fn pressed_n(arm: &str, rate_hz: usize, slides: bool, coupling: &str) -> f64 {
    let text = format!(
        "version = 1\n[rendering]\nrate_hz = {rate_hz}\n[[static]]\nname = \"floor\"\nshape = {{ \
            plane_mm = [60.0, 60.0] }}\nvoxel_size_mm = 0.5\n[tool]\nshape = {{ box_mm = [10.0, \
            10.0, 10.0] }}\nvoxel_size_mm = 0.5\nSTART\n{coupling}\n[device]\nprofile = \
            \"{arm}\"\nhand = \"HAND\"\n"
    );
    let down = DVec3::Z * -3.0;
    let along = if slides { DVec3::X * 10.0 } else { DVec3::ZERO };
    let way = [(0.0, DVec3::ZERO), (0.5, down), (1.0, down), (1.5, down + along)];
    let run = play(&text, (DVec3::Z * 6.0, DQuat::IDENTITY), &way);
    let until_end = |ticks: usize| &run.records[run.stop_at_tick - ticks..run.stop_at_tick];
    // The hand stays a second more.
    let lies = until_end(rate_hz * 17 / 10).iter();
    let without = lies.filter(|record| record.output.contacts == 0).count();
    assert_eq!(without, 0, "{arm} at {rate_hz} Hz, slides: {slides}, {coupling}");
    let rests = until_end(rate_hz / 2).iter();
    mean(rests.map(|record| record.output.contact_world.force.z))
}

/// With a spring that every arm can take at these rates.
fn assert_same_at(arm: &str, rates_hz: &[usize], slides: bool) {
    let coupling = "[coupling]\ntranslation_n_per_mm = 0.1";
    let forces_n: Vec<f64> =
        rates_hz.iter().map(|rate_hz| pressed_n(arm, *rate_hz, slides, coupling)).collect();
    eprintln!("{arm} at {rates_hz:?} Hz, slides: {slides}: {forces_n:?} N");
    let [least, most] = [f64::min as fn(f64, f64) -> f64, f64::max]
        .map(|of| forces_n.iter().copied().reduce(of).expect("some rates"));
    assert!(least > 0.1 && most / least < 1.03, "{arm}: {forces_n:?}");
}

#[test]
fn a_press_has_the_same_force_at_any_rate() {
    for arm in ["sim-sigma7", "sim-inverse3"] {
        assert_same_at(arm, &[500, 1000, 2000, 4000], false);
    }
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn every_arm_presses_and_slides_with_the_same_force_at_any_rate() {
    let profiles = std::fs::read_dir("devices").expect("the shipped profiles");
    let names = profiles.map(|file| file.expect("a file").file_name().into_string());
    let arms: Vec<String> = names
        .filter_map(|name| name.expect("a name").strip_suffix(".toml").map(ToOwned::to_owned))
        // One has no damping of its own, for tests; one moves across, and never comes down.
        .filter(|arm| arm.starts_with("sim-") && !["sim-ideal", "sim-2diy"].contains(&&**arm))
        .collect();
    assert!(arms.len() >= 15, "{arms:?}");
    arms.par_iter().for_each(|arm| {
        assert_same_at(arm, &[500, 1000, 4000, 8000], true);
        // By default the spring is as hard as the arm can take at the rate: nearly none at 100 Hz.
        for rate_hz in [100, 10_000] {
            assert!(pressed_n(arm, rate_hz, true, "") > 0.05, "{arm} at {rate_hz} Hz");
        }
    });
}
