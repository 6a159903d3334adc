//! Voxmap in, pointshell out: the stages in order.

use std::time::Instant;

use glam::DVec3;
use rayon::prelude::*;

use super::project::{SurfacePoint, project};
use super::{normals, shell::Shell};
use crate::mesh::TriangleMesh;
use crate::voxmap::Voxmap;

/// What was built.
#[derive(Clone, Copy, Debug, Default)]
pub struct ShellReport {
    /// Points, one per surface voxel.
    pub points: usize,
    /// Points whose projection landed inside a triangle.
    pub phase1_points: usize,
    /// Points on edges and corners, for voxels that phase 1 left empty.
    pub phase2_points: usize,
    /// Seconds for projection and ordering.
    pub project_s: f64,
    /// Seconds for normals.
    pub normals_s: f64,
}

/// Builds the shell of an object about `center_of_mass_tool` (tool frame, m).
///
/// Points are ordered along a Morton curve over their voxels, so that neighbours in memory are neighbours in space. Cost: linear
/// in the number of points (plus a sort).
pub fn build(mesh: &TriangleMesh, map: &Voxmap, center_of_mass_tool: DVec3) -> (Shell, ShellReport) {
    let mesh = map.mesh(mesh);
    let grid = &map.surface.grid;
    let since = Instant::now();
    let mut points = project(mesh, &map.surface);
    points.par_sort_unstable_by_key(|point| morton(point.cell));
    let project_s = since.elapsed().as_secs_f64();
    let since = Instant::now();
    let placed: Vec<(DVec3, DVec3)> = points
        .par_iter()
        .map(|point| {
            let position_tool = grid.origin_m + point.cells * grid.voxel_size_m;
            (position_tool - center_of_mass_tool, normals::normal(mesh, map, point))
        })
        .collect();
    let normals_s = since.elapsed().as_secs_f64();
    let phase2_points = points.iter().filter(|point: &&SurfacePoint| point.on_boundary).count();
    let report =
        ShellReport { points: points.len(), phase1_points: points.len() - phase2_points, phase2_points, project_s, normals_s };
    (Shell::new(&placed, grid.voxel_size_m), report)
}

/// Interleaves the bits of a cell's coordinates.
fn morton(cell: [i32; 3]) -> u64 {
    let spread = |i: i32| {
        let mut bits = i as u64 & 0x1f_ffff;
        for (shift, mask) in [
            (32, 0x001f_0000_0000_ffff),
            (16, 0x001f_0000_ff00_00ff),
            (8, 0x100f_00f0_0f00_f00f),
            (4, 0x10c3_0c30_c30c_30c3),
            (2, 0x1249_2492_4924_9249),
        ] {
            bits = (bits | bits << shift) & mask;
        }
        bits
    };
    spread(cell[0]) << 2 | spread(cell[1]) << 1 | spread(cell[2])
}
