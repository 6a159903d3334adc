//! The virtual tool: what touches it, how it follows the arm in each coupling, and what the arm
//! feels of it.

use glam::{DQuat, DVec3};

use super::RenderScene;
use super::braking::{Brake, Braking};
use super::clay::Held;
use super::constraint::{self, Planes, SLOP_VOXELS};
use super::contact_damping;
use super::coupling::{Body, Inertia, LinearContact, Spring, StepInput};
use super::filter::{ShapingFilter, Slide};
use super::friction::{Friction, FrictionWrench, Presses};
use super::limits::Ramp;
use super::moving_obstacles::ALWAYS_VOXELS;
use super::params::{CouplingMode, CouplingParameters, FreeSpace, Parameters};
use vps::contact::planes::DeepestContacts;
use vps::contact::{Contact, ContactSum, ObstacleMotion, Patch, Traversal};
use vps::spatial::{Mat6, Pose, Twist, Wrench};

/// Time in which that part of the coupling wrench comes in that was there before contact, s
/// (decision: free space).
const CONTACT_RISE_S: f64 = 5e-3;

/// How far the shell may follow the arm in one tick without a virtual tool, voxels.
const SEEN_VOXELS: f64 = 2.9;

/// A query that looks at more, for each second of the period, takes too much of a tick to be made
/// twice in each: some 40 µs of a millisecond.
const MOST_POINTS_PER_S: f64 = 2.0e6;

/// Share of the squared frequency of turns that counts for the damping ratio.
const TURNS_COUNT: f64 = 0.01;

/// What the arm feels of the tool: world axes, about the grip point.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Pull {
    pub(super) wrench: Wrench,
    /// Energy in the spring that makes its force and its torque, J: what the hand gets back when
    /// the tool is let go. Zero without a virtual tool.
    pub(super) stored_j: [f64; 2],
}

/// What a contact query asks, at whatever pose.
pub(super) struct Query<'a> {
    pub(super) traversal: &'a mut Traversal,
    pub(super) scene: &'a RenderScene,
    pub(super) p: &'a Parameters,
}

impl Query<'_> {
    /// Rigid contact of the tool there; `deepest` gets all of it.
    fn rigid(&mut self, body: Pose, deepest: Option<&mut DeepestContacts>) -> ContactSum {
        let Self { traversal, scene, p } = self;
        let law = p.force_law();
        let shell = &scene.tool.shell;
        match deepest {
            Some(deepest) => {
                let mut also =
                    |obstacle_idx: usize, contact: &Contact| deepest.add(obstacle_idx, contact);
                ContactSum::of(traversal, &scene.obstacles, shell, body, law, Some(&mut also))
            }
            None => ContactSum::of(traversal, &scene.obstacles, shell, body, law, None),
        }
    }
}

/// What the contact queries of a tick found.
pub(super) struct Touch {
    /// Of the last query that found one.
    pub(super) contact: ContactSum,
    /// Where the step ended, friction included: what is published, and what holds energy. A query
    /// may be at a pose that the tool was only tried at, ten times as deep.
    pub(super) ended: ContactSum,
    /// How far the tool had gone at the last query from where it stood, seen from what it touches.
    way: ObstacleMotion,
    /// What the clay adds to it where the first query was.
    clay: Option<ContactSum>,
    /// What the rope in the clay pulls with, N.
    rope: DVec3,
    brake: Option<Brake>,
}

/// Pose, velocity and all memory of force.
#[derive(Clone, Debug, Default)]
pub(super) struct VirtualTool {
    body: Body,
    filter: ShapingFilter,
    friction: Friction,
    /// For the constraint coupling only.
    deepest: DeepestContacts,
    /// What the coupling pulled with in the last tick of free space, which the arm did not feel. Of
    /// that alone a share is kept from the arm while `contact_gain` rises: what contact adds is
    /// felt at once. A gain on the whole wrench would take force away on the way in and give all of
    /// it back on the way out, which drives the hand.
    unfelt: Wrench,
    /// 0 in free space, 1 after [`CONTACT_RISE_S`] in contact.
    contact_gain: Ramp,
    /// Where the arm wanted it in the last tick.
    target: Option<Pose>,
    /// In free space: it stood where the arm wanted it in the last tick.
    tracks: bool,
    /// Something touched it in the last tick.
    touched: bool,
    /// How far a point of the tool may go in the next tick without a virtual tool, m.
    step_limit_m: f64,
}

impl VirtualTool {
    /// At rest, with nothing remembered.
    pub(super) fn at(pose: Pose) -> Self {
        Self { body: Body { pose, twist: Twist::ZERO }, ..Self::default() }
    }

    /// Pose of the axes at the centre of mass, world.
    pub(super) fn pose(&self) -> Pose {
        self.body.pose
    }

    pub(super) fn is_finite(&self) -> bool {
        self.body.pose.is_finite() && self.body.twist.is_finite()
    }

    /// Without a virtual tool the shell stands where the arm is now, so contact has no delay of its
    /// own. Only what is too fast to be seen in passing is followed more slowly.
    pub(super) fn stand_at(&mut self, target: (Pose, Twist), scene: &RenderScene) {
        self.body = self.body.followed(target, scene.tool.shell.radius_m(), self.step_limit_m);
    }

    /// A tool that stood where the arm wanted it in free space does so again before contact is
    /// looked for, in steps that see every wall: so first contact has no delay of its own. With
    /// what the tick of before knew of the way.
    pub(super) fn keep_tracking(
        &mut self,
        target: (Pose, Twist),
        scene: &RenderScene,
        p: &Parameters,
    ) {
        if self.tracks {
            let sag_m = sag_m(scene, p, &p.coupling);
            self.tracks = self.track(
                target,
                sag_m,
                (scene.tool.shell.radius_m(), self.step_limit_m),
                p.period_s,
            );
        }
    }

    /// Looks for contact where the tool stands, and with `braking` for what it approaches;
    /// `moving`: obstacles are under way.
    pub(super) fn touch(
        &mut self,
        query: &mut Query<'_>,
        clay: Option<&mut Held>,
        braking: Option<&mut Braking>,
        moving: bool,
    ) -> Touch {
        let body = self.body.pose;
        let mode = query.p.coupling.mode;
        self.deepest.begin_tick();
        let deepest = (mode == CouplingMode::Constraint).then_some(&mut self.deepest);
        let rigid = query.rigid(body, deepest);
        let Query { traversal, scene, p } = query;
        let mut rope = DVec3::ZERO;
        let clay = clay.zip(scene.clay.as_ref()).map(|(held, clay)| {
            let sum = held.touch(clay, &scene.tool.shell, body, p);
            rope = held.forces().rope_world;
            sum
        });
        let contact = clay.map_or(rigid, |clay| rigid.with_clay(&clay));
        // A point that goes no further than this is seen inside of a wall of three voxels.
        let seen_voxels = if moving { SEEN_VOXELS - ALWAYS_VOXELS } else { SEEN_VOXELS };
        self.step_limit_m = contact.step_limit_m.max(seen_voxels * contact.voxel_size_m);
        let brake =
            braking.and_then(|braking| braking.brake(scene, traversal, &self.body, &contact));
        let way = ObstacleMotion::default();
        Touch { contact, ended: contact, way, clay, rope, brake }
    }

    /// Friction of what touches.
    pub(super) fn rub(&mut self, touch: &Touch, p: &Parameters) -> FrictionWrench {
        if let Some(faces) = touch.contact.carried_faces() {
            self.friction.carry(faces);
        }
        self.friction.update(touch.contact.patches(), self.body.pose, &p.contact.friction)
    }

    /// Steps the tool in its coupling and gives the wrench that the arm feels (world axes, about
    /// the grip point). `is_paid`: the hand has put in what the spring holds; before, nothing more
    /// of what was unfelt comes in. `None` on non-finite input.
    pub(super) fn follow(
        &mut self,
        query: &mut Query<'_>,
        touch: &mut Touch,
        rubbing: &FrictionWrench,
        (coupling, is_paid): (&CouplingParameters, bool),
        target: (Pose, Twist),
    ) -> Option<Pull> {
        let Query { scene, p, .. } = *query;
        let Touch { contact, ended, way, clay, rope, brake } = touch;
        if coupling.mode == CouplingMode::Direct {
            ended.wrench = ended.wrench + rubbing.wrench;
            let wrench = self.direct((scene, p), contact, rubbing, coupling)?;
            return Some(Pull { wrench, ..Pull::default() });
        }
        let radius_m = scene.tool.shell.radius_m();
        let (target_pose, target_twist) = target;
        let touching = contact.acts();
        if self.tracks && touching && clay.is_none() {
            // It was set to where the arm is now, in one step of what is measured and without a
            // force on the way: so deep in a wall that the contact would throw it out again. It
            // stands where it touched.
            let out = contact.wrench.force.normalize_or_zero() * contact.max_value_m.max(0.0);
            self.body.pose.translation += out;
            way.linear -= out;
            self.end_approach(contact, &scene.tool.inertia, p.period_s)?;
        }

        let voxel_size_m = contact.voxel_size_m;
        let spring = |body: Pose| {
            Spring::between(body, target_pose, coupling, &p.limits, voxel_size_m, radius_m)
        };
        let stretched = spring(self.body.pose);
        let weight = p.gravity_m_per_s2 * scene.tool.inertia.mass_kg;
        let over_a_tick = |(way, turn): (DVec3, DVec3)| Twist {
            linear: way / p.period_s,
            angular: turn / p.period_s,
        };
        let before = self.target.replace(target_pose).unwrap_or(target_pose);
        // How the hand went in the last tick.
        let went = over_a_tick((
            target_pose.translation - before.translation,
            before.rotation_to(target_pose),
        ));
        let is_unfelt = coupling.mode.has_mass()
            && coupling.free_space == FreeSpace::Zero
            && !touching
            && brake.is_none();
        let sag_m = sag_m(scene, p, coupling);
        if is_unfelt && !self.tracks {
            // Nothing is in the way: a tool that has sprung off a wall while the hand is inside of
            // it is further away than that.
            self.tracks = self.track(target, sag_m, (radius_m, contact.free_way_m), p.period_s);
            if self.tracks {
                // The way that it lagged by is no velocity.
                self.body.twist = as_far_as(target_twist, went);
            }
        }
        self.tracks &= is_unfelt;
        if self.tracks {
            self.touched = false;
            self.contact_gain.reset();
            self.unfelt = spring(self.body.pose).wrench * -1.0;
            return Some(Pull::default());
        }
        // What is not felt may be as rough as the encoder, but not late.
        let target_twist = if is_unfelt { went } else { target_twist };
        let step_limit_m = contact.step_limit_m;
        let mut rubs;
        let twist = match coupling.mode {
            CouplingMode::Constraint => {
                let body = self.body.pose;
                // As seen from what it touches, which may move.
                let ObstacleMotion { linear, angular } = contact.obstacle_motion;
                let free = (
                    target_pose.translation - body.translation + sag_m - linear,
                    body.rotation_to(target_pose) - angular,
                );
                let obstacle_poses = query.traversal.obstacle_poses();
                let way_out = |idx: usize, contact: &Contact| match (
                    scene.obstacles.get(idx),
                    obstacle_poses.pose(idx),
                ) {
                    (Some(obstacle), Some(stand)) => {
                        constraint::way_out(obstacle, stand.world_from_map, body, contact)
                    }
                    _ => body.transform_vector(contact.normal_body.as_dvec3()),
                };
                let slop_m = SLOP_VOXELS * contact.voxel_size_m;
                let planes = Planes::of(body, coupling, &self.deepest, way_out, slop_m);
                let solve = |rubbing: &FrictionWrench| planes.step(free, coupling, rubbing);
                let presses = |step: &(DVec3, DVec3)| {
                    (over_a_tick(*step), planes.pressed_n(*step, contact.patches()))
                };
                let params = &p.contact.friction;
                let step;
                (step, rubs) =
                    self.friction.settle(*rubbing, p.period_s, params, solve, presses)?;
                over_a_tick((step.0 + linear, step.1 + angular))
            }
            _ => {
                let pull = (stretched, target_twist, weight);
                let filter = self.filter;
                let brake = brake.as_ref();
                let found = Found { contact, way };
                let mut twist;
                (twist, rubs) =
                    self.step_with_mass((scene, p), (found, rubbing, brake), coupling, pull)?;
                let reached = self.body.moved(twist, p.period_s, radius_m, step_limit_m);
                let tried = way_of(reached.twist, p.period_s);
                let goes_m = tried.linear.length() + tried.angular.length() * radius_m;
                let is_clear = goes_m < contact.free_way_m;
                // A landing is looked at again however much there is: it is one tick.
                let most_points = MOST_POINTS_PER_S * p.period_s.min(1e-3);
                let is_large = f64::from(contact.looked_at) > most_points;
                if !(is_clear || (self.touched && is_large)) {
                    // A contact that begins or ends in this tick is not known at its start. As seen
                    // from what it touches, which may move: its poses are those of the start.
                    let carried = contact.obstacle_motion;
                    let seen = Pose::new(
                        DQuat::from_scaled_axis(-carried.angular) * reached.pose.rotation,
                        reached.pose.translation - carried.linear,
                    );
                    let goes = way_of(reached.twist - carried.over(p.period_s), p.period_s);
                    let rigid = query.rigid(seen, None);
                    let again = clay.map_or(rigid, |mut clay| {
                        clay.wrench = clay.wrench - pushed(&clay.stiffness, &goes);
                        rigid.with_clay(&clay)
                    });
                    self.filter = filter;
                    let found = Found { contact: &again, way: &goes };
                    (twist, rubs) =
                        self.step_with_mass((scene, p), (found, rubbing, brake), coupling, pull)?;
                    // One that ends in this tick is felt in it still.
                    if again.acts() || !contact.acts() {
                        *contact = again;
                        *way = goes;
                    }
                }
                twist
            }
        };
        self.body = self.body.moved(twist, p.period_s, radius_m, step_limit_m);
        self.touched = contact.acts();
        let mut pressed_j = 0.0;
        if coupling.mode.has_mass() {
            let nears = contact.obstacle_motion.over(p.period_s) - self.body.twist;
            let since_found = way_of(way.over(p.period_s) + nears, p.period_s);
            *ended = moved_on(contact, &since_found, *rope);
            // What the contact itself gives back; a constraint stands at its surface whatever
            // pulls.
            pressed_j = pressed(ended);
            // What presses nothing rubs on nothing.
            if ended.max_value_m > 0.0 {
                let rubbed = pushed(&rubs.stiffness, &way_of(nears, p.period_s));
                ended.wrench = ended.wrench + rubs.wrench + rubbed;
            }
        }

        // The spring after the step: what the tool holds on to now is what the hand feels now.
        let damper = Wrench::new(
            (self.body.twist.linear - target_twist.linear) * coupling.felt_damping_n_s_per_m,
            (self.body.twist.angular - target_twist.angular) * coupling.felt_damping_nm_s_per_rad,
        );
        let pulling = spring(self.body.pose);
        if coupling.mode == CouplingMode::Constraint && contact.contacts > 0 {
            // What holds back a tool without mass is what pulls it.
            ended.wrench = (pulling.wrench + Wrench::new(weight, DVec3::ZERO)) * -1.0;
        }
        let felt = damper - pulling.wrench;
        let felt = match coupling.free_space {
            FreeSpace::Drag => felt,
            FreeSpace::Zero if touching => {
                let rise_s = if is_paid { CONTACT_RISE_S } else { f64::INFINITY };
                let gain = self.contact_gain.advance(true, rise_s, p.period_s);
                felt - self.unfelt * (1.0 - gain)
            }
            FreeSpace::Zero => {
                self.contact_gain.reset();
                self.unfelt = felt;
                Wrench::ZERO
            }
        };
        let [along, about] = pulling.stored_j;
        let stored_j = [
            pressed_j + along * squared_share(felt.force, pulling.wrench.force),
            about * squared_share(felt.torque, pulling.wrench.torque),
        ];
        Some(Pull { wrench: felt, stored_j })
    }

    /// Ends the tool's velocity into what it touches, by a blow along the contact force. Its mass
    /// is not felt in free space, so it does not strike either: 100 g that stop within 0.25 ms
    /// would press ten times as hard as the hand. `None` on non-finite input.
    fn end_approach(
        &mut self,
        contact: &ContactSum,
        inertia: &Inertia,
        period_s: f64,
    ) -> Option<()> {
        let normal = contact.wrench.force.normalize_or_zero();
        let moment = contact.arm_world.cross(normal);
        let leaves = |twist: Twist| normal.dot(twist.linear) + moment.dot(twist.angular);
        let speed = leaves(self.body.twist - contact.obstacle_motion.over(period_s));
        if speed < 0.0 {
            let mass = inertia.in_world(self.body.pose.rotation_matrix());
            let unit = mass.solve_spd(Wrench::new(normal, moment))?;
            let unit = Twist { linear: unit.0, angular: unit.1 };
            let blow = -speed / leaves(unit);
            self.body.twist.linear += unit.linear * blow;
            self.body.twist.angular += unit.angular * blow;
        }
        Some(())
    }

    /// Stands a tool that touches nothing where the arm wants it, by its weight lower, if that is
    /// no further than `most_m`.
    ///
    /// A mass that is not felt must not lag either: the damper pulls it along at a velocity that is
    /// half a window old, which makes 0.3 mm in a hand that falls onto a wall with 6 m/s². The hand
    /// would find the wall that much deeper, and be pushed out from where it is.
    ///
    /// Its velocity is that of the arm as far as its way in this tick agrees: one that is half a
    /// window old alone throws it off the wall when the hand has just turned round, and a step of
    /// the encoder in a tick alone throws it into the wall when the hand is slow.
    fn track(
        &mut self,
        (target, twist): (Pose, Twist),
        sag_m: DVec3,
        (radius_m, most_m): (f64, f64),
        period_s: f64,
    ) -> bool {
        let target = Pose::new(target.rotation, target.translation + sag_m);
        let way = target.translation - self.body.pose.translation;
        let turn = self.body.pose.rotation_to(target);
        let stands = way.length() + turn.length() * radius_m <= most_m;
        if stands {
            let way = Twist { linear: way / period_s, angular: turn / period_s };
            self.body = Body { pose: target, twist: as_far_as(twist, way) };
        }
        stands
    }

    /// Velocity of a virtual tool with mass after one step, and the friction with which that was
    /// found. `None` on non-finite input.
    fn step_with_mass(
        &mut self,
        (scene, p): (&RenderScene, &Parameters),
        (Found { contact, way }, rubbing, brake): (Found<'_>, &FrictionWrench, Option<&Brake>),
        coupling: &CouplingParameters,
        (spring, target_twist, weight): (Spring, Twist, DVec3),
    ) -> Option<(Twist, FrictionWrench)> {
        let inertia = &scene.tool.inertia;
        let coupled = StepInput::critical_damping(coupling, inertia);
        let held = self.held(contact, inertia)?;
        let (along, about) = held.bounds();
        let contact_rad_per_s =
            (along / inertia.mass_kg).max(about / inertia.least_kg_m2).max(0.0).sqrt();
        let met = contact.wrench + pushed(&held, way);
        let wrench = self.shaped((contact, met), contact_rad_per_s, p);
        // Of what is stiff against turns alone, such as a tip that a dent holds, the turns count.
        let squared = (along / inertia.mass_kg).max(TURNS_COUNT * (about / inertia.least_kg_m2));
        let damping_s =
            if squared > 0.0 { 2.0 * p.contact.damping_ratio / squared.sqrt() } else { 0.0 };
        let pull =
            StepInput { spring, target_twist, weight, damping: coupled, period_s: p.period_s };
        let ground = contact.obstacle_motion.over(p.period_s);
        let braking = brake.map(|brake| brake.damping(inertia.mass_kg, p.period_s));
        let damping_n_s_per_m = p.contact.damping_n_s_per_m;
        let squared_n2 = met.force.length_squared();
        let alpha = self.filter.alpha();
        let presses = Presses {
            shaped: if squared_n2 > 0.0 { wrench.force.dot(met.force) / squared_n2 } else { 0.0 },
            held_s: (1.0 - alpha) * p.period_s + damping_s,
            damping_n_s_per_m,
        };
        let body = self.body;
        let step = |rubbing: &FrictionWrench| {
            // Friction is smooth by itself: it goes past the filter.
            let stiffness =
                Mat6::ZERO.plus_scaled(1.0 - alpha, &held).plus_scaled(1.0, &rubbing.stiffness);
            // It acts at once, whatever the filter does to the force: at higher rates less and less
            // of the stiffness acts within a tick.
            let damping =
                Mat6::ZERO.plus_scaled(damping_s, &held).plus_scaled(damping_s, &rubbing.stiffness);
            // What moves towards the tool will push by so much more at the end of the tick, and
            // damping acts on the speed between both.
            let wrench = wrench + rubbing.wrench + pushed(&stiffness, &contact.obstacle_motion);
            let solve = |faces: &Mat6| {
                let damping = damping.plus_scaled(1.0, faces);
                let (force, torque) = damping.mul(ground.linear, ground.angular);
                let contact = LinearContact {
                    wrench: wrench + Wrench::new(force, torque),
                    stiffness,
                    damping: braking.map_or(damping, |braking| damping.plus_scaled(1.0, &braking)),
                };
                body.step_implicit(&pull, &contact, inertia)
            };
            let undamped = solve(&Mat6::ZERO)?;
            if contact.contacts == 0 || damping_n_s_per_m <= 0.0 {
                return Some(undamped);
            }
            // As seen from what the faces touch, which may move.
            let seen = contact_damping::damped(
                // At the start of the step, as the velocity is that from there on.
                contact.patches().map(|patch| {
                    let more_n = patch.stiffness_n_per_m * nears_m(patch, way);
                    Patch { force_n: patch.force_n + more_n, ..*patch }
                }),
                damping_n_s_per_m,
                p.period_s + damping_s,
                undamped - ground,
                |dampers| solve(dampers).map(|twist| twist - ground),
            )?;
            Some(seen + ground)
        };
        self.friction.settle(*rubbing, p.period_s, &p.contact.friction, step, |twist| {
            let leaves = *twist - ground;
            (leaves, presses.pressed_n(contact.patches(), way, leaves))
        })
    }

    /// The part of a contact's stiffness that holds the tool: over another an implicit step would
    /// not be solvable, and a sum of eigenvalues would say too little of the largest.
    fn held(&self, contact: &ContactSum, inertia: &Inertia) -> Option<Mat6> {
        contact.stiffness.positive_part(&inertia.in_world(self.body.pose.rotation_matrix()))
    }

    /// No virtual tool: the shell stands where the arm is, the arm gets the filtered contact
    /// wrench, its stiffness limited to what the arm can take. `None` on non-finite input.
    fn direct(
        &mut self,
        (scene, p): (&RenderScene, &Parameters),
        contact: &ContactSum,
        rubbing: &FrictionWrench,
        coupling: &CouplingParameters,
    ) -> Option<Wrench> {
        let held = self.held(contact, &scene.tool.inertia)?;
        let stiffness = held.plus_scaled(1.0, &rubbing.stiffness);
        // What is deeper than the field goes pushes on and has no gradient.
        let secant = contact.wrench.force.length() / contact.max_value_m.max(f64::MIN_POSITIVE);
        let (along, about) = stiffness.bounds();
        let share =
            within((along.max(secant), about), (coupling.bound_n_per_m, coupling.bound_nm_per_rad));
        let shaped = self.shaped((contact, contact.wrench * share), 0.0, p);
        Some(shaped + rubbing.wrench * share)
    }

    /// What is met of a contact through the dynamic shaping filter.
    fn shaped(
        &mut self,
        (contact, met): (&ContactSum, Wrench),
        contact_rad_per_s: f64,
        p: &Parameters,
    ) -> Wrench {
        let against = self.body.twist - contact.obstacle_motion.over(p.period_s);
        let slide = Slide {
            speed_m_per_s: slide_speed(contact, against),
            voxel_size_m: contact.voxel_size_m,
            contact_rad_per_s,
        };
        self.filter.update(met, slide, contact.acts(), &p.filter, p.period_s)
    }
}

/// Of a velocity over a window of time what the velocity in the last tick agrees with.
fn as_far_as(windowed: Twist, last: Twist) -> Twist {
    let agreed = |windowed: DVec3, last: DVec3| {
        let squared = windowed.length_squared();
        if squared > 0.0 {
            windowed * (last.dot(windowed) / squared).clamp(0.0, 1.0)
        } else {
            windowed
        }
    };
    Twist {
        linear: agreed(windowed.linear, last.linear),
        angular: agreed(windowed.angular, last.angular),
    }
}

/// A contact as it was found after a way of the tool from where it stood.
#[derive(Clone, Copy)]
struct Found<'a> {
    contact: &'a ContactSum,
    way: &'a ObstacleMotion,
}

/// How far the coupling lets the tool's weight sag, m.
fn sag_m(scene: &RenderScene, p: &Parameters, coupling: &CouplingParameters) -> DVec3 {
    p.gravity_m_per_s2 * (scene.tool.inertia.mass_kg / coupling.stiffness_n_per_m)
}

/// The share of a spring's energy that a part of its force stands for, up to 1.
pub(super) fn squared_share(part: DVec3, whole: DVec3) -> f64 {
    if whole == DVec3::ZERO {
        0.0
    } else {
        (part.length_squared() / whole.length_squared()).min(1.0)
    }
}

/// How much nearer a face comes to what it touches when that goes by so much, m.
fn nears_m(patch: &Patch, way: &ObstacleMotion) -> f64 {
    patch.normal_world.dot(way.linear + way.angular.cross(patch.arm_world))
}

/// A contact when what touches has gone by so much since it was found. Each face presses as its
/// stiffness says, where it pressed, and never pulls: the whole stiffness would leave a couple of
/// what presses at one end and pulls at the other. What the faces do not say of the wrench goes
/// with what they press with together; a rope pulls as before.
fn moved_on(contact: &ContactSum, way: &ObstacleMotion, rope: DVec3) -> ContactSum {
    let mut found_n = 0.0;
    let mut left_n = 0.0;
    let mut deeper_nm = 0.0;
    let mut found = Wrench::new(rope, DVec3::ZERO);
    let mut left = found;
    for patch in contact.patches() {
        let nears_m = nears_m(patch, way);
        let presses_n = (patch.force_n + patch.stiffness_n_per_m * nears_m).max(0.0);
        let along = Wrench::new(patch.normal_world, patch.arm_world.cross(patch.normal_world));
        found = found + along * patch.force_n;
        left = left + along * presses_n;
        found_n += patch.force_n;
        left_n += presses_n;
        deeper_nm += presses_n * nears_m;
    }
    let mut moved = *contact;
    if found_n > 0.0 {
        moved.wrench = left + (contact.wrench - found) * (left_n / found_n).min(1.0);
        // By as much deeper as the faces near that press; of a graze, as the force has it.
        let depth_m = contact.max_value_m.max(0.0);
        let deeper_m = depth_m + deeper_nm / left_n.max(f64::MIN_POSITIVE);
        let by_force_m = depth_m * (left_n / found_n).min(1.0);
        moved.max_value_m = if left_n > 0.0 && deeper_m > 0.0 { deeper_m } else { by_force_m };
    }
    moved
}

/// Energy of a contact, J: that of a spring with its force and its depth. A curved one holds two
/// thirds of it.
fn pressed(contact: &ContactSum) -> f64 {
    0.5 * contact.wrench.force.length() * contact.max_value_m.max(0.0)
}

/// How far a velocity goes in a tick.
fn way_of(twist: Twist, period_s: f64) -> ObstacleMotion {
    ObstacleMotion { linear: twist.linear * period_s, angular: twist.angular * period_s }
}

/// What a contact stiffness adds to its wrench when what touches moves by so much.
fn pushed(stiffness: &Mat6, carried: &ObstacleMotion) -> Wrench {
    let (force, torque) = stiffness.mul(carried.linear, carried.angular);
    Wrench::new(force, torque)
}

/// The largest factor up to 1 that keeps both stiffnesses within their bounds.
fn within(stiffness: (f64, f64), bounds: (f64, f64)) -> f64 {
    let share =
        |stiffness: f64, bound: f64| if stiffness > bound { bound / stiffness } else { 1.0 };
    share(stiffness.0, bounds.0).min(share(stiffness.1, bounds.1))
}

/// Speed of the contact along the surface, m/s: what excites the voxel line that the filter
/// removes.
fn slide_speed(contact: &ContactSum, tool: Twist) -> f64 {
    let Some(normal) = contact.wrench.force.try_normalize() else { return 0.0 };
    let velocity = tool.linear + tool.angular.cross(contact.arm_world);
    (velocity - normal * velocity.dot(normal)).length()
}

#[cfg(test)]
#[expect(clippy::disallowed_types, clippy::expect_used, reason = "test code")]
pub(crate) mod tests;
