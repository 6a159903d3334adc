//! What `run` says when its scene is read again.

use serde_json::Value;

use super::error::CliError;
use super::output::{self, Level};
use super::{OutputOptions, report};
use crate::daemon::reload::{Cause, ReloadNotice, Reloaded};
use crate::daemon::service;
use crate::daemon::session::SessionError;
use document::show;
use engine::servo::FileChange;
use vps::storage::printable::shown;

/// Reports to the user, and to a service manager, how a reload goes.
pub(super) fn tell(news: &ReloadNotice, output: OutputOptions) {
    match news {
        ReloadNotice::Begun(cause) => {
            service::reloading();
            let (word, text) = match cause {
                Cause::Signal => ("signal", "reload: asked for by SIGHUP"),
                Cause::File => ("file", "reload: a file has changed"),
            };
            line(Level::Info, text, &[("cause", word.into())], output);
        }
        ReloadNotice::Done(done) => {
            let (word, text) = outcome(done);
            service::reloaded(&text);
            let changes = match done {
                Reloaded::Changed(changes) => changes
                    .iter()
                    .map(|FileChange { name, to, .. }| ((*name).to_owned(), Value::from(*to)))
                    .collect(),
                Reloaded::Unchanged | Reloaded::Baked(_) => serde_json::Map::new(),
            };
            line(
                Level::Info,
                &text,
                &[("outcome", word.into()), ("changes", Value::Object(changes))],
                output,
            );
        }
        ReloadNotice::Refused(refusal) => {
            let text = format!("reload refused, the old scene stays: {refusal}");
            service::reloaded(&text);
            say_why(refusal, output);
        }
        ReloadNotice::TerminalGone => line(
            Level::Warning,
            "stop: the terminal has gone",
            &[("outcome", "stop".into())],
            output,
        ),
    }
}

fn outcome(done: &Reloaded) -> (&'static str, String) {
    match done {
        Reloaded::Unchanged => ("unchanged", "reload: nothing has changed".to_owned()),
        Reloaded::Changed(changes) => {
            let one = |FileChange { name, from, to }: &FileChange| {
                format!("{name} {} -> {}", show(*from), show(*to))
            };
            ("tuned", format!("reload: {}", changes.iter().map(one).collect::<Vec<_>>().join(", ")))
        }
        Reloaded::Baked(path) => {
            ("baked", format!("reload: {} is baked and comes next", shown(path)))
        }
    }
}

/// An error that ends nothing: every problem of the scene, and that the old one stays.
fn say_why(refusal: &SessionError, output: OutputOptions) {
    match refusal {
        SessionError::Config(errors) => {
            CliError::from(errors).report(output);
        }
        SessionError::Scene(problem) => {
            CliError::from(problem).report(output);
        }
        SessionError::Unlike { .. } => report::error(
            &refusal.to_string(),
            Some("this counts from the start of a run on: begin a new one"),
            output,
        ),
        SessionError::Clay { .. } => {
            let hint = "the page chooses tools; whatever else counts from the start of a run on: \
                save a session and begin a new one";
            report::error(&refusal.to_string(), Some(hint), output);
        }
        _ => report::error(&refusal.to_string(), None, output),
    }
    line(
        Level::Warning,
        "reload: refused, the old scene stays",
        &[("outcome", "refused".into())],
        output,
    );
}

fn line(level: Level, text: &str, fields: output::Fields<'_>, output: OutputOptions) {
    if !output.quiet {
        output::event(level, "reload", text, fields);
    }
}
