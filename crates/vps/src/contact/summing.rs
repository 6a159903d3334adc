//! The sum over obstacles while it grows: faces, what was found of each obstacle, normalisation.

use glam::DVec3;

use super::faces::FACES;
use super::obstacle_poses::{self, FarSum};
use super::sum::{Sums, Total, Weighting};
use super::tree_traversal::QueryResult;
use super::{ContactSum, ForceLaw, Normalization, Obstacle, ObstacleMotion, Patch};

use crate::pointshell::shell::Shell;
use crate::spatial::{Mat6, Pose, Wrench};
use crate::voxmap::field::{FieldKind, MOST_MOVED_CELLS};

/// Contacts from which an averaged sum stops growing (McNeely1999: F_tot below ten contacts,
/// F_tot/(N/10) from ten on).
pub const AVERAGED_CONTACTS: f64 = 10.0;

/// Memory for sums by face: large, so that they are not made on the stack anew in each tick.
#[derive(Clone, Debug)]
pub struct FaceSums(Box<[Sums; FACES]>);

impl FaceSums {
    /// Allocates; RT: start-up only.
    pub fn new() -> Self {
        let sums: Box<[Sums]> = core::iter::repeat_n(Sums::ZERO, FACES).collect();
        match sums.try_into() {
            Ok(sums) => Self(sums),
            Err(_) => unreachable!("as many as there are faces"),
        }
    }
}

impl Default for FaceSums {
    fn default() -> Self {
        Self::new()
    }
}

/// The sums while obstacles are added.
pub(super) struct Summing<'a> {
    law: ForceLaw,
    world_from_body: Pose,
    /// Tool axes; of all obstacles together. Of a face that has not touched yet, what an earlier
    /// tick left.
    faces: &'a mut FaceSums,
    /// One bit for each face that touches.
    touching: u32,
    contacts: u32,
    max_value_m: f64,
    depth_is_bound: bool,
    clearance_is_bound: bool,
    voxel_size_m: f64,
    touched_voxel_m: f64,
    step_limit_m: f64,
    free_way_m: f64,
    looked_at: u32,
    left_out: u32,
    /// Σ depth · motion of what is touched by each face.
    obstacle_motion: Option<[ObstacleMotion; FACES]>,
}

impl<'a> Summing<'a> {
    pub(super) fn new(law: ForceLaw, world_from_body: Pose, faces: &'a mut FaceSums) -> Self {
        Self {
            law,
            world_from_body,
            faces,
            touching: 0,
            contacts: 0,
            max_value_m: f64::NEG_INFINITY,
            depth_is_bound: false,
            clearance_is_bound: false,
            voxel_size_m: f64::INFINITY,
            touched_voxel_m: f64::INFINITY,
            step_limit_m: f64::INFINITY,
            free_way_m: f64::INFINITY,
            looked_at: 0,
            left_out: 0,
            obstacle_motion: None,
        }
    }

    /// Notes that what a face touches has moved; `depth_m`: all depths of these contacts, each with
    /// the weight that it has in the sums.
    pub(super) fn carry(&mut self, face: u8, carried: ObstacleMotion, depth_m: f64) {
        let faces = self.obstacle_motion.get_or_insert_with(|| [ObstacleMotion::default(); FACES]);
        if let Some(sum) = faces.get_mut(usize::from(face)) {
            sum.add(depth_m, carried);
        }
    }

    pub(super) fn weighting(&self, obstacle: &Obstacle, shell: &Shell) -> Weighting {
        let field = &obstacle.field;
        Weighting::new(field.voxel_size_m(), field.is_thin(), shell.is_skin())
    }

    /// The sums of a face that touches.
    #[inline]
    pub(super) fn face(&mut self, face: u8) -> Option<&mut Sums> {
        let sums = self.faces.0.get_mut(usize::from(face))?;
        if self.touching >> face & 1 == 0 {
            self.touching |= 1 << face;
            *sums = Sums::ZERO;
        }
        Some(sums)
    }

    /// By how much a clearance may be overstated: interpolation by half the diagonal of a cell and
    /// by what samples are moved, the other look-ups by up to two voxels.
    pub(super) fn overstated_voxels(&self) -> f64 {
        let moved = f64::from(MOST_MOVED_CELLS);
        if self.law.field == FieldKind::Trilinear { 0.5 * 3_f64.sqrt() + moved } else { 2.0 }
    }

    /// Notes the obstacles that need not be asked.
    pub(super) fn note_far(&mut self, far: FarSum) {
        self.max_value_m = self.max_value_m.max(far.max_value_m);
        self.voxel_size_m = self.voxel_size_m.min(far.voxel_size_m);
        self.step_limit_m = self.step_limit_m.min(far.step_limit_m);
        self.free_way_m = self.free_way_m.min(far.free_way_m);
    }

    /// Notes what else was found at an obstacle.
    pub(super) fn note(
        &mut self,
        obstacle: &Obstacle,
        n_contacts: u32,
        found: &QueryResult,
        reserve_m: f64,
    ) {
        self.depth_is_bound |= found.max_value_m >= obstacle.field.deepest_m();
        self.clearance_is_bound |= found.is_bound;
        self.left_out += found.left_out;
        self.looked_at += found.looked_at;
        let max_value_m = f64::from(found.max_value_m);
        let voxel_size_m = f64::from(obstacle.field.voxel_size_m());
        let limit_m = obstacle_poses::step_limit_m(
            max_value_m,
            voxel_size_m,
            self.overstated_voxels(),
            reserve_m,
        );
        let free_way_m = f64::from(found.free_way_m);
        self.note_found(voxel_size_m, n_contacts, (max_value_m, free_way_m), limit_m);
    }

    /// Notes what was found of something whose voxels are so large, and how far a point of the tool
    /// may go.
    pub(super) fn note_found(
        &mut self,
        voxel_size_m: f64,
        n_contacts: u32,
        (max_value_m, free_way_m): (f64, f64),
        limit_m: f64,
    ) {
        self.contacts += n_contacts;
        self.max_value_m = self.max_value_m.max(max_value_m);
        self.free_way_m = self.free_way_m.min(free_way_m);
        self.voxel_size_m = self.voxel_size_m.min(voxel_size_m);
        self.step_limit_m = self.step_limit_m.min(limit_m);
        if n_contacts > 0 {
            self.touched_voxel_m = self.touched_voxel_m.min(voxel_size_m);
        }
    }

    pub(super) fn finish(&self) -> ContactSum {
        let rotation = self.world_from_body.rotation_matrix();
        // Turned zeros may get a sign; free space is exactly zero.
        let rotation = if self.contacts > 0 { rotation } else { glam::DMat3::IDENTITY };
        let mut totals = [None; FACES];
        let mut effective = 0.0;
        // A facet that is immersed in part may have its centroid outside.
        let mut deepest_m = self.max_value_m;
        for ((face, total), sums) in totals.iter_mut().enumerate().zip(self.faces.0.iter()) {
            if self.touching >> face & 1 == 1 {
                let total = total.insert(sums.total());
                effective += total.effective;
                deepest_m = deepest_m.max(total.deepest);
            }
        }
        let mut sum = ContactSum {
            contacts: self.contacts,
            max_value_m: deepest_m,
            depth_is_bound: self.depth_is_bound,
            wrench: Wrench::ZERO,
            stiffness: Mat6::ZERO,
            arm_world: DVec3::ZERO,
            voxel_size_m: if self.contacts > 0 { self.touched_voxel_m } else { self.voxel_size_m },
            step_limit_m: self.step_limit_m,
            looked_at: self.looked_at,
            left_out: self.left_out,
            obstacle_motion: ObstacleMotion::default(),
            free_way_m: if self.contacts > 0 { 0.0 } else { self.free_way_m },
            clearance_is_bound: self.contacts == 0 && self.clearance_is_bound,
            is_roped: false,
            patches: [None; FACES],
            carried_faces: self.obstacle_motion,
        };
        let stiffness_n_per_m = self.law.stiffness_n_per_m
            * match self.law.normalization {
                Normalization::None => 1.0,
                Normalization::Average => within_ten(effective),
            };
        let mut depth = 0.0;
        let mut depth_arm = DVec3::ZERO;
        let mut force = DVec3::ZERO;
        let mut moment = DVec3::ZERO;
        let mut stiffness = Mat6::ZERO;
        for ((face, total), patch) in totals.iter().enumerate().zip(&mut sum.patches) {
            let Some(total) = total else { continue };
            force += total.depth_normal;
            moment += total.depth_moment;
            stiffness = stiffness.plus_scaled(1.0, &total.stiffness);
            depth += total.depth;
            depth_arm += total.depth_arm;
            *patch = Patch::of(face as u8, total, stiffness_n_per_m, rotation);
        }
        sum.wrench = Wrench::new(rotation * force, rotation * moment) * stiffness_n_per_m;
        sum.stiffness = Mat6::ZERO.plus_scaled(stiffness_n_per_m, &stiffness.rotated(rotation));
        if depth > 0.0 {
            sum.arm_world = rotation * depth_arm / depth;
        }
        if let Some(faces) = sum.carried_faces.as_mut() {
            // Points without a share in the sum, such as probes, have no depth there either.
            let mean_over = |depth_m: f64| if depth_m > 0.0 { 1.0 / depth_m } else { 0.0 };
            for (carried, total) in faces.iter_mut().zip(&totals) {
                sum.obstacle_motion.add(mean_over(depth), *carried);
                *carried = carried.scaled(mean_over(total.map_or(0.0, |total| total.depth)));
            }
        }
        sum
    }
}

/// The factor that keeps a sum of so many contacts at what ten of them give.
fn within_ten(effective: f64) -> f64 {
    1.0 / (effective / AVERAGED_CONTACTS).max(1.0)
}

impl Patch {
    /// From the sums of a face; `None` where it presses nothing.
    fn of(face: u8, total: &Total, stiffness_n_per_m: f64, rotation: glam::DMat3) -> Option<Self> {
        let normal = (-total.depth_gradient).try_normalize()?;
        let force_n = stiffness_n_per_m * total.depth_normal.dot(normal);
        let arm = total.depth_arm / total.depth;
        let (along, about) = total.stiffness.traces();
        let squared =
            if along > 0.0 { about / along - arm.cross(normal).length_squared() } else { 0.0 };
        (arm.is_finite() && force_n > 0.0).then(|| Self {
            face,
            force_n,
            normal_world: rotation * normal,
            arm_world: rotation * arm,
            radius_m: squared.max(0.0).sqrt(),
            stiffness_n_per_m: stiffness_n_per_m
                * total.stiffness.mul(normal, DVec3::ZERO).0.dot(normal),
        })
    }
}

#[cfg(test)]
#[expect(clippy::expect_used, reason = "test code")]
mod tests {
    use glam::DMat3;

    use super::*;

    #[test]
    fn a_patch_lies_in_the_middle_of_its_points_and_is_as_wide_and_as_stiff_as_they_are() {
        let stiffness_n_per_m = 700.0;
        let rotation = DMat3::from_rotation_x(0.7);
        // Two points half a metre to both sides of the middle, each so deep, pushed along z by a
        // wall whose normal lies aside.
        let normal = DVec3::new(-1.0, 0.0, 3.0) / 10_f64.sqrt();
        let middle = DVec3::new(0.1, -0.2, 0.3);
        let aside = DVec3::X * 0.5;
        let depth = 0.25;
        let slope = 3.0;
        let mut stiffness = Mat6::ZERO;
        for arm in [middle - aside, middle + aside] {
            stiffness.add_outer(slope, normal, arm.cross(normal));
        }
        let total = Total {
            depth_normal: DVec3::Z * (2.0 * depth),
            depth_moment: middle.cross(DVec3::Z) * (2.0 * depth),
            stiffness,
            // Steeper than a distance.
            depth_gradient: normal * (-4.0 * depth),
            depth: 2.0 * depth,
            depth_arm: middle * (2.0 * depth),
            effective: 2.0,
            deepest: depth,
        };
        let patch = Patch::of(4, &total, stiffness_n_per_m, rotation).expect("a face that presses");
        let off_n = patch.force_n - stiffness_n_per_m * 2.0 * depth * normal.z;
        let off_n_per_m = patch.stiffness_n_per_m - stiffness_n_per_m * 2.0 * slope;
        assert!(
            patch.face == 4
                && off_n.abs() < 1e-9
                && off_n_per_m.abs() < 1e-9
                && (patch.normal_world - rotation * normal).length() < 1e-12
                && (patch.arm_world - rotation * middle).length() < 1e-12
                && (patch.radius_m - aside.cross(normal).length()).abs() < 1e-12,
            "{patch:?}"
        );
        for nowhere in [
            Total { depth_normal: DVec3::ZERO, ..total },
            Total { depth_normal: -total.depth_normal, ..total },
            Total { depth_gradient: DVec3::ZERO, ..total },
        ] {
            assert_eq!(Patch::of(4, &nowhere, stiffness_n_per_m, rotation), None);
        }
    }
}
