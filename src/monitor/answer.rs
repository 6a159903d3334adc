//! Answers to requests of clients.

use std::path::PathBuf;

use serde_json::Value;

use super::problem::RequestError;
use super::recorder::RecorderStatus;

/// What a request came to.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Completion {
    /// It is done, and there is no more to say.
    Nothing,
    /// An order for the hand is under way.
    HandOrder(u32),
    /// A recording.
    Recording(RecorderStatus),
    /// A file was written.
    Saved(PathBuf),
}

impl Completion {
    /// Adds what there is to say to an answer.
    pub(super) fn tell(&self, answer: &mut Value) {
        match self {
            Self::Nothing => {}
            Self::HandOrder(number) => answer["order"] = (*number).into(),
            Self::Recording(recording) => answer["recording"] = recording.json(),
            Self::Saved(file) => answer["file"] = file.to_string_lossy().into(),
        }
    }
}

/// Called with what became of a request.
pub(super) type Reply = Box<dyn FnOnce(Result<Completion, RequestError>) + Send>;
