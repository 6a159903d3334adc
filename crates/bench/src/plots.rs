//! Plots of `bench contact --quality` and `bench sculpt`.

use std::path::Path;

use bench::BenchError;
use bench::contact::Quality;
use bench::contact::clay::RecedingForce;
use bench::contact::sliding::{DEPTHS_VOXELS, Slid};
use bench::sculpt::RecedingAt;
use hapticd::picture::plot::{self, Chart, Line, Tone};

/// Between two ticks, s.
const STEP_S: f64 = 1e-3;
/// Ticks of a slide that are drawn: enough to see single voxels.
const DRAWN_TICKS: usize = 400;

/// Ticks of receding clay that are drawn.
const RECEDING_TICKS: usize = 150;

/// Makes the folder that [`draw`] writes into.
pub(super) fn make_folder(folder: &Path) -> Result<(), BenchError> {
    std::fs::create_dir_all(folder).map_err(|source| BenchError::Write { path: folder.to_owned(), source })
}

/// Writes `smoothness-force-law.png` and `smoothness-on-the-hand.png`.
pub(super) fn draw(folder: &Path, quality: &Quality) -> Result<(), BenchError> {
    let failed = |source| BenchError::Write { path: folder.to_owned(), source };
    let law: Vec<Chart> =
        quality.slides.iter().filter(|slid| slid.depth_voxels.total_cmp(&DEPTHS_VOXELS[0]).is_eq()).map(law_chart).collect();
    // A quick run slides nothing.
    let write = |path: &Path, title: &str, note: &str, charts: &[Chart]| match charts {
        [] => Ok(()),
        charts => plot::write(path, title, note, charts),
    };
    write(
        &folder.join("smoothness-force-law.png"),
        "Sliding at constant depth over the shipped scenes, 50 mm/s, a quarter of a voxel deep",
        "force along its mean, % of the mean: what a hand would feel that is moved exactly",
        &law,
    )
    .map_err(failed)?;
    let hand: Vec<Chart> = quality
        .felt
        .iter()
        .map(|felt| Chart {
            title: felt.scene.clone(),
            unit: "N",
            step_s: STEP_S,
            lines: vec![
                Line { name: "raw field of 2008 through the same coupling", tone: Tone::Orange, values: felt.raw.clone() },
                Line { name: "as shipped", tone: Tone::Blue, values: felt.shipped.clone() },
            ],
        })
        .collect();
    write(
        &folder.join("smoothness-on-the-hand.png"),
        "Force on the hand in the shipped scenes, simulated sigma.7-class arm",
        "a second of the longest contact: steps of the encoder times the stiffness of the coupling are part of both",
        &hand,
    )
    .map_err(failed)
}

/// Writes `receding-clay.png`: the force while clay goes back under a point, at each rate of updates.
pub(super) fn draw_receding(folder: &Path, receding: &[RecedingAt]) -> Result<(), BenchError> {
    let chart = |at: &RecedingAt| {
        let drawn = |force: &RecedingForce| force.felt_n.iter().copied().take(RECEDING_TICKS).collect();
        Chart {
            title: format!("updates at {} Hz", at.update_hz),
            unit: "N",
            step_s: STEP_S,
            lines: vec![
                Line { name: "as they come", tone: Tone::Orange, values: drawn(&at.raw) },
                Line { name: "extrapolated", tone: Tone::Blue, values: drawn(&at.extrapolated) },
            ],
        }
    };
    let charts: Vec<Chart> = receding.iter().map(chart).collect();
    let (title, note) = (
        "Force on the hand while clay recedes at 50 mm/s, 2 mm deep at 1 N/mm",
        "direct coupling, a tick every millisecond; an update in every tick would give 2 N throughout",
    );
    let path = folder.join("receding-clay.png");
    plot::write(&path, title, note, &charts).map_err(|source| BenchError::Write { path, source })
}

fn law_chart(slid: &Slid) -> Chart {
    let percent = |forces: &[glam::DVec3]| -> Vec<f64> {
        let mean = forces.iter().sum::<glam::DVec3>() / forces.len() as f64;
        forces.iter().take(DRAWN_TICKS).map(|force| 100.0 * force.dot(mean) / mean.length_squared()).collect()
    };
    Chart {
        title: match slid.times_smoother().filter(|times| times.is_finite()) {
            Some(times) => format!("{}: {times:.0} times smoother", slid.scene),
            None => format!("{}: without ripple", slid.scene),
        },
        unit: "%",
        step_s: STEP_S,
        lines: vec![
            Line { name: "raw, as in 2008", tone: Tone::Orange, values: percent(&slid.raw) },
            Line { name: "without the low-pass", tone: Tone::Green, values: percent(&slid.unfiltered) },
            Line { name: "as shipped", tone: Tone::Blue, values: percent(&slid.shipped) },
        ],
    }
}
