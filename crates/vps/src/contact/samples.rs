//! Points that stand for others, looked up by the block.

#![expect(
    clippy::disallowed_types,
    reason = "pushes into a list that is sized when the scene is made ready"
)]

use super::contact_block::ContactBlock;
use super::immersion::Extents;
use super::kernel::{Blocks, Depths, Place};
use crate::pointshell::shell::{LANES, Lanes, Lanes3, Shell};
use crate::simd::SimdLevel;
use crate::voxmap::field::brick_bounds::BrickBounds;

/// Single points, gathered into a block.
#[derive(Clone, Copy, Debug)]
pub(super) struct Samples {
    positions: Lanes3,
    half_axes: [Lanes3; 2],
    /// The longest reach of the blocks that they are of, m.
    reach_m: f32,
    /// Points and the surface that they stand for, as a multiple of their own; the same for all of
    /// a block.
    points: [(u32, f32); LANES],
    n: usize,
}

impl Default for Samples {
    fn default() -> Self {
        let none = Lanes([f32::NAN; LANES]);
        Self {
            positions: Lanes3 { x: none, y: none, z: none },
            half_axes: [Lanes3::ZERO; 2],
            reach_m: 0.0,
            points: [(0, 0.0); LANES],
            n: 0,
        }
    }
}

impl Samples {
    /// A point that stands for this multiple of its own surface.
    pub(super) fn push(&mut self, shell: &Shell, point: u32, weight: f32) {
        let block = point as usize / LANES;
        let lane = point as usize % LANES;
        let (Some(positions), Some(place)) =
            (shell.positions().get(block), self.points.get_mut(self.n))
        else {
            return;
        };
        self.positions.set(self.n, positions.get(lane));
        if let (Some([a, b]), Some(reach_m)) =
            (shell.half_axes().get(block), shell.reaches_m().get(block))
        {
            let [own_a, own_b] = &mut self.half_axes;
            own_a.set(self.n, a.get(lane));
            own_b.set(self.n, b.get(lane));
            self.reach_m = self.reach_m.max(*reach_m);
        }
        *place = (point, weight);
        self.n += 1;
    }

    pub(super) fn has_room_for(&self, n: usize) -> bool {
        self.n + n <= LANES
    }

    /// Reports those that touch, points of one block that follow each other as one, and starts
    /// anew.
    pub(super) fn look(
        &mut self,
        simd_level: SimdLevel,
        (bounds, limit_m, slack_m): (&BrickBounds, f32, f32),
        place: &Place,
        touched: &mut Vec<ContactBlock>,
    ) -> f32 {
        let Self { positions, half_axes, reach_m, points, n } = core::mem::take(self);
        if n == 0 {
            return f32::NEG_INFINITY;
        }
        let found = |_, Depths { touched: found, .. }: &Depths| {
            let mut last: Option<ContactBlock> = None;
            for (lane, (point, weight)) in points.into_iter().enumerate().take(n) {
                if found.lanes >> lane & 1 == 0 {
                    continue;
                }
                let block = point / LANES as u32;
                let lane_of_block = point as usize % LANES;
                if last.is_some_and(|last| last.block != block) {
                    touched.extend(last.take());
                }
                let one = last.get_or_insert(ContactBlock {
                    block,
                    weight,
                    limit_m,
                    ..ContactBlock::NONE
                });
                one.lanes |= 1 << lane_of_block;
                one.clipped |= (found.clipped >> lane & 1) << lane_of_block;
                if let (Some(depth_m), Some(of_lane)) =
                    (found.depths_m.get(lane), one.depths_m.get_mut(lane_of_block))
                {
                    *of_lane = *depth_m;
                    one.gradients.set(lane_of_block, found.gradients.get(lane));
                    let shortfalls_m = found.shortfalls_m.map(|of| of.0.get(lane).copied());
                    one.set_shortfalls(lane_of_block, shortfalls_m.map(Option::unwrap_or_default));
                }
            }
            touched.extend(last);
        };
        let positions = core::slice::from_ref(&positions);
        let (half_axes, reaches_m) =
            (core::slice::from_ref(&half_axes), core::slice::from_ref(&reach_m));
        let extents = Extents::new(half_axes, reaches_m, limit_m, slack_m);
        let floor = |_| f32::NEG_INFINITY;
        simd_level.run(Blocks {
            bounds,
            place,
            positions,
            extents,
            which: core::iter::once(0),
            floor,
            found,
        })
    }
}
