//! `hapticd completions`: what a shell has to know to complete the command line.

use clap::CommandFactory as _;
use clap::builder::PossibleValuesParser;
use clap_complete::Shell;

use super::{Cli, output};
use crate::error::Exit;
use arms::profile;

/// Arguments of `hapticd completions`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Which shell.
    shell: Shell,
}

pub(crate) fn main(args: &Args) -> Exit {
    output::result(format_args!("{}", script(args.shell)));
    Exit::Ok
}

/// The script. Where a profile is asked for, the shell offers those in the program beside files.
fn script(shell: Shell) -> String {
    let profiles: Vec<&str> = profile::names().collect();
    let named = |command: clap::Command, arg: &str| {
        command.mut_arg(arg, |arg| {
            arg.value_parser(PossibleValuesParser::new(profiles.iter().copied()))
        })
    };
    let mut command = Cli::command();
    for renders in ["run", "sculpt"] {
        command = command.mut_subcommand(renders, |renders| named(renders, "device"));
    }
    for takes in ["mock", "device-node"] {
        command = command.mut_subcommand(takes, |takes| named(takes, "profile"));
    }
    command = command.mut_subcommand("devices", |devices| {
        devices
            .mut_subcommand("probe", |probe| named(probe, "profile"))
            .mut_subcommand("profiles", |print| named(print, "name"))
    });
    let mut script = Vec::new();
    clap_complete::generate(shell, &mut command, "hapticd", &mut script);
    let names = profiles.join(" ");
    let script = String::from_utf8_lossy(&script);
    // A profile may be a file as well, which the generated lines would not offer.
    match shell {
        Shell::Bash => script.replace(
            &format!("compgen -W \"{names}\" --"),
            &format!("compgen -f -W \"{names}\" --"),
        ),
        Shell::Zsh => {
            script.replace(&format!(":({names})'"), &format!(":{{compadd {names}; _files}}'"))
        }
        // `-f`: no files.
        Shell::Fish => script.replace(
            &format!(" -r -f -a \"{}\\t", profiles[0]),
            &format!(" -r -F -a \"{}\\t", profiles[0]),
        ),
        _ => script.into_owned(),
    }
}
