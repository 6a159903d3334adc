//! Scene files: version → schema (as written) → resolved (checked, SI, typed).
//!
//! Data in: a TOML scene and device profiles. Data out: one [`SceneConfig`], or every problem of the first
//! pass that found any. [`document`](crate::document) reads syntax and version, `schema` holds the keys, `resolve` checks
//! and converts, `scene` is the result.
//!
//! Invariant: cold, and silent: problems are returned, `cli` prints them.

mod schema;

pub mod bound;
pub mod draft;
pub mod json_schema;
pub mod resolve;
pub mod scene;
pub mod strokes;

pub use resolve::{LoadOptions, load, load_with};
pub use scene::SceneConfig;

pub use crate::document::{ConfigErrors, Problem, ProblemKind};

/// The shipped `config/default.toml`: every key with its default and unit.
pub const DEFAULT_SCENE: &str = include_str!("../../config/default.toml");
