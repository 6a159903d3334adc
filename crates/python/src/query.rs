//! Wrenches and contacts as structured arrays.

use std::time::Instant;

use bytemuck::{Pod, Zeroable};
use pyo3::PyTypeInfo;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use vps::{ContactPoint, ContactWrench};

use crate::arrays;
use crate::errors::{InvalidInput, raise};
use crate::parts::{PointShell, Voxmap};
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
    point: i64,
}

type Column = (&'static str, &'static str, usize);
const WRENCH: [Column; 5] = [
    ("force_n", "=f8", 3),
    ("torque_nm", "=f8", 3),
    ("penetration_m", "=f8", 1),
    ("clearance_m", "=f8", 1),
    ("contacts", "=i8", 1),
];
const CONTACT: [Column; 6] = [
    ("position_m", "=f8", 3),
    ("normal", "=f8", 3),
    ("gradient", "=f8", 3),
    ("force_n", "=f8", 3),
    ("depth_m", "=f8", 1),
    ("point", "=i8", 1),
];

fn dtype<'py>(columns: &[Column], py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
    let column = |(name, kind, n): &Column| -> PyResult<Bound<'py, PyAny>> {
        Ok(if *n == 1 {
            (*name, *kind).into_pyobject(py)?.into_any()
        } else {
            (*name, *kind, *n).into_pyobject(py)?.into_any()
        })
    };
    let columns: Vec<_> = columns.iter().map(column).collect::<PyResult<_>>()?;
    PyModule::import(py, "numpy")?.getattr("dtype")?.call1((columns,))
}

/// Columns of what `ContactQuery.wrench` returns.
pub(crate) fn wrench_dtype(py: Python<'_>) -> PyResult<&Bound<'_, PyAny>> {
    static DTYPE: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
    Ok(DTYPE.get_or_try_init(py, || dtype(&WRENCH, py).map(Bound::unbind))?.bind(py))
}

/// Columns of what `ContactQuery.contacts` returns.
pub(crate) fn contact_dtype(py: Python<'_>) -> PyResult<&Bound<'_, PyAny>> {
    static DTYPE: PyOnceLock<Py<PyAny>> = PyOnceLock::new();
    Ok(DTYPE.get_or_try_init(py, || dtype(&CONTACT, py).map(Bound::unbind))?.bind(py))
}

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
            point: contact.point.into(),
        }
    }
}

/// Asks what wrench a voxmap exerts on a shell.
///
/// ContactQuery(voxmap, shell, stiffness_n_per_m=1000.0): each point inside pushes with stiffness x
/// depth x weight along its normal; the weight is the area that it stands for in squares of the
/// shell's voxel edge. A face of area A at depth d pushes with about stiffness x d x A / voxel
/// edge². There is no friction, and nothing is remembered: the same pose gives the same bits.
/// Threads may share a query. Raises InvalidInput: the stiffness is not between 0 and 1e12 N/m.
/// Cost: milliseconds; memory is shared with both parts.
#[pyclass(frozen, module = "hapticd_vps")]
pub(crate) struct ContactQuery {
    query: vps::ContactQuery,
    /// What it was made of, which is how it is pickled.
    made_of: (Py<Voxmap>, Py<PointShell>, f64),
}

#[pymethods]
impl ContactQuery {
    #[new]
    #[pyo3(signature = (voxmap, shell, stiffness_n_per_m = 1000.0))]
    fn new(
        py: Python<'_>,
        voxmap: Py<Voxmap>,
        shell: Py<PointShell>,
        stiffness_n_per_m: f64,
    ) -> PyResult<Self> {
        let (map, points) = (&voxmap.get().voxmap, &shell.get().shell);
        let query =
            py.detach(|| vps::ContactQuery::new(map, points, stiffness_n_per_m)).map_err(raise)?;
        Ok(Self { query, made_of: (voxmap, shell, stiffness_n_per_m) })
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let (voxmap, shell, stiffness_n_per_m) = &self.made_of;
        let made_of = (voxmap.clone_ref(py), shell.clone_ref(py), *stiffness_n_per_m);
        Ok((Self::type_object(py), made_of).into_pyobject(py)?.into_any())
    }

    /// Wrenches at poses of the shell's mesh frame in the voxmap's: (7,) or (n, 7) of x, y, z (m),
    /// qx, qy, qz, qw (unit), or (4, 4) or (n, 4, 4).
    ///
    /// Returns an array (n,) of `WRENCH_DTYPE`, or one such record of a single pose. On the shell:
    /// `force_n` (3,), N, axes of the voxmap's mesh frame; `torque_nm` (3,), N m, the same axes,
    /// about the origin of the shell's mesh frame; `penetration_m` of the deepest point, 0 without
    /// contact; `clearance_m` of the nearest one, 0 in contact, at most the voxmap's `band_m`;
    /// `contacts`, the number of points in contact. Raises InvalidInput, naming the first pose that
    /// is none. Cost: about linear in the points of the shell, never in triangles; many poses use
    /// all processors, with the same bits as one by one.
    fn wrench<'py>(
        &self,
        py: Python<'py>,
        poses: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let (poses, is_single) = arrays::poses(poses)?;
        if let (true, [pose]) = (is_single, &poses[..]) {
            let found = py.detach(|| self.query.wrench(*pose)).map_err(raise)?;
            return arrays::array(&[WrenchRecord::from(found)], &[], wrench_dtype(py)?)?
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
        arrays::array(&records, &[records.len()], wrench_dtype(py)?)
    }

    /// All contacts at one pose, (7,) or (4, 4) as of `wrench`: an array of `CONTACT_DTYPE`, in the
    /// order of the points of the shell.
    ///
    /// `position_m` (3,), m, and `normal` (3,), unit, the shell's surface normal, inward, which
    /// pushes it out, in the voxmap's mesh frame; `gradient` (3,), unit, of the voxmap's distance,
    /// the quickest way out, beyond the band it may be zero; `force_n` (3,), N, of this contact on
    /// the shell; `depth_m`; `point`, the number of the point. Raises InvalidInput.
    fn contacts<'py>(
        &self,
        py: Python<'py>,
        pose: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let pose = one_pose(pose)?;
        let mut records = Vec::new();
        py.detach(|| {
            self.query.contacts(pose, |contact| records.push(ContactRecord::from(contact)))
        })
        .map_err(raise)?;
        arrays::array(&records, &[records.len()], contact_dtype(py)?)
    }

    /// How stiff the contact is at one pose, (7,) or (4, 4) as of `wrench`: (6, 6) float64.
    ///
    /// The second derivative of the contact's energy by x: translation, m, and rotation vector,
    /// rad, about the origin of the shell's mesh frame, axes of the voxmap's. Symmetric: rows are
    /// -d force_n / dx and -d torque_nm / dx, whose part by turns is taken symmetric. Not always
    /// positive: convex contact pivots away. Raises InvalidInput. Cost: as `wrench`.
    fn stiffness<'py>(
        &self,
        py: Python<'py>,
        pose: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let pose = one_pose(pose)?;
        let rows = py.detach(|| self.query.stiffness(pose)).map_err(raise)?;
        arrays::numbers(rows.as_flattened(), &[6, 6], py)
    }
}

fn one_pose(pose: &Bound<'_, PyAny>) -> PyResult<vps::Pose> {
    let (poses, is_single) = arrays::poses(pose)?;
    match poses[..] {
        [pose] if is_single => Ok(pose),
        _ => Err(InvalidInput::new_err(format!(
            "{} poses: give one, of shape (7,) or (4, 4)",
            poses.len()
        ))),
    }
}
