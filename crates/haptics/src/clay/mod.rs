//! Clay: material that deforms while it is touched, as the tick sees it.
//!
//! Data in: the newest [`DensityFrame`] of a simulation that runs elsewhere, at its own rate. Data
//! out: contacts, added to those with rigid obstacles, and the pull of a rope.
//!
//! ```text
//!  frame ──► probe: density, way out, virtual contact point ──► sum over the shell ──► residual ──► wrench of the clay
//!        └─► rope ──────────────────────────────────────────────────────────────────────────────► + pull
//! ```
//!
//! # Source
//! Guo2004, dynamic global volumetric model (density raster), painting tool (direction of the
//! force, virtual contact point), force extrapolation.

mod held;
mod residual;
mod rope;

pub use held::ClayForces;
pub(crate) use held::Held;
pub use rope::Rope;

use super::{CouplingMode, CouplingParameters, Parameters};
use vps::density::DensityFrame;
use vps::spatial::Pose;

/// Material in a scene.
#[derive(Clone, Debug)]
pub struct Clay {
    /// Where it stands.
    pub world_from_map: Pose,
    /// As it is before the first update, [made ready](DensityFrame::make_ready).
    pub frame: DensityFrame,
    /// α of the force extrapolation: share of the step at an update that is left one tick later,
    /// 0..1; 0 passes steps through.
    pub smoothing: f64,
    /// How a rope pulls.
    pub rope: Rope,
}

/// A tool that is less deep, in spacings of the nodes, was put down on the clay and does not start
/// inside of it.
pub const PUT_DOWN_SPACINGS: f64 = 0.1;

/// Share of a step that is left after one interval between updates, by default.
const LEFT_AFTER_UPDATE: f64 = 0.1;

/// A rope is so much softer than what holds the arm to the virtual tool, and pulls with this share
/// of the largest force.
const ROPE_SHARE_OF_COUPLING: f64 = 0.25;
const ROPE_N_PER_M_MAX: f64 = 500.0;
const ROPE_SHARE_OF_LIMIT: f64 = 0.5;

impl Clay {
    /// Material of which a new frame comes every `update_period_s`, with a rope that makes no arm
    /// unstable and always leaves force for the contact.
    pub fn new(
        world_from_map: Pose,
        frame: DensityFrame,
        update_period_s: f64,
        parameters: &Parameters,
    ) -> Self {
        let CouplingParameters { stiffness_n_per_m, bound_n_per_m, .. } = parameters.coupling;
        let rope = Rope {
            stiffness_n_per_m: (ROPE_SHARE_OF_COUPLING * stiffness_n_per_m.min(bound_n_per_m))
                .min(ROPE_N_PER_M_MAX),
            force_n: ROPE_SHARE_OF_LIMIT * parameters.limits.force_n,
        };
        Self {
            world_from_map,
            frame,
            smoothing: Self::smoothing_between(update_period_s, parameters.period_s),
            rope,
        }
    }

    /// The α with which nine tenths of a step are felt when the next update comes.
    pub fn smoothing_between(update_period_s: f64, tick_period_s: f64) -> f64 {
        LEFT_AFTER_UPDATE.powf(tick_period_s / update_period_s)
    }
}

impl CouplingMode {
    /// Whether clay can be felt in this coupling. Not in `constraint`: it stands on planes and has
    /// no contact force that could go on smoothly from one update of the clay to the next; each
    /// update would be felt as a jump.
    pub fn feels_clay(self) -> bool {
        self != Self::Constraint
    }
}
