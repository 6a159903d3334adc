//! Files of strokes: what is done to clay, and when.
//!
//! TOML, `version = 1`, then a `[[stroke]]` table for each, with `at_s` (loop time, s) and `do`;
//! `docs/reference/clay.md` lists the keys. Files that are read are relative to the file of
//! strokes, files that are written to the working directory.

mod curves;
mod image_placement;
mod laid_material;
mod naming;
mod size;

use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use self::naming::{in_words, name_of};
use self::size::Size;
use super::resolve::Resolve;
use super::schema::{Deed, Stroke, Strokes, holds_strokes};
use super::setting_names::{KEYS, MISSING};
use clay::boolean::Boolean;
use clay::engine::{SculptOrder, ToolSettings};
use clay::{LoadError, OpenedSolid};
use document::{Checks, ConfigErrors, Document, Interval, Problem, ProblemKind, any_of};
use vps::mesh::MeshError;
use vps::storage::regular;

/// A file of strokes.
#[derive(Clone, Debug)]
pub struct Script {
    /// The file.
    pub file: PathBuf,
    /// What is done, in the order of the times.
    pub orders: Vec<TimedOrder>,
    /// The files that it names to be read.
    pub reads: Vec<PathBuf>,
    /// What a user should know of the meshes among them.
    pub notes: Arc<[Problem]>,
}

/// An order of a file of strokes.
#[derive(Clone, Debug)]
pub struct TimedOrder {
    /// Time of the loop, from its first tick.
    pub at: Duration,
    /// What is done then.
    pub order: SculptOrder,
    /// Line of its stroke.
    pub line: usize,
    /// What says how large the other solid of a Boolean is.
    size: Option<Size>,
}

const TIME_S: Interval = Interval::from(0.0).to(1e5).unit("s");

/// Reads a file of strokes, with every image and solid that it names, in the order of their times;
/// those of one time stay in the order of the file. `tool`: what is in the hand before, of which a
/// `take` changes what it names.
///
/// # Errors
/// Every problem of the first pass that found any.
pub fn load(path: &Path, tool: &ToolSettings) -> Result<Script, ConfigErrors> {
    let of_file = |kind| ConfigErrors::new(vec![Problem::of_file(path, kind)]);
    let text = regular::written(path).map_err(|cause| {
        of_file(match cause.kind() {
            ErrorKind::NotFound => ProblemKind::StrokesMissing,
            _ => ProblemKind::Unreadable { cause },
        })
    })?;
    let document = Document::parse(path, &text)?;
    if document.has("tool") || document.has("sculpt") {
        return Err(of_file(ProblemKind::IsNoStrokes));
    }
    let Strokes { strokes, .. } = document.read().map_err(|errors| in_words(&document, errors))?;
    let dir = path.parent().unwrap_or(Path::new(""));
    let mut reader = Reader {
        resolve: Resolve { checks: Checks::new(&document), document: &document, dir },
        tool,
        orders: Vec::new(),
        holds: Vec::new(),
        written: Vec::new(),
        notes: Vec::new(),
    };
    for (index, stroke) in strokes.iter().enumerate() {
        reader.stroke(index, stroke);
    }
    reader.holds_are_apart();
    let Reader { resolve, mut orders, notes, .. } = reader;
    let reads = resolve.checks.files().to_vec();
    resolve.checks.finish().map_err(|errors| in_words(&document, errors))?;
    orders.sort_by_key(|timed| timed.at);
    let of_script = |note: Problem| Problem { file: path.to_owned(), ..note };
    let notes = notes.into_iter().map(of_script).collect();
    Ok(Script { file: path.to_owned(), orders, reads, notes })
}

/// A file of strokes, as far as it can be read without checking it.
pub fn is_script(path: &Path) -> bool {
    regular::written(path).is_ok_and(|text| {
        Document::parse(path, &text).is_ok_and(|document| holds_strokes(&document))
    })
}

impl Script {
    /// The files that its orders write.
    pub fn writes(&self) -> impl Iterator<Item = &Path> {
        self.orders.iter().filter_map(|timed| match &timed.order {
            SculptOrder::SavePoints(path)
            | SculptOrder::SaveSession(path)
            | SculptOrder::Export(path) => Some(path.as_path()),
            _ => None,
        })
    }
}

struct Reader<'d> {
    resolve: Resolve<'d>,
    tool: &'d ToolSettings,
    orders: Vec<TimedOrder>,
    /// Number of the stroke, from and until, s.
    holds: Vec<(usize, f64, f64)>,
    /// Files and the strokes that write them.
    written: Vec<(usize, PathBuf)>,
    /// What a user should know of meshes.
    notes: Vec<Problem>,
}

impl Reader<'_> {
    fn stroke(&mut self, index: usize, stroke: &Stroke) {
        let table = format!("stroke[{index}]");
        let at_s = self.resolve.checks.required(&format!("{table}.at_s"), stroke.at_s, TIME_S);
        let accepted = any_of(&Deed::ALL.map(|deed| deed.to_string()));
        let Some(deed) = self.resolve.checks.given(&format!("{table}.do"), stroke.deed, accepted)
        else {
            return;
        };
        self.only_what_belongs(&table, stroke, deed);
        let at = Duration::try_from_secs_f64(at_s).unwrap_or_default();
        let order = match deed {
            Deed::Take => Some(SculptOrder::Take(self.resolve.tool_settings(
                &table,
                &stroke.written_tool(),
                self.tool,
            ))),
            Deed::Hold => {
                self.hold(index, at_s, stroke.until_s);
                return;
            }
            Deed::Union | Deed::Intersection | Deed::Difference => {
                self.combine(&table, stroke, deed)
            }
            Deed::Emboss | Deed::Engrave => self.emboss(&table, stroke, deed),
            Deed::Draw => self.curves(&table, stroke).map(SculptOrder::Draw),
            Deed::Lay => self.lay(&table, stroke),
            Deed::Pull => self.pull(index, &table, stroke, at_s),
            Deed::Undo => Some(SculptOrder::Undo),
            Deed::Redo => Some(SculptOrder::Redo),
            Deed::Region => {
                let key = format!("{table}.region_mm");
                let accepted = "[[x, y, z], [x, y, z]], the lowest and the highest corner";
                let region = self.resolve.checks.given(&key, stroke.region_mm.as_deref(), accepted);
                let region = self.resolve.region_m(&key, region);
                region.map(|(low_map, high_map)| SculptOrder::Region { low_map, high_map })
            }
            Deed::SavePoints => self.file(index, stroke, Some("ply")).map(SculptOrder::SavePoints),
            Deed::SaveSession => self.file(index, stroke, None).map(SculptOrder::SaveSession),
            Deed::Export => self.file(index, stroke, Some("ply")).map(SculptOrder::Export),
        };
        let Some(order) = order else { return };
        let size = matches!(order, SculptOrder::Combine { .. })
            .then(|| Size::of(self.resolve.document, &table, stroke));
        self.orders.push(TimedOrder { at, order, line: self.line(index), size });
    }

    fn line(&self, index: usize) -> usize {
        self.resolve.document.line(&format!("stroke[{index}]")).unwrap_or_default()
    }

    fn hold(&mut self, index: usize, at_s: f64, until_s: Option<f64>) {
        let key = format!("stroke[{index}].until_s");
        let until_s = self.resolve.checks.required(&key, until_s, TIME_S);
        if until_s <= at_s {
            self.resolve.checks.not_accepted(&key, format_args!("later than at_s = {at_s} s"));
        }
        self.holds.push((index, at_s, until_s));
        for (time_s, held) in [(at_s, true), (until_s, false)] {
            let at = Duration::try_from_secs_f64(time_s).unwrap_or_default();
            self.orders.push(TimedOrder {
                at,
                order: SculptOrder::Hold(held),
                line: self.line(index),
                size: None,
            });
        }
    }

    /// What is held twice would be let go by the first end, and a pull would end with the next one.
    fn holds_are_apart(&mut self) {
        let mut holds = self.holds.clone();
        holds.sort_by(|(_, one_s, _), (_, other_s, _)| one_s.total_cmp(other_s));
        for pair in holds.windows(2) {
            let &[(before, _, until_s), (index, at_s, _)] = pair else { continue };
            let line = self.line(before);
            let accepted = if at_s < until_s {
                format!("{until_s} s or later: until then the stroke in line {line} holds or pulls")
            } else if at_s == until_s && index < before {
                // What happens at one time happens in the order of the file: this one would be let
                // go as soon as it holds.
                format!(
                    "later than {until_s} s, or stand below the stroke in line {line}, which holds \
                        or pulls until then"
                )
            } else {
                continue;
            };
            self.resolve.checks.not_accepted(&format!("stroke[{index}].at_s"), accepted);
        }
    }

    fn combine(&mut self, table: &str, stroke: &Stroke, deed: Deed) -> Option<SculptOrder> {
        let boolean = match deed {
            Deed::Intersection => Boolean::Intersection,
            Deed::Difference => Boolean::Difference,
            _ => Boolean::Union,
        };
        let n_before = self.resolve.checks.count();
        let solid = self.resolve.solid(table, &stroke.written_solid(), "");
        let map_from_body = self.resolve.pose(table, stroke.position_mm, stroke.orientation_xyzw);
        if self.resolve.checks.count() > n_before {
            return None;
        }
        match solid.open().and_then(OpenedSolid::into_source) {
            Ok((body, warnings)) => {
                self.note(table, solid_key(stroke), warnings);
                Some(SculptOrder::Combine {
                    boolean,
                    with: Arc::new(body),
                    map_from_body,
                    is_sharp: stroke.sharp.unwrap_or(self.tool.is_sharp),
                })
            }
            Err(problem) => {
                let is_missing = matches!(problem, LoadError::File(MeshError::Missing { .. }));
                let hint = if is_missing { Some(MISSING.to_owned()) } else { problem.hint(&KEYS) };
                self.resolve.checks.refuse(
                    &format!("{table}.{}", solid_key(stroke)),
                    ProblemKind::Refused { why: problem.to_string(), hint },
                );
                None
            }
        }
    }

    /// What was found in the file of a key.
    fn note(&mut self, table: &str, key: &str, found: Vec<String>) {
        let document = self.resolve.document;
        let path = format!("{table}.{key}");
        self.notes.extend(found.into_iter().map(|found| Problem {
            file: PathBuf::new(),
            line: document.line(&path),
            key: Some(name_of(document, table, key)),
            value: document.written(&path),
            kind: ProblemKind::Disagrees { found },
        }));
    }

    fn file(&mut self, index: usize, stroke: &Stroke, ending: Option<&str>) -> Option<PathBuf> {
        let key = format!("stroke[{index}].file");
        let accepted = "the file to write, relative to the working directory";
        let path =
            PathBuf::from(self.resolve.checks.given(&key, stroke.file.as_ref(), accepted)?);
        if let Some(ending) = ending
            && !path.extension().is_some_and(|found| found.eq_ignore_ascii_case(ending))
        {
            self.resolve
                .checks
                .not_accepted(&key, format_args!("a file whose name ends in .{ending}"));
            return None;
        }
        if let Some((first, _)) = self.written.iter().find(|(_, earlier)| *earlier == path) {
            let line = self.line(*first);
            self.resolve.checks.not_accepted(
                &key,
                format_args!("another file: the stroke in line {line} writes this one"),
            );
            return None;
        }
        self.written.push((index, path.clone()));
        Some(path)
    }

    fn only_what_belongs(&mut self, table: &str, stroke: &Stroke, deed: Deed) {
        let known = deed.keys();
        let keys =
            if known.is_empty() { "no key beside at_s".to_owned() } else { known.join(", ") };
        let strange = stroke
            .given()
            .into_iter()
            .filter(|key| !matches!(*key, "at_s" | "deed") && !known.contains(key));
        self.leave_out(table, strange, &format!("beside do = \"{deed}\", which takes {keys}"));
    }

    fn leave_out(&mut self, table: &str, keys: impl IntoIterator<Item = &'static str>, why: &str) {
        for key in keys {
            self.resolve
                .checks
                .not_accepted(&format!("{table}.{key}"), format_args!("left out {why}"));
        }
    }
}

/// The key that names the other solid.
fn solid_key(stroke: &Stroke) -> &'static str {
    if stroke.points.is_some() {
        "points"
    } else if stroke.mesh.is_some() {
        "mesh"
    } else {
        "shape"
    }
}

#[cfg(test)]
mod tests;
