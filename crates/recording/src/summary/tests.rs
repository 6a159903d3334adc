use glam::{DQuat, DVec3};

use super::*;
use haptics::TickOutput;

fn counted() -> LoopCounts {
    LoopCounts {
        ticks: 3,
        rate_hz: 1000,
        clock: "virtual",
        missed_deadlines: 2,
        dropped_records: 0,
        contact_budget_points: None,
        faults: Faults::PANIC,
        realtime: RealtimeSummary { policy: "other", ..RealtimeSummary::default() },
    }
}

#[test]
fn extremes_counts_and_the_last_pose_are_kept() {
    let mut summary = Summary::new();
    for n in 0..3u32 {
        summary.add(&TickRecord {
            time_ns: 5_000_000 + i64::from(n) * 1_000_000,
            wakeup_ns: 1000 * u64::from(n),
            output: TickOutput {
                command_device: Wrench::new(DVec3::new(3.0, 4.0, 0.0) * f64::from(2 - n), DVec3::Z),
                contacts: n,
                max_depth_m: 1e-4 * f64::from(n),
                depth_is_bound: n == 1,
                world_from_tool: Pose::new(DQuat::IDENTITY, DVec3::splat(f64::from(n))),
                faults: if n == 1 { Faults::STALE } else { Faults::NONE },
                ..TickOutput::default()
            },
            ..TickRecord::default()
        });
    }
    let totals = summary.totals(counted());
    assert_eq!((totals.max_force_n, totals.max_torque_nm, totals.max_depth_m), (10.0, 1.0, 2e-4));
    assert_eq!(totals.deepest(), "deepest at least 0.2000 mm");
    assert_eq!((totals.contact_ticks, totals.stale_samples), (2, 3));
    assert_eq!(totals.final_pose.z_m, 2.0);
    assert_eq!(totals.faults, ["stale", "panic"]);
    assert!((totals.duration_s - 0.003).abs() < 1e-12);
    assert!((totals.wakeup_us.max - 2.0).abs() < 0.01);
}

#[test]
fn the_json_object_has_the_keys_of_the_contract() {
    let json = serde_json::to_value(Summary::new().totals(counted())).expect("plain data");
    let object = json.as_object().expect("an object");
    for key in [
        "ticks",
        "duration_s",
        "rate_hz",
        "missed_deadlines",
        "wakeup_us",
        "compute_us",
        "device_us",
        "max_force_n",
        "max_torque_nm",
        "max_depth_m",
        "depth_is_bound",
        "contact_ticks",
        "faults",
        "realtime",
        "final_pose",
    ] {
        assert!(object.contains_key(key), "{key}");
    }
    let keys = |value: &serde_json::Value| -> Vec<String> {
        let mut keys: Vec<String> = value.as_object().expect("an object").keys().cloned().collect();
        keys.sort();
        keys
    };
    assert_eq!(keys(&object["wakeup_us"]), ["max", "p50", "p99", "p999"]);
    assert_eq!(
        keys(&object["realtime"]),
        ["cpu", "kernel_rt", "memory_locked", "policy", "priority"]
    );
    assert_eq!(keys(&object["final_pose"]), ["qw", "qx", "qy", "qz", "x_m", "y_m", "z_m"]);
}

#[test]
fn a_motor_at_its_limit_is_distinguished_from_a_command_that_did_not_go_out() {
    let pushes = |force_n: f64| Wrench::new(DVec3::X * force_n, DVec3::ZERO);
    let mut summary = Summary::new();
    // Whole; at a limit twice; the older one kept; refused; nothing to render.
    for (command_n, rendered_n) in
        [(1.0, 1.0), (3.0, 2.0), (4.0, 2.5), (5.0, 2.5), (5.0, 0.0), (0.0, 0.0)]
    {
        let output = TickOutput { command_device: pushes(command_n), ..TickOutput::default() };
        summary.add(&TickRecord {
            output,
            rendered_device: pushes(rendered_n),
            ..TickRecord::default()
        });
    }
    let rendered = summary.totals(counted()).rendered;
    assert_eq!((rendered.weakened_ticks, rendered.unsent_ticks), (2, 2));
}

#[test]
fn what_the_motors_make_beside_the_command_counts_as_rendered() {
    let pushes =
        |force_n: f64, torque_nm: f64| Wrench::new(DVec3::X * force_n, DVec3::Z * torque_nm);
    let mut summary = Summary::new();
    for (rendered, beside) in
        [((0.0, 0.0), (2.0, 0.1)), ((1.0, 0.0), (1.5, 0.0)), ((1.0, 0.2), (-1.0, 0.0))]
    {
        let output =
            TickOutput { command_device: pushes(rendered.0, rendered.1), ..TickOutput::default() };
        let rendered_device = output.command_device;
        let beside_device = pushes(beside.0, beside.1);
        summary.add(&TickRecord {
            output,
            rendered_device,
            beside_device,
            ..TickRecord::default()
        });
    }
    let totals = summary.totals(counted());
    let rendered = totals.rendered;
    assert_eq!(
        (totals.max_force_n, rendered.max_force_n, rendered.max_beside_force_n),
        (1.0, 2.5, 2.0)
    );
    assert_eq!((rendered.max_torque_nm, rendered.max_beside_torque_nm), (0.2, 0.1));
    assert_eq!((rendered.weakened_ticks, rendered.unsent_ticks), (0, 0));
}

#[test]
fn every_tick_lies_in_one_bin() {
    let mut summary = Summary::new();
    for compute_ns in [0, 900, 1000, 1100, 4_000, 180_000, 190_000, u64::MAX] {
        summary.add(&TickRecord { compute_ns, ..TickRecord::default() });
    }
    let Histograms { wakeup, compute } = summary.totals(counted()).histograms_us;
    assert_eq!(wakeup, [[1, 8]]);
    let filled: Vec<[u64; 2]> = compute.into_iter().filter(|[_, count]| *count > 0).collect();
    assert_eq!(filled, [[1, 3], [2, 1], [5, 1], [200, 2], [20_000_000, 1]]);
}

#[test]
fn a_latency_beyond_the_range_is_counted_as_the_longest() {
    let mut summary = Summary::new();
    summary.add(&TickRecord { wakeup_ns: u64::MAX, ..TickRecord::default() });
    assert!(summary.totals(counted()).wakeup_us.max >= 9.9e6);
}
