//! A run of the program: preparation, the [supervisor](engine::supervisor) with the session that
//! changes what is rendered, sculpting, replay.
//!
//! Invariant: prints nothing.

pub mod device_node;
pub mod drawing;
mod hand_checks;
mod prepare;
mod recorded;
pub mod reload;
pub mod remote;
mod replay;
mod run;
mod scene_keys;
pub mod sculpting;
pub mod service;
pub mod session;
mod session_error;
#[cfg(test)]
pub(crate) mod testing;
mod unpacked;

pub use hand_checks::HandProblem;
pub use prepare::{
    Inputs, PrepareError, Prepared, RealArmNode, inputs, prepare, prepare_on, prepare_with,
};
pub use recorded::{resolved, scene_files};
pub use replay::{Difference, Gap, ReplayError, Replayed, replay};
pub use run::{RunSummary, exit_of, render};
pub use scene_keys::{scenes_beside, unlike};
pub use unpacked::{RecordedScene, UnpackError, Unpacked};
