//! Recordings that clients begin and end, as the monitor knows them.

use std::path::{Path, PathBuf};

use serde_json::{Value, json};

/// Begins and ends recordings when a client says so.
pub trait RecordingControl: Send + Sync {
    /// Begins one, into a file of this name or of one that the recorder chooses, and says which.
    /// May block.
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

    /// The recordings of this run, oldest first, with the one that is under way. Never blocks.
    fn made(&self) -> Vec<MadeRecording>;

    /// The page of a recording that has ended, as `hapticd report` writes it: HTML. Blocks for as
    /// long as reading it takes.
    ///
    /// # Errors
    /// The file cannot be read, or holds no tick.
    fn report(&self, file: &Path) -> Result<String, RecorderError>;
}

/// A recording of this run.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MadeRecording {
    /// Counts the recordings of a run, from 1: clients ask for one by it, never by a name of
    /// theirs.
    pub number: u32,
    /// It has not ended.
    pub is_under_way: bool,
    /// How it goes, or what it came to.
    pub status: RecorderStatus,
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
