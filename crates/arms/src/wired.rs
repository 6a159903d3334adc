//! The driver of every arm with a wire protocol: transport, protocol, transmission and kinematics
//! put together.
//!
//! ```text
//!  read    link ─► codec ─► readings ─► transmission ─► joint angles ─► kinematics ─► pose, twist (device axes)
//!  write   wrench ─► motor stage (limits, Jᵀ, what is beside the wrench, transmission) ─► codec ─► link
//! ```
//!
//! What is not decided here: whether force may flow. The tick does that from what a sample says
//! (homing, lost and corrupt packets, errors of the arm, hot motors). This layer only repeats the
//! hard limits of the profile, because it is the last code before the motors (devices reference,
//! section 3.4).

mod arm_limits;
mod connection;
mod round_trip;

use core::time::Duration;

use glam::{DQuat, DVec3};

use self::arm_limits::ArmLimits;
pub(super) use self::arm_limits::{judge_declared, lower};
pub(super) use self::connection::{Connection, Replacements};
pub(super) use self::round_trip::RoundTrip;
use super::axes::MAX_AXES;
use super::kinematics::{Configuration, Kinematics};
use super::motor_stage::{Motion, MotorCommand, MotorStage, MotorWrenches};
use super::parameters::{Timebase, WiredParameters};
use super::protocol::{DeclaredLimits, FeedCounts};
use super::thermal::Thermal;
use super::transport::{FRAME_MAX, Frame, TransportError};
use super::velocity::VelocityWindow;
use super::{Capabilities, Device, DeviceError, IoPlacement, Pacing};
use rt::clock::elapsed_ns;
use vps::spatial::{DeviceSample, Pose, SampleStatus, Twist, Wrench};

/// Ticks with reports after an arm was opened in which a gap of its count is none: what came before
/// the first read was not lost on the way. Two for the backlog and the gap behind it, and some for
/// what comes meanwhile.
const SETTLING: u32 = 4;
/// Reads of one tick: what a kernel queue of 64 reports can hold. More would let a chattering arm
/// keep the loop.
const READS_MAX: usize = 64;
/// The same of a tick after a stall: more than a tty holds, 68 KiB.
const READS_AFTER_STALL: usize = 512;
/// Time between two reads after which the host was asleep, s, and in periods: what lies in the
/// queues is where the arm was, not where it is.
const STALL_S: f64 = 20e-3;
const STALL_TICKS: f64 = 4.0;
/// How long after a stall a thread of the link may still bring what came before, s.
const BACKLOG_S: f64 = 5e-3;
/// Silence after which an arm counts as lost, s, and in kicks: it is looked for again.
const DEAF_S: f64 = 0.5;
const DEAF_KICKS: f64 = 4.0;
/// How long an arm may receive nothing while it sends until its samples count as stale, s. What is
/// sent in this time is also the most that may lie unread before the arm counts as lost.
const UNHEARD_S: f64 = 20e-3;
/// How long force may go on without a look of the guard, s, counted in ticks: within 200 ms where ten
/// of them are missed.
const UNWATCHED_S: f64 = 0.19;
/// Ticks in a row in which the link takes no frame before the arm counts as lost: the time in which
/// a silent one does.
const FULL_TICKS_MAX: u32 = 20;
/// How long a stop waits for the answer to its first zero command before it sends the second.
const STOP_PATIENCE: Duration = Duration::from_millis(3);
/// Silence after which an arm that knows no frame to be woken with counts as having lost the
/// command, s: the next one may go.
const REPLY_PATIENCE_S: f64 = 5e-3;
/// A rate input that sends nothing for so long is at rest, s: it sends on change only, and an
/// unplugged one must not coast.
const RATE_INPUT_REST_S: f64 = 0.1;

/// Number of the gripper among the axes; its reading is the last one.
const GRIP_AXIS: usize = 6;

/// An open arm. RT: as [`Device`] asks.
pub struct WiredArm {
    /// `None`: the arm is lost, and its connection is with the reconnect thread.
    connection: Option<Connection>,
    replacements: Replacements,
    /// Of the connection that is, or was last.
    io: IoPlacement,
    /// Of the profile; those in `parameters` hold, the lower of these and of what the arm declares.
    of_profile: ArmLimits,
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
    /// What the motors were last reported, and what it amounts to.
    sent: MotorCommand,
    rendered: Wrench,
    /// What it makes beside the command.
    beside: Wrench,
    stage: MotorStage,

    n_reads: u64,
    start_ns: i64,
    last_read_s: f64,
    /// Reports up to then may be older than a stall of this machine.
    old_until_s: Option<f64>,
    last_report_s: f64,
    /// When the arm last said that it receives, where it says so.
    last_heard_s: f64,
    last_sent_s: f64,
    /// The arm owes a reply to the last frame.
    owes_reply: bool,
    full_ticks: u32,
    /// Nothing may be sent until then: the arm is to find the frames of a stream again.
    quiet_until_s: Option<f64>,
    /// Half a reply was found when a command was due: the next read counts it as a packet.
    spoilt: bool,
    /// It was quiet already since the last sound report.
    quiet_before: bool,
    /// Ticks that brought reports since this connection was made.
    heard: u32,
    /// Reports whose check held and that describe nothing that can be.
    refused: u64,
    enabled: bool,
    frame: Frame,
    buffer: [u8; FRAME_MAX],
}

impl WiredArm {
    /// An arm over a connection that has been started. RT: start-up only.
    pub(super) fn new(
        connection: Connection,
        replacements: Replacements,
        mut parameters: WiredParameters,
    ) -> Self {
        let [window_linear_s, window_angular_s] = parameters.velocity_window_s;
        let home = parameters.kinematics.home();
        let configuration =
            parameters.kinematics.solve(&home, &Configuration::default()).unwrap_or_default();
        let is_rate_input = matches!(parameters.kinematics, Kinematics::Rate(_));
        let of_profile = ArmLimits::of(&parameters);
        parameters.hold_to(of_profile.lowered_by(&*connection.codec));
        Self {
            round_trip: connection.round_trip(&parameters),
            io: connection.link.io(),
            of_profile,
            connection: Some(connection),
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
            beside: Wrench::ZERO,
            stage: MotorStage::default(),
            n_reads: 0,
            start_ns: elapsed_ns(),
            last_read_s: 0.0,
            old_until_s: None,
            last_report_s: 0.0,
            last_heard_s: 0.0,
            last_sent_s: 0.0,
            owes_reply: false,
            full_ticks: 0,
            quiet_until_s: None,
            spoilt: false,
            quiet_before: false,
            heard: 0,
            refused: 0,
            enabled: false,
            frame: Frame::default(),
            buffer: [0; FRAME_MAX],
            parameters,
        }
    }

    /// What the arm said of itself at the start, in one line for people. Cold.
    pub fn identity(&self) -> Option<String> {
        self.connection.as_ref()?.codec.identity()
    }

    /// What it said that a person should know before force flows. Cold.
    pub fn notice(&self) -> Option<String> {
        self.connection.as_ref()?.codec.notice()
    }

    /// What it declared that it can do. Cold.
    pub fn declared(&self) -> Option<DeclaredLimits> {
        self.connection.as_ref()?.codec.declared()
    }

    /// Reports so far that were whole and described nothing that can be: they count as corrupt
    /// packets too.
    pub fn refused(&self) -> u64 {
        self.refused
    }

    fn ticks_of(&self, time_s: f64) -> u32 {
        (time_s / self.parameters.period_s).ceil() as u32
    }

    fn now_s(&self) -> f64 {
        match self.parameters.timebase {
            Timebase::Monotonic => (elapsed_ns() - self.start_ns) as f64 * 1e-9,
            Timebase::Counted => self.n_reads as f64 * self.parameters.period_s,
        }
    }

    /// Sends the arm zero while that still may reach it, and lets go of it: the reconnect thread
    /// sends it again, closes the link, and only then opens it anew.
    fn lose(&mut self) -> DeviceError {
        if let Some(mut connection) = self.connection.take() {
            // Most losses are a plug that is out.
            let _ = connection.send_last_zero();
            self.connection = self.replacements.give_away(connection);
        }
        self.owes_reply = false;
        self.rendered = Wrench::ZERO;
        self.sent = MotorCommand::default();
        self.gone()
    }

    /// What a loss is called.
    fn gone(&self) -> DeviceError {
        if self.parameters.link_silence_s.is_some() { DeviceError::Link } else { DeviceError::Lost }
    }

    /// The network has said nothing for too long.
    fn is_silent(&self, now_s: f64) -> bool {
        self.parameters
            .link_silence_s
            .is_some_and(|silence_s| now_s - self.last_report_s >= silence_s)
    }

    /// The arm sends nothing any more, or receives nothing. One that sends on change only may be
    /// silent for any time; an arm behind a network has a rule of its own.
    fn is_deaf(&self, now_s: f64) -> bool {
        let parameters = &self.parameters;
        if parameters.link_silence_s.is_some() || parameters.capabilities.pacing == Pacing::Event {
            return false;
        }
        let deaf_s = DEAF_S.max(DEAF_KICKS * parameters.kick_s.unwrap_or(0.0));
        now_s - self.last_report_s >= deaf_s
            || self.unheard_s(now_s).is_some_and(|unheard_s| unheard_s >= deaf_s)
    }

    /// Time for which the arm has not said that it receives, where it says so.
    fn unheard_s(&self, now_s: f64) -> Option<f64> {
        self.connection.as_ref()?.codec.unheard()?;
        Some(now_s - self.last_heard_s)
    }

    /// Takes a new connection if the arm is back.
    fn is_back(&mut self) -> bool {
        let Some(connection) = self.replacements.take() else { return false };
        self.io = connection.link.io();
        self.parameters.hold_to(self.of_profile.lowered_by(&*connection.codec));
        self.round_trip = connection.round_trip(&self.parameters);
        self.connection = Some(connection);
        self.full_ticks = 0;
        self.last_report_s = self.now_s();
        self.last_heard_s = self.last_report_s;
        self.quiet_until_s = None;
        self.quiet_before = false;
        self.heard = 0;
        self.window.restart();
        true
    }

    /// Notes a stall of this machine: what came meanwhile describes the past, and its gaps are no
    /// loss of the link.
    fn note_stall(&mut self, now_s: f64) {
        let stall_s = STALL_S.max(STALL_TICKS * self.parameters.period_s);
        let since_s = now_s - self.last_read_s;
        let is_stall = self.n_reads > 1 && since_s > stall_s;
        self.last_read_s = now_s;
        if is_stall {
            // The host said nothing meanwhile: the silence of the arm counts no longer than up to
            // the stall. That of a network does.
            self.last_heard_s += since_s - stall_s;
            if self.parameters.link_silence_s.is_none() {
                self.last_report_s += since_s - stall_s;
            }
            // A link of the loop's own is empty after this read, one with threads may bring more.
            self.old_until_s =
                Some(if self.io == IoPlacement::OwnThread { now_s + BACKLOG_S } else { now_s });
            self.heard = 0;
        }
    }

    /// Takes everything that has come, `reads` times at most; whether it was everything.
    fn drain(&mut self, reads: usize) -> Result<(FeedCounts, bool), TransportError> {
        let mut total = FeedCounts::default();
        let Some(connection) = &mut self.connection else { return Err(TransportError::Lost) };
        // One more look: whether that was all.
        for _ in 0..=reads {
            let n = connection.link.receive(&mut self.buffer)?;
            let Some(bytes) = self.buffer.get(..n).filter(|bytes| !bytes.is_empty()) else {
                return Ok((total, true));
            };
            total += connection.codec.feed(bytes);
        }
        Ok((total, false))
    }

    /// What the newest report makes of the sample; false when it describes a grip that cannot be.
    fn take_report(&mut self, now_s: f64) -> bool {
        let Some(connection) = &self.connection else { return false };
        let report = *connection.codec.newest();
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
            let Some(configuration) =
                self.parameters.kinematics.solve(&joints, &self.configuration)
            else {
                return false;
            };
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

    /// Grip in the device frame; the identity where the orientation is not sensed. The grip's own
    /// axes are those of the device frame at the native identity, so a turn about a native axis is
    /// one about the device axis of the same direction.
    fn device_pose(&self) -> Pose {
        let q = self.parameters.device_from_native;
        let native = self.configuration.native_from_grip;
        let senses_rotation =
            (3..6).any(|axis_idx| self.parameters.capabilities.sensed.has(axis_idx));
        let rotation = if senses_rotation {
            (q * native.rotation * q.conjugate()).normalize()
        } else {
            DQuat::IDENTITY
        };
        Pose::new(rotation, q * native.translation)
    }

    /// A rate input moves the grip by what it says, for as long as it says it.
    fn coast(&mut self, now_s: f64) {
        if now_s - self.last_report_s > RATE_INPUT_REST_S {
            self.last.twist = Twist::ZERO;
        }
        let period_s = self.parameters.period_s;
        self.last.pose = self
            .last
            .pose
            .stepped(self.last.twist.linear * period_s, self.last.twist.angular * period_s);
        self.last.sequence += 1;
        self.last.status = SampleStatus::Fresh;
    }

    /// Commands may lie in a queue that the arm does not read: the arm is silent, or receives
    /// nothing, or nothing would show it.
    fn may_lie_unread(&self, now_s: f64) -> bool {
        let is_unheard = match self.unheard_s(now_s) {
            Some(unheard_s) => unheard_s > REPLY_PATIENCE_S,
            None => self.parameters.capabilities.pacing == Pacing::Stream,
        };
        is_unheard || self.full_ticks > 0 || now_s - self.last_report_s > REPLY_PATIENCE_S
    }

    fn send(
        &mut self,
        mut command: MotorCommand,
        mut made: MotorWrenches,
        now_s: f64,
    ) -> Result<(), DeviceError> {
        let takes_force_away = command.moves_nothing() && !self.sent.moves_nothing();
        let may_lie_unread = self.may_lie_unread(now_s);
        let most_unread = self.ticks_of(UNHEARD_S);
        let Some(connection) = &mut self.connection else { return Err(self.gone()) };
        // Whatever it says meanwhile: an arm that wakes obeys what it has not read.
        if connection.link.unread() > most_unread as usize {
            return Err(self.lose());
        }
        self.frame.clear();
        connection.codec.encode(&command, &mut self.frame);
        if self.frame.is_empty() {
            // Half a reply is known for one when the next command is due.
            if connection.codec.silence().is_some() {
                self.spoilt = true;
                return self.fall_silent(now_s);
            }
            return Ok(());
        }
        if self.owes_reply && (may_lie_unread || command.moves_nothing()) {
            let mut zero = Frame::default();
            connection.codec.zero_out_of_step(&mut zero);
            if !zero.is_empty() {
                (self.frame, command, made) =
                    (zero, MotorCommand::default(), MotorWrenches::default());
            }
        }
        let is_zero = command.moves_nothing();
        // Not in every tick: on a slow line each would take the place of the one before, and none
        // would ever arrive.
        let may_arrive = now_s - self.last_sent_s >= REPLY_PATIENCE_S;
        let replaces =
            is_zero && may_lie_unread && (takes_force_away || self.owes_reply && may_arrive);
        let mut result = if replaces {
            connection.link.send_now(self.frame.as_slice())
        } else {
            connection.link.send(self.frame.as_slice())
        };
        if is_zero && result == Err(TransportError::Full) {
            result = connection.link.send_now(self.frame.as_slice());
        }
        match result {
            Ok(()) => {
                self.full_ticks = 0;
                self.sent = command;
                // Only what left counts: a command that found the queue full must not widen the
                // step of the next one.
                self.stage.went_out();
                (self.rendered, self.beside) = (made.command, made.beside);
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

    /// True while nothing may be sent, because the protocol has no frame marks and has to be left
    /// alone until its stream is empty.
    fn is_quiet(&mut self, now_s: f64) -> Result<bool, DeviceError> {
        let Some(connection) = &mut self.connection else { return Err(self.gone()) };
        if let Some(until_s) = self.quiet_until_s {
            if now_s < until_s {
                return Ok(true);
            }
            self.quiet_until_s = None;
            connection.codec.resume();
            // Nothing was asked meanwhile.
            self.last_report_s = now_s;
            self.send(MotorCommand::default(), MotorWrenches::default(), now_s)?;
            return Ok(true);
        }
        if connection.codec.silence().is_none() {
            return Ok(false);
        }
        self.fall_silent(now_s)?;
        // Whatever made it lose them was a packet.
        self.last.corrupt_packets = self.last.corrupt_packets.max(1);
        Ok(true)
    }

    /// Begins the silence in which a stream finds its frames again, with a zero: the last command
    /// would stay on all the while.
    fn fall_silent(&mut self, now_s: f64) -> Result<(), DeviceError> {
        let Some(connection) = &mut self.connection else { return Err(self.gone()) };
        let Some(silence) = connection.codec.silence() else { return Ok(()) };
        if self.quiet_before {
            return Err(self.lose());
        }
        connection.zero(false, &mut self.frame);
        let result = if self.frame.is_empty() {
            Ok(())
        } else {
            connection.link.send_now(self.frame.as_slice())
        };
        if matches!(result, Err(TransportError::Lost | TransportError::Os(_))) {
            return Err(self.lose());
        }
        self.sent = MotorCommand::default();
        self.rendered = Wrench::ZERO;
        self.owes_reply = false;
        self.quiet_before = true;
        self.quiet_until_s = Some(now_s + silence.as_secs_f64());
        Ok(())
    }

    /// Wakes an arm that has been silent for too long.
    fn kick_if_silent(&mut self, now_s: f64) {
        let (Some(kick_s), Some(connection)) = (self.parameters.kick_s, &mut self.connection)
        else {
            return;
        };
        if now_s - self.last_report_s.max(self.last_sent_s) < kick_s {
            return;
        }
        self.frame.clear();
        if connection.codec.kick(&mut self.frame)
            && connection.link.send_now(self.frame.as_slice()).is_ok()
        {
            self.last_sent_s = now_s;
            self.owes_reply = true;
            self.sent = MotorCommand::default();
            self.rendered = Wrench::ZERO;
        }
    }
}

impl Device for WiredArm {
    fn capabilities(&self) -> Capabilities {
        Capabilities { io: self.io, ..self.parameters.capabilities }
    }

    fn read(&mut self) -> Result<DeviceSample, DeviceError> {
        self.n_reads += 1;
        let now_s = self.now_s();
        self.note_stall(now_s);
        if self.connection.is_none() && !self.is_back() {
            return Err(self.gone());
        }
        if self.n_reads == 1 {
            // The time since the arm was opened is no silence of the arm.
            self.last_report_s = now_s;
            self.last_heard_s = now_s;
        }
        if let Some(connection) = &mut self.connection {
            connection.codec.tell_time(now_s);
        }
        let reads = if self.old_until_s.is_some() { READS_AFTER_STALL } else { READS_MAX };
        let Ok((mut fed, is_all)) = self.drain(reads) else { return Err(self.lose()) };
        if self.connection.as_ref().is_some_and(|connection| connection.codec.unheard() == Some(0))
        {
            self.last_heard_s = now_s;
        }
        // What lay in a queue says where the arm was, the next report says where it is. One that
        // sends on change only has sent its current state.
        let may_be_old = self.parameters.capabilities.pacing != Pacing::Event;
        let is_old =
            may_be_old && (!is_all || self.old_until_s.is_some_and(|until_s| now_s <= until_s));
        if !is_old {
            self.old_until_s = None;
        }
        if self.heard < SETTLING && fed.reports > 0 {
            self.heard += 1;
            fed.gap = 0;
        }
        fed.corrupt += u32::from(core::mem::take(&mut self.spoilt));
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
            let newest = self
                .connection
                .as_ref()
                .map(|connection| (connection.codec.newest().echo, connection.codec.sequence()));
            let behind = newest
                .and_then(|(echo, sequence)| echo.zip(sequence))
                .map(|(echo, sequence)| sequence.wrapping_sub(echo));
            if !is_old {
                self.round_trip.received(self.n_reads, behind);
            }
            self.last.delay_ticks = self.round_trip.ticks();
            let is_unheard = self.unheard_s(now_s).is_some_and(|unheard_s| unheard_s >= UNHEARD_S);
            if is_old || is_unheard {
                self.window.restart();
            } else if self.take_report(now_s) {
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
        if self.is_silent(now_s) || self.is_deaf(now_s) {
            return Err(self.lose());
        }
        if self.connection.as_ref().is_some_and(|connection| connection.codec.is_cut()) {
            return Err(DeviceError::Link);
        }
        if self.is_rate_input {
            self.coast(now_s);
        }
        self.last.overheated = self.thermal.advance(self.sent.motors(), self.parameters.period_s);
        Ok(self.last)
    }

    fn write(&mut self, wrench_device: &Wrench) -> Result<Wrench, DeviceError> {
        if let Some(connection) = &mut self.connection
            && connection.has_guard_acted()
        {
            // What was computed before that goes nowhere; and a frame that a thread of the link
            // still held may have come after the guard's zero.
            let reported = connection.send_last_zero();
            self.sent = MotorCommand::default();
            self.rendered = Wrench::ZERO;
            self.stage.begin();
            return Err(if reported.is_ok() || reported == Err(TransportError::Full) {
                DeviceError::Stalled
            } else {
                self.lose()
            });
        }
        let now_s = self.now_s();
        let most_unwatched = self.ticks_of(UNWATCHED_S);
        let Some(connection) = &mut self.connection else { return Err(self.gone()) };
        let is_unwatched = connection.is_unwatched(most_unwatched);
        connection.codec.tell_time(now_s);
        let motion = Motion {
            configuration: &self.configuration,
            joints: &self.joints,
            rates: &self.joint_rates,
            twist: self.last.twist,
        };
        let (command, made) = self.stage.command(
            &self.parameters,
            &motion,
            wrench_device,
            self.enabled,
            self.sent.moves_nothing(),
        );
        if is_unwatched && !command.moves_nothing() {
            return Err(self.lose());
        }
        // One command in flight, but for the one that takes force away: it never waits for a reply
        // that may be lost.
        let waits = self.parameters.capabilities.pacing == Pacing::PingPong && self.owes_reply;
        let takes_force_away = command.moves_nothing() && !self.sent.moves_nothing();
        let given_up =
            now_s - self.last_sent_s >= self.parameters.kick_s.unwrap_or(REPLY_PATIENCE_S);
        let may_send = self.quiet_until_s.is_none() && (!waits || takes_force_away || given_up);
        if may_send {
            if !command.moves_nothing() {
                // The guard hears of a force before the arm does.
                connection.beat(true);
            }
            self.send(command, made, now_s)?;
        }
        let has_force = !self.sent.moves_nothing();
        if let Some(connection) = &mut self.connection {
            connection.beat(has_force);
        }
        if wrench_device.is_finite() { Ok(self.rendered) } else { Err(DeviceError::NonFinite) }
    }

    fn beside_device(&self) -> Wrench {
        if self.sent.moves_nothing() { Wrench::ZERO } else { self.beside }
    }

    fn set_enabled(&mut self, enabled: bool) {
        self.enabled = enabled;
        self.stage.begin();
    }

    fn doubt_signs(&mut self, doubted: bool) {
        self.stage.doubt_signs(doubted);
    }

    fn stop(&mut self) {
        self.enabled = false;
        let now_s = self.now_s();
        let mut in_step = !self.owes_reply;
        let replaces = self.may_lie_unread(now_s);
        for turn in 0..2 {
            let Some(connection) = &mut self.connection else { break };
            connection.zero(in_step, &mut self.frame);
            let frame = self.frame.as_slice();
            let mut result = if replaces && turn == 0 {
                connection.link.send_now(frame)
            } else {
                connection.link.send(frame)
            };
            if result == Err(TransportError::Full) {
                result = connection.link.send_now(frame);
            }
            if turn == 0
                && result.is_ok()
                && self.parameters.capabilities.pacing == Pacing::PingPong
            {
                // Arms without a frame mark read a second command as part of the first one until
                // they have answered.
                in_step = false;
                let begin_ns = elapsed_ns();
                while !in_step && (elapsed_ns() - begin_ns) < STOP_PATIENCE.as_nanos() as i64 {
                    match self.drain(READS_MAX) {
                        Ok((fed, _)) if fed.reports == 0 => {
                            std::thread::sleep(Duration::from_micros(100))
                        }
                        Ok(_) => in_step = true,
                        Err(_) => break,
                    }
                }
            }
        }
        self.sent = MotorCommand::default();
        self.rendered = Wrench::ZERO;
        if let Some(connection) = &mut self.connection {
            connection.beat(false);
        }
    }
}

impl Drop for WiredArm {
    fn drop(&mut self) {
        self.stop();
        if let Some(unused) = self.replacements.take() {
            unused.close();
        }
        match self.connection.take() {
            Some(connection) => connection.close(),
            // What was commanded to the lost one, and what holds its arm: a process must not outlive
            // the program.
            None => self.replacements.wait_for_end(),
        }
    }
}

fn turned(q: DQuat, twist: Twist) -> Twist {
    Twist { linear: q * twist.linear, angular: q * twist.angular }
}

#[cfg(test)]
mod tests;
