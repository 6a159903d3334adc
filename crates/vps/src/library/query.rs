//! Wrench and contacts of a pose.

use std::sync::{Mutex, PoisonError};

use glam::DVec3;

use super::error::check;
use super::{Error, PointShell, Voxmap};
use crate::contact::{
    Also, Contact, ContactSum, ForceLaw, Obstacle, SimdLevel, Traversal, TraversalMode,
};
use crate::mesh::FARTHEST_M;
use crate::parallel;
use crate::spatial::{Pose, Wrench};

/// Poses of a batch that one task looks at: enough that its memory is soon paid for.
const POSES_PER_TASK: usize = 16;
/// How far the square of a quaternion's length may be from 1: rounding to `f32` stays below it.
const UNIT_TOLERANCE: f64 = 1e-5;

/// Asks what wrench the voxmap exerts on the shell.
///
/// # Force
/// Each facet of the shell pushes with stiffness × mean depth × weight along its normal, where the
/// weight is its surface in squares of the shell's voxel edge s, and the mean over the facet counts
/// what of it is outside as 0. So a
/// face of area A at depth d pushes with about stiffness · d · A / s²: an elastic foundation of
/// stiffness / s², N/m³. There is no friction, and nothing is remembered: the same pose gives the
/// same bits, on every machine and thread.
///
/// # Threads
/// Any number of threads may ask one query at a time. Each takes the memory of its traversal from a
/// pool; a call allocates only where more threads ask at a time than ever before.
#[derive(Debug)]
pub struct ContactQuery {
    obstacle: [Obstacle; 1],
    shell: PointShell,
    law: ForceLaw,
    /// Traversals that no thread uses.
    spare: Mutex<Vec<Traversal>>,
}

/// What a shell feels at one pose.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ContactWrench {
    /// On the shell: force, N, in axes of the voxmap's mesh frame, and torque, N·m, about the
    /// origin of the shell's mesh frame.
    pub wrench: Wrench,
    /// Facets and points in contact.
    pub contacts: u32,
    /// Depth of the deepest point, m; 0 without contact, and where corners of facets alone touch.
    pub penetration_m: f64,
    /// Distance of the nearest point, m; 0 in contact, and never more than [`Voxmap::band_m`].
    pub clearance_m: f64,
}

/// One point in contact; vectors in axes of the voxmap's mesh frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ContactPoint {
    /// Number of the point in the shell.
    pub point: u32,
    /// Where its force acts, m, in the voxmap's mesh frame: the point itself, or of a facet that is
    /// immersed in part the middle of what presses.
    pub position_m: DVec3,
    /// Unit direction that pushes the shell out: its own surface's normal, inward.
    pub normal: DVec3,
    /// Unit gradient of the voxmap's distance there, the quickest way out: a motion of the contact
    /// by v changes its depth by −v · gradient. Beyond the band it may be zero.
    pub gradient: DVec3,
    /// m, greater than 0: of the point, or of the deepest place of a facet whose middle is outside.
    pub depth_m: f64,
    /// Force of this contact on the shell, N; 0 of probes on edges and corners, which have no
    /// surface. All of a pose add up to its force but for rounding, and their torques to its
    /// torque.
    pub force_n: DVec3,
}

impl ContactQuery {
    /// Prepares queries; `stiffness_n_per_m` is that of one point that stands for a square of the
    /// shell's voxel edge. Shares the memory of both parts. Cost: milliseconds, and about ten bytes
    /// per point for each thread that asks.
    ///
    /// # Errors
    /// [`Error::Value`]: the stiffness is not between 0 and 10¹² N/m.
    pub fn new(voxmap: &Voxmap, shell: &PointShell, stiffness_n_per_m: f64) -> Result<Self, Error> {
        check("stiffness_n_per_m", stiffness_n_per_m, 0.0..=1e12, "newtons per metre, 0 to 1e12")?;
        let obstacle = [Obstacle { field: voxmap.field().clone(), world_from_map: Pose::IDENTITY }];
        let law = ForceLaw { stiffness_n_per_m, ..ForceLaw::PLAIN };
        let query =
            Self { obstacle, shell: shell.clone(), law, spare: Mutex::new(Vec::with_capacity(64)) };
        query.with_traversal(|_| ());
        Ok(query)
    }

    /// Wrench, penetration and clearance at a pose of the shell's mesh frame in the voxmap's mesh
    /// frame. Allocates nothing; see [threads](#threads).
    ///
    /// # Errors
    /// [`Error::Pose`].
    pub fn wrench(&self, voxmap_from_shell: Pose) -> Result<ContactWrench, Error> {
        check_pose(0, voxmap_from_shell)?;
        Ok(self.with_traversal(|traversal| self.sum(traversal, voxmap_from_shell, None)))
    }

    /// The same; `each` gets every contact, in the order of the points.
    ///
    /// # Errors
    /// [`Error::Pose`].
    pub fn contacts(
        &self,
        voxmap_from_shell: Pose,
        mut each: impl FnMut(&ContactPoint),
    ) -> Result<ContactWrench, Error> {
        check_pose(0, voxmap_from_shell)?;
        let voxmap_from_body = self.voxmap_from_body(voxmap_from_shell);
        let mut also = |_: usize, contact: &Contact| {
            let normal = voxmap_from_body.transform_vector(contact.normal_body.as_dvec3());
            each(&ContactPoint {
                point: contact.point_idx,
                position_m: voxmap_from_body.transform_point(contact.pressed_body.as_dvec3()),
                normal,
                gradient: voxmap_from_body.transform_vector(contact.way_out_body.as_dvec3()),
                depth_m: contact.depth_m.into(),
                force_n: normal
                    * (self.law.stiffness_n_per_m
                        * f64::from(contact.mean_depth_m)
                        * f64::from(contact.weight)),
            });
        };
        Ok(self.with_traversal(|traversal| self.sum(traversal, voxmap_from_shell, Some(&mut also))))
    }

    /// `[n]`: [`Self::wrench`] of each pose, on the current rayon pool; the same bits as one by
    /// one, for any number of threads.
    ///
    /// # Errors
    /// [`Error::Pose`] of the first pose that is none.
    pub fn wrenches(&self, voxmap_from_shell: &[Pose]) -> Result<Vec<ContactWrench>, Error> {
        voxmap_from_shell
            .iter()
            .enumerate()
            .try_for_each(|(index, pose)| check_pose(index, *pose))?;
        Ok(parallel::map_chunks(voxmap_from_shell, POSES_PER_TASK, |poses| {
            self.with_traversal(|traversal| {
                poses.iter().map(|pose| self.sum(traversal, *pose, None)).collect::<Vec<_>>()
            })
        })
        .concat())
    }

    /// How stiff the contact is at a pose, as the law of the tick takes it: `[6][6]`, the second
    /// derivative of the contact's energy by x = (translation, m, rotation vector, rad, about the
    /// origin of the shell's mesh frame), axes of the voxmap's mesh frame. Symmetric; its rows are
    /// −∂force/∂x, N/m and N, and −∂torque/∂x, N and N·m, where the part that turns give the torque
    /// is taken symmetric. Convex contact has directions of negative stiffness: it pivots away.
    /// Cost: as [`Self::wrench`].
    ///
    /// # Errors
    /// [`Error::Pose`].
    pub fn stiffness(&self, voxmap_from_shell: Pose) -> Result<[[f64; 6]; 6], Error> {
        check_pose(0, voxmap_from_shell)?;
        let body = self.voxmap_from_body(voxmap_from_shell);
        let sum = self.with_traversal(|traversal| {
            ContactSum::of(traversal, &self.obstacle, self.shell.shell(), body, self.law, None)
        });
        Ok(sum.stiffness.moved(sum.wrench, body.translation, voxmap_from_shell.translation).0)
    }

    fn voxmap_from_body(&self, voxmap_from_shell: Pose) -> Pose {
        voxmap_from_shell * Pose::from_translation(self.shell.mass_properties().center_m)
    }

    fn sum(
        &self,
        traversal: &mut Traversal,
        pose: Pose,
        also: Option<&mut Also<'_>>,
    ) -> ContactWrench {
        let body = self.voxmap_from_body(pose);
        let shell = self.shell.shell();
        let band_m: f64 = self.obstacle[0].field.known_outside_m().into();
        let sum =
            ContactSum::with_clearance(traversal, &self.obstacle, shell, body, self.law, also);
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
            Traversal::new(
                SimdLevel::best(),
                TraversalMode::Tree,
                &self.obstacle,
                self.shell.shell(),
            )
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
