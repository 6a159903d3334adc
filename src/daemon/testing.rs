//! Stand-ins for tests of what clients and files ask of a run: a small scene, and its session.

use std::path::PathBuf;

use super::session::SessionHandle;
use crate::config::{self, LoadOptions, SceneConfig};
use rt::clock::ClockKind;

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
stiffness_n_per_mm3 = 1.25
[device]
profile = "sim-sigma7"
"#;

/// A scene of this text, in a file that is gone: all have the same path, so that they can be
/// compared whole.
pub(crate) fn scene(text: &str) -> SceneConfig {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("scene.toml");
    std::fs::write(&path, text).expect("written");
    SceneConfig {
        path: PathBuf::from("scene.toml"),
        ..config::load(&path).unwrap_or_else(|errors| panic!("{errors}"))
    }
}

/// A session of that scene, which is still to be baked; no other scene is taken.
pub(crate) fn session(clock: ClockKind) -> SessionHandle {
    SessionHandle::new(scene(SCENE), LoadOptions::default(), clock, None)
}
