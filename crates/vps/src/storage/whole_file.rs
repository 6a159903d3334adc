//! The files that this program leaves to a person: whole or not at all, never through a link, and
//! private where they show what a person did.
//!
//! Under its own name there is what was there before, until all of a new file is written. A link is
//! refused: in a folder that others may write to it may lead to any file of this user. The links of
//! the system to open files of this process, such as /dev/stdout, are written to.

use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, ErrorKind, Write};
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};

/// Who may read a new file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// Its owner: recordings, sessions and traces, which show what a person did.
    Private,
    /// Everyone whom the umask of the user allows: meshes, tables, pictures, pages, scenes.
    Shared,
}

impl Access {
    const fn mode(self) -> u32 {
        match self {
            Self::Private => 0o600,
            Self::Shared => 0o666,
        }
    }
}

/// What there is under a name.
enum Target {
    Nothing,
    File,
    /// A device or a pipe is written to; a file in its place would be the end of it.
    Device,
}

/// A link of the system to an open file of this process: it leads where the user has led it.
fn is_open_file(path: &Path) -> bool {
    let folder = path.parent();
    ["/dev/stdout", "/dev/stderr"].into_iter().any(|link| path == Path::new(link))
        || ["/dev/fd", "/proc/self/fd"].into_iter().any(|own| folder == Some(Path::new(own)))
}

impl Target {
    fn of(path: &Path) -> io::Result<Self> {
        let there = match fs::symlink_metadata(path) {
            Ok(there) => there,
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(Self::Nothing),
            Err(error) => return Err(error),
        };
        if there.is_symlink() && is_open_file(path) {
            return Ok(Self::Device);
        }
        if there.is_symlink() {
            let to = fs::read_link(path)?;
            let text = format!("it is a link to {}: name that file itself", to.display());
            return Err(io::Error::new(ErrorKind::InvalidInput, text));
        }
        let kind = fs::metadata(path)?.file_type();
        match (kind.is_file(), kind.is_dir()) {
            (true, _) => Ok(Self::File),
            (_, true) => Err(io::Error::new(ErrorKind::IsADirectory, "it is a folder")),
            _ => Ok(Self::Device),
        }
    }
}

/// Creates a file, for what grows while it is read; one that is there is refused.
fn create(path: &Path, access: Access) -> io::Result<File> {
    OpenOptions::new().write(true).create_new(true).mode(access.mode()).open(path)
}

/// A new file beside the one whose name it takes in [`Self::place`]; without that it goes. A killed
/// program leaves it, as `.NAME.PID-N.tmp`.
#[derive(Debug)]
pub struct NewFile {
    beside: PathBuf,
    path: PathBuf,
}

impl NewFile {
    /// Creates it.
    ///
    /// # Errors
    /// Any error of the file system; what has the name is a link, a folder or a device, or may not
    /// be written to.
    pub fn beside(path: &Path, access: Access) -> io::Result<(Self, File)> {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        match Target::of(path)? {
            Target::Nothing => {}
            // One that may not be written to is not replaced either.
            Target::File => drop(OpenOptions::new().write(true).open(path)?),
            Target::Device => return Err(io::Error::new(ErrorKind::InvalidInput, "it is no file")),
        }
        let name = path.file_name().ok_or(ErrorKind::IsADirectory)?.to_string_lossy();
        loop {
            // Relaxed: only that no two are equal.
            let number = COUNT.fetch_add(1, Ordering::Relaxed);
            let beside =
                path.with_file_name(format!(".{name}.{}-{number}.tmp", std::process::id()));
            match create(&beside, access) {
                // Left by one that was killed under the same number, as happens in containers.
                Err(error) if error.kind() == ErrorKind::AlreadyExists => {}
                created => return Ok((Self { beside, path: path.to_owned() }, created?)),
            }
        }
    }

    /// Gives it its name.
    ///
    /// # Errors
    /// Any error of the file system; then it is gone.
    pub fn place(self) -> io::Result<()> {
        fs::rename(&self.beside, &self.path)
    }
}

impl Drop for NewFile {
    fn drop(&mut self) {
        // Not there any more where it has its name; else what cannot be removed stays.
        let _ = fs::remove_file(&self.beside);
    }
}

/// Opens a file that grows while it is read; a device or a pipe is written to. One that is there is
/// refused, or `overwrites`: then it stays until the new one is placed.
///
/// # Errors
/// As [`NewFile::beside`].
pub fn growing(
    path: &Path,
    access: Access,
    overwrites: bool,
) -> io::Result<(File, Option<NewFile>)> {
    match Target::of(path)? {
        Target::File if overwrites => {
            let (new, file) = NewFile::beside(path, access)?;
            Ok((file, Some(new)))
        }
        Target::Device if overwrites => Ok((OpenOptions::new().write(true).open(path)?, None)),
        _ => Ok((create(path, access)?, None)),
    }
}

/// What can be known of a file that is yet to be written: its folder is there and takes a file of
/// this name, which is made and taken away again, and a file that is there may be written to.
///
/// # Errors
/// Why it cannot be written.
pub fn check(path: &Path) -> io::Result<()> {
    let folder =
        path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let refused = |kind, text: String| Err(io::Error::new(kind, text));
    if !folder.exists() {
        return refused(ErrorKind::NotFound, format!("there is no folder {}", folder.display()));
    } else if !folder.is_dir() {
        return refused(ErrorKind::NotADirectory, format!("{} is no folder", folder.display()));
    }
    match Target::of(path)? {
        Target::File => OpenOptions::new().write(true).open(path).map(drop),
        // Opening it may be felt at its other end.
        Target::Device => Ok(()),
        Target::Nothing => create(path, Access::Private).and_then(|_| fs::remove_file(path)),
    }
}

/// Writes bytes that everyone may read, as [`write_whole`].
///
/// # Errors
/// As [`write_whole`].
pub fn write_bytes(path: &Path, bytes: &[u8]) -> io::Result<()> {
    write_whole(path, Access::Shared, |file| file.write_all(bytes))
}

/// Writes beside the file and takes its name at the end: a full disk, or a program that is killed,
/// leaves what was there before. A device or a pipe is written to.
///
/// # Errors
/// As [`NewFile::beside`]; then there is nothing beside.
pub fn write_whole(
    path: &Path,
    access: Access,
    contents: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>,
) -> io::Result<()> {
    if let Target::Device = Target::of(path)? {
        return write_to(OpenOptions::new().write(true).open(path)?, contents, |_| Ok(()));
    }
    let (new, file) = NewFile::beside(path, access)?;
    write_to(file, contents, File::sync_all)?;
    new.place()
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

    const SHARED: Access = Access::Shared;

    #[test]
    fn a_link_is_refused_by_every_way_to_write_and_what_it_leads_to_stays() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::write(at("file"), b"first").unwrap();
        std::os::unix::fs::symlink("file", at("link")).unwrap();
        std::os::unix::fs::symlink("nothing", at("ahead")).unwrap();
        std::os::unix::fs::symlink("/dev/null", at("device")).unwrap();
        for link in ["link", "ahead", "device"] {
            let link = at(link);
            for written in [
                write_bytes(&link, b"second"),
                growing(&link, Access::Private, true).map(drop),
                growing(&link, Access::Private, false).map(drop),
                NewFile::beside(&link, Access::Private).map(drop),
                check(&link),
            ] {
                let text = written.unwrap_err().to_string();
                assert!(text.starts_with("it is a link to "), "{text}");
            }
        }
        assert_eq!(fs::read(at("file")).unwrap(), b"first");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 4);
    }

    #[test]
    fn only_links_to_open_files_of_this_process_are_written_to() {
        for link in ["/dev/stdout", "/dev/stderr", "/dev/fd/7", "/proc/self/fd/1"] {
            assert!(is_open_file(Path::new(link)), "{link}");
        }
        for link in [
            "/dev/shm/scene.toml",
            "/dev/fd/../shm/scene.toml",
            "/dev/disk/by-id/disk",
            "/proc/1/fd/1",
            "stdout",
        ] {
            assert!(!is_open_file(Path::new(link)), "{link}");
        }
        let file = tempfile::NamedTempFile::new().unwrap();
        let number = std::os::fd::AsRawFd::as_raw_fd(file.as_file());
        let link = PathBuf::from(format!("/proc/self/fd/{number}"));
        check(&link).unwrap();
        write_bytes(&link, b"first").unwrap();
        assert_eq!(fs::read(file.path()).unwrap(), b"first");
    }

    #[test]
    fn what_shows_a_person_is_private_whatever_was_there_before() {
        use std::os::unix::fs::PermissionsExt as _;
        let folder = tempfile::tempdir().unwrap();
        let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode() & 0o777;
        let [new, old] = ["new", "old"].map(|name| folder.path().join(name));
        fs::write(&old, "for all").unwrap();
        fs::set_permissions(&old, fs::Permissions::from_mode(0o644)).unwrap();
        let (_, placed) = growing(&old, Access::Private, true).unwrap();
        placed.unwrap().place().unwrap();
        growing(&new, Access::Private, true).unwrap();
        assert_eq!((mode(&new), mode(&old)), (0o600, 0o600));
        write_bytes(&old, b"for all").unwrap();
        let umask = 0o666 & !mode(&old);
        assert!(umask & 0o400 == 0 && mode(&new) == 0o600, "{umask:o}");
        write_whole(&old, Access::Private, |file| file.write_all(b"mine")).unwrap();
        assert_eq!(mode(&old), 0o600);
    }

    #[test]
    fn what_is_no_file_is_written_to() {
        let folder = tempfile::tempdir().unwrap();
        let pipe = folder.path().join("pipe");
        assert!(std::process::Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        let mut reader = File::options().read(true).write(true).open(&pipe).unwrap();
        write_whole(&pipe, SHARED, |file| file.write_all(b"third")).unwrap();
        let mut read = [0; 5];
        io::Read::read_exact(&mut reader, &mut read).unwrap();
        assert!(read == *b"third" && !fs::metadata(&pipe).unwrap().is_file());
    }

    #[test]
    fn what_fails_half_way_leaves_the_file_before_and_nothing_beside() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("piece.ply");
        write_whole(&path, SHARED, |file| file.write_all(b"first")).unwrap();
        let error = write_whole(&path, SHARED, |file| {
            file.write_all(b"half of the sec")?;
            Err(io::ErrorKind::StorageFull.into())
        });
        assert_eq!(error.unwrap_err().kind(), io::ErrorKind::StorageFull);
        assert_eq!(fs::read(&path).unwrap(), b"first");
        write_whole(&path, SHARED, |file| file.write_all(b"second")).unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"second");
        assert!(write_whole(folder.path(), SHARED, |_| Ok(())).is_err());
        assert!(
            write_whole(&folder.path().join("no/such/folder.ply"), SHARED, |_| Ok(())).is_err()
        );
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
        write_whole(&path, SHARED, |file| file.write_all(b"whole")).unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"whole");
    }
}
