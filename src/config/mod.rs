//! Scene files: version → schema (as written) → resolved (checked, SI, typed).
//!
//! Data in: a TOML scene and device profiles. Data out: one [`SceneConfig`], or every problem of the first
//! pass that found any. `document` reads syntax and version, `schema` holds the keys, `resolve` checks
//! and converts, `scene` is the result.
//!
//! Invariant: cold, and silent: problems are returned, `cli` prints them.

pub(crate) mod checks;
pub(crate) mod document;
pub(crate) mod problem;
pub(crate) mod schema;

pub mod bound;
pub mod draft;
pub mod json_schema;
pub mod poses;
pub mod resolve;
pub mod scene;
pub mod strokes;

pub use problem::{ConfigErrors, Problem, ProblemKind};
pub use resolve::{LoadOptions, load, load_with};
pub use scene::SceneConfig;

/// The shipped `config/default.toml`: every key with its default and unit.
pub const DEFAULT_SCENE: &str = include_str!("../../config/default.toml");
