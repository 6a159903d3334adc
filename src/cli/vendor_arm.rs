//! `hapticd vendor-arm`: the process that the library of an arm's maker runs in. Runs start it;
//! people do not, so no help names it.

use std::process::ExitCode;

use clap::error::ErrorKind;
use clap::{CommandFactory as _, Parser};

use arms::vendor::{self, Assignment};

#[derive(Debug, Parser)]
#[command(
    name = "hapticd vendor-arm",
    about = "Part of a run, which starts it for the library of an arm's maker."
)]
struct Args {
    /// Which arm, as JSON.
    assignment: Assignment,
}

/// Works, where the command line says so.
pub(super) fn main() -> Option<ExitCode> {
    let mut words = std::env::args_os().skip(1);
    words.next().filter(|word| word == "vendor-arm")?;
    let args = Args::parse_from(std::iter::once("hapticd vendor-arm".into()).chain(words));
    Some(vendor::work(&args.assignment).unwrap_or_else(|_| {
        let message = "this is a part of a run, which starts it for the library of an arm's maker: \
            see docs/how-to/arms.md";
        Args::command().error(ErrorKind::MissingRequiredArgument, message).exit()
    }))
}
