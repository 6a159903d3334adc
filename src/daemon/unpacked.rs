//! The scenes of a recording, put back into a folder from which they can be baked.

use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::path::{Component, Path, PathBuf};

use super::recorded::{file_keys, resolved};
use crate::config::{self, ConfigErrors, LoadOptions, SceneConfig};
use recording::file::LONGEST_TEXT;

/// Why a recorded scene cannot be put back.
#[derive(Debug, thiserror::Error)]
pub enum UnpackError {
    /// Not everything is in the recording.
    #[error("the recording does not hold `{file}`, which scene {scene_idx} needs: {why}")]
    Missing {
        /// Which scene.
        scene_idx: u32,
        /// As written in the scene.
        file: String,
        /// What the recorder said.
        why: String,
    },
    /// A name that leads out of the recording.
    #[error("the recording names a file `{0}`, which is outside of it")]
    Outside(String),
    /// The temporary folder.
    #[error("cannot write {}: {source}", file.display())]
    Write {
        /// Which file.
        file: PathBuf,
        /// Cause.
        source: io::Error,
    },
    /// The recorded scene is none.
    #[error("scene {scene_idx} of the recording: {message}")]
    Toml {
        /// Which scene.
        scene_idx: u32,
        /// Cause.
        message: String,
    },
    /// This version reads it in another way.
    #[error("{0}")]
    Config(ConfigErrors),
}

/// A folder into which the files of a recording go; removed when it goes.
#[derive(Debug)]
pub struct Unpacked {
    folder: tempfile::TempDir,
    manifests: BTreeMap<String, BTreeMap<String, String>>,
}

/// A scene as it was, and what this version makes of it in another way than the one that recorded
/// it.
#[derive(Debug)]
pub struct RecordedScene {
    /// Its files lie in the folder into which the recording was unpacked.
    pub config: SceneConfig,
    /// Keys of the resolved form.
    pub changed: Vec<String>,
    /// The tool began at its start.
    pub starts_anew: bool,
}

impl Unpacked {
    /// An empty one.
    ///
    /// # Errors
    /// There is no place for temporary files.
    pub fn new() -> Result<Self, UnpackError> {
        let folder = tempfile::Builder::new().prefix("hapticd-replay-").tempdir();
        let folder =
            folder.map_err(|source| UnpackError::Write { file: std::env::temp_dir(), source })?;
        Ok(Self { folder, manifests: BTreeMap::new() })
    }

    /// Puts a file where its name says.
    ///
    /// # Errors
    /// The name leads out of the folder, or the file cannot be written.
    pub fn put(&self, name: &str, data: &[u8]) -> Result<(), UnpackError> {
        if !is_inside(name) {
            return Err(UnpackError::Outside(name.to_owned()));
        }
        // Others may attach what they like; no scene is made of it.
        if !name.starts_with("scenes/") {
            return Ok(());
        }
        let path = self.folder.path().join(name);
        let written =
            path.parent().map_or(Ok(()), fs::create_dir_all).and_then(|()| fs::write(&path, data));
        written.map_err(|source| UnpackError::Write { file: path, source })
    }

    /// Takes note of what belongs together.
    pub fn note(&mut self, name: String, values: BTreeMap<String, String>) {
        self.manifests.insert(name, values);
    }

    /// A fact about the run that was recorded.
    pub fn fact(&self, name: &str) -> Option<&str> {
        self.manifests.get("run")?.get(name).map(String::as_str)
    }

    /// Reads a scene whose files are all there.
    ///
    /// # Errors
    /// [`UnpackError`]: a file is missing, or the scene is none.
    pub fn scene(&self, scene_idx: u32) -> Result<RecordedScene, UnpackError> {
        let folder = self.folder.path().join(format!("scenes/{scene_idx}"));
        let missing = |file: &str, why: String| UnpackError::Missing {
            scene_idx,
            file: file.to_owned(),
            why,
        };
        let garbled = |message: String| UnpackError::Toml { scene_idx, message };
        let read = |name: &str| {
            let path = folder.join(name);
            if fs::metadata(&path).is_ok_and(|text| text.len() > LONGEST_TEXT as u64) {
                return Err(missing(
                    name,
                    format!("no text has more than {} MiB", LONGEST_TEXT >> 20),
                ));
            }
            fs::read_to_string(path).map_err(|error| missing(name, error.to_string()))
        };
        let manifest = self.manifests.get(&format!("scenes/{scene_idx}"));
        let manifest = manifest.ok_or_else(|| {
            missing(
                "scene.toml",
                "the recording does not say which scene the run went over to".to_owned(),
            )
        })?;
        let mut scene: toml::Table = read("scene.toml")?
            .parse()
            .map_err(|error: toml::de::Error| garbled(error.message().to_owned()))?;
        // Of the arm only what it is made of matters: its samples are in the recording.
        if let Some(device) = scene.get_mut("device").and_then(toml::Value::as_table_mut) {
            device.retain(|key, _| key != "hand" && key != "profile" && key != "selector");
        }
        scene.remove("monitor");
        for key in file_keys(&mut scene) {
            let written = key.as_str().unwrap_or_default().to_owned();
            let n = (0..)
                .map_while(|n| manifest.get(&format!("file.{n}.written")).map(|other| (n, other)));
            let Some((n, _)) = n.into_iter().find(|(_, other)| **other == written) else {
                return Err(missing(&written, "the recording does not list it".to_owned()));
            };
            for part in 0.. {
                let about = |what: &str| manifest.get(&format!("file.{n}.{part}.{what}"));
                let Some(name) = about("name") else {
                    if part == 0 {
                        // That name may be one of a file of the user who replays it.
                        return Err(missing(
                            &written,
                            "the recording names no file for it".to_owned(),
                        ));
                    }
                    break;
                };
                if !is_inside(name) {
                    return Err(UnpackError::Outside(name.clone()));
                }
                if let Some(why) = about("missing") {
                    return Err(missing(name, why.clone()));
                }
                if part == 0 {
                    *key = toml::Value::String(format!("files/{n}/{name}"));
                }
            }
        }
        let text = toml::to_string(&scene).map_err(|error| garbled(error.to_string()))?;
        let path = folder.join("replay.toml");
        fs::write(&path, text)
            .map_err(|source| UnpackError::Write { file: path.clone(), source })?;
        let profile = folder.join("profile.toml");
        let mut arm: toml::Table = read("profile.toml")?
            .parse()
            .map_err(|error: toml::de::Error| garbled(error.message().to_owned()))?;
        // An arm that is not there takes no firmware.
        let firmware = arm
            .get_mut("protocol")
            .and_then(toml::Value::as_table_mut)
            .and_then(|protocol| protocol.remove("firmware"));
        if firmware.is_some() {
            let text = toml::to_string(&arm).map_err(|error| garbled(error.to_string()))?;
            fs::write(&profile, text)
                .map_err(|source| UnpackError::Write { file: profile.clone(), source })?;
        }
        let profile = profile.to_string_lossy().into_owned();
        let enforce = manifest.get("enforce").map(|enforce| enforce == "true");
        let options = LoadOptions { device: Some(profile), enforce, ..LoadOptions::default() };
        let config = config::load_with(&path, &options).map_err(UnpackError::Config)?;
        let recorded = serde_json::from_str(&read("resolved.json")?)
            .map_err(|error| garbled(error.to_string()))?;
        let mut changed = Vec::new();
        let mut now = resolved(&config);
        // A scene without a name is called like its file.
        if let (Some(now), Some(name)) = (now.as_object_mut(), manifest.get("name")) {
            now.insert("name".to_owned(), name.clone().into());
        }
        differences("", &recorded, &now, &mut changed);
        let starts_anew =
            manifest.get("starts_anew").is_some_and(|starts_anew| starts_anew == "true");
        Ok(RecordedScene { config, changed, starts_anew })
    }
}

/// A name that stays within the folder to which it is joined.
fn is_inside(name: &str) -> bool {
    let mut parts = Path::new(name).components().peekable();
    parts.peek().is_some() && parts.all(|part| matches!(part, Component::Normal(_)))
}

/// Keys that two objects have different values for.
fn differences(
    key: &str,
    recorded: &serde_json::Value,
    now: &serde_json::Value,
    found: &mut Vec<String>,
) {
    match (recorded, now) {
        (serde_json::Value::Object(recorded), serde_json::Value::Object(now)) => {
            let keys: std::collections::BTreeSet<&String> =
                recorded.keys().chain(now.keys()).collect();
            let at = |object: &serde_json::Map<String, serde_json::Value>, name: &str| {
                object.get(name).cloned().unwrap_or_default()
            };
            for name in keys {
                let path = if key.is_empty() { name.clone() } else { format!("{key}.{name}") };
                differences(&path, &at(recorded, name), &at(now, name), found);
            }
        }
        _ if recorded != now => found.push(format!("{key}: {recorded} was recorded, {now} now")),
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Why a scene that names `part.obj` cannot be put back from these values.
    fn refused(values: &[(&str, &str)]) -> UnpackError {
        let mut unpacked = Unpacked::new().expect("a folder");
        unpacked
            .put("scenes/0/scene.toml", b"[tool]\nmesh = \"/etc/part.obj\"\n")
            .expect("written");
        unpacked.note(
            "scenes/0".to_owned(),
            values.iter().map(|(key, value)| ((*key).to_owned(), (*value).to_owned())).collect(),
        );
        unpacked.scene(0).expect_err("refused")
    }

    #[test]
    fn no_file_of_the_replaying_user_is_read() {
        let written = ("file.0.written", "/etc/part.obj");
        let error = refused(&[written]);
        assert!(
            matches!(&error, UnpackError::Missing { why, .. } if why == "the recording names no file for it"),
            "{error}"
        );
        for name in ["../../../etc/part.obj", "/etc/part.obj", "a/../../b", ""] {
            let error = refused(&[written, ("file.0.0.name", name)]);
            assert!(matches!(&error, UnpackError::Outside(outside) if outside == name), "{error}");
        }
    }

    #[test]
    fn what_belongs_to_no_scene_is_not_written() {
        let unpacked = Unpacked::new().expect("a folder");
        unpacked.put("notes.txt", b"of another program").expect("not looked at");
        assert!(matches!(unpacked.put("scenes/../../x", b""), Err(UnpackError::Outside(_))));
        assert_eq!(fs::read_dir(unpacked.folder.path()).expect("a folder").count(), 0);
    }

    #[test]
    fn a_text_that_is_none_is_not_read() {
        let mut unpacked = Unpacked::new().expect("a folder");
        unpacked.put("scenes/0/scene.toml", &vec![b'#'; LONGEST_TEXT + 1]).expect("written");
        unpacked.note("scenes/0".to_owned(), BTreeMap::new());
        assert!(unpacked.scene(0).expect_err("refused").to_string().contains("16 MiB"));
    }
}
