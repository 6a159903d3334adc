//! Serial ports: USB CDC, FTDI adapters, pseudo-terminals.
//!
//! `serialport` opens the port, takes it for itself and sets it to raw bytes. From then on only its
//! file descriptor is used, with non-blocking reads and writes: the crate's own read waits with a
//! timeout and allocates.
#![expect(unsafe_code, reason = "three ioctls, and a descriptor that changes its owner")]

use core::time::Duration;
use std::os::fd::{AsRawFd, FromRawFd, IntoRawFd, OwnedFd};
use std::os::unix::fs::FileTypeExt;
use std::path::{Path, PathBuf};

use rustix::io::Errno;
use rustix::termios::{self, OptionalActions, QueueSelector, SpecialCodeIndex};
use serialport::{DataBits, FlowControl, Parity, SerialPort, StopBits};

use super::{Line, Transport, TransportError};

/// Why a port cannot be opened. Cold.
#[derive(Debug, thiserror::Error)]
pub enum SerialError {
    /// The port is not there, or is held, or may not be opened.
    #[error("cannot open {}: {cause}{}", .path.display(), hint(.cause))]
    Open {
        /// The node.
        path: PathBuf,
        /// Why.
        cause: serialport::Error,
    },
    /// Something else stands there.
    #[error("{} is not a serial port", .path.display())]
    NoPort {
        /// The node.
        path: PathBuf,
    },
    /// The port is open and cannot be set.
    #[error("cannot set up {}: {cause}", .path.display())]
    SetUp {
        /// The node.
        path: PathBuf,
        /// Why.
        cause: std::io::Error,
    },
}

fn hint(cause: &serialport::Error) -> &'static str {
    match cause.kind() {
        serialport::ErrorKind::Io(std::io::ErrorKind::PermissionDenied) => {
            "; install devices/udev/70-hapticd.rules, or join the group of the node (see `hapticd \
                doctor`)"
        }
        serialport::ErrorKind::Io(std::io::ErrorKind::NotFound) => {
            "; is it plugged in? `hapticd devices` lists what there is"
        }
        serialport::ErrorKind::NoDevice => {
            "; is it unplugged, or held by another program? `hapticd devices` names the holder"
        }
        _ => "",
    }
}

/// An open serial port, raw, exclusive, non-blocking.
#[derive(Debug)]
pub(crate) struct SerialLink {
    fd: OwnedFd,
    /// Kept open while the descriptor works: it sets lines, and its drop gives the port free.
    port: serialport::TTYPort,
    backlog: Backlog,
}

impl SerialLink {
    /// Opens a port: raw, 8N1, no flow control, exclusive, low latency where the driver knows it,
    /// both directions flushed. A CDC device ignores the baud rate. Cold.
    ///
    /// # Errors
    /// See [`SerialError`].
    pub(crate) fn open(path: &Path, baud: u32) -> Result<Self, SerialError> {
        // Without opening it: that alone could wait for a carrier.
        if std::fs::metadata(path).is_ok_and(|found| !found.file_type().is_char_device()) {
            return Err(SerialError::NoPort { path: path.to_owned() });
        }
        let port = serialport::new(path.to_string_lossy(), baud)
            .data_bits(DataBits::Eight)
            .parity(Parity::None)
            .stop_bits(StopBits::One)
            .flow_control(FlowControl::None)
            .timeout(Duration::from_millis(1))
            .open_native()
            .map_err(|cause| SerialError::Open { path: path.to_owned(), cause })?;
        Self::over(port)
            .map_err(|errno| SerialError::SetUp { path: path.to_owned(), cause: errno.into() })
    }

    /// The link over a port that is already open.
    fn over(port: serialport::TTYPort) -> Result<Self, Errno> {
        let twin = port.try_clone_native().map_err(|_| Errno::BADF)?;
        // SAFETY: `into_raw_fd` gives the descriptor of the clone away; nothing else closes it.
        let fd = unsafe { OwnedFd::from_raw_fd(twin.into_raw_fd()) };
        let flags = rustix::fs::fcntl_getfl(&fd)?;
        rustix::fs::fcntl_setfl(&fd, flags | rustix::fs::OFlags::NONBLOCK)?;
        let mut attributes = termios::tcgetattr(&fd)?;
        attributes.make_raw();
        // At least one byte: an empty port then says "again", and 0 means that it was hung up.
        attributes.special_codes[SpecialCodeIndex::VMIN] = 1;
        attributes.special_codes[SpecialCodeIndex::VTIME] = 0;
        termios::tcsetattr(&fd, OptionalActions::Now, &attributes)?;
        termios::tcflush(&fd, QueueSelector::IOFlush)?;
        ask_for_low_latency(&fd);
        Ok(Self { fd, port, backlog: Backlog::default() })
    }
}

impl Transport for SerialLink {
    fn receive(&mut self, buffer: &mut [u8]) -> Result<usize, TransportError> {
        let wanted = buffer.len();
        match rustix::io::read(&self.fd, buffer) {
            Ok(0) if wanted > 0 => Err(TransportError::Lost),
            Ok(n) => Ok(n),
            Err(Errno::AGAIN | Errno::INTR) => Ok(0),
            Err(errno) => Err(lost_or(errno)),
        }
    }

    fn send(&mut self, frame: &[u8]) -> Result<(), TransportError> {
        match rustix::io::write(&self.fd, frame) {
            Ok(n) if n == frame.len() => {
                self.backlog.sent(n, || waiting(&self.fd));
                Ok(())
            }
            // A part of a frame is on its way and the arm will find it garbled. Sending the rest
            // later would only move the harm.
            Ok(_) => Err(TransportError::Full),
            Err(Errno::AGAIN | Errno::INTR) => Err(TransportError::Full),
            Err(errno) => Err(lost_or(errno)),
        }
    }

    fn send_now(&mut self, frame: &[u8]) -> Result<(), TransportError> {
        // Drivers that keep no queue refuse, which is fine.
        let _ = termios::tcflush(&self.fd, QueueSelector::OFlush);
        self.send(frame)
    }

    /// As far as the driver knows: a pseudo-terminal knows nothing of what its other end has read.
    fn unread(&mut self) -> usize {
        self.backlog.frames(waiting(&self.fd))
    }

    fn line(&mut self, line: Line) -> Result<(), TransportError> {
        let done = match line {
            Line::PurgeReceived => {
                return termios::tcflush(&self.fd, QueueSelector::IFlush).map_err(lost_or);
            }
            Line::PurgeSent => {
                return termios::tcflush(&self.fd, QueueSelector::OFlush).map_err(lost_or);
            }
            Line::Reset => {
                return termios::tcflush(&self.fd, QueueSelector::IOFlush).map_err(lost_or);
            }
            // As it was opened.
            Line::Plain8N1 => Ok(()),
            Line::Dtr(level) => self.port.write_data_terminal_ready(level),
            Line::Rts(level) => self.port.write_request_to_send(level),
            Line::Baud(baud) => self.port.set_baud_rate(baud),
            // The low-latency flag, asked for at the start, is what a tty has of it.
            Line::LatencyMs(_) => Ok(()),
        };
        done.map_err(|_| TransportError::Os(Errno::INVAL.raw_os_error()))
    }

    fn descriptor(&self) -> std::io::Result<OwnedFd> {
        self.fd.try_clone()
    }
}

impl Drop for SerialLink {
    /// The mark of exclusive use stays on a pseudo-terminal for as long as its other end is open,
    /// and would keep ourselves out.
    fn drop(&mut self) {
        let _ = termios::ioctl_tiocnxcl(&self.fd);
    }
}

/// What ends a link, apart from what is only refused.
fn lost_or(errno: Errno) -> TransportError {
    match errno {
        Errno::IO | Errno::NODEV | Errno::NXIO | Errno::PIPE | Errno::BADF => TransportError::Lost,
        errno => TransportError::Os(errno.raw_os_error()),
    }
}

/// Bytes that the driver has not passed on, as it counts them; 0 from one that does not count. RT:
/// safe; one system call.
fn waiting(fd: &OwnedFd) -> usize {
    let mut waiting: libc::c_int = 0;
    // SAFETY: the descriptor is open; the kernel writes one int.
    let done = unsafe { libc::ioctl(fd.as_raw_fd(), libc::TIOCOUTQ, &raw mut waiting) };
    if done == 0 { usize::try_from(waiting).unwrap_or(0) } else { 0 }
}

/// How many frames wait in a driver, which counts in a unit of its own: `cdc-acm` counts whole
/// buffers, however little is in them.
#[derive(Debug, Default)]
struct Backlog {
    /// Nothing waited just before the next frame.
    is_empty: bool,
    /// Most that one frame has taken in an empty queue; 0: none was sent into one.
    of_a_frame: usize,
    n_measured: u32,
}

/// Frames after which the unit of a driver is known: to ask for it is a system call.
const MEASURED: u32 = 100;

impl Backlog {
    /// Frames in a queue in which so much waits.
    fn frames(&mut self, waiting: usize) -> usize {
        self.is_empty = waiting == 0;
        waiting.checked_div(self.of_a_frame).map_or(0, |_| waiting.div_ceil(self.of_a_frame))
    }

    /// A frame of so many bytes was sent; `waiting` looks again.
    fn sent(&mut self, n_bytes: usize, waiting: impl FnOnce() -> usize) {
        if core::mem::take(&mut self.is_empty) && self.n_measured < MEASURED {
            self.n_measured += 1;
            self.of_a_frame = self.of_a_frame.max(n_bytes).max(waiting());
        }
    }
}

/// The first fields of the kernel's `struct serial_struct` (linux/serial.h), padded to its size.
#[repr(C)]
struct SerialStruct {
    kind: libc::c_int,
    line: libc::c_int,
    port: libc::c_uint,
    irq: libc::c_int,
    flags: libc::c_int,
    rest: [u64; 16],
}

/// Asks the driver to pass bytes on at once (FTDI: a latency timer of 1 ms in place of 16). Drivers
/// without the flag refuse, which is fine.
fn ask_for_low_latency(fd: &OwnedFd) {
    const TIOCGSERIAL: libc::c_ulong = 0x541E;
    const TIOCSSERIAL: libc::c_ulong = 0x541F;
    const ASYNC_LOW_LATENCY: libc::c_int = 1 << 13;
    let mut settings = SerialStruct { kind: 0, line: 0, port: 0, irq: 0, flags: 0, rest: [0; 16] };
    // SAFETY: the descriptor is open; the kernel writes at most its 72-byte struct, which
    // `SerialStruct` exceeds.
    if unsafe { libc::ioctl(fd.as_raw_fd(), TIOCGSERIAL, &raw mut settings) } == 0 {
        settings.flags |= ASYNC_LOW_LATENCY;
        // SAFETY: as above; the kernel only reads.
        unsafe { libc::ioctl(fd.as_raw_fd(), TIOCSSERIAL, &raw const settings) };
    }
}

#[cfg(test)]
mod tests {
    use std::io::{Read, Write};

    use super::*;

    fn pair() -> (serialport::TTYPort, SerialLink) {
        let (mut far, near) = serialport::TTYPort::pair().expect("a pty");
        far.set_timeout(Duration::from_secs(2)).expect("set");
        (far, SerialLink::over(near).expect("set up"))
    }

    #[test]
    fn bytes_pass_both_ways_unchanged_and_nothing_blocks() {
        let (mut far, mut link) = pair();
        let mut buffer = [0; 64];
        assert_eq!(link.receive(&mut buffer), Ok(0));
        let every: Vec<u8> = (0..=255).collect();
        link.send(&every).expect("sent");
        let mut got = [0; 256];
        far.read_exact(&mut got).expect("read");
        assert_eq!(got.as_slice(), every);
        far.write_all(b"\x03\x04\r\n\x11\x13").expect("written");
        let mut seen = Vec::new();
        while seen.len() < 6 {
            let n = link.receive(&mut buffer).expect("open");
            seen.extend_from_slice(&buffer[..n]);
        }
        assert_eq!(seen, b"\x03\x04\r\n\x11\x13", "raw: no signal, no flow control, no line ends");
    }

    #[test]
    fn a_hang_up_is_a_loss_and_a_full_line_is_not() {
        let (far, mut link) = pair();
        let mut n_sent = 0;
        while link.send(&[0x55; 256]).is_ok() {
            n_sent += 1;
            assert!(n_sent < 10_000, "the other end does not read, so it must fill");
        }
        assert_eq!(link.send(&[0x55; 256]), Err(TransportError::Full));
        drop(far);
        assert_eq!(link.receive(&mut [0; 8]), Err(TransportError::Lost));
        assert_eq!(link.send(&[1]), Err(TransportError::Lost));
    }

    /// What an arm that did not read for seconds finds when it reads again.
    #[test]
    fn what_an_arm_has_not_read_does_not_stand_before_a_zero() {
        let (mut far, mut link) = pair();
        let mut n_waiting = 0;
        while link.send(b"P1 0.36\n").is_ok() {
            n_waiting += 1;
        }
        assert!(n_waiting > 2000, "{n_waiting}");
        // Twice: the first may follow half a line. The second takes nothing back, or the first
        // might go with it.
        link.send_now(b"P1 0\n").expect("room has been made");
        link.send(b"P1 0\n").expect("there is room");
        let mut read = Vec::new();
        far.set_timeout(Duration::from_millis(300)).expect("set");
        // Its end is that nothing more comes.
        let _ = far.read_to_end(&mut read);
        let lines: Vec<&[u8]> = read.split_inclusive(|byte| *byte == b'\n').collect();
        // The kernel keeps one page for the reader, which cannot be taken back.
        assert!(lines.len() <= 4096 / 8 + 2, "{} of {n_waiting} lines", lines.len());
        assert_eq!(lines.last(), Some(&&b"P1 0\n"[..]));
    }

    /// Drivers that count bytes, and one that counts whole buffers; in each of them one frame may
    /// still be on its way when the next one is due.
    #[test]
    fn frames_that_wait_are_counted_in_the_unit_of_the_driver() {
        for of_a_frame in [8, 64, 1280] {
            let mut backlog = Backlog::default();
            let mut waiting = 0;
            for n in 0..40 {
                let frames = backlog.frames(waiting);
                assert!(frames <= 1, "an arm that reads: {frames} after {n}");
                waiting += of_a_frame;
                backlog.sent(8, || waiting);
                // One of them is taken late.
                waiting = if n == 20 { of_a_frame } else { 0 };
            }
            for n in 0..40 {
                assert_eq!(backlog.frames(waiting), n, "{of_a_frame} bytes a frame");
                waiting += of_a_frame;
                backlog.sent(8, || waiting);
            }
        }
        // A fast driver has passed a frame on before it is asked.
        let mut backlog = Backlog::default();
        for _ in 0..40 {
            assert_eq!(backlog.frames(0), 0);
            backlog.sent(8, || 0);
        }
        assert_eq!(backlog.frames(24), 3);
    }

    #[test]
    fn a_port_that_was_closed_can_be_opened_again_while_its_other_end_lives() {
        let (far, near) = serialport::TTYPort::pair().expect("a pty");
        let path = std::path::PathBuf::from(near.name().expect("has one"));
        drop(near);
        let link = SerialLink::open(&path, 115_200).expect("free");
        assert!(SerialLink::open(&path, 115_200).is_err(), "held");
        drop(link);
        drop(SerialLink::open(&path, 115_200).expect("free again"));
        drop(far);
    }

    #[test]
    fn a_port_that_is_not_there_says_what_to_look_at() {
        let error = SerialLink::open(Path::new("/dev/no-such-arm"), 115_200)
            .expect_err("nothing there")
            .to_string();
        assert!(error.contains("/dev/no-such-arm") && error.contains("plugged in"), "{error}");
    }
}
