//! HID: a hidraw node, read and written by two threads of the link's own.
//!
//! A write to a hidraw node waits for the bus and may take milliseconds, and hidapi's read allocates when it fails. So neither happens in the
//! servo:
//!
//! ```text
//!   servo ── send ──► ring ──► writer thread ──► hidraw      the newest frame wins: what could not leave in time is skipped
//!   servo ◄─ receive ─ ring ◄── reader thread ◄── hidraw     every report, in order
//! ```
//! The writer sleeps on an eventfd, which costs the servo one non-blocking write.

use core::sync::atomic::{AtomicBool, Ordering};
use core::time::Duration;
use std::ffi::CString;
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::thread::JoinHandle;

use hidapi::{HidApi, HidDevice};
use rtrb::{Consumer, Producer, RingBuffer};
use rustix::event::{EventfdFlags, eventfd};

use super::{Frame, Transport, TransportError};
use crate::device::IoPlacement;
use crate::rt::schedule::{self, ThreadRequest};

/// Reports that may wait for the servo: as many as the kernel keeps for a reader.
const REPORTS: usize = 64;
/// Frames that may wait for the bus.
const FRAMES: usize = 8;
/// How long the reader waits before it looks whether it is still wanted.
const READ_WAIT: Duration = Duration::from_millis(50);
/// How long the last frames may take to leave when the link is closed.
const CLOSE_PATIENCE: Duration = Duration::from_millis(200);

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
pub struct HidLink {
    reports: Consumer<Frame>,
    frames: Producer<Frame>,
    doorbell: Arc<OwnedFd>,
    lost: Arc<AtomicBool>,
    quit: Arc<AtomicBool>,
    reader: Option<JoinHandle<()>>,
    writer: Option<JoinHandle<()>>,
}

impl HidLink {
    /// Opens the node, twice: one handle reads, one writes. Its threads run under SCHED_FIFO where `request` asks for it and the system allows
    /// it. Cold.
    ///
    /// # Errors
    /// See [`HidOpenError`].
    pub fn open(path: &Path, request: Option<ThreadRequest>) -> Result<Self, HidOpenError> {
        let at = || path.to_owned();
        let name = CString::new(path.as_os_str().as_encoded_bytes()).map_err(|_| HidOpenError::Path { path: at() })?;
        let api = HidApi::new().map_err(|cause| HidOpenError::Open { path: at(), cause })?;
        let open = || api.open_path(&name).map_err(|cause| HidOpenError::Open { path: at(), cause });
        let (to_read, to_write) = (open()?, open()?);
        let thread = |cause: std::io::Error| HidOpenError::Thread { path: at(), cause };
        let doorbell = Arc::new(eventfd(0, EventfdFlags::CLOEXEC).map_err(|errno| thread(errno.into()))?);
        let (lost, quit) = (Arc::new(AtomicBool::new(false)), Arc::new(AtomicBool::new(false)));
        let (report_producer, reports) = RingBuffer::new(REPORTS);
        let (frames, frame_consumer) = RingBuffer::new(FRAMES);
        let reader = {
            let (lost, quit) = (lost.clone(), quit.clone());
            spawn("hid-read", request, move || read_reports(&to_read, report_producer, &lost, &quit)).map_err(thread)?
        };
        let mut link = Self { reports, frames, doorbell, lost, quit, reader: Some(reader), writer: None };
        let (doorbell, lost, quit) = (link.doorbell.clone(), link.lost.clone(), link.quit.clone());
        let writer = spawn("hid-write", request, move || write_frames(&to_write, frame_consumer, &doorbell, &lost, &quit));
        link.writer = Some(writer.map_err(thread)?);
        Ok(link)
    }

    fn ring(&self) {
        // A counter: it cannot fill up before the writer has been asked 2⁶⁴ times.
        let _ = rustix::io::write(&*self.doorbell, &1_u64.to_ne_bytes());
    }
}

fn spawn(
    name: &str,
    request: Option<ThreadRequest>,
    work: impl FnOnce() + Send + 'static,
) -> Result<JoinHandle<()>, std::io::Error> {
    std::thread::Builder::new().name(name.to_owned()).spawn(move || {
        if let Some(request) = request {
            // What was refused shows in the preflight of the servo, which asks for the same.
            schedule::enter_realtime(request);
        }
        work();
    })
}

fn read_reports(device: &HidDevice, mut reports: Producer<Frame>, lost: &AtomicBool, quit: &AtomicBool) {
    let mut buffer = [0; super::FRAME_MAX];
    // Relaxed: the flags are the whole message; the ring orders what it carries itself.
    while !quit.load(Ordering::Relaxed) {
        match device.read_timeout(&mut buffer, i32::try_from(READ_WAIT.as_millis()).unwrap_or(i32::MAX)) {
            Ok(0) => {}
            Ok(n) => {
                let mut report = Frame::default();
                report.extend(buffer.get(..n).unwrap_or_default());
                // Full: the servo has not looked for 64 reports, and its stale check has long had its say.
                let _ = reports.push(report);
            }
            Err(_) => {
                lost.store(true, Ordering::Relaxed);
                return;
            }
        }
    }
}

fn write_frames(device: &HidDevice, mut frames: Consumer<Frame>, doorbell: &OwnedFd, lost: &AtomicBool, quit: &AtomicBool) {
    let mut count = [0; 8];
    loop {
        // Sleeps until somebody rings.
        if rustix::io::read(doorbell, &mut count).is_err() {
            return;
        }
        let ends = quit.load(Ordering::Relaxed);
        while let Ok(frame) = frames.pop() {
            // A newer command is under way: this one is too late to be worth the bus. At the end everything leaves.
            if !ends && !frames.is_empty() {
                continue;
            }
            if device.write(frame.as_slice()).is_err() {
                lost.store(true, Ordering::Relaxed);
                return;
            }
        }
        if ends {
            return;
        }
    }
}

impl Transport for HidLink {
    fn receive(&mut self, buffer: &mut [u8]) -> Result<usize, TransportError> {
        match self.reports.pop() {
            Ok(report) => {
                let bytes = report.as_slice();
                let n = bytes.len().min(buffer.len());
                if let (Some(room), Some(bytes)) = (buffer.get_mut(..n), bytes.get(..n)) {
                    room.copy_from_slice(bytes);
                }
                Ok(n)
            }
            // What came before the loss is still handed out.
            Err(_) if self.lost.load(Ordering::Relaxed) => Err(TransportError::Lost),
            Err(_) => Ok(0),
        }
    }

    fn send(&mut self, frame: &[u8]) -> Result<(), TransportError> {
        if self.lost.load(Ordering::Relaxed) {
            return Err(TransportError::Lost);
        }
        let mut outgoing = Frame::default();
        if !outgoing.extend(frame) {
            return Err(TransportError::Full);
        }
        self.frames.push(outgoing).map_err(|_| TransportError::Full)?;
        self.ring();
        Ok(())
    }

    fn io(&self) -> IoPlacement {
        IoPlacement::OwnThread
    }
}

impl Drop for HidLink {
    /// Lets the last frames leave, for as long as that is not forever: a bus that hangs must not hold up the end of the program.
    fn drop(&mut self) {
        self.quit.store(true, Ordering::Relaxed);
        self.ring();
        let begin = std::time::Instant::now();
        for thread in [self.writer.take(), self.reader.take()].into_iter().flatten() {
            while !thread.is_finished() && begin.elapsed() < CLOSE_PATIENCE {
                std::thread::sleep(Duration::from_millis(1));
            }
            if thread.is_finished() {
                let _ = thread.join();
            }
        }
    }
}
