//! What `run` says when its scene is read again.

use serde_json::Value;

use super::say::{self, Level};
use super::{Talk, report};
use crate::daemon::desk::Refusal;
use crate::daemon::reload::{Cause, News, Reloaded, Tuned};
use crate::daemon::service;
use crate::document::show;
use crate::storage::printable::shown;

/// Tells people, and a service manager, how a reload goes.
pub(super) fn tell(news: &News, talk: Talk) {
    match news {
        News::Begun(cause) => {
            service::reloading();
            let (word, text) = match cause {
                Cause::Signal => ("signal", "reload: asked for by SIGHUP"),
                Cause::File => ("file", "reload: a file has changed"),
            };
            line(Level::Info, text, &[("cause", word.into())], talk);
        }
        News::Done(done) => {
            let (word, text) = outcome(done);
            service::reloaded(&text);
            let changes = match done {
                Reloaded::Tuned(tunes) => {
                    tunes.iter().map(|Tuned { name, to, .. }| ((*name).to_owned(), Value::from(*to))).collect()
                }
                Reloaded::Unchanged | Reloaded::Baked(_) => serde_json::Map::new(),
            };
            line(Level::Info, &text, &[("outcome", word.into()), ("changes", Value::Object(changes))], talk);
        }
        News::Refused(refusal) => {
            let text = format!("reload refused, the old scene stays: {refusal}");
            service::reloaded(&text);
            say_why(refusal, talk);
        }
        News::TerminalGone => line(Level::Warning, "stop: the terminal has gone", &[("outcome", "stop".into())], talk),
    }
}

fn outcome(done: &Reloaded) -> (&'static str, String) {
    match done {
        Reloaded::Unchanged => ("unchanged", "reload: nothing has changed".to_owned()),
        Reloaded::Tuned(tunes) => {
            let one = |Tuned { name, from, to }: &Tuned| format!("{name} {} -> {}", show(*from), show(*to));
            ("tuned", format!("reload: {}", tunes.iter().map(one).collect::<Vec<_>>().join(", ")))
        }
        Reloaded::Baked(path) => ("baked", format!("reload: {} is baked and comes next", shown(path))),
    }
}

/// An error that ends nothing: every problem of the scene, and that the old one stays.
fn say_why(refusal: &Refusal, talk: Talk) {
    match refusal {
        Refusal::Config(errors) => {
            report::config_errors(errors, talk);
        }
        Refusal::Scene(problem) => {
            report::scene_error(problem, talk);
        }
        Refusal::Unlike { .. } => {
            report::error(&refusal.to_string(), Some("this counts from the start of a run on: begin a new one"), talk)
        }
        Refusal::Clay { .. } => {
            let hint =
                "the page chooses tools; whatever else counts from the start of a run on: save a session and begin a new one";
            report::error(&refusal.to_string(), Some(hint), talk);
        }
        _ => report::error(&refusal.to_string(), None, talk),
    }
    line(Level::Warning, "reload: refused, the old scene stays", &[("outcome", "refused".into())], talk);
}

fn line(level: Level, text: &str, fields: say::Fields<'_>, talk: Talk) {
    if !talk.quiet {
        say::event(level, "reload", text, fields);
    }
}
