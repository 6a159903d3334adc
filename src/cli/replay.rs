//! `hapticd replay`: a recording again, bit for bit.

use std::path::PathBuf;

use serde::Serialize;

use super::bake::print_json;
use super::error::{CliError, Outcome};
use super::memory::{MemoryArgs, MemoryRule};
use super::{OutputOptions, cache, output, report};
use crate::config::SceneConfig;
use crate::daemon::{ReplayError, Replayed, UnpackError, replay};
use crate::error::Exit;
use crate::scene::cache::CachePolicy;
use crate::scene::{self, SceneError};
use haptics::RenderScene;
use recording::file::ReadError;
use vps::storage::printable::one_line;

/// Arguments of `hapticd replay`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Recording of `run --record`.
    recording: PathBuf,
    #[command(flatten)]
    memory: MemoryArgs,
    #[command(flatten)]
    cache: cache::CacheArgs,
    /// Print the result as one JSON object.
    #[arg(long)]
    json: bool,
}

/// The object of `--json`.
#[derive(Serialize)]
struct ReplayReport<'r> {
    identical: bool,
    #[serde(flatten)]
    replayed: &'r Replayed,
}

pub(crate) fn main(args: &Args, output: OutputOptions) -> Outcome {
    let bake = |config: &SceneConfig| bake(config, args, output);
    let replayed = replay(&args.recording, bake).map_err(refused)?;
    for changed in &replayed.changed {
        report::warning(
            &format!("this version reads the scene in another way: {}", one_line(changed)),
            output,
        );
    }
    if !replayed.whole && replayed.is_identical() {
        report::note(
            "the file has no end, its recorder was stopped short: this is what can be read of it",
            output,
        );
    }
    if args.json {
        print_json(&ReplayReport { identical: replayed.is_identical(), replayed: &replayed });
    } else {
        output::result(format_args!("{}\n", verdict(&replayed)));
    }
    Ok(if replayed.is_identical() { Exit::Ok } else { Exit::Asset })
}

fn verdict(replayed: &Replayed) -> String {
    let Replayed { ticks, gap, difference, .. } = replayed;
    match (difference, gap) {
        (Some(difference), _) => format!(
            "differs in tick {}, scene {}: {}\n  recorded {}\n  replayed {}\n{ticks} ticks before \
                it are bit-identical",
            difference.tick,
            difference.scene_idx,
            difference.field,
            difference.recorded,
            difference.replayed
        ),
        (None, Some(gap)) => format!(
            "bit-identical up to a gap: {ticks} ticks; {} ticks from {} on are missing, and \
                nothing behind them can be run",
            gap.next.saturating_sub(gap.first_missing),
            gap.first_missing
        ),
        (None, None) => format!("bit-identical, {ticks} ticks"),
    }
}

fn bake(
    config: &SceneConfig,
    args: &Args,
    output: OutputOptions,
) -> Result<RenderScene, SceneError> {
    // The scene comes with the recording: it must not end this program.
    let memory = MemoryRule::Left(&args.memory);
    let built = args.cache.bake(CachePolicy::Copy, memory, output, |options, progress| {
        scene::build_with(config, options, |event| progress.tell(&event))
    });
    built.map(|(scene, _)| scene)
}

fn refused(problem: ReplayError) -> CliError {
    let hint = match &problem {
        ReplayError::Scene(problem) => return problem.into(),
        ReplayError::Unpack(UnpackError::Config(errors)) => {
            return CliError::from(errors).exit(Exit::Asset);
        }
        ReplayError::BeganLate(_) => Some(
            "only one from the start of a run can be run again (`run --record`); `hapticd report` \
                shows this one",
        ),
        ReplayError::OtherForceLaw { .. } => Some(
            "replay it with the version that recorded it; `hapticd report` and the viewers show it \
                in this one as well",
        ),
        ReplayError::Clay { .. } => Some("its forces are in it: `hapticd report` shows them"),
        ReplayError::Read(problem) => read_hint(problem),
        ReplayError::Unpack(_) | ReplayError::Empty { .. } => None,
    };
    // Names in a recording are not ours.
    CliError::asset(one_line(&problem.to_string())).hint(hint)
}

/// What to do about a recording that cannot be read.
pub(super) fn read_hint(problem: &ReadError) -> Option<&'static str> {
    match problem {
        ReadError::File { .. } => None,
        ReadError::Format { .. } => Some(
            "give a file of `hapticd run --record`; of one that is damaged `mcap recover` saves \
                what can be read",
        ),
    }
}
