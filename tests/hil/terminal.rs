//! Arms behind a library of their maker at a terminal: what a person types, over the stand-ins, and
//! what is said.

use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, Instant};

use arms::profile;
use serde_json::Value;

use super::link::{root, turn};
use super::maker::{self, built_example, shipped, worker_of};

const HAPTICD: &str = env!("CARGO_BIN_EXE_hapticd");
const PATIENCE: Duration = Duration::from_secs(20);
/// What a link that a busy machine makes late may cost of the identified mass.
const MASS_ERROR_MAX: f64 = 0.3;

/// A mock arm of a profile, and the environment in which its maker's stand-in finds it.
struct Arm {
    /// Its name, or the file of a copy.
    profile: String,
    mock: maker::Arm,
    library: Option<(&'static str, PathBuf)>,
    faults: String,
}

/// The stand-in of a profile's library, which `cargo test` builds with the tests, and the variable
/// that names it.
fn library(profile: &str) -> (&'static str, PathBuf) {
    let (variable, name) = match profile {
        "touch" => ("HAPTICD_LIBHD", "mock_hd"),
        "virtuose-6d" => ("HAPTICD_LIBVIRTUOSE", "mock_virtuose"),
        _ => ("HAPTICD_LIBDRD", "mock_drd"),
    };
    (variable, built_example(&format!("lib{name}.so")))
}

/// A command of the program as a user without libraries has it: nothing of the environment of these
/// tests is in it.
fn hapticd(home: &Path, args: &[&str]) -> Command {
    let mut command = Command::new(HAPTICD);
    command
        .args(args)
        .env_clear()
        .env("PATH", "/usr/bin:/bin")
        .env("NO_COLOR", "1")
        .env("HOME", home)
        .stdin(Stdio::null());
    command
}

impl Arm {
    fn new(name: &str, faults: &str) -> Self {
        let profile = shipped(name);
        let mock = maker::Arm::on_a_cable(&profile, None, &[]);
        Self {
            profile: name.to_owned(),
            mock,
            library: Some(library(name)),
            faults: faults.to_owned(),
        }
    }

    /// An Inverse3 behind a mock of its maker's service.
    fn served() -> Self {
        let profile = shipped("inverse3");
        let (mock, address) = maker::Arm::behind_a_service(&profile, "3.5.0", None, &[]);
        let text = std::fs::read_to_string(root("devices/inverse3.toml")).expect("shipped");
        let copy = mock.folder().join("inverse3.toml");
        std::fs::write(&copy, text.replace("127.0.0.1:10001", &address)).expect("written");
        Self {
            profile: copy.to_string_lossy().into_owned(),
            mock,
            library: None,
            faults: String::new(),
        }
    }

    fn command(&self, args: &[&str]) -> Command {
        let mut command = hapticd(self.mock.folder(), args);
        command.env("HAPTICD_MOCK_ARM", self.mock.link()).env("HAPTICD_MOCK_FAULT", &self.faults);
        command.envs(self.library.iter().map(|(variable, path)| (variable, path)));
        command
    }

    /// Exit code, the JSON object or null, and what was said on stderr.
    fn probe(&self, more: &[&str]) -> (Option<i32>, Value, String) {
        let args =
            [&["devices", "probe", &self.profile, "--duration", "200ms", "--json"], more].concat();
        let Output { status, stdout, stderr } = self.command(&args).output().expect("runs");
        let json = serde_json::from_slice(&stdout).unwrap_or(Value::Null);
        (status.code(), json, String::from_utf8_lossy(&stderr).into_owned())
    }

    /// Whether the motors of the mock arm make a force now.
    fn pushes(&self) -> bool {
        let text = std::fs::read_to_string(self.mock.folder().join("trace")).unwrap_or_default();
        let last = text
            .lines()
            .skip(1)
            .filter_map(|line| line.split(',').nth(1)?.parse::<f64>().ok())
            .last();
        last.is_some_and(|force_n| force_n > 0.0)
    }

    fn comes_to(&self, pushes: bool) {
        let begin = Instant::now();
        while self.pushes() != pushes {
            assert!(begin.elapsed() < PATIENCE, "force is {}", !pushes);
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}

/// What was found under a name.
fn found<'j>(json: &'j Value, name: &str) -> &'j str {
    let findings = json["findings"].as_array().map(Vec::as_slice).unwrap_or_default();
    let row = findings.iter().find(|row| row["name"] == name);
    row.and_then(|row| row["found"].as_str()).unwrap_or_else(|| panic!("no {name}: {json}"))
}

#[test]
fn a_library_that_is_missing_is_reported_as_a_list_and_other_wrong_ones_by_what_they_are() {
    let home = tempfile::tempdir().expect("a folder");
    let said = |variables: &[(&str, &str)], more: &[&str]| {
        let args = [&["devices", "probe", "omega7"], more].concat();
        let output =
            hapticd(home.path(), &args).envs(variables.iter().copied()).output().expect("runs");
        assert_eq!(output.status.code(), Some(5), "{variables:?} {more:?}");
        String::from_utf8_lossy(&output.stderr).into_owned()
    };
    let missing = said(&[("FDSDK", ""), ("HAPTICD_LIBDRD", "")], &[]);
    let lines: Vec<&str> = missing.lines().collect();
    assert_eq!(
        lines[0], "error: the omega.7 (Force Dimension): its library is in none of 4 folders",
        "{missing}"
    );
    assert!(lines[1].starts_with("  hint: looked for libdrd.so.3"), "{missing}");
    assert!(
        lines[2].trim() == home.path().join(".local/lib").to_string_lossy()
            && lines[3].trim() == "/usr/local/lib",
        "{missing}"
    );
    assert!(
        lines.iter().all(|line| line.len() < 240) && missing.contains("export FDSDK="),
        "{missing}"
    );

    let text = home.path().join("libdrd.so.3");
    std::fs::write(&text, "no library").expect("written");
    let text = text.to_string_lossy().into_owned();
    for (variables, more, words) in [
        (&[("HAPTICD_LIBDRD", "/no/libdrd.so.3")][..], &[][..], "there is no /no/libdrd.so.3"),
        (&[("HAPTICD_LIBDRD", text.as_str())], &[], "libdrd.so.3 is no library"),
        (&[], &["--selector", text.as_str()], "libdrd.so.3 is no library"),
        (&[], &["--selector", text.as_str(), "--home"], "libdrd.so.3 is no library"),
        (&[], &["--selector", "/dev/ttyACM0"], "a path names the library of its maker"),
        (
            &[],
            &["--selector", "16c0:0483"],
            "16c0:0483 does not choose the omega.7 (Force Dimension): the USB vendor of its maker \
                is 1451",
        ),
    ] {
        let said = said(variables, more);
        assert!(said.contains(words) && !said.contains("moves by itself"), "{words}: {said}");
    }
    let args = ["devices", "probe", "inverse3", "--selector", "1:2"];
    let served = hapticd(home.path(), &args).output().expect("runs");
    assert!(
        String::from_utf8_lossy(&served.stderr)
            .contains("under [protocol] of a copy of the profile")
    );
}

#[test]
fn an_arm_is_chosen_by_its_serial_number_and_finds_its_zero_only_when_that_is_typed() {
    let _turn = turn();
    // Over a tty, as a person would try it.
    let profile = shipped("omega7");
    let mut arm = Arm {
        mock: maker::Arm::on_a_tty(&profile, None, &[]),
        ..Arm::new("omega7", "uninitialised")
    };
    let (code, _, said) = arm.probe(&[]);
    assert!(code == Some(5) && said.contains("hapticd devices probe PROFILE --home"), "{said}");
    let (code, json, said) = arm.probe(&["--home"]);
    assert!(
        code == Some(0)
            && json["homed"] == true
            && said.contains("moves by itself now, until it has found it"),
        "{json}\n{said}"
    );

    arm.faults = "gripper".to_owned();
    let (code, right, said) = arm.probe(&["--selector", "1451:0402:1"]);
    assert!(
        code == Some(0)
            && right["path"].as_str().is_some_and(|path| path.contains("serial number 1")),
        "{right}\n{said}"
    );
    let (code, _, said) = arm.probe(&["--selector", "1451:0402:7"]);
    assert!(code == Some(5) && said.contains("no arm with serial number 7"), "{said}");
    // The gripper of a left-handed arm counts the other way, and opens the same way.
    arm.faults = "gripper,left-handed".to_owned();
    let (_, left, said) = arm.probe(&[]);
    assert!(
        left["path"].as_str().is_some_and(|path| path.contains("left-handed")),
        "{left}\n{said}"
    );
    let angle = |json: &Value| json["grip_rad"].as_f64().expect("measured");
    assert!(angle(&right) > 0.25 && (angle(&right) - angle(&left)).abs() < 0.02, "{right}\n{left}");
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn a_probe_that_is_ended_while_the_arm_finds_its_zero_stops_the_arm() {
    let _turn = turn();
    // A script in the background has its programs ignore interrupts.
    for (signal, shell) in [("INT", ""), ("INT", "trap '' INT; "), ("KILL", "")] {
        let arm = Arm::new("omega7", "slow-init");
        let as_typed = arm.command(&[]);
        let mut probe = Command::new("sh");
        probe
            .args(["-c", &format!("{shell}exec \"$0\" devices probe omega7 --home"), HAPTICD])
            .env_clear();
        probe
            .envs(as_typed.get_envs().filter_map(|(name, value)| Some((name, value?))))
            .stdin(Stdio::null());
        let mut probe = probe.stdout(Stdio::null()).stderr(Stdio::null()).spawn().expect("starts");
        arm.comes_to(true);
        let begin = Instant::now();
        let pid = probe.id().to_string();
        assert!(
            Command::new("kill")
                .args([&format!("-{signal}"), &pid])
                .status()
                .expect("kill")
                .success()
        );
        arm.comes_to(false);
        // By itself it would go on for 3 s.
        assert!(begin.elapsed() < Duration::from_millis(1500), "{signal}: {:?}", begin.elapsed());
        probe.wait().expect("ours");
    }
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn a_library_that_hangs_ends_soon_after_the_program_that_was_killed() {
    let _turn = turn();
    let arm = Arm::new("omega7", "hang");
    let link = arm.mock.link();
    let mut probe = arm
        .command(&["devices", "probe", "omega7", "--duration", "60s"])
        .stderr(Stdio::null())
        .spawn()
        .expect("starts");
    let comes_to = |is_there: bool| {
        let begin = Instant::now();
        while worker_of(&link).is_some() != is_there {
            assert!(
                begin.elapsed() < PATIENCE,
                "the worker is {}",
                if is_there { "not there" } else { "still there" }
            );
            std::thread::sleep(Duration::from_millis(20));
        }
    };
    comes_to(true);
    // Time enough to open the library, and to hang in it.
    std::thread::sleep(Duration::from_secs(1));
    comes_to(true);
    probe.kill().expect("ours");
    probe.wait().expect("ours");
    comes_to(false);
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn every_makers_arm_is_listed_and_passes_the_sign_check_and_the_identification() {
    let _turn = turn();
    // Each probe enters real time by itself, for its trials alone: what moved is fitted at the
    // priority of this test.
    std::thread::scope(|scope| {
        scope.spawn(|| {
            listed_and_probed("force-dimension", "omega.7 (mock)", || Arm::new("omega7", ""))
        });
        scope.spawn(|| listed_and_probed("haply-service", "", Arm::served));
        scope.spawn(|| listed_and_probed("open-haptics", "Mock Touch", || Arm::new("touch", "")));
        scope.spawn(|| {
            listed_and_probed("virtuose", "Virtuose of type 0", || Arm::new("virtuose-6d", ""))
        });
    });
}

fn listed_and_probed(codec: &str, identity: &str, new_arm: impl Fn() -> Arm) {
    let arm = new_arm();
    if arm.library.is_some() {
        let listed = arm.command(&["devices", "--json", "list"]).output().expect("runs");
        let listed: Value = serde_json::from_slice(&listed.stdout).expect("JSON");
        let mut libraries = listed["libraries"].as_array().expect("a list").iter();
        let own = libraries
            .find(|library| library["codec"] == codec)
            .unwrap_or_else(|| panic!("{codec}: {listed}"));
        assert!(
            own["profiles"]
                .as_array()
                .is_some_and(|profiles| profiles.contains(&arm.profile.clone().into())),
            "{own}"
        );
    }
    let probe = |arm: &Arm| arm.probe(&["--sign-check", "--identify", "--yes"]);
    let mut probed = probe(&arm);
    // A machine that is busy ends a probe like an arm that has gone. The next arm begins where an
    // arm begins, not where that one was pushed to.
    for _ in 0..2 {
        if probed.1["ended_early"] != Value::Null {
            probed = probe(&new_arm());
        }
    }
    let (code, json, said) = probed;
    assert_eq!(code, Some(0), "{codec}: {json}\n{said}");
    assert!(
        json["path"].as_str().is_some_and(|path| path.contains(identity))
            && found(&json, "signs").starts_with("all right"),
        "{json}"
    );
    // The mock arm has the mass that its profile says.
    let here = Path::new("");
    let true_kg = profile::find(&arm.profile, here).expect("there").plant.mass_kg;
    for axis in json["identified"].as_array().expect("three axes") {
        let mass_kg =
            axis["mass_kg"].as_f64().unwrap_or_else(|| panic!("{codec} did not move: {json}"));
        assert!(
            (mass_kg / true_kg - 1.0).abs() < MASS_ERROR_MAX,
            "{codec}: {mass_kg} of {true_kg} kg: {json}"
        );
    }
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn why_the_motors_make_less_or_nothing_is_reported_by_name() {
    let _turn = turn();
    let mut arm = Arm::new("omega6", "saturated");
    let (_, _, said) = arm.probe(&["--sign-check", "--yes"]);
    assert!(said.contains("device: its motors are at their limits"), "{said}");
    for (fault, words) in [
        ("watchdog", "its own watchdog has switched its forces off"),
        ("software", "were switched off by a program"),
        ("usb", "its USB cable was out"),
        ("dead-man", "its dead-man's switch is open"),
    ] {
        arm.faults = fault.to_owned();
        // On a machine that is busy a worker may not open its arm in time: then there is nothing to
        // read yet.
        let mut probes = core::iter::repeat_with(|| arm.probe(&["--sign-check", "--yes"])).take(3);
        let (code, json, said) =
            probes.find(|(_, json, _)| !json.is_null()).expect("the arm never opened");
        assert!(
            code == Some(5) && found(&json, "arm's error").contains(words),
            "{fault}: {json}\n{said}"
        );
    }
}
