//! `hapticd sculpt`: clay, worked with the arm, by script and from the monitor page.

use super::error::{CliError, Outcome};
use super::render::{self, CommandOptions, LoopArgs};
use super::sculpt_run::ClayArgs;
use super::{OutputOptions, live};

/// Arguments of `hapticd sculpt`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    #[command(flatten)]
    render: LoopArgs,
    #[command(flatten)]
    clay: ClayArgs,
    /// Let --record, --save, --session, --export, --pictures and strokes write over files that are
    /// there already.
    #[arg(long)]
    overwrite: bool,
    #[command(flatten)]
    rigid: RigidArgs,
}

/// What `run` takes and clay does not, so that it is refused in words.
#[derive(Debug, clap::Args)]
struct RigidArgs {
    #[arg(long, hide = true, num_args = 0..)]
    swap: Option<Vec<String>>,
    #[arg(long = "move", hide = true, num_args = 0..)]
    moves: Option<Vec<String>>,
    #[arg(long, hide = true)]
    watch: bool,
    #[arg(long, hide = true, num_args = 0..)]
    video: Option<Vec<String>>,
}

impl RigidArgs {
    /// The first that was given, and why it is not taken.
    fn given(&self) -> Option<(&'static str, &'static str)> {
        if self.swap.is_some() {
            Some((
                "--swap",
                "the clay is worked until the run ends; save a session and begin the other scene",
            ))
        } else if self.moves.is_some() {
            Some(("--move", "parts beside the clay can be moved from the monitor page"))
        } else if self.watch {
            Some(("--watch", "SIGHUP reads the parameters of the scene again"))
        } else if self.video.is_some() {
            Some(("--video", "--pictures draws the clay as it was and as it is at the end"))
        } else {
            None
        }
    }
}

pub(crate) fn main(args: &Args, output: OutputOptions, started_ns: i64) -> Outcome {
    if let Some((flag, hint)) = args.rigid.given() {
        let message = format!("{flag} is for rigid scenes, which `hapticd run` renders");
        return Err(CliError::usage(message).hint(hint));
    }
    let own = CommandOptions {
        live: &live::LiveArgs::default(),
        drawing: None,
        clay: Some(&args.clay),
        overwrite: args.overwrite,
    };
    render::main(&args.render, &own, output, started_ns)
}
