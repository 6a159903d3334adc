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

/// The virtual tool: pose of its axes at the centre of mass, and velocity of that point, world.
#[derive(Clone, Copy, Debug, PartialEq)]
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
    /// Contact damping per contact stiffness β, s.
    pub(super) damping_s: f64,
    /// Dampers beyond that: of the faces that touch, and of the brake; symmetric, positive
    /// semi-definite, N·s/m, N·s, N·m·s/rad.
    pub(super) damping: Option<Mat6>,
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
        let axes = self.pose.rotation_matrix();
        let identity = DMat3::IDENTITY;
        let mass = Mat6::from_blocks(
            identity * inertia.mass_kg,
            DMat3::ZERO,
            DMat3::ZERO,
            axes * inertia.body_kg_m2 * axes.transpose(),
        );
        let on_diagonal = |linear: f64, angular: f64| {
            Mat6::from_blocks(identity * linear, DMat3::ZERO, DMat3::ZERO, identity * angular)
        };
        let springs = on_diagonal(pull.spring.stiffness_n_per_m, pull.spring.stiffness_nm_per_rad);
        let dampers = on_diagonal(pull.damping.0, pull.damping.1);
        let mut system = mass
            .plus_scaled(h, &dampers)
            .plus_scaled(h * h, &springs)
            .plus_scaled(h * (h + contact.damping_s), &contact.stiffness);
        // What one more tick at the present velocity adds to spring and contact, and what contact
        // damping takes now.
        let mut resisting = Mat6::ZERO
            .plus_scaled(h, &springs)
            .plus_scaled(h + contact.damping_s, &contact.stiffness);
        if let Some(damping) = &contact.damping {
            system = system.plus_scaled(h, damping);
            resisting = resisting.plus_scaled(1.0, damping);
        }
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
