//! Other programs for the same work, run in the same minutes on the same machine.
//!
//! The folder of peers holds
//!
//! | file | what |
//! |---|---|
//! | `openvdb_level_set` | program: `MESH VOXELS_ON_LONGEST_AXIS BAND RUNS`, prints a line of JSON with `best_s` |
//! | `voxel_grids.py` | script: `MESH VOXELS_ON_LONGEST_AXIS open3d`, the same |
//! | `venv/bin/python` | Python with the script's packages; `python3` of the path where it is missing |
//!
//! Times are the peers' own and leave out reading the mesh.

use std::path::{Path, PathBuf};
use std::process::Command;

use super::process;

/// A folder of peers, or the reason why there is none.
#[derive(Debug)]
pub(super) struct Peers {
    folder: Option<PathBuf>,
    n_threads: usize,
}

/// A program to compare with.
#[derive(Clone, Copy, Debug)]
pub(super) enum Peer {
    /// OpenVDB's narrow-band level set: signed distance on both sides of the surface.
    OpenVdb {
        /// Voxels on each side.
        band: u32,
    },
    /// Open3D's voxel grid: surface voxels only, no inside, no distance.
    Open3d,
}

impl Peer {
    pub(super) fn name(self) -> String {
        match self {
            Self::OpenVdb { band } => format!("OpenVDB, band {band}"),
            Self::Open3d => "Open3D, surface only".to_owned(),
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
    pub(super) fn run(&self, peer: Peer, mesh: &Path, voxels_on_longest_axis: u32) -> Result<PeerRun, String> {
        let voxels = voxels_on_longest_axis.to_string();
        match peer {
            Peer::OpenVdb { band } => {
                let program = self.file("openvdb_level_set")?;
                self.measure(&program, |command| command.arg(mesh).args([voxels, band.to_string(), "1".to_owned()]))
            }
            Peer::Open3d => {
                let script = self.file("voxel_grids.py")?;
                let python = self.file("venv/bin/python").unwrap_or_else(|_| "python3".into());
                self.measure(&python, |command| command.arg(&script).arg(mesh).args([voxels, "open3d".to_owned()]))
            }
        }
    }

    fn file(&self, name: &str) -> Result<PathBuf, String> {
        let folder = self.folder.as_ref().ok_or("HAPTICD_PEERS not set")?;
        let path = folder.join(name);
        if path.is_file() { Ok(path) } else { Err(format!("no {name} in HAPTICD_PEERS")) }
    }

    fn measure(&self, program: &Path, arguments: impl FnOnce(&mut Command) -> &mut Command) -> Result<PeerRun, String> {
        let all = std::thread::available_parallelism().map_or(1, usize::from);
        // A peer takes every processor that it may use.
        let mut command = if self.n_threads < all {
            let mut pinned = Command::new("taskset");
            pinned.args(["-c", &format!("0-{}", self.n_threads - 1)]).arg(program);
            pinned
        } else {
            Command::new(program)
        };
        let ended = process::run(arguments(&mut command)).map_err(|error| error.to_string())?;
        let seconds = ended.json["best_s"].as_f64().ok_or_else(|| format!("no `best_s` in {}", ended.json))?;
        Ok(PeerRun { seconds, peak_mb: ended.peak_rss_bytes.map(|bytes| bytes as f64 * 1e-6) })
    }
}
