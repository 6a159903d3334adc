//! What a picture is of.

use glam::DVec3;

use vps::pointshell::shell::Shell;
use vps::voxmap::layers::Layers;
use vps::voxmap::surface::Surface;

/// An object as it was baked.
#[derive(Clone, Copy, Debug)]
pub struct BakedObject<'a> {
    /// Name of the object.
    pub name: &'a str,
    /// Surface voxels.
    pub surface: &'a Surface,
    /// Layer values, same grid.
    pub layers: &'a Layers,
    /// The shell, about the centre of mass.
    pub shell: &'a Shell,
    /// Centre of mass, mesh frame, m.
    pub center_of_mass_tool: DVec3,
    /// A two-sided skin, not a solid.
    pub thin: bool,
}
