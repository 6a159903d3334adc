//! Embossing and engraving: the greys of an image as heights of the surface.
//!
//! A sample moves along its own normal by the grey times a depth, and the fits are made from the moved samples; engraving is the same with the
//! sign turned.
//!
//! # Source
//! Guo2004, embossing and engraving: there the surface is fitted to the greys as distance values, and the samples go to the isosurface of the
//! fit. We deviate because such a fit smooths relief as fine as the spacing of the samples.

use std::path::Path;

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::{PointSurface, SampleMove};
use vps::storage::regular;

/// Bytes of an image file at most.
const LONGEST_IMAGE: u64 = 64 << 20;

/// A grey-scale image.
#[derive(Clone, Debug, PartialEq)]
pub struct GreyImage {
    width: usize,
    height: usize,
    /// `[height][width]`, rows from top to bottom, 0 black to 1 white.
    greys: Vec<f32>,
}

/// Why an image cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum ImageError {
    /// It cannot be opened or read.
    #[error("cannot read {path}: {source}")]
    Read {
        /// The file.
        path: std::path::PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// It is no PNG, or a damaged one.
    #[error("{path} is no PNG image that can be read: {reason}")]
    Decode {
        /// The file.
        path: std::path::PathBuf,
        /// Why.
        reason: String,
    },
    /// Nothing in it.
    #[error("an image of {width} x {height} pixels cannot be embossed; it takes at least 2 x 2, and one grey per pixel")]
    Size {
        /// Pixels.
        width: usize,
        /// Pixels.
        height: usize,
    },
}

impl GreyImage {
    /// Greys row by row from the top, 0 black to 1 white.
    ///
    /// # Errors
    /// [`ImageError::Size`] where there are fewer than 2 × 2 pixels, or not one grey for each.
    pub(super) fn new(width: usize, height: usize, greys: Vec<f32>) -> Result<Self, ImageError> {
        if width < 2 || height < 2 || greys.len() != width * height {
            return Err(ImageError::Size { width, height });
        }
        Ok(Self { width, height, greys })
    }

    /// Reads a PNG; colours count with their luminance (BT.709), transparent pixels as black.
    ///
    /// # Errors
    /// [`ImageError`].
    pub fn read(path: &Path) -> Result<Self, ImageError> {
        let bytes = regular::bytes(path, LONGEST_IMAGE).map_err(|source| ImageError::Read { path: path.to_owned(), source })?;
        let decoded = tiny_skia::Pixmap::decode_png(&bytes)
            .map_err(|error| ImageError::Decode { path: path.to_owned(), reason: error.to_string() })?;
        // Premultiplied: what is transparent is dark already.
        let grey = |pixel: &tiny_skia::PremultipliedColorU8| {
            (0.2126 * f32::from(pixel.red()) + 0.7152 * f32::from(pixel.green()) + 0.0722 * f32::from(pixel.blue())) / 255.0
        };
        Self::new(decoded.width() as usize, decoded.height() as usize, decoded.pixels().iter().map(grey).collect())
    }

    /// Half its width and height, the larger one 1.
    pub(super) fn half_edges(&self) -> DVec2 {
        DVec2::new(self.width as f64, self.height as f64) / self.width.max(self.height) as f64
    }

    /// The grey at a place, (0, 0) top left and (1, 1) bottom right, between pixels' middles as straight lines; 0 beyond the image.
    pub(super) fn at(&self, place: DVec2) -> f64 {
        if !(place.cmpge(DVec2::ZERO).all() && place.cmple(DVec2::ONE).all()) {
            return 0.0;
        }
        let size = DVec2::new(self.width as f64, self.height as f64);
        let pixel = (place * size - 0.5).clamp(DVec2::ZERO, size - 1.0);
        let low = pixel.floor().min(size - 2.0);
        let (x, y, t) = (low.x as usize, low.y as usize, pixel - low);
        let grey = |x: usize, y: usize| f64::from(self.greys[y * self.width + x]);
        let row = |y: usize| grey(x, y) + (grey(x + 1, y) - grey(x, y)) * t.x;
        row(y) + (row(y + 1) - row(y)) * t.y
    }
}

/// How an image lies over the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ImagePlacement {
    /// Flat, as a stamp: its middle and the half edges of the image to the right and up, map frame, m. Only what faces the stamp gets it.
    Flat {
        /// Middle of the image.
        middle_map: DVec3,
        /// From the middle to the right edge.
        right_map: DVec3,
        /// From the middle to the upper edge.
        up_map: DVec3,
    },
    /// Around a ball, as a map of the world: longitude to the right, latitude up.
    Around {
        /// Middle of the ball, map frame, m.
        center_map: DVec3,
        /// To the upper edge, unit.
        north_map: DVec3,
        /// To the middle of the image, unit, across `north_map`.
        front_map: DVec3,
    },
}

impl ImagePlacement {
    /// Where on the image a sample lies; `None` where the image does not reach it.
    pub(super) fn place(&self, at_map: DVec3, normal_map: DVec3) -> Option<DVec2> {
        match self {
            Self::Flat { middle_map, right_map, up_map } => {
                if normal_map.dot(right_map.cross(*up_map)) <= 0.0 {
                    return None;
                }
                let away = at_map - *middle_map;
                let across = |edge: DVec3| away.dot(edge) / edge.length_squared();
                let place = DVec2::new(0.5 + 0.5 * across(*right_map), 0.5 - 0.5 * across(*up_map));
                (place.cmpge(DVec2::ZERO).all() && place.cmple(DVec2::ONE).all()).then_some(place)
            }
            Self::Around { center_map, north_map, front_map } => {
                let away = (at_map - *center_map).try_normalize()?;
                let east = north_map.cross(*front_map);
                let longitude = away.dot(east).atan2(away.dot(*front_map));
                let latitude = away.dot(*north_map).clamp(-1.0, 1.0).asin();
                Some(DVec2::new(0.5 + longitude / core::f64::consts::TAU, 0.5 - latitude / core::f64::consts::PI))
            }
        }
    }
}

/// Where the samples go when white lies `depth_m` above the surface (below: engraving), and their new normals; only those that move.
///
/// The normals follow from the slope of the image along the surface: n' ∝ n − ∇h, its gradient by differences over a quarter of the sample's
/// spacing. The caller, which moves the samples, makes their fits again. Cost: five look-ups of the image per sample.
pub(super) fn embossed(surface: &PointSurface, image: &GreyImage, placement: &ImagePlacement, depth_m: f64) -> Vec<SampleMove> {
    let points = surface.points();
    (0..points.len() as u32)
        .into_par_iter()
        .filter_map(|sample| {
            let (at, normal) = (points.positions_map[sample as usize], points.normals_map[sample as usize]);
            let height_m = |at: DVec3| placement.place(at, normal).map(|place| depth_m * image.at(place));
            let middle_m = height_m(at)?;
            let (u, v) = normal.any_orthonormal_pair();
            let step_m = 0.25 * surface.spacings_m()[sample as usize];
            let slope = |way: DVec3| {
                let (ahead, behind) = (height_m(at + way * step_m), height_m(at - way * step_m));
                (ahead.unwrap_or(middle_m) - behind.unwrap_or(middle_m)) / (2.0 * step_m)
            };
            let (along_u, along_v) = (slope(u), slope(v));
            if middle_m == 0.0 && along_u == 0.0 && along_v == 0.0 {
                return None;
            }
            let normal_map = (normal - u * along_u - v * along_v).normalize();
            Some(SampleMove { sample, position_map: at + normal * middle_m, normal_map })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::PointSet;

    fn step_image() -> GreyImage {
        // Black on the left, white on the right.
        GreyImage::new(64, 32, (0..64 * 32).map(|n| if n % 64 < 32 { 0.0 } else { 1.0 }).collect()).unwrap()
    }

    fn sphere(radius: f64) -> PointSurface {
        let mut points = PointSet::default();
        let n = 4000;
        for i in 0..n {
            let z = 1.0 - (2.0 * f64::from(i) + 1.0) / f64::from(n);
            let turn = f64::from(i) * 2.399_963_229_728_653;
            let normal = DVec3::new((1.0 - z * z).sqrt() * turn.cos(), (1.0 - z * z).sqrt() * turn.sin(), z);
            points.push(normal * radius, normal, [0; 3]);
        }
        PointSurface::build(points, PointSurface::DEFAULT_NEIGHBOURS).unwrap()
    }

    const GLOBE: ImagePlacement = ImagePlacement::Around { center_map: DVec3::ZERO, north_map: DVec3::Z, front_map: DVec3::X };

    #[test]
    fn greys_are_interpolated_between_the_middles_of_pixels() {
        let image = GreyImage::new(2, 2, vec![0.0, 1.0, 0.5, 0.5]).unwrap();
        for (place, grey) in
            [((0.25, 0.25), 0.0), ((0.75, 0.25), 1.0), ((0.5, 0.25), 0.5), ((0.5, 0.5), 0.5), ((0.0, 0.0), 0.0), ((1.0, 1.0), 0.5)]
        {
            assert!((image.at(place.into()) - grey).abs() < 1e-9, "{place:?}");
        }
        assert_eq!(image.at(DVec2::new(1.1, 0.5)), 0.0);
        assert_eq!(image.at(DVec2::NAN), 0.0);
        assert!(matches!(GreyImage::new(1, 5, vec![0.0; 5]), Err(ImageError::Size { .. })));
        assert!(matches!(GreyImage::new(3, 3, vec![0.0; 5]), Err(ImageError::Size { .. })));
    }

    #[test]
    fn white_stands_out_by_the_depth_and_is_sunk_in_by_engraving() {
        for depth in [1e-3, -1e-3] {
            let mut surface = sphere(0.02);
            let moved = embossed(&surface, &step_image(), &GLOBE, depth);
            surface.move_samples(&moved).unwrap();
            let all: Vec<u32> = (0..surface.points().len() as u32).collect();
            surface.refit(&all).unwrap();
            // White is the half towards +y, away from the step.
            for n in 0..100 {
                let turn = 0.6 + 1.9 * f64::from(n) / 100.0;
                for (side, radius) in [(1.0, 0.02 + depth), (-1.0, 0.02)] {
                    let way = DVec3::new(turn.cos(), side * turn.sin(), 0.3).normalize();
                    let off = surface.at(way * radius).value_m;
                    assert!(off.abs() < 1e-5, "{way}: {off}");
                }
            }
        }
    }

    #[test]
    fn a_stamp_reaches_only_what_faces_it_and_lies_under_it() {
        let surface = sphere(0.02);
        let stamp = ImagePlacement::Flat { middle_map: DVec3::Z * 0.02, right_map: DVec3::X * 5e-3, up_map: DVec3::Y * 5e-3 };
        let moved = embossed(&surface, &GreyImage::new(2, 2, vec![1.0; 4]).unwrap(), &stamp, 1e-3);
        assert!(!moved.is_empty());
        for SampleMove { sample, position_map, normal_map } in moved {
            let before = surface.points().positions_map[sample as usize];
            assert!(before.z > 0.0 && before.x.abs() <= 5e-3 && before.y.abs() <= 5e-3, "{before}");
            assert!((position_map.distance(before) - 1e-3).abs() < 1e-9 && normal_map.is_normalized());
        }
    }

    #[test]
    fn a_file_that_is_no_image_is_said_to_be_none() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("notes.png");
        assert!(matches!(GreyImage::read(&path), Err(ImageError::Read { .. })));
        std::fs::write(&path, "no image").unwrap();
        assert!(matches!(GreyImage::read(&path), Err(ImageError::Decode { .. })));
    }
}
