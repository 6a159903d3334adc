//! A checked scene in, a baked one out.

use super::cache::{Baked, Cache, Request, Spacing};
use super::loaded_clay::LoadedClay;
use super::object::{self, BakeOptions, MemoryPlan, SceneError};
use crate::config::SceneConfig;
use crate::config::scene::{MeshSource, StaticConfig, ToolConfig};
use haptics::clay::{Clay, PUT_DOWN_SPACINGS};
use haptics::{RenderScene, SceneBuilder, ToolOptions};
use recording::at_least;
use vps::contact::ContactSum;
use vps::part::{ObjectReport, Part, PartError, PartRole};
use vps::pointshell::Points;
use vps::spatial::{Metres, Pose};
use vps::voxmap::border::Border;
use vps::voxmap::{BakeStage, Options};

/// Progress of a bake.
#[derive(Clone, Copy, Debug)]
pub struct BakeEvent<'a> {
    /// Name of the object at work.
    pub name: &'a str,
    /// Number of the object, from 0.
    pub object_idx: usize,
    /// Objects in the scene.
    pub n_objects: usize,
    /// Stage that begins.
    pub stage: BakeStage,
}

/// Bakes every object of a scene, without a cache and whatever memory it takes. Runs on the current
/// rayon pool; the result does not depend on its size.
///
/// # Errors
/// The first object whose mesh cannot be used or whose grid is too large.
pub fn build(
    config: &SceneConfig,
    watch: impl FnMut(BakeEvent<'_>),
) -> Result<(RenderScene, Vec<ObjectReport>), SceneError> {
    build_with(config, &mut BakeOptions::from(&mut Cache::off()), watch)
}

/// The same, taking from the cache what it has and giving it what it has not; bit for bit the same
/// scene. Memory is judged for each object that is baked, after its mesh was read and before the
/// work.
///
/// # Errors
/// As [`build`], and an object that would take too much memory; the cache adds none.
pub fn build_with(
    config: &SceneConfig,
    options: &mut BakeOptions<'_>,
    watch: impl FnMut(BakeEvent<'_>),
) -> Result<(RenderScene, Vec<ObjectReport>), SceneError> {
    build_all(config, options, watch).map(|Built { scene, objects, .. }| (scene, objects))
}

/// A scene with all that was made for it.
#[derive(Debug)]
pub struct Built {
    /// What the tick reads.
    pub scene: RenderScene,
    /// A report on each object, the tool last.
    pub objects: Vec<ObjectReport>,
    /// The clay, where the scene has some.
    pub model: Option<LoadedClay>,
}

/// The same with the clay, for commands that sculpt it.
///
/// # Errors
/// As [`build_with`], and clay that cannot be read or makes no surface.
pub fn build_all(
    config: &SceneConfig,
    options: &mut BakeOptions<'_>,
    mut watch: impl FnMut(BakeEvent<'_>),
) -> Result<Built, SceneError> {
    let n_objects = config.statics.len() + 1 + usize::from(config.sculpt.is_some());
    let mut builder = SceneBuilder::new(config.parameters);
    for (object_idx, object) in config.statics.iter().enumerate() {
        let tell = |stage| watch(BakeEvent { name: &object.name, object_idx, n_objects, stage });
        let request = static_request(object, builder.needs_gradients());
        let Baked { field, report, .. } = object::obtain(&request, options, tell)?;
        let Some(field) = field else { unreachable!("a static object has a field") };
        builder.add_baked_part(field, report, object.pose);
    }

    let ToolConfig { mass_kg, center_of_mass_m, inertia_kg_m2, .. } = &config.tool;
    let tell = |stage| {
        watch(BakeEvent { name: "tool", object_idx: config.statics.len(), n_objects, stage })
    };
    let request = tool_request(&config.tool);
    let Baked { shell, mass, report, .. } = object::obtain(&request, options, tell)?;
    let (Some(shell), Some(mass)) = (shell, mass) else {
        unreachable!("a tool has a shell and a mass")
    };
    let mut model = None;
    if let Some(sculpt) = &config.sculpt {
        watch(BakeEvent {
            name: "clay",
            object_idx: n_objects - 1,
            n_objects,
            stage: BakeStage::Surface,
        });
        let built = LoadedClay::build(config, sculpt, &options.memory)?;
        builder.set_clay(built.clay(config, sculpt)?);
        model = Some(built);
    }
    let options = ToolOptions {
        mass_kg: *mass_kg,
        center_of_mass_m: *center_of_mass_m,
        inertia_kg_m2: *inertia_kg_m2,
        points: config.tool.points,
    };
    let (scene, mut objects) = builder.finish_baked(shell, &mass, report, &options);
    let warnings = inside_at_start(&scene).or_else(|| inside_clay_at_start(&scene));
    if let Some(tool) = objects.last_mut() {
        tool.warnings.extend(warnings);
    }
    Ok(Built { scene, objects, model })
}

/// Looks at every part of a scene as [`build_all`] does before its work: reads it, judges its grid
/// and memory, and bakes nothing. `see` gets each part with its source and the edge of its voxels, m.
///
/// # Errors
/// Those of [`build_all`] that come before any work.
pub fn look_at_parts(
    config: &SceneConfig,
    memory: &mut MemoryPlan<'_>,
    mut see: impl FnMut(&Part, &MeshSource, &Options),
) -> Result<(), PartError> {
    for request in requests(config) {
        let part = object::load(request.name, request.source, request.spacing)?;
        let options = request.options(&part);
        see(&part, request.source, &options);
        memory.judge(&part, &options, request.products())?;
    }
    Ok(())
}

/// Surfaces of the static objects of a scene, each made when it is asked for: a part is read and
/// cut into voxels anew for it.
#[derive(Debug)]
pub struct Borders<'a> {
    config: &'a SceneConfig,
    borders: Vec<Option<Border<'static>>>,
}

impl<'a> Borders<'a> {
    /// None is made yet.
    pub fn new(config: &'a SceneConfig) -> Self {
        Self { config, borders: config.statics.iter().map(|_| None).collect() }
    }

    /// Makes that of an object.
    ///
    /// # Errors
    /// A part that cannot be used any more.
    pub fn make(&mut self, object_idx: usize) -> Result<(), PartError> {
        let object = self.config.statics.get(object_idx);
        let border = self.borders.get_mut(object_idx).filter(|border| border.is_none());
        if let (Some(object), Some(border)) = (object, border) {
            let request = static_request(object, false);
            let part = object::load(request.name, request.source, request.spacing)?;
            border.replace(part.border(&request.options(&part))?);
        }
        Ok(())
    }

    /// That of an object; `None`: it was not made.
    pub fn of(&self, object_idx: usize) -> Option<&Border<'static>> {
        self.borders.get(object_idx)?.as_ref()
    }
}

/// What is baked of each object: the fixed ones in the order of the scene, then the tool.
pub(crate) fn requests(config: &SceneConfig) -> impl Iterator<Item = Request<'_>> {
    let needs_gradients = SceneBuilder::new(config.parameters).needs_gradients();
    let statics = config.statics.iter().map(move |object| static_request(object, needs_gradients));
    statics.chain([tool_request(&config.tool)])
}

fn static_request(object: &StaticConfig, with_gradients: bool) -> Request<'_> {
    Request {
        name: &object.name,
        role: PartRole::Static,
        source: &object.source,
        spacing: Spacing::Size(object.voxel_size_m),
        layers: object.layers,
        sides: object.sides,
        with_gradients,
        points: Points::default(),
        center_of_mass: None,
    }
}

fn tool_request(tool: &ToolConfig) -> Request<'_> {
    Request {
        name: "tool",
        role: PartRole::Tool,
        source: &tool.source,
        spacing: Spacing::Size(tool.voxel_size_m),
        layers: tool.layers,
        sides: tool.sides,
        with_gradients: false,
        points: tool.points,
        center_of_mass: tool.center_of_mass_m,
    }
}

/// What to say of a tool that stands in an obstacle when the arm is enabled.
fn inside_at_start(scene: &RenderScene) -> Option<String> {
    let RenderScene { parameters, obstacles, tool, .. } = scene;
    let world_from_body =
        parameters.mapping.start * Pose::from_translation(tool.center_of_mass_tool);
    let sum = ContactSum::flat(obstacles, &tool.shell, world_from_body, parameters.force_law());
    // A tenth of a voxel is a tool that was put down, not one that was put inside.
    (sum.contacts > 0 && sum.max_value_m > 0.1 * sum.voxel_size_m).then(|| {
        format!(
            "it starts inside a part, {}{:.3} mm deep with {} points: move `tool.start_position_mm`",
            at_least(sum.depth_is_bound),
            sum.max_value_m * 1e3,
            sum.contacts
        )
    })
}

/// The same of clay.
fn inside_clay_at_start(scene: &RenderScene) -> Option<String> {
    let RenderScene { parameters, clay, tool, .. } = scene;
    let Clay { world_from_map, frame, .. } = clay.as_ref()?;
    let map_from_body = world_from_map.inverse()
        * parameters.mapping.start
        * Pose::from_translation(tool.center_of_mass_tool);
    let points = tool.shell.points().map(|(position_body, _)| position_body);
    let inside = points
        .filter_map(|at| frame.at(map_from_body.transform_point(at.as_dvec3())))
        .map(|density| f64::from(density.value_m));
    let mut n_inside = 0;
    let mut deepest_m = 0.0_f64;
    for value_m in inside.filter(|value_m| *value_m > 0.0) {
        (n_inside, deepest_m) = (n_inside + 1, deepest_m.max(value_m));
    }
    (deepest_m > PUT_DOWN_SPACINGS * frame.base.lattice().spacing_m).then(|| {
        format!(
            "it starts inside the clay, {} deep with {n_inside} points: no force flows and nothing \
                is worked before it has been outside; move `tool.start_position_mm`",
            Metres(deepest_m)
        )
    })
}
