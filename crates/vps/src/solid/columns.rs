//! Winding numbers of points, by the closed triangles above them.
//!
//! Data in: triangles of closed pieces, a point. Data out: the triangles that the ray from the
//! point along +z crosses, and which way. Signs are exact, and a ray through an edge or a vertex
//! crosses exactly one of the triangles there, so that the sum over a closed piece is its winding
//! number, whatever the point, unless it lies on the piece.

use glam::DVec3;
use robust::{Coord, Coord3D, orient2d, orient3d};

use crate::mesh::boxes::Boxes;

/// +1 when the ray from `point` along +z leaves through the triangle, −1 when it enters, 0 when it
/// does not cross it.
pub(super) fn crossing(corners: &[DVec3; 3], point: DVec3) -> i32 {
    let flat = |p: DVec3| Coord { x: p.x, y: p.y };
    let mut turns = 0;
    for k in 0..3 {
        let from = corners[k];
        let to = corners[(k + 1) % 3];
        // Half-open in y: a corner belongs to one of its edges.
        let rises = from.y <= point.y && point.y < to.y;
        let falls = to.y <= point.y && point.y < from.y;
        if rises || falls {
            // The edge is asked in one direction, so that both of its triangles hear the same.
            let (low, high) = if rises { (from, to) } else { (to, from) };
            let is_left = orient2d(flat(low), flat(high), flat(point)) > 0.0;
            turns += i32::from(is_left) * if rises { 1 } else { -1 };
        }
    }
    if turns == 0 {
        return 0;
    }
    let solid = |p: DVec3| Coord3D { x: p.x, y: p.y, z: p.z };
    let side = orient3d(solid(corners[0]), solid(corners[1]), solid(corners[2]), solid(point));
    // Positive when the point lies below a triangle that faces up.
    if side * f64::from(turns) > 0.0 { turns } else { 0 }
}

/// Calls `crossed` with the way of each triangle that the ray crosses.
pub(super) fn above(
    boxes: &Boxes,
    corners_of: impl Fn(u32) -> [DVec3; 3],
    point: DVec3,
    mut crossed: impl FnMut(i32),
) {
    let top = point.with_z(f64::INFINITY);
    boxes.meeting(point, top, |number| {
        let way = crossing(&corners_of(number), point);
        if way != 0 {
            crossed(way);
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::primitives::Shape;

    #[test]
    fn rays_through_corners_and_edges_count_a_closed_surface_once() {
        let mesh = Shape::Box { size_m: DVec3::splat(2.0) }.tessellate(1.0);
        let boxes = Boxes::new(mesh.triangles.len(), |k| {
            let [a, b, c] = mesh.corners(k);
            (a.min(b).min(c), a.max(b).max(c))
        });
        let winding = |point: DVec3| {
            let mut sum = 0;
            above(&boxes, |k| mesh.corners(k as usize), point, |way| sum += way);
            sum
        };
        let ticks = [-1.5, -1.0, -0.5, 0.0, 0.5, 1.0, 1.5];
        for x in ticks {
            for y in ticks {
                for z in ticks {
                    let point = DVec3::new(x, y, z);
                    let reach = point.abs().max_element();
                    if reach != 1.0 {
                        assert_eq!(winding(point), i32::from(reach < 1.0), "{point}");
                    }
                }
            }
        }
    }
}
