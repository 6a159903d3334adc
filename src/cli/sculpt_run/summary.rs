//! What became of the clay: for people, and for `--json`.

use std::path::{Path, PathBuf};

use serde::Serialize;

use super::super::{OutputOptions, report};
use crate::daemon::sculpting::{FailedOrder, SculptReport};
use crate::error::Exit;
use document::show;

/// A share of late updates that is felt.
const LATE_SHARE: f64 = 0.05;

/// A file that was written.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct SavedFile {
    /// `points`, `session`, `mesh` or `picture`.
    pub(super) kind: &'static str,
    #[serde(serialize_with = "lossily")]
    pub(super) file: PathBuf,
}

/// A name that is no UTF-8 is written all the same.
fn lossily<'f, S: serde::Serializer>(
    file: impl Into<Option<&'f PathBuf>>,
    serializer: S,
) -> Result<S::Ok, S::Error> {
    file.into().map(|file| file.to_string_lossy()).serialize(serializer)
}

/// What became of the clay, as `--json` has it.
#[derive(Clone, Debug, Default, Serialize)]
pub(crate) struct SculptSummary {
    #[serde(flatten)]
    pub(super) engine: SculptReport,
    pub(super) update_hz: f64,
    pub(super) volume_before_mm3: Option<f64>,
    pub(super) volume_mm3: Option<f64>,
    pub(super) saved: Vec<SavedFile>,
    pub(super) unsaved: Vec<SavedFile>,
    #[serde(skip_serializing_if = "Option::is_none", serialize_with = "lossily")]
    pub(super) rescued: Option<PathBuf>,
}

impl SculptSummary {
    /// Something was to be kept and was not, and no session has it.
    pub(super) fn is_at_risk(&self) -> bool {
        let writes = |order: &FailedOrder| {
            matches!(&order.what[..], "save-points" | "save-session" | "export")
        };
        let has_failed = !self.unsaved.is_empty()
            || self.engine.broken.is_some()
            || self.engine.failed.iter().any(writes);
        has_failed && !self.saved.iter().any(|saved| saved.kind == "session")
    }

    /// A script that was not carried out, or a file that was not written, is not what was asked
    /// for.
    pub(crate) fn exit(&self) -> Exit {
        if self.engine.broken.is_some() {
            Exit::Internal
        } else if !self.unsaved.is_empty()
            || self.engine.failed.iter().any(|order| order.is_scripted)
        {
            Exit::Asset
        } else {
            Exit::Ok
        }
    }

    pub(super) fn tell(&self, strokes: Option<&Path>, tick_s: f64, output: OutputOptions) {
        let SculptReport { failed, left_over, troubles, broken, updates, late, .. } = &self.engine;
        for FailedOrder { tick, is_scripted, line, what, why } in failed {
            let at_s = show(*tick as f64 * tick_s);
            let message = match (strokes, line) {
                (Some(file), Some(line)) => format!(
                    "{}:{line}: stroke not carried out: {what} at {at_s} s: {why}",
                    file.display()
                ),
                _ => format!(
                    "{} not carried out: {what} at {at_s} s: {why}",
                    if *is_scripted { "stroke" } else { "order" }
                ),
            };
            report::warning(&message, output);
        }
        for trouble in troubles {
            report::warning(&format!("clay: {trouble}"), output);
        }
        if *left_over > 0 {
            let (number, were) = if *left_over == 1 {
                ("1 stroke".to_owned(), "was")
            } else {
                (format!("{left_over} strokes"), "were")
            };
            report::warning(
                &format!(
                    "the run ended before {number} {were} due; --duration says how long it goes on"
                ),
                output,
            );
        }
        if *late as f64 > LATE_SHARE * (*updates + *late) as f64 {
            report::warning(
                &format!(
                    "this machine was too slow for {late} of {} updates, so the clay moved more \
                        slowly than the time: give fewer mass points in `sculpt.raster`, or a \
                        lower `sculpt.update_hz`",
                    updates + late
                ),
                output,
            );
        }
        if let Some(broken) = broken {
            report::error(
                &format!("sculpting ended before the loop: {broken}"),
                Some("this is a bug of hapticd: please report it"),
                output,
            );
        }
    }

    /// Rows of the summary.
    pub(crate) fn rows(&self) -> Vec<(&'static str, String)> {
        let SculptReport { updates, late, strokes, taken_back, samples_before, samples, .. } =
            &self.engine;
        let volume = |mm3: Option<f64>| mm3.map_or("open".to_owned(), |mm3| format!("{mm3:.1}"));
        let strokes_word = if *strokes == 1 { "stroke" } else { "strokes" };
        let back =
            if *taken_back == 0 { String::new() } else { format!(" ({taken_back} taken back)") };
        let mut rows = vec![
            (
                "clay",
                format!(
                    "{strokes} {strokes_word}{back}, {samples_before} samples before, {samples} \
                        after"
                ),
            ),
            (
                "volume",
                format!(
                    "{} mm³ before, {} mm³ after",
                    volume(self.volume_before_mm3),
                    volume(self.volume_mm3)
                ),
            ),
            (
                "updates",
                format!(
                    "{updates} at {} Hz, {late} left out because they were late",
                    show(self.update_hz)
                ),
            ),
        ];
        let saved = self
            .saved
            .iter()
            .map(|SavedFile { kind, file }| ("saved", format!("{kind} in {}", file.display())));
        rows.extend(saved);
        rows
    }
}
