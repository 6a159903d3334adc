//! A fall of the force is never delayed: whatever the keys that `check` accepts, and whatever takes
//! the force away.
//!
//! The ranges of the keys are found by asking the resolver, so a range that becomes wider is tested
//! as wide as it is.

use glam::DVec3;
use hapticd::config::{self, SceneConfig, json_schema};
use hapticd::daemon::prepare;
use haptics::{
    Drive, DriveRequest, Faults, LimitParameters, LiveParameter, ParameterChange, Parameters,
    RenderScene, State, TickInput, TickOutput, tick,
};
use serde_json::Value;
use vps::spatial::testing::Random;
use vps::spatial::{DeviceSample, SampleStatus, Wrench};

const MODES: [&str; 3] = ["implicit", "constraint", "direct"];
const RATES_HZ: [u32; 3] = [250, 1000, 2000];
/// The table of a scene, and its type in the schema.
const TABLES: [(&str, &str); 4] =
    [("safety", "Safety"), ("limits", "Limits"), ("coupling", "Coupling"), ("contact", "Contact")];
/// Longest ramp down, s.
const RAMP_DOWN_S: f64 = 0.1;
/// How fast the hand comes, and how fast it leaves, m/s.
const COMES_M_PER_S: f64 = 0.05;
const LEAVES_M_PER_S: f64 = 0.2;
const N_SCENES: usize = 40;

/// A key of a scene, with the least and the largest number that the resolver accepts.
struct Key {
    table: &'static str,
    name: String,
    range: [f64; 2],
}

fn text(mode: &str, rate_hz: u32, keys: &[(&str, &str, f64)]) -> String {
    let tables: String = TABLES
        .iter()
        .map(|(table, _)| {
            let deadman = if *table == "safety" { "deadman = 0\n" } else { "" };
            let lines: String = keys
                .iter()
                .filter(|(of, ..)| of == table)
                .map(|(_, name, value)| format!("{name} = {value:?}\n"))
                .collect();
            format!("[{table}]\n{deadman}{lines}")
        })
        .collect();
    format!(
        "version = 1\n[rendering]\nrate_hz = {rate_hz}\ncoupling = \"{mode}\"\n[[static]]\n\
            shape = {{ plane_mm = [30, 30] }}\nvoxel_size_mm = 1\n[tool]\n\
            shape = {{ sphere_mm = 5 }}\nvoxel_size_mm = 1\nstart_position_mm = [0, 0, 6]\n\
            [device]\nprofile = \"sim-sigma7\"\n{tables}"
    )
}

fn load(text: &str) -> Option<SceneConfig> {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("scene.toml");
    std::fs::write(&path, text).expect("written");
    config::load(&path).ok()
}

/// Every key that is a number.
fn keys() -> Vec<Key> {
    let schema: Value = serde_json::from_str(&json_schema::scene()).expect("a schema");
    let mut keys = Vec::new();
    for (table, definition) in TABLES {
        let properties = schema["$defs"][definition]["properties"].as_object().expect("keys");
        for (name, property) in properties {
            if property["type"] == "number" {
                let range = accepted(table, name);
                keys.push(Key { table, name: name.clone(), range });
            }
        }
    }
    keys
}

/// The ends of the range that the resolver accepts, to five digits.
fn accepted(table: &str, name: &str) -> [f64; 2] {
    let accepts = |number: f64| load(&text("implicit", 1000, &[(table, name, number)])).is_some();
    let decades: Vec<f64> =
        (-9..=9).map(|n| 10.0_f64.powi(n)).filter(|number| accepts(*number)).collect();
    let edge = |mut inside: f64, mut outside: f64| {
        for _ in 0..17 {
            let middle = (inside * outside).sqrt();
            let end = if accepts(middle) { &mut inside } else { &mut outside };
            *end = middle;
        }
        inside
    };
    let first = *decades.first().unwrap_or_else(|| panic!("{table}.{name} accepts no number"));
    let last = *decades.last().expect("as above");
    [edge(first, 0.1 * first), edge(last, 10.0 * last)]
}

/// An arm in a hand that presses a ball onto a plane.
#[derive(Clone)]
struct Hand {
    state: State,
    input: TickInput,
    last: TickOutput,
}

impl Hand {
    fn new(scene: &RenderScene) -> Self {
        let sample =
            DeviceSample { status: SampleStatus::Fresh, buttons: 1, ..DeviceSample::default() };
        let input = TickInput { sample, request: DriveRequest::Enable, ..TickInput::default() };
        Self { state: State::new(scene), input, last: TickOutput::default() }
    }

    /// A tick in which the hand goes up with this speed, and `change` has its way.
    fn tick(
        &mut self,
        scene: &RenderScene,
        up_m_per_s: f64,
        change: impl Fn(&mut TickInput, &Parameters),
    ) -> TickOutput {
        let p = &scene.parameters;
        let sample = &mut self.input.sample;
        sample.sequence += 1;
        sample.pose.translation.z += up_m_per_s * p.period_s;
        // What the arm reports stays below the speed limit, which has a fault of its own.
        let most = 0.5 * p.limits.speed_m_per_s;
        sample.twist.linear = DVec3::Z * up_m_per_s.clamp(-most, most);
        let mut input = self.input;
        change(&mut input, p);
        self.last = tick(scene, &mut self.state, &input);
        let force_n = self.last.command_device.force.length();
        assert!(force_n <= p.limits.force_n * (1.0 + 1e-9), "{force_n} N");
        self.last
    }

    /// So long that the ramp has come to this share.
    fn enable(&mut self, scene: &RenderScene, share: f64) {
        let p = &scene.parameters;
        let n_ticks = (share * p.limits.ramp_s / p.period_s) as usize + 10;
        for _ in 0..n_ticks {
            self.tick(scene, 0.0, |_, _| ());
        }
        let expected = if share < 1.0 { Drive::Enabling } else { Drive::Enabled };
        assert!(self.last.drive == expected || p.limits.ramp_s < 0.1, "{:?}", self.last);
    }

    /// 3 mm down and a moment there. The force, N; `None` after a fault.
    fn press(&mut self, scene: &RenderScene) -> Option<f64> {
        let n_ticks = (0.06 / scene.parameters.period_s) as usize;
        for n in 0..2 * n_ticks {
            self.tick(scene, if n < n_ticks { -COMES_M_PER_S } else { 0.0 }, |_, _| ());
        }
        let force_n = self.last.command_device.force.length();
        (self.last.faults == Faults::NONE).then_some(force_n)
    }
}

/// What takes force away, what it does to the input of each tick, and after how long a time the
/// output stage is asked for zero, s.
type OffSource = (&'static str, fn(&mut TickInput, &Parameters), f64);

const OFF_SOURCES: [OffSource; 16] = [
    ("disable", |input, _| input.request = DriveRequest::Disable, 0.0),
    ("stop, or another scene", |input, _| input.request = DriveRequest::Stop, RAMP_DOWN_S),
    ("deadman", |input, _| input.sample.buttons = 0, RAMP_DOWN_S),
    ("heat", |input, _| input.sample.overheated = true, RAMP_DOWN_S),
    ("silence", |input, _| input.sample.status = SampleStatus::Stale, 0.02),
    ("unplugged", |input, _| input.sample.status = SampleStatus::Lost, 0.0),
    ("link", |input, _| input.sample.status = SampleStatus::LinkLost, 0.0),
    ("error of the arm", |input, _| input.sample.device_error = 1, 0.0),
    ("zero lost", |input, _| input.sample.homed = false, 0.0),
    ("not a number", |input, _| input.sample.pose.translation.x = f64::NAN, 0.0),
    ("jump", |input, _| input.sample.pose.translation.x += 1.0, 0.0),
    ("lost samples", |input, _| input.sample.lost_packets = 1000, 0.0),
    ("garbled packets", |input, _| input.sample.corrupt_packets = 100, 0.0),
    ("stall", |input, _| input.stalled = true, 0.0),
    (
        "too fast",
        |input, p| input.sample.twist.linear = DVec3::X * (2.0 * p.limits.speed_m_per_s),
        0.1,
    ),
    ("workspace", |_, _| (), RAMP_DOWN_S),
];

/// Each off source ends the force of `pressing` in its time, while the hand presses on.
fn assert_off(scene: &mut RenderScene, pressing: &Hand, about: &str) {
    let p = scene.parameters;
    for (name, change, asked_s) in OFF_SOURCES {
        let mut hand = pressing.clone();
        if name == "workspace" {
            scene.parameters.safety.workspace_radius_m = 1e-6;
        }
        // A tick to see it, and one for the rounding of equal steps.
        let fall_s = if asked_s > 0.0 { asked_s + LimitParameters::FALL_S } else { 0.0 };
        let n_ticks = (fall_s / p.period_s).ceil() as usize + if asked_s > 0.0 { 2 } else { 0 };
        for n in 0..n_ticks + 20 {
            let output = hand.tick(scene, -0.01, change);
            let is_zero = output.command_device == Wrench::ZERO;
            assert!(is_zero || n < n_ticks, "{name}: {output:?} in tick {n}\n{about}");
        }
        scene.parameters = p;
    }
}

/// The hand draws back: within 10 ms of the last contact there is no force, and no more work was
/// done on it than an even fall in that time does. False when contact did not end: after a fault,
/// or where all is so soft that the tool does not follow.
fn assert_free(scene: &RenderScene, pressing: &Hand, about: &str) -> bool {
    let p = &scene.parameters;
    let mut hand = pressing.clone();
    let mut last_n = 0.0;
    let mut given_j = 0.0;
    let mut free_ticks = 0;
    let most_ticks = (LimitParameters::FALL_S / p.period_s).ceil() as usize + 1;
    for _ in 0..(0.1 / p.period_s) as usize {
        let output = hand.tick(scene, LEAVES_M_PER_S, |_, _| ());
        let force = output.command_device.force;
        if output.drive == Drive::Fault {
            // Too much power on the way.
            assert_eq!(output.command_device, Wrench::ZERO, "{about}");
            return false;
        }
        if output.contacts > 0 {
            last_n = force.length();
            continue;
        }
        free_ticks += 1;
        given_j += force.z.max(0.0) * LEAVES_M_PER_S * p.period_s;
        let is_zero = output.command_device == Wrench::ZERO;
        assert!(
            is_zero || free_ticks <= most_ticks,
            "{free_ticks} ticks free: {output:?}\n{about}"
        );
    }
    let most_j =
        0.5 * last_n * last_n / p.limits.force_n * LimitParameters::FALL_S * LEAVES_M_PER_S;
    assert!(given_j <= most_j * (1.0 + 1e-6) + 1e-12, "{given_j} of {most_j} J\n{about}");
    free_ticks > 0
}

/// A limit that a client lowers holds in every tick, wherever it is on its way.
fn assert_lowered(scene: &RenderScene, pressing: &Hand, about: &str) {
    let p = &scene.parameters;
    let range = LiveParameter::ForceLimit.range(p).expect("a limit of the force");
    let mut hand = pressing.clone();
    for n in 0..(0.6 / p.period_s) as usize {
        let output = hand.tick(scene, 0.0, |input, _| {
            let change =
                ParameterChange { parameter: LiveParameter::ForceLimit, value: range.least };
            input.parameter_change = (n == 0).then_some(change);
        });
        let share = (1.0 - n as f64 * p.period_s / 0.5).max(0.0);
        let most_n = range.least + share * (range.most - range.least);
        let force_n = output.command_device.force.length();
        assert!(force_n <= most_n * (1.0 + 1e-9), "{force_n} of {most_n} N in tick {n}\n{about}");
    }
}

#[test]
fn no_key_that_check_accepts_delays_a_fall() {
    let keys = keys();
    let slew = keys.iter().find(|key| key.name == "slew_n_per_s").expect("a slew limit");
    assert!((slew.range[0] - 120.0).abs() < 0.1, "the search finds the bounds: {:?}", slew.range);
    let mut random = Random(39);
    let (prepared, _) =
        prepare(&load(&text("implicit", 1000, &[])).expect("a scene"), |_| ()).expect("baked");
    let mut scene = prepared.scene;
    let mut n_scenes = 0;
    let mut n_with_force = 0;
    let mut n_half_way = 0;
    let mut n_free = 0;
    while n_scenes < N_SCENES {
        let mode = MODES[(random.unit() * MODES.len() as f64) as usize];
        let rate_hz = RATES_HZ[(random.unit() * RATES_HZ.len() as f64) as usize];
        let chosen: Vec<_> = keys
            .iter()
            .filter_map(|Key { table, name, range: [low, high] }| {
                let value = match (random.unit() * 8.0) as usize {
                    0 => *low,
                    1 => *high,
                    2 => low * (high / low).powf(random.unit()),
                    _ => return None,
                };
                Some((*table, name.as_str(), value))
            })
            .collect();
        let about = text(mode, rate_hz, &chosen);
        let Some(config) = load(&about) else { continue };
        n_scenes += 1;
        scene.parameters = config.parameters;
        let mut hand = Hand::new(&scene);
        hand.enable(&scene, 0.5);
        let mut early = hand.clone();
        hand.enable(&scene, 1.0);
        for (hand, n) in [(&mut hand, &mut n_with_force), (&mut early, &mut n_half_way)] {
            let Some(force_n) = hand.press(&scene) else { continue };
            *n += usize::from(force_n > 0.01 * scene.parameters.limits.force_n);
            assert_off(&mut scene, hand, &about);
            n_free += usize::from(assert_free(&scene, hand, &about));
            assert_lowered(&scene, hand, &about);
        }
    }
    let enough = N_SCENES / 3;
    assert!(
        n_with_force > enough && n_half_way > enough && n_free > enough,
        "{n_with_force} with force, {n_half_way} half way, {n_free} free"
    );
}
