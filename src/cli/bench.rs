//! `hapticd bench`: figures beside the paper's and beside other programs'.

use std::path::{Path, PathBuf};

use clap::ValueEnum;

use super::bake::print_json;
use super::{Talk, plots, report, say};
use crate::bench::{BenchError, Machine, Report, Row, commit_of, contact, generation, loops, sculpt};
use crate::document::PACKAGED;
use crate::error::Exit;

/// Arguments of `hapticd bench`.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "HAPTICD_MODELS names a folder with real meshes: stanford-bunny.obj, factory_bolt_m16_tight.obj and others. \
                        HAPTICD_PEERS names a folder with openvdb_level_set and voxel_grids.py (generation), coal_contacts.py, \
                        parry_contacts and embree_distance.py (contact), and venv/bin/python for the scripts. `loop` runs \
                        cyclictest where it is installed. What is missing is skipped and said."
)]
pub(crate) struct Args {
    /// What to measure, one or more; generation, contact, loop and sculpt if not given.
    #[arg(value_name = "GROUP")]
    group: Vec<Group>,
    /// Runs of each case; figures are medians [default: 3, with --quick 1].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100))]
    runs: Option<u32>,
    /// Threads of a bake and processors of a peer; all processors if not given.
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
    /// With --quality or sculpt: draw how smooth forces are there, as PNG files.
    #[arg(long, value_name = "DIR")]
    plots: Option<PathBuf>,
    /// Folder of the scenes that contact and loop play [default: config/scenes, or where the package has them].
    #[arg(long, value_name = "DIR")]
    scenes: Option<PathBuf>,
    /// Print exactly one JSON object.
    #[arg(long)]
    json: bool,
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
    /// A million points in a violent hand: ten minutes of simulated time, two of real time. Only when asked for.
    Torture,
    /// Sculpting.
    Sculpt,
}

/// Where the shipped scenes are in a checkout.
const SHIPPED: &str = "config/scenes";

impl Args {
    /// The folder of scenes: of a checkout, or of the package; where there is none, that of a checkout is told.
    fn scenes(&self) -> PathBuf {
        let shipped = || {
            let packaged = Path::new(PACKAGED).join("scenes");
            if !Path::new(SHIPPED).is_dir() && packaged.is_dir() { packaged } else { SHIPPED.into() }
        };
        self.scenes.clone().unwrap_or_else(shipped)
    }

    fn wants(&self, group: Group) -> bool {
        if self.group.is_empty() { group != Group::Torture } else { self.group.contains(&group) }
    }
}

pub(crate) fn main(args: &Args, talk: Talk) -> Exit {
    if args.plots.is_some() && !args.quality && !args.wants(Group::Sculpt) {
        report::error("--plots draws what --quality or sculpt measures", Some("hapticd bench sculpt --plots DIR"), talk);
        return Exit::Usage;
    }
    if args.quality && args.group != [Group::Contact] {
        report::error("--quality goes with contact", Some("hapticd bench contact --quality"), talk);
        return Exit::Usage;
    }
    let Ok(program) = std::env::current_exe() else {
        report::error("the path of this program is not known, so it cannot start itself", None, talk);
        return Exit::Internal;
    };
    let n_threads = args.threads.map_or_else(|| std::thread::available_parallelism().map_or(1, usize::from), |n| n as usize);
    // The pool of the process: nothing has used it before.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build_global();
    debug_assert!(pool.is_ok(), "the global pool is built once");
    let commit = commit_of(&program);
    match measure(args, program, n_threads, talk) {
        Ok((rows, table)) => {
            let report = Report { machine: Machine::read(), commit, rows };
            if args.json {
                print_json(&report);
            } else {
                say::result(format_args!("{}{table}", report.markdown()));
            }
            Exit::Ok
        }
        Err(error) => {
            report::error(&error.to_string(), None, talk);
            Exit::Asset
        }
    }
}

/// The rows of the group, or of all of them, and what goes under their tables.
fn measure(args: &Args, program: PathBuf, n_threads: usize, talk: Talk) -> Result<(Vec<Row>, String), BenchError> {
    let told = |what: &str| {
        if !talk.quiet {
            say::talk(format_args!("{what}\n"));
        }
    };
    let folder = |name: &str| std::env::var_os(name).map(PathBuf::from);
    let (models, peers) = (folder("HAPTICD_MODELS"), folder("HAPTICD_PEERS"));
    let n_runs = args.runs.unwrap_or(if args.quick { 1 } else { 3 }) as usize;
    let wanted = |group: Group| args.wants(group);
    // A folder that cannot be made is better known before minutes of measuring.
    if let Some(folder) = &args.plots {
        plots::make_folder(folder)?;
    }
    let (mut rows, mut table) = (Vec::new(), String::new());
    if wanted(Group::Generation) {
        let (program, models, peers) = (program.clone(), models.clone(), peers.clone());
        rows.extend(generation::run(&generation::Options { n_runs, n_threads, quick: args.quick, models, peers, program }, told)?);
    }
    let options = contact::Options { n_runs, quick: args.quick, scenes: args.scenes(), csv: args.csv.clone(), models, peers };
    if wanted(Group::Contact) {
        if args.quality {
            let quality = contact::quality(&options, told)?;
            if let Some(folder) = &args.plots {
                plots::draw(folder, &quality)?;
            }
            rows.extend(quality.rows);
            table = quality.choice;
        } else {
            rows.extend(contact::speed(&options, told)?);
        }
    }
    if wanted(Group::Torture) {
        rows.extend(contact::torture(&options, told)?);
    }
    if wanted(Group::Loop) {
        rows.extend(loops::run(&loops::Options { program, quick: args.quick, scenes: args.scenes() }, told)?);
    }
    if wanted(Group::Sculpt) {
        let figures = sculpt::run(&sculpt::Options { n_runs, quick: args.quick }, told)?;
        if let Some(folder) = &args.plots {
            plots::draw_receding(folder, &figures.receding)?;
        }
        rows.extend(figures.rows);
    }
    Ok((rows, table))
}
