//! Files that are yet to be written: what can be known of them before the work, and what to do when
//! it fails.

use std::fs::{self, File};
use std::io::{Error, ErrorKind};
use std::path::Path;

use super::error::CliError;
use super::{OutputOptions, report};

/// What can be known of a file that is yet to be written: its folder is there and takes a file of
/// this name, which is made and taken away again, and a file that is there may be written to.
pub(super) fn check(path: &Path) -> Result<(), Error> {
    let folder =
        path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    if path.is_dir() {
        return Err(Error::new(ErrorKind::IsADirectory, "it is a folder"));
    } else if !folder.exists() {
        return Err(Error::new(
            ErrorKind::NotFound,
            format!("there is no folder {}", folder.display()),
        ));
    } else if !folder.is_dir() {
        return Err(Error::new(
            ErrorKind::NotADirectory,
            format!("{} is no folder", folder.display()),
        ));
    }
    match fs::metadata(path) {
        Ok(there) if there.is_file() => File::options().write(true).open(path).map(drop),
        // A device or a pipe: opening it may be felt at its other end.
        Ok(_) => Ok(()),
        // A link to nothing yet.
        Err(_) if path.is_symlink() => Ok(()),
        Err(_) => {
            drop(File::create_new(path)?);
            fs::remove_file(path)
        }
    }
}

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
