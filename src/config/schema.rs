//! Second pass: the scene as it is written. Foreign units, nothing checked but names and types.
//!
//! Every key is optional here: what must be given is said by the third pass, in the words of the scene. `docs` of the keys are in
//! `config/default.toml`, which a test holds against these tables.

mod sculpt;

use std::borrow::Cow;
use std::fmt;

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::Deserialize;
use serde::de::{self, Deserializer, IgnoredAny, SeqAccess, Visitor};

use document::{Numbers, words};

pub(super) use self::sculpt::{
    CraftWord, Creep, Deed, FalloffWritten, IntegratorWord, PaintedWritten, Sculpt, Stroke, Strokes, WrittenSolid, WrittenTool,
    holds_strokes,
};

/// A key of a later version: any value is read, so that the third pass can refuse it by name.
pub(crate) type Later = Option<IgnoredAny>;

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
    pub(super) mass_g: Option<f64>,
    pub(super) center_of_mass_mm: Option<Numbers<3>>,
    pub(super) inertia_kg_mm2: Option<Numbers<6>>,
    pub(super) start_position_mm: Option<Numbers<3>>,
    pub(super) start_orientation_xyzw: Option<Numbers<4>>,
}

#[derive(Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default, expecting = "a table with one shape, such as { box_mm = [60, 40, 10] } or { sphere_mm = 8 }")]
pub(super) struct Shape {
    pub(super) box_mm: Option<Numbers<3>>,
    pub(super) sphere_mm: Option<f64>,
    pub(super) cylinder_mm: Option<Numbers<2>>,
    pub(super) cone_mm: Option<Numbers<2>>,
    pub(super) capsule_mm: Option<Numbers<2>>,
    pub(super) torus_mm: Option<Numbers<2>>,
    pub(super) plane_mm: Option<Numbers<2>>,
}

#[derive(Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default, expecting = "a table, written [contact]")]
pub(super) struct Contact {
    pub(super) stiffness_n_per_mm: Option<f64>,
    pub(super) damping_ratio: Option<f64>,
    pub(super) normalize: Option<NormalizeWord>,
    pub(super) friction: Option<Friction>,
    pub(super) braking: Option<bool>,
    pub(super) damping_n_s_per_m: Option<f64>,
    pub(super) geometric_awareness: Option<AwarenessWord>,
    pub(super) time_budget_us: Option<f64>,
}

#[derive(Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default, expecting = "a table, written { static = 0.25, dynamic = 0.2 }")]
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
    pub(super) spatial: Option<bool>,
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
    expecting = "a table, such as { position_mm = [0, 0, 0], orientation_xyzw = [0, 0, 0, 1], scale = 1 }"
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
    pub(super) hand_repeat: Option<bool>,
    pub(super) hand_stiffness_n_per_m: Option<f64>,
    pub(super) hand_damping_n_s_per_m: Option<f64>,
    pub(super) hand_mass_g: Option<f64>,
    pub(super) delay_ticks: Option<u32>,
    pub(super) fault: Option<String>,
    pub(super) seed: Option<u64>,
    #[schemars(skip)]
    pub(super) jitter_us: Later,
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
    CouplingWord { Implicit = "implicit", SemiImplicit = "semi-implicit", Static = "static", Constraint = "constraint", Direct = "direct" }
    FieldWord { Layers = "layers", SurfacePoint = "surface-point", Octant = "octant", Trilinear = "trilinear" }
    UnitWord { Metre = "m", Millimetre = "mm", Centimetre = "cm", Inch = "in" }
    SidesWord { Auto = "auto", Flood = "flood", Winding = "winding", Thin = "thin" }
    AwarenessWord { Edges = "edges", Off = "off" }
    NormalizeWord { None = "none", Average = "average", Cluster = "cluster" }
    ClampWord { Saturate = "saturate", HalfVoxel = "half-voxel" }
    FreeSpaceWord { Zero = "zero", Drag = "drag" }
    HandWord { None = "none" }
    RealtimeWord { BestEffort = "best-effort", Enforce = "enforce" }
}

/// `filter.cutoff_hz`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Cutoff {
    Off,
    Range([f64; 2]),
}

impl<'de> Deserialize<'de> for Cutoff {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct RangeOrOff;
        impl<'de> Visitor<'de> for RangeOrOff {
            type Value = Cutoff;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("[lowest, highest] in Hz or \"off\"")
            }
            fn visit_str<E: de::Error>(self, word: &str) -> Result<Cutoff, E> {
                if word == "off" { Ok(Cutoff::Off) } else { Err(E::invalid_value(de::Unexpected::Str(word), &self)) }
            }
            fn visit_seq<A: SeqAccess<'de>>(self, seq: A) -> Result<Cutoff, A::Error> {
                Numbers::deserialize(de::value::SeqAccessDeserializer::new(seq)).map(|Numbers(range)| Cutoff::Range(range))
            }
        }
        deserializer.deserialize_any(RangeOrOff)
    }
}

impl JsonSchema for Cutoff {
    fn schema_name() -> Cow<'static, str> {
        "Cutoff".into()
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        json_schema!({ "anyOf": [generator.subschema_for::<Numbers<2>>(), { "const": "off" }] })
    }
}

/// `safety.deadman`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Deadman {
    Off,
    Button(i64),
}

impl<'de> Deserialize<'de> for Deadman {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct ButtonOrOff;
        impl Visitor<'_> for ButtonOrOff {
            type Value = Deadman;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("the number of a button or \"off\"")
            }
            fn visit_i64<E: de::Error>(self, button: i64) -> Result<Deadman, E> {
                Ok(Deadman::Button(button))
            }
            fn visit_str<E: de::Error>(self, word: &str) -> Result<Deadman, E> {
                if word == "off" { Ok(Deadman::Off) } else { Err(E::invalid_value(de::Unexpected::Str(word), &self)) }
            }
        }
        deserializer.deserialize_any(ButtonOrOff)
    }
}

impl JsonSchema for Deadman {
    fn schema_name() -> Cow<'static, str> {
        "Deadman".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "anyOf": [{ "type": "integer", "minimum": 0, "maximum": 31 }, { "const": "off" }] })
    }
}

/// `safety.overrun`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Overrun {
    Off,
    Consecutive(i64),
}

impl<'de> Deserialize<'de> for Overrun {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct CountOrOff;
        impl Visitor<'_> for CountOrOff {
            type Value = Overrun;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a whole number of consecutive missed ticks or \"off\"")
            }
            fn visit_i64<E: de::Error>(self, count: i64) -> Result<Overrun, E> {
                Ok(Overrun::Consecutive(count))
            }
            fn visit_str<E: de::Error>(self, word: &str) -> Result<Overrun, E> {
                if word == "off" { Ok(Overrun::Off) } else { Err(E::invalid_value(de::Unexpected::Str(word), &self)) }
            }
        }
        deserializer.deserialize_any(CountOrOff)
    }
}

impl JsonSchema for Overrun {
    fn schema_name() -> Cow<'static, str> {
        "Overrun".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "anyOf": [{ "type": "integer", "minimum": 1 }, { "const": "off" }] })
    }
}
