//! `hapkit-ascii`: Hapkit, one axis. `Prm pos vel acc button` by itself; `P1 force` is answered by
//! `Ok`.

use core::time::Duration;

use super::dialogue::{Question, ask};
use super::gather::Gather;
use super::number::{put, words};
use super::{
    ArmReadings, Codec, FeedCounts, Firmware, MAX_AXES, MotorCommand, Outbox, Report, StartError,
};
use crate::transport::{Frame, Transport};

/// Most that is ever asked, N: keeps a line short; the limit of an arm is its profile's.
const FORCE_MAX_N: f64 = 1000.0;

/// The host's side.
#[derive(Debug, Default)]
pub(super) struct HostCodec {
    gather: Gather<128>,
    report: Report,
    /// Commands since the last `Ok`; `None`: there was none yet. A board need not answer.
    unheard: Option<u32>,
}

impl HostCodec {
    /// `None`: not a report, and nothing wrong with it.
    fn read_line(&mut self) -> Option<bool> {
        let line = self.gather.as_slice();
        let line = line.strip_suffix(b"\r").unwrap_or(line);
        if line == b"Ok" {
            self.unheard = Some(0);
        }
        if line.is_empty() || line == b"Ok" {
            return None;
        }
        let mut words = words(line, b' ');
        if words.next() != Some("Prm") {
            return Some(false);
        }
        let mut number = || words.next()?.parse::<f64>().ok();
        let (Some(position), Some(velocity), Some(_acceleration), Some(button)) =
            (number(), number(), number(), number())
        else {
            return Some(false);
        };
        if words.next().is_some() {
            return Some(false);
        }
        // A number that is none was not garbled on its way, it is a whole word: the arm says so,
        // and the host has to know.
        self.report.readings[0] = if velocity.is_finite() { position } else { f64::NAN };
        let mut rates = [0.0; MAX_AXES];
        rates[0] = velocity;
        self.report.rates = Some(rates);
        self.report.buttons = u32::from(button == 1.0);
        Some(true)
    }
}

impl Codec for HostCodec {
    fn start(&mut self, link: &mut dyn Transport) -> Result<(), StartError> {
        *self = Self::default();
        // A board that was not reset holds the last commanded force, also while it sends nothing.
        let mut zero = Frame::default();
        self.encode(&MotorCommand::default(), &mut zero);
        // A board that was reset by the opening drives its handle into both stops first. A board
        // that sends and does not receive cannot be used, and is dangerous.
        let question = Question {
            step: "waiting for a line, and for Ok to a force of zero",
            frame: zero.as_slice(),
            every: Duration::from_millis(100),
            within: Duration::from_millis(10_000),
        };
        let mut reports = 0;
        ask(link, &question, |bytes| {
            reports += self.feed(bytes).reports;
            (reports > 0 && self.unheard.is_some()).then_some(Ok(()))
        })?;
        link.send(zero.as_slice())?;
        Ok(())
    }

    fn feed(&mut self, bytes: &[u8]) -> FeedCounts {
        let mut fed = FeedCounts::default();
        for byte in bytes {
            match self.gather.until(b'\n', *byte) {
                Some(true) => match self.read_line() {
                    Some(true) => fed.reports += 1,
                    Some(false) => fed.corrupt += 1,
                    None => {}
                },
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
        let force = command.motors()[0];
        let force = if force.is_finite() { force.clamp(-FORCE_MAX_N, FORCE_MAX_N) } else { 0.0 };
        // Five places, toward zero; adding 0 makes −0 a 0.
        let force = (force * 1e5).trunc() / 1e5 + 0.0;
        frame.clear();
        put!(frame, "P1 {force}\n");
        self.unheard = self.unheard.map(|unheard| unheard.saturating_add(1));
    }

    fn unheard(&self) -> Option<u32> {
        self.unheard
    }

    fn finish(&mut self, link: &mut dyn Transport) {
        // Also behind a start that failed: no watchdog lets go.
        let mut zero = Frame::default();
        self.encode(&MotorCommand::default(), &mut zero);
        let _ = link.send(zero.as_slice());
    }

    fn resume(&mut self) {
        self.gather.clear();
    }
}

/// The arm's side, as a board would be that takes forces at its own rate: the published example has
/// that switched off. No watchdog.
#[derive(Debug, Default)]
pub(super) struct ArmFirmware {
    gather: Gather<64>,
    motors: [f64; MAX_AXES],
}

impl Firmware for ArmFirmware {
    fn receive(&mut self, bytes: &[u8], _: f64, _: &ArmReadings, out: &mut Outbox) {
        for byte in bytes {
            if self.gather.until(b'\n', *byte) != Some(true) {
                continue;
            }
            let mut words = words(self.gather.as_slice(), b' ');
            if words.next() == Some("P1")
                && let Some(Ok(force)) = words.next().map(str::parse::<f64>)
                && force.is_finite()
                && words.next().is_none()
            {
                self.motors[0] = force;
                out.push(b"Ok\n".to_vec());
            }
        }
    }

    fn advance(&mut self, _: f64, arm: &ArmReadings, out: &mut Outbox) {
        let button = arm.buttons & 1;
        out.push(
            format!("Prm {:.5} {:.5} {:.5} {button}\n", arm.readings[0], arm.rates[0], 0.0)
                .into_bytes(),
        );
    }

    fn motors(&self) -> [f64; MAX_AXES] {
        self.motors
    }
}
