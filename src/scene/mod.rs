//! The one door between the cold rooms and the hot ones: a checked scene in, everything baked, or taken from the bake cache, out.
//!
//! Data in: a [`SceneConfig`](crate::config::SceneConfig). Data out: one immutable [`RenderScene`](haptics::RenderScene) with
//! all memory allocated and touched, and a report on each object. [`build()`] bakes, [`build_with`] asks the [`cache`] first; the
//! [front page](crate) of the crate has an example.
//!
//! Invariant: nothing that the tick reads is created or changed after this room.

mod build;
pub mod cache;
mod loaded_clay;
mod object;
mod report;

pub use build::{Built, Event, build, build_all, build_with};
pub use loaded_clay::{BorderReport, ClayReport, LoadedClay};
pub use object::{BakeMeans, Geometry, MemoryPlan, SceneError};
pub use report::{CacheUse, LeakReport, LidsReport, ObjectReport, Role, Timings};
