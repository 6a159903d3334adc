//! How much work an order may be, and how it ends before it is done.
//!
//! A step is a look at a sample, a node or a neighbour: some tens of nanoseconds. Each loop that is
//! longer than what lies under a brush takes its steps from a meter, some milliseconds of work at a
//! time. So no such loop goes on after it was cancelled, and none is longer than was estimated
//! ([`WorkEstimate`](super::clay_model::WorkEstimate)).

use core::sync::atomic::{AtomicU64, Ordering};
use std::fmt;
use std::sync::Arc;

/// Steps of a sample in a search tree that is built, and of a search for the nearest.
pub(super) const TREE_STEPS: u64 = 16;
/// Steps of a fit, for each neighbour.
pub(super) const FIT_STEPS: u64 = 8;
/// Steps of the side on which a place far from the samples lies.
pub(super) const SIDE_STEPS: u64 = 16;

/// Asked again and again while work goes on; true: the work ends, and the clay is as it was.
#[derive(Clone)]
pub struct Cancel(Arc<dyn Fn() -> bool + Send + Sync>);

impl Cancel {
    /// Work that goes on until this is true. It is asked from many threads, and must not block.
    pub fn when(is_cancelled: impl Fn() -> bool + Send + Sync + 'static) -> Self {
        Self(Arc::new(is_cancelled))
    }

    /// The work is to end.
    pub(super) fn is_cancelled(&self) -> bool {
        (self.0)()
    }
}

impl Default for Cancel {
    /// Never.
    fn default() -> Self {
        Self::when(|| false)
    }
}

impl fmt::Debug for Cancel {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Cancel")
    }
}

/// Why work ended before it was done.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum WorkError {
    /// [`Cancel`] said so.
    #[error(
        "the work was cancelled, because the run ends or a client that controls it has gone; the \
            clay is as it was"
    )]
    Cancelled,
    /// It was longer than was estimated.
    #[error("the work took more than the {most} steps that were estimated; the clay is as it was")]
    TooLong {
        /// Steps that it could have taken.
        most: u64,
    },
}

impl WorkError {
    /// What to do about it.
    pub(super) fn hint(&self) -> &'static str {
        match self {
            Self::Cancelled => "give the order again",
            Self::TooLong { .. } => "take a smaller solid or image, or fewer samples",
        }
    }
}

/// Counts the steps of one order.
#[derive(Debug)]
pub struct WorkMeter {
    cancel: Cancel,
    taken: AtomicU64,
    most: u64,
}

impl WorkMeter {
    /// For work of so many steps at most.
    pub(super) fn new(cancel: Cancel, most: u64) -> Self {
        Self { cancel, taken: AtomicU64::new(0), most }
    }

    /// For work that nothing ends.
    pub fn unlimited() -> Self {
        Self::new(Cancel::default(), u64::MAX)
    }

    /// Takes steps, before or after they are done.
    ///
    /// # Errors
    /// The work is to end.
    pub(super) fn take(&self, steps: u64) -> Result<(), WorkError> {
        // Relaxed: a count, and no other data depends on it.
        let before = self.taken.fetch_add(steps, Ordering::Relaxed);
        if self.cancel.is_cancelled() {
            return Err(WorkError::Cancelled);
        }
        if before.saturating_add(steps) > self.most {
            return Err(WorkError::TooLong { most: self.most });
        }
        Ok(())
    }
}
