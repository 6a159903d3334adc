//! The simulated arm: a shipped driver, not test code.
//!
//! ```text
//!  write ─► project, limit ─► delay line ─► plant ◄── hand (spring, damper, mass) ◄── path
//!                                             │
//!  read  ◄─ faults ◄─ velocity window ◄─ encoder steps
//! ```
//!
//! Each [`read`](crate::Device::read) advances the plant by one period, in
//! [`SUBSTEPS`](super::SUBSTEPS) fixed steps; the first one reports the rest state at time 0. The
//! arm never looks at a clock, so it runs the same under real and virtual time, and a late servo
//! slows the simulated world down instead of making it jump. Same parameters, same commands: same
//! bits.
//!
//! The plant is described in [`plant`](super::plant).

#[cfg(test)]
mod tests;

use glam::{DQuat, DVec3};

use super::fault::{FaultKind, FaultPlan, JUMP_M, SATURATED_SHARE};
use super::hand_control::HandControl;
use super::parameters::{SimError, SimParameters, check_windows};
use super::plant::GripPlant;
use crate::split_mix::SplitMix64;
use crate::velocity::VelocityWindow;
use crate::{Capabilities, Device, DeviceError, IoPlacement, Pacing};
use vps::spatial::{DeviceSample, Pose, SampleStatus, Twist, Wrench};

/// The simulated arm. RT: `read`, `write` and `stop` are safe; everything is allocated by
/// [`SimArm::new`].
#[derive(Clone, Debug)]
pub struct SimArm {
    period_s: f64,
    plant: GripPlant,
    encoder_step_m: f64,
    encoder_step_rad: f64,
    capabilities: Capabilities,
    force_limit_n: f64,
    torque_limit_nm: f64,
    fault: Option<FaultPlan>,
    homed: bool,
    random: SplitMix64,

    /// Reads so far.
    n_reads: u64,
    /// `[delay_ticks + 1]`, ring of commands under way.
    delay_line: Box<[Wrench]>,
    delay_head: usize,
    /// Last command written: device axes, at the grip point.
    command: Wrench,
    ticks_since_write: u64,
    watchdog_ticks: u64,
    window: VelocityWindow,
    last: DeviceSample,
    stuck_at: Option<Pose>,
    /// A late sample: the read that gets it, and what was measured.
    under_way: Option<(u64, Pose)>,
    /// Ticks that a command spends in the delay line, which every sample reports.
    delay_ticks: u32,
}

impl SimArm {
    /// An arm at rest at its zero pose. RT: start-up only.
    ///
    /// # Errors
    /// A value that the plant's step cannot follow.
    pub fn new(parameters: SimParameters) -> Result<Self, SimError> {
        let SimParameters { period_s, plant, sensed, actuated, .. } = parameters;
        check_windows(parameters.window_linear_s, parameters.window_angular_s)?;
        let grip = GripPlant::new(period_s, &plant, parameters.hand, sensed)?;
        let watchdog_ticks = parameters.watchdog_ms.map_or(u64::MAX, |watchdog_ms| {
            (f64::from(watchdog_ms) * 1e-3 / period_s).ceil() as u64
        });
        Ok(Self {
            period_s,
            plant: grip,
            encoder_step_m: plant.encoder_step_m,
            encoder_step_rad: plant.encoder_step_rad,
            capabilities: Capabilities {
                sensed,
                actuated,
                pacing: Pacing::PingPong,
                io: IoPlacement::InLoop,
                watchdog_ms: parameters.watchdog_ms,
                watchdog_latched: false,
                holds_last_command: parameters.holds_last_command,
                simulated: true,
            },
            force_limit_n: parameters.force_limit_n,
            torque_limit_nm: parameters.torque_limit_nm,
            fault: parameters.fault,
            homed: parameters.homed,
            random: SplitMix64::new(parameters.seed),
            n_reads: 0,
            delay_line: vec![Wrench::ZERO; plant.delay_ticks as usize + 1].into_boxed_slice(),
            delay_head: 0,
            command: Wrench::ZERO,
            ticks_since_write: 0,
            watchdog_ticks,
            window: VelocityWindow::new(
                parameters.window_linear_s,
                parameters.window_angular_s,
                period_s,
            ),
            last: DeviceSample::default(),
            stuck_at: None,
            under_way: None,
            delay_ticks: plant.delay_ticks,
        })
    }

    /// True grip pose, `device_from_grip`, before the encoder.
    pub fn true_pose(&self) -> Pose {
        self.plant.pose()
    }

    /// True twist of the grip point, device axes.
    pub fn true_twist(&self) -> Twist {
        self.plant.twist()
    }

    /// The last command as the motors take it: projected and limited, before the delay. Device
    /// axes, at the grip point.
    pub fn command(&self) -> Wrench {
        self.command
    }

    /// Sets the grip in motion, for checks against closed forms.
    #[cfg(test)]
    fn set_true_twist(&mut self, twist: Twist) {
        self.plant.set_twist(twist);
    }

    fn fault_active(&self, now_s: f64) -> Option<FaultKind> {
        self.fault.and_then(|plan| plan.active(now_s, self.period_s))
    }

    fn now_s(&self) -> f64 {
        self.n_reads as f64 * self.period_s
    }

    fn last_read_s(&self) -> f64 {
        self.n_reads.saturating_sub(1) as f64 * self.period_s
    }

    /// Its commands are lost.
    fn is_deaf(&self) -> bool {
        self.fault_active(self.last_read_s()) == Some(FaultKind::Deaf)
    }

    /// Moves the plant from `n_reads − 1` to `n_reads` periods.
    fn advance(&mut self) {
        let start_s = (self.n_reads - 1) as f64 * self.period_s;
        let mut command = self.take_delayed_command();
        match self.fault_active(start_s) {
            Some(FaultKind::SignFlip) => command = -command,
            Some(FaultKind::Saturate) => {
                command = saturated(&command, self.force_limit_n, self.torque_limit_nm)
            }
            _ => {}
        }
        self.plant.advance(start_s, &command);
    }

    fn take_delayed_command(&mut self) -> Wrench {
        self.ticks_since_write += 1;
        let entering =
            if self.ticks_since_write > self.watchdog_ticks { Wrench::ZERO } else { self.command };
        let length = self.delay_line.len();
        self.delay_line[self.delay_head] = entering;
        self.delay_head = (self.delay_head + 1) % length;
        self.delay_line[self.delay_head]
    }

    /// What the encoders make of the true pose.
    fn measured_pose(&self) -> Pose {
        let pose = self.plant.pose();
        let translation = quantised(pose.translation, self.encoder_step_m);
        let rotation = if self.encoder_step_rad > 0.0 {
            let turn = Pose::IDENTITY.rotation_to(pose);
            DQuat::from_scaled_axis(quantised(turn, self.encoder_step_rad)).normalize()
        } else {
            pose.rotation
        };
        Pose::new(rotation, translation)
    }

    /// Samples that `skip` loses in this tick.
    fn skipped(&self, now_s: f64) -> u16 {
        match self.fault {
            Some(plan @ FaultPlan { kind: FaultKind::Skip { samples }, .. })
                if plan.begins(now_s, self.period_s) =>
            {
                samples
            }
            _ => 0,
        }
    }

    fn stale(&self) -> DeviceSample {
        DeviceSample { status: SampleStatus::Stale, ..self.last }
    }
}

impl Device for SimArm {
    fn capabilities(&self) -> Capabilities {
        self.capabilities
    }

    fn read(&mut self) -> Result<DeviceSample, DeviceError> {
        if self.n_reads > 0 {
            self.advance();
        }
        let now_s = self.now_s();
        self.n_reads += 1;
        let mut pose = self.measured_pose();
        let fault = self.fault_active(now_s);
        if fault != Some(FaultKind::Stuck) {
            self.stuck_at = None;
        }
        match fault {
            Some(FaultKind::Unplug) => return Err(DeviceError::Lost),
            Some(FaultKind::Stall) => return Ok(self.stale()),
            Some(FaultKind::Repeat | FaultKind::Reorder) if self.n_reads.is_multiple_of(2) => {
                return Ok(self.stale());
            }
            Some(FaultKind::Garbage | FaultKind::Truncate | FaultKind::LostByte) => {
                return Err(DeviceError::Packet);
            }
            Some(FaultKind::Slow { delay_s }) => {
                // One exchange at a time: the next sample is measured when the one before has come.
                let due = self.n_reads + (delay_s / self.period_s).ceil() as u64;
                match self.under_way {
                    Some((due, measured)) if self.n_reads >= due => {
                        self.under_way = None;
                        pose = measured;
                    }
                    Some(_) => return Ok(self.stale()),
                    None => {
                        self.under_way = Some((due, pose));
                        return Ok(self.stale());
                    }
                }
            }
            Some(FaultKind::Drop { probability }) if self.random.unit() < probability => {
                return Ok(self.stale());
            }
            Some(FaultKind::Stuck) => pose = *self.stuck_at.get_or_insert(pose),
            Some(FaultKind::Jump) => pose.translation.x += JUMP_M,
            Some(FaultKind::Nan) => {
                // Only what is handed out is poisoned: the window and the plant keep their numbers.
                let mut sample = self.last;
                sample.pose.translation.x = f64::NAN;
                sample.sequence += 1;
                sample.status = SampleStatus::Fresh;
                self.last.sequence += 1;
                return Ok(sample);
            }
            _ => {}
        }
        let measured = self.window.push(now_s, pose);
        let twist = if fault == Some(FaultKind::NoVelocity) { Twist::ZERO } else { measured };
        self.last = DeviceSample {
            pose,
            twist,
            lost_packets: self.skipped(now_s),
            grip_rad: 0.0,
            buttons: if let Some(FaultKind::Press { button }) = fault { 1 << button } else { 0 },
            homed: self.homed && fault != Some(FaultKind::Unhome),
            sequence: self.last.sequence + 1,
            status: SampleStatus::Fresh,
            delay_ticks: self.delay_ticks,
            ..DeviceSample::default()
        };
        Ok(self.last)
    }

    fn write(&mut self, wrench_device: &Wrench) -> Result<Wrench, DeviceError> {
        if self.is_deaf() {
            return Ok(*wrench_device);
        }
        self.ticks_since_write = 0;
        if !wrench_device.is_finite() {
            self.command = Wrench::ZERO;
            return Err(DeviceError::NonFinite);
        }
        let actuated = self.capabilities.actuated;
        self.command = wrench_device.limited_to(actuated, self.force_limit_n, self.torque_limit_nm);
        match self.fault_active(self.last_read_s()) {
            Some(FaultKind::Unplug) => Err(DeviceError::Lost),
            _ => Ok(self.command),
        }
    }

    fn set_enabled(&mut self, enabled: bool) {
        self.plant.hand().set_enabled(enabled);
    }

    fn hand(&mut self) -> Option<&mut HandControl> {
        Some(self.plant.hand())
    }

    fn stop(&mut self) {
        if self.is_deaf() {
            return;
        }
        self.command = Wrench::ZERO;
        self.ticks_since_write = 0;
    }
}

/// The nearest multiple of `step` per component.
fn quantised(value: DVec3, step: f64) -> DVec3 {
    if step > 0.0 { (value / step).round() * step } else { value }
}

/// What motors make of a command when each axis gives a share of the arm's limit at most.
pub(crate) fn saturated(command: &Wrench, force_limit_n: f64, torque_limit_nm: f64) -> Wrench {
    let clip = |vector: DVec3, limit: f64| {
        let most = DVec3::splat(SATURATED_SHARE * limit);
        vector.clamp(-most, most)
    };
    Wrench::new(clip(command.force, force_limit_n), clip(command.torque, torque_limit_nm))
}
