//! Runs with arms that count, and what they tell.

use crossbeam::channel::bounded;

use super::*;
use crate::servo::testing::CountingArm;
use arms::simulated::{SimArm, SimParameters};
use arms::{Capabilities, Device};
use haptics::Faults;
use haptics::testing::empty_scene;
use rt::schedule::RealtimeConfig;

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
        fn read(&mut self) -> Result<vps::spatial::DeviceSample, arms::DeviceError> {
            let sample = self.0.read()?;
            assert!(sample.sequence < 50, "a driver that panics on purpose");
            Ok(sample)
        }
        fn write(
            &mut self,
            wrench: &vps::spatial::Wrench,
        ) -> Result<vps::spatial::Wrench, arms::DeviceError> {
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
