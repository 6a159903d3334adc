//! Datagrams over a zenoh session, best effort: the newest frame wins, nothing waits for a
//! congested link.
//!
//! | key | carries |
//! |---|---|
//! | `hapticd/device/NAME/command` | packets to the node |
//! | `hapticd/device/NAME/state` | packets from the node |
//! | `hapticd/device/NAME/profile` | a query: the profile of the arm, as it is written |
//!
//! Bytes pass through the two threads of a link (`threaded`): zenoh allocates and locks.

use core::time::Duration;

use crossbeam::channel::{Receiver, RecvTimeoutError, bounded};
use zenoh::bytes::ZBytes;
use zenoh::pubsub::{Publisher, Subscriber};
use zenoh::qos::{CongestionControl, Priority};
use zenoh::query::Queryable;
use zenoh::{Session, Wait};

use super::NetworkError;
use arms::IoPlacement;
use arms::transport::threaded::{Disconnected, Sink, Source, Threaded};
use arms::transport::{FRAME_MAX, Frame, Transport, TransportError};
use rt::schedule::ThreadRequest;

/// Packets that may wait between zenoh's thread and ours.
const WAITING: usize = 64;
/// How long one question for a profile waits; over UDP it may be lost.
const ASK_AGAIN: Duration = Duration::from_millis(500);

fn key(name: &str, what: &str) -> String {
    format!("hapticd/device/{name}/{what}")
}

/// A name becomes part of a key: letters, digits, `-`, `_` and `.`, at most 32 of them.
pub fn is_name(name: &str) -> bool {
    (1..=32).contains(&name.len())
        && name.bytes().all(|byte| byte.is_ascii_alphanumeric() || b"-_.".contains(&byte))
}

/// A link of datagrams over a session. RT: `receive` and `send` are safe.
pub struct ZenohLink {
    threads: Threaded,
    /// Ends with the link.
    _subscriber: Subscriber<()>,
}

struct Packets(Receiver<Frame>);

impl Source for Packets {
    fn wait(
        &mut self,
        buffer: &mut [u8; FRAME_MAX],
        patience: Duration,
    ) -> Result<usize, Disconnected> {
        match self.0.recv_timeout(patience) {
            Ok(packet) => {
                let bytes = packet.as_slice();
                buffer[..bytes.len()].copy_from_slice(bytes);
                Ok(bytes.len())
            }
            Err(RecvTimeoutError::Timeout) => Ok(0),
            Err(RecvTimeoutError::Disconnected) => Err(Disconnected),
        }
    }
}

struct Outlet {
    publisher: Publisher<'static>,
    /// The publisher alone would not keep it open.
    _session: Session,
}

impl Sink for Outlet {
    fn put(&mut self, frame: &[u8]) -> Result<(), Disconnected> {
        self.publisher.put(ZBytes::from(frame.to_vec())).wait().map_err(|_| Disconnected)
    }
}

impl ZenohLink {
    /// The host's end of the link to the node of that name. Cold.
    ///
    /// # Errors
    /// The session is closed, or a thread cannot be started.
    pub fn to_node(
        session: &Session,
        name: &str,
        request: Option<ThreadRequest>,
    ) -> Result<Self, NetworkError> {
        Self::between(session, name, "state", "command", request)
    }

    /// The node's end. Cold.
    ///
    /// # Errors
    /// As [`Self::to_node`].
    pub fn to_host(
        session: &Session,
        name: &str,
        request: Option<ThreadRequest>,
    ) -> Result<Self, NetworkError> {
        Self::between(session, name, "command", "state", request)
    }

    fn between(
        session: &Session,
        name: &str,
        from: &str,
        to: &str,
        request: Option<ThreadRequest>,
    ) -> Result<Self, NetworkError> {
        let failed = |cause: String| NetworkError::Link { name: name.to_owned(), cause };
        let publisher = session
            .declare_publisher(key(name, to))
            .congestion_control(CongestionControl::Drop)
            .priority(Priority::RealTime)
            .express(true)
            .wait()
            .map_err(|cause| failed(cause.to_string()))?;
        let (came, packets) = bounded(WAITING);
        let subscriber = session
            .declare_subscriber(key(name, from))
            .callback(move |sample| {
                let mut packet = Frame::default();
                // Full: the receiver has left 64 packets unread and has long reported silence.
                if packet.extend(&sample.payload().to_bytes()) {
                    let _ = came.try_send(packet);
                }
            })
            .wait()
            .map_err(|cause| failed(cause.to_string()))?;
        let outlet = Outlet { publisher, _session: session.clone() };
        let threads = Threaded::start(Packets(packets), outlet, request)
            .map_err(|cause| failed(cause.to_string()))?;
        Ok(Self { threads, _subscriber: subscriber })
    }
}

impl Transport for ZenohLink {
    fn receive(&mut self, buffer: &mut [u8]) -> Result<usize, TransportError> {
        self.threads.receive(buffer)
    }

    fn send(&mut self, frame: &[u8]) -> Result<(), TransportError> {
        self.threads.send(frame)
    }

    fn send_now(&mut self, frame: &[u8]) -> Result<(), TransportError> {
        self.threads.send_now(frame)
    }

    /// The network drops what is late, and the node judges the age of what comes.
    fn unread(&mut self) -> usize {
        0
    }

    fn io(&self) -> IoPlacement {
        IoPlacement::OwnThread
    }
}

/// Answers every query for the profile of the arm until the returned value is dropped. Cold.
///
/// # Errors
/// The session is closed.
pub fn serve_profile(
    session: &Session,
    name: &str,
    toml: String,
) -> Result<Queryable<()>, NetworkError> {
    session
        .declare_queryable(key(name, "profile"))
        .callback(move |query| {
            // A peer that asked and has gone gets no answer.
            let _ = query.reply(query.key_expr().clone(), toml.clone()).wait();
        })
        .wait()
        .map_err(|cause| NetworkError::Link { name: name.to_owned(), cause: cause.to_string() })
}

/// Asks the node of that name for the profile of its arm, again and again. Cold.
///
/// # Errors
/// No node of that name answers in time.
pub fn ask_profile(
    session: &Session,
    name: &str,
    within: Duration,
) -> Result<String, NetworkError> {
    let begin = std::time::Instant::now();
    while begin.elapsed() < within {
        let asked = session.get(key(name, "profile")).timeout(ASK_AGAIN).wait();
        let replies = asked.map_err(|cause| NetworkError::Link {
            name: name.to_owned(),
            cause: cause.to_string(),
        })?;
        while let Ok(reply) = replies.recv() {
            if let Some(text) = reply
                .result()
                .ok()
                .and_then(|sample| sample.payload().try_to_string().ok().map(String::from))
            {
                return Ok(text);
            }
        }
        // Without a peer to ask it returns at once.
        std::thread::sleep(Duration::from_millis(20));
    }
    Err(NetworkError::NoNode { name: name.to_owned(), waited_s: within.as_secs() })
}
