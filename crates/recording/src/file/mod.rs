//! Recordings: every tick of a run in an MCAP file that other programs open and that this one can
//! run again.
//!
//! Data in: records from a subscriber on the drain, and what the scenes are made of. Data out:
//! files, and entries read back from them.
//!
//! | file | owns |
//! |---|---|
//! | `channels` | topics |
//! | `wire` | one description of a message → its bytes and back, its schema |
//! | `foxglove` | the form of Foxglove's own messages, and their schemas |
//! | `messages` | what they say: parts, the tool's frame, faults |
//! | `scene_files` | what a scene was made of |
//! | `write`, `read` | one file |
//! | `recorder` | recordings that start and stop while a run goes on |
//! | `live` | the same messages for connected clients |
//! | `fault_files` | the flight recorder's files |
//!
//! Invariant: a disk that is slow or full costs records, which are counted, and nothing else.

mod channels;
mod fault_files;
mod foxglove;
pub mod live;
mod messages;
mod read;
mod recorder;
mod scene_files;
#[cfg(test)]
mod tests;
mod wire;
mod write;

pub use fault_files::{FaultFile, FaultFileHandler, FaultFiles, now};
pub use read::{Entry, LONGEST_TEXT, ReadError, Recording};
pub use recorder::{
    FORCE_LAW_KEY, Facts, FailureHandler, Recorder, RecorderHandle, RecordingSummary,
};
pub use scene_files::{DisplayObject, DisplayShape, NamedFile, SceneFiles, Scenes};
pub use write::RecordingError;
