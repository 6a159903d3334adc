//! Time of the loop: `CLOCK_MONOTONIC` with absolute sleep, or a clock that jumps.
#![expect(unsafe_code, reason = "clock_gettime and clock_nanosleep are libc calls")]

/// Which time a run follows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ClockKind {
    /// The machine's monotonic clock.
    #[default]
    Real,
    /// Simulated time: one period per tick, as fast as the processor goes.
    Virtual,
}

impl ClockKind {
    /// The name that the command line uses.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Real => "real",
            Self::Virtual => "virtual",
        }
    }
}

/// Time as the servo loop sees it. RT: every method is safe in the loop.
///
/// There are three times on purpose. *Loop time* decides when a tick is due and whether it is late;
/// under the virtual clock it is simulated and exact. *Elapsed time* goes on in a suspend of the
/// machine: the age of a command. *Stopwatch time* only measures how long
/// things took and never enters a tick; it is the machine's own clock under both kinds, so the
/// compute times of a virtual run are real measurements.
pub trait Clock: Send {
    /// Real or virtual.
    fn kind(&self) -> ClockKind;
    /// Loop time, ns from an arbitrary zero.
    fn now_ns(&mut self) -> i64;
    /// The same, and it goes on while the machine is suspended, where loop time stands still: the
    /// age of a command is measured with it. Its zero is another one.
    fn elapsed_ns(&mut self) -> i64 {
        self.now_ns()
    }
    /// Returns at or after the loop time `deadline_ns`; at once when that has passed.
    fn sleep_until(&mut self, deadline_ns: i64);
    /// Stopwatch time, ns from an arbitrary zero.
    fn stopwatch_ns(&self) -> i64 {
        monotonic_ns()
    }
}

/// The machine's monotonic clock.
#[derive(Clone, Copy, Debug, Default)]
pub struct RealClock;

impl Clock for RealClock {
    fn kind(&self) -> ClockKind {
        ClockKind::Real
    }

    fn now_ns(&mut self) -> i64 {
        monotonic_ns()
    }

    fn elapsed_ns(&mut self) -> i64 {
        elapsed_ns()
    }

    fn sleep_until(&mut self, deadline_ns: i64) {
        sleep_until_monotonic_ns(deadline_ns);
    }
}

/// Simulated time: starts at 0, moves only when the loop sleeps, and then exactly to the deadline.
#[derive(Clone, Copy, Debug, Default)]
pub struct VirtualClock {
    now_ns: i64,
}

impl Clock for VirtualClock {
    fn kind(&self) -> ClockKind {
        ClockKind::Virtual
    }

    fn now_ns(&mut self) -> i64 {
        self.now_ns
    }

    fn sleep_until(&mut self, deadline_ns: i64) {
        self.now_ns = self.now_ns.max(deadline_ns);
    }
}

const NS_PER_S: i64 = 1_000_000_000;

/// `CLOCK_MONOTONIC` in ns. RT: safe; a vDSO read, no system call on the usual clock sources.
pub fn monotonic_ns() -> i64 {
    read_ns(libc::CLOCK_MONOTONIC)
}

/// `CLOCK_BOOTTIME` in ns, which goes on while the machine is suspended. RT: safe, likewise.
pub fn elapsed_ns() -> i64 {
    read_ns(libc::CLOCK_BOOTTIME)
}

/// Processor time that the calling thread has used, ns: without the time in which others ran. RT:
/// safe; one system call.
pub fn thread_cpu_ns() -> i64 {
    read_ns(libc::CLOCK_THREAD_CPUTIME_ID)
}

/// One of the three clocks of this file, ns. RT: safe.
fn read_ns(clock: libc::clockid_t) -> i64 {
    let mut now = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: `now` is a valid, exclusive timespec; the clocks of this file exist on every Linux,
    // so the call cannot fail.
    unsafe {
        libc::clock_gettime(clock, &raw mut now);
    }
    now.tv_sec * NS_PER_S + now.tv_nsec
}

/// Sleeps until `CLOCK_MONOTONIC` shows `deadline_ns`. RT: safe; one system call. Absolute, so that
/// a signal or a preemption between reading the clock and sleeping does not add up.
fn sleep_until_monotonic_ns(deadline_ns: i64) {
    let deadline = libc::timespec {
        tv_sec: deadline_ns.div_euclid(NS_PER_S),
        tv_nsec: deadline_ns.rem_euclid(NS_PER_S),
    };
    loop {
        // SAFETY: `deadline` is a valid timespec with 0 <= tv_nsec < 1e9; a null remainder is
        // allowed with TIMER_ABSTIME.
        let result = unsafe {
            libc::clock_nanosleep(
                libc::CLOCK_MONOTONIC,
                libc::TIMER_ABSTIME,
                &raw const deadline,
                core::ptr::null_mut(),
            )
        };
        // Only a signal is worth another try; the arguments are right, so any other error would
        // repeat for ever.
        if result != libc::EINTR {
            return;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_virtual_clock_stands_still_until_the_loop_sleeps() {
        let mut clock = VirtualClock::default();
        assert_eq!(clock.now_ns(), 0);
        clock.sleep_until(1_000_000);
        assert_eq!(clock.now_ns(), 1_000_000);
        clock.sleep_until(500_000);
        assert_eq!(clock.now_ns(), 1_000_000, "time does not run backwards");
    }

    #[test]
    fn a_thread_that_sleeps_uses_no_processor_time() {
        let begin_ns = monotonic_ns();
        let begin_used_ns = thread_cpu_ns();
        sleep_until_monotonic_ns(begin_ns + 20_000_000);
        let used_ns = thread_cpu_ns() - begin_used_ns;
        assert!(used_ns > 0 && used_ns < monotonic_ns() - begin_ns, "{used_ns} ns");
    }

    #[test]
    fn elapsed_time_goes_as_fast_as_loop_time_while_the_machine_is_awake() {
        let mut clock = RealClock;
        let begin_ns = clock.now_ns();
        let begin_elapsed_ns = clock.elapsed_ns();
        sleep_until_monotonic_ns(begin_ns + 20_000_000);
        let elapsed_ns = clock.elapsed_ns() - begin_elapsed_ns;
        let before_ns = clock.now_ns() - begin_ns;
        assert!((19_000_000..=before_ns).contains(&elapsed_ns), "{elapsed_ns} {before_ns}");
    }

    #[test]
    fn the_real_clock_never_wakes_before_the_deadline() {
        let mut clock = RealClock;
        for _ in 0..5 {
            let deadline_ns = clock.now_ns() + 300_000;
            clock.sleep_until(deadline_ns);
            assert!(clock.now_ns() >= deadline_ns);
        }
        clock.sleep_until(0);
    }
}
