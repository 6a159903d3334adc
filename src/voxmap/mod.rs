//! Voxmaps: the sampled volume of one object.
//!
//! The way through, which [`Voxmap::build`] runs in order:
//!
//! | stage | files | question |
//! |---|---|---|
//! | | [`estimate`] | what will the bake take, before it begins? |
//! | grid | [`grid`], `bricks` | index arithmetic; sparse sets of bricks |
//! | surface | [`surface`], `navigation`, `columns`, [`sat`] | which voxels does a triangle touch? Two navigations, by columns; the test that specifies them |
//! | fill | [`fill`] | which cells are reached from outside? |
//! | | [`sides`] | what tells inside from outside: the fill, winding numbers or nothing? |
//! | | [`leak`], [`winding`] | did the fill get in; how often does the surface wind around a point? |
//! | | [`lid`] | triangles that close the holes |
//! | | [`orient`] | which way do faces point? |
//! | layers | [`layers`], `growth` | how many voxels from the surface? |
//! | distance | [`distance`] | how many metres? |
//! | field | [`field`] | what the tick reads |
//! | | [`npy`] | layers and distances as files |
//!
//! Storage is sparse on two levels: a top grid with one entry per brick of 8³ cells, and bricks only where the band passes; a
//! brick without band cells only knows whether it is far outside or deep inside.
//!
//! Invariant: results do not depend on the number of threads.
//!
//! Units and frames: the map frame is the mesh file's own frame in metres; *cells* are continuous grid coordinates.

mod bricks;
mod build;
mod columns;
pub mod distance;
pub mod estimate;
pub mod field;
pub mod fill;
pub mod grid;
mod growth;
pub mod layers;
pub mod leak;
pub mod lid;
mod navigation;
pub mod npy;
pub mod orient;
pub mod sat;
pub mod sides;
pub mod surface;
pub mod winding;

pub use build::{Options, Stage, Timings, Voxmap};
