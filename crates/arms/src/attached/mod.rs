//! Arms on this machine: which are there, how one is opened, what it does and what it is made of.
//!
//! | file | owns |
//! |---|---|
//! | [`nodes`] | hidraw nodes and serial ports of this machine, and which of them is an arm |
//! | [`discover`] | the arms that are attached, and what stands in their way |
//! | [`libraries`] | libraries and services of arms' makers, and what stands in their way |
//! | [`open`] | from a profile to an open arm, and back to it when it is lost |
//! | [`probe`] | whether an arm answers, how evenly, whether its signs fit |
//! | [`identify`] | what it is made of, from how it moves under known forces |

pub mod discover;
pub mod identify;
pub mod libraries;
pub mod nodes;
pub mod open;
pub mod probe;
