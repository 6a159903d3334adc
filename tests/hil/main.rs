//! Hardware in the loop: the program on one end of a real tty, a mock arm in a process of its own
//! on the other.
//!
//! A binary of its own, so that nothing else computes meanwhile, and one test at a time: both ends
//! want to be on time. Where the machine does not let them (no SCHED_FIFO, a busy host), a run that
//! the machine itself has spoilt is repeated; see [`link::repeat`].

mod arms;
mod deaf;
mod ends;
mod faults;
mod guard;
mod link;
mod maker;
mod open_haptics;
mod plug;
mod same_end;
mod service;
mod terminal;
mod vendor;
