//! The arm's end of a link.

use core::time::Duration;
use std::io;
use std::path::PathBuf;

#[cfg(test)]
use crate::transport::{LoopbackEnd, Transport};

/// Why the arm's end cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum LinkError {
    /// A node of the kernel cannot be opened or set up.
    #[error("cannot {what}: {cause}")]
    Node {
        /// What was tried, with its path.
        what: String,
        /// Why not.
        cause: io::Error,
    },
    /// Another arm, or another program, is behind the link.
    #[error("{} leads to {}, which another program has open; name another link, or remove this one", .link.display(), .taken_by.display())]
    Taken {
        /// The link.
        link: PathBuf,
        /// What it leads to.
        taken_by: PathBuf,
    },
    /// The link cannot be pulled out from this side.
    #[error("the plug of {0} cannot be pulled from here")]
    NoPlug(String),
}

/// The arm's end of a link: a host may come, speak, go and come again.
pub trait ArmLink {
    /// Waits until the host has sent something, at most `timeout`. May return early.
    fn wait(&mut self, timeout: Duration);

    /// Takes what has come: one report, or what there is of a stream; 0 when there is nothing.
    fn receive(&mut self, buffer: &mut [u8]) -> usize;

    /// Sends a frame; false when the host does not take it.
    fn send(&mut self, frame: &[u8]) -> bool;

    /// Pulls the plug.
    ///
    /// # Errors
    /// [`LinkError::NoPlug`] where there is none to be pulled.
    fn unplug(&mut self) -> Result<(), LinkError>;

    /// Puts it in again.
    ///
    /// # Errors
    /// The node cannot be made again.
    fn replug(&mut self) -> Result<(), LinkError>;

    /// Told in every period whether the arm receives nothing. A program that serves an arm leaves
    /// its sockets unread then, and may go on sending.
    fn set_deaf(&mut self, is_deaf: bool) {
        let _ = is_deaf;
    }

    /// Bytes that an arm which wakes takes of a backlog per period: some frames, obeyed one after
    /// the other. A link of whole messages gives one of them.
    fn backlog_share(&self) -> usize {
        128
    }

    /// True after a host has been there and has gone.
    fn is_host_gone(&self) -> bool;
}

/// The arm's end of a link in memory; the host's is a transport.
#[cfg(test)]
#[derive(Debug)]
pub(super) struct Loopback(pub LoopbackEnd);

#[cfg(test)]
impl ArmLink for Loopback {
    fn wait(&mut self, timeout: Duration) {
        std::thread::sleep(timeout.min(Duration::from_micros(100)));
    }

    fn receive(&mut self, buffer: &mut [u8]) -> usize {
        self.0.receive(buffer).unwrap_or(0)
    }

    fn send(&mut self, frame: &[u8]) -> bool {
        self.0.send(frame).is_ok()
    }

    fn unplug(&mut self) -> Result<(), LinkError> {
        self.0.cut();
        Ok(())
    }

    fn replug(&mut self) -> Result<(), LinkError> {
        Err(LinkError::NoPlug("a link in memory".to_owned()))
    }

    fn is_host_gone(&self) -> bool {
        false
    }
}
