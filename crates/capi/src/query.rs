//! Queries.

use std::mem::MaybeUninit;

use vps::{
    ContactPatch, ContactPoint, ContactQuery, ContactWrench, DQuat, DVec3, Impact, NearestPoint,
    Pose,
};

use crate::baked::{vps_shell, vps_voxmap};
use crate::border::{call, free, given, given_mut, make, place, places, slice, vps_status};

/// Asks what wrench voxmaps exert on a shell. Any number of threads may ask one query at a time.
pub struct vps_query(ContactQuery);

/// Where a mesh frame is in another: the shell's in the *world*, which is the voxmap's mesh frame, or
/// of a query of several parts the frame in which these stand.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct vps_pose {
    /// m.
    pub position_m: [f64; 3],
    /// Unit quaternion x, y, z, w.
    pub rotation_xyzw: [f64; 4],
}

impl From<Pose> for vps_pose {
    fn from(pose: Pose) -> Self {
        Self { position_m: pose.translation.to_array(), rotation_xyzw: pose.rotation.to_array() }
    }
}

impl From<&vps_pose> for Pose {
    fn from(pose: &vps_pose) -> Self {
        Self::new(DQuat::from_array(pose.rotation_xyzw), DVec3::from_array(pose.position_m))
    }
}

/// What a shell feels at one pose; vectors in axes of the world.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct vps_wrench {
    /// Force on the shell, N.
    pub force_n: [f64; 3],
    /// Torque about the origin of the shell's mesh frame, N m.
    pub torque_nm: [f64; 3],
    /// Depth of the deepest contact, m; 0 without one.
    pub penetration_m: f64,
    /// Distance of the nearest point, m; 0 in contact, and never more than the least band of the
    /// voxmaps.
    pub clearance_m: f64,
    /// Number of points in contact.
    pub n_contacts: usize,
}

impl From<ContactWrench> for vps_wrench {
    fn from(felt: ContactWrench) -> Self {
        Self {
            force_n: felt.wrench.force.to_array(),
            torque_nm: felt.wrench.torque.to_array(),
            penetration_m: felt.penetration_m,
            clearance_m: felt.clearance_m,
            n_contacts: felt.contacts as usize,
        }
    }
}

/// One point in contact; vectors in axes of the world.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct vps_contact {
    /// Where its force acts, m.
    pub position_m: [f64; 3],
    /// Unit direction that pushes the shell out: its own surface's normal, inward.
    pub normal: [f64; 3],
    /// Unit gradient of the voxmap's distance there, the quickest way out: a motion of the contact
    /// by v changes its depth by -v . gradient, that of a facet whose middle is outside by less.
    /// Beyond the band it may be zero.
    pub gradient: [f64; 3],
    /// Force of this contact on the shell, N; 0 of probes on edges and corners.
    pub force_n: [f64; 3],
    /// m, greater than 0: of the point, or in the mean over a facet whose middle is outside.
    pub depth_m: f64,
    /// Surface that it stands for, m²; 0 of probes.
    pub area_m2: f64,
    /// Number of the voxmap.
    pub part: usize,
    /// Number of the point in the shell.
    pub point: usize,
}

impl From<&ContactPoint> for vps_contact {
    fn from(contact: &ContactPoint) -> Self {
        Self {
            position_m: contact.position_m.to_array(),
            normal: contact.normal.to_array(),
            gradient: contact.gradient.to_array(),
            force_n: contact.force_n.to_array(),
            depth_m: contact.depth_m,
            area_m2: contact.area_m2,
            part: contact.part as usize,
            point: contact.point as usize,
        }
    }
}

/// Prepares queries, which share the memory of both parts: these may be freed. stiffness_n_per_m is
/// that of one point, which stands for a square of the shell's voxel edge s: a face of area A at
/// depth d pushes with stiffness d A / s².
#[unsafe(no_mangle)]
pub extern "C" fn vps_query_new(
    voxmap: Option<&vps_voxmap>,
    shell: Option<&vps_shell>,
    stiffness_n_per_m: f64,
    out: Option<&mut MaybeUninit<*mut vps_query>>,
) -> vps_status {
    make(out, || {
        let voxmap = &given("voxmap", voxmap)?.voxmap;
        let shell = &given("shell", shell)?.shell;
        Ok(vps_query(ContactQuery::new(voxmap, shell, stiffness_n_per_m)?))
    })
}

/// The same of `n` voxmaps that stand in one world, each with the pose of its mesh frame there. Poses
/// of the shell are then those in the world.
///
/// # Safety
/// There are `n` voxmaps and poses.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vps_query_new_of_parts(
    voxmaps: *const Option<&vps_voxmap>,
    poses: *const vps_pose,
    n: usize,
    shell: Option<&vps_shell>,
    stiffness_n_per_m: f64,
    out: Option<&mut MaybeUninit<*mut vps_query>>,
) -> vps_status {
    make(out, || {
        // SAFETY: as the caller promises.
        let (voxmaps, poses) =
            unsafe { (slice("voxmaps", voxmaps, n)?, slice("poses", poses, n)?) };
        let mut parts = Vec::with_capacity(n);
        for (voxmap, pose) in voxmaps.iter().zip(poses) {
            parts.push((&given("an element of voxmaps", *voxmap)?.voxmap, pose.into()));
        }
        let shell = &given("shell", shell)?.shell;
        Ok(vps_query(ContactQuery::of_parts(&parts, shell, stiffness_n_per_m)?))
    })
}

/// The same of two parts that each have both, the one that stands still and the one that moves:
/// half of the energy of the moving shell's points in the voxmap, and half of that of own_shell's
/// points in own_voxmap. voxmap and own_shell are of the part that stands still, own_voxmap and
/// shell of the one that moves. stiffness_n_per_m counts for a square of the moving shell's voxel
/// edge, and by area for the other one. Contacts of own_shell's points have the part 1.
#[unsafe(no_mangle)]
pub extern "C" fn vps_query_new_both_ways(
    voxmap: Option<&vps_voxmap>,
    own_shell: Option<&vps_shell>,
    own_voxmap: Option<&vps_voxmap>,
    shell: Option<&vps_shell>,
    stiffness_n_per_m: f64,
    out: Option<&mut MaybeUninit<*mut vps_query>>,
) -> vps_status {
    make(out, || {
        let fixed = (&given("voxmap", voxmap)?.voxmap, &given("own_shell", own_shell)?.shell);
        let moving = (&given("own_voxmap", own_voxmap)?.voxmap, &given("shell", shell)?.shell);
        Ok(vps_query(ContactQuery::both_ways(fixed, moving, stiffness_n_per_m)?))
    })
}

/// Has a query find depths by a vps_field, before threads share it; voxmaps have to be baked for
/// VPS_FIELD_SURFACE_POINT. With shells of the same vps_points the force is that of a scene.
#[unsafe(no_mangle)]
pub extern "C" fn vps_query_set_field(query: Option<&mut vps_query>, field: u32) -> vps_status {
    call(|| {
        let field = crate::baked::field("field", field)?;
        Ok(given_mut("query", query)?.0.set_field(field)?)
    })
}

/// How far answers may be off, m: in at least 95 of 100 poses the penetration by no more than this,
/// and the force by no more than this over the penetration as a share of it, at most all. NaN where
/// that is not known: of skins, other fields than VPS_FIELD_TRILINEAR, other points than
/// VPS_POINTS_FACETS.
#[unsafe(no_mangle)]
pub extern "C" fn vps_query_error_m(
    query: Option<&vps_query>,
    out: Option<&mut MaybeUninit<f64>>,
) -> vps_status {
    call(|| {
        let error_m = given("query", query)?.0.error_m();
        place("out", out)?.write(error_m.unwrap_or(f64::NAN));
        Ok(())
    })
}

/// Wrench, penetration and clearance at a pose: the same bits on every thread. Allocates only where
/// more threads ask at a time than ever before.
#[unsafe(no_mangle)]
pub extern "C" fn vps_query_wrench(
    query: Option<&vps_query>,
    pose: Option<&vps_pose>,
    out: Option<&mut MaybeUninit<vps_wrench>>,
) -> vps_status {
    call(|| {
        place("out", out)?
            .write(given("query", query)?.0.wrench(given("pose", pose)?.into())?.into());
        Ok(())
    })
}

/// The same, and the contacts part by part in the order of the points: at most `capacity` of them;
/// out->n_contacts says how many there are. Allocates as vps_query_wrench.
///
/// # Safety
/// There is room for `capacity` contacts.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vps_query_contacts(
    query: Option<&vps_query>,
    pose: Option<&vps_pose>,
    contacts: *mut vps_contact,
    capacity: usize,
    out: Option<&mut MaybeUninit<vps_wrench>>,
) -> vps_status {
    call(|| {
        // SAFETY: as the caller promises.
        let mut room = unsafe { places("contacts", contacts, capacity) }?.iter_mut();
        let felt = given("query", query)?.0.contacts(given("pose", pose)?.into(), |contact| {
            if let Some(place) = room.next() {
                place.write(contact.into());
            }
        })?;
        place("out", out)?.write(felt.into());
        Ok(())
    })
}

/// How stiff a contact is: the second derivative of its energy by x, translations (m) and a
/// rotation vector (rad) about the origin of the shell's mesh frame, world axes.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct vps_stiffness {
    /// Symmetric: -d force/dx, N/m and N, and -d torque/dx, N and N m, whose part by turns is taken
    /// symmetric.
    pub rows: [[f64; 6]; 6],
}

/// Stiffness at a pose; not always positive: convex contact pivots away. Allocates as
/// vps_query_wrench.
#[unsafe(no_mangle)]
pub extern "C" fn vps_query_stiffness(
    query: Option<&vps_query>,
    pose: Option<&vps_pose>,
    out: Option<&mut MaybeUninit<vps_stiffness>>,
) -> vps_status {
    call(|| {
        let rows = given("query", query)?.0.stiffness(given("pose", pose)?.into())?;
        place("out", out)?.write(vps_stiffness { rows });
        Ok(())
    })
}

/// The point of a shell that is nearest to a part while nothing touches; world frame.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct vps_nearest {
    /// False where something touches, and beyond the least band less a voxel: all else is then 0.
    pub is_known: bool,
    /// Number of the voxmap.
    pub part: usize,
    /// Number of the point in the shell.
    pub point: usize,
    /// The point, m.
    pub on_shell_m: [f64; 3],
    /// The place on the surface of the part that is nearest to it, m: by interpolated distances.
    pub on_part_m: [f64; 3],
    /// The clearance, m.
    pub distance_m: f64,
}

/// The nearest point at a pose. Allocates as vps_query_wrench.
#[unsafe(no_mangle)]
pub extern "C" fn vps_query_nearest(
    query: Option<&vps_query>,
    pose: Option<&vps_pose>,
    out: Option<&mut MaybeUninit<vps_nearest>>,
) -> vps_status {
    call(|| {
        let found = given("query", query)?.0.nearest(given("pose", pose)?.into())?;
        let NearestPoint { part, point, on_shell_m, on_part_m, distance_m } =
            found.unwrap_or_default();
        place("out", out)?.write(vps_nearest {
            is_known: found.is_some(),
            part: part as usize,
            point: point as usize,
            on_shell_m: on_shell_m.to_array(),
            on_part_m: on_part_m.to_array(),
            distance_m,
        });
        Ok(())
    })
}

/// Contacts with one part whose gradients are within 20°; world frame.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct vps_patch {
    /// Mean unit gradient of the distance, by force: the quickest way out.
    pub normal: [f64; 3],
    /// Force on the shell, N.
    pub force_n: [f64; 3],
    /// Mean place of the forces, by their size, m.
    pub position_m: [f64; 3],
    /// Surface of the facets that touch, be it in part, m².
    pub area_m2: f64,
    /// Of the deepest, m.
    pub depth_m: f64,
    /// Number of the voxmap.
    pub part: usize,
    /// How many.
    pub n_contacts: usize,
}

impl From<ContactPatch> for vps_patch {
    fn from(patch: ContactPatch) -> Self {
        Self {
            normal: patch.normal.to_array(),
            force_n: patch.force_n.to_array(),
            position_m: patch.position_m.to_array(),
            area_m2: patch.area_m2,
            depth_m: patch.depth_m,
            part: patch.part as usize,
            n_contacts: patch.contacts as usize,
        }
    }
}

/// Patches at a pose, the hardest first: at most `capacity` of them; *n says how many there are.
/// Allocates.
///
/// # Safety
/// There is room for `capacity` patches.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vps_query_patches(
    query: Option<&vps_query>,
    pose: Option<&vps_pose>,
    patches: *mut vps_patch,
    capacity: usize,
    n: Option<&mut MaybeUninit<usize>>,
) -> vps_status {
    call(|| {
        // SAFETY: as the caller promises.
        let room = unsafe { places("patches", patches, capacity) }?;
        let found = given("query", query)?.0.patches(given("pose", pose)?.into())?;
        place("n", n)?.write(found.len());
        for (place, patch) in room.iter_mut().zip(found) {
            place.write(patch.into());
        }
        Ok(())
    })
}

/// Where a motion first touches.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct vps_impact {
    /// False where it does not.
    pub touches: bool,
    /// Share of the motion, 0 to 1; 1 where it does not touch.
    pub share: f64,
    /// Pose there: it touches, and a motion by the tolerance before it did not, where it does not
    /// begin in contact. The end of a motion that does not touch.
    pub pose: vps_pose,
}

/// Where a motion first touches on which the shell's centre of mass goes straight and its rotation
/// turns about one axis, both evenly. Parts may be thin: only contact that ends again within a way of
/// tolerance_m may be missed. Allocates as vps_query_wrench.
#[unsafe(no_mangle)]
pub extern "C" fn vps_query_first_contact(
    query: Option<&vps_query>,
    from: Option<&vps_pose>,
    to: Option<&vps_pose>,
    tolerance_m: f64,
    out: Option<&mut MaybeUninit<vps_impact>>,
) -> vps_status {
    call(|| {
        let from: Pose = given("from", from)?.into();
        let to: Pose = given("to", to)?.into();
        let found = given("query", query)?.0.first_contact(from, to, tolerance_m)?;
        let Impact { share, pose } = found.unwrap_or(Impact { share: 1.0, pose: to });
        place("out", out)?.write(vps_impact { touches: found.is_some(), share, pose: pose.into() });
        Ok(())
    })
}

/// The wrenches of n poses, on all processors: the same bits as one by one. Where a pose is none,
/// nothing is written.
///
/// # Safety
/// There are `n` poses, and room for as many wrenches.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vps_query_wrenches(
    query: Option<&vps_query>,
    poses: *const vps_pose,
    n: usize,
    out: *mut vps_wrench,
) -> vps_status {
    call(|| {
        // SAFETY: as the caller promises.
        let (poses, out) = unsafe { (slice("poses", poses, n)?, places("out", out, n)?) };
        let poses: Vec<Pose> = poses.iter().map(Pose::from).collect();
        for (place, felt) in out.iter_mut().zip(given("query", query)?.0.wrenches(&poses)?) {
            place.write(felt.into());
        }
        Ok(())
    })
}

/// Frees a query.
///
/// # Safety
/// Null, or a query that nothing uses any more.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn vps_query_free(query: *mut vps_query) {
    // SAFETY: as the caller promises.
    unsafe { free(query) }
}
