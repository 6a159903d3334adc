//! A program that serves an arm over a WebSocket: the Inverse service of Haply. Two
//! [threads](super::threaded) turn its messages into records and back.
//!
//! The loop exchanges records; only what `descriptor` gives away carries what is on the wire, and
//! [`Transport::on_wire`] makes it.
//!
//! Behind each command goes a ping. The service answers it when it has read the command (RFC 6455,
//! 5.5.2), and so shows what it has not read. The system cannot: it takes bytes in the name of a
//! program that does not read them.

use core::sync::atomic::{AtomicU32, Ordering};
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
/// What the first ping carries; those behind commands carry a number.
const ENTRY_PING: &[u8] = b"enter";

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

/// How many commands were sent, and how many the service has read.
#[derive(Debug, Default)]
struct CommandCounts {
    sent: AtomicU32,
    read: AtomicU32,
}

/// An open service.
#[derive(Debug)]
pub(crate) struct ServiceLink {
    threads: Threaded,
    counts: Arc<CommandCounts>,
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
    web_socket
        .send(Message::Ping(ENTRY_PING.into()))
        .map_err(|error| foreign(format!("it takes no ping: {error}")))?;
    let end = Instant::now() + ENTRY_PATIENCE;
    let mut first = None;
    let mut is_answered = false;
    loop {
        if let Some((inventory, text)) = first.take_if(|_| is_answered) {
            return Ok((web_socket, inventory, text));
        }
        let missing = match first {
            None => "no list of devices",
            Some(_) => "no answer to a ping, which shows what the service has read",
        };
        if Instant::now() > end {
            return Err(foreign(format!("{missing} within {} s", ENTRY_PATIENCE.as_secs())));
        }
        match web_socket.read() {
            Ok(Message::Text(text)) if first.is_none() => {
                let inventory = Inventory::read(&text)
                    .ok_or_else(|| foreign("its first message is no list of devices".to_owned()))?;
                first = Some((inventory, text.to_string()));
            }
            Ok(Message::Pong(payload)) => is_answered |= payload.as_ref() == ENTRY_PING,
            Ok(_) => {}
            Err(error) => return Err(foreign(format!("{missing}: {error}"))),
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
        let counts = Arc::new(CommandCounts::default());
        let source = States { web_socket, reader, patience: None, counts: counts.clone() };
        let sink = Commands { writer, arm: arm.id.clone(), dialect, counts: counts.clone() };
        let threads = Threaded::start(source, sink, request).map_err(ServiceError::Thread)?;
        let arm = arm.id.clone();
        Ok(Self { threads, counts, greeting: Some(greeting), socket, arm, dialect })
    }
}

struct States {
    web_socket: WebSocket<Half>,
    reader: Reader,
    /// What the socket was reported last.
    patience: Option<Duration>,
    counts: Arc<CommandCounts>,
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
            Ok(Message::Pong(payload)) => {
                if let Some(number) = payload.first_chunk() {
                    // Relaxed: the number is the whole message.
                    self.counts.read.store(u32::from_be_bytes(*number), Ordering::Relaxed);
                }
                return Ok(0);
            }
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
    counts: Arc<CommandCounts>,
}

impl Sink for Commands {
    fn put(&mut self, frame: &[u8]) -> Result<(), Disconnected> {
        let text = command_text(frame, &self.arm, self.dialect).ok_or(Disconnected)?;
        // Before it leaves: what is being sent is not read yet.
        let number = self.counts.sent.fetch_add(1, Ordering::Relaxed).wrapping_add(1);
        // The mask keeps caches on the way from reading commands; between two programs of one
        // machine it only has to change.
        let mask = number.wrapping_mul(0x9E37_79B9).to_le_bytes();
        let mut bytes = masked(TEXT, text.as_bytes(), mask);
        bytes.extend(masked(PING, &number.to_be_bytes(), mask));
        self.writer.write_all(&bytes).map_err(|_| Disconnected)
    }
}

/// First bytes of whole frames.
const TEXT: u8 = 0x81;
const PING: u8 = 0x89;

/// A frame as a client sends it (RFC 6455, 5.2): of at most 65,535 bytes.
fn masked(kind: u8, payload: &[u8], mask: [u8; 4]) -> Vec<u8> {
    let mut frame = vec![kind];
    match u16::try_from(payload.len()) {
        Ok(len @ ..126) => frame.push(0x80 | len as u8),
        Ok(len) => {
            frame.push(0x80 | 126);
            frame.extend(len.to_be_bytes());
        }
        // An id that long is none; an empty message asks for nothing.
        Err(_) => return masked(kind, b"{}", mask),
    }
    frame.extend(mask);
    frame.extend(payload.iter().zip(mask.iter().cycle()).map(|(byte, mask)| byte ^ mask));
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

    fn unread(&mut self) -> usize {
        let read = self.counts.read.load(Ordering::Relaxed);
        let unread = self.counts.sent.load(Ordering::Relaxed).wrapping_sub(read).cast_signed();
        // Of two counts that change meanwhile the later one may be seen first.
        usize::try_from(unread).unwrap_or(0)
    }

    fn descriptor(&self) -> io::Result<OwnedFd> {
        Ok(self.socket.try_clone()?.into())
    }

    fn on_wire(&self, frame: &[u8]) -> Vec<u8> {
        command_text(frame, &self.arm, self.dialect)
            .map_or_else(Vec::new, |text| masked(TEXT, text.as_bytes(), [0x5A, 0xC3, 0x96, 0x3C]))
    }

    fn io(&self) -> IoPlacement {
        IoPlacement::OwnThread
    }
}

#[cfg(test)]
mod tests {
    use core::sync::atomic::AtomicBool;
    use std::net::TcpListener;
    use std::path::Path;
    use std::thread::JoinHandle;

    use glam::DVec3;
    use vps::spatial::Wrench;

    use super::*;
    use crate::attached::open::{self, OpenOptions};
    use crate::profile::Profile;
    use crate::protocol::haply::service::{HELLO, Service};
    use crate::protocol::{ArmReadings, Firmware as _, MAX_AXES, Outbox, Protocol, ServiceVersion};
    use crate::{Device as _, DeviceError};

    /// Longer than anything here takes on a busy machine.
    const HUNG: Duration = Duration::from_secs(20);
    const READINGS: ArmReadings = ArmReadings {
        readings: [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0],
        rates: [0.0; MAX_AXES],
        buttons: 0,
        homed: true,
        asleep: false,
    };

    /// A service of which the test says when it reads. It sends a state in every millisecond.
    struct Served {
        profile: Profile,
        reads: Arc<AtomicBool>,
        has_woken: Arc<AtomicBool>,
        /// Forces that it obeys after it has woken.
        thread: JoinHandle<u32>,
    }

    fn serve() -> Served {
        let mut profile = crate::profile::find("inverse3", Path::new("")).expect("shipped");
        let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
        let Some(Protocol::HaplyService(wanted)) =
            profile.real.as_mut().map(|real| &mut real.protocol)
        else {
            panic!("an arm behind a service")
        };
        wanted.address = listener.local_addr().expect("bound").to_string();
        wanted.version = Some(ServiceVersion(3, 5));
        let service = Service::new(wanted, ServiceVersion(3, 5));
        let reads = Arc::new(AtomicBool::new(true));
        let has_woken = Arc::new(AtomicBool::new(false));
        let thread = {
            let (reads, has_woken) = (reads.clone(), has_woken.clone());
            std::thread::spawn(move || exchange(&listener, service, &reads, &has_woken))
        };
        Served { profile, reads, has_woken, thread }
    }

    fn exchange(
        listener: &TcpListener,
        mut service: Service,
        reads: &AtomicBool,
        has_woken: &AtomicBool,
    ) -> u32 {
        let (socket, _) = listener.accept().expect("a client");
        let mut client = tungstenite::accept(socket).expect("a web socket");
        client.get_ref().set_read_timeout(Some(Duration::from_millis(1))).expect("set");
        let mut hears = |bytes: &[u8], client: &mut WebSocket<TcpStream>| {
            let mut out = Outbox::new();
            service.receive(bytes, 0.0, &READINGS, &mut out);
            for frame in out {
                let _ = client.send(Message::text(String::from_utf8(frame).expect("text")));
            }
            service.motors() != [0.0; MAX_AXES]
        };
        hears(HELLO, &mut client);
        let begin = Instant::now();
        let mut n_forced = 0;
        // Longer than the other end waits: its loss is not to be the end of this one.
        while begin.elapsed() < 4 * HUNG {
            if !reads.load(Ordering::Relaxed) {
                hears(br#"{"session": {}}"#, &mut client);
                std::thread::sleep(Duration::from_millis(1));
                continue;
            }
            match client.read() {
                Ok(Message::Text(text)) => {
                    let is_forced = hears(text.as_bytes(), &mut client);
                    n_forced += u32::from(is_forced && has_woken.load(Ordering::Relaxed));
                }
                Ok(_) => {}
                Err(tungstenite::Error::Io(error))
                    if matches!(
                        error.kind(),
                        io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut
                    ) => {}
                Err(_) => break,
            }
        }
        n_forced
    }

    /// The bytes lie with the system, which takes them in the name of the service: 900 commands were
    /// obeyed late before each was followed by a ping.
    #[test]
    fn a_service_that_sends_and_does_not_read_is_a_lost_arm_and_obeys_few_old_forces() {
        for pushes in [1, 40, 300] {
            let Served { profile, reads, has_woken, thread } = serve();
            let options =
                OpenOptions { selector: None, io_request: None, period_s: 1e-3, guard: None };
            let mut arm = open::open(&profile, &options).expect("it is there").arm;
            arm.set_enabled(true);
            let push = Wrench::new(DVec3::Z * 0.3, DVec3::ZERO);
            let begin = Instant::now();
            let mut ticks = 0;
            let lost = loop {
                if ticks == pushes {
                    reads.store(false, Ordering::Relaxed);
                }
                ticks += 1;
                if let Err(error) = arm.read().and_then(|_| arm.write(&push)) {
                    break error;
                }
                assert!(begin.elapsed() < HUNG, "it is never lost");
                std::thread::sleep(Duration::from_millis(1));
            };
            assert_eq!(lost, DeviceError::Lost);
            assert!(ticks > pushes, "{ticks}");
            has_woken.store(true, Ordering::Relaxed);
            reads.store(true, Ordering::Relaxed);
            drop(arm);
            let n_forced = thread.join().expect("no panic");
            assert!(n_forced <= 24, "{n_forced} old forces after {pushes} pushes");
        }
    }
}
