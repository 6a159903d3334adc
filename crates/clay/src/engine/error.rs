//! Why the engine did not do what it was asked for.

use std::io;
use std::path::{Path, PathBuf};

use super::super::SurfaceError;
use super::super::clay_model::ClayModelError;
use super::super::export::ExportError;
use super::super::material_map::Painted;
use super::super::session::SessionFileError;
use glam::DVec3;
use vps::setting_names::SettingNames;
use vps::spatial::{Metres, Place};

/// Why the engine did not do what it was asked for. The clay is as it was; [`EngineError::hint`]
/// says what would help.
#[derive(Debug, thiserror::Error)]
pub enum EngineError {
    /// What would come out is no surface.
    #[error("{0}")]
    Surface(#[from] SurfaceError),
    /// What would come out cannot be worked.
    #[error("{0}")]
    Model(#[from] ClayModelError),
    /// No closed mesh.
    #[error("{0}")]
    Export(#[from] ExportError),
    /// A session that cannot be written.
    #[error("{0}")]
    Session(#[from] SessionFileError),
    /// A file that cannot be written.
    #[error("cannot write {path}: {source}")]
    Write {
        /// The file.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// There is no stroke to take back.
    #[error("there is no stroke to take back")]
    NothingToUndo,
    /// Nothing was taken back since the last stroke.
    #[error("there is no stroke to do again")]
    NothingToRedo,
    /// A tool needs a shape that the tool does not have.
    #[error("the tool has no shape that could be joined with the clay")]
    NoShape,
    /// The tool is too far from the clay.
    #[error("there is no surface within the brush")]
    OutOfReach,
    /// The tool works where the clay is stiff.
    #[error("the tool is outside of the region that deforms")]
    OutsideRegion,
    /// The hand does not feel what it does.
    #[error("no force flows, and nothing is worked that the hand does not feel")]
    NoForce,
    /// A place of a curve that is not near the surface.
    #[error("the curve has a place at {}, and no surface is within the brush there", Place(*.0))]
    CurveOutOfReach(DVec3),
    /// A place of a curve that cannot deform.
    #[error("the curve has a place at {}, outside of the region that deforms", Place(*.0))]
    CurveOutsideRegion(DVec3),
    /// Curves that are none, or too many of them.
    #[error("{what}")]
    Curves {
        /// What is wrong with them.
        what: String,
    },
    /// A place for material that is none.
    #[error("{what}")]
    Place {
        /// What is wrong with it.
        what: String,
    },
    /// Material that was laid beside the clay, or that it has already.
    #[error("no mass point has become another one")]
    NothingLaid,
    /// Curves are pulled by an order, and the hand has to wait.
    #[error("curves are being pulled by an order")]
    PullUnderWay,
    /// The tool touches none of the samples that it could work on.
    #[error("nothing of the clay lies under the {0}")]
    Nothing(&'static str),
    /// A difference that cuts nothing off.
    #[error("the other solid is beside the clay and cuts nothing off")]
    Beside,
    /// A property that no mass point may have.
    #[error("{name} of {value} {unit}")]
    Property {
        /// What it is of.
        name: &'static str,
        /// As given.
        value: f32,
        /// Its unit.
        unit: &'static str,
    },
    /// A number that means nothing.
    #[error("{name} of {}", Metres(*value))]
    Length {
        /// What it is of.
        name: &'static str,
        /// As given.
        value: f64,
    },
}

impl EngineError {
    pub(super) fn write(path: &Path, source: io::Error) -> Self {
        Self::Write { path: path.to_owned(), source }
    }

    /// What to do about it.
    pub fn hint(&self, names: &SettingNames) -> String {
        let SettingNames { raster, region, .. } = names;
        let hint = match self {
            Self::Surface(error) | Self::Model(ClayModelError::Surface(error)) => {
                return error.hint(names);
            }
            Self::Model(ClayModelError::NothingLeft) => {
                "move or shrink the other solid, and check its unit"
            }
            Self::Model(ClayModelError::TooMuchWork { .. }) => {
                return format!(
                    "take a smaller or a coarser solid, a lower relief, or fewer mass points in \
                        {raster}"
                );
            }
            Self::Model(ClayModelError::Memory { limit, .. }) => return limit.remedy(names),
            Self::Model(ClayModelError::TooFine { .. })
            | Self::Export(ExportError::TooLarge(_)) => {
                return format!("take fewer mass points in {raster}, or enlarge {region}");
            }
            Self::Model(_) => "choose another region or another raster",
            Self::Export(_) => "undo the last stroke, or load the clay with more air around it",
            Self::Session(_) | Self::Write { .. } => {
                "choose a file in a folder that exists and may be written to"
            }
            Self::NothingToUndo => "nothing has changed since the clay was loaded",
            Self::NothingToRedo => {
                "only what was taken back can be done again, until the next stroke"
            }
            Self::NoShape => "give the tool a mesh or a shape, or combine with another solid",
            Self::OutOfReach => "bring the tool nearer to the surface, or take a larger brush",
            Self::OutsideRegion => {
                return format!("work inside {region}, or choose another");
            }
            Self::CurveOutOfReach(_) => {
                "lay the curve nearer to the surface, take a larger brush, or let the curve be \
                    free: then it pulls the clay around it, wherever it lies"
            }
            Self::CurveOutsideRegion(_) => "draw inside the region, or choose another region first",
            Self::Curves { .. } => {
                "give 1 to 64 curves of finite places with at most 4096 of them in all, a force \
                    above 0 up to 1000 N, a time above 0 up to 60 s"
            }
            Self::Place { .. } => {
                "give finite places and lengths above 0, in the frame of the clay"
            }
            Self::NothingLaid => {
                "lay another material, or lay it where the clay is: in the frame of the clay, and \
                    check the unit"
            }
            Self::PullUnderWay => "wait until it is over, or undo it",
            Self::NoForce => "enable the arm",
            Self::Nothing(_) => "lay it on the surface, facing out of it",
            Self::Beside => "move it, and check its unit",
            Self::Property { .. } => Painted::KNOWN_GOOD,
            Self::Length { .. } => "give a finite length, above 0 for a brush",
        };
        hint.to_owned()
    }
}
