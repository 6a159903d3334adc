//! One cut through the map.

use glam::DVec3;

use super::canvas::{Align, Canvas};
use super::marks::Mark;
use super::palette::{self, FAINT, INK, PAPER};
use super::subject::BakedObject;
use recording::report::plots::{short, steps};

/// Height of the words at the axes, pixels.
const TEXT: f64 = 13.0;
/// Points closer than this on the sheet are thinned out, pixels.
const POINT_SPACING: i32 = 13;
const NAMES: [&str; 3] = ["x", "y", "z"];

/// A cut across one axis, placed on the sheet.
#[derive(Clone, Copy, Debug)]
pub(super) struct Panel {
    /// Axis to the right, axis up, axis cut across.
    pub(super) axes: [usize; 3],
    /// Cell of the cut on its axis.
    pub(super) cut: i32,
    /// Upper left pixel.
    pub(super) corner: [i32; 2],
    /// Pixels.
    pub(super) size: [i32; 2],
}

impl Panel {
    /// Draws map, points, frame and axes.
    pub(super) fn draw(&self, canvas: &mut Canvas, subject: &BakedObject<'_>) {
        self.draw_layers(canvas, subject);
        self.draw_points(canvas, subject);
        canvas.frame(self.corner, self.size, INK);
        self.draw_axes(canvas, subject);
    }

    /// Cells per axis of the sheet: right, up.
    fn n_cells(&self, subject: &BakedObject<'_>) -> [i32; 2] {
        [0, 1].map(|side| subject.surface.grid.dims[self.axes[side]] as i32)
    }

    fn draw_layers(&self, canvas: &mut Canvas, subject: &BakedObject<'_>) {
        let BakedObject { surface, layers, marks, .. } = *subject;
        let [width, height] = self.size;
        let n_cells = self.n_cells(subject);
        let cell_under = |pixel: i32, n_pixels: i32, n_cells: i32| {
            ((f64::from(pixel) + 0.5) / f64::from(n_pixels) * f64::from(n_cells)) as i32
        };
        let mut cell = [0; 3];
        cell[self.axes[2]] = self.cut;
        for row in 0..height {
            cell[self.axes[1]] = cell_under(height - 1 - row, height, n_cells[1]);
            // Runs of one colour are one block.
            let mut run_start = 0;
            let mut run_color = None;
            for column in 0..=width {
                let color = (column < width).then(|| {
                    cell[self.axes[0]] = cell_under(column, width, n_cells[0]);
                    if marks.is_hatched(surface, layers, cell, [column, row]) {
                        return Mark::Hollow.color();
                    }
                    palette::of_layer(layers.value(cell), layers.n_layers)
                });
                if color != run_color {
                    if let Some(color) = run_color {
                        canvas.block(
                            [self.corner[0] + run_start, self.corner[1] + row],
                            [column - run_start, 1],
                            color,
                        );
                    }
                    (run_start, run_color) = (column, color);
                }
            }
        }
        // Where a pixel covers several voxels the surface still shows.
        let plain = surface.cells().map(|cell| (cell, INK));
        let marked = marks.voxels().map(|(cell, mark)| (cell, mark.color()));
        for (cell, color) in plain.chain(marked).filter(|(cell, _)| cell[self.axes[2]] == self.cut)
        {
            // The first pixel whose middle lies in the cell: as above.
            let pixel = |index: i32, side: usize| {
                let n = i64::from(n_cells[side]);
                ((2 * i64::from(index) * i64::from(self.size[side]) + n - 1) / (2 * n)) as i32
            };
            let [u, v] = [cell[self.axes[0]], cell[self.axes[1]]];
            let left = pixel(u, 0);
            let right = pixel(u + 1, 0);
            let low = pixel(v, 1);
            let high = pixel(v + 1, 1);
            let wide = (right - left).max(1);
            let tall = (high - low).max(1);
            canvas.block(
                [self.corner[0] + left, self.corner[1] + height - low - tall],
                [wide, tall],
                color,
            );
        }
    }

    fn draw_points(&self, canvas: &mut Canvas, subject: &BakedObject<'_>) {
        let grid = &subject.surface.grid;
        let n_cells = self.n_cells(subject);
        let scale = [0, 1].map(|side| f64::from(self.size[side]) / f64::from(n_cells[side]));
        // The first point of each place on the sheet: the shell's order does not depend on
        // anything.
        let n_columns = self.size[0] / POINT_SPACING + 1;
        let n_rows = self.size[1] / POINT_SPACING + 1;
        let mut drawn: Vec<Vec<[f64; 2]>> = vec![Vec::new(); (n_columns * n_rows) as usize];
        let length = (2.2 * scale[0].min(scale[1])).clamp(10.0, 20.0);
        for (position, normal) in subject.shell.points() {
            let cells = grid.to_cells(position.as_dvec3() + subject.center_of_mass_tool);
            let normal: DVec3 = normal.as_dvec3();
            if cells[self.axes[2]].floor() as i32 != self.cut {
                continue;
            }
            let on_panel = [
                cells[self.axes[0]] * scale[0],
                f64::from(self.size[1]) - cells[self.axes[1]] * scale[1],
            ];
            let field = [0, 1].map(|side| {
                (on_panel[side] as i32 / POINT_SPACING).clamp(0, [n_columns, n_rows][side] - 1)
            });
            let near = |column: i32, row: i32| {
                let field = drawn
                    .get((row * n_columns + column) as usize)
                    .filter(|_| (0..n_columns).contains(&column) && row >= 0);
                field.into_iter().flatten().any(|other| {
                    (other[0] - on_panel[0]).hypot(other[1] - on_panel[1])
                        < f64::from(POINT_SPACING)
                })
            };
            if (-1..=1).any(|dx| (-1..=1).any(|dy| near(field[0] + dx, field[1] + dy))) {
                continue;
            }
            drawn[(field[1] * n_columns + field[0]) as usize].push(on_panel);
            let at = [0, 1].map(|side| f64::from(self.corner[side]) + on_panel[side]);
            draw_point(canvas, at, [normal[self.axes[0]], -normal[self.axes[1]]], length);
        }
    }

    fn draw_axes(&self, canvas: &mut Canvas, subject: &BakedObject<'_>) {
        let grid = &subject.surface.grid;
        let [left, top] = self.corner.map(f64::from);
        let [width, height] = self.size.map(f64::from);
        let low_mm = |side: usize| grid.origin_m[self.axes[side]] * 1e3;
        let span_mm = |side: usize| f64::from(grid.dims[self.axes[side]]) * grid.voxel_size_m * 1e3;
        let bottom = top + height;
        // Numbers stand at least so many pixels apart.
        for value in steps([low_mm(0), low_mm(0) + span_mm(0)], width / 64.0) {
            let x = left + (value - low_mm(0)) / span_mm(0) * width;
            canvas.line([x, bottom + 1.0], [x, bottom + 6.0], 1.0, INK);
            canvas.text([x, bottom + 20.0], TEXT, Align::Middle, INK, &short(value));
        }
        for value in steps([low_mm(1), low_mm(1) + span_mm(1)], height / 40.0) {
            let y = bottom - (value - low_mm(1)) / span_mm(1) * height;
            canvas.line([left - 6.0, y], [left - 1.0, y], 1.0, INK);
            canvas.text([left - 10.0, y + 4.5], TEXT, Align::Right, INK, &short(value));
        }
        let [across, up, cut] = self.axes.map(|axis| NAMES[axis]);
        canvas.text(
            [left + 0.5 * width, bottom + 38.0],
            TEXT,
            Align::Middle,
            FAINT,
            &format!("{across} (mm)"),
        );
        canvas.text([left - 10.0, top - 10.0], TEXT, Align::Right, FAINT, &format!("{up} (mm)"));
        let mut center = [0; 3];
        center[self.axes[2]] = self.cut;
        let at_mm = grid.center_map(center)[self.axes[2]] * 1e3;
        canvas.text(
            [left, top - 10.0],
            TEXT + 1.0,
            Align::Left,
            INK,
            &format!("{cut} = {} mm", short(at_mm)),
        );
    }
}

/// A point of the shell with its inward normal, as projected.
pub(super) fn draw_point(canvas: &mut Canvas, at: [f64; 2], normal: [f64; 2], length: f64) {
    let tip = [0, 1].map(|side| at[side] + normal[side] * length);
    canvas.line(at, tip, 3.4, PAPER);
    canvas.line(at, tip, 1.6, INK);
    canvas.dot(at, 3.4, INK);
    canvas.dot(at, 2.2, PAPER);
}
