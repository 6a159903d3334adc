//! Arms without hardware: the simulated arm, the hand that holds it, and what can be made to go
//! wrong.
//!
//! | file | owns |
//! |---|---|
//! | `arm` | the simulated arm: delay, encoder, faults |
//! | `plant` | the grip as a body, and the hand that holds it |
//! | `parameters` | what both are made of |
//! | [`hand`] | where the hand wants to be, over time |
//! | `hand_control` | what moves the hand: its path, or a client |
//! | [`fault`] | what goes wrong and when |
//!
//! The same arm behind a real link, as a process of its own, is [`mock`](super::mock).

mod arm;
pub mod fault;
pub mod hand;
mod hand_control;
mod parameters;
mod plant;

pub use arm::SimArm;
pub(crate) use arm::saturated;
pub use hand_control::{HandControl, Reach};
pub use parameters::{HandParameters, SimError, SimParameters};
pub(crate) use plant::GripPlant;
