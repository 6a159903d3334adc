//! The page that hapticd and a worker share: the newest frame in each direction, and nothing older.
//!
//! ```text
//!  words   0 ─ 15 frame of the host     16 ─ 31 frame of the worker
//!          count, length, bytes         count, length, bytes
//! ```
//! Each is a sequence lock: the count is odd while its one writer writes. A reader that finds it
//! odd, or changed meanwhile, has read nothing; it tries again a fixed number of times, so that a
//! writer that was stopped in the middle holds up no one.

use core::sync::atomic::{AtomicU64, Ordering, fence};
use std::io;
use std::os::fd::{AsFd, OwnedFd};

use rt::process::SharedPage;

/// Words of a slot: its count, the length of its frame, the frame.
const SLOT: usize = 16;
/// Bytes of the longest frame.
const BYTES: usize = 8 * (SLOT - 2);
/// How often a frame that changes is read.
const TRIES: usize = 8;

/// Which of the two writers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum End {
    Host,
    Worker,
}

/// One end of the page. RT: `put` and `take` make no system call.
#[derive(Debug)]
pub(super) struct Page {
    shared: SharedPage,
    end: End,
    /// Count of the frame that was taken last.
    taken: u64,
}

impl Page {
    /// The host's end, with what leads the worker to its own. Cold.
    pub(super) fn new() -> io::Result<(Self, OwnedFd)> {
        let (shared, fd) = SharedPage::new()?;
        Ok((Self { shared, end: End::Host, taken: 0 }, fd))
    }

    /// The worker's end. Cold.
    pub(super) fn of(fd: impl AsFd) -> io::Result<Self> {
        Ok(Self { shared: SharedPage::of(fd)?, end: End::Worker, taken: 0 })
    }

    fn slot(&self, end: End) -> &[AtomicU64] {
        let words = self.shared.words();
        match end {
            End::Host => &words[..SLOT],
            End::Worker => &words[SLOT..2 * SLOT],
        }
    }

    /// Writes a frame in the place of the one before; false, and nothing written, when it is too
    /// long.
    pub(super) fn put(&mut self, frame: &[u8]) -> bool {
        let [count, length, words @ ..] = self.slot(self.end) else { return false };
        if frame.len() > BYTES {
            return false;
        }
        // One writer: nothing else changes the count.
        let before = count.load(Ordering::Relaxed);
        count.store(before.wrapping_add(1), Ordering::Relaxed);
        fence(Ordering::Release);
        length.store(frame.len() as u64, Ordering::Relaxed);
        for (word, bytes) in words.iter().zip(frame.chunks(8)) {
            let mut eight = [0; 8];
            eight[..bytes.len()].copy_from_slice(bytes);
            word.store(u64::from_le_bytes(eight), Ordering::Relaxed);
        }
        count.store(before.wrapping_add(2), Ordering::Release);
        true
    }

    /// Reads the newest frame of the other end, once; 0 when there is no new one.
    pub(super) fn take(&mut self, buffer: &mut [u8]) -> usize {
        let other = if self.end == End::Host { End::Worker } else { End::Host };
        let mut frame = [0; BYTES];
        let mut found = None;
        {
            let [count, length, words @ ..] = self.slot(other) else { return 0 };
            for _ in 0..TRIES {
                let before = count.load(Ordering::Acquire);
                if before == self.taken {
                    return 0;
                }
                if before & 1 == 1 {
                    core::hint::spin_loop();
                    continue;
                }
                let n = length.load(Ordering::Relaxed) as usize;
                for (eight, word) in frame.as_chunks_mut::<8>().0.iter_mut().zip(words) {
                    *eight = word.load(Ordering::Relaxed).to_le_bytes();
                }
                fence(Ordering::Acquire);
                if count.load(Ordering::Relaxed) == before {
                    found = Some((before, n.min(BYTES)));
                    break;
                }
            }
        }
        let Some((count, n)) = found else { return 0 };
        self.taken = count;
        let n = n.min(buffer.len());
        buffer[..n].copy_from_slice(&frame[..n]);
        n
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ends() -> (Page, Page) {
        let (host, fd) = Page::new().expect("memory");
        (host, Page::of(fd).expect("a page"))
    }

    #[test]
    fn the_newest_frame_is_taken_once() {
        let (mut host, mut worker) = ends();
        let mut buffer = [0; 200];
        assert_eq!(worker.take(&mut buffer), 0);
        assert!(host.put(&[1; 65]) && host.put(&[2; 65]));
        assert_eq!((worker.take(&mut buffer), buffer[64], worker.take(&mut buffer)), (65, 2, 0));
        assert!(worker.put(&[3; 9]) && !worker.put(&[0; BYTES + 1]));
        assert_eq!((host.take(&mut buffer), buffer[8], host.take(&mut buffer)), (9, 3, 0));
    }

    #[test]
    fn a_frame_that_is_half_written_is_none_and_holds_up_no_one() {
        let (mut host, mut worker) = ends();
        assert!(host.put(&[1; 8]));
        host.slot(End::Host)[0].fetch_add(1, Ordering::Relaxed);
        assert_eq!(worker.take(&mut [0; 64]), 0);
        host.slot(End::Host)[0].fetch_add(1, Ordering::Relaxed);
        assert_eq!(worker.take(&mut [0; 64]), 8);
    }

    #[test]
    fn frames_are_whole_whatever_the_other_end_does() {
        let (mut host, mut worker) = ends();
        let writer = std::thread::spawn(move || {
            for n in 0..200_000_u32 {
                assert!(host.put(&[(n % 251) as u8; 64]));
            }
        });
        let mut buffer = [0; 64];
        let mut taken = 0;
        while !writer.is_finished() || taken == 0 {
            if worker.take(&mut buffer) == 64 {
                assert!(buffer.iter().all(|byte| *byte == buffer[0]), "{buffer:?}");
                taken += 1;
            }
        }
        writer.join().expect("ends");
        assert!(taken > 0);
    }
}
