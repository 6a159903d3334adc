//! `haply-service`: the Inverse service of Haply, versions 3.1 to 3.5, which drives an Inverse3 and
//! hears its grip.
//!
//! ```text
//!   loop ── record ── link-write ── JSON ──► WebSocket ──► service ──► arm        one message, one state
//!   loop ◄─ record ── link-read ◄── JSON ◄── WebSocket ◄── service ◄── arm, grip
//! ```
//! Messages are JSON over a WebSocket. Threads of the link read and write them, so that the loop
//! exchanges short records of fixed length.
//!
//! Sources: the pages docs.haply.co/inverseSDK/service and the types of the crate `haply` 1.3.1; no
//! code of theirs was read for ours.
//!
//! | file | owns |
//! |---|---|
//! | `mod` | which arm, grip and service; errors by name |
//! | `record` | what crosses to the loop and back |
//! | `message` | what the client says and hears: JSON |
//! | `host` | the codec over records |
//! | [`service`] | the other end, for mock arms |

mod host;
mod message;
mod record;
pub(crate) mod service;

pub(super) use host::HostCodec;
pub use message::Version;
pub(crate) use message::{ArmOfService, Dialect, Inventory, Reader, command_text};
pub(crate) use record::{COMMAND, greeting, is_gone};
pub(super) use service::Adapted;

/// Where the service listens by itself.
pub(crate) const ADDRESS: &str = "127.0.0.1:10001";

/// What a profile says of the service, its arm and its grip.
#[derive(Clone, Debug, PartialEq)]
pub struct HaplyService {
    /// Host and port of the service.
    pub address: String,
    /// Id of the arm; `None`: the only one.
    pub arm: Option<String>,
    /// Id of the grip; `None`: the only one. No matter where no orientation is measured.
    pub grip: Option<String>,
    /// Whether a grip says how the tool is turned.
    pub has_grip: bool,
    /// Version of the service, where it does not say it itself.
    pub version: Option<Version>,
}

/// Why a state of the service takes the force away.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Trouble {
    NotReady = 1,
    NoPower,
    GripAsleep,
    GripGone,
}

/// What the error code of a sample means.
pub(super) fn error_text(error: u16) -> String {
    let text = match error {
        1 => {
            "the service says that the arm is not ready: look at its lamp and at the service's own \
                page"
        }
        2 => "the arm has no power supply: plug its adapter in",
        3 => {
            "the grip sleeps, and its orientation stands still: take it in the hand or press a \
                button"
        }
        4 => {
            "the service does not hear the grip any more: switch it on, and look at the battery \
                and the dongle"
        }
        _ => return format!("error {error} of the service"),
    };
    text.to_owned()
}

#[cfg(test)]
mod tests;
