//! Voxmaps: the sampled volume of one object.
//!
//! The way through: [`grid`] (index arithmetic) → [`surface`] (two navigations over [`sat`]) → [`fill`] (outside, inside) →
//! [`leak`] and [`orient`] (is it a solid, which way do faces point) → [`layers`] → [`distance`] → [`field`] (what the tick
//! reads). `build` runs them in order. Storage is sparse on two levels: a top grid with one entry per brick of 8³ cells, and
//! bricks only where the band passes; a brick without band cells only knows whether it is far outside or deep inside.
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
pub mod npy;
pub mod orient;
pub mod sat;
pub mod sides;
pub mod surface;
pub mod winding;

pub use build::{Options, Stage, Timings, Voxmap};
