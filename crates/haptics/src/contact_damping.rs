//! Contact damping: a damper behind each face of the tool that touches, along its normal.
//!
//! Data in: the faces that touch, the velocity that a tick would give without dampers. Data out:
//! the velocity with them.
//!
//! One damper per face, so it does not grow with the area, unlike the damping ratio, which goes
//! with the stiffness. It resists both ways, but never so much that a face would pull: its
//! coefficient is cut to what the face still presses with at the velocity without dampers, which a
//! damper of its own can only lower; what several do to each other is looked at, and all are halved
//! until none pulls.
//!
//! The dampers form Σ c w wᵀ, w = (n, r × n): symmetric and positive semi-definite, so they take
//! energy only, and the implicit step stays solvable.
//!
//! # Source
//! Ours. That a contact must not pull: Hunt, Crossley, "Coefficient of restitution interpreted as
//! damping in vibroimpact", 1975.

use glam::DVec3;

use vps::contact::{FACES, Patch};
use vps::spatial::{Mat6, Twist};

/// How often all dampers are halved before a tick does without.
const HALVINGS: usize = 4;

/// Damper of one face.
#[derive(Clone, Copy, Debug)]
struct Damper {
    normal: DVec3,
    /// r × n, m.
    moment: DVec3,
    /// What it presses with now, N.
    force_n: f64,
    /// How much less of that when it recedes, and of what else damps it, N·s/m.
    loss_n_s_per_m: f64,
    coefficient_n_s_per_m: f64,
}

impl Damper {
    fn speed(&self, twist: Twist) -> f64 {
        self.normal.dot(twist.linear) + self.moment.dot(twist.angular)
    }

    /// What the face presses with at a velocity, apart from the damper, N.
    fn presses_n(&self, speed: f64) -> f64 {
        (self.force_n - self.loss_n_s_per_m * speed).max(0.0)
    }

    fn pulls(&self, share: f64, twist: Twist) -> bool {
        let speed = self.speed(twist);
        speed > 0.0
            && share * self.coefficient_n_s_per_m * speed > self.presses_n(speed) * (1.0 + 1e-9)
    }
}

/// The velocity with a damper of `damping_n_s_per_m` behind each of `patches`, or `undamped`, which
/// is the one without, where they would pull all the same. `spring_s`: over how long a velocity
/// changes the force of a face within the tick, times its stiffness. `solve`: the velocity for a
/// sum of dampers. `None` only where `solve` gives none. RT: safe; two solves, at most [`HALVINGS`]
/// more.
pub(super) fn damped(
    patches: impl Iterator<Item = Patch>,
    damping_n_s_per_m: f64,
    spring_s: f64,
    undamped: Twist,
    mut solve: impl FnMut(&Mat6) -> Option<Twist>,
) -> Option<Twist> {
    let mut dampers = [None; FACES];
    for (patch, slot) in patches.zip(&mut dampers) {
        let normal = patch.normal_world;
        let moment = patch.arm_world.cross(patch.normal_world);
        let loss_n_s_per_m = spring_s * patch.stiffness_n_per_m;
        let damper = Damper {
            normal,
            moment,
            force_n: patch.force_n,
            loss_n_s_per_m,
            coefficient_n_s_per_m: damping_n_s_per_m,
        };
        let speed = damper.speed(undamped);
        let most = if speed > 0.0 { damper.presses_n(speed) / speed } else { f64::INFINITY };
        *slot = Some(Damper { coefficient_n_s_per_m: damping_n_s_per_m.min(most), ..damper });
    }
    let mut share = 1.0;
    for _ in 0..=HALVINGS {
        let mut damping = Mat6::ZERO;
        for damper in dampers.iter().flatten() {
            damping.add_outer(share * damper.coefficient_n_s_per_m, damper.normal, damper.moment);
        }
        let twist = solve(&damping)?;
        if !dampers.iter().flatten().any(|damper| damper.pulls(share, twist)) {
            return Some(twist);
        }
        share *= 0.5;
    }
    Some(undamped)
}

#[cfg(test)]
#[expect(
    clippy::disallowed_types,
    clippy::disallowed_macros,
    clippy::expect_used,
    reason = "test code"
)]
mod tests {
    use super::*;
    use crate::coupling::on_diagonal;
    use crate::testing::product;
    use vps::spatial::Wrench;
    use vps::spatial::testing::Random;

    const PERIOD_S: f64 = 1e-3;
    const MASS_KG: f64 = 0.1;
    const INERTIA_KG_M2: f64 = 1e-5;

    fn vector(random: &mut Random, length: f64) -> DVec3 {
        random.in_box(-length, length)
    }

    fn patch(random: &mut Random, face: u8) -> Patch {
        Patch {
            face,
            force_n: 5.0 * random.signed().abs(),
            normal_world: vector(random, 1.0).normalize(),
            arm_world: vector(random, 0.03),
            radius_m: 0.01,
            stiffness_n_per_m: 1e4 * random.signed().abs(),
        }
    }

    fn mass() -> Mat6 {
        on_diagonal(MASS_KG, INERTIA_KG_M2)
    }

    /// The faces push as they are: v' = (M + h D)⁻¹ (M v + h F).
    fn step(patches: &[Patch], twist: Twist, damping: &Mat6) -> Option<Twist> {
        let mut impulse = product(&mass(), twist);
        for patch in patches {
            let force = patch.normal_world * (patch.force_n * PERIOD_S);
            impulse = impulse + Wrench::new(force, patch.arm_world.cross(force));
        }
        let (linear, angular) = mass().plus_scaled(PERIOD_S, damping).solve_spd(impulse)?;
        Some(Twist { linear, angular })
    }

    fn energy_j(twist: Twist) -> f64 {
        0.5 * (MASS_KG * twist.linear.length_squared()
            + INERTIA_KG_M2 * twist.angular.length_squared())
    }

    #[test]
    fn dampers_are_symmetric_positive_semi_definite_and_no_face_ever_pulls() {
        let mut random = Random(11);
        let mut n_cut = 0;
        let mut n_full = 0;
        let mut n_without = 0;
        for _ in 0..4000 {
            let n_patches = 1 + (random.signed().abs() * 4.0) as u8;
            let patches: Vec<Patch> = (0..n_patches).map(|face| patch(&mut random, face)).collect();
            let linear = vector(&mut random, 0.2);
            let before = Twist { linear, angular: vector(&mut random, 5.0) };
            let undamped = step(&patches, before, &Mat6::ZERO).expect("positive definite");
            let mut used = Mat6::ZERO;
            let after = damped(patches.iter().copied(), 50.0, 0.0, undamped, |damping| {
                used = *damping;
                step(&patches, before, damping)
            })
            .expect("positive definite");
            for (i, row) in used.0.iter().enumerate() {
                for (j, entry) in row.iter().enumerate() {
                    let mirrored = used.0.get(j).and_then(|row| row.get(i)).expect("six by six");
                    assert!((entry - mirrored).abs() <= 1e-12 * used.traces().0);
                }
            }
            for _ in 0..10 {
                let linear = vector(&mut random, 1.0);
                let angular = vector(&mut random, 30.0);
                let (force, torque) = used.mul(linear, angular);
                assert!(force.dot(linear) + torque.dot(angular) >= -1e-12);
            }
            if after == undamped {
                n_without += 1;
                continue;
            }
            // What acted, face by face: coefficients from the matrix are those that were cut,
            // halved together or not.
            let share = (0..=HALVINGS).map(|n| 0.5_f64.powi(n as i32)).find(|share| {
                let mut sum = Mat6::ZERO;
                for patch in &patches {
                    sum.add_outer(
                        share * cut(patch, undamped),
                        patch.normal_world,
                        patch.arm_world.cross(patch.normal_world),
                    );
                }
                (sum.traces().0 - used.traces().0).abs() <= 1e-9 * used.traces().0
            });
            let share = share.expect("one of the halvings");
            for patch in &patches {
                let speed =
                    patch.normal_world.dot(after.linear + after.angular.cross(patch.arm_world));
                let total_n = patch.force_n - share * cut(patch, undamped) * speed;
                assert!(total_n >= -1e-6 * patch.force_n, "{total_n} N of {patch:?}");
            }
            if share < 1.0 {
                n_cut += 1
            } else {
                n_full += 1
            }
            // Passive: dampers alone, from the velocity that they act at, never add to the energy.
            let alone = step(&[], before, &used).expect("positive definite");
            assert!(energy_j(alone) <= energy_j(before) * (1.0 + 1e-12));
        }
        assert!(
            n_full > 3000 && n_cut > 0 && n_without < 40,
            "{n_full} as they are, {n_cut} cut, {n_without} without"
        );
    }

    fn cut(patch: &Patch, undamped: Twist) -> f64 {
        let speed =
            patch.normal_world.dot(undamped.linear + undamped.angular.cross(patch.arm_world));
        if speed > 0.0 { (patch.force_n / speed).min(50.0) } else { 50.0 }
    }

    const FLOOR: Patch = Patch {
        face: 0,
        force_n: 0.5,
        normal_world: DVec3::Z,
        arm_world: DVec3::ZERO,
        radius_m: 0.0,
        stiffness_n_per_m: 0.0,
    };

    #[test]
    fn a_face_that_leaves_is_let_go_and_one_that_comes_is_held_up() {
        let floor = Patch { stiffness_n_per_m: 1e4, ..FLOOR };
        let with = |speed: f64| {
            let before = Twist { linear: DVec3::Z * speed, angular: DVec3::ZERO };
            let undamped = step(&[floor], before, &Mat6::ZERO).expect("positive definite");
            let after = damped([floor].into_iter(), 100.0, 0.0, undamped, |damping| {
                step(&[floor], before, damping)
            });
            (undamped.linear.z, after.expect("positive definite").linear.z)
        };
        let (undamped, after) = with(-0.1);
        assert!(
            (after - undamped / 2.0).abs() < 1e-9,
            "100 N·s/m on 0.1 kg for 1 ms halve it: {after}"
        );
        // Leaving at 0.1 m/s, it would pull with 10 N; the face presses with 0.5 N, so that is all
        // that it loses.
        let (undamped, after) = with(0.1);
        assert!(after > 0.0999 && after < undamped, "{after}");
    }

    #[test]
    fn a_face_is_damped_by_what_it_still_presses_with_as_it_recedes() {
        let patch = Patch {
            normal_world: DVec3::new(2.0, -1.0, 2.0) / 3.0,
            arm_world: DVec3::new(0.02, 0.03, -0.01),
            stiffness_n_per_m: 1e3,
            ..FLOOR
        };
        let moment = patch.arm_world.cross(patch.normal_world);
        let twist =
            Twist { linear: DVec3::new(0.1, 0.05, 0.02), angular: DVec3::new(1.0, 2.0, -3.0) };
        let with = |twist: Twist, most: f64| {
            let mut used = Mat6::ZERO;
            let after = damped([patch].into_iter(), most, 2e-3, twist, |damping| {
                used = *damping;
                Some(twist)
            });
            assert_eq!(after, Some(twist));
            let (force, torque) = used.mul(patch.normal_world, DVec3::ZERO);
            let coefficient = force.dot(patch.normal_world);
            assert!((force - patch.normal_world * coefficient).length() < 1e-12);
            assert!((torque - moment * coefficient).length() < 1e-12);
            coefficient
        };
        // The speed of the contact point away from the wall, and what is left of 0.5 N there.
        let point = twist.linear + twist.angular.cross(patch.arm_world);
        let speed = point.dot(patch.normal_world);
        assert!(speed > 0.01 && speed < 0.2, "{speed}");
        let presses_n = 0.5 - 1e3 * 2e-3 * speed;
        assert!((with(twist, 500.0) - presses_n / speed).abs() < 1e-9);
        assert!((with(twist, 0.7) - 0.7).abs() < 1e-12);
        let towards = Twist { linear: -twist.linear, angular: -twist.angular };
        assert!((with(towards, 500.0) - 500.0).abs() < 1e-9);
    }

    #[test]
    fn dampers_that_pull_are_halved_until_none_does() {
        let at = |speed: f64| Twist { linear: DVec3::Z * speed, angular: DVec3::ZERO };
        let with = |speed: f64| {
            let mut coefficients = Vec::new();
            let after = damped([FLOOR].into_iter(), 100.0, 0.0, at(-0.1), |damping| {
                coefficients.push(damping.0[2][2]);
                Some(at(speed))
            });
            (after, coefficients)
        };
        // 0.5 N hold 100 N·s/m up to 5 mm/s, 25 N·s/m up to 20 mm/s.
        assert_eq!(with(4.9e-3), (Some(at(4.9e-3)), vec![100.0]));
        assert_eq!(with(19.9e-3), (Some(at(19.9e-3)), vec![100.0, 50.0, 25.0]));
        assert_eq!(with(1.0), (Some(at(-0.1)), vec![100.0, 50.0, 25.0, 12.5, 6.25]));
    }
}
