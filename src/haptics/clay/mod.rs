//! Clay: material that deforms while it is touched, as the tick sees it.
//!
//! Data in: the newest [`Frame`] of a simulation that runs elsewhere, at its own rate. Data out: contacts, added to those with rigid
//! obstacles.
//!
//! # Source
//! Guo2004, dynamic global volumetric model (density raster), painting tool (direction of the force, virtual contact point).

mod raster;

use std::sync::Arc;

use glam::DVec3;

pub use raster::{Density, Lattice, Raster};

/// The material at one moment of its simulation.
#[derive(Clone, Debug)]
pub struct Frame {
    /// Counts up with every update of the simulation.
    pub sequence: u64,
    /// All of the material at rest, and air around it.
    pub base: Arc<Raster>,
    /// The part that deforms: nodes of it are nodes of `base`, and its outermost nodes have the densities of `base`.
    pub region: Raster,
    /// Where a rope pulls, map frame, m; `None`: no rope is taut.
    pub rope_map: Option<DVec3>,
}

impl Frame {
    /// The density at a point: of the region where it lies in it, of all else otherwise; `None` far away. RT: safe; O(1).
    #[inline]
    pub fn at(&self, point_map: DVec3) -> Option<Density> {
        self.region.at(point_map).or_else(|| self.base.at(point_map))
    }
}
