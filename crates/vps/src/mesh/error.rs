//! Why a mesh file cannot be used: one enum for the whole module.

use std::io;
use std::path::PathBuf;

use super::{Foreign, Format};
use crate::setting_names::SettingNames;

/// A mesh file that cannot be used. Messages read well after "failed to load the mesh: ";
/// [`MeshError::hint`] says what to do.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum MeshError {
    /// No such file.
    #[error("{}: no such file", path.display())]
    Missing {
        /// As given.
        path: PathBuf,
    },
    /// The file is there, but it cannot be read.
    #[error("{}: cannot be read: {source}", path.display())]
    Unreadable {
        /// As given.
        path: PathBuf,
        /// What the operating system said.
        source: io::Error,
    },
    /// The extension names no known format.
    #[error("{}: {}, known: {}", path.display(), what_extension(extension), super::EXTENSIONS.join(", "))]
    UnknownExtension {
        /// As given.
        path: PathBuf,
        /// Lower case, without the dot; empty when there is none.
        extension: String,
    },
    /// A format of CAD programs that has no triangles.
    #[error("{}: {}", path.display(), curved_surfaces(format))]
    CurvedSurfaces {
        /// As given.
        path: PathBuf,
        /// Its name.
        format: &'static str,
    },
    /// A format that this build leaves out.
    #[error("{}: this build of `vps` does not read {}", path.display(), format.name())]
    NotBuilt {
        /// As given.
        path: PathBuf,
        /// Its format.
        format: Format,
    },
    /// There is nothing in the file.
    #[error("{}: no triangles: the file is empty", path.display())]
    NoBytes {
        /// As given.
        path: PathBuf,
    },
    /// The file begins like one of another format than its extension names.
    #[error("{}: this is a file of the format {}, and its name says {}", path.display(), found.name(), named.name())]
    OtherFormat {
        /// As given.
        path: PathBuf,
        /// What the file is.
        found: Format,
        /// What its extension says.
        named: Format,
    },
    /// The file is no mesh of any format.
    #[error("{}: this is {}", path.display(), found.what())]
    NotAMesh {
        /// As given.
        path: PathBuf,
        /// What it is.
        found: Foreign,
    },
    /// No triangle of the mesh has an area.
    #[error("{}: none of the {triangles} triangles has an area", path.display())]
    NoArea {
        /// As given.
        path: PathBuf,
        /// How many there are.
        triangles: usize,
    },
    /// The text or the layout of the file is wrong.
    #[error("{}{}: {what}", path.display(), at_line(*line))]
    Parse {
        /// As given.
        path: PathBuf,
        /// Line of the file, from 1, where it is known.
        line: Option<usize>,
        /// What is wrong, with the text at that place.
        what: String,
    },
    /// The same for a file of numbers, which has no lines.
    #[error("{}: byte {offset_bytes}: {what}", path.display())]
    Binary {
        /// As given.
        path: PathBuf,
        /// Where in the file, from 0.
        offset_bytes: u64,
        /// What is wrong, with the value at that place.
        what: String,
    },
    /// A coordinate is not a number or infinite, in the file or after scaling to metres.
    #[error("{}{}: vertex {vertex} is not finite", path.display(), at_line(*line))]
    NonFiniteVertex {
        /// As given.
        path: PathBuf,
        /// Number of the vertex, from 1, in the order of the file (for STL: of the corner).
        vertex: usize,
        /// Line of the file, from 1, where it is known.
        line: Option<usize>,
    },
    /// A coordinate is so large that it cannot belong to a part.
    #[error("{}: vertex {vertex} is {distance_m:.1e} m away from the origin", path.display())]
    FarVertex {
        /// As given.
        path: PathBuf,
        /// Number of the vertex, from 1.
        vertex: usize,
        /// Its largest coordinate.
        distance_m: f64,
    },
    /// The file is sound and holds no triangle.
    #[error("{}: no triangles", path.display())]
    Empty {
        /// As given.
        path: PathBuf,
    },
    /// A face names a vertex that is not there.
    #[error("{}{}: face names vertex {index}, the file has {vertices}", path.display(), at_line(*line))]
    IndexOutOfRange {
        /// As given.
        path: PathBuf,
        /// Line of the file, from 1, where it is known.
        line: Option<usize>,
        /// As written: from 1, or negative to count back from the last.
        index: i64,
        /// Number of vertices in the file.
        vertices: usize,
    },
    /// The file is shorter than it says.
    #[error("{}: truncated, {expected_bytes} bytes expected for {triangles} triangles, \
        {found_bytes} found", path.display())]
    Truncated {
        /// As given.
        path: PathBuf,
        /// Number of triangles that the header announces; 0 when the header itself is cut.
        triangles: u64,
        /// Size that follows from it.
        expected_bytes: u64,
        /// Size of the file.
        found_bytes: u64,
    },
    /// The file names its own unit, and the caller another.
    #[error("{}: the file says {unit} ({file_metres_per_unit} m), not {metres_per_unit} m", path.display())]
    UnitConflict {
        /// As given.
        path: PathBuf,
        /// Name of the unit in the file.
        unit: &'static str,
        /// Metres in the unit of the file.
        file_metres_per_unit: f64,
        /// Metres in the unit asked for.
        metres_per_unit: f64,
    },
    /// Nodes of the file place so many copies of its meshes that they would fill the memory.
    #[error("{}: copies of its meshes make more than {most} vertices or triangles", path.display())]
    TooManyCopies {
        /// As given.
        path: PathBuf,
        /// The largest number of either.
        most: usize,
    },
    /// The file needs more memory than is free.
    #[error("{}: {file_bytes} bytes are too large for the {free_bytes} bytes of free memory", path.display())]
    TooLarge {
        /// As given.
        path: PathBuf,
        /// Size of the file.
        file_bytes: u64,
        /// Memory that the system can give.
        free_bytes: u64,
    },
    /// Another program wrote to the file while it was read.
    #[error("{}: changed while it was read", path.display())]
    Changed {
        /// As given.
        path: PathBuf,
    },
}

impl MeshError {
    /// What to do about it, where there is something to say.
    pub fn hint(&self, names: &SettingNames) -> Option<String> {
        let unit = names.unit;
        let hint = match self {
            Self::Missing { .. } => None,
            Self::Unreadable { .. } => {
                Some("check that it is a file and that this user may read it")
            }
            Self::CurvedSurfaces { .. } => return Some(super::cad_hint(names)),
            Self::UnknownExtension { .. } => Some("export the part as STL or OBJ"),
            Self::NotBuilt { .. } => Some(
                "build `vps` with its features `gltf` and `threemf`, or export the part as STL or \
                    OBJ",
            ),
            Self::NoBytes { .. } => {
                Some("copy or export it again: the program that wrote it may have failed")
            }
            Self::OtherFormat { found, .. } => Some(found.rename_hint()),
            Self::NotAMesh { found, .. } => return Some(found.hint(names)),
            Self::NoArea { .. } => Some(
                "export the part as a surface: points and lines written as triangles cannot be felt",
            ),
            Self::Parse { .. } | Self::Binary { .. } => {
                Some("export the mesh again, or open and save it in a mesh editor")
            }
            Self::NonFiniteVertex { .. } | Self::FarVertex { .. } => {
                return Some(format!("remove the vertex in a mesh editor, and check {unit}"));
            }
            Self::Empty { .. } => {
                Some("export a surface mesh: points, lines and curves are not rendered")
            }
            Self::IndexOutOfRange { .. } => Some("the file is damaged or was cut: export it again"),
            Self::Truncated { .. } => Some("the file was cut: copy or export it again"),
            Self::UnitConflict { .. } => {
                return Some(format!(
                    "set {unit} to that of the file; export micron and foot as millimetres"
                ));
            }
            Self::TooManyCopies { .. } => {
                Some("export only the part that is to be felt, or a coarser mesh")
            }
            Self::TooLarge { .. } => {
                Some("reduce the mesh: triangles smaller than a voxel add nothing that can be felt")
            }
            Self::Changed { .. } => Some("wait until the program that writes the file is done"),
        };
        hint.map(str::to_owned)
    }
}

/// What is said of a file of [`cad_format`](super::cad_format).
pub fn curved_surfaces(format: &str) -> String {
    format!("{format} files hold curved surfaces, and a mesh of triangles is needed")
}

fn what_extension(extension: &str) -> String {
    if extension.is_empty() {
        "no mesh extension".to_owned()
    } else {
        format!("unknown mesh extension `{extension}`")
    }
}

/// The middle of `path:line: message`.
fn at_line(line: Option<usize>) -> String {
    line.map(|line| format!(":{line}")).unwrap_or_default()
}
