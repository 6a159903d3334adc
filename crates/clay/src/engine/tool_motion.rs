//! What the engine gets of the hand.

use std::sync::Arc;

use glam::DVec3;

use super::super::PointSet;
use vps::spatial::Pose;

/// The tool in one tick of the loop.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ToolMotion {
    /// Pose of the tool (mesh file frame) in the map frame.
    pub map_from_tool: Pose,
    /// Force of the surface on the tool, friction and rope apart, map axes, N. On the clay acts the
    /// opposite.
    pub force_map: DVec3,
    /// Force of the rope on the tool, map axes, N.
    pub rope_map: DVec3,
    /// The tool touches the clay.
    pub touches: bool,
    /// The arm's first button is held.
    pub is_held: bool,
    /// Force may flow: without, the hand does not feel what it does, and nothing is worked.
    pub has_force: bool,
}

/// What becomes of a hold.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum HoldOutcome {
    /// No hold began.
    #[default]
    None,
    /// A hold began, and the tool did what it does.
    Taken,
    /// A hold began, and there was nothing that the tool could work on.
    Missed,
}

/// The body in the hand, as the engine needs it.
#[derive(Clone, Debug, Default)]
pub struct ToolBody {
    /// Samples of its surface, tool frame (mesh file frame); `None`: a point, which Booleans cannot
    /// use.
    pub shape: Option<Arc<PointSet>>,
    /// Its centre of mass, tool frame, m: there the rope is tied.
    pub center_of_mass_tool: DVec3,
}

impl ToolBody {
    /// Where the tool takes hold, map frame.
    pub(super) fn tip_map(&self, motion: &ToolMotion) -> DVec3 {
        motion.map_from_tool.transform_point(self.center_of_mass_tool)
    }
}
