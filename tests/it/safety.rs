//! The safety table against a whole loop: the simulated arm in contact, something goes wrong, ticks
//! are counted. `docs/reference/safety.md` names these tests; what an arm in the same process
//! cannot play is tested in `crates/haptics/src/tick/tests.rs`.

use std::sync::Arc;

use arms::profile;
use engine::servo::{Control, Ending, RunPlan, ServoLoop, Step};
use hapticd::config::{LoadOptions, SceneConfig, load_with};
use hapticd::daemon::prepare_with;
use hapticd::scene::BakeOptions;
use hapticd::scene::cache::Cache;
use haptics::{Drive, Faults, OffCause, Parameters};
use recording::TickRecord;
use rt::clock::VirtualClock;
use vps::spatial::DeviceSample;

use super::meddled::Meddled;
use super::rig;

/// The hand presses the block onto the plane from 1.2 s to 2.4 s.
const WRONG_FROM: u64 = 1500;
const N_TICKS: u64 = 2300;
const RAMP_TICKS: usize = 100;
/// Ticks that the slew limit takes from the force in contact to zero, at most.
const SLEW_TICKS: usize = 2;

struct Played {
    records: Vec<TickRecord>,
    faults: Faults,
    ending: Ending,
}

fn play(
    config: &SceneConfig,
    n_ticks: u64,
    change: impl FnOnce(&mut Parameters),
    meddle: impl Fn(u64, &mut DeviceSample) + Send,
) -> Played {
    let (mut prepared, _) =
        prepare_with(config, &mut BakeOptions::from(&mut Cache::off()), |_| ()).expect("a scene");
    change(&mut prepared.scene.parameters);
    let (producer, mut consumer) = rtrb::RingBuffer::new(n_ticks as usize + 2000);
    let device = Meddled { arm: prepared.device, n_reads: 0, meddle };
    let plan = RunPlan { stop_at_tick: Some(n_ticks), ..RunPlan::default() };
    let control = Arc::new(Control::enabled());
    let mut servo = ServoLoop::new(
        Arc::new(prepared.scene),
        device,
        VirtualClock::default(),
        control,
        plan,
        producer,
    );
    servo.warm_up();
    while servo.step() == Step::Continue {}
    let report = servo.finish();
    let records = core::iter::from_fn(|| consumer.pop().ok()).collect();
    Played { records, faults: report.faults, ending: report.ending }
}

fn pressing(fault: &str) -> SceneConfig {
    let with_fault = format!("[device.sim]\nfault = \"{fault}\"\n\n[realtime]");
    let replacements = [("[realtime]", with_fault.as_str())];
    rig::rewritten("block-on-plane", if fault.is_empty() { &[] } else { &replacements })
}

/// The block over the plane with a hand of its own: lines of time (s), x and z (mm).
fn with_hand(
    knots: &[(f64, f64, f64)],
    replacements: &[(&str, &str)],
) -> (tempfile::TempDir, SceneConfig) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("hand.csv");
    let mut lines = "t_s,x_m,y_m,z_m,qx,qy,qz,qw\n".to_owned();
    for (t_s, x_mm, z_mm) in knots {
        lines += &format!("{t_s},{},0,{},0,0,0,1\n", x_mm * 1e-3, z_mm * 1e-3);
    }
    std::fs::write(&path, lines).expect("written");
    let hand = format!("hand = \"{}\"", path.display());
    let mut all = vec![("hand = \"hands/block-on-plane.csv\"", hand.as_str())];
    all.extend_from_slice(replacements);
    let config = rig::rewritten("block-on-plane", &all);
    (folder, config)
}

impl Played {
    fn force_n(&self, tick: usize) -> f64 {
        self.records[tick].output.command_device.force.length()
    }

    fn is_zero(&self, tick: usize) -> bool {
        rig::is_bit_zero(self.records[tick].output.command_device)
            && rig::is_bit_zero(self.records[tick].rendered_device)
    }

    /// Force until something goes wrong at `WRONG_FROM`, and then the fault, after exactly so many
    /// ticks, with zero command.
    fn assert_fault_after(&self, name: &str, n_ticks: usize, faults: Faults, cause: OffCause) {
        let fault_tick = WRONG_FROM as usize + n_ticks;
        assert!(
            self.force_n(WRONG_FROM as usize - 1) > 0.3,
            "{name}: {} N in contact",
            self.force_n(WRONG_FROM as usize - 1)
        );
        let first = self.records.iter().position(|record| !record.output.faults.is_empty());
        assert_eq!(
            first,
            Some(fault_tick),
            "{name}: {:?}",
            self.faults.names().collect::<Vec<_>>()
        );
        let output = &self.records[fault_tick].output;
        assert_eq!(
            (output.faults, output.off_cause, output.drive),
            (faults, cause, Drive::Fault),
            "{name}"
        );
        assert!(self.is_zero(fault_tick), "{name}");
        assert_eq!((self.faults, self.ending), (faults, Ending::Faulted), "{name}");
    }
}

#[test]
fn faults_of_samples_give_zero_in_the_tick_that_shows_them() {
    type Meddle = fn(u64, &mut DeviceSample);
    let rows: [(&str, usize, Faults, OffCause, Meddle); 5] = [
        ("device error", 0, Faults::DEVICE_ERROR, OffCause::Protocol, |n, s| {
            s.device_error = u16::from(n >= WRONG_FROM)
        }),
        ("homing lost", 0, Faults::NOT_HOMED, OffCause::NotHomed, |n, s| s.homed = n < WRONG_FROM),
        ("gap of 20 samples", 0, Faults::SEQUENCE_GAP, OffCause::Protocol, |n, s| {
            s.lost_packets = if n >= WRONG_FROM { 20 } else { 0 };
        }),
        ("a garbled packet per tick", 10, Faults::PROTOCOL, OffCause::Protocol, |n, s| {
            s.corrupt_packets = u16::from(n >= WRONG_FROM);
        }),
        ("eleven at once", 0, Faults::PROTOCOL, OffCause::Protocol, |n, s| {
            s.corrupt_packets = if n >= WRONG_FROM { 11 } else { 0 };
        }),
    ];
    let config = pressing("");
    for (name, n_ticks, faults, cause, meddle) in rows {
        play(&config, N_TICKS, |_| (), meddle).assert_fault_after(name, n_ticks, faults, cause);
    }
}

#[test]
fn faults_that_the_simulated_arm_plays_give_zero_in_time() {
    for (fault, n_ticks, faults, cause) in [
        ("nan@1500ms", 0, Faults::NON_FINITE, OffCause::NonFinite),
        ("unplug@1500ms", 0, Faults::DEVICE_LOST, OffCause::Disconnected),
        ("jump@1500ms", 0, Faults::POSITION_JUMP | Faults::SPEED, OffCause::Velocity),
        ("skip=40@1500ms", 0, Faults::SEQUENCE_GAP, OffCause::Protocol),
        ("stall@1500ms", 20, Faults::STALE, OffCause::Stale),
    ] {
        let played = play(&pressing(fault), N_TICKS, |_| (), |_, _| ());
        played.assert_fault_after(fault, n_ticks, faults, cause);
        if fault.starts_with("stall") {
            // Down by a hundredth per tick from the fourth tick on. Across, the last velocity still
            // carries the tool on.
            let down_n = |tick: u64| played.records[tick as usize].output.command_device.force.z;
            let held_n = down_n(WRONG_FROM + 2);
            let low_n = down_n(WRONG_FROM + 19);
            assert!((low_n - 0.83 * held_n).abs() < 0.05 * held_n, "{low_n} N of {held_n} N");
        }
    }
}

#[test]
fn a_deadman_that_is_let_go_ramps_to_zero_and_pressed_again_ramps_up() {
    let config =
        rig::rewritten("block-on-plane", &[("[realtime]", "[safety]\ndeadman = 3\n\n[realtime]")]);
    let held = |n: u64| (200..WRONG_FROM).contains(&n) || n >= WRONG_FROM + 300;
    let played =
        play(&config, N_TICKS, |_| (), move |n, sample| sample.buttons = u32::from(held(n)) << 3);
    let drive = |tick: usize| played.records[tick].output.drive;
    let cause = |tick: usize| played.records[tick].output.off_cause;
    assert!((0..200).all(|tick| drive(tick) == Drive::Disabled
        && cause(tick) == OffCause::Deadman
        && played.is_zero(tick)));
    assert_eq!((drive(200), drive(200 + RAMP_TICKS + 2)), (Drive::Enabling, Drive::Enabled));
    let from = WRONG_FROM as usize;
    assert_eq!((drive(from), cause(from)), (Drive::Stopping, OffCause::Deadman));
    assert!(played.force_n(from - 1) > 0.3);
    // At most the share of the ramp that is left, up to what the arm moves meanwhile.
    for n in [25, 50, 75, 99] {
        let share = 1.0 - n as f64 / RAMP_TICKS as f64;
        assert!(
            played.force_n(from + n) <= (share + 0.01) * 3.0 * played.force_n(from - 1),
            "{n}: {}",
            played.force_n(from + n)
        );
    }
    assert!(
        (from + RAMP_TICKS + SLEW_TICKS..from + 300)
            .all(|tick| played.is_zero(tick) && drive(tick) == Drive::Disabled)
    );
    assert_eq!(drive(from + 300), Drive::Enabling);
    assert!(played.is_zero(from + 300));
    // The tool stays where it stood while the deadman is released.
    let place = |tick: usize| played.records[tick].output.world_from_tool.translation;
    assert!((place(from + 299) - place(from + 300)).length() < 1e-4);
    assert_eq!((played.faults, played.ending), (Faults::NONE, Ending::Stopped));
}

#[test]
fn an_overheated_motor_ramps_to_zero_then_faults() {
    let played =
        play(&pressing(""), N_TICKS, |_| (), |n, sample| sample.overheated = n >= WRONG_FROM);
    let from = WRONG_FROM as usize;
    assert_eq!(played.records[from].output.drive, Drive::Stopping);
    assert!((1..RAMP_TICKS - 5).all(|n| played.force_n(from + n) > 0.0));
    let n = played.records.len() - 1 - from;
    assert!((RAMP_TICKS - 1..RAMP_TICKS + SLEW_TICKS).contains(&n), "{n}");
    played.assert_fault_after("overheated", n, Faults::THERMAL, OffCause::Thermal);
}

#[test]
fn force_waits_for_homing() {
    let played = play(&pressing(""), N_TICKS, |_| (), |n, sample| sample.homed = n >= 300);
    let output = |tick: usize| played.records[tick].output;
    assert!((0..300).all(|tick| output(tick).drive == Drive::Disabled
        && output(tick).off_cause == OffCause::NotHomed));
    assert_eq!(output(300).drive, Drive::Enabling);
    assert!(output(300 + RAMP_TICKS + 2).drive == Drive::Enabled && played.force_n(1499) > 0.3);
    assert_eq!((played.faults, played.ending), (Faults::NONE, Ending::Stopped));
}

/// Down to 1.5 mm inside by 1 s; then 10 mm along x with 50 mm/s, and back.
const SLIDE: [(f64, f64, f64); 6] = [
    (0.0, 0.0, 15.0),
    (0.2, 0.0, 15.0),
    (1.0, 0.0, 8.5),
    (1.5, 0.0, 8.5),
    (1.7, 10.0, 8.5),
    (1.9, 0.0, 8.5),
];

#[test]
fn too_much_speed_brakes_for_a_tenth_of_a_second_at_most_then_faults() {
    let (_folder, config) =
        with_hand(&SLIDE, &[("[realtime]", "[limits]\nspeed_mm_per_s = 20\n\n[realtime]")]);
    let played = play(&config, N_TICKS, |_| (), |_, _| ());
    let drive = |tick: usize| played.records[tick].output.drive;
    let from =
        (0..played.records.len()).find(|tick| drive(*tick) == Drive::Braking).expect("it brakes");
    assert!(
        (1500..1600).contains(&from)
            && drive(from - 1) == Drive::Enabled
            && played.force_n(from - 1) > 0.3,
        "{from}"
    );
    let n = (from..played.records.len()).take_while(|tick| drive(*tick) == Drive::Braking).count();
    assert!((2..=100).contains(&n), "{n} ticks");
    for tick in from..from + n {
        let record = &played.records[tick];
        assert_eq!(
            (record.output.faults, record.output.off_cause),
            (Faults::NONE, OffCause::Velocity)
        );
        // Nothing but resistance: no spring is left.
        let force = record.output.command_device.force;
        let velocity = record.input.sample.twist.linear;
        assert!(
            force.dot(velocity) <= 0.0 && force.length() <= 10.0 * velocity.length() + 1e-9,
            "tick {tick}: {force} at {velocity}"
        );
    }
    assert!((from..from + n).any(|tick| played.force_n(tick) > 0.1));
    let output = &played.records[from + n].output;
    assert_eq!((output.drive, output.faults), (Drive::Fault, Faults::SPEED));
    assert!(played.is_zero(from + n));
    assert_eq!((played.faults, played.ending), (Faults::SPEED, Ending::Faulted));
}

/// Pressed, then along x with 0.4 m/s.
const DASH: [(f64, f64, f64); 5] =
    [(0.0, 0.0, 15.0), (0.2, 0.0, 15.0), (1.0, 0.0, 8.5), (1.5, 0.0, 8.5), (1.55, 20.0, 8.5)];

#[test]
fn encoders_that_freeze_in_a_motion_are_stale_then_stuck_and_the_motion_alone_is_not() {
    let (_folder, config) = with_hand(&DASH, &[]);
    let played = play(&config, N_TICKS, |_| (), |_, _| ());
    assert_eq!((played.faults, played.ending), (Faults::NONE, Ending::Stopped));
    let moves = |tick: usize| played.records[tick].input.sample.twist.linear.x;
    let fastest = (1500..1600).max_by(|a, b| moves(*a).total_cmp(&moves(*b))).expect("ticks");
    assert!(moves(fastest) > 0.25, "{} m/s", moves(fastest));

    let frozen = fastest - 5;
    let fault = format!("[device.sim]\nfault = \"stuck@{frozen}ms\"\n\n[realtime]");
    let (_folder, config) = with_hand(&DASH, &[("[realtime]", &fault)]);
    let played = play(&config, N_TICKS, |_| (), |_, _| ());
    let output = |repeat: usize| played.records[frozen + repeat].output;
    // The sample of tick `frozen` is the first that is kept; the next one is the first repeat.
    for repeat in 1..=20 {
        let expected = if repeat < 5 { OffCause::None } else { OffCause::Stale };
        assert_eq!(
            (output(repeat).off_cause, output(repeat).faults),
            (expected, Faults::NONE),
            "{repeat}"
        );
    }
    assert_eq!((output(21).drive, output(21).faults), (Drive::Fault, Faults::STUCK));
    assert!(played.is_zero(frozen + 21));
    assert_eq!(played.ending, Ending::Faulted);
}

#[test]
fn outside_of_the_workspace_the_force_fades_and_inside_it_comes_back() {
    let (_folder, config) = with_hand(&SLIDE, &[]);
    // 5 mm down and more than 6.2 mm aside is outside.
    let played = play(&config, 2600, |p| p.safety.workspace_radius_m = 8e-3, |_, _| ());
    let is_outside =
        |tick: usize| played.records[tick].input.sample.pose.translation.length() > 8e-3;
    let left = (0..2500).find(|tick| is_outside(*tick)).expect("it leaves");
    let back = (left..2500).find(|tick| !is_outside(*tick)).expect("it comes back");
    assert!(
        (1500..1800).contains(&left) && back - left > RAMP_TICKS + SLEW_TICKS,
        "{left}..{back}"
    );
    assert!(played.force_n(left - 1) > 0.3);
    assert!((left..back).all(|tick| played.records[tick].output.off_cause == OffCause::Workspace));
    assert!((left + RAMP_TICKS + SLEW_TICKS..back).all(|tick| played.is_zero(tick)));
    assert!((left..2500).all(|tick| played.records[tick].output.drive == Drive::Enabled));
    for n in 0..RAMP_TICKS {
        let most_n = 12.0 * (n + 1) as f64 / RAMP_TICKS as f64;
        assert!(played.force_n(back + n) <= most_n, "{n}");
    }
    assert!(played.force_n(2400) > 0.3);
    assert_eq!((played.faults, played.ending), (Faults::NONE, Ending::Stopped));
}

#[test]
fn a_tool_that_starts_pressed_waits_for_a_small_force_and_the_hand_ends_it() {
    let hand =
        [(0.0, 0.0, 8.5), (1.0, 0.0, 8.5), (1.5, 0.0, 11.0), (2.0, 0.0, 11.0), (2.5, 0.0, 8.5)];
    let replacements = [
        ("start_position_mm = [0.0, 0.0, 15.0]", "start_position_mm = [0.0, 0.0, 8.5]"),
        ("coupling = \"implicit\"", "coupling = \"direct\""),
        ("stiffness_n_per_mm3 = 2.222222222222222", "stiffness_n_per_mm3 = 0.622"),
    ];
    let (_folder, config) = with_hand(&hand, &replacements);
    let played = play(&config, 3000, |_| (), |_, _| ());
    let output = |tick: usize| played.records[tick].output;
    assert!((0..1000).all(|tick| output(tick).drive == Drive::Enabling
        && output(tick).drive.is_busy()
        && played.is_zero(tick)));
    assert!(output(500).contacts > 0 && output(500).max_depth_m > 1e-3);
    assert_eq!(output(2000).drive, Drive::Enabled);
    assert!(played.force_n(2990) > 0.3);
    assert_eq!((played.faults, played.ending), (Faults::NONE, Ending::Stopped));
}

#[test]
fn unverified_signs_cap_the_force() {
    let hand = [(0.0, 0.0, 15.0), (0.2, 0.0, 15.0), (1.0, 0.0, 5.0), (2.0, 0.0, 5.0)];
    let (_folder, config) = with_hand(&hand, &[]);
    let strongest_n = |change: fn(&mut Parameters)| {
        let played = play(&config, N_TICKS, change, |_, _| ());
        assert_eq!((played.faults, played.ending), (Faults::NONE, Ending::Stopped));
        (0..played.records.len()).map(|tick| played.force_n(tick)).fold(0.0, f64::max)
    };
    assert!(strongest_n(|_| ()) > 2.0);
    assert!(
        strongest_n(|p| p.limits.force_n = profile::UNVERIFIED_SIGNS_FORCE_N)
            <= 0.5 * (1.0 + 1e-12)
    );
    // Every real arm that ships is such an arm, and no scene can raise it.
    let options = LoadOptions { device: Some("polhem-2022".to_owned()), ..LoadOptions::default() };
    let config = load_with(&rig::shipped("block-on-plane"), &options)
        .unwrap_or_else(|errors| panic!("{errors}"));
    assert_eq!(config.parameters.limits.force_n, profile::UNVERIFIED_SIGNS_FORCE_N);
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("greedy.toml");
    let text = std::fs::read_to_string(rig::shipped("block-on-plane")).expect("readable");
    let text = text
        .replace("hand = \"hands/block-on-plane.csv\"", "")
        .replace("[device]", "[limits]\nforce_n = 9.0\n\n[device]");
    std::fs::write(&path, text).expect("written");
    let greedy = load_with(&path, &options).unwrap_or_else(|errors| panic!("{errors}"));
    assert_eq!(greedy.parameters.limits.force_n, profile::UNVERIFIED_SIGNS_FORCE_N);
}

#[test]
fn the_table_names_every_fault_and_every_cause() {
    let page = include_str!("../../docs/reference/safety.md");
    let rules = page
        .split("## Rules")
        .nth(1)
        .and_then(|rest| rest.split("\n## ").next())
        .expect("the table");
    for (_, name, _) in Faults::TABLE {
        assert!(rules.contains(&format!("\n| `{name}` |")), "{name} has no row");
    }
    for cause in OffCause::ALL {
        assert!(rules.contains(&format!("`{}`", cause.name())), "{cause:?}");
    }
}
