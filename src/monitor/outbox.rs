//! What waits to be sent to one client: words, none of which may be lost, and states, of which only
//! the newest count.

use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use axum::extract::ws::Message;
use tokio::sync::Notify;

use super::encode::EncodedState;
use engine::drive_watchdog::DriveWatchdog;

/// Messages under way; a client that lets more of them pile up does not read.
const MOST_WORDS: usize = 1024;
/// The same in bytes: a reply repeats what the client wrote.
const MOST_WORD_BYTES: usize = 1 << 20;
/// The states of so long wait at most, s.
const STATES_S: f64 = 0.05;
/// Going away (RFC 6455).
pub(super) const AWAY: u16 = 1001;
/// The client does not do its part.
pub(super) const POLICY: u16 = 1008;
/// Why a client is expelled that takes nothing.
const DEAF: &str = "does not read";

/// The queue of one client.
#[derive(Debug)]
pub(super) struct ClientQueue {
    waiting: Mutex<Waiting>,
    changed: Notify,
    /// Switches force off when the client is expelled.
    drive: Arc<DriveWatchdog>,
}

#[derive(Debug, Default)]
struct Waiting {
    words: VecDeque<String>,
    /// Of all words.
    n_bytes: usize,
    states: VecDeque<Arc<EncodedState>>,
    /// States that this client was sent.
    sent: u64,
    /// States that were due and will not be sent.
    dropped: u64,
    ends: Option<(u16, &'static str)>,
}

/// What to do next for a client.
#[derive(Debug)]
pub(super) enum OutboxAction {
    /// Send these.
    Send(Vec<Message>),
    /// Close, with a code and a reason.
    Close(u16, &'static str),
}

impl ClientQueue {
    pub(super) fn new(drive: Arc<DriveWatchdog>) -> Self {
        Self { waiting: Mutex::default(), changed: Notify::new(), drive }
    }

    /// Words, in order.
    pub(super) fn say(&self, words: String) {
        let mut waiting = self.waiting();
        if waiting.ends.is_some() {
            return;
        }
        if waiting.words.len() >= MOST_WORDS || waiting.n_bytes + words.len() > MOST_WORD_BYTES {
            drop(waiting);
            return self.expel_deaf();
        }
        waiting.n_bytes += words.len();
        waiting.words.push_back(words);
        drop(waiting);
        self.changed.notify_one();
    }

    /// A state; it replaces the oldest one. `missed`: states that were due since the last one, of
    /// ticks that never came here.
    pub(super) fn show(&self, state: Arc<EncodedState>, rate_hz: f64, missed: u64) {
        let most = ((rate_hz * STATES_S).ceil() as usize).max(2);
        let mut waiting = self.waiting();
        // What keeps coming would keep the end away.
        if waiting.ends.is_some() {
            return;
        }
        waiting.dropped += missed;
        while waiting.states.len() >= most {
            waiting.states.pop_front();
            waiting.dropped += 1;
        }
        waiting.states.push_back(state);
        drop(waiting);
        self.changed.notify_one();
    }

    /// Nothing more: the client or the run ends the connection.
    pub(super) fn end(&self, code: u16, reason: &'static str) {
        self.close(code, reason);
    }

    /// Nothing more: the server ends the connection for what the client did. An order to switch
    /// force off may be on its way, so that is done here.
    pub(super) fn expel(&self, code: u16, reason: &'static str) {
        if self.close(code, reason) {
            self.drive.expel(reason);
        }
    }

    /// The same for a client that takes nothing.
    pub(super) fn expel_deaf(&self) {
        self.expel(POLICY, DEAF);
    }

    /// False where the connection was ending already.
    fn close(&self, code: u16, reason: &'static str) -> bool {
        let mut waiting = self.waiting();
        let is_first = waiting.ends.is_none();
        waiting.ends.get_or_insert((code, reason));
        drop(waiting);
        self.changed.notify_one();
        is_first
    }

    /// True when the connection is ending: whatever is asked now finds no answer.
    pub(super) fn has_ended(&self) -> bool {
        self.waiting().ends.is_some()
    }

    /// Waits for something to do.
    pub(super) async fn next(&self) -> OutboxAction {
        loop {
            if let Some(next) = self.take() {
                return next;
            }
            self.changed.notified().await;
        }
    }

    fn take(&self) -> Option<OutboxAction> {
        let mut waiting = self.waiting();
        waiting.n_bytes = 0;
        let mut messages: Vec<_> = waiting.words.drain(..).map(Message::from).collect();
        let Waiting { states, sent, dropped, .. } = &mut *waiting;
        messages.extend(states.drain(..).map(|state| {
            *sent += 1;
            state.message(*sent, *dropped)
        }));
        match (messages.is_empty(), waiting.ends) {
            (false, _) => Some(OutboxAction::Send(messages)),
            (true, Some((code, reason))) => Some(OutboxAction::Close(code, reason)),
            (true, None) => None,
        }
    }

    fn waiting(&self) -> MutexGuard<'_, Waiting> {
        // Queues hold together after every statement above.
        self.waiting.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rt::control::{Control, Order};

    fn queue() -> (ClientQueue, Arc<Control>) {
        let control = Arc::new(Control::enabled());
        (ClientQueue::new(Arc::new(DriveWatchdog::new(control.clone(), None))), control)
    }

    fn words(next: Option<OutboxAction>) -> Vec<String> {
        match next {
            Some(OutboxAction::Send(messages)) => {
                messages.iter().map(|message| message.to_text().expect("text").to_owned()).collect()
            }
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn states_make_room_for_newer_ones_and_words_do_not() {
        let (outbox, _) = queue();
        assert!(outbox.take().is_none());
        for tick in 0..5 {
            outbox.say(format!("word {tick}"));
            outbox.show(Arc::new(EncodedState::Text(format!("{{\"tick\":{tick}}}"))), 60.0, 0);
        }
        let reported = words(outbox.take());
        assert_eq!(reported[..5], ["word 0", "word 1", "word 2", "word 3", "word 4"]);
        assert_eq!(reported[5], r#"{"type":"state","seq":1,"dropped":2,"tick":2}"#);
        assert_eq!(
            (reported.len(), &reported[7][..]),
            (8, r#"{"type":"state","seq":3,"dropped":2,"tick":4}"#)
        );
        assert!(outbox.take().is_none());
        outbox.show(Arc::new(EncodedState::Text(r#"{"tick":9}"#.to_owned())), 60.0, 5);
        assert_eq!(
            words(outbox.take()),
            [r#"{"type":"state","seq":4,"dropped":7,"tick":9}"#],
            "ticks that were lost on the way count"
        );
    }

    #[test]
    fn nothing_more_comes_between_a_client_and_its_end() {
        let (outbox, control) = queue();
        for _ in 0..MOST_WORDS {
            outbox.say(String::new());
        }
        assert_eq!(control.order(), Order::Enable);
        outbox.say(String::new());
        assert_eq!(control.order(), Order::Disable, "what it asked for last may be lost");
        assert_eq!(words(outbox.take()).len(), MOST_WORDS);
        outbox.say("late".to_owned());
        outbox.show(Arc::new(EncodedState::Text("{}".to_owned())), 60.0, 0);
        assert!(matches!(outbox.take(), Some(OutboxAction::Close(POLICY, _))));
    }

    #[test]
    fn who_never_reads_is_closed_at_the_end_of_what_is_there() {
        let (outbox, _) = queue();
        for _ in 0..=MOST_WORDS {
            outbox.say(String::new());
        }
        outbox.end(AWAY, "later");
        assert_eq!(words(outbox.take()).len(), MOST_WORDS);
        assert!(matches!(outbox.take(), Some(OutboxAction::Close(POLICY, _))));
        let (outbox, _) = queue();
        (0..3).for_each(|_| outbox.say("x".repeat(MOST_WORD_BYTES / 2)));
        assert_eq!(words(outbox.take()).len(), 2);
        assert!(matches!(outbox.take(), Some(OutboxAction::Close(POLICY, _))));
    }

    #[test]
    fn the_end_of_a_run_and_of_a_client_leave_force_as_it_is() {
        let (outbox, control) = queue();
        outbox.end(AWAY, "the run is over");
        outbox.expel(POLICY, "too late");
        assert_eq!(control.order(), Order::Enable);
        assert!(matches!(outbox.take(), Some(OutboxAction::Close(AWAY, _))));
    }
}
