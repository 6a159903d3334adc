//! The bytes of a mesh file: large ones mapped into memory, small ones read.
//!
//! Invariants: only regular files are read, so no pipe or device can feed bytes for ever; a file that cannot fit into the memory
//! that is free is refused before any of it is read. What another program does to a file while it is mapped is the one thing that
//! cannot be checked: shortening it makes the system end this program (SIGBUS), and writing to it changes what is read. Both
//! happen while a part is loaded, before forces are rendered. [`Bytes::unchanged`] says afterwards whether the file kept its size
//! and time. Small files are copied and have no such risk.
#![expect(unsafe_code, reason = "a memory map is only as safe as the file behind it")]

use std::fs::File;
use std::io::{self, Read};
use std::ops::Deref;
use std::path::Path;
use std::time::SystemTime;

use super::MeshError;

/// Smaller files are read: mapping saves nothing there.
const MAP_FROM_BYTES: u64 = 4 << 20;

/// Memory that a mesh takes while it is read and inspected, per byte of its file: an estimate from the arrays of a closed mesh in
/// binary STL, the densest format. Of its 50 bytes per triangle 12 become corner numbers and 12 vertices (half a vertex of three
/// `f64`); the rest is room for joining equal corners and for the edges of the inspection.
const MEMORY_PER_FILE_BYTE: u64 = 3;

/// The contents of a file.
pub(super) struct Bytes {
    contents: Contents,
}

enum Contents {
    Read(Vec<u8>),
    Mapped { map: memmap2::Mmap, file: File, modified: Option<SystemTime> },
}

impl Deref for Bytes {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        match &self.contents {
            Contents::Read(bytes) => bytes,
            Contents::Mapped { map, .. } => map,
        }
    }
}

impl Bytes {
    /// False when another program has written to the file since it was opened.
    fn unchanged(&self) -> bool {
        match &self.contents {
            Contents::Read(_) => true,
            Contents::Mapped { map, file, modified } => {
                file.metadata().is_ok_and(|now| now.len() == map.len() as u64 && now.modified().ok() == *modified)
            }
        }
    }

    /// `result`, unless the file changed while it was worked out.
    pub(super) fn confirm<T>(&self, result: Result<T, MeshError>, path: &Path) -> Result<T, MeshError> {
        if self.unchanged() { result } else { Err(MeshError::Changed { path: path.to_owned() }) }
    }
}

/// Reads or maps a file.
pub(super) fn read(path: &Path) -> Result<Bytes, MeshError> {
    open(path, MAP_FROM_BYTES, memory_free_bytes()).map_err(|refused| match refused {
        Refused::System(source) if source.kind() == io::ErrorKind::NotFound => MeshError::Missing { path: path.to_owned() },
        Refused::System(source) => MeshError::Unreadable { path: path.to_owned(), source },
        Refused::TooLarge { file_bytes, free_bytes } => MeshError::TooLarge { path: path.to_owned(), file_bytes, free_bytes },
    })
}

enum Refused {
    System(io::Error),
    TooLarge { file_bytes: u64, free_bytes: u64 },
}

fn open(path: &Path, map_from_bytes: u64, free_bytes: Option<u64>) -> Result<Bytes, Refused> {
    // Asked before opening: to open a pipe waits for its writer.
    let kind = std::fs::metadata(path).map_err(Refused::System)?;
    if kind.is_dir() {
        return Err(Refused::System(io::ErrorKind::IsADirectory.into()));
    }
    if !kind.is_file() {
        return Err(Refused::System(io::Error::new(io::ErrorKind::InvalidInput, "it is a pipe, a socket or a device")));
    }
    let mut file = File::open(path).map_err(Refused::System)?;
    let metadata = file.metadata().map_err(Refused::System)?;
    let file_bytes = metadata.len();
    if let Some(free_bytes) = free_bytes.filter(|free| file_bytes.saturating_mul(MEMORY_PER_FILE_BYTE) > *free) {
        return Err(Refused::TooLarge { file_bytes, free_bytes });
    }
    if file_bytes < map_from_bytes {
        let mut bytes = Vec::with_capacity(file_bytes as usize);
        (&mut file).take(map_from_bytes).read_to_end(&mut bytes).map_err(Refused::System)?;
        return Ok(Bytes { contents: Contents::Read(bytes) });
    }
    // SAFETY: the map is private and read-only, so this program never writes through it. That no other program changes the file
    // meanwhile cannot be ensured on this system; the head of this file says what follows from it, and bytes of any value are
    // sound here, as every reader checks what it finds.
    let map = unsafe { memmap2::MmapOptions::new().len(file_bytes as usize).map_copy_read_only(&file) }.map_err(Refused::System)?;
    Ok(Bytes { contents: Contents::Mapped { map, file, modified: metadata.modified().ok() } })
}

/// What the system can still give without swapping; `None` where it does not say.
fn memory_free_bytes() -> Option<u64> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let kibibytes: u64 =
        text.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kibibytes * 1024)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mapped_and_read_bytes_are_the_same() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("bytes");
        let bytes: Vec<u8> = (0..10_000_u32).map(|k| k as u8).collect();
        std::fs::write(&path, &bytes).unwrap();
        for (map_from_bytes, is_mapped) in [(10_001, false), (10_000, true)] {
            let found = open(&path, map_from_bytes, None).ok().unwrap();
            assert_eq!((&*found, matches!(found.contents, Contents::Mapped { .. })), (&bytes[..], is_mapped));
            assert_eq!(found.confirm(Ok(7), &path).unwrap(), 7);
        }
        assert!(matches!(open(&path, 0, Some(29_999)), Err(Refused::TooLarge { file_bytes: 10_000, free_bytes: 29_999 })));
        assert!(memory_free_bytes().is_none_or(|bytes| bytes > 1 << 20));
    }

    #[test]
    fn a_file_written_while_it_is_mapped_is_refused() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("part.stl");
        std::fs::write(&path, [1; 5000]).unwrap();
        let found = open(&path, 0, None).ok().unwrap();
        std::fs::OpenOptions::new().append(true).open(&path).unwrap().set_len(6000).unwrap();
        let error = found.confirm(Ok(()), &path).unwrap_err();
        assert!(matches!(error, MeshError::Changed { .. }) && error.hint().is_some(), "{error}");
    }

    #[cfg(unix)]
    #[test]
    fn endless_files_are_not_read() {
        let error = read(Path::new("/dev/zero")).err().unwrap();
        assert!(error.to_string().contains("a device"), "{error}");
    }
}
