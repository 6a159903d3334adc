//! Signed distance from cell centres to the true surface, in the band.
//!
//! In the surface voxels every triangle nearby is measured ([`near`]). From there outward, layer by layer, every cell takes over the
//! nearest triangles of its inner neighbours and walks across edges to closer ones ([`far`]). What propagates is a choice, not a
//! value, and every value is an exact point-triangle distance, so no error builds up. Choices are kept for two layers at a time
//! only; distances go straight to where the tick reads them.
//!
//! ```text
//! mesh ─► patches ─► near (layer 0) ─► far (±1, ±2, … ±L) ─► Samples ─► field
//!            └────────── kernel on simd ──────┘
//! ```

mod far;
mod kernel;
mod near;
mod patches;
mod simd;

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use self::far::{Front, Search};
use self::near::{Bins, Nearby};
use self::patches::{NONE, Patches};
use self::simd::Machine;
use super::grid::{BRICK_CELLS, BRICK_EDGE, brick_origin, cell_of};
use super::layers::{FAR_OUTSIDE, Layers};
use super::orient::Orientation;
use super::surface::{Mask, Surface};
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
        let around = layers.bricks.par_iter().with_min_len(64).map(|brick| around(layers, *brick as usize)).collect();
        let stage = Stage { mesh, surface, layers, signs, patches: Patches::new(mesh, &surface.grid), around, machine };
        let mut values_m = vec![[0.0; APRON_CELLS]; layers.bricks.len()];
        let mut gradients = vec![[Vec3::ZERO; BRICK_CELLS]; if with_gradients { layers.bricks.len() } else { 0 }];
        let mut front = stage.near(&mut values_m, &mut gradients);
        for layer in 1..=layers.n_layers as i8 {
            front = stage.far(layer, &front, &mut values_m, &mut gradients);
        }
        Self { values_m, gradients }
    }
}

/// What all passes read.
struct Stage<'a> {
    mesh: &'a TriangleMesh,
    surface: &'a Surface,
    layers: &'a Layers,
    signs: Signs<'a>,
    patches: Patches,
    /// `[n_slots]`: entries of the top grid for the brick and those next to it.
    around: Vec<[u32; 27]>,
    machine: Machine,
}

impl Stage<'_> {
    /// Measures layer 0, and sets all other cells to the values beyond the band.
    fn near(&self, values_m: &mut [[f32; APRON_CELLS]], gradients: &mut [[Vec3; BRICK_CELLS]]) -> Front {
        let Self { surface, layers, .. } = *self;
        let bins = Bins::new(&self.patches, surface);
        let voxel_size_m = surface.grid.voxel_size_m as f32;
        let beyond_m = (layers.n_layers as f32 + 0.5) * voxel_size_m;
        let surface_slot = |slot: usize| surface.slot(layers.bricks[slot] as usize);
        let masks: Vec<Mask> = (0..layers.bricks.len())
            .into_par_iter()
            .map(|slot| surface_slot(slot).map_or([0; 8], |slot| surface.masks[slot]))
            .collect();
        let mut front = Front::new(masks);
        let fill = |samples: &mut [f32; APRON_CELLS], slot: usize| {
            for (row_idx, row) in layers.values[slot].as_chunks::<BRICK_EDGE>().0.iter().enumerate() {
                let first = sample_of(row_idx * BRICK_EDGE);
                let signed = row.map(|layer| if layer < 0 { -beyond_m } else { beyond_m });
                samples[first..first + BRICK_EDGE].copy_from_slice(&signed);
            }
        };
        each_part(
            &mut front,
            values_m,
            gradients,
            || (),
            |(), slot, part, samples, mut gradients| {
                fill(samples, slot);
                let (Some((mask, found)), Some(surface_slot)) = (part, surface_slot(slot)) else { return };
                let Nearby { patch_idx, squared, height } =
                    Nearby::measure(self.machine, &self.patches, &bins, surface, surface_slot);
                for (found, inside) in found.iter_mut().zip(near::cells(mask)) {
                    *found = patch_idx[inside];
                    if *found == NONE {
                        continue;
                    }
                    let distance = squared[inside].sqrt();
                    let sign = match self.signs {
                        Signs::Solid(orientation) if distance > ON_SURFACE_CELLS => {
                            -(height[inside] * orientation.sign(self.patches.triangle(*found)) as f32).signum()
                        }
                        _ => -1.0,
                    };
                    samples[sample_of(inside)] = sign * distance * voxel_size_m;
                    if let Some(gradients) = gradients.as_deref_mut() {
                        gradients[inside] = self.gradient(slot, inside, *found, sign);
                    }
                }
            },
        );
        front
    }

    /// Measures a layer next to one that is measured.
    fn far(&self, layer: i8, inner: &Front, values_m: &mut [[f32; APRON_CELLS]], gradients: &mut [[Vec3; BRICK_CELLS]]) -> Front {
        let Self { surface, layers, .. } = *self;
        let voxel_size_m = surface.grid.voxel_size_m as f32;
        let masks = layers.values.par_iter().with_min_len(64).map(|values| self.machine.cells_on_layer(values, layer)).collect();
        let mut front = Front::new(masks);
        each_part(
            &mut front,
            values_m,
            gradients,
            || Search::new(self.machine),
            |search, slot, part, samples, mut gradients| {
                let Some((mask, found)) = part else { return };
                let brick = layers.bricks[slot] as usize;
                let origin = brick_origin(surface.grid.brick_coord(brick));
                search.measure(&self.patches, origin, &self.around[slot], mask, inner);
                for (found, (inside, patch_idx, squared)) in found.iter_mut().zip(search.results()) {
                    *found = patch_idx;
                    let sign = match self.signs {
                        Signs::Solid(_) if layers.values[slot][inside] > 0 => 1.0,
                        _ => -1.0,
                    };
                    samples[sample_of(inside)] = sign * squared.sqrt() * voxel_size_m;
                    if let Some(gradients) = gradients.as_deref_mut() {
                        gradients[inside] = self.gradient(slot, inside, patch_idx, sign);
                    }
                }
            },
        );
        front
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

/// Entries of the top grid for a brick and the 26 next to it.
fn around(layers: &Layers, brick: usize) -> [u32; 27] {
    let coord = layers.grid.brick_coord(brick);
    core::array::from_fn(|idx| {
        let offset = [idx as i32 / 9 - 1, idx as i32 / 3 % 3 - 1, idx as i32 % 3 - 1];
        layers.grid.brick_neighbour(coord, offset).map_or(FAR_OUTSIDE, |neighbour| layers.top[neighbour])
    })
}

/// Calls `work(scratch, slot, part of the front, samples, gradients)` for every slot, in parallel.
fn each_part<S>(
    front: &mut Front,
    values_m: &mut [[f32; APRON_CELLS]],
    gradients: &mut [[Vec3; BRICK_CELLS]],
    scratch: impl Fn() -> S + Sync + Send,
    work: impl Fn(&mut S, usize, Option<(&Mask, &mut [u32])>, &mut [f32; APRON_CELLS], Option<&mut [Vec3; BRICK_CELLS]>) + Sync + Send,
) {
    let parts = front.parts();
    if gradients.is_empty() {
        values_m
            .par_iter_mut()
            .zip(parts)
            .enumerate()
            .for_each_init(scratch, |scratch, (slot, (samples, part))| work(scratch, slot, part, samples, None));
    } else {
        values_m.par_iter_mut().zip(gradients).zip(parts).enumerate().for_each_init(
            scratch,
            |scratch, (slot, ((samples, gradients), part))| {
                work(scratch, slot, part, samples, Some(gradients));
            },
        );
    }
}
