//! Stand-ins for tests of what clients and files ask of a run: a small scene, and the desk that answers.

use std::path::PathBuf;
use std::sync::Arc;

use super::desk::{Board, Counter, Desk, Tools};
use crate::config::{self, LoadOptions, SceneConfig};
use crate::servo::Lowered;

/// A box over a plate, on a simulated arm; more keys may follow.
pub(crate) const SCENE: &str = r#"version = 1
[[static]]
name = "base"
shape = { plane_mm = [60.0, 60.0] }
voxel_size_mm = 2.0
[tool]
shape = { box_mm = [20.0, 20.0, 20.0] }
voxel_size_mm = 2.0
[contact]
stiffness_n_per_mm = 5.0
[device]
profile = "sim-sigma7"
"#;

/// A scene of this text, in a file that is gone: all have the same path, so that they can be compared whole.
pub(crate) fn scene(text: &str) -> SceneConfig {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("scene.toml");
    std::fs::write(&path, text).expect("written");
    SceneConfig { path: PathBuf::from("scene.toml"), ..config::load(&path).unwrap_or_else(|errors| panic!("{errors}")) }
}

/// A desk that is not open yet, without anybody who bakes other scenes.
pub(crate) fn desk() -> (Desk, Counter, Board) {
    let board = Board::new(scene(SCENE));
    let look = Arc::new(|_: &_| Box::new(|| ()) as Box<dyn FnOnce() + Send>);
    let tools = Tools { board: board.clone(), switches: None, options: LoadOptions::default(), lowered: Lowered::default(), look };
    let (desk, counter) = Desk::new(tools);
    (desk, counter, board)
}
