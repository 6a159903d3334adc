//! Who else wants every record: recorders and monitors come and go while a run goes on.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use super::TickRecord;

/// Takes every record in turn, on the drain's thread; false when it wants no more. What a tap cannot take at once it drops and counts
/// itself: under the real clock the drain waits for nobody.
pub type Tap = Box<dyn FnMut(&TickRecord) -> bool + Send>;

/// The taps of one drain. Clones share them.
#[derive(Clone, Default)]
pub struct Taps(Arc<Mutex<Open>>);

#[derive(Default)]
struct Open {
    taps: Vec<Tap>,
    is_over: bool,
}

impl Taps {
    /// From the next record on; ignored when the run is over.
    pub fn add(&self, tap: Tap) {
        let mut open = self.open();
        if !open.is_over {
            open.taps.push(tap);
        }
    }

    /// Gives a record to all of them. Cold.
    pub(super) fn pass(&self, record: &TickRecord) {
        self.open().taps.retain_mut(|tap| tap(record));
    }

    /// The run is over: drops all taps, which is how they hear of it.
    pub(super) fn close(&self) {
        let mut open = self.open();
        open.is_over = true;
        open.taps.clear();
    }

    fn open(&self) -> MutexGuard<'_, Open> {
        // A tap that panicked takes the drain with it; its list is whole.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl core::fmt::Debug for Taps {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_tuple("Taps").field(&self.open().taps.len()).finish()
    }
}
