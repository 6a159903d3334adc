//! What can be asked of the engine.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::DVec3;

use super::super::SolidSource;
use super::super::boolean::Boolean;
use super::super::emboss::{GreyImage, ImagePlacement};
use super::{ToolChange, ToolSettings};
use vps::spatial::Pose;

/// What a person, a page or a script asks for. Taken between two updates of the material; what ends a stroke says so.
#[derive(Clone, Debug)]
pub enum SculptOrder {
    /// Another craft, or other settings of the same one. Ends a stroke.
    Take(ToolSettings),
    /// Some of the settings. Ends a stroke.
    Adjust(ToolChange),
    /// As if the arm's first button were held (true) or let go (false).
    Hold(bool),
    /// Takes the last stroke back, or the one under way; refused where there is none.
    Undo,
    /// Does again what was taken back last; refused where nothing was.
    Redo,
    /// Another part of the piece deforms: lowest and highest corner of a box, map frame, m. Ends a stroke.
    Region {
        /// Lowest corner.
        low_map: DVec3,
        /// Highest corner.
        high_map: DVec3,
    },
    /// Joins the piece with another solid, or cuts it by one. Ends a stroke.
    Combine {
        /// Which way.
        boolean: Boolean,
        /// The other solid; what is not sampled yet gets the spacing that the piece has then.
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
    /// Writes the samples with normals and colours, a PLY file; those of a stroke under way as they are.
    SavePoints(PathBuf),
    /// Writes all that is needed to go on another day. Ends a stroke.
    SaveSession(PathBuf),
    /// Writes the piece as a closed triangle mesh that a rigid scene can use, a PLY file. Ends a stroke.
    Export(PathBuf),
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
