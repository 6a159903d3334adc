//! What viewers show beside the ticks, in Foxglove's own messages: the parts, the tool's frame,
//! faults.

use std::path::Path;
use std::time::SystemTime;

use glam::DVec3;

use super::foxglove::{
    self, Color, CubePrimitive, CylinderPrimitive, FrameTransform, KeyValuePair, Log,
    ModelPrimitive, SceneEntity, SceneEntityDeletion, SceneUpdate, SpherePrimitive,
};
use super::scene_files::{DisplayObject, DisplayShape, SceneFiles};
use super::wire::{self, Quaternion, Timestamp, Vector3, WirePart as _};
use crate::TickRecord;
use crate::stamped_record::StampedRecord;
use haptics::Faults;
use vps::spatial::Pose;
use vps::storage::regular;

/// A topic whose messages come on occasion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Occasion {
    /// Faults appear, change or are acknowledged.
    Faults,
    /// A scene begins.
    Scene,
    /// It is time to tell where the tool's frame is.
    Frame,
}

impl Occasion {
    pub(super) const ALL: [Self; 3] = [Self::Faults, Self::Scene, Self::Frame];

    pub(super) const fn topic(self) -> &'static str {
        match self {
            Self::Faults => "/faults",
            Self::Scene => "/scene",
            Self::Frame => "/tf",
        }
    }

    /// Name and bytes of the schema.
    pub(super) fn schema(self) -> (String, Vec<u8>) {
        let (name, schema) = match self {
            Self::Faults => ("foxglove.Log", foxglove::LOG),
            Self::Scene => ("foxglove.SceneUpdate", foxglove::SCENE_UPDATE),
            Self::Frame => ("foxglove.FrameTransform", foxglove::FRAME_TRANSFORM),
        };
        (name.to_owned(), schema.to_owned())
    }
}

/// What time the messages of a run bear.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stamps {
    /// What a stamp is at loop time zero, ns: of the simulated clock, that the caller has reported,
    /// or else as the first row is made.
    zero_ns: Option<u64>,
}

impl Stamps {
    pub(super) fn new(is_virtual: bool) -> Self {
        Self { zero_ns: is_virtual.then_some(0) }
    }

    /// Notes what the wall clock showed at loop time zero ([`zero_ns`]). Counts before the first
    /// row, and not under the virtual clock.
    pub(super) fn begin_at(&mut self, zero_ns: u64) {
        self.zero_ns.get_or_insert(zero_ns);
    }

    pub(super) fn row(&mut self, record: &TickRecord, dropped: u64) -> StampedRecord {
        let time_ns = record.time_ns.max(0).unsigned_abs();
        let zero_ns = *self.zero_ns.get_or_insert_with(|| zero_ns(record));
        StampedRecord { record: *record, dropped, stamp_ns: zero_ns + time_ns }
    }
}

/// What the wall clock showed at loop time zero, ns since 1970, when this record comes just now.
pub(super) fn zero_ns(now: &TickRecord) -> u64 {
    let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
    u64::try_from(since.as_nanos())
        .unwrap_or(u64::MAX)
        .saturating_sub(now.time_ns.max(0).unsigned_abs())
}

/// `/tf`: where the tool's frame is.
pub(super) fn frame(row: &StampedRecord) -> FrameTransform {
    let pose = row.record.output.world_from_tool;
    FrameTransform {
        timestamp: Timestamp::of(row.stamp_ns),
        parent_frame_id: "world".to_owned(),
        child_frame_id: "tool".to_owned(),
        translation: Vector3::of(&pose.translation),
        rotation: Quaternion::of(&pose.rotation),
    }
}

/// `/faults`: those of a tick, in words.
pub(super) fn faults(row: &StampedRecord) -> Log {
    let faults = row.record.output.faults;
    let reported = Faults::TABLE.into_iter().filter(|(fault, ..)| faults.contains(*fault));
    let message =
        reported.map(|(_, name, words)| format!("{name}: {words}")).collect::<Vec<_>>().join("; ");
    let (level, message) = if faults.is_empty() {
        (foxglove::LEVEL_INFO, "faults acknowledged".to_owned())
    } else {
        (foxglove::LEVEL_ERROR, message)
    };
    Log { timestamp: Timestamp::of(row.stamp_ns), level, message, name: "hapticd".to_owned() }
}

/// `/scene`: the parts, from a time on, in place of those before. Reads mesh files, so many bytes
/// in all.
pub(super) fn scene_update(
    scene: &SceneFiles,
    scene_idx: u32,
    stamp_ns: u64,
    most_bytes: u64,
) -> SceneUpdate {
    let timestamp = Timestamp::of(stamp_ns);
    let before = SceneEntityDeletion { timestamp: timestamp.clone(), kind: foxglove::DELETE_ALL };
    let mut left_bytes = most_bytes;
    let with_time = |shown: &DisplayObject| SceneEntity {
        timestamp: timestamp.clone(),
        ..entity(shown, scene, scene_idx, &mut left_bytes)
    };
    let entities = scene.shown.iter().map(with_time).collect();
    SceneUpdate { deletions: if scene_idx == 0 { Vec::new() } else { vec![before] }, entities }
}

/// What viewers show of an object; its mesh file if it fits.
fn entity(
    shown: &DisplayObject,
    scene: &SceneFiles,
    scene_idx: u32,
    left_bytes: &mut u64,
) -> SceneEntity {
    let (frame_id, origin) =
        if shown.is_tool { ("tool", Pose::IDENTITY) } else { ("world", shown.pose) };
    let at = |middle: [f64; 3]| wire::Pose::of(&(origin * Pose::from_translation(middle.into())));
    let color = if shown.is_tool { TOOL_COLOR } else { STATIC_COLOR };
    let pair = |key: &str, value: String| KeyValuePair { key: key.to_owned(), value };
    let mut entity = SceneEntity {
        frame_id: frame_id.to_owned(),
        id: shown.name.clone(),
        // The tool goes where its frame goes.
        frame_locked: true,
        metadata: vec![pair("scene", scene.name.clone()), pair("scene_idx", scene_idx.to_string())],
        ..SceneEntity::default()
    };
    match &shown.form {
        DisplayShape::Box([x, y, z], middle) => {
            entity.cubes.push(CubePrimitive { pose: at(*middle), size: size(*x, *y, *z), color });
        }
        DisplayShape::Ellipsoid([x, y, z]) => {
            let size = size(2.0 * x, 2.0 * y, 2.0 * z);
            entity.spheres.push(SpherePrimitive { pose: at([0.0; 3]), size, color });
        }
        DisplayShape::Cylinder(radius_m, top_scale, height_m) => {
            let size = size(2.0 * radius_m, 2.0 * radius_m, *height_m);
            entity.cylinders.push(CylinderPrimitive {
                pose: at([0.0; 3]),
                size,
                bottom_scale: 1.0,
                top_scale: *top_scale,
                color,
            });
        }
        DisplayShape::Mesh(path, metres_per_unit) => {
            let ending = path.extension().map(|ending| ending.to_string_lossy().to_lowercase());
            let media_type = match ending.as_deref() {
                Some("stl") => "model/stl",
                Some("obj") => "model/obj",
                Some("glb") => "model/gltf-binary",
                _ => return entity,
            };
            if let Some(data) = contents(path, left_bytes) {
                entity.models.push(ModelPrimitive {
                    pose: at([0.0; 3]),
                    scale: Vector3::of(&DVec3::splat(*metres_per_unit)),
                    color,
                    override_color: true,
                    media_type: media_type.to_owned(),
                    data,
                });
            }
        }
        DisplayShape::Other => {}
    }
    entity
}

/// A file that fits, and what is left of the limit.
fn contents(path: &Path, left_bytes: &mut u64) -> Option<Vec<u8>> {
    let data = regular::bytes(path, *left_bytes).ok()?;
    *left_bytes -= data.len() as u64;
    Some(data)
}

const STATIC_COLOR: Color = Color { r: 0.6, g: 0.65, b: 0.7, a: 1.0 };
const TOOL_COLOR: Color = Color { r: 0.95, g: 0.6, b: 0.2, a: 1.0 };

fn size(x: f64, y: f64, z: f64) -> Vector3 {
    Vector3::of(&DVec3::new(x, y, z))
}
