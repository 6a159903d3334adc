//! The motor stage: the one place between a wrench and a codec.
//!
//! ```text
//! wrench ─► finite? ─► axes, |F|, |τ| ─┐
//!                                      ├─► power ─► slew ─► caps ─► motors, all scaled together ─► MotorCommand
//! joints ─► gravity, damping ─► rise ──┘
//! ```
//!
//! Only a [`MotorStage`] makes a [`MotorCommand`] that moves something, and a codec takes nothing
//! else: whatever reaches a motor (the force of a scene, gravity compensation, damping of joints,
//! the pushes of a sign check, an identification) has been through all of this.
//!
//! Caps. Of an arm with verified signs the wrench of all motors together stays within the force and
//! the torque limit of its profile. What they make beside the command stays within [`BESIDE_SHARE`]
//! of these, and within the force limit whichever motors push the wrong way. Of an arm whose signs
//! are not verified there is nothing beside the command, and all that the motors make stays within
//! the cap whichever of them push the wrong way: what counts is the largest |Σ ± τᵢ·pᵢ| over all
//! signs, pᵢ being what one N·m of motor i makes at the grip. In a singular pose the pᵢ grow
//! without bound, so nothing is left. A codec rounds toward zero, which cannot raise that largest:
//! it is convex in each τᵢ, and even. It can raise the sum that counts for verified signs, so that
//! one is taken of the rounded commands.
//!
//! Energy. The passivity observer of the tick counts the command alone, and that is meant.
//! Compensation is the negative of a force that is there anyway, the weight of the links: over any
//! closed path the two do no work, and counting only one of them would charge the scene for each
//! lift and credit it for each fall. Damping of joints takes energy only. What could make either of
//! them a source (a wrong sign, a wrong mass) is none of the scene's doing, and no damping that the
//! observer could ask for would cure it; it is held by the caps and by the power limit of this
//! stage, which count everything, and it is written into the record of the tick
//! ([`Device::beside_device`](super::Device::beside_device)).

use super::axes::MAX_AXES;
use super::kinematics::Configuration;
use super::parameters::{MotorLimits, WiredParameters};
use super::transmission::Transmission;
use vps::spatial::{Twist, Wrench};

/// Most power that the motors may put into the grip, W: what a scene has by default (devices
/// reference, safety rule 9).
pub const POWER_MAX_W: f64 = 5.0;
/// Most that gravity compensation and damping of joints may make at the grip, as a share of the
/// profile's limits. To hold their links at home the shipped arms take 23 % (Polhem) and 63 %
/// (leader-arm-6).
pub(super) const BESIDE_SHARE: f64 = 0.75;
/// Time in which they come in after an enable, s. They go at once: an arm is not reported whether
/// force is switched off in order or by a fault.
pub(super) const RISE_S: f64 = 0.1;
/// From zero to the limits, s (devices reference, safety rule 7).
const FULL_SLEW_S: f64 = 0.01;
/// Tries to come within the limits with commands that are rounded for the wire.
const ON_WIRE_ROUNDS: u32 = 4;
/// What rounding may add to a step: a command that rises just as fast as it may goes through as it
/// is.
const ROUNDING: f64 = 1.0 + 1e-9;

/// What the motors are to do, in the units of the wire (mA, N·m, counts), rounded toward zero by
/// the codec where the wire is whole numbers. Arms that take a wrench: force x, y, z in N, then
/// torque x, y, z in N·m.
///
/// Any code can make a zero; only the motor stage makes anything else.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MotorCommand {
    motors: [f64; MAX_AXES],
    enabled: bool,
}

impl MotorCommand {
    /// Nothing on any motor, and force is off.
    pub const ZERO: Self = Self { motors: [0.0; MAX_AXES], enabled: false };

    /// Nothing on any motor, force being on or off.
    pub const fn at_rest(enabled: bool) -> Self {
        Self { enabled, ..Self::ZERO }
    }

    /// In the order of the protocol.
    pub const fn motors(&self) -> &[f64; MAX_AXES] {
        &self.motors
    }

    /// Force is on: what a protocol with an enable bit or a lamp shows.
    pub const fn is_enabled(&self) -> bool {
        self.enabled
    }

    /// No motor gets a command.
    pub fn moves_nothing(&self) -> bool {
        self.motors == [0.0; MAX_AXES]
    }

    /// Any command, for tests of codecs.
    #[cfg(any(test, fuzzing))]
    pub const fn of(motors: [f64; MAX_AXES], enabled: bool) -> Self {
        Self { motors, enabled }
    }
}

/// What is known of the arm when a command is made.
#[derive(Clone, Copy, Debug)]
pub(super) struct Motion<'a> {
    /// Where the grip is, and how each joint moves it.
    pub(super) configuration: &'a Configuration,
    /// Joint angles.
    pub(super) joints: &'a [f64; MAX_AXES],
    /// Rates that the arm itself reports; zero where it does not.
    pub(super) rates: &'a [f64; MAX_AXES],
    /// Motion of the grip, device axes.
    pub(super) twist: Twist,
}

/// What the motors make at the grip: device axes.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct MotorWrenches {
    /// Of the command.
    pub(super) command: Wrench,
    /// Beside it: gravity compensation and damping of joints.
    pub(super) beside: Wrench,
}

/// Two parts of what the motors do: the command as a wrench, device axes, and the torques of joints
/// beside it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Parts {
    command: Wrench,
    beside: [f64; MAX_AXES],
}

impl Parts {
    fn scaled(self, scale: f64) -> Self {
        Self { command: self.command * scale, beside: self.beside.map(|torque| torque * scale) }
    }
}

/// The motor stage of one arm. RT: safe; about ten 6×6 solves.
#[derive(Clone, Debug, Default)]
pub(super) struct MotorStage {
    /// The signs count as unverified, whatever the profile says.
    doubts_signs: bool,
    /// How far what is beside the command has come in, s.
    risen_s: f64,
    /// What went out last, and since when, s.
    sent: Parts,
    since_s: f64,
    /// What goes out next.
    next: Parts,
}

impl MotorStage {
    /// Lets the signs count as unverified, or as the profile says.
    pub(super) fn doubt_signs(&mut self, doubted: bool) {
        self.doubts_signs = doubted;
        self.begin();
    }

    /// Force was switched on or off: what is beside the command rises from zero again.
    pub(super) fn begin(&mut self) {
        self.risen_s = 0.0;
    }

    /// The command of one tick, and what it makes at the grip. `was_at_rest`: nothing is on the
    /// motors now. Zero while force is off, and for a wrench that is not finite, which switches it
    /// off.
    pub(super) fn command(
        &mut self,
        parameters: &WiredParameters,
        motion: &Motion<'_>,
        wrench_device: &Wrench,
        enabled: bool,
        was_at_rest: bool,
    ) -> (MotorCommand, MotorWrenches) {
        self.since_s = (self.since_s + parameters.period_s).min(FULL_SLEW_S);
        if was_at_rest {
            self.sent = Parts::default();
        }
        let enabled = enabled && wrench_device.is_finite();
        let made = if enabled { self.wanted(parameters, motion, wrench_device) } else { None };
        let Some((motors, parts, made)) = made else {
            self.next = Parts::default();
            return (MotorCommand::at_rest(enabled), MotorWrenches::default());
        };
        self.next = parts;
        (MotorCommand { motors, enabled }, made)
    }

    /// Takes note that the last command went out: the next one may be so far from it.
    pub(super) fn went_out(&mut self) {
        (self.sent, self.since_s) = (self.next, 0.0);
    }

    fn wanted(
        &mut self,
        parameters: &WiredParameters,
        motion: &Motion<'_>,
        wrench_device: &Wrench,
    ) -> Option<([f64; MAX_AXES], Parts, MotorWrenches)> {
        let WiredParameters { transmission, device_from_native, capabilities, .. } = parameters;
        let trusts_signs = parameters.signs_verified && !self.doubts_signs;
        let limits = if trusts_signs { parameters.limits } else { parameters.unverified_limits };
        if !motion.twist.is_finite() {
            return None;
        }
        let has_motor =
            |idx: usize| transmission.joints.get(idx).is_some_and(|joint| joint.motor.is_some());
        let pushes =
            motion.configuration.pushes(has_motor, *device_from_native, capabilities.actuated)?;
        let native_from_device = device_from_native.conjugate();
        let torques = |parts: &Parts| {
            let Wrench { force, torque } = parts.command;
            let mut torques = motion
                .configuration
                .torques(&Wrench::new(native_from_device * force, native_from_device * torque));
            for (torque, beside) in torques.iter_mut().zip(parts.beside) {
                *torque += beside;
            }
            torques
        };

        let mut parts = Parts {
            command: wrench_device.limited_to(
                capabilities.actuated,
                limits.force_n,
                limits.torque_nm,
            ),
            beside: if trusts_signs { self.beside(parameters, motion) } else { [0.0; MAX_AXES] },
        };
        // Whichever is more: the motion of the grip is known of every arm; that of a redundant one
        // whose grip stands still only from rates of joints.
        let at_joints_w: f64 =
            torques(&parts).iter().zip(motion.rates).map(|(torque, rate)| torque * rate).sum();
        let power_w =
            (parts.command + at_grip(&pushes, &parts.beside)).power(motion.twist).max(at_joints_w);
        parts = self.slewed(parts.scaled(share(power_w, POWER_MAX_W)), &pushes, limits);
        // Last, and over what slew has kept of torques that were made for another pose.
        if trusts_signs {
            let [worst_n, _] = worst_of_signs(&pushes, &parts.beside);
            let of_beside =
                limits.scaled(BESIDE_SHARE).share_of(lengths(at_grip(&pushes, &parts.beside)));
            let of_beside = of_beside.min(share(worst_n, limits.force_n));
            parts.beside = parts.beside.map(|torque| torque * of_beside);
            parts = parts
                .scaled(limits.share_of(lengths(parts.command + at_grip(&pushes, &parts.beside))));
        } else {
            parts = parts.scaled(limits.share_of(worst_of_signs(&pushes, &torques(&parts))));
        }
        let (motors, mut scale) = transmission
            .commands(&torques(&Parts { beside: [0.0; MAX_AXES], ..parts }), &parts.beside);
        let mut motors = motors;
        if trusts_signs {
            let share =
                share_on_wire(&pushes, transmission, &motors, parameters.motor_step, limits);
            motors = motors.map(|motor| motor * share);
            scale *= share;
        }
        parts = parts.scaled(scale);
        let made =
            MotorWrenches { command: parts.command, beside: at_grip(&pushes, &parts.beside) };
        (made.command.is_finite() && made.beside.is_finite()).then_some((motors, parts, made))
    }

    /// Torques beside those of the command, as far as they have come in.
    fn beside(&mut self, parameters: &WiredParameters, motion: &Motion<'_>) -> [f64; MAX_AXES] {
        self.risen_s = (self.risen_s + parameters.period_s).min(RISE_S);
        let torques = parameters.kinematics.extra_torques(motion.joints, motion.rates);
        torques.map(|torque| torque * (self.risen_s / RISE_S))
    }

    /// Towards what is wanted, as far as the sum of all may go since the last command that went
    /// out. The command goes first: what is beside it has what is left of the way. A zero of the
    /// command goes out as it is.
    fn slewed(&self, wanted: Parts, pushes: &[Wrench; MAX_AXES], limits: MotorLimits) -> Parts {
        let step = limits.scaled(self.since_s / FULL_SLEW_S * ROUNDING);
        let mut parts = wanted;
        let mut left = step;
        if wanted.command != Wrench::ZERO {
            let change = wanted.command - self.sent.command;
            let share = step.share_of(lengths(change));
            if share < 1.0 {
                parts.command = self.sent.command + change * share;
            }
            let [force_n, torque_nm] = lengths(change * share);
            left = MotorLimits {
                force_n: (step.force_n - force_n).max(0.0),
                torque_nm: (step.torque_nm - torque_nm).max(0.0),
            };
        }
        let change: [f64; MAX_AXES] =
            core::array::from_fn(|idx| wanted.beside[idx] - self.sent.beside[idx]);
        let share = left.share_of(lengths(at_grip(pushes, &change)));
        if share < 1.0 {
            parts.beside = core::array::from_fn(|idx| self.sent.beside[idx] + share * change[idx]);
        }
        parts
    }
}

impl MotorLimits {
    fn scaled(self, share: f64) -> Self {
        Self { force_n: self.force_n * share, torque_nm: self.torque_nm * share }
    }

    /// Factor in 0..=1 that brings so much force and so much torque within both.
    fn share_of(self, [force_n, torque_nm]: [f64; 2]) -> f64 {
        share(force_n, self.force_n).min(share(torque_nm, self.torque_nm))
    }
}

/// Factor in 0..=1 that brings what the motors make within both limits once the codec has rounded
/// each command toward zero by itself: rounding turns the sum, and where the motors pull against
/// each other it makes it longer. Of six servos of a leader arm that push with 2 N it made 2.02 N.
fn share_on_wire(
    pushes: &[Wrench; MAX_AXES],
    transmission: &Transmission,
    motors: &[f64; MAX_AXES],
    step: f64,
    limits: MotorLimits,
) -> f64 {
    if step == 0.0 {
        return 1.0;
    }
    let made = |motors: &[f64; MAX_AXES]| at_grip(pushes, &transmission.torques(motors));
    let mut scaled = 1.0;
    for _ in 0..ON_WIRE_ROUNDS {
        let share = limits
            .share_of(lengths(made(&motors.map(|motor| (motor * scaled / step).trunc() * step))));
        if share == 1.0 {
            return scaled;
        }
        scaled *= share;
    }
    // Each command loses less than a step: below both limits by what a step of every motor makes
    // there is nothing to exceed.
    let [force_n, torque_nm] = lengths(made(motors));
    let (step_n, step_nm) = transmission.torques(&[step; MAX_AXES]).iter().zip(pushes).fold(
        (0.0, 0.0),
        |(force_n, torque_nm), (torque, push)| {
            let [step_n, step_nm] = lengths(*push * *torque);
            (force_n + step_n, torque_nm + step_nm)
        },
    );
    let below = MotorLimits {
        force_n: (limits.force_n - step_n).max(0.0),
        torque_nm: (limits.torque_nm - step_nm).max(0.0),
    };
    below.share_of([force_n, torque_nm])
}

/// Factor in 0..=1 that brings a quantity to its limit; 0 for one that is not a number.
fn share(quantity: f64, limit: f64) -> f64 {
    // `max` drops what is not a number.
    if quantity <= limit { 1.0 } else { (limit / quantity).max(0.0) }
}

fn lengths(wrench: Wrench) -> [f64; 2] {
    [wrench.force.length(), wrench.torque.length()]
}

/// What torques of joints make at the grip.
pub(super) fn at_grip(pushes: &[Wrench; MAX_AXES], torques: &[f64; MAX_AXES]) -> Wrench {
    pushes.iter().zip(torques).fold(Wrench::ZERO, |sum, (push, torque)| sum + *push * *torque)
}

/// The largest force, N, and the largest torque, N·m, that motors with these torques make at the
/// grip if any of them may push the wrong way.
fn worst_of_signs(pushes: &[Wrench; MAX_AXES], torques: &[f64; MAX_AXES]) -> [f64; 2] {
    let mut parts = [Wrench::ZERO; MAX_AXES];
    let mut n = 0;
    for part in pushes
        .iter()
        .zip(torques)
        .map(|(push, torque)| *push * *torque)
        .filter(|part| *part != Wrench::ZERO)
    {
        parts[n] = part;
        n += 1;
    }
    let mut sum = parts.iter().fold(Wrench::ZERO, |sum, part| sum + *part);
    if !sum.is_finite() {
        return [f64::INFINITY; 2];
    }
    let mut worst = lengths(sum);
    // Every choice of signs, in an order in which each differs from the one before in one sign (a
    // Gray code). The first part keeps its own: with all signs turned round the lengths are the
    // same.
    let mut turned = [false; MAX_AXES];
    for count in 1_u32..1 << (n.max(1) - 1) {
        let idx = count.trailing_zeros() as usize + 1;
        turned[idx] = !turned[idx];
        sum = sum + parts[idx] * if turned[idx] { -2.0 } else { 2.0 };
        let [force_n, torque_nm] = lengths(sum);
        worst = [worst[0].max(force_n), worst[1].max(torque_nm)];
    }
    worst
}

#[cfg(test)]
mod tests;
