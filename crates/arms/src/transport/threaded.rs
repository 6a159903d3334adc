//! Bytes moved by two threads of the link's own, for transports whose system calls can block: HID
//! and USB.
//!
//! ```text
//!   servo ── send ───► ring ──► writer thread ──► bus      the newest frame wins: what could not leave in time is skipped
//!   servo ◄─ receive ─ ring ◄── reader thread ◄── bus      every report, in order; of a backlog the oldest and the newest
//! ```
//! The writer sleeps on an eventfd, which costs the servo one non-blocking write.

use core::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use core::time::Duration;
use std::os::fd::OwnedFd;
use std::sync::Arc;
use std::thread::JoinHandle;

use rtrb::{Consumer, Producer, RingBuffer};
use rustix::event::{EventfdFlags, eventfd};

use super::{FRAME_MAX, Frame, TransportError};
use rt::schedule::{self, ThreadRequest};

/// Reports that may wait for the servo: as many as the kernel keeps for a reader.
const REPORTS: usize = 64;
/// Frames that may wait for the bus.
const FRAMES: usize = 8;
/// Places beside them for frames that replace all others.
const FRAMES_NOW: usize = 4;
/// How long the reader waits before it looks whether it is still wanted.
const READ_WAIT: Duration = Duration::from_millis(50);
/// The same while a report waits for a place in the ring.
const HELD_WAIT: Duration = Duration::from_millis(1);
/// How long the last frames may take to leave when the link is closed.
const CLOSE_PATIENCE: Duration = Duration::from_millis(200);

/// The other end is gone, whatever the reason.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Disconnected;

/// Where reports come from. May block and allocate.
pub trait Source: Send + 'static {
    /// Waits for a report for at most `patience`; its length, or 0.
    ///
    /// # Errors
    /// The link is gone.
    fn wait(
        &mut self,
        buffer: &mut [u8; FRAME_MAX],
        patience: Duration,
    ) -> Result<usize, Disconnected>;
}

/// Where frames go. May block and allocate.
pub trait Sink: Send + 'static {
    /// Hands a whole frame to the bus.
    ///
    /// # Errors
    /// The link is gone.
    fn put(&mut self, frame: &[u8]) -> Result<(), Disconnected>;
}

/// Both threads with their rings. RT: `receive` and `send` are safe.
#[derive(Debug)]
pub struct Threaded {
    reports: Consumer<Frame>,
    frames: Producer<Frame>,
    /// Frames given to the writer so far.
    n_frames: u64,
    /// Frames before this one are not to leave any more.
    void_before: Arc<AtomicU64>,
    doorbell: Arc<OwnedFd>,
    lost: Arc<AtomicBool>,
    quit: Arc<AtomicBool>,
    reader: Option<JoinHandle<()>>,
    writer: Option<JoinHandle<()>>,
}

impl Threaded {
    /// Starts both threads, under SCHED_FIFO where `request` asks for it and the system allows it.
    /// Cold.
    ///
    /// # Errors
    /// A thread that the system does not give.
    pub fn start(
        source: impl Source,
        sink: impl Sink,
        request: Option<ThreadRequest>,
    ) -> Result<Self, std::io::Error> {
        let doorbell = Arc::new(eventfd(0, EventfdFlags::CLOEXEC)?);
        let lost = Arc::new(AtomicBool::new(false));
        let quit = Arc::new(AtomicBool::new(false));
        let (report_producer, reports) = RingBuffer::new(REPORTS);
        let (frames, frame_consumer) = RingBuffer::new(FRAMES + FRAMES_NOW);
        let void_before = Arc::new(AtomicU64::new(0));
        let reader = {
            let lost = lost.clone();
            let quit = quit.clone();
            spawn("link-read", request, move || {
                read_reports(source, report_producer, &lost, &quit)
            })?
        };
        // From here on the drop of `link` ends what was started.
        let mut link = Self {
            reports,
            frames,
            n_frames: 0,
            void_before: void_before.clone(),
            doorbell,
            lost,
            quit,
            reader: Some(reader),
            writer: None,
        };
        let doorbell = link.doorbell.clone();
        let lost = link.lost.clone();
        let quit = link.quit.clone();
        let write =
            move || write_frames(sink, frame_consumer, &void_before, &doorbell, &lost, &quit);
        link.writer = Some(spawn("link-write", request, write)?);
        Ok(link)
    }

    fn ring(&self) {
        // A counter: it cannot fill up before the writer has been asked 2⁶⁴ times.
        let _ = rustix::io::write(&*self.doorbell, &1_u64.to_ne_bytes());
    }

    /// The next report.
    ///
    /// # Errors
    /// The link is gone.
    pub fn receive(&mut self, buffer: &mut [u8]) -> Result<usize, TransportError> {
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
    ///
    /// # Errors
    /// The link is gone.
    pub fn send(&mut self, frame: &[u8]) -> Result<(), TransportError> {
        self.push(frame, FRAMES_NOW)
    }

    /// Gives a frame to the writer and takes all others away from it, but for the one that is on
    /// the bus.
    ///
    /// # Errors
    /// The link is gone.
    pub fn send_now(&mut self, frame: &[u8]) -> Result<(), TransportError> {
        // Relaxed: the ring orders what it carries; a writer that sees the number late sends one
        // frame too many.
        self.void_before.store(self.n_frames, Ordering::Relaxed);
        self.push(frame, 0)
    }

    /// `spared`: places that are to stay free.
    fn push(&mut self, frame: &[u8], spared: usize) -> Result<(), TransportError> {
        if self.lost.load(Ordering::Relaxed) {
            return Err(TransportError::Lost);
        }
        let mut outgoing = Frame::default();
        if !outgoing.extend(frame) || self.frames.slots() <= spared {
            return Err(TransportError::Full);
        }
        self.frames.push(outgoing).map_err(|_| TransportError::Full)?;
        self.n_frames += 1;
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

fn read_reports(
    mut source: impl Source,
    mut reports: Producer<Frame>,
    lost: &AtomicBool,
    quit: &AtomicBool,
) {
    let mut buffer = [0; FRAME_MAX];
    // The newest report while the ring is full: the servo has not looked for 64 of them, and wants
    // to know where the arm is now, not where it was.
    let mut held: Option<Frame> = None;
    // Relaxed: the flags are the whole message; the ring orders what it carries itself.
    while !quit.load(Ordering::Relaxed) {
        let came = source.wait(&mut buffer, if held.is_some() { HELD_WAIT } else { READ_WAIT });
        if let Ok(n @ 1..) = came {
            let mut report = Frame::default();
            report.extend(buffer.get(..n).unwrap_or_default());
            if let Some(older) = held.replace(report).filter(|_| !reports.is_full()) {
                let _ = reports.push(older);
            }
        }
        if !reports.is_full()
            && let Some(newest) = held.take()
        {
            let _ = reports.push(newest);
        }
        if came.is_err() {
            lost.store(true, Ordering::Relaxed);
            return;
        }
    }
}

fn write_frames(
    mut sink: impl Sink,
    mut frames: Consumer<Frame>,
    void_before: &AtomicU64,
    doorbell: &OwnedFd,
    lost: &AtomicBool,
    quit: &AtomicBool,
) {
    let mut count = [0; 8];
    let mut n_taken = 0_u64;
    loop {
        // Sleeps until a caller writes to the doorbell.
        if rustix::io::read(doorbell, &mut count).is_err() {
            return;
        }
        let ends = quit.load(Ordering::Relaxed);
        while let Ok(frame) = frames.pop() {
            n_taken += 1;
            // A newer command is under way: this one is too late to be worth the bus. At the end
            // everything leaves that a zero has not replaced.
            if !ends && !frames.is_empty() || n_taken <= void_before.load(Ordering::Relaxed) {
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
    /// Lets the last frames leave, for as long as that is not forever: a bus that hangs must not
    /// hold up the end of the program.
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
        fn wait(
            &mut self,
            buffer: &mut [u8; FRAME_MAX],
            patience: Duration,
        ) -> Result<usize, Disconnected> {
            match self.0.recv_timeout(patience) {
                Ok(bytes) => {
                    buffer[..bytes.len()].copy_from_slice(&bytes);
                    Ok(bytes.len())
                }
                Err(RecvTimeoutError::Timeout) => Ok(0),
                Err(RecvTimeoutError::Disconnected) => Err(Disconnected),
            }
        }
    }

    /// Takes a frame when it is let to.
    struct SlowBus {
        gate: Receiver<()>,
        taken: Sender<Vec<u8>>,
    }

    impl Sink for SlowBus {
        fn put(&mut self, frame: &[u8]) -> Result<(), Disconnected> {
            // A closed gate is a bus without a brake.
            let _ = self.gate.recv();
            self.taken.send(frame.to_vec()).map_err(|_| Disconnected)
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
        let mut link =
            Threaded::start(Bus(source), SlowBus { gate, taken }, None).expect("threads");
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
        let mut link =
            Threaded::start(Bus(source), SlowBus { gate, taken }, None).expect("threads");
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
    fn a_zero_takes_the_place_of_what_a_bus_that_hangs_has_not_taken() {
        let (_to_host, source) = unbounded();
        let (taken, frames) = unbounded();
        let (open, gate) = bounded(0);
        let mut link =
            Threaded::start(Bus(source), SlowBus { gate, taken }, None).expect("threads");
        let sent = (1..100).take_while(|n| link.send(&[*n]).is_ok()).count();
        assert!(sent >= FRAMES, "{sent}");
        for _ in 0..2 {
            link.send_now(&[0]).expect("there is room for it");
        }
        // At the end, when everything leaves.
        drop(open);
        drop(link);
        let left: Vec<Vec<u8>> = frames.try_iter().collect();
        assert!(left.len() <= 3 && left.ends_with(&[vec![0]]), "{left:?}");
        assert!(
            left.iter().all(|frame| *frame == [0] || *frame == [1]),
            "but for the one that was on the bus: {left:?}"
        );
    }

    #[test]
    fn of_a_backlog_the_newest_report_is_kept() {
        let (to_host, source) = unbounded();
        let (taken, _frames) = unbounded();
        let (_open, gate) = bounded(0);
        let mut link =
            Threaded::start(Bus(source), SlowBus { gate, taken }, None).expect("threads");
        for n in 0..200 {
            to_host.send(vec![n]).expect("read");
        }
        while !to_host.is_empty() {
            std::thread::sleep(Duration::from_millis(1));
        }
        let mut last = Vec::new();
        for _ in 0..=REPORTS {
            last = receive_one(&mut link).expect("there");
        }
        assert_eq!(last, [199]);
    }

    #[test]
    fn a_bus_that_hangs_fills_up_and_does_not_hold_up_the_end() {
        let (_to_host, source) = unbounded();
        let (taken, _frames) = unbounded();
        let (_open, gate) = bounded(0);
        let mut link =
            Threaded::start(Bus(source), SlowBus { gate, taken }, None).expect("threads");
        let sent = (0..100).take_while(|_| link.send(&[1]).is_ok()).count();
        assert!((FRAMES..=FRAMES + 1).contains(&sent), "{sent}");
        assert_eq!(link.send(&[1]), Err(TransportError::Full));
        let begin = std::time::Instant::now();
        drop(link);
        assert!(begin.elapsed() >= CLOSE_PATIENCE);
    }
}
