//! Slots for connections: which have one, and which give way.
//!
//! A connection has a slot of its own from its first request on that was let in. Until then, half a
//! request, a wrong token or a reader of the page among them, it keeps its slot for as long as no
//! other connection needs it: when all are taken, the oldest of these is closed for the new one. So
//! an order to take force away arrives however many other connections are open.

use core::sync::atomic::{AtomicBool, Ordering};
use core::task::Context;
use std::collections::VecDeque;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use futures_util::task::AtomicWaker;
use tokio::sync::Semaphore;

/// All slots of a server.
#[derive(Debug)]
pub(super) struct ConnectionSlots {
    most: usize,
    taken: Mutex<Taken>,
    /// For connections that are being shut out, which have no slot any more, or never had one.
    pub(super) leaving: Arc<Semaphore>,
}

#[derive(Debug, Default)]
struct Taken {
    n: usize,
    /// Those that have to give way, the oldest first.
    pending: VecDeque<Arc<ConnectionState>>,
}

/// A connection as its slot knows it. The flags are `Relaxed`: each is the whole message, and all
/// are on one thread but in tests.
#[derive(Debug, Default)]
pub(super) struct ConnectionState {
    has_asked: AtomicBool,
    is_known: AtomicBool,
    is_web_socket: AtomicBool,
    must_leave: AtomicBool,
    /// Of the task that serves it.
    waker: AtomicWaker,
}

impl ConnectionState {
    /// It has sent a whole request, and was not refused.
    pub(super) fn asks(&self) {
        self.has_asked.store(true, Ordering::Relaxed);
    }

    pub(super) fn has_asked(&self) -> bool {
        self.has_asked.load(Ordering::Relaxed)
    }

    pub(super) fn become_web_socket(&self) {
        self.is_web_socket.store(true, Ordering::Relaxed);
    }

    pub(super) fn is_web_socket(&self) -> bool {
        self.is_web_socket.load(Ordering::Relaxed)
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

    /// A slot for a new connection: a free one, or that of the oldest connection without access.
    /// `None`: all others have.
    pub(super) fn take(self: &Arc<Self>) -> Option<ConnectionSlot> {
        let mut taken = self.taken();
        if taken.n < self.most {
            taken.n += 1;
        } else {
            let oldest = taken.pending.pop_front()?;
            oldest.must_leave.store(true, Ordering::Relaxed);
            oldest.waker.wake();
        }
        let state = Arc::new(ConnectionState::default());
        taken.pending.push_back(state.clone());
        Some(ConnectionSlot { state, slots: self.clone() })
    }

    /// A request of this connection was let in: it keeps its slot.
    pub(super) fn let_in(&self, state: &Arc<ConnectionState>) {
        state.asks();
        if !state.is_known.swap(true, Ordering::Relaxed) {
            self.taken().pending.retain(|other| !Arc::ptr_eq(other, state));
        }
    }

    fn taken(&self) -> MutexGuard<'_, Taken> {
        // Every statement leaves numbers and a list that hold together.
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
    /// It is kept until the connection ends.
    pub(super) fn is_kept(&self) -> bool {
        self.state.is_known.load(Ordering::Relaxed) && !self.is_gone()
    }

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
            taken.pending.retain(|other| !Arc::ptr_eq(other, &self.state));
        }
    }
}

#[cfg(test)]
mod tests {
    use core::task::Waker;

    use super::*;

    #[test]
    fn only_the_oldest_that_was_not_let_in_gives_way() {
        let slots = ConnectionSlots::new(3, 1);
        let mut held: Vec<ConnectionSlot> = (0..3).filter_map(|_| slots.take()).collect();
        assert!(held.len() == 3 && !slots.has_room());
        slots.let_in(&held[0].state);
        // Looking at the page is not enough.
        held[1].state.asks();
        let gone = |held: &[ConnectionSlot]| {
            held.iter()
                .map(|slot| slot.state.must_leave(&Context::from_waker(Waker::noop())))
                .collect::<Vec<_>>()
        };
        held.extend(slots.take());
        assert_eq!(gone(&held), [false, true, false, false]);
        held.extend(slots.take());
        assert_eq!(gone(&held), [false, true, true, false, false]);
        // What is let in too late has no slot any more.
        slots.let_in(&held[1].state);
        assert!(!held[1].is_kept() && held[0].is_kept());
        slots.let_in(&held[3].state);
        slots.let_in(&held[4].state);
        assert!(slots.take().is_none());
        // Those that had to go give nothing back, those that had a slot do.
        held.drain(1..3);
        assert!(!slots.has_room() && slots.take().is_none());
        held.remove(0);
        assert!(slots.has_room());
        drop(slots.take());
        held.clear();
        assert_eq!(
            (0..9).filter_map(|_| slots.take()).collect::<Vec<_>>().len(),
            9,
            "each at the cost of an older one, or of none"
        );
        assert!(slots.has_room() && slots.taken().pending.is_empty());
    }
}
