//! Everything that a client can change in one scene, in one hand.
#![expect(clippy::disallowed_types, reason = "made on the cold side")]

use rtrb::Consumer;

use super::{Placer, Tuner, Wishes};
use crate::haptics::{Parameters, Placement, Tune};

/// The cold end: poses of movable objects and parameters. One per scene; ends with it.
#[derive(Debug)]
pub struct Reins {
    /// Poses of movable objects.
    pub placer: Placer,
    /// Parameters.
    pub tuner: Tuner,
}

/// The loop's end, for [`Wishes`].
#[derive(Debug)]
pub struct ReinEnds {
    pub(super) placements: Consumer<Placement>,
    pub(super) tunes: Consumer<Tune>,
}

impl Reins {
    /// Both ends, for a scene of these parameters with these static objects in their order: name, and whether it may move. Allocates.
    pub fn new(parameters: &Parameters, objects: impl IntoIterator<Item = (String, bool)>) -> (Self, ReinEnds) {
        let (placer, placements) = Placer::new(objects);
        let (tuner, tunes) = Tuner::new(parameters);
        (Self { placer, tuner }, ReinEnds { placements, tunes })
    }
}

impl Wishes {
    /// The same, held by reins too.
    #[must_use]
    pub fn with_reins(mut self, ends: ReinEnds) -> Self {
        (self.ring, self.tunes) = (Some(ends.placements), Some(ends.tunes));
        self
    }
}
