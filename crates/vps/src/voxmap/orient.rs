//! Which side of a triangle is out? Asked of the fill, not of the file.
//!
//! CAD exports turn single faces or whole parts inside out (Sagardia2008, section 4). The fill
//! knows better: a probe on either side of a triangle meets an outside and an inside cell. Where it
//! cannot say (a wall thinner than a voxel, a face inside solid material) the winding of the file
//! stands, turned by the verdict of the object's other faces.

use glam::DVec3;

use super::fill::{Side, Sides};
use super::surface::Surface;
use crate::mesh::TriangleMesh;
use crate::mesh::validate::MeshReport;
use crate::parallel;

/// One verdict per triangle.
#[derive(Debug)]
pub struct Orientation {
    /// `[n_triangles]`: +1 when the winding's normal points out, −1 when it points in.
    signs: Vec<i8>,
    /// Triangles that the fill found inside out.
    pub n_inverted: usize,
}

impl Orientation {
    /// The winding of the file stands: for a thin skin, which has no inside to face.
    pub(super) fn as_filed(n_triangles: usize) -> Self {
        Self { signs: vec![1; n_triangles], n_inverted: 0 }
    }

    /// Probes both sides of every triangle. Where the mesh is consistently wound, the parts of a
    /// connected piece outvote those whose probe went astray in a groove or a thin rib. Cost:
    /// O(triangles).
    pub(super) fn judge(
        mesh: &TriangleMesh,
        report: &MeshReport,
        surface: &Surface,
        sides: &Sides,
    ) -> Self {
        let verdicts: Vec<i8> = parallel::map(mesh.triangles.len(), 1, |triangle_idx| {
            let corners = mesh.corners(triangle_idx).map(|corner| surface.grid.to_cells(corner));
            let normal =
                (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize_or_zero();
            let center = (corners[0] + corners[1] + corners[2]) / 3.0;
            match (probe(surface, sides, center, normal), probe(surface, sides, center, -normal)) {
                (Some(Side::Outside), Some(Side::Inside)) => 1,
                (Some(Side::Inside), Some(Side::Outside)) => -1,
                _ => 0,
            }
        });
        let majority = |balance: i64, default: i8| match balance {
            0 => default,
            balance => balance.signum() as i8,
        };
        let count = |sign: i8| verdicts.iter().filter(|verdict| **verdict == sign).count() as i64;
        let n_outward = count(1);
        let n_inward = count(-1);
        let default = majority(n_outward - n_inward, 1);
        let signs: Vec<i8> = if n_outward == 0 || n_inward == 0 {
            // No triangle differs, so there is nothing to vote on.
            vec![default; verdicts.len()]
        } else if report.inconsistent_edges == 0 && report.duplicate_triangles == 0 {
            let pieces = connected_pieces(mesh.vertices.len(), &mesh.triangles);
            let mut balance = vec![0_i64; mesh.vertices.len()];
            for (piece, verdict) in pieces.iter().zip(&verdicts) {
                balance[*piece as usize] += i64::from(*verdict);
            }
            pieces.iter().map(|piece| majority(balance[*piece as usize], default)).collect()
        } else {
            verdicts.into_iter().map(|verdict| majority(i64::from(verdict), default)).collect()
        };
        let n_inverted = signs.iter().filter(|sign| **sign < 0).count();
        Self { signs, n_inverted }
    }

    /// +1 when the winding's normal of this triangle points out of the material, −1 when it points
    /// in.
    pub fn sign(&self, triangle_idx: u32) -> f64 {
        f64::from(self.signs[triangle_idx as usize])
    }
}

/// For each triangle the number of a vertex that stands for its connected piece (union-find over
/// shared vertices).
pub(super) fn connected_pieces(n_vertices: usize, triangles: &[[u32; 3]]) -> Vec<u32> {
    let mut parent: Vec<u32> = (0..n_vertices as u32).collect();
    fn root(parent: &mut [u32], mut vertex: u32) -> u32 {
        while parent[vertex as usize] != vertex {
            // Halving the path keeps the trees flat.
            parent[vertex as usize] = parent[parent[vertex as usize] as usize];
            vertex = parent[vertex as usize];
        }
        vertex
    }
    for triangle in triangles {
        let [a, b, c] = triangle.map(|vertex| root(&mut parent, vertex));
        let lowest = a.min(b).min(c);
        for other in [a, b, c] {
            parent[other as usize] = lowest;
        }
    }
    triangles.iter().map(|triangle| root(&mut parent, triangle[0])).collect()
}

/// First cell that is not surface on the way from a point along a direction, up to three voxels
/// away.
fn probe(surface: &Surface, sides: &Sides, from: DVec3, direction: DVec3) -> Option<Side> {
    let mut asked = None;
    (1..=6).map(|half_voxels| from + direction * (0.5 * f64::from(half_voxels))).find_map(|point| {
        let cell = point.floor().as_ivec3();
        // Half a step often ends in the same cell.
        if asked.replace(cell) == Some(cell) {
            return None;
        }
        Some(sides.side(surface, cell.to_array())).filter(|side| *side != Side::Surface)
    })
}
