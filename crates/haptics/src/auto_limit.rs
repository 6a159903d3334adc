//! Automatic gain limit: less stiffness when the arm turns out to be further away than its profile
//! says.
//!
//! Data in: the round trip that each sample measures. Data out: coupling gains and bounds that the
//! loop can take at that delay.
//!
//! The configuration has already held the gains to the bound at the delay that the profile states.
//! What is left here is the difference: a network, a slow driver, a hub. The longest delay since
//! enable counts, so the gain never comes and goes with jitter, and it moves over
//! [`SETTLE_S_PER_TICK`], so a late packet makes no step in the hand.
//!
//! # Source
//! Gil2009 for K (T/2 + t_d + t_f) < b; the rule with the factor 0.8 is that of
//! [`stability`](super::stability).

use super::params::{ArmParameters, CouplingParameters};
use super::stability::damping_reach;

/// Time in which the limit follows one more tick of delay, s.
const SETTLE_S_PER_TICK: f64 = 0.01;

/// The delay that the gains allow for.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct LoopDelay {
    /// Longest delay since enable, ticks.
    pub(super) worst_ticks: u32,
    allowed_ticks: f64,
}

impl LoopDelay {
    /// At enable, when nothing is felt yet: the measured delay counts at once, older ones are
    /// forgotten.
    pub(super) fn starting_at(measured_ticks: u32) -> Self {
        Self { worst_ticks: measured_ticks, allowed_ticks: f64::from(measured_ticks) }
    }

    /// One tick. RT: safe.
    pub(super) fn measure(&mut self, measured_ticks: u32, period_s: f64) {
        self.worst_ticks = self.worst_ticks.max(measured_ticks);
        self.allowed_ticks =
            (self.allowed_ticks + period_s / SETTLE_S_PER_TICK).min(f64::from(self.worst_ticks));
    }

    /// The gains and bounds at that delay; `filter_lag_s` counts where the shaping filter lies in
    /// the arm's loop. The very bits that came in while the measured delay is no longer than the
    /// one that they allow for. RT: safe.
    pub(super) fn limited(
        &self,
        coupling: &CouplingParameters,
        arm: &ArmParameters,
        filter_lag_s: f64,
        period_s: f64,
    ) -> CouplingParameters {
        if self.allowed_ticks <= f64::from(arm.delay_ticks) {
            return *coupling;
        }
        let lag_s = (0.5 + self.allowed_ticks) * period_s + filter_lag_s;
        let translation = arm.stiffness_lag_n_s_per_m / lag_s;
        let rotation = arm.stiffness_lag_nm_s_per_rad / lag_s;
        let damped = self.damped(arm);
        CouplingParameters {
            felt_damping_n_s_per_m: coupling
                .felt_damping_n_s_per_m
                .min(damped.stable_damping_n_s_per_m),
            felt_damping_nm_s_per_rad: coupling
                .felt_damping_nm_s_per_rad
                .min(damped.stable_damping_nm_s_per_rad),
            stiffness_n_per_m: coupling.stiffness_n_per_m.min(translation),
            stiffness_nm_per_rad: coupling.stiffness_nm_per_rad.min(rotation),
            bound_n_per_m: coupling.bound_n_per_m.min(translation),
            bound_nm_per_rad: coupling.bound_nm_per_rad.min(rotation),
            ..*coupling
        }
    }

    /// What the arm takes of dampers at the longest delay: each acts on a velocity that is older by
    /// the difference, and would drive the arm beyond this. The very bits that came in while the
    /// measured delay is no longer than the one that they allow for. RT: safe.
    pub(super) fn damped(&self, arm: &ArmParameters) -> ArmParameters {
        let later = self.worst_ticks.saturating_sub(arm.delay_ticks);
        if later == 0 {
            return *arm;
        }
        let share = arm
            .velocity_age_ticks
            .map(|age| damping_reach(age.saturating_add(later)) / damping_reach(age));
        let [linear, angular] = share;
        let stable = arm.stable_damping_n_s_per_m * linear;
        let stable_angular = arm.stable_damping_nm_s_per_rad * angular;
        ArmParameters {
            stable_damping_n_s_per_m: stable,
            stable_damping_nm_s_per_rad: stable_angular,
            injected_n_s_per_m: arm.injected_n_s_per_m.min(stable),
            injected_nm_s_per_rad: arm.injected_nm_s_per_rad.min(stable_angular),
            ..*arm
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stability::SampledWall;
    use crate::testing::parameters;

    const PERIOD_S: f64 = 1e-3;

    /// A plant of b = 1.5 N·s/m that the profile puts one tick away.
    fn arm() -> ArmParameters {
        ArmParameters {
            delay_ticks: 1,
            stiffness_lag_n_s_per_m: 0.8 * 1.5,
            ..ArmParameters::default()
        }
    }

    /// The plant so many ticks away, with a wall that is filtered by this pole.
    fn wall(delay_ticks: u32, filter_alpha: f64) -> SampledWall {
        SampledWall {
            mass_kg: 0.3,
            damping_n_s_per_m: 1.5,
            wall_damping_n_s_per_m: 0.0,
            period_s: PERIOD_S,
            delay_ticks,
            filter_alpha,
        }
    }

    fn near(one: f64, other: f64) -> bool {
        (one / other - 1.0).abs() < 1e-12
    }

    #[test]
    fn a_delay_that_was_expected_changes_no_bit() {
        let coupling = parameters().coupling;
        for ticks in [0, 1] {
            let limited = LoopDelay::starting_at(ticks).limited(&coupling, &arm(), 0.0, PERIOD_S);
            assert_eq!(limited, coupling);
        }
    }

    #[test]
    fn a_longer_delay_gives_the_bound_of_the_stability_rule() {
        let coupling = CouplingParameters { stiffness_n_per_m: 1e6, ..parameters().coupling };
        for delay_ticks in [2, 5, 20] {
            for filter_alpha in [0.0, 0.5] {
                let wall = wall(delay_ticks, filter_alpha);
                let delay = LoopDelay::starting_at(delay_ticks);
                let limited = delay.limited(&coupling, &arm(), wall.filter_lag_s(), PERIOD_S);
                let bound_n_per_m = wall.stiffness_bound();
                assert!(near(limited.stiffness_n_per_m, bound_n_per_m), "{delay_ticks} ticks");
                assert!(near(limited.bound_n_per_m, bound_n_per_m), "{delay_ticks} ticks");
                assert!(
                    limited.stiffness_nm_per_rad.to_bits()
                        == coupling.stiffness_nm_per_rad.to_bits(),
                    "no bound on rotation"
                );
            }
        }
    }

    #[test]
    fn damping_shrinks_to_what_a_velocity_so_old_can_damp() {
        let window_s = 15e-3;
        let arm = ArmParameters {
            delay_ticks: 1,
            injected_n_s_per_m: 20.0,
            stable_damping_n_s_per_m: wall(1, 0.0).injectable_damping(window_s),
            velocity_age_ticks: [wall(1, 0.0).velocity_age_ticks(window_s), 0],
            ..arm()
        };
        assert_eq!(LoopDelay::starting_at(1).damped(&arm), arm);
        for delay_ticks in [5, 20, 100, 200] {
            let damped = LoopDelay::starting_at(delay_ticks).damped(&arm);
            let expected = wall(delay_ticks, 0.0).injectable_damping(window_s);
            assert!(near(damped.injected_n_s_per_m, expected.min(20.0)), "{delay_ticks} ticks");
        }
    }

    #[test]
    fn the_gain_follows_slowly_and_does_not_come_back_with_jitter() {
        let coupling = CouplingParameters { stiffness_n_per_m: 800.0, ..parameters().coupling };
        let mut delay = LoopDelay::starting_at(1);
        let mut before = 800.0;
        for n in 0..200 {
            delay.measure(if n % 3 == 0 { 6 } else { 1 }, PERIOD_S);
            let now = delay.limited(&coupling, &arm(), 0.0, PERIOD_S).stiffness_n_per_m;
            assert!(now <= before && now > 0.92 * before, "tick {n}: {now} N/m after {before} N/m");
            before = now;
        }
        assert!((before - 1.2 / 6.5e-3).abs() < 1e-9);
        assert_eq!(delay.worst_ticks, 6);
    }

    #[test]
    fn every_gain_bound_and_damper_is_limited_by_what_the_arm_takes_at_that_delay() {
        let arm = ArmParameters {
            delay_ticks: 1,
            stiffness_lag_n_s_per_m: 1.2,
            stiffness_lag_nm_s_per_rad: 2e-3,
            injected_n_s_per_m: 19.0,
            injected_nm_s_per_rad: 0.047,
            stable_damping_n_s_per_m: 20.0,
            stable_damping_nm_s_per_rad: 0.05,
            velocity_age_ticks: [8, 5],
            ..ArmParameters::default()
        };
        let coupling = CouplingParameters {
            stiffness_n_per_m: 1e4,
            stiffness_nm_per_rad: 5.0,
            felt_damping_n_s_per_m: 18.0,
            felt_damping_nm_s_per_rad: 0.045,
            bound_n_per_m: 2e4,
            bound_nm_per_rad: 7.0,
            ..CouplingParameters::PLAIN
        };
        // Five ticks later than stated: a velocity that is so much older damps so much less.
        let reach = |ticks: f64| (core::f64::consts::PI / (4.0 * ticks + 2.0)).sin();
        let linear = 20.0 * reach(13.0) / reach(8.0);
        let angular = 0.05 * reach(10.0) / reach(5.0);
        let delay = LoopDelay::starting_at(6);
        let damped = delay.damped(&arm);
        assert!(near(damped.stable_damping_n_s_per_m, linear), "{damped:?}");
        assert!(near(damped.stable_damping_nm_s_per_rad, angular), "{damped:?}");
        assert!(near(damped.injected_n_s_per_m, linear), "{damped:?}");
        assert!(near(damped.injected_nm_s_per_rad, angular), "{damped:?}");
        // 6.5 ticks and 1.5 ms of the filter.
        let limited = delay.limited(&coupling, &arm, 1.5e-3, PERIOD_S);
        assert!(near(limited.stiffness_n_per_m, 150.0) && near(limited.bound_n_per_m, 150.0));
        assert!(near(limited.stiffness_nm_per_rad, 0.25) && near(limited.bound_nm_per_rad, 0.25));
        assert!(near(limited.felt_damping_n_s_per_m, linear), "{limited:?}");
        assert!(near(limited.felt_damping_nm_s_per_rad, angular), "{limited:?}");
    }
}
