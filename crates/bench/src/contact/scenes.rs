//! Scene files with some keys changed, played on the virtual clock with every record kept.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use toml::{Table, Value};

use super::super::BenchError;
use document::poses;
use engine::servo::{Control, RunPlan, ServoLoop, run_to_end};
use hapticd::config::{self, SceneConfig};
use hapticd::daemon::prepare_with;
use hapticd::scene::BakeOptions;
use hapticd::scene::cache::Cache;
use haptics::{Faults, RenderScene};
use recording::TickRecord;
use rt::clock::VirtualClock;

/// A key, dotted, and what it is set to; in each of them where there are several tables of that
/// name.
pub(super) type Edit = (&'static str, Value);

/// The scene files of a folder, by name; none where there is no such folder.
pub(super) fn shipped(folder: &Path) -> Vec<PathBuf> {
    let entries =
        std::fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
    let mut scenes: Vec<PathBuf> = entries
        .filter(|path| path.extension().is_some_and(|extension| extension == "toml"))
        .collect();
    scenes.sort();
    scenes
}

/// The name of a scene's file.
pub(super) fn name(scene: &Path) -> String {
    scene.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

/// Reads a scene with some of its keys changed. The text in between is left in `folder`. A refusal
/// is said in one line.
pub(super) fn load(scene: &Path, edits: &[Edit], folder: &Path) -> Result<SceneConfig, String> {
    let text =
        std::fs::read_to_string(scene).map_err(|error| format!("{}: {error}", scene.display()))?;
    let mut table: Table = text.parse().map_err(|error| format!("{}: {error}", scene.display()))?;
    let home = scene
        .parent()
        .unwrap_or(Path::new(""))
        .canonicalize()
        .map_err(|error| error.to_string())?;
    // The changed file lies elsewhere.
    let absolute = |value: &mut Value| {
        if let Some(path) = value.as_str() {
            *value = home.join(path).to_string_lossy().into_owned().into();
        }
    };
    let statics = table.get_mut("static").and_then(Value::as_array_mut);
    statics.into_iter().flatten().filter_map(|object| object.get_mut("mesh")).for_each(absolute);
    for (key, path) in [("tool", "mesh"), ("device", "hand")] {
        table.get_mut(key).and_then(|owner| owner.get_mut(path)).into_iter().for_each(absolute);
    }
    for (key, value) in edits {
        set(&mut table, key, value.clone());
    }
    let changed = folder.join("scene.toml");
    std::fs::write(&changed, table.to_string())
        .map_err(|error| format!("{}: {error}", changed.display()))?;
    config::load(&changed).map_err(|errors| one_line(&errors.to_string(), &changed))
}

fn set(table: &mut Table, key: &str, value: Value) {
    match key.split_once('.') {
        None => drop(table.insert(key.to_owned(), value)),
        Some((first, rest)) => match table.entry(first).or_insert_with(|| Table::new().into()) {
            Value::Table(inner) => set(inner, rest, value),
            Value::Array(tables) => tables
                .iter_mut()
                .filter_map(Value::as_table_mut)
                .for_each(|inner| set(inner, rest, value.clone())),
            _ => {}
        },
    }
}

/// The first problem, without the name of a file that is gone soon.
fn one_line(errors: &str, file: &Path) -> String {
    let first = errors.lines().find(|line| !line.trim().is_empty()).unwrap_or_default();
    let first = first.trim().trim_start_matches("error: ");
    first
        .trim_start_matches(&file.display().to_string())
        .trim_start_matches(|c: char| c == ':' || c == ' ' || c.is_ascii_digit())
        .to_owned()
}

/// What a scene did.
pub(super) struct Played {
    pub(super) scene: Arc<RenderScene>,
    /// Every tick, the last of them at rest again.
    pub(super) records: Vec<TickRecord>,
    /// The tick in which the ramp-down began.
    pub(super) stop_at_tick: usize,
    pub(super) faults: Faults,
}

impl Played {
    /// The ticks before the ramp-down.
    pub(super) fn before_stop(&self) -> &[TickRecord] {
        &self.records[..self.stop_at_tick.min(self.records.len())]
    }
}

/// Plays a scene to the end of its hand and a second more, but no longer than `longest_s`, on the
/// virtual clock.
pub(super) fn play(
    config: &SceneConfig,
    cache: &mut Cache,
    longest_s: f64,
) -> Result<Played, BenchError> {
    let failed = |why: String| BenchError::Prepare { what: config.name.clone(), why };
    let hand = config
        .device
        .hand
        .as_deref()
        .map(poses::read)
        .transpose()
        .map_err(|error| failed(error.to_string()))?;
    let hand_s = hand.and_then(|poses| poses.last().map(|pose| pose.time_s)).unwrap_or_default();
    let n_ticks = ((hand_s + 1.0).min(longest_s) / config.parameters.period_s).round() as u64;
    let (prepared, _) = prepare_with(config, &mut BakeOptions::from(cache), |_| ())
        .map_err(|error| failed(error.to_string()))?;
    let scene = Arc::new(prepared.scene);
    // Capacity for all: the virtual clock waits for a drain, and nothing drains here before the
    // end.
    let (producer, mut consumer) = rtrb::RingBuffer::new(n_ticks as usize + 2000);
    let control = Arc::new(Control::enabled());
    let plan = RunPlan { stop_at_tick: Some(n_ticks), ..RunPlan::default() };
    let servo = ServoLoop::new(
        scene.clone(),
        prepared.device,
        VirtualClock::default(),
        control,
        plan,
        producer,
    );
    let report = run_to_end(servo);
    let mut records = Vec::with_capacity(report.ticks as usize);
    while let Ok(record) = consumer.pop() {
        records.push(record);
    }
    Ok(Played { scene, records, stop_at_tick: n_ticks as usize, faults: report.faults })
}

#[cfg(test)]
mod tests {
    use super::*;
    use haptics::CouplingMode;
    use vps::voxmap::field::FieldKind;

    #[test]
    fn keys_are_changed_and_paths_still_lead_to_the_files() {
        let scenes = shipped(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/scenes"));
        assert!(scenes.len() >= 4);
        let folder = tempfile::tempdir().unwrap();
        for scene in &scenes {
            let edits =
                [("rendering.coupling", "constraint".into()), ("rendering.field", "layers".into())];
            let config = load(scene, &edits, folder.path()).unwrap();
            assert_eq!(config.parameters.coupling.mode, CouplingMode::Constraint);
            assert_eq!(config.parameters.contact.field, FieldKind::Layers);
        }
        let refused =
            load(&scenes[0], &[("rendering.coupling", "magic".into())], folder.path()).unwrap_err();
        assert!(refused.contains("magic") && !refused.contains('\n'), "{refused}");
        assert!(shipped(Path::new("no such folder")).is_empty());
    }
}
