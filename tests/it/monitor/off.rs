//! Every order and event of a client that switches force off does so while everything else that
//! the server does is blocked, full, asleep or closing.
//!
//! The sources are those of the table *Off* in docs/reference/safety.md that are reachable over the
//! monitor. A block stays until force is off, so no test here measures how quick a source is.

use std::any::Any;
use std::io::{Read as _, Write as _};
use std::net::{Shutdown, SocketAddr, TcpStream};
use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, LazyLock};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use clay::engine::{ClayView, SculptOrder, SculptTool};
use crossbeam::channel::{Receiver, Sender, unbounded};
use engine::servo::CommandQueue;
use engine::supervisor::{Enable, Notice, Phase};
use hapticd::config::{self, LoadOptions, SceneConfig};
use hapticd::daemon::sculpting::Reply;
use hapticd::daemon::session::SessionHandle;
use hapticd::monitor::{
    BoundMonitor, ClayAccess, ClayParts, Hub, HubParts, MadeRecording, Monitor, RecorderError,
    RecorderStatus, RecordingControl,
};
use hapticd::scene;
use haptics::RenderScene;
use rt::clock::ClockKind;
use rt::control::{Control, Order};
use serde_json::json;
use tempfile::TempDir;
use tokio_tungstenite::tungstenite::Message;
use vps::spatial::Pose;

use super::{Client, HUNG, folder, http};

/// A server without a loop: the control word shows what a loop would do in its next tick.
pub(super) struct Server {
    pub(super) control: Arc<Control>,
    pub(super) address: SocketAddr,
    /// Ends what is stuck.
    done: Option<Sender<()>>,
    monitor: Option<Monitor>,
    /// A supervisor and a loop that are asleep.
    _asleep: (Receiver<Enable>, CommandQueue),
    _folder: TempDir,
}

/// `press.toml`, baked once for all servers.
static SCENE: LazyLock<Arc<RenderScene>> = LazyLock::new(|| Arc::new(baked(&loaded(&folder("")))));

fn loaded(folder: &TempDir) -> SceneConfig {
    config::load_with(&folder.path().join("press.toml"), &LoadOptions::default()).unwrap()
}

fn baked(config: &SceneConfig) -> RenderScene {
    scene::build(config, |_| ()).unwrap().0
}

impl Server {
    /// Force may flow. `heartbeat`: the scene needs one.
    pub(super) fn new(heartbeat: Option<Duration>) -> Self {
        let folder = folder("");
        let control = Arc::new(Control::enabled());
        let clock = ClockKind::Real;
        let (enables, asleep) = unbounded();
        let (done, stuck) = unbounded::<()>();
        let session = SessionHandle::new(loaded(&folder), LoadOptions::default(), clock, None);
        let commands = session.begin(&SCENE, Vec::new(), true);
        let bakes = stuck.clone();
        let baker = move |config: &SceneConfig| {
            let _ = bakes.recv();
            Ok((baked(config), Vec::new()))
        };
        session.begin_baking(Box::new(baker), Vec::new()).unwrap();
        let hub = Hub::new(HubParts {
            session,
            control: control.clone(),
            enables,
            heartbeat,
            clock,
            recorder: Some(Box::new(StuckRecorder(stuck.clone()))),
            metrics: None,
        });
        hub.sculpts(ClayParts {
            access: Box::new(StuckClay(stuck)),
            world_from_map: Pose::IDENTITY,
            kind: SculptTool::default(),
            folder: None,
            session_at_end: None,
        });
        hub.notice(&Notice::Phase(Phase::Enabled));
        let bound = BoundMonitor::bind(([127, 0, 0, 1], 0).into(), None, Vec::new()).unwrap();
        let address = bound.address();
        let (monitor, _) = bound.serve(hub).unwrap();
        let monitor = Some(monitor);
        let done = Some(done);
        Self { control, address, done, monitor, _asleep: (asleep, commands), _folder: folder }
    }

    pub(super) fn connect(&self) -> Client {
        Client::connect(self.address, "", &[]).unwrap()
    }

    /// What was blocked before may have switched force off.
    fn enable(&self) {
        wait_until("force is on", || {
            self.control.enable(self.control.permit());
            self.control.order() == Order::Enable
        });
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        drop(self.done.take());
        drop(self.monitor.take());
    }
}

/// A disk that does not answer until the sender is dropped.
struct StuckRecorder(Receiver<()>);

impl RecordingControl for StuckRecorder {
    fn start(&self, _: Option<&str>) -> Result<RecorderStatus, RecorderError> {
        let _ = self.0.recv();
        Err(RecorderError::State("the run is over".to_owned()))
    }

    fn stop(&self) -> Result<RecorderStatus, RecorderError> {
        Err(RecorderError::State("none is under way".to_owned()))
    }

    fn status(&self) -> Option<RecorderStatus> {
        None
    }

    fn made(&self) -> Vec<MadeRecording> {
        Vec::new()
    }

    fn report(&self, _: &Path) -> Result<String, RecorderError> {
        Err(RecorderError::File("there is none".to_owned()))
    }
}

/// A clay whose queue has no room for an order to let go until the sender is dropped.
struct StuckClay(Receiver<()>);

impl ClayAccess for StuckClay {
    fn view(&self) -> Option<Arc<ClayView>> {
        None
    }

    fn ask(&self, order: SculptOrder, reply: Reply) {
        if matches!(order, SculptOrder::Hold(false)) {
            let _ = self.0.recv();
        }
        reply(Ok(()));
    }

    fn cancel(&self) {}
}

/// Within this time a source acts. Later a rule of the server would have done it: it expels a
/// client that takes nothing after 5 s, and one that sends nothing after 30 s.
const BEFORE_THE_SERVER: Duration = Duration::from_secs(4);

fn wait_until(what: &str, mut is_it: impl FnMut() -> bool) {
    let began = Instant::now();
    while !is_it() {
        assert!(began.elapsed() < HUNG, "{what}: it did not come to that");
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// Names of the sources of the table *Off* that `tests/it/monitor/off.rs` is to try.
fn sources() -> Vec<String> {
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/reference/safety.md");
    let page = std::fs::read_to_string(page).unwrap();
    let section = page.split("\n## ").find(|section| section.starts_with("Off\n")).unwrap();
    let rows = section.lines().filter(|line| line.starts_with("| `"));
    let ours = rows.filter(|line| line.contains("tests/it/monitor/off.rs"));
    ours.map(|line| line.split('`').nth(1).unwrap().to_owned()).collect()
}

/// A source acts. `driver`: a client that was there before anything was blocked.
fn act(source: &str, server: &Server, mut driver: Client) -> Box<dyn Any> {
    let ask = |client: &mut Client, what: serde_json::Value| {
        client.socket.send(Message::from(what.to_string())).unwrap()
    };
    let post = |path| {
        let answer = http(server.address, "POST", path, &[], b"").map(|(status, _)| status);
        assert_eq!(answer.ok(), Some(200), "{path}");
    };
    match source {
        "http disable" => post("/api/v1/disable"),
        "http stop" => post("/api/v1/stop"),
        "websocket disable" => ask(&mut driver, json!({ "do": "disable" })),
        "websocket stop" => ask(&mut driver, json!({ "do": "stop" })),
        "silence" => ask(&mut driver, json!({ "do": "heartbeat", "timeout_ms": 20 })),
        "lost client" => {
            driver.does(json!({ "do": "heartbeat", "timeout_ms": 10_000 }));
            drop(driver);
            return Box::new(());
        }
        // It stays connected, and never sent a heartbeat: the scene of this server needs one.
        "no heartbeat" => {}
        "expelled client" => driver.socket.send(Message::from(vec![0_u8])).unwrap(),
        other => panic!("docs/reference/safety.md has a source that is not tried: {other}"),
    }
    Box::new(driver)
}

/// A thread that goes on until it is dropped.
struct Busy(Arc<AtomicBool>, Option<JoinHandle<()>>);

impl Busy {
    fn begin(mut work: impl FnMut() + Send + 'static) -> Box<dyn Any> {
        let is_over = Arc::new(AtomicBool::new(false));
        let over = is_over.clone();
        let work = move || {
            while !over.load(Ordering::Relaxed) {
                work();
            }
        };
        Box::new(Self(is_over, Some(std::thread::spawn(work))))
    }
}

impl Drop for Busy {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
        let _ = self.1.take().unwrap().join();
    }
}

/// As many connections as the server has slots, and more, that have each sent this and wait.
fn crowd(address: SocketAddr, sent: &[u8], reads: bool) -> Vec<TcpStream> {
    let open = || {
        let mut stream = TcpStream::connect(address).ok()?;
        stream.set_read_timeout(Some(HUNG)).ok()?;
        stream.write_all(sent).ok()?;
        if reads {
            // One that had to give way meanwhile reads nothing.
            let _ = stream.read(&mut [0; 4096]);
        }
        Some(stream)
    };
    (0..220).filter_map(|_| open()).collect()
}

type Block = fn(&Server, &mut Client) -> Box<dyn Any>;

const BLOCKS: [(&str, Block); 10] = [
    ("nothing", |_, _| Box::new(())),
    ("a disk that does not answer, and 200 requests that wait for it", |_, driver| {
        for _ in 0..200 {
            driver.send(&json!({ "do": "record" }));
        }
        Box::new(())
    }),
    ("1,500 requests of the same client", |_, driver| {
        for _ in 0..1500 {
            driver.send(&json!({ "do": "set", "parameter": "limit_force_n", "value": 1 }));
        }
        Box::new(())
    }),
    ("a flood of another client", |server, _| {
        let mut client = server.connect();
        Busy::begin(move || {
            // What is asked too often is refused, and the answers are read.
            (0..100).for_each(|_| client.send(&json!({ "do": "ping" })));
            (0..100).for_each(|_| _ = client.json());
        })
    }),
    ("a client that reads nothing, with its buffers full", |server, _| {
        let mut deaf = server.connect();
        let id = "x".repeat(200);
        (0..1000).for_each(|_| deaf.send(&json!({ "id": id, "do": "ping" })));
        Box::new(deaf)
    }),
    ("idle connections in all slots", |server, _| {
        let request = b"GET /api/v1/info HTTP/1.1\r\nHost: localhost\r\n\r\n";
        Box::new(crowd(server.address, request, true))
    }),
    ("uploads under way in all slots", |server, _| {
        // Of files for the clay only one is under way at a time.
        let request =
            b"POST /api/v1/hand HTTP/1.1\r\nHost: localhost\r\nContent-Length: 60000\r\n\r\n{";
        Box::new(crowd(server.address, request, false))
    }),
    ("WebSockets in all seats", |server, _| {
        Box::new((0..63).map(|_| server.connect()).collect::<Vec<_>>())
    }),
    ("a lapsed hold of clay whose queue is full", |server, driver| {
        let hold = json!({ "do": "clay_hold", "held": true });
        let mut holder = server.connect();
        holder.does(hold.clone());
        drop(holder);
        // It has lapsed when the driver may hold: the thread that lets go for it is stuck.
        wait_until("the hold has lapsed", || driver.ask(hold.clone())["ok"] == true);
        Box::new(())
    }),
    ("a scene that is being baked, and 200 requests for others", |_, driver| {
        for _ in 0..200 {
            driver.send(&json!({ "do": "switch", "scene": "press" }));
        }
        Box::new(())
    }),
];

#[test]
fn every_source_switches_force_off_whatever_else_is_blocked() {
    let sources = sources();
    assert_eq!(sources.len(), 8, "{sources:?}");
    for source in &sources {
        for (name, block) in BLOCKS {
            let heartbeat = (source == "no heartbeat").then_some(Duration::from_millis(100));
            let server = Server::new(heartbeat);
            let mut driver = server.connect();
            let blocked = block(&server, &mut driver);
            server.enable();
            let began = Instant::now();
            let acting = act(source, &server, driver);
            wait_until(&format!("{source}, with {name}"), || {
                let is_in_time = began.elapsed() < BEFORE_THE_SERVER;
                assert!(is_in_time, "{source}, with {name}: it did not act");
                server.control.order() != Order::Enable
            });
            let ends = source.ends_with("stop");
            assert_eq!(server.control.order() == Order::Stop, ends, "{source}, with {name}");
            drop((acting, blocked));
        }
    }
}

#[test]
fn a_stuck_clay_does_not_delay_the_next_silence() {
    let server = Server::new(None);
    let mut holder = server.connect();
    holder.does(json!({ "do": "clay_hold", "held": true }));
    // The order to let go finds no room, and the thread of the hold is stuck in it.
    drop(holder);
    let mut driver = server.connect();
    for _ in 0..3 {
        driver.does(json!({ "do": "heartbeat", "timeout_ms": 20 }));
        server.enable();
        wait_until("silent", || server.control.order() == Order::Disable);
        driver.does(json!({ "do": "ping" }));
    }
}

#[test]
fn a_burst_is_answered_and_its_client_keeps_its_connection() {
    let server = Server::new(None);
    let mut client = server.connect();
    // More than a server may have to say to one client at a time.
    for id in 0..1500 {
        client.send(&json!({ "id": id, "do": "set", "parameter": "limit_force_n", "value": 1 }));
    }
    client.send(&json!({ "id": 1500, "do": "disable" }));
    let mut next = 0;
    while next <= 1500 {
        let message = client.json();
        if message["type"] == "reply" {
            assert_eq!(message["id"], next);
            next += 1;
        }
    }
    assert_eq!(server.control.order(), Order::Disable);
    client.does(json!({ "do": "ping" }));
}

#[test]
fn a_flood_does_not_hold_up_its_own_disable() {
    const N: usize = 12_000;
    let server = Server::new(None);
    let mut client = server.connect();
    let mut replies = client.socket.get_ref().try_clone().unwrap();
    let drained = std::thread::spawn(move || {
        let mut buffer = [0; 1 << 16];
        while let Ok(1..) = replies.read(&mut buffer) {}
    });
    // Another client counts what the server does meanwhile.
    let mut other = server.connect();
    let done = Arc::new(AtomicUsize::new(0));
    let counted = done.clone();
    let counting = Busy::begin(move || {
        other.does(json!({ "do": "ping" }));
        counted.fetch_add(1, Ordering::Relaxed);
    });
    for _ in 0..N {
        client.send(&json!({ "do": "set", "parameter": "limit_force_n", "value": 1 }));
    }
    client.send(&json!({ "do": "disable" }));
    let before = done.load(Ordering::Relaxed);
    wait_until("disable", || server.control.order() == Order::Disable);
    let meanwhile = done.load(Ordering::Relaxed) - before;
    // 64 of these requests are done in a turn, and all were sent.
    assert!(meanwhile <= N / 16, "{meanwhile} requests of another client went first");
    drop(counting);
    client.socket.get_ref().shutdown(Shutdown::Both).unwrap();
    drained.join().unwrap();
}

#[test]
fn off_is_obeyed_from_a_connection_that_is_being_closed() {
    let server = Server::new(None);
    let mut client = server.connect();
    client.socket.write(Message::from(vec![0_u8])).unwrap();
    client.socket.write(Message::from(json!({ "do": "stop" }).to_string())).unwrap();
    client.socket.flush().unwrap();
    assert_eq!(client.close_code(), Some(1003));
    wait_until("stop", || server.control.order() == Order::Stop);
}

#[test]
fn a_client_that_goes_by_itself_leaves_force_as_it_is() {
    let server = Server::new(None);
    for is_polite in [false, true] {
        let mut client = server.connect();
        client.does(json!({ "do": "ping" }));
        if is_polite {
            client.socket.close(None).unwrap();
            client.close_code();
        }
        drop(client);
    }
    // A connection is over before the next one is answered.
    server.connect().does(json!({ "do": "ping" }));
    assert_eq!(server.control.order(), Order::Enable);
}
