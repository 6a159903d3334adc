//! What other programs embed: meshes in, the wrench of a pose out, every input checked.
//!
//! ```text
//!  file, arrays, Shape ─► Mesh ─┬─► Voxmap ◄──────► file
//!                               └─► PointShell ◄──► file      Voxmap + PointShell ─► ContactQuery ─► wrench, contacts
//! ```
//!
//! Everything is re-exported at the root of the crate. The modules do the work and trust their
//! input; these types check it first, so that no value, array or file that a caller passes makes a
//! panic.

mod baked;
mod error;
mod mesh;
mod query;
mod way;

pub use baked::{Distance, PointShell, Voxmap};
pub use error::Error;
pub use mesh::Mesh;
pub use query::{ContactPatch, ContactPoint, ContactQuery, ContactWrench, Impact, NearestPoint};
