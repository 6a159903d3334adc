//! Plant, firmware and faults of a mock arm, period by period. Never looks at a clock: the caller
//! gives the time.

use std::collections::VecDeque;

use glam::DQuat;

use super::linkage::Linkage;
use super::tally::{MockReport, Tally};
use super::trace::TraceSample;
use crate::kinematics::Kinematics;
use crate::motor_stage::RISE_S;
use crate::profile::Plant;
use crate::protocol::{ArmReadings, Firmware, MAX_AXES, Outbox};
use crate::simulated::fault::{FaultKind, FaultPlan, JUMP_M};
use crate::simulated::{GripPlant, HandParameters, SimError, saturated};
use crate::split_mix::SplitMix64;
use crate::transmission::Transmission;
use vps::spatial::{Axes, Wrench};

/// What a mock arm is made of.
#[derive(Clone, Debug)]
pub struct MockParameters {
    /// Joint angles to grip.
    pub(crate) kinematics: Kinematics,
    /// Readings to joint angles, torques to commands.
    pub(crate) transmission: Transmission,
    /// From the frame of the kinematics to the device frame.
    pub(crate) device_from_native: DQuat,
    /// Axes that move.
    pub(crate) sensed: Axes,
    /// Axes with a motor.
    pub(crate) actuated: Axes,
    /// The host holds the weight of the links: it does once the signs are verified.
    pub(crate) is_compensated: bool,
    /// The grip.
    pub(crate) plant: Plant,
    /// The hand; its path counts from where the grip rests at the start. `None`: no hand holds it.
    pub(crate) hand: Option<HandParameters>,
    /// How long the hand waits where its path begins, from the host's first frame on, s.
    pub(crate) hand_delay_s: f64,
    /// One period, s.
    pub period_s: f64,
    /// Limits that a saturating motor falls short of: N and N·m.
    pub(crate) limits: (f64, f64),
    /// What goes wrong, as written and as read. Its time begins with the host's first frame.
    pub(crate) faults: Vec<(String, FaultPlan)>,
    /// Seed of everything random.
    pub(crate) seed: u64,
}

/// The mock arm.
pub struct MockArm {
    parameters: MockParameters,
    linkage: Linkage,
    plant: GripPlant,
    firmware: Box<dyn Firmware>,
    /// Share of the links' weight that is taken off what the motors make. It rises with the host's
    /// compensation.
    held: f64,
    readings: ArmReadings,
    stuck_at: Option<ArmReadings>,
    /// What `skip` has still to lose.
    skips: Option<u16>,
    random: SplitMix64,
    /// Wrenches under way from the firmware to the motors.
    delay_line: VecDeque<Wrench>,
    /// When the host first spoke, s of the caller's clock.
    first_frame_s: Option<f64>,
    /// Frames to be sent, each from its time on.
    outgoing: VecDeque<(f64, Vec<u8>)>,
    /// The frame that `reorder` lets the next one overtake.
    overtaken: Option<Vec<u8>>,
    answers: Outbox,
    tally: Tally,
}

impl MockArm {
    /// At rest at its home pose. Everything before the host's first frame happens at time 0.
    ///
    /// # Errors
    /// A plant or hand that cannot be simulated.
    pub fn new(parameters: MockParameters, firmware: Box<dyn Firmware>) -> Result<Self, SimError> {
        let MockParameters {
            kinematics, transmission, device_from_native, sensed, actuated, ..
        } = parameters;
        let linkage = Linkage::new(kinematics, transmission, device_from_native, actuated);
        let mut plant = GripPlant::new(
            parameters.period_s,
            &parameters.plant,
            parameters.hand.clone(),
            sensed,
        )?;
        plant.rest_at(linkage.pose());
        let mut arm = Self {
            readings: linkage.readings(),
            linkage,
            plant,
            firmware,
            held: 0.0,
            stuck_at: None,
            skips: parameters.faults.iter().find_map(|(_, plan)| match plan.kind {
                FaultKind::Skip { samples } => Some(samples),
                _ => None,
            }),
            random: SplitMix64::new(parameters.seed),
            delay_line: VecDeque::new(),
            first_frame_s: None,
            outgoing: VecDeque::new(),
            overtaken: None,
            answers: Outbox::new(),
            tally: Tally::default(),
            parameters,
        };
        arm.delay_line
            .extend(core::iter::repeat_n(Wrench::ZERO, arm.parameters.plant.delay_ticks as usize));
        Ok(arm)
    }

    /// Something goes wrong from now on.
    pub fn fail(&mut self, fault: FaultKind, name: &str, now_s: f64) {
        let plan = FaultPlan::from(fault, self.time_s(now_s));
        self.parameters.faults.push((name.to_owned(), plan));
    }

    /// True grip pose, `device_from_grip`.
    pub fn pose(&self) -> vps::spatial::Pose {
        self.plant.pose()
    }

    /// What its encoders say, not yet cut to the wire.
    pub fn readings(&self) -> &ArmReadings {
        &self.readings
    }

    /// What the firmware drives the motors with now, as in [`Firmware::motors`].
    pub fn motors(&self) -> [f64; MAX_AXES] {
        self.firmware.motors()
    }

    /// What motors that are driven with this would do to the grip where it is: device axes, at the
    /// grip point, the weight of the links included.
    pub fn wrench_of(&self, motors: &[f64; MAX_AXES]) -> Wrench {
        let mut linkage = self.linkage.clone();
        linkage.follow(self.plant.pose(), vps::spatial::Twist::ZERO, 1.0);
        linkage.wrench(motors, 0.0)
    }

    /// Time since the host's first frame, s; 0 before it.
    fn time_s(&self, now_s: f64) -> f64 {
        self.first_frame_s.map_or(0.0, |first_s| now_s - first_s)
    }

    fn has(&self, now_s: f64, wanted: impl Fn(&FaultKind) -> bool) -> Option<FaultKind> {
        let time_s = self.time_s(now_s);
        self.parameters
            .faults
            .iter()
            .filter_map(|(_, plan)| plan.active(time_s, self.parameters.period_s))
            .find(wanted)
    }

    /// True while the plug is out.
    pub(super) fn is_unplugged(&self, now_s: f64) -> bool {
        self.has(now_s, |kind| *kind == FaultKind::Unplug).is_some()
    }

    /// True while it receives nothing.
    pub(super) fn is_deaf(&self, now_s: f64) -> bool {
        self.has(now_s, |kind| *kind == FaultKind::Deaf).is_some()
    }

    /// How many faults there are now; a button that is held is none.
    pub(super) fn wrong(&self, now_s: f64) -> usize {
        let time_s = self.time_s(now_s);
        let period_s = self.parameters.period_s;
        let active = |plan: &FaultPlan| {
            plan.active(time_s, period_s)
                .is_some_and(|kind| !matches!(kind, FaultKind::Press { .. }))
        };
        self.parameters.faults.iter().filter(|(_, plan)| active(plan)).count()
    }

    /// Takes bytes of the host.
    pub fn receive(&mut self, bytes: &[u8], now_s: f64) {
        self.first_frame_s.get_or_insert(now_s);
        self.tally.frame(bytes.len(), now_s, self.parameters.period_s);
        self.skip(now_s, |firmware, readings, lost| firmware.receive(bytes, now_s, readings, lost));
        self.firmware.receive(bytes, now_s, &self.readings, &mut self.answers);
        self.post(now_s);
    }

    /// One period of the plant and of the firmware, which ends at `now_s`.
    pub fn advance(&mut self, now_s: f64) {
        let MockParameters { period_s, limits, .. } = self.parameters;
        let time_s = self.time_s(now_s);

        let was_on = is_on(&self.firmware.motors());
        self.skip(now_s, |firmware, readings, lost| firmware.advance(now_s, readings, lost));
        self.firmware.advance(now_s, &self.readings, &mut self.answers);
        let motors = self.firmware.motors();
        self.tally.report.watchdog_trips += u64::from(was_on && !is_on(&motors));

        let rising = if is_on(&motors) { self.held + period_s / RISE_S } else { 0.0 };
        self.held = if self.parameters.is_compensated { rising.min(1.0) } else { 0.0 };
        let commanded = self.linkage.wrench(&motors, self.held);
        self.tally.period(&commanded, &self.parameters.faults, time_s, period_s);
        self.delay_line.push_back(commanded);
        let mut felt = self.delay_line.pop_front().unwrap_or_default();
        if self.has(now_s, |kind| *kind == FaultKind::SignFlip).is_some() {
            felt = -felt;
        }
        if self.has(now_s, |kind| *kind == FaultKind::Saturate).is_some() {
            felt = saturated(&felt, limits.0, limits.1);
        }
        let hand_s = (time_s - self.parameters.hand_delay_s - period_s).max(0.0);
        self.plant
            .advance(if time_s > self.parameters.hand_delay_s { hand_s } else { -period_s }, &felt);
        let mut pose = self.plant.pose();
        if self.has(now_s, |kind| *kind == FaultKind::Jump).is_some() {
            pose.translation.x += JUMP_M;
        }
        self.linkage.follow(pose, self.plant.twist(), period_s);
        self.readings = self.linkage.readings();
        match self.has(now_s, |kind| matches!(kind, FaultKind::Stuck)) {
            Some(_) => self.readings = *self.stuck_at.get_or_insert(self.readings),
            None => self.stuck_at = None,
        }
        if self.has(now_s, |kind| *kind == FaultKind::Nan).is_some() {
            self.readings.readings[0] = f64::NAN;
        }
        if self.has(now_s, |kind| *kind == FaultKind::NoVelocity).is_some() {
            self.readings.rates = [0.0; MAX_AXES];
        }
        self.readings.homed = self.has(now_s, |kind| *kind == FaultKind::Unhome).is_none();
        self.readings.asleep = self.has(now_s, |kind| *kind == FaultKind::Sleep).is_some();
        self.readings.buttons =
            match self.has(now_s, |kind| matches!(kind, FaultKind::Press { .. })) {
                Some(FaultKind::Press { button }) => 1 << button,
                _ => 0,
            };
        self.post(now_s);
    }

    /// Lets the firmware answer as often as `skip` says and loses the answers: its counter then
    /// runs ahead of what the host has got. Whether an arm answers the host or speaks by itself,
    /// the first of the two that gives a frame is the one that counts.
    fn skip(&mut self, now_s: f64, answer: impl Fn(&mut dyn Firmware, &ArmReadings, &mut Outbox)) {
        let Some(samples) = self.skips else { return };
        if self.has(now_s, |kind| matches!(kind, FaultKind::Skip { .. })).is_none() {
            return;
        }
        let mut lost = Outbox::new();
        for _ in 0..samples {
            answer(&mut *self.firmware, &self.readings, &mut lost);
        }
        if !lost.is_empty() {
            self.tally.report.frames_lost += lost.len() as u64;
            self.skips = None;
        }
    }

    /// Lets what the firmware said go through the faults of the wire.
    fn post(&mut self, now_s: f64) {
        let is_silent =
            self.has(now_s, |kind| matches!(kind, FaultKind::Stall | FaultKind::Unplug)).is_some();
        for mut frame in core::mem::take(&mut self.answers) {
            let lost = match self.has(now_s, |kind| matches!(kind, FaultKind::Drop { .. })) {
                Some(FaultKind::Drop { probability }) => self.random.unit() < probability,
                _ => false,
            };
            if is_silent || lost {
                self.tally.report.frames_lost += 1;
                continue;
            }
            if self.has(now_s, |kind| *kind == FaultKind::Garbage).is_some() {
                for byte in &mut frame {
                    *byte = (self.random.unit() * 256.0) as u8;
                }
            }
            if self.has(now_s, |kind| *kind == FaultKind::Truncate).is_some() {
                frame.truncate(frame.len() / 2);
            }
            if self.has(now_s, |kind| *kind == FaultKind::LostByte).is_some() && !frame.is_empty() {
                frame.remove(frame.len() / 2);
            }
            let delay_s = match self.has(now_s, |kind| matches!(kind, FaultKind::Slow { .. })) {
                Some(FaultKind::Slow { delay_s }) => delay_s,
                _ => 0.0,
            };
            let due_s = now_s + delay_s;
            if self.has(now_s, |kind| *kind == FaultKind::Repeat).is_some() {
                self.outgoing.push_back((due_s, frame.clone()));
            }
            match self.overtaken.take() {
                None if self.has(now_s, |kind| *kind == FaultKind::Reorder).is_some() => {
                    self.overtaken = Some(frame)
                }
                overtaken => self.outgoing.extend(
                    [Some(frame), overtaken].into_iter().flatten().map(|frame| (due_s, frame)),
                ),
            }
        }
    }

    /// The next frame that is due, if any.
    pub fn next_frame(&mut self, now_s: f64) -> Option<Vec<u8>> {
        let is_due = self.outgoing.front().is_some_and(|(due_s, _)| *due_s <= now_s);
        if is_due { self.outgoing.pop_front().map(|(_, frame)| frame) } else { None }
    }

    /// When the next frame is due.
    pub(super) fn next_due_s(&self) -> Option<f64> {
        self.outgoing.front().map(|(due_s, _)| *due_s)
    }

    /// Forgets what was not sent: the plug is out.
    pub(super) fn discard(&mut self) {
        self.tally.report.frames_lost +=
            self.outgoing.len() as u64 + u64::from(self.overtaken.take().is_some());
        self.outgoing.clear();
    }

    /// Counts a frame that the link took, or did not.
    pub(crate) fn sent(&mut self, was_taken: bool) {
        if was_taken {
            self.tally.report.frames_sent += 1;
        } else {
            self.tally.report.frames_lost += 1;
        }
    }

    /// Counts a period that began late.
    pub(crate) fn late(&mut self) {
        self.tally.report.late_periods += 1;
    }

    /// What it feels now, for a trace.
    pub(super) fn trace_sample(&self, now_s: f64) -> TraceSample {
        let MockReport { last_command, frames_received, late_periods, .. } = &self.tally.report;
        let wrench = Wrench::from(*last_command);
        TraceSample {
            force_n: wrench.force.length(),
            torque_nm: wrench.torque.length(),
            frames: *frames_received,
            late: *late_periods,
            wrong: self.wrong(now_s),
        }
    }

    /// What was measured so far.
    pub fn report(&self) -> MockReport {
        MockReport { final_pose: self.plant.pose().into(), ..self.tally.report.clone() }
    }
}

fn is_on(motors: &[f64; MAX_AXES]) -> bool {
    motors.iter().any(|motor| *motor != 0.0)
}
