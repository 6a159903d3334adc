//! How a clay model is worked, and why one cannot be.

use glam::DVec3;

use super::super::dynamics::{Integrator, Material};
use super::super::{PointSet, PointSurface, SurfaceError, WorkError, WorkMeter};
use super::{MemoryEstimate, WorkEstimate};
use vps::spatial::{Metres, Place};
use vps::voxmap::memory_limit::MemoryLimit;

/// Nodes of the base raster at most: 128 MiB.
pub(super) const NODES_MAX: usize = 1 << 25;

/// How a clay model is worked.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Samples that a local fit takes into account.
    pub n_neighbours: usize,
    /// The field meets every sample exactly ([`PointSurface::interpolating`]).
    pub interpolates: bool,
    /// Lowest and highest corner of the region that deforms, map frame, m; `None`: all of the
    /// model, and air around it.
    pub region_map: Option<(DVec3, DVec3)>,
    /// Mass points along x, y, z.
    pub raster: [usize; 3],
    /// Air around the clay that clay may be pulled into, m.
    pub air_m: f64,
    /// What it is made of where nothing else was painted.
    pub material: Material,
    /// How densities move on in time.
    pub integrator: Integrator,
}

impl Default for Settings {
    /// The paper's largest raster over the whole model, a centimetre of air, soft clay.
    fn default() -> Self {
        Self {
            n_neighbours: PointSurface::DEFAULT_NEIGHBOURS,
            interpolates: false,
            region_map: None,
            raster: [40; 3],
            air_m: 0.01,
            material: Material::default(),
            integrator: Integrator::default(),
        }
    }
}

impl Settings {
    /// The surface through samples.
    pub(crate) fn surface(
        &self,
        points: PointSet,
        meter: &WorkMeter,
    ) -> Result<PointSurface, SurfaceError> {
        let surface = PointSurface::build_within(points, self.n_neighbours, meter)?;
        Ok(if self.interpolates { surface.interpolating() } else { surface })
    }
}

impl From<WorkError> for ClayModelError {
    fn from(error: WorkError) -> Self {
        Self::Surface(error.into())
    }
}

/// Why a clay model cannot be worked.
#[derive(Debug, thiserror::Error)]
pub enum ClayModelError {
    /// Samples that make no surface.
    #[error(transparent)]
    Surface(#[from] SurfaceError),
    /// Fewer mass points than there is something to interpolate between.
    #[error("a raster of {0:?} mass points is too small; give at least 4 along every axis")]
    Raster([usize; 3]),
    /// A box without inside.
    #[error("the region from {} to {} is empty; its first corner is the lowest, its second the \
        highest", Place(*.0), Place(*.1))]
    Region(DVec3, DVec3),
    /// Nothing of the clay is in it.
    #[error("no part of the surface is in the region from {} to {}", Place(*.0), Place(*.1))]
    Beside(DVec3, DVec3),
    /// Mass points, or samples, too far apart for the walls of the clay.
    #[error(
        "walls of about {} may lose {:.0} % of its volume: mass points of its raster {raster:?} are {} apart, \
            samples {}; {} would hold them",
        Metres(*wall_m), 100.0 * lost_share, Metres(*mass_points_m), Metres(*samples_m),
        Metres(*apart_m)
    )]
    ThinWalls {
        /// Half of what is lost lies in walls thinner than this, m.
        wall_m: f64,
        /// The part of the volume that is lost, by estimate.
        lost_share: f64,
        /// With mass points and samples so far apart walls lose a twentieth of the volume at most,
        /// m.
        apart_m: f64,
        /// Mass points along x, y, z.
        raster: [usize; 3],
        /// How far apart they are, m.
        mass_points_m: f64,
        /// How far apart samples are, m.
        samples_m: f64,
        /// The coarsest raster that holds the walls.
        needed: [usize; 3],
    },
    /// A Boolean that leaves no solid.
    #[error("nothing would be left of the clay")]
    NothingLeft,
    /// More work than a change of this clay may be.
    #[error(
        "it takes {} samples and {} nodes of the raster, {} steps of work, and {most} are possible \
            with this clay", estimate.memory.samples, estimate.memory.nodes, estimate.steps
    )]
    TooMuchWork {
        /// What it takes.
        estimate: WorkEstimate,
        /// Steps that are possible.
        most: u64,
    },
    /// More memory than there is.
    #[error("{} samples and {} nodes of the raster take about {}", estimate.samples, estimate.nodes, limit.exceeded_by(estimate.bytes))]
    Memory {
        /// What it takes.
        estimate: MemoryEstimate,
        /// What may be taken.
        limit: MemoryLimit,
    },
    /// The base would be too large.
    #[error(
        "mass points {} apart make {n_nodes} of them over the whole model, more than {NODES_MAX}",
        Metres(*spacing_m)
    )]
    TooFine {
        /// Between mass points, m.
        spacing_m: f64,
        /// Over the whole model.
        n_nodes: f64,
    },
}
