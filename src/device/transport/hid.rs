//! HID: a hidraw node. A write to one waits for the bus and may take milliseconds, and hidapi's read allocates when it fails; so two
//! [threads](super::threaded) move the reports.

use core::time::Duration;
use std::ffi::CString;
use std::path::{Path, PathBuf};

use hidapi::{HidApi, HidDevice};

use super::threaded::{Gone, Sink, Source, Threaded};
use super::{FRAME_MAX, Transport, TransportError};
use crate::device::IoPlacement;
use crate::rt::schedule::ThreadRequest;

/// Why a HID node cannot be opened. Cold.
#[derive(Debug, thiserror::Error)]
pub enum HidOpenError {
    /// hidapi refused.
    #[error("cannot open {}: {cause}; install devices/udev/70-hapticd.rules and replug (see `hapticd doctor`)", .path.display())]
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
pub(in crate::device) struct HidLink(Threaded);

impl HidLink {
    /// Opens the node, twice: one handle reads, one writes. Its threads run under SCHED_FIFO where `request` asks for it and the system allows
    /// it. Cold.
    ///
    /// # Errors
    /// See [`HidOpenError`].
    pub(in crate::device) fn open(path: &Path, request: Option<ThreadRequest>) -> Result<Self, HidOpenError> {
        let at = || path.to_owned();
        let name = CString::new(path.as_os_str().as_encoded_bytes()).map_err(|_| HidOpenError::Path { path: at() })?;
        let api = HidApi::new().map_err(|cause| HidOpenError::Open { path: at(), cause })?;
        let open = || api.open_path(&name).map_err(|cause| HidOpenError::Open { path: at(), cause });
        let (source, sink) = (Reports(open()?), Reports(open()?));
        Threaded::start(source, sink, request).map(Self).map_err(|cause| HidOpenError::Thread { path: at(), cause })
    }
}

struct Reports(HidDevice);

impl Source for Reports {
    fn wait(&mut self, buffer: &mut [u8; FRAME_MAX], patience: Duration) -> Result<usize, Gone> {
        let patience_ms = i32::try_from(patience.as_millis()).unwrap_or(i32::MAX);
        self.0.read_timeout(buffer, patience_ms).map_err(|_| Gone)
    }
}

impl Sink for Reports {
    fn put(&mut self, frame: &[u8]) -> Result<(), Gone> {
        self.0.write(frame).map(|_| ()).map_err(|_| Gone)
    }
}

impl Transport for HidLink {
    fn receive(&mut self, buffer: &mut [u8]) -> Result<usize, TransportError> {
        self.0.receive(buffer)
    }

    fn send(&mut self, frame: &[u8]) -> Result<(), TransportError> {
        self.0.send(frame)
    }

    fn io(&self) -> IoPlacement {
        IoPlacement::OwnThread
    }
}
