//! Files that people write: TOML in which every entry knows its line, poses as CSV, and what is wrong with them.
//!
//! Data in: the text of a scene, a profile or a file of strokes, and types that name its keys. Data out: these types filled in, or every
//! problem of a pass with file, line, key and value. `toml` reads syntax and version, `values` are words and arrays as they are written,
//! `checks` gathers what is out of its range, `problem` says it; [`poses`] are files of their own.
//!
//! Invariant: knows the form of files, and nothing of what they are about.

mod checks;
pub mod poses;
mod problem;
mod toml;
mod values;

pub use self::toml::{Document, GoneKey};
pub use checks::{Checks, FINITE, Interval, NOT_NEGATIVE, POSITIVE};
pub use problem::{ConfigErrors, Problem, ProblemKind};
pub use problem::{PACKAGED, any_of, did_you_mean, nearest, show};
pub use values::Numbers;
