//! Every arm with a serial port speaks its protocol over a tty.

use super::link::{Bench, exchange};

/// Enabled, without a path for the hand: nothing is touched, frames flow both ways, and the last
/// command is zero.
fn speaks(profile: &str, rate_hz: f64) {
    let bench = Bench::shipped(profile);
    let (host, mock) =
        exchange(&bench, &["--no-hand"], &["--enable", "--duration", "1500ms"], &[&[]]);
    assert_eq!(
        (host.code(), host.faults()),
        (Some(0), Vec::new()),
        "{profile}: {}\n{}",
        host.json,
        host.stderr
    );
    assert!(host.stderr.contains("state: enabled"), "{profile}: {}", host.stderr);
    let ticks = host.number("ticks");
    let fresh = ticks - host.number("stale_samples");
    // A lower bound that a busy machine meets too; an arm that says nothing does not.
    assert!(fresh > 0.3 * ticks * (rate_hz / 1000.0).min(1.0), "{profile}: {fresh} of {ticks}");
    assert!(
        mock.number("frames_received") > 0.3 * ticks * (rate_hz / 1000.0).min(1.0),
        "{profile}: {}",
        mock.json
    );
    assert_eq!(
        host.number("corrupt_packets"),
        0.0,
        "{profile}: {}\n{}\n{}",
        host.json,
        mock.json,
        host.stderr
    );
    for component in ["fx_n", "fy_n", "fz_n", "tx_nm", "ty_nm", "tz_nm"] {
        assert_eq!(
            mock.json["last_command"][component].as_f64(),
            Some(0.0),
            "{profile}: {component}"
        );
    }
}

#[test]
fn open6_over_a_tty() {
    speaks("open6-serial", 1000.0);
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn lines_of_2020_over_a_tty() {
    speaks("polhem-2020", 1000.0);
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn brackets_of_2022_over_a_tty() {
    speaks("polhem-2022", 1000.0);
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn the_vintage_arm_over_a_tty() {
    speaks("vintage-2022", 1000.0);
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn woodenhaptics_of_2022_over_a_tty() {
    speaks("woodenhaptics-2022", 1000.0);
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn a_hapi_board_over_a_tty() {
    speaks("haply-2diy", 1000.0);
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn a_leader_arm_over_a_tty() {
    speaks("leader-arm-6", 500.0);
}
