//! `woodenhaptics-hid8`: WoodenHaptics 1.5. Reports of 8 bytes, sent by the arm; three encoders cut
//! to 16 bits and a counter, three currents.

use core::time::Duration;

use super::dialogue::{Question, ask};
use super::number::{Whole, i16_at, low_16, toward_zero_i16, u16_at};
use super::{
    ArmReadings, Codec, FeedCounts, Firmware, MAX_AXES, MotorCommand, Outbox, Report, StartError,
};
use crate::transport::{Frame, Transport};

const LEN: usize = 8;

/// The host's side.
#[derive(Debug, Default)]
pub(super) struct HostCodec {
    whole: [Whole; 3],
    counter: Option<u16>,
    report: Report,
}

impl Codec for HostCodec {
    fn start(&mut self, link: &mut dyn Transport) -> Result<(), StartError> {
        *self = Self::default();
        let question = Question {
            step: "waiting for the first report (boards of 2019 have the same USB ids and wait for \
                the host: codec haptikfabriken-hid14)",
            frame: &[],
            every: Duration::MAX,
            within: Duration::from_millis(1000),
        };
        ask(link, &question, |bytes| match bytes.len() {
            LEN => Some(Ok(())),
            14 | 64 => Some(Err(StartError::Refused(format!(
                "reports of {} bytes: this is a board of 2019 with the same USB ids; choose a \
                    profile with codec haptikfabriken-hid14",
                bytes.len()
            )))),
            _ => None,
        })?;
        // Until its watchdog trips it holds the current that a host before us asked for.
        let mut zero = Frame::default();
        self.encode(&MotorCommand::default(), &mut zero);
        link.send(zero.as_slice())?;
        Ok(())
    }

    fn feed(&mut self, bytes: &[u8]) -> FeedCounts {
        if bytes.len() != LEN {
            return FeedCounts { corrupt: 1, ..FeedCounts::default() };
        }
        let counter = u16_at(bytes, 6);
        let step = self.counter.map_or(1, |last| counter.wrapping_sub(last));
        self.counter = Some(counter);
        for (idx, whole) in self.whole.iter_mut().enumerate() {
            self.report.readings[idx] = whole.take_16(i16_at(bytes, 2 * idx));
        }
        FeedCounts {
            reports: 1,
            gap: u32::from(step.saturating_sub(1)),
            repeated: u32::from(step == 0),
            ..FeedCounts::default()
        }
    }

    fn newest(&self) -> &Report {
        &self.report
    }

    fn encode(&mut self, command: &MotorCommand, frame: &mut Frame) {
        frame.clear();
        frame.push(0);
        for motor in &command.motors()[..3] {
            frame.extend(&toward_zero_i16(*motor, i16::MAX).to_le_bytes());
        }
        frame.extend(&[0, 0]);
    }

    fn resume(&mut self) {
        self.counter = None;
    }
}

/// The arm's side. Watchdog of 0.5 s, not latched; currents above 3 A are 3 A.
#[derive(Debug, Default)]
pub(super) struct ArmFirmware {
    motors: [f64; MAX_AXES],
    fed_s: f64,
    counter: u16,
}

impl Firmware for ArmFirmware {
    fn receive(&mut self, bytes: &[u8], now_s: f64, _: &ArmReadings, _: &mut Outbox) {
        let payload = match bytes.len() {
            LEN => bytes,
            9 if bytes[0] == 0 => &bytes[1..],
            _ => return,
        };
        self.fed_s = now_s;
        for (idx, motor) in self.motors[..3].iter_mut().enumerate() {
            *motor = f64::from(i16_at(payload, 2 * idx)).clamp(-3000.0, 3000.0);
        }
    }

    fn advance(&mut self, now_s: f64, arm: &ArmReadings, out: &mut Outbox) {
        if now_s - self.fed_s > 0.5 {
            self.motors = [0.0; MAX_AXES];
        }
        self.counter = self.counter.wrapping_add(1);
        let mut report = Vec::with_capacity(LEN);
        for reading in &arm.readings[..3] {
            report.extend(low_16(*reading).to_le_bytes());
        }
        report.extend(self.counter.to_le_bytes());
        out.push(report);
    }

    fn motors(&self) -> [f64; MAX_AXES] {
        self.motors
    }
}
