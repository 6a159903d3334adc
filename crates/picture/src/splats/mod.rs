//! Pictures of clay: its samples as one surface, or each for itself, from three sides on one sheet.
//!
//! [`sheet`](self) lays the views out, `discs` says what each pixel sees, `shade` lights it.
//! Samples cover one another as surfaces do: a pixel of the surface shows the mean of the discs
//! that are nearest to the viewer there, weighted by how near their middles are; of samples that
//! are drawn each for itself, the nearest.
//!
//! Invariants: no randomness, one thread: the same picture on every machine. Cost: O(pixels · discs
//! that cover one).

mod discs;

use std::io;
use std::path::Path;

use glam::DVec3;

pub use self::discs::SampleForm;
use self::discs::{Discs, add_balls, seen};
use super::canvas::{Align, Canvas};
use super::palette::{BACKDROP, FAINT, INK};
use super::shade::{self, FINER, halved};
use super::sheet::{grouped, shortened};
use super::view::Camera;
use clay::PointSet;
use recording::report::plots::short;
use vps::density::Raster;
use vps::storage::whole_file::write_bytes;

/// A clay model at one moment.
#[derive(Clone, Copy, Debug)]
pub struct ClaySnapshot<'a> {
    /// Above its row.
    pub name: &'a str,
    /// Its samples, map frame.
    pub points: &'a PointSet,
    /// The same model at another moment, in another picture: both are drawn at one scale.
    pub beside: Option<&'a PointSet>,
    /// What is drawn of the samples.
    pub form: SampleForm,
    /// Those that [`SampleForm::MassPoints`] shows.
    pub mass_points: &'a MassPoints,
}

/// Mass points on both sides of a surface.
#[derive(Clone, Debug, Default)]
pub struct MassPoints {
    /// `[n]`, map frame, m.
    places_map: Vec<DVec3>,
    /// Distance of neighbours, m.
    spacing_m: f64,
}

impl MassPoints {
    /// Those of a region that are within their own distance of its surface. O(mass points).
    pub fn beside_surface(region: &Raster) -> Self {
        let lattice = region.lattice();
        let [nx, ny, nz] = lattice.dims;
        let nodes =
            (0..nx).flat_map(|x| (0..ny).flat_map(move |y| (0..nz).map(move |z| [x, y, z])));
        let is_near = |value_m: &f32| f64::from(value_m.abs()) < lattice.spacing_m;
        let near = nodes.zip(region.values_m()).filter(|(_, value_m)| is_near(value_m));
        Self {
            places_map: near.map(|(node, _)| lattice.position(node)).collect(),
            spacing_m: lattice.spacing_m,
        }
    }
}

/// Of the sheet, pixels.
const WIDTH: i32 = 1000;
const MARGIN: i32 = 12;
const HEADER: i32 = 52;
/// The view from the corner, and the two beside it, pixels.
const LARGE: [i32; 2] = [608, 420];
const SMALL: [i32; 2] = [356, 204];
const GAP: i32 = 12;
/// Radius of the ball of a mass point, as a share of the distance of neighbours.
const BALL: f64 = 0.12;
/// Share of a view that the clay takes up at most.
const FILLED: f64 = 0.86;

/// What a view looks at: word, place on the sheet below the header, size, and the way towards the
/// viewer.
const VIEWS: [(&str, [i32; 2], [i32; 2], DVec3); 3] = [
    ("", [MARGIN, 0], LARGE, DVec3::new(0.45, -0.75, 0.5)),
    ("front", [MARGIN + LARGE[0] + GAP, 0], SMALL, DVec3::NEG_Y),
    ("top", [MARGIN + LARGE[0] + GAP, SMALL[1] + GAP], SMALL, DVec3::Z),
];

/// Draws a sheet, 1000 pixels wide, with a row for each subject, all at one scale, and writes it as
/// a PNG.
///
/// # Errors
/// Any error of the file system; a sheet without memory for its pixels.
pub fn write(path: &Path, subjects: &[ClaySnapshot<'_>]) -> io::Result<()> {
    write_bytes(path, &png(subjects)?)
}

fn png(subjects: &[ClaySnapshot<'_>]) -> io::Result<Vec<u8>> {
    let row = HEADER + LARGE[1] + MARGIN;
    let mut canvas = u32::try_from(row * subjects.len() as i32)
        .ok()
        .and_then(|height| Canvas::new(WIDTH as u32, height))
        .ok_or_else(|| io::Error::other("no memory for a sheet of pixels"))?;
    let shown =
        || subjects.iter().flat_map(|subject| [Some(subject.points), subject.beside]).flatten();
    for (n, subject) in subjects.iter().enumerate() {
        let top = n as i32 * row;
        draw_words(&mut canvas, subject, f64::from(top));
        let discs = Discs::of(subject.points, subject.form);
        for (word, [left, below], size, toward) in VIEWS {
            let corner = [left, top + HEADER + below];
            let fine = size.map(|edge| (edge * FINER) as usize);
            let camera = Camera::over(
                toward,
                shown().flat_map(|points| points.positions_map.iter().copied()),
                fine,
                FILLED,
            );
            let mut view = seen(&camera, &discs, fine);
            if subject.form == SampleForm::MassPoints {
                let MassPoints { places_map, spacing_m } = subject.mass_points;
                add_balls(&camera, &mut view, places_map, BALL * spacing_m, INK);
            }
            let pixels = shade::lit(&view, BACKDROP);
            canvas.image(corner, size, &halved(&pixels, fine[0]));
            canvas.scale_bar(corner, size, camera.pixels_per_m() / f64::from(FINER));
            let [x, y] = corner.map(f64::from);
            canvas.text([x + f64::from(size[0]) - 10.0, y + 20.0], 13.0, Align::Right, FAINT, word);
        }
    }
    canvas.png()
}

fn draw_words(canvas: &mut Canvas, subject: &ClaySnapshot<'_>, top: f64) {
    let left = f64::from(MARGIN);
    canvas.text([left, top + 22.0], 17.0, Align::Left, INK, &shortened(subject.name, 90));
    let (low, high) = subject.points.bounds().unwrap_or_default();
    let size_mm = ((high - low) * 1e3).to_array().map(|edge| short((edge * 10.0).round() / 10.0));
    let facts =
        format!("{} samples \u{b7} {} mm", grouped(subject.points.len()), size_mm.join(" \u{d7} "));
    canvas.text([left, top + 41.0], 13.0, Align::Left, FAINT, &facts);
}

#[cfg(test)]
mod tests;
