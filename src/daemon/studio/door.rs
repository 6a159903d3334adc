//! Where pages, consoles and scripts knock.

use std::fmt;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use crossbeam::channel::{Receiver, Sender, TrySendError, bounded};

use clay::studio::{Order, StudioError, View};

/// Orders that may wait.
const WAITING_MAX: usize = 64;

/// Hears, once, what became of an order: on the studio's thread, or at once where it is refused at the door. Must not block.
pub type Reply = Box<dyn FnOnce(Result<(), Refused>) + Send>;

/// Why an order was not carried out.
#[derive(Debug, thiserror::Error)]
pub enum Refused {
    /// The studio tried.
    #[error("{0}")]
    Studio(#[from] StudioError),
    /// Too many at once.
    #[error("{WAITING_MAX} orders are waiting for the studio already")]
    Busy,
    /// The run has ended, or goes on without its studio.
    #[error("the studio is over")]
    Over,
}

impl Refused {
    /// What to do about it.
    pub fn hint(&self) -> &'static str {
        match self {
            Self::Studio(error) => error.hint(),
            Self::Busy => "wait until the ones before are answered",
            Self::Over => "begin the scene again",
        }
    }
}

/// An order and who hears of it: dropped unheard, it hears that the studio is over.
pub(super) struct Asked {
    pub(super) order: Order,
    reply: Option<Reply>,
}

impl Asked {
    pub(super) fn answer(mut self, result: Result<(), Refused>) {
        if let Some(reply) = self.reply.take() {
            reply(result);
        }
    }
}

impl Drop for Asked {
    fn drop(&mut self) {
        if let Some(reply) = self.reply.take() {
            reply(Err(Refused::Over));
        }
    }
}

#[derive(Default)]
struct Window {
    newest: Mutex<Option<Arc<View>>>,
    /// Somebody has looked since the last view was made.
    is_watched: AtomicBool,
}

/// The way to a studio for everybody but the loop. Cheap to clone.
#[derive(Clone)]
pub struct Door {
    asks: Sender<Asked>,
    window: Arc<Window>,
}

impl fmt::Debug for Door {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Door").field("waiting", &self.asks.len()).finish_non_exhaustive()
    }
}

impl Door {
    /// Asks for something; `reply` hears once what became of it. Never blocks; refused while too many wait, and when the studio is over.
    pub fn ask(&self, order: Order, reply: Reply) {
        match self.asks.try_send(Asked { order, reply: Some(reply) }) {
            Ok(()) => {}
            Err(TrySendError::Full(asked)) => asked.answer(Err(Refused::Busy)),
            Err(TrySendError::Disconnected(asked)) => asked.answer(Err(Refused::Over)),
        }
    }

    /// The newest view of the piece; `None` before the first one. Views are made while somebody looks, some tens of times a second: the one
    /// after a long silence is as old as that. Samples of a large piece come less often: copying them takes at most a tenth of the studio's time.
    pub fn view(&self) -> Option<Arc<View>> {
        // Relaxed: one view sooner or later makes no difference.
        self.window.is_watched.store(true, Ordering::Relaxed);
        self.window.newest.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

/// The studio's side of its door.
pub(super) struct Desk {
    pub(super) asks: Receiver<Asked>,
    window: Arc<Window>,
}

impl Desk {
    /// Somebody wants a newer view.
    pub(super) fn is_watched(&self) -> bool {
        self.window.is_watched.load(Ordering::Relaxed)
    }

    pub(super) fn hang_out(&self, view: View) {
        self.window.is_watched.store(false, Ordering::Relaxed);
        *self.window.newest.lock().unwrap_or_else(PoisonError::into_inner) = Some(Arc::new(view));
    }

    /// The way to tell that the studio has broken, when the desk has gone with it.
    pub(super) fn last_words(&self) -> LastWords {
        LastWords(self.window.clone())
    }
}

/// What is seen of a studio that has broken.
pub(super) struct LastWords(Arc<Window>);

impl LastWords {
    /// From now on the last view says that nothing happens any more, and why.
    pub(super) fn hang_out(&self, why: &str) {
        let mut newest = self.0.newest.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(view) = newest.as_deref() {
            let trouble = format!("the studio has ended, and the clay stays as it is: {why}; end the run to save what was done");
            *newest = Some(Arc::new(View { is_stroke: false, is_over: true, trouble: trouble.into(), ..view.clone() }));
        }
    }
}

pub(super) fn pair() -> (Door, Desk) {
    let (asks, asked) = bounded(WAITING_MAX);
    let window = Arc::new(Window::default());
    (Door { asks, window: window.clone() }, Desk { asks: asked, window })
}
