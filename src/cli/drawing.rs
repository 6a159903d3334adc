//! `run --pictures` and `--video`: what is drawn of a rigid scene while it renders.

use std::path::PathBuf;
use std::time::Duration;

use super::error::CliError;
use super::{OutputOptions, destination, report};
use crate::config::SceneConfig;
use crate::daemon::drawing::{DrawingPlan, DrawnSummary, PicturesPlan};
use crate::error::Exit;
use rt::duration;
use vps::storage::printable::one_line;
use vps::storage::whole_file;

/// Where `--help` lists it.
const HEADING: &str = "Pictures";
/// Endings of animated PNG files.
const FILM_ENDINGS: [&str; 2] = ["png", "apng"];

/// What is to be drawn.
#[derive(Debug, Default, clap::Args)]
pub(crate) struct DrawingArgs {
    /// Draw the scene again and again, at the first tick and at the last: SCENE-TIMEs.png in this
    /// folder. Needs no display.
    #[arg(long, help_heading = HEADING, value_name = "DIR")]
    pictures: Option<PathBuf>,
    /// Time of the run from one of --pictures to the next, such as 500ms.
    #[arg(long, help_heading = HEADING, value_name = "TIME", requires = "pictures", value_parser = parse_every, default_value = "1s")]
    picture_every: Duration,
    /// Make a film of the run, 25 frames a second as an animated PNG, which browsers show and
    /// ffmpeg converts. Needs no display. Under --clock real frames are left out where drawing is
    /// too slow for them.
    #[arg(long, help_heading = HEADING, value_name = "FILE.apng")]
    video: Option<PathBuf>,
}

fn parse_every(text: &str) -> Result<Duration, String> {
    let every = duration::parse(text).map_err(|error| error.to_string())?;
    if every >= Duration::from_millis(1) {
        Ok(every)
    } else {
        Err("write a time of at least 1ms".to_owned())
    }
}

impl DrawingArgs {
    /// Looks whether it can be written, before anything takes long. `None`: nothing is to be drawn.
    pub(crate) fn plan(
        &self,
        config: &SceneConfig,
        overwrite: bool,
        output: OutputOptions,
    ) -> Result<Option<DrawingPlan>, CliError> {
        let mut plan = DrawingPlan::default();
        if let Some(folder) = &self.pictures {
            destination::make_picture_folder(folder, output)?;
            let name = config.path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
            let pictures = PicturesPlan { folder: folder.clone(), name, every: self.picture_every };
            whole_file::check(&pictures.file(0)).map_err(|error| {
                CliError::write(format_args!("to {}", folder.display()), &error)
            })?;
            let names = std::fs::read_dir(folder).into_iter().flatten().flatten();
            let earlier = names
                .map(|entry| entry.file_name().to_string_lossy().into_owned())
                .find(|name| pictures.is_own(name));
            if let Some(earlier) = earlier.filter(|_| !overwrite) {
                let hint = "name another folder, or give --overwrite; pictures of times that this \
                    run does not reach stay";
                return Err(destination::is_there(&folder.join(earlier)).hint(hint));
            }
            plan.pictures = Some(pictures);
        }
        if let Some(file) = &self.video {
            let shown = file.display();
            let is_film = |ending: &std::ffi::OsStr| {
                FILM_ENDINGS.iter().any(|known| ending.eq_ignore_ascii_case(known))
            };
            if !file.extension().is_some_and(is_film) {
                let hint = "name it .apng; `ffmpeg -i FILE.apng FILE.mp4` makes other films of it";
                return Err(
                    CliError::usage(format_args!("{shown}: a film is an animated PNG")).hint(hint)
                );
            }
            whole_file::check(file).map_err(|error| CliError::write(&shown, &error))?;
            if file.exists() && !file.is_file() {
                let message = format!("{shown}: a film is a file, and this is none");
                return Err(CliError::usage(message));
            }
            if file.exists() && !overwrite {
                return Err(destination::is_there(file));
            }
            plan.video = Some(file.clone());
        }
        Ok(Some(plan).filter(|plan| plan.pictures.is_some() || plan.video.is_some()))
    }
}

/// Says why something is missing; the exit code for it.
pub(crate) fn failure(drawn: &DrawnSummary, output: OutputOptions) -> Option<Exit> {
    let error = drawn.error.as_ref()?;
    report::error(&format!("not everything was drawn: {}", one_line(error)), None, output);
    Some(Exit::Asset)
}

/// What was drawn, in words.
pub(crate) fn row(drawn: &DrawnSummary) -> String {
    let DrawnSummary { pictures, video, frames, left_out, .. } = drawn;
    let counted =
        |n: u64, what: &str| if n == 1 { format!("1 {what}") } else { format!("{n} {what}s") };
    let film =
        video.as_ref().map(|file| format!("{} in {}", counted(*frames, "frame"), file.display()));
    let pictures = Some(counted(*pictures, "picture")).filter(|_| *pictures > 0 || video.is_none());
    let left_out =
        Some(format!("{left_out} left out because drawing was too slow")).filter(|_| *left_out > 0);
    [pictures, film, left_out].into_iter().flatten().collect::<Vec<_>>().join(", ")
}
