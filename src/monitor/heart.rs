//! The heartbeat: a client that drives and falls silent takes the force with it.
//!
//! It has a thread of its own, so that a monitor that hangs is silence as well.

use core::time::Duration;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// Silence that a client may allow itself, and the default.
pub(super) const SHORTEST: Duration = Duration::from_millis(20);
pub(super) const LONGEST: Duration = Duration::from_secs(10);
const DEFAULT: Duration = Duration::from_millis(500);
/// Silence of a client that holds the clay.
pub(super) const LONGEST_HOLD: Duration = Duration::from_secs(1);
/// How often a loop that still has force is told again.
const AGAIN: Duration = Duration::from_millis(50);

/// Who beats.
#[derive(Debug)]
pub(super) struct Heart {
    beats: Mutex<Beats>,
    changed: Condvar,
    /// Longest silence of the scene: without a client that beats no force flows.
    needed: Option<Duration>,
}

#[derive(Debug, Default)]
struct Beats {
    beating: Vec<Beat>,
    hold: Option<Hold>,
    has_force: bool,
    is_told: bool,
    is_over: bool,
}

#[derive(Clone, Copy, Debug)]
struct Beat {
    client: u64,
    longest: Duration,
    /// `None`: it has gone.
    last: Option<Instant>,
    /// It was silent for too long, and this was told. Its next sign of life puts it on guard again: it still believes that it is.
    has_lapsed: bool,
}

/// Somebody holds the clay.
#[derive(Clone, Copy, Debug)]
struct Hold {
    /// `None`: whoever it was has let go, and that was not heard.
    client: Option<u64>,
    /// `None`: it has gone.
    last: Option<Instant>,
}

/// Why force, or the clay, is to be let go.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Silence {
    /// A client that holds the clay was silent for too long or has gone: only the clay is let go.
    Holding,
    /// The same again: the first time it was not heard.
    StillHolding,
    /// A client that used to beat was silent for longer than it may be.
    Of(Duration),
    /// A client that used to beat has gone.
    Gone,
    /// The scene wants a client that beats, and none does.
    Nobody,
}

impl Heart {
    pub(super) fn new(needed: Option<Duration>) -> Self {
        Self { beats: Mutex::default(), changed: Condvar::new(), needed }
    }

    /// A client beats, from now on with this longest silence if it gives one; zero: it ends that. Gives the silence that it may allow itself.
    pub(super) fn beat(&self, client: u64, longest: Option<Duration>) -> Duration {
        let mut beats = self.beats();
        let known = beats.beating.iter().position(|beat| beat.client == client);
        if longest == Some(Duration::ZERO) {
            if let Some(known) = known {
                beats.beating.swap_remove(known);
            }
            self.changed.notify_all();
            return Duration::ZERO;
        }
        let cut = |longest: Duration| longest.min(self.needed.unwrap_or(longest));
        let last = Some(Instant::now());
        let longest = match known.and_then(|known| beats.beating.get_mut(known)) {
            Some(beat) => {
                beat.longest = longest.map_or(beat.longest, cut);
                (beat.last, beat.has_lapsed) = (last, false);
                beat.longest
            }
            None => {
                let longest = cut(longest.unwrap_or(DEFAULT));
                beats.beating.push(Beat { client, longest, last, has_lapsed: false });
                longest
            }
        };
        self.changed.notify_all();
        longest
    }

    /// A client holds the clay from now on, for as long as it gives signs of life; false: another one does.
    pub(super) fn hold(&self, client: u64) -> bool {
        let mut beats = self.beats();
        let is_free = beats.hold.is_none_or(|hold| hold.client == Some(client));
        if is_free {
            beats.hold = Some(Hold { client: Some(client), last: Some(Instant::now()) });
            self.changed.notify_all();
        }
        is_free
    }

    /// A client lets go; false where it did not hold.
    pub(super) fn let_go(&self, client: u64) -> bool {
        self.beats().hold.take_if(|hold| hold.client == Some(client)).is_some()
    }

    /// Whoever holds lets go; false where nobody did.
    pub(super) fn let_all_go(&self) -> bool {
        self.beats().hold.take_if(|hold| hold.client.is_some()).is_some()
    }

    /// That somebody let go was not heard: it is told again.
    pub(super) fn still_held(&self) {
        self.beats().hold.get_or_insert(Hold { client: None, last: None });
        self.changed.notify_all();
    }

    /// Somebody holds the clay.
    pub(super) fn holds(&self) -> bool {
        self.beats().hold.is_some()
    }

    /// Whatever a client says is a sign of life.
    pub(super) fn hear(&self, client: u64) {
        let mut beats = self.beats();
        if let Some(hold) = beats.hold.as_mut().filter(|hold| hold.client == Some(client)) {
            hold.last = Some(Instant::now());
        }
        if let Some(beat) = beats.beating.iter_mut().find(|beat| beat.client == client) {
            beat.last = Some(Instant::now());
            if core::mem::take(&mut beat.has_lapsed) {
                self.changed.notify_all();
            }
        }
    }

    /// The connection of a client has ended.
    pub(super) fn lose(&self, client: u64) {
        let mut beats = self.beats();
        if let Some(hold) = beats.hold.as_mut().filter(|hold| hold.client == Some(client)) {
            hold.last = None;
            self.changed.notify_all();
        }
        // Whoever had fallen silent before has taken the force already.
        beats.beating.retain(|beat| beat.client != client || !beat.has_lapsed);
        if let Some(beat) = beats.beating.iter_mut().find(|beat| beat.client == client) {
            beat.last = None;
            self.changed.notify_all();
        }
    }

    /// True when an order to enable may come from this client (`None`: from one without a connection).
    pub(super) fn lets_enable(&self, client: Option<u64>) -> bool {
        let beats = self.beats();
        let beats_now = |beat: &Beat| !beat.has_lapsed && client.is_none_or(|client| client == beat.client);
        self.needed.is_none() || beats.beating.iter().any(beats_now)
    }

    /// Whether force may flow now.
    pub(super) fn note_force(&self, has_force: bool) {
        let mut beats = self.beats();
        beats.has_force = has_force;
        beats.is_told &= has_force;
        self.changed.notify_all();
    }

    /// The run is over.
    pub(super) fn end(&self) {
        self.beats().is_over = true;
        self.changed.notify_all();
    }

    /// Watches until the end; for a thread of its own. `silent` switches force off; the flag says that this is news.
    pub(super) fn watch(&self, silent: impl Fn(Silence, bool)) {
        let mut beats = self.beats();
        while !beats.is_over {
            let now = Instant::now();
            let until = |beat: &Beat| beat.last.filter(|_| !beat.has_lapsed).map(|last| last + beat.longest);
            let held_until = beats.hold.map(|hold| hold.last.map_or(now, |last| last + LONGEST_HOLD));
            let lapsed = beats.hold.take_if(|_| held_until.is_some_and(|until| until <= now));
            let silent_one = beats.beating.iter_mut().find(|beat| until(beat).is_some_and(|until| until <= now));
            let (silence, is_news) = if let Some(hold) = lapsed {
                if hold.client.is_some() { (Silence::Holding, true) } else { (Silence::StillHolding, false) }
            } else if let Some(beat) = silent_one {
                beat.has_lapsed = true;
                (Silence::Of(beat.longest), true)
            } else if let Some(gone) = beats.beating.iter().position(|beat| beat.last.is_none()) {
                beats.beating.swap_remove(gone);
                (Silence::Gone, true)
            } else if self.needed.is_some() && beats.has_force && beats.beating.iter().all(|beat| beat.has_lapsed) {
                (Silence::Nobody, !core::mem::replace(&mut beats.is_told, true))
            } else {
                let next = beats.beating.iter().filter_map(until).chain(held_until).min();
                let patience = next.map_or(Duration::from_secs(3600), |next| next.saturating_duration_since(now));
                beats = self.changed.wait_timeout(beats, patience).unwrap_or_else(PoisonError::into_inner).0;
                continue;
            };
            // Whoever is told may ask this very heart.
            drop(beats);
            silent(silence, is_news);
            if matches!(silence, Silence::Nobody | Silence::StillHolding) {
                std::thread::sleep(AGAIN);
            }
            beats = self.beats();
        }
    }

    fn beats(&self) -> MutexGuard<'_, Beats> {
        // Every statement above leaves a list that holds together.
        self.beats.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::mpsc::channel;

    use super::*;

    /// What a heart says while `then` happens.
    fn told(heart: &Heart, then: impl FnOnce(&dyn Fn() -> (Silence, bool))) {
        let (sender, said) = channel();
        std::thread::scope(|scope| {
            scope.spawn(|| heart.watch(move |silence, is_news| sender.send((silence, is_news)).unwrap_or_default()));
            then(&|| said.recv().expect("it watches"));
            heart.end();
        });
    }

    #[test]
    fn silence_a_closed_connection_and_nobody_take_the_force_away() {
        let heart = Heart::new(None);
        assert!(heart.lets_enable(None) && heart.lets_enable(Some(3)));
        told(&heart, |next| {
            assert_eq!(heart.beat(3, Some(SHORTEST)), SHORTEST);
            assert_eq!(next(), (Silence::Of(SHORTEST), true));
            heart.beat(4, Some(LONGEST));
            heart.lose(4);
            assert_eq!(next(), (Silence::Gone, true));
            // Who has taken leave is not missed.
            heart.beat(5, Some(LONGEST));
            assert_eq!(heart.beat(5, Some(Duration::ZERO)), Duration::ZERO);
            heart.lose(5);
            heart.beat(6, Some(SHORTEST));
            assert_eq!(next(), (Silence::Of(SHORTEST), true));
        });
    }

    #[test]
    fn who_was_silent_is_on_guard_again_with_its_next_sign_of_life() {
        let heart = Heart::new(Some(LONGEST));
        told(&heart, |next| {
            heart.beat(1, Some(SHORTEST));
            for say in [&|| heart.hear(1), &|| _ = heart.beat(1, None), &|| heart.hear(1)] as [&dyn Fn(); 3] {
                assert_eq!(next(), (Silence::Of(SHORTEST), true));
                assert!(!heart.lets_enable(None), "nobody beats while it is silent");
                say();
            }
            assert_eq!(next(), (Silence::Of(SHORTEST), true));
            heart.beat(1, Some(LONGEST));
            assert!(heart.lets_enable(Some(1)));
            heart.lose(1);
            assert_eq!(next(), (Silence::Gone, true));
            assert!(!heart.lets_enable(Some(1)));
        });
    }

    #[test]
    fn a_hold_ends_with_the_client_and_takes_no_force_with_it() {
        let heart = Heart::new(None);
        told(&heart, |next| {
            assert!(heart.hold(1) && heart.hold(1) && !heart.hold(2));
            assert!(!heart.let_go(2) && heart.holds() && heart.let_go(1) && !heart.holds());
            // Gone, and silent.
            assert!(heart.hold(1));
            heart.lose(1);
            assert_eq!(next(), (Silence::Holding, true));
            assert!(heart.hold(2));
            let began = Instant::now();
            while began.elapsed() < LONGEST_HOLD + LONGEST_HOLD / 2 {
                heart.hear(2);
                std::thread::sleep(SHORTEST);
            }
            assert!(heart.holds(), "who says something still holds");
            assert_eq!(next(), (Silence::Holding, true));
            assert!(!heart.holds() && !heart.let_go(2));
            // Nobody heard of it.
            heart.still_held();
            assert_eq!(next(), (Silence::StillHolding, false));
            assert!(heart.hold(3) && heart.let_all_go() && !heart.holds());
        });
    }

    #[test]
    fn a_scene_that_wants_a_heartbeat_has_no_force_without() {
        let needed = Duration::from_millis(200);
        let heart = Heart::new(Some(needed));
        assert!(!heart.lets_enable(None));
        told(&heart, |next| {
            heart.note_force(true);
            assert_eq!(next(), (Silence::Nobody, true));
            assert_eq!(next(), (Silence::Nobody, false), "again, until it is off");
            heart.note_force(false);
            assert_eq!(heart.beat(1, Some(LONGEST)), needed, "no longer than the scene allows");
            assert!(heart.lets_enable(Some(1)) && heart.lets_enable(None) && !heart.lets_enable(Some(2)));
        });
    }
}
