//! `hapticd guard`: the process that takes the force away when hapticd dies or stands still. Runs
//! start it; people do not, so no help names it.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::CommandFactory as _;
use clap::error::ErrorKind;

use super::Cli;
use arms::guard;

/// Watches, where the command line says so.
pub(super) fn main() -> Option<ExitCode> {
    let watched = guard::watch_if_asked()?;
    if watched.is_err() {
        let message = "this is a part of a run, which starts it beside a real arm: see \
            docs/reference/safety.md";
        Cli::command().error(ErrorKind::MissingRequiredArgument, message).exit();
    }
    Some(ExitCode::SUCCESS)
}

/// The program of a guard: this one, also after its file was replaced.
pub(super) fn program() -> Option<PathBuf> {
    Some(PathBuf::from("/proc/self/exe"))
}

/// What to say where there is none.
pub(super) fn missing_text(why: &str) -> String {
    format!(
        "device: no guard ({why}): if hapticd is killed or stands still, the arm keeps its last \
            force until its own watchdog, if it has one, lets go"
    )
}
