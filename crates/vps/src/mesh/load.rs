//! From a file to a mesh in metres.

use std::path::{Path, PathBuf};

use glam::DVec3;

#[cfg(feature = "gltf")]
use super::gltf;
#[cfg(feature = "threemf")]
use super::threemf;
use super::{FileMesh, Foreign, Format, MeshError, TriangleMesh, obj, ply, source, stl};
use crate::parallel;

/// No part is this far from its origin; squares and fifth powers of what is nearer stay far inside
/// the range of `f64`.
pub(crate) const FARTHEST_M: f64 = 1e9;
/// Vertices that are scaled in one go.
const CHUNK_VERTICES: usize = 4096;

/// Reads a mesh file, the format chosen by its extension (any case), and scales it to metres.
///
/// Groups and objects of a file become one mesh. Materials, normals and texture coordinates are not
/// read: normals of CAD files are unreliable, and nothing here needs the others.
///
/// # Errors
/// [`MeshError`], naming the path and, where it is known, the line.
pub fn load(path: &Path, metres_per_unit: f64) -> Result<TriangleMesh, MeshError> {
    load_with_notes(path, metres_per_unit).map(|file| file.mesh)
}

/// The same, with what a user should know of the file.
///
/// # Errors
/// As [`load`].
pub fn load_with_notes(path: &Path, metres_per_unit: f64) -> Result<FileMesh, MeshError> {
    let format = Format::of(path)?;
    let bytes = source::read(path)?;
    bytes.confirm(parse_with_notes(&bytes, format, path, metres_per_unit), path)
}

/// The same for a file whose bytes are at hand. `path` is for messages, and where files that this
/// one names are looked for.
///
/// Damaged bytes give an error, never a panic; no allocation is larger than a small multiple of
/// `bytes`.
///
/// # Errors
/// [`MeshError`], naming the path and, where it is known, the line or the byte.
pub fn parse(
    bytes: &[u8],
    format: Format,
    path: &Path,
    metres_per_unit: f64,
) -> Result<TriangleMesh, MeshError> {
    parse_with_notes(bytes, format, path, metres_per_unit).map(|file| file.mesh)
}

/// The same, with what a user should know of the file.
///
/// # Errors
/// As [`parse`].
pub fn parse_with_notes(
    bytes: &[u8],
    format: Format,
    path: &Path,
    metres_per_unit: f64,
) -> Result<FileMesh, MeshError> {
    if bytes.is_empty() {
        return Err(MeshError::NoBytes { path: path.to_owned() });
    }
    let read = match format {
        Format::Obj => obj::parse(bytes, path).map(FileMesh::from),
        Format::Stl => stl::parse(bytes, path),
        Format::Ply => ply::parse(bytes, path),
        #[cfg(feature = "gltf")]
        Format::Gltf => gltf::parse(bytes, path),
        #[cfg(feature = "threemf")]
        Format::ThreeMf => threemf::parse(bytes, path, metres_per_unit),
        #[cfg(not(all(feature = "gltf", feature = "threemf")))]
        other => Err(MeshError::NotBuilt { path: path.to_owned(), format: other }),
    };
    let read = match read {
        Ok(file) if file.mesh.triangles.is_empty() => {
            Err(MeshError::Empty { path: path.to_owned() })
        }
        read => read,
    };
    // Only now: the free text at the head of a binary STL may say anything.
    let mut file = read.map_err(|error| named_for_what_it_is(error, bytes, Some(format), path))?;
    scale(&mut file.mesh.vertices, metres_per_unit, path)?;
    file.rounding = file.rounding.map(|rounding| rounding.scaled(metres_per_unit));
    Ok(file)
}

/// `error` of a file that no reader could read, unless it is something else than its name says.
/// `named`: the format of a mesh.
pub(super) fn named_for_what_it_is(
    error: MeshError,
    bytes: &[u8],
    named: Option<Format>,
    path: &Path,
) -> MeshError {
    let found = Format::recognise(bytes);
    match (found, named, Foreign::recognise(bytes)) {
        (Some(found), Some(named), _) if found != named => {
            MeshError::OtherFormat { path: path.to_owned(), found, named }
        }
        (None, _, Some(found)) => MeshError::NotAMesh { path: path.to_owned(), found },
        _ => error,
    }
}

/// From the unit of the file to metres; refuses what is not finite, and what no part can be.
pub(super) fn scale(
    vertices: &mut [DVec3],
    metres_per_unit: f64,
    path: &Path,
) -> Result<(), MeshError> {
    let mut chunks: Vec<_> = vertices.chunks_mut(CHUNK_VERTICES).collect();
    let wrong = parallel::map_mut(&mut chunks, 1, |chunk_idx, chunk| {
        chunk.iter_mut().for_each(|vertex| *vertex *= metres_per_unit);
        let wrong = chunk
            .iter()
            .position(|vertex| !vertex.is_finite() || vertex.abs().max_element() > FARTHEST_M)?;
        Some((chunk_idx * CHUNK_VERTICES + wrong, chunk[wrong]))
    });
    match wrong.into_iter().flatten().next() {
        None => Ok(()),
        Some((vertex_idx, vertex)) if vertex.is_finite() => {
            let distance_m = vertex.abs().max_element();
            Err(MeshError::FarVertex { path: path.to_owned(), vertex: vertex_idx + 1, distance_m })
        }
        Some((vertex_idx, _)) => Err(MeshError::NonFiniteVertex {
            path: path.to_owned(),
            vertex: vertex_idx + 1,
            line: None,
        }),
    }
}

/// From now on no mesh file is mapped into memory in this process, only copied: for a process that
/// renders forces. A mapped file that another program shortens would end it.
pub fn copy_only() {
    source::copy_only();
}

/// Other files that a mesh file takes its triangles from: the buffers that a glTF file names. Every
/// other format has all in one.
///
/// # Errors
/// [`MeshError`] of a glTF file that cannot be read, or that names what it must not.
pub fn companions(path: &Path) -> Result<Vec<PathBuf>, MeshError> {
    match Format::of(path)? {
        #[cfg(feature = "gltf")]
        Format::Gltf => {
            let bytes = source::read(path)?;
            bytes.confirm(gltf::companions(&bytes, path), path)
        }
        _ => Ok(Vec::new()),
    }
}
