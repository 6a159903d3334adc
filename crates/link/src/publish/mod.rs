//! Publishes a run on a network while it goes on (feature `zenoh`).
//!
//! ```text
//!  run ──newest record and state──► sender ──► topics of ROS 2, states for other viewers
//! ```
//! Data in: the newest record of the run and its state, a hundred times a second, from a closure that the program gives. Data out: messages.
//!
//! | file | owns |
//! |---|---|
//! | `plan` | what is asked for, and why it cannot be; always compiled |
//! | `sender` | the thread, and what it takes to begin it |
//! | `ros_topics` | the publishers of a node of ROS 2 |
//!
//! Invariant: data goes out only. No topic takes a force, sets a parameter or lets force flow; the loop and the clients of a run are not known here.

mod plan;
#[cfg(feature = "zenoh")]
mod ros_topics;
#[cfg(feature = "zenoh")]
mod sender;

pub use plan::{PublishError, PublishPlan};
#[cfg(feature = "zenoh")]
pub use sender::{OpenedPublisher, RunState, Sender};
