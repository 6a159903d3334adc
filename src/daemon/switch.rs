//! Scenes that are to take the place of the one that is rendered: baked while it renders, handed over, and the old one freed.

use core::time::Duration;
use std::sync::Arc;

use crossbeam::channel::{Receiver, RecvTimeoutError, Sender, unbounded};

use crate::config::SceneConfig;
use crate::haptics::RenderScene;
use crate::rt::clock::ClockKind;
use crate::scene::SceneError;
use crate::servo::{Refused, Reins, Stage, Swapper, Wishes};

/// How often the cold side looks for what came back.
const POLL: Duration = Duration::from_millis(2);
/// The same while nothing is to be handed over.
const IDLE: Duration = Duration::from_millis(10);

/// Bakes a scene in whatever way the caller likes: with its cache, its limits, its progress.
pub type Baker = Box<dyn FnMut(&SceneConfig) -> Result<RenderScene, SceneError> + Send>;

/// Hears what became of a scene: baked and offered, or why not. `None`: the run was over first.
pub type Done = Box<dyn FnOnce(Option<Result<Offered, SceneError>>) + Send>;

/// A scene to go over to: one that is not [`unlike`](super::desk::unlike) the one that is rendered.
pub struct Switch {
    /// The checked scene.
    pub config: SceneConfig,
    /// First tick in which it may be taken.
    pub at_tick: u64,
    /// A run under the virtual clock waits for it at that tick. When it cannot be baked, no other is waited for either.
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
/// has been taken. Not joined: a bake that nobody waits for any more ends with the process.
///
/// # Errors
/// The thread could not be started.
pub fn spawn(baker: Baker, swapper: Swapper, clock: ClockKind) -> std::io::Result<Sender<Switch>> {
    let (sender, switches) = unbounded();
    std::thread::Builder::new().name("switch".to_owned()).spawn(move || run(baker, swapper, clock, &switches))?;
    Ok(sender)
}

fn run(mut baker: Baker, mut swapper: Swapper, clock: ClockKind, switches: &Receiver<Switch>) {
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
                done(Some(Err(problem)));
                if is_promised {
                    // The slot goes with this thread, so that simulated time does not wait for it.
                    return;
                }
                continue;
            }
        };
        let (reins, ends) = Reins::new(&scene.parameters, objects(&config));
        let stage = Stage::new(scene.clone())
            .with_wishes(Wishes::default().with_reins(ends))
            .with_time_budget(config.time_budget_s, clock)
            .at_tick(at_tick);
        let mut offered = swapper.offer(Box::new(stage));
        while let Err((Refused::Waiting, stage)) = offered {
            std::thread::sleep(POLL);
            drop(swapper.take_back());
            offered = swapper.offer(stage);
        }
        done(offered.is_ok().then_some(Ok(Offered { config, scene, reins })));
    }
}
