//! Signed distance from cell centres to the true surface, in the band.
//!
//! In the surface voxels every triangle nearby is measured. Elsewhere the nearest triangle is searched exactly on a
//! coarse lattice; the cells between take the choices of the lattice points around them and walk across
//! edges to closer ones. What is handed on is a choice, not a value: every value is an exact point-triangle distance,
//! so no error builds up, and no cell waits for another.
//!
//! ```text
//! mesh ─► patches ─┬─► near (surface voxels) ───────────────────────┬─► Samples ─► field
//!                  └─► tree ─► lattice (¼, ½) ─► group (all cells) ──┘
//!                        kernel on simd
//! ```

mod group;
mod kernel;
mod lattice;
mod near;
mod patches;
mod simd;
mod tree;

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use self::group::Group;
use self::lattice::Lattice;
use self::near::{Bins, Nearby};
use self::patches::{NONE, Patches};
use self::simd::{Cube, Machine};
use super::grid::{BRICK_CELLS, BRICK_EDGE, brick_origin, cell_of};
use super::layers::Layers;
use super::orient::Orientation;
use super::surface::Surface;
use crate::mesh::TriangleMesh;
use crate::mesh::closest_point::TriangleProjector;

/// Below this distance a centre counts as lying on the surface, where an offset has no direction; cells.
const ON_SURFACE_CELLS: f32 = 1e-6;

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
        Self { values_m: values_m.par_iter().map(own).collect(), gradients }
    }
}

/// What decides the sign of a distance.
#[derive(Clone, Copy, Debug)]
pub enum Signs<'a> {
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
    pub(crate) fn measure(mesh: &TriangleMesh, surface: &Surface, layers: &Layers, signs: Signs<'_>, with_gradients: bool) -> Self {
        Self::measure_on(Machine::best(), mesh, surface, layers, signs, with_gradients)
    }

    fn measure_on(
        machine: Machine,
        mesh: &TriangleMesh,
        surface: &Surface,
        layers: &Layers,
        signs: Signs<'_>,
        with_gradients: bool,
    ) -> Self {
        let patches = Patches::new(mesh, &surface.grid);
        let stage = Stage {
            mesh,
            surface,
            layers,
            signs,
            bins: Bins::new(&patches, surface),
            lattice: Lattice::new(&patches, layers, surface.n_voxels, machine),
            patches: &patches,
            machine,
        };
        let mut values_m = vec![[0.0; APRON_CELLS]; layers.bricks.len()];
        let mut gradients = vec![[Vec3::ZERO; BRICK_CELLS]; if with_gradients { layers.bricks.len() } else { 0 }];
        if with_gradients {
            values_m.par_iter_mut().zip(&mut gradients).enumerate().for_each_init(
                || Group::new(machine),
                |group, (slot, (samples, gradients))| {
                    stage.measure(group, slot, samples, Some(gradients));
                },
            );
        } else {
            values_m.par_iter_mut().enumerate().with_min_len(16).for_each_init(
                || Group::new(machine),
                |group, (slot, samples)| {
                    stage.measure(group, slot, samples, None);
                },
            );
        }
        Self { values_m, gradients }
    }
}

/// What every brick reads.
struct Stage<'a> {
    mesh: &'a TriangleMesh,
    surface: &'a Surface,
    layers: &'a Layers,
    signs: Signs<'a>,
    patches: &'a Patches,
    bins: Bins,
    lattice: Lattice<'a>,
    machine: Machine,
}

impl Stage<'_> {
    /// Measures the cells of one brick.
    fn measure(
        &self,
        group: &mut Group,
        slot: usize,
        samples: &mut [f32; APRON_CELLS],
        mut gradients: Option<&mut [Vec3; BRICK_CELLS]>,
    ) {
        let Self { surface, layers, patches, .. } = *self;
        let (brick, values) = (layers.bricks[slot] as usize, &layers.values[slot]);
        let voxel_size_m = surface.grid.voxel_size_m as f32;
        let mut put = |inside: usize, patch_idx: u32, signed_cells: f32| {
            samples[sample_of(inside)] = signed_cells * voxel_size_m;
            if let Some(gradients) = gradients.as_deref_mut() {
                gradients[inside] = self.gradient(slot, inside, patch_idx, if signed_cells > 0.0 { 1.0 } else { -1.0 });
            }
        };
        let beyond = layers.n_layers as i8 + 1;
        let side = |layer: i8| match self.signs {
            Signs::Solid(_) if layer > 0 => 1.0,
            _ => -1.0,
        };
        let origin = brick_origin(surface.grid.brick_coord(brick));
        self.lattice.each_cube(slot, |cube, candidates| {
            let first = (cube[0] << 7) + (cube[1] << 4) + (cube[2] << 1);
            let inside: [usize; 8] = core::array::from_fn(|lane| first + (lane >> 2 << 6) + (lane >> 1 & 1) * 8 + (lane & 1));
            let is_wanted = |lane: usize| values[inside[lane]] != 0 && values[inside[lane]].abs() != beyond;
            let wanted = (0..8).fold(0, |wanted, lane| wanted | u8::from(is_wanted(lane)) << lane);
            if wanted == 0 {
                return;
            }
            group.restart(Cube { base: core::array::from_fn(|axis| origin[axis] + 2 * cube[axis] as i32), step: 1 }, wanted);
            candidates.iter().for_each(|patch_idx| group.consider(*patch_idx));
            let is_next_to_surface = (0..8).any(|lane| values[inside[lane]].abs() == 1);
            self.lattice.settle(group, patches, is_next_to_surface);
            for lane in (0..8).filter(|lane| wanted >> lane & 1 == 1) {
                put(inside[lane], group.nearest.patch_idx[lane], side(values[inside[lane]]) * group.nearest.squared[lane].sqrt());
            }
        });
        if let Some(surface_slot) = surface.slot(brick) {
            let outward = |patch_idx: u32| match self.signs {
                Signs::Solid(orientation) => orientation.sign(patches.triangle(patch_idx)) as f32,
                Signs::Thin => 1.0,
            };
            let near = Nearby::measure(self.machine, patches, &self.bins, surface, surface_slot, outward);
            for inside in near::cells(&surface.masks[surface_slot]) {
                let (patch_idx, distance) = (near.patch_idx[inside], near.squared[inside].sqrt());
                if patch_idx == NONE {
                    continue;
                }
                let sign = match self.signs {
                    Signs::Solid(_) if distance > ON_SURFACE_CELLS => -near.height[inside].signum(),
                    _ => -1.0,
                };
                put(inside, patch_idx, sign * distance);
            }
        }
        let beyond_m = (layers.n_layers as f32 + 0.5) * voxel_size_m;
        for (inside, layer) in values.iter().enumerate().filter(|(_, layer)| layer.abs() == beyond) {
            samples[sample_of(inside)] = beyond_m.copysign((*layer).into());
        }
    }

    /// Unit direction in which the signed distance of a cell grows: away from the surface on the side of the centre, times the
    /// sign.
    fn gradient(&self, slot: usize, inside: usize, patch_idx: u32, sign: f32) -> Vec3 {
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
        (away * f64::from(sign)).as_vec3()
    }
}
