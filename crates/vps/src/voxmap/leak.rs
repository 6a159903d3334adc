//! Did the fill get in, and is there an inside at all? A closed mesh leaves no gap between its
//! voxels, so there the volume inside is enough of a check; a mesh with open edges is probed.
//!
//! An open edge alone proves nothing: real CAD exports hold edges that do not match up although the
//! faces meet. A leak shows where the space on *both* sides of a face was flooded although the
//! winding number on one side says "within". Sheets and bowls show the same.
//!
//! A closed part thinner than a voxel has no cell inside: as a solid it would not be felt. When
//! most of the surface is like that the object becomes a thin skin.

use glam::DVec3;

use super::fill::{Side, Sides};
use super::surface::Surface;
use super::winding::WindingTree;
use crate::mesh::TriangleMesh;
use crate::mesh::validate::MeshReport;
use crate::parallel;

/// Where the fill got in.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Leak {
    /// Centre of the widest hole, mesh frame, m.
    pub position_m: DVec3,
    /// Width of the hole, m, however long it is.
    pub size_m: f64,
}

/// |winding number| from which a flooded point counts as lying within: 1 inside a closed surface, ½ beside a large sheet, 0 apart.
const WITHIN: f64 = 0.3;
/// Share of the surface that must be flooded on both sides before the object counts as leaking.
pub(super) const LEAKING: f64 = 0.02;
/// A winding number is clear when it is this near to a whole number.
const CLEAR: f64 = 0.1;
/// Places that are looked at.
const N_SAMPLES: usize = 512;
/// Triangles whose areas are summed by one thread; fixed, so that sums do not depend on the number
/// of threads.
const CHUNK: usize = 1024;

/// Surface with outside on both of its sides from which on the whole object counts as a thin skin.
pub const MOSTLY_THIN: f64 = 0.5;

/// Places on the surface, spread evenly over its area and without chance.
pub(super) struct FaceSamples<'a> {
    mesh: &'a TriangleMesh,
    /// Triangle, and place on it, mesh frame, m.
    drawn: Vec<(usize, DVec3)>,
}

/// The first points off the surface along a face's normal and against it, mesh frame, m.
type Beside = [(Side, DVec3); 2];

/// What the faces of an object say of its fill.
pub(super) struct FaceProbe {
    /// Where the fill got in, if it did.
    pub(super) leak: Option<Leak>,
    /// Share of the surface that is thinner than the voxels resolve: outside on both sides, and
    /// rightly so.
    pub(super) thin_share: f64,
    /// Winding numbers, where they had to be asked.
    pub(super) winding: Option<WindingTree>,
}

impl<'a> FaceSamples<'a> {
    /// Draws some 500 places. Cost: O(triangles).
    pub(super) fn draw(mesh: &'a TriangleMesh) -> Self {
        let n_triangles = mesh.triangles.len();
        let area = |triangle_idx| {
            let [a, b, c] = mesh.corners(triangle_idx);
            (b - a).cross(c - a).length()
        };
        let chunk =
            |chunk_idx: usize| chunk_idx * CHUNK..((chunk_idx + 1) * CHUNK).min(n_triangles);
        let sums: Vec<f64> = parallel::map(n_triangles.div_ceil(CHUNK), 1, |chunk_idx| {
            chunk(chunk_idx).map(area).sum()
        });
        let total: f64 = sums.iter().sum();
        let per_area = if total > 0.0 { N_SAMPLES as f64 / total } else { 0.0 };
        let due = |passed: f64| (passed * per_area + 0.5) as usize;
        let befores: Vec<f64> = sums
            .iter()
            .scan(0.0, |passed, sum| {
                let before = *passed;
                *passed += sum;
                Some(before)
            })
            .collect();
        let drawn = parallel::map(sums.len(), 1, |chunk_idx| {
            let mut passed = befores[chunk_idx];
            let after = befores[chunk_idx] + sums[chunk_idx];
            let mut drawn = Vec::new();
            if due(after) > due(passed) {
                for triangle_idx in chunk(chunk_idx) {
                    let from = due(passed);
                    passed = (passed + area(triangle_idx)).min(after);
                    drawn.extend(
                        (from..due(passed))
                            .map(|k| (triangle_idx, place(mesh.corners(triangle_idx), k))),
                    );
                }
            }
            drawn
        });
        Self { mesh, drawn: drawn.concat() }
    }

    /// Both sides of the places, up to three voxels away; places with surface all the way are left
    /// out.
    fn beside(&self, surface: &Surface, sides: &Sides) -> Vec<Beside> {
        let grid = &surface.grid;
        let look = |(triangle_idx, place): &(usize, DVec3)| {
            let corners = self.mesh.corners(*triangle_idx);
            let normal =
                (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize_or_zero();
            let first = |direction: DVec3| {
                let steps =
                    (1..=6).map(|half_voxels| 0.5 * f64::from(half_voxels) * grid.voxel_size_m);
                steps.map(|step| *place + direction * step).find_map(|point| {
                    let cell = grid.to_cells(point).floor();
                    match sides.side(surface, [cell.x as i32, cell.y as i32, cell.z as i32]) {
                        Side::Surface => None,
                        side => Some((side, point)),
                    }
                })
            };
            Some([first(normal)?, first(-normal)?])
        };
        self.drawn.iter().filter_map(look).collect()
    }

    fn outside_twice(&self, surface: &Surface, sides: &Sides) -> Vec<Beside> {
        let mut beside = self.beside(surface, sides);
        beside.retain(|points| points.iter().all(|(side, _)| *side == Side::Outside));
        beside
    }

    /// Share of all draws.
    fn share(&self, count: usize) -> f64 {
        count as f64 / self.drawn.len().max(1) as f64
    }

    /// Looks for a leak. Cost: O(samples); for a mesh that may leak the tree of winding numbers and
    /// O(samples) questions to it.
    pub(super) fn probe(&self, report: &MeshReport, surface: &Surface, sides: &Sides) -> FaceProbe {
        let outside_twice = self.outside_twice(surface, sides);
        let outside_share = self.share(outside_twice.len());
        if outside_share < LEAKING || report.closed && fills_its_volume(report, surface, sides) {
            return FaceProbe { leak: None, thin_share: outside_share, winding: None };
        }
        let winding = WindingTree::new(self.mesh);
        let flooded = flooded(&outside_twice, &winding);
        let leak = flooded.first().filter(|_| self.share(flooded.len()) >= LEAKING).map(|point| {
            let widest =
                report.widest_hole().filter(|hole| hole.width_m > surface.grid.voxel_size_m);
            match widest {
                Some(hole) => Leak { position_m: hole.center_m, size_m: hole.width_m },
                None => Leak { position_m: *point, size_m: surface.grid.voxel_size_m },
            }
        });
        FaceProbe {
            leak,
            thin_share: self.share(outside_twice.len() - flooded.len()),
            winding: Some(winding),
        }
    }

    /// Shares of the surface with outside on both sides: those within, where the fill got in, and
    /// those that are thin.
    pub(super) fn flooded_and_thin(
        &self,
        surface: &Surface,
        sides: &Sides,
        winding: &WindingTree,
    ) -> (f64, f64) {
        let outside_twice = self.outside_twice(surface, sides);
        let flooded = flooded(&outside_twice, winding).len();
        (self.share(flooded), self.share(outside_twice.len() - flooded))
    }

    /// Share of the points beside the surface whose winding number is near a whole number: 1 for
    /// closed parts, however they face, overlap or repeat; less the larger the holes are that are
    /// seen from there. 0 where no point was found.
    pub(super) fn clear_share(
        &self,
        surface: &Surface,
        sides: &Sides,
        winding: &WindingTree,
    ) -> f64 {
        let windings = windings(&self.beside(surface, sides), winding);
        let n_clear =
            windings.iter().filter(|winding| (*winding - winding.round()).abs() < CLEAR).count();
        n_clear as f64 / windings.len().max(1) as f64
    }
}

/// The k-th of places that fill a triangle evenly.
///
/// # Source
/// Roberts 2018, "The unreasonable effectiveness of quasirandom sequences": multiples of the
/// plastic number's powers, folded.
fn place([a, b, c]: [DVec3; 3], k: usize) -> DVec3 {
    let [mut u, mut v] = [0.754_877_666_246_692_8, 0.569_840_290_998_053_3]
        .map(|step: f64| (0.5 + step * k as f64).fract());
    if u + v > 1.0 {
        (u, v) = (1.0 - u, 1.0 - v);
    }
    a + (b - a) * u + (c - a) * v
}

/// `[2 · n_places]`: the winding numbers of both sides of each place.
fn windings(beside: &[Beside], winding: &WindingTree) -> Vec<f64> {
    let points: Vec<DVec3> = beside.as_flattened().iter().map(|(_, point)| *point).collect();
    winding.at(&points)
}

/// Points, one for each place that has one, that were flooded although they lie within.
fn flooded(outside_twice: &[Beside], winding: &WindingTree) -> Vec<DVec3> {
    let windings = windings(outside_twice, winding);
    let within = outside_twice.iter().zip(windings.as_chunks::<2>().0);
    within
        .filter_map(|(sides, windings)| {
            Some(sides[windings.iter().position(|winding| winding.abs() > WITHIN)?].1)
        })
        .collect()
}

/// True when the cells inside make up what the mesh's volume leaves beside its surface cells, to a
/// quarter: parts that overlap or nest count their volume twice. A volume of surface cells only
/// says nothing.
fn fills_its_volume(report: &MeshReport, surface: &Surface, sides: &Sides) -> bool {
    let cell_m3 = surface.grid.voxel_size_m.powi(3);
    let expected_m3 = report.signed_volume_m3.abs() - surface.n_voxels as f64 * cell_m3;
    sides.count_inside(surface) as f64 * cell_m3 >= 0.25 * expected_m3
}
