//! The scanned bunny beside OpenVDB (signed distances in a narrow band) and Open3D (surface voxels
//! only).
//!
//! Runs are interleaved: ours, each peer, ours again. Our time is that of the same product and
//! leaves out reading the mesh, as the peers' do.

use super::super::peers::{Peer, PeerRun};
use super::super::process::{Bakes, Resolution};
use super::super::statistics::median;
use super::super::{BenchError, Row};
use super::Bench;

/// A peer's runs, up to the first that failed.
struct PeerRuns {
    peer: Peer,
    name: String,
    runs: Result<Vec<PeerRun>, String>,
}

impl PeerRuns {
    fn new(peer: Peer) -> Self {
        Self { peer, name: peer.name(), runs: Ok(Vec::new()) }
    }

    fn push(&mut self, run: Result<PeerRun, String>) {
        match (&mut self.runs, run) {
            (Ok(runs), Ok(run)) => runs.push(run),
            (Ok(_), Err(why)) => self.runs = Err(why),
            (Err(_), _) => {}
        }
    }

    fn of(&self, figure: impl Fn(&PeerRun) -> Option<f64>) -> Result<f64, String> {
        let runs = self.runs.as_ref().map_err(Clone::clone)?;
        median(&runs.iter().filter_map(figure).collect::<Vec<_>>())
            .ok_or_else(|| "no figure".to_owned())
    }
}

pub(super) fn rows(bench: &mut Bench<'_>) -> Result<Vec<Row>, BenchError> {
    let mesh = match bench.bunny() {
        Ok(mesh) => mesh,
        Err(why) => return Ok(vec![Row::new("bunny", format!("skipped: {why}"), None, "")]),
    };
    let mut rows = Vec::new();
    let sizes: &[u32] = if bench.options.quick { &[64] } else { &[256, 1024] };
    for voxels in sizes.iter().copied() {
        let group = format!("bunny: {voxels} voxels on the longest axis");
        let mut ours = Bakes::default();
        let mut peers =
            [Peer::OpenVdb { band: 8 }, Peer::OpenVdb { band: 3 }, Peer::Open3d].map(PeerRuns::new);
        for run in 1..=bench.options.n_runs {
            bench.bake_once(
                &format!("{group}, run {run}"),
                &mesh,
                Resolution::LongestAxis(voxels),
                None,
                &mut ours,
            )?;
            for peer in peers.iter_mut().filter(|peer| peer.runs.is_ok()) {
                (bench.tell)(&format!("{group}, {}, run {run}", peer.name));
                peer.push(bench.peers.run(peer.peer, &mesh, voxels));
            }
        }
        let [band_8, band_3, surface] = &peers;
        let seconds = |peer: &PeerRuns| peer.of(|run| Some(run.seconds));
        let map = ["init", "surface", "fill", "layers", "distance"];
        let ours_s = ours.sum_s(&map);
        let what = "surface + fill + 8 layers + distance";
        rows.push(Row::new(&group, "voxels", ours.count("voxels"), ""));
        rows.push(
            Row::new(&group, what, ours_s, "s")
                .beside_peer(&band_8.name, &seconds(band_8))
                .at_least_times(10.0),
        );
        rows.push(Row::new(&group, what, ours_s, "s").beside_peer(&band_3.name, &seconds(band_3)));
        rows.push(
            Row::new(&group, what, ours_s, "s")
                .beside_peer(&surface.name, &seconds(surface))
                .at_least_times(1.0),
        );
        let surface_s = ours.sum_s(&["init", "surface"]);
        rows.push(
            Row::new(&group, "surface", surface_s, "s")
                .beside_peer(&surface.name, &seconds(surface)),
        );
        for stage in map {
            rows.push(Row::new(&group, stage, ours.stage_s(stage), "s"));
        }
        let memory = Row::new(&group, "peak memory, pointshell included", ours.peak_mb(), "MB");
        rows.push(memory.beside_peer(&band_8.name, &band_8.of(|run| run.peak_mb)).at_most(1000.0));
    }
    Ok(rows)
}
