//! Sculpting beside a run: what is planned, what runs while a scene renders, and what is written at
//! its end.

mod ending;
mod outputs;
mod summary;

use std::path::{Path, PathBuf};
use std::sync::Arc;

pub(crate) use self::summary::SculptSummary;

use self::ending::{carry_out, hint, rescue, wait};
use self::outputs::{OutputFiles, Pictures, destination_of, session_of};
use self::summary::SavedFile;
use super::error::CliError;
use super::{OutputOptions, destination, output, recording, report};
use crate::config::scene::SculptConfig;
use crate::config::setting_names::KEYS;
use crate::config::strokes::{self, Script, TimedOrder};
use crate::config::{ConfigErrors, SceneConfig};
use crate::daemon::sculpting::{
    self, ClayHandle, ScriptedOrder, SculptOutcome, SculptPlan, SculptReport, SculptThread,
};
use crate::monitor::ClayParts;
use crate::scene::LoadedClay;
use clay::PointSet;
use clay::engine::{SculptEngine, SculptOrder, ToolBody};
use engine::supervisor::LiveChannels;
use haptics::RenderScene;
use picture::splats::{MassPoints, SampleForm};
use rt::clock::ClockKind;
use rt::control::Control;
use vps::mesh::{self, cloud};
use vps::storage::printable::one_line;

/// Where `--help` lists it.
const HEADING: &str = "Clay";

/// What is to become of the clay.
#[derive(Debug, clap::Args)]
pub(crate) struct ClayArgs {
    /// Strokes of this file instead of the scene's.
    #[arg(long, help_heading = HEADING, value_name = "FILE.toml")]
    strokes: Option<PathBuf>,
    /// At the end, write the samples with normals and colours.
    #[arg(long, help_heading = HEADING, value_name = "FILE.ply")]
    save: Option<PathBuf>,
    /// At the end, write all that is needed to go on another day: `session` under [sculpt] takes
    /// it.
    #[arg(long, help_heading = HEADING, value_name = "FILE")]
    session: Option<PathBuf>,
    /// At the end, write the clay as a closed mesh that `bake` and rigid scenes take.
    #[arg(long, help_heading = HEADING, value_name = "FILE.ply")]
    export: Option<PathBuf>,
    /// At the end, draw the clay as it was and as it is: SCENE-before.png and SCENE-after.png in
    /// this folder.
    #[arg(long, help_heading = HEADING, value_name = "DIR")]
    pictures: Option<PathBuf>,
    /// What --pictures draws of the samples.
    #[arg(long, help_heading = HEADING, value_enum, default_value_t, requires = "pictures")]
    drawn_as: DrawnAs,
}

/// [`SampleForm`] as a word of the command line.
#[derive(Clone, Copy, Debug, Default, clap::ValueEnum)]
enum DrawnAs {
    /// One surface, blended from discs.
    #[default]
    Surface,
    /// Each as a disc across its normal.
    Discs,
    /// Each as a disc that faces the viewer.
    Sprites,
    /// Each as a ball.
    Spheres,
    /// The surface, with a ball for each mass point beside it.
    MassPoints,
}

impl From<DrawnAs> for SampleForm {
    fn from(word: DrawnAs) -> Self {
        match word {
            DrawnAs::Surface => Self::Surface,
            DrawnAs::Discs => Self::Discs,
            DrawnAs::Sprites => Self::Sprites,
            DrawnAs::Spheres => Self::Spheres,
            DrawnAs::MassPoints => Self::MassPoints,
        }
    }
}

/// A file that samples can be taken from.
pub(super) fn is_source(file: &Path) -> bool {
    let ending =
        file.extension().map(|ending| ending.to_string_lossy().to_lowercase()).unwrap_or_default();
    mesh::EXTENSIONS.iter().chain(cloud::EXTENSIONS).any(|known| *known == ending)
}

/// Sculpting beside one run: planned, open while the loop runs, closed after it.
pub(crate) struct SculptRun {
    plan: SculptPlan,
    script: Option<Script>,
    sculpt: SculptConfig,
    /// The stem of the scene's name.
    name: String,
    /// What is written at the end, the session first.
    outputs: Vec<SculptOrder>,
    pictures: Option<Pictures>,
    open: Option<Open>,
}

struct Open {
    thread: SculptThread,
    /// Held for as long as the run goes on, for clients.
    handle: ClayHandle,
    volume_before_m3: Option<f64>,
}

impl SculptRun {
    /// Reads the strokes and looks where files are to go, before anything takes long. `None`: the
    /// scene has no clay, and the command wants none.
    pub(crate) fn plan(
        config: &SceneConfig,
        args: Option<&ClayArgs>,
        overwrite: bool,
        clock: ClockKind,
        recording: Option<&Path>,
        output: OutputOptions,
    ) -> Result<Option<Self>, CliError> {
        let path = config.path.display();
        let file = output::quoted(&config.path);
        let (sculpt, args) = match (&config.sculpt, args) {
            (None, None) => return Ok(None),
            (Some(sculpt), Some(args)) => (sculpt.clone(), args),
            (Some(_), None) => {
                return Err(CliError::configuration(format_args!(
                    "{path}: [sculpt]: this scene has clay, and `run` is for rigid ones"
                ))
                .hint(&*format!("`hapticd sculpt {file}` works it")));
            }
            (None, Some(_)) => {
                return Err(CliError::configuration(format_args!(
                    "{path}: this scene has no clay to sculpt"
                ))
                .hint(&*format!(
                    "`hapticd run {file}` renders it; a [sculpt] table would give it clay"
                )));
            }
        };
        let file = args.strokes.as_ref().or(sculpt.strokes.as_ref());
        let script = file.map(|file| strokes::load(file, &sculpt.tool)).transpose()?;
        if script.is_none() && config.device.profile.real.is_none() && config.device.hand.is_none()
        {
            let hint = "`hand` under [device] leads it along a path, --strokes FILE works the \
                model without it";
            report::note(
                &format!("no path moves the simulated arm, only a client such as the page: {hint}"),
                output,
            );
        }
        let outputs = args.outputs();
        let pictures = args.pictures.as_ref().map(|folder| Pictures {
            title: config.name.clone(),
            name: config.path.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
            folder: folder.clone(),
            form: args.drawn_as.into(),
            before: PointSet::default(),
            mass_before: MassPoints::default(),
        });
        let written = OutputFiles {
            own: &outputs,
            script: script.as_ref(),
            pictures: pictures.as_ref(),
            recording,
        };
        written.check(config, overwrite, output)?;
        let tick_s = config.parameters.period_s;
        Ok(Some(Self {
            plan: SculptPlan {
                tick_s,
                update_ticks: sculpt.update_ticks,
                clock,
                script: Vec::new(),
            },
            script,
            name: config.path.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
            outputs,
            pictures,
            sculpt,
            open: None,
        }))
    }

    /// Holds the solids of the strokes against the clay: whether their units can be right. Says what
    /// a user should know of their files.
    pub(crate) fn fit(
        &self,
        model: &LoadedClay,
        output: OutputOptions,
    ) -> Result<(), ConfigErrors> {
        let Some(script) = &self.script else { return Ok(()) };
        let odd = script.fit(model.clay.surface().bounds())?;
        let problems = script.notes.iter().chain(&odd);
        problems.for_each(|problem| report::warning(&one_line(&problem.to_string()), output));
        Ok(())
    }

    /// Begins to work the clay: the loop gets its clay.
    pub(crate) fn open(
        &mut self,
        model: LoadedClay,
        scene: &RenderScene,
        live: &mut LiveChannels,
        control: &Arc<Control>,
    ) -> std::io::Result<()> {
        let Some(rendered) = &scene.clay else { return Ok(()) };
        let LoadedClay { clay, tool_shape, report } = model;
        if let Some(pictures) = &mut self.pictures {
            pictures.before = clay.points().clone();
            pictures.mass_before = MassPoints::beside_surface(clay.region());
        }
        let body = ToolBody {
            shape: Some(tool_shape),
            center_of_mass_tool: scene.tool.center_of_mass_tool,
        };
        let engine =
            SculptEngine::new(clay, self.sculpt.tool.clone(), body).with_setting_names(KEYS);
        let due = |TimedOrder { at, order, line, .. }: TimedOrder| ScriptedOrder {
            tick: (at.as_secs_f64() / self.plan.tick_s).round() as u64,
            order,
            line: Some(line),
        };
        let orders = self
            .script
            .as_mut()
            .map(|script| std::mem::take(&mut script.orders))
            .unwrap_or_default();
        let plan =
            SculptPlan { script: orders.into_iter().map(due).collect(), ..self.plan.clone() };
        let (slot, handle, thread) = sculpting::begin(engine, rendered, plan, control.clone())?;
        live.density = Some(slot);
        self.open = Some(Open { thread, handle, volume_before_m3: report.volume_m3 });
        Ok(())
    }

    /// The way to the clay; `None` before it is open.
    pub(crate) fn handle(&self) -> Option<&ClayHandle> {
        Some(&self.open.as_ref()?.handle)
    }

    /// The clay for clients; `None` before it is open.
    pub(crate) fn for_clients(&self, scene: &RenderScene) -> Option<ClayParts> {
        Some(ClayParts {
            access: Box::new(self.open.as_ref()?.handle.clone()),
            world_from_map: scene.clay.as_ref()?.world_from_map,
            kind: self.sculpt.tool.kind,
            folder: recording::state_folder().map(|state| state.join("clay")),
            session_at_end: self.outputs.iter().find_map(session_of),
        })
    }

    /// After the last tick: waits for the thread of the clay, writes what was asked for and says
    /// what went wrong. `None`: it was never open.
    pub(crate) fn close(self, output: OutputOptions) -> Option<SculptSummary> {
        let Open { thread, handle, volume_before_m3 } = self.open?;
        drop(handle);
        let SculptOutcome { report, mut engine } = match wait(thread, output) {
            Ok(ended) => ended,
            Err((why, hint)) => {
                report::error(why, Some(hint), output);
                return Some(SculptSummary {
                    engine: SculptReport {
                        broken: Some(why.to_owned()),
                        ..SculptReport::default()
                    },
                    ..SculptSummary::default()
                });
            }
        };
        let mut summary = SculptSummary {
            update_hz: 1.0 / (self.plan.update_ticks as f64 * self.plan.tick_s),
            volume_before_mm3: volume_before_m3.map(|volume_m3| volume_m3 * 1e9),
            volume_mm3: engine.model().volume_m3().map(|volume_m3| volume_m3 * 1e9),
            engine: report,
            ..SculptSummary::default()
        };
        for order in self.outputs {
            let (kind, file) = destination_of(&order);
            match carry_out(&mut engine, order) {
                Some(Ok(())) => summary.saved.push(SavedFile { kind, file }),
                Some(Err(error)) => {
                    report::error(&error.to_string(), Some(&hint(&error)), output);
                    summary.unsaved.push(SavedFile { kind, file });
                }
                None => {
                    let message = format!(
                        "cannot write {}: the program failed while it wrote it",
                        file.display()
                    );
                    report::error(
                        &message,
                        Some("this is a bug of hapticd: please report it"),
                        output,
                    );
                    summary.unsaved.push(SavedFile { kind, file });
                }
            }
        }
        if summary.is_at_risk() {
            summary.rescued = rescue(&mut engine, &self.name, output);
        } else if summary.saved.is_empty()
            && summary.engine.files.is_empty()
            && summary.engine.strokes > 0
        {
            report::note(
                "the strokes were not kept: --session FILE keeps all, --save FILE the samples, \
                    --export FILE a mesh",
                output,
            );
        }
        // A picture keeps no stroke, and one that cannot be drawn loses none.
        if let Some(pictures) = &self.pictures {
            for (file, drawn) in pictures.draw(engine.model()) {
                match drawn {
                    Ok(()) => summary.saved.push(SavedFile { kind: "picture", file }),
                    Err(error) => {
                        report::error(
                            &format!("cannot write {}: {error}", file.display()),
                            destination::hint(&error),
                            output,
                        );
                        summary.unsaved.push(SavedFile { kind: "picture", file });
                    }
                }
            }
        }
        // Those of strokes and clients came first; what is at risk is judged without them, as they
        // may be older than the last stroke.
        let earlier = std::mem::take(&mut summary.engine.files);
        summary
            .saved
            .splice(0..0, earlier.into_iter().map(|(kind, file)| SavedFile { kind, file }));
        summary.tell(self.script.as_ref().map(|script| &*script.file), self.plan.tick_s, output);
        Some(summary)
    }
}

impl ClayArgs {
    fn outputs(&self) -> Vec<SculptOrder> {
        let save = self.save.clone().map(SculptOrder::SavePoints);
        let session = self.session.clone().map(SculptOrder::SaveSession);
        [session, save, self.export.clone().map(SculptOrder::Export)]
            .into_iter()
            .flatten()
            .collect()
    }
}
