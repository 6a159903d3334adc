//! From the drain's thread to the monitor's: every record, through a ring that the drain never
//! waits for.

use rtrb::{Consumer, RingBuffer};

use super::index_origin::{IndexOrigin, IndexOriginTracker};
use recording::{Subscriber, TickRecord};

/// Records under way: two seconds at 1 kHz.
const RING_RECORDS: usize = 2048;

/// A record with what only all records together show.
#[derive(Clone, Copy, Debug)]
pub(super) struct FeedRecord {
    pub(super) record: TickRecord,
    pub(super) index_origin: Option<IndexOrigin>,
}

/// Both ends. A record that finds the queue full is lost.
pub(super) fn feed() -> (Subscriber, Consumer<FeedRecord>) {
    let (mut ring, consumer) = RingBuffer::new(RING_RECORDS);
    let mut watcher = IndexOriginTracker::default();
    let subscriber = Box::new(move |record: &TickRecord| {
        let _ = ring.push(FeedRecord { record: *record, index_origin: watcher.see(record) });
        !ring.is_abandoned()
    });
    (subscriber, consumer)
}
