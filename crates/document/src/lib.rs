//! Files that people write: TOML in which every entry knows its line, poses as CSV, and what is
//! wrong with them.
//!
//! ```text
//!  text ─► Document (syntax, version, lines) ─► types of the caller ─► Checks (ranges) ─► values
//!            └──────────── ConfigErrors: file, line, key, value, what to write ◄──┘
//! ```
//!
//! The crate knows the form of files. Which keys there are, and what their values mean, its callers
//! know; the kinds of problem are a list for all callers, so that each is worded once. All problems
//! of a pass are reported at once.
//!
//! # Units and frames
//! Values stay in the units that their keys name (`_mm`, `_g`); the caller converts. Poses are
//! `world_from_tool`, m and unit quaternions, times in s.
//!
//! # Cost
//! Linear in the text; for the start of a program, not for a loop.
//!
//! # Example
//! ```
//! use document::Document;
//!
//! let document = Document::parse("scene.toml".as_ref(), "version = 1\n[tool]\nmass_g = 50.0\n")?;
//! assert_eq!((document.line("tool.mass_g"), document.has("tool")), (Some(3), true));
//! let refused = Document::parse("scene.toml".as_ref(), "version = 2\n").err();
//! assert!(refused.is_some_and(|errors| errors.problems()[0].to_string().contains("scene.toml")));
//! # Ok::<(), document::ConfigErrors>(())
//! ```
//!
//! # Where to find what
//!
//! | module | owns |
//! |---|---|
//! | `toml` | syntax, version, the line of every entry, keys that are not known |
//! | `values` | words and arrays of numbers as they are written |
//! | `checks` | what is out of its range |
//! | `problem` | how a problem is reported: file, line, key, value, remedy, the nearest word |
//! | [`poses`] | files of timed poses |
#![forbid(unsafe_code)]

mod checks;
pub mod poses;
mod problem;
mod toml;
mod values;

pub use self::toml::{Document, GoneKey};
pub use checks::{Checks, FINITE, Interval, NOT_NEGATIVE, POSITIVE};
pub use problem::{ConfigErrors, Problem, ProblemKind};
pub use problem::{PACKAGED, any_of, did_you_mean, nearest, round_down, show};
pub use values::Numbers;
