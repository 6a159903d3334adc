//! How every command says what is wrong.

use std::io::IsTerminal;

use super::output::{self, Lead, Level};
use super::{OutputOptions, When};
use crate::config::{self, Problem, SceneConfig};
use crate::daemon::{PrepareError, service};
use crate::error::Exit;
use crate::scene::{ClayError, ClayReport, ObjectReport, SceneError};
use clay::clay_model::ClayModelError;
use vps::part::PartError;
use vps::storage::printable::one_line;

/// Prints what is likely wrong with a scene.
pub(crate) fn scene_warnings(config: &SceneConfig, output: OutputOptions) {
    config::plausibility_warnings(config)
        .iter()
        .for_each(|problem| warning(&one_line(&warning_text(problem)), output));
}

/// All of it in one line.
pub(super) fn warning_text(problem: &Problem) -> String {
    problem.hint().map_or_else(|| problem.to_string(), |hint| format!("{problem}; {hint}"))
}

/// An asset, or a grid that the configuration asks for.
pub(super) fn scene_exit(problem: &SceneError) -> Exit {
    match problem {
        SceneError::Part(PartError::Mesh { .. })
        | SceneError::Clay(
            ClayError::Load(_)
            | ClayError::Session(_)
            | ClayError::Model(ClayModelError::Surface(_)),
        ) => Exit::Asset,
        SceneError::Part(PartError::Grid { .. })
        | SceneError::Clay(ClayError::Model(_) | ClayError::Frame(_)) => Exit::Configuration,
    }
}

/// What to do about it.
pub(super) fn prepare_hint(problem: &PrepareError) -> Option<String> {
    match problem {
        PrepareError::Scene(problem) => problem.hint(),
        PrepareError::HandPath(problem) => Some(problem.remedy.clone()),
        PrepareError::Open(problem) => problem.hint().map(str::to_owned),
        _ => None,
    }
}

/// The exit code for it.
pub(super) fn prepare_exit(problem: &PrepareError) -> Exit {
    match problem {
        PrepareError::Scene(problem) => scene_exit(problem),
        PrepareError::Open(_) => Exit::Device,
        PrepareError::Config(_)
        | PrepareError::Hand(_)
        | PrepareError::HandPath(_)
        | PrepareError::Fault { .. }
        | PrepareError::Arm(_) => Exit::Configuration,
    }
}

/// Prints what a user should know of the objects of a scene.
pub(crate) fn bake_warnings(reports: &[ObjectReport], output: OutputOptions) {
    bake_warnings_of("", reports, output);
}

/// The same, of one of several scenes: `scene` goes before each.
pub(crate) fn bake_warnings_of(scene: &str, reports: &[ObjectReport], output: OutputOptions) {
    for object in reports {
        for text in &object.warnings {
            warning(&one_line(&format!("{scene}{}: {text}", object.name)), output);
        }
    }
}

/// Prints what a user should know of the clay of a scene.
pub(crate) fn clay_warnings(clay: &ClayReport, output: OutputOptions) {
    for text in &clay.warnings {
        warning(&one_line(&format!("clay: {text}")), output);
    }
}

/// Prints one error with what to do about it.
pub(crate) fn error(message: &str, hint: Option<&str>, output: OutputOptions) {
    if output::is_json() {
        let hint = hint.map(|hint| ("hint", hint.into()));
        return output::event(Level::Error, "error", message, hint.as_slice());
    }
    let colour = |colour| if is_coloured(output) { colour } else { "" };
    output::led(Lead { word: "error:", colour: colour(output::RED) }, message);
    for (n, line) in hint.iter().flat_map(|hint| hint.lines()).enumerate() {
        let word = if n == 0 { "  hint:" } else { "       " };
        output::led(Lead { word, colour: colour(output::CYAN) }, line);
    }
}

/// Prints one warning, unless `--quiet` is given.
pub(crate) fn warning(message: &str, output: OutputOptions) {
    remark(
        Level::Warning,
        "warning",
        Lead { word: "warning:", colour: output::YELLOW },
        message,
        output,
    );
}

/// Prints what was assumed, unless `--quiet` is given.
pub(crate) fn note(message: &str, output: OutputOptions) {
    remark(Level::Info, "note", Lead { word: "note:", colour: output::CYAN }, message, output);
}

fn remark(level: Level, name: &str, lead: Lead, message: &str, output: OutputOptions) {
    if output.quiet {
        return;
    }
    if output::is_json() {
        return output::event(level, name, message, &[]);
    }
    let lead = if is_coloured(output) { lead } else { Lead { colour: "", ..lead } };
    output::led(lead, message);
}

/// Prints a line as it is, unless `--quiet` is given.
pub(crate) fn line(text: &str, output: OutputOptions) {
    if !output.quiet {
        output::message(format_args!("{text}\n"));
    }
}

/// The last word: a result that could not be delivered spoils a good ending.
pub(crate) fn finish(exit: Exit, output: OutputOptions) -> Exit {
    output::attach();
    service::finish();
    let Some(lost) = output::lost_result() else { return exit };
    error(&format!("cannot write the result to stdout: {lost}"), None, output);
    if exit == Exit::Ok { Exit::Asset } else { exit }
}

fn is_coloured(output: OutputOptions) -> bool {
    match output.color {
        When::Always => true,
        When::Never => false,
        When::Auto => {
            std::io::stderr().is_terminal()
                && std::env::var_os("NO_COLOR").is_none_or(|value| value.is_empty())
        }
    }
}
