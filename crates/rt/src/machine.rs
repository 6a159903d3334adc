//! What a machine offers a 1 kHz loop, beyond what the servo thread itself is granted: kernel,
//! clock, governor, processors, memory, rights.
//!
//! Data out: [`Finding`]s, each with what to type.

use super::finding::{Finding, Root};
use super::preflight::affinity_text;
use super::realtime::Entered;
use super::schedule::{CpuSharing, MemoryLockRefusal};

/// What gives an ordinary user the rights of a real-time loop: what to type. `program` is the path
/// of this one.
fn rights_advice(program: &str) -> String {
    format!(
        "sudo setcap cap_sys_nice,cap_ipc_lock=ep {program}\nor, for every program of a group: \
            sudo groupadd -f realtime && sudo usermod -aG realtime \"$USER\" && printf '@realtime \
            - rtprio 99\\n@realtime - memlock unlimited\\n' | sudo tee \
            /etc/security/limits.d/99-hapticd.conf, then log out and in again"
    )
}

/// Everything about the machine that files say. `cpu`: where the servo runs.
pub fn findings(root: &Root, cpu: usize) -> Vec<Finding> {
    let mut findings = vec![
        kernel(root),
        clock_source(root),
        governor(root, cpu),
        isolated(root, cpu),
        throttling(root),
        limits(root),
    ];
    findings.extend(swap(root));
    findings
}

fn kernel(root: &Root) -> Finding {
    let release = root
        .read("/proc/sys/kernel/osrelease")
        .unwrap_or_else(|| "kernel of unknown release".to_owned());
    let version = root.read("/proc/sys/kernel/version").unwrap_or_default();
    if version.contains("PREEMPT_RT") || root.read("/sys/kernel/realtime").as_deref() == Some("1") {
        return Finding::good("kernel", format!("{release}, PREEMPT_RT"));
    }
    Finding::advice(
        "kernel",
        format!("{release}, not PREEMPT_RT: wake-ups may be late by a millisecond now and then"),
        "sudo apt-get install linux-image-rt-amd64   # Debian; other systems name it differently. \
            Then boot it",
    )
}

/// Clock sources that a program can read without a system call.
const FAST_CLOCKSOURCES: [&str; 3] = ["tsc", "kvm-clock", "arch_sys_counter"];

fn clock_source(root: &Root) -> Finding {
    const FILE: &str = "/sys/devices/system/clocksource/clocksource0/current_clocksource";
    match root.read(FILE) {
        Some(source) if FAST_CLOCKSOURCES.contains(&source.as_str()) => {
            Finding::good("clock source", source)
        }
        Some(source) => Finding::advice(
            "clock source",
            format!("{source}: slow to read"),
            format!("echo tsc | sudo tee {FILE}"),
        ),
        None => Finding::unknown("clock source", "not reported"),
    }
}

fn governor(root: &Root, cpu: usize) -> Finding {
    let file = format!("/sys/devices/system/cpu/cpu{cpu}/cpufreq/scaling_governor");
    match root.read(&file) {
        Some(governor) if governor == "performance" => {
            Finding::good("governor", format!("performance (processor {cpu})"))
        }
        Some(governor) => Finding::advice(
            "governor",
            format!("{governor} (processor {cpu}): it slows down between ticks"),
            "echo performance | sudo tee /sys/devices/system/cpu/cpu*/cpufreq/scaling_governor",
        ),
        None => Finding::unknown(
            "governor",
            "not reported: a virtual machine, or a processor of one frequency",
        ),
    }
}

fn isolated(root: &Root, cpu: usize) -> Finding {
    match root.read("/sys/devices/system/cpu/isolated") {
        Some(list) if holds(&list, cpu) => {
            Finding::good("isolated processors", format!("{list}; the servo runs on {cpu}"))
        }
        Some(list) => {
            let found = if list.is_empty() {
                "none".to_owned()
            } else {
                format!("{list}; the servo runs on {cpu}")
            };
            Finding::advice(
                "isolated processors",
                found,
                format!(
                    "add isolcpus={cpu} to GRUB_CMDLINE_LINUX in /etc/default/grub, then: sudo \
                    update-grub && sudo reboot"
                ),
            )
            .by_hand()
        }
        None => Finding::unknown("isolated processors", "not reported"),
    }
}

/// True when a list such as `1,4-7` names `cpu`.
fn holds(list: &str, cpu: usize) -> bool {
    list.split(',').any(|part| match part.trim().split_once('-') {
        Some((first, last)) => {
            matches!((first.parse(), last.parse::<usize>()), (Ok(first), Ok(last)) if (first..=last).contains(&cpu))
        }
        None => part.trim().parse() == Ok(cpu),
    })
}

fn throttling(root: &Root) -> Finding {
    const FILE: &str = "/proc/sys/kernel/sched_rt_runtime_us";
    let period = root
        .read("/proc/sys/kernel/sched_rt_period_us")
        .and_then(|text| text.parse::<i64>().ok())
        .unwrap_or(1_000_000);
    match root.read(FILE).and_then(|text| text.parse::<i64>().ok()) {
        Some(runtime) if runtime < 0 || runtime * 10 >= period * 9 => Finding::good(
            "real-time share",
            if runtime < 0 {
                "all of it".to_owned()
            } else {
                format!("{} %", runtime * 100 / period)
            },
        ),
        Some(runtime) => Finding::bad(
            "real-time share",
            format!("{} %: the kernel stops a real-time thread beyond it", runtime * 100 / period),
            format!("echo 950000 | sudo tee {FILE}"),
        ),
        None => Finding::unknown("real-time share", "not reported"),
    }
}

fn limits(root: &Root) -> Finding {
    let limits = root.read("/proc/self/limits").unwrap_or_default();
    let soft = |name: &str| {
        limits
            .lines()
            .find_map(|line| line.strip_prefix(name)?.split_whitespace().next().map(str::to_owned))
    };
    let priority = soft("Max realtime priority");
    let memory = soft("Max locked memory");
    match (priority, memory) {
        (Some(priority), Some(memory)) => Finding::good(
            "limits",
            format!(
                "rtprio {priority}, memlock {}",
                if memory == "unlimited" { memory } else { memory + " bytes" }
            ),
        ),
        _ => Finding::unknown("limits", "not reported"),
    }
}

fn swap(root: &Root) -> Option<Finding> {
    let swaps = root.read("/proc/swaps")?;
    let areas: Vec<&str> =
        swaps.lines().skip(1).filter_map(|line| line.split_whitespace().next()).collect();
    Some(match areas.as_slice() {
        [] => Finding::good("swap", "none"),
        areas => Finding::good(
            "swap",
            format!("{}: pages that are locked never go there", areas.join(", ")),
        ),
    })
}

/// What a thread that asked for its place got: the rights that count.
pub fn rights(entered: &Entered, program: &str) -> Vec<Finding> {
    let Entered { request, standing, memory } = *entered;
    let errno = |errno: i32| std::io::Error::from_raw_os_error(errno).to_string();
    let scheduling = if standing.fifo {
        Finding::good("scheduling", format!("SCHED_FIFO, priority {}", standing.priority))
    } else {
        let found = format!(
            "SCHED_FIFO was refused ({}): any program may delay the loop",
            errno(standing.schedule_errno)
        );
        Finding::bad("scheduling", found, rights_advice(program))
    };
    let text = affinity_text(request, standing);
    let affinity = match (standing.cpu, standing.sharing) {
        (Some(_), CpuSharing::Own | CpuSharing::InsteadOf(_)) => Finding::good("affinity", text),
        (Some(_), CpuSharing::Shared) => Finding::advice(
            "affinity",
            text,
            "end the other program, or name another processor as [realtime] cpu of the scene",
        )
        .by_hand(),
        (None, _) => Finding::bad(
            "affinity",
            text,
            "name a processor that this process may use as [realtime] cpu of the scene; `taskset \
                -pc $$` lists them",
        )
        .by_hand(),
    };
    let memory = match memory {
        Ok(()) => Finding::good("memory", "every page can be locked"),
        Err(MemoryLockRefusal::Limit { bytes }) => Finding::bad(
            "memory",
            format!(
                "cannot be locked; the memlock limit is {} KiB: a page fault may stop the loop",
                bytes / 1024
            ),
            rights_advice(program),
        ),
        Err(MemoryLockRefusal::Errno(number)) => Finding::bad(
            "memory",
            format!("cannot be locked ({})", errno(number)),
            rights_advice(program),
        ),
    };
    vec![scheduling, affinity, memory]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::finding::{Standing, tree};
    use crate::schedule::{ThreadRequest, ThreadStanding};

    fn standing(findings: &[Finding], name: &str) -> (Standing, String, String) {
        let found = findings.iter().find(|finding| finding.name == name).expect(name);
        (found.standing, found.found.clone(), found.advice.clone())
    }

    #[test]
    fn a_tuned_machine_needs_nothing() {
        let (_folder, root) = tree(&[
            ("/proc/sys/kernel/osrelease", "6.12.1\n"),
            ("/proc/sys/kernel/version", "#1 SMP PREEMPT_RT\n"),
            ("/sys/devices/system/clocksource/clocksource0/current_clocksource", "tsc\n"),
            ("/sys/devices/system/cpu/cpu3/cpufreq/scaling_governor", "performance\n"),
            ("/sys/devices/system/cpu/isolated", "1,2-3\n"),
            ("/proc/sys/kernel/sched_rt_runtime_us", "950000\n"),
            (
                "/proc/self/limits",
                "Max locked memory         unlimited            unlimited            bytes\nMax \
                    realtime priority     99                   99\n",
            ),
            ("/proc/swaps", "Filename Type Size Used Priority\n"),
        ]);
        let findings = findings(&root, 3);
        assert!(
            findings
                .iter()
                .all(|finding| finding.standing == Standing::Good && finding.advice.is_empty()),
            "{findings:?}"
        );
        assert_eq!(standing(&findings, "limits").1, "rtprio 99, memlock unlimited");
    }

    #[test]
    fn what_is_not_as_it_should_be_comes_with_what_to_type() {
        let (_folder, root) = tree(&[
            ("/proc/sys/kernel/osrelease", "6.1.0\n"),
            ("/proc/sys/kernel/version", "#1 SMP PREEMPT_DYNAMIC\n"),
            ("/sys/devices/system/clocksource/clocksource0/current_clocksource", "hpet\n"),
            ("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor", "powersave\n"),
            ("/sys/devices/system/cpu/isolated", "\n"),
            ("/proc/sys/kernel/sched_rt_runtime_us", "500000\n"),
        ]);
        let findings = findings(&root, 0);
        for (name, found, advice) in [
            ("kernel", "not PREEMPT_RT", "linux-image-rt"),
            ("clock source", "hpet", "echo tsc"),
            ("governor", "powersave", "echo performance"),
            ("isolated processors", "none", "isolcpus=0"),
            ("real-time share", "50 %", "echo 950000"),
        ] {
            let (standing, text, typed) = standing(&findings, name);
            assert!(
                standing >= Standing::Advice && text.contains(found) && typed.contains(advice),
                "{name}: {text} / {typed}"
            );
        }
        let (_folder, nothing) = tree(&[]);
        let silent = super::findings(&nothing, 0);
        assert!(silent.iter().all(|finding| finding.standing != Standing::Bad), "{silent:?}");
    }

    #[test]
    fn lists_of_processors_are_read() {
        assert!(holds("1,4-7", 5) && holds("2", 2) && holds("0-1", 1));
        assert!(!holds("", 0) && !holds("1,4-7", 3) && !holds("x", 0));
    }

    #[test]
    fn refused_rights_say_how_to_get_them() {
        let request = ThreadRequest { cpu: 1, priority: 80 };
        let standing =
            ThreadStanding { schedule_errno: 1, affinity_errno: 22, ..ThreadStanding::default() };
        let memory = Err(MemoryLockRefusal::Limit { bytes: 65536 });
        let rows = rights(&Entered { request, standing, memory }, "/opt/hapticd");
        assert!(rows.iter().all(|row| row.standing == Standing::Bad));
        assert!(rows[0].advice.contains("setcap cap_sys_nice,cap_ipc_lock=ep /opt/hapticd"));
        assert!(rows[0].advice.contains("limits.d") && rows[2].found.contains("64 KiB"));
        let standing =
            ThreadStanding { fifo: true, priority: 80, cpu: Some(1), ..ThreadStanding::default() };
        let granted = Entered { request, standing, memory: Ok(()) };
        assert!(rights(&granted, "x").iter().all(|row| row.standing == Standing::Good));
        let sharing = CpuSharing::Shared;
        let shared = Entered { standing: ThreadStanding { sharing, ..standing }, ..granted };
        let rows = rights(&shared, "x");
        assert!(rows[1].standing == Standing::Advice && rows[1].found.contains("another program"));
    }
}
