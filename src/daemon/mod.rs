//! The supervisor: takes a scene from the file to the arm and back to rest.
//!
//! ```text
//!  ┌──────┐  file read  ┌────────┐  baked  ┌──────────┐  enable  ┌──────────┐  ramp up  ┌─────────┐
//!  │ Init ├────────────►│ Baking ├────────►│ Disabled ├─────────►│ Enabling ├──────────►│ Enabled │
//!  └──┬───┘             └───┬────┘         └────┬─────┘          └────┬─────┘           └────┬────┘
//!     │ 3 configuration     │ 3, 4 asset        │ 5 no operator       │ stop, signal,        │
//!     │                     │                   │ 6 refused           │ duration             │
//!     ▼                     ▼                   ▼                     ▼                      ▼
//!   exit                  exit                exit              ┌──────────┐ ◄───────────────┤
//!                                                               │ Stopping │ ramp down       │
//!                                                               └────┬─────┘                 │ any fault, from
//!                                                                    ▼                       ▼ any state above
//!                                                               ┌─────────┐             ┌───────┐
//!                                                  exit 0 ◄─────┤ Stopped │             │ Fault ├──► exit 7
//!                                                               └─────────┘             └───────┘
//! ```
//!
//! While it renders, movable objects take poses and a swap goes once around: Enabled, Stopping,
//! Disabled with zero force, where the scenes are exchanged, Enabling, Enabled. The phases tell it
//! as it is.
//!
//! Force flows in Enabling, Enabled and Stopping only. Every way out, drawn or not, passes the
//! servo's stop guard: the last thing that the arm gets is a zero command.
//!
//! Data in: a prepared [`RenderJob`]. Data out: [`Notice`]s while it runs, one [`RunOutcome`] at
//! the end. Invariant: prints nothing.

pub mod device_node;
pub mod drawing;
mod hand_checks;
mod prepare;
mod recorded;
pub mod reload;
pub mod remote;
mod replay;
mod scene_keys;
pub mod sculpting;
pub mod service;
pub mod session;
mod session_error;
mod supervisor;
#[cfg(test)]
pub(crate) mod testing;
mod unpacked;

pub use hand_checks::HandProblem;
pub use prepare::{
    Inputs, PrepareError, Prepared, RealArmNode, inputs, prepare, prepare_on, prepare_with,
};
pub use recorded::{resolved, scene_files};
pub use replay::{Difference, Gap, ReplayError, Replayed, replay};
pub use scene_keys::{scenes_beside, unlike};
pub use supervisor::{
    Enable, LiveChannels, Notice, Operator, Phase, RenderJob, RunError, RunOutcome, Supervisor,
};
pub use unpacked::{RecordedScene, UnpackError, Unpacked};
