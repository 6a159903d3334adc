//! Charts as SVG text: axes for any values, envelopes over time, histograms.
//!
//! Style sheets of the page give the classes their looks: `grid` and `tick` (with `end`: the text
//! ends there) of the axes, `trace`, `bar`, `limit`, `fault`; of traces `contact`, `command`, `x`,
//! `y`, `z` besides.

use std::fmt::Write as _;

/// Of the charts of a report, pixels.
const WIDTH: f64 = 960.0;
const HEIGHT: f64 = 190.0;
/// Around what is inside the axes, pixels.
pub const LEFT: f64 = 64.0;
const RIGHT: f64 = 14.0;
const TOP: f64 = 12.0;
const BOTTOM: f64 = 30.0;

/// Values over time or over a distance.
pub(super) struct Plot<'c> {
    /// What it is, with its unit.
    pub(super) title: &'c str,
    /// Of the lower axis.
    pub(super) unit_x: &'c str,
    /// A class of the style sheet for each, and its rows: where, least and most there.
    pub(super) bands: Vec<(&'c str, Vec<[f64; 3]>)>,
    /// A line across, with its name; of values below zero as well, another one as far below.
    pub(super) limit: Option<(f64, &'c str)>,
    /// Where to draw lines up, as moments of faults.
    pub(super) marks: &'c [f64],
}

/// A chart and the values at its ends.
#[derive(Clone, Copy, Debug)]
pub struct PlotArea {
    /// Width and height of the chart with its numbers, pixels.
    pub size: [f64; 2],
    /// Values at the left and at the right end; they differ.
    pub x: [f64; 2],
    /// Values at the bottom and at the top; they differ.
    pub y: [f64; 2],
}

impl PlotArea {
    /// Where a value is, pixels from the left.
    pub fn x(&self, value: f64) -> f64 {
        LEFT + (value - self.x[0]) / (self.x[1] - self.x[0]) * (self.size[0] - LEFT - RIGHT)
    }

    /// Where a value is, pixels from the top; far outside is at the edge.
    pub fn y(&self, value: f64) -> f64 {
        let share = ((value - self.y[0]) / (self.y[1] - self.y[0])).clamp(-0.05, 1.05);
        self.size[1] - BOTTOM - share * (self.size[1] - TOP - BOTTOM)
    }

    /// Grid and round numbers of both axes, with the unit of the lower one.
    pub fn axes(&self, svg: &mut String, unit_x: &str) {
        let [width, height] = self.size;
        // Four on the charts of a report, more on taller ones.
        for value in steps(self.y, height / 47.5) {
            let y = self.y(value);
            let _ = write!(
                svg,
                "<line class=\"grid\" x1=\"{LEFT}\" x2=\"{}\" y1=\"{y:.1}\" y2=\"{y:.1}\"/>",
                width - RIGHT
            );
            let _ = write!(
                svg,
                "<text class=\"tick end\" x=\"{}\" y=\"{:.1}\">{}</text>",
                LEFT - 6.0,
                y + 4.0,
                short(value)
            );
        }
        for value in steps(self.x, 10.0) {
            let _ = write!(
                svg,
                "<text class=\"tick\" x=\"{:.1}\" y=\"{}\">{}</text>",
                self.x(value),
                height - 12.0,
                short(value)
            );
        }
        let _ = write!(
            svg,
            "<text class=\"tick end\" x=\"{}\" y=\"{}\">{unit_x}</text>",
            width - RIGHT,
            height - 1.0
        );
    }
}

/// Envelopes, each filled between the least and the most of its rows.
pub(super) fn plot(plot: Plot<'_>) -> String {
    let Plot { title, unit_x, mut bands, limit, marks } = plot;
    bands
        .iter_mut()
        .for_each(|(_, rows)| rows.retain(|row| row.iter().all(|value| value.is_finite())));
    let ends = |value: usize, choose: fn(f64, f64) -> f64| {
        bands.iter().flat_map(|(_, rows)| rows).map(|row| row[value]).reduce(choose)
    };
    let begin = ends(0, f64::min).unwrap_or(0.0);
    let end = ends(0, f64::max).unwrap_or(1.0).max(begin + 1e-3);
    let lowest = ends(1, f64::min).unwrap_or(0.0).min(0.0);
    let highest = ends(2, f64::max).unwrap_or(0.0).max(0.0);
    // A limit far away would make a flat line of what is to be seen.
    let shown_limit = limit
        .filter(|(limit, _)| limit.is_finite() && *limit <= 2.5 * highest.max(-lowest).max(1e-12));
    let limits: Vec<(f64, &str)> = shown_limit
        .into_iter()
        .flat_map(|(limit, name)| {
            [
                Some((limit, name)).filter(|_| highest > 0.0),
                Some((-limit, name)).filter(|_| lowest < 0.0),
            ]
        })
        .flatten()
        .collect();
    let highest = limits.iter().fold(highest, |highest, (limit, _)| highest.max(limit * 1.05));
    let lowest = limits.iter().fold(lowest, |lowest, (limit, _)| lowest.min(limit * 1.05));
    let span = if highest - lowest > 0.0 { highest - lowest } else { 1.0 };
    let frame =
        PlotArea { size: [WIDTH, HEIGHT], x: [begin, end], y: [lowest, lowest + 1.05 * span] };
    let mut svg = open(title);
    frame.axes(&mut svg, unit_x);
    for mark in marks {
        let x = frame.x(*mark);
        // Writing to a string cannot fail, here and below.
        let _ = write!(
            svg,
            "<line class=\"fault\" x1=\"{x:.1}\" x2=\"{x:.1}\" y1=\"{TOP}\" y2=\"{:.1}\"/>",
            HEIGHT - BOTTOM
        );
    }
    for (limit, name) in limits {
        line_across(&mut svg, frame.y(limit), name);
    }
    for (class, rows) in &bands {
        let upper = rows.iter().map(|[at, _, most]| (frame.x(*at), frame.y(*most)));
        let lower = rows.iter().rev().map(|[at, least, _]| (frame.x(*at), frame.y(*least)));
        let outline: String = upper.chain(lower).map(|(x, y)| format!("{x:.1},{y:.1} ")).collect();
        let _ = write!(svg, "<polygon class=\"trace {class}\" points=\"{}\"/>", outline.trim_end());
    }
    svg.push_str("</svg>");
    svg
}

/// Bars over bins of 1, 2, 5, 10 …; heights are logarithms of counts. `deadline_us`: a line between
/// what is in time and what is not.
pub(super) fn histogram(title: &str, bins: &[[u64; 2]], deadline_us: f64) -> String {
    let mut svg = open(title);
    let n_bins = bins.len().max(10);
    let most = bins.iter().map(|[_, count]| *count).max().unwrap_or(1).max(1);
    let decades = (most as f64).log10().ceil().max(1.0);
    let width = (WIDTH - LEFT - RIGHT) / n_bins as f64;
    let height_of = |count: u64| {
        if count == 0 {
            0.0
        } else {
            ((count as f64).log10() + 0.3) / (decades + 0.3) * (HEIGHT - TOP - BOTTOM)
        }
    };
    let floor = HEIGHT - BOTTOM;
    for decade in 0..=decades as u32 {
        let y = floor - height_of(10_u64.pow(decade));
        let _ = write!(
            svg,
            "<line class=\"grid\" x1=\"{LEFT}\" x2=\"{}\" y1=\"{y:.1}\" y2=\"{y:.1}\"/>",
            WIDTH - RIGHT
        );
        let _ = write!(
            svg,
            "<text class=\"tick end\" x=\"{}\" y=\"{:.1}\">{}</text>",
            LEFT - 6.0,
            y + 4.0,
            10_u64.pow(decade)
        );
    }
    for (n, [bound_us, count]) in bins.iter().enumerate() {
        let x = LEFT + n as f64 * width;
        let height = height_of(*count);
        let late = if *bound_us as f64 > deadline_us { " late" } else { "" };
        let _ = write!(
            svg,
            "<rect class=\"bar{late}\" x=\"{:.1}\" y=\"{:.1}\" width=\"{:.1}\" \
                height=\"{height:.1}\"><title>{count} ticks up to {bound_us} µs</title></rect>",
            x + 1.0,
            floor - height,
            width - 2.0
        );
        let _ = write!(
            svg,
            "<text class=\"tick end\" x=\"{:.1}\" y=\"{:.1}\">{bound_us}</text>",
            x + width,
            HEIGHT - 12.0
        );
    }
    // The deadline lies behind the last bound that is not above it.
    let n_in_time = bins.iter().filter(|[bound_us, _]| *bound_us as f64 <= deadline_us).count();
    if bins.iter().any(|[bound_us, _]| *bound_us as f64 >= deadline_us) {
        let x = LEFT + n_in_time as f64 * width;
        let _ = write!(
            svg,
            "<line class=\"limit\" x1=\"{x:.1}\" x2=\"{x:.1}\" y1=\"{TOP}\" y2=\"{floor:.1}\"/>"
        );
        let _ = write!(
            svg,
            "<text class=\"limit end\" x=\"{:.1}\" y=\"{:.1}\">deadline</text>",
            x - 5.0,
            TOP + 10.0
        );
    }
    let _ = write!(
        svg,
        "<text class=\"tick end\" x=\"{}\" y=\"{}\">µs</text></svg>",
        WIDTH - RIGHT,
        HEIGHT - 1.0
    );
    svg
}

fn open(title: &str) -> String {
    format!(
        "<svg viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" aria-label=\"{title}\" \
            xmlns=\"http://www.w3.org/2000/svg\">"
    )
}

fn line_across(svg: &mut String, y: f64, name: &str) {
    let _ = write!(
        svg,
        "<line class=\"limit\" x1=\"{LEFT}\" x2=\"{}\" y1=\"{y:.1}\" y2=\"{y:.1}\"/>",
        WIDTH - RIGHT
    );
    let _ = write!(
        svg,
        "<text class=\"limit end\" x=\"{}\" y=\"{:.1}\">{name}</text>",
        WIDTH - RIGHT - 4.0,
        y - 4.0
    );
}

/// Round numbers in a range, about so many; at most 40.
pub fn steps([low, high]: [f64; 2], wanted: f64) -> Vec<f64> {
    let rough = (high - low) / wanted;
    let power = 10_f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0]
        .into_iter()
        .map(|factor| factor * power)
        .find(|step| *step >= rough * 0.999)
        .unwrap_or(rough);
    let first = (low / step).ceil();
    (0..40)
        .map(|n| (first + f64::from(n)) * step)
        .take_while(|value| *value <= high * (1.0 + 1e-9))
        .collect()
}

/// Up to four decimals, without trailing zeros, with a true minus.
pub fn short(value: f64) -> String {
    let text = format!("{value:.4}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".to_owned() } else { text.replace('-', "\u{2212}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn axes_have_round_numbers() {
        assert_eq!(steps([0.0, 10.0], 5.0), [0.0, 2.0, 4.0, 6.0, 8.0, 10.0]);
        assert_eq!(steps([-0.3, 0.3], 4.0).len(), 3);
        for (low, high) in
            [(-13.7, 17.3), (0.0, 0.004), (-1e4, 1e4), (3.0, 3.000_001), (812.5, 813.5)]
        {
            let steps = steps([low, high], 8.0);
            assert!(
                (4..=9).contains(&steps.len())
                    && steps.iter().all(|step| (low..=high * 1.000_001).contains(step)),
                "{steps:?}"
            );
        }
        assert_eq!(
            [short(0.25), short(-0.0), short(3.0), short(-2.5), short(-0.00001)],
            ["0.25", "0", "3", "\u{2212}2.5", "0"]
        );
    }
}
