//! A tree to and from a file of the bake cache.

use super::{CHILDREN, Spheres, Tree};
use crate::storage::sections::{Reader, Refusal, Writer};

impl Tree {
    /// Adds the tree to a file. Its levels follow from the number of points.
    pub(in crate::pointshell) fn store<'a>(&'a self, to: &mut Writer<'a>) {
        let Self { levels: _, spheres, representatives, weights } = self;
        to.array("tree spheres", spheres);
        to.array("tree points", representatives);
        to.array("tree weights", weights);
    }

    /// Takes the tree over `n_points` points from a file. Shape, spheres and point numbers are
    /// checked; that the spheres are where the points are is not.
    ///
    /// # Errors
    /// A section that is missing or damaged, or arrays that do not belong to so many points.
    pub(in crate::pointshell) fn load(from: &Reader, n_points: usize) -> Result<Self, Refusal> {
        let tree = Self {
            levels: super::levels_over(n_points),
            spheres: from.array("tree spheres")?,
            representatives: from.array("tree points")?,
            weights: from.array("tree weights")?,
        };
        if tree.is_consistent(n_points) { Ok(tree) } else { Err(Refusal::Damaged("tree")) }
    }

    fn is_consistent(&self, n_points: usize) -> bool {
        let n_blocks =
            self.levels.last().map_or(0, |last| last.first_block as usize + last.n_blocks());
        self.spheres.len() == n_blocks
            && self.representatives.len() == n_blocks
            && self.weights.len() == n_blocks
            && self.weights.iter().flatten().all(|weight| *weight >= 0.0 && weight.is_finite())
            && self.representatives.iter().flatten().all(|point| (*point as usize) < n_points)
            && (0..self.n_levels()).all(|level| {
                let n_nodes = self.n_nodes(level);
                self.spheres(level)
                    .iter()
                    .zip((0..n_nodes).step_by(CHILDREN))
                    .all(|(block, first)| block.are_sound(n_nodes - first))
            })
    }
}

impl Spheres {
    /// True when every number is finite, and nothing is in the lanes from `n_nodes` on.
    fn are_sound(&self, n_nodes: usize) -> bool {
        let Self { x, y, z, radius } = self;
        let (used, unused) = radius.split_at(n_nodes.min(CHILDREN));
        [x, y, z].into_iter().flatten().all(|coordinate| coordinate.is_finite())
            && used.iter().all(|radius| *radius >= 0.0 && radius.is_finite())
            && unused.iter().all(|radius| *radius == f32::NEG_INFINITY)
    }
}
