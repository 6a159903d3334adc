//! A file that appears whole or not at all: under its own name there is what was there before,
//! until all of it is written.

use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::Path;
use std::sync::atomic::{AtomicU32, Ordering};

/// Writes bytes, as [`write_whole`].
///
/// # Errors
/// As [`write_whole`].
pub fn write_bytes(path: &Path, bytes: &[u8]) -> io::Result<()> {
    write_whole(path, |file| file.write_all(bytes))
}

/// Writes beside the file and takes its name at the end: a full disk, or a program that is killed,
/// leaves what was there before. A killed program leaves the file beside it, `.NAME.PID-N.tmp`.
///
/// # Errors
/// Any error of the file system; then there is nothing beside.
pub fn write_whole(
    path: &Path,
    contents: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>,
) -> io::Result<()> {
    static COUNT: AtomicU32 = AtomicU32::new(0);
    match fs::metadata(path) {
        // A device or a pipe is written to; a file in its place would be the end of it.
        Ok(there) if !there.is_file() && !there.is_dir() => {
            return write_to(File::options().write(true).open(path)?, contents, |_| Ok(()));
        }
        // Through a link, which stays one.
        Ok(_) if path.is_symlink() => return write_whole(&fs::canonicalize(path)?, contents),
        _ => {}
    }
    // Renaming a file over a folder fails as well, but only after all of it has been written.
    let name = path.file_name().filter(|_| !path.is_dir()).ok_or(io::ErrorKind::IsADirectory)?;
    let (beside, file) = loop {
        // Relaxed: only that no two are equal.
        let number = COUNT.fetch_add(1, Ordering::Relaxed);
        let beside = path.with_file_name(format!(
            ".{}.{}-{number}.tmp",
            name.to_string_lossy(),
            std::process::id()
        ));
        match File::create_new(&beside) {
            // Left by one that was killed under the same number, as happens in containers.
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
            created => break (beside, created?),
        }
    };
    let written = write_to(file, contents, File::sync_all).and_then(|()| fs::rename(&beside, path));
    if written.is_err() {
        let _ = fs::remove_file(&beside);
    }
    written
}

fn write_to(
    file: File,
    contents: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>,
    sync: impl FnOnce(&File) -> io::Result<()>,
) -> io::Result<()> {
    let mut file = BufWriter::with_capacity(1 << 20, file);
    contents(&mut file)?;
    file.flush()?;
    sync(&file.into_inner().map_err(io::IntoInnerError::into_error)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_link_stays_a_link_and_what_is_no_file_is_written_to() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("file");
        let link = folder.path().join("link");
        let pipe = folder.path().join("pipe");
        fs::write(&file, b"first").unwrap();
        std::os::unix::fs::symlink(&file, &link).unwrap();
        write_whole(&link, |file| file.write_all(b"second")).unwrap();
        assert!(link.is_symlink() && fs::read(&file).unwrap() == b"second");
        assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        let mut reader = File::options().read(true).write(true).open(&pipe).unwrap();
        write_whole(&pipe, |file| file.write_all(b"third")).unwrap();
        let mut read = [0; 5];
        io::Read::read_exact(&mut reader, &mut read).unwrap();
        assert!(read == *b"third" && !fs::metadata(&pipe).unwrap().is_file());
    }

    #[test]
    fn what_fails_half_way_leaves_the_file_before_and_nothing_beside() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("piece.ply");
        write_whole(&path, |file| file.write_all(b"first")).unwrap();
        let error = write_whole(&path, |file| {
            file.write_all(b"half of the sec")?;
            Err(io::ErrorKind::StorageFull.into())
        });
        assert_eq!(error.unwrap_err().kind(), io::ErrorKind::StorageFull);
        assert_eq!(fs::read(&path).unwrap(), b"first");
        write_whole(&path, |file| file.write_all(b"second")).unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"second");
        assert!(write_whole(folder.path(), |_| Ok(())).is_err());
        assert!(write_whole(&folder.path().join("no/such/folder.ply"), |_| Ok(())).is_err());
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn what_a_killed_program_left_is_no_hindrance() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("piece.ply");
        for number in 0..1000 {
            fs::write(
                folder.path().join(format!(".piece.ply.{}-{number}.tmp", std::process::id())),
                "half",
            )
            .unwrap();
        }
        write_whole(&path, |file| file.write_all(b"whole")).unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"whole");
    }
}
