//! What to do about files that cannot be written.

use std::fs;
use std::io::{Error, ErrorKind};
use std::path::Path;

use super::error::CliError;
use super::{OutputOptions, report};

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

/// Refuses to write over a file.
pub(super) fn is_there(file: &Path) -> CliError {
    CliError::usage(format_args!("{} is there already", file.display()))
        .hint("name another file, or give --overwrite")
}

/// Makes a folder for pictures where there is none.
pub(super) fn make_picture_folder(folder: &Path, output: OutputOptions) -> Result<(), CliError> {
    let shown = folder.display();
    let is_new = !folder.exists();
    fs::create_dir_all(folder).map_err(|error| {
        CliError::asset(format_args!("cannot make the folder {shown}: {error}")).hint(hint(&error))
    })?;
    if is_new {
        report::note(&format!("made the folder {shown} for pictures"), output);
    }
    Ok(())
}
