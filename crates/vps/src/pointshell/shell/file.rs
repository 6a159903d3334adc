//! A shell to and from a file of the bake cache.

use bytemuck::{Pod, Zeroable};

use super::{LANES, Shell, longest_m};
use crate::pointshell::tree::Tree;
use crate::storage::SharedSlice;
use crate::storage::sections::{Reader, Refusal, Writer};

/// Everything of a shell but its arrays.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub struct ShellHead {
    n_points: u64,
    radius_m: f64,
    voxel_size_m: f64,
    /// 1 when some points have no normal, else 0.
    is_skin: u64,
}

impl Shell {
    /// What [`Self::store`] needs beside the shell itself.
    pub fn head(&self) -> ShellHead {
        ShellHead {
            n_points: self.n_points as u64,
            radius_m: self.radius_m,
            voxel_size_m: self.voxel_size_m,
            is_skin: self.is_skin.into(),
        }
    }

    /// Adds the shell to a file.
    pub fn store<'a>(&'a self, head: &'a ShellHead, to: &mut Writer<'a>) {
        let Self {
            positions,
            normals,
            weights,
            half_axes,
            reaches_m,
            tree,
            n_points: _,
            radius_m: _,
            voxel_size_m: _,
            is_skin: _,
            reach_m: _,
        } = self;
        to.record("shell", head);
        to.array("shell positions", positions);
        to.array("shell normals", normals);
        to.array("shell weights", weights);
        to.array("shell half axes", half_axes);
        to.array("shell reaches", reaches_m);
        tree.store(to);
    }

    /// True when a file holds a shell.
    pub fn is_in(from: &Reader) -> bool {
        from.has("shell")
    }

    /// Takes the shell from a file. The layout is checked; coordinates may be any numbers.
    ///
    /// # Errors
    /// A section that is missing or damaged, or arrays that do not belong together.
    pub fn load(from: &Reader) -> Result<Self, Refusal> {
        let ShellHead { n_points, radius_m, voxel_size_m, is_skin } = from.record("shell")?;
        // Point numbers have 32 bits.
        let n_points = u32::try_from(n_points).map_err(|_| Refusal::Damaged("shell"))? as usize;
        let reaches_m: SharedSlice<f32> = from.array("shell reaches")?;
        let shell = Self {
            positions: from.array("shell positions")?,
            normals: from.array("shell normals")?,
            weights: from.array("shell weights")?,
            half_axes: from.array("shell half axes")?,
            reach_m: longest_m(&reaches_m),
            reaches_m,
            tree: Tree::load(from, n_points)?,
            n_points,
            radius_m,
            voxel_size_m,
            is_skin: is_skin != 0,
        };
        if shell.is_consistent() { Ok(shell) } else { Err(Refusal::Damaged("shell")) }
    }

    fn is_consistent(&self) -> bool {
        let Self {
            positions,
            normals,
            weights,
            half_axes,
            reaches_m,
            tree: _,
            n_points,
            radius_m,
            voxel_size_m,
            is_skin: _,
            reach_m: _,
        } = self;
        let unused = (n_points % LANES..LANES).filter(|_| n_points % LANES > 0);
        positions.len() == n_points.div_ceil(LANES)
            && normals.len() == positions.len()
            && weights.len() == positions.len()
            && weights
                .iter()
                .flat_map(|weights| weights.0)
                .all(|weight| weight >= 0.0 && weight.is_finite())
            && (half_axes.is_empty() || half_axes.len() == positions.len())
            && reaches_m.len() == half_axes.len()
            && reaches_m.iter().all(|reach| *reach >= 0.0 && reach.is_finite())
            && positions
                .last()
                .is_none_or(|last| unused.into_iter().all(|lane| last.get(lane).is_nan()))
            && *radius_m >= 0.0
            && radius_m.is_finite()
            && *voxel_size_m > 0.0
            && voxel_size_m.is_finite()
    }
}
