//! Sixteen points, or eight spheres, against a field at once.
//!
//! Each kernel is written twice: lane by lane, which is the specification, and with AVX2. Both do the same operations in the same
//! order with the same rounding (no fused multiply-add), so results do not depend on which of them ran.
//!
//! Most points are never interpolated, because their brick's ceiling says that they cannot touch.

#![expect(unsafe_code, reason = "AVX2 intrinsics, and the call of code compiled for AVX2 after asking for it")]
#![expect(clippy::indexing_slicing, reason = "three axes, and the corners of a cell in an array of their size")]

#[cfg(target_arch = "x86_64")]
mod avx2;
mod portable;

use glam::{Mat3, Vec3};

use super::contact_block::{ContactBlock, Pushes};
use super::sum::{APART, Eight, Sums, Weighting};
use crate::pointshell::shell::{LANES, Lanes, Lanes3};
use crate::pointshell::tree::{CHILDREN, Spheres};
use crate::spatial::Pose;
use crate::voxmap::field::brick_bounds::BrickBounds;
use crate::voxmap::field::{APRON_CELLS, APRON_EDGE, DEEP_INSIDE, FAR_OUTSIDE, Field};

const ROW: usize = APRON_EDGE;
const PLANE: usize = APRON_EDGE * APRON_EDGE;
/// What two interpolations take from a distance: the variance of a corner about the place it is interpolated for is at most ¼ per
/// axis, and there are three axes and two places; cells².
const SPREAD_CELLS_SQUARED: f32 = 1.5;
/// A ball of this radius about a place in a brick, and what rounding may add, lie in the brick and its 26 neighbours, cells.
const AROUND_CELLS: f32 = 8.0;
/// 1/√3, a little less: an interpolation of values that grow by no more than their distance is at most √3 times as steep.
const LEAST_SLOPE: f32 = 0.577;

/// Where the tool stands on a field's grid: body axes about the centre of mass to cells.
#[derive(Clone, Copy, Debug)]
pub(super) struct Place {
    /// Cells per metre, columns are the images of the body axes.
    pub(super) axes: Mat3,
    /// The centre of mass, cells.
    pub(super) origin: Vec3,
}

impl Place {
    pub(super) fn new(field: &Field, map_from_body: Pose) -> Self {
        let per_metre = 1.0 / f64::from(field.voxel_size_m());
        // The subtraction in f64: what is left is small, whatever the origin.
        let origin = (map_from_body.translation - field.origin_map().as_dvec3()) * per_metre;
        Self { axes: (map_from_body.rotation_matrix() * per_metre).as_mat3(), origin: origin.as_vec3() }
    }

    pub(super) fn is_finite(&self) -> bool {
        self.axes.is_finite() && self.origin.is_finite()
    }
}

/// V of the points of a block.
#[derive(Clone, Copy, Debug)]
pub(super) struct Depths {
    /// m; of a point that was not interpolated its brick's ceiling instead, which is no more than the floor asked for.
    pub(super) depths_m: Lanes,
    /// One bit per lane: V > 0.
    pub(super) touching: u16,
    /// Largest of them, m; lanes that are not a number do not count.
    pub(super) max_m: f32,
}

/// How lanes are computed. No intrinsic stands in a closure that is handed to code compiled for any processor: it would be called, not
/// inlined.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Machine {
    /// One after the other.
    Portable,
    /// All at once. Made by [`Machine::best`] only, which asks the processor.
    #[cfg(target_arch = "x86_64")]
    Avx2(HasAvx2),
}

/// Proof that the processor has AVX2.
#[cfg(target_arch = "x86_64")]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HasAvx2(());

impl Machine {
    /// The fastest that this processor has.
    pub fn best() -> Self {
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") {
            return Self::Avx2(HasAvx2(()));
        }
        Self::Portable
    }

    /// Looks up blocks of points one after the other, and tells what it `found` of each. `floor` gives, from the largest V so far,
    /// the ceiling up to which a point's own V is of no interest. Returns the largest V. RT: safe; allocates nothing.
    #[inline]
    pub(super) fn blocks(
        self,
        bounds: &BrickBounds,
        place: &Place,
        positions: &[Lanes3],
        which: impl Iterator<Item = u32> + Clone,
        floor: impl Fn(f32) -> f32,
        found: impl FnMut(u32, &Depths),
    ) -> f32 {
        match self {
            Self::Portable => {
                each(positions, which, floor, found, |positions, floor_m| portable::block(bounds, place, positions, floor_m))
            }
            #[cfg(target_arch = "x86_64")]
            // SAFETY: the processor has AVX2, of which `HasAvx2` is the proof.
            Self::Avx2(HasAvx2(())) => unsafe { avx2::blocks(bounds, place, positions, which, floor, found) },
        }
    }

    /// Which of eight spheres may hold a point whose V is above the floor: one bit each. `margin_cells`: what rounding may take. RT: safe.
    #[inline]
    pub(super) fn above(self, bounds: &BrickBounds, place: &Place, spheres: &Spheres, floor_m: f32, margin_cells: f32) -> u8 {
        match self {
            Self::Portable => portable::above(bounds, place, spheres, floor_m, margin_cells),
            #[cfg(target_arch = "x86_64")]
            // SAFETY: as above.
            Self::Avx2(HasAvx2(())) => unsafe { avx2::above(bounds, place, spheres, floor_m, margin_cells) },
        }
    }

    /// For each of eight spheres, how far it may move in any way before one of its points can touch, cells; not above 0 when nothing is
    /// proven. `margin_cells`: what rounding may take. RT: safe.
    #[inline]
    pub(super) fn spheres(self, bounds: &BrickBounds, place: &Place, spheres: &Spheres, margin_cells: f32) -> [f32; CHILDREN] {
        match self {
            Self::Portable => portable::spheres(bounds, place, spheres, margin_cells),
            #[cfg(target_arch = "x86_64")]
            // SAFETY: as above.
            Self::Avx2(HasAvx2(())) => unsafe { avx2::spheres(bounds, place, spheres, margin_cells) },
        }
    }
}

impl Machine {
    /// Adds blocks to the sums, whose positions and normals are among these.
    pub(super) fn add_all(
        self,
        sums: &mut Sums,
        touched: &[ContactBlock],
        (positions, normals): (&[Lanes3], &[Lanes3]),
        by: Weighting,
    ) {
        let geometry =
            |touched: &ContactBlock| Some((positions.get(touched.block as usize)?, normals.get(touched.block as usize)?));
        match self {
            Self::Portable => {
                for touched in touched {
                    if let Some((positions, normals)) = geometry(touched) {
                        sums.add::<[f32; APART]>(touched, (positions, normals), None, by);
                    }
                }
            }
            #[cfg(target_arch = "x86_64")]
            // SAFETY: as above.
            Self::Avx2(HasAvx2(())) => unsafe { avx2::add_all(sums, touched, geometry, by) },
        }
    }

    /// Adds a block to the sums, its lanes as they push.
    #[inline]
    pub(super) fn add(self, sums: &mut Sums, touched: &ContactBlock, pushes: &Pushes, by: Weighting) {
        match self {
            Self::Portable => sums.add::<[f32; APART]>(touched, (&pushes.positions, &pushes.normals), Some(&pushes.weights), by),
            #[cfg(target_arch = "x86_64")]
            // SAFETY: as above.
            Self::Avx2(HasAvx2(())) => unsafe { avx2::add(sums, touched, pushes, by) },
        }
    }
}

/// How far a place with V = −`depth_cells` is from anything with V > 0, cells, by the field itself.
///
/// # Source
/// Ours. Samples are distances, so they differ by no more than they are apart. V at two places are means of such samples, hence
/// V(b) − V(a) ≤ E|X − Y| ≤ √(E|X − Y|²) = √(|b − a|² + Var X + Var Y), X and Y the corners with their weights; also
/// V(b) − V(a) ≤ √3·|b − a|, as no partial derivative exceeds 1. The better of the two counts.
#[inline(always)]
pub(super) fn free_cells(depth_cells: f32) -> f32 {
    let outside_cells = greater(depth_cells, 0.0);
    let by_spread = greater(outside_cells * outside_cells - SPREAD_CELLS_SQUARED, 0.0).sqrt();
    greater(by_spread, outside_cells * LEAST_SLOPE)
}

/// The maximum as the instruction has it: the second where either is not a number.
#[inline(always)]
fn greater(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

#[inline(always)]
fn lesser(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

#[inline(always)]
fn each(
    positions: &[Lanes3],
    which: impl Iterator<Item = u32>,
    floor: impl Fn(f32) -> f32,
    mut found: impl FnMut(u32, &Depths),
    look: impl Fn(&Lanes3, f32) -> Depths,
) -> f32 {
    let mut max_m = f32::NEG_INFINITY;
    for block in which {
        let Some(points) = positions.get(block as usize) else { continue };
        let depths = look(points, floor(max_m));
        max_m = greater(depths.max_m, max_m);
        found(block, &depths);
    }
    max_m
}
