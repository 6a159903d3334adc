//! Normals of samples that come without: the plane through the neighbours, turned so that all point
//! out.
//!
//! Cost: linear in the samples but for the sorting of neighbours; 67,038 samples take some tenths
//! of a second.
//!
//! # Source
//! Guo2004, equation 1 (weighted plane fit), and the minimal spanning tree that it names for the
//! orientation.

use glam::{DMat3, DVec3};
use rayon::prelude::*;

use super::orient::orient;
use super::{Neighbour, Neighbours, SurfaceError};

/// Neighbours that a plane is fitted to; the tree of the orientation runs along them as well.
const NEIGHBOURS: usize = 16;
/// Nearest others whose mean distance is the spacing.
const RING: usize = 6;
/// Neighbours whose extent across is this small a share of that along are a line: squared, as
/// eigenvalues are.
const LINE: f64 = 1e-6;

/// Unit normals out of the material, from positions alone. Where closed surfaces lie inside each
/// other, the material is between them.
///
/// # Errors
/// [`SurfaceError::TooFew`], [`SurfaceError::NonFinite`], [`SurfaceError::Lines`].
pub(super) fn estimate(positions_map: &[DVec3]) -> Result<Vec<DVec3>, SurfaceError> {
    let found = positions_map.len();
    if found < super::PointSet::LEAST {
        return Err(SurfaceError::TooFew { found });
    }
    if let Some(sample) = positions_map.iter().position(|at| !at.is_finite()) {
        return Err(SurfaceError::NonFinite { sample, position_map: positions_map[sample] });
    }
    let near = Neighbours::new(positions_map);
    let around: Vec<Vec<Neighbour>> = positions_map
        .par_iter()
        .map(|at| {
            let mut found = Vec::with_capacity(NEIGHBOURS);
            near.nearest_n(*at, NEIGHBOURS, &mut found);
            found
        })
        .collect();
    let planes: Vec<FittedPlane> =
        around.par_iter().map(|found| FittedPlane::through(positions_map, found)).collect();
    let lines = planes.iter().filter(|plane| plane.is_line).count();
    if 2 * lines > found {
        return Err(SurfaceError::Lines { samples: lines, of: found });
    }
    let normals = planes.iter().map(|plane| plane.normal).collect();
    let spacings_m: Vec<f64> = planes.iter().map(|plane| plane.spacing_m).collect();
    Ok(orient(positions_map, normals, &spacings_m, &around))
}

struct FittedPlane {
    normal: DVec3,
    spacing_m: f64,
    is_line: bool,
}

impl FittedPlane {
    /// Equation 1 for the first of `found`.
    fn through(positions_map: &[DVec3], found: &[Neighbour]) -> Self {
        let ring = found.iter().filter(|other| other.distance_squared_m2 > 0.0).take(RING);
        let distances = ring.map(|other| other.distance_squared_m2.sqrt());
        let spacing_m = distances.clone().sum::<f64>() / distances.count().max(1) as f64;
        let weight = |other: &Neighbour| {
            // A spacing of zero: all are at one place, and any plane will do.
            (-other.distance_squared_m2 / (spacing_m * spacing_m).max(f64::MIN_POSITIVE)).exp()
        };
        // Sums about a sample, not about the far origin.
        let origin_map =
            found.first().map_or(DVec3::ZERO, |first| positions_map[first.sample as usize]);
        let at = |other: &Neighbour| positions_map[other.sample as usize] - origin_map;
        let total: f64 = found.iter().map(weight).sum();
        let center = found.iter().map(|other| at(other) * weight(other)).sum::<DVec3>() / total;
        let mut covariance = DMat3::ZERO;
        for other in found {
            let way = (at(other) - center) / spacing_m.max(f64::MIN_POSITIVE);
            let weighted = way * weight(other);
            covariance += DMat3::from_cols(weighted * way.x, weighted * way.y, weighted * way.z);
        }
        let (values, vectors) = eigen(covariance);
        let mut order = [0, 1, 2];
        order.sort_unstable_by(|a, b| values[*a].total_cmp(&values[*b]));
        let is_line = values[order[1]] <= LINE * values[order[2]];
        Self { normal: vectors.col(order[0]).normalize_or(DVec3::Z), spacing_m, is_line }
    }
}

/// Eigenvalues and unit eigenvectors, as columns, of a symmetric matrix: rotations that remove one
/// off-diagonal entry after the other (Jacobi).
fn eigen(mut matrix: DMat3) -> (DVec3, DMat3) {
    let mut vectors = DMat3::IDENTITY;
    // Three or four rounds are enough.
    for _ in 0..10 {
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            let off = matrix.col(q)[p];
            if off.abs() <= f64::EPSILON * 1e-3 * (matrix.col(p)[p].abs() + matrix.col(q)[q].abs())
            {
                continue;
            }
            let theta = (matrix.col(q)[q] - matrix.col(p)[p]) / (2.0 * off);
            let tangent = theta.signum() / (theta.abs() + theta.hypot(1.0));
            let cosine = tangent.hypot(1.0).recip();
            let sine = tangent * cosine;
            let mut turn = DMat3::IDENTITY;
            turn.col_mut(p)[p] = cosine;
            turn.col_mut(q)[q] = cosine;
            turn.col_mut(q)[p] = sine;
            turn.col_mut(p)[q] = -sine;
            matrix = turn.transpose() * matrix * turn;
            vectors *= turn;
        }
    }
    (DVec3::new(matrix.x_axis.x, matrix.y_axis.y, matrix.z_axis.z), vectors)
}

#[cfg(test)]
mod tests {
    use super::super::sample;
    use super::super::shapes::{cube, shell_between, sphere, torus};
    use super::*;
    use vps::mesh::primitives::Shape;

    /// Share of estimated normals that point out, and the mean angle to the right ones, degrees.
    fn compare(set: &super::super::PointSet) -> (f64, f64) {
        let normals = estimate(&set.positions_map).unwrap();
        let angles: Vec<f64> =
            normals.iter().zip(&set.normals_map).map(|(a, b)| a.angle_between(*b)).collect();
        let out = angles.iter().filter(|angle| **angle < std::f64::consts::FRAC_PI_2).count();
        (
            out as f64 / angles.len() as f64,
            angles.iter().sum::<f64>().to_degrees() / angles.len() as f64,
        )
    }

    #[test]
    fn normals_point_out_of_ball_ring_and_box() {
        for (name, set, most_degrees) in [
            ("sphere", sphere(2000, 0.05), 1.0),
            ("torus", torus(6000, 0.05, 0.02), 1.0),
            ("cube", cube(30, 0.1), 6.0),
        ] {
            let (out, angle) = compare(&set);
            assert_eq!(out, 1.0, "{name}");
            assert!(angle < most_degrees, "{name}: {angle}°");
        }
    }

    #[test]
    fn walls_of_a_hollow_ball_point_away_from_their_material_and_two_balls_both_out() {
        assert_eq!(compare(&shell_between(3000, 0.05, 0.03)).0, 1.0);
        let mut two = sphere(1500, 0.02);
        let mut other = sphere(1500, 0.02);
        other.positions_map.iter_mut().for_each(|at| at.x += 0.05);
        two.append(&other);
        assert_eq!(compare(&two).0, 1.0);
    }

    #[test]
    fn a_thin_plate_has_two_sides() {
        // Thinner than twice the spacing: neighbours are on the other side as well.
        let size_m = DVec3::new(0.1, 0.1, 0.004);
        let plate = sample(&Shape::Box { size_m }.tessellate(1e-3), 0.0025).unwrap();
        let inner = |at: &DVec3| at.x.abs() < 0.045 && at.y.abs() < 0.045;
        let normals = estimate(&plate.positions_map).unwrap();
        let checked = plate.positions_map.iter().zip(&normals).filter(|(at, _)| inner(at));
        assert!(checked.clone().count() > 1000);
        for (at, normal) in checked {
            assert!(normal.z * at.z.signum() > 0.9, "{at} {normal}");
        }
    }

    #[test]
    fn eigenvectors_diagonalise() {
        let matrix = DMat3::from_cols_array(&[4.0, 1.0, -2.0, 1.0, 3.0, 0.5, -2.0, 0.5, 1.0]);
        let (values, vectors) = eigen(matrix);
        let again = vectors * DMat3::from_diagonal(values) * vectors.transpose();
        assert!((again - matrix).to_cols_array().iter().all(|entry| entry.abs() < 1e-12));
        assert!(
            (vectors * vectors.transpose() - DMat3::IDENTITY)
                .to_cols_array()
                .iter()
                .all(|entry| entry.abs() < 1e-12)
        );
    }

    #[test]
    fn points_without_a_surface_are_refused() {
        let line: Vec<DVec3> =
            (0..100).map(|k| DVec3::new(f64::from(k), 2.0, -f64::from(k))).collect();
        assert_eq!(estimate(&line), Err(SurfaceError::Lines { samples: 100, of: 100 }));
        assert_eq!(estimate(&line[..3]), Err(SurfaceError::TooFew { found: 3 }));
        assert_eq!(
            estimate(&[DVec3::ONE; 50]).unwrap_err(),
            SurfaceError::Lines { samples: 50, of: 50 }
        );
        let mut broken = line;
        broken[7].y = f64::NAN;
        assert!(matches!(estimate(&broken), Err(SurfaceError::NonFinite { sample: 7, .. })));
    }
}
