//! The exceptions of the module: values that cannot be used, and files.

use std::ffi::CString;

use pyo3::create_exception;
use pyo3::exceptions::{PyOSError, PyUserWarning, PyValueError};
use pyo3::prelude::*;
use vps::mesh::MeshError;

create_exception!(
    hapticd_vps,
    InvalidInput,
    PyValueError,
    "An array, a number, a pose or the content of a mesh file that cannot be used. The text says \
        what is wrong, where, and what to do."
);
create_exception!(
    hapticd_vps,
    FileError,
    PyOSError,
    "A file that cannot be read or written, or that holds no baked part. The text says which file, \
        and what to do; `errno` is what the operating system said, or None."
);

/// ENOENT of every system.
const NO_SUCH_FILE: i32 = 2;

/// What the library said, as the exception of its kind.
pub(crate) fn raise(error: vps::Error) -> PyErr {
    let text = error.to_string();
    let code = match error {
        vps::Error::Mesh { source: MeshError::Missing { .. } } => Some(NO_SUCH_FILE),
        vps::Error::File { .. } | vps::Error::Mesh { source: MeshError::Unreadable { .. } } => {
            error.os_error().and_then(std::io::Error::raw_os_error)
        }
        _ => return InvalidInput::new_err(text),
    };
    match code {
        Some(code) => FileError::new_err((code, text)),
        None => FileError::new_err(text),
    }
}

/// Says each as a `UserWarning` of the line that called.
pub(crate) fn warn(py: Python<'_>, warnings: &[String]) -> PyResult<()> {
    let category = py.get_type::<PyUserWarning>();
    warnings
        .iter()
        .filter_map(|text| CString::new(text.as_str()).ok())
        .try_for_each(|text| PyErr::warn(py, &category, &text, 1))
}
