//! Triangle meshes: readers, primitive shapes, validation, exact closest points.
//!
//! Data in: mesh files, shape parameters. Data out: one [`TriangleMesh`] in metres, a report on it
//! ([`validate::inspect`]) and its mass properties ([`mass::mass_properties`]).
//!
//! ```text
//!  file ─► source ─┬─► obj, ply, gltf, 3mf ─┐
//!   (mapped, read) └─► stl ─► weld ─────────┴─► TriangleMesh ─► validate ─► mass
//!            Shape ─► primitives ───────────────────┘    └────► closest_point (asked by the pointshell)
//! ```
//!
//! | format | read | not read |
//! |---|---|---|
//! | OBJ | every group, polygons, negative indices | free-form surfaces |
//! | STL | text and binary; equal corners are joined | normals, attributes |
//! | PLY | text and binary of both byte orders, numbers of any type, polygons, `tristrips` | attributes |
//! | glTF, GLB | default scene with its transforms; triangles, strips, fans; embedded and external buffers; sparse, quantized | skins, morph targets, instances, Draco and meshopt compression |
//! | 3MF | what is built, with transforms; the production extension | supports, what is not printed, modifiers and negative volumes of slicers; beam lattices, slices, boolean operations, encryption |
//!
//! Points without faces are read by [`cloud`], from PLY, OBJ and plain text.
//!
//! Coordinates keep the axes of the file, and are multiplied by `units`, whatever a format says of
//! metres; only 3MF names a unit in the file, which then must be the same.
//!
//! Invariants: cold, nothing here runs while forces are rendered. Nothing here repairs a mesh: what
//! is wrong with it is said, and generation copes. No file, however damaged, ends the program:
//! numbers that a file announces are checked against the bytes that are there before memory is
//! allocated for them. Results do not depend on the number of threads. Cost: every step is linear
//! in the file; binary STL and the inspection run in parallel.
//!
//! # Example
//! ```
//! use vps::mesh::mass::mass_properties;
//! use vps::mesh::validate::inspect;
//! use vps::mesh::{Format, parse};
//!
//! // A tetrahedron whose file counts in millimetres.
//! let text = b"v 0 0 0\nv 30 0 0\nv 0 30 0\nv 0 0 30\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n";
//! let mesh = parse(text, Format::Obj, "tetrahedron.obj".as_ref(), 1e-3)?;
//! assert!(inspect(&mesh).closed);
//! assert!((mass_properties(&mesh).volume_m3 - 0.03_f64.powi(3) / 6.0).abs() < 1e-12);
//! # Ok::<(), vps::mesh::MeshError>(())
//! ```

pub(crate) mod boxes;
pub mod closest_point;
pub mod cloud;
#[cfg(any(feature = "gltf", feature = "threemf"))]
mod copy_budget;
pub(crate) mod edges;
mod error;
mod file_mesh;
mod foreign;
mod format;
#[cfg(feature = "gltf")]
mod gltf;
mod load;
pub mod mass;
mod obj;
mod ply;
mod points;
pub mod polygon;
pub mod primitives;
mod shards;
mod source;
mod stl;
#[cfg(test)]
mod tests;
#[cfg(feature = "threemf")]
mod threemf;
mod triangle_mesh;
pub mod validate;
pub(crate) mod weld;
mod xyz;

pub use error::{MeshError, curved_surfaces};
pub use file_mesh::{FileMesh, Rounding};
pub use foreign::Foreign;
pub use format::{EXTENSIONS, Format, cad_format, cad_hint};
pub(crate) use load::FARTHEST_M;
pub use load::{companions, copy_only, load, load_with_notes, parse, parse_with_notes};
use triangle_mesh::SUM_TRIANGLES;
pub use triangle_mesh::TriangleMesh;
