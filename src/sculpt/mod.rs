//! Sculpting: a dynamic implicit point-set surface, the second thing that a hand can touch.
//!
//! # Source
//! Guo2004 (haptic sculpting of dynamic point-set surfaces); equations are numbered as there.

pub mod dynamics;
pub mod falloff;
mod point_set;
pub mod pull;

pub use point_set::PointSet;
