//! Densities made distances again, without moving the surface.
//!
//! A stroke leaves densities that are steep here and flat there. At its end they become distances:
//! nodes beside the surface keep what the crossings on their edges say, the others follow from them
//! (|∇s| = 1, first-order upwind differences, swept in eight directions).
//!
//! # Source
//! Zhao 2005 (fast sweeping); Sethian 1999 (distances beside the front). The paper leaves its
//! densities as they are.

use vps::density::Raster;

/// Rounds of eight sweeps at most; one is enough for straight ways out, each turn of a way takes
/// one more.
const ROUNDS: u32 = 3;

/// Makes distances of densities, m. The outermost nodes and the zero crossings stay. Cost:
/// O(nodes), on one thread.
pub(super) fn redistance(raster: &mut Raster) {
    let [nx, ny, nz] = raster.lattice().dims;
    let spacing_m = raster.lattice().spacing_m as f32;
    let strides = [ny * nz, nz, 1];
    let before: Vec<f32> = raster.values_m().to_vec();
    let is_outermost = |[x, y, z]: [usize; 3]| {
        x == 0 || y == 0 || z == 0 || x + 1 == nx || y + 1 == ny || z + 1 == nz
    };
    let mut is_fixed = vec![false; before.len()];
    // Magnitudes; the sign stays that of the density.
    let mut away: Vec<f32> = vec![f32::INFINITY; before.len()];
    for x in 0..nx {
        for y in 0..ny {
            for z in 0..nz {
                let node = (x * ny + y) * nz + z;
                if is_outermost([x, y, z]) {
                    (is_fixed[node], away[node]) = (true, before[node].abs());
                } else if let Some(distance) = beside_surface(&before, node, strides, spacing_m) {
                    (is_fixed[node], away[node]) = (true, distance);
                }
            }
        }
    }
    for _ in 0..ROUNDS {
        let mut change: f32 = 0.0;
        for sweep in 0..8 {
            let turned = |n: usize, len: usize, bit: u32| {
                if sweep >> bit & 1 == 1 { len - 1 - n } else { n }
            };
            for x in (1..nx.saturating_sub(1)).map(|x| turned(x, nx, 0)) {
                for y in (1..ny.saturating_sub(1)).map(|y| turned(y, ny, 1)) {
                    for z in (1..nz.saturating_sub(1)).map(|z| turned(z, nz, 2)) {
                        let node = (x * ny + y) * nz + z;
                        if is_fixed[node] {
                            continue;
                        }
                        let distance = upwind(&away, node, strides, spacing_m);
                        if distance < away[node] {
                            change = change.max(if away[node].is_finite() {
                                away[node] - distance
                            } else {
                                f32::INFINITY
                            });
                            away[node] = distance;
                        }
                    }
                }
            }
        }
        if change < 1e-4 * spacing_m {
            break;
        }
    }
    for ((value, away), before) in raster.values_m_mut().iter_mut().zip(&away).zip(&before) {
        if away.is_finite() {
            *value = away.copysign(*before);
        }
    }
}

/// Distance of a node from the surface, from where it crosses the edges to its neighbours; `None`
/// where it crosses none.
fn beside_surface(
    densities: &[f32],
    node: usize,
    strides: [usize; 3],
    spacing_m: f32,
) -> Option<f32> {
    let own = densities[node];
    let mut inverse_squares = 0.0;
    for stride in strides {
        let crossing = |other: f32| {
            ((own < 0.0) != (other < 0.0))
                .then(|| spacing_m * own.abs() / (own.abs() + other.abs()))
        };
        let low = crossing(densities[node - stride]);
        let high = crossing(densities[node + stride]);
        if let Some(nearer) = low.into_iter().chain(high).reduce(f32::min) {
            // A node on the surface: a crossing of zero.
            if nearer <= 0.0 {
                return Some(0.0);
            }
            inverse_squares += 1.0 / (nearer * nearer);
        }
    }
    (inverse_squares > 0.0).then(|| 1.0 / inverse_squares.sqrt())
}

/// The root of Σ max(u − a, 0)² = h² over the nearer neighbours a of each axis.
fn upwind(away: &[f32], node: usize, strides: [usize; 3], spacing_m: f32) -> f32 {
    let mut nearer = strides.map(|stride| away[node - stride].min(away[node + stride]));
    nearer.sort_unstable_by(f32::total_cmp);
    let [a, b, c] = nearer;
    let mut distance = a + spacing_m;
    if distance > b {
        let gap = b - a;
        distance = 0.5 * (a + b + (2.0 * spacing_m * spacing_m - gap * gap).max(0.0).sqrt());
    }
    if distance > c {
        let sum = a + b + c;
        let squares = a * a + b * b + c * c;
        distance =
            (sum + (sum * sum - 3.0 * (squares - spacing_m * spacing_m)).max(0.0).sqrt()) / 3.0;
    }
    distance
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use vps::density::Lattice;

    const SPACING_M: f64 = 1e-3;

    fn raster(density: impl Fn(DVec3) -> f64) -> Raster {
        let lattice =
            Lattice { origin_map: DVec3::splat(-0.015), spacing_m: SPACING_M, dims: [31; 3] };
        let mut raster = Raster::uniform(lattice, 0.0);
        for x in 0..31 {
            for y in 0..31 {
                for z in 0..31 {
                    raster.values_m_mut()[lattice.index([x, y, z])] =
                        density(lattice.position([x, y, z])) as f32;
                }
            }
        }
        raster
    }

    fn assert_is(raster: &Raster, distance: impl Fn(DVec3) -> f64, within_m: f64) {
        for x in 1..30 {
            for y in 1..30 {
                for z in 1..30 {
                    let at = raster.lattice().position([x, y, z]);
                    let value = f64::from(raster.values_m()[raster.lattice().index([x, y, z])]);
                    assert!(
                        (value - distance(at)).abs() <= within_m,
                        "{at}: {value}, {}",
                        distance(at)
                    );
                }
            }
        }
    }

    #[test]
    fn a_plane_of_any_steepness_becomes_its_distance() {
        let normal = DVec3::new(0.48, 0.6, 0.64);
        for steepness in [0.2, 1.0, 7.0] {
            let plane = |at: DVec3| 2.3e-4 - at.dot(normal);
            // Undeformed at its faces, as regions are.
            let mut made = raster(|at| {
                let inner = ((0.0135 - at.abs().max_element()) / 4e-3).clamp(0.0, 1.0);
                plane(at) * (1.0 + (steepness - 1.0) * inner)
            });
            redistance(&mut made);
            assert_is(&made, plane, 0.5 * SPACING_M);
        }
    }

    #[test]
    fn a_sphere_keeps_its_surface_and_its_sides() {
        let sphere = |at: DVec3| 0.0083 - at.length();
        let bent = |at: DVec3| {
            sphere(at) * (1.0 + 40.0 * at.x) + 300.0 * sphere(at).powi(2).copysign(sphere(at))
        };
        let before = raster(bent);
        let mut made = before.clone();
        redistance(&mut made);
        for (before, after) in before.values_m().iter().zip(made.values_m()) {
            assert!(*before == 0.0 || before.signum() == after.signum());
        }
        // Where the surface crosses a ray.
        for n in 0..200 {
            let z = 1.0 - (2.0 * f64::from(n) + 1.0) / 200.0;
            let turn = f64::from(n) * 2.4;
            let ray =
                DVec3::new((1.0 - z * z).sqrt() * turn.cos(), (1.0 - z * z).sqrt() * turn.sin(), z);
            let off = f64::from(made.at(ray * 0.0083).unwrap().value_m);
            assert!(off.abs() < 0.12 * SPACING_M, "{ray}: {off}");
        }
    }

    #[test]
    fn outermost_nodes_stay_and_a_raster_without_surface_too() {
        let mut air = raster(|_| -1.0);
        let before = air.clone();
        redistance(&mut air);
        let on_faces = |raster: &Raster| raster.values_m()[..31 * 31].to_vec();
        assert_eq!(on_faces(&air), on_faces(&before));
        assert!(air.values_m().iter().all(|value| *value < 0.0));
    }
}
