//! Rigid transforms.

use core::ops::Mul;

use glam::{DMat3, DQuat, DVec3};

/// A rigid transform, named `to_from_from`: maps coordinates of the right-hand frame to the
/// left-hand one.
///
/// # Examples
/// ```
/// # use vps::{DQuat, DVec3, Pose};
/// // The grip is 30 mm along the x axis of a tool that is turned by a quarter about z.
/// let quarter = DQuat::from_rotation_z(core::f64::consts::FRAC_PI_2);
/// let world_from_tool = Pose::new(quarter, DVec3::X * 0.1);
/// let world_from_grip = world_from_tool * Pose::from_translation(DVec3::X * 0.03);
/// assert!(world_from_grip.translation.abs_diff_eq(DVec3::new(0.1, 0.03, 0.0), 1e-12));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Turns components along the `from` axes into components along the `to` axes; a unit
    /// quaternion.
    pub rotation: DQuat,
    /// Origin of the `from` frame in the `to` frame, metres.
    pub translation: DVec3,
}

impl Pose {
    /// The pose of a frame in itself.
    pub const IDENTITY: Self = Self { rotation: DQuat::IDENTITY, translation: DVec3::ZERO };

    /// A pose from its parts; the quaternion must be of unit length.
    pub const fn new(rotation: DQuat, translation: DVec3) -> Self {
        Self { rotation, translation }
    }

    /// A pure translation in metres.
    pub const fn from_translation(translation: DVec3) -> Self {
        Self { rotation: DQuat::IDENTITY, translation }
    }

    /// The inverse transform: `a_from_b.inverse()` is `b_from_a`.
    ///
    /// # Examples
    /// ```
    /// # use vps::{DQuat, DVec3, Pose};
    /// # let a_from_b = Pose::new(DQuat::from_rotation_x(0.3), DVec3::new(0.1, 0.2, 0.3));
    /// let point_b = DVec3::new(1.0, 2.0, 3.0);
    /// let point_a = a_from_b.transform_point(point_b);
    /// assert!(a_from_b.inverse().transform_point(point_a).abs_diff_eq(point_b, 1e-12));
    /// ```
    pub fn inverse(self) -> Self {
        let rotation = self.rotation.conjugate();
        Self { rotation, translation: -(rotation * self.translation) }
    }

    /// Coordinates of a point, changed from the `from` to the `to` frame.
    ///
    /// # Examples
    /// ```
    /// # use vps::{DVec3, Pose};
    /// let pose = Pose::from_translation(DVec3::Z);
    /// assert_eq!(pose.transform_point(DVec3::X), DVec3::new(1.0, 0.0, 1.0));
    /// ```
    pub fn transform_point(self, point: DVec3) -> DVec3 {
        self.rotation * point + self.translation
    }

    /// Components of a free vector, changed from the `from` to the `to` frame.
    ///
    /// # Examples
    /// ```
    /// # use vps::{DVec3, Pose};
    /// let pose = Pose::from_translation(DVec3::Z);
    /// assert_eq!(pose.transform_vector(DVec3::X), DVec3::X, "a direction has no place");
    /// ```
    pub fn transform_vector(self, vector: DVec3) -> DVec3 {
        self.rotation * vector
    }

    /// The rotation as a matrix whose columns are the `from` axes in the `to` frame.
    pub fn rotation_matrix(self) -> DMat3 {
        DMat3::from_quat(self.rotation)
    }

    /// Moves the frame by a small step given in the `to` frame: translation `linear` (m), rotation
    /// vector `angular` (rad) about the frame's own origin. The quaternion is normalised, so drift
    /// does not build up.
    ///
    /// # Examples
    /// ```
    /// # use vps::{DQuat, DVec3, Pose};
    /// let step = Pose::IDENTITY.stepped(DVec3::X * 1e-3, DVec3::Z * 0.1);
    /// assert_eq!(step.translation, DVec3::X * 1e-3);
    /// assert!(step.rotation.abs_diff_eq(DQuat::from_rotation_z(0.1), 1e-12));
    /// ```
    pub fn stepped(self, linear: DVec3, angular: DVec3) -> Self {
        Self {
            rotation: (DQuat::from_scaled_axis(angular) * self.rotation).normalize(),
            translation: self.translation + linear,
        }
    }

    /// Rotation vector (rad, `to` frame) that turns `self` into `target`, of length at most π.
    ///
    /// # Examples
    /// ```
    /// # use vps::{DQuat, DVec3, Pose};
    /// let turned = Pose::new(DQuat::from_rotation_y(0.5), DVec3::ZERO);
    /// assert!(Pose::IDENTITY.rotation_to(turned).abs_diff_eq(DVec3::Y * 0.5, 1e-12));
    /// ```
    pub fn rotation_to(self, target: Self) -> DVec3 {
        let mut turn = target.rotation * self.rotation.conjugate();
        if turn.w < 0.0 {
            turn = -turn;
        }
        turn.to_scaled_axis()
    }

    /// True when every component is a finite number.
    pub fn is_finite(self) -> bool {
        self.rotation.is_finite() && self.translation.is_finite()
    }
}

impl Default for Pose {
    fn default() -> Self {
        Self::IDENTITY
    }
}

impl Mul for Pose {
    type Output = Self;

    fn mul(self, rhs: Self) -> Self {
        Self {
            rotation: self.rotation * rhs.rotation,
            translation: self.rotation * rhs.translation + self.translation,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample() -> Pose {
        Pose::new(DQuat::from_scaled_axis(DVec3::new(0.3, -1.2, 0.7)), DVec3::new(0.1, 0.2, -0.3))
    }

    #[test]
    fn a_pose_times_its_inverse_is_the_identity() {
        let product = sample() * sample().inverse();
        assert!(product.translation.length() < 1e-15);
        assert!(product.rotation.angle_between(DQuat::IDENTITY) < 1e-7);
    }

    #[test]
    fn a_step_by_the_rotation_to_a_target_reaches_it() {
        let start = sample();
        let target = start.stepped(DVec3::new(0.01, 0.0, 0.0), DVec3::new(0.4, 0.5, -0.2));
        let turn = start.rotation_to(target);
        assert!((turn - DVec3::new(0.4, 0.5, -0.2)).length() < 1e-12);
    }
}
