//! Distances of eight points to a patch, without branches.
//!
//! # Source
//! Ours. In the patch's own frame the triangle is (0, 0), (length, 0), apex with 0 ≤ apex.x ≤
//! length, because the first edge is the longest. Three orientation tests tell whether the foot
//! lies inside; otherwise the nearest of three segments counts. No test decides more than rounding
//! is worth: next to an edge both answers agree. Unit vectors along the edges give the distance to
//! an edge and the side of it from one pair of products; they come from the rounded corners, so
//! that they are unit vectors however short the edge.

use super::patches::{NONE, Patch};
use crate::simd::{F32x8, I32s, LANES};

/// A patch must be nearer by this share to replace another: rounding must not decide which of two
/// that tie is found first.
const NEARER: f32 = 1.0 - 1e-6;
/// Eight cells at the corners of a cube: lane x·4 + y·2 + z is the cell `base + step·[x, y, z]`.
#[derive(Clone, Copy)]
pub(super) struct Cube {
    /// The first of them.
    pub(super) base: [i32; 3],
    /// From one to the next, cells.
    pub(super) step: i32,
}

/// Of each axis, how far eight cells at the corners of a cube lie from the first, cells.
#[inline(always)]
pub(super) fn offsets<I: I32s<LANES>>(step: i32) -> [I; 3] {
    const ONE: u32 = u32::MAX;
    let step = I::splat(step);
    [
        step & I::load(&[0, 0, 0, 0, ONE, ONE, ONE, ONE]),
        step & I::load(&[0, 0, ONE, ONE, 0, 0, ONE, ONE]),
        step & I::load(&[0, ONE, 0, ONE, 0, ONE, 0, ONE]),
    ]
}

/// The nearest patches of eight cells so far.
#[derive(Clone, Copy)]
pub(super) struct NearestOfEight<L: F32x8> {
    /// Cells².
    pub(super) squared: L,
    pub(super) patch_idx: L::Int,
}

impl<L: F32x8> NearestOfEight<L> {
    /// Nothing found, infinitely far away.
    #[inline(always)]
    pub(super) fn none() -> Self {
        Self { squared: L::splat(f32::INFINITY), patch_idx: L::Int::splat(NONE as i32) }
    }

    /// Measures cells at places in the frame of a patch, which replaces the nearest of those that
    /// it is nearer to.
    #[inline(always)]
    pub(super) fn measure(&mut self, patch: &WidePatch<L>, patch_idx: u32, places: [L; 3]) {
        let squared = patch.nearest(places).squared;
        let is_nearer = squared.lt(self.squared * L::splat(NEARER));
        // A minimum, and no choice by the mask: that was compiled to a masked store, and waiting
        // for it took a quarter of the time of all blocks.
        self.squared = squared.min(self.squared);
        self.patch_idx = L::Int::select(is_nearer, L::Int::splat(patch_idx as i32), self.patch_idx);
    }

    /// The same with the cells of a cube.
    #[inline(always)]
    pub(super) fn measure_cube(&mut self, patch: &Patch, patch_idx: u32, cube: Cube) {
        let patch = WidePatch::new(patch);
        self.measure(&patch, patch_idx, patch.place(cube.base, offsets(cube.step)));
    }
}

/// A patch in every lane, read once for all cells that are measured against it.
pub(super) struct WidePatch<L> {
    anchor: [i32; 3],
    first: [L; 3],
    right: [L; 3],
    up: [L; 3],
    normal: [L; 3],
    length: L,
    /// The edges that end and start at the apex: unit vectors from their lower ends on, and
    /// lengths.
    second: Edge<L>,
    third: Edge<L>,
}

/// Direction of unit length and length of an edge, in the plane of the patch; an edge that is a
/// point has any direction.
struct Edge<L> {
    x: L,
    y: L,
    length: L,
}

/// A point as seen from an edge.
struct FromEdge<L> {
    /// Of the distance, cells².
    squared: L,
    /// How far along the line of the edge the point lies past the nearer end, cells; 0 beside it.
    beyond: L,
    /// How far to the right of the line, cells.
    right: L,
}

impl<L: F32x8> Edge<L> {
    #[inline(always)]
    fn new([x, y]: [L; 2], inverse_length: L) -> Self {
        let x_unit = L::select(L::splat(0.0).lt(inverse_length), x * inverse_length, L::splat(1.0));
        Self { x: x_unit, y: y * inverse_length, length: (x * x + y * y) * inverse_length }
    }

    /// Where a point given from the edge's start on lies.
    #[inline(always)]
    fn from(&self, [x, y]: [L; 2]) -> FromEdge<L> {
        let along = x * self.x + y * self.y;
        let right = x * self.y - y * self.x;
        let beyond = along - along.max(L::splat(0.0)).min(self.length);
        FromEdge { squared: beyond * beyond + right * right, beyond, right }
    }

    /// The way to such a point from the closest point of the edge.
    #[inline(always)]
    fn away(&self, from: &FromEdge<L>) -> [L; 2] {
        [from.beyond * self.x + from.right * self.y, from.beyond * self.y - from.right * self.x]
    }
}

impl<L: F32x8> WidePatch<L> {
    #[inline(always)]
    pub(super) fn new(patch: &Patch) -> Self {
        let mut numbers = [L::splat(0.0); 14];
        for (k, number) in numbers.iter_mut().enumerate() {
            *number = L::splat(patch.number(2 + k));
        }
        let [
            o_x,
            o_y,
            o_z,
            r_x,
            r_y,
            r_z,
            u_x,
            u_y,
            u_z,
            length,
            apex_x,
            apex_y,
            inverse_second,
            inverse_third,
        ] = numbers;
        Self {
            anchor: patch.anchor(),
            first: [o_x, o_y, o_z],
            right: [r_x, r_y, r_z],
            up: [u_x, u_y, u_z],
            normal: [r_y * u_z - r_z * u_y, r_z * u_x - r_x * u_z, r_x * u_y - r_y * u_x],
            length,
            second: Edge::new([apex_x - length, apex_y], inverse_second),
            third: Edge::new([apex_x, apex_y], inverse_third),
        }
    }

    /// The centres of the cells `base + offsets` in the frame of the patch. Whole cells are
    /// subtracted as whole numbers, which is exact.
    #[inline(always)]
    pub(super) fn place(&self, base: [i32; 3], offsets: [L::Int; 3]) -> [L; 3] {
        let mut way = [L::splat(0.0); 3];
        for axis in 0..3 {
            let cells = offsets[axis] + L::Int::splat(base[axis] - self.anchor[axis]);
            way[axis] = L::of_int(cells) - self.first[axis];
        }
        self.turn(way)
    }

    /// A way in cells in the frame of the patch.
    #[inline(always)]
    fn turn(&self, way: [L; 3]) -> [L; 3] {
        [dot(self.right, way), dot(self.up, way), dot(self.normal, way)]
    }

    /// How far the eight cubes of a block lie from its first in the frame of the patch; `offsets`
    /// in cells.
    #[inline(always)]
    pub(super) fn steps(&self, offsets: [L::Int; 3]) -> [[f32; LANES]; 3] {
        let [x, y, z] = offsets;
        let mut steps = [[0.0; LANES]; 3];
        for (step, to) in
            self.turn([L::of_int(x), L::of_int(y), L::of_int(z)]).into_iter().zip(&mut steps)
        {
            step.store(to);
        }
        steps
    }

    /// From eight cells of the brick at `origin`, given by their numbers inside: squared distances
    /// (cells²), and distances to the plane of the patch, positive on the side of the winding
    /// normal (cells).
    #[inline(always)]
    pub(super) fn measure_cells(
        &self,
        origin: [i32; 3],
        cells: &[u32; LANES],
    ) -> ([f32; LANES], [f32; LANES]) {
        let inside = L::Int::load(cells);
        let seven = L::Int::splat(7);
        let offsets = [inside.shifted::<6>(), inside.shifted::<3>() & seven, inside & seven];
        let found = self.nearest(self.place(origin, offsets));
        let mut squared = [0.0; LANES];
        let mut height = [0.0; LANES];
        found.squared.store(&mut squared);
        found.height.store(&mut height);
        (squared, height)
    }

    /// From places in the frame of the patch.
    #[inline(always)]
    fn nearest(&self, [x, y, height]: [L; 3]) -> Nearest<L> {
        let zero = L::splat(0.0);
        let beyond = x - x.max(zero).min(self.length);
        let base = beyond * beyond + y * y;
        let second = self.second.from([x - self.length, y]);
        let third = self.third.from([x, y]);
        let inside = zero.lt(y) & second.right.lt(zero) & zero.lt(third.right);
        let in_plane = L::select(inside, zero, base.min(second.squared).min(third.squared));
        Nearest { squared: height * height + in_plane, height }
    }

    /// The ways from the closest points of the patch to points in centre coordinates, cells.
    #[inline(always)]
    pub(super) fn ways(&self, points: &[L; 3]) -> [L; 3] {
        let zero = L::splat(0.0);
        let mut way = [zero; 3];
        for axis in 0..3 {
            way[axis] = points[axis] - L::splat(self.anchor[axis] as f32) - self.first[axis];
        }
        let [x, y, height] = self.turn(way);
        let beyond = x - x.max(zero).min(self.length);
        let base = beyond * beyond + y * y;
        let second = self.second.from([x - self.length, y]);
        let third = self.third.from([x, y]);
        let of_second = self.second.away(&second);
        let of_third = self.third.away(&third);
        let inside = zero.lt(y) & second.right.lt(zero) & zero.lt(third.right);
        let on_second = second.squared.lt(base);
        let least = second.squared.min(base);
        let on_third = third.squared.lt(least);
        let mut in_plane = [beyond, y];
        for k in 0..2 {
            let on_edge = L::select(on_second, of_second[k], in_plane[k]);
            let on_edge = L::select(on_third, of_third[k], on_edge);
            in_plane[k] = L::select(inside, zero, on_edge);
        }
        let [x, y] = in_plane;
        let mut away = [zero; 3];
        for (axis, away) in away.iter_mut().enumerate() {
            *away = self.right[axis] * x + self.up[axis] * y + self.normal[axis] * height;
        }
        away
    }
}

/// The closest point of a patch, per lane.
struct Nearest<L> {
    /// Cells².
    squared: L,
    /// Along the winding normal, cells.
    height: L,
}

#[inline(always)]
fn dot<L: F32x8>(a: [L; 3], b: [L; 3]) -> L {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
