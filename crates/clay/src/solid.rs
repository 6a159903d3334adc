//! Solids that work a clay model or become one: read, and sampled as densely as they are needed.

use std::borrow::Cow;
use std::path::PathBuf;

use glam::DVec3;

use super::load::{DEFAULT_SAMPLES, FileContents, area_m2, open, sample_of, scaled, spacing_of};
use super::mesh_solid::MeshSolid;
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
    /// The border of what a mesh bounds: closed and outward, m; open where the mesh is a skin.
    Mesh(TriangleMesh),
    /// A primitive shape, centred on the origin, and how much it is stretched along x, y and z.
    Shape(Shape, DVec3),
}

/// A solid that was read, and not sampled yet.
#[derive(Clone, Debug)]
pub struct OpenedSolid {
    /// What its samples are taken from.
    pub source: SolidSource,
    /// What a user should know of the file of a mesh, a sentence each.
    pub warnings: Vec<String>,
    merged: usize,
    normals: NormalSource,
    /// The file, for messages; `None` of a shape.
    path: Option<PathBuf>,
    spacing_m: Option<f64>,
}

impl Solid {
    /// Reads it. Cost: a file is read, and the solid of a mesh made.
    ///
    /// # Errors
    /// [`LoadError`].
    pub fn open(&self) -> Result<OpenedSolid, LoadError> {
        let of_faces = |source, spacing_m| OpenedSolid {
            source,
            warnings: Vec::new(),
            merged: 0,
            normals: NormalSource::Faces,
            path: None,
            spacing_m,
        };
        match self {
            Self::Shape { shape, scale, spacing_m } => {
                Ok(of_faces(SolidSource::Shape(*shape, *scale), *spacing_m))
            }
            Self::File { path, metres_per_unit, scale, spacing_m } => {
                let opened = match open(path, *metres_per_unit, *scale, *spacing_m)? {
                    FileContents::Mesh(MeshSolid { border, warnings }) => {
                        OpenedSolid { warnings, ..of_faces(SolidSource::Mesh(border), *spacing_m) }
                    }
                    FileContents::Samples(LoadedPoints { points, merged, normals, warnings }) => {
                        let source = SolidSource::Samples(points);
                        OpenedSolid { warnings, merged, normals, ..of_faces(source, None) }
                    }
                };
                Ok(OpenedSolid { path: Some(path.clone()), ..opened })
            }
        }
    }

    /// Its samples.
    ///
    /// # Errors
    /// [`LoadError`].
    pub fn load(&self) -> Result<LoadedPoints, LoadError> {
        self.open()?.load()
    }

    /// Its samples, as far apart as those of a clay model ([`SolidSource::beside`]), whatever its
    /// own spacing.
    ///
    /// # Errors
    /// [`LoadError`].
    pub fn load_beside(&self, spacing_m: f64) -> Result<PointSet, LoadError> {
        let opened = self.open()?;
        let points = opened.source.beside(spacing_m, &WorkMeter::unlimited());
        points.map_err(|source| opened.refused(source))
    }
}

impl OpenedSolid {
    /// About how many samples it has, and the box around it, m.
    pub fn size(&self) -> (u64, (DVec3, DVec3)) {
        let n_of = |mesh: &TriangleMesh| {
            let n_samples = |spacing_m: f64| area_m2(mesh) / (spacing_m * spacing_m);
            self.spacing_m.map_or(DEFAULT_SAMPLES, n_samples) as u64
        };
        let n_samples = match &self.source {
            SolidSource::Samples(points) => points.len() as u64,
            SolidSource::Mesh(mesh) => n_of(mesh),
            SolidSource::Shape(shape, scale) => n_of(&rough(shape, *scale)),
        };
        (n_samples, self.source.bounds_map(&Pose::IDENTITY).unwrap_or_default())
    }

    /// Its samples.
    ///
    /// # Errors
    /// [`LoadError`].
    pub fn load(self) -> Result<LoadedPoints, LoadError> {
        let sampled = self.faces().map(|(mesh, spacing_m)| {
            sample_of(&mesh, spacing_m, &WorkMeter::unlimited())
                .map_err(|source| self.refused(source))
        });
        let sampled = sampled.transpose()?;
        let Self { source, warnings, merged, normals, .. } = self;
        let points = match source {
            SolidSource::Samples(points) => points,
            SolidSource::Mesh(_) | SolidSource::Shape(..) => sampled.unwrap_or_default(),
        };
        Ok(LoadedPoints { points, merged, normals, warnings })
    }

    /// What works a clay model, and the warnings: its samples where it names a spacing of its own;
    /// else the model samples it ([`SolidSource::beside`]).
    ///
    /// # Errors
    /// [`LoadError`].
    pub fn into_source(self) -> Result<(SolidSource, Vec<String>), LoadError> {
        if self.spacing_m.is_none() {
            return Ok((self.source, self.warnings));
        }
        let LoadedPoints { points, warnings, .. } = self.load()?;
        Ok((SolidSource::Samples(points), warnings))
    }

    /// The triangles that it is sampled from, and the spacing, m; `None` of points.
    pub(super) fn faces(&self) -> Option<(Cow<'_, TriangleMesh>, f64)> {
        let spacing_on = |mesh: &TriangleMesh| {
            self.spacing_m.unwrap_or_else(|| spacing_of(mesh, DEFAULT_SAMPLES))
        };
        match &self.source {
            SolidSource::Samples(_) => None,
            SolidSource::Mesh(mesh) => Some((Cow::Borrowed(mesh), spacing_on(mesh))),
            SolidSource::Shape(shape, scale) => {
                let spacing_m = spacing_on(&rough(shape, *scale));
                Some((Cow::Owned(cut_for(shape, *scale, spacing_m)), spacing_m))
            }
        }
    }

    fn refused(&self, source: SurfaceError) -> LoadError {
        match &self.path {
            Some(path) => LoadError::Surface { path: path.clone(), source },
            None => LoadError::Shape(source),
        }
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
            Self::Shape(shape, scale) => {
                sample_of(&cut_for(shape, *scale, spacing_m), spacing_m, meter)
            }
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
        let placed = |at: DVec3| map_from_body.transform_point(at);
        match self {
            Self::Samples(points) => around(points.positions_map.iter().copied().map(placed)),
            // A border has vertices of what is not on it, too.
            Self::Mesh(mesh) => {
                let corners = mesh.triangles.as_flattened().iter();
                around(corners.map(|corner| placed(mesh.vertices[*corner as usize])))
            }
            Self::Shape(shape, scale) => {
                around(rough(shape, *scale).vertices.into_iter().map(placed))
            }
        }
    }
}

/// Lowest and highest corner of the box around points.
fn around(mut points: impl Iterator<Item = DVec3>) -> Option<(DVec3, DVec3)> {
    let first = points.next()?;
    Some(points.fold((first, first), |(low, high), at| (low.min(at), high.max(at))))
}

/// Area and size of a shape hardly depend on how finely it is cut.
fn rough(shape: &Shape, scale: DVec3) -> TriangleMesh {
    scaled(shape.tessellate(f64::INFINITY), scale)
}

/// A shape, cut as finely as samples at this spacing show.
fn cut_for(shape: &Shape, scale: DVec3, spacing_m: f64) -> TriangleMesh {
    scaled(shape.tessellate(CHORD_SHARE * spacing_m / scale.max_element()), scale)
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
            let (n, (low, high)) = solid.open().unwrap().size();
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
