//! What a scene file has that is accepted and likely wrong, and where it stands.

use std::path::Path;

use super::resolve::DEFAULT_CONTACT_N_PER_MM3;
use super::scene::StiffnessKey;
use super::{Problem, ProblemKind, SceneConfig};
use document::{Document, show};
use haptics::{CouplingMode, LiveParameter, Parameters};
use vps::storage::regular;

/// N/m in a N/mm.
const N_PER_M: f64 = 1e3;
const MM_PER_M: f64 = 1e3;
/// What is so many times softer or stiffer than the default is likely in another unit, which is a
/// thousand times off; the shipped tight fit has six times the default.
const USUAL_FACTOR: f64 = 20.0;

/// What is likely wrong with a scene that was read.
pub fn plausibility_warnings(config: &SceneConfig) -> Vec<Problem> {
    [old_stiffness_key(config), contact_stiffness(config), late_force(config), slow_line(config)]
        .into_iter()
        .flatten()
        .collect()
}

/// A serial line that is too slow, if it is one of a UART.
fn slow_line(config: &SceneConfig) -> Option<Problem> {
    let why = config.device.profile.link_carries(config.rate_hz).err()?.to_string();
    let kind = ProblemKind::Refused { why, hint: None };
    Some(problem_at(&config.path, "rendering.rate_hz", kind))
}

/// A spring that is felt late gives energy at K · lag · v²; a damper of K · lag takes it. An arm
/// that takes less is weakened after a hard landing.
fn late_force(config: &SceneConfig) -> Option<Problem> {
    let Parameters { arm, coupling, period_s, mapping, .. } = config.parameters;
    // An arm that takes no damping, or has no bound, is not watched.
    let takes = arm.injected_n_s_per_m;
    if coupling.mode == CouplingMode::Direct || takes <= 0.0 {
        return None;
    }
    let lag_s = (0.5 + f64::from(arm.delay_ticks)) * period_s;
    let felt_n_per_m = coupling.stiffness_n_per_m * mapping.scale;
    let gives = felt_n_per_m * lag_s;
    if gives <= takes * (1.0 + 1e-9) {
        return None;
    }
    let most = takes / lag_s / mapping.scale / N_PER_M;
    let why = format!(
        "{} N/m felt {} ms late needs {} N·s/m of damping to give no energy, and this arm takes \
            {}: after a hard landing it gets less force than the contact has, until the hand \
            presses on",
        show(felt_n_per_m),
        show(lag_s * 1e3),
        show(gives),
        show(takes),
    );
    let hint =
        Some(format!("write {} N/mm at most, or know of it", show((most * 100.0).floor() / 100.0)));
    Some(problem_at(
        &config.path,
        "coupling.translation_n_per_mm",
        ProblemKind::Refused { why, hint },
    ))
}

/// A problem at a key of a scene that was read before. The file is read again, for the line and
/// what is written there; one that is gone or no scene any more has neither.
pub fn problem_at(path: &Path, key: &str, kind: ProblemKind) -> Problem {
    if let Ok(text) = regular::written(path)
        && let Ok(document) = Document::parse(path, &text)
    {
        return document.problem(key, kind);
    }
    Problem { key: Some(key.to_owned()), ..Problem::of_file(path, kind) }
}

/// Of version 0.1.0: the same scene felt different at another voxel size.
fn old_stiffness_key(config: &SceneConfig) -> Option<Problem> {
    let StiffnessKey::OfPoint { n_per_mm3 } = config.stiffness_key else { return None };
    let why =
        "holds for one square of the tool's voxel edge, so that another voxel size feels different";
    let hint = Some(format!("write stiffness_n_per_mm3 = {n_per_mm3:?}"));
    let kind = ProblemKind::Refused { why: why.to_owned(), hint };
    Some(problem_at(&config.path, "contact.stiffness_n_per_mm", kind))
}

/// A stiffness of contact that is likely in another unit.
fn contact_stiffness(config: &SceneConfig) -> Option<Problem> {
    let Parameters { contact, coupling, .. } = config.parameters;
    // `None`: it does nothing in this mode.
    LiveParameter::ContactStiffness.range(&config.parameters)?;
    // N/m of a point in a N/mm³.
    let voxel_mm = config.tool.voxel_size_m * MM_PER_M;
    let n_per_m = voxel_mm * voxel_mm * N_PER_M;
    // In `direct` the arm feels each point, and the default is no more than it takes.
    let most_of_arm = match coupling.mode {
        CouplingMode::Direct => coupling.bound_n_per_m / n_per_m,
        CouplingMode::Implicit | CouplingMode::Constraint => f64::INFINITY,
    };
    let default = DEFAULT_CONTACT_N_PER_MM3.min(most_of_arm);
    let [least, most] =
        [default / USUAL_FACTOR, (default * USUAL_FACTOR).min(most_of_arm)].map(show);
    // As it is shown: a number at an end of the range is within.
    let n_per_mm3 = show(contact.stiffness_n_per_m / n_per_m);
    if (least..=most).contains(&n_per_mm3) {
        return None;
    }
    let (key, that_is) = match config.stiffness_key {
        StiffnessKey::OfVolume => ("contact.stiffness_n_per_mm3", String::new()),
        StiffnessKey::OfPoint { .. } => {
            ("contact.stiffness_n_per_mm", format!("that is {n_per_mm3} N/mm³, "))
        }
    };
    let why = format!("{that_is}far from the default of {} N/mm³", show(default));
    let hint =
        Some(format!("write {least} to {most} N/mm³; is the unit right? 1 N/mm³ is 1e9 N/m³"));
    Some(problem_at(&config.path, key, ProblemKind::Refused { why, hint }))
}
