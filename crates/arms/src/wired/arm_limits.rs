//! What an arm is held to: the lower of what its profile says and of what it declares itself.

use super::WiredParameters;
use crate::parameters::MotorLimits;
use crate::protocol::{Codec, DeclaredLimits, StartError};

/// Share by which a number that was rounded for the wire may be lower, and counts as the same.
const ROUNDING: f64 = 1e-6;
/// Periods that a watchdog has to wait for: the loop may miss one of them.
const WATCHDOG_PERIODS: f64 = 2.0;
/// Where the rate of the loop is written.
const RATE_KEYS: &str =
    "rendering.rate_hz of the scene, link.rate_hz of the profile for `device-node` and `probe`";

/// Limits that an arm may declare itself.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ArmLimits {
    /// Of the motors, with verified signs.
    verified: MotorLimits,
    /// Of the motors until then.
    unverified: MotorLimits,
    /// The arm drops its command after so long, ms; `None`: never.
    watchdog_ms: Option<u32>,
}

/// The lower one, where what is declared is more than a rounding below.
pub(crate) fn lower(profile: f64, declared: f64) -> f64 {
    if declared < profile * (1.0 - ROUNDING) { declared } else { profile }
}

impl ArmLimits {
    /// Those of a profile.
    pub(super) fn of(parameters: &WiredParameters) -> Self {
        Self {
            verified: parameters.limits,
            unverified: parameters.unverified_limits,
            watchdog_ms: parameters.capabilities.watchdog_ms,
        }
    }

    /// Each number, or what the arm has declared where that is lower. RT: safe.
    pub(super) fn lowered_by(self, codec: &dyn Codec) -> Self {
        let watchdogs = [self.watchdog_ms, codec.watchdog_ms()];
        let declared = codec.declared();
        let lowered = |limits: MotorLimits| match declared {
            Some(declared) => MotorLimits {
                force_n: lower(limits.force_n, declared.force_n),
                torque_nm: lower(limits.torque_nm, declared.torque_nm),
            },
            None => limits,
        };
        Self {
            verified: lowered(self.verified),
            unverified: lowered(self.unverified),
            watchdog_ms: watchdogs.into_iter().flatten().min(),
        }
    }
}

impl WiredParameters {
    /// Puts these limits in the place of those of the profile. RT: safe.
    pub(super) fn hold_to(&mut self, limits: ArmLimits) {
        self.limits = limits.verified;
        self.unverified_limits = limits.unverified;
        self.capabilities.watchdog_ms = limits.watchdog_ms;
    }
}

/// Refuses an arm that declares what the loop cannot meet; else says what it declares below its
/// profile. Cold.
///
/// # Errors
/// [`StartError::Refused`], with both numbers and what to write.
pub(crate) fn judge_declared(
    codec: &dyn Codec,
    profile: MotorLimits,
    period_s: f64,
) -> Result<Option<String>, StartError> {
    let refuse = |text: String| Err(StartError::Refused(text));
    let loop_hz = 1.0 / period_s;
    let least_ms = WATCHDOG_PERIODS * 1e3 * period_s;
    if let Some(watchdog_ms) = codec.watchdog_ms()
        && f64::from(watchdog_ms) < least_ms * (1.0 - ROUNDING)
    {
        return refuse(format!(
            "the arm declares a watchdog of {watchdog_ms} ms, and a loop of {loop_hz:.0} Hz needs \
                one of {least_ms:.1} ms or more: write a higher {RATE_KEYS}"
        ));
    }
    let Some(declared) = codec.declared() else { return Ok(None) };
    let DeclaredLimits { rate_hz, force_n, torque_nm, workspace_radius_m } = declared;
    let is_none = |limit: &f64| !limit.is_finite() || *limit < 0.0;
    if [force_n, torque_nm, workspace_radius_m].iter().any(is_none) {
        return refuse(format!(
            "the arm declares limits that are none: {force_n} N, {torque_nm} N·m, a workspace of \
                {workspace_radius_m} m; its firmware has to be corrected"
        ));
    }
    if f64::from(rate_hz) < loop_hz * (1.0 - ROUNDING) {
        return refuse(format!(
            "the arm declares {rate_hz} Hz at most, and the loop has {loop_hz:.0} Hz: write \
                {rate_hz} or less as {RATE_KEYS}"
        ));
    }
    let rows = [
        ("limits.force_n", profile.force_n, force_n, "N"),
        ("limits.torque_nm", profile.torque_nm, torque_nm, "N·m"),
    ];
    let less: Vec<String> = rows
        .into_iter()
        .filter(|(_, asked, has, _)| lower(*asked, *has) < *asked)
        .map(|(key, asked, has, unit)| format!("{key} = {asked}, the arm declares {has:.4} {unit}"))
        .collect();
    Ok((!less.is_empty()).then(|| format!("{}: the lower number holds", less.join("; "))))
}
