//! Sculpting: a dynamic implicit point-set surface, the second thing that a hand can touch.
//!
//! # Source
//! Guo2004 (haptic sculpting of dynamic point-set surfaces); equations are numbered as there.

mod point_set;

pub use point_set::PointSet;
