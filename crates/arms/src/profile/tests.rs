//! Real arms as data: every shipped one, what is refused, and a new one that needs no Rust.

use std::fs;
use std::path::Path;

use glam::{DQuat, DVec3};

use super::*;
use crate::attached::nodes::DeviceFile;
use crate::kinematics::{Configuration, Kinematics};
use crate::protocol::{ArmReadings, MAX_AXES, MotorCommand, Outbox, Protocol};
use crate::transport::Frame;
use vps::spatial::{Pose, Wrench};

fn shipped() -> Vec<Profile> {
    names()
        .map(|name| find(name, Path::new("")).unwrap_or_else(|error| panic!("{name}: {error}")))
        .collect()
}

fn real(name: &str) -> (Profile, RealArm) {
    let profile = find(name, Path::new("")).unwrap_or_else(|error| panic!("{name}: {error}"));
    let real = profile.real.clone().expect("a real arm");
    (profile, real)
}

#[test]
fn every_real_arm_has_a_known_answer() {
    // Loading holds them against the rest.
    let mut n_checks = 0;
    let mut n_frames = 0;
    for profile in shipped() {
        let Some(real) = profile.real else { continue };
        let is_rate = matches!(real.kinematics, Kinematics::Rate(_));
        assert!(is_rate || !real.checks.is_empty(), "{}: no [[check]]", profile.name);
        assert!(
            real.checks.iter().all(|check| check.readings.is_some()),
            "{}: shipped checks say what the readings are",
            profile.name
        );
        n_checks += real.checks.len();
        n_frames += real.checks.iter().filter(|check| check.frame.is_some()).count();
    }
    assert!(n_checks >= 15 && n_frames >= 7, "{n_checks} {n_frames}");
}

/// A copy of a shipped profile with one change.
fn changed(name: &str, from: &str, to: &str) -> String {
    let text = fs::read_to_string(
        Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("devices/{name}.toml")),
    )
    .expect("shipped");
    assert!(text.contains(from), "{name}: {from}");
    load_text(&text.replacen(from, to, 1)).err().unwrap_or_default()
}

#[test]
fn a_profile_that_contradicts_its_known_answers_is_refused() {
    let expected = "error: my-arm.toml:149: check[0].position_mm = [73.0, 0.0, 82.0]: the readings \
        give (73.0000, 0.0000, 92.0000) mm, 10.0000 mm away: geometry, signs, offsets or this \
        position are wrong";
    assert_eq!(
        changed(
            "leader-arm-6",
            "position_mm = [73.0, 0.0, 92.0]",
            "position_mm = [73.0, 0.0, 82.0]"
        ),
        expected
    );
    for (what, name, from, to, said) in [
        ("geometry", "haply-2diy", "inner_mm = 70.0", "inner_mm = 75.0", "check[0].position_mm"),
        (
            "sign",
            "woodenhaptics-2022",
            "encoder_sign = [",
            "encoder_sign = [-",
            "check[0].position_mm",
        ),
        (
            "count",
            "leader-arm-6",
            "readings = [2048, ",
            "readings = [",
            "check[0].readings = [2048, 2048, 2048, 2048, 2048]: must be",
        ),
        (
            "too many",
            "haply-2diy",
            "readings = [40, 150]",
            "readings = [40, 150, 7]",
            "from 2 to 2 readings",
        ),
        (
            "frame",
            "polhem-2022",
            "frame_hex = \"5B ",
            "frame_hex = \"5C ",
            "one sound report of `haptikfabriken-brackets`",
        ),
        (
            "two frames",
            "haply-2diy-first",
            "frame_hex = \"05 00 00",
            "frame_hex = \"00 00",
            "one sound report of `hapi-f32`",
        ),
        (
            "readings",
            "polhem-2022",
            "readings = [100, -200, 300, 4,",
            "readings = [100, -201, 300, 4,",
            "the frame says [100.0, -200.0",
        ),
        (
            "nowhere",
            "haply-2diy",
            "outer_mm = 90.0",
            "outer_mm = 20.0",
            "the arm cannot be where the readings put it",
        ),
    ] {
        let errors = changed(name, from, to);
        assert!(errors.contains(said), "{what}: {errors}");
    }
    let rate = changed(
        "spacemouse",
        "[plant]",
        "[[check]]\nreadings = [1, 2, 3, 4, 5, 6]\nposition_mm = [0, 0, 0]\n[plant]",
    );
    assert!(rate.contains("check[0]: must be left out: a rate input has no position"), "{rate}");
}

#[test]
fn every_real_arm_can_stand_within_its_workspace() {
    for profile in shipped() {
        let Some(real) =
            profile.real.filter(|real| !matches!(real.kinematics, Kinematics::Rate(_)))
        else {
            continue;
        };
        let home = real.kinematics.solve(&real.kinematics.home(), &Configuration::default());
        let away_m = home
            .unwrap_or_else(|| panic!("{}", profile.name))
            .native_from_grip
            .translation
            .length();
        assert!(away_m < 0.5 * profile.limits.workspace_radius_m, "{}: {away_m} m", profile.name);
    }
}

#[test]
fn every_real_arm_is_unverified_unidentified_and_whole() {
    for profile in shipped() {
        let Some(real) = &profile.real else { continue };
        let name = &profile.name;
        assert!(!real.signs_verified && profile.is_unidentified(), "{name}");
        let ratio = profile.bound_plant().damping_n_s_per_m / profile.plant.damping_n_s_per_m;
        assert_eq!(ratio, 0.5, "{name}: half of the assumed viscosity");
        assert!(real.device_from_native.is_normalized(), "{name}");
        real.protocol.check().unwrap_or_else(|error| panic!("{name}: {error}"));
        // The middle of the workspace is a place where the arm can be, and its readings lead back
        // there.
        let home = real.kinematics.home();
        let solved = real
            .kinematics
            .solve(&home, &Configuration::default())
            .unwrap_or_else(|| panic!("{name}"));
        let again = real.transmission.angles(&real.transmission.readings(&home));
        for idx in 0..real.kinematics.n_joints() {
            assert!((again[idx] - home[idx]).abs() < 1e-9, "{name} {idx}: {home:?} {again:?}");
        }
        if !matches!(real.kinematics, Kinematics::Chain(_)) {
            assert!(
                solved.native_from_grip.translation.length() < 1e-6,
                "{name}: {}",
                solved.native_from_grip.translation
            );
        }
        // Every actuated axis has motors that can push along it.
        for (idx, axis) in
            DVec3::AXES.into_iter().enumerate().filter(|(idx, _)| profile.actuated.has(*idx))
        {
            let native = real.device_from_native.conjugate() * axis;
            let (commands, scale) = real
                .transmission
                .commands(&solved.torques(&Wrench::new(native, DVec3::ZERO)), &[0.0; MAX_AXES]);
            assert!(
                scale > 0.2 && commands.iter().any(|command| command.abs() > 1e-3),
                "{name} {idx}: {commands:?} {scale}"
            );
        }
    }
}

#[test]
fn measured_values_replace_assumed_ones() {
    let dir = tempfile::tempdir().expect("a folder");
    let path = dir.path().join("mine.toml");
    let text =
        fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("devices/polhem-2022.toml"))
            .expect("shipped");
    fs::write(
        &path,
        text + "\n[identified]\nround_trip_ticks = 2\nmass_kg = 0.31\ndamping_n_s_per_m = 1.2\n",
    )
    .expect("written");
    let profile = load(&path).unwrap_or_else(|errors| panic!("{errors}"));
    assert!(!profile.is_unidentified());
    let plant = profile.bound_plant();
    assert_eq!((plant.delay_ticks, plant.mass_kg, plant.damping_n_s_per_m), (2, 0.31, 1.2));
    assert_eq!(profile.plant.mass_kg, 0.25, "the twin stays what it was");
}

#[test]
fn frames_map_as_the_table_says() {
    let (_, falcon) = real("novint-falcon");
    // Native z comes out of the device, toward the operator.
    assert!((falcon.device_from_native * DVec3::Z).distance(DVec3::X) < 1e-12);
    assert!((falcon.device_from_native * DVec3::X).distance(DVec3::Y) < 1e-12);
    assert!((falcon.device_from_native * DVec3::Y).distance(DVec3::Z) < 1e-12);
    let (_, mouse) = real("spacemouse");
    assert!((mouse.device_from_native * DVec3::Y).distance(DVec3::X) < 1e-12);
    assert!((mouse.device_from_native * DVec3::Z).distance(-DVec3::Z) < 1e-12);
    let (_, polhem) = real("polhem-2022");
    assert_eq!(polhem.device_from_native, DQuat::IDENTITY);
}

#[test]
fn ports_and_arms_of_a_pantograph_are_not_mixed_up() {
    let (_, haply) = real("haply-2diy");
    let Protocol::HapiF32(board) = &haply.protocol else { panic!("a hAPI board") };
    assert_eq!((board.encoders[0].start_deg, board.encoders[1].start_deg), (12.0, 168.0));
    // Arm 1 is wired to port 2: its start angle is what port 2 reports.
    let mut readings = [0.0; MAX_AXES];
    readings[..2].copy_from_slice(&[12.0, 168.0]);
    let joints = haply.transmission.angles(&readings);
    assert!(
        (joints[0] - 168f64.to_radians()).abs() < 1e-12
            && (joints[1] - 12f64.to_radians()).abs() < 1e-12
    );
    let mut torques = [0.0; MAX_AXES];
    torques[0] = 0.05;
    let (commands, _) = haply.transmission.commands(&torques, &[0.0; MAX_AXES]);
    assert_eq!((commands[0], commands[1]), (0.0, 0.05));
}

#[test]
fn a_spacemouse_is_looked_for_by_all_its_numbers() {
    let (_, mouse) = real("spacemouse");
    let matching = &mouse.matching;
    assert_eq!((matching.ids.len(), matching.usage_page, matching.usage), (14, Some(1), Some(8)));
    for id in &matching.ids {
        let mouse = DeviceFile {
            vendor_id: id.vendor,
            product_id: id.product,
            usages: vec![(1, 8)],
            ..DeviceFile::at(Path::new("/dev/hidraw0"))
        };
        assert!(
            matching.admits(&mouse)
                && !matching.admits(&DeviceFile { usages: vec![(1, 6)], ..mouse.clone() }),
            "{id:?}"
        );
    }
}

/// An arm of a known family and a layout of its own, as a user writes it who knows no Rust.
const NEW_ARM: &str = r#"
version = 1
[device]
name = "my-arm"
codec = "declarative"
kinematics = "serial-capstan"
sensed = ["x", "y", "z"]
actuated = ["x", "y", "z"]
signs_verified = false
[match]
transport = "serial"
by_id = "my-board"
baud = 1000000
[link]
pacing = "ping-pong"
device_watchdog_ms = 50
holds_last_command = false
current_limit_ma = [1000, 1000, 1000]
[packet.report]
framing = "sync"
sync_hex = "AA 55"
length = 8
checksum = "crc16-ccitt"
fields = [
  { role = "reading", index = 0, offset = 0, type = "i16", wraps = true },
  { role = "reading", index = 1, offset = 2, type = "i16", wraps = true },
  { role = "reading", index = 2, offset = 4, type = "i16", wraps = true },
]
[packet.command]
framing = "sync"
sync_hex = "AA 56"
length = 8
checksum = "crc16-ccitt"
fields = [
  { role = "motor", index = 0, offset = 0, type = "i16" },
  { role = "motor", index = 1, offset = 2, type = "i16" },
  { role = "motor", index = 2, offset = 4, type = "i16" },
]
[frame]
device_from_native = ["+x", "+y", "+z"]
[homing]
mode = "power-on-pose"
instruction = "Switch on with the arm folded."
[geometry]
length_mm = [50, 200, 200]
origin_m = [0.2, 0, 0.05]
counts_per_rev = [8192, 8192, 8192]
capstan_diameter_mm = [10, 10, 10]
body_diameter_mm = [100, 100, 100]
torque_constant_nm_per_a = [0.05, 0.05, 0.05]
encoder_sign = [1, 1, 1]
motor_sign = [1, 1, 1]
joint_offset_rad = [0, 0, 1.5707963267948966]
[limits]
force_n = 4
torque_nm = 0
stiffness_n_per_m = 500
damping_n_s_per_m = 4
workspace_radius_m = 0.1
[plant]
mass_kg = 0.2
damping_n_s_per_m = 1
inertia_kg_m2 = 2e-4
damping_nm_s_per_rad = 1e-3
coulomb_n = 0.05
coulomb_nm = 0
encoder_step_mm = 0.02
encoder_step_rad = 0
"#;

fn load_text(text: &str) -> Result<Profile, String> {
    let dir = tempfile::tempdir().expect("a folder");
    let path = dir.path().join("my-arm.toml");
    fs::write(&path, text).expect("written");
    load(&path)
        .map_err(|errors| errors.to_string().replace(&format!("{}/", dir.path().display()), ""))
}

#[test]
fn a_new_arm_needs_no_rust() {
    let profile = load_text(NEW_ARM).unwrap_or_else(|errors| panic!("{errors}"));
    let arm = profile.real.expect("a real arm");
    let Protocol::Declarative(layout) = &arm.protocol else { panic!("declarative") };
    assert_eq!((layout.n_readings(), layout.n_motors(), layout.watchdog_ms), (3, 3, Some(50)));
    // From readings to a position, and from a force to commands.
    let solved = arm
        .kinematics
        .solve(&arm.transmission.angles(&[0.0; MAX_AXES]), &Configuration::default())
        .expect("reachable");
    assert!(solved.native_from_grip.translation.distance(DVec3::new(0.0, 0.0, 0.2)) < 1e-12);
    let (commands, _) = arm
        .transmission
        .commands(&solved.torques(&Wrench::new(DVec3::X, DVec3::ZERO)), &[0.0; MAX_AXES]);
    assert!((commands[1] - 0.2 * 0.1 / 0.05 * 1e3).abs() < 1e-9, "{commands:?}");
    // The whole way over the wire, both sides: the command moves the twin's motors, its counters
    // become a position.
    let carriage = arm.protocol.carriages()[0];
    let mut codec = arm.protocol.codec(carriage);
    let mut firmware = arm.protocol.firmware(carriage);
    let mut frame = Frame::default();
    codec.encode(&MotorCommand::of(commands, true), &mut frame);
    let joints = arm
        .kinematics
        .inverse(&Pose::from_translation(DVec3::new(0.01, -0.02, 0.15)), &arm.kinematics.home())
        .expect("in reach");
    let readings = arm.transmission.readings(&joints).map(f64::round);
    let state =
        ArmReadings { readings, rates: [0.0; MAX_AXES], buttons: 0, homed: true, asleep: false };
    let mut out = Outbox::new();
    firmware.receive(frame.as_slice(), 0.0, &state, &mut out);
    for (made, command) in firmware.motors().iter().zip(commands) {
        assert_eq!(*made, command.trunc());
    }
    assert_eq!(out.iter().map(|bytes| codec.feed(bytes).reports).sum::<u32>(), 1);
    let solved = arm
        .kinematics
        .solve(&arm.transmission.angles(&codec.newest().readings), &Configuration::default())
        .expect("reachable");
    // A count is 0.08 mrad at a joint.
    assert!(solved.native_from_grip.translation.distance(DVec3::new(0.01, -0.02, 0.15)) < 2e-5);
}

#[test]
fn what_is_wrong_with_a_real_arm_is_said_at_once() {
    let text = NEW_ARM
        .replace("[\"+x\", \"+y\", \"+z\"]", "[\"+x\", \"+y\", \"-z\"]")
        .replace("encoder_sign = [1, 1, 1]", "encoder_sign = [1, 0, 1]")
        .replace("length_mm = [50, 200, 200]", "length_mm = [50, 200]\nrod_mm = 3")
        .replace("transport = \"serial\"", "transport = \"hid\"\nvendor_id = 1\nproduct_id = 2")
        .replace(
            "index = 2, offset = 4, type = \"i16\" }",
            "index = 2, offset = 5, type = \"i16\" }",
        )
        .replace("signs_verified = false\n", "");
    let errors = load_text(&text).expect_err("wrong");
    let expected = r#"error: my-arm.toml:3: device.signs_verified: missing; give false, until `hapticd devices probe PROFILE --sign-check` has passed on such an arm; force stays below 0.5 N until then
error: my-arm.toml:10: match.transport = "hid": must be "serial": `declarative` travels so
error: my-arm.toml:20: packet: must be sound: the command, field 2 ends behind the body, which has 6 places for fields
error: my-arm.toml:41: frame.device_from_native = ["+x", "+y", "-z"]: must be a proper rotation: each axis once, and a right-handed frame (turn one sign)
error: my-arm.toml:46: geometry.length_mm = [50, 200]: must be an array of 3 numbers, one for each joint
error: my-arm.toml:47: geometry.rod_mm = 3: must be left out: kinematics "serial-capstan" has none
error: my-arm.toml:53: geometry.encoder_sign[1] = 0: must be 1 or -1"#;
    assert_eq!(errors, expected);
}

#[test]
fn no_number_of_a_profile_switches_a_rule_off() {
    let chain = include_str!("../../devices/leader-arm-6.toml");
    let capstan = include_str!("../../devices/polhem-2022.toml");
    let hinges = include_str!("../../devices/examples/hinges.toml");
    for (text, from, to, ceiling) in [
        (NEW_ARM, "force_n = 4", "force_n = 1e9", "limits.force_n = 1e9: must be at most 100 N"),
        (NEW_ARM, "stiffness_n_per_m = 500", "stiffness_n_per_m = 1e9", "at most 100000 N/m"),
        (
            NEW_ARM,
            "stiffness_n_per_m = 500\n",
            "",
            "limits.stiffness_n_per_m: missing; give the largest stiffness",
        ),
        (NEW_ARM, "damping_n_s_per_m = 4", "damping_n_s_per_m = 1e9", "from 0 to 1000 N·s/m"),
        (NEW_ARM, "workspace_radius_m = 0.1", "workspace_radius_m = 5.1", "at most 5 m"),
        (NEW_ARM, "mass_kg = 0.2", "mass_kg = 1e9", "at most 100 kg"),
        (NEW_ARM, "damping_n_s_per_m = 1\n", "damping_n_s_per_m = 1e9\n", "from 0 to 1000 N·s/m"),
        (NEW_ARM, "inertia_kg_m2 = 2e-4", "inertia_kg_m2 = 1e9", "at most 10 kg·m²"),
        (NEW_ARM, "encoder_step_mm = 0.02", "encoder_step_mm = 1e9", "from 0 to 10 mm"),
        (NEW_ARM, "encoder_step_rad = 0", "encoder_step_rad = 1e9", "from 0 to 0.1 rad"),
        (
            NEW_ARM,
            "device_watchdog_ms = 50",
            "device_watchdog_ms = 4000000000",
            "a whole number from 1 to 10000",
        ),
        (
            NEW_ARM,
            "current_limit_ma = [1000",
            "current_limit_ma = [1e9",
            "link.current_limit_ma[0] = 1e9: must be greater than 0 and at most 50000 mA",
        ),
        (
            NEW_ARM,
            "torque_constant_nm_per_a = [0.05",
            "torque_constant_nm_per_a = [50.0",
            "would make 500 N·m at the joint, and 100 is the most",
        ),
        (chain, "mass_g = 140.0", "mass_g = 1e9", "from 0 to 10000 g"),
        (
            hinges,
            "limit_counts = 1500.0",
            "limit_counts = 1e9",
            "limit_counts = 1e9: must be at most 100000: with the constants beside it",
        ),
        (
            capstan,
            "link_mass_g = [157.64",
            "link_mass_g = [1e9",
            "geometry.link_mass_g[0] = 1e9: must be from 0 to 10000 g",
        ),
        (capstan, "current_scale = 1.0", "current_scale = 1e9", "from 0.1 to 10"),
    ] {
        assert!(text.contains(from), "{from}");
        let errors = load_text(&text.replacen(from, to, 1)).expect_err(to);
        assert!(errors.contains(ceiling), "{to}: {errors}");
    }
}

#[test]
fn more_is_sensed_than_the_joints_determine_is_refused() {
    let text =
        NEW_ARM.replace("sensed = [\"x\", \"y\", \"z\"]", "sensed = [\"x\", \"y\", \"z\", \"rx\"]");
    let errors = load_text(&text).expect_err("no wrist");
    assert!(
        errors.contains(
            "device.sensed = [\"x\", \"y\", \"z\", \"rx\"]: must be a subset of x \
        y z, which is what"
        ),
        "{errors}"
    );
    let text = NEW_ARM.replace("codec = \"declarative\"", "codec = \"openffboard-hid\"");
    let errors = load_text(&text).expect_err("not driven");
    assert!(
        errors.contains("not available in this version; an arm with firmware of one's own speaks"),
        "{errors}"
    );
    let text = NEW_ARM.replace("codec = \"declarative\"", "codec = \"sim\"");
    let errors = load_text(&text).expect_err("a simulated arm has no match");
    assert!(
        errors.contains("match: must be left out: a simulated arm")
            && errors.contains("device.kinematics"),
        "{errors}"
    );
}
