//! A watcher inside the program: takes every record as a client does, and looks at the newest at
//! any time.

use std::sync::Arc;

use rtrb::Consumer;

use super::encode::{self, Extras};
use super::feed::{FeedRecord, feed};
use super::hub::{Hub, NewestState};
use super::scene_tracker::SceneTracker;
use recording::{Subscriber, TickRecord};

/// Watches a run; the newest record wins.
pub struct Observer {
    hub: Arc<Hub>,
    tracker: SceneTracker,
    fed: Consumer<FeedRecord>,
}

/// What a look showed.
pub struct Observation<'a> {
    hub: &'a Hub,
    newest: NewestState,
}

impl Observer {
    /// One that has not looked yet, and the subscriber that feeds it. An observer that looks less
    /// often than once in two seconds misses records in between, and with them objects that moved.
    pub fn new(hub: Arc<Hub>) -> (Self, Subscriber) {
        let (subscriber, fed) = feed();
        let tracker = SceneTracker::new(hub.session.view());
        (Self { hub, tracker, fed }, subscriber)
    }

    /// The newest record; `None`: there was none since the last look. Cold.
    pub fn look(&mut self) -> Option<Observation<'_>> {
        self.tracker.look_at(self.hub.session.view());
        let mut newest = None;
        // No more than there are now: under the virtual clock the ring fills as fast as it empties.
        for _ in 0..self.fed.slots() {
            let Ok(fed) = self.fed.pop() else { break };
            self.tracker.see(&fed.record);
            newest = Some(fed);
        }
        let newest = self.tracker.newest(newest?);
        Some(Observation { hub: &self.hub, newest })
    }
}

impl Observation<'_> {
    /// The record itself.
    pub fn record(&self) -> &TickRecord {
        &self.newest.fed.record
    }

    /// The state as `docs/reference/api.md` has it, without contact points and history.
    pub fn text(&self, seq: u64) -> String {
        encode::with_counts(&self.hub.text(&self.newest, Extras::default()), seq, 0)
    }

    /// The same in the binary layout.
    pub fn binary(&self, seq: u64) -> Vec<u8> {
        let mut bytes = self.hub.binary(&self.newest);
        encode::count_in(&mut bytes, seq, 0);
        bytes
    }
}
