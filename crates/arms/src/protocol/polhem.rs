//! `polhem-ascii64`: Polhem of 2020–21. One line each way, padded with blanks; encoders, or a pose
//! that the arm computes.

use core::time::Duration;

use super::dialogue::{Question, ask, hush};
use super::gather::Gather;
use super::number::{count_32, integers, pad, put, toward_zero, words};
use super::{
    ArmReadings, Codec, FeedCounts, Firmware, MAX_AXES, MotorCommand, Outbox, Report, StartError,
};
use crate::transport::{Frame, Transport};

/// Bytes of a line that the host sends, its end included, and of one that the arm answers.
const LINE: usize = 64;
/// Beyond this the arm zeroes a motor, mA.
const CURRENT_MAX_MA: u32 = 6000;
/// Beyond this two numbers may no longer fit a line with the rest.
const COUNT_MAX: u32 = 99_999_999;
/// Most that is asked of the arm's own kinematics, mN: far above any arm, and short enough for the
/// line.
const FORCE_MAX_MN: u32 = 100_000;

/// The host's side.
#[derive(Debug)]
pub(super) struct HostCodec {
    cartesian: bool,
    gather: Gather<128>,
    report: Report,
}

impl HostCodec {
    pub(super) fn new(cartesian: bool) -> Self {
        Self { cartesian, gather: Gather::default(), report: Report::default() }
    }

    fn read_line(&mut self) -> bool {
        let line = self.gather.as_slice();
        let mut readings = [0.0; MAX_AXES];
        if self.cartesian {
            let mut words = words(line, b' ');
            for (idx, reading) in readings[..7].iter_mut().enumerate() {
                let Some(Ok(number)) = words.next().map(str::parse::<f64>) else { return false };
                // One that is none is a whole word too: the arm says so, and the host has to know.
                *reading = if idx < 3 { number * 1e-3 } else { number };
            }
            if words.next().is_none_or(|info| info.parse::<i32>().is_err())
                || words.next().is_some()
            {
                return false;
            }
        } else {
            let Some(numbers) = integers::<7>(line, b' ') else { return false };
            for (reading, number) in readings.iter_mut().zip(&numbers[..6]) {
                *reading = f64::from(*number);
            }
        }
        self.report.readings = readings;
        true
    }
}

fn end_line(frame: &mut Frame) {
    pad(frame, b' ', LINE - 1);
    frame.push(b'\n');
}

impl Codec for HostCodec {
    fn start(&mut self, link: &mut dyn Transport) -> Result<(), StartError> {
        *self = Self::new(self.cartesian);
        hush(link, Duration::from_millis(20))?;
        let mut zero = Frame::default();
        self.encode(&MotorCommand::default(), &mut zero);
        let question = Question {
            step: "waiting for a line of numbers",
            frame: zero.as_slice(),
            every: Duration::from_millis(100),
            within: Duration::from_millis(3000),
        };
        ask(link, &question, |bytes| (self.feed(bytes).reports > 0).then_some(Ok(())))?;
        hush(link, Duration::from_millis(20))?;
        self.gather.clear();
        Ok(())
    }

    fn feed(&mut self, bytes: &[u8]) -> FeedCounts {
        let mut fed = FeedCounts::default();
        for byte in bytes {
            match self.gather.until(b'\n', *byte) {
                Some(true) if self.read_line() => fed.reports += 1,
                Some(_) => fed.corrupt += 1,
                None => {}
            }
        }
        fed
    }

    fn newest(&self) -> &Report {
        &self.report
    }

    fn encode(&mut self, command: &MotorCommand, frame: &mut Frame) {
        frame.clear();
        let [a, b, c] = [0, 1, 2].map(|idx| command.motors()[idx]);
        if self.cartesian {
            let [x, y, z] = [a, b, c].map(|force| toward_zero(force * 1e3, FORCE_MAX_MN));
            put!(frame, "{x} {y} {z} 2 0 0 0");
        } else {
            let [a, b, c] = [a, b, c].map(|current| toward_zero(current, CURRENT_MAX_MA));
            put!(frame, "{a} {b} {c} 0 0 0 0");
        }
        end_line(frame);
    }

    fn resume(&mut self) {
        self.gather.clear();
    }

    fn set_readings(&mut self, readings: &[f64; MAX_AXES], frame: &mut Frame) -> bool {
        let [a, b, c, d, e, f] =
            [0, 1, 2, 3, 4, 5].map(|idx| toward_zero(readings[idx], COUNT_MAX));
        frame.clear();
        put!(frame, "{d} {e} {f} 1 {a} {b} {c}");
        end_line(frame);
        true
    }
}

/// The arm's side. Watchdog of 0.1 s, fed by sound lines alone, not latched; a motor out of range
/// is zero, not clamped. Its kinematics are not modelled: after a Cartesian command, `motors` is
/// the force.
#[derive(Debug, Default)]
pub(super) struct ArmFirmware {
    gather: Gather<64>,
    motors: [f64; MAX_AXES],
    offsets: [f64; 6],
    cartesian: bool,
    fed_s: f64,
}

impl ArmFirmware {
    fn take(&mut self, now_s: f64, arm: &ArmReadings, out: &mut Outbox) {
        self.motors = [0.0; MAX_AXES];
        if let Some(numbers) = integers::<7>(self.gather.as_slice(), b' ') {
            self.fed_s = now_s;
            let [x, y, z, _, a, b, c] = numbers.map(f64::from);
            match numbers[3] {
                0 => {
                    self.cartesian = false;
                    self.motors[..3].copy_from_slice(&[x, y, z]);
                }
                1 => {
                    for (idx, target) in [a, b, c, x, y, z].into_iter().enumerate() {
                        self.offsets[idx] = target - arm.readings[idx].round();
                    }
                }
                2 => {
                    self.cartesian = true;
                    self.motors[..3].copy_from_slice(&[x * 1e-3, y * 1e-3, z * 1e-3]);
                }
                _ => {}
            }
            let limit = if self.cartesian { f64::INFINITY } else { f64::from(CURRENT_MAX_MA) };
            for motor in &mut self.motors {
                if motor.abs() > limit {
                    *motor = 0.0;
                }
            }
        }
        let readings = &arm.readings;
        let (text, len) = if self.cartesian {
            let [x, y, z] = [0, 1, 2].map(|idx| readings[idx] * 1e3);
            let [a, lambda, d, e] = [3, 4, 5, 6].map(|idx| readings[idx]);
            (format!("{x:8.3} {y:8.3} {z:8.3} {a:7.4} {lambda:7.4} {d:7.4} {e:7.4} 0"), LINE - 2)
        } else {
            let counts: Vec<_> =
                (0..6).map(|idx| count_32(readings[idx] + self.offsets[idx]).to_string()).collect();
            (format!("{} 0", counts.join(" ")), LINE - 1)
        };
        out.push(format!("{text:len$}\n").into_bytes());
    }
}

impl Firmware for ArmFirmware {
    fn receive(&mut self, bytes: &[u8], now_s: f64, arm: &ArmReadings, out: &mut Outbox) {
        for byte in bytes {
            // Of a longer line the first 64 bytes are dropped and the rest is a line of its own.
            if self.gather.as_slice().len() == LINE {
                self.gather.clear();
            }
            if self.gather.until(b'\n', *byte).is_some() {
                self.take(now_s, arm, out);
            }
        }
    }

    fn advance(&mut self, now_s: f64, _: &ArmReadings, _: &mut Outbox) {
        if now_s - self.fed_s > 0.1 {
            self.motors = [0.0; MAX_AXES];
        }
    }

    fn motors(&self) -> [f64; MAX_AXES] {
        self.motors
    }
}
