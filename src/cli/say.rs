//! Where every word leaves the program: results on stdout, talk on stderr.
//!
//! `println!` panics when the reader is gone (`hapticd check … | head`) or the disk is full. While an arm is being rendered a panic of the
//! talking thread would leave the loop alone, so nothing here panics: lost talk is lost, a lost result becomes the exit code.

use std::fmt;
use std::io::{self, Write as _};
use std::sync::OnceLock;

use super::{Talk, report};
use crate::error::Exit;

/// Why the first result that did not arrive did not.
static LOST_RESULT: OnceLock<io::Error> = OnceLock::new();

/// Writes a result to stdout.
pub(crate) fn result(text: fmt::Arguments<'_>) {
    if let Err(error) = io::stdout().write_all(text.to_string().as_bytes()) {
        let _ = LOST_RESULT.set(error);
    }
}

/// Writes talk to stderr at once.
pub(crate) fn talk(text: fmt::Arguments<'_>) {
    // One write, so that lines of other processes do not cut in. If it fails, nobody is left to be told.
    let _ = io::stderr().write_all(text.to_string().as_bytes());
}

/// The last word: a result that could not be delivered spoils a good ending. A reader that has seen enough does not.
pub(crate) fn finish(exit: Exit, talk: Talk) -> Exit {
    if let Err(error) = io::stdout().flush() {
        let _ = LOST_RESULT.set(error);
    }
    match LOST_RESULT.get() {
        Some(error) if error.kind() != io::ErrorKind::BrokenPipe => {
            report::error(&format!("cannot write the result to stdout: {error}"), None, talk);
            if exit == Exit::Ok { Exit::Asset } else { exit }
        }
        _ => exit,
    }
}
