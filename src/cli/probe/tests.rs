//! What is said of an arm, by what was found of it.

use std::path::Path;

use clap::Parser;
use glam::DVec3;

use super::*;

#[derive(Debug, Parser)]
struct Command {
    #[command(flatten)]
    args: Args,
}

/// What is said of an arm of which that was found.
fn reported(
    line: &str,
    found: &ProbeResult,
    ended: Option<ProbeEnd>,
    declared: Option<DeclaredLimits>,
) -> Vec<Finding> {
    let args = Command::try_parse_from(["probe"].into_iter().chain(line.split_whitespace()))
        .expect("valid")
        .args;
    let profile = profile::find(&args.profile, Path::new("")).expect("shipped");
    let real = profile.real.as_ref().expect("a real arm");
    ProbeReport {
        profile: &profile,
        real,
        args: &args,
        found,
        ended,
        identity: None,
        notice: None,
        declared,
        refused: 0,
    }
    .findings()
}

fn row<'f>(findings: &'f [Finding], name: &str) -> &'f Finding {
    findings
        .iter()
        .find(|finding| finding.name == name)
        .unwrap_or_else(|| panic!("{name}: {findings:?}"))
}

fn at(position_m: DVec3) -> ProbeResult {
    let answers = Answers { ticks: 100, fresh: 100, homed: true, position_m, ..Answers::default() };
    ProbeResult { answers, ..ProbeResult::default() }
}

#[test]
fn a_place_beyond_the_workspace_is_not_ok() {
    let position =
        |profile, x_m| row(&reported(profile, &at(DVec3::X * x_m), None, None), "position").clone();
    assert_eq!(position("open6-serial", 0.1).standing, Standing::Good);
    let far = position("open6-serial", 374.0);
    assert_eq!(far.standing, Standing::Bad);
    let said = "374.000 m from the origin, the workspace is 0.12 m: units, scale, home_counts or \
        park pose?";
    assert!(far.found.contains(said) && far.by_hand, "{far:?}");
    // Its park pose is out there, and no fault.
    assert_eq!(position("polhem-2022", 0.23).standing, Standing::Advice);
    assert_eq!(position("polhem-2022", 0.6).standing, Standing::Bad);
    assert_eq!(position("spacemouse", 3.0).standing, Standing::Good, "a rate input has no place");
}

#[test]
fn what_no_sample_said_is_not_known() {
    let nothing = ProbeResult {
        answers: Answers { ticks: 1000, ..Answers::default() },
        ..ProbeResult::default()
    };
    let findings = reported("open6-serial", &nothing, None, None);
    let standing = |name| row(&findings, name).standing;
    assert_eq!(
        (standing("answers"), standing("arm"), standing("position")),
        (Standing::Bad, Standing::Unknown, Standing::Unknown)
    );
}

#[test]
fn all_is_right_when_every_axis_was_pushed() {
    let mut found = at(DVec3::ZERO);
    found.signs[..3].fill(Some(Sign::Right));
    let is_all = |profile: &str, found: &ProbeResult| {
        let findings = reported(&format!("{profile} --sign-check"), found, None, None);
        findings.iter().any(|finding| finding.found.contains("signs_verified = true"))
    };
    assert!(
        is_all("polhem-2022", &found) && !is_all("open6-serial", &found),
        "three rotations were not pushed"
    );
    found.signs.fill(Some(Sign::Right));
    assert!(is_all("open6-serial", &found));
    found.signs[4] = Some(Sign::Still);
    assert!(!is_all("open6-serial", &found));
}

#[test]
fn why_nothing_was_pushed_is_said() {
    let end = |ended, name: &str| {
        row(&reported("leader-arm-6 --sign-check", &at(DVec3::ZERO), Some(ended), None), name)
            .clone()
    };
    let not_homed = end(ProbeEnd::NotHomed, "not homed");
    assert_eq!((not_homed.standing, not_homed.found.as_str()), (Standing::Bad, "nothing pushed"));
    assert_eq!(not_homed.advice_lines().collect::<Vec<_>>(), ["do:   home it"]);
    let watchdog = end(ProbeEnd::Watchdog(61), "watchdog");
    assert!(
        watchdog
            .found
            .contains("no command for 61 ms, and its watchdog waits for 40 ms; nothing pushed"),
        "{watchdog:?}"
    );
    let moves = end(ProbeEnd::Moves(1240, 300), "moves by itself");
    assert!(
        moves.standing == Standing::Bad && moves.found.contains("1.24 m/s and 0.3 rad/s"),
        "{moves:?}"
    );
    assert!(
        end(ProbeEnd::Reports(0x0380), "arm's error").found.contains("servo 3: hardware alert")
    );
}

#[test]
fn a_profile_that_asks_for_more_than_the_arm_has_is_reported() {
    let has = DeclaredLimits {
        rate_hz: 1000,
        force_n: 4.0,
        torque_nm: f64::from(0.2_f32),
        workspace_radius_m: f64::from(0.12_f32),
    };
    let findings = reported("open6-serial", &at(DVec3::ZERO), None, Some(has));
    assert_eq!(
        row(&findings, "profile asks more").found,
        "limits.force_n = 8, the arm has 4.0000 N"
    );
    let enough = reported(
        "open6-serial",
        &at(DVec3::ZERO),
        None,
        Some(DeclaredLimits { force_n: 8.0, ..has }),
    );
    assert!(enough.iter().all(|finding| finding.name != "profile asks more"));
}

#[test]
fn a_command_that_is_named_works_for_a_profile_of_ones_own() {
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path().join("mine.toml");
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("devices/open6-serial.toml");
    std::fs::copy(shipped, &path).expect("copied");
    let mine = profile::find("./mine.toml", folder.path()).expect("sound");
    let typed = command(&mine, Some(&"/tmp/arm".parse().expect("a path")), "--identify");
    assert_eq!(
        typed,
        format!(
            "hapticd devices probe {}/./mine.toml --selector /tmp/arm --identify",
            folder.path().display()
        )
    );
    let shipped = profile::find("open6-serial", folder.path()).expect("shipped");
    assert_eq!(
        command(&shipped, None, "--sign-check"),
        "hapticd devices probe open6-serial --sign-check"
    );
}
