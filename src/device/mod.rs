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
//! | [`nodes`] | hidraw nodes and serial ports of this machine, and which of them is an arm |
//! | [`open`] | from a profile to an open arm, and back to it when it is lost |
//! | `wired` | the driver of every arm on a wire, which joins the next four |
//! | [`transport`] | how bytes travel |
//! | [`protocol`] | what they mean, both sides |
//! | [`transmission`] | readings into joint angles, joint torques into motor commands |
//! | [`kinematics`] | joint angles into a pose, a wrench into joint torques |
//! | [`velocity`], `round_trip`, `thermal` | how fast the grip is, how far away the arm, how hot its motors |
//! | [`sim`] | the simulated arm: a plant, a hand, an encoder, faults |
//! | [`mock`] | the same behind a real link |
//! | [`remote`] | an arm on another machine: both ends, force between commands, clocks |
//! | [`hand`], [`fault`], `dice` | where the simulated hand wants to be, what goes wrong, chance from a seed |
//! | [`discover`], [`probe`], [`identify`] | which arms are attached, what they do, what they are made of |
//! | `conformance` | tests that every arm passes |
//!
//! [`DeviceSample`]: crate::spatial::DeviceSample

#[cfg(test)]
mod conformance;
mod dice;
pub mod discover;
mod driver;
pub mod fault;
pub mod hand;
pub mod identify;
pub mod kinematics;
pub mod mock;
pub mod nodes;
pub mod open;
pub mod probe;
pub mod profile;
pub mod protocol;
pub mod remote;
mod round_trip;
pub mod sim;
mod thermal;
pub mod transmission;
pub mod transport;
pub mod velocity;
mod wired;

pub use driver::{Capabilities, Device, DeviceError, IoPlacement, Pacing, Wakeup};
pub use round_trip::RoundTrip;
pub use thermal::Thermal;
pub use wired::{Connection, Replacements, Timebase, WiredArm, WiredParameters};
