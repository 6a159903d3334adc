//! Bytes moved by two threads of the link's own, for transports whose system calls can block: HID and USB.
//!
//! ```text
//!   servo ── send ───► ring ──► writer thread ──► bus      the newest frame wins: what could not leave in time is skipped
//!   servo ◄─ receive ─ ring ◄── reader thread ◄── bus      every report, in order
//! ```
//! The writer sleeps on an eventfd, which costs the servo one non-blocking write.

use core::sync::atomic::{AtomicBool, Ordering};
use core::time::Duration;
use std::os::fd::OwnedFd;
use std::sync::Arc;
use std::thread::JoinHandle;

use rtrb::{Consumer, Producer, RingBuffer};
use rustix::event::{EventfdFlags, eventfd};

use super::{FRAME_MAX, Frame, TransportError};
use crate::rt::schedule::{self, ThreadRequest};

/// Reports that may wait for the servo: as many as the kernel keeps for a reader.
const REPORTS: usize = 64;
/// Frames that may wait for the bus.
const FRAMES: usize = 8;
/// How long the reader waits before it looks whether it is still wanted.
const READ_WAIT: Duration = Duration::from_millis(50);
/// How long the last frames may take to leave when the link is closed.
const CLOSE_PATIENCE: Duration = Duration::from_millis(200);

/// The other end is gone, whatever the reason.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Gone;

/// Where reports come from. May block and allocate.
pub(super) trait Source: Send + 'static {
    /// Waits for a report for at most `patience`; its length, or 0.
    fn wait(&mut self, buffer: &mut [u8; FRAME_MAX], patience: Duration) -> Result<usize, Gone>;
}

/// Where frames go. May block and allocate.
pub(super) trait Sink: Send + 'static {
    /// Hands a whole frame to the bus.
    fn put(&mut self, frame: &[u8]) -> Result<(), Gone>;
}

/// Both threads with their rings. RT: `receive` and `send` are safe.
#[derive(Debug)]
pub(super) struct Threaded {
    reports: Consumer<Frame>,
    frames: Producer<Frame>,
    doorbell: Arc<OwnedFd>,
    lost: Arc<AtomicBool>,
    quit: Arc<AtomicBool>,
    reader: Option<JoinHandle<()>>,
    writer: Option<JoinHandle<()>>,
}

impl Threaded {
    /// Starts both threads, under SCHED_FIFO where `request` asks for it and the system allows it. Cold.
    pub(super) fn start(source: impl Source, sink: impl Sink, request: Option<ThreadRequest>) -> Result<Self, std::io::Error> {
        let doorbell = Arc::new(eventfd(0, EventfdFlags::CLOEXEC)?);
        let (lost, quit) = (Arc::new(AtomicBool::new(false)), Arc::new(AtomicBool::new(false)));
        let (report_producer, reports) = RingBuffer::new(REPORTS);
        let (frames, frame_consumer) = RingBuffer::new(FRAMES);
        let reader = {
            let (lost, quit) = (lost.clone(), quit.clone());
            spawn("link-read", request, move || read_reports(source, report_producer, &lost, &quit))?
        };
        // From here on the drop of `link` ends what was started.
        let mut link = Self { reports, frames, doorbell, lost, quit, reader: Some(reader), writer: None };
        let (doorbell, lost, quit) = (link.doorbell.clone(), link.lost.clone(), link.quit.clone());
        link.writer = Some(spawn("link-write", request, move || write_frames(sink, frame_consumer, &doorbell, &lost, &quit))?);
        Ok(link)
    }

    fn ring(&self) {
        // A counter: it cannot fill up before the writer has been asked 2⁶⁴ times.
        let _ = rustix::io::write(&*self.doorbell, &1_u64.to_ne_bytes());
    }

    /// The next report.
    pub(super) fn receive(&mut self, buffer: &mut [u8]) -> Result<usize, TransportError> {
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

    /// Gives a frame to the writer.
    pub(super) fn send(&mut self, frame: &[u8]) -> Result<(), TransportError> {
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

fn read_reports(mut source: impl Source, mut reports: Producer<Frame>, lost: &AtomicBool, quit: &AtomicBool) {
    let mut buffer = [0; FRAME_MAX];
    // Relaxed: the flags are the whole message; the ring orders what it carries itself.
    while !quit.load(Ordering::Relaxed) {
        match source.wait(&mut buffer, READ_WAIT) {
            Ok(0) => {}
            Ok(n) => {
                let mut report = Frame::default();
                report.extend(buffer.get(..n).unwrap_or_default());
                // Full: the servo has not looked for 64 reports, and its stale check has long had its say.
                let _ = reports.push(report);
            }
            Err(Gone) => {
                lost.store(true, Ordering::Relaxed);
                return;
            }
        }
    }
}

fn write_frames(mut sink: impl Sink, mut frames: Consumer<Frame>, doorbell: &OwnedFd, lost: &AtomicBool, quit: &AtomicBool) {
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
            if sink.put(frame.as_slice()).is_err() {
                lost.store(true, Ordering::Relaxed);
                return;
            }
        }
        if ends {
            return;
        }
    }
}

impl Drop for Threaded {
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

#[cfg(test)]
mod tests {
    use crossbeam::channel::{Receiver, RecvTimeoutError, Sender, bounded, unbounded};

    use super::*;

    struct Bus(Receiver<Vec<u8>>);

    impl Source for Bus {
        fn wait(&mut self, buffer: &mut [u8; FRAME_MAX], patience: Duration) -> Result<usize, Gone> {
            match self.0.recv_timeout(patience) {
                Ok(bytes) => {
                    buffer[..bytes.len()].copy_from_slice(&bytes);
                    Ok(bytes.len())
                }
                Err(RecvTimeoutError::Timeout) => Ok(0),
                Err(RecvTimeoutError::Disconnected) => Err(Gone),
            }
        }
    }

    /// Takes a frame when it is let to.
    struct SlowBus {
        gate: Receiver<()>,
        taken: Sender<Vec<u8>>,
    }

    impl Sink for SlowBus {
        fn put(&mut self, frame: &[u8]) -> Result<(), Gone> {
            // A closed gate is a bus without a brake.
            let _ = self.gate.recv();
            self.taken.send(frame.to_vec()).map_err(|_| Gone)
        }
    }

    fn receive_one(link: &mut Threaded) -> Result<Vec<u8>, TransportError> {
        let mut buffer = [0; 64];
        loop {
            let n = link.receive(&mut buffer)?;
            if n > 0 {
                return Ok(buffer[..n].to_vec());
            }
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    #[test]
    fn reports_come_in_order_and_what_came_before_a_loss_is_not_lost() {
        let (to_host, source) = unbounded();
        let (taken, _frames) = unbounded();
        let (open, gate) = bounded(1);
        drop(open);
        let mut link = Threaded::start(Bus(source), SlowBus { gate, taken }, None).expect("threads");
        for n in 0..5 {
            to_host.send(vec![n; 3]).expect("read");
        }
        drop(to_host);
        for n in 0..5 {
            assert_eq!(receive_one(&mut link), Ok(vec![n; 3]));
        }
        assert_eq!(receive_one(&mut link), Err(TransportError::Lost));
        assert_eq!(link.send(&[1]), Err(TransportError::Lost));
    }

    #[test]
    fn a_slow_bus_gets_the_newest_frame_and_a_closing_link_leaves_the_last_one() {
        let (_to_host, source) = unbounded();
        let (taken, frames) = unbounded();
        let (open, gate) = bounded(0);
        let mut link = Threaded::start(Bus(source), SlowBus { gate, taken }, None).expect("threads");
        link.send(&[0]).expect("room");
        // The first frame is on the bus once the gate has let it through.
        open.send(()).expect("taken");
        assert_eq!(frames.recv().expect("sent"), [0]);
        link.send(&[1]).expect("room");
        std::thread::sleep(Duration::from_millis(50));
        for n in 2..=5 {
            link.send(&[n]).expect("room");
        }
        open.send(()).expect("the first of them was under way already");
        assert_eq!(frames.recv().expect("sent"), [1]);
        open.send(()).expect("taken");
        assert_eq!(frames.recv().expect("sent"), [5], "2, 3 and 4 came too late");
        drop(open);
        link.send(&[6]).expect("room");
        drop(link);
        assert_eq!(frames.try_iter().last(), Some(vec![6]));
    }

    #[test]
    fn a_bus_that_hangs_fills_up_and_does_not_hold_up_the_end() {
        let (_to_host, source) = unbounded();
        let (taken, _frames) = unbounded();
        let (_open, gate) = bounded(0);
        let mut link = Threaded::start(Bus(source), SlowBus { gate, taken }, None).expect("threads");
        let sent = (0..100).take_while(|_| link.send(&[1]).is_ok()).count();
        assert!((FRAMES..=FRAMES + 1).contains(&sent), "{sent}");
        assert_eq!(link.send(&[1]), Err(TransportError::Full));
        let begin = std::time::Instant::now();
        drop(link);
        assert!(begin.elapsed() >= CLOSE_PATIENCE);
    }
}
