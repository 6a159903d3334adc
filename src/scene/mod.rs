//! From a checked scene to what the tick reads: every object baked, or taken from the bake cache,
//! and given to the [`SceneBuilder`](haptics::SceneBuilder).
//!
//! Data in: a [`SceneConfig`](crate::config::SceneConfig). Data out: one immutable
//! [`RenderScene`](haptics::RenderScene) with all memory allocated and touched, and a report on
//! each object. [`build()`] bakes, [`build_with`] asks the [`cache`] first; the [front page](crate)
//! of the crate has an example.
//!
//! Invariant: nothing that the tick reads is created or changed after this module.

mod build;
pub mod cache;
mod loaded_clay;
mod object;
mod unit;

pub(crate) use build::requests;
pub use build::{BakeEvent, Borders, Built, build, build_all, build_with, look_at_parts};
pub use loaded_clay::{BorderReport, ClayError, ClayReport, LoadedClay, look_at_clay};
pub use object::{BakeOptions, MemoryPlan, SceneError, load, smallest_overlap_m};
pub use unit::doubted_unit;
pub use vps::part::{CacheUse, ObjectReport, PartRole};
