//! The one entrance into real time of a loop that commands an arm: scheduling, processor, memory.
//!
//! `run`, `devices probe`, `doctor`, `device-node` and the worker of a maker's library enter here,
//! each in a thread of the loop's own, and say what they got by [`Entered::judge`].

use std::sync::{Mutex, PoisonError};

use super::preflight::{KernelFacts, PreflightReport};
use super::schedule::{self, MemoryLockRefusal, ThreadRequest, ThreadStanding};

/// What was asked for, and what was obtained.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Entered {
    /// What the thread asked for.
    pub request: ThreadRequest,
    /// What the thread got.
    pub standing: ThreadStanding,
    /// Whether the memory of the process is locked.
    pub memory: Result<(), MemoryLockRefusal>,
}

impl Entered {
    /// What the machine offers this loop, row by row. Cold.
    pub fn judge(&self) -> PreflightReport {
        let kernel = KernelFacts::read(self.request.cpu);
        PreflightReport::judge(&kernel, self.request, self.standing, self.memory)
    }
}

/// A thread in real time. At the drop of the last one the memory of the process is unlocked, so that the process
/// of a library's user goes back to what it was; the thread keeps its schedule, and is to end.
#[derive(Debug)]
pub struct RealtimeThread(Entered);

impl RealtimeThread {
    /// What it got.
    pub const fn entered(&self) -> Entered {
        self.0
    }
}

/// Threads of this process that rely on its locked memory.
static RELYING: Mutex<usize> = Mutex::new(0);

impl Drop for RealtimeThread {
    fn drop(&mut self) {
        if self.0.memory.is_ok() {
            let mut relying = RELYING.lock().unwrap_or_else(PoisonError::into_inner);
            *relying -= 1;
            if *relying == 0 {
                schedule::unlock_memory();
            }
        }
    }
}

/// Takes the calling thread into real time as far as the system allows: every page of the process
/// locked, the processor, SCHED_FIFO, a touched stack. Threads that it starts later inherit its
/// schedule. RT: start-up only.
#[must_use = "at the drop the memory is unlocked"]
pub fn enter(request: ThreadRequest) -> RealtimeThread {
    let mut relying = RELYING.lock().unwrap_or_else(PoisonError::into_inner);
    let memory = schedule::lock_memory();
    *relying += usize::from(memory.is_ok());
    drop(relying);
    RealtimeThread(Entered { request, standing: schedule::enter_realtime(request), memory })
}

/// Runs `work` in a thread of its own that has entered real time, and `meanwhile` in the calling one
/// meanwhile. Cold.
///
/// # Errors
/// The thread cannot be started, or has panicked.
pub fn run<T: Send>(
    name: &str,
    request: ThreadRequest,
    work: impl FnOnce(Entered) -> T + Send,
    meanwhile: impl FnOnce(),
) -> std::io::Result<T> {
    std::thread::scope(|scope| {
        let thread =
            std::thread::Builder::new().name(name.to_owned()).spawn_scoped(scope, || {
                let thread = enter(request);
                work(thread.entered())
            })?;
        meanwhile();
        thread.join().map_err(|_| std::io::Error::other(format!("the thread {name} panicked")))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::preflight::CheckOutcome;

    #[test]
    fn a_loop_enters_in_a_thread_of_its_own_and_says_what_it_got() {
        let request = ThreadRequest { cpu: schedule::loop_cpu(None), priority: 1 };
        let mut has_looked = false;
        let (name, entered) = run(
            "loop",
            request,
            |entered| (std::thread::current().name().map(str::to_owned), entered),
            || has_looked = true,
        )
        .expect("a thread");
        assert!(has_looked && name.as_deref() == Some("loop"));
        assert_eq!((entered.request, entered.standing.cpu), (request, Some(request.cpu)));
        let report = entered.judge();
        let outcome = |name| report.rows.iter().find(|row| row.name == name).map(|row| row.outcome);
        let passed =
            |is_got| Some(if is_got { CheckOutcome::Passed } else { CheckOutcome::Failed });
        assert_eq!(outcome("scheduling"), passed(entered.standing.fifo));
        assert_eq!(outcome("memory"), passed(entered.memory.is_ok()));
    }

    #[test]
    fn a_loop_that_panics_is_an_error_of_its_thread() {
        let request = ThreadRequest { cpu: schedule::loop_cpu(None), priority: 1 };
        let ended = run("loop", request, |_| assert!(request.priority > 1), || {});
        assert!(ended.is_err_and(|error| error.to_string().contains("loop")));
    }
}
