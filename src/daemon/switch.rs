//! Scenes that are to take the place of the one that is rendered: baked while it renders, handed over, and the old one freed.

use core::time::Duration;
use std::sync::Arc;

use crossbeam::channel::{Receiver, RecvTimeoutError, Sender, unbounded};

use crate::config::SceneConfig;
use crate::haptics::RenderScene;
use crate::rt::clock::ClockKind;
use crate::scene::SceneError;
use crate::servo::{Lowered, Refused, Reins, Stage, Swapper, Wishes};

/// How often the cold side looks for what came back.
const POLL: Duration = Duration::from_millis(2);
/// The same while nothing is to be handed over.
const IDLE: Duration = Duration::from_millis(10);

/// Bakes a scene in whatever way the caller likes: with its cache, its limits, its progress.
pub type Baker = Box<dyn FnMut(&SceneConfig) -> Result<RenderScene, SceneError> + Send>;

type Hears = dyn FnOnce(Option<Result<Offered, SceneError>>) + Send;

/// Hears, once, what became of a scene: baked and offered, or why not. `None`: the run was over first, which is also what it hears when it is
/// dropped, on whatever way.
pub struct Done(Option<Box<Hears>>);

impl Done {
    /// What is to be done then, on the thread that bakes.
    pub fn new(hears: impl FnOnce(Option<Result<Offered, SceneError>>) + Send + 'static) -> Self {
        Self(Some(Box::new(hears)))
    }

    fn tell(mut self, became: Result<Offered, SceneError>) {
        if let Some(hears) = self.0.take() {
            hears(Some(became));
        }
    }
}

impl Drop for Done {
    fn drop(&mut self) {
        if let Some(hears) = self.0.take() {
            hears(None);
        }
    }
}

/// A scene to go over to: one that is not [`unlike`](super::desk::unlike) the one that is rendered.
pub struct Switch {
    /// The checked scene.
    pub config: SceneConfig,
    /// First tick in which it may be taken.
    pub at_tick: u64,
    /// A run under the virtual clock waits for it at that tick. When it cannot be baked, such a run gets no other scene either.
    pub is_promised: bool,
    /// Hears what became of it.
    pub done: Done,
}

/// A scene that the loop will take.
#[derive(Debug)]
pub struct Offered {
    /// As checked.
    pub config: SceneConfig,
    /// As rendered.
    pub scene: Arc<RenderScene>,
    /// What can be changed in it.
    pub reins: Reins,
}

/// Names of the static objects in their order, and whether each may move.
pub fn objects(config: &SceneConfig) -> Vec<(String, bool)> {
    config.statics.iter().map(|object| (object.name.clone(), object.movable)).collect()
}

/// Begins a thread that bakes scenes in the order in which they are sent, and ends with the loop, or when the sender has gone and every scene
/// has been taken. Not joined: a bake that is no longer wanted ends with the process. `lowered`: limits that every one of them keeps.
///
/// # Errors
/// The thread could not be started.
pub fn spawn(baker: Baker, swapper: Swapper, clock: ClockKind, lowered: Lowered) -> std::io::Result<Sender<Switch>> {
    let (sender, switches) = unbounded();
    std::thread::Builder::new().name("switch".to_owned()).spawn(move || run(baker, swapper, clock, &lowered, &switches))?;
    Ok(sender)
}

fn run(mut baker: Baker, mut swapper: Swapper, clock: ClockKind, lowered: &Lowered, switches: &Receiver<Switch>) {
    while !swapper.is_over() {
        drop(swapper.take_back());
        let switch = match switches.recv_timeout(IDLE) {
            Ok(switch) => switch,
            Err(RecvTimeoutError::Timeout) => continue,
            // Nobody will send any more: what comes back is still to be freed here.
            Err(RecvTimeoutError::Disconnected) => {
                std::thread::sleep(IDLE);
                continue;
            }
        };
        let Switch { config, at_tick, is_promised, done } = switch;
        let scene = match baker(&config) {
            Ok(scene) => Arc::new(scene),
            Err(problem) => {
                done.tell(Err(problem));
                if is_promised && clock == ClockKind::Virtual {
                    // The slot goes with this thread, so that simulated time does not wait for it.
                    return;
                }
                continue;
            }
        };
        let (reins, ends) = Reins::new(&scene.parameters, objects(&config));
        let stage = Stage::new(scene.clone())
            .with_wishes(Wishes::default().with_reins(ends).with_lowered(lowered))
            .with_time_budget(config.time_budget_s, clock)
            .at_tick(at_tick);
        let mut offered = swapper.offer(Box::new(stage));
        while let Err((Refused::Waiting, stage)) = offered {
            std::thread::sleep(POLL);
            drop(swapper.take_back());
            offered = swapper.offer(stage);
        }
        if offered.is_ok() {
            done.tell(Ok(Offered { config, scene, reins }));
        }
    }
}

#[cfg(test)]
mod tests {
    use crossbeam::channel::unbounded;

    use super::*;
    use crate::config;
    use crate::servo::SwapSlot;
    use crate::servo::testing::empty_scene;

    fn config() -> SceneConfig {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("scene.toml");
        let shape = "shape = { box_mm = [20.0, 20.0, 20.0] }\nvoxel_size_mm = 2.0\n";
        let text = format!("version = 1\n[[static]]\nname = \"base\"\n{shape}[tool]\n{shape}[device]\nprofile = \"sim-sigma7\"\n");
        std::fs::write(&path, text).expect("written");
        config::load(&path).unwrap_or_else(|errors| panic!("{errors}"))
    }

    /// What becomes of a promised scene that cannot be baked and of one that could, asked for behind it.
    fn became(clock: ClockKind) -> [String; 2] {
        let mut n_baked = 0;
        let baker: Baker = Box::new(move |_| {
            n_baked += 1;
            if n_baked == 1 {
                return Err(SceneError::Mesh {
                    name: "base".to_owned(),
                    source: crate::mesh::MeshError::Empty { path: "a.obj".into() },
                });
            }
            Ok(Arc::try_unwrap(empty_scene()).expect("not shared"))
        });
        let (swapper, slot) = SwapSlot::new(Box::new([0]));
        let switches = spawn(baker, swapper, clock, Lowered::default()).expect("a thread");
        let (sender, heard) = unbounded();
        for is_promised in [true, false] {
            let sender = sender.clone();
            let done = Done::new(move |result| {
                let word = match result {
                    Some(Ok(_)) => "offered",
                    Some(Err(_)) => "not baked",
                    None => "over",
                };
                sender.send(word.to_owned()).expect("heard");
            });
            // What cannot be sent any more is answered too.
            let _ = switches.send(Switch { config: config(), at_tick: 0, is_promised, done });
        }
        let both = [(); 2].map(|()| heard.recv().expect("an answer to each"));
        drop(slot);
        both
    }

    #[test]
    fn a_scene_that_cannot_be_baked_ends_no_other_but_under_the_virtual_clock() {
        assert_eq!(became(ClockKind::Real), ["not baked", "offered"]);
        assert_eq!(became(ClockKind::Virtual), ["not baked", "over"]);
    }
}
