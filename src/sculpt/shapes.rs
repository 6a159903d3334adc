//! Samples of known shapes, for tests.

use glam::DVec3;

use super::PointSet;

const GREY: [u8; 3] = [128; 3];

/// Even samples of a sphere around the origin.
pub(super) fn sphere(n: usize, radius_m: f64) -> PointSet {
    let mut points = PointSet::default();
    for k in 0..n {
        let (z, angle) = (1.0 - (2 * k + 1) as f64 / n as f64, k as f64 * 2.399_963_229_728_653);
        let radius = (1.0 - z * z).sqrt();
        let normal = DVec3::new(radius * angle.cos(), radius * angle.sin(), z).normalize();
        points.push(normal * radius_m, normal, GREY);
    }
    points
}
