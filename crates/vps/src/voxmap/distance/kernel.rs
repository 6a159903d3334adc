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

/// Share of a squared distance by which two edges may differ and still both hold the closest point
/// (a corner).
const CORNER_SHARE: f32 = 1.0 + 1e-5;
/// The same next to the plane of the foot, cells².
const CORNER_CELLS_SQUARED: f32 = 1e-9;
/// A patch must be nearer by this share to replace another: rounding must not decide which of two
/// that tie is found first.
const NEARER: f32 = 1.0 - 1e-6;
/// Patches that are further away by no more than this share are as near, for a corner is equally
/// far on all patches around it.
const PLATEAU: f32 = 1.0 + 1e-5;
/// The same next to the surface, cells².
const PLATEAU_CELLS_SQUARED: f32 = 1e-9;

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
    pub(super) fn measure(
        &mut self,
        patch: &WidePatch<L>,
        patch_idx: u32,
        places: [L; 3],
    ) -> Measured<L> {
        let Nearest { squared, height: _, on_edge: [[a, a_limit], [b, b_limit], [c, c_limit]] } =
            patch.nearest(places);
        let found = Measured { squared, on_edge: [a.le(a_limit), b.le(b_limit), c.le(c_limit)] };
        let is_nearer = found.squared.lt(self.squared * L::splat(NEARER));
        // A minimum, and no choice by the mask: that was compiled to a masked store, and waiting
        // for it took a quarter of the time of all blocks.
        self.squared = found.squared.min(self.squared);
        self.patch_idx = L::Int::select(is_nearer, L::Int::splat(patch_idx as i32), self.patch_idx);
        found
    }

    /// The same with the cells of a cube.
    #[inline(always)]
    pub(super) fn measure_cube(&mut self, patch: &Patch, patch_idx: u32, cube: Cube) {
        let patch = WidePatch::new(patch);
        self.measure(&patch, patch_idx, patch.place(cube.base, offsets(cube.step)));
    }

    /// Up to which squared distance a patch is as near as the nearest, cells².
    #[inline(always)]
    pub(super) fn plateau(&self) -> L {
        self.squared * L::splat(PLATEAU) + L::splat(PLATEAU_CELLS_SQUARED)
    }
}

/// A patch as seen by eight cells.
#[derive(Clone, Copy)]
pub(super) struct Measured<L: F32x8> {
    /// Cells².
    pub(super) squared: L,
    /// A mask for each edge: the closest point lies on it.
    pub(super) on_edge: [L::Int; 3],
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

impl<L: F32x8> Edge<L> {
    #[inline(always)]
    fn new([x, y]: [L; 2], inverse_length: L) -> Self {
        let x_unit = L::select(L::splat(0.0).lt(inverse_length), x * inverse_length, L::splat(1.0));
        Self { x: x_unit, y: y * inverse_length, length: (x * x + y * y) * inverse_length }
    }

    /// Squared distance of a point given from the edge's start on, and how far to the right of its
    /// line the point lies.
    #[inline(always)]
    fn from(&self, [x, y]: [L; 2]) -> [L; 2] {
        let along = x * self.x + y * self.y;
        let right = x * self.y - y * self.x;
        let beyond = along - along.max(L::splat(0.0)).min(self.length);
        [beyond * beyond + right * right, right]
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
        let [second, right_of_second] = self.second.from([x - self.length, y]);
        let [third, right_of_third] = self.third.from([x, y]);
        let inside = zero.lt(y) & right_of_second.lt(zero) & zero.lt(right_of_third);
        let in_plane = L::select(inside, zero, base.min(second).min(third));
        let limit = in_plane * L::splat(CORNER_SHARE) + L::splat(CORNER_CELLS_SQUARED);
        Nearest {
            squared: height * height + in_plane,
            height,
            on_edge: [[base, limit], [second, limit], [third, limit]],
        }
    }
}

/// Where the closest point of a patch is, per lane.
struct Nearest<L> {
    /// Cells².
    squared: L,
    /// Along the winding normal, cells.
    height: L,
    /// Squared distance in the plane to each edge, and the largest with which the closest point
    /// counts as lying on it.
    on_edge: [[L; 2]; 3],
}

#[inline(always)]
fn dot<L: F32x8>(a: [L; 3], b: [L; 3]) -> L {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
