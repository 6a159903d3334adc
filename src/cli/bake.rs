//! `hapticd bake`: generation only, with figures.

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::ValueEnum;
use serde::Serialize;

use super::progress::BakeProgress;
use super::{Talk, cache, check, destination, memory, report, say};
use crate::config;
use crate::config::problem::show;
use crate::config::scene::MeshSource;
use crate::error::Exit;
use crate::mesh::MeshError;
use crate::picture::{self, Subject};
use crate::pointshell::ply;
use crate::scene::cache::{Baked, Cache, CacheUse, Lookup, Request, Residence, Spacing};
use crate::scene::{self, BakeMeans, Built, Event, Geometry, MemoryPlan, ObjectReport, PieceReport, Role, SceneError};
use crate::voxmap::grid::GridError;
use crate::voxmap::sides::SidesRule;
use crate::voxmap::surface::Navigation;
use crate::voxmap::{Options, Stage, npy};

/// Arguments of `hapticd bake`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// A scene (.toml), or a mesh (.obj, .stl, .ply, .gltf, .glb, .3mf).
    #[arg(value_name = "SCENE|MESH")]
    input: PathBuf,
    /// Voxel edge, mm (mesh only).
    #[arg(long, value_name = "S", conflicts_with = "longest_axis_voxels", allow_negative_numbers = true)]
    voxel_size_mm: Option<f64>,
    /// Voxels on the longest edge of the mesh's box, instead of a size (mesh only).
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    longest_axis_voxels: Option<u32>,
    /// Unit of the numbers in the mesh file; required with --voxel-size-mm, else metres (mesh only).
    #[arg(long, value_name = "UNIT")]
    units: Option<Unit>,
    /// Layers on each side of the surface (mesh only).
    #[arg(long, value_name = "L", value_parser = clap::value_parser!(u32).range(2..=60))]
    layers: Option<u32>,
    /// How candidates are walked; plane-span and two-sided bake without the cache (mesh only).
    #[arg(long, value_name = "HOW")]
    navigation: Option<NavigationChoice>,
    /// How inside and outside are told: by the fill, where it leaks by winding numbers or else as a thin skin (auto); only what the
    /// fill left is inside (flood); with lids on holes (winding); a two-sided skin (thin) (mesh only).
    #[arg(long, value_name = "HOW")]
    sides: Option<SidesChoice>,
    /// Threads; all processors if not given.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024))]
    threads: Option<u32>,
    #[command(flatten)]
    memory: memory::MemoryArgs,
    /// Write the layer values as int8, shape [nx, ny, nz]; bakes without the cache, as all output files do (mesh only).
    #[arg(long, value_name = "F.npy")]
    voxmap_out: Option<PathBuf>,
    /// Write the signed distances in metres as float32, NaN beyond the band (mesh only).
    #[arg(long, value_name = "F.npy")]
    field_out: Option<PathBuf>,
    /// Write the points and inward normals as binary PLY, metres (mesh only).
    #[arg(long, value_name = "F.ply")]
    pointshell_out: Option<PathBuf>,
    /// Draw three cuts through the map with the shell on them (mesh only).
    #[arg(long, value_name = "F.png")]
    picture: Option<PathBuf>,
    #[command(flatten)]
    cache: cache::CacheArgs,
    /// Print exactly one JSON object.
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Unit {
    M,
    Mm,
    Cm,
    In,
}

impl Unit {
    fn metres(self) -> f64 {
        match self {
            Self::M => 1.0,
            Self::Mm => 1e-3,
            Self::Cm => 1e-2,
            Self::In => 0.0254,
        }
    }
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum NavigationChoice {
    PlaneSpan,
    TwoSided,
    Auto,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum SidesChoice {
    Auto,
    Flood,
    Winding,
    Thin,
}

impl From<SidesChoice> for SidesRule {
    fn from(choice: SidesChoice) -> Self {
        match choice {
            SidesChoice::Auto => Self::Auto,
            SidesChoice::Flood => Self::Flood,
            SidesChoice::Winding => Self::Winding,
            SidesChoice::Thin => Self::Thin,
        }
    }
}

/// Layers where none are asked for: the default of the scene file.
const DEFAULT_LAYERS: u32 = 8;

/// Largest voxel edge: that of the scene file.
const VOXEL_SIZE_MAX_MM: f64 = 1000.0;

/// Why baking ended early.
enum Failure {
    Usage(String),
    Scene(SceneError),
    Write(PathBuf, std::io::Error),
}

impl From<SceneError> for Failure {
    fn from(error: SceneError) -> Self {
        Self::Scene(error)
    }
}

pub(crate) fn main(args: &Args, talk: Talk) -> Exit {
    if let Some(n_threads) = args.threads {
        // The pool of the process: nothing has used it before.
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads as usize).build_global();
        debug_assert!(pool.is_ok(), "the global pool is built once");
    }
    let is_scene = args.input.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("toml"));
    let outcome = if is_scene { bake_scene(args, talk) } else { bake_mesh(args, talk).map(|()| Exit::Ok) };
    match outcome {
        Ok(exit) => exit,
        Err(Failure::Usage(message)) => {
            report::error(&message, None, talk);
            Exit::Usage
        }
        Err(Failure::Scene(error)) if is_scene => report::scene_error(&error, talk),
        Err(Failure::Scene(error)) => mesh_error(args, &error, talk),
        Err(Failure::Write(path, error)) => {
            report::error(&format!("cannot write {}: {error}", path.display()), destination::hint(&error), talk);
            Exit::Asset
        }
    }
}

/// A mesh of the command line: no scene that it could be relative to, and flags instead of keys.
fn mesh_error(args: &Args, error: &SceneError, talk: Talk) -> Exit {
    match error {
        SceneError::Mesh { source, .. } => {
            let hint = if matches!(source, MeshError::Missing { .. }) { None } else { source.hint() };
            report::error(&source.to_string(), hint, talk);
            Exit::Asset
        }
        SceneError::Grid { source, .. } => {
            let hint = match (source, args.longest_axis_voxels) {
                (GridError::TooLarge { .. } | GridError::Surface { .. }, Some(_)) => {
                    "ask for fewer --longest-axis-voxels".to_owned()
                }
                (GridError::TooLarge { .. } | GridError::Surface { .. }, None) => source.hint().replace("`units`", "--units"),
                (GridError::Memory { asked_m, voxel_size_m: Some(fits_m), .. }, Some(n)) => {
                    let n_fits = (f64::from(n) * asked_m / fits_m).floor();
                    format!("use at most --longest-axis-voxels {n_fits}, fewer --layers, or a larger --max-memory")
                }
                (GridError::Memory { .. } | GridError::VoxelSize(_), _) => source.hint(),
            };
            report::error(&format!("{}: {source}", args.input.display()), Some(&hint), talk);
            Exit::Configuration
        }
        // A mesh has no clay.
        SceneError::Load(_) | SceneError::Session(_) | SceneError::Piece(_) | SceneError::Frame(_) => {
            report::scene_error(error, talk)
        }
    }
}

fn bake_scene(args: &Args, talk: Talk) -> Result<Exit, Failure> {
    let mesh_only = [
        ("--voxel-size-mm", args.voxel_size_mm.is_some()),
        ("--longest-axis-voxels", args.longest_axis_voxels.is_some()),
        ("--units", args.units.is_some()),
        ("--layers", args.layers.is_some()),
        ("--navigation", args.navigation.is_some()),
        ("--sides", args.sides.is_some()),
        ("--voxmap-out", args.voxmap_out.is_some()),
        ("--field-out", args.field_out.is_some()),
        ("--pointshell-out", args.pointshell_out.is_some()),
        ("--picture", args.picture.is_some()),
    ];
    if let Some((flag, _)) = mesh_only.iter().find(|(_, given)| *given) {
        return Err(Failure::Usage(format!("{flag} goes with a mesh; a scene says it in its file")));
    }
    let config = match config::load(&args.input) {
        Ok(config) => config,
        Err(errors) => return Ok(report::config_errors(&errors, talk)),
    };
    if talk.verbose > 0 {
        say::talk(format_args!("{}\n", check::summary(&config)));
    }
    let since = Instant::now();
    let mut cache = args.cache.open(Residence::Mapped, talk);
    let progress = BakeProgress::new(talk);
    let mut means = BakeMeans { cache: &mut cache, memory: args.memory.plan(&progress, talk) };
    let baked = scene::build_all(&config, &mut means, |event| progress.tell(&event));
    drop(means);
    progress.finish();
    cache::tell(&mut cache, talk);
    let Built { objects: reports, piece, .. } = baked?;
    let clay = piece.map(|piece| piece.report);
    let total_s = since.elapsed().as_secs_f64();
    report::bake_warnings(&reports, talk);
    if let Some(clay) = &clay {
        report::clay_warnings(clay, talk);
    }
    if args.json {
        #[derive(Serialize)]
        struct Total {
            total: f64,
        }
        #[derive(Serialize)]
        struct SceneReport {
            objects: Vec<ObjectReport>,
            #[serde(skip_serializing_if = "Option::is_none")]
            clay: Option<PieceReport>,
            timings_s: Total,
            peak_rss_bytes: Option<u64>,
        }
        let timings_s = Total { total: total_s };
        print_json(&SceneReport { objects: reports, clay, timings_s, peak_rss_bytes: peak_rss_bytes() });
    } else {
        reports.iter().for_each(|object| say::result(format_args!("{}", report_text(object))));
        if let Some(clay) = &clay {
            say::result(format_args!("{}", clay_text(clay)));
        }
        say::result(format_args!("{} objects in {total_s:.2} s\n", reports.len() + usize::from(clay.is_some())));
    }
    Ok(Exit::Ok)
}

fn bake_mesh(args: &Args, talk: Talk) -> Result<(), Failure> {
    let metres_per_unit = match (args.units, args.voxel_size_mm, args.longest_axis_voxels) {
        (_, None, None) => return Err(Failure::Usage("a mesh needs --voxel-size-mm S or --longest-axis-voxels N".into())),
        (None, Some(_), _) => return Err(Failure::Usage("--voxel-size-mm needs --units m|mm|cm|in of the mesh file".into())),
        (Some(unit), ..) => unit.metres(),
        (None, None, Some(_)) => 1.0,
    };
    if let Some(size_mm) = args.voxel_size_mm.filter(|size_mm| !(*size_mm > 0.0 && *size_mm <= VOXEL_SIZE_MAX_MM)) {
        return Err(Failure::Usage(format!(
            "--voxel-size-mm {size_mm}: must be greater than 0 and at most {VOXEL_SIZE_MAX_MM} mm"
        )));
    }
    // Before the work, not after it.
    let outputs = [&args.voxmap_out, &args.field_out, &args.pointshell_out, &args.picture];
    for path in outputs.into_iter().flatten() {
        destination::check(path).map_err(|error| Failure::Write(path.clone(), error))?;
        // Both exist, or one is no file yet: then there is nothing to lose.
        if let (Ok(output), Ok(input)) = (path.canonicalize(), args.input.canonicalize())
            && output == input
        {
            return Err(Failure::Usage(format!("{} is the mesh itself: name another file to write", path.display())));
        }
    }
    if let Some(path) = &args.picture
        && !path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("png"))
    {
        return Err(Failure::Usage(format!("--picture {}: a picture is a .png", path.display())));
    }
    let name = args.input.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let source = MeshSource::File { path: args.input.clone(), metres_per_unit };
    let request = Request {
        name: &name,
        role: Role::Mesh,
        source: &source,
        spacing: match (args.voxel_size_mm, args.longest_axis_voxels) {
            (Some(size_mm), _) => Spacing::Size(size_mm * 1e-3),
            (None, n) => Spacing::LongestAxis(n.unwrap_or(1)),
        },
        layers: args.layers.unwrap_or(DEFAULT_LAYERS),
        sides: args.sides.map_or(SidesRule::Auto, SidesRule::from),
        with_gradients: false,
        center_of_mass: None,
    };
    // The cache has neither layers nor distances by voxel, and a navigation that is asked for is asked for its figures.
    let navigation = match args.navigation {
        Some(NavigationChoice::PlaneSpan) => Some(Navigation::PlaneSpan),
        Some(NavigationChoice::TwoSided) => Some(Navigation::TwoSided),
        Some(NavigationChoice::Auto) | None => None,
    };
    let needs_more = navigation.is_some() || outputs.iter().any(|output| output.is_some());
    let mut cache = if needs_more { Cache::off() } else { args.cache.open(Residence::Mapped, talk) };
    if args.units.is_none() {
        report::note("the numbers of the mesh file are taken as metres; --units m|mm|cm|in says otherwise", talk);
    }
    // JSON has it under "cache".
    if needs_more && !args.cache.is_off() && !args.json {
        report::note("baked without the cache, which has neither layers nor distances by voxel nor what a navigation costs", talk);
    }
    let progress = BakeProgress::new(talk);
    let tell = |stage| progress.tell(&Event { name: &name, object_idx: 0, n_objects: 1, stage });
    tell(Stage::Load);
    let baked = match cache.look_up(&request) {
        Lookup::Hit(baked) => *baked,
        Lookup::Bake(slot) => {
            let mut memory = args.memory.plan(&progress, talk);
            let mut baked = generate(args, &request, navigation, &mut memory, tell)?;
            baked.report.cache = slot.cache;
            cache.store(&slot, &request, &baked);
            baked
        }
    };
    progress.finish();
    cache::tell(&mut cache, talk);

    let Baked { field, shell, report: object, .. } = baked;
    report::bake_warnings(core::slice::from_ref(&object), talk);
    if args.json {
        #[derive(Serialize)]
        struct MeshReport {
            #[serde(flatten)]
            object: ObjectReport,
            field_bytes: usize,
            pointshell_bytes: usize,
            peak_rss_bytes: Option<u64>,
        }
        let report = MeshReport {
            object,
            field_bytes: field.map_or(0, |field| field.heap_bytes()),
            pointshell_bytes: shell.map_or(0, |shell| shell.heap_bytes()),
            peak_rss_bytes: peak_rss_bytes(),
        };
        print_json(&report);
    } else {
        say::result(format_args!("{}", report_text(&object)));
    }
    Ok(())
}

/// Bakes a mesh on its own and writes the files that are asked for.
fn generate(
    args: &Args,
    request: &Request<'_>,
    navigation: Option<Navigation>,
    memory: &mut MemoryPlan<'_>,
    tell: impl Fn(Stage),
) -> Result<Baked, Failure> {
    let geometry = Geometry::load(request.name, request.role, request.source, request.spacing)?;
    let options =
        Options { voxel_size_m: geometry.voxel_size_m(request.spacing), layers: request.layers, navigation, sides: request.sides };
    geometry.foresee(&options, request.products(), memory)?;
    let mut map = geometry.voxmap(&options, &tell)?;
    tell(Stage::Distance);
    if let Some(path) = &args.field_out {
        let distances = map.distances(&geometry.mesh, false);
        write(path, |path| npy::write_distances(path, &map.layers, &distances))?;
    }
    let field = geometry.field(&mut map, request.with_gradients);
    tell(Stage::Pointshell);
    let mass = geometry.mass_properties();
    let center_of_mass = request.center_of_mass.unwrap_or(mass.center_m);
    let (shell, shell_report) = geometry.shell(&map, center_of_mass);
    if let Some(path) = &args.voxmap_out {
        write(path, |path| npy::write_layers(path, &map.layers))?;
    }
    if let Some(path) = &args.pointshell_out {
        write(path, |path| ply::write(path, &shell, center_of_mass))?;
    }
    if let Some(path) = &args.picture {
        let subject = Subject {
            name: request.name,
            surface: &map.surface,
            layers: &map.layers,
            shell: &shell,
            center_of_mass_tool: center_of_mass,
            thin: map.thin,
        };
        write(path, |path| picture::write(path, &subject))?;
    }
    let report = geometry.report(&map, &shell_report);
    Ok(Baked { field: Some(field), shell: Some(shell), mass: Some(mass), report })
}

fn write(path: &Path, export: impl FnOnce(&Path) -> std::io::Result<()>) -> Result<(), Failure> {
    export(path).map_err(|error| Failure::Write(path.to_owned(), error))
}

/// One object, in one line of JSON with the keys in the order of the struct.
pub(super) fn print_json(report: &impl Serialize) {
    match serde_json::to_string(report) {
        Ok(text) => say::result(format_args!("{text}\n")),
        // True invariant: numbers, names and flags, no map with odd keys.
        Err(error) => unreachable!("plain data: {error}"),
    }
}

/// An object's figures for people.
pub(super) fn report_text(object: &ObjectReport) -> String {
    let [nx, ny, nz] = object.dims;
    let t = &object.timings_s;
    let mut lines = vec![
        format!("{} ({} triangles)", object.name, object.triangles),
        format!("  grid        {nx} x {ny} x {nz} = {} voxels of {} mm", object.voxels, show(object.voxel_size_m * 1e3)),
        format!(
            "  voxels      {} surface, {} inside, {} outside, {} layers, {}",
            object.surface_voxels,
            object.inside_voxels,
            object.outside_voxels,
            object.layers,
            if object.watertight { "watertight" } else { "leaking" }
        ),
        format!("  navigation  {}, {} SAT tests", object.navigation, object.sat_tests),
    ];
    if object.points > 0 {
        lines.push(format!("  points      {} ({} phase 1, {} phase 2)", object.points, object.phase1_points, object.phase2_points));
        let levels: Vec<String> = object.tree_levels.iter().map(|level| level.points.to_string()).collect();
        let leaf_mm = object.tree_levels.iter().rev().nth(1).map_or(0.0, |level| level.mean_radius_m * 1e3);
        lines.push(format!("  tree        {} points by level, leaf spheres of {leaf_mm:.3} mm on average", levels.join(", ")));
    }
    if object.cache == CacheUse::Hit {
        lines.push(format!("  seconds     {:.3} from the bake cache", t.load));
        lines.push(String::new());
        return lines.join("\n");
    }
    lines.push(format!(
        "  seconds     load {:.3}, surface {:.3}, fill {:.3}, layers {:.3}, distance {:.3}, pointshell {:.3}, normals {:.3}, tree {:.3}, total {:.3}",
        t.load, t.surface, t.fill, t.layers, t.distance, t.pointshell, t.normals, t.tree, t.total
    ));
    lines.push(String::new());
    lines.join("\n")
}

/// The clay of a scene, for people.
pub(super) fn clay_text(clay: &PieceReport) -> String {
    let [nx, ny, nz] = clay.raster;
    let volume = clay.volume_m3.map_or("open".to_owned(), |volume_m3| format!("{:.2} mm³", volume_m3 * 1e9));
    let borders = match clay.borders.len() {
        0 => "no border".to_owned(),
        1 => "1 border".to_owned(),
        n => format!("{n} borders"),
    };
    format!(
        "clay ({} samples)\n  surface     {} mm between samples, normals: {}, {}, {borders}, {volume}\n  \
         raster      {nx} x {ny} x {nz} mass points {} mm apart, {} nodes over the whole piece\n  seconds     {:.3}\n",
        clay.samples,
        show(clay.spacing_m * 1e3),
        clay.normals,
        if clay.closed { "closed" } else { "a sheet" },
        show(clay.raster_spacing_m * 1e3),
        clay.nodes,
        clay.seconds,
    )
}

/// Largest resident set of this process so far; `None` where /proc does not say.
fn peak_rss_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kib: u64 = line.trim().trim_end_matches("kB").trim().parse().ok()?;
    Some(kib * 1024)
}
