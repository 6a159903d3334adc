//! Every protocol: golden frames of the devices reference, both directions, byte for byte; what is
//! malformed; host against arm.

use super::*;
use crate::profile;
use crate::transport::{Carriage, Line, LoopbackEnd, loopback};
use core::time::Duration;
use std::path::Path;
use std::time::Instant;
use vps::spatial::Axes;

mod arms;
mod golden;
mod open6_frames;
mod start;
mod zero;

/// Bytes of hex text.
fn hex(text: &str) -> Vec<u8> {
    text.split_whitespace().map(|byte| u8::from_str_radix(byte, 16).expect("hex")).collect()
}

fn show(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02X}")).collect::<Vec<_>>().join(" ")
}

fn encode(codec: &mut dyn Codec, motors: &[f64]) -> Vec<u8> {
    encode_enabled(codec, motors, false)
}

fn encode_enabled(codec: &mut dyn Codec, motors: &[f64], enabled: bool) -> Vec<u8> {
    let mut all = [0.0; MAX_AXES];
    all[..motors.len()].copy_from_slice(motors);
    let mut frame = Frame::default();
    codec.encode(&MotorCommand::of(all, enabled), &mut frame);
    frame.as_slice().to_vec()
}

fn arm_at(readings: &[f64]) -> ArmReadings {
    let mut arm = ArmReadings {
        readings: [0.0; MAX_AXES],
        rates: [0.0; MAX_AXES],
        buttons: 0,
        homed: true,
        asleep: false,
    };
    arm.readings[..readings.len()].copy_from_slice(readings);
    arm
}

fn fed(reports: u32, corrupt: u32) -> FeedCounts {
    FeedCounts { reports, corrupt, ..FeedCounts::default() }
}

/// What a shipped arm speaks.
fn shipped(name: &str) -> Protocol {
    profile::find(name, Path::new("")).expect(name).real.expect("real").protocol
}

/// One of each, with the carriage it is tried on.
fn every_protocol() -> Vec<(Protocol, Carriage)> {
    let servos = (1..=7).map(|id| Servo { id, model: ServoModel::Xc330T288 }).collect();
    let encoder =
        |start_deg| HapiEncoder { direction: Turn::Clockwise, start_deg, counts_per_rev: 13824.0 };
    let board = HapiBoard {
        device_id: 5,
        motors: vec![Turn::Clockwise; 2],
        encoders: vec![encoder(180.0), encoder(0.0)],
    };
    let mut all = vec![
        (shipped("woodenhaptics-v15"), Carriage::Reports),
        (Protocol::HaptikfabrikenHid14 { carrier: Hid14Carrier::Mbed }, Carriage::Reports),
        (Protocol::HaptikfabrikenHid14 { carrier: Hid14Carrier::TeensyRawHid }, Carriage::Reports),
        (shipped("polhem-2020"), Carriage::Stream),
        (shipped("woodenhaptics-2022"), Carriage::Stream),
        (Protocol::HapiF32(board), Carriage::Stream),
        (Protocol::FalconNibble16 { image: None }, Carriage::Stream),
        (Protocol::HapkitAscii, Carriage::Stream),
        (Protocol::SpaceMouse { dead_band: 0 }, Carriage::Reports),
        (Protocol::Spacenav, Carriage::Stream),
        (Protocol::Dynamixel2 { servos }, Carriage::Stream),
        (Protocol::HaplyService(haply_service()), Carriage::Reports),
        (Protocol::Open6(open6_arm()), Carriage::Reports),
        (Protocol::Open6(open6_arm()), Carriage::Stream),
    ];
    all.extend(arms::layouts().into_iter().map(|layout| {
        let carriage = layout.carriages()[0];
        (Protocol::Declarative(layout), carriage)
    }));
    all
}

fn haply_service() -> HaplyService {
    HaplyService {
        address: "127.0.0.1:10001".to_owned(),
        arm: None,
        grip: None,
        has_grip: true,
        version: None,
    }
}

fn open6_arm() -> Open6Arm {
    Open6Arm {
        name: "test arm".to_owned(),
        sensed: Axes::SIX,
        actuated: Axes::SIX,
        rate_hz: 1000,
        watchdog_ms: 100,
        force_n: 12.0,
        torque_nm: 0.5,
        workspace_radius_m: 0.1,
    }
}

/// A link with an arm at its other end, which answers as soon as it is spoken to. Its time is the
/// test's; while the host waits at its start, it is at least the clock by which that waits.
struct Linked {
    here: LoopbackEnd,
    there: LoopbackEnd,
    firmware: Box<dyn Firmware>,
    arm: ArmReadings,
    now_s: f64,
    looked: Instant,
    /// Everything that the host sent, and everything that the adapter was reported.
    sent: Vec<Vec<u8>>,
    lines: Vec<Line>,
}

impl Linked {
    fn new(firmware: Box<dyn Firmware>, carriage: Carriage, arm: ArmReadings) -> Self {
        let (here, there) = loopback(carriage);
        Self {
            here,
            there,
            firmware,
            arm,
            now_s: 0.0,
            looked: Instant::now(),
            sent: Vec::new(),
            lines: Vec::new(),
        }
    }

    fn pump(&mut self) {
        let mut out = Outbox::new();
        let mut buffer = [0; 256];
        while let Ok(n @ 1..) = self.there.receive(&mut buffer) {
            self.firmware.receive(&buffer[..n], self.now_s, &self.arm, &mut out);
        }
        self.firmware.advance(self.now_s, &self.arm, &mut out);
        for frame in out {
            self.there.send(&frame).expect("open");
        }
    }

    /// What has come, by frames of at most 256 bytes.
    fn take(&mut self) -> Vec<Vec<u8>> {
        let mut frames = Vec::new();
        let mut buffer = [0; 256];
        while let Ok(n @ 1..) = self.here.receive(&mut buffer) {
            frames.push(buffer[..n].to_vec());
        }
        frames
    }

    /// One exchange a millisecond later.
    fn exchange(&mut self, codec: &mut dyn Codec, motors: &[f64], enabled: bool) -> FeedCounts {
        self.now_s += 1e-3;
        let frame = encode_enabled(codec, motors, enabled);
        if !frame.is_empty() {
            self.here.send(&frame).expect("open");
        }
        self.pump();
        let mut sum = FeedCounts::default();
        for bytes in self.take() {
            sum += codec.feed(&bytes);
        }
        sum
    }
}

impl Transport for Linked {
    fn receive(&mut self, buffer: &mut [u8]) -> Result<usize, TransportError> {
        let waited = core::mem::replace(&mut self.looked, Instant::now()).elapsed();
        self.now_s += waited.as_secs_f64().max(1e-3);
        self.pump();
        self.here.receive(buffer)
    }

    fn send(&mut self, frame: &[u8]) -> Result<(), TransportError> {
        self.sent.push(frame.to_vec());
        self.here.send(frame)?;
        self.pump();
        Ok(())
    }

    fn unread(&mut self) -> usize {
        self.here.unread()
    }

    fn line(&mut self, line: Line) -> Result<(), TransportError> {
        self.lines.push(line);
        Ok(())
    }
}
