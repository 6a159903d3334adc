//! Plots of `bench contact --quality`, `bench sculpt` and `bench wrench`, sheets of charts over
//! time, and of `bench sagardia-2008`, charts over voxels; as SVG files.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use bench::BenchError;
use bench::contact::Quality;
use bench::contact::clay::RecedingForce;
use bench::contact::sliding::{DEPTHS_VOXELS, SlideForces};
use bench::contact::wrench;
use bench::sagardia2008::{Figures, Step};
use bench::sculpt::RecedingAt;
use bench::stand_ins::StandIn;
use recording::report::plots::{LEFT, PlotArea, short, steps};

/// Of a sheet, pixels; charts stand two to a row.
const WIDTH: f64 = 1400.0;
const HEADER: f64 = 104.0;
const ROW: f64 = 300.0;
/// Above a chart, pixels.
const TITLE: f64 = 30.0;

const STYLE: &str = "text { font: 13px system-ui, sans-serif; fill: #6e7480; text-anchor: middle; \
    } text.end { text-anchor: end; } text.left { text-anchor: start; font-size: 15px; fill: \
    #1e222a; } .grid { stroke: #e2e5ea; } path { fill: none; stroke-width: 1.6; stroke-linejoin: \
    round; }";

/// Colours of curves, which all kinds of colour vision tell apart: what is compared with, what is
/// between, what it is about.
const ORANGE: &str = "#e07a20";
const GREEN: &str = "#78aa6e";
const BLUE: &str = "#1c5ca0";
/// What the paper says.
const GREY: &str = "#6e7480";
/// Of programs, in their order; the last of all that joined.
const PROGRAMS: [&str; 7] = [BLUE, "#56a0d3", GREY, GREEN, ORANGE, "#a03070", "#1e222a"];

/// Between two ticks, s.
const STEP_S: f64 = 1e-3;
/// Ticks of a slide that are drawn: enough to see single voxels.
const DRAWN_TICKS: usize = 400;

/// Ticks of receding clay that are drawn.
const RECEDING_TICKS: usize = 150;

/// One curve.
struct Line {
    name: String,
    color: &'static str,
    /// From left to right; a `NaN` leaves a gap.
    points: Vec<[f64; 2]>,
    /// Names of the points: they are dots then, without a curve.
    dots: Vec<String>,
}

impl Line {
    fn new(name: impl Into<String>, color: &'static str, points: Vec<[f64; 2]>) -> Self {
        Self { name: name.into(), color, points, dots: Vec::new() }
    }

    /// One value for each time step.
    fn over_time(name: impl Into<String>, color: &'static str, values: Vec<f64>) -> Self {
        let points =
            values.into_iter().enumerate().map(|(step, value)| [step as f64 * STEP_S, value]);
        Self::new(name, color, points.collect())
    }
}

/// Curves over the same axis.
struct LinePlot {
    /// Above the chart, with the unit of the values.
    title: String,
    /// Of the lower axis.
    unit_x: &'static str,
    /// Of each axis: goes up by factors.
    is_log: [bool; 2],
    /// Drawn in this order, the last on top.
    lines: Vec<Line>,
}

impl LinePlot {
    fn over_time(title: String, lines: Vec<Line>) -> Self {
        Self { title, unit_x: "s", is_log: [false; 2], lines }
    }

    fn draw(&self, svg: &mut String, [left, top]: [f64; 2]) {
        let scaled = |point: &[f64; 2]| {
            [0, 1].map(|axis| if self.is_log[axis] { point[axis].log10() } else { point[axis] })
        };
        let range = |axis: usize| {
            let finite = || {
                self.lines
                    .iter()
                    .flat_map(|line| &line.points)
                    .map(|point| scaled(point)[axis])
                    .filter(|value| value.is_finite())
            };
            let low = finite().fold(f64::INFINITY, f64::min);
            let high = finite().fold(f64::NEG_INFINITY, f64::max);
            if low <= high { (low, high) } else { (0.0, 0.0) }
        };
        let (low, high) = range(1);
        // A constant has a scale too.
        let margin = (0.06 * (high - low)).max(1e-3 * high.abs()).max(1e-12);
        let (begin, end) = range(0);
        let frame = PlotArea {
            size: [0.5 * WIDTH, ROW - TITLE],
            x: [begin, end.max(begin + STEP_S)],
            y: [low - margin, high + margin],
        };
        let title = self.title.replace('&', "&amp;").replace('<', "&lt;");
        // Writing to a string cannot fail, here and below.
        let _ = write!(
            svg,
            "<g transform=\"translate({left} {top})\"><text class=\"left\" x=\"{LEFT}\" \
                y=\"{}\">{title}</text>",
            TITLE - 4.0
        );
        let _ = write!(svg, "<g transform=\"translate(0 {TITLE})\">");
        if self.is_log == [false; 2] {
            frame.axes(svg, self.unit_x)
        } else {
            log_axes(svg, &frame, self.is_log, self.unit_x)
        }
        for Line { color, points, dots, .. } in &self.lines {
            let places: Vec<[f64; 2]> = points.iter().map(scaled).collect();
            let is_drawn = |place: &[f64; 2]| place.iter().all(|value| value.is_finite());
            for (place, name) in places.iter().zip(dots).filter(|(place, _)| is_drawn(place)) {
                let x = frame.x(place[0]);
                let y = frame.y(place[1]);
                let _ = write!(
                    svg,
                    "<circle fill=\"{color}\" cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"4\"/><text \
                        x=\"{x:.1}\" y=\"{:.1}\">{name}</text>",
                    y - 8.0
                );
            }
            if !dots.is_empty() {
                continue;
            }
            let _ = write!(svg, "<path stroke=\"{color}\" d=\"");
            for (step, place) in places.iter().enumerate().filter(|(_, place)| is_drawn(place)) {
                let is_first = step == 0 || !is_drawn(&places[step - 1]);
                let _ = write!(
                    svg,
                    "{}{:.1} {:.1}",
                    if is_first { 'M' } else { 'L' },
                    frame.x(place[0]),
                    frame.y(place[1])
                );
            }
            svg.push_str("\"/>");
        }
        svg.push_str("</g></g>");
    }
}

/// Grid and numbers of axes of which one or both go up by factors; `area` is in powers of ten
/// there.
fn log_axes(svg: &mut String, area: &PlotArea, is_log: [bool; 2], unit_x: &str) {
    let [from, to] = [area.x(area.x[0]), area.x(area.x[1])];
    let [bottom, top] = [area.y(area.y[0]), area.y(area.y[1])];
    for (value, name) in ticks(area.y, is_log[1], area.size[1] / 47.5) {
        let y = area.y(value);
        let _ = write!(
            svg,
            "<line class=\"grid\" x1=\"{from:.1}\" x2=\"{to:.1}\" y1=\"{y:.1}\" y2=\"{y:.1}\"/>"
        );
        let _ = write!(
            svg,
            "<text class=\"end\" x=\"{:.1}\" y=\"{:.1}\">{name}</text>",
            from - 6.0,
            y + 4.0
        );
    }
    for (value, name) in ticks(area.x, is_log[0], 10.0) {
        let x = area.x(value);
        let _ = write!(
            svg,
            "<line class=\"grid\" x1=\"{x:.1}\" x2=\"{x:.1}\" y1=\"{bottom:.1}\" y2=\"{top:.1}\"/>"
        );
        let _ = write!(svg, "<text x=\"{x:.1}\" y=\"{:.1}\">{name}</text>", bottom + 18.0);
    }
    let _ =
        write!(svg, "<text class=\"end\" x=\"{to:.1}\" y=\"{:.1}\">{unit_x}</text>", bottom + 29.0);
}

/// Round numbers of an axis and their names: by factors of ten, with 2 and 5 between them where
/// there are few; or about so many in equal steps.
fn ticks(range: [f64; 2], is_log: bool, wanted: f64) -> Vec<(f64, String)> {
    if !is_log {
        return steps(range, wanted).into_iter().map(|value| (value, short(value))).collect();
    }
    let factors: &[i32] = if range[1] - range[0] < 2.5 { &[1, 2, 5] } else { &[1] };
    let powers = range[0].floor() as i32..=range[1].floor() as i32;
    let all = powers.flat_map(|power| factors.iter().map(move |factor| (*factor, power)));
    let placed = all.map(|(factor, power)| {
        let name = match (factor, power) {
            (_, -3..4) => short(f64::from(factor) * 10_f64.powi(power)),
            (1, _) => format!("10{}", superscript(power)),
            _ => format!("{factor}·10{}", superscript(power)),
        };
        (f64::from(factor).log10() + f64::from(power), name)
    });
    placed.filter(|(at, _)| (range[0]..=range[1]).contains(at)).collect()
}

fn superscript(power: i32) -> String {
    let digit = |c: char| match c {
        '-' => '⁻',
        '1' => '¹',
        '2' => '²',
        '3' => '³',
        c => char::from_u32('⁰' as u32 + (c as u32 - '0' as u32)).unwrap_or(c),
    };
    power.to_string().chars().map(digit).collect()
}

/// Makes the folder that [`draw`] writes into.
pub(super) fn make_folder(folder: &Path) -> Result<(), BenchError> {
    std::fs::create_dir_all(folder)
        .map_err(|source| BenchError::Write { path: folder.to_owned(), source })
}

/// Writes `smoothness-force-law.svg` and `smoothness-on-the-hand.svg`.
pub(super) fn draw(folder: &Path, quality: &Quality) -> Result<(), BenchError> {
    let law: Vec<LinePlot> = quality
        .slides
        .iter()
        .filter(|slid| slid.depth_voxels.total_cmp(&DEPTHS_VOXELS[0]).is_eq())
        .map(law_chart)
        .collect();
    // A quick run slides nothing.
    write(
        folder.join("smoothness-force-law.svg"),
        "Sliding at constant depth over the shipped scenes, 50 mm/s, a quarter of a voxel deep",
        "force along its mean, % of the mean: what a hand would feel that is moved exactly",
        &law,
    )?;
    let hand: Vec<LinePlot> = quality
        .felt
        .iter()
        .map(|felt| {
            let lines = vec![
                Line::over_time(
                    "raw field of 2008 through the same coupling",
                    ORANGE,
                    felt.raw.clone(),
                ),
                Line::over_time("as shipped", BLUE, felt.shipped.clone()),
            ];
            LinePlot::over_time(format!("{}, N", felt.scene), lines)
        })
        .collect();
    write(
        folder.join("smoothness-on-the-hand.svg"),
        "Force on the hand in the shipped scenes, simulated sigma.7-class arm",
        "a second of the longest contact: steps of the encoder times the stiffness of the coupling \
            are part of both",
        &hand,
    )
}

/// Writes `receding-clay.svg`: the force while clay goes back under a point, at each rate of
/// updates.
pub(super) fn draw_receding(folder: &Path, receding: &[RecedingAt]) -> Result<(), BenchError> {
    let chart = |at: &RecedingAt| {
        let drawn =
            |force: &RecedingForce| force.felt_n.iter().copied().take(RECEDING_TICKS).collect();
        let lines = vec![
            Line::over_time("as they come", ORANGE, drawn(&at.raw)),
            Line::over_time("extrapolated", BLUE, drawn(&at.extrapolated)),
        ];
        LinePlot::over_time(format!("updates at {} Hz, N", at.update_hz), lines)
    };
    let charts: Vec<LinePlot> = receding.iter().map(chart).collect();
    let title = "Force on the hand while clay recedes at 50 mm/s, 2 mm deep at 1 N/mm";
    let note = "direct coupling, a tick every millisecond; an update in every tick would give 2 N \
        throughout";
    write(folder.join("receding-clay.svg"), title, note, &charts)
}

/// Writes `wrench-size.svg` and `wrench-angle.svg`: a chart for each scene with a closed form, a
/// curve for each program.
pub(super) fn draw_wrenches(folder: &Path, figures: &wrench::Figures) -> Result<(), BenchError> {
    // Beyond this a curve would flatten all others: there it has a gap.
    const SHOWN_PERCENT: [f64; 2] = [50.0, 150.0];
    const LEAST_DEG: f64 = 1e-3;
    let held: Vec<_> =
        figures.programs.iter().map(|program| (&program.name, figures.held(program))).collect();
    let Some((_, first)) = held.first() else { return Ok(()) };
    let charts = |is_log: bool, value: &dyn Fn([f64; 2]) -> f64| -> Vec<LinePlot> {
        let chart = |title: &String| {
            let lines = held.iter().enumerate().filter_map(|(idx, (program, scenes))| {
                let (_, values) = scenes.iter().find(|(name, _)| name == title)?;
                let color = PROGRAMS[idx.min(PROGRAMS.len() - 1)];
                Some(Line::over_time(
                    program.as_str(),
                    color,
                    values.iter().map(|at| value(*at)).collect(),
                ))
            });
            LinePlot {
                is_log: [false, is_log],
                ..LinePlot::over_time(title.clone(), lines.collect())
            }
        };
        first.iter().map(|(title, _)| chart(title)).collect()
    };
    let shown = |[percent, _]: [f64; 2]| {
        if (SHOWN_PERCENT[0]..=SHOWN_PERCENT[1]).contains(&percent) { percent } else { f64::NAN }
    };
    write(
        folder.join("wrench-size.svg"),
        "Size of the force in a contact that is held, % of the closed form",
        "after scaling by one number for each program; what is below 50 % or above 150 % is left \
            out",
        &charts(false, &shown),
    )?;
    write(
        folder.join("wrench-angle.svg"),
        "Angle between the force and the closed form in a contact that is held, °",
        "what is below a thousandth of a degree is drawn there",
        &charts(true, &|[_, angle_deg]| angle_deg.max(LEAST_DEG)),
    )
}

fn law_chart(slid: &SlideForces) -> LinePlot {
    let percent = |forces: &[glam::DVec3]| -> Vec<f64> {
        let mean = forces.iter().sum::<glam::DVec3>() / forces.len() as f64;
        forces
            .iter()
            .take(DRAWN_TICKS)
            .map(|force| 100.0 * force.dot(mean) / mean.length_squared())
            .collect()
    };
    let title = match slid.times_smoother().filter(|times| times.is_finite()) {
        Some(times) => format!("{}: {times:.0} times smoother, %", slid.scene),
        None => format!("{}: without ripple, %", slid.scene),
    };
    let lines = vec![
        Line::over_time("raw, as in 2008", ORANGE, percent(&slid.raw)),
        Line::over_time("without the low-pass", GREEN, percent(&slid.unfiltered)),
        Line::over_time("as shipped", BLUE, percent(&slid.shipped)),
    ];
    LinePlot::over_time(title, lines)
}

/// Writes `sagardia-2008-points.svg`, after figure 6 of the paper, and `sagardia-2008-ratios.svg`,
/// after its figure 7.
pub(super) fn draw_paper_of_2008(folder: &Path, figures: &Figures) -> Result<(), BenchError> {
    let charts: Vec<LinePlot> =
        figures.models().map(|(stand_in, steps)| points_chart(figures, stand_in, &steps)).collect();
    write(
        folder.join("sagardia-2008-points.svg"),
        "Points of a pointshell, after figure 6 of Sagardia2008",
        "stand-ins for the models of the paper, whose own counts are the dots, by case of its \
            table 1",
        &charts,
    )?;
    let of_models = |value: fn(&Step) -> f64, paper: &dyn Fn(StandIn) -> Vec<(char, f64, f64)>| {
        let curves = figures.models().map(|(stand_in, steps)| {
            let points = steps.iter().map(|step| [step.voxels as f64, value(step)]);
            Line::new(stand_in.name(), color_of(stand_in), points.collect())
        });
        let mut lines: Vec<Line> = curves.collect();
        let dots: Vec<_> = figures.models().flat_map(|(stand_in, _)| paper(stand_in)).collect();
        let points = dots.iter().map(|(_, voxels, ratio)| [*voxels, *ratio]).collect();
        let names = dots.iter().map(|(name, ..)| format!("({name})")).collect();
        lines.push(Line {
            dots: names,
            ..Line::new("the paper, by case of its table 1", GREY, points)
        });
        // What has no point has no place in the legend either.
        lines.retain(|line| !line.points.is_empty());
        lines
    };
    let pointshell_deltas = |stand_in| {
        let deltas = figures.paper_pointshell_deltas(stand_in).into_iter();
        deltas.map(|(name, voxels, delta, _)| (name, voxels, delta)).collect()
    };
    let chart = |title: &str, is_log_y: bool, lines| LinePlot {
        title: title.to_owned(),
        unit_x: "voxels",
        is_log: [true, is_log_y],
        lines,
    };
    write(
        folder.join("sagardia-2008-ratios.svg"),
        "Ratios of times, after figure 7 of Sagardia2008",
        "the paper: the generator before it over its own; here: the naïve way over the second \
            navigation, and the two phases as printed over what is shipped",
        &[
            chart(
                "voxmap: Δ",
                true,
                of_models(Step::delta, &|stand_in| figures.paper_voxmap_deltas(stand_in)),
            ),
            chart("pointshell: Δ", true, of_models(|step| step.points.delta(), &pointshell_deltas)),
            chart(
                "first over second navigation: above 1 the second one is faster",
                false,
                of_models(Step::first_over_second, &|_| Vec::new()),
            ),
        ],
    )
}

fn color_of(stand_in: StandIn) -> &'static str {
    match stand_in {
        StandIn::Bracket => GREEN,
        StandIn::Brake => BLUE,
        StandIn::Car => ORANGE,
    }
}

fn points_chart(figures: &Figures, stand_in: StandIn, steps: &[&Step]) -> LinePlot {
    let curve = |name, color, count: &dyn Fn(&Step) -> u64| {
        Line::new(
            name,
            color,
            steps.iter().map(|step| [step.voxels as f64, count(step) as f64]).collect(),
        )
    };
    let paper = figures.paper_pointshell_deltas(stand_in);
    let dots = Line {
        dots: paper.iter().map(|(name, ..)| format!("({name})")).collect(),
        ..Line::new(
            "the paper",
            GREY,
            paper.iter().map(|(_, voxels, _, points)| [*voxels, *points]).collect(),
        )
    };
    let mut lines = vec![
        curve("all projections", ORANGE, &|step| step.points.phases.projections()),
        curve("two phases as printed", GREEN, &|step| step.points.phases.points()),
        curve("as shipped, one for each voxel", BLUE, &|step| step.surface_voxels as u64),
        dots,
    ];
    lines.retain(|line| !line.points.is_empty());
    LinePlot {
        title: format!("{}: points", stand_in.name()),
        unit_x: "voxels",
        is_log: [true; 2],
        lines,
    }
}

/// Draws the charts two to a row; the legend is that of the first. No charts, no file.
fn write(path: PathBuf, title: &str, note: &str, charts: &[LinePlot]) -> Result<(), BenchError> {
    if charts.is_empty() {
        return Ok(());
    }
    let height = HEADER + ROW * charts.len().div_ceil(2) as f64;
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{WIDTH}\" height=\"{height}\" \
            viewBox=\"0 0 {WIDTH} {height}\"><style>{STYLE}</style><rect width=\"{WIDTH}\" \
            height=\"{height}\" fill=\"#fff\"/><text class=\"left\" x=\"36\" y=\"40\" \
            style=\"font-size: 24px\">{title}</text><text class=\"left\" x=\"36\" \
            y=\"66\">{note}</text>"
    );
    let mut x = 36.0;
    for Line { name, color, .. } in charts.iter().take(1).flat_map(|chart| &chart.lines) {
        let _ = write!(
            svg,
            "<path stroke=\"{color}\" style=\"stroke-width: 3\" d=\"M{x} 86h26\"/><text \
                class=\"left\" x=\"{}\" y=\"91\">{name}</text>",
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
