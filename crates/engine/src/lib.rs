//! The loop around an arm: the part of the program that can hurt a person, alone.
//!
//! ```text
//!  RenderScene ─┐                      ┌─► ring of TickRecords ─► drain ─► subscribers
//!  open arm ────┼─► Supervisor ─► servo: wait ─► read ─► tick ─► write
//!  clock ───────┘        ▲             ▲  ▲
//!               Enable ──┘             │  └── CommandQueue ◄── SceneControls (parameters, poses, scenes)
//!  off: everything that holds the Control ──┘
//! ```
//! Data in: a [`RenderScene`](haptics::RenderScene), an open arm ([`arms::Device`]), a clock. Data
//! out: one [`TickRecord`](record::TickRecord) a tick, [notices](supervisor::Notice) of what changes, and a
//! [report](servo::LoopReport) at the end.
//!
//! The crate knows no network, no file, no format, and none of the programs that bake or deform
//! what it renders. What takes force away is one atomic operation on the
//! [`Control`](rt::control::Control), and waits for nothing before it.
//!
//! # Units and frames
//! SI; the frames of [`vps::spatial`].
//!
//! # Cost
//! From the first tick on, the servo thread does not allocate, lock or print.
//!
//! # Example
//! `examples/arm.rs` is a whole loop on a simulated or a real arm.
//!
//! # Where to find what
//!
//! | module | owns |
//! |---|---|
//! | [`arm_rules`] | what an arm is held to: stiffness bounds, limits, gates and rules at their defaults |
//! | [`servo`] | the 1 kHz loop and its thread; commands into it; zero force on every way out |
//! | [`drive_watchdog`] | force goes off when a client that drives falls silent or is lost |
//! | [`supervisor`] | a run from the first tick to rest: preflight, enabling, faults, stop |
//! | [`record`] | what leaves the loop: records, the ticks before a fault, subscribers |
#![forbid(unsafe_code)]

pub mod arm_rules;
pub mod drive_watchdog;
pub mod record;
pub mod servo;
pub mod supervisor;
