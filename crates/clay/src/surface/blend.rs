//! Blending of the fits into one field, and of that into what lies beyond.
//!
//! # Source
//! Guo2004, equation 3.

use glam::DVec3;

use super::super::Patch;
use super::super::local_fit::LocalFit;
use super::Distance;

/// Sum of weights from which on the fits alone decide.
const FULL_WEIGHT: f64 = 0.02;

/// How much of what is there counts alone, of a patch with a weight alone, and of what both decide;
/// and how far fits are there then, 0 to 1.
pub(super) fn patch_shares(presence: f64, weight: f64) -> ([f64; 3], f64) {
    let next = (weight / FULL_WEIGHT).min(1.0);
    let both = presence * next;
    let after = presence + next - both;
    ([(presence - both) / after, (next - both) / after, both / after], after)
}

/// Where a patch meets what is there, the patch decides.
pub(super) fn is_next(patch: Patch, now_m: f64, next_m: f64) -> bool {
    if patch.is_smaller() { next_m < now_m } else { next_m > now_m }
}

/// Sums of equation 3 at one point.
///
/// [`patch_shares`] and [`is_next`] put those of several patches together.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Blend {
    pub(super) weight: f64,
    weight_slope: DVec3,
    sum_m: f64,
    sum_slope: DVec3,
}

impl Blend {
    /// Where only the value is wanted.
    pub(super) fn of(weight: f64, sum_m: f64) -> Self {
        Self { weight, sum_m, ..Self::default() }
    }

    pub(super) fn add(&mut self, fit: &LocalFit, point_map: DVec3, (weight, slope): (f64, f64)) {
        if weight > 0.0 {
            let (value_m, gradient) = fit.at(point_map);
            let weight_slope = (point_map - fit.center_map) * slope;
            self.weight += weight;
            self.weight_slope += weight_slope;
            self.sum_m += weight * value_m;
            self.sum_slope += gradient * weight + weight_slope * value_m;
        }
    }

    /// The blends of all patches as one, in the order of the patches. A patch counts as far as its
    /// fits do, so that nothing jumps where it ends.
    ///
    /// The slope is that of the patch which decides; of a change from one to another it says
    /// nothing.
    pub(super) fn joined(blends: &[(Patch, Self)]) -> Self {
        if let [(_, blend)] = blends {
            return *blend;
        }
        let mut all = Self::default();
        let mut presence = 0.0;
        let mut now = Distance { value_m: 0.0, gradient: DVec3::ZERO };
        for (patch, blend) in blends.iter().filter(|(_, blend)| blend.weight > 0.0) {
            all.weight += blend.weight;
            let next = blend.distance();
            let (shares, after) = patch_shares(presence, blend.weight);
            let decides = if is_next(*patch, now.value_m, next.value_m) { next } else { now };
            let mixed = [(now, shares[0]), (next, shares[1]), (decides, shares[2])];
            now = Distance {
                value_m: mixed.iter().map(|(distance, share)| distance.value_m * share).sum(),
                gradient: mixed.iter().map(|(distance, share)| distance.gradient * *share).sum(),
            };
            presence = after;
        }
        (all.sum_m, all.sum_slope) = (now.value_m * all.weight, now.gradient * all.weight);
        all
    }

    pub(super) fn is_full(&self) -> bool {
        self.weight >= FULL_WEIGHT
    }

    pub(super) fn distance(&self) -> Distance {
        let value_m = self.sum_m / self.weight;
        Distance { value_m, gradient: (self.sum_slope - self.weight_slope * value_m) / self.weight }
    }

    /// The far field counts the more the less the fits do.
    pub(super) fn fade(mut self, far: Distance) -> Distance {
        let rest = 1.0 - self.weight / FULL_WEIGHT;
        let weight = FULL_WEIGHT * rest * rest;
        let slope = -2.0 * rest;
        self.sum_m += weight * far.value_m;
        self.sum_slope += far.gradient * weight + self.weight_slope * (slope * far.value_m);
        self.weight += weight;
        self.weight_slope += self.weight_slope * slope;
        self.distance()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two constant fields 2 m apart, of domains of 3 m: s = Σ φ_i s_i / Σ φ_i with φ = B(t)
    /// (1.5/t)², t = distance/2, B the quadratic B-spline.
    #[test]
    fn weights_without_bound_give_the_closed_form_of_equation_3_and_meet_each_sample() {
        let fits = [(0.0, 0.5), (2.0, -1.0)].map(|(x, value_m)| {
            let mut fit = LocalFit::nothing(DVec3::X * x);
            fit.half_m = 3.0;
            fit.raised(value_m)
        });
        let at = |x: f64| {
            let mut blend = Blend::default();
            for fit in &fits {
                let distance_squared_m2 = (x - fit.center_map.x).powi(2);
                blend.add(fit, DVec3::X * x, fit.unbounded_weight(distance_squared_m2));
            }
            blend.distance()
        };
        let phi = |distance: f64| {
            let t = distance / 2.0;
            let spline = if t <= 0.5 { 0.75 - t * t } else { 0.5 * (1.5 - t).powi(2) };
            spline * (1.5 / t).powi(2)
        };
        for x in [0.01, 0.3, 0.9, 1.0, 1.5, 1.99] {
            let expected = (0.5 * phi(x) - phi(2.0 - x)) / (phi(x) + phi(2.0 - x));
            assert!(
                (at(x).value_m - expected).abs() < 1e-9,
                "{x}: {:?} instead of {expected}",
                at(x)
            );
            let slope = (at(x + 1e-6).value_m - at(x - 1e-6).value_m) / 2e-6;
            assert!((at(x).gradient.x - slope).abs() < 1e-6, "{x}: {:?} instead of {slope}", at(x));
        }
        // At a sample its own value and slope alone, and no jump of the slope beside it: it grows
        // in proportion to the distance.
        for (x, value_m) in [(0.0, 0.5), (2.0, -1.0)] {
            assert!(
                (at(x).value_m - value_m).abs() < 1e-10 && at(x).gradient.length() < 1e-10,
                "{x}: {:?}",
                at(x)
            );
            for away in [1e-3, -1e-3] {
                let near = at(x + 2.0 * away).gradient.x;
                let nearer = at(x + away).gradient.x;
                assert!(
                    nearer.abs() < 1e-3 && (near / nearer - 2.0).abs() < 1e-2,
                    "{x}: {near} and {nearer}"
                );
            }
        }
    }
}
