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
/// | 0, 1 | anchor cell: x in the low, y in the high half of word 0; z in the low half of word 1 |
/// | 1, high half | which edge of the triangle, or of the piece, is the longest |
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
        words[1] = anchor.z as u32 | (longest as u32) << 16;
        let numbers = [offset.to_array(), right.to_array(), up.to_array(), [length, along, height]];
        for (word, number) in words[2..14].iter_mut().zip(numbers.as_flattened()) {
            *word = (*number as f32).to_bits();
        }
        words[14] = inverse_length(length).to_bits();
        words[15] = inverse_length(0.0).to_bits();
        Self { words }
    }

    /// Which edge of the corners is the longest.
    fn longest(&self) -> usize {
        (self.words[1] >> 16) as usize
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
        [self.words[0] & 0xffff, self.words[0] >> 16, self.words[1] & 0xffff].map(|i| i as i32)
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
    /// `[n_patches]`: patch across each edge, counted from the longest; [`NONE`] where there is
    /// none.
    across: Vec<[u32; 3]>,
}

impl Patches {
    /// Cost: O(triangles) and a parallel sort of them, plus the pieces of those that are longer
    /// than [`EDGE_MAX_CELLS`].
    pub(super) fn new(mesh: &TriangleMesh, grid: &Grid) -> Self {
        let ((pieces, order), neighbours) = rayon::join(
            || {
                let pieces = Pieces::new(mesh, grid);
                let mut keyed = parallel::map(pieces.all.len(), 1, |piece| {
                    (curve(&pieces.all[piece]), piece as u32)
                });
                keyed.par_sort_unstable();
                (pieces, keyed)
            },
            || neighbours(mesh),
        );
        let mut places = vec![NONE; pieces.all.len()];
        for (place, (_, piece)) in order.iter().enumerate() {
            places[*piece as usize] = place as u32;
        }
        let all = parallel::map(order.len(), 1, |place| pieces.all[order[place].1 as usize]);
        let triangles = parallel::map(order.len(), 1, |place| pieces.triangle(order[place].1));
        let across_pieces = pieces.across(mesh, grid, neighbours);
        let place = |piece: u32| if piece == NONE { NONE } else { places[piece as usize] };
        let across = parallel::map(order.len(), 1, |patch_idx| {
            let across = &across_pieces[order[patch_idx].1 as usize];
            core::array::from_fn(|edge| place(across[(all[patch_idx].longest() + edge) % 3]))
        });
        Self { all, triangles, across }
    }

    /// The triangle that a patch is or belongs to.
    pub(super) fn triangle(&self, patch_idx: u32) -> u32 {
        self.triangles[patch_idx as usize]
    }

    /// The patches across the edges of a patch, from its longest on; [`NONE`] where there is none.
    #[inline]
    pub(super) fn across(&self, patch_idx: u32) -> &[u32; 3] {
        &self.across[patch_idx as usize]
    }
}

/// Triangles, and pieces of those that were cut.
struct Pieces {
    /// One per triangle, then the further pieces of those that were cut.
    all: Vec<Patch>,
    /// The triangles of these further pieces.
    triangles: Vec<u32>,
    /// Every piece of a cut triangle, and its corners in cells.
    cut: Vec<(u32, [DVec3; 3])>,
}

impl Pieces {
    /// Cuts at the middle of the longest edge until none is longer than [`EDGE_MAX_CELLS`].
    ///
    /// Whether an edge is cut depends on its length alone, so pieces on both sides of one meet edge
    /// to edge.
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
        let mut cut = Vec::new();
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
                let piece =
                    if core::mem::take(&mut is_first) { triangle_idx } else { all.len() as u32 };
                if piece == triangle_idx {
                    all[triangle_idx as usize] = Patch::new(&corners);
                } else {
                    all.push(Patch::new(&corners));
                    triangles.push(triangle_idx);
                }
                cut.push((piece, corners));
            }
        }
        Self { all, triangles, cut }
    }

    /// The triangle that a piece is or belongs to.
    fn triangle(&self, piece: u32) -> u32 {
        let n_triangles = self.all.len() - self.triangles.len();
        (piece as usize).checked_sub(n_triangles).map_or(piece, |more| self.triangles[more])
    }

    /// The pieces across the edges of each, from those across the edges of the triangles.
    fn across(&self, mesh: &TriangleMesh, grid: &Grid, neighbours: Vec<[u32; 3]>) -> Vec<[u32; 3]> {
        let mut across = neighbours;
        let mut beside: Vec<u32> = Vec::new();
        across.resize(self.all.len(), [NONE; 3]);
        for (piece, _) in &self.cut {
            beside.extend(across[*piece as usize].iter().filter(|neighbour| **neighbour != NONE));
        }
        self.cut.iter().for_each(|(piece, _)| across[*piece as usize] = [NONE; 3]);
        beside.sort_unstable();
        beside.dedup();
        let mut is_cut: Vec<u32> = self.cut.iter().map(|(piece, _)| *piece).collect();
        is_cut.sort_unstable();
        beside.retain(|triangle_idx| is_cut.binary_search(triangle_idx).is_err());
        let whole = beside
            .iter()
            .map(|triangle_idx| (*triangle_idx, in_cells(mesh, grid, *triangle_idx as usize)));
        // Both ends of an edge, the smaller first; then whose edge it is, and which.
        let mut edges: Vec<([[u64; 3]; 2], u32, u8)> =
            Vec::with_capacity(3 * (self.cut.len() + beside.len()));
        for (piece, corners) in self.cut.iter().copied().chain(whole) {
            // Zeros have one sign here: coordinates in cells are not negative.
            let ends = corners.map(|corner| corner.to_array().map(f64::to_bits));
            for k in 0..3 {
                let a = ends[k];
                let b = ends[(k + 1) % 3];
                edges.push(([a.min(b), a.max(b)], piece, k as u8));
            }
        }
        edges.par_sort_unstable();
        let mut rest = &*edges;
        while let [a, b, ..] = rest {
            let is_pair = a.0 == b.0;
            if is_pair {
                across[a.1 as usize][usize::from(a.2)] = b.1;
                across[b.1 as usize][usize::from(b.2)] = a.1;
            }
            rest = &rest[if is_pair { 2 } else { 1 }..];
        }
        across
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

/// Matches the edges of a mesh: edges are put in buckets by their lower vertex and sorted there by
/// the other. Where more than two triangles share an edge they pair up in order.
fn neighbours(mesh: &TriangleMesh) -> Vec<[u32; 3]> {
    let edges = || {
        mesh.triangles.iter().enumerate().flat_map(|(triangle_idx, corners)| {
            (0..3).map(move |k| {
                let a = corners[k];
                let b = corners[(k + 1) % 3];
                (a.min(b), a.max(b), (triangle_idx * 3 + k) as u64)
            })
        })
    };
    let mut ends = vec![0_u32; mesh.vertices.len() + 1];
    edges().for_each(|(low, _, _)| ends[low as usize + 1] += 1);
    for vertex in 1..ends.len() {
        ends[vertex] += ends[vertex - 1];
    }
    // The higher vertex above, three times the triangle plus the edge below; each bucket starts
    // where the one before it ends.
    let mut sorted = vec![(0_u32, 0_u64); mesh.triangles.len() * 3];
    for (low, high, edge) in edges() {
        let place = &mut ends[low as usize];
        sorted[*place as usize] = (high, edge);
        *place += 1;
    }
    let mut neighbours = vec![[NONE; 3]; mesh.triangles.len()];
    let mut first = 0;
    for end in ends {
        let bucket = &mut sorted[first..end as usize];
        bucket.sort_unstable();
        let mut rest = &*bucket;
        while let [a, b, ..] = rest {
            let is_pair = a.0 == b.0;
            if is_pair {
                for (from, to) in [(a.1, b.1), (b.1, a.1)] {
                    neighbours[(from / 3) as usize][(from % 3) as usize] = (to / 3) as u32;
                }
            }
            rest = &rest[if is_pair { 2 } else { 1 }..];
        }
        first = end as usize;
    }
    neighbours
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::primitives::Shape;

    #[test]
    fn pieces_of_cut_triangles_meet_edge_to_edge() {
        let mesh = Shape::Box { size_m: DVec3::new(0.2, 0.1, 0.01) }.tessellate(1e-3);
        let (low, high) = mesh.bounds().expect("a box has triangles");
        let grid = Grid::around(low, high, 1e-3, 3).expect("a small grid");
        let patches = Patches::new(&mesh, &grid);
        assert!(
            patches.all.len() > 4 * mesh.triangles.len(),
            "nothing was cut: {} patches",
            patches.all.len()
        );
        for (patch_idx, across) in patches.across.iter().enumerate() {
            for neighbour in across {
                assert_ne!(*neighbour, NONE, "patch {patch_idx} of a closed mesh ends in nothing");
                assert!(
                    patches.across(*neighbour).contains(&(patch_idx as u32)),
                    "{patch_idx} and {neighbour}"
                );
            }
        }
    }
}
