//! Energy observer: what an arm has taken from the hand so far.
//!
//! Data in: the wrench on the hand and the motion of the port. Data out: an energy. It observes
//! only and changes no force.
//!
//! # Source
//! HannafordRyu2002, one port, the observer E_k = E_(k−1) + T F_k v_k; the form over displacements
//! is ours.

use glam::DVec3;

use vps::spatial::{Twist, Wrench};

/// Energy absorbed at one port, J: what the hand has put into the arm minus what it got back. A
/// passive port, at rest and relaxed at the start, never goes below zero.
///
/// The wrench is the one *on the hand*, so a port absorbs −W · V: a wall that pushes back against
/// the motion counts positive. Wrench and motion share frame and reduction point. RT: safe; a
/// sample that is not finite is left out, as the finite check faults on it elsewhere.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct EnergyObserver {
    energy_j: f64,
    #[cfg(test)]
    lowest_j: f64,
}

impl EnergyObserver {
    /// One tick by power: E ← E − T W·V. Of first order in the period, as V is taken at one
    /// instant.
    #[cfg(test)]
    pub(super) fn observe(&mut self, wrench_on_hand: Wrench, twist: Twist, period_s: f64) -> f64 {
        self.add(-period_s * wrench_on_hand.power(twist))
    }

    /// One interval over which the wrench was held: E ← E − F·Δx − τ·Δθ.
    ///
    /// Exact for the force, as the energy of a held force depends on the displacement alone; for
    /// the torque when Δθ is small.
    pub(super) fn observe_held(
        &mut self,
        wrench_on_hand: Wrench,
        displacement_m: DVec3,
        turn_rad: DVec3,
    ) -> f64 {
        self.add(-wrench_on_hand.power(Twist { linear: displacement_m, angular: turn_rad }))
    }

    /// Energy absorbed since the start, J.
    pub(super) fn energy_j(&self) -> f64 {
        self.energy_j
    }

    /// The lowest energy since the start, J: 0 for a port that has been passive so far.
    #[cfg(test)]
    pub(super) fn lowest_j(&self) -> f64 {
        self.lowest_j
    }

    fn add(&mut self, absorbed_j: f64) -> f64 {
        if absorbed_j.is_finite() {
            self.energy_j += absorbed_j;
            #[cfg(test)]
            {
                self.lowest_j = self.lowest_j.min(self.energy_j);
            }
        }
        self.energy_j
    }
}

#[cfg(test)]
#[expect(clippy::indexing_slicing, reason = "test code")]
mod tests {
    use super::*;
    use crate::stability::SampledWall;
    use vps::spatial::testing::Random;

    const PERIOD_S: f64 = 1e-3;
    const MASS_KG: f64 = 0.04;
    const DEVICE_DAMPING: f64 = 0.8;
    const N_TICKS: usize = 400;

    /// A sampled wall on a damped mass. The port lies between mass and hand, the mass's own energy
    /// is known exactly.
    struct PassivePort {
        stiffness: f64,
        wall_damping: f64,
        device_damping: f64,
        x: f64,
        v: f64,
        x_before: f64,
        wall_force: f64,
        observer: EnergyObserver,
        /// Lowest energy that wall and damper alone have absorbed: the hand's minus the mass's.
        lowest_without_mass_j: f64,
    }

    impl PassivePort {
        fn new(stiffness: f64, wall_damping: f64, device_damping: f64) -> Self {
            let observer = EnergyObserver::default();
            Self {
                stiffness,
                wall_damping,
                device_damping,
                x: 0.0,
                v: 0.0,
                x_before: 0.0,
                wall_force: 0.0,
                observer,
                lowest_without_mass_j: 0.0,
            }
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
            let energy = self.observer.observe_held(
                Wrench::new(DVec3::X * force_on_hand, DVec3::ZERO),
                DVec3::X * moved,
                DVec3::ZERO,
            );
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
            assert!(
                port.observer.lowest_j() >= -1e-13,
                "run {run_idx}: {} J",
                port.observer.lowest_j()
            );
            assert!(
                port.lowest_without_mass_j >= -1e-13,
                "run {run_idx}: {} J without the mass",
                port.lowest_without_mass_j
            );
            exercised += u32::from(port.observer.energy_j() > 1e-3);
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
                    (angle, port.observer.lowest_j())
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
    fn a_damper_absorbs_and_a_driven_port_delivers_in_all_six_axes() {
        let mut observer = EnergyObserver::default();
        let twist =
            Twist { linear: DVec3::new(0.1, -0.2, 0.3), angular: DVec3::new(1.0, 2.0, -3.0) };
        let damper = Wrench::new(-2.0 * twist.linear, -0.5 * twist.angular);
        let energy = observer.observe(damper, twist, PERIOD_S);
        assert!((energy - PERIOD_S * (2.0 * 0.14 + 0.5 * 14.0)).abs() < 1e-15);
        observer.observe(-damper, twist, 2.0 * PERIOD_S);
        assert!(
            (observer.energy_j() + energy).abs() < 1e-15
                && (observer.lowest_j() + energy).abs() < 1e-15
        );
    }

    #[test]
    fn a_sample_that_is_not_finite_is_left_out() {
        let mut observer = EnergyObserver::default();
        observer.observe_held(Wrench::new(-DVec3::X, DVec3::ZERO), DVec3::X, DVec3::ZERO);
        observer.observe(Wrench::new(DVec3::splat(f64::NAN), DVec3::ZERO), Twist::ZERO, PERIOD_S);
        observer.observe_held(
            Wrench::new(DVec3::X * f64::MAX, DVec3::ZERO),
            DVec3::X * f64::MAX,
            DVec3::ZERO,
        );
        assert_eq!(observer.energy_j(), 1.0);
    }
}
