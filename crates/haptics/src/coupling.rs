//! Virtual coupling: how the tool follows the arm, and what the arm feels of it.
//!
//! The tool is a rigid body at its centre of mass, pulled by a spring and damper towards the pose
//! that the arm asks for and pushed by contact. The arm feels the **spring** (and a damper only
//! where the scene asks for one): in contact the tool stands on the wall and the spring is what the
//! hand presses against, so the arm's stability bound applies to the spring's stiffness.
//!
//! # Source
//! McNeely1999 (spring-damper coupling, critical damping); OtaduyLin2006 (implicit step over
//! linearised contact and coupling); saturation and the reading of the damper are ours.

use glam::{DMat3, DVec3};

use super::params::{CouplingParameters, LimitParameters, SpringClamp};
use vps::spatial::{Mat6, Pose, Twist, Wrench};

/// Mass properties of the tool.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Inertia {
    /// Mass m, kg.
    pub mass_kg: f64,
    /// I about the centre of mass, tool axes, kg·m².
    pub body_kg_m2: DMat3,
    /// Smallest principal moment of inertia, kg·m².
    pub least_kg_m2: f64,
}

impl Inertia {
    /// The 6×6 mass matrix about the centre of mass of a tool whose axes lie so in the world; world
    /// axes.
    pub(super) fn in_world(&self, axes: DMat3) -> Mat6 {
        Mat6::from_blocks(
            DMat3::IDENTITY * self.mass_kg,
            DMat3::ZERO,
            DMat3::ZERO,
            axes * self.body_kg_m2 * axes.transpose(),
        )
    }
}

/// Isotropic against ways and against turns, with nothing between the two.
pub(super) fn on_diagonal(linear: f64, angular: f64) -> Mat6 {
    let identity = DMat3::IDENTITY;
    Mat6::from_blocks(identity * linear, DMat3::ZERO, DMat3::ZERO, identity * angular)
}

/// The virtual tool: pose of its axes at the centre of mass, and velocity of that point, world.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Body {
    pub(super) pose: Pose,
    pub(super) twist: Twist,
}

/// Spring wrench on the tool at its centre of mass, world axes, with its secant stiffness.
#[derive(Clone, Copy, Debug)]
pub(super) struct Spring {
    pub(super) wrench: Wrench,
    pub(super) stiffness_n_per_m: f64,
    pub(super) stiffness_nm_per_rad: f64,
    /// Energy in its translation and its rotation, J: what it gives back when it is let go.
    pub(super) stored_j: [f64; 2],
}

impl Spring {
    /// The bounded spring from `body` to `target`. `voxel_size_m` and `radius_m` serve the
    /// half-voxel clamp only.
    pub(super) fn between(
        body: Pose,
        target: Pose,
        coupling: &CouplingParameters,
        limits: &LimitParameters,
        voxel_size_m: f64,
        radius_m: f64,
    ) -> Self {
        let mut force_max_n = limits.force_n;
        let mut torque_max_nm = limits.torque_nm;
        if coupling.clamp == SpringClamp::HalfVoxel {
            force_max_n = force_max_n.min(coupling.stiffness_n_per_m * 0.5 * voxel_size_m);
            torque_max_nm =
                torque_max_nm.min(coupling.stiffness_nm_per_rad * 0.5 * voxel_size_m / radius_m);
        }
        let way = target.translation - body.translation;
        let turn = body.rotation_to(target);
        let (force, stiffness_n_per_m) = saturated(coupling.stiffness_n_per_m, way, force_max_n);
        let (torque, stiffness_nm_per_rad) =
            saturated(coupling.stiffness_nm_per_rad, turn, torque_max_nm);
        let stored_j = [
            stored(coupling.stiffness_n_per_m, way.length(), force_max_n),
            stored(coupling.stiffness_nm_per_rad, turn.length(), torque_max_nm),
        ];
        Self {
            wrench: Wrench::new(force, torque),
            stiffness_n_per_m,
            stiffness_nm_per_rad,
            stored_j,
        }
    }
}

/// F_max · tanh(k |x| / F_max) along x, with its secant stiffness |F|/|x|.
///
/// A limit of zero (an arm without torque) must not cut the spring inside the virtual tool: it then
/// stays linear.
pub(super) fn saturated(stiffness: f64, stretch: DVec3, limit: f64) -> (DVec3, f64) {
    let length = stretch.length();
    let linear = stiffness * length;
    if !(limit > 0.0 && limit.is_finite()) || linear < 1e-9 * limit {
        return (stretch * stiffness, stiffness);
    }
    let secant = limit * (linear / limit).tanh() / length;
    (stretch * secant, secant)
}

/// The energy of [`saturated`] at that length: F_max²/k · ln cosh(k x / F_max), J.
fn stored(stiffness: f64, length: f64, limit: f64) -> f64 {
    let share = stiffness * length / limit;
    if !(limit > 0.0 && limit.is_finite()) || share < 1e-4 {
        return 0.5 * stiffness * length * length;
    }
    // ln cosh x without the overflow of cosh.
    limit * limit / stiffness * (share + (-2.0 * share).exp().ln_1p() - core::f64::consts::LN_2)
}

/// Contact as the coupling sees it: wrench on the tool about its centre of mass, world axes, and
/// how it answers to motion.
#[derive(Clone, Copy, Debug)]
pub(super) struct LinearContact {
    /// Filtered wrench y_k.
    pub(super) wrench: Wrench,
    /// (1 − α) · stiffness: the share that acts within the tick.
    pub(super) stiffness: Mat6,
    /// Dampers of the contact, of the faces that touch, and of the brake; symmetric, positive
    /// semi-definite, N·s/m, N·s, N·m·s/rad.
    pub(super) damping: Mat6,
}

/// What pulls and how the step is taken.
#[derive(Clone, Copy, Debug)]
pub(super) struct StepInput {
    pub(super) spring: Spring,
    /// Velocity of the target at the centre of mass, world.
    pub(super) target_twist: Twist,
    /// Weight, N.
    pub(super) weight: DVec3,
    /// Internal damping between tool and arm, N·s/m and N·m·s/rad.
    pub(super) damping: (f64, f64),
    pub(super) period_s: f64,
}

impl StepInput {
    /// Critical damping of the coupling spring on the tool's inertia: b = 2 √(m k).
    pub(super) fn critical_damping(coupling: &CouplingParameters, inertia: &Inertia) -> (f64, f64) {
        (
            2.0 * (inertia.mass_kg * coupling.stiffness_n_per_m).sqrt(),
            2.0 * (inertia.least_kg_m2 * coupling.stiffness_nm_per_rad).sqrt(),
        )
    }

    /// Everything but contact that acts at velocity `twist`.
    fn wrench(&self, twist: Twist) -> Wrench {
        let damper = Wrench::new(
            (self.target_twist.linear - twist.linear) * self.damping.0,
            (self.target_twist.angular - twist.angular) * self.damping.1,
        );
        self.spring.wrench + damper + Wrench::new(self.weight, DVec3::ZERO)
    }
}

impl Body {
    /// Implicit Euler over linearised contact and coupling:
    /// `(M + h D + h² K) dv = h (W + y − (D_c + h K) v)`, then `v ← v + dv`, `x ← x + h v`.
    ///
    /// K sums the spring's secant stiffness and the contact stiffness, D the internal damper and
    /// the contact damping; all are symmetric and positive semi-definite, so the system is positive
    /// definite for every stiffness. `None` only on non-finite input. RT: safe; one 6×6 LDLᵀ.
    /// Gyroscopic torque is left out: at hand speeds it is below what encoders resolve.
    pub(super) fn step_implicit(
        &self,
        pull: &StepInput,
        contact: &LinearContact,
        inertia: &Inertia,
    ) -> Option<Twist> {
        let h = pull.period_s;
        let mass = inertia.in_world(self.pose.rotation_matrix());
        let springs = on_diagonal(pull.spring.stiffness_n_per_m, pull.spring.stiffness_nm_per_rad);
        let dampers = on_diagonal(pull.damping.0, pull.damping.1);
        let system = mass
            .plus_scaled(h, &dampers)
            .plus_scaled(h * h, &springs)
            .plus_scaled(h * h, &contact.stiffness)
            .plus_scaled(h, &contact.damping);
        // What one more tick at the present velocity adds to spring and contact, and what contact
        // damping takes now.
        let resisting = Mat6::ZERO
            .plus_scaled(h, &springs)
            .plus_scaled(h, &contact.stiffness)
            .plus_scaled(1.0, &contact.damping);
        let (force, torque) = resisting.mul(self.twist.linear, self.twist.angular);
        let wrench = (pull.wrench(self.twist) + contact.wrench - Wrench::new(force, torque)) * h;
        let (linear, angular) = system.solve_spd(wrench)?;
        Some(Twist { linear: self.twist.linear + linear, angular: self.twist.angular + angular })
    }

    /// Moves by one tick at `twist`, but no point by more than `step_limit_m`: velocity and step
    /// are scaled down together, so what is cut is not stored.
    pub(super) fn moved(
        &self,
        twist: Twist,
        period_s: f64,
        radius_m: f64,
        step_limit_m: f64,
    ) -> Self {
        let step_m = (twist.linear.length() + twist.angular.length() * radius_m) * period_s;
        let scale = if step_m > step_limit_m { step_limit_m / step_m } else { 1.0 };
        let twist = Twist { linear: twist.linear * scale, angular: twist.angular * scale };
        Self { pose: self.pose.stepped(twist.linear * period_s, twist.angular * period_s), twist }
    }

    /// Stands at `target`, or on the way there where that is further than `step_limit_m` for some
    /// point.
    pub(super) fn followed(
        &self,
        (target, twist): (Pose, Twist),
        radius_m: f64,
        step_limit_m: f64,
    ) -> Self {
        let way = target.translation - self.pose.translation;
        let turn = self.pose.rotation_to(target);
        let step_m = way.length() + turn.length() * radius_m;
        if step_m <= step_limit_m {
            return Self { pose: target, twist };
        }
        let share = step_limit_m / step_m;
        // A target that is not a number must come through, to be refused.
        if !share.is_finite() {
            return Self { pose: target, twist };
        }
        Self { pose: self.pose.stepped(way * share, turn * share), twist }
    }
}

#[cfg(test)]
#[expect(clippy::expect_used, reason = "test code")]
mod tests {
    use glam::DQuat;

    use super::*;
    use crate::testing::product;

    const K: f64 = 1300.0;
    const K_TURN: f64 = 0.45;
    const VOXEL_M: f64 = 1e-3;
    const RADIUS_M: f64 = 0.02;
    const PERIOD_S: f64 = 1e-3;

    fn coupling() -> CouplingParameters {
        CouplingParameters {
            stiffness_n_per_m: K,
            stiffness_nm_per_rad: K_TURN,
            ..CouplingParameters::PLAIN
        }
    }

    fn limits(force_n: f64, torque_nm: f64) -> LimitParameters {
        LimitParameters { force_n, torque_nm, ..LimitParameters::NONE }
    }

    fn along() -> DVec3 {
        DVec3::new(2.0, -1.0, 3.0).normalize()
    }

    fn about() -> DVec3 {
        DVec3::new(-1.0, 2.0, 0.5).normalize()
    }

    fn body() -> Pose {
        let rotation = DQuat::from_scaled_axis(DVec3::new(0.3, -0.7, 1.1));
        Pose::new(rotation, DVec3::new(0.1, 0.2, -0.3))
    }

    fn stretched(
        way_m: f64,
        turn_rad: f64,
        coupling: &CouplingParameters,
        limits: &LimitParameters,
        voxel_size_m: f64,
    ) -> Spring {
        let body = body();
        let rotation = DQuat::from_scaled_axis(about() * turn_rad) * body.rotation;
        let target = Pose::new(rotation, body.translation + along() * way_m);
        Spring::between(body, target, coupling, limits, voxel_size_m, RADIUS_M)
    }

    /// The work of F_max tanh(k x / F_max) up to `end`, by Simpson's rule.
    fn work_j(stiffness: f64, end: f64, limit: f64) -> f64 {
        let n = 2000;
        let step = end / f64::from(n);
        let force = |i: i32| limit * (stiffness * step * f64::from(i) / limit).tanh();
        (0..n / 2)
            .map(|i| (force(2 * i) + 4.0 * force(2 * i + 1) + force(2 * i + 2)) * step / 3.0)
            .sum()
    }

    #[test]
    fn a_spring_saturates_along_its_stretch_and_holds_the_work_that_stretched_it() {
        for (way_m, turn_rad) in [(1e-3, 0.1), (4e-3, 0.5), (2e-2, 1.5), (0.5, 3.0)] {
            let spring = stretched(way_m, turn_rad, &coupling(), &limits(7.0, 0.3), VOXEL_M);
            let force_n = 7.0 * (K * way_m / 7.0).tanh();
            let torque_nm = 0.3 * (K_TURN * turn_rad / 0.3).tanh();
            assert!((spring.wrench.force - along() * force_n).length() < 1e-9);
            assert!((spring.wrench.torque - about() * torque_nm).length() < 1e-9);
            assert!((spring.stiffness_n_per_m * way_m - force_n).abs() < 1e-9);
            assert!((spring.stiffness_nm_per_rad * turn_rad - torque_nm).abs() < 1e-9);
            let [linear_j, angular_j] = spring.stored_j;
            assert!((linear_j / work_j(K, way_m, 7.0) - 1.0).abs() < 1e-6, "{way_m}: {linear_j}");
            let expected_j = work_j(K_TURN, turn_rad, 0.3);
            assert!((angular_j / expected_j - 1.0).abs() < 1e-6, "{turn_rad}: {angular_j}");
        }
    }

    #[test]
    fn a_spring_without_a_limit_is_linear() {
        for limit in [0.0, f64::INFINITY] {
            let spring = stretched(0.02, 1.5, &coupling(), &limits(limit, limit), VOXEL_M);
            assert!((spring.wrench.force - along() * (K * 0.02)).length() < 1e-9);
            assert!((spring.wrench.torque - about() * (K_TURN * 1.5)).length() < 1e-9);
            let [linear_j, angular_j] = spring.stored_j;
            assert!((linear_j - 0.5 * K * 0.02 * 0.02).abs() < 1e-9);
            assert!((angular_j - 0.5 * K_TURN * 1.5 * 1.5).abs() < 1e-9);
        }
    }

    #[test]
    fn the_half_voxel_clamp_bounds_a_spring_by_half_a_voxel_unless_the_limit_is_lower() {
        let coupling = CouplingParameters { clamp: SpringClamp::HalfVoxel, ..coupling() };
        let clamped = stretched(0.5, 3.0, &coupling, &limits(7.0, 0.3), VOXEL_M).wrench;
        assert!((clamped.force.length() - K * 0.5 * VOXEL_M).abs() < 1e-9);
        assert!((clamped.torque.length() - K_TURN * 0.5 * VOXEL_M / RADIUS_M).abs() < 1e-9);
        let limited = stretched(0.5, 3.0, &coupling, &limits(7.0, 0.3), 0.1).wrench;
        assert!((limited.force.length() - 7.0).abs() < 1e-9);
        let torque_nm = 0.3 * (K_TURN * 3.0 / 0.3_f64).tanh();
        assert!((limited.torque.length() - torque_nm).abs() < 1e-9);
    }

    fn inertia() -> Inertia {
        Inertia {
            mass_kg: 0.3,
            body_kg_m2: DMat3::from_diagonal(DVec3::new(2e-5, 5e-5, 9e-5)),
            least_kg_m2: 2e-5,
        }
    }

    #[test]
    fn the_damper_of_the_coupling_is_critical() {
        let (linear, angular) = StepInput::critical_damping(&coupling(), &inertia());
        assert!((linear * linear / (4.0 * K * 0.3) - 1.0).abs() < 1e-12);
        assert!((angular * angular / (4.0 * K_TURN * 2e-5) - 1.0).abs() < 1e-12);
    }

    /// Newton's law at the end of the tick: M (v' − v)/h is what spring, dampers, weight and
    /// contact give at v' and after its step.
    #[test]
    fn an_implicit_step_ends_where_all_forces_balance_the_change_of_momentum() {
        let body = Body {
            pose: body(),
            twist: Twist {
                linear: DVec3::new(0.3, -0.2, 0.1),
                angular: DVec3::new(2.0, 3.0, -5.0),
            },
        };
        let spring = stretched(4e-3, 0.5, &coupling(), &limits(7.0, 0.3), VOXEL_M);
        let pull = StepInput {
            spring,
            target_twist: Twist {
                linear: DVec3::new(-0.2, 0.5, 0.4),
                angular: DVec3::new(-3.0, 1.0, 2.0),
            },
            weight: DVec3::new(0.4, -1.1, -2.9),
            damping: (21.0, 4e-3),
            period_s: PERIOD_S,
        };
        let mut stiffness = Mat6::ZERO;
        stiffness.add_outer(9e3, along(), DVec3::new(0.01, 0.02, -0.03));
        stiffness.add_outer(7e3, about(), DVec3::new(-0.02, 0.01, 0.01));
        let mut dampers = Mat6::ZERO;
        dampers.add_outer(60.0, about(), DVec3::new(0.03, -0.01, 0.02));
        for damping in [dampers, Mat6::ZERO] {
            let contact = LinearContact {
                wrench: Wrench::new(DVec3::new(3.0, 2.0, 5.0), DVec3::new(0.05, -0.08, 0.03)),
                stiffness,
                damping,
            };
            let after = body.step_implicit(&pull, &contact, &inertia()).expect("finite");
            let axes = body.pose.rotation_matrix();
            let changed = after - body.twist;
            let momentum = Wrench::new(
                changed.linear * (0.3 / PERIOD_S),
                axes * inertia().body_kg_m2 * axes.transpose() * changed.angular / PERIOD_S,
            );
            let slip = pull.target_twist - after;
            let coupled = Wrench::new(
                slip.linear * 21.0 - after.linear * (PERIOD_S * spring.stiffness_n_per_m),
                slip.angular * 4e-3 - after.angular * (PERIOD_S * spring.stiffness_nm_per_rad),
            );
            let forces =
                spring.wrench + coupled + Wrench::new(pull.weight, DVec3::ZERO) + contact.wrench
                    - product(&stiffness, after) * PERIOD_S
                    - product(&damping, after);
            assert!((forces - momentum).force.length() < 1e-9, "{forces:?} {momentum:?}");
            assert!((forces - momentum).torque.length() < 1e-11, "{forces:?} {momentum:?}");
        }
    }

    #[test]
    fn no_point_of_the_tool_goes_further_than_a_tick_may() {
        let body = Body { pose: body(), twist: Twist::ZERO };
        let twist = Twist { linear: along() * 0.3, angular: about() * 10.0 };
        // 0.3 mm and 0.2 mm at the radius.
        let free = body.moved(twist, PERIOD_S, RADIUS_M, 0.6e-3);
        assert_eq!(free.twist, twist);
        assert_eq!(free.pose, body.pose.stepped(along() * 0.3e-3, about() * 0.01));
        let cut = body.moved(twist, PERIOD_S, RADIUS_M, 0.2e-3);
        assert!((cut.twist.linear - along() * 0.12).length() < 1e-12);
        assert!((cut.twist.angular - about() * 4.0).length() < 1e-12);
        let way = cut.pose.translation - body.pose.translation;
        assert!((way - along() * 0.12e-3).length() < 1e-15);
        assert!((body.pose.rotation_to(cut.pose) - about() * 4e-3).length() < 1e-12);

        let target = body.pose.stepped(along() * 0.3e-3, about() * 0.01);
        let followed = |most_m| body.followed((target, twist), RADIUS_M, most_m);
        assert_eq!(followed(0.6e-3), Body { pose: target, twist });
        let part = followed(0.2e-3);
        assert_eq!(part.twist, twist);
        assert!((part.pose.translation - cut.pose.translation).length() < 1e-15);
        assert!(part.pose.rotation_to(cut.pose).length() < 1e-12);
        let lost = Pose { translation: DVec3::NAN, ..target };
        assert!(!body.followed((lost, twist), RADIUS_M, 0.2e-3).pose.is_finite());
    }
}
