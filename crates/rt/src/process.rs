//! What a process beside this one needs: words that both of them see, and to be left alone by what
//! ends the other one.
#![expect(
    unsafe_code,
    reason = "a page of two processes is reached by a pointer; signals and sessions are libc calls"
)]

use core::sync::atomic::AtomicU64;
use std::io;
use std::os::fd::{AsFd, AsRawFd, OwnedFd};

use memmap2::{MmapOptions, MmapRaw};
use rustix::fs::{MemfdFlags, fstat, ftruncate, memfd_create};

/// Bytes of the page.
const PAGE: usize = 4096;
/// Words of it.
const WORDS: usize = PAGE / 8;

/// Some words of memory that this process has in common with another one.
#[derive(Debug)]
pub struct SharedPage(MmapRaw);

impl SharedPage {
    /// A page of zeros, with the descriptor that leads another process to it. Cold.
    ///
    /// # Errors
    /// The system has no memory to share.
    pub fn new() -> io::Result<(Self, OwnedFd)> {
        let fd = memfd_create("hapticd", MemfdFlags::CLOEXEC)?;
        ftruncate(&fd, PAGE as u64)?;
        Ok((Self::of(&fd)?, fd))
    }

    /// The page behind a descriptor. Cold.
    ///
    /// # Errors
    /// It is not one of [`Self::new`].
    pub fn of(fd: impl AsFd) -> io::Result<Self> {
        // What lies beyond the end of a file cannot be read.
        if fstat(&fd)?.st_size < PAGE as i64 {
            return Err(io::ErrorKind::InvalidInput.into());
        }
        Ok(Self(MmapOptions::new().len(PAGE).map_raw(fd.as_fd().as_raw_fd())?))
    }

    /// The words. RT: safe.
    pub fn words(&self) -> &[AtomicU64; WORDS] {
        // SAFETY: the page is as long, aligned to itself, mapped for as long as `self`, and reached
        // by atomics alone in either process.
        unsafe { &*self.0.as_ptr().cast() }
    }
}

/// Leaves the terminal, the session and the name of the parent process, and ignores every signal
/// that can be ignored. RT: start-up only.
pub fn stand_apart(name: &str) {
    for signal in 1..=64 {
        // SAFETY: SIG_IGN is a valid disposition and runs no code of ours; the system refuses
        // signals that cannot be ignored, or are none.
        unsafe { libc::signal(signal, libc::SIG_IGN) };
    }
    // SAFETY: takes no arguments; refused to a process that leads a session already, which is as
    // good.
    unsafe { libc::setsid() };
    // A name is worth no failure.
    let _ = std::fs::write("/proc/self/comm", name);
}

#[cfg(test)]
mod tests {
    use core::sync::atomic::Ordering;

    use super::*;

    #[test]
    fn both_ends_of_a_page_see_the_same_words() {
        let (here, fd) = SharedPage::new().expect("memory");
        let there = SharedPage::of(&fd).expect("a page");
        here.words()[1].store(7, Ordering::Relaxed);
        let [first, second, .., last] = there.words();
        assert_eq!([first, second, last].map(|word| word.load(Ordering::Relaxed)), [0, 7, 0]);
    }

    #[test]
    fn what_is_no_page_is_refused() {
        assert!(SharedPage::of(tempfile::tempfile().expect("a file")).is_err());
        assert!(SharedPage::of(std::fs::File::open("/dev/null").expect("there")).is_err());
    }
}
