//! An arm that falls silent with its plug in, and what it finds when it wakes.

use std::time::Duration;

use super::link::{Bench, is_lateness, repeat};

/// For so long the arm takes nothing that the host sends, from the time on at which the hand presses. Without a watchdog it holds its last force.
const DEAF: &str = "deaf@2600ms+1500ms";

#[test]
fn an_arm_that_was_deaf_wakes_to_a_zero_and_is_found_again() {
    let bench = Bench::verified("polhem-2022");
    let (host, mock) = repeat(|| {
        let mock = bench.mock_with(&["--duration", "12s", "--fault", DEAF]);
        let mut host = bench.host(&["--console"]);
        host.wait_for("preflight");
        host.say("enable");
        host.wait_for("state: enabled");
        host.wait_for("state: fault");
        host.wait_for("device: gone");
        host.wait_for("device: back");
        std::thread::sleep(Duration::from_millis(100));
        host.say("enable");
        let is_enabled = host.comes_to("state: enabled");
        host.say("stop");
        let (host, mock) = (host.ended(), mock.ended());
        let is_early = mock.json["faults"].as_array().is_none_or(Vec::is_empty);
        let is_late = host.faults().iter().any(|fault| is_lateness(fault) && *fault != "stale");
        ((host, mock), is_early || is_late || !is_enabled)
    });
    let said = format!("{}\n{}\n{}", host.json, host.stderr, mock.json);
    assert_eq!(host.code(), Some(7), "{said}");
    // That it counted as lost after that is what was waited for: `device: gone`.
    assert!(host.faults().contains(&"stale"), "{said}");
    let felt = &mock.json["faults"][0];
    assert!(felt["force_before_n"].as_f64().is_some_and(|force_n| force_n > 0.1), "{said}");
    // It could not let go before it heard again; then it did at once, and nothing old came behind.
    let zero_after = felt["zero_after_ticks"].as_f64().unwrap_or_else(|| panic!("the motors never stopped: {said}"));
    assert!(zero_after <= 1500.0 + 50.0 + mock.number("late_periods"), "{said}");
    assert_eq!(mock.json["last_command"]["fz_n"].as_f64(), Some(0.0), "{said}");
}
