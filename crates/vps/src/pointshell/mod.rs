//! Pointshells: the surface of the moving object as points with inward normals.
//!
//! Data in: triangles and their [`Volume`](crate::voxmap::Volume). Data out: a
//! [`Shell`](shell::Shell), one point for each surface voxel, with a tree of spheres over it. Units
//! and frames: metres and axes of the tool mesh file, positions relative to the centre of mass.
//!
//! The way through: [`project`] (surface voxel → one point on the surface, two phases; triangles
//! sorted into bricks by `bins`) → `normals` (5×5×5 neighbourhood of the layer values) → `cluster`
//! (ordered so that near points lie near in memory) → [`shell`] (laid out for the tick in `lanes`)
//! → [`tree`] (spheres over it). [`build()`] runs them in order.
//!
//! Invariant: the same points, bit for bit, whatever the number of threads.
//!
//! # Example
//! ```
//! use glam::DVec3;
//! use vps::mesh::{primitives::Shape, validate::inspect};
//! use vps::voxmap::inside_test::InsideTest;
//! use vps::voxmap::{Options, Volume};
//!
//! let mesh = Shape::Sphere { radius_m: 10e-3 }.tessellate(5e-5);
//! let options = Options { voxel_size_m: 1e-3, layers: 3, navigation: None, sides: InsideTest::Auto };
//! let map = Volume::build(&mesh, &inspect(&mesh), &options, |_stage| {})?;
//! let (shell, report) = vps::pointshell::build(&mesh, &map, DVec3::ZERO);
//!
//! assert_eq!(report.points, map.surface.n_voxels);
//! assert!(shell.points().all(|(position, normal)| position.dot(normal) < 0.0), "normals point inward");
//! # Ok::<(), vps::voxmap::grid::GridError>(())
//! ```

mod bins;
mod build;
mod cluster;
mod facets;
mod lanes;
mod levels;
mod normals;
pub mod ply;
pub mod project;
pub mod shell;
mod sphere;
pub mod tree;

pub use build::{Points, ShellReport, build, build_with};
pub use levels::LevelReport;
