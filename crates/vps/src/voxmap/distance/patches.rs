//! Triangles as the kernel reads them: one cache line each, in cells, in a frame of their own.
//!
//! The longest edge is the first axis, the height over it the second. There the closest point is a
//! question in the plane that needs no division and stays well conditioned however thin the
//! triangle is. Lengths are `f32`: the anchor is a whole cell, so the way from it to a cell centre
//! is exact, and triangles longer than [`EDGE_MAX_CELLS`] are cut, so that rounding stays below
//! 10⁻⁵ cells on any grid.

use core::ops::RangeInclusive;

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::mesh::TriangleMesh;
use crate::parallel;
use crate::voxmap::grid::Grid;

/// No patch, no triangle.
pub(super) const NONE: u32 = u32::MAX;
/// Steps of the curve that orders the patches, per cell.
const CURVE_STEPS: f32 = 4.0;
/// Longest edge of a patch, cells.
const EDGE_MAX_CELLS: f64 = 32.0;
/// Height over the longest edge below which a triangle is a segment, cells; cell coordinates are
/// rounded to a hundredth of it.
const FLAT_CELLS: f64 = 1e-9;

/// A triangle, or a piece of a large one.
///
/// | word | content |
/// |---|---|
/// | 0, 1 | anchor cell: x in the low, y in the high half of word 0; z is word 1 |
/// | 2–4 | first corner minus the anchor's centre |
/// | 5–7 | `right`: unit vector along the longest edge |
/// | 8–10 | `up`: unit vector to the apex, square to `right`; `right × up` is the winding normal |
/// | 11 | length of the longest edge |
/// | 12, 13 | apex along `right` and `up`, from the first corner |
/// | 14, 15 | inverse lengths of the edges that end and start at the apex; 0 for an edge that is a point |
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(super) struct Patch {
    pub(super) words: [u32; 16],
}

impl Patch {
    /// Prepares three corners given in cells; any will do.
    fn new(corners: &[DVec3; 3]) -> Self {
        let edge_squared = |k: usize| (corners[(k + 1) % 3] - corners[k]).length_squared();
        let longest =
            (1..3).fold(
                0,
                |longest, k| if edge_squared(k) > edge_squared(longest) { k } else { longest },
            );
        let [first, second, apex] = [0, 1, 2].map(|k| corners[(longest + k) % 3]);
        let base = second - first;
        let length = base.length();
        let right = if length > 0.0 { base / length } else { DVec3::X };
        let along = (apex - first).dot(right).clamp(0.0, length);
        let height = apex - first - right * along;
        let (up, height) = match height.length() {
            height_cells if height_cells > FLAT_CELLS => (height / height_cells, height_cells),
            _ => (right.any_orthonormal_vector(), 0.0),
        };
        let anchor = first.floor();
        let offset = first - anchor - 0.5;
        // Of the rounded numbers, from which the kernel makes unit vectors.
        let inverse_length = |from: f64| {
            let along = along as f32 - from as f32;
            let height = height as f32;
            let squared = along * along + height * height;
            if squared > (FLAT_CELLS * FLAT_CELLS) as f32 { squared.sqrt().recip() } else { 0.0 }
        };
        let mut words = [0; 16];
        // A negative coordinate does not occur: the grid is padded.
        words[0] = anchor.x as u32 | (anchor.y as u32) << 16;
        words[1] = anchor.z as u32;
        let numbers = [offset.to_array(), right.to_array(), up.to_array(), [length, along, height]];
        for (word, number) in words[2..14].iter_mut().zip(numbers.as_flattened()) {
            *word = (*number as f32).to_bits();
        }
        words[14] = inverse_length(length).to_bits();
        words[15] = inverse_length(0.0).to_bits();
        Self { words }
    }

    #[inline(always)]
    fn vector(&self, first: usize) -> Vec3 {
        Vec3::from_array(core::array::from_fn(|k| self.number(first + k)))
    }

    /// Word 2 or later as the number that it is.
    #[inline(always)]
    pub(super) fn number(&self, word: usize) -> f32 {
        f32::from_bits(self.words[word])
    }

    #[inline(always)]
    pub(super) fn anchor(&self) -> [i32; 3] {
        [self.words[0] & 0xffff, self.words[0] >> 16, self.words[1]].map(|i| i as i32)
    }

    /// Over its longest edge, cells.
    pub(super) fn height(&self) -> f32 {
        self.number(13)
    }

    /// Unit winding normal; arbitrary for a segment.
    pub(super) fn normal(&self) -> Vec3 {
        self.vector(5).cross(self.vector(8))
    }

    /// Cells, per axis, whose centres lie in the patch's box padded by `pad_cells`; may leave the
    /// grid.
    #[inline(always)]
    pub(super) fn cells_near(&self, pad_cells: f32) -> [RangeInclusive<i32>; 3] {
        let (low, high) = self.box_at_anchor(pad_cells);
        let anchor = self.anchor();
        [0, 1, 2].map(|axis| {
            anchor[axis] + low[axis].ceil() as i32..=anchor[axis] + high[axis].floor() as i32
        })
    }

    /// Lowest and highest corner of the patch's box padded by `pad_cells`, relative to the centre
    /// of cell 0, cells.
    pub(super) fn bounds(&self, pad_cells: f32) -> ([f32; 3], [f32; 3]) {
        let (low, high) = self.box_at_anchor(pad_cells);
        let anchor = Vec3::from_array(self.anchor().map(|i| i as f32));
        ((anchor + low).to_array(), (anchor + high).to_array())
    }

    /// The same relative to the centre of the anchor.
    #[inline(always)]
    fn box_at_anchor(&self, pad_cells: f32) -> (Vec3, Vec3) {
        let first = self.vector(2);
        let right = self.vector(5);
        let second = first + right * self.number(11);
        let apex = first + right * self.number(12) + self.vector(8) * self.number(13);
        (first.min(second).min(apex) - pad_cells, first.max(second).max(apex) + pad_cells)
    }

    /// Signed distance of a point (cells, relative to the centre of cell 0) to the patch's plane,
    /// cells; for culling.
    pub(super) fn height_of(&self, point: Vec3) -> f32 {
        let anchor = Vec3::from_array(self.anchor().map(|i| i as f32));
        self.normal().dot(point - anchor - self.vector(2))
    }
}

/// All patches of a mesh, in the order of a space-filling curve: what is near in space is near in
/// memory.
pub(super) struct Patches {
    /// One per triangle, and more for those that are cut.
    pub(super) all: Vec<Patch>,
    /// `[n_patches]`: the triangle that a patch is or belongs to.
    triangles: Vec<u32>,
}

impl Patches {
    /// Cost: O(triangles) and a parallel sort of them, plus the pieces of those that are longer
    /// than [`EDGE_MAX_CELLS`].
    pub(super) fn new(mesh: &TriangleMesh, grid: &Grid) -> Self {
        let pieces = Pieces::new(mesh, grid);
        let mut order =
            parallel::map(pieces.all.len(), 1, |piece| (curve(&pieces.all[piece]), piece as u32));
        order.par_sort_unstable();
        let all = parallel::map(order.len(), 1, |place| pieces.all[order[place].1 as usize]);
        let triangles = parallel::map(order.len(), 1, |place| pieces.triangle(order[place].1));
        Self { all, triangles }
    }

    /// The triangle that a patch is or belongs to.
    pub(super) fn triangle(&self, patch_idx: u32) -> u32 {
        self.triangles[patch_idx as usize]
    }
}

/// Triangles, and pieces of those that were cut.
struct Pieces {
    /// One per triangle, then the further pieces of those that were cut.
    all: Vec<Patch>,
    /// The triangles of these further pieces.
    triangles: Vec<u32>,
}

impl Pieces {
    /// Cuts at the middle of the longest edge until none is longer than [`EDGE_MAX_CELLS`].
    fn new(mesh: &TriangleMesh, grid: &Grid) -> Self {
        let is_cut = |corners: &[DVec3; 3]| longest_edge(corners).1 > EDGE_MAX_CELLS;
        let mut all = parallel::map(mesh.triangles.len(), 1, |triangle_idx| {
            Patch::new(&in_cells(mesh, grid, triangle_idx))
        });
        let is_long =
            parallel::map(all.len(), 1, |triangle_idx| is_cut(&in_cells(mesh, grid, triangle_idx)));
        let long = (0..)
            .zip(is_long)
            .filter_map(|(triangle_idx, is_long)| is_long.then_some(triangle_idx));
        let mut triangles = Vec::new();
        for triangle_idx in long {
            let mut rest = vec![in_cells(mesh, grid, triangle_idx as usize)];
            let mut is_first = true;
            while let Some(corners) = rest.pop() {
                let (longest, length) = longest_edge(&corners);
                if length > EDGE_MAX_CELLS {
                    let [from, to, apex] = [0, 1, 2].map(|k| corners[(longest + k) % 3]);
                    let middle = 0.5 * (from + to);
                    rest.extend([[from, middle, apex], [middle, to, apex]]);
                    continue;
                }
                if core::mem::take(&mut is_first) {
                    all[triangle_idx as usize] = Patch::new(&corners);
                } else {
                    all.push(Patch::new(&corners));
                    triangles.push(triangle_idx);
                }
            }
        }
        Self { all, triangles }
    }

    /// The triangle that a piece is or belongs to.
    fn triangle(&self, piece: u32) -> u32 {
        let n_triangles = self.all.len() - self.triangles.len();
        (piece as usize).checked_sub(n_triangles).map_or(piece, |more| self.triangles[more])
    }
}

fn in_cells(mesh: &TriangleMesh, grid: &Grid, triangle_idx: usize) -> [DVec3; 3] {
    mesh.corners(triangle_idx).map(|corner| grid.to_cells(corner))
}

/// Place of a patch's middle on a space-filling curve (Morton 1966).
fn curve(patch: &Patch) -> u64 {
    let (low, high) = patch.bounds(0.0);
    [0, 1, 2].iter().fold(0, |key, axis| {
        key | spread(((low[*axis] + high[*axis]) * 0.5 * CURVE_STEPS) as u32) << axis
    })
}

/// Puts two zero bits between the lowest 21 bits of a number.
fn spread(number: u32) -> u64 {
    let mut bits = u64::from(number) & 0x1f_ffff;
    for (shift, mask) in [
        (32, 0x001f_0000_0000_ffff),
        (16, 0x001f_0000_ff00_00ff),
        (8, 0x100f_00f0_0f00_f00f),
        (4, 0x10c3_0c30_c30c_30c3),
        (2, 0x1249_2492_4924_9249),
    ] {
        bits = (bits | bits << shift) & mask;
    }
    bits
}

/// Which edge is the longest, and its length.
fn longest_edge(corners: &[DVec3; 3]) -> (usize, f64) {
    let length = |k: usize| (corners[(k + 1) % 3] - corners[k]).length();
    (1..3)
        .map(|k| (k, length(k)))
        .fold((0, length(0)), |longest, edge| if edge.1 > longest.1 { edge } else { longest })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::primitives::Shape;

    #[test]
    fn pieces_of_a_cut_triangle_are_short_and_have_its_area() {
        let mesh = Shape::Box { size_m: DVec3::new(0.2, 0.1, 0.01) }.tessellate(1e-3);
        let (low, high) = mesh.bounds().expect("a box has triangles");
        let grid = Grid::around(low, high, 1e-3, 3).expect("a small grid");
        let patches = Patches::new(&mesh, &grid);
        let mut areas = vec![0.0; mesh.triangles.len()];
        for (patch, triangle_idx) in patches.all.iter().zip(&patches.triangles) {
            assert!(patch.number(11) <= EDGE_MAX_CELLS as f32, "{patch:?}");
            areas[*triangle_idx as usize] += 0.5 * f64::from(patch.number(11) * patch.number(13));
        }
        for (triangle_idx, area) in areas.into_iter().enumerate() {
            let [a, b, c] = in_cells(&mesh, &grid, triangle_idx);
            let expected = 0.5 * (b - a).cross(c - a).length();
            assert!((area - expected).abs() < 1e-3 * expected, "{area} of {expected} cells²");
        }
    }
}
