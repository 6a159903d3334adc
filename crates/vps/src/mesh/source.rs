//! The bytes of a mesh file: large ones mapped into memory, small ones read.
//!
//! Invariants: only regular files are read, so no pipe or device can feed bytes for ever; a file
//! that cannot fit into the memory that is free is refused before any of it is read. What another
//! program does to a file while it is mapped is the one thing that cannot be checked: shortening it
//! makes the system end this program (SIGBUS), and writing to it changes what is read. So a process
//! that renders maps nothing ([`copy_only`]): parts are loaded there too, for other scenes and for
//! display. [`Bytes::unchanged`] says afterwards whether a file kept its size and time. Small files
//! are always copied.
#![expect(unsafe_code, reason = "a memory map is only as safe as the file behind it")]

use std::fs::File;
use std::io::{self, Read};
use std::ops::Deref;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::SystemTime;

use super::MeshError;
use crate::storage::{memory, regular};

/// Smaller files are read: mapping saves nothing there.
const MAP_FROM_BYTES: u64 = 4 << 20;

/// Set once, by [`copy_only`]. `Relaxed`: it is set before the threads begin that could read it
/// late.
static COPIES_ONLY: AtomicBool = AtomicBool::new(false);

/// From now on this process copies every file: a file that another program shortens is not to take
/// the loop with it.
pub(super) fn copy_only() {
    COPIES_ONLY.store(true, Ordering::Relaxed);
}

/// Memory that a mesh takes while it is read and inspected, per byte of its file: an estimate from
/// the arrays of a closed mesh in binary STL, the densest format. Of its 50 bytes per triangle 12
/// become corner numbers and 12 vertices (half a vertex of three `f64`); the rest is memory for
/// joining equal corners and for the edges of the inspection.
const MEMORY_PER_FILE_BYTE: u64 = 3;

/// The contents of a file.
pub(super) struct Bytes {
    contents: Contents,
}

enum Contents {
    Read { bytes: Vec<u8>, changed_meanwhile: bool },
    Mapped { map: memmap2::Mmap, file: File, modified: Option<SystemTime> },
}

impl Deref for Bytes {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        match &self.contents {
            Contents::Read { bytes, .. } => bytes,
            Contents::Mapped { map, .. } => map,
        }
    }
}

impl Bytes {
    /// False when another program has written to the file since it was opened.
    fn unchanged(&self) -> bool {
        match &self.contents {
            Contents::Read { changed_meanwhile, .. } => !changed_meanwhile,
            Contents::Mapped { map, file, modified } => is_still(file, map.len() as u64, *modified),
        }
    }

    /// `result`, unless the file changed while it was worked out.
    pub(super) fn confirm<T>(
        &self,
        result: Result<T, MeshError>,
        path: &Path,
    ) -> Result<T, MeshError> {
        if self.unchanged() { result } else { Err(MeshError::Changed { path: path.to_owned() }) }
    }
}

/// Reads or maps a file.
pub(super) fn read(path: &Path) -> Result<Bytes, MeshError> {
    let map_from_bytes =
        if COPIES_ONLY.load(Ordering::Relaxed) { u64::MAX } else { MAP_FROM_BYTES };
    open(path, map_from_bytes, memory::available_bytes()).map_err(|refused| match refused {
        OpenFailure::System(source) if source.kind() == io::ErrorKind::NotFound => {
            MeshError::Missing { path: path.to_owned() }
        }
        OpenFailure::System(source) => MeshError::Unreadable { path: path.to_owned(), source },
        OpenFailure::TooLarge { file_bytes, free_bytes } => {
            MeshError::TooLarge { path: path.to_owned(), file_bytes, free_bytes }
        }
    })
}

/// The file has this length and time.
fn is_still(file: &File, bytes: u64, modified: Option<SystemTime>) -> bool {
    file.metadata().is_ok_and(|now| now.len() == bytes && now.modified().ok() == modified)
}

enum OpenFailure {
    System(io::Error),
    TooLarge { file_bytes: u64, free_bytes: u64 },
}

fn open(path: &Path, map_from_bytes: u64, free_bytes: Option<u64>) -> Result<Bytes, OpenFailure> {
    let mut file = regular::open(path).map_err(OpenFailure::System)?;
    let metadata = file.metadata().map_err(OpenFailure::System)?;
    let file_bytes = metadata.len();
    let is_copied = file_bytes < map_from_bytes;
    let memory_bytes = file_bytes.saturating_mul(MEMORY_PER_FILE_BYTE + u64::from(is_copied));
    if let Some(free_bytes) = free_bytes.filter(|free| memory_bytes > *free) {
        return Err(OpenFailure::TooLarge { file_bytes, free_bytes });
    }
    if is_copied {
        let mut bytes = Vec::with_capacity(file_bytes as usize);
        (&mut file).take(file_bytes).read_to_end(&mut bytes).map_err(OpenFailure::System)?;
        let changed_meanwhile = !is_still(&file, bytes.len() as u64, metadata.modified().ok());
        return Ok(Bytes { contents: Contents::Read { bytes, changed_meanwhile } });
    }
    // SAFETY: the map is private and read-only, so this program never writes through it. That no
    // other program changes the file meanwhile cannot be ensured on this system; the head of this
    // file says what follows from it, and bytes of any value are sound here, as every reader checks
    // what it finds.
    let map =
        unsafe { memmap2::MmapOptions::new().len(file_bytes as usize).map_copy_read_only(&file) }
            .map_err(OpenFailure::System)?;
    Ok(Bytes { contents: Contents::Mapped { map, file, modified: metadata.modified().ok() } })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::setting_names::SettingNames;

    #[test]
    fn mapped_and_read_bytes_are_the_same() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("bytes");
        let bytes: Vec<u8> = (0..10_000_u32).map(|k| k as u8).collect();
        std::fs::write(&path, &bytes).unwrap();
        for (map_from_bytes, is_mapped) in [(10_001, false), (10_000, true)] {
            let found = open(&path, map_from_bytes, None).ok().unwrap();
            assert_eq!(
                (&*found, matches!(found.contents, Contents::Mapped { .. })),
                (&bytes[..], is_mapped)
            );
            assert_eq!(found.confirm(Ok(7), &path).unwrap(), 7);
        }
        assert!(matches!(
            open(&path, 0, Some(29_999)),
            Err(OpenFailure::TooLarge { file_bytes: 10_000, free_bytes: 29_999 })
        ));
    }

    #[test]
    fn a_file_written_while_it_is_mapped_is_refused() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("part.stl");
        std::fs::write(&path, [1; 5000]).unwrap();
        let found = open(&path, 0, None).ok().unwrap();
        std::fs::OpenOptions::new().append(true).open(&path).unwrap().set_len(6000).unwrap();
        let error = found.confirm(Ok(()), &path).unwrap_err();
        assert!(
            matches!(error, MeshError::Changed { .. })
                && error.hint(&SettingNames::PLAIN).is_some(),
            "{error}"
        );
    }

    #[test]
    fn a_process_that_renders_maps_nothing() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("part.stl");
        File::create(&path).unwrap().set_len(2 * MAP_FROM_BYTES).unwrap();
        copy_only();
        let found = read(&path).ok().unwrap();
        assert!(
            matches!(found.contents, Contents::Read { .. })
                && found.len() as u64 == 2 * MAP_FROM_BYTES
        );
        // Shortened while it is used, it is what it was.
        File::create(&path).unwrap();
        assert!(found.iter().all(|byte| *byte == 0));
        assert!(found.confirm(Ok(()), &path).is_ok());
    }

    #[cfg(unix)]
    #[test]
    fn endless_files_are_not_read() {
        let error = read(Path::new("/dev/zero")).err().unwrap();
        assert!(error.to_string().contains("a device"), "{error}");
    }
}
