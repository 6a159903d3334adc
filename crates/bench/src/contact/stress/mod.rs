//! The shipped nut on its bolt with a million points, in a hand that slams, spins and jams it, on
//! both clocks; every tick is judged.
//!
//! The hand stays below the speed that the arm's own limit calls a fault. Everything else may
//! happen: forces reach their limits, contact queries their budget, the passivity controller its
//! damping. What may not: a fault, a value that is not finite, a command beyond the limits, a lost
//! record.

mod hand;
mod judge;

use std::sync::Arc;
use std::thread;
use std::time::Duration;

use rtrb::RingBuffer;

use self::judge::Judge;
use super::super::export::TemporaryFolder;
use super::super::{BenchError, Row};
use super::{Options, scenes};
use engine::servo::{Control, LoopReport, RunPlan, ServoLoop, run_to_end};
use hapticd::config::SceneConfig;
use hapticd::daemon::prepare_with;
use hapticd::scene::BakeOptions;
use hapticd::scene::cache::{Cache, CachePolicy};
use rt::clock::{Clock, RealClock, VirtualClock};
use rt::schedule::{self, ThreadRequest};

const SCENE: &str = "nut-on-bolt";
/// Spacing of the nut's points that makes a million of them, and of the quick run, mm.
const VOXEL_MM: [f64; 2] = [0.058, 0.25];
/// Length of the runs on the virtual and on the real clock, s; and of the quick ones.
const LONG_S: [f64; 2] = [600.0, 120.0];
const QUICK_S: [f64; 2] = [20.0, 2.0];
const SEED: u64 = 1999;
/// Records under way between the loop and the judge.
const RING_RECORDS: usize = 1 << 14;
/// What a contact query may take, µs: a million points do not fit into a millisecond wherever they
/// are.
const TIME_BUDGET_US: i64 = 300;
/// A hand that arms can hardly hold: N/m, N·s/m, g.
const STIFF_HAND: [(&str, f64); 3] = [
    ("device.sim.hand_stiffness_n_per_m", 2000.0),
    ("device.sim.hand_damping_n_s_per_m", 20.0),
    ("device.sim.hand_mass_g", 200.0),
];

/// Plays the stress. `tell` is called with each step. Cost: ten minutes of ticks as fast as they
/// go, then two minutes; quick, some seconds.
pub(super) fn rows(options: &Options, tell: &mut dyn FnMut(&str)) -> Result<Vec<Row>, BenchError> {
    let Some(scene) =
        scenes::shipped(&options.scenes).into_iter().find(|path| scenes::name(path) == SCENE)
    else {
        let why = format!("skipped: no {SCENE} in {} (--scenes)", options.scenes.display());
        return Ok(vec![Row::new("stress", why, None, "")]);
    };
    let folder = TemporaryFolder::create()
        .map_err(|source| BenchError::Write { path: std::env::temp_dir(), source })?;
    let mut cache = Cache::at(folder.path().join("cache"), CachePolicy::Copy);
    let [virtual_s, real_s] = if options.quick { QUICK_S } else { LONG_S };
    let mut rows = Vec::new();
    for (is_real, long_s) in [(false, virtual_s), (true, real_s)] {
        let hand = folder.path().join("hand.csv");
        std::fs::write(&hand, hand::path(long_s, SEED))
            .map_err(|source| BenchError::Write { path: hand.clone(), source })?;
        let mut edits: Vec<scenes::Edit> =
            STIFF_HAND.iter().map(|(key, value)| (*key, (*value).into())).collect();
        edits.push(("contact.time_budget_us", TIME_BUDGET_US.into()));
        edits.push(("tool.voxel_size_mm", VOXEL_MM[usize::from(options.quick)].into()));
        // After the others are made absolute: an absolute path stays.
        edits.push(("device.hand", hand.to_string_lossy().into_owned().into()));
        let config = scenes::load(&scene, &edits, folder.path())
            .map_err(|why| BenchError::Prepare { what: scene.display().to_string(), why })?;
        tell(&format!(
            "stress: {long_s} s on the {} clock",
            if is_real { "real" } else { "virtual" }
        ));
        let (judge, report, n_points) = if is_real {
            play(&config, &mut cache, RealClock, long_s)?
        } else {
            play(&config, &mut cache, VirtualClock::default(), long_s)?
        };
        rows.extend(judge.rows(&report, n_points, is_real, long_s));
    }
    Ok(rows)
}

/// One run, judged as it goes.
fn play<C: Clock + Send>(
    config: &SceneConfig,
    cache: &mut Cache,
    clock: C,
    long_s: f64,
) -> Result<(Judge, LoopReport, usize), BenchError> {
    let failed = |why: String| BenchError::Prepare { what: config.name.clone(), why };
    let (prepared, _) = prepare_with(config, &mut BakeOptions::from(cache), |_| ())
        .map_err(|error| failed(error.to_string()))?;
    let n_points = prepared.scene.tool.shell.len();
    let parameters = prepared.scene.parameters;
    let request = ThreadRequest {
        cpu: schedule::loop_cpu(prepared.realtime.cpu),
        priority: prepared.realtime.priority,
    };
    let is_real = clock.kind() == rt::clock::ClockKind::Real;
    let locked = is_real && schedule::lock_memory().is_ok();
    let (producer, mut records) = RingBuffer::new(RING_RECORDS);
    let control = Arc::new(Control::enabled());
    let plan = RunPlan {
        stop_at_tick: Some((long_s / parameters.period_s).round() as u64),
        ..RunPlan::default()
    };
    let servo =
        ServoLoop::new(Arc::new(prepared.scene), prepared.device, clock, control, plan, producer)
            .with_time_budget(prepared.time_budget_s);
    let mut judge = Judge::new(parameters.limits);
    let report = thread::scope(|threads| {
        let servo = threads.spawn(move || {
            if is_real {
                schedule::enter_realtime(request);
            }
            run_to_end(servo)
        });
        loop {
            // Asked before popping: a record that was pushed before the loop went is then always
            // seen.
            let has_gone = records.is_abandoned();
            while let Ok(record) = records.pop() {
                judge.see(&record);
            }
            if has_gone {
                return servo.join();
            }
            thread::sleep(Duration::from_millis(1));
        }
    });
    if locked {
        schedule::unlock_memory();
    }
    let report = report.map_err(|_| failed("the loop ended without a report".to_owned()))?;
    Ok((judge, report, n_points))
}
