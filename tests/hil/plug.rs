//! Arms and hosts that go away and come back.

use std::time::Duration;

use super::link::{Bench, is_lateness, repeat};

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn a_replugged_arm_waits_for_the_operator() {
    let bench = Bench::viscous();
    let (host, mock) = repeat(|| {
        let mock = bench.mock(&["--fault", "unplug@2600ms+700ms"]);
        let mut host = bench.host(&["--console"]);
        host.wait_for("preflight");
        host.say("enable");
        host.wait_for("state: enabled");
        host.wait_for("state: fault");
        host.wait_for("device: back");
        std::thread::sleep(Duration::from_millis(100));
        host.say("enable");
        host.wait_for("state: enabled");
        std::thread::sleep(Duration::from_millis(800));
        host.say("stop");
        let host = host.ended();
        let mock = mock.ended();
        let is_late = host.faults().into_iter().any(is_lateness);
        ((host, mock), is_late)
    });
    let said = format!("{}\n{}\n{}", host.json, host.stderr, mock.json);
    assert_eq!((host.code(), host.faults()), (Some(7), vec!["disconnected"]), "{said}");
    let felt = &mock.json["faults"][0];
    assert!(felt["force_before_n"].as_f64().is_some_and(|force_n| force_n > 0.3), "{said}");
    assert!(felt["zero_after_ticks"].as_f64().is_some(), "{said}");
    assert_eq!(mock.json["last_command"]["fz_n"].as_f64(), Some(0.0), "{said}");
}

/// Kills the host while it pushes; what the arm felt.
fn killed(bench: &Bench, signal: &str) -> serde_json::Value {
    repeat(|| {
        let mock = bench.mock_with(&["--duration", "6s"]);
        let mut host = bench.host(&["--enable"]);
        let is_enabled = host.comes_to("state: enabled");
        // The hand begins after one second and presses from 1.2 s of its own time on.
        std::thread::sleep(Duration::from_millis(2600));
        host.signal(signal);
        // A host that is killed has no summary, but has reported its faults.
        let reported = host.ended().stderr;
        let is_late = !is_enabled
            || reported
                .lines()
                .filter_map(|line| line.strip_prefix("fault: ")?.split(' ').next())
                .any(is_lateness);
        (mock.ended().json, is_late)
    })
}

fn force_n(felt: &serde_json::Value) -> f64 {
    ["fx_n", "fy_n", "fz_n"]
        .map(|key| felt["last_command"][key].as_f64().expect("a number").powi(2))
        .iter()
        .sum::<f64>()
        .sqrt()
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn a_host_that_is_ordered_to_end_leaves_no_force() {
    for signal in ["TERM", "INT"] {
        let felt = killed(&Bench::verified("polhem-2022"), signal);
        assert!(
            felt["largest_force_n"].as_f64().is_some_and(|force_n| force_n > 0.1),
            "{signal}: {felt}"
        );
        assert_eq!(force_n(&felt), 0.0, "{signal}: {felt}");
    }
}
