//! `hapticd guard`: the process that takes the force away when hapticd dies or stands still. Runs
//! start it; people do not, so no help names it.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::error::ErrorKind;
use clap::{CommandFactory as _, Parser};

use arms::guard::{self, ZeroFrame};

#[derive(Debug, Parser)]
#[command(name = "hapticd guard", about = "Part of a run, which starts it beside a real arm.")]
struct Args {
    /// The zero frame of the arm, as hex.
    frame: ZeroFrame,
    /// Of SCHED_FIFO.
    #[arg(long)]
    priority: Option<u8>,
}

/// Watches, where the command line says so.
pub(super) fn main() -> Option<ExitCode> {
    let mut words = std::env::args_os().skip(1);
    words.next().filter(|word| word == "guard")?;
    let args = Args::parse_from(std::iter::once("hapticd guard".into()).chain(words));
    if guard::watch(&args.frame, args.priority).is_err() {
        let message = "this is a part of a run, which starts it beside a real arm: see \
            docs/reference/safety.md";
        Args::command().error(ErrorKind::MissingRequiredArgument, message).exit();
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
