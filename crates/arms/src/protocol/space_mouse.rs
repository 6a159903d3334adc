//! `3dconnexion-hid`: the SpaceMouse family, split or combined reports, distinguished by their
//! length; and the same through the socket of spacenavd. Rates, not a pose; no motors.

use super::gather::Gather;
use super::number::{i16_at, i32_at};
use super::{ArmReadings, Codec, FeedCounts, Firmware, MAX_AXES, MotorCommand, Outbox, Report};
use crate::transport::Frame;

/// Report IDs.
const TRANSLATION: u8 = 1;
const ROTATION: u8 = 2;
const BUTTONS: u8 = 3;
const LAMP: u8 = 4;

/// The host's side over HID.
#[derive(Debug)]
pub(super) struct HostCodec {
    dead_band: u16,
    /// What the lamp shows; `None`: not known.
    lamp: Option<bool>,
    report: Report,
}

impl HostCodec {
    pub(super) fn new(dead_band: u16) -> Self {
        Self { dead_band, lamp: None, report: Report::default() }
    }

    fn axes(&mut self, bytes: &[u8], first: usize, n: usize) {
        for (idx, reading) in self.report.readings[first..first + n].iter_mut().enumerate() {
            let count = i16_at(bytes, 1 + 2 * idx);
            *reading = if count.unsigned_abs() <= self.dead_band { 0.0 } else { f64::from(count) };
        }
    }
}

impl Codec for HostCodec {
    fn feed(&mut self, bytes: &[u8]) -> FeedCounts {
        match (bytes.first(), bytes.len()) {
            // One byte more or less is a report that was cut.
            (Some(&TRANSLATION), 7) => self.axes(bytes, 0, 3),
            (Some(&TRANSLATION), 13..) => self.axes(bytes, 0, 6),
            (Some(&ROTATION), 7) => self.axes(bytes, 3, 3),
            (Some(&BUTTONS), 2..=7) => {
                let mut bits = [0; 4];
                for (bit, byte) in bits.iter_mut().zip(&bytes[1..]) {
                    *bit = *byte;
                }
                self.report.buttons = u32::from_le_bytes(bits);
            }
            (Some(&(TRANSLATION | ROTATION | BUTTONS)) | None, _) => {
                return FeedCounts { corrupt: 1, ..FeedCounts::default() };
            }
            // Battery and the like.
            _ => return FeedCounts::default(),
        }
        FeedCounts { reports: 1, ..FeedCounts::default() }
    }

    fn newest(&self) -> &Report {
        &self.report
    }

    fn encode(&mut self, command: &MotorCommand, frame: &mut Frame) {
        frame.clear();
        if self.lamp != Some(command.is_enabled()) {
            self.lamp = Some(command.is_enabled());
            frame.extend(&[LAMP, u8::from(command.is_enabled())]);
        }
    }

    fn kick(&mut self, _: &mut Frame) -> bool {
        false
    }
}

/// The device's side over HID: reports on change only.
#[derive(Debug)]
pub(super) struct Puck {
    combined: bool,
    axes: [i16; 6],
    buttons: u32,
}

impl Puck {
    pub(super) fn new(combined: bool) -> Self {
        Self { combined, axes: [0; 6], buttons: 0 }
    }
}

fn counts(arm: &ArmReadings) -> [i16; 6] {
    [0, 1, 2, 3, 4, 5].map(|idx| arm.readings[idx].round() as i16)
}

impl Firmware for Puck {
    fn receive(&mut self, _: &[u8], _: f64, _: &ArmReadings, _: &mut Outbox) {}

    fn advance(&mut self, _: f64, arm: &ArmReadings, out: &mut Outbox) {
        let axes = counts(arm);
        let report = |id: u8, axes: &[i16]| -> Vec<u8> {
            core::iter::once(id).chain(axes.iter().flat_map(|axis| axis.to_le_bytes())).collect()
        };
        if self.combined {
            if axes != self.axes {
                out.push(report(TRANSLATION, &axes));
            }
        } else {
            for (id, half) in [(TRANSLATION, 0..3), (ROTATION, 3..6)] {
                if axes[half.clone()] != self.axes[half.clone()] {
                    out.push(report(id, &axes[half]));
                }
            }
        }
        self.axes = axes;
        if arm.buttons != self.buttons {
            self.buttons = arm.buttons;
            let [low, high, ..] = arm.buttons.to_le_bytes();
            out.push(vec![BUTTONS, low, high]);
        }
    }

    fn motors(&self) -> [f64; MAX_AXES] {
        [0.0; MAX_AXES]
    }
}

/// Bytes of a message of spacenavd: eight i32.
const MESSAGE: usize = 32;

/// The host's side at the socket of spacenavd.
#[derive(Debug, Default)]
pub(super) struct SocketHost {
    gather: Gather<MESSAGE>,
    report: Report,
}

impl Codec for SocketHost {
    fn feed(&mut self, bytes: &[u8]) -> FeedCounts {
        let mut fed = FeedCounts::default();
        for byte in bytes {
            self.gather.push(*byte);
            let message = self.gather.as_slice();
            if message.len() < MESSAGE {
                continue;
            }
            let button = i32_at(message, 4);
            match (
                i32_at(message, 0),
                u32::try_from(button).ok().and_then(|button| 1_u32.checked_shl(button)),
            ) {
                (0, _) => {
                    for (idx, reading) in self.report.readings[..6].iter_mut().enumerate() {
                        *reading = f64::from(i32_at(message, 4 + 4 * idx));
                    }
                    fed.reports += 1;
                }
                (1, Some(bit)) => {
                    self.report.buttons |= bit;
                    fed.reports += 1;
                }
                (2, Some(bit)) => {
                    self.report.buttons &= !bit;
                    fed.reports += 1;
                }
                _ => fed.corrupt += 1,
            }
            self.gather.clear();
        }
        fed
    }

    fn newest(&self) -> &Report {
        &self.report
    }

    fn encode(&mut self, _: &MotorCommand, frame: &mut Frame) {
        frame.clear();
    }

    fn resume(&mut self) {
        self.gather.clear();
    }
}

/// The other end of that socket.
#[derive(Debug, Default)]
pub(super) struct SocketPuck {
    axes: [i16; 6],
    buttons: u32,
    moved_s: f64,
}

impl Firmware for SocketPuck {
    fn receive(&mut self, _: &[u8], _: f64, _: &ArmReadings, _: &mut Outbox) {}

    fn advance(&mut self, now_s: f64, arm: &ArmReadings, out: &mut Outbox) {
        let mut send =
            |words: [i32; 8]| out.push(words.iter().flat_map(|word| word.to_le_bytes()).collect());
        let axes = counts(arm);
        if axes != self.axes {
            let [x, y, z, rx, ry, rz] = axes.map(i32::from);
            send([0, x, y, z, rx, ry, rz, ((now_s - self.moved_s) * 1e3).round() as i32]);
            (self.axes, self.moved_s) = (axes, now_s);
        }
        for button in 0..32 {
            let bit = 1_u32 << button;
            if (arm.buttons ^ self.buttons) & bit != 0 {
                send([if arm.buttons & bit != 0 { 1 } else { 2 }, button, 0, 0, 0, 0, 0, 0]);
            }
        }
        self.buttons = arm.buttons;
    }

    fn motors(&self) -> [f64; MAX_AXES] {
        [0.0; MAX_AXES]
    }
}
