//! A WebSocket server: what the Inverse service is to its clients. Each client has a thread; the
//! arm answers one after the other.

use core::sync::atomic::{AtomicBool, Ordering};
use core::time::Duration;
use std::collections::VecDeque;
use std::io::{self, BufRead, BufReader, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};

use tungstenite::{Message, WebSocket};

use super::link::{ArmLink, LinkError};
use super::serve::BUFFER;
use crate::protocol::Firmware;
use crate::protocol::haply::HaplyService;
use crate::protocol::haply::service::{HELLO, Service};
use crate::protocol::{Protocol, ServiceVersion};

/// How long a client may take to say what it wants.
const ENTER_PATIENCE: Duration = Duration::from_secs(2);
/// How long a client may leave its answer unread before it is let go.
const ANSWER_PATIENCE: Duration = Duration::from_secs(1);
/// Longest line of a request.
const LINE_MAX: u64 = 8192;

/// What a client said; `None`: it has gone.
type ClientMessage = (Arc<Client>, Option<Vec<u8>>);

#[derive(Debug)]
struct Client {
    /// Its thread reads the other handle of the same socket.
    writer: Mutex<WebSocket<TcpStream>>,
}

impl Client {
    fn write(&self, message: Message) -> bool {
        self.writer.lock().unwrap_or_else(PoisonError::into_inner).send(message).is_ok()
    }
}

/// The service's end: a listening port.
#[derive(Debug)]
pub struct ServiceServer {
    address: SocketAddr,
    version: String,
    /// `None`: the plug is out.
    listener: Option<TcpListener>,
    /// Every client that has come.
    sockets: Vec<TcpStream>,
    said: Receiver<ClientMessage>,
    to_said: Sender<ClientMessage>,
    /// What came while the arm waited.
    next: Option<ClientMessage>,
    /// Whom the next answers are for.
    asked: VecDeque<Arc<Client>>,
    /// The last answer, and whose it was.
    last: Option<(Arc<Client>, Message)>,
    /// Nothing is read; the last answer goes out again and again.
    is_deaf: Arc<AtomicBool>,
    gone: bool,
}

/// The arm's side of a profile of the service.
///
/// # Errors
/// Another profile, or a version that is none.
pub fn firmware(protocol: &Protocol, version: &str) -> Result<Box<dyn Firmware>, &'static str> {
    let Protocol::HaplyService(wanted) = protocol else {
        return Err("only arms behind the Inverse service have --service");
    };
    let version = version
        .parse()
        .map_err(|()| "--service-version is major, minor and patch, such as 3.5.0")?;
    Ok(served(wanted, version))
}

fn served(wanted: &HaplyService, version: ServiceVersion) -> Box<dyn Firmware> {
    Box::new(Service::new(wanted, version))
}

impl ServiceServer {
    /// Listens; port 0 is any that is free.
    ///
    /// # Errors
    /// The port is taken.
    pub fn new(address: SocketAddr, version: &str) -> Result<Self, LinkError> {
        let (to_said, said) = channel();
        let asked = VecDeque::new();
        let mut server = Self {
            address,
            version: version.to_owned(),
            listener: None,
            sockets: Vec::new(),
            said,
            to_said,
            next: None,
            asked,
            last: None,
            is_deaf: Arc::default(),
            gone: false,
        };
        server.replug()?;
        Ok(server)
    }

    /// Lets clients in that wait at the port.
    fn accept(&mut self) {
        while let Some((socket, _)) =
            self.listener.as_ref().and_then(|listener| listener.accept().ok())
        {
            let Ok(kept) = socket.try_clone() else { continue };
            self.sockets.push(kept);
            let version = self.version.clone();
            let said = self.to_said.clone();
            let is_deaf = self.is_deaf.clone();
            std::thread::spawn(move || {
                // A client that does not speak HTTP has gone already.
                let _ = talk(socket, &version, &said, &is_deaf);
            });
        }
    }

    /// Where it listens.
    pub fn address(&self) -> SocketAddr {
        self.address
    }
}

/// One client, from its first line to its end.
fn talk(
    socket: TcpStream,
    version: &str,
    said: &Sender<ClientMessage>,
    is_deaf: &AtomicBool,
) -> io::Result<()> {
    socket.set_nonblocking(false)?;
    socket.set_nodelay(true)?;
    socket.set_read_timeout(Some(ENTER_PATIENCE))?;
    socket.set_write_timeout(Some(ANSWER_PATIENCE))?;
    // A look at the request that takes nothing of it: a web socket reads it again.
    let mut head = [0; LINE_MAX as usize];
    let n = loop {
        let n = socket.peek(&mut head)?;
        let is_whole = head[..n].windows(4).any(|four| four == b"\r\n\r\n");
        if n == 0 || n == head.len() || is_whole {
            break n;
        }
        std::thread::sleep(Duration::from_millis(1));
    };
    let is_upgrade =
        String::from_utf8_lossy(&head[..n]).to_ascii_lowercase().contains("upgrade: websocket");
    if !is_upgrade {
        return answer_http(socket, version);
    }
    let other = |text: String| io::Error::other(text);
    let writer = socket.try_clone()?;
    let mut reader = tungstenite::accept(socket).map_err(|error| other(error.to_string()))?;
    reader.get_ref().set_read_timeout(None)?;
    let writer = WebSocket::from_raw_socket(writer, tungstenite::protocol::Role::Server, None);
    let client = Arc::new(Client { writer: Mutex::new(writer) });
    let tell =
        |what| said.send((client.clone(), what)).map_err(|_| other("the arm has ended".to_owned()));
    tell(Some(HELLO.to_vec()))?;
    loop {
        while is_deaf.load(Ordering::Relaxed) {
            std::thread::sleep(Duration::from_millis(1));
        }
        match reader.read() {
            Ok(Message::Text(text)) => tell(Some(text.as_bytes().to_vec()))?,
            Ok(Message::Close(_)) | Err(_) => return tell(None),
            Ok(_) => {}
        }
    }
}

fn answer_http(socket: TcpStream, version: &str) -> io::Result<()> {
    let mut request = BufReader::new(io::Read::take(socket.try_clone()?, LINE_MAX));
    let mut line = String::new();
    request.read_line(&mut line)?;
    let path = line.split_whitespace().nth(1).unwrap_or("/");
    let (status, body) = match path.split('?').next() {
        Some("/version") => (
            "200 OK",
            serde_json::json!({
                "build_time": "", "git_branch": "", "git_describe": version, "git_hash": "", "git_tag": version,
                "project_name": "haply-inverse-service", "project_version": version,
            }),
        ),
        _ => (
            "404 Not Found",
            serde_json::json!({ "ok": false, "error": format!("this mock has no {path}") }),
        ),
    };
    // The rest of the request has to be read, or the answer is lost with it.
    while request.read_line(&mut line)? > 2 {}
    let body = body.to_string();
    let mut socket = socket;
    write!(
        &mut socket,
        "HTTP/1.1 {status}\r\nContent-Type: application/json\r\nContent-Length: {}\r\nConnection: \
            close\r\n\r\n{body}",
        body.len()
    )?;
    socket.shutdown(std::net::Shutdown::Both)
}

impl ArmLink for ServiceServer {
    fn wait(&mut self, timeout: Duration) {
        if self.next.is_none() {
            match self.said.recv_timeout(timeout) {
                Ok(said) => self.next = Some(said),
                Err(RecvTimeoutError::Timeout | RecvTimeoutError::Disconnected) => {}
            }
        }
    }

    fn receive(&mut self, buffer: &mut [u8]) -> usize {
        self.accept();
        while let Some((client, said)) = self.next.take().or_else(|| self.said.try_recv().ok()) {
            let Some(text) = said else {
                self.asked.retain(|asked| !Arc::ptr_eq(asked, &client));
                self.gone = true;
                continue;
            };
            // A message that does not fit asks for nothing that an arm knows, and is answered all
            // the same.
            let text = if text.len() <= buffer.len() { text.as_slice() } else { b"{}" };
            let n = text.len().min(buffer.len());
            buffer[..n].copy_from_slice(&text[..n]);
            self.asked.push_back(client);
            return n;
        }
        0
    }

    fn send(&mut self, frame: &[u8]) -> bool {
        let Some(client) = self.asked.pop_front() else { return false };
        let answer = Message::text(String::from_utf8_lossy(frame).into_owned());
        self.last = Some((client.clone(), answer.clone()));
        client.write(answer)
    }

    fn set_deaf(&mut self, is_deaf: bool) {
        self.is_deaf.store(is_deaf, Ordering::Relaxed);
        if let Some((client, answer)) = self.last.as_ref().filter(|_| is_deaf) {
            client.write(answer.clone());
        }
    }

    fn backlog_share(&self) -> usize {
        BUFFER
    }

    fn unplug(&mut self) -> Result<(), LinkError> {
        self.listener = None;
        for socket in self.sockets.drain(..) {
            let _ = socket.shutdown(std::net::Shutdown::Both);
        }
        self.asked.clear();
        self.last = None;
        self.next = None;
        Ok(())
    }

    fn replug(&mut self) -> Result<(), LinkError> {
        let listen = |address| {
            let listener = TcpListener::bind(address)?;
            listener.set_nonblocking(true)?;
            Ok((listener.local_addr()?, listener))
        };
        let (address, listener) = listen(self.address).map_err(|cause| LinkError::Node {
            what: format!("listen at {}", self.address),
            cause,
        })?;
        (self.address, self.listener) = (address, Some(listener));
        Ok(())
    }

    fn is_host_gone(&self) -> bool {
        self.gone
    }
}

impl Drop for ServiceServer {
    fn drop(&mut self) {
        let _ = self.unplug();
    }
}
