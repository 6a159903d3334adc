//! Points that stand for others, looked up by the block.

#![expect(clippy::disallowed_types, reason = "pushes into a list that is sized when the scene is made ready")]

use super::contact_block::ContactBlock;
use super::kernel::{Blocks, Depths, Place};
use crate::pointshell::shell::{LANES, Lanes, Lanes3, Shell};
use crate::simd::SimdLevel;
use crate::voxmap::field::brick_bounds::BrickBounds;

/// Single points, gathered into a block.
#[derive(Clone, Copy, Debug)]
pub(super) struct Samples {
    positions: Lanes3,
    /// Points and the surface that they stand for, as a multiple of their own.
    points: [(u32, f32); LANES],
    n: usize,
}

impl Default for Samples {
    fn default() -> Self {
        let none = Lanes([f32::NAN; LANES]);
        Self { positions: Lanes3 { x: none, y: none, z: none }, points: [(0, 0.0); LANES], n: 0 }
    }
}

impl Samples {
    /// A point that stands for so much surface, s².
    pub(super) fn push(&mut self, shell: &Shell, point: u32, weight: f32) {
        let (block, lane) = (point as usize / LANES, point as usize % LANES);
        let own = shell.weights().get(block).and_then(|weights| weights.0.get(lane)).copied().unwrap_or(1.0);
        let weight = weight / own.max(f32::MIN_POSITIVE);
        let (Some(positions), Some(place)) = (shell.positions().get(block), self.points.get_mut(self.n)) else { return };
        self.positions.set(self.n, positions.get(lane));
        *place = (point, weight);
        self.n += 1;
    }

    pub(super) fn is_full(&self) -> bool {
        self.n == LANES
    }

    /// Reports those that touch, each as a block with one lane, and starts anew.
    pub(super) fn look(
        &mut self,
        simd_level: SimdLevel,
        bounds: &BrickBounds,
        place: &Place,
        touched: &mut Vec<ContactBlock>,
    ) -> f32 {
        let Self { positions, points, n } = core::mem::take(self);
        if n == 0 {
            return f32::NEG_INFINITY;
        }
        let found = |_, depths: &Depths| {
            for (lane, (point, weight)) in points.into_iter().enumerate().take(n) {
                if depths.touching >> lane & 1 == 1 {
                    let (block, lane_of_block) = (point / LANES as u32, point % LANES as u32);
                    let depth_m = depths.depths_m.0.get(lane).copied().unwrap_or(0.0);
                    let depths_m = [depth_m; LANES];
                    touched.push(ContactBlock { block, lanes: 1 << lane_of_block, weight, depths_m });
                }
            }
        };
        let (positions, floor) = (core::slice::from_ref(&positions), |_| f32::NEG_INFINITY);
        simd_level.run(Blocks { bounds, place, positions, which: core::iter::once(0), floor, found })
    }
}
