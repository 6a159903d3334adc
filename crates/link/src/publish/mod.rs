//! Publishes a run on a network while it goes on (feature `zenoh`).
//!
//! ```text
//!  run ──newest record and state──► sender ──► topics of ROS 2, states for other viewers
//!   ▲────────────pose───────────── hand ◄───── a topic of ROS 2, a key for other programs
//! ```
//! Data in: the newest record of the run and its state, a hundred times a second, from a closure
//! that the program gives. Data out: messages.
//!
//! | file | owns |
//! |---|---|
//! | `plan` | what is asked for, and why it cannot be; always compiled |
//! | `sender` | the thread, and what it takes to begin it |
//! | `ros_topics` | the publishers of a node of ROS 2 |
//! | `hand` | the subscribers: poses for the hand of a simulated arm |
//!
//! Invariant: what comes in is a pose for the hand of a simulated arm, which goes to the closure
//! that takes it. No topic takes a force, sets a parameter or lets force flow; the loop and the
//! clients of a run are not known here.

#[cfg(feature = "zenoh")]
mod hand;
mod plan;
#[cfg(feature = "zenoh")]
mod ros_topics;
#[cfg(feature = "zenoh")]
mod sender;

pub use plan::{PublishError, PublishPlan};
#[cfg(feature = "zenoh")]
pub use sender::{OpenedPublisher, RunState, Sender};
