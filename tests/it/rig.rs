//! Runs a scene the way `hapticd run --clock virtual` does, and keeps every record.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use arms::simulated::hand::HandPath;
use engine::servo::{CommandQueue, Control, Ending, ObjectPaths, RunPlan, ServoLoop, Step};
use hapticd::config::{self, SceneConfig};
use hapticd::daemon::prepare_with;
use hapticd::scene::cache::Cache;
use hapticd::scene::{BakeOptions, ObjectReport};
use haptics::{Faults, Parameters, RenderScene};
use recording::TickRecord;
use rt::clock::VirtualClock;
use vps::mesh::{TriangleMesh, validate};
use vps::spatial::{Pose, Wrench};
use vps::voxmap::inside_test::InsideTest;
use vps::voxmap::{Options, Volume};

/// One tick may round a limit up by this share.
const ROUNDING: f64 = 1.0 + 1e-12;

/// The volume of a mesh.
pub(crate) fn volume(mesh: &TriangleMesh, voxel_size_m: f64, layers: u32) -> Volume {
    let options = Options { voxel_size_m, layers, navigation: None, sides: InsideTest::Auto };
    Volume::build(mesh, &validate::inspect(mesh), &options, |_| ()).expect("a grid that fits")
}

/// Parameters of a virtual tool in an implicit coupling, every limit out of the way.
pub(crate) fn unlimited() -> Parameters {
    Parameters::unlimited(1e-3)
}

/// A shipped scene's file.
pub(crate) fn shipped(name: &str) -> PathBuf {
    folder_of_scenes().join(name).with_extension("toml")
}

/// Where the shipped scenes are.
pub(crate) fn folder_of_scenes() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("config/scenes")
}

/// Reads and checks a scene.
pub(crate) fn load(path: &Path) -> SceneConfig {
    config::load(path).unwrap_or_else(|errors| panic!("{}: {errors}", path.display()))
}

/// A shipped scene with parts of its text replaced, its relative paths made absolute.
pub(crate) fn rewritten(name: &str, replacements: &[(&str, &str)]) -> SceneConfig {
    let mut text = std::fs::read_to_string(shipped(name)).expect("a shipped scene");
    let config_folder = folder_of_scenes().parent().expect("a parent").to_owned();
    let absolute = |part: &str| format!("\"{}/", config_folder.join(part).display());
    for (from, to) in replacements {
        assert!(text.contains(from), "{name} has no `{from}`");
        text = text.replace(from, to);
    }
    text = text
        .replace("\"../models/", &absolute("models"))
        .replace("\"hands/", &absolute("scenes/hands"));
    written(&text)
}

/// Loads a scene that is only text.
pub(crate) fn written(text: &str) -> SceneConfig {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("scene.toml");
    std::fs::write(&path, text).expect("written");
    load(&path)
}

/// When the hand of a scene comes to its last pose, s.
pub(crate) fn hand_end_s(config: &SceneConfig) -> f64 {
    let path = config.device.hand.as_deref().expect("a hand");
    let text = std::fs::read_to_string(path).expect("a hand file");
    let last = text.lines().rfind(|line| !line.trim().is_empty()).expect("lines");
    last.split(',').next().and_then(|time| time.parse().ok()).expect("a time")
}

/// What a run left behind.
pub(crate) struct Run {
    pub(crate) scene: Arc<RenderScene>,
    pub(crate) reports: Vec<ObjectReport>,
    pub(crate) records: Vec<TickRecord>,
    /// The tick in which the ramp-down began.
    pub(crate) stop_at_tick: usize,
    faults: Faults,
    ending: Ending,
}

/// The hand's full length and a second more, then the safe stop.
pub(crate) fn run(config: &SceneConfig) -> Run {
    let n_ticks = ((hand_end_s(config) + 1.0) / config.parameters.period_s).round() as u64;
    run_ticks(config, n_ticks)
}

/// So many ticks, then the safe stop.
pub(crate) fn run_ticks(config: &SceneConfig, n_ticks: u64) -> Run {
    run_ticks_with(config, &mut Cache::off(), n_ticks)
}

/// The hand's full length and a second more, while objects follow their paths.
pub(crate) fn run_moving<const N: usize>(
    config: &SceneConfig,
    paths: [(&str, HandPath); N],
) -> Run {
    let n_ticks = ((hand_end_s(config) + 1.0) / config.parameters.period_s).round() as u64;
    let objects: Vec<(String, bool)> =
        config.statics.iter().map(|object| (object.name.clone(), object.movable)).collect();
    let paths = paths.map(|(name, path)| (name.to_owned(), path));
    run_along(
        config,
        &mut Cache::off(),
        n_ticks,
        ObjectPaths::new(&objects, paths).expect("movable"),
    )
}

/// The same, with a bake cache.
pub(crate) fn run_ticks_with(config: &SceneConfig, cache: &mut Cache, n_ticks: u64) -> Run {
    run_along(config, cache, n_ticks, ObjectPaths::default())
}

fn run_along(config: &SceneConfig, cache: &mut Cache, n_ticks: u64, paths: ObjectPaths) -> Run {
    let (prepared, reports) = prepare_with(config, &mut BakeOptions::from(cache), |_| ())
        .unwrap_or_else(|error| panic!("{error}"));
    let scene = Arc::new(prepared.scene);
    // Capacity for all: the virtual clock waits for a drain, and nothing drains here before the
    // end.
    let (producer, mut consumer) = rtrb::RingBuffer::new(n_ticks as usize + 2000);
    let control = Arc::new(Control::enabled());
    let plan = RunPlan { stop_at_tick: Some(n_ticks), ..RunPlan::default() };
    let mut servo = ServoLoop::new(
        scene.clone(),
        prepared.device,
        VirtualClock::default(),
        control,
        plan,
        producer,
    )
    .with_commands(CommandQueue::default().with_paths(paths));
    servo.warm_up();
    while servo.step() == Step::Continue {}
    let report = servo.finish();
    assert_eq!((report.dropped_records, report.missed_deadlines, report.packet_errors), (0, 0, 0));
    let mut records = Vec::with_capacity(report.ticks as usize);
    while let Ok(record) = consumer.pop() {
        records.push(record);
    }
    assert_eq!(records.len() as u64, report.ticks);
    Run {
        scene,
        reports,
        records,
        stop_at_tick: n_ticks as usize,
        faults: report.faults,
        ending: report.ending,
    }
}

fn bits(wrench: Wrench) -> [u64; 6] {
    let ([a, b, c], [d, e, f]) = (wrench.force.to_array(), wrench.torque.to_array());
    [a, b, c, d, e, f].map(f64::to_bits)
}

/// True when every component is +0.
pub(crate) fn is_bit_zero(wrench: Wrench) -> bool {
    bits(wrench) == [0; 6]
}

impl Run {
    /// The last tick before the ramp-down.
    pub(crate) fn at_end(&self) -> &TickRecord {
        &self.records[self.stop_at_tick - 1]
    }

    /// Where the tool stood then.
    pub(crate) fn final_pose(&self) -> Pose {
        self.at_end().output.world_from_tool
    }

    /// Deepest point of the whole run, m.
    pub(crate) fn max_depth_m(&self) -> f64 {
        self.records.iter().map(|record| record.output.max_depth_m).fold(0.0, f64::max)
    }

    /// Says what happened, for `--nocapture`.
    pub(crate) fn tell(&self, name: &str) {
        let pose = self.final_pose();
        let (axis, turn) = pose.rotation.to_axis_angle();
        let deepest = self
            .records
            .iter()
            .max_by(|a, b| a.output.max_depth_m.total_cmp(&b.output.max_depth_m))
            .expect("records");
        let touching = self.records.iter().filter(|record| record.output.contacts > 0).count();
        let force = |record: &TickRecord| record.output.commanded_device.force.length();
        let strongest = self.records.iter().map(force).fold(0.0, f64::max);
        eprintln!(
            "{name}: {} points, {} ticks, {touching} in contact; deepest {:.4} mm at tick {}; \
                largest command {strongest:.2} N; end [{:.4}] mm, {:.3}° about {axis:.2}",
            self.scene.tool.shell.len(),
            self.records.len(),
            deepest.output.max_depth_m * 1e3,
            deepest.tick,
            pose.translation * 1e3,
            turn.to_degrees(),
        );
    }

    /// What holds in every run without an injected fault, in every tick:
    ///
    /// - no faults, an ending at rest, some contact, every number finite;
    /// - |F| and |τ| of the command within the limits;
    /// - the contact wrench is +0 to the bit whenever no point has V > 0;
    /// - the command is +0 to the bit in free space, from the tick on by which the slew limit can
    ///   have brought the last command in contact down to zero;
    /// - no point is ever as deep as one voxel of the finest static object: nothing went through.
    pub(crate) fn assert_sound(&self, name: &str) {
        self.tell(name);
        assert_eq!((self.faults, self.ending), (Faults::NONE, Ending::Stopped), "{name}");
        let limits = self.scene.parameters.limits;
        let period_s = self.scene.parameters.period_s;
        let slew_ticks = |command: Wrench| {
            let ticks = |length: f64, slew: f64| (length / (slew * period_s)).ceil() as u64;
            // One more for the rounding of n equal steps.
            1 + ticks(command.force.length(), limits.slew_n_per_s)
                .max(ticks(command.torque.length(), limits.slew_nm_per_s))
        };
        let mut zero_from_tick = 0;
        for record in &self.records {
            let tick = record.tick;
            let input = &record.input;
            let output = &record.output;
            let command = output.commanded_device;
            let numbers = [output.max_depth_m, output.clearance_m, output.energy_j];
            assert!(
                command.is_finite()
                    && output.command_device.is_finite()
                    && output.contact_world.is_finite()
                    && output.world_from_tool.is_finite()
                    && numbers.iter().all(|number| number.is_finite())
                    && input.sample.pose.is_finite()
                    && input.sample.twist.is_finite(),
                "{name}, tick {tick}: {output:?}"
            );
            assert!(
                command.force.length() <= limits.force_n * ROUNDING,
                "{name}, tick {tick}: {command:?}"
            );
            assert!(
                command.torque.length() <= limits.torque_nm * ROUNDING,
                "{name}, tick {tick}: {command:?}"
            );
            if output.contacts > 0 {
                zero_from_tick = tick + slew_ticks(command);
                // A step that ends out of contact has found it at its start.
                assert!(
                    output.max_depth_m > 0.0 || output.contact_world.force.length() < 1e-3,
                    "{name}, tick {tick}: {:?}",
                    output.contact_world
                );
            } else {
                assert!(
                    is_bit_zero(output.contact_world),
                    "{name}, tick {tick}: {:?}",
                    output.contact_world
                );
                assert!(
                    output.max_depth_m == 0.0 && output.clearance_m >= 0.0,
                    "{name}, tick {tick}"
                );
                assert!(
                    tick < zero_from_tick || is_bit_zero(command),
                    "{name}, tick {tick}: {command:?} in free space"
                );
            }
        }
        assert!(
            self.records.iter().any(|record| record.output.contacts > 0),
            "{name}: nothing was touched"
        );
        let finest_m = self
            .scene
            .obstacles
            .iter()
            .map(|obstacle| f64::from(obstacle.field.voxel_size_m()))
            .fold(f64::INFINITY, f64::min);
        assert!(self.max_depth_m() < finest_m, "{name}: {} mm deep", self.max_depth_m() * 1e3);
        let last = self.records.last().expect("records");
        assert!(is_bit_zero(last.output.command_device), "{name}: at rest");
    }
}
