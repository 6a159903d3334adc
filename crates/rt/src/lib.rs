//! The operating system: every libc call of the program, and everything about time.
//!
//! Data in: what the scene asks for (a processor, a priority). Data out: what was obtained, as data; nothing here prints.
//!
//! Invariant: outside the byte transports of `device`, only the files of this room hold `unsafe`; each of them opens with a
//! reason.
//!
//! | file | owns |
//! |---|---|
//! | [`clock`] | `CLOCK_MONOTONIC`, absolute sleep; real and virtual time behind one trait |
//! | [`schedule`] | policy, priority, processor, memory lock, stack prefault of one thread |
//! | [`preflight`] | what the machine offers, row by row, with hints |
//! | [`control`] | the control word of a loop: whether force may flow, whether it is to end |
//! | [`signals`] | what each signal does to that word; what SIGHUP means |
//! | [`duration`] | durations as people write them |
//! | [`finding`] | what was found, and what to type |
//! | [`machine`] | kernel, clock, processors, rights |
//! | [`process`] | memory that two processes share, and how one of them stands apart |
//! | [`utc`] | the time of day as text |
//! | [`wakeup`] | how late the machine wakes a loop |

pub mod clock;
pub mod control;
#[cfg(test)]
mod control_tests;
pub mod duration;
pub mod finding;
pub mod machine;
pub mod preflight;
pub mod process;
pub mod schedule;
pub mod signals;
pub mod utc;
pub mod wakeup;

/// What [`control`] is made of; `tests/loom` puts a model checker's in its place.
mod atomics {
    pub(super) use core::sync::atomic::{AtomicU8, AtomicU64, Ordering};
}
