//! A client with a connection, and what it wants to see.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::Instant;

use tokio::sync::Semaphore;

use super::connection_slots::ConnectionState;
use super::outbox::ClientQueue;
use engine::drive_watchdog::DriveWatchdog;

/// Requests of one client that wait to be answered.
const MOST_UNANSWERED: usize = 64;

/// A client with a connection.
#[derive(Debug)]
pub(super) struct Client {
    pub(super) id: u64,
    pub(super) outbox: ClientQueue,
    /// Places for requests that wait for an answer, which may be slow.
    pub(super) unanswered: Arc<Semaphore>,
    wants: Mutex<Option<Subscription>>,
    connection: Arc<ConnectionState>,
}

/// What a client wants to see.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Subscription {
    pub(super) rate_hz: f64,
    pub(super) is_binary: bool,
    pub(super) contacts: bool,
    pub(super) history: bool,
}

impl Client {
    /// One that was sent nothing yet, and wants to see nothing.
    pub(super) fn new(
        id: u64,
        drive: Arc<DriveWatchdog>,
        connection: Arc<ConnectionState>,
    ) -> Self {
        Self {
            id,
            outbox: ClientQueue::new(drive),
            unanswered: Arc::new(Semaphore::new(MOST_UNANSWERED)),
            wants: Mutex::default(),
            connection,
        }
    }

    /// When its bytes came last.
    pub(super) fn heard(&self) -> Instant {
        self.connection.heard()
    }

    /// It has closed its connection, or is gone.
    pub(super) fn has_left(&self) -> bool {
        self.connection.has_left()
    }

    /// What it wants to see, if anything.
    pub(super) fn wants(&self) -> Option<Subscription> {
        *self.wants.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn want(&self, wanted: Option<Subscription>) {
        *self.wants.lock().unwrap_or_else(PoisonError::into_inner) = wanted;
    }
}
