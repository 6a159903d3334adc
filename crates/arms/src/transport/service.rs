//! A program that serves an arm over a WebSocket: the Inverse service of Haply. Two
//! [threads](super::threaded) turn its messages into records and back.
//!
//! The loop exchanges records; only what `descriptor` gives away carries what is on the wire, and
//! [`Transport::on_wire`] makes it.

use core::time::Duration;
use std::io::{self, Read, Write};
use std::net::{TcpStream, ToSocketAddrs};
use std::os::fd::OwnedFd;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use tungstenite::protocol::WebSocketConfig;
use tungstenite::{Message, WebSocket};

use super::threaded::{Disconnected, Sink, Source, Threaded};
use super::{FRAME_MAX, Transport, TransportError};
use crate::IoPlacement;
use crate::protocol::StartError;
use crate::protocol::haply::{
    ArmOfService, Dialect, HaplyService, Inventory, Reader, Version, command_text, greeting,
    is_gone,
};
use rt::schedule::ThreadRequest;

/// How long a connection may take: the service runs on this machine, or on the next one.
const CONNECT_PATIENCE: Duration = Duration::from_secs(1);
/// How long the service may take for an answer, or for its inventory.
const ANSWER_PATIENCE: Duration = Duration::from_secs(3);
/// How long a message may take to leave before the link counts as lost.
const WRITE_PATIENCE: Duration = Duration::from_millis(500);
/// Longest answer over HTTP, and longest message.
const MESSAGE_MAX: usize = 1 << 20;
/// How long a version and a list of devices may take in pieces, each of which comes in time; and
/// the length of the first.
const ENTRY_PATIENCE: Duration = Duration::from_secs(5);
const VERSION_MAX: usize = 1 << 16;

/// Why a service cannot be used. Cold.
#[derive(Debug, thiserror::Error)]
pub enum ServiceError {
    /// Nothing listens there, or the address is none.
    #[error(
        "no service answers at {address}: {cause}; start it (Haply: `systemctl start \
            haply-inverse-service`), or name another address in protocol.address"
    )]
    Absent {
        /// Host and port.
        address: String,
        /// Why.
        cause: io::Error,
    },
    /// It runs, and its arm is not there.
    #[error("the service at {address} runs, but {cause}")]
    Refused {
        /// Host and port.
        address: String,
        /// Why.
        cause: StartError,
    },
    /// What listens there is another program.
    #[error("what listens at {address} does not speak as the Inverse service: {cause}")]
    Foreign {
        /// Host and port.
        address: String,
        /// What it did.
        cause: String,
    },
    /// No thread, no eventfd.
    #[error("cannot start the threads of the link: {0}")]
    Thread(io::Error),
}

/// A socket whose writes are whole: the reader's pongs and the writer's commands take turns.
#[derive(Debug)]
struct Half {
    socket: TcpStream,
    turn: Arc<Mutex<()>>,
}

impl Read for Half {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        self.socket.read(buffer)
    }
}

impl Write for Half {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let _turn = self.turn.lock().unwrap_or_else(PoisonError::into_inner);
        self.socket.write_all(bytes)?;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// An open service.
#[derive(Debug)]
pub(crate) struct ServiceLink {
    threads: Threaded,
    /// Said once, before everything else.
    greeting: Option<Vec<u8>>,
    socket: TcpStream,
    arm: String,
    dialect: Dialect,
}

fn connect(address: &str) -> io::Result<TcpStream> {
    let mut last = io::Error::new(io::ErrorKind::NotFound, "the name has no address");
    for address in address.to_socket_addrs()? {
        match TcpStream::connect_timeout(&address, CONNECT_PATIENCE) {
            Ok(socket) => {
                socket.set_nodelay(true)?;
                socket.set_read_timeout(Some(ANSWER_PATIENCE))?;
                socket.set_write_timeout(Some(WRITE_PATIENCE))?;
                return Ok(socket);
            }
            Err(error) => last = error,
        }
    }
    Err(last)
}

/// The version in an answer; `None` while it is not whole.
fn version_in(answer: &str) -> Option<Version> {
    // In one piece, or in pieces with their lengths between them: the object is the same.
    let (_, body) = answer.split_once("\r\n\r\n")?;
    Dialect::version_in(body.get(body.find('{')?..=body.rfind('}')?)?)
}

/// The version that the service says of itself.
fn version_of(address: &str) -> Result<Version, ServiceError> {
    let absent = |cause| ServiceError::Absent { address: address.to_owned(), cause };
    let mut socket = connect(address).map_err(absent)?;
    let mut answer = Vec::new();
    let mut failed =
        write!(socket, "GET /version HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n\r\n")
            .err();
    let mut version = None;
    // Until the answer is whole: a server may keep the connection.
    let end = Instant::now() + ENTRY_PATIENCE;
    while failed.is_none()
        && version.is_none()
        && answer.len() < VERSION_MAX
        && Instant::now() < end
    {
        let mut some = [0; 4096];
        match socket.read(&mut some) {
            Ok(0) => break,
            Ok(n) => answer.extend_from_slice(&some[..n]),
            Err(error) => failed = Some(error),
        }
        version = version_in(&String::from_utf8_lossy(&answer));
    }
    version.ok_or_else(|| {
        let text = String::from_utf8_lossy(&answer);
        let heard = failed.map_or_else(
            || text.lines().next().unwrap_or("nothing").to_owned(),
            |error| error.to_string(),
        );
        let cause = format!(
            "GET /version gives no project_version ({heard}); \
            protocol.service_version of a profile names one"
        );
        ServiceError::Foreign { address: address.to_owned(), cause }
    })
}

/// Connects and reads the inventory; and the message that it came in, which says how arm and grip
/// are as well.
fn enter(address: &str) -> Result<(WebSocket<Half>, Inventory, String), ServiceError> {
    let socket = connect(address)
        .map_err(|cause| ServiceError::Absent { address: address.to_owned(), cause })?;
    let foreign = |cause: String| ServiceError::Foreign { address: address.to_owned(), cause };
    let half = Half { socket, turn: Arc::default() };
    let config = WebSocketConfig::default()
        .max_message_size(Some(MESSAGE_MAX))
        .max_frame_size(Some(MESSAGE_MAX));
    let (mut web_socket, _) =
        tungstenite::client::client_with_config(format!("ws://{address}/"), half, Some(config))
            .map_err(|error| foreign(error.to_string()))?;
    let end = Instant::now() + ENTRY_PATIENCE;
    loop {
        if Instant::now() > end {
            return Err(foreign(format!(
                "no list of devices within {} s",
                ENTRY_PATIENCE.as_secs()
            )));
        }
        match web_socket.read() {
            Ok(Message::Text(text)) => {
                let inventory = Inventory::read(&text)
                    .ok_or_else(|| foreign("its first message is no list of devices".to_owned()))?;
                return Ok((web_socket, inventory, text.to_string()));
            }
            Ok(_) => {}
            Err(error) => return Err(foreign(format!("no list of devices: {error}"))),
        }
    }
}

/// A service that runs, for a list of what is attached.
#[derive(Clone, Debug, PartialEq)]
pub struct RunningService {
    /// Host and port.
    pub address: String,
    /// Its version.
    pub version: Version,
    /// Kind and id of each arm.
    pub arms: Vec<(String, String)>,
    /// Ids of grips.
    pub grips: Vec<String>,
}

/// Asks a service what it has; `None` where none answers. Cold; a server that is none, or silent,
/// takes some seconds.
pub fn running_service(address: &str) -> Option<RunningService> {
    let version = version_of(address).ok()?;
    let (_, inventory, _) = enter(address).ok()?;
    let arms = inventory.arms.into_iter().map(|ArmOfService { kind, id, .. }| (kind, id)).collect();
    Some(RunningService { address: address.to_owned(), version, arms, grips: inventory.grips })
}

impl ServiceLink {
    /// Connects to the service, finds the arm, and starts both threads. Cold.
    ///
    /// # Errors
    /// See [`ServiceError`].
    pub(crate) fn open(
        wanted: &HaplyService,
        request: Option<ThreadRequest>,
    ) -> Result<Self, ServiceError> {
        let address = &wanted.address;
        let refused = |cause| ServiceError::Refused { address: address.clone(), cause };
        let version = wanted.version.map_or_else(|| version_of(address), Ok)?;
        let dialect = Dialect::of(version).map_err(refused)?;
        let (web_socket, inventory, first) = enter(address)?;
        let (arm, grip) = inventory.choose(wanted).map_err(refused)?;
        let half = web_socket.get_ref();
        let share = || half.socket.try_clone().map_err(ServiceError::Thread);
        let writer = Half { socket: share()?, turn: half.turn.clone() };
        let socket = share()?;
        let mut reader = Reader::new(&arm.id, grip.map(String::as_str));
        // What later messages leave out was said in it.
        let _ = reader.record(first.as_bytes());
        let greeting = greeting(&arm.greeting(version, grip));
        let source = States { web_socket, reader, patience: None };
        let sink = Commands { writer, arm: arm.id.clone(), dialect, n_sent: 0 };
        let threads = Threaded::start(source, sink, request).map_err(ServiceError::Thread)?;
        Ok(Self { threads, greeting: Some(greeting), socket, arm: arm.id.clone(), dialect })
    }
}

struct States {
    web_socket: WebSocket<Half>,
    reader: Reader,
    /// What the socket was reported last.
    patience: Option<Duration>,
}

impl Source for States {
    fn wait(
        &mut self,
        buffer: &mut [u8; FRAME_MAX],
        patience: Duration,
    ) -> Result<usize, Disconnected> {
        if self.patience != Some(patience) {
            self.web_socket
                .get_ref()
                .socket
                .set_read_timeout(Some(patience))
                .map_err(|_| Disconnected)?;
            self.patience = Some(patience);
        }
        let record = match self.web_socket.read() {
            Ok(Message::Text(text)) => self.reader.record(text.as_bytes()),
            // Questions of the web socket itself are answered by it.
            Ok(_) => return Ok(0),
            Err(tungstenite::Error::Io(error))
                if matches!(
                    error.kind(),
                    io::ErrorKind::WouldBlock
                        | io::ErrorKind::TimedOut
                        | io::ErrorKind::Interrupted
                ) =>
            {
                return Ok(0);
            }
            Err(_) => return Err(Disconnected),
        };
        if is_gone(&record) {
            return Err(Disconnected);
        }
        let n = record.len().min(FRAME_MAX);
        buffer[..n].copy_from_slice(&record[..n]);
        Ok(n)
    }
}

struct Commands {
    writer: Half,
    arm: String,
    dialect: Dialect,
    n_sent: u32,
}

impl Sink for Commands {
    fn put(&mut self, frame: &[u8]) -> Result<(), Disconnected> {
        let text = command_text(frame, &self.arm, self.dialect).ok_or(Disconnected)?;
        // The mask keeps caches on the way from reading commands; between two programs of one
        // machine it only has to change.
        self.n_sent = self.n_sent.wrapping_add(0x9E37_79B9);
        self.writer
            .write_all(&masked(text.as_bytes(), self.n_sent.to_le_bytes()))
            .map_err(|_| Disconnected)
    }
}

/// A text frame as a client sends it (RFC 6455, 5.2): of at most 65,535 bytes.
fn masked(text: &[u8], mask: [u8; 4]) -> Vec<u8> {
    let mut frame = vec![0x81];
    match u16::try_from(text.len()) {
        Ok(len @ ..126) => frame.push(0x80 | len as u8),
        Ok(len) => {
            frame.push(0x80 | 126);
            frame.extend(len.to_be_bytes());
        }
        // An id that long is none; an empty message asks for nothing.
        Err(_) => return masked(b"{}", mask),
    }
    frame.extend(mask);
    frame.extend(text.iter().zip(mask.iter().cycle()).map(|(byte, mask)| byte ^ mask));
    frame
}

impl Transport for ServiceLink {
    fn receive(&mut self, buffer: &mut [u8]) -> Result<usize, TransportError> {
        match &self.greeting {
            Some(greeting) => {
                let n = greeting.len().min(buffer.len());
                buffer[..n].copy_from_slice(&greeting[..n]);
                // Before the first tick.
                self.greeting = None;
                Ok(n)
            }
            None => self.threads.receive(buffer),
        }
    }

    fn send(&mut self, frame: &[u8]) -> Result<(), TransportError> {
        self.threads.send(frame)
    }

    fn send_now(&mut self, frame: &[u8]) -> Result<(), TransportError> {
        self.threads.send_now(frame)
    }

    fn descriptor(&self) -> io::Result<OwnedFd> {
        Ok(self.socket.try_clone()?.into())
    }

    fn on_wire(&self, frame: &[u8]) -> Vec<u8> {
        command_text(frame, &self.arm, self.dialect)
            .map_or_else(Vec::new, |text| masked(text.as_bytes(), [0x5A, 0xC3, 0x96, 0x3C]))
    }

    fn io(&self) -> IoPlacement {
        IoPlacement::OwnThread
    }
}
