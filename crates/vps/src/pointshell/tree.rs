//! The point-sphere tree: spheres around runs of points, for a walk that leaves out what cannot
//! touch.
//!
//! ```text
//!   level 0       ●                       one node
//!   level 1       ●●●●●●●●                8 nodes: children of node i are nodes 8i … 8i + 7 of the next level
//!   …             ●●●●●●●● ●●●●●●●● …
//!   last level    ●●●●●●●● ●●●●●●●● …     one node per block of 16 points of the shell
//!   points        ▪▪▪▪▪▪▪▪▪▪▪▪▪▪▪▪ …
//! ```
//! - **Complete**: every node but the last of its level is full, so children and points follow from
//!   the node's number and nothing is linked. The shell is ordered for it (each node a compact
//!   cluster).
//! - **A leaf is a block of the shell**: where a walk arrives, sixteen points are evaluated at
//!   once.
//! - **Eight spheres in a block, by coordinate** ([`Spheres`]): the children of a node are
//!   transformed and compared together, in two cache lines; a walk that takes a level breadth-first
//!   reads blocks in rising order.
//! - **Nested samples**: each node has a representative, a point of the shell that also represents
//!   one of its children, down to the leaf. The representatives of a level are a roughly uniform
//!   subset of the next level's, so a walk that must stop early has sampled the whole shell evenly.
//!   They lie apart from the spheres because pruning does not read them.
//! - **Free centres**: the sphere holds *all points below*, not the spheres below, and is centred
//!   where it is smallest, which is not on the surface. On a bent surface a sphere about a point of
//!   the shell would be up to twice as large.
//!
//! A node may be left out when the clearance at the sphere's centre exceeds its radius.
//!
//! # Measured
//! On a sphere, a torus, a plate, a bolt, a bunny and a rocker arm of 17 k to 77 k points: leaves
//! have a mean radius of 2.1 to 2.6 voxels, and at most 1 % of them are wider than 6 (they straddle
//! a gap). Of the representatives of a level, all but one in twenty have their nearest neighbour at
//! 0.5 to 2 of its mean distance.
//!
//! # Units and frames
//! Those of the shell: tool axes about the centre of mass, m.
//!
//! # Source
//! BarbicJames2008 (nested levels, a sphere around all descendants); Sagardia2019 (bottom-up
//! clusters with a parent point and minimal spheres, walked breadth-first). The complete 8-ary form
//! over blocks and the representatives are ours.

mod file;

use core::ops::Range;

use bytemuck::{Pod, Zeroable};
use glam::DVec3;

use super::lanes::{LANES, Lanes, Lanes3};
use super::sphere::{Ball, enclose};
use crate::parallel;
use crate::storage::SharedSlice;

/// Children of a node.
pub const CHILDREN: usize = 8;

/// The spheres of the children of one node. No padding.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C, align(64))]
pub struct Spheres {
    /// Centre x, m. Where there are fewer than eight children the rest repeats the last one's
    /// centre …
    pub x: [f32; CHILDREN],
    /// Centre y, m.
    pub y: [f32; CHILDREN],
    /// Centre z, m.
    pub z: [f32; CHILDREN],
    /// Radius, m, rounded up. … with a radius of −∞, which any clearance exceeds.
    pub radius: [f32; CHILDREN],
}

/// Where a level lies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Level {
    first_block: u32,
    n_nodes: u32,
}

impl Level {
    fn n_blocks(self) -> usize {
        (self.n_nodes as usize).div_ceil(CHILDREN)
    }
}

/// The levels of the complete tree over so many points, from coarse to fine.
fn levels_over(n_points: usize) -> Vec<Level> {
    // From the leaves up, the root last.
    let mut counts: Vec<usize> = Vec::new();
    let mut n_nodes = n_points.div_ceil(LANES);
    while n_nodes > 0 {
        counts.push(n_nodes);
        n_nodes = if n_nodes > 1 { n_nodes.div_ceil(CHILDREN) } else { 0 };
    }
    let mut first_block = 0;
    let levels = counts.into_iter().rev().map(|n_nodes| {
        let level = Level { first_block, n_nodes: n_nodes as u32 };
        first_block += level.n_blocks() as u32;
        level
    });
    levels.collect()
}

/// Spheres around runs of points of a shell. See the module page.
#[derive(Clone, Debug, Default)]
pub struct Tree {
    /// `[n_levels]`, from coarse to fine; empty without points.
    levels: Vec<Level>,
    /// `[n_blocks]`: the blocks of each level in turn.
    spheres: SharedSlice<Spheres>,
    /// `[n_blocks]`: number of the point that represents each node; the rest of a block repeats the
    /// last one.
    representatives: SharedSlice<[u32; CHILDREN]>,
    /// `[n_blocks]`: surface that the points below each node stand for, s²; 0 in the rest of a
    /// block.
    weights: SharedSlice<[f32; CHILDREN]>,
}

impl Tree {
    /// Builds the tree over points in blocks, in the order that they have. Cold.
    ///
    /// Runs on the current rayon pool. Cost: linear in the number of points, with a small factor
    /// per level.
    pub(super) fn over(positions: &[Lanes3], weights: &[Lanes], n_points: usize) -> Self {
        let builder = Builder::build(positions, weights, n_points);
        let n_blocks: usize =
            builder.levels.iter().map(|nodes| nodes.len().div_ceil(CHILDREN)).sum();
        let mut spheres = Vec::with_capacity(n_blocks);
        let mut representatives = Vec::with_capacity(n_blocks);
        let mut node_weights = Vec::with_capacity(n_blocks);
        for nodes in builder.levels.iter().rev() {
            for siblings in nodes.chunks(CHILDREN) {
                let node = |lane: usize| &siblings[lane.min(siblings.len() - 1)];
                let centers: [[f32; 3]; CHILDREN] =
                    core::array::from_fn(|lane| node(lane).ball.center.as_vec3().to_array());
                spheres.push(Spheres {
                    x: centers.map(|center| center[0]),
                    y: centers.map(|center| center[1]),
                    z: centers.map(|center| center[2]),
                    radius: core::array::from_fn(|lane| {
                        siblings.get(lane).map_or(f32::NEG_INFINITY, |node| node.ball.radius)
                    }),
                });
                representatives.push(core::array::from_fn(|lane| node(lane).representative));
                node_weights.push(core::array::from_fn(|lane| {
                    siblings.get(lane).map_or(0.0, |node| node.weight as f32)
                }));
            }
        }
        Self {
            levels: levels_over(n_points),
            spheres: spheres.into(),
            representatives: representatives.into(),
            weights: node_weights.into(),
        }
    }

    /// Levels of nodes, 0 the coarsest; none without points.
    #[inline]
    pub fn n_levels(&self) -> usize {
        self.levels.len()
    }

    /// Nodes of a level; 0 beyond the last.
    #[inline]
    pub fn n_nodes(&self, level: usize) -> usize {
        self.levels.get(level).map_or(0, |level| level.n_nodes as usize)
    }

    /// Spheres of a level: block b holds nodes 8b … 8b + 7, the children of node b of the level
    /// before. RT: safe.
    #[inline]
    pub fn spheres(&self, level: usize) -> &[Spheres] {
        self.spheres.get(self.blocks(level)).unwrap_or(&[])
    }

    /// Numbers of the points that represent the nodes of a level, laid out like [`Self::spheres`].
    /// RT: safe.
    #[inline]
    pub fn representatives(&self, level: usize) -> &[[u32; CHILDREN]] {
        self.representatives.get(self.blocks(level)).unwrap_or(&[])
    }

    /// Surface that the points below the nodes of a level stand for, s², laid out like
    /// [`Self::spheres`]. RT: safe.
    #[inline]
    pub fn weights(&self, level: usize) -> &[[f32; CHILDREN]] {
        self.weights.get(self.blocks(level)).unwrap_or(&[])
    }

    /// Points of the shell below a node of a level, the last of them cut off at `n_points`. RT:
    /// safe.
    #[inline]
    pub fn points_below(&self, level: usize, node: usize, n_points: usize) -> Range<usize> {
        let generations = self.n_levels().saturating_sub(level + 1);
        let span = LANES * CHILDREN.pow(generations as u32);
        (node * span).min(n_points)..((node + 1) * span).min(n_points)
    }

    fn blocks(&self, level: usize) -> Range<usize> {
        let Some(level) = self.levels.get(level) else { return 0..0 };
        let first = level.first_block as usize;
        first..first + level.n_blocks()
    }

    /// Size of the arrays, bytes.
    pub fn heap_bytes(&self) -> usize {
        let Self { levels, spheres, representatives, weights } = self;
        size_of_val(&**levels)
            + size_of_val(&**spheres)
            + size_of_val(&**representatives)
            + size_of_val(&**weights)
    }
}

/// A node while the tree grows from its leaves.
struct Node {
    ball: Ball,
    /// Number of the point that stands for it.
    representative: u32,
    /// Surface that the points below stand for, s².
    weight: f64,
    low: DVec3,
    high: DVec3,
}

/// Levels from fine to coarse.
struct Builder<'a> {
    positions: &'a [Lanes3],
    weights: &'a [Lanes],
    levels: Vec<Vec<Node>>,
}

impl<'a> Builder<'a> {
    fn build(positions: &'a [Lanes3], weights: &'a [Lanes], n_points: usize) -> Self {
        let mut builder = Self { positions, weights, levels: Vec::new() };
        let n_leaves = n_points.div_ceil(LANES);
        if n_leaves > 0 {
            builder.levels.push(parallel::map(n_leaves, 256, |block| builder.leaf(block)));
        }
        while let Some(children) = builder.levels.last().filter(|children| children.len() > 1) {
            let n_parents = children.len().div_ceil(CHILDREN);
            let parents = parallel::map(n_parents, 16, |node| builder.parent(node));
            builder.levels.push(parents);
        }
        builder
    }

    fn leaf(&self, block: usize) -> Node {
        let points = &self.positions[block];
        let mut low = DVec3::INFINITY;
        let mut high = DVec3::NEG_INFINITY;
        for point in lanes(points).filter(|point| !point.is_nan()) {
            (low, high) = (low.min(point), high.max(point));
        }
        let ball = enclose(0.5 * (low + high), |from| {
            let mut best = (f64::NEG_INFINITY, from);
            farthest_of(points, from, &mut best);
            best
        });
        // A probe has no surface of which it could stand for a multiple.
        let weights = &self.weights[block].0;
        let has_surface = weights.iter().any(|weight| *weight > 0.0);
        let mut nearest = (f64::INFINITY, 0);
        for ((point, weight), lane) in lanes(points).zip(weights).zip(0..) {
            let distance_squared = (point - ball.center).length_squared();
            if distance_squared < nearest.0 && (*weight > 0.0 || !has_surface) {
                nearest = (distance_squared, lane);
            }
        }
        let is_used = |(point, _): &(DVec3, f32)| !point.is_nan();
        let weight = lanes(points)
            .zip(self.weights[block].0)
            .filter(is_used)
            .map(|(_, weight)| f64::from(weight))
            .sum();
        Node { ball, representative: (block * LANES) as u32 + nearest.1, weight, low, high }
    }

    /// A node over the last level that is finished.
    fn parent(&self, node: usize) -> Node {
        let level = self.levels.len();
        let children = self.children(level, node);
        let (low, high) =
            children.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), child| {
                (low.min(child.low), high.max(child.high))
            });
        let ball = enclose(0.5 * (low + high), |from| {
            let mut best = (f64::NEG_INFINITY, from);
            self.farthest(level, node, from, &mut best);
            best
        });
        let has_surface = children.iter().any(|child| child.weight > 0.0);
        let mut nearest = (f64::INFINITY, 0);
        for child in children {
            let distance_squared =
                (self.point(child.representative) - ball.center).length_squared();
            if distance_squared < nearest.0 && (child.weight > 0.0 || !has_surface) {
                nearest = (distance_squared, child.representative);
            }
        }
        Node {
            ball,
            representative: nearest.1,
            weight: children.iter().map(|child| child.weight).sum(),
            low,
            high,
        }
    }

    fn point(&self, point_idx: u32) -> DVec3 {
        self.positions[point_idx as usize / LANES].get(point_idx as usize % LANES).as_dvec3()
    }

    fn children(&self, level: usize, node: usize) -> &[Node] {
        let children = &self.levels[level - 1];
        &children[node * CHILDREN..((node + 1) * CHILDREN).min(children.len())]
    }

    /// The point below a node that is farthest from a place; leaves out children whose sphere lies
    /// nearer than the best so far.
    fn farthest(&self, level: usize, node: usize, from: DVec3, best: &mut (f64, DVec3)) {
        if level == 0 {
            farthest_of(&self.positions[node], from, best);
            return;
        }
        let children = self.children(level, node);
        let mut bounds = [(f64::NEG_INFINITY, 0); CHILDREN];
        for (lane, (bound, child)) in bounds.iter_mut().zip(children).enumerate() {
            // A little more than rounding can take.
            let reach = ((child.ball.center - from).length() + f64::from(child.ball.radius))
                * (1.0 + 1e-12);
            *bound = (reach * reach, lane);
        }
        bounds.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        for (bound, lane) in &bounds[..children.len()] {
            if *bound <= best.0 {
                return;
            }
            self.farthest(level - 1, node * CHILDREN + lane, from, best);
        }
    }
}

fn lanes(block: &Lanes3) -> impl Iterator<Item = DVec3> + '_ {
    (0..LANES).map(|lane| block.get(lane).as_dvec3())
}

/// NaN is not farther than anything.
fn farthest_of(block: &Lanes3, from: DVec3, best: &mut (f64, DVec3)) {
    let Lanes3 { x, y, z } = block;
    let distances: [f64; LANES] = core::array::from_fn(|lane| {
        let [dx, dy, dz] = [
            f64::from(x.0[lane]) - from.x,
            f64::from(y.0[lane]) - from.y,
            f64::from(z.0[lane]) - from.z,
        ];
        dx * dx + dy * dy + dz * dz
    });
    // Halving vectorises; most blocks hold nothing farther. Unused lanes come last, and a first
    // argument that is NaN loses.
    let greater = |a: f64, b: f64| if a > b { a } else { b };
    let eight: [f64; 8] =
        core::array::from_fn(|lane| greater(distances[lane + 8], distances[lane]));
    let four: [f64; 4] = core::array::from_fn(|lane| greater(eight[lane + 4], eight[lane]));
    let most = greater(greater(four[3], four[1]), greater(four[2], four[0]));
    if most > best.0 {
        let lane = distances.iter().position(|distance| *distance == most).unwrap_or(0);
        *best = (most, block.get(lane).as_dvec3());
    }
}
