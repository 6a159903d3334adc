//! The scene is read again while it is rendered: when SIGHUP asks for it, and where wished when one of its files changes.
//!
//! ```text
//!  SIGHUP ─┐                    ┌─ wrong, or for another arm ─► refused; the old scene stays
//!  file  ──┴► read and check ───┼─ only parameters differ ────► set together, each along its ramp
//!  changed                      └─ anything else ─────────────► baked meanwhile, then switched at zero force
//! ```
//! Data in: the board, for what is rendered now. Data out: requests to the desk, and [`News`]. Invariant: never touches the loop itself.

use core::time::Duration;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::{Instant, SystemTime};

use crossbeam::channel::{Receiver, TryRecvError, bounded};

use super::desk::{Ask, Board, Counter, Refusal, Request, Setting, View, unlike_at_the_arm};
use crate::config::scene::MeshSource;
use crate::config::{self, LoadOptions, SceneConfig};
use crate::haptics::Knob;
use crate::mesh;
use crate::rt::signals::{Hangup, Hangups};
use crate::servo::Lowered;

/// How often signals are looked for.
const LISTEN: Duration = Duration::from_millis(100);
/// How often files are.
const LOOK: Duration = Duration::from_secs(1);
/// A file that is being written is left alone until it has stayed the same for so long.
const SETTLE: Duration = Duration::from_millis(300);

/// Reads scenes again.
pub struct Reloader {
    /// How scenes are read.
    pub options: LoadOptions,
    /// Takes what is to change.
    pub counter: Counter,
    /// Shows what is rendered.
    pub board: Board,
    /// Says when it is asked for.
    pub hangups: Hangups,
    /// Look at the files as well.
    pub watches: bool,
    /// The files as they were before they were baked.
    pub known: Known,
    /// Limits that clients lowered: no file raises them.
    pub lowered: Lowered,
    /// Hears what comes of it, on the thread of the reloader.
    pub tell: Box<dyn Fn(&News) + Send>,
}

/// What a reload has to say.
#[derive(Debug)]
pub enum News {
    /// The scene is read again, and why.
    Begun(Cause),
    /// What came of it.
    Done(Reloaded),
    /// Nothing came of it: the old scene stays.
    Refused(Refusal),
    /// SIGHUP, and the terminal has gone: the run ends with a ramp.
    TerminalGone,
}

/// Why a scene is read again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cause {
    /// A signal.
    Signal,
    /// A file.
    File,
}

/// What came of a reload.
#[derive(Clone, Debug, PartialEq)]
pub enum Reloaded {
    /// What is rendered is what the file says.
    Unchanged,
    /// Parameters go to new values.
    Tuned(Vec<Tuned>),
    /// The scene was baked, and takes the place of the old one at zero force.
    Baked(PathBuf),
}

/// One parameter that goes to a new value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tuned {
    /// Name with its unit.
    pub name: &'static str,
    /// Where it was, or was going.
    pub from: f64,
    /// Where it goes.
    pub to: f64,
}

impl Reloader {
    /// Begins to listen, in a thread of its own that ends with the process.
    ///
    /// # Errors
    /// The thread could not be started.
    pub fn spawn(self) -> std::io::Result<()> {
        std::thread::Builder::new().name("reload".to_owned()).spawn(move || self.run())?;
        Ok(())
    }

    fn run(mut self) {
        let mut next_look = Instant::now();
        let mut pending = None;
        let mut baking: Option<Baking> = None;
        // Nothing here waits for a bake: a terminal that goes away is heard at once.
        loop {
            std::thread::sleep(LISTEN);
            match self.hangups.take() {
                Some(Hangup::TerminalGone) => {
                    // The signal has ended the run itself.
                    (self.tell)(&News::TerminalGone);
                    return;
                }
                Some(Hangup::Reload) => pending = Some(Cause::Signal),
                None if Instant::now() >= next_look => {
                    next_look = Instant::now() + LOOK;
                    self.follow();
                    if self.watches && self.has_changed() {
                        pending = Some(Cause::File);
                    }
                }
                None => {}
            }
            if let Some(result) = baking.as_ref().and_then(Baking::result)
                && let Some(Baking { meshes, path, .. }) = baking.take()
            {
                if result.is_ok() {
                    self.known.meshes = meshes;
                }
                (self.tell)(&result.map_or_else(News::Refused, |()| News::Done(Reloaded::Baked(path))));
            }
            // One scene at a time: what is asked for meanwhile is done afterwards.
            let is_free = baking.is_none() && self.board.view().switching_to.is_none();
            if let Some(cause) = pending.take_if(|_| is_free) {
                (self.tell)(&News::Begun(cause));
                match self.reload() {
                    Ok(Step::Done(reloaded)) => (self.tell)(&News::Done(reloaded)),
                    Ok(Step::Bakes(bakes)) => baking = Some(bakes),
                    Err(refusal) => (self.tell)(&News::Refused(refusal)),
                }
            }
        }
    }

    /// Goes over to another scene as soon as it is rendered: from then on its files may change.
    fn follow(&mut self) {
        let view = self.board.view();
        if view.scene_idx != self.known.scene_idx {
            self.known.go_over(&view);
        }
    }

    /// Whether a file is another one than at the last look, and stays as it is.
    fn has_changed(&mut self) -> bool {
        let view = self.board.view();
        let files = self.known.companions.files(&view.config);
        if files == self.known.files {
            return false;
        }
        std::thread::sleep(SETTLE);
        // One that is still being written is for the next look.
        let has_settled = self.known.companions.files(&view.config) == files;
        if has_settled {
            self.known.files = files;
        }
        has_settled
    }

    fn reload(&mut self) -> Result<Step, Refusal> {
        let view = self.board.view();
        let config = config::load_with(&view.config.path, &self.options).map_err(Refusal::Config)?;
        if let Some((key, its, ours)) = unlike_at_the_arm(&config, &view.config).or_else(|| fixed(&config, &view.config)) {
            return Err(Refusal::Unlike { key, its, ours });
        }
        let meshes = self.known.companions.meshes(&config);
        match tunes(&config, &view, &self.lowered) {
            Some(tunes) if meshes == self.known.meshes => {
                let values = values(&config, &view);
                let set = self.ask(Ask::SetAll { scene_idx: view.scene_idx, values });
                set.recv().unwrap_or(Err(Refusal::Over))?;
                Ok(Step::Done(if tunes.is_empty() { Reloaded::Unchanged } else { Reloaded::Tuned(tunes) }))
            }
            // What the hands of a person made of it would be lost.
            _ if view.config.sculpt.is_some() => {
                Err(Refusal::Clay { taken: view.settings.iter().map(|setting| setting.name).collect() })
            }
            _ => Ok(Step::Bakes(Baking { answer: self.ask(Ask::Reload), meshes, path: config.path })),
        }
    }

    /// Asks the desk; its answer comes.
    fn ask(&self, ask: Ask) -> Receiver<Result<(), Refusal>> {
        let (sender, answer) = bounded(1);
        // Whoever has gone does not want to know.
        self.counter.ask(Request { ask, answer: Box::new(move |result| drop(sender.send(result))) });
        answer
    }
}

/// How far a reload came.
enum Step {
    Done(Reloaded),
    Bakes(Baking),
}

/// A scene that is being baked.
struct Baking {
    answer: Receiver<Result<(), Refusal>>,
    meshes: Files,
    path: PathBuf,
}

impl Baking {
    /// What became of it; `None`: not known yet.
    fn result(&self) -> Option<Result<(), Refusal>> {
        match self.answer.try_recv() {
            Ok(result) => Some(result),
            Err(TryRecvError::Empty) => None,
            Err(TryRecvError::Disconnected) => Some(Err(Refusal::Over)),
        }
    }
}

/// The files of a scene, as they were when they were last looked at.
#[derive(Clone, Debug)]
pub struct Known {
    scene_idx: u32,
    files: Files,
    /// Those that were baked.
    meshes: Files,
    companions: Companions,
}

impl Known {
    /// Of the first scene of a run.
    pub fn of(config: &SceneConfig) -> Self {
        let mut companions = Companions::default();
        Self { scene_idx: 0, files: companions.files(config), meshes: companions.meshes(config), companions }
    }

    /// Another scene is rendered. What is known of files that both have stays: they may have changed meanwhile.
    fn go_over(&mut self, view: &View) {
        self.scene_idx = view.scene_idx;
        self.files = self.companions.files(&view.config).knowing(&self.files);
        self.meshes = self.companions.meshes(&view.config).knowing(&self.meshes);
    }
}

/// When a file was written, and how long it is; `None`: it is not there.
type Stamp = Option<(SystemTime, u64)>;

/// Files and when each was written.
#[derive(Clone, Debug, PartialEq)]
struct Files(BTreeMap<PathBuf, Stamp>);

impl Files {
    /// The same files, as an earlier look knew them.
    fn knowing(mut self, earlier: &Self) -> Self {
        for (path, stamp) in &mut self.0 {
            if let Some(known) = earlier.0.get(path) {
                *stamp = *known;
            }
        }
        self
    }
}

/// The files that meshes take their contents from, kept until a mesh is written anew: to find them a whole file has to be read.
#[derive(Clone, Debug, Default)]
struct Companions(BTreeMap<PathBuf, (Stamp, Vec<PathBuf>)>);

impl Companions {
    /// Of a scene as they are now: its own file and those of its meshes.
    fn files(&mut self, config: &SceneConfig) -> Files {
        let Files(mut files) = self.meshes(config);
        files.insert(config.path.clone(), stamp(&config.path));
        Files(files)
    }

    /// Those of its meshes only.
    fn meshes(&mut self, config: &SceneConfig) -> Files {
        let sources = config.statics.iter().map(|object| &object.source).chain([&config.tool.source]);
        let mut files = BTreeMap::new();
        for source in sources {
            let MeshSource::File { path, .. } = source else { continue };
            let now = stamp(path);
            files.extend(self.of(path, now).iter().map(|beside| (beside.clone(), stamp(beside))));
            files.insert(path.clone(), now);
        }
        Files(files)
    }

    fn of(&mut self, path: &Path, now: Stamp) -> &[PathBuf] {
        let (known, companions) = self.0.entry(path.to_owned()).or_default();
        if *known != now {
            // A file that cannot be read now names no others.
            (*known, *companions) = (now, mesh::companions(path).unwrap_or_default());
        }
        companions
    }
}

fn stamp(path: &Path) -> Stamp {
    let meta = std::fs::metadata(path).ok()?;
    Some((meta.modified().ok()?, meta.len()))
}

/// What the scene says of everything that can be set.
fn values(config: &SceneConfig, view: &View) -> Vec<(&'static str, f64)> {
    let value = |setting: &Setting| {
        let knob = Knob::ALL.into_iter().find(|knob| knob.name() == setting.name)?;
        Some((setting.name, knob.read(&config.parameters)))
    };
    view.settings.iter().filter_map(value).collect()
}

/// What has to be set so that what is rendered is what the scene says, and no limit is raised that a person lowered; `None` where that takes more
/// than setting.
fn tunes(config: &SceneConfig, view: &View, lowered: &Lowered) -> Option<Vec<Tuned>> {
    let mut same = config.clone();
    let mut tunes = Vec::new();
    for Setting { name, range, value } in &view.settings {
        let knob = Knob::ALL.into_iter().find(|knob| knob.name() == *name)?;
        let to = knob.read(&config.parameters);
        if !(to >= range.least && to <= range.most) {
            return None;
        }
        let to = lowered.bound(knob, to).max(range.least);
        knob.copy(&view.config.parameters, &mut same.parameters);
        if to != *value {
            tunes.push(Tuned { name, from: *value, to });
        }
    }
    (same == *view.config).then_some(tunes)
}

/// A key, and its value in a scene for people.
type Shown = (&'static str, fn(&SceneConfig) -> String);

/// What a run takes from its first scene and keeps.
const FIXED: [Shown; 16] = [
    ("device.selector", |scene| scene.device.selector.as_ref().map_or("none".to_owned(), |selector| format!("{selector:?}"))),
    ("device.hand", |scene| scene.device.hand.as_ref().map_or("none".to_owned(), |path| format!("\"{}\"", path.display()))),
    ("device.sim.hand_stiffness_n_per_m", |scene| scene.device.sim.hand_stiffness_n_per_m.to_string()),
    ("device.sim.hand_damping_n_s_per_m", |scene| scene.device.sim.hand_damping_n_s_per_m.to_string()),
    ("device.sim.hand_mass_g", |scene| (scene.device.sim.hand_mass_kg * 1e3).to_string()),
    ("device.sim.hand", |scene| if scene.device.sim.hand_present { "present" } else { "\"none\"" }.to_owned()),
    ("device.sim.hand_repeat", |scene| scene.device.sim.hand_repeats.to_string()),
    ("device.sim.delay_ticks", |scene| scene.device.sim.delay_ticks.map_or("the profile's".to_owned(), |ticks| ticks.to_string())),
    ("device.sim.fault", |scene| scene.device.sim.fault.as_ref().map_or("none".to_owned(), |fault| format!("\"{fault}\""))),
    ("device.sim.seed", |scene| scene.device.sim.seed.to_string()),
    ("realtime.mode", |scene| if scene.realtime.enforce { "\"enforce\"" } else { "\"best-effort\"" }.to_owned()),
    ("realtime.cpu", |scene| scene.realtime.cpu.map_or("the last one".to_owned(), |cpu| cpu.to_string())),
    ("realtime.priority", |scene| scene.realtime.priority.to_string()),
    ("monitor.listen", |scene| scene.monitor.listen.map_or("\"off\"".to_owned(), |address| format!("\"{address}\""))),
    ("monitor.token_file", |scene| {
        scene.monitor.token_file.as_ref().map_or("none".to_owned(), |path| format!("\"{}\"", path.display()))
    }),
    ("monitor.origins", |scene| format!("{:?}", scene.monitor.origins)),
];

/// The key in which a scene differs although it counts at the start of a run only, and both values.
fn fixed(config: &SceneConfig, rendered: &SceneConfig) -> Option<(&'static str, String, String)> {
    FIXED.into_iter().map(|(key, show)| (key, show(config), show(rendered))).find(|(_, its, ours)| its != ours)
}

#[cfg(test)]
mod tests;
