//! The guard: a second, small process that holds the arm's descriptor, and takes the force away
//! where this process no longer can.
//!
//! ```text
//!   hapticd                                 guard (`ps`: haptic-guard)
//!   Guard ── pipe ────────────────────────► stdin    the other end closes: hapticd is dead; a byte: stand aside
//!    beat ── page of memory ──────────────► stderr   count of beats, force is on │ times that the guard acted │ its looks
//!   link ─── arm ◄────────────────────────── stdout   the same port, or the same HID node
//! ```
//! | what happens | what the guard does |
//! |---|---|
//! | the pipe closes, or hapticd has begun to die (`has_died`) | zero; ends |
//! | no beat for `STALL` while force is on | zero, once; goes on watching |
//! | it is ordered to stand aside | ends; while force is on, zero first |
//! | it was stopped (SIGSTOP), and hapticd ends | goes on, and does the above |
//!
//! The host hears of a guard that looks no more, and lets no force flow without it.
//!
//! Invariant: between `watch`'s first and last look the guard allocates nothing, takes no lock,
//! and calls nothing that can wait but the link of the arm.

use core::fmt;
use core::str::FromStr;
use core::sync::atomic::Ordering;
use core::time::Duration;
use std::fs::{self, File};
use std::io::{self, PipeWriter, Write as _};
use std::os::fd::{BorrowedFd, OwnedFd};
use std::os::unix::fs::FileExt as _;
use std::os::unix::process::{CommandExt as _, parent_id};
use std::path::Path;
#[cfg(test)]
use std::process::Stdio;
use std::process::{Child, Command};
use std::thread::sleep;

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::stdio;
use rustix::termios::{QueueSelector, tcflush};

use rt::clock::monotonic_ns;
use rt::process::{self, SharedPage, stand_apart};
use rt::schedule;

/// No beat for so long while force is on: the loop stands still.
const STALL: Duration = Duration::from_millis(50);
/// Between two looks at the page.
const LOOK: Duration = Duration::from_millis(5);
/// Between the two zero frames: an arm without marks between its frames may take the first one for
/// the rest of a frame that was cut.
const AGAIN: Duration = Duration::from_millis(3);
/// How long the port stays open after the last frame: a close may overtake what is still under way.
const LINGER: Duration = Duration::from_millis(50);
/// How long a guard may take to be there.
const START_PATIENCE: Duration = Duration::from_secs(5);
/// How long it may take to end before it is killed.
const END_PATIENCE: Duration = Duration::from_millis(200);
/// Force is on: the lowest bit of the count of beats.
const FORCE: u64 = 1;
/// Its name in `ps`. Not one that `pkill hapticd` means.
pub(crate) const NAME: &str = "haptic-guard";

/// A frame that takes the force away, written as hex on the command line of the guard.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ZeroFrame(pub Vec<u8>);

impl fmt::Display for ZeroFrame {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
    }
}

impl FromStr for ZeroFrame {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let pair = |pair: &[u8]| u8::from_str_radix(str::from_utf8(pair).ok()?, 16).ok();
        let bytes: Option<Vec<u8>> = text.as_bytes().chunks_exact(2).map(pair).collect();
        bytes
            .filter(|bytes| !bytes.is_empty() && 2 * bytes.len() == text.len())
            .map(Self)
            .ok_or("bytes as hex")
    }
}

/// Watches where the command line says `guard FRAME [--priority=N]`, as [`Guard::start`] writes it;
/// `None`: it says something else. The first call of a program that is its own guard
/// (`/proc/self/exe`).
pub fn watch_if_asked() -> Option<io::Result<()>> {
    let mut words = std::env::args().skip(1);
    words.next().filter(|word| word == "guard")?;
    let zero = words.next().and_then(|word| word.parse().ok());
    let priority = words.next().and_then(|word| word.strip_prefix("--priority=")?.parse().ok());
    Some(zero.ok_or(io::ErrorKind::InvalidInput.into()).and_then(|zero| watch(&zero, priority)))
}

/// The guard's half, with its three descriptors in the place of the standard ones. Returns when
/// there is nothing left to watch.
///
/// # Errors
/// It was not started by a [`Guard`].
fn watch(zero: &ZeroFrame, priority: Option<u8>) -> io::Result<()> {
    let pipe = stdio::stdin();
    let arm = stdio::stdout();
    let page = SharedPage::of(stdio::stderr())?;
    // stderr is the page: from here on nothing may be printed.
    stdio::dup2_stderr(File::options().write(true).open("/dev/null")?)?;
    stand_apart(NAME);
    std::env::set_current_dir("/")?;
    // Each of these as far as it is allowed.
    let _ = fs::write("/proc/self/oom_score_adj", "-1000");
    let _ = schedule::lock_memory();
    let _ = priority.map(schedule::enter_fifo);
    let host = File::open(format!("/proc/{}/statm", parent_id())).ok();
    let [beats, acted, looks, ..] = page.words();
    let mut last = beats.load(Ordering::Relaxed);
    let mut since_ns = monotonic_ns();
    let mut has_acted = false;
    loop {
        // Relaxed: each word says all that it says by itself.
        looks.fetch_add(1, Ordering::Relaxed);
        let order = listen(pipe);
        let beat = beats.load(Ordering::Relaxed);
        let has_force = beat & FORCE != 0;
        let stands_still = has_force && beat == last;
        if order == Some(Order::HostGone) || stands_still && has_died(host.as_ref()) {
            act(arm, zero);
            sleep(LINGER);
            return Ok(());
        }
        if order == Some(Order::StandAside) {
            if has_force {
                act(arm, zero);
                sleep(LINGER);
            }
            return Ok(());
        }
        if !stands_still {
            (last, since_ns, has_acted) = (beat, monotonic_ns(), false);
        } else if !has_acted && monotonic_ns() - since_ns >= STALL.as_nanos() as i64 {
            has_acted = true;
            // First the word: a loop that wakes up now sends nothing after the zero.
            acted.fetch_add(1, Ordering::SeqCst);
            act(arm, zero);
        }
    }
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Order {
    StandAside,
    HostGone,
}

/// Waits for a word of the host, for the time between two looks.
fn listen(pipe: BorrowedFd<'_>) -> Option<Order> {
    let timeout = Timespec { tv_sec: 0, tv_nsec: LOOK.subsec_nanos().into() };
    match poll(&mut [PollFd::new(&pipe, PollFlags::IN)], Some(&timeout)) {
        Ok(0) => None,
        Ok(_) => match rustix::io::read(pipe, &mut [0_u8; 1]) {
            Ok(1..) => Some(Order::StandAside),
            // A pipe that cannot be read is one that says nothing any more.
            Ok(0) | Err(_) => Some(Order::HostGone),
        },
        // Stopped and continued.
        Err(_) => {
            sleep(LOOK);
            None
        }
    }
}

/// A process that was killed gives its memory back before it closes its descriptors, which takes
/// 0.1 s for each GB; meanwhile its size is 0 already.
fn has_died(statm: Option<&File>) -> bool {
    let mut head = [0; 2];
    statm.is_some_and(|statm| statm.read_at(&mut head, 0).is_err() || head == *b"0 ")
}

/// Takes the force away, as well as it can be done.
fn act(arm: BorrowedFd<'_>, zero: &ZeroFrame) {
    // What waits in the port is older than the zero. A HID node has no such queue, and refuses.
    let _ = tcflush(arm, QueueSelector::OFlush);
    for _ in 0..2 {
        // The host is gone: the error cannot be reported.
        let _ = rustix::io::write(arm, &zero.0);
        sleep(AGAIN);
    }
}

/// The host's half: a guard at work. Its end lets the guard stand aside.
#[derive(Debug)]
pub struct Guard {
    process: Child,
    pipe: PipeWriter,
    page: SharedPage,
    beats: u64,
    seen: u64,
    /// Looks of the guard so far, and ticks in which there was no other one.
    looks: u64,
    unwatched_ticks: u32,
    was_missing: bool,
}

impl Guard {
    /// Starts a guard and waits until it watches: `program` is a `hapticd`, `arm` a descriptor that
    /// frames can be written to, `priority` one of SCHED_FIFO above that of the loop. Cold; takes
    /// some milliseconds.
    ///
    /// # Errors
    /// The program cannot be started, or does not become a guard.
    pub fn start(
        program: &Path,
        arm: OwnedFd,
        zero: &ZeroFrame,
        priority: Option<u8>,
    ) -> io::Result<Self> {
        let (page, shared) = SharedPage::new()?;
        let (orders, pipe) = io::pipe()?;
        let mut command = Command::new(program);
        command.arg0(NAME).args(["guard", &zero.to_string()]);
        command.args(priority.map(|priority| format!("--priority={priority}")));
        let process = command.stdin(orders).stdout(arm).stderr(shared).spawn()?;
        // Its ends of all three are closed here, so that ours of the pipe is the only one.
        drop(command);
        let mut guard = Self::of(process, pipe, page);
        let [_, _, looks, ..] = guard.page.words();
        let begin_ns = monotonic_ns();
        while looks.load(Ordering::Relaxed) == 0 {
            if let Some(status) = guard.process.try_wait()? {
                return Err(io::Error::other(format!("{} guard: {status}", program.display())));
            }
            if monotonic_ns() - begin_ns > START_PATIENCE.as_nanos() as i64 {
                return Err(io::ErrorKind::TimedOut.into());
            }
            sleep(Duration::from_millis(1));
        }
        Ok(guard)
    }

    fn of(process: Child, pipe: PipeWriter, page: SharedPage) -> Self {
        Self {
            process,
            pipe,
            page,
            beats: 0,
            seen: 0,
            looks: 0,
            unwatched_ticks: 0,
            was_missing: false,
        }
    }

    /// Says that the loop turns, and whether any force was commanded. RT: safe; one store.
    pub fn beat(&mut self, has_force: bool) {
        self.beats = self.beats.wrapping_add(FORCE + 1);
        self.page.words()[0]
            .store(self.beats | if has_force { FORCE } else { 0 }, Ordering::Relaxed);
    }

    /// True, once, after the guard took the force away because the beats stood still. RT: safe.
    pub fn has_acted(&mut self) -> bool {
        let acted = self.page.words()[1].load(Ordering::SeqCst);
        core::mem::replace(&mut self.seen, acted) != acted
    }

    /// The guard has not looked for more than so many ticks: it was stopped or has ended. Called once
    /// a tick. Ticks and not time: a machine that stands still lets both wait. RT: safe.
    pub fn is_missing(&mut self, most_ticks: u32) -> bool {
        let looks = self.page.words()[2].load(Ordering::Relaxed);
        let has_looked = core::mem::replace(&mut self.looks, looks) != looks;
        self.unwatched_ticks = if has_looked { 0 } else { self.unwatched_ticks.saturating_add(1) };
        self.was_missing = self.unwatched_ticks > most_ticks;
        self.was_missing
    }

    /// What [`Self::is_missing`] said last.
    pub(crate) fn was_missing(&self) -> bool {
        self.was_missing
    }

    /// One whose other end is the test: its page is that of a guard.
    #[cfg(test)]
    pub(crate) fn of_test() -> (Self, SharedPage) {
        let (page, shared) = SharedPage::new().expect("memory");
        let (orders, pipe) = io::pipe().expect("a pipe");
        let mut command = Command::new("head");
        command.arg("-c1").stdin(orders).stdout(Stdio::null());
        let process = command.spawn().expect("a program");
        (Self::of(process, pipe, page), SharedPage::of(shared).expect("a page"))
    }
}

impl Drop for Guard {
    fn drop(&mut self) {
        // It may have been killed; then there is no reader.
        let _ = self.pipe.write(&[0]);
        process::end(&mut self.process, END_PATIENCE);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_survives_the_command_line() {
        let frame = ZeroFrame((0..=255).collect());
        assert_eq!(frame.to_string().parse(), Ok(frame));
        for text in ["", "0", "0g", "é"] {
            assert!(text.parse::<ZeroFrame>().is_err(), "{text}");
        }
    }

    #[test]
    fn a_process_that_lives_has_not_died() {
        let statm = File::open("/proc/self/statm").expect("there");
        assert!(!has_died(Some(&statm)) && !has_died(None));
    }
}
