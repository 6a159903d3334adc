//! The union of maps that are made of the same bricks: what the bodies and skins of one part are
//! together.
//!
//! Depth in a union is the largest of the depths, exact outside and on the surface; where bodies
//! overlap it is a lower bound, as the surface of one may lie in another. A skin counts as a plate
//! that reaches one voxel to either side.

use std::sync::Arc;

use glam::Vec3;

use super::distance::{APRON_CELLS, Samples, sample_of};
use super::grid::{BRICK_CELLS, Grid};
use super::layers::{DEEP_INSIDE, FAR_OUTSIDE, Layers};
use crate::parallel;

/// A map, and where its grid begins in that of the union.
pub(super) struct Member<'a> {
    pub(super) layers: &'a Layers,
    pub(super) samples: Samples,
    /// Coordinate of its first brick.
    pub(super) first_brick: [u32; 3],
    /// A two-sided skin.
    pub(super) thin: bool,
}

impl Member<'_> {
    /// What its top grid holds for a brick of the union.
    fn state(&self, coord: [u32; 3]) -> u32 {
        let dims = self.layers.grid.brick_dims();
        let own: [u32; 3] =
            core::array::from_fn(|axis| coord[axis].wrapping_sub(self.first_brick[axis]));
        if (0..3).all(|axis| own[axis] < dims[axis]) {
            self.layers.top[self.layers.grid.brick_index(own)]
        } else {
            FAR_OUTSIDE
        }
    }
}

/// The layers and the samples of all members together; `grid` holds all of theirs. Cost: linear in
/// the bricks of the grid, and in the cells of the members.
pub(super) fn union(grid: Grid, members: &[Member<'_>]) -> (Layers, Samples) {
    let n_layers = members.iter().map(|member| member.layers.n_layers).max().unwrap_or(1);
    let mut top = parallel::map(grid.n_bricks(), 64, |brick| {
        let coord = grid.brick_coord(brick);
        let states = members.iter().map(|member| member.state(coord));
        // Deep inside of one is inside of all; any slot, the lowest number, is kept.
        states.fold(FAR_OUTSIDE, |all, state| match (all, state) {
            (DEEP_INSIDE, _) | (_, DEEP_INSIDE) => DEEP_INSIDE,
            (all, state) => all.min(state),
        })
    });
    let bricks: Vec<u32> = (0..)
        .zip(&top)
        .filter(|(_, state)| **state < DEEP_INSIDE)
        .map(|(brick, _)| brick)
        .collect();
    for (slot, brick) in bricks.iter().enumerate() {
        top[*brick as usize] = slot as u32;
    }
    let voxel_size_m = grid.voxel_size_m as f32;
    let far = -(n_layers as i8 + 1);
    let far_m = -(n_layers as f32 + 0.5) * voxel_size_m;
    let has_gradients = members.iter().any(|member| !member.samples.gradients.is_empty());
    let joined = parallel::map(bricks.len(), 16, |slot| {
        let coord = grid.brick_coord(bricks[slot] as usize);
        let mut layers = [far; BRICK_CELLS];
        let mut values_m = [0.0; APRON_CELLS];
        let mut gradients = [Vec3::ZERO; BRICK_CELLS];
        for inside in 0..BRICK_CELLS {
            values_m[sample_of(inside)] = far_m;
        }
        for member in members {
            let state = member.state(coord);
            if state >= DEEP_INSIDE {
                continue;
            }
            let from = state as usize;
            let skin = i8::from(member.thin);
            for inside in 0..BRICK_CELLS {
                layers[inside] = layers[inside].max(member.layers.values[from][inside] + skin);
                let at = sample_of(inside);
                let value_m = member.samples.values_m[from][at] + f32::from(skin) * voxel_size_m;
                if value_m > values_m[at] {
                    values_m[at] = value_m;
                    if let Some(gradient) = member.samples.gradients.get(from) {
                        gradients[inside] = gradient[inside];
                    }
                }
            }
        }
        (layers, values_m, gradients)
    });
    let mut values = Vec::with_capacity(joined.len());
    let mut samples = Samples { values_m: Vec::with_capacity(joined.len()), gradients: Vec::new() };
    for (layers, values_m, gradients) in joined {
        values.push(layers);
        samples.values_m.push(values_m);
        if has_gradients {
            samples.gradients.push(gradients);
        }
    }
    (Layers { grid, top, bricks, values: Arc::new(values), n_layers }, samples)
}
