//! Arms on a wire, and what the tick does with what they say.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use arms::attached::nodes::Selector;
use arms::attached::open::{self, OpenOptions};
use arms::mock::MockArm;
use arms::mock::builder::{self, MockSettings};
use arms::mock::pty::Pty;
use arms::mock::serve::{Serving, serve};
use arms::simulated::HandParameters;
use arms::simulated::fault;
use arms::{Device, DeviceError, profile};
use glam::DVec3;
use hapticd::config::SceneConfig;
use hapticd::daemon::prepare_with;
use hapticd::scene::BakeOptions;
use hapticd::scene::cache::Cache;
use hapticd::servo::{Control, RunPlan, ServoLoop, Step};
use haptics::{Faults, OffCause, Parameters};
use rt::clock::VirtualClock;
use vps::spatial::{DeviceSample, SampleStatus, Wrench};

use super::meddled::Meddled;
use super::{STRIDE, counted, scene};

/// Exchanges with an arm at the other end of a terminal.
const EXCHANGES: u32 = 12_000;
/// One of them: shorter than a tick, so that the test is.
const PERIOD: Duration = Duration::from_micros(400);

/// Longer than any machine takes.
const GIVEN_UP: Duration = Duration::from_secs(60);

/// The real driver over a real terminal, with a thread that looks for the lost arm: sound exchanges, garbled ones, a plug that is pulled and put in
/// again, enable and disable, numbers that are none, and stops.
#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn an_arm_on_a_terminal_allocates_nothing() {
    for name in ["polhem-2022", "haply-2diy", "open6-serial"] {
        exchanges_of(name);
    }
}

fn exchanges_of(name: &str) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let node: PathBuf = folder.path().join("arm");
    let profile = profile::find(name, Path::new("")).expect("shipped");
    let faults =
        ["truncate@300ms+5ms", "unplug@2s+300ms"].map(|text| (text.to_owned(), fault::parse(text).expect("grammar"))).to_vec();
    let settings = MockSettings { hand: Some(HandParameters::default()), hand_delay: Duration::ZERO, faults, seed: 1 };
    let (parameters, protocol) = builder::parameters(&profile, settings);
    let serving = Serving { period_s: parameters.period_s, duration: Some(Duration::from_secs(60)), until_host_gone: false };
    let quit = Arc::new(AtomicBool::new(false));
    let mut pty = Pty::new(&node).expect("a terminal");
    let told = quit.clone();
    let carriage = arms::transport::Carriage::Stream;
    let mut mock = MockArm::new(parameters, protocol.firmware(carriage)).expect("valid");
    let arm_side = std::thread::spawn(move || {
        serve(&mut mock, &mut pty, serving, None, || told.load(Ordering::Relaxed)).expect("served");
        mock.report()
    });
    let options = OpenOptions {
        selector: Some(Selector::Path(node)),
        io_request: None,
        period_s: PERIOD.as_secs_f64(),
        guard: Some(env!("CARGO_BIN_EXE_hapticd").into()),
    };
    let mut arm = open::open(&profile, &options).unwrap_or_else(|error| panic!("{name}: {error}")).arm;
    let (mut n_fresh, mut n_lost, mut n_fresh_again) = (0, 0, 0);
    let begin = Instant::now();
    for n in 0_u32.. {
        // A machine that is busy with something else may take the mock longer to come to its faults.
        if (n >= EXCHANGES && n_fresh_again > 500) || begin.elapsed() > GIVEN_UP {
            break;
        }
        let wrench = match n % 1000 {
            997 => Wrench::new(DVec3::NAN, DVec3::ZERO),
            _ => Wrench::new(DVec3::new(0.2, -0.1, 0.05), DVec3::ZERO),
        };
        let (sample, allocations, frees) = counted(|| {
            if n % 500 == 0 {
                arm.set_enabled(n % 1000 == 0);
            }
            let sample = arm.read();
            let _ = arm.write(&wrench);
            if n % 2000 == 1999 {
                arm.stop();
            }
            sample
        });
        assert_eq!((allocations, frees), (0, 0), "{name}: exchange {n}, {sample:?}");
        match sample {
            Ok(sample) if sample.status == SampleStatus::Fresh => {
                n_fresh += 1;
                n_fresh_again += u32::from(n_lost > 0);
            }
            Ok(_) => {}
            Err(error) => {
                assert_eq!(error, DeviceError::Lost, "{name}");
                n_lost += 1;
            }
        }
        std::thread::sleep(PERIOD);
    }
    drop(arm);
    quit.store(true, Ordering::Relaxed);
    let report = arm_side.join().expect("no panic");
    let sound = n_fresh > 2000 && n_lost > 10 && n_fresh_again > 500 && report.largest_force_n > 0.01;
    assert!(sound, "{name}: {n_fresh} fresh, {n_lost} lost, {n_fresh_again} after that; {report:?}");
}

/// Steps through a run, counting; gives its faults and the causes for which it rendered nothing.
fn play(
    what: &str,
    config: &SceneConfig,
    change: impl FnOnce(&mut Parameters),
    meddle: impl Fn(u64, &mut DeviceSample) + Send,
) -> (Faults, Vec<OffCause>) {
    let (mut prepared, _) = prepare_with(config, &mut BakeOptions::from(&mut Cache::off()), |_| ()).expect("a scene");
    change(&mut prepared.scene.parameters);
    let (producer, mut consumer) = rtrb::RingBuffer::new(STRIDE);
    let device = Meddled { arm: prepared.device, n_reads: 0, meddle };
    let control = Arc::new(Control::enabled());
    let plan = RunPlan { stop_at_tick: Some(10_000), ..RunPlan::default() };
    let mut servo = ServoLoop::new(Arc::new(prepared.scene), device, VirtualClock::default(), control, plan, producer);
    servo.warm_up();
    let (mut faults, mut causes) = (Faults::NONE, Vec::new());
    loop {
        let (n, allocations, frees) =
            counted(|| (0..STRIDE).map(|_| servo.step()).take_while(|step| *step == Step::Continue).count());
        assert_eq!((allocations, frees), (0, 0), "{what}");
        while let Ok(record) = consumer.pop() {
            faults |= record.output.faults;
            if causes.last() != Some(&record.output.off_cause) {
                causes.push(record.output.off_cause);
            }
        }
        if n < STRIDE {
            return (faults, causes);
        }
    }
}

#[test]
fn no_safety_rule_allocates() {
    type Change = fn(&mut Parameters);
    type Meddle = fn(u64, &mut DeviceSample);
    let same: Change = |_| ();
    let rows: [(&str, Change, Meddle, Faults, OffCause); 10] = [
        (
            "deadman",
            |p| p.safety.deadman = Some(3),
            |n, s| s.buttons = u32::from(n % 600 > 300) << 3,
            Faults::NONE,
            OffCause::Deadman,
        ),
        ("braking", |p| p.limits.speed_m_per_s = 2e-3, |_, _| (), Faults::SPEED, OffCause::Velocity),
        ("power", |p| p.limits.power_w = 1e-4, |_, s| s.twist.linear = DVec3::ZERO, Faults::POWER, OffCause::Power),
        ("workspace", |p| p.safety.workspace_radius_m = 4e-3, |_, _| (), Faults::NONE, OffCause::Workspace),
        ("homing", same, |n, s| s.homed = n > 300, Faults::NONE, OffCause::NotHomed),
        ("homing lost", same, |n, s| s.homed = n < 1500, Faults::NOT_HOMED, OffCause::NotHomed),
        ("heat", same, |n, s| s.overheated = n > 1500, Faults::THERMAL, OffCause::Thermal),
        ("device error", same, |n, s| s.device_error = u16::from(n > 1500), Faults::DEVICE_ERROR, OffCause::Protocol),
        ("packets", same, |n, s| s.corrupt_packets = u16::from(n > 1500), Faults::PROTOCOL, OffCause::Protocol),
        ("gap", same, |n, s| s.lost_packets = if n > 1500 { 20 } else { 0 }, Faults::SEQUENCE_GAP, OffCause::Protocol),
    ];
    let config = scene("block-on-plane", &[]);
    for (what, change, meddle, expected, cause) in rows {
        let (faults, causes) = play(what, &config, change, meddle);
        assert!(faults == expected && causes.contains(&cause), "{what}: {:?} {causes:?}", faults.names().collect::<Vec<_>>());
    }
}
