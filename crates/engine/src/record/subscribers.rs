//! Subscribers to every record: recorders and monitors come and go while a run goes on.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::TickRecord;

/// Takes every record in turn, on the drain's thread; false when it wants no more. What a
/// subscriber cannot take at once it drops and counts itself: under the real clock the drain waits
/// for no subscriber.
pub type Subscriber = Box<dyn FnMut(&TickRecord) -> bool + Send>;

/// The subscribers of one drain. Clones share them.
#[derive(Clone, Default)]
pub struct RecordSubscribers(Arc<Mutex<Open>>);

#[derive(Default)]
struct Open {
    subscribers: Vec<Subscriber>,
    is_over: bool,
}

impl RecordSubscribers {
    /// From the next record on; ignored when the run is over.
    pub fn add(&self, subscriber: Subscriber) {
        let mut open = self.open();
        if !open.is_over {
            open.subscribers.push(subscriber);
        }
    }

    /// Gives a record to all of them. Cold.
    pub(super) fn pass(&self, record: &TickRecord) {
        self.open().subscribers.retain_mut(|subscriber| subscriber(record));
    }

    /// The run is over: drops all subscribers, which is how they learn of it.
    pub(super) fn close(&self) {
        let mut open = self.open();
        open.is_over = true;
        open.subscribers.clear();
    }

    fn open(&self) -> MutexGuard<'_, Open> {
        // A subscriber that panicked takes the drain with it; its list is whole.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl core::fmt::Debug for RecordSubscribers {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_tuple("RecordSubscribers").field(&self.open().subscribers.len()).finish()
    }
}
