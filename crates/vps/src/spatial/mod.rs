//! Poses, twists, wrenches: the types that every other module shares.
//!
//! Invariant: a leaf. Nothing here knows of meshes, devices or threads.
//!
//! # Units and frames
//! SI only (m, kg, s, N, N·m, rad), `f64`. Frames are a closed list: `world`, `device`, `tool` (the
//! pointshell body, the tool mesh file's own frame), `map` (a voxmap body, that mesh file's own
//! frame), `cell` (integer voxel index). Two names are local to the device edge: `grip` (the handle
//! in the hand) and `native` (a codec's frame).
//! - A pose is named `to_from_from`: `world_from_tool * tool_from_grip` reads as a chain and gives
//!   `world_from_grip`.
//! - A vector ends in its frame: `force_world`.
//! - A [`Wrench`] names its frame and its reduction point where it is declared.
//!
//! # Signs
//! - Field V: negative outside, 0 on the surface, positive inside (penetration depth).
//! - Pointshell normals are unit and point **into** the moving object; a penalty force along them
//!   pushes the tool out.
//! - Rotation vectors act on the left: `R ← exp([dθ]×) R`.
//!
//! # Example
//! ```
//! use core::f64::consts::FRAC_PI_2;
//! use glam::{DQuat, DVec3};
//! use vps::spatial::{Pose, Wrench};
//!
//! // The grip is 3 cm along the tool's x; the tool was turned a quarter about z.
//! let world_from_tool = Pose::new(DQuat::from_rotation_z(FRAC_PI_2), DVec3::X * 0.1);
//! let world_from_grip = world_from_tool * Pose::from_translation(DVec3::X * 0.03);
//! assert!(world_from_grip.translation.abs_diff_eq(DVec3::new(0.1, 0.03, 0.0), 1e-12));
//!
//! // 2 N up at the grip, reduced at the origin of the tool: torque about its axis.
//! let at_grip = Wrench::new(DVec3::Z * 2.0, DVec3::ZERO);
//! let at_tool = at_grip.moved(world_from_grip.translation, world_from_tool.translation);
//! assert!(at_tool.torque.abs_diff_eq(DVec3::X * 0.06, 1e-12));
//! ```

mod axes;
mod device_sample;
mod length;
mod mat6;
mod named_pose;
mod pose;
#[cfg(any(test, feature = "testing"))]
#[doc(hidden)]
pub mod testing;
mod wrench;

pub use axes::Axes;
pub use device_sample::{DeviceSample, SampleStatus};
pub use length::{Metres, Place};
pub use mat6::Mat6;
pub use named_pose::NamedPose;
pub use pose::Pose;
pub use wrench::{Twist, Wrench};
