//! The watchdog of the hold: a client holds the clay for no longer than it gives signs of life.
//!
//! It shares no lock and no thread with the watchdog of clients that drive: an order to let go may
//! find the queue of the clay full.

use core::time::Duration;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// Longest silence of the client that holds.
const LONGEST: Duration = Duration::from_secs(1);
/// Pause before an order to let go that was not taken is given again.
const AGAIN: Duration = Duration::from_millis(50);
/// Sleep while nothing is held; every change ends it.
const IDLE: Duration = Duration::from_secs(3600);

/// Watches the client that holds the clay.
#[derive(Debug, Default)]
pub(in crate::monitor) struct HoldWatchdog {
    watched: Mutex<Watched>,
    changed: Condvar,
}

#[derive(Debug, Default)]
struct Watched {
    hold: Option<Hold>,
    is_over: bool,
}

#[derive(Clone, Copy, Debug)]
struct Hold {
    /// `None`: the client has let go, and the order to let go was not taken.
    client: Option<u64>,
    until: Instant,
}

impl HoldWatchdog {
    /// A client holds the clay from now on; false: another one does.
    pub(super) fn hold(&self, client: u64) -> bool {
        let mut watched = self.watched();
        // A new hold takes the place of an order to let go that waits.
        let holder = watched.hold.and_then(|hold| hold.client);
        let is_free = holder.is_none_or(|holder| holder == client);
        if is_free {
            let until = Instant::now() + LONGEST;
            watched.hold = Some(Hold { client: Some(client), until });
            self.changed.notify_all();
        }
        is_free
    }

    /// A client lets go; false where it did not hold.
    pub(super) fn let_go(&self, client: u64) -> bool {
        self.watched().hold.take_if(|hold| hold.client == Some(client)).is_some()
    }

    /// The client that holds lets go; false where none did.
    pub(in crate::monitor) fn let_all_go(&self) -> bool {
        self.watched().hold.take_if(|hold| hold.client.is_some()).is_some()
    }

    /// The order to let go was not taken: it is given again.
    pub(super) fn still_held(&self) {
        let until = Instant::now() + AGAIN;
        self.watched().hold.get_or_insert(Hold { client: None, until });
        self.changed.notify_all();
    }

    /// A client holds the clay.
    pub(in crate::monitor) fn holds(&self) -> bool {
        self.watched().hold.is_some()
    }

    /// Bytes of a client came at `at`: every message is a sign of life.
    pub(in crate::monitor) fn note_message(&self, client: u64, at: Instant) {
        let mut watched = self.watched();
        if let Some(hold) = watched.hold.as_mut().filter(|hold| hold.client == Some(client)) {
            hold.until = hold.until.max(at + LONGEST);
        }
    }

    /// The connection of a client has ended.
    pub(in crate::monitor) fn lose(&self, client: u64) {
        let mut watched = self.watched();
        if let Some(hold) = watched.hold.as_mut().filter(|hold| hold.client == Some(client)) {
            hold.until = Instant::now();
            self.changed.notify_all();
        }
    }

    /// The run is over: [`Self::watch`] returns.
    pub(in crate::monitor) fn end(&self) {
        self.watched().is_over = true;
        self.changed.notify_all();
    }

    /// Watches until the end; for a thread of its own. `let_go` is called when a hold has lapsed;
    /// the flag says that this is news.
    pub(in crate::monitor) fn watch(&self, let_go: impl Fn(bool)) {
        let mut watched = self.watched();
        while !watched.is_over {
            let now = Instant::now();
            if let Some(lapsed) = watched.hold.take_if(|hold| hold.until <= now) {
                // What is called may ask this watchdog.
                drop(watched);
                let_go(lapsed.client.is_some());
                watched = self.watched();
                continue;
            }
            let patience =
                watched.hold.map_or(IDLE, |hold| hold.until.saturating_duration_since(now));
            watched = self
                .changed
                .wait_timeout(watched, patience)
                .unwrap_or_else(PoisonError::into_inner)
                .0;
        }
    }

    fn watched(&self) -> MutexGuard<'_, Watched> {
        // Every statement above leaves a hold that is whole.
        self.watched.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::channel;

    use super::*;

    const HUNG: Duration = Duration::from_secs(60);

    /// A test that fails must not leave the thread behind.
    struct End<'w>(&'w HoldWatchdog);

    impl Drop for End<'_> {
        fn drop(&mut self) {
            self.0.end();
        }
    }

    #[test]
    fn a_hold_ends_with_its_client() {
        let watchdog = HoldWatchdog::default();
        let (sender, lapsed) = channel();
        std::thread::scope(|scope| {
            scope.spawn(|| watchdog.watch(move |is_news| sender.send(is_news).unwrap_or_default()));
            let _end = End(&watchdog);
            let next = || lapsed.recv_timeout(HUNG).expect("it watches");
            assert!(watchdog.hold(1) && watchdog.hold(1) && !watchdog.hold(2));
            assert!(
                !watchdog.let_go(2) && watchdog.holds() && watchdog.let_go(1) && !watchdog.holds()
            );
            // Gone, and silent.
            assert!(watchdog.hold(1));
            watchdog.lose(1);
            assert!(next());
            assert!(watchdog.hold(2));
            watchdog.note_message(2, Instant::now() + Duration::from_secs(3600));
            std::thread::sleep(LONGEST + AGAIN);
            assert!(watchdog.holds(), "a client that sends something still holds");
            watchdog.lose(2);
            assert!(next());
            assert!(watchdog.hold(2));
            assert!(next(), "it is silent");
            assert!(!watchdog.holds() && !watchdog.let_go(2));
            // The order was not taken.
            watchdog.still_held();
            assert!(!next(), "no news");
            watchdog.still_held();
            assert!(watchdog.hold(3) && !watchdog.hold(4));
            assert!(watchdog.let_all_go() && !watchdog.holds());
        });
    }
}
