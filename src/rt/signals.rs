//! Ctrl-C, SIGTERM and SIGHUP as messages.
#![expect(unsafe_code, reason = "asking for and ignoring signals are libc calls")]

use core::mem::MaybeUninit;

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

fn is_hangup_ignored() -> bool {
    let mut old = MaybeUninit::<libc::sigaction>::zeroed();
    // SAFETY: without a new action the call only writes the old one, to memory of its type.
    let result = unsafe { libc::sigaction(libc::SIGHUP, core::ptr::null(), old.as_mut_ptr()) };
    // SAFETY: all-zero is a valid `sigaction` (SIG_DFL), and the kernel filled it if the call succeeded.
    result == 0 && unsafe { old.assume_init() }.sa_sigaction == libc::SIG_IGN
}
