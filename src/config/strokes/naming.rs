//! Problems of strokes by the line and the time that their author wrote, not by the number of the
//! stroke.

use super::super::schema::Deed;
use document::{ConfigErrors, Document, Problem, ProblemKind, nearest};

/// The same problems: `stroke[2].brush_mm` becomes `stroke at 1.5 s (line 9): brush_mm`, and of
/// unknown keys only those that its `do` takes are known.
pub(super) fn in_words(document: &Document<'_>, errors: ConfigErrors) -> ConfigErrors {
    ConfigErrors::new(
        errors.into_problems().into_iter().map(|problem| named(document, problem)).collect(),
    )
}

fn named(document: &Document<'_>, mut problem: Problem) -> Problem {
    let Some((table, key)) = problem.key.as_deref().and_then(split) else { return problem };
    let table = table.to_owned();
    let key = key.to_owned();
    match &mut problem.kind {
        ProblemKind::UnknownKey { nearest: guess, known } => {
            let deed = document
                .written(&format!("{table}.do"))
                .and_then(|word| Deed::of(word.trim_matches(['"', '\''])));
            if let Some(deed) = deed {
                *known =
                    ["at_s", "do"].iter().chain(deed.keys()).map(|key| (*key).to_owned()).collect();
                // A key of another `do` is not meant here.
                *guess = nearest(&key, known.iter().map(String::as_str));
            }
        }
        ProblemKind::Exclusive { other } => {
            if let Some((_, key)) = split(other) {
                *other = key.to_owned();
            }
        }
        _ => {}
    }
    problem.key = Some(name_of(document, &table, &key));
    problem
}

/// A key of a stroke as messages name it.
pub(super) fn name_of(document: &Document<'_>, table: &str, key: &str) -> String {
    let at = document
        .written(&format!("{table}.at_s"))
        .filter(|_| key != "at_s")
        .map_or_else(String::new, |at| format!(" at {at} s"));
    let line = document.line(table).map_or_else(String::new, |line| format!(" (line {line})"));
    format!("stroke{at}{line}: {key}")
}

/// `stroke[2]` and what comes behind it.
fn split(key: &str) -> Option<(&str, &str)> {
    key.split_once('.').filter(|(table, _)| table.starts_with("stroke["))
}
