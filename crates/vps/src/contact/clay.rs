//! Contact with clay: the points of the shell whose density is above zero, each pushed towards its
//! virtual contact point.
//!
//! Blocks of which the density in the middle of their sphere says that they cannot touch are passed
//! over; all others are looked up point by point. What is found goes into a sum like that of a
//! rigid obstacle.
//!
//! # Source
//! Guo2004 (virtual contact point); the sum is that of rigid contact.

use glam::Vec3;

use super::contact_block::{ContactBlock, ContactDirections};
use super::sum::{Add, Weighting};
use super::summing::Summing;
use super::{ContactSum, FaceSums, ForceLaw, Patch, SimdLevel};
use crate::density::Probe;
use crate::pointshell::shell::{LANES, Lanes3, Shell};
use crate::pointshell::tree::{CHILDREN, Spheres};
use crate::spatial::{Mat6, Pose, Wrench};

impl ContactSum {
    /// The clay that a probe sees at this pose. `faces`: of each block of the shell. −`max_value_m`
    /// is the clearance that is proven while nothing touches, and no point may go further in a
    /// tick; `contacts` with a direction of their own count with the whole of their weight, on an
    /// edge of the tool as well.
    ///
    /// RT: safe; a look-up per block, and up to one per point where the block is near, up to twenty
    /// where the point touches.
    pub fn of_clay(
        probe: &Probe<'_>,
        shell: &Shell,
        (faces, sums): (&[u8], &mut FaceSums),
        simd_level: SimdLevel,
        world_from_body: Pose,
        law: ForceLaw,
    ) -> Self {
        let mut summing = Summing::new(law, world_from_body, sums);
        let by = Weighting::new(probe.spacing_m(), law.smooth_entry);
        let mut n_contacts = 0;
        let mut max_value_m = f32::NEG_INFINITY;
        let whole_clearance_m = probe.sphere_clearance_m(Vec3::ZERO, shell.radius_m() as f32);
        if whole_clearance_m > 0.0 {
            max_value_m = -whole_clearance_m;
        } else {
            let blocks = leaves(shell).zip(shell.blocks()).zip(shell.weights()).zip(faces);
            for (block, ((((center, radius_m), (positions, normals)), weights), face)) in
                (0..).zip(blocks)
            {
                let clearance_m = probe.sphere_clearance_m(center, radius_m);
                if clearance_m > 0.0 {
                    max_value_m = max_value_m.max(-clearance_m);
                    continue;
                }
                let found = QueryResult::of(probe, positions, normals);
                max_value_m = max_value_m.max(found.max_value_m);
                if found.lanes == 0 {
                    continue;
                }
                let touched = ContactBlock {
                    block,
                    lanes: found.lanes,
                    weight: 1.0,
                    depths_m: found.depths_m,
                };
                let pushes = ContactDirections {
                    positions: *positions,
                    normals: found.directions,
                    areas: *weights,
                    weights: *weights,
                };
                n_contacts += found.lanes.count_ones();
                if let Some(sums) = summing.face(*face) {
                    simd_level.run(Add { sums, touched: &touched, pushes: &pushes, by });
                }
            }
        }
        let clearance_m = f64::from(-max_value_m);
        let spacing_m = f64::from(probe.spacing_m());
        summing.note_found(
            spacing_m,
            n_contacts,
            f64::from(max_value_m),
            clearance_m.max(0.5 * spacing_m),
        );
        summing.finish()
    }

    /// Replaces the wrench by what is felt of it. What presses on each face, which friction asks
    /// for, goes along.
    pub fn become_felt(&mut self, felt: Wrench) {
        let along = self.wrench.force.length_squared();
        if felt != self.wrench && along > 0.0 {
            let share = (felt.force.dot(self.wrench.force) / along).max(0.0);
            for patch in self.patches.iter_mut().flatten() {
                // Faces that press against each other do not press harder than what is felt of them
                // all.
                patch.force_n = (patch.force_n * share).min(patch.force_n.max(felt.force.length()));
            }
        }
        self.wrench = felt;
    }

    /// Adds the pull of a rope: it acts, but it is no contact.
    pub fn add_rope(&mut self, pull: Wrench, stiffness: &Mat6) {
        self.wrench = self.wrench + pull;
        self.stiffness = self.stiffness.plus_scaled(1.0, stiffness);
        self.is_roped = true;
    }

    /// What touches moves less in the mean when clay, which stays where it is, presses on the tool
    /// as well.
    fn stands_beside(&mut self, clay: &Self) {
        let Some(faces) = self.carried_faces.as_mut() else { return };
        let share = |ours_n: f64, clays_n: f64| {
            if clays_n > 0.0 { ours_n / (ours_n + clays_n) } else { 1.0 }
        };
        let force_n = |patch: &Option<Patch>| patch.map_or(0.0, |patch| patch.force_n);
        for ((carried, patch), clays) in faces.iter_mut().zip(&self.patches).zip(&clay.patches) {
            *carried = carried.scaled(share(force_n(patch), force_n(clays)));
        }
        self.obstacle_motion =
            self.obstacle_motion.scaled(share(self.pressed_n(), clay.pressed_n()));
    }

    /// What presses on all faces, N.
    fn pressed_n(&self) -> f64 {
        self.patches().map(|patch| patch.force_n).sum()
    }

    /// Rigid contact together with that of clay: each is normalised by itself, a face that touches
    /// both presses with what both press.
    #[must_use]
    pub fn with_clay(mut self, clay: &Self) -> Self {
        if clay.acts() {
            self.stands_beside(clay);
            let arm = weighted_arm(&self, clay);
            self.arm_world = arm;
            for (patch, other) in self.patches.iter_mut().zip(clay.patches) {
                *patch = match (*patch, other) {
                    (Some(patch), Some(other)) => Some(patch.with(&other)),
                    (one, other) => one.or(other),
                };
            }
            self.voxel_size_m = match (self.contacts > 0, clay.contacts > 0) {
                (true, false) => self.voxel_size_m,
                (false, true) => clay.voxel_size_m,
                _ => self.voxel_size_m.min(clay.voxel_size_m),
            };
            self.contacts += clay.contacts;
            self.wrench = self.wrench + clay.wrench;
            self.stiffness = self.stiffness.plus_scaled(1.0, &clay.stiffness);
            self.is_roped |= clay.is_roped;
        } else if self.contacts == 0 {
            self.voxel_size_m = self.voxel_size_m.min(clay.voxel_size_m);
        }
        self.max_value_m = self.max_value_m.max(clay.max_value_m);
        self.step_limit_m = self.step_limit_m.min(clay.step_limit_m);
        self
    }
}

/// Middle of both contacts, each with the force that presses it.
fn weighted_arm(one: &ContactSum, other: &ContactSum) -> glam::DVec3 {
    let by_one = one.pressed_n();
    let by_other = other.pressed_n();
    let both = by_one + by_other;
    if both > 0.0 {
        (one.arm_world * by_one + other.arm_world * by_other) / both
    } else {
        one.arm_world
    }
}

impl Patch {
    /// Both as one.
    fn with(&self, other: &Self) -> Self {
        let one_n = self.force_n;
        let other_n = other.force_n;
        let force = self.normal_world * one_n + other.normal_world * other_n;
        let Some(normal_world) = force.try_normalize() else { return *self };
        let both_n = one_n + other_n;
        let arm_world = (self.arm_world * one_n + other.arm_world * other_n) / both_n;
        let spread = |patch: &Self| {
            patch.radius_m * patch.radius_m + patch.arm_world.distance_squared(arm_world)
        };
        let along =
            |patch: &Self| patch.stiffness_n_per_m * patch.normal_world.dot(normal_world).powi(2);
        Self {
            face: self.face,
            force_n: force.length(),
            normal_world,
            arm_world,
            radius_m: ((spread(self) * one_n + spread(other) * other_n) / both_n).sqrt(),
            stiffness_n_per_m: along(self) + along(other),
        }
    }
}

/// The spheres around the blocks of a shell, in their order.
fn leaves(shell: &Shell) -> impl Iterator<Item = (Vec3, f32)> + '_ {
    let tree = shell.tree();
    let spheres = tree.n_levels().checked_sub(1).map_or(&[][..], |last| tree.spheres(last));
    let eight = |s: &Spheres| {
        let Spheres { x, y, z, radius } = *s;
        x.into_iter()
            .zip(y)
            .zip(z)
            .zip(radius)
            .map(|(((x, y), z), radius_m)| (Vec3::new(x, y, z), radius_m))
    };
    const { assert!(CHILDREN == 8) };
    spheres.iter().flat_map(eight)
}

/// What is found of a block.
struct QueryResult {
    lanes: u16,
    depths_m: [f32; LANES],
    directions: Lanes3,
    max_value_m: f32,
}

impl QueryResult {
    fn of(probe: &Probe<'_>, positions: &Lanes3, normals: &Lanes3) -> Self {
        let mut found = Self {
            lanes: 0,
            depths_m: [0.0; LANES],
            directions: *normals,
            max_value_m: f32::NEG_INFINITY,
        };
        for (lane, depth_m) in found.depths_m.iter_mut().enumerate() {
            let nodes = probe.nodes(positions.get(lane));
            match probe.value_m(nodes) {
                Some(value_m) if value_m > 0.0 => {
                    let out = probe.way_out(nodes, value_m, normals.get(lane));
                    *depth_m = out.depth_m;
                    found.directions.set(lane, out.direction_body);
                    found.lanes |= 1 << lane;
                    found.max_value_m = found.max_value_m.max(out.depth_m);
                }
                _ => found.max_value_m = found.max_value_m.max(-probe.clearance_m(nodes)),
            }
        }
        found
    }
}
