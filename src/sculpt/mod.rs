//! Sculpting: a dynamic implicit point-set surface, the second thing that a hand can touch.
//!
//! # Source
//! Guo2004 (haptic sculpting of dynamic point-set surfaces); equations are numbered as there.

pub mod advect;
pub mod dynamics;
pub mod falloff;
mod neighbours;
mod point_set;
pub mod pull;
pub mod resample;

pub use point_set::PointSet;
