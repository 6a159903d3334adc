//! Accepts connections, as many as there are slots, and closes those on which nothing comes.
//! [`connection_slots`](super::connection_slots) says which have one.

use core::pin::Pin;
use core::task::{Context, Poll};
use core::time::Duration;
use std::io;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Instant;

use axum::extract::connect_info::Connected;
use axum::serve::{IncomingStream, Listener};
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::{TcpListener, TcpStream};
use tokio::runtime::Handle;
use tokio::sync::OwnedSemaphorePermit;
use tokio::time::Sleep;

use super::connection_slots::{ConnectionSlot, ConnectionSlots, ConnectionState};

/// Connections at the same time, WebSockets among them.
const MOST_CONNECTIONS: usize = 192;
/// Connections that are just being closed, with the reason as their last answer.
const MOST_LEAVING: usize = 64;
/// A connection whose first request is not whole, or was refused, by then is closed.
const FIRST_REQUEST: Duration = Duration::from_secs(5);
/// A connection on which nothing comes for so long is closed. WebSockets are pinged more often.
const SILENT: Duration = Duration::from_secs(30);
/// A connection that is no WebSocket ends after so long whatever it does.
const LONGEST: Duration = Duration::from_secs(300);
/// A client that is being shut out may take so long, and send so much more.
const LINGER: Duration = Duration::from_secs(1);
const LINGER_BYTES: usize = 4 << 20;
/// Rest after an error that is not the fault of one connection, such as too many open files.
const AFTER_ERROR: Duration = Duration::from_millis(50);

/// Accepts connections for axum.
pub(super) struct ConnectionListener {
    listener: TcpListener,
    slots: Arc<ConnectionSlots>,
}

impl ConnectionListener {
    pub(super) fn new(listener: TcpListener) -> Self {
        Self { listener, slots: ConnectionSlots::new(MOST_CONNECTIONS, MOST_LEAVING) }
    }
}

impl Listener for ConnectionListener {
    type Io = ClientConnection;
    type Addr = SocketAddr;

    async fn accept(&mut self) -> (ClientConnection, SocketAddr) {
        loop {
            match self.listener.accept().await {
                Ok((stream, peer)) => {
                    if !self.slots.has_room() {
                        // A connection that came just before may have a whole request in its
                        // socket: that is read before a slot is taken away.
                        tokio::task::yield_now().await;
                    }
                    // Small messages leave at once; if that cannot be had they come a little later.
                    let _ = stream.set_nodelay(true);
                    return (ClientConnection::new(stream, self.slots.take()), peer);
                }
                Err(error) if error.kind() == io::ErrorKind::ConnectionAborted => {}
                Err(_) => tokio::time::sleep(AFTER_ERROR).await,
            }
        }
    }

    fn local_addr(&self) -> io::Result<SocketAddr> {
        self.listener.local_addr()
    }
}

/// What a handler knows of its connection.
#[derive(Clone, Debug)]
pub(super) struct Peer {
    pub(super) address: SocketAddr,
    pub(super) state: Arc<ConnectionState>,
    slots: Arc<ConnectionSlots>,
}

impl Peer {
    /// It has sent a whole request that needs no token.
    pub(super) fn looks(&self) {
        self.state.asks();
    }

    /// It may use the API.
    pub(super) fn let_in(&self) {
        self.slots.accept(&self.state);
    }

    /// It keeps its slot from now on.
    pub(super) fn become_web_socket(&self) {
        self.slots.become_web_socket(&self.state);
    }
}

impl Connected<IncomingStream<'_, ConnectionListener>> for Peer {
    fn connect_info(stream: IncomingStream<'_, ConnectionListener>) -> Self {
        let ClientConnection { state, slots, .. } = stream.io();
        Self { address: *stream.remote_addr(), state: state.clone(), slots: slots.clone() }
    }
}

/// One connection with its slot.
pub(super) struct ClientConnection {
    /// `None` while it is dropped only.
    stream: Option<(TcpStream, ConnectionSlot)>,
    state: Arc<ConnectionState>,
    slots: Arc<ConnectionSlots>,
    silent: Pin<Box<Sleep>>,
}

impl ClientConnection {
    fn new(stream: TcpStream, slot: ConnectionSlot) -> Self {
        let state = slot.state.clone();
        let slots = slot.slots.clone();
        let silent = Box::pin(tokio::time::sleep(FIRST_REQUEST));
        Self { stream: Some((stream, slot)), state, slots, silent }
    }

    fn with<T>(
        &mut self,
        cx: &mut Context<'_>,
        act: impl FnOnce(Pin<&mut TcpStream>, &mut Context<'_>) -> Poll<io::Result<T>>,
    ) -> Poll<io::Result<T>> {
        match &mut self.stream {
            Some(_) if self.state.must_leave(cx) => {
                Poll::Ready(Err(io::ErrorKind::ConnectionAborted.into()))
            }
            Some((stream, _)) => act(Pin::new(stream), cx),
            None => Poll::Ready(Err(io::ErrorKind::NotConnected.into())),
        }
    }

    /// What became of a write. Nothing is read while an answer waits to be taken, so that a client
    /// that asks and never reads counts as silent, too.
    fn taken(
        &mut self,
        written: Poll<io::Result<usize>>,
        cx: &mut Context<'_>,
    ) -> Poll<io::Result<usize>> {
        if written.is_pending() {
            return self.poll_patience(cx);
        }
        self.state.moves(Instant::now());
        written
    }

    /// For what cannot go on: ends the connection when nothing came for too long.
    fn poll_patience<T>(&mut self, cx: &mut Context<'_>) -> Poll<io::Result<T>> {
        self.poll_silent(cx).map(|()| Err(io::ErrorKind::TimedOut.into()))
    }

    /// Ready when nothing came for too long.
    fn poll_silent(&mut self, cx: &mut Context<'_>) -> Poll<()> {
        while self.silent.as_mut().poll(cx).is_ready() {
            // A long answer that is being taken is no silence.
            let is_web_socket = self.state.is_web_socket();
            let last = if is_web_socket { self.state.heard() } else { self.state.moved() };
            let since_heard = last.elapsed();
            let since_opened = self.state.opened().elapsed();
            let longest = if self.state.has_asked() { LONGEST } else { FIRST_REQUEST };
            if since_heard >= SILENT || !is_web_socket && since_opened >= longest {
                return Poll::Ready(());
            }
            let left = (SILENT - since_heard).max(Duration::from_millis(10));
            self.silent.as_mut().reset(tokio::time::Instant::now() + left);
        }
        Poll::Pending
    }
}

impl AsyncRead for ClientConnection {
    fn poll_read(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        let before = buffer.filled().len();
        let read = self.with(cx, |stream, cx| stream.poll_read(cx, buffer));
        match read {
            Poll::Pending => return self.poll_patience(cx),
            Poll::Ready(Ok(())) if buffer.filled().len() > before => {
                self.state.hear(Instant::now())
            }
            Poll::Ready(_) => self.state.leave(),
        }
        read
    }
}

impl AsyncWrite for ClientConnection {
    fn poll_write(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        bytes: &[u8],
    ) -> Poll<io::Result<usize>> {
        let written = self.with(cx, |stream, cx| stream.poll_write(cx, bytes));
        self.taken(written, cx)
    }

    fn poll_flush(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        match self.with(cx, |stream, cx| stream.poll_flush(cx)) {
            Poll::Pending => self.poll_patience(cx),
            flushed => flushed,
        }
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        self.with(cx, |stream, cx| stream.poll_shutdown(cx))
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        slices: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        let written = self.with(cx, |stream, cx| stream.poll_write_vectored(cx, slices));
        self.taken(written, cx)
    }

    fn is_write_vectored(&self) -> bool {
        true
    }
}

impl Drop for ClientConnection {
    /// A socket that is closed over unread bytes takes back what was sent last: the answer that
    /// says why. A connection that gave way gets no answer.
    fn drop(&mut self) {
        if let (Some((stream, slot)), Ok(runtime)) = (self.stream.take(), Handle::try_current())
            && !slot.is_gone()
            && let Ok(leaving) = self.slots.leaving.clone().try_acquire_owned()
        {
            runtime.spawn(linger(stream, leaving));
        }
    }
}

/// Closes a connection after its other end has.
async fn linger(mut stream: TcpStream, _leaving: OwnedSemaphorePermit) {
    let _ = core::future::poll_fn(|cx| Pin::new(&mut stream).poll_shutdown(cx)).await;
    let rest = async {
        let mut scratch = [0; 4096];
        let mut left = LINGER_BYTES;
        while left > 0 && stream.readable().await.is_ok() {
            match stream.try_read(&mut scratch) {
                Ok(0) => return,
                Ok(n) => left = left.saturating_sub(n),
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => {}
                Err(_) => return,
            }
        }
    };
    let _ = tokio::time::timeout(LINGER, rest).await;
}

#[cfg(test)]
mod tests {
    use core::future::poll_fn;

    use super::*;

    #[test]
    fn who_asks_and_never_reads_is_let_go() {
        let runtime =
            tokio::runtime::Builder::new_current_thread().enable_all().build().expect("a runtime");
        let ended = runtime.block_on(async {
            let listener = TcpListener::bind(("127.0.0.1", 0)).await.expect("a port");
            let deaf = TcpStream::connect(listener.local_addr().expect("it is bound"))
                .await
                .expect("it listens");
            let (stream, _) = listener.accept().await.expect("a connection");
            let mut slot = ConnectionSlots::new(1, 1).take();
            let long_ago =
                Instant::now().checked_sub(SILENT).expect("a machine that is up for longer");
            slot.state = Arc::new(ConnectionState::new(long_ago));
            slot.state.asks();
            let mut connection = ClientConnection::new(stream, slot);
            let write = |connection: &mut ClientConnection, cx: &mut Context<'_>| {
                Pin::new(connection).poll_write(cx, &[0; 65_536])
            };
            let is_full = |connection: &mut ClientConnection, cx: &mut Context<'_>| {
                write(connection, cx).is_pending()
            };
            while !poll_fn(|cx| Poll::Ready(is_full(&mut connection, cx))).await {}
            // As if all of its patience had passed.
            connection.state.moves(long_ago);
            connection.silent.as_mut().reset(tokio::time::Instant::now());
            let written =
                tokio::time::timeout(SILENT, poll_fn(|cx| write(&mut connection, cx))).await;
            drop(deaf);
            written.expect("it does not wait for ever")
        });
        assert_eq!(ended.map_err(|error| error.kind()), Err(io::ErrorKind::TimedOut));
    }
}
