//! Runs with arms that count, and what they tell.

use core::sync::atomic::Ordering::SeqCst;
use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::process::{Child, Command, Stdio};

use crossbeam::channel::{Sender, bounded};

use super::*;
use crate::record::TickRecord;
use crate::servo::testing::CountingArm;
use arms::simulated::{SimArm, SimParameters};
use arms::{Capabilities, Device, DeviceError};
use haptics::testing::empty_scene;
use haptics::{Faults, TickOutput};
use rt::schedule::RealtimeConfig;
use vps::spatial::{DeviceSample, Wrench};

const HUNG: Duration = Duration::from_secs(60);
/// Says to a program of these tests that it is the one that is suspended.
const IS_SUSPENDED: &str = "HAPTICD_TEST_SUSPENDED";

fn wait_until(mut is_it: impl FnMut() -> bool) {
    let began = Instant::now();
    while !is_it() {
        assert!(began.elapsed() < HUNG, "it did not come to that");
        std::thread::sleep(Duration::from_millis(1));
    }
}

fn job(device: Box<dyn Device>, clock: ClockKind, duration_ms: u64) -> RenderJob {
    RenderJob {
        scene: empty_scene(),
        device,
        realtime: RealtimeConfig { enforce: false, cpu: None, priority: 10 },
        time_budget_s: None,
        clock,
        duration: Some(Duration::from_millis(duration_ms)),
    }
}

fn ideal() -> Box<dyn Device> {
    Box::new(SimArm::new(SimParameters::ideal(1e-3)).expect("valid"))
}

#[test]
fn a_virtual_run_ends_by_itself_and_gives_a_summary() {
    let mut phases = Vec::new();
    let mut preflights = 0;
    let mut supervisor = Supervisor::new(|notice| match notice {
        Notice::Phase(phase) => phases.push(phase),
        Notice::Preflight(_) => preflights += 1,
        _ => {}
    });
    let prepared: Result<RenderJob, ()> =
        supervisor.bake(|| Ok(job(ideal(), ClockKind::Virtual, 20_000)));
    let outcome = supervisor
        .render(prepared.expect("prepared"), &Arc::new(Control::new()))
        .expect("an outcome");
    assert!(outcome.report.faults.is_empty() && outcome.report.ticks > 20_000);
    assert_eq!((outcome.report.missed_deadlines, outcome.report.dropped_records), (0, 0));
    assert_eq!(outcome.report.ending, Ending::Stopped);
    assert_eq!(preflights, 1);
    assert_eq!(phases.first(), Some(&Phase::Baking));
    assert_eq!(phases.last(), Some(&Phase::Stopped));
}

#[test]
fn two_virtual_runs_agree_in_every_bit_but_the_measured_times() {
    let run = || {
        let outcome = Supervisor::new(|_| {})
            .render(job(ideal(), ClockKind::Virtual, 3000), &Arc::new(Control::new()))
            .expect("an outcome");
        let flight: Vec<_> = outcome
            .report
            .flight
            .records()
            .map(|r| (r.tick, r.time_ns, r.wakeup_ns, r.input, r.output))
            .collect();
        (outcome.report.ticks, outcome.report.last, flight)
    };
    assert_eq!(run(), run());
}

#[test]
fn a_real_run_of_a_fifth_of_a_second_comes_to_its_end() {
    let outcome = Supervisor::new(|_| {})
        .render(job(ideal(), ClockKind::Real, 200), &Arc::new(Control::new()))
        .expect("an outcome");
    assert_eq!(outcome.report.ending, Ending::Stopped);
    assert!(outcome.report.faults.is_empty() && outcome.report.ticks > 200);
    assert_eq!(outcome.report.packet_errors, 0);
    assert!(outcome.preflight.rows.len() > 1);
}

#[test]
fn a_real_arm_without_an_operator_is_refused() {
    let arm = CountingArm {
        capabilities: Capabilities { simulated: false, ..Capabilities::default() },
        ..CountingArm::default()
    };
    let log = arm.log.clone();
    let refused = Supervisor::new(|_| {})
        .render(job(Box::new(arm), ClockKind::Virtual, 100), &Arc::new(Control::new()));
    assert!(matches!(refused, Err(RunError::NoOperator)));
    assert_eq!(log.writes.load(core::sync::atomic::Ordering::SeqCst), 0);
    assert_eq!(
        log.stops.load(core::sync::atomic::Ordering::SeqCst),
        1,
        "zero on a failed start too"
    );
}

#[test]
fn an_enable_that_waited_gives_no_force_after_a_later_disable() {
    for is_disabled in [false, true] {
        let arm = CountingArm {
            capabilities: Capabilities { simulated: false, ..Capabilities::default() },
            ..CountingArm::default()
        };
        let (enable, enables) = bounded(4);
        let control = Arc::new(Control::new());
        // Both before the run begins, as during a bake.
        enable.send(Enable(control.permit())).expect("room");
        if is_disabled {
            control.disable();
        }
        let operator = Operator {
            enables_at_start: false,
            waits_after_fault: true,
            holds_back: false,
            enables: Some(enables),
        };
        let mut phases = Vec::new();
        let mut supervisor = Supervisor::new(|notice| {
            if let Notice::Phase(phase) = notice {
                phases.push(phase);
            }
        });
        let job = job(Box::new(arm), ClockKind::Real, 1000);
        supervisor
            .render_live(job, LiveChannels { operator, ..LiveChannels::default() }, &control)
            .expect("an outcome");
        assert_eq!(phases.contains(&Phase::Enabling), !is_disabled, "{phases:?}");
    }
}

#[test]
fn after_a_fault_force_waits_for_the_operator_and_the_run_still_counts_as_faulted() {
    let arm = CountingArm {
        lost_from_read: Some(60),
        back_from_read: Some(120),
        ..CountingArm::default()
    };
    let log = arm.log.clone();
    let (enable, enables) = bounded(4);
    let control = Arc::new(Control::new());
    let stops = control.clone();
    let live = LiveChannels {
        operator: Operator {
            enables_at_start: true,
            waits_after_fault: true,
            holds_back: false,
            enables: Some(enables),
        },
        ..LiveChannels::default()
    };
    let mut job = job(Box::new(arm), ClockKind::Real, 0);
    job.duration = None;
    let wait_for = {
        let log = log.clone();
        move |n_reads| {
            while log.reads.load(core::sync::atomic::Ordering::SeqCst) < n_reads {
                std::thread::sleep(Duration::from_millis(1));
            }
        }
    };
    let operator = std::thread::spawn(move || {
        wait_for(200);
        enable.send(Enable(stops.permit())).expect("the supervisor listens");
        wait_for(400);
        // Force flows: this one changes nothing.
        enable.send(Enable(stops.permit())).expect("the supervisor listens");
        wait_for(600);
        stops.stop();
    });
    let mut phases = Vec::new();
    let mut supervisor = Supervisor::new(|notice| {
        if let Notice::Phase(phase) = notice {
            phases.push(phase);
        }
    });
    let outcome = supervisor.render_live(job, live, &control).expect("an outcome");
    operator.join().expect("no panic");
    assert_eq!(outcome.report.ending, Ending::Stopped);
    assert_eq!(outcome.report.faults, Faults::DEVICE_LOST);
    let of_interest: Vec<_> =
        phases.iter().filter(|phase| !matches!(phase, Phase::Stopping)).collect();
    use Phase::{Disabled, Enabled, Enabling, Fault, Stopped};
    // The fault was acknowledged, and the exit code remembers it.
    assert_eq!(
        of_interest,
        [&Enabling, &Fault, &Disabled, &Enabling, &Enabled, &Disabled, &Stopped],
        "{phases:?}"
    );
}

#[test]
fn an_interrupt_is_a_safe_stop() {
    let control = Arc::new(Control::new());
    let interrupts = control.clone();
    let arm = CountingArm {
        capabilities: Capabilities { simulated: true, ..Capabilities::default() },
        ..CountingArm::default()
    };
    let log = arm.log.clone();
    let mut job = job(Box::new(arm), ClockKind::Real, 0);
    job.duration = None;
    let running = log.clone();
    let interrupter = std::thread::spawn(move || {
        while running.reads.load(core::sync::atomic::Ordering::SeqCst) < 20 {
            std::thread::sleep(Duration::from_millis(1));
        }
        interrupts.interrupt();
    });
    let outcome = Supervisor::new(|_| {}).render(job, &control).expect("an outcome");
    interrupter.join().expect("no panic");
    assert_eq!((outcome.report.faults, outcome.report.ending), (Faults::NONE, Ending::Stopped));
    assert!(log.stops.load(core::sync::atomic::Ordering::SeqCst) >= 1);
}

#[test]
fn enforce_refuses_a_machine_that_fails_a_check_before_any_tick() {
    let arm = CountingArm {
        capabilities: Capabilities { simulated: true, ..Capabilities::default() },
        ..CountingArm::default()
    };
    let log = arm.log.clone();
    let mut job = job(Box::new(arm), ClockKind::Real, 100);
    // No machine has this processor, so the affinity row fails everywhere.
    job.realtime = RealtimeConfig { enforce: true, cpu: Some(1_000_000), priority: 10 };
    let error =
        Supervisor::new(|_| {}).render(job, &Arc::new(Control::new())).expect_err("refused");
    assert!(matches!(error, RunError::Refused(_)), "{error}");
    assert_eq!(log.reads.load(core::sync::atomic::Ordering::SeqCst), 0);
    assert!(
        log.stops.load(core::sync::atomic::Ordering::SeqCst) >= 1,
        "zero on a failed start too"
    );
}

#[test]
fn a_listener_that_panics_does_not_leave_the_loop_alone() {
    let sim = SimArm::new(SimParameters::ideal(1e-3)).expect("valid");
    let capabilities = sim.capabilities();
    let arm = CountingArm { capabilities, ..CountingArm::default() };
    let log = arm.log.clone();
    let job = RenderJob { duration: None, ..job(Box::new(arm), ClockKind::Real, 0) };
    let rendered = std::panic::catch_unwind(core::panic::AssertUnwindSafe(|| {
        Supervisor::new(|notice| {
            assert!(!matches!(notice, Notice::Phase(Phase::Enabling)), "a panic on purpose")
        })
        .render(job, &Arc::new(Control::new()))
    }));
    assert!(rendered.is_err());
    assert!(
        log.stops.load(core::sync::atomic::Ordering::SeqCst) >= 1,
        "zero before the panic goes on"
    );
}

#[test]
fn a_panic_of_the_driver_is_a_fault_with_its_exit_code() {
    #[derive(Debug)]
    struct Exploding(SimArm);
    impl Device for Exploding {
        fn capabilities(&self) -> Capabilities {
            self.0.capabilities()
        }
        fn read(&mut self) -> Result<DeviceSample, DeviceError> {
            let sample = self.0.read()?;
            assert!(sample.sequence < 50, "a driver that panics on purpose");
            Ok(sample)
        }
        fn write(&mut self, wrench: &Wrench) -> Result<Wrench, DeviceError> {
            self.0.write(wrench)
        }
        fn stop(&mut self) {
            self.0.stop();
        }
    }
    let arm = Exploding(SimArm::new(SimParameters::ideal(1e-3)).expect("valid"));
    let mut supervisor = Supervisor::new(|_| {});
    let outcome = supervisor
        .render(job(Box::new(arm), ClockKind::Virtual, 1000), &Arc::new(Control::new()))
        .expect("an outcome");
    assert_eq!(supervisor.phase(), Phase::Fault);
    assert_eq!((outcome.report.faults, outcome.report.ending), (Faults::PANIC, Ending::Panicked));
    assert_eq!(outcome.report.flight.records().count(), 49);
}

#[test]
fn a_check_that_fails_is_told_and_refuses_nothing_where_none_is_enforced() {
    let mut job = job(ideal(), ClockKind::Real, 20);
    // No machine has this processor.
    job.realtime.cpu = Some(1_000_000);
    let mut passed = Vec::new();
    let outcome = Supervisor::new(|notice| {
        if let Notice::Preflight(report) = notice {
            passed.push(report.passed());
        }
    })
    .render(job, &Arc::new(Control::new()))
    .expect("an outcome");
    assert_eq!((passed.as_slice(), outcome.preflight.passed()), (&[false][..], false));
    assert!(outcome.report.ticks > 20);
}

#[test]
fn what_an_operator_can_mend_is_told_when_it_begins() {
    use OffCause::{Deadman, Software, Workspace};
    let mut reported = Vec::new();
    let mut supervisor = Supervisor::new(|notice| match notice {
        Notice::Waiting(cause) => reported.push(Some(cause)),
        Notice::Status(_) => reported.push(None),
        _ => {}
    });
    for off_cause in [OffCause::None, Deadman, Deadman, Software, Workspace, Workspace, Deadman] {
        let output = TickOutput { off_cause, ..TickOutput::default() };
        supervisor.tell(&Watch::Snapshot(TickRecord { output, ..TickRecord::default() }));
    }
    let [deadman, workspace] = [Deadman, Workspace].map(Some);
    // An operator cannot mend what software ordered.
    assert_eq!(
        reported,
        [None, deadman, None, None, None, workspace, None, None, deadman, None],
        "each before the status that shows it"
    );
}

#[test]
fn phases_have_the_names_that_people_read() {
    use Phase::{Baking, Braking, Disabled, Enabled, Enabling, Fault, Init, Stopped, Stopping};
    let phases = [Init, Baking, Disabled, Enabling, Enabled, Stopping, Braking, Fault, Stopped];
    let names = [
        "init", "baking", "disabled", "enabling", "enabled", "stopping", "braking", "fault",
        "stopped",
    ];
    assert_eq!(phases.map(Phase::name), names);
}

/// An arm that stops the run in its first read, and does not come back when a quit is ordered.
struct Stuck {
    control: Arc<Control>,
    /// When the run was stopped, when no quit had come yet, and when one had.
    seen: Sender<[Instant; 3]>,
    /// Disconnects at the end of the test.
    released: Receiver<()>,
}

impl Device for Stuck {
    fn capabilities(&self) -> Capabilities {
        Capabilities { simulated: true, ..Capabilities::default() }
    }

    fn read(&mut self) -> Result<DeviceSample, DeviceError> {
        let stopped = Instant::now();
        self.control.stop();
        let mut before_quit = stopped;
        while stopped.elapsed() < HUNG {
            let now = Instant::now();
            if self.control.order() == Order::Quit {
                let _ = self.seen.send([stopped, before_quit, Instant::now()]);
                let _ = self.released.recv_timeout(HUNG);
                break;
            }
            before_quit = now;
            std::thread::sleep(Duration::from_millis(1));
        }
        Err(DeviceError::Lost)
    }

    fn write(&mut self, wrench: &Wrench) -> Result<Wrench, DeviceError> {
        Ok(*wrench)
    }

    fn stop(&mut self) {}
}

#[test]
fn an_arm_that_does_not_come_back_has_its_time_to_stop_and_to_quit_and_is_given_up() {
    let control = Arc::new(Control::new());
    let (sender, seen) = bounded(1);
    let (_release, released) = bounded(1);
    let arm = Stuck { control: control.clone(), seen: sender, released };
    let job = RenderJob { duration: None, ..job(Box::new(arm), ClockKind::Real, 0) };
    let ramp_s = job.scene.parameters.limits.ramp_down_s();
    let error = Supervisor::new(|_| {}).render(job, &control).expect_err("given up");
    let given_up = Instant::now();
    assert!(matches!(error, RunError::Servo(why) if why.starts_with("did not end")), "{error}");
    let [stopped, before_quit, quit] = seen.recv_timeout(HUNG).expect("a quit");
    // A busy machine makes it later, never earlier.
    assert!(quit - stopped >= STOP_PATIENCE + Duration::from_secs_f64(ramp_s));
    assert!(given_up - before_quit >= QUIT_PATIENCE);
}

/// The run of a simulated arm that has an operator. It is suspended meanwhile.
fn suspended_run() {
    let control = Arc::new(Control::new());
    signals::end_by_signals(&control).expect("the first call");
    signals::suspend_without_force();
    let arm = CountingArm {
        capabilities: Capabilities { simulated: true, ..Capabilities::default() },
        ..CountingArm::default()
    };
    let log = arm.log.clone();
    let looked_at = control.clone();
    let look = std::thread::spawn(move || {
        let wait_for = |n_reads: u64| {
            let first = log.reads.load(SeqCst);
            wait_until(|| log.reads.load(SeqCst) >= first + n_reads);
        };
        wait_for(20);
        let before = looked_at.order();
        std::io::stderr().write_all(b"running\n").expect("a pipe");
        // The line comes when it goes on.
        std::io::stdin().read_line(&mut String::new()).expect("a pipe");
        wait_for(100);
        let after = looked_at.order();
        looked_at.stop();
        [before, after]
    });
    let (_enable, enables) = bounded(1);
    let live = LiveChannels {
        operator: Operator {
            enables_at_start: false,
            waits_after_fault: true,
            holds_back: false,
            enables: Some(enables),
        },
        ..LiveChannels::default()
    };
    let job = job(Box::new(arm), ClockKind::Real, 60_000);
    Supervisor::new(|_| {}).render_live(job, live, &control).expect("an outcome");
    assert_eq!(look.join().expect("no panic"), [Order::Enable, Order::Disable]);
}

/// A program that does not outlive the test.
struct Program(Child);

impl Drop for Program {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

#[test]
fn ctrl_z_stops_the_process_once_its_zero_has_left_and_force_waits_for_the_operator() {
    if std::env::var_os(IS_SUSPENDED).is_some() {
        return suspended_run();
    }
    let this = "supervisor::tests::\
                ctrl_z_stops_the_process_once_its_zero_has_left_and_force_waits_for_the_operator";
    let child = Command::new(std::env::current_exe().expect("this program"))
        .args(["--exact", this])
        .env(IS_SUSPENDED, "1")
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .expect("starts");
    let pid = child.id().to_string();
    let mut program = Program(child);
    let lines = BufReader::new(program.0.stderr.take().expect("piped")).lines();
    assert!(lines.map_while(Result::ok).any(|line| line == "running"), "it does not run");
    let signal = |name: &str| {
        let status = Command::new("kill").args([name, pid.as_str()]).status().expect("kill");
        assert!(status.success(), "{name}");
    };
    let begin = Instant::now();
    signal("-TSTP");
    wait_until(|| {
        let stat = std::fs::read_to_string(format!("/proc/{pid}/stat")).expect("a process");
        stat.rsplit_once(") ").is_some_and(|(_, rest)| rest.starts_with('T'))
    });
    let took = begin.elapsed();
    signal("-CONT");
    program.0.stdin.take().expect("piped").write_all(b"\n").expect("it reads");
    let mut said = String::new();
    program.0.stdout.take().expect("piped").read_to_string(&mut said).expect("text");
    assert!(program.0.wait().expect("a child").success(), "{said}");
    // A busy machine makes it later, never earlier.
    assert!(took >= BEFORE_SUSPEND, "{took:?}");
}
