//! The planar five-bar of the Haply 2DIY, in the native x-y plane (devices reference, 6.3).
//!
//! ```text
//! A = l·(cosθ1, sinθ1)       B = (d, 0) + l·(cosθ2, sinθ2)       |E − A| = |E − B| = L, E left of A→B
//! ```

use glam::{DVec2, DVec3};

use super::Configuration;
use super::five_link::MEETING_SINE_MIN;
use crate::axes::MAX_AXES;
use vps::spatial::Pose;

/// Geometry of the five-bar.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Pantograph {
    /// Driven arm l, m.
    pub(crate) inner_m: f64,
    /// Outer arm L, m.
    pub(crate) outer_m: f64,
    /// Distance d of the motors, m; the second is at +x of the first.
    pub(crate) distance_m: f64,
    /// Centre of the workspace as seen from the first motor, m: the native origin.
    pub(crate) origin_m: DVec2,
}

impl Pantograph {
    pub(super) fn solve(&self, joints: &[f64; MAX_AXES]) -> Option<Configuration> {
        let [angle_a, angle_b, ..] = *joints;
        let direction_a = DVec2::from_angle(angle_a);
        let direction_b = DVec2::from_angle(angle_b);
        let a = self.inner_m * direction_a;
        let b = DVec2::new(self.distance_m, 0.0) + self.inner_m * direction_b;
        let between = b - a;
        let height_squared = self.outer_m * self.outer_m - 0.25 * between.length_squared();
        if height_squared.is_nan() || height_squared <= 0.0 {
            return None;
        }
        let e = 0.5 * (a + b) + height_squared.sqrt() * between.perp() / between.length();
        let from_a = e - a;
        let from_b = e - b;
        let area = from_a.perp_dot(from_b);
        if area.is_nan() || area.abs() < MEETING_SINE_MIN * self.outer_m * self.outer_m {
            return None;
        }
        let column = |right_a: f64, right_b: f64| {
            DVec3::new(
                right_a * from_b.y - right_b * from_a.y,
                right_b * from_a.x - right_a * from_b.x,
                0.0,
            ) / area
        };
        let mut configuration = Configuration {
            native_from_grip: Pose::from_translation((e - self.origin_m).extend(0.0)),
            ..Configuration::default()
        };
        configuration.columns[0].linear =
            column(from_a.dot(self.inner_m * direction_a.perp()), 0.0);
        configuration.columns[1].linear =
            column(0.0, from_b.dot(self.inner_m * direction_b.perp()));
        Some(configuration)
    }
}
