//! Contact: which points of the shell are inside which obstacle, and what wrench and stiffness that makes.
//!
//! # Units and frames
//! Sums are formed in tool axes about the centre of mass, where normals and arms are constants of the shell, and turned to world
//! axes once per obstacle. `f32` per point, `f64` sums, added in the order of the points: the same bits on every machine.
//!
//! # Source
//! Sagardia2008, section 2 (traverse all points, sum penetration × normal); McNeely1999 (wrench about the centre of mass).

mod flat;
pub mod planes;

use glam::DVec3;

pub use flat::{Contact, visit};

use super::filter::entry_weight;
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

impl Obstacle {
    /// Unit direction in world axes in which a contact leaves this obstacle fastest, −grad V; the contact's own normal where the gradient
    /// vanishes. `world_from_body` is the pose at which the contact was found. RT: safe, O(1).
    pub fn way_out_world(&self, world_from_body: Pose, contact: &Contact) -> DVec3 {
        let point_map = self.world_from_map.inverse().transform_point(world_from_body.transform_point(contact.arm_body.as_dvec3()));
        let cells = (point_map - self.field.origin_map().as_dvec3()) / f64::from(self.field.voxel_size_m());
        match (-self.field.gradient(cells.as_vec3())).as_dvec3().try_normalize() {
            Some(normal_map) => self.world_from_map.transform_vector(normal_map),
            None => world_from_body.transform_vector(contact.normal_body.as_dvec3()),
        }
    }
}

/// The sum over all contacts of all obstacles, world axes, about the tool's centre of mass.
#[derive(Clone, Copy, Debug)]
pub struct ContactSum {
    /// Points with V > 0.
    pub contacts: u32,
    /// Largest V over all points and obstacles, m; −band when everything is far.
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
}

/// What one obstacle adds, tool axes, metres instead of newtons (stiffness is multiplied in later).
#[derive(Clone, Copy, Debug)]
struct Partial {
    depth_normal: DVec3,
    depth_moment: DVec3,
    stiffness: Mat6,
    depth: f64,
    depth_arm: DVec3,
    effective: f64,
    contacts: u32,
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
        Self::flat_with(obstacles, shell, world_from_body, contact, filter, |_, _| ())
    }

    /// The same, and `also` gets every contact record (tool axes, about the centre of mass) with the number of its obstacle.
    pub fn flat_with(
        obstacles: &[Obstacle],
        shell: &Shell,
        world_from_body: Pose,
        contact: &ContactParameters,
        filter: &FilterParameters,
        mut also: impl FnMut(usize, &Contact),
    ) -> Self {
        let stiffness_n_per_m = contact.stiffness_n_per_m;
        let mut sum = Self {
            contacts: 0,
            max_value_m: f64::NEG_INFINITY,
            wrench: Wrench::ZERO,
            stiffness: Mat6::ZERO,
            arm_world: DVec3::ZERO,
            voxel_size_m: f64::INFINITY,
            step_limit_m: f64::INFINITY,
        };
        let (mut touched_voxel_m, mut depth, mut depth_arm, mut effective) = (f64::INFINITY, 0.0, DVec3::ZERO, 0.0);
        for (obstacle_idx, obstacle) in obstacles.iter().enumerate() {
            let voxel_size_m = f64::from(obstacle.field.voxel_size_m());
            let map_from_body = obstacle.world_from_map.inverse() * world_from_body;
            let mut partial = Partial::NONE;
            let max_value_m = f64::from(visit(&obstacle.field, contact.field, shell, map_from_body, |touching| {
                partial.add(touching, voxel_size_m, filter.spatial);
                also(obstacle_idx, touching);
            }));
            sum.max_value_m = sum.max_value_m.max(max_value_m);
            sum.voxel_size_m = sum.voxel_size_m.min(voxel_size_m);
            // Interpolation may overstate a clearance by half the diagonal of a cell, the other look-ups by up to two voxels.
            let overstated_voxels = if contact.field == FieldKind::Trilinear { 0.5 * 3_f64.sqrt() } else { 2.0 };
            let clearance_m = -max_value_m - overstated_voxels * voxel_size_m;
            sum.step_limit_m = sum.step_limit_m.min(clearance_m.max(0.5 * voxel_size_m));
            if partial.contacts == 0 {
                continue;
            }
            let rotation = world_from_body.rotation_matrix();
            sum.contacts += partial.contacts;
            sum.wrench =
                sum.wrench + Wrench::new(rotation * partial.depth_normal, rotation * partial.depth_moment) * stiffness_n_per_m;
            sum.stiffness = sum.stiffness.plus_scaled(stiffness_n_per_m, &partial.stiffness.rotated(rotation));
            touched_voxel_m = touched_voxel_m.min(voxel_size_m);
            depth += partial.depth;
            depth_arm += rotation * partial.depth_arm;
            effective += partial.effective;
        }
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

/// Contacts from which the averaged sum stops growing (McNeely1999: F_tot below ten contacts, F_tot/(N/10) from ten on).
const AVERAGED_CONTACTS: f64 = 10.0;

impl Partial {
    const NONE: Self = Self {
        depth_normal: DVec3::ZERO,
        depth_moment: DVec3::ZERO,
        stiffness: Mat6::ZERO,
        depth: 0.0,
        depth_arm: DVec3::ZERO,
        effective: 0.0,
        contacts: 0,
    };

    #[inline]
    fn add(&mut self, contact: &Contact, voxel_size_m: f64, spatial: bool) {
        let depth = f64::from(contact.depth_m);
        let (weight, weight_slope) = if spatial { entry_weight(depth, voxel_size_m) } else { (1.0, 0.0) };
        let normal = contact.normal_body.as_dvec3();
        let arm = contact.arm_body.as_dvec3();
        let moment = arm.cross(normal);
        self.depth_normal += normal * (depth * weight);
        self.depth_moment += moment * (depth * weight);
        // d(d·w)/dd = w + d·w'
        self.stiffness.add_outer(weight + depth * weight_slope, normal, moment);
        self.depth += depth;
        self.depth_arm += arm * depth;
        // Our smooth count: a contact counts fully from a quarter voxel on, so that normalisation has no steps.
        self.effective += (4.0 * depth / voxel_size_m).min(1.0);
        self.contacts += 1;
    }
}
