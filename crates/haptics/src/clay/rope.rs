//! The rope tool: a spring from the tool to the place of the clay that was grabbed.
//!
//! # Source
//! Guo2004 (point rope, curve rope: the force acts at a picked place); the bounded spring is that
//! of the coupling.

use glam::DVec3;

use super::super::coupling::{on_diagonal, saturated};
use vps::spatial::{Mat6, Wrench};

/// How a rope pulls.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Rope {
    /// Stiffness, N/m.
    pub stiffness_n_per_m: f64,
    /// Largest force, N, approached smoothly.
    pub force_n: f64,
}

impl Rope {
    /// Force on the tool's centre of mass and its secant stiffness, world axes, with the anchor
    /// `stretch` away. RT: safe.
    pub(super) fn pull(&self, stretch: DVec3) -> (Wrench, Mat6) {
        let (force, stiffness_n_per_m) = saturated(self.stiffness_n_per_m, stretch, self.force_n);
        (Wrench::new(force, DVec3::ZERO), on_diagonal(stiffness_n_per_m, 0.0))
    }
}
