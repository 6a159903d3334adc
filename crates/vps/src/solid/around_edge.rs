//! The order of triangles around an edge.

use glam::DVec3;

use crate::mesh::TriangleMesh;
use crate::mesh::edges::EdgeFan;

/// Half-planes closer than this, rad, are one: of bodies that touch in a face.
const SAME_ANGLE: f64 = 1e-6;

/// A triangle in an edge.
#[derive(Clone, Copy, Debug)]
pub(super) struct Wall {
    /// The number of its half-plane, counted as one turns about the edge from its lower to its
    /// higher vertex.
    pub(super) plane: u32,
    pub(super) triangle: u32,
    /// It runs from the lower to the higher vertex: what lies behind it ends here.
    pub(super) ends: bool,
}

/// The triangles of an edge as one meets them when turning about it, by the right-hand rule; in one
/// half-plane by their numbers. `None` when the edge has no length.
pub(super) fn around(
    mesh: &TriangleMesh,
    fan: &EdgeFan,
    triangles: &[[u32; 3]],
) -> Option<Vec<Wall>> {
    let [low, high] = fan.edge.map(|vertex| mesh.vertices[vertex as usize]);
    let axis = (high - low).try_normalize()?;
    let (u, v) = axis.any_orthonormal_pair();
    let mut around: Vec<(f64, bool, u32)> = fan
        .triangles
        .iter()
        .map(|(triangle, forward)| {
            let corners = triangles[*triangle as usize];
            let far = corners.into_iter().find(|corner| !fan.edge.contains(corner));
            let way = far.map_or(DVec3::ZERO, |far| mesh.vertices[far as usize] - low);
            (way.dot(v).atan2(way.dot(u)), *forward, *triangle)
        })
        .collect();
    around.sort_unstable_by(|one, other| one.0.total_cmp(&other.0).then(one.2.cmp(&other.2)));
    // Planes are numbered from the widest gap on, so that none is on both sides of the seam.
    let n = around.len();
    let gap = |k: usize| {
        let turn = if k == 0 { std::f64::consts::TAU } else { 0.0 };
        around[k].0 + turn - around[(k + n - 1) % n].0
    };
    let seam = (1..n).fold(0, |best, k| if gap(k) > gap(best) { k } else { best });
    let mut plane = 0;
    let walls = (0..n).map(|k| {
        let k = (seam + k) % n;
        plane += u32::from(gap(k) > SAME_ANGLE);
        let (_, ends, triangle) = around[k];
        Wall { plane, triangle, ends }
    });
    Some(walls.collect())
}
