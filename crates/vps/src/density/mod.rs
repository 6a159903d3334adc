//! Densities of a material that deforms, as rasters that a query reads while another thread
//! computes the next ones.
//!
//! A density is a distance in metres, above 0 inside of the material. Rasters lie in the material's
//! map frame; a [`Probe`] asks one for body axes.
//!
//! # Source
//! Guo2004, dynamic global volumetric model (density raster), painting tool (direction of the
//! force, virtual contact point).

mod probe;
mod raster;

use std::sync::Arc;

use glam::DVec3;

pub use probe::{Probe, WayOut};
pub use raster::{Density, Lattice, Raster};

/// The material at one moment of its simulation.
#[derive(Clone, Debug)]
pub struct DensityFrame {
    /// Counts up with every update of the simulation.
    pub sequence: u64,
    /// All of the material at rest, and air around it. To be [measured](Raster::measure) before it
    /// is shared.
    pub base: Arc<Raster>,
    /// The part that deforms: nodes of it are nodes of `base`, and its outermost nodes have the
    /// densities of `base`.
    pub region: Raster,
    /// Where a rope pulls, map frame, m; `None`: no rope is taut.
    pub rope_map: Option<DVec3>,
    /// The surface is elsewhere than in the frame before without having moved there, such as after
    /// a Boolean: the force follows slowly.
    pub is_leap: bool,
}

/// Why a frame cannot be touched.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum FrameError {
    /// Too small to interpolate in.
    #[error("the {which} of the clay has {dims:?} nodes; give it at least 2 along every axis")]
    Dims {
        /// `base` or `region`.
        which: &'static str,
        /// As given.
        dims: [usize; 3],
    },
    /// No length.
    #[error(
        "the nodes of the {which} of the clay are {spacing_m} m apart; give a finite distance \
            above 0"
    )]
    Spacing {
        /// `base` or `region`.
        which: &'static str,
        /// As given.
        spacing_m: f64,
    },
    /// Two lattices that do not fit.
    #[error(
        "the region of the clay has its first node at node {node} of the base; take whole nodes of \
            the base, and its spacing"
    )]
    Lattice {
        /// In nodes of the base.
        node: DVec3,
    },
    /// A simulation that has burst.
    #[error(
        "a density of the {which} of the clay is not finite; halve the step of the simulation or \
            raise its damping"
    )]
    NotFinite {
        /// `base` or `region`.
        which: &'static str,
    },
    /// Its distances are unknown.
    #[error(
        "the base of the clay was changed and not measured; call `Raster::measure` before it is \
            shared"
    )]
    Unmeasured,
    /// Nowhere.
    #[error("the anchor of the rope is at {anchor_map} m, which is not finite")]
    Anchor {
        /// As given.
        anchor_map: DVec3,
    },
}

impl DensityFrame {
    /// The density at a point: of the region where it lies in it, of all else otherwise; `None` far
    /// away. RT: safe; O(1).
    #[inline]
    pub fn at(&self, point_map: DVec3) -> Option<Density> {
        self.region.at(point_map).or_else(|| self.base.at(point_map))
    }

    /// Checks a frame and measures its region: what has to be done before it goes to the tick. The
    /// base is looked at only when it is not `known`, the one of an earlier frame. Cold; O(nodes).
    ///
    /// # Errors
    /// See [`FrameError`].
    pub fn make_ready(&mut self, known: Option<&Arc<Raster>>) -> Result<(), FrameError> {
        for (which, raster) in [("base", &*self.base), ("region", &self.region)] {
            let Lattice { spacing_m, dims, .. } = *raster.lattice();
            if dims.iter().any(|n| *n < 2) {
                return Err(FrameError::Dims { which, dims });
            }
            if !(spacing_m > 0.0 && spacing_m.is_finite()) {
                return Err(FrameError::Spacing { which, spacing_m });
            }
        }
        let base = self.base.lattice();
        let region = self.region.lattice();
        let node = (region.origin_map - base.origin_map) / base.spacing_m;
        let same_spacing = (region.spacing_m / base.spacing_m - 1.0).abs() < 1e-6;
        if !(same_spacing && (node - node.round()).abs().max_element() < 1e-3) {
            return Err(FrameError::Lattice { node });
        }
        if let Some(anchor_map) = self.rope_map.filter(|anchor| !anchor.is_finite()) {
            return Err(FrameError::Anchor { anchor_map });
        }
        let is_finite =
            |raster: &Raster| raster.values_m().iter().all(|value_m| value_m.is_finite());
        if !known.is_some_and(|known| Arc::ptr_eq(known, &self.base)) {
            if !is_finite(&self.base) {
                return Err(FrameError::NotFinite { which: "base" });
            }
            if !self.base.steepest().is_finite() {
                return Err(FrameError::Unmeasured);
            }
        }
        if !is_finite(&self.region) {
            return Err(FrameError::NotFinite { which: "region" });
        }
        self.region.measure();
        Ok(())
    }
}
