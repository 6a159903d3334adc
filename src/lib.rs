//! `hapticd`: open, device-agnostic, 6-DoF haptic rendering with the voxmap-pointshell algorithm.
//!
//! The rooms, in the order in which the data walks them:
//!
//! | room | does |
//! |---|---|
//! | [`spatial`] | poses, twists, wrenches, frames, signs: the shared vocabulary |
//! | [`mesh`] | files and shapes → triangles |
//! | [`voxmap`] | triangles → bricked voxel map: surface, sides, layers, distance, field |
//! | [`pointshell`] | surface voxels → points with inward normals |
//! | [`haptics`] | the tick: contact, filter, coupling, limits |
//! | [`rt`] | every operating-system call of the loop |

pub mod haptics;
pub mod mesh;
pub mod pointshell;
pub mod rt;
pub mod spatial;
pub mod voxmap;
