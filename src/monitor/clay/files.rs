//! Files of the clay that clients ask for: into a folder of our own, never over a file that is
//! there.

use std::path::PathBuf;
use std::sync::{Arc, MutexGuard, PoisonError};
use std::time::SystemTime;

use serde::Deserialize;

use super::super::answer::{Completion, Reply};
use super::super::hub::Hub;
use super::super::problem::RequestError;
use super::super::worker::Worker;
use super::ClayService;
use crate::daemon::sculpting::OrderError;
use clay::engine::SculptOrder;
use rt::utc;

/// Longest name of a file that a client may choose, bytes.
const LONGEST_NAME: usize = 120;

/// Where there is no folder to write to.
const NO_FOLDER: &str =
    "begin hapticd with HOME or XDG_STATE_HOME set to a folder that may be written to";

/// What is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(in crate::monitor) enum SaveKind {
    /// Samples with normals and colours.
    Points,
    /// All that is needed to go on another day.
    Session,
    /// A closed mesh.
    Export,
}

impl SaveKind {
    fn word(self) -> &'static str {
        match self {
            Self::Points => "points",
            Self::Session => "session",
            Self::Export => "mesh",
        }
    }

    fn ending(self) -> &'static str {
        match self {
            Self::Points | Self::Export => ".ply",
            Self::Session => ".session",
        }
    }

    fn order(self, file: PathBuf) -> SculptOrder {
        match self {
            Self::Points => SculptOrder::SavePoints(file),
            Self::Session => SculptOrder::SaveSession(file),
            Self::Export => SculptOrder::Export(file),
        }
    }
}

/// The name of a file that a client chose, with its ending; in words what will do where it will
/// not.
///
/// # Errors
/// It could lead out of the folder that it is meant for, or be hidden there.
pub fn plain_name(chosen: &str, ending: &str) -> Result<String, &'static str> {
    let mut name = chosen.to_owned();
    if !name.ends_with(ending) {
        name += ending;
    }
    // Letters of every language, also where an accent is a character of its own.
    let is_plain =
        |c: char| c.is_alphanumeric() || matches!(c, '-' | '_' | '.' | ' ' | '\u{300}'..='\u{36f}');
    if name.starts_with('.') || !name.chars().all(is_plain) || name.len() > LONGEST_NAME {
        return Err(
            "a name of letters, digits, `-`, `_`, `.` and spaces that does not begin with `.`",
        );
    }
    Ok(name)
}

/// Writes the clay to a file of this name, or of one that is chosen here.
pub(in crate::monitor) fn save(
    hub: &Arc<Hub>,
    files: &Worker,
    kind: SaveKind,
    file: Option<String>,
    reply: Reply,
) {
    let clay = match hub.clay() {
        Ok(clay) => clay,
        Err(problem) => return reply(Err(problem)),
    };
    let hub = hub.clone();
    // Folders may be on a disk that takes its time.
    files.post(move || {
        let path = match clay.reserve(kind, file.as_deref()) {
            Ok(path) => path,
            Err(problem) => return reply(Err(problem)),
        };
        let saver = clay.clone();
        let order = kind.order(path.clone());
        let answer = Box::new(move |result: Result<(), OrderError>| {
            saver.saving.lock().unwrap_or_else(PoisonError::into_inner).remove(&path);
            if result.is_ok() {
                saver.saved().push(path.clone());
                let file = path.to_string_lossy();
                hub.tell(
                    "clay",
                    None,
                    &format!("the {} of the clay went to {file}", kind.word()),
                    &["saved", &file],
                );
            }
            reply(
                result
                    .map(|()| Completion::Saved(path))
                    .map_err(|refused| RequestError::from(&refused)),
            );
        });
        clay.access.ask(order, answer);
    });
}

impl ClayService {
    /// Files that were written for clients, oldest first.
    pub(in crate::monitor) fn saved(&self) -> MutexGuard<'_, Vec<PathBuf>> {
        self.saved.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A path that no other request writes to.
    fn reserve(&self, kind: SaveKind, file: Option<&str>) -> Result<PathBuf, RequestError> {
        let folder = self
            .folder
            .as_ref()
            .ok_or_else(|| RequestError::unavailable("there is no folder to save to", NO_FOLDER))?;
        let dated = || utc::timestamp(SystemTime::now()).replace(':', "");
        let chosen = file.map_or_else(|| format!("{}-{}", kind.word(), dated()), str::to_owned);
        let name = plain_name(&chosen, kind.ending()).map_err(|accepted| {
            RequestError::bad(
                format!("a file of clay takes {accepted}"),
                format!("such as bowl{}", kind.ending()),
            )
        })?;
        std::fs::create_dir_all(folder).map_err(|error| {
            RequestError::conflict(
                format!("cannot create {}: {error}", folder.display()),
                NO_FOLDER,
            )
        })?;
        let path = folder.join(name);
        let mut saving = self.saving.lock().unwrap_or_else(PoisonError::into_inner);
        if path.symlink_metadata().is_ok() || saving.contains(&path) {
            return Err(RequestError::conflict(
                format!("{} exists already", path.display()),
                "choose another name",
            ));
        }
        saving.insert(path.clone());
        Ok(path)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_stay_in_their_folder() {
        assert_eq!(plain_name("a bowl", ".ply"), Ok("a bowl.ply".to_owned()));
        assert_eq!(plain_name("bowl.ply", ".ply"), Ok("bowl.ply".to_owned()));
        assert_eq!(plain_name("Schüssel 2", ".ply"), Ok("Schüssel 2.ply".to_owned()));
        assert_eq!(plain_name("u\u{308}ber", ".ply"), Ok("u\u{308}ber.ply".to_owned()));
        for chosen in
            ["../bowl", "/tmp/bowl", ".bowl", "", "bo\nwl", "b\0", "a/b", &"x".repeat(200)]
        {
            assert!(plain_name(chosen, ".ply").is_err(), "{chosen:?}");
        }
    }
}
