//! How large a mesh may become when a file places copies of its parts.
//!
//! A kilobyte of nodes that all name one mesh can ask for more triangles than there is memory. A
//! mesh that is written once is as large as its file at most; copies beyond that are counted.

use std::path::Path;

use super::MeshError;
use crate::storage::memory;

/// Vertices, and triangles, that copies may add: an assembly of thousands of screws fits, and half
/// a gigabyte is enough for it.
const COPIES: usize = 1 << 24;
/// Memory that one of them and one triangle take while the mesh is read and inspected, bytes.
const COPY_BYTES: u64 = 128;
/// Placed parts beyond one per byte of the file.
const PARTS: usize = 1 << 20;

/// What is left of the largest number of vertices, of triangles, and of placed parts.
#[derive(Clone, Copy, Debug)]
pub(super) struct CopyBudget {
    most: usize,
    vertices: usize,
    triangles: usize,
    parts: usize,
}

impl CopyBudget {
    /// For a file of this size.
    pub(super) fn of_file(bytes: usize) -> Self {
        // No more than there is memory for: copies cost the file nothing.
        let copies = memory::available_bytes()
            .map_or(COPIES, |bytes| COPIES.min((bytes / COPY_BYTES) as usize));
        let most = bytes.saturating_add(copies).min(u32::MAX as usize);
        Self { most, vertices: most, triangles: most, parts: bytes.saturating_add(PARTS) }
    }

    /// More of the file was read.
    pub(super) fn grow(&mut self, bytes: usize) {
        let more = bytes.min(u32::MAX as usize - self.most);
        self.most += more;
        self.vertices += more;
        self.triangles += more;
    }

    /// Takes one more part out of the budget; refuses when it does not fit, before anything is
    /// made.
    pub(super) fn add(
        &mut self,
        vertices: usize,
        triangles: usize,
        path: &Path,
    ) -> Result<(), MeshError> {
        let take =
            |left: &mut usize, amount: usize| left.checked_sub(amount).map(|rest| *left = rest);
        let taken = [
            take(&mut self.vertices, vertices),
            take(&mut self.triangles, triangles),
            take(&mut self.parts, 1),
        ];
        if taken.contains(&None) {
            return Err(MeshError::TooManyCopies { path: path.to_owned(), most: self.most });
        }
        Ok(())
    }
}
