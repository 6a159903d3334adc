//! The loop on the real clock: every shipped scene as `hapticd run` renders it, beside `cyclictest`
//! in the same minute.
//!
//! Best effort: without the right to SCHED_FIFO the figures are those of a normal thread, and the
//! table says so. That a tick does not allocate is for the tests to prove, not for this.

use std::path::PathBuf;
use std::process::Command;

use serde_json::Value;

use super::{BenchError, Row, process};

/// What to measure, and with what.
#[derive(Clone, Debug)]
pub struct Options {
    /// This program: runs are processes of it.
    pub program: PathBuf,
    /// One second of the smallest scene only.
    pub quick: bool,
    /// Folder of the shipped scenes.
    pub scenes: PathBuf,
}

/// Seconds of each run, and of `cyclictest` after it.
const RUN_S: u32 = 6;
/// Largest latency that `cyclictest` tells apart, µs.
const HISTOGRAM_US: u32 = 20_000;

/// Runs every scene, each a process of its own. `tell` is called with each step. Cost: a dozen
/// seconds for each scene.
///
/// # Errors
/// A run that fails. A folder without scenes, or no `cyclictest`, is a row that says so.
pub fn run(options: &Options, mut tell: impl FnMut(&str)) -> Result<Vec<Row>, BenchError> {
    let entries = std::fs::read_dir(&options.scenes)
        .into_iter()
        .flatten()
        .flatten()
        .map(|entry| entry.path());
    let mut scenes: Vec<PathBuf> = entries
        .filter(|path| path.extension().is_some_and(|extension| extension == "toml"))
        .collect();
    scenes.sort();
    if scenes.is_empty() {
        let why = format!("skipped: no scenes in {} (--scenes)", options.scenes.display());
        return Ok(vec![Row::new("the loop on the real clock", why, None, "")]);
    }
    let seconds = if options.quick { 1 } else { RUN_S };
    let mut rows = Vec::new();
    for scene in scenes.iter().take(if options.quick { 1 } else { usize::MAX }) {
        let name = scene.file_stem().unwrap_or_default().to_string_lossy();
        tell(&format!("{name}: {seconds} s on the real clock"));
        let flags = [
            "--monitor",
            "off",
            "--realtime",
            "best-effort",
            "--duration",
            &format!("{seconds}s"),
            "--json",
            "--quiet",
        ]
        .map(str::to_owned);
        let ended =
            process::run(process::hapticd(&options.program).arg("run").arg(scene).args(flags))?;
        let realtime = &ended.json["realtime"];
        tell(&format!("cyclictest, {seconds} s"));
        let beside = cyclictest(realtime, seconds);
        rows.extend(scene_rows(&name, &ended.json, &beside));
    }
    Ok(rows)
}

fn scene_rows(name: &str, json: &Value, beside: &Result<Latency, String>) -> Vec<Row> {
    let realtime = &json["realtime"];
    let text = |key: &str| realtime[key].as_str().unwrap_or("unknown").to_owned();
    let group = format!("{name}: real clock, {}", text("policy"));
    let us = |times: &str, key: &str| json[times][key].as_f64();
    let mut rows = vec![
        Row::new(&group, "ticks", json["ticks"].as_f64(), ""),
        Row::new(&group, "tick compute, p50", us("compute_us", "p50"), "µs"),
        Row::new(&group, "tick compute, p99", us("compute_us", "p99"), "µs"),
        Row::new(&group, "tick compute, p99.9", us("compute_us", "p999"), "µs").at_most(250.0),
        Row::new(&group, "tick compute, max", us("compute_us", "max"), "µs"),
    ];
    let peer = |of: fn(&Latency) -> f64| beside.as_ref().map(of).map_err(Clone::clone);
    let latency = |what: &str, key: &str, of| {
        Row::new(&group, format!("wake-up, {what}"), us("wakeup_us", key), "µs")
            .beside_peer("cyclictest", &peer(of))
    };
    rows.push(latency("p50", "p50", |latency| latency.p50_us));
    rows.push(latency("p99", "p99", |latency| latency.p99_us));
    // At most 1.1 times as late.
    rows.push(latency("p99.9", "p999", |latency| latency.p999_us).at_least_times(0.909));
    rows.push(latency("max", "max", |latency| latency.max_us));
    rows.push(
        Row::new(&group, "missed deadlines", json["missed_deadlines"].as_f64(), "").at_most(0.0),
    );
    rows
}

/// Wake-up latency, µs.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Latency {
    p50_us: f64,
    p99_us: f64,
    p999_us: f64,
    max_us: f64,
}

/// One thread with the priority and on the processor of the run before.
fn cyclictest(realtime: &Value, seconds: u32) -> Result<Latency, String> {
    let priority = realtime["priority"].as_u64().unwrap_or(0);
    let mut command = Command::new("cyclictest");
    command.args(["-m", "-q", "-t", "1", "-i", "1000", "-p", &priority.to_string()]);
    command.args(["-l", &(1000 * seconds).to_string(), "-h", &HISTOGRAM_US.to_string()]);
    if let Some(cpu) = realtime["cpu"].as_u64() {
        command.args(["-a", &cpu.to_string()]);
    }
    let said = command.output().map_err(|error| match error.kind() {
        std::io::ErrorKind::NotFound => "not installed".to_owned(),
        _ => error.to_string(),
    })?;
    if !said.status.success() {
        let why =
            String::from_utf8_lossy(&said.stderr).lines().next().unwrap_or_default().to_owned();
        return Err(format!("{}: {why}", said.status));
    }
    percentiles(&String::from_utf8_lossy(&said.stdout))
        .ok_or_else(|| "its histogram is not readable".to_owned())
}

/// From lines of `LATENCY_US COUNT` and the comment `# Max Latencies: N`.
fn percentiles(histogram: &str) -> Option<Latency> {
    let bins: Vec<(f64, u64)> = histogram
        .lines()
        .filter(|line| !line.starts_with('#'))
        .filter_map(|line| {
            let mut words = line.split_whitespace();
            Some((words.next()?.parse().ok()?, words.next()?.parse().ok()?))
        })
        .collect();
    let number_behind = |word: &str| {
        let line = histogram.lines().find_map(|line| line.strip_prefix(word))?;
        line.split_whitespace().next()?.parse::<f64>().ok()
    };
    let max_us = number_behind("# Max Latencies:")?;
    let overflows = number_behind("# Histogram Overflows:").unwrap_or(0.0) as u64;
    let n = bins.iter().map(|(_, count)| count).sum::<u64>() + overflows;
    let at = |share: f64| {
        let rank = (share * n as f64).ceil() as u64;
        let mut seen = 0;
        bins.iter()
            .find(|(_, count)| {
                seen += count;
                seen >= rank
            })
            .map_or(max_us, |(us, _)| *us)
    };
    (n > 0).then(|| Latency { p50_us: at(0.5), p99_us: at(0.99), p999_us: at(0.999), max_us })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_histogram_gives_percentiles() {
        let text = "# /dev/cpu_dma_latency set to 0us\n# Histogram\n000000 000000\n000003 \
            000900\n000005 000090\n000040 000009\n# Total: 000000999\n# Min Latencies: 00003\n# \
            Avg Latencies: 00003\n# Max Latencies: 00712\n# Histogram Overflows: 00001\n";
        let latency = percentiles(text).unwrap();
        assert_eq!(latency, Latency { p50_us: 3.0, p99_us: 5.0, p999_us: 40.0, max_us: 712.0 });
        assert_eq!(percentiles("no numbers"), None);
    }
}
