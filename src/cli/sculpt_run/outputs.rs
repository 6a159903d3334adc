//! What is to be written of a clay model, and whether it can be: looked at before the work.

use std::collections::HashSet;
use std::path::{Path, PathBuf};

use super::super::error::CliError;
use super::super::{OutputOptions, destination};
use crate::config::SceneConfig;
use crate::config::strokes::Script;
use clay::engine::SculptOrder;
use clay::{ClayModel, PointSet};
use picture::splats::{self, ClaySnapshot, MassPoints, SampleForm};
use vps::mesh;
use vps::storage::whole_file;

/// Drawings of the clay at the start and at the end.
pub(super) struct Pictures {
    /// Above the clay.
    pub(super) title: String,
    /// What the files' names begin with.
    pub(super) name: String,
    pub(super) folder: PathBuf,
    pub(super) form: SampleForm,
    pub(super) before: PointSet,
    pub(super) mass_before: MassPoints,
}

impl Pictures {
    fn file(&self, when: &str) -> PathBuf {
        self.folder.join(format!("{}-{when}.png", self.name))
    }

    fn files(&self) -> [PathBuf; 2] {
        ["before", "after"].map(|when| self.file(when))
    }

    /// Draws both at one scale.
    pub(super) fn draw(&self, after: &ClayModel) -> [(PathBuf, std::io::Result<()>); 2] {
        let mass_after = MassPoints::beside_surface(after.region());
        let after = after.points();
        let drawn = [
            ("before", &self.before, after, &self.mass_before),
            ("after", after, &self.before, &mass_after),
        ];
        drawn.map(|(when, points, beside, mass_points)| {
            let name = format!("{}, {when}", self.title);
            let file = self.file(when);
            let written = splats::write(
                &file,
                &[ClaySnapshot {
                    name: &name,
                    points,
                    beside: Some(beside),
                    form: self.form,
                    mass_points,
                }],
            );
            (file, written)
        })
    }
}

/// Every file that is to be written.
pub(super) struct OutputFiles<'w> {
    /// At the end.
    pub(super) own: &'w [SculptOrder],
    pub(super) script: Option<&'w Script>,
    pub(super) pictures: Option<&'w Pictures>,
    pub(super) recording: Option<&'w Path>,
}

impl OutputFiles<'_> {
    /// Refuses what cannot be written, may not be written over, or is read.
    pub(super) fn check(
        &self,
        config: &SceneConfig,
        overwrite: bool,
        output: OutputOptions,
    ) -> Result<(), CliError> {
        let Self { own, script, pictures, recording } = self;
        let own = own.iter().map(destination_of);
        if let Some((_, file)) =
            own.clone().find(|(kind, file)| *kind != "session" && !is_ply(file))
        {
            let file = file.display();
            return Err(CliError::usage(format_args!("{file}: samples and meshes are .ply files")));
        }
        let mut files: Vec<PathBuf> = own.map(|(_, file)| file).collect();
        files.extend(script.iter().flat_map(|script| script.writes()).map(Path::to_owned));
        if let Some(pictures) = pictures {
            destination::make_picture_folder(&pictures.folder, output)?;
            files.extend(pictures.files());
        }
        let read: HashSet<PathBuf> =
            self.reads(config).iter().filter_map(|file| file.canonicalize().ok()).collect();
        let mut places: HashSet<PathBuf> = HashSet::new();
        // A recording knows by itself whether it can be written.
        for (file, is_clay) in
            files.iter().map(|file| (&**file, true)).chain(recording.map(|file| (file, false)))
        {
            let shown = file.display();
            if !places.insert(place_of(file)) {
                return Err(CliError::usage(format_args!("{shown} would be written twice"))
                    .hint("give each its own name"));
            }
            if file.canonicalize().is_ok_and(|file| read.contains(&file)) {
                return Err(CliError::usage(format_args!(
                    "{shown} is what the scene is read from: name another file to write"
                )));
            }
            if is_clay && file.exists() && !file.is_dir() && !overwrite {
                return Err(destination::is_there(file));
            }
            if is_clay {
                whole_file::check(file).map_err(|error| CliError::write(&shown, &error))?;
            }
        }
        Ok(())
    }

    /// The scene, its strokes, and all that they name.
    fn reads(&self, config: &SceneConfig) -> Vec<PathBuf> {
        let mut files = vec![config.path.clone()];
        files.extend_from_slice(&config.files);
        if let Some(script) = self.script {
            files.push(script.file.clone());
            files.extend_from_slice(&script.reads);
        }
        // Files that meshes take their contents from; one that cannot be read names none.
        let companions: Vec<PathBuf> =
            files.iter().flat_map(|file| mesh::companions(file).unwrap_or_default()).collect();
        files.extend(companions);
        files
    }
}

/// The same for every way to write the name of a file, there or not.
fn place_of(file: &Path) -> PathBuf {
    let folder =
        file.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    match (folder.canonicalize(), file.file_name()) {
        (Ok(folder), Some(name)) => folder.join(name),
        _ => file.to_owned(),
    }
}

fn is_ply(file: &Path) -> bool {
    file.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("ply"))
}

/// What an order writes, and where.
pub(super) fn destination_of(order: &SculptOrder) -> (&'static str, PathBuf) {
    // True invariant: made by `ClayArgs::outputs`.
    let Some((kind, file)) = order.writes() else { unreachable!("an order that writes nothing") };
    (kind, file.to_owned())
}

/// Where an order writes a session, whatever the working directory is; `None`: it writes none.
pub(super) fn session_of(order: &SculptOrder) -> Option<PathBuf> {
    match order {
        SculptOrder::SaveSession(file) => {
            Some(std::path::absolute(file).unwrap_or_else(|_| file.clone()))
        }
        _ => None,
    }
}
