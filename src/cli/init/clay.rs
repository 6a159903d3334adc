//! A first scene for a file of points, or of a mesh, that is to be clay.

use std::ffi::OsStr;
use std::path::Path;

use glam::DVec3;

use super::super::OutputOptions;
use super::super::error::CliError;
use super::super::units::UnitArg;
use super::place::SceneDestination;
use super::{Args, guessed, read, relative};
use crate::config::draft::{ClayDraft, Unit};
use crate::config::setting_names::FLAGS;
use vps::mesh::cloud::{self, Contents};
use vps::mesh::{Format, MeshError};
use vps::spatial::Metres;

/// What a file has of a clay model, in units of the file; in metres where it names its own.
struct InputMesh {
    is_mesh: bool,
    bounds: Option<(DVec3, DVec3)>,
    own_unit: Option<Unit>,
}

/// Writes the scene.
pub(super) fn init(args: &Args, output: OutputOptions) -> Result<(), CliError> {
    let file = &args.folder;
    let shown = file.display();
    if !file.is_file() {
        return Err(CliError::usage(format_args!("{shown}: --clay takes one file"))
            .hint("name the file of points or the mesh that is to be clay"));
    }
    if !args.clay {
        return Err(CliError::usage(format_args!("{shown}: not a folder"))
            .hint("give its folder, or --clay to sculpt this file"));
    }
    let place = SceneDestination::of(args, || file.with_extension("toml"))?;
    if args.tool.is_some() {
        return Err(CliError::usage("--tool goes with a folder: a ball works the clay"));
    }
    place.check_free(args)?;
    let InputMesh { is_mesh, bounds, own_unit } =
        look(file).map_err(|error| CliError::asset(&error).hint(error.hint(&FLAGS).as_deref()))?;
    let Some((low, high)) = bounds.filter(|(low, high)| (*high - *low).max_element() > 0.0) else {
        return Err(CliError::asset(format_args!("{shown}: nothing in it has a size")));
    };
    let longest = (high - low).max_element();
    let (unit, why) = match (args.units, own_unit) {
        (_, Some(own)) => (own, "of the file, which names it itself".to_owned()),
        (Some(UnitArg(unit)), None) => (unit, "of the file".to_owned()),
        (None, None) => guessed(longest, "the clay", output),
    };
    let metres = if own_unit.is_some() { 1.0 } else { unit.metres() };
    let named = relative(file, place.folder())?;
    let name = file.file_stem().and_then(OsStr::to_str).unwrap_or("clay").to_owned();
    let draft =
        ClayDraft { file: named, name, is_mesh, unit, bounds_m: (low * metres, high * metres) };
    let what = if is_mesh { "a mesh, sampled" } else { "points" };
    let summary = format!("clay    {} ({what}), {} across\n", draft.file, Metres(longest * metres));
    place.write(&draft.text(&place.named(), &why), &summary, ("sculpt", "works"), output)
}

fn look(file: &Path) -> Result<InputMesh, MeshError> {
    if matches!(Format::of(file), Ok(Format::Gltf | Format::ThreeMf)) {
        let found = read(file)?;
        return Ok(InputMesh {
            is_mesh: true,
            bounds: found.mesh.bounds(),
            own_unit: found.own_unit,
        });
    }
    Ok(match cloud::load(file, 1.0)? {
        Contents::Mesh(mesh) => InputMesh { is_mesh: true, bounds: mesh.bounds(), own_unit: None },
        Contents::Cloud(cloud) => {
            let mut points = cloud.positions.into_iter();
            let bounds = points.next().map(|first| {
                points.fold((first, first), |(low, high), at| (low.min(at), high.max(at)))
            });
            InputMesh { is_mesh: false, bounds, own_unit: None }
        }
    })
}
