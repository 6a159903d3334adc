//! Slots for connections: which have one, and which give way.
//!
//! A WebSocket keeps its slot. Every other connection gives way when all slots are taken and
//! another connection comes: first the oldest of those without an accepted request (half a request,
//! a wrong token, a reader of the page), except the newest of these, then the one on which nothing
//! moved for longest. There are more slots than WebSockets may have. So an order to switch force
//! off finds a slot however many other connections are open.

use core::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use core::task::Context;
use core::time::Duration;
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use futures_util::task::AtomicWaker;
use tokio::sync::Semaphore;

/// The newest connections without an accepted request do not give way while others can: their
/// request may be on its way.
const NEWEST: usize = 64;

/// All slots of a server.
#[derive(Debug)]
pub(super) struct ConnectionSlots {
    most: usize,
    taken: Mutex<Taken>,
    /// For connections that are being closed, which have no slot any more.
    pub(super) leaving: Arc<Semaphore>,
}

#[derive(Debug, Default)]
struct Taken {
    n: usize,
    /// Connections without an accepted request, the oldest first.
    pending: VecDeque<Arc<ConnectionState>>,
    /// Those with one that are no WebSockets.
    accepted: Vec<Arc<ConnectionState>>,
}

impl Taken {
    /// The connection that gives way to another one.
    fn give_way(&mut self) -> Option<Arc<ConnectionState>> {
        if self.pending.len() > NEWEST {
            return self.pending.pop_front();
        }
        let stillest = (0..self.accepted.len()).min_by_key(|idx| self.accepted[*idx].moved());
        match stillest {
            Some(idx) => Some(self.accepted.swap_remove(idx)),
            None => self.pending.pop_front(),
        }
    }

    fn forget(&mut self, state: &Arc<ConnectionState>) {
        self.pending.retain(|other| !Arc::ptr_eq(other, state));
        self.accepted.retain(|other| !Arc::ptr_eq(other, state));
    }
}

/// A connection as its slot, its socket and its requests know it. The fields are `Relaxed`: each is
/// the whole message, and all are on one thread but in tests.
#[derive(Debug)]
pub(super) struct ConnectionState {
    opened: Instant,
    /// When bytes came last, and when they came or went, ns since it was opened.
    heard_ns: AtomicU64,
    moved_ns: AtomicU64,
    has_asked: AtomicBool,
    is_accepted: AtomicBool,
    is_web_socket: AtomicBool,
    has_left: AtomicBool,
    must_leave: AtomicBool,
    /// Of the task that serves it.
    waker: AtomicWaker,
}

impl ConnectionState {
    pub(super) fn new(opened: Instant) -> Self {
        Self {
            opened,
            heard_ns: AtomicU64::new(0),
            moved_ns: AtomicU64::new(0),
            has_asked: AtomicBool::new(false),
            is_accepted: AtomicBool::new(false),
            is_web_socket: AtomicBool::new(false),
            has_left: AtomicBool::new(false),
            must_leave: AtomicBool::new(false),
            waker: AtomicWaker::new(),
        }
    }

    /// Bytes came from its other end.
    pub(super) fn hear(&self, at: Instant) {
        self.heard_ns.store(self.since_opened_ns(at), Ordering::Relaxed);
        self.moves(at);
    }

    /// Its other end took bytes.
    pub(super) fn moves(&self, at: Instant) {
        self.moved_ns.store(self.since_opened_ns(at), Ordering::Relaxed);
    }

    pub(super) fn opened(&self) -> Instant {
        self.opened
    }

    /// When bytes came last.
    pub(super) fn heard(&self) -> Instant {
        self.opened + Duration::from_nanos(self.heard_ns.load(Ordering::Relaxed))
    }

    /// When bytes came or went last.
    pub(super) fn moved(&self) -> Instant {
        self.opened + Duration::from_nanos(self.moved_ns.load(Ordering::Relaxed))
    }

    fn since_opened_ns(&self, at: Instant) -> u64 {
        let since = at.saturating_duration_since(self.opened);
        u64::try_from(since.as_nanos()).unwrap_or(u64::MAX)
    }

    /// It has sent a whole request, and was not refused.
    pub(super) fn asks(&self) {
        self.has_asked.store(true, Ordering::Relaxed);
    }

    pub(super) fn has_asked(&self) -> bool {
        self.has_asked.load(Ordering::Relaxed)
    }

    pub(super) fn is_web_socket(&self) -> bool {
        self.is_web_socket.load(Ordering::Relaxed)
    }

    /// Its other end has closed it, or is gone.
    pub(super) fn leave(&self) {
        self.has_left.store(true, Ordering::Relaxed);
    }

    pub(super) fn has_left(&self) -> bool {
        self.has_left.load(Ordering::Relaxed)
    }

    /// True from the moment on in which another connection got the slot; the task is woken then.
    pub(super) fn must_leave(&self, cx: &Context<'_>) -> bool {
        self.waker.register(cx.waker());
        self.must_leave.load(Ordering::Relaxed)
    }
}

impl ConnectionSlots {
    pub(super) fn new(most: usize, most_leaving: usize) -> Arc<Self> {
        Arc::new(Self {
            most,
            taken: Mutex::default(),
            leaving: Arc::new(Semaphore::new(most_leaving)),
        })
    }

    /// There is a free slot: no connection has to give way.
    pub(super) fn has_room(&self) -> bool {
        self.taken().n < self.most
    }

    /// A slot for a new connection: a free one, or that of a connection that gives way.
    pub(super) fn take(self: &Arc<Self>) -> ConnectionSlot {
        let mut taken = self.taken();
        let given = if taken.n < self.most { None } else { taken.give_way() };
        match given {
            Some(given) => {
                given.must_leave.store(true, Ordering::Relaxed);
                given.waker.wake();
            }
            // All but WebSockets give way, and these are fewer.
            None => taken.n += 1,
        }
        let state = Arc::new(ConnectionState::new(Instant::now()));
        taken.pending.push_back(state.clone());
        drop(taken);
        ConnectionSlot { state, slots: self.clone() }
    }

    /// A request of this connection was accepted.
    pub(super) fn accept(&self, state: &Arc<ConnectionState>) {
        state.asks();
        if !state.is_accepted.swap(true, Ordering::Relaxed) {
            let mut taken = self.taken();
            taken.forget(state);
            if !state.must_leave.load(Ordering::Relaxed) {
                taken.accepted.push(state.clone());
            }
        }
    }

    /// It keeps its slot from now on, unless it had to give way before.
    pub(super) fn become_web_socket(&self, state: &Arc<ConnectionState>) {
        state.is_web_socket.store(true, Ordering::Relaxed);
        self.taken().forget(state);
    }

    fn taken(&self) -> MutexGuard<'_, Taken> {
        // Every statement leaves numbers and lists that hold together.
        self.taken.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// One slot, free again when it is dropped, unless another connection has got it.
#[derive(Debug)]
pub(super) struct ConnectionSlot {
    pub(super) state: Arc<ConnectionState>,
    pub(super) slots: Arc<ConnectionSlots>,
}

impl ConnectionSlot {
    /// Another connection has it.
    pub(super) fn is_gone(&self) -> bool {
        self.state.must_leave.load(Ordering::Relaxed)
    }
}

impl Drop for ConnectionSlot {
    fn drop(&mut self) {
        if !self.is_gone() {
            let mut taken = self.slots.taken();
            taken.n -= 1;
            taken.forget(&self.state);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn held(slots: &Arc<ConnectionSlots>, n: usize) -> Vec<ConnectionSlot> {
        (0..n).map(|_| slots.take()).collect()
    }

    /// Which of these had to give way.
    fn gone(held: &[ConnectionSlot]) -> Vec<usize> {
        (0..held.len()).filter(|idx| held[*idx].is_gone()).collect()
    }

    #[test]
    fn every_connection_gives_way_but_web_sockets() {
        let slots = ConnectionSlots::new(4, 1);
        let mut held = held(&slots, 4);
        assert!(!slots.has_room());
        slots.accept(&held[0].state);
        slots.become_web_socket(&held[0].state);
        slots.accept(&held[1].state);
        slots.accept(&held[2].state);
        // Looking at the page is not enough.
        held[3].state.asks();
        held[1].state.hear(Instant::now() + Duration::from_secs(1));
        held.push(slots.take());
        assert_eq!(gone(&held), [2], "the one on which nothing moved for longest");
        held.push(slots.take());
        assert_eq!(gone(&held), [1, 2]);
        held.push(slots.take());
        assert_eq!(gone(&held), [1, 2, 3], "the oldest of those without a request");
        // What is accepted too late has no slot any more.
        slots.accept(&held[3].state);
        held.push(slots.take());
        assert_eq!(gone(&held), [1, 2, 3, 4]);
        // Those that had to go give nothing back, those that had a slot do.
        held.drain(1..5);
        assert!(!slots.has_room());
        held.clear();
        let taken = slots.taken();
        assert!(taken.n == 0 && taken.pending.is_empty() && taken.accepted.is_empty());
    }

    #[test]
    fn a_crowd_without_requests_pushes_out_itself() {
        let slots = ConnectionSlots::new(3 * NEWEST, 1);
        let mut held = held(&slots, NEWEST);
        held.iter().for_each(|slot| slots.accept(&slot.state));
        held.extend((0..10 * NEWEST).map(|_| slots.take()));
        assert!(held[..NEWEST].iter().all(|slot| !slot.is_gone()));
        let newest = &held[held.len() - NEWEST..];
        assert!(newest.iter().all(|slot| !slot.is_gone()));
        assert_eq!(held.len() - gone(&held).len(), 3 * NEWEST);
    }
}
