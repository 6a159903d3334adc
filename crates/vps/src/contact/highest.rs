//! Which point of a tool is nearest to what it does not touch.

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
    /// Number of the obstacle; `None` of a box.
    pub(crate) obstacle_idx: Option<usize>,
    /// Block of the point, where a walk has found it.
    block: Option<u32>,
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
        let mut highest = Self { value_m: far_m, obstacle_idx: None, block: None };
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
                let obstacle_idx = Some(obstacle_idx);
                highest = Self { value_m: value_m.into(), obstacle_idx, block };
            }
        }
        highest
    }

    /// Number of the point in the shell, which stands there in the map of the obstacle. O(1), and
    /// O(points) where no walk has found it.
    pub(crate) fn point(&self, field: &Field, shell: &Shell, map_from_body: Pose) -> Option<u32> {
        let place = Place::new(field, map_from_body);
        let value_m = |point: &u32| {
            let block = shell.positions().get(*point as usize / LANES);
            let position = block.map_or(Vec3::ZERO, |block| block.get(*point as usize % LANES));
            field.value(FieldKind::Trilinear, place.cells(position), Vec3::ZERO)
        };
        let n_points = shell.len() as u32;
        let points = self.block.map_or(0..n_points, |block| {
            let first = block * LANES as u32;
            first..(first + LANES as u32).min(n_points)
        });
        points.max_by(|a, b| value_m(a).total_cmp(&value_m(b)))
    }
}
