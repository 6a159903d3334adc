//! What changes while a run goes on: `--move` and `--swap`.

use std::fmt::{Display, Formatter};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use crossbeam::channel::{Receiver, Sender, never, unbounded};
use serde::Serialize;

use super::cache::CacheArgs;
use super::memory::MemoryArgs;
use super::progress::BakeProgress;
use super::{Talk, cache, report};
use crate::config::poses::PoseFileError;
use crate::config::{self, LoadOptions, SceneConfig};
use crate::daemon::Live;
use crate::device::hand::HandPath;
use crate::error::Exit;
use crate::haptics::RenderScene;
use crate::rt::clock::ClockKind;
use crate::rt::duration;
use crate::scene::cache::Residence;
use crate::scene::{self, BakeMeans, SceneError};
use crate::servo::{PlaceError, Refused, Stage, SwapSlot, Swapper, Wishes};
use crate::telemetry::SwapSummary;

/// Arguments that change a run while it goes on.
#[derive(Debug, clap::Args)]
pub(crate) struct LiveArgs {
    /// Let a movable object of SCENE follow timed poses in the world, a CSV file like that of a hand; may be repeated.
    #[arg(long = "move", value_name = "NAME=FILE", value_parser = parse_move)]
    moves: Vec<(String, PathBuf)>,
    /// Go over to another scene for the same arm at that time, such as b.toml@3s; baked while the first one renders; may be repeated. Hand,
    /// clock and real-time settings stay those of SCENE.
    #[arg(long = "swap", value_name = "SCENE@TIME", value_parser = parse_swap)]
    swaps: Vec<(PathBuf, Duration)>,
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
            (Some(at_s), Some(tick)) => write!(f, "{} from {at_s:.3} s on (tick {tick})", self.scene.display()),
            _ => write!(f, "{} did not come, wanted at {:.3} s", self.scene.display(), self.wanted_s),
        }
    }
}

/// The changes of a run, all read and checked.
pub(crate) struct Changes {
    wishes: Wishes,
    swaps: Vec<PlannedSwap>,
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
                report::error(&message, Some("a scene is swapped for one of the same arm and rate; write the same in both"), talk);
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
        Ok(Changes { wishes, swaps })
    }
}

/// The key in which a scene differs from the one that it is to replace, and both values.
fn unlike(scene: &SceneConfig, rendered: &SceneConfig) -> Option<(&'static str, String, String)> {
    if scene.rate_hz != rendered.rate_hz {
        return Some(("rendering.rate_hz", scene.rate_hz.to_string(), rendered.rate_hz.to_string()));
    }
    let [its, ours] = [scene, rendered].map(|scene| &scene.device.profile);
    (its != ours).then(|| ("device.profile", format!("\"{}\"", its.name), format!("\"{}\"", ours.name)))
}

fn objects(scene: &SceneConfig) -> Vec<(String, bool)> {
    scene.statics.iter().map(|object| (object.name.clone(), object.movable)).collect()
}

/// What went wrong with a scene while another was rendered.
pub(crate) struct Failed {
    path: PathBuf,
    problem: SceneError,
}

/// The changes while they take place.
pub(crate) struct UnderWay {
    /// At most one: the first failure is the last.
    failed: Receiver<Failed>,
    planned: Vec<(PathBuf, Duration)>,
}

impl Changes {
    /// Begins: the thread that bakes the other scenes runs until they are taken, or the loop is over.
    pub(crate) fn begin(
        self,
        cache: &CacheArgs,
        memory: &MemoryArgs,
        clock: ClockKind,
        talk: Talk,
    ) -> std::io::Result<(Live, UnderWay)> {
        let (failures, failed) = unbounded();
        let planned = self.swaps.iter().map(|swap| (swap.config.path.clone(), swap.at)).collect();
        let mut swaps = None;
        if !self.swaps.is_empty() {
            let (swapper, slot) = SwapSlot::new(self.swaps.iter().map(|swap| swap.at_tick).collect());
            swaps = Some(slot);
            let baker = Baker { cache: cache.clone(), memory: memory.clone(), clock, talk, swapper, failures };
            // Not joined: a bake that nobody waits for any more ends with the process.
            std::thread::Builder::new().name("swap".to_owned()).spawn(move || baker.bake_all(self.swaps))?;
        }
        Ok((Live { wishes: self.wishes, swaps, ..Live::default() }, UnderWay { failed, planned }))
    }
}

struct Baker {
    cache: CacheArgs,
    memory: MemoryArgs,
    clock: ClockKind,
    talk: Talk,
    swapper: Swapper,
    failures: Sender<Failed>,
}

impl Baker {
    /// Bakes scene by scene, hands each over, and frees what comes back.
    fn bake_all(mut self, swaps: Vec<PlannedSwap>) {
        for PlannedSwap { config, at_tick, .. } in swaps {
            let stage = match self.bake(&config) {
                Ok(scene) => Stage::new(Arc::new(scene)).with_time_budget(config.time_budget_s, self.clock).at_tick(at_tick),
                Err(problem) => {
                    // If the run is over, nobody wants to know. The slot goes with this thread, so that simulated time does not wait for it.
                    let _ = self.failures.send(Failed { path: config.path, problem });
                    return;
                }
            };
            let mut offered = self.swapper.offer(Box::new(stage));
            while let Err((Refused::Waiting, stage)) = offered {
                std::thread::sleep(POLL);
                drop(self.swapper.take_back());
                offered = self.swapper.offer(stage);
            }
        }
        while !self.swapper.is_over() {
            drop(self.swapper.take_back());
            std::thread::sleep(POLL);
        }
    }

    fn bake(&self, config: &SceneConfig) -> Result<RenderScene, SceneError> {
        let mut cache = self.cache.open(Residence::Owned, self.talk);
        // Quiet: the screen belongs to the run.
        let progress = BakeProgress::new(Talk { quiet: true, verbose: 0, ..self.talk });
        let mut means = BakeMeans { cache: &mut cache, memory: self.memory.plan(&progress, self.talk) };
        let built = scene::build_with(config, &mut means, |_| ());
        drop(means);
        cache::tell(&mut cache, self.talk);
        let (scene, reports) = built?;
        report::bake_warnings_of(&format!("{}: ", config.path.display()), &reports, self.talk);
        Ok(scene)
    }
}

/// How often the cold side looks for what came back.
const POLL: Duration = Duration::from_millis(2);

impl Default for UnderWay {
    /// Nothing changes.
    fn default() -> Self {
        Self { failed: never(), planned: Vec::new() }
    }
}

impl UnderWay {
    /// The scene of a number, for people.
    pub(crate) fn scene(&self, scene_idx: u32) -> &Path {
        let planned = (scene_idx as usize).checked_sub(1).and_then(|n| self.planned.get(n));
        planned.map_or(Path::new("the first scene"), |(path, _)| path)
    }

    /// Says what went wrong, if anything; its exit code.
    pub(crate) fn failure(&self, talk: Talk) -> Option<Exit> {
        let Failed { path, problem } = self.failed.try_recv().ok()?;
        report::error(&format!("{} was not rendered: it cannot be baked", path.display()), None, talk);
        Some(report::scene_error(&problem, talk))
    }

    /// What came of each swap.
    pub(crate) fn reports(&self, swaps: &[SwapSummary]) -> Vec<SwapReport> {
        let report = |((scene, at), scene_idx): (&(PathBuf, Duration), u32)| {
            let swap = swaps.iter().find(|swap| swap.scene_idx == scene_idx);
            SwapReport {
                scene: scene.clone(),
                wanted_s: at.as_secs_f64(),
                tick: swap.map(|swap| swap.tick),
                at_s: swap.map(|swap| swap.at_s),
            }
        };
        self.planned.iter().zip(1..).map(report).collect()
    }
}
