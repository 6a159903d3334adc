//! What version 0.1.0 read is read: its scenes, profiles, files of strokes and messages, kept as
//! they were in `tests/fixtures/v0.1.0`.
//!
//! A key that is gone since is accepted where it says what holds now, and refused by its name
//! elsewhere.

use std::fs;
use std::path::{Path, PathBuf};

use arms::profile;
use hapticd::config::{self, strokes};
use serde_json::Value;
use tempfile::TempDir;

use crate::monitor::{Daemon, folder, scene_file};

const ROOT: &str = env!("CARGO_MANIFEST_DIR");

fn kept(name: &str) -> PathBuf {
    Path::new(ROOT).join("tests/fixtures/v0.1.0").join(name)
}

/// The TOML files of a folder, sorted; there are some.
fn files(folder: &Path) -> Vec<PathBuf> {
    let mut paths: Vec<PathBuf> =
        fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
    paths.retain(|path| path.extension().is_some_and(|extension| extension == "toml"));
    paths.sort();
    assert!(!paths.is_empty(), "{}", folder.display());
    paths
}

/// The kept scenes beside the shipped models, hands and moves, which they name.
fn laid_out() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let place = |kept_name: &str, at: &str| {
        fs::create_dir_all(folder.path().join(at)).unwrap();
        for file in files(&kept(kept_name)) {
            fs::copy(&file, folder.path().join(at).join(file.file_name().unwrap())).unwrap();
        }
    };
    place("scenes", "scenes");
    place("clay", "clay");
    place("clay/strokes", "clay/strokes");
    for shipped in ["models", "scenes/hands", "scenes/moves", "clay/hands"] {
        std::os::unix::fs::symlink(
            Path::new(ROOT).join("config").join(shipped),
            folder.path().join(shipped),
        )
        .unwrap();
    }
    folder
}

#[test]
fn every_scene_and_file_of_strokes_is_accepted() {
    let folder = laid_out();
    let mut n_strokes = 0;
    for scenes in ["scenes", "clay"] {
        for path in files(&folder.path().join(scenes)) {
            let config = config::load(&path).unwrap_or_else(|errors| panic!("{errors}"));
            if let Some(sculpt) = config.sculpt
                && let Some(file) = sculpt.strokes
            {
                let script =
                    strokes::load(&file, &sculpt.tool).unwrap_or_else(|errors| panic!("{errors}"));
                n_strokes += script.orders.len();
            }
        }
    }
    assert!(n_strokes > 10, "{n_strokes}");
}

#[test]
fn every_profile_is_accepted() {
    for folder in ["devices", "devices/examples"] {
        for path in files(&kept(folder)) {
            let profile = profile::load(&path).unwrap_or_else(|errors| panic!("{errors}"));
            assert!(!profile.name.is_empty());
        }
    }
}

/// Sends what is kept for a command; none of it may be refused for what it says, and every key of
/// the answers is there.
fn is_understood(daemon: &Daemon, command: &str) {
    let messages: Value =
        serde_json::from_str(&fs::read_to_string(kept("messages.json")).unwrap()).unwrap();
    let messages = &messages[command];
    // A refusal for what a message says; "not as things stand" is another one.
    let is_wrong = |status: &Value| matches!(status.as_u64(), Some(400 | 404 | 405 | 413));
    let mut client = daemon.connect();
    for request in messages["websocket"].as_array().unwrap() {
        let reply = client.ask(request.clone());
        assert!(!is_wrong(&reply["status"]), "{request}: {reply}");
    }
    for (path, keys) in messages["keys"].as_object().unwrap() {
        let answer = if path == "hello" { client.hello.clone() } else { daemon.get(path) };
        let missing: Vec<&Value> = keys
            .as_array()
            .unwrap()
            .iter()
            .filter(|key| answer.get(key.as_str().unwrap()).is_none())
            .collect();
        assert!(missing.is_empty(), "{path} lacks {missing:?}: {answer}");
    }
    for request in messages["http"].as_array().unwrap() {
        let [method, path] = [0, 1].map(|part| request[part].as_str().unwrap());
        let body = if request[2].is_null() { String::new() } else { request[2].to_string() };
        let (status, answer) = daemon.http(method, path, &[], &body);
        assert!(!is_wrong(&status.into()), "{request}: {status} {answer}");
    }
}

#[test]
fn every_message_to_a_run_is_understood() {
    let folder = folder("");
    scene_file(&folder, "other.toml", "");
    let mut daemon = Daemon::of(folder, "", &[]);
    daemon.wait_for("state: enabled");
    is_understood(&daemon, "run");
    assert_eq!(daemon.ended().code, Some(0));
}

#[test]
fn every_message_about_clay_is_understood() {
    let mut daemon = Daemon::sculpting(crate::monitor::clay::SCENE, crate::monitor::clay::STILL);
    is_understood(&daemon, "sculpt");
    assert_eq!(daemon.ended().code, Some(0));
}
