//! What the tick reads and never writes.

use glam::DVec3;

use super::Parameters;
use super::clay::Clay;
use super::coupling::Inertia;
use vps::contact::Obstacle;
use vps::pointshell::shell::Shell;
use vps::spatial::Pose;

/// The tool as the tick sees it.
#[derive(Debug)]
pub struct Tool {
    /// Points and inward normals about the centre of mass, tool axes, m.
    pub shell: Shell,
    /// Mass, and inertia about the centre of mass.
    pub inertia: Inertia,
    /// Centre of mass, which is also the grip point, in the tool frame, m.
    pub center_of_mass_tool: DVec3,
}

/// The immutable scene: everything allocated and touched before the first tick.
#[derive(Debug)]
pub struct RenderScene {
    /// Everything that a scene sets, SI.
    pub parameters: Parameters,
    /// Rigid objects that the tool touches, each with its place.
    #[expect(clippy::disallowed_types, reason = "filled on the cold side, never resized")]
    pub obstacles: Vec<Obstacle>,
    /// Material that deforms; `None`: there is none.
    pub clay: Option<Clay>,
    /// The moving object.
    pub tool: Tool,
}

impl RenderScene {
    /// Start pose of the body axes (tool axes at the centre of mass).
    pub(super) fn start(&self) -> Pose {
        self.parameters.mapping.start * Pose::from_translation(self.tool.center_of_mass_tool)
    }
}
