//! The simulated arm: a shipped driver, not test code.
//!
//! ```text
//!  write ─► project, limit ─► delay line ─► plant ◄── hand (spring, damper, mass) ◄── path
//!                                             │
//!  read  ◄─ faults ◄─ velocity window ◄─ encoder steps
//! ```
//!
//! Each [`read`](crate::device::Device::read) advances the plant by one period, in [`SUBSTEPS`] fixed steps; the first one reports
//! the rest state at time 0. The arm never looks at a clock, so it runs the same under real and virtual time, and a late servo slows the
//! simulated world down instead of making it jump. Same parameters, same commands: same bits.
//!
//! # The plant
//! For translation, and likewise for rotation with a scalar inertia,
//!
//! ```text
//! (m + m_hand) a = F_command + k_hand (x_target − x) + b_hand (v_target − v) − b v − F_coulomb
//! ```
//!
//! in semi-implicit steps: springs from the old position, dampers implicit in the new velocity, so that no viscosity can make a step
//! unstable. Coulomb friction is solved exactly within the step: the momentum that is left after everything else has acted is reduced by at
//! most h·F_c and never reversed. A resting grip therefore stays at rest to the last bit, and nothing chatters.
//!
//! An axis that the arm does not sense has no joint: it does not move.

use glam::{DQuat, DVec3};

use super::fault::{FaultKind, FaultPlan, JUMP_M};
use super::hand::GripPath;
use super::profile::Plant;
use super::velocity::{DEFAULT_WINDOW_ANGULAR_S, DEFAULT_WINDOW_LINEAR_S, VelocityWindow};
use super::{Capabilities, Device, DeviceError, IoPlacement, Pacing, Wakeup};
use crate::spatial::{Axes, DeviceSample, Pose, SampleStatus, Twist, Wrench};

/// Plant steps in one period.
pub const SUBSTEPS: u32 = 10;

/// Largest h²·k/m of a step: the semi-implicit step is stable up to 4 and accurate well below 1.
const STIFFEST_STEP: f64 = 1.0;

/// The hand that holds the grip.
#[derive(Clone, Debug, PartialEq)]
pub struct HandParameters {
    /// Stiffness between the hand's target and the grip, N/m.
    pub stiffness_n_per_m: f64,
    /// Damping, N·s/m.
    pub damping_n_s_per_m: f64,
    /// Mass of the hand that moves with the grip, kg.
    pub mass_kg: f64,
    /// Rotational stiffness, N·m/rad.
    pub stiffness_nm_per_rad: f64,
    /// Rotational damping, N·m·s/rad.
    pub damping_nm_s_per_rad: f64,
    /// Inertia of the hand that turns with the grip, kg·m².
    pub inertia_kg_m2: f64,
    /// Where the hand wants to be; `None`: at the zero pose.
    pub path: Option<GripPath>,
}

impl Default for HandParameters {
    /// A relaxed grip. The linear values are those of the device reference (assumed there; human hand damping is quoted as 1–10 N·s/m). The
    /// rotational ones are assumed: 3 N·m/rad and 0.03 N·m·s/rad turn the grip with about 12 Hz and ζ = 0.4 against the hand's
    /// inertia of 5·10⁻⁴ kg·m², a wrist that holds a pen.
    fn default() -> Self {
        Self {
            stiffness_n_per_m: 500.0,
            damping_n_s_per_m: 5.0,
            mass_kg: 0.15,
            stiffness_nm_per_rad: 3.0,
            damping_nm_s_per_rad: 0.03,
            inertia_kg_m2: 5e-4,
            path: None,
        }
    }
}

/// Everything that makes one simulated arm.
#[derive(Clone, Debug, PartialEq)]
pub struct SimParameters {
    /// Time that one `read` takes in the simulated world, s.
    pub period_s: f64,
    /// The arm.
    pub plant: Plant,
    /// The hand; `None`: nobody holds the grip.
    pub hand: Option<HandParameters>,
    /// Axes that exist and are measured.
    pub sensed: Axes,
    /// Axes with a motor.
    pub actuated: Axes,
    /// Largest |F| of the motors, N.
    pub force_limit_n: f64,
    /// Largest |τ| of the motors, N·m.
    pub torque_limit_nm: f64,
    /// Window of the linear velocity, s.
    pub window_linear_s: f64,
    /// Window of the angular velocity, s.
    pub window_angular_s: f64,
    /// The arm drops its command when none came for this long.
    pub watchdog_ms: Option<u32>,
    /// Reported as is: the motors would keep the last command if the host went away.
    pub holds_last_command: bool,
    /// Homed at power-on.
    pub homed: bool,
    /// What goes wrong, if anything.
    pub fault: Option<FaultPlan>,
    /// Seed of everything random.
    pub seed: u64,
}

impl SimParameters {
    /// An arm without mass to speak of, friction, steps, delay or limits that matter: six axes, for analytic checks.
    pub fn ideal(period_s: f64) -> Self {
        Self {
            period_s,
            plant: Plant {
                mass_kg: 1e-3,
                damping_n_s_per_m: 0.0,
                inertia_kg_m2: 2e-4,
                damping_nm_s_per_rad: 0.0,
                coulomb_n: 0.0,
                coulomb_nm: 0.0,
                encoder_step_m: 0.0,
                encoder_step_rad: 0.0,
                delay_ticks: 0,
            },
            hand: Some(HandParameters::default()),
            sensed: Axes::SIX,
            actuated: Axes::SIX,
            force_limit_n: 100.0,
            torque_limit_nm: 10.0,
            window_linear_s: DEFAULT_WINDOW_LINEAR_S,
            window_angular_s: DEFAULT_WINDOW_ANGULAR_S,
            watchdog_ms: Some(100),
            holds_last_command: false,
            homed: true,
            fault: None,
            seed: 0,
        }
    }
}

/// Why an arm cannot be simulated.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum SimError {
    /// A value is negative, zero where it must not be, or not finite.
    #[error("simulated arm: {name} = {value} must be {expected}")]
    Range {
        /// Name of the value.
        name: &'static str,
        /// The value.
        value: f64,
        /// What would be accepted.
        expected: &'static str,
    },
    /// The hand is too stiff for the mass it holds.
    #[error("simulated arm: {name} = {value} is too stiff for the moving mass, at most {largest}")]
    TooStiff {
        /// Name of the value.
        name: &'static str,
        /// The value.
        value: f64,
        /// Largest value that the plant's step can follow.
        largest: f64,
    },
}

/// One half of the plant: translation or rotation.
#[derive(Clone, Copy, Debug)]
struct Body {
    /// kg or kg·m², the hand included.
    inertia: f64,
    /// Viscosity of the arm alone.
    damping: f64,
    coulomb: f64,
    hand_stiffness: f64,
    hand_damping: f64,
    /// 1 where there is a joint, 0 where not.
    free_axes: DVec3,
}

impl Body {
    /// The velocity after one step of length `h`.
    fn step(&self, velocity: DVec3, load: DVec3, stretch: DVec3, target_velocity: DVec3, h: f64) -> DVec3 {
        let push = load + self.hand_stiffness * stretch + self.hand_damping * target_velocity;
        let implicit_inertia = self.inertia + h * (self.damping + self.hand_damping);
        let sliding = (self.inertia * velocity + h * push) / implicit_inertia * self.free_axes;
        let friction = h * self.coulomb / implicit_inertia;
        let speed = sliding.length();
        if speed <= friction { DVec3::ZERO } else { sliding * (1.0 - friction / speed) }
    }
}

/// The simulated arm. RT: `read`, `write` and `stop` are safe; everything is allocated by [`SimArm::new`].
#[derive(Clone, Debug)]
pub struct SimArm {
    period_s: f64,
    translation: Body,
    rotation: Body,
    encoder_step_m: f64,
    encoder_step_rad: f64,
    path: Option<GripPath>,
    capabilities: Capabilities,
    force_limit_n: f64,
    torque_limit_nm: f64,
    fault: Option<FaultPlan>,
    random: u64,

    /// True pose, `device_from_grip`, before the encoder.
    pose: Pose,
    /// True twist, device axes, at the grip point.
    twist: Twist,
    /// Reads so far.
    n_reads: u64,
    /// Where the hand's target was at the end of the last step.
    target: Pose,
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
    /// Ticks that a command spends in the delay line, which every sample reports.
    delay_ticks: u32,
}

impl SimArm {
    /// An arm at rest at its zero pose. RT: start-up only.
    ///
    /// # Errors
    /// A value that the plant's step cannot follow.
    pub fn new(parameters: SimParameters) -> Result<Self, SimError> {
        let SimParameters { period_s, plant, hand, sensed, actuated, .. } = parameters;
        let held = hand.is_some();
        let hand = hand.unwrap_or_default();
        let of_hand = |value: f64| if held { value } else { 0.0 };
        check_ranges(&parameters_of(period_s, &plant, &hand, parameters.window_linear_s, parameters.window_angular_s))?;
        let translation = Body {
            inertia: plant.mass_kg + of_hand(hand.mass_kg),
            damping: plant.damping_n_s_per_m,
            coulomb: plant.coulomb_n,
            hand_stiffness: of_hand(hand.stiffness_n_per_m),
            hand_damping: of_hand(hand.damping_n_s_per_m),
            free_axes: axis_mask(sensed, 0),
        };
        let rotation = Body {
            inertia: plant.inertia_kg_m2 + of_hand(hand.inertia_kg_m2),
            damping: plant.damping_nm_s_per_rad,
            coulomb: plant.coulomb_nm,
            hand_stiffness: of_hand(hand.stiffness_nm_per_rad),
            hand_damping: of_hand(hand.damping_nm_s_per_rad),
            free_axes: axis_mask(sensed, 3),
        };
        let h = period_s / f64::from(SUBSTEPS);
        for (name, body) in [("hand_stiffness_n_per_m", translation), ("hand_stiffness_nm_per_rad", rotation)] {
            let largest = STIFFEST_STEP * body.inertia / (h * h);
            if body.hand_stiffness > largest {
                return Err(SimError::TooStiff { name, value: body.hand_stiffness, largest });
            }
        }
        let path = if held { hand.path } else { None };
        let target = path.as_ref().map_or(Pose::IDENTITY, |path| path.sample(0.0));
        let watchdog_ticks =
            parameters.watchdog_ms.map_or(u64::MAX, |watchdog_ms| (f64::from(watchdog_ms) * 1e-3 / period_s).ceil() as u64);
        Ok(Self {
            period_s,
            translation,
            rotation,
            encoder_step_m: plant.encoder_step_m,
            encoder_step_rad: plant.encoder_step_rad,
            path,
            capabilities: Capabilities {
                sensed,
                actuated,
                pacing: Pacing::PingPong,
                io: IoPlacement::InLoop,
                wakeup: Wakeup::Clock,
                watchdog_ms: parameters.watchdog_ms,
                watchdog_latched: false,
                holds_last_command: parameters.holds_last_command,
                homed: parameters.homed,
                simulated: true,
            },
            force_limit_n: parameters.force_limit_n,
            torque_limit_nm: parameters.torque_limit_nm,
            fault: parameters.fault,
            random: parameters.seed,
            pose: Pose::IDENTITY,
            twist: Twist::ZERO,
            n_reads: 0,
            target,
            delay_line: vec![Wrench::ZERO; plant.delay_ticks as usize + 1].into_boxed_slice(),
            delay_head: 0,
            command: Wrench::ZERO,
            ticks_since_write: 0,
            watchdog_ticks,
            window: VelocityWindow::new(parameters.window_linear_s, parameters.window_angular_s, period_s),
            last: DeviceSample::default(),
            stuck_at: None,
            delay_ticks: plant.delay_ticks,
        })
    }

    /// True grip pose, `device_from_grip`, before the encoder.
    pub fn true_pose(&self) -> Pose {
        self.pose
    }

    /// True twist of the grip point, device axes.
    pub fn true_twist(&self) -> Twist {
        self.twist
    }

    /// The last command as the motors take it: projected and limited, before the delay. Device axes, at the grip point.
    pub fn command(&self) -> Wrench {
        self.command
    }

    /// Sets the grip in motion, for checks against closed forms.
    pub fn set_true_twist(&mut self, twist: Twist) {
        self.twist = twist;
    }

    fn fault_active(&self, now_s: f64) -> Option<FaultKind> {
        // Half a period early: the tick that is nearest to the time asked for.
        self.fault.filter(|plan| now_s + 0.5 * self.period_s >= plan.start_s).map(|plan| plan.kind)
    }

    fn now_s(&self) -> f64 {
        self.n_reads as f64 * self.period_s
    }

    /// Moves the plant from `n_reads − 1` to `n_reads` periods.
    fn advance(&mut self) {
        let start_s = (self.n_reads - 1) as f64 * self.period_s;
        let h = self.period_s / f64::from(SUBSTEPS);
        let mut command = self.take_delayed_command();
        if matches!(self.fault_active(start_s), Some(FaultKind::SignFlip)) {
            command = -command;
        }
        for substep in 1..=SUBSTEPS {
            let target = match &self.path {
                Some(path) => path.sample(start_s + f64::from(substep) * h),
                None => self.target,
            };
            let target_velocity = (target.translation - self.target.translation) / h;
            let target_spin = self.target.rotation_to(target) / h;
            let stretch = self.target.translation - self.pose.translation;
            let twist_stretch = self.pose.rotation_to(self.target);
            self.twist.linear = self.translation.step(self.twist.linear, command.force, stretch, target_velocity, h);
            self.twist.angular = self.rotation.step(self.twist.angular, command.torque, twist_stretch, target_spin, h);
            self.pose = self.pose.stepped(self.twist.linear * h, self.twist.angular * h);
            self.target = target;
        }
    }

    fn take_delayed_command(&mut self) -> Wrench {
        self.ticks_since_write += 1;
        let entering = if self.ticks_since_write > self.watchdog_ticks { Wrench::ZERO } else { self.command };
        let length = self.delay_line.len();
        self.delay_line[self.delay_head] = entering;
        self.delay_head = (self.delay_head + 1) % length;
        self.delay_line[self.delay_head]
    }

    /// What the encoders make of the true pose.
    fn measured_pose(&self) -> Pose {
        let translation = quantised(self.pose.translation, self.encoder_step_m);
        let rotation = if self.encoder_step_rad > 0.0 {
            let turn = Pose::IDENTITY.rotation_to(self.pose);
            DQuat::from_scaled_axis(quantised(turn, self.encoder_step_rad)).normalize()
        } else {
            self.pose.rotation
        };
        Pose::new(rotation, translation)
    }

    /// Uniform in 0..1 (splitmix64).
    fn next_random(&mut self) -> f64 {
        self.random = self.random.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut bits = self.random;
        bits = (bits ^ (bits >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        bits = (bits ^ (bits >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        bits ^= bits >> 31;
        (bits >> 11) as f64 / (1u64 << 53) as f64
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
        match self.fault_active(now_s) {
            Some(FaultKind::Unplug) => return Err(DeviceError::Lost),
            Some(FaultKind::Stall) => return Ok(self.stale()),
            Some(FaultKind::Drop { probability }) if self.next_random() < probability => return Ok(self.stale()),
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
        let twist = self.window.push(now_s, pose);
        self.last = DeviceSample {
            pose,
            twist,
            grip_rad: 0.0,
            buttons: 0,
            sequence: self.last.sequence + 1,
            status: SampleStatus::Fresh,
            delay_ticks: self.delay_ticks,
            ..DeviceSample::default()
        };
        Ok(self.last)
    }

    fn write(&mut self, wrench_device: &Wrench) -> Result<Wrench, DeviceError> {
        self.ticks_since_write = 0;
        if !wrench_device.is_finite() {
            self.command = Wrench::ZERO;
            return Err(DeviceError::NonFinite);
        }
        let actuated = self.capabilities.actuated;
        self.command = Wrench::new(
            limited(wrench_device.force * axis_mask(actuated, 0), self.force_limit_n),
            limited(wrench_device.torque * axis_mask(actuated, 3), self.torque_limit_nm),
        );
        let last_read_s = self.n_reads.saturating_sub(1) as f64 * self.period_s;
        match self.fault_active(last_read_s) {
            Some(FaultKind::Unplug) => Err(DeviceError::Lost),
            _ => Ok(self.command),
        }
    }

    fn stop(&mut self) {
        self.command = Wrench::ZERO;
        self.ticks_since_write = 0;
    }
}

/// 1 for each axis of the set, 0 for the others; axes `first_axis..first_axis + 3`.
fn axis_mask(axes: Axes, first_axis: usize) -> DVec3 {
    let one_if = |axis_idx: usize| if axes.has(axis_idx) { 1.0 } else { 0.0 };
    DVec3::new(one_if(first_axis), one_if(first_axis + 1), one_if(first_axis + 2))
}

/// The nearest multiple of `step` per component.
fn quantised(value: DVec3, step: f64) -> DVec3 {
    if step > 0.0 { (value / step).round() * step } else { value }
}

/// The vector, shortened to `limit`, direction kept.
fn limited(vector: DVec3, limit: f64) -> DVec3 {
    let length = vector.length();
    if length > limit { vector * (limit / length) } else { vector }
}

/// What a value must be.
#[derive(Clone, Copy)]
enum Must {
    BePositive,
    NotBeNegative,
}

fn parameters_of(
    period_s: f64,
    plant: &Plant,
    hand: &HandParameters,
    window_linear_s: f64,
    window_angular_s: f64,
) -> [(&'static str, f64, Must); 17] {
    use Must::{BePositive, NotBeNegative};
    [
        ("period_s", period_s, BePositive),
        ("mass_kg", plant.mass_kg, BePositive),
        ("inertia_kg_m2", plant.inertia_kg_m2, BePositive),
        ("damping_n_s_per_m", plant.damping_n_s_per_m, NotBeNegative),
        ("damping_nm_s_per_rad", plant.damping_nm_s_per_rad, NotBeNegative),
        ("coulomb_n", plant.coulomb_n, NotBeNegative),
        ("coulomb_nm", plant.coulomb_nm, NotBeNegative),
        ("encoder_step_m", plant.encoder_step_m, NotBeNegative),
        ("encoder_step_rad", plant.encoder_step_rad, NotBeNegative),
        ("hand_stiffness_n_per_m", hand.stiffness_n_per_m, NotBeNegative),
        ("hand_damping_n_s_per_m", hand.damping_n_s_per_m, NotBeNegative),
        ("hand_mass_kg", hand.mass_kg, NotBeNegative),
        ("hand_stiffness_nm_per_rad", hand.stiffness_nm_per_rad, NotBeNegative),
        ("hand_damping_nm_s_per_rad", hand.damping_nm_s_per_rad, NotBeNegative),
        ("hand_inertia_kg_m2", hand.inertia_kg_m2, NotBeNegative),
        ("velocity_window_linear_s", window_linear_s, NotBeNegative),
        ("velocity_window_angular_s", window_angular_s, NotBeNegative),
    ]
}

fn check_ranges(values: &[(&'static str, f64, Must)]) -> Result<(), SimError> {
    for &(name, value, must) in values {
        let (fine, expected) = match must {
            Must::BePositive => (value > 0.0, "above zero"),
            Must::NotBeNegative => (value >= 0.0, "zero or above"),
        };
        if !(fine && value.is_finite()) {
            return Err(SimError::Range { name, value, expected });
        }
    }
    Ok(())
}

#[cfg(test)]
#[expect(clippy::float_cmp, reason = "exact zeros and exact delays are what is tested")]
mod tests {
    use super::*;
    use crate::device::fault;
    use crate::device::hand::HandPath;

    const T: f64 = 1e-3;

    fn free_arm() -> SimParameters {
        let mut parameters = SimParameters::ideal(T);
        parameters.hand = None;
        parameters.plant.mass_kg = 0.3;
        parameters
    }

    fn arm(parameters: SimParameters) -> SimArm {
        let mut arm = SimArm::new(parameters).expect("valid parameters");
        arm.read().expect("the rest state");
        arm
    }

    fn x_at(offset_m: f64) -> GripPath {
        GripPath::in_device_frame(HandPath::fixed(Pose::from_translation(DVec3::new(offset_m, 0.0, 0.0))))
    }

    #[test]
    fn a_free_motion_decays_as_viscous_friction_says() {
        let mut parameters = free_arm();
        parameters.plant.damping_n_s_per_m = 2.5;
        parameters.plant.damping_nm_s_per_rad = 2e-3;
        let mut arm = arm(parameters);
        arm.set_true_twist(Twist { linear: DVec3::new(0.1, 0.0, 0.0), angular: DVec3::new(0.0, 0.0, 2.0) });
        for n in 1..=400 {
            arm.read().expect("sample");
            let time_s = f64::from(n) * T;
            let speed = 0.1 * (-2.5 / 0.3 * time_s).exp();
            let travel = 0.1 * 0.3 / 2.5 * (1.0 - (-2.5 / 0.3 * time_s).exp());
            let spin = 2.0 * (-2e-3 / 2e-4 * time_s).exp();
            assert!((arm.true_twist().linear.x - speed).abs() < 0.01 * 0.1);
            assert!((arm.true_pose().translation.x - travel).abs() < 0.01 * travel);
            assert!((arm.true_twist().angular.z - spin).abs() < 0.01 * 2.0);
        }
    }

    #[test]
    fn a_step_of_the_hand_rings_as_a_mass_on_a_spring_does() {
        let mut parameters = SimParameters::ideal(T);
        parameters.plant.mass_kg = 0.15;
        parameters.hand = Some(HandParameters { path: Some(x_at(0.01)), ..HandParameters::default() });
        let mut arm = arm(parameters);
        let (m, b, k) = (0.3, 5.0, 500.0);
        let decay = b / (2.0 * m);
        let ringing = f64::sqrt(k / m - decay * decay);
        for n in 1..=600 {
            arm.read().expect("sample");
            let time_s = f64::from(n) * T;
            let envelope = (-decay * time_s).exp();
            let x = 0.01 * (1.0 - envelope * ((ringing * time_s).cos() + decay / ringing * (ringing * time_s).sin()));
            assert!((arm.true_pose().translation.x - x).abs() < 0.01 * 0.01, "{n}");
        }
    }

    #[test]
    fn a_turn_of_the_hand_turns_the_grip() {
        let mut parameters = SimParameters::ideal(T);
        let goal = Pose::new(DQuat::from_scaled_axis(DVec3::new(0.3, -0.4, 0.2)), DVec3::ZERO);
        parameters.hand =
            Some(HandParameters { path: Some(GripPath::in_device_frame(HandPath::fixed(goal))), ..HandParameters::default() });
        let mut arm = arm(parameters);
        for _ in 0..2000 {
            arm.read().expect("sample");
        }
        assert!(arm.true_pose().rotation_to(goal).length() < 1e-6);
    }

    #[test]
    fn static_friction_holds_to_the_last_bit_and_lets_go_above() {
        let mut parameters = free_arm();
        parameters.plant.coulomb_n = 0.2;
        parameters.plant.coulomb_nm = 0.01;
        let mut arm = arm(parameters);
        for _ in 0..1000 {
            arm.write(&Wrench::new(DVec3::new(0.1, 0.1, 0.1), DVec3::new(0.0, 0.009, 0.0))).expect("written");
            arm.read().expect("sample");
        }
        assert_eq!(arm.true_pose(), Pose::IDENTITY);
        for _ in 0..100 {
            arm.write(&Wrench::new(DVec3::new(0.5, 0.0, 0.0), DVec3::ZERO)).expect("written");
            arm.read().expect("sample");
        }
        // (0.5 − 0.2) N on 0.3 kg for 0.1 s.
        assert!((arm.true_twist().linear.x - 0.1).abs() < 1e-9);
        // Left alone it comes to rest and stays there.
        for _ in 0..1000 {
            arm.write(&Wrench::ZERO).expect("written");
            arm.read().expect("sample");
        }
        let rest = arm.true_pose();
        assert_eq!(arm.true_twist().linear, DVec3::ZERO);
        for _ in 0..1000 {
            arm.write(&Wrench::ZERO).expect("written");
            arm.read().expect("sample");
        }
        assert_eq!(arm.true_pose(), rest);
    }

    #[test]
    fn a_command_acts_after_exactly_the_delay() {
        for delay_ticks in [0, 1, 2, 7] {
            let mut parameters = free_arm();
            parameters.plant.delay_ticks = delay_ticks;
            let mut arm = arm(parameters);
            arm.write(&Wrench::new(DVec3::X, DVec3::ZERO)).expect("written");
            let mut quiet_reads = 0;
            while arm.read().is_ok() && arm.true_pose().translation.x == 0.0 {
                arm.write(&Wrench::ZERO).expect("written");
                quiet_reads += 1;
            }
            assert_eq!(quiet_reads, delay_ticks);
            // It acted for one period and no longer.
            let speed = arm.true_twist().linear.x;
            assert!((speed - T / 0.3).abs() < 1e-12);
            arm.write(&Wrench::ZERO).expect("written");
            arm.read().expect("sample");
            assert_eq!(arm.true_twist().linear.x, speed);
        }
    }

    #[test]
    fn positions_come_in_encoder_steps() {
        let mut parameters = free_arm();
        parameters.plant.encoder_step_m = 4e-5;
        parameters.plant.encoder_step_rad = 6e-3;
        let mut arm = arm(parameters);
        arm.set_true_twist(Twist { linear: DVec3::new(0.0123, -0.02, 0.003), angular: DVec3::new(0.5, 0.1, -0.3) });
        for _ in 0..500 {
            let sample = arm.read().expect("sample");
            for (measured, exact, step) in [
                (sample.pose.translation, arm.true_pose().translation, 4e-5),
                (Pose::IDENTITY.rotation_to(sample.pose), Pose::IDENTITY.rotation_to(arm.true_pose()), 6e-3),
            ] {
                let steps = measured / step;
                assert!((steps - steps.round()).length() < 1e-6);
                assert!((measured - exact).abs().max_element() <= 0.5 * step + 1e-12);
            }
        }
        // Far into a steady motion the window smooths the steps: at most one step per window.
        let sample = arm.read().expect("sample");
        assert!((sample.twist.linear - arm.true_twist().linear).abs().max_element() <= 4e-5 / 0.015 + 1e-12);
        assert!((sample.twist.angular - arm.true_twist().angular).abs().max_element() <= 2.0 * 6e-3 / 0.030);
    }

    #[test]
    fn axes_without_a_motor_ignore_their_command_and_axes_without_a_joint_stay() {
        let mut parameters = free_arm();
        parameters.actuated = Axes::TRANSLATION;
        let mut arm_3 = arm(parameters.clone());
        arm_3.write(&Wrench::new(DVec3::X, DVec3::Z)).expect("written");
        assert_eq!(arm_3.command(), Wrench::new(DVec3::X, DVec3::ZERO));
        let plane = Axes::from_name("x").expect("axis").union(Axes::from_name("y").expect("axis"));
        parameters.sensed = plane;
        parameters.actuated = Axes::SIX;
        parameters.hand = Some(HandParameters {
            path: Some(GripPath::in_device_frame(HandPath::fixed(Pose::new(
                DQuat::from_rotation_x(0.5),
                DVec3::new(0.01, 0.01, 0.01),
            )))),
            ..HandParameters::default()
        });
        let mut arm_2 = arm(parameters);
        for _ in 0..100 {
            arm_2.read().expect("sample");
        }
        let pose = arm_2.true_pose();
        assert!(pose.translation.x > 0.0 && pose.translation.z == 0.0);
        assert_eq!(pose.rotation, DQuat::IDENTITY);
    }

    #[test]
    fn the_motors_limit_the_magnitude_and_keep_the_direction() {
        let mut parameters = free_arm();
        parameters.force_limit_n = 5.0;
        parameters.torque_limit_nm = 0.1;
        let mut arm = arm(parameters);
        arm.write(&Wrench::new(DVec3::new(30.0, 40.0, 0.0), DVec3::new(0.0, 0.0, -7.0))).expect("written");
        assert!((arm.command().force - DVec3::new(3.0, 4.0, 0.0)).length() < 1e-12);
        assert!((arm.command().torque - DVec3::new(0.0, 0.0, -0.1)).length() < 1e-12);
        let refused = arm.write(&Wrench::new(DVec3::new(f64::NAN, 0.0, 0.0), DVec3::ZERO));
        assert_eq!(refused, Err(DeviceError::NonFinite));
        assert_eq!(arm.command(), Wrench::ZERO);
    }

    #[test]
    fn the_watchdog_drops_a_command_that_is_not_repeated() {
        let mut parameters = free_arm();
        parameters.watchdog_ms = Some(20);
        let mut arm = arm(parameters);
        arm.write(&Wrench::new(DVec3::X, DVec3::ZERO)).expect("written");
        for _ in 0..20 {
            arm.read().expect("sample");
        }
        let speed = arm.true_twist().linear.x;
        assert!((speed - 20.0 * T / 0.3).abs() < 1e-9);
        for _ in 0..50 {
            arm.read().expect("sample");
        }
        assert_eq!(arm.true_twist().linear.x, speed);
    }

    fn run(parameters: SimParameters, n: usize) -> Vec<Result<DeviceSample, DeviceError>> {
        let mut arm = SimArm::new(parameters).expect("valid");
        (0..n)
            .map(|_| {
                let sample = arm.read();
                if let Ok(sample) = sample {
                    // A feedback loop, so that every bit of the sample matters.
                    let _ = arm.write(&Wrench::new(-200.0 * sample.pose.translation, -0.5 * sample.twist.angular));
                }
                sample
            })
            .collect()
    }

    fn lively(fault: Option<&str>) -> SimParameters {
        let mut parameters = SimParameters::ideal(T);
        parameters.plant.mass_kg = 0.3;
        parameters.plant.encoder_step_m = 4e-5;
        parameters.plant.coulomb_n = 0.05;
        parameters.plant.delay_ticks = 1;
        parameters.hand = Some(HandParameters { path: Some(x_at(0.02)), ..HandParameters::default() });
        parameters.fault = fault.map(|text| fault::parse(text).expect("grammar"));
        parameters
    }

    #[test]
    fn two_runs_are_bit_identical() {
        for fault in [None, Some("drop=10%"), Some("sign-flip@100ms")] {
            assert_eq!(run(lively(fault), 2000), run(lively(fault), 2000));
        }
    }

    #[test]
    fn faults_begin_on_their_tick() {
        let at = 200; // 200 ms
        let clean = run(lively(None), 400);
        for (spec, check) in [
            (
                "nan@200ms",
                (|s, _| s.is_ok_and(|s| !s.pose.is_finite())) as fn(Result<DeviceSample, DeviceError>, DeviceSample) -> bool,
            ),
            ("jump@200ms", |s, clean| s.is_ok_and(|s| s.pose.translation.x - clean.pose.translation.x > 0.04)),
            ("unplug@200ms", |s, _| s == Err(DeviceError::Lost)),
            ("stall@200ms", |s, _| s.is_ok_and(|s| s.status == SampleStatus::Stale)),
        ] {
            let samples = run(lively(Some(spec)), 400);
            assert_eq!(samples[..at], clean[..at], "{spec}");
            assert!(check(samples[at], clean[at].expect("clean")), "{spec}: {:?}", samples[at]);
        }
        let stuck = run(lively(Some("stuck@20ms")), 40);
        assert_eq!(stuck[39].expect("sample").pose, stuck[20].expect("sample").pose);
        assert_eq!(stuck[39].expect("sample").sequence, 40);
        let flipped = run(lively(Some("sign-flip@200ms")), 400);
        assert_eq!(flipped[..at], clean[..at]);
        assert_ne!(flipped[at + 10], clean[at + 10]);
    }

    #[test]
    fn samples_are_dropped_about_as_often_as_asked() {
        let stale =
            run(lively(Some("drop=10%")), 10_000).into_iter().filter(|s| s.is_ok_and(|s| s.status == SampleStatus::Stale)).count();
        assert!((900..1100).contains(&stale), "{stale}");
    }

    #[test]
    fn values_that_cannot_be_simulated_are_refused_by_name() {
        let mut parameters = free_arm();
        parameters.plant.mass_kg = 0.0;
        assert!(SimArm::new(parameters).expect_err("no mass").to_string().contains("mass_kg = 0 must be above zero"));
        let mut parameters = SimParameters::ideal(T);
        parameters.hand = Some(HandParameters { stiffness_n_per_m: 1e9, ..HandParameters::default() });
        assert!(SimArm::new(parameters).expect_err("too stiff").to_string().contains("too stiff"));
        let mut parameters = free_arm();
        parameters.plant.damping_n_s_per_m = f64::NAN;
        assert!(SimArm::new(parameters).is_err());
    }
}
