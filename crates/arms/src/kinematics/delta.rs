//! The three legs of the Novint Falcon (devices reference, 6.4).
//!
//! Each leg i, with φ its azimuth: u = x·cosφ + y·sinφ − r, v = −x·sinφ + y·cosφ − s, w = z, p =
//! u + c, R = √(b² − (v + f)²), K = d + e + R; the leg closes where (p − a·cosθ)² + (w − a·sinθ)² =
//! K².
//!
//! The pose at given leg angles is found by Newton's method from the last one; the leg angles at a
//! given pose are in closed form.

use glam::{DMat3, DVec3};

use super::Configuration;
use crate::axes::MAX_AXES;
use vps::spatial::Pose;

/// Steps after which a search that has not converged is given up.
const STEPS_MAX: usize = 10;
/// A leg angle this close to the measured one counts as reached, rad: a ten-millionth of an encoder
/// count.
const TOLERANCE_RAD: f64 = 1e-11;
/// Largest column of J, m/rad. In the workspace they stay below 0.2; where a leg stretches out they
/// grow without bound.
const COLUMN_MAX_M_PER_RAD: f64 = 2.0;
/// Where a search starts that has no configuration before it: inside the workspace, from where
/// every pose is reached.
const START: DVec3 = DVec3::new(0.0, 0.0, 0.11);

/// Geometry of the delta, with the letters of the reference.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Delta {
    /// a: driven link, m.
    pub(crate) driven_m: f64,
    /// b: parallelogram, m.
    pub(crate) rod_m: f64,
    /// c, d, e, f: offsets of the links, m.
    pub(crate) offsets_m: [f64; 4],
    /// r: distance of a shoulder from the axis, m.
    pub(crate) radius_m: f64,
    /// s: offset of a shoulder across its leg, m.
    pub(crate) shift_m: f64,
    /// φ of the three legs, rad.
    pub(crate) azimuth_rad: [f64; 3],
    /// Centre of the workspace, m: the native origin.
    pub(crate) origin_m: DVec3,
}

/// A leg at a position.
struct Leg {
    theta_rad: f64,
    /// ∂θ/∂P, rad/m.
    gradient: DVec3,
}

impl Delta {
    /// `position` as seen from the frame of the geometry, without the origin.
    fn leg(&self, position: DVec3, azimuth_rad: f64) -> Option<Leg> {
        let (sin, cos) = azimuth_rad.sin_cos();
        let [c, d, e, f] = self.offsets_m;
        let a = self.driven_m;
        let p = position.x * cos + position.y * sin - self.radius_m + c;
        let v = -position.x * sin + position.y * cos - self.shift_m + f;
        let w = position.z;
        let rod = (self.rod_m * self.rod_m - v * v).sqrt();
        let reach = d + e + rod;
        let distance_squared = p * p + w * w;
        let cosine =
            (distance_squared + a * a - reach * reach) / (2.0 * a * distance_squared.sqrt());
        if cosine.is_nan() || cosine.abs() > 1.0 || rod <= 0.0 {
            return None;
        }
        let theta_rad = w.atan2(p) - cosine.acos();
        let (sin_theta, cos_theta) = theta_rad.sin_cos();
        let along = p - a * cos_theta;
        let up = w - a * sin_theta;
        let across = reach * v / rod;
        let per_angle = a * (along * sin_theta - up * cos_theta);
        let gradient =
            -DVec3::new(along * cos - across * sin, along * sin + across * cos, up) / per_angle;
        gradient.is_finite().then_some(Leg { theta_rad, gradient })
    }

    fn legs(&self, position: DVec3) -> Option<[Leg; 3]> {
        let [first, second, third] = self.azimuth_rad;
        Some([self.leg(position, first)?, self.leg(position, second)?, self.leg(position, third)?])
    }

    /// Leg angles at a native position; `None`: out of reach.
    pub(super) fn angles(&self, position_native: DVec3) -> Option<[f64; 3]> {
        self.legs(position_native + self.origin_m).map(|legs| legs.map(|leg| leg.theta_rad))
    }

    pub(super) fn solve(
        &self,
        joints: &[f64; MAX_AXES],
        near_native: DVec3,
    ) -> Option<Configuration> {
        let from_near = Some(near_native)
            .filter(|near| near.is_finite())
            .and_then(|near| self.search(joints, near + self.origin_m));
        from_near.or_else(|| self.search(joints, START))
    }

    fn search(&self, joints: &[f64; MAX_AXES], start: DVec3) -> Option<Configuration> {
        let mut position = start;
        for _ in 0..STEPS_MAX {
            let legs = self.legs(position)?;
            let [first, second, third] = &legs;
            // Rows of ∂θ/∂P; its inverse has ∂P/∂θ as columns.
            let inverse = DMat3::from_cols(first.gradient, second.gradient, third.gradient)
                .transpose()
                .inverse();
            let [miss_a, miss_b, miss_c] = [
                joints[0] - first.theta_rad,
                joints[1] - second.theta_rad,
                joints[2] - third.theta_rad,
            ];
            let miss = DVec3::new(miss_a, miss_b, miss_c);
            if miss.abs().max_element() < TOLERANCE_RAD {
                let columns = [inverse.x_axis, inverse.y_axis, inverse.z_axis];
                if !columns.iter().all(|column| column.length() < COLUMN_MAX_M_PER_RAD) {
                    return None;
                }
                let mut configuration = Configuration {
                    native_from_grip: Pose::from_translation(position - self.origin_m),
                    ..Configuration::default()
                };
                for (column, linear) in configuration.columns.iter_mut().zip(columns) {
                    column.linear = linear;
                }
                return Some(configuration);
            }
            position += inverse * miss;
        }
        None
    }
}
