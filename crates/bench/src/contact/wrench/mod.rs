//! The benchmark of 6-DoF contact wrenches: what a program makes of given poses, beside closed
//! forms, and whether it is smooth, consistent and fast.
//!
//! | file | owns |
//! |---|---|
//! | `scenes` | parts, trajectories |
//! | `laws` | closed forms of force and torque |
//! | `files` | folders of scenes, CSVs of wrenches |
//! | `programs` | hapticd, peers |
//! | `metrics` | figures |
//! | `page` | the page of results |
//!
//! What is compared, and how to join with a CSV: docs/reference/wrench-benchmark.md.

mod files;
mod laws;
mod metrics;
mod page;
mod programs;
mod scenes;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use twox_hash::XxHash3_64;

use self::files::{About, Answer};
use self::metrics::{FIGURES, Samples};
use self::programs::{PEERS, SETTINGS};
use self::scenes::{Kind, Scene, TICKS, Trajectory};
use super::super::export::TemporaryFolder;
use super::super::{BenchError, Row};
use vps::spatial::Wrench;

pub use page::page;

/// What to measure, and with what.
#[derive(Clone, Debug)]
pub struct Options {
    /// hapticd as it is and on scenes with closed forms only.
    pub quick: bool,
    /// Where scenes are written, and wrenches written and found; `None`: a temporary folder.
    pub folder: Option<PathBuf>,
    /// Folder of real meshes; without it those scenes are skipped.
    pub models: Option<PathBuf>,
    /// Folder with the Python of the peers; without it they are skipped.
    pub peers: Option<PathBuf>,
    /// The program that measures.
    pub program: PathBuf,
}

/// What one program made of all scenes.
#[derive(Debug)]
pub struct Program {
    /// Of its folder.
    pub name: String,
    /// What its forces are multiplied by.
    scale: Option<f64>,
    /// Of each scene; without wrenches where it has none.
    answers: Vec<Answer>,
}

/// What [`run`] found.
#[derive(Debug)]
pub struct Figures {
    /// hapticd, its peers, and other programs whose wrenches are there.
    pub programs: Vec<Program>,
    scenes: Vec<Scene>,
    /// Of meshes, poses and closed forms of the scenes with one.
    hash: u64,
    /// What was not measured, and why.
    skipped: Vec<String>,
}

/// A trajectory with what a program made of it.
struct AnsweredTrajectory<'a> {
    scene: &'a Scene,
    trajectory: &'a Trajectory,
    wrenches: &'a [Wrench],
    query_ns: &'a [f64],
    about: &'a About,
}

/// Writes the scenes, asks every program, and judges its wrenches. `tell` is called with each step.
///
/// Cost: half an hour with all peers; quick, some seconds.
///
/// # Errors
/// A file that cannot be written or read, a CSV that does not fit its poses, a scene that `hapticd`
/// cannot bake. A peer that is not there is skipped.
pub fn run(options: &Options, mut tell: impl FnMut(&str)) -> Result<Figures, BenchError> {
    let temporary = TemporaryFolder::create()
        .map_err(|source| BenchError::Write { path: std::env::temp_dir(), source })?;
    let folder = options.folder.clone().unwrap_or_else(|| temporary.path().to_owned());
    files::make_folder(&folder)?;
    // As programs in folders of their own find it.
    let folder =
        folder.canonicalize().map_err(|source| BenchError::Write { path: folder, source })?;
    let mut skipped = Vec::new();
    let mut scenes = scenes::closed_forms();
    let mut hash = XxHash3_64::new();
    let scene_folder = |scene: &Scene| folder.join("scenes").join(scene.name);
    for scene in &scenes {
        files::write_scene(&scene_folder(scene), scene, &mut hash)?;
    }
    let hash = std::hash::Hasher::finish(&hash);
    for scene in scenes::without_closed_form() {
        files::write_scene(&scene_folder(&scene), &scene, &mut XxHash3_64::new())?;
        scenes.push(scene);
    }
    match &options.models {
        _ if options.quick => skipped.push("real parts: --quick".to_owned()),
        None => skipped.push("real parts: HAPTICD_MODELS not set".to_owned()),
        Some(models) => {
            for found in scenes::real_parts(models) {
                match found {
                    Ok(scene) => {
                        files::write_scene(&scene_folder(&scene), &scene, &mut XxHash3_64::new())?;
                        scenes.push(scene);
                    }
                    Err(why) => skipped.push(why),
                }
            }
        }
    }
    let wrenches = folder.join("wrenches");
    files::make_folder(&wrenches)?;
    let answer_of =
        |name: &str, scene: &Scene| wrenches.join(name).join(format!("{}.csv", scene.name));
    let answers = |name: &str| {
        let all = scenes
            .iter()
            .map(|scene| files::read_answer(&answer_of(name, scene), scene.ticks().count()));
        all.collect::<Result<Vec<Answer>, BenchError>>()
    };
    let (known, others) = names(&wrenches)?;
    // A file that does not fit is better known before minutes of measuring.
    let mut joined = Vec::new();
    for name in others {
        let answers = answers(&name)?;
        joined.push((name, answers));
    }
    for setting in if options.quick { &SETTINGS[..1] } else { &SETTINGS[..] } {
        for scene in &scenes {
            tell(&format!("{}: {}", setting.name, scene.name));
            programs::ask_hapticd(
                setting,
                &options.program,
                &scene_folder(scene),
                &answer_of(setting.name, scene),
            )?;
        }
    }
    // Without peers at hand, what they answered before is judged.
    for (name, script) in PEERS.into_iter().filter(|_| !options.quick && options.peers.is_some()) {
        for scene in &scenes {
            tell(&format!("{name}: {}", scene.name));
            programs::ask_peer(
                script,
                options.peers.clone(),
                &scene_folder(scene),
                &answer_of(name, scene),
            )?;
        }
    }
    let mut answered = Vec::new();
    for name in known {
        answered.push((name.to_owned(), answers(name)?));
    }
    let mut programs = Vec::new();
    for (name, answers) in answered.into_iter().chain(joined) {
        for (scene, answer) in scenes.iter().zip(&answers) {
            skipped.extend(
                answer
                    .about
                    .not_measured
                    .iter()
                    .map(|why| format!("{name}, {}: {why}", scene.name)),
            );
        }
        if !answers.iter().any(Answer::is_there) {
            skipped.push(format!(
                "{name}: no answers; its adapter needs HAPTICD_PEERS, and no --quick"
            ));
            continue;
        }
        let scale = metrics::scale(
            pieces(&scenes, &answers).map(|piece| (piece.trajectory, piece.wrenches)),
        );
        programs.push(Program { name, scale, answers });
    }
    Ok(Figures { programs, scenes, hash, skipped })
}

/// Programs that are asked here, and folders of the wrenches of others, in which a file of no scene
/// is refused.
fn names(wrenches: &Path) -> Result<(Vec<&'static str>, BTreeSet<String>), BenchError> {
    let refused = |error: std::io::Error| BenchError::Prepare {
        what: wrenches.display().to_string(),
        why: error.to_string(),
    };
    let scenes = wrenches.with_file_name("scenes");
    let known: Vec<&str> =
        SETTINGS.iter().map(|setting| setting.name).chain(PEERS.map(|(name, _)| name)).collect();
    let mut others = BTreeSet::new();
    for entry in wrenches.read_dir().map_err(refused)? {
        let name = entry.map_err(refused)?.file_name().to_string_lossy().into_owned();
        if known.contains(&name.as_str()) || !wrenches.join(&name).is_dir() {
            continue;
        }
        for entry in wrenches.join(&name).read_dir().map_err(refused)? {
            let file = entry.map_err(refused)?.path();
            let is_answer =
                file.extension().is_some_and(|extension| extension == "csv" || extension == "json");
            if is_answer && !scenes.join(file.file_stem().unwrap_or_default()).is_dir() {
                let why = format!(
                    "there is no scene of this name: name it after a folder of {}",
                    scenes.display()
                );
                return Err(BenchError::Prepare { what: file.display().to_string(), why });
            }
        }
        others.insert(name);
    }
    Ok((known, others))
}

/// Trajectories of a scene lie one behind the other.
fn pieces<'a>(
    scenes: &'a [Scene],
    answers: &'a [Answer],
) -> impl Iterator<Item = AnsweredTrajectory<'a>> {
    let answered = scenes.iter().zip(answers).filter(|(_, answer)| answer.is_there());
    answered.flat_map(|(scene, Answer { wrenches, query_ns, about })| {
        scene.trajectories.iter().enumerate().map(move |(n, trajectory)| {
            let ticks = n * TICKS..(n + 1) * TICKS;
            let query_ns = query_ns.get(ticks.clone()).unwrap_or_default();
            let wrenches = wrenches.get(ticks).unwrap_or_default();
            AnsweredTrajectory { scene, trajectory, wrenches, query_ns, about }
        })
    })
}

impl Figures {
    /// Figures of a program, over the trajectories that are wanted, in the order of [`FIGURES`];
    /// `None` where it answered none of them.
    fn of(
        &self,
        program: &Program,
        wanted: impl Fn(&Scene, &Trajectory) -> bool,
    ) -> Option<[Option<f64>; FIGURES.len()]> {
        let mut samples = Samples::default();
        let mut is_answered = false;
        for piece in pieces(&self.scenes, &program.answers)
            .filter(|piece| wanted(piece.scene, piece.trajectory))
        {
            is_answered = true;
            samples.add(
                piece.trajectory,
                piece.wrenches,
                piece.query_ns,
                program.scale.unwrap_or(1.0),
            );
            samples.memory_mb.extend(piece.about.memory_mb);
            samples.bake_s.extend(piece.about.bake_s);
        }
        is_answered.then(|| samples.figures())
    }

    /// Of the first contact of each scene that is held, for plots: its name, force after scaling in
    /// % of the closed form, and angle to it, °.
    pub fn held(&self, program: &Program) -> Vec<(String, Vec<[f64; 2]>)> {
        let is_held = |of: &Trajectory| of.kind == Kind::Steady && of.ticks[0].law.is_some();
        let mut found: Vec<(String, Vec<[f64; 2]>)> = Vec::new();
        for AnsweredTrajectory { scene, trajectory, wrenches, .. } in
            pieces(&self.scenes, &program.answers).filter(|piece| !piece.wrenches.is_empty())
        {
            if scene
                .trajectories
                .iter()
                .find(|of| is_held(of))
                .is_some_and(|first| first.name == trajectory.name)
            {
                let scale = program.scale.unwrap_or(1.0);
                let ticks = trajectory.ticks.iter().zip(wrenches);
                let values = ticks.map(|(tick, wrench)| {
                    metrics::beside(tick.law, wrench, scale).unwrap_or([f64::NAN; 2])
                });
                found.push((format!("{}, {}", scene.name, trajectory.name), values.collect()));
            }
        }
        found
    }

    /// Every figure over the scenes with closed forms, with what is asked of hapticd.
    pub fn rows(&self) -> Vec<Row> {
        let mut rows = Vec::new();
        for program in &self.programs {
            let group = |title: &str| format!("wrench: {}, {}", program.name, title.to_lowercase());
            for (title, is_sharp) in page::KINDS {
                let wanted = |scene: &Scene, trajectory: &Trajectory| {
                    scene.has_law(trajectory) && scene.is_sharp() == is_sharp
                };
                for (value, (name, unit)) in
                    self.of(program, wanted).into_iter().flatten().zip(FIGURES)
                {
                    let row = Row::new(&group(title), name, value, unit);
                    let is_asked = program.name == SETTINGS[0].name;
                    rows.push(if is_asked { asked(name, is_sharp, row) } else { row });
                }
            }
            rows.push(Row::new(&group(page::KINDS[0].0), "scale", program.scale, ""));
        }
        rows
    }
}

/// What is asked of hapticd: of tips, edges and wedges what any scene of this kind should have;
/// of others what was measured, with room for another processor's rounding and for other scenes.
fn asked(name: &str, is_sharp: bool, row: Row) -> Row {
    let most = match name {
        "angle, p95" if is_sharp => 2.0,
        "size off, p95" if is_sharp => 10.0,
        "work of a loop" if is_sharp => 1.0,
        "line of action off, p95" | "ripple above 10 Hz" | "largest step" if is_sharp => {
            return row;
        }
        "angle, p95" => 1.0,
        "line of action off, p95" => 0.02,
        // Of which 2 % may be the meshes'.
        "size off, p95" => 5.0,
        "no force" | "force in a near miss" => 0.0,
        "ripple above 10 Hz" | "work of a loop" => 0.2,
        "largest step" => 1.0,
        _ => return row,
    };
    row.at_most(most)
}
