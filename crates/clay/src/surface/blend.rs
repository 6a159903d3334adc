//! Blending of the fits into one field, and of that into what lies beyond.
//!
//! # Source
//! Guo2004, equation 3.

use glam::DVec3;

use super::super::local_fit::LocalFit;
use super::Distance;

/// Sum of weights from which on the fits alone decide.
const FULL_WEIGHT: f64 = 0.02;

/// Sums of equation 3 at one point.
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

    pub(super) fn add(&mut self, fit: &LocalFit, point_map: DVec3, distance_squared_m2: f64) {
        let (weight, slope) = fit.weight(distance_squared_m2);
        if weight > 0.0 {
            let (value_m, gradient) = fit.at(point_map);
            let weight_slope = (point_map - fit.center_map) * slope;
            self.weight += weight;
            self.weight_slope += weight_slope;
            self.sum_m += weight * value_m;
            self.sum_slope += gradient * weight + weight_slope * value_m;
        }
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
        let (weight, slope) = (FULL_WEIGHT * rest * rest, -2.0 * rest);
        self.sum_m += weight * far.value_m;
        self.sum_slope += far.gradient * weight + self.weight_slope * (slope * far.value_m);
        self.weight += weight;
        self.weight_slope += self.weight_slope * slope;
        self.distance()
    }
}
