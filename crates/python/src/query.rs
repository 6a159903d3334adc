//! Wrenches and contacts as structured arrays.

use core::ops::ControlFlow;
use std::time::Instant;

use bytemuck::{Pod, Zeroable};
use glam::{DQuat, DVec3};
use pyo3::PyTypeInfo;
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use vps::{ContactPatch, ContactPoint, ContactWrench, FieldKind, NearestPoint};

use crate::arrays;
use crate::errors::{InvalidInput, raise};
use crate::parts::{PointShell, Voxmap, named};
use crate::pool::{self, SIGNALS_EVERY};

/// An item of `WRENCH_DTYPE`.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct WrenchRecord {
    force_n: [f64; 3],
    torque_nm: [f64; 3],
    penetration_m: f64,
    clearance_m: f64,
    contacts: i64,
}

/// An item of `CONTACT_DTYPE`.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct ContactRecord {
    position_m: [f64; 3],
    normal: [f64; 3],
    gradient: [f64; 3],
    force_n: [f64; 3],
    depth_m: f64,
    area_m2: f64,
    part: i64,
    point: i64,
}

/// An item of `PATCH_DTYPE`.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct PatchRecord {
    normal: [f64; 3],
    force_n: [f64; 3],
    position_m: [f64; 3],
    area_m2: f64,
    depth_m: f64,
    part: i64,
    contacts: i64,
}

/// The item of `NEAREST_DTYPE`.
#[derive(Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct NearestRecord {
    on_shell_m: [f64; 3],
    on_part_m: [f64; 3],
    distance_m: f64,
    part: i64,
    point: i64,
}

/// A voxmap and the pose of its mesh frame in the world.
type Part = (Py<Voxmap>, vps::Pose);
type Column = (&'static str, &'static str, usize);

/// Columns of a structured array: names, NumPy's kinds, and how many of each.
pub(crate) struct Columns<const N: usize> {
    columns: [Column; N],
    dtype: PyOnceLock<Py<PyAny>>,
}

impl<const N: usize> Columns<N> {
    const fn new(columns: [Column; N]) -> Self {
        Self { columns, dtype: PyOnceLock::new() }
    }

    pub(crate) fn dtype<'py>(&self, py: Python<'py>) -> PyResult<&Bound<'py, PyAny>> {
        let make = || -> PyResult<Py<PyAny>> {
            let column = |(name, kind, n): &Column| -> PyResult<Bound<'py, PyAny>> {
                Ok(if *n == 1 {
                    (*name, *kind).into_pyobject(py)?.into_any()
                } else {
                    (*name, *kind, *n).into_pyobject(py)?.into_any()
                })
            };
            let columns: Vec<_> = self.columns.iter().map(column).collect::<PyResult<_>>()?;
            Ok(PyModule::import(py, "numpy")?.getattr("dtype")?.call1((columns,))?.unbind())
        };
        Ok(self.dtype.get_or_try_init(py, make)?.bind(py))
    }
}

/// Of what `ContactQuery.wrench` returns.
pub(crate) static WRENCH: Columns<5> = Columns::new([
    ("force_n", "=f8", 3),
    ("torque_nm", "=f8", 3),
    ("penetration_m", "=f8", 1),
    ("clearance_m", "=f8", 1),
    ("contacts", "=i8", 1),
]);
/// Of what `ContactQuery.contacts` returns.
pub(crate) static CONTACT: Columns<8> = Columns::new([
    ("position_m", "=f8", 3),
    ("normal", "=f8", 3),
    ("gradient", "=f8", 3),
    ("force_n", "=f8", 3),
    ("depth_m", "=f8", 1),
    ("area_m2", "=f8", 1),
    ("part", "=i8", 1),
    ("point", "=i8", 1),
]);
/// Of what `ContactQuery.patches` returns.
pub(crate) static PATCH: Columns<7> = Columns::new([
    ("normal", "=f8", 3),
    ("force_n", "=f8", 3),
    ("position_m", "=f8", 3),
    ("area_m2", "=f8", 1),
    ("depth_m", "=f8", 1),
    ("part", "=i8", 1),
    ("contacts", "=i8", 1),
]);
/// Of what `ContactQuery.nearest` returns.
pub(crate) static NEAREST: Columns<5> = Columns::new([
    ("on_shell_m", "=f8", 3),
    ("on_part_m", "=f8", 3),
    ("distance_m", "=f8", 1),
    ("part", "=i8", 1),
    ("point", "=i8", 1),
]);

impl From<ContactWrench> for WrenchRecord {
    fn from(found: ContactWrench) -> Self {
        Self {
            force_n: found.wrench.force.to_array(),
            torque_nm: found.wrench.torque.to_array(),
            penetration_m: found.penetration_m,
            clearance_m: found.clearance_m,
            contacts: found.contacts.into(),
        }
    }
}

impl From<&ContactPoint> for ContactRecord {
    fn from(contact: &ContactPoint) -> Self {
        Self {
            position_m: contact.position_m.to_array(),
            normal: contact.normal.to_array(),
            gradient: contact.gradient.to_array(),
            force_n: contact.force_n.to_array(),
            depth_m: contact.depth_m,
            area_m2: contact.area_m2,
            part: contact.part.into(),
            point: contact.point.into(),
        }
    }
}

impl From<&ContactPatch> for PatchRecord {
    fn from(patch: &ContactPatch) -> Self {
        Self {
            normal: patch.normal.to_array(),
            force_n: patch.force_n.to_array(),
            position_m: patch.position_m.to_array(),
            area_m2: patch.area_m2,
            depth_m: patch.depth_m,
            part: patch.part.into(),
            contacts: patch.contacts.into(),
        }
    }
}

impl From<NearestPoint> for NearestRecord {
    fn from(nearest: NearestPoint) -> Self {
        Self {
            on_shell_m: nearest.on_shell_m.to_array(),
            on_part_m: nearest.on_part_m.to_array(),
            distance_m: nearest.distance_m,
            part: nearest.part.into(),
            point: nearest.point.into(),
        }
    }
}

/// Asks what wrench voxmaps exert on a shell.
///
/// ContactQuery(voxmap, shell, stiffness_n_per_m=1000.0): each point inside pushes with stiffness x
/// depth x weight along its normal; the weight is the area that it stands for in squares of the
/// shell's voxel edge. A face of area A at depth d pushes with about stiffness x d x A / voxel
/// edge². There is no friction, and nothing is remembered: the same pose gives the same bits.
/// `voxmap` may be a sequence of (voxmap, pose): parts that stand in one world; poses of the shell
/// are then those in the world, which else is the voxmap's mesh frame.
/// field: how depths are found, "trilinear", "layers", "octant" or, of voxmaps that are baked for
/// it, "surface-point"; with a shell of the same points the force is that of a scene with these
/// keys. Threads may share a query. Raises InvalidInput: the stiffness is not between 0 and 1e12
/// N/m, there is no voxmap, or one is not baked for this field. Cost: milliseconds; memory is
/// shared with all parts.
///
///     >>> force = 2000 * 0.01**2 * 0.0005 / 0.0005**2  # stiffness x area x depth / voxel edge²
///     >>> bool(abs(ContactQuery(block, cube, 2000).wrench(deep)["force_n"][2] - force) < 0.1)
///     True
#[pyclass(frozen, module = "hapticd_vps")]
pub(crate) struct ContactQuery {
    query: vps::ContactQuery,
    /// Which is how it is pickled.
    made_of: MadeOf,
    stiffness_n_per_m: f64,
    field: String,
}

/// What a query was made of.
enum MadeOf {
    Parts(Vec<Part>, Py<PointShell>),
    BothWays([(Py<Voxmap>, Py<PointShell>); 2]),
}

#[pymethods]
impl ContactQuery {
    #[new]
    #[pyo3(signature = (voxmap, shell, stiffness_n_per_m = 1000.0, field = "trilinear"))]
    fn new(
        py: Python<'_>,
        voxmap: &Bound<'_, PyAny>,
        shell: Py<PointShell>,
        stiffness_n_per_m: f64,
        field: &str,
    ) -> PyResult<Self> {
        let parts = match voxmap.cast::<Voxmap>() {
            Ok(voxmap) => vec![(voxmap.clone().unbind(), vps::Pose::IDENTITY)],
            Err(_) => placed(voxmap)?,
        };
        let points = &shell.get().shell;
        let parts_at: Vec<_> =
            parts.iter().map(|(voxmap, pose)| (&*voxmap.get().voxmap, *pose)).collect();
        let query = py
            .detach(|| vps::ContactQuery::of_parts(&parts_at, points, stiffness_n_per_m))
            .map_err(raise)?;
        Self::with_field(query, MadeOf::Parts(parts, shell), stiffness_n_per_m, field)
    }

    /// A query of two parts that each have both, the one that stands still and the one that moves:
    /// two pairs (voxmap, shell).
    ///
    /// Wrench, stiffness and contacts are those of half the energy of the points of the one in the
    /// other and half of the reverse: neither is preferred, and a needle that slips between the
    /// points of the other part presses with its own. The stiffness counts for a square of the
    /// moving shell's voxel edge, and by area for the other one. Contacts of the points of the part
    /// that stands still have the `part` 1. Raises InvalidInput. Cost: as both queries.
    ///
    ///     >>> block_shell = PointShell.bake(block_mesh, 1e-3)
    ///     >>> cube_map = Voxmap.bake(cube_mesh, 1e-3)
    ///     >>> both = ContactQuery.both_ways((block, block_shell), (cube_map, cube), 2000)
    ///     >>> # 400 N of the cube's points, less of the block's
    ///     >>> force = both.wrench(deep)["force_n"]
    ///     >>> bool(370 < force[2] < 400)
    ///     True
    #[staticmethod]
    #[pyo3(signature = (fixed, moving, stiffness_n_per_m = 1000.0, field = "trilinear"))]
    fn both_ways(
        py: Python<'_>,
        fixed: (Py<Voxmap>, Py<PointShell>),
        moving: (Py<Voxmap>, Py<PointShell>),
        stiffness_n_per_m: f64,
        field: &str,
    ) -> PyResult<Self> {
        let pairs = [fixed, moving];
        let [fixed, moving] =
            pairs.each_ref().map(|(voxmap, shell)| (&*voxmap.get().voxmap, &*shell.get().shell));
        let query = py
            .detach(|| vps::ContactQuery::both_ways(fixed, moving, stiffness_n_per_m))
            .map_err(raise)?;
        Self::with_field(query, MadeOf::BothWays(pairs), stiffness_n_per_m, field)
    }

    /// How far answers may be off, m: in at least 95 of 100 poses `penetration_m` by no more than
    /// this, and the force by no more than this over `penetration_m` as a share of it, at most all.
    /// It adds `surface_error_m` of the voxmap, `unseen_depth_m` of the shell and a tenth of its
    /// voxel edge. None of skins, fields other than "trilinear" and points other than "facets".
    ///
    ///     >>> query.error_m < 2.5e-4  # half a voxel
    ///     True
    #[getter]
    fn error_m(&self) -> Option<f64> {
        self.query.error_m()
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let own = Self::type_object(py);
        let Self { made_of, stiffness_n_per_m, field, .. } = self;
        match made_of {
            MadeOf::Parts(parts, shell) => {
                let parts: Vec<_> = parts
                    .iter()
                    .map(|(voxmap, pose)| (voxmap.clone_ref(py), seven(*pose)))
                    .collect();
                let made_of = (parts, shell.clone_ref(py), *stiffness_n_per_m, field);
                Ok((own, made_of).into_pyobject(py)?.into_any())
            }
            MadeOf::BothWays(pairs) => {
                let [fixed, moving] = pairs
                    .each_ref()
                    .map(|(voxmap, shell)| (voxmap.clone_ref(py), shell.clone_ref(py)));
                let made_of = (fixed, moving, *stiffness_n_per_m, field);
                Ok((own.getattr("both_ways")?, made_of).into_pyobject(py)?.into_any())
            }
        }
    }

    /// Wrenches at poses of the shell's mesh frame in the world: (7,) or (n, 7) of x, y, z (m),
    /// qx, qy, qz, qw (unit), or (4, 4) or (n, 4, 4).
    ///
    /// Returns an array (n,) of `WRENCH_DTYPE`, or one such record of a single pose. On the shell:
    /// `force_n` (3,), N, world axes; `torque_nm` (3,), N m, the same axes,
    /// about the origin of the shell's mesh frame; `penetration_m` of the deepest contact, 0 without
    /// contact; `clearance_m` of the nearest one, 0 in contact, at most the least `band_m`;
    /// `contacts`, the number of points in contact. Raises InvalidInput, naming the first pose that
    /// is none. Cost: about linear in the points of the shell, never in triangles; many poses use
    /// all processors, with the same bits as one by one.
    ///
    ///     >>> felt = query.wrench(deep)
    ///     >>> felt["force_n"].round(1)[2], felt["penetration_m"].round(6)
    ///     (400.0, 0.0005)
    ///     >>> query.wrench([deep, [0, 0, 0.05, 0, 0, 0, 1]])["contacts"][1]
    ///     0
    fn wrench<'py>(
        &self,
        py: Python<'py>,
        poses: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let (poses, is_single) = arrays::poses(poses, 0)?;
        if let (true, [pose]) = (is_single, &poses[..]) {
            let found = py.detach(|| self.query.wrench(*pose)).map_err(raise)?;
            return arrays::array(&[WrenchRecord::from(found)], &[], WRENCH.dtype(py)?)?
                .get_item(());
        }
        let pool = pool::pool(py)?;
        let mut records = Vec::with_capacity(poses.len());
        let mut left = &poses[..];
        let mut n_at_a_time = 1;
        while !left.is_empty() {
            let (part, rest) = left.split_at(left.len().min(n_at_a_time));
            let began = Instant::now();
            let found = py.detach(|| pool.install(|| self.query.wrenches(part)));
            let found = found.map_err(|error| match error {
                vps::Error::Pose { index, what } => {
                    let index = records.len() + index;
                    InvalidInput::new_err(vps::Error::Pose { index, what }.to_string())
                }
                error => raise(error),
            })?;
            records.extend(found.into_iter().map(WrenchRecord::from));
            py.check_signals()?;
            n_at_a_time = match began.elapsed() {
                took if took < SIGNALS_EVERY / 2 => 2 * n_at_a_time,
                took if took > 2 * SIGNALS_EVERY => n_at_a_time.div_ceil(2),
                _ => n_at_a_time,
            };
            left = rest;
        }
        arrays::array(&records, &[records.len()], WRENCH.dtype(py)?)
    }

    /// All contacts at one pose, (7,) or (4, 4) as of `wrench`: an array of `CONTACT_DTYPE`, part
    /// by part in the order of the points of the shell.
    ///
    /// `position_m` (3,), m, and `normal` (3,), unit, the shell's surface normal, inward, which
    /// pushes it out, in the world; `gradient` (3,), unit, of the voxmap's distance,
    /// the quickest way out, beyond the band it may be zero; `force_n` (3,), N, of this contact on
    /// the shell; `depth_m`; `area_m2` that it stands for, 0 of probes; `part`, the number of the
    /// voxmap; `point`, the number of the point. Raises InvalidInput.
    ///
    ///     >>> contacts = query.contacts(deep)
    ///     >>> contacts["force_n"].sum(axis=0).round(1)[2]
    ///     400.0
    ///     >>> contacts["depth_m"].max().round(6)
    ///     0.0005
    fn contacts<'py>(
        &self,
        py: Python<'py>,
        pose: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let pose = one_pose(pose, 0)?;
        let mut records = Vec::new();
        py.detach(|| {
            self.query.contacts(pose, |contact| records.push(ContactRecord::from(contact)))
        })
        .map_err(raise)?;
        arrays::array(&records, &[records.len()], CONTACT.dtype(py)?)
    }

    /// How stiff the contact is at one pose, (7,) or (4, 4) as of `wrench`: (6, 6) float64.
    ///
    /// The second derivative of the contact's energy by x: translation, m, and rotation vector,
    /// rad, about the origin of the shell's mesh frame, world axes. Symmetric: rows are
    /// -d force_n / dx and -d torque_nm / dx, whose part by turns is taken symmetric. Not always
    /// positive: convex contact pivots away. Raises InvalidInput. Cost: as `wrench`.
    ///
    ///     >>> query.stiffness(deep)[2, 2].round()  # N/m: 2000 for each of 400 squares of a voxel
    ///     800000.0
    fn stiffness<'py>(
        &self,
        py: Python<'py>,
        pose: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let pose = one_pose(pose, 0)?;
        let rows = py.detach(|| self.query.stiffness(pose)).map_err(raise)?;
        arrays::numbers(rows.as_flattened(), &[6, 6], py)
    }
    /// What touches at one pose, in few words: an array of `PATCH_DTYPE`, the hardest first.
    ///
    /// Contacts with one part whose gradients are within 20 degrees are one patch: `normal` (3,),
    /// their mean gradient by force; `force_n` (3,), N, on the shell, which add up to that of the
    /// pose; `position_m` (3,), their mean place by force; `area_m2` of the facets that touch, be it
    /// in part; `depth_m` of the deepest; `part`; `contacts`, how many. Raises InvalidInput.
    ///
    ///     >>> [patch] = query.patches(deep)
    ///     >>> patch["normal"].round(3).tolist(), patch["force_n"].round(1)[2]
    ///     ([0.0, 0.0, 1.0], 400.0)
    fn patches<'py>(
        &self,
        py: Python<'py>,
        pose: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let pose = one_pose(pose, 0)?;
        let found = py.detach(|| self.query.patches(pose)).map_err(raise)?;
        let records: Vec<_> = found.iter().map(PatchRecord::from).collect();
        arrays::array(&records, &[records.len()], PATCH.dtype(py)?)
    }

    /// The point of the shell that is nearest to a part at one pose: a record of `NEAREST_DTYPE`.
    ///
    /// `on_shell_m` (3,), the point, and `on_part_m` (3,), the place on the surface of the part, m,
    /// world; `distance_m`, the clearance; `part`; `point`. None where something touches, and beyond
    /// the least band less a voxel. Raises InvalidInput. Cost: as `wrench`.
    ///
    ///     >>> nearest = query.nearest([-0.005, -0.005, 0.012, 0, 0, 0, 1])  # 2 mm above the block
    ///     >>> nearest["distance_m"].round(6), nearest["on_part_m"].round(6)[2]
    ///     (0.002, 0.01)
    fn nearest<'py>(
        &self,
        py: Python<'py>,
        pose: &Bound<'py, PyAny>,
    ) -> PyResult<Option<Bound<'py, PyAny>>> {
        let pose = one_pose(pose, 0)?;
        let found = py.detach(|| self.query.nearest(pose)).map_err(raise)?;
        found
            .map(|found| {
                arrays::array(&[NearestRecord::from(found)], &[], NEAREST.dtype(py)?)?.get_item(())
            })
            .transpose()
    }

    /// Where a motion from one pose to another first touches: its share of the motion, 0 to 1, and
    /// the pose (7,) there; None where it does not.
    ///
    /// The shell's centre of mass goes straight and its rotation turns about one axis, both evenly.
    /// At the pose it touches, a motion by `tolerance_m` before it did not. Parts may be thin: only
    /// contact that ends again within a way of the tolerance may be missed. Raises InvalidInput.
    /// Cost: few queries in the open, and close along a part the way over the tolerance.
    ///
    ///     >>> high, low = [-0.005, -0.005, 0.02, 0, 0, 0, 1], [-0.005, -0.005, 0, 0, 0, 0, 1]
    ///     >>> share, pose = query.first_contact(high, low)
    ///     >>> round(share, 2), pose.round(3)[2]
    ///     (0.5, 0.01)
    #[pyo3(signature = (from_pose, to_pose, tolerance_m = 1e-5))]
    fn first_contact<'py>(
        &self,
        py: Python<'py>,
        from_pose: &Bound<'py, PyAny>,
        to_pose: &Bound<'py, PyAny>,
        tolerance_m: f64,
    ) -> PyResult<Option<(f64, Bound<'py, PyAny>)>> {
        let from = one_pose(from_pose, 0)?;
        let to = one_pose(to_pose, 1)?;
        let mut interrupted = Ok(());
        let mut looked = Instant::now();
        let found = py.detach(|| {
            self.query.first_contact_with(from, to, tolerance_m, |_| {
                if looked.elapsed() > SIGNALS_EVERY {
                    looked = Instant::now();
                    interrupted = Python::attach(|py| py.check_signals());
                }
                if interrupted.is_ok() { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
            })
        });
        interrupted?;
        found
            .map_err(raise)?
            .map(|found| Ok((found.share, arrays::numbers(&seven(found.pose), &[7], py)?)))
            .transpose()
    }
}

impl ContactQuery {
    fn with_field(
        mut query: vps::ContactQuery,
        made_of: MadeOf,
        stiffness_n_per_m: f64,
        field: &str,
    ) -> PyResult<Self> {
        query.set_field(named("field", &FieldKind::NAMES, field)?).map_err(raise)?;
        Ok(Self { query, made_of, stiffness_n_per_m, field: field.to_owned() })
    }
}

/// Voxmaps with their poses.
fn placed(parts: &Bound<'_, PyAny>) -> PyResult<Vec<Part>> {
    let wrong = |_: PyErr| PyTypeError::new_err("give a Voxmap, or a list of (Voxmap, pose)");
    let mut all = Vec::new();
    for part in parts.try_iter().map_err(wrong)? {
        let (voxmap, pose): (Py<Voxmap>, Bound<'_, PyAny>) = part?.extract().map_err(wrong)?;
        let number = all.len();
        all.push((voxmap, one_pose(&pose, number)?));
    }
    Ok(all)
}

/// x, y, z, qx, qy, qz, qw.
fn seven(pose: vps::Pose) -> [f64; 7] {
    let (DVec3 { x, y, z }, DQuat { x: qx, y: qy, z: qz, w: qw }) =
        (pose.translation, pose.rotation);
    [x, y, z, qx, qy, qz, qw]
}

fn one_pose(pose: &Bound<'_, PyAny>, number: usize) -> PyResult<vps::Pose> {
    let (poses, is_single) = arrays::poses(pose, number)?;
    match poses[..] {
        [pose] if is_single => Ok(pose),
        _ => Err(InvalidInput::new_err(format!(
            "{} poses: give one, of shape (7,) or (4, 4)",
            poses.len()
        ))),
    }
}
