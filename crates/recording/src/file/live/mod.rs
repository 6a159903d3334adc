//! The messages of a recording for connected clients: a server of the Foxglove WebSocket protocol
//! (`foxglove.sdk.v1`).
//!
//! ```text
//!  drain ──ring──► feed ──► channels ──► queues of the crate's server ──► proxy ──► clients
//!             └ full: dropped and counted
//! ```
//! Data in: every record, through a subscriber. Data out: a hundred times a second the newest of
//! them, and what must not be missed of those between: other faults, other scenes, objects that
//! moved.
//!
//! | file | owns |
//! |---|---|
//! | `feed` | which messages leave, and when |
//! | `proxy` | which clients may connect, how many, and how much they may send |
//!
//! Invariants: the drain never waits, and the loop is not even known. Everything is on one thread,
//! with one tokio runtime of its own. Clients can only look: the server takes no messages, no
//! parameters and no services.

mod feed;
mod proxy;

use core::sync::atomic::{AtomicU64, Ordering};
use std::hash::{BuildHasher as _, RandomState};
use std::io;
use std::net::{Ipv4Addr, SocketAddr};
use std::sync::Arc;
use std::thread::JoinHandle;

use foxglove::{Context, FoxgloveError};
use rtrb::RingBuffer;
use tokio::net::{TcpListener, TcpSocket};
use tokio::runtime::{Builder, Runtime};
use tokio::sync::oneshot;

use self::feed::{Channels, Feed, PendingClients};
use self::proxy::{Counts, Proxy};
use super::recorder::Recorder;
use crate::stamped_record::StampedRecord;

/// Records under way: two seconds at 1 kHz.
const RING_RECORDS: usize = 2048;
/// Messages that may wait for one client: a third of a second. The oldest go first.
const BACKLOG_MESSAGES: usize = 256;
/// Connections that wait to be taken in.
const BACKLOG_CONNECTIONS: u32 = 64;

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
            socket.set_send_buffer_size(proxy::BUFFER_BYTES)?;
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
    /// There is no thread or no port for the server.
    pub fn serve(self, recorder: &Recorder, origins: Vec<String>) -> io::Result<LiveServer> {
        let Self { runtime, listener, .. } = self;
        let context = Context::new();
        let channels = Channels::open(&context).map_err(io::Error::other)?;
        let newcomers = Arc::new(PendingClients::default());
        let inner = hidden_loopback();
        let server = context
            .websocket_server()
            .name("hapticd")
            .bind(inner.to_string(), 0)
            .message_backlog_size(BACKLOG_MESSAGES)
            .listener(newcomers.clone());
        let server = runtime.block_on(server.start()).map_err(|error| match error {
            FoxgloveError::Bind(error) => error,
            error => io::Error::other(error),
        })?;
        let counts = Arc::new(Counts::default());
        let proxy = Proxy { inner: (inner, server.port()).into(), origins, counts: counts.clone() };
        let (mut ring, rows) = RingBuffer::<StampedRecord>::new(RING_RECORDS);
        let feed = Feed::new(rows, recorder.scenes.clone(), channels, newcomers);
        let (end, ended) = oneshot::channel::<()>();
        let work = async move {
            tokio::select! {
                () = proxy.run(listener) => {}
                () = feed.run() => {}
                _ = ended => {}
            }
            // Close frames go into sockets that take them at once, or are left out.
            drop(server.stop());
            drop(context);
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

/// A loopback address that is not published: the crate's server behind the proxy asks no page where
/// it is from, so none may find it. With the port that the kernel chooses there are some 10¹¹
/// places to look at. Which it is stands in `/proc/net/tcp` for programs of this machine, which may
/// watch anyway.
fn hidden_loopback() -> Ipv4Addr {
    // The keys of a `RandomState` are random.
    let [.., b, c, d] = RandomState::new().hash_one(std::process::id()).to_be_bytes();
    Ipv4Addr::new(127, 1 + b % 254, c, d)
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
