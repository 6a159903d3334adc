//! Solids that work a clay model or become one: read, and sampled as densely as they are needed.

use std::path::PathBuf;

use glam::DVec3;

use super::load::{
    DEFAULT_SAMPLES, FileContents, area_m2, load_scaled, open, sample_of, scaled, spacing_of,
};
use super::{LoadError, LoadedPoints, NormalSource, PointSet, SurfaceError, WorkMeter};
use vps::mesh::TriangleMesh;
use vps::mesh::primitives::Shape;
use vps::spatial::Pose;

/// Samples of a solid that is to work a clay model, whatever the spacing of the clay: fewer make no
/// surface, more take too long.
const BESIDE_SAMPLES: (f64, f64) = (500.0, 500_000.0);
/// How far a shape that is cut into triangles may be off, over the spacing of its samples.
const CHORD_SHARE: f64 = 0.02;

/// A solid that samples can be had of.
#[derive(Clone, Debug, PartialEq)]
pub enum Solid {
    /// A file of points or a mesh.
    File {
        /// Where it is.
        path: PathBuf,
        /// 1 for m, 1e-3 for mm.
        metres_per_unit: f64,
        /// Stretched so much along x, y and z; above 0.
        scale: DVec3,
        /// Between samples of a mesh, m; `None`: about 20,000 samples, or as a clay model has them.
        spacing_m: Option<f64>,
    },
    /// A primitive shape.
    Shape {
        /// Centred on the origin.
        shape: Shape,
        /// Stretched so much along x, y and z; above 0.
        scale: DVec3,
        /// Between samples, m; `None`: about 20,000 samples, or as a clay model has them.
        spacing_m: Option<f64>,
    },
}

/// A solid in memory, in a frame of its own: its samples, or what they can be taken from.
#[derive(Clone, Debug)]
pub enum SolidSource {
    /// As it is.
    Samples(PointSet),
    /// A mesh, m.
    Mesh(TriangleMesh),
    /// A primitive shape, centred on the origin, and how much it is stretched along x, y and z.
    Shape(Shape, DVec3),
}

impl Solid {
    /// Its samples.
    ///
    /// # Errors
    /// [`LoadError`].
    pub fn load(&self) -> Result<LoadedPoints, LoadError> {
        match self {
            Self::File { path, metres_per_unit, scale, spacing_m } => {
                load_scaled(path, *metres_per_unit, *scale, *spacing_m)
            }
            Self::Shape { shape, scale, spacing_m } => {
                let spacing_m =
                    spacing_m.unwrap_or_else(|| spacing_of(&rough(shape, *scale), DEFAULT_SAMPLES));
                let points = sampled(shape, *scale, spacing_m, &WorkMeter::unlimited())
                    .map_err(LoadError::Shape)?;
                Ok(LoadedPoints { points, merged: 0, normals: NormalSource::Faces })
            }
        }
    }

    /// About how many samples it has, and the box around it, m. Cost: the file is read, and not
    /// sampled.
    ///
    /// # Errors
    /// [`LoadError`].
    pub fn look(&self) -> Result<(u64, (DVec3, DVec3)), LoadError> {
        let body = self.source()?;
        let spacing_m = self.spacing_m();
        let n_of = |mesh: &TriangleMesh| {
            spacing_m.map_or(DEFAULT_SAMPLES, |spacing_m| area_m2(mesh) / (spacing_m * spacing_m))
        };
        let n_samples = match &body {
            SolidSource::Samples(points) => points.len() as u64,
            SolidSource::Mesh(mesh) => n_of(mesh) as u64,
            SolidSource::Shape(shape, scale) => n_of(&rough(shape, *scale)) as u64,
        };
        Ok((n_samples, body.bounds_map(&Pose::IDENTITY).unwrap_or_default()))
    }

    /// The same, not sampled yet where it names no spacing of its own: a clay model does
    /// ([`SolidSource::beside`]).
    ///
    /// # Errors
    /// [`LoadError`].
    pub fn open(&self) -> Result<SolidSource, LoadError> {
        if self.spacing_m().is_none() {
            self.source()
        } else {
            Ok(SolidSource::Samples(self.load()?.points))
        }
    }

    /// What its samples are taken from.
    fn source(&self) -> Result<SolidSource, LoadError> {
        Ok(match self {
            Self::File { path, metres_per_unit, scale, .. } => {
                match open(path, *metres_per_unit, *scale)? {
                    FileContents::Samples(loaded) => SolidSource::Samples(loaded.points),
                    FileContents::Mesh(mesh) => SolidSource::Mesh(mesh),
                }
            }
            Self::Shape { shape, scale, .. } => SolidSource::Shape(*shape, *scale),
        })
    }

    fn spacing_m(&self) -> Option<f64> {
        let (Self::File { spacing_m, .. } | Self::Shape { spacing_m, .. }) = self;
        *spacing_m
    }

    /// Its samples, as far apart as those of a clay model ([`SolidSource::beside`]), whatever its
    /// own spacing.
    ///
    /// # Errors
    /// [`LoadError`].
    pub fn load_beside(&self, spacing_m: f64) -> Result<PointSet, LoadError> {
        let points = self.source()?.beside(spacing_m, &WorkMeter::unlimited());
        points.map_err(|source| match self {
            Self::File { path, .. } => LoadError::Surface { path: path.clone(), source },
            Self::Shape { .. } => LoadError::Shape(source),
        })
    }
}

impl SolidSource {
    /// Its samples: those it has, or as far apart as those of a clay model that it is to join or
    /// cut; nearer where it is so small that it would have hardly any, farther where it would have
    /// more than half a million.
    ///
    /// # Errors
    /// [`SurfaceError`] for a mesh without area.
    pub fn beside(&self, spacing_m: f64, meter: &WorkMeter) -> Result<PointSet, SurfaceError> {
        let (_, spacing_m) = self.samples_beside(spacing_m);
        match self {
            Self::Samples(points) => Ok(points.clone()),
            Self::Mesh(mesh) => sample_of(mesh, spacing_m, meter),
            Self::Shape(shape, scale) => sampled(shape, *scale, spacing_m, meter),
        }
    }

    /// About how many samples [`Self::beside`] gives, and how far apart they are, m. Cost:
    /// O(triangles).
    pub(super) fn samples_beside(&self, spacing_m: f64) -> (u64, f64) {
        let (least, most) = BESIDE_SAMPLES;
        let of_area = |area_m2: f64| {
            let spacing_of = |n_samples: f64| (area_m2 / n_samples).sqrt();
            let spacing_m = spacing_m.min(spacing_of(least)).max(spacing_of(most));
            ((area_m2 / (spacing_m * spacing_m)) as u64, spacing_m)
        };
        match self {
            // Those of a file are as far apart as they are: few are farther than the clay's.
            Self::Samples(points) => (points.len() as u64, spacing_m),
            Self::Mesh(mesh) => of_area(area_m2(mesh)),
            Self::Shape(shape, scale) => of_area(area_m2(&rough(shape, *scale))),
        }
    }

    /// Lowest and highest corner of the box around it where it stands, map frame, m; `None` for a
    /// body of nothing.
    pub fn bounds_map(&self, map_from_body: &Pose) -> Option<(DVec3, DVec3)> {
        let around = |corners: &[DVec3]| {
            let mut placed = corners.iter().map(|at| map_from_body.transform_point(*at));
            let first = placed.next()?;
            Some(placed.fold((first, first), |(low, high), at| (low.min(at), high.max(at))))
        };
        match self {
            Self::Samples(points) => around(&points.positions_map),
            Self::Mesh(mesh) => around(&mesh.vertices),
            Self::Shape(shape, scale) => around(&rough(shape, *scale).vertices),
        }
    }
}

/// Area and size of a shape hardly depend on how finely it is cut.
fn rough(shape: &Shape, scale: DVec3) -> TriangleMesh {
    scaled(shape.tessellate(f64::INFINITY), scale)
}

fn sampled(
    shape: &Shape,
    scale: DVec3,
    spacing_m: f64,
    meter: &WorkMeter,
) -> Result<PointSet, SurfaceError> {
    sample_of(
        &scaled(shape.tessellate(CHORD_SHARE * spacing_m / scale.max_element()), scale),
        spacing_m,
        meter,
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::PointSurface;

    #[test]
    #[ignore = "takes long: `cargo test -- --include-ignored`"]
    fn a_solid_beside_a_clay_model_has_its_spacing_unless_that_makes_too_few_samples_or_too_many() {
        let ball = |radius_m: f64| Solid::Shape {
            shape: Shape::Sphere { radius_m },
            scale: DVec3::ONE,
            spacing_m: None,
        };
        let spacing_m = 1e-3;
        let area_m2 = |radius_m: f64| 4.0 * core::f64::consts::PI * radius_m * radius_m;
        for (radius_m, expected) in [(0.5e-3, 500.0), (0.02, area_m2(0.02) / 1e-6)] {
            let points = ball(radius_m).load_beside(spacing_m).unwrap();
            let n = points.len() as f64;
            assert!(
                (n / expected - 1.0).abs() < 0.15,
                "{n} of {expected} for a ball of {radius_m} m"
            );
            assert!(PointSurface::build(points, PointSurface::DEFAULT_NEIGHBOURS).is_ok());
        }
        let most = ball(0.1).load_beside(1e-5).unwrap().len() as f64;
        assert!((most / BESIDE_SAMPLES.1 - 1.0).abs() < 0.15, "{most}");
    }

    #[test]
    fn a_ball_that_is_stretched_is_an_ellipsoid_whichever_way_it_comes() {
        let scale = DVec3::new(1.0, 0.5, 2.0);
        let spacing_m = Some(1e-3);
        let radius_m = 0.01;
        let shape = Shape::Sphere { radius_m };
        let folder = tempfile::tempdir().unwrap();
        let mesh = folder.path().join("ball.obj");
        let points = folder.path().join("ball.ply");
        let ball = shape.tessellate(1e-5);
        let lines = ball.vertices.iter().map(|at| format!("v {} {} {}\n", at.x, at.y, at.z));
        let faces =
            ball.triangles.iter().map(|[a, b, c]| format!("f {} {} {}\n", a + 1, b + 1, c + 1));
        std::fs::write(&mesh, lines.chain(faces).collect::<String>()).unwrap();
        let of_shape = Solid::Shape { shape, scale: DVec3::ONE, spacing_m }.load().unwrap().points;
        crate::save(&points, &of_shape).unwrap();
        let of_file =
            |path: PathBuf, spacing_m| Solid::File { path, metres_per_unit: 1.0, scale, spacing_m };
        for solid in [
            Solid::Shape { shape, scale, spacing_m },
            of_file(mesh, spacing_m),
            of_file(points, None),
        ] {
            let points = solid.load().unwrap().points;
            for (at, normal) in points.positions_map.iter().zip(&points.normals_map) {
                let on_ball = *at / scale;
                assert!((on_ball.length() - radius_m).abs() < 3e-5, "{solid:?}: {at}");
                assert!(
                    normal.dot((on_ball / scale).normalize()) > 0.99,
                    "{solid:?}: {normal} at {at}"
                );
            }
            let (n, (low, high)) = solid.look().unwrap();
            assert!(
                (high - low).distance(2.0 * radius_m * scale) < 1e-4,
                "{solid:?}: {low} {high}"
            );
            assert!(
                (n as f64 / points.len() as f64 - 1.0).abs() < 0.2,
                "{solid:?}: {n} of {}",
                points.len()
            );
        }
    }
}
