//! The loop: wait → read → tick → write → publish, in a thread of its own.
//!
//! Data in: an immutable scene (exchanged as a whole when another is offered), one ring of
//! commands, frames of densities, an arm, a clock, one atomic request. Data out: one [`TickRecord`] per
//! tick through a wait-free ring, and one [`LoopReport`] at the end.
//!
//! Invariant: between the first and the last [`ServoLoop::step`] nothing here allocates, locks,
//! prints or panics, and the only system calls are the clock's sleep and the arm's own. (Simulated
//! time also waits for what is full or owed, by a yield or asleep: `waiting`.)
//!
//! Invariant: whichever way the loop ends, the last command that the arm gets is zero.
//!
//! [`TickRecord`]: crate::record::TickRecord
#![deny(
    clippy::disallowed_methods,
    clippy::disallowed_macros,
    clippy::disallowed_types,
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::indexing_slicing
)]

mod calibration;
mod commands;
mod deadlines;
mod density;
mod loaded_scene;
mod paths;
mod step;
mod stop_guard;
#[cfg(test)]
pub(crate) mod testing;
mod thread;
mod waiting;

pub use commands::{
    CommandQueue, ControlError, FileChange, HandOrder, HandUse, Objects, ParameterSetting,
    SceneControls, SwapError,
};
pub use deadlines::{DeadlineGrid, TickTiming};
pub use density::{DensityFeed, DensitySlot, FramePublishError, ToolState};
pub use loaded_scene::LoadedScene;
pub use paths::ObjectPaths;
pub use rt::control::{Control, Order, Permit};
pub use step::{Ending, LoopReport, RunPlan, ServoLoop, Step, TickFunction};
pub use stop_guard::StopGuard;
pub use thread::run_to_end;
pub use waiting::Waiting;
