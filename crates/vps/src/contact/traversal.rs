//! How a tick finds what touches: everything that can be prepared is, once.

#![expect(clippy::disallowed_types, reason = "sized when the scene is made ready, never resized")]

use glam::{DQuat, DVec3};

use super::budget::Budget;
use super::contact_block::{Contact, ContactBlock};
use super::faces::BlockFaces;
use super::immersion::{Extents, slack_m};
use super::kernel::{Above, Blocks, Depths, Place};
use super::obstacle_poses::{FarSum, ObstaclePoses};
use super::summing::FaceSums;
use super::tree_traversal::{Lists, QueryResult, TreeTraversal};
use super::{Obstacle, flat};
use crate::pointshell::shell::{LANES, Shell};
use crate::pointshell::tree::CHILDREN;
use crate::simd::SimdLevel;
use crate::spatial::Pose;
use crate::voxmap::field::FieldKind;

/// What a traversal looks at.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum TraversalMode {
    /// Down the tree, past what cannot touch.
    #[default]
    Tree,
    /// Over every point of the shell.
    Flat,
}

/// Finds the blocks of a shell that touch an obstacle, tick after tick.
///
/// Owns all memory that this takes, and the proofs of earlier ticks. Walks interpolate: with
/// another field than `trilinear` every point is looked up, as `flat` does.
#[derive(Clone, Debug)]
pub struct Traversal {
    simd_level: SimdLevel,
    mode: TraversalMode,
    budget: Budget,
    /// Of what is left of it in this tick.
    left: Budget,
    /// One per obstacle.
    walks: Vec<Option<TreeTraversal>>,
    obstacle_poses: ObstaclePoses,
    lists: Lists,
    touched: Vec<ContactBlock>,
    /// `[n_blocks]`: the faces of each block of the shell.
    faces: Box<[BlockFaces]>,
    /// `None` while a query has it.
    sums: Option<FaceSums>,
}

impl Traversal {
    /// Prepares the traversal of a shell against obstacles. Allocates; RT: start-up only.
    pub fn new(
        simd_level: SimdLevel,
        mode: TraversalMode,
        obstacles: &[Obstacle],
        shell: &Shell,
    ) -> Self {
        let walks: Vec<Option<TreeTraversal>> =
            obstacles.iter().map(|obstacle| TreeTraversal::new(&obstacle.field, shell)).collect();
        Self {
            simd_level,
            mode,
            budget: Budget::Unlimited,
            left: Budget::Unlimited,
            obstacle_poses: ObstaclePoses::new(
                obstacles,
                walks.iter().map(|walk| walk.as_ref().map(TreeTraversal::bounds)),
            ),
            walks,
            lists: Lists::new(shell),
            touched: Vec::with_capacity(shell.positions().len()),
            faces: BlockFaces::all_of(shell),
            sums: Some(FaceSums::new()),
        }
    }

    /// The same with convex edges of the obstacles as interpolation has them.
    #[must_use]
    pub fn without_planes(mut self) -> Self {
        self.walks.iter_mut().flatten().for_each(TreeTraversal::leave_planes_out);
        self
    }

    /// Limits what a tick may look at; `Flat` knows no limit.
    pub fn set_budget(&mut self, budget: Budget) {
        self.budget = budget;
    }

    /// What a tick may look at.
    pub fn budget(&self) -> Budget {
        self.budget
    }

    /// Whether obstacles far away are passed over. They are, unless it is to be shown that it makes
    /// no difference.
    #[must_use]
    pub fn with_broad_phase(mut self, on: bool) -> Self {
        self.obstacle_poses.set_culling(on);
        self
    }

    /// How many obstacles the last tick asked; the others are far away.
    pub fn n_near(&self) -> usize {
        self.obstacle_poses.n_near()
    }

    /// Where the obstacles stand.
    pub fn obstacle_poses(&self) -> &ObstaclePoses {
        &self.obstacle_poses
    }

    /// Where the obstacles stand.
    pub fn obstacle_poses_mut(&mut self) -> &mut ObstaclePoses {
        &mut self.obstacle_poses
    }

    /// Forgets the proofs of earlier ticks.
    pub fn forget(&mut self) {
        self.walks.iter_mut().flatten().for_each(TreeTraversal::forget);
    }

    /// A pose of the shell at which one of its points lies in the middle of a brick that holds
    /// surface of an obstacle, another one each `turn`; `None` without a surface or a point. Cold.
    pub fn overlapping_pose(
        &self,
        obstacles: &[Obstacle],
        shell: &Shell,
        turn: usize,
    ) -> Option<Pose> {
        let obstacle_idx = turn.checked_rem(obstacles.len())?;
        let obstacle = obstacles.get(obstacle_idx)?;
        let walk = self.walks.get(obstacle_idx)?.as_ref()?;
        let world_from_map = self.obstacle_poses.pose(obstacle_idx)?.world_from_map;
        // Multiples of the golden ratio: spread evenly, however many turns there are.
        let spread = |stride: f64, n: usize| ((turn as f64 * stride).fract() * n as f64) as usize;
        let cells = walk.bounds().surface_place(spread(0.618_034, walk.bounds().top().len()))?;
        let place_map = obstacle.field.origin_map().as_dvec3()
            + cells.as_dvec3() * f64::from(obstacle.field.voxel_size_m());
        let point = spread(0.754_878, shell.len());
        let arm = shell.positions().get(point / LANES)?.get(point % LANES).as_dvec3();
        let rotation = DQuat::from_scaled_axis(DVec3::new(1.3, 2.1, 0.7) * turn as f64);
        Some(Pose::new(rotation, world_from_map.transform_point(place_map) - rotation * arm))
    }

    pub(super) fn simd_level(&self) -> SimdLevel {
        self.simd_level
    }

    /// Memory for the sums of a query, which brings it back. RT: safe; allocates only where one did
    /// not.
    pub(super) fn take_sums(&mut self) -> FaceSums {
        self.sums.take().unwrap_or_default()
    }

    /// Takes it back.
    pub(super) fn keep_sums(&mut self, sums: FaceSums) {
        self.sums = Some(sums);
    }

    /// The face that all that touches of a block belongs to; `None` of several.
    #[inline]
    pub(super) fn face(&self, touched: &ContactBlock) -> Option<u8> {
        self.faces.get(touched.block as usize)?.only(touched.lanes)
    }

    /// What touches of a block, by face.
    #[inline]
    pub(super) fn split(&self, touched: &ContactBlock) -> impl Iterator<Item = (u8, ContactBlock)> {
        self.faces.get(touched.block as usize).into_iter().flat_map(|faces| faces.split(touched))
    }

    /// A new tick begins, with the tool at this pose. Returns what obstacles far away add.
    pub(super) fn begin(
        &mut self,
        shell: &Shell,
        world_from_body: Pose,
        overstated_voxels: f64,
    ) -> FarSum {
        self.left = self.budget;
        self.touched.clear();
        self.obstacle_poses.look_around(shell, world_from_body, overstated_voxels)
    }

    /// Finds what touches an obstacle, the n-th of those that are near; [`Self::touched`] has it
    /// until the next call. RT: safe; allocates nothing.
    pub(super) fn find(
        &mut self,
        (n, obstacle_idx): (usize, usize),
        obstacle: &Obstacle,
        kind: FieldKind,
        shell: &Shell,
        map_from_body: Pose,
    ) -> QueryResult {
        let Self {
            simd_level,
            mode,
            budget: _,
            left,
            walks,
            obstacle_poses,
            lists,
            touched,
            faces: _,
            sums: _,
        } = self;
        touched.clear();
        let n_obstacles_left = obstacle_poses.n_near().saturating_sub(n);
        let place = Place::new(&obstacle.field, map_from_body);
        match walks.get_mut(obstacle_idx).and_then(Option::as_mut) {
            Some(walk) if kind == FieldKind::Trilinear => {
                if *mode == TraversalMode::Tree && place.is_finite() {
                    let found = walk.find(
                        *simd_level,
                        shell,
                        (&place, map_from_body),
                        left.share(n_obstacles_left),
                        lists,
                        touched,
                    );
                    *left = left.without(found.looked_at);
                    found
                } else {
                    let max_value_m = all(*simd_level, walk, shell, &place, touched);
                    QueryResult::of_all(max_value_m, shell.reach_m() + walk.slack_m())
                }
            }
            _ => {
                let field = &obstacle.field;
                let all = |block: &ContactBlock| touched.push(*block);
                let max_value_m = flat::blocks(field, kind, shell, map_from_body, all);
                QueryResult::of_all(max_value_m, shell.reach_m() + slack_m(field, kind))
            }
        }
    }

    /// Largest V of all points of the shell at an obstacle that none of them touches, m, and the
    /// block of that point where a walk finds it. RT: safe.
    pub(super) fn highest_m(
        &mut self,
        obstacle_idx: usize,
        obstacle: &Obstacle,
        kind: FieldKind,
        shell: &Shell,
        map_from_body: Pose,
    ) -> (f32, Option<u32>) {
        let place = Place::new(&obstacle.field, map_from_body);
        match self.walks.get(obstacle_idx).and_then(Option::as_ref) {
            Some(walk) if kind == FieldKind::Trilinear && place.is_finite() => {
                walk.highest_m(self.simd_level, shell, &place, &mut self.lists)
            }
            _ => (flat::blocks(&obstacle.field, kind, shell, map_from_body, |_| ()), None),
        }
    }

    /// Notes what was found of an obstacle that is under way, for its next step: its largest V and
    /// its deepest contact. RT: safe; O(touched).
    pub(super) fn note_pressed(
        &mut self,
        (obstacle_idx, obstacle): (usize, &Obstacle),
        shell: &Shell,
        world_from_body: Pose,
        max_value_m: f32,
    ) {
        let Some(pose) = self.obstacle_poses.pose(obstacle_idx) else { return };
        let map_from_body = pose.world_from_map.inverse() * world_from_body;
        let mut deepest: Option<Contact> = None;
        for touched in &self.touched {
            let depth_m = |touched: &ContactBlock| {
                touched
                    .lanes()
                    .filter_map(|lane| touched.depths_m.get(lane))
                    .fold(0.0, |a, b| b.max(a))
            };
            if deepest.is_none_or(|deepest| depth_m(touched) > deepest.depth_m) {
                touched.contacts(&obstacle.field, shell, map_from_body, |contact| {
                    if deepest.is_none_or(|deepest| contact.depth_m > deepest.depth_m) {
                        deepest = Some(*contact);
                    }
                });
            }
        }
        let Some(pose) = self.obstacle_poses.pose_mut(obstacle_idx) else { return };
        pose.max_value_m = f64::from(max_value_m);
        pose.deepest_world = deepest.map(|contact| {
            let point = world_from_body.transform_point(contact.arm_body.as_dvec3());
            (point, obstacle.way_out_world(pose.world_from_map, world_from_body, &contact))
        });
    }

    /// What touches the obstacle that was asked for last, in the order of the shell; with a budget,
    /// points that stand for others first.
    pub fn touched(&self) -> &[ContactBlock] {
        &self.touched
    }
}

/// Every block in turn, past those of which one look at their sphere says that they can neither
/// touch, be it with a corner of a facet, nor hold the highest point so far.
fn all(
    simd_level: SimdLevel,
    walk: &TreeTraversal,
    shell: &Shell,
    place: &Place,
    touched: &mut Vec<ContactBlock>,
) -> f32 {
    let bounds = walk.bounds();
    let extents = Extents::of(shell, walk.limit_m(), walk.slack_m());
    let reach_m = walk.reach_m();
    let floor = |max_m: f32| max_m.min(-reach_m);
    let margin_cells = walk.margin_cells(place);
    let tree = shell.tree();
    let leaves = tree.n_levels().checked_sub(1).map_or(&[][..], |last| tree.spheres(last));
    let mut highest_m = f32::NEG_INFINITY;
    for (first, spheres) in (0_u32..).step_by(CHILDREN).zip(leaves) {
        let above = simd_level.run(Above {
            bounds,
            place,
            spheres,
            floor_m: floor(highest_m),
            margin_cells,
        });
        if above == 0 {
            continue;
        }
        let which = (first..).take(CHILDREN).filter(|block| above >> (block - first) & 1 == 1);
        let found = |_, depths: &Depths| {
            if depths.touched.lanes != 0 {
                touched.push(depths.touched);
            }
        };
        let floor = |max_m: f32| floor(max_m.max(highest_m));
        let max_m = simd_level.run(Blocks {
            bounds,
            place,
            positions: shell.positions(),
            extents,
            which,
            floor,
            found,
        });
        highest_m = highest_m.max(max_m);
    }
    highest_m
}
