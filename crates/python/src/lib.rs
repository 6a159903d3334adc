//! The Python module `hapticd_vps`: the types of [`vps`] over NumPy arrays.
//!
//! Data in: files, arrays of vertices, faces and poses. Data out: structured arrays of wrenches and
//! contacts, and read-only views of baked parts. Units and frames are those of [`vps`].
//!
//! # Threads
//! Bakes, batches and single queries release the interpreter's lock. What runs in parallel runs in
//! a pool of threads of this module: `pool`.
//!
//! | module | owns |
//! |---|---|
//! | `arrays` | arrays of Python as slices and back, views of memory that a part owns |
//! | `errors` | the two exceptions |
//! | `parts` | `Mesh`, `Voxmap`, `PointShell` |
//! | `pool` | the threads; progress, signals and cancellation of a bake |
//! | `query` | `ContactQuery` |

mod arrays;
mod errors;
mod parts;
mod pool;
mod query;

/// Voxmap-pointshell contact: two triangle meshes in, the contact wrench of a pose out.
///
/// `Mesh` -> `Voxmap` (the part that is touched) and `PointShell` (the part that touches) ->
/// `ContactQuery(voxmap, shell).wrench(poses)`.
///
/// SI units: metres, newtons, newton metres. Each mesh keeps its own frame; a pose is that of the
/// shell's mesh frame in the voxmap's mesh frame: seven numbers x, y, z, qx, qy, qz, qw (a unit
/// quaternion), or a homogeneous matrix of 4 x 4. Wrenches act on the shell.
///
/// Values that cannot be used raise `InvalidInput`, a `ValueError`; files that cannot be read or
/// written raise `FileError`, an `OSError`.
///
/// Examples of the calls have a `block` (Voxmap) of 40 x 40 x 20 mm around its origin, a `cube`
/// (PointShell) of 10 mm with a corner at its origin, their meshes `block_mesh` and `cube_mesh`,
/// voxels of 0.5 mm, `query`, which is ContactQuery(block, cube, 2000), the pose `deep`, half a
/// millimetre deep in the top of the block, [-0.005, -0.005, 0.0095, 0, 0, 0, 1], and a `folder`.
#[pyo3::pymodule]
mod hapticd_vps {
    use pyo3::prelude::*;

    #[pymodule_export]
    use crate::errors::{FileError, InvalidInput};
    #[pymodule_export]
    use crate::parts::{Mesh, PointShell, Voxmap};
    #[pymodule_export]
    use crate::query::ContactQuery;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        let py = module.py();
        module.add("CONTACT_DTYPE", crate::query::CONTACT.dtype(py)?)?;
        module.add("NEAREST_DTYPE", crate::query::NEAREST.dtype(py)?)?;
        module.add("PATCH_DTYPE", crate::query::PATCH.dtype(py)?)?;
        module.add("WRENCH_DTYPE", crate::query::WRENCH.dtype(py)?)?;
        module.add("__version__", env!("CARGO_PKG_VERSION"))
    }
}
