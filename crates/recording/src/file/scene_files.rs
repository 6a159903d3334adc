//! What a scene was made of: everything that a recording has to bring along to be run again alone.

use std::fs::{self, File, Metadata};
use std::io::{self, Read as _};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::SystemTime;

use twox_hash::XxHash3_128;

use vps::spatial::Pose;
use vps::storage::regular;

/// Files of one scene that are brought along, bytes; what does not fit is named with its hash.
pub(super) const ROOM_BYTES: u64 = 256 << 20;

/// A scene as it was checked, and the files that it names.
#[derive(Clone, Debug, Default)]
pub struct SceneFiles {
    /// Name for people.
    pub name: String,
    /// The scene file.
    pub path: PathBuf,
    /// The scene file as written.
    pub toml: String,
    /// What it comes to: one JSON object, SI.
    pub resolved_json: String,
    /// The arm's profile as written.
    pub profile_toml: String,
    /// The real-time mode was `enforce`, from the scene or the command line: it decides what an
    /// over-run is.
    pub enforce: bool,
    /// The tool began at its start again, where it stays in place otherwise as one scene takes the
    /// place of another.
    pub starts_anew: bool,
    /// Meshes and hand.
    pub named: Vec<NamedFile>,
    /// What there is to see.
    pub shown: Vec<DisplayObject>,
}

/// A file that a scene names.
#[derive(Clone, Debug)]
pub struct NamedFile {
    /// As written in the scene.
    pub written: String,
    /// Where it is.
    pub path: PathBuf,
    /// Files beside it that it takes its contents from, relative to its folder.
    pub companions: Vec<PathBuf>,
    /// Length and time of each when the scene was read; the file itself first.
    stamps: Vec<Option<(u64, SystemTime)>>,
}

impl NamedFile {
    /// A file as it is now.
    pub fn new(written: String, path: PathBuf, companions: Vec<PathBuf>) -> Self {
        let mut named = Self { written, path, companions, stamps: Vec::new() };
        named.stamps = named
            .parts()
            .map(|(path, _)| fs::metadata(path).ok().as_ref().and_then(stamp))
            .collect();
        named
    }

    /// The file and its companions: where they are, and their path beside each other.
    fn parts(&self) -> impl Iterator<Item = (PathBuf, PathBuf)> {
        let folder = self.path.parent().unwrap_or(Path::new("")).to_owned();
        let own = (self.path.clone(), PathBuf::from(self.path.file_name().unwrap_or_default()));
        std::iter::once(own)
            .chain(self.companions.iter().map(move |beside| (folder.join(beside), beside.clone())))
    }

    /// The same, each opened and as it was when the scene was read; or what became of it.
    pub(super) fn opened(
        &self,
    ) -> impl Iterator<Item = (PathBuf, Result<(File, u64), MissingFile>)> {
        self.parts().zip(&self.stamps).map(|((path, beside), stamp)| (beside, open(&path, *stamp)))
    }
}

pub(super) fn stamp(metadata: &Metadata) -> Option<(u64, SystemTime)> {
    Some((metadata.len(), metadata.modified().ok()?))
}

fn open(path: &Path, before: Option<(u64, SystemTime)>) -> Result<(File, u64), MissingFile> {
    let file = regular::open(path).map_err(MissingFile::Unreadable)?;
    let metadata = file.metadata().map_err(MissingFile::Unreadable)?;
    if before.is_none() || stamp(&metadata) != before {
        return Err(MissingFile::Changed);
    }
    Ok((file, metadata.len()))
}

/// Why a file is not in the recording.
#[derive(Debug, thiserror::Error)]
pub(super) enum MissingFile {
    #[error("changed after it was baked")]
    Changed,
    #[error("changed while it was recorded")]
    ChangedMeanwhile,
    #[error("{0}")]
    Unreadable(io::Error),
}

/// The hash of a file, as the bake cache has it.
pub(super) fn hash(file: &mut File) -> io::Result<u128> {
    let mut hasher = XxHash3_128::new();
    let mut buffer = vec![0; 1 << 18];
    loop {
        match file.read(&mut buffer)? {
            0 => return Ok(hasher.finish_128()),
            n => hasher.write(buffer.get(..n).unwrap_or_default()),
        }
    }
}

/// An object for the eye.
#[derive(Clone, Debug)]
pub struct DisplayObject {
    /// Name of the object in the scene.
    pub name: String,
    /// `world_from_object`; of the tool, where it stands at the start.
    pub pose: Pose,
    /// It moves with `/tool/pose`.
    pub is_tool: bool,
    /// Its form.
    pub form: DisplayShape,
}

/// What an object looks like, m.
#[derive(Clone, Debug)]
pub enum DisplayShape {
    /// Full edges along x, y and z, and its middle.
    Box([f64; 3], [f64; 3]),
    /// Half of its extents along x, y and z: of a sphere its radius.
    Ellipsoid([f64; 3]),
    /// Radius, share of it that is left at the top, and height.
    Cylinder(f64, f64, f64),
    /// A mesh file; metres per unit of it.
    Mesh(PathBuf, f64),
    /// Something else.
    Other,
}

/// The scenes of a run in the order of their numbers. Clones share them.
#[derive(Clone, Debug, Default)]
pub struct Scenes(Arc<Mutex<Vec<Arc<SceneFiles>>>>);

impl Scenes {
    /// The loop renders this one next.
    pub fn add(&self, scene: SceneFiles) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push(Arc::new(scene));
    }

    /// The scene of a number.
    pub fn get(&self, scene_idx: u32) -> Option<Arc<SceneFiles>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).get(scene_idx as usize).cloned()
    }
}
