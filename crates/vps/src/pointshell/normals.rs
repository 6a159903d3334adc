//! Inward unit normals from the layer values around a point: what the volume says, not what the
//! file says.
//!
//! The sums of a whole brick are formed at once from a copy of its layer values with a rim: a sum
//! over 5³ values is three sums over five, and the rows are short integers, so that one instruction
//! does eight cells. All sums are exact.
//!
//! # Source
//! Sagardia2008, section 4: n = normalize(Σ v_k (C_k − C_0)) over the 5×5×5 voxels around the voxel
//! that holds the point, v_k the layer value (negative outside, positive inside), so n points
//! inward. Needs two layers on each side (ours).

use glam::DVec3;

use super::project::SurfacePoint;
use crate::mesh::TriangleMesh;
use crate::voxmap::Volume;
use crate::voxmap::grid::{BRICK_CELLS, BRICK_EDGE, brick_origin};
use crate::voxmap::layers::{DEEP_INSIDE, FAR_OUTSIDE, Layers};

/// Cells that a window reaches beyond its middle.
const REACH: usize = 2;
/// Cells around a brick that matter: a point may lie one cell beyond its voxel.
const RIM: usize = REACH + 1;
/// Cells on the edge of a brick with its rim.
const PADDED: usize = BRICK_EDGE + 2 * RIM;
/// Cells on an edge that the windows about the brick's own cells reach.
const SUMMED: usize = BRICK_EDGE + 2 * REACH;

/// Eight neighbours along z. At most 127 · 150 = 19,050 per sum, which 16 bits hold.
type Row = [i16; BRICK_EDGE];

/// Σ v_k (C_k − C_0) for every cell of a brick.
pub(super) struct BrickSums {
    origin: [i32; 3],
    values: [[[i16; PADDED]; PADDED]; PADDED],
    /// `[x][y][axis][z]`.
    sums: [[[Row; 3]; BRICK_EDGE]; BRICK_EDGE],
}

impl Default for BrickSums {
    fn default() -> Self {
        Self {
            origin: [i32::MIN / 2; 3],
            values: [[[0; PADDED]; PADDED]; PADDED],
            sums: [[[[0; BRICK_EDGE]; 3]; BRICK_EDGE]; BRICK_EDGE],
        }
    }
}

impl BrickSums {
    /// Forms the sums of one brick of the grid.
    pub(super) fn form(&mut self, layers: &Layers, brick: usize) {
        let coord = layers.grid.brick_coord(brick);
        self.origin = brick_origin(coord);
        pad(layers, coord, &mut self.values);
        // Along z: the plain sum and the one weighted with −2 … 2.
        let mut along_z = [[[[0; BRICK_EDGE]; 2]; SUMMED]; SUMMED];
        for (plane, values) in along_z.iter_mut().zip(&self.values[1..]) {
            for (sums, row) in plane.iter_mut().zip(&values[1..]) {
                let mut at = [[0; BRICK_EDGE]; 5];
                for (k, at) in at.iter_mut().enumerate() {
                    at.copy_from_slice(&row[1 + k..1 + k + BRICK_EDGE]);
                }
                for z in 0..BRICK_EDGE {
                    sums[0][z] = at[0][z] + at[1][z] + at[2][z] + at[3][z] + at[4][z];
                    sums[1][z] = 2 * (at[4][z] - at[0][z]) + (at[3][z] - at[1][z]);
                }
            }
        }
        // Along y: the window slides over rows; weights go to one axis each.
        let mut along_y = [[[[0; BRICK_EDGE]; 3]; BRICK_EDGE]; SUMMED];
        for (plane, rows) in along_y.iter_mut().zip(&along_z) {
            for (y, sums) in plane.iter_mut().enumerate() {
                let rows: &[_; 5] = window(rows, y);
                *sums = [plain(rows, 0), weighted(rows, 0), plain(rows, 1)];
            }
        }
        for (x, plane) in self.sums.iter_mut().enumerate() {
            let planes: &[_; 5] = window(&along_y, x);
            for (y, sums) in plane.iter_mut().enumerate() {
                let mut rows = [[[0; BRICK_EDGE]; 3]; 5];
                rows.iter_mut().zip(planes).for_each(|(to, plane)| *to = plane[y]);
                *sums = [weighted(&rows, 0), plain(&rows, 1), plain(&rows, 2)];
            }
        }
    }

    /// Σ v_k (C_k − C_0) around one cell; `None` more than a cell outside the brick.
    #[inline]
    fn get(&self, cell: [i32; 3]) -> Option<DVec3> {
        // One more than the place in the brick; huge below it.
        let [x, y, z] = [0, 1, 2].map(|axis| (cell[axis] - self.origin[axis] + 1) as usize);
        let is_own = |i: usize| (1..=BRICK_EDGE).contains(&i);
        if is_own(x) && is_own(y) && is_own(z) {
            return Some(DVec3::from_array(self.sums[x - 1][y - 1].map(|sums| sums[z - 1].into())));
        }
        (x.max(y).max(z) <= BRICK_EDGE + 1).then(|| self.sum([x, y, z]))
    }

    /// The sum by its definition over the padded copy, whose cell `first` is the window's lowest:
    /// for points just outside the brick.
    fn sum(&self, first: [usize; 3]) -> DVec3 {
        let [mut along_x, mut along_y, mut along_z] = [0_i32; 3];
        for x in 0..5_i32 {
            for y in 0..5_i32 {
                let row: &[i16; 5] =
                    window(&self.values[first[0] + x as usize][first[1] + y as usize], first[2]);
                let [a, b, c, d, e] = row.map(i32::from);
                let plain = a + b + c + d + e;
                along_x += (x - 2) * plain;
                along_y += (y - 2) * plain;
                along_z += 2 * (e - a) + (d - b);
            }
        }
        DVec3::new(along_x.into(), along_y.into(), along_z.into())
    }
}

#[inline(always)]
fn window<T>(rows: &[T], first: usize) -> &[T; 5] {
    rows[first..].first_chunk().expect("five values from any place but the last four")
}

/// Sum of one of the quantities of five rows. Loops here and below, because a closure per lane is
/// not always inlined.
#[inline(always)]
fn plain<const N: usize>(rows: &[[Row; N]; 5], of: usize) -> Row {
    let mut sums = rows[0][of];
    for row in &rows[1..] {
        sums.iter_mut().zip(&row[of]).for_each(|(sum, value)| *sum += value);
    }
    sums
}

/// The same, weighted with −2, −1, 0, 1, 2.
#[inline(always)]
fn weighted<const N: usize>(rows: &[[Row; N]; 5], of: usize) -> Row {
    let mut sums = [0; BRICK_EDGE];
    for (z, sum) in sums.iter_mut().enumerate() {
        *sum = 2 * (rows[4][of][z] - rows[0][of][z]) + (rows[3][of][z] - rows[1][of][z]);
    }
    sums
}

/// Layer values of a brick with its rim.
fn pad(layers: &Layers, coord: [u32; 3], values: &mut [[[i16; PADDED]; PADDED]; PADDED]) {
    let grid = &layers.grid;
    let beyond = layers.n_layers as i8 + 1;
    let outside = [-beyond; BRICK_CELLS];
    let inside = [beyond; BRICK_CELLS];
    let around: [&[i8; BRICK_CELLS]; 27] = core::array::from_fn(|idx| {
        let offset = [idx as i32 / 9 - 1, idx as i32 / 3 % 3 - 1, idx as i32 % 3 - 1];
        match grid.brick_neighbour(coord, offset).map(|neighbour| layers.top[neighbour]) {
            None | Some(FAR_OUTSIDE) => &outside,
            Some(DEEP_INSIDE) => &inside,
            Some(slot) => &layers.values[slot as usize],
        }
    });
    for (x, plane) in values.iter_mut().enumerate() {
        let (brick_x, in_x) = split(x);
        for (y, row) in plane.iter_mut().enumerate() {
            let (brick_y, in_y) = split(y);
            let first = (in_x * BRICK_EDGE + in_y) * BRICK_EDGE;
            let part = |brick_z: usize| {
                &around[brick_x * 9 + brick_y * 3 + brick_z][first..first + BRICK_EDGE]
            };
            widen(&mut row[..RIM], &part(0)[BRICK_EDGE - RIM..]);
            widen(&mut row[RIM..RIM + BRICK_EDGE], part(1));
            widen(&mut row[RIM + BRICK_EDGE..], &part(2)[..RIM]);
        }
    }
    // The last bricks stick out of the grid, and what they hold there means nothing.
    let first = brick_origin(coord).map(|i| i - RIM as i32);
    if (0..3).any(|axis| first[axis] + PADDED as i32 > grid.dims[axis] as i32) {
        let is_beyond = |axis: usize, i: usize| first[axis] + i as i32 >= grid.dims[axis] as i32;
        for (x, plane) in values.iter_mut().enumerate() {
            for (y, row) in plane.iter_mut().enumerate() {
                for (z, value) in row.iter_mut().enumerate() {
                    if is_beyond(0, x) || is_beyond(1, y) || is_beyond(2, z) {
                        *value = (-beyond).into();
                    }
                }
            }
        }
    }
}

#[inline(always)]
fn widen(to: &mut [i16], from: &[i8]) {
    to.iter_mut().zip(from).for_each(|(to, from)| *to = (*from).into());
}

/// Which brick (0 before, 1 own, 2 after) and which cell in it a padded index means.
fn split(padded: usize) -> (usize, usize) {
    let shifted = padded + BRICK_EDGE - RIM;
    (shifted / BRICK_EDGE, shifted % BRICK_EDGE)
}

/// The same sum by its definition, one look-up at a time: for bricks with few points.
fn sum_by_look_up(layers: &Layers, home: [i32; 3]) -> DVec3 {
    let mut sum = DVec3::ZERO;
    for x in -2..=2_i32 {
        for y in -2..=2_i32 {
            for z in -2..=2_i32 {
                let value = f64::from(layers.value([home[0] + x, home[1] + y, home[2] + z]));
                sum += value * DVec3::new(x.into(), y.into(), z.into());
            }
        }
    }
    sum
}

/// Inward unit normal of a point, map axes. A sum that vanishes gives the triangle's normal, turned
/// inward by the verdict of the fill or, where there is none, by the winding; a degenerate triangle
/// then gives +z, never NaN.
///
/// `sums` are those of the brick of the point's voxel, or of no brick.
pub(super) fn normal(
    mesh: &TriangleMesh,
    map: &Volume,
    sums: &BrickSums,
    point: &SurfacePoint,
) -> DVec3 {
    // In a thin skin both sides are outside: what the sum shows is the grid, not the surface.
    if !map.thin {
        let floor = point.cells.floor();
        let home = [floor.x as i32, floor.y as i32, floor.z as i32];
        let sum = sums.get(home).unwrap_or_else(|| sum_by_look_up(&map.layers, home));
        // A wall thinner than the neighbourhood looks the same from both sides: no direction. All
        // components are integers.
        if sum != DVec3::ZERO {
            return sum.normalize();
        }
    }
    let [a, b, c] = mesh.corners(point.triangle_idx as usize);
    let outward =
        (b - a).cross(c - a).normalize_or_zero() * map.orientation.sign(point.triangle_idx);
    if outward == DVec3::ZERO { DVec3::Z } else { -outward }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::primitives::Shape;
    use crate::mesh::validate::inspect;
    use crate::voxmap::Options;
    use crate::voxmap::inside_test::InsideTest;

    #[test]
    fn the_sums_of_a_brick_are_those_of_the_definition() {
        let meshes = [
            Shape::Torus { major_m: 0.02, minor_m: 0.006 }.tessellate(1e-5),
            Shape::Box { size_m: DVec3::new(0.03, 0.004, 0.0205) }.tessellate(1e-5),
        ];
        for (mesh, layers) in meshes.iter().flat_map(|mesh| [1, 2, 5].map(|layers| (mesh, layers)))
        {
            let options =
                Options { voxel_size_m: 1e-3, layers, navigation: None, sides: InsideTest::Auto };
            let map =
                Volume::build(mesh, &inspect(mesh), &options, |_| ()).expect("a grid that fits");
            let mut sums = BrickSums::default();
            for brick in 0..map.surface.grid.n_bricks() {
                sums.form(&map.layers, brick);
                for inside in 0..BRICK_CELLS {
                    let cell =
                        crate::voxmap::grid::cell_of(map.surface.grid.brick_coord(brick), inside);
                    assert_eq!(
                        sums.get(cell),
                        Some(sum_by_look_up(&map.layers, cell)),
                        "{layers} layers, {cell:?}"
                    );
                }
                let [x, y, z] = sums.origin;
                for around in [
                    [x - 1, y, z],
                    [x + 8, y - 1, z + 3],
                    [x - 1, y + 8, z + 8],
                    [x + 4, y + 2, z + 8],
                ] {
                    assert_eq!(
                        sums.get(around),
                        Some(sum_by_look_up(&map.layers, around)),
                        "{layers} layers, {around:?}"
                    );
                }
                assert_eq!([sums.get([x - 2, y, z]), sums.get([x, y, z + 9])], [None; 2]);
            }
        }
    }
}
