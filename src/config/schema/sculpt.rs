//! `[sculpt]` of a scene, and files of strokes: what both say of clay, its tool and other solids.

use schemars::JsonSchema;
use serde::Deserialize;
use serde::de::IgnoredAny;

use clay::dynamics::Integrator;
use clay::engine::SculptTool;
use clay::falloff::Falloff;
use document::{Document, Numbers, words};

use super::{OffWord, Shape, UnitWord};

/// A table that says something of clay: its own keys, and those that the scene and a stroke share,
/// which are written here once.
macro_rules! clay_table {
    (@ $(#[$of_table:meta])* $name:ident { $($(#[$of_key:meta])* $key:ident: $type:ty,)+ }) => {
        $(#[$of_table])*
        #[serde(deny_unknown_fields, default)]
        pub(in crate::config) struct $name {
            $($(#[$of_key])* pub(in crate::config) $key: Option<$type>,)+
        }

        impl $name {
            /// The keys that are written, by their names here.
            pub(in crate::config) fn given(&self) -> Vec<&'static str> {
                [$((stringify!($key), self.$key.is_some())),+].into_iter().filter_map(|(key, is)| is.then_some(key)).collect()
            }

            /// What it says of a solid.
            pub(in crate::config) fn written_solid(&self) -> WrittenSolid<'_> {
                WrittenSolid {
                    points: self.points.as_deref(),
                    mesh: self.mesh.as_deref(),
                    shape: self.shape.as_ref(),
                    units: self.units,
                    spacing_mm: self.spacing_mm,
                    scale: self.scale,
                }
            }

            /// What it says of the tool.
            pub(in crate::config) fn written_tool(&self) -> WrittenTool<'_> {
                WrittenTool {
                    tool: self.tool,
                    brush_mm: self.brush_mm,
                    falloff: self.falloff.as_ref(),
                    color: self.color.as_deref(),
                    painted: self.painted,
                    depth_mm: self.depth_mm,
                    image: self.image.as_deref(),
                    sharp: self.sharp,
                }
            }
        }
    };
    ($(#[$of_table:meta])* $name:ident { $($own:tt)+ }) => {
        clay_table! {
            @ $(#[$of_table])* $name {
                $($own)+
                // A solid.
                points: String,
                mesh: String,
                shape: Shape,
                units: UnitWord,
                spacing_mm: f64,
                scale: Numbers<3>,
                position_mm: Numbers<3>,
                orientation_xyzw: Numbers<4>,
                // A tool.
                tool: CraftWord,
                brush_mm: f64,
                falloff: FalloffWritten,
                color: String,
                painted: PaintedWritten,
                depth_mm: f64,
                image: String,
                sharp: bool,
                // What deforms.
                region_mm: Vec<Numbers<3>>,
            }
        }
    };
}

clay_table! {
    #[derive(Debug, Default, Deserialize, JsonSchema)]
    #[serde(expecting = "a table, written [sculpt]")]
    Sculpt {
        session: String,
        raster: Numbers<3>,
        air_mm: f64,
        neighbours: u32,
        interpolate: bool,
        mass: f64,
        damping: f64,
        stiffness: f64,
        creep_ms: Creep,
        integrator: IntegratorWord,
        acceleration_max: f64,
        smoothing: f64,
        update_hz: f64,
        strokes: String,
    }
}

/// A document of strokes, and not of a scene.
pub(in crate::config) fn holds_strokes(document: &Document<'_>) -> bool {
    document.has("stroke") && !document.has("tool") && !document.has("sculpt")
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

clay_table! {
    #[derive(Debug, Default, Deserialize)]
    #[serde(expecting = "a table, written [[stroke]]")]
    Stroke {
        at_s: f64,
        #[serde(rename = "do")]
        deed: Deed,
        until_s: f64,
        corner_mm: Numbers<3>,
        across_mm: Numbers<3>,
        down_mm: Numbers<3>,
        center_mm: Numbers<3>,
        axis: Numbers<3>,
        front: Numbers<3>,
        file: String,
        curves_mm: Vec<Vec<Numbers<3>>>,
        free: bool,
        force_n: Numbers<3>,
        low_mm: Numbers<3>,
        high_mm: Numbers<3>,
        radius_mm: f64,
        from_mm: Numbers<3>,
        to_mm: Numbers<3>,
        values: String,
        within_mm: f64,
    }
}

/// How a tool is written.
pub(in crate::config) struct WrittenTool<'w> {
    pub(in crate::config) tool: Option<CraftWord>,
    pub(in crate::config) brush_mm: Option<f64>,
    pub(in crate::config) falloff: Option<&'w FalloffWritten>,
    pub(in crate::config) color: Option<&'w str>,
    pub(in crate::config) painted: Option<PaintedWritten>,
    pub(in crate::config) depth_mm: Option<f64>,
    pub(in crate::config) image: Option<&'w str>,
    pub(in crate::config) sharp: Option<bool>,
}

/// How a solid is written.
pub(in crate::config) struct WrittenSolid<'w> {
    pub(in crate::config) points: Option<&'w str>,
    pub(in crate::config) mesh: Option<&'w str>,
    pub(in crate::config) shape: Option<&'w Shape>,
    pub(in crate::config) units: Option<UnitWord>,
    pub(in crate::config) spacing_mm: Option<f64>,
    pub(in crate::config) scale: Option<Numbers<3>>,
}

words! {
    CraftWord for SculptTool {
        Touch = "touch", Push = "push", Pull = "pull", PullCurve = "pull-curve", Paint = "paint", Material = "material",
        Emboss = "emboss", Engrave = "engrave", Union = "union", Intersection = "intersection", Difference = "difference",
        Region = "region",
    }
    IntegratorWord for Integrator { Implicit = "implicit", Explicit = "explicit" }
    FalloffWord for Falloff { Gaussian = "gaussian", Constant = "constant", Spherical = "spherical" }
    Deed {
        Take = "take", Hold = "hold", Union = "union", Intersection = "intersection", Difference = "difference",
        Emboss = "emboss", Engrave = "engrave", Draw = "draw", Pull = "pull", Lay = "lay", Undo = "undo", Redo = "redo", Region = "region",
        SavePoints = "save-points", SaveSession = "save-session", Export = "export",
    }
}

impl Deed {
    /// The one of a word.
    pub(in crate::config) fn of(word: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|deed| deed.to_string() == word)
    }

    /// The keys that belong to it, beside `at_s`.
    pub(in crate::config) fn keys(self) -> &'static [&'static str] {
        match self {
            Self::Take => {
                &["tool", "brush_mm", "falloff", "color", "painted", "depth_mm", "image", "sharp"]
            }
            Self::Hold => &["until_s"],
            Self::Union | Self::Intersection | Self::Difference => &[
                "points",
                "mesh",
                "shape",
                "units",
                "scale",
                "spacing_mm",
                "position_mm",
                "orientation_xyzw",
                "sharp",
            ],
            Self::Emboss | Self::Engrave => &[
                "image",
                "depth_mm",
                "corner_mm",
                "across_mm",
                "down_mm",
                "center_mm",
                "axis",
                "front",
            ],
            Self::Draw => &["curves_mm", "free"],
            Self::Pull => &["curves_mm", "free", "force_n", "until_s", "brush_mm"],
            Self::Lay => &[
                "painted",
                "low_mm",
                "high_mm",
                "center_mm",
                "radius_mm",
                "falloff",
                "from_mm",
                "to_mm",
                "values",
                "within_mm",
            ],
            Self::Undo | Self::Redo => &[],
            Self::Region => &["region_mm"],
            Self::SavePoints | Self::SaveSession | Self::Export => &["file"],
        }
    }

    /// All of them, in the order of the documentation.
    pub(in crate::config) const ALL: [Self; 16] = [
        Self::Take,
        Self::Hold,
        Self::Union,
        Self::Intersection,
        Self::Difference,
        Self::Emboss,
        Self::Engrave,
        Self::Draw,
        Self::Pull,
        Self::Lay,
        Self::Undo,
        Self::Redo,
        Self::Region,
        Self::SavePoints,
        Self::SaveSession,
        Self::Export,
    ];
}

/// `painted`: what the tool material paints.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default, expecting = "a table such as { stiffness = 500.0 }")]
#[schemars(rename = "Painted")]
pub(in crate::config) struct PaintedWritten {
    pub(in crate::config) mass: Option<f64>,
    pub(in crate::config) damping: Option<f64>,
    pub(in crate::config) stiffness: Option<f64>,
}

/// `falloff`: a word or weights.
#[derive(Clone, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(
    untagged,
    expecting = "invalid value, expected \"gaussian\", \"constant\", \"spherical\", { rate = 2.0 } \
        or an array of weights from 0 to 1"
)]
#[schemars(rename = "Falloff")]
pub(in crate::config) enum FalloffWritten {
    Word(FalloffWord),
    Weights(#[schemars(length(min = 2))] Vec<f64>),
    Rate(FalloffRate),
}

/// `falloff = { rate = 2.0 }`: 1 − ρ^rate at a share ρ of the radius.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "FalloffRate")]
pub(in crate::config) struct FalloffRate {
    #[schemars(range(min = 0.1, max = 100.0))]
    pub(in crate::config) rate: f64,
}

/// `creep_ms`.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize, JsonSchema)]
#[serde(untagged, expecting = "invalid value, expected a number of milliseconds or \"off\"")]
pub(in crate::config) enum Creep {
    Off(OffWord),
    Milliseconds(#[schemars(range(min = 0))] f64),
}
