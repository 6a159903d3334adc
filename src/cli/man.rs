//! `hapticd man`: manual pages, made from what `--help` says.

use std::path::PathBuf;

use clap::CommandFactory as _;
use clap_mangen::Man;

use super::{Cli, Talk, report, say};
use crate::error::Exit;

/// Arguments of `hapticd man`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Folder for one page per command, such as man/man1 [default: the main page to stdout].
    #[arg(value_name = "DIR")]
    folder: Option<PathBuf>,
}

pub(crate) fn main(args: &Args, talk: Talk) -> Exit {
    // `help` is no command of ours.
    let command = Cli::command().disable_help_subcommand(true);
    let Some(folder) = &args.folder else {
        let mut page = Vec::new();
        // True invariant: writing to memory does not fail.
        let _ = Man::new(command).render(&mut page);
        say::result(format_args!("{}", String::from_utf8_lossy(&page)));
        return Exit::Ok;
    };
    match std::fs::create_dir_all(folder).and_then(|()| clap_mangen::generate_to(command, folder)) {
        Ok(()) => Exit::Ok,
        Err(error) => {
            report::error(
                &format!("cannot write to {}: {error}", folder.display()),
                Some("name a folder that this user may write to"),
                talk,
            );
            Exit::Asset
        }
    }
}
