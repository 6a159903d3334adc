//! One point per surface voxel: the closest point of the surface to the voxel's centre, in two phases.
//!
//! # Source
//! Sagardia2008, section 4. Phase 1 keeps projections that land inside a triangle; phase 2 takes a projection on an edge or
//! corner only for a voxel that phase 1 left without a point. The paper is silent on several phase-1 points in one voxel; ours
//! keeps the one nearest to the voxel's centre and lets the lowest triangle number win a tie, in both phases, which makes the
//! result independent of the order of work.

use core::sync::atomic::{AtomicU64, Ordering};

use glam::DVec3;
use rayon::prelude::*;

use crate::mesh::TriangleMesh;
use crate::mesh::closest_point::TriangleProjector;
use crate::voxmap::surface::Surface;

/// The point of one surface voxel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfacePoint {
    /// The voxel it belongs to.
    pub cell: [i32; 3],
    /// Position, cell coordinates.
    pub cells: DVec3,
    /// Triangle it lies on.
    pub triangle_idx: u32,
    /// Found in phase 2.
    pub on_boundary: bool,
}

/// Set in the key of a projection on an edge or corner, so that any interior projection sorts before it.
const BOUNDARY: u64 = 1 << 63;

/// Projects every surface voxel's centre on the triangles that touch the voxel and keeps one point each, in order of rank.
///
/// Runs on the current rayon pool. Cost: one projection per touching pair of voxel and triangle.
pub fn project(mesh: &TriangleMesh, surface: &Surface) -> Vec<SurfacePoint> {
    // The key sorts by phase, then squared distance, then triangle: one atomic minimum does both phases and breaks ties.
    let keys: Vec<AtomicU64> = (0..surface.n_voxels).map(|_| AtomicU64::new(u64::MAX)).collect();
    surface.for_each_hit(mesh, TriangleProjector::new, |triangle_idx, projector, cell, rank| {
        let projection = projector.project(center(cell));
        let phase = if projection.region.is_interior() { 0 } else { BOUNDARY };
        let distance = u64::from((projection.distance_squared as f32).to_bits()) << 32;
        // Relaxed: a minimum needs no order; the join publishes it.
        keys[rank].fetch_min(phase | distance | u64::from(triangle_idx), Ordering::Relaxed);
    });
    let cells: Vec<[i32; 3]> = surface.cells().collect();
    cells
        .into_par_iter()
        .zip(keys)
        .map(|(cell, key)| {
            let key = key.into_inner();
            let triangle_idx = key as u32;
            let corners = mesh.corners(triangle_idx as usize).map(|corner| surface.grid.to_cells(corner));
            let point = TriangleProjector::new(&corners).project(center(cell)).point;
            SurfacePoint { cell, cells: point, triangle_idx, on_boundary: key & BOUNDARY != 0 }
        })
        .collect()
}

fn center(cell: [i32; 3]) -> DVec3 {
    DVec3::new(cell[0].into(), cell[1].into(), cell[2].into()) + 0.5
}
