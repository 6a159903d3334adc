//! Which clients may connect, how many, and how much they may send: the server of the `foxglove`
//! crate bounds none of these.
//!
//! Bytes are passed on to the server behind, which listens at an address that only the proxy knows.

use core::sync::atomic::{AtomicU64, Ordering};
use core::time::Duration;
use std::io;
use std::net::SocketAddr;
use std::sync::Arc;

use tokio::io::{AsyncRead, AsyncReadExt as _, AsyncWrite, AsyncWriteExt as _, copy};
use tokio::net::{TcpListener, TcpSocket, TcpStream};
use tokio::sync::Semaphore;
use tokio::time::timeout;

/// What went by and what did not. All `Relaxed`: each number stands for itself.
#[derive(Debug, Default)]
pub(super) struct Counts {
    pub(super) records: AtomicU64,
    pub(super) turned_away: AtomicU64,
    pub(super) cut_off: AtomicU64,
}

/// Clients at the same time.
const MOST_CLIENTS: usize = 8;
/// What the kernel keeps for a client that reads slowly, bytes: states in there are old ones.
pub(super) const BUFFER_BYTES: u32 = 64 << 10;
/// A request for a WebSocket is this long at most, bytes, and comes within this time.
const MOST_HEAD_BYTES: usize = 8 << 10;
const HEAD_PATIENCE: Duration = Duration::from_secs(5);
/// What a client may send on one connection in all, bytes: a subscription takes fifty. So no
/// message of it is longer either.
const MOST_SAID_BYTES: u64 = 1 << 20;
/// A client that takes nothing for so long is cut off.
const STALLED: Duration = Duration::from_secs(10);
/// Rest after an error that is not the fault of one connection, such as too many open files.
const AFTER_ERROR: Duration = Duration::from_millis(50);
/// The page of the Foxglove app.
const FOXGLOVE_APP: &str = "https://app.foxglove.dev";

const NO_SLOT: &[u8] =
    b"HTTP/1.1 503 Service Unavailable\r\nConnection: close\r\nContent-Length: 0\r\n\r\n";
const NOT_WELCOME: &[u8] =
    b"HTTP/1.1 403 Forbidden\r\nConnection: close\r\nContent-Length: 0\r\n\r\n";

#[derive(Clone)]
pub(super) struct Proxy {
    /// The server behind.
    pub(super) inner: SocketAddr,
    /// Web pages that are welcome.
    pub(super) origins: Vec<String>,
    pub(super) counts: Arc<Counts>,
}

impl Proxy {
    /// For ever.
    pub(super) async fn run(self, listener: TcpListener) {
        let proxy = Arc::new(self);
        let slots = Arc::new(Semaphore::new(MOST_CLIENTS));
        loop {
            let Ok((client, _)) = listener.accept().await else {
                tokio::time::sleep(AFTER_ERROR).await;
                continue;
            };
            let Ok(slot) = slots.clone().try_acquire_owned() else {
                proxy.counts.turned_away.fetch_add(1, Ordering::Relaxed);
                // Written into an empty buffer: it fits.
                let _ = client.try_write(NO_SLOT);
                continue;
            };
            let proxy = proxy.clone();
            tokio::spawn(async move {
                // A connection that breaks is over; no other part depends on it.
                let _ = proxy.pass(client).await;
                drop(slot);
            });
        }
    }

    /// One client, from its request to its end.
    async fn pass(&self, mut client: TcpStream) -> io::Result<()> {
        client.set_nodelay(true)?;
        let head = timeout(HEAD_PATIENCE, read_head(&mut client)).await??;
        if !self.welcomes(&head) {
            self.counts.turned_away.fetch_add(1, Ordering::Relaxed);
            return client.write_all(NOT_WELCOME).await;
        }
        let socket = TcpSocket::new_v4()?;
        socket.set_recv_buffer_size(BUFFER_BYTES)?;
        let mut server = socket.connect(self.inner).await?;
        server.set_nodelay(true)?;
        server.write_all(&head).await?;
        let (said, mut heard) = client.split();
        let (answers, mut asked) = server.split();
        let mut said = said.take(MOST_SAID_BYTES);
        tokio::select! {
            over = copy(&mut said, &mut asked) => over.map(drop),
            over = pass_on(answers, &mut heard) => {
                if over.as_ref().is_err_and(|error| error.kind() == io::ErrorKind::TimedOut) {
                    self.counts.cut_off.fetch_add(1, Ordering::Relaxed);
                }
                over
            }
        }
    }

    /// A web page that the operator has open can connect too. It betrays itself by its `Origin`;
    /// programs send none, or none of the web.
    fn welcomes(&self, head: &[u8]) -> bool {
        let head = String::from_utf8_lossy(head);
        let headers = head.lines().filter_map(|line| line.split_once(':'));
        let origins = headers
            .filter(|(name, _)| name.trim().eq_ignore_ascii_case("origin"))
            .map(|(_, origin)| origin.trim());
        origins.into_iter().all(|origin| self.welcomes_page(origin))
    }

    fn welcomes_page(&self, origin: &str) -> bool {
        if origin == FOXGLOVE_APP || self.origins.iter().any(|known| known == origin) {
            return true;
        }
        let lower = origin.to_lowercase();
        match lower.strip_prefix("http://").or(lower.strip_prefix("https://")) {
            Some(host) => ["localhost", "127.0.0.1", "[::1]"].iter().any(|ours| {
                host.strip_prefix(ours).is_some_and(|rest| rest.is_empty() || rest.starts_with(':'))
            }),
            // A page without a name of its own says `null`; `file:` and the like are programs.
            None => lower != "null",
        }
    }
}

/// The request up to its empty line, and what came with it.
async fn read_head(client: &mut TcpStream) -> io::Result<Vec<u8>> {
    let mut head = Vec::with_capacity(MOST_HEAD_BYTES);
    loop {
        let room = MOST_HEAD_BYTES.saturating_sub(head.len()) as u64;
        if client.take(room).read_buf(&mut head).await? == 0 {
            return Err(io::ErrorKind::InvalidData.into());
        }
        if head.windows(4).any(|bytes| bytes == b"\r\n\r\n") {
            return Ok(head);
        }
    }
}

async fn pass_on(
    mut from: impl AsyncRead + Unpin,
    to: &mut (impl AsyncWrite + Unpin),
) -> io::Result<()> {
    let mut buffer = vec![0; BUFFER_BYTES as usize];
    loop {
        let n = from.read(&mut buffer).await?;
        let mut part = buffer.get(..n).unwrap_or_default();
        if part.is_empty() {
            return Ok(());
        }
        while !part.is_empty() {
            let taken = timeout(STALLED, to.write(part)).await??;
            part = part.get(taken..).unwrap_or_default();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn web_pages_of_others_do_not_come_in() {
        let counts = Arc::default();
        let proxy = Proxy {
            inner: ([127, 0, 0, 1], 1).into(),
            origins: vec!["https://lab.example".to_owned()],
            counts,
        };
        let welcomes = |origin: &str| {
            proxy.welcomes(
                format!("GET / HTTP/1.1\r\nHost: x\r\norigin: {origin}\r\n\r\n").as_bytes(),
            )
        };
        for origin in [
            "http://localhost:8080",
            "http://127.0.0.1",
            "https://[::1]:1",
            FOXGLOVE_APP,
            "https://lab.example",
            "file://",
        ] {
            assert!(welcomes(origin), "{origin}");
        }
        for origin in [
            "http://evil.example",
            "null",
            "http://localhost.evil.example",
            "https://127.0.0.1.evil.example",
            "HTTP://x",
        ] {
            assert!(!welcomes(origin), "{origin}");
        }
        assert!(proxy.welcomes(b"GET / HTTP/1.1\r\nHost: x\r\n\r\n"), "a program");
    }
}
