//! A mesh of the command line: flags instead of keys, and files of what was baked.

use std::path::Path;

use serde::Serialize;

use super::super::cache::CacheArgs;
use super::super::error::CliError;
use super::super::memory::MemoryRule;
use super::super::units::UnitArg;
use super::super::{OutputOptions, output, report};
use super::figures::{peak_rss_bytes, print_json, report_text};
use super::{Args, NavigationChoice};
use crate::config::scene::MeshSource;
use crate::config::setting_names::FLAGS;
use crate::scene::cache::{Baked, CachePolicy, Lookup, Request, Spacing};
use crate::scene::{self, BakeEvent, MemoryPlan, ObjectReport, PartRole};
use picture::{BakedObject, Marks};
use vps::part::{Part, PartError};
use vps::pointshell::{self, Points, ply};
use vps::storage::whole_file;
use vps::voxmap::accuracy::FieldError;
use vps::voxmap::field::Field;
use vps::voxmap::grid::GridError;
use vps::voxmap::inside_test::InsideTest;
use vps::voxmap::surface::Navigation;
use vps::voxmap::{BakeStage, Options, Volume, npy};

/// Largest voxel edge: that of the scene file.
const VOXEL_SIZE_MAX_MM: f64 = 1000.0;

/// Samples that `--verify` measures again, and how far they may be off, voxels.
const VERIFIED: usize = 100_000;
const MOST_ERROR: f64 = 1e-4;

/// A mesh of the command line: no scene that it could be relative to, and flags instead of keys.
fn mesh_error(args: &Args, error: &PartError) -> CliError {
    let (input, n) = (args.input.display(), args.longest_axis_voxels);
    match error {
        PartError::Mesh { source, .. } => {
            CliError::asset(source).hint(source.hint(&FLAGS).as_deref())
        }
        PartError::Grid { source, .. } => {
            let hint = match (source, n) {
                (GridError::TooLarge { .. } | GridError::Surface { .. }, Some(_)) => {
                    "ask for fewer --longest-axis-voxels".to_owned()
                }
                (GridError::Memory { asked_m, voxel_size_m: Some(fits_m), limit, .. }, Some(n)) => {
                    let n_fits = (f64::from(n) * asked_m / fits_m).floor();
                    format!(
                        "use at most --longest-axis-voxels {n_fits}, fewer --layers, or {}",
                        limit.remedy(&FLAGS)
                    )
                }
                _ => source.hint(&FLAGS),
            };
            CliError::configuration(format_args!("{input}: {source}")).hint(&*hint)
        }
    }
}

pub(super) fn bake_mesh(args: &Args, output: OutputOptions) -> Result<(), CliError> {
    let metres_per_unit = match (args.units, args.voxel_size_mm, args.longest_axis_voxels) {
        (_, None, None) => {
            return Err(CliError::usage(
                "a mesh needs --voxel-size-mm S or --longest-axis-voxels N",
            ));
        }
        (None, Some(_), _) => {
            return Err(CliError::usage(
                "--voxel-size-mm needs --units m|mm|cm|in of the mesh file",
            ));
        }
        (Some(UnitArg(unit)), ..) => unit.metres(),
        (None, None, Some(_)) => 1.0,
    };
    if let Some(size_mm) =
        args.voxel_size_mm.filter(|size_mm| !(*size_mm > 0.0 && *size_mm <= VOXEL_SIZE_MAX_MM))
    {
        return Err(CliError::usage(format_args!(
            "--voxel-size-mm {size_mm}: must be greater than 0 and at most {VOXEL_SIZE_MAX_MM} mm"
        )));
    }
    // Before the work, not after it.
    let outputs =
        [&args.voxmap_out, &args.field_out, &args.pointshell_out, &args.picture, &args.picture_3d];
    for path in outputs.into_iter().flatten() {
        let shown = path.display();
        whole_file::check(path).map_err(|error| CliError::write(&shown, &error))?;
        // Both exist, or one is no file yet: then there is nothing to lose.
        if let (Ok(output), Ok(input)) = (path.canonicalize(), args.input.canonicalize())
            && output == input
        {
            let message = format!("{shown} is the mesh itself: name another file to write");
            return Err(CliError::usage(message));
        }
    }
    for (flag, path) in [("--picture", &args.picture), ("--picture-3d", &args.picture_3d)] {
        if let Some(path) = path
            && !path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case("png"))
        {
            let shown = path.display();
            return Err(CliError::usage(format_args!("{flag} {shown}: a picture is a .png")));
        }
    }
    let name = args.input.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let source = MeshSource::File { path: args.input.clone(), metres_per_unit };
    let request = Request {
        name: &name,
        role: PartRole::Mesh,
        source: &source,
        spacing: match (args.voxel_size_mm, args.longest_axis_voxels) {
            (Some(size_mm), _) => Spacing::Size(size_mm * 1e-3),
            (None, n) => Spacing::LongestAxis(n.unwrap_or(1)),
        },
        layers: args.layers.unwrap_or(Options::DEFAULT_LAYERS),
        sides: args.sides.map_or(InsideTest::Auto, InsideTest::from),
        with_gradients: false,
        // The paper's, whose tables this command measures; a scene bakes its tool by its own
        // settings.
        points: Points::Voxels,
        center_of_mass: None,
    };
    // The cache has neither layers nor distances by voxel, and a navigation that is asked for is
    // asked for its figures.
    let navigation = match args.navigation {
        Some(NavigationChoice::PlaneSpan) => Some(Navigation::PlaneSpan),
        Some(NavigationChoice::TwoSided) => Some(Navigation::TwoSided),
        Some(NavigationChoice::Auto) | None => None,
    };
    let has_outputs = outputs.iter().any(|output| output.is_some());
    let needs_more = navigation.is_some() || args.verify || has_outputs;
    let off = CacheArgs::off();
    let cache = if needs_more { &off } else { &args.cache };
    if args.units.is_none() {
        report::note(
            "the numbers of the mesh file are taken as metres; --units m|mm|cm|in says otherwise",
            output,
        );
    }
    // JSON has it under "cache".
    if needs_more && !args.cache.is_off() && !args.json {
        report::note(
            "baked without the cache, which has neither layers nor distances by voxel nor what a \
                navigation costs",
            output,
        );
    }
    let memory = MemoryRule::Given(&args.memory);
    let baked = cache.bake(CachePolicy::Mapped, memory, output, |options, progress| {
        let tell =
            |stage| progress.tell(&BakeEvent { name: &name, object_idx: 0, n_objects: 1, stage });
        tell(BakeStage::Load);
        Ok::<Baked, CliError>(match options.cache.look_up(&request, u64::MAX) {
            Lookup::Hit(baked) => *baked,
            Lookup::Bake(slot) => {
                let mut baked = generate(args, &request, navigation, &mut options.memory, tell)?;
                baked.report.cache = slot.cache;
                options.cache.store(&slot, &request, &baked);
                baked
            }
        })
    });
    let Baked { field, shell, report: object, .. } = baked?;
    report::bake_warnings(core::slice::from_ref(&object), output);
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
        output::result(format_args!("{}", report_text(&object)));
    }
    Ok(())
}

/// Bakes a mesh on its own and writes the files that are asked for.
fn generate(
    args: &Args,
    request: &Request<'_>,
    navigation: Option<Navigation>,
    memory: &mut MemoryPlan<'_>,
    tell: impl Fn(BakeStage),
) -> Result<Baked, CliError> {
    let refused = |error: PartError| mesh_error(args, &error);
    let part = scene::load(request.name, request.source, request.spacing).map_err(refused)?;
    let part = part.with_setting_names(FLAGS);
    let options = Options { navigation, ..request.options(&part) };
    memory.judge(&part, &options, request.products()).map_err(refused)?;
    let mut map = part.voxmap(&options, &tell).map_err(refused)?;
    tell(BakeStage::Distance);
    if args.field_out.is_some() || args.voxmap_out.is_some() {
        let (layers, distances) = map.of_whole(&part.mesh);
        if let Some(path) = &args.field_out {
            write(path, |path| npy::write_distances(path, &layers, &distances))?;
        }
        if let Some(path) = &args.voxmap_out {
            write(path, |path| npy::write_layers(path, &layers))?;
        }
    }
    let field = map.field(&part.mesh, request.with_gradients);
    tell(BakeStage::Pointshell);
    let mass = part.mass_of(&map);
    let center_of_mass = request.center_of_mass.unwrap_or(mass.center_m);
    let (shell, shell_report) =
        pointshell::build_with(request.points, &part.mesh, &map, center_of_mass);
    if let Some(path) = &args.pointshell_out {
        write(path, |path| ply::write(path, &shell, center_of_mass))?;
    }
    // Cuts show what is felt of the part, with what is beside its solid.
    let of_cuts = args.picture.as_ref().map(|_| {
        let whole = (!map.beside.is_empty()).then(|| map.of_whole(&part.mesh).0);
        (whole, Marks::of(&part.mesh, &map))
    });
    let (whole, marks) = of_cuts.unwrap_or_default();
    let subject = BakedObject {
        name: request.name,
        surface: &map.surface,
        layers: whole.as_ref().unwrap_or(&map.layers),
        shell: &shell,
        center_of_mass_tool: center_of_mass,
        thin: map.thin,
        marks: &marks,
    };
    if let Some(path) = &args.picture {
        write(path, |path| picture::write(path, &subject))?;
    }
    if let Some(path) = &args.picture_3d {
        write(path, |path| picture::parts::write_structures(path, &part.mesh, &subject))?;
    }
    let points = Some((&shell, center_of_mass));
    let report = part.report(PartRole::Mesh, &map, Some(&field), points, &shell_report);
    if args.verify {
        verify(&map, &part, &field)?;
    }
    Ok(Baked { field: Some(field), shell: Some(shell), mass: Some(mass), report })
}

/// Says how far the field is from exact distances.
fn verify(map: &Volume, part: &Part, field: &Field) -> Result<(), CliError> {
    let FieldError { samples, error_m, position_m } = map.verify(&part.mesh, field, VERIFIED);
    let [x, y, z] = (position_m * 1e3).to_array();
    let voxel_size_m = f64::from(field.voxel_size_m());
    let error = error_m / voxel_size_m;
    let far_m =
        part.mesh.bounds().map_or(0.0, |(low, high)| low.abs().max(high.abs()).max_element());
    // Samples, and the origin of their grid, are `f32`.
    let allowed = MOST_ERROR + 4.0 * f64::from(f32::EPSILON) * far_m / voxel_size_m;
    let text = format!(
        "the worst of {samples} samples is off by {error:.1e} voxels, at ({x:.3}, {y:.3}, {z:.3}) mm"
    );
    if error > allowed {
        return Err(CliError::internal(format_args!(
            "{}: {text}; {allowed:.1e} is what rounding explains",
            part.name()
        )));
    }
    output::message(format_args!("{}: {text}\n", part.name()));
    Ok(())
}

fn write(path: &Path, export: impl FnOnce(&Path) -> std::io::Result<()>) -> Result<(), CliError> {
    export(path).map_err(|error| CliError::write(path.display(), &error))
}
