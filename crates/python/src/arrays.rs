//! Arrays of Python as slices, slices as arrays, and views of memory that Rust owns.
//!
//! All of it goes through NumPy's own interfaces and needs no `unsafe`: input is copied once by
//! `tobytes`, results once into a `bytearray` that the array owns, and a view reads
//! `__array_interface__` of an object that keeps the memory alive.

use std::sync::Arc;

use bytemuck::NoUninit;
use glam::{DMat3, DQuat, DVec3};
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::{PyByteArray, PyBytes, PyDict, PyString, PyTuple};
use vps::spatial::Pose;

use crate::errors::InvalidInput;

/// How far columns of a rotation matrix may be from unit length and right angles: rounding to
/// float32 stays below it.
const ROTATION_TOLERANCE: f64 = 1e-5;

fn numpy<'py>(py: Python<'py>, name: &str) -> PyResult<Bound<'py, PyAny>> {
    static NUMPY: PyOnceLock<Py<PyModule>> = PyOnceLock::new();
    let numpy = NUMPY.get_or_try_init(py, || PyModule::import(py, "numpy").map(Bound::unbind))?;
    numpy.bind(py).getattr(name)
}

fn shape_error(name: &str, shape: &[usize], wanted: &str) -> PyErr {
    InvalidInput::new_err(format!("{name} has the shape {shape:?}: give {wanted}"))
}

/// Items of an array-like in C order, converted to `dtype`, and its shape. `kinds`: the kinds of
/// dtypes that are taken.
fn items<T: bytemuck::Pod>(
    value: &Bound<'_, PyAny>,
    name: &str,
    kinds: &str,
    dtype: &str,
) -> PyResult<(Vec<T>, Vec<usize>)> {
    let array = numpy(value.py(), "asarray")?.call1((value,))?;
    let shape: Vec<usize> = array.getattr("shape")?.extract()?;
    let found = array.getattr("dtype")?;
    let is_taken = kinds.contains(&found.getattr("kind")?.extract::<String>()?);
    // An empty list has no kind of its own.
    if !is_taken && !shape.contains(&0) {
        let wanted = if kinds.contains('f') { "real numbers" } else { "whole numbers" };
        return Err(InvalidInput::new_err(format!("{name} has the dtype {found}: give {wanted}")));
    }
    let bytes = array.call_method1("astype", (dtype,))?.call_method0("tobytes")?;
    Ok((bytemuck::pod_collect_to_vec(bytes.cast::<PyBytes>()?.as_bytes()), shape))
}

fn floats(value: &Bound<'_, PyAny>, name: &str) -> PyResult<(Vec<f64>, Vec<usize>)> {
    items(value, name, "fiu", "=f8")
}

/// Points (n, 3), or one of shape (3,): then the second is true.
pub(crate) fn points(value: &Bound<'_, PyAny>, name: &str) -> PyResult<(Vec<[f64; 3]>, bool)> {
    let (numbers, shape) = floats(value, name)?;
    match shape[..] {
        [3] => Ok((numbers.as_chunks().0.to_vec(), true)),
        [_, 3] => Ok((numbers.as_chunks().0.to_vec(), false)),
        _ => Err(shape_error(name, &shape, "(n, 3)")),
    }
}

/// Triangles (m, 3).
pub(crate) fn faces(value: &Bound<'_, PyAny>) -> PyResult<Vec<[u32; 3]>> {
    let (numbers, shape) = items::<i64>(value, "faces", "iu", "=i8")?;
    if !matches!(shape[..], [_, 3]) {
        return Err(shape_error("faces", &shape, "(m, 3)"));
    }
    let index = |(at, number): (usize, &i64)| {
        u32::try_from(*number).map_err(|_| {
            InvalidInput::new_err(format!(
                "faces: triangle {} names vertex {number}: count vertices from 0",
                at / 3
            ))
        })
    };
    let numbers: Vec<u32> = numbers.iter().enumerate().map(index).collect::<PyResult<_>>()?;
    Ok(numbers.as_chunks().0.to_vec())
}

/// Poses (n, 7) or (n, 4, 4); or one, (7,) or (4, 4): then the second is true. `first`: the number of
/// the first of them.
pub(crate) fn poses(value: &Bound<'_, PyAny>, first: usize) -> PyResult<(Vec<Pose>, bool)> {
    let (numbers, shape) = floats(value, "the pose")?;
    let is_single = shape.len() + 1 == if shape.ends_with(&[4, 4]) { 3 } else { 2 };
    let poses = match shape[..] {
        [7] | [_, 7] => numbers.as_chunks().0.iter().map(of_seven).collect(),
        [4, 4] | [_, 4, 4] => {
            (first..).zip(numbers.as_chunks().0).map(of_matrix).collect::<PyResult<_>>()?
        }
        _ => {
            return Err(shape_error(
                "the pose",
                &shape,
                "(7,) or (n, 7): x, y, z, qx, qy, qz, qw; or (4, 4) or (n, 4, 4)",
            ));
        }
    };
    Ok((poses, is_single))
}

fn of_seven(&[x, y, z, qx, qy, qz, qw]: &[f64; 7]) -> Pose {
    Pose::new(DQuat::from_xyzw(qx, qy, qz, qw), DVec3::new(x, y, z))
}

fn of_matrix(
    (index, &[xx, xy, xz, x, yx, yy, yz, y, zx, zy, zz, z, b0, b1, b2, b3]): (usize, &[f64; 16]),
) -> PyResult<Pose> {
    let rotation = DMat3::from_cols_array(&[xx, yx, zx, xy, yy, zy, xz, yz, zz]);
    let away = rotation.transpose() * rotation - DMat3::IDENTITY;
    let is_near = |numbers: &[f64]| numbers.iter().all(|number| number.abs() <= ROTATION_TOLERANCE);
    if !is_near(&[b0, b1, b2, b3 - 1.0]) {
        let found = [b0, b1, b2, b3];
        return Err(InvalidInput::new_err(format!(
            "pose {index}: the last row of the matrix is {found:?}: give 0, 0, 0, 1"
        )));
    }
    if !(is_near(&away.to_cols_array()) && rotation.determinant() > 0.0) {
        let what = "its upper left 3 x 3 are no rotation: give columns of unit length at right \
            angles, right-handed";
        return Err(InvalidInput::new_err(format!("pose {index}: {what}")));
    }
    Ok(Pose::new(DQuat::from_mat3(&rotation).normalize(), DVec3::new(x, y, z)))
}

/// A new array of this shape and dtype that holds these items.
pub(crate) fn array<'py, T: NoUninit>(
    items: &[T],
    shape: &[usize],
    dtype: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyAny>> {
    let py = dtype.py();
    let bytes: &[u8] = bytemuck::cast_slice(items);
    let memory = PyByteArray::new_with(py, bytes.len(), |memory| {
        memory.copy_from_slice(bytes);
        Ok(())
    })?;
    numpy(py, "ndarray")?.call1((PyTuple::new(py, shape)?, dtype, memory))
}

/// The same of numbers.
pub(crate) fn numbers<'py, T: NoUninit>(
    items: &[T],
    shape: &[usize],
    py: Python<'py>,
) -> PyResult<Bound<'py, PyAny>> {
    array(items, shape, PyString::new(py, "=f8").as_any())
}

/// Memory of a part, as NumPy asks for it.
#[pyclass(frozen)]
struct View {
    /// Keeps the memory alive.
    _owner: Arc<dyn Send + Sync>,
    address: usize,
    shape: Vec<usize>,
    typestr: &'static str,
}

#[pymethods]
impl View {
    #[getter]
    fn __array_interface__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let interface = PyDict::new(py);
        interface.set_item("version", 3)?;
        interface.set_item("shape", PyTuple::new(py, &self.shape)?)?;
        interface.set_item("typestr", self.typestr)?;
        // True: read-only.
        interface.set_item("data", (self.address, true))?;
        Ok(interface)
    }
}

/// A read-only array over memory that `owner` holds and never changes.
pub(crate) fn view<'py, O: Send + Sync + 'static, T>(
    owner: &Arc<O>,
    memory: fn(&O) -> &[T],
    shape: &[usize],
    typestr: &'static str,
    py: Python<'py>,
) -> PyResult<Bound<'py, PyAny>> {
    let memory = memory(owner);
    let items: usize = shape.iter().product();
    let bytes_per_item =
        typestr.bytes().next_back().map_or(0, |digit| usize::from(digit.wrapping_sub(b'0')));
    if items * bytes_per_item != size_of_val(memory) {
        return Err(InvalidInput::new_err(format!(
            "{items} items of {typestr} are not {} bytes",
            size_of_val(memory)
        )));
    }
    let view = View {
        _owner: Arc::<O>::clone(owner),
        address: memory.as_ptr().addr(),
        shape: shape.to_vec(),
        typestr,
    };
    numpy(py, "asarray")?.call1((view,))
}
