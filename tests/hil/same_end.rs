//! The same scene and hand, with the arm in the same process and behind a tty, end in the same
//! place.

use super::link::{Bench, Running, block_on_plane, exchange};

/// Where a hand of 500 N/m rests when 0.05 N of friction and one step of the encoder hold it, and
/// again on the other side.
const TOLERANCE_M: f64 = 0.3e-3;

fn final_position(json: &serde_json::Value) -> [f64; 3] {
    ["x_m", "y_m", "z_m"].map(|key| json["final_pose"][key].as_f64().expect("a number"))
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn in_process_and_over_a_tty() {
    let bench = Bench::viscous();
    let (host, mock) = exchange(&bench, &[], &["--enable", "--duration", "8s"], &[&[]]);
    assert_eq!(
        (host.code(), host.faults()),
        (Some(0), Vec::new()),
        "{}\n{}\n{}",
        host.json,
        host.stderr,
        mock.json
    );
    assert!(
        host.number("contact_ticks") > 500.0 && host.number("max_force_n") > 0.3,
        "{}",
        host.json
    );
    // What left the host is what the motors made. A tick whose bytes the machine held up commanded
    // a force that was never sent.
    let sent_n = host.json["rendered"]["max_force_n"].as_f64().expect("a number");
    assert!((mock.number("largest_force_n") - sent_n).abs() < 1e-3, "{} {}", mock.json, host.json);

    let scene = block_on_plane();
    let args = [
        "run",
        scene.to_str().expect("text"),
        "--device",
        "sim-sigma7",
        "--clock",
        "virtual",
        "--duration",
        "8s",
        "--json",
        "--cache",
        "off",
    ];
    let in_process = Running::start(&args).ended();
    let near = final_position(&in_process.json);
    let far = final_position(&host.json);
    let apart_m = (0..3).map(|axis| (near[axis] - far[axis]).powi(2)).sum::<f64>().sqrt();
    assert!(apart_m < TOLERANCE_M, "{near:?} {far:?}");
}
