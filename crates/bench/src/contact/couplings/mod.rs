//! Forces on the hand: Q1 through the couplings, a peg that is inserted, slides over the shipped
//! scenes; and what to choose.

mod choice;
mod insertion;
mod slides;
mod smoothness;

use std::path::Path;

use glam::DVec3;
use toml::Value;

use self::insertion::InsertionResult;
use self::slides::SlideResult;
use self::smoothness::Smooth;
use super::super::{BenchError, Row};
use super::fields::Measured;
use super::ripple::{SHORTEST_S, ripple_rms};
use super::scenarios::RATE_HZ;
use super::scenes::{self, Edit, Played};
use super::{Csv, Options};
use hapticd::scene::cache::Cache;
use recording::TickRecord;

/// The words of a scene file; one that this version lacks is a row that says so.
const COUPLINGS: [&str; 2] = ["implicit", "direct"];

/// The force of 2008: the plane through the voxel, no filter.
fn raw() -> Vec<Edit> {
    vec![("rendering.field", "layers".into()), ("filter.cutoff_hz", "off".into())]
}

fn coupled(coupling: &str) -> Edit {
    ("rendering.coupling", coupling.into())
}

/// Figures through couplings.
pub(super) struct CouplingFigures {
    pub(super) rows: Vec<Row>,
    /// What to choose, as markdown.
    pub(super) choice: String,
    /// The longest contacts of the shipped scenes, for plots.
    pub(super) series: Vec<ForceSeries>,
}

/// Force on the hand in a shipped scene while it touches, N, tick by tick.
#[derive(Clone, Debug)]
pub struct ForceSeries {
    /// Name of the scene.
    pub scene: String,
    /// As shipped.
    pub shipped: Vec<f64>,
    /// The raw field through the same coupling, in the same ticks.
    pub raw: Vec<f64>,
}

pub(super) fn measure(
    options: &Options,
    measured: &[Measured],
    folder: &Path,
    csv: &mut Csv,
    cache: &mut Cache,
    tell: &mut dyn FnMut(&str),
) -> Result<CouplingFigures, BenchError> {
    let mut bench = Bench { options, folder, csv, cache, tell };
    let slides = bench.slides()?;
    let insertions = bench.insertions()?;
    let (smoothness, series) = bench.smoothness()?;
    let mut rows: Vec<Row> = slides.iter().flat_map(SlideResult::rows).collect();
    rows.extend(insertions.iter().flat_map(InsertionResult::rows));
    rows.extend(smoothness.iter().flat_map(Smooth::rows));
    Ok(CouplingFigures { rows, choice: choice::choice(measured, &slides, &insertions), series })
}

struct Bench<'a> {
    options: &'a Options,
    folder: &'a Path,
    csv: &'a mut Csv,
    cache: &'a mut Cache,
    tell: &'a mut dyn FnMut(&str),
}

/// What a variant of a scene gave, or why it did not run.
type Tried<T> = Result<T, String>;

impl Bench<'_> {
    fn tell(&mut self, what: &str) {
        (self.tell)(what);
    }

    fn played(&mut self, scene: &Path, edits: &[Edit]) -> Result<Tried<Played>, BenchError> {
        match scenes::load(scene, edits, self.folder) {
            Ok(config) => {
                let longest_s = if self.options.quick { 3.0 } else { f64::INFINITY };
                scenes::play(&config, self.cache, longest_s).map(Ok)
            }
            Err(why) => Ok(Err(why)),
        }
    }

    /// In `direct` the arm feels each point: a scene for another coupling gets the stiffest point
    /// that the arm takes.
    fn as_stiff_as_allowed(&self, scene: &Path, mut edits: Vec<Edit>) -> Vec<Edit> {
        const KEY: &str = "contact.stiffness_n_per_mm3";
        if scenes::load(scene, &edits, self.folder).is_err() {
            let soft: Vec<Edit> =
                edits.iter().cloned().chain([(KEY, Value::Float(1e-3))]).collect();
            if let Ok(config) = scenes::load(scene, &soft, self.folder) {
                // Rounded down: the text holds fewer digits than the bound.
                let n_per_mm = config.parameters.coupling.bound_n_per_m.floor() * 1e-3;
                let voxel_mm = config.tool.voxel_size_m * 1e3;
                edits.push((KEY, Value::Float(n_per_mm / (voxel_mm * voxel_mm))));
            }
        }
        edits
    }

    fn no_scenes(&self) -> String {
        format!("no such scene in {} (--scenes)", self.options.scenes.display())
    }
}

/// How often contact came or went.
fn changes(records: &[TickRecord]) -> usize {
    let touches = |record: &TickRecord| record.output.contacts > 0;
    records.windows(2).filter(|pair| touches(&pair[0]) != touches(&pair[1])).count()
}

fn commanded(record: &TickRecord) -> DVec3 {
    record.output.commanded_device.force
}

/// Contacts that last long enough to be called rough or smooth, without the moments in which they
/// come and go.
fn windows(records: &[TickRecord]) -> Vec<(usize, usize)> {
    const EDGE_TICKS: usize = 50;
    let mut windows = Vec::new();
    let mut from = None;
    for tick in 0..=records.len() {
        let touches = records.get(tick).is_some_and(|record| record.output.contacts > 0);
        match (from, touches) {
            (None, true) => from = Some(tick),
            (Some(begin), false) => {
                let inside = begin + EDGE_TICKS;
                let end = tick.saturating_sub(EDGE_TICKS);
                if end > inside && (end - inside) as f64 >= SHORTEST_S * RATE_HZ {
                    windows.push((inside, end));
                }
                from = None;
            }
            _ => {}
        }
    }
    windows
}

/// RMS over all windows together, N; `None` without any.
fn ripple_over(windows: &[(usize, usize)], forces: &[DVec3]) -> Option<f64> {
    let mut squares = 0.0;
    let mut n = 0;
    for (from, to) in windows {
        if let Some(rms_n) = ripple_rms(&forces[*from..*to], RATE_HZ) {
            squares += rms_n * rms_n * (to - from) as f64;
            n += to - from;
        }
    }
    (n > 0).then(|| (squares / n as f64).sqrt())
}
