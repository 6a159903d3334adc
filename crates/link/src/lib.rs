//! Other machines: sessions with them, the link to an arm elsewhere, and what a run publishes, as messages of ROS 2 without ROS.
//!
//! Data in: a record of the loop. Data out: messages as bytes, under the names where `rmw_zenoh` looks for them; [`publish`] sends them.
//!
//! | file | owns |
//! |---|---|
//! | `cdr` | numbers, words and lists as little-endian plain CDR |
//! | `messages` | the messages, each with its type name and the hash of its definition |
//! | `topics` | which part of a record is which message, on which topic |
//! | `names` | namespaces, key expressions, liveliness tokens, attachments |
//! | [`publish`] | the thread that sends the newest record of a run |
//! | [`network`] | endpoints, sessions, and the link to an arm on another machine |
//!
//! Invariants: messages and names are pure and always compiled; zenoh comes with the feature `zenoh`. `docs/reference/ros2.md` is its description; golden bytes and hashes by libraries that share no
//! code with it are in `tests/fixtures/cdr`.

mod cdr;
mod messages;
mod names;
pub mod network;
pub mod publish;
mod topics;

pub use messages::{
    DiagnosticArray, DiagnosticStatus, Header, JointState, Joy, Level, Message, MessageType, OperatingState, PoseStamped, Time,
    TwistStamped, WrenchStamped,
};
pub use names::{Attachment, Domain, Gid, Namespace, NamespaceError, Node, gid, node_token, publisher_token, topic_key};
pub use topics::{Moment, Topic};
