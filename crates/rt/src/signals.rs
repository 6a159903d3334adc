//! Signals: each that can be caught takes force away before anything else is done.
//!
//! | signal | does |
//! |---|---|
//! | INT, TERM (by `ctrlc`), QUIT, ABRT, USR1, USR2, ALRM, VTALRM, PROF, XCPU, IO, PWR, SYS, TRAP, STKFLT, the real-time ones | ramp down and end; the second one at once |
//! | HUP | the same when the terminal has gone; else the scene is read again |
//! | TSTP (Ctrl-Z) | force off, then the process stops; `fg` leaves it off. Of `devices probe` and `doctor`: an end |
//! | TTOU, TTIN, PIPE, XFSZ | ignored: the write or read that caused it fails |
//! | SEGV, BUS, ILL, FPE | sent by another process: ramp down and end; of an instruction of our own, as KILL: the guard process and the arm's own watchdog are what is left |
//! | KILL, STOP | cannot be caught: likewise |
//!
//! A handler touches atomics and nothing else: the [`Control`] of the loop, and counters for
//! threads that have time.
#![expect(
    unsafe_code,
    reason = "asking for, ignoring, counting and sending signals are libc calls"
)]

use core::mem::MaybeUninit;
use core::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, OnceLock};

use super::control::Control;

/// The handler could not be installed.
#[derive(Debug, thiserror::Error)]
#[error("cannot catch signals: {0}")]
pub struct SignalError(#[from] ctrlc::Error);

/// What the signals end. Set once, before the handlers are installed.
static CONTROL: OnceLock<Arc<Control>> = OnceLock::new();
/// How often an end was asked for.
static INTERRUPTS: AtomicU32 = AtomicU32::new(0);
/// The same as a flag, for loops that only want to know.
static INTERRUPTED: AtomicBool = AtomicBool::new(false);
/// How often SIGHUP has asked for the files.
static RELOADS: AtomicU32 = AtomicU32::new(0);
/// SIGHUP came because the terminal has gone.
static TERMINAL_GONE: AtomicBool = AtomicBool::new(false);
/// There was a terminal that could go.
static HAD_TERMINAL: AtomicBool = AtomicBool::new(false);
/// SIGTSTP has come.
static SUSPENDED: AtomicBool = AtomicBool::new(false);

/// Signals that end a program by default, and that nothing here sends on purpose.
const ENDING: [libc::c_int; 13] = [
    libc::SIGQUIT,
    libc::SIGABRT,
    libc::SIGUSR1,
    libc::SIGUSR2,
    libc::SIGALRM,
    libc::SIGVTALRM,
    libc::SIGPROF,
    libc::SIGXCPU,
    libc::SIGIO,
    libc::SIGPWR,
    libc::SIGSYS,
    libc::SIGTRAP,
    libc::SIGSTKFLT,
];
/// Signals of an instruction that cannot go on. Sent from outside they are like any other; what
/// handled them before keeps the rest.
const OF_INSTRUCTIONS: [libc::c_int; 4] = [libc::SIGSEGV, libc::SIGBUS, libc::SIGILL, libc::SIGFPE];
/// What handled them before.
static BEFORE: [OnceLock<libc::sigaction>; OF_INSTRUCTIONS.len()] =
    [const { OnceLock::new() }; OF_INSTRUCTIONS.len()];
/// A write or read fails instead: a file that grows beyond a limit, or a terminal that belongs to
/// another job, is no reason to leave an arm alone.
const IGNORED: [libc::c_int; 3] = [libc::SIGXFSZ, libc::SIGTTOU, libc::SIGTTIN];

/// From now on signals end what `control` runs. Once per process.
///
/// A SIGHUP that the caller has reported the program to ignore (`nohup`) stays ignored. An ignored
/// SIGINT does not: a shell without job control ignores it for everything in the background, and a
/// program that moves an arm stops when it is asked to.
///
/// # Errors
/// The operating system refused, or this or [`interrupted`] was called before.
pub fn end_by_signals(control: &Arc<Control>) -> Result<(), SignalError> {
    // Refused below when it was set before.
    let _ = CONTROL.set(control.clone());
    catch_ends()
}

/// Until signals are caught, an interrupt ends the program at once, also where a shell without job
/// control has reported it to ignore interrupts: for what waits long while an arm moves by itself.
pub fn interrupt_ends() {
    // SAFETY: SIG_DFL is a valid disposition and runs no code of ours.
    unsafe { libc::signal(libc::SIGINT, libc::SIG_DFL) };
}

/// A flag that the first signal that asks for an end sets; for what has no [`Control`]. Ctrl-Z asks
/// for an end too: what is stopped in the middle would leave its last command on the arm. Once per
/// process.
///
/// # Errors
/// As [`end_by_signals`].
pub fn interrupted() -> Result<&'static AtomicBool, SignalError> {
    catch_ends()?;
    handle(libc::SIGTSTP, on_end);
    Ok(&INTERRUPTED)
}

/// How often an end was asked for so far.
pub fn interrupts() -> u32 {
    INTERRUPTS.load(Ordering::Relaxed)
}

fn catch_ends() -> Result<(), SignalError> {
    let ignores_hangup = is_hangup_ignored();
    ctrlc::set_handler(end)?;
    for signal in ENDING.into_iter().chain(libc::SIGRTMIN()..=libc::SIGRTMAX()) {
        handle(signal, on_end);
    }
    for (signal, before) in OF_INSTRUCTIONS.into_iter().zip(&BEFORE) {
        handle_sent(signal, before);
    }
    for signal in IGNORED {
        ignore(signal);
    }
    if ignores_hangup {
        ignore(libc::SIGHUP);
    }
    Ok(())
}

/// A signal asks for an end. Only atomics: it runs in signal handlers.
fn end() {
    INTERRUPTED.store(true, Ordering::Relaxed);
    INTERRUPTS.fetch_add(1, Ordering::Relaxed);
    if let Some(control) = CONTROL.get() {
        control.interrupt();
    }
}

extern "C" fn on_end(_signal: libc::c_int) {
    end();
}

extern "C" fn on_instruction(
    signal: libc::c_int,
    info: *mut libc::siginfo_t,
    _context: *mut libc::c_void,
) {
    // SAFETY: with SA_SIGINFO the kernel hands a whole `siginfo_t` to the handler.
    let is_sent = unsafe { info.as_ref() }.is_some_and(|info| info.si_code <= 0);
    if is_sent {
        return end();
    }
    // The instruction runs again, and finds what handled it before: the standard library names a
    // stack that overflowed.
    let before =
        OF_INSTRUCTIONS.iter().position(|known| *known == signal).and_then(|idx| BEFORE[idx].get());
    let action = before.map_or(core::ptr::null(), core::ptr::from_ref);
    // SAFETY: `before` came from the kernel; without one the call changes nothing, and the default
    // below ends the process.
    unsafe {
        if action.is_null() {
            libc::signal(signal, libc::SIG_DFL);
        } else {
            libc::sigaction(signal, action, core::ptr::null_mut());
        }
    }
}

/// What a SIGHUP meant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Hangup {
    /// The program is to read its files again.
    Reload,
    /// The terminal has gone, and with it its user: an end was asked for.
    TerminalGone,
}

/// What SIGHUP asked for since [`hangups`].
#[derive(Debug)]
pub struct Hangups {
    taken: u32,
}

/// SIGHUP ends the program from now on only when the terminal has gone, and is counted else; call
/// it after [`end_by_signals`]. One that the program was ordered to ignore (`nohup`) stays ignored.
pub fn hangups() -> Hangups {
    HAD_TERMINAL.store(has_terminal(), Ordering::Relaxed);
    if !is_hangup_ignored() {
        handle(libc::SIGHUP, on_hangup);
    }
    Hangups { taken: RELOADS.load(Ordering::Relaxed) }
}

extern "C" fn on_hangup(_signal: libc::c_int) {
    // SAFETY: the place of this thread's errno: what was interrupted may be about to read it.
    let errno = unsafe { *libc::__errno_location() };
    // A terminal that hangs up is taken away from its processes before they get the signal.
    if HAD_TERMINAL.load(Ordering::Relaxed) && !has_terminal() {
        TERMINAL_GONE.store(true, Ordering::Relaxed);
        end();
    } else {
        RELOADS.fetch_add(1, Ordering::Relaxed);
    }
    // SAFETY: as above.
    unsafe { *libc::__errno_location() = errno };
}

impl Hangups {
    /// What came since the last call; several signals count as one.
    pub fn take(&mut self) -> Option<Hangup> {
        if TERMINAL_GONE.swap(false, Ordering::Relaxed) {
            return Some(Hangup::TerminalGone);
        }
        let count = RELOADS.load(Ordering::Relaxed);
        (core::mem::replace(&mut self.taken, count) != count).then_some(Hangup::Reload)
    }
}

/// Whether this process has a terminal. Two system calls that a signal handler may make.
fn has_terminal() -> bool {
    // SAFETY: the path ends with a zero byte; the descriptor is closed here.
    unsafe {
        let terminal = libc::open(
            c"/dev/tty".as_ptr(),
            libc::O_RDONLY | libc::O_NOCTTY | libc::O_CLOEXEC | libc::O_NONBLOCK,
        );
        terminal >= 0 && libc::close(terminal) == 0
    }
}

/// Ctrl-Z takes force away from now on, and stops the process only by [`stop_process`]: an arm that
/// is pressed against something would hold its force for as long as the process is stopped. After
/// [`end_by_signals`].
pub fn suspend_without_force() {
    handle(libc::SIGTSTP, on_suspend);
}

extern "C" fn on_suspend(_signal: libc::c_int) {
    if let Some(control) = CONTROL.get() {
        control.disable();
    }
    SUSPENDED.store(true, Ordering::Relaxed);
}

/// True once after each Ctrl-Z.
pub fn take_suspend() -> bool {
    SUSPENDED.swap(false, Ordering::Relaxed)
}

/// Stops this process until it is continued, as the default of SIGTSTP does.
pub fn stop_process() {
    // SAFETY: a signal to ourselves.
    unsafe { libc::kill(libc::getpid(), libc::SIGSTOP) };
}

fn handle(signal: libc::c_int, handler: extern "C" fn(libc::c_int)) {
    // SAFETY: all-zero is a valid `sigaction`: no flags, an empty mask.
    let mut action = unsafe { MaybeUninit::<libc::sigaction>::zeroed().assume_init() };
    action.sa_sigaction = handler as libc::sighandler_t;
    action.sa_flags = libc::SA_RESTART;
    // SAFETY: `action` is a whole `sigaction`, and every handler of this file uses atomics and
    // calls that a signal handler may make.
    unsafe { libc::sigaction(signal, &raw const action, core::ptr::null_mut()) };
}

fn handle_sent(signal: libc::c_int, before: &OnceLock<libc::sigaction>) {
    // SAFETY: all-zero is a valid `sigaction`: no flags, an empty mask.
    let mut action = unsafe { MaybeUninit::<libc::sigaction>::zeroed().assume_init() };
    let handler: extern "C" fn(libc::c_int, *mut libc::siginfo_t, *mut libc::c_void) =
        on_instruction;
    action.sa_sigaction = handler as libc::sighandler_t;
    // On the stack that the standard library keeps for a thread whose own has overflowed.
    action.sa_flags = libc::SA_SIGINFO | libc::SA_ONSTACK | libc::SA_RESTART;
    let mut old = MaybeUninit::<libc::sigaction>::zeroed();
    // SAFETY: both are whole `sigaction`s, and the handler uses atomics and calls that a signal
    // handler may make.
    if unsafe { libc::sigaction(signal, core::ptr::null(), old.as_mut_ptr()) } == 0 {
        // SAFETY: all-zero is a valid `sigaction`, and the kernel filled it.
        let _ = before.set(unsafe { old.assume_init() });
    }
    // SAFETY: as above. Only now: the handler needs what was there before.
    unsafe { libc::sigaction(signal, &raw const action, core::ptr::null_mut()) };
}

fn ignore(signal: libc::c_int) {
    // SAFETY: SIG_IGN is a valid disposition and runs no code of ours.
    unsafe { libc::signal(signal, libc::SIG_IGN) };
}

fn is_hangup_ignored() -> bool {
    let mut old = MaybeUninit::<libc::sigaction>::zeroed();
    // SAFETY: without a new action the call only writes the old one, to memory of its type.
    let result = unsafe { libc::sigaction(libc::SIGHUP, core::ptr::null(), old.as_mut_ptr()) };
    // SAFETY: all-zero is a valid `sigaction` (SIG_DFL), and the kernel filled it if the call
    // succeeded.
    result == 0 && unsafe { old.assume_init() }.sa_sigaction == libc::SIG_IGN
}
