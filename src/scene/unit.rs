//! A mesh whose numbers are likely in another unit than its scene says.

use super::object::SceneError;
use crate::config::scene::MeshSource;
use crate::config::setting_names::KEYS;
use crate::config::{Problem, ProblemKind, SceneConfig, problem_at};
use vps::part::{Part, PartError};
use vps::spatial::Metres;

/// No part that a hand feels its way around is as large, m.
const IMPLAUSIBLE_M: f64 = 10.0;
/// What the numbers of most meshes are, m.
const MILLIMETRE_M: f64 = 1e-3;

/// Where a grid is refused, and its part is implausibly large: the unit that makes it so. Reads the
/// mesh again.
pub fn doubted_unit(config: &SceneConfig, error: &SceneError) -> Option<Problem> {
    let SceneError::Part(PartError::Grid { name, source: grid }) = error else { return None };
    let static_idx = config.statics.iter().position(|object| object.name == *name);
    let (table, source) = match static_idx {
        Some(idx) => (format!("static[{idx}]"), &config.statics[idx].source),
        None => ("tool".to_owned(), &config.tool.source),
    };
    let MeshSource::File { path, metres_per_unit } = source else { return None };
    let (low, high) = Part::load(name, path, *metres_per_unit).ok()?.mesh.bounds()?;
    let size_m = (high - low).max_element();
    if size_m < IMPLAUSIBLE_M {
        return None;
    }
    let in_millimetres_m = size_m / metres_per_unit * MILLIMETRE_M;
    let advice = if *metres_per_unit > MILLIMETRE_M && in_millimetres_m < IMPLAUSIBLE_M {
        format!("check the unit first: with \"mm\" the part is {} long", Metres(in_millimetres_m))
    } else {
        "check the unit and the mesh first".to_owned()
    };
    let kind = ProblemKind::Refused {
        why: format!("{name} is {} long: {grid}", Metres(size_m)),
        hint: Some(format!("{advice}; if the part is so large, {}", grid.hint_at_this_size(&KEYS))),
    };
    Some(problem_at(&config.path, &format!("{table}.units"), kind))
}
