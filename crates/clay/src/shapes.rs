//! Samples of known shapes, for tests.

use std::f64::consts::TAU;

use glam::DVec3;

use super::PointSet;

const GREY: [u8; 3] = [128; 3];
/// Turns so far from one sample of a spiral to the next that none comes near the ones before.
const GOLDEN: f64 = 0.381_966_011_250_105;

/// Even samples of a sphere around the origin.
pub(super) fn sphere(n: usize, radius_m: f64) -> PointSet {
    let mut points = PointSet::default();
    for k in 0..n {
        let z = 1.0 - (2 * k + 1) as f64 / n as f64;
        let angle = k as f64 * GOLDEN * TAU;
        let radius = (1.0 - z * z).sqrt();
        let normal = DVec3::new(radius * angle.cos(), radius * angle.sin(), z).normalize();
        points.push(normal * radius_m, normal, GREY);
    }
    points
}

/// A ball with a hollow: both walls.
pub(super) fn shell_between(n: usize, outer_m: f64, inner_m: f64) -> PointSet {
    let mut points = sphere(n, outer_m);
    let mut inner = sphere(n / 2, inner_m);
    inner.normals_map.iter_mut().for_each(|normal| *normal = -*normal);
    points.append(&inner);
    points
}

/// About `n` samples of a torus around z.
pub(super) fn torus(n: usize, major_m: f64, minor_m: f64) -> PointSet {
    let mut points = PointSet::default();
    let around = (n as f64 * major_m / minor_m).sqrt() as usize;
    for k in 0..around {
        let (sin, cos) = (TAU * k as f64 / around as f64).sin_cos();
        let out = DVec3::new(cos, sin, 0.0);
        let n_ring = n / around;
        for j in 0..n_ring {
            let (up, away) = (TAU * (j as f64 + 0.5 * (k % 2) as f64) / n_ring as f64).sin_cos();
            let normal = out * away + DVec3::Z * up;
            points.push(out * major_m + normal * minor_m, normal, GREY);
        }
    }
    points
}

/// `n` × `n` samples on each face of a cube around the origin, none on an edge.
pub(super) fn cube(n: usize, edge_m: f64) -> PointSet {
    let mut points = PointSet::default();
    for (normal, u, v) in [
        (DVec3::X, DVec3::Y, DVec3::Z),
        (DVec3::Y, DVec3::Z, DVec3::X),
        (DVec3::Z, DVec3::X, DVec3::Y),
    ] {
        for normal in [normal, -normal] {
            for k in 0..n * n {
                let at = |k: usize| ((k as f64 + 0.5) / n as f64 - 0.5) * edge_m;
                points.push(normal * (0.5 * edge_m) + u * at(k / n) + v * at(k % n), normal, GREY);
            }
        }
    }
    points
}
