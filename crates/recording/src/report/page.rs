//! The page itself.

use std::fmt::Write as _;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde_json::Value;

use super::bins::Bins;
use super::key_frames::{KeyFrame, Peak};
use super::plots::{self, Plot};
use super::trace::{
    CLEARANCE, COMMAND_FORCE, COMMAND_TORQUE, COMPUTE, CONTACT_FORCE, CONTACT_TORQUE, DEPTH, WAKEUP,
};
use super::{FaultSpan, LabReport, SceneFacts};
use crate::{LatencySummary, at_least};
use haptics::Faults;
use rt::utc::timestamp;

const STYLE: &str = include_str!("page.css");
/// Faults that are listed before the rest is folded.
const FAULTS_SHOWN: usize = 6;

/// The whole text.
pub(super) fn page(report: &LabReport) -> String {
    let scene = report
        .scenes
        .values()
        .next()
        .and_then(|scene| scene.manifest.get("name"))
        .map_or("recording", String::as_str);
    let begun = begun(report);
    let mut body = format!(
        "<h1>{}</h1><p class=\"file\">{}{begun}</p>",
        escaped(scene),
        escaped(&report.file)
    );
    if report.last.is_some() {
        picture(report, &mut body);
        verdict(report, &mut body);
        forces_over_distances(report, &mut body);
        over_time(report, &mut body);
        folded("Counts", &mut body, |body| counts(report, body));
        folded("Timing of the loop", &mut body, |body| latencies(report, body));
    } else {
        body.push_str("<p>The recording holds no tick.</p>");
    }
    if report.faults.len() > FAULTS_SHOWN {
        folded("All faults", &mut body, |body| faults(&report.faults, body));
    }
    for (scene_idx, scene) in &report.scenes {
        let name = scene.manifest.get("name").map_or("unknown", String::as_str);
        folded(&format!("Scene {scene_idx}: {}", escaped(name)), &mut body, |body| {
            scene_facts(*scene_idx, scene, body)
        });
    }
    if !report.run.is_empty() {
        folded("Run and machine", &mut body, |body| {
            table(body, report.run.iter().map(|(name, value)| (name.as_str(), escaped(value))));
        });
    }
    format!(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" \
            content=\"width=device-width\"><meta name=\"color-scheme\" content=\"light \
            dark\"><title>{} · \
            hapticd</title><style>{STYLE}</style></head>\n<body><main>{body}<footer>Made by \
            hapticd {} from the recording alone.</footer></main></body></html>\n",
        escaped(scene),
        env!("CARGO_PKG_VERSION")
    )
}

/// When the run began, and when the recording did, where that was later.
fn begun(report: &LabReport) -> String {
    let run = report.run.get("begun").map(|begun| escaped(begun));
    let later = report.first.filter(|first| first.tick > 0).map(|first| {
        let at = report
            .first_tick_at
            .filter(|_| report.keeps_time())
            .map_or(String::new(), |at| format!(" {}", timestamp(at)));
        format!(
            "recording begun{at}, {:.3} s after the first tick of the run",
            first.time_ns as f64 * 1e-9
        )
    });
    match (run, later) {
        (Some(run), None) => format!(" · begun {run}"),
        (Some(run), Some(later)) => format!(" · {later} · run begun {run}"),
        (None, later) => later.map_or(String::new(), |later| format!(" · {later}")),
    }
}

/// What a reader opens if wanted; paper shows the title alone.
fn folded(title: &str, body: &mut String, write: impl FnOnce(&mut String)) {
    // Writing to a string cannot fail, here and below.
    let _ = write!(body, "<details><summary>{title}</summary>");
    write(body);
    body.push_str("</details>");
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// Rows of a name and a value that is HTML already.
fn table<'t>(body: &mut String, rows: impl Iterator<Item = (&'t str, String)>) {
    body.push_str("<table>");
    for (name, value) in rows {
        let _ = write!(body, "<tr><th scope=\"row\">{}</th><td>{value}</td></tr>", escaped(name));
    }
    body.push_str("</table>");
}

fn picture(report: &LabReport, body: &mut String) {
    let Some(KeyFrame { time_s, depth_m, depth_is_bound, .. }) = report.moment() else { return };
    match &report.picture {
        Some(Ok(png)) => {
            let when = if *depth_m > 0.0 {
                let at_least = at_least(*depth_is_bound);
                format!("at its deepest contact ({at_least}{} mm)", figures(depth_m * 1e3))
            } else {
                "at the end".to_owned()
            };
            let path = "and the path of its middle: <span class=\"key free\">free</span>, <span \
                class=\"key touches\">in contact</span>; pale where a part is in front of it.";
            body.push_str("<div class=\"scenes\">");
            scene_figure(png, &when, &format!("{time_s:.3} s, {path}"), body);
            if let (Some(png), Some(KeyFrame { time_s, depth_m, depth_is_bound, .. })) =
                (&report.end_picture, report.end())
            {
                let depth = if depth_m > 0.0 {
                    let at_least = at_least(depth_is_bound);
                    format!("{at_least}{} mm deep", figures(depth_m * 1e3))
                } else {
                    "without contact".to_owned()
                };
                scene_figure(png, "at the end", &format!("{time_s:.3} s, {depth}."), body);
            }
            body.push_str("</div>");
        }
        Some(Err(why)) => {
            let _ = write!(
                body,
                "<p class=\"warning\">There is no picture of the scene: {}.</p>",
                escaped(why)
            );
        }
        None => {}
    }
}

fn scene_figure(png: &[u8], when: &str, caption: &str, body: &mut String) {
    let data = STANDARD.encode(png);
    let _ = write!(
        body,
        "<figure class=\"scene\"><img alt=\"The parts of the scene and the tool {when}\" \
            src=\"data:image/png;base64,{data}\"><figcaption>The tool {when}, \
            {caption}</figcaption></figure>"
    );
}

/// What happened, in sentences and in one table.
fn verdict(report: &LabReport, body: &mut String) {
    let totals = report.totals();
    let moments = &report.moments;
    let mut words = Vec::new();
    match moments.first_contact_s {
        Some(first_s) => words.push(format!(
            "<strong>The tool touched something</strong>, first at {first_s:.3} s, and for {} of \
                {} ticks; {} {} mm deep{}.",
            totals.contact_ticks,
            totals.ticks,
            if totals.depth_is_bound { "at least" } else { "at most" },
            figures(moments.depth.value * 1e3),
            if totals.depth_is_bound { ", where the distances of a part end" } else { "" },
        )),
        None => words
            .push(format!("<strong>The tool touched nothing</strong> in {} ticks.", totals.ticks)),
    }
    words.push(if totals.faults.is_empty() {
        "There was <strong>no fault</strong>.".to_owned()
    } else {
        format!("<strong class=\"warning\">Faults: {}.</strong>", totals.faults.join(", "))
    });
    words.push(match (report.keeps_time(), moments.late_ticks) {
        (false, _) => "The clock was virtual: no tick can be late.".to_owned(),
        (true, 0) => "<strong>No tick was late.</strong>".to_owned(),
        (true, 1) => {
            "<strong>1 tick was late</strong>: it began when the next one was due.".to_owned()
        }
        (true, late) => format!(
            "<strong>{late} ticks were late</strong>: they began when the next one was due."
        ),
    });
    let _ = write!(
        body,
        "<section class=\"verdict\"><p>{} The recording is {:.3} s long, at {} Hz, and the tool \
            went {} mm.</p>",
        words.join(" "),
        totals.duration_s,
        totals.rate_hz,
        figures(moments.arc_m * 1e3)
    );
    body.push_str(
        "<table><tr><th scope=\"col\">largest</th><th scope=\"col\">value</th><th \
            scope=\"col\">when</th><th scope=\"col\">tool at (x, y, z)</th></tr>",
    );
    for (name, peak, factor, unit) in [
        ("depth", moments.depth, 1e3, "mm"),
        ("contact force", moments.contact_force, 1.0, "N"),
        ("commanded force", moments.command_force, 1.0, "N"),
        ("contact torque", moments.contact_torque, 1e3, "mN·m"),
        ("commanded torque", moments.command_torque, 1e3, "mN·m"),
    ] {
        let Peak { value, time_s, place_world } = peak;
        let [x, y, z] =
            (place_world * 1e3).to_array().map(|mm| plots::short((mm * 1e3).round() * 1e-3));
        let (when, place) = if value > 0.0 {
            (format!("{time_s:.3} s"), format!("{x}, {y}, {z} mm"))
        } else {
            ("–".to_owned(), "–".to_owned())
        };
        let _ = write!(
            body,
            "<tr><th scope=\"row\">{name}</th><td>{} \
                {unit}</td><td>{when}</td><td>{place}</td></tr>",
            figures(value * factor)
        );
    }
    body.push_str("</table>");
    let lacks = [
        (
            report.is_cut_off,
            "The recording has no end: what recorded it was killed, or is at it still.".to_owned(),
        ),
        (
            report.missing_ticks > 0,
            format!("{} ticks are missing from the recording.", report.missing_ticks),
        ),
        (
            totals.dropped_records > 0,
            format!("{} ticks were dropped, as the disk was too slow.", totals.dropped_records),
        ),
    ];
    for (_, words) in lacks.iter().filter(|(holds, _)| *holds) {
        let _ = write!(body, "<p class=\"warning\">{words}</p>");
    }
    if !report.faults.is_empty() {
        faults(report.faults.get(..FAULTS_SHOWN).unwrap_or(&report.faults), body);
    }
    body.push_str(
        "<p class=\"note\">Contact: what the parts do to the tool, about its centre of mass, in \
            world axes. Command: what the arm is reported, after filter, coupling, scale and limits, \
            in its own axes. So the command may be above zero where nothing touches: the slew \
            limit lets it fall over some ticks, and with <code>coupling.free_space = \
            \"drag\"</code> the spring and the damping of the coupling act there as well. And it \
            may be below the contact force: the spring of the coupling saturates, the control of \
            passivity weakens a force that has given energy, and the limits scale it back. The \
            place of the tool is that of the origin of its frame. Times count from the first tick \
            of the recording.</p></section>",
    );
}

/// Four figures of what is measured, and no zeros behind them.
fn figures(value: f64) -> String {
    // True invariant: what was written as a number is read as one.
    format!("{value:.3e}").parse::<f64>().unwrap_or(value).to_string()
}

fn counts(report: &LabReport, body: &mut String) {
    let totals = report.totals();
    let mut rows = vec![
        (
            "duration",
            format!(
                "{:.3} s, {} ticks at {} Hz, {} clock",
                totals.duration_s, totals.ticks, totals.rate_hz, totals.clock
            ),
        ),
        (
            "largest command",
            format!("{:.3} N, {:.1} mN·m", totals.max_force_n, totals.max_torque_nm * 1e3),
        ),
        ("contact", format!("{} ticks, {}", totals.contact_ticks, totals.deepest())),
        (
            "passivity",
            format!(
                "damped {} ticks, lowest energy {:.4} mJ",
                totals.passivity_ticks,
                totals.lowest_energy_j * 1e3
            ),
        ),
        (
            "samples",
            format!(
                "{} stale, {} garbled, {} lost",
                totals.stale_samples, totals.corrupt_packets, totals.lost_packets
            ),
        ),
        (
            "faults",
            if totals.faults.is_empty() { "none".to_owned() } else { totals.faults.join(", ") },
        ),
    ];
    if let Some(points) = totals.contact_budget_points {
        rows.push((
            "contact budget",
            format!("{points} points a tick, at most {} left out", totals.points_left_out),
        ));
    }
    if let Some(first) = report.first.filter(|first| first.tick > 0) {
        rows.push((
            "begins",
            format!(
                "with tick {}, {:.3} s after the first one",
                first.tick,
                first.time_ns as f64 * 1e-9
            ),
        ));
    }
    table(body, rows.into_iter());
}

fn figure(plot: Plot<'_>, keys: &[(&str, &str)], body: &mut String) {
    let words: String = keys
        .iter()
        .map(|(class, name)| format!(" <span class=\"key {class}\">{name}</span>"))
        .collect();
    let title = plot.title.to_owned();
    let svg = plots::plot(plot);
    let _ = write!(body, "<figure><figcaption>{title}{words}</figcaption>{svg}</figure>");
}

fn forces_over_distances(report: &LabReport, body: &mut String) {
    let keys = [("contact", "contact"), ("command", "command")];
    body.push_str(
        "<section class=\"distances\"><h2>Force over depth and over the path of the tool</h2>",
    );
    let mut over = |title: &str, bins: &Bins| {
        let bands =
            keys.iter().enumerate().map(|(value, (class, _))| (*class, bins.rows(value))).collect();
        figure(
            Plot { title, unit_x: "mm", bands, limit: force_limit(report), marks: &[] },
            &keys,
            body,
        );
    };
    over("Force over depth, N", &report.over_depth);
    over("Force over the path of the tool, N", &report.over_path);
    body.push_str("</section>");
}

/// Of the first scene.
fn force_limit(report: &LabReport) -> Option<(f64, &'static str)> {
    Some((limits(report)?["force_n"].as_f64()?, "force limit"))
}

fn torque_limit(report: &LabReport) -> Option<(f64, &'static str)> {
    Some((limits(report)?["torque_nm"].as_f64()? * 1e3, "torque limit"))
}

fn limits(report: &LabReport) -> Option<&Value> {
    report.scenes.values().next().map(|scene| &scene.resolved["parameters"]["limits"])
}

fn over_time(report: &LabReport, body: &mut String) {
    let marks: Vec<f64> = report.faults.iter().map(|span| span.time_s).collect();
    let axes = [("x", "x"), ("y", "y"), ("z", "z")];
    body.push_str("<section class=\"times\"><h2>Over time</h2>");
    for (title, first, limit) in [
        ("Contact force, N, world axes:", CONTACT_FORCE, None),
        ("Commanded force, N, axes of the arm:", COMMAND_FORCE, force_limit(report)),
        ("Contact torque, mN·m, world axes:", CONTACT_TORQUE, None),
        ("Commanded torque, mN·m, axes of the arm:", COMMAND_TORQUE, torque_limit(report)),
    ] {
        let bands = axes
            .iter()
            .enumerate()
            .map(|(axis, (class, _))| (*class, report.trace.rows(first + axis)))
            .collect();
        figure(Plot { title, unit_x: "s", bands, limit, marks: &marks }, &axes, body);
    }
    for (title, value) in [("Depth, mm", DEPTH), ("Clearance, at least, mm", CLEARANCE)] {
        let bands = vec![("contact", report.trace.rows(value))];
        figure(Plot { title, unit_x: "s", bands, limit: None, marks: &marks }, &[], body);
    }
    body.push_str("</section>");
}

fn latencies(report: &LabReport, body: &mut String) {
    let totals = report.totals();
    let period_us = report.period_s() * 1e6;
    let deadline = report.keeps_time().then_some((period_us, "deadline"));
    let text = |latency: LatencySummary| {
        let LatencySummary { p50, p99, p999, max } = latency;
        format!("p50 {p50:.1} · p99 {p99:.1} · p99.9 {p999:.1} · max {max:.1} µs")
    };
    let rows = [
        ("compute", totals.compute_us),
        ("device", totals.device_us),
        ("wake-up", totals.wakeup_us),
    ];
    let histograms = [
        ("Ticks by duration, logarithmic", &totals.histograms_us.compute),
        ("Ticks by lateness of the wake-up, logarithmic", &totals.histograms_us.wakeup),
    ];
    // Simulated time has no wake-ups.
    let (n_rows, n_histograms) = if report.keeps_time() { (3, 2) } else { (2, 1) };
    let curves = [("Duration of the tick, µs", COMPUTE), ("Lateness of the wake-up, µs", WAKEUP)];
    table(body, rows.into_iter().take(n_rows).map(|(name, latency)| (name, text(latency))));
    for (title, value) in curves.into_iter().take(n_histograms) {
        let bands = vec![("contact", report.trace.rows(value))];
        figure(Plot { title, unit_x: "s", bands, limit: deadline, marks: &[] }, &[], body);
    }
    for (title, bins) in histograms.into_iter().take(n_histograms) {
        let svg = plots::histogram(title, bins, period_us);
        let _ = write!(body, "<figure><figcaption>{title}</figcaption>{svg}</figure>");
    }
}

fn faults(spans: &[FaultSpan], body: &mut String) {
    body.push_str(
        "<table><tr><th scope=\"col\">time</th><th scope=\"col\">tick</th><th \
        scope=\"col\">what happened</th></tr>",
    );
    for FaultSpan { tick, time_s, faults, cause } in spans {
        let reported = Faults::TABLE.into_iter().filter(|(fault, ..)| faults.contains(*fault));
        let words = reported
            .map(|(_, name, words)| format!("<strong>{name}</strong>: {words}"))
            .collect::<Vec<_>>()
            .join("; ");
        let _ = write!(
            body,
            "<tr><td>{time_s:.3} s</td><td>{tick}</td><td>{words} (force off: {cause})</td></tr>"
        );
    }
    body.push_str("</table>");
}

fn scene_facts(scene_idx: u32, scene: &SceneFacts, body: &mut String) {
    let mut rows = Vec::new();
    if let Some(time_s) = scene.first_time_s.filter(|_| scene_idx > 0) {
        rows.push(("from".to_owned(), format!("{time_s:.3} s on")));
    }
    if let Some(path) = scene.manifest.get("path") {
        rows.push(("file".to_owned(), escaped(path)));
    }
    flatten("", &scene.resolved, &mut rows);
    table(body, rows.iter().map(|(name, value)| (name.as_str(), value.clone())));
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
        Value::Number(number) if number.is_f64() => {
            number.as_f64().map_or_else(|| number.to_string(), six_figures)
        }
        Value::Array(list) => {
            format!("[{}]", list.iter().map(shown).collect::<Vec<_>>().join(", "))
        }
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
    fn a_scene_is_reported_in_paths_and_in_figures_that_can_be_read() {
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
            assert!(
                rows.contains(&(key.to_owned(), value.to_owned())),
                "{key} = {value}: {rows:?}"
            );
        }
    }
}
