//! Passivity controller: takes out of the motion what the loop has put into it.
//!
//! Data in: the wrench that the coupling wants, the motion of the port, the command that was
//! written. Data out: that wrench, with damping added only where the port would otherwise have
//! given the hand more than it took.
//!
//! Energy is counted over what is known exactly: the command that acted (held for a tick, `delay`
//! ticks on its way) and the displacement over which it acted. The velocity, a difference over a
//! window and late, only says which way to damp and how much. Where it says nothing, between two
//! steps of the encoder, an arm that has given too much is weakened instead.
//!
//! # Source
//! HannafordRyu2002, observer and controller of one port in impedance form: E_k = E_(k−1) + T (F_k
//! v_k + a_(k−1) v_(k−1)²), a_k = −E_k/(T v_k²). Counting over displacements, one scalar energy for
//! six axes, the delay line, the forgotten credit and the weakened wrench are ours.

use glam::DVec3;

use super::damper;
use super::params::{ArmParameters, LimitParameters};
use vps::spatial::{Pose, Twist, Wrench};

/// Longest delay for which the command that acted is known, ticks; a longer one counts as this
/// long.
pub(super) const MAX_DELAY_TICKS: u32 = 255;

/// Commands that are remembered.
const N_HELD: usize = MAX_DELAY_TICKS as usize + 1;

/// Time without force after which energy that the hand has left in the port is no longer a credit,
/// s. Otherwise an hour of friction would pay for a minute of trembling.
const FORGET_AFTER_S: f64 = 0.01;

/// Ticks over which the pose itself says whether the hand has turned round: a velocity of a window
/// of 15 ms says so 7.5 ms late.
const TRAIL_TICKS: usize = 6;

/// What the spring may hold beyond the energy that the hand has put in before it is damped, J.
pub(super) const LENT_FREELY_J: f64 = 2e-4;

/// Energy that may be owed without consequences, J: contact that ends leaves so much behind.
const OWED_FREELY_J: f64 = 5e-4;
/// What is left of the wrench however much is owed: a wall stays a wall.
const LEAST_SHARE: f64 = 0.25;

/// Time at rest after which what is missing begins to be forgiven, s, and the time constant in
/// which it is: a hand that rests in contact would feel a part of it for ever.
const REST_S: f64 = 0.2;
const FORGIVEN_IN_S: f64 = 0.25;

/// Displacement in a tick that is none, m and rad: 0.1 mm/s at 1 kHz.
const STILL_M: f64 = 1e-7;
const STILL_RAD: f64 = 1e-6;

/// Nothing is forgiven to a port that has given more than this, J: trembling that rests in between
/// would give without end. What then may still be given makes a millijoule in all.
const FORGIVES_ABOVE_J: f64 = -6e-4;

/// Observer and controller of one port. 24 KiB, no heap. Wrench, twist and pose are those of the
/// grip in device axes.
#[derive(Clone, Debug)]
pub(super) struct PassivityController {
    /// What the hand has put into the arm less what it got back since [`reset`](Self::reset), J: of
    /// a passive port that began relaxed never below zero.
    pub(super) energy_j: f64,
    /// The observed energy without forgotten credit, J: never above it.
    budget_j: f64,
    /// `[N_HELD]`, ring of commands; `newest` was written in the last tick.
    held: [Wrench; N_HELD],
    newest: usize,
    last_pose: Option<Pose>,
    /// `[TRAIL_TICKS]`, ring of displacements, m and rad; `newest_way` is that of the last tick.
    trail: [Twist; TRAIL_TICKS],
    newest_way: usize,
    quiet_s: f64,
    /// Time since the port last moved, s.
    still_s: f64,
    /// The last [`damped`](Self::damped) injected damping.
    pub(super) is_active: bool,
    /// What the spring held at the last [`damped`](PassivityController::damped), J.
    held_j: f64,
    /// Energy that moving obstacles have put in since [`reset`](Self::reset), less what they took,
    /// J.
    pub(super) carried_j: f64,
    /// What the last [`damped`](PassivityController::damped) added.
    injected: Wrench,
    /// `[N_HELD]`, as `held`: the commands without what was injected, which is all that an obstacle
    /// can push with.
    coupled: [Wrench; N_HELD],
}

impl Default for PassivityController {
    fn default() -> Self {
        Self {
            energy_j: 0.0,
            budget_j: 0.0,
            held: [Wrench::ZERO; N_HELD],
            newest: 0,
            last_pose: None,
            trail: [Twist::ZERO; TRAIL_TICKS],
            newest_way: 0,
            quiet_s: 0.0,
            still_s: 0.0,
            is_active: false,
            held_j: 0.0,
            carried_j: 0.0,
            injected: Wrench::ZERO,
            coupled: [Wrench::ZERO; N_HELD],
        }
    }
}

impl PassivityController {
    /// Counts the energy of the interval that ends with this sample: the displacement since the
    /// last one, times the command that was written `delay_ticks` before the newest. The first call
    /// only takes the pose. Returns the energy that the command put into the hand in that interval,
    /// J. RT: safe, O(1).
    pub(super) fn observe(&mut self, pose: Pose, delay_ticks: u32, period_s: f64) -> f64 {
        let Some(last) = self.last_pose.replace(pose) else { return 0.0 };
        let acted = self.of(&self.held, delay_ticks);
        let before_j = self.energy_j;
        let way =
            Twist { linear: pose.translation - last.translation, angular: last.rotation_to(pose) };
        self.newest_way = (self.newest_way + 1) % TRAIL_TICKS;
        if let Some(slot) = self.trail.get_mut(self.newest_way) {
            *slot = way;
        }
        // Exact for the force, as the energy of a held force depends on the displacement alone; for
        // the torque where the turn is small. On what is not finite the finite check faults.
        let absorbed_j = -acted.power(way);
        if absorbed_j.is_finite() {
            self.energy_j += absorbed_j;
        }
        self.budget_j += self.energy_j - before_j;
        self.quiet_s = if acted == Wrench::ZERO { self.quiet_s + period_s } else { 0.0 };
        if self.quiet_s > FORGET_AFTER_S {
            self.budget_j = self.budget_j.min(0.0);
        }
        let is_still = way.linear.length() <= STILL_M && way.angular.length() <= STILL_RAD;
        self.still_s = if is_still { self.still_s + period_s } else { 0.0 };
        if self.still_s > REST_S && self.energy_j > FORGIVES_ABOVE_J {
            self.forgive(period_s);
        }
        before_j - self.energy_j
    }

    /// Lets what is missing fade, from the most that weakens the wrench further: of forgotten
    /// credit as much comes back as the spring holds, else what is owed beyond what is free.
    fn forgive(&mut self, period_s: f64) {
        let rests_at_j = self.energy_j.min(self.held_j).max(-OWED_FREELY_J);
        let weakest_j = OWED_FREELY_J * (LEAST_SHARE - 2.0);
        let missing_j = rests_at_j - self.budget_j.max(weakest_j);
        if missing_j > 0.0 {
            let left = (1.0 - period_s / FORGIVEN_IN_S).max(0.0);
            self.budget_j = rests_at_j - missing_j * left;
        }
    }

    /// Takes note, after [`observe`](Self::observe), of how obstacles that move carry the port
    /// (device axes, m and rad in this tick).
    ///
    /// An obstacle is moved by a power of its own: what the coupling's command of `delay_ticks` ago
    /// does over the obstacle's way goes into the spring or the hand and is no debt, and what the
    /// hand gives to one that recedes is not there any more. It makes a credit of `spring_j` at
    /// most, what the spring can hold, so that an arm that does not give way saves nothing up; and
    /// it never makes a debt. RT: safe, O(1).
    pub(super) fn carry(&mut self, moved: DVec3, turned: DVec3, delay_ticks: u32, spring_j: f64) {
        let acted = self.of(&self.coupled, delay_ticks);
        let work_j = acted.force.dot(moved) + acted.torque.dot(turned);
        // A NaN counts for nothing.
        if !work_j.is_finite() {
            return;
        }
        self.carried_j += work_j;
        let carried_j = self.budget_j + work_j;
        self.budget_j = if work_j > 0.0 {
            carried_j.min(spring_j).max(self.budget_j)
        } else {
            carried_j.max(0.0).min(self.budget_j)
        };
    }

    /// The wrench on the hand: `wanted`, whose spring holds `held_j`, plus a damper against `twist`
    /// where `wanted` would drive the energy below zero, or where the spring holds more than the
    /// hand has put in. So much that neither is so after this tick, at most the arm's `injected_*`
    /// and the force limits.
    ///
    /// A held, late force takes too little from a hand that goes in and gives too much to one that
    /// comes out. Waiting until more was given than taken is waiting until the spring is nearly let
    /// go, when no damper is strong enough. What it holds says at once what will be missing, so
    /// most of it is paid on the way in.
    ///
    /// A component along which the pose itself goes the other way by now does not count: the
    /// velocity is late.
    ///
    /// Each component of the velocity counts only as far as it exceeds what one step of the encoder
    /// makes of it: below, it says nothing of the direction, and a damper that follows it drives
    /// the arm. (On an encoder of 0.04 mm and a window of 15 ms, a loose hand trembled with 2.4
    /// mm/s for that alone, and 0.35 N.)
    ///
    /// No wrench, no damper: free space stays free, and what is owed there is paid in the next
    /// contact. RT: safe, O(1). Input that is not finite passes through, for the finite check to
    /// see.
    pub(super) fn damped(
        &mut self,
        (wanted, held_j): (Wrench, f64),
        twist: Twist,
        arm: &ArmParameters,
        limits: &LimitParameters,
        period_s: f64,
    ) -> Wrench {
        self.is_active = false;
        self.injected = Wrench::ZERO;
        self.held_j = held_j;
        let missing_j =
            (period_s * wanted.power(twist)).max(held_j - LENT_FREELY_J) - self.budget_j;
        let certain = damper::certain(twist, arm);
        let way = self.trail.iter().fold(Twist::ZERO, |sum, way| sum + *way);
        let sure = Twist {
            linear: agreeing(certain.linear, way.linear),
            angular: agreeing(certain.angular, way.angular),
        };
        let damper = Wrench::new(
            sure.linear * -arm.injected_n_s_per_m,
            sure.angular * -arm.injected_nm_s_per_rad,
        );
        let largest_j = -period_s * damper.power(sure);
        // Written so that a NaN injects nothing.
        if !(missing_j > 0.0 && largest_j > 0.0 && largest_j.is_finite()) || wanted == Wrench::ZERO
        {
            return wanted;
        }
        self.is_active = true;
        let damper = damper * (missing_j / largest_j).min(1.0);
        let within =
            |length: f64, limit: f64| if length > limit { (limit / length).max(0.0) } else { 1.0 };
        self.injected = Wrench::new(
            damper.force * within(damper.force.length(), limits.force_n),
            damper.torque * within(damper.torque.length(), limits.torque_nm),
        );
        wanted + self.injected
    }

    /// Share of the wanted wrench that the arm gets while energy is owed: all of it up to half a
    /// millijoule, then less and less, so that a loop which cannot be damped (motion within a step
    /// of the encoder has no velocity) is weakened until it rests. An arm that takes no damping
    /// gets all of it: it is not watched. RT: safe, O(1).
    pub(super) fn trusted_share(&self, arm: &ArmParameters) -> f64 {
        let over = (-self.budget_j - OWED_FREELY_J) / OWED_FREELY_J;
        // Written so that a NaN weakens nothing: the finite check sees it elsewhere.
        if damper::can_damp(arm) && over > 0.0 { (1.0 - over).max(LEAST_SHARE) } else { 1.0 }
    }

    /// Notes the command that was written. RT: safe.
    pub(super) fn hold(&mut self, command: Wrench) {
        self.newest = (self.newest + 1) % N_HELD;
        if let Some(slot) = self.held.get_mut(self.newest) {
            *slot = command;
        }
        if let Some(slot) = self.coupled.get_mut(self.newest) {
            *slot = command - core::mem::take(&mut self.injected);
        }
    }

    /// At the last [`damped`](Self::damped) the hand had put in what the spring held, or that was
    /// little. True for an arm that is not watched. RT: safe.
    pub(super) fn is_paid(&self, arm: &ArmParameters) -> bool {
        !(damper::can_damp(arm) && self.held_j - LENT_FREELY_J > self.budget_j.max(0.0))
    }

    /// Starts again from zero.
    pub(super) fn reset(&mut self) {
        *self = Self::default();
    }

    fn of(&self, ring: &[Wrench; N_HELD], delay_ticks: u32) -> Wrench {
        let back = delay_ticks.min(MAX_DELAY_TICKS) as usize;
        ring.get((self.newest + N_HELD - back) % N_HELD).copied().unwrap_or(Wrench::ZERO)
    }
}

/// The components of a velocity that the way does not contradict. A NaN stays one.
fn agreeing(velocity: DVec3, way: DVec3) -> DVec3 {
    DVec3::select((velocity * way).cmplt(DVec3::ZERO), DVec3::ZERO, velocity)
}

#[cfg(test)]
#[expect(
    clippy::disallowed_types,
    clippy::disallowed_macros,
    clippy::indexing_slicing,
    reason = "test code"
)]
mod tests {
    use super::*;
    use crate::stability::SampledWall;
    use crate::testing::parameters;
    use vps::spatial::testing::Random;

    const PERIOD_S: f64 = 1e-3;

    fn free() -> LimitParameters {
        LimitParameters { force_n: f64::INFINITY, torque_nm: f64::INFINITY, ..parameters().limits }
    }

    fn injecting(injected_n_s_per_m: f64) -> ArmParameters {
        ArmParameters {
            injected_n_s_per_m,
            injected_nm_s_per_rad: 1e-3 * injected_n_s_per_m,
            ..ArmParameters::default()
        }
    }

    fn at(x_m: f64) -> Pose {
        Pose::from_translation(DVec3::X * x_m)
    }

    fn along(speed_m_per_s: f64) -> Twist {
        Twist { linear: DVec3::X * speed_m_per_s, angular: DVec3::ZERO }
    }

    fn push(force_n: f64) -> Wrench {
        Wrench::new(DVec3::X * force_n, DVec3::ZERO)
    }

    /// A port that stands at zero.
    fn started() -> PassivityController {
        let mut controller = PassivityController::default();
        controller.observe(at(0.0), 0, PERIOD_S);
        controller
    }

    /// A port that such a force has driven by so much.
    fn driven(force_n: f64, way_m: f64) -> PassivityController {
        let mut controller = started();
        controller.hold(push(force_n));
        controller.observe(at(way_m), 0, PERIOD_S);
        controller
    }

    impl PassivityController {
        /// The wrench along x that such a wanted force becomes at a speed, without limits.
        fn damps(&mut self, wanted_n: f64, speed_m_per_s: f64, arm: &ArmParameters) -> Wrench {
            self.damps_spring(wanted_n, 0.0, speed_m_per_s, arm)
        }

        /// The same of the force of a spring that holds so much.
        fn damps_spring(
            &mut self,
            wanted_n: f64,
            held_j: f64,
            speed_m_per_s: f64,
            arm: &ArmParameters,
        ) -> Wrench {
            self.damped((push(wanted_n), held_j), along(speed_m_per_s), arm, &free(), PERIOD_S)
        }
    }

    /// Leader (1 kg, 2 N·s/m) and follower (1 kg, 300 N/m, 8 N·s/m) 30 ticks apart each way; the
    /// follower meets a wall of 800 N/m at 50 mm; a hand pushes the leader with 5 N. Position and
    /// velocity go forward, the force comes back. Returns the largest |x| of the leader in 10 s,
    /// its lowest observed energy, and whether damping was ever injected.
    fn teleoperation(arm: &ArmParameters) -> (f64, f64, bool) {
        const DELAY: usize = 30;
        let mut leader = (0.0, 0.0);
        let mut follower = (0.0, 0.0);
        let mut forward = [(0.0, 0.0); DELAY];
        let mut back = [0.0; DELAY];
        let mut controller = PassivityController::default();
        let mut farthest_m = 0.0_f64;
        let mut lowest_j = 0.0_f64;
        let mut injected = false;
        for n in 0..10_000 {
            let (wanted_m, wanted_m_per_s) = core::mem::replace(&mut forward[n % DELAY], leader);
            let spring_n = 300.0 * (wanted_m - follower.0) + 8.0 * (wanted_m_per_s - follower.1);
            let wall_n = if follower.0 > 0.05 { -800.0 * (follower.0 - 0.05) } else { 0.0 };
            follower.1 += PERIOD_S * (spring_n + wall_n);
            follower.0 += PERIOD_S * follower.1;
            let felt_n = -core::mem::replace(&mut back[n % DELAY], spring_n);

            controller.observe(at(leader.0), 0, PERIOD_S);
            let command = controller.damps(felt_n, leader.1, arm);
            controller.hold(command);
            leader.1 += PERIOD_S * (5.0 + command.force.x - 2.0 * leader.1);
            leader.0 += PERIOD_S * leader.1;

            farthest_m = farthest_m.max(leader.0.abs());
            lowest_j = lowest_j.min(controller.energy_j);
            injected |= controller.is_active;
        }
        (farthest_m, lowest_j, injected)
    }

    #[test]
    fn acceptance_24_delayed_teleoperation_diverges_without_and_stays_with_the_controller() {
        let (without_m, without_j, injected) = teleoperation(&injecting(0.0));
        assert!(without_m > 1.0 && without_j < -1.0 && !injected, "{without_m} m, {without_j} J");
        // Damping up to m/T, what stops the leader within one tick.
        let (with_m, with_j, injected) = teleoperation(&injecting(1000.0));
        assert!(with_m < 0.5 && injected, "{with_m} m");
        assert!(with_j > -0.01, "{with_j} J");
        // It still reaches the wall: the controller did not simply hold it.
        assert!(with_m > 0.05, "{with_m} m");
    }

    #[test]
    fn a_passive_port_keeps_its_bits() {
        let mut controller = PassivityController::default();
        let mut wanted_n = 0.0;
        for n in 0..1000 {
            // A damped spring, pressed and let go, ever slower.
            let x_m = 1e-3 * (1.0 - (0.02 * f64::from(n)).cos());
            let speed = 0.02e-3 * (0.02 * f64::from(n)).sin() / PERIOD_S;
            controller.observe(at(x_m), 0, PERIOD_S);
            let damped = controller.damps(wanted_n, speed, &injecting(100.0));
            assert!(damped == push(wanted_n) && !controller.is_active, "tick {n}");
            controller.hold(damped);
            wanted_n = -1000.0 * x_m - 5.0 * speed;
        }
        assert!(controller.energy_j > 0.0);
    }

    #[test]
    fn damping_repays_what_was_given_and_no_more() {
        // 2 N drove the hand by 1 mm: 2 mJ are owed.
        let mut controller = driven(2.0, 1e-3);
        assert!((controller.energy_j + 2e-3).abs() < 1e-15);
        let speed = 1.0;
        let damped = controller.damps(1.0, speed, &injecting(1e6));
        assert!(controller.is_active);
        controller.hold(damped);
        controller.observe(at(1e-3 + speed * PERIOD_S), 0, PERIOD_S);
        assert!(controller.energy_j.abs() < 1e-12, "{} J", controller.energy_j);
    }

    #[test]
    fn an_arm_that_gave_too_much_is_weakened_until_it_is_repaid() {
        let mut controller = started();
        controller.hold(push(1.0));
        for (owed_mj, expected) in
            [(0.1, 1.0), (0.5, 1.0), (0.6, 0.8), (0.75, 0.5), (1.0, 0.25), (5.0, 0.25), (0.2, 1.0)]
        {
            controller.observe(at(1e-3 * owed_mj), 0, PERIOD_S);
            let share = controller.trusted_share(&injecting(5.0));
            assert!((share - expected).abs() < 1e-9, "{owed_mj} mJ: {share}");
            assert!(controller.trusted_share(&injecting(0.0)) == 1.0);
        }
    }

    #[test]
    fn damping_is_bounded_by_the_arm_and_by_the_force_limit() {
        let mut controller = driven(10.0, 0.1);
        let damped = controller.damps(1.0, 0.2, &injecting(5.0));
        assert!((damped.force.x - (1.0 - 5.0 * 0.2)).abs() < 1e-12);
        let limits = LimitParameters { force_n: 0.3, torque_nm: 0.0, ..free() };
        let twist = Twist { linear: DVec3::X * 0.2, angular: DVec3::Y };
        let damped = controller.damped((push(1.0), 0.0), twist, &injecting(5.0), &limits, PERIOD_S);
        assert!((damped.force.x - 0.7).abs() < 1e-12 && damped.torque == DVec3::ZERO, "{damped:?}");
        // At rest there is nothing to damp, and free space stays free.
        for (wanted, twist) in [(push(1.0), Twist::ZERO), (Wrench::ZERO, twist)] {
            let damped =
                controller.damped((wanted, 0.0), twist, &injecting(5.0), &limits, PERIOD_S);
            assert!(damped == wanted && !controller.is_active, "{damped:?}");
        }
    }

    #[test]
    fn a_velocity_that_may_be_rest_is_not_damped() {
        let stepping = ArmParameters {
            velocity_step_m_per_s: 0.1,
            velocity_step_rad_per_s: 2.0,
            ..injecting(5.0)
        };
        let mut controller = driven(10.0, 0.1);
        for twist in
            [along(0.1), along(-0.1), Twist { linear: DVec3::ZERO, angular: DVec3::Y * 2.0 }]
        {
            let damped = controller.damped((push(1.0), 0.0), twist, &stepping, &free(), PERIOD_S);
            assert!(damped == push(1.0) && !controller.is_active, "{damped:?}");
        }
        for speed in [0.3_f64, -0.3] {
            let mut controller = driven(10.0 * speed.signum(), 0.1 * speed.signum());
            let damped = controller.damps(1.0, speed, &stepping);
            let force_n = 1.0 - 5.0 * (speed - speed.signum() * 0.1);
            assert!(controller.is_active && (damped.force.x - force_n).abs() < 1e-12);
        }
    }

    #[test]
    fn what_a_spring_holds_beyond_what_the_hand_put_in_is_paid_on_the_way_in() {
        // Held for a tick and three more on its way, 1 kN/m takes 1 kN/m · 3.5 ms · 0.2 m/s · 50 mm
        // = 35 mJ too little in 50 mm.
        let press = |arm: &ArmParameters| {
            let mut controller = PassivityController::default();
            let mut held_j = 0.0;
            let mut was_active = false;
            for n in 0..=250 {
                let x_m = -2e-4 * f64::from(n);
                controller.observe(at(x_m), 3, PERIOD_S);
                held_j = 0.5 * 1000.0 * x_m * x_m;
                let damped = controller.damps_spring(-1000.0 * x_m, held_j, -0.2, arm);
                controller.hold(damped);
                was_active |= controller.is_active;
            }
            (held_j - controller.energy_j, was_active)
        };
        let (lent_j, was_active) = press(&injecting(0.0));
        assert!((lent_j - 35e-3).abs() < 1e-3 && !was_active, "{lent_j} J");
        let (lent_j, was_active) = press(&injecting(50.0));
        // What the last ticks have lent is on its way.
        assert!(lent_j < LENT_FREELY_J + 1e-3 && was_active, "{lent_j} J");
    }

    #[test]
    fn a_damper_does_not_push_a_hand_that_has_turned_round() {
        // Out since two ticks, while the velocity of the window still goes in.
        let mut controller = driven(1.0, 1e-3);
        controller.observe(at(2e-3), 0, PERIOD_S);
        assert_eq!(controller.damps_spring(1.0, 10e-3, -0.2, &injecting(5.0)), push(1.0));
        assert!(!controller.is_active);
        assert!(controller.damps_spring(1.0, 10e-3, 0.2, &injecting(5.0)).force.x < 1.0);
    }

    #[test]
    fn the_way_of_the_last_six_ticks_says_where_the_hand_goes() {
        let mut controller = started();
        controller.observe(at(10e-3), 0, PERIOD_S);
        // Back by 1 mm a tick: 10 − n mm out over six ticks, and −6 mm once the 10 mm are older.
        for n in 1..=6 {
            controller.observe(at(1e-3 * f64::from(10 - n)), 0, PERIOD_S);
            controller.damps_spring(1.0, 10e-3, 0.2, &injecting(5.0));
            assert_eq!(controller.is_active, n <= 5, "{n}");
        }
    }

    #[test]
    fn the_command_that_acted_is_the_one_that_had_arrived() {
        for delay_ticks in [0, 1, 5, MAX_DELAY_TICKS] {
            let mut controller = PassivityController::default();
            controller.observe(at(0.0), delay_ticks, PERIOD_S);
            for n in 0..200 {
                controller.hold(push(f64::from(n)));
                let before_j = controller.energy_j;
                controller.observe(at(1e-3 * f64::from(n + 1)), delay_ticks, PERIOD_S);
                let acted_n = (f64::from(n) - f64::from(delay_ticks)).max(0.0);
                assert!(
                    (before_j - controller.energy_j - 1e-3 * acted_n).abs() < 1e-9,
                    "tick {n}, delay {delay_ticks}"
                );
            }
        }
    }

    #[test]
    fn credit_is_forgotten_without_force_and_debt_is_not() {
        for (sign, owed) in [(-1.0, false), (1.0, true)] {
            let mut controller = driven(sign, 1e-3);
            let energy_j = controller.energy_j;
            for _ in 0..20 {
                controller.hold(Wrench::ZERO);
                controller.observe(at(1e-3), 0, PERIOD_S);
            }
            assert_eq!(controller.energy_j, energy_j, "what is reported is not forgotten");
            controller.damps(1.0, 0.5, &injecting(5.0));
            assert!(controller.is_active, "{owed}: nothing is left to pay with");
            let damped = controller.damps(1.0, 0.5, &injecting(1e6));
            let taken_j = PERIOD_S * 0.5 * (1.0 - damped.force.x);
            let expected_j = PERIOD_S * 0.5 + if owed { 1e-3 } else { 0.0 };
            assert!((taken_j - expected_j).abs() < 1e-12, "{taken_j} J");
        }
    }

    /// A spring of 1 kN/m that is pressed by a wall that goes to `wall_m`, while the hand is at
    /// `hand_m`; gives the controller after that.
    fn pushed(steps: impl Iterator<Item = (f64, f64)>) -> PassivityController {
        let mut controller = started();
        let mut last_m = 0.0;
        for (wall_m, hand_m) in steps {
            controller.observe(at(hand_m), 0, PERIOD_S);
            controller.carry(DVec3::X * (wall_m - last_m), DVec3::ZERO, 0, SPRING_J);
            last_m = wall_m;
            controller.hold(push(1000.0 * (wall_m - hand_m)));
        }
        controller
    }

    /// What 10 N hold in it.
    const SPRING_J: f64 = 0.5 * 10.0 * 0.01;

    #[test]
    fn the_work_of_a_wall_that_moves_is_no_debt() {
        // The wall goes ahead by 4 mm, and takes the hand 46 mm along.
        let way_m = |n: u32| 1e-4 * f64::from(n);
        let mut controller = pushed((0..500).map(|n| (way_m(n), way_m(n.saturating_sub(40)))));
        assert!(controller.energy_j < -0.15, "{} J: the wall did no work", controller.energy_j);
        // What is left is in the spring.
        let left_j = controller.energy_j + controller.carried_j;
        assert!((left_j - 0.5 * 4.0 * 4e-3).abs() < 1e-3, "{left_j} J");
        controller.damps(1.0, 0.01, &injecting(5.0));
        assert!(!controller.is_active, "nothing is owed");
        // The same without the wall's account is a debt.
        let mut blind = PassivityController::default();
        for n in 0..500_u32 {
            blind.observe(at(way_m(n.saturating_sub(40))), 0, PERIOD_S);
            blind.hold(push(1000.0 * (way_m(n) - way_m(n.saturating_sub(40)))));
        }
        blind.damps(1.0, 0.01, &injecting(5.0));
        assert!(blind.is_active);
    }

    #[test]
    fn a_wall_makes_no_credit_beyond_what_the_spring_holds_and_no_debt() {
        // 100 mm against a hand that does not give way, and back again.
        let mut controller = pushed((0..1000).map(|n| (1e-4 * f64::from(n), 0.0)));
        let damped = controller.damps(1.0, 1000.0, &injecting(1e9));
        let taken_j = PERIOD_S * 1000.0 * (1.0 - damped.force.x);
        assert!((taken_j - (1.0 - SPRING_J)).abs() < 1e-9, "a credit of {} J", 1.0 - taken_j);
        let mut controller =
            pushed((0..2000_u32).map(|n| (1e-4 * f64::from(n.min(2000 - n)), 0.0)));
        controller.damps(1e-6, 1e-9, &injecting(5.0));
        let damped = controller.damps(1.0, 1.0, &injecting(1e9));
        assert!(PERIOD_S * (1.0 - damped.force.x) < 2e-3, "a debt without any flow");
        for nan in [f64::NAN, f64::INFINITY] {
            controller.carry(DVec3::X * nan, DVec3::ZERO, 0, SPRING_J);
            assert!(controller.carried_j.is_finite());
        }
    }

    #[test]
    fn what_is_not_finite_passes_through_and_leaves_no_trace() {
        let mut controller = started();
        let poisoned = controller.damps(f64::NAN, 0.1, &injecting(5.0));
        assert!(!poisoned.is_finite() && !controller.is_active);
        assert_eq!(controller.damps(1.0, f64::NAN, &injecting(5.0)), push(1.0));
        controller.observe(at(f64::NAN), 0, PERIOD_S);
        assert_eq!(controller.energy_j, 0.0);
    }

    #[test]
    fn a_turn_that_gave_energy_is_damped_against_its_direction() {
        let about = DVec3::new(1.0, -2.0, 2.0) / 3.0;
        let turned = |rad: f64| Pose::new(glam::DQuat::from_scaled_axis(about * rad), DVec3::ZERO);
        let mut controller = started();
        controller.hold(Wrench::new(DVec3::ZERO, about * 0.05));
        // 0.05 N·m drove it by 0.02 rad: 1 mJ is owed.
        let given_j = controller.observe(turned(0.02), 0, PERIOD_S);
        assert!((given_j - 1e-3).abs() < 1e-12 && (controller.energy_j + 1e-3).abs() < 1e-12);
        let wanted = Wrench::new(DVec3::ZERO, about * 0.01);
        let twist = Twist { linear: DVec3::ZERO, angular: about * 20.0 };
        let arm = ArmParameters { injected_nm_s_per_rad: 0.01, ..ArmParameters::default() };
        let damped = controller.damped((wanted, 0.0), twist, &arm, &free(), PERIOD_S);
        // 0.2 mJ that the tick would give besides; 0.01 N·m·s/rad take 4 mJ in it.
        let share = (1e-3 + 0.01 * 20.0 * PERIOD_S) / (0.01 * 400.0 * PERIOD_S);
        let torque = about * (0.01 - 0.01 * 20.0 * share);
        assert!((damped.torque - torque).length() < 1e-9, "{damped:?} {torque}");
        assert!(controller.is_active && (controller.trusted_share(&arm) - 0.25).abs() < 1e-9);
        controller.reset();
        assert_eq!((controller.energy_j, controller.is_active), (0.0, false));
        assert_eq!(controller.trusted_share(&arm), 1.0);
    }

    /// A port that has taken so much and forgotten it, then given so much, J.
    fn owing(taken_j: f64, given_j: f64) -> PassivityController {
        let mut controller = driven(-1.0, taken_j);
        controller.hold(Wrench::ZERO);
        (0..20).for_each(|_| {
            controller.observe(at(taken_j), 0, PERIOD_S);
        });
        controller.hold(push(1.0));
        controller.observe(at(taken_j + given_j), 0, PERIOD_S);
        controller
    }

    #[test]
    fn a_debt_is_forgiven_at_rest_as_long_as_the_port_has_not_given_too_much() {
        let arm = injecting(5.0);
        // What goes on at so much a tick, and the share after two seconds.
        for (taken_j, goes_m, forgiven) in
            [(2e-3, 0.0, true), (3e-4, 0.0, true), (2e-3, 2e-7, false), (1e-4, 0.0, false)]
        {
            let mut controller = owing(taken_j, 8e-4);
            assert!((controller.trusted_share(&arm) - 0.4).abs() < 1e-9);
            let mut place_m = taken_j + 8e-4;
            let mut shares = Vec::new();
            for _ in 0..2000 {
                place_m += goes_m;
                // Nothing acts, so that nothing more is owed.
                controller.hold(push(if goes_m == 0.0 { 1.0 } else { 0.0 }));
                controller.observe(at(place_m), 0, PERIOD_S);
                shares.push(controller.trusted_share(&arm));
            }
            let what = format!("{taken_j} J taken, {goes_m} m a tick");
            assert!(shares.iter().take(199).all(|share| (share - 0.4).abs() < 1e-9), "{what}");
            assert!(shares.is_sorted(), "{what}");
            assert_eq!(shares.last().is_some_and(|share| *share > 0.99), forgiven, "{what}");
        }
    }

    #[test]
    fn at_rest_a_spring_is_paid_by_what_the_port_has_taken() {
        let arm = injecting(5.0);
        for (taken_j, is_paid) in [(3e-3, true), (1e-3, false)] {
            let mut controller = owing(taken_j, 8e-4);
            for _ in 0..2000 {
                controller.damps_spring(-1.0, 1.5e-3, 0.0, &arm);
                controller.observe(at(taken_j + 8e-4), 0, PERIOD_S);
            }
            // 1.5 mJ are held, and a quarter of a millijoule is lent.
            assert_eq!(controller.is_paid(&arm), is_paid, "{taken_j}");
        }
    }

    #[test]
    fn however_much_is_owed_two_seconds_of_rest_are_enough() {
        let mut controller = owing(50e-3, 40e-3);
        let arm = injecting(5.0);
        assert_eq!(controller.trusted_share(&arm), LEAST_SHARE);
        (0..2000).for_each(|_| {
            controller.observe(at(90e-3), 0, PERIOD_S);
        });
        assert!(controller.trusted_share(&arm) > 0.99);
    }

    #[test]
    fn what_a_spring_holds_is_paid_when_the_hand_has_put_it_in() {
        let arm = injecting(5.0);
        // The hand puts 2 mJ in, and 0.2 mJ are lent.
        let mut controller = driven(-2.0, 1e-3);
        for (held_j, is_paid) in [(2.15e-3, true), (2.25e-3, false)] {
            controller.damps_spring(-2.0, held_j, 0.0, &arm);
            assert_eq!(controller.is_paid(&arm), is_paid, "{held_j}");
            assert!(controller.is_paid(&injecting(0.0)), "an arm that is not watched");
            let turns = ArmParameters { injected_n_s_per_m: 0.0, ..arm };
            assert_eq!(controller.is_paid(&turns), is_paid, "{held_j}");
        }
        let mut owes = driven(2.0, 1e-3);
        owes.damps_spring(-2.0, 2e-4, 0.0, &arm);
        assert!(owes.is_paid(&arm), "so little is lent whatever is owed");
    }

    #[test]
    fn an_obstacle_pushes_with_what_the_coupling_wants_and_not_with_what_was_injected() {
        let mut controller = driven(10.0, 0.01);
        let limits = LimitParameters { force_n: 0.7, ..free() };
        let damped =
            controller.damped((push(2.0), 0.0), along(0.5), &injecting(5.0), &limits, PERIOD_S);
        // 2.5 N of damping, of which the limit leaves 0.7 N.
        assert!((damped.force.x - 1.3).abs() < 1e-12, "{damped:?}");
        controller.hold(damped);
        controller.carry(DVec3::X * 3e-3, DVec3::ZERO, 0, 1.0);
        assert!((controller.carried_j - 6e-3).abs() < 1e-15, "{}", controller.carried_j);
    }

    const MASS_KG: f64 = 0.04;
    const DEVICE_DAMPING: f64 = 0.8;
    const N_TICKS: usize = 400;

    /// A sampled wall on a damped mass. The port lies between mass and hand, the mass's own energy
    /// is known exactly.
    #[derive(Default)]
    struct PassivePort {
        stiffness: f64,
        wall_damping: f64,
        device_damping: f64,
        x: f64,
        v: f64,
        x_before: f64,
        wall_force: f64,
        /// Where the hand would be if it had made every way with the same port.
        hand: f64,
        controller: PassivityController,
        lowest_j: f64,
        /// Lowest energy that wall and damper alone have absorbed: the hand's minus the mass's.
        lowest_without_mass_j: f64,
    }

    impl PassivePort {
        fn new(stiffness: f64, wall_damping: f64, device_damping: f64) -> Self {
            let controller = started();
            Self { stiffness, wall_damping, device_damping, controller, ..Self::default() }
        }

        /// The wall samples the position and holds its force from now on.
        fn sample(&mut self) {
            self.wall_force =
                -self.stiffness * self.x - self.wall_damping * (self.x - self.x_before) / PERIOD_S;
            self.x_before = self.x;
        }

        /// Constant hand force for a while: exact solution of m x'' + b x' = F.
        fn push(&mut self, hand_force: f64, duration_s: f64) {
            let decay = (-self.device_damping * duration_s / MASS_KG).exp();
            let terminal = (hand_force + self.wall_force) / self.device_damping;
            let moved = terminal * duration_s
                + (self.v - terminal) * (1.0 - decay) * MASS_KG / self.device_damping;
            self.v = terminal + (self.v - terminal) * decay;
            self.x += moved;
            self.absorb(-hand_force, moved);
        }

        /// The hand strikes the mass to that velocity: an impulse, whose energy is its mean
        /// velocity times the impulse.
        fn strike_to(&mut self, velocity: f64) {
            let impulse = MASS_KG * (velocity - self.v);
            let mean = 0.5 * (velocity + self.v);
            self.v = velocity;
            self.absorb(-impulse, mean);
        }

        fn absorb(&mut self, force_on_hand: f64, moved: f64) {
            self.hand += moved;
            self.controller.hold(push(force_on_hand));
            self.controller.observe(at(self.hand), 0, PERIOD_S);
            let energy = self.controller.energy_j;
            self.lowest_j = self.lowest_j.min(energy);
            self.lowest_without_mass_j =
                self.lowest_without_mass_j.min(energy - 0.5 * MASS_KG * self.v * self.v);
        }
    }

    /// One random hand: noise, sinusoids up to past the sampling rate, strikes at and between
    /// samples, in random proportions.
    fn random_run(port: &mut PassivePort, random: &mut Random) {
        const PARTS: usize = 5;
        let noise = random.signed().max(0.0);
        let wave = random.signed().max(0.0) * 5.0;
        let strikes = random.signed();
        let angle = random.signed() * 1.2 * core::f64::consts::PI;
        let phase = random.signed() * 3.0;
        for tick_idx in 0..N_TICKS {
            port.sample();
            for part_idx in 0..PARTS {
                if strikes > 0.0 && random.signed() > strikes {
                    let velocity = random.signed() * 0.2;
                    port.strike_to(velocity);
                }
                let when = tick_idx as f64 + part_idx as f64 / PARTS as f64;
                let force = noise * random.signed() * 10.0 + wave * (angle * when + phase).sin();
                port.push(force, PERIOD_S / PARTS as f64);
            }
        }
    }

    /// The hand forces a sinusoidal sequence of velocities, each one nearly constant over its
    /// period (the motion that a damper punishes least). At the Nyquist frequency the signs
    /// alternate.
    fn forced_run(port: &mut PassivePort, angle: f64, n_ticks: usize) {
        for tick_idx in 0..n_ticks {
            port.sample();
            let velocity = 0.1 * (angle * (tick_idx as f64 + 0.5)).sin();
            // Against wall and damper the hand holds its velocity; strikes join the periods.
            port.strike_to(velocity);
            port.push(port.device_damping * velocity - port.wall_force, PERIOD_S);
        }
    }

    /// Walls with the given wall damping, at a multiple of the damping that the condition b >
    /// KT/2 + |B| asks for.
    fn port_at(wall_damping: f64, damping_factor: f64) -> PassivePort {
        let wall = SampledWall {
            mass_kg: MASS_KG,
            damping_n_s_per_m: DEVICE_DAMPING,
            wall_damping_n_s_per_m: wall_damping,
            period_s: PERIOD_S,
            delay_ticks: 0,
            filter_alpha: 0.0,
        };
        PassivePort::new(wall.passive_stiffness(), wall_damping, damping_factor * DEVICE_DAMPING)
    }

    #[test]
    fn acceptance_21_the_observer_never_goes_below_zero_when_the_damping_condition_holds() {
        let mut random = Random(7);
        let mut exercised = 0;
        for run_idx in 0..1500 {
            let mut port = port_at([0.0, 0.2, 0.4][run_idx % 3], 1.001);
            random_run(&mut port, &mut random);
            // Rounding of a sum of N_TICKS terms of a few J.
            assert!(port.lowest_j >= -1e-13, "run {run_idx}: {} J", port.lowest_j);
            assert!(
                port.lowest_without_mass_j >= -1e-13,
                "run {run_idx}: {} J without the mass",
                port.lowest_without_mass_j
            );
            exercised += u32::from(port.controller.energy_j > 1e-3);
        }
        assert!(exercised > 1000, "only {exercised} runs moved any energy");
        for wall_damping in [0.0, 0.2, 0.4] {
            for step_idx in 1..=200 {
                let mut port = port_at(wall_damping, 1.001);
                forced_run(&mut port, core::f64::consts::PI * f64::from(step_idx) / 200.0, 2000);
                assert!(
                    port.lowest_without_mass_j >= -1e-13,
                    "step {step_idx}: {} J",
                    port.lowest_without_mass_j
                );
            }
        }
    }

    #[test]
    fn acceptance_21_a_counterexample_is_found_when_the_condition_is_violated_by_a_tenth() {
        for wall_damping in [0.0, 0.2, 0.4] {
            let (angle, lowest_j) = (1..=200)
                .map(|step_idx| {
                    let angle = core::f64::consts::PI * f64::from(step_idx) / 200.0;
                    let mut port = port_at(wall_damping, 0.9);
                    forced_run(&mut port, angle, 2000);
                    (angle, port.lowest_j)
                })
                .min_by(|a, b| a.1.total_cmp(&b.1))
                .unwrap_or_default();
            assert!(
                lowest_j < -1e-4,
                "B {wall_damping}: the worst of 200 frequencies left {lowest_j} J"
            );
            if wall_damping > 0.0 {
                assert!(
                    angle > 3.0,
                    "B {wall_damping}: worst at {angle}, not at the Nyquist frequency"
                );
            }
        }
    }

    #[test]
    fn a_damper_absorbs_in_all_six_axes() {
        let mut controller = started();
        let linear = DVec3::new(0.1, -0.2, 0.3) * PERIOD_S;
        let angular = DVec3::new(1.0, 2.0, -3.0) * PERIOD_S;
        controller.hold(Wrench::new(linear * -2e3, angular * -500.0));
        controller.observe(Pose::IDENTITY.stepped(linear, angular), 0, PERIOD_S);
        let expected_j = PERIOD_S * (2.0 * 0.14 + 0.5 * 14.0);
        assert!((controller.energy_j - expected_j).abs() < 1e-12, "{}", controller.energy_j);
    }
}
