//! Small line charts on one sheet: values over time.

use std::io;
use std::path::Path;

use super::canvas::{Align, Canvas};
use super::palette::{FAINT, INK, Rgb};

/// Colour of a curve; all kinds of colour vision tell them apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tone {
    /// What is compared with.
    Orange,
    /// In between.
    Green,
    /// What it is about.
    Blue,
}

impl Tone {
    fn color(self) -> Rgb {
        match self {
            Self::Orange => [224, 122, 32],
            Self::Green => [120, 170, 110],
            Self::Blue => [28, 92, 160],
        }
    }
}

/// One curve.
#[derive(Clone, Debug)]
pub struct Line {
    /// As in the legend.
    pub name: &'static str,
    /// Colour.
    pub tone: Tone,
    /// One for each time step; `NaN` leaves a gap.
    pub values: Vec<f64>,
}

/// Curves over the same time.
#[derive(Clone, Debug)]
pub struct Chart {
    /// Above the chart.
    pub title: String,
    /// Of the values.
    pub unit: &'static str,
    /// Between two values, s.
    pub step_s: f64,
    /// Drawn in this order, the last on top.
    pub lines: Vec<Line>,
}

const WIDTH: f64 = 1400.0;
const HEADER: f64 = 104.0;
const ROW: f64 = 300.0;
/// Around the area of a chart, pixels.
const LEFT: f64 = 92.0;
const RIGHT: f64 = 28.0;
const TOP: f64 = 42.0;
const BOTTOM: f64 = 52.0;

/// Draws the charts two to a row and writes them as a PNG, 1400 pixels wide. The legend is that of the first chart.
///
/// # Errors
/// Any error of the file system.
pub fn write(path: &Path, title: &str, note: &str, charts: &[Chart]) -> io::Result<()> {
    std::fs::write(path, png(title, note, charts)?)
}

fn png(title: &str, note: &str, charts: &[Chart]) -> io::Result<Vec<u8>> {
    let height = HEADER + ROW * charts.len().div_ceil(2) as f64;
    let mut canvas = Canvas::new(WIDTH as u32, height as u32).ok_or_else(|| io::Error::other("no memory for a sheet of pixels"))?;
    canvas.text([36.0, 40.0], 24.0, Align::Left, INK, title);
    canvas.text([36.0, 66.0], 15.0, Align::Left, FAINT, note);
    let mut x = 36.0;
    for line in charts.iter().take(1).flat_map(|chart| &chart.lines) {
        canvas.line([x, 86.0], [x + 26.0, 86.0], 3.0, line.tone.color());
        canvas.text([x + 34.0, 91.0], 15.0, Align::Left, INK, line.name);
        x += 34.0 + canvas.text_width(15.0, line.name) + 30.0;
    }
    for (n, chart) in charts.iter().enumerate() {
        let (column, row) = ((n % 2) as f64, (n / 2) as f64);
        let corner = [column * 0.5 * WIDTH + LEFT, HEADER + row * ROW + TOP];
        chart.draw(&mut canvas, corner, [0.5 * WIDTH - LEFT - RIGHT, ROW - TOP - BOTTOM]);
    }
    canvas.png()
}

impl Chart {
    fn draw(&self, canvas: &mut Canvas, [left, top]: [f64; 2], [width, height]: [f64; 2]) {
        canvas.text([left, top - 14.0], 17.0, Align::Left, INK, &self.title);
        let finite = || self.lines.iter().flat_map(|line| &line.values).copied().filter(|value| value.is_finite());
        let (low, high) = finite().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| (low.min(value), high.max(value)));
        if low > high {
            canvas.text([left, top + 0.5 * height], 15.0, Align::Left, FAINT, "nothing to show");
            return;
        }
        // A constant has a scale too.
        let margin = (0.06 * (high - low)).max(1e-3 * high.abs()).max(1e-12);
        let (low, high) = (low - margin, high + margin);
        let n_steps = self.lines.iter().map(|line| line.values.len()).max().unwrap_or(0).max(2) - 1;
        let long_s = n_steps as f64 * self.step_s;
        let at = |step: f64, value: f64| [left + width * step / n_steps as f64, top + height * (high - value) / (high - low)];
        for value in ticks(low, high) {
            let [_, y] = at(0.0, value);
            canvas.line([left, y], [left + width, y], 1.0, [226, 229, 234]);
            canvas.text([left - 8.0, y + 5.0], 13.0, Align::Right, FAINT, &label(value));
        }
        for time_s in ticks(0.0, long_s) {
            let [x, _] = at(time_s / self.step_s, low);
            canvas.line([x, top + height], [x, top + height + 5.0], 1.0, FAINT);
            canvas.text([x, top + height + 21.0], 13.0, Align::Middle, FAINT, &label(time_s));
        }
        canvas.text([left + width, top + height + 38.0], 13.0, Align::Right, FAINT, "s");
        canvas.text([left, top + height + 38.0], 13.0, Align::Left, FAINT, self.unit);
        for line in &self.lines {
            for (step, pair) in line.values.windows(2).enumerate() {
                if pair.iter().all(|value| value.is_finite()) {
                    canvas.line(at(step as f64, pair[0]), at(step as f64 + 1.0, pair[1]), 1.6, line.tone.color());
                }
            }
        }
        canvas.frame([left as i32, top as i32], [width as i32, height as i32], FAINT);
    }
}

/// Four to eight round numbers between two bounds.
fn ticks(low: f64, high: f64) -> Vec<f64> {
    let rough = (high - low) / 5.0;
    let power = 10_f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].map(|factor| factor * power).into_iter().find(|step| *step >= 0.999 * rough).unwrap_or(rough);
    let first = (low / step).ceil() as i64;
    (first..).map(|n| n as f64 * step).take_while(|value| *value <= high + 1e-9 * step).take(12).collect()
}

/// A tick in few digits.
fn label(value: f64) -> String {
    let rounded = (value * 1e6).round() / 1e6;
    if rounded == 0.0 { "0".to_owned() } else { format!("{rounded}").replace('-', "\u{2212}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_within() {
        for (low, high) in [(-1.3, 2.9), (0.0, 0.7), (99.97, 100.03), (-4e-3, -1e-3)] {
            let ticks = ticks(low, high);
            assert!((3..=8).contains(&ticks.len()), "{low} {high}: {ticks:?}");
            assert!(ticks.iter().all(|tick| (low..=high + 1e-9).contains(tick)), "{low} {high}: {ticks:?}");
        }
        assert_eq!([label(0.30000000000000004), label(-20.0), label(-1e-18)], ["0.3", "\u{2212}20", "0"]);
    }

    #[test]
    fn curves_are_drawn_where_their_values_are() {
        let lines = vec![
            Line { name: "high", tone: Tone::Orange, values: vec![1.0; 50] },
            Line { name: "low", tone: Tone::Blue, values: vec![0.0; 50] },
        ];
        let chart = Chart { title: "two".to_owned(), unit: "N", step_s: 1e-3, lines };
        let empty = Chart { title: "none".to_owned(), unit: "N", step_s: 1e-3, lines: Vec::new() };
        let pixels = tiny_skia::Pixmap::decode_png(&png("title", "note", &[chart, empty]).unwrap()).unwrap();
        assert_eq!((pixels.width(), pixels.height()), (1400, 404));
        let rows_of = |color: Rgb| -> Vec<u32> {
            // A line between two rows of pixels is paler in both.
            let is = |x: u32, y: u32| {
                let pixel = pixels.pixel(x, y).map(|pixel| [pixel.red(), pixel.green(), pixel.blue()]);
                pixel.is_some_and(|pixel| pixel.iter().zip(color).map(|(a, b)| a.abs_diff(b)).max() < Some(60))
            };
            (HEADER as u32..pixels.height()).filter(|y| is(300, *y)).collect()
        };
        let (high, low) = (rows_of(Tone::Orange.color()), rows_of(Tone::Blue.color()));
        assert!(!high.is_empty() && !low.is_empty() && high.iter().max() < low.iter().min(), "{high:?} {low:?}");
    }
}
