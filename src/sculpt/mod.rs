//! Sculpting: a dynamic implicit point-set surface, the second thing that a hand can touch.
//!
//! # Source
//! Guo2004 (haptic sculpting of dynamic point-set surfaces); equations are numbered as there.

pub mod advect;
pub mod boolean;
pub mod dynamics;
pub mod emboss;
mod error;
pub mod export;
pub mod falloff;
mod least_squares;
mod load;
mod local_fit;
pub mod material_map;
mod neighbours;
pub mod normals;
mod orient;
pub mod paint;
mod point_set;
pub mod pull;
pub mod redistance;
pub mod resample;
mod sample;
mod save;
pub mod session;
mod solid;
pub mod spline;
pub mod studio;
mod surface;
mod whole_file;
pub mod workpiece;

pub use error::SurfaceError;
pub use load::{LoadError, Loaded, NormalSource, complete, load};
pub use neighbours::{Neighbour, Neighbours};
pub use point_set::PointSet;
pub use sample::sample;
pub use save::{save, write};
pub use solid::{Body, Solid};
pub use surface::{Distance, Moved, PointSurface};
pub use workpiece::Workpiece;

#[cfg(test)]
mod shapes;
