//! The page itself.

use std::fmt::Write as _;

use serde_json::Value;

use super::chart::{self, Curve};
use super::{FaultSpan, LabReport, SceneFacts};
use crate::LatencySummary;
use haptics::Faults;

/// Place of the wake-up among the values of a trace.
const WAKEUP: usize = 5;

const STYLE: &str = include_str!("page.css");

/// The whole text.
pub(super) fn page(report: &LabReport) -> String {
    let scene = report.scenes.values().next().and_then(|scene| scene.manifest.get("name")).map_or("recording", String::as_str);
    let begun = report.run.get("begun").map_or(String::new(), |begun| format!(" · begun {}", escaped(begun)));
    let mut body = format!("<h1>{}</h1><p class=\"file\">{}{begun}</p>", escaped(scene), escaped(&report.file));
    match (&report.first, &report.last) {
        (Some(_), Some(_)) => {
            overview(report, &mut body);
            curves(report, &mut body);
            latencies(report, &mut body);
        }
        _ => body.push_str("<p>The recording holds no tick.</p>"),
    }
    faults(&report.faults, &mut body);
    for (scene_idx, scene) in &report.scenes {
        scene_facts(*scene_idx, scene, &mut body);
    }
    if !report.run.is_empty() {
        body.push_str("<section><h2>Run and machine</h2>");
        table(&mut body, report.run.iter().map(|(name, value)| (name.as_str(), escaped(value))));
        body.push_str("</section>");
    }
    format!(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" content=\"width=device-width\">\
         <meta name=\"color-scheme\" content=\"light dark\"><title>{} · hapticd</title><style>{STYLE}</style></head>\n\
         <body><main>{body}<footer>Made by hapticd {} from the recording alone.</footer></main></body></html>\n",
        escaped(scene),
        env!("CARGO_PKG_VERSION")
    )
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// Rows of a name and a value that is HTML already.
fn table<'t>(body: &mut String, rows: impl Iterator<Item = (&'t str, String)>) {
    body.push_str("<table>");
    for (name, value) in rows {
        // Writing to a string cannot fail, here and below.
        let _ = write!(body, "<tr><th scope=\"row\">{}</th><td>{value}</td></tr>", escaped(name));
    }
    body.push_str("</table>");
}

fn overview(report: &LabReport, body: &mut String) {
    let totals = report.totals();
    let mut rows = vec![
        (
            "duration",
            format!("{:.3} s, {} ticks at {} Hz, {} clock", totals.duration_s, totals.ticks, totals.rate_hz, totals.clock),
        ),
        ("largest command", format!("{:.3} N, {:.1} mN·m", totals.max_force_n, totals.max_torque_nm * 1e3)),
        ("contact", format!("{} ticks, deepest {:.4} mm", totals.contact_ticks, totals.max_depth_m * 1e3)),
        ("passivity", format!("damped {} ticks, lowest energy {:.4} mJ", totals.passivity_ticks, totals.lowest_energy_j * 1e3)),
        ("samples", format!("{} stale, {} garbled, {} lost", totals.stale_samples, totals.corrupt_packets, totals.lost_packets)),
        ("faults", if totals.faults.is_empty() { "none".to_owned() } else { totals.faults.join(", ") }),
    ];
    if let Some(points) = totals.contact_budget_points {
        rows.push(("contact budget", format!("{points} points a tick, at most {} left out", totals.points_left_out)));
    }
    if let Some(first) = report.first.filter(|first| first.tick > 0) {
        rows.push(("begins", format!("with tick {}, {:.3} s after the first one", first.tick, first.time_ns as f64 * 1e-9)));
    }
    body.push_str("<section>");
    table(body, rows.into_iter());
    let warnings = [
        (report.is_cut_off, "The recording has no end: what recorded it was killed, or is at it still.".to_owned()),
        (report.missing_ticks > 0, format!("{} ticks are missing from the recording.", report.missing_ticks)),
        (totals.dropped_records > 0, format!("{} ticks were dropped, as the disk was too slow.", totals.dropped_records)),
    ];
    for (_, words) in warnings.iter().filter(|(holds, _)| *holds) {
        let _ = write!(body, "<p class=\"warning\">{words}</p>");
    }
    body.push_str("</section>");
}

fn curves(report: &LabReport, body: &mut String) {
    let limits = report.scenes.values().next().map(|scene| &scene.resolved["parameters"]["limits"]);
    let limit = |name: &str, factor: f64, words| {
        let value = limits.and_then(|limits| limits[name].as_f64());
        value.map(|value| (value * factor, words))
    };
    let marks: Vec<f64> = report.faults.iter().map(|span| span.time_s).collect();
    let deadline_us = report.keeps_time().then(|| (report.period_s() * 1e6, "deadline"));
    for (value, (title, limit)) in [
        ("Force of the command, N", limit("force_n", 1.0, "force limit")),
        ("Torque of the command, mN·m", limit("torque_nm", 1e3, "torque limit")),
        ("Depth, mm", None),
        ("Clearance, at least, mm", None),
        ("Duration of the tick, µs", deadline_us),
        ("Lateness of the wake-up, µs", deadline_us),
    ]
    .into_iter()
    .enumerate()
    {
        if value == WAKEUP && !report.keeps_time() {
            continue;
        }
        let svg = chart::curve(&Curve { title, value, limit, marks: &marks }, &report.trace.stretches);
        let _ = write!(body, "<figure><figcaption>{title}</figcaption>{svg}</figure>");
    }
}

fn latencies(report: &LabReport, body: &mut String) {
    let totals = report.totals();
    let period_us = report.period_s() * 1e6;
    body.push_str("<section><h2>Latency</h2>");
    let text = |latency: LatencySummary| {
        let LatencySummary { p50, p99, p999, max } = latency;
        format!("p50 {p50:.1} · p99 {p99:.1} · p99.9 {p999:.1} · max {max:.1} µs")
    };
    let rows = [("compute", totals.compute_us), ("device", totals.device_us), ("wake-up", totals.wakeup_us)];
    let histograms = [
        ("Ticks by duration, logarithmic", &totals.histograms_us.compute),
        ("Ticks by lateness of the wake-up, logarithmic", &totals.histograms_us.wakeup),
    ];
    // Simulated time has no wake-ups.
    let (n_rows, n_histograms) = if report.keeps_time() { (3, 2) } else { (2, 1) };
    table(body, rows.into_iter().take(n_rows).map(|(name, latency)| (name, text(latency))));
    for (title, bins) in histograms.into_iter().take(n_histograms) {
        let svg = chart::histogram(title, bins, period_us);
        let _ = write!(body, "<figure><figcaption>{title}</figcaption>{svg}</figure>");
    }
    body.push_str("</section>");
}

fn faults(spans: &[FaultSpan], body: &mut String) {
    body.push_str("<section><h2>Faults</h2>");
    if spans.is_empty() {
        body.push_str("<p>None.</p></section>");
        return;
    }
    body.push_str("<table><tr><th scope=\"col\">time</th><th scope=\"col\">tick</th><th scope=\"col\">what happened</th></tr>");
    for FaultSpan { tick, time_s, faults, cause } in spans {
        let told = Faults::TABLE.into_iter().filter(|(fault, ..)| faults.contains(*fault));
        let words = told.map(|(_, name, words)| format!("<strong>{name}</strong>: {words}")).collect::<Vec<_>>().join("; ");
        let _ = write!(body, "<tr><td>{time_s:.3} s</td><td>{tick}</td><td>{words} (force off: {cause})</td></tr>");
    }
    body.push_str("</table></section>");
}

fn scene_facts(scene_idx: u32, scene: &SceneFacts, body: &mut String) {
    let name = scene.manifest.get("name").map_or("unknown", String::as_str);
    let _ = write!(body, "<section><h2>Scene {scene_idx}: {}</h2>", escaped(name));
    let mut rows = Vec::new();
    if let Some(time_s) = scene.first_time_s.filter(|_| scene_idx > 0) {
        rows.push(("from".to_owned(), format!("{time_s:.3} s on")));
    }
    if let Some(path) = scene.manifest.get("path") {
        rows.push(("file".to_owned(), escaped(path)));
    }
    flatten("", &scene.resolved, &mut rows);
    table(body, rows.iter().map(|(name, value)| (name.as_str(), value.clone())));
    body.push_str("</section>");
}

/// Everything that a scene came to, keys as paths.
fn flatten(key: &str, value: &Value, rows: &mut Vec<(String, String)>) {
    match value {
        Value::Object(object) => {
            for (name, value) in object {
                let path = if key.is_empty() { name.clone() } else { format!("{key}.{name}") };
                // The space is the same for all of them.
                flatten(path.trim_start_matches("parameters."), value, rows);
            }
        }
        Value::Array(list) if list.iter().any(Value::is_object) => {
            for (n, value) in list.iter().enumerate() {
                flatten(&format!("{key}[{n}]"), value, rows);
            }
        }
        Value::Null if key.is_empty() => {}
        other => rows.push((key.to_owned(), escaped(&shown(other)))),
    }
}

/// A value for people.
fn shown(value: &Value) -> String {
    match value {
        Value::Null => "–".to_owned(),
        Value::String(text) => text.clone(),
        Value::Number(number) if number.is_f64() => number.as_f64().map_or_else(|| number.to_string(), six_figures),
        Value::Array(list) => format!("[{}]", list.iter().map(shown).collect::<Vec<_>>().join(", ")),
        other => other.to_string(),
    }
}

/// Six figures, and no zeros behind them.
fn six_figures(number: f64) -> String {
    // True invariant: what was written as a number is read as one.
    format!("{number:.5e}").parse::<f64>().unwrap_or(number).to_string()
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn a_scene_is_told_in_paths_and_in_figures_that_can_be_read() {
        let resolved = json!({
            "name": "MyScene",
            "tool": { "sides": "flood", "mass_kg": 0.1, "inertia_kg_m2": null },
            "parameters": {
                "coupling": { "mode": "constraint", "clamp": "half-voxel" },
                "limits": { "slew_n_per_s": 24.773803641699697, "stale_ticks_max": 3, "speed_m_per_s": 1.0, "small": 1.234567891e-9 },
                "port": { "start": [0.1, -0.2, 1234567.8], "sensed": ["x", "rx"] },
            },
        });
        let mut rows = Vec::new();
        flatten("", &resolved, &mut rows);
        for (key, value) in [
            ("name", "MyScene"),
            ("tool.sides", "flood"),
            ("tool.mass_kg", "0.1"),
            ("tool.inertia_kg_m2", "–"),
            ("coupling.mode", "constraint"),
            ("coupling.clamp", "half-voxel"),
            ("limits.slew_n_per_s", "24.7738"),
            ("limits.stale_ticks_max", "3"),
            ("limits.speed_m_per_s", "1"),
            ("limits.small", "0.00000000123457"),
            ("port.start", "[0.1, -0.2, 1234570]"),
            ("port.sensed", "[x, rx]"),
        ] {
            assert!(rows.contains(&(key.to_owned(), value.to_owned())), "{key} = {value}: {rows:?}");
        }
    }
}
