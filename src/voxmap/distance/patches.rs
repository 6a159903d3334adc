//! Triangles as the kernel reads them: one cache line each, in cells, in a frame of their own.
//!
//! The longest edge is the first axis, the height over it the second. There the closest point is a question in the plane that
//! needs no division and stays well conditioned however thin the triangle is. Lengths are `f32`: the anchor is a whole cell, so
//! the way from it to a cell centre is exact, and triangles longer than [`EDGE_MAX_CELLS`] are cut, so that rounding stays below
//! 10⁻⁵ cells on any grid.

use core::ops::RangeInclusive;

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use crate::mesh::TriangleMesh;
use crate::voxmap::grid::Grid;

/// No patch, no triangle.
pub(super) const NONE: u32 = u32::MAX;
/// Longest edge of a patch, cells.
const EDGE_MAX_CELLS: f64 = 32.0;
/// Height over the longest edge below which a triangle is a segment, cells; cell coordinates are rounded to a hundredth of it.
const FLAT_CELLS: f64 = 1e-9;

/// A triangle, or a piece of a large one.
///
/// | word | content |
/// |---|---|
/// | 0, 1 | anchor cell: x in the low, y in the high half of word 0; z in the low half of word 1 |
/// | 1, high half | which edge of the triangle is the longest; 3 for a piece of a triangle that was cut |
/// | 2–4 | first corner minus the anchor's centre |
/// | 5–7 | `right`: unit vector along the longest edge |
/// | 8–10 | `up`: unit vector to the apex, square to `right`; `right × up` is the winding normal |
/// | 11 | length of the longest edge |
/// | 12, 13 | apex along `right` and `up`, from the first corner |
/// | 14, 15 | inverse squared lengths of the edges that end and start at the apex; 0 for an edge that is a point |
#[derive(Clone, Copy, Debug)]
#[repr(C, align(64))]
pub(super) struct Patch {
    pub(super) words: [u32; 16],
}

impl Patch {
    /// Prepares three corners given in cells; any will do.
    fn new(corners: &[DVec3; 3], is_piece: bool) -> Self {
        let edge_squared = |k: usize| (corners[(k + 1) % 3] - corners[k]).length_squared();
        let longest = (1..3).fold(0, |longest, k| if edge_squared(k) > edge_squared(longest) { k } else { longest });
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
        let inverse_square = |x: f64| {
            let squared = x * x + height * height;
            if squared > FLAT_CELLS * FLAT_CELLS { squared.recip() } else { 0.0 }
        };
        let mut words = [0; 16];
        // A negative coordinate does not occur: the grid is padded.
        words[0] = anchor.x as u32 | (anchor.y as u32) << 16;
        words[1] = anchor.z as u32 | if is_piece { 3 } else { longest as u32 } << 16;
        let numbers = [offset.to_array(), right.to_array(), up.to_array(), [length, along, height]];
        for (word, number) in words[2..14].iter_mut().zip(numbers.as_flattened()) {
            *word = (*number as f32).to_bits();
        }
        words[14] = (inverse_square(along - length) as f32).to_bits();
        words[15] = (inverse_square(along) as f32).to_bits();
        Self { words }
    }

    fn vector(&self, first: usize) -> Vec3 {
        Vec3::from_array(core::array::from_fn(|k| self.number(first + k)))
    }

    /// Word 2 or later as the number that it is.
    pub(super) fn number(&self, word: usize) -> f32 {
        f32::from_bits(self.words[word])
    }

    pub(super) fn anchor(&self) -> [i32; 3] {
        [self.words[0] & 0xffff, self.words[0] >> 16, self.words[1] & 0xffff].map(|i| i as i32)
    }

    /// Unit winding normal; arbitrary for a segment.
    pub(super) fn normal(&self) -> Vec3 {
        self.vector(5).cross(self.vector(8))
    }

    /// Cells, per axis, whose centres lie in the patch's box padded by `pad_cells`; may leave the grid.
    pub(super) fn cells_near(&self, pad_cells: f32) -> [RangeInclusive<i32>; 3] {
        let (first, right) = (self.vector(2), self.vector(5));
        let second = first + right * self.number(11);
        let apex = first + right * self.number(12) + self.vector(8) * self.number(13);
        let low = (first.min(second).min(apex) - pad_cells).ceil();
        let high = (first.max(second).max(apex) + pad_cells).floor();
        let anchor = self.anchor();
        [0, 1, 2].map(|axis| anchor[axis] + low[axis] as i32..=anchor[axis] + high[axis] as i32)
    }

    /// Signed distance of a point (cells, relative to the centre of cell 0) to the patch's plane, cells; for culling.
    pub(super) fn height_of(&self, point: Vec3) -> f32 {
        let anchor = Vec3::from_array(self.anchor().map(|i| i as f32));
        self.normal().dot(point - anchor - self.vector(2))
    }
}

/// All patches of a mesh.
pub(super) struct Patches {
    /// One per triangle, then the further pieces of those that were cut.
    pub(super) all: Vec<Patch>,
    /// Triangle of each further piece.
    triangles_of_pieces: Vec<u32>,
    n_triangles: usize,
    /// `[n_triangles]`: triangle across the edge that starts at each corner, or [`NONE`].
    neighbours: Vec<[u32; 3]>,
}

impl Patches {
    /// Cost: O(triangles), plus the pieces of those that are longer than [`EDGE_MAX_CELLS`].
    pub(super) fn new(mesh: &TriangleMesh, grid: &Grid) -> Self {
        let prepare = || {
            let in_cells = |triangle_idx: usize| mesh.corners(triangle_idx).map(|corner| grid.to_cells(corner));
            let is_cut = |corners: &[DVec3; 3]| longest_edge(corners).1 > EDGE_MAX_CELLS;
            let mut all: Vec<Patch> = (0..mesh.triangles.len())
                .into_par_iter()
                .map(|triangle_idx| {
                    let corners = in_cells(triangle_idx);
                    Patch::new(&corners, is_cut(&corners))
                })
                .collect();
            let cut: Vec<u32> = (0..mesh.triangles.len() as u32)
                .into_par_iter()
                .filter(|triangle_idx| all[*triangle_idx as usize].words[1] >> 16 == 3)
                .collect();
            let mut triangles_of_pieces = Vec::new();
            for triangle_idx in cut {
                let mut rest = vec![in_cells(triangle_idx as usize)];
                let mut is_first = true;
                while let Some(corners) = rest.pop() {
                    let (longest, length) = longest_edge(&corners);
                    if length > EDGE_MAX_CELLS {
                        let [from, to, apex] = [0, 1, 2].map(|k| corners[(longest + k) % 3]);
                        let middle = 0.5 * (from + to);
                        rest.extend([[from, middle, apex], [middle, to, apex]]);
                    } else if core::mem::take(&mut is_first) {
                        all[triangle_idx as usize] = Patch::new(&corners, true);
                    } else {
                        all.push(Patch::new(&corners, true));
                        triangles_of_pieces.push(triangle_idx);
                    }
                }
            }
            (all, triangles_of_pieces)
        };
        let ((all, triangles_of_pieces), neighbours) = rayon::join(prepare, || neighbours(mesh));
        Self { all, triangles_of_pieces, n_triangles: mesh.triangles.len(), neighbours }
    }

    /// The triangle that a patch is or belongs to.
    pub(super) fn triangle(&self, patch_idx: u32) -> u32 {
        match (patch_idx as usize).checked_sub(self.n_triangles) {
            None => patch_idx,
            Some(piece) => self.triangles_of_pieces[piece],
        }
    }

    /// The patch across edge `edge` of a patch, counted from its longest; [`NONE`] where there is none or the triangle was cut.
    pub(super) fn across(&self, patch_idx: u32, edge: usize) -> u32 {
        match self.all[patch_idx as usize].words[1] >> 16 {
            3 => NONE,
            longest => self.neighbours[patch_idx as usize][(longest as usize + edge) % 3],
        }
    }
}

/// Which edge is the longest, and its length.
fn longest_edge(corners: &[DVec3; 3]) -> (usize, f64) {
    let length = |k: usize| (corners[(k + 1) % 3] - corners[k]).length();
    (1..3).map(|k| (k, length(k))).fold((0, length(0)), |longest, edge| if edge.1 > longest.1 { edge } else { longest })
}

/// Matches the edges of a mesh: edges are put in buckets by their lower vertex and sorted there by the other. Where more than two
/// triangles share an edge they pair up in order.
fn neighbours(mesh: &TriangleMesh) -> Vec<[u32; 3]> {
    let edges = || {
        mesh.triangles.iter().enumerate().flat_map(|(triangle_idx, corners)| {
            (0..3).map(move |k| {
                let (a, b) = (corners[k], corners[(k + 1) % 3]);
                (a.min(b), a.max(b), (triangle_idx * 3 + k) as u64)
            })
        })
    };
    let mut ends = vec![0_u32; mesh.vertices.len() + 1];
    edges().for_each(|(low, _, _)| ends[low as usize + 1] += 1);
    for vertex in 1..ends.len() {
        ends[vertex] += ends[vertex - 1];
    }
    // The higher vertex above, three times the triangle plus the edge below; each bucket starts where the one before it ends.
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
