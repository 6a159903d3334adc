//! What can be wrong with a scene or a profile, and how it is said.

use std::collections::BTreeMap;
use std::fmt;
use std::io;
use std::path::{Path, PathBuf};

use vps::storage::printable::{one_line, shown};

/// Every problem of the first pass that found any, in the order of the file.
#[derive(Debug)]
pub struct ConfigErrors {
    problems: Vec<Problem>,
}

impl ConfigErrors {
    /// Gathers problems and sorts them as a reader meets them: by file, then by line.
    pub fn new(mut problems: Vec<Problem>) -> Self {
        // Stable: problems of one line stay in the order in which they were found.
        problems.sort_by(|a, b| (&a.file, a.line).cmp(&(&b.file, b.line)));
        Self { problems }
    }

    /// The problems by file, then by line; never empty.
    pub fn problems(&self) -> &[Problem] {
        &self.problems
    }

    /// All of them, in the order in which they were found.
    pub fn into_problems(self) -> Vec<Problem> {
        self.problems
    }
}

/// One `error:` line for each problem, with a `hint:` line where one helps.
impl fmt::Display for ConfigErrors {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (problem_idx, problem) in self.problems.iter().enumerate() {
            if problem_idx > 0 {
                writeln!(f)?;
            }
            write!(f, "error: {problem}")?;
            if let Some(hint) = problem.hint() {
                write!(f, "\n  hint: {hint}")?;
            }
        }
        Ok(())
    }
}

impl std::error::Error for ConfigErrors {}

/// One problem: where it is, what was written there, what is wrong with it.
///
/// Displays as `FILE:LINE: KEY = VALUE: WHAT`, leaving out what does not apply.
#[derive(Debug)]
pub struct Problem {
    /// The scene or profile.
    pub file: PathBuf,
    /// Line, from 1: of the key, else of the table that should hold it; `None` for a problem with
    /// the file itself.
    pub line: Option<usize>,
    /// Dotted path of the key, such as `static[0].voxel_size_mm`.
    pub key: Option<String>,
    /// The value as written, on one line, cut when long; `None` where nothing is written.
    pub value: Option<String>,
    /// What is wrong with it, and what would be accepted.
    pub kind: ProblemKind,
}

impl Problem {
    /// A problem with the file as a whole.
    pub fn of_file(file: &Path, kind: ProblemKind) -> Self {
        Self { file: file.to_path_buf(), line: None, key: None, value: None, kind }
    }

    /// True where something that is named is not there: the file system says so by itself, whatever
    /// else is wrong with the file.
    pub fn is_missing(&self) -> bool {
        use ProblemKind::{FileMissing, NotAFile, UnknownProfile};
        matches!(self.kind, FileMissing { .. } | NotAFile { .. } | UnknownProfile { .. })
    }

    /// What to do about it; `None` when the message already says so.
    pub fn hint(&self) -> Option<String> {
        let key = self.key.as_deref().unwrap_or_default();
        match &self.kind {
            ProblemKind::VersionMissing { supported } => {
                Some(format!("write `version = {supported}` as the first line"))
            }
            ProblemKind::UnknownKey { known, .. } => {
                Some(format!("known here: {}", known.join(", ")))
            }
            ProblemKind::WrongType { .. } if key == "static" => {
                Some("write each static object as its own [[static]] table".into())
            }
            ProblemKind::Missing { .. } if key.ends_with("units") => {
                Some("a mesh file does not say its unit; a wrong guess is a factor of 1000".into())
            }
            ProblemKind::FileMissing { .. } if key.starts_with("--") => {
                Some(TO_WORKING_DIRECTORY.into())
            }
            ProblemKind::FileMissing { path } => {
                let relative = "paths are relative to the file that names them";
                Some(
                    near_file(path).map_or(relative.into(), |name| {
                        format!("did you mean `{name}`? {relative}")
                    }),
                )
            }
            ProblemKind::UnknownProfile { known, .. } => Some(format!(
                "known profiles: {}; a path has a `/` or ends in .toml",
                known.join(", ")
            )),
            ProblemKind::IsProfile => Some(
                "a scene names it as `profile` under [device]; or give a scene, and this file \
                    to --device"
                    .into(),
            ),
            ProblemKind::IsScene => {
                Some("a profile describes an arm: its name, or a file of devices/".into())
            }
            ProblemKind::IsStrokes => Some(
                "a scene names it as `strokes` under [sculpt], or `hapticd sculpt SCENE \
                    --strokes FILE` takes it"
                    .into(),
            ),
            ProblemKind::IsNoStrokes => Some(
                "a file of strokes has `version` and [[stroke]] tables, and nothing else".into(),
            ),
            ProblemKind::IsSession => {
                Some("a scene goes on from it: `session` under [sculpt] names it".into())
            }
            ProblemKind::IsMesh => Some(
                "`hapticd bake` takes it as it is; a scene (.toml) names it as `mesh` under \
                    [[static]] or [tool]"
                    .into(),
            ),
            ProblemKind::StiffnessAboveBound { accepted, unit, .. } => Some(format!(
                "write at most {} {unit}, leave the key out to get the bound itself, or set \
                    rendering.allow_unstable = true",
                round_down(*accepted)
            )),
            ProblemKind::Refused { hint, .. } => hint.clone(),
            ProblemKind::Syntax { hint, .. } => hint.map(str::to_owned),
            ProblemKind::StrokesMissing => Some(TO_WORKING_DIRECTORY.into()),
            ProblemKind::Unreadable { cause } if cause.kind() == io::ErrorKind::NotFound => {
                let of_package = packaged(&self.file)
                    .map(|file| format!("the package has one of that name: {}", file.display()));
                let near = || {
                    near_file(&self.file)
                        .map(|name| format!("did you mean `{name}`? {TO_WORKING_DIRECTORY}"))
                };
                of_package.or_else(near).or_else(|| Some(TO_WORKING_DIRECTORY.into()))
            }
            ProblemKind::Unreadable { cause } if cause.kind() == io::ErrorKind::IsADirectory => {
                let scene = self.file.join("scene.toml");
                scene.is_file().then(|| format!("did you mean {}?", scene.display()))
            }
            ProblemKind::Unreadable { .. }
            | ProblemKind::VersionUnknown { .. }
            | ProblemKind::WrongType { .. }
            | ProblemKind::Repeated { .. }
            | ProblemKind::UnknownWord { .. }
            | ProblemKind::Missing { .. }
            | ProblemKind::NotAccepted { .. }
            | ProblemKind::Disagrees { .. }
            | ProblemKind::NotAvailable { .. }
            | ProblemKind::Gone { .. }
            | ProblemKind::NotAFile { .. }
            | ProblemKind::Exclusive { .. }
            | ProblemKind::DuplicateName { .. }
            | ProblemKind::DampingAboveProfile { .. } => None,
        }
    }
}

/// Where the Debian package keeps what it shares.
pub const PACKAGED: &str = "/usr/share/hapticd";

const TO_WORKING_DIRECTORY: &str =
    "on the command line, paths are relative to the working directory";
/// Names of a folder that are looked at for a near one.
const NAMES_MAX: usize = 1000;

/// The name in the same folder, of the same type, that looks most like that of a file which is not
/// there.
fn near_file(missing: &Path) -> Option<String> {
    let folder =
        missing.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let extension = missing.extension()?;
    let is_alike = |path: &PathBuf| {
        path.extension().is_some_and(|own| own.eq_ignore_ascii_case(extension)) && path.is_file()
    };
    let paths = folder
        .read_dir()
        .ok()?
        .take(NAMES_MAX)
        .filter_map(Result::ok)
        .map(|entry| entry.path())
        .filter(is_alike);
    let stems: BTreeMap<String, PathBuf> =
        paths.filter_map(|path| Some((path.file_stem()?.to_str()?.to_owned(), path))).collect();
    let stem = nearest(missing.file_stem()?.to_str()?, stems.keys().map(String::as_str))?;
    Some(stems.get(&stem)?.file_name()?.to_str()?.to_owned())
}

fn unreadable(cause: &io::Error) -> String {
    if cause.kind() == io::ErrorKind::NotFound {
        "no such file".to_owned()
    } else {
        format!("cannot be read: {cause}")
    }
}

/// The file of that name that the Debian package brought.
fn packaged(file: &Path) -> Option<PathBuf> {
    let folders = ["scenes", "clay"].map(|folder| Path::new(PACKAGED).join(folder));
    folders
        .iter()
        .map(|folder| folder.join(file.file_name().unwrap_or_default()))
        .find(|file| file.is_file())
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&shown(&self.file))?;
        if let Some(line) = self.line {
            write!(f, ":{line}")?;
        }
        write!(f, ": ")?;
        match (&self.key, &self.value) {
            (Some(key), Some(value)) => write!(f, "{} = {}: ", one_line(key), one_line(value))?,
            (Some(key), None) => write!(f, "{}: ", one_line(key))?,
            (None, _) => {}
        }
        write!(f, "{}", self.kind)
    }
}

impl std::error::Error for Problem {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        Some(&self.kind)
    }
}

/// The kinds of problem. A variant carries what its message needs beyond file, line, key and value.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ProblemKind {
    /// The file does not open.
    #[error("{}", unreadable(.cause))]
    Unreadable {
        /// What the operating system said.
        cause: io::Error,
    },
    /// A file of strokes that is not there.
    #[error("no such file; it would hold the strokes of the clay")]
    StrokesMissing,
    /// A file of strokes where a scene must be.
    #[error("this is a file of strokes, not a scene")]
    IsStrokes,
    /// A scene where a file of strokes must be.
    #[error("this is a scene, not a file of strokes")]
    IsNoStrokes,
    /// A saved session of clay where a scene must be.
    #[error("this is a saved session of clay, not a scene")]
    IsSession,
    /// A mesh where a scene must be.
    #[error("this is a mesh file, not a scene")]
    IsMesh,
    /// A device profile where a scene belongs.
    #[error("this is a device profile, not a scene")]
    IsProfile,
    /// A scene where a device profile belongs.
    #[error("this is a scene, not a device profile")]
    IsScene,
    /// The file is not TOML.
    #[error("not TOML: {message}")]
    Syntax {
        /// The parser's words.
        message: String,
        /// What to do about it, where the place of the error shows what was meant.
        hint: Option<&'static str>,
    },
    /// No `version` key.
    #[error("missing; this program reads version {supported}")]
    VersionMissing {
        /// The version that this program reads.
        supported: i64,
    },
    /// Another version, or no number.
    #[error("unknown version; this program reads version {supported}")]
    VersionUnknown {
        /// The version that this program reads.
        supported: i64,
    },
    /// A key that the table does not have.
    #[error("unknown key{}", did_you_mean(.nearest))]
    UnknownKey {
        /// The known key that looks most like it.
        nearest: Option<String>,
        /// All keys of the table.
        known: Vec<String>,
    },
    /// A value of another type.
    #[error("must be {expected}")]
    WrongType {
        /// What would be accepted.
        expected: String,
    },
    /// A table that there is once, written as an array of tables.
    #[error("is one table: write [{table}], once, in place of [[{table}]]")]
    Repeated {
        /// Its name.
        table: String,
    },
    /// A word that is none of those accepted.
    #[error("must be {}{}", any_of(.known), did_you_mean(.nearest))]
    UnknownWord {
        /// The known word that looks most like it.
        nearest: Option<String>,
        /// All words accepted.
        known: Vec<String>,
    },
    /// A key that must be given.
    #[error("missing; give {accepted}")]
    Missing {
        /// What would be accepted.
        accepted: String,
    },
    /// A value out of its range, not finite, or otherwise impossible.
    #[error("must be {accepted}")]
    NotAccepted {
        /// What would be accepted.
        accepted: String,
    },
    /// A known answer that the rest of the file does not give.
    #[error("{found}")]
    Disagrees {
        /// What the rest of the file gives, and what may be wrong.
        found: String,
    },
    /// A key or value of a later version.
    #[error("not available in this version; {accepted}")]
    NotAvailable {
        /// What this version accepts.
        accepted: String,
    },
    /// A key that an earlier version had, with another value than the one that holds now.
    #[error("is no longer a key; {instead}")]
    Gone {
        /// What holds now, or what to write instead.
        instead: &'static str,
    },
    /// A file that is named but is not there.
    #[error("no such file: {}", shown(.path))]
    FileMissing {
        /// The path as looked up.
        path: PathBuf,
    },
    /// A folder or device where a file must be.
    #[error("not a file: {}", shown(.path))]
    NotAFile {
        /// The path as looked up.
        path: PathBuf,
    },
    /// Two keys that exclude each other.
    #[error("cannot stand beside {other}; give exactly one of the two")]
    Exclusive {
        /// The key that it excludes.
        other: String,
    },
    /// A name that was given before.
    #[error(
        "this name was given before, in line {first_line}; names of static objects must differ"
    )]
    DuplicateName {
        /// Line of the first use.
        first_line: usize,
    },
    /// No profile of that name.
    #[error("no device profile of this name{}", did_you_mean(.nearest))]
    UnknownProfile {
        /// The known profile that looks most like it.
        nearest: Option<String>,
        /// All shipped profiles.
        known: Vec<String>,
    },
    /// A stiffness that the arm cannot render stably.
    #[error("the arm would feel {felt} {felt_unit}, above its stability bound of {} {felt_unit} = \
        {rule}", show(*.bound))]
    StiffnessAboveBound {
        /// Stiffness that the arm would feel, SI, `scale` included.
        felt: f64,
        /// Unit of `felt` and of the bound.
        felt_unit: &'static str,
        /// The largest stiffness that the arm may feel.
        bound: f64,
        /// The rule that gives it, with its numbers.
        rule: String,
        /// The largest value that this key accepts, in the unit of the key.
        accepted: f64,
        /// Unit of the key.
        unit: &'static str,
    },
    /// A value that the part of the program that it is for refuses, in the words of that part.
    #[error("{why}")]
    Refused {
        /// What is wrong with it.
        why: String,
        /// What to do about it.
        hint: Option<String>,
    },
    /// More felt damping than the profile allows.
    #[error("must be from 0 to {} {unit}: the arm's profile takes {declared} at most, and it feels \
        this times scale", show(*.accepted))]
    DampingAboveProfile {
        /// The largest value that this key accepts.
        accepted: f64,
        /// What the profile declares.
        declared: f64,
        /// Unit of both.
        unit: &'static str,
    },
}

impl ProblemKind {
    /// What another part of the program says of a value, without a hint.
    pub fn refused(why: impl fmt::Display) -> Self {
        Self::Refused { why: why.to_string(), hint: None }
    }
}

/// The known word nearest to `word`, if any is near enough to be meant.
pub fn nearest<'k>(word: &str, known: impl IntoIterator<Item = &'k str>) -> Option<String> {
    // 0.7 lets through one wrong letter in a short word and a forgotten unit suffix, but not words
    // that only share an ending.
    let word = word.to_lowercase();
    let scored = known.into_iter().map(|candidate| {
        // A name without its prefix or suffix (`ideal`, `stiffness`) is meant as that name.
        let is_part: f64 = if word.len() >= 4 && candidate.contains(&word) { 0.8 } else { 0.0 };
        let similar = strsim::jaro_winkler(&word, candidate)
            .max(strsim::normalized_damerau_levenshtein(&word, candidate))
            .max(is_part);
        (similar, candidate)
    });
    scored
        .filter(|(similar, _)| *similar >= 0.7)
        .max_by(|(a, _), (b, _)| a.total_cmp(b))
        .map(|(_, candidate)| candidate.to_owned())
}

/// `"a", "b" or "c"`.
pub fn any_of(words: &[impl AsRef<str>]) -> String {
    let quoted: Vec<String> = words.iter().map(|word| format!("\"{}\"", word.as_ref())).collect();
    match quoted.split_last() {
        Some((last, rest)) if !rest.is_empty() => format!("{} or {last}", rest.join(", ")),
        Some((last, _)) => last.clone(),
        None => String::new(),
    }
}

/// `; did you mean `…`?`, or nothing where no name is near.
pub fn did_you_mean(nearest: &Option<String>) -> String {
    nearest.as_ref().map(|nearest| format!("; did you mean `{nearest}`?")).unwrap_or_default()
}

/// A computed number for a reader: at most six significant digits, so that rounding noise does not
/// show.
pub fn show(number: f64) -> f64 {
    format!("{number:.5e}").parse().unwrap_or(number)
}

/// At most four significant digits and never above the number, so that what a hint proposes is
/// accepted.
pub fn round_down(number: f64) -> f64 {
    if !number.is_normal() {
        return number;
    }
    let digits = 3 - number.abs().log10().floor() as i32;
    let factor = 10f64.powi(digits);
    // The nudge keeps 3.9999999999999996 from becoming 3.999.
    ((number * factor * (1.0 + 1e-12)).floor() / factor).min(show(number))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_word_is_one_that_could_be_meant() {
        let known = ["voxel_size_mm", "layers", "units"];
        assert_eq!(nearest("voxelsize_mm", known).as_deref(), Some("voxel_size_mm"));
        assert_eq!(nearest("unit", known).as_deref(), Some("units"));
        assert_eq!(nearest("voxel_size", known).as_deref(), Some("voxel_size_mm"));
        assert_eq!(nearest("colour", known), None);
    }

    #[test]
    fn a_proposed_value_is_never_above_the_bound() {
        assert_eq!(round_down(4.0), 4.0);
        assert_eq!(round_down(3.999_999_999_999_999_6), 4.0);
        assert_eq!(round_down(1.425_519), 1.425);
        assert_eq!(round_down(0.3), 0.3);
    }
}
