//! A scene from typed values: what the program fills from TOML and its bake cache, and others from
//! code.
//!
//! Data in: [`Parameters`], parts to bake (or baked ones), a tool, perhaps clay. Data out: one
//! immutable [`RenderScene`] and a report on each object, the tool last. Units and frames: SI;
//! poses are `world_from_map`, where the map frame is that of the mesh.
//!
//! Cost: baking, see [`vps::part`]. Cold: runs before the first tick.
#![expect(clippy::disallowed_types, reason = "cold: all of it runs before the first tick")]

use glam::{DMat3, DVec3};

use super::clay::Clay;
use super::{Inertia, Parameters, RenderScene, Tool};
use vps::contact::Obstacle;
use vps::mesh::mass::MassProperties;
use vps::part::{ObjectReport, Part, PartError};
use vps::pointshell::Points;
use vps::pointshell::shell::Shell;
use vps::spatial::Pose;
use vps::voxmap::Options;
use vps::voxmap::field::{Field, FieldKind};

/// What a tool is, beside its shape.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ToolOptions {
    /// Mass, kg.
    pub mass_kg: f64,
    /// Centre of mass in the tool frame, m; `None`: from the mesh.
    pub center_of_mass_m: Option<DVec3>,
    /// Inertia about the centre of mass in tool axes, kg·m²; `None`: from the mesh.
    pub inertia_kg_m2: Option<DMat3>,
    /// Which points it has, where the builder bakes it.
    pub points: Points,
}

impl ToolOptions {
    /// So heavy, with the centre of mass and the inertia of the mesh.
    pub fn new(mass_kg: f64) -> Self {
        Self { mass_kg, center_of_mass_m: None, inertia_kg_m2: None, points: Points::default() }
    }
}

/// Builds a [`RenderScene`]: parts first, then clay if there is any, the tool last.
#[derive(Debug)]
pub struct SceneBuilder {
    parameters: Parameters,
    obstacles: Vec<Obstacle>,
    clay: Option<Clay>,
    reports: Vec<ObjectReport>,
}

/// A radius of gyration that no real tool falls below, as a share of its size: keeps the rotational
/// step well-conditioned for needles, whose moment about their own axis is next to nothing.
const GYRATION_SHARE: f64 = 0.05;

impl SceneBuilder {
    /// A scene without objects.
    pub fn new(parameters: Parameters) -> Self {
        Self { parameters, obstacles: Vec::new(), clay: None, reports: Vec::new() }
    }

    /// The contact model of the scene reads gradients.
    pub fn needs_gradients(&self) -> bool {
        self.parameters.contact.field == FieldKind::SurfacePoint
    }

    /// Bakes a part that the tool can touch.
    ///
    /// # Errors
    /// A grid that is too large.
    pub fn add_part(
        &mut self,
        part: &Part,
        options: &Options,
        world_from_map: Pose,
    ) -> Result<(), PartError> {
        let (field, report) = part.bake_field(options, self.needs_gradients(), |_| ())?;
        self.add_baked_part(field, report, world_from_map);
        Ok(())
    }

    /// Adds a part that is baked, with gradients where the scene [needs
    /// them](Self::needs_gradients).
    pub fn add_baked_part(&mut self, field: Field, report: ObjectReport, world_from_map: Pose) {
        self.obstacles.push(Obstacle { field, world_from_map });
        self.reports.push(report);
    }

    /// Gives the scene its clay.
    pub fn set_clay(&mut self, clay: Clay) {
        self.clay = Some(clay);
    }

    /// Bakes the tool and completes the scene.
    ///
    /// # Errors
    /// A grid that is too large.
    pub fn finish(
        self,
        tool: &Part,
        options: &Options,
        tool_options: &ToolOptions,
    ) -> Result<(RenderScene, Vec<ObjectReport>), PartError> {
        let (shell, mass, report) =
            tool.bake_shell(options, tool_options.points, tool_options.center_of_mass_m, |_| ())?;
        Ok(self.finish_baked(shell, &mass, report, tool_options))
    }

    /// Completes the scene with a tool that is baked, about the centre of mass that the options
    /// name.
    pub fn finish_baked(
        self,
        shell: Shell,
        mass: &MassProperties,
        report: ObjectReport,
        options: &ToolOptions,
    ) -> (RenderScene, Vec<ObjectReport>) {
        let Self { parameters, obstacles, clay, mut reports } = self;
        let center_of_mass_tool = options.center_of_mass_m.unwrap_or(mass.center_m);
        let inertia = inertia(options, mass, shell.radius_m(), center_of_mass_tool);
        reports.push(report);
        let tool = Tool { shell, inertia, center_of_mass_tool };
        (RenderScene { parameters, obstacles, clay, tool }, reports)
    }
}

/// The tool's inertia: as configured, or from the mesh about the configured centre of mass.
fn inertia(
    tool: &ToolOptions,
    mass: &MassProperties,
    radius_m: f64,
    center_of_mass_tool: DVec3,
) -> Inertia {
    let shift = mass.center_m - center_of_mass_tool;
    // Parallel axes, for a centre of mass that is not the mesh's own.
    let outer = DMat3::from_cols(shift * shift.x, shift * shift.y, shift * shift.z);
    let about_center = mass.inertia_per_mass + DMat3::IDENTITY * shift.length_squared() - outer;
    let floor = (GYRATION_SHARE * radius_m).powi(2);
    let body_kg_m2 =
        tool.inertia_kg_m2.unwrap_or((about_center + DMat3::IDENTITY * floor) * tool.mass_kg);
    Inertia { mass_kg: tool.mass_kg, body_kg_m2, least_kg_m2: least_eigenvalue(body_kg_m2) }
}

/// Smallest eigenvalue of a symmetric matrix, by the trigonometric solution of its characteristic
/// cubic.
fn least_eigenvalue(matrix: DMat3) -> f64 {
    let mean = (matrix.x_axis.x + matrix.y_axis.y + matrix.z_axis.z) / 3.0;
    let deviator = matrix - DMat3::IDENTITY * mean;
    let spread = ((deviator.x_axis.length_squared()
        + deviator.y_axis.length_squared()
        + deviator.z_axis.length_squared())
        / 6.0)
        .sqrt();
    if spread <= f64::EPSILON * mean {
        return mean;
    }
    let angle = (0.5 * (deviator * (1.0 / spread)).determinant()).clamp(-1.0, 1.0).acos() / 3.0;
    mean + 2.0 * spread * (angle + core::f64::consts::TAU / 3.0).cos()
}

#[cfg(test)]
mod tests {
    use glam::DQuat;

    use super::*;
    use vps::mesh::primitives::Shape;

    #[test]
    fn the_least_principal_moment_does_not_depend_on_the_axes() {
        for moments in
            [DVec3::new(8.3e-7, 8.4e-5, 8.4e-5), DVec3::new(3e-6, 1e-6, 2e-6), DVec3::splat(1e-5)]
        {
            for turn in [DVec3::ZERO, DVec3::new(0.3, -1.2, 0.7), DVec3::new(2.0, 0.1, -0.4)] {
                let axes = DMat3::from_quat(DQuat::from_scaled_axis(turn));
                let least =
                    least_eigenvalue(axes * DMat3::from_diagonal(moments) * axes.transpose());
                assert!(
                    (least / moments.min_element() - 1.0).abs() < 1e-9,
                    "{moments} turned by {turn}: {least}"
                );
            }
        }
    }

    #[test]
    fn inertia_counts_about_the_centre_that_the_options_name() {
        // Two points of half the mass each, as far from the middle as the box's turning asks for:
        // I/m about the middle is that of the mass's spread.
        let spread = DVec3::new(0.01, 0.02, 0.03);
        let outer = |v: DVec3| DMat3::from_cols(v * v.x, v * v.y, v * v.z);
        let of_points = |at: &[DVec3]| {
            let n = at.len() as f64;
            at.iter().fold(DMat3::ZERO, |sum, v| {
                sum + (DMat3::IDENTITY * v.length_squared() - outer(*v)) * (1.0 / n)
            })
        };
        let center_m = DVec3::new(-0.1, 0.2, 0.05);
        let mass = MassProperties {
            center_m,
            inertia_per_mass: of_points(&[spread, -spread]),
            volume_m3: 1e-5,
            from_surface: false,
        };
        let options = ToolOptions::new(0.4);
        let about = DVec3::new(0.02, -0.03, 0.01);
        let made = inertia(&options, &mass, 0.2, about);
        let arms = [center_m + spread - about, center_m - spread - about];
        let floor = DMat3::IDENTITY * (0.05_f64 * 0.2).powi(2);
        let expected = (of_points(&arms) + floor) * 0.4;
        let differs = made.body_kg_m2 - expected;
        assert!(differs.to_cols_array().iter().all(|entry| entry.abs() < 1e-15), "{differs}");
        assert_eq!(made.mass_kg, 0.4);
        assert_eq!(made.least_kg_m2, least_eigenvalue(made.body_kg_m2));
        let named = ToolOptions { inertia_kg_m2: Some(DMat3::IDENTITY * 3e-5), ..options };
        assert_eq!(inertia(&named, &mass, 0.2, about).body_kg_m2, DMat3::IDENTITY * 3e-5);
    }

    #[test]
    fn gradients_are_baked_for_the_field_that_reads_them() {
        for (field, needs) in [(FieldKind::SurfacePoint, true), (FieldKind::Trilinear, false)] {
            let mut p = crate::testing::parameters();
            p.contact.field = field;
            assert_eq!(SceneBuilder::new(p).needs_gradients(), needs);
        }
    }

    #[test]
    fn a_part_that_is_added_stands_where_it_was_put_and_is_reported() {
        let part = Part::of_shape("block", &Shape::Box { size_m: DVec3::splat(8e-3) }, 1e-3);
        let stands = Pose::from_translation(DVec3::new(0.1, -0.2, 0.3));
        let mut builder = SceneBuilder::new(crate::testing::parameters());
        assert!(builder.add_part(&part, &Options::new(1e-3), stands).is_ok());
        let poses = builder.obstacles.iter().map(|obstacle| obstacle.world_from_map);
        assert!(poses.eq([stands]));
        assert_eq!(builder.reports.len(), 1);
    }
}
