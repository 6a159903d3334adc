//! Distance of a point to a patch, without branches.
//!
//! # Source
//! Ours. In the patch's own frame the triangle is (0, 0), (length, 0), apex with 0 ≤ apex.x ≤ length, because the first edge is
//! the longest. Three orientation tests tell whether the foot lies inside; otherwise the nearest of three segments counts. No
//! test decides more than rounding is worth: next to an edge both answers agree.

/// A number per lane.
pub(super) trait Number: Copy {
    fn add(self, other: Self) -> Self;
    fn sub(self, other: Self) -> Self;
    fn mul(self, other: Self) -> Self;
    fn min(self, other: Self) -> Self;
    fn max(self, other: Self) -> Self;
    fn splat(value: f32) -> Self;
    /// 0 where all three are above 0.
    fn zero_where_all_positive(self, three: [Self; 3]) -> Self;
}

/// A patch's own frame and shape, per lane.
pub(super) struct Flat<N> {
    right: [N; 3],
    up: [N; 3],
    length: N,
    apex: [N; 2],
    inverse: [N; 2],
}

impl<N: Number> Flat<N> {
    /// From words 5 to 15 of a patch.
    #[inline(always)]
    pub(super) fn new([a, b, c, d, e, f, length, apex_x, apex_y, inverse_1, inverse_2]: [N; 11]) -> Self {
        Self { right: [a, b, c], up: [d, e, f], length, apex: [apex_x, apex_y], inverse: [inverse_1, inverse_2] }
    }
}

/// Where the closest point is, per lane.
pub(super) struct Nearest<N> {
    /// Cells².
    pub(super) squared: N,
    /// Along the winding normal, cells.
    pub(super) height: N,
    /// Squared distance in the plane to each edge, and the largest with which the closest point counts as lying on it.
    pub(super) on_edge: [[N; 2]; 3],
}

/// Share of a squared distance by which two edges may differ and still both hold the closest point (a corner).
const CORNER_SHARE: f32 = 1.0 + 1e-5;
/// The same next to the plane of the foot, cells².
const CORNER_CELLS_SQUARED: f32 = 1e-9;

/// `way`: from the patch's first corner to the point, cells.
#[inline(always)]
pub(super) fn nearest<N: Number>(flat: &Flat<N>, way: [N; 3]) -> Nearest<N> {
    let [r, u] = [flat.right, flat.up];
    let normal = [r[1].mul(u[2]).sub(r[2].mul(u[1])), r[2].mul(u[0]).sub(r[0].mul(u[2])), r[0].mul(u[1]).sub(r[1].mul(u[0]))];
    let (x, y, height) = (dot(r, way), dot(u, way), dot(normal, way));
    let beyond = x.sub(x.max(N::splat(0.0)).min(flat.length));
    let base = beyond.mul(beyond).add(y.mul(y));
    let [apex_x, apex_y] = flat.apex;
    let (from_second, edge_second) = (x.sub(flat.length), apex_x.sub(flat.length));
    let second = segment([from_second, y], [edge_second, apex_y], flat.inverse[0]);
    let third = segment([x, y], flat.apex, flat.inverse[1]);
    let inside = [y, edge_second.mul(y).sub(apex_y.mul(from_second)), apex_y.mul(x).sub(apex_x.mul(y))];
    let in_plane = base.min(second).min(third).zero_where_all_positive(inside);
    let limit = in_plane.mul(N::splat(CORNER_SHARE)).add(N::splat(CORNER_CELLS_SQUARED));
    Nearest { squared: height.mul(height).add(in_plane), height, on_edge: [[base, limit], [second, limit], [third, limit]] }
}

#[inline(always)]
fn dot<N: Number>(a: [N; 3], b: [N; 3]) -> N {
    a[0].mul(b[0]).add(a[1].mul(b[1])).add(a[2].mul(b[2]))
}

/// Squared distance to an edge of which one end is the origin.
#[inline(always)]
fn segment<N: Number>([x, y]: [N; 2], [edge_x, edge_y]: [N; 2], inverse: N) -> N {
    let along = x.mul(edge_x).add(y.mul(edge_y)).mul(inverse).max(N::splat(0.0)).min(N::splat(1.0));
    let (rest_x, rest_y) = (x.sub(along.mul(edge_x)), y.sub(along.mul(edge_y)));
    rest_x.mul(rest_x).add(rest_y.mul(rest_y))
}
