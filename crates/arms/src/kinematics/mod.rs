//! Kinematics: from joint angles to the grip, and from a wrench at the grip to joint torques.
//!
//! Data in: joint angles, rad (m for sliding joints). Data out: a [`Configuration`]: the pose of
//! the grip in the arm's native frame, and the columns of the geometric Jacobian there. τ = JᵀW
//! needs no inverse, so no singularity of a serial arm can blow up a force. A closed loop has
//! configurations where its columns grow without bound; [`Kinematics::solve`] gives `None` in a
//! narrow band around them (devices reference, section 6).
//!
//! Invariant: `solve`, `extra_torques` and `rate_twist` neither allocate nor panic, on any numbers.
//! `inverse` and `home` are for start-up and for simulated arms.
//!
//! | file | owns |
//! |---|---|
//! | [`capstan`] | serial capstan arms (WoodenHaptics, vintage, Polhem v1) |
//! | [`five_link`] | the closed five-link of Polhem v3 |
//! | [`gimbal`] | the passive wrist of both |
//! | [`pantograph`] | the planar five-bar of the Haply 2DIY |
//! | [`delta`] | the three legs of the Novint Falcon |
//! | [`chain`] | any chain of up to seven joints, as a product of exponentials |
//! | [`plain`] | arms that report a pose, one axis, or rates |
//! | `inverse` | joint angles of a pose |

mod capstan;
mod chain;
mod delta;
mod five_link;
mod gimbal;
mod inverse;
mod pantograph;
mod plain;

#[cfg(test)]
mod tests;

use glam::DQuat;

pub(super) use capstan::{Capstan, CapstanLinks};
pub(super) use chain::{Chain, ChainJoint};
pub(super) use delta::Delta;
pub(super) use five_link::{FiveLink, PlaneLink};
pub(super) use gimbal::Gimbal;
pub(super) use inverse::M_PER_RAD;
pub(super) use pantograph::Pantograph;
pub(super) use plain::{OneAxis, Rate};

use super::axes::MAX_AXES;
use vps::spatial::{Axes, Mat6, Pose, Twist, Wrench};

/// Standard gravity for compensation torques, m/s².
pub(super) const GRAVITY_M_PER_S2: f64 = 9.81;
/// Share of the trace of J·Jᵀ that keeps the way from torques to a wrench well posed: far below
/// what any wire resolves.
const RIDGE: f64 = 1e-10;

/// Where the grip is, and how each joint moves it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Configuration {
    /// Grip in the native frame. The orientation of an arm that senses none is the identity.
    pub(super) native_from_grip: Pose,
    /// Motion of the grip point per unit rate of each joint, native axes: columns of J.
    pub(super) columns: [Twist; MAX_AXES],
}

impl Configuration {
    /// Joint torques that hold a wrench: τ = JᵀW. `wrench_native`: native axes, reduced at the grip
    /// point.
    ///
    /// RT: safe.
    pub(super) fn torques(&self, wrench_native: &Wrench) -> [f64; MAX_AXES] {
        self.columns.map(|column| wrench_native.power(column))
    }

    /// Motion of the grip at joint rates: J·θ̇, native axes, of the grip point.
    ///
    /// RT: safe.
    pub(super) fn twist(&self, rates: &[f64; MAX_AXES]) -> Twist {
        let mut twist = Twist::ZERO;
        for (column, rate) in self.columns.iter().zip(rates) {
            twist.linear += column.linear * *rate;
            twist.angular += column.angular * *rate;
        }
        twist
    }

    /// What one N·m (N of a sliding joint) of each joint that `has_motor` makes at the grip: the
    /// columns of (J·Jᵀ)⁻¹·J, the least wrench W with JᵀW = τ over the axes that have a motor.
    /// Device axes; zero for a joint without a motor. Where J loses rank the columns are huge, but
    /// finite. `None`: they cannot be computed.
    ///
    /// RT: safe; one 6×6 solve for each motor.
    pub(super) fn pushes(
        &self,
        has_motor: impl Fn(usize) -> bool,
        device_from_native: DQuat,
        actuated: Axes,
    ) -> Option<[Wrench; MAX_AXES]> {
        let forced = actuated.linear_mask();
        let turned = actuated.angular_mask();
        let mut columns = [Wrench::ZERO; MAX_AXES];
        let mut gram = Mat6::ZERO;
        for (idx, (column, moved)) in columns.iter_mut().zip(self.columns).enumerate() {
            if has_motor(idx) {
                *column = Wrench::new(
                    device_from_native * moved.linear * forced,
                    device_from_native * moved.angular * turned,
                );
                gram.add_outer(1.0, column.force, column.torque);
            }
        }
        let trace: f64 = gram.traces().0 + gram.traces().1;
        for idx in 0..6 {
            gram.0[idx][idx] += RIDGE * trace.max(f64::MIN_POSITIVE);
        }
        let mut pushes = [Wrench::ZERO; MAX_AXES];
        for (push, column) in
            pushes.iter_mut().zip(columns).filter(|(_, column)| *column != Wrench::ZERO)
        {
            let (force, torque) = gram.solve_spd(column)?;
            *push = Some(Wrench::new(force, torque)).filter(|push| push.is_finite())?;
        }
        Some(pushes)
    }

    fn is_finite(&self) -> bool {
        self.native_from_grip.is_finite() && self.columns.iter().all(|column| column.is_finite())
    }
}

/// How the joints of an arm move its grip.
#[expect(
    clippy::large_enum_variant,
    reason = "there is one for each arm, and the loop takes it as it is, without a heap"
)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) enum Kinematics {
    /// The arm reports the pose of its grip and takes a wrench: readings x, y, z in m and the
    /// orientation x, y, z, w; commands force in N, then torque in N·m; rates, where it sends them,
    /// linear and angular velocity.
    #[default]
    Cartesian,
    /// A serial capstan arm.
    Capstan(Capstan),
    /// The closed five-link of Polhem v3.
    FiveLink(FiveLink),
    /// A planar five-bar.
    Pantograph(Pantograph),
    /// Three legs.
    Delta(Delta),
    /// A chain of joints.
    Chain(Chain),
    /// One axis.
    OneAxis(OneAxis),
    /// A rate input without a pose.
    Rate(Rate),
}

impl Kinematics {
    /// Entries of the joint array that mean something: those of a pose are seven.
    pub(super) fn n_joints(&self) -> usize {
        match self {
            Self::Cartesian => 7,
            Self::Capstan(arm) => 3 + 3 * usize::from(arm.gimbal.is_some()),
            Self::FiveLink(arm) => 3 + 3 * usize::from(arm.gimbal.is_some()),
            Self::Pantograph(_) => 2,
            Self::Delta(_) => 3,
            Self::Chain(chain) => chain.n_joints(),
            Self::OneAxis(_) => 1,
            Self::Rate(_) => 6,
        }
    }

    /// Native axes of the pose that the joints determine. A chain of fewer than six joints is taken
    /// by its position.
    pub(super) fn axes(&self) -> Axes {
        let axis = |name| Axes::from_name(name).unwrap_or_default();
        match self {
            Self::Cartesian => Axes::SIX,
            Self::Capstan(Capstan { gimbal: Some(_), .. })
            | Self::FiveLink(FiveLink { gimbal: Some(_), .. }) => Axes::SIX,
            Self::Capstan(_) | Self::FiveLink(_) | Self::Delta(_) => Axes::TRANSLATION,
            Self::Chain(chain) if chain.n_joints() >= 6 => Axes::SIX,
            Self::Chain(_) => Axes::TRANSLATION,
            Self::Pantograph(_) => axis("x").union(axis("y")),
            Self::OneAxis(_) => axis("x"),
            Self::Rate(_) => Axes::NONE,
        }
    }

    /// The grip at these joint angles. `None`: the joints cannot be there, the search did not
    /// converge, the loop is too close to where its columns grow without bound, or a joint is not a
    /// number. `near`: the configuration of the tick before; only searches use it.
    ///
    /// RT: safe; the delta makes at most ten steps, the rest is in closed form.
    pub(super) fn solve(
        &self,
        joints: &[f64; MAX_AXES],
        near: &Configuration,
    ) -> Option<Configuration> {
        if !joints.iter().take(self.n_joints()).all(|joint| joint.is_finite()) {
            return None;
        }
        let solved = match self {
            Self::Cartesian => plain::pose(joints),
            Self::Capstan(arm) => Some(arm.solve(joints)),
            Self::FiveLink(arm) => arm.solve(joints),
            Self::Pantograph(arm) => arm.solve(joints),
            Self::Delta(arm) => arm.solve(joints, near.native_from_grip.translation),
            Self::Chain(chain) => Some(chain.solve(joints)),
            Self::OneAxis(arm) => Some(arm.solve(joints)),
            Self::Rate(_) => Some(Configuration {
                native_from_grip: near.native_from_grip,
                ..Configuration::default()
            }),
        };
        solved.filter(Configuration::is_finite)
    }

    /// Motion that a rate input asks for, native axes; `None` for arms that report where they are.
    ///
    /// RT: safe.
    pub(super) fn rate_twist(&self, joints: &[f64; MAX_AXES]) -> Option<Twist> {
        match self {
            Self::Rate(rate) => Some(rate.twist(joints)),
            _ => None,
        }
    }

    /// Joint torques beside those of the wrench: gravity compensation, and damping of the freedom
    /// that a redundant chain has. They take part in the common scaling of the motors, but not in
    /// the rendered wrench. Zero where a number is not finite.
    ///
    /// RT: safe.
    pub(super) fn extra_torques(
        &self,
        joints: &[f64; MAX_AXES],
        rates: &[f64; MAX_AXES],
    ) -> [f64; MAX_AXES] {
        let torques_nm = match self {
            Self::Capstan(arm) => arm.gravity_torques(joints),
            Self::FiveLink(arm) => arm.gravity_torques(joints),
            Self::Chain(chain) => chain.extra_torques(joints, rates),
            _ => [0.0; MAX_AXES],
        };
        if torques_nm.iter().all(|torque_nm| torque_nm.is_finite()) {
            torques_nm
        } else {
            [0.0; MAX_AXES]
        }
    }

    /// Joint angles at which the grip has this pose, as far as the arm senses it (see
    /// [`Self::axes`]), near these. `None`: out of reach, or a rate input.
    ///
    /// Cold: up to a few hundred configurations are tried.
    pub(super) fn inverse(
        &self,
        native_from_grip: &Pose,
        near: &[f64; MAX_AXES],
    ) -> Option<[f64; MAX_AXES]> {
        if !native_from_grip.is_finite() {
            return None;
        }
        inverse::joints(self, native_from_grip, near)
    }

    /// What a rate input reports at this motion: the inverse of [`Self::rate_twist`].
    pub(super) fn rate_joints(&self, twist_native: &Twist) -> Option<[f64; MAX_AXES]> {
        match self {
            Self::Rate(rate) => Some(rate.joints(twist_native)),
            _ => None,
        }
    }

    /// Joint angles with the grip at the native origin, the centre of the workspace, or as close as
    /// the arm is described to come.
    pub(super) fn home(&self) -> [f64; MAX_AXES] {
        inverse::home(self)
    }

    /// Joint angles around these: others for each round, evenly spread, at most 1 rad (1 m) away.
    pub(super) fn around(&self, joints: &[f64; MAX_AXES], round: u32) -> [f64; MAX_AXES] {
        inverse::around(joints, self.n_joints(), round)
    }
}
