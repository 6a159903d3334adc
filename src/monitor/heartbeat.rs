//! The watchdog of heartbeats: when a client that drives falls silent, the force goes off.
//!
//! It has a thread of its own, so that a monitor that stands still counts as silence.

use core::time::Duration;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// Silence that a client may allow itself, and the default.
pub(super) const SHORTEST: Duration = Duration::from_millis(20);
pub(super) const LONGEST: Duration = Duration::from_secs(10);
const DEFAULT: Duration = Duration::from_millis(500);
/// Silence of a client that holds the clay.
pub(super) const LONGEST_HOLD: Duration = Duration::from_secs(1);
/// How often a loop that still has force gets the order again.
const AGAIN: Duration = Duration::from_millis(50);

/// The timers of clients.
#[derive(Debug)]
pub(super) struct HeartbeatWatchdog {
    timers: Mutex<Timers>,
    changed: Condvar,
    /// Longest silence of the scene: without a client that sends heartbeats no force flows.
    needed: Option<Duration>,
}

#[derive(Debug, Default)]
struct Timers {
    clients: Vec<ClientTimer>,
    hold: Option<HoldTimer>,
    has_force: bool,
    is_reported: bool,
    is_over: bool,
}

#[derive(Clone, Copy, Debug)]
struct ClientTimer {
    client: u64,
    longest: Duration,
    /// `None`: it has gone.
    last: Option<Instant>,
    /// It was silent for too long, and that was reported. Its next message starts the timer again:
    /// the client still relies on it.
    has_lapsed: bool,
}

/// A client holds the clay.
#[derive(Clone, Copy, Debug)]
struct HoldTimer {
    /// `None`: the client has let go, and the order to let go was not taken.
    client: Option<u64>,
    /// `None`: it has gone.
    last: Option<Instant>,
}

/// Why force, or the clay, is to be let go.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Timeout {
    /// A client that holds the clay was silent for too long or has gone: only the clay is let go.
    Holding,
    /// The same again: the first order was not taken.
    StillHolding,
    /// A client that sent heartbeats was silent for longer than it may be.
    Of(Duration),
    /// A client that sent heartbeats has disconnected.
    Gone,
    /// The scene wants a client that sends heartbeats, and none does.
    NoClient,
}

impl HeartbeatWatchdog {
    pub(super) fn new(needed: Option<Duration>) -> Self {
        Self { timers: Mutex::default(), changed: Condvar::new(), needed }
    }

    /// A client sends a heartbeat, from now on with this longest silence if it gives one; zero: it
    /// ends that. Gives the silence that it may allow itself.
    pub(super) fn beat(&self, client: u64, longest: Option<Duration>) -> Duration {
        let mut timers = self.timers();
        let known = timers.clients.iter().position(|timer| timer.client == client);
        if longest == Some(Duration::ZERO) {
            if let Some(known) = known {
                timers.clients.swap_remove(known);
            }
            self.changed.notify_all();
            return Duration::ZERO;
        }
        let cut = |longest: Duration| longest.min(self.needed.unwrap_or(longest));
        let last = Some(Instant::now());
        let longest = match known.and_then(|known| timers.clients.get_mut(known)) {
            Some(timer) => {
                timer.longest = longest.map_or(timer.longest, cut);
                (timer.last, timer.has_lapsed) = (last, false);
                timer.longest
            }
            None => {
                let longest = cut(longest.unwrap_or(DEFAULT));
                timers.clients.push(ClientTimer { client, longest, last, has_lapsed: false });
                longest
            }
        };
        self.changed.notify_all();
        longest
    }

    /// A client holds the clay from now on, for as long as it gives signs of life; false: another
    /// one does.
    pub(super) fn hold(&self, client: u64) -> bool {
        let mut timers = self.timers();
        let is_free = timers.hold.is_none_or(|hold| hold.client == Some(client));
        if is_free {
            timers.hold = Some(HoldTimer { client: Some(client), last: Some(Instant::now()) });
            self.changed.notify_all();
        }
        is_free
    }

    /// A client lets go; false where it did not hold.
    pub(super) fn let_go(&self, client: u64) -> bool {
        self.timers().hold.take_if(|hold| hold.client == Some(client)).is_some()
    }

    /// The client that holds lets go; false where none did.
    pub(super) fn let_all_go(&self) -> bool {
        self.timers().hold.take_if(|hold| hold.client.is_some()).is_some()
    }

    /// The order to let go was not taken: it is given again.
    pub(super) fn still_held(&self) {
        self.timers().hold.get_or_insert(HoldTimer { client: None, last: None });
        self.changed.notify_all();
    }

    /// A client holds the clay.
    pub(super) fn holds(&self) -> bool {
        self.timers().hold.is_some()
    }

    /// Every message of a client is a sign of life.
    pub(super) fn note_message(&self, client: u64) {
        let mut timers = self.timers();
        if let Some(hold) = timers.hold.as_mut().filter(|hold| hold.client == Some(client)) {
            hold.last = Some(Instant::now());
        }
        if let Some(timer) = timers.clients.iter_mut().find(|timer| timer.client == client) {
            timer.last = Some(Instant::now());
            if core::mem::take(&mut timer.has_lapsed) {
                self.changed.notify_all();
            }
        }
    }

    /// The connection of a client has ended.
    pub(super) fn lose(&self, client: u64) {
        let mut timers = self.timers();
        if let Some(hold) = timers.hold.as_mut().filter(|hold| hold.client == Some(client)) {
            hold.last = None;
            self.changed.notify_all();
        }
        // A client that was silent before has switched the force off already.
        timers.clients.retain(|timer| timer.client != client || !timer.has_lapsed);
        if let Some(timer) = timers.clients.iter_mut().find(|timer| timer.client == client) {
            timer.last = None;
            self.changed.notify_all();
        }
    }

    /// True when an order to enable may come from this client (`None`: from one without a
    /// connection).
    pub(super) fn lets_enable(&self, client: Option<u64>) -> bool {
        let timers = self.timers();
        let is_watched = |timer: &ClientTimer| {
            !timer.has_lapsed && client.is_none_or(|client| client == timer.client)
        };
        self.needed.is_none() || timers.clients.iter().any(is_watched)
    }

    /// Whether force may flow now.
    pub(super) fn note_force(&self, has_force: bool) {
        let mut timers = self.timers();
        timers.has_force = has_force;
        timers.is_reported &= has_force;
        self.changed.notify_all();
    }

    /// The run is over.
    pub(super) fn end(&self) {
        self.timers().is_over = true;
        self.changed.notify_all();
    }

    /// Watches until the end; for a thread of its own. `silent` switches force off; the flag says
    /// that this is news.
    pub(super) fn watch(&self, silent: impl Fn(Timeout, bool)) {
        let mut timers = self.timers();
        while !timers.is_over {
            let now = Instant::now();
            let until = |timer: &ClientTimer| {
                timer.last.filter(|_| !timer.has_lapsed).map(|last| last + timer.longest)
            };
            let held_until =
                timers.hold.map(|hold| hold.last.map_or(now, |last| last + LONGEST_HOLD));
            let lapsed = timers.hold.take_if(|_| held_until.is_some_and(|until| until <= now));
            let silent_one = timers
                .clients
                .iter_mut()
                .find(|timer| until(timer).is_some_and(|until| until <= now));
            let (silence, is_news) = if let Some(hold) = lapsed {
                if hold.client.is_some() {
                    (Timeout::Holding, true)
                } else {
                    (Timeout::StillHolding, false)
                }
            } else if let Some(timer) = silent_one {
                timer.has_lapsed = true;
                (Timeout::Of(timer.longest), true)
            } else if let Some(gone) = timers.clients.iter().position(|timer| timer.last.is_none())
            {
                timers.clients.swap_remove(gone);
                (Timeout::Gone, true)
            } else if self.needed.is_some()
                && timers.has_force
                && timers.clients.iter().all(|timer| timer.has_lapsed)
            {
                (Timeout::NoClient, !core::mem::replace(&mut timers.is_reported, true))
            } else {
                let next = timers.clients.iter().filter_map(until).chain(held_until).min();
                let patience = next
                    .map_or(Duration::from_secs(3600), |next| next.saturating_duration_since(now));
                timers = self
                    .changed
                    .wait_timeout(timers, patience)
                    .unwrap_or_else(PoisonError::into_inner)
                    .0;
                continue;
            };
            // The closure may ask this watchdog.
            drop(timers);
            silent(silence, is_news);
            if matches!(silence, Timeout::NoClient | Timeout::StillHolding) {
                std::thread::sleep(AGAIN);
            }
            timers = self.timers();
        }
    }

    fn timers(&self) -> MutexGuard<'_, Timers> {
        // Every statement above leaves a list that holds together.
        self.timers.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::channel;

    use super::*;

    /// What a watchdog reports while `then` happens.
    fn reported(watchdog: &HeartbeatWatchdog, then: impl FnOnce(&dyn Fn() -> (Timeout, bool))) {
        let (sender, said) = channel();
        std::thread::scope(|scope| {
            scope.spawn(|| {
                watchdog.watch(move |silence, is_news| {
                    sender.send((silence, is_news)).unwrap_or_default()
                })
            });
            then(&|| said.recv().expect("it watches"));
            watchdog.end();
        });
    }

    #[test]
    fn silence_a_closed_connection_and_no_client_take_the_force_away() {
        let watchdog = HeartbeatWatchdog::new(None);
        assert!(watchdog.lets_enable(None) && watchdog.lets_enable(Some(3)));
        reported(&watchdog, |next| {
            assert_eq!(watchdog.beat(3, Some(SHORTEST)), SHORTEST);
            assert_eq!(next(), (Timeout::Of(SHORTEST), true));
            watchdog.beat(4, Some(LONGEST));
            watchdog.lose(4);
            assert_eq!(next(), (Timeout::Gone, true));
            // A client that has signed off is not missed.
            watchdog.beat(5, Some(LONGEST));
            assert_eq!(watchdog.beat(5, Some(Duration::ZERO)), Duration::ZERO);
            watchdog.lose(5);
            watchdog.beat(6, Some(SHORTEST));
            assert_eq!(next(), (Timeout::Of(SHORTEST), true));
        });
    }

    #[test]
    fn who_was_silent_is_on_guard_again_with_its_next_sign_of_life() {
        let watchdog = HeartbeatWatchdog::new(Some(LONGEST));
        reported(&watchdog, |next| {
            watchdog.beat(1, Some(SHORTEST));
            for say in [&|| watchdog.note_message(1), &|| _ = watchdog.beat(1, None), &|| {
                watchdog.note_message(1)
            }] as [&dyn Fn(); 3]
            {
                assert_eq!(next(), (Timeout::Of(SHORTEST), true));
                assert!(!watchdog.lets_enable(None), "no client counts while it is silent");
                say();
            }
            assert_eq!(next(), (Timeout::Of(SHORTEST), true));
            watchdog.beat(1, Some(LONGEST));
            assert!(watchdog.lets_enable(Some(1)));
            watchdog.lose(1);
            assert_eq!(next(), (Timeout::Gone, true));
            assert!(!watchdog.lets_enable(Some(1)));
        });
    }

    #[test]
    fn a_hold_ends_with_the_client_and_takes_no_force_with_it() {
        let watchdog = HeartbeatWatchdog::new(None);
        reported(&watchdog, |next| {
            assert!(watchdog.hold(1) && watchdog.hold(1) && !watchdog.hold(2));
            assert!(
                !watchdog.let_go(2) && watchdog.holds() && watchdog.let_go(1) && !watchdog.holds()
            );
            // Gone, and silent.
            assert!(watchdog.hold(1));
            watchdog.lose(1);
            assert_eq!(next(), (Timeout::Holding, true));
            assert!(watchdog.hold(2));
            let began = Instant::now();
            while began.elapsed() < LONGEST_HOLD + LONGEST_HOLD / 2 {
                watchdog.note_message(2);
                std::thread::sleep(SHORTEST);
            }
            assert!(watchdog.holds(), "a client that sends something still holds");
            assert_eq!(next(), (Timeout::Holding, true));
            assert!(!watchdog.holds() && !watchdog.let_go(2));
            // The order was not taken.
            watchdog.still_held();
            assert_eq!(next(), (Timeout::StillHolding, false));
            assert!(watchdog.hold(3) && watchdog.let_all_go() && !watchdog.holds());
        });
    }

    #[test]
    fn a_scene_that_wants_a_heartbeat_has_no_force_without() {
        let needed = Duration::from_millis(200);
        let watchdog = HeartbeatWatchdog::new(Some(needed));
        assert!(!watchdog.lets_enable(None));
        reported(&watchdog, |next| {
            watchdog.note_force(true);
            assert_eq!(next(), (Timeout::NoClient, true));
            assert_eq!(next(), (Timeout::NoClient, false), "again, until it is off");
            watchdog.note_force(false);
            assert_eq!(watchdog.beat(1, Some(LONGEST)), needed, "no longer than the scene allows");
            assert!(
                watchdog.lets_enable(Some(1))
                    && watchdog.lets_enable(None)
                    && !watchdog.lets_enable(Some(2))
            );
        });
    }
}
