//! The walk over the point-sphere tree: finds what the flat traversal finds, and leaves out what
//! cannot touch.
//!
//! ```text
//!   level by level, in the order of the nodes:
//!     still clear since an earlier tick?  ──yes──► skip
//!     sphere clear of the obstacle?       ──yes──► skip, remember for how long
//!     budget left?                        ──no───► its representative stands for it
//!     else                                ───────► its children; of a leaf, its sixteen points, or some of them
//! ```
//! - **Clear** is proven, not guessed: a sphere is left out when its centre is farther than its
//!   radius from all that can be as deep as minus the reach of the shell's facets (see
//!   `BrickBounds` and `kernel`), and so are its points, wherever in it they lie.
//! - **For how long**: the proof holds until the tool has moved by what was to spare. The way that
//!   a node's points have gone is at most Σ|Δx| + r·Σ|Δθ|, x the centre of mass and r the node's
//!   reach about it, both seen from the obstacle. The sums are kept per obstacle, each node
//!   remembers the value of its own at which it is due.
//! - **The same bits as the flat traversal**: blocks are reported in the order of the shell, and
//!   each block is looked up by the same kernel. What is not the same is the largest V while
//!   nothing touches: the walk gives what it has proven instead.
//!
//! # Source
//! BarbicJames2008 and Sagardia2019 (breadth-first, prune, time-critical levels); the clearance
//! that is used up by motion: McNeely2006, BarbicJames2008. The bounds are ours.

#![expect(clippy::disallowed_types, reason = "sized when the scene is made ready, never resized")]

use core::ops::Range;
use std::sync::Arc;

use glam::DVec3;

use super::budget::{Budget, Choice};
use super::contact_block::ContactBlock;
use super::immersion::{Extents, limit_m, slack_m, with_slack_m};
use super::kernel::{Blocks, Ceilings, Clearance, Depths, Place, free_cells};
use super::samples::Samples;
use crate::pointshell::shell::{LANES, Lanes, Shell};
use crate::pointshell::tree::{CHILDREN, Spheres};
use crate::simd::SimdLevel;
use crate::spatial::Pose;
use crate::voxmap::field::brick_bounds::BrickBounds;
use crate::voxmap::field::{Field, FieldKind};

#[cfg(test)]
mod tests;

/// What rounding may take from a clearance, cells: of the sums of motion up to [`FORGET_CELLS`], of
/// a due value, of a position.
const MARGIN_CELLS: f32 = 2e-3;
/// The same of a position as a share of how far it lies from the grid's corner.
const MARGIN_SHARE: f32 = 1e-6;
/// Motion after which all proofs are forgotten, so that its sum stays exact enough in `f32`, cells.
const FORGET_CELLS: f64 = 1024.0;
/// No proof reaches further, for the same reason, cells.
const PROOF_CELLS: f32 = 1024.0;
/// A node of which nothing is known: neither clear nor to be opened unseen.
const UNKNOWN: f32 = 0.0;
/// A node that reaches so deep that it stays open is looked at again after a motion of so many
/// cells. Opening one too many costs time only.
const OPEN_CELLS: f32 = 1.0;
/// What refining costs is known only afterwards, so a budget that does not suffice in the worst
/// case is asked again.
const ROUNDS: usize = 6;
/// A ceiling down here is as good a proof as a sample: points below it are not interpolated,
/// voxels.
const FLOOR_VOXELS: f32 = 2.0;

/// What a walk found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct QueryResult {
    /// Largest V, m, or more than that.
    pub(super) max_value_m: f32,
    /// It may be more.
    pub(super) is_bound: bool,
    /// While nothing touches: how far the tool may move in any way before anything does, m.
    pub(super) free_way_m: f32,
    /// Points and spheres looked at.
    pub(super) looked_at: u32,
    /// Points that others stood for.
    pub(super) left_out: u32,
}

impl QueryResult {
    /// Of a look at every point of a shell whose facets reach so far.
    pub(super) fn of_all(max_value_m: f32, reach_m: f32) -> Self {
        let free_way_m = (-max_value_m - reach_m).max(0.0);
        Self { max_value_m, is_bound: false, free_way_m, looked_at: 0, left_out: 0 }
    }
}

/// A node that may hold the highest point.
#[derive(Clone, Copy, Debug)]
struct Ceiling {
    /// What no point below it exceeds, m.
    highest_m: f32,
    /// How high the field at its centre lets it reach, m.
    reached_m: f32,
    level: usize,
    node: u32,
}

/// The lists that all walks share.
#[derive(Clone, Debug)]
pub(super) struct Lists {
    open: Vec<u32>,
    next: Vec<u32>,
    ceilings: Vec<Ceiling>,
    samples: Samples,
}

impl Lists {
    pub(super) fn new(shell: &Shell) -> Self {
        let n_leaves = shell.positions().len().max(CHILDREN);
        Self {
            open: Vec::with_capacity(n_leaves),
            next: Vec::with_capacity(n_leaves),
            ceilings: Vec::with_capacity(CHILDREN * (shell.tree().n_levels() + 1)),
            samples: Samples::default(),
        }
    }
}

/// One obstacle's walk.
#[derive(Clone, Debug)]
pub(super) struct TreeTraversal {
    bounds: Arc<BrickBounds>,
    /// `[n_blocks of the tree]`, cells: farthest point of each node from the centre of mass, at
    /// most.
    reaches_cells: Arc<Vec<[f32; CHILDREN]>>,
    /// `[n_blocks of the tree]`, cells: motion up to which a node is clear; or, negative, up to
    /// which it is opened without another look.
    clear_until_cells: Vec<[f32; CHILDREN]>,
    /// `[n_blocks of the last level]`, a bit for each leaf: what is known of it comes from its points,
    /// of which none touches, not from its sphere.
    by_points: Vec<u8>,
    /// First block of each level.
    first_blocks: Arc<Vec<u32>>,
    /// `[n_blocks of the tree]`, cells: how far each node's centre was outside of what can touch
    /// when it was looked at last; kept while a budget limits the walk.
    outside_cells: Vec<[f32; CHILDREN]>,
    /// `[n_blocks of the tree]`: when something below a node touched last; kept likewise.
    touched_at: Vec<[u32; CHILDREN]>,
    now: u32,
    reach_cells: f32,
    /// See [`limit_m`]; 0 where facets count as points.
    limit_m: f32,
    /// See [`slack_m`].
    slack_m: f32,
    motion: Motion,
    turn: u64,
}

/// How far the tool has moved, seen from the obstacle.
#[derive(Clone, Copy, Debug, Default)]
struct Motion {
    last: Option<Pose>,
    /// Σ|Δx|, cells.
    along_cells: f64,
    /// Σ|Δθ|, rad.
    about_rad: f64,
    /// The last step of either.
    step: (f64, f64),
}

impl Motion {
    fn follow(&mut self, map_from_body: Pose, voxel_size_m: f64) {
        let last = self.last.replace(map_from_body);
        self.step = last.map_or((0.0, 0.0), |last| {
            let along_m = (map_from_body.translation - last.translation).length();
            (along_m / voxel_size_m, last.rotation_to(map_from_body).length())
        });
        self.along_cells += self.step.0;
        self.about_rad += self.step.1;
    }

    /// Way of a node's points so far, and after two more ticks like the last, by its reach.
    fn ways(&self) -> [(f32, f32); 2] {
        [0.0, 2.0].map(|ticks| {
            (
                (self.along_cells + ticks * self.step.0) as f32,
                (self.about_rad + ticks * self.step.1) as f32,
            )
        })
    }
}

impl TreeTraversal {
    /// `None` when the field or the shell is not one that can be walked. Cold.
    pub(super) fn new(field: &Field, shell: &Shell) -> Option<Self> {
        let limit_m = limit_m(field, FieldKind::Trilinear);
        let slack_m = slack_m(field, FieldKind::Trilinear);
        let reaches_m = shell.reaches_m().iter();
        let reach_m = reaches_m.map(|reach_m| with_slack_m(*reach_m, slack_m, limit_m));
        let reach_m = reach_m.fold(0.0, f32::max);
        Some(Self { slack_m, ..Self::over(BrickBounds::within(field, reach_m)?, shell, limit_m)? })
    }

    /// The same over bounds that are not just the field's; facets reach no further than `limit_m`,
    /// and than the bounds know. Cold.
    pub(super) fn over(bounds: BrickBounds, shell: &Shell, limit_m: f32) -> Option<Self> {
        let tree = shell.tree();
        let voxel_size_m = f64::from(bounds.voxel_size_m());
        let bounds = Arc::new(bounds);
        let mut first_blocks = Vec::new();
        let mut reaches_cells = Vec::new();
        for level in 0..tree.n_levels() {
            first_blocks.push(reaches_cells.len() as u32);
            reaches_cells.extend(tree.spheres(level).iter().map(|spheres| {
                let centers = spheres.x.iter().zip(&spheres.y).zip(&spheres.z);
                let mut reaches = [0.0; CHILDREN];
                for ((reach, ((x, y), z)), radius) in
                    reaches.iter_mut().zip(centers).zip(&spheres.radius)
                {
                    let far_m = DVec3::new(f64::from(*x), f64::from(*y), f64::from(*z)).length()
                        + f64::from(*radius);
                    *reach = (far_m.max(0.0) / voxel_size_m) as f32 * (1.0 + MARGIN_SHARE);
                }
                reaches
            }));
        }
        (!first_blocks.is_empty()).then(|| Self {
            bounds,
            clear_until_cells: vec_of(UNKNOWN, reaches_cells.len()),
            outside_cells: vec_of(UNKNOWN, reaches_cells.len()),
            touched_at: vec_of(0, reaches_cells.len()),
            by_points: core::iter::repeat_n(0, reaches_cells.len()).collect(),
            now: 1,
            reaches_cells: Arc::new(reaches_cells),
            first_blocks: Arc::new(first_blocks),
            reach_cells: (shell.radius_m() / voxel_size_m) as f32,
            limit_m,
            slack_m: 0.0,
            motion: Motion::default(),
            turn: 0,
        })
    }

    /// The bounds that the kernels read.
    pub(super) fn bounds(&self) -> &BrickBounds {
        &self.bounds
    }

    /// The largest depth that a facet's corner has beyond its centroid and that counts, m.
    pub(super) fn limit_m(&self) -> f32 {
        self.limit_m
    }

    /// No facet counts by planes from now on.
    pub(super) fn leave_planes_out(&mut self) {
        self.slack_m = 0.0;
    }

    /// See [`slack_m`].
    pub(super) fn slack_m(&self) -> f32 {
        self.slack_m
    }

    /// The longest reach of a facet that counts, m.
    pub(super) fn reach_m(&self) -> f32 {
        self.bounds.reach_m()
    }

    /// What rounding may take from a distance at this place, cells.
    pub(super) fn margin_cells(&self, place: &Place) -> f32 {
        MARGIN_CELLS + MARGIN_SHARE * (place.origin.abs().element_sum() + self.reach_cells)
    }

    /// Forgets all proofs.
    pub(super) fn forget(&mut self) {
        self.clear_until_cells.fill([UNKNOWN; CHILDREN]);
        self.motion = Motion { last: self.motion.last, ..Motion::default() };
    }

    /// Appends the blocks that touch, in the order of the shell; with a budget, single points that
    /// stand for others among them.
    ///
    /// `map_from_body` must be finite. RT: safe; allocates nothing as long as `touched` has room
    /// for every block of the shell.
    pub(super) fn find(
        &mut self,
        simd_level: SimdLevel,
        shell: &Shell,
        (place, map_from_body): (&Place, Pose),
        budget: Budget,
        lists: &mut Lists,
        touched: &mut Vec<ContactBlock>,
    ) -> QueryResult {
        self.motion.follow(map_from_body, f64::from(self.bounds.voxel_size_m()));
        let whole_way_cells =
            self.motion.along_cells + self.motion.about_rad * f64::from(self.reach_cells);
        if whole_way_cells.is_nan() || whole_way_cells >= FORGET_CELLS {
            self.forget();
        }
        let mut query = Query {
            simd_level,
            shell,
            place,
            spheres: &[],
            ways: self.motion.ways(),
            margin_cells: self.margin_cells(place),
            clear_cells: PROOF_CELLS,
            max_m: f32::NEG_INFINITY,
            looked_at: 0,
            left_out: 0,
            passes_points: false,
            is_limited: budget != Budget::Unlimited,
            per_voxel: 1.0 / self.bounds.voxel_size_m(),
            limit_m: self.limit_m,
            slack_m: self.slack_m,
        };
        lists.open.clear();
        lists.open.push(0);
        for level in 0..self.first_blocks.len() {
            self.refine(level, budget, &mut query, lists);
            // What could not be refined is represented on the level that it is of.
            query.represent(&self.bounds, level.checked_sub(1), lists, touched);
            core::mem::swap(&mut lists.open, &mut lists.next);
            // An obstacle far away is done with its root.
            if lists.open.is_empty() {
                break;
            }
        }
        if budget == Budget::Unlimited {
            query.look_at_leaves(self, &lists.open, touched);
        } else {
            self.look_at_leaves_within(budget, &mut query, lists, touched);
            self.now = self.now.wrapping_add(1);
            touched.iter().for_each(|touched| self.mark(touched.block));
        }
        let outside_m = self.bounds.skin_m() - self.bounds.band_m();
        let voxel_size_m = self.bounds.voxel_size_m();
        let reach_m = self.bounds.reach_m();
        // Spheres that were left out are no deeper than minus the reach; of a leaf whose points were
        // looked at in an earlier tick it is only known that none of them touches.
        let is_known = query.max_m > -reach_m && !query.passes_points && query.left_out == 0;
        let bound_m = if is_known {
            query.max_m
        } else {
            query.max_m.max(-query.clear_cells.max(0.0) * voxel_size_m)
        };
        let max_value_m = bound_m.max(outside_m);
        // Points that stand for others prove nothing of those.
        let free_way_m = if query.is_limited {
            -max_value_m - reach_m
        } else {
            query.clear_cells * voxel_size_m
        };
        QueryResult {
            max_value_m,
            is_bound: !is_known,
            free_way_m: free_way_m.max(0.0),
            looked_at: query.looked_at,
            left_out: query.left_out,
        }
    }

    /// Largest V of all points of the shell, m, where V of none is above 0, and the block of that
    /// point: branch and bound, what may be highest first. To the bit what the flat traversal finds.
    /// RT: safe.
    pub(super) fn highest_m(
        &self,
        simd_level: SimdLevel,
        shell: &Shell,
        place: &Place,
        lists: &mut Lists,
    ) -> (f32, Option<u32>) {
        let tree = shell.tree();
        let bounds = &self.bounds;
        let margin_cells = self.margin_cells(place);
        let mut highest_m = f32::NEG_INFINITY;
        let mut block = None;
        let open = &mut lists.ceilings;
        open.clear();
        open.push(Ceiling {
            highest_m: f32::INFINITY,
            reached_m: f32::INFINITY,
            level: 0,
            node: 0,
        });
        while let Some(Ceiling { highest_m: ceiling_m, level, node, .. }) = open.pop() {
            if ceiling_m <= highest_m {
                continue;
            }
            if level == tree.n_levels() {
                let floor = |max_m: f32| max_m.max(highest_m);
                let max_m = simd_level.run(Blocks {
                    bounds,
                    place,
                    positions: shell.positions(),
                    // Points without extent: only where their middles are is asked.
                    extents: Extents::NONE,
                    which: core::iter::once(node),
                    floor,
                    found: |_, _: &Depths| (),
                });
                if max_m > highest_m {
                    highest_m = max_m;
                    block = Some(node);
                }
                continue;
            }
            let Some(spheres) = tree.spheres(level).get(node as usize) else { continue };
            let [ceilings_m, reached_m] =
                simd_level.run(Ceilings { bounds, place, spheres, margin_cells });
            let first = open.len();
            let children = (node * CHILDREN as u32..).zip(ceilings_m).zip(reached_m);
            for ((node, ceiling_m), reached_m) in children {
                if ceiling_m > highest_m {
                    let level = level + 1;
                    open.push(Ceiling { highest_m: ceiling_m, reached_m, level, node });
                }
            }
            if let Some(children) = open.get_mut(first..) {
                children.sort_unstable_by(|a, b| a.reached_m.total_cmp(&b.reached_m));
            }
        }
        (highest_m, block)
    }

    /// Replaces the open nodes by their children that are open, which go to `next`, as far as the
    /// budget allows.
    fn refine(&mut self, level: usize, budget: Budget, query: &mut Query<'_>, lists: &mut Lists) {
        lists.next.clear();
        query.spheres = query.shell.tree().spheres(level);
        for _ in 0..ROUNDS {
            let n_open = lists.open.len() as u32;
            let n_refined =
                budget.without(query.looked_at + lists.next.len() as u32).refinable(n_open);
            let choice = self.choose(level.checked_sub(1), &mut lists.open, n_refined);
            for (idx, node) in (0_u32..).zip(&lists.open) {
                if choice.takes(idx) {
                    query.open_children(self, level, *node, &mut lists.next);
                }
            }
            retain(&mut lists.open, choice);
            if lists.open.is_empty() || n_refined == 0 {
                break;
            }
        }
    }

    /// Looks at the points of the open leaves as far as the budget allows: at all of those in which
    /// something touched in the last tick, and at some of each of the others.
    fn look_at_leaves_within(
        &mut self,
        budget: Budget,
        query: &mut Query<'_>,
        lists: &mut Lists,
        touched: &mut Vec<ContactBlock>,
    ) {
        self.sort_by_depth(self.first_blocks.len().checked_sub(1), &mut lists.open);
        let left = budget.without(query.looked_at);
        let n_touched = lists
            .open
            .partition_point(|leaf| self.is_touched(self.first_blocks.len().checked_sub(1), *leaf))
            as u32;
        let n_others = lists.open.len() as u32 - n_touched;
        // One point of each of the others is always looked at.
        let (per_touched, n_twice) = left.without(n_others).points_per_leaf(n_touched);
        let spent = per_touched * (n_touched + n_twice);
        let (per_other, n_others_twice) = left.without(spent).points_per_leaf(n_others);
        let mut leaves = lists.open.as_slice();
        // Of the others different ones in each tick: what touches at one point is found.
        let turn = self.now as usize % LANES;
        for (n, per_leaf, turn) in [
            (n_twice, 2 * per_touched, 0),
            (n_touched - n_twice, per_touched, 0),
            (n_others_twice, 2 * per_other, turn),
            (n_others - n_others_twice, per_other, turn),
        ] {
            let (these, rest) = leaves.split_at(leaves.len().min(n as usize));
            leaves = rest;
            if per_leaf as usize == LANES {
                query.look_at_leaves(self, these, touched);
            } else {
                query.look_at_some(
                    &self.bounds,
                    (per_leaf, turn),
                    these,
                    &mut lists.samples,
                    touched,
                );
            }
        }
    }

    /// Chooses what is refined of the open nodes of a level (without one, of the root): where that
    /// is not all, those that matter most, which are put first, and some of the others.
    fn choose(&mut self, level: Option<usize>, open: &mut [u32], n_refined: u32) -> Choice {
        let n_open = open.len() as u32;
        if n_refined == n_open {
            return Choice::all(n_open);
        }
        self.turn = self.turn.wrapping_add(u64::from(n_refined.max(1)));
        self.sort_by_depth(level, open);
        Choice::new(n_open, n_refined, self.turn)
    }

    /// Those below which something touched in the last tick first, and of either kind those whose
    /// centre lies deepest.
    fn sort_by_depth(&self, level: Option<usize>, open: &mut [u32]) {
        let outside = |node: u32| {
            let siblings = level
                .and_then(|level| self.outside_cells.get(self.at(level, node as usize / CHILDREN)));
            siblings
                .and_then(|siblings| siblings.get(node as usize % CHILDREN))
                .copied()
                .unwrap_or(UNKNOWN)
        };
        open.sort_unstable_by(|a, b| {
            let [first, second] = [a, b].map(|node| !self.is_touched(level, *node));
            first.cmp(&second).then_with(|| outside(*a).total_cmp(&outside(*b))).then(a.cmp(b))
        });
    }

    /// Whether something below a node touched in the last tick.
    fn is_touched(&self, level: Option<usize>, node: u32) -> bool {
        let stamps =
            level.and_then(|level| self.touched_at.get(self.at(level, node as usize / CHILDREN)));
        stamps.and_then(|stamps| stamps.get(node as usize % CHILDREN)) == Some(&self.now)
    }

    /// Remembers that something touched in a leaf, and so below all nodes above it.
    fn mark(&mut self, leaf: u32) {
        let now = self.now;
        let mut node = leaf as usize;
        for level in (0..self.first_blocks.len()).rev() {
            let at = self.at(level, node / CHILDREN);
            let Some(stamp) =
                self.touched_at.get_mut(at).and_then(|stamps| stamps.get_mut(node % CHILDREN))
            else {
                return;
            };
            if *stamp == now {
                return;
            }
            *stamp = now;
            node /= CHILDREN;
        }
    }

    /// Where the block of eight siblings lies in the arrays.
    fn at(&self, level: usize, block: usize) -> usize {
        self.first_blocks.get(level).map_or(usize::MAX, |first| *first as usize + block)
    }
}

/// Keeps what was not selected.
fn retain(open: &mut Vec<u32>, choice: Choice) {
    let mut idx = 0;
    open.retain(|_| {
        idx += 1;
        !choice.takes(idx - 1)
    });
}

const ALL_LANES: [usize; LANES] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15];

/// Lanes that stand for all sixteen. The points of a leaf come in rows, so those lanes are chosen
/// that lie evenly in four rows of four: their mean place is that of all, or the same side of every
/// leaf would be left out. Eight lanes are Thue's and Morse's, of which the squares and cubes have
/// the right mean as well. The exclusive or of all lanes with a number gives other lanes with the
/// same properties.
fn spread_lanes(n: u32) -> &'static [usize] {
    match n {
        8.. => &[0, 3, 5, 6, 9, 10, 12, 15],
        4 => &[1, 7, 8, 14],
        2 => &[5, 10],
        _ => &[6],
    }
}

fn vec_of<T: Copy>(value: T, n: usize) -> Vec<[T; CHILDREN]> {
    core::iter::repeat_n([value; CHILDREN], n).collect()
}

/// One walk through the tree.
struct Query<'a> {
    simd_level: SimdLevel,
    shell: &'a Shell,
    place: &'a Place,
    /// Of the level that is being refined.
    spheres: &'a [Spheres],
    ways: [(f32, f32); 2],
    margin_cells: f32,
    /// What every node that was left out may still move, at least, cells.
    clear_cells: f32,
    /// Largest V of the points that were looked at, m.
    max_m: f32,
    looked_at: u32,
    left_out: u32,
    /// A leaf was left out as its points did not touch in an earlier tick.
    passes_points: bool,
    /// What lies how deep is kept for the choice of what a budget suffices for.
    is_limited: bool,
    per_voxel: f32,
    limit_m: f32,
    slack_m: f32,
}

impl Query<'_> {
    /// Looks at the children of a node, which are a block of the level.
    #[inline]
    fn open_children(
        &mut self,
        walk: &mut TreeTraversal,
        level: usize,
        node: u32,
        open: &mut Vec<u32>,
    ) {
        let at = walk.at(level, node as usize);
        let (Some(clear_until), Some(reaches)) =
            (walk.clear_until_cells.get_mut(at), walk.reaches_cells.get(at))
        else {
            return;
        };
        let is_last = level + 1 == walk.first_blocks.len();
        let [now, soon] =
            self.ways.map(|(along, about)| reaches.map(|reach| along + about * reach));
        let mut n_unclear = 0;
        for ((clear_until, now), soon) in clear_until.iter().zip(now).zip(soon) {
            n_unclear += u32::from(*clear_until <= soon && *clear_until + now >= 0.0);
        }
        self.looked_at += 1;
        if n_unclear > 0 {
            self.looked_at += CHILDREN as u32 - 1;
            let Some(spheres) = self.spheres.get(node as usize) else { return };
            let bounds = &walk.bounds;
            let place = self.place;
            let margin_cells = self.margin_cells;
            let rooms = self.simd_level.run(Clearance { bounds, place, spheres, margin_cells });
            if self.is_limited
                && let Some(outside) = walk.outside_cells.get_mut(at)
            {
                for ((outside, room), radius) in outside.iter_mut().zip(rooms).zip(spheres.radius) {
                    *outside = room + radius * self.per_voxel;
                }
            }
            let mut by_spheres = 0_u8;
            for (lane, (((clear_until, room), now), soon)) in
                clear_until.iter_mut().zip(rooms).zip(now).zip(soon).enumerate()
            {
                if *clear_until <= soon {
                    by_spheres |= 1 << lane;
                    *clear_until = if room > 0.0 {
                        now + room.min(PROOF_CELLS)
                    } else {
                        -(now + (-room).min(OPEN_CELLS))
                    };
                }
            }
            if is_last && let Some(by_points) = walk.by_points.get_mut(node as usize) {
                *by_points &= !by_spheres;
            }
        }
        let by_points = match walk.by_points.get(node as usize) {
            Some(by_points) if is_last => *by_points,
            _ => 0,
        };
        for ((lane, clear_until), now) in (0..).zip(clear_until).zip(now) {
            if *clear_until > now {
                self.clear_cells = self.clear_cells.min(*clear_until - now);
                self.passes_points |= by_points >> lane & 1 == 1;
            } else {
                open.push(node * CHILDREN as u32 + lane);
            }
        }
    }

    /// Looks at all points of some leaves.
    fn look_at_leaves(
        &mut self,
        walk: &mut TreeTraversal,
        leaves: &[u32],
        touched: &mut Vec<ContactBlock>,
    ) {
        let limit_m = self.limit_m;
        let extents = Extents::of(self.shell, limit_m, self.slack_m);
        let TreeTraversal {
            bounds, clear_until_cells, reaches_cells, by_points, first_blocks, ..
        } = walk;
        let first = first_blocks.last().map_or(0, |first| *first as usize);
        let per_voxel = 1.0 / bounds.voxel_size_m();
        let floor_m = (-FLOOR_VOXELS * bounds.voxel_size_m()).min(-bounds.reach_m());
        let (along, about) = self.ways[0];
        let margin_cells = self.margin_cells;
        let jump_cells = bounds.jump_cells();
        let mut n_looked_at = 0;
        let mut clear_cells = self.clear_cells;
        let leaves = leaves.iter().copied();
        let found = |leaf: u32, depths: &Depths| {
            n_looked_at += LANES as u32;
            if depths.touched.lanes != 0 {
                touched.push(depths.touched);
                return;
            }
            let block = first + leaf as usize / CHILDREN;
            let lane = leaf as usize % CHILDREN;
            let highest_m = depths.max_m + extents.whole_reach_m(leaf as usize);
            let room = free_cells(-highest_m * per_voxel - jump_cells) - margin_cells;
            clear_cells = clear_cells.min(room);
            let clear_until =
                clear_until_cells.get_mut(block).and_then(|clear_until| clear_until.get_mut(lane));
            let reach = reaches_cells.get(block).and_then(|reaches| reaches.get(lane));
            if let (Some(clear_until), Some(reach)) = (clear_until, reach)
                && room > 0.0
            {
                *clear_until = along + about * reach + room.min(PROOF_CELLS);
                if let Some(by_points) = by_points.get_mut(leaf as usize / CHILDREN) {
                    *by_points |= 1 << lane;
                }
            }
        };
        let place = self.place;
        let positions = self.shell.positions();
        let floor = |_| floor_m;
        let max_m = self.simd_level.run(Blocks {
            bounds,
            place,
            positions,
            extents,
            which: leaves,
            floor,
            found,
        });
        self.max_m = self.max_m.max(max_m);
        self.clear_cells = clear_cells;
        self.looked_at += n_looked_at;
    }

    /// Looks at so many points of each of these leaves; they stand for all points of the leaf.
    fn look_at_some(
        &mut self,
        bounds: &BrickBounds,
        (per_leaf, turn): (u32, usize),
        leaves: &[u32],
        samples: &mut Samples,
        touched: &mut Vec<ContactBlock>,
    ) {
        for leaf in leaves.iter().map(|leaf| *leaf as usize) {
            let n_points = self.shell.len().saturating_sub(leaf * LANES).min(LANES);
            let Some(Lanes(weights)) = self.shell.weights().get(leaf) else { continue };
            let sum = |lanes: &[usize]| -> f32 {
                lanes.iter().filter_map(|lane| weights.get(*lane)).sum()
            };
            let used = ALL_LANES.get(..n_points).unwrap_or(&[]);
            let mut chosen = [0; LANES];
            let mut n_chosen = 0;
            // A last block may be filled in part.
            for lane in spread_lanes(per_leaf)
                .iter()
                .map(|lane| lane ^ turn)
                .filter(|lane| *lane < n_points)
            {
                if let Some(place) = chosen.get_mut(n_chosen) {
                    (*place, n_chosen) = (lane, n_chosen + 1);
                }
            }
            let lanes = if n_chosen > 0 {
                chosen.get(..n_chosen).unwrap_or(used)
            } else {
                used.get(..1).unwrap_or(used)
            };
            // Probes alone would stand for a surface that they do not have.
            let first_facet = used
                .iter()
                .position(|lane| weights.get(*lane).is_some_and(|weight| *weight > 0.0))
                .filter(|_| sum(lanes) == 0.0);
            let lanes = match first_facet {
                Some(lane) => used.get(lane..=lane).unwrap_or(lanes),
                None => lanes,
            };
            let share = sum(used) / sum(lanes).max(f32::MIN_POSITIVE);
            // A leaf is looked up as a whole: noted twice, it would take the room of another.
            if !samples.has_room_for(lanes.len()) {
                self.max_m = self.max_m.max(samples.look(
                    self.simd_level,
                    (bounds, self.limit_m, self.slack_m),
                    self.place,
                    touched,
                ));
            }
            for lane in lanes {
                samples.push(self.shell, (leaf * LANES + lane) as u32, share);
            }
            self.looked_at += lanes.len() as u32;
            self.left_out += (n_points - lanes.len()) as u32;
        }
        self.max_m = self.max_m.max(samples.look(
            self.simd_level,
            (bounds, self.limit_m, self.slack_m),
            self.place,
            touched,
        ));
    }

    /// Lets the representatives of the open nodes of a level stand for the points below them;
    /// without a level, of nothing for all.
    fn represent(
        &mut self,
        bounds: &BrickBounds,
        level: Option<usize>,
        lists: &mut Lists,
        touched: &mut Vec<ContactBlock>,
    ) {
        let tree = self.shell.tree();
        let Some(level) = level else {
            if !lists.open.is_empty() {
                self.left_out = self.shell.len() as u32;
            }
            return;
        };
        for node in &lists.open {
            let block = *node as usize / CHILDREN;
            let lane = *node as usize % CHILDREN;
            let point = tree.representatives(level).get(block).and_then(|points| points.get(lane));
            let Range { start, end } = tree.points_below(level, *node as usize, self.shell.len());
            let weight = tree
                .weights(level)
                .get(block)
                .and_then(|weights| weights.get(lane))
                .copied()
                .unwrap_or(0.0);
            self.looked_at += 1;
            self.left_out += (end - start).saturating_sub(1) as u32;
            if !lists.samples.has_room_for(1) {
                self.max_m = self.max_m.max(lists.samples.look(
                    self.simd_level,
                    (bounds, self.limit_m, self.slack_m),
                    self.place,
                    touched,
                ));
            }
            if let Some(point) = point {
                // As a multiple of its own surface.
                let block = *point as usize / LANES;
                let lane = *point as usize % LANES;
                let own = self
                    .shell
                    .weights()
                    .get(block)
                    .and_then(|weights| weights.0.get(lane))
                    .copied()
                    .unwrap_or(1.0);
                lists.samples.push(self.shell, *point, weight / own.max(f32::MIN_POSITIVE));
            }
        }
        self.max_m = self.max_m.max(lists.samples.look(
            self.simd_level,
            (bounds, self.limit_m, self.slack_m),
            self.place,
            touched,
        ));
    }
}
