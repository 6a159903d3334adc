//! A checked scene in, a baked one out.

use glam::{DMat3, DVec3};

use super::cache::{Baked, Cache, Request, Spacing};
use super::loaded_clay::LoadedClay;
use super::object::{self, BakeMeans, SceneError};
use super::report::{ObjectReport, Role};
use crate::config::SceneConfig;
use crate::config::scene::ToolConfig;
use haptics::clay::{Clay, PUT_DOWN_SPACINGS};
use haptics::{Inertia, RenderScene, Tool};
use vps::contact::{ContactSum, Obstacle};
use vps::mesh::mass::MassProperties;
use vps::spatial::{Metres, Pose};
use vps::voxmap::Stage;
use vps::voxmap::field::FieldKind;

/// What a watcher is told while a scene is baked.
#[derive(Clone, Copy, Debug)]
pub struct Event<'a> {
    /// Name of the object at work.
    pub name: &'a str,
    /// Number of the object, from 0.
    pub object_idx: usize,
    /// Objects in the scene.
    pub n_objects: usize,
    /// Stage that begins.
    pub stage: Stage,
}

/// A radius of gyration that no real tool falls below, as a share of its size: keeps the rotational step well-conditioned for
/// needles, whose moment about their own axis is next to nothing.
const GYRATION_SHARE: f64 = 0.05;

/// Bakes every object of a scene, without a cache and whatever memory it takes. Runs on the current rayon pool; the result does not depend on its size.
///
/// # Errors
/// The first object whose mesh cannot be used or whose grid is too large.
pub fn build(config: &SceneConfig, watch: impl FnMut(Event<'_>)) -> Result<(RenderScene, Vec<ObjectReport>), SceneError> {
    build_with(config, &mut BakeMeans::from(&mut Cache::off()), watch)
}

/// The same, taking from the cache what it has and giving it what it has not; bit for bit the same scene. Memory is judged for each
/// object that is baked, after its mesh was read and before the work.
///
/// # Errors
/// As [`build`], and an object that would take too much memory; the cache adds none.
pub fn build_with(
    config: &SceneConfig,
    means: &mut BakeMeans<'_>,
    watch: impl FnMut(Event<'_>),
) -> Result<(RenderScene, Vec<ObjectReport>), SceneError> {
    build_all(config, means, watch).map(|Built { scene, objects, .. }| (scene, objects))
}

/// A scene with all that was made for it.
#[derive(Debug)]
pub struct Built {
    /// What the tick reads.
    pub scene: RenderScene,
    /// A report on each object, the tool last.
    pub objects: Vec<ObjectReport>,
    /// The clay, where the scene has some.
    pub piece: Option<LoadedClay>,
}

/// The same with the clay, for those who work it.
///
/// # Errors
/// As [`build_with`], and clay that cannot be read or makes no surface.
pub fn build_all(config: &SceneConfig, means: &mut BakeMeans<'_>, mut watch: impl FnMut(Event<'_>)) -> Result<Built, SceneError> {
    let n_objects = config.statics.len() + 1 + usize::from(config.sculpt.is_some());
    let mut reports = Vec::with_capacity(n_objects);
    let mut obstacles = Vec::with_capacity(config.statics.len());
    let with_gradients = config.parameters.contact.field == FieldKind::SurfacePoint;
    for (object_idx, object) in config.statics.iter().enumerate() {
        let tell = |stage| watch(Event { name: &object.name, object_idx, n_objects, stage });
        let request = Request {
            name: &object.name,
            role: Role::Static,
            source: &object.source,
            spacing: Spacing::Size(object.voxel_size_m),
            layers: object.layers,
            sides: object.sides,
            with_gradients,
            center_of_mass: None,
        };
        let Baked { field, report, .. } = object::obtain(&request, means, tell)?;
        reports.push(report);
        let Some(field) = field else { unreachable!("a static object has a field") };
        obstacles.push(Obstacle { field, world_from_map: object.pose });
    }

    let tell = |stage| watch(Event { name: "tool", object_idx: config.statics.len(), n_objects, stage });
    let request = Request {
        name: "tool",
        role: Role::Tool,
        source: &config.tool.source,
        spacing: Spacing::Size(config.tool.voxel_size_m),
        layers: config.tool.layers,
        sides: config.tool.sides,
        with_gradients: false,
        center_of_mass: config.tool.center_of_mass_m,
    };
    let Baked { shell, mass, report: mut tool_report, .. } = object::obtain(&request, means, tell)?;
    let (Some(shell), Some(mass)) = (shell, mass) else { unreachable!("a tool has a shell and a mass") };
    let shell = if config.knows_edges { shell } else { shell.without_edges() };
    let center_of_mass_tool = config.tool.center_of_mass_m.unwrap_or(mass.center_m);
    let inertia = inertia(&config.tool, &mass, shell.radius_m(), center_of_mass_tool);
    let tool = Tool { shell, inertia, center_of_mass_tool };
    let mut scene = RenderScene { parameters: config.parameters, obstacles, clay: None, tool };
    let mut piece = None;
    if let Some(sculpt) = &config.sculpt {
        watch(Event { name: "clay", object_idx: n_objects - 1, n_objects, stage: Stage::Surface });
        let built = LoadedClay::build(config, sculpt, &means.memory)?;
        scene.clay = Some(built.clay(config, sculpt)?);
        piece = Some(built);
    }
    tool_report.warnings.extend(inside_at_start(&scene).or_else(|| inside_clay_at_start(&scene)));
    reports.push(tool_report);
    Ok(Built { scene, objects: reports, piece })
}

/// What to say of a tool that stands in an obstacle when the arm is enabled.
fn inside_at_start(scene: &RenderScene) -> Option<String> {
    let RenderScene { parameters, obstacles, tool, .. } = scene;
    let world_from_body = parameters.mapping.start * Pose::from_translation(tool.center_of_mass_tool);
    let sum = ContactSum::flat(obstacles, &tool.shell, world_from_body, parameters.force_law());
    // A tenth of a voxel is a tool that was put down, not one that was put inside.
    (sum.contacts > 0 && sum.max_value_m > 0.1 * sum.voxel_size_m).then(|| {
        format!(
            "it starts inside a part, {:.3} mm deep with {} points: move `tool.start_position_mm`",
            sum.max_value_m * 1e3,
            sum.contacts
        )
    })
}

/// The same of clay.
fn inside_clay_at_start(scene: &RenderScene) -> Option<String> {
    let RenderScene { parameters, clay, tool, .. } = scene;
    let Clay { world_from_map, frame, .. } = clay.as_ref()?;
    let map_from_body = world_from_map.inverse() * parameters.mapping.start * Pose::from_translation(tool.center_of_mass_tool);
    let points = tool.shell.points().map(|(position_body, _)| position_body);
    let inside =
        points.filter_map(|at| frame.at(map_from_body.transform_point(at.as_dvec3()))).map(|density| f64::from(density.value_m));
    let (mut n_inside, mut deepest_m) = (0, 0.0_f64);
    for value_m in inside.filter(|value_m| *value_m > 0.0) {
        (n_inside, deepest_m) = (n_inside + 1, deepest_m.max(value_m));
    }
    (deepest_m > PUT_DOWN_SPACINGS * frame.base.lattice().spacing_m).then(|| {
        format!(
            "it starts inside the clay, {} deep with {n_inside} points: no force flows and nothing is worked before it has been outside; move \
             `tool.start_position_mm`",
            Metres(deepest_m)
        )
    })
}

/// The tool's inertia: as configured, or from the mesh about the configured centre of mass.
fn inertia(tool: &ToolConfig, mass: &MassProperties, radius_m: f64, center_of_mass_tool: DVec3) -> Inertia {
    let shift = mass.center_m - center_of_mass_tool;
    // Parallel axes, for a centre of mass that is not the mesh's own.
    let outer = DMat3::from_cols(shift * shift.x, shift * shift.y, shift * shift.z);
    let about_center = mass.inertia_per_mass + DMat3::IDENTITY * shift.length_squared() - outer;
    let floor = (GYRATION_SHARE * radius_m).powi(2);
    let body_kg_m2 = tool.inertia_kg_m2.unwrap_or((about_center + DMat3::IDENTITY * floor) * tool.mass_kg);
    Inertia { mass_kg: tool.mass_kg, body_kg_m2, least_kg_m2: least_eigenvalue(body_kg_m2) }
}

/// Smallest eigenvalue of a symmetric matrix, by the trigonometric solution of its characteristic cubic.
fn least_eigenvalue(matrix: DMat3) -> f64 {
    let mean = (matrix.x_axis.x + matrix.y_axis.y + matrix.z_axis.z) / 3.0;
    let deviator = matrix - DMat3::IDENTITY * mean;
    let spread =
        ((deviator.x_axis.length_squared() + deviator.y_axis.length_squared() + deviator.z_axis.length_squared()) / 6.0).sqrt();
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

    #[test]
    fn the_least_principal_moment_does_not_depend_on_the_axes() {
        for moments in [DVec3::new(8.3e-7, 8.4e-5, 8.4e-5), DVec3::new(3e-6, 1e-6, 2e-6), DVec3::splat(1e-5)] {
            for turn in [DVec3::ZERO, DVec3::new(0.3, -1.2, 0.7), DVec3::new(2.0, 0.1, -0.4)] {
                let axes = DMat3::from_quat(DQuat::from_scaled_axis(turn));
                let least = least_eigenvalue(axes * DMat3::from_diagonal(moments) * axes.transpose());
                assert!((least / moments.min_element() - 1.0).abs() < 1e-9, "{moments} turned by {turn}: {least}");
            }
        }
    }
}
