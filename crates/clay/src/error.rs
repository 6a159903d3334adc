//! Why samples make no surface.

use glam::DVec3;

use super::WorkError;
use vps::setting_names::SettingNames;
use vps::spatial::{Metres, Place};

/// Samples that no surface can be made of. Messages read well after "failed to build the surface:
/// "; [`SurfaceError::hint`] says what to do.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SurfaceError {
    /// The work ended before it was done.
    #[error(transparent)]
    Work(#[from] WorkError),
    /// Not enough samples to go around a body.
    #[error("{found} points, at least {} are needed", super::PointSet::LEAST)]
    TooFew {
        /// How many there are.
        found: usize,
    },
    /// A mesh that is too small for the spacing at which it is sampled.
    #[error(
        "it is {} across, so a spacing of {} gives {found} points, and at least {} are needed", Metres(*across_m), Metres(*spacing_m),
        super::PointSet::LEAST
    )]
    TooCoarse {
        /// How many points there are.
        found: usize,
        /// Between samples, m.
        spacing_m: f64,
        /// Longest edge of its box, m.
        across_m: f64,
    },
    /// The arrays of the set differ in length.
    #[error(
        "{positions} positions, {normals} normals and {colors} colours: every point needs one of \
            each"
    )]
    UnequalArrays {
        /// Length of the first array.
        positions: usize,
        /// Of the second.
        normals: usize,
        /// Of the third.
        colors: usize,
    },
    /// A coordinate is not a number, or infinite.
    #[error("point {sample} (counted from 0) is not finite: {position_map}")]
    NonFinite {
        /// Number of the sample, from 0.
        sample: usize,
        /// As given.
        position_map: DVec3,
    },
    /// A normal is not of length one.
    #[error("the normal of point {sample} (counted from 0) is not of length 1: {normal_map}")]
    BadNormal {
        /// Number of the sample, from 0.
        sample: usize,
        /// As given.
        normal_map: DVec3,
    },
    /// Two samples are at one place.
    #[error("points {first} and {second} (counted from 0) are both at {}", Place(*position_map))]
    Coincident {
        /// Number of one sample, from 0.
        first: usize,
        /// Number of the other.
        second: usize,
        /// Where both are, m.
        position_map: DVec3,
    },
    /// The neighbourhoods of most samples are lines: they have no tangent plane.
    #[error(
        "{samples} of {of} points lie with their neighbours on a line, so they have no tangent \
            plane"
    )]
    Lines {
        /// How many such samples there are.
        samples: usize,
        /// Of how many.
        of: usize,
    },
    /// A mesh cannot be sampled at this spacing.
    #[error("it is {} across, and a spacing of {} makes too many points of it: at least {} is \
        possible", Metres(*across_m), Metres(*spacing_m), Metres(*least_m))]
    Spacing {
        /// Longest edge of its box, m.
        across_m: f64,
        /// As given.
        spacing_m: f64,
        /// With this one the mesh gives as many samples as are allowed.
        least_m: f64,
    },
    /// The number of neighbours to look at is out of range.
    #[error("{found} neighbours, {} to {} are possible", super::PointSurface::NEIGHBOURS.start(), super::PointSurface::NEIGHBOURS.end())]
    Neighbours {
        /// As given.
        found: usize,
    },
}

impl SurfaceError {
    /// What to do about it.
    pub fn hint(&self, names: &SettingNames) -> String {
        let hint = match self {
            Self::Work(error) => error.hint(),
            Self::TooFew { .. } => {
                "scan or sample the surface more densely; a sphere takes some hundreds of points"
            }
            Self::TooCoarse { .. } => {
                return format!("is {} right? else choose a smaller spacing", names.unit);
            }
            Self::UnequalArrays { .. } => "give every point a normal and a colour",
            Self::NonFinite { .. } => "remove the point",
            Self::BadNormal { .. } => "leave all normals out, then they are estimated",
            Self::Coincident { .. } => "remove one of the two: loading a file does that by itself",
            Self::Lines { .. } => {
                "scan or sample the surface evenly: lines of points that are far apart make no \
                    surface"
            }
            Self::Spacing { .. } => {
                return format!("is {} right? else choose a larger spacing", names.unit);
            }
            Self::Neighbours { .. } => "take 24, which suit most surfaces",
        };
        hint.to_owned()
    }
}
