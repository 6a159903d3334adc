//! Haptic arms: everything between a wrench and a motor.
//!
//! A profile describes the hardware as data; a [`Device`] reads the pose of its grip and takes a
//! wrench. A driver knows nothing of scenes or contact.
//!
//! ```text
//!  Device::read ◄── kinematics ◄── transmission ◄─────────────┐
//!  (DeviceSample)   velocity                                  ├── protocol ◄─► transport ◄─► arm
//!  Device::write ─► kinematics ─► transmission ─► motor_stage ┘   (codec)      (bytes)
//!  (Wrench)                                      caps, slew, power        guard: zero force if this process dies
//! ```
//!
//! # Units and frames
//! SI in device axes; the pose is `device_from_grip`, the wrench acts at the grip point. Angles of
//! joints are radians, torques N·m.
//!
//! # Cost
//! Everything behind [`Device::read`], [`Device::write`] and [`Device::stop`] is bounded, does not
//! block and does not allocate; transports that block have threads of their own.
//!
//! # Example
//! ```
//! use arms::Device;
//! use arms::simulated::{SimArm, SimParameters};
//! # use glam::DVec3;
//! # use vps::spatial::Wrench;
//!
//! // A grip without a hand, pushed with 1 N for a tenth of a second.
//! let mut arm = SimArm::new(SimParameters { hand: None, ..SimParameters::ideal(1e-3) })?;
//! for _ in 0..100 {
//!     arm.write(&Wrench::new(DVec3::X, DVec3::ZERO))?;
//!     arm.read()?;
//! }
//! assert!(arm.read()?.pose.translation.x > 0.0);
//! arm.stop();
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Where to find what
//!
//! | module | owns |
//! |---|---|
//! | `driver` | the [`Device`] trait, [`Capabilities`], errors |
//! | [`profile`] | hardware as data: reading, checks, the embedded profiles |
//! | [`protocol`] | what bytes mean, the host's and the arm's side: one file for each protocol, and a new one goes here |
//! | [`transport`] | how bytes travel: serial, HID, USB, datagrams |
//! | `wired` | the driver of every arm on a wire, which joins these; round trips, temperatures |
//! | `kinematics`, `transmission`, `velocity` | joint angles ↔ pose and torques; readings ↔ joint angles; how fast the grip is |
//! | `motor_stage`, `parameters`, `thermal` | the last bounds before a motor: caps of torque, slew, power; what they rest on; heat of the motors |
//! | [`guard`] | the process that takes the force away when this one dies or stands still |
//! | [`attached`] | arms on this machine: found, opened, probed, identified |
//! | [`simulated`], [`mock`] | the simulated arm (plant, hand, encoder, faults); the same behind a real link |
//! | `split_mix` | chance for simulated arms and networks |
//! | [`vendor`] | arms behind a library of their maker: a worker process, its two ends, one file for each maker |
//! | [`remote`] | an arm on another machine: both ends, force between commands, clocks |
//!
//! Tests that every arm passes are in `crates/arms-testing`.

pub mod attached;
mod axes;
mod driver;
pub mod guard;
#[doc(hidden)]
pub mod inspection;
mod kinematics;
pub mod mock;
mod motor_stage;
mod parameters;
pub mod profile;
pub mod protocol;
pub mod remote;
pub mod simulated;
mod split_mix;
mod thermal;
mod transmission;
pub mod transport;
mod velocity;
pub mod vendor;
mod wired;

pub use driver::{Capabilities, Device, DeviceError, IoPlacement, Pacing};
pub use motor_stage::POWER_MAX_W;
pub use parameters::Timebase;
use parameters::WiredParameters;
use thermal::Thermal;
pub use wired::WiredArm;
use wired::{Connection, Replacements, judge_declared, lower};
