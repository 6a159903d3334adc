//! The monitor as its clients meet it: a real run, real connections.

mod access;
pub(crate) mod clay;
mod heartbeat;
mod hostile;
mod off;
mod orders;
mod streams;

use std::fs;
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::{SocketAddr, TcpStream};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use serde_json::{Value, json};
use tempfile::TempDir;
use tokio_tungstenite::tungstenite::client::IntoClientRequest as _;
use tokio_tungstenite::tungstenite::{self, Message, WebSocket};

/// A process that has not answered by then hangs.
const HUNG: Duration = Duration::from_secs(120);

/// A block over a plate that may move, pressed on it by its hand from 300 ms on: a scene that bakes
/// in no time.
const SCENE: &str = r#"version = 1
name = "press"
[[static]]
name = "plate"
shape = { box_mm = [60.0, 60.0, 20.0] }
voxel_size_mm = 2.0
layers = 4
movable = true
position_mm = [0, 0, -10]
[tool]
shape = { box_mm = [20.0, 20.0, 20.0] }
voxel_size_mm = 2.0
mass_g = 100.0
start_position_mm = [0, 0, 12]
[device]
profile = "sim-sigma7"
hand = "hand.csv"
"#;
const HAND: &str = "t_s,x_m,y_m,z_m,qx,qy,qz,qw\n0,0,0,0.012,0,0,0,1\n0.2,0,0,0.012,0,0,0,1\n0.6,0,0,0.006,0,0,0,1\n";

/// A run with its monitor, which does not outlive its test.
pub(crate) struct Daemon {
    child: Child,
    pub(crate) address: SocketAddr,
    /// That the run has made.
    token: Option<String>,
    stderr: Receiver<String>,
    said: String,
    folder: TempDir,
}

/// What a run left behind.
pub(crate) struct Ended {
    pub(crate) code: Option<i32>,
    pub(crate) json: Value,
    pub(crate) stderr: String,
}

/// The scene with more keys at its end. Its stiffness is that of its messages of version 0.1.0.
fn text(more: &str) -> String {
    let contact =
        if more.contains("[contact]") { "" } else { "[contact]\nstiffness_n_per_mm3 = 1.25\n" };
    format!("{SCENE}{contact}{more}")
}

/// A folder with the scene `press.toml`, with more keys at its end.
pub(crate) fn folder(more: &str) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("press.toml"), text(more)).unwrap();
    fs::write(folder.path().join("hand.csv"), HAND).unwrap();
    folder
}

/// `hapticd run` in a folder, not started.
pub(crate) fn command(folder: &Path, line: &str) -> Command {
    command_to("run", folder, line)
}

fn command_to(verb: &str, folder: &Path, line: &str) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_hapticd"));
    command
        .arg(verb)
        .args(line.split_whitespace())
        .current_dir(folder)
        .env("XDG_CACHE_HOME", folder)
        .env("XDG_STATE_HOME", folder)
        .env_remove("HAPTICD_TOKEN");
    command
}

impl Daemon {
    /// A run of `press.toml` on the real clock, with more keys in the scene and more flags.
    pub(crate) fn start(more: &str, flags: &str) -> Self {
        Self::of(folder(more), flags, &[])
    }

    pub(crate) fn of(folder: TempDir, flags: &str, variables: &[(&str, &str)]) -> Self {
        let line =
            format!("press.toml --json --realtime best-effort --monitor 127.0.0.1:0 {flags}");
        let command = command(folder.path(), &line);
        Self::launch(folder, command, variables)
    }

    /// `hapticd sculpt` on a scene of this text, with a hand that goes along this path, once force
    /// flows.
    pub(crate) fn sculpting(scene: &str, hand: &str) -> Self {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join("clay.toml"), scene).unwrap();
        fs::write(folder.path().join("hand.csv"), hand).unwrap();
        let command = command_to(
            "sculpt",
            folder.path(),
            "clay.toml --json --realtime best-effort --monitor 127.0.0.1:0 --hand-repeat",
        );
        let mut daemon = Self::launch(folder, command, &[]);
        daemon.wait_for("state: enabled");
        daemon
    }

    fn launch(folder: TempDir, mut command: Command, variables: &[(&str, &str)]) -> Self {
        let mut child = command
            .envs(variables.iter().copied())
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let lines = BufReader::new(child.stderr.take().unwrap());
        let (sender, stderr) = channel();
        std::thread::spawn(move || {
            lines.lines().map_while(Result::ok).try_for_each(|line| sender.send(line))
        });
        let mut daemon = Self {
            child,
            address: ([127, 0, 0, 1], 0).into(),
            token: None,
            stderr,
            said: String::new(),
            folder,
        };
        let line = daemon.wait_for("monitor: http://");
        let (address, rest) = line["monitor: http://".len()..].split_once('/').unwrap();
        daemon.address = address.parse().unwrap();
        daemon.token = rest.strip_prefix("#token=").map(str::to_owned);
        daemon
    }

    /// The same, once force flows.
    pub(crate) fn enabled(more: &str, flags: &str) -> Self {
        let mut daemon = Self::start(more, flags);
        daemon.wait_for("state: enabled");
        daemon
    }

    /// Waits for a line of stderr that begins so.
    pub(crate) fn wait_for(&mut self, wanted: &str) -> String {
        loop {
            match self.stderr.recv_timeout(HUNG) {
                Ok(line) => {
                    self.said.extend([&line, "\n"]);
                    if line.starts_with(wanted) {
                        return line;
                    }
                }
                Err(error) => panic!("{error}: no `{wanted}` after\n{}", self.said),
            }
        }
    }

    pub(crate) fn connect(&self) -> Client {
        Client::connect(self.address, "", &[]).unwrap_or_else(|error| panic!("{error}"))
    }

    /// Ends the run as Ctrl-C does.
    pub(crate) fn end(mut self) -> Ended {
        let sent = Command::new("sh")
            .args(["-c", &format!("kill -INT {}", self.child.id())])
            .status()
            .unwrap();
        assert!(sent.success());
        self.ended()
    }

    /// Waits for the end of the run.
    pub(crate) fn ended(&mut self) -> Ended {
        let mut stdout = String::new();
        self.child.stdout.take().unwrap().read_to_string(&mut stdout).unwrap();
        let code = self.child.wait().unwrap().code();
        let mut stderr = core::mem::take(&mut self.said);
        stderr.extend(self.stderr.iter().flat_map(|line| [line, "\n".to_owned()]));
        Ended { code, json: serde_json::from_str(&stdout).unwrap_or(Value::Null), stderr }
    }

    /// Where the run keeps what clients save.
    pub(crate) fn state_folder(&self) -> PathBuf {
        self.folder.path().join("hapticd")
    }

    pub(crate) fn id(&self) -> u32 {
        self.child.id()
    }

    /// One request; status and body.
    pub(crate) fn http(
        &self,
        method: &str,
        path: &str,
        headers: &[(&str, &str)],
        body: &str,
    ) -> (u16, Value) {
        let (status, body) = http(self.address, method, path, headers, body.as_bytes()).unwrap();
        (
            status,
            serde_json::from_slice(&body)
                .unwrap_or_else(|_| Value::String(String::from_utf8_lossy(&body).into_owned())),
        )
    }

    pub(crate) fn get(&self, path: &str) -> Value {
        let (status, body) = self.http("GET", path, &[], "");
        assert_eq!(status, 200, "{path}: {body}");
        body
    }
}

impl Drop for Daemon {
    fn drop(&mut self) {
        // Gone already, most of the time.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// One request over a connection of its own; status and body.
pub(crate) fn http(
    address: SocketAddr,
    method: &str,
    path: &str,
    headers: &[(&str, &str)],
    body: &[u8],
) -> std::io::Result<(u16, Vec<u8>)> {
    let mut stream = TcpStream::connect(address)?;
    stream.set_read_timeout(Some(HUNG))?;
    let mut head = format!(
        "{method} {path} HTTP/1.1\r\nConnection: close\r\nContent-Length: {}\r\n",
        body.len()
    );
    if !headers.iter().any(|(name, _)| *name == "Host") {
        head += &format!("Host: {address}\r\n");
    }
    for (name, value) in headers {
        head += &format!("{name}: {value}\r\n");
    }
    stream.write_all(format!("{head}\r\n").as_bytes())?;
    // An answer may come before the body has been read.
    let _ = stream.write_all(body);
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer)?;
    let end = answer
        .windows(4)
        .position(|bytes| bytes == b"\r\n\r\n")
        .ok_or(std::io::ErrorKind::InvalidData)?;
    let status = String::from_utf8_lossy(&answer[..end])
        .split(' ')
        .nth(1)
        .and_then(|status| status.parse().ok());
    Ok((status.ok_or(std::io::ErrorKind::InvalidData)?, answer.split_off(end + 4)))
}

/// A WebSocket client that waits for what it wants to see.
pub(crate) struct Client {
    pub(crate) socket: WebSocket<TcpStream>,
    next_id: u64,
    /// The greeting.
    pub(crate) hello: Value,
    /// Events that came while something else was waited for.
    pub(crate) events: Vec<Value>,
}

impl Client {
    /// Connects and takes the greeting.
    pub(crate) fn connect(
        address: SocketAddr,
        query: &str,
        headers: &[(&str, &str)],
    ) -> Result<Self, String> {
        let mut request = format!("ws://{address}/api/v1/ws{query}").into_client_request().unwrap();
        for (name, value) in headers {
            let name: tungstenite::http::HeaderName = name.parse().unwrap();
            request.headers_mut().insert(name, value.parse().unwrap());
        }
        let stream = TcpStream::connect(address).map_err(|error| error.to_string())?;
        stream.set_read_timeout(Some(HUNG)).unwrap();
        let (socket, _) = tungstenite::client(request, stream).map_err(|error| match error {
            tungstenite::HandshakeError::Failure(tungstenite::Error::Http(response)) => {
                response.status().as_str().to_owned()
            }
            error => error.to_string(),
        })?;
        let mut client = Self { socket, next_id: 1, hello: Value::Null, events: Vec::new() };
        client.hello = client.json();
        assert_eq!((&client.hello["type"], &client.hello["api"]), (&"hello".into(), &1.into()));
        Ok(client)
    }

    pub(crate) fn send(&mut self, request: &Value) {
        self.socket.send(Message::from(request.to_string())).unwrap();
    }

    /// The next message that is an object.
    pub(crate) fn json(&mut self) -> Value {
        loop {
            match self.socket.read() {
                Ok(Message::Text(text)) => return serde_json::from_str(&text).unwrap(),
                Ok(Message::Ping(_) | Message::Pong(_) | Message::Binary(_)) => {}
                other => panic!("{other:?}"),
            }
        }
    }

    /// Sends a request and waits for its answer.
    pub(crate) fn ask(&mut self, mut request: Value) -> Value {
        let id = self.next_id;
        self.next_id += 1;
        request["id"] = id.into();
        self.send(&request);
        let started = Instant::now();
        loop {
            let message = self.json();
            match message["type"].as_str() {
                Some("reply") if message["id"] == id => return message,
                Some("event") => self.events.push(message),
                _ => assert!(started.elapsed() < HUNG, "no answer to {request}"),
            }
        }
    }

    /// The same for a request that has to be done.
    pub(crate) fn does(&mut self, request: Value) {
        let reply = self.ask(request.clone());
        assert_eq!(reply["ok"], true, "{request}: {reply}");
    }

    /// Waits for a state; needs a subscription.
    pub(crate) fn state_where(&mut self, is_it: impl Fn(&Value) -> bool) -> Value {
        let started = Instant::now();
        let mut last = Value::Null;
        while started.elapsed() < HUNG {
            let message = self.json();
            match message["type"].as_str() {
                Some("state") if is_it(&message) => return message,
                Some("state") => last = message,
                Some("event") => self.events.push(message),
                _ => {}
            }
        }
        panic!("it did not come to that: {last}");
    }

    pub(crate) fn state(&mut self) -> Value {
        self.state_where(|_| true)
    }

    /// Waits for an event of a kind, with a word among its names if it is not empty.
    pub(crate) fn event(&mut self, kind: &str, name: &str) -> Value {
        let is_it = |event: &Value| {
            let names = event["names"].as_array().cloned().unwrap_or_default();
            event["event"] == kind && (name.is_empty() || names.iter().any(|known| known == name))
        };
        if let Some(known) = self.events.iter().position(is_it) {
            return self.events.remove(known);
        }
        let started = Instant::now();
        while started.elapsed() < HUNG {
            let message = self.json();
            if message["type"] == "event" {
                if is_it(&message) {
                    return message;
                }
                self.events.push(message);
            }
        }
        panic!("no event `{kind}` {name}");
    }

    pub(crate) fn subscribe(&mut self, rate_hz: f64) {
        self.does(json!({ "do": "subscribe", "rate_hz": rate_hz }));
    }

    /// Reads until the other end closes; the code that it gives, if it does so properly.
    pub(crate) fn close_code(&mut self) -> Option<u16> {
        loop {
            match self.socket.read() {
                Ok(Message::Close(frame)) => return frame.map(|frame| frame.code.into()),
                Ok(_) => {}
                Err(_) => return None,
            }
        }
    }
}

/// Length of a vector in a message.
pub(crate) fn length(vector: &Value) -> f64 {
    vector
        .as_array()
        .unwrap()
        .iter()
        .map(|number| number.as_f64().unwrap().powi(2))
        .sum::<f64>()
        .sqrt()
}

pub(crate) fn scene_file(folder: &TempDir, name: &str, more: &str) -> PathBuf {
    let path = folder.path().join(name);
    fs::write(&path, text(more)).unwrap();
    path
}

/// What was rendered and what was missed are all ticks there were.
pub(crate) fn no_record_lost(ended: &Ended) {
    assert_eq!(ended.json["dropped_records"], 0, "{}", ended.json);
    assert!(ended.json["ticks"].as_u64() > Some(0), "{}", ended.json);
}
