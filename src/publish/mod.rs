//! What a run tells a network while it goes on, and the worlds that it shares with other runs (feature `zenoh`).
//!
//! ```text
//!  drain ──ring──► observer ──newest record──► sender ──► topics of ROS 2, states, poses of objects that are owned here
//!  other runs ──poses of their objects──► world ──► session ──► loop
//! ```
//! Data in: the newest record of the run, a hundred times a second; poses that others publish. Data out: messages, and poses for the session, as
//! any client sends them.
//!
//! | file | owns |
//! |---|---|
//! | `keys` | names of states, worlds, objects and owners; pure, always compiled |
//! | `plan` | what is asked for, and why it cannot be; always compiled |
//! | `sender` | the thread, and what it takes to begin it |
//! | `ros_topics` | the publishers of a node of ROS 2 |
//! | `claims` | who owns which object of a world |
//! | `world` | poses of a world, out and in |
//!
//! Invariants: the drain never waits for anything here, and the loop is not even known. No topic takes a force, and none lets force flow: whoever
//! reaches the network moves at most objects of a world that this run joined.

#[cfg(feature = "zenoh")]
mod claims;
mod keys;
mod plan;
#[cfg(feature = "zenoh")]
mod ros_topics;
#[cfg(feature = "zenoh")]
mod sender;
#[cfg(feature = "zenoh")]
mod world;

pub use keys::{
    Owner, WorldName, WorldNameError, binary_state_key, owner_key, owner_keys, pose_key, pose_keys, posed_object, state_key,
};
pub use plan::{Plan, PublishError, Share, Topics};
#[cfg(feature = "zenoh")]
pub use sender::{Opened, Sender};
#[cfg(feature = "zenoh")]
pub use world::Tell;
