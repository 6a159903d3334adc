//! `haptikfabriken-hid14`: boards of 2019. One report per report; six encoders cut to 16 bits,
//! three currents or a command.

use core::time::Duration;

use super::dialogue::{Question, ask};
use super::number::{Whole, i16_at, low_16, pad, toward_zero_i16};
use super::{
    ArmReadings, Codec, FeedCounts, Firmware, Hid14Carrier, MAX_AXES, MotorCommand, Outbox, Report,
    StartError,
};
use crate::transport::{Frame, Transport};

/// The button is folded into encoder d: pressed above the first, which adds the second.
const BUTTON_ABOVE: i16 = 5000;
const BUTTON_ADDS: i16 = 10_000;
/// Reading of each encoder of the wire: the gimbal is wired from the other end.
const READING_OF: [usize; 6] = [0, 1, 2, 5, 4, 3];

/// The host's side.
#[derive(Debug)]
pub(super) struct HostCodec {
    carrier: Hid14Carrier,
    whole: [Whole; 6],
    report: Report,
}

impl HostCodec {
    pub(super) fn new(carrier: Hid14Carrier) -> Self {
        Self { carrier, whole: Default::default(), report: Report::default() }
    }

    fn finish_frame(&self, frame: &mut Frame) {
        pad(frame, 0, 1 + self.carrier.report_len());
    }
}

impl Codec for HostCodec {
    fn start(&mut self, link: &mut dyn Transport) -> Result<(), StartError> {
        *self = Self::new(self.carrier);
        let mut zero = Frame::default();
        self.encode(&MotorCommand::default(), &mut zero);
        let question = Question {
            step: "waking the board with a zero report",
            frame: zero.as_slice(),
            every: Duration::from_millis(10),
            within: Duration::from_millis(1000),
        };
        let expected = self.carrier.report_len();
        ask(link, &question, |bytes| match bytes.len() {
            n if n == expected => Some(Ok(())),
            8 => Some(Err(StartError::Refused(
                "reports of 8 bytes: this is a WoodenHaptics 1.5 with the same USB ids; choose a \
                    profile with codec woodenhaptics-hid8"
                    .to_owned(),
            ))),
            n @ (14 | 64) => Some(Err(StartError::Refused(format!(
                "reports of {n} bytes, \
                {expected} expected: choose the other carrier, mbed (14) or teensy-rawhid (64)"
            )))),
            _ => None,
        })
    }

    fn feed(&mut self, bytes: &[u8]) -> FeedCounts {
        if bytes.len() != self.carrier.report_len() {
            return FeedCounts { corrupt: 1, ..FeedCounts::default() };
        }
        let mut buttons = 0;
        for (idx, whole) in self.whole.iter_mut().enumerate() {
            let mut count = i16_at(bytes, 2 * idx);
            if idx == 3 && count > BUTTON_ABOVE {
                buttons |= 1;
                count -= BUTTON_ADDS;
            }
            self.report.readings[READING_OF[idx]] = whole.take_16(count);
        }
        if i16_at(bytes, 12) == 1 {
            buttons |= 2;
        }
        self.report.buttons = buttons;
        FeedCounts { reports: 1, ..FeedCounts::default() }
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
        self.finish_frame(frame);
    }
}

/// The arm's side. Speaks first once, then when spoken to; watchdog of 0.5 s, not latched; does not
/// clamp.
#[derive(Debug)]
pub(super) struct ArmFirmware {
    carrier: Hid14Carrier,
    motors: [f64; MAX_AXES],
    has_spoken: bool,
    fed_s: f64,
}

impl ArmFirmware {
    pub(super) fn new(carrier: Hid14Carrier) -> Self {
        Self { carrier, motors: [0.0; MAX_AXES], has_spoken: false, fed_s: 0.0 }
    }

    fn report(&mut self, arm: &ArmReadings, out: &mut Outbox) {
        let mut report = Vec::with_capacity(self.carrier.report_len());
        for (idx, reading_idx) in READING_OF.iter().enumerate() {
            let count = low_16(arm.readings[*reading_idx]);
            let folded = if idx == 3 && arm.buttons & 1 != 0 {
                count.wrapping_add(BUTTON_ADDS)
            } else {
                count
            };
            report.extend(folded.to_le_bytes());
        }
        report.extend(i16::from(arm.buttons & 2 != 0).to_le_bytes());
        report.resize(self.carrier.report_len(), 0);
        out.push(report);
    }
}

impl Firmware for ArmFirmware {
    fn receive(&mut self, bytes: &[u8], now_s: f64, arm: &ArmReadings, out: &mut Outbox) {
        let payload = match bytes {
            [0, payload @ ..] if payload.len() == self.carrier.report_len() => payload,
            payload if payload.len() == self.carrier.report_len() => payload,
            _ => return,
        };
        self.fed_s = now_s;
        let word = |idx: usize| f64::from(i16_at(payload, 2 * idx));
        self.motors[..3].copy_from_slice(&[word(0), word(1), word(2)]);
        self.report(arm, out);
    }

    fn advance(&mut self, now_s: f64, arm: &ArmReadings, out: &mut Outbox) {
        if now_s - self.fed_s > 0.5 {
            self.motors = [0.0; MAX_AXES];
        }
        if !self.has_spoken {
            self.has_spoken = true;
            self.report(arm, out);
        }
    }

    fn motors(&self) -> [f64; MAX_AXES] {
        self.motors
    }
}
