//! What a picture is of.

use glam::DVec3;

use super::marks::Marks;
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
    /// What the cuts mark.
    pub marks: &'a Marks,
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use vps::mesh::TriangleMesh;
    use vps::mesh::primitives::Shape;
    use vps::mesh::validate::inspect;
    use vps::pointshell;
    use vps::voxmap::inside_test::InsideTest;
    use vps::voxmap::{Options, Volume};

    /// A box and what was baked of it.
    pub(crate) fn with_baked_box<T>(
        size_m: DVec3,
        voxel_size_m: f64,
        look: impl FnOnce(&TriangleMesh, &BakedObject<'_>) -> T,
    ) -> T {
        let mesh = Shape::Box { size_m }.tessellate(1e-4);
        let options =
            Options { voxel_size_m, layers: 3, navigation: None, sides: InsideTest::Auto };
        let map = Volume::build(&mesh, &inspect(&mesh), &options, |_| {}).unwrap();
        let (shell, _) = pointshell::build(&mesh, &map, DVec3::ZERO);
        let subject = BakedObject {
            name: "box",
            surface: &map.surface,
            layers: &map.layers,
            shell: &shell,
            center_of_mass_tool: DVec3::ZERO,
            thin: map.thin,
            marks: &Marks::of(&mesh, &map),
        };
        look(&mesh, &subject)
    }
}
