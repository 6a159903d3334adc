//! The waiting part of a start-up dialogue. Cold.

use core::fmt::Write;
use core::time::Duration;
use std::thread;
use std::time::Instant;

use super::StartError;
use crate::transport::{Transport, TransportError};

/// Pause between two looks at a link: shorter than any period that an arm keeps.
const LOOK: Duration = Duration::from_micros(200);

/// A question to an arm.
pub(crate) struct Question<'a> {
    /// What it is, for people.
    pub(crate) step: &'static str,
    /// What is sent; empty: nothing.
    pub(crate) frame: &'a [u8],
    /// How long until it is sent again.
    pub(crate) every: Duration,
    /// For how long.
    pub(crate) within: Duration,
}

impl From<TransportError> for StartError {
    fn from(error: TransportError) -> Self {
        Self::Transport(error)
    }
}

/// Asks until `take` has made an answer of what came.
pub(crate) fn ask<T>(
    link: &mut dyn Transport,
    question: &Question<'_>,
    mut take: impl FnMut(&[u8]) -> Option<Result<T, StartError>>,
) -> Result<T, StartError> {
    let begin = Instant::now();
    let mut next = Duration::ZERO;
    let mut seen = String::new();
    let mut buffer = [0; 512];
    loop {
        let waited = begin.elapsed();
        if waited >= next && !question.frame.is_empty() {
            link.send(question.frame)?;
            next = waited.saturating_add(question.every);
        }
        let n = link.receive(&mut buffer)?;
        if n > 0 {
            let bytes = &buffer[..n];
            if let Some(answer) = take(bytes) {
                return answer;
            }
            for byte in bytes.iter().take(24_usize.saturating_sub(seen.len() / 3)) {
                let _ = write!(seen, "{}{byte:02X}", if seen.is_empty() { "" } else { " " });
            }
        }
        // Checked after bytes too: an arm that babbles for ever is given up like a silent one.
        if waited >= question.within {
            return Err(StartError::Silent { step: question.step, waited: question.within, seen });
        }
        if n == 0 {
            thread::sleep(LOOK);
        }
    }
}

/// Throws away what comes for a while.
pub(super) fn hush(link: &mut dyn Transport, duration: Duration) -> Result<(), TransportError> {
    let begin = Instant::now();
    let mut buffer = [0; 512];
    loop {
        // Not more at once than a burst: an arm that never stops does not hold the start up for
        // ever.
        for _ in 0..64 {
            if link.receive(&mut buffer)? == 0 {
                break;
            }
        }
        if begin.elapsed() >= duration {
            return Ok(());
        }
        thread::sleep(LOOK);
    }
}
