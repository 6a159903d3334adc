//! What changes while a run goes on: `--move` and `--swap`.

use std::fmt::{Display, Formatter};
use std::path::PathBuf;
use std::time::Duration;

use serde::Serialize;

use super::cache::CacheArgs;
use super::error::CliError;
use super::memory::{MemoryArgs, MemoryRule};
use super::{OutputOptions, report};
use crate::config::{self, LoadOptions, SceneConfig};
use crate::daemon::session::{PlannedScene, SessionHandle, objects};
use crate::daemon::unlike;
use crate::error::Exit;
use crate::scene::cache::CachePolicy;
use crate::scene::{self, ObjectReport, SceneError};
use arms::simulated::hand::HandPath;
use document::poses::PoseFileError;
use engine::servo::{ControlError, ObjectPaths};
use haptics::RenderScene;
use recording::SwapSummary;
use rt::duration;
use vps::storage::printable::shown;

/// Arguments that change a run while it goes on.
#[derive(Debug, Default, clap::Args)]
pub(crate) struct LiveArgs {
    /// Let a movable object of SCENE follow timed poses in the world, a CSV file like that of a
    /// hand; may be repeated.
    #[arg(long = "move", value_name = "NAME=FILE", value_parser = parse_move)]
    moves: Vec<(String, PathBuf)>,
    /// Go over to another scene for the same arm at that time, such as b.toml@3s; baked while the
    /// first one renders; may be repeated. Hand, clock and real-time settings stay those of SCENE.
    #[arg(long = "swap", value_name = "SCENE@TIME", value_parser = parse_swap)]
    swaps: Vec<(PathBuf, Duration)>,
    /// Read the scene again when its file or a mesh of it changes, as SIGHUP does: parameters go to
    /// their new values, anything else is baked and switched, what is wrong is refused.
    #[arg(long)]
    pub(crate) watch: bool,
}

fn parse_move(text: &str) -> Result<(String, PathBuf), String> {
    match text.split_once('=') {
        Some((name, file)) if !name.is_empty() && !file.is_empty() => {
            Ok((name.to_owned(), PathBuf::from(file)))
        }
        _ => Err(
            "write the name of a movable object and a file of poses, such as plate=hands/plate.csv"
                .to_owned(),
        ),
    }
}

fn parse_swap(text: &str) -> Result<(PathBuf, Duration), String> {
    match text.rsplit_once('@') {
        Some((file, time)) if !file.is_empty() => {
            Ok((PathBuf::from(file), duration::parse(time).map_err(|error| error.to_string())?))
        }
        _ => Err("write a scene file and when to go over to it, such as b.toml@3s".to_owned()),
    }
}

/// What came of a `--swap`, as `--json` has it.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct SwapReport {
    /// The scene file.
    scene: PathBuf,
    /// When it was to come, s.
    wanted_s: f64,
    /// Its first tick; null when it did not come.
    tick: Option<u64>,
    /// Loop time of that tick, s.
    at_s: Option<f64>,
}

impl Display for SwapReport {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        match (self.at_s, self.tick) {
            (Some(at_s), Some(tick)) => {
                write!(f, "{} from {at_s:.3} s on (tick {tick})", shown(&self.scene))
            }
            _ => write!(f, "{} did not come, wanted at {:.3} s", shown(&self.scene), self.wanted_s),
        }
    }
}

/// The changes of a run, all read and checked.
pub(crate) struct Changes {
    paths: ObjectPaths,
    planned: Vec<PlannedScene>,
    /// When each of them is wanted.
    swaps: PlannedSwaps,
}

/// Scenes to go over to, and when; in the order of their times.
#[derive(Debug, Default)]
pub(crate) struct PlannedSwaps(Vec<(PathBuf, Duration)>);

impl LiveArgs {
    /// Reads and checks what the arguments name.
    pub(crate) fn check(
        &self,
        scene: &SceneConfig,
        options: &LoadOptions,
        ends: Option<Duration>,
    ) -> Result<Changes, CliError> {
        let path = scene.path.display();
        let mut paths = Vec::new();
        for (name, file) in &self.moves {
            let path = HandPath::read(file).map_err(|problem| {
                let remedy = matches!(problem, PoseFileError::Read { .. })
                    .then_some("--move NAME=FILE takes a CSV file of poses");
                CliError::configuration(format_args!("--move {name}: {problem}")).hint(remedy)
            })?;
            paths.push((name.clone(), path));
        }
        let paths = ObjectPaths::new(&objects(scene), paths).map_err(|problem| {
            let is_none_movable = matches!(
                &problem,
                ControlError::UnknownObject { known, .. } if known.is_empty()
            );
            let remedy = is_none_movable
                .then_some("no object of the scene is movable; set `movable = true`");
            CliError::configuration(format_args!("--move: {path}: {problem}")).hint(remedy)
        })?;
        let mut swaps = Vec::new();
        for (file, at) in &self.swaps {
            let config = config::load_with(file, options)?;
            let file = file.display();
            if let Some((key, its, ours)) = unlike(&config, scene) {
                let message = format!("{file}: {key} = {its}, but {path} has {ours}");
                return Err(CliError::configuration(message)
                    .hint("this counts from the start of a run on; write the same in both"));
            }
            if let Some(ends) = ends.filter(|ends| at >= ends) {
                let message = format!("--swap {file}: at {at:?}, but the run ends after {ends:?}");
                return Err(
                    CliError::usage(message).hint("give a time before the end of --duration")
                );
            }
            let at_tick = (at.as_secs_f64() / scene.parameters.period_s).round() as u64;
            swaps.push((*at, PlannedScene { config, at_tick }));
        }
        swaps.sort_by_key(|(_, scene)| scene.at_tick);
        let times = swaps.iter().map(|(at, scene)| (scene.config.path.clone(), *at)).collect();
        let planned = swaps.into_iter().map(|(_, scene)| scene).collect();
        Ok(Changes { paths, planned, swaps: PlannedSwaps(times) })
    }
}

impl Changes {
    /// Begins to bake the other scenes, which goes on until the loop is over. `is_open`: more may
    /// be asked for than was planned.
    pub(crate) fn begin(
        self,
        session: &SessionHandle,
        cache: &CacheArgs,
        memory: &MemoryArgs,
        is_open: bool,
        output: OutputOptions,
    ) -> std::io::Result<(ObjectPaths, PlannedSwaps)> {
        if is_open || !self.planned.is_empty() {
            let cache = cache.clone();
            let memory = memory.clone();
            session.begin_baking(
                Box::new(move |config| bake(config, &cache, &memory, output)),
                self.planned,
            )?;
        }
        Ok((self.paths, self.swaps))
    }
}

fn bake(
    config: &SceneConfig,
    cache: &CacheArgs,
    memory: &MemoryArgs,
    output: OutputOptions,
) -> Result<(RenderScene, Vec<ObjectReport>), SceneError> {
    let memory = MemoryRule::Left(memory);
    // Without progress: the screen belongs to the run.
    let (scene, reports) = cache.bake(CachePolicy::Copy, memory, output, |options, _| {
        scene::build_with(config, options, |_| ())
    })?;
    report::bake_warnings_of(&format!("{}: ", config.path.display()), &reports, output);
    Ok((scene, reports))
}

/// Says which planned scenes could not be baked, if any; the exit code of the first.
pub(crate) fn failure(session: &SessionHandle, output: OutputOptions) -> Option<Exit> {
    let say = |(path, problem): (PathBuf, SceneError)| {
        let message = format!("{} was not rendered: it cannot be baked", path.display());
        report::error(&message, None, output);
        CliError::from(problem).report(output)
    };
    session.take_failed().into_iter().map(say).reduce(|first, _| first)
}

impl PlannedSwaps {
    /// What came of each.
    pub(crate) fn reports(
        &self,
        session: &SessionHandle,
        swaps: &[SwapSummary],
    ) -> Vec<SwapReport> {
        let report = |(idx, (scene, at)): (usize, &(PathBuf, Duration))| {
            let number = session.planned_scene_idx(idx);
            let swap = number.and_then(|number| swaps.iter().find(|swap| swap.scene_idx == number));
            SwapReport {
                scene: scene.clone(),
                wanted_s: at.as_secs_f64(),
                tick: swap.map(|swap| swap.tick),
                at_s: swap.map(|swap| swap.at_s),
            }
        };
        self.0.iter().enumerate().map(report).collect()
    }
}
