//! Inward unit normals from the layer values around a point: what the volume says, not what the file says.
//!
//! # Source
//! Sagardia2008, section 4: n = normalize(Σ v_k (C_k − C_0)) over the 5×5×5 voxels around the voxel that holds the point, v_k the
//! layer value (negative outside, positive inside), so n points inward. Needs two layers on each side (ours).

use glam::DVec3;

use super::project::SurfacePoint;
use crate::mesh::TriangleMesh;
use crate::voxmap::Voxmap;

/// Below this length the sum has no direction: a wall thinner than the neighbourhood looks the same from both sides.
const VANISHING: f64 = 1e-3;

/// Inward unit normal of a point, map axes. A sum that vanishes gives the triangle's normal, turned inward by the verdict of
/// the fill or, where there is none, by the winding; a degenerate triangle then gives +z, never NaN.
pub fn normal(mesh: &TriangleMesh, map: &Voxmap, point: &SurfacePoint) -> DVec3 {
    let floor = point.cells.floor();
    let home = [floor.x as i32, floor.y as i32, floor.z as i32];
    let mut sum = DVec3::ZERO;
    for x in -2..=2_i32 {
        for y in -2..=2_i32 {
            for z in -2..=2_i32 {
                let value = f64::from(map.layers.value([home[0] + x, home[1] + y, home[2] + z]));
                sum += value * DVec3::new(x.into(), y.into(), z.into());
            }
        }
    }
    // In a thin skin both sides are outside: what the sum shows is the grid, not the surface.
    if !map.thin && sum.length() > VANISHING {
        return sum.normalize();
    }
    let [a, b, c] = mesh.corners(point.triangle_idx as usize);
    let outward = (b - a).cross(c - a).normalize_or_zero() * map.orientation.sign(point.triangle_idx);
    if outward == DVec3::ZERO { DVec3::Z } else { -outward }
}
