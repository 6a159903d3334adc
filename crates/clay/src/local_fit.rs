//! The field around one sample: a quadratic B-spline over a cube.
//!
//! Sign: greater than 0 inside. Cost: a fit to 24 neighbours takes some ten microseconds, a look-up
//! some tens of nanoseconds.
//!
//! # Source
//! Guo2004, equation 2 and the weighted fit behind it, with one point outside and one inside for
//! every neighbour; equation 5. Ours: the spline is fitted as the tangent plane and a correction to
//! it, and a ridge keeps the correction small where neighbours do not decide, the more so the
//! higher its degree and the more their normals differ. So a plane is reproduced whatever the
//! neighbours are, no fit is singular, and none swings out at a sharp edge.

use glam::DVec3;

use super::least_squares::Constraints;
use super::spline::{self, Cube, GRID};

/// How strongly each product of coordinates is kept small: hardly where any three neighbours decide
/// (degrees 0 and 1), a little for curvature (a neighbour at the spacing counts as 1/e, so this
/// moves a curvature by about its ten-thousandth part), and ten times as much with every further
/// degree.
const RIDGE: Cube = {
    const OF_DEGREE: [f64; 7] = [1e-9, 1e-9, 1e-4, 1e-3, 1e-2, 1e-1, 1.0];
    let mut ridge = [0.0; 27];
    let mut place = 0;
    while place < 27 {
        ridge[place] = OF_DEGREE[place / 9 + place / 3 % 3 + place % 3];
        place += 1;
    }
    ridge
};

/// Roughness that doubles the ridge. Curvature that samples resolve well has a hundredth, an edge a
/// third.
const ROUGH: f64 = 0.02;
/// Roughness from which on points off the surface may come close to other neighbours.
const SHARP: f64 = 0.05;
/// Added to squared distances (over those of the spline's knots) where weights grow without bound,
/// so that none is infinite: ten digits and more are then those of the sample's own fit.
const NEAR: f64 = 1e-12;
/// Points off the surface are this much nearer to their own sample than to any other, as a share of
/// distances.
const CLEAR: f64 = 0.9;

/// A sample with its normal, m and unit, map frame.
pub(super) type OrientedPoint = (DVec3, DVec3);

/// Field of one sample, within a cube around it.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct LocalFit {
    /// Where the sample was when the field was fitted, map frame, m: the middle of the cube.
    pub(super) center_map: DVec3,
    /// Half of the cube's edge, m; the field counts within a ball of this radius.
    pub(super) half_m: f64,
    /// Values in m.
    coefficients: Cube,
}

impl LocalFit {
    /// Fits the signed distance to the neighbours of a sample, itself among them, each with the
    /// value that the field is to have there, m: 0 on the surface, more where an image raises it
    /// (Guo2004, embossing and engraving). `spacing_m` is the distance at which samples lie here:
    /// neighbours count as exp(−distance²/spacing²), and have their points outside and inside that
    /// far away, or nearer where those would come close to another neighbour.
    pub(super) fn to_neighbours(
        (center_map, normal_map): OrientedPoint,
        half_m: f64,
        spacing_m: f64,
        mut neighbours: Vec<(OrientedPoint, f64)>,
    ) -> Self {
        // Lengths in spacings, so that coefficients of every degree are of one size.
        for ((at, _), value) in &mut neighbours {
            (*at, *value) = ((*at - center_map) / spacing_m, *value / spacing_m);
        }
        let scaled = neighbours.iter().map(|(neighbour, _)| *neighbour);
        let roughness = roughness(normal_map, scaled.clone());
        let mut constraints = Constraints::new();
        for ((at, normal), value) in neighbours.iter().copied() {
            let weight = (-at.length_squared()).exp();
            for side in [0.0, 1.0, -1.0] {
                let clear = if roughness < SHARP {
                    Some(side)
                } else {
                    clear_offset(at, normal, side, scaled.clone())
                };
                if let Some(offset) = clear {
                    let point = at + normal * offset;
                    // Outside is negative; what the tangent plane says already is taken off.
                    constraints.add(point, value - offset + normal_map.dot(point), weight);
                }
            }
        }
        let stiffer = 1.0 + (roughness / ROUGH).powi(2);
        let mut correction = constraints.solve(&RIDGE.map(|ridge| ridge * stiffer));
        correction[9] -= normal_map.x;
        correction[3] -= normal_map.y;
        correction[1] -= normal_map.z;
        // From products of coordinates, in spacings, to coefficients of the spline, in metres.
        let ratio = half_m / spacing_m;
        let one = 2.0 * ratio;
        let two = ratio * ratio;
        let from_products = [[1.0, -one, 3.0 * two], [1.0, 0.0, -two], [1.0, one, 3.0 * two]];
        let coefficients =
            spline::along_axes(&correction, &from_products).map(|value| value * spacing_m);
        Self { center_map, half_m, coefficients }
    }

    /// The same field with a value added everywhere, m: the functions of the spline sum to one.
    pub(super) fn raised(mut self, by_m: f64) -> Self {
        self.coefficients.iter_mut().for_each(|coefficient| *coefficient += by_m);
        self
    }

    /// The same field raised so that it is 0 at its own sample.
    pub(super) fn meeting_its_sample(self) -> Self {
        let (off_m, _) = self.at(self.center_map);
        self.raised(-off_m)
    }

    /// No field yet.
    pub(super) fn nothing(center_map: DVec3) -> Self {
        Self { center_map, half_m: 0.0, coefficients: [0.0; 27] }
    }

    /// The same cube around a new middle, with the values of a field at its grid; `None` where the
    /// field has none.
    ///
    /// # Source
    /// Guo2004, equation 5.
    pub(super) fn to_field(
        center_map: DVec3,
        half_m: f64,
        field: impl Fn(DVec3) -> Option<f64>,
    ) -> Option<Self> {
        let mut values = [0.0; 27];
        for (place, value) in values.iter_mut().enumerate() {
            let share = DVec3::new(GRID[place / 9], GRID[place / 3 % 3], GRID[place % 3]);
            *value = field(center_map + (share * 2.0 - 1.0) * half_m)?;
        }
        Some(Self { center_map, half_m, coefficients: spline::from_grid(&values) })
    }

    /// Value, m, and gradient, m/m, at a point in or near the cube.
    #[inline]
    pub(super) fn at(&self, point_map: DVec3) -> (f64, DVec3) {
        let scale = 0.5 / self.half_m;
        let (value, slope) =
            spline::at(&self.coefficients, (point_map - self.center_map) * scale + 0.5);
        (value, slope * scale)
    }

    /// The values along a line parallel to z, m, as a polynomial of `z_map − center_map.z`.
    #[inline]
    pub(super) fn along_z(&self, x_map: f64, y_map: f64) -> [f64; 3] {
        let scale = 0.5 / self.half_m;
        let x = spline::basis((x_map - self.center_map.x) * scale + 0.5);
        let y = spline::basis((y_map - self.center_map.y) * scale + 0.5);
        let mut line = [0.0; 3];
        for (row, coefficients) in self.coefficients.chunks_exact(3).enumerate() {
            let share = x[row / 3] * y[row % 3];
            for (sum, coefficient) in line.iter_mut().zip(coefficients) {
                *sum += share * coefficient;
            }
        }
        // About the middle, w = 1/2 + t/2: the three functions are (1 − t)²/8, (3 − t²)/4 and (1 +
        // t)²/8.
        let [low, middle, high] = line;
        let per_m = 2.0 * scale;
        [
            0.125 * (low + 6.0 * middle + high),
            0.25 * (high - low) * per_m,
            0.125 * (low - 2.0 * middle + high) * per_m * per_m,
        ]
    }

    /// How much the field counts at a squared distance from the sample, and the slope of that along
    /// the distance divided by the distance: a quadratic B-spline that ends at the ball in the
    /// cube.
    #[inline]
    pub(super) fn weight(&self, distance_squared_m2: f64) -> (f64, f64) {
        let scale = 1.5 / self.half_m;
        let t_squared = distance_squared_m2 * scale * scale;
        if t_squared <= 0.25 {
            (0.75 - t_squared, -2.0 * scale * scale)
        } else if t_squared < 2.25 {
            let t = t_squared.sqrt();
            let rest = 1.5 - t;
            (0.5 * rest * rest, -rest / t * scale * scale)
        } else {
            (0.0, 0.0)
        }
    }

    /// The same, growing without bound towards the sample: times (1.5 / t)², with t the distance
    /// over that of the spline's knots. As it grows with the square of the distance, the blend of
    /// fits is as smooth at a sample as beside it.
    #[inline]
    pub(super) fn unbounded_weight(&self, distance_squared_m2: f64) -> (f64, f64) {
        let (weight, slope) = self.weight(distance_squared_m2);
        let scale_squared = (1.5 / self.half_m).powi(2);
        let t_squared = distance_squared_m2 * scale_squared + NEAR;
        let share = 2.25 / t_squared;
        (weight * share, (slope - 2.0 * scale_squared * weight / t_squared) * share)
    }
}

/// How much normals differ from that of the sample: the mean of 1 − cosine.
fn roughness(normal_map: DVec3, scaled: impl Iterator<Item = OrientedPoint>) -> f64 {
    let mut sum = 0.0;
    let mut weights = 0.0;
    for (at, normal) in scaled {
        // Wider than the fit, which must not swing out between its neighbours and the end of the
        // domain.
        let weight = (-0.3 * at.length_squared()).exp();
        sum += weight * (1.0 - normal.dot(normal_map));
        weights += weight;
    }
    if weights > 0.0 { sum / weights } else { 0.0 }
}

/// The largest part of an offset along the normal that leads nearer to no other neighbour.
fn clear_offset(
    at: DVec3,
    normal: DVec3,
    offset: f64,
    scaled: impl Iterator<Item = OrientedPoint> + Clone,
) -> Option<f64> {
    [1.0, 0.5, 0.25].into_iter().map(|part| offset * part).find(|offset| {
        let point = at + normal * *offset;
        let least = (CLEAR * offset).powi(2);
        scaled.clone().all(|(other, _)| point.distance_squared(other) >= least)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Samples of a surface around one of them.
    fn around(point: impl Fn(f64, f64) -> OrientedPoint) -> Vec<OrientedPoint> {
        let mut samples = vec![point(0.0, 0.0)];
        for k in 1..24 {
            let radius = 0.53 * f64::from(k).sqrt();
            let angle = 2.4 * f64::from(k);
            samples.push(point(radius * angle.cos(), radius * angle.sin()));
        }
        samples
    }

    fn fit(samples: &[OrientedPoint]) -> LocalFit {
        LocalFit::to_neighbours(
            samples[0],
            2.6,
            1.0,
            samples.iter().map(|sample| (*sample, 0.0)).collect(),
        )
    }

    #[test]
    fn acceptance_28_a_plane_is_reproduced_even_by_neighbours_on_a_line() {
        let normal = DVec3::new(2.0, -1.0, 3.0).normalize();
        let (u, v) = normal.any_orthonormal_pair();
        let origin = DVec3::new(0.3, -7.0, 2.0);
        let plane = around(|a, b| (origin + u * a + v * b, normal));
        let line = around(|a, _| (origin + u * a, normal));
        for samples in [&plane[..], &line[..], &plane[..3], &plane[..1]] {
            let fit = fit(samples);
            for offset in [
                DVec3::ZERO,
                DVec3::new(1.5, -2.0, 0.3),
                DVec3::splat(2.6),
                DVec3::new(-2.0, 2.0, -2.0),
            ] {
                let (value, gradient) = fit.at(origin + offset);
                assert!((value + normal.dot(offset)).abs() < 1e-9, "{value} at {offset}");
                assert!((gradient + normal).length() < 1e-9, "{gradient}");
            }
        }
    }

    #[test]
    fn a_curved_patch_is_followed_inside_its_neighbours() {
        let radius = 19.0;
        let sphere = around(|a, b| {
            let normal = DVec3::new(a / radius, b / radius, 1.0).normalize();
            (normal * radius, normal)
        });
        let fit = fit(&sphere);
        for point in
            [DVec3::new(0.0, 0.0, 0.5), DVec3::new(0.7, -0.5, 0.0), DVec3::new(-1.0, 0.3, -0.6)]
        {
            let point = sphere[0].0 + point;
            let (value, gradient) = fit.at(point);
            assert!((value - (radius - point.length())).abs() < 1e-3, "{value}");
            assert!((gradient + point.normalize()).length() < 1e-2, "{gradient}");
        }
    }

    #[test]
    fn a_field_is_taken_over_at_the_grid() {
        let field = |p: DVec3| 1.0 + p.x - 2.0 * p.y * p.x * p.x + p.z * p.z;
        let fit =
            LocalFit::to_field(DVec3::new(1.0, 2.0, 3.0), 0.5, |point| Some(field(point))).unwrap();
        for offset in [DVec3::ZERO, DVec3::new(0.2, -0.4, 0.1)] {
            let point = DVec3::new(1.0, 2.0, 3.0) + offset;
            let (value, gradient) = fit.at(point);
            assert!((value - field(point)).abs() < 1e-12);
            assert!((gradient.z - 2.0 * point.z).abs() < 1e-10);
            let line = fit.along_z(point.x, point.y);
            assert!(
                (line[0] + offset.z * (line[1] + offset.z * line[2]) - field(point)).abs() < 1e-12
            );
        }
        assert_eq!(
            LocalFit::to_field(DVec3::ZERO, 1.0, |point| (point.x < 1.0).then_some(0.0)),
            None
        );
    }

    #[test]
    fn weights_end_at_the_ball_and_their_slope_is_that_of_their_values() {
        let fit = LocalFit { center_map: DVec3::ZERO, half_m: 3.0, coefficients: [0.0; 27] };
        assert_eq!(fit.weight(9.0), (0.0, 0.0));
        for distance in [0.3_f64, 0.99, 1.01, 2.0, 2.9] {
            let above = fit.weight((distance + 1e-6).powi(2)).0;
            let below = fit.weight((distance - 1e-6).powi(2)).0;
            assert!(
                ((above - below) / 2e-6 - fit.weight(distance * distance).1 * distance).abs()
                    < 1e-8
            );
        }
        assert!((fit.weight(1.0 + 1e-12).0 - fit.weight(1.0 - 1e-12).0).abs() < 1e-9);
        for distance in [0.1_f64, 0.3, 0.99, 1.01, 2.0, 2.9] {
            let weight = |distance: f64| fit.unbounded_weight(distance * distance);
            let above = weight(distance + 1e-6).0;
            let below = weight(distance - 1e-6).0;
            assert!(
                ((above - below) / 2e-6 / distance / weight(distance).1 - 1.0).abs() < 1e-6,
                "{distance}"
            );
            assert!(
                (weight(distance).0 / fit.weight(distance * distance).0 - (3.0 / distance).powi(2))
                    .abs()
                    < 1e-6
            );
        }
        assert!(fit.unbounded_weight(0.0).0 > 1e12 && fit.unbounded_weight(9.0) == (0.0, 0.0));
    }

    /// Why the eight corners are interpolated: the paper blends them by Gaussian weights, which
    /// keep no plane, whatever their width.
    #[test]
    fn gaussian_blending_of_eight_corners_is_off_a_plane_and_interpolation_is_not() {
        let normal = DVec3::new(0.36, 0.48, 0.8);
        let plane = |at: DVec3| 0.2 - at.dot(normal);
        let corners = |at: DVec3| {
            (0..8).map(move |n| {
                at.floor() + DVec3::new(f64::from(n >> 2), f64::from(n >> 1 & 1), f64::from(n & 1))
            })
        };
        let blended = |weight: &dyn Fn(DVec3) -> f64, at: DVec3| {
            let weights: f64 = corners(at).map(|corner| weight(at - corner)).sum();
            corners(at).map(|corner| weight(at - corner) * plane(corner)).sum::<f64>() / weights
        };
        // Worst error of fits at the middle of their domains, spacings of the raster.
        let worst = |weight: &(dyn Fn(DVec3) -> f64 + Sync)| {
            let off = |k: i32| {
                let center =
                    DVec3::new(f64::from(k) * 0.7548, f64::from(k) * 0.5698, f64::from(k) * 0.4301);
                let fit = LocalFit::to_field(center, 2.3, |at| Some(blended(weight, at))).unwrap();
                (fit.at(center).0 - plane(center)).abs()
            };
            (0..300).map(off).fold(0.0, f64::max)
        };
        let linear = worst(&|away: DVec3| (1.0 - away.abs()).max(DVec3::ZERO).element_product());
        let gaussian = [0.2, 0.3, 0.35, 0.4, 0.45, 0.5, 0.7, 1.0].map(|sigma: f64| {
            worst(&|away: DVec3| (-0.5 * away.length_squared() / (sigma * sigma)).exp())
        });
        let least = gaussian.into_iter().fold(f64::INFINITY, f64::min);
        assert!(linear < 1e-9 && least > 0.05, "{linear}, {gaussian:?}");
    }
}
