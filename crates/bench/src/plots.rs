//! Plots of `bench contact --quality` and `bench sculpt`: sheets of charts over time, as SVG files.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use bench::BenchError;
use bench::contact::Quality;
use bench::contact::clay::RecedingForce;
use bench::contact::sliding::{DEPTHS_VOXELS, SlideForces};
use bench::sculpt::RecedingAt;
use recording::report::chart::{LEFT, PlotArea};

/// Of a sheet, pixels; charts stand two to a row.
const WIDTH: f64 = 1400.0;
const HEADER: f64 = 104.0;
const ROW: f64 = 300.0;
/// Above a chart, pixels.
const TITLE: f64 = 30.0;

const STYLE: &str = "text { font: 13px system-ui, sans-serif; fill: #6e7480; text-anchor: middle; } text.end { text-anchor: end; } \
    text.left { text-anchor: start; font-size: 15px; fill: #1e222a; } .grid { stroke: #e2e5ea; } path { fill: none; stroke-width: 1.6; stroke-linejoin: round; }";

/// Colours of curves, which all kinds of colour vision tell apart: what is compared with, what is between, what it is about.
const ORANGE: &str = "#e07a20";
const GREEN: &str = "#78aa6e";
const BLUE: &str = "#1c5ca0";

/// Between two ticks, s.
const STEP_S: f64 = 1e-3;
/// Ticks of a slide that are drawn: enough to see single voxels.
const DRAWN_TICKS: usize = 400;

/// Ticks of receding clay that are drawn.
const RECEDING_TICKS: usize = 150;

/// One curve.
struct Line {
    name: &'static str,
    color: &'static str,
    /// One for each time step; `NaN` leaves a gap.
    values: Vec<f64>,
}

/// Curves over the same time.
struct Chart {
    /// Above the chart, with the unit of the values.
    title: String,
    /// Drawn in this order, the last on top.
    lines: Vec<Line>,
}

impl Chart {
    fn draw(&self, svg: &mut String, [left, top]: [f64; 2]) {
        let finite = || self.lines.iter().flat_map(|line| &line.values).copied().filter(|value| value.is_finite());
        let (low, high) = (finite().fold(f64::INFINITY, f64::min), finite().fold(f64::NEG_INFINITY, f64::max));
        let (low, high) = if low <= high { (low, high) } else { (0.0, 0.0) };
        // A constant has a scale too.
        let margin = (0.06 * (high - low)).max(1e-3 * high.abs()).max(1e-12);
        let n_steps = self.lines.iter().map(|line| line.values.len()).max().unwrap_or(0).max(2) - 1;
        let frame =
            PlotArea { size: [0.5 * WIDTH, ROW - TITLE], x: [0.0, n_steps as f64 * STEP_S], y: [low - margin, high + margin] };
        let title = self.title.replace('&', "&amp;").replace('<', "&lt;");
        // Writing to a string cannot fail, here and below.
        let _ = write!(
            svg,
            "<g transform=\"translate({left} {top})\"><text class=\"left\" x=\"{LEFT}\" y=\"{}\">{title}</text>",
            TITLE - 4.0
        );
        let _ = write!(svg, "<g transform=\"translate(0 {TITLE})\">");
        frame.axes(svg, "s");
        for Line { color, values, .. } in &self.lines {
            let _ = write!(svg, "<path stroke=\"{color}\" d=\"");
            for (step, value) in values.iter().enumerate().filter(|(_, value)| value.is_finite()) {
                let is_first = step == 0 || !values[step - 1].is_finite();
                let _ =
                    write!(svg, "{}{:.1} {:.1}", if is_first { 'M' } else { 'L' }, frame.x(step as f64 * STEP_S), frame.y(*value));
            }
            svg.push_str("\"/>");
        }
        svg.push_str("</g></g>");
    }
}

/// Makes the folder that [`draw`] writes into.
pub(super) fn make_folder(folder: &Path) -> Result<(), BenchError> {
    std::fs::create_dir_all(folder).map_err(|source| BenchError::Write { path: folder.to_owned(), source })
}

/// Writes `smoothness-force-law.svg` and `smoothness-on-the-hand.svg`.
pub(super) fn draw(folder: &Path, quality: &Quality) -> Result<(), BenchError> {
    let law: Vec<Chart> =
        quality.slides.iter().filter(|slid| slid.depth_voxels.total_cmp(&DEPTHS_VOXELS[0]).is_eq()).map(law_chart).collect();
    // A quick run slides nothing.
    write(
        folder.join("smoothness-force-law.svg"),
        "Sliding at constant depth over the shipped scenes, 50 mm/s, a quarter of a voxel deep",
        "force along its mean, % of the mean: what a hand would feel that is moved exactly",
        &law,
    )?;
    let hand: Vec<Chart> = quality
        .felt
        .iter()
        .map(|felt| Chart {
            title: format!("{}, N", felt.scene),
            lines: vec![
                Line { name: "raw field of 2008 through the same coupling", color: ORANGE, values: felt.raw.clone() },
                Line { name: "as shipped", color: BLUE, values: felt.shipped.clone() },
            ],
        })
        .collect();
    write(
        folder.join("smoothness-on-the-hand.svg"),
        "Force on the hand in the shipped scenes, simulated sigma.7-class arm",
        "a second of the longest contact: steps of the encoder times the stiffness of the coupling are part of both",
        &hand,
    )
}

/// Writes `receding-clay.svg`: the force while clay goes back under a point, at each rate of updates.
pub(super) fn draw_receding(folder: &Path, receding: &[RecedingAt]) -> Result<(), BenchError> {
    let chart = |at: &RecedingAt| {
        let drawn = |force: &RecedingForce| force.felt_n.iter().copied().take(RECEDING_TICKS).collect();
        Chart {
            title: format!("updates at {} Hz, N", at.update_hz),
            lines: vec![
                Line { name: "as they come", color: ORANGE, values: drawn(&at.raw) },
                Line { name: "extrapolated", color: BLUE, values: drawn(&at.extrapolated) },
            ],
        }
    };
    let charts: Vec<Chart> = receding.iter().map(chart).collect();
    let (title, note) = (
        "Force on the hand while clay recedes at 50 mm/s, 2 mm deep at 1 N/mm",
        "direct coupling, a tick every millisecond; an update in every tick would give 2 N throughout",
    );
    write(folder.join("receding-clay.svg"), title, note, &charts)
}

fn law_chart(slid: &SlideForces) -> Chart {
    let percent = |forces: &[glam::DVec3]| -> Vec<f64> {
        let mean = forces.iter().sum::<glam::DVec3>() / forces.len() as f64;
        forces.iter().take(DRAWN_TICKS).map(|force| 100.0 * force.dot(mean) / mean.length_squared()).collect()
    };
    Chart {
        title: match slid.times_smoother().filter(|times| times.is_finite()) {
            Some(times) => format!("{}: {times:.0} times smoother, %", slid.scene),
            None => format!("{}: without ripple, %", slid.scene),
        },
        lines: vec![
            Line { name: "raw, as in 2008", color: ORANGE, values: percent(&slid.raw) },
            Line { name: "without the low-pass", color: GREEN, values: percent(&slid.unfiltered) },
            Line { name: "as shipped", color: BLUE, values: percent(&slid.shipped) },
        ],
    }
}

/// Draws the charts two to a row; the legend is that of the first. No charts, no file.
fn write(path: PathBuf, title: &str, note: &str, charts: &[Chart]) -> Result<(), BenchError> {
    if charts.is_empty() {
        return Ok(());
    }
    let height = HEADER + ROW * charts.len().div_ceil(2) as f64;
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{WIDTH}\" height=\"{height}\" viewBox=\"0 0 {WIDTH} {height}\"><style>{STYLE}</style>\
         <rect width=\"{WIDTH}\" height=\"{height}\" fill=\"#fff\"/><text class=\"left\" x=\"36\" y=\"40\" style=\"font-size: 24px\">{title}</text>\
         <text class=\"left\" x=\"36\" y=\"66\">{note}</text>"
    );
    let mut x = 36.0;
    for Line { name, color, .. } in charts.iter().take(1).flat_map(|chart| &chart.lines) {
        let _ = write!(
            svg,
            "<path stroke=\"{color}\" style=\"stroke-width: 3\" d=\"M{x} 86h26\"/><text class=\"left\" x=\"{}\" y=\"91\">{name}</text>",
            x + 34.0
        );
        // About the width of a letter.
        x += 64.0 + 8.0 * name.len() as f64;
    }
    for (n, chart) in charts.iter().enumerate() {
        chart.draw(&mut svg, [(n % 2) as f64 * 0.5 * WIDTH, HEADER + (n / 2) as f64 * ROW]);
    }
    std::fs::write(&path, svg + "</svg>\n").map_err(|source| BenchError::Write { path, source })
}
