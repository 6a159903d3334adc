//! One millisecond of haptic rendering: from the pose of an arm to the wrench that its motors make.
//!
//! [`tick`] is pure and total: same inputs, same bits; no I/O, no allocation, no lock, no panic. A
//! [`SceneBuilder`] makes its immutable [`RenderScene`] before the first tick; [`State`] holds all
//! that changes from tick to tick.
//!
//! ```text
//!  TickInput ─► sample check ─► indexing ─► contact sum ─► friction, damping ─► shaping filter ─► coupling ─► passivity ─► output stage ─► TickOutput
//!  (sample,     sample, stuck,  indexing    vps::contact   friction,            filter            coupling…   passivity…   ramp, power,    (command,
//!   request)    packets                                    contact_damping                                                 slew, magnitude, faults)
//!                                                                                                                          finite check
//!                     └────────────────────────── interlock, drive: may force flow? ───────────────────────────────────────┘
//! ```
//!
//! # Units and frames
//! SI. A sample and a command are in device axes at the grip; everything between is in world axes
//! at the tool's centre of mass. Forces are not scaled when positions are.
//!
//! # Cost
//! A tick costs its contact query and some microseconds; the budget of points (`TickInput`) bounds
//! it. [`SceneBuilder`] bakes and is not for the loop.
//!
//! # Example
//! ```
//! use glam::DVec3;
//! use haptics::{Parameters, SceneBuilder, State, TickInput, ToolOptions, tick};
//! use vps::{mesh::primitives::Shape, part::Part, spatial::Pose, voxmap::Options};
//!
//! let (size_m, radius_m, voxels) = (DVec3::splat(40e-3), 10e-3, Options::new(1e-3));
//! let mut builder = SceneBuilder::new(Parameters::unlimited(1e-3)); // for an arm: `limits` of what it may do
//! builder.add_part(&Part::of_shape("block", &Shape::Box { size_m }, 1e-3), &voxels, Pose::from_translation(DVec3::Z * -29.5e-3))?;
//! let (scene, _reports) = builder.finish(&Part::of_shape("ball", &Shape::Sphere { radius_m }, 1e-3), &voxels, &ToolOptions::new(0.1))?;
//! let output = tick(&scene, &mut State::new(&scene), &TickInput::default());
//! assert!(output.contacts > 0, "the ball starts half a millimetre inside the block");
//! # Ok::<(), vps::part::PartError>(())
//! ```
//!
//! # Where to find what
//!
//! | module | owns |
//! |---|---|
//! | `scene_builder`, `render_scene`, `params` | a scene from typed values; what the tick reads; everything that a scene can set |
//! | `tick` | the one step, and the order of all that follows |
//! | `sample`, `stuck`, `packets` | whether a sample of the arm may be rendered |
//! | `interlock`, `drive`, `off_cause`, [`Faults`] | whether force may flow, and why it does not |
//! | `encoder_hold`, `indexing` | a pose that trembles by one encoder step; device coordinates ↔ world coordinates |
//! | `virtual_tool` | what touches the tool, and how it follows the arm in each coupling |
//! | `coupling`, `constraint` | the couplings: with mass, on the surface |
//! | `friction` | Coulomb friction, by face of the tool |
//! | `contact_damping`, `braking` | damping in contact and just ahead of it |
//! | [`filter`] | the shaping filter of the contact wrench |
//! | [`clay`] | contact with material that deforms, and the rope |
//! | `passivity_control`, `damper` | guarantees passivity: counts the energy at the grip, and takes it out by damping; damping against the arm's own tremble |
//! | [`stability`], `auto_limit` | how stiff an arm may be made to feel |
//! | `limits`, `power_window` | the output stage: what bounds force, torque, slew and power |
//! | `moving_obstacles`, `live_parameters` | obstacles that move; parameters that change while the loop runs |
#![forbid(unsafe_code)]
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
mod encoder_hold;
mod faults;
pub mod filter;
mod friction;
mod indexing;
mod interlock;
mod limits;
mod live_parameters;
mod moving_obstacles;
mod off_cause;
mod packets;
mod params;
mod passivity_control;
mod power_window;
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

/// Number of the force law: it counts up with every change after which a tick gives other bits for
/// the same scene, state and input. Recordings bear it, as one of another law cannot be compared
/// bit for bit. Version 0.1.0 wrote no number: its law is the first.
pub const FORCE_LAW: u32 = 8;

pub use coupling::Inertia;
pub use drive::{Drive, DriveRequest};
pub use faults::Faults;
pub use indexing::Indexing;
pub use live_parameters::{LiveParameter, ParameterChange, ParameterRange};
pub use moving_obstacles::Placement;
pub use off_cause::OffCause;
pub use params::{
    ArmParameters, ContactParameters, CouplingMode, CouplingParameters, DeviceMapping,
    FilterParameters, FreeSpace, FrictionParameters, LimitParameters, Parameters, SafetyParameters,
    SpringClamp,
};
pub use render_scene::{RenderScene, Tool};
pub use scene_builder::{SceneBuilder, ToolOptions};
pub use tick::{FrameInUse, Handover, State, TickInput, TickOutput, tick};
