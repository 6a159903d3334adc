//! Every source of off, while every other consumer of the loop stands still.

use core::sync::atomic::{AtomicBool, AtomicU64, Ordering::SeqCst};
use core::time::Duration;
use std::sync::{Arc, Mutex};
use std::time::Instant;

use arms::simulated::{HandParameters, SimArm, SimParameters};
use arms::{Capabilities, Device, DeviceError};
use engine::drive_watchdog::DriveWatchdog;
use engine::servo::{Ending, SceneControls};
use engine::supervisor::{LiveChannels, Notice, Phase, RenderJob, RunOutcome, Supervisor};
use glam::DVec3;
use haptics::{Drive, Faults, LimitParameters, Parameters, RenderScene, SceneBuilder, ToolOptions};
use rt::clock::ClockKind;
use rt::control::Control;
use rt::schedule::RealtimeConfig;
use vps::spatial::{DeviceSample, Wrench};
use vps::{Options, Pose, Shape, part::Part};

/// Four ticks in a millisecond: the ring of records is full after a second.
const PERIOD_S: f64 = 2.5e-4;
/// More records than the ring has places.
const RING_AND_MORE: u64 = 4200;
const HUNG: Duration = Duration::from_secs(60);
/// Forced writes after an order that takes force away at once: the one that was under way, and one
/// whose tick had read the word before.
const WRITES_AT_ONCE: u64 = 2;
/// Of a ramp down: a tenth of a second, and the fall of the output stage.
const WRITES_OF_RAMP: u64 = (0.115 / PERIOD_S) as u64;

/// What an arm was given; outlives it.
#[derive(Debug, Default)]
struct Log {
    writes: AtomicU64,
    /// Writes that made the motors push.
    forced: AtomicU64,
    is_lost: AtomicBool,
    is_wild: AtomicBool,
}

struct LoggedArm {
    arm: SimArm,
    log: Arc<Log>,
}

impl Device for LoggedArm {
    fn capabilities(&self) -> Capabilities {
        self.arm.capabilities()
    }

    fn read(&mut self) -> Result<DeviceSample, DeviceError> {
        if self.log.is_lost.load(SeqCst) {
            return Err(DeviceError::Lost);
        }
        let mut sample = self.arm.read()?;
        if self.log.is_wild.load(SeqCst) {
            sample.pose.translation.x = f64::NAN;
        }
        Ok(sample)
    }

    fn write(&mut self, wrench_device: &Wrench) -> Result<Wrench, DeviceError> {
        self.log.writes.fetch_add(1, SeqCst);
        self.log.forced.fetch_add(u64::from(*wrench_device != Wrench::ZERO), SeqCst);
        self.arm.write(wrench_device)
    }

    fn set_enabled(&mut self, enabled: bool) {
        self.arm.set_enabled(enabled);
    }

    fn stop(&mut self) {
        self.arm.stop();
    }
}

/// A ball at the grip, two millimetres deep in a block.
fn scene() -> RenderScene {
    let limits =
        LimitParameters { force_n: 10.0, torque_nm: 1.0, stall_s: 0.05, ..LimitParameters::NONE };
    let parameters = Parameters { limits, ..Parameters::unlimited(PERIOD_S) };
    let mut builder = SceneBuilder::new(parameters);
    let block = Part::of_shape("block", &Shape::Box { size_m: DVec3::splat(40e-3) }, 1e-3);
    let pose = Pose::from_translation(DVec3::Z * -28e-3);
    builder.add_part(&block, &Options::new(1e-3), pose).expect("a block");
    let ball = Part::of_shape("ball", &Shape::Sphere { radius_m: 10e-3 }, 1e-3);
    let (scene, _) =
        builder.finish(&ball, &Options::new(1e-3), &ToolOptions::new(0.1)).expect("a scene");
    scene
}

/// What stands still while force is to go off.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Blocked {
    Nothing,
    /// A subscriber to records does not return.
    Records,
    /// A handler of notices does not return: the supervisor stands still.
    Notices,
    /// The ring of commands is filled again and again.
    Commands,
    /// All of them, and the ring of records is full.
    All,
}

/// What takes force away.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Source {
    /// As signals, clients and the console do it.
    Disable,
    Stop,
    Quit,
    SilentDriver,
    LostDriver,
    ExpelledClient,
    /// The scene needs a client that sends heartbeats, and the last one signs off.
    NoClient,
    LostArm,
    WildSample,
}

const SOURCES: [Source; 9] = [
    Source::Disable,
    Source::Stop,
    Source::Quit,
    Source::SilentDriver,
    Source::LostDriver,
    Source::ExpelledClient,
    Source::NoClient,
    Source::LostArm,
    Source::WildSample,
];

const BLOCKED: [Blocked; 5] =
    [Blocked::Nothing, Blocked::Records, Blocked::Notices, Blocked::Commands, Blocked::All];

fn wait_until(what: &str, is_so: impl Fn() -> bool) {
    let begin = Instant::now();
    while !is_so() {
        assert!(begin.elapsed() < HUNG, "{what}");
        std::thread::sleep(Duration::from_micros(200));
    }
}

/// Forced writes after the off, and how the run ended.
fn forced_after(source: Source, blocked: Blocked, scene: &Arc<RenderScene>) -> (u64, RunOutcome) {
    let log = Arc::new(Log::default());
    let hand = Some(HandParameters::default());
    let parameters = SimParameters { hand, ..SimParameters::ideal(PERIOD_S) };
    let arm = SimArm::new(parameters).expect("a sound arm");
    let control = Arc::new(Control::new());
    let is_needed = source == Source::NoClient;
    let watchdog = DriveWatchdog::new(control.clone(), is_needed.then_some(HUNG));
    if is_needed {
        watchdog.beat(2, Some(HUNG), Instant::now());
    }
    let is_alive = || {
        watchdog.note_message(2, Instant::now());
        true
    };
    let (mut controls, commands) = SceneControls::new(&scene.parameters, Vec::new());
    let live = LiveChannels { commands, ..LiveChannels::default() };
    // Whoever holds the gate keeps the consumers from going on.
    let gate = Arc::new(Mutex::new(()));
    let blocks = |one: Blocked| blocked == one || blocked == Blocked::All;
    if blocks(Blocked::Records) {
        let gate = gate.clone();
        let mut is_enabled = false;
        live.subscribers.add(Box::new(move |record| {
            // The supervisor is to hear of the force.
            if core::mem::replace(&mut is_enabled, record.output.drive == Drive::Enabled) {
                drop(gate.lock());
            }
            true
        }));
    }
    let job = RenderJob {
        scene: scene.clone(),
        device: Box::new(LoggedArm { arm, log: log.clone() }),
        realtime: RealtimeConfig { enforce: false, cpu: None, priority: 10 },
        time_budget_s: None,
        clock: ClockKind::Real,
        duration: None,
    };
    let has_ended = AtomicBool::new(false);
    let is_stuck = AtomicBool::new(false);
    let n_refused = AtomicU64::new(0);
    std::thread::scope(|scope| {
        let held = gate.lock().expect("no panic");
        let run = scope.spawn(|| {
            let mut supervisor = Supervisor::new(|notice| {
                if blocks(Blocked::Notices) && matches!(notice, Notice::Phase(Phase::Enabled)) {
                    is_stuck.store(true, SeqCst);
                    drop(gate.lock());
                }
            });
            supervisor.render_live(job, live, &control).expect("an outcome")
        });
        scope.spawn(|| watchdog.watch());
        if blocks(Blocked::Commands) {
            scope.spawn(|| {
                while !has_ended.load(SeqCst) {
                    for _ in 0..200 {
                        let asked = controls.set("contact_stiffness_n_per_m", 1000.0);
                        n_refused.fetch_add(u64::from(asked.is_err()), SeqCst);
                    }
                    std::thread::sleep(Duration::from_micros(50));
                }
            });
        }
        wait_until("no force", || is_alive() && log.forced.load(SeqCst) > 100);
        wait_until("nothing is blocked", || {
            is_alive()
                && (!blocks(Blocked::Notices) || is_stuck.load(SeqCst))
                && (!blocks(Blocked::Commands) || n_refused.load(SeqCst) > 0)
        });
        if blocked == Blocked::All {
            let before = log.writes.load(SeqCst);
            wait_until("no ticks", || {
                is_alive() && log.writes.load(SeqCst) > before + RING_AND_MORE
            });
        }
        let permit = control.permit();
        match source {
            Source::Disable => control.disable(),
            Source::Stop => control.stop(),
            Source::Quit => control.quit(),
            Source::SilentDriver => {
                watchdog.beat(1, Some(Duration::from_millis(20)), Instant::now());
                wait_until("the watchdog sleeps", || control.permit() != permit);
            }
            Source::LostDriver => {
                watchdog.beat(1, Some(HUNG), Instant::now());
                watchdog.lose(1);
            }
            Source::ExpelledClient => watchdog.expel("a test"),
            Source::NoClient => {
                watchdog.beat(2, Some(Duration::ZERO), Instant::now());
                wait_until("the watchdog sleeps", || control.permit() != permit);
            }
            Source::LostArm => log.is_lost.store(true, SeqCst),
            Source::WildSample => log.is_wild.store(true, SeqCst),
        }
        let forced = log.forced.load(SeqCst);
        let writes = log.writes.load(SeqCst);
        // The loop ends by itself under the last two, and after a quit.
        wait_until("the loop stands still", || {
            log.writes.load(SeqCst) > writes + 2 * WRITES_OF_RAMP || has_gone(&log, source)
        });
        let after = log.forced.load(SeqCst) - forced;
        drop(held);
        control.quit();
        let outcome = run.join().expect("no panic");
        has_ended.store(true, SeqCst);
        watchdog.end();
        (after, outcome)
    })
}

/// Under these the loop writes no more after a moment.
fn has_gone(log: &Log, source: Source) -> bool {
    let ends = matches!(source, Source::Stop | Source::Quit | Source::LostArm | Source::WildSample);
    let writes = log.writes.load(SeqCst);
    std::thread::sleep(Duration::from_millis(100));
    ends && log.writes.load(SeqCst) == writes
}

#[test]
fn every_source_of_off_acts_while_every_other_consumer_is_blocked() {
    let scene = Arc::new(scene());
    // Nine loops of four ticks in a millisecond are more than two processors keep up with.
    for sources in SOURCES.chunks(2) {
        std::thread::scope(|scope| {
            for source in sources {
                scope.spawn(|| acts_whatever_is_blocked(*source, &scene));
            }
        });
    }
}

fn acts_whatever_is_blocked(source: Source, scene: &Arc<RenderScene>) {
    for blocked in BLOCKED {
        // A machine that stood still is a fault of its own: that run says nothing.
        let (after, outcome) = (0..20)
            .map(|_| forced_after(source, blocked, scene))
            .find(|(_, outcome)| !outcome.report.faults.contains(Faults::OVERRUN))
            .expect("a machine that keeps time for a second");
        let most = if source == Source::Stop { WRITES_OF_RAMP } else { WRITES_AT_ONCE };
        assert!(after <= most, "{source:?}, {blocked:?}: {after} forced writes");
        let is_fault = matches!(source, Source::LostArm | Source::WildSample);
        assert_eq!(
            outcome.report.ending == Ending::Faulted,
            is_fault,
            "{source:?}, {blocked:?}: {:?}, {:?}",
            outcome.report.ending,
            outcome.report.faults
        );
    }
}
