//! Pointshells: the surface of the moving object as points with inward normals.
//!
//! The way through: [`project`] (surface voxel → one point on the surface, two phases; triangles sorted into bricks by `bins`) →
//! `normals` (5×5×5 neighbourhood of the layer values) → `cluster` (ordered so that near points lie near in memory) → [`shell`]
//! (laid out for the tick in `lanes`) → [`tree`] (spheres over it). [`build`] runs them in order.
//!
//! Invariant: the same points, bit for bit, whatever the number of threads.

mod bins;
mod build;
mod cluster;
mod lanes;
mod levels;
mod normals;
pub mod ply;
pub mod project;
pub mod shell;
mod sphere;
pub mod tree;

pub use build::{ShellReport, build};
pub use levels::LevelReport;
