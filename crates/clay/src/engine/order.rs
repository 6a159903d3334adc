//! What can be asked of the engine.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::DVec3;

use super::super::SolidSource;
use super::super::boolean::Boolean;
use super::super::emboss::{GreyImage, ImagePlacement};
use super::super::material_map::{MaterialPlace, Painted};
use super::{ToolChange, ToolSettings};
use vps::spatial::Pose;

/// What a person, a page or a script asks for. Taken between two updates of the material; what ends
/// a stroke says so.
#[derive(Clone, Debug)]
pub enum SculptOrder {
    /// Another tool, or other settings of the same one. Ends a stroke.
    Take(ToolSettings),
    /// Some of the settings. Ends a stroke.
    Adjust(ToolChange),
    /// As if the arm's first button were held (true) or let go (false).
    Hold(bool),
    /// Takes the last stroke back, or the one under way; refused where there is none.
    Undo,
    /// Does again what was taken back last; refused where nothing was.
    Redo,
    /// Another part of the clay deforms: lowest and highest corner of a box, map frame, m. Ends a
    /// stroke.
    Region {
        /// Lowest corner.
        low_map: DVec3,
        /// Highest corner.
        high_map: DVec3,
    },
    /// Joins the clay with another solid, or cuts it by one. Ends a stroke.
    Combine {
        /// Which way.
        boolean: Boolean,
        /// The other solid; what is not sampled yet gets the spacing that the clay has then.
        with: Arc<SolidSource>,
        /// Where it stands.
        map_from_body: Pose,
        /// The edge between both stays.
        is_sharp: bool,
    },
    /// Raises the surface by an image (depth above 0) or sinks it in (below). Ends a stroke.
    Emboss {
        /// White is deep, black is none.
        image: Arc<GreyImage>,
        /// Where.
        placement: ImagePlacement,
        /// m.
        depth_m: f64,
    },
    /// Lays a material at a place, or everywhere: one stroke. Ends a stroke.
    Lay {
        /// Which; nothing given: [so many times](Painted::HARDER) as hard as the clay.
        painted: Painted,
        /// Where.
        place: MaterialPlace,
    },
    /// Lays curves for the curve rope, as if they had been drawn: the next hold near one of them
    /// pulls all of them. They take the place of those that were drawn before; none at all: they
    /// are gone. Ends a stroke.
    Draw(RopeCurves),
    /// Pulls curves, or single places, with a force for a time, whatever the hand does; that is one
    /// stroke. Ends the stroke before.
    Pull {
        /// Along which.
        curves: RopeCurves,
        /// On the material, map axes, N: all curves together.
        force_map: DVec3,
        /// How long, s.
        time_s: f64,
        /// Radius around the curves; `None`: that of the tool, m.
        brush_m: Option<f64>,
    },
    /// Writes the samples with normals and colours, a PLY file; those of a stroke under way as they
    /// are.
    SavePoints(PathBuf),
    /// Writes all that is needed to go on another day. Ends a stroke.
    SaveSession(PathBuf),
    /// Writes the clay as a closed triangle mesh that a rigid scene can use, a PLY file. Ends a
    /// stroke.
    Export(PathBuf),
}

/// Curves for the rope.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RopeCurves {
    /// Corners of each, map frame, m; a curve of one corner is a place.
    pub curves_map: Vec<Vec<DVec3>>,
    /// They stay where they are given, inside the clay or beside it, and each place pulls the level
    /// of density that it lies on; otherwise they are laid onto the surface, which is to be within
    /// the brush.
    pub is_free: bool,
}

impl RopeCurves {
    /// Curves at once, and corners of all of them, at most.
    pub const CURVES_MAX: usize = 64;
    /// Corners of all curves at most, those among them that are put in between.
    pub const CORNERS_MAX: usize = 4096;
    /// The largest force, N, and the longest time, s.
    pub const FORCE_MAX_N: f64 = 1000.0;
    /// s.
    pub const TIME_MAX_S: f64 = 60.0;
}

impl SculptOrder {
    /// What it writes, a word, and where; `None`: nothing.
    pub fn writes(&self) -> Option<(&'static str, &Path)> {
        match self {
            Self::SavePoints(file) => Some(("points", file)),
            Self::SaveSession(file) => Some(("session", file)),
            Self::Export(file) => Some(("mesh", file)),
            _ => None,
        }
    }
}
