//! Opening files by foreign names: regular files only.
//!
//! To open a pipe waits for its writer, a device may have no end, and to open a serial port already
//! resets the board behind it. So what is no regular file is refused by its kind before it is
//! opened, and once more afterwards, as the name may have been given to something else meanwhile:
//! nothing here waits for another program. What is read whole has a bound on its bytes, as a file
//! may have holes and so be larger than any disk.

use std::fs::{self, File, FileType, OpenOptions};
use std::io::{self, ErrorKind, Read};
use std::os::unix::fs::{FileTypeExt as _, OpenOptionsExt as _};
use std::path::Path;

/// Bytes of a text that a person writes (a scene, a profile, a file of strokes) at most: a hundred
/// times the longest that is known. What a parser makes of it takes some fifty times as much.
pub const WRITTEN_BYTES_MAX: u64 = 4 << 20;

/// Opens a regular file for reading; a link to one will do.
///
/// # Errors
/// Those of the operating system, and what is no regular file: its kind is in the message.
pub fn open(path: &Path) -> io::Result<File> {
    refuse_others(fs::metadata(path)?.file_type())?;
    // A pipe that took the place of the file would wait for its writer, and a terminal would become
    // ours.
    let file =
        OpenOptions::new().read(true).custom_flags(libc::O_NONBLOCK | libc::O_NOCTTY).open(path)?;
    refuse_others(file.metadata()?.file_type())?;
    Ok(file)
}

/// Reads a regular file of at most `max_bytes`.
///
/// # Errors
/// As [`open`], and a file that is longer.
pub fn bytes(path: &Path, max_bytes: u64) -> io::Result<Vec<u8>> {
    let file = open(path)?;
    let n_bytes = file.metadata()?.len();
    let mut bytes = Vec::with_capacity(usize::try_from(n_bytes.min(max_bytes)).unwrap_or_default());
    // One more than may be there: the file may grow, or not say how long it is, as those of /proc.
    file.take(max_bytes.saturating_add(1)).read_to_end(&mut bytes)?;
    if n_bytes > max_bytes || bytes.len() as u64 > max_bytes {
        return Err(io::Error::new(
            ErrorKind::FileTooLarge,
            format!("it has more than the {max_bytes} bytes that are read of such a file"),
        ));
    }
    Ok(bytes)
}

/// Reads a regular file of at most `max_bytes` as text.
///
/// # Errors
/// As [`bytes`], and what is no UTF-8.
pub fn text(path: &Path, max_bytes: u64) -> io::Result<String> {
    String::from_utf8(bytes(path, max_bytes)?)
        .map_err(|_| io::Error::new(ErrorKind::InvalidData, "it is no text in UTF-8"))
}

/// A text that a person writes, see [`WRITTEN_BYTES_MAX`].
///
/// # Errors
/// As [`text`].
pub fn written(path: &Path) -> io::Result<String> {
    text(path, WRITTEN_BYTES_MAX)
}

fn refuse_others(kind: FileType) -> io::Result<()> {
    let word = match kind {
        kind if kind.is_file() => return Ok(()),
        kind if kind.is_dir() => return Err(ErrorKind::IsADirectory.into()),
        kind if kind.is_fifo() => "a fifo",
        kind if kind.is_socket() => "a socket",
        kind if kind.is_char_device() || kind.is_block_device() => "a device",
        _ => "something else",
    };
    Err(io::Error::new(ErrorKind::InvalidInput, format!("it is {word}, not a regular file")))
}

#[cfg(test)]
mod tests {
    use std::os::unix::net::UnixListener;
    use std::process::Command;
    use std::time::Instant;

    use super::*;

    #[test]
    fn what_is_no_regular_file_is_refused_at_once_by_its_kind() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        assert!(Command::new("mkfifo").arg(at("fifo")).status().unwrap().success());
        let _listener = UnixListener::bind(at("socket")).unwrap();
        std::os::unix::fs::symlink("/dev/zero", at("link")).unwrap();
        let since = Instant::now();
        for (path, kind) in [
            (at("fifo"), "it is a fifo, not a regular file"),
            (at("socket"), "it is a socket, not a regular file"),
            (at("link"), "it is a device, not a regular file"),
            ("/dev/null".into(), "it is a device, not a regular file"),
            (folder.path().to_owned(), "is a directory"),
        ] {
            for refused in
                [open(&path).map(drop), bytes(&path, 10).map(drop), written(&path).map(drop)]
            {
                assert_eq!(refused.unwrap_err().to_string(), kind, "{}", path.display());
            }
        }
        assert!(since.elapsed().as_secs() < 5, "an open waited");
        assert_eq!(open(&at("none")).unwrap_err().kind(), ErrorKind::NotFound);
    }

    #[test]
    fn files_and_links_to_them_are_read_up_to_their_bound() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("text");
        let link = folder.path().join("link");
        fs::write(&path, "0123456789").unwrap();
        std::os::unix::fs::symlink(&path, &link).unwrap();
        assert_eq!(text(&link, 10).unwrap(), "0123456789");
        let refused = text(&link, 9).unwrap_err();
        assert!(
            refused.kind() == ErrorKind::FileTooLarge && refused.to_string().contains("9 bytes"),
            "{refused}"
        );
        // Holes, which take no room on the disk.
        File::options().write(true).open(&path).unwrap().set_len(1 << 40).unwrap();
        assert_eq!(written(&path).unwrap_err().kind(), ErrorKind::FileTooLarge);
        fs::write(&path, [0xff, 0xfe]).unwrap();
        assert!(written(&path).unwrap_err().to_string().contains("UTF-8"));
        // Without a length of its own.
        assert!(!bytes(Path::new("/proc/self/status"), 1 << 20).unwrap().is_empty());
        assert_eq!(
            bytes(Path::new("/proc/self/status"), 3).unwrap_err().kind(),
            ErrorKind::FileTooLarge
        );
    }
}
