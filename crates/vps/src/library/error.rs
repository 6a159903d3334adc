//! The one error of the library.

use std::io;
use std::path::PathBuf;

use thiserror::Error;

use crate::mesh::MeshError;
use crate::part::PartError;
use crate::setting_names::SettingNames;
use crate::voxmap::grid::{GridError, round_up};

/// Why a call failed. The text says what is wrong, where, and what to do.
///
/// # Examples
/// ```
/// # use vps::{Error, Mesh, Shape};
/// let error = Mesh::from_shape(&Shape::Sphere { radius_m: 0.0 }, 1e-5).unwrap_err();
/// assert!(matches!(error, Error::Value { found: 0.0, .. }));
/// assert_eq!(
///     error.to_string(),
///     "a size of the shape is 0: give metres, from 1 nm to 1000 km"
/// );
/// ```
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum Error {
    /// A mesh file that cannot be used. The text names the file and, where it is known, the line.
    #[error("{source}{}", mesh_hint(source))]
    Mesh {
        /// Cause, with the file.
        #[doc(hidden)]
        source: MeshError,
    },
    /// Arrays that are no mesh.
    #[error("mesh from arrays: {what}")]
    Arrays {
        /// What is wrong, where, and what to do.
        what: String,
    },
    /// Voxels that cannot be baked: too many for one map, or for the memory that the system has
    /// left.
    #[error("{mesh}: {source}; {}", grid_hint(source))]
    Grid {
        /// Name of the mesh: its file, or what it was made from.
        mesh: String,
        /// Cause.
        #[doc(hidden)]
        source: GridError,
    },
    /// A number outside of what its name allows.
    #[error("{name} is {found}: give {wanted}")]
    Value {
        /// Name of the argument or field, with its unit.
        name: &'static str,
        /// What was given.
        found: f64,
        /// What is allowed.
        wanted: &'static str,
    },
    /// A pose that is none.
    #[error("pose {index}: {what}")]
    Pose {
        /// Number of the pose in a batch, from 0; 0 of a single one.
        index: usize,
        /// What is wrong, and what to do.
        what: String,
    },
    /// A file of a baked part that cannot be written or used.
    #[error("{}: {what}", path.display())]
    File {
        /// As given.
        path: PathBuf,
        /// What is wrong, and what to do.
        what: String,
        /// What the operating system said, where it refused.
        source: Option<io::Error>,
    },
    /// Bytes that hold no baked part.
    #[error("baked part from bytes: {what}")]
    Bytes {
        /// What is wrong, and what to do.
        what: String,
    },
    /// A voxmap without the gradients that a query is to read.
    #[error(
        "the field surface-point needs voxmaps that are baked for it: bake them for this field"
    )]
    Field,
    /// A callback ended a bake or a search.
    #[error("cancelled by its callback")]
    Cancelled,
}

impl Error {
    /// What the operating system said, where it refused a file.
    ///
    /// # Examples
    /// ```
    /// # let folder = tempfile::tempdir().unwrap();
    /// let error = vps::Voxmap::load(folder.path().join("missing")).unwrap_err();
    /// assert_eq!(error.os_error().and_then(std::io::Error::raw_os_error), Some(2)); // ENOENT
    /// ```
    pub fn os_error(&self) -> Option<&io::Error> {
        match self {
            Self::File { source, .. } => source.as_ref(),
            Self::Mesh { source: MeshError::Unreadable { source, .. } } => Some(source),
            _ => None,
        }
    }
}

impl From<PartError> for Error {
    fn from(error: PartError) -> Self {
        match error {
            PartError::Mesh { source, .. } => Self::Mesh { source },
            PartError::Grid { source: GridError::Cancelled, .. } => Self::Cancelled,
            PartError::Grid { name, source } => Self::Grid { mesh: name, source },
        }
    }
}

/// What to do, after a semicolon.
fn mesh_hint(error: &MeshError) -> String {
    error.hint(&SettingNames::PLAIN).map(|hint| format!("; {hint}")).unwrap_or_default()
}

/// What to do, with the voxel size that fits in the unit of `voxel_size_m` too.
fn grid_hint(error: &GridError) -> String {
    let fits = error
        .fitting_voxel_size_m()
        .map(|voxel_size_m| format!(" (voxel_size_m = {})", round_up(voxel_size_m)));
    error.hint(&SettingNames::PLAIN) + &fits.unwrap_or_default()
}

/// Refuses a number that is not within a range, or is not a number.
pub(super) fn check(
    name: &'static str,
    found: f64,
    range: core::ops::RangeInclusive<f64>,
    wanted: &'static str,
) -> Result<(), Error> {
    if range.contains(&found) { Ok(()) } else { Err(Error::Value { name, found, wanted }) }
}
