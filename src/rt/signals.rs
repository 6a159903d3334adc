//! Ctrl-C, SIGTERM and SIGHUP as messages.
#![expect(unsafe_code, reason = "asking for, ignoring, counting and sending signals are libc calls")]

use core::mem::MaybeUninit;
use core::sync::atomic::{AtomicU32, Ordering};

use crossbeam::channel::{Receiver, bounded};

/// The handler could not be installed.
#[derive(Debug, thiserror::Error)]
#[error("cannot catch signals: {0}")]
pub struct SignalError(#[from] ctrlc::Error);

/// One message per signal from now on; signals that nobody has taken yet are not counted twice. Once per process.
///
/// A SIGHUP that the caller has told the program to ignore (`nohup`) stays ignored. An ignored SIGINT does not: a shell without job control
/// ignores it for everything in the background, and a program that moves an arm stops when it is asked to. A SIGXFSZ is ignored too: a file
/// that grows beyond a limit is an error of whoever writes it and no reason to leave an arm alone.
///
/// # Errors
/// The operating system refused, or this was called before.
pub fn interrupts() -> Result<Receiver<()>, SignalError> {
    let (sender, receiver) = bounded(2);
    let ignores_hangup = is_hangup_ignored();
    ctrlc::set_handler(move || {
        // A full channel already says everything: stop, and stop at once.
        let _ = sender.try_send(());
    })?;
    // SAFETY: SIG_IGN is a valid disposition and runs no code of ours.
    unsafe { libc::signal(libc::SIGXFSZ, libc::SIG_IGN) };
    if ignores_hangup {
        // SAFETY: SIG_IGN is a valid disposition and runs no code of ours.
        unsafe { libc::signal(libc::SIGHUP, libc::SIG_IGN) };
    }
    Ok(receiver)
}

/// How often SIGHUP has come.
static HANGUPS: AtomicU32 = AtomicU32::new(0);

/// What SIGHUP asks for since [`hangups`].
#[derive(Debug)]
pub struct Hangups {
    taken: u32,
    had_terminal: bool,
}

/// What a SIGHUP means.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Hangup {
    /// Somebody asks the program to read its files again.
    Reload,
    /// The terminal has gone, and with it whoever sat there.
    TerminalGone,
}

/// SIGHUP is counted from now on and no longer an [interrupt](interrupts); call it after that. One that the program was told to ignore
/// (`nohup`) stays ignored.
pub fn hangups() -> Hangups {
    if !is_hangup_ignored() {
        extern "C" fn count(_signal: libc::c_int) {
            HANGUPS.fetch_add(1, Ordering::Relaxed);
        }
        let handler: extern "C" fn(libc::c_int) = count;
        // SAFETY: all-zero is a valid `sigaction`: no flags, an empty mask.
        let mut action = unsafe { MaybeUninit::<libc::sigaction>::zeroed().assume_init() };
        action.sa_sigaction = handler as libc::sighandler_t;
        action.sa_flags = libc::SA_RESTART;
        // SAFETY: `action` is a whole `sigaction`, and its handler only adds to an atomic, which a signal handler may.
        unsafe { libc::sigaction(libc::SIGHUP, &raw const action, core::ptr::null_mut()) };
    }
    Hangups { taken: HANGUPS.load(Ordering::Relaxed), had_terminal: has_terminal() }
}

impl Hangups {
    /// What came since the last call; several signals count as one.
    pub fn take(&mut self) -> Option<Hangup> {
        let count = HANGUPS.load(Ordering::Relaxed);
        if core::mem::replace(&mut self.taken, count) == count {
            return None;
        }
        // A terminal that hangs up is taken away from its processes before they hear of it.
        Some(if self.had_terminal && !has_terminal() { Hangup::TerminalGone } else { Hangup::Reload })
    }
}

fn has_terminal() -> bool {
    std::fs::File::open("/dev/tty").is_ok()
}

/// Asks this process to stop, as SIGTERM from outside would.
pub fn interrupt() {
    // SAFETY: a signal to ourselves; what catches it was installed by `interrupts`, or ends the process.
    unsafe { libc::kill(libc::getpid(), libc::SIGTERM) };
}

fn is_hangup_ignored() -> bool {
    let mut old = MaybeUninit::<libc::sigaction>::zeroed();
    // SAFETY: without a new action the call only writes the old one, to memory of its type.
    let result = unsafe { libc::sigaction(libc::SIGHUP, core::ptr::null(), old.as_mut_ptr()) };
    // SAFETY: all-zero is a valid `sigaction` (SIG_DFL), and the kernel filled it if the call succeeded.
    result == 0 && unsafe { old.assume_init() }.sa_sigaction == libc::SIG_IGN
}
