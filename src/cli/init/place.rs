//! Where a first scene goes: a file, or stdout.

use std::path::{Path, PathBuf};

use super::super::error::CliError;
use super::super::{OutputOptions, destination, output, report};
use super::Args;
use crate::config;
use vps::storage::whole_file::write_bytes;

/// Where the scene goes.
pub(super) enum SceneDestination {
    File(PathBuf),
    /// The reader keeps it in the working directory.
    Stdout,
}

impl SceneDestination {
    /// What the command line says, or the default.
    pub(super) fn of(args: &Args, default: impl FnOnce() -> PathBuf) -> Result<Self, CliError> {
        let file = match &args.out {
            Some(out) if out.as_os_str() == "-" => return Ok(Self::Stdout),
            Some(out) => out.clone(),
            None => default(),
        };
        if file.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("toml")) {
            return Ok(Self::File(file));
        }
        Err(CliError::usage(format_args!("{}: a scene is a .toml file", file.display())))
    }

    /// Refuses a file that is there and is to be kept.
    pub(super) fn check_free(&self, args: &Args) -> Result<(), CliError> {
        let Self::File(file) = self else { return Ok(()) };
        let files = [Some(file.clone()), self.hand().filter(|_| !args.clay)];
        match files.into_iter().flatten().find(|file| file.exists() && !args.overwrite) {
            Some(file) => Err(destination::is_there(&file)
                .hint("--overwrite writes over it, -o names another file")),
            None => Ok(()),
        }
    }

    /// The folder that paths of the scene are relative to.
    pub(super) fn folder(&self) -> &Path {
        match self {
            Self::File(file) => file
                .parent()
                .filter(|folder| !folder.as_os_str().is_empty())
                .unwrap_or(Path::new(".")),
            Self::Stdout => Path::new("."),
        }
    }

    /// The file of the scene's hand, beside it; none where the scene is read from stdout.
    pub(super) fn hand(&self) -> Option<PathBuf> {
        let Self::File(file) = self else { return None };
        Some(file.with_file_name(format!("{}-hand.csv", file.file_stem()?.to_str()?)))
    }

    /// What commands call it, as a shell takes it.
    pub(super) fn named(&self) -> String {
        match self {
            Self::File(file) => output::quoted(file),
            Self::Stdout => "scene.toml".to_owned(),
        }
    }

    /// Writes the scene, reads it back, and says what it is. On stdout stands nothing but the
    /// scene. `next`: the command for it, and what that does.
    pub(super) fn write(
        &self,
        text: &str,
        summary: &str,
        next: (&str, &str),
        output: OutputOptions,
    ) -> Result<(), CliError> {
        let Self::File(file) = self else {
            output::result(format_args!("{text}"));
            report::line(summary.trim_end(), output);
            return Ok(());
        };
        write_bytes(file, text.as_bytes())
            .map_err(|error| CliError::write(file.display(), &error))?;
        config::load(file)?;
        let (command, does) = next;
        output::result(format_args!(
            "{summary}wrote   {}: `hapticd {command} {}` {does} it\n",
            file.display(),
            self.named()
        ));
        Ok(())
    }
}
