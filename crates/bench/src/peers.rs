//! Other programs for the same work, run in the same minutes on the same machine.
//!
//! The folder of peers holds
//!
//! | file | what |
//! |---|---|
//! | `openvdb_level_set` | program: `MESH VOXELS_ON_LONGEST_AXIS BAND RUNS`, prints a line of JSON with `best_s` |
//! | `voxel_grids.py` | script: `MESH VOXELS_ON_LONGEST_AXIS open3d`, the same |
//! | `coal_contacts.py` | script: `A.obj B.obj DX DY DZ [MOST_CONTACTS]` (B moved, m), prints a line of JSON with `median_ms` |
//! | `parry_contacts` | program: the same |
//! | `embree_distance.py` | script: `STATIC.obj TOOL.obj DX DY DZ POINTS`, the same |
//! | `venv/bin/python` | Python with the scripts' packages; `python3` of the path where it is missing |
//!
//! Times are the peers' own and leave out reading the mesh.

use std::path::{Path, PathBuf};
use std::process::Command;

use super::process::{self, ProcessResult};

/// A folder of peers, or the reason why there is none.
#[derive(Debug)]
pub(super) struct Peers {
    folder: Option<PathBuf>,
    n_threads: usize,
}

/// A program to compare with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Peer {
    /// OpenVDB's narrow-band level set: signed distance on both sides of the surface.
    OpenVdb {
        /// Voxels on each side.
        band: u32,
    },
    /// Open3D's voxel grid: surface voxels only, no inside, no distance.
    Open3d,
    /// Coal's bounding volumes: all contacts of two meshes.
    Coal,
    /// The same, until the first contact is found.
    CoalFirst,
    /// parry3d: contact manifolds of two meshes.
    Parry,
    /// Open3D on Embree: exact signed distances of as many points as our shell has.
    Embree,
}

impl Peer {
    pub(super) fn name(self) -> String {
        match self {
            Self::OpenVdb { band } => format!("OpenVDB, band {band}"),
            Self::Open3d => "Open3D, surface only".to_owned(),
            Self::Coal => "Coal, all contacts".to_owned(),
            Self::CoalFirst => "Coal, first contact".to_owned(),
            Self::Parry => "parry3d, manifolds".to_owned(),
            Self::Embree => "Embree, distances of as many points".to_owned(),
        }
    }
}

/// What a peer took.
#[derive(Clone, Copy, Debug)]
pub(super) struct PeerRun {
    pub(super) seconds: f64,
    pub(super) peak_mb: Option<f64>,
}

impl Peers {
    pub(super) fn new(folder: Option<PathBuf>, n_threads: usize) -> Self {
        Self { folder, n_threads }
    }

    /// One run of a peer on a mesh.
    pub(super) fn run(
        &self,
        peer: Peer,
        mesh: &Path,
        voxels_on_longest_axis: u32,
    ) -> Result<PeerRun, String> {
        let voxels = voxels_on_longest_axis.to_string();
        match peer {
            Peer::OpenVdb { band } => {
                let program = self.file("openvdb_level_set")?;
                self.measure(&program, |command| {
                    command.arg(mesh).args([voxels, band.to_string(), "1".to_owned()])
                })
            }
            Peer::Open3d => {
                let script = self.file("voxel_grids.py")?;
                self.measure(&self.python(), |command| {
                    command.arg(&script).arg(mesh).args([voxels, "open3d".to_owned()])
                })
            }
            Peer::Coal | Peer::CoalFirst | Peer::Parry | Peer::Embree => {
                Err(format!("{} makes no volume", peer.name()))
            }
        }
    }

    /// Contacts of a tool that is lifted along z with a static mesh, both OBJ files in metres: the
    /// peer's own median, ms.
    pub(super) fn contacts_ms(
        &self,
        peer: Peer,
        fixed: &Path,
        tool: &Path,
        lift_m: f64,
        n_points: usize,
    ) -> Result<f64, String> {
        let place = ["0".to_owned(), "0".to_owned(), lift_m.to_string()];
        let ended = match peer {
            Peer::Coal | Peer::CoalFirst | Peer::Embree => {
                let [script, most] = match peer {
                    Peer::Embree => ["embree_distance.py", &n_points.to_string()],
                    Peer::CoalFirst => ["coal_contacts.py", "1"],
                    _ => ["coal_contacts.py", "1000000"],
                };
                let script = self.file(script)?;
                self.ended(&self.python(), |command| {
                    command.arg(&script).args([fixed, tool]).args(place).arg(most)
                })
            }
            Peer::Parry => {
                let program = self.file("parry_contacts")?;
                self.ended(&program, |command| command.args([fixed, tool]).args(place))
            }
            Peer::OpenVdb { .. } | Peer::Open3d => {
                Err(format!("{} finds no contacts", peer.name()))
            }
        }?;
        ended.json["median_ms"].as_f64().ok_or_else(|| format!("no `median_ms` in {}", ended.json))
    }

    /// Runs a script of this repository with the Python of the folder of peers.
    pub(super) fn script(
        &self,
        script: &Path,
        arguments: &[&Path],
    ) -> Result<ProcessResult, String> {
        self.ended(&self.python(), |command| command.arg(script).args(arguments))
    }

    fn python(&self) -> PathBuf {
        self.file("venv/bin/python").unwrap_or_else(|_| "python3".into())
    }

    fn file(&self, name: &str) -> Result<PathBuf, String> {
        let folder = self.folder.as_ref().ok_or("HAPTICD_PEERS not set")?;
        let path = folder.join(name);
        if path.is_file() { Ok(path) } else { Err(format!("no {name} in HAPTICD_PEERS")) }
    }

    fn measure(
        &self,
        program: &Path,
        arguments: impl FnOnce(&mut Command) -> &mut Command,
    ) -> Result<PeerRun, String> {
        let ended = self.ended(program, arguments)?;
        let seconds = ended.json["best_s"]
            .as_f64()
            .ok_or_else(|| format!("no `best_s` in {}", ended.json))?;
        Ok(PeerRun { seconds, peak_mb: ended.peak_rss_bytes.map(|bytes| bytes as f64 * 1e-6) })
    }

    fn ended(
        &self,
        program: &Path,
        arguments: impl FnOnce(&mut Command) -> &mut Command,
    ) -> Result<ProcessResult, String> {
        let all = std::thread::available_parallelism().map_or(1, usize::from);
        // A peer takes every processor that it may use.
        let mut command = if self.n_threads < all {
            let mut pinned = Command::new("taskset");
            pinned.args(["-c", &format!("0-{}", self.n_threads - 1)]).arg(program);
            pinned
        } else {
            Command::new(program)
        };
        process::run(arguments(&mut command)).map_err(|error| error.to_string())
    }
}
