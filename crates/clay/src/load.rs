//! Samples from files: scans with what they lack made good, and meshes sampled.

use std::path::{Path, PathBuf};

use glam::DVec3;

use super::mesh_solid::MeshSolid;
use super::sample::{GREY, sample_within};
use super::{Neighbour, Neighbours, PointSet, Solid, SurfaceError, WorkMeter, normals};
use vps::mesh::cloud::{self, Cloud, Contents};
use vps::mesh::{self, MeshError, TriangleMesh};
use vps::setting_names::SettingNames;

/// Samples of a mesh for which no spacing is asked.
pub(super) const DEFAULT_SAMPLES: f64 = 20_000.0;
/// Points nearer to each other than this share of the whole extent are one.
const ONE_PLACE: f64 = 1e-7;

/// Where normals came from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NormalSource {
    /// The file has them.
    File,
    /// The file has them, pointing into the material: they were turned.
    FileTurned,
    /// The file has none, or some that are no directions: planes through neighbours.
    Estimated,
    /// Faces of a mesh.
    Faces,
}

/// Samples of a solid, and what was done to them.
#[derive(Clone, Debug)]
pub struct LoadedPoints {
    /// Ready for [`super::PointSurface::build`].
    pub points: PointSet,
    /// Points at the place of another one, left out.
    pub merged: usize,
    /// Where the normals came from.
    pub normals: NormalSource,
    /// What a user should know of the file of a mesh, a sentence each.
    pub warnings: Vec<String>,
}

/// A file that gives no samples. Messages read well after "failed to load the points: ";
/// [`LoadError::hint`] says what to do.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LoadError {
    /// The file itself.
    #[error(transparent)]
    File(#[from] MeshError),
    /// The extension names no known format.
    #[error("{}: unknown extension `{extension}`, known: {}, {}", path.display(), mesh::EXTENSIONS.join(", "), cloud::EXTENSIONS.join(", "))]
    UnknownExtension {
        /// As given.
        path: PathBuf,
        /// Lower case, without the dot.
        extension: String,
    },
    /// All points are at one place.
    #[error("{}: all {found} points are at one place", path.display())]
    OnePlace {
        /// As given.
        path: PathBuf,
        /// How many there are.
        found: usize,
    },
    /// The points make no surface.
    #[error("{}: {source}", path.display())]
    Surface {
        /// As given.
        path: PathBuf,
        /// Why not.
        source: SurfaceError,
    },
    /// A shape that cannot be sampled.
    #[error("the shape: {0}")]
    Shape(SurfaceError),
}

impl LoadError {
    /// What to do about it, where there is something to say.
    pub fn hint(&self, names: &SettingNames) -> Option<String> {
        let hint = match self {
            Self::File(error) => return error.hint(names),
            Self::UnknownExtension { .. } => {
                "export the scan as PLY, or as text with one point in each line (.xyz)"
            }
            Self::OnePlace { .. } => {
                "check the columns of the file and its unit, or export the scan again"
            }
            Self::Surface { source, .. } | Self::Shape(source) => return Some(source.hint(names)),
        };
        Some(hint.to_owned())
    }
}

/// Reads samples: points as they are, and those of the solid that a mesh bounds at `mesh_spacing_m`
/// (`None`: about 20,000 samples). Points at one place become one; normals that are missing are
/// estimated, and turned round where they point inwards as a whole.
///
/// # Errors
/// [`LoadError`], naming the file and what is wrong in it.
pub fn load(
    path: &Path,
    metres_per_unit: f64,
    mesh_spacing_m: Option<f64>,
) -> Result<LoadedPoints, LoadError> {
    let path = path.to_owned();
    Solid::File { path, metres_per_unit, scale: DVec3::ONE, spacing_m: mesh_spacing_m }.load()
}

/// What a file holds.
pub(super) enum FileContents {
    /// Samples.
    Samples(LoadedPoints),
    /// The solid of a mesh, from which samples can be taken.
    Mesh(MeshSolid),
}

/// Reads a file of points, or a mesh, and stretches it along x, y and z; `spacing_m` is that of the
/// samples that will be taken of a mesh, if it is known. Cost: a mesh is read
/// twice, as only its own reader has notes; and that of its solid.
pub(super) fn open(
    path: &Path,
    metres_per_unit: f64,
    scale: DVec3,
    spacing_m: Option<f64>,
) -> Result<FileContents, LoadError> {
    let extension = path
        .extension()
        .map(|extension| extension.to_string_lossy().to_lowercase())
        .unwrap_or_default();
    if !mesh::EXTENSIONS.iter().chain(cloud::EXTENSIONS).any(|known| *known == extension) {
        return Err(LoadError::UnknownExtension { path: path.to_owned(), extension });
    }
    let cloud = match cloud::load(path, metres_per_unit)? {
        Contents::Cloud(cloud) => cloud,
        Contents::Mesh(_) => {
            let mut file = mesh::load_with_notes(path, metres_per_unit)?;
            file.mesh = scaled(file.mesh, scale);
            return Ok(FileContents::Mesh(MeshSolid::new(file, spacing_m)));
        }
    };
    let found = cloud.positions.len();
    if found > 1 && cloud.positions.iter().all(|at| *at == cloud.positions[0]) {
        return Err(LoadError::OnePlace { path: path.to_owned(), found });
    }
    let refuse = |source: SurfaceError| LoadError::Surface { path: path.to_owned(), source };
    let loaded = complete(cloud).map_err(refuse)?;
    Ok(FileContents::Samples(LoadedPoints { points: loaded.points.scaled(scale), ..loaded }))
}

/// A mesh, stretched along x, y and z.
pub(super) fn scaled(mut mesh: TriangleMesh, factors: DVec3) -> TriangleMesh {
    mesh.vertices.iter_mut().for_each(|at| *at *= factors);
    mesh
}

/// Samples of a mesh that can make a surface; errors name the size of the mesh, which a wrong unit
/// makes wrong.
pub(super) fn sample_of(
    mesh: &TriangleMesh,
    spacing_m: f64,
    meter: &WorkMeter,
) -> Result<PointSet, SurfaceError> {
    let points = sample_within(mesh, spacing_m, meter)?;
    if points.len() < PointSet::LEAST {
        let across_m = mesh.bounds().map_or(0.0, |(low, high)| (high - low).max_element());
        return Err(SurfaceError::TooCoarse { found: points.len(), spacing_m, across_m });
    }
    points.check()?;
    Ok(points)
}

/// With it a mesh has about so many samples, m.
pub(super) fn spacing_of(mesh: &TriangleMesh, n_samples: f64) -> f64 {
    (area_m2(mesh) / n_samples).sqrt()
}

pub(super) fn area_m2(mesh: &TriangleMesh) -> f64 {
    let area = |[a, b, c]: [DVec3; 3]| 0.5 * (b - a).cross(c - a).length();
    (0..mesh.triangles.len()).map(|triangle| area(mesh.corners(triangle))).sum()
}

/// Points as a file has them, made into samples of a surface.
///
/// # Errors
/// [`SurfaceError`] when there are too few, or no planes can be found.
pub(super) fn complete(cloud: Cloud) -> Result<LoadedPoints, SurfaceError> {
    let kept = distinct(&cloud.positions);
    let merged = cloud.positions.len() - kept.len();
    if kept.len() < PointSet::LEAST {
        return Err(SurfaceError::TooFew { found: kept.len() });
    }
    let positions_map: Vec<DVec3> =
        kept.iter().map(|point| cloud.positions[*point as usize]).collect();
    let given: Option<Vec<DVec3>> = cloud.normals.and_then(|normals| {
        kept.iter().map(|point| normals[*point as usize].try_normalize()).collect()
    });
    let colors = match cloud.colors {
        Some(colors) => kept.iter().map(|point| colors[*point as usize]).collect(),
        None => vec![GREY; kept.len()],
    };
    let (normals_map, source) = match given {
        Some(normals) if point_inwards(&positions_map, &normals) => {
            (normals.into_iter().map(|normal| -normal).collect(), NormalSource::FileTurned)
        }
        Some(normals) => (normals, NormalSource::File),
        None => (normals::estimate(&positions_map)?, NormalSource::Estimated),
    };
    let points = PointSet { positions_map, normals_map, colors, patches: Vec::new() };
    points.check()?;
    Ok(LoadedPoints { points, merged, normals: source, warnings: Vec::new() })
}

/// The first point of every place, in order.
fn distinct(positions_map: &[DVec3]) -> Vec<u32> {
    let (low, high) =
        positions_map.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), at| {
            (low.min(*at), high.max(*at))
        });
    let tolerance_m = ONE_PLACE * (high - low).max_element().max(0.0);
    let near = Neighbours::new(positions_map);
    let mut is_free = vec![true; positions_map.len()];
    let mut found: Vec<Neighbour> = Vec::new();
    let mut kept = Vec::new();
    for (at, point) in positions_map.iter().zip(0..) {
        if is_free[point as usize] {
            kept.push(point);
            near.within(*at, tolerance_m, &mut found);
            found.iter().for_each(|other| is_free[other.sample as usize] = false);
        }
    }
    kept
}

/// The volume that the samples enclose is negative, each taken for the area that it has among its
/// neighbours.
fn point_inwards(positions_map: &[DVec3], normals: &[DVec3]) -> bool {
    const AROUND: usize = 7;
    let near = Neighbours::new(positions_map);
    let middle = positions_map.iter().sum::<DVec3>() / positions_map.len() as f64;
    let mut found = Vec::new();
    let mut volume = 0.0;
    for (at, normal) in positions_map.iter().zip(normals) {
        near.nearest_n(*at, AROUND, &mut found);
        volume +=
            found.last().map_or(0.0, |last| last.distance_squared_m2) * normal.dot(*at - middle);
    }
    volume < 0.0
}

#[cfg(test)]
mod tests {
    use super::super::shapes::sphere;
    use super::super::{PointSurface, save};
    use super::*;

    fn refusal(name: &str, text: &str) -> LoadError {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        load(&path, 1.0, None).unwrap_err()
    }

    #[test]
    fn samples_come_back_from_a_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("ball.ply");
        let mut points = sphere(500, 0.05);
        points.colors[7] = [1, 2, 3];
        save(&path, &points).unwrap();
        let loaded = load(&path, 1.0, None).unwrap();
        assert_eq!((loaded.merged, loaded.normals), (0, NormalSource::File));
        assert_eq!(
            (&loaded.points.positions_map, &loaded.points.colors),
            (&points.positions_map, &points.colors)
        );
        for (found, normal) in loaded.points.normals_map.iter().zip(&points.normals_map) {
            assert!(found.distance(*normal) < 1e-6);
        }
        let mut turned = points.clone();
        turned.normals_map.iter_mut().for_each(|normal| *normal = -*normal);
        save(&path, &turned).unwrap();
        let again = load(&path, 1.0, None).unwrap();
        assert_eq!(again.normals, NormalSource::FileTurned);
        assert_eq!(again.points, loaded.points);
    }

    #[test]
    fn what_a_scan_lacks_is_made_good() {
        let ball = sphere(800, 0.05);
        let mut positions = ball.positions_map.clone();
        positions.extend_from_slice(&ball.positions_map[..10]);
        positions.push(positions[3] + 1e-10);
        let loaded = complete(Cloud { positions, normals: None, colors: None }).unwrap();
        assert_eq!(
            (loaded.merged, loaded.normals, loaded.points.len()),
            (11, NormalSource::Estimated, 800)
        );
        for (normal, right) in loaded.points.normals_map.iter().zip(&ball.normals_map) {
            assert!(normal.dot(*right) > 0.99);
        }
        // One normal that is no direction: none of them is trusted.
        let mut normals = ball.normals_map.clone();
        normals[5] = DVec3::ZERO;
        let loaded =
            complete(Cloud { positions: ball.positions_map, normals: Some(normals), colors: None })
                .unwrap();
        assert_eq!(loaded.normals, NormalSource::Estimated);
        assert!(PointSurface::build(loaded.points, PointSurface::DEFAULT_NEIGHBOURS).is_ok());
    }

    #[test]
    fn meshes_are_sampled() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("corner.obj");
        std::fs::write(
            &path,
            "v 0 0 0\nv 100 0 0\nv 0 100 0\nv 0 0 100\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n",
        )
        .unwrap();
        let loaded = load(&path, 1e-3, Some(2e-3)).unwrap();
        let expected = (1.5 + 3.0_f64.sqrt() / 2.0) * 0.01 / 4e-6;
        assert_eq!(loaded.normals, NormalSource::Faces);
        assert!(
            (loaded.points.len() as f64 / expected - 1.0).abs() < 0.1,
            "{} of {expected}",
            loaded.points.len()
        );
        let about = load(&path, 1e-3, None).unwrap().points.len() as f64;
        assert!((about / DEFAULT_SAMPLES - 1.0).abs() < 0.1, "{about}");
    }

    #[test]
    fn files_that_give_no_samples_say_why() {
        let three = refusal("three.xyz", "0 0 0\n1 0 0\n0 1 0\n");
        assert!(
            three.to_string().ends_with("three.xyz: 3 points, at least 32 are needed"),
            "{three}"
        );
        assert!(three.hint(&SettingNames::PLAIN).is_some_and(|hint| hint.contains("densely")));
        let same = refusal("same.xyz", &"1 2 3\n".repeat(100));
        assert!(same.to_string().ends_with("same.xyz: all 100 points are at one place"), "{same}");
        let few = refusal("few.xyz", &"1 2 3\n4 5 6\n".repeat(100));
        assert!(few.to_string().ends_with("few.xyz: 2 points, at least 32 are needed"), "{few}");
        let line: String = (0..100).map(|k| format!("{k} 0 0\n")).collect();
        let line = refusal("line.xyz", &line);
        assert!(
            line.to_string().ends_with(
                "line.xyz: 100 of 100 points lie with their neighbours on a line, so \
                    they have no tangent plane"
            ),
            "{line}"
        );
        let kind = refusal("a.las", "");
        assert!(
            kind.to_string().ends_with(
                "a.las: unknown extension `las`, known: obj, stl, ply, \
                gltf, glb, 3mf, xyz, txt, asc"
            ),
            "{kind}"
        );
        assert!(
            refusal("empty.xyz", "")
                .to_string()
                .ends_with("empty.xyz: 0 points, at least 32 are needed")
        );
        assert!(
            refusal("bad.xyz", "0 0 0\n1 2 z\n")
                .to_string()
                .ends_with("bad.xyz:2: `z` is no number")
        );
        assert!(matches!(
            load(Path::new("none.ply"), 1.0, None),
            Err(LoadError::File(MeshError::Missing { .. }))
        ));
    }
}
