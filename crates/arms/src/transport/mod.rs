//! Transports: how bytes reach an arm and come back.
//!
//! Data in: whole frames. Data out: reports (HID) or bytes as they come (streams). A transport
//! knows nothing of what they mean.
//!
//! Invariant: [`Transport::receive`], [`Transport::send`] and [`Transport::send_now`] never block
//! and never allocate. Where the system call behind a write can block (HID), a thread of the
//! transport's own makes it.
//!
//! Invariant: no frame waits unseen. [`Transport::unread`] has no default: each transport says how
//! many of its frames the other end has not taken, or keeps none but the newest.
//!
//! | file | owns |
//! |---|---|
//! | `mod` | the trait, and the frame that encoders fill |
//! | `serial` | ttys: CDC, FTDI, pty |
//! | `hid` | hidraw nodes |
//! | `usb` | bulk transfers to an FTDI chip (feature `usb`) |
//! | `service` | another program over a WebSocket |
//! | `threaded` | the two threads of links whose writes can block: `hid`, `usb`, `service`, and a network |
//! | `memory` | a pair of ends in memory, for tests |
//! | `simulated` | the same as a network: delay, jitter, loss, a cut |

mod hid;
mod memory;
mod serial;
mod service;
mod simulated;
pub mod threaded;
#[cfg(feature = "usb")]
mod usb;

pub(crate) use hid::HidLink;
pub use hid::HidOpenError;
pub use memory::{LoopbackEnd, loopback};
pub use serial::SerialError;
pub(crate) use serial::SerialLink;
pub(crate) use service::ServiceLink;
pub use service::{RunningService, ServiceError, running_service};
pub use simulated::{LinkQuality, NetworkEnd, SimulatedNetwork};
#[cfg(feature = "usb")]
pub use usb::UsbError;
#[cfg(feature = "usb")]
pub(crate) use usb::UsbLink;

use std::io;
use std::os::fd::OwnedFd;

use super::IoPlacement;
use rt::clock::monotonic_ns;

/// Longest frame of any protocol, bytes: a RawHID report with its ID is 65, a sync write to seven
/// servos 42, and every packet of a declarative arm has to fit.
pub const FRAME_MAX: usize = 256;

/// One frame, or several that go out in one write. `Copy`: encoders fill it in the loop.
#[derive(Clone, Copy, Debug)]
pub struct Frame {
    bytes: [u8; FRAME_MAX],
    len: usize,
}

impl Default for Frame {
    fn default() -> Self {
        Self { bytes: [0; FRAME_MAX], len: 0 }
    }
}

impl Frame {
    /// Makes the frame empty. RT: safe.
    pub fn clear(&mut self) {
        self.len = 0;
    }

    /// Appends bytes; false, and nothing appended, when they do not fit.
    pub fn extend(&mut self, bytes: &[u8]) -> bool {
        let end = self.len + bytes.len();
        let Some(room) = self.bytes.get_mut(self.len..end) else { return false };
        room.copy_from_slice(bytes);
        self.len = end;
        true
    }

    /// Appends one byte; false when it does not fit.
    pub fn push(&mut self, byte: u8) -> bool {
        self.extend(&[byte])
    }

    /// The bytes of the frame. RT: safe.
    pub fn as_slice(&self) -> &[u8] {
        self.bytes.get(..self.len).unwrap_or_default()
    }

    /// True when it holds nothing.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }
}

/// How what is sent arrives at the other end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Carriage {
    /// One `receive` takes one frame, as HID does.
    Reports,
    /// One `receive` takes whatever bytes there are, as a tty does.
    Stream,
}

/// Why a transport failed. `Copy`, no text: the cold side writes that.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TransportError {
    /// The other end is gone; nothing more will come.
    Lost,
    /// The queue is full; nothing of the frame was sent.
    Full,
    /// The operating system refused with this errno.
    Os(i32),
}

/// What can be set at a serial adapter beside bytes. Transports without such lines ignore it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Line {
    /// Back to the state after plugging in.
    Reset,
    /// 8 data bits, no parity, one stop bit, no flow control.
    Plain8N1,
    /// Forget what was received and not taken.
    PurgeReceived,
    /// Forget what was not yet sent.
    PurgeSent,
    /// Data terminal ready.
    Dtr(bool),
    /// Request to send.
    Rts(bool),
    /// Baud rate.
    Baud(u32),
    /// How long an FTDI adapter collects bytes before it passes them on, ms.
    LatencyMs(u8),
}

/// An open link to an arm.
///
/// RT: `receive`, `send` and `send_now` are safe: a bounded number of non-blocking system calls, no
/// allocation, no lock.
pub trait Transport: Send {
    /// Takes what has come into `buffer` and says how many bytes: one whole report (HID; a longer
    /// one is cut) or what there is of a stream; 0 when nothing has come.
    ///
    /// # Errors
    /// [`TransportError::Lost`] or [`TransportError::Os`].
    fn receive(&mut self, buffer: &mut [u8]) -> Result<usize, TransportError>;

    /// Sends a whole frame in one call. The report ID of HID is its first byte.
    ///
    /// # Errors
    /// See [`TransportError`].
    fn send(&mut self, frame: &[u8]) -> Result<(), TransportError>;

    /// Sends a whole frame in the place of everything that has not left yet: for a zero, which must
    /// not wait behind old commands that an arm has not read. What is dropped may end in the middle
    /// of a frame, so that the arm may find this one garbled: send another one behind it.
    ///
    /// # Errors
    /// As [`Self::send`].
    fn send_now(&mut self, frame: &[u8]) -> Result<(), TransportError> {
        self.send(frame)
    }

    /// Frames that were sent and that the other end has not taken, as far as the system or the
    /// protocol of the link shows; 0 where the newest frame takes the place of the others. An arm
    /// obeys what is unread when it reads again, however late. RT: at most one system call.
    fn unread(&mut self) -> usize;

    /// Sets a line. Cold.
    ///
    /// # Errors
    /// [`TransportError::Lost`] or [`TransportError::Os`].
    fn line(&mut self, line: Line) -> Result<(), TransportError> {
        let _ = line;
        Ok(())
    }

    /// A descriptor that another process can write the same frames to. Cold.
    ///
    /// # Errors
    /// The system refuses, or the link has no such thing.
    fn descriptor(&self) -> io::Result<OwnedFd> {
        Err(io::Error::other("no other process can write to its link"))
    }

    /// What another process writes to [`Self::descriptor`] to send this frame. Cold.
    fn on_wire(&self, frame: &[u8]) -> Vec<u8> {
        frame.to_vec()
    }

    /// Where its bytes are moved.
    fn io(&self) -> IoPlacement {
        IoPlacement::InLoop
    }

    /// Time in the world of the link, ns from an arbitrary zero: a simulated network has its own.
    fn now_ns(&self) -> i64 {
        monotonic_ns()
    }
}

impl<T: Transport + ?Sized> Transport for Box<T> {
    fn receive(&mut self, buffer: &mut [u8]) -> Result<usize, TransportError> {
        (**self).receive(buffer)
    }

    fn send(&mut self, frame: &[u8]) -> Result<(), TransportError> {
        (**self).send(frame)
    }

    fn send_now(&mut self, frame: &[u8]) -> Result<(), TransportError> {
        (**self).send_now(frame)
    }

    fn unread(&mut self) -> usize {
        (**self).unread()
    }

    fn line(&mut self, line: Line) -> Result<(), TransportError> {
        (**self).line(line)
    }

    fn descriptor(&self) -> io::Result<OwnedFd> {
        (**self).descriptor()
    }

    fn on_wire(&self, frame: &[u8]) -> Vec<u8> {
        (**self).on_wire(frame)
    }

    fn io(&self) -> IoPlacement {
        (**self).io()
    }

    fn now_ns(&self) -> i64 {
        (**self).now_ns()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_takes_what_fits() {
        let mut frame = Frame::default();
        assert!(frame.is_empty() && frame.extend(&[1; FRAME_MAX - 1]) && frame.push(2));
        assert!(!frame.push(3) && frame.as_slice().len() == FRAME_MAX);
        frame.clear();
        assert!(frame.is_empty());
    }
}
