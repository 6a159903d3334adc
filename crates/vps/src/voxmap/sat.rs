//! Does a triangle touch a voxel? The separating-axis test on 13 axes, exactly as the whole map
//! defines "surface".
//!
//! # Source
//! Sagardia2008, section 3.2 (13 axes: 3 coordinate axes, the triangle's normal, 9 cross products
//! of the coordinate axes with the edges); AkenineMoller2001. **Erratum**: the printed text calls
//! the pair colliding as soon as *one* axis overlaps. The theorem says the opposite: they collide
//! only if **no** axis separates, and the test may stop at the first axis that does.

use glam::DVec3;

/// A triangle prepared for tests against many voxels. Coordinates are cells: voxel `[i, j, k]` is
/// the cube `[i..i+1, …]`.
///
/// Per axis a the triangle covers `[min a·v, max a·v]` and a voxel with centre c covers `a·c ±
/// ½(|ax|+|ay|+|az|)`; both closed, so touching counts. The voxel's half-width is moved into the
/// triangle's interval here, once, which leaves one dot product per axis and voxel. Zero-length
/// axes (an edge along a coordinate axis, a degenerate triangle) separate nothing.
///
/// Invariant: for fixed cell coordinates on two axes, the voxels that [`Self::hits`] accepts along
/// the third form one gap-free run, *in floating point too*: `a·c` is summed in a fixed order and
/// IEEE multiplication and addition are monotone, so each axis accepts an interval, and an
/// intersection of intervals is one. The two-sided navigation rests on this.
#[derive(Clone, Copy, Debug)]
pub(crate) struct TriangleSat {
    /// Lowest and highest corner of the triangle, cells.
    pub(crate) bounds: (DVec3, DVec3),
    axes: [DVec3; 10],
    low: [f64; 10],
    high: [f64; 10],
}

impl TriangleSat {
    /// Prepares a triangle given by its corners in cell coordinates. Cost: 10 axes, about 200
    /// flops.
    pub(crate) fn new(corners: &[DVec3; 3]) -> Self {
        let [v0, v1, v2] = *corners;
        let edges = [v1 - v0, v2 - v1, v0 - v2];
        let normal = edges[0].cross(edges[1]);
        let mut axes = [normal; 10];
        for (edge_idx, edge) in edges.iter().enumerate() {
            for (unit_idx, unit) in [DVec3::X, DVec3::Y, DVec3::Z].iter().enumerate() {
                axes[1 + 3 * edge_idx + unit_idx] = unit.cross(*edge);
            }
        }
        let largest = v0.abs().max(v1.abs()).max(v2.abs()).max_element();
        let mut low = [0.0; 10];
        let mut high = [0.0; 10];
        for (idx, axis) in axes.iter().enumerate() {
            let projections = corners.map(|corner| dot_in_order(*axis, corner));
            let extent = axis.x.abs() + axis.y.abs() + axis.z.abs();
            // A face on a cell boundary touches the cells on both sides of it. Rounding must not
            // take it from both, which would leave a hole in the surface: the intervals grow by
            // more than three products and two sums can lose.
            let half_width = 0.5 * extent + 8.0 * f64::EPSILON * extent * (1.0 + largest);
            low[idx] = projections[0].min(projections[1]).min(projections[2]) - half_width;
            high[idx] = projections[0].max(projections[1]).max(projections[2]) + half_width;
        }
        Self { bounds: (v0.min(v1).min(v2), v0.max(v1).max(v2)), axes, low, high }
    }

    /// True when no axis separates the triangle from the voxel; stops at the first that does.
    #[inline]
    pub(crate) fn hits(&self, cell: [i32; 3]) -> bool {
        let lowest = DVec3::new(cell[0].into(), cell[1].into(), cell[2].into());
        let (triangle_low, triangle_high) = self.bounds;
        if (triangle_low.cmpgt(lowest + 1.0) | triangle_high.cmplt(lowest)).any() {
            return false;
        }
        let center = lowest + 0.5;
        self.axes.iter().zip(self.low.iter().zip(&self.high)).all(|(axis, (low, high))| {
            let projection = dot_in_order(*axis, center);
            projection >= *low && projection <= *high
        })
    }
}

/// a·b summed x, then y, then z: the monotonicity argument of [`TriangleSat`] needs this order to
/// be fixed.
#[inline]
fn dot_in_order(a: DVec3, b: DVec3) -> f64 {
    (a.x * b.x + a.y * b.y) + a.z * b.z
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::spatial::testing::Random;

    /// Reference: clip the triangle by the six half-spaces of the closed voxel, moved out by
    /// `tolerance`; something left means contact.
    fn clipping_hits(corners: &[DVec3; 3], cell: [i32; 3], tolerance: f64) -> bool {
        let low = DVec3::new(cell[0].into(), cell[1].into(), cell[2].into());
        let mut polygon: Vec<DVec3> = corners.to_vec();
        for axis in 0..3 {
            for (sign, bound) in [(1.0, low[axis]), (-1.0, -(low[axis] + 1.0))] {
                let inside = |p: DVec3| sign * p[axis] - bound + tolerance;
                let mut clipped = Vec::new();
                for (idx, &p) in polygon.iter().enumerate() {
                    let q = polygon[(idx + 1) % polygon.len()];
                    let a = inside(p);
                    let b = inside(q);
                    if a >= 0.0 {
                        clipped.push(p);
                    }
                    if (a > 0.0 && b < 0.0) || (a < 0.0 && b > 0.0) {
                        clipped.push(p + (q - p) * (a / (a - b)));
                    }
                }
                polygon = clipped;
            }
        }
        !polygon.is_empty()
    }

    #[test]
    fn acceptance_1_sat_agrees_with_clipping_on_random_pairs() {
        let mut random = Random(7);
        let mut hits = 0;
        for idx in 0..200_000 {
            let around = random.in_box(-0.4, 1.4);
            let spread = [0.05, 0.5, 2.0, 6.0][idx % 4];
            let corners = [(); 3].map(|()| around + random.in_box(-spread, spread));
            let expected = clipping_hits(&corners, [0, 0, 0], 0.0);
            assert_eq!(TriangleSat::new(&corners).hits([0, 0, 0]), expected, "{corners:?}");
            hits += usize::from(expected);
        }
        assert!((40_000..160_000).contains(&hits), "both outcomes must be common: {hits}");
    }

    #[test]
    fn acceptance_1_sat_agrees_with_clipping_on_touching_and_axis_aligned_pairs() {
        // Corners on a half-integer lattice: the test's arithmetic is exact, and touching by face,
        // edge and corner is common. The reference divides, so it gets a tolerance, far below the
        // smallest gap that such corners can leave.
        let mut random = Random(11);
        let mut touching = 0;
        for _ in 0..100_000 {
            let corners = [(); 3].map(|()| (random.in_box(-2.0, 5.0)).floor() * 0.5);
            let expected = clipping_hits(&corners, [0, 0, 0], 1e-9);
            assert_eq!(TriangleSat::new(&corners).hits([0, 0, 0]), expected, "{corners:?}");
            let strictly_apart = (0..3).any(|axis| {
                corners.iter().all(|c| c[axis] <= 0.0) || corners.iter().all(|c| c[axis] >= 1.0)
            });
            touching += usize::from(expected && strictly_apart);
        }
        assert!(touching > 1000, "{touching}");
    }

    #[test]
    fn acceptance_1_degenerate_triangles_are_points_and_segments() {
        let p = DVec3::new(0.5, 0.5, 0.5);
        assert!(TriangleSat::new(&[p, p, p]).hits([0, 0, 0]));
        assert!(!TriangleSat::new(&[p, p, p]).hits([1, 0, 0]));
        let corner = DVec3::ONE;
        for cell in [[0, 0, 0], [1, 1, 1], [0, 1, 0]] {
            assert!(
                TriangleSat::new(&[corner; 3]).hits(cell),
                "a point on a corner touches all eight voxels"
            );
        }
        let segment =
            [DVec3::new(-3.0, 0.5, 0.5), DVec3::new(4.0, 0.5, 0.5), DVec3::new(1.0, 0.5, 0.5)];
        assert!(TriangleSat::new(&segment).hits([0, 0, 0]));
        assert!(!TriangleSat::new(&segment).hits([0, 1, 0]));
    }

    #[test]
    fn hits_along_a_column_are_one_gap_free_run() {
        let mut random = Random(23);
        for round in 0..3000 {
            // Lattice corners with a breath of noise: borderline in many axes at once.
            let noise = [0.0, 1e-16, 1e-13, 1e-9][round % 4];
            let corners =
                [(); 3].map(|()| random.in_box(0.0, 12.0).floor() + random.in_box(-noise, noise));
            let sat = TriangleSat::new(&corners);
            for axis in 0..3 {
                for (u, v) in (0..12).flat_map(|u| (0..12).map(move |v| (u, v))) {
                    let mut cell = [0; 3];
                    cell[(axis + 1) % 3] = u;
                    cell[(axis + 2) % 3] = v;
                    let row: Vec<bool> = (0..12)
                        .map(|w| {
                            cell[axis] = w;
                            sat.hits(cell)
                        })
                        .collect();
                    let first = row.iter().position(|hit| *hit);
                    let last = row.iter().rposition(|hit| *hit);
                    if let (Some(first), Some(last)) = (first, last) {
                        assert!(row[first..=last].iter().all(|hit| *hit), "{corners:?} {row:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn a_face_on_a_cell_boundary_is_never_lost_on_both_sides() {
        let mut random = Random(11);
        for _ in 0..200_000 {
            // Corners off the plane by a few roundings, as a division by the voxel edge leaves
            // them.
            let mut corner = || {
                let mut point = random.in_box(2.0, 60.0);
                point.z = 18.0 * (1.0 + f64::EPSILON * (random.unit() * 5.0 - 2.5).round());
                point
            };
            let corners = [corner(), corner(), corner()];
            let middle = (corners[0] + corners[1] + corners[2]) / 3.0;
            let [x, y] = [middle.x.floor() as i32, middle.y.floor() as i32];
            let sat = TriangleSat::new(&corners);
            assert!(sat.hits([x, y, 17]) || sat.hits([x, y, 18]), "{corners:?}");
        }
    }
}
