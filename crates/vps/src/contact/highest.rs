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
            if f64::from(value_m) > highest.value_m {
                let point = block.and_then(|block| {
                    let place = Place::new(&obstacle.field, map_from_body);
                    highest_of_block(&obstacle.field, &place, shell, block)
                });
                highest = Self {
                    value_m: value_m.into(),
                    at: point.map(|point_idx| (obstacle_idx, point_idx)),
                };
            }
        }
        highest
    }
}

/// Number of the point of a block at which V is largest.
fn highest_of_block(field: &Field, place: &Place, shell: &Shell, block: u32) -> Option<u32> {
    let positions = shell.positions().get(block as usize)?;
    let first = block * LANES as u32;
    let value_m = |lane: &u32| {
        let cells = place.cells(positions.get(*lane as usize));
        field.value(FieldKind::Trilinear, cells, Vec3::ZERO)
    };
    let lanes = (0..LANES as u32).filter(|lane| ((first + lane) as usize) < shell.len());
    lanes.max_by(|a, b| value_m(a).total_cmp(&value_m(b))).map(|lane| first + lane)
}
