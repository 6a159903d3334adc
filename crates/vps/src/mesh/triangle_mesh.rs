//! What every reader and every shape gives.

use glam::DVec3;

use crate::parallel;

/// Sums over triangles are taken in pieces of this many, in parallel, and the pieces added in
/// order: the rounding is then the same for any number of threads.
pub(super) const SUM_TRIANGLES: usize = 1 << 16;

/// Triangles over shared vertices, metres, in the mesh file's own frame.
#[derive(Clone, Debug, Default)]
pub struct TriangleMesh {
    /// `[n_vertices]`, metres.
    pub vertices: Vec<DVec3>,
    /// `[n_triangles]`, counter-clockwise seen from outside when the file is sound; every index is
    /// below `vertices.len()`.
    pub triangles: Vec<[u32; 3]>,
}

impl TriangleMesh {
    /// The three corners of triangle `triangle_idx`, metres.
    pub fn corners(&self, triangle_idx: usize) -> [DVec3; 3] {
        self.triangles[triangle_idx].map(|vertex| self.vertices[vertex as usize])
    }

    /// Lowest and highest corner of the box around the vertices that triangles use; `None` for an
    /// empty mesh.
    pub fn bounds(&self) -> Option<(DVec3, DVec3)> {
        let around = |corners: &[[u32; 3]]| {
            let mut used = corners.iter().flatten().map(|vertex| self.vertices[*vertex as usize]);
            let first = used.next()?;
            Some(
                used.fold((first, first), |(low, high), vertex| {
                    (low.min(vertex), high.max(vertex))
                }),
            )
        };
        let boxes = parallel::map_chunks(&self.triangles, SUM_TRIANGLES, around);
        boxes.into_iter().flatten().reduce(|(low, high), (other_low, other_high)| {
            (low.min(other_low), high.max(other_high))
        })
    }
}
