//! Distances of eight points to a patch, without branches.
//!
//! # Source
//! Ours. In the patch's own frame the triangle is (0, 0), (length, 0), apex with 0 ≤ apex.x ≤ length, because the first edge is
//! the longest. Three orientation tests tell whether the foot lies inside; otherwise the nearest of three segments counts. No
//! test decides more than rounding is worth: next to an edge both answers agree.

use super::patches::Patch;
use crate::simd::{F32x8, I32s, Kernel, LANES};

/// Share of a squared distance by which two edges may differ and still both hold the closest point (a corner).
const CORNER_SHARE: f32 = 1.0 + 1e-5;
/// The same next to the plane of the foot, cells².
const CORNER_CELLS_SQUARED: f32 = 1e-9;
/// A patch must be nearer by this share to replace another: rounding must not decide which of two that tie is found first.
const NEARER: f32 = 1.0 - 1e-6;
/// Patches that are further away by no more than this share are as near, for a corner is equally far on all patches around it.
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

/// The nearest patches of eight cells so far.
#[derive(Clone, Copy)]
pub(super) struct NearestOfEight {
    /// Cells².
    pub(super) squared: [f32; LANES],
    pub(super) patch_idx: [u32; LANES],
}

/// A patch as seen by eight cells.
#[derive(Clone, Copy, Default)]
pub(super) struct Measured {
    /// Cells².
    pub(super) squared: [f32; LANES],
    /// One bit per lane for each edge: the closest point lies on it.
    pub(super) on_edge: [u8; 3],
}

/// Measures the cells of a cube against one patch, which replaces the nearest of those that it is nearer to.
pub(super) struct OfCube<'a> {
    pub(super) patch: &'a Patch,
    pub(super) patch_idx: u32,
    pub(super) cube: Cube,
    pub(super) nearest: &'a mut NearestOfEight,
    pub(super) measured: &'a mut Measured,
}

impl Kernel for OfCube<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: F32x8>(self) {
        let Self { patch, patch_idx, cube, nearest, measured } = self;
        const ONE: u32 = u32::MAX;
        let step = L::Int::splat(cube.step);
        let offsets = [
            step & L::Int::load(&[0, 0, 0, 0, ONE, ONE, ONE, ONE]),
            step & L::Int::load(&[0, 0, ONE, ONE, 0, 0, ONE, ONE]),
            step & L::Int::load(&[0, ONE, 0, ONE, 0, ONE, 0, ONE]),
        ];
        let found = Nearest::<L>::of(patch, cube.base, offsets);
        let squared = L::load(&nearest.squared);
        let is_nearer = found.squared.lt(squared * L::splat(NEARER));
        L::select(is_nearer, found.squared, squared).store(&mut nearest.squared);
        let own = L::Int::splat(patch_idx as i32);
        L::Int::select(is_nearer, own, L::Int::load(&nearest.patch_idx)).store(&mut nearest.patch_idx);
        found.squared.store(&mut measured.squared);
        for (bits, [edge, limit]) in measured.on_edge.iter_mut().zip(found.on_edge) {
            *bits = edge.le(limit).bits() as u8;
        }
    }
}

/// Which cells are as near to a patch as to their nearest, one bit each.
pub(super) struct OnPlateau<'a> {
    /// Distances to the patch, cells².
    pub(super) squared: &'a [f32; LANES],
    pub(super) nearest: &'a NearestOfEight,
}

impl Kernel for OnPlateau<'_> {
    type Output = u8;

    #[inline(always)]
    fn run<L: F32x8>(self) -> u8 {
        let limit = L::load(&self.nearest.squared) * L::splat(PLATEAU) + L::splat(PLATEAU_CELLS_SQUARED);
        L::load(self.squared).le(limit).bits() as u8
    }
}

/// Measures eight cells of the brick at `origin`, given by their numbers inside, against one patch: squared distances (cells²), and
/// distances to its plane, positive on the side of the winding normal (cells).
pub(super) struct OfCells<'a> {
    pub(super) patch: &'a Patch,
    pub(super) origin: [i32; 3],
    pub(super) cells: &'a [u32; LANES],
}

impl Kernel for OfCells<'_> {
    type Output = ([f32; LANES], [f32; LANES]);

    #[inline(always)]
    fn run<L: F32x8>(self) -> Self::Output {
        let (inside, seven) = (L::Int::load(self.cells), L::Int::splat(7));
        let offsets = [inside.shifted::<6>(), inside.shifted::<3>() & seven, inside & seven];
        let found = Nearest::<L>::of(self.patch, self.origin, offsets);
        let (mut squared, mut height) = ([0.0; LANES], [0.0; LANES]);
        found.squared.store(&mut squared);
        found.height.store(&mut height);
        (squared, height)
    }
}

/// Where the closest point of a patch is, per lane.
struct Nearest<L> {
    /// Cells².
    squared: L,
    /// Along the winding normal, cells.
    height: L,
    /// Squared distance in the plane to each edge, and the largest with which the closest point counts as lying on it.
    on_edge: [[L; 2]; 3],
}

impl<L: F32x8> Nearest<L> {
    /// Of the centres of the cells `base + offsets`. Whole cells are subtracted as whole numbers, which is exact.
    #[inline(always)]
    fn of(patch: &Patch, base: [i32; 3], offsets: [L::Int; 3]) -> Self {
        let anchor = patch.anchor();
        let mut way = [L::splat(0.0); 3];
        for axis in 0..3 {
            let cells = offsets[axis] + L::Int::splat(base[axis] - anchor[axis]);
            way[axis] = L::of_int(cells) - L::splat(patch.number(2 + axis));
        }
        let mut numbers = [L::splat(0.0); 11];
        for (k, number) in numbers.iter_mut().enumerate() {
            *number = L::splat(patch.number(5 + k));
        }
        let [r_x, r_y, r_z, u_x, u_y, u_z, length, apex_x, apex_y, inverse_second, inverse_third] = numbers;
        let normal = [r_y * u_z - r_z * u_y, r_z * u_x - r_x * u_z, r_x * u_y - r_y * u_x];
        let (x, y, height) = (dot([r_x, r_y, r_z], way), dot([u_x, u_y, u_z], way), dot(normal, way));
        let beyond = x - x.max(L::splat(0.0)).min(length);
        let base = beyond * beyond + y * y;
        let (from_second, edge_second) = (x - length, apex_x - length);
        let second = segment([from_second, y], [edge_second, apex_y], inverse_second);
        let third = segment([x, y], [apex_x, apex_y], inverse_third);
        let zero = L::splat(0.0);
        let inside = zero.lt(y) & zero.lt(edge_second * y - apex_y * from_second) & zero.lt(apex_y * x - apex_x * y);
        let in_plane = L::select(inside, zero, base.min(second).min(third));
        let limit = in_plane * L::splat(CORNER_SHARE) + L::splat(CORNER_CELLS_SQUARED);
        Self { squared: height * height + in_plane, height, on_edge: [[base, limit], [second, limit], [third, limit]] }
    }
}

#[inline(always)]
fn dot<L: F32x8>(a: [L; 3], b: [L; 3]) -> L {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Squared distance to an edge of which one end is the origin.
#[inline(always)]
fn segment<L: F32x8>([x, y]: [L; 2], [edge_x, edge_y]: [L; 2], inverse: L) -> L {
    let along = ((x * edge_x + y * edge_y) * inverse).max(L::splat(0.0)).min(L::splat(1.0));
    let (rest_x, rest_y) = (x - along * edge_x, y - along * edge_y);
    rest_x * rest_x + rest_y * rest_y
}
