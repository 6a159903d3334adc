//! How long a contact query takes: against points and contact share, against triangles, and beside other programs on a nut.

use std::hint::black_box;
use std::time::Instant;

use glam::{DQuat, DVec3};

use super::super::peers::{Peer, Peers};
use super::super::statistics::{median, quantile};
use super::super::{BenchError, Row};
use super::fields::contact;
use super::fixture::{self, Tube};
use super::{Options, Walk, query};
use crate::haptics::FilterParameters;
use crate::haptics::contact::{ContactSum, Obstacle};
use crate::mesh;
use crate::mesh::primitives::Shape;
use crate::pointshell::shell::Shell;
use crate::spatial::Pose;
use crate::voxmap::field::FieldKind;

/// Voxel of the bore, m; the pin's is what gives the wanted number of points.
const VOXEL_M: f64 = 5e-4;
const BORE_M: f64 = 0.02;
/// Between pin and bore: every point of the pin's side is inside the band.
const GAP_M: f64 = 1e-3;
const PIN_HEIGHT_M: f64 = 0.16;
/// Queries are repeated for at least so long, s.
const MEASURED_S: f64 = 0.4;

pub(super) fn rows(options: &Options, tell: &mut dyn FnMut(&str)) -> Result<Vec<Row>, BenchError> {
    let mut rows = points_and_share(options, tell)?;
    rows.extend(triangles(options, tell)?);
    rows.extend(nut(options, tell)?);
    Ok(rows)
}

fn bore(pieces: [usize; 2]) -> Tube {
    // As long as the pin and a band more on both sides, thicker than two bands.
    let sides = Tube::sides_for(BORE_M, VOXEL_M);
    Tube { inner_m: BORE_M, outer_m: BORE_M + 30.0 * VOXEL_M, height_m: PIN_HEIGHT_M + 40.0 * VOXEL_M, sides, pieces }
}

/// A pin with about so many points.
fn pin(n_points: f64) -> Result<Shell, BenchError> {
    let radius_m = BORE_M - GAP_M;
    let area_m2 = core::f64::consts::TAU * radius_m * (PIN_HEIGHT_M + radius_m);
    // Surface voxels of an upright pin in the area of one face, counted.
    let voxel_size_m = (1.245 * area_m2 / n_points).sqrt();
    let shape = Shape::Cylinder { radius_m, height_m: PIN_HEIGHT_M };
    fixture::shell("a pin", &fixture::tessellated(shape, voxel_size_m), voxel_size_m)
}

fn ask(walk: Walk, obstacles: &[Obstacle], shell: &Shell, pose: Pose) -> ContactSum {
    let filter = FilterParameters { spatial: true, cutoff_hz: [f64::INFINITY; 2] };
    query(walk, obstacles, shell, pose, &contact(FieldKind::Trilinear), &filter)
}

/// The pin so far to the side that a share of its points touches.
fn at_share(obstacles: &[Obstacle], shell: &Shell, share: f64) -> Pose {
    let at = |aside_m: f64| Pose::from_translation(DVec3::new(0.8, 0.6, 0.0) * aside_m);
    if share == 0.0 {
        return at(0.5 * GAP_M);
    }
    let (mut low_m, mut high_m) = (0.5 * GAP_M, 2.0 * GAP_M);
    for _ in 0..20 {
        let middle_m = 0.5 * (low_m + high_m);
        let touching = f64::from(ask(Walk::Flat, obstacles, shell, at(middle_m)).contacts);
        if touching < share * shell.len() as f64 { low_m = middle_m } else { high_m = middle_m }
    }
    at(high_m)
}

/// Median and p99 of one query over small turns of a pose, µs.
fn time_us(walk: Walk, obstacles: &[Obstacle], shell: &Shell, pose: Pose, options: &Options) -> (f64, f64) {
    let long_s = if options.quick { 0.02 } else { MEASURED_S };
    let turned = |n: usize| pose * Pose::new(DQuat::from_rotation_z(1e-3 * (n % 64) as f64), DVec3::ZERO);
    let mut medians = Vec::new();
    let mut p99s = Vec::new();
    for _ in 0..options.n_runs {
        let begin = Instant::now();
        let mut times_us = Vec::new();
        while times_us.len() < 8 || begin.elapsed().as_secs_f64() < long_s {
            let pose = turned(times_us.len());
            let since = Instant::now();
            black_box(ask(walk, obstacles, shell, black_box(pose)));
            times_us.push(since.elapsed().as_secs_f64() * 1e6);
        }
        times_us.sort_by(f64::total_cmp);
        medians.extend(quantile(&times_us, 0.5));
        p99s.extend(quantile(&times_us, 0.99));
    }
    (median(&medians).unwrap_or_default(), median(&p99s).unwrap_or_default())
}

fn points_and_share(options: &Options, tell: &mut dyn FnMut(&str)) -> Result<Vec<Row>, BenchError> {
    let obstacles = [fixture::obstacle("the bore", &bore([1, 1]).mesh(), VOXEL_M, false)?];
    let sizes: &[f64] = if options.quick { &[8e3] } else { &[8e3, 1e5, 1e6] };
    let mut rows = Vec::new();
    for wanted in sizes {
        let shell = pin(*wanted)?;
        let group = format!("pin in a bore, {} points all within the band, trilinear", shell.len());
        for share in [0.0, 0.01, 0.03] {
            tell(&format!("{} points, {} % touching", shell.len(), 100.0 * share));
            let pose = at_share(&obstacles, &shell, share);
            let touching = ask(Walk::Flat, &obstacles, &shell, pose).contacts;
            for walk in Walk::ALL {
                let (median_us, p99_us) = time_us(walk, &obstacles, &shell, pose, options);
                let name = |what: &str| format!("{}, {} % touching: {what}", walk.name(), 100.0 * share);
                let per_point = Row::new(&group, name("for one point"), 1e3 * median_us / shell.len() as f64, "ns");
                let per_point = match (walk, *wanted as u64) {
                    (Walk::Flat, 1_000_000) => per_point.at_most(1.2),
                    _ => per_point,
                };
                let whole = Row::new(&group, name("one query, median"), median_us, "µs");
                let whole = if *wanted as u64 == 8_000 { whole.beside_paper(1000.0).at_most(16.0) } else { whole };
                rows.extend([whole, Row::new(&group, name("one query, p99"), p99_us, "µs"), per_point]);
                rows.push(Row::new(&group, name("points in contact"), f64::from(touching), ""));
            }
        }
    }
    Ok(rows)
}

/// The same bore cut into few and into many triangles.
fn triangles(options: &Options, tell: &mut dyn FnMut(&str)) -> Result<Vec<Row>, BenchError> {
    let shell = pin(8e3)?;
    let group = format!("pin of {} points in the same bore, cut into few and many triangles", shell.len());
    let sides = bore([1, 1]).sides;
    // Two triangles for each piece around and each step of the profile.
    let pieces = |n_triangles: usize, around: usize| [around, (n_triangles / (4 * sides * around)).max(2) - 1];
    let (few, many) = (pieces(10_000, 1), if options.quick { pieces(100_000, 2) } else { pieces(3_000_000, 8) });
    let mut baked = Vec::new();
    for pieces in [few, many] {
        let mesh = bore(pieces).mesh();
        tell(&format!("bore of {} triangles", mesh.triangles.len()));
        baked.push((mesh.triangles.len(), [fixture::obstacle("the bore", &mesh, VOXEL_M, false)?]));
    }
    let pose = at_share(&baked[0].1, &shell, 0.03);
    // In turn, so that a busy moment of the machine meets both.
    let mut times_us = [Vec::new(), Vec::new()];
    let one = Options { n_runs: 1, ..options.clone() };
    for _ in 0..2 * options.n_runs.max(2) {
        for ((_, obstacles), times_us) in baked.iter().zip(&mut times_us) {
            times_us.push(time_us(Walk::Flat, obstacles, &shell, pose, &one).0);
        }
    }
    let medians = times_us.map(|times_us| median(&times_us).unwrap_or_default());
    let mut rows: Vec<Row> = baked
        .iter()
        .zip(medians)
        .map(|((n, _), median_us)| Row::new(&group, format!("flat, {n} triangles: one query, median"), median_us, "µs"))
        .collect();
    rows.push(Row::new(&group, "flat: more time with many triangles, share", medians[1] / medians[0] - 1.0, "").within(0.1));
    Ok(rows)
}

/// Where nut and bolt stand: the nut's mesh lies at 16 to 29 mm along the bolt's axis, as the thread has it, and is lifted until flanks touch.
const LIFT_M: f64 = 2e-4;
const BOLT: &str = "factory_bolt_m16_tight.obj";
const NUT: &str = "factory_nut_m16_tight_subdiv_3x.obj";
const NUT_GROUP: &str = "M16 nut on its bolt: all contacts of 25,672 with 15,078 triangles";

fn nut(options: &Options, tell: &mut dyn FnMut(&str)) -> Result<Vec<Row>, BenchError> {
    let skipped = |why: String| Ok(vec![Row::new(NUT_GROUP, format!("skipped: {why}"), None, "")]);
    if options.quick {
        return skipped("--quick".to_owned());
    }
    let Some(folder) = &options.models else { return skipped("HAPTICD_MODELS not set".to_owned()) };
    let [bolt_path, nut_path] = [BOLT, NUT].map(|name| folder.join(name));
    let (bolt, nut) = match (mesh::load(&bolt_path, 1.0), mesh::load(&nut_path, 1.0)) {
        (Ok(bolt), Ok(nut)) => (bolt, nut),
        (Err(error), _) | (_, Err(error)) => return skipped(error.to_string()),
    };
    tell("nut on bolt");
    let obstacles = [fixture::obstacle(BOLT, &bolt, 2e-4, false)?];
    // At least 20,000 points.
    let shell = fixture::shell(NUT, &nut, 4e-4)?;
    let pose = Pose::from_translation(DVec3::Z * LIFT_M);
    let mut times_us = Vec::new();
    let mut contacts = Vec::new();
    for _ in 0..options.n_runs.max(3) {
        // The turns of the peers.
        for turn in 0..11 {
            let pose = pose * Pose::new(DQuat::from_rotation_z(0.01 * f64::from(turn)), DVec3::ZERO);
            let since = Instant::now();
            let sum = ask(Walk::Flat, &obstacles, &shell, black_box(pose));
            times_us.push(since.elapsed().as_secs_f64() * 1e6);
            contacts.push(f64::from(black_box(sum).contacts));
        }
    }
    let median_ms = median(&times_us).map(|us| us * 1e-3);
    let peers = Peers::new(options.peers.clone(), 1);
    let figure = |peer: Peer, tell: &mut dyn FnMut(&str)| {
        tell(&format!("nut on bolt: {}", peer.name()));
        peers.contacts_ms(peer, &bolt_path, &nut_path, LIFT_M, shell.len())
    };
    let peer_row = |peer: Peer, tell: &mut dyn FnMut(&str)| {
        let row = Row::new(NUT_GROUP, format!("flat, {} points: one query, median", shell.len()), median_ms, "ms");
        row.beside_peer(&peer.name(), &figure(peer, tell)).at_least_times(1000.0)
    };
    let mut rows = vec![Row::new(NUT_GROUP, "points in contact, median", median(&contacts), "")];
    rows.extend([Peer::Coal, Peer::Parry, Peer::Embree].map(|peer| peer_row(peer, tell)));
    Ok(rows)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_point_of_the_pin_is_in_the_band_and_shares_are_met() {
        let obstacles = [fixture::obstacle("the bore", &bore([1, 1]).mesh(), VOXEL_M, false).unwrap()];
        let shell = pin(8e3).unwrap();
        assert!((shell.len() as f64 / 8e3 - 1.0).abs() < 0.3, "{} points", shell.len());
        for share in [0.0, 0.01, 0.03] {
            let touching = f64::from(ask(Walk::Flat, &obstacles, &shell, at_share(&obstacles, &shell, share)).contacts);
            let found = touching / shell.len() as f64;
            assert!(found >= share && found < share + 0.02, "{share}: {found}");
        }
    }
}
