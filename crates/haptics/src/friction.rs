//! Coulomb friction with stick and slip, one elastic element per face of the tool.
//!
//! While a face touches, the motion of the tool's material at the middle of its contact stretches
//! an elastic element: along the wall, and about its normal. The element holds until the friction
//! cone is reached (`static`), then gives way at the `dynamic` coefficient and is dragged along. A
//! stretch that is not passed on is not forgotten either, so what stands on a slope does not creep.
//!
//! The step of the tool is implicit, and the cone holds at its end: which faces slide, and how hard
//! each is pressed there, is found together with the step ([`Friction::settle`]). A face that held
//! within the step would hold any force.
//!
//! # Units and frames
//! World axes, SI, wrenches about the centre of mass.
//!
//! # Source
//! The tangential element that is stretched by increments and cut at the cone is that of discrete
//! element methods (Cundall, Strack, "A discrete numerical model for granular assemblies", 1979);
//! turning about the normal, the radius of a face and the common cone of both are ours. To cut at
//! the end of an implicit step is the return mapping of plasticity (Simo, Hughes, "Computational
//! inelasticity", 1998).

use glam::{DMat3, DVec3};

use super::params::FrictionParameters;
use vps::contact::{FACES, ObstacleMotion, Patch};
use vps::spatial::{Mat6, Pose, Twist, Wrench};

/// A face holds no more than this many times as stiffly along the wall as it presses into it.
const MOST_TIMES_AS_STIFF: f64 = 10.0;

/// What friction does in a tick.
#[derive(Clone, Copy, Debug)]
pub(super) struct FrictionWrench {
    /// On the tool, about its centre of mass.
    pub(super) wrench: Wrench,
    /// −dW/dx of the faces that stick, symmetric, positive semi-definite.
    pub(super) stiffness: Mat6,
}

impl FrictionWrench {
    /// Nothing rubs.
    pub(super) const ZERO: Self = Self { wrench: Wrench::ZERO, stiffness: Mat6::ZERO };

    /// A step by one is a step by the other.
    fn is_near(&self, other: &Self) -> bool {
        let is_near =
            |one: f64, other: f64| (one - other).abs() <= NEAR * (one.abs() + other.abs());
        let (one, two) = (self.stiffness.traces(), other.stiffness.traces());
        let apart = self.wrench - other.wrench;
        apart.force.length() <= NEAR * self.wrench.force.length()
            && apart.torque.length() <= NEAR * self.wrench.torque.length()
            && is_near(one.0, two.0)
            && is_near(one.1, two.1)
    }
}

/// Most repeats of a step for faces that slide.
const MOST_REPEATS: usize = 8;

/// Pulls that differ by less are the same.
const NEAR: f64 = 1e-3;

/// How a contact presses a tool with mass in a step.
#[derive(Clone, Copy, Debug)]
pub(super) struct Presses {
    /// What the filter lets through of its force.
    pub(super) shaped: f64,
    /// By how much its stiffness counts against the velocity with which it leaves, s.
    pub(super) held_s: f64,
    /// Damping beyond that, of each face.
    pub(super) damping_n_s_per_m: f64,
}

impl Presses {
    /// What presses each face, N: what its depth pushes with at the end of the step, `way` from
    /// where the contact was found, and its damping, at the velocity `leaves` against what it
    /// touches. A tool that rocks on an edge is pushed by its depth, and held back by damping as it
    /// leaves: friction that knew of the depth alone would be several times what the hand presses.
    /// RT: safe, O(faces).
    pub(super) fn pressed_n<'a>(
        &self,
        patches: impl Iterator<Item = &'a Patch>,
        way: &ObstacleMotion,
        leaves: Twist,
    ) -> [f64; FACES] {
        let mut faces = [0.0; FACES];
        for patch in patches {
            let Some(pressed_n) = faces.get_mut(usize::from(patch.face)) else { continue };
            let normal = patch.normal_world;
            let arm = patch.arm_world;
            let way_m = normal.dot(way.linear + way.angular.cross(arm));
            let speed = normal.dot(leaves.linear + leaves.angular.cross(arm));
            let met_n = self.shaped * (patch.force_n + patch.stiffness_n_per_m * way_m);
            let held = patch.stiffness_n_per_m * self.held_s + self.damping_n_s_per_m;
            *pressed_n = (met_n - held * speed).max(0.0);
        }
        faces
    }
}

/// How far an element is stretched.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Stretch {
    /// How far the material has gone along the wall, m.
    along: DVec3,
    /// How far it has turned about the normal, rad.
    about: f64,
}

impl Stretch {
    fn scaled(self, share: f64) -> Self {
        Self { along: self.along * share, about: self.about * share }
    }
}

/// The element of one face.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Element {
    slips: bool,
    stretch: Stretch,
    /// What it touches moved by in this tick.
    obstacle_motion: ObstacleMotion,
    /// What presses it at the end of the step, N; `None` before the first one.
    pressed_n: Option<f64>,
    /// As it was found in this tick; `None`: it does not touch.
    face: Option<Face>,
}

/// The elements of all faces, and where the tool was.
#[derive(Clone, Debug, Default)]
pub(super) struct Friction {
    elements: [Element; FACES],
    before: Option<Pose>,
}

impl Friction {
    /// Sets, before a tick, how each face is carried by what it touches: only what the tool moves
    /// against that stretches.
    pub(super) fn carry(&mut self, faces: &[ObstacleMotion; FACES]) {
        for (element, carried) in self.elements.iter_mut().zip(faces) {
            element.obstacle_motion = *carried;
        }
    }

    /// Takes a step, and takes it again with the friction of the step before until it no longer
    /// differs: that step, and its friction. `step`: makes one with that friction; `presses`: with
    /// which velocity a step goes against what the tool touches, and what presses each face at its
    /// end, N. RT: safe, at most [`MOST_REPEATS`] steps more.
    pub(super) fn settle<S>(
        &mut self,
        mut friction: FrictionWrench,
        period_s: f64,
        params: &FrictionParameters,
        step: impl Fn(&FrictionWrench) -> Option<S>,
        presses: impl Fn(&S) -> (Twist, [f64; FACES]),
    ) -> Option<(S, FrictionWrench)> {
        let mut taken = step(&friction)?;
        if !params.acts() {
            return Some((taken, friction));
        }
        for repeat in 0..=MOST_REPEATS {
            let (leaves, pressed_n) = presses(&taken);
            for (element, pressed_n) in self.elements.iter_mut().zip(pressed_n) {
                element.pressed_n = Some(pressed_n);
            }
            let over = self.over(leaves, period_s, params);
            if repeat == MOST_REPEATS || over.is_near(&friction) {
                break;
            }
            friction = over;
            taken = step(&friction)?;
        }
        Some((taken, friction))
    }

    /// What the faces of this tick pull with over a step of this velocity against what they touch:
    /// those that it stretches beyond their cone slide, with the cone of what presses them at its
    /// end. An implicit step that knew only that they hold would be held by any force. RT: safe,
    /// O(faces).
    fn over(&self, leaves: Twist, period_s: f64, params: &FrictionParameters) -> FrictionWrench {
        let mut sum = FrictionWrench::ZERO;
        let step = Twist { linear: leaves.linear * period_s, angular: leaves.angular * period_s };
        self.elements.iter().for_each(|element| element.over(step, params, &mut sum));
        sum
    }

    /// One tick with the tool at `world_from_body`. `patches`: what touches now, one per face. RT:
    /// safe, O(faces).
    pub(super) fn update<'a>(
        &mut self,
        patches: impl Iterator<Item = &'a Patch>,
        world_from_body: Pose,
        params: &FrictionParameters,
    ) -> FrictionWrench {
        let before = self.before.replace(world_from_body).unwrap_or(world_from_body);
        if !params.acts() {
            // Coefficients are set while it runs: what was stretched before is not felt after.
            self.elements = [Element::default(); FACES];
            return FrictionWrench::ZERO;
        }
        let mut touching = [false; FACES];
        let mut sum = FrictionWrench::ZERO;
        let turned = before.rotation_to(world_from_body);
        let moved_center = world_from_body.translation - before.translation;
        for patch in patches {
            let face = usize::from(patch.face);
            let (Some(element), Some(touches)) =
                (self.elements.get_mut(face), touching.get_mut(face))
            else {
                continue;
            };
            *touches = true;
            element.pull(patch, moved_center, turned, params, &mut sum);
        }
        for (element, touches) in self.elements.iter_mut().zip(touching) {
            if !touches {
                *element = Element::default();
            }
        }
        sum
    }
}

impl Element {
    fn pull(
        &mut self,
        patch: &Patch,
        moved_center: DVec3,
        turned: DVec3,
        params: &FrictionParameters,
        sum: &mut FrictionWrench,
    ) {
        let normal = patch.normal_world;
        let arm = patch.arm_world;
        let carried = core::mem::take(&mut self.obstacle_motion);
        let before = *self;
        if self.face.is_some() {
            // Small steps: the tool moves less than a voxel and a degree in a tick.
            let turned = turned - carried.angular;
            self.stretch.along += moved_center - carried.linear
                + turned.cross(arm)
                + carried.angular.cross(self.stretch.along);
            self.stretch.about += turned.dot(normal);
        }
        self.stretch.along -= normal * self.stretch.along.dot(normal);

        let pressed_n = core::mem::take(&mut self.pressed_n).unwrap_or(patch.force_n);
        let face = Face::of(patch, params);
        let share = face.share(
            self.stretch,
            self.coefficient(params) * pressed_n,
            params.dynamic * pressed_n,
        );
        self.slips = share < 1.0;
        self.stretch = self.stretch.scaled(share);
        // Pulled in one tick from one end of its elastic way through to the other: what balances
        // lies between both, where it is elastic. A step that knows of it only how it slides may go
        // to and fro between the ends for ever.
        let has_turned_round = face.stiffness_n_per_m
            * before.stretch.along.dot(self.stretch.along)
            + face.about_nm_per_rad() * before.stretch.about * self.stretch.about
            < 0.0;
        let holds = if self.slips && !has_turned_round { share } else { 1.0 };
        face.pull(self.stretch, holds, sum);
        self.face = Some(face);
    }

    /// Adds what the element pulls with in a step, so that at its end it pulls no harder than its
    /// cone: see [`Friction::over`].
    fn over(&self, step: Twist, params: &FrictionParameters, sum: &mut FrictionWrench) {
        let Some(face) = &self.face else { return };
        let Patch { normal_world: normal, arm_world: arm, .. } = face.patch;
        let way = step.linear + step.angular.cross(arm);
        let ends = Stretch {
            along: self.stretch.along + way - normal * way.dot(normal),
            about: self.stretch.about + step.angular.dot(normal),
        };
        let pressed_n = self.pressed_n.unwrap_or(face.patch.force_n);
        let share =
            face.share(ends, self.coefficient(params) * pressed_n, params.dynamic * pressed_n);
        if share < 1.0 {
            let mut slides = FrictionWrench::ZERO;
            face.pull(ends.scaled(share), share, &mut slides);
            let (force, torque) = slides.stiffness.mul(step.linear, step.angular);
            // At the start of the step, so that it is this at the end.
            sum.wrench = sum.wrench + slides.wrench + Wrench::new(force, torque);
            sum.stiffness = sum.stiffness.plus_scaled(1.0, &slides.stiffness);
        } else {
            face.pull(self.stretch, 1.0, sum);
        }
    }

    /// That up to which it holds: once it slides, the one at which it slides.
    fn coefficient(&self, params: &FrictionParameters) -> f64 {
        if self.slips { params.dynamic } else { params.r#static }
    }
}

/// A face that touches, and how stiffly it holds.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Face {
    patch: Patch,
    stiffness_n_per_m: f64,
}

impl Face {
    fn of(patch: &Patch, params: &FrictionParameters) -> Self {
        // An upright side, of which next to nothing presses, would stop the tool within the tick at
        // the first touch.
        let most = MOST_TIMES_AS_STIFF * patch.stiffness_n_per_m.max(0.0);
        Self { patch: *patch, stiffness_n_per_m: params.stiffness_n_per_m.min(most) }
    }

    fn about_nm_per_rad(&self) -> f64 {
        self.stiffness_n_per_m * self.patch.radius_m * self.patch.radius_m
    }

    /// The part of a stretch that is left where it pulls harder than `holds_n`: that which pulls
    /// with `slides_n`; 1 of what holds.
    fn share(&self, stretch: Stretch, holds_n: f64, slides_n: f64) -> f64 {
        // One cone for both: a face that slides along turns easily, as a rotating floor polisher
        // shows.
        let load = (self.stiffness_n_per_m * stretch.along)
            .length()
            .hypot(self.stiffness_n_per_m * self.patch.radius_m * stretch.about);
        if load > holds_n { slides_n / load } else { 1.0 }
    }

    /// Adds the pull of a stretch, and its stiffness: of one that slides, of which the cone left
    /// `holds` of less than 1, that across its way.
    fn pull(&self, stretch: Stretch, holds: f64, sum: &mut FrictionWrench) {
        let stiffness = self.stiffness_n_per_m;
        let Patch { normal_world: normal, arm_world: arm, radius_m, .. } = self.patch;
        if holds < 1.0 {
            // A force that slides turns with the motion: across it resists like one that holds,
            // along it not at all. Without that a step that is made of forces and stiffnesses
            // throws the tool from one side of its way to the other.
            for (way, turn) in across(stretch.along, stretch.about * radius_m, normal) {
                sum.stiffness.add_outer(
                    stiffness * holds,
                    way,
                    arm.cross(way) + normal * (turn * radius_m),
                );
            }
        } else {
            let tangent = DMat3::IDENTITY
                - DMat3::from_cols(normal * normal.x, normal * normal.y, normal * normal.z);
            for column in [tangent.x_axis, tangent.y_axis, tangent.z_axis] {
                // t tᵀ over the three columns of a projection is the projection.
                sum.stiffness.add_outer(stiffness, column, arm.cross(column));
            }
            sum.stiffness.add_outer(self.about_nm_per_rad(), DVec3::ZERO, normal);
        }
        let force = stretch.along * -stiffness;
        let torque = arm.cross(force) - normal * (self.about_nm_per_rad() * stretch.about);
        sum.wrench = sum.wrench + Wrench::new(force, torque);
    }
}

/// Two directions, of unit length and across each other, that are across a stretch along the wall
/// and one about its normal (as a length): a way along the wall, and a turn.
fn across(stretch: DVec3, turned_m: f64, normal: DVec3) -> [(DVec3, f64); 2] {
    let length = stretch.length();
    let along = if length > 0.0 { stretch / length } else { normal.any_orthonormal_vector() };
    let load = length.hypot(turned_m);
    let (slides, turns) = if load > 0.0 { (length / load, turned_m / load) } else { (1.0, 0.0) };
    [(normal.cross(along), 0.0), (along * -turns, slides)]
}

#[cfg(test)]
#[expect(clippy::indexing_slicing, reason = "test code")]
mod tests {
    use glam::DQuat;

    use super::*;

    const PARAMS: FrictionParameters =
        FrictionParameters { r#static: 0.5, dynamic: 0.4, stiffness_n_per_m: 1e4 };

    fn floor(force_n: f64) -> Patch {
        Patch {
            face: 3,
            force_n,
            normal_world: DVec3::Z,
            arm_world: DVec3::new(0.0, 0.0, -0.01),
            radius_m: 0.02,
            stiffness_n_per_m: 1e4,
        }
    }

    fn at(x_m: f64, turn_rad: f64) -> Pose {
        Pose::new(DQuat::from_rotation_z(turn_rad), DVec3::new(x_m, 0.0, 0.0))
    }

    /// The pull of a face that touches, tick by tick where the tool stands and how it is turned.
    fn pull_of(patch: Patch) -> impl FnMut(f64, f64) -> FrictionWrench {
        let mut friction = Friction::default();
        move |x_m, turn_rad| friction.update([&patch].into_iter(), at(x_m, turn_rad), &PARAMS)
    }

    #[test]
    fn it_holds_up_to_the_static_cone_and_drags_at_the_dynamic_one() {
        let mut pull = pull_of(floor(10.0));
        assert_eq!(pull(0.0, 0.0).wrench, Wrench::ZERO);
        let held = pull(4.9e-4, 0.0);
        assert!((held.wrench.force - DVec3::new(-4.9, 0.0, 0.0)).length() < 1e-9, "{held:?}");
        assert!((held.wrench.torque - DVec3::new(0.0, 0.049, 0.0)).length() < 1e-9, "{held:?}");
        assert!((held.stiffness.0[0][0] - 1e4).abs() < 1e-6 && held.stiffness.0[2][2].abs() < 1e-9);
        let slipping = pull(5.1e-4, 0.0);
        assert!((slipping.wrench.force.x + 4.0).abs() < 1e-9);
        // It slides on along x as it is; across, and in turning, it resists by what its turn of
        // direction takes.
        let [along, across, out] = [0, 1, 2].map(|axis| slipping.stiffness.0[axis][axis]);
        assert!(
            along.abs() < 1e-9 && out.abs() < 1e-9 && (across - 1e4 * 4.0 / 5.1).abs() < 1e-6,
            "{:?}",
            slipping.stiffness
        );
        let (_, turning) = slipping.stiffness.mul(DVec3::ZERO, DVec3::Z);
        assert!((turning.z - 1e4 * 4.0 / 5.1 * 4e-4).abs() < 1e-6, "{turning}");
        assert!((pull(2e-3, 0.0).wrench.force.x + 4.0).abs() < 1e-9);
        // Back by a little: it lets go elastically, then drags the other way.
        assert!((pull(2e-3 - 1e-4, 0.0).wrench.force.x + 3.0).abs() < 1e-9);
        assert!((pull(2e-3 - 2e-3, 0.0).wrench.force.x - 4.0).abs() < 1e-9);
    }

    #[test]
    fn a_face_resists_turning_and_what_lets_go_forgets() {
        let mut friction = Friction::default();
        let patch = floor(10.0);
        friction.update([&patch].into_iter(), at(0.0, 0.0), &PARAMS);
        let held = friction.update([&patch].into_iter(), at(0.0, 0.01), &PARAMS);
        assert!((held.wrench.torque.z + 1e4 * 4e-4 * 0.01).abs() < 1e-9, "{held:?}");
        // The cone: µ N r.
        let slipping = friction.update([&patch].into_iter(), at(0.0, 0.5), &PARAMS);
        assert!((slipping.wrench.torque.z + 0.4 * 10.0 * 0.02).abs() < 1e-9, "{slipping:?}");
        friction.update(core::iter::empty(), at(0.0, 0.5), &PARAMS);
        let again = friction.update([&patch].into_iter(), at(0.0, 0.5), &PARAMS);
        assert_eq!(again.wrench, Wrench::ZERO);
    }

    #[test]
    fn the_stiffness_of_a_face_that_slides_is_how_its_force_turns() {
        let pose = |dx: f64, dy: f64, turn: f64| {
            Pose::new(DQuat::from_rotation_z(turn), DVec3::new(1e-3 + dx, 2e-4 + dy, 0.0))
        };
        let slid = |to: Pose| {
            let mut friction = Friction::default();
            // Over the middle of the tool, so that a turn does not also shift it.
            let patch = Patch { arm_world: DVec3::ZERO, ..floor(10.0) };
            friction.update([&patch].into_iter(), Pose::IDENTITY, &PARAMS);
            friction.update([&patch].into_iter(), to, &PARAMS)
        };
        let rotation = 0.03;
        let here = slid(pose(0.0, 0.0, rotation));
        let step = 1e-7;
        for (way, turn) in
            [(DVec3::X, DVec3::ZERO), (DVec3::Y, DVec3::ZERO), (DVec3::ZERO, DVec3::Z)]
        {
            let there = slid(pose(step * way.x, step * way.y, rotation + step * turn.z));
            let (force, torque) = here.stiffness.mul(way * step, turn * step);
            let by_force = here.wrench.force - there.wrench.force;
            let by_torque = here.wrench.torque - there.wrench.torque;
            assert!(
                (force - by_force).length() < 2e-6 && (torque - by_torque).length() < 5e-8,
                "{way} {turn}: {force} {by_force} {torque} {by_torque}"
            );
        }
        assert!(here.stiffness.traces().0 > 1e3);
    }

    #[test]
    fn a_side_that_hardly_presses_hardly_holds() {
        for stiffness_n_per_m in [-1.0, 0.0, 30.0] {
            let held = pull_of(Patch { stiffness_n_per_m, ..floor(1e-6) })(0.0, 0.0);
            let (along, _) = held.stiffness.traces();
            assert!((along - 20.0 * stiffness_n_per_m.max(0.0)).abs() < 1e-9, "{along}");
        }
    }

    #[test]
    fn a_face_that_is_thrown_from_end_to_end_is_as_stiff_as_one_that_holds() {
        let mut pull = pull_of(floor(10.0));
        pull(0.0, 0.0);
        assert!(pull(1e-3, 0.0).stiffness.0[0][0].abs() < 1e-9, "it slides on");
        let back = pull(-1e-3, 0.0);
        assert!(
            (back.wrench.force.x - 4.0).abs() < 1e-9 && (back.stiffness.0[0][0] - 1e4).abs() < 1e-6,
            "{back:?}"
        );
        assert!(pull(-2e-3, 0.0).stiffness.0[0][0].abs() < 1e-9, "it slides back");
    }

    #[test]
    fn friction_that_comes_back_knows_nothing_of_what_was_stretched_before() {
        let mut friction = Friction::default();
        let patch = floor(10.0);
        let none = FrictionParameters { r#static: 0.0, dynamic: 0.0, ..PARAMS };
        let mut pull = |x_m, params| friction.update([&patch].into_iter(), at(x_m, 0.0), params);
        pull(0.0, &PARAMS);
        assert!(pull(1e-4, &PARAMS).wrench.force.x < -0.9);
        pull(1e-4, &none);
        assert_eq!(pull(1e-4, &PARAMS).wrench, Wrench::ZERO);
    }

    #[test]
    fn without_coefficients_nothing_rubs() {
        let mut friction = Friction::default();
        let params = FrictionParameters { r#static: 0.0, dynamic: 0.0, ..PARAMS };
        let patch = floor(10.0);
        for x_m in [0.0, 1e-3, 2e-3] {
            assert_eq!(
                friction.update([&patch].into_iter(), at(x_m, 0.0), &params).wrench,
                Wrench::ZERO
            );
        }
    }

    const HOLDS: FrictionParameters = FrictionParameters { r#static: 50.0, ..PARAMS };

    /// A wall and a contact that lie askew.
    fn wall() -> Patch {
        Patch {
            normal_world: DVec3::new(1.0, -2.0, 2.0) / 3.0,
            arm_world: DVec3::new(0.02, 0.01, -0.03),
            ..floor(10.0)
        }
    }

    fn carried(motion: ObstacleMotion) -> [ObstacleMotion; FACES] {
        let mut faces = [ObstacleMotion::default(); FACES];
        faces[3] = motion;
        faces
    }

    #[test]
    fn only_what_the_tool_moves_against_a_moving_wall_stretches() {
        let patch = wall();
        let normal = patch.normal_world;
        let arm = patch.arm_world;
        let motion = ObstacleMotion {
            linear: DVec3::new(2e-5, 3e-5, -1e-5),
            angular: DVec3::new(1e-3, -2e-3, 4e-3),
        };
        let moved = DVec3::new(-1e-5, 4e-5, 3e-5);
        let turned = DVec3::new(-3e-3, 1e-3, 2e-3);
        let start = Pose::new(DQuat::from_scaled_axis(DVec3::new(0.3, 0.9, -0.4)), DVec3::ONE);
        let mut friction = Friction::default();
        friction.update([&patch].into_iter(), start, &HOLDS);
        friction.carry(&carried(motion));
        let held = friction.update([&patch].into_iter(), start.stepped(moved, turned), &HOLDS);
        // The material at the contact goes by this against the wall; along the wall it stretches.
        let slid = moved - motion.linear + (turned - motion.angular).cross(arm);
        let along = slid - normal * slid.dot(normal);
        let force = along * -PARAMS.stiffness_n_per_m;
        let about = PARAMS.stiffness_n_per_m * patch.radius_m * patch.radius_m;
        let turn = (turned - motion.angular).dot(normal);
        let torque = arm.cross(force) - normal * (about * turn);
        assert!((held.wrench.force - force).length() < 1e-9, "{held:?} {force}");
        assert!((held.wrench.torque - torque).length() < 1e-11, "{held:?} {torque}");
        // As stiff as the element, across the wall not at all.
        let (push, _) = held.stiffness.mul(normal, DVec3::ZERO);
        assert!(push.length() < 1e-9, "{push}");
        let (push, twist) = held.stiffness.mul(along, DVec3::ZERO);
        assert!((push - along * 1e4).length() < 1e-9);
        assert!((twist - arm.cross(along) * 1e4).length() < 1e-9);
        let (_, twist) = held.stiffness.mul(DVec3::ZERO, normal);
        let across = normal.cross(arm);
        let expected = normal * about + arm.cross(across - normal * across.dot(normal)) * 1e4;
        assert!((twist - expected).length() < 1e-9, "{twist} {expected}");
    }

    #[test]
    fn what_is_held_turns_with_a_wall_that_carries_the_tool() {
        let patch = wall();
        let start = Pose::IDENTITY;
        let stretched = start.stepped(DVec3::new(4e-5, 6e-5, 4e-5), DVec3::ZERO);
        let mut friction = Friction::default();
        friction.update([&patch].into_iter(), start, &HOLDS);
        let before = friction.update([&patch].into_iter(), stretched, &HOLDS).wrench.force;
        assert!(before.length() > 0.5, "{before}");
        // Wall and tool go and turn together.
        let angular = DVec3::new(2e-4, -1e-4, 3e-4);
        let linear = DVec3::new(1e-3, 2e-3, -5e-4);
        let turn = DQuat::from_scaled_axis(angular);
        friction.carry(&carried(ObstacleMotion { linear, angular }));
        let carried = Patch {
            normal_world: turn * patch.normal_world,
            arm_world: turn * patch.arm_world,
            ..patch
        };
        let after = friction
            .update([&carried].into_iter(), stretched.stepped(linear, angular), &HOLDS)
            .wrench
            .force;
        let turned = (turn * before - before).length();
        assert!((after - turn * before).length() < 0.01 * turned, "{before} {after}");
    }

    #[test]
    fn sliding_and_turning_share_one_cone() {
        let mut pull = pull_of(Patch { arm_world: DVec3::ZERO, ..floor(10.0) });
        pull(0.0, 0.0);
        // 3 N of stretch and 4 N of turn at the radius are the cone's 5 N; just above it slides.
        let held = pull(2.99e-4, 0.0199).wrench;
        assert!((held.force.x + 2.99).abs() < 1e-9 && (held.torque.z + 0.0796).abs() < 1e-9);
        let slides = pull(3.01e-4, 0.0201).wrench;
        let load = 3.01_f64.hypot(4.02);
        assert!((slides.force.x + 3.01 * 4.0 / load).abs() < 1e-9, "{slides:?}");
        assert!((slides.torque.z + 4.02 * 0.02 * 4.0 / load).abs() < 1e-9, "{slides:?}");
    }

    #[test]
    fn a_face_that_is_thrown_from_end_to_end_of_its_turn_is_as_stiff_as_one_that_holds() {
        let mut pull = pull_of(Patch { arm_world: DVec3::ZERO, ..floor(10.0) });
        pull(0.0, 0.0);
        let about = |held: FrictionWrench| held.stiffness.mul(DVec3::ZERO, DVec3::Z).1.z;
        assert!(about(pull(0.0, 0.5)).abs() < 1e-9, "it turns on");
        assert!((about(pull(0.0, -0.5)) - 1e4 * 4e-4).abs() < 1e-9);
        assert!(about(pull(0.0, -0.9)).abs() < 1e-9, "it turns back");
    }

    #[test]
    fn friction_takes_a_coefficient_and_a_stiffness() {
        assert!(PARAMS.acts());
        assert!(!FrictionParameters { r#static: 0.0, ..PARAMS }.acts());
        assert!(!FrictionParameters { stiffness_n_per_m: 0.0, ..PARAMS }.acts());
    }
}
