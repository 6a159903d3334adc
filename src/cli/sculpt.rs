//! `hapticd sculpt`: a piece of clay, worked with the arm, by script and from the monitor page.

use std::collections::HashSet;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use crossbeam::channel::{Receiver, RecvTimeoutError, never};
use serde::Serialize;

use super::render::{self, LoopArgs, Own};
use super::{Talk, destination, live, recording, report};
use crate::config::SceneConfig;
use crate::config::problem::show;
use crate::config::scene::SculptConfig;
use crate::config::strokes::{self, Timed};
use crate::daemon::Live;
use crate::daemon::studio::{self, Door, Ended, FailedOrder, Plan, StudioReport, StudioThread};
use crate::error::Exit;
use crate::haptics::RenderScene;
use crate::monitor::ClayParts;
use crate::picture::splats::{self, Subject};
use crate::rt::clock::ClockKind;
use crate::rt::utc::timestamp;
use crate::scene::Piece;
use crate::sculpt::PointSet;
use crate::sculpt::studio::{Order, Studio, StudioError, ToolBody};

/// How often somebody who waits for the studio looks whether it has ended.
const LOOK: Duration = Duration::from_millis(5);

/// Arguments of `hapticd sculpt`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    render: LoopArgs,
    #[command(flatten)]
    clay: ClayArgs,
    /// Let --record, --save, --session, --export, --pictures and strokes write over files that are there already.
    #[arg(long)]
    overwrite: bool,
}

/// What is to become of the clay.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Clay")]
pub(crate) struct ClayArgs {
    /// Strokes of this file instead of the scene's.
    #[arg(long, value_name = "FILE.toml")]
    strokes: Option<PathBuf>,
    /// At the end, write the samples with normals and colours.
    #[arg(long, value_name = "FILE.ply")]
    save: Option<PathBuf>,
    /// At the end, write all that is needed to go on another day: `session` under [sculpt] takes it.
    #[arg(long, value_name = "FILE")]
    session: Option<PathBuf>,
    /// At the end, write the piece as a closed mesh that `bake` and rigid scenes take.
    #[arg(long, value_name = "FILE.ply")]
    export: Option<PathBuf>,
    /// At the end, draw the piece as it was and as it is: SCENE-before.png and SCENE-after.png in this folder.
    #[arg(long, value_name = "DIR")]
    pictures: Option<PathBuf>,
}

pub(crate) fn main(args: &Args, talk: Talk, started_ns: i64) -> Exit {
    let own = Own { live: &live::LiveArgs::default(), clay: Some(&args.clay), overwrite: args.overwrite };
    render::main(&args.render, &own, talk, started_ns)
}

/// Where a piece is worked: planned, open while the loop runs, closed after it.
pub(crate) struct Workshop {
    plan: Plan,
    sculpt: SculptConfig,
    /// The stem of the scene's name.
    name: String,
    /// What is written at the end.
    outputs: Vec<Order>,
    pictures: Option<Pictures>,
    open: Option<Open>,
    interrupts: Receiver<()>,
}

/// Drawings of the piece at the start and at the end.
struct Pictures {
    /// Above the piece.
    title: String,
    /// What the files' names begin with.
    name: String,
    folder: PathBuf,
    before: PointSet,
}

struct Open {
    thread: StudioThread,
    /// Held for as long as the run goes on, for whoever asks.
    door: Door,
    volume_before_m3: Option<f64>,
}

impl Workshop {
    /// Reads the strokes and looks where files are to go, before anything takes long. `None`: the scene has no clay, and the command wants
    /// none.
    pub(crate) fn plan(config: &SceneConfig, own: &Own<'_>, clock: ClockKind, talk: Talk) -> Result<Option<Self>, Exit> {
        let path = config.path.display();
        let (sculpt, args) = match (&config.sculpt, own.clay) {
            (None, None) => return Ok(None),
            (Some(sculpt), Some(args)) => (sculpt.clone(), args),
            (Some(_), None) => {
                let hint = format!("`hapticd sculpt {path}` works it");
                report::error(&format!("{path}: [sculpt]: this scene has clay, and `run` is for rigid ones"), Some(&hint), talk);
                return Err(Exit::Configuration);
            }
            (None, Some(_)) => {
                let hint = format!("`hapticd run {path}` renders it; a [sculpt] table would give it clay");
                report::error(&format!("{path}: this scene has no clay to sculpt"), Some(&hint), talk);
                return Err(Exit::Configuration);
            }
        };
        let script = match args.strokes.as_ref().or(sculpt.strokes.as_ref()) {
            Some(file) => strokes::load(file, &sculpt.tool).map_err(|errors| report::config_errors(&errors, talk))?,
            None => Vec::new(),
        };
        let outputs = args.outputs();
        let pictures = args.pictures.as_ref().map(|folder| Pictures {
            title: config.name.clone(),
            name: config.path.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
            folder: folder.clone(),
            before: PointSet::default(),
        });
        check_outputs(config, &script, &outputs, pictures.as_ref(), own.overwrite, talk)?;
        let tick_s = config.parameters.period_s;
        let due = |(at, order): Timed| ((at.as_secs_f64() / tick_s).round() as u64, order);
        Ok(Some(Self {
            plan: Plan { tick_s, update_ticks: sculpt.update_ticks, clock, script: script.into_iter().map(due).collect() },
            name: config.path.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
            outputs,
            pictures,
            sculpt,
            open: None,
            interrupts: never(),
        }))
    }

    /// Begins to work the piece: the loop gets its clay.
    pub(crate) fn open(&mut self, piece: Piece, scene: &RenderScene, live: &mut Live) -> std::io::Result<()> {
        let Some(clay) = &scene.clay else { return Ok(()) };
        let Piece { workpiece, tool_shape, report } = piece;
        if let Some(pictures) = &mut self.pictures {
            pictures.before = workpiece.points().clone();
        }
        let body = ToolBody { shape: Some(tool_shape), center_of_mass_tool: scene.tool.center_of_mass_tool };
        let studio = Studio::new(workpiece, self.sculpt.tool.clone(), body);
        let plan = Plan { script: std::mem::take(&mut self.plan.script), ..self.plan.clone() };
        let (slot, door, thread) = studio::begin(studio, clay, plan)?;
        live.clay = Some(slot);
        self.open = Some(Open { thread, door, volume_before_m3: report.volume_m3 });
        Ok(())
    }

    /// The clay for those who ask and look; `None` before it is open.
    pub(crate) fn for_clients(&self, scene: &RenderScene) -> Option<ClayParts> {
        Some(ClayParts {
            door: Box::new(self.open.as_ref()?.door.clone()),
            world_from_map: scene.clay.as_ref()?.world_from_map,
            craft: self.sculpt.tool.craft,
            folder: recording::state_folder().map(|state| state.join("clay")),
            session_at_end: self.outputs.iter().find_map(session_of),
        })
    }

    /// From now on whoever interrupts does so while the studio is waited for as well.
    pub(crate) fn heed(&mut self, interrupts: Receiver<()>) {
        self.interrupts = interrupts;
    }

    /// After the last tick: waits for the studio, writes what was asked for and says what went wrong. `None`: it was never open.
    pub(crate) fn close(self, talk: Talk) -> Option<SculptReport> {
        let Open { thread, door, volume_before_m3 } = self.open?;
        drop(door);
        let Ended { report, mut studio } = match wait(thread, &self.interrupts, talk) {
            Ok(ended) => ended,
            Err((why, hint)) => {
                report::error(why, Some(hint), talk);
                return Some(SculptReport {
                    studio: StudioReport { broken: Some(why.to_owned()), ..StudioReport::default() },
                    ..SculptReport::default()
                });
            }
        };
        let mut summary = SculptReport {
            update_hz: 1.0 / (self.plan.update_ticks as f64 * self.plan.tick_s),
            volume_before_mm3: volume_before_m3.map(|volume_m3| volume_m3 * 1e9),
            volume_mm3: studio.piece().volume_m3().map(|volume_m3| volume_m3 * 1e9),
            studio: report,
            ..SculptReport::default()
        };
        for order in self.outputs {
            let (kind, file) = destination_of(&order);
            match carry_out(&mut studio, order) {
                Some(Ok(())) => summary.saved.push(Saved { kind, file }),
                Some(Err(error)) => {
                    report::error(&error.to_string(), Some(hint(&error)), talk);
                    summary.unsaved.push(Saved { kind, file });
                }
                None => {
                    let message = format!("cannot write {}: the studio broke over it", file.display());
                    report::error(&message, Some("this is a bug of hapticd: please report it"), talk);
                    summary.unsaved.push(Saved { kind, file });
                }
            }
        }
        if summary.is_at_risk() {
            summary.rescued = rescue(&mut studio, &self.name, talk);
        } else if summary.saved.is_empty() && summary.studio.files == 0 && summary.studio.strokes > 0 {
            report::note(
                "the strokes were not kept: --session FILE keeps all, --save FILE the samples, --export FILE a mesh",
                talk,
            );
        }
        // A picture keeps no stroke, and one that cannot be drawn loses none.
        if let Some(pictures) = &self.pictures {
            for (file, drawn) in pictures.draw(studio.piece().points()) {
                match drawn {
                    Ok(()) => summary.saved.push(Saved { kind: "picture", file }),
                    Err(error) => {
                        report::error(&format!("cannot write {}: {error}", file.display()), destination::hint(&error), talk);
                        summary.unsaved.push(Saved { kind: "picture", file });
                    }
                }
            }
        }
        summary.tell(talk);
        Some(summary)
    }
}

impl Pictures {
    fn file(&self, moment: &str) -> PathBuf {
        self.folder.join(format!("{}-{moment}.png", self.name))
    }

    fn files(&self) -> [PathBuf; 2] {
        ["before", "after"].map(|moment| self.file(moment))
    }

    /// Draws both at one scale.
    fn draw(&self, after: &PointSet) -> [(PathBuf, std::io::Result<()>); 2] {
        let moments = [("before", &self.before, after), ("after", after, &self.before)];
        moments.map(|(moment, points, beside)| {
            let (name, file) = (format!("{}, {moment}", self.title), self.file(moment));
            let written = splats::write(&file, &[Subject { name: &name, points, beside: Some(beside) }]);
            (file, written)
        })
    }
}

impl ClayArgs {
    fn outputs(&self) -> Vec<Order> {
        let save = self.save.clone().map(Order::SavePoints);
        let session = self.session.clone().map(Order::SaveSession);
        [save, session, self.export.clone().map(Order::Export)].into_iter().flatten().collect()
    }
}

/// Refuses what cannot be written or may not be written over.
fn check_outputs(
    config: &SceneConfig,
    script: &[Timed],
    outputs: &[Order],
    pictures: Option<&Pictures>,
    overwrite: bool,
    talk: Talk,
) -> Result<(), Exit> {
    let refuse = |exit: Exit, message: String, hint: Option<&str>| {
        report::error(&message, hint, talk);
        Err(exit)
    };
    let own = outputs.iter().map(destination_of);
    if let Some((_, file)) = own.clone().find(|(kind, file)| *kind != "session" && !is_ply(file)) {
        return refuse(Exit::Usage, format!("{}: samples and meshes are .ply files", file.display()), None);
    }
    let mut files: Vec<PathBuf> = own.map(|(_, file)| file).collect();
    files.extend(strokes::outputs(script).map(Path::to_owned));
    if let Some(pictures) = pictures {
        if let Err(error) = std::fs::create_dir_all(&pictures.folder) {
            let message = format!("cannot make the folder {}: {error}", pictures.folder.display());
            return refuse(Exit::Asset, message, destination::hint(&error));
        }
        files.extend(pictures.files());
    }
    let mut places = HashSet::new();
    for file in &files {
        if !places.insert(place_of(file)) {
            let hint = "give each its own name";
            return refuse(Exit::Usage, format!("{} would be written twice", file.display()), Some(hint));
        }
        if let Err(error) = destination::check(file) {
            let message = format!("cannot write {}: {error}", file.display());
            return refuse(Exit::Asset, message, destination::hint(&error));
        }
        let is_scene = |path: &Path| file.canonicalize().is_ok_and(|file| path.canonicalize().is_ok_and(|path| path == file));
        if is_scene(&config.path) {
            return refuse(Exit::Usage, format!("{} is the scene itself: name another file to write", file.display()), None);
        }
        if file.exists() && !overwrite {
            let hint = "name another file, or give --overwrite";
            return refuse(Exit::Usage, format!("{} is there already", file.display()), Some(hint));
        }
    }
    Ok(())
}

/// The same for every way to write the name of a file, there or not.
fn place_of(file: &Path) -> PathBuf {
    let folder = file.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    match (folder.canonicalize(), file.file_name()) {
        (Ok(folder), Some(name)) => folder.join(name),
        _ => file.to_owned(),
    }
}

fn is_ply(file: &Path) -> bool {
    file.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("ply"))
}

/// What an order writes, and where.
fn destination_of(order: &Order) -> (&'static str, PathBuf) {
    match order {
        Order::SavePoints(file) => ("points", file.clone()),
        Order::SaveSession(file) => ("session", file.clone()),
        Order::Export(file) => ("mesh", file.clone()),
        // True invariant: made by `ClayArgs::outputs`.
        _ => unreachable!("an order that writes nothing"),
    }
}

/// Where an order writes a session, whatever the working directory is; `None`: it writes none.
fn session_of(order: &Order) -> Option<PathBuf> {
    match order {
        Order::SaveSession(file) => Some(std::path::absolute(file).unwrap_or_else(|_| file.clone())),
        _ => None,
    }
}

fn hint(error: &StudioError) -> &'static str {
    match error {
        StudioError::Write { source, .. } => destination::hint(source).unwrap_or(error.hint()),
        _ => error.hint(),
    }
}

/// Waits for a studio that finishes what it does. Whoever interrupts hears of that; the second time nobody waits any more.
fn wait(thread: StudioThread, interrupts: &Receiver<()>, talk: Talk) -> Result<Ended, (&'static str, &'static str)> {
    thread.end();
    let mut interrupts = interrupts.clone();
    let mut was_asked = false;
    while !thread.has_ended() {
        match interrupts.recv_timeout(LOOK) {
            Ok(()) if was_asked => return Err(("the studio was not waited for", "what was not saved before is lost")),
            Ok(()) => {
                was_asked = true;
                report::note("the studio finishes what it does; interrupt once more to end without what it would save", talk);
            }
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => interrupts = never(),
        }
    }
    thread.join().map_err(|why| (why, "this is a bug of hapticd: the piece is lost"))
}

/// An order after the last tick; `None`: the studio panicked. What else there is to be written is not to suffer.
fn carry_out(studio: &mut Studio, order: Order) -> Option<Result<(), StudioError>> {
    catch_unwind(AssertUnwindSafe(|| studio.order(order))).ok()
}

/// Keeps the session where it surely can be written: among what the program keeps for itself, else among temporary files.
fn rescue(studio: &mut Studio, name: &str, talk: Talk) -> Option<PathBuf> {
    let file = format!("{name}-{}-{}.session", timestamp(SystemTime::now()), std::process::id());
    let folders = [recording::state_folder().map(|state| state.join("rescued")), Some(std::env::temp_dir())];
    for folder in folders.into_iter().flatten() {
        let path = folder.join(&file);
        if std::fs::create_dir_all(&folder).is_ok() && matches!(carry_out(studio, Order::SaveSession(path.clone())), Some(Ok(()))) {
            let hint = format!("`session = \"{}\"` under [sculpt] goes on from there", path.display());
            report::warning(&format!("nothing is lost: the whole session is in {}; {hint}", path.display()), talk);
            return Some(path);
        }
    }
    report::error("the session could not be kept anywhere", Some("free some space on the disk"), talk);
    None
}

/// A file that was written.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Saved {
    /// `points`, `session`, `mesh` or `picture`.
    kind: &'static str,
    file: PathBuf,
}

/// What became of the clay, as `--json` has it.
#[derive(Clone, Debug, Default)]
pub(crate) struct SculptReport {
    studio: StudioReport,
    update_hz: f64,
    volume_before_mm3: Option<f64>,
    volume_mm3: Option<f64>,
    saved: Vec<Saved>,
    unsaved: Vec<Saved>,
    rescued: Option<PathBuf>,
}

impl Serialize for SculptReport {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        #[derive(Serialize)]
        struct Failed<'r> {
            tick: u64,
            scripted: bool,
            what: &'r str,
            why: &'r str,
        }
        #[derive(Serialize)]
        struct Shape<'r> {
            samples_before: usize,
            samples: usize,
            strokes: u64,
            update_hz: f64,
            updates: u64,
            late: u64,
            volume_before_mm3: Option<f64>,
            volume_mm3: Option<f64>,
            saved: &'r [Saved],
            unsaved: &'r [Saved],
            #[serde(skip_serializing_if = "Option::is_none")]
            rescued: Option<&'r Path>,
            failed: Vec<Failed<'r>>,
            left_over: usize,
            troubles: &'r [String],
            #[serde(skip_serializing_if = "Option::is_none")]
            broken: Option<&'r str>,
        }
        let StudioReport { updates, late, strokes, samples_before, samples, failed, left_over, troubles, broken, files: _ } =
            &self.studio;
        let failed = failed.iter().map(|FailedOrder { tick, is_scripted, what, why }| Failed {
            tick: *tick,
            scripted: *is_scripted,
            what,
            why,
        });
        let shape = Shape {
            samples_before: *samples_before,
            samples: *samples,
            strokes: *strokes,
            update_hz: self.update_hz,
            updates: *updates,
            late: *late,
            volume_before_mm3: self.volume_before_mm3,
            volume_mm3: self.volume_mm3,
            saved: &self.saved,
            unsaved: &self.unsaved,
            rescued: self.rescued.as_deref(),
            failed: failed.collect(),
            left_over: *left_over,
            troubles,
            broken: broken.as_deref(),
        };
        shape.serialize(serializer)
    }
}

impl SculptReport {
    /// Something was to be kept and was not, and no session has it.
    fn is_at_risk(&self) -> bool {
        let writes = |order: &FailedOrder| matches!(&order.what[..], "save-points" | "save-session" | "export");
        let has_failed = !self.unsaved.is_empty() || self.studio.broken.is_some() || self.studio.failed.iter().any(writes);
        has_failed && !self.saved.iter().any(|saved| saved.kind == "session")
    }

    /// A script that was not carried out, or a file that was not written, is not what was asked for.
    pub(crate) fn exit(&self) -> Exit {
        if self.studio.broken.is_some() {
            Exit::Internal
        } else if !self.unsaved.is_empty() || self.studio.failed.iter().any(|order| order.is_scripted) {
            Exit::Asset
        } else {
            Exit::Ok
        }
    }

    fn tell(&self, talk: Talk) {
        let StudioReport { failed, left_over, troubles, broken, .. } = &self.studio;
        for FailedOrder { tick, is_scripted, what, why } in failed {
            let who = if *is_scripted { "stroke" } else { "order" };
            report::warning(&format!("{who} not carried out: {what} (tick {tick}): {why}"), talk);
        }
        for trouble in troubles {
            report::warning(&format!("clay: {trouble}"), talk);
        }
        if *left_over > 0 {
            report::warning(&format!("the run ended before {left_over} orders of the strokes were due"), talk);
        }
        if let Some(broken) = broken {
            report::error(
                &format!("the studio ended before the loop: {broken}"),
                Some("this is a bug of hapticd: please report it"),
                talk,
            );
        }
    }

    /// Rows of the summary.
    pub(crate) fn rows(&self) -> Vec<(&'static str, String)> {
        let StudioReport { updates, late, strokes, samples_before, samples, .. } = &self.studio;
        let volume = |mm3: Option<f64>| mm3.map_or("open".to_owned(), |mm3| format!("{mm3:.1}"));
        let strokes_word = if *strokes == 1 { "stroke" } else { "strokes" };
        let mut rows = vec![
            ("clay", format!("{strokes} {strokes_word}, {samples_before} samples before, {samples} after")),
            ("volume", format!("{} mm³ before, {} mm³ after", volume(self.volume_before_mm3), volume(self.volume_mm3))),
            ("updates", format!("{updates} at {} Hz, {late} left out because they were late", show(self.update_hz))),
        ];
        let saved = self.saved.iter().map(|Saved { kind, file }| ("saved", format!("{kind} in {}", file.display())));
        rows.extend(saved);
        rows
    }
}
