//! Why a session does not do what it was asked for.

use crate::config::ConfigErrors;
use crate::scene::SceneError;
use engine::servo::ControlError;

/// Why something was not done.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    /// A parameter or a pose.
    #[error("{0}")]
    Control(#[from] ControlError),
    /// The file of a scene's hand.
    #[error("{0}")]
    Hand(String),
    /// Clay has no beginning to go back to but its strokes.
    #[error("clay is not reset: undo its strokes")]
    ClayStays,
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
    #[error("a run with clay takes only changes of parameters ({}), and the scene file has other \
        changes", .taken.join(", "))]
    Clay {
        /// The parameters.
        taken: Vec<&'static str>,
    },
    /// The scene cannot be baked.
    #[error("{0}")]
    Scene(#[from] SceneError),
    /// One scene at a time.
    #[error("another scene is being baked or exchanged; ask again when it is rendered")]
    Busy,
    /// The first scene is not rendered yet.
    #[error("the scene is being baked: nothing is rendered yet")]
    Baking,
    /// The run has ended, or has no part that could do it.
    #[error("the run cannot do this any more")]
    Over,
}
