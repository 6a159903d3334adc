//! Embossing and engraving: the greys of an image as distances of the surface.
//!
//! The grey at a sample times a depth is the distance that its surface is to have from where it is.
//! The field around each sample is fitted to these distances, its own met exactly, and the sample
//! goes along its normal to the zero level of that field; engraving is the same with the sign
//! turned. Where the image is steep, samples are added first, so that the fit has what it takes to
//! be as steep.
//!
//! # Source
//! Guo2004, embossing and engraving. Ours: that a fit meets the distance of its own sample (the
//! limit φ → ∞ of the paper's equation 3, at that sample), because least squares alone smooth
//! relief as fine as the spacing; and the samples that are added.

use std::path::Path;

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::resample::OccupiedPlaces;
use super::work_meter::{FIT_STEPS, TREE_STEPS};
use super::{
    Neighbour, Neighbours, PointSet, PointSurface, SampleMove, SurfaceError, WorkError, WorkMeter,
};
use vps::storage::regular;

/// Bytes of an image file at most.
const LONGEST_IMAGE: u64 = 64 << 20;

/// Two samples are looked at together up to this distance, spacings of the surface.
const SEEN_SPACINGS: f64 = 1.8;
/// Slope of the image between two samples from which on samples are added between them: 27°.
const STEEP: f64 = 0.5;
/// And the distance that the relief leaves between them, spacings.
const TORN_SPACINGS: f64 = 1.2;
/// Samples nearer than this (spacings) are not parted again, and none is added nearer to another
/// than the second number.
const FINEST_SPACINGS: f64 = 0.45;
const APART_SPACINGS: f64 = 0.2;
/// Each round halves distances.
const ROUNDS: u32 = 3;
/// Walls that are lower than this, in largest empty circles, have samples enough at their upper and
/// lower edges.
const TALL_GAPS: f64 = 1.6;
/// On the walls of a relief samples are so far apart, largest empty circles; none is nearer to
/// another than the second number.
const WALL_GAPS: f64 = 0.7;
const WALL_APART_GAPS: f64 = 0.45;
/// The slope of the image at a sample is that between places so far to both sides, spacings.
const SLOPE_SPACINGS: f64 = 0.25;
/// Newton steps to the level of a fit.
const STEPS: u32 = 4;
/// Slopes along the normal below this lead nowhere; an undeformed field has slope 1.
const FLAT: f64 = 0.2;

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
    #[error(
        "an image of {width} x {height} pixels cannot be embossed; it takes at least 2 x 2, and \
            one grey per pixel"
    )]
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
        let bytes = regular::bytes(path, LONGEST_IMAGE)
            .map_err(|source| ImageError::Read { path: path.to_owned(), source })?;
        Self::decode(&bytes, path)
    }

    /// The same from bytes; `path` is for messages.
    ///
    /// # Errors
    /// [`ImageError`].
    pub fn decode(bytes: &[u8], path: &Path) -> Result<Self, ImageError> {
        let decoded = tiny_skia::Pixmap::decode_png(bytes).map_err(|error| ImageError::Decode {
            path: path.to_owned(),
            reason: error.to_string(),
        })?;
        // Premultiplied: what is transparent is dark already.
        let grey = |pixel: &tiny_skia::PremultipliedColorU8| {
            (0.2126 * f32::from(pixel.red())
                + 0.7152 * f32::from(pixel.green())
                + 0.0722 * f32::from(pixel.blue()))
                / 255.0
        };
        Self::new(
            decoded.width() as usize,
            decoded.height() as usize,
            decoded.pixels().iter().map(grey).collect(),
        )
    }

    /// Half its width and height, the larger one 1.
    pub(super) fn half_edges(&self) -> DVec2 {
        DVec2::new(self.width as f64, self.height as f64) / self.width.max(self.height) as f64
    }

    /// The grey at a place, (0, 0) top left and (1, 1) bottom right, between pixels' middles as
    /// straight lines; 0 beyond the image.
    pub(super) fn at(&self, place: DVec2) -> f64 {
        if !(place.cmpge(DVec2::ZERO).all() && place.cmple(DVec2::ONE).all()) {
            return 0.0;
        }
        let size = DVec2::new(self.width as f64, self.height as f64);
        let pixel = (place * size - 0.5).clamp(DVec2::ZERO, size - 1.0);
        let low = pixel.floor().min(size - 2.0);
        let x = low.x as usize;
        let y = low.y as usize;
        let t = pixel - low;
        let grey = |x: usize, y: usize| f64::from(self.greys[y * self.width + x]);
        let row = |y: usize| grey(x, y) + (grey(x + 1, y) - grey(x, y)) * t.x;
        row(y) + (row(y + 1) - row(y)) * t.y
    }
}

/// How an image lies over the surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ImagePlacement {
    /// Flat, as a stamp: its middle and the half edges of the image to the right and up, map frame,
    /// m. Only what faces the stamp gets it.
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
                Some(DVec2::new(
                    0.5 + longitude / core::f64::consts::TAU,
                    0.5 - latitude / core::f64::consts::PI,
                ))
            }
        }
    }
}

/// How many samples lie under an image, and about how many it adds where it is steep. Cost: the
/// neighbours of those samples.
pub(super) fn samples_under(
    surface: &PointSurface,
    image: &GreyImage,
    placement: &ImagePlacement,
    depth_m: f64,
    gap_m: f64,
) -> (u64, u64) {
    let points = surface.points();
    let heights_m: Vec<Option<f64>> = points
        .positions_map
        .par_iter()
        .zip(&points.normals_map)
        .map(|(at, normal)| placement.place(*at, *normal).map(|place| depth_m * image.at(place)))
        .collect();
    let added = |found: &mut Vec<Neighbour>, sample: usize| {
        let Some(height_m) = heights_m[sample] else { return 0.0 };
        let seen_m = SEEN_SPACINGS * surface.spacing_m();
        surface.neighbours().within(points.positions_map[sample], seen_m, found);
        let of_other = |other: &Neighbour| {
            let along_m = other.distance_squared_m2.sqrt();
            let up_m = (heights_m[other.sample as usize].unwrap_or(0.0) - height_m).abs();
            if up_m > STEEP * along_m { 1.0 + up_m / (WALL_GAPS * gap_m) } else { 0.0 }
        };
        found.iter().map(of_other).sum()
    };
    let n_added: f64 =
        (0..points.len()).into_par_iter().map_init(Vec::new, |found, n| added(found, n)).sum();
    (heights_m.iter().flatten().count() as u64, n_added as u64)
}

/// Samples to be added between those whose heights under the image differ so much that the relief
/// would tear them apart; on the surface as it is, in rounds that halve their distance. Cost: a
/// look-up of the image per sample, and the neighbours of those at a slope.
pub(super) fn between_steep(
    surface: &PointSurface,
    image: &GreyImage,
    placement: &ImagePlacement,
    depth_m: f64,
    meter: &WorkMeter,
) -> Result<PointSet, WorkError> {
    let spacing_m = surface.spacing_m();
    let height_m = |at: DVec3, normal: DVec3| {
        placement.place(at, normal).map_or(0.0, |place| depth_m * image.at(place))
    };
    let mut points = surface.points().clone();
    let n_before = points.len() as u32;
    let mut heights_m: Vec<f64> = points
        .positions_map
        .par_iter()
        .zip(&points.normals_map)
        .map(|(at, normal)| height_m(*at, *normal))
        .collect();
    let mut taken = OccupiedPlaces::new(APART_SPACINGS * spacing_m);
    points.positions_map.iter().for_each(|at| taken.take(*at));
    let mut looked_at: Vec<u32> = (0..n_before).collect();
    for _ in 0..ROUNDS {
        meter.take(TREE_STEPS * points.len() as u64)?;
        let near = Neighbours::new(&points.positions_map);
        let middles = |found: &mut Vec<Neighbour>, sample: &u32| {
            let at = points.positions_map[*sample as usize];
            let height = heights_m[*sample as usize];
            near.within(at, SEEN_SPACINGS * spacing_m, found);
            meter.take(1 + found.len() as u64)?;
            let is_torn = |other: &&Neighbour| {
                let along_m = other.distance_squared_m2.sqrt();
                let up_m = (heights_m[other.sample as usize] - height).abs();
                let is_beside = points.normals_map[other.sample as usize]
                    .dot(points.normals_map[*sample as usize])
                    > 0.0;
                is_beside
                    && along_m > FINEST_SPACINGS * spacing_m
                    && up_m > STEEP * along_m
                    && along_m.hypot(up_m) > TORN_SPACINGS * spacing_m
            };
            let torn = found.iter().filter(is_torn);
            let middle = |other: &Neighbour| {
                (0.5 * (at + points.positions_map[other.sample as usize]), *sample)
            };
            Ok(torn.map(middle).collect())
        };
        let middles: Vec<Vec<(DVec3, u32)>> =
            looked_at.par_iter().map_init(Vec::new, middles).collect::<Result<_, WorkError>>()?;
        let first_new = points.len() as u32;
        for (middle_map, sample) in middles.into_iter().flatten() {
            if !taken.is_free(middle_map) {
                continue;
            }
            let mut steps = 0;
            let on_surface = surface.project_counted(middle_map, &mut steps);
            meter.take(steps)?;
            let Some(at) = on_surface else { continue };
            let normal = surface.at(at).normal();
            if taken.is_free(at) && normal.is_normalized() {
                taken.take(at);
                points.push(at, normal, points.colors[sample as usize]);
                heights_m.push(height_m(at, normal));
            }
        }
        let new = first_new..points.len() as u32;
        if new.is_empty() {
            break;
        }
        let near = Neighbours::new(&points.positions_map);
        let mut found = Vec::new();
        looked_at.clear();
        for sample in new {
            near.within(
                points.positions_map[sample as usize],
                SEEN_SPACINGS * spacing_m,
                &mut found,
            );
            looked_at.extend(found.iter().map(|other| other.sample));
        }
        looked_at.sort_unstable();
        looked_at.dedup();
    }
    Ok(points.select(n_before..points.len() as u32))
}

/// Samples on the walls of a relief that is so steep that nothing was left between the samples
/// above and below: along the straight lines between neighbours, at most `gap_m` apart. `points`
/// are as the image found them, `moved` what it does to them.
pub(super) fn cliffs(
    points: &PointSet,
    moved: &[SampleMove],
    spacing_m: f64,
    gap_m: f64,
    meter: &WorkMeter,
) -> Result<PointSet, WorkError> {
    let mut after_map = points.positions_map.clone();
    moved.iter().for_each(|moved| after_map[moved.sample as usize] = moved.position_map);
    meter.take(TREE_STEPS * points.len() as u64)?;
    let near = Neighbours::new(&points.positions_map);
    let on_walls = |found: &mut Vec<Neighbour>, moved: &SampleMove| {
        let at = points.positions_map[moved.sample as usize];
        let after = moved.position_map;
        near.within(at, spacing_m, found);
        meter.take(1 + found.len() as u64)?;
        let mut walls = PointSet::default();
        for other in found.iter().map(|other| other.sample as usize) {
            let along = points.positions_map[other] - at;
            let up = after_map[other] - after;
            let n = (up.length() / (WALL_GAPS * gap_m)).ceil() as u32;
            if up.length() <= (TALL_GAPS * gap_m).max(along.length() / STEEP)
                || points.normals_map[other].dot(points.normals_map[moved.sample as usize]) <= 0.0
            {
                continue;
            }
            // Across the line, away from what stands higher.
            let high_to_low = if up.dot(points.normals_map[moved.sample as usize]) < 0.0 {
                along
            } else {
                -along
            };
            let Some(normal) = high_to_low.reject_from(up).try_normalize() else { continue };
            // Before they are there: a wall is as high as the depth that was asked for.
            meter.take(n.into())?;
            for k in 1..n {
                walls.push(
                    after + up * (f64::from(k) / f64::from(n)),
                    normal,
                    points.colors[moved.sample as usize],
                );
            }
        }
        Ok(walls)
    };
    let walls: Vec<PointSet> =
        moved.par_iter().map_init(Vec::new, on_walls).collect::<Result<_, WorkError>>()?;
    let mut taken = OccupiedPlaces::new(WALL_APART_GAPS * gap_m);
    after_map.iter().for_each(|at| taken.take(*at));
    let mut kept = PointSet::default();
    for walls in &walls {
        meter.take(walls.len() as u64)?;
        for (n, at) in walls.positions_map.iter().enumerate() {
            if taken.is_free(*at) {
                taken.take(*at);
                kept.push(*at, walls.normals_map[n], walls.colors[n]);
            }
        }
    }
    Ok(kept)
}

/// Where the samples go when white lies `depth_m` above the surface (below: engraving), and their
/// new normals; only those under the image that move. The caller, which moves the samples, makes
/// their fits again. Parallel; cost: a fit per sample at the image.
///
/// # Errors
/// [`SurfaceError::Coincident`] for samples at one place.
pub(super) fn embossed(
    surface: &PointSurface,
    image: &GreyImage,
    placement: &ImagePlacement,
    depth_m: f64,
    meter: &WorkMeter,
) -> Result<Vec<SampleMove>, SurfaceError> {
    let points = surface.points();
    let reach_m = SLOPE_SPACINGS * surface.spacing_m();
    let height_m = |at: &DVec3, normal: &DVec3| {
        placement.place(*at, *normal).map(|place| depth_m * image.at(place))
    };
    let heights_m: Vec<Option<f64>> = points
        .positions_map
        .par_iter()
        .zip(&points.normals_map)
        .map(|(at, normal)| height_m(at, normal))
        .collect();
    let distance_m = |sample: u32| heights_m[sample as usize].unwrap_or(0.0);
    let moved = |sample: u32| -> Result<Option<SampleMove>, SurfaceError> {
        let Some(height_m) = heights_m[sample as usize] else { return Ok(None) };
        meter.take(FIT_STEPS * surface.n_neighbours() as u64)?;
        let Some(fit) = surface.fit_to_distances(sample, distance_m)? else { return Ok(None) };
        let at = points.positions_map[sample as usize];
        let normal = points.normals_map[sample as usize];
        // The field falls by about a metre per metre on the way out.
        let mut way_m = height_m;
        for _ in 0..STEPS {
            let (value_m, gradient) = fit.at(at + normal * way_m);
            let along = -gradient.dot(normal);
            if along < FLAT {
                break;
            }
            way_m += value_m / along;
        }
        // The fit is about where the sample was: at the end of the way its gradient may turn
        // anywhere, and discs with such normals were teeth at the outline of a relief. How steep
        // the image is there, it says itself.
        let height_m_at =
            |at: DVec3| placement.place(at, normal).map_or(0.0, |place| depth_m * image.at(place));
        let slope = |along: DVec3| {
            (height_m_at(at + along * reach_m) - height_m_at(at - along * reach_m))
                / (2.0 * reach_m)
        };
        let (right, up) = normal.any_orthonormal_pair();
        let out = (normal - right * slope(right) - up * slope(up)).normalize();
        let is_sound = way_m.is_finite() && (way_m - height_m).abs() <= 0.5 * fit.half_m;
        Ok(Some(SampleMove {
            sample,
            position_map: at + normal * if is_sound { way_m } else { height_m },
            normal_map: out,
        }))
    };
    let moved: Vec<Option<SampleMove>> =
        (0..points.len() as u32).into_par_iter().map(moved).collect::<Result<_, _>>()?;
    Ok(moved.into_iter().flatten().collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn step_image() -> GreyImage {
        // Black on the left, white on the right.
        GreyImage::new(64, 32, (0..64 * 32).map(|n| if n % 64 < 32 { 0.0 } else { 1.0 }).collect())
            .unwrap()
    }

    fn sphere(radius: f64) -> PointSurface {
        let mut points = PointSet::default();
        let n = 4000;
        for i in 0..n {
            let z = 1.0 - (2.0 * f64::from(i) + 1.0) / f64::from(n);
            let turn = f64::from(i) * 2.399_963_229_728_653;
            let normal =
                DVec3::new((1.0 - z * z).sqrt() * turn.cos(), (1.0 - z * z).sqrt() * turn.sin(), z);
            points.push(normal * radius, normal, [0; 3]);
        }
        PointSurface::build(points, PointSurface::DEFAULT_NEIGHBOURS).unwrap()
    }

    const GLOBE: ImagePlacement = ImagePlacement::Around {
        center_map: DVec3::ZERO,
        north_map: DVec3::Z,
        front_map: DVec3::X,
    };

    #[test]
    fn greys_are_interpolated_between_the_middles_of_pixels() {
        let image = GreyImage::new(2, 2, vec![0.0, 1.0, 0.5, 0.5]).unwrap();
        for (place, grey) in [
            ((0.25, 0.25), 0.0),
            ((0.75, 0.25), 1.0),
            ((0.5, 0.25), 0.5),
            ((0.5, 0.5), 0.5),
            ((0.0, 0.0), 0.0),
            ((1.0, 1.0), 0.5),
        ] {
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
            let moved =
                embossed(&surface, &step_image(), &GLOBE, depth, &WorkMeter::unlimited()).unwrap();
            surface.move_samples(&moved).unwrap();
            let all: Vec<u32> = (0..surface.points().len() as u32).collect();
            surface.refit(&all, &WorkMeter::unlimited()).unwrap();
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
    fn normals_of_a_relief_around_a_ball_are_those_of_its_image_where_it_is_steep_too() {
        // Hills of 1 mm on a ball of 20 mm, 40 around it: as steep as 51°; the radius is r + d (1 +
        // cos 40 λ)/2 at the longitude λ.
        let n = 1024;
        let n_hills = 40.0;
        let depth_m = 1e-3;
        let grey = |k: usize| {
            0.5 + 0.5 * (n_hills * core::f64::consts::TAU * ((k % n) as f64 + 0.5) / n as f64).cos()
        };
        let hills = GreyImage::new(n, 2, (0..2 * n).map(|k| grey(k) as f32).collect()).unwrap();
        let surface = sphere(0.02);
        let mut n_steep = 0;
        for SampleMove { sample, normal_map, .. } in
            embossed(&surface, &hills, &GLOBE, depth_m, &WorkMeter::unlimited()).unwrap()
        {
            let out = surface.points().normals_map[sample as usize];
            let east = DVec3::Z.cross(out);
            if out.z.abs() > 0.5 {
                continue;
            }
            // The front, longitude 0, is the middle of the image.
            let longitude = out.y.atan2(out.x) + core::f64::consts::PI;
            let slope =
                -0.5 * depth_m * n_hills * (n_hills * longitude).sin() / (0.02 * east.length());
            n_steep += usize::from(slope.abs() > 0.7);
            let expected = (out - east.normalize() * slope).normalize();
            let off = normal_map.angle_between(expected).to_degrees();
            assert!(off < 4.0, "{off}° at {out}, slope {slope}");
        }
        assert!(n_steep > 300, "{n_steep}");
    }

    #[test]
    fn a_stamp_reaches_only_what_faces_it_and_lies_under_it() {
        let surface = sphere(0.02);
        let stamp = ImagePlacement::Flat {
            middle_map: DVec3::Z * 0.02,
            right_map: DVec3::X * 5e-3,
            up_map: DVec3::Y * 5e-3,
        };
        let moved = embossed(
            &surface,
            &GreyImage::new(2, 2, vec![1.0; 4]).unwrap(),
            &stamp,
            1e-3,
            &WorkMeter::unlimited(),
        )
        .unwrap();
        assert!(!moved.is_empty());
        for SampleMove { sample, position_map, normal_map } in moved {
            let before = surface.points().positions_map[sample as usize];
            assert!(before.z > 0.0 && before.x.abs() <= 5e-3 && before.y.abs() <= 5e-3, "{before}");
            // The fit meets the distance of its own sample; on the way out, the field of a sphere
            // that rises steeply is not quite linear.
            let within_m = if before.x.abs().max(before.y.abs()) < 2e-3 { 5e-6 } else { 1e-4 };
            assert!(
                (position_map.distance(before) - 1e-3).abs() < within_m
                    && normal_map.is_normalized(),
                "{before}: {position_map}"
            );
        }
    }

    /// The top face of a block at z = 5 mm, raised or sunk by an image of ±4 mm.
    fn worked_block(image: &GreyImage, depth_m: f64, is_refined: bool) -> PointSurface {
        let mut surface =
            PointSurface::build(crate::shapes::cube(20, 0.01), PointSurface::DEFAULT_NEIGHBOURS)
                .unwrap();
        let stamp = ImagePlacement::Flat {
            middle_map: DVec3::Z * 5e-3,
            right_map: DVec3::X * 4e-3,
            up_map: DVec3::Y * 4e-3,
        };
        if is_refined {
            let meter = WorkMeter::unlimited();
            let between = between_steep(&surface, image, &stamp, depth_m, &meter).unwrap();
            surface.replace(&[], &between, &meter).unwrap();
        }
        let meter = WorkMeter::unlimited();
        let moved = embossed(&surface, image, &stamp, depth_m, &meter).unwrap();
        surface.move_and_refit(&moved, &meter).unwrap();
        surface
    }

    #[test]
    fn a_ramp_has_the_depth_and_the_steepness_of_its_image() {
        // From black at x = -4 mm to white at 4 mm, exact where a quarter of a pixel is away from
        // the rim.
        let n = 256;
        let ramp =
            GreyImage::new(n, 2, (0..2 * n).map(|k| ((k % n) as f32 + 0.5) / n as f32).collect())
                .unwrap();
        for depth_m in [2e-3, 8e-3, -2e-3] {
            let surface = worked_block(&ramp, depth_m, true);
            let steepness = depth_m / 8e-3;
            let expected = DVec3::new(-steepness, 0.0, 1.0).normalize();
            let height_m = |x: f64| 5e-3 + depth_m * (x + 4e-3) / 8e-3;
            let is_inner = |at: &DVec3| at.x.abs() < 2.5e-3 && at.y.abs() < 2.5e-3 && at.z > 0.0;
            let points = surface.points();
            let inner =
                points.positions_map.iter().zip(&points.normals_map).filter(|(at, _)| is_inner(at));
            assert!(inner.clone().count() > 90, "{}", inner.count());
            for (at, normal) in inner {
                assert!(
                    (at.z - height_m(at.x)).abs() < 2e-6,
                    "{depth_m}: {at} instead of {} m",
                    height_m(at.x)
                );
                assert!(
                    normal.dot(expected) > 0.5_f64.to_radians().cos(),
                    "{depth_m}: {normal} instead of {expected}"
                );
            }
            // And between samples.
            for k in 0..200 {
                let x = (f64::from(k) * 0.7548).fract() * 4e-3 - 2e-3;
                let y = (f64::from(k) * 0.5698).fract() * 4e-3 - 2e-3;
                let off_m = surface.at(DVec3::new(x, y, height_m(x))).value_m;
                assert!(off_m.abs() < 5e-6, "{depth_m}: {off_m} m at {x}, {y}");
            }
        }
    }

    #[test]
    fn a_cliff_gets_samples_and_is_as_steep_as_they_let_it_be() {
        // White on the right: a cliff of one pixel, 0.03 mm wide; samples are 0.5 mm apart.
        let depth_m = 1e-3;
        let rise_m = |surface: &PointSurface, z: f64, y: f64| {
            (-2000..2000)
                .map(|k| f64::from(k) * 1e-6)
                .find(|x| surface.at(DVec3::new(*x, y, z)).value_m > 0.0)
                .unwrap()
        };
        let width_m = |surface: &PointSurface| {
            let at = |y: f64| {
                (rise_m(surface, 5e-3 + 0.9 * depth_m, y)
                    - rise_m(surface, 5e-3 + 0.1 * depth_m, y))
                .abs()
            };
            [-1e-3, -3e-4, 4e-4, 1.1e-3].map(at).into_iter().fold(0.0, f64::max)
        };
        let image = GreyImage::new(
            256,
            2,
            (0..512).map(|k| if k % 256 < 128 { 0.0 } else { 1.0 }).collect(),
        )
        .unwrap();
        let coarse = worked_block(&image, depth_m, false);
        let fine = worked_block(&image, depth_m, true);
        assert!(
            fine.points().len() > coarse.points().len() + 30,
            "{} of {}",
            fine.points().len(),
            coarse.points().len()
        );
        let coarse_m = width_m(&coarse);
        let fine_m = width_m(&fine);
        assert!(fine_m < 0.08e-3 && fine_m < 0.6 * coarse_m, "{fine_m} m against {coarse_m} m");
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
