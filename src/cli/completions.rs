//! `hapticd completions`: what a shell has to know to complete the command line.

use clap::CommandFactory as _;
use clap_complete::Shell;

use super::{Cli, output};
use crate::error::Exit;

/// Arguments of `hapticd completions`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Which shell.
    shell: Shell,
}

pub(crate) fn main(args: &Args) -> Exit {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut Cli::command(), "hapticd", &mut script);
    output::result(format_args!("{}", String::from_utf8_lossy(&script)));
    Exit::Ok
}
