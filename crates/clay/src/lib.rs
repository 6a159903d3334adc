//! Clay: a dynamic implicit point-set surface that a tool pulls, paints, cuts and embosses.
//!
//! ```text
//!  scan, mesh, shape ─► PointSet ─► PointSurface ─► ClayModel ─► DensityFrame (vps::density) ─► tick
//!    load, sample                   surface           ▲    └───► files: points, mesh, session
//!               motions of the tool, orders ─► engine ┘
//! ```
//!
//! # Units and frames
//! Metres and axes of the file that the clay comes from (its map frame); densities are distances,
//! m, greater than 0 inside.
//!
//! # Cost
//! A fit for each sample when a surface is made; a step costs the mass points of the region that
//! moves. Runs in parallel on the current rayon pool, never in the loop; the same calls give the
//! same bits on any number of threads.
//!
//! # Example
//! ```
//! # use glam::DVec3;
//! # use vps::mesh::primitives::Shape;
//! # use clay::{ClayModel, clay_model::Settings, falloff::Falloff, pull::PullForce, sample};
//! // A ball of clay with a radius of 20 mm, pulled at its top for a tenth of a second.
//! let ball = sample(&Shape::Sphere { radius_m: 20e-3 }.tessellate(2e-5), 2e-3)?;
//! let mut model = ClayModel::new(ball, Settings { raster: [24; 3], ..Settings::default() })?;
//! let before_m = model.density_m(DVec3::Z * 20.5e-3);
//! for _ in 0..25 {
//!     let (along_map, force_n) = (vec![DVec3::Z * 20e-3], DVec3::Z * 10.0);
//!     model.pull(&PullForce { along_map, force_n, reach_m: 3e-3, radius_m: 8e-3, falloff: Falloff::Gaussian })?;
//!     model.advance(4e-3);
//! }
//! assert!(model.density_m(DVec3::Z * 20.5e-3) > before_m, "there is more of it now");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Where to find what
//!
//! | module | owns |
//! |---|---|
//! | `load`, `sample`, `normals`, `orient`, `solid` | samples from files, meshes and shapes, and what they lack made good |
//! | `mesh_solid`, `walls` | the solid that a mesh bounds, and whether a raster holds its walls |
//! | `point_set`, `neighbours`, `save` | the samples, which are near a point, and their file |
//! | `local_fit`, `spline`, `least_squares` | the field around one sample |
//! | `surface` | all fits together: distance, side, border, raster |
//! | [`clay_model`] | the clay that is worked on, stroke by stroke, with undo |
//! | [`dynamics`], [`pull`], [`falloff`] | densities as masses on springs, and the forces of a tool on them |
//! | `advect`, `resample`, `redistance`, `topology` | samples and densities after a change of shape |
//! | [`boolean`], [`emboss`], `paint`, [`material_map`] | the other tools: solids that join and cut, images, colour, painted material |
//! | `work_meter` | how much work an order may be, and how it is cancelled |
//! | [`engine`] | what the tool does in a tick → strokes; orders of clients; views |
//! | [`session`], [`export`] | clay as a file, as a closed mesh |
//!
//! # Source
//! Guo2004 (haptic sculpting of dynamic point-set surfaces); equations are numbered as there.
#![forbid(unsafe_code)]

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
mod mesh_solid;
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
mod topology;
mod walls;
mod work_meter;

pub use clay_model::ClayModel;
pub use error::SurfaceError;
pub use load::{LoadError, LoadedPoints, NormalSource, load};
pub use neighbours::{Neighbour, Neighbours};
use point_set::Patch;
pub use point_set::PointSet;
pub use sample::sample;
pub use save::{save, write};
pub use solid::{OpenedSolid, Solid, SolidSource};
use surface::SampleMove;
pub use surface::{Distance, PointSurface};
pub use work_meter::{Cancel, WorkError, WorkMeter};

#[cfg(test)]
mod shapes;
