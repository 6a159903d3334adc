//! Figures of generation: the paper's Table 1, peers on a scanned mesh, growth with the voxel size.

mod pointshells;
mod scaling;
mod side_by_side;
mod voxmaps;

use std::path::{Path, PathBuf};

use super::export::{TemporaryFolder, write_stl};
use super::peers::Peers;
use super::process::{Bake, Bakes, Resolution};
use super::stand_ins::StandIn;
use super::{BenchError, Row};

/// What to measure, and with what.
#[derive(Clone, Debug)]
pub struct Options {
    /// This program: bakes are processes of it.
    pub program: PathBuf,
    /// Runs of everything; figures are medians.
    pub n_runs: usize,
    /// Threads of a bake, processors of a peer.
    pub n_threads: usize,
    /// Small cases only: seconds instead of minutes.
    pub quick: bool,
    /// Folder of real meshes (`stanford-bunny.obj`); without it those rows are skipped.
    pub models: Option<PathBuf>,
    /// Folder of peer programs; without it those figures are skipped.
    pub peers: Option<PathBuf>,
}

/// Seed of the stand-ins: every run measures the same ones.
const SEED: u64 = 2008;

/// Measures generation. `tell` is called with each step.
///
/// Needs the size of the stand-ins (about 155 MB) in the temporary folder. Cost: minutes to a
/// quarter of an hour, mostly peers.
///
/// # Errors
/// A bake that fails, or a temporary folder that cannot be written. A peer that fails is a row that
/// says so.
pub fn run(options: &Options, mut tell: impl FnMut(&str)) -> Result<Vec<Row>, BenchError> {
    let mut bench = Bench::new(options, &mut tell)?;
    let mut rows = vec![
        Row::new(
            "settings",
            "threads of a bake, processors of a peer",
            options.n_threads as f64,
            "",
        ),
        Row::new(
            "settings",
            "runs, of which every figure is the median",
            options.n_runs as f64,
            "",
        ),
    ];
    rows.extend(voxmaps::rows(&mut bench)?);
    rows.extend(pointshells::rows(&mut bench)?);
    rows.extend(side_by_side::rows(&mut bench)?);
    rows.extend(scaling::rows(&mut bench)?);
    Ok(rows)
}

/// What every part of the bench needs.
struct Bench<'a> {
    options: &'a Options,
    folder: TemporaryFolder,
    peers: Peers,
    tell: &'a mut dyn FnMut(&str),
}

impl<'a> Bench<'a> {
    fn new(options: &'a Options, tell: &'a mut dyn FnMut(&str)) -> Result<Self, BenchError> {
        let folder = TemporaryFolder::create()
            .map_err(|source| BenchError::Write { path: std::env::temp_dir(), source })?;
        let peers = Peers::new(options.peers.clone(), options.n_threads);
        Ok(Self { options, folder, peers, tell })
    }

    /// The STL file of a stand-in, written when it is first asked for.
    fn stand_in(&mut self, stand_in: StandIn) -> Result<PathBuf, BenchError> {
        let path = self.folder.path().join(stand_in.name()).with_extension("stl");
        if !path.is_file() {
            (self.tell)(&format!("making the {}", stand_in.name()));
            write_stl(&path, &stand_in.mesh(SEED))
                .map_err(|source| BenchError::Write { path: path.clone(), source })?;
        }
        Ok(path)
    }

    /// The scanned bunny, or the reason why there is none.
    fn bunny(&self) -> Result<PathBuf, String> {
        let folder = self.options.models.as_ref().ok_or("HAPTICD_MODELS not set")?;
        let path = folder.join("stanford-bunny.obj");
        if path.is_file() {
            Ok(path)
        } else {
            Err("no stanford-bunny.obj in HAPTICD_MODELS".to_owned())
        }
    }

    /// One measured bake.
    fn bake(
        &mut self,
        what: &str,
        mesh: &Path,
        resolution: Resolution,
        navigation: Option<&'static str>,
    ) -> Result<Bakes, BenchError> {
        let mut bakes = Bakes::default();
        for run in 1..=self.options.n_runs {
            self.bake_once(
                &format!("{what}, run {run}"),
                mesh,
                resolution,
                navigation,
                &mut bakes,
            )?;
        }
        Ok(bakes)
    }

    fn bake_once(
        &mut self,
        what: &str,
        mesh: &Path,
        resolution: Resolution,
        navigation: Option<&'static str>,
        bakes: &mut Bakes,
    ) -> Result<(), BenchError> {
        (self.tell)(what);
        let bake = Bake { mesh, resolution, navigation, n_threads: self.options.n_threads };
        bakes.push(bake.run(&self.options.program)?);
        Ok(())
    }
}
