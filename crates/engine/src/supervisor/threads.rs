//! The threads of a run, and the memory that is locked for them.

use std::thread::JoinHandle;

use crossbeam::channel::{Receiver, Sender, bounded};

use super::job::LiveChannels;
use crate::record::{RecordSubscribers, TickRecord, Watch, drain};
use crate::servo::{LoopReport, ServoLoop, run_to_end};
use arms::Device;
use rt::clock::Clock;
use rt::realtime::{self, Entered};
use rt::schedule::ThreadRequest;

/// The servo thread, ready or running.
pub(super) struct ServoThread {
    pub(super) thread: JoinHandle<Option<LoopReport>>,
    /// What the thread obtained, if it asked for anything; sent once.
    pub(super) entered: Receiver<Option<Entered>>,
    /// A message starts the loop; dropping the sender ends the thread without a tick.
    pub(super) go: Sender<()>,
    /// Never sends: it disconnects when the thread has ended, however it did.
    pub(super) ended: Receiver<()>,
}

/// The loop with all that may change while it runs.
pub(super) fn with_live<C: Clock>(
    servo: ServoLoop<Box<dyn Device>, C>,
    live: LiveChannels,
) -> ServoLoop<Box<dyn Device>, C> {
    let servo = servo.with_commands(live.commands);
    match live.density {
        Some(density) => servo.with_density(density),
        None => servo,
    }
}

/// The servo thread, which waits for a go. Without a `request` it stays an ordinary thread.
pub(super) fn spawn_servo<C: Clock + 'static>(
    servo: ServoLoop<Box<dyn Device>, C>,
    request: Option<ThreadRequest>,
) -> Result<ServoThread, std::io::Error> {
    let (entered_sender, entered) = bounded(1);
    let (go, go_receiver) = bounded(1);
    let (ended_sender, ended) = bounded(1);
    let thread = std::thread::Builder::new().name("servo".to_owned()).spawn(move || {
        let _ended_sender = ended_sender;
        let realtime = request.map(realtime::enter);
        // Channels end here: from `run_to_end` on, the thread only touches atomics and the ring.
        entered_sender.send(realtime.as_ref().map(|thread| thread.entered())).ok()?;
        go_receiver.recv().ok()?;
        Some(run_to_end(servo))
    })?;
    Ok(ServoThread { thread, entered, go, ended })
}

pub(super) fn spawn_drain(
    records: rtrb::Consumer<TickRecord>,
    subscribers: RecordSubscribers,
    events: Sender<Watch>,
) -> Result<JoinHandle<()>, std::io::Error> {
    std::thread::Builder::new().name("drain".to_owned()).spawn(move || {
        drain(records, &subscribers, |watch| {
            // The supervisor outlives the drain; if it has given up, the message is dropped.
            let _ = events.send(watch);
        });
    })
}
