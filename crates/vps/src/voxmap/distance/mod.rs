//! Signed distance from cell centres to the true surface, in the band.
//!
//! In the surface voxels every triangle nearby is measured. Elsewhere the nearest triangle is searched exactly on a
//! coarse lattice; the cells between take the choices of the lattice points around them, and of the surface voxels beside them, and
//! walk across edges to closer ones. What is handed on is a choice, not a value: every value is an exact point-triangle distance,
//! so no error builds up, and no cell waits for another.
//!
//! ```text
//! mesh ─► patches ─┬─► near (surface voxels) ───────────┬───────────┬─► Samples ─► field
//!                  └─► tree ─► lattice (¼, ½) ─► group (all cells) ──┘
//!                        kernel
//! ```

mod group;
mod kernel;
mod lattice;
mod near;
mod patches;
mod tree;

use glam::{DVec3, Vec3};

use self::group::Group;
use self::kernel::Cube;
use self::lattice::Lattice;
use self::near::{Around, Near, ON_SURFACE_CELLS};
use self::patches::{NONE, Patches};
use super::grid::{BRICK_CELLS, BRICK_EDGE, brick_origin, cell_of};
use super::layers::Layers;
use super::orient::Orientation;
use super::surface::Surface;
use crate::mesh::TriangleMesh;
use crate::mesh::closest_point::TriangleProjector;
use crate::parallel;
use crate::simd::{LANES, SimdLevel};

/// Samples on a brick's edge: its own eight and the next brick's first, so that all corners of an interpolation cell lie in one
/// brick.
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
    /// `[n_slots][512]`, m: negative outside, positive inside; ±(n_layers + ½)·s beyond the band, which no true distance there
    /// falls below.
    pub values_m: Vec<[f32; BRICK_CELLS]>,
    /// `[n_slots][512]`, unit: direction in which the distance grows, at the closest surface point; empty unless asked for.
    pub gradients: Vec<[Vec3; BRICK_CELLS]>,
}

impl From<Samples> for Distances {
    fn from(Samples { values_m, gradients }: Samples) -> Self {
        let own = |brick: &[f32; APRON_CELLS]| core::array::from_fn(|inside| brick[sample_of(inside)]);
        Self { values_m: parallel::map(values_m.len(), 1, |slot| own(&values_m[slot])), gradients }
    }
}

/// What decides the sign of a distance.
#[derive(Clone, Copy, Debug)]
pub(super) enum Signs<'a> {
    /// A solid: layers give the side, and the orientation of the nearest triangle decides in surface voxels.
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
    /// Deterministic whatever the number of threads and the processor. Cost: O(triangles + band cells), a few triangle distances
    /// per cell; memory beside the result: a cache line per triangle and two layers of choices.
    pub(super) fn measure(mesh: &TriangleMesh, surface: &Surface, layers: &Layers, signs: Signs<'_>, with_gradients: bool) -> Self {
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
            lattice: Lattice::new(&patches, layers, surface.n_voxels, simd_level),
            patches: &patches,
        };
        let mut values_m = vec![[0.0; APRON_CELLS]; layers.bricks.len()];
        let mut gradients = vec![[Vec3::ZERO; BRICK_CELLS]; if with_gradients { layers.bricks.len() } else { 0 }];
        let gradients_of = gradients.iter_mut().map(Some).chain(core::iter::repeat_with(|| None));
        let mut bricks: Vec<_> = values_m.iter_mut().zip(gradients_of).collect();
        parallel::map_mut_with(
            &mut bricks,
            16,
            || (Group::new(simd_level), Around::new()),
            |scratch, slot, (samples, gradients)| inputs.measure(scratch, slot, samples, gradients.as_deref_mut()),
        );
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
    lattice: Lattice<'a>,
}

impl DistanceInputs<'_> {
    /// Measures the cells of one brick.
    fn measure(
        &self,
        (group, around): &mut (Group, Around),
        slot: usize,
        samples: &mut [f32; APRON_CELLS],
        mut gradients: Option<&mut [Vec3; BRICK_CELLS]>,
    ) {
        let Self { surface, layers, patches, .. } = *self;
        let (brick, values) = (layers.bricks[slot] as usize, &layers.values[slot]);
        let (voxel_size_m, is_solid) = (surface.grid.voxel_size_m as f32, matches!(self.signs, Signs::Solid(_)));
        let beyond = layers.n_layers as i8 + 1;
        let origin = brick_origin(surface.grid.brick_coord(brick));
        if values.iter().any(|layer| layer.abs() == 1) {
            around.gather(&self.near, surface, brick);
        }
        self.lattice.each_cube(slot, |cube, candidates| {
            let first = (cube[0] << 7) + (cube[1] << 4) + (cube[2] << 1);
            let inside: [usize; LANES] = core::array::from_fn(|lane| first + (lane >> 2 << 6) + (lane >> 1 & 1) * 8 + (lane & 1));
            let layers = inside.map(|inside| values[inside]);
            let bits =
                |holds: fn(i8, i8) -> bool| (0..LANES).fold(0, |bits, lane| bits | u8::from(holds(layers[lane], beyond)) << lane);
            let wanted = bits(|layer, beyond| layer != 0 && layer.abs() != beyond);
            if wanted == 0 {
                return;
            }
            group.restart(Cube { base: core::array::from_fn(|axis| origin[axis] + 2 * cube[axis] as i32), step: 1 }, wanted);
            candidates.iter().for_each(|patch_idx| group.consider(*patch_idx));
            // What hands feel most is not left to the lattice alone.
            if bits(|layer, _| layer.abs() == 1) != 0 {
                around.offer(cube, group);
            }
            self.lattice.settle(group, patches);
            // All eight, as that is simpler for the processor; those that are not wanted are overwritten below.
            let side = layers.map(|layer| if is_solid && layer > 0 { voxel_size_m } else { -voxel_size_m });
            let signed_m: [f32; LANES] = core::array::from_fn(|lane| side[lane] * group.nearest.squared[lane].sqrt());
            for (row, pair) in signed_m.as_chunks::<2>().0.iter().enumerate() {
                let first = sample_of(inside[2 * row]);
                samples[first..first + 2].copy_from_slice(pair);
            }
            if let Some(gradients) = gradients.as_deref_mut() {
                for lane in (0..LANES).filter(|lane| wanted >> lane & 1 == 1) {
                    let is_inside = is_solid && layers[lane] > 0;
                    gradients[inside[lane]] = self.gradient(slot, inside[lane], group.nearest.patch_idx[lane], is_inside);
                }
            }
        });
        if let Some(surface_slot) = surface.slot(brick) {
            for (inside, voxel) in near::cells(&surface.masks[surface_slot]).zip(self.near.voxels(surface, surface_slot)) {
                let signed_cells = if is_solid { voxel.signed_cells } else { -voxel.signed_cells.abs() };
                samples[sample_of(inside)] = signed_cells * voxel_size_m;
                if let Some(gradients) = gradients.as_deref_mut().filter(|_| voxel.patch_idx != NONE) {
                    gradients[inside] = self.gradient(slot, inside, voxel.patch_idx, signed_cells > 0.0);
                }
            }
        }
        let beyond_m = (layers.n_layers as f32 + 0.5) * voxel_size_m;
        for (inside, layer) in values.iter().enumerate().filter(|(_, layer)| layer.abs() == beyond) {
            samples[sample_of(inside)] = beyond_m.copysign((*layer).into());
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
            // On the surface itself the offset has no direction; a sign of −1 there means "outward".
            let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize_or_zero();
            match self.signs {
                Signs::Solid(orientation) => normal * orientation.sign(triangle_idx),
                Signs::Thin => normal,
            }
        };
        if is_inside { away.as_vec3() } else { -away.as_vec3() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::primitives::Shape;
    use crate::mesh::validate::inspect;
    use crate::voxmap::inside_test::InsideTest;
    use crate::voxmap::{Options, Voxmap};

    #[test]
    fn every_simd_level_measures_the_same_bits() {
        let torus = Shape::Torus { major_m: 8e-3, minor_m: 3e-3 }.tessellate(1e-4);
        let plate = Shape::Box { size_m: DVec3::new(0.04, 0.03, 0.002) }.tessellate(1e-4);
        for (mesh, sides) in [(&torus, InsideTest::Auto), (&plate, InsideTest::Auto), (&plate, InsideTest::Thin)] {
            let options = Options { voxel_size_m: 4e-4, layers: 5, navigation: None, sides };
            let map = Voxmap::build(mesh, &inspect(mesh), &options, |_| ()).expect("a small grid");
            let signs = if map.thin { Signs::Thin } else { Signs::Solid(&map.orientation) };
            let measure = |level| Samples::measure_on(level, mesh, &map.surface, &map.layers, signs, true);
            let (portable, best) = (measure(SimdLevel::Portable), measure(SimdLevel::best()));
            let bits = |samples: &Samples| samples.values_m.as_flattened().iter().map(|value| value.to_bits()).collect::<Vec<_>>();
            assert_eq!(bits(&portable), bits(&best));
            assert_eq!(portable.gradients, best.gradients);
        }
    }
}
