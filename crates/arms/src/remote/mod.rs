//! An arm on another machine.
//!
//! ```text
//!   workstation                                          beside the arm
//!   servo ─ WiredArm ─ Host ──── COMMAND, 1 kHz ───────► Node ─ Hold ─ limits ─► Device (simulated or real)
//!                       ▲                                  │
//!                       └──────── STATE, 1 kHz ────────────┘  time of the measurement, echo, age of what is echoed
//! ```
//! The node is an arm that speaks our own protocol, open6, one packet to a datagram, and sends
//! states by itself; minor version 1.2 says which host is meant, how old the echoed command was,
//! and how long a force outlives its command. So the host drives it with the driver of every other
//! arm, and measures its delay the same way.
//!
//! Data in and out: frames of a [`Transport`](super::transport::Transport), which may lose, delay
//! and reorder them. The newest wins: what is older than something already taken is dropped and
//! counted.
//!
//! Invariant: silence is zero force. The node holds the last force for some ms, fades it, and then
//! needs a *disabled* command before it listens to *enabled* again; the host calls the same silence
//! a lost link. Invariant: `step` and `feed` do not allocate, lock or block.
//!
//! | file | owns |
//! |---|---|
//! | `packets` | what version 1.2 adds to the packets of open6 |
//! | `host` | the workstation's side: a codec |
//! | `node` | the arm's side: state machine, limits, states |
//! | [`command_hold`] | the force between commands, and after the last one |
//! | `clock` | two clocks and the ways between them |
//! | [`figures`] | figures of both sides for display |
//! | `connect` | how a host comes to a node, and back to it |

mod clock;
pub mod command_hold;
mod connect;
pub mod figures;
mod host;
mod node;
mod packets;

pub use connect::{Dial, RemoteOptions, open};
pub use figures::{LinkFigures, NodeFigures};
pub use host::RemoteHost;
pub use node::{Node, NodeParameters};
