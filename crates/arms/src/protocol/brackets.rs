//! `haptikfabriken-brackets`: boards of 2022 and later. `[model,e0,…,e5,err]` for `[ma0,ma1,ma2]`,
//! strictly in turn.

use core::time::Duration;

use super::dialogue::{Question, ask, hush};
use super::gather::Gather;
use super::number::{count_32, integers, pad, put, toward_zero};
use super::{
    ArmReadings, Codec, FeedCounts, Firmware, MAX_AXES, MotorCommand, Outbox, Report, StartError,
};
use crate::transport::{Frame, Transport};

/// [`Report::error`] of an arm that calls itself another model than at the start: above every code
/// of the arm's own.
pub(super) const WRONG_MODEL: u32 = 0xFFFF;

/// Least bytes of a write.
const WRITE_MIN: usize = 16;
/// Most that is ever asked, mA: keeps a frame short; the limit of an arm is its profile's.
const CURRENT_MAX_MA: u32 = 32_767;

fn model_name(model: i32) -> &'static str {
    match model {
        1 => "Polhem 2022",
        2 => "vintage",
        3 => "WoodenHaptics",
        _ => "unknown",
    }
}

/// The host's side.
#[derive(Debug)]
pub(super) struct HostCodec {
    model: u8,
    gather: Gather<128>,
    report: Report,
}

impl HostCodec {
    pub(super) fn new(model: u8) -> Self {
        Self { model, gather: Gather::default(), report: Report::default() }
    }

    /// The numbers of the frame that has just ended, and whether anything but blanks stood before
    /// it.
    fn numbers(&self) -> (Option<[i32; 8]>, bool) {
        let line = self.gather.as_slice();
        let Some(open) = line.iter().rposition(|byte| *byte == b'[') else { return (None, false) };
        let (before, rest) = line.split_at(open);
        let is_dirty = before.iter().any(|byte| !matches!(byte, b'\n' | b'\r' | b' ' | 0));
        (integers::<8>(&rest[1..], b','), is_dirty)
    }
}

impl Codec for HostCodec {
    fn start(&mut self, link: &mut dyn Transport) -> Result<(), StartError> {
        *self = Self::new(self.model);
        let mut wake = Frame::default();
        self.kick(&mut wake);
        let question = Question {
            step: "waking the board with [0,0,0]",
            frame: wake.as_slice(),
            every: Duration::from_millis(100),
            within: Duration::from_millis(3000),
        };
        let expected = i32::from(self.model);
        ask(link, &question, |bytes| {
            for byte in bytes {
                if self.gather.until(b']', *byte) != Some(true) {
                    continue;
                }
                if let (Some([model, ..]), _) = self.numbers() {
                    return Some(if model == expected {
                        Ok(())
                    } else {
                        Err(StartError::Refused(format!(
                            "the arm says that it is model {model} ({}), and the profile is for \
                                model {expected} ({}): choose the profile of model {model}",
                            model_name(model),
                            model_name(expected)
                        )))
                    });
                }
            }
            None
        })?;
        hush(link, Duration::from_millis(20))?;
        self.gather.clear();
        Ok(())
    }

    fn feed(&mut self, bytes: &[u8]) -> FeedCounts {
        let mut fed = FeedCounts::default();
        for byte in bytes {
            match self.gather.until(b']', *byte) {
                Some(true) => {
                    let (numbers, is_dirty) = self.numbers();
                    fed.corrupt += u32::from(is_dirty);
                    let Some([model, encoders @ .., error]) = numbers else {
                        fed.corrupt += 1;
                        continue;
                    };
                    let encoders: [i32; 6] = encoders;
                    for (reading, encoder) in self.report.readings.iter_mut().zip(encoders) {
                        *reading = f64::from(encoder);
                    }
                    let is_expected = model == i32::from(self.model);
                    self.report.error = if is_expected {
                        error.unsigned_abs().min(WRONG_MODEL - 1)
                    } else {
                        WRONG_MODEL
                    };
                    fed.reports += 1;
                }
                Some(false) => fed.corrupt += 1,
                None => {}
            }
        }
        fed
    }

    fn newest(&self) -> &Report {
        &self.report
    }

    fn encode(&mut self, command: &MotorCommand, frame: &mut Frame) {
        let [a, b, c] = [0, 1, 2].map(|idx| toward_zero(command.motors()[idx], CURRENT_MAX_MA));
        frame.clear();
        put!(frame, "[{a},{b},{c}]\n");
        pad(frame, 0, WRITE_MIN);
    }

    fn kick(&mut self, frame: &mut Frame) -> bool {
        frame.clear();
        put!(frame, "[0,0,0]");
        pad(frame, 0, WRITE_MIN);
        true
    }

    fn resume(&mut self) {
        self.gather.clear();
    }

    fn identity(&self) -> Option<String> {
        Some(format!("model {} ({})", self.model, model_name(self.model.into())))
    }
}

/// The arm's side. No watchdog: the last currents stay on.
#[derive(Debug)]
pub(super) struct ArmFirmware {
    model: u8,
    gather: Gather<128>,
    motors: [f64; MAX_AXES],
}

impl ArmFirmware {
    pub(super) fn new(model: u8) -> Self {
        Self { model, gather: Gather::default(), motors: [0.0; MAX_AXES] }
    }
}

impl Firmware for ArmFirmware {
    fn receive(&mut self, bytes: &[u8], _: f64, arm: &ArmReadings, out: &mut Outbox) {
        for byte in bytes {
            if self.gather.until(b']', *byte) != Some(true) {
                continue;
            }
            let line = self.gather.as_slice();
            let Some(open) = line.iter().rposition(|byte| *byte == b'[') else { continue };
            let Some(currents) = integers::<3>(&line[open + 1..], b',') else { continue };
            for (motor, current) in self.motors.iter_mut().zip(currents) {
                *motor = f64::from(current);
            }
            let counts: Vec<_> =
                arm.readings[..6].iter().map(|reading| count_32(*reading).to_string()).collect();
            out.push(format!("[{},{},0]\n", self.model, counts.join(",")).into_bytes());
        }
    }

    fn advance(&mut self, _: f64, _: &ArmReadings, _: &mut Outbox) {}

    fn motors(&self) -> [f64; MAX_AXES] {
        self.motors
    }
}
