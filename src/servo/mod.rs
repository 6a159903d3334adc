//! The loop: wait → read → tick → write → publish, in a thread of its own.
//!
//! Data in: an immutable scene (exchanged as a whole when another is offered), poses of movable objects, frames of clay, an arm, a clock, one
//! atomic request.
//! Data out: one [`TickRecord`] per tick through a wait-free ring, and one
//! [`LoopReport`] at the end.
//!
//! Invariant: between the first and the last [`ServoLoop::step`] nothing here allocates, locks, prints or panics, and the only system
//! calls are the clock's sleep and the arm's own. (Under the virtual clock there is one more: a yield while the ring is full.)
//!
//! Invariant: whichever way the loop ends, the last thing that the arm hears is a zero command.
//!
//! [`TickRecord`]: crate::telemetry::TickRecord
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
mod clay;
mod lowered;
mod pace;
mod placing;
mod reins;
mod step;
mod stop_guard;
mod swap;
#[cfg(test)]
pub(crate) mod testing;
mod thread;
mod tuner;

pub use crate::rt::control::{Control, Order, Permit};
pub use clay::{ClayFeed, ClaySlot, PublishError, ToolState};
pub use lowered::Lowered;
pub use pace::{Due, Pace};
pub use placing::{PlaceError, Placer, Wishes};
pub use reins::{ReinEnds, Reins};
pub use step::{Ending, LoopReport, RunPlan, ServoLoop, Step, TickFunction};
pub use stop_guard::StopGuard;
pub use swap::{Refused, Stage, SwapSlot, Swapper};
pub use thread::run_to_end;
pub use tuner::{TuneError, Tuner};
