//! A field as the contact kernels read it: the same samples, and for each brick what can be said of
//! it without them.
//!
//! - **Ceiling**: no interpolated value of the brick is above it. Points whose brick cannot touch
//!   are answered without a sample.
//! - **Ceiling around**: the same of the brick and its 26 neighbours, for whole blocks of points.
//! - **Clearance**: how far every place of the brick is from all that can touch, be it with a facet
//!   that reaches so far, at least. It reaches where the band does not.
//!
//! Built once per field when a scene is made ready, from the samples alone. Cost: one pass over
//! them, and O(16) per brick of the grid. Reading is RT: safe.
//!
//! Coordinates are those of the lattice of cell centres: cells minus ½. Brick b of an axis covers
//! 8b … 8b + 8 there, so the eight samples around a place are always those of its own brick.
//!
//! # Source
//! Ours. The clearances are an exact distance transform by one axis after the other
//! (Felzenszwalb2012's decomposition), its range cut short.

use glam::Vec3;

use super::creases::Creases;
use super::{APRON_CELLS, APRON_EDGE, DEEP_INSIDE, FAR_OUTSIDE, Field};
use crate::parallel;
use crate::simd::Pair;
use crate::storage::SharedSlice;
use crate::voxmap::grid::BRICK_EDGE;

/// Clearances are measured up to so many bricks.
const ROOM_BRICKS: u32 = 16;
/// What rounding may add to an interpolated value, as a share of the band.
const ROUNDING: f32 = 1e-6;
/// Neighbouring samples that differ by this much more than they are apart have no surface between
/// them: distances are exact, so the side changes there by itself, cells.
const JUMP_CELLS: f32 = 0.05;

/// See the module page. Invariant: `dims` are positive, `top`, `max_depth_m`, `max_depth_nearby_m`,
/// `clearance_cells` and `far_cells` have one entry per brick, the creases are consistent, every slot
/// of `top` is one of `samples_m`, and all samples can be counted by an `i32`.
#[derive(Debug)]
pub(crate) struct BrickBounds {
    dims: [i32; 3],
    top: SharedSlice<u32>,
    samples_m: SharedSlice<[f32; APRON_CELLS]>,
    max_depth_m: SharedSlice<f32>,
    padded: SharedSlice<Pair>,
    max_depth_nearby_m: SharedSlice<f32>,
    clearance_cells: SharedSlice<f32>,
    far_cells: SharedSlice<f32>,
    band_m: f32,
    skin_m: f32,
    voxel_size_m: f32,
    jump_cells: f32,
    reach_m: f32,
    /// Of facets that reach so far; else none.
    creases: Creases,
}

impl BrickBounds {
    /// Looks a field over; `None` for one that is too large for the kernels' 32-bit indices, or
    /// whose outside is inside (a thin skin that is thicker than its band). Cold.
    #[cfg(test)]
    pub(crate) fn of(field: &Field) -> Option<Self> {
        Self::thicker(field, 0.0)
    }

    /// The same for facets that touch with their corners where V > −`reach_m`, no further than the
    /// field is known. Cold.
    pub(crate) fn within(field: &Field, reach_m: f32) -> Option<Self> {
        Self::build(field, 0.0, reach_m)
    }

    /// The same with every value higher by `by_m`: what is that far from the object touches it.
    /// Cold.
    pub(crate) fn thicker(field: &Field, by_m: f32) -> Option<Self> {
        Self::build(field, by_m, 0.0)
    }

    fn build(field: &Field, by_m: f32, reach_m: f32) -> Option<Self> {
        let Field { brick_dims: dims, top, samples_m, band_m, voxel_size_m, .. } = field;
        let skin_m = &(field.skin_m + by_m);
        let n_bricks = dims.iter().try_fold(1_usize, |n, dim| {
            n.checked_mul(usize::try_from(*dim).ok().filter(|dim| *dim > 0)?)
        });
        let n_slots = samples_m.len();
        let known =
            |slot: u32| matches!(slot, FAR_OUTSIDE | DEEP_INSIDE) || (slot as usize) < n_slots;
        let fits = n_bricks == Some(top.len())
            && i32::try_from(top.len()).is_ok()
            && field.creases.is_consistent(*dims)
            && n_slots.checked_mul(APRON_CELLS).is_some_and(|n| i32::try_from(n).is_ok())
            && top.iter().all(|slot| known(*slot));
        if !fits || skin_m - band_m > 0.0 {
            return None;
        }
        let looks: Vec<Look> = parallel::map(n_slots, 64, |slot| {
            // True invariant: a slot of the field.
            let brick = field.distances_m(slot).unwrap_or([*band_m; APRON_CELLS]);
            Look::at(&brick, *band_m, *voxel_size_m)
        });
        let moved_m = field.most_moved_m();
        let margin_m = ROUNDING * (band_m + skin_m) + moved_m;
        let max_depth_m: Vec<f32> = top
            .iter()
            .map(|slot| match *slot {
                FAR_OUTSIDE => skin_m - band_m,
                DEEP_INSIDE => skin_m + band_m,
                slot => looks
                    .get(slot as usize)
                    .map_or(f32::INFINITY, |look| look.highest_m + skin_m + margin_m),
            })
            .collect();
        let clearance_cells = gaps_cells(&max_depth_m, -reach_m, *dims);
        let far_cells = gaps_cells(&max_depth_m, skin_m - band_m, *dims);
        let max_depth_nearby_m = max_nearby(&max_depth_m, *dims, skin_m - band_m);
        let jump_cells =
            looks.iter().map(|look| look.steepest_m / voxel_size_m - 1.0).fold(0.0, f32::max);
        Some(Self {
            dims: *dims,
            top: top.clone(),
            samples_m: samples_m.clone(),
            clearance_cells: clearance_cells.into(),
            far_cells: far_cells.into(),
            padded: padded(top, &max_depth_m, *dims, skin_m - band_m).into(),
            max_depth_m: max_depth_m.into(),
            max_depth_nearby_m: max_depth_nearby_m.into(),
            band_m: *band_m,
            skin_m: *skin_m,
            voxel_size_m: *voxel_size_m,
            // A side that changes at a distance h shows as a step of at least 2h less two cells. Of
            // two samples one may be moved up and one down.
            jump_cells: jump_cells
                + if jump_cells > JUMP_CELLS { 2.0 } else { 0.0 }
                + 2.0 * moved_m / voxel_size_m,
            reach_m,
            creases: if reach_m > 0.0 { field.creases.clone() } else { Creases::default() },
        })
    }

    /// The planes of the object's convex edges, which facets meet.
    #[inline]
    pub(crate) fn creases(&self) -> &Creases {
        &self.creases
    }

    /// Bricks per axis.
    #[inline]
    pub(crate) fn dims(&self) -> [i32; 3] {
        self.dims
    }

    /// `[n_bricks]`, z fastest: slot of the samples, or [`FAR_OUTSIDE`], or [`DEEP_INSIDE`].
    #[inline]
    pub(crate) fn top(&self) -> &[u32] {
        &self.top
    }

    /// `[n_slots][9³]`, z fastest, m, as in the field.
    #[inline]
    pub(crate) fn samples_m(&self) -> &[[f32; APRON_CELLS]] {
        &self.samples_m
    }

    /// `[n_bricks]`, m: no value in the brick is higher; the value itself where the brick has no
    /// samples.
    #[inline]
    pub(crate) fn max_depth_m(&self) -> &[f32] {
        &self.max_depth_m
    }

    /// Slots and largest depths of eight bricks, two along each axis from `first` on, z fastest;
    /// `None` where `first` is two bricks or more off the grid, or beyond its last one. RT: safe.
    #[inline(always)]
    pub(crate) fn eight(&self, first: [i32; 3]) -> Option<[&[Pair; 2]; 4]> {
        let [nx, ny, nz] = self.dims;
        let [x, y, z] = [first[0] + 1, first[1] + 1, first[2] + 1];
        if x as u32 > nx as u32 || y as u32 > ny as u32 || z as u32 > nz as u32 {
            return None;
        }
        let row = nz as usize + 2;
        let plane = (nz as usize + 2) * (ny as usize + 2);
        let at = (x as usize) * plane + y as usize * row + z as usize;
        let pairs = |at: usize| self.padded.get(at..at + 2)?.first_chunk();
        Some([pairs(at)?, pairs(at + row)?, pairs(at + plane)?, pairs(at + plane + row)?])
    }

    /// `[n_bricks]`, m: no value in the brick or in one of its 26 neighbours, on the grid or not,
    /// is higher.
    #[inline]
    pub(crate) fn max_depth_nearby_m(&self) -> &[f32] {
        &self.max_depth_nearby_m
    }

    /// `[n_bricks]`, cells: from any place in the brick to anything with V > −reach, at least.
    #[inline]
    pub(crate) fn clearance_cells(&self) -> &[f32] {
        &self.clearance_cells
    }

    /// `[n_bricks]`, cells: from any place in the brick to anything higher than where everything is
    /// far, at least.
    #[inline]
    pub(crate) fn far_cells(&self) -> &[f32] {
        &self.far_cells
    }

    /// The middle of the first brick from this one on that the surface may run through, cells;
    /// `None` when none does. Cold.
    pub(crate) fn surface_place(&self, from_brick: usize) -> Option<Vec3> {
        let n_bricks = self.top.len();
        let runs_through = |brick: &usize| {
            let slot = self.top.get(*brick).filter(|slot| **slot < DEEP_INSIDE);
            let samples = slot.and_then(|slot| self.samples_m.get(*slot as usize));
            let side = |of: fn(&f32, &f32) -> bool| {
                samples.is_some_and(|samples| {
                    samples.iter().any(|sample| of(&(sample + self.skin_m), &0.0))
                })
            };
            side(f32::gt) && side(f32::lt)
        };
        let brick = (0..n_bricks).map(|step| (from_brick + step) % n_bricks).find(runs_through)?;
        Some(Vec3::from_array(
            coord_of(brick, self.dims).map(|coord| (BRICK_EDGE * coord + BRICK_EDGE / 2) as f32),
        ))
    }

    /// Where the field saturates on both sides, m.
    #[inline]
    pub(crate) fn band_m(&self) -> f32 {
        self.band_m
    }

    /// Added to every sample, m.
    #[inline]
    pub(crate) fn skin_m(&self) -> f32 {
        self.skin_m
    }

    /// Facets may touch where V is greater than minus this, m.
    #[inline]
    pub(crate) fn reach_m(&self) -> f32 {
        self.reach_m
    }

    /// Voxel edge, m.
    #[inline]
    pub(crate) fn voxel_size_m(&self) -> f32 {
        self.voxel_size_m
    }

    /// By how much two values may differ beyond their distance, cells: up to a tenth for a sound
    /// mesh, whose samples are moved where it is curved, more where the side changes without a
    /// surface between.
    #[inline]
    pub(crate) fn jump_cells(&self) -> f32 {
        self.jump_cells
    }

    /// The same bounds of a field in which a side changes without a surface.
    #[cfg(test)]
    pub(crate) fn with_jump(self, jump_cells: f32) -> Self {
        Self { jump_cells, ..self }
    }
}

/// Slots and largest depths of a grid with a layer of bricks around it, which are outside.
fn padded(top: &[u32], max_depth_m: &[f32], dims: [i32; 3], outside_m: f32) -> Vec<Pair> {
    let [_, ny, nz] = dims.map(|n| n as usize);
    let row = nz + 2;
    let plane = (nz + 2) * (ny + 2);
    let mut padded = vec![[FAR_OUTSIDE, outside_m.to_bits()]; (dims[0] as usize + 2) * plane];
    for ((line, slots), depths_m) in (0..).zip(top.chunks(nz)).zip(max_depth_m.chunks(nz)) {
        let first = (line / ny + 1) * plane + (line % ny + 1) * row + 1;
        for ((to, slot), depth_m) in padded.iter_mut().skip(first).zip(slots).zip(depths_m) {
            *to = [*slot, depth_m.to_bits()];
        }
    }
    padded
}

/// What a brick's samples say.
struct Look {
    highest_m: f32,
    /// Largest difference between two neighbours.
    steepest_m: f32,
}

impl Look {
    fn at(brick: &[f32; APRON_CELLS], band_m: f32, voxel_size_m: f32) -> Self {
        // What is not a number is no contact, and ends in no maximum.
        let clamped = brick.map(|sample| sample.clamp(-band_m, band_m));
        let (rows, _) = clamped.as_chunks::<APRON_EDGE>();
        // Lane by lane along a row, which vectorises.
        let mut highest_m = [f32::NEG_INFINITY; APRON_EDGE];
        let mut steepest_m = [voxel_size_m; APRON_EDGE];
        let greater = |a: f32, b: f32| if a > b { a } else { b };
        let mut compare = |one: &[f32], other: &[f32]| {
            for ((steepest, a), b) in steepest_m.iter_mut().zip(one).zip(other) {
                *steepest = greater((a - b).abs(), *steepest);
            }
        };
        for (at, row) in rows.iter().enumerate() {
            highest_m
                .iter_mut()
                .zip(row)
                .for_each(|(best, sample)| *best = greater(*sample, *best));
            compare(row, row.get(1..).unwrap_or(&[]));
            if let Some(next) = rows.get(at + 1).filter(|_| at % APRON_EDGE != APRON_EDGE - 1) {
                compare(row, next);
            }
            if let Some(above) = rows.get(at + APRON_EDGE) {
                compare(row, above);
            }
        }
        let most = |lanes: [f32; APRON_EDGE]| lanes.into_iter().fold(f32::NEG_INFINITY, greater);
        Self { highest_m: most(highest_m), steepest_m: most(steepest_m) }
    }
}

fn coord_of(brick: usize, [_, ny, nz]: [i32; 3]) -> [usize; 3] {
    let ny = ny as usize;
    let nz = nz as usize;
    [brick / (ny * nz), brick / nz % ny, brick % nz]
}

/// Length and stride of the lines along z, y and x.
fn axes(dims: [i32; 3]) -> [(usize, usize); 3] {
    let [nx, ny, nz] = dims.map(|n| n as usize);
    [(nz, 1), (ny, nz), (nx, ny * nz)]
}

/// Largest ceiling among each brick and its 26 neighbours; that of what is not on the grid counts
/// everywhere.
fn max_nearby(max_depth_m: &[f32], dims: [i32; 3], outside_m: f32) -> Vec<f32> {
    let mut max_depth_nearby_m = max_depth_m.to_vec();
    for (n, stride) in axes(dims) {
        along(&mut max_depth_nearby_m, n, stride, |line, k| {
            let beside = |k: usize| line.get(k).copied().unwrap_or(outside_m).max(outside_m);
            beside(k).max(beside(k.wrapping_sub(1))).max(beside(k + 1))
        });
    }
    max_depth_nearby_m
}

/// Gaps between the cube of each brick and those that reach above a depth, cells. As the gap along an
/// axis is one brick less than the difference of the numbers, it is measured to the bricks that do
/// and their 26 neighbours.
fn gaps_cells(max_depth_m: &[f32], above_m: f32, dims: [i32; 3]) -> Vec<f32> {
    const FAR: u32 = ROOM_BRICKS * ROOM_BRICKS;
    let axes = axes(dims);
    let mut squares: Vec<u32> =
        max_depth_m.iter().map(|ceiling| if *ceiling > above_m { 0 } else { FAR }).collect();
    for (n, stride) in axes {
        along(&mut squares, n, stride, |line, k| {
            let beside = |k: usize| line.get(k).copied().unwrap_or(FAR);
            beside(k).min(beside(k.wrapping_sub(1))).min(beside(k + 1))
        });
    }
    for (n, stride) in axes {
        along(&mut squares, n, stride, |line, k| {
            let beside = |k: usize| line.get(k).copied().unwrap_or(FAR);
            let mut best = beside(k);
            for away in 1..ROOM_BRICKS {
                if away * away >= best {
                    break;
                }
                let least = beside(k.wrapping_sub(away as usize)).min(beside(k + away as usize));
                best = best.min(least + away * away);
            }
            best
        });
    }
    squares.into_iter().map(|square| BRICK_EDGE as f32 * (square as f32).sqrt()).collect()
}

/// Replaces every line along an axis by a function of itself.
fn along<T: Copy + Default>(
    values: &mut [T],
    n: usize,
    stride: usize,
    of: impl Fn(&[T], usize) -> T,
) {
    let mut line = vec![T::default(); n];
    let firsts = (0..values.len()).filter(|at| (at / stride).is_multiple_of(n)).collect::<Vec<_>>();
    for first in firsts {
        for (k, value) in line.iter_mut().enumerate() {
            *value = values.get(first + k * stride).copied().unwrap_or_default();
        }
        for k in 0..n {
            if let Some(value) = values.get_mut(first + k * stride) {
                *value = of(&line, k);
            }
        }
    }
}

#[cfg(test)]
#[expect(clippy::expect_used, clippy::indexing_slicing, reason = "test code")]
mod tests {
    use super::*;
    use crate::mesh::primitives::Shape;
    use crate::mesh::validate::inspect;
    use crate::spatial::testing::Random;
    use crate::voxmap::inside_test::InsideTest;
    use crate::voxmap::{Options, Volume};

    fn fields() -> Vec<Field> {
        let ring = Shape::Torus { major_m: 0.02, minor_m: 0.006 }.tessellate(1e-5);
        let ball = Shape::Sphere { radius_m: 0.015 }.tessellate(1e-5);
        let built =
            [(ring, InsideTest::Auto), (ball.clone(), InsideTest::Auto), (ball, InsideTest::Thin)]
                .map(|(mesh, sides)| {
                    let options =
                        Options { voxel_size_m: 5e-4, layers: 6, navigation: None, sides };
                    Volume::build(&mesh, &inspect(&mesh), &options, |_| ())
                        .expect("a grid that fits")
                        .field(&mesh, false)
                });
        built.into()
    }

    /// Places on and around the grid, cells.
    fn places(field: &Field, n: usize) -> Vec<Vec3> {
        let mut random = Random(17);
        let [x, y, z] = field.brick_dims.map(|n| (8 * n) as f32);
        (0..n)
            .map(|_| random.in_box(0.0, 1.0).as_vec3() * (Vec3::new(x, y, z) + 8.0) - 4.0)
            .collect()
    }

    /// The brick that a place's samples are of, if it is on the grid.
    fn brick_at(bounds: &BrickBounds, cells: Vec3) -> Option<usize> {
        let lattice = cells - 0.5;
        let coord = [lattice.x, lattice.y, lattice.z].map(|at| at.floor() as i32 >> 3);
        let on_grid = coord.iter().zip(bounds.dims()).all(|(at, n)| (0..n).contains(at));
        on_grid.then(|| {
            ((coord[0] * bounds.dims()[1] + coord[1]) * bounds.dims()[2] + coord[2]) as usize
        })
    }

    #[test]
    fn no_value_is_above_its_ceiling_or_the_ceiling_around() {
        for field in fields() {
            let bounds = BrickBounds::of(&field).expect("bounds");
            let places = places(&field, 20_000);
            let mut n_inside = 0;
            for (place, step) in places.iter().zip(places.iter().rev()) {
                let value_m = field.trilinear::<true>(*place);
                n_inside += usize::from(value_m > 0.0);
                let Some(brick) = brick_at(&bounds, *place) else { continue };
                assert!(value_m <= bounds.max_depth_m()[brick]);
                // Less than eight cells away along every axis, on the grid or not.
                let beside = *place + (*step * 0.37).fract_gl() * 15.9 - 7.95;
                assert!(field.trilinear::<true>(beside) <= bounds.max_depth_nearby_m()[brick]);
                assert!(bounds.max_depth_nearby_m()[brick] >= bounds.max_depth_m()[brick]);
            }
            assert!(n_inside > 100, "{n_inside}");
        }
    }

    #[test]
    fn no_room_exceeds_the_distance_to_anything_that_touches_or_is_not_far() {
        for field in fields() {
            let bounds = BrickBounds::of(&field).expect("bounds");
            let places = places(&field, 6000);
            let far_m = bounds.skin_m() - bounds.band_m();
            for (above_m, cells) in [(0.0, bounds.clearance_cells()), (far_m, bounds.far_cells())] {
                let higher: Vec<Vec3> = places
                    .iter()
                    .copied()
                    .filter(|place| field.trilinear::<true>(*place) > above_m)
                    .collect();
                let mut largest = 0.0_f32;
                for place in &places {
                    let Some(brick) = brick_at(&bounds, *place) else { continue };
                    let clearance = cells[brick];
                    largest = largest.max(clearance);
                    let nearest = higher
                        .iter()
                        .map(|other| place.distance(*other))
                        .fold(f32::INFINITY, f32::min);
                    assert!(clearance <= nearest, "{place}: {clearance} to {nearest}");
                }
                assert!(above_m < 0.0 || largest >= 8.0, "some brick is clear: {largest}");
            }
        }
    }

    #[test]
    fn what_kernels_index_by_stays_in_bounds() {
        for field in fields() {
            let bounds = BrickBounds::of(&field).expect("bounds");
            let n_bricks = bounds.dims().iter().product::<i32>() as usize;
            assert_eq!(
                [
                    bounds.top().len(),
                    bounds.max_depth_m().len(),
                    bounds.max_depth_nearby_m().len(),
                    bounds.clearance_cells().len(),
                    bounds.far_cells().len()
                ],
                [n_bricks; 5]
            );
            assert!(bounds.top().iter().all(|slot| *slot >= DEEP_INSIDE || (*slot as usize) < bounds.samples_m().len()));
            for from_brick in [0, 1, n_bricks / 2, n_bricks - 1, n_bricks, usize::MAX / 2] {
                let place = bounds.surface_place(from_brick).expect("a surface");
                assert!(brick_at(&bounds, place).is_some());
                assert!(field.trilinear::<true>(place).abs() < 8.0 * bounds.voxel_size_m());
            }
        }
    }

    #[test]
    fn a_side_that_changes_without_a_surface_costs_its_step_and_two_cells() {
        let field = fields().swap_remove(0);
        let jump_with = |change: fn(f32) -> f32| {
            let mut samples = field.samples_m.to_vec();
            // One and a half cells outside, where neighbours are outside as well, and within the
            // band with a cell more.
            let far = |sample: &f32| (*sample / field.voxel_size_m + 1.5).abs() < 0.1;
            let (brick, cell) = samples
                .iter()
                .enumerate()
                .find_map(|(brick, samples)| Some((brick, samples.iter().position(far)?)))
                .expect("a sample there");
            samples[brick][cell] =
                change(samples[brick][cell] / field.voxel_size_m) * field.voxel_size_m;
            BrickBounds::of(&Field { samples_m: samples.into(), ..field.clone() })
                .expect("bounds")
                .jump_cells()
        };
        assert!(jump_with(|cells| cells) < JUMP_CELLS);
        let changed = jump_with(|cells| -cells);
        assert!(changed > 2.0, "{changed}");
    }
}
