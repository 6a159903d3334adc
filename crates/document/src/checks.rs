//! What the third pass of a scene and the one of a profile share: ranges, words for them, and a
//! place where problems gather.

use std::fmt;
use std::path::{Path, PathBuf};

use glam::{DQuat, DVec3};

use super::problem::{ConfigErrors, Problem, ProblemKind, show};
use super::toml::{Document, PROBLEMS_MAX};
use super::values::Numbers;

/// Numbers that a key accepts. Nothing that is not finite is in any interval.
#[derive(Clone, Copy, Debug)]
pub struct Interval {
    low: f64,
    is_low_open: bool,
    high: f64,
    unit: &'static str,
}

impl Interval {
    /// Greater than `low`.
    pub const fn above(low: f64) -> Self {
        Self { low, is_low_open: true, high: f64::MAX, unit: "" }
    }

    /// `low` or more.
    pub const fn from(low: f64) -> Self {
        Self { low, is_low_open: false, high: f64::MAX, unit: "" }
    }

    /// At most `high`.
    pub const fn to(self, high: f64) -> Self {
        Self { high, ..self }
    }

    /// For the message only.
    pub const fn unit(self, unit: &'static str) -> Self {
        Self { unit, ..self }
    }

    fn contains(&self, number: f64) -> bool {
        number.is_finite()
            && number <= self.high
            && (number > self.low || number == self.low && !self.is_low_open)
    }
}

impl fmt::Display for Interval {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { low, is_low_open, high, unit } = *self;
        let space = if unit.is_empty() { "" } else { " " };
        match (is_low_open, high < f64::MAX) {
            (_, false) if low <= f64::MIN => write!(f, "finite"),
            (true, false) => write!(f, "finite and greater than {low}{space}{unit}"),
            (false, false) => write!(f, "finite and {low}{space}{unit} or more"),
            (true, true) => write!(f, "greater than {low} and at most {high}{space}{unit}"),
            (false, true) => write!(f, "from {low} to {high}{space}{unit}"),
        }
    }
}

/// Collects the problems of one pass over one document.
///
/// A check gives a usable value in any case, so that the pass goes on and later checks do not
/// follow from earlier ones.
pub struct Checks<'d> {
    document: &'d Document<'d>,
    problems: Vec<Problem>,
    /// Files that the document names.
    files: Vec<PathBuf>,
}

impl<'d> Checks<'d> {
    /// No problems yet of this document.
    pub fn new(document: &'d Document<'d>) -> Self {
        Self { document, problems: Vec::new(), files: Vec::new() }
    }

    /// The files that the document names, in the order in which they were looked for.
    pub fn files(&self) -> &[PathBuf] {
        &self.files
    }

    /// Notes a problem at a key.
    pub fn refuse(&mut self, key: &str, kind: ProblemKind) {
        if self.problems.len() < PROBLEMS_MAX {
            self.problems.push(self.document.problem(key, kind));
        }
    }

    /// Notes a problem with a value that the command line gives instead of the file, when there is
    /// one.
    pub fn refuse_as(&mut self, key: &str, given: Option<&str>, kind: ProblemKind) {
        let mut problem = self.document.problem(key, kind);
        if let Some(given) = given {
            problem.line = None;
            problem.value = Some(format!("\"{given}\""));
        }
        self.problems.push(problem);
    }

    /// Notes a value that is out of what the key accepts.
    pub fn not_accepted(&mut self, key: &str, accepted: impl fmt::Display) {
        self.refuse(key, ProblemKind::NotAccepted { accepted: accepted.to_string() });
    }

    /// True while nothing was found wrong: what rests on everything else may be judged.
    pub fn is_clean(&self) -> bool {
        self.problems.is_empty()
    }

    /// How many problems were found so far.
    pub fn count(&self) -> usize {
        self.problems.len()
    }

    /// Notes a key that must be given.
    pub fn missing(&mut self, key: &str, accepted: impl fmt::Display) {
        self.refuse(key, ProblemKind::Missing { accepted: accepted.to_string() });
    }

    /// What is written at a key that must be given; notes it where it is not.
    pub fn given<T>(
        &mut self,
        key: &str,
        written: Option<T>,
        accepted: impl fmt::Display,
    ) -> Option<T> {
        if written.is_none() {
            self.missing(key, accepted);
        }
        written
    }

    /// Notes a key or value of a later version.
    pub fn not_available(&mut self, key: &str, accepted: impl Into<String>) {
        self.refuse(key, ProblemKind::NotAvailable { accepted: accepted.into() });
    }

    /// Takes over problems of another file.
    pub fn append(&mut self, errors: ConfigErrors) {
        self.problems.extend(errors.into_problems());
    }

    /// A number that must be given; NaN after a problem.
    pub fn required(&mut self, key: &str, written: Option<f64>, interval: Interval) -> f64 {
        match written {
            None => {
                self.missing(key, format_args!("a number: {interval}"));
                f64::NAN
            }
            Some(number) => self.number(key, Some(number), f64::NAN, interval),
        }
    }

    /// A number with a default, which is given after a problem as well.
    pub fn number(
        &mut self,
        key: &str,
        written: Option<f64>,
        default: f64,
        interval: Interval,
    ) -> f64 {
        self.optional(key, written, interval).unwrap_or(default)
    }

    /// A number that may be left out; `None` after a problem as well.
    pub fn optional(&mut self, key: &str, written: Option<f64>, interval: Interval) -> Option<f64> {
        let number = written?;
        if interval.contains(number) {
            return Some(number);
        }
        self.not_accepted(key, interval);
        None
    }

    /// A number with a default that a rule of safety rests on: beyond its range the rule would hold
    /// nothing back. `from`: where the range comes from.
    pub fn rule(
        &mut self,
        key: &str,
        written: Option<f64>,
        default: f64,
        interval: Interval,
        from: &str,
    ) -> f64 {
        match written {
            Some(number) if !interval.contains(number) => {
                self.not_accepted(
                    key,
                    format_args!(
                        "{interval} ({from}): beyond that the rule would hold nothing back"
                    ),
                );
                default
            }
            written => written.unwrap_or(default),
        }
    }

    /// A whole number with a default.
    pub fn whole(
        &mut self,
        key: &str,
        written: Option<u32>,
        default: u32,
        low: u32,
        high: u32,
    ) -> u32 {
        match written {
            Some(number) if !(low..=high).contains(&number) => {
                self.not_accepted(key, format_args!("a whole number from {low} to {high}"));
                default
            }
            written => written.unwrap_or(default),
        }
    }

    /// Numbers of an array; each outside of the interval is a problem of its own. `None` when left
    /// out or after a problem.
    pub fn array<const N: usize>(
        &mut self,
        key: &str,
        written: Option<Numbers<N>>,
        interval: Interval,
    ) -> Option<[f64; N]> {
        let Numbers(numbers) = written?;
        let mut is_sound = true;
        for (index, number) in numbers.iter().enumerate() {
            if !interval.contains(*number) {
                self.not_accepted(&format!("{key}[{index}]"), interval);
                is_sound = false;
            }
        }
        is_sound.then_some(numbers)
    }

    /// A position, default the origin, in the unit of the key.
    pub fn position(&mut self, key: &str, written: Option<Numbers<3>>) -> DVec3 {
        self.array(key, written, FINITE).map_or(DVec3::ZERO, DVec3::from_array)
    }

    /// A quaternion x y z w, default the identity. Rounding in the file is normalised away; more is
    /// refused.
    pub fn orientation(&mut self, key: &str, written: Option<Numbers<4>>) -> DQuat {
        let Some(numbers) = self.array(key, written, FINITE) else { return DQuat::IDENTITY };
        let quaternion = DQuat::from_array(numbers);
        let length = quaternion.length();
        if (length - 1.0).abs() <= 1e-3 {
            return quaternion.normalize();
        }
        let length = show(length);
        self.not_accepted(
            key,
            format_args!(
                "a unit quaternion [x, y, z, w]; its length is {length}, which may be off \
                1 by at most 0.001"
            ),
        );
        DQuat::IDENTITY
    }

    /// A file named in a document of folder `dir`; `None` after a problem.
    pub fn file(&mut self, key: &str, written: &str, dir: &Path) -> Option<PathBuf> {
        let path = dir.join(written);
        if path.is_file() {
            self.files.push(path.clone());
            return Some(path);
        }
        let kind = if path.exists() {
            ProblemKind::NotAFile { path }
        } else {
            ProblemKind::FileMissing { path }
        };
        self.refuse(key, kind);
        None
    }

    /// All problems, if any.
    ///
    /// # Errors
    /// All problems, where there is one.
    pub fn finish(self) -> Result<(), ConfigErrors> {
        if self.problems.is_empty() { Ok(()) } else { Err(ConfigErrors::new(self.problems)) }
    }
}

/// Every finite number.
pub const FINITE: Interval = Interval::from(f64::MIN);

/// 0 or more.
pub const NOT_NEGATIVE: Interval = Interval::from(0.0);

/// Greater than 0.
pub const POSITIVE: Interval = Interval::above(0.0);
