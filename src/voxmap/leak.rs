//! Did the fill get in, and is there an inside at all? A closed mesh leaves no gap between its voxels, so there the volume inside is enough of a check; a mesh
//! with open edges is probed.
//!
//! An open edge alone proves nothing: real CAD exports hold edges that do not match up although the faces meet. A leak shows
//! where the space on *both* sides of a face was flooded although the winding number on one side says "within". Sheets and
//! bowls show the same and get the same answer: a thin two-sided skin, never a solid by accident (decision: thin objects).
//!
//! A closed part thinner than a voxel has no cell inside: as a solid it would not be felt. When most of the surface is like
//! that the object becomes a thin skin too.

use core::f64::consts::PI;

use glam::DVec3;
use rayon::prelude::*;

use super::fill::{Side, Sides};
use super::surface::Surface;
use crate::mesh::TriangleMesh;
use crate::mesh::validate::MeshReport;

/// Where the fill got in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Leak {
    /// Centre of the largest hole, mesh frame, m.
    pub position_m: DVec3,
    /// Diameter of a disc of the hole's area, m.
    pub size_m: f64,
}

/// |winding number| from which a flooded point counts as lying within: 1 inside a closed surface, ½ beside a large sheet, 0 apart.
const WITHIN: f64 = 0.3;
/// Share of the surface that must be flooded on both sides before the object counts as leaking.
const SHARE: f64 = 0.02;

/// Surface with outside on both of its sides from which on the whole object counts as a thin skin.
pub const MOSTLY_THIN: f64 = 0.5;

/// What the faces of an object say of its fill.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FaceProbe {
    /// Where the fill got in, if it did.
    pub leak: Option<Leak>,
    /// Share of the surface that is thinner than the voxels resolve: outside on both sides, and rightly so.
    pub thin_share: f64,
}

impl FaceProbe {
    /// Looks at both sides of faces drawn in proportion to their area. Cost: O(samples), and for a mesh that may leak
    /// O(samples · triangles), bounded to about 4·10⁶ triangle terms, or 32 samples.
    pub fn new(mesh: &TriangleMesh, report: &MeshReport, surface: &Surface, sides: &Sides) -> Self {
        let may_leak = !(report.closed && fills_its_volume(report, surface, sides));
        let n_samples = (4_000_000 / mesh.triangles.len().max(1)).clamp(32, 512);
        let samples = by_area(mesh, n_samples);
        let n_samples: usize = samples.iter().map(|(_, weight)| weight).sum();
        let outside_twice: Vec<(usize, Option<DVec3>)> = samples
            .par_iter()
            .filter_map(|(triangle_idx, weight)| {
                let beside = outside_on_both_sides(mesh, surface, sides, *triangle_idx)?;
                let within = |point: &DVec3| may_leak && winding_number(mesh, *point).abs() > WITHIN;
                Some((*weight, beside.into_iter().find(within)))
            })
            .collect();
        let share = |flooded: bool| {
            let weights = outside_twice.iter().filter(|(_, within)| within.is_some() == flooded).map(|(weight, _)| *weight);
            weights.sum::<usize>() as f64 / n_samples.max(1) as f64
        };
        let leak = outside_twice.iter().find_map(|(_, within)| *within).filter(|_| share(true) >= SHARE).map(|flooded| {
            let largest = report.boundary_loops.first().filter(|hole| hole.size_m > surface.grid.voxel_size_m);
            match largest {
                Some(hole) => Leak { position_m: hole.center_m, size_m: hole.size_m },
                None => Leak { position_m: flooded, size_m: surface.grid.voxel_size_m },
            }
        });
        Self { leak, thin_share: share(false) }
    }
}

/// True when the cells inside make up what the mesh's volume leaves beside its surface cells, to a quarter: parts that overlap or
/// nest count their volume twice. A volume of surface cells only says nothing.
fn fills_its_volume(report: &MeshReport, surface: &Surface, sides: &Sides) -> bool {
    let cell_m3 = surface.grid.voxel_size_m.powi(3);
    let expected_m3 = report.signed_volume_m3.abs() - surface.n_voxels as f64 * cell_m3;
    sides.count_inside(surface) as f64 * cell_m3 >= 0.25 * expected_m3
}

/// Triangles drawn in proportion to their area, evenly and without chance, with how often each was drawn.
fn by_area(mesh: &TriangleMesh, n_samples: usize) -> Vec<(usize, usize)> {
    let area = |triangle_idx| {
        let [a, b, c] = mesh.corners(triangle_idx);
        (b - a).cross(c - a).length()
    };
    let total: f64 = (0..mesh.triangles.len()).map(area).sum();
    let per_area = if total > 0.0 { n_samples as f64 / total } else { 0.0 };
    let (mut samples, mut passed, mut drawn) = (Vec::with_capacity(n_samples), 0.0, 0);
    for triangle_idx in 0..mesh.triangles.len() {
        passed += area(triangle_idx);
        let due = (passed * per_area + 0.5) as usize;
        if due > drawn {
            samples.push((triangle_idx, due - drawn));
            drawn = due;
        }
    }
    samples
}

/// The first points off the surface on either side of a triangle, when both are outside; mesh frame.
fn outside_on_both_sides(mesh: &TriangleMesh, surface: &Surface, sides: &Sides, triangle_idx: usize) -> Option<[DVec3; 2]> {
    let grid = &surface.grid;
    let corners = mesh.corners(triangle_idx);
    let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize_or_zero();
    let center = (corners[0] + corners[1] + corners[2]) / 3.0;
    let beside = |direction: DVec3| {
        (1..=6).map(|half_voxels| center + direction * (0.5 * f64::from(half_voxels) * grid.voxel_size_m)).find_map(|point| {
            let cell = grid.to_cells(point).floor();
            match sides.side(surface, [cell.x as i32, cell.y as i32, cell.z as i32]) {
                Side::Surface => None,
                side => Some((side, point)),
            }
        })
    };
    match (beside(normal)?, beside(-normal)?) {
        ((Side::Outside, front), (Side::Outside, back)) => Some([front, back]),
        _ => None,
    }
}

/// How often the surface winds around a point: Σ solid angles / 4π (van Oosterom and Strackee 1983).
fn winding_number(mesh: &TriangleMesh, point: DVec3) -> f64 {
    let solid_angles: f64 = (0..mesh.triangles.len())
        .map(|triangle_idx| {
            let [a, b, c] = mesh.corners(triangle_idx).map(|corner| corner - point);
            let (la, lb, lc) = (a.length(), b.length(), c.length());
            let numerator = a.dot(b.cross(c));
            let denominator = la * lb * lc + a.dot(b) * lc + b.dot(c) * la + c.dot(a) * lb;
            2.0 * numerator.atan2(denominator)
        })
        .sum();
    solid_angles / (4.0 * PI)
}
