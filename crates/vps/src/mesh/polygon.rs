//! Polygons cut into triangles.
//!
//! Convex polygons become fans. Others have their ears clipped, because the fan of a hollow polygon
//! leaves it, and a voxel map of such triangles has walls in the air. Cost: linear for convex
//! polygons, quadratic for usual others, and bounded for those that were made to be slow.

use glam::{DVec2, DVec3};

/// Corners looked at per corner of a polygon before the rest of it becomes a fan: usual ones of ten
/// thousand corners need a third.
const MOST_LOOKS: usize = 1 << 15;

/// Appends triangles that cover `polygon`, in its direction of turning; fewer than three corners
/// give nothing.
pub fn triangulate(vertices: &[DVec3], polygon: &[u32], triangles: &mut Vec<[u32; 3]>) {
    if let [a, b, c] = *polygon {
        triangles.push([a, b, c]);
        return;
    }
    let corner = |k: usize| vertices[polygon[k % polygon.len()] as usize];
    // Newell's normal holds for hollow and for slightly bent polygons.
    let origin = polygon.first().map(|first| vertices[*first as usize]).unwrap_or_default();
    let normal: DVec3 =
        (0..polygon.len()).map(|k| (corner(k) - origin).cross(corner(k + 1) - origin)).sum();
    if normal == DVec3::ZERO || !normal.is_finite() {
        fan(polygon, triangles);
        return;
    }
    let (x_axis, y_axis) = normal.normalize().any_orthonormal_pair();
    let flat: Vec<DVec2> = (0..polygon.len())
        .map(|k| {
            let arm = corner(k) - origin;
            DVec2::new(arm.dot(x_axis), arm.dot(y_axis))
        })
        .collect();

    let turn = |a: usize, b: usize, c: usize| (flat[b] - flat[a]).perp_dot(flat[c] - flat[b]);
    let is_convex =
        (0..flat.len()).all(|k| turn(k, (k + 1) % flat.len(), (k + 2) % flat.len()) >= 0.0);
    if is_convex {
        fan(polygon, triangles);
        return;
    }
    let mut rest: Vec<usize> = (0..polygon.len()).collect();
    let mut looks = MOST_LOOKS.saturating_mul(polygon.len());
    while rest.len() > 3 && looks > 0 {
        let n = rest.len();
        let ear = (0..n).find(|k| {
            let a = rest[(k + n - 1) % n];
            let b = rest[*k];
            let c = rest[(k + 1) % n];
            looks = looks.saturating_sub(1);
            looks > 0
                && turn(a, b, c) > 0.0
                && rest.iter().all(|other| {
                    looks = looks.saturating_sub(1);
                    let point = flat[*other];
                    // Corners at the same place as the ear's own do not block it: polygons with
                    // bridges to holes have such.
                    [a, b, c].iter().any(|own| flat[*own] == point)
                        || !covers([flat[a], flat[b], flat[c]], point)
                })
        });
        // A polygon that crosses itself may have no ear: any corner will do, and the report on the
        // mesh will show the rest.
        let k = ear.unwrap_or(0);
        triangles.push(
            [rest[(k + n - 1) % n], rest[k], rest[(k + 1) % n]].map(|corner| polygon[corner]),
        );
        rest.remove(k);
    }
    fan(&rest.into_iter().map(|corner| polygon[corner]).collect::<Vec<_>>(), triangles);
}

fn fan(polygon: &[u32], triangles: &mut Vec<[u32; 3]>) {
    if let [first, rest @ ..] = polygon {
        triangles.extend(rest.windows(2).map(|pair| [*first, pair[0], pair[1]]));
    }
}

/// True when the counter-clockwise triangle covers the point, border included.
fn covers([a, b, c]: [DVec2; 3], point: DVec2) -> bool {
    (b - a).perp_dot(point - a) >= 0.0
        && (c - b).perp_dot(point - b) >= 0.0
        && (a - c).perp_dot(point - c) >= 0.0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn areas(vertices: &[DVec3], polygon: &[u32]) -> (f64, f64, usize) {
        let mut triangles = Vec::new();
        triangulate(vertices, polygon, &mut triangles);
        let vectors: Vec<DVec3> = triangles
            .iter()
            .map(|t| t.map(|v| vertices[v as usize]))
            .map(|[a, b, c]| (b - a).cross(c - a) * 0.5)
            .collect();
        (
            vectors.iter().copied().sum::<DVec3>().length(),
            vectors.iter().map(|v| v.length()).sum(),
            triangles.len(),
        )
    }

    #[test]
    fn hollow_polygons_are_covered_once() {
        // An L, a comb and an arrow, in a tilted plane, in both directions of turning and from
        // every first corner.
        let shapes: [&[(f64, f64)]; 3] = [
            &[(0.0, 0.0), (2.0, 0.0), (2.0, 1.0), (1.0, 1.0), (1.0, 2.0), (0.0, 2.0)],
            &[
                (0.0, 0.0),
                (5.0, 0.0),
                (5.0, 3.0),
                (4.0, 3.0),
                (4.0, 1.0),
                (3.0, 1.0),
                (3.0, 3.0),
                (0.0, 3.0),
            ],
            &[(0.0, 0.0), (2.0, -1.0), (0.5, 0.0), (2.0, 1.0)],
        ];
        for (shape, area) in shapes.iter().zip([3.0, 13.0, 0.5 * 2.0 * 0.5 * 2.0 + 0.5]) {
            let vertices: Vec<DVec3> =
                shape.iter().map(|(x, y)| DVec3::new(*x, y * 0.6, y * 0.8)).collect();
            let n = vertices.len() as u32;
            for first in 0..n {
                let mut polygon: Vec<u32> = (0..n).map(|k| (first + k) % n).collect();
                for _ in 0..2 {
                    let (vector, total, count) = areas(&vertices, &polygon);
                    assert_eq!(count, polygon.len() - 2);
                    assert!((vector - total).abs() < 1e-12, "triangles overlap: {vector} {total}");
                    assert!((total - area).abs() < 1e-12 || n == 4, "{total} instead of {area}");
                    polygon.reverse();
                }
            }
        }
    }

    #[test]
    fn degenerate_polygons_do_no_harm() {
        let vertices = [DVec3::ZERO, DVec3::X, DVec3::X * 2.0, DVec3::X * 3.0];
        assert_eq!(areas(&vertices, &[0, 1, 2, 3]).2, 2);
        assert_eq!(areas(&vertices, &[0, 1]).2, 0);
        assert_eq!(areas(&vertices, &[]).2, 0);
        let crossing =
            [DVec3::ZERO, DVec3::new(1.0, 1.0, 0.0), DVec3::X, DVec3::new(0.0, 1.2, 0.0)];
        assert_eq!(areas(&crossing, &[0, 1, 2, 3]).2, 2);
    }
}
