//! Queries.

use std::mem::MaybeUninit;

use vps::{ContactPoint, ContactQuery, ContactWrench, DQuat, DVec3, Pose};

use crate::baked::{vps_shell, vps_voxmap};
use crate::border::{call, free, given, make, place, places, slice, vps_status};

/// Asks what wrench a voxmap exerts on a shell. Any number of threads may ask one query at a time.
pub struct vps_query(ContactQuery);

/// Where the shell's mesh frame is in the voxmap's mesh frame.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct vps_pose {
    /// m.
    pub position_m: [f64; 3],
    /// Unit quaternion x, y, z, w.
    pub rotation_xyzw: [f64; 4],
}

impl From<&vps_pose> for Pose {
    fn from(pose: &vps_pose) -> Self {
        Self::new(DQuat::from_array(pose.rotation_xyzw), DVec3::from_array(pose.position_m))
    }
}

/// What a shell feels at one pose; vectors in axes of the voxmap's mesh frame.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct vps_wrench {
    /// Force on the shell, N.
    pub force_n: [f64; 3],
    /// Torque about the origin of the shell's mesh frame, N m.
    pub torque_nm: [f64; 3],
    /// Depth of the deepest point, m; 0 without contact.
    pub penetration_m: f64,
    /// Distance of the nearest point, m; 0 in contact, and never more than the band of the voxmap.
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

/// One point in contact; vectors in axes of the voxmap's mesh frame.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct vps_contact {
    /// Where its force acts, m, in the voxmap's mesh frame.
    pub position_m: [f64; 3],
    /// Unit direction that pushes the shell out: its own surface's normal, inward.
    pub normal: [f64; 3],
    /// Unit gradient of the voxmap's distance there, the quickest way out: a motion of the contact
    /// by v changes its depth by -v . gradient. Beyond the band it may be zero.
    pub gradient: [f64; 3],
    /// Force of this contact on the shell, N; 0 of probes on edges and corners.
    pub force_n: [f64; 3],
    /// m, greater than 0.
    pub depth_m: f64,
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

/// The same, and the contacts in the order of the points: at most `capacity` of them;
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
/// rotation vector (rad) about the origin of the shell's mesh frame, axes of the voxmap's.
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
