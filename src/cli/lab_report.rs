//! `hapticd report`: one page of a recording, for the notes of a lab.

use std::path::{Path, PathBuf};

use super::error::{CliError, Outcome};
use super::{OutputOptions, report};
use crate::daemon::drawing::drawn_parts;
use crate::daemon::{RecordedScene, UnpackError, Unpacked};
use crate::error::Exit;
use picture::parts::{SceneSnapshot, sheet};
use recording::file::{Entry, ReadError, Recording};
use recording::report::{KeyFrame, LabReport};
use vps::storage::printable::one_line;
use vps::storage::whole_file::write_bytes;

/// Arguments of `hapticd report`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Recording of `run --record`, or of the flight recorder.
    recording: PathBuf,
    /// Where to write the page: HTML that needs no other file [default: beside the recording, by
    /// its name].
    #[arg(short, long, alias = "output", value_name = "F.html")]
    out: Option<PathBuf>,
    /// Replace the page if there is one.
    #[arg(long)]
    overwrite: bool,
}

pub(crate) fn main(args: &Args, output: OutputOptions) -> Outcome {
    let out = args.out.clone().unwrap_or_else(|| args.recording.with_extension("html"));
    let shown = out.display();
    // Before the recording is read, which may take a while.
    may_write(args, &out).map_err(|problem| {
        CliError::usage(format_args!("{shown} {problem}")).hint("give another name, or --overwrite")
    })?;
    let page = read(args)
        .map_err(|problem| CliError::asset(&problem).hint(super::replay::read_hint(&problem)))?;
    let n_ticks = page.ticks();
    if n_ticks == 0 {
        let recording = args.recording.display();
        return Err(CliError::asset(format_args!("{recording} ends before its first tick")));
    }
    write_bytes(&out, page.page().as_bytes()).map_err(|error| CliError::write(&shown, &error))?;
    report::line(&format!("{shown}: {n_ticks} ticks"), output);
    Ok(Exit::Ok)
}

/// What a recording shows, for a page that is not written to a file.
pub(super) fn of_recording(recording: &Path) -> Result<LabReport, ReadError> {
    read(&Args { recording: recording.to_owned(), out: None, overwrite: false })
}

/// Whether the page may be written where it is asked for; never over the recording that it is made
/// of.
fn may_write(args: &Args, out: &Path) -> Result<(), &'static str> {
    let is_the_recording =
        || Some(std::fs::canonicalize(out).ok()? == std::fs::canonicalize(&args.recording).ok()?);
    if is_the_recording() == Some(true) {
        return Err("is the recording itself");
    }
    if !args.overwrite && out.is_file() { Err("exists already") } else { Ok(()) }
}

fn read(args: &Args) -> Result<LabReport, ReadError> {
    let mut recording = Recording::open(&args.recording)?;
    // The page may be read elsewhere than beside the recording.
    let file = std::path::absolute(&args.recording).unwrap_or_else(|_| args.recording.clone());
    let mut page = LabReport::new(file.display().to_string());
    let mut unpacked = Unpacked::new();
    while let Some(entry) = recording.next_entry()? {
        page.take(&entry);
        unpacked = unpacked.and_then(|files| unpack(files, entry));
    }
    if !recording.is_whole() {
        page.cut_off();
    }
    recording.first_tick_at().into_iter().for_each(|at| page.begun_at(at));
    // A page without its picture is still a page: what is wrong with the scene's files stands on
    // it.
    let drawn = unpacked.map_err(|problem| problem.to_string()).and_then(|files| {
        let moment = page.moment().ok_or("no tick has a pose of the tool")?;
        let at_end = page.end().map(|end| picture(&page, &files, &end)).transpose()?;
        Ok((picture(&page, &files, moment)?, at_end))
    });
    match drawn {
        Ok((png, at_end)) => {
            page.put_picture(Ok(png));
            at_end.into_iter().for_each(|png| page.put_end_picture(png));
        }
        Err(why) => page.put_picture(Err(one_line(&why).into_owned())),
    }
    Ok(page)
}

/// Keeps what scenes are made of.
fn unpack(mut files: Unpacked, entry: Entry) -> Result<Unpacked, UnpackError> {
    match entry {
        Entry::Attachment { name, data } => files.put(&name, &data)?,
        Entry::Metadata { name, values } => files.note(name, values),
        Entry::Tick { .. } => {}
    }
    Ok(files)
}

/// The scene in a moment of the page.
fn picture(page: &LabReport, files: &Unpacked, moment: &KeyFrame) -> Result<Vec<u8>, String> {
    let RecordedScene { config, .. } =
        files.scene(moment.scene_idx).map_err(|problem| problem.to_string())?;
    let parts = drawn_parts(&config).map_err(|problem| problem.to_string())?;
    let place = |(idx, pose)| moment.moved.get(&(idx as u32)).copied().unwrap_or(pose);
    let world_from_objects: Vec<_> =
        config.statics.iter().map(|object| object.pose).enumerate().map(place).collect();
    let path = page.path(moment.scene_idx);
    let snapshot = SceneSnapshot {
        parts: &parts,
        world_from_objects: &world_from_objects,
        world_from_tool: moment.world_from_tool,
        path,
    };
    sheet(&snapshot).map_err(|problem| problem.to_string())
}
