//! What stand-ins of makers' libraries have in common: the way to a mock arm of `hapticd mock …
//! --pty`, which speaks open6, and faults on demand.

use std::fs::File;
use std::io::{ErrorKind, Read as _, Write as _};
use std::os::fd::OwnedFd;
use std::os::unix::fs::OpenOptionsExt as _;
use std::os::unix::net::UnixStream;
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec, poll};

/// What a mock answers within.
const REPLY: Duration = Duration::from_millis(5);
/// Commands in a row without an answer that are a lost arm.
const UNANSWERED: u32 = 3;
const HELLO_PATIENCE: Duration = Duration::from_secs(3);

fn crc(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0xFFFF, |crc, byte| {
        (0..8).fold(crc ^ u16::from(*byte) << 8, |crc, _| {
            if crc & 0x8000 != 0 { crc << 1 ^ 0x1021 } else { crc << 1 }
        })
    })
}

/// A packet of open6 as bytes of a stream.
fn packet(kind: u8, sequence: u16, payload: &[u8]) -> Vec<u8> {
    let mut packet = vec![kind, payload.len() as u8];
    packet.extend(sequence.to_le_bytes());
    packet.extend(payload);
    packet.extend(crc(&packet).to_le_bytes());
    let mut stuffed = Vec::new();
    for run in packet.split(|byte| *byte == 0) {
        stuffed.push(run.len() as u8 + 1);
        stuffed.extend(run);
    }
    stuffed.push(0);
    stuffed
}

/// What a stuffed packet says: kind, payload.
fn unpacked(stuffed: &[u8]) -> Option<(u8, Vec<u8>)> {
    let mut packet = Vec::new();
    let mut rest = stuffed;
    while let [code, after @ ..] = rest {
        let n = usize::from(*code).checked_sub(1)?;
        packet.extend(after.get(..n)?);
        rest = &after[n..];
        if !rest.is_empty() {
            packet.push(0);
        }
    }
    let (checked, sum) = packet.split_at_checked(packet.len().checked_sub(2)?)?;
    (crc(checked).to_le_bytes() == sum && checked.len() >= 4)
        .then(|| (checked[0], checked[4..].to_vec()))
}

fn f32_at(payload: &[u8], at: usize) -> f64 {
    let four = payload.get(at..at + 4).and_then(|four| four.try_into().ok()).unwrap_or_default();
    f64::from(f32::from_le_bytes(four))
}

fn u16_at(payload: &[u8], at: usize) -> u16 {
    u16::from_le_bytes(
        payload.get(at..at + 2).and_then(|two| two.try_into().ok()).unwrap_or_default(),
    )
}

/// What is to go wrong: a list with commas, of `HAPTICD_MOCK_FAULT` and of the file that
/// `HAPTICD_MOCK_FAULT_FILE` names, which may change meanwhile.
fn faults() -> String {
    let from_now = std::env::var_os("HAPTICD_MOCK_FAULT_FILE")
        .and_then(|path| std::fs::read_to_string(path).ok());
    [std::env::var("HAPTICD_MOCK_FAULT").unwrap_or_default(), from_now.unwrap_or_default()]
        .join(",")
}

fn is_among(faults: &str, word: &str, first_force: Option<Instant>) -> bool {
    let since_s = first_force.map_or(-1.0, |first| first.elapsed().as_secs_f64());
    faults.split(',').any(|fault| match fault.trim().split_once('@') {
        Some((name, at_s)) => name == word && at_s.parse::<f64>().is_ok_and(|at_s| since_s >= at_s),
        None => fault.trim() == word,
    })
}

/// Whether a fault is there from the start.
pub(crate) fn has_fault(word: &str) -> bool {
    is_among(&faults(), word, None)
}

/// A mock arm, as it was when it answered last.
pub(crate) struct Mock {
    file: File,
    sequence: u16,
    frame: Vec<u8>,
    pub(crate) name: String,
    /// Axes that it measures, as bits: x y z rx ry rz grip.
    pub(crate) sensed: u8,
    /// The same of those that it drives.
    pub(crate) actuated: u8,
    pub(crate) watchdog_ms: u16,
    /// x, y, z; the quaternion x, y, z, w; the grip.
    pub(crate) pose: [f64; 8],
    pub(crate) twist: [f64; 6],
    pub(crate) buttons: u16,
    flags: u8,
    /// The last command was answered.
    pub(crate) is_fresh: bool,
    /// Commands in a row that it has not answered.
    unanswered: u32,
    /// So many that it counts as lost.
    pub(crate) is_silent: bool,
    faults: String,
    first_force: Option<Instant>,
}

impl Mock {
    /// The arm behind the terminal, or the socket, that `HAPTICD_MOCK_ARM` names.
    pub(crate) fn open() -> Option<Self> {
        let path = std::env::var("HAPTICD_MOCK_ARM").ok()?;
        let file = match UnixStream::connect(&path) {
            Ok(stream) => {
                stream.set_nonblocking(true).ok()?;
                OwnedFd::from(stream).into()
            }
            // O_NONBLOCK | O_NOCTTY
            Err(_) => File::options()
                .read(true)
                .write(true)
                .custom_flags(0o4000 | 0o400)
                .open(path)
                .ok()?,
        };
        let mut mock = Self {
            file,
            sequence: 0,
            frame: Vec::new(),
            name: String::new(),
            sensed: 0,
            actuated: 0,
            watchdog_ms: 0,
            pose: [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0],
            twist: [0.0; 6],
            buttons: 0,
            flags: 0,
            is_fresh: false,
            unanswered: 0,
            is_silent: false,
            faults: faults(),
            first_force: None,
        };
        let begin = Instant::now();
        while mock.name.is_empty() {
            // Magic, version 1.0, the arm's own watchdog.
            mock.file
                .write_all(&[&[0][..], &packet(1, 0, b"op6d\x01\x00\x00\x00")].concat())
                .ok()?;
            mock.hear(Duration::from_millis(100), 0x81);
            if begin.elapsed() > HELLO_PATIENCE {
                return None;
            }
        }
        mock.exchange(&[0.0; 7], false).then_some(mock)
    }

    /// Whether this goes wrong now.
    pub(crate) fn fault(&self, word: &str) -> bool {
        is_among(&self.faults, word, self.first_force)
    }

    /// Looks again what goes wrong.
    pub(crate) fn look(&mut self) {
        self.faults = faults();
    }

    /// Its own watchdog has switched its motors off, until a command without enable.
    pub(crate) fn has_tripped(&self) -> bool {
        self.flags & 4 != 0
    }

    /// From here on the times of faults count.
    pub(crate) fn force_comes(&mut self) {
        self.first_force.get_or_insert_with(Instant::now);
    }

    /// Sends a force, torque and grip torque, and takes where the arm is then; false when it is
    /// gone. Here foreign code may do what it does.
    pub(crate) fn exchange(&mut self, force: &[f64; 7], is_on: bool) -> bool {
        self.look();
        match () {
            () if self.fault("crash") => {
                // SAFETY: none; a write through no pointer, which no handler of Rust turns into a
                // panic, is the crash that was asked for.
                unsafe { core::ptr::null_mut::<u8>().write_volatile(1) }
            }
            () if self.fault("exit") => std::process::exit(3),
            () if self.fault("hang") => loop {
                std::thread::sleep(Duration::from_secs(1));
            },
            () if self.fault("com") => return false,
            () => {}
        }
        let mut payload = Vec::with_capacity(30);
        for component in force {
            payload.extend((if is_on { *component } else { 0.0 } as f32).to_le_bytes());
        }
        payload.extend([u8::from(is_on), 0]);
        self.sequence = self.sequence.wrapping_add(1);
        if self.file.write_all(&packet(2, self.sequence, &payload)).is_err() {
            return false;
        }
        self.is_fresh = false;
        self.unanswered =
            if self.hear(REPLY, 0x82) { 0 } else { self.unanswered.saturating_add(1) };
        self.is_silent = self.unanswered >= UNANSWERED;
        if self.fault("garbage") {
            (self.pose, self.twist) = ([1e30; 8], [-1e30; 6]);
        }
        true
    }

    /// Waits for a packet of this kind; whether it came.
    fn hear(&mut self, patience: Duration, wanted: u8) -> bool {
        let begin = Instant::now();
        let mut buffer = [0; 512];
        let mut has_come = false;
        while !has_come && begin.elapsed() < patience {
            match self.file.read(&mut buffer) {
                Ok(n) if n > 0 => {
                    for byte in &buffer[..n] {
                        if *byte != 0 {
                            self.frame.push(*byte);
                            continue;
                        }
                        let frame = core::mem::take(&mut self.frame);
                        if let Some((kind, payload)) = unpacked(&frame) {
                            self.take(kind, &payload);
                            has_come |= kind == wanted;
                        }
                    }
                }
                Err(error) if error.kind() != ErrorKind::WouldBlock => return false,
                _ => {
                    let left = patience.saturating_sub(begin.elapsed());
                    let left = Timespec {
                        tv_sec: left.as_secs() as i64,
                        tv_nsec: left.subsec_nanos().into(),
                    };
                    let _ = poll(&mut [PollFd::new(&self.file, PollFlags::IN)], Some(&left));
                }
            }
        }
        has_come
    }

    fn take(&mut self, kind: u8, payload: &[u8]) {
        match kind {
            0x81 if payload.len() >= 54 => {
                (self.sensed, self.actuated) = (payload[2], payload[3]);
                self.watchdog_ms = u16_at(payload, 6);
                self.name = String::from_utf8_lossy(
                    payload[22..54].split(|byte| *byte == 0).next().unwrap_or_default(),
                )
                .into_owned();
            }
            0x82 if payload.len() >= 54 => {
                self.pose = core::array::from_fn(|idx| f32_at(payload, 4 * idx));
                self.buttons = u16_at(payload, 38);
                self.flags = payload[40];
                self.twist = core::array::from_fn(|idx| {
                    f64::from(u16_at(payload, 42 + 2 * idx) as i16)
                        / if idx < 3 { 8192.0 } else { 1024.0 }
                });
                self.is_fresh = true;
            }
            _ => {}
        }
    }
}
