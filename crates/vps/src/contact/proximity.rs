//! Points of the tool that are about to touch: within a voxel of an obstacle's surface, not in it
//! yet, and turned to it.
//!
//! Turned to it, because the foot of a face that stands upright on a floor is near to it as well,
//! and slides along without ever touching.
//!
//! The walk that finds contacts, over the bounds of an obstacle that is a voxel thicker, with
//! proofs of its own. It costs what a contact query costs, and only while something is near.

#![expect(clippy::disallowed_types, reason = "sized when the scene is made ready, never resized")]

use glam::Vec3;

use super::contact_block::{Contact, ContactBlock};
use super::kernel::Place;
use super::tree_traversal::{Lists, TreeTraversal};
use super::{ContactSum, Obstacle, Traversal};
use crate::pointshell::shell::{LANES, Shell};
use crate::simd::SimdLevel;
use crate::spatial::Pose;
use crate::voxmap::field::brick_bounds::BrickBounds;

/// Thickness of the layer ahead of a surface, voxels.
const LAYER_VOXELS: f32 = 1.0;
/// A point is turned to a surface when its normal is within 60° of the way out.
const TURNED_COSINE: f32 = 0.5;
/// Share of what is known of a field outside its object that the layer may take: beyond, far and
/// near look alike.
const KNOWN_SHARE: f32 = 0.99;

/// Finds the points ahead of contact, tick after tick. Owns all memory that this takes.
#[derive(Clone, Debug)]
pub struct Proximity {
    simd_level: SimdLevel,
    /// One per obstacle; `None` where it cannot be walked, which nothing is near to then.
    layers: Vec<Option<Layer>>,
    thickest_m: f64,
    lists: Lists,
    touched: Vec<ContactBlock>,
}

#[derive(Clone, Debug)]
struct Layer {
    walk: TreeTraversal,
    thickness_m: f32,
}

impl Layer {
    fn new(obstacle: &Obstacle, shell: &Shell) -> Option<Self> {
        let field = &obstacle.field;
        let thickness_m =
            (LAYER_VOXELS * field.voxel_size_m()).min(KNOWN_SHARE * field.known_outside_m());
        let bounds =
            (thickness_m > 0.0).then(|| BrickBounds::thicker(field, thickness_m)).flatten()?;
        Some(Self { walk: TreeTraversal::over(bounds, shell, 0.0)?, thickness_m })
    }
}

impl Proximity {
    /// Prepares the search. Allocates; RT: start-up only.
    pub fn new(simd_level: SimdLevel, obstacles: &[Obstacle], shell: &Shell) -> Self {
        let layers: Vec<_> = obstacles.iter().map(|obstacle| Layer::new(obstacle, shell)).collect();
        let thickest_m =
            layers.iter().flatten().map(|layer| f64::from(layer.thickness_m)).fold(0.0, f64::max);
        Self {
            simd_level,
            layers,
            thickest_m,
            lists: Lists::new(shell),
            touched: Vec::with_capacity(shell.positions().len()),
        }
    }

    /// Calls `near` with every such point as if it touched, its normal the way out. The layer is
    /// thinner than a voxel where less than that is known of the field outside.
    ///
    /// `contact`: what `traversal`, which knows where the obstacles stand, found at this pose;
    /// where its clearance says that nothing is near, nothing is looked at. What its budget left is
    /// what this may look at. RT: safe; allocates nothing.
    pub fn visit(
        &mut self,
        traversal: &Traversal,
        obstacles: &[Obstacle],
        shell: &Shell,
        world_from_body: Pose,
        contact: &ContactSum,
        mut near: impl FnMut(&Contact),
    ) {
        if contact.max_value_m <= -self.thickest_m {
            return;
        }
        let Self { simd_level, layers, thickest_m: _, lists, touched } = self;
        let mut left = traversal.budget().without(contact.looked_at);
        let n_obstacles = layers.len();
        for ((idx, obstacle), layer) in obstacles.iter().enumerate().zip(layers) {
            let (Some(Layer { walk, thickness_m }), Some(pose)) =
                (layer, traversal.obstacle_poses().pose(idx))
            else {
                continue;
            };
            let map_from_body = pose.world_from_map.inverse() * world_from_body;
            let place = Place::new(&obstacle.field, map_from_body);
            if !place.is_finite() {
                continue;
            }
            touched.clear();
            let found = walk.find(
                *simd_level,
                shell,
                (&place, map_from_body),
                left.share(n_obstacles - idx),
                lists,
                touched,
            );
            left = left.without(found.looked_at);
            for block in touched.iter() {
                let number = block.block as usize;
                let (Some(positions), Some(normals)) =
                    (shell.positions().get(number), shell.normals().get(number))
                else {
                    continue;
                };
                for lane in block.lanes() {
                    let depth_m = block.depths_m.get(lane).copied().unwrap_or(0.0);
                    // What is deeper than the layer touches.
                    if depth_m > *thickness_m {
                        continue;
                    }
                    let arm_body = positions.get(lane);
                    let weight = block.weight_of(shell, lane);
                    let normal = normals.get(lane);
                    let is_turned =
                        |out: &Vec3| normal == Vec3::ZERO || out.dot(normal) > TURNED_COSINE;
                    let way_out = block.way_out(lane).filter(is_turned);
                    if let Some(normal_body) = way_out {
                        let point_idx = block.block * LANES as u32 + lane as u32;
                        let contact = Contact::of_point(point_idx, depth_m, arm_body, normal_body);
                        near(&Contact { weight, ..contact });
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::{DVec3, Vec3};

    use super::*;
    use crate::contact::tests::plate;
    use crate::contact::{Budget, ForceLaw, TraversalMode};

    /// Millimetres above the plate, and a normal.
    fn point(x: f64, z: f64, normal: DVec3) -> (DVec3, DVec3) {
        (DVec3::new(x, 0.0, z) * 1e-3, normal)
    }

    /// A block far above the plate, and one with a point in it, one beside it that is upright, one
    /// beside it that leans by 30°, and one above.
    fn shell() -> Shell {
        let mut points = [point(0.0, 3.0, DVec3::Z); LANES + 4];
        points[LANES] = point(1.0, -0.5, DVec3::Z);
        points[LANES + 1] = point(2.0, 0.5, DVec3::X);
        points[LANES + 2] = point(3.0, 0.5, DVec3::new(0.5, 0.0, 0.75_f64.sqrt()));
        Shell::new(&points, 1e-3)
    }

    /// What is near with a budget that leaves so many points.
    fn near(obstacles: &[Obstacle], left: Option<u32>) -> Vec<Contact> {
        let shell = shell();
        let level = SimdLevel::best();
        let mut traversal = Traversal::new(level, TraversalMode::Tree, obstacles, &shell);
        let pose = Pose::IDENTITY;
        let sum = ContactSum::of(&mut traversal, obstacles, &shell, pose, ForceLaw::PLAIN, None);
        assert_eq!(sum.contacts, 1);
        if let Some(left) = left {
            traversal.set_budget(Budget::Points(sum.looked_at + left));
        }
        let mut search = Proximity::new(level, obstacles, &shell);
        let mut found = Vec::new();
        search.visit(&traversal, obstacles, &shell, pose, &sum, |contact| found.push(*contact));
        found
    }

    /// Nothing but the leaning point, half a millimetre deep in a layer of one, which the plate
    /// pushes upwards.
    fn assert_leaning(found: &[Contact]) {
        let [Contact { point_idx, depth_m, weight, arm_body, normal_body, .. }] = *found else {
            panic!("{found:?}");
        };
        assert_eq!((point_idx, weight), (LANES as u32 + 2, 1.0));
        assert_eq!(arm_body, (DVec3::new(3.0, 0.0, 0.5) * 1e-3).as_vec3());
        assert!(
            (depth_m - 5e-4).abs() < 1e-6 && (normal_body - Vec3::Z).length() < 1e-3,
            "{found:?}"
        );
    }

    #[test]
    fn near_is_what_is_turned_to_a_surface_within_a_voxel_and_does_not_touch_it() {
        assert_leaning(&near(&[plate()], None));
    }

    #[test]
    fn no_more_is_looked_at_than_the_budget_of_the_traversal_leaves() {
        // Eight spheres are too many.
        assert_eq!(near(&[plate()], Some(7)), []);
    }

    #[test]
    fn an_obstacle_far_away_leaves_the_budget_to_the_next() {
        let far = Obstacle { world_from_map: Pose::from_translation(DVec3::Z * -1.0), ..plate() };
        // Eight spheres of the one far away; eight, eight and sixteen points of the other.
        assert_leaning(&near(&[far, plate()], Some(60)));
    }
}
