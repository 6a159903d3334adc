//! What was found of a machine or of an arm, and what to do about it.

use std::fs;
use std::path::{Path, PathBuf};

/// How bad it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Standing {
    /// As it should be.
    Good,
    /// The machine does not say.
    Unknown,
    /// It works, and would work better.
    Advice,
    /// It does not work like this.
    Bad,
}

impl Standing {
    /// Word for reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Good => "ok",
            Self::Unknown => "unknown",
            Self::Advice => "advice",
            Self::Bad => "bad",
        }
    }
}

/// One finding.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Finding {
    /// What was looked at.
    pub name: String,
    /// How bad it is.
    pub standing: Standing,
    /// What was found.
    pub found: String,
    /// What to type, or to do by hand; empty: nothing to do.
    pub advice: String,
    /// The advice is prose, and no command.
    pub by_hand: bool,
}

impl Finding {
    /// All is well.
    pub fn good(name: impl Into<String>, found: impl Into<String>) -> Self {
        Self {
            name: name.into(),
            standing: Standing::Good,
            found: found.into(),
            advice: String::new(),
            by_hand: false,
        }
    }

    /// The program cannot find out.
    pub fn unknown(name: impl Into<String>, found: impl Into<String>) -> Self {
        Self { standing: Standing::Unknown, ..Self::good(name, found) }
    }

    /// Could be better.
    pub fn advice(
        name: impl Into<String>,
        found: impl Into<String>,
        advice: impl Into<String>,
    ) -> Self {
        Self { standing: Standing::Advice, advice: advice.into(), ..Self::good(name, found) }
    }

    /// Has to be better.
    pub fn bad(
        name: impl Into<String>,
        found: impl Into<String>,
        advice: impl Into<String>,
    ) -> Self {
        Self { standing: Standing::Bad, advice: advice.into(), ..Self::good(name, found) }
    }

    /// The same, with an advice that is no command.
    pub fn by_hand(self) -> Self {
        Self { by_hand: true, ..self }
    }

    /// The advice, line by line, each behind what it is: `type:` a command, `do:` prose.
    pub fn advice_lines(&self) -> impl Iterator<Item = String> {
        let lead = if self.by_hand { "do:" } else { "type:" };
        self.advice.lines().map(move |line| format!("{lead:<5} {line}"))
    }
}

/// The root of `/sys`, `/proc`, `/etc` and `/dev`: `/`, or a folder that looks like it.
#[derive(Clone, Debug)]
pub struct Root(PathBuf);

impl Default for Root {
    fn default() -> Self {
        Self::at(Path::new("/"))
    }
}

impl Root {
    /// Another root.
    pub fn at(folder: &Path) -> Self {
        Self(folder.to_owned())
    }

    /// A path below it; `path` is absolute.
    pub fn join(&self, path: impl AsRef<Path>) -> PathBuf {
        let path = path.as_ref();
        self.0.join(path.strip_prefix("/").unwrap_or(path))
    }

    /// A file, without the white space at its ends; `None`: not there, or not readable.
    pub fn read(&self, path: impl AsRef<Path>) -> Option<String> {
        fs::read_to_string(self.join(path)).ok().map(|text| text.trim().to_owned())
    }

    /// Names in a folder, sorted; empty where there is none.
    pub fn names(&self, folder: impl AsRef<Path>) -> Vec<String> {
        let Ok(entries) = fs::read_dir(self.join(folder)) else { return Vec::new() };
        let mut names: Vec<String> = entries
            .flatten()
            .map(|entry| entry.file_name().to_string_lossy().into_owned())
            .collect();
        names.sort();
        names
    }
}

/// A folder that looks like a root, with these files in it.
#[cfg(any(test, feature = "testing"))]
#[doc(hidden)]
pub fn tree(files: &[(&str, &str)]) -> (tempfile::TempDir, Root) {
    let folder = tempfile::tempdir().expect("folder");
    let root = Root::at(folder.path());
    for (path, text) in files {
        let path = root.join(path);
        fs::create_dir_all(path.parent().expect("below the root")).expect("folder");
        fs::write(path, text).expect("file");
    }
    (folder, root)
}
