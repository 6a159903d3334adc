//! Scene files: version → schema (as written) → resolved (checked, SI, typed).
//!
//! Data in: a TOML scene and device profiles. Data out: one [`SceneConfig`], or every problem of
//! the first pass that found any. [`document`] reads syntax and version, `schema` holds the keys,
//! `resolve` checks and converts, [`scene`] is the result. Beside that: [`strokes`] (scripted work
//! on clay), [`draft`] (a first scene for meshes that have none), [`json_schema`] (what editors
//! complete keys from).
//!
//! Invariant: cold, and silent: problems are returned, `cli` prints them.
//!
//! # Example
//! ```
//! # let folder = tempfile::tempdir()?;
//! # let file = folder.path().join("ball.toml");
//! std::fs::write(&file, "version = 1\n[tool]\nshape = { sphere_mm = 10.0 }\nvoxel_size = 1.0\n")?;
//! let Err(errors) = hapticd::config::load(&file) else { unreachable!("a key that is not one") };
//! let problem = &errors.problems()[0];
//! assert_eq!(problem.line, Some(4));
//! assert!(errors.to_string().contains("voxel_size_mm"), "the known key that is nearest");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod schema;

mod bound;
pub mod draft;
pub mod json_schema;
mod plausibility;
mod resolve;
pub mod scene;
pub mod setting_names;
pub mod strokes;

pub use plausibility::{plausibility_warnings, problem_at};
pub(crate) use resolve::{
    FOXGLOVE_ACCEPTED, LISTEN_ACCEPTED, RASTER_AXIS, RASTER_NODES, parse_foxglove, parse_listen,
};
pub use resolve::{LoadOptions, load, load_with};
pub use scene::SceneConfig;

pub use document::{ConfigErrors, Problem, ProblemKind};

/// The shipped `config/default.toml`: every key with its default and unit.
pub const DEFAULT_SCENE: &str = include_str!("../../config/default.toml");
