//! The mock arm: the simulated plant and hand behind a real link, in the arm's own protocol.
//!
//! ```text
//!  host ══ link ══ firmware ─► motors ─► transmission, J ─► wrench ─► plant ◄── hand
//!                     ▲                                                 │
//!                     └── readings ◄── transmission ◄── inverse ◄───────┘
//! ```
//!
//! It is the hardware of a hardware-in-the-loop test: it has its own clock, its own watchdog and
//! its own faults, and it reports at the end what it felt. Nothing here is part of a real-time loop
//! of the host.
//!
//! | file | owns |
//! |---|---|
//! | `arm` | plant, firmware and faults, period by period |
//! | `linkage` | grip pose into readings, motors into a wrench |
//! | [`builder`] | a mock arm from a profile |
//! | `tally` | what it measured |
//! | [`trace`] | the same while it feels it, line by line in a file |
//! | `link` | the arm's end of a link; the one in memory, for tests |
//! | [`pty`] | a pseudo-terminal |
//! | [`uhid`] | a HID device of the kernel's making |
//! | [`gadget`] | a node that exists: the arm's end of a USB gadget |
//! | [`service`] | a WebSocket server in the place of a service of the arm's maker |
//! | [`serve`] | the real clock |

mod arm;
pub mod builder;
pub mod gadget;
mod link;
pub(crate) mod linkage;
pub mod pty;
pub mod serve;
pub mod service;
mod tally;
#[cfg(test)]
mod tests;
pub mod trace;
pub mod uhid;

pub use arm::{MockArm, MockParameters};
pub use link::{ArmLink, LinkError};
pub use tally::{FaultReport, MockReport, NamedWrench};
