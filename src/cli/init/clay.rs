//! A first scene for a file of points, or of a mesh, that is to be clay.

use std::ffi::OsStr;
use std::fs;
use std::path::Path;

use glam::DVec3;

use super::super::{Talk, report, say};
use super::{Args, Refused, guessed, read, relative};
use crate::config;
use crate::config::draft::{ClayDraft, Unit};
use crate::error::Exit;
use crate::mesh::cloud::{self, Contents};
use crate::mesh::{Format, MeshError};
use crate::spatial::Metres;

/// What a file has of a piece, in units of the file; in metres where it names its own.
struct Found {
    is_mesh: bool,
    bounds: Option<(DVec3, DVec3)>,
    own_unit: Option<Unit>,
}

/// Writes the scene.
pub(super) fn init(args: &Args, talk: Talk) -> Result<(), Refused> {
    let refuse = |exit: Exit, message: &str, hint: Option<&str>| {
        report::error(message, hint, talk);
        Refused(exit)
    };
    let file = &args.folder;
    let output = args.output.clone().unwrap_or_else(|| file.with_extension("toml"));
    if output.extension().is_none_or(|ending| !ending.eq_ignore_ascii_case("toml")) {
        return Err(refuse(Exit::Usage, &format!("{}: a scene is a .toml file", output.display()), None));
    }
    if args.tool.is_some() {
        return Err(refuse(Exit::Usage, "--tool goes with a folder: a ball works the clay", None));
    }
    if output.exists() && !args.force {
        let message = format!("{} is there already", output.display());
        return Err(refuse(Exit::Usage, &message, Some("--force writes over it, -o names another file")));
    }
    let Found { is_mesh, bounds, own_unit } = look(file).map_err(|error| {
        report::error(&error.to_string(), error.hint(), talk);
        Refused(Exit::Asset)
    })?;
    let Some((low, high)) = bounds.filter(|(low, high)| (*high - *low).max_element() > 0.0) else {
        return Err(refuse(Exit::Asset, &format!("{}: nothing in it has a size", file.display()), None));
    };
    let longest = (high - low).max_element();
    let (unit, why) = match (args.units, own_unit) {
        (_, Some(own)) => (own, "of the file, which names it itself".to_owned()),
        (Some(unit), None) => (unit.into(), "of the file".to_owned()),
        (None, None) => guessed(longest, "the piece", talk),
    };
    let metres = if own_unit.is_some() { 1.0 } else { unit.metres() };
    let folder = output.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let Some(named) = relative(file, folder) else {
        let message = format!("{}: a scene in {} cannot name this file", file.display(), folder.display());
        return Err(refuse(Exit::Asset, &message, Some("the folder of the scene must exist, and names must be UTF-8")));
    };
    let name = file.file_stem().and_then(OsStr::to_str).unwrap_or("clay").to_owned();
    let draft = ClayDraft { file: named, name, is_mesh, unit, bounds_m: (low * metres, high * metres) };
    fs::write(&output, draft.text(&output.display().to_string(), &why))
        .map_err(|error| refuse(Exit::Asset, &format!("cannot write {}: {error}", output.display()), None))?;
    config::load(&output).map_err(|errors| Refused(report::config_errors(&errors, talk)))?;
    let what = if is_mesh { "a mesh, sampled" } else { "points" };
    say::result(format_args!("clay    {} ({what}), {} across\n", draft.file, Metres(longest * metres)));
    say::result(format_args!("wrote   {}: `hapticd sculpt {}` works it\n", output.display(), say::quoted(&output)));
    Ok(())
}

fn look(file: &Path) -> Result<Found, MeshError> {
    if matches!(Format::of(file), Ok(Format::Gltf | Format::ThreeMf)) {
        let found = read(file)?;
        return Ok(Found { is_mesh: true, bounds: found.mesh.bounds(), own_unit: found.own_unit });
    }
    Ok(match cloud::load(file, 1.0)? {
        Contents::Mesh(mesh) => Found { is_mesh: true, bounds: mesh.bounds(), own_unit: None },
        Contents::Cloud(cloud) => {
            let mut points = cloud.positions.into_iter();
            let bounds = points.next().map(|first| points.fold((first, first), |(low, high), at| (low.min(at), high.max(at))));
            Found { is_mesh: false, bounds, own_unit: None }
        }
    })
}
