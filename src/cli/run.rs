//! `hapticd run`: bake a scene and render it on its arm.

use super::error::Outcome;
use super::render::{self, CommandOptions, LoopArgs};
use super::{OutputOptions, drawing, live};

/// Arguments of `hapticd run`.
#[derive(Debug, clap::Args)]
#[command(group(clap::ArgGroup::new("written").args(["record", "pictures", "video"]).multiple(true)))]
pub(crate) struct Args {
    #[command(flatten)]
    render: LoopArgs,
    #[command(flatten)]
    live: live::LiveArgs,
    #[command(flatten)]
    drawing: drawing::DrawingArgs,
    /// Let --record, --pictures and --video write over files that are there already.
    #[arg(long, requires = "written")]
    overwrite: bool,
}

pub(crate) fn main(args: &Args, output: OutputOptions, started_ns: i64) -> Outcome {
    let own = CommandOptions {
        live: &args.live,
        drawing: Some(&args.drawing),
        clay: None,
        overwrite: args.overwrite,
    };
    render::main(&args.render, &own, output, started_ns)
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Debug, Parser)]
    struct Command {
        #[command(flatten)]
        args: Args,
    }

    #[test]
    fn flags_of_later_versions_and_bare_numbers_are_usage_errors() {
        let args = |line: &str| {
            Command::try_parse_from(["run"].into_iter().chain(line.split_whitespace()))
        };
        for line in [
            "s.toml --overwrite",
            "s.toml --picture-every 1s",
            "s.toml --pictures p --picture-every 0s",
            "s.toml --monitor 7878",
            "s.toml --duration 10",
            "",
            "s.toml --clock fast",
        ] {
            let error = args(line).expect_err(line);
            assert_eq!(error.exit_code(), 2, "{line}");
        }
        assert!(args("s.toml --video v.apng --pictures p --record r.mcap --overwrite").is_ok());
        assert!(args("s.toml --duration 10").expect_err("no unit").to_string().contains("500ms"));
    }
}
