//! `hapticd report`: one page of a recording, for the notes of a lab.

use std::path::PathBuf;

use super::{Talk, report, say};
use crate::error::Exit;
use crate::telemetry::recording::{ReadError, Recording};
use crate::telemetry::report::LabReport;

/// Arguments of `hapticd report`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Recording of `run --record`, or of the flight recorder.
    recording: PathBuf,
    /// Where to write the page: HTML that needs no other file.
    #[arg(short, long, value_name = "F.html")]
    out: PathBuf,
}

pub(crate) fn main(args: &Args, talk: Talk) -> Exit {
    let page = match read(args) {
        Ok(page) => page,
        Err(problem) => {
            report::error(&problem.to_string(), Some("give a file of `hapticd run --record`"), talk);
            return Exit::Asset;
        }
    };
    let n_ticks = page.ticks();
    if n_ticks == 0 {
        report::error(&format!("{} holds no tick", args.recording.display()), None, talk);
        return Exit::Asset;
    }
    if let Err(error) = std::fs::write(&args.out, page.page()) {
        report::error(&format!("cannot write {}: {error}", args.out.display()), None, talk);
        return Exit::Asset;
    }
    if !talk.quiet {
        say::talk(format_args!("{}: {n_ticks} ticks\n", args.out.display()));
    }
    Exit::Ok
}

fn read(args: &Args) -> Result<LabReport, ReadError> {
    let mut recording = Recording::open(&args.recording)?;
    let mut page = LabReport::new(args.recording.display().to_string());
    while let Some(entry) = recording.next_entry()? {
        page.take(&entry);
    }
    Ok(page)
}
