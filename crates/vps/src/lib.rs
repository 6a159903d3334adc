//! Voxmap-pointshell contact: two rigid meshes in, the wrench of a pose out.
//!
//! A part that is touched becomes a *voxmap* with a field of depths; a part that touches becomes a
//! *pointshell*, points on its surface with inward normals. A contact query looks the points up in
//! the field and sums depth × normal. Its cost follows the number of points near contact, not the
//! number of triangles, so that it fits into a millisecond.
//!
//! # Example
//! ```no_run
//! use vps::{ContactQuery, DVec3, Mesh, Options, PointShell, Pose, Voxmap};
//!
//! let options = Options::new(0.5e-3); // voxels of half a millimetre
//! let hole = Voxmap::bake(&Mesh::load("hole.stl", 1e-3)?, &options)?; // files in millimetres
//! let peg = PointShell::bake(&Mesh::load("peg.stl", 1e-3)?, &options)?;
//! let query = ContactQuery::new(&hole, &peg, 1000.0)?; // N/m
//! let felt = query.wrench(Pose::from_translation(DVec3::new(0.0, 0.0, 0.02)))?;
//! println!("{} N, {} N·m, {} m deep", felt.wrench.force, felt.wrench.torque, felt.penetration_m);
//! # Ok::<(), vps::Error>(())
//! ```
//! The same runs as `cargo run -p vps --example query`; `two_parts`, `slide` and `voxmap` show
//! more. [`Mesh::load`] reads OBJ, STL and PLY files, with the features `gltf` and `threemf` those
//! formats too; [`Mesh::from_arrays`] takes triangles.
//!
//! # What is stable
//! All that this page lists follows semantic versioning and checks all of its input: no argument and
//! no file makes a panic. The crate has further public modules, which this page leaves out: they are
//! for hapticd's own crates, change without notice, and trust their callers.
//!
//! | to | use |
//! |---|---|
//! | read or make triangles | [`Mesh`], [`Shape`], [`MassProperties`], [`SolidReport`] |
//! | bake parts, save and load them | [`Voxmap`], [`PointShell`], [`Options`], [`Accuracy`] |
//! | ask for forces, contacts, distances and motions | [`ContactQuery`] |
//! | place parts and read forces | [`Pose`], [`Wrench`], [`DVec3`], [`DQuat`] |
//! | find out why a call failed | [`Error`] |
//!
//! # Units and frames
//! SI: metres, newtons, radians; `f64` outside of arrays. A mesh, its voxmap and its pointshell
//! keep the axes and the origin of the mesh file (the *mesh frame*, below also *map frame*). A pose
//! `a_from_b` takes coordinates in `b` to coordinates in `a`. A depth is greater than 0 inside, a
//! [`Distance`] greater than 0 outside.
//!
//! # Cost
//! Baking: time and memory follow the voxels near the surface (layers × area / voxel size²), in
//! parallel on the current rayon pool; the same bits for any number of threads. A query: its time
//! follows the points near contact, and it allocates nothing.
//!
//! # Source
//! McNeely1999 (voxmap and pointshell), Sagardia2008 (distance fields and their generation).

// # How it works
//
//  file, arrays, Shape ─► Mesh ─┬─► Voxmap ─────┐                              what is stable
//                               └─► PointShell ─┴─► ContactQuery ─► wrench
//
//  file, Shape, triangles ─► Part ─► Volume ─┬─► Field ──► Obstacle ─┐         what it is made of
//             mesh           part    voxmap  └─► Shell ──────────────┴─► ContactSum of a pose
//                                                pointshell              contact
//
// Points of a shell are relative to the centre of mass (the *body frame*), where sums act.
// `ContactSum::flat` is O(points × obstacles), the specification; `ContactSum::of`, which a
// `ContactQuery` runs, leaves out what cannot touch.
//
// | module | owns |
// |---|---|
// | `library` | the types at the root |
// | `spatial` | poses, twists, wrenches, axes, samples of an arm; frames and signs |
// | `mesh` | readers of mesh files, primitive shapes, inspection, mass, closest points |
// | `part` | one part through all stages of baking, and the report on it |
// | `voxmap` | surface voxels, inside and outside, layers, distances, the field; estimates |
// | `pointshell` | points with normals, their order, the tree of spheres over them |
// | `contact` | which points touch, what wrench and stiffness that makes; moving obstacles |
// | `density` | rasters of clay that a query reads while another thread computes the next |
// | `parallel` | loops on the current rayon pool |
// | `solid` | what the triangles of a file mean: the union of their bodies, and skins beside it |
// | `setting_names` | what texts call the settings of a program |
// | `simd` | what the processor can do, kernels over eight lanes |
// | `storage` | arrays that are owned or mapped; opening files of other programs; memory left |
//
// The public modules are for hapticd's own crates and change without notice. Their pages are made
// with the feature `inner-docs` only, so that those of the crate show the stable interface.
#[cfg_attr(not(feature = "inner-docs"), doc(hidden))]
pub mod contact;
#[cfg_attr(not(feature = "inner-docs"), doc(hidden))]
pub mod density;
mod halving;
mod library;
#[cfg_attr(not(feature = "inner-docs"), doc(hidden))]
pub mod mesh;
#[cfg_attr(not(feature = "inner-docs"), doc(hidden))]
pub mod parallel;
#[cfg_attr(not(feature = "inner-docs"), doc(hidden))]
pub mod part;
mod part_report;
#[cfg_attr(not(feature = "inner-docs"), doc(hidden))]
pub mod pointshell;
mod sets;
#[cfg_attr(not(feature = "inner-docs"), doc(hidden))]
pub mod setting_names;
mod simd;
#[cfg_attr(not(feature = "inner-docs"), doc(hidden))]
pub mod solid;
#[cfg_attr(not(feature = "inner-docs"), doc(hidden))]
pub mod spatial;
#[cfg_attr(not(feature = "inner-docs"), doc(hidden))]
pub mod storage;
#[cfg_attr(not(feature = "inner-docs"), doc(hidden))]
pub mod voxmap;

pub use glam::{DMat3, DQuat, DVec3};
pub use library::{
    ContactPatch, ContactPoint, ContactQuery, ContactWrench, Distance, Error, Impact, Mesh,
    NearestPoint, PointShell, Voxmap,
};
pub use mesh::mass::MassProperties;
pub use mesh::primitives::Shape;
pub use pointshell::Points;
pub use solid::{Cavity, SolidReport};
pub use spatial::{Pose, Wrench};
pub use voxmap::accuracy::Accuracy;
pub use voxmap::field::FieldKind;
pub use voxmap::inside_test::InsideTest;
pub use voxmap::{BakeStage, Options};

/// Runs the example of the README.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
