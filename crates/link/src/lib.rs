//! ROS 2 without ROS: messages as bytes, and the names under which `rmw_zenoh` looks for them.
//!
//! Data in: a record of the loop. Data out: bytes and words, which the room `publish` sends.
//!
//! | file | owns |
//! |---|---|
//! | `cdr` | numbers, words and lists as little-endian plain CDR |
//! | `messages` | the messages, each with its type name and the hash of its definition |
//! | `topics` | which part of a record is which message, on which topic |
//! | `names` | namespaces, key expressions, liveliness tokens, attachments |
//!
//! Invariants: pure, always compiled, knows of no network. `docs/reference/ros2.md` is its description; golden bytes and hashes by libraries that share no
//! code with it are in `tests/fixtures/cdr`.

mod cdr;
mod messages;
mod names;
mod topics;

pub use messages::{
    DiagnosticArray, DiagnosticStatus, Header, JointState, Joy, Level, Message, MessageType, OperatingState, PoseStamped, Time,
    TwistStamped, WrenchStamped,
};
pub use names::{Attachment, Domain, Gid, Namespace, NamespaceError, Node, gid, node_token, publisher_token, topic_key};
pub use topics::{Moment, Topic};
