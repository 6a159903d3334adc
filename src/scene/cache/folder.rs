//! The files of a cache folder: written aside and renamed, swept, kept below a size.

use std::fs::{self, DirEntry, File, OpenOptions};
use std::io::{self, BufWriter};
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, SystemTime};

use vps::storage::sections::Key;

const EXTENSION: &str = "bake";
const TEMPORARY: &str = "tmp";
/// A temporary file that was not written to for so long is abandoned.
const ABANDONED: Duration = Duration::from_secs(600);

/// Where the object of a key is.
pub(super) fn path(folder: &Path, key: &Key) -> PathBuf {
    folder.join(format!("{:032x}.{EXTENSION}", u128::from_be_bytes(*key)))
}

/// Notes that a file was used. Not being able to is no harm: it will be thought older than it is.
pub(super) fn touch(file: &File) {
    let _ = file.set_modified(SystemTime::now());
}

/// Writes a file so that it appears whole or not at all, then removes what has not been used for
/// longest while the folder is larger than `limit_bytes` (never the new one).
pub(super) fn write(
    folder: &Path,
    key: &Key,
    limit_bytes: u64,
    contents: impl FnOnce(&mut BufWriter<&File>) -> io::Result<()>,
) -> io::Result<()> {
    fs::create_dir_all(folder)?;
    sweep(folder);
    let to = path(folder, key);
    let temporary = Temporary::create(&to)?;
    let mut out = BufWriter::with_capacity(1 << 20, &temporary.file);
    contents(&mut out)?;
    out.into_inner().map_err(io::IntoInnerError::into_error)?;
    temporary.file.sync_all()?;
    fs::rename(&temporary.path, &to)?;
    prune(folder, &to, limit_bytes);
    Ok(())
}

/// A file under a name of its own, gone with this value unless it was renamed.
struct Temporary {
    path: PathBuf,
    file: File,
}

impl Temporary {
    fn create(to: &Path) -> io::Result<Self> {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        // Relaxed: only that no two are equal.
        let number = COUNT.fetch_add(1, Ordering::Relaxed);
        let path = to.with_extension(format!("{}-{number}.{TEMPORARY}", std::process::id()));
        // Read-only for other users and processes from the start: none changes it by accident.
        let file = OpenOptions::new().write(true).create_new(true).mode(0o444).open(&path)?;
        Ok(Self { path, file })
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        // Fails after the rename, which is as it should be.
        let _ = fs::remove_file(&self.path);
    }
}

fn entries(folder: &Path, extension: &str) -> Vec<(DirEntry, u64, SystemTime)> {
    let Ok(entries) = fs::read_dir(folder) else { return Vec::new() };
    entries
        .flatten()
        .filter(|entry| entry.path().extension().is_some_and(|found| found == extension))
        .filter_map(|entry| {
            let metadata = entry.metadata().ok().filter(fs::Metadata::is_file)?;
            Some((entry, metadata.len(), metadata.modified().ok()?))
        })
        .collect()
}

/// Removes what killed processes left behind.
fn sweep(folder: &Path) {
    for (entry, _, modified) in entries(folder, TEMPORARY) {
        if modified.elapsed().is_ok_and(|age| age > ABANDONED) {
            let _ = fs::remove_file(entry.path());
        }
    }
}

fn prune(folder: &Path, keep: &Path, limit_bytes: u64) {
    let mut files = entries(folder, EXTENSION);
    files.sort_by_key(|(.., modified)| *modified);
    let mut total_bytes: u64 = files.iter().map(|(_, bytes, _)| bytes).sum();
    for (entry, bytes, _) in files {
        if total_bytes <= limit_bytes {
            break;
        }
        if entry.path() != keep && fs::remove_file(entry.path()).is_ok() {
            total_bytes -= bytes;
        }
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write as _;

    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let mut names: Vec<_> = fs::read_dir(folder)
            .unwrap()
            .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
            .collect();
        names.sort();
        names
    }

    fn age(path: &Path, seconds: u64) {
        File::open(path)
            .unwrap()
            .set_modified(SystemTime::now() - Duration::from_secs(seconds))
            .unwrap();
    }

    #[test]
    fn a_file_appears_whole_or_not_at_all() {
        let dir = tempfile::tempdir().unwrap();
        let folder = dir.path().join("a/b");
        write(&folder, &[1; 16], u64::MAX, |out| out.write_all(b"whole")).unwrap();
        assert_eq!(fs::read(path(&folder, &[1; 16])).unwrap(), b"whole");
        let failed = write(&folder, &[1; 16], u64::MAX, |out| {
            out.write_all(&[0; 3 << 20])?;
            Err(io::Error::other("on purpose"))
        });
        assert!(failed.is_err());
        assert_eq!(fs::read(path(&folder, &[1; 16])).unwrap(), b"whole", "the one before stays");
        assert_eq!(names(&folder), ["01010101010101010101010101010101.bake"]);
        write(&folder, &[1; 16], u64::MAX, |out| out.write_all(b"new")).unwrap();
        assert_eq!(fs::read(path(&folder, &[1; 16])).unwrap(), b"new");
        assert!(fs::metadata(path(&folder, &[1; 16])).unwrap().permissions().readonly());
    }

    #[test]
    fn what_was_left_behind_is_swept_and_what_is_being_written_is_not() {
        let dir = tempfile::tempdir().unwrap();
        for name in ["old.1-0.tmp", "new.2-0.tmp", "notes.txt"] {
            fs::write(dir.path().join(name), "x").unwrap();
        }
        age(&dir.path().join("old.1-0.tmp"), 3600);
        age(&dir.path().join("notes.txt"), 3600);
        write(dir.path(), &[2; 16], u64::MAX, |_| Ok(())).unwrap();
        assert_eq!(
            names(dir.path()),
            ["02020202020202020202020202020202.bake", "new.2-0.tmp", "notes.txt"]
        );
    }

    #[test]
    fn beyond_the_limit_the_longest_unused_go_first() {
        let dir = tempfile::tempdir().unwrap();
        let write = |n: u8, limit_bytes| {
            write(dir.path(), &[n; 16], limit_bytes, |out| out.write_all(&[n; 100])).unwrap()
        };
        let is_there = |n: u8| path(dir.path(), &[n; 16]).exists();
        for n in 0..4 {
            write(n, 400);
            age(&path(dir.path(), &[n; 16]), 100 - u64::from(n));
        }
        assert!((0..4).all(is_there));
        touch(&File::open(path(dir.path(), &[0; 16])).unwrap());
        write(4, 400);
        assert_eq!([0, 1, 2, 3, 4].map(is_there), [true, false, true, true, true]);
        write(5, 50);
        assert_eq!(
            [0, 2, 3, 4, 5].map(is_there),
            [false, false, false, false, true],
            "the new one stays, however large"
        );
    }
}
