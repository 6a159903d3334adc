//! What an arm is held to: the bounds of its stiffness, and the parameters of a loop on it with every
//! rule at its default.

use arms::profile::{Plant, Profile, UNVERIFIED_SIGNS_FORCE_N};
use haptics::stability::SampledWall;
use haptics::{
    ArmParameters, CouplingParameters, DeviceMapping, LimitParameters, Parameters,
    SafetyParameters, stuck,
};
use vps::spatial::Axes;

/// Torque limit of the virtual tool where the arm renders no torque at all, N·m: the coupling still
/// has to turn the tool.
const UNACTUATED_TORQUE_NM: f64 = 1.0;
/// Force limit of the virtual tool where the arm renders no force at all, N.
const UNACTUATED_FORCE_N: f64 = 10.0;
/// Coupling of an arm that bounds nothing: as stiff as the stiffest common arm.
pub const UNBOUNDED_N_PER_M: f64 = 4000.0;
/// The same in rotation.
pub const UNBOUNDED_NM_PER_RAD: f64 = 4.0;
/// Window of the fault for power (rule 9).
const POWER_WINDOW_S: f64 = 0.050;
/// The ramp begins once the wrench was below this share of its limits for more than so many ticks
/// (rule 4).
const ENGAGE_SHARE: f64 = 0.1;
const ENGAGE_TICKS: u32 = 3;
const STALE_TICKS_MAX: u32 = 3;
const STALE_FAULT_S: f64 = 0.020;

/// A bound on translational (N/m) or rotational (N·m/rad) stiffness felt by the arm, with the
/// numbers that gave it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StiffnessBound {
    /// One axis of the arm: its plant, period, delay, and the shaping filter where that lies in the
    /// loop. Virtual damping is not credited (decision: virtual damping).
    pub wall: SampledWall,
    /// The stiffness that the profile declares; `None`: the arm has no bound.
    pub declared: Option<f64>,
}

impl StiffnessBound {
    /// A bound that allows everything: for an ideal arm, and for axes that render nothing.
    pub fn none(period_s: f64) -> Self {
        let wall = SampledWall {
            mass_kg: 1.0,
            damping_n_s_per_m: 0.0,
            wall_damping_n_s_per_m: 0.0,
            period_s,
            delay_ticks: 0,
            filter_alpha: 0.0,
        };
        Self { wall, declared: None }
    }

    /// The bound itself; infinite where none is declared.
    pub fn value(&self) -> f64 {
        let Some(declared) = self.declared else { return f64::INFINITY };
        let rule = self.wall.stiffness_bound();
        // A plant built to meet its declared stiffness exactly must not lose it to rounding.
        if rule > declared * (1.0 - 1e-9) { declared } else { rule }
    }

    /// True when a felt stiffness is within the bound, rounding aside.
    pub fn admits(&self, felt_stiffness: f64) -> bool {
        felt_stiffness <= self.value() * (1.0 + 1e-9)
    }
}

/// The stiffness bounds of an arm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StabilityBounds {
    /// Translational stiffness that the arm may feel, N/m; the world's stiffness times `scale`.
    pub translation: StiffnessBound,
    /// Rotational stiffness that the arm may feel, N·m/rad.
    pub rotation: StiffnessBound,
    /// The scene overrides the bounds: those of the tick are infinite.
    pub allow_unstable: bool,
}

impl StabilityBounds {
    /// Those of an arm. Axes that render nothing cannot become unstable, so they have none.
    /// `delay_ticks`: of a command, where it is not that of the profile; `filter_alpha`: of a filter
    /// between contact and arm, 0 without one.
    pub fn of(
        profile: Option<&Profile>,
        period_s: f64,
        delay_ticks: Option<u32>,
        filter_alpha: f64,
        allow_unstable: bool,
    ) -> Self {
        let bound = |axes: Axes,
                     plant: fn(&Plant) -> (f64, f64),
                     declared: fn(&Profile) -> Option<f64>| match profile {
            Some(profile) if has_any(profile.actuated, axes) => {
                let judged = profile.bound_plant();
                let (mass_kg, damping_n_s_per_m) = plant(&judged);
                let wall = SampledWall {
                    mass_kg,
                    damping_n_s_per_m,
                    wall_damping_n_s_per_m: 0.0,
                    period_s,
                    delay_ticks: delay_ticks.unwrap_or(judged.delay_ticks),
                    filter_alpha,
                };
                StiffnessBound { wall, declared: declared(profile) }
            }
            _ => StiffnessBound::none(period_s),
        };
        Self {
            translation: bound(
                Axes::TRANSLATION,
                |p| (p.mass_kg, p.damping_n_s_per_m),
                |p| p.limits.stiffness_n_per_m,
            ),
            rotation: bound(
                Axes::ROTATION,
                |p| (p.inertia_kg_m2, p.damping_nm_s_per_rad),
                |p| p.limits.stiffness_nm_per_rad,
            ),
            allow_unstable,
        }
    }
}

/// What the tick knows of the arm: how its stiffness bound falls with delay, and how much damping
/// may be injected. `scale`: world metres per metre of the arm.
pub fn arm_parameters(profile: &Profile, bounds: &StabilityBounds, scale: f64) -> ArmParameters {
    let StabilityBounds { translation, rotation, allow_unstable } = *bounds;
    let stiffness_lag = |bound: &StiffnessBound| {
        if bound.declared.is_none() || allow_unstable {
            f64::INFINITY
        } else {
            bound.wall.stiffness_lag()
        }
    };
    let [window_s, window_angular_s] = profile.velocity_window_ms.map(|window_ms| window_ms * 1e-3);
    let period_s = translation.wall.period_s;
    // No more than the profile can render, and no more than keeps still an arm without a hand: the
    // velocity that it is made of is as old as half its window.
    let injected = |bound: &StiffnessBound, declared: Option<f64>, window_s: f64| match declared {
        Some(declared) if bound.declared.is_some() => {
            declared.min(bound.wall.injectable_damping(window_s))
        }
        _ => 0.0,
    };
    let stable = |bound: &StiffnessBound, window_s: f64| match bound.declared {
        Some(_) => bound.wall.injectable_damping(window_s),
        None => f64::INFINITY,
    };
    ArmParameters {
        delay_ticks: translation.wall.delay_ticks.max(rotation.wall.delay_ticks),
        stiffness_lag_n_s_per_m: stiffness_lag(&translation) / scale,
        stiffness_lag_nm_s_per_rad: stiffness_lag(&rotation),
        injected_n_s_per_m: injected(&translation, profile.limits.damping_n_s_per_m, window_s),
        injected_nm_s_per_rad: injected(
            &rotation,
            profile.limits.damping_nm_s_per_rad,
            window_angular_s,
        ),
        stable_damping_n_s_per_m: stable(&translation, window_s),
        stable_damping_nm_s_per_rad: stable(&rotation, window_angular_s),
        velocity_age_ticks: [
            translation.wall.velocity_age_ticks(window_s),
            rotation.wall.velocity_age_ticks(window_angular_s),
        ],
        velocity_step_m_per_s: profile.plant.encoder_step_m / window_s.max(period_s),
        velocity_step_rad_per_s: profile.plant.encoder_step_rad / window_angular_s.max(period_s),
        encoder_step_m: profile.plant.encoder_step_m,
        encoder_step_rad: profile.plant.encoder_step_rad,
    }
}

/// The largest force, N, and torque, N·m, of an arm, whether its signs are verified or not. Along axes
/// that it does not render: what the virtual tool is held to.
pub fn largest(profile: Option<&Profile>) -> [f64; 2] {
    let limits = |axes| profile.filter(|profile| has_any(profile.actuated, axes));
    [
        limits(Axes::TRANSLATION).map_or(UNACTUATED_FORCE_N, |profile| profile.limits.force_n),
        limits(Axes::ROTATION).map_or(UNACTUATED_TORQUE_NM, |profile| profile.limits.torque_nm),
    ]
}

/// The same, and no more than holds until its signs are verified.
pub fn largest_now(profile: Option<&Profile>) -> [f64; 2] {
    let [force_n, torque_nm] = largest(profile);
    if !profile.is_some_and(Profile::has_unverified_signs) {
        return [force_n, torque_nm];
    }
    let capped_n = force_n.min(UNVERIFIED_SIGNS_FORCE_N);
    [capped_n, torque_nm * capped_n / force_n]
}

/// Every limit at its default, for this largest force and torque.
pub fn limits(force_n: f64, torque_nm: f64, period_s: f64) -> LimitParameters {
    LimitParameters {
        force_n,
        torque_nm,
        speed_m_per_s: 1.0,
        slew_n_per_s: force_n / LimitParameters::FALL_S,
        slew_nm_per_s: torque_nm / LimitParameters::FALL_S,
        power_w: 5.0,
        ramp_s: 0.1,
        stale_ticks_max: STALE_TICKS_MAX,
        stale_fault_ticks: ((STALE_FAULT_S / period_s).round() as u32).max(STALE_TICKS_MAX + 1),
        overrun_fault_ticks: 0,
        stall_s: 0.05,
    }
}

/// Every gate and rule at its default.
pub fn safety(profile: Option<&Profile>, period_s: f64) -> SafetyParameters {
    let [step_m, step_rad] = profile
        .map_or([0.0; 2], |profile| [profile.plant.encoder_step_m, profile.plant.encoder_step_rad]);
    SafetyParameters {
        deadman: profile
            .and_then(|profile| profile.real.as_ref())
            .and_then(|real| real.deadman_button),
        workspace_radius_m: profile
            .map_or(f64::INFINITY, |profile| profile.limits.workspace_radius_m),
        brake_s: 0.1,
        engage_share: ENGAGE_SHARE,
        engage_ticks: ENGAGE_TICKS,
        power_window_s: POWER_WINDOW_S,
        stuck_move_m: stuck::least_move_m(step_m, period_s),
        stuck_turn_rad: stuck::least_turn_rad(step_rad, period_s),
    }
}

/// Parameters of a loop on this arm: its limits, its bounds, and every rule at its default. What is
/// rendered (contact, filter) is as in [`Parameters::unlimited`].
pub fn parameters(profile: &Profile, period_s: f64) -> Parameters {
    let bounds = StabilityBounds::of(Some(profile), period_s, None, 0.0, false);
    let [bound_n_per_m, bound_nm_per_rad] = [bounds.translation.value(), bounds.rotation.value()];
    let [force_n, torque_nm] = largest_now(Some(profile));
    Parameters {
        coupling: CouplingParameters {
            stiffness_n_per_m: or_if_infinite(bound_n_per_m, UNBOUNDED_N_PER_M),
            stiffness_nm_per_rad: or_if_infinite(bound_nm_per_rad, UNBOUNDED_NM_PER_RAD),
            bound_n_per_m,
            bound_nm_per_rad,
            ..CouplingParameters::PLAIN
        },
        limits: limits(force_n, torque_nm, period_s),
        safety: safety(Some(profile), period_s),
        mapping: DeviceMapping {
            sensed: profile.sensed,
            actuated: profile.actuated,
            ..DeviceMapping::PLAIN
        },
        arm: arm_parameters(profile, &bounds, 1.0),
        ..Parameters::unlimited(period_s)
    }
}

/// A bound, or this where there is none.
pub fn or_if_infinite(bound: f64, default: f64) -> f64 {
    if bound.is_finite() { bound } else { default }
}

fn has_any(axes: Axes, of: Axes) -> bool {
    (0..7).any(|axis_idx| axes.has(axis_idx) && of.has(axis_idx))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plant_built_for_its_declared_stiffness_keeps_it() {
        for declared in [0.3, 1.0, 400.0, 800.0, 2000.0, 4000.0] {
            let mut bound = StiffnessBound::none(1e-3);
            bound.wall.damping_n_s_per_m = 1.25 * declared * 1.5e-3;
            bound.wall.delay_ticks = 1;
            bound.declared = Some(declared);
            assert_eq!(bound.value(), declared);
            assert!(bound.admits(declared));
            assert!(!bound.admits(declared * 1.001));
            bound.wall.damping_n_s_per_m *= 2.0;
            assert_eq!(bound.value(), declared, "however much its plant takes");
        }
    }

    #[test]
    fn nothing_declared_means_no_bound() {
        assert_eq!(StiffnessBound::none(1e-3).value(), f64::INFINITY);
        assert!(StiffnessBound::none(1e-3).admits(1e12));
    }

    fn profile(name: &str) -> Profile {
        arms::profile::find(name, std::path::Path::new("")).expect("shipped")
    }

    fn near(value: f64, expected: f64) {
        assert!((value / expected - 1.0).abs() < 1e-3, "{value} in place of {expected}");
    }

    /// Numbers of devices/sim-sigma7.toml, by hand: 0.8 b, sin(π/(4n + 2)) m/T with n = 9 and 16.
    #[test]
    fn an_arm_takes_what_its_plant_and_its_windows_allow() {
        let sigma7 = profile("sim-sigma7");
        let bounds = StabilityBounds::of(Some(&sigma7), 1e-3, None, 0.0, false);
        near(bounds.translation.value(), 4000.0);
        near(bounds.rotation.value(), 1.0);
        let arm = arm_parameters(&sigma7, &bounds, 2.0);
        assert_eq!((arm.delay_ticks, arm.velocity_age_ticks), (1, [9, 16]));
        near(arm.stiffness_lag_n_s_per_m, 3.0);
        near(arm.stiffness_lag_nm_s_per_rad, 1.5e-3);
        near(arm.injected_n_s_per_m, 24.77);
        near(arm.stable_damping_n_s_per_m, 24.77);
        near(arm.injected_nm_s_per_rad, 9.516e-3);
        near(arm.stable_damping_nm_s_per_rad, 9.516e-3);
        near(arm.velocity_step_m_per_s, 2.6667e-3);
        near(arm.velocity_step_rad_per_s, 0.2);
        near(arm.encoder_step_m, 4e-5);
        near(arm.encoder_step_rad, 6e-3);
        let longer = StabilityBounds::of(Some(&sigma7), 1e-3, Some(3), 0.0, true);
        near(longer.translation.value(), 0.8 * 7.5 / 3.5e-3);
        let free = arm_parameters(&sigma7, &longer, 2.0);
        assert_eq!((free.delay_ticks, free.velocity_age_ticks), (3, [11, 18]));
        assert!(free.stiffness_lag_n_s_per_m.is_infinite());
        let none = StabilityBounds::of(None, 1e-3, None, 0.0, false);
        assert!(none.translation.value().is_infinite() && none.rotation.value().is_infinite());
    }

    /// devices/polhem-2022.toml: 5 N, no torque, unverified signs.
    #[test]
    fn an_arm_without_torque_and_with_unchecked_signs_has_the_rules_for_both() {
        let polhem = profile("polhem-2022");
        assert_eq!(largest(None), [10.0, 1.0]);
        assert_eq!(largest(Some(&polhem)), [5.0, 1.0]);
        assert_eq!(largest_now(Some(&polhem)), [0.5, 0.1]);
        assert_eq!(largest_now(Some(&profile("sim-sigma7"))), [12.0, 0.2]);
        let p = parameters(&polhem, 1e-3);
        assert_eq!((p.limits.force_n, p.limits.torque_nm), (0.5, 0.1));
        let translation = StabilityBounds::of(Some(&polhem), 1e-3, None, 0.0, false).translation;
        assert!(translation.value() > 100.0 && translation.value() <= 2000.0);
        assert_eq!(p.coupling.stiffness_n_per_m, translation.value());
        assert_eq!(p.coupling.bound_n_per_m, translation.value());
        assert_eq!(p.coupling.stiffness_nm_per_rad, UNBOUNDED_NM_PER_RAD);
        assert!(p.coupling.bound_nm_per_rad.is_infinite());
        assert_eq!((p.mapping.sensed, p.mapping.actuated), (polhem.sensed, polhem.actuated));
        assert_eq!((p.arm.injected_n_s_per_m, p.arm.injected_nm_s_per_rad), (1.0, 0.0));
        assert!(p.arm.stable_damping_nm_s_per_rad.is_infinite());
        assert_eq!(or_if_infinite(3.0, 4.0), 3.0);
    }

    /// K = 0.8 b / (T/2 + delay): of sim-sigma7 0.8 · 7.5 / 1.5e-3 and 0.8 · 1.875e-3 / 1.5e-3,
    /// which is what it declares.
    #[test]
    fn the_coupling_of_an_arm_is_as_stiff_as_its_bounds_allow() {
        let sigma7 = profile("sim-sigma7");
        let p = parameters(&sigma7, 1e-3);
        assert_eq!((p.coupling.stiffness_n_per_m, p.coupling.bound_n_per_m), (4000.0, 4000.0));
        assert_eq!((p.coupling.stiffness_nm_per_rad, p.coupling.bound_nm_per_rad), (1.0, 1.0));
        assert_eq!(p.mapping.sensed, sigma7.sensed, "with the grip");
        assert_eq!(p.safety, safety(Some(&sigma7), 1e-3));
        let ideal = parameters(&profile("sim-ideal"), 1e-3).coupling;
        assert_eq!((ideal.stiffness_n_per_m, ideal.stiffness_nm_per_rad), (4000.0, 4.0));
        assert!(ideal.bound_n_per_m.is_infinite() && ideal.bound_nm_per_rad.is_infinite());
    }

    #[test]
    fn axes_that_render_nothing_have_no_bound_and_no_damping_whatever_is_declared() {
        let mut sigma7 = profile("sim-sigma7");
        sigma7.actuated = Axes::TRANSLATION;
        let bounds = StabilityBounds::of(Some(&sigma7), 1e-3, None, 0.0, false);
        assert_eq!(bounds.rotation, StiffnessBound::none(1e-3));
        near(bounds.translation.value(), 4000.0);
        let arm = arm_parameters(&sigma7, &bounds, 1.0);
        near(arm.injected_n_s_per_m, 24.77);
        assert_eq!(arm.injected_nm_s_per_rad, 0.0);
        assert!(arm.stiffness_lag_nm_s_per_rad.is_infinite());
    }

    #[test]
    fn limits_and_rules_are_those_of_the_defaults() {
        let limits = limits(10.0, 2.0, 2e-3);
        assert_eq!((limits.force_n, limits.torque_nm), (10.0, 2.0));
        near(limits.slew_n_per_s, 1000.0);
        near(limits.slew_nm_per_s, 200.0);
        assert_eq!((limits.stale_ticks_max, limits.stale_fault_ticks), (3, 10));
        assert_eq!(super::limits(10.0, 2.0, 1e-2).stale_fault_ticks, 4);
        let safety = safety(Some(&profile("sim-sigma7")), 1e-3);
        near(safety.workspace_radius_m, 0.075);
        assert_eq!((safety.engage_share, safety.engage_ticks), (0.1, 3));
        assert_eq!((safety.deadman, safety.brake_s, safety.power_window_s), (None, 0.1, 0.05));
        assert_eq!(safety.stuck_move_m, stuck::least_move_m(4e-5, 1e-3));
        assert_eq!(safety.stuck_turn_rad, stuck::least_turn_rad(6e-3, 1e-3));
        assert!(super::safety(None, 1e-3).workspace_radius_m.is_infinite());
    }
}
