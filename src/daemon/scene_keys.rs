//! Keys that count from the start of a run on: a scene that differs in one of them does not take
//! the place of another.

use core::time::Duration;
use std::path::{Path, PathBuf};

use super::session_error::SessionError;
use crate::config::SceneConfig;

/// The file of a scene beside the one that is rendered, by its name without the ending.
pub(super) fn path_of(name: &str, rendered: &SceneConfig) -> Result<PathBuf, SessionError> {
    let known = scenes_beside(&rendered.path);
    match known.iter().find(|(known, _)| known == name) {
        Some((_, path)) => Ok(path.clone()),
        None => {
            let known = known.into_iter().map(|(name, _)| name).collect();
            Err(SessionError::UnknownScene { name: name.to_owned(), known })
        }
    }
}

/// Scene files in the same folder: names without their ending, and paths, sorted.
pub fn scenes_beside(path: &Path) -> Vec<(String, PathBuf)> {
    let folder =
        path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let entries = std::fs::read_dir(folder)
        .into_iter()
        .flatten()
        .filter_map(Result::ok)
        .map(|entry| entry.path());
    let is_scene =
        |path: &PathBuf| path.extension().is_some_and(|ending| ending == "toml") && path.is_file();
    let named = |path: PathBuf| Some((path.file_stem()?.to_str()?.to_owned(), path));
    let mut scenes: Vec<_> = entries.filter(is_scene).filter_map(named).collect();
    scenes.sort();
    scenes
}

/// The key in which a scene differs from the one that it is to replace, and both values.
pub fn unlike(
    scene: &SceneConfig,
    rendered: &SceneConfig,
) -> Option<(&'static str, String, String)> {
    // The user's work on the clay would be lost.
    match (&scene.sculpt, &rendered.sculpt) {
        (None, None) => {}
        (its, Some(_)) => {
            let its = if its.is_some() { "clay" } else { "none" };
            return Some((
                "sculpt",
                its.to_owned(),
                "clay, which is worked until the run ends".to_owned(),
            ));
        }
        (Some(_), None) => return Some(("sculpt", "clay".to_owned(), "none".to_owned())),
    }
    unlike_at_the_arm(scene, rendered)
}

/// The same of what the arm and the client that enables it count on.
pub(super) fn unlike_at_the_arm(
    scene: &SceneConfig,
    rendered: &SceneConfig,
) -> Option<(&'static str, String, String)> {
    if scene.rate_hz != rendered.rate_hz {
        return Some((
            "rendering.rate_hz",
            scene.rate_hz.to_string(),
            rendered.rate_hz.to_string(),
        ));
    }
    let [its, ours] = [scene, rendered].map(|scene| &scene.device.profile);
    if its != ours {
        return Some(("device.profile", format!("\"{}\"", its.name), format!("\"{}\"", ours.name)));
    }
    // The source that lets force flow was chosen when the run began: an arm that a deadman enabled
    // is not to go on without one.
    let [its, ours] = [scene, rendered].map(|scene| scene.parameters.safety.deadman);
    if its != ours {
        let shown =
            |deadman: Option<u8>| deadman.map_or("\"off\"".to_owned(), |button| button.to_string());
        return Some(("safety.deadman", shown(its), shown(ours)));
    }
    let [its, ours] = [scene, rendered].map(|scene| scene.heartbeat);
    (its != ours).then(|| {
        let shown = |longest: Option<Duration>| {
            longest.map_or("none".to_owned(), |longest| longest.as_millis().to_string())
        };
        ("safety.heartbeat_ms", shown(its), shown(ours))
    })
}

/// A key, and its value in a scene for people.
type Shown = (&'static str, fn(&SceneConfig) -> String);

/// What a run takes from its first scene and keeps.
const FIXED: [Shown; 13] = [
    ("device.selector", |scene| {
        scene.device.selector.as_ref().map_or("none".to_owned(), |selector| format!("{selector:?}"))
    }),
    ("device.sim.hand_stiffness_n_per_m", |scene| {
        scene.device.sim.hand_stiffness_n_per_m.to_string()
    }),
    ("device.sim.hand_damping_n_s_per_m", |scene| {
        scene.device.sim.hand_damping_n_s_per_m.to_string()
    }),
    ("device.sim.hand_mass_g", |scene| (scene.device.sim.hand_mass_kg * 1e3).to_string()),
    ("device.sim.hand", |scene| {
        if scene.device.sim.hand_present { "present" } else { "\"none\"" }.to_owned()
    }),
    ("device.sim.delay_ticks", |scene| {
        scene.device.sim.delay_ticks.map_or("the profile's".to_owned(), |ticks| ticks.to_string())
    }),
    ("device.sim.fault", |scene| {
        scene.device.sim.fault.as_ref().map_or("none".to_owned(), |fault| format!("\"{fault}\""))
    }),
    ("realtime.mode", |scene| {
        if scene.realtime.enforce { "\"enforce\"" } else { "\"best-effort\"" }.to_owned()
    }),
    ("realtime.cpu", |scene| {
        scene.realtime.cpu.map_or("the last one".to_owned(), |cpu| cpu.to_string())
    }),
    ("realtime.priority", |scene| scene.realtime.priority.to_string()),
    ("monitor.listen", |scene| {
        scene.monitor.listen.map_or("\"off\"".to_owned(), |address| format!("\"{address}\""))
    }),
    ("monitor.token_file", |scene| {
        scene
            .monitor
            .token_file
            .as_ref()
            .map_or("none".to_owned(), |path| format!("\"{}\"", path.display()))
    }),
    ("monitor.origins", |scene| format!("{:?}", scene.monitor.origins)),
];

/// The key in which a scene differs although it counts at the start of a run only, and both values.
pub(super) fn fixed(
    config: &SceneConfig,
    rendered: &SceneConfig,
) -> Option<(&'static str, String, String)> {
    FIXED
        .into_iter()
        .map(|(key, show)| (key, show(config), show(rendered)))
        .find(|(_, its, ours)| its != ours)
}
