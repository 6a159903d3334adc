//! Every shipped profile and scene loads, and says what it must.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use arms::profile::{self, Profile, ProfileError};
use hapticd::config::{self, ProblemKind};
use vps::spatial::Axes;

const ROOT: &str = env!("CARGO_MANIFEST_DIR");

fn toml_files(folder: &str) -> Vec<PathBuf> {
    let entries = match fs::read_dir(Path::new(ROOT).join(folder)) {
        Ok(entries) => entries,
        Err(_) => return Vec::new(),
    };
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    paths.retain(|path| path.extension().is_some_and(|extension| extension == "toml"));
    paths.sort();
    paths
}

fn shipped() -> Vec<Profile> {
    profile::names().map(|name| profile::find(name, Path::new("")).unwrap()).collect()
}

#[test]
fn every_profile_file_is_embedded_under_its_own_name() {
    let files: BTreeSet<String> = toml_files("devices")
        .iter()
        .map(|path| path.file_stem().unwrap().to_string_lossy().into_owned())
        .collect();
    let embedded: BTreeSet<String> = profile::names().map(str::to_owned).collect();
    assert_eq!(files, embedded);
    for path in toml_files("devices") {
        let name = path.file_stem().unwrap().to_string_lossy().into_owned();
        let loaded = profile::load(&path).unwrap_or_else(|errors| panic!("{errors}"));
        assert_eq!(loaded.name, name);
        let embedded = profile::find(&name, Path::new("")).unwrap();
        // The same but for where it came from.
        assert_eq!(Profile { source: None, ..loaded }, embedded);
    }
}

/// b = 1.25 K (T/2 + delay T): the declared stiffness meets the stability rule at 1 kHz, and
/// nothing above it does.
#[test]
fn simulated_plants_are_consistent_with_what_they_declare() {
    let period_s = 1e-3;
    for profile in shipped() {
        let lag_s = period_s * (0.5 + f64::from(profile.plant.delay_ticks));
        let pairs = [
            (profile.limits.stiffness_n_per_m, profile.plant.damping_n_s_per_m),
            (profile.limits.stiffness_nm_per_rad, profile.plant.damping_nm_s_per_rad),
        ];
        for (stiffness, damping) in pairs {
            if let Some(stiffness) = stiffness {
                assert!(
                    (damping / (1.25 * stiffness * lag_s) - 1.0).abs() < 1e-12,
                    "{}: b = {damping}",
                    profile.name
                );
            }
        }
    }
}

#[test]
fn the_axes_are_those_of_the_products() {
    let axes = |name: &str| {
        let profile = profile::find(name, Path::new("")).unwrap();
        (profile.sensed.count(), profile.actuated.count())
    };
    assert_eq!(axes("sim-sigma7"), (7, 7));
    assert_eq!(axes("sim-premium15-6dof"), (6, 6));
    assert_eq!(axes("sim-touch"), (6, 3));
    assert_eq!(axes("sim-polhem"), (6, 3));
    assert_eq!(axes("sim-ideal"), (6, 6));
    assert_eq!(axes("sim-omega7"), (7, 4));
    assert_eq!(axes("sim-2diy"), (2, 2));
    assert_eq!(axes("polhem-2022"), (6, 3));
    assert_eq!(axes("woodenhaptics-v15"), (3, 3));
    assert_eq!(axes("leader-arm-6"), (6, 6));
    assert_eq!(axes("spacemouse"), (6, 0));
    assert_eq!(profile::find("sim-touch", Path::new("")).unwrap().actuated, Axes::TRANSLATION);
}

#[test]
fn every_key_of_a_shipped_profile_has_a_comment_or_names_itself() {
    for path in toml_files("devices") {
        for line in fs::read_to_string(&path)
            .unwrap()
            .lines()
            .filter(|line| line.contains(" = ") && !line.starts_with('#'))
        {
            let names_itself = ["version", "title", "sensed", "actuated", "instruction"]
                .iter()
                .any(|key| line.starts_with(key));
            assert!(line.contains(" # ") || names_itself, "{}: {line}", path.display());
        }
    }
}

/// A program that embeds the loop holds an arm to what this one holds it to.
#[test]
fn a_scene_that_says_nothing_of_an_arm_has_the_rules_of_the_engine() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.toml");
    for profile in shipped() {
        let rate_hz = profile.link.rate_hz.min(1000);
        let text = format!(
            "version = 1\nname = \"plain\"\n[rendering]\nrate_hz = {rate_hz}\n[tool]\n\
             shape = {{ sphere_mm = 10.0 }}\nvoxel_size_mm = 1.0\nmass_g = 100.0\n\
             [device]\nprofile = \"{}\"\n",
            profile.name
        );
        fs::write(&path, text).unwrap();
        let scene = config::load(&path).unwrap_or_else(|errors| panic!("{errors}")).parameters;
        let rules = engine::arm_rules::parameters(&profile, 1.0 / f64::from(rate_hz));
        let name = &profile.name;
        assert_eq!(scene.limits, rules.limits, "{name}");
        assert_eq!(scene.safety, rules.safety, "{name}");
        assert_eq!(scene.coupling, rules.coupling, "{name}");
        assert_eq!(scene.arm, rules.arm, "{name}");
        assert_eq!(
            (scene.mapping.sensed, scene.mapping.actuated),
            (rules.mapping.sensed, rules.mapping.actuated),
            "{name}"
        );
    }
}

#[test]
fn a_profile_is_found_by_path_from_the_scene() {
    let found = profile::find("devices/sim-touch.toml", Path::new(ROOT)).unwrap();
    assert_eq!(found.name, "sim-touch");
    assert!(matches!(
        profile::find("./sim-none.toml", Path::new(ROOT)),
        Err(ProfileError::FileMissing { .. })
    ));
    let Err(ProfileError::Unknown { nearest, .. }) = profile::find("sim-sigma", Path::new(ROOT))
    else {
        panic!("found")
    };
    assert_eq!(nearest.as_deref(), Some("sim-sigma7"));
}

#[test]
fn a_profile_of_another_codec_is_refused_before_its_tables_are_read() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("wheel.toml");
    fs::write(&path, "version = 1\n[device]\ncodec = \"openffboard-hid\"\n[wheel]\nport = 10001\n")
        .unwrap();
    let errors = profile::load(&path).unwrap_err();
    assert_eq!(errors.problems().len(), 1);
    assert!(matches!(errors.problems()[0].kind, ProblemKind::NotAvailable { .. }), "{errors}");
}

#[test]
fn a_wrong_profile_reports_all_its_problems() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("x.toml");
    let text = fs::read_to_string(Path::new(ROOT).join("devices/sim-touch.toml")).unwrap();
    let text = text
        .replace("torque_nm = 0.0", "torque_nm = 0.1")
        .replace("mass_kg = 0.1 ", "mass_kg = -1  ");
    let text = text.replace("actuated = [\"x\"", "actuated = [\"u\", \"x\"");
    fs::write(&path, text).unwrap();
    let errors = profile::load(&path)
        .unwrap_err()
        .to_string()
        .replace(&format!("{}/", dir.path().display()), "");
    let expected = r#"error: x.toml:12: device.actuated[0] = "u": must be "x", "y", "z", "rx", "ry", "rz" or "grip"
error: x.toml:22: limits.torque_nm = 0.1: must be 0: device.actuated names none of its axes
error: x.toml:32: plant.mass_kg = -1: must be greater than 0 and at most 100 kg"#;
    assert_eq!(errors, expected);
}

#[test]
fn every_shipped_scene_loads() {
    for path in toml_files("config/scenes").into_iter().chain(toml_files("config/clay")) {
        if let Err(errors) = config::load(&path) {
            panic!("{errors}");
        }
    }
}

#[test]
fn profiles_to_copy_are_sound() {
    let examples = toml_files("devices/examples");
    assert!(!examples.is_empty());
    for path in examples {
        let loaded = profile::load(&path).unwrap_or_else(|errors| panic!("{errors}"));
        assert!(
            loaded.has_unverified_signs() && loaded.is_unidentified(),
            "{}: it is unchecked",
            path.display()
        );
        assert_eq!(loaded.plausibility_warnings(), [""; 0], "{}", path.display());
    }
    for name in profile::names() {
        let shipped = profile::find(name, Path::new("")).unwrap_or_else(|error| panic!("{error}"));
        assert_eq!(shipped.plausibility_warnings(), [""; 0], "{name}");
    }
}

#[test]
fn a_line_that_is_too_slow_for_the_rate_is_doubted() {
    let dir = tempfile::tempdir().unwrap();
    let doubts_of = |profile: &str, from: &str, to: &str| {
        let text = fs::read_to_string(Path::new(ROOT).join("devices").join(profile)).unwrap();
        assert!(text.contains(from), "{from}");
        let file = dir.path().join("arm.toml");
        fs::write(&file, text.replace(from, to)).unwrap();
        profile::load(&file).unwrap_or_else(|errors| panic!("{errors}")).plausibility_warnings()
    };
    // 38 and 62 bytes of ten bits each, a thousand times a second, fill 1 Mbaud.
    let doubts = doubts_of("open6-serial.toml", "baud = 2000000", "baud = 1000000");
    let expected = "match.baud = 1000000 does not carry 1000 exchanges of 100 bytes per second: a \
        UART needs 1250000 or more";
    assert!(doubts.len() == 1 && doubts[0].starts_with(expected), "{doubts:?}");
    assert_eq!(doubts_of("open6-serial.toml", "rate_hz = 1000", "rate_hz = 500"), [""; 0]);
    let doubts = doubts_of("leader-arm-6.toml", "baud = 4000000", "baud = 1000000");
    assert!(doubts.len() == 1 && doubts[0].contains("exchanges of 178 bytes"), "{doubts:?}");
    let doubts = doubts_of("examples/hinges.toml", "baud = 1000000", "baud = 115200");
    assert!(doubts.len() == 1 && doubts[0].contains("exchanges of 19 bytes"), "{doubts:?}");
}

#[test]
fn an_arm_that_cannot_move_as_it_says_is_doubted() {
    let hinges = fs::read_to_string(Path::new(ROOT).join("devices/examples/hinges.toml")).unwrap();
    let without_checks = &hinges[..hinges.find("[[check]]").unwrap()];
    let dir = tempfile::tempdir().unwrap();
    let doubts_of = |from: &str, to: &str| {
        assert!(without_checks.contains(from), "{from}");
        let file = dir.path().join("arm.toml");
        fs::write(&file, without_checks.replace(from, to)).unwrap();
        profile::load(&file).unwrap_or_else(|errors| panic!("{errors}")).plausibility_warnings()
    };
    let no_check =
        "no [[check]]: nothing holds geometry and signs against a position that you know";
    assert_eq!(doubts_of("version = 1", "version = 1"), [no_check]);
    let stretched = "at home the motors cannot push along x: the arm is stretched out or folded \
        there, and a joint without `home_rad` stands at 0";
    assert_eq!(doubts_of("home_rad = ", "home_rad = 0.0 # "), [no_check, stretched]);
    let away = "at home the grip is 253 mm from the origin, outside of `workspace_radius_m` = 0.1: \
        the origin is the middle of the workspace";
    assert_eq!(
        doubts_of("grip_position_m = [0.05, 0.0, 0.0]", "grip_position_m = [0.05, 0.253, 0.0]"),
        [no_check, away]
    );
    let nowhere =
        "the motors push along y nowhere: `axis` of a joint is wrong, or a motor is missing";
    assert_eq!(doubts_of("axis = [0, 0, 1]", "axis = [0, 1, 0]"), [no_check, nowhere]);
}

#[test]
fn a_profile_and_a_scene_in_each_others_place_are_reported_apart() {
    let said = |errors: config::ConfigErrors| {
        errors.problems().iter().map(ToString::to_string).collect::<Vec<_>>().join("\n")
    };
    let scene = Path::new(ROOT).join("config/scenes/block-on-plane.toml");
    let arm = Path::new(ROOT).join("devices/open6-hid.toml");
    assert!(
        said(config::load(&arm).unwrap_err())
            .ends_with("open6-hid.toml: this is a device profile, not a scene")
    );
    assert!(
        said(profile::load(&scene).unwrap_err())
            .ends_with("block-on-plane.toml: this is a scene, not a device profile")
    );
}
