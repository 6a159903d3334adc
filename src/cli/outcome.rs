//! stdout of `run`: what a run came to, as text or as one JSON object.

use std::fmt::Write as _;

use serde::Serialize;

use super::sculpt_run::SculptSummary;
use super::{drawing, live};
use crate::daemon::drawing::DrawnSummary;
use arms::remote::figures::LinkReport;
use recording::file::RecordingSummary;
use recording::{LatencySummary, Totals};

/// How long a run took to begin, s since the first instruction of `main`.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub(super) struct StartTimes {
    /// The scene was baked, or read from the cache, and the arm open.
    pub(super) baked: f64,
    /// The first tick began; 0 when there was none.
    pub(super) first_tick: f64,
}

/// What there was beside the loop.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct RunExtras<'a> {
    pub(super) swaps: &'a [live::SwapReport],
    pub(super) recording: Option<&'a RecordingSummary>,
    pub(super) sculpt: Option<&'a SculptSummary>,
    pub(super) drawn: Option<&'a DrawnSummary>,
    pub(super) link: Option<LinkReport>,
}

/// What a node does when no command arrives.
pub(super) fn lets_go_text(LinkReport { hold_ms, fade_ms, .. }: &LinkReport) -> String {
    format!(
        "lets go {} ms after the last command ({hold_ms} held, {fade_ms} fading)",
        hold_ms + fade_ms
    )
}

/// What goes to stdout.
pub(super) fn result_text(
    totals: &Totals,
    start_s: StartTimes,
    more: &RunExtras<'_>,
    json: bool,
) -> String {
    let RunExtras { swaps, recording, sculpt, drawn, link } = *more;
    if json {
        #[derive(Serialize)]
        struct RunReport<'t> {
            #[serde(flatten)]
            totals: &'t Totals,
            start_s: StartTimes,
            #[serde(skip_serializing_if = "<[_]>::is_empty")]
            swaps: &'t [live::SwapReport],
            #[serde(skip_serializing_if = "Option::is_none")]
            recording: Option<&'t RecordingSummary>,
            #[serde(skip_serializing_if = "Option::is_none")]
            sculpt: Option<&'t SculptSummary>,
            #[serde(skip_serializing_if = "Option::is_none")]
            drawn: Option<&'t DrawnSummary>,
            #[serde(skip_serializing_if = "Option::is_none")]
            link: Option<LinkReport>,
        }
        return match serde_json::to_string(&RunReport {
            totals,
            start_s,
            swaps,
            recording,
            sculpt,
            drawn,
            link,
        }) {
            Ok(mut text) => {
                text.push('\n');
                text
            }
            // True invariant: numbers, names and flags, no map with odd keys.
            Err(error) => unreachable!("plain data: {error}"),
        };
    }
    let mut text = String::new();
    let mut row = |name: &str, value: std::fmt::Arguments<'_>| {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{name:<18} {value}");
    };
    row(
        "ticks",
        format_args!(
            "{} in {:.3} s at {} Hz ({} clock)",
            totals.ticks, totals.duration_s, totals.rate_hz, totals.clock
        ),
    );
    row(
        "start",
        format_args!(
            "baked after {:.3} s, first tick after {:.3} s",
            start_s.baked, start_s.first_tick
        ),
    );
    for swap in swaps {
        row("swap", format_args!("{swap}"));
    }
    if let Some(RecordingSummary { file, records, dropped, error }) = recording {
        let lost = if *dropped > 0 {
            format!(", {dropped} that the disk was too slow for are missing")
        } else {
            String::new()
        };
        let early =
            error.as_ref().map_or_else(String::new, |error| format!(", ended early: {error}"));
        row("recording", format_args!("{}: {records} ticks{lost}{early}", file.display()));
    }
    for (name, text) in sculpt.map(SculptSummary::rows).into_iter().flatten() {
        row(name, format_args!("{text}"));
    }
    if let Some(drawn) = drawn {
        row("drawn", format_args!("{}", drawing::row(drawn)));
    }
    if let Some(report @ LinkReport { there_ms, back_ms, old_packets, lost_packets, .. }) = link {
        row(
            "link",
            format_args!(
                "{there_ms:.2} ms there, {back_ms:.2} ms back at most; {lost_packets} packets \
                    lost, {old_packets} too late; {}",
                lets_go_text(&report)
            ),
        );
    }
    row("missed deadlines", format_args!("{}", totals.missed_deadlines));
    for (name, latency) in [
        ("wake-up", totals.wakeup_us),
        ("compute", totals.compute_us),
        ("device", totals.device_us),
    ] {
        let LatencySummary { p50, p99, p999, max } = latency;
        row(name, format_args!("p50 {p50:.1}  p99 {p99:.1}  p99.9 {p999:.1}  max {max:.1} µs"));
    }
    row(
        "largest command",
        format_args!("{:.3} N, {:.4} N·m", totals.max_force_n, totals.max_torque_nm),
    );
    let rendered = totals.rendered;
    if rendered.max_dropped_torque_nm > 0.0
        || rendered.max_dropped_force_n > 0.0
        || rendered.weakened_ticks + rendered.unsent_ticks > 0
        || rendered.max_beside_force_n + rendered.max_beside_torque_nm > 0.0
    {
        row(
            "largest rendered",
            format_args!(
                "{:.3} N, {:.4} N·m; of it {:.3} N, {:.4} N·m beside the command",
                rendered.max_force_n,
                rendered.max_torque_nm,
                rendered.max_beside_force_n,
                rendered.max_beside_torque_nm
            ),
        );
        row(
            "not rendered",
            format_args!(
                "up to {:.3} N and {:.4} N·m without a motor; {} ticks weakened by the limits of \
                    the motors, {} not sent in time",
                rendered.max_dropped_force_n,
                rendered.max_dropped_torque_nm,
                rendered.weakened_ticks,
                rendered.unsent_ticks
            ),
        );
    }
    if let Some(points) = totals.contact_budget_points {
        row(
            "contact budget",
            format_args!("{points} points a tick, at most {} left out", totals.points_left_out),
        );
    }
    row("contact", format_args!("{} ticks, {}", totals.contact_ticks, totals.deepest()));
    row(
        "passivity",
        format_args!(
            "damped {} ticks, lowest energy {:.4} mJ",
            totals.passivity_ticks,
            totals.lowest_energy_j * 1e3
        ),
    );
    if totals.object_work_j > 0.0 {
        row(
            "moving objects",
            format_args!("put up to {:.4} mJ into the hand", totals.object_work_j * 1e3),
        );
    }
    let pose = totals.final_pose;
    row(
        "tool at the end",
        format_args!(
            "[{:.6}, {:.6}, {:.6}] m, xyzw [{:.6}, {:.6}, {:.6}, {:.6}]",
            pose.x_m, pose.y_m, pose.z_m, pose.qx, pose.qy, pose.qz, pose.qw
        ),
    );
    if totals.stale_samples > 0 {
        row("stale samples", format_args!("{}", totals.stale_samples));
    }
    if totals.corrupt_packets > 0 || totals.lost_packets > 0 {
        row(
            "packets",
            format_args!(
                "{} corrupt, {} lost on the way",
                totals.corrupt_packets, totals.lost_packets
            ),
        );
    }
    if totals.dropped_records > 0 {
        row(
            "dropped records",
            format_args!("{}: the extremes above do not know of them", totals.dropped_records),
        );
    }
    let faults =
        if totals.faults.is_empty() { "none".to_owned() } else { totals.faults.join(", ") };
    row("faults", format_args!("{faults}"));
    text
}
