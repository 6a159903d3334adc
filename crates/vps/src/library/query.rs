//! Wrench and contacts of a pose.

use std::ops::ControlFlow;
use std::sync::{Mutex, PoisonError};

use glam::DVec3;

use super::error::check;
use super::way::{Way, error_m};
use super::{Error, PointShell, Voxmap};
use crate::contact::{ForceLaw, Highest, Obstacle, Traversal};
use crate::mesh::FARTHEST_M;
use crate::parallel;
use crate::spatial::{Mat6, Pose, Wrench};
use crate::voxmap::field::FieldKind;

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
/// what of it is outside as 0. So a face of area A at depth d pushes with about stiffness · d · A /
/// s²: an elastic foundation of stiffness / s², N/m³. Several voxmaps add up. There is no friction,
/// and nothing is remembered: the same pose gives the same bits, on every machine and thread.
///
/// # Threads
/// Any number of threads may ask one query at a time. Each takes the memory of its traversal from a
/// pool; a call allocates only where more threads ask at a time than ever before.
///
/// # Examples
/// Examples of the calls have these parts and poses; where they say `query`, it is of both parts and
/// 1000 N/m.
/// ```
/// # use vps::{ContactQuery, DVec3, Mesh, Options, PointShell, Pose, Shape, Voxmap};
/// let options = Options::new(1e-3);
/// let cube = |edge_m| Mesh::from_shape(&Shape::Box { size_m: DVec3::splat(edge_m) }, 1e-5);
/// let block = Voxmap::bake(&cube(40e-3)?, &options)?;
/// let peg = PointShell::bake(&cube(10e-3)?, &options)?;
/// // The peg's lower face is half a millimetre deep in the top of the block.
/// let deep = Pose::from_translation(DVec3::Z * 24.5e-3);
/// let felt = ContactQuery::new(&block, &peg, 1000.0)?.wrench(deep)?;
/// // Stiffness · area · depth / s², straight up.
/// let force_n = 1000.0 * (10e-3 * 10e-3) * 0.5e-3 / (1e-3 * 1e-3);
/// assert!((felt.wrench.force - DVec3::Z * force_n).length() < 1e-3 * force_n);
/// # Ok::<(), vps::Error>(())
/// ```
#[derive(Debug)]
pub struct ContactQuery {
    /// The shell in the voxmaps; then, of both ways, the other part's shell in the shell's voxmap.
    ways: Vec<Way>,
    /// Traversals that no thread uses, one for each way.
    spare: Mutex<Vec<Vec<Traversal>>>,
}

/// What a shell feels at one pose; vectors in axes of the *world*, the frame in which poses are
/// given: the voxmap's mesh frame, or of several the frame in which these stand.
///
/// # Examples
/// ```
/// # use vps::{ContactQuery, DVec3, Mesh, Options, PointShell, Pose, Shape, Voxmap};
/// # let options = Options::new(1e-3);
/// # let cube = |edge_m| Mesh::from_shape(&Shape::Box { size_m: DVec3::splat(edge_m) }, 1e-5);
/// # let block = Voxmap::bake(&cube(40e-3)?, &options)?;
/// # let peg = PointShell::bake(&cube(10e-3)?, &options)?;
/// # let query = ContactQuery::new(&block, &peg, 1000.0)?;
/// let high = query.wrench(Pose::from_translation(DVec3::Z * 26e-3))?; // 1 mm above the block
/// assert_eq!((high.contacts, high.penetration_m), (0, 0.0));
/// assert!((high.clearance_m - 1e-3).abs() < 0.001e-3);
/// let deep = query.wrench(Pose::from_translation(DVec3::Z * 24e-3))?; // 1 mm inside
/// assert!((deep.penetration_m - 1e-3).abs() < 0.001e-3 && deep.clearance_m == 0.0);
/// # Ok::<(), vps::Error>(())
/// ```
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

impl ContactWrench {
    /// Of both ways.
    fn and(self, other: Self) -> Self {
        let contacts = self.contacts + other.contacts;
        let clearance_m = self.clearance_m.min(other.clearance_m);
        Self {
            wrench: self.wrench + other.wrench,
            contacts,
            penetration_m: self.penetration_m.max(other.penetration_m),
            clearance_m: if contacts > 0 { 0.0 } else { clearance_m },
        }
    }
}

/// One point in contact; world axes as of [`ContactWrench`].
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ContactPoint {
    /// Number of the voxmap, from 0. Of both ways 1: the point is one of the part that stands
    /// still, and the normal is that surface's, outward.
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
    /// Number of the voxmap, from 0. Of both ways 1: the point is one of the part that stands still
    /// and lies at `on_part_m`.
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
    /// # Examples
    /// ```
    /// # use vps::{ContactQuery, DVec3, Mesh, Options, PointShell, Pose, Shape, Voxmap};
    /// # let options = Options::new(1e-3);
    /// # let cube = |edge_m| Mesh::from_shape(&Shape::Box { size_m: DVec3::splat(edge_m) }, 1e-5);
    /// # let block = Voxmap::bake(&cube(40e-3)?, &options)?;
    /// # let peg = PointShell::bake(&cube(10e-3)?, &options)?;
    /// # let deep = Pose::from_translation(DVec3::Z * 24.5e-3);
    /// let soft = ContactQuery::new(&block, &peg, 1000.0)?.wrench(deep)?;
    /// let hard = ContactQuery::new(&block, &peg, 3000.0)?.wrench(deep)?;
    /// let ratio = hard.wrench.force.z / soft.wrench.force.z;
    /// assert!((ratio - 3.0).abs() < 1e-6, "force is proportional to the stiffness");
    /// assert!(ContactQuery::new(&block, &peg, -1.0).is_err());
    /// # Ok::<(), vps::Error>(())
    /// ```
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
    /// # Examples
    /// ```
    /// # use vps::{ContactQuery, DVec3, Mesh, Options, PointShell, Pose, Shape, Voxmap};
    /// # let options = Options::new(1e-3);
    /// # let cube = |edge_m| Mesh::from_shape(&Shape::Box { size_m: DVec3::splat(edge_m) }, 1e-5);
    /// # let block = Voxmap::bake(&cube(40e-3)?, &options)?;
    /// # let peg = PointShell::bake(&cube(10e-3)?, &options)?;
    /// // The peg's lower and left face are half a millimetre deep in a floor and a wall.
    /// let wall = Pose::from_translation(DVec3::new(-24.5e-3, 0.0, 24.5e-3));
    /// let parts = [(&block, Pose::IDENTITY), (&block, wall)];
    /// let query = ContactQuery::of_parts(&parts, &peg, 1000.0)?;
    /// let force = query.wrench(Pose::from_translation(DVec3::Z * 24.5e-3))?.wrench.force;
    /// assert!((force - DVec3::new(50.0, 0.0, 50.0)).length() < 0.1);
    /// # Ok::<(), vps::Error>(())
    /// ```
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
        let error_m = error_m(world_from_voxmap.iter().map(|(voxmap, _)| *voxmap), shell);
        let shell = shell.clone();
        let way = Way { parts, shell, law, is_back: false, first_part: 0, error_m };
        Ok(Self::of_ways(vec![way]))
    }

    /// The same of two parts that each have both, the one that stands still and the one that moves:
    /// wrench, stiffness and contacts are those of half the energy of the points of the one in the
    /// other and half of the reverse, so that neither is preferred, and a needle or blade that
    /// slips between the points of the other part presses with its own.
    ///
    /// The stiffness counts for a square of the moving shell's voxel edge, and for other edges of
    /// the other shell by their area. The number 1 of a voxmap is that of the moving part, in which
    /// points of the other shell are. Penetration and clearance are the greater and the lesser of
    /// both. Costs as both queries.
    ///
    /// # Examples
    /// ```
    /// # use vps::{ContactQuery, DVec3, Mesh, Options, PointShell, Pose, Shape, Voxmap};
    /// # let options = Options::new(1e-3);
    /// # let cube = |edge_m| Mesh::from_shape(&Shape::Box { size_m: DVec3::splat(edge_m) }, 1e-5);
    /// let bake = |mesh: &Mesh| -> Result<_, vps::Error> {
    ///     Ok((Voxmap::bake(mesh, &options)?, PointShell::bake(mesh, &options)?))
    /// };
    /// let block = bake(&cube(40e-3)?)?;
    /// let peg = bake(&cube(10e-3)?)?;
    /// let query = ContactQuery::both_ways((&block.0, &block.1), (&peg.0, &peg.1), 1000.0)?;
    /// let force = query.wrench(Pose::from_translation(DVec3::Z * 24.5e-3))?.wrench.force;
    /// // The peg's points press with 50 N. The block's points are less deep where a side of the peg
    /// // is nearer than its lower face: 45.17 N.
    /// assert!((force - DVec3::Z * (50.0 + 45.17) / 2.0).length() < 0.1);
    /// # Ok::<(), vps::Error>(())
    /// ```
    ///
    /// # Errors
    /// Those of [`Self::new`].
    pub fn both_ways(
        (voxmap, own_shell): (&Voxmap, &PointShell),
        (own_voxmap, shell): (&Voxmap, &PointShell),
        stiffness_n_per_m: f64,
    ) -> Result<Self, Error> {
        let there = Self::new(voxmap, shell, stiffness_n_per_m)?;
        let back = Self::new(own_voxmap, own_shell, stiffness_n_per_m)?;
        let squares = (own_shell.voxel_size_m() / shell.voxel_size_m()).powi(2);
        let back = back.ways.into_iter().map(|way| Way { is_back: true, first_part: 1, ..way });
        let mut ways: Vec<Way> = there.ways.into_iter().chain(back).collect();
        for way in &mut ways {
            way.law.stiffness_n_per_m *= if way.is_back { 0.5 * squares } else { 0.5 };
        }
        Ok(Self::of_ways(ways))
    }

    /// Finds depths by another look-up than interpolation, as `rendering.field` of a scene; with
    /// [`PointShell::bake_of`] the force is that of the scene. Every point is then looked at, and
    /// contacts may be without a gradient.
    ///
    /// # Examples
    /// ```
    /// # use vps::{ContactQuery, DVec3, Error, FieldKind, Mesh, Options, PointShell, Pose};
    /// # use vps::{Shape, Voxmap};
    /// # let options = Options::new(1e-3);
    /// # let cube = |edge_m| Mesh::from_shape(&Shape::Box { size_m: DVec3::splat(edge_m) }, 1e-5);
    /// # let block = Voxmap::bake(&cube(40e-3)?, &options)?;
    /// # let peg = PointShell::bake(&cube(10e-3)?, &options)?;
    /// # let deep = Pose::from_translation(DVec3::Z * 24.5e-3);
    /// let mut query = ContactQuery::new(&block, &peg, 1000.0)?;
    /// query.set_field(FieldKind::Octant)?;
    /// assert!((query.wrench(deep)?.wrench.force.z - 50.0).abs() < 0.1);
    /// assert!(matches!(query.set_field(FieldKind::SurfacePoint), Err(Error::Field)));
    /// # Ok::<(), vps::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::Field`]: a voxmap lacks what this look-up reads.
    pub fn set_field(&mut self, field: FieldKind) -> Result<(), Error> {
        let lacks = |part: &Obstacle| !part.field.has_gradients();
        let mut parts = self.ways.iter().flat_map(|way| &way.parts);
        if field == FieldKind::SurfacePoint && parts.any(lacks) {
            return Err(Error::Field);
        }
        self.ways.iter_mut().for_each(|way| way.law.field = field);
        Ok(())
    }

    /// How far the answer may be off, m: in at least 95 of 100 poses the penetration by no more
    /// than this, and the force by no more than this over the penetration as a share of it, at most
    /// all.
    ///
    /// It is [`surface_error_m`](crate::Accuracy::surface_error_m) of the voxmap,
    /// [`unseen_depth_m`](crate::Accuracy::unseen_depth_m) of the shell and a tenth of the shell's
    /// voxel edge, of several voxmaps or both ways the most; a test holds it against exact
    /// integrals over blocks, balls and rods, with cones as tools too, up to two voxels deep. Flat
    /// faces and straight edges are some ten times better. `None` of skins, other fields than
    /// trilinear, points that are not facets, and voxmaps of files that do not say it.
    ///
    /// # Examples
    /// ```
    /// # use vps::{ContactQuery, DVec3, Mesh, Options, PointShell, Pose, Shape, Voxmap};
    /// # let options = Options::new(1e-3);
    /// # let cube = |edge_m| Mesh::from_shape(&Shape::Box { size_m: DVec3::splat(edge_m) }, 1e-5);
    /// # let block = Voxmap::bake(&cube(40e-3)?, &options)?;
    /// # let peg = PointShell::bake(&cube(10e-3)?, &options)?;
    /// # let query = ContactQuery::new(&block, &peg, 1000.0)?;
    /// # let deep = Pose::from_translation(DVec3::Z * 24.5e-3);
    /// let error_m = query.error_m().unwrap();
    /// assert!(error_m < 0.5e-3, "less than half a voxel");
    /// assert!((query.wrench(deep)?.penetration_m - 0.5e-3).abs() < error_m);
    /// # Ok::<(), vps::Error>(())
    /// ```
    pub fn error_m(&self) -> Option<f64> {
        let known = |way: &Way| way.error_m.filter(|_| way.law.field == FieldKind::Trilinear);
        self.ways.iter().map(known).reduce(|one, other| Some(one?.max(other?)))?
    }

    fn of_ways(ways: Vec<Way>) -> Self {
        let query = Self { ways, spare: Mutex::new(Vec::with_capacity(64)) };
        query.with_traversals(|_| ());
        query
    }

    /// Wrench, penetration and clearance at a pose of the shell's mesh frame in the world, which is
    /// the voxmap's mesh frame where there is one. Allocates nothing; see [threads](#threads).
    ///
    /// # Examples
    /// ```
    /// # use vps::{ContactQuery, DVec3, Mesh, Options, PointShell, Pose, Shape, Voxmap};
    /// # let options = Options::new(1e-3);
    /// # let cube = |edge_m| Mesh::from_shape(&Shape::Box { size_m: DVec3::splat(edge_m) }, 1e-5);
    /// # let block = Voxmap::bake(&cube(40e-3)?, &options)?;
    /// # let peg = PointShell::bake(&cube(10e-3)?, &options)?;
    /// # let query = ContactQuery::new(&block, &peg, 1000.0)?;
    /// // The peg stands 10 mm beside the block's origin. The torque is about the peg's: none.
    /// let felt = query.wrench(Pose::from_translation(DVec3::new(10e-3, 0.0, 24.5e-3)))?.wrench;
    /// assert!((felt.force.z - 50.0).abs() < 0.1 && felt.torque.length() < 1e-6);
    /// assert!(query.wrench(Pose::from_translation(DVec3::NAN)).is_err());
    /// # Ok::<(), vps::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::Pose`].
    pub fn wrench(&self, world_from_shell: Pose) -> Result<ContactWrench, Error> {
        check_pose(0, world_from_shell)?;
        Ok(self.with_traversals(|traversals| self.felt(traversals, world_from_shell)))
    }

    /// The same; `each` gets every contact, part after part in the order of the points.
    ///
    /// # Examples
    /// ```
    /// # use vps::{ContactQuery, DVec3, Mesh, Options, PointShell, Pose, Shape, Voxmap};
    /// # let options = Options::new(1e-3);
    /// # let cube = |edge_m| Mesh::from_shape(&Shape::Box { size_m: DVec3::splat(edge_m) }, 1e-5);
    /// # let block = Voxmap::bake(&cube(40e-3)?, &options)?;
    /// # let peg = PointShell::bake(&cube(10e-3)?, &options)?;
    /// # let query = ContactQuery::new(&block, &peg, 1000.0)?;
    /// # let deep = Pose::from_translation(DVec3::Z * 24.5e-3);
    /// let mut force = DVec3::ZERO;
    /// let felt = query.contacts(deep, |point| {
    ///     assert!(point.position_m.z < 20.001e-3 && point.gradient.z > 0.99);
    ///     force += point.force_n;
    /// })?;
    /// assert!((force - felt.wrench.force).length() < 1e-3);
    /// # Ok::<(), vps::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::Pose`].
    pub fn contacts(
        &self,
        world_from_shell: Pose,
        mut each: impl FnMut(&ContactPoint),
    ) -> Result<ContactWrench, Error> {
        check_pose(0, world_from_shell)?;
        Ok(self.with_traversals(|traversals| {
            let found = self
                .each(traversals)
                .map(|(way, traversal)| way.contacts(traversal, world_from_shell, &mut each));
            found.reduce(ContactWrench::and).unwrap_or_default()
        }))
    }

    /// `[n]`: [`Self::wrench`] of each pose, on the current rayon pool; the same bits as one by
    /// one, for any number of threads.
    ///
    /// # Examples
    /// ```
    /// # use vps::{ContactQuery, DVec3, Mesh, Options, PointShell, Pose, Shape, Voxmap};
    /// # let options = Options::new(1e-3);
    /// # let cube = |edge_m| Mesh::from_shape(&Shape::Box { size_m: DVec3::splat(edge_m) }, 1e-5);
    /// # let block = Voxmap::bake(&cube(40e-3)?, &options)?;
    /// # let peg = PointShell::bake(&cube(10e-3)?, &options)?;
    /// # let query = ContactQuery::new(&block, &peg, 1000.0)?;
    /// let poses = [26e-3, 25e-3, 24.5e-3].map(|z| Pose::from_translation(DVec3::Z * z));
    /// let felt = query.wrenches(&poses)?;
    /// assert_eq!(felt[0].contacts, 0);
    /// assert_eq!(felt[2], query.wrench(poses[2])?, "the same bits");
    /// # Ok::<(), vps::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::Pose`] of the first pose that is none.
    pub fn wrenches(&self, world_from_shell: &[Pose]) -> Result<Vec<ContactWrench>, Error> {
        world_from_shell
            .iter()
            .enumerate()
            .try_for_each(|(index, pose)| check_pose(index, *pose))?;
        Ok(parallel::map_chunks(world_from_shell, POSES_PER_TASK, |poses| {
            self.with_traversals(|traversals| {
                poses.iter().map(|pose| self.felt(traversals, *pose)).collect::<Vec<_>>()
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
    /// # Examples
    /// ```
    /// # use vps::{ContactQuery, DVec3, Mesh, Options, PointShell, Pose, Shape, Voxmap};
    /// # let options = Options::new(1e-3);
    /// # let cube = |edge_m| Mesh::from_shape(&Shape::Box { size_m: DVec3::splat(edge_m) }, 1e-5);
    /// # let block = Voxmap::bake(&cube(40e-3)?, &options)?;
    /// # let peg = PointShell::bake(&cube(10e-3)?, &options)?;
    /// # let query = ContactQuery::new(&block, &peg, 1000.0)?;
    /// # let deep = Pose::from_translation(DVec3::Z * 24.5e-3);
    /// let stiffness = query.stiffness(deep)?;
    /// // The force of the face grows by 1000 N/m for each of its 100 squares of a millimetre.
    /// assert!((stiffness[2][2] - 100e3).abs() < 1.0);
    /// assert!(stiffness[0][0].abs() < 1.0, "it slides freely");
    /// # Ok::<(), vps::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::Pose`].
    pub fn stiffness(&self, world_from_shell: Pose) -> Result<[[f64; 6]; 6], Error> {
        check_pose(0, world_from_shell)?;
        Ok(self.with_traversals(|traversals| {
            let found = self
                .each(traversals)
                .map(|(way, traversal)| way.stiffness(traversal, world_from_shell));
            found.reduce(|one, other| one.plus_scaled(1.0, &other)).unwrap_or(Mat6::ZERO).0
        }))
    }

    /// The point of the shell that is nearest to a part, and the place there. `None` where
    /// something touches, of which [`Self::contacts`] says where, and beyond the least band less a
    /// voxel. Allocates nothing; costs as [`Self::wrench`].
    ///
    /// # Examples
    /// ```
    /// # use vps::{ContactQuery, DVec3, Mesh, Options, PointShell, Pose, Shape, Voxmap};
    /// # let options = Options::new(1e-3);
    /// # let cube = |edge_m| Mesh::from_shape(&Shape::Box { size_m: DVec3::splat(edge_m) }, 1e-5);
    /// # let block = Voxmap::bake(&cube(40e-3)?, &options)?;
    /// # let peg = PointShell::bake(&cube(10e-3)?, &options)?;
    /// # let query = ContactQuery::new(&block, &peg, 1000.0)?;
    /// let above = query.nearest(Pose::from_translation(DVec3::Z * 27e-3))?.unwrap();
    /// assert!((above.distance_m - 2e-3).abs() < 0.001e-3);
    /// assert!((above.on_shell_m.z - 22e-3).abs() < 0.001e-3);
    /// assert!((above.on_part_m.z - 20e-3).abs() < 0.001e-3);
    /// assert_eq!(query.nearest(Pose::from_translation(DVec3::Z))?, None, "beyond the band");
    /// # Ok::<(), vps::Error>(())
    /// ```
    ///
    /// # Errors
    /// [`Error::Pose`].
    pub fn nearest(&self, world_from_shell: Pose) -> Result<Option<NearestPoint>, Error> {
        check_pose(0, world_from_shell)?;
        Ok(self.with_traversals(|traversals| {
            let mut nearest = None;
            for (way, traversal) in self.each(traversals) {
                let highest = way.highest(traversal, world_from_shell)?;
                if nearest
                    .is_none_or(|(_, nearest): (_, Highest)| highest.value_m > nearest.value_m)
                {
                    nearest = Some((way, highest));
                }
            }
            let (way, highest) = nearest?;
            way.nearest(highest, world_from_shell)
        }))
    }

    /// What touches, in few words: contacts with one part whose gradients are within 20° are one
    /// patch, the hardest first. Their forces add up to that of the pose but for rounding. Probes,
    /// which have no surface, are in no patch. Allocates; costs as [`Self::contacts`].
    ///
    /// # Examples
    /// ```
    /// # use vps::{ContactQuery, DVec3, Mesh, Options, PointShell, Pose, Shape, Voxmap};
    /// # let options = Options::new(1e-3);
    /// # let cube = |edge_m| Mesh::from_shape(&Shape::Box { size_m: DVec3::splat(edge_m) }, 1e-5);
    /// # let block = Voxmap::bake(&cube(40e-3)?, &options)?;
    /// # let peg = PointShell::bake(&cube(10e-3)?, &options)?;
    /// # // The peg's lower and left face are half a millimetre deep in a floor and a wall.
    /// # let wall = Pose::from_translation(DVec3::new(-24.5e-3, 0.0, 24.5e-3));
    /// # let parts = [(&block, Pose::IDENTITY), (&block, wall)];
    /// // A floor, part 0, and a wall, part 1: the peg is half a millimetre deep in both.
    /// let query = ContactQuery::of_parts(&parts, &peg, 1000.0)?;
    /// let mut patches = query.patches(Pose::from_translation(DVec3::Z * 24.5e-3))?;
    /// patches.sort_by_key(|patch| patch.part);
    /// assert_eq!(patches.len(), 2);
    /// assert!(patches[0].normal.z > 0.99 && patches[1].normal.x > 0.99);
    /// assert!((patches[0].depth_m - 0.5e-3).abs() < 0.001e-3);
    /// # Ok::<(), vps::Error>(())
    /// ```
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
    /// Conservative advancement: it goes as far as nothing can touch, at least by the tolerance,
    /// and asks again. Parts may be thin: only contact that ends again within a way of the
    /// tolerance may be missed. Cost: a query for each step; few in the open, and close along a
    /// part no more than the way over the tolerance. Allocates nothing.
    ///
    /// # Examples
    /// ```
    /// # use vps::{ContactQuery, DVec3, Mesh, Options, PointShell, Pose, Shape, Voxmap};
    /// # let options = Options::new(1e-3);
    /// # let cube = |edge_m| Mesh::from_shape(&Shape::Box { size_m: DVec3::splat(edge_m) }, 1e-5);
    /// # let block = Voxmap::bake(&cube(40e-3)?, &options)?;
    /// # let peg = PointShell::bake(&cube(10e-3)?, &options)?;
    /// # let ball = Mesh::from_shape(&Shape::Sphere { radius_m: 5e-3 }, 1e-5)?;
    /// # let query = ContactQuery::new(&block, &PointShell::bake(&ball, &options)?, 1000.0)?;
    /// // A ball of radius 5 mm falls onto the top of the block, which is at 20 mm.
    /// let [from, to] = [40e-3, 20e-3].map(|z| Pose::from_translation(DVec3::Z * z));
    /// let impact = query.first_contact(from, to, 1e-6)?.unwrap();
    /// assert!((impact.share - 0.75).abs() < 0.002);
    /// assert!((impact.pose.translation.z - 25e-3).abs() < 0.05e-3);
    /// assert_eq!(query.first_contact(from, from, 1e-6)?, None);
    /// # Ok::<(), vps::Error>(())
    /// ```
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

    /// The same; `watch` gets the share of the motion that is clear before each step, and can end
    /// the search.
    ///
    /// # Examples
    /// ```
    /// # use std::ops::ControlFlow;
    /// # use vps::{ContactQuery, DVec3, Error, Mesh, Options, PointShell, Pose, Shape, Voxmap};
    /// # let options = Options::new(1e-3);
    /// # let cube = |edge_m| Mesh::from_shape(&Shape::Box { size_m: DVec3::splat(edge_m) }, 1e-5);
    /// # let block = Voxmap::bake(&cube(40e-3)?, &options)?;
    /// # let peg = PointShell::bake(&cube(10e-3)?, &options)?;
    /// # let query = ContactQuery::new(&block, &peg, 1000.0)?;
    /// # let [from, to] = [40e-3, 20e-3].map(|z| Pose::from_translation(DVec3::Z * z));
    /// let mut clear = Vec::new();
    /// query.first_contact_with(from, to, 1e-6, |share| {
    ///     clear.push(share);
    ///     ControlFlow::Continue(())
    /// })?;
    /// // It touches at 25 mm.
    /// assert!(clear.is_sorted() && clear.iter().all(|share| *share <= 0.75));
    /// let ended = query.first_contact_with(from, to, 1e-6, |_| ControlFlow::Break(()));
    /// assert!(matches!(ended, Err(Error::Cancelled)));
    /// # Ok::<(), vps::Error>(())
    /// ```
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
        let Some(Way { shell, .. }) = self.ways.first() else { return Ok(None) };
        let shell_from_body = Pose::from_translation(shell.mass_properties().center_m);
        let [begin, end] = [from, to].map(|pose| {
            let body = pose * shell_from_body;
            Pose { rotation: body.rotation.normalize(), ..body }
        });
        let body_from_shell = begin.inverse() * from;
        let centers = [begin.translation, end.translation];
        let turn = begin.rotation_to(end).length();
        self.with_traversals(|traversals| {
            let mut share = 0.0;
            loop {
                let body = Pose::new(
                    begin.rotation.slerp(end.rotation, share),
                    begin.translation.lerp(end.translation, share),
                );
                let pose = body * body_from_shell;
                let mut step = 1.0_f64;
                for (way, traversal) in self.each(traversals) {
                    let Some(free_way_m) = way.free_way_m(traversal, pose) else {
                        return Ok(Some(Impact { share, pose }));
                    };
                    let way_m = way.farthest_m(centers, turn);
                    let least = (tolerance_m / way_m.max(f64::MIN_POSITIVE)).max(f64::EPSILON);
                    step = step.min((free_way_m / way_m).max(least));
                }
                if share >= 1.0 {
                    return Ok(None);
                }
                if watch(share).is_break() {
                    return Err(Error::Cancelled);
                }
                share = (share + step).min(1.0);
            }
        })
    }

    fn each<'a>(
        &'a self,
        traversals: &'a mut [Traversal],
    ) -> impl Iterator<Item = (&'a Way, &'a mut Traversal)> {
        self.ways.iter().zip(traversals)
    }

    fn felt(&self, traversals: &mut [Traversal], pose: Pose) -> ContactWrench {
        let found = self.each(traversals).map(|(way, traversal)| way.felt(traversal, pose, None));
        found.reduce(ContactWrench::and).unwrap_or_default()
    }

    fn with_traversals<T>(&self, ask: impl FnOnce(&mut [Traversal]) -> T) -> T {
        let spare = || self.spare.lock().unwrap_or_else(PoisonError::into_inner);
        let taken = spare().pop();
        let mut traversals =
            taken.unwrap_or_else(|| self.ways.iter().map(Way::traversal).collect());
        let answer = ask(&mut traversals);
        spare().push(traversals);
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
