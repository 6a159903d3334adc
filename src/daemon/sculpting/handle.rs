//! The way to the clay for pages, consoles and scripts.

use std::fmt;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crossbeam::channel::{Receiver, Sender, TrySendError, bounded};

use crate::config::setting_names::KEYS;
use clay::engine::{ClayView, EngineError, SculptOrder};

/// Orders that may wait.
const WAITING_MAX: usize = 64;

/// Called once with what became of an order: on the thread of the clay, or at once where it is
/// refused. Must not block.
pub type Reply = Box<dyn FnOnce(Result<(), OrderError>) + Send>;

/// Why an order was not carried out.
#[derive(Debug, thiserror::Error)]
pub enum OrderError {
    /// It was tried.
    #[error("{0}")]
    Engine(#[from] EngineError),
    /// Too many at once.
    #[error("{WAITING_MAX} orders for the clay are waiting already")]
    Busy,
    /// The run has ended, or goes on while the clay stays as it is.
    #[error("the clay takes no more orders")]
    Over,
}

impl OrderError {
    /// What to do about it.
    pub fn hint(&self) -> String {
        match self {
            Self::Engine(error) => error.hint(&KEYS),
            Self::Busy => "wait until the ones before are answered".to_owned(),
            Self::Over => "begin the scene again".to_owned(),
        }
    }
}

/// An order that waits. Dropped without an answer, it calls its reply with that.
pub(super) struct WaitingOrder {
    pub(super) order: SculptOrder,
    /// Cancels before it was given.
    pub(super) cancels: u64,
    reply: Option<Reply>,
}

impl WaitingOrder {
    pub(super) fn answer(mut self, result: Result<(), OrderError>) {
        if let Some(reply) = self.reply.take() {
            reply(result);
        }
    }
}

impl Drop for WaitingOrder {
    fn drop(&mut self) {
        if let Some(reply) = self.reply.take() {
            reply(Err(OrderError::Over));
        }
    }
}

/// The newest view, and whether a newer one is wanted.
#[derive(Default)]
pub(super) struct ViewCell {
    newest: Mutex<Option<Arc<ClayView>>>,
    /// A client has looked since the last view was made.
    is_watched: AtomicBool,
}

impl ViewCell {
    /// A newer view is wanted.
    pub(super) fn is_watched(&self) -> bool {
        self.is_watched.load(Ordering::Relaxed)
    }

    pub(super) fn publish(&self, view: ClayView) {
        self.is_watched.store(false, Ordering::Relaxed);
        *self.newest() = Some(Arc::new(view));
    }

    /// From now on the last view says that nothing happens any more, and why.
    pub(super) fn end(&self, why: &str) {
        let mut newest = self.newest();
        if let Some(view) = newest.as_deref() {
            let trouble = format!(
                "sculpting has ended, and the clay stays as it is: {why}; end the run to save what \
                    was done"
            );
            *newest = Some(Arc::new(ClayView {
                is_stroke: false,
                is_over: true,
                trouble: trouble.into(),
                ..view.clone()
            }));
        }
    }

    fn newest(&self) -> MutexGuard<'_, Option<Arc<ClayView>>> {
        self.newest.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The way to the clay for everything but the loop. Cheap to clone.
#[derive(Clone)]
pub struct ClayHandle {
    orders: Sender<WaitingOrder>,
    /// How often work was cancelled.
    cancels: Arc<AtomicU64>,
    view: Arc<ViewCell>,
}

impl fmt::Debug for ClayHandle {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ClayHandle").field("waiting", &self.orders.len()).finish_non_exhaustive()
    }
}

impl ClayHandle {
    /// Asks for something; `reply` is called once with what became of it. Never blocks; refused
    /// while too many wait, and when the clay takes no more orders.
    pub fn ask(&self, order: SculptOrder, reply: Reply) {
        let cancels = self.cancels.load(Ordering::Relaxed);
        match self.orders.try_send(WaitingOrder { order, cancels, reply: Some(reply) }) {
            Ok(()) => {}
            Err(TrySendError::Full(waiting)) => waiting.answer(Err(OrderError::Busy)),
            Err(TrySendError::Disconnected(waiting)) => waiting.answer(Err(OrderError::Over)),
        }
    }

    /// Cancels what takes long, of the order that is carried out and of those that wait: the clay
    /// is as it was before. Never blocks.
    pub fn cancel(&self) {
        // Relaxed: no other data depends on it.
        self.cancels.fetch_add(1, Ordering::Relaxed);
    }

    /// The newest view of the clay; `None` before the first one. Views are made while a client
    /// looks, some tens of times a second: the one after a long silence is as old as that. During a
    /// stroke the samples of a large model come less often: copying them takes at most a tenth of
    /// the thread's time.
    pub fn view(&self) -> Option<Arc<ClayView>> {
        // Relaxed: one view sooner or later makes no difference.
        self.view.is_watched.store(true, Ordering::Relaxed);
        self.view.newest().clone()
    }
}

/// The thread's end of a handle: orders in, views out.
pub(super) struct HandleEnd {
    pub(super) orders: Receiver<WaitingOrder>,
    pub(super) cancels: Arc<AtomicU64>,
    pub(super) view: Arc<ViewCell>,
}

pub(super) fn pair() -> (ClayHandle, HandleEnd) {
    let (orders, waiting) = bounded(WAITING_MAX);
    let view = Arc::new(ViewCell::default());
    let cancels = Arc::new(AtomicU64::new(0));
    let end = HandleEnd { orders: waiting, cancels: cancels.clone(), view: view.clone() };
    (ClayHandle { orders, cancels, view }, end)
}
