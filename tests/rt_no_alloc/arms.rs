//! Arms on a wire, and what the tick does with what they say.

use std::sync::Arc;
use std::time::{Duration, Instant};

use arms::attached::open::OpenedArm;
use arms::{Device, DeviceError};
use engine::servo::{Control, RunPlan, ServoLoop, Step};
use glam::DVec3;
use hapticd::config::SceneConfig;
use hapticd::daemon::prepare_with;
use hapticd::scene::BakeOptions;
use hapticd::scene::cache::Cache;
use haptics::{Faults, OffCause, Parameters};
use rt::clock::VirtualClock;
use vps::spatial::{DeviceSample, SampleStatus, Wrench};

use super::maker::{self, Library, Serial, Service};
use super::meddled::Meddled;
use super::{STRIDE, counted, scene};

/// Exchanges with an arm at the other end of a terminal.
const EXCHANGES: u32 = 12_000;
/// One of them: shorter than a tick, so that the test is.
const PERIOD: Duration = Duration::from_micros(400);

/// Longer than any machine takes.
const GIVEN_UP: Duration = Duration::from_secs(60);

/// The real driver over a real terminal, a maker's library in a worker, and a maker's service, with
/// a thread that looks for the lost arm: sound exchanges, garbled ones, a plug that is pulled and
/// put in again, enable and disable, numbers that are none, and stops.
#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn an_arm_on_a_wire_allocates_nothing() {
    const FAULTS: [&str; 2] = ["truncate@300ms+5ms", "unplug@2s+300ms"];
    std::thread::scope(|scope| {
        for name in ["polhem-2022", "haply-2diy", "open6-serial"] {
            scope.spawn(move || {
                exchanges_of(name, Serial::new(name, &FAULTS), Serial::open, |serial| serial.arm)
            });
        }
        for name in ["omega6", "touch", "virtuose-6d"] {
            scope.spawn(move || {
                exchanges_of(name, Library::new(name, &FAULTS), Library::open, |library| {
                    library.arm
                })
            });
        }
        scope.spawn(|| {
            exchanges_of("inverse3", Service::new("3.5.0", &FAULTS), Service::open, |service| {
                service.arm
            })
        });
    });
}

fn exchanges_of<B>(
    name: &str,
    bench: B,
    open: impl Fn(&B) -> OpenedArm,
    arm_of: impl Fn(B) -> maker::Arm,
) {
    let mut arm = open(&bench).arm;
    let mut n_fresh = 0;
    let mut n_lost = 0;
    let mut n_fresh_again = 0;
    let begin = Instant::now();
    for n in 0_u32.. {
        // A machine that is busy with something else may take the mock longer to come to its
        // faults.
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
    let report = arm_of(bench).ended();
    let sound =
        n_fresh > 2000 && n_lost > 10 && n_fresh_again > 500 && report.largest_force_n > 0.01;
    assert!(
        sound,
        "{name}: {n_fresh} fresh, {n_lost} lost, {n_fresh_again} after that; {report:?}"
    );
}

/// Steps through a run, counting; gives its faults and the causes for which it rendered nothing.
fn play(
    what: &str,
    config: &SceneConfig,
    change: impl FnOnce(&mut Parameters),
    meddle: impl Fn(u64, &mut DeviceSample) + Send,
) -> (Faults, Vec<OffCause>) {
    let (mut prepared, _) =
        prepare_with(config, &mut BakeOptions::from(&mut Cache::off()), |_| ()).expect("a scene");
    change(&mut prepared.scene.parameters);
    let (producer, mut consumer) = rtrb::RingBuffer::new(STRIDE);
    let device = Meddled { arm: prepared.device, n_reads: 0, meddle };
    let control = Arc::new(Control::enabled());
    let plan = RunPlan { stop_at_tick: Some(10_000), ..RunPlan::default() };
    let mut servo = ServoLoop::new(
        Arc::new(prepared.scene),
        device,
        VirtualClock::default(),
        control,
        plan,
        producer,
    );
    servo.warm_up();
    let mut faults = Faults::NONE;
    let mut causes = Vec::new();
    loop {
        let (n, allocations, frees) = counted(|| {
            (0..STRIDE).map(|_| servo.step()).take_while(|step| *step == Step::Continue).count()
        });
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
        (
            "braking",
            |p| p.limits.speed_m_per_s = 2e-3,
            |_, _| (),
            Faults::SPEED,
            OffCause::Velocity,
        ),
        (
            "power",
            |p| p.limits.power_w = 1e-4,
            |_, s| s.twist.linear = DVec3::ZERO,
            Faults::POWER,
            OffCause::Power,
        ),
        (
            "workspace",
            |p| p.safety.workspace_radius_m = 4e-3,
            |_, _| (),
            Faults::NONE,
            OffCause::Workspace,
        ),
        ("homing", same, |n, s| s.homed = n > 300, Faults::NONE, OffCause::NotHomed),
        ("homing lost", same, |n, s| s.homed = n < 1500, Faults::NOT_HOMED, OffCause::NotHomed),
        ("heat", same, |n, s| s.overheated = n > 1500, Faults::THERMAL, OffCause::Thermal),
        (
            "device error",
            same,
            |n, s| s.device_error = u16::from(n > 1500),
            Faults::DEVICE_ERROR,
            OffCause::Protocol,
        ),
        (
            "packets",
            same,
            |n, s| s.corrupt_packets = u16::from(n > 1500),
            Faults::PROTOCOL,
            OffCause::Protocol,
        ),
        (
            "gap",
            same,
            |n, s| s.lost_packets = if n > 1500 { 20 } else { 0 },
            Faults::SEQUENCE_GAP,
            OffCause::Protocol,
        ),
    ];
    let config = scene("block-on-plane", &[]);
    for (what, change, meddle, expected, cause) in rows {
        let (faults, causes) = play(what, &config, change, meddle);
        assert!(
            faults == expected && causes.contains(&cause),
            "{what}: {:?} {causes:?}",
            faults.names().collect::<Vec<_>>()
        );
    }
}
