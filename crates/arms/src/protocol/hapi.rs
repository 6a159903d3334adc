//! `hapi-f32`: Haply 2DIY and other hAPI boards. No framing, no checksum, no watchdog: the last
//! torque stays on.
//!
//! ```text
//! host  setup ──► zero torque ──► torque ──► … ──► zero torque ─► zero torque ─► reset
//! board               angles        angles             angles         angles
//!                      └ wrong id, or bytes left over at the next command: zero torque at once, silence for 1.2 s, flush, zero torque
//! ```

use core::time::Duration;

use super::dialogue::{Question, ask, hush};
use super::gather::Gather;
use super::number::{f32_at, finite_f32};
use super::{
    ArmReadings, Codec, FeedCounts, Firmware, HapiBoard, HapiEncoder, MAX_AXES, MotorCommand,
    Outbox, Report, StartError,
};
use crate::transport::{Frame, Transport};

const RESET: u8 = 0;
const SETUP: u8 = 1;
const WRITE: u8 = 2;
/// Silence after which a board has given up on whatever it was reading.
const SILENCE: Duration = Duration::from_millis(1200);
/// Every byte of a torque that is as good as zero, 4e-37 N·m. None of them begins a command.
const NEXT_TO_ZERO: u8 = 3;
/// Less than one step of the pulse width of any board, N·m.
const TORQUE_STEP_NM: f64 = 1e-9;

/// The host's side.
#[derive(Debug)]
pub(super) struct HostCodec {
    board: HapiBoard,
    gather: Gather<32>,
    report: Report,
    is_set_up: bool,
    /// It still is, whether it answers or not.
    kept_power: bool,
    lost: bool,
}

impl HostCodec {
    pub(super) fn new(board: HapiBoard) -> Self {
        Self {
            board,
            gather: Gather::default(),
            report: Report::default(),
            is_set_up: false,
            kept_power: false,
            lost: false,
        }
    }

    fn reply_len(&self) -> usize {
        1 + 4 * self.board.encoders.len().min(4)
    }

    fn setup(&self, frame: &mut Frame) {
        let HapiBoard { device_id, motors, encoders } = &self.board;
        let mask = |n: usize| (1_u8 << n.min(4)) - 1;
        frame.clear();
        frame.extend(&[SETUP, *device_id, mask(motors.len())]);
        for motor in motors.iter().take(4) {
            frame.push(*motor as u8);
        }
        frame.push(mask(encoders.len()));
        for encoder in encoders.iter().take(4) {
            frame.push(encoder.direction as u8);
        }
        // No analog sensors, no PWM pins.
        frame.extend(&[0, 0]);
        for HapiEncoder { start_deg, counts_per_rev, .. } in encoders.iter().take(4) {
            frame.extend(&start_deg.to_le_bytes());
            frame.extend(&counts_per_rev.to_le_bytes());
        }
    }

    fn exchange_zero(
        &mut self,
        link: &mut dyn Transport,
        within: Duration,
    ) -> Result<(), StartError> {
        let mut zero = Frame::default();
        self.gather.clear();
        self.lost = false;
        self.encode(&MotorCommand::default(), &mut zero);
        // Once: a board that reads the second one as a part of the first is worse than one that is
        // silent.
        let question =
            Question { step: "zero torque", frame: zero.as_slice(), every: Duration::MAX, within };
        ask(link, &question, |bytes| (self.feed(bytes).reports > 0).then_some(Ok(())))
    }
}

impl Codec for HostCodec {
    fn start(&mut self, link: &mut dyn Transport) -> Result<(), StartError> {
        hush(link, Duration::from_millis(50))?;
        if self.is_set_up && self.exchange_zero(link, Duration::from_millis(200)).is_ok() {
            // The link was lost, not the board: a second setup would take this pose for the home
            // pose.
            return Ok(());
        }
        if self.kept_power {
            // The setup would wait for the board to wake, and give it a home pose that is none. It
            // may be in the middle of a command.
            hush(link, SILENCE)?;
            return self.exchange_zero(link, Duration::from_millis(500));
        }
        let mut setup = Frame::default();
        self.setup(&mut setup);
        self.is_set_up = true;
        let mut answered = Ok(());
        for turn in 0..2 {
            if turn > 0 {
                // A host of another protocol may have left it in the middle of a command: it gives
                // that up.
                hush(link, SILENCE)?;
            }
            link.send(setup.as_slice())?;
            // Setup is not answered.
            hush(link, Duration::from_millis(100))?;
            answered = self.exchange_zero(link, Duration::from_millis(500));
            if !matches!(answered, Err(StartError::Silent { .. })) {
                break;
            }
        }
        answered
    }

    fn started_before(&mut self, kept_power: bool) {
        self.is_set_up = true;
        self.kept_power = kept_power;
    }

    fn feed(&mut self, bytes: &[u8]) -> FeedCounts {
        let mut fed = FeedCounts::default();
        for byte in bytes {
            if self.lost {
                break;
            }
            self.gather.push(*byte);
            let reply = self.gather.as_slice();
            if reply.first().is_some_and(|id| *id != self.board.device_id) {
                self.lost = true;
                fed.corrupt += 1;
                break;
            }
            if reply.len() < self.reply_len() {
                continue;
            }
            let mut readings = [0.0; MAX_AXES];
            for (idx, reading) in
                readings.iter_mut().enumerate().take(self.board.encoders.len().min(4))
            {
                *reading = f64::from(f32_at(reply, 1 + 4 * idx));
            }
            // An angle that is no number too: whether the board says so or a byte is missing, the
            // tick takes the force away at once.
            self.report.readings = readings;
            fed.reports += 1;
            self.gather.clear();
        }
        fed
    }

    fn newest(&self) -> &Report {
        &self.report
    }

    fn encode(&mut self, command: &MotorCommand, frame: &mut Frame) {
        // Half a reply when the next command is due: whatever comes now cannot be distinguished
        // from its other half.
        self.lost |= !self.gather.as_slice().is_empty();
        frame.clear();
        if self.lost {
            return;
        }
        frame.extend(&[WRITE, self.board.device_id]);
        for motor in &command.motors()[..self.board.motors.len().min(4)] {
            frame.extend(&finite_f32(*motor).to_le_bytes());
        }
    }

    fn silence(&self) -> Option<Duration> {
        self.lost.then_some(SILENCE)
    }

    /// The board is in step, and only its reply was cut short: it takes the command as any other,
    /// and lets go now and not after the silence.
    ///
    /// Or it has a part of a command: the missing bytes are filled with the first ones of this
    /// frame, which make the rest of a torque next to nothing, as its most significant byte becomes
    /// 2, the id or 3. A torque that was whole already stays until the silence is over, as it would
    /// without this. What is left over then stands where a command begins. A true zero would be a
    /// reset there, which leaves torques on and lets nothing reach them any more; hence
    /// [`NEXT_TO_ZERO`], which begins no command and is thrown away.
    fn zero_out_of_step(&mut self, frame: &mut Frame) {
        frame.clear();
        // The id may stand there too.
        if matches!(self.board.device_id, RESET | SETUP | WRITE) {
            return;
        }
        frame.extend(&[WRITE, self.board.device_id]);
        for _ in self.board.motors.iter().take(4) {
            frame.extend(&[NEXT_TO_ZERO; 4]);
        }
    }

    fn resume(&mut self) {
        self.lost = false;
        self.gather.clear();
    }

    fn finish(&mut self, link: &mut dyn Transport) {
        if self.lost && hush(link, SILENCE).is_err() {
            return;
        }
        let answered = self.exchange_zero(link, Duration::from_millis(100)).is_ok();
        if !answered {
            let _ = hush(link, SILENCE);
        }
        let _ = self.exchange_zero(link, Duration::from_millis(100));
        // After a reset no write can clear a torque: only when the zero is known to have arrived.
        if answered {
            let _ = link.send(&[RESET, 0]);
        }
    }

    fn finish_lost(&mut self, link: &mut dyn Transport) {
        // It may have a part of a command, which only silence takes away. No reset: it would forget
        // its motors and not its torques.
        if hush(link, SILENCE).is_ok() {
            let _ = self.exchange_zero(link, Duration::from_millis(100));
        }
    }
}

/// The arm's side. Clamps torques at 0.123 N·m and keeps the last ones for ever; a reset forgets
/// the motors and leaves them on.
#[derive(Debug, Default)]
pub(super) struct ArmFirmware {
    gather: Gather<64>,
    motors: [f64; MAX_AXES],
    device_id: u8,
    n_motors: usize,
    counts_per_rev: Vec<f32>,
    offsets_deg: Vec<f64>,
    was_set_up: bool,
    heard_s: f64,
}

impl ArmFirmware {
    /// Bytes of the command that begins the buffer, as far as they are known yet.
    fn needed(&self) -> usize {
        let bytes = self.gather.as_slice();
        let count = |at: usize| bytes.get(at).map(|mask| mask.count_ones() as usize);
        match bytes.first() {
            Some(&WRITE) => 2 + 4 * self.n_motors,
            Some(&SETUP) => {
                let Some(n_motors) = count(2) else { return 3 };
                let Some(n_encoders) = count(3 + n_motors) else { return 4 + n_motors };
                let analog_at = 4 + n_motors + n_encoders;
                let Some(n_analog) = bytes.get(analog_at) else { return analog_at + 1 };
                let pwm_at = analog_at + 1 + usize::from(*n_analog);
                let Some(n_pwm) = bytes.get(pwm_at) else { return pwm_at + 1 };
                pwm_at + 1 + usize::from(*n_pwm) + 8 * n_encoders
            }
            _ => 2,
        }
    }

    fn take(&mut self, arm: &ArmReadings, out: &mut Outbox) {
        let bytes = self.gather.as_slice();
        match bytes[0] {
            SETUP => {
                self.device_id = bytes[1];
                // As many as the masks name, though a board has four ports: the rest of the frame
                // is placed by them.
                self.n_motors = bytes[2].count_ones() as usize;
                let n_encoders = bytes[3 + self.n_motors].count_ones() as usize;
                let data = &bytes[bytes.len() - 8 * n_encoders..];
                self.counts_per_rev =
                    (0..n_encoders).map(|idx| f32_at(data, 8 * idx + 4)).collect();
                // The first setup finds the arm in its home pose; another one takes whatever pose
                // there is for it.
                let start = |idx: usize| f64::from(f32_at(data, 8 * idx));
                let again = self.was_set_up;
                self.offsets_deg = (0..n_encoders)
                    .map(|idx| if again { start(idx) - arm.readings[idx] } else { 0.0 })
                    .collect();
                self.was_set_up = true;
            }
            WRITE if !self.counts_per_rev.is_empty() && bytes[1] == self.device_id => {
                for (idx, motor) in self.motors.iter_mut().enumerate().take(self.n_motors) {
                    let torque = f64::from(f32_at(bytes, 2 + 4 * idx));
                    let is_felt = torque.is_finite() && torque.abs() >= TORQUE_STEP_NM;
                    *motor = if is_felt { torque.clamp(-0.123, 0.123) } else { 0.0 };
                }
                let mut reply = vec![self.device_id];
                for (idx, counts_per_rev) in self.counts_per_rev.iter().enumerate() {
                    let per_degree = f64::from(*counts_per_rev) / 360.0;
                    let degrees = ((arm.readings[idx] + self.offsets_deg[idx]) * per_degree)
                        .round()
                        / per_degree;
                    reply.extend((degrees as f32).to_le_bytes());
                }
                out.push(reply);
            }
            // The motors stay on, and nothing reaches them any more.
            RESET => {
                self.n_motors = 0;
                // The host has gone, and the user holds the arm in its start pose when it is opened
                // again.
                self.was_set_up = false;
            }
            _ => {}
        }
    }
}

impl Firmware for ArmFirmware {
    fn receive(&mut self, bytes: &[u8], now_s: f64, arm: &ArmReadings, out: &mut Outbox) {
        // A host of another protocol may have left half a command behind.
        if now_s - self.heard_s >= SILENCE.as_secs_f64() {
            self.gather.clear();
        }
        self.heard_s = now_s;
        for byte in bytes {
            if !self.gather.push(*byte) {
                self.gather.clear();
            }
            if self.gather.as_slice().len() >= self.needed() {
                self.take(arm, out);
                self.gather.clear();
            }
        }
    }

    fn advance(&mut self, _: f64, _: &ArmReadings, _: &mut Outbox) {}

    fn motors(&self) -> [f64; MAX_AXES] {
        self.motors
    }
}
