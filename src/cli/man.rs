//! `hapticd man`: manual pages, made from what `--help` says.

use std::fmt::Write as _;
use std::fs::OpenOptions;
use std::io::{self, Write as _};
use std::path::{Path, PathBuf};

use clap::CommandFactory as _;
use clap_mangen::Man;

use super::error::{CliError, Outcome};
use super::{Cli, output};
use crate::error::Exit;
use document::PACKAGED;

/// Arguments of `hapticd man`.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    /// Folder for one page per command, such as man/man1 [default: the main page to stdout].
    #[arg(value_name = "DIR")]
    folder: Option<PathBuf>,
}

pub(crate) fn main(args: &Args) -> Outcome {
    // `help` is no command of ours.
    let command = Cli::command().disable_help_subcommand(true);
    let Some(folder) = &args.folder else {
        let mut page = Vec::new();
        // True invariant: writing to memory does not fail.
        let _ = Man::new(command).render(&mut page);
        output::result(format_args!("{}{}", String::from_utf8_lossy(&page), main_sections()));
        return Ok(Exit::Ok);
    };
    write_pages(command, folder).map_err(|error| {
        CliError::write(format_args!("to {}", folder.display()), &error)
            .hint("name a folder that this user may write to")
    })?;
    Ok(Exit::Ok)
}

fn write_pages(command: clap::Command, folder: &Path) -> io::Result<()> {
    std::fs::create_dir_all(folder)?;
    let append = |page: &str, sections: String| {
        let mut file = OpenOptions::new().append(true).open(folder.join(page))?;
        file.write_all(sections.as_bytes())
    };
    clap_mangen::generate_to(command, folder)?;
    append("hapticd.1", main_sections())?;
    EXAMPLES.iter().try_for_each(|(command, lines)| {
        append(
            &format!("hapticd-{command}.1"),
            format!("{}.SH \"SEE ALSO\"\nhapticd(1)\n", examples(lines)),
        )
    })
}

/// Command lines, with the command whose page shows them. Scenes are those of the package.
const EXAMPLES: [(&str, &[(&str, &str)]); 12] = [
    (
        "run",
        &[
            (
                "hapticd run /usr/share/hapticd/scenes/peg-in-hole.toml",
                "Render on a simulated arm, with the page at http://127.0.0.1:7878/.",
            ),
            (
                "hapticd run my.toml --clock virtual --duration 10s --json",
                "Ten seconds in simulated time, and the result as JSON.",
            ),
            (
                "hapticd run my.toml --device polhem-2022 --enable --record session.mcap",
                "On a real arm, every tick recorded.",
            ),
        ],
    ),
    (
        "sculpt",
        &[(
            "hapticd sculpt /usr/share/hapticd/clay/bowl.toml --monitor 127.0.0.1:7878",
            "Clay, worked by a script and from the page.",
        )],
    ),
    (
        "bake",
        &[
            ("hapticd bake my.toml", "What the scene's parts come to, into the cache."),
            (
                "hapticd bake part.stl --units mm --voxel-size-mm 0.5 --picture part.png",
                "A mesh by itself, drawn.",
            ),
        ],
    ),
    (
        "check",
        &[("hapticd check my.toml my-arm.toml", "All problems of a scene and of a profile.")],
    ),
    (
        "eval",
        &[(
            "hapticd eval my.toml --poses poses.csv --out -",
            "The contact wrench of each pose, to stdout.",
        )],
    ),
    ("replay", &[("hapticd replay session.mcap", "The same ticks again, compared bit by bit.")]),
    ("report", &[("hapticd report session.mcap --out session.html", "One page of a recording.")]),
    (
        "init",
        &[("hapticd init parts --units mm", "A first scene of the meshes in the folder parts.")],
    ),
    ("mock", &[("hapticd mock open6-serial --pty /tmp/arm", "A simulated arm behind a tty.")]),
    (
        "device-node",
        &[(
            "hapticd device-node polhem-2022 --enable",
            "The arm of this machine, for a run on another one.",
        )],
    ),
    (
        "devices",
        &[
            ("hapticd devices", "What is attached."),
            ("hapticd devices profiles polhem-2022", "A profile to copy."),
            ("hapticd devices probe polhem-2022 --sign-check", "Does the arm push the right way?"),
        ],
    ),
    (
        "doctor",
        &[(
            "hapticd doctor my.toml",
            "Whether this machine and the arm of the scene are good enough.",
        )],
    ),
];

/// What the program reads from its environment.
const ENVIRONMENT: [(&str, &str); 6] = [
    (
        "HAPTICD_TOKEN",
        "Token that clients of the monitor have to know, where no --monitor-token names a file.",
    ),
    (
        "XDG_CACHE_HOME, XDG_STATE_HOME, HOME",
        "Where the cache of bakes and the recordings of faults and of clients are: see FILES.",
    ),
    ("NO_COLOR", "Not empty: no colour, unless --color always."),
    (
        "RAYON_NUM_THREADS",
        "Threads that bake, where no --threads says it [default: all processors].",
    ),
    ("ROS_DOMAIN_ID", "Domain of the topics of --publish, where no --ros-domain says it."),
    ("NOTIFY_SOCKET", "Set by systemd: states of the run are reported there."),
];

/// A section of command lines, each with what it does.
fn examples(lines: &[(&str, &str)]) -> String {
    let mut section = ".SH EXAMPLES\n".to_owned();
    for (line, what) in lines {
        // A plain `-` would be printed as a hyphen, which no shell takes.
        let _ = write!(section, ".TP\n\\fB{}\\fR\n{what}\n", line.replace('-', "\\-"));
    }
    section
}

/// Sections of the main page that no `--help` has.
fn main_sections() -> String {
    let mut page = ".SH \"EXIT STATUS\"\n".to_owned();
    for (exit, meaning) in Exit::TABLE {
        // True invariant: writing to memory does not fail.
        let _ = write!(page, ".TP\n{}\n{meaning}\n", exit as u8);
    }
    let scenes = format!("{PACKAGED}/scenes, {PACKAGED}/clay");
    let files = [
        (scenes.as_str(), "Scenes of the Debian package."),
        ("~/.cache/hapticd", "What was baked; $XDG_CACHE_HOME/hapticd where that is set."),
        (
            "~/.local/state/hapticd/faults",
            "Recordings of faults; $XDG_STATE_HOME/hapticd/faults where that is set.",
        ),
        ("/etc/hapticd", "Scenes of the systemd unit hapticd@."),
        ("/usr/share/doc/hapticd/README.md", "Where the documents begin."),
    ];
    for (title, rows) in [("ENVIRONMENT", &ENVIRONMENT[..]), ("FILES", &files[..])] {
        let _ = writeln!(page, ".SH {title}");
        for (name, what) in rows {
            let _ = write!(page, ".TP\n{name}\n{what}\n");
        }
    }
    let first: Vec<_> = EXAMPLES.iter().filter_map(|(_, lines)| lines.first().copied()).collect();
    page.push_str(&examples(&first));
    let pages: Vec<_> =
        EXAMPLES.iter().map(|(command, _)| format!("hapticd\\-{command}(1)")).collect();
    let _ = writeln!(page, ".SH \"SEE ALSO\"\n{}", pages.join(", "));
    page
}

#[cfg(test)]
mod tests {
    use clap::Parser as _;

    use super::*;

    #[test]
    fn examples_are_command_lines_that_the_program_takes() {
        let commands = Cli::command();
        let shown: Vec<_> = commands
            .get_subcommands()
            .filter(|command| !command.is_hide_set())
            .map(clap::Command::get_name)
            .collect();
        for (command, lines) in EXAMPLES {
            assert!(shown.contains(&command) && !lines.is_empty(), "{command}");
            for (line, what) in lines {
                let parsed = Cli::try_parse_from(line.split_whitespace());
                assert!(
                    parsed.is_ok() && line.starts_with(&format!("hapticd {command}")),
                    "{line}: {}",
                    parsed.unwrap_err()
                );
                assert!(what.ends_with(['.', '?']), "{what}");
            }
        }
        let named: Vec<_> = EXAMPLES.iter().map(|(command, _)| *command).collect();
        assert!(shown.iter().all(|command| named.contains(command)), "{shown:?}");
    }
}
