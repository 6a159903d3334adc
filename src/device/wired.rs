//! The driver of every arm that hangs on a wire: transport, protocol, transmission and kinematics put together.
//!
//! ```text
//!  read    link ─► codec ─► readings ─► transmission ─► joint angles ─► kinematics ─► pose, twist (device axes)
//!  write   wrench ─► project, limit ─► Jᵀ ─► joint torques ─► transmission, all motors scaled together ─► codec ─► link
//! ```
//!
//! What is not decided here: whether force may flow. The tick does that from what a sample says (homing, lost and corrupt packets, errors of the arm,
//! hot motors). This layer only repeats the hard limits of the profile, because it is the last code before the motors (devices reference,
//! section 3.4).

mod connection;
mod parameters;
mod round_trip;
mod thermal;

use core::time::Duration;

use glam::{DQuat, DVec3};

pub(super) use self::connection::{Connection, Replacements};
pub use self::parameters::Timebase;
pub(super) use self::parameters::WiredParameters;
pub(super) use self::round_trip::RoundTrip;
pub(super) use self::thermal::Thermal;
use super::kinematics::{Configuration, Kinematics};
use super::protocol::{Declared, Fed, MAX_AXES, MotorCommand};
use super::transport::{FRAME_MAX, Frame, TransportError};
use super::velocity::VelocityWindow;
use super::{Capabilities, Device, DeviceError, Pacing};
use crate::rt::clock::monotonic_ns;
use crate::spatial::{DeviceSample, Pose, SampleStatus, Twist, Wrench};

/// Ticks with reports after an arm was opened in which a gap of its count is none: what came while nobody looked yet was not lost on the way. Two for
/// the backlog and the gap behind it, and some for what comes meanwhile.
const SETTLING: u32 = 4;
/// Reads of one tick: what a kernel queue of 64 reports can hold. More would let a chattering arm keep the loop.
const READS_MAX: usize = 64;
/// Ticks in a row in which the link takes no frame before the arm counts as lost: the time in which a silent one does.
const FULL_TICKS_MAX: u32 = 20;
/// How long a stop waits for the answer to its first zero command before it sends the second.
const STOP_PATIENCE: Duration = Duration::from_millis(3);
/// How long a link stays open after its last frame: bytes of a tty pass through a worker of the kernel, and a close may overtake them. An arm
/// that did not hear its zero would hold its force until its watchdog lets go.
const LINGER: Duration = Duration::from_millis(10);
/// Silence after which an arm that knows no frame to be woken with counts as having lost the command, s: the next one may go.
const REPLY_PATIENCE_S: f64 = 5e-3;
/// A rate input that sends nothing for so long is at rest, s: it sends on change only, and an unplugged one must not coast.
const RATE_INPUT_REST_S: f64 = 0.1;

/// Number of the gripper among the axes; its reading is the last one.
const GRIP_AXIS: usize = 6;

/// An open arm. RT: as [`Device`] asks.
pub struct WiredArm {
    connection: Connection,
    replacements: Option<Replacements>,
    parameters: WiredParameters,
    is_rate_input: bool,

    /// Newest configuration; the start of the next search for one.
    configuration: Configuration,
    joints: [f64; MAX_AXES],
    joint_rates: [f64; MAX_AXES],
    window: VelocityWindow,
    thermal: Thermal,
    round_trip: RoundTrip,
    last: DeviceSample,
    /// What the motors were last told, and what it amounts to.
    sent: MotorCommand,
    rendered: Wrench,

    n_reads: u64,
    start_ns: i64,
    last_report_s: f64,
    last_sent_s: f64,
    /// The arm owes a reply to the last frame.
    owes_reply: bool,
    full_ticks: u32,
    /// Nothing may be sent until then: the arm is to find the frames of a stream again.
    quiet_until_s: Option<f64>,
    /// It was quiet already since the last sound report.
    quiet_before: bool,
    /// Ticks that brought reports since this connection was made.
    heard: u32,
    /// Reports whose check held and that describe nothing that can be.
    refused: u64,
    enabled: bool,
    lost: bool,
    frame: Frame,
    buffer: [u8; FRAME_MAX],
}

impl WiredArm {
    /// An arm over a connection that has been started. RT: start-up only.
    pub(super) fn new(connection: Connection, replacements: Option<Replacements>, parameters: WiredParameters) -> Self {
        let [window_linear_s, window_angular_s] = parameters.velocity_window_s;
        let home = parameters.kinematics.home();
        let configuration = parameters.kinematics.solve(&home, &Configuration::default()).unwrap_or_default();
        let is_rate_input = matches!(parameters.kinematics, Kinematics::Rate(_));
        Self {
            round_trip: connection.round_trip(&parameters),
            connection,
            replacements,
            is_rate_input,
            configuration,
            joints: home,
            joint_rates: [0.0; MAX_AXES],
            window: VelocityWindow::new(window_linear_s, window_angular_s, parameters.period_s),
            thermal: parameters.thermal,
            // A rate input has no zero, and says nothing before it is moved.
            last: DeviceSample { homed: is_rate_input, ..DeviceSample::default() },
            sent: MotorCommand::default(),
            rendered: Wrench::ZERO,
            n_reads: 0,
            start_ns: monotonic_ns(),
            last_report_s: 0.0,
            last_sent_s: 0.0,
            owes_reply: false,
            full_ticks: 0,
            quiet_until_s: None,
            quiet_before: false,
            heard: 0,
            refused: 0,
            enabled: false,
            lost: false,
            frame: Frame::default(),
            buffer: [0; FRAME_MAX],
            parameters,
        }
    }

    /// What the arm said of itself at the start, in one line for people. Cold.
    pub fn identity(&self) -> Option<String> {
        self.connection.codec.identity()
    }

    /// What it declared that it can do. Cold.
    pub fn declared(&self) -> Option<Declared> {
        self.connection.codec.declared()
    }

    /// Reports so far that were whole and described nothing that can be: they count as corrupt packets too.
    pub fn refused(&self) -> u64 {
        self.refused
    }

    fn now_s(&self) -> f64 {
        match self.parameters.timebase {
            Timebase::Monotonic => (monotonic_ns() - self.start_ns) as f64 * 1e-9,
            Timebase::Counted => self.n_reads as f64 * self.parameters.period_s,
        }
    }

    fn lose(&mut self) -> DeviceError {
        self.lost = true;
        self.owes_reply = false;
        self.rendered = Wrench::ZERO;
        self.sent = MotorCommand::default();
        if let Some(replacements) = &self.replacements {
            replacements.ask();
        }
        self.gone()
    }

    /// What a loss is called.
    fn gone(&self) -> DeviceError {
        if self.parameters.link_silence_s.is_some() { DeviceError::Link } else { DeviceError::Lost }
    }

    /// The network has said nothing for too long.
    fn is_silent(&self, now_s: f64) -> bool {
        self.parameters.link_silence_s.is_some_and(|silence_s| now_s - self.last_report_s >= silence_s)
    }

    /// Takes a new connection if the arm is back.
    fn is_back(&mut self) -> bool {
        let replacements = self.replacements.as_mut();
        if !replacements.is_some_and(|replacements| replacements.exchange(&mut self.connection)) {
            return false;
        }
        self.lost = false;
        self.full_ticks = 0;
        self.round_trip = self.connection.round_trip(&self.parameters);
        self.last_report_s = self.now_s();
        self.quiet_until_s = None;
        self.quiet_before = false;
        self.heard = 0;
        self.window.restart();
        true
    }

    /// Takes everything that has come.
    fn drain(&mut self) -> Result<Fed, TransportError> {
        let mut total = Fed::default();
        for _ in 0..READS_MAX {
            let n = self.connection.link.receive(&mut self.buffer)?;
            let Some(bytes) = self.buffer.get(..n).filter(|bytes| !bytes.is_empty()) else { break };
            total += self.connection.codec.feed(bytes);
        }
        Ok(total)
    }

    /// What the newest report makes of the sample; false when it describes a grip that cannot be.
    fn take_report(&mut self, now_s: f64) -> bool {
        let report = *self.connection.codec.newest();
        if !report.readings.iter().all(|reading| reading.is_finite()) {
            // Not a garbled packet but an arm that says so: the tick judges it.
            self.last.pose.translation = DVec3::NAN;
            return true;
        }
        let q = self.parameters.device_from_native;
        let joints = self.parameters.transmission.angles(&report.readings);
        if let Some(asked_for) = self.parameters.kinematics.rate_twist(&joints) {
            self.last.twist = turned(q, asked_for);
        } else {
            let Some(configuration) = self.parameters.kinematics.solve(&joints, &self.configuration) else { return false };
            self.configuration = configuration;
            self.joints = joints;
            self.last.pose = self.device_pose();
            let measured = self.window.push(now_s, self.last.pose);
            self.last.twist = match report.rates {
                Some(rates) => {
                    self.joint_rates = self.parameters.transmission.rates(&rates);
                    turned(q, configuration.twist(&self.joint_rates))
                }
                None => measured,
            };
        }
        self.last.buttons = report.buttons;
        self.last.homed = report.homed.unwrap_or(true);
        self.last.device_error = u16::try_from(report.error).unwrap_or(u16::MAX);
        if self.parameters.capabilities.sensed.has(GRIP_AXIS) {
            self.last.grip_rad = report.readings.last().copied().unwrap_or(0.0);
        }
        true
    }

    /// Grip in the device frame; the identity where the orientation is not sensed. The grip's own axes are those of the device frame at the native
    /// identity, so a turn about a native axis is one about the device axis of the same direction.
    fn device_pose(&self) -> Pose {
        let q = self.parameters.device_from_native;
        let native = self.configuration.native_from_grip;
        let senses_rotation = (3..6).any(|axis_idx| self.parameters.capabilities.sensed.has(axis_idx));
        let rotation = if senses_rotation { (q * native.rotation * q.conjugate()).normalize() } else { DQuat::IDENTITY };
        Pose::new(rotation, q * native.translation)
    }

    /// A rate input moves the grip by what it says, for as long as it says it.
    fn coast(&mut self, now_s: f64) {
        if now_s - self.last_report_s > RATE_INPUT_REST_S {
            self.last.twist = Twist::ZERO;
        }
        let period_s = self.parameters.period_s;
        self.last.pose = self.last.pose.stepped(self.last.twist.linear * period_s, self.last.twist.angular * period_s);
        self.last.sequence += 1;
        self.last.status = SampleStatus::Fresh;
    }

    /// Motor commands for a wrench, and the wrench that is left of it.
    fn motors_for(&self, wrench_device: &Wrench) -> (MotorCommand, Wrench) {
        let parameters = &self.parameters;
        let actuated = parameters.capabilities.actuated;
        let projected = wrench_device.limited_to(actuated, parameters.force_limit_n, parameters.torque_limit_nm);
        let native_from_device = parameters.device_from_native.conjugate();
        let native = Wrench::new(native_from_device * projected.force, native_from_device * projected.torque);
        let torques = self.configuration.torques(&native);
        let extra =
            if self.enabled { parameters.kinematics.extra_torques(&self.joints, &self.joint_rates) } else { [0.0; MAX_AXES] };
        let (motors, scale) = parameters.transmission.commands(&torques, &extra);
        (MotorCommand { motors, enabled: self.enabled }, projected * scale)
    }

    fn send(&mut self, command: MotorCommand, rendered: Wrench, now_s: f64) -> Result<(), DeviceError> {
        self.frame.clear();
        self.connection.codec.encode(&command, &mut self.frame);
        if self.frame.is_empty() {
            return Ok(());
        }
        match self.connection.link.send(self.frame.as_slice()) {
            Ok(()) => {
                self.full_ticks = 0;
                self.sent = command;
                self.rendered = rendered;
                self.last_sent_s = now_s;
                self.owes_reply = true;
                self.round_trip.sent(self.n_reads);
                Ok(())
            }
            Err(TransportError::Full) if self.full_ticks < FULL_TICKS_MAX => {
                self.full_ticks += 1;
                Ok(())
            }
            Err(_) => Err(self.lose()),
        }
    }

    /// True while nothing may be sent, because the protocol has no frame marks and has to be left alone until its stream is empty.
    fn is_quiet(&mut self, now_s: f64) -> Result<bool, DeviceError> {
        if let Some(until_s) = self.quiet_until_s {
            if now_s < until_s {
                return Ok(true);
            }
            self.quiet_until_s = None;
            self.connection.codec.resume();
            self.send(MotorCommand::default(), Wrench::ZERO, now_s)?;
            return Ok(true);
        }
        let Some(silence) = self.connection.codec.silence() else { return Ok(false) };
        if self.quiet_before {
            return Err(self.lose());
        }
        self.quiet_before = true;
        // Whatever made it lose them was a packet.
        self.last.corrupt_packets = self.last.corrupt_packets.max(1);
        self.quiet_until_s = Some(now_s + silence.as_secs_f64());
        Ok(true)
    }

    /// Wakes an arm that has been silent for too long.
    fn kick_if_silent(&mut self, now_s: f64) {
        let Some(kick_s) = self.parameters.kick_s else { return };
        if now_s - self.last_report_s.max(self.last_sent_s) < kick_s {
            return;
        }
        self.frame.clear();
        if self.connection.codec.kick(&mut self.frame) && self.connection.link.send(self.frame.as_slice()).is_ok() {
            self.last_sent_s = now_s;
            self.owes_reply = true;
            self.sent = MotorCommand::default();
            self.rendered = Wrench::ZERO;
        }
    }
}

impl Device for WiredArm {
    fn capabilities(&self) -> Capabilities {
        let Connection { link, codec } = &self.connection;
        let capabilities = self.parameters.capabilities;
        Capabilities { io: link.io(), watchdog_ms: codec.watchdog_ms().or(capabilities.watchdog_ms), ..capabilities }
    }

    fn read(&mut self) -> Result<DeviceSample, DeviceError> {
        self.n_reads += 1;
        if self.lost && !self.is_back() {
            return Err(self.gone());
        }
        let now_s = self.now_s();
        if self.n_reads == 1 {
            // Whatever passed since the arm was opened is nobody's silence.
            self.last_report_s = now_s;
        }
        self.connection.codec.tell_time(now_s);
        let mut fed = match self.drain() {
            Ok(fed) => fed,
            Err(_) => return Err(self.lose()),
        };
        if self.heard < SETTLING && fed.reports > 0 {
            self.heard += 1;
            fed.gap = 0;
        }
        self.refused += u64::from(fed.refused);
        self.last.status = SampleStatus::Stale;
        self.last.corrupt_packets = u16::try_from(fed.corrupt).unwrap_or(u16::MAX);
        self.last.lost_packets = u16::try_from(fed.gap).unwrap_or(u16::MAX);
        if self.is_quiet(now_s)? {
            return Ok(self.last);
        }
        if fed.corrupt > 0 {
            // Garbled, but an answer: the next command may go.
            self.owes_reply = false;
        }
        if fed.reports > 0 {
            self.owes_reply = false;
            self.quiet_before = false;
            self.last_report_s = now_s;
            let codec = &self.connection.codec;
            let behind = codec.newest().echo.zip(codec.sequence()).map(|(echo, sequence)| sequence.wrapping_sub(echo));
            self.round_trip.received(self.n_reads, behind);
            self.last.delay_ticks = self.round_trip.ticks();
            if self.take_report(now_s) {
                // A rate input has a sample of its own in every tick.
                if !self.is_rate_input {
                    self.last.sequence += 1;
                    self.last.status = SampleStatus::Fresh;
                }
            } else {
                self.refused += 1;
                self.last.corrupt_packets = self.last.corrupt_packets.saturating_add(1);
            }
        } else if fed.corrupt == 0 {
            self.kick_if_silent(now_s);
        }
        if self.is_silent(now_s) {
            return Err(self.lose());
        }
        if self.connection.codec.is_cut() {
            return Err(DeviceError::Link);
        }
        if self.is_rate_input {
            self.coast(now_s);
        }
        self.last.overheated = self.thermal.advance(&self.sent.motors, self.parameters.period_s);
        Ok(self.last)
    }

    fn write(&mut self, wrench_device: &Wrench) -> Result<Wrench, DeviceError> {
        if self.lost {
            return Err(self.gone());
        }
        let now_s = self.now_s();
        self.connection.codec.tell_time(now_s);
        let finite = wrench_device.is_finite();
        let (command, rendered) = if finite { self.motors_for(wrench_device) } else { (MotorCommand::default(), Wrench::ZERO) };
        // One command in flight, but for the one that takes force away: it never waits for a reply that may be lost.
        let waits = self.parameters.capabilities.pacing == Pacing::PingPong && self.owes_reply;
        let takes_force_away = command.motors == [0.0; MAX_AXES] && self.sent.motors != [0.0; MAX_AXES];
        let given_up = now_s - self.last_sent_s >= self.parameters.kick_s.unwrap_or(REPLY_PATIENCE_S);
        let may_send = self.quiet_until_s.is_none() && (!waits || takes_force_away || given_up);
        if may_send {
            self.send(command, rendered, now_s)?;
        }
        if finite { Ok(self.rendered) } else { Err(DeviceError::NonFinite) }
    }

    fn set_enabled(&mut self, enabled: bool) {
        self.enabled = enabled;
    }

    fn stop(&mut self) {
        self.enabled = false;
        for turn in 0..2 {
            self.frame.clear();
            self.connection.codec.encode(&MotorCommand::default(), &mut self.frame);
            let sent = self.connection.link.send(self.frame.as_slice()).is_ok();
            if turn == 0 && sent && self.parameters.capabilities.pacing == Pacing::PingPong {
                // Arms without a frame mark read a second command as part of the first one until they have answered.
                let begin_ns = monotonic_ns();
                while (monotonic_ns() - begin_ns) < STOP_PATIENCE.as_nanos() as i64 {
                    match self.drain() {
                        Ok(fed) if fed.reports == 0 => std::thread::sleep(Duration::from_micros(100)),
                        _ => break,
                    }
                }
            }
        }
        self.sent = MotorCommand::default();
        self.rendered = Wrench::ZERO;
    }
}

impl Drop for WiredArm {
    fn drop(&mut self) {
        self.stop();
        let Connection { link, codec } = &mut self.connection;
        codec.finish(link);
        std::thread::sleep(LINGER);
    }
}

fn turned(q: DQuat, twist: Twist) -> Twist {
    Twist { linear: q * twist.linear, angular: q * twist.angular }
}

#[cfg(test)]
mod tests;
