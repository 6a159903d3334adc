//! The arm: profile, simulation, limits, scheduling, and what it can take.

use std::path::Path;

use super::super::scene::SimConfig;
use super::super::schema::{self, Deadman, Overrun};
use super::{LoadOptions, MM, Resolve};
use arms::attached::nodes::Selector;
use arms::profile::{self, Profile, ProfileError, ceilings};
use arms::simulated::fault;
use document::{Interval, POSITIVE, ProblemKind, nearest, show};
use engine::arm_rules;
use haptics::{LimitParameters, SafetyParameters};
use rt::schedule::RealtimeConfig;

const DEFAULT_PROFILE: &str = "sim-sigma7";
const DEFAULT_SPEED_MM_PER_S: f64 = 1000.0;
/// No hand that holds an arm is faster, mm/s: a throw has 10 m/s without one.
const MOST_SPEED_MM_PER_S: f64 = 5000.0;
/// Shortest time from zero to the limit: a tick at 1 kHz. Faster, the force would step.
const LEAST_RISE_S: f64 = 0.001;
/// Longest: dampers rise by the same limit, and braking after too much speed is over by then.
const MOST_RISE_S: f64 = 0.1;
const DEFAULT_POWER_W: f64 = 5.0;
/// A hand that moves at 1 m/s goes 5 cm meanwhile, and the guard acts after as long. Less than a
/// few periods would fault on a healthy machine.
const DEFAULT_STALL_MS: f64 = 50.0;
const STALL_MS: Interval = Interval::from(5.0).to(50.0);
/// The power limit goes up to what the arm's largest force does at this speed, m/s: that of a hand
/// that moves fast.
const POWER_SPEED_M_PER_S: f64 = 1.0;
/// Longest braking after too much speed, and the default.
const MOST_BRAKE_MS: f64 = 100.0;
const DEFAULT_RAMP_MS: f64 = 100.0;
/// The shortest ramp, ms: ten ticks at 1 kHz. A shorter one is a blow.
const LEAST_RAMP_MS: f64 = 10.0;
/// The longest rise, ms: after a longer one a person takes the arm for one without force.
const MOST_RAMP_MS: f64 = 10_000.0;
/// Over-runs that make a fault, as a time of them without a tick in time, s.
const MOST_OVERRUN_S: u32 = 1;
const ENFORCED_OVERRUN_TICKS: u32 = 20;
const DEFAULT_PRIORITY: u32 = 80;
const DEFAULT_HAND_N_PER_M: f64 = 500.0;
const DEFAULT_HAND_N_S_PER_M: f64 = 5.0;
const DEFAULT_HAND_MASS_G: f64 = 150.0;

impl Resolve<'_> {
    pub(super) fn realtime(
        &mut self,
        written: &schema::Realtime,
        options: &LoadOptions,
    ) -> RealtimeConfig {
        let enforce =
            options.enforce.unwrap_or(written.mode == Some(schema::RealtimeWord::Enforce));
        let priority =
            self.checks.whole("realtime.priority", written.priority, DEFAULT_PRIORITY, 1, 99);
        let cpu = written
            .cpu
            .map(|cpu| self.checks.whole("realtime.cpu", Some(cpu), 0, 0, 1023) as usize);
        RealtimeConfig { enforce, cpu, priority: u8::try_from(priority).unwrap_or(u8::MAX) }
    }

    pub(super) fn sim(&mut self, device: &schema::Device, options: &LoadOptions) -> SimConfig {
        let written = &device.sim;
        let hand_present = written.hand != Some(schema::HandWord::None);
        if !hand_present && device.hand.is_some() {
            self.checks
                .refuse("device.sim.hand", ProblemKind::Exclusive { other: "device.hand".into() });
        }
        if let Some(fault) = &written.fault {
            let word = fault.split(['@', ':', '=', ' ']).next().unwrap_or_default();
            if !fault::NAMES.contains(&word) {
                let known = fault::NAMES.map(str::to_owned).to_vec();
                self.checks.refuse(
                    "device.sim.fault",
                    ProblemKind::UnknownWord { nearest: nearest(word, fault::NAMES), known },
                );
            } else if let Err(error) = fault::parse(fault) {
                self.checks.refuse("device.sim.fault", ProblemKind::refused(error));
            }
        }
        let checks = &mut self.checks;
        let not_negative = Interval::from(0.0);
        SimConfig {
            hand_stiffness_n_per_m: checks.number(
                "device.sim.hand_stiffness_n_per_m",
                written.hand_stiffness_n_per_m,
                DEFAULT_HAND_N_PER_M,
                not_negative.to(1e5).unit("N/m"),
            ),
            hand_damping_n_s_per_m: checks.number(
                "device.sim.hand_damping_n_s_per_m",
                written.hand_damping_n_s_per_m,
                DEFAULT_HAND_N_S_PER_M,
                not_negative.to(1e4).unit("N·s/m"),
            ),
            hand_mass_kg: checks.number(
                "device.sim.hand_mass_g",
                written.hand_mass_g,
                DEFAULT_HAND_MASS_G,
                not_negative.to(1e5).unit("g"),
            ) * 1e-3,
            hand_present,
            hand_repeats: options.hand_repeat,
            delay_ticks: written
                .delay_ticks
                .map(|ticks| checks.whole("device.sim.delay_ticks", Some(ticks), 0, 0, 100)),
            fault: written.fault.clone(),
        }
    }

    pub(super) fn profile(
        &mut self,
        written: &schema::Device,
        options: &LoadOptions,
    ) -> Option<Profile> {
        let (found, key, shown) = match (&options.device, &written.profile) {
            (Some(name), _) => (profile::find(name, Path::new("")), "--device", Some(name)),
            (None, Some(name)) => (profile::find(name, self.dir), "device.profile", None),
            (None, None) => (profile::find(DEFAULT_PROFILE, self.dir), "device.profile", None),
        };
        let kind = match found {
            Ok(profile) => return Some(profile),
            Err(ProfileError::Unknown { nearest, known }) => {
                ProblemKind::UnknownProfile { nearest, known }
            }
            Err(ProfileError::FileMissing { path }) => ProblemKind::FileMissing { path },
            Err(ProfileError::Invalid(errors)) => {
                self.checks.append(errors);
                return None;
            }
        };
        self.checks.refuse_as(key, shown.map(String::as_str), kind);
        None
    }

    pub(super) fn selector(
        &mut self,
        written: &schema::Device,
        options: &LoadOptions,
    ) -> Option<Selector> {
        if options.selector.is_some() {
            return options.selector.clone();
        }
        let selector = written.selector.as_deref()?.parse();
        if selector.is_err() {
            let accepted =
                "VID:PID or VID:PID:SERIAL in hex, or the path of a node such as /dev/ttyACM0";
            self.checks.not_accepted("device.selector", accepted);
        }
        selector.ok()
    }

    pub(super) fn scale(&mut self, written: &schema::WorldFromDevice) -> f64 {
        let interval = POSITIVE.to(1000.0).unit("world metres per device metre");
        self.checks.number("device.world_from_device.scale", written.scale, 1.0, interval)
    }

    pub(super) fn limits(
        &mut self,
        limits: &schema::Limits,
        safety: &schema::Safety,
        profile: Option<&Profile>,
        rate_hz: u32,
        enforce: bool,
    ) -> LimitParameters {
        // What rules are measured by, whether the signs are verified or not: a scene does not
        // change with that.
        let [arm_n, _] = arm_rules::largest(profile);
        let [force_max, torque_max] = arm_rules::largest_now(profile);
        let checks = &mut self.checks;
        let of_profiles = "no arm's profile has more, and the lower of profile and scene counts";
        let range = POSITIVE.to(ceilings::FORCE_N).unit("N");
        let scene_n =
            checks.rule("limits.force_n", limits.force_n, arm_n, range, of_profiles).min(arm_n);
        let force_n = scene_n.min(force_max);
        let range = POSITIVE.to(ceilings::TORQUE_NM).unit("N·m");
        let torque_nm = checks
            .rule("limits.torque_nm", limits.torque_nm, torque_max, range, of_profiles)
            .min(torque_max);
        let overrun_fault_ticks = match safety.overrun {
            Some(Overrun::Off(_)) => 0,
            Some(Overrun::Consecutive(count)) => match u32::try_from(count) {
                Ok(count) if (1..=MOST_OVERRUN_S * rate_hz).contains(&count) => count,
                _ => {
                    let most = MOST_OVERRUN_S * rate_hz;
                    checks.not_accepted(
                        "safety.overrun",
                        format_args!(
                            "a whole number of consecutive missed ticks from 1 to {most}, which is \
                                a second of them, or \"off\""
                        ),
                    );
                    0
                }
            },
            None if enforce => ENFORCED_OVERRUN_TICKS,
            None => 0,
        };
        LimitParameters {
            speed_m_per_s: checks.rule(
                "limits.speed_mm_per_s",
                limits.speed_mm_per_s,
                DEFAULT_SPEED_MM_PER_S,
                POSITIVE.to(MOST_SPEED_MM_PER_S).unit("mm/s"),
                "no hand that holds an arm is faster",
            ) * MM,
            slew_n_per_s: checks
                .rule(
                    "safety.slew_n_per_s",
                    safety.slew_n_per_s,
                    force_n / LimitParameters::FALL_S,
                    Interval::from(show(scene_n / MOST_RISE_S))
                        .to(show(arm_n / LEAST_RISE_S))
                        .unit("N/s"),
                    &format!(
                        "at least {scene_n} N within 100 ms, else dampers come too late; at most \
                            the arm's largest force of {arm_n} N within 1 ms"
                    ),
                )
                .min(force_n / LEAST_RISE_S),
            power_w: checks.rule(
                "safety.power_w",
                safety.power_w,
                DEFAULT_POWER_W,
                POSITIVE.to(show(DEFAULT_POWER_W.max(arm_n * POWER_SPEED_M_PER_S))).unit("W"),
                &format!("the larger of 5 W and the arm's largest force of {arm_n} N at 1 m/s"),
            ),
            ramp_s: checks.rule(
                "safety.ramp_ms",
                safety.ramp_ms,
                DEFAULT_RAMP_MS,
                Interval::from(LEAST_RAMP_MS).to(MOST_RAMP_MS).unit("ms"),
                "a shorter one is a blow",
            ) * 1e-3,
            overrun_fault_ticks,
            stall_s: checks.number(
                "safety.stall_ms",
                safety.stall_ms,
                DEFAULT_STALL_MS,
                STALL_MS.unit("ms"),
            ) * 1e-3,
            ..arm_rules::limits(force_n, torque_nm, 1.0 / f64::from(rate_hz))
        }
    }

    pub(super) fn safety(
        &mut self,
        written: &schema::Safety,
        profile: Option<&Profile>,
        period_s: f64,
    ) -> SafetyParameters {
        let rules = arm_rules::safety(profile, period_s);
        let deadman = match written.deadman {
            Some(Deadman::Off(_)) => None,
            None => rules.deadman,
            Some(Deadman::Button(number)) => {
                let button =
                    u8::try_from(number).ok().filter(|button| u32::from(*button) < u32::BITS);
                if button.is_none() {
                    self.checks.not_accepted(
                        "safety.deadman",
                        "the number of a button from 0 to 31, or \"off\"",
                    );
                }
                button
            }
        };
        let brake = Interval::from(0.0).to(MOST_BRAKE_MS).unit("ms");
        SafetyParameters {
            deadman,
            brake_s: self.checks.number("safety.brake_ms", written.brake_ms, MOST_BRAKE_MS, brake)
                * 1e-3,
            ..rules
        }
    }
}
