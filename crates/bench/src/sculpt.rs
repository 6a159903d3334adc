//! Sculpting: how long a surface takes to be built and a clay model to be updated, beside the
//! paper, and how steady the force stays meanwhile.
//!
//! The paper's two tables (Guo2004, tables 2 and 3) are of models that are not public: here the
//! samples are those of a sphere, as many. As in the paper an update is one step of the mass points
//! and the motion of the samples, without samples that come or go.

use std::time::Instant;

use glam::DVec3;

use super::contact::clay::{Receding, RecedingForce};
use super::{BenchError, Row, statistics};
use clay::clay_model::{ClayModel, Settings};
use clay::dynamics::Integrator;
use clay::falloff::Falloff;
use clay::pull::PullForce;
use clay::{PointSet, PointSurface};
use haptics::CouplingMode;

/// What to measure.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Runs of each build; figures are medians.
    pub n_runs: usize,
    /// The smallest case of each table only.
    pub quick: bool,
}

/// What came of it.
#[derive(Clone, Debug, Default)]
pub struct Figures {
    /// The tables.
    pub rows: Vec<Row>,
    /// The force while clay recedes, at each rate of updates.
    pub receding: Vec<RecedingAt>,
}

/// The force at one rate of updates, without extrapolation and with it.
#[derive(Clone, Debug)]
pub struct RecedingAt {
    /// Updates per second.
    pub update_hz: f64,
    /// As it comes.
    pub raw: RecedingForce,
    /// As it is felt.
    pub extrapolated: RecedingForce,
}

/// Samples and the paper's seconds (table 2).
const BUILDS: [(usize, f64); 3] = [(4_500, 8.177_936), (8_000, 15.378_002), (67_038, 134.427_521)];
/// Mass points along an edge, samples inside, and the paper's milliseconds where they can be read
/// (table 3).
const UPDATES: [(usize, usize, Option<f64>); 6] = [
    (20, 6_060, None),
    (30, 6_060, Some(30.717)),
    (40, 6_060, Some(50.563)),
    (20, 16_071, Some(29.026)),
    (30, 16_071, Some(42.454)),
    (40, 16_071, Some(66.969)),
];
/// Seconds that the largest build may take, and milliseconds of the largest update.
const BUILD_TARGET_S: f64 = 2.0;
const UPDATE_TARGET_MS: f64 = 4.0;
/// Radius of the sphere, m.
const RADIUS_M: f64 = 0.03;
/// Updates that are timed, after some that bring the clay into motion.
const TIMED: usize = 60;
const BEFORE: usize = 10;
/// Time of an update, s.
const UPDATE_S: f64 = 4e-3;
/// Rates of updates at which the force is played, and the speed of the clay, m/s.
const RATES_HZ: [f64; 3] = [60.0, 250.0, 500.0];
const SPEED_M_PER_S: f64 = 0.05;
/// Ticks that are judged.
const TICKS: u64 = 400;

/// Measures. `tell` is called with each step. Cost: some seconds.
///
/// # Errors
/// A clay model that cannot be built, which a sphere can.
pub fn run(options: &Options, mut tell: impl FnMut(&str)) -> Result<Figures, BenchError> {
    let mut figures = Figures::default();
    let cases = |n: usize| if options.quick { 1 } else { n };
    for (n_samples, paper_s) in BUILDS.into_iter().take(cases(BUILDS.len())) {
        tell(&format!("building a surface of {n_samples} samples"));
        let seconds: Result<Vec<f64>, BenchError> =
            (0..options.n_runs).map(|_| build_s(n_samples)).collect();
        let row = Row::new(
            "building a surface",
            format!("{n_samples} samples"),
            statistics::median(&seconds?),
            "s",
        );
        let row = row.beside_paper(paper_s);
        figures.rows.push(if n_samples == BUILDS[2].0 { row.at_most(BUILD_TARGET_S) } else { row });
    }
    for (edge, n_samples, paper_ms) in UPDATES.into_iter().take(cases(UPDATES.len())) {
        tell(&format!("updating {edge}³ mass points and {n_samples} samples"));
        let ways = [
            ("implicit", Integrator::Implicit, false),
            ("explicit", Integrator::Explicit, false),
            ("implicit, a field that interpolates", Integrator::Implicit, true),
        ];
        for (name, integrator, interpolates) in ways {
            let times_ms = update_ms(edge, n_samples, integrator, interpolates)?;
            let what = format!("{edge}³ mass points, {n_samples} samples, {name}");
            let row = Row::new("updating a clay model", what, statistics::median(&times_ms), "ms");
            let row = if let Some(paper_ms) = paper_ms { row.beside_paper(paper_ms) } else { row };
            figures.rows.push(if (edge, n_samples) == (40, 16_071) && !interpolates {
                row.at_most(UPDATE_TARGET_MS)
            } else {
                row
            });
        }
    }
    for update_hz in RATES_HZ {
        tell(&format!("clay that recedes, updated at {update_hz} Hz"));
        let play = |extrapolates: bool| {
            let receding = Receding {
                speed_m_per_s: SPEED_M_PER_S,
                update_hz,
                extrapolates,
                coupling: CouplingMode::Direct,
            };
            receding.play(TICKS).map_err(|error| BenchError::Prepare {
                what: "receding clay".to_owned(),
                why: error.to_string(),
            })
        };
        let at = RecedingAt { update_hz, raw: play(false)?, extrapolated: play(true)? };
        let group = "largest step of the force between two ticks, clay receding at 50 mm/s, 1 N/mm";
        let step = |name: &str, force: &RecedingForce| {
            Row::new(
                group,
                format!("updates at {update_hz} Hz, {name}"),
                force.largest_felt_step_n(),
                "N",
            )
        };
        figures.rows.push(step("as they come", &at.raw));
        figures.rows.push(step("extrapolated", &at.extrapolated));
        figures.receding.push(at);
    }
    Ok(figures)
}

fn refused(error: impl ToString) -> BenchError {
    BenchError::Prepare { what: "a sphere of samples".to_owned(), why: error.to_string() }
}

fn build_s(n_samples: usize) -> Result<f64, BenchError> {
    let points = sphere(n_samples);
    let begin = Instant::now();
    let surface = PointSurface::build(points, PointSurface::DEFAULT_NEIGHBOURS).map_err(refused)?;
    let seconds = begin.elapsed().as_secs_f64();
    core::hint::black_box(surface);
    Ok(seconds)
}

/// Milliseconds of each update while the pole is pulled out.
fn update_ms(
    edge: usize,
    n_samples: usize,
    integrator: Integrator,
    interpolates: bool,
) -> Result<Vec<f64>, BenchError> {
    let settings = Settings { raster: [edge; 3], integrator, interpolates, ..Settings::default() };
    let mut model = ClayModel::new(sphere(n_samples), settings).map_err(refused)?;
    let mut times_ms = Vec::with_capacity(TIMED);
    for n in 0..BEFORE + TIMED {
        model
            .pull(&PullForce {
                along_map: vec![DVec3::Z * RADIUS_M],
                force_n: DVec3::Z * 2.0,
                reach_m: 5e-3,
                radius_m: 8e-3,
                falloff: Falloff::Gaussian,
            })
            .map_err(refused)?;
        let begin = Instant::now();
        core::hint::black_box(model.advance(UPDATE_S));
        if n >= BEFORE {
            times_ms.push(begin.elapsed().as_secs_f64() * 1e3);
        }
    }
    Ok(times_ms)
}

/// Even samples of a sphere, on a spiral of golden angles.
fn sphere(n_samples: usize) -> PointSet {
    let mut points = PointSet::default();
    for n in 0..n_samples {
        let z = 1.0 - (2 * n + 1) as f64 / n_samples as f64;
        let (sin, cos) = (n as f64 * 2.399_963_229_728_653).sin_cos();
        let across = (1.0 - z * z).sqrt();
        let normal = DVec3::new(across * cos, across * sin, z).normalize();
        points.push(normal * RADIUS_M, normal, [200; 3]);
    }
    points
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quick_run_fills_every_table() {
        let figures = run(&Options { n_runs: 1, quick: true }, |_| ()).unwrap();
        assert!(
            figures.rows.iter().all(|row| row.value.is_some_and(|value| value > 0.0)),
            "{:?}",
            figures.rows
        );
        assert_eq!(figures.receding.len(), RATES_HZ.len());
        for at in &figures.receding {
            let raw = at.raw.largest_felt_step_n();
            let smooth = at.extrapolated.largest_felt_step_n();
            assert!(smooth < 0.6 * raw, "{} Hz: {smooth} N after {raw} N", at.update_hz);
        }
    }
}
