//! Work in processes of its own: a bake by this program, a peer. Each has its own peak of memory
//! and its own first touch.

use std::ffi::OsString;
use std::io::Read;
use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use serde_json::Value;

use super::BenchError;
use super::statistics::median;

/// The name under which the program that measures is started again, to be measured: it is then
/// `hapticd`, with the same code.
pub const HAPTICD: &str = "hapticd";

/// A call of `hapticd`. `program` is the one that measures.
pub(super) fn hapticd(program: &Path) -> Command {
    let mut command = Command::new(program);
    command.arg0(HAPTICD);
    command
}

/// What a process printed and took.
#[derive(Debug)]
pub(super) struct ProcessResult {
    /// Its last line of output.
    pub(super) json: Value,
    /// From start to end, s.
    pub(super) wall_s: f64,
    /// Largest resident set that was seen, bytes: the system's own high-water mark, read every few
    /// milliseconds.
    pub(super) peak_rss_bytes: Option<u64>,
}

/// Runs a command that prints a line of JSON.
pub(super) fn run(command: &mut Command) -> Result<ProcessResult, BenchError> {
    let (out, mut ended) = run_to_end(command)?;
    let line = out.lines().last().unwrap_or_default();
    ended.json = serde_json::from_str(line).map_err(|error| BenchError::Process {
        command: format!("{command:?}"),
        why: format!("its output is not JSON ({error}): {line}"),
    })?;
    Ok(ended)
}

/// Runs a command that prints anything: its output, and a result without JSON.
pub(super) fn run_to_end(command: &mut Command) -> Result<(String, ProcessResult), BenchError> {
    let shown = format!("{command:?}");
    let failed = |why: String| BenchError::Process { command: shown.clone(), why };
    let since = Instant::now();
    let mut child = command
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .map_err(|error| failed(error.to_string()))?;
    let readers = [
        child.stdout.take().map(|pipe| drain(Box::new(pipe))),
        child.stderr.take().map(|pipe| drain(Box::new(pipe))),
    ];
    let status_file = PathBuf::from(format!("/proc/{}/status", child.id()));
    let mut peak_rss_bytes = None;
    let status = loop {
        peak_rss_bytes = high_water_bytes(&status_file).max(peak_rss_bytes);
        match child.try_wait() {
            Ok(Some(status)) => break status,
            Ok(None) => std::thread::sleep(Duration::from_millis(5)),
            Err(error) => return Err(failed(error.to_string())),
        }
    };
    let wall_s = since.elapsed().as_secs_f64();
    let [out, err] =
        readers.map(|reader| reader.and_then(|reader| reader.join().ok()).unwrap_or_default());
    if !status.success() {
        return Err(failed(format!("{status}: {}", err.lines().last().unwrap_or_default())));
    }
    Ok((out, ProcessResult { json: Value::Null, wall_s, peak_rss_bytes }))
}

fn drain(mut pipe: Box<dyn Read + Send>) -> std::thread::JoinHandle<String> {
    std::thread::spawn(move || {
        let mut bytes = Vec::new();
        // A pipe that breaks ends the output there; the exit status says the rest.
        let _ = pipe.read_to_end(&mut bytes);
        String::from_utf8_lossy(&bytes).into_owned()
    })
}

fn high_water_bytes(status_file: &Path) -> Option<u64> {
    let status = std::fs::read_to_string(status_file).ok()?;
    let kib = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    kib.trim().trim_end_matches("kB").trim().parse::<u64>().ok().map(|kib| kib * 1024)
}

/// How large the voxels of a bake are.
#[derive(Clone, Copy, Debug)]
pub(super) enum Resolution {
    /// Edge, mm, of a mesh in mm.
    SizeMm(f64),
    /// Voxels on the longest axis of a mesh in m.
    LongestAxis(u32),
}

/// A bake to be measured.
#[derive(Clone, Debug)]
pub(super) struct Bake<'a> {
    pub(super) mesh: &'a Path,
    pub(super) resolution: Resolution,
    /// Name on the command line, for the paper's own way, which takes the triangles as they are and
    /// fills; `None` bakes as a user does.
    pub(super) navigation: Option<&'static str>,
    pub(super) n_threads: usize,
}

impl Bake<'_> {
    /// A process that bakes this and nothing else.
    pub(super) fn run(&self, program: &Path) -> Result<ProcessResult, BenchError> {
        let mut flags: Vec<OsString> = vec![
            "bake".into(),
            self.mesh.into(),
            "--json".into(),
            "--quiet".into(),
            "--cache".into(),
            "off".into(),
        ];
        match self.resolution {
            Resolution::SizeMm(size) => flags.extend([
                "--units".into(),
                "mm".into(),
                "--voxel-size-mm".into(),
                size.to_string().into(),
            ]),
            Resolution::LongestAxis(n) => {
                flags.extend([
                    "--units".into(),
                    "m".into(),
                    "--longest-axis-voxels".into(),
                    n.to_string().into(),
                ]);
            }
        }
        if let Some(navigation) = self.navigation {
            let flood = ["--sides", "flood", "--navigation", navigation];
            flags.extend(flood.map(OsString::from));
        }
        flags.extend(["--threads".into(), self.n_threads.to_string().into()]);
        run(hapticd(program).args(flags))
    }
}

/// The same bake, several times.
#[derive(Debug, Default)]
pub(super) struct Bakes(Vec<ProcessResult>);

/// Stages of a bake in order; one that the program does not have is left out of the tables.
pub(super) const STAGES: [&str; 9] =
    ["load", "init", "surface", "fill", "layers", "distance", "pointshell", "normals", "tree"];

impl Bakes {
    pub(super) fn push(&mut self, ended: ProcessResult) {
        self.0.push(ended);
    }

    /// Median of a stage, s; `None` for one that does not exist.
    pub(super) fn stage_s(&self, stage: &str) -> Option<f64> {
        median(
            &self
                .0
                .iter()
                .filter_map(|ended| ended.json["timings_s"][stage].as_f64())
                .collect::<Vec<_>>(),
        )
    }

    /// Median over the runs of the sum of some stages, s; stages that do not exist count nothing.
    pub(super) fn sum_s(&self, stages: &[&str]) -> Option<f64> {
        let sum = |ended: &ProcessResult| {
            stages.iter().filter_map(|stage| ended.json["timings_s"][stage].as_f64()).sum()
        };
        median(&self.0.iter().map(sum).collect::<Vec<f64>>())
    }

    /// Median from start to end of the process, s.
    pub(super) fn wall_s(&self) -> Option<f64> {
        median(&self.0.iter().map(|ended| ended.wall_s).collect::<Vec<_>>())
    }

    /// Median peak of memory, MB.
    pub(super) fn peak_mb(&self) -> Option<f64> {
        median(
            &self
                .0
                .iter()
                .filter_map(|ended| ended.json["peak_rss_bytes"].as_f64())
                .map(|bytes| bytes * 1e-6)
                .collect::<Vec<_>>(),
        )
    }

    /// A number that is the same in every run.
    pub(super) fn count(&self, key: &str) -> Option<f64> {
        self.0.last().and_then(|ended| ended.json[key].as_f64())
    }

    /// A word that is the same in every run.
    pub(super) fn text(&self, key: &str) -> Option<&str> {
        self.0.last().and_then(|ended| ended.json[key].as_str())
    }

    /// Yes or no, the same in every run.
    pub(super) fn is(&self, key: &str) -> Option<bool> {
        self.0.last().and_then(|ended| ended.json[key].as_bool())
    }

    /// Voxels per axis, with one voxel of padding on every side as the paper's, whatever the layers
    /// ask for.
    pub(super) fn dims_padded_by_one(&self) -> Option<[u64; 3]> {
        let ended = self.0.last()?;
        let layers = ended.json["layers"].as_u64()?;
        let dim =
            |axis: usize| ended.json["dims"][axis].as_u64().map(|n| n.saturating_sub(2 * layers));
        Some([dim(0)?, dim(1)?, dim(2)?])
    }
}
