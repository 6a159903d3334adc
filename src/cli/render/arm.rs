//! What an operator has to know of a real arm before it moves.

use super::super::{OutputOptions, probe, report};
use crate::config::SceneConfig;
use arms::profile::RealArm;
use vps::spatial::Axes;

/// What an operator has to know of a real arm before it moves.
pub(super) fn tell_of_arm(config: &SceneConfig, real: &RealArm, output: OutputOptions) {
    let profile = &config.device.profile;
    if config.device.hand.is_some() {
        report::note("the scene's hand is for simulated arms: a real one has yours", output);
    }
    if let Some(instruction) = &real.homing.instruction {
        report::note(&format!("homing: {instruction}"), output);
    }
    let has_motors = profile.actuated != Axes::NONE;
    if has_motors && profile.has_unverified_signs() {
        let force_n = config.parameters.limits.force_n;
        report::warning(
            &format!(
                "signs not verified: force stays below {force_n} N until the profile says \
                    `signs_verified = true` ({})",
                probe::command(profile, config.device.selector.as_ref(), "--sign-check")
            ),
            output,
        );
    }
    if has_motors && profile.is_unidentified() {
        report::warning(
            &format!(
                "not identified: stiffness is bounded by half of the assumed damping ({})",
                probe::command(profile, config.device.selector.as_ref(), "--identify")
            ),
            output,
        );
    }
}
