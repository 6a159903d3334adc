//! Pieces of material and of air that no sample bounds, and how the material hangs together.
//!
//! Densities may part and join as they like: a tool that pushes through a plate leaves a hole, two
//! fronts that meet become one, a neck that is pulled thin breaks. What the clay is, the samples
//! say: connected material without a sample on it (a crumb finer than the samples), and connected
//! air without one (a bubble), are taken away; samples that no level is left for go as well
//! ([`AdvectedSamples::lost`](super::advect::AdvectedSamples::lost)).

use glam::DVec3;
use rayon::prelude::*;

use vps::density::Raster;

/// Turns material and air over that no sample bounds and that does not reach the faces of the
/// raster; gives whether there was any. Nodes are connected along the axes. Cost: O(nodes and
/// samples).
pub(super) fn forget_unsampled(raster: &mut Raster, positions_map: &[DVec3]) -> bool {
    const NONE: u32 = u32::MAX;
    let lattice = *raster.lattice();
    let [nx, ny, nz] = lattice.dims;
    let values_m = raster.values_m();
    let is_in: Vec<bool> = values_m.iter().map(|value_m| *value_m >= 0.0).collect();
    let mut part_of = vec![NONE; values_m.len()];
    // Of each connected part: something keeps it.
    let mut stays: Vec<bool> = Vec::new();
    let mut waiting = Vec::new();
    for seed in 0..is_in.len() {
        if part_of[seed] != NONE {
            continue;
        }
        let part = stays.len() as u32;
        stays.push(false);
        part_of[seed] = part;
        waiting.push(seed);
        while let Some(node) = waiting.pop() {
            let x = node / (ny * nz);
            let y = node / nz % ny;
            let z = node % nz;
            let beside = [
                (x > 0).then(|| node - ny * nz),
                (x + 1 < nx).then_some(node + ny * nz),
                (y > 0).then(|| node - nz),
                (y + 1 < ny).then_some(node + nz),
                (z > 0).then(|| node - 1),
                (z + 1 < nz).then_some(node + 1),
            ];
            for other in beside {
                match other {
                    None => stays[part as usize] = true,
                    Some(other) if part_of[other] == NONE && is_in[other] == is_in[node] => {
                        part_of[other] = part;
                        waiting.push(other);
                    }
                    Some(_) => {}
                }
            }
        }
    }
    if stays.iter().all(|stays| *stays) {
        return false;
    }
    for at in positions_map {
        let node = (at - lattice.origin_map) / lattice.spacing_m;
        let last = DVec3::new(nx as f64, ny as f64, nz as f64) - 2.0;
        if !(node.cmpge(DVec3::ZERO).all() && node.floor().cmple(last).all()) {
            continue;
        }
        let [x, y, z] = node.floor().to_array().map(|n| n as usize);
        for corner in 0..8 {
            let node = lattice.index([x + (corner >> 2), y + (corner >> 1 & 1), z + (corner & 1)]);
            stays[part_of[node] as usize] = true;
        }
    }
    let mut has_turned = false;
    for (value_m, part) in raster.values_m_mut().iter_mut().zip(&part_of) {
        if !stays[*part as usize] {
            // A zero is inside: its negative has to be outside.
            *value_m = if *value_m >= 0.0 { -value_m.max(f32::MIN_POSITIVE) } else { -*value_m };
            has_turned = true;
        }
    }
    has_turned
}

/// The Euler number of the material in a raster: 1 for a ball, 0 for a ring, 2 for two balls or a
/// hollow one. Nodes with their neighbours along the axes, squares and cubes of them: V − E + F −
/// C. A stroke that changes it has let fronts meet or part. Parallel; cost: O(nodes).
pub(super) fn euler_number(raster: &Raster) -> i64 {
    let [nx, ny, nz] = raster.lattice().dims;
    let values_m = raster.values_m();
    let is_in = |[x, y, z]: [usize; 3]| {
        x < nx && y < ny && z < nz && values_m[(x * ny + y) * nz + z] >= 0.0
    };
    // Of the cells whose lowest corner is a node.
    let of_node = |[x, y, z]: [usize; 3]| {
        let corner = |n: usize| is_in([x + (n >> 2), y + (n >> 1 & 1), z + (n & 1)]);
        let along = [1, 2, 4].map(corner);
        let square = [3, 5, 6].map(corner);
        let count = |all: &[bool]| all.iter().filter(|is| **is).count() as i64;
        let squares = [
            along[0] && along[1] && square[0],
            along[0] && along[2] && square[1],
            along[1] && along[2] && square[2],
        ];
        1 - count(&along) + count(&squares) - i64::from(squares == [true; 3] && corner(7))
    };
    let of_plane = |x: usize| -> i64 {
        (0..ny)
            .flat_map(|y| (0..nz).map(move |z| [x, y, z]))
            .filter(|node| is_in(*node))
            .map(of_node)
            .sum()
    };
    (0..nx).into_par_iter().map(of_plane).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shapes::sphere;
    use vps::density::Lattice;

    #[test]
    fn euler_numbers_of_balls_rings_and_shells() {
        let lattice = Lattice { origin_map: DVec3::splat(-0.02), spacing_m: 1e-3, dims: [41; 3] };
        let ball = |middle: DVec3, radius_m: f64| move |at: DVec3| radius_m - at.distance(middle);
        let ring = |at: DVec3| 4e-3 - (at.truncate().length() - 0.011).hypot(at.z);
        let one = ball(DVec3::X * 0.01, 6e-3);
        let cases: [(&dyn Fn(DVec3) -> f64, i64); 6] = [
            (&|_| -1.0, 0),
            (&one, 1),
            (&|at| one(at).max(ball(DVec3::X * -0.01, 6e-3)(at)), 2),
            (&ring, 0),
            (&|at| ring(at).max(2.5e-3 - at.y.hypot(at.z)), -1),
            (&|at| ball(DVec3::ZERO, 0.015)(at).min(at.length() - 8e-3), 2),
        ];
        for (n, (field, expected)) in cases.into_iter().enumerate() {
            let mut raster = Raster::uniform(lattice, 0.0);
            for (place, value_m) in raster.values_m_mut().iter_mut().enumerate() {
                *value_m =
                    field(lattice.position([place / 41 / 41, place / 41 % 41, place % 41])) as f32;
            }
            assert_eq!(euler_number(&raster), expected, "case {n}");
        }
    }

    #[test]
    fn a_crumb_and_a_bubble_without_samples_go_and_sampled_ones_stay() {
        let lattice = Lattice { origin_map: DVec3::splat(-0.02), spacing_m: 1e-3, dims: [41; 3] };
        let crumb = DVec3::X * 0.015;
        let bubble = DVec3::Y * 3e-3;
        let ball = |at: DVec3| 0.01 - at.length();
        let field =
            |at: DVec3| ball(at).max(2e-3 - at.distance(crumb)).min(at.distance(bubble) - 2e-3);
        let raster = |field: &dyn Fn(DVec3) -> f64| {
            let mut raster = Raster::uniform(lattice, 0.0);
            for x in 0..41 {
                for y in 0..41 {
                    for z in 0..41 {
                        raster.values_m_mut()[lattice.index([x, y, z])] =
                            field(lattice.position([x, y, z])) as f32;
                    }
                }
            }
            raster
        };
        let around =
            |middle: DVec3| sphere(100, 2e-3).positions_map.into_iter().map(move |at| at + middle);
        let outer = sphere(2000, 0.01).positions_map;
        let n_in =
            |raster: &Raster| raster.values_m().iter().filter(|value_m| **value_m >= 0.0).count();
        let bare = raster(&ball);
        let full = raster(&field);
        let mut left = full.clone();
        assert!(forget_unsampled(&mut left, &outer));
        assert_eq!(n_in(&left), n_in(&bare));
        assert!(!forget_unsampled(&mut left, &outer), "nothing is left to go");
        let all: Vec<DVec3> =
            outer.iter().copied().chain(around(crumb)).chain(around(bubble)).collect();
        let mut left = full.clone();
        assert!(!forget_unsampled(&mut left, &all) && left == full);
    }
}
