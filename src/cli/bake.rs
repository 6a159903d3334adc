//! `hapticd bake`: generation only, with figures.

mod figures;
mod mesh;

use std::path::PathBuf;
use std::time::Instant;

use clap::ValueEnum;
use serde::Serialize;

pub(super) use self::figures::{
    accuracy_text, clay_text, overlap_text, press_fit_text, print_json, report_text,
};

use self::figures::peak_rss_bytes;
use self::mesh::bake_mesh;
use super::error::{CliError, Outcome};
use super::memory::MemoryRule;
use super::units::UnitArg;
use super::{OutputOptions, cache, check, memory, output, report};
use crate::config;
use crate::daemon::PrepareError;
use crate::error::Exit;
use crate::scene::cache::CachePolicy;
use crate::scene::{self, Built, ClayReport, ObjectReport};
use vps::voxmap::inside_test::InsideTest;

/// Arguments of `hapticd bake`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// A scene (.toml), or a mesh (.obj, .stl, .ply, .gltf, .glb, .3mf).
    #[arg(value_name = "SCENE|MESH")]
    input: PathBuf,
    /// Voxel edge, mm (mesh only).
    #[arg(
        long,
        value_name = "S",
        conflicts_with = "longest_axis_voxels",
        allow_negative_numbers = true
    )]
    voxel_size_mm: Option<f64>,
    /// Voxels on the longest edge of the mesh's box, instead of a size (mesh only).
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    longest_axis_voxels: Option<u32>,
    /// Unit of the numbers in the mesh file; required with --voxel-size-mm, else metres (mesh
    /// only).
    #[arg(long, value_name = "UNIT")]
    units: Option<UnitArg>,
    /// Layers on each side of the surface (mesh only).
    #[arg(long, value_name = "L", value_parser = clap::value_parser!(u32).range(2..=60))]
    layers: Option<u32>,
    /// How candidates are walked; plane-span and two-sided bake without the cache (mesh only).
    #[arg(long, value_name = "HOW")]
    navigation: Option<NavigationChoice>,
    /// How inside and outside are distinguished: by the fill, where it leaks by winding numbers or
    /// else as a thin skin (auto); only what the fill left is inside (flood); with lids on holes
    /// (winding); a two-sided skin (thin) (mesh only).
    #[arg(long, value_name = "HOW")]
    sides: Option<InsideTestChoice>,
    /// Threads; all processors if not given.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024))]
    threads: Option<u32>,
    #[command(flatten)]
    memory: memory::MemoryArgs,
    /// Write the layer values as int8, shape [nx, ny, nz]; bakes without the cache, as all output
    /// files do (mesh only).
    #[arg(long, value_name = "F.npy")]
    voxmap_out: Option<PathBuf>,
    /// Write the signed distances in metres as float32, NaN beyond the band (mesh only).
    #[arg(long, value_name = "F.npy")]
    field_out: Option<PathBuf>,
    /// Write the points, one for each surface voxel, and inward normals as binary PLY, metres (mesh
    /// only).
    #[arg(long, value_name = "F.ply")]
    pointshell_out: Option<PathBuf>,
    /// Measure 100,000 samples of the field again, exactly, and print the worst error; ends with 70
    /// where one is wrong. Bakes without the cache (mesh only).
    #[arg(long)]
    verify: bool,
    /// Draw three cuts through the map with the shell on them; surface that was left out, skins and
    /// hollows are marked (mesh only).
    #[arg(long, value_name = "F.png")]
    picture: Option<PathBuf>,
    /// Draw polygons, voxmap and pointshell side by side, in three dimensions (mesh only).
    #[arg(long = "picture-3d", value_name = "F.png")]
    picture_3d: Option<PathBuf>,
    #[command(flatten)]
    cache: cache::CacheArgs,
    /// Print exactly one JSON object.
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum NavigationChoice {
    PlaneSpan,
    TwoSided,
    Auto,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum InsideTestChoice {
    Auto,
    Flood,
    Winding,
    Thin,
}

impl From<InsideTestChoice> for InsideTest {
    fn from(choice: InsideTestChoice) -> Self {
        match choice {
            InsideTestChoice::Auto => Self::Auto,
            InsideTestChoice::Flood => Self::Flood,
            InsideTestChoice::Winding => Self::Winding,
            InsideTestChoice::Thin => Self::Thin,
        }
    }
}

pub(crate) fn main(args: &Args, output: OutputOptions) -> Outcome {
    if let Some(n_threads) = args.threads {
        // The pool of the process: nothing has used it before.
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads as usize).build_global();
        debug_assert!(pool.is_ok(), "the global pool is built once");
    }
    let is_scene =
        args.input.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("toml"));
    if is_scene { bake_scene(args, output) } else { bake_mesh(args, output) }?;
    Ok(Exit::Ok)
}

fn bake_scene(args: &Args, output: OutputOptions) -> Result<(), CliError> {
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
        ("--verify", args.verify),
        ("--picture", args.picture.is_some()),
        ("--picture-3d", args.picture_3d.is_some()),
    ];
    if let Some((flag, _)) = mesh_only.iter().find(|(_, given)| *given) {
        let message = format!("{flag} goes with a mesh; a scene says it in its file");
        return Err(CliError::usage(message));
    }
    let config = config::load(&args.input)?;
    if output.verbose > 0 {
        output::message(format_args!("{}\n", check::summary(&config)));
    }
    let since = Instant::now();
    let memory = MemoryRule::Given(&args.memory);
    let baked = args.cache.bake(CachePolicy::Mapped, memory, output, |options, progress| {
        scene::build_all(&config, options, |event| progress.tell(&event))
    });
    let Built { objects: reports, model, .. } =
        baked.map_err(|error| PrepareError::of_scene(&config, error))?;
    let clay = model.map(|model| model.report);
    let total_s = since.elapsed().as_secs_f64();
    report::bake_warnings(&reports, output);
    if let Some(clay) = &clay {
        report::clay_warnings(clay, output);
    }
    if args.json {
        #[derive(Serialize)]
        struct Total {
            total: f64,
        }
        #[derive(Serialize)]
        struct SceneReport {
            objects: Vec<ObjectReport>,
            smallest_overlap_m: Option<f64>,
            #[serde(skip_serializing_if = "Option::is_none")]
            clay: Option<ClayReport>,
            timings_s: Total,
            peak_rss_bytes: Option<u64>,
        }
        let timings_s = Total { total: total_s };
        print_json(&SceneReport {
            smallest_overlap_m: scene::smallest_overlap_m(&reports),
            objects: reports,
            clay,
            timings_s,
            peak_rss_bytes: peak_rss_bytes(),
        });
    } else {
        reports.iter().for_each(|object| output::result(format_args!("{}", report_text(object))));
        if let Some(clay) = &clay {
            output::result(format_args!("{}", clay_text(clay)));
        }
        if let Some(text) = overlap_text(&reports, &config) {
            output::result(format_args!("{text}\n"));
        }
        output::result(format_args!(
            "{} objects in {total_s:.2} s\n",
            reports.len() + usize::from(clay.is_some())
        ));
    }
    Ok(())
}
