//! The operating system of a real-time loop: clocks, scheduling, signals, and the word that says
//! whether force may flow.
//!
//! ```text
//!  signals, clients, watchdogs ─► control word ─► loop        what the scene asks for (processor, priority) ─► schedule ─► what was obtained
//!                                 control           ▲                                    the machine ─► preflight ─► findings, and what to type
//!                                                   └─ clock: absolute sleep
//! ```
//!
//! # Units and frames
//! Nanoseconds of `CLOCK_MONOTONIC` and `CLOCK_BOOTTIME` in the loop, [`Duration`](core::time::Duration) elsewhere.
//!
//! # Cost
//! Reading the control word is three atomic loads, and a sleep is one system call. Everything else
//! runs before the loop or beside it. Nothing here prints: results are data.
//!
//! # Example
//! ```
//! use rt::control::{Control, Order};
//!
//! let control = Control::new();
//! let permit = control.permit();
//! control.enable(permit);
//! assert_eq!(control.order(), Order::Enable);
//! control.disable(); // a signal, a client, a heartbeat that is missing
//! control.enable(permit);
//! assert_eq!(control.order(), Order::Disable, "a permit drawn before is worthless");
//! ```
//!
//! # Where to find what
//!
//! | module | owns |
//! |---|---|
//! | [`control`] | the control word of a loop: whether force may flow, whether it is to end |
//! | [`clock`] | `CLOCK_MONOTONIC`, absolute sleep; real and virtual time behind one trait |
//! | [`realtime`] | the one entrance of a loop that commands an arm into real time |
//! | [`schedule`] | policy, priority, processor, memory lock, stack prefault of one thread |
//! | [`signals`] | what each signal does to the control word; what SIGHUP means |
//! | [`preflight`], [`machine`], [`finding`] | what the machine offers and lacks, row by row, and what to type |
//! | [`wakeup`] | a test before the loop begins: how late the machine wakes it |
//! | [`process`] | memory that two processes share, and a session of its own for a child process |
//! | [`duration`], [`utc`] | durations and the time of day as people write them |
//!
//! Every file with `unsafe` code opens with its reason.

pub mod clock;
pub mod control;
#[cfg(test)]
mod control_tests;
pub mod duration;
pub mod finding;
pub mod machine;
pub mod preflight;
pub mod process;
pub mod realtime;
pub mod schedule;
pub mod signals;
pub mod utc;
pub mod wakeup;

/// What [`control`] is made of; `tests/loom` puts a model checker's in its place.
mod atomics {
    pub(super) use core::sync::atomic::{AtomicU8, AtomicU64, Ordering};
}
