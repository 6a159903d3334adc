//! Chance for tests: the same seed, the same numbers on every machine.

use glam::DVec3;

/// A linear congruential generator.
pub struct Random(pub u64);

impl Random {
    /// Even over `[0, 1)`.
    pub fn unit(&mut self) -> f64 {
        self.0 =
            self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Even over `[-1, 1)`.
    pub fn signed(&mut self) -> f64 {
        2.0 * self.unit() - 1.0
    }

    /// A point of the cube with these corners.
    pub fn in_box(&mut self, low: f64, high: f64) -> DVec3 {
        DVec3::new(self.unit(), self.unit(), self.unit()) * (high - low) + low
    }
}
