//! Twists and wrenches: the two halves of a power port.

use core::ops::{Add, Mul, Neg, Sub};

use glam::DVec3;

use super::Axes;

/// Linear velocity of a reference point and angular velocity; the frame is named where it is
/// declared.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Twist {
    /// Velocity of the reference point, m/s.
    pub linear: DVec3,
    /// Angular velocity, rad/s.
    pub angular: DVec3,
}

impl Twist {
    /// At rest.
    pub const ZERO: Self = Self { linear: DVec3::ZERO, angular: DVec3::ZERO };

    /// True when every component is a finite number.
    pub fn is_finite(self) -> bool {
        self.linear.is_finite() && self.angular.is_finite()
    }
}

impl Add for Twist {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self { linear: self.linear + other.linear, angular: self.angular + other.angular }
    }
}

impl Sub for Twist {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Self { linear: self.linear - other.linear, angular: self.angular - other.angular }
    }
}

/// Force and torque; the frame and the reduction point are named where it is declared.
///
/// # Examples
/// ```
/// # use vps::{DVec3, Wrench};
/// let push = Wrench::new(DVec3::X * 3.0, DVec3::ZERO);
/// let pull = Wrench::new(DVec3::X * -1.0, DVec3::Z * 0.5);
/// assert_eq!(push + pull, Wrench::new(DVec3::X * 2.0, DVec3::Z * 0.5));
/// assert_eq!(pull * 2.0, Wrench::new(DVec3::X * -2.0, DVec3::Z));
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Wrench {
    /// Force, N.
    pub force: DVec3,
    /// Torque about the reduction point, N·m.
    pub torque: DVec3,
}

impl Wrench {
    /// No force, no torque; every bit zero.
    pub const ZERO: Self = Self { force: DVec3::ZERO, torque: DVec3::ZERO };

    /// A wrench from its parts.
    pub const fn new(force: DVec3, torque: DVec3) -> Self {
        Self { force, torque }
    }

    /// What an arm with motors on `axes` gives of it: the other components are zero, force (N) and
    /// torque (N·m) each shortened to its limit with the direction kept. RT: safe; what is not
    /// finite stays so.
    #[doc(hidden)]
    pub fn limited_to(self, axes: Axes, force_limit_n: f64, torque_limit_nm: f64) -> Self {
        let limited = |vector: DVec3, limit: f64| {
            let length = vector.length();
            if length > limit { vector * (limit / length) } else { vector }
        };
        Self::new(
            limited(self.force * axes.linear_mask(), force_limit_n),
            limited(self.torque * axes.angular_mask(), torque_limit_nm),
        )
    }

    /// The same wrench reduced at another point: τ_b = τ_a + (p_a − p_b) × F.
    ///
    /// # Examples
    /// ```
    /// # use vps::{DVec3, Wrench};
    /// // 2 N upward at x = 30 mm turn about the y axis of the origin.
    /// let at_grip = Wrench::new(DVec3::Z * 2.0, DVec3::ZERO);
    /// let at_origin = at_grip.moved(DVec3::X * 0.03, DVec3::ZERO);
    /// assert!(at_origin.torque.abs_diff_eq(DVec3::Y * -0.06, 1e-12));
    /// ```
    pub fn moved(self, from_point: DVec3, to_point: DVec3) -> Self {
        Self { force: self.force, torque: self.torque + (from_point - to_point).cross(self.force) }
    }

    /// Power of this wrench on a twist of the same frame and reduction point, W.
    #[doc(hidden)]
    pub fn power(self, twist: Twist) -> f64 {
        self.force.dot(twist.linear) + self.torque.dot(twist.angular)
    }

    /// True when every component is a finite number.
    pub fn is_finite(self) -> bool {
        self.force.is_finite() && self.torque.is_finite()
    }
}

impl Add for Wrench {
    type Output = Self;
    fn add(self, rhs: Self) -> Self {
        Self { force: self.force + rhs.force, torque: self.torque + rhs.torque }
    }
}

impl Sub for Wrench {
    type Output = Self;
    fn sub(self, rhs: Self) -> Self {
        Self { force: self.force - rhs.force, torque: self.torque - rhs.torque }
    }
}

impl Neg for Wrench {
    type Output = Self;
    fn neg(self) -> Self {
        Self { force: -self.force, torque: -self.torque }
    }
}

impl Mul<f64> for Wrench {
    type Output = Self;
    fn mul(self, scale: f64) -> Self {
        Self { force: self.force * scale, torque: self.torque * scale }
    }
}
