//! What changes while a run goes on: `--move` and `--swap`.

use std::fmt::{Display, Formatter};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use crossbeam::channel::{Receiver, Sender, never, unbounded};
use serde::Serialize;

use super::cache::CacheArgs;
use super::memory::MemoryArgs;
use super::progress::BakeProgress;
use super::{Talk, cache, report};
use crate::config::{self, LoadOptions, SceneConfig};
use crate::daemon::desk::{Noted, unlike};
use crate::daemon::switch::{self, Done, Switch, objects};
use crate::daemon::{Live, scene_files};
use crate::device::simulated::hand::HandPath;
use crate::document::poses::PoseFileError;
use crate::error::Exit;
use crate::haptics::RenderScene;
use crate::rt::clock::ClockKind;
use crate::rt::duration;
use crate::scene::cache::Residence;
use crate::scene::{self, BakeMeans, SceneError};
use crate::servo::{Lowered, PlaceError, SwapSlot, Wishes};
use crate::storage::memory::available_bytes;
use crate::storage::printable::shown;
use crate::telemetry::SwapSummary;
use crate::telemetry::recording::Recorder;

/// Arguments that change a run while it goes on.
#[derive(Debug, Default, clap::Args)]
pub(crate) struct LiveArgs {
    /// Let a movable object of SCENE follow timed poses in the world, a CSV file like that of a hand; may be repeated.
    #[arg(long = "move", value_name = "NAME=FILE", value_parser = parse_move)]
    moves: Vec<(String, PathBuf)>,
    /// Go over to another scene for the same arm at that time, such as b.toml@3s; baked while the first one renders; may be repeated. Hand,
    /// clock and real-time settings stay those of SCENE.
    #[arg(long = "swap", value_name = "SCENE@TIME", value_parser = parse_swap)]
    swaps: Vec<(PathBuf, Duration)>,
    /// Read the scene again when its file or a mesh of it changes, as SIGHUP does: parameters go to their new values, anything else is baked and
    /// switched, what is wrong is refused.
    #[arg(long)]
    pub(crate) watch: bool,
}

fn parse_move(text: &str) -> Result<(String, PathBuf), String> {
    match text.split_once('=') {
        Some((name, file)) if !name.is_empty() && !file.is_empty() => Ok((name.to_owned(), PathBuf::from(file))),
        _ => Err("write the name of a movable object and a file of poses, such as plate=hands/plate.csv".to_owned()),
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

/// One scene to go over to.
struct PlannedSwap {
    config: SceneConfig,
    at: Duration,
    at_tick: u64,
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
            (Some(at_s), Some(tick)) => write!(f, "{} from {at_s:.3} s on (tick {tick})", shown(&self.scene)),
            _ => write!(f, "{} did not come, wanted at {:.3} s", shown(&self.scene), self.wanted_s),
        }
    }
}

/// The changes of a run, all read and checked.
pub(crate) struct Changes {
    wishes: Wishes,
    swaps: Vec<PlannedSwap>,
    recorded: Option<(Recorder, LoadOptions)>,
}

impl LiveArgs {
    /// Reads and checks what the arguments name; says what is wrong with it.
    pub(crate) fn check(
        &self,
        scene: &SceneConfig,
        options: &LoadOptions,
        ends: Option<Duration>,
        talk: Talk,
    ) -> Result<Changes, Exit> {
        let mut paths = Vec::new();
        for (name, file) in &self.moves {
            let path = HandPath::read(file).map_err(|problem| {
                let remedy = matches!(problem, PoseFileError::Read { .. }).then_some("--move NAME=FILE takes a CSV file of poses");
                report::error(&format!("--move {name}: {problem}"), remedy, talk);
                Exit::Configuration
            })?;
            paths.push((name.clone(), path));
        }
        let wishes = Wishes::new(&objects(scene), None, paths).map_err(|problem| {
            let remedy = match &problem {
                PlaceError::Unknown { known, .. } if known.is_empty() => {
                    Some("no object of the scene is movable; set `movable = true`")
                }
                _ => None,
            };
            report::error(&format!("--move: {}: {problem}", scene.path.display()), remedy, talk);
            Exit::Configuration
        })?;
        let mut swaps = Vec::new();
        for (file, at) in &self.swaps {
            let config = config::load_with(file, options).map_err(|errors| report::config_errors(&errors, talk))?;
            let refusal = unlike(&config, scene);
            if let Some((key, its, ours)) = refusal {
                let message = format!("{}: {key} = {its}, but {} has {ours}", file.display(), scene.path.display());
                report::error(&message, Some("this counts from the start of a run on; write the same in both"), talk);
                return Err(Exit::Configuration);
            }
            if let Some(ends) = ends.filter(|ends| at >= ends) {
                let message = format!("--swap {}: at {at:?}, but the run ends after {ends:?}", file.display());
                report::error(&message, Some("give a time before the end of --duration"), talk);
                return Err(Exit::Usage);
            }
            let at_tick = (at.as_secs_f64() / scene.parameters.period_s).round() as u64;
            swaps.push(PlannedSwap { config, at: *at, at_tick });
        }
        swaps.sort_by_key(|swap| swap.at_tick);
        Ok(Changes { wishes, swaps, recorded: None })
    }
}

/// What went wrong with a scene while another was rendered.
pub(crate) struct Failed {
    path: PathBuf,
    problem: SceneError,
}

/// A scene file, and which of the planned ones it is.
type OfferedScene = (PathBuf, Option<usize>);

/// Scene files in the order in which the loop takes them. Clones share it.
#[derive(Clone, Default)]
pub(crate) struct OfferedScenes {
    list: Arc<Mutex<Vec<OfferedScene>>>,
    /// Recordings bring along what each is made of.
    recorded: Option<(Recorder, LoadOptions)>,
}

impl OfferedScenes {
    /// Looks at what a scene is made of, before it is baked: what is written meanwhile is not what is rendered. What comes back takes note that
    /// the loop will take it next.
    pub(crate) fn look(&self, config: &SceneConfig, planned: Option<usize>) -> Noted {
        let (offered, path) = (self.clone(), config.path.clone());
        let files = self.recorded.as_ref().map(|(_, options)| scene_files(config, options));
        Box::new(move || {
            offered.list().push((path, planned));
            if let (Some(recorder), Some(files)) = (offered.recorder(), files) {
                recorder.scenes.add(files);
            }
        })
    }

    /// Who records the run.
    pub(crate) fn recorder(&self) -> Option<&Recorder> {
        self.recorded.as_ref().map(|(recorder, _)| recorder)
    }

    fn list(&self) -> MutexGuard<'_, Vec<OfferedScene>> {
        self.list.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The changes while they take place.
pub(crate) struct UnderWay {
    failed: Receiver<Failed>,
    planned: Vec<(PathBuf, Duration)>,
    pub(crate) offered: OfferedScenes,
}

/// A run that can be changed.
pub(crate) struct Begun {
    /// For the supervisor.
    pub(crate) live: Live,
    /// For the screen and the summary.
    pub(crate) under_way: UnderWay,
    /// Takes more scenes; `None` where nothing was planned and nobody may ask.
    pub(crate) switches: Option<Sender<Switch>>,
    /// Limits that every scene keeps once a client lowered them.
    pub(crate) lowered: Lowered,
}

/// Hears of every planned scene that is offered.
pub(crate) type Hears = Box<dyn Fn(switch::Offered) + Send>;

impl Changes {
    /// The same, with somebody who records the scenes too; they are read with these options.
    pub(crate) fn recorded_by(self, recorder: &Recorder, options: &LoadOptions) -> Self {
        Self { recorded: Some((recorder.clone(), options.clone())), ..self }
    }

    /// Begins: the thread that bakes the other scenes runs until the loop is over. `is_open`: more may be asked for than was planned.
    pub(crate) fn begin(
        self,
        cache: &CacheArgs,
        memory: &MemoryArgs,
        clock: ClockKind,
        is_open: bool,
        hears: impl Fn() -> Option<Hears>,
        talk: Talk,
    ) -> std::io::Result<Begun> {
        let (failures, failed) = unbounded();
        let offered = OfferedScenes { recorded: self.recorded, ..OfferedScenes::default() };
        let planned = self.swaps.iter().map(|swap| (swap.config.path.clone(), swap.at)).collect();
        let (mut swaps, mut switches, lowered) = (None, None, Lowered::default());
        if is_open || !self.swaps.is_empty() {
            let (swapper, slot) = SwapSlot::new(self.swaps.iter().map(|swap| swap.at_tick).collect());
            swaps = Some(slot);
            let (cache, memory) = (cache.clone(), memory.clone());
            let sender =
                switch::spawn(Box::new(move |config| bake(config, &cache, &memory, talk)), swapper, clock, lowered.clone())?;
            for (idx, PlannedSwap { config, at_tick, .. }) in self.swaps.into_iter().enumerate() {
                let (failures, note, hears, path) =
                    (failures.clone(), offered.look(&config, Some(idx)), hears(), config.path.clone());
                let done = Done::new(move |result| match result {
                    Some(Ok(scene)) => {
                        note();
                        if let Some(hears) = hears {
                            hears(scene);
                        }
                    }
                    // If the run is over, nobody wants to know.
                    Some(Err(problem)) => drop(failures.send(Failed { path, problem })),
                    None => {}
                });
                // It has just begun.
                let _ = sender.send(Switch { config, at_tick, is_promised: true, done });
            }
            switches = Some(sender);
        }
        let live = Live { wishes: self.wishes, swaps, ..Live::default() };
        Ok(Begun { live, under_way: UnderWay { failed, planned, offered }, switches, lowered })
    }
}

fn bake(config: &SceneConfig, cache: &CacheArgs, memory: &MemoryArgs, talk: Talk) -> Result<RenderScene, SceneError> {
    let mut cache = cache.open(Residence::Owned, talk);
    // Quiet: the screen belongs to the run.
    let progress = BakeProgress::new(Talk { quiet: true, verbose: 0, ..talk });
    let mut means = BakeMeans { cache: &mut cache, memory: memory.plan_within(available_bytes, &progress, talk) };
    let built = scene::build_with(config, &mut means, |_| ());
    drop(means);
    cache::tell(&mut cache, talk);
    let (scene, reports) = built?;
    report::bake_warnings_of(&format!("{}: ", config.path.display()), &reports, talk);
    Ok(scene)
}

impl Default for UnderWay {
    /// Nothing changes.
    fn default() -> Self {
        Self { failed: never(), planned: Vec::new(), offered: OfferedScenes::default() }
    }
}

impl UnderWay {
    /// The scene of a number, for people.
    pub(crate) fn scene(&self, scene_idx: u32) -> PathBuf {
        let offered = self.offered.list();
        let taken = (scene_idx as usize).checked_sub(1).and_then(|n| offered.get(n));
        taken.map_or_else(|| PathBuf::from("another scene"), |(path, _)| path.clone())
    }

    /// Says what went wrong, if anything; the exit code of the first failure.
    pub(crate) fn failure(&self, talk: Talk) -> Option<Exit> {
        let say = |Failed { path, problem }: Failed| {
            report::error(&format!("{} was not rendered: it cannot be baked", path.display()), None, talk);
            report::scene_error(&problem, talk)
        };
        self.failed.try_iter().map(say).reduce(|first, _| first)
    }

    /// What came of each planned swap.
    pub(crate) fn reports(&self, swaps: &[SwapSummary]) -> Vec<SwapReport> {
        let offered = self.offered.list();
        let report = |(idx, (scene, at)): (usize, &(PathBuf, Duration))| {
            let number = offered.iter().position(|(_, planned)| *planned == Some(idx)).map(|n| n + 1);
            let swap = number.and_then(|number| swaps.iter().find(|swap| swap.scene_idx as usize == number));
            SwapReport {
                scene: scene.clone(),
                wanted_s: at.as_secs_f64(),
                tick: swap.map(|swap| swap.tick),
                at_s: swap.map(|swap| swap.at_s),
            }
        };
        self.planned.iter().enumerate().map(report).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::telemetry::Taps;

    #[test]
    fn a_scene_is_recorded_as_it_was_before_it_was_baked() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("scene.toml");
        let shape = "shape = { box_mm = [20.0, 20.0, 20.0] }\nvoxel_size_mm = 2.0\n";
        let text = format!("version = 1\n[[static]]\nname = \"base\"\n{shape}[tool]\n{shape}[device]\nprofile = \"sim-sigma7\"\n");
        std::fs::write(&path, &text).expect("written");
        let config = config::load(&path).unwrap_or_else(|errors| panic!("{errors}"));
        let recorder = Recorder::new(Taps::default(), true);
        let recorded = Some((recorder.clone(), LoadOptions::default()));
        let offered = OfferedScenes { recorded, ..OfferedScenes::default() };
        let note = offered.look(&config, None);
        std::fs::write(&path, "version = 2\n").expect("written");
        assert!(recorder.scenes.get(0).is_none() && offered.list().is_empty());
        note();
        assert_eq!(recorder.scenes.get(0).expect("noted").toml, text);
        assert_eq!(*offered.list(), [(path, None)]);
    }
}
