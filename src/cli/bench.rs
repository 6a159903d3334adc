//! `hapticd bench`: figures beside the paper's and beside other programs'.

use std::path::PathBuf;

use clap::ValueEnum;

use super::bake::print_json;
use super::{Talk, report, say};
use crate::bench::generation::{self, Options};
use crate::bench::{Machine, Report, commit_of};
use crate::error::Exit;

/// Arguments of `hapticd bench`.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "HAPTICD_MODELS names a folder with stanford-bunny.obj. HAPTICD_PEERS names a folder with openvdb_level_set, \
                        voxel_grids.py and venv/bin/python. What is missing is skipped and said."
)]
pub(crate) struct Args {
    /// What to measure; everything there is if not given.
    #[arg(value_name = "GROUP")]
    group: Option<Group>,
    /// Runs of each case; figures are medians [default: 3, with --quick 1].
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=100))]
    runs: Option<u32>,
    /// Threads of a bake and processors of a peer; all processors if not given.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024))]
    threads: Option<u32>,
    /// Small cases only: does it work, not how fast is it.
    #[arg(long)]
    quick: bool,
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
    /// Sculpting.
    Sculpt,
}

pub(crate) fn main(args: &Args, talk: Talk) -> Exit {
    if let Some(group) = args.group.filter(|group| *group != Group::Generation) {
        let name = group.to_possible_value().map(|value| value.get_name().to_owned()).unwrap_or_default();
        report::error(&format!("bench {name}: not available in this version"), Some("available: generation"), talk);
        return Exit::Configuration;
    }
    let Ok(program) = std::env::current_exe() else {
        report::error("the path of this program is not known, so it cannot start itself", None, talk);
        return Exit::Internal;
    };
    let n_threads = args.threads.map_or_else(|| std::thread::available_parallelism().map_or(1, usize::from), |n| n as usize);
    // The pool of the process: nothing has used it before.
    let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build_global();
    debug_assert!(pool.is_ok(), "the global pool is built once");
    let folder = |name: &str| std::env::var_os(name).map(PathBuf::from);
    let options = Options {
        n_runs: args.runs.unwrap_or(if args.quick { 1 } else { 3 }) as usize,
        n_threads,
        quick: args.quick,
        models: folder("HAPTICD_MODELS"),
        peers: folder("HAPTICD_PEERS"),
        program,
    };
    let told = |what: &str| {
        if !talk.quiet {
            say::talk(format_args!("{what}\n"));
        }
    };
    match generation::run(&options, told) {
        Ok(rows) => {
            let report = Report { machine: Machine::read(), commit: commit_of(&options.program), rows };
            if args.json {
                print_json(&report);
            } else {
                say::result(format_args!("{}", report.markdown()));
            }
            Exit::Ok
        }
        Err(error) => {
            report::error(&error.to_string(), None, talk);
            Exit::Asset
        }
    }
}
