//! The grip of a simulated arm as a body, with the hand that holds it.
//!
//! Data in: the wrench that the motors make. Data out: the true pose and twist of the grip, one
//! period later.
//!
//! For translation, and likewise for rotation with a scalar inertia,
//!
//! ```text
//! (m + m_hand) a = F_command + k_hand (x_target − x) + b_hand (v_target − v) − b v − F_coulomb
//! ```
//!
//! in steps of half a drift, a kick and half a drift: springs from the position in the middle of
//! the step, dampers implicit in the new velocity, so that no viscosity can make a step unstable. A
//! constant force moves a free body by exactly half its acceleration times the time squared;
//! drifting only after the kick would be half a step ahead of that, and every loop around the arm
//! would look that much more stable than it is. Coulomb friction is solved exactly within the step:
//! the momentum that is left after everything else has acted is reduced by at most h·F_c and never
//! reversed. A resting grip therefore stays at rest to the last bit, and nothing chatters.
//!
//! An axis that the arm does not sense has no joint: it does not move.

use glam::DVec3;

use super::hand_control::HandControl;
use super::parameters::{HandParameters, SimError, check_plant};
use crate::profile;
use vps::spatial::{Axes, Pose, Twist, Wrench};

/// Plant steps in one period.
pub(crate) const SUBSTEPS: u32 = 10;

/// Largest h²·k/m of a step: the semi-implicit step is stable up to 4 and accurate well below 1.
const STIFFEST_STEP: f64 = 1.0;

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
    fn step(
        &self,
        velocity: DVec3,
        load: DVec3,
        stretch: DVec3,
        target_velocity: DVec3,
        h: f64,
    ) -> DVec3 {
        let push = load + self.hand_stiffness * stretch + self.hand_damping * target_velocity;
        let implicit_inertia = self.inertia + h * (self.damping + self.hand_damping);
        let sliding = (self.inertia * velocity + h * push) / implicit_inertia * self.free_axes;
        let friction = h * self.coulomb / implicit_inertia;
        let speed = sliding.length();
        if speed <= friction { DVec3::ZERO } else { sliding * (1.0 - friction / speed) }
    }
}

/// The grip and the hand. RT: `advance` is safe; everything is allocated by [`GripPlant::new`].
#[derive(Clone, Debug)]
pub(crate) struct GripPlant {
    period_s: f64,
    translation: Body,
    rotation: Body,
    hand: HandControl,
    /// True pose, `device_from_grip`.
    pose: Pose,
    /// True twist, device axes, at the grip point.
    twist: Twist,
}

impl GripPlant {
    /// A grip at rest at its zero pose, with the hand where its path begins. RT: start-up only.
    ///
    /// # Errors
    /// A value that the plant's step cannot follow.
    pub(crate) fn new(
        period_s: f64,
        plant: &profile::Plant,
        hand: Option<HandParameters>,
        sensed: Axes,
    ) -> Result<Self, SimError> {
        let held = hand.is_some();
        let hand = hand.unwrap_or_default();
        let of_hand = |value: f64| if held { value } else { 0.0 };
        check_plant(period_s, plant, &hand)?;
        let translation = Body {
            inertia: plant.mass_kg + of_hand(hand.mass_kg),
            damping: plant.damping_n_s_per_m,
            coulomb: plant.coulomb_n,
            hand_stiffness: of_hand(hand.stiffness_n_per_m),
            hand_damping: of_hand(hand.damping_n_s_per_m),
            free_axes: sensed.linear_mask(),
        };
        let rotation = Body {
            inertia: plant.inertia_kg_m2 + of_hand(hand.inertia_kg_m2),
            damping: plant.damping_nm_s_per_rad,
            coulomb: plant.coulomb_nm,
            hand_stiffness: of_hand(hand.stiffness_nm_per_rad),
            hand_damping: of_hand(hand.damping_nm_s_per_rad),
            free_axes: sensed.angular_mask(),
        };
        let h = period_s / f64::from(SUBSTEPS);
        for (name, body) in
            [("hand_stiffness_n_per_m", translation), ("hand_stiffness_nm_per_rad", rotation)]
        {
            let largest = STIFFEST_STEP * body.inertia / (h * h);
            if body.hand_stiffness > largest {
                return Err(SimError::TooStiff { name, value: body.hand_stiffness, largest });
            }
        }
        let hand = HandControl::new(if held { hand.path } else { None });
        Ok(Self { period_s, translation, rotation, hand, pose: Pose::IDENTITY, twist: Twist::ZERO })
    }

    /// Puts the grip at rest at the given place. The path of the hand counts from there.
    pub(crate) fn rest_at(&mut self, device_from_grip: Pose) {
        self.pose = device_from_grip;
        self.twist = Twist::ZERO;
        self.hand.rest_at(device_from_grip);
    }

    /// What moves the hand.
    pub(super) fn hand(&mut self) -> &mut HandControl {
        &mut self.hand
    }

    /// True grip pose, `device_from_grip`.
    pub(crate) fn pose(&self) -> Pose {
        self.pose
    }

    /// True twist of the grip point, device axes.
    pub(crate) fn twist(&self) -> Twist {
        self.twist
    }

    /// Sets the grip in motion.
    #[cfg(test)]
    pub(super) fn set_twist(&mut self, twist: Twist) {
        self.twist = twist;
    }

    fn drift(&mut self, time_s: f64) {
        self.pose = self.pose.stepped(self.twist.linear * time_s, self.twist.angular * time_s);
    }

    /// Moves the grip by one period, in [`SUBSTEPS`] steps, under a wrench of the motors: device
    /// axes, at the grip point. `start_s`: time of the hand's path at its beginning.
    pub(crate) fn advance(&mut self, start_s: f64, command: &Wrench) {
        let h = self.period_s / f64::from(SUBSTEPS);
        self.hand.begin(self.period_s);
        for substep in 1..=SUBSTEPS {
            let before = self.hand.target();
            let target = self.hand.next(start_s + f64::from(substep) * h, h);
            let target_velocity = (target.translation - before.translation) / h;
            let target_spin = before.rotation_to(target) / h;
            self.drift(0.5 * h);
            let stretch = before.translation.midpoint(target.translation) - self.pose.translation;
            let twist_stretch = self.pose.rotation_to(before) + target_spin * (0.5 * h);
            self.twist.linear = self.translation.step(
                self.twist.linear,
                command.force,
                stretch,
                target_velocity,
                h,
            );
            self.twist.angular = self.rotation.step(
                self.twist.angular,
                command.torque,
                twist_stretch,
                target_spin,
                h,
            );
            self.drift(0.5 * h);
        }
    }
}
