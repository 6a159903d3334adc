//! Refusals of the desk, sorted by what whoever asked can do about them.

use super::desk::Refusal;
use crate::servo::{PlaceError, TuneError};

/// What kind of refusal it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RefusalKind {
    /// There is nothing of that name.
    Unknown,
    /// The value will not do.
    Invalid,
    /// Too many at once; later it would do.
    TooMany,
    /// Not as things stand.
    Conflict,
}

impl Refusal {
    /// Its kind.
    pub fn kind(&self) -> RefusalKind {
        match self {
            Self::Tune(TuneError::Unknown { .. }) | Self::Place(PlaceError::Unknown { .. }) | Self::UnknownScene { .. } => {
                RefusalKind::Unknown
            }
            Self::Tune(TuneError::Range { .. }) | Self::Place(PlaceError::Pose { .. }) => RefusalKind::Invalid,
            Self::Tune(TuneError::Full) | Self::Place(PlaceError::Full) => RefusalKind::TooMany,
            _ => RefusalKind::Conflict,
        }
    }
}
