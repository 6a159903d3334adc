//! What a reader gives: a mesh, and what a user should know of its file.

use super::TriangleMesh;

/// A mesh as a file has it.
#[derive(Clone, Debug, Default)]
pub struct FileMesh {
    /// Its triangles.
    pub mesh: TriangleMesh,
    /// What the file has and the mesh has not, and what was read otherwise than the file says; a
    /// sentence each, of one line.
    pub notes: Vec<String>,
}

impl From<TriangleMesh> for FileMesh {
    fn from(mesh: TriangleMesh) -> Self {
        Self { mesh, notes: Vec::new() }
    }
}

/// Things by their names, for a sentence; a file may have thousands.
#[cfg(any(feature = "gltf", feature = "threemf"))]
pub(super) fn listed(names: &[String]) -> String {
    const MOST_NAMED: usize = 6;
    let named = names[..names.len().min(MOST_NAMED)].join(", ");
    match names.len().saturating_sub(MOST_NAMED) {
        0 => named,
        more => format!("{named} and {more} more"),
    }
}
