//! Samples of a field, interpolated in other ways than the tick does, to see what each would cure.
//!
//! | way | of what degree | samples it reads |
//! |---|---|---:|
//! | [`Interpolation::Linear`] | trilinear through exact samples | 8 |
//! | [`Interpolation::Fitted`] | trilinear through samples that are moved by a twelfth of their second differences, as in the tick | 8 |
//! | [`Interpolation::Cubic`] | cubic through the samples, without kinks | 64 |
//!
//! Linear interpolation through samples of a function f errs by h²/2 · Σ t (1 − t) f'', always to
//! one side where the surface bends to one side: the mean over a cell is h²/12 · Δf. Moved by that,
//! the samples make a field whose mean is right, and which is exact over a plane as before.
//!
//! # Source
//! Condat, Blu and Unser 2005, "Beyond interpolation: optimal reconstruction by
//! quasi-interpolation" (the moved samples); Keys 1981, "Cubic convolution interpolation for
//! digital image processing".

use glam::{DVec3, Vec3};

use vps::voxmap::field::Field;
use vps::voxmap::grid::BRICK_EDGE;

/// How a value comes from the samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Interpolation {
    Linear,
    Fitted,
    Cubic,
}

/// The samples of a field, dense.
pub(super) struct Lattice {
    dims: [i32; 3],
    origin: DVec3,
    voxel_size_m: f64,
    outside_m: f64,
    samples: Vec<f32>,
    fitted: Vec<f32>,
}

/// Beyond so many voxels from the surface samples are not moved: what is there pushes nothing.
const FITTED_VOXELS: f32 = 3.0;

impl Lattice {
    pub(super) fn new(field: &Field) -> Self {
        let dims = field.brick_dims().map(|n| (n * BRICK_EDGE) as i32);
        let cells = || {
            let [nx, ny, nz] = dims;
            (0..nx).flat_map(move |x| (0..ny).flat_map(move |y| (0..nz).map(move |z| [x, y, z])))
        };
        let center = |cell: [i32; 3]| Vec3::from_array(cell.map(|n| n as f32 + 0.5));
        let samples = cells().map(|cell| field.distance(center(cell)).0).collect();
        let lattice = Self {
            dims,
            origin: field.origin_map().as_dvec3(),
            voxel_size_m: f64::from(field.voxel_size_m()),
            outside_m: f64::from(field.outside_m()),
            samples,
            fitted: Vec::new(),
        };
        let fitted = cells().map(|cell| lattice.moved(cell)).collect();
        Self { fitted, ..lattice }
    }

    fn sample(&self, samples: &[f32], cell: [i32; 3]) -> f64 {
        let [nx, ny, nz] = self.dims;
        let [x, y, z] = cell;
        let is_inside = (0..nx).contains(&x) && (0..ny).contains(&y) && (0..nz).contains(&z);
        if is_inside {
            f64::from(samples[((x * ny + y) * nz + z) as usize])
        } else {
            self.outside_m
        }
    }

    fn moved(&self, cell: [i32; 3]) -> f32 {
        let here = self.sample(&self.samples, cell);
        if here.abs() > f64::from(FITTED_VOXELS) * self.voxel_size_m {
            return here as f32;
        }
        let beside = |axis: usize, by: i32| {
            let mut cell = cell;
            cell[axis] += by;
            self.sample(&self.samples, cell)
        };
        let second: f64 = (0..3).map(|axis| beside(axis, 1) + beside(axis, -1) - 2.0 * here).sum();
        (here - second / 12.0) as f32
    }

    /// Depth at a point of the map frame, m, and its gradient, m/m.
    pub(super) fn at(&self, way: Interpolation, point: DVec3) -> (f64, DVec3) {
        let cells = (point - self.origin) / self.voxel_size_m - 0.5;
        let base = cells.floor();
        let base_cell = base.to_array().map(|n| n as i32 - 1);
        let weights = (cells - base).to_array().map(|t| match way {
            Interpolation::Linear | Interpolation::Fitted => {
                [[0.0, 1.0 - t, t, 0.0], [0.0, -1.0, 1.0, 0.0]]
            }
            Interpolation::Cubic => {
                let squared = t * t;
                let cubed = t * t * t;
                [
                    [
                        0.5 * (2.0 * squared - t - cubed),
                        1.0 - 2.5 * squared + 1.5 * cubed,
                        0.5 * t + 2.0 * squared - 1.5 * cubed,
                        0.5 * (cubed - squared),
                    ],
                    [
                        2.0 * t - 0.5 - 1.5 * squared,
                        4.5 * squared - 5.0 * t,
                        0.5 + 4.0 * t - 4.5 * squared,
                        1.5 * squared - t,
                    ],
                ]
            }
        });
        let samples = if way == Interpolation::Fitted { &self.fitted } else { &self.samples };
        let [[wx, dx], [wy, dy], [wz, dz]] = weights;
        let mut value = 0.0;
        let mut gradient = DVec3::ZERO;
        let reads = if way == Interpolation::Cubic { 0..4 } else { 1..3 };
        for (i, j, k) in reads
            .clone()
            .flat_map(|i| reads.clone().flat_map(move |j| (0..4).map(move |k| (i, j, k))))
        {
            if !reads.contains(&k) {
                continue;
            }
            let sample = self.sample(
                samples,
                [base_cell[0] + i as i32, base_cell[1] + j as i32, base_cell[2] + k as i32],
            );
            value += sample * wx[i] * wy[j] * wz[k];
            gradient += sample
                * DVec3::new(dx[i] * wy[j] * wz[k], wx[i] * dy[j] * wz[k], wx[i] * wy[j] * dz[k]);
        }
        (value, gradient / self.voxel_size_m)
    }
}

/// Mean of the immersed depths of a facet that is so deep in the middle and reaches so much farther
/// on both sides, m: what a point counts of its facet where the surface cuts it.
pub(super) fn spread(depth_m: f64, reach_m: f64) -> f64 {
    if depth_m.abs() >= reach_m {
        depth_m.max(0.0)
    } else {
        (depth_m + reach_m).powi(2) / (4.0 * reach_m)
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixture;
    use super::*;
    use vps::mesh::primitives::Shape;

    #[test]
    fn all_are_exact_over_a_plane_and_moved_samples_and_cubes_are_nearly_so_over_a_ball() {
        const R: f64 = 8e-3;
        let field = |shape: Shape| {
            fixture::obstacle("part", &shape.tessellate(1e-6), 5e-4, false)
                .expect("a grid that fits")
                .field
        };
        let slab = Lattice::new(&field(Shape::Plane { x_m: 0.02, y_m: 0.02, thickness_m: 6e-3 }));
        let ball = Lattice::new(&field(Shape::Sphere { radius_m: R }));
        let error_m = |way: Interpolation| {
            let mut sum_m = 0.0;
            let mut n = 0.0;
            for step in 0..200 {
                let angle = 0.31 * f64::from(step);
                let out = DVec3::new(angle.cos(), angle.sin(), (0.17 * f64::from(step)).sin())
                    .normalize();
                let (depth_m, gradient) =
                    slab.at(way, DVec3::new(3e-3 * out.x, 3e-3 * out.y, -2e-4));
                assert!(
                    (depth_m - 2e-4).abs() < 1e-9 && (gradient + DVec3::Z).length() < 1e-5,
                    "{way:?}: {depth_m} {gradient}"
                );
                let (depth_m, gradient) = ball.at(way, out * (R - 1e-4));
                assert!((gradient + out).length() < 0.1, "{way:?}: {gradient} {out}");
                sum_m += depth_m - 1e-4;
                n += 1.0;
            }
            sum_m / n
        };
        let [linear, fitted, cubic] =
            [Interpolation::Linear, Interpolation::Fitted, Interpolation::Cubic].map(error_m);
        // h²/12 · 2/R.
        assert!((linear + 5.2e-6).abs() < 1e-6, "{linear}");
        assert!(
            fitted.abs() < 0.1 * linear.abs() && cubic.abs() < 0.1 * linear.abs(),
            "{fitted} {cubic}"
        );
    }

    #[test]
    fn a_spread_point_counts_what_is_immersed_of_its_facet() {
        for depth_m in [-1.2, -0.9, -0.3, 0.0, 0.4, 0.99, 1.5] {
            let n = 10_000;
            let mean: f64 = (0..n)
                .map(|k| (depth_m + 2.0 * (f64::from(k) + 0.5) / f64::from(n) - 1.0).max(0.0))
                .sum::<f64>()
                / f64::from(n);
            assert!((spread(depth_m, 1.0) - mean).abs() < 1e-4, "{depth_m}");
            assert!((spread(depth_m, 0.0) - depth_m.max(0.0)).abs() == 0.0);
        }
    }
}
