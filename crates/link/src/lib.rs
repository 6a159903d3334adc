//! Other machines: records of a loop as messages of ROS 2 without ROS, the names under which
//! `rmw_zenoh` looks for them, and the sessions that send them.
//!
//! ```text
//!  TickRecord ─► topics: which part of it, on which topic ─► messages ─► cdr ─► bytes ─┐
//!                                              names ─► key expression, attachment ────┴─► `publish`
//! ```
//!
//! # Units and frames
//! Those of ROS: SI, quaternions as x, y, z, w; each topic names its frame.
//! `docs/reference/ros2.md` describes every topic.
//!
//! # Cost
//! A message costs its bytes.
//!
//! # Example
//! ```
//! use link::Topic;
//!
//! let [pose, buttons] = [Topic::MeasuredCp, Topic::Joy];
//! assert_eq!((pose.name(), pose.message_type().ros_name()), ("measured_cp", "geometry_msgs/msg/PoseStamped".to_owned()));
//! assert!(!pose.is_occasional() && buttons.is_occasional(), "a pose leaves with every message, buttons when they change");
//! ```
//!
//! # Where to find what
//!
//! | module | owns |
//! |---|---|
//! | `cdr` | numbers, words and lists as little-endian plain CDR |
//! | `messages` | the messages, each with its type name and the hash of its definition |
//! | `topics` | which part of a record is which message, on which topic |
//! | `names` | namespaces, key expressions, liveliness tokens, attachments |
//! | [`publish`] | the thread that sends the newest record of a run, and poses that come for the hand of a simulated arm |
//! | [`network`] | endpoints, sessions, and the link to an arm on another machine |
//!
//! Messages and names are pure and always compiled; [`publish`] and sessions come with the feature
//! `zenoh`. Golden bytes and hashes by libraries that share no code with it are in
//! `tests/fixtures/cdr`.
#![forbid(unsafe_code)]

mod cdr;
mod messages;
mod names;
pub mod network;
pub mod publish;
mod topics;

pub use messages::{
    DiagnosticArray, DiagnosticLevel, DiagnosticStatus, Header, JointState, Joy, Message,
    MessageType, OperatingState, PoseStamped, Time, TwistStamped, WrenchStamped,
};
pub use names::{
    Attachment, Domain, Gid, Namespace, NamespaceError, RosNode, gid, node_token, publisher_token,
    subscriber_token, topic_key,
};
pub use topics::{Topic, TopicInput};
