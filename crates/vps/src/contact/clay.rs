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

use super::contact_block::ContactBlock;
use super::faces::BlockFaces;
use super::sum::{Add, Points, Weighting};
use super::summing::Summing;
use super::{ContactSum, FaceSums, ForceLaw, Patch, SimdLevel};
use crate::density::Probe;
use crate::pointshell::shell::{LANES, Lanes3, Shell};
use crate::pointshell::tree::{CHILDREN, Spheres};
use crate::spatial::{Mat6, Pose, Wrench};

impl ContactSum {
    /// The clay that a probe sees at this pose. `faces`: of the blocks of the shell. −`max_value_m`
    /// is the clearance that is proven while nothing touches, and no point may go further in a
    /// tick; `contacts` with a direction of their own count with the whole of their weight.
    ///
    /// RT: safe; a look-up per block, and up to one per point where the block is near, up to twenty
    /// where the point touches.
    pub fn of_clay(
        probe: &Probe<'_>,
        shell: &Shell,
        (faces, sums): (&[BlockFaces], &mut FaceSums),
        simd_level: SimdLevel,
        world_from_body: Pose,
        law: ForceLaw,
    ) -> Self {
        let mut summing = Summing::new(law, world_from_body, sums);
        let by = Weighting::new(probe.spacing_m(), false, false);
        let mut n_contacts = 0;
        let mut max_value_m = f32::NEG_INFINITY;
        let whole_clearance_m = probe.sphere_clearance_m(Vec3::ZERO, shell.radius_m() as f32);
        if whole_clearance_m > 0.0 {
            max_value_m = -whole_clearance_m;
        } else {
            let blocks = leaves(shell).zip(shell.blocks()).zip(shell.weights()).zip(faces);
            for (block, ((((center, radius_m), (positions, normals)), weights), faces)) in
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
                    depths_m: found.depths_m,
                    // Clay pushes along what it changes along.
                    ..ContactBlock::NONE
                };
                // Each counts as a point in the middle of its surface.
                let points =
                    Points { positions, normals: &found.directions, weights, half_axes: None };
                n_contacts += found.lanes.count_ones();
                for (face, touched) in faces.split(&touched) {
                    let Some(sums) = summing.face(face) else { continue };
                    simd_level.run(Add { sums, touched: &touched, points, by });
                }
            }
        }
        let clearance_m = f64::from(-max_value_m);
        let spacing_m = f64::from(probe.spacing_m());
        summing.note_found(
            spacing_m,
            n_contacts,
            (f64::from(max_value_m), clearance_m.max(0.0)),
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
        self.free_way_m = self.free_way_m.min(clay.free_way_m);
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

#[cfg(test)]
#[expect(clippy::expect_used, reason = "test code")]
mod tests {
    use std::sync::Arc;

    use glam::DVec3;

    use super::*;
    use crate::contact::{FACES, ObstacleMotion};
    use crate::density::{DensityFrame, Lattice, Raster};

    /// A power of two, so that nodes and densities are exact.
    const SPACING_M: f64 = 1.0 / 512.0;
    const STIFFNESS_N_PER_M: f64 = ForceLaw::PLAIN.stiffness_n_per_m;

    /// Clay below z = 0, sixteen spacings wide and as deep as it is high.
    fn clay() -> DensityFrame {
        let origin_map = DVec3::splat(-8.0 * SPACING_M);
        let lattice = Lattice { origin_map, spacing_m: SPACING_M, dims: [17; 3] };
        let mut raster = Raster::uniform(lattice, 0.0);
        for (value_m, z) in raster.values_m_mut().iter_mut().zip((0_u8..17).cycle()) {
            *value_m = ((8.0 - f64::from(z)) * SPACING_M) as f32;
        }
        raster.measure();
        let base = Arc::new(raster.clone());
        let mut frame =
            DensityFrame { sequence: 1, base, region: raster, rope_map: None, is_leap: false };
        frame.make_ready(None).expect("sound");
        frame
    }

    /// What a tool touches whose middle is so many spacings above the clay; its first block is of
    /// face 7.
    fn touched(shell: &Shell, height: f64) -> ContactSum {
        let frame = clay();
        let pose = Pose::from_translation(DVec3::Z * (height * SPACING_M));
        let probe = Probe::new(&frame, pose);
        let mut sums = FaceSums::new();
        let faces = [7, 3].map(BlockFaces::one);
        ContactSum::of_clay(
            &probe,
            shell,
            (faces.as_slice(), &mut sums),
            SimdLevel::Portable,
            pose,
            ForceLaw::PLAIN,
        )
    }

    /// A point at x, y and z spacings from the middle, with a normal that clay does not ask for.
    fn point(x: f64, y: f64, z: f64) -> (DVec3, DVec3) {
        (DVec3::new(x, y, z) * SPACING_M, DVec3::X)
    }

    /// Nothing touches, and so many spacings are clear.
    fn assert_clear(sum: &ContactSum, clear: f64) {
        let clear_m = clear * SPACING_M;
        assert_eq!((sum.contacts, sum.wrench), (0, Wrench::ZERO));
        assert!(
            (sum.max_value_m + clear_m).abs() < 1e-6 && (sum.step_limit_m - clear_m).abs() < 1e-6,
            "{clear_m} and not {sum:?}"
        );
    }

    #[test]
    fn a_tool_is_as_clear_of_clay_as_the_sphere_around_it() {
        // Its point lies aside, so the sphere about the middle comes one spacing nearer than the
        // point; a thousandth of a spacing is left to rounding.
        let shell = Shell::new(&[point(1.0, 0.0, 0.0)], 1e-3);
        assert_clear(&touched(&shell, 4.0), 4.0 - 1.0 - 1e-3);
    }

    #[test]
    fn a_tool_whose_sphere_meets_clay_is_as_clear_as_the_nearest_sphere_around_a_block() {
        // Two rows of points across, each two spacings long, four spacings aside, the second one
        // spacing higher.
        let points: [(DVec3, DVec3); 2 * LANES] = core::array::from_fn(|n| {
            let across = (n % LANES) as f64 / 7.5 - 1.0;
            if n < LANES { point(-4.0, across, 0.0) } else { point(4.0, across, 1.0) }
        });
        assert_clear(&touched(&Shell::new(&points, 1e-3), 2.0), 2.0 - 1.0 - 1e-3);
    }

    #[test]
    fn a_tool_whose_blocks_meet_clay_is_as_clear_as_its_nearest_point() {
        let shell = Shell::new(&[point(-4.0, 0.0, 0.0), point(4.0, 0.0, 1.0)], 1e-3);
        assert_clear(&touched(&shell, 2.0), 2.0);
    }

    #[test]
    fn clay_pushes_each_point_that_is_below_its_surface_out_by_its_depth() {
        // A point above it, two below, one on it; the others, with a second block, far above.
        let mut points = [point(0.0, 0.0, 2.0); LANES + 4];
        points[1] = point(1.0, 0.0, -0.25);
        points[2] = point(-3.0, 0.0, -0.5);
        points[3] = point(2.0, 0.0, 0.0);
        let sum = touched(&Shell::new(&points, 1e-3), 0.0);
        assert_eq!(sum.contacts, 2);
        assert!((sum.max_value_m - 0.5 * SPACING_M).abs() < 1e-8, "{sum:?}");
        assert_eq!((sum.voxel_size_m, sum.step_limit_m), (SPACING_M, 0.5 * SPACING_M));
        // F = K Σ d along z, and r × F = −K Σ x d = K (−1 · 0.25 + 3 · 0.5) s² about y.
        let force = DVec3::Z * (STIFFNESS_N_PER_M * 0.75 * SPACING_M);
        let torque = DVec3::Y * (STIFFNESS_N_PER_M * 1.25 * SPACING_M * SPACING_M);
        assert!(
            (sum.wrench.force - force).length() < 1e-4
                && (sum.wrench.torque - torque).length() < 1e-6,
            "{sum:?}"
        );
        assert!(sum.patches().map(|patch| patch.face).eq([7]));
    }

    const ALONG_X: Patch = Patch {
        face: 2,
        force_n: 3.0,
        normal_world: DVec3::X,
        arm_world: DVec3::new(0.1, 0.2, -0.3),
        radius_m: 0.5,
        stiffness_n_per_m: 100.0,
    };
    const ALONG_Y: Patch = Patch {
        face: 2,
        force_n: 4.0,
        normal_world: DVec3::Y,
        arm_world: DVec3::new(-0.4, 0.6, 0.2),
        radius_m: 0.25,
        stiffness_n_per_m: 200.0,
    };

    /// A sum with these patches, a contact each.
    fn pressed_by(patches: &[Patch]) -> ContactSum {
        let mut sum = ContactSum {
            contacts: 0,
            max_value_m: -1e-3,
            depth_is_bound: false,
            wrench: Wrench::ZERO,
            stiffness: Mat6::ZERO,
            arm_world: DVec3::ZERO,
            voxel_size_m: 1e-3,
            step_limit_m: 1e-3,
            looked_at: 0,
            left_out: 0,
            obstacle_motion: ObstacleMotion::default(),
            free_way_m: 0.0,
            clearance_is_bound: false,
            is_roped: false,
            patches: [None; FACES],
            carried_faces: None,
        };
        for patch in patches {
            sum.contacts += 1;
            sum.wrench.force += patch.normal_world * patch.force_n;
            sum.patches[usize::from(patch.face)] = Some(*patch);
        }
        sum
    }

    /// The forces on the faces of such a sum, on face 2 so strong along x and on face 5 along
    /// `other`, when this is felt of it.
    fn felt(forces_n: [f64; 2], other: DVec3, felt: DVec3) -> Vec<f64> {
        let mut sum = pressed_by(&[
            Patch { force_n: forces_n[0], ..ALONG_X },
            Patch { face: 5, force_n: forces_n[1], normal_world: other, ..ALONG_X },
        ]);
        let felt = Wrench::new(felt, DVec3::Z);
        sum.become_felt(felt);
        assert_eq!(sum.wrench, felt);
        sum.patches().map(|patch| patch.force_n).collect()
    }

    #[test]
    fn faces_press_with_the_share_of_the_force_that_is_felt() {
        // 3 N of 6 N are felt along it; 12 N, twice as much; of what points against it nothing.
        for (along_n, expected_n) in [(3.0, [2.0, 1.0]), (12.0, [8.0, 4.0]), (-3.0, [0.0, 0.0])] {
            assert_eq!(felt([4.0, 2.0], DVec3::X, DVec3::X * along_n), expected_n);
        }
    }

    #[test]
    fn faces_against_each_other_press_no_harder_than_they_did_or_than_all_that_is_felt() {
        // 2 N are left of both. Felt twice, neither presses more; felt ten times, both with 20 N.
        assert_eq!(felt([10.0, 8.0], DVec3::NEG_X, DVec3::X * 4.0), [10.0, 8.0]);
        assert_eq!(felt([10.0, 8.0], DVec3::NEG_X, DVec3::X * 20.0), [20.0, 20.0]);
    }

    #[test]
    fn faces_that_cancel_out_press_as_before_whatever_is_felt() {
        assert_eq!(felt([5.0, 5.0], DVec3::NEG_X, DVec3::Y), [5.0, 5.0]);
    }

    #[test]
    fn a_rope_pulls_and_acts_without_a_contact() {
        let mut sum = pressed_by(&[]);
        assert!(!sum.acts() && pressed_by(&[ALONG_X]).acts());
        let pull = Wrench::new(DVec3::new(1.0, -2.0, 3.0), DVec3::new(0.1, 0.2, -0.3));
        let mut stiffness = Mat6::ZERO;
        stiffness.add_outer(7.0, DVec3::X, DVec3::Y);
        for n in [1.0, 2.0] {
            sum.add_rope(pull, &stiffness);
            assert_eq!(sum.wrench, pull * n);
            assert_eq!(sum.stiffness, Mat6::ZERO.plus_scaled(n, &stiffness));
        }
        assert!(sum.acts() && sum.contacts == 0);
    }

    #[test]
    fn a_face_that_touches_an_obstacle_and_clay_presses_with_what_both_press() {
        let both = pressed_by(&[ALONG_X]).with_clay(&pressed_by(&[ALONG_Y]));
        let found = both.patches().next().expect("a face that presses");
        // 3 N along x and 4 N along y: 5 N along (3, 4) / 5, at the middle of both, each with its
        // force. The mean of the squared radii, and what the middles are apart by the theorem of
        // parallel axes: (3 · 0.25 + 4 · 0.0625) / 7 + 3 · 4 / 7² · |a − b|². Stiffness: Σ k cos².
        let apart = ALONG_X.arm_world - ALONG_Y.arm_world;
        let expected = Patch {
            face: 2,
            force_n: 5.0,
            normal_world: DVec3::new(0.6, 0.8, 0.0),
            arm_world: ALONG_X.arm_world * (3.0 / 7.0) + ALONG_Y.arm_world * (4.0 / 7.0),
            radius_m: (1.0 / 7.0 + 12.0 / 49.0 * apart.length_squared()).sqrt(),
            stiffness_n_per_m: 100.0 * 0.36 + 200.0 * 0.64,
        };
        assert_eq!((found.face, both.patches().count()), (2, 1));
        assert!(
            (found.force_n - expected.force_n).abs() < 1e-12
                && (found.normal_world - expected.normal_world).length() < 1e-12
                && (found.arm_world - expected.arm_world).length() < 1e-12
                && (found.radius_m - expected.radius_m).abs() < 1e-12
                && (found.stiffness_n_per_m - expected.stiffness_n_per_m).abs() < 1e-9,
            "{found:?} and not {expected:?}"
        );
    }

    #[test]
    fn contact_with_clay_adds_to_that_with_obstacles() {
        let mut stiffness = Mat6::ZERO;
        stiffness.add_outer(7.0, DVec3::X, DVec3::Y);
        let rigid = ContactSum {
            max_value_m: 1e-3,
            arm_world: DVec3::new(0.1, 0.2, 0.3),
            step_limit_m: 2e-3,
            stiffness,
            ..pressed_by(&[Patch { force_n: 2.0, ..ALONG_X }])
        };
        let clay = ContactSum {
            max_value_m: 2e-3,
            arm_world: DVec3::new(-0.4, 0.5, 0.6),
            step_limit_m: 1e-3,
            stiffness,
            ..pressed_by(&[
                Patch { force_n: 5.0, ..ALONG_Y },
                Patch { face: 9, force_n: 1.0, ..ALONG_Y },
            ])
        };
        let sum = rigid.with_clay(&clay);
        assert_eq!((sum.contacts, sum.max_value_m, sum.step_limit_m), (3, 2e-3, 1e-3));
        assert_eq!(sum.wrench.force, DVec3::new(2.0, 6.0, 0.0));
        assert_eq!(sum.stiffness, Mat6::ZERO.plus_scaled(2.0, &stiffness));
        assert!(sum.patches().map(|patch| patch.face).eq([2, 9]));
        // The middle, with 2 N and 6 N.
        let arm = rigid.arm_world * 0.25 + clay.arm_world * 0.75;
        assert!((sum.arm_world - arm).length() < 1e-12, "{}", sum.arm_world);
    }

    #[test]
    fn voxels_are_those_of_what_touches_and_the_smaller_where_both_or_neither_do() {
        // Contacts and voxels of the obstacles and of clay, which pulls by a rope as well.
        for ((contacts, voxel_size_m), (clays, size_m), expected) in [
            ((3, 2e-3), (0, 1e-3), 2e-3),
            ((0, 1e-3), (5, 2e-3), 2e-3),
            ((3, 2e-3), (5, 1e-3), 1e-3),
            ((3, 1e-3), (5, 2e-3), 1e-3),
            ((0, 2e-3), (0, 1e-3), 1e-3),
        ] {
            let rigid = ContactSum { contacts, voxel_size_m, ..pressed_by(&[]) };
            let mut clay = pressed_by(&[]);
            (clay.contacts, clay.voxel_size_m) = (clays, size_m);
            clay.add_rope(Wrench::ZERO, &Mat6::ZERO);
            let sum = rigid.with_clay(&clay);
            assert_eq!((sum.contacts, sum.voxel_size_m), (contacts + clays, expected));
            assert!(sum.acts());
        }
        // Clay that does not act.
        for (contacts, expected) in [(3, 2e-3), (0, 1e-3)] {
            let rigid = ContactSum { contacts, voxel_size_m: 2e-3, ..pressed_by(&[]) };
            let sum = rigid.with_clay(&pressed_by(&[]));
            assert_eq!((sum.contacts, sum.voxel_size_m), (contacts, expected));
        }
    }

    #[test]
    fn the_middle_stays_where_it_is_when_nothing_presses() {
        let rigid = ContactSum { arm_world: DVec3::ONE, ..pressed_by(&[]) };
        let mut clay = pressed_by(&[]);
        clay.add_rope(Wrench::ZERO, &Mat6::ZERO);
        assert_eq!(rigid.with_clay(&clay).arm_world, DVec3::ONE);
    }

    #[test]
    fn clay_carries_a_face_less_by_its_share_of_what_presses_on_it() {
        let motion = ObstacleMotion {
            linear: DVec3::new(4.0, 8.0, 12.0),
            angular: DVec3::new(-16.0, 20.0, 24.0),
        };
        let times = |share: f64| ObstacleMotion {
            linear: motion.linear * share,
            angular: motion.angular * share,
        };
        let mut carried = [ObstacleMotion::default(); FACES];
        carried[2] = motion;
        carried[5] = motion;
        let rigid = ContactSum {
            obstacle_motion: motion,
            carried_faces: Some(carried),
            ..pressed_by(&[ALONG_X, Patch { face: 5, force_n: 2.0, ..ALONG_X }])
        };
        let sum = rigid.with_clay(&pressed_by(&[Patch { force_n: 1.0, ..ALONG_Y }]));
        // Of 4 N on face 2 the clay, which stays where it is, has 1 N, and of 6 N on all faces.
        carried[2] = times(3.0 / 4.0);
        assert_eq!(sum.carried_faces(), Some(&carried));
        assert_eq!(sum.obstacle_motion, times(5.0 / 6.0));
    }
}
