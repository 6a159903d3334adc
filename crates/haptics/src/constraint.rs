//! Constraint coupling: the tool stands where the hand wants it, as far as the surface allows.
//!
//! Data in: the deepest contacts, the step that the coupling alone would take. Data out: the
//! nearest step, in the metric of the coupling spring, that moves no contact deeper:
//!
//! ```text
//! minimise ½ (x − x_free)ᵀ K (x − x_free) − f·x + ½ xᵀ F x   subject to   w_j · x ≥ β (V_j − δ),
//!     w = (n, r × n),   K = diag(k_T, k_R),   friction (f, F)
//! ```
//!
//! The multipliers are contact forces in newtons; friction follows from them
//! ([`friction`](super::friction)).
//! δ ([`SLOP_VOXELS`]) is the depth at which the tool comes to rest, so that the contacts which
//! hold it stay known; β ([`SHARE_PER_TICK`]) is the share of an error that one tick takes away,
//! less than all of it as normal and gradient differ at edges.
//!
//! Each plane yields a little ([`SOFTNESS`]): a peg too thick for its hole, where nothing is
//! feasible, gets the balance of penalties instead of forces without bound. That also makes the
//! programme smooth: ½ |x − x_free|²_K + Σ ½ k_j max(0, violation_j)² is convex, its gradient
//! piecewise linear, and Newton's method on it, each step cut to the minimum along its line, ends
//! in a few 6×6 solves at the exact solution. No plane has to be chosen. Of the ticks before
//! only the deepest points are known: one that still touches keeps its plane, or steps would
//! alternate between two points.
//!
//! # Source
//! ZillesSalisbury1995 and Ortega2007 (god-object, three and six axes), Sagardia2016 (constraint
//! and penalty together); planes, slop and the solver are ours.

use glam::DVec3;

use super::coupling::on_diagonal;
use super::friction::FrictionWrench;
use super::params::CouplingParameters;
use vps::contact::planes::{DeepestContacts, MOST_PLANES};
use vps::contact::{Contact, FACES, Obstacle, Patch};
use vps::spatial::{Mat6, Pose, Wrench};

/// Depth at which the tool rests, in voxels of the object that it touches.
pub(super) const SLOP_VOXELS: f64 = 0.1;

/// Share of a depth error that one tick removes.
const SHARE_PER_TICK: f64 = 0.5;

/// Compliance of a plane as a share of the coupling's along it. So small that the depths of one
/// face differ by less than what decides between its points (at 0.01 a tilted block stepped from
/// one point to the next for ever), so large that a 6×6 solve keeps its digits.
const SOFTNESS: f64 = 1e-4;

/// Most Newton steps in one tick. It takes two on a plane, about five in a corner.
const NEWTON_STEPS: usize = 12;

/// Bisections of a step whose end is past the minimum of its line.
const BISECTIONS: usize = 20;

/// Share of the first gradient that counts as zero.
const CONVERGED: f64 = 1e-12;

/// Power of the cosine between a plane's normal and a face's with which they count as one wall's: a
/// half at 23°, next to nothing at 60°.
const SAME_WAY: i32 = 8;

/// One plane that holds the tool.
#[derive(Clone, Copy, Debug)]
struct Plane {
    normal: DVec3,
    /// r × n, m.
    moment: DVec3,
    /// How far the step has to go along w, m; negative: how far it may go against it.
    needed_m: f64,
    stiffness_n_per_m: f64,
}

impl Plane {
    /// How far the step falls short of what the plane needs, m.
    fn violation_m(&self, (linear, angular): (DVec3, DVec3)) -> f64 {
        self.needed_m - self.normal.dot(linear) - self.moment.dot(angular)
    }

    /// What it presses with at the end of the step, N.
    fn force_n(&self, step: (DVec3, DVec3)) -> f64 {
        self.stiffness_n_per_m * self.violation_m(step).max(0.0)
    }
}

/// What is minimised: spring, friction and planes.
struct Programme<'a> {
    free: (DVec3, DVec3),
    stiffness_n_per_m: f64,
    stiffness_nm_per_rad: f64,
    rubbing: &'a FrictionWrench,
    planes: &'a [Plane],
}

impl Programme<'_> {
    /// Minus the gradient: what pulls and pushes at a step.
    fn pull(&self, step: (DVec3, DVec3)) -> Wrench {
        let mut pull = Wrench::new(
            (self.free.0 - step.0) * self.stiffness_n_per_m,
            (self.free.1 - step.1) * self.stiffness_nm_per_rad,
        );
        let (force, torque) = self.rubbing.stiffness.mul(step.0, step.1);
        pull = pull + self.rubbing.wrench - Wrench::new(force, torque);
        for plane in self.planes {
            let force_n = plane.force_n(step);
            pull = pull + Wrench::new(plane.normal * force_n, plane.moment * force_n);
        }
        pull
    }

    /// The second derivative at a step.
    fn stiffness(&self, step: (DVec3, DVec3)) -> Mat6 {
        let mut stiffness = on_diagonal(self.stiffness_n_per_m, self.stiffness_nm_per_rad)
            .plus_scaled(1.0, &self.rubbing.stiffness);
        for plane in self.planes.iter().filter(|plane| plane.violation_m(step) > 0.0) {
            stiffness.add_outer(plane.stiffness_n_per_m, plane.normal, plane.moment);
        }
        stiffness
    }

    /// The minimum. `None` only on non-finite input.
    fn solve(&self) -> Option<(DVec3, DVec3)> {
        let mut step = self.free;
        let along = |wrench: Wrench, (linear, angular): (DVec3, DVec3)| {
            wrench.force.dot(linear) + wrench.torque.dot(angular)
        };
        let mut first = 0.0;
        for n in 0..NEWTON_STEPS {
            let pull = self.pull(step);
            let newton = self.stiffness(step).solve_spd(pull)?;
            // What the step gains at best; an energy, so that newtons and newton-metres compare.
            let gain = along(pull, newton);
            if n == 0 {
                first = gain;
            }
            if gain <= CONVERGED * first {
                break;
            }
            let at = |share: f64| (step.0 + newton.0 * share, step.1 + newton.1 * share);
            let mut low = 0.0;
            let mut high = 1.0;
            if along(self.pull(at(high)), newton) < -1e-9 * gain {
                // Past the minimum of the line: planes that were not known came in on the way.
                for _ in 0..BISECTIONS {
                    let middle = 0.5 * (low + high);
                    if along(self.pull(at(middle)), newton) > 0.0 {
                        low = middle;
                    } else {
                        high = middle;
                    }
                }
            }
            step = at(high);
        }
        Some(step)
    }
}

/// Unit direction in world axes out of an obstacle at a contact; the contact's own where there is
/// none. The poses are those at which the contact was found.
///
/// It is that of the mean over a voxel, which turns steadily: the gradient itself turns in steps at
/// the faces of cells, and a tool whose balance lies between two of these directions would go to
/// and fro across the face for ever. RT: safe, O(1).
pub(super) fn way_out(
    obstacle: &Obstacle,
    world_from_map: Pose,
    world_from_body: Pose,
    contact: &Contact,
) -> DVec3 {
    let point_map = world_from_map
        .inverse()
        .transform_point(world_from_body.transform_point(contact.arm_body.as_dvec3()));
    let cells = (point_map - obstacle.field.origin_map().as_dvec3())
        / f64::from(obstacle.field.voxel_size_m());
    match (-obstacle.field.mean_gradient(cells.as_vec3())).as_dvec3().try_normalize() {
        Some(normal_map) => world_from_map.transform_vector(normal_map),
        None => world_from_body.transform_vector(contact.normal_body.as_dvec3()),
    }
}

/// The planes of a tick.
#[derive(Clone, Debug)]
pub(super) struct Planes {
    slots: [Plane; MOST_PLANES],
    n_planes: usize,
}

impl Planes {
    /// Those of the deepest contacts. `body`: tool axes at the centre of mass; `way_out`: unit
    /// normal of the obstacle's surface at a contact, world axes (the point's own normal would hold
    /// a tool by its rounded edges); `slop_m`: depth at which the tool rests.
    ///
    /// RT: safe; O(contacts), at most [`MOST_PLANES`] of them.
    pub(super) fn of(
        body: Pose,
        coupling: &CouplingParameters,
        contacts: &DeepestContacts,
        way_out: impl Fn(usize, &Contact) -> DVec3,
        slop_m: f64,
    ) -> Self {
        let axes = body.rotation_matrix();
        let mut slots = [Plane {
            normal: DVec3::ZERO,
            moment: DVec3::ZERO,
            needed_m: 0.0,
            stiffness_n_per_m: 0.0,
        }; MOST_PLANES];
        let mut n_planes = 0;
        for ((obstacle_idx, contact), slot) in contacts.iter().zip(&mut slots) {
            let normal = way_out(*obstacle_idx, contact);
            let moment = (axes * contact.arm_body.as_dvec3()).cross(normal);
            let give = 1.0 / coupling.stiffness_n_per_m
                + moment.length_squared() / coupling.stiffness_nm_per_rad;
            *slot = Plane {
                normal,
                moment,
                needed_m: SHARE_PER_TICK * (f64::from(contact.depth_m) - slop_m),
                stiffness_n_per_m: 1.0 / (SOFTNESS * give),
            };
            n_planes += 1;
        }
        Self { slots, n_planes }
    }

    fn planes(&self) -> &[Plane] {
        self.slots.get(..self.n_planes).unwrap_or_default()
    }

    /// The step (m, rad; world) that they and `rubbing` leave of the free step. `None` only on
    /// non-finite input. RT: safe; O(planes) for each of [`NEWTON_STEPS`], and of [`BISECTIONS`]
    /// where one ends past its minimum. Deterministic.
    pub(super) fn step(
        &self,
        free: (DVec3, DVec3),
        coupling: &CouplingParameters,
        rubbing: &FrictionWrench,
    ) -> Option<(DVec3, DVec3)> {
        Programme {
            free,
            stiffness_n_per_m: coupling.stiffness_n_per_m,
            stiffness_nm_per_rad: coupling.stiffness_nm_per_rad,
            rubbing,
            planes: self.planes(),
        }
        .solve()
    }

    /// What presses each face of the tool at the end of a step, N: each plane's force, shared by
    /// the faces that touch its way as their contact has it. A plane stands for points at the rim of
    /// what touches, where a face may be next to nothing. RT: safe, O([`FACES`] · planes).
    pub(super) fn pressed_n<'a>(
        &self,
        step: (DVec3, DVec3),
        patches: impl Iterator<Item = &'a Patch> + Clone,
    ) -> [f64; FACES] {
        let mut faces = [0.0; FACES];
        for plane in self.planes() {
            let force_n = plane.force_n(step);
            if force_n == 0.0 {
                continue;
            }
            let mut shares = [0.0; FACES];
            for patch in patches.clone() {
                if let Some(share) = shares.get_mut(usize::from(patch.face)) {
                    let cosine = plane.normal.dot(patch.normal_world).max(0.0);
                    *share = patch.force_n * cosine.powi(SAME_WAY);
                }
            }
            let all = shares.iter().sum::<f64>().max(f64::MIN_POSITIVE);
            for (pressed_n, share) in faces.iter_mut().zip(shares) {
                *pressed_n += force_n * (share / all);
            }
        }
        faces
    }
}

#[cfg(test)]
#[expect(
    clippy::disallowed_types,
    clippy::indexing_slicing,
    clippy::expect_used,
    reason = "test code"
)]
mod tests {
    use glam::DQuat;

    use super::*;
    use crate::testing::parameters;
    use vps::{mesh::primitives::Shape, part::Part, voxmap::Options};

    const SLOP_M: f64 = 5e-5;

    fn coupling() -> CouplingParameters {
        CouplingParameters {
            stiffness_n_per_m: 1300.0,
            stiffness_nm_per_rad: 0.45,
            ..CouplingParameters::PLAIN
        }
    }

    /// Of that coupling.
    fn programme(free: (DVec3, DVec3), planes: &[Plane]) -> Programme<'_> {
        let CouplingParameters { stiffness_n_per_m, stiffness_nm_per_rad, .. } = coupling();
        let rubbing = &FrictionWrench::ZERO;
        Programme { free, stiffness_n_per_m, stiffness_nm_per_rad, rubbing, planes }
    }

    /// Without friction.
    fn step(
        free: (DVec3, DVec3),
        body: Pose,
        coupling: &CouplingParameters,
        contacts: &DeepestContacts,
        way_out: impl Fn(usize, &Contact) -> DVec3,
    ) -> Option<(DVec3, DVec3)> {
        Planes::of(body, coupling, contacts, way_out, SLOP_M).step(
            free,
            coupling,
            &FrictionWrench::ZERO,
        )
    }

    /// Points of a block against half-spaces n · p ≥ offset.
    fn contacts(walls: &[(DVec3, f64)], body: Pose) -> DeepestContacts {
        let mut deepest = DeepestContacts::default();
        let edge = [-5.0, -2.5, 0.0, 2.5, 5.0];
        for (point_idx, (x, y, z)) in
            (0..).zip((0..125).map(|n| (edge[n % 5], edge[n / 5 % 5], edge[n / 25])))
        {
            let arm_body = DVec3::new(x, y, z) * 1e-3;
            for (normal, offset_m) in walls {
                let depth_m = offset_m - normal.dot(body.transform_point(arm_body));
                if depth_m > 0.0 {
                    let normal_body = (body.rotation.conjugate() * *normal).as_vec3();
                    deepest.add(
                        0,
                        &Contact::of_point(
                            point_idx,
                            depth_m as f32,
                            arm_body.as_vec3(),
                            normal_body,
                        ),
                    );
                }
            }
        }
        deepest
    }

    fn deepest_m(contacts: &DeepestContacts) -> f64 {
        contacts.iter().map(|(_, contact)| f64::from(contact.depth_m)).fold(0.0, f64::max)
    }

    /// Ticks with the clamp of the tick; the pose at the end, how deep it is, and its last step.
    fn settle(walls: &[(DVec3, f64)], target: Pose, n_ticks: usize) -> (Pose, f64, f64) {
        let mut body = Pose::from_translation(DVec3::Z * 6e-3);
        let mut last_m = 0.0;
        for _ in 0..n_ticks {
            let free = (target.translation - body.translation, body.rotation_to(target));
            let way_out = |_, contact: &Contact| body.rotation * contact.normal_body.as_dvec3();
            let contacts = contacts(walls, body);
            let (linear, angular) =
                step(free, body, &parameters().coupling, &contacts, way_out).expect("finite");
            let step_m = linear.length() + angular.length() * 9e-3;
            let share = (0.25e-3 / step_m).min(1.0);
            body = body.stepped(linear * share, angular * share);
            last_m = step_m * share;
        }
        (body, deepest_m(&contacts(walls, body)), last_m)
    }

    const FLOOR: (DVec3, f64) = (DVec3::Z, 0.0);

    #[test]
    fn it_rests_at_the_slop() {
        let target = Pose::from_translation(DVec3::new(1e-3, 0.0, 3e-3));
        let (body, deep_m, last_m) = settle(&[FLOOR], target, 100);
        assert!(deep_m > 0.99 * SLOP_M && deep_m < SLOP_M + 1e-6, "{deep_m} m deep");
        assert!(last_m < 1e-9, "still moving by {last_m} m per tick");
        assert!(
            (body.translation.x - target.translation.x).abs() < 1e-9
                && body.rotation_to(target).length() < 1e-7
        );
    }

    #[test]
    fn a_corner_holds_three_ways_and_a_turned_block_lies_down_flat() {
        let walls = [FLOOR, (DVec3::NEG_X, -5e-3), (DVec3::NEG_Y, -5e-3)];
        let target = Pose::new(
            DQuat::from_scaled_axis(DVec3::new(0.02, -0.01, 0.03)),
            DVec3::new(2e-3, 3e-3, 3e-3),
        );
        let (body, deep_m, last_m) = settle(&walls, target, 300);
        assert!(deep_m < 2.0 * SLOP_M, "{deep_m} m deep");
        assert!(last_m < 1e-8, "still moving by {last_m} m per tick");
        assert!(
            body.translation.x < 1e-4 && body.translation.y < 1e-4 && body.translation.z > 4.9e-3,
            "{body:?}"
        );
        assert!(body.rotation.angle_between(DQuat::IDENTITY) < 0.02, "{body:?}");
    }

    #[test]
    fn a_slot_too_narrow_is_balanced() {
        // 0.2 mm too narrow on 10 mm: nothing is feasible.
        let walls = [FLOOR, (DVec3::NEG_X, -4.9e-3), (DVec3::X, -4.9e-3)];
        let (body, deep_m, last_m) =
            settle(&walls, Pose::from_translation(DVec3::new(1e-3, 0.0, 3e-3)), 400);
        assert!(body.translation.x.abs() < 1e-4, "in the middle: {body:?}");
        assert!(deep_m < 2e-4 && last_m < 1e-6, "{deep_m} m deep, {last_m} m per tick");
    }

    #[test]
    fn without_contact_the_step_is_the_free_one() {
        let free = (DVec3::new(1e-3, -2e-3, 3e-3), DVec3::new(0.1, 0.2, -0.3));
        let none = DeepestContacts::default();
        let taken = step(free, Pose::IDENTITY, &parameters().coupling, &none, |_, _| DVec3::Z);
        assert_eq!(taken, Some(free));
    }

    #[test]
    fn the_step_is_the_one_of_least_energy() {
        let mut random = vps::spatial::testing::Random(5);
        for n in 0..300 {
            let mut vector = |length: f64| random.in_box(-length, length);
            let planes: Vec<_> = (0..1 + n % 8)
                .map(|_| {
                    let normal = vector(1.0).normalize();
                    let needed_m = vector(1e-3).x;
                    let moment = vector(0.03);
                    Plane { normal, moment, needed_m, stiffness_n_per_m: 1e7 }
                })
                .collect();
            let free = (vector(2e-3), vector(0.1));
            let programme = programme(free, &planes);
            let energy = |(linear, angular): (DVec3, DVec3)| {
                let springs = 1300.0 * (linear - free.0).length_squared()
                    + 0.45 * (angular - free.1).length_squared();
                let pressed = |plane: &Plane| {
                    let gone_m = plane.normal.dot(linear) + plane.moment.dot(angular);
                    plane.stiffness_n_per_m * (plane.needed_m - gone_m).max(0.0).powi(2)
                };
                0.5 * (springs + planes.iter().map(pressed).sum::<f64>())
            };
            let step = programme.solve().expect("finite");
            let least = energy(step);
            for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
                for by in [-1.0, 1.0] {
                    let linear = energy((step.0 + axis * (by * 1e-6), step.1));
                    let angular = energy((step.0, step.1 + axis * (by * 3e-5)));
                    assert!(linear > least && angular > least, "{n}: {least} {linear} {angular}");
                }
            }
            // Away from it, what pulls is minus the slope of that energy.
            let at = (free.0 + vector(1e-3), free.1 + vector(0.05));
            let pull = programme.pull(at);
            for axis in [DVec3::X, DVec3::Y, DVec3::Z] {
                let h = 1e-9;
                let ahead = energy((at.0 + axis * h, at.1));
                let behind = energy((at.0 - axis * h, at.1));
                let slope = (ahead - behind) / (2.0 * h);
                assert!((pull.force.dot(axis) + slope).abs() < 1e-3 * pull.force.length() + 1e-3);
                let h = 1e-7;
                let ahead = energy((at.0, at.1 + axis * h));
                let behind = energy((at.0, at.1 - axis * h));
                let slope = (ahead - behind) / (2.0 * h);
                assert!((pull.torque.dot(axis) + slope).abs() < 1e-3 * pull.torque.length() + 1e-4);
            }
        }
    }

    #[test]
    fn one_plane_takes_the_step_back_along_what_the_coupling_gives() {
        let coupling = coupling();
        let body = Pose::new(DQuat::from_scaled_axis(DVec3::new(0.3, 0.9, -0.4)), DVec3::ONE);
        let arm_body = DVec3::new(0.02, -0.01, 0.03).as_vec3();
        let mut contacts = DeepestContacts::default();
        let normal_body = DVec3::Z.as_vec3();
        contacts.add(0, &Contact::of_point(0, 3e-4, arm_body, normal_body));
        let normal = DVec3::new(2.0, -1.0, 2.0) / 3.0;
        let free = (DVec3::new(-1e-3, 2e-3, -2e-3), DVec3::new(0.02, -0.03, 0.01));
        let taken = step(free, body, &coupling, &contacts, |_, _| normal).expect("finite");
        let moment = (body.rotation * arm_body.as_dvec3()).cross(normal);
        let needed_m = 0.5 * (f64::from(3e-4_f32) - SLOP_M);
        let gives = 1.0 / 1300.0 + moment.length_squared() / 0.45;
        let short_m = needed_m - normal.dot(free.0) - moment.dot(free.1);
        // The plane is ten thousand times as stiff as the coupling along it.
        let force_n = short_m / gives / (1.0 + 1e-4);
        assert!(force_n > 0.1, "{force_n}");
        assert!((taken.0 - free.0 - normal * (force_n / 1300.0)).length() < 1e-11);
        assert!((taken.1 - free.1 - moment * (force_n / 0.45)).length() < 1e-9);
    }

    #[test]
    fn planes_press_the_faces_that_touch_their_way() {
        let coupling = coupling();
        let mut deepest = DeepestContacts::default();
        for (point_idx, x) in (0..).zip([-0.01, 0.01]) {
            let arm_body = DVec3::new(x, 0.0, -0.01).as_vec3();
            let normal_body = DVec3::new(x.signum() * 0.3, 0.0, 1.0).normalize().as_vec3();
            deepest.add(0, &Contact::of_point(point_idx, 3e-4, arm_body, normal_body));
        }
        let planes = Planes::of(Pose::IDENTITY, &coupling, &deepest, |_, _| DVec3::Z, SLOP_M);
        let step = planes
            .step((DVec3::NEG_Z * 1e-3, DVec3::ZERO), &coupling, &FrictionWrench::ZERO)
            .expect("finite");
        let patch = |face, normal_world, force_n| Patch {
            face,
            force_n,
            normal_world,
            arm_world: DVec3::ZERO,
            radius_m: 0.01,
            stiffness_n_per_m: 1e4,
        };
        let walls = [
            patch(2, DVec3::Z, 3.0),
            patch(7, DVec3::X, 50.0),
            patch(9, DVec3::Z, 1.0),
            patch(11, DVec3::new(0.0, 0.6, 0.8), 0.0),
        ];
        let pressed = planes.pressed_n(step, walls.iter());
        let all = 1300.0 * (1e-3 + step.0.z);
        assert!(all > 1.0 && (pressed.iter().sum::<f64>() / all - 1.0).abs() < 1e-6, "{pressed:?}");
        assert!((pressed[2] / all - 0.75).abs() < 1e-6 && (pressed[9] / all - 0.25).abs() < 1e-6);
        // Nothing touches that way: nothing rubs.
        assert!(
            planes.pressed_n(step, walls[1..2].iter()).iter().all(|pressed_n| *pressed_n == 0.0)
        );
    }

    #[test]
    fn a_step_of_ten_nanometres_ends_at_the_plane_as_one_of_a_millimetre_does() {
        for needed_m in [1e-3, 1e-8] {
            let normal = DVec3::Z;
            let moment = DVec3::ZERO;
            let planes = [Plane { normal, moment, needed_m, stiffness_n_per_m: 1.3e7 }];
            let (linear, _) =
                programme((DVec3::ZERO, DVec3::ZERO), &planes).solve().expect("finite");
            // K x = k (needed − x) with k = 10⁴ K.
            let expected_m = needed_m * 1e4 / (1e4 + 1.0);
            assert!((linear.z / expected_m - 1.0).abs() < 1e-9, "{needed_m}: {linear}");
        }
    }

    #[test]
    fn the_way_out_of_a_ball_is_away_from_its_middle() {
        let ball = Part::of_shape("ball", &Shape::Sphere { radius_m: 10e-3 }, 1e-3);
        let (field, _) = ball.bake_field(&Options::new(1e-3), false, |_| ()).expect("a small grid");
        let obstacle = Obstacle { field, world_from_map: Pose::IDENTITY };
        let pose = |turn: DVec3, at: DVec3| Pose::new(DQuat::from_scaled_axis(turn), at);
        let stands = pose(DVec3::new(0.4, -0.9, 0.6), DVec3::new(0.05, -0.02, 0.03));
        let body = pose(DVec3::new(-0.2, 0.3, 0.7), DVec3::new(0.06, -0.01, 0.02));
        for away_map in [DVec3::new(2.0, -1.0, 2.0) / 3.0, DVec3::new(-1.0, 2.0, -2.0) / 3.0] {
            let point = stands.transform_point(away_map * 9.8e-3);
            let arm_body = body.inverse().transform_point(point).as_vec3();
            // Its own normal is what counts where the obstacle says nothing.
            let contact = Contact::of_point(0, 2e-4, arm_body, DVec3::ZERO.as_vec3());
            let found = way_out(&obstacle, stands, body, &contact);
            let expected = stands.transform_vector(away_map);
            // The voxels of 1 mm turn it by a hundredth or so.
            assert!((found - expected).length() < 0.05, "{found}, expected {expected}");
        }
    }
}
