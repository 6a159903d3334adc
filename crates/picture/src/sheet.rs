//! Where everything goes.

use core::cmp::Reverse;
use std::io;
use std::path::Path;

use super::canvas::{Align, Canvas};
use super::marks::{self, Mark, Present};
use super::palette::{self, FAINT, INK};
use super::panel::{Panel, draw_point};
use super::subject::BakedObject;
use recording::report::plots::short;
use vps::storage::whole_file::write_bytes;

/// Largest sheet, pixels.
const WIDTH: f64 = 1600.0;
/// Most that the cuts above each other take of the height, pixels.
const PANELS_HEIGHT: f64 = 960.0;
/// A cut is never narrower, pixels: a flat map is stretched across instead of vanishing.
const PANEL_MIN: f64 = 72.0;
/// Beside, between and around the cuts, pixels.
const LEFT: f64 = 84.0;
const RIGHT: f64 = 36.0;
const HEADER: f64 = 112.0;
const LEGEND: f64 = 92.0;
/// A line of the legend for each kind of mark.
const MARK_LINE: f64 = 24.0;
/// Of its samples of colours, pixels.
const SAMPLE: [i32; 2] = [44, 16];
const COLUMN_GAP: f64 = 96.0;
const ROW_GAP: f64 = 84.0;
/// Longest edge over the second from which on a body is drawn along the sheet.
const LONG: f64 = 1.8;

/// Draws the sheet and writes it as a PNG, at most 1600 pixels wide.
///
/// # Errors
/// Any error of the file system.
pub fn write(path: &Path, subject: &BakedObject<'_>) -> io::Result<()> {
    write_bytes(path, &png(subject)?)
}

fn png(subject: &BakedObject<'_>) -> io::Result<Vec<u8>> {
    let slices = subject.marks.by_slice(subject.surface, subject.layers);
    let panels = panels(subject, cuts(subject, &slices));
    let far = |side: usize| {
        panels.iter().map(|panel| panel.corner[side] + panel.size[side]).max().unwrap_or(0)
    };
    let right = f64::from(far(0));
    let bottom = f64::from(far(1));
    let is_there = |mark: &Mark| slices[0].iter().any(|present| present[*mark as usize]);
    let is_cut = |mark: Mark| {
        panels.iter().any(|panel| slices[panel.axes[2]][panel.cut as usize][mark as usize])
    };
    let marks: Vec<Mark> = Mark::ALL.into_iter().filter(is_there).collect();
    let below = 44.0 + LEGEND + MARK_LINE * marks.len() as f64;
    let [width, height] = [right + RIGHT, bottom + below].map(|edge| edge.ceil() as u32);
    // A legend and a title have a width, too.
    let width = width.max(900);
    let mut canvas = Canvas::new(width, height)
        .ok_or_else(|| io::Error::other("no memory for a sheet of pixels"))?;
    header(&mut canvas, subject);
    for panel in &panels {
        panel.draw(&mut canvas, subject);
    }
    legend(&mut canvas, subject, bottom + 44.0 + 30.0);
    for (n, mark) in marks.into_iter().enumerate() {
        let top = bottom + 44.0 + 30.0 + 48.0 + MARK_LINE * n as f64;
        mark_line(&mut canvas, subject, top, mark, is_cut(mark));
    }
    canvas.png()
}

/// Places three cuts on the sheet. Most bodies have them side by side; a long one has its longest
/// edge to the right in the first, the second below and the third beside it, as in a drawing of
/// three views.
fn panels(subject: &BakedObject<'_>, cuts: [i32; 3]) -> [Panel; 3] {
    let dims = subject.surface.grid.dims;
    let extent = dims.map(f64::from);
    let mut by_length = [0, 1, 2];
    by_length.sort_by_key(|axis| (Reverse(dims[*axis]), *axis));
    let [a, b, c] = by_length;
    let room = WIDTH - LEFT - RIGHT;
    let is_long = extent[a] > LONG * extent[b];
    let (scale, axes) = if !is_long {
        let across = scale_to_fit(&[extent[0], extent[0], extent[1]], room - 2.0 * COLUMN_GAP);
        (across.min(PANELS_HEIGHT / extent[1].max(extent[2])), [[0, 1, 2], [0, 2, 1], [1, 2, 0]])
    } else {
        let across = scale_to_fit(&[extent[a], extent[c]], room - COLUMN_GAP);
        (
            across.min(scale_to_fit(&[extent[b], extent[c]], PANELS_HEIGHT - ROW_GAP)),
            [[a, b, c], [a, c, b], [c, b, a]],
        )
    };
    let pixels = extent.map(|n_cells| (n_cells * scale).max(PANEL_MIN).floor());
    let place = |axes: [usize; 3], left: f64, top: f64| Panel {
        axes,
        cut: cuts[axes[2]],
        corner: [left, top].map(|edge| edge as i32),
        size: [axes[0], axes[1]].map(|axis| pixels[axis] as i32),
    };
    if !is_long {
        let tallest = pixels[1].max(pixels[2]);
        let second = LEFT + pixels[0] + COLUMN_GAP;
        [
            place(axes[0], LEFT, HEADER + tallest - pixels[1]),
            place(axes[1], second, HEADER + tallest - pixels[2]),
            place(axes[2], second + pixels[0] + COLUMN_GAP, HEADER + tallest - pixels[2]),
        ]
    } else {
        [
            place(axes[0], LEFT, HEADER),
            place(axes[1], LEFT, HEADER + pixels[b] + ROW_GAP),
            place(axes[2], LEFT + pixels[a] + COLUMN_GAP, HEADER),
        ]
    }
}

/// Pixels per voxel with which edges fit side by side, the short ones stretched to [`PANEL_MIN`].
fn scale_to_fit(extents: &[f64], n_pixels: f64) -> f64 {
    let mut scale = n_pixels / extents.iter().sum::<f64>();
    for _ in extents {
        let (short, long): (Vec<f64>, Vec<f64>) =
            extents.iter().partition(|extent| **extent * scale < PANEL_MIN);
        scale = (n_pixels - PANEL_MIN * short.len() as f64) / long.iter().sum::<f64>();
    }
    scale
}

/// Per axis the slice nearest to the middle of the grid among those that hold surface and the most
/// kinds of marks.
fn cuts(subject: &BakedObject<'_>, slices: &[Vec<Present>; 3]) -> [i32; 3] {
    let dims = subject.surface.grid.dims;
    let mut is_held = dims.map(|n| vec![false; n as usize]);
    for cell in subject.surface.cells() {
        for axis in 0..3 {
            is_held[axis][cell[axis] as usize] = true;
        }
    }
    core::array::from_fn(|axis| {
        let middle = (dims[axis] / 2) as i32;
        let held = is_held[axis]
            .iter()
            .enumerate()
            .filter(|(_, is_held)| **is_held)
            .map(|(index, _)| index as i32);
        let n_marks =
            |index: i32| slices[axis][index as usize].iter().filter(|is_there| **is_there).count();
        held.min_by_key(|index| (Reverse(n_marks(*index)), (index - middle).abs()))
            .unwrap_or(middle)
    })
}

fn header(canvas: &mut Canvas, subject: &BakedObject<'_>) {
    let grid = &subject.surface.grid;
    let [nx, ny, nz] = grid.dims;
    canvas.text([LEFT, 40.0], 24.0, Align::Left, INK, &shortened(subject.name, 60));
    let facts = format!(
        "{nx} \u{d7} {ny} \u{d7} {nz} voxels of {} mm \u{b7} {} of them on the surface, a point in \
            each \u{b7} {} layers \u{b7} {}",
        short(grid.voxel_size_m * 1e3),
        grouped(subject.surface.n_voxels),
        subject.layers.n_layers,
        if subject.thin { "two-sided skin" } else { "solid" }
    );
    canvas.text([LEFT, 66.0], 15.0, Align::Left, FAINT, &facts);
}

fn legend(canvas: &mut Canvas, subject: &BakedObject<'_>, top: f64) {
    let n_layers = subject.layers.n_layers as i32;
    let values: Vec<i32> = (-n_layers - 1..=n_layers + 1).collect();
    let swatch = (320 / values.len() as i32).clamp(3, 18);
    let left = LEFT + canvas.text_width(13.0, "outside ");
    canvas.text([LEFT, top + 13.0], 13.0, Align::Left, INK, "outside");
    for (k, value) in values.iter().enumerate() {
        let color = palette::of_layer(*value as i8, subject.layers.n_layers);
        canvas.block([left as i32 + k as i32 * swatch, top as i32], [swatch, 16], color);
    }
    let width = swatch * values.len() as i32;
    canvas.frame([left as i32, top as i32], [width, 16], FAINT);
    let right = left + f64::from(width);
    canvas.text([right + 8.0, top + 13.0], 13.0, Align::Left, INK, "inside");
    let under = |k: f64| left + (k + 0.5) * f64::from(swatch);
    let layers = f64::from(n_layers);
    for (at, text) in [
        (1.0, format!("\u{2212}{n_layers}")),
        (layers + 1.0, "0".to_owned()),
        (2.0 * layers + 1.0, format!("+{n_layers}")),
    ] {
        canvas.text([under(at), top + 33.0], 13.0, Align::Middle, FAINT, &text);
    }
    canvas.text([right + 8.0, top + 33.0], 13.0, Align::Left, FAINT, "layers");
    let sample = [right + 100.0, top + 8.0];
    canvas.block(
        [sample[0] as i32 - 10, top as i32],
        SAMPLE,
        palette::of_layer(3, subject.layers.n_layers),
    );
    draw_point(canvas, sample, [1.0, 0.0], 18.0);
    canvas.text(
        [sample[0] + 44.0, top + 13.0],
        13.0,
        Align::Left,
        INK,
        "point in the cut (thinned out) and its normal",
    );
}

/// What one kind of mark means.
fn mark_line(canvas: &mut Canvas, subject: &BakedObject<'_>, top: f64, mark: Mark, is_cut: bool) {
    let corner = [LEFT, top].map(|edge| edge as i32);
    if mark == Mark::Hollow {
        canvas.block(corner, SAMPLE, palette::of_layer(-2, subject.layers.n_layers));
        for column in 0..SAMPLE[0] {
            for row in (0..SAMPLE[1]).filter(|row| marks::is_hatch([column, *row])) {
                canvas.block([corner[0] + column, corner[1] + row], [1, 1], mark.color());
            }
        }
    } else {
        canvas.block(corner, SAMPLE, mark.color());
    }
    let elsewhere = if is_cut { "" } else { " (in none of these cuts)" };
    let words = format!("{}{elsewhere}", mark.words());
    let left = LEFT + f64::from(SAMPLE[0]) + 10.0;
    canvas.text([left, top + 13.0], 13.0, Align::Left, INK, &words);
}

/// Digits in groups of three.
pub(super) fn grouped(count: usize) -> String {
    let digits = count.to_string();
    let mut text = String::new();
    for (k, digit) in digits.chars().enumerate() {
        if k > 0 && (digits.len() - k).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

/// A name that fits on the sheet.
pub(super) fn shortened(name: &str, n_letters: usize) -> String {
    if name.chars().count() <= n_letters {
        return name.to_owned();
    }
    name.chars().take(n_letters - 1).chain(['\u{2026}']).collect()
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::subject::tests::with_baked_box;

    fn sheet(size_m: DVec3, voxel_size_m: f64) -> ([Panel; 3], tiny_skia::Pixmap) {
        with_baked_box(size_m, voxel_size_m, |_, subject| {
            let slices = subject.marks.by_slice(subject.surface, subject.layers);
            let panels = panels(subject, cuts(subject, &slices));
            (panels, tiny_skia::Pixmap::decode_png(&png(subject).unwrap()).unwrap())
        })
    }

    #[test]
    #[ignore = "takes long: `cargo test -- --include-ignored`"]
    fn cuts_of_any_proportion_lie_apart_on_the_sheet() {
        let sizes = [
            (DVec3::new(0.02, 0.02, 0.02), 1e-3),
            (DVec3::new(0.1, 0.1, 0.0005), 1e-3),
            (DVec3::new(1.5, 0.002, 0.002), 1e-3),
            (DVec3::new(0.03, 0.2, 0.05), 1e-3),
            (DVec3::splat(0.001), 1e-3),
        ];
        for (size_m, voxel_size_m) in sizes {
            let (panels, pixels) = sheet(size_m, voxel_size_m);
            assert!(
                pixels.width() <= 1600 && pixels.height() <= 1300,
                "{size_m}: {} x {}",
                pixels.width(),
                pixels.height()
            );
            for (k, panel) in panels.iter().enumerate() {
                assert!(panel.size.iter().all(|edge| *edge >= 72), "{size_m}: {panel:?}");
                assert!(
                    panel.corner[0] + panel.size[0] < pixels.width() as i32
                        && panel.corner[1] + panel.size[1] < pixels.height() as i32
                );
                for other in &panels[k + 1..] {
                    let apart = |side: usize| {
                        panel.corner[side] + panel.size[side] + 60 < other.corner[side]
                            || other.corner[side] + other.size[side] + 60 < panel.corner[side]
                    };
                    assert!(apart(0) || apart(1), "{size_m}: {panel:?} {other:?}");
                }
            }
        }
    }

    #[test]
    fn a_cut_shows_surface_inside_and_outside_where_they_are() {
        let (panels, pixels) = sheet(DVec3::new(0.02, 0.02, 0.02), 1e-3);
        // The solid is 20 of 29 voxels wide: 4 of padding, then the surface.
        let color = |panel: &Panel, u: f64, v: f64| {
            let [x, y] = [
                panel.corner[0] + (u * f64::from(panel.size[0])) as i32,
                panel.corner[1] + (v * f64::from(panel.size[1])) as i32,
            ];
            let pixel = pixels.pixel(x as u32, y as u32).unwrap();
            [pixel.red(), pixel.green(), pixel.blue()]
        };
        for panel in &panels {
            assert_eq!(color(panel, 0.5, 0.5), palette::of_layer(4, 3), "deep inside");
            assert_eq!(color(panel, 0.01, 0.01), palette::of_layer(-4, 3), "far outside");
            let n_dark = (0..panel.size[0])
                .filter(|x| color(panel, f64::from(*x) / f64::from(panel.size[0]), 0.37) == INK)
                .count();
            assert!(n_dark > 10, "{n_dark} dark pixels across the surface");
        }
    }

    #[test]
    fn numbers_and_names_are_readable() {
        assert_eq!([grouped(7), grouped(1234), grouped(182_464)], ["7", "1,234", "182,464"]);
        assert_eq!(shortened("häptic", 4), "häp\u{2026}");
    }
}
