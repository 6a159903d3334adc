//! The drive watchdog: force goes off when a client that drives falls silent or is lost.
//!
//! A client drives from its first heartbeat on, until it ends its watch. Data in: the times at
//! which bytes of clients came, the ends of connections, and the control word. Data out: a disable
//! in the control word, and reports for people.
//!
//! Invariants: [`DriveWatchdog::watch`] has a thread of its own, so that a server that stands still
//! counts as silence. It calls nothing but the control word, and it does so before it writes a
//! report. Whether force may flow it reads there too, so nothing that hears of the loop late delays
//! it. Reports wait until they are fetched, so no reader of them delays the next disable.

use core::time::Duration;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use rt::control::Control;

/// Shortest silence that a client may allow itself.
pub const SHORTEST: Duration = Duration::from_millis(20);
/// Longest one.
pub const LONGEST: Duration = Duration::from_secs(10);
/// That of a client that gives none.
const DEFAULT: Duration = Duration::from_millis(500);
/// How often the control word is read while force may not flow for want of a client.
const UNWATCHED: Duration = Duration::from_millis(20);
/// Sleep while there is nothing to watch; every change ends it.
const IDLE: Duration = Duration::from_secs(3600);

/// Takes force away when a client that drives is silent or lost.
#[derive(Debug)]
pub struct DriveWatchdog {
    control: Arc<Control>,
    timers: Mutex<Timers>,
    changed: Condvar,
    /// Longest silence of the scene: without a client that sends heartbeats no force flows.
    needed: Option<Duration>,
}

#[derive(Debug, Default)]
struct Timers {
    clients: Vec<ClientTimer>,
    /// For reports alone.
    has_force: bool,
    reports: Vec<OffReport>,
    is_over: bool,
}

#[derive(Clone, Copy, Debug)]
struct ClientTimer {
    client: u64,
    longest: Duration,
    /// When its last bytes came.
    last: Instant,
    /// It was silent for too long, and that was reported. Its next message starts the timer again:
    /// the client still relies on it.
    has_lapsed: bool,
}

impl ClientTimer {
    fn until(&self) -> Option<Instant> {
        (!self.has_lapsed).then(|| self.last + self.longest)
    }

    fn is_due(&self, now: Instant) -> bool {
        self.until().is_some_and(|until| until <= now)
    }
}

/// Why the watchdog switched force off.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OffReason {
    /// A client that sent heartbeats was silent for longer than this.
    Silent(Duration),
    /// A client that sent heartbeats has disconnected.
    Lost,
    /// The scene wants a client that sends heartbeats, and none does.
    NoClient,
    /// The server closes the connection of a client, for this reason: an order of the client may be
    /// among what is not read any more.
    Expelled(&'static str),
}

/// Force was switched off.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OffReport {
    /// Why.
    pub reason: OffReason,
    /// Force might flow until then.
    pub had_force: bool,
}

impl DriveWatchdog {
    /// A watchdog without clients. `needed`: longest silence of the scene, where force needs a
    /// client that sends heartbeats.
    pub fn new(control: Arc<Control>, needed: Option<Duration>) -> Self {
        Self { control, timers: Mutex::default(), changed: Condvar::new(), needed }
    }

    /// A client sends a heartbeat, whose bytes came at `at`. From now on its longest silence is
    /// `longest`, where it gives one, from [`SHORTEST`] to [`LONGEST`] and no longer than the scene
    /// allows; zero ends its watch. Gives the silence that holds.
    pub fn beat(&self, client: u64, longest: Option<Duration>, at: Instant) -> Duration {
        let mut timers = self.timers();
        let known = timers.clients.iter().position(|timer| timer.client == client);
        if longest == Some(Duration::ZERO) {
            if let Some(known) = known {
                timers.clients.swap_remove(known);
            }
            self.changed.notify_all();
            return Duration::ZERO;
        }
        let cut = |longest: Duration| {
            longest.clamp(SHORTEST, LONGEST).min(self.needed.unwrap_or(LONGEST))
        };
        let longest = match known.and_then(|known| timers.clients.get_mut(known)) {
            Some(timer) => {
                timer.longest = longest.map_or(timer.longest, cut);
                timer.last = timer.last.max(at);
                timer.has_lapsed = false;
                timer.longest
            }
            None => {
                let longest = cut(longest.unwrap_or(DEFAULT));
                timers.clients.push(ClientTimer { client, longest, last: at, has_lapsed: false });
                longest
            }
        };
        self.changed.notify_all();
        longest
    }

    /// Bytes of a client came at `at`: every message is a sign of life.
    pub fn note_message(&self, client: u64, at: Instant) {
        let mut timers = self.timers();
        if let Some(timer) = timers.clients.iter_mut().find(|timer| timer.client == client) {
            timer.last = timer.last.max(at);
            if core::mem::take(&mut timer.has_lapsed) {
                self.changed.notify_all();
            }
        }
    }

    /// The connection of a client has ended.
    pub fn lose(&self, client: u64) {
        let mut timers = self.timers();
        let known = timers.clients.iter().position(|timer| timer.client == client);
        let timer = known.map(|known| timers.clients.swap_remove(known));
        // A client that was silent before has switched the force off already.
        if timer.is_some_and(|timer| !timer.has_lapsed) {
            self.control.disable();
            self.report(timers, OffReason::Lost);
        }
    }

    /// The server closes the connection of a client against that client's will, for this reason.
    pub fn expel(&self, why: &'static str) {
        // Before the lock.
        self.control.disable();
        self.report(self.timers(), OffReason::Expelled(why));
    }

    /// True when an order to enable may come from this client (`None`: from one without a
    /// connection).
    pub fn lets_enable(&self, client: Option<u64>) -> bool {
        let timers = self.timers();
        let is_watched = |timer: &ClientTimer| {
            !timer.has_lapsed && client.is_none_or(|client| client == timer.client)
        };
        self.needed.is_none() || timers.clients.iter().any(is_watched)
    }

    /// Whether force flows, for the reports.
    pub fn note_force(&self, has_force: bool) {
        self.timers().has_force = has_force;
    }

    /// What was switched off since the last call, oldest first.
    pub fn take_reports(&self) -> Vec<OffReport> {
        core::mem::take(&mut self.timers().reports)
    }

    /// The run is over: [`Self::watch`] returns.
    pub fn end(&self) {
        self.timers().is_over = true;
        self.changed.notify_all();
    }

    /// Watches until the end; for a thread of its own. Where it panics, the run stops.
    pub fn watch(&self) {
        let _unwatched = StopOnPanic(&self.control);
        let mut timers = self.timers();
        while !timers.is_over {
            let now = Instant::now();
            let next = self.look(&mut timers, now);
            let patience = next.map_or(IDLE, |next| next.saturating_duration_since(now));
            timers = self
                .changed
                .wait_timeout(timers, patience)
                .unwrap_or_else(PoisonError::into_inner)
                .0;
        }
    }

    /// Switches force off where that is due. Gives when to look again.
    fn look(&self, timers: &mut Timers, now: Instant) -> Option<Instant> {
        let is_silent = timers.clients.iter().any(|timer| timer.is_due(now));
        let is_unwatched = self.needed.is_some()
            && timers.clients.iter().all(|timer| timer.has_lapsed || timer.is_due(now));
        let is_wrong = is_unwatched && self.control.allows_force();
        if is_silent || is_wrong {
            self.control.disable();
        }
        let had_force = timers.has_force;
        let Timers { clients, reports, .. } = timers;
        for timer in clients.iter_mut().filter(|timer| timer.is_due(now)) {
            timer.has_lapsed = true;
            reports.push(OffReport { reason: OffReason::Silent(timer.longest), had_force });
        }
        if is_wrong && !is_silent {
            reports.push(OffReport { reason: OffReason::NoClient, had_force });
        }
        let unwatched = is_unwatched.then(|| now + UNWATCHED);
        timers.clients.iter().filter_map(ClientTimer::until).chain(unwatched).min()
    }

    fn report(&self, mut timers: MutexGuard<'_, Timers>, reason: OffReason) {
        let had_force = timers.has_force;
        timers.reports.push(OffReport { reason, had_force });
        // Without this client there may be none left that the scene needs.
        self.changed.notify_all();
    }

    fn timers(&self) -> MutexGuard<'_, Timers> {
        // Every statement above leaves a list that holds together.
        self.timers.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

struct StopOnPanic<'c>(&'c Control);

impl Drop for StopOnPanic<'_> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            self.0.stop();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rt::control::Order;

    const HUNG: Duration = Duration::from_secs(60);

    /// A watchdog that watches while `then` happens.
    fn watched(needed: Option<Duration>, then: impl FnOnce(&DriveWatchdog, &Control)) {
        let control = Arc::new(Control::enabled());
        let watchdog = DriveWatchdog::new(control.clone(), needed);
        std::thread::scope(|scope| {
            scope.spawn(|| watchdog.watch());
            // A test that fails must not leave the thread behind.
            let _end = End(&watchdog);
            then(&watchdog, &control);
        });
    }

    struct End<'w>(&'w DriveWatchdog);

    impl Drop for End<'_> {
        fn drop(&mut self) {
            self.0.end();
        }
    }

    fn wait_until(mut is_it: impl FnMut() -> bool) {
        let began = Instant::now();
        while !is_it() {
            assert!(began.elapsed() < HUNG, "it did not come to that");
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    /// Waits until force is off, and gives the reports.
    fn reasons(watchdog: &DriveWatchdog, control: &Control) -> Vec<OffReason> {
        wait_until(|| control.order() == Order::Disable);
        // The report is written after the disable, under the same lock.
        watchdog.take_reports().iter().map(|report| report.reason).collect()
    }

    /// The same, and lets force flow again.
    fn off(watchdog: &DriveWatchdog, control: &Control) -> Vec<OffReason> {
        let reasons = reasons(watchdog, control);
        control.enable(control.permit());
        reasons
    }

    #[test]
    fn silence_and_a_lost_client_switch_force_off_and_a_client_that_signs_off_does_not() {
        watched(None, |watchdog, control| {
            assert!(watchdog.lets_enable(None) && watchdog.lets_enable(Some(3)));
            assert_eq!(watchdog.beat(3, Some(SHORTEST), Instant::now()), SHORTEST);
            assert_eq!(off(watchdog, control), [OffReason::Silent(SHORTEST)]);
            watchdog.beat(4, Some(LONGEST), Instant::now());
            watchdog.lose(4);
            assert_eq!(control.order(), Order::Disable, "in the call itself");
            assert_eq!(off(watchdog, control), [OffReason::Lost]);
            watchdog.beat(5, Some(LONGEST), Instant::now());
            assert_eq!(watchdog.beat(5, Some(Duration::ZERO), Instant::now()), Duration::ZERO);
            watchdog.lose(5);
            assert_eq!(control.order(), Order::Enable);
            // The client that was silent is not missed either.
            watchdog.lose(3);
            assert_eq!((control.order(), watchdog.take_reports()), (Order::Enable, vec![]));
            watchdog.expel("does not read");
            assert_eq!(off(watchdog, control), [OffReason::Expelled("does not read")]);
        });
    }

    #[test]
    fn life_counts_from_when_bytes_came() {
        watched(None, |watchdog, control| {
            let long_ago = Instant::now().checked_sub(LONGEST).expect("a machine that is up");
            watchdog.beat(1, Some(LONGEST), long_ago);
            assert_eq!(off(watchdog, control), [OffReason::Silent(LONGEST)]);
            watchdog.note_message(1, long_ago);
            assert_eq!(off(watchdog, control), [OffReason::Silent(LONGEST)], "worked off late");
            watchdog.note_message(1, Instant::now());
            // The thread has looked meanwhile.
            std::thread::sleep(5 * UNWATCHED);
            assert_eq!(control.order(), Order::Enable);
        });
    }

    #[test]
    fn a_silence_is_within_its_bounds_whatever_a_client_asks_for() {
        watched(None, |watchdog, control| {
            assert_eq!(watchdog.beat(1, Some(Duration::MAX), Instant::now()), LONGEST);
            assert_eq!(watchdog.beat(2, Some(Duration::from_nanos(1)), Instant::now()), SHORTEST);
            assert_eq!(off(watchdog, control), [OffReason::Silent(SHORTEST)]);
        });
    }

    #[test]
    fn a_run_stops_where_its_watchdog_panics() {
        let control = Control::enabled();
        let panicked = std::thread::scope(|scope| {
            let watch = scope.spawn(|| {
                let _unwatched = StopOnPanic(&control);
                assert!(control.is_ending(), "a panic on purpose");
            });
            watch.join().is_err()
        });
        assert!(panicked && control.order() == Order::Stop);
    }

    #[test]
    fn a_client_that_was_silent_guards_again_from_its_next_message_on() {
        watched(Some(LONGEST), |watchdog, control| {
            // No client was there at the beginning.
            assert_eq!(reasons(watchdog, control), [OffReason::NoClient]);
            watchdog.beat(1, Some(SHORTEST), Instant::now());
            let note = || watchdog.note_message(1, Instant::now());
            let beat = || _ = watchdog.beat(1, None, Instant::now());
            for say in [&note, &beat, &note] as [&dyn Fn(); 3] {
                say();
                control.enable(control.permit());
                // On a busy machine it was silent before force was let flow, and that is off again.
                let reasons = reasons(watchdog, control);
                assert_eq!(reasons.first(), Some(&OffReason::Silent(SHORTEST)));
                assert!(!watchdog.lets_enable(None), "no client counts while it is silent");
            }
            watchdog.beat(1, Some(LONGEST), Instant::now());
            control.enable(control.permit());
            assert!(watchdog.lets_enable(Some(1)));
            watchdog.lose(1);
            assert_eq!(reasons(watchdog, control), [OffReason::Lost]);
            assert!(!watchdog.lets_enable(Some(1)));
        });
    }

    #[test]
    fn a_scene_that_needs_a_heartbeat_has_no_force_without() {
        let needed = Duration::from_millis(200);
        watched(Some(needed), |watchdog, control| {
            assert!(!watchdog.lets_enable(None));
            // Also without any word from the loop that force flows.
            assert_eq!(off(watchdog, control), [OffReason::NoClient]);
            assert_eq!(off(watchdog, control), [OffReason::NoClient], "at each enable");
            let longest = watchdog.beat(1, Some(LONGEST), Instant::now());
            assert_eq!(longest, needed, "no longer than the scene allows");
            assert!(
                watchdog.lets_enable(Some(1))
                    && watchdog.lets_enable(None)
                    && !watchdog.lets_enable(Some(2))
            );
        });
    }

    #[test]
    fn a_silence_is_noticed_while_another_repeats() {
        watched(Some(LONGEST), |watchdog, control| {
            // Any number of silences at the same time are one disable, and a report each.
            let long_ago = Instant::now().checked_sub(LONGEST).expect("a machine that is up");
            watchdog.note_force(true);
            wait_until(|| control.order() == Order::Disable);
            for client in 0..5 {
                watchdog.beat(client, Some(LONGEST), long_ago);
            }
            let mut silent = 0;
            wait_until(|| {
                silent += watchdog
                    .take_reports()
                    .iter()
                    .filter(|report| report.reason == OffReason::Silent(LONGEST))
                    .inspect(|report| assert!(report.had_force))
                    .count();
                silent == 5
            });
        });
    }

    #[test]
    fn a_client_that_was_silent_is_none_and_where_one_is_needed_the_next_look_is_soon() {
        let begin = Instant::now();
        let end = begin + SHORTEST;
        for needed in [None, Some(LONGEST)] {
            let control = Arc::new(Control::enabled());
            let watchdog = DriveWatchdog::new(control.clone(), needed);
            let look = |now: Instant| watchdog.look(&mut watchdog.timers(), now);
            watchdog.beat(1, Some(SHORTEST), begin);
            assert_eq!(look(begin), Some(end));
            assert_eq!((control.order(), watchdog.take_reports()), (Order::Enable, vec![]));
            let soon = needed.map(|_| end + UNWATCHED);
            assert_eq!(look(end), soon);
            assert_eq!(off(&watchdog, &control), [OffReason::Silent(SHORTEST)]);
            // Force flows again, and no client has sent anything.
            assert_eq!(look(end), soon);
            let is_off = control.order() == Order::Disable;
            let reports = watchdog.take_reports();
            assert_eq!((is_off, reports.len()), (needed.is_some(), usize::from(is_off)));
            assert!(reports.iter().all(|report| report.reason == OffReason::NoClient));
        }
    }
}
