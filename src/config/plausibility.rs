//! What a scene file has that is accepted and likely wrong, and where it stands.

use std::path::Path;

use super::resolve::DEFAULT_CONTACT_N_PER_MM;
use super::{Problem, ProblemKind, SceneConfig};
use document::{Document, show};
use haptics::{ContactParameters, CouplingMode, CouplingParameters, LiveParameter, Parameters};
use vps::storage::regular;

/// N/m in a N/mm.
const N_PER_M: f64 = 1e3;

/// What is likely wrong with a scene that was read.
pub fn plausibility_warnings(config: &SceneConfig) -> Vec<Problem> {
    [contact_stiffness(config), late_force(config), slow_line(config)]
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

/// Clients set the stiffness of a scene to multiples of its own. What no client could set a scene
/// of the default to is likely in another unit.
fn contact_stiffness(config: &SceneConfig) -> Option<Problem> {
    let written = config.parameters;
    // `None`: it does nothing in this mode.
    LiveParameter::ContactStiffness.range(&written)?;
    let contact = ContactParameters {
        stiffness_n_per_m: DEFAULT_CONTACT_N_PER_MM * N_PER_M,
        ..written.contact
    };
    // `direct` has no range above its own stiffness.
    let coupling = CouplingParameters { mode: CouplingMode::Implicit, ..written.coupling };
    let usual =
        LiveParameter::ContactStiffness.range(&Parameters { contact, coupling, ..written })?;
    if (usual.least..=usual.most).contains(&written.contact.stiffness_n_per_m) {
        return None;
    }
    let [least, most] = [usual.least, usual.most].map(|n_per_m| show(n_per_m / N_PER_M));
    let why = format!(
        "outside {least} to {most} N/mm, the range that the page gives a scene with the default of \
            {} N/mm",
        show(DEFAULT_CONTACT_N_PER_MM)
    );
    let hint = Some(format!("write {least} to {most}; is the unit right? 1 N/mm is 1000 N/m"));
    Some(problem_at(&config.path, "contact.stiffness_n_per_mm", ProblemKind::Refused { why, hint }))
}
