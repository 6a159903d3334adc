//! Recordings that clients begin and end, as the monitor knows them.

use std::path::PathBuf;

use serde_json::{Value, json};

/// Begins and ends recordings when a client says so.
pub trait RecordingControl: Send + Sync {
    /// Begins one, into a file of this name or of one that the recorder chooses, and says which. May block.
    ///
    /// # Errors
    /// One is under way, or the file cannot be made.
    fn start(&self, file: Option<&str>) -> Result<RecorderStatus, RecorderError>;

    /// Ends the one that is under way, and says what it came to. May block.
    ///
    /// # Errors
    /// None is.
    fn stop(&self) -> Result<RecorderStatus, RecorderError>;

    /// The one that is under way. Never blocks: it is asked on the thread that serves every client.
    fn status(&self) -> Option<RecorderStatus>;
}

/// How a recording goes, or what it came to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RecorderStatus {
    /// Where it goes.
    pub file: PathBuf,
    /// Ticks that are in it.
    pub records: u64,
    /// Ticks that found the queue full.
    pub dropped: u64,
}

impl RecorderStatus {
    pub(super) fn json(&self) -> Value {
        json!({ "file": self.file.to_string_lossy(), "records": self.records, "dropped": self.dropped })
    }
}

/// Why a recording did not begin or end.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum RecorderError {
    /// The file is not one that may be written.
    #[error("{0}")]
    File(String),
    /// One is under way, or none is.
    #[error("{0}")]
    State(String),
}
