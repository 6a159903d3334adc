//! Signed distance from cell centres to the true surface, in the band.
//!
//! In the surface voxels every triangle nearby is measured. Elsewhere a near triangle is searched
//! for every fourth cell per axis; a block of cells between them measures what the lattice points
//! at its corners have found, which bounds the distances of its cells, and then every triangle that
//! the bound does not exclude. So each distance is exact, but for rounding below 10⁻⁵ cells, and no
//! block waits for another.
//!
//! ```text
//! mesh ─► patches ─┬─► near (surface voxels) ─────────┬───────────┬─► Samples ─► field
//!                  └─► tree ─► lattice (¼) ─► block (all cells) ──┘
//!                        kernel
//! ```
//!
//! Errors against a search over all triangles in `f64`, all cells of the band: at most 10⁻⁵ voxel
//! on the shipped bolt, the NIST parts and the Stanford bunny. When blocks walked from the choices
//! of the lattice across edges, in place of the last search, distances were too large by more than
//! 10⁻⁴ voxel at 896 of 1,806,294 cells of the bolt (0.2 mm, worst 1.20), at 33,229 of 3,730,074 of
//! the bunny (256 voxels, worst 1.12), at 15,043 of 698,356 of a torus, worst 0.13.
//!
//! Cost: in CPU time 1.06 times that of the walk on the Stanford bunny at 1,024 voxels (169,469
//! bricks; 3.54 s for 3.35 s on a busy machine, medians of three; 1.95 s on an idle one with the
//! walk), as much as it at 256, 1.35 times on the bolt. A patch against eight cells takes 7 ns.
//! Tried and taken back: a search for each block by itself, by the box around it (1.75 times the
//! walk); the walk before the search (1.65 times, before patches were tested by themselves, and no
//! faster than without it); pages of 2 MiB for the samples (1.97 to 2.86 s in place of 2.23, slower
//! in seven runs of eight).

mod block;
mod kernel;
mod lattice;
mod near;
mod patches;
mod tree;

use glam::{DVec3, Vec3};

use self::block::{Block, CUBES};
use self::lattice::DistanceLattice;
use self::near::{Near, ON_SURFACE_CELLS};
use self::patches::{NONE, Patches};
use super::grid::{BRICK_CELLS, BRICK_EDGE, brick_origin, cell_of};
use super::layers::Layers;
use super::orient::Orientation;
use super::surface::{Surface, bits};
use crate::mesh::TriangleMesh;
use crate::mesh::closest_point::TriangleProjector;
use crate::parallel;
use crate::simd::{F32x8, I32s, Kernel, LANES, SimdLevel};

/// Samples on a brick's edge: its own eight and the next brick's first, so that all corners of an
/// interpolation cell lie in one brick.
pub const APRON_EDGE: usize = BRICK_EDGE + 1;
/// Samples of a brick.
pub const APRON_CELLS: usize = APRON_EDGE * APRON_EDGE * APRON_EDGE;

/// Place of a brick's own cell among its samples.
pub(crate) const fn sample_of(inside: usize) -> usize {
    ((inside >> 6) * APRON_EDGE + (inside >> 3 & 7)) * APRON_EDGE + (inside & 7)
}

/// Distances in the bricks of a [`Layers`] map, same slots.
#[derive(Debug)]
pub struct Distances {
    /// `[n_slots][512]`, m: negative outside, positive inside; ±(n_layers + ½)·s beyond the band,
    /// which no true distance there falls below.
    pub values_m: Vec<[f32; BRICK_CELLS]>,
    /// `[n_slots][512]`, unit: direction in which the distance grows, at the closest surface point;
    /// empty unless asked for.
    pub gradients: Vec<[Vec3; BRICK_CELLS]>,
}

impl From<Samples> for Distances {
    fn from(Samples { values_m, gradients }: Samples) -> Self {
        let own =
            |brick: &[f32; APRON_CELLS]| core::array::from_fn(|inside| brick[sample_of(inside)]);
        Self { values_m: parallel::map(values_m.len(), 1, |slot| own(&values_m[slot])), gradients }
    }
}

/// What decides the sign of a distance.
#[derive(Clone, Copy, Debug)]
pub(super) enum Signs<'a> {
    /// A solid: layers give the side, and the orientation of the nearest triangle decides in
    /// surface voxels.
    Solid(&'a Orientation),
    /// A thin skin: everything is outside.
    Thin,
}

/// Distances as the field stores them, the aprons still empty.
pub(crate) struct Samples {
    /// `[n_slots][9³]`, z fastest, m: as in [`Distances`], at [`sample_of`] each cell.
    pub(crate) values_m: Vec<[f32; APRON_CELLS]>,
    /// As in [`Distances`].
    pub(crate) gradients: Vec<[Vec3; BRICK_CELLS]>,
}

impl Samples {
    /// Measures every cell of the band.
    ///
    /// Deterministic whatever the number of threads and the processor. Cost: O(triangles + band
    /// cells), a few triangle distances per cell; memory beside the result: a cache line per
    /// triangle and a choice for every 64 cells.
    pub(super) fn measure(
        mesh: &TriangleMesh,
        surface: &Surface,
        layers: &Layers,
        signs: Signs<'_>,
        with_gradients: bool,
    ) -> Self {
        Self::measure_on(SimdLevel::best(), mesh, surface, layers, signs, with_gradients)
    }

    fn measure_on(
        simd_level: SimdLevel,
        mesh: &TriangleMesh,
        surface: &Surface,
        layers: &Layers,
        signs: Signs<'_>,
        with_gradients: bool,
    ) -> Self {
        let patches = Patches::new(mesh, &surface.grid);
        let outward = |patch_idx: u32| match signs {
            Signs::Solid(orientation) => orientation.sign(patches.triangle(patch_idx)) as f32,
            Signs::Thin => 1.0,
        };
        let inputs = DistanceInputs {
            mesh,
            surface,
            layers,
            signs,
            near: Near::new(simd_level, &patches, surface, outward),
            lattice: DistanceLattice::new(&patches, layers, surface.n_voxels, simd_level),
            patches: &patches,
        };
        // Fresh pages of the system, which are zero: `vec!` clears arrays of this length once more,
        // on one thread.
        let mut values_m = bytemuck::zeroed_vec(layers.bricks.len());
        let mut gradients =
            vec![[Vec3::ZERO; BRICK_CELLS]; if with_gradients { layers.bricks.len() } else { 0 }];
        let gradients_of = gradients.iter_mut().map(Some).chain(core::iter::repeat_with(|| None));
        let mut bricks: Vec<_> = values_m.iter_mut().zip(gradients_of).collect();
        let mut runs: Vec<_> = bricks.chunks_mut(MEASURED_TOGETHER).collect();
        parallel::map_mut(&mut runs, 1, |run, bricks| {
            simd_level.run(Bricks { inputs: &inputs, first_slot: run * MEASURED_TOGETHER, bricks });
        });
        drop(bricks);
        Self { values_m, gradients }
    }
}

/// What every brick reads.
struct DistanceInputs<'a> {
    mesh: &'a TriangleMesh,
    surface: &'a Surface,
    layers: &'a Layers,
    signs: Signs<'a>,
    patches: &'a Patches,
    near: Near,
    lattice: DistanceLattice<'a>,
}

/// Cells on the edge of a block, which has one list of patches.
const BLOCK_EDGE: usize = BRICK_EDGE / 2;

/// Bricks that share scratch memory, which takes as long to clear as to measure a block.
const MEASURED_TOGETHER: usize = 16;

/// Bricks in order of their slots: samples, and gradients where they are wanted.
struct Bricks<'a, 'b> {
    inputs: &'a DistanceInputs<'a>,
    first_slot: usize,
    bricks: &'a mut [(&'b mut [f32; APRON_CELLS], Option<&'b mut [Vec3; BRICK_CELLS]>)],
}

impl Kernel for Bricks<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run<L: F32x8>(self) {
        let mut blocks = [Block::<L>::new(); LANES];
        for (slot, (samples, gradients)) in (self.first_slot..).zip(self.bricks) {
            self.inputs.measure(&mut blocks, slot, samples, gradients.as_deref_mut());
        }
    }
}

impl DistanceInputs<'_> {
    /// Measures the cells of one brick, every sample of its own once.
    #[inline(always)]
    fn measure<L: F32x8>(
        &self,
        blocks: &mut [Block<L>; LANES],
        slot: usize,
        samples: &mut [f32; APRON_CELLS],
        mut gradients: Option<&mut [Vec3; BRICK_CELLS]>,
    ) {
        let Self { surface, layers, patches, lattice, near, .. } = self;
        let brick = layers.bricks[slot] as usize;
        let values = &layers.values[slot];
        let voxel_size_m = surface.grid.voxel_size_m as f32;
        let is_solid = matches!(self.signs, Signs::Solid(_));
        let beyond = layers.n_layers as u8 + 1;
        let beyond_m = (layers.n_layers as f32 + 0.5) * voxel_size_m;
        let origin = brick_origin(surface.grid.brick_coord(brick));
        let points = lattice.points(slot);
        for (block_idx, block) in blocks.iter_mut().enumerate() {
            let corner = corner_of(block_idx);
            let wanted = core::array::from_fn(|cube| {
                let layers = CubeLayers::of(values, first_of(corner, cube));
                !(layers.are(beyond) | layers.are(0))
            });
            block.restart(core::array::from_fn(|axis| origin[axis] + corner[axis] as i32), wanted);
            if block.is_wanted() {
                block.offer(&patches.all, &points.around(corner.map(|cell| cell / BLOCK_EDGE)));
            }
        }
        lattice.complete(blocks);
        for (block_idx, block) in blocks.iter().enumerate() {
            let corner = corner_of(block_idx);
            for cube in 0..CUBES {
                let first = first_of(corner, cube);
                let layers = CubeLayers::of(values, first);
                let inside = if is_solid { layers.are_positive() } else { 0 };
                let is_beyond = layers.are(beyond);
                let sign = L::select(L::Int::mask(inside.into()), L::splat(1.0), L::splat(-1.0));
                // Surface voxels get theirs below.
                let measured_m = sign * L::splat(voxel_size_m) * block.nearest[cube].squared.sqrt();
                let mut signed_m = [0.0; LANES];
                L::select(L::Int::mask(is_beyond.into()), sign * L::splat(beyond_m), measured_m)
                    .store(&mut signed_m);
                for (row, pair) in signed_m.as_chunks::<2>().0.iter().enumerate() {
                    let first = sample_of(first + (row >> 1 << 6) + (row & 1) * 8);
                    samples[first..first + 2].copy_from_slice(pair);
                }
                if let Some(gradients) = gradients.as_deref_mut() {
                    let mut patch_idx = [NONE; LANES];
                    block.nearest[cube].patch_idx.store(&mut patch_idx);
                    let measured = !(is_beyond | layers.are(0));
                    for lane in bits(measured.into()).map(|lane| lane as usize) {
                        let cell = first + (lane >> 2 << 6) + (lane >> 1 & 1) * 8 + (lane & 1);
                        gradients[cell] =
                            self.gradient(slot, cell, patch_idx[lane], inside >> lane & 1 == 1);
                    }
                }
            }
        }
        if let Some(surface_slot) = surface.slot(brick) {
            for (inside, voxel) in
                near::cells(&surface.masks[surface_slot]).zip(near.voxels(surface, surface_slot))
            {
                let signed_cells =
                    if is_solid { voxel.signed_cells } else { -voxel.signed_cells.abs() };
                samples[sample_of(inside)] = signed_cells * voxel_size_m;
                if let Some(gradients) =
                    gradients.as_deref_mut().filter(|_| voxel.patch_idx != NONE)
                {
                    gradients[inside] =
                        self.gradient(slot, inside, voxel.patch_idx, signed_cells > 0.0);
                }
            }
        }
    }

    /// Unit direction in which the signed distance of a cell grows: away from the surface
    /// inside, towards it outside.
    fn gradient(&self, slot: usize, inside: usize, patch_idx: u32, is_inside: bool) -> Vec3 {
        let grid = &self.surface.grid;
        let cell = cell_of(grid.brick_coord(self.layers.bricks[slot] as usize), inside);
        let center = DVec3::new(cell[0].into(), cell[1].into(), cell[2].into()) + 0.5;
        let triangle_idx = self.patches.triangle(patch_idx);
        let corners = self.mesh.corners(triangle_idx as usize).map(|corner| grid.to_cells(corner));
        let offset = center - TriangleProjector::new(&corners).project(center).point;
        let distance = offset.length();
        let away = if distance > f64::from(ON_SURFACE_CELLS) {
            offset / distance
        } else {
            // On the surface itself the offset has no direction; a sign of −1 there means
            // "outward".
            let normal =
                (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize_or_zero();
            match self.signs {
                Signs::Solid(orientation) => normal * orientation.sign(triangle_idx),
                Signs::Thin => normal,
            }
        };
        if is_inside { away.as_vec3() } else { -away.as_vec3() }
    }
}

/// First cell of a block in its brick.
#[inline(always)]
const fn corner_of(block: usize) -> [usize; 3] {
    [(block >> 2) * BLOCK_EDGE, (block >> 1 & 1) * BLOCK_EDGE, (block & 1) * BLOCK_EDGE]
}

/// Number in the brick of the first cell of a cube, `corner` that of its block.
#[inline(always)]
const fn first_of([x, y, z]: [usize; 3], cube: usize) -> usize {
    ((x + (cube >> 2) * 2) * BRICK_EDGE + y + (cube >> 1 & 1) * 2) * BRICK_EDGE + z + (cube & 1) * 2
}

/// Layer values of the eight cells of a cube, a byte each, about which one question is answered for
/// all at once.
#[derive(Clone, Copy)]
struct CubeLayers(u64);

impl CubeLayers {
    const ONES: u64 = 0x0101_0101_0101_0101;

    /// Those of the 2³ cells from number `first` of a brick on.
    #[inline(always)]
    fn of(values: &[i8; BRICK_CELLS], first: usize) -> Self {
        let pair = |inside: usize| {
            u64::from(u16::from_le_bytes([values[inside] as u8, values[inside + 1] as u8]))
        };
        Self(pair(first) | pair(first + 8) << 16 | pair(first + 64) << 32 | pair(first + 72) << 48)
    }

    /// One bit for each cell that is this many layers from the surface, on either side.
    #[inline(always)]
    fn are(self, n_layers: u8) -> u8 {
        let negative = self.0 >> 7 & Self::ONES;
        // Two's complement, byte by byte: a negative number is never 0, so nothing is carried.
        // Below, 127 + 127 is not carried either.
        let layers = (self.0 ^ (negative * 0xff)) + negative;
        Self::packed(!((layers ^ (Self::ONES * u64::from(n_layers))) + Self::ONES * 0x7f))
    }

    /// One bit for each cell inside.
    #[inline(always)]
    fn are_positive(self) -> u8 {
        !(Self::packed(self.0) | self.are(0))
    }

    /// The highest bits of all bytes.
    #[inline(always)]
    fn packed(bytes: u64) -> u8 {
        ((bytes >> 7 & Self::ONES).wrapping_mul(0x0102_0408_1020_4080) >> 56) as u8
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::primitives::Shape;
    use crate::mesh::validate::inspect;
    use crate::voxmap::inside_test::InsideTest;
    use crate::voxmap::{Options, Volume};

    #[test]
    fn every_simd_level_measures_the_same_bits() {
        let torus = Shape::Torus { major_m: 8e-3, minor_m: 3e-3 }.tessellate(1e-4);
        let plate = Shape::Box { size_m: DVec3::new(0.04, 0.03, 0.002) }.tessellate(1e-4);
        for (mesh, sides) in
            [(&torus, InsideTest::Auto), (&plate, InsideTest::Auto), (&plate, InsideTest::Thin)]
        {
            let options = Options { voxel_size_m: 4e-4, layers: 5, navigation: None, sides };
            let map = Volume::build(mesh, &inspect(mesh), &options, |_| ()).expect("a small grid");
            let signs = if map.thin { Signs::Thin } else { Signs::Solid(&map.orientation) };
            let measure =
                |level| Samples::measure_on(level, mesh, &map.surface, &map.layers, signs, true);
            let portable = measure(SimdLevel::Portable);
            let best = measure(SimdLevel::best());
            let bits = |samples: &Samples| {
                samples
                    .values_m
                    .as_flattened()
                    .iter()
                    .map(|value| value.to_bits())
                    .collect::<Vec<_>>()
            };
            assert_eq!(bits(&portable), bits(&best));
            assert_eq!(portable.gradients, best.gradients);
        }
    }
}
