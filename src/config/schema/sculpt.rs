//! `[sculpt]` of a scene, and files of strokes: what both say of a piece of clay, its tool and other solids.

use std::borrow::Cow;
use std::fmt;

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::Deserialize;
use serde::de::{self, Deserializer, IgnoredAny, SeqAccess, Visitor};

use super::{Numbers, Shape, UnitWord, words};

#[derive(Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default, expecting = "a table, written [sculpt]")]
pub(in crate::config) struct Sculpt {
    pub(in crate::config) points: Option<String>,
    pub(in crate::config) mesh: Option<String>,
    pub(in crate::config) shape: Option<Shape>,
    pub(in crate::config) session: Option<String>,
    pub(in crate::config) units: Option<UnitWord>,
    pub(in crate::config) spacing_mm: Option<f64>,
    pub(in crate::config) position_mm: Option<Numbers<3>>,
    pub(in crate::config) orientation_xyzw: Option<Numbers<4>>,
    pub(in crate::config) region_mm: Option<Vec<Numbers<3>>>,
    pub(in crate::config) raster: Option<Numbers<3>>,
    pub(in crate::config) air_mm: Option<f64>,
    pub(in crate::config) neighbours: Option<u32>,
    pub(in crate::config) mass: Option<f64>,
    pub(in crate::config) damping: Option<f64>,
    pub(in crate::config) stiffness: Option<f64>,
    pub(in crate::config) creep_ms: Option<Creep>,
    pub(in crate::config) integrator: Option<IntegratorWord>,
    pub(in crate::config) update_hz: Option<f64>,
    pub(in crate::config) tool: Option<CraftWord>,
    pub(in crate::config) brush_mm: Option<f64>,
    pub(in crate::config) falloff: Option<FalloffWritten>,
    pub(in crate::config) color: Option<String>,
    pub(in crate::config) depth_mm: Option<f64>,
    pub(in crate::config) image: Option<String>,
    pub(in crate::config) sharp: Option<bool>,
    pub(in crate::config) strokes: Option<String>,
}

/// A file of strokes.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "a file of strokes")]
pub(in crate::config) struct Strokes {
    #[serde(rename = "version")]
    pub(in crate::config) _version: Option<IgnoredAny>,
    #[serde(rename = "stroke")]
    pub(in crate::config) strokes: Vec<Stroke>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default, expecting = "a table, written [[stroke]]")]
pub(in crate::config) struct Stroke {
    pub(in crate::config) at_s: Option<f64>,
    #[serde(rename = "do")]
    pub(in crate::config) deed: Option<Deed>,
    pub(in crate::config) until_s: Option<f64>,
    pub(in crate::config) tool: Option<CraftWord>,
    pub(in crate::config) brush_mm: Option<f64>,
    pub(in crate::config) falloff: Option<FalloffWritten>,
    pub(in crate::config) color: Option<String>,
    pub(in crate::config) depth_mm: Option<f64>,
    pub(in crate::config) image: Option<String>,
    pub(in crate::config) sharp: Option<bool>,
    pub(in crate::config) points: Option<String>,
    pub(in crate::config) mesh: Option<String>,
    pub(in crate::config) shape: Option<Shape>,
    pub(in crate::config) units: Option<UnitWord>,
    pub(in crate::config) spacing_mm: Option<f64>,
    pub(in crate::config) position_mm: Option<Numbers<3>>,
    pub(in crate::config) orientation_xyzw: Option<Numbers<4>>,
    pub(in crate::config) corner_mm: Option<Numbers<3>>,
    pub(in crate::config) across_mm: Option<Numbers<3>>,
    pub(in crate::config) down_mm: Option<Numbers<3>>,
    pub(in crate::config) center_mm: Option<Numbers<3>>,
    pub(in crate::config) axis: Option<Numbers<3>>,
    pub(in crate::config) front: Option<Numbers<3>>,
    pub(in crate::config) region_mm: Option<Vec<Numbers<3>>>,
    pub(in crate::config) file: Option<String>,
}

words! {
    CraftWord {
        Touch = "touch", Push = "push", Pull = "pull", PullCurve = "pull-curve", Paint = "paint", Emboss = "emboss",
        Engrave = "engrave", Union = "union", Intersection = "intersection", Difference = "difference",
    }
    IntegratorWord { Implicit = "implicit", Explicit = "explicit" }
    Deed {
        Take = "take", Hold = "hold", Union = "union", Intersection = "intersection", Difference = "difference",
        Emboss = "emboss", Engrave = "engrave", Undo = "undo", Redo = "redo", Region = "region",
        SavePoints = "save-points", SaveSession = "save-session", Export = "export",
    }
}

impl Deed {
    /// All of them, in the order of the documentation.
    pub(in crate::config) const ALL: [Self; 13] = [
        Self::Take,
        Self::Hold,
        Self::Union,
        Self::Intersection,
        Self::Difference,
        Self::Emboss,
        Self::Engrave,
        Self::Undo,
        Self::Redo,
        Self::Region,
        Self::SavePoints,
        Self::SaveSession,
        Self::Export,
    ];
}

/// `falloff`: a word or weights.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::config) enum FalloffWritten {
    Gaussian,
    Constant,
    Spherical,
    Weights(Vec<f64>),
}

impl<'de> Deserialize<'de> for FalloffWritten {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct WordOrWeights;
        impl<'de> Visitor<'de> for WordOrWeights {
            type Value = FalloffWritten;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str(r#""gaussian", "constant", "spherical" or an array of weights from 0 to 1"#)
            }
            fn visit_str<E: de::Error>(self, word: &str) -> Result<FalloffWritten, E> {
                match word {
                    "gaussian" => Ok(FalloffWritten::Gaussian),
                    "constant" => Ok(FalloffWritten::Constant),
                    "spherical" => Ok(FalloffWritten::Spherical),
                    _ => Err(E::invalid_value(de::Unexpected::Str(word), &self)),
                }
            }
            fn visit_seq<A: SeqAccess<'de>>(self, mut seq: A) -> Result<FalloffWritten, A::Error> {
                let mut weights = Vec::new();
                while let Some(weight) = seq.next_element()? {
                    weights.push(weight);
                }
                Ok(FalloffWritten::Weights(weights))
            }
        }
        deserializer.deserialize_any(WordOrWeights)
    }
}

impl JsonSchema for FalloffWritten {
    fn schema_name() -> Cow<'static, str> {
        "Falloff".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "anyOf": [
            { "type": "string", "enum": ["gaussian", "constant", "spherical"] },
            { "type": "array", "items": { "type": "number" }, "minItems": 2 },
        ] })
    }
}

/// `creep_ms`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::config) enum Creep {
    Off,
    Milliseconds(f64),
}

impl<'de> Deserialize<'de> for Creep {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct TimeOrOff;
        impl Visitor<'_> for TimeOrOff {
            type Value = Creep;
            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("a number of milliseconds or \"off\"")
            }
            fn visit_i64<E: de::Error>(self, ms: i64) -> Result<Creep, E> {
                self.visit_f64(ms as f64)
            }
            fn visit_f64<E: de::Error>(self, ms: f64) -> Result<Creep, E> {
                Ok(if ms == 0.0 { Creep::Off } else { Creep::Milliseconds(ms) })
            }
            fn visit_str<E: de::Error>(self, word: &str) -> Result<Creep, E> {
                if word == "off" { Ok(Creep::Off) } else { Err(E::invalid_value(de::Unexpected::Str(word), &self)) }
            }
        }
        deserializer.deserialize_any(TimeOrOff)
    }
}

impl JsonSchema for Creep {
    fn schema_name() -> Cow<'static, str> {
        "Creep".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "anyOf": [{ "type": "number", "minimum": 0 }, { "const": "off" }] })
    }
}
