//! Sculpting: a dynamic implicit point-set surface, the second thing that a hand can touch.
//!
//! Data in: samples of a surface ([`load`] and [`sample`] give a [`PointSet`]), forces and orders. Data out: a [`ClayModel`] that they
//! deform, [frames](vps::density::Frame) of it for the tick, files. [`engine`] puts a tool in the hand: it turns what the tick
//! tells of it into strokes, and keeps order among the wishes of several people.
//!
//! Units and frames: metres and axes of the piece (its map frame); densities are distances, m, greater than 0 inside.
//!
//! Invariant: cold and parallel; the same calls give the same bits on any number of threads.
//!
//! # Example
//! ```
//! use glam::DVec3;
//! use vps::mesh::primitives::Shape;
//! use clay::pull::Pull;
//! use clay::clay_model::Settings;
//! use clay::{ClayModel, falloff::Falloff, sample};
//!
//! // A ball of clay of 20 mm, pulled at its top for a tenth of a second.
//! let ball = sample(&Shape::Sphere { radius_m: 20e-3 }.tessellate(2e-5), 2e-3)?;
//! let mut piece = ClayModel::new(ball, Settings { raster: [24; 3], ..Settings::default() })?;
//! let above = DVec3::Z * 20.5e-3;
//! let before_m = piece.density_m(above);
//! let (along_map, force_n) = (vec![DVec3::Z * 20e-3], DVec3::Z * 10.0);
//! for _ in 0..25 {
//!     let along_map = along_map.clone();
//!     piece.pull(&Pull { along_map, force_n, reach_m: 3e-3, radius_m: 8e-3, falloff: Falloff::Gaussian })?;
//!     piece.advance(4e-3);
//! }
//! assert!(piece.density_m(above) > before_m, "there is more of it now");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Source
//! Guo2004 (haptic sculpting of dynamic point-set surfaces); equations are numbered as there.

mod advect;
pub mod boolean;
pub mod clay_model;
pub mod dynamics;
pub mod emboss;
pub mod engine;
mod error;
pub mod export;
pub mod falloff;
mod least_squares;
mod load;
mod local_fit;
pub mod material_map;
mod neighbours;
mod normals;
mod orient;
mod paint;
mod point_set;
pub mod pull;
mod redistance;
mod resample;
mod sample;
mod save;
pub mod session;
mod solid;
mod spline;
mod surface;
mod whole_file;

pub use clay_model::ClayModel;
pub use error::SurfaceError;
pub use load::{LoadError, Loaded, NormalSource, load};
pub use neighbours::{Neighbour, Neighbours};
pub use point_set::PointSet;
pub use sample::sample;
pub use save::{save, write};
pub use solid::{Body, Solid};
use surface::Moved;
pub use surface::{Distance, PointSurface};

#[cfg(test)]
mod shapes;
