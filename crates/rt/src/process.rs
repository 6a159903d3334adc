//! What a process beside this one needs: words that both of them see, to be left alone by what ends
//! the other one, and to end after it even where it was stopped.
#![expect(
    unsafe_code,
    reason = "a page of two processes is reached by a pointer; signals and sessions are libc calls"
)]

use core::sync::atomic::AtomicU64;
use core::time::Duration;
use std::io;
use std::os::fd::{AsFd, AsRawFd, OwnedFd};
use std::process::Child;
use std::time::Instant;

use memmap2::{MmapOptions, MmapRaw};
use rustix::fs::{MemfdFlags, fstat, ftruncate, memfd_create};

/// Bytes of the page.
const PAGE: usize = 4096;
/// Words of it.
const WORDS: usize = PAGE / 8;
/// How long the system may take to end a process that is killed.
const KILL_PATIENCE: Duration = Duration::from_millis(200);

/// Gives memory that was freed back to the system, after work that took much of it: glibc keeps what
/// a thread of its own has freed. Cold.
pub fn give_back_memory() {
    #[cfg(target_env = "gnu")]
    // SAFETY: it takes the allocator's own locks, and moves nothing that is in use.
    unsafe {
        libc::malloc_trim(0);
    }
}

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
/// that can be ignored. The kernel sends SIGCONT when the thread that started this process ends, so a
/// stopped process runs again and sees that its host has gone; where only that thread has gone, it
/// has no effect. RT: start-up only.
pub fn stand_apart(name: &str) {
    for signal in 1..=64 {
        // SAFETY: SIG_IGN is a valid disposition and runs no code of ours; the system refuses
        // signals that cannot be ignored, or are none.
        unsafe { libc::signal(signal, libc::SIG_IGN) };
    }
    // SAFETY: takes no arguments; refused to a process that leads a session already, which is as
    // good.
    unsafe { libc::setsid() };
    // SAFETY: sets an attribute of this process; it is refused for numbers alone that are no signal.
    // Not SIGKILL: a process that holds an arm has a zero to send first.
    unsafe { libc::prctl(libc::PR_SET_PDEATHSIG, libc::SIGCONT) };
    // A name is worth no failure.
    let _ = std::fs::write("/proc/self/comm", name);
}

/// Waits at most `patience` for a child that was asked to end, and then kills it. One that a signal
/// has stopped (SIGSTOP) goes on first, and ends in order if it can. One that hangs in a driver
/// stays, and is not waited for. Cold.
pub fn end(child: &mut Child, patience: Duration) {
    // A child that has ended and was not waited for keeps its number, which then belongs to no other
    // process.
    if let (Ok(None), Ok(pid)) = (child.try_wait(), libc::pid_t::try_from(child.id())) {
        // SAFETY: takes numbers only.
        unsafe { libc::kill(pid, libc::SIGCONT) };
    }
    if !ends_within(child, patience) {
        let _ = child.kill();
        ends_within(child, KILL_PATIENCE);
    }
}

fn ends_within(child: &mut Child, patience: Duration) -> bool {
    let begin = Instant::now();
    while matches!(child.try_wait(), Ok(None)) {
        if begin.elapsed() > patience {
            return false;
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    true
}

#[cfg(test)]
mod tests {
    use core::sync::atomic::Ordering;
    use std::io::Read as _;
    use std::os::unix::process::ExitStatusExt as _;
    use std::process::{Command, Stdio};

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
    fn a_child_that_is_stopped_goes_on_to_its_end_or_is_killed() {
        let stopped = |script: &str| {
            let mut child = Command::new("sh")
                .args(["-c", script])
                .stdin(Stdio::piped())
                .stdout(Stdio::piped())
                .spawn()
                .expect("a shell");
            let mut ready = [0; 1];
            child.stdout.as_mut().expect("piped").read_exact(&mut ready).expect("it says so");
            Command::new("kill").args(["-STOP", &child.id().to_string()]).status().expect("kill");
            // The end of its input asks it to end.
            drop(child.stdin.take());
            child
        };
        let mut willing = stopped("echo; read line; exit 3");
        end(&mut willing, Duration::from_secs(20));
        assert_eq!(willing.try_wait().expect("ours").and_then(|status| status.code()), Some(3));
        let mut deaf = stopped("trap '' TERM; echo; while :; do sleep 0.1; done");
        end(&mut deaf, Duration::from_millis(50));
        assert_eq!(deaf.wait().expect("ours").signal(), Some(libc::SIGKILL));
    }

    #[test]
    fn what_is_no_page_is_refused() {
        assert!(SharedPage::of(tempfile::tempfile().expect("a file")).is_err());
        assert!(SharedPage::of(std::fs::File::open("/dev/null").expect("there")).is_err());
    }
}
