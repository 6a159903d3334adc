//! Samples of a triangle mesh.

use glam::DVec3;

use super::{Neighbours, PointSet, SurfaceError, WorkMeter};
use vps::mesh::TriangleMesh;

/// Steps of a candidate.
const CANDIDATE_STEPS: u64 = 4;
/// Candidates for each sample that stays.
const CANDIDATES: f64 = 8.0;
/// Least distance of samples over the spacing: with it so many of the candidates stay that each has
/// spacing² of the area.
const LEAST_DISTANCE: f64 = 0.76;
/// Samples above which a spacing is refused.
pub(super) const MOST_SAMPLES: f64 = 4e6;
/// Colour of what has none.
pub(super) const GREY: [u8; 3] = [190, 190, 190];

/// Samples a mesh at about `spacing_m` with the normals of its faces, evenly and without a pattern
/// (blue noise). Every sample has about spacing² of the area. The same mesh gives the same samples.
///
/// # Errors
/// [`SurfaceError::Spacing`] for a spacing that is not above zero, or makes more than four million
/// samples.
pub fn sample(mesh: &TriangleMesh, spacing_m: f64) -> Result<PointSet, SurfaceError> {
    sample_within(mesh, spacing_m, &WorkMeter::unlimited())
}

/// The same, with steps from a meter.
pub(super) fn sample_within(
    mesh: &TriangleMesh,
    spacing_m: f64,
    meter: &WorkMeter,
) -> Result<PointSet, SurfaceError> {
    let area_of = |[a, b, c]: [DVec3; 3]| 0.5 * (b - a).cross(c - a).length();
    let areas_m2: Vec<f64> =
        (0..mesh.triangles.len()).map(|triangle| area_of(mesh.corners(triangle))).collect();
    let density = CANDIDATES / (spacing_m * spacing_m);
    let area_m2: f64 = areas_m2.iter().sum();
    let n_samples = area_m2 / (spacing_m * spacing_m);
    if !(spacing_m > 0.0 && n_samples <= MOST_SAMPLES) {
        // Rounded up: what is proposed is accepted.
        let least_m = 1.001 * (area_m2 / MOST_SAMPLES).sqrt();
        let across_m = mesh.bounds().map_or(0.0, |(low, high)| (high - low).max_element());
        return Err(SurfaceError::Spacing { across_m, spacing_m, least_m });
    }

    meter.take(mesh.triangles.len() as u64 + steps_of(n_samples as u64) / 2)?;
    // A sequence that fills a square evenly, cut into pieces, one for each triangle.
    let mut candidates = PointSet::default();
    let mut covered = 0.0;
    for (triangle, area_m2) in areas_m2.iter().enumerate() {
        covered += area_m2 * density;
        let [a, b, c] = mesh.corners(triangle);
        let Some(normal) = (b - a).cross(c - a).try_normalize() else {
            continue;
        };
        while (candidates.len() as f64) < covered {
            let number = candidates.len() as f64 + 1.0;
            let u = (number * 0.754_877_666_246_692_8).fract();
            let v = (number * 0.569_840_290_998_053_3).fract();
            let (u, v) = if u + v > 1.0 { (1.0 - u, 1.0 - v) } else { (u, v) };
            candidates.push(a + (b - a) * u + (c - a) * v, normal, GREY);
        }
    }

    // In an order without a pattern, each takes the place of those that are too near on its side.
    let mut order: Vec<u32> = (0..candidates.len() as u32).collect();
    order.sort_unstable_by_key(|candidate| (scramble(*candidate), *candidate));
    let near = Neighbours::new(&candidates.positions_map);
    let mut is_free = vec![true; candidates.len()];
    let mut found = Vec::new();
    let mut kept = Vec::new();
    for candidate in order {
        if !is_free[candidate as usize] {
            continue;
        }
        kept.push(candidate);
        let normal = candidates.normals_map[candidate as usize];
        near.within(
            candidates.positions_map[candidate as usize],
            LEAST_DISTANCE * spacing_m,
            &mut found,
        );
        meter.take(found.len() as u64)?;
        for other in &found {
            // The far side of a thin wall keeps its own.
            if candidates.normals_map[other.sample as usize].dot(normal) > -0.5 {
                is_free[other.sample as usize] = false;
            }
        }
    }
    kept.sort_unstable();
    Ok(candidates.select(kept.into_iter()))
}

/// Steps for so many samples of a mesh.
pub(super) fn steps_of(n_samples: u64) -> u64 {
    n_samples.saturating_mul(2 * CANDIDATE_STEPS * CANDIDATES as u64)
}

/// The bits of a number, well mixed (the finalizer of MurmurHash3).
fn scramble(number: u32) -> u32 {
    let mut bits = number ^ 0x9e37_79b9;
    bits = (bits ^ (bits >> 16)).wrapping_mul(0x85eb_ca6b);
    bits = (bits ^ (bits >> 13)).wrapping_mul(0xc2b2_ae35);
    bits ^ (bits >> 16)
}

#[cfg(test)]
mod tests {
    use super::*;
    use vps::mesh::primitives::Shape;

    #[test]
    fn samples_lie_on_the_faces_evenly() {
        let size_m = DVec3::new(0.1, 0.08, 0.004);
        let mesh = Shape::Box { size_m }.tessellate(1e-3);
        let spacing_m = 0.002;
        let samples = sample(&mesh, spacing_m).unwrap();
        let area_m2 = 2.0 * (size_m.x * size_m.y + size_m.y * size_m.z + size_m.z * size_m.x);
        let n_expected = area_m2 / (spacing_m * spacing_m);
        assert!(
            (samples.len() as f64 / n_expected - 1.0).abs() < 0.1,
            "{} of {n_expected}",
            samples.len()
        );
        let near = Neighbours::new(&samples.positions_map);
        let mut found = Vec::new();
        for (at, normal) in samples.positions_map.iter().zip(&samples.normals_map) {
            let out = (at * 2.0 / size_m).dot(*normal);
            assert!((out - 1.0).abs() < 1e-12, "{at} {normal}");
            near.nearest_n(*at, 2, &mut found);
            assert!(found[1].distance_squared_m2.sqrt() >= LEAST_DISTANCE * spacing_m);
        }
        // No place is without.
        for k in 0..2000 {
            let at = DVec3::new(
                ((f64::from(k) * 0.7548).fract() - 0.5) * 0.1,
                ((f64::from(k) * 0.5698).fract() - 0.5) * 0.08,
                0.002,
            );
            let nearest = near.nearest(at).unwrap();
            assert!(nearest.distance_squared_m2.sqrt() < spacing_m, "{at}");
        }
        assert_eq!(samples, sample(&mesh, spacing_m).unwrap());
    }

    #[test]
    fn spacings_that_make_no_or_too_many_samples_are_refused() {
        let mesh = Shape::Sphere { radius_m: 0.05 }.tessellate(1e-3);
        for spacing_m in [0.0, -1.0, f64::NAN, 1e-6] {
            let error = sample(&mesh, spacing_m).unwrap_err();
            assert!(
                matches!(error, SurfaceError::Spacing { least_m, .. } if least_m > 5e-5 && least_m < 1e-4),
                "{error}"
            );
        }
    }
}
