//! Runs what a recording says entered the ticks through the scene that it brings along, and
//! compares what leaves them bit for bit.

use std::fmt::{Display, Formatter};
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::unpacked::{RecordedScene, UnpackError, Unpacked};
use crate::config::SceneConfig;
use crate::scene::SceneError;
use haptics::{self, Drive, Faults, OffCause, Placement, RenderScene, State, TickOutput};
use recording::TickRecord;
use recording::file::{Entry, FORCE_LAW_KEY, ReadError, Recording};
use vps::contact::Budget;
use vps::spatial::{Pose, Wrench};

/// Why a recording cannot be run again, or no further.
#[derive(Debug, thiserror::Error)]
pub enum ReplayError {
    /// The file.
    #[error("{0}")]
    Read(#[from] ReadError),
    /// What it brings along.
    #[error("{0}")]
    Unpack(#[from] UnpackError),
    /// Its scene.
    #[error("{0}")]
    Scene(#[from] SceneError),
    /// What came before is unknown, and with it the state of the tick.
    #[error("the recording begins with tick {0}, not with the first one of the run")]
    BeganLate(u64),
    /// What was touched is not in the recording.
    #[error("tick {tick} touched clay, whose frames are not recorded: it cannot be run again")]
    Clay {
        /// The first such tick.
        tick: u64,
    },
    /// Other forces come out for the same input by now.
    #[error(
        "it was recorded by {program} with {}; this is hapticd {} with force law {}: the same \
            input gives other forces, and no bit could be compared",
        law.as_ref().map_or_else(|| "the first force law, which has no number".to_owned(), |law| format!("force law {law}")),
        env!("CARGO_PKG_VERSION"),
        haptics::FORCE_LAW
    )]
    OtherForceLaw {
        /// Which program wrote it.
        program: String,
        /// Its number, where it wrote one.
        law: Option<String>,
    },
    /// There is nothing in it.
    #[error("{} ends before its first tick", file.display())]
    Empty {
        /// Which.
        file: PathBuf,
    },
}

/// What came of a replay.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Replayed {
    /// Ticks that were run and came out the same.
    pub ticks: u64,
    /// Scenes that they took place in.
    pub scenes: u32,
    /// The file has an end; without one its recorder was killed.
    pub whole: bool,
    /// Ticks are missing: the replay ended here.
    pub gap: Option<Gap>,
    /// Where it came out in another way: the replay ended here.
    pub difference: Option<Difference>,
    /// Values of the scene that this version resolves in another way.
    pub changed: Vec<String>,
}

/// Missing ticks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Gap {
    /// The first one that is missing.
    pub first_missing: u64,
    /// The next one that is there.
    pub next: u64,
}

/// The first value that came out in another way.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Difference {
    /// Tick.
    pub tick: u64,
    /// Number of the scene.
    pub scene_idx: u32,
    /// Which value of the tick's output.
    pub field: String,
    /// As it was.
    pub recorded: String,
    /// As it is now.
    pub replayed: String,
}

impl Replayed {
    /// Every tick of the recording came out the same.
    pub fn is_identical(&self) -> bool {
        self.gap.is_none() && self.difference.is_none()
    }
}

/// Runs a recording again. `bake` makes a scene ready in a way that the caller chooses.
///
/// # Errors
/// See [`ReplayError`]; ticks that came out in another way are no error, they are in the result.
pub fn replay(
    path: &Path,
    mut bake: impl FnMut(&SceneConfig) -> Result<RenderScene, SceneError>,
) -> Result<Replayed, ReplayError> {
    let mut recording = Recording::open(path)?;
    let mut unpacked = Unpacked::new()?;
    let mut replayed = Replayed::default();
    let mut rendered: Option<ReplayedScene> = None;
    while let Some(entry) = recording.next_entry()? {
        let record = match entry {
            Entry::Attachment { name, data } => {
                unpacked.put(&name, &data)?;
                continue;
            }
            Entry::Metadata { name, values } => {
                unpacked.note(name, values);
                continue;
            }
            Entry::Tick { record, .. } => record,
        };
        let due = replayed.ticks;
        if rendered.is_none() && (record.tick, record.scene_idx) != (0, 0) {
            return Err(ReplayError::BeganLate(record.tick));
        }
        if rendered.is_none() {
            same_force_law(&unpacked)?;
        }
        if record.input.clay.is_some() {
            return Err(ReplayError::Clay { tick: record.tick });
        }
        if record.tick != due {
            replayed.gap = Some(Gap { first_missing: due, next: record.tick });
            break;
        }
        let current = match rendered.take() {
            Some(rendered) if rendered.scene_idx == record.scene_idx => rendered,
            before => {
                let RecordedScene { config, changed, starts_anew } =
                    unpacked.scene(record.scene_idx)?;
                replayed.changed.extend(changed);
                replayed.scenes += 1;
                ReplayedScene::new(bake(&config)?, &record, before.as_ref(), starts_anew)
            }
        };
        let current = rendered.insert(current);
        let output = haptics::tick(&current.scene, &mut current.state, &record.input);
        current.last = output;
        if let Some((field, recorded, now)) = first_difference(&record.output, &output) {
            replayed.difference = Some(Difference {
                tick: record.tick,
                scene_idx: record.scene_idx,
                field,
                recorded,
                replayed: now,
            });
            break;
        }
        replayed.ticks += 1;
    }
    if rendered.is_none() {
        return Err(ReplayError::Empty { file: path.to_owned() });
    }
    replayed.whole = recording.is_whole();
    Ok(replayed)
}

/// Refuses a recording whose forces were made by another law.
fn same_force_law(unpacked: &Unpacked) -> Result<(), ReplayError> {
    let law = unpacked.fact(FORCE_LAW_KEY);
    if law.is_some_and(|law| law == haptics::FORCE_LAW.to_string()) {
        return Ok(());
    }
    let program =
        unpacked.fact("program").unwrap_or("a program that does not name itself").to_owned();
    Err(ReplayError::OtherForceLaw { program, law: law.map(str::to_owned) })
}

/// A scene with the state of its ticks.
struct ReplayedScene {
    scene_idx: u32,
    scene: RenderScene,
    state: State,
    last: TickOutput,
}

impl ReplayedScene {
    /// As the loop makes one ready: the first one, or one that takes the place of another.
    fn new(
        scene: RenderScene,
        first: &TickRecord,
        before: Option<&Self>,
        starts_anew: bool,
    ) -> Self {
        let mut state = State::new(&scene);
        state.set_budget(first.contact_budget_points.map_or(Budget::Unlimited, Budget::Points));
        if let Some(before) = before {
            let stays = (!starts_anew).then_some(before.last.world_from_tool);
            state.resume_at(&scene, stays, before.state.handover());
        }
        Self { scene_idx: first.scene_idx, scene, state, last: TickOutput::default() }
    }
}

/// A value of an output.
#[derive(Clone, Copy)]
enum Value {
    Number(f64),
    Whole(u64),
    Flag(bool),
    Drive(Drive),
    Faults(Faults),
    Cause(OffCause),
    Object(Option<u32>),
}

impl Value {
    fn same(self, other: Self) -> bool {
        match (self, other) {
            // Bits: minus zero is not zero, and a NaN is itself.
            (Self::Number(a), Self::Number(b)) => a.to_bits() == b.to_bits(),
            (Self::Whole(a), Self::Whole(b)) => a == b,
            (Self::Flag(a), Self::Flag(b)) => a == b,
            (Self::Drive(a), Self::Drive(b)) => a == b,
            (Self::Faults(a), Self::Faults(b)) => a == b,
            (Self::Cause(a), Self::Cause(b)) => a == b,
            (Self::Object(a), Self::Object(b)) => a == b,
            _ => false,
        }
    }
}

impl Display for Value {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Number(number) => write!(f, "{number:?} (bits {:016x})", number.to_bits()),
            Self::Whole(number) => write!(f, "{number}"),
            Self::Flag(flag) => write!(f, "{flag}"),
            Self::Drive(drive) => write!(f, "{drive:?}"),
            Self::Faults(faults) => {
                write!(f, "[{}]", faults.names().collect::<Vec<_>>().join(", "))
            }
            Self::Cause(cause) => write!(f, "{}", cause.name()),
            Self::Object(Some(obstacle_idx)) => write!(f, "object {obstacle_idx}"),
            Self::Object(None) => write!(f, "none"),
        }
    }
}

/// Every value of an output with its name and component.
struct Values(Vec<(&'static str, &'static str, Value)>);

impl Values {
    fn of(output: &TickOutput) -> Self {
        // By name: a field that is added has to be compared.
        let TickOutput {
            command_device,
            commanded_device,
            contact_world,
            world_from_tool,
            contacts,
            max_depth_m,
            // It follows from the depth, and recordings of 0.1.0 do not have it.
            depth_is_bound: _,
            clearance_m,
            points_left_out,
            energy_j,
            object_work_j,
            objects_moving,
            object,
            passivity_active,
            delay_ticks,
            drive,
            faults,
            off_cause,
        } = *output;
        let mut values = Self(Vec::with_capacity(48));
        values.add("drive", Value::Drive(drive));
        values.add("faults", Value::Faults(faults));
        values.add("off_cause", Value::Cause(off_cause));
        values.pose("world_from_tool", world_from_tool);
        values.wrench("contact_world", contact_world);
        values.add("contacts", Value::Whole(contacts.into()));
        values.add("max_depth_m", Value::Number(max_depth_m));
        values.add("clearance_m", Value::Number(clearance_m));
        values.add("points_left_out", Value::Whole(points_left_out.into()));
        values.wrench("commanded_device", commanded_device);
        values.wrench("command_device", command_device);
        values.add("energy_j", Value::Number(energy_j));
        values.add("object_work_j", Value::Number(object_work_j));
        values.add("passivity_active", Value::Flag(passivity_active));
        values.add("delay_ticks", Value::Whole(delay_ticks.into()));
        values.add("objects_moving", Value::Whole(objects_moving.into()));
        values.add("object", Value::Object(object.map(|object| object.obstacle_idx)));
        let Placement { world_from_map, .. } = object.unwrap_or_default();
        values.pose("object", world_from_map);
        values
    }

    fn add(&mut self, name: &'static str, value: Value) {
        self.0.push((name, "", value));
    }

    fn components<const N: usize>(
        &mut self,
        name: &'static str,
        components: [&'static str; N],
        numbers: [f64; N],
    ) {
        self.0.extend(
            components
                .into_iter()
                .zip(numbers)
                .map(|(component, number)| (name, component, Value::Number(number))),
        );
    }

    fn wrench(&mut self, name: &'static str, wrench: Wrench) {
        self.components(name, [".force.x", ".force.y", ".force.z"], wrench.force.to_array());
        self.components(name, [".torque.x", ".torque.y", ".torque.z"], wrench.torque.to_array());
    }

    fn pose(&mut self, name: &'static str, pose: Pose) {
        self.components(
            name,
            [".translation.x", ".translation.y", ".translation.z"],
            pose.translation.to_array(),
        );
        self.components(
            name,
            [".rotation.x", ".rotation.y", ".rotation.z", ".rotation.w"],
            pose.rotation.to_array(),
        );
    }
}

/// Name and both values of the first one that differs.
fn first_difference(recorded: &TickOutput, now: &TickOutput) -> Option<(String, String, String)> {
    let recorded = Values::of(recorded);
    let now = Values::of(now);
    let mut pairs = recorded.0.into_iter().zip(now.0);
    let ((name, component, before), (.., after)) =
        pairs.find(|((.., before), (.., after))| !before.same(*after))?;
    Some((format!("{name}{component}"), before.to_string(), after.to_string()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_bit_counts_and_the_first_difference_is_named() {
        let output = TickOutput { energy_j: f64::NAN, ..TickOutput::default() };
        assert_eq!(first_difference(&output, &output), None);
        let minus = TickOutput { max_depth_m: -0.0, ..output };
        let (field, before, after) = first_difference(&output, &minus).expect("a difference");
        assert_eq!(
            (field.as_str(), before.as_str()),
            ("max_depth_m", "0.0 (bits 0000000000000000)")
        );
        assert!(after.starts_with("-0.0"), "{after}");
        let mut moved = minus;
        moved.world_from_tool.rotation.w = 0.5;
        moved.object = Some(Placement::default());
        assert_eq!(
            first_difference(&output, &moved).expect("a difference").0,
            "world_from_tool.rotation.w"
        );
        let object = TickOutput { object: Some(Placement::default()), ..output };
        assert_eq!(first_difference(&output, &object).expect("a difference").0, "object");
    }
}
