//! A link with its codec, and the next one when it is lost.

use core::time::Duration;
use std::io;
use std::time::Instant;

use rtrb::{Consumer, Producer, PushError, RingBuffer};

use super::RoundTrip;
use crate::guard::Guard;
use crate::parameters::WiredParameters;
use crate::protocol::{Codec, MotorCommand};
use crate::transport::{Frame, Transport, TransportError};

/// Zeros that a lost arm is sent before its link is closed, as long as the link takes any, and the
/// time between two.
const LAST_ZEROS: usize = 5;
const BETWEEN_ZEROS: Duration = Duration::from_millis(2);
/// How long a link stays open after its last frame: bytes of a tty pass through a worker of the
/// kernel, and a close may overtake them. An arm that did not get its zero would hold its force
/// until its watchdog lets go.
const LINGER: Duration = Duration::from_millis(10);
/// How long the end of a program may wait until a lost link is closed: as long as that may take with
/// the process behind it.
const END_PATIENCE: Duration = Duration::from_secs(3);

/// An opened link with a codec that has been through its start.
pub(crate) struct Connection {
    /// The link.
    pub(crate) link: Box<dyn Transport>,
    /// The codec.
    pub(crate) codec: Box<dyn Codec>,
    /// What takes the force away where this process no longer can: `None` where it was not asked
    /// for or is not needed, an error where it could not start.
    pub(crate) guard: io::Result<Option<Guard>>,
}

/// Where an arm leaves the connection that it has lost and finds the next one. The other ends
/// belong to the reconnect thread, which is cold.
///
/// There is never more than one connection: the next one is opened only after the lost one was
/// handed over and closed, and a connection that is handed over is the whole message that the arm
/// is lost.
pub(crate) struct Replacements {
    /// New ones.
    pub(crate) fresh: Consumer<Connection>,
    /// Lost ones: they are sent zero and closed where that may wait.
    pub(crate) spent: Producer<Connection>,
}

impl Connection {
    /// Reports to the guard that the loop turns, and whether any force was commanded. RT: safe.
    pub(super) fn beat(&mut self, has_force: bool) {
        if let Ok(Some(guard)) = &mut self.guard {
            guard.beat(has_force);
        }
    }

    /// True, once, after the guard took the force away because the loop stood still. RT: safe.
    pub(super) fn has_guard_acted(&mut self) -> bool {
        if let Ok(Some(guard)) = &mut self.guard { guard.has_acted() } else { false }
    }

    /// The guard has not looked for more ticks than these: it was stopped or has ended. Once a tick.
    /// RT: safe.
    pub(super) fn is_unwatched(&mut self, most_ticks: u32) -> bool {
        match &mut self.guard {
            Ok(Some(guard)) => guard.is_missing(most_ticks),
            Ok(None) | Err(_) => false,
        }
    }

    /// It was lost because its guard was missing.
    pub(crate) fn has_lost_guard(&self) -> bool {
        matches!(&self.guard, Ok(Some(guard)) if guard.was_missing())
    }

    /// What is known of the way to the arm before it is used.
    pub(super) fn round_trip(&self, parameters: &WiredParameters) -> RoundTrip {
        match self.codec.round_trip_s() {
            Some(trip_s) => RoundTrip::over_network((trip_s / parameters.period_s).ceil() as u32),
            None => RoundTrip::starting_at(parameters.delay_ticks),
        }
    }

    /// Makes the frame of a zero command; empty when there is none. `in_step`: the arm has answered
    /// the last command, so a new one begins where the arm expects one. RT: safe.
    pub(super) fn zero(&mut self, in_step: bool, frame: &mut Frame) {
        frame.clear();
        if !in_step {
            self.codec.zero_out_of_step(frame);
        }
        if frame.is_empty() {
            self.codec.encode(&MotorCommand::default(), frame);
        }
    }

    /// Sends a zero in the place of everything that has not left, and another one: what was dropped
    /// may have ended in the middle of a frame, and spoilt the first. RT: safe.
    pub(super) fn send_last_zero(&mut self) -> Result<(), TransportError> {
        let mut frame = Frame::default();
        self.zero(false, &mut frame);
        if frame.is_empty() {
            // An arm without motors.
            return Ok(());
        }
        self.link.send_now(frame.as_slice())?;
        self.zero(false, &mut frame);
        self.link.send(frame.as_slice())
    }

    /// Sends a lost arm zero for as long as its link takes bytes, and closes it; whether it took
    /// all. Cold: it waits.
    pub(crate) fn let_go(mut self) -> bool {
        let takes = (0..LAST_ZEROS).all(|_| {
            let is_open =
                !matches!(self.send_last_zero(), Err(TransportError::Lost | TransportError::Os(_)));
            std::thread::sleep(BETWEEN_ZEROS);
            is_open
        });
        self.codec.finish_lost(&mut *self.link);
        std::thread::sleep(LINGER);
        takes
    }

    /// Says what a protocol has to say at the end, and closes the link. Cold: it waits.
    pub(crate) fn close(mut self) {
        self.codec.finish(&mut *self.link);
        std::thread::sleep(LINGER);
    }
}

impl Replacements {
    /// Gives a lost connection away; back where the queue is full; one connection always finds a
    /// place. RT: safe.
    pub(super) fn give_away(&mut self, connection: Connection) -> Option<Connection> {
        self.spent.push(connection).err().map(|PushError::Full(connection)| connection)
    }

    /// Lets the reconnect thread end, and waits until it has closed what it holds. Cold.
    pub(super) fn wait_for_end(&mut self) {
        // Without this end of the queue it looks for no arm any more.
        self.fresh = RingBuffer::new(1).1;
        let begin = Instant::now();
        while !self.spent.is_abandoned() && begin.elapsed() < END_PATIENCE {
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    /// The next connection, if there is one. RT: safe.
    pub(super) fn take(&mut self) -> Option<Connection> {
        self.fresh.pop().ok()
    }
}
