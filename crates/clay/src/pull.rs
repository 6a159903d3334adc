//! From the force of a tool to forces on mass points.
//!
//! Guo2004, force mapping: f = −∫_C s dC along the force vector C. A vector that leaves the
//! material runs through negative densities and raises them; one that enters it lowers them; one
//! along the surface does nothing.

use glam::DVec3;
use rayon::prelude::*;

use super::falloff::Falloff;
use vps::density::{Lattice, Raster};

/// Steps of the integral along the force vector, at most this share of the spacing each.
const STEP_SPACINGS: f64 = 0.5;
/// And no more of them than this, however far the vector reaches.
const STEPS_MAX: usize = 256;

/// A vector crosses the surface where the cosine of its angle with the normal is this at least.
const ACROSS_MIN: f64 = 0.5;

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

/// A force on the material along several curves at once. It is shared out over all of them
/// together: where they cross, no mass point gets it twice.
#[derive(Clone, Copy, Debug)]
pub(super) struct CurvesPull<'c> {
    /// Corners of each curve along which it acts, map frame, m; one corner: a point.
    pub(super) curves_map: &'c [Vec<DVec3>],
    /// Force on the material, map axes, N.
    pub(super) force_n: DVec3,
    /// Length of the force vector in space, m.
    pub(super) reach_m: f64,
    /// Distance from the curves at which the force ends, m.
    pub(super) radius_m: f64,
    /// How it fades until there.
    pub(super) falloff: &'c Falloff,
    /// The curves need not lie on the surface: each place pulls the level of density that it lies
    /// on, as if that were the surface.
    pub(super) is_free: bool,
}

impl<'c> From<&'c PullForce> for CurvesPull<'c> {
    fn from(pull: &'c PullForce) -> Self {
        let PullForce { along_map, force_n, reach_m, radius_m, falloff } = pull;
        let curves_map = core::slice::from_ref(along_map);
        Self {
            curves_map,
            force_n: *force_n,
            reach_m: *reach_m,
            radius_m: *radius_m,
            falloff,
            is_free: false,
        }
    }
}

/// −∫_C (s − level) dC along C = `reach_m` in direction `direction` from `from_map`, over ½
/// `reach_m²`: 1 where C leaves an undeformed surface along its normal, −1 where it enters it, near
/// 0 where it runs along it. Beyond the raster the last density counts on. The level of the surface
/// is 0. A vector that crosses the surface keeps the sign that it has there: densities that turn
/// back count as if they went on, or no force would be left to get through a thin plate, or over a
/// narrow gap (ours).
fn mapped_share(
    raster: &Raster,
    (from_map, level_m): (DVec3, f64),
    direction: DVec3,
    reach_m: f64,
) -> f64 {
    let Some(direction) = direction.try_normalize() else { return 0.0 };
    let reaches = reach_m > 0.0;
    if !reaches {
        return 0.0;
    }
    let n_steps = ((reach_m / (STEP_SPACINGS * raster.lattice().spacing_m)).ceil() as usize)
        .clamp(4, STEPS_MAX);
    let step_m = reach_m / n_steps as f64;
    // Its cosine with the way in; the slope itself is small where a plate or a gap is about as thin
    // as the raster is fine.
    let across = raster
        .at(from_map)
        .map_or(0.0, |density| density.gradient.as_dvec3().normalize_or_zero().dot(direction));
    let mut last_m = 0.0;
    let mut value_m = 0.0;
    let mut sum = 0.0;
    for n in 0..=n_steps {
        if let Some(density) = raster.at(from_map + direction * (n as f64 * step_m)) {
            let density_m = f64::from(density.value_m) - level_m;
            // Where the vector comes near the far side of a plate or of a gap, densities turn back.
            let turns = n > 0 && across.abs() >= ACROSS_MIN && (density_m - last_m) * across < 0.0;
            value_m += if turns { last_m - density_m } else { density_m - last_m };
            last_m = density_m;
        }
        sum += if n == 0 || n == n_steps { 0.5 * value_m } else { value_m };
    }
    -sum * step_m / (0.5 * reach_m * reach_m)
}

/// Adds a pull to the forces on the mass points, N, `[n_nodes]`.
///
/// The force is mapped at every piece of the curves by itself, so a curve over a bent surface lifts
/// or dents it all along. Each piece hands out its share of the force among the mass points that
/// are nearest to it, by the weights of the fall-off, which are scaled to a sum of 1: what arrives
/// is the tool's force, whatever the spacing. Where nothing lies within the radius the nearest node
/// takes all. Cost: O(pieces · nodes in the radius + nodes in the box around the curves).
pub(super) fn add_pull<'p>(raster: &Raster, pull: impl Into<CurvesPull<'p>>, forces_n: &mut [f32]) {
    let pull: CurvesPull<'p> = pull.into();
    let lattice = raster.lattice();
    let corners = || pull.curves_map.iter().flatten();
    let (Some(first), magnitude_n) = (corners().next(), pull.force_n.length()) else { return };
    let pulls = magnitude_n > 0.0 && corners().all(|corner| corner.is_finite());
    if !pulls {
        return;
    }
    let share_at = |at: &DVec3| {
        let level_m = if pull.is_free {
            raster.at(*at).map_or(0.0, |density| f64::from(density.value_m))
        } else {
            0.0
        };
        mapped_share(raster, (*at, level_m), pull.force_n, pull.reach_m)
    };
    let shares: Vec<Vec<f64>> =
        pull.curves_map.iter().map(|curve| curve.par_iter().map(share_at).collect()).collect();
    let (low, high) = corners()
        .fold((*first, *first), |(low, high), corner| (low.min(*corner), high.max(*corner)));
    let (first_node, last_node) = nodes_within(lattice, low - pull.radius_m, high + pull.radius_m);
    let [nx, ny, nz] = [0, 1, 2].map(|axis| (last_node[axis] + 1).saturating_sub(first_node[axis]));
    // Of each node in the box: its distance from the nearest piece, and the share of the force that
    // this piece maps there.
    let mut nearest = vec![(f64::INFINITY, 0.0); nx * ny * nz];
    for (curve, shares) in pull.curves_map.iter().zip(&shares) {
        let last = curve.len().saturating_sub(1);
        // A single corner is a piece without length.
        for piece in 0..last.max(1).min(curve.len()) {
            let begin = piece;
            let end = (piece + 1).min(last);
            let ends = [curve[begin], curve[end]];
            let values = [shares[begin], shares[end]];
            let (low, high) = nodes_within(
                lattice,
                ends[0].min(ends[1]) - pull.radius_m,
                ends[0].max(ends[1]) + pull.radius_m,
            );
            for x in low[0]..=high[0] {
                for y in low[1]..=high[1] {
                    for z in low[2]..=high[2] {
                        let here = ((x - first_node[0]) * ny + (y - first_node[1])) * nz
                            + (z - first_node[2]);
                        let (distance_m, share) =
                            on_piece(ends, values, lattice.position([x, y, z]));
                        if distance_m < nearest[here].0 {
                            nearest[here] = (distance_m, share);
                        }
                    }
                }
            }
        }
    }
    let weighed = || {
        nearest.iter().enumerate().filter_map(|(here, (distance_m, share))| {
            let weight = pull.falloff.weight(distance_m / pull.radius_m);
            (weight > 0.0).then_some((here, weight, share))
        })
    };
    let total: f64 = weighed().map(|(_, weight, _)| weight).sum();
    if total > 0.0 {
        for (here, weight, share) in weighed() {
            let node = [
                first_node[0] + here / (ny * nz),
                first_node[1] + here / nz % ny,
                first_node[2] + here % nz,
            ];
            forces_n[lattice.index(node)] += (magnitude_n * share * weight / total) as f32;
        }
    } else {
        let nearest = lattice.nodes(*first).round();
        let last = lattice.dims.map(|n| (n - 1) as f32);
        let share = shares.iter().flatten().next().copied().unwrap_or(0.0);
        if nearest.cmpge(glam::Vec3::ZERO).all() && nearest.cmple(last.into()).all() {
            forces_n
                [lattice.index([nearest.x as usize, nearest.y as usize, nearest.z as usize])] +=
                (magnitude_n * share) as f32;
        }
    }
}

/// First and last node of a box, clipped to the lattice; the first beyond the last where the box
/// lies outside.
pub(super) fn nodes_within(
    lattice: &Lattice,
    low_map: DVec3,
    high_map: DVec3,
) -> ([usize; 3], [usize; 3]) {
    let nodes = |point: DVec3| (point - lattice.origin_map) / lattice.spacing_m;
    let low = nodes(low_map).ceil().to_array();
    let high = nodes(high_map).floor().to_array();
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

/// Distance of a point from a piece of a curve, and the value there between those at its ends.
fn on_piece(ends: [DVec3; 2], values: [f64; 2], point: DVec3) -> (f64, f64) {
    let way = ends[1] - ends[0];
    let along = if way == DVec3::ZERO {
        0.0
    } else {
        ((point - ends[0]).dot(way) / way.length_squared()).clamp(0.0, 1.0)
    };
    (point.distance(ends[0] + way * along), values[0] + (values[1] - values[0]) * along)
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
        for (force, expected) in
            [(DVec3::Z, 1.0), (-DVec3::Z, -1.0), (DVec3::X, 0.0), (DVec3::new(0.6, 0.0, 0.8), 0.8)]
        {
            let share = mapped_share(&raster, (DVec3::ZERO, 0.0), force, 5e-3);
            assert!((share - expected).abs() < 1e-6, "{force}: {share}");
        }
        assert_eq!(mapped_share(&raster, (DVec3::ZERO, 0.0), DVec3::ZERO, 5e-3), 0.0);
        assert_eq!(mapped_share(&raster, (DVec3::ZERO, 0.0), DVec3::Z, 0.0), 0.0);
    }

    #[test]
    fn what_is_handed_out_is_the_force_whatever_the_curve_and_the_fall_off() {
        let raster = half_space();
        let curve = vec![
            DVec3::new(-0.01, 0.0, 0.0),
            DVec3::new(0.0, 5e-3, 0.0),
            DVec3::new(0.01, 0.0, 0.0),
        ];
        for along in [vec![DVec3::ZERO], curve] {
            for falloff in [
                Falloff::Gaussian,
                Falloff::Constant,
                Falloff::Spherical,
                Falloff::table(vec![0.2, 1.0]).unwrap(),
            ] {
                let mut forces = vec![0.0; raster.values_m().len()];
                add_pull(
                    &raster,
                    &PullForce { falloff: falloff.clone(), ..pull(along.clone(), DVec3::Z * 2.0) },
                    &mut forces,
                );
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
                        assert_eq!(
                            forces[lattice.index([x, y, z])] != 0.0,
                            distance_m < 6e-3,
                            "{x} {y} {z}"
                        );
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

    #[test]
    fn a_rope_along_a_circle_gives_every_node_what_its_distance_from_the_circle_says() {
        const RING_M: f64 = 0.01;
        let raster = half_space();
        // So many corners that the polygon is within 0.2 µm of the circle.
        let on_circle = |n: u32| {
            DVec3::from(core::array::from_fn(|axis| {
                match (axis, f64::from(n) * core::f64::consts::TAU / 640.0) {
                    (0, turn) => RING_M * turn.cos(),
                    (1, turn) => RING_M * turn.sin(),
                    _ => 0.0,
                }
            }))
        };
        let circle: Vec<DVec3> = (0..=640).map(on_circle).collect();
        let mut forces = vec![0.0; raster.values_m().len()];
        let of_circle = PullForce { falloff: Falloff::Spherical, ..pull(circle, DVec3::Z * 3.0) };
        add_pull(&raster, &of_circle, &mut forces);
        let lattice = raster.lattice();
        let weight_at = |at: DVec3| {
            let off_m = (at.truncate().length() - RING_M).hypot(at.z);
            Falloff::Spherical.weight(off_m / of_circle.radius_m)
        };
        let nodes = || (0..41 * 41 * 41).map(|n| [n / (41 * 41), n / 41 % 41, n % 41]);
        let total: f64 = nodes().map(|node| weight_at(lattice.position(node))).sum();
        for node in nodes() {
            let force_n = f64::from(forces[lattice.index(node)]);
            let expected_n = 3.0 * weight_at(lattice.position(node)) / total;
            assert!(
                (force_n - expected_n).abs() < 0.01 * 3.0 / total,
                "{node:?}: {force_n} N, not {expected_n} N"
            );
        }
    }

    #[test]
    fn curves_that_are_pulled_together_share_the_force_and_none_gets_it_twice_where_they_cross() {
        let raster = half_space();
        let curves = [
            vec![DVec3::new(-0.01, 0.0, 0.0), DVec3::new(0.01, 0.0, 0.0)],
            vec![DVec3::new(0.0, -0.01, 0.0), DVec3::new(0.0, 0.01, 0.0)],
        ];
        let mut forces = vec![0.0; raster.values_m().len()];
        let falloff = Falloff::Gaussian;
        let both = CurvesPull {
            curves_map: &curves,
            force_n: DVec3::Z * 2.0,
            reach_m: 5e-3,
            radius_m: 4e-3,
            falloff: &falloff,
            is_free: false,
        };
        add_pull(&raster, both, &mut forces);
        let sum: f64 = forces.iter().map(|force| f64::from(*force)).sum();
        assert!((sum - 2.0).abs() < 1e-4, "{sum}");
        let at = |node: [usize; 3]| forces[raster.lattice().index(node)];
        assert!(
            (at([20, 20, 20]) - at([28, 20, 20])).abs() < 1e-7,
            "the crossing is pulled as the arms are"
        );
        assert!((at([28, 20, 20]) - at([20, 12, 20])).abs() < 1e-7);
        assert_eq!(at([28, 28, 20]), 0.0, "between the arms nothing is pulled");
    }

    #[test]
    fn a_place_below_the_surface_or_above_it_pulls_the_level_that_it_lies_on() {
        let raster = half_space();
        let force_at = |z_m: f64, is_free: bool| {
            let mut forces = vec![0.0; raster.values_m().len()];
            let curves = [vec![DVec3::Z * z_m]];
            let falloff = Falloff::Gaussian;
            let pull = CurvesPull {
                curves_map: &curves,
                force_n: DVec3::Z,
                reach_m: 5e-3,
                radius_m: 4e-3,
                falloff: &falloff,
                is_free,
            };
            add_pull(&raster, pull, &mut forces);
            forces.iter().map(|force| f64::from(*force)).sum::<f64>()
        };
        for z_m in [-8e-3, -2e-3, 0.0, 3e-3] {
            assert!((force_at(z_m, true) - 1.0).abs() < 1e-4, "{z_m} m: {}", force_at(z_m, true));
        }
        // As if on the surface: what lies below it counts as material that the vector enters.
        assert!(force_at(-8e-3, false) < -1.0);
    }
}
