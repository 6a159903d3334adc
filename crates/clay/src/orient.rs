//! Which way normals point: a spanning tree carries the sign from sample to sample.
//!
//! Across an edge of the tree the surface is taken to bend evenly, so a normal is mirrored at the
//! middle of the edge before the next one is compared with it. That is right over flat and round
//! places, over sharp edges, and from one side of a thin wall to the other.
//!
//! # Source
//! Hoppe et al. 1992, "Surface reconstruction from unorganized points" (spanning tree, weight 1 −
//! |n·n|), as Guo2004 asks for; the mirrored normal is that of König and Gumhold 2009, "Consistent
//! propagation of normal orientations in point clouds".

use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::f64::consts::PI;

use glam::DVec3;

use super::Neighbour;

/// Pieces up to which it is asked which of them lie in which: more are noise.
const PIECES: usize = 64;

/// Turns unit normals so that they point out of the material.
pub(super) fn orient(
    positions_map: &[DVec3],
    mut normals: Vec<DVec3>,
    spacings_m: &[f64],
    around: &[Vec<Neighbour>],
) -> Vec<DVec3> {
    let links = both_ways(around);
    let pieces = pieces(&links);
    for piece in &pieces {
        let root = outermost(piece, positions_map, &mut normals);
        spread(root, positions_map, &mut normals, &links);
    }
    if (2..=PIECES).contains(&pieces.len()) {
        turn_cavities(&pieces, positions_map, &mut normals, spacings_m);
    }
    normals
}

/// Neighbourhood is not mutual by itself.
fn both_ways(around: &[Vec<Neighbour>]) -> Vec<Vec<u32>> {
    let mut links: Vec<Vec<u32>> =
        around.iter().map(|found| found.iter().map(|other| other.sample).collect()).collect();
    for (sample, found) in (0..).zip(around) {
        found.iter().for_each(|other| links[other.sample as usize].push(sample));
    }
    for (sample, links) in (0..).zip(&mut links) {
        links.sort_unstable();
        links.dedup();
        links.retain(|other| *other != sample);
    }
    links
}

/// Samples that hang together, in ascending order each.
fn pieces(links: &[Vec<u32>]) -> Vec<Vec<u32>> {
    let mut is_seen = vec![false; links.len()];
    let mut pieces = Vec::new();
    for first in 0..links.len() {
        if std::mem::replace(&mut is_seen[first], true) {
            continue;
        }
        let mut piece = vec![first as u32];
        let mut next = 0;
        while let Some(sample) = piece.get(next).copied() {
            next += 1;
            for other in &links[sample as usize] {
                if !std::mem::replace(&mut is_seen[*other as usize], true) {
                    piece.push(*other);
                }
            }
        }
        piece.sort_unstable();
        pieces.push(piece);
    }
    pieces
}

/// Of the samples that lie farthest along the axes the one whose plane faces its axis best, its
/// normal turned out.
fn outermost(piece: &[u32], positions_map: &[DVec3], normals: &mut [DVec3]) -> u32 {
    let mut best = (-1.0, piece[0], DVec3::X);
    for axis in [DVec3::X, DVec3::Y, DVec3::Z, -DVec3::X, -DVec3::Y, -DVec3::Z] {
        let along = |sample: &u32| positions_map[*sample as usize].dot(axis);
        let farthest = piece
            .iter()
            .copied()
            .reduce(|best, sample| if along(&sample) > along(&best) { sample } else { best });
        if let Some(sample) = farthest {
            let facing = normals[sample as usize].dot(axis).abs();
            if facing > best.0 {
                best = (facing, sample, axis);
            }
        }
    }
    let (_, root, axis) = best;
    let normal = &mut normals[root as usize];
    if normal.dot(axis) < 0.0 {
        *normal = -*normal;
    }
    root
}

/// An edge of the graph; weights are never negative, so their bits are in their order.
type Edge = Reverse<(u64, u32, u32)>;

/// Carries the orientation of the root over the cheapest edges (Prim).
fn spread(root: u32, positions_map: &[DVec3], normals: &mut [DVec3], links: &[Vec<u32>]) {
    // The normal that an even bend expects at the other end of an edge.
    let mirrored = |normal: DVec3, from: u32, to: u32| {
        let way = (positions_map[to as usize] - positions_map[from as usize]).normalize_or_zero();
        normal - way * (2.0 * normal.dot(way))
    };
    let mut is_done = vec![false; links.len()];
    let mut heap: BinaryHeap<Edge> = BinaryHeap::new();
    let mut done = Some(root);
    while let Some(from) = done {
        is_done[from as usize] = true;
        for to in &links[from as usize] {
            if !is_done[*to as usize] {
                let agree =
                    mirrored(normals[from as usize], from, *to).dot(normals[*to as usize]).abs();
                heap.push(Reverse(((1.0 - agree).max(0.0).to_bits(), from, *to)));
            }
        }
        done = None;
        while let Some(Reverse((_, from, to))) = heap.pop() {
            if !is_done[to as usize] {
                let normal = normals[to as usize];
                if mirrored(normals[from as usize], from, to).dot(normal) < 0.0 {
                    normals[to as usize] = -normal;
                }
                done = Some(to);
                break;
            }
        }
    }
}

/// The wall of a cavity lies inside another piece, or inside three.
fn turn_cavities(
    pieces: &[Vec<u32>],
    positions_map: &[DVec3],
    normals: &mut [DVec3],
    spacings_m: &[f64],
) {
    let is_in = |at: DVec3, piece: &[u32]| {
        let winding = piece.iter().map(|sample| {
            let sample = *sample as usize;
            let way = positions_map[sample] - at;
            let squared = way.length_squared();
            let area_m2 = spacings_m[sample] * spacings_m[sample];
            if squared > 0.0 {
                area_m2 * normals[sample].dot(way) / (squared * squared.sqrt())
            } else {
                0.0
            }
        });
        winding.sum::<f64>() / (4.0 * PI) > 0.5
    };
    let is_cavity: Vec<bool> = (0..pieces.len())
        .map(|piece| {
            let at = positions_map[pieces[piece][0] as usize];
            let around = (0..pieces.len())
                .filter(|other| *other != piece && is_in(at, &pieces[*other]))
                .count();
            around % 2 == 1
        })
        .collect();
    for (piece, _) in pieces.iter().zip(is_cavity).filter(|(_, is_cavity)| *is_cavity) {
        piece.iter().for_each(|sample| normals[*sample as usize] = -normals[*sample as usize]);
    }
}
