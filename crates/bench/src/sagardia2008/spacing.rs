//! How far each point of a pointshell is from its nearest neighbour, in voxels.

use glam::DVec3;

use super::super::statistics::quantile;
use vps::pointshell::project::SurfacePoint;
use vps::voxmap::surface::Surface;

/// Shares of the points up to which [`Spacing::voxels`] says the distance; the ends are the least
/// and the largest.
pub const SHARES: [f64; 7] = [0.0, 0.01, 0.1, 0.5, 0.9, 0.99, 1.0];
/// Points nearer than this to another one, voxels, describe the same place twice.
const SAME_PLACE: f64 = 0.1;
/// A point is no farther from the centre of its voxel than a corner is.
const REACH: f64 = 0.866_025_403_784_438_7;
/// Voxels to look around a point for another.
const RINGS_MAX: i32 = 8;

/// Distances to the nearest neighbour.
#[derive(Clone, Copy, Debug, Default)]
pub struct Spacing {
    /// At each of [`SHARES`].
    pub voxels: [f64; SHARES.len()],
    /// Share of the points that are less than a tenth of a voxel from another.
    pub same_place_share: f64,
}

impl Spacing {
    /// Of points in order of rank.
    pub(super) fn of(surface: &Surface, points: &[SurfacePoint]) -> Self {
        let mut distances: Vec<f64> =
            points.iter().map(|point| nearest(surface, points, point)).collect();
        distances.sort_by(f64::total_cmp);
        let n_same = distances.partition_point(|distance| *distance < SAME_PLACE);
        Self {
            voxels: SHARES.map(|share| quantile(&distances, share).unwrap_or(f64::NAN)),
            same_place_share: n_same as f64 / distances.len().max(1) as f64,
        }
    }

    /// Half the points have a neighbour within so many voxels.
    pub fn median(&self) -> f64 {
        self.voxels[SHARES.len() / 2]
    }

    /// Of the loneliest point.
    pub fn largest(&self) -> f64 {
        self.voxels[SHARES.len() - 1]
    }
}

/// Distance of a point to the nearest other one, voxels; infinite where there is none around.
fn nearest(surface: &Surface, points: &[SurfacePoint], of: &SurfacePoint) -> f64 {
    let mut best = f64::INFINITY;
    for ring in 1..=RINGS_MAX {
        let mut look = |step: [i32; 3]| {
            let cell = [0, 1, 2].map(|axis| of.cell[axis] + step[axis]);
            if let Some(rank) = surface.rank(cell) {
                best = best.min(DVec3::distance(points[rank].cells, of.cells));
            }
        };
        let edge = -ring..=ring;
        for x in edge.clone() {
            for y in edge.clone() {
                let is_face = x.abs() == ring || y.abs() == ring;
                // Inside of the ring the cells have been looked at.
                let step = if is_face { 1 } else { 2 * ring };
                edge.clone().step_by(step as usize).for_each(|z| look([x, y, z]));
            }
        }
        // Points of cells farther out have at least this distance.
        if best <= f64::from(ring + 1) - 2.0 * REACH {
            break;
        }
    }
    best
}

#[cfg(test)]
mod tests {
    use super::*;
    use vps::mesh::primitives::Shape;
    use vps::pointshell::project::project;
    use vps::voxmap::grid::Grid;
    use vps::voxmap::surface::Navigation;

    #[test]
    fn the_nearest_is_that_of_a_search_over_all_points() {
        let mesh = Shape::Torus { major_m: 0.02, minor_m: 0.006 }.tessellate(1e-4);
        let (low, high) = mesh.bounds().unwrap();
        let surface =
            Surface::mark(&mesh, &Grid::around(low, high, 1.7e-3, 1).unwrap(), Navigation::AUTO);
        let points = project(&mesh, &surface);
        let spacing = Spacing::of(&surface, &points);
        let searched: Vec<f64> = (0..points.len())
            .map(|own| {
                let others = (0..points.len()).filter(|other| *other != own);
                others
                    .map(|other| points[other].cells.distance(points[own].cells))
                    .fold(f64::INFINITY, f64::min)
            })
            .collect();
        for (point, searched) in points.iter().zip(&searched) {
            assert_eq!(nearest(&surface, &points, point), *searched);
        }
        assert_eq!(spacing.largest(), searched.iter().copied().fold(0.0, f64::max));
        assert!(
            spacing.voxels.is_sorted()
                && spacing.voxels[0] < spacing.median()
                && spacing.median() < spacing.largest()
        );
    }
}
