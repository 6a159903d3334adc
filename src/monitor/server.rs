//! The server: one thread, one runtime.

use core::time::Duration;
use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::thread::JoinHandle;

use tokio::net::{TcpListener, TcpSocket};
use tokio::runtime::{Builder, Runtime};
use tokio::sync::{Semaphore, watch};

use super::access::{Access, Token};
use super::app_state::AppState;
use super::connection::{ConnectionListener, Peer};
use super::feed::feed;
use super::hub::Hub;
use super::object_cache::ObjectCache;
use super::rate_limiter::RateLimiter;
use super::rest::router;
use super::state_publisher::StatePublisher;
use super::worker::Worker;
use recording::Subscriber;

/// WebSockets at the same time.
const MOST_WEB_SOCKETS: usize = 64;
/// Connections that wait to be taken in.
const BACKLOG: u32 = 1024;
/// What the kernel keeps for a client that reads slowly, bytes: states in there are old ones.
const SEND_BUFFER_BYTES: u32 = 64 << 10;
/// What it keeps of a client that sends faster than this server reads, bytes: an order waits behind
/// no more than that.
const RECEIVE_BUFFER_BYTES: u32 = 64 << 10;
/// How long good-byes may take at the end of a run: for the rest of what a slow page has not read
/// yet.
const GOOD_BYE: Duration = Duration::from_secs(3);

/// An address that is taken, before any client is answered there.
pub struct BoundMonitor {
    runtime: Runtime,
    listener: TcpListener,
    access: Access,
    address: SocketAddr,
}

impl BoundMonitor {
    /// Takes an address. `token`: clients need it; `origins`: pages of other servers that may.
    ///
    /// # Errors
    /// The address is taken, or not one of this machine.
    pub fn bind(
        address: SocketAddr,
        token: Option<Token>,
        origins: Vec<String>,
    ) -> io::Result<Self> {
        let runtime = Builder::new_current_thread().enable_io().enable_time().build()?;
        let listener = {
            let _inside = runtime.enter();
            let socket = if address.is_ipv4() { TcpSocket::new_v4() } else { TcpSocket::new_v6() }?;
            socket.set_reuseaddr(true)?;
            // Connections inherit it.
            socket.set_send_buffer_size(SEND_BUFFER_BYTES)?;
            socket.set_recv_buffer_size(RECEIVE_BUFFER_BYTES)?;
            socket.bind(address)?;
            socket.listen(BACKLOG)?
        };
        let address = listener.local_addr()?;
        Ok(Self { runtime, listener, access: Access::new(address, token, origins), address })
    }

    /// The address, with the port that port 0 became.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Begins to answer.
    ///
    /// # Errors
    /// A thread could not be started.
    pub fn serve(self, hub: Arc<Hub>) -> io::Result<(Monitor, Subscriber)> {
        let Self { runtime, listener, access, .. } = self;
        let shapes = Worker::new("monitor-mesh")?;
        let state = Arc::new(AppState {
            hub: hub.clone(),
            access,
            visuals: ObjectCache::new(shapes.clone()),
            voxels: ObjectCache::new(shapes.clone()),
            points: ObjectCache::new(shapes.clone()),
            shapes,
            uploads: Worker::new("monitor-upload")?,
            upload_turn: Arc::new(Semaphore::new(1)),
            files: Worker::new("monitor-file")?,
            seats: Arc::new(Semaphore::new(MOST_WEB_SOCKETS)),
            rate_limiter: RateLimiter::default(),
        });
        let (subscriber, fed) = feed();
        let (end, mut ended) = watch::channel(());
        let drive = hub.drive.clone();
        let drive = std::thread::Builder::new()
            .name("drive-watchdog".to_owned())
            .spawn(move || drive.watch())?;
        let held = hub.clone();
        let hold = std::thread::Builder::new()
            .name("hold-watchdog".to_owned())
            .spawn(move || held.watch_hold())?;
        let states = StatePublisher::new(hub.clone(), Worker::new("monitor-points")?);
        let work = async move {
            tokio::spawn(states.run(fed));
            let seats = state.seats.clone();
            let router = router(state).into_make_service_with_connect_info::<Peer>();
            let mut over = ended.clone();
            let serving = axum::serve(ConnectionListener::new(listener), router)
                .with_graceful_shutdown(async move {
                    let _ = over.changed().await;
                });
            tokio::select! {
                // The server counts no connection that became a WebSocket: those are over when all
                // seats are free.
                _ = async {
                    let _ = serving.await;
                    seats.acquire_many(MOST_WEB_SOCKETS as u32).await.map(drop)
                } => {}
                () = async {
                    let _ = ended.changed().await;
                    tokio::time::sleep(GOOD_BYE).await;
                } => {}
            }
        };
        let thread = std::thread::Builder::new()
            .name("monitor".to_owned())
            .spawn(move || runtime.block_on(work))?;
        Ok((Monitor { hub, end: Some(end), threads: vec![thread, drive, hold] }, subscriber))
    }
}

/// A server at work. It says good-bye and ends when it is dropped.
pub struct Monitor {
    hub: Arc<Hub>,
    end: Option<watch::Sender<()>>,
    threads: Vec<JoinHandle<()>>,
}

impl Drop for Monitor {
    fn drop(&mut self) {
        self.hub.end();
        // The tasks that wait for a change are notified that there will be none.
        drop(self.end.take());
        for thread in self.threads.drain(..) {
            // A server that panicked has nothing more to say.
            let _ = thread.join();
        }
    }
}
