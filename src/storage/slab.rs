//! An array that is owned or lies in a mapped file.
#![expect(unsafe_code, reason = "a mapped file is memory that the compiler does not know of")]

use core::ops::{Deref, Range};
use core::ptr::NonNull;
use std::fs::File;
use std::io;
use std::sync::Arc;

use bytemuck::Pod;

/// A file in memory, read-only, all of its pages present.
#[derive(Debug)]
pub struct Mapping(memmap2::Mmap);

impl Mapping {
    /// Maps a whole file. The file must not be shortened or written to while it is mapped; see [`Slab`].
    ///
    /// # Errors
    /// Any error of the operating system.
    pub fn of(file: &File) -> io::Result<Arc<Self>> {
        // SAFETY: the pages are read-only here. That nobody else writes to the file is a rule of the bake cache: its files are written
        // once under another name, made read-only, renamed and from then on only replaced or deleted, which a mapping survives. Somebody
        // who breaks it on purpose ends this process with SIGBUS, so nothing is mapped while forces are rendered.
        let mapping = unsafe { memmap2::MmapOptions::new().populate().map(file) }?;
        Ok(Arc::new(Self(mapping)))
    }

    /// The file's bytes.
    pub fn bytes(&self) -> &[u8] {
        &self.0
    }
}

/// `[len]` of `T`, immutable: owned memory, or a window into a [`Mapping`] that lives as long as any window does.
///
/// Reading costs the same either way: pointer and length are at hand, nothing is looked up. RT: safe; only a mapped one can fail, when
/// somebody shortens the file (SIGBUS), so what the servo loop reads is owned.
pub struct Slab<T> {
    first: NonNull<T>,
    len: usize,
    /// `None`: `first` is a boxed slice of this slab's own.
    mapping: Option<Arc<Mapping>>,
}

// SAFETY: a slab is a shared, immutable slice of T (and a reference count that is itself thread-safe).
unsafe impl<T: Send + Sync> Send for Slab<T> {}
// SAFETY: as above.
unsafe impl<T: Send + Sync> Sync for Slab<T> {}

impl<T> Slab<T> {
    /// A window into a mapped file; `None` when `range` is not within it, not aligned for `T`, or not a whole number of `T`.
    pub fn mapped(mapping: &Arc<Mapping>, range: Range<usize>) -> Option<Self>
    where
        T: Pod,
    {
        let window: &[T] = bytemuck::try_cast_slice(mapping.bytes().get(range)?).ok()?;
        Some(Self { first: NonNull::from(window).cast(), len: window.len(), mapping: Some(mapping.clone()) })
    }

    /// Lies in a mapped file.
    pub fn is_mapped(&self) -> bool {
        self.mapping.is_some()
    }
}

impl<T> From<Vec<T>> for Slab<T> {
    fn from(values: Vec<T>) -> Self {
        let values = Box::leak(values.into_boxed_slice());
        let len = values.len();
        Self { first: NonNull::from(values).cast(), len, mapping: None }
    }
}

impl<T> Default for Slab<T> {
    fn default() -> Self {
        Vec::new().into()
    }
}

impl<T> Deref for Slab<T> {
    type Target = [T];

    #[inline]
    fn deref(&self) -> &[T] {
        // SAFETY: `first` and `len` are those of a slice that was checked when the slab was made. It is alive: a leaked box that only
        // `drop` takes back, or a window into a mapping that `self` holds. Nothing writes to it.
        unsafe { core::slice::from_raw_parts(self.first.as_ptr(), self.len) }
    }
}

impl<T> Drop for Slab<T> {
    fn drop(&mut self) {
        if self.mapping.is_none() {
            let values = core::ptr::slice_from_raw_parts_mut(self.first.as_ptr(), self.len);
            // SAFETY: leaked from a box in `From<Vec<T>>`, the only place that makes a slab without a mapping, and freed only here.
            drop(unsafe { Box::from_raw(values) });
        }
    }
}

impl<T> core::fmt::Debug for Slab<T> {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        let kind = if self.is_mapped() { "mapped" } else { "owned" };
        write!(f, "Slab([{}; {kind}])", self.len)
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write as _;

    use super::*;

    fn mapping(bytes: &[u8]) -> Arc<Mapping> {
        let mut file = tempfile::tempfile().unwrap();
        file.write_all(bytes).unwrap();
        Mapping::of(&file).unwrap()
    }

    #[test]
    fn owned_values_are_read_and_dropped_once() {
        let witness = Arc::new(());
        let slab = Slab::from(vec![witness.clone(), witness.clone()]);
        assert_eq!((slab.len(), slab.is_mapped(), Arc::strong_count(&witness)), (2, false, 3));
        drop(slab);
        assert_eq!(Arc::strong_count(&witness), 1);
        assert!(Slab::<u64>::default().is_empty());
    }

    #[test]
    fn a_window_outlives_the_name_of_its_file_and_of_its_mapping() {
        let numbers: Vec<u32> = (0..100).collect();
        let mapping = mapping(bytemuck::cast_slice(&numbers));
        let slab = Slab::<u32>::mapped(&mapping, 40..80).unwrap();
        drop(mapping);
        assert!(slab.is_mapped());
        assert_eq!(*slab, numbers[10..20]);
        assert_eq!(std::thread::spawn(move || slab[3]).join().unwrap(), 13);
    }

    #[test]
    fn windows_that_are_none_are_refused() {
        let mapping = mapping(&[0; 64]);
        assert!(Slab::<u32>::mapped(&mapping, 0..64).is_some());
        assert!(Slab::<u32>::mapped(&mapping, 64..64).is_some_and(|slab| slab.is_empty()));
        for range in [0..68, 2..6, 0..6, 68..72, usize::MAX - 3..usize::MAX] {
            assert!(Slab::<u32>::mapped(&mapping, range.clone()).is_none(), "{range:?}");
        }
    }
}
