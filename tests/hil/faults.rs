//! The safety table over a real transport: something goes wrong at the arm while it is pressed
//! against the plane, and the arm says when its motors stopped.

use std::time::Duration;

use super::link::{Bench, exchange, repeat};

/// When the hand presses the block onto the plane, s after the host's first frame: the hand begins
/// after one second.
const WRONG_AT: &str = "2600ms";
/// Periods in which a host that says zero in its next tick is heard: a reply on the way, a tick, a
/// frame on the way.
const AT_ONCE_TICKS: f64 = 4.0;
const STALE_TICKS: f64 = 20.0;

/// Injects a fault into an open6 arm while it pushes, and expects one of these sets of faults and
/// zero force within `ticks`.
fn ends_in(fault: &str, expected: &[&[&str]], ticks: f64) {
    ends_in_with(&["--fault", &format!("{fault}@{WRONG_AT}")], expected, ticks);
}

fn ends_in_with(mock_args: &[&str], expected: &[&[&str]], ticks: f64) {
    let (host, mock) =
        exchange(&Bench::viscous(), mock_args, &["--enable", "--duration", "6s"], expected);
    let said = format!("{}\n{}\n{}", host.json, host.stderr, mock.json);
    assert!(
        host.code() == Some(7) && expected.iter().any(|faults| host.faults() == *faults),
        "{said}"
    );
    let felt = &mock.json["faults"][0];
    assert!(
        felt["force_before_n"].as_f64().is_some_and(|force_n| force_n > 0.3),
        "it pushed before: {said}"
    );
    let zero_after = felt["zero_after_ticks"]
        .as_f64()
        .unwrap_or_else(|| panic!("the motors never stopped: {said}"));
    // What the machine itself was late is not the host's doing.
    let lateness = host.number("missed_deadlines") + mock.number("late_periods");
    assert!(zero_after <= ticks + lateness, "{zero_after} ticks: {said}");
    assert_eq!(felt["force_again_after_ticks"].as_f64(), None, "no force comes back: {said}");
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn a_sample_that_is_no_number() {
    ends_in("nan", &[&["non-finite"]], AT_ONCE_TICKS);
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn a_jump_of_the_position() {
    // The velocity is the arm's own word, so `speed` is not among the faults.
    ends_in("jump", &[&["position-jump"]], AT_ONCE_TICKS);
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn silence() {
    ends_in("stall", &[&["stale"]], STALE_TICKS + AT_ONCE_TICKS);
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn garbage() {
    // The marks between frames are garbled too, so it depends on chance whether frames are bad or
    // missing.
    ends_in("garbage", &[&["stale"], &["protocol"]], STALE_TICKS + AT_ONCE_TICKS);
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn frames_cut_short() {
    // Half a frame of a stream has no end: what is cut is not garbled but missing.
    ends_in("truncate", &[&["stale"]], STALE_TICKS + AT_ONCE_TICKS);
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn the_plug_is_pulled() {
    // The arm receives nothing more: its own watchdog of 50 ms lets go. Nor does it see the host
    // go.
    let pulled = format!("unplug@{WRONG_AT}");
    ends_in_with(
        &["--fault", &pulled, "--duration", "8s"],
        &[&["disconnected"]],
        50.0 + AT_ONCE_TICKS,
    );
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn a_counter_that_runs_ahead() {
    ends_in("skip=40", &[&["sequence-gap"]], AT_ONCE_TICKS);
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn an_arm_that_loses_its_zero() {
    // Its error code says so too.
    ends_in("unhome", &[&["not-homed", "device-error"]], AT_ONCE_TICKS);
}

/// A run that ends in a fault of its own, without one that is injected.
fn ends_by_itself_in(
    bench: &Bench,
    mock_args: &[&str],
    expected: &str,
) -> (super::link::Ended, super::link::Ended) {
    let (host, mock) =
        exchange(bench, mock_args, &["--enable", "--duration", "6s"], &[&[expected]]);
    let said = format!("{}\n{}\n{}", host.json, host.stderr, mock.json);
    assert_eq!((host.code(), host.faults()), (Some(7), vec![expected]), "{said}");
    for component in ["fx_n", "fy_n", "fz_n", "tx_nm", "ty_nm", "tz_nm"] {
        assert_eq!(mock.json["last_command"][component].as_f64(), Some(0.0), "{said}");
    }
    (host, mock)
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn a_hand_that_is_too_fast() {
    let bench = Bench::viscous();
    // Pressed, then 80 mm in 40 ms.
    let hand = bench.hand(&[
        (0.0, 0.0, 15.0),
        (0.5, 0.0, 8.5),
        (1.0, 0.0, 8.5),
        (1.04, 80.0, 8.5),
        (3.0, 80.0, 8.5),
    ]);
    ends_by_itself_in(&bench, &["--hand", &hand], "speed");
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn more_power_into_the_hand_than_is_allowed() {
    let bench = Bench::viscous().scene_with("[safety]\npower_w = 0.01");
    // Pressed hard, then drawn back at 0.5 m/s by a hand that the arm says stands still: the
    // limiter sees no power, the window does.
    let hand = bench.hand(&[
        (0.0, 0.0, 15.0),
        (0.5, 0.0, 2.0),
        (1.5, 0.0, 2.0),
        (1.54, 0.0, 22.0),
        (3.0, 0.0, 22.0),
    ]);
    ends_by_itself_in(&bench, &["--hand", &hand, "--fault", "no-velocity@1s"], "power");
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn a_host_that_misses_a_deadline_where_none_may_be_missed() {
    let bench = Bench::viscous().scene_with("[safety]\noverrun = 1");
    let (host, mock) = repeat(|| {
        let mock = bench.mock(&[]);
        let mut host = bench.host(&["--enable", "--duration", "6s"]);
        // Until the hand presses. A machine that is late by itself before that ends the run in the
        // same way; before force flows it says nothing.
        let is_enabled = host.comes_to("state: enabled");
        std::thread::sleep(Duration::from_millis(2500));
        host.signal("STOP");
        std::thread::sleep(Duration::from_millis(10));
        host.signal("CONT");
        let host = host.ended();
        let mock = mock.ended();
        let is_late = !is_enabled || host.faults().contains(&"stale");
        ((host, mock), is_late)
    });
    let said = format!("{}\n{}\n{}", host.json, host.stderr, mock.json);
    assert_eq!((host.code(), host.faults()), (Some(7), vec!["overrun"]), "{said}");
    assert!(host.number("missed_deadlines") > 0.0, "{said}");
    assert_eq!(mock.json["last_command"]["fz_n"].as_f64(), Some(0.0), "{said}");
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn encoders_that_freeze_in_a_fast_motion() {
    let bench = Bench::viscous();
    // 0.5 m/s through free space; frozen in the middle of it.
    let hand = bench.hand(&[
        (0.0, -40.0, 15.0),
        (0.5, -40.0, 15.0),
        (0.66, 40.0, 15.0),
        (3.0, 40.0, 15.0),
    ]);
    let (_, mock) =
        ends_by_itself_in(&bench, &["--hand", &hand, "--fault", "stuck@1600ms"], "stuck");
    assert!(mock.json["faults"][0]["began_s"].as_f64().is_some());
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn a_motor_that_gets_too_hot() {
    let bench = Bench::verified("polhem-2022").changed(&[
        ("continuous_current_ma = [", "continuous_current_ma = [20, 20, 20] # ["),
        ("thermal_time_s = 30.0", "thermal_time_s = 1.0"),
    ]);
    ends_by_itself_in(&bench, &[], "thermal");
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn a_deadman_that_is_let_go() {
    let bench = Bench::viscous().scene_with("[safety]\ndeadman = 3");
    // Held while it presses, let go, held again.
    let held = ["--fault", "press=3@1s+1600ms", "--fault", "press=3@2900ms+1s"];
    let (host, mock) = exchange(&bench, &held, &["--duration", "5s"], &[&[]]);
    let said = format!("{}\n{}\n{}", host.json, host.stderr, mock.json);
    assert_eq!((host.code(), host.faults()), (Some(0), Vec::new()), "{said}");
    let states: Vec<&str> =
        host.stderr.lines().filter_map(|line| line.strip_prefix("state: ")).collect();
    assert_eq!(states.iter().filter(|state| **state == "enabled").count(), 2, "{said}");
    assert!(host.stderr.contains("no force: deadman"), "{said}");
    assert!(mock.number("largest_force_n") > 0.2, "{said}");
}

/// What the host does not take for a fault leaves a run that ends well.
fn is_survived(fault: &str) -> (super::link::Ended, super::link::Ended) {
    let bench = Bench::viscous();
    let (host, mock) =
        exchange(&bench, &["--fault", fault], &["--enable", "--duration", "5s"], &[&[]]);
    assert_eq!(
        (host.code(), host.faults()),
        (Some(0), Vec::new()),
        "{}\n{}\n{}",
        host.json,
        host.stderr,
        mock.json
    );
    assert_eq!(mock.json["last_command"]["fz_n"].as_f64(), Some(0.0));
    (host, mock)
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn lost_reports_are_counted() {
    let (host, mock) = is_survived("drop=1%@2s");
    assert!(
        host.number("stale_samples") >= 0.5 * mock.number("frames_lost")
            && mock.number("frames_lost") > 5.0
    );
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn late_replies_weaken_and_do_not_fault() {
    let (host, _) = is_survived("slow=2ms@2s");
    assert!(host.number("delay_ticks") >= 3.0, "{}", host.json);
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn weak_motors_and_a_silent_moment_are_survived() {
    is_survived("saturate@2s");
    let (host, mock) = is_survived("stall@2600ms+10ms");
    assert!(host.number("stale_samples") >= 5.0, "{} {}", host.json, mock.json);
}
