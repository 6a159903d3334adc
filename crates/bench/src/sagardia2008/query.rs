//! One contact query over all points of a shell: what remark 2 asks of a millisecond.
//!
//! # Source
//! Sagardia2008, remark 2: around 8,000 points were what the computer of 2008 could query in 1 ms.

use glam::DVec3;

use super::super::statistics::median;
use super::{Options, timed};
use vps::contact::{ContactSum, ForceLaw, Obstacle, SimdLevel, Traversal, TraversalMode};
use vps::mesh::TriangleMesh;
use vps::pointshell;
use vps::spatial::Pose;
use vps::voxmap::Volume;

/// Queries of one run.
const N_QUERIES: usize = 400;

/// A query of all points, without the tree.
#[derive(Clone, Copy, Debug)]
pub struct Query {
    /// Points of the shell.
    pub n_points: usize,
    /// Of these, those in contact.
    pub touching: u32,
    /// Time of one query, µs.
    pub median_us: f64,
}

/// The model against itself, moved by half a voxel along the diagonal: about half of its points
/// touch, far more than in any assembly.
pub(super) fn measure(mesh: &TriangleMesh, mut map: Volume, options: Options) -> Query {
    let (shell, _) = pointshell::build(mesh, &map, DVec3::ZERO);
    let aside = DVec3::ONE.normalize() * 0.5 * map.surface.grid.voxel_size_m;
    let obstacles = [Obstacle { field: map.field(mesh, false), world_from_map: Pose::IDENTITY }];
    let mut traversal = Traversal::new(SimdLevel::best(), TraversalMode::Flat, &obstacles, &shell);
    let mut ask =
        |pose| ContactSum::of(&mut traversal, &obstacles, &shell, pose, ForceLaw::PLAIN, None);
    let n_queries = if options.quick { 20 } else { N_QUERIES * options.n_runs };
    let mut times_us = Vec::with_capacity(n_queries);
    let mut touching = 0;
    for n in 0..n_queries {
        // To and fro by a hundredth of it, as in a hand.
        let pose = Pose::from_translation(aside * (1.0 + 0.01 * f64::sin(n as f64)));
        let (sum, seconds) = timed(|| ask(std::hint::black_box(pose)));
        touching = sum.contacts;
        times_us.push(1e6 * seconds);
    }
    Query { n_points: shell.len(), touching, median_us: median(&times_us).unwrap_or_default() }
}
