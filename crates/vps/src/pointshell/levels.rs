//! What the levels of a tree look like, in numbers.

use glam::Vec3;

use super::shell::{LANES, Shell};
use super::tree::CHILDREN;

/// One level of a point-sphere tree.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct LevelReport {
    /// Points that represent the nodes of the level; in the last level, all points of the shell.
    pub points: usize,
    /// Mean radius of the spheres, m; 0 for points.
    pub mean_radius_m: f64,
    /// Largest radius, m.
    pub max_radius_m: f64,
    /// Mean distance from a point of the level to the nearest other under the same parent, m; 0
    /// where there is none.
    pub spacing_m: f64,
}

/// Families of siblings that a spacing is averaged over, at most: evenly spread, always the same
/// ones.
const FAMILIES: usize = 4096;

/// The levels of a shell's tree from coarse to fine; the last one is the shell itself. Cost:
/// O(nodes).
pub(super) fn levels(shell: &Shell) -> Vec<LevelReport> {
    if shell.is_empty() {
        return Vec::new();
    }
    let tree = shell.tree();
    let point = |idx: u32| shell.positions()[idx as usize / LANES].get(idx as usize % LANES);
    let mut levels: Vec<LevelReport> = (0..tree.n_levels())
        .map(|level| {
            let n_nodes = tree.n_nodes(level);
            let radii = || {
                tree.spheres(level)
                    .iter()
                    .flat_map(|spheres| spheres.radius)
                    .take(n_nodes)
                    .map(f64::from)
            };
            let families =
                tree.representatives(level).iter().enumerate().map(|(block, representatives)| {
                    let siblings = (n_nodes - block * CHILDREN).min(CHILDREN);
                    representatives[..siblings].iter().map(|idx| point(*idx)).collect()
                });
            LevelReport {
                points: n_nodes,
                mean_radius_m: radii().sum::<f64>() / n_nodes as f64,
                max_radius_m: radii().fold(0.0, f64::max),
                spacing_m: spacing(families, tree.representatives(level).len()),
            }
        })
        .collect();
    let blocks = shell
        .positions()
        .iter()
        .map(|block| (0..LANES).map(|lane| block.get(lane)).filter(|p| !p.is_nan()).collect());
    let spacing_m = spacing(blocks, shell.positions().len());
    levels.push(LevelReport {
        points: shell.len(),
        mean_radius_m: 0.0,
        max_radius_m: 0.0,
        spacing_m,
    });
    levels
}

/// Mean over the members of some families of the distance to the nearest sibling.
fn spacing(families: impl Iterator<Item = Vec<Vec3>>, n_families: usize) -> f64 {
    let mut sum = 0.0;
    let mut count = 0_u32;
    for family in families.step_by(n_families.div_ceil(FAMILIES).max(1)) {
        for (idx, point) in family.iter().enumerate() {
            let others = family.iter().enumerate().filter(|(other, _)| *other != idx);
            let nearest = others.map(|(_, other)| point.distance(*other)).min_by(f32::total_cmp);
            if let Some(distance) = nearest {
                sum += f64::from(distance);
                count += 1;
            }
        }
    }
    if count == 0 { 0.0 } else { sum / f64::from(count) }
}
