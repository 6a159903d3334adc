//! The messages of a recording for connected clients: a server of the Foxglove WebSocket protocol
//! (`foxglove.sdk.v1`).
//!
//! ```text
//!  drain ──ring──► feed ──queue of each client──► client
//!             └ full: dropped and counted  └ full: the oldest go
//! ```
//! Data in: every record, through a subscriber. Data out: a hundred times a second the newest of
//! them, and what must not be missed of those between: other faults, other scenes, objects that
//! moved.
//!
//! | file | owns |
//! |---|---|
//! | `feed` | which messages leave, and when |
//! | `client` | which clients may connect, how many, and what each of them is sent |
//!
//! Invariants: the drain never waits, and the loop is not even known. Everything is on one thread,
//! with one tokio runtime of its own. Clients can only look: the server takes no messages, no
//! parameters and no services.

mod client;
mod feed;

use core::sync::atomic::{AtomicU64, Ordering};
use core::time::Duration;
use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::thread::JoinHandle;

use rtrb::RingBuffer;
use tokio::net::{TcpListener, TcpSocket};
use tokio::runtime::{Builder, Runtime};
use tokio::sync::{Semaphore, broadcast, oneshot, watch};
use tokio::time::timeout;

use self::client::{Gate, MOST_CLIENTS};
use self::feed::Feed;
use super::channels::Channel;
use super::messages::Occasion;
use super::recorder::Recorder;
use crate::stamped_record::StampedRecord;
use haptics::Faults;

/// Records under way: two seconds at 1 kHz.
const RING_RECORDS: usize = 2048;
/// Messages that may wait for one client: a third of a second. The oldest go first.
const BACKLOG_MESSAGES: usize = 256;
/// Connections that wait to be taken in.
const BACKLOG_CONNECTIONS: u32 = 64;
/// What the kernel keeps for a client that reads slowly, bytes: states in there are old ones.
const BUFFER_BYTES: u32 = 64 << 10;
/// How long the end of a run waits for sockets that take a close frame.
const CLOSE_PATIENCE: Duration = Duration::from_millis(200);

/// A message of a topic.
#[derive(Clone, Debug)]
struct LiveMessage {
    channel_id: u32,
    stamp_ns: u64,
    bytes: Arc<Vec<u8>>,
}

/// The number of a topic of ticks.
fn channel_id(channel: Channel) -> u32 {
    1 + channel as u32
}

/// The number of another topic.
fn occasion_id(occasion: Occasion) -> u32 {
    1 + Channel::ALL.len() as u32 + occasion as u32
}

/// What reached no client. All `Relaxed`: each number stands for itself.
#[derive(Debug, Default)]
struct Counts {
    records: AtomicU64,
    turned_away: AtomicU64,
    cut_off: AtomicU64,
}

/// An address that is bound, before the server answers any client there.
#[derive(Debug)]
pub struct BoundLiveServer {
    runtime: Runtime,
    listener: TcpListener,
    address: SocketAddr,
}

impl BoundLiveServer {
    /// Takes an address, which has to be of this machine alone: the protocol carries no token.
    ///
    /// # Errors
    /// It is not a loopback address, or is taken.
    pub fn bind(address: SocketAddr) -> io::Result<Self> {
        if !address.ip().is_loopback() {
            return Err(io::Error::new(
                io::ErrorKind::InvalidInput,
                "other machines could reach it, and this protocol carries no token",
            ));
        }
        let runtime = Builder::new_current_thread().enable_io().enable_time().build()?;
        let listener = {
            let _inside = runtime.enter();
            let socket = if address.is_ipv4() { TcpSocket::new_v4() } else { TcpSocket::new_v6() }?;
            socket.set_reuseaddr(true)?;
            // Connections inherit it.
            socket.set_send_buffer_size(BUFFER_BYTES)?;
            socket.bind(address)?;
            socket.listen(BACKLOG_CONNECTIONS)?
        };
        let address = listener.local_addr()?;
        Ok(Self { runtime, listener, address })
    }

    /// The address, with the port that port 0 became.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Begins to answer; what is to be seen comes with the ticks. `origins`: web pages that are
    /// welcome beside those of this machine and Foxglove's own.
    ///
    /// # Errors
    /// There is no thread for the server.
    pub fn serve(self, recorder: &Recorder, origins: Vec<String>) -> io::Result<LiveServer> {
        let Self { runtime, listener, .. } = self;
        let counts = Arc::new(Counts::default());
        let (messages, _) = broadcast::channel(BACKLOG_MESSAGES);
        let (scene, shown) = watch::channel(None);
        let gate =
            Gate { messages: messages.clone(), scene: shown, origins, counts: counts.clone() };
        let (mut ring, rows) = RingBuffer::<StampedRecord>::new(RING_RECORDS);
        let feed = Feed {
            rows,
            scenes: recorder.scenes.clone(),
            messages,
            scene,
            scene_idx: None,
            faults: Faults::NONE,
        };
        let slots = Arc::new(Semaphore::new(MOST_CLIENTS));
        let (end, ended) = oneshot::channel::<()>();
        let work = async move {
            tokio::select! {
                () = gate.run(listener, slots.clone()) => {}
                () = feed.run() => {}
                _ = ended => {}
            }
            // Their queue has ended: clients are closed, those that take nothing are left.
            let _ = timeout(CLOSE_PATIENCE, slots.acquire_many(MOST_CLIENTS as u32)).await;
        };
        let thread = std::thread::Builder::new()
            .name("foxglove".to_owned())
            .spawn(move || runtime.block_on(work))?;
        let noted = counts.clone();
        let mut stamps = recorder.stamps();
        recorder.subscribers().add(Box::new(move |record| {
            let dropped = noted.records.load(Ordering::Relaxed);
            if ring.push(stamps.row(record, dropped)).is_err() {
                noted.records.store(dropped + 1, Ordering::Relaxed);
            }
            !ring.is_abandoned()
        }));
        Ok(LiveServer { counts, end: Some(end), thread: Some(thread) })
    }
}

/// What reached no client.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LiveSummary {
    /// Ticks that the server was too slow for; of each only a share would have been shown.
    pub dropped: u64,
    /// Connections that found no place, or came from a page that is not welcome.
    pub turned_away: u64,
    /// Clients that took nothing for too long.
    pub cut_off: u64,
}

/// A server at work. It ends when it is dropped.
#[derive(Debug)]
pub struct LiveServer {
    counts: Arc<Counts>,
    end: Option<oneshot::Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl LiveServer {
    /// What it has come to so far.
    pub fn status(&self) -> LiveSummary {
        let count = |count: &AtomicU64| count.load(Ordering::Relaxed);
        let Counts { records, turned_away, cut_off } = &*self.counts;
        LiveSummary {
            dropped: count(records),
            turned_away: count(turned_away),
            cut_off: count(cut_off),
        }
    }
}

impl Drop for LiveServer {
    fn drop(&mut self) {
        drop(self.end.take());
        if let Some(thread) = self.thread.take() {
            // A server that panicked has nothing more to say.
            let _ = thread.join();
        }
    }
}
