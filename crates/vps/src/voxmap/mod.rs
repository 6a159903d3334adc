//! Voxmaps: the sampled volume of one object.
//!
//! Data in: triangles and what [`inspect`](crate::mesh::validate::inspect) says of them, a voxel
//! size, a number of layers. Data out: a [`Volume`], and from it the [`Field`](field::Field) that
//! the tick reads.
//!
//! The way through, which [`Volume::build`] runs in order:
//!
//! | stage | files | question |
//! |---|---|---|
//! | | [`estimate`] | what will the bake take, before it begins? |
//! | grid | [`grid`], `bricks` | index arithmetic; sparse sets of bricks |
//! | surface | [`surface`], `navigation`, `columns`, `sat` | which voxels does a triangle touch? Two navigations, by columns; the test that specifies them |
//! | fill | [`fill`] | which cells are reached from outside? |
//! | | [`inside_test`] | what distinguishes inside from outside: the fill, winding numbers or nothing? |
//! | | `leak`, `winding` | did the fill get in; how often does the surface wind around a point? |
//! | | `hole_cap` | triangles that close the holes |
//! | | `orient` | which way do faces point? |
//! | layers | [`layers`], `growth` | how many voxels from the surface? |
//! | distance | `distance` | how many metres? |
//! | field | [`field`] | what the tick reads |
//! | | [`npy`] | layers and distances as files |
//! | | `thin_walls` | what do the voxels not resolve? |
//! | | [`accuracy`] | how far the field is from the triangles, and what a part tells apart |
//!
//! Storage is sparse on two levels: a top grid with one entry per brick of 8³ cells, and bricks
//! only where the band passes; a brick without band cells only knows whether it is far outside or
//! deep inside.
//!
//! Invariant: results do not depend on the number of threads.
//!
//! Units and frames: the map frame is the mesh file's own frame in metres; *cells* are continuous
//! grid coordinates.
//!
//! # Example
//! ```
//! use glam::{DVec3, Vec3};
//! use vps::mesh::{primitives::Shape, validate::inspect};
//! use vps::voxmap::field::FieldKind;
//! use vps::voxmap::inside_test::InsideTest;
//! use vps::voxmap::{Options, Volume};
//!
//! let mesh = Shape::Sphere { radius_m: 10e-3 }.tessellate(5e-5);
//! let options = Options { voxel_size_m: 1e-3, layers: 3, navigation: None, sides: InsideTest::Auto };
//! let mut map = Volume::build(&mesh, &inspect(&mesh), &options, |_stage| {})?;
//! let field = map.field(&mesh, false);
//!
//! // 9.5 mm from the middle is half a millimetre inside.
//! let cells = map.surface.grid.to_cells(DVec3::X * 9.5e-3).as_vec3();
//! let depth_m = field.value(FieldKind::Trilinear, cells, Vec3::ZERO);
//! assert!((depth_m - 0.5e-3).abs() < 0.1e-3);
//! # Ok::<(), vps::voxmap::grid::GridError>(())
//! ```

pub mod accuracy;
pub mod border;
mod bricks;
mod build;
mod columns;
mod distance;
pub mod estimate;
pub mod field;
pub mod fill;
pub mod grid;
mod growth;
mod hole_cap;
pub mod inside_test;
pub mod layers;
mod leak;
pub mod memory_limit;
mod navigation;
pub mod npy;
mod orient;
pub mod sat;
pub mod surface;
mod thin_walls;
mod union;
mod winding;

pub(crate) use build::announce;
pub use build::{Answer, BakeStage, Options, StageTimes, Volume};
pub use distance::Distances;
pub use hole_cap::CappedMesh;
pub use leak::Leak;
pub use leak::MOSTLY_THIN;
pub use orient::Orientation;
pub(crate) use thin_walls::ThinPlace;
