//! The desk: what clients ask of a run while it goes on, answered in turn by one thread.
//!
//! ```text
//!  monitor ─┬─Request──► desk ─┬─knob, pose──► loop (through the reins of the scene that is rendered)
//!  reload  ─┘                  └─scene──► switch ──baked──► loop
//! ```
//! Orders that let force flow or end the run do not wait here: they go to the supervisor straight. Nobody sends a force.

use core::time::Duration;
use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::sync::{Arc, PoisonError, RwLock, RwLockReadGuard};

use crossbeam::channel::{Receiver, Sender, unbounded};

use super::switch::{Done, Offered, Switch};
use crate::config::{self, ConfigErrors, LoadOptions, SceneConfig};
use crate::haptics::{KnobRange, RenderScene};
use crate::scene::SceneError;
use crate::servo::{Lowered, PlaceError, Reins, TuneError};
use crate::spatial::Pose;

/// What a client asks for.
#[derive(Clone, Debug, PartialEq)]
pub enum Ask {
    /// A parameter, by its name (`haptics::Knob::name`), SI.
    Set {
        /// Which.
        parameter: String,
        /// To what.
        value: f64,
    },
    /// Parameters of one scene to what its file says now, or none of them; a limit that a person lowered stays lowered.
    SetAll {
        /// Number of the scene.
        scene_idx: u32,
        /// By name, SI.
        values: Vec<(&'static str, f64)>,
    },
    /// A movable object to a pose.
    Place {
        /// Its name.
        object: String,
        /// `world_from_object`.
        world_from_object: Pose,
    },
    /// Another scene of the folder of the one that the run began with.
    Switch {
        /// File name without its ending.
        scene: String,
    },
    /// The scene that is rendered, as its file is now.
    Reload,
}

/// Why something was not done.
#[derive(Debug, thiserror::Error)]
pub enum Refusal {
    /// A parameter.
    #[error("{0}")]
    Tune(#[from] TuneError),
    /// A pose.
    #[error("{0}")]
    Place(#[from] PlaceError),
    /// No such scene.
    #[error("no scene is called `{name}`; known here: {}", known.join(", "))]
    UnknownScene {
        /// As asked for.
        name: String,
        /// What is there.
        known: Vec<String>,
    },
    /// The scene file is wrong.
    #[error("{0}")]
    Config(ConfigErrors),
    /// The scene differs in a key that counts from the start of a run on.
    #[error("{key} = {its}, but the scene that is rendered has {ours}")]
    Unlike {
        /// The key.
        key: &'static str,
        /// What the scene has.
        its: String,
        /// What is rendered.
        ours: String,
    },
    /// Something else than parameters of a scene with clay has changed.
    #[error("the clay is worked until the run ends: of its scene only parameters are taken meanwhile ({}), and more than those has changed", .taken.join(", "))]
    Clay {
        /// The parameters.
        taken: Vec<&'static str>,
    },
    /// The scene cannot be baked.
    #[error("{0}")]
    Scene(#[from] SceneError),
    /// One thing at a time.
    #[error("a scene is on its way already")]
    Busy,
    /// The run has ended, or has no part that could do it.
    #[error("the run cannot do this any more")]
    Over,
}

/// Hears what became of a request, on the desk's or the baker's thread.
pub type Answer = Box<dyn FnOnce(Result<(), Refusal>) + Send>;

/// One request.
pub struct Request {
    /// What.
    pub ask: Ask,
    /// To whom.
    pub answer: Answer,
}

/// One parameter as it stands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Setting {
    /// Name with its unit.
    pub name: &'static str,
    /// How far it goes.
    pub range: KnobRange,
    /// Where it is or goes to.
    pub value: f64,
}

/// What is rendered, and what can be changed in it.
#[derive(Clone, Debug)]
pub struct View {
    /// Number of the scene, as records have it.
    pub scene_idx: u32,
    /// As checked.
    pub config: Arc<SceneConfig>,
    /// As rendered; `None` while the first one is baked.
    pub scene: Option<Arc<RenderScene>>,
    /// Parameters.
    pub settings: Vec<Setting>,
    /// Movable objects.
    pub movable: Vec<String>,
    /// A scene that is on its way.
    pub switching_to: Option<PathBuf>,
}

/// The newest [`View`], for any thread.
#[derive(Clone, Debug)]
pub struct Board(Arc<RwLock<View>>);

impl Board {
    /// While the first scene is baked.
    pub fn new(config: SceneConfig) -> Self {
        Self(Arc::new(RwLock::new(View {
            scene_idx: 0,
            config: Arc::new(config),
            scene: None,
            settings: Vec::new(),
            movable: Vec::new(),
            switching_to: None,
        })))
    }

    /// The view as it is.
    pub fn view(&self) -> View {
        self.read().clone()
    }

    fn read(&self) -> RwLockReadGuard<'_, View> {
        // Views are replaced whole: a writer that panicked left one that holds together.
        self.0.read().unwrap_or_else(PoisonError::into_inner)
    }

    fn change(&self, change: impl FnOnce(&mut View)) {
        change(&mut self.0.write().unwrap_or_else(PoisonError::into_inner));
    }

    fn show(&self, scene_idx: u32, config: SceneConfig, scene: Arc<RenderScene>, reins: &Reins) {
        self.change(|view| {
            *view = View {
                scene_idx,
                config: Arc::new(config),
                scene: Some(scene),
                settings: settings(reins),
                movable: reins.placer.movable().map(str::to_owned).collect(),
                switching_to: view.switching_to.take(),
            };
        });
    }
}

fn settings(reins: &Reins) -> Vec<Setting> {
    reins.tuner.knobs().iter().map(|(knob, range, value)| Setting { name: knob.name(), range: *range, value: *value }).collect()
}

/// What reaches the desk.
enum Message {
    Request(Request),
    /// A scene that the loop will take, planned or asked for; and whether it was asked for here.
    Offered(Box<Offered>, bool),
    /// A scene that was asked for and will not come.
    NotOffered,
    /// The first record of this scene.
    Rendered(u32),
}

/// Sends requests to the desk. Clones are cheap.
#[derive(Clone)]
pub struct Counter(Sender<Message>);

impl Counter {
    /// Puts a request on the desk; when the desk has gone, the answer is [`Refusal::Over`].
    pub fn ask(&self, request: Request) {
        if let Err(failed) = self.0.send(Message::Request(request))
            && let Message::Request(Request { answer, .. }) = failed.into_inner()
        {
            answer(Err(Refusal::Over));
        }
    }

    /// Tells that a scene was offered to the loop by somebody else.
    pub fn offered(&self, offered: Offered) {
        let _ = self.0.send(Message::Offered(Box::new(offered), false));
    }

    /// Tells that the loop renders this scene from now on.
    pub fn rendered(&self, scene_idx: u32) {
        let _ = self.0.send(Message::Rendered(scene_idx));
    }
}

/// What the desk works with.
pub struct Tools {
    /// What it shows.
    pub board: Board,
    /// Bakes and hands over; `None`: no other scenes.
    pub switches: Option<Sender<Switch>>,
    /// How scenes are read.
    pub options: LoadOptions,
    /// Where limits are kept that clients lowered.
    pub lowered: Lowered,
    /// Looks at every scene that was asked for, as its files are before it is baked.
    pub look: Arc<dyn Fn(&SceneConfig) -> Noted + Send + Sync>,
}

/// Takes note that the loop will take a scene.
pub type Noted = Box<dyn FnOnce() + Send>;

/// The desk before its thread.
pub struct Desk {
    tools: Tools,
    messages: Receiver<Message>,
    counter: Counter,
    reins: Option<Reins>,
    /// Scenes that were offered and are not shown yet, in order.
    coming: VecDeque<(Offered, bool)>,
    /// The newest scene that the loop renders, and the one that the board shows: either may be told first.
    rendered_idx: u32,
    shown_idx: u32,
}

impl Desk {
    /// A desk and its counter. Until [`Desk::serve`] requests wait.
    pub fn new(tools: Tools) -> (Self, Counter) {
        let (sender, messages) = unbounded();
        let counter = Counter(sender);
        let desk =
            Self { tools, messages, counter: counter.clone(), reins: None, coming: VecDeque::new(), rendered_idx: 0, shown_idx: 0 };
        (desk, counter)
    }

    /// Shows the first scene and begins to answer, in a thread of its own that ends with the process.
    ///
    /// # Errors
    /// The thread could not be started.
    pub fn serve(mut self, config: SceneConfig, scene: Arc<RenderScene>, reins: Reins) -> std::io::Result<()> {
        self.tools.board.show(0, config, scene, &reins);
        self.reins = Some(reins);
        std::thread::Builder::new().name("desk".to_owned()).spawn(move || self.run())?;
        Ok(())
    }

    fn run(mut self) {
        // Never ends by itself: the desk has a counter of its own. It ends with the process, like everything that waits for clients.
        while let Ok(message) = self.messages.recv() {
            match message {
                Message::Request(Request { ask, answer }) => self.answer(ask, answer),
                Message::Offered(offered, was_asked_for) => self.coming.push_back((*offered, was_asked_for)),
                Message::NotOffered => self.tools.board.change(|view| view.switching_to = None),
                Message::Rendered(scene_idx) => self.rendered_idx = self.rendered_idx.max(scene_idx),
            }
            self.show();
        }
    }

    /// Goes over to what is rendered, as far as it is known here.
    fn show(&mut self) {
        while self.shown_idx < self.rendered_idx
            && let Some((Offered { config, scene, mut reins }, was_asked_for)) = self.coming.pop_front()
        {
            self.shown_idx += 1;
            reins.tuner.show_lowered(&self.tools.lowered);
            self.tools.board.show(self.shown_idx, config, scene, &reins);
            if was_asked_for {
                self.tools.board.change(|view| view.switching_to = None);
            }
            self.reins = Some(reins);
        }
    }

    fn answer(&mut self, ask: Ask, answer: Answer) {
        match ask {
            Ask::Set { parameter, value } => answer(self.set(&parameter, value)),
            Ask::SetAll { scene_idx, .. } if scene_idx != self.shown_idx => answer(Err(TuneError::Over.into())),
            Ask::SetAll { values, .. } => answer(self.set_as_file(&values)),
            Ask::Place { object, world_from_object } => {
                let Some(reins) = &mut self.reins else { return answer(Err(Refusal::Over)) };
                answer(reins.placer.place(&object, world_from_object).map_err(Refusal::from));
            }
            Ask::Switch { scene } => self.switch(Some(&scene), answer),
            Ask::Reload => self.switch(None, answer),
        }
    }

    /// Turns a knob for a client.
    fn set(&mut self, name: &str, value: f64) -> Result<(), Refusal> {
        let reins = self.reins.as_mut().ok_or(Refusal::Over)?;
        let scene = reins.tuner.knobs().iter().find(|(knob, ..)| knob.name() == name).map(|(knob, range, _)| (*knob, range.scene));
        let set = reins.tuner.set(name, value);
        match (scene, &set) {
            (Some((knob, scene)), Ok(())) => self.tools.lowered.keep(knob, value, scene),
            // Another scene is rendered already, and is not known here yet: it is lowered all the same.
            (Some((knob, scene)), Err(TuneError::Over)) if value < self.tools.lowered.bound(knob, scene) => {
                self.tools.lowered.keep(knob, value, scene);
            }
            _ => {}
        }
        set?;
        self.show_settings();
        Ok(())
    }

    /// Turns knobs to what the scene's file says now.
    fn set_as_file(&mut self, values: &[(&'static str, f64)]) -> Result<(), Refusal> {
        let reins = self.reins.as_mut().ok_or(Refusal::Over)?;
        let turned = |(name, value): &(&'static str, f64)| {
            let Some((knob, range, target)) = reins.tuner.knobs().iter().find(|(knob, ..)| knob.name() == *name) else {
                return Some((*name, *value));
            };
            let value = match self.tools.lowered.bound(*knob, *value) {
                bounded if bounded < *value => bounded.max(range.least),
                _ => *value,
            };
            // Bits: what is the same stays the same.
            (value.to_bits() != target.to_bits()).then_some((*name, value))
        };
        let turned: Vec<_> = values.iter().filter_map(turned).collect();
        reins.tuner.set_all(turned)?;
        reins.tuner.adopt(values.iter().copied());
        self.show_settings();
        Ok(())
    }

    fn show_settings(&self) {
        if let Some(reins) = &self.reins {
            let settings = settings(reins);
            self.tools.board.change(|view| view.settings = settings);
        }
    }

    /// Reads a scene, or the one that is rendered again, and lets it be baked; the answer comes when it is offered.
    fn switch(&mut self, name: Option<&str>, answer: Answer) {
        let view = self.tools.board.view();
        let (Some(switches), None) = (&self.tools.switches, &view.switching_to) else {
            return answer(Err(if view.switching_to.is_some() { Refusal::Busy } else { Refusal::Over }));
        };
        let config = match self.read(name, &view.config) {
            Ok(config) => config,
            Err(refusal) => return answer(Err(refusal)),
        };
        let path = config.path.clone();
        self.tools.board.change(|view| view.switching_to = Some(path));
        let (counter, note) = (self.counter.clone(), (self.tools.look)(&config));
        let done = Done::new(move |result| {
            let said = match result {
                Some(Ok(offered)) => {
                    note();
                    let _ = counter.0.send(Message::Offered(Box::new(offered), true));
                    Ok(())
                }
                Some(Err(problem)) => Err(Refusal::Scene(problem)),
                None => Err(Refusal::Over),
            };
            if said.is_err() {
                let _ = counter.0.send(Message::NotOffered);
            }
            answer(said);
        });
        // What nobody takes any more is dropped, which answers it.
        let _ = switches.send(Switch { config, at_tick: 0, is_promised: false, done });
    }

    fn read(&self, name: Option<&str>, rendered: &SceneConfig) -> Result<SceneConfig, Refusal> {
        let path = match name {
            Some(name) => path_of(name, rendered)?,
            None => rendered.path.clone(),
        };
        let config = config::load_with(&path, &self.tools.options).map_err(Refusal::Config)?;
        match unlike(&config, rendered) {
            Some((key, its, ours)) => Err(Refusal::Unlike { key, its, ours }),
            None => Ok(config),
        }
    }
}

fn path_of(name: &str, rendered: &SceneConfig) -> Result<PathBuf, Refusal> {
    let known = scenes_beside(&rendered.path);
    match known.iter().find(|(known, _)| known == name) {
        Some((_, path)) => Ok(path.clone()),
        None => {
            let known = known.into_iter().map(|(name, _)| name).collect();
            Err(Refusal::UnknownScene { name: name.to_owned(), known })
        }
    }
}

/// Scene files in the same folder: names without their ending, and paths, sorted.
pub fn scenes_beside(path: &Path) -> Vec<(String, PathBuf)> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let entries = std::fs::read_dir(folder).into_iter().flatten().filter_map(Result::ok).map(|entry| entry.path());
    let is_scene = |path: &PathBuf| path.extension().is_some_and(|ending| ending == "toml") && path.is_file();
    let named = |path: PathBuf| Some((path.file_stem()?.to_str()?.to_owned(), path));
    let mut scenes: Vec<_> = entries.filter(is_scene).filter_map(named).collect();
    scenes.sort();
    scenes
}

/// The key in which a scene differs from the one that it is to replace, and both values.
pub fn unlike(scene: &SceneConfig, rendered: &SceneConfig) -> Option<(&'static str, String, String)> {
    // What the hands of a person made of clay would be lost.
    match (&scene.sculpt, &rendered.sculpt) {
        (None, None) => {}
        (its, Some(_)) => {
            let its = if its.is_some() { "clay" } else { "none" };
            return Some(("sculpt", its.to_owned(), "clay, which is worked until the run ends".to_owned()));
        }
        (Some(_), None) => return Some(("sculpt", "clay".to_owned(), "none".to_owned())),
    }
    unlike_at_the_arm(scene, rendered)
}

/// The same of what the arm and whoever enables it count on.
pub(super) fn unlike_at_the_arm(scene: &SceneConfig, rendered: &SceneConfig) -> Option<(&'static str, String, String)> {
    if scene.rate_hz != rendered.rate_hz {
        return Some(("rendering.rate_hz", scene.rate_hz.to_string(), rendered.rate_hz.to_string()));
    }
    let [its, ours] = [scene, rendered].map(|scene| &scene.device.profile);
    if its != ours {
        return Some(("device.profile", format!("\"{}\"", its.name), format!("\"{}\"", ours.name)));
    }
    // Who lets force flow was settled when the run began: an arm that a deadman enabled is not to go on without one.
    let [its, ours] = [scene, rendered].map(|scene| scene.parameters.safety.deadman);
    if its != ours {
        let shown = |deadman: Option<u8>| deadman.map_or("\"off\"".to_owned(), |button| button.to_string());
        return Some(("safety.deadman", shown(its), shown(ours)));
    }
    let [its, ours] = [scene, rendered].map(|scene| scene.heartbeat);
    (its != ours).then(|| {
        let shown = |longest: Option<Duration>| longest.map_or("none".to_owned(), |longest| longest.as_millis().to_string());
        ("safety.heartbeat_ms", shown(its), shown(ours))
    })
}

#[cfg(test)]
mod tests;
