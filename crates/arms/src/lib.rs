//! Arms: what the servo sees of them, and everything between it and their motors.
//!
//! Data in: a wrench in device axes, reduced at the grip point. Data out: the newest [`DeviceSample`] of the grip.
//!
//! Invariant: never uses `haptics`; a driver knows nothing of scenes. Invariant: everything behind [`Device::read`],
//! [`Device::write`] and [`Device::stop`] is bounded, does not block and does not allocate.
//!
//! | file | owns |
//! |---|---|
//! | `driver` | the [`Device`] trait, [`Capabilities`], edge errors |
//! | [`profile`] | hardware as data |
//! | [`attached`] | arms on this machine: found, opened, probed, identified |
//! | `wired` | the driver of every arm on a wire, which joins the next four; how far away it is, how hot its motors |
//! | [`guard`] | the process that takes the force away when this one dies or stands still |
//! | [`transport`] | how bytes travel |
//! | [`protocol`] | what they mean, both sides |
//! | `motor_stage` | the one place between a wrench and a codec: caps, slew, power, what is beside the wrench |
//! | `transmission` | readings into joint angles, joint torques into motor commands |
//! | `kinematics` | joint angles into a pose, a wrench into joint torques |
//! | `velocity` | how fast the grip is |
//! | [`simulated`] | the simulated arm: a plant, a hand, an encoder, faults |
//! | [`mock`] | the same behind a real link |
//! | [`remote`] | an arm on another machine: both ends, force between commands, clocks |
//! | `conformance` | tests that every arm passes |
//!
//! # Example
//! ```
//! use glam::DVec3;
//! use arms::Device;
//! use arms::simulated::{SimArm, SimParameters};
//! use vps::spatial::Wrench;
//!
//! // A grip that nobody holds, pushed with 1 N for a tenth of a second.
//! let mut arm = SimArm::new(SimParameters { hand: None, ..SimParameters::ideal(1e-3) })?;
//! let start = arm.read()?;
//! for _ in 0..100 {
//!     arm.write(&Wrench::new(DVec3::X, DVec3::ZERO))?;
//!     arm.read()?;
//! }
//! let moved = arm.read()?.pose.translation - start.pose.translation;
//! assert!(moved.x > 0.0 && moved.y == 0.0);
//! arm.stop();
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! [`DeviceSample`]: vps::spatial::DeviceSample

pub mod attached;
#[cfg(test)]
mod conformance;
mod driver;
pub mod guard;
mod kinematics;
pub mod mock;
mod motor_stage;
pub mod profile;
pub mod protocol;
pub mod remote;
pub mod simulated;
#[cfg(any(test, feature = "testing"))]
#[doc(hidden)]
pub mod testing;
mod transmission;
pub mod transport;
mod velocity;
mod wired;

pub use driver::{Capabilities, Device, DeviceError, IoPlacement, Pacing};
pub use motor_stage::POWER_MAX_W;
use wired::{Connection, Replacements, Thermal, WiredParameters};
pub use wired::{Timebase, WiredArm};
