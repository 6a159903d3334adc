//! HID: a hidraw node. A write to one waits for the bus and may take milliseconds, and hidapi's
//! read allocates when it fails; so two [threads](super::threaded) move the reports.

use core::time::Duration;
use std::ffi::CString;
use std::fs::File;
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};

use hidapi::{HidApi, HidDevice};
use rustix::fs::{FlockOperation, Mode, OFlags, flock, open};
use rustix::io::Errno;

use super::threaded::{Disconnected, Sink, Source, Threaded};
use super::{FRAME_MAX, Transport, TransportError};
use crate::IoPlacement;
use rt::schedule::ThreadRequest;

/// Why a HID node cannot be opened. Cold.
#[derive(Debug, thiserror::Error)]
pub enum HidOpenError {
    /// hidapi refused.
    #[error("cannot open {}: {cause}; install devices/udev/70-hapticd.rules and replug (see \
        `hapticd doctor`)", .path.display())]
    Open {
        /// The node.
        path: PathBuf,
        /// Why.
        cause: hidapi::HidError,
    },
    /// The path holds a zero byte.
    #[error("{} is not the path of a node", .path.display())]
    Path {
        /// The path.
        path: PathBuf,
    },
    /// Another driver of arms has it.
    #[error("{} is held by another hapticd", .path.display())]
    Locked {
        /// The node.
        path: PathBuf,
    },
    /// No thread, no eventfd.
    #[error("cannot start the threads of {}: {cause}", .path.display())]
    Thread {
        /// The node.
        path: PathBuf,
        /// Why.
        cause: std::io::Error,
    },
}

/// An open hidraw node.
#[derive(Debug)]
pub(crate) struct HidLink {
    threads: Threaded,
    path: PathBuf,
    /// Any number of processes may open a hidraw node, and two drivers on one arm would take turns
    /// with its motors.
    _lock: Option<OwnedFd>,
}

/// Takes the node for this link. `None`: it cannot be opened, which opening it for good will say
/// better.
fn lock(path: &Path) -> Result<Option<OwnedFd>, HidOpenError> {
    let Ok(file) = open(path, OFlags::RDONLY | OFlags::NONBLOCK | OFlags::CLOEXEC, Mode::empty())
    else {
        return Ok(None);
    };
    match flock(&file, FlockOperation::NonBlockingLockExclusive) {
        Err(Errno::WOULDBLOCK) => Err(HidOpenError::Locked { path: path.to_owned() }),
        _ => Ok(Some(file)),
    }
}

impl HidLink {
    /// Opens the node, twice: one handle reads, one writes. Its threads run under SCHED_FIFO where
    /// `request` asks for it and the system allows it. Cold.
    ///
    /// # Errors
    /// See [`HidOpenError`].
    pub(crate) fn open(path: &Path, request: Option<ThreadRequest>) -> Result<Self, HidOpenError> {
        let at = || path.to_owned();
        let name = CString::new(path.as_os_str().as_encoded_bytes())
            .map_err(|_| HidOpenError::Path { path: at() })?;
        let lock = lock(path)?;
        let api = HidApi::new().map_err(|cause| HidOpenError::Open { path: at(), cause })?;
        let open =
            || api.open_path(&name).map_err(|cause| HidOpenError::Open { path: at(), cause });
        let source = Reports(open()?);
        let sink = Reports(open()?);
        let threads = Threaded::start(source, sink, request)
            .map_err(|cause| HidOpenError::Thread { path: at(), cause })?;
        Ok(Self { threads, path: at(), _lock: lock })
    }
}

struct Reports(HidDevice);

impl Source for Reports {
    fn wait(
        &mut self,
        buffer: &mut [u8; FRAME_MAX],
        patience: Duration,
    ) -> Result<usize, Disconnected> {
        let patience_ms = i32::try_from(patience.as_millis()).unwrap_or(i32::MAX);
        self.0.read_timeout(buffer, patience_ms).map_err(|_| Disconnected)
    }
}

impl Sink for Reports {
    fn put(&mut self, frame: &[u8]) -> Result<(), Disconnected> {
        self.0.write(frame).map(|_| ()).map_err(|_| Disconnected)
    }
}

impl Transport for HidLink {
    fn receive(&mut self, buffer: &mut [u8]) -> Result<usize, TransportError> {
        self.threads.receive(buffer)
    }

    fn send(&mut self, frame: &[u8]) -> Result<(), TransportError> {
        self.threads.send(frame)
    }

    /// A handle of its own: hidapi does not give its one away.
    fn descriptor(&self) -> std::io::Result<OwnedFd> {
        Ok(File::options().write(true).open(&self.path)?.into())
    }

    fn send_now(&mut self, frame: &[u8]) -> Result<(), TransportError> {
        self.threads.send_now(frame)
    }

    /// The newest frame wins: but for one on the bus there is no older one.
    fn unread(&mut self) -> usize {
        0
    }

    fn io(&self) -> IoPlacement {
        IoPlacement::OwnThread
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_driver_at_a_time_has_a_node() {
        let node = tempfile::NamedTempFile::new().expect("a file in its place");
        let first = lock(node.path()).expect("free");
        assert!(matches!(lock(node.path()), Err(HidOpenError::Locked { .. })));
        drop(first);
        assert!(lock(node.path()).expect("free again").is_some());
        assert!(lock(Path::new("/dev/no-such-arm")).expect("nothing to hold").is_none());
    }
}
