//! The command line: one file for each command, and what several of them share. The only module
//! that prints.

mod bake;
mod cache;
mod check;
mod completions;
mod console;
mod destination;
mod device_node;
mod devices;
mod doctor;
mod drawing;
mod error;
mod eval;
mod findings;
mod foxglove;
mod guard;
mod hand;
mod init;
mod lab_report;
mod live;
mod man;
mod memory;
mod mock;
mod monitor;
mod network;
mod outcome;
mod output;
mod probe;
mod progress;
mod publish;
mod recording;
mod reload;
mod render;
mod replay;
mod report;
mod run;
mod sculpt;
mod sculpt_run;
mod services;
mod status_line;
mod units;
mod vendor_arm;

use std::process::ExitCode;

use clap::builder::StyledStr;
use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{CommandFactory as _, Parser, Subcommand, ValueEnum};

use self::error::CliError;
use rt::clock::monotonic_ns;

/// Open, device-agnostic, 6-DoF haptic rendering server.
#[derive(Debug, Parser)]
#[command(version, about, max_term_width = 100)]
struct Cli {
    #[command(subcommand)]
    command: Command,
    #[command(flatten)]
    output: OutputOptions,
}

/// How much to output, and how.
#[derive(Clone, Copy, Debug, clap::Args)]
#[command(next_help_heading = "Output")]
pub(crate) struct OutputOptions {
    /// Say more: what the scene resolves to, and what was baked.
    #[arg(short, long, global = true, action = clap::ArgAction::Count)]
    pub(crate) verbose: u8,
    /// Say errors and faults only.
    #[arg(short, long, global = true, conflicts_with = "verbose")]
    pub(crate) quiet: bool,
    /// Colour on stderr and stdout.
    #[arg(long, global = true, value_name = "WHEN", default_value = "auto")]
    pub(crate) color: When,
    /// What messages on stderr look like: lines for people, or one JSON object per line.
    #[arg(long, global = true, value_name = "FORMAT", default_value = "text")]
    pub(crate) log_format: output::LogFormat,
}

/// When to use colour.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum When {
    /// On a terminal, unless NO_COLOR is set.
    Auto,
    /// Always.
    Always,
    /// Never.
    Never,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Bake a scene and render it on its arm until Ctrl-C.
    Run(run::Args),
    /// Sculpt clay with the arm, by script or from the monitor page.
    Sculpt(sculpt::Args),
    /// Generate voxmaps and pointshells only, with figures.
    Bake(bake::Args),
    /// Check scenes and device profiles without baking: reports all problems of a pass together.
    Check(check::Args),
    /// Contact wrench at each given tool pose: no device, no time.
    Eval(eval::Args),
    /// Run a recording again, through the scene that it brings along, and compare every bit of what
    /// comes out.
    Replay(replay::Args),
    /// Make one page of a recording: force, depth, latency, faults.
    Report(lab_report::Args),
    /// Write a first scene for a folder of meshes.
    Init(init::Args),
    /// Simulate an arm behind a real link, in its own protocol, with faults on demand.
    Mock(mock::Args),
    /// Drive an arm for a host on another machine, over zenoh.
    DeviceNode(device_node::Args),
    /// List attached arms, with what stands in their way.
    Devices(devices::Args),
    /// Examine this machine and its arms: rights, scheduling, 10 s of wake-ups, udev rules. Says
    /// what to type.
    Doctor(doctor::Args),
    /// Print what a shell needs to complete the command line.
    #[command(hide = true)]
    Completions(completions::Args),
    /// Write manual pages.
    #[command(hide = true)]
    Man(man::Args),
}

/// Parses the command line, runs the command and gives the process's exit code.
pub fn main() -> ExitCode {
    // Before anything else is started: it is to stay small.
    if let Some(exit) = guard::main().or_else(vendor_arm::main) {
        return exit;
    }
    let started_ns = monotonic_ns();
    let Cli { command, output } = Cli::try_parse().unwrap_or_else(|error| refused(error).exit());
    output::use_format(output.log_format);
    let dispatched = std::panic::catch_unwind(|| match command {
        Command::Run(args) => run::main(&args, output, started_ns),
        Command::Sculpt(args) => sculpt::main(&args, output, started_ns),
        Command::Bake(args) => bake::main(&args, output),
        Command::Check(args) => Ok(check::main(&args, output)),
        Command::Eval(args) => eval::main(&args, output),
        Command::Replay(args) => replay::main(&args, output),
        Command::Report(args) => lab_report::main(&args, output),
        Command::Mock(args) => mock::main(&args, output),
        Command::DeviceNode(args) => device_node::main(&args, output),
        Command::Devices(args) => devices::main(&args, output),
        Command::Doctor(args) => doctor::main(&args, output),
        Command::Init(args) => init::main(&args, output),
        Command::Completions(args) => Ok(completions::main(&args)),
        Command::Man(args) => man::main(&args),
    });
    let bug = |_| {
        Err(CliError::internal(
            "this is a bug of hapticd: please report it with the lines above and the command line",
        ))
    };
    let exit = dispatched.unwrap_or_else(bug).unwrap_or_else(|error| error.report(output));
    report::finish(exit, output).into()
}

/// Words of other programs for what a command does here: commands that look like them are found by
/// clap itself.
const SYNONYMS: [(&[&str], &str); 12] = [
    (
        &["start", "play", "render", "simulate", "serve", "launch", "exec", "demo", "go"],
        "run SCENE",
    ),
    (&["record", "capture", "log"], "run SCENE --record FILE.mcap"),
    (&["view", "gui", "ui", "web", "show", "monitor"], "run SCENE --monitor"),
    (&["validate", "verify", "lint", "test", "info"], "check SCENE"),
    (&["new", "create", "setup", "scaffold"], "init FOLDER"),
    (&["build", "compile", "generate", "voxelize", "voxelise", "preprocess"], "bake SCENE"),
    (&["clay", "carve"], "sculpt SCENE"),
    (&["list", "ls", "scan", "arms", "device"], "devices"),
    (&["probe", "identify", "calibrate"], "devices probe PROFILE"),
    (&["profiles", "profile"], "devices profiles"),
    (&["diagnose", "health", "status"], "doctor"),
    (&["plot", "analyse", "analyze", "summary", "page"], "report FILE.mcap"),
];

/// What is said of a command line that is not one. `bench` was a command of version 0.1.0.
fn refused(mut error: clap::Error) -> clap::Error {
    let Some(ContextValue::String(word)) = error.get(ContextKind::InvalidSubcommand) else {
        return error;
    };
    if word != "bench" {
        let command = SYNONYMS
            .iter()
            .find(|(words, _)| words.contains(&word.as_str()))
            .map(|(_, command)| command);
        if let Some(command) = command {
            error.remove(ContextKind::SuggestedSubcommand);
            let tip = StyledStr::from(format!("the command for that is `hapticd {command}`"));
            error.insert(ContextKind::Suggested, ContextValue::StyledStrs(vec![tip]));
        }
        return error;
    }
    let rest = std::env::args_os().skip_while(|word| word != "bench").skip(1);
    let words: Vec<String> = rest.map(|word| word.to_string_lossy().into_owned()).collect();
    let message = format!(
        "`bench` is a program of its own now; in a checkout of the sources: cargo run --release -p \
            bench -- {}",
        words.join(" ")
    );
    Cli::command().error(ErrorKind::InvalidSubcommand, message)
}
