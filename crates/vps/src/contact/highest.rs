//! Which point of a tool is nearest to what it does not touch.

use core::ops::Range;

use glam::Vec3;

use super::kernel::Place;
use super::{ForceLaw, Obstacle, Traversal};
use crate::pointshell::shell::{LANES, Shell};
use crate::spatial::Pose;
use crate::voxmap::field::{Field, FieldKind};

/// The point that is nearest to an obstacle, while none touches.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Highest {
    /// V there, m: minus its distance. Where no point is within the box of any obstacle, that of
    /// the nearest box.
    pub(crate) value_m: f64,
    /// Numbers of the obstacle and of the point in the shell; `None` of a box.
    pub(crate) at: Option<(usize, u32)>,
}

impl Highest {
    /// To the bit what a look at every point finds. Costs about what contact costs. RT: safe.
    pub(crate) fn of(
        traversal: &mut Traversal,
        obstacles: &[Obstacle],
        shell: &Shell,
        world_from_body: Pose,
        law: ForceLaw,
    ) -> Self {
        // Of obstacles far away what is outside of their boxes.
        let far_m = traversal.begin(shell, world_from_body, 0.0).max_value_m;
        let mut highest = Self { value_m: far_m, at: None };
        for n in 0..traversal.n_near() {
            let Some(obstacle_idx) = traversal.obstacle_poses().near(n) else { break };
            let (Some(obstacle), Some(pose)) =
                (obstacles.get(obstacle_idx), traversal.obstacle_poses().pose(obstacle_idx))
            else {
                break;
            };
            let map_from_body = pose.world_from_map.inverse() * world_from_body;
            let (value_m, block) =
                traversal.highest_m(obstacle_idx, obstacle, law.field, shell, map_from_body);
            // Planes may have said that a point does not touch which interpolation has inside.
            let value_m = value_m.min(0.0);
            if f64::from(value_m) > highest.value_m {
                let place = Place::new(&obstacle.field, map_from_body);
                let n_points = shell.len() as u32;
                let points = block.map_or(0..n_points, |block| {
                    let first = block * LANES as u32;
                    first..(first + LANES as u32).min(n_points)
                });
                let point = highest_of(&obstacle.field, &place, shell, points);
                highest = Self {
                    value_m: value_m.into(),
                    at: point.map(|point_idx| (obstacle_idx, point_idx)),
                };
            }
        }
        highest
    }
}

/// That of these points at which V is largest.
fn highest_of(field: &Field, place: &Place, shell: &Shell, points: Range<u32>) -> Option<u32> {
    let value_m = |point: &u32| {
        let (block, lane) = (*point as usize / LANES, *point as usize % LANES);
        let block = shell.positions().get(block)?;
        Some(field.value(FieldKind::Trilinear, place.cells(block.get(lane)), Vec3::ZERO))
    };
    points.max_by(|a, b| value_m(a).unwrap_or(f32::MIN).total_cmp(&value_m(b).unwrap_or(f32::MIN)))
}
