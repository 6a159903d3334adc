//! The exceptions of the module: values that cannot be used, and files.

use pyo3::create_exception;
use pyo3::exceptions::{PyOSError, PyValueError};
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
        and what to do."
);

/// What the library said, as the exception of its kind.
pub(crate) fn raise(error: vps::Error) -> PyErr {
    let text = error.to_string();
    match error {
        vps::Error::File { .. }
        | vps::Error::Mesh { source: MeshError::Missing { .. } | MeshError::Unreadable { .. } } => {
            FileError::new_err(text)
        }
        _ => InvalidInput::new_err(text),
    }
}
