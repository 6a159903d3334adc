//! Where a first scene goes: a file, or stdout.

use std::path::{Path, PathBuf};

use super::super::{OutputOptions, output, report};
use super::{Args, ReportedExit};
use crate::config;
use crate::error::Exit;
use vps::storage::whole_file::write_bytes;

/// Where the scene goes.
pub(super) enum SceneDestination {
    File(PathBuf),
    /// The reader keeps it in the working directory.
    Stdout,
}

impl SceneDestination {
    /// What the command line says, or the default.
    pub(super) fn of(
        args: &Args,
        default: impl FnOnce() -> PathBuf,
        output: OutputOptions,
    ) -> Result<Self, ReportedExit> {
        let file = match &args.out {
            Some(out) if out.as_os_str() == "-" => return Ok(Self::Stdout),
            Some(out) => out.clone(),
            None => default(),
        };
        if file.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("toml")) {
            return Ok(Self::File(file));
        }
        report::error(&format!("{}: a scene is a .toml file", file.display()), None, output);
        Err(ReportedExit(Exit::Usage))
    }

    /// Refuses a file that is there and is to be kept.
    pub(super) fn check_free(
        &self,
        args: &Args,
        output: OutputOptions,
    ) -> Result<(), ReportedExit> {
        match self {
            Self::File(file)
                if !args.overwrite
                    && (file.exists()
                        || self.hand().is_some_and(|hand| hand.exists() && !args.clay)) =>
            {
                let there =
                    if file.exists() { file.clone() } else { self.hand().unwrap_or_default() };
                let message = format!("{} is there already", there.display());
                report::error(
                    &message,
                    Some("--overwrite writes over it, -o names another file"),
                    output,
                );
                Err(ReportedExit(Exit::Usage))
            }
            _ => Ok(()),
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
    ) -> Result<(), ReportedExit> {
        let Self::File(file) = self else {
            output::result(format_args!("{text}"));
            report::line(summary.trim_end(), output);
            return Ok(());
        };
        write_bytes(file, text.as_bytes()).map_err(|error| {
            report::error(&format!("cannot write {}: {error}", file.display()), None, output);
            ReportedExit(Exit::Asset)
        })?;
        config::load(file)
            .map_err(|errors| ReportedExit(report::config_errors(&errors, output)))?;
        let (command, does) = next;
        output::result(format_args!(
            "{summary}wrote   {}: `hapticd {command} {}` {does} it\n",
            file.display(),
            self.named()
        ));
        Ok(())
    }
}
