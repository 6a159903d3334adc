//! `bench`: figures beside the papers' and beside other programs'.
//!
//! Bakes and runs are measured in processes of their own: this program started again under the name
//! `hapticd`, which it then is.
#![expect(clippy::print_stderr, reason = "a program of the command line")]

mod plots;

use std::io::{ErrorKind, Write as _};
use std::path::PathBuf;
use std::process::ExitCode;

use bench::contact::wrench;
use bench::{
    BenchError, BenchReport, HAPTICD, MachineInfo, Row, commit_of, contact, generation, loops,
    sagardia2008, sculpt,
};
use clap::{Parser, ValueEnum};
use hapticd::error::Exit;

/// Measure, beside the papers' figures and other programs.
#[derive(Debug, Parser)]
#[command(
    version,
    max_term_width = 100,
    after_help = "HAPTICD_MODELS names a folder with real meshes: stanford-bunny.obj, \
        factory_bolt_m16_tight.obj and others. HAPTICD_PEERS names a folder with openvdb_level_set \
        and voxel_grids.py (generation), coal_contacts.py, parry_contacts and embree_distance.py \
        (contact), and venv/bin/python for the scripts, with drake, mujoco and coal (wrench). \
        `loop` runs cyclictest where it is installed. What is missing is skipped and said."
)]
struct Args {
    /// What to measure, one or more; generation, contact, loop and sculpt if not given.
    #[arg(value_name = "GROUP")]
    group: Vec<Group>,
    /// Runs of each case; figures are medians [default: 3, with --quick 1].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100))]
    runs: Option<u32>,
    /// Threads of a bake and processors of a peer; all processors if not given. sagardia-2008 has
    /// one.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024))]
    threads: Option<u32>,
    /// Small cases only: does it work, not how fast is it.
    #[arg(long)]
    quick: bool,
    /// With contact: how right and how smooth forces are, not how fast.
    #[arg(long)]
    quality: bool,
    /// With --quality: write raw results there as CSV files.
    #[arg(long, value_name = "DIR", requires = "quality")]
    csv: Option<PathBuf>,
    /// With --quality or sculpt: draw how smooth forces are there, as SVG files.
    #[arg(long, value_name = "DIR")]
    plots: Option<PathBuf>,
    /// With wrench: where scenes are written, and wrenches are written and found; a temporary
    /// folder if not given.
    #[arg(long, value_name = "DIR")]
    folder: Option<PathBuf>,
    /// With sagardia-2008 or wrench: write its page and plots into this folder, below reference/
    /// and pictures/.
    #[arg(long, value_name = "DIR")]
    docs: Option<PathBuf>,
    /// Folder of the scenes that contact and loop play.
    #[arg(long, value_name = "DIR", default_value = "config/scenes")]
    scenes: PathBuf,
    /// Print exactly one JSON object.
    #[arg(long)]
    json: bool,
    /// Say errors only.
    #[arg(short, long)]
    quiet: bool,
}

/// Groups of figures.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Group {
    /// Voxmaps and pointshells.
    Generation,
    /// Contact queries.
    Contact,
    /// The 1 kHz loop.
    Loop,
    /// A million points in a violent hand: ten minutes of simulated time, two of real time. Only
    /// when asked for.
    Stress,
    /// Parts inserted at several voxel sizes, clearances and errors of the hand. Only when asked
    /// for.
    Insertions,
    /// Sculpting.
    Sculpt,
    /// Table 1, figures 6 and 7 and the remarks of the paper of 2008. Only when asked for.
    #[value(name = "sagardia-2008")]
    Sagardia2008,
    /// Contact wrenches of several programs beside closed forms. Only when asked for.
    Wrench,
}

impl Args {
    fn wants(&self, group: Group) -> bool {
        let is_on_request = matches!(
            group,
            Group::Stress | Group::Insertions | Group::Sagardia2008 | Group::Wrench
        );
        if self.group.is_empty() { !is_on_request } else { self.group.contains(&group) }
    }
}

fn main() -> ExitCode {
    // A bake or a run that is measured.
    if std::env::args_os().next().is_some_and(|name| name == HAPTICD) {
        return hapticd::cli::main();
    }
    let args = Args::parse();
    run(&args)
        .unwrap_or_else(|(exit, message)| {
            eprintln!("error: {message}");
            exit
        })
        .into()
}

/// Measures and prints, or says why not.
fn run(args: &Args) -> Result<Exit, (Exit, String)> {
    if args.plots.is_some() && !args.quality && !args.wants(Group::Sculpt) {
        return Err((
            Exit::Usage,
            "--plots draws what --quality or sculpt measures: bench sculpt --plots DIR".to_owned(),
        ));
    }
    if args.quality && args.group != [Group::Contact] {
        return Err((
            Exit::Usage,
            "--quality goes with contact: bench contact --quality".to_owned(),
        ));
    }
    if args.docs.is_some() && !args.wants(Group::Sagardia2008) && !args.wants(Group::Wrench) {
        let message =
            "--docs writes the page of sagardia-2008 or wrench: bench sagardia-2008 --docs docs";
        return Err((Exit::Usage, message.to_owned()));
    }
    if args.folder.is_some() && !args.wants(Group::Wrench) {
        return Err((
            Exit::Usage,
            "--folder holds the files of wrench: bench wrench --folder DIR".to_owned(),
        ));
    }
    let program = std::env::current_exe().map_err(|error| {
        (
            Exit::Internal,
            format!("the path of this program is not known, so it cannot start itself: {error}"),
        )
    })?;
    let n_threads = args.threads.map_or_else(
        || std::thread::available_parallelism().map_or(1, usize::from),
        |n| n as usize,
    );
    // The pool of the process: nothing has used it before.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build_global();
    debug_assert!(pool.is_ok(), "the global pool is built once");
    let commit = commit_of(&program);
    let machine = MachineInfo::read();
    let facts = machine.facts(commit.as_deref());
    let (rows, table) = measure(args, program, n_threads, &facts)
        .map_err(|error| (Exit::Asset, error.to_string()))?;
    let report = BenchReport { machine, commit, rows };
    let text = if args.json {
        serde_json::to_string(&report).map_err(|error| (Exit::Internal, error.to_string()))? + "\n"
    } else {
        format!("{}{table}", report.markdown())
    };
    match std::io::stdout().write_all(text.as_bytes()) {
        // A reader that has seen enough is no failure.
        Err(error) if error.kind() != ErrorKind::BrokenPipe => {
            Err((Exit::Asset, format!("cannot write the result to stdout: {error}")))
        }
        _ => Ok(Exit::Ok),
    }
}

/// Folders of `docs` that pages and their plots go into.
const PAGES: &str = "reference";
const PICTURES: &str = "pictures";

/// The rows of the group, or of all of them, and what goes under their tables. `machine`: where it
/// runs, for a page.
fn measure(
    args: &Args,
    program: PathBuf,
    n_threads: usize,
    machine: &str,
) -> Result<(Vec<Row>, String), BenchError> {
    let reported = |what: &str| {
        if !args.quiet {
            eprintln!("{what}");
        }
    };
    let folder = |name: &str| std::env::var_os(name).map(PathBuf::from);
    let models = folder("HAPTICD_MODELS");
    let peers = folder("HAPTICD_PEERS");
    let n_runs = args.runs.unwrap_or(if args.quick { 1 } else { 3 }) as usize;
    let wanted = |group: Group| args.wants(group);
    // A folder that cannot be made is better known before minutes of measuring.
    if let Some(folder) = &args.plots {
        plots::make_folder(folder)?;
    }
    for folder in args.docs.iter().flat_map(|docs| [PAGES, PICTURES].map(|of| docs.join(of))) {
        plots::make_folder(&folder)?;
    }
    let mut rows = Vec::new();
    let mut table = String::new();
    if wanted(Group::Generation) {
        let program = program.clone();
        let models = models.clone();
        let peers = peers.clone();
        rows.extend(generation::run(
            &generation::Options { n_runs, n_threads, quick: args.quick, models, peers, program },
            reported,
        )?);
    }
    let options = contact::Options {
        n_runs,
        quick: args.quick,
        scenes: args.scenes.clone(),
        csv: args.csv.clone(),
        models,
        peers,
    };
    if wanted(Group::Contact) {
        if args.quality {
            let quality = contact::quality(&options, reported)?;
            if let Some(folder) = &args.plots {
                plots::draw(folder, &quality)?;
            }
            rows.extend(quality.rows);
            table = quality.choice;
        } else {
            rows.extend(contact::speed(&options, reported)?);
        }
    }
    if wanted(Group::Stress) {
        rows.extend(contact::stress(&options, reported)?);
    }
    if wanted(Group::Insertions) {
        let (found, markdown) = contact::insertions(&options, reported)?;
        rows.extend(found);
        table.push_str(&markdown);
    }
    if wanted(Group::Loop) {
        rows.extend(loops::run(
            &loops::Options {
                program: program.clone(),
                quick: args.quick,
                scenes: args.scenes.clone(),
            },
            reported,
        )?);
    }
    if wanted(Group::Sculpt) {
        let figures = sculpt::run(&sculpt::Options { n_runs, quick: args.quick }, reported)?;
        if let Some(folder) = &args.plots {
            plots::draw_receding(folder, &figures.receding)?;
        }
        rows.extend(figures.rows);
    }
    if wanted(Group::Sagardia2008) {
        let figures =
            sagardia2008::run(sagardia2008::Options { n_runs, quick: args.quick }, reported)?;
        if let Some(docs) = &args.docs {
            plots::draw_paper_of_2008(&docs.join(PICTURES), &figures)?;
            sagardia2008::draw_models(&docs.join(PICTURES), &figures)?;
            let path = docs.join(PAGES).join("sagardia-2008.md");
            let text = sagardia2008::page(&figures, machine);
            std::fs::write(&path, text).map_err(|source| BenchError::Write { path, source })?;
        }
        rows.extend(figures.rows());
    }
    if wanted(Group::Wrench) {
        let folder = args.folder.clone();
        let models = options.models.clone();
        let peers = options.peers.clone();
        let figures = wrench::run(
            &wrench::Options { quick: args.quick, folder, models, peers, program: program.clone() },
            reported,
        )?;
        if let Some(docs) = &args.docs {
            plots::draw_wrenches(&docs.join(PICTURES), &figures)?;
            let path = docs.join(PAGES).join("wrench-results.md");
            std::fs::write(&path, wrench::page(&figures, machine))
                .map_err(|source| BenchError::Write { path, source })?;
        }
        rows.extend(figures.rows());
    }
    Ok((rows, table))
}
