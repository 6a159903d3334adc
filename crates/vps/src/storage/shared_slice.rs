//! An array that is owned or is a window into a file's bytes.
#![expect(unsafe_code, reason = "a mapped file is memory that the compiler does not know of")]

use core::ops::{Deref, Range};
use core::ptr::NonNull;
use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt as _;
use std::sync::Arc;

use bytemuck::Pod;
use memmap2::{Advice, Mmap, MmapMut, MmapOptions};

/// The bytes of a file, read-only, on a page boundary, all pages present.
#[derive(Debug)]
pub struct MappedFile(Mmap);

impl MappedFile {
    /// Maps a file: nothing is copied, processes share the memory and the kernel may take it back
    /// and read it again. The file must not be shortened or written to meanwhile: that ends the
    /// process (SIGBUS), or changes what was checked.
    ///
    /// # Errors
    /// Any error of the operating system.
    pub fn map(file: &File) -> io::Result<Arc<Self>> {
        // SAFETY: the pages are read-only here. That no other process writes to the file is a rule
        // of the bake cache: its files are written once under another name, made read-only,
        // renamed, and from then on only replaced or deleted, which a mapping survives. Only a copy
        // helps against a process that breaks that rule: what is read while forces are rendered is
        // made by `read`.
        Ok(Arc::new(Self(unsafe { MmapOptions::new().populate().map(file) }?)))
    }

    /// Reads a file into memory that no other process can reach; from then on the file does not
    /// matter. Cost: one copy.
    ///
    /// # Errors
    /// Any error of the operating system; a file that becomes shorter meanwhile is one.
    pub fn read(file: &File) -> io::Result<Arc<Self>> {
        let n_bytes =
            usize::try_from(file.metadata()?.len()).map_err(|_| io::ErrorKind::FileTooLarge)?;
        Self::fill(n_bytes, |memory| file.read_exact_at(memory, 0))
    }

    /// Copies bytes.
    ///
    /// # Errors
    /// Any error of the operating system.
    pub fn copy(bytes: &[u8]) -> io::Result<Arc<Self>> {
        Self::fill(bytes.len(), |memory| {
            memory.copy_from_slice(bytes);
            Ok(())
        })
    }

    fn fill(
        n_bytes: usize,
        fill: impl FnOnce(&mut [u8]) -> io::Result<()>,
    ) -> io::Result<Arc<Self>> {
        // A mapping of no bytes is none.
        let mut memory = MmapMut::map_anon(n_bytes.max(1))?;
        // Pages of 2 MiB where the kernel gives them: hundreds of times fewer faults now, and fewer
        // misses of the TLB in each tick.
        let _ = memory.advise(Advice::HugePage);
        fill(memory.get_mut(..n_bytes).unwrap_or_default())?;
        Ok(Arc::new(Self(memory.make_read_only()?)))
    }

    /// All bytes.
    pub fn bytes(&self) -> &[u8] {
        &self.0
    }
}

/// `[len]` of `T`, immutable: a vector, or a window into a [`MappedFile`], that lives as long as
/// its last handle.
///
/// Reading costs the same either way: pointer and length are at hand, nothing is looked up. A clone
/// is another handle on the same memory. RT: reading is safe.
pub struct SharedSlice<T> {
    first: NonNull<T>,
    len: usize,
    owner: Owner<T>,
}

/// Keeps the memory of a slab; never read through.
enum Owner<T> {
    Vector(Arc<Vec<T>>),
    MappedFile(Arc<MappedFile>),
}

// SAFETY: a slab is a shared, immutable slice of T and a reference count that is itself
// thread-safe.
unsafe impl<T: Send + Sync> Send for SharedSlice<T> {}
// SAFETY: as above.
unsafe impl<T: Send + Sync> Sync for SharedSlice<T> {}

impl<T: Pod> SharedSlice<T> {
    /// A window; `None` when `range` is not within the region, not aligned for `T`, or not a whole
    /// number of `T`.
    pub fn window(mapped: &Arc<MappedFile>, range: Range<usize>) -> Option<Self> {
        let window: &[T] = bytemuck::try_cast_slice(mapped.bytes().get(range)?).ok()?;
        Some(Self {
            first: NonNull::from(window).cast(),
            len: window.len(),
            owner: Owner::MappedFile(mapped.clone()),
        })
    }
}

impl<T> From<Arc<Vec<T>>> for SharedSlice<T> {
    fn from(values: Arc<Vec<T>>) -> Self {
        Self {
            first: NonNull::from(values.as_slice()).cast(),
            len: values.len(),
            owner: Owner::Vector(values),
        }
    }
}

impl<T> From<Vec<T>> for SharedSlice<T> {
    fn from(values: Vec<T>) -> Self {
        Arc::new(values).into()
    }
}

impl<T> Default for SharedSlice<T> {
    fn default() -> Self {
        Vec::new().into()
    }
}

impl<T> Clone for SharedSlice<T> {
    fn clone(&self) -> Self {
        let owner = match &self.owner {
            Owner::Vector(values) => Owner::Vector(values.clone()),
            Owner::MappedFile(mapped) => Owner::MappedFile(mapped.clone()),
        };
        Self { owner, ..*self }
    }
}

impl<T> Deref for SharedSlice<T> {
    type Target = [T];

    #[inline]
    fn deref(&self) -> &[T] {
        // SAFETY: `first` and `len` are those of a slice that was there when the slab was made, and
        // still is: of a region, which does not change, or of a vector in an `Arc`, which hands out
        // no exclusive reference while this is one of its owners.
        unsafe { core::slice::from_raw_parts(self.first.as_ptr(), self.len) }
    }
}

impl<T> core::fmt::Debug for SharedSlice<T> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "SharedSlice({})", self.len)
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write as _;

    use super::*;

    fn file(bytes: &[u8]) -> File {
        let mut file = tempfile::tempfile().unwrap();
        file.write_all(bytes).unwrap();
        file
    }

    #[test]
    fn owned_values_are_read_and_dropped_once() {
        let witness = Arc::new(());
        let slab = SharedSlice::from(vec![witness.clone(), witness.clone()]);
        let other = slab.clone();
        assert_eq!((slab.len(), Arc::strong_count(&witness)), (2, 3));
        assert!(core::ptr::eq(&*slab, &*other), "one memory");
        drop(slab);
        assert_eq!((other.len(), Arc::strong_count(&witness)), (2, 3));
        drop(other);
        assert_eq!(Arc::strong_count(&witness), 1);
        assert!(SharedSlice::<u64>::default().is_empty());
    }

    #[test]
    fn a_window_outlives_its_file_and_every_other_handle() {
        let numbers: Vec<u32> = (0..100).collect();
        for make in [MappedFile::map, MappedFile::read] {
            let mapped = make(&file(bytemuck::cast_slice(&numbers))).unwrap();
            let slab = SharedSlice::<u32>::window(&mapped, 40..80).unwrap();
            drop(mapped);
            assert_eq!(*slab, numbers[10..20]);
            assert_eq!(std::thread::spawn(move || slab[3]).join().unwrap(), 13);
        }
    }

    #[test]
    fn what_was_read_does_not_change_with_its_file() {
        let file = file(&[7; 5000]);
        let mapped = MappedFile::read(&file).unwrap();
        file.set_len(0).unwrap();
        assert_eq!(mapped.bytes(), [7; 5000]);
        assert!(MappedFile::read(&file).unwrap().bytes().len() <= 1);
    }

    #[test]
    fn windows_that_are_none_are_refused() {
        let mapped = MappedFile::copy(&[0; 64]).unwrap();
        assert!(SharedSlice::<u32>::window(&mapped, 0..64).is_some());
        assert!(SharedSlice::<u32>::window(&mapped, 64..64).is_some_and(|slab| slab.is_empty()));
        for range in [0..68, 2..6, 0..6, 68..72, usize::MAX - 3..usize::MAX] {
            assert!(SharedSlice::<u32>::window(&mapped, range.clone()).is_none(), "{range:?}");
        }
    }
}
