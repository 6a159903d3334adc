//! Contact: which points of the shell are inside which obstacle, and what wrench and stiffness that makes.
//!
//! # Units and frames
//! Sums are formed in tool axes about the centre of mass, where normals and arms are constants of the shell, and turned to world
//! axes once per obstacle. `f32` per point and over a few blocks, `f64` beyond; always added in the order of the blocks: the same
//! bits on every machine.
//!
//! ```text
//!   flat (specification) ─┐
//!   traversal ─┬─ all ────┼─► Touched: blocks of the shell and depths ─► sum
//!              └─ walk ───┘
//! ```
//!
//! # Source
//! Sagardia2008, section 2 (traverse all points, sum penetration × normal); McNeely1999 (wrench about the centre of mass).

mod budget;
mod flat;
mod simd;
mod sum;
mod touched;
mod traversal;
mod walk;

use glam::DVec3;

pub use budget::Budget;
pub use flat::visit;
pub use simd::Machine;
pub use touched::{Contact, Touched};
pub use traversal::{Traversal, Way};

use self::sum::{Sums, Weighting};
use super::params::{ContactParameters, FilterParameters, Normalization};
use crate::pointshell::shell::Shell;
use crate::spatial::{Mat6, Pose, Wrench};
use crate::voxmap::field::{Field, FieldKind};

/// A static object as the tick sees it.
#[derive(Debug)]
pub struct Obstacle {
    /// Its field, map frame.
    pub field: Field,
    /// Where it stands.
    pub world_from_map: Pose,
}

/// The sum over all contacts of all obstacles, world axes, about the tool's centre of mass.
#[derive(Clone, Copy, Debug)]
pub struct ContactSum {
    /// Points with V > 0.
    pub contacts: u32,
    /// Largest V over all points and obstacles, m; −band when everything is far. See [`Self::of`] for what a walk gives.
    pub max_value_m: f64,
    /// Contact wrench on the tool: stiffness times depths, stage S and normalisation applied where they are on.
    pub wrench: Wrench,
    /// Symmetric positive semi-definite contact stiffness −dW/dx, N/m, N, N·m/rad.
    pub stiffness: Mat6,
    /// Depth-weighted mean contact point relative to the centre of mass, m.
    pub arm_world: DVec3,
    /// Smallest voxel edge among the obstacles that are touched, m; of all obstacles when none is.
    pub voxel_size_m: f64,
    /// Largest displacement that a point may make in one tick without passing unnoticed through any
    /// obstacle: the proven clearance, or half a voxel near contact, m.
    pub step_limit_m: f64,
    /// Points and spheres that a walk looked at; 0 of the flat traversal, which looks at all points.
    pub looked_at: u32,
    /// Points that a budget left out: others stood for them.
    pub left_out: u32,
}

impl ContactSum {
    /// Traverses the whole shell against every obstacle.
    ///
    /// `world_from_body`: tool axes at the centre of mass. Contact stiffness is the Gauss-Newton form K Σ w wᵀ with
    /// w = (n, r × n): the depth's gradient is taken as −n, which keeps the matrix positive semi-definite, so the implicit step
    /// can never gain energy from it. The exact Jacobian K n gᵀ differs where the shell's normal and the field's gradient do.
    ///
    /// RT: safe; O(obstacles · points).
    pub fn flat(
        obstacles: &[Obstacle],
        shell: &Shell,
        world_from_body: Pose,
        contact: &ContactParameters,
        filter: &FilterParameters,
    ) -> Self {
        let mut summing = Summing::new(contact, filter, world_from_body);
        for obstacle in obstacles {
            let map_from_body = obstacle.world_from_map.inverse() * world_from_body;
            let by = summing.weighting(obstacle);
            let mut sums = Sums::ZERO;
            let max_value_m = flat::blocks(&obstacle.field, contact.field, shell, map_from_body, |touched| {
                if let Some((positions, normals)) = touched.geometry(&obstacle.field, shell, map_from_body) {
                    Machine::Portable.add(&mut sums, touched, &positions, &normals, by);
                }
            });
            summing.add(obstacle, &sums, max_value_m);
        }
        summing.finish()
    }

    /// The same by a prepared [`Traversal`], which remembers what cannot touch from one call to the next.
    ///
    /// While something touches, and the budget suffices, every bit is that of [`Self::flat`]. While nothing touches, −`max_value_m` of a
    /// walk is the clearance that it has proven, which is less. `obstacles` and `shell` must be those that the traversal was made for.
    ///
    /// RT: safe; allocates nothing.
    pub fn of(
        traversal: &mut Traversal,
        obstacles: &[Obstacle],
        shell: &Shell,
        world_from_body: Pose,
        contact: &ContactParameters,
        filter: &FilterParameters,
    ) -> Self {
        let machine = traversal.machine();
        let mut summing = Summing::new(contact, filter, world_from_body);
        traversal.begin();
        for (obstacle_idx, obstacle) in obstacles.iter().enumerate() {
            let map_from_body = obstacle.world_from_map.inverse() * world_from_body;
            let by = summing.weighting(obstacle);
            let mut sums = Sums::ZERO;
            let found = traversal.find(obstacle_idx, obstacle, contact.field, shell, map_from_body);
            if obstacle.field.is_thin() {
                for touched in traversal.touched() {
                    if let Some((positions, normals)) = touched.geometry(&obstacle.field, shell, map_from_body) {
                        machine.add(&mut sums, touched, &positions, &normals, by);
                    }
                }
            } else {
                machine.add_all(&mut sums, traversal.touched(), (shell.positions(), shell.normals()), by);
            }
            summing.add(obstacle, &sums, found.max_value_m);
            summing.sum.left_out += found.left_out;
            summing.sum.looked_at += found.looked_at;
        }
        summing.finish()
    }
}

/// Contacts from which the averaged sum stops growing (McNeely1999: F_tot below ten contacts, F_tot/(N/10) from ten on).
const AVERAGED_CONTACTS: f64 = 10.0;

/// The sum while obstacles are added.
struct Summing<'a> {
    contact: &'a ContactParameters,
    filter: &'a FilterParameters,
    world_from_body: Pose,
    sum: ContactSum,
    touched_voxel_m: f64,
    depth: f64,
    depth_arm: DVec3,
    effective: f64,
}

impl<'a> Summing<'a> {
    fn new(contact: &'a ContactParameters, filter: &'a FilterParameters, world_from_body: Pose) -> Self {
        let sum = ContactSum {
            contacts: 0,
            max_value_m: f64::NEG_INFINITY,
            wrench: Wrench::ZERO,
            stiffness: Mat6::ZERO,
            arm_world: DVec3::ZERO,
            voxel_size_m: f64::INFINITY,
            step_limit_m: f64::INFINITY,
            looked_at: 0,
            left_out: 0,
        };
        let nothing = (f64::INFINITY, 0.0, DVec3::ZERO, 0.0);
        let (touched_voxel_m, depth, depth_arm, effective) = nothing;
        Self { contact, filter, world_from_body, sum, touched_voxel_m, depth, depth_arm, effective }
    }

    fn weighting(&self, obstacle: &Obstacle) -> Weighting {
        Weighting::new(obstacle.field.voxel_size_m(), self.filter.spatial)
    }

    /// Adds what was found at an obstacle.
    fn add(&mut self, obstacle: &Obstacle, sums: &Sums, max_value_m: f32) {
        let (sum, max_value_m) = (&mut self.sum, f64::from(max_value_m));
        let voxel_size_m = f64::from(obstacle.field.voxel_size_m());
        sum.max_value_m = sum.max_value_m.max(max_value_m);
        sum.voxel_size_m = sum.voxel_size_m.min(voxel_size_m);
        // Interpolation may overstate a clearance by half the diagonal of a cell, the other look-ups by up to two voxels.
        let overstated_voxels = if self.contact.field == FieldKind::Trilinear { 0.5 * 3_f64.sqrt() } else { 2.0 };
        let clearance_m = -max_value_m - overstated_voxels * voxel_size_m;
        sum.step_limit_m = sum.step_limit_m.min(clearance_m.max(0.5 * voxel_size_m));
        if sums.contacts == 0 {
            return;
        }
        let (rotation, stiffness_n_per_m, total) =
            (self.world_from_body.rotation_matrix(), self.contact.stiffness_n_per_m, sums.total());
        sum.contacts += sums.contacts;
        sum.wrench = sum.wrench + Wrench::new(rotation * total.depth_normal, rotation * total.depth_moment) * stiffness_n_per_m;
        sum.stiffness = sum.stiffness.plus_scaled(stiffness_n_per_m, &total.stiffness.rotated(rotation));
        self.touched_voxel_m = self.touched_voxel_m.min(voxel_size_m);
        self.depth += total.depth;
        self.depth_arm += rotation * total.depth_arm;
        self.effective += total.effective;
    }

    fn finish(self) -> ContactSum {
        let Self { contact, mut sum, touched_voxel_m, depth, depth_arm, effective, .. } = self;
        if sum.contacts > 0 {
            sum.voxel_size_m = touched_voxel_m;
            sum.arm_world = depth_arm / depth;
            if contact.normalization == Normalization::Average {
                let scale = 1.0 / (effective / AVERAGED_CONTACTS).max(1.0);
                sum.wrench = sum.wrench * scale;
                sum.stiffness = Mat6::ZERO.plus_scaled(scale, &sum.stiffness);
            }
        }
        sum
    }
}
