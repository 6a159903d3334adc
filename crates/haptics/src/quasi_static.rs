//! Static coupling: a virtual tool without mass, at the pose where coupling and contact balance.
//!
//! Data in: contact wrench and stiffness at the present pose, the coupling spring. Data out: the
//! step to the next pose. No velocity, no inertia: nothing is felt but spring and contact.
//!
//! One Newton step per tick on W_spring(x) + W_contact(x) = 0. The matrix K_spring + K_contact is
//! positive definite by itself (the secant stiffness of the spring is above zero in all six axes,
//! the Gauss-Newton contact stiffness is not below), so it is solved in free space and on one flat
//! contact like everywhere else.
//!
//! A plain Newton step is not safe across the edge of contact: outside it knows no wall and steps
//! deep in, inside it knows nothing but wall and steps far out, for ever. So the stiffness that was
//! met is remembered and halved with every tick ([`MEMORY`]), and added to what is met now. In
//! steady contact that makes twice the stiffness, so each step takes away half of the residual and
//! the tool settles from inside; where contact comes and goes the sum does not fall below half of
//! what is really there, which is what a Newton-like step needs to descend; in free space the
//! memory is gone in a few ticks.
//!
//! # Source
//! BarbicJames2008 (static virtual coupling); the remembered stiffness is ours.

use glam::{DMat3, DVec3};

use super::coupling::Spring;
use vps::spatial::{Mat6, Wrench};

/// Share of the remembered stiffness that is left one tick later.
const MEMORY: f64 = 0.5;

/// Share of the spring's stiffness below which a remembered contact is forgotten.
const FORGOTTEN: f64 = 1e-6;

/// What the static coupling remembers of the ticks before.
#[derive(Clone, Copy, Debug)]
pub(super) struct StaticBalance {
    /// Σ ½ⁿ⁺¹ K_contact of n ticks ago; N/m, N, N·m/rad.
    remembered: Mat6,
}

impl Default for StaticBalance {
    fn default() -> Self {
        Self { remembered: Mat6::ZERO }
    }
}

impl StaticBalance {
    /// Step (m, rad; world) towards the balance of spring, weight and contact. `None` only on
    /// non-finite input. RT: safe; one 6×6 LDLᵀ.
    pub(super) fn step(
        &mut self,
        spring: &Spring,
        weight: DVec3,
        contact: Wrench,
        stiffness: &Mat6,
    ) -> Option<(DVec3, DVec3)> {
        self.remembered =
            Mat6::ZERO.plus_scaled(MEMORY, &self.remembered.plus_scaled(1.0, stiffness));
        let (along, about) = self.remembered.traces();
        if along <= FORGOTTEN * spring.stiffness_n_per_m
            && about <= FORGOTTEN * spring.stiffness_nm_per_rad
        {
            self.remembered = Mat6::ZERO;
        }
        let identity = DMat3::IDENTITY;
        let springs = Mat6::from_blocks(
            identity * spring.stiffness_n_per_m,
            DMat3::ZERO,
            DMat3::ZERO,
            identity * spring.stiffness_nm_per_rad,
        );
        let residual = spring.wrench + contact + Wrench::new(weight, DVec3::ZERO);
        springs.plus_scaled(1.0, stiffness).plus_scaled(1.0, &self.remembered).solve_spd(residual)
    }
}

#[cfg(test)]
#[expect(
    clippy::disallowed_types,
    clippy::disallowed_macros,
    clippy::indexing_slicing,
    clippy::expect_used,
    reason = "test code"
)]
mod tests {
    use super::*;
    use crate::filter::entry_weight;
    use crate::params::LimitParameters;
    use crate::testing::parameters;
    use vps::spatial::Pose;

    const VOXEL_M: f64 = 5e-4;
    const RADIUS_M: f64 = 9e-3;

    /// Outward-pushing half-spaces n · p ≥ offset, and a block of points that they push.
    struct Penalty {
        walls: Vec<(DVec3, f64)>,
        stiffness_n_per_m: f64,
        spatial: bool,
    }

    impl Penalty {
        fn at(&self, body: Pose) -> (Wrench, Mat6) {
            let mut wrench = Wrench::ZERO;
            let mut stiffness = Mat6::ZERO;
            let edge = [-5.0, -2.5, 0.0, 2.5, 5.0];
            for (x, y, z) in (0..125).map(|n| (edge[n % 5], edge[n / 5 % 5], edge[n / 25])) {
                let arm = body.rotation * (DVec3::new(x, y, z) * 1e-3);
                for (normal, offset_m) in &self.walls {
                    let depth_m = offset_m - normal.dot(body.translation + arm);
                    if depth_m > 0.0 {
                        let (weight, slope) =
                            if self.spatial { entry_weight(depth_m, VOXEL_M) } else { (1.0, 0.0) };
                        let force = *normal * (self.stiffness_n_per_m * depth_m * weight);
                        let moment = arm.cross(*normal);
                        wrench = wrench + Wrench::new(force, arm.cross(force));
                        stiffness.add_outer(
                            self.stiffness_n_per_m * (weight + depth_m * slope),
                            *normal,
                            moment,
                        );
                    }
                }
            }
            (wrench, stiffness)
        }
    }

    /// Newtons; a torque counts by the force at the radius.
    fn size(wrench: Wrench) -> f64 {
        wrench.force.length() + wrench.torque.length() / RADIUS_M
    }

    /// Residuals of W_spring + W_contact, tick by tick, with the clamps of the tick, and the pose
    /// at the end.
    fn settle(penalty: &Penalty, target: Pose, n_ticks: usize) -> (Vec<f64>, Pose) {
        let limits = LimitParameters { force_n: 12.0, torque_nm: 0.2, ..parameters().limits };
        let coupling = parameters().coupling;
        let mut balance = StaticBalance::default();
        let mut body = Pose::from_translation(DVec3::Z * 6e-3);
        let mut residuals = Vec::new();
        for _ in 0..n_ticks {
            let (contact, stiffness) = penalty.at(body);
            let spring = Spring::between(body, target, &coupling, &limits, VOXEL_M, RADIUS_M);
            residuals.push(size(spring.wrench + contact));
            let (linear, angular) =
                balance.step(&spring, DVec3::ZERO, contact, &stiffness).expect("positive definite");
            let step_m = linear.length() + angular.length() * RADIUS_M;
            let share = (0.5 * VOXEL_M / step_m).min(1.0);
            body = body.stepped(linear * share, angular * share);
        }
        (residuals, body)
    }

    fn floor() -> (DVec3, f64) {
        (DVec3::Z, 0.0)
    }

    /// The static half of acceptance test 18.
    #[test]
    fn acceptance_18_the_residual_of_the_static_balance_decreases_over_ticks() {
        let tilted = Pose::new(
            glam::DQuat::from_scaled_axis(DVec3::new(0.05, 0.02, 0.1)),
            DVec3::new(1e-3, 2e-3, 4e-3),
        );
        let corner = vec![floor(), (DVec3::NEG_X, -5e-3), (DVec3::NEG_Y, -5e-3)];
        let slot = vec![floor(), (DVec3::NEG_X, -5e-3), (DVec3::X, -4.9e-3)];
        for (what, walls) in [("plane", vec![floor()]), ("corner", corner), ("slot", slot)] {
            for stiffness_n_per_m in [1.0, 100.0, 1e4, 1e6, 1e8] {
                for spatial in [false, true] {
                    let penalty = Penalty { walls: walls.clone(), stiffness_n_per_m, spatial };
                    let (residuals, _) = settle(&penalty, tilted, 200);
                    let what = format!("{what}, {stiffness_n_per_m} N/m, entry weight {spatial}");
                    // What rounding of a pose leaves is stiffness times 1e-17 m or so.
                    let rounding_n = 1e-9 + 1e-14 * stiffness_n_per_m;
                    let end = residuals.last().copied().expect("ticks");
                    let half = residuals.get(100).copied().expect("ticks");
                    assert!(
                        end <= rounding_n.max(1e-6 * residuals.first().expect("ticks")),
                        "{what}: {end} N left, {half} N halfway"
                    );
                    // After the way to the wall and the turn onto it, every tenth tick is better
                    // than the one before.
                    for (n, pair) in residuals.windows(11).enumerate().skip(60) {
                        let [before, .., after] = pair else { unreachable!("eleven") };
                        assert!(
                            after <= before || *after <= rounding_n,
                            "{what}: {before} N, ten ticks later {after} N, tick {n}"
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn in_free_space_it_is_at_the_target_as_soon_as_the_clamp_lets_it() {
        let target = Pose::new(glam::DQuat::from_rotation_x(0.1), DVec3::new(1e-3, 0.0, 8e-3));
        let (residuals, body) = settle(
            &Penalty { walls: Vec::new(), stiffness_n_per_m: 1.0, spatial: true },
            target,
            30,
        );
        assert!(
            (body.translation - target.translation).length() < 1e-12
                && body.rotation_to(target).length() < 1e-9
        );
        assert!(residuals.last().is_some_and(|residual| *residual < 1e-9));
    }

    #[test]
    fn a_contact_that_is_left_is_forgotten() {
        let spring = |x_m: f64| {
            let p = parameters();
            Spring::between(
                Pose::from_translation(DVec3::X * x_m),
                Pose::IDENTITY,
                &p.coupling,
                &p.limits,
                VOXEL_M,
                RADIUS_M,
            )
        };
        let mut balance = StaticBalance::default();
        let mut stiff = Mat6::ZERO;
        stiff.add_outer(1e6, DVec3::X, DVec3::ZERO);
        balance.step(&spring(1e-4), DVec3::ZERO, Wrench::ZERO, &stiff).expect("finite");
        let mut x_m = 1e-4;
        for _ in 0..20 {
            let (linear, _) =
                balance.step(&spring(x_m), DVec3::ZERO, Wrench::ZERO, &Mat6::ZERO).expect("finite");
            x_m += linear.x;
        }
        assert!(x_m.abs() < 1e-6, "{x_m} m from the target 20 ticks after the contact");
        for _ in 0..60 {
            balance.step(&spring(1e-4), DVec3::ZERO, Wrench::ZERO, &Mat6::ZERO).expect("finite");
        }
        assert_eq!(balance.remembered, Mat6::ZERO, "no trail of ever smaller numbers");
    }
}
