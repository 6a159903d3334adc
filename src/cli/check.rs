//! `hapticd check`: every configuration pass over each scene, device profile or file of strokes; bakes nothing.

use std::path::{Path, PathBuf};

use super::{OutputOptions, output, report};
use crate::config::scene::{ClaySource, MeshSource, SculptConfig};
use crate::config::strokes::{self, Script, TimedOrder};
use crate::config::{self, SceneConfig, StiffnessBound};
use crate::daemon::{PrepareError, inputs};
use crate::error::Exit;
use crate::scene::{self, SceneError, cache::Spacing};
use arms::profile::{self, Profile, ProfileError};
use clay::engine::{SculptOrder, ToolSettings};
use document::show;
use haptics::CouplingMode;
use vps::part::PartError;
use vps::spatial::{Axes, Metres};
use vps::storage::printable::{one_line, shown};
use vps::voxmap::grid::Grid;

/// Arguments of `hapticd check`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Scene files, files of strokes, or profiles of arms: files, or names of shipped ones.
    #[arg(required = true, value_name = "SCENE")]
    scenes: Vec<PathBuf>,
}

pub(crate) fn main(args: &Args, output: OutputOptions) -> Exit {
    let mut exit = Exit::Ok;
    for scene in &args.scenes {
        let named = scene.to_str().filter(|name| !scene.exists() && profile::names().any(|known| known == *name));
        if named.is_some() || profile::is_profile(scene) {
            let loaded = match named {
                Some(name) => profile::find(name, Path::new("")).map_err(|error| match error {
                    ProfileError::Invalid(errors) => errors,
                    // True invariant: it was among the names.
                    error => unreachable!("{error}"),
                }),
                None => profile::load(scene),
            };
            match loaded {
                Ok(profile) if output.quiet => drop(profile),
                Ok(profile) => {
                    profile
                        .plausibility_warnings()
                        .iter()
                        .for_each(|doubt| report::warning(&format!("{}: {doubt}", scene.display()), output));
                    output::result(format_args!("ok {}\n", profile_summary(scene, &profile)));
                }
                Err(errors) => exit = report::config_errors(&errors, output),
            }
            continue;
        }
        if strokes::is_script(scene) {
            match strokes::load(scene, &ToolSettings::default()) {
                Ok(script) if output.quiet => drop(script),
                Ok(script) => output::result(format_args!("ok {}\n", script_summary(&script))),
                Err(errors) => exit = report::config_errors(&errors, output),
            }
            continue;
        }
        let checked = config::load(scene).map_err(PrepareError::Config).and_then(|config| {
            inputs(&config)?;
            if let Some(SculptConfig { strokes: Some(file), tool, .. }) = &config.sculpt {
                strokes::load(file, tool).map_err(PrepareError::Config)?;
            }
            look_at_parts(&config, output).map_err(SceneError::from)?;
            Ok(config)
        });
        match checked {
            Ok(config) if output.quiet => drop(config),
            Ok(config) => output::result(format_args!("ok {}\n", summary(&config))),
            Err(error) => exit = report::prepare_error(&error, output),
        }
    }
    exit
}

/// One line: `arm.toml: "My arm", senses x y z, actuates x y z, simulated`.
fn profile_summary(path: &Path, profile: &Profile) -> String {
    let axes = |axes: Axes| axes.names().collect::<Vec<_>>().join(" ");
    let mut parts = vec![
        format!("{}: \"{}\"", shown(path), profile.title),
        format!("senses {}", axes(profile.sensed)),
        format!("actuates {}", if profile.actuated == Axes::NONE { "nothing".into() } else { axes(profile.actuated) }),
    ];
    match &profile.real {
        None => parts.push("simulated".into()),
        Some(real) => {
            parts.push(real.protocol.name().into());
            parts.extend(real.matching.ids.iter().map(|id| format!("USB {:04x}:{:04x}", id.vendor, id.product)));
            parts.extend(profile.has_unverified_signs().then(|| "signs not verified".into()));
            parts.extend(profile.is_unidentified().then(|| "not identified".into()));
        }
    }
    parts.join(", ")
}

/// Longest part that is likely to be meant, m.
const LIKELY_M: f64 = 5.0;

/// Looks at the box of each part: a mesh that cannot be used, or a grid that is too large, is refused as `run` would; of a part that is so large that
/// its unit is likely to be wrong is warned.
fn look_at_parts(config: &SceneConfig, output: OutputOptions) -> Result<(), PartError> {
    let SceneConfig { statics, tool, .. } = config;
    let statics = statics.iter().map(|object| (object.name.as_str(), &object.source, object.voxel_size_m, object.layers));
    for (name, source, voxel_size_m, layers) in statics.chain([("tool", &tool.source, tool.voxel_size_m, tool.layers)]) {
        // The box of a shape hardly depends on how finely it is cut.
        let bounds = scene::load(name, source, Spacing::LongestAxis(1))?.mesh.bounds();
        let Some((low, high)) = bounds else { continue };
        let longest_m = (high - low).max_element();
        if let MeshSource::File { path, .. } = source
            && longest_m > LIKELY_M
        {
            report::warning(&format!("{name}: {} is {} long: is its `units` right?", path.display(), Metres(longest_m)), output);
        }
        let grid = Grid::around(low, high, voxel_size_m, layers);
        grid.map_err(|source| PartError::Grid { name: name.to_owned(), source })?;
    }
    Ok(())
}

/// One line: `strokes.toml: 5 orders from 0.5 s to 3 s`. How many of them are strokes of the clay shows when they are carried out.
fn script_summary(script: &Script) -> String {
    let file = shown(&script.file);
    // The end of a hold is part of the same order as its beginning.
    let n_orders = script.orders.iter().filter(|timed| !matches!(timed.order, SculptOrder::Hold(false))).count();
    let at_s = |timed: Option<&TimedOrder>| show(timed.map_or(0.0, |timed| timed.at.as_secs_f64()));
    match n_orders {
        0 => format!("{file}: no orders"),
        1 => format!("{file}: 1 order at {} s", at_s(script.orders.first())),
        n => format!("{file}: {n} orders from {} s to {} s", at_s(script.orders.first()), at_s(script.orders.last())),
    }
}

/// One line: `scene.toml: "gear", 1 static + tool, sim-sigma7 at 1000 Hz, implicit, 4000 N/m (declared bound 4000), 1 N·m/rad (declared bound 1)`.
pub(super) fn summary(config: &SceneConfig) -> String {
    let coupling = &config.parameters.coupling;
    let mode = match coupling.mode {
        CouplingMode::Implicit => "implicit",
        CouplingMode::Static => "static",
        CouplingMode::Constraint => "constraint",
        CouplingMode::Direct => "direct",
    };
    // What the arm feels: the contact itself in `direct`, else the coupling; times `scale`.
    let translation = match coupling.mode {
        CouplingMode::Direct => config.parameters.contact.stiffness_n_per_m,
        _ => coupling.stiffness_n_per_m,
    } * config.parameters.mapping.scale;
    let bound = |bound: &StiffnessBound| match bound.value() {
        value if value.is_infinite() => "no bound".to_owned(),
        value if bound.declared == Some(value) => format!("declared bound {}", show(value)),
        value => format!("stability bound {}", show(value)),
    };
    let mut parts = vec![
        format!("{}: \"{}\"", shown(&config.path), one_line(&config.name)),
        format!("{} static + tool{}", config.statics.len(), if config.sculpt.is_some() { " + clay" } else { "" }),
        format!("{} at {} Hz", config.device.profile.name, config.rate_hz),
        mode.to_owned(),
        format!("{} N/m ({})", show(translation), bound(&config.stability.translation)),
    ];
    if coupling.mode != CouplingMode::Direct {
        let rotation = coupling.stiffness_nm_per_rad;
        parts.push(format!("{} N·m/rad ({})", show(rotation), bound(&config.stability.rotation)));
    }
    if config.stability.allow_unstable {
        parts.push("allow_unstable".to_owned());
    }
    if let Some(sculpt) = &config.sculpt {
        let update_hz = f64::from(config.rate_hz) / sculpt.update_ticks as f64;
        let raster = match sculpt.source {
            ClaySource::Session(_) => "raster of the session".to_owned(),
            ClaySource::Solid(_) => {
                let [nx, ny, nz] = sculpt.settings.raster;
                format!("raster {nx} x {ny} x {nz}")
            }
        };
        parts.push(format!("{raster} updated at {} Hz, {} in the hand", show(update_hz), sculpt.tool.craft));
        parts.extend(sculpt.strokes.as_ref().map(|file| format!("strokes of {}", shown(file))));
    }
    parts.join(", ")
}
