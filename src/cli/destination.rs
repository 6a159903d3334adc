//! Files that are yet to be written: what can be known of them before the work, and what to do when it fails.

use std::io::{Error, ErrorKind};
use std::path::Path;

/// What can be known of a file that is yet to be written without touching it.
pub(super) fn check(path: &Path) -> Result<(), Error> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let refusal = if path.is_dir() {
        ErrorKind::IsADirectory
    } else if !folder.exists() {
        ErrorKind::NotFound
    } else if !folder.is_dir() {
        ErrorKind::NotADirectory
    } else {
        return Ok(());
    };
    Err(refusal.into())
}

/// What to do about a file that cannot be written.
pub(super) fn hint(error: &Error) -> Option<&'static str> {
    match error.kind() {
        ErrorKind::NotFound => Some("the folder must exist"),
        ErrorKind::IsADirectory => Some("give a file name, not a folder"),
        ErrorKind::PermissionDenied | ErrorKind::ReadOnlyFilesystem => Some("choose a folder that this user may write to"),
        _ => None,
    }
}
