//! Files of strokes: what is done to a piece of clay, and when.
//!
//! TOML, `version = 1`, then a `[[stroke]]` table for each, with `at_s` (loop time, s) and `do`; `docs/sculpting.md` lists the keys. Files
//! that are read are relative to the file of strokes, files that are written to the working directory.

mod laid;

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use super::checks::{Checks, Interval};
use super::document::Document;
use super::problem::{ConfigErrors, Problem, ProblemKind, any_of};
use super::resolve::Resolve;
use super::schema::{Deed, Stroke, Strokes};
use crate::sculpt::PointSet;
use crate::sculpt::boolean::Boolean;
use crate::sculpt::studio::{Order, ToolSettings};

/// An order and its loop time.
pub type Timed = (Duration, Order);

const TIME_S: Interval = Interval::from(0.0).to(1e5).unit("s");

/// Reads a file of strokes, with every image and solid that it names, in the order of their times; those of one time stay in the order of the
/// file. `tool`: what is in the hand before, of which a `take` changes what it names.
///
/// # Errors
/// Every problem of the first pass that found any.
pub fn load(path: &Path, tool: &ToolSettings) -> Result<Vec<Timed>, ConfigErrors> {
    let of_file = |kind| ConfigErrors::new(vec![Problem::of_file(path, kind)]);
    let text = fs::read_to_string(path).map_err(|cause| of_file(ProblemKind::Unreadable { cause }))?;
    let document = Document::parse(path, &text)?;
    let Strokes { strokes, .. } = document.read()?;
    let dir = path.parent().unwrap_or(Path::new(""));
    let mut script = Script {
        resolve: Resolve { checks: Checks::new(&document), document: &document, dir },
        tool,
        orders: Vec::new(),
        holds: Vec::new(),
        written: Vec::new(),
    };
    for (index, stroke) in strokes.iter().enumerate() {
        script.stroke(index, stroke);
    }
    script.holds_are_apart();
    let Script { resolve, mut orders, .. } = script;
    resolve.checks.finish()?;
    orders.sort_by_key(|(at, _)| *at);
    Ok(orders)
}

/// The files that orders write.
pub fn outputs(orders: &[Timed]) -> impl Iterator<Item = &Path> {
    orders.iter().filter_map(|(_, order)| match order {
        Order::SavePoints(path) | Order::SaveSession(path) | Order::Export(path) => Some(path.as_path()),
        _ => None,
    })
}

struct Script<'d> {
    resolve: Resolve<'d>,
    tool: &'d ToolSettings,
    orders: Vec<Timed>,
    /// Number of the stroke, from and until, s.
    holds: Vec<(usize, f64, f64)>,
    /// Files and the strokes that write them.
    written: Vec<(usize, PathBuf)>,
}

impl Script<'_> {
    fn stroke(&mut self, index: usize, stroke: &Stroke) {
        let table = format!("stroke[{index}]");
        let at_s = self.resolve.checks.required(&format!("{table}.at_s"), stroke.at_s, TIME_S);
        let Some(deed) = stroke.deed else {
            self.resolve.checks.missing(&format!("{table}.do"), any_of(&Deed::ALL.map(|deed| deed.to_string())));
            return;
        };
        self.only_what_belongs(&table, stroke, deed);
        let at = Duration::try_from_secs_f64(at_s).unwrap_or_default();
        let order = match deed {
            Deed::Take => Some(Order::Take(self.resolve.tool_settings(&table, &stroke.written_tool(), self.tool))),
            Deed::Hold => {
                self.hold(index, at_s, stroke.until_s);
                return;
            }
            Deed::Union | Deed::Intersection | Deed::Difference => self.combine(&table, stroke, deed),
            Deed::Emboss | Deed::Engrave => self.emboss(&table, stroke, deed),
            Deed::Undo => Some(Order::Undo),
            Deed::Redo => Some(Order::Redo),
            Deed::Region => {
                let key = format!("{table}.region_mm");
                if stroke.region_mm.is_none() {
                    self.resolve.checks.missing(&key, "[[x, y, z], [x, y, z]], the lowest and the highest corner");
                }
                let region = self.resolve.region_m(&key, stroke.region_mm.as_deref());
                region.map(|(low_map, high_map)| Order::Region { low_map, high_map })
            }
            Deed::SavePoints => self.file(index, stroke, Some("ply")).map(Order::SavePoints),
            Deed::SaveSession => self.file(index, stroke, None).map(Order::SaveSession),
            Deed::Export => self.file(index, stroke, Some("ply")).map(Order::Export),
        };
        self.orders.extend(order.map(|order| (at, order)));
    }

    fn hold(&mut self, index: usize, at_s: f64, until_s: Option<f64>) {
        let key = format!("stroke[{index}].until_s");
        let until_s = self.resolve.checks.required(&key, until_s, TIME_S);
        if until_s <= at_s {
            self.resolve.checks.not_accepted(&key, format_args!("later than at_s = {at_s} s"));
        }
        self.holds.push((index, at_s, until_s));
        for (time_s, held) in [(at_s, true), (until_s, false)] {
            self.orders.push((Duration::try_from_secs_f64(time_s).unwrap_or_default(), Order::Hold(held)));
        }
    }

    /// What is held twice would be let go by the first end.
    fn holds_are_apart(&mut self) {
        let mut holds = self.holds.clone();
        holds.sort_by(|(_, one_s, _), (_, other_s, _)| one_s.total_cmp(other_s));
        for pair in holds.windows(2) {
            let &[(before, _, until_s), (index, at_s, _)] = pair else { continue };
            let line = self.resolve.document.line(&format!("stroke[{before}]")).unwrap_or_default();
            let accepted = if at_s < until_s {
                format!("{until_s} s or later: until then the tool is held by the stroke in line {line}")
            } else if at_s == until_s && index < before {
                // What happens at one time happens in the order of the file: this one would be let go as soon as it holds.
                format!("later than {until_s} s, or stand below the stroke in line {line}, which holds the tool until then")
            } else {
                continue;
            };
            self.resolve.checks.not_accepted(&format!("stroke[{index}].at_s"), accepted);
        }
    }

    fn combine(&mut self, table: &str, stroke: &Stroke, deed: Deed) -> Option<Order> {
        let boolean = match deed {
            Deed::Intersection => Boolean::Intersection,
            Deed::Difference => Boolean::Difference,
            _ => Boolean::Union,
        };
        let n_before = self.resolve.checks.count();
        let solid = self.resolve.solid(table, &stroke.written_solid(), "");
        let map_from_solid = self.resolve.pose(table, stroke.position_mm, stroke.orientation_xyzw);
        if self.resolve.checks.count() > n_before {
            return None;
        }
        let mut points = match solid.load() {
            Ok(loaded) => loaded.points,
            Err(problem) => {
                let key = if stroke.points.is_some() {
                    "points"
                } else if stroke.mesh.is_some() {
                    "mesh"
                } else {
                    "shape"
                };
                self.resolve.checks.refuse(&format!("{table}.{key}"), ProblemKind::Solid(problem));
                return None;
            }
        };
        let PointSet { positions_map, normals_map, .. } = &mut points;
        positions_map.iter_mut().for_each(|at| *at = map_from_solid.transform_point(*at));
        normals_map.iter_mut().for_each(|normal| *normal = map_from_solid.transform_vector(*normal).normalize());
        Some(Order::Combine { boolean, with: Arc::new(points), is_sharp: stroke.sharp.unwrap_or(self.tool.is_sharp) })
    }

    fn file(&mut self, index: usize, stroke: &Stroke, ending: Option<&str>) -> Option<PathBuf> {
        let key = format!("stroke[{index}].file");
        let Some(file) = &stroke.file else {
            self.resolve.checks.missing(&key, "the file to write, relative to the working directory");
            return None;
        };
        let path = PathBuf::from(file);
        if let Some(ending) = ending
            && !path.extension().is_some_and(|found| found.eq_ignore_ascii_case(ending))
        {
            self.resolve.checks.not_accepted(&key, format_args!("a file whose name ends in .{ending}"));
            return None;
        }
        if let Some((first, _)) = self.written.iter().find(|(_, earlier)| *earlier == path) {
            let line = self.resolve.document.line(&format!("stroke[{first}]")).unwrap_or_default();
            self.resolve.checks.not_accepted(&key, format_args!("another file: the stroke in line {line} writes this one"));
            return None;
        }
        self.written.push((index, path.clone()));
        Some(path)
    }

    fn only_what_belongs(&mut self, table: &str, stroke: &Stroke, deed: Deed) {
        let known = deed.keys();
        let keys = if known.is_empty() { "no key beside at_s".to_owned() } else { known.join(", ") };
        let strange = stroke.given().into_iter().filter(|key| !matches!(*key, "at_s" | "deed") && !known.contains(key));
        self.leave_out(table, strange, &format!("beside do = \"{deed}\", which takes {keys}"));
    }

    fn leave_out(&mut self, table: &str, keys: impl IntoIterator<Item = &'static str>, why: &str) {
        for key in keys {
            self.resolve.checks.not_accepted(&format!("{table}.{key}"), format_args!("left out {why}"));
        }
    }
}

#[cfg(test)]
mod tests;
