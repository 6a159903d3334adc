//! The way out of the loop: records, their ring, the flight recorder, the summary.
//!
//! Data in: one [`TickRecord`] per tick through a wait-free ring. Data out: a [`Summary`] with latency histograms, and snapshots for whoever
//! watches.
//!
//! Invariant: never calls into `servo`; everything but [`FlightRecorder::note`] runs on a normal thread.
//!
//! # Example
//! ```
//! use recording::file::Recording;
//! use recording::report::LabReport;
//!
//! let mut recording = Recording::open("tests/fixtures/block-on-plane.mcap".as_ref())?;
//! let mut report = LabReport::new("block-on-plane.mcap".to_owned());
//! while let Some(entry) = recording.next_entry()? {
//!     report.take(&entry);
//! }
//! assert!(report.ticks() > 0 && report.page().contains("<svg"));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod drain;
pub mod file;
mod flight;
pub mod metrics;
mod record;
pub mod report;
mod summary;
mod taps;

pub use drain::{Drained, Watch, drain};
pub use flight::FlightRecorder;
pub use record::TickRecord;
pub use summary::{Counted, Histograms, LatencySummary, RealtimeSummary, Rendered, Summary, SwapSummary, Totals};
pub use taps::{Tap, Taps};
