//! What to do about files that cannot be written.

use std::io::{Error, ErrorKind};

/// What to do about a file that cannot be written.
pub(super) fn hint(error: &Error) -> Option<&'static str> {
    match error.kind() {
        ErrorKind::NotFound => Some("the folder must exist"),
        ErrorKind::IsADirectory => Some("give a file name, not a folder"),
        ErrorKind::NotADirectory => Some("what should be the folder is a file: name another one"),
        ErrorKind::InvalidFilename => Some("give a shorter name"),
        ErrorKind::PermissionDenied | ErrorKind::ReadOnlyFilesystem => {
            Some("choose a folder that this user may write to")
        }
        _ => None,
    }
}
