//! Wrench and contacts of a pose.

use std::ops::ControlFlow;
use std::sync::{Mutex, PoisonError};

use glam::{DVec3, Vec3};

use super::error::check;
use super::{Error, PointShell, Voxmap};
use crate::contact::{
    Also, Contact, ContactSum, ForceLaw, Highest, Obstacle, SimdLevel, Traversal, TraversalMode,
};
use crate::mesh::FARTHEST_M;
use crate::parallel;
use crate::pointshell::shell::LANES;
use crate::spatial::{Pose, Wrench};

/// Poses of a batch that one task looks at: enough that its memory is soon paid for.
const POSES_PER_TASK: usize = 16;
/// How far the square of a quaternion's length may be from 1: rounding to `f32` stays below it.
const UNIT_TOLERANCE: f64 = 1e-5;

/// Cosine of the angle between contacts of one patch, 20°.
const ONE_DIRECTION: f64 = 0.939_692_620_785_908_4;

/// Asks what wrench voxmaps exert on a shell.
///
/// # Force
/// Each facet of the shell pushes with stiffness × mean depth × weight along its normal, where the
/// weight is its surface in squares of the shell's voxel edge s, and the mean over the facet counts
/// what of it is outside as 0. So a face of area A at depth d pushes with about stiffness · d · A / s²:
/// an elastic foundation of stiffness / s², N/m³. Several voxmaps add up. There is no friction, and
/// nothing is remembered: the same pose gives the same bits, on every machine and thread.
///
/// # Threads
/// Any number of threads may ask one query at a time. Each takes the memory of its traversal from a
/// pool; a call allocates only where more threads ask at a time than ever before.
#[derive(Debug)]
pub struct ContactQuery {
    parts: Vec<Obstacle>,
    shell: PointShell,
    law: ForceLaw,
    /// Traversals that no thread uses.
    spare: Mutex<Vec<Traversal>>,
}

/// What a shell feels at one pose; vectors in axes of the *world*, the frame in which poses are
/// given: the voxmap's mesh frame, or of several the frame in which these stand.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ContactWrench {
    /// On the shell: force, N, and torque, N·m, about the origin of the shell's mesh frame.
    pub wrench: Wrench,
    /// Facets and points in contact.
    pub contacts: u32,
    /// Depth of the deepest contact, m; 0 without one.
    pub penetration_m: f64,
    /// Distance of the nearest point, m; 0 in contact, and never more than [`Voxmap::band_m`], of
    /// several the least.
    pub clearance_m: f64,
}

/// One point in contact; world axes as of [`ContactWrench`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ContactPoint {
    /// Number of the voxmap, from 0.
    pub part: u32,
    /// Number of the point in the shell.
    pub point: u32,
    /// Where its force acts, m: the point itself, or of a facet that is
    /// immersed in part the middle of what presses.
    pub position_m: DVec3,
    /// Unit direction that pushes the shell out: its own surface's normal, inward.
    pub normal: DVec3,
    /// Unit gradient of the voxmap's distance there, the quickest way out: a motion of the contact
    /// by v changes its depth by −v · gradient, that of a facet whose middle is outside by less.
    /// Beyond the band it may be zero.
    pub gradient: DVec3,
    /// m, greater than 0: of the point, or in the mean over a facet whose middle is outside.
    pub depth_m: f64,
    /// Surface that it stands for, m².
    pub area_m2: f64,
    /// Force of this contact on the shell, N; 0 of probes on edges and corners, which have no
    /// surface. All of a pose add up to its force but for rounding, and their torques to its
    /// torque.
    pub force_n: DVec3,
}

/// The point of a shell that is nearest to a voxmap while nothing touches; world frame as of
/// [`ContactWrench`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct NearestPoint {
    /// Number of the voxmap, from 0.
    pub part: u32,
    /// Number of the point in the shell.
    pub point: u32,
    /// The point, m.
    pub on_shell_m: DVec3,
    /// The place on the surface of the voxmap that is nearest to it, m: by interpolated distances.
    pub on_part_m: DVec3,
    /// The clearance, m: the distance of both but for interpolation.
    pub distance_m: f64,
}

/// Contacts with one part that push in about one direction; world frame as of [`ContactWrench`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ContactPatch {
    /// Number of the voxmap, from 0.
    pub part: u32,
    /// Mean unit gradient of the distance, by force: the quickest way out.
    pub normal: DVec3,
    /// Force on the shell, N.
    pub force_n: DVec3,
    /// Mean place of the forces, by their size, m.
    pub position_m: DVec3,
    /// Surface of the facets that touch, be it in part, m².
    pub area_m2: f64,
    /// Of the deepest, m.
    pub depth_m: f64,
    /// How many.
    pub contacts: u32,
}

impl ContactPatch {
    /// `sums`: of sizes of forces, and of gradients and places each by these.
    fn add(&mut self, (size_n, gradients, places): &mut (f64, DVec3, DVec3), point: &ContactPoint) {
        let own_n = point.force_n.length();
        *size_n += own_n;
        *gradients += point.way_out() * own_n;
        *places += point.position_m * own_n;
        self.normal = gradients.normalize_or(point.way_out());
        self.position_m = if *size_n > 0.0 { *places / *size_n } else { point.position_m };
        self.force_n += point.force_n;
        self.area_m2 += point.area_m2;
        self.depth_m = self.depth_m.max(point.depth_m);
        self.contacts += 1;
    }
}

/// Where a motion first touches.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Impact {
    /// Share of the motion, 0 to 1.
    pub share: f64,
    /// Pose there: it touches, and a motion by the tolerance before it did not, where it does not
    /// begin in contact.
    pub pose: Pose,
}

impl ContactPoint {
    /// The gradient, or the normal where there is none.
    fn way_out(&self) -> DVec3 {
        if self.gradient == DVec3::ZERO { self.normal } else { self.gradient }
    }
}

impl ContactQuery {
    /// Prepares queries; `stiffness_n_per_m` is that of one point that stands for a square of the
    /// shell's voxel edge. Shares the memory of both parts. Cost: milliseconds, and about ten bytes
    /// per point for each thread that asks.
    ///
    /// # Errors
    /// [`Error::Value`]: the stiffness is not between 0 and 10¹² N/m.
    pub fn new(voxmap: &Voxmap, shell: &PointShell, stiffness_n_per_m: f64) -> Result<Self, Error> {
        Self::of_parts(&[(voxmap, Pose::IDENTITY)], shell, stiffness_n_per_m)
    }

    /// The same of several voxmaps that stand in one world, each with the pose of its mesh frame
    /// there; poses of the shell are then those in the world. A face that is immersed in two counts
    /// twice.
    ///
    /// # Errors
    /// Those of [`Self::new`]; [`Error::Value`]: no voxmap; [`Error::Pose`].
    pub fn of_parts(
        world_from_voxmap: &[(&Voxmap, Pose)],
        shell: &PointShell,
        stiffness_n_per_m: f64,
    ) -> Result<Self, Error> {
        check("stiffness_n_per_m", stiffness_n_per_m, 0.0..=1e12, "newtons per metre, 0 to 1e12")?;
        check("the number of voxmaps", world_from_voxmap.len() as f64, 1.0..=1e6, "1 to 1e6")?;
        for (index, (_, pose)) in world_from_voxmap.iter().enumerate() {
            check_pose(index, *pose)?;
        }
        let part = |(voxmap, world_from_map): &(&Voxmap, Pose)| Obstacle {
            field: voxmap.field().clone(),
            world_from_map: *world_from_map,
        };
        let parts = world_from_voxmap.iter().map(part).collect();
        let law = ForceLaw { stiffness_n_per_m, ..ForceLaw::PLAIN };
        let query =
            Self { parts, shell: shell.clone(), law, spare: Mutex::new(Vec::with_capacity(64)) };
        query.with_traversal(|_| ());
        Ok(query)
    }

    /// Wrench, penetration and clearance at a pose of the shell's mesh frame in the world, which is
    /// the voxmap's mesh frame where there is one. Allocates nothing; see [threads](#threads).
    ///
    /// # Errors
    /// [`Error::Pose`].
    pub fn wrench(&self, world_from_shell: Pose) -> Result<ContactWrench, Error> {
        check_pose(0, world_from_shell)?;
        Ok(self.with_traversal(|traversal| self.sum(traversal, world_from_shell, None)))
    }

    /// The same; `each` gets every contact, part after part in the order of the points.
    ///
    /// # Errors
    /// [`Error::Pose`].
    pub fn contacts(
        &self,
        world_from_shell: Pose,
        mut each: impl FnMut(&ContactPoint),
    ) -> Result<ContactWrench, Error> {
        check_pose(0, world_from_shell)?;
        let world_from_body = self.world_from_body(world_from_shell);
        let mut also = |part: usize, contact: &Contact| {
            let normal = world_from_body.transform_vector(contact.normal_body.as_dvec3());
            each(&ContactPoint {
                part: part as u32,
                point: contact.point_idx,
                position_m: world_from_body.transform_point(contact.pressed_body.as_dvec3()),
                normal,
                gradient: world_from_body.transform_vector(contact.way_out_body.as_dvec3()),
                depth_m: contact.noted_depth_m().into(),
                area_m2: f64::from(contact.weight) * self.shell.voxel_size_m().powi(2),
                force_n: normal
                    * (self.law.stiffness_n_per_m
                        * f64::from(contact.mean_depth_m)
                        * f64::from(contact.weight)),
            });
        };
        Ok(self.with_traversal(|traversal| self.sum(traversal, world_from_shell, Some(&mut also))))
    }

    /// `[n]`: [`Self::wrench`] of each pose, on the current rayon pool; the same bits as one by
    /// one, for any number of threads.
    ///
    /// # Errors
    /// [`Error::Pose`] of the first pose that is none.
    pub fn wrenches(&self, world_from_shell: &[Pose]) -> Result<Vec<ContactWrench>, Error> {
        world_from_shell
            .iter()
            .enumerate()
            .try_for_each(|(index, pose)| check_pose(index, *pose))?;
        Ok(parallel::map_chunks(world_from_shell, POSES_PER_TASK, |poses| {
            self.with_traversal(|traversal| {
                poses.iter().map(|pose| self.sum(traversal, *pose, None)).collect::<Vec<_>>()
            })
        })
        .concat())
    }

    /// How stiff the contact is at a pose, as the law of the tick takes it: `[6][6]`, the second
    /// derivative of the contact's energy by x = (translation, m, rotation vector, rad, about the
    /// origin of the shell's mesh frame), world axes. Symmetric; its rows are
    /// −∂force/∂x, N/m and N, and −∂torque/∂x, N and N·m, where the part that turns give the torque
    /// is taken symmetric. Convex contact has directions of negative stiffness: it pivots away.
    /// Cost: as [`Self::wrench`].
    ///
    /// # Errors
    /// [`Error::Pose`].
    pub fn stiffness(&self, world_from_shell: Pose) -> Result<[[f64; 6]; 6], Error> {
        check_pose(0, world_from_shell)?;
        let body = self.world_from_body(world_from_shell);
        let sum = self.with_traversal(|traversal| {
            ContactSum::of(traversal, &self.parts, self.shell.shell(), body, self.law, None)
        });
        Ok(sum.stiffness.moved(sum.wrench, body.translation, world_from_shell.translation).0)
    }

    /// The point of the shell that is nearest to a part, and the place there. `None` where something
    /// touches, of which [`Self::contacts`] says where, and beyond the least band less a voxel.
    /// Allocates nothing; costs as [`Self::wrench`].
    ///
    /// # Errors
    /// [`Error::Pose`].
    pub fn nearest(&self, world_from_shell: Pose) -> Result<Option<NearestPoint>, Error> {
        check_pose(0, world_from_shell)?;
        let body = self.world_from_body(world_from_shell);
        let shell = self.shell.shell();
        let highest = self.with_traversal(|traversal| {
            let sum = ContactSum::of(traversal, &self.parts, shell, body, self.law, None);
            (sum.contacts == 0).then(|| Highest::of(traversal, &self.parts, shell, body, self.law))
        });
        Ok(highest.and_then(|highest| {
            let part = highest.obstacle_idx?;
            let Obstacle { field, world_from_map } = self.parts.get(part)?;
            let distance_m = -highest.value_m;
            let voxel_size_m = f64::from(field.voxel_size_m());
            // Directions take distances half a cell farther out.
            if distance_m > f64::from(field.known_outside_m()) - voxel_size_m {
                return None;
            }
            let map_from_body = world_from_map.inverse() * body;
            let point = highest.point(field, shell, map_from_body)?;
            let block = shell.positions().get(point as usize / LANES)?;
            let arm = block.get(point as usize % LANES).as_dvec3();
            let mut on_map = map_from_body.transform_point(arm);
            // Once the whole way, and what is off there. Within a cell interpolated gradients are off
            // by up to half a cell over the distance; differences over a cell are not.
            for _ in 0..3 {
                let cells = ((on_map - field.origin_map().as_dvec3()) / voxel_size_m).as_vec3();
                let depth_m = |cells: Vec3| field.distance(cells).0;
                let grows = |axis: Vec3| depth_m(cells + 0.5 * axis) - depth_m(cells - 0.5 * axis);
                let inward = Vec3::from_array(Vec3::AXES.map(grows)).as_dvec3();
                on_map -= inward.normalize_or_zero() * f64::from(depth_m(cells));
            }
            Some(NearestPoint {
                part: part as u32,
                point,
                on_shell_m: body.transform_point(arm),
                on_part_m: world_from_map.transform_point(on_map),
                distance_m,
            })
        }))
    }

    /// What touches, in few words: contacts with one part whose gradients are within 20° are one
    /// patch, the hardest first. Their forces add up to that of the pose but for rounding. Probes,
    /// which have no surface, are in no patch. Allocates; costs as [`Self::contacts`].
    ///
    /// # Errors
    /// [`Error::Pose`].
    pub fn patches(&self, world_from_shell: Pose) -> Result<Vec<ContactPatch>, Error> {
        let mut patches: Vec<(ContactPatch, (f64, DVec3, DVec3))> = Vec::new();
        self.contacts(world_from_shell, |point| {
            if point.area_m2 <= 0.0 {
                return;
            }
            let is_same = |(patch, _): &&mut (ContactPatch, _)| {
                patch.part == point.part && patch.normal.dot(point.way_out()) > ONE_DIRECTION
            };
            if let Some((patch, sums)) = patches.iter_mut().find(is_same) {
                patch.add(sums, point);
                return;
            }
            let mut patch = ContactPatch { part: point.part, ..ContactPatch::default() };
            let mut sums = (0.0, DVec3::ZERO, DVec3::ZERO);
            patch.add(&mut sums, point);
            patches.push((patch, sums));
        })?;
        patches.sort_by(|(_, (a, ..)), (_, (b, ..))| b.total_cmp(a));
        Ok(patches.into_iter().map(|(patch, _)| patch).collect())
    }

    /// Where a motion from one pose to another first touches; `None` where it does not. The shell's
    /// centre of mass goes straight and its rotation turns about one axis, both evenly.
    ///
    /// Conservative advancement: it goes as far as nothing can touch, at least by the tolerance, and
    /// asks again. Parts may be thin: only contact that ends again within a way of the tolerance
    /// may be missed. Cost: a query for each step; few in the open, and close along a part no more
    /// than the way over the tolerance. Allocates nothing.
    ///
    /// # Errors
    /// [`Error::Pose`], with the number 0 or 1 of the pose that is none; [`Error::Value`]: the
    /// tolerance is not greater than 0.
    pub fn first_contact(
        &self,
        from: Pose,
        to: Pose,
        tolerance_m: f64,
    ) -> Result<Option<Impact>, Error> {
        self.first_contact_with(from, to, tolerance_m, |_| ControlFlow::Continue(()))
    }

    /// The same; `watch` gets the share of the motion that is clear before each step, and can end the
    /// search.
    ///
    /// # Errors
    /// Those of [`Self::first_contact`], and [`Error::Cancelled`].
    pub fn first_contact_with(
        &self,
        from: Pose,
        to: Pose,
        tolerance_m: f64,
        mut watch: impl FnMut(f64) -> ControlFlow<()>,
    ) -> Result<Option<Impact>, Error> {
        check_pose(0, from)?;
        check_pose(1, to)?;
        check("tolerance_m", tolerance_m, 1e-12..=FARTHEST_M, "metres, greater than 1e-12")?;
        let [begin, end] = [from, to].map(|pose| {
            let body = self.world_from_body(pose);
            Pose { rotation: body.rotation.normalize(), ..body }
        });
        let body_from_shell = begin.inverse() * from;
        let shell = self.shell.shell();
        let way_m = begin.translation.distance(end.translation)
            + begin.rotation_to(end).length() * (shell.radius_m() + f64::from(shell.reach_m()));
        let least = (tolerance_m / way_m.max(f64::MIN_POSITIVE)).max(f64::EPSILON);
        self.with_traversal(|traversal| {
            let mut share = 0.0;
            loop {
                let body = Pose::new(
                    begin.rotation.slerp(end.rotation, share),
                    begin.translation.lerp(end.translation, share),
                );
                let sum = ContactSum::of(traversal, &self.parts, shell, body, self.law, None);
                if sum.contacts > 0 {
                    return Ok(Some(Impact { share, pose: body * body_from_shell }));
                }
                if share >= 1.0 {
                    return Ok(None);
                }
                if watch(share).is_break() {
                    return Err(Error::Cancelled);
                }
                share = (share + (sum.free_way_m / way_m).max(least)).min(1.0);
            }
        })
    }

    fn world_from_body(&self, world_from_shell: Pose) -> Pose {
        world_from_shell * Pose::from_translation(self.shell.mass_properties().center_m)
    }

    fn sum(
        &self,
        traversal: &mut Traversal,
        pose: Pose,
        also: Option<&mut Also<'_>>,
    ) -> ContactWrench {
        let body = self.world_from_body(pose);
        let shell = self.shell.shell();
        let bands_m = self.parts.iter().map(|part| part.field.known_outside_m());
        let band_m = bands_m.fold(f32::INFINITY, f32::min).into();
        let sum = ContactSum::with_clearance(traversal, &self.parts, shell, body, self.law, also);
        ContactWrench {
            wrench: sum.wrench.moved(body.translation, pose.translation),
            contacts: sum.contacts,
            penetration_m: sum.max_value_m.max(0.0),
            clearance_m: if sum.contacts > 0 { 0.0 } else { (-sum.max_value_m).clamp(0.0, band_m) },
        }
    }

    fn with_traversal<T>(&self, ask: impl FnOnce(&mut Traversal) -> T) -> T {
        let spare = || self.spare.lock().unwrap_or_else(PoisonError::into_inner);
        let taken = spare().pop();
        let mut traversal = taken.unwrap_or_else(|| {
            Traversal::new(SimdLevel::best(), TraversalMode::Tree, &self.parts, self.shell.shell())
        });
        let answer = ask(&mut traversal);
        spare().push(traversal);
        answer
    }
}

fn check_pose(index: usize, pose: Pose) -> Result<(), Error> {
    let Pose { rotation, translation } = pose;
    let refused = |what| Err(Error::Pose { index, what });
    if !(translation.is_finite() && translation.abs().max_element() <= FARTHEST_M) {
        return refused(format!(
            "translation {translation} m: give finite metres, at most {FARTHEST_M:e} from the \
                origin"
        ));
    }
    if !(-UNIT_TOLERANCE..=UNIT_TOLERANCE).contains(&(rotation.length_squared() - 1.0)) {
        return refused(format!(
            "rotation {rotation} of length {}: give a unit quaternion x, y, z, w",
            rotation.length()
        ));
    }
    Ok(())
}
