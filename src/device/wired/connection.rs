//! A link with what speaks over it, and the next one when it is lost.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use rtrb::{Consumer, Producer};

use super::{RoundTrip, WiredParameters};
use crate::device::protocol::Codec;
use crate::device::transport::Transport;

/// An opened link with a codec that has been through its start.
pub(in crate::device) struct Connection {
    /// The link.
    pub(in crate::device) link: Box<dyn Transport>,
    /// What speaks over it.
    pub(in crate::device) codec: Box<dyn Codec>,
}

/// Where a lost arm finds its next connection. The other ends belong to whoever opens it again, on a cold thread.
pub(in crate::device) struct Replacements {
    /// New ones.
    pub(in crate::device) fresh: Consumer<Connection>,
    /// Old ones: they are closed where closing may wait.
    pub(in crate::device) spent: Producer<Connection>,
    /// Set while the arm is lost.
    pub(in crate::device) lost: Arc<AtomicBool>,
}

impl Connection {
    /// What is known of the way to the arm before it is used.
    pub(super) fn round_trip(&self, parameters: &WiredParameters) -> RoundTrip {
        match self.codec.round_trip_s() {
            Some(trip_s) => RoundTrip::over_network((trip_s / parameters.period_s).ceil() as u32),
            None => RoundTrip::starting_at(parameters.delay_ticks),
        }
    }
}

impl Replacements {
    /// Asks for another connection. RT: safe.
    pub(super) fn ask(&self) {
        // Relaxed: the flag is the whole message.
        self.lost.store(true, Ordering::Relaxed);
    }

    /// Puts the next connection in the place of the lost one, if there is one; that goes where closing it may take its time. RT: safe.
    pub(super) fn exchange(&mut self, connection: &mut Connection) -> bool {
        if self.spent.is_full() {
            return false;
        }
        let Ok(fresh) = self.fresh.pop() else { return false };
        let old = core::mem::replace(connection, fresh);
        let _ = self.spent.push(old);
        self.lost.store(false, Ordering::Relaxed);
        true
    }
}
