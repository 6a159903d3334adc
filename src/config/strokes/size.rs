//! Whether the solids of strokes fit the clay that they join and cut: a wrong unit is a factor of
//! a thousand.

use std::path::Path;

use glam::DVec3;

use super::super::schema::Stroke;
use super::naming::name_of;
use super::{Script, solid_key};
use clay::boolean::Boolean;
use clay::engine::SculptOrder;
use document::{ConfigErrors, Document, Problem, ProblemKind};
use vps::spatial::Metres;

/// A solid so many times as large as the clay, or the clay as the solid, is a wrong unit: what is
/// that much larger has hardly a sample where the clay is, and what is that much smaller is finer
/// than its samples.
const LARGEST: f64 = 100.0;

/// What says how large a solid is: its unit, or the shape itself.
#[derive(Clone, Debug)]
pub(super) struct Size {
    line: Option<usize>,
    key: String,
    value: Option<String>,
    has_unit: bool,
}

impl Size {
    pub(super) fn of(document: &Document<'_>, table: &str, stroke: &Stroke) -> Self {
        let has_unit = stroke.units.is_some();
        let key = if has_unit { "units" } else { solid_key(stroke) };
        let path = format!("{table}.{key}");
        Self {
            line: document.line(&path),
            key: name_of(document, table, key),
            value: document.written(&path),
            has_unit,
        }
    }

    fn problem(&self, file: &Path, found: String) -> Problem {
        let Self { line, key, value, .. } = self.clone();
        Problem {
            file: file.to_owned(),
            line,
            key: Some(key),
            value,
            kind: ProblemKind::Disagrees { found },
        }
    }
}

impl Script {
    /// Holds the solids against a clay model, by the boxes around both (map frame, m). What cannot
    /// be meant is an error; gives what looks odd: solids that stand away from the clay and from
    /// all that was joined with it before.
    ///
    /// # Errors
    /// Solids a hundred times as large or as small as the clay.
    pub fn fit(&self, model: (DVec3, DVec3)) -> Result<Vec<Problem>, ConfigErrors> {
        let longest = |(low, high): (DVec3, DVec3)| (high - low).max_element();
        let clay_m = longest(model);
        let mut wrong = Vec::new();
        let mut odd = Vec::new();
        let (mut low, mut high) = model;
        for timed in &self.orders {
            let (SculptOrder::Combine { boolean, with, map_from_body, .. }, Some(size)) =
                (&timed.order, &timed.size)
            else {
                continue;
            };
            let Some(solid) = with.bounds_map(map_from_body) else { continue };
            let solid_m = longest(solid);
            let ratio = solid_m / clay_m;
            if !(1.0 / LARGEST..=LARGEST).contains(&ratio) {
                let right = if size.has_unit {
                    "is this unit right, and that of the clay?"
                } else {
                    "shapes are in mm: are these?"
                };
                wrong.push(size.problem(
                    &self.file,
                    format!(
                        "the solid is {} across, the clay {}; {right}",
                        Metres(solid_m),
                        Metres(clay_m)
                    ),
                ));
                continue;
            }
            let away_m = (solid.0 - high).max(low - solid.1).max(DVec3::ZERO).length();
            if away_m > longest((low, high)) {
                let found = format!(
                    "the solid stands {} away from the clay, which is {} across",
                    Metres(away_m),
                    Metres(clay_m)
                );
                odd.push(size.problem(
                    &self.file,
                    format!("{found}; are its position_mm and its unit right?"),
                ));
            } else if *boolean == Boolean::Union {
                (low, high) = (low.min(solid.0), high.max(solid.1));
            }
        }
        if wrong.is_empty() { Ok(odd) } else { Err(ConfigErrors::new(wrong)) }
    }
}
