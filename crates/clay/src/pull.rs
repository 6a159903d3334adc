//! From the force of a tool to forces on mass points.
//!
//! Guo2004, force mapping: f = −∫_C s dC along the force vector C. A vector that leaves the material runs through negative densities and
//! raises them; one that enters it lowers them; one along the surface does nothing.

use glam::DVec3;
use rayon::prelude::*;

use super::falloff::Falloff;
use vps::density::{Lattice, Raster};

/// Steps of the integral along the force vector, at most this share of the spacing each.
const STEP_SPACINGS: f64 = 0.5;
/// And no more of them than this, however far the vector reaches.
const STEPS_MAX: usize = 256;

/// A force on the material.
#[derive(Clone, Debug, PartialEq)]
pub struct PullForce {
    /// Corners of the curve along which it acts, map frame, m; one: a point.
    pub along_map: Vec<DVec3>,
    /// Force on the material, map axes, N.
    pub force_n: DVec3,
    /// Length of the force vector in space, m: as far as the tool wants the surface to go.
    pub reach_m: f64,
    /// Distance from the curve at which the force ends, m.
    pub radius_m: f64,
    /// How it fades until there.
    pub falloff: Falloff,
}

/// −∫_C s dC along C = `reach_m` in direction `direction` from `from_map`, over ½ `reach_m²`: 1 where C leaves an undeformed surface along its
/// normal, −1 where it enters it, near 0 where it runs along it. Beyond the raster the last density counts on.
fn mapped_share(raster: &Raster, from_map: DVec3, direction: DVec3, reach_m: f64) -> f64 {
    let Some(direction) = direction.try_normalize() else { return 0.0 };
    let reaches = reach_m > 0.0;
    if !reaches {
        return 0.0;
    }
    let n_steps = ((reach_m / (STEP_SPACINGS * raster.lattice().spacing_m)).ceil() as usize).clamp(4, STEPS_MAX);
    let step_m = reach_m / n_steps as f64;
    let mut last_m = 0.0;
    let mut sum = 0.0;
    for n in 0..=n_steps {
        if let Some(density) = raster.at(from_map + direction * (n as f64 * step_m)) {
            last_m = f64::from(density.value_m);
        }
        sum += if n == 0 || n == n_steps { 0.5 * last_m } else { last_m };
    }
    -sum * step_m / (0.5 * reach_m * reach_m)
}

/// Adds a pull to the forces on the mass points, N, `[n_nodes]`.
///
/// The force is mapped at every piece of the curve by itself, so a curve over a bent surface lifts or dents it all along. Each piece
/// hands out its share of the force among the mass points that are nearest to it, by the weights of the fall-off, which are scaled to a
/// sum of 1: what arrives is the tool's force, whatever the spacing. Where nothing lies within the radius the nearest node takes all.
/// Cost: O(nodes in the radius · corners).
pub(super) fn add_pull(raster: &Raster, pull: &PullForce, forces_n: &mut [f32]) {
    let lattice = raster.lattice();
    let (Some(first), magnitude_n) = (pull.along_map.first(), pull.force_n.length()) else { return };
    let pulls = magnitude_n > 0.0 && pull.along_map.iter().all(|corner| corner.is_finite());
    if !pulls {
        return;
    }
    let shares: Vec<f64> = pull.along_map.iter().map(|corner| mapped_share(raster, *corner, pull.force_n, pull.reach_m)).collect();
    let (low, high) = pull.along_map.iter().fold((*first, *first), |(low, high), corner| (low.min(*corner), high.max(*corner)));
    let (first_node, last_node) = nodes_within(lattice, low - pull.radius_m, high + pull.radius_m);
    let [nx, ny, nz] = [0, 1, 2].map(|axis| (last_node[axis] + 1).saturating_sub(first_node[axis]));
    // The weight of each node, and the share of the force that its place on the curve maps.
    let weighed: Vec<(usize, f64, f64)> = (0..nx)
        .into_par_iter()
        .flat_map_iter(|x| {
            let shares = &shares;
            (0..ny * nz).filter_map(move |yz| {
                let node = [first_node[0] + x, first_node[1] + yz / nz, first_node[2] + yz % nz];
                let (distance_m, share) = nearest(&pull.along_map, shares, lattice.position(node));
                let weight = pull.falloff.weight(distance_m / pull.radius_m);
                (weight > 0.0).then(|| (lattice.index(node), weight, share))
            })
        })
        .collect();
    let total: f64 = weighed.iter().map(|(_, weight, _)| weight).sum();
    if total > 0.0 {
        for (node, weight, share) in weighed {
            forces_n[node] += (magnitude_n * share * weight / total) as f32;
        }
    } else {
        let nearest = lattice.nodes(*first).round();
        let last = lattice.dims.map(|n| (n - 1) as f32);
        if nearest.cmpge(glam::Vec3::ZERO).all() && nearest.cmple(last.into()).all() {
            forces_n[lattice.index([nearest.x as usize, nearest.y as usize, nearest.z as usize])] +=
                (magnitude_n * shares[0]) as f32;
        }
    }
}

/// First and last node of a box, clipped to the lattice; the first beyond the last where the box lies outside.
pub(super) fn nodes_within(lattice: &Lattice, low_map: DVec3, high_map: DVec3) -> ([usize; 3], [usize; 3]) {
    let nodes = |point: DVec3| (point - lattice.origin_map) / lattice.spacing_m;
    let (low, high) = (nodes(low_map).ceil().to_array(), nodes(high_map).floor().to_array());
    let first = low.map(|n| n.max(0.0) as usize);
    let mut last = [0; 3];
    for axis in 0..3 {
        let highest = (lattice.dims[axis] - 1) as f64;
        // An empty side must not look like node 0.
        if high[axis] < 0.0 || low[axis] > highest {
            return ([1; 3], [0; 3]);
        }
        last[axis] = high[axis].min(highest) as usize;
    }
    (first, last)
}

/// Distance of a point from a curve, and the value there between those at its corners.
fn nearest(corners: &[DVec3], values: &[f64], point: DVec3) -> (f64, f64) {
    let mut best = (f64::INFINITY, 0.0);
    if let ([corner], [value]) = (corners, values) {
        return (corner.distance(point), *value);
    }
    for (ends, values) in corners.windows(2).zip(values.windows(2)) {
        let way = ends[1] - ends[0];
        let along = if way == DVec3::ZERO { 0.0 } else { ((point - ends[0]).dot(way) / way.length_squared()).clamp(0.0, 1.0) };
        let distance = point.distance(ends[0] + way * along);
        if distance < best.0 {
            best = (distance, values[0] + (values[1] - values[0]) * along);
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Material below z = 0.
    fn half_space() -> Raster {
        let lattice = Lattice { origin_map: DVec3::splat(-0.02), spacing_m: 1e-3, dims: [41; 3] };
        let mut raster = Raster::uniform(lattice, 0.0);
        for n in 0..lattice.n_nodes() {
            raster.values_m_mut()[n] = -((n % 41) as f32 * 1e-3 - 0.02);
        }
        raster
    }

    fn pull(along_map: Vec<DVec3>, force_n: DVec3) -> PullForce {
        PullForce { along_map, force_n, reach_m: 5e-3, radius_m: 6e-3, falloff: Falloff::Gaussian }
    }

    #[test]
    fn a_force_out_of_the_surface_arrives_in_full_and_one_along_it_not_at_all() {
        let raster = half_space();
        for (force, expected) in [(DVec3::Z, 1.0), (-DVec3::Z, -1.0), (DVec3::X, 0.0), (DVec3::new(0.6, 0.0, 0.8), 0.8)] {
            let share = mapped_share(&raster, DVec3::ZERO, force, 5e-3);
            assert!((share - expected).abs() < 1e-6, "{force}: {share}");
        }
        assert_eq!(mapped_share(&raster, DVec3::ZERO, DVec3::ZERO, 5e-3), 0.0);
        assert_eq!(mapped_share(&raster, DVec3::ZERO, DVec3::Z, 0.0), 0.0);
    }

    #[test]
    fn what_is_handed_out_is_the_force_whatever_the_curve_and_the_fall_off() {
        let raster = half_space();
        let curve = vec![DVec3::new(-0.01, 0.0, 0.0), DVec3::new(0.0, 5e-3, 0.0), DVec3::new(0.01, 0.0, 0.0)];
        for along in [vec![DVec3::ZERO], curve] {
            for falloff in [Falloff::Gaussian, Falloff::Constant, Falloff::Spherical, Falloff::table(vec![0.2, 1.0]).unwrap()] {
                let mut forces = vec![0.0; raster.values_m().len()];
                add_pull(&raster, &PullForce { falloff: falloff.clone(), ..pull(along.clone(), DVec3::Z * 2.0) }, &mut forces);
                let sum: f64 = forces.iter().map(|force| f64::from(*force)).sum();
                assert!((sum - 2.0).abs() < 1e-4, "{falloff}: {sum}");
                assert!(forces.iter().all(|force| *force >= 0.0));
            }
        }
    }

    #[test]
    fn nothing_beyond_the_radius_is_moved() {
        let raster = half_space();
        let mut forces = vec![0.0; raster.values_m().len()];
        add_pull(&raster, &pull(vec![DVec3::ZERO], DVec3::Z), &mut forces);
        let lattice = raster.lattice();
        for x in 0..41 {
            for y in 0..41 {
                for z in 0..41 {
                    let distance_m = lattice.position([x, y, z]).length();
                    if (distance_m - 6e-3).abs() > 1e-9 {
                        assert_eq!(forces[lattice.index([x, y, z])] != 0.0, distance_m < 6e-3, "{x} {y} {z}");
                    }
                }
            }
        }
    }

    #[test]
    fn a_radius_below_the_spacing_moves_the_nearest_node_and_a_place_outside_none() {
        let raster = half_space();
        let mut forces = vec![0.0; raster.values_m().len()];
        let thin = |at: DVec3| PullForce { radius_m: 1e-4, ..pull(vec![at], DVec3::Z) };
        add_pull(&raster, &thin(DVec3::new(4e-4, 4e-4, 0.0)), &mut forces);
        assert_eq!(forces.iter().filter(|force| **force != 0.0).count(), 1);
        assert!(forces[raster.lattice().index([20, 20, 20])] > 0.9);
        forces.fill(0.0);
        for outside in [DVec3::splat(1.0), DVec3::splat(-1.0), DVec3::NAN] {
            add_pull(&raster, &thin(outside), &mut forces);
            add_pull(&raster, &pull(vec![outside], DVec3::Z), &mut forces);
        }
        assert!(forces.iter().all(|force| *force == 0.0));
    }
}
