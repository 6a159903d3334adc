//! What the machine offers a 1 kHz loop, row by row, before the first tick.
//!
//! Data, no text layout: the command line prints the rows, the record keeps them. `enforce` refuses
//! to run when a row failed; `best-effort` names those rows as what it gave up.

use std::path::Path;

use super::schedule::{CpuSharing, MemoryLockRefusal, ThreadRequest, ThreadStanding};

/// How a check ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CheckOutcome {
    /// As a 1 kHz loop wants it.
    Passed,
    /// Not as it wants it.
    Failed,
    /// The machine does not say (a virtual machine without a governor, say). Never a reason to
    /// refuse.
    Unknown,
}

impl CheckOutcome {
    /// The word that clients and recordings have for it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Passed => "passed",
            Self::Failed => "failed",
            Self::Unknown => "unknown",
        }
    }
}

/// One check.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct CheckRow {
    /// What was checked.
    pub name: &'static str,
    /// How it ended.
    pub outcome: CheckOutcome,
    /// What was found.
    pub found: String,
    /// What to do about it; empty when there is nothing to do.
    pub hint: &'static str,
}

/// What the kernel says of itself.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct KernelFacts {
    /// `uname -r`.
    pub release: String,
    /// Built with PREEMPT_RT.
    pub preempt_rt: bool,
    /// Frequency governor of the servo's processor.
    pub governor: Option<String>,
    /// Current clock source.
    pub clocksource: Option<String>,
}

impl KernelFacts {
    /// Reads them for processor `cpu`. RT: start-up only.
    pub fn read(cpu: usize) -> Self {
        let version = read_line("/proc/sys/kernel/version").unwrap_or_default();
        Self {
            release: read_line("/proc/sys/kernel/osrelease").unwrap_or_default(),
            preempt_rt: version.contains("PREEMPT_RT")
                || read_line("/sys/kernel/realtime").as_deref() == Some("1"),
            governor: read_line(format!(
                "/sys/devices/system/cpu/cpu{cpu}/cpufreq/scaling_governor"
            )),
            clocksource: read_line(
                "/sys/devices/system/clocksource/clocksource0/current_clocksource",
            ),
        }
    }
}

fn read_line(path: impl AsRef<Path>) -> Option<String> {
    std::fs::read_to_string(path).ok().map(|text| text.trim().to_owned())
}

/// The whole report: rows for people, and the facts that summaries repeat.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PreflightReport {
    /// In the order in which they are printed.
    pub rows: Vec<CheckRow>,
    /// What the servo thread got.
    pub standing: ThreadStanding,
    /// Every page of the process is locked.
    pub memory_locked: bool,
    /// The kernel is built with PREEMPT_RT.
    pub kernel_rt: bool,
}

impl PreflightReport {
    /// Judges what was asked for against what was obtained.
    pub fn judge(
        kernel: &KernelFacts,
        request: ThreadRequest,
        standing: ThreadStanding,
        memory: Result<(), MemoryLockRefusal>,
    ) -> Self {
        let rows = vec![
            kernel_row(kernel),
            policy_row(request, standing),
            affinity_row(request, standing),
            memory_row(memory),
            governor_row(kernel),
            clocksource_row(kernel),
        ];
        Self { rows, standing, memory_locked: memory.is_ok(), kernel_rt: kernel.preempt_rt }
    }

    /// The report of a run under the virtual clock: nothing is asked of the scheduler, so nothing
    /// can be refused. A loop that never sleeps under SCHED_FIFO would only starve its processor.
    pub fn virtual_clock(kernel: &KernelFacts) -> Self {
        let rows = vec![CheckRow {
            name: "clock",
            outcome: CheckOutcome::Passed,
            found: "virtual: time is simulated, real-time scheduling is not used".to_owned(),
            hint: "",
        }];
        Self {
            rows,
            standing: ThreadStanding::default(),
            memory_locked: false,
            kernel_rt: kernel.preempt_rt,
        }
    }

    /// Rows that failed.
    pub fn failed(&self) -> impl Iterator<Item = &CheckRow> {
        self.rows.iter().filter(|row| row.outcome == CheckOutcome::Failed)
    }

    /// True when no row failed.
    pub fn passed(&self) -> bool {
        self.failed().next().is_none()
    }
}

fn row(name: &'static str, passed: bool, found: String, hint: &'static str) -> CheckRow {
    let (outcome, hint) =
        if passed { (CheckOutcome::Passed, "") } else { (CheckOutcome::Failed, hint) };
    CheckRow { name, outcome, found, hint }
}

fn kernel_row(kernel: &KernelFacts) -> CheckRow {
    let kind = if kernel.preempt_rt { "PREEMPT_RT" } else { "not PREEMPT_RT" };
    row(
        "kernel",
        kernel.preempt_rt,
        format!("{}, {kind}", kernel.release),
        "boot a kernel built with PREEMPT_RT",
    )
}

fn policy_row(request: ThreadRequest, standing: ThreadStanding) -> CheckRow {
    let found = if standing.fifo {
        format!("SCHED_FIFO, priority {}", standing.priority)
    } else {
        format!("time-sharing; SCHED_FIFO was refused ({})", errno_text(standing.schedule_errno))
    };
    let passed = standing.fifo && standing.priority == request.priority;
    row(
        "scheduling",
        passed,
        found,
        "allow it: `* - rtprio 99` in /etc/security/limits.d, or run with CAP_SYS_NICE",
    )
}

fn affinity_row(request: ThreadRequest, standing: ThreadStanding) -> CheckRow {
    let is_shared = standing.sharing == CpuSharing::Shared;
    row(
        "affinity",
        standing.cpu.is_some() && !is_shared,
        affinity_text(request, standing),
        if is_shared {
            "end the other program, or name another processor in [realtime] cpu"
        } else {
            "name a processor that exists and that this process may use in [realtime] cpu"
        },
    )
}

/// Which processor the thread is pinned to, and who else is.
pub(super) fn affinity_text(request: ThreadRequest, standing: ThreadStanding) -> String {
    let Some(cpu) = standing.cpu else {
        let why = errno_text(standing.affinity_errno);
        return format!("processor {} was refused ({why})", request.cpu);
    };
    match standing.sharing {
        CpuSharing::Own => format!("pinned to processor {cpu}"),
        CpuSharing::InsteadOf(other) => format!(
            "pinned to processor {cpu}, because the loop of another program has processor {other}"
        ),
        CpuSharing::Shared => format!(
            "pinned to processor {cpu}, and so is the loop of another program: they delay each \
                other"
        ),
    }
}

fn memory_row(memory: Result<(), MemoryLockRefusal>) -> CheckRow {
    let found = match memory {
        Ok(()) => "every page is locked".to_owned(),
        Err(MemoryLockRefusal::Limit { bytes }) => {
            format!("not locked; the memlock limit is {} KiB", bytes / 1024)
        }
        Err(MemoryLockRefusal::Errno(errno)) => format!("not locked ({})", errno_text(errno)),
    };
    row(
        "memory",
        memory.is_ok(),
        found,
        "allow it: `* - memlock unlimited` in /etc/security/limits.d, or run with CAP_IPC_LOCK",
    )
}

fn governor_row(kernel: &KernelFacts) -> CheckRow {
    match kernel.governor.as_deref() {
        Some(governor) => row(
            "governor",
            governor == "performance",
            governor.to_owned(),
            "set the frequency governor to `performance`",
        ),
        None => CheckRow {
            name: "governor",
            outcome: CheckOutcome::Unknown,
            found: "not reported".to_owned(),
            hint: "",
        },
    }
}

/// Clock sources that a program can read without a system call.
const FAST_CLOCKSOURCES: [&str; 3] = ["tsc", "kvm-clock", "arch_sys_counter"];

fn clocksource_row(kernel: &KernelFacts) -> CheckRow {
    match kernel.clocksource.as_deref() {
        Some(source) => row(
            "clock source",
            FAST_CLOCKSOURCES.contains(&source),
            source.to_owned(),
            "choose `tsc` as the kernel's clock source",
        ),
        None => CheckRow {
            name: "clock source",
            outcome: CheckOutcome::Unknown,
            found: "not reported".to_owned(),
            hint: "",
        },
    }
}

fn errno_text(errno: i32) -> String {
    std::io::Error::from_raw_os_error(errno).to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    const REQUEST: ThreadRequest = ThreadRequest { cpu: 1, priority: 80 };

    fn tuned() -> KernelFacts {
        KernelFacts {
            release: "6.12.0".to_owned(),
            preempt_rt: true,
            governor: Some("performance".to_owned()),
            clocksource: Some("tsc".to_owned()),
        }
    }

    fn obtained() -> ThreadStanding {
        ThreadStanding { fifo: true, priority: 80, cpu: Some(1), ..ThreadStanding::default() }
    }

    #[test]
    fn a_tuned_machine_passes_every_row() {
        let report = PreflightReport::judge(&tuned(), REQUEST, obtained(), Ok(()));
        assert!(report.passed(), "{report:?}");
        assert!(report.memory_locked && report.kernel_rt);
    }

    #[test]
    fn every_refusal_is_a_row_with_a_hint() {
        let kernel = KernelFacts {
            preempt_rt: false,
            governor: Some("powersave".to_owned()),
            clocksource: Some("hpet".to_owned()),
            ..tuned()
        };
        let standing =
            ThreadStanding { schedule_errno: 1, affinity_errno: 22, ..ThreadStanding::default() };
        let report = PreflightReport::judge(
            &kernel,
            REQUEST,
            standing,
            Err(MemoryLockRefusal::Limit { bytes: 65_536 }),
        );
        let failed: Vec<_> = report.failed().map(|row| row.name).collect();
        assert_eq!(
            failed,
            ["kernel", "scheduling", "affinity", "memory", "governor", "clock source"]
        );
        assert!(report.failed().all(|row| !row.hint.is_empty()));
    }

    #[test]
    fn what_the_machine_does_not_say_is_not_held_against_it() {
        let kernel = KernelFacts { governor: None, clocksource: None, ..tuned() };
        assert!(PreflightReport::judge(&kernel, REQUEST, obtained(), Ok(())).passed());
    }

    #[test]
    fn a_processor_that_two_loops_have_is_a_failure_and_another_one_is_said() {
        let judged = |sharing| {
            let standing = ThreadStanding { sharing, ..obtained() };
            let report = PreflightReport::judge(&tuned(), REQUEST, standing, Ok(()));
            let row = report.rows.into_iter().find(|row| row.name == "affinity").expect("a row");
            (row.outcome, row.found)
        };
        let (outcome, found) = judged(CpuSharing::Shared);
        assert!(outcome == CheckOutcome::Failed && found.contains("processor 1"), "{found}");
        let (outcome, found) = judged(CpuSharing::InsteadOf(3));
        assert!(outcome == CheckOutcome::Passed && found.contains("processor 3"), "{found}");
    }

    #[test]
    fn a_lower_priority_than_asked_for_fails() {
        let standing = ThreadStanding { priority: 10, ..obtained() };
        assert!(!PreflightReport::judge(&tuned(), REQUEST, standing, Ok(())).passed());
    }

    #[test]
    fn the_facts_of_this_machine_can_be_read() {
        assert!(!KernelFacts::read(0).release.is_empty());
    }
}
