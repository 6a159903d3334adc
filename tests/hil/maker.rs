//! Arms behind a library or a service of their maker, driven by this process: the mock arm in a
//! thread, and what its motors did in a file.
//!
//! ```text
//!   this test ─ WiredArm ─ page ─ worker (hapticd vendor-arm) ─ libmock_drd.so, … ─ socket ─ mock arm
//!             └ WiredArm ─ WebSocket ─────────────────────────────────────── mock service and arm
//! ```

use std::fs;
use std::io::{ErrorKind, Read as _, Write as _};
use std::net::TcpListener;
use std::os::fd::AsFd as _;
use std::os::unix::fs::symlink;
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use arms::attached::nodes::Selector;
use arms::attached::open::{self, OpenError, OpenOptions, OpenedArm};
use arms::mock::builder::{self, MockSettings};
use arms::mock::pty::Pty;
use arms::mock::serve::{Serving, serve};
use arms::mock::service::{self, ServiceServer};
use arms::mock::trace::TraceFile;
use arms::mock::{ArmLink, LinkError, MockArm, MockReport};
use arms::profile::{self, Profile};
use arms::protocol::{Firmware, Protocol};
use arms::simulated::{HandParameters, fault};
use arms::transport::Carriage;
use arms::{Device as _, DeviceError};
use glam::DVec3;
use rt::schedule::{self, ThreadRequest};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use tempfile::TempDir;
use vps::spatial::{DeviceSample, SampleStatus, Wrench};

const HAPTICD: &str = env!("CARGO_BIN_EXE_hapticd");
/// Longer than anything here takes on a busy machine.
pub(crate) const HUNG: Duration = Duration::from_secs(20);
/// What a busy machine adds to a time that the mock arm keeps: a period of it, and a line of its
/// file.
pub(crate) const LATENESS_MS: f64 = 10.0;
/// As much as unverified signs leave.
pub(crate) const PUSH: Wrench = Wrench { force: DVec3::new(0.0, 0.0, 0.4), torque: DVec3::ZERO };

/// Above any host: firmware does not wait for the host.
const ARM_PRIORITY: u8 = 90;
const WORKER_PRIORITY: u8 = 85;
pub(crate) const LOOP_PRIORITY: u8 = 80;

/// A profile of `devices/`.
pub(crate) fn shipped(name: &str) -> Profile {
    profile::find(name, Path::new("")).expect("shipped")
}

/// Lets this thread run before what else computes, where that is allowed.
pub(crate) fn keep_time(priority: u8) {
    let _ = schedule::enter_fifo(priority);
}

/// What a stand-in has in the place of its arm's cable. Not a tty: that passes bytes on in a thread
/// of the kernel, for which a busy machine has no time.
struct Cable {
    path: PathBuf,
    listener: Option<UnixListener>,
    stream: Option<UnixStream>,
}

impl Cable {
    fn new(path: PathBuf) -> Self {
        let mut cable = Self { path, listener: None, stream: None };
        cable.replug().expect("a socket");
        cable
    }
}

impl ArmLink for Cable {
    fn wait(&mut self, timeout: Duration) {
        let listener = self.listener.as_ref().map(UnixListener::as_fd);
        let Some(fd) = self.stream.as_ref().map(UnixStream::as_fd).or(listener) else {
            return std::thread::sleep(timeout);
        };
        let timeout = Timespec { tv_sec: 0, tv_nsec: timeout.subsec_nanos().into() };
        let _ = poll(&mut [PollFd::from_borrowed_fd(fd, PollFlags::IN)], Some(&timeout));
    }

    fn receive(&mut self, buffer: &mut [u8]) -> usize {
        if self.stream.is_none()
            && let Some((stream, _)) =
                self.listener.as_ref().and_then(|listener| listener.accept().ok())
        {
            stream.set_nonblocking(true).expect("a socket");
            self.stream = Some(stream);
        }
        match self.stream.as_mut().map(|stream| stream.read(buffer)) {
            Some(Ok(n @ 1..)) => n,
            Some(Err(error)) if error.kind() == ErrorKind::WouldBlock => 0,
            _ => {
                // The host has gone, and another may come.
                self.stream = None;
                0
            }
        }
    }

    fn send(&mut self, frame: &[u8]) -> bool {
        self.stream.as_mut().is_some_and(|stream| stream.write_all(frame).is_ok())
    }

    fn unplug(&mut self) -> Result<(), LinkError> {
        (self.listener, self.stream) = (None, None);
        let _ = fs::remove_file(&self.path);
        Ok(())
    }

    fn replug(&mut self) -> Result<(), LinkError> {
        let of =
            |cause| LinkError::Node { what: format!("listen at {}", self.path.display()), cause };
        let listener = UnixListener::bind(&self.path).map_err(of)?;
        listener.set_nonblocking(true).map_err(of)?;
        self.listener = Some(listener);
        Ok(())
    }

    fn is_host_gone(&self) -> bool {
        false
    }
}

/// A mock arm in a thread of this process.
pub(crate) struct Arm {
    folder: TempDir,
    quit: Arc<AtomicBool>,
    thread: Option<JoinHandle<MockReport>>,
}

/// What the motors did.
pub(crate) struct Felt {
    /// From the time in question until they were at zero for good.
    pub(crate) zero_ms: f64,
    /// What they made at that time.
    pub(crate) before_n: f64,
    /// The mock itself was late meanwhile, which a busy machine makes it.
    pub(crate) is_late: bool,
}

impl Arm {
    fn new<L: ArmLink + Send + 'static>(
        profile: &Profile,
        hand: Option<HandParameters>,
        faults: &[&str],
        make: impl FnOnce(&Path, &Protocol) -> (L, Box<dyn Firmware>),
    ) -> Self {
        let folder = folder_in_memory();
        let faults = faults
            .iter()
            .map(|text| ((*text).to_owned(), fault::parse(text).expect("grammar")))
            .collect();
        let settings = MockSettings { hand, hand_delay: Duration::ZERO, faults, seed: 1 };
        let (parameters, protocol) = builder::parameters(profile, settings);
        let (mut link, firmware) = make(folder.path(), &protocol);
        let serving =
            Serving { period_s: parameters.period_s, duration: None, until_host_gone: false };
        let mut mock = MockArm::new(parameters, firmware).expect("valid");
        let mut trace = TraceFile::create(&folder.path().join("trace")).expect("written");
        let quit = Arc::new(AtomicBool::new(false));
        let reported = quit.clone();
        let thread = std::thread::spawn(move || {
            keep_time(ARM_PRIORITY);
            serve(&mut mock, &mut link, serving, Some(&mut trace), || {
                reported.load(Ordering::Relaxed)
            })
            .expect("served");
            mock.report()
        });
        Self { folder, quit, thread: Some(thread) }
    }

    /// The arm of a profile behind a pseudo-terminal.
    pub(crate) fn on_a_tty(
        profile: &Profile,
        hand: Option<HandParameters>,
        faults: &[&str],
    ) -> Self {
        Self::new(profile, hand, faults, |folder, protocol| {
            (
                Pty::new(&folder.join("arm")).expect("a terminal"),
                protocol.firmware(Carriage::Stream),
            )
        })
    }

    /// The same at the end of a stand-in's cable.
    pub(crate) fn on_a_cable(
        profile: &Profile,
        hand: Option<HandParameters>,
        faults: &[&str],
    ) -> Self {
        Self::new(profile, hand, faults, |folder, protocol| {
            (Cable::new(folder.join("arm")), protocol.firmware(Carriage::Stream))
        })
    }

    /// The same behind a service, and the address of that.
    pub(crate) fn behind_a_service(
        profile: &Profile,
        version: &str,
        hand: Option<HandParameters>,
        faults: &[&str],
    ) -> (Self, String) {
        let mut address = String::new();
        let arm = Self::new(profile, hand, faults, |_, protocol| {
            let server = ServiceServer::new("127.0.0.1:0".parse().expect("an address"), version)
                .expect("a port");
            address = server.address().to_string();
            (server, service::firmware(protocol, version).expect("served"))
        });
        (arm, address)
    }

    /// Where its files are.
    pub(crate) fn folder(&self) -> &Path {
        self.folder.path()
    }

    pub(crate) fn link(&self) -> PathBuf {
        self.folder.path().join("arm")
    }

    pub(crate) fn felt(&self, at_ns: i64, until_ns: i64) -> Felt {
        let text = fs::read_to_string(self.folder.path().join("trace")).expect("written");
        let samples = text.lines().skip(1).filter_map(|line| {
            let mut words = line.split(',');
            let t_ns = words.next()?.parse::<i64>().ok()?;
            Some((t_ns, words.next()?.parse::<f64>().ok()?, words.nth(2)?.parse::<f64>().ok()?))
        });
        let mut before_n = 0.0;
        let mut now_n = 0.0;
        let mut zero_ns = at_ns;
        let mut late_before = 0.0;
        let mut late_at_zero = 0.0;
        for (t_ns, force_n, late) in samples.filter(|(t_ns, ..)| *t_ns <= until_ns) {
            if t_ns < at_ns {
                (before_n, late_before, late_at_zero) = (force_n, late, late);
            } else if now_n > 0.0 && force_n == 0.0 {
                (zero_ns, late_at_zero) = (t_ns, late);
            }
            now_n = force_n;
        }
        assert!(now_n == 0.0, "the motors are still on with {now_n} N");
        Felt {
            zero_ms: (zero_ns - at_ns) as f64 * 1e-6,
            before_n,
            is_late: late_at_zero > late_before,
        }
    }

    pub(crate) fn ended(mut self) -> MockReport {
        self.quit.store(true, Ordering::Relaxed);
        self.thread.take().expect("once").join().expect("no panic")
    }
}

impl Drop for Arm {
    fn drop(&mut self) {
        self.quit.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn options(selector: Option<PathBuf>, guard: Option<PathBuf>) -> OpenOptions {
    OpenOptions { selector: selector.map(Selector::Path), io_request: None, period_s: 1e-3, guard }
}

/// An arm that this process drives itself, over a tty.
pub(crate) struct Serial {
    profile: Profile,
    pub(crate) arm: Arm,
}

impl Serial {
    pub(crate) fn new(name: &str, faults: &[&str]) -> Self {
        let profile = shipped(name);
        let arm = Arm::on_a_tty(&profile, Some(HandParameters::default()), faults);
        Self { profile, arm }
    }

    pub(crate) fn open(&self) -> OpenedArm {
        let options = options(Some(self.arm.link()), Some(HAPTICD.into()));
        open::open(&self.profile, &options)
            .unwrap_or_else(|error| panic!("{}: {error}", self.profile.name))
    }
}

/// An arm behind a stand-in of its maker's library.
pub(crate) struct Library {
    pub(crate) profile: Profile,
    pub(crate) arm: Arm,
}

impl Library {
    /// Faults are those of the arm behind it.
    pub(crate) fn new(name: &str, faults: &[&str]) -> Self {
        Self::over(name, name, faults)
    }

    /// The same with another arm than the profile says.
    pub(crate) fn over(name: &str, arm: &str, faults: &[&str]) -> Self {
        let profile = shipped(name);
        let arm = shipped(arm);
        let arm = Arm::on_a_cable(&arm, Some(HandParameters::default()), faults);
        let library = Self { profile, arm };
        library.goes_wrong("");
        let link = library.arm.link();
        let faults = library.faults();
        let environment = format!(
            "export HAPTICD_MOCK_ARM={} HAPTICD_MOCK_FAULT_FILE={}\nHAPTICD={HAPTICD} \
                PRIORITY={WORKER_PRIORITY}\n",
            link.display(),
            faults.display()
        );
        fs::write(library.arm.folder.path().join("environment"), environment).expect("written");
        symlink(
            Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/hil/worker.sh"),
            library.program(),
        )
        .expect("a link");
        library
    }

    /// The stand-in, which `cargo test` builds with the tests.
    fn path(&self) -> PathBuf {
        let name = match &self.profile.name {
            name if name.starts_with("virtuose") => "mock_virtuose",
            name if name.starts_with("touch") || name.starts_with("premium") => "mock_hd",
            _ => "mock_drd",
        };
        built_example(&format!("lib{name}.so"))
    }

    /// What starts its worker.
    pub(crate) fn program(&self) -> PathBuf {
        self.arm.folder.path().join("worker")
    }

    fn faults(&self) -> PathBuf {
        self.arm.folder.path().join("faults")
    }

    /// What goes wrong in the library from now on.
    pub(crate) fn goes_wrong(&self, faults: &str) {
        fs::write(self.faults(), faults).expect("written");
    }

    pub(crate) fn try_open(&self) -> Result<OpenedArm, OpenError> {
        open::open(&self.profile, &options(Some(self.path()), Some(self.program())))
    }

    pub(crate) fn open(&self) -> OpenedArm {
        self.try_open().unwrap_or_else(|error| panic!("{}: {error}", self.profile.name))
    }

    /// What the error code of a sample means.
    pub(crate) fn error_text(&self, error: u16) -> String {
        self.profile
            .real
            .as_ref()
            .and_then(|real| real.protocol.error_text(error))
            .expect("has words")
    }

    /// The process of the worker that works now, if one does.
    pub(crate) fn worker(&self) -> Option<u32> {
        worker_of(&self.arm.link())
    }
}

/// The process of the worker that leads to the mock arm at the end of this cable, if one is there.
pub(crate) fn worker_of(link: &Path) -> Option<u32> {
    let link = link.display().to_string();
    let leads_there = |pid: u32| {
        let environment = fs::read(format!("/proc/{pid}/environ")).unwrap_or_default();
        String::from_utf8_lossy(&environment).contains(&link)
    };
    let is_worker = |pid: u32| {
        let stat = fs::read_to_string(format!("/proc/{pid}/stat")).unwrap_or_default();
        stat.split_once('(').is_some_and(|(_, rest)| {
            rest.starts_with("haptic-worker) ") && !rest.starts_with("haptic-worker) Z")
        })
    };
    let pids = fs::read_dir("/proc")
        .expect("proc")
        .filter_map(|entry| entry.ok()?.file_name().to_str()?.parse().ok());
    pids.into_iter().find(|pid| is_worker(*pid) && leads_there(*pid))
}

/// An address of this machine at which nothing listens. Its port is none that the system gives to
/// the near end of a connection: what connects to such a port before there is a listener may be
/// given it, and is connected to itself.
pub(crate) fn free_address() -> String {
    let ports = (0..10_000).map(|n| 20_000 + (std::process::id() as u16 % 10_000 + n) % 10_000);
    let is_free = |address: &String| TcpListener::bind(address).is_ok();
    ports.map(|port| format!("127.0.0.1:{port}")).find(is_free).expect("a free port")
}

/// A file that `cargo test` makes of an example of `arms`.
pub(crate) fn built_example(name: &str) -> PathBuf {
    let path = Path::new(HAPTICD).with_file_name("examples").join(name);
    assert!(path.exists(), "{} is missing: cargo build -p arms-testing --examples", path.display());
    path
}

/// An arm behind a mock of the Inverse service in this process.
pub(crate) struct Service {
    pub(crate) profile: Profile,
    pub(crate) arm: Arm,
}

impl Service {
    pub(crate) fn new(version: &str, faults: &[&str]) -> Self {
        let mut profile = shipped("inverse3");
        let (arm, address) =
            Arm::behind_a_service(&profile, version, Some(HandParameters::default()), faults);
        let service = profile.real.as_mut().and_then(|real| match &mut real.protocol {
            Protocol::HaplyService(service) => Some(service),
            _ => None,
        });
        service.expect("behind a service").address = address;
        Self { profile, arm }
    }

    /// Where the service listens.
    pub(crate) fn address(&mut self) -> &mut String {
        match self.profile.real.as_mut().map(|real| &mut real.protocol) {
            Some(Protocol::HaplyService(service)) => &mut service.address,
            _ => unreachable!("an arm behind a service"),
        }
    }

    pub(crate) fn try_open(&self) -> Result<OpenedArm, OpenError> {
        // The threads of its link keep time as the loop does.
        let io_request = Some(ThreadRequest { cpu: 0, priority: LOOP_PRIORITY + 1 });
        open::open(&self.profile, &OpenOptions { io_request, ..options(None, None) })
    }

    pub(crate) fn open(&self) -> OpenedArm {
        self.try_open().unwrap_or_else(|error| panic!("{error}"))
    }
}

/// What a tick had of the arm.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ticked {
    pub(crate) error: Option<DeviceError>,
    pub(crate) sample: Option<DeviceSample>,
    pub(crate) made: Wrench,
    pub(crate) took: Duration,
    /// How often its two calls waited for something.
    pub(crate) waits: u64,
}

impl Ticked {
    pub(crate) fn is_fresh(&self) -> bool {
        self.sample.is_some_and(|sample| sample.status == SampleStatus::Fresh)
    }

    pub(crate) fn device_error(&self) -> u16 {
        self.sample.map_or(0, |sample| sample.device_error)
    }
}

/// How often this thread has given its processor away to wait for something.
fn waits() -> u64 {
    let status = fs::read_to_string("/proc/thread-self/status").expect("proc");
    let count = status.lines().find_map(|line| line.strip_prefix("voluntary_ctxt_switches:"));
    count.and_then(|count| count.trim().parse().ok()).expect("a count")
}

/// Ticks of a millisecond until `until` says so: what the last one gave.
pub(crate) fn play(
    opened: &mut OpenedArm,
    wrench: &Wrench,
    mut until: impl FnMut(&Ticked) -> bool,
) -> Ticked {
    keep_time(LOOP_PRIORITY);
    let begin = Instant::now();
    loop {
        let waited = waits();
        let tick = Instant::now();
        let read = opened.arm.read();
        let wrote = if read.is_ok() { opened.arm.write(wrench) } else { Ok(Wrench::ZERO) };
        let took = tick.elapsed();
        let waits = waits() - waited;
        let ticked = Ticked {
            error: read.err().or(wrote.err()),
            sample: read.ok(),
            made: wrote.unwrap_or_default(),
            took,
            waits,
        };
        if until(&ticked) {
            return ticked;
        }
        assert!(begin.elapsed() < HUNG, "it does not come to that: {ticked:?}");
        std::thread::sleep(Duration::from_millis(1).saturating_sub(tick.elapsed()));
    }
}

pub(crate) fn n_ticks(n: u32) -> impl FnMut(&Ticked) -> bool {
    let mut left = n;
    move |_| {
        left = left.saturating_sub(1);
        left == 0
    }
}

/// Pushes until the arm makes most of it, and has done so for some ticks.
pub(crate) fn push(opened: &mut OpenedArm) {
    opened.arm.set_enabled(true);
    play(opened, &PUSH, |ticked| ticked.made.force.z > 0.3);
    play(opened, &PUSH, n_ticks(30));
}

/// A folder for the trace of an arm, in memory: a disk that is busy would hold up the arm, which
/// writes a line in every period.
pub(crate) fn folder_in_memory() -> TempDir {
    let memory = Path::new("/dev/shm");
    if memory.is_dir() { TempDir::new_in(memory) } else { TempDir::new() }.expect("a folder")
}
