//! Voxmap-pointshell contact: two rigid meshes in, the wrench of a pose out.
//!
//! A part that is touched becomes a *voxmap* with a field of depths; a part that touches becomes a *pointshell*, points on its surface with inward
//! normals. A contact query looks the points up in the field and sums depth × normal. Its cost follows the number of points near contact, not the
//! number of triangles, so that it fits into a millisecond.
//!
//! ```text
//!  file, Shape, triangles ─► Part ─► Volume ─┬─► Field ──► Obstacle ─┐
//!             mesh           part    voxmap  └─► Shell ──────────────┴─► ContactSum (wrench, stiffness, depth) of a pose
//!                                                pointshell              contact
//! ```
//!
//! # Units and frames
//! SI: metres, newtons, radians; `f64` outside of arrays. A mesh, its field and its points keep the axes of the mesh file (the *map frame*);
//! `world_from_map` says where a part is. Points of a shell are relative to the centre of mass (the *body frame*). A wrench acts at the centre of mass,
//! in world axes. A depth is greater than 0 inside. A pose `a_from_b` takes coordinates in `b` to coordinates in `a`.
//!
//! # Cost
//! Baking: time and memory follow the voxels near the surface (layers × area / voxel size²), in parallel on the current rayon pool; the same bits for any
//! number of threads. A query: [`ContactSum::flat`](contact::ContactSum::flat) is O(points × obstacles); [`ContactSum::of`](contact::ContactSum::of) leaves out
//! what cannot touch, and allocates nothing.
//!
//! # Example
//! ```
//! use glam::DVec3;
//! use vps::{contact::*, mesh::primitives::Shape, part::Part, pointshell::Points, spatial::Pose, voxmap::Options};
//!
//! let block = Part::new("block", Shape::Box { size_m: DVec3::splat(40e-3) }.tessellate(0.0));
//! let ball = Part::new("ball", Shape::Sphere { radius_m: 10e-3 }.tessellate(2e-5));
//! let (field, _report) = block.bake_field(&Options::new(1e-3), false, |_stage| ())?;
//! let (shell, _mass, _report) = ball.bake_shell(&Options::new(1e-3), Points::Facets, None, |_stage| ())?;
//! let obstacle = Obstacle { field, world_from_map: Pose::IDENTITY };
//! let sum = ContactSum::flat(&[obstacle], &shell, Pose::from_translation(DVec3::Z * 29.5e-3), ForceLaw::PLAIN);
//! assert!(sum.contacts > 0 && sum.wrench.force.z > 0.0, "half a millimetre deep: the block pushes up");
//! # Ok::<(), vps::part::PartError>(())
//! ```
//! [`Part::load`](part::Part::load) reads OBJ, STL and PLY files, with the features `gltf` and `threemf` those formats too.
//!
//! # Where to find what
//!
//! | module | owns |
//! |---|---|
//! | [`spatial`] | poses, twists, wrenches, axes, samples of an arm; frames and signs |
//! | [`mesh`] | readers of mesh files, primitive shapes, inspection, mass, closest points |
//! | [`part`] | one part through all stages of baking, and the report on it |
//! | [`voxmap`] | surface voxels, inside and outside, layers, distances, the field of depths; memory estimates |
//! | [`pointshell`] | points with normals, their order, the tree of spheres over them |
//! | [`contact`] | which points touch, and what wrench and stiffness that makes; the broad phase and moving obstacles |
//! | [`density`] | rasters of clay that a query reads while another thread computes the next ones |
//! | [`parallel`] | loops on the current rayon pool |
//! | `simd` | what the processor can do, kernels over eight lanes |
//! | `storage` | arrays that are owned or lie in a mapped file; opening files of other programs; memory that is left |
//!
//! # Source
//! McNeely1999 (voxmap and pointshell), Sagardia2008 (distance fields and their generation); each module names its sections.
pub mod contact;
pub mod density;
pub mod mesh;
pub mod parallel;
pub mod part;
mod part_report;
pub mod pointshell;
mod simd;
pub mod spatial;
/// Files and arrays of the bake cache: shared with the program, no part of the interface.
#[doc(hidden)]
pub mod storage;
pub mod voxmap;
