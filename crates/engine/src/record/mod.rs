//! What leaves the loop: a record of every tick, through a wait-free ring to a thread of its own.
//!
//! The loop pays one copy of a record into the ring and one into the [`FlightRecorder`]. A full ring
//! drops records and counts them, and never delays the loop.

mod drain;
mod flight;
mod subscribers;
mod tick_record;

pub use drain::{Watch, drain};
pub use flight::FlightRecorder;
pub use subscribers::{RecordSubscribers, Subscriber};
pub use tick_record::TickRecord;
