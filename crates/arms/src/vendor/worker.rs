//! The worker's end: a process that exchanges frames with the host on one side and calls the
//! maker's library on the other.

use core::sync::atomic::{AtomicBool, Ordering};
use core::time::Duration;
use std::fs::File;
use std::io::{self, Read as _, Write as _};
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::process::ExitCode;

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::stdio;
use serde::{Deserialize, Serialize};

use super::page::Page;
use super::{
    Family, NAME, VendorArm, VendorCommand, VendorFault, VendorSample, force_dimension,
    open_haptics, virtuose,
};
use crate::protocol::open6::{axes_of, bits_of};
use crate::protocol::{ArmReadings, Firmware as _, MAX_AXES, Open6Arm, Outbox, open6_arm};
use crate::transport::Carriage;
use glam::DVec3;
use rt::clock::monotonic_ns;
use rt::process::stand_apart;
use rt::realtime;
use rt::schedule::ThreadRequest;

/// Longest time between two turns: a host at 1 kHz is never so late without reason, and the maker's
/// own watchdog is fed meanwhile.
const TURN: Duration = Duration::from_millis(2);

/// The same while the host waits for a sample that is none yet.
const REPEAT: Duration = Duration::from_micros(500);

/// Between two looks for a host while the library moves the arm by itself.
const LOOK: Duration = Duration::from_millis(20);
/// How long the library may take to stop such a motion.
const STOP_PATIENCE: Duration = Duration::from_millis(300);

/// How long a library may go on after the host has gone: its stop and its close take less.
const HANG_PATIENCE: Duration = Duration::from_secs(2);
/// Between two looks for that.
const SLOW_LOOK: Duration = Duration::from_millis(500);

/// What a worker is given on its command line, as JSON.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Assignment {
    pub(super) family: Family,
    pub(super) library: Option<PathBuf>,
    /// The arm may move by itself to find its zero.
    pub(super) home: bool,
    /// Serial number of the arm that is meant, as its maker counts.
    pub(super) serial: Option<String>,
    name: String,
    sensed: u8,
    actuated: u8,
    rate_hz: u16,
    watchdog_ms: u16,
    pub(super) force_n: f32,
    pub(super) torque_nm: f32,
    workspace_radius_m: f32,
    pub(super) cpu: Option<usize>,
    pub(super) priority: Option<u8>,
}

impl Assignment {
    pub(super) fn new(
        protocol: &super::VendorProtocol,
        serial: Option<String>,
        request: Option<ThreadRequest>,
    ) -> Self {
        let arm = &protocol.arm;
        Self {
            family: protocol.family,
            library: protocol.library.clone(),
            home: protocol.home,
            serial,
            name: arm.name.clone(),
            sensed: bits_of(arm.sensed),
            actuated: bits_of(arm.actuated),
            rate_hz: arm.rate_hz,
            watchdog_ms: arm.watchdog_ms,
            force_n: arm.force_n,
            torque_nm: arm.torque_nm,
            workspace_radius_m: arm.workspace_radius_m,
            cpu: request.map(|request| request.cpu),
            priority: request.map(|request| request.priority),
        }
    }

    /// Axes that the profile expects to be driven.
    pub(super) fn arm(&self) -> Open6Arm {
        Open6Arm {
            name: self.name.clone(),
            sensed: axes_of(self.sensed),
            actuated: axes_of(self.actuated),
            rate_hz: self.rate_hz,
            watchdog_ms: self.watchdog_ms,
            force_n: self.force_n,
            torque_nm: self.torque_nm,
            workspace_radius_m: self.workspace_radius_m,
        }
    }
}

impl core::str::FromStr for Assignment {
    type Err = serde_json::Error;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        serde_json::from_str(text)
    }
}

/// The socket to the host: a byte of it wakes, its end is the host's.
pub(crate) struct HostLine(UnixStream);

impl HostLine {
    /// Waits for a command, at most `timeout`; false when the host has gone or lets go.
    pub(crate) fn wait(&mut self, timeout: Duration) -> bool {
        let timeout =
            Timespec { tv_sec: timeout.as_secs() as i64, tv_nsec: timeout.subsec_nanos().into() };
        let mut polled = [PollFd::new(&self.0, PollFlags::IN | PollFlags::RDHUP)];
        match poll(&mut polled, Some(&timeout)) {
            // A signal ends a wait early, which is allowed.
            Ok(0) | Err(_) => true,
            // What the host wrote before it went is not obeyed any more.
            Ok(_) if polled[0].revents().intersects(PollFlags::RDHUP | PollFlags::HUP) => false,
            Ok(_) => match self.0.read(&mut [0; 64]) {
                Ok(n) => n > 0,
                Err(error) => {
                    matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::Interrupted)
                }
            },
        }
    }

    /// Does what takes long and does not look at the host, such as a motion that the library makes
    /// by itself. A host that goes meanwhile (Ctrl-C, or its patience is over) ends it by `stop`,
    /// from another thread, and this process with it: an arm does not go on moving that no program
    /// watches.
    pub(crate) fn during<T>(&self, work: impl FnOnce() -> T, stop: impl FnOnce() + Send) -> T {
        let is_done = AtomicBool::new(false);
        std::thread::scope(|scope| {
            let is_done = &is_done;
            scope.spawn(move || {
                while !is_done.load(Ordering::Relaxed) {
                    if self.has_host_gone(LOOK) {
                        let (stopped, has_stopped) = std::sync::mpsc::channel();
                        scope.spawn(move || {
                            stop();
                            let _ = stopped.send(());
                        });
                        // A library that hangs in its stop is ended with the process.
                        let _ = has_stopped.recv_timeout(STOP_PATIENCE);
                        std::process::exit(1);
                    }
                }
            });
            let result = work();
            is_done.store(true, Ordering::Relaxed);
            result
        })
    }

    /// Whether the host has closed its end, or does so within this time.
    fn has_host_gone(&self, within: Duration) -> bool {
        let within = Timespec { tv_sec: 0, tv_nsec: within.subsec_nanos().into() };
        let mut polled = [PollFd::new(&self.0, PollFlags::RDHUP)];
        poll(&mut polled, Some(&within)).is_ok_and(|n| n > 0)
    }

    /// Ends this process some time after the host has gone, also where the library hangs and
    /// nothing else can.
    fn end_after_host(&self) -> io::Result<()> {
        let line = Self(self.0.try_clone()?);
        std::thread::Builder::new().name("host-watch".to_owned()).spawn(move || {
            while !line.has_host_gone(SLOW_LOOK) {}
            std::thread::sleep(HANG_PATIENCE);
            // Not an exit: that runs what the library has left to be run, which may hang as well.
            std::process::abort();
        })?;
        Ok(())
    }

    /// Tells the host a line for people.
    pub(crate) fn tell(&mut self, text: &str) {
        self.say("told", text);
    }

    fn say(&mut self, word: &str, text: &str) {
        // One line each; a host that does not read loses it.
        let _ = self.0.write_all(format!("{word} {}\n", text.replace('\n', " ")).as_bytes());
    }
}

/// Frames of the host on one side, the arm on the other: an `open6` arm with its watchdog, whose
/// motors and sensors a [`VendorArm`] has.
pub(crate) struct Exchange {
    page: Page,
    firmware: open6_arm::ArmFirmware,
    readings: ArmReadings,
    fault: u8,
    /// The host is owed a state, which waits for a sample.
    owes: bool,
    outbox: Outbox,
    start_ns: i64,
}

impl Exchange {
    fn new(page: Page, arm: Open6Arm) -> Self {
        Self {
            page,
            firmware: open6_arm::ArmFirmware::new(arm, Carriage::Reports),
            readings: readings_of(&VendorSample::default()),
            fault: 0,
            owes: false,
            outbox: Outbox::new(),
            start_ns: monotonic_ns(),
        }
    }

    /// How long to wait for the next command at most.
    pub(super) fn patience(&self) -> Duration {
        if self.owes { REPEAT } else { TURN }
    }

    /// One turn: the newest command, if there is one, into the motors, or zero when the last one is
    /// too old; then where the arm is; then the answer.
    ///
    /// # Errors
    /// The arm is lost.
    pub(crate) fn turn<A: VendorArm + ?Sized>(&mut self, arm: &mut A) -> Result<(), VendorFault> {
        let now_s = (monotonic_ns() - self.start_ns) as f64 * 1e-9;
        let mut buffer = [0; 128];
        let n = self.page.take(&mut buffer);
        self.owes |=
            n > 0 && self.firmware.hear(&buffer[..n], now_s, self.readings.homed, &mut self.outbox);
        self.firmware.watch(now_s);
        let [fx, fy, fz, tx, ty, tz, ..] = self.firmware.motors();
        arm.command(&VendorCommand {
            force: DVec3::new(fx, fy, fz),
            torque: DVec3::new(tx, ty, tz),
            enabled: self.firmware.is_enabled(),
        })?;
        let sample = arm.sample()?;
        (self.readings, self.fault) = (readings_of(&sample), sample.fault);
        if self.owes && !sample.is_repeat {
            self.owes = false;
            self.firmware.state(now_s, &self.readings, self.fault, &mut self.outbox);
        }
        for frame in self.outbox.drain(..) {
            self.page.put(&frame);
        }
        Ok(())
    }
}

fn readings_of(sample: &VendorSample) -> ArmReadings {
    let VendorSample { position, orientation, twist, grip, buttons, homed, .. } = sample;
    let [x, y, z] = position.to_array();
    let [qx, qy, qz, qw] = orientation.to_array();
    let mut rates = [0.0; MAX_AXES];
    rates[..3].copy_from_slice(&twist.linear.to_array());
    rates[3..6].copy_from_slice(&twist.angular.to_array());
    rates[7] = grip[1];
    ArmReadings {
        readings: [x, y, z, qx, qy, qz, qw, grip[0]],
        rates,
        buttons: u32::from(*buttons),
        homed: *homed,
        asleep: false,
    }
}

/// The worker: stdin is the socket to the host, stdout the page.
///
/// # Errors
/// It was not started by a host.
pub fn work(assignment: &Assignment) -> io::Result<ExitCode> {
    let socket = UnixStream::from(stdio::stdin().try_clone_to_owned()?);
    let page = Page::of(stdio::stdout())?;
    socket.peer_addr()?;
    socket.set_nonblocking(true)?;
    // Libraries print what they like: not into the page, and not between the lines of a run.
    let nowhere = File::options().read(true).write(true).open("/dev/null")?;
    stdio::dup2_stdin(&nowhere)?;
    stdio::dup2_stdout(&nowhere)?;
    stdio::dup2_stderr(&nowhere)?;
    stand_apart(NAME);
    let mut host = HostLine(socket);
    host.end_after_host()?;
    let request = assignment.cpu.zip(assignment.priority);
    let _realtime = request.map(|(cpu, priority)| realtime::enter(ThreadRequest { cpu, priority }));
    let opened: Result<Box<dyn VendorArm>, VendorFault> = match assignment.family {
        Family::ForceDimension => force_dimension::open(assignment, &mut host)
            .map(|arm| Box::new(arm) as Box<dyn VendorArm>),
        Family::OpenHaptics => {
            open_haptics::open(assignment, &mut host).map(|arm| Box::new(arm) as Box<dyn VendorArm>)
        }
        Family::Virtuose => {
            virtuose::open(assignment, &mut host).map(|arm| Box::new(arm) as Box<dyn VendorArm>)
        }
    };
    let mut arm = match opened {
        Ok(arm) => arm,
        Err(fault) => {
            host.say("refused", &fault.0);
            return Ok(ExitCode::FAILURE);
        }
    };
    host.say("ready", &arm.identity());
    let mut exchange = Exchange::new(page, assignment.arm());
    // Whatever happens, the arm is closed.
    let ended = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
        arm.run(&mut exchange, &mut host)
    }))
    .unwrap_or_else(|_| Err(VendorFault("the worker has a fault of its own".to_owned())));
    if let Err(fault) = &ended {
        host.say("lost", &fault.0);
    }
    arm.close();
    Ok(if ended.is_ok() { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}
