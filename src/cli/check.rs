//! `hapticd check`: every configuration pass over each scene, device profile or file of strokes;
//! bakes nothing.

use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::bake::{accuracy_text, press_fit_text};
use super::memory::scarce_text;
use super::{OutputOptions, output, report};
use crate::config::scene::{ClaySource, MeshSource, SculptConfig};
use crate::config::strokes::{self, Script, TimedOrder};
use crate::config::{self, Problem, SceneConfig};
use crate::daemon::{HandProblem, Inputs, PrepareError, inputs};
use crate::error::Exit;
use crate::scene::{self, MemoryPlan};
use arms::profile::{self, Profile, ProfileError};
use clay::engine::{SculptOrder, ToolSettings};
use document::show;
use engine::arm_rules::StiffnessBound;
use haptics::CouplingMode;
use vps::Accuracy;
use vps::spatial::Axes;
use vps::storage::printable::{one_line, shown};

/// Arguments of `hapticd check`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Scene files, files of strokes, or profiles of arms: files, or names of shipped ones.
    #[arg(required = true, value_name = "SCENE")]
    scenes: Vec<PathBuf>,
    /// Print exactly one JSON object, with the problems of each file.
    #[arg(long)]
    json: bool,
}

/// What was found in one file.
struct Checked {
    kind: &'static str,
    /// One line on what it is, where it is sound.
    summary: Option<String>,
    /// What the triangles of each part show, of a scene that is sound.
    parts: Vec<PartFigures>,
    /// What goes in though it is too large, of a scene that is sound.
    press_fit: Option<String>,
    findings: Vec<Finding>,
    exit: Exit,
}

/// What the triangles of a part show without a bake.
struct PartFigures {
    name: String,
    voxel_size_m: f64,
    accuracy: Accuracy,
}

/// One thing that is wrong, or likely to be.
#[derive(Default)]
struct Finding {
    is_error: bool,
    /// All of it in one line, as `run` says it.
    text: String,
    hint: Option<String>,
    file: Option<PathBuf>,
    line: Option<usize>,
    /// The key, the columns, or the part.
    key: Option<String>,
    value: Option<String>,
}

pub(crate) fn main(args: &Args, output: OutputOptions) -> Exit {
    let checked: Vec<Checked> = args.scenes.iter().map(|file| check(file)).collect();
    if args.json {
        let files: Vec<Value> =
            args.scenes.iter().zip(&checked).map(|(file, checked)| checked.json(file)).collect();
        let is_ok = checked.iter().all(|checked| checked.exit == Exit::Ok);
        output::result(format_args!("{}\n", json!({ "ok": is_ok, "files": files })));
    } else {
        checked.iter().for_each(|checked| checked.print(output));
    }
    checked.iter().map(|checked| checked.exit).rfind(|exit| *exit != Exit::Ok).unwrap_or(Exit::Ok)
}

fn check(file: &Path) -> Checked {
    let name =
        file.to_str().filter(|name| !file.exists() && profile::names().any(|known| known == *name));
    if name.is_some() || profile::is_profile(file) {
        return check_profile(file, name);
    }
    if strokes::is_script(file) {
        return match strokes::load(file, &ToolSettings::default()) {
            Ok(script) => {
                let notes = script.notes.iter().map(Finding::of_warning).collect();
                Checked::sound("strokes", script_summary(&script), notes)
            }
            Err(errors) => Checked::refused("strokes", Vec::new(), &PrepareError::Config(errors)),
        };
    }
    let mut warnings = Vec::new();
    let mut parts = Vec::new();
    match check_scene(file, &mut warnings, &mut parts) {
        Ok(config) => Checked {
            parts,
            press_fit: press_fit_text(&config),
            ..Checked::sound("scene", summary(&config), warnings)
        },
        Err(error) => Checked::refused("scene", warnings, &error),
    }
}

fn check_profile(file: &Path, name: Option<&str>) -> Checked {
    let loaded = match name {
        Some(name) => profile::find(name, Path::new("")).map_err(|error| match error {
            ProfileError::Invalid(errors) => errors,
            // True invariant: it was among the names.
            error => unreachable!("{error}"),
        }),
        None => profile::load(file),
    };
    match loaded {
        Ok(profile) => {
            let doubts = profile.plausibility_warnings();
            let warnings = doubts
                .iter()
                .map(|doubt| Finding::warning(format!("{}: {doubt}", file.display()), file))
                .collect();
            Checked::sound("profile", profile_summary(file, &profile), warnings)
        }
        Err(errors) => Checked::refused("profile", Vec::new(), &PrepareError::Config(errors)),
    }
}

/// What `run` would say before it bakes.
fn check_scene(
    file: &Path,
    warnings: &mut Vec<Finding>,
    parts: &mut Vec<PartFigures>,
) -> Result<SceneConfig, PrepareError> {
    let config = config::load(file).map_err(PrepareError::Config)?;
    warnings.extend(config::plausibility_warnings(&config).iter().map(Finding::of_warning));
    let Inputs { warnings: of_hand, .. } = inputs(&config)?;
    warnings.extend(of_hand.into_iter().map(|problem| Finding::of_hand(false, &problem)));
    if let Some(SculptConfig { strokes: Some(file), tool, .. }) = &config.sculpt {
        let script = strokes::load(file, tool).map_err(PrepareError::Config)?;
        warnings.extend(script.notes.iter().map(Finding::of_warning));
    }
    let mut of_parts = Vec::new();
    let mut of_memory = Vec::new();
    let mut memory = MemoryPlan::new(None, |name, estimate| {
        of_memory.extend(
            scarce_text(name, estimate)
                .map(|text| Finding { key: Some(name.to_owned()), ..Finding::warning(text, file) }),
        );
    });
    let looked_at = scene::look_at_parts(&config, &mut memory, |part, source, options| {
        let mesh = if let MeshSource::File { path, .. } = source { path } else { file };
        parts.push(PartFigures {
            name: part.name().to_owned(),
            voxel_size_m: options.voxel_size_m,
            accuracy: part.walls_and_edges(options.voxel_size_m),
        });
        let of_mesh = part
            .mesh_warnings(options.sides, Some(options.voxel_size_m))
            .into_iter()
            .map(|text| format!("{}: {text}", part.name()));
        of_parts.extend(of_mesh.map(|text| Finding {
            key: Some(part.name().to_owned()),
            ..Finding::warning(text, mesh)
        }));
    });
    drop(memory);
    warnings.extend(of_parts.into_iter().chain(of_memory));
    looked_at.map_err(|problem| PrepareError::of_scene(&config, problem.into()))?;
    if let Some(sculpt) = &config.sculpt {
        let of_clay = scene::look_at_clay(sculpt)
            .map_err(|problem| PrepareError::of_scene(&config, problem.into()))?;
        warnings.extend(of_clay.into_iter().map(|text| Finding {
            key: Some("sculpt.mesh".to_owned()),
            ..Finding::warning(format!("clay: {text}"), file)
        }));
    }
    Ok(config)
}

impl Checked {
    fn sound(kind: &'static str, summary: String, findings: Vec<Finding>) -> Self {
        Self {
            kind,
            summary: Some(summary),
            parts: Vec::new(),
            press_fit: None,
            findings,
            exit: Exit::Ok,
        }
    }

    fn refused(kind: &'static str, mut findings: Vec<Finding>, error: &PrepareError) -> Self {
        match error {
            PrepareError::Config(errors) => {
                findings.extend(errors.problems().iter().map(Finding::of_config))
            }
            PrepareError::HandPath(problem) => findings.push(Finding::of_hand(true, problem)),
            error => findings.push(Finding {
                is_error: true,
                text: error.to_string(),
                hint: report::prepare_hint(error),
                ..Finding::default()
            }),
        }
        Self {
            summary: None,
            exit: report::prepare_exit(error),
            ..Self::sound(kind, String::new(), findings)
        }
    }

    fn print(&self, output: OutputOptions) {
        for finding in &self.findings {
            let text = one_line(&finding.text);
            match finding.is_error {
                true => report::error(&text, finding.hint.as_deref(), output),
                false => report::warning(&text, output),
            }
        }
        if let Some(summary) = self.summary.as_ref().filter(|_| !output.quiet) {
            output::result(format_args!("ok {summary}\n"));
            for part in &self.parts {
                if let Some(text) = accuracy_text(&part.accuracy, part.voxel_size_m) {
                    output::result(format_args!("  {}: {text}\n", one_line(&part.name)));
                }
            }
            if let Some(press_fit) = &self.press_fit {
                output::result(format_args!("  {press_fit}\n"));
            }
        }
    }

    fn json(&self, file: &Path) -> Value {
        json!({
            "file": file.to_string_lossy(),
            "kind": self.kind,
            "ok": self.exit == Exit::Ok,
            "exit_code": self.exit as u8,
            "summary": self.summary,
            "parts": self.parts.iter().map(PartFigures::json).collect::<Vec<_>>(),
            "press_fit": self.press_fit,
            "problems": self.findings.iter().map(Finding::json).collect::<Vec<_>>(),
        })
    }
}

impl Finding {
    fn warning(text: String, file: &Path) -> Self {
        Self { text, file: Some(file.to_owned()), ..Self::default() }
    }

    fn of_config(problem: &Problem) -> Self {
        let Problem { file, line, key, value, .. } = problem;
        Self {
            is_error: true,
            text: problem.to_string(),
            hint: problem.hint(),
            file: Some(file.clone()),
            line: *line,
            key: key.clone(),
            value: value.clone(),
        }
    }

    /// `run` says it with what to do about it.
    fn of_warning(problem: &Problem) -> Self {
        Self { is_error: false, text: report::warning_text(problem), ..Self::of_config(problem) }
    }

    /// `run` says it of the tool, which the hand moves.
    fn of_hand(is_error: bool, problem: &HandProblem) -> Self {
        let HandProblem { file, line, column, value, remedy, .. } = problem;
        Self {
            is_error,
            text: if is_error {
                problem.to_string()
            } else {
                format!("tool: {}", problem.with_remedy())
            },
            hint: Some(remedy.clone()),
            file: Some(file.clone()),
            line: Some(*line),
            key: Some((*column).to_owned()),
            value: Some(value.clone()),
        }
    }

    fn json(&self) -> Value {
        let Self { is_error, text, hint, file, line, key, value } = self;
        json!({
            "severity": if *is_error { "error" } else { "warning" },
            "message": text,
            "hint": hint,
            "file": file.as_deref().map(Path::to_string_lossy),
            "line": line,
            "key": key,
            "value": value,
        })
    }
}

impl PartFigures {
    fn json(&self) -> Value {
        let Accuracy { thinnest_wall_m, sharpest_edge_deg, .. } = self.accuracy;
        json!({
            "name": self.name,
            "voxel_size_m": self.voxel_size_m,
            "thinnest_wall_m": thinnest_wall_m,
            "sharpest_edge_deg": sharpest_edge_deg,
        })
    }
}

/// One line: `arm.toml: "My arm", senses x y z, actuates x y z, simulated`.
fn profile_summary(path: &Path, profile: &Profile) -> String {
    let axes = |axes: Axes| axes.names().collect::<Vec<_>>().join(" ");
    let mut parts = vec![
        format!("{}: \"{}\"", shown(path), profile.title),
        format!("senses {}", axes(profile.sensed)),
        format!(
            "actuates {}",
            if profile.actuated == Axes::NONE { "nothing".into() } else { axes(profile.actuated) }
        ),
    ];
    match &profile.real {
        None => parts.push("simulated".into()),
        Some(real) => {
            parts.push(real.protocol.name().into());
            parts.extend(
                real.matching
                    .ids
                    .iter()
                    .map(|id| format!("USB {:04x}:{:04x}", id.vendor, id.product)),
            );
            parts.extend(profile.has_unverified_signs().then(|| "signs not verified".into()));
            parts.extend(profile.is_unidentified().then(|| "not identified".into()));
        }
    }
    parts.join(", ")
}

/// One line: `strokes.toml: 5 orders from 0.5 s to 3 s`. How many of them are strokes of the clay
/// shows when they are carried out.
fn script_summary(script: &Script) -> String {
    let file = shown(&script.file);
    // The end of a hold is part of the same order as its beginning.
    let n_orders = script
        .orders
        .iter()
        .filter(|timed| !matches!(timed.order, SculptOrder::Hold(false)))
        .count();
    let at_s = |timed: Option<&TimedOrder>| show(timed.map_or(0.0, |timed| timed.at.as_secs_f64()));
    match n_orders {
        0 => format!("{file}: no orders"),
        1 => format!("{file}: 1 order at {} s", at_s(script.orders.first())),
        n => format!(
            "{file}: {n} orders from {} s to {} s",
            at_s(script.orders.first()),
            at_s(script.orders.last())
        ),
    }
}

/// One line: `scene.toml: "gear", 1 static + tool, sim-sigma7 at 1000 Hz, implicit, 4000 N/m
/// (declared bound 4000), 1 N·m/rad (declared bound 1)`.
pub(super) fn summary(config: &SceneConfig) -> String {
    let coupling = &config.parameters.coupling;
    let mode = match coupling.mode {
        CouplingMode::Implicit => "implicit",
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
        format!(
            "{} static + tool{}",
            config.statics.len(),
            if config.sculpt.is_some() { " + clay" } else { "" }
        ),
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
        parts.push(format!(
            "{raster} updated at {} Hz, {} in the hand",
            show(update_hz),
            sculpt.tool.kind
        ));
        parts.extend(sculpt.strokes.as_ref().map(|file| format!("strokes of {}", shown(file))));
    }
    parts.join(", ")
}
