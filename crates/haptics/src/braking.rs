//! Pre-contact braking: the virtual tool loses half of its approach speed with every tick that it
//! spends just ahead of a surface.
//!
//! Data in: the points ahead of contact, the velocity of the tool. Data out: a damper on the
//! velocity of the centre of mass, along one direction. It has no torque and takes energy only; it
//! never turns a velocity round, and what recedes is left alone.
//!
//! n is the way out of the obstacle at a point. The speed s = −n · v at which the point approaches
//! counts where it is positive. The brake acts along d, the direction of Σ s n, on v_a = −v_cm · d,
//! and takes the share ρ of it:
//!
//! ```text
//! ρ = ½ v_a |Σ s n| / Σ s²,   at most ½
//! ```
//! which is ½ for every pure translation, whichever way the surfaces look; less where rotation
//! makes them approach faster than the middle.
//!
//! # Source
//! McNeely1999: F = −b (v·n) n on points in proximity voxels, b such that the kinetic energy along
//! the approach is gone in one cycle. With its b = m v_a²/(2 T Σ s²) the speed falls by ρ. Ours:
//! the bound of ρ, n from the obstacle and not from the point (which is the same in a contact that
//! is seen well, and does not brake a face that slides by), and the step: F is taken at the end of
//! the tick (implicitly), with the b that gives the same ρ there.

use glam::DVec3;

use super::RenderScene;
use super::coupling::Body;
use vps::contact::{Contact, ContactSum, Proximity, SimdLevel, Traversal};
use vps::spatial::{Mat6, Twist};

/// Share of the approach speed that a tick takes away.
const SHARE: f64 = 0.5;

/// What finds the points ahead of contact.
#[derive(Clone, Debug)]
pub(super) struct Braking {
    proximity: Proximity,
}

impl Braking {
    /// Where the scene asks for it and the virtual tool has a mass. Allocates; RT: start-up only.
    pub(super) fn of(scene: &RenderScene) -> Option<Self> {
        let p = &scene.parameters;
        (p.contact.braking && p.coupling.mode.has_mass()).then(|| Self {
            proximity: Proximity::new(SimdLevel::best(), &scene.obstacles, &scene.tool.shell),
        })
    }

    /// The brake at this pose and velocity; `None` when nothing approaches. `contact`: what
    /// `traversal` found at this pose. RT: safe.
    pub(super) fn brake(
        &mut self,
        scene: &RenderScene,
        traversal: &Traversal,
        body: &Body,
        contact: &ContactSum,
    ) -> Option<Brake> {
        if body.twist == Twist::ZERO {
            return None;
        }
        let to_body = body.pose.rotation.conjugate();
        let twist =
            Twist { linear: to_body * body.twist.linear, angular: to_body * body.twist.angular };
        let mut approach = Approach::default();
        let obstacles = &scene.obstacles;
        let shell = &scene.tool.shell;
        self.proximity.visit(traversal, obstacles, shell, body.pose, contact, |point| {
            approach.add(point, twist)
        });
        approach
            .brake(twist)
            .map(|brake| Brake { direction: body.pose.rotation * brake.direction, ..brake })
    }
}

/// Sums over the points that approach.
#[derive(Clone, Copy, Debug, Default)]
struct Approach {
    /// Σ s n, m/s.
    along: DVec3,
    /// Σ s², m²/s².
    squares: f64,
}

impl Approach {
    fn add(&mut self, point: &Contact, twist: Twist) {
        let arm = point.arm_body.as_dvec3();
        let normal = point.normal_body.as_dvec3();
        let speed = -normal.dot(twist.linear + twist.angular.cross(arm));
        if speed > 0.0 {
            let weight = f64::from(point.weight);
            self.along += normal * (weight * speed);
            self.squares += weight * speed * speed;
        }
    }

    fn brake(&self, twist: Twist) -> Option<Brake> {
        let direction = self.along.try_normalize()?;
        let speed = -direction.dot(twist.linear);
        let share = (SHARE * speed * self.along.length() / self.squares).min(SHARE);
        (share > 0.0).then_some(Brake { direction, share })
    }
}

/// Takes a share of the velocity along a direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Brake {
    /// Unit vector away from what is approached, world axes.
    direction: DVec3,
    /// Of the velocity, up to a half.
    share: f64,
}

impl Brake {
    /// The damper that takes this share from a free mass in one implicit step: (m + T b) v' = m v;
    /// N·s/m in its linear block.
    pub(super) fn damping(&self, mass_kg: f64, period_s: f64) -> Mat6 {
        let mut damping = Mat6::ZERO;
        damping.add_outer(
            mass_kg / period_s * self.share / (1.0 - self.share),
            self.direction,
            DVec3::ZERO,
        );
        damping
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::CouplingMode;
    use crate::testing::{parameters, skew_scene};

    fn point(normal: DVec3, arm: DVec3) -> Contact {
        let arm_body = arm.as_vec3();
        let normal_body = normal.normalize().as_vec3();
        Contact::of_point(0, 1e-4, arm_body, normal_body)
    }

    fn brake(points: &[Contact], twist: Twist) -> Option<Brake> {
        let mut approach = Approach::default();
        points.iter().for_each(|point| approach.add(point, twist));
        approach.brake(twist)
    }

    fn sliding(linear: DVec3) -> Twist {
        Twist { linear, angular: DVec3::ZERO }
    }

    #[test]
    fn a_translation_loses_half_of_its_approach_however_the_surfaces_look() {
        let floor = [point(DVec3::Z, DVec3::ZERO); 7];
        let brake_of_floor = brake(&floor, sliding(DVec3::new(0.3, 0.0, -0.1)))
            .unwrap_or_else(|| unreachable!("it approaches"));
        assert!(
            (brake_of_floor.share - 0.5).abs() < 1e-9
                && (brake_of_floor.direction - DVec3::Z).length() < 1e-9
        );
        let ball = [
            DVec3::new(0.3, 0.1, 1.0),
            DVec3::new(-0.5, 0.4, 1.0),
            DVec3::new(0.1, -0.8, 1.0),
            DVec3::X,
        ];
        let points = ball.map(|normal| point(normal, DVec3::ZERO));
        let brake_of_ball = brake(&points, sliding(DVec3::new(0.01, 0.02, -0.1)))
            .unwrap_or_else(|| unreachable!("it approaches"));
        assert!((brake_of_ball.share - 0.5).abs() < 1e-6, "{brake_of_ball:?}");
    }

    #[test]
    fn what_recedes_rests_or_only_turns_is_left_alone() {
        let floor = [point(DVec3::Z, DVec3::X), point(DVec3::Z, DVec3::NEG_X)];
        for linear in [DVec3::Z, DVec3::X, DVec3::ZERO] {
            assert_eq!(brake(&floor, sliding(linear)), None);
        }
        assert_eq!(
            brake(&floor, Twist { linear: DVec3::ZERO, angular: DVec3::Y }),
            None,
            "no torque, so nothing to do"
        );
        assert_eq!(brake(&[], sliding(DVec3::NEG_Z)), None);
    }

    /// Whatever moves, and however: the damper takes at most half of one component, and gives
    /// nothing.
    #[test]
    fn energy_only_falls_and_no_component_changes_its_sign() {
        let mut random = vps::spatial::testing::Random(3);
        let mut vector = |length: f64| random.in_box(-length, length);
        let mass_kg = 0.1;
        let period_s = 1e-3;
        let mut n_braked = 0;
        for _ in 0..2000 {
            let points: [Contact; 5] =
                core::array::from_fn(|_| point(vector(1.0) + DVec3::Z * 0.7, vector(0.05)));
            let twist = Twist { linear: vector(0.3), angular: vector(5.0) };
            let Some(brake) = brake(&points, twist) else { continue };
            n_braked += 1;
            let damping = brake.damping(mass_kg, period_s);
            let (force, torque) = damping.mul(twist.linear, twist.angular);
            assert!(force.dot(twist.linear) >= 0.0 && torque == DVec3::ZERO);
            let before = brake.direction.dot(twist.linear);
            let factor = 1.0
                / (1.0
                    + period_s / mass_kg
                        * damping.mul(brake.direction, DVec3::ZERO).0.dot(brake.direction));
            assert!(before < 0.0 && (0.5 - 1e-12..1.0).contains(&factor), "{brake:?}");
        }
        assert!(n_braked > 500, "{n_braked}");
    }

    #[test]
    fn points_count_by_what_they_stand_for() {
        let light = Contact { weight: 0.5, ..point(DVec3::Z, DVec3::X * 0.01) };
        let heavy = Contact { weight: 3.0, ..point(DVec3::new(0.6, 0.0, 0.8), DVec3::Y * 0.02) };
        let linear = DVec3::new(-0.02, 0.0, -0.05);
        let twist = Twist { linear, angular: DVec3::new(3.0, 4.0, 0.0) };
        let brake = brake(&[light, heavy], twist).unwrap_or_else(|| unreachable!("it approaches"));
        let speed = |point: &Contact| {
            let normal = point.normal_body.as_dvec3();
            (-normal.dot(twist.linear + twist.angular.cross(point.arm_body.as_dvec3())), normal)
        };
        let ((one, first), (other, second)) = (speed(&light), speed(&heavy));
        let along = first * (0.5 * one) + second * (3.0 * other);
        let squares = 0.5 * one * one + 3.0 * other * other;
        let approach = -along.normalize().dot(twist.linear);
        let share = 0.5 * approach * along.length() / squares;
        assert!(one > 0.0 && other > 0.0 && share < 0.5, "{one} {other} {share}");
        assert!((brake.share - share).abs() < 1e-9, "{brake:?} {share}");
        assert!((brake.direction - along.normalize()).length() < 1e-9);
    }

    #[test]
    fn only_a_scene_that_asks_for_it_brakes_and_only_a_tool_with_mass() {
        for (braking, mode, brakes) in [
            (true, CouplingMode::Implicit, true),
            (false, CouplingMode::Implicit, false),
            (true, CouplingMode::Constraint, false),
        ] {
            let mut p = parameters();
            p.contact.braking = braking;
            p.coupling.mode = mode;
            assert_eq!(Braking::of(&skew_scene(p)).is_some(), brakes, "{braking} {mode:?}");
        }
    }
}
