//! What one thread asks of the scheduler and of memory: policy, priority, processor, locked pages,
//! a touched stack.
#![expect(unsafe_code, reason = "affinity, memory lock and resource limits are libc calls")]

use core::mem::{MaybeUninit, size_of};
use std::io;
use std::os::linux::net::SocketAddrExt as _;
use std::os::unix::net::{SocketAddr, UnixDatagram};
use std::sync::{Mutex, PoisonError};

use thread_priority::{
    RealtimeThreadSchedulePolicy, ThreadPriority, ThreadPriorityValue, ThreadSchedulePolicy,
    set_thread_priority_and_policy, thread_native_id, thread_schedule_policy_param,
};

/// Bytes of stack that [`prefault_stack`] touches: far more than a tick needs, less than the
/// default 2 MiB of a thread.
const PREFAULT_STACK_BYTES: usize = 256 * 1024;

/// Niceness of a thread that is not waited for: a tenth of the weight of niceness 0.
const BACKGROUND_NICE: i32 = 10;

/// `CAP_IPC_LOCK` in the capability masks of `/proc/self/status`.
const CAP_IPC_LOCK_BIT: u32 = 14;

/// What the loop asks of the operating system.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RealtimeConfig {
    /// Refuse to run when a preflight check fails.
    pub enforce: bool,
    /// Processor to pin to; `None`: the last one that this process may use.
    pub cpu: Option<usize>,
    /// SCHED_FIFO priority, 1 to 99.
    pub priority: u8,
}

/// What a thread asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ThreadRequest {
    /// Processor to pin to.
    pub cpu: usize,
    /// SCHED_FIFO priority, 1..=99.
    pub priority: u8,
}

impl ThreadRequest {
    /// For a thread that moves the bytes of a loop: below it, so that it never keeps the loop from
    /// waking, and on its processor, which is free while the loop sleeps.
    #[must_use]
    pub fn below(self) -> Self {
        Self { priority: self.priority.saturating_sub(1).max(1), ..self }
    }
}

/// What a thread got.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ThreadStanding {
    /// True: SCHED_FIFO. False: the ordinary time-sharing policy.
    pub fifo: bool,
    /// Its real-time priority; 0 without SCHED_FIFO.
    pub priority: u8,
    /// Processor that it is pinned to.
    pub cpu: Option<usize>,
    /// errno of the refused scheduling call; 0: not refused.
    pub schedule_errno: i32,
    /// errno of the refused affinity call; 0: not refused.
    pub affinity_errno: i32,
    /// Who else uses the processor.
    pub sharing: CpuSharing,
}

/// Whether a loop of another process is pinned to the processor that [`loop_cpu`] gave.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum CpuSharing {
    /// None that is known.
    #[default]
    Own,
    /// None; but one is pinned to this one, which would have been the choice.
    InsteadOf(usize),
    /// One is.
    Shared,
}

/// Pins the calling thread, puts it under SCHED_FIFO and touches its stack; says what was obtained.
/// Never fails: what was refused is in the answer. RT: start-up only.
pub fn enter_realtime(request: ThreadRequest) -> ThreadStanding {
    let affinity = pin_to(request.cpu);
    let schedule = set_fifo(request.priority);
    prefault_stack();
    let (fifo, priority) = current_policy();
    ThreadStanding {
        fifo,
        priority,
        cpu: affinity.is_ok().then_some(request.cpu),
        schedule_errno: schedule.err().unwrap_or(0),
        affinity_errno: affinity.err().unwrap_or(0),
        sharing: sharing(request.cpu),
    }
}

/// Puts the calling thread under SCHED_FIFO, on any processor; true where that is allowed. RT:
/// start-up only.
pub fn enter_fifo(priority: u8) -> bool {
    set_fifo(priority).is_ok()
}

/// Gives way to other threads: the calling one gets a tenth of what they get of a processor that
/// both want.
pub fn enter_background() {
    // SAFETY: a call with numbers only; on Linux process 0 is the calling thread.
    unsafe { libc::setpriority(libc::PRIO_PROCESS, 0, BACKGROUND_NICE) };
}

fn set_fifo(priority: u8) -> Result<(), i32> {
    let priority = ThreadPriorityValue::try_from(priority).map_err(|_| libc::EINVAL)?;
    set_thread_priority_and_policy(
        thread_native_id(),
        ThreadPriority::Crossplatform(priority),
        ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo),
    )
    .map_err(|error| match error {
        thread_priority::Error::OS(errno) => errno,
        _ => libc::EINVAL,
    })
}

fn current_policy() -> (bool, u8) {
    match thread_schedule_policy_param(thread_native_id()) {
        Ok((ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo), parameters)) => {
            (true, u8::try_from(parameters.sched_priority).unwrap_or(0))
        }
        _ => (false, 0),
    }
}

fn last_errno() -> i32 {
    std::io::Error::last_os_error().raw_os_error().unwrap_or(0)
}

/// Processors that this process may use, ascending. RT: start-up only.
pub fn allowed_cpus() -> Vec<usize> {
    let mut set = MaybeUninit::<libc::cpu_set_t>::zeroed();
    // SAFETY: `set` is writable memory of the size passed; pid 0 is the calling thread. The kernel
    // fills the set or fails.
    let result =
        unsafe { libc::sched_getaffinity(0, size_of::<libc::cpu_set_t>(), set.as_mut_ptr()) };
    if result != 0 {
        return Vec::new();
    }
    // SAFETY: `cpu_set_t` is plain bits; all-zero is valid and the call above succeeded.
    let set = unsafe { set.assume_init() };
    // SAFETY: every index is below CPU_SETSIZE, the number of bits in `set`.
    (0..libc::CPU_SETSIZE as usize).filter(|&cpu| unsafe { libc::CPU_ISSET(cpu, &set) }).collect()
}

/// Processors that loops of this process are pinned to, each with the name that says so to other
/// processes for as long as this one lives.
static CLAIMS: Mutex<Vec<Claim>> = Mutex::new(Vec::new());

struct Claim {
    cpu: usize,
    sharing: CpuSharing,
    /// No processor was named for it.
    is_default: bool,
    _name: Option<UnixDatagram>,
}

/// The processor for the loop of this process: `named`, or the last one allowed that no loop of
/// another process is pinned to, as low numbers usually take the interrupts. Where each is taken,
/// the last one. RT: start-up only.
pub fn loop_cpu(named: Option<usize>) -> usize {
    let mut claims = CLAIMS.lock().unwrap_or_else(PoisonError::into_inner);
    let known = claims.iter().find(|claim| named.map_or(claim.is_default, |cpu| cpu == claim.cpu));
    if let Some(claim) = known {
        return claim.cpu;
    }
    let candidates = named.map_or_else(allowed_cpus, |cpu| vec![cpu]);
    let first_choice = candidates.last().copied().unwrap_or(0);
    let own = |cpu| claims.iter().any(|claim| claim.cpu == cpu);
    let free = candidates.into_iter().rev().find_map(|cpu| match cpu_name(cpu) {
        Ok(name) => Some((cpu, Some(name))),
        Err(error) if error.kind() == io::ErrorKind::AddrInUse && !own(cpu) => None,
        Err(_) => Some((cpu, None)),
    });
    let (cpu, sharing, name) = match free {
        Some((cpu, name)) if cpu == first_choice => (cpu, CpuSharing::Own, name),
        Some((cpu, name)) => (cpu, CpuSharing::InsteadOf(first_choice), name),
        None => (first_choice, CpuSharing::Shared, None),
    };
    claims.push(Claim { cpu, sharing, is_default: named.is_none(), _name: name });
    cpu
}

/// The name of a processor that a loop is pinned to, in the abstract namespace of sockets: it goes
/// with the process, however that ends.
fn cpu_name(cpu: usize) -> io::Result<UnixDatagram> {
    UnixDatagram::bind_addr(&SocketAddr::from_abstract_name(format!("hapticd-cpu-{cpu}"))?)
}

fn sharing(cpu: usize) -> CpuSharing {
    let claims = CLAIMS.lock().unwrap_or_else(PoisonError::into_inner);
    claims.iter().find(|claim| claim.cpu == cpu).map_or(CpuSharing::Own, |claim| claim.sharing)
}

fn pin_to(cpu: usize) -> Result<(), i32> {
    if cpu >= libc::CPU_SETSIZE as usize {
        return Err(libc::EINVAL);
    }
    let mut set = MaybeUninit::<libc::cpu_set_t>::zeroed();
    // SAFETY: an all-zero `cpu_set_t` is the empty set.
    let set = unsafe { set.assume_init_mut() };
    // SAFETY: `cpu` is below CPU_SETSIZE, checked above.
    unsafe { libc::CPU_SET(cpu, set) };
    // SAFETY: `set` is a valid set of the size passed; pid 0 is the calling thread.
    if unsafe { libc::sched_setaffinity(0, size_of::<libc::cpu_set_t>(), set) } == 0 {
        Ok(())
    } else {
        Err(last_errno())
    }
}

/// Why the memory of the process is not locked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MemoryLockRefusal {
    /// The memlock limit is finite and the process lacks CAP_IPC_LOCK. Locking all future pages
    /// under such a limit would make a later allocation fail, so it is not even tried.
    Limit {
        /// The limit, bytes.
        bytes: u64,
    },
    /// The kernel refused with this errno.
    Errno(i32),
}

/// Locks every present and future page of the process. RT: start-up only.
///
/// # Errors
/// See [`MemoryLockRefusal`]; nothing is locked then.
pub fn lock_memory() -> Result<(), MemoryLockRefusal> {
    if let Some(bytes) = finite_memlock_limit()
        && !has_cap_ipc_lock()
    {
        return Err(MemoryLockRefusal::Limit { bytes });
    }
    // SAFETY: takes flags only; the mappings of the process stay as they are.
    if unsafe { libc::mlockall(libc::MCL_CURRENT | libc::MCL_FUTURE) } == 0 {
        Ok(())
    } else {
        Err(MemoryLockRefusal::Errno(last_errno()))
    }
}

/// Undoes [`lock_memory`], so that a library user's process goes back to what it was. RT: start-up
/// only.
pub fn unlock_memory() {
    // SAFETY: takes no arguments; the mappings of the process stay as they are.
    unsafe {
        libc::munlockall();
    }
}

fn finite_memlock_limit() -> Option<u64> {
    let mut limit = libc::rlimit { rlim_cur: 0, rlim_max: 0 };
    // SAFETY: `limit` is a valid, exclusive rlimit.
    let result = unsafe { libc::getrlimit(libc::RLIMIT_MEMLOCK, &raw mut limit) };
    (result != 0 || limit.rlim_cur != libc::RLIM_INFINITY).then_some(limit.rlim_cur)
}

fn has_cap_ipc_lock() -> bool {
    std::fs::read_to_string("/proc/self/status")
        .is_ok_and(|status| effective_capabilities(&status) >> CAP_IPC_LOCK_BIT & 1 == 1)
}

fn effective_capabilities(status: &str) -> u64 {
    status
        .lines()
        .find_map(|line| line.strip_prefix("CapEff:"))
        .and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok())
        .unwrap_or(0)
}

/// Touches the stack below the caller, so that the loop does not take page faults on its way down.
#[inline(never)]
fn prefault_stack() {
    let mut block = [0u8; PREFAULT_STACK_BYTES];
    core::hint::black_box(&mut block);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn at_least_one_processor_is_allowed() {
        let cpus = allowed_cpus();
        assert!(!cpus.is_empty());
        assert!(cpus.contains(&loop_cpu(None)));
    }

    #[test]
    fn a_thread_says_what_it_got() {
        let cpu = loop_cpu(None);
        let standing =
            std::thread::spawn(move || enter_realtime(ThreadRequest { cpu, priority: 1 }))
                .join()
                .expect("no panic");
        assert_eq!(standing.cpu, Some(cpu));
        // Whether SCHED_FIFO was granted depends on the user that runs the test; that the answer is
        // consistent does not.
        assert_eq!(standing.fifo, standing.schedule_errno == 0);
        assert_eq!(standing.priority, u8::from(standing.fifo));
    }

    #[test]
    fn a_processor_that_another_loop_holds_is_shared_and_said_so() {
        // No machine has so many, and nothing else claims them.
        let held = cpu_name(70_001).expect("free");
        let free = loop_cpu(Some(70_000));
        let taken = loop_cpu(Some(70_001));
        assert_eq!((sharing(free), sharing(taken)), (CpuSharing::Own, CpuSharing::Shared));
        drop(held);
        assert!(cpu_name(70_000).is_err(), "it is held for as long as this process lives");
        assert!(cpu_name(70_001).is_ok(), "and this one goes with its process");
    }

    #[test]
    fn a_thread_in_the_background_is_nice_and_the_others_are_not() {
        // SAFETY: a call with numbers only.
        let nice = || unsafe { libc::getpriority(libc::PRIO_PROCESS, 0) };
        let before = nice();
        let there = std::thread::spawn(move || {
            enter_background();
            nice()
        });
        assert_eq!(there.join().expect("no panic"), before.max(BACKGROUND_NICE));
        assert_eq!(nice(), before);
    }

    #[test]
    fn a_processor_that_does_not_exist_is_refused_not_ignored() {
        let standing =
            std::thread::spawn(|| enter_realtime(ThreadRequest { cpu: 100_000, priority: 1 }))
                .join()
                .expect("no panic");
        assert_eq!(standing.cpu, None);
        assert_eq!(standing.affinity_errno, libc::EINVAL);
    }

    #[test]
    fn capabilities_are_read_from_the_status_page() {
        assert_eq!(
            effective_capabilities("Name:\tx\nCapEff:\t0000000000004000\n"),
            1 << CAP_IPC_LOCK_BIT
        );
        assert_eq!(effective_capabilities("Name:\tx\n"), 0);
    }
}
