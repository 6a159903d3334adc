//! `hapticd man`: manual pages, made from what `--help` says.

use std::fmt::Write as _;
use std::fs::OpenOptions;
use std::io::Write as _;
use std::path::PathBuf;

use clap::CommandFactory as _;
use clap_mangen::Man;

use super::{Cli, OutputOptions, output, report};
use crate::error::Exit;
use document::PACKAGED;

/// Arguments of `hapticd man`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Folder for one page per command, such as man/man1 [default: the main page to stdout].
    #[arg(value_name = "DIR")]
    folder: Option<PathBuf>,
}

pub(crate) fn main(args: &Args, output: OutputOptions) -> Exit {
    // `help` is no command of ours.
    let command = Cli::command().disable_help_subcommand(true);
    let Some(folder) = &args.folder else {
        let mut page = Vec::new();
        // True invariant: writing to memory does not fail.
        let _ = Man::new(command).render(&mut page);
        output::result(format_args!("{}{}", String::from_utf8_lossy(&page), endings_and_files()));
        return Exit::Ok;
    };
    let written = std::fs::create_dir_all(folder).and_then(|()| clap_mangen::generate_to(command, folder));
    let main_page = || OpenOptions::new().append(true).open(folder.join("hapticd.1"));
    match written.and_then(|()| main_page()?.write_all(endings_and_files().as_bytes())) {
        Ok(()) => Exit::Ok,
        Err(error) => {
            report::error(
                &format!("cannot write to {}: {error}", folder.display()),
                Some("name a folder that this user may write to"),
                output,
            );
            Exit::Asset
        }
    }
}

/// Sections of the main page that no `--help` has.
fn endings_and_files() -> String {
    let mut page = ".SH \"EXIT STATUS\"\n".to_owned();
    for (exit, meaning) in Exit::TABLE {
        // True invariant: writing to memory does not fail.
        let _ = write!(page, ".TP\n{}\n{meaning}\n", exit as u8);
    }
    let scenes = format!("{PACKAGED}/scenes, {PACKAGED}/clay");
    let files = [
        (scenes.as_str(), "Scenes of the Debian package."),
        ("~/.cache/hapticd", "What was baked; $XDG_CACHE_HOME/hapticd where that is set."),
        ("~/.local/state/hapticd/faults", "Recordings of faults; $XDG_STATE_HOME/hapticd/faults where that is set."),
        ("/etc/hapticd", "Scenes of the systemd unit hapticd@."),
        ("/usr/share/doc/hapticd/README.md", "Where the documents begin."),
    ];
    page.push_str(".SH FILES\n");
    for (file, what) in files {
        let _ = write!(page, ".TP\n{file}\n{what}\n");
    }
    page
}
