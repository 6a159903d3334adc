//! The session: what is rendered, and what changes it while the loop runs.
//!
//! ```text
//!  HTTP, WebSocket ─┐                   ┌─ parameter, pose, hand ────────────────┐
//!  SIGHUP, --watch ─┼─► SessionHandle ──┤                                        ├─ring─► loop
//!  --swap          ─┘   (one mutex)     └─ scene ──► thread `scenes`: bakes it ──┘
//! ```
//! A parameter and a pose are answered at once; a scene is answered when it is baked and sent. What
//! takes force away, or lets it flow, does not pass here. No caller waits for a file, for a bake or
//! for the loop: the mutex is held for some copies only.

use core::time::Duration;
use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

use super::prepare::hand_of;
use super::recorded::scene_files;
use super::scene_keys::{path_of, unlike};
use crate::config::{self, LoadOptions, SceneConfig};
use crate::scene::{ObjectReport, SceneError};
use engine::servo::{CommandQueue, FileChange, LoadedScene, Objects, SceneControls};
use haptics::RenderScene;
use recording::file::{Recorder, SceneFiles};
use rt::clock::ClockKind;
use vps::spatial::Pose;

pub use super::session_error::SessionError;
pub use engine::servo::{ControlError, HandOrder, HandUse, ParameterSetting};

/// How often the thread of scenes looks for a scene that the loop gave back, while one is to be
/// sent.
const POLL: Duration = Duration::from_millis(2);
/// The same while none is.
const IDLE: Duration = Duration::from_millis(10);

/// Bakes a scene in a way that the caller chooses, with its cache, its limits, its progress; gives
/// what [`build_with`](crate::scene::build_with) gives.
pub type Baker =
    Box<dyn FnMut(&SceneConfig) -> Result<(RenderScene, Vec<ObjectReport>), SceneError> + Send>;

/// Called again and again on the thread of scenes, between two bakes; whether no other scene is on
/// its way.
pub(super) type SceneWatcher = Box<dyn FnMut(&SessionHandle, bool, &mut Baker) + Send>;

/// Called once with what became of a scene: it is baked and sent to the loop, or why not. Called on
/// the thread of scenes; must not block.
pub type Reply = Box<dyn FnOnce(Result<(), SessionError>) + Send>;

/// What is rendered, and what can be changed in it.
#[derive(Clone, Debug)]
pub struct SceneView {
    /// Number of the scene, as records have it.
    pub scene_idx: u32,
    /// As checked.
    pub config: Arc<SceneConfig>,
    /// As rendered; `None` while the first one is baked.
    pub scene: Option<Arc<RenderScene>>,
    /// What was baked: the fixed objects in the order of the scene, then the tool; empty while the
    /// first scene is baked.
    pub reports: Arc<[ObjectReport]>,
    /// Parameters.
    pub settings: Vec<ParameterSetting>,
    /// Movable objects.
    pub movable: Vec<String>,
    /// The hand of a simulated arm, which clients can move.
    pub has_hand: bool,
    /// The scene that a client or a reload asked for, while it is on its way.
    pub switching_to: Option<PathBuf>,
}

/// A scene to go over to: one that is not [`unlike`] the first one.
#[derive(Debug)]
pub struct PlannedScene {
    /// The checked scene.
    pub config: SceneConfig,
    /// First tick in which it may be taken. A run under the virtual clock waits for it at that
    /// tick.
    pub at_tick: u64,
}

/// Names of the static objects in their order, and whether each may move.
pub fn objects(config: &SceneConfig) -> Objects {
    config.statics.iter().map(|object| (object.name.clone(), object.movable)).collect()
}

/// Everything that clients, files and the command line change while a scene is rendered. Clones are
/// cheap, and are the same session.
#[derive(Clone)]
pub struct SessionHandle(Arc<Shared>);

struct Shared {
    state: Mutex<SessionState>,
    /// A scene was asked for.
    asked: Condvar,
    /// The scene that the run begins with.
    first: Arc<SceneConfig>,
    options: LoadOptions,
    clock: ClockKind,
    /// Recordings bring along what each scene is made of.
    recorder: Option<Recorder>,
}

struct SessionState {
    config: Arc<SceneConfig>,
    scene: Option<Arc<RenderScene>>,
    reports: Arc<[ObjectReport]>,
    /// `None` while the first scene is baked.
    controls: Option<SceneControls>,
    /// A simulated arm: its hand can be moved.
    is_simulated: bool,
    /// A scene that was sent to the loop and is not rendered yet.
    coming: Option<BakedScene>,
    /// A client or a reload has asked for a scene that is not rendered yet ...
    is_switching: bool,
    /// ... and which.
    switching_to: Option<PathBuf>,
    jobs: VecDeque<Job>,
    /// Ticks at which planned scenes are wanted.
    promised_ticks: Vec<u64>,
    /// Scenes in the order in which the loop takes them, and which of the planned ones each is.
    sent: Vec<(Arc<SceneConfig>, Option<usize>)>,
    /// Planned scenes that could not be baked.
    failed: Vec<(PathBuf, SceneError)>,
    /// Scenes that were rendered before, for the thread of scenes to free.
    replaced: Vec<Box<LoadedScene>>,
    watcher: Option<SceneWatcher>,
    /// The thread of scenes takes no more jobs.
    has_ended: bool,
}

enum Job {
    Planned(Box<PlannedScene>, usize),
    Switch { name: String, reply: Reply },
    Reset { reply: Reply },
}

impl Job {
    /// It will not be done.
    fn refuse(self, refusal: SessionError) {
        if let Self::Switch { reply, .. } | Self::Reset { reply } = self {
            reply(Err(refusal));
        }
    }
}

/// A scene that can be rendered.
struct BakedScene {
    config: Arc<SceneConfig>,
    scene: Arc<RenderScene>,
    reports: Arc<[ObjectReport]>,
}

/// A scene on its way to the loop.
struct Coming {
    baked: BakedScene,
    /// What a recording brings along of it.
    files: Option<SceneFiles>,
    at_tick: u64,
    planned_idx: Option<usize>,
    starts_anew: bool,
}

impl SessionState {
    /// Goes over to what the loop renders.
    fn follow(&mut self) {
        while let Some(replaced) = self.controls.as_mut().and_then(SceneControls::take_replaced) {
            self.replaced.push(replaced);
            if let Some(BakedScene { config, scene, reports }) = self.coming.take() {
                self.config = config;
                self.scene = Some(scene);
                self.reports = reports;
            }
            if self.sent.last().is_some_and(|(_, planned)| planned.is_none()) {
                (self.is_switching, self.switching_to) = (false, None);
            }
        }
    }

    fn controls(&mut self) -> Result<&mut SceneControls, SessionError> {
        self.follow();
        self.controls.as_mut().ok_or(SessionError::Baking)
    }

    /// Why no client can move the hand.
    fn why_no_hand(&self) -> Option<&'static str> {
        match &self.config.device {
            _ if !self.is_simulated => Some("a person holds this one"),
            device if !device.sim.hand_present => {
                Some("`device.sim.hand` is \"none\" in this scene")
            }
            _ => None,
        }
    }

    fn is_over(&self) -> bool {
        self.controls.as_ref().is_some_and(SceneControls::is_over)
    }
}

impl SessionHandle {
    /// A session whose first scene is still to be baked. `options`: how scenes are read.
    pub fn new(
        config: SceneConfig,
        options: LoadOptions,
        clock: ClockKind,
        recorder: Option<Recorder>,
    ) -> Self {
        let first = Arc::new(config);
        let state = SessionState {
            config: first.clone(),
            scene: None,
            reports: Arc::default(),
            controls: None,
            is_simulated: false,
            coming: None,
            is_switching: false,
            switching_to: None,
            jobs: VecDeque::new(),
            promised_ticks: Vec::new(),
            sent: Vec::new(),
            failed: Vec::new(),
            replaced: Vec::new(),
            watcher: None,
            has_ended: true,
        };
        Self(Arc::new(Shared {
            state: Mutex::new(state),
            asked: Condvar::new(),
            first,
            options,
            clock,
            recorder,
        }))
    }

    /// Begins the thread `scenes`, which bakes scenes one after the other, first the planned ones,
    /// sends them to the loop, and frees those that were rendered before. It ends with the loop,
    /// and is not joined: a bake that is no longer wanted ends with the process. Without it no
    /// other scene is taken.
    ///
    /// # Errors
    /// The thread could not be started.
    pub fn begin_baking(
        &self,
        mut baker: Baker,
        planned: Vec<PlannedScene>,
    ) -> std::io::Result<()> {
        {
            let mut state = self.state();
            state.has_ended = false;
            state.promised_ticks = planned.iter().map(|scene| scene.at_tick).collect();
            state.jobs = planned
                .into_iter()
                .enumerate()
                .map(|(idx, scene)| Job::Planned(Box::new(scene), idx))
                .collect();
        }
        let session = self.clone();
        std::thread::Builder::new()
            .name("scenes".to_owned())
            .spawn(move || session.work(&mut baker))?;
        Ok(())
    }

    /// The first scene is baked: from now on it can be changed, and the hand of a simulated arm can
    /// be moved. Gives the loop's end.
    pub fn begin(
        &self,
        scene: &Arc<RenderScene>,
        reports: Vec<ObjectReport>,
        is_simulated: bool,
    ) -> CommandQueue {
        let mut state = self.state();
        state.is_simulated = is_simulated;
        let (controls, queue) = SceneControls::new(&scene.parameters, objects(&state.config));
        (state.controls, state.scene) = (Some(controls), Some(scene.clone()));
        state.reports = reports.into();
        queue.with_promised(core::mem::take(&mut state.promised_ticks).into())
    }

    /// What is rendered now.
    pub fn view(&self) -> SceneView {
        let mut state = self.state();
        state.follow();
        let controls = state.controls.as_ref();
        SceneView {
            scene_idx: controls.map_or(0, SceneControls::scene_idx),
            config: state.config.clone(),
            scene: state.scene.clone(),
            reports: state.reports.clone(),
            settings: controls.map_or(Vec::new(), |controls| controls.settings().to_vec()),
            movable: controls
                .map_or(Vec::new(), |controls| controls.movable().map(str::to_owned).collect()),
            has_hand: state.why_no_hand().is_none(),
            switching_to: state.switching_to.clone(),
        }
    }

    /// Sets a parameter, by its name (`haptics::LiveParameter::name`), SI. A limit that is lowered
    /// stays lowered in every scene until it is raised here.
    ///
    /// # Errors
    /// [`SessionError`]; nothing changes then.
    pub fn set(&self, parameter: &str, value: f64) -> Result<(), SessionError> {
        Ok(self.state().controls()?.set(parameter, value)?)
    }

    /// Asks a movable object to go to a pose, `world_from_object`.
    ///
    /// # Errors
    /// [`SessionError`]; nothing moves then.
    pub fn place(&self, object: &str, world_from_object: Pose) -> Result<(), SessionError> {
        Ok(self.state().controls()?.place(object, world_from_object)?)
    }

    /// Asks the hand of a simulated arm to go to a pose of the tool, or along the scene's path
    /// again; gives the number of this order.
    ///
    /// # Errors
    /// [`SessionError`]; nothing moves then, as where a person holds the arm.
    pub fn hand(&self, order: HandOrder) -> Result<u32, SessionError> {
        self.hand_in(None, order)
    }

    /// The same of a client that means one scene: a drag that began before a switch does not move
    /// the tool of the next scene.
    ///
    /// # Errors
    /// [`SessionError`]; nothing moves then.
    pub fn hand_in(&self, scene_idx: Option<u32>, order: HandOrder) -> Result<u32, SessionError> {
        let mut state = self.state();
        let missing = state.why_no_hand();
        let controls = state.controls()?;
        let rendered = controls.scene_idx();
        match (missing, scene_idx) {
            (Some(why), _) => Err(ControlError::NoHand(why).into()),
            (None, Some(asked)) if asked != rendered => {
                Err(ControlError::AnotherScene { asked, rendered }.into())
            }
            (None, _) => Ok(controls.hand(order)?),
        }
    }

    /// The newest order for the hand that a tick has used.
    pub fn hand_use(&self) -> Option<HandUse> {
        self.state().controls.as_ref()?.hand_use()
    }

    /// Asks for the scene as it was at its beginning: tool and objects where they began, parameters
    /// as in its file. Limits that a person lowered stay.
    pub fn reset(&self, reply: Reply) {
        self.ask(Job::Reset { reply });
    }

    /// Asks for another scene of the folder of the one that is rendered, by its file name without
    /// the ending.
    pub fn switch(&self, name: String, reply: Reply) {
        self.ask(Job::Switch { name, reply });
    }

    fn ask(&self, job: Job) {
        let mut state = self.state();
        state.follow();
        let refusal = if state.controls.is_none() {
            SessionError::Baking
        } else if state.has_ended || state.is_over() {
            SessionError::Over
        } else if state.is_switching {
            SessionError::Busy
        } else {
            state.is_switching = true;
            state.jobs.push_back(job);
            return self.0.asked.notify_all();
        };
        drop(state);
        job.refuse(refusal);
    }

    /// Begins to call `watcher`. Without [`Self::begin_baking`] it is never called.
    pub(super) fn watch_with(&self, watcher: SceneWatcher) {
        self.state().watcher = Some(watcher);
    }

    /// The file of a scene, by its number; `None`: there is no such scene, or it is the first one.
    pub fn sent_file(&self, scene_idx: u32) -> Option<PathBuf> {
        let sent_idx = (scene_idx as usize).checked_sub(1)?;
        self.state().sent.get(sent_idx).map(|(config, _)| config.path.clone())
    }

    /// A scene of this run by its number, as it was checked; `None`: there is no such scene.
    pub fn config_of(&self, scene_idx: u32) -> Option<Arc<SceneConfig>> {
        match (scene_idx as usize).checked_sub(1) {
            None => Some(self.0.first.clone()),
            Some(sent_idx) => self.state().sent.get(sent_idx).map(|(config, _)| config.clone()),
        }
    }

    /// The number of a scene that was planned; `None`: it was not sent.
    pub fn planned_scene_idx(&self, planned_idx: usize) -> Option<u32> {
        let sent_idx =
            self.state().sent.iter().position(|(_, planned)| *planned == Some(planned_idx))?;
        Some(sent_idx as u32 + 1)
    }

    /// Planned scenes that could not be baked, each reported once.
    pub fn take_failed(&self) -> Vec<(PathBuf, SceneError)> {
        core::mem::take(&mut self.state().failed)
    }

    /// How scenes are read.
    pub(super) fn options(&self) -> &LoadOptions {
        &self.0.options
    }

    /// Sets what a file says differently, where the scene of this number is still rendered and
    /// nothing but parameters differs; `None`: more does.
    pub(super) fn follow_file(
        &self,
        scene_idx: u32,
        file: &SceneConfig,
    ) -> Result<Option<Vec<FileChange>>, SessionError> {
        let mut state = self.state();
        state.follow();
        let SessionState { config, controls: Some(controls), .. } = &mut *state else {
            return Err(SessionError::Over);
        };
        if controls.scene_idx() != scene_idx {
            return Err(ControlError::Over.into());
        }
        let mut same = file.clone();
        for setting in controls.settings() {
            setting.parameter.copy(&config.parameters, &mut same.parameters);
        }
        let Some(changes) = controls.file_changes(&file.parameters).filter(|_| same == **config)
        else {
            return Ok(None);
        };
        controls.follow_file(&file.parameters, &changes)?;
        Ok(Some(changes))
    }

    /// Bakes a scene that a client or a reload asked for, and sends it to the loop. On the thread
    /// of scenes.
    pub(super) fn switch_to(
        &self,
        config: SceneConfig,
        baker: &mut Baker,
    ) -> Result<(), SessionError> {
        let mut state = self.state();
        (state.is_switching, state.switching_to) = (true, Some(config.path.clone()));
        drop(state);
        self.bake(PlannedScene { config, at_tick: 0 }, None, baker)
            .inspect_err(|_| self.stop_switching())
    }

    fn stop_switching(&self) {
        let mut state = self.state();
        (state.is_switching, state.switching_to) = (false, None);
    }

    fn work(&self, baker: &mut Baker) {
        loop {
            self.free_replaced();
            let mut state = self.state();
            if state.is_over() {
                state.has_ended = true;
                let left = core::mem::take(&mut state.jobs);
                drop(state);
                return left.into_iter().for_each(|job| job.refuse(SessionError::Over));
            }
            if let Some(job) = state.jobs.pop_front() {
                drop(state);
                self.carry_out(job, baker);
            } else if let Some(mut watcher) = state.watcher.take() {
                let is_free = !state.is_switching;
                drop(state);
                // A panic there ends reloading and nothing else.
                let turned = catch_unwind(AssertUnwindSafe(|| watcher(self, is_free, baker)));
                self.state().watcher = turned.is_ok().then_some(watcher);
                self.rest(IDLE);
            } else {
                drop(state);
                self.rest(IDLE);
            }
        }
    }

    /// Waits until a scene is asked for, or for a time.
    fn rest(&self, time: Duration) {
        let state = self.state();
        if state.jobs.is_empty() {
            drop(self.0.asked.wait_timeout(state, time));
        }
    }

    fn carry_out(&self, job: Job, baker: &mut Baker) {
        match job {
            Job::Planned(planned, idx) => {
                let path = planned.config.path.clone();
                let Err(SessionError::Scene(problem)) = self.bake(*planned, Some(idx), baker)
                else {
                    return;
                };
                self.state().failed.push((path, problem));
                if let Some(mut state) = self.with_room()
                    && let Ok(controls) = state.controls()
                {
                    // If the loop has ended it does not wait.
                    let _ = controls.skip();
                }
            }
            Job::Switch { name, reply } => {
                let switched = catch_unwind(AssertUnwindSafe(|| {
                    let view = self.view();
                    let config = config::load_with(&path_of(&name, &view.config)?, self.options())
                        .map_err(SessionError::Config)?;
                    match unlike(&config, &view.config) {
                        Some((key, its, ours)) => Err(SessionError::Unlike { key, its, ours }),
                        None => self.switch_to(config, baker),
                    }
                }));
                self.answer(switched.unwrap_or(Err(SessionError::Over)), reply);
            }
            Job::Reset { reply } => {
                let SceneView { scene_idx, config, scene, reports, .. } = self.view();
                let result = match (scene, &config.sculpt) {
                    (_, Some(_)) => Err(SessionError::ClayStays),
                    (None, None) => Err(SessionError::Over),
                    (Some(scene), None) => {
                        // What is rendered again is what was baked, whatever its files say by now.
                        let files = self
                            .0
                            .recorder
                            .as_ref()
                            .and_then(|recorder| recorder.scenes.get(scene_idx));
                        let files = files.map(|files| (*files).clone());
                        self.send(Coming {
                            baked: BakedScene { config, scene, reports },
                            files,
                            at_tick: 0,
                            planned_idx: None,
                            starts_anew: true,
                        })
                    }
                };
                self.answer(result, reply);
            }
        }
    }

    fn bake(
        &self,
        planned: PlannedScene,
        planned_idx: Option<usize>,
        baker: &mut Baker,
    ) -> Result<(), SessionError> {
        let PlannedScene { config, at_tick } = planned;
        // Before it is baked: what is written meanwhile is not what is rendered.
        let files = self.0.recorder.as_ref().map(|_| scene_files(&config, &self.0.options));
        let (scene, reports) = baker(&config)?;
        self.send(Coming {
            baked: BakedScene {
                config: Arc::new(config),
                scene: Arc::new(scene),
                reports: reports.into(),
            },
            files,
            at_tick,
            planned_idx,
            starts_anew: false,
        })
    }

    /// Sends a scene to the loop, which takes it from its tick on.
    fn send(&self, coming: Coming) -> Result<(), SessionError> {
        let Coming { baked, files, at_tick, planned_idx, starts_anew } = coming;
        let BakedScene { config, scene, .. } = &baked;
        let hand = hand_of(config, scene.tool.center_of_mass_tool)
            .map_err(|error| SessionError::Hand(error.to_string()))?;
        let loaded =
            LoadedScene::new(scene.clone()).with_time_budget(config.time_budget_s, self.0.clock);
        let loaded = loaded.at_tick(at_tick).with_hand(hand).starting_anew(starts_anew);
        let mut state = self.with_room().ok_or(SessionError::Over)?;
        // Before the loop can render it.
        if let (Some(recorder), Some(files)) = (&self.0.recorder, files) {
            recorder.scenes.add(SceneFiles { starts_anew, ..files });
        }
        state
            .controls()?
            .offer(Box::new(loaded), objects(config))
            .map_err(|_| SessionError::Over)?;
        state.sent.push((config.clone(), planned_idx));
        state.coming = Some(baked);
        Ok(())
    }

    fn answer(&self, result: Result<(), SessionError>, reply: Reply) {
        if result.is_err() {
            self.stop_switching();
        }
        reply(result);
    }

    /// Waits until a scene can be sent: the first one is rendered, and no other is on its way.
    /// `None`: the loop is over.
    fn with_room(&self) -> Option<MutexGuard<'_, SessionState>> {
        loop {
            self.free_replaced();
            let state = self.state();
            if state.is_over() {
                return None;
            }
            if state.controls.is_some() && state.coming.is_none() {
                return Some(state);
            }
            drop(state);
            std::thread::sleep(POLL);
        }
    }

    fn free_replaced(&self) {
        let mut state = self.state();
        state.follow();
        let replaced = core::mem::take(&mut state.replaced);
        drop(state);
        drop(replaced);
    }

    fn state(&self) -> MutexGuard<'_, SessionState> {
        // Nothing that is done under the lock can panic half-way.
        self.0.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests;
