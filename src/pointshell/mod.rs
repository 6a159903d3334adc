//! Pointshells: the surface of the moving object as points with inward normals.
//!
//! The way through: [`project`] (surface voxel → one point on the surface, two phases) → [`normals`] (5×5×5 neighbourhood of the
//! layer values) → [`shell`] (ordered along a space-filling curve, laid out for the tick). [`build`] runs them in order.
//!
//! Invariant: the same points, bit for bit, whatever the number of threads.

mod build;
pub mod normals;
pub mod ply;
pub mod project;
pub mod shell;

pub use build::{ShellReport, build};
