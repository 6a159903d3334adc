//! What is made of the records that leave a haptic loop ([`engine::record`]).
//!
//! ```text
//!  loop ─► ring of TickRecords ─► drain thread ─┬─► Summary, metrics
//!    └───► FlightRecorder (in the loop)         └─► subscribers: recorder thread ─► MCAP file ─► Recording ─► replay, report
//!                     └─► thread `fault-files` ─► MCAP file of a fault       └─► viewers (`file::live`)
//! ```
//!
//! # Units and frames
//! Those of the tick: SI; device axes at the grip, or world axes at the tool's centre of mass, as
//! each field says. Times are nanoseconds of the loop's clock.
//!
//! # Cost
//! The loop pays one copy of a record into a wait-free ring and one into the flight recorder;
//! everything else runs on normal threads. A full ring or a slow disk drops records and counts
//! them, and never delays the loop.
//!
//! # Example
//! ```
//! use recording::file::Recording;
//! use recording::report::LabReport;
//!
//! let mut recording = Recording::open("../../tests/fixtures/block-on-plane.mcap".as_ref())?;
//! let mut report = LabReport::new("block-on-plane.mcap".to_owned());
//! while let Some(entry) = recording.next_entry()? {
//!     report.take(&entry);
//! }
//! assert!(report.ticks() > 0 && report.page().contains("<svg"));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Where to find what
//!
//! | module | owns |
//! |---|---|
//! | [`mod@file`] | MCAP files: written by the thread `recorder`, read, live for the Foxglove app; files of faults |
//! | `summary`, [`metrics`] | latency histograms and extremes as JSON, as text for Prometheus |
//! | [`report`] | a page of a recording, with charts |
#![forbid(unsafe_code)]

pub mod file;
pub mod metrics;
pub mod report;
mod stamped_record;
mod summary;

pub use engine::record::{FlightRecorder, RecordSubscribers, Subscriber, TickRecord, Watch, drain};
pub use summary::{
    Histograms, LatencySummary, LoopCounts, RealtimeSummary, Rendered, SharedSummary, Summary,
    SwapSummary, Totals, at_least, summary_subscriber,
};
