//! One tick as it is recorded.

use super::TickRecord;

/// One tick as it is recorded.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct StampedRecord {
    pub(crate) record: TickRecord,
    /// Records that the recorder had dropped when it took this one.
    pub(crate) dropped: u64,
    /// Time of the messages: ns since 1970, or of the loop under the virtual clock.
    pub(crate) stamp_ns: u64,
}
