//! The hot room: what happens in one millisecond.
//!
//! Data in: an immutable [`RenderScene`] and one [`TickInput`]. Data out: one [`TickOutput`]. [`tick`] is pure and total: same
//! inputs, same bits; no I/O, no allocation, no lock, no panic. What a scene sets of it is in [`Parameters`], what changes from tick to
//! tick in [`State`]. [`contact`] answers single questions (what touches at this pose, and how hard) without a tick.
//!
//! The [front page](crate) of the crate has an example of each.
//!
//! Invariant: uses only `spatial`, `voxmap::field` and `pointshell::{shell, tree}` (a test reads the `use` lines).
#![deny(clippy::disallowed_methods, clippy::disallowed_macros, clippy::disallowed_types)]
#![deny(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::indexing_slicing)]

mod auto_limit;
mod braking;
pub mod clay;
mod constraint;
mod contact_damping;
mod coupling;
mod damper;
mod drive;
mod faults;
pub mod filter;
mod friction;
mod indexing;
mod interlock;
mod limits;
mod live_parameters;
mod off_cause;
mod packets;
mod params;
mod passivity;
mod passivity_control;
mod placing;
mod power_window;
mod quasi_static;
mod render_scene;
mod sample;
mod scene_builder;
pub mod stability;
pub mod stuck;
#[cfg(any(test, feature = "testing"))]
#[doc(hidden)]
pub mod testing;
mod tick;
mod virtual_tool;

pub use coupling::Inertia;
pub use drive::{Drive, DriveRequest};
pub use faults::Faults;
pub use indexing::Indexing;
pub use live_parameters::{LiveParameter, ParameterChange, ParameterRange};
pub use off_cause::OffCause;
pub use params::{
    ArmParameters, ContactParameters, CouplingMode, CouplingParameters, DeviceMapping, FilterParameters, FreeSpace,
    FrictionParameters, LimitParameters, Parameters, SafetyParameters, SpringClamp,
};
pub use placing::Placement;
pub use render_scene::{RenderScene, Tool};
pub use scene_builder::{SceneBuilder, ToolOptions};
pub use tick::{FrameInUse, Handover, State, TickInput, TickOutput, tick};
