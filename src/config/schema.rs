//! Second pass: the scene as it is written. Foreign units, nothing checked but names and types.
//!
//! Every key is optional here: what must be given is said by the third pass, in the words of the
//! scene. `docs` of the keys are in `config/default.toml`, which a test holds against these tables.

mod sculpt;

use schemars::JsonSchema;
use serde::Deserialize;
use serde::de::IgnoredAny;

use super::draft::Unit;
use document::{Numbers, words};
use haptics::{CouplingMode, FreeSpace, SpringClamp};
use vps::contact::Normalization;
use vps::pointshell::Points;
use vps::voxmap::field::FieldKind;
use vps::voxmap::inside_test::InsideTest;

#[cfg(test)]
pub(super) use self::sculpt::CraftWord;
pub(super) use self::sculpt::{
    Creep, Deed, FalloffRate, FalloffWritten, PaintedWritten, Sculpt, Stroke, Strokes,
    WrittenSolid, WrittenTool, holds_strokes,
};

/// The whole file.
#[derive(Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default, expecting = "a scene")]
pub(super) struct Scene {
    #[serde(rename = "version")]
    #[schemars(with = "u32", extend("const" = 1))]
    pub(super) _version: Option<IgnoredAny>,
    pub(super) name: Option<String>,
    pub(super) rendering: Rendering,
    #[serde(rename = "static")]
    pub(super) statics: Vec<Static>,
    pub(super) tool: Option<Tool>,
    pub(super) contact: Contact,
    pub(super) coupling: Coupling,
    pub(super) filter: Filter,
    pub(super) limits: Limits,
    pub(super) safety: Safety,
    pub(super) device: Device,
    pub(super) realtime: Realtime,
    pub(super) monitor: Monitor,
    pub(super) sculpt: Option<Sculpt>,
}

#[derive(Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default, expecting = "a table, written [rendering]")]
pub(super) struct Rendering {
    pub(super) rate_hz: Option<u32>,
    pub(super) coupling: Option<CouplingWord>,
    pub(super) field: Option<FieldWord>,
    pub(super) gravity_m_per_s2: Option<Numbers<3>>,
    pub(super) allow_unstable: Option<bool>,
}

#[derive(Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default, expecting = "a table, written [[static]]")]
pub(super) struct Static {
    pub(super) name: Option<String>,
    pub(super) mesh: Option<String>,
    pub(super) shape: Option<Shape>,
    pub(super) units: Option<UnitWord>,
    pub(super) voxel_size_mm: Option<f64>,
    pub(super) layers: Option<u32>,
    pub(super) position_mm: Option<Numbers<3>>,
    pub(super) orientation_xyzw: Option<Numbers<4>>,
    pub(super) movable: Option<bool>,
    pub(super) sides: Option<SidesWord>,
}

#[derive(Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default, expecting = "a table, written [tool]")]
pub(super) struct Tool {
    pub(super) mesh: Option<String>,
    pub(super) shape: Option<Shape>,
    pub(super) units: Option<UnitWord>,
    pub(super) voxel_size_mm: Option<f64>,
    pub(super) layers: Option<u32>,
    pub(super) sides: Option<SidesWord>,
    pub(super) points: Option<PointsWord>,
    pub(super) mass_g: Option<f64>,
    pub(super) center_of_mass_mm: Option<Numbers<3>>,
    pub(super) inertia_kg_mm2: Option<Numbers<6>>,
    pub(super) start_position_mm: Option<Numbers<3>>,
    pub(super) start_orientation_xyzw: Option<Numbers<4>>,
}

#[derive(Debug, Default, Deserialize, JsonSchema)]
#[serde(
    deny_unknown_fields,
    default,
    expecting = "a table with one shape, such as { box_mm = [60, 40, 10] } or { sphere_mm = 8 }"
)]
pub(super) struct Shape {
    pub(super) box_mm: Option<Numbers<3>>,
    pub(super) sphere_mm: Option<f64>,
    pub(super) ellipsoid_mm: Option<Numbers<3>>,
    pub(super) cylinder_mm: Option<Numbers<2>>,
    pub(super) cone_mm: Option<Numbers<2>>,
    pub(super) capsule_mm: Option<Numbers<2>>,
    pub(super) torus_mm: Option<Numbers<2>>,
    pub(super) plane_mm: Option<Numbers<2>>,
}

#[derive(Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default, expecting = "a table, written [contact]")]
pub(super) struct Contact {
    pub(super) stiffness_n_per_mm3: Option<f64>,
    // Of version 0.1.0: of one s² of the tool.
    #[schemars(extend("deprecated" = true))]
    pub(super) stiffness_n_per_mm: Option<f64>,
    pub(super) damping_ratio: Option<f64>,
    pub(super) normalize: Option<NormalizeWord>,
    pub(super) friction: Option<Friction>,
    pub(super) braking: Option<bool>,
    pub(super) damping_n_s_per_m: Option<f64>,
    pub(super) time_budget_us: Option<f64>,
}

#[derive(Debug, Default, Deserialize, JsonSchema)]
#[serde(
    deny_unknown_fields,
    default,
    expecting = "a table, written { static = 0.25, dynamic = 0.2 }"
)]
pub(super) struct Friction {
    #[serde(rename = "static")]
    pub(super) holding: Option<f64>,
    #[serde(rename = "dynamic")]
    pub(super) sliding: Option<f64>,
}

#[derive(Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default, expecting = "a table, written [coupling]")]
pub(super) struct Coupling {
    pub(super) translation_n_per_mm: Option<f64>,
    pub(super) rotation_nm_per_rad: Option<f64>,
    pub(super) damping_n_s_per_m: Option<f64>,
    pub(super) damping_nm_s_per_rad: Option<f64>,
    pub(super) clamp: Option<ClampWord>,
    pub(super) free_space: Option<FreeSpaceWord>,
}

#[derive(Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default, expecting = "a table, written [filter]")]
pub(super) struct Filter {
    pub(super) cutoff_hz: Option<Cutoff>,
}

#[derive(Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default, expecting = "a table, written [limits]")]
pub(super) struct Limits {
    pub(super) force_n: Option<f64>,
    pub(super) torque_nm: Option<f64>,
    pub(super) speed_mm_per_s: Option<f64>,
}

#[derive(Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default, expecting = "a table, written [safety]")]
pub(super) struct Safety {
    pub(super) ramp_ms: Option<f64>,
    pub(super) slew_n_per_s: Option<f64>,
    pub(super) power_w: Option<f64>,
    pub(super) overrun: Option<Overrun>,
    pub(super) stall_ms: Option<f64>,
    pub(super) brake_ms: Option<f64>,
    pub(super) deadman: Option<Deadman>,
    pub(super) heartbeat_ms: Option<f64>,
}

#[derive(Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default, expecting = "a table, written [device]")]
pub(super) struct Device {
    pub(super) profile: Option<String>,
    pub(super) selector: Option<String>,
    pub(super) world_from_device: WorldFromDevice,
    pub(super) hand: Option<String>,
    pub(super) sim: Sim,
}

#[derive(Debug, Default, Deserialize, JsonSchema)]
#[serde(
    deny_unknown_fields,
    default,
    expecting = "a table, such as { position_mm = [0, 0, 0], orientation_xyzw = [0, 0, 0, 1], \
        scale = 1 }"
)]
pub(super) struct WorldFromDevice {
    pub(super) position_mm: Option<Numbers<3>>,
    pub(super) orientation_xyzw: Option<Numbers<4>>,
    pub(super) scale: Option<f64>,
}

#[derive(Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default, expecting = "a table, written [device.sim]")]
pub(super) struct Sim {
    pub(super) hand: Option<HandWord>,
    pub(super) hand_stiffness_n_per_m: Option<f64>,
    pub(super) hand_damping_n_s_per_m: Option<f64>,
    pub(super) hand_mass_g: Option<f64>,
    pub(super) delay_ticks: Option<u32>,
    pub(super) fault: Option<String>,
}

#[derive(Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default, expecting = "a table, written [realtime]")]
pub(super) struct Realtime {
    pub(super) mode: Option<RealtimeWord>,
    pub(super) cpu: Option<u32>,
    pub(super) priority: Option<u32>,
}

#[derive(Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default, expecting = "a table, written [monitor]")]
pub(super) struct Monitor {
    pub(super) listen: Option<String>,
    pub(super) token_file: Option<String>,
    pub(super) origins: Option<Vec<String>>,
    pub(super) foxglove: Option<String>,
}

words! {
    CouplingWord for CouplingMode { Implicit = "implicit", Constraint = "constraint", Direct = "direct" }
    FieldWord for FieldKind { Layers = "layers", SurfacePoint = "surface-point", Octant = "octant", Trilinear = "trilinear" }
    UnitWord for Unit { M = "m", Mm = "mm", Cm = "cm", In = "in" }
    SidesWord for InsideTest { Auto = "auto", Flood = "flood", Winding = "winding", Thin = "thin" }
    PointsWord for Points { Facets = "facets", Voxels = "voxels" }
    NormalizeWord for Normalization { None = "none", Average = "average" }
    ClampWord for SpringClamp { Saturate = "saturate", HalfVoxel = "half-voxel" }
    FreeSpaceWord for FreeSpace { Zero = "zero", Drag = "drag" }
    HandWord { None = "none" }
    OffWord { Off = "off" }
    RealtimeWord { BestEffort = "best-effort", Enforce = "enforce" }
}

/// `filter.cutoff_hz`.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(untagged, expecting = "invalid value, expected [lowest, highest] in Hz or \"off\"")]
pub(super) enum Cutoff {
    Off(OffWord),
    Range(Numbers<2>),
}

/// `safety.deadman`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(untagged, expecting = "invalid value, expected the number of a button or \"off\"")]
pub(super) enum Deadman {
    Off(OffWord),
    Button(#[schemars(range(min = 0, max = 31))] i64),
}

/// `safety.overrun`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(
    untagged,
    expecting = "invalid value, expected a whole number of consecutive missed ticks or \"off\""
)]
pub(super) enum Overrun {
    Off(OffWord),
    Consecutive(#[schemars(range(min = 1))] i64),
}
