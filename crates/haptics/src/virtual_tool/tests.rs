//! What a tick of the virtual tool gives, against the laws that it is to follow.

use glam::{DMat3, DQuat};

use super::*;
use crate::testing::{parameters, product, skew_block, skew_scene, skew_start};
use crate::{FilterParameters, LimitParameters};
use vps::contact::obstacle_poses::PoseStep;
use vps::pointshell::shell::Shell;

const PERIOD_S: f64 = 1e-3;

/// No value of the coupling, of damping and of the filter is 0 or 1.
fn generic() -> Parameters {
    let mut p = parameters();
    p.gravity_m_per_s2 = DVec3::new(0.3, -0.5, -1.8);
    p.contact.stiffness_n_per_m = 440.0;
    p.contact.damping_ratio = 0.35;
    p.contact.damping_n_s_per_m = 45.0;
    p.coupling.stiffness_n_per_m = 1300.0;
    p.coupling.stiffness_nm_per_rad = 0.45;
    p.coupling.felt_damping_n_s_per_m = 3.7;
    p.coupling.felt_damping_nm_s_per_rad = 0.013;
    p.coupling.free_space = FreeSpace::Drag;
    p.filter = FilterParameters { cutoff_hz: [3.0, 220.0] };
    p.limits = LimitParameters { force_n: 9.0, torque_nm: 0.25, ..p.limits };
    p
}

struct Rig {
    scene: RenderScene,
    traversal: Traversal,
    tool: VirtualTool,
}

impl Rig {
    fn new(p: Parameters, raised_m: f64) -> Self {
        Self::of(skew_scene(p), raised_m)
    }

    fn of(scene: RenderScene, raised_m: f64) -> Self {
        let traversal = crate::tick::traversal(&scene);
        Self { traversal, tool: VirtualTool::at(skew_start(raised_m)), scene }
    }

    fn touch(&mut self) -> Touch {
        self.look(None, false)
    }

    fn look(&mut self, braking: Option<&mut Braking>, moving: bool) -> Touch {
        let Self { scene, traversal, tool } = self;
        let mut query = Query { traversal, scene, p: &scene.parameters };
        tool.touch(&mut query, None, braking, moving)
    }

    /// The spring that pulls the tool to `target`.
    fn spring(&self, target: Pose) -> Spring {
        let p = &self.scene.parameters;
        let radius_m = self.scene.tool.shell.radius_m();
        Spring::between(self.tool.body.pose, target, &p.coupling, &p.limits, 1e-3, radius_m)
    }

    /// The block goes by so much in each tick, as seen from the tool.
    fn carry(&mut self, motion: ObstacleMotion) {
        let ObstacleMotion { linear, angular } = motion;
        let moved = PoseStep { center: self.tool.pose().translation, linear, angular };
        self.traversal.obstacle_poses_mut().pose_mut(0).expect("one").moved = moved;
    }

    fn follow(
        &mut self,
        touch: &mut Touch,
        rubbing: &FrictionWrench,
        is_paid: bool,
        target: (Pose, Twist),
    ) -> Pull {
        let Self { scene, traversal, tool } = self;
        let p = &scene.parameters;
        let mut query = Query { traversal, scene, p };
        tool.follow(&mut query, touch, rubbing, (&p.coupling, is_paid), target).expect("finite")
    }
}

/// Friction that no contact made.
fn rubbing() -> FrictionWrench {
    let mut stiffness = Mat6::ZERO;
    stiffness.add_outer(900.0, DVec3::new(0.6, 0.8, 0.0), DVec3::new(0.01, -0.02, 0.03));
    let wrench = Wrench::new(DVec3::new(0.3, -0.2, 0.1), DVec3::new(2e-3, 1e-3, -3e-3));
    FrictionWrench { wrench, stiffness }
}

fn target() -> (Pose, Twist) {
    let moved = skew_start(0.0).stepped(DVec3::new(1e-3, -2e-3, -1e-3), DVec3::new(0.1, -0.2, 0.3));
    let twist =
        Twist { linear: DVec3::new(0.02, 0.01, -0.03), angular: DVec3::new(0.5, 0.3, -0.4) };
    (moved, twist)
}

/// Into the block.
fn approach() -> Twist {
    let out = skew_block().transform_vector(DVec3::Z);
    Twist { linear: out * -0.05 + DVec3::new(0.01, 0.02, 0.0), angular: DVec3::new(0.2, 0.1, 0.3) }
}

/// What the arm feels of the damper between it and a tool that goes so much faster.
fn felt_damping(faster: Twist) -> Wrench {
    Wrench::new(faster.linear * 3.7, faster.angular * 0.013)
}

fn times(twist: Twist, factor: f64) -> Twist {
    Twist { linear: twist.linear * factor, angular: twist.angular * factor }
}

fn assert_near(one: Wrench, other: Wrench, share: f64) {
    let differs = one - other;
    assert!(
        differs.force.length() <= share * other.force.length()
            && differs.torque.length() <= share * other.torque.length(),
        "{one:?} {other:?}"
    );
}

/// Two ticks in contact with a block that moves: what the tool's momentum changes by is what
/// spring, dampers, weight, contact, friction and the dampers of the faces give at its end.
#[test]
fn the_tool_s_momentum_changes_by_the_sum_of_all_that_acts_at_the_end_of_the_tick() {
    let mut rig = Rig::new(generic(), 0.0);
    let p = rig.scene.parameters;
    let motion = ObstacleMotion {
        linear: DVec3::new(2e-5, -1e-5, 3e-5),
        angular: DVec3::new(1e-4, 2e-4, -1e-4),
    };
    rig.tool.body.twist = approach();
    let mut filtered = Wrench::ZERO;
    for tick_idx in 0..2 {
        let before = rig.tool.body;
        rig.carry(motion);
        let mut touch = rig.touch();
        assert_eq!(touch.contact.contacts, 24);
        let (target_pose, target_twist) = target();
        let spring = rig.spring(target_pose);
        let pull = rig.follow(&mut touch, &rubbing(), true, target());
        let Touch { contact, way, .. } = &touch;
        let inertia = rig.scene.tool.inertia;
        let mass = inertia.in_world(before.pose.rotation_matrix());
        let stiffness = contact.stiffness.positive_part(&mass).expect("finite");
        let ground = contact.obstacle_motion.over(PERIOD_S);
        assert!((ground.linear - motion.linear / PERIOD_S).length() < 1e-3);
        // The filter follows the speed along the face, and less where the contact is stiff.
        let normal = contact.wrench.force.normalize();
        let against = before.twist - ground;
        let slides = against.linear + against.angular.cross(contact.arm_world);
        let speed = (slides - normal * normal.dot(slides)).length();
        let cutoff_hz = (0.3 * speed / contact.voxel_size_m).clamp(3.0, 220.0);
        let (along, about) = stiffness.bounds();
        let pole_rad_per_s =
            (core::f64::consts::TAU * cutoff_hz).max((along / 0.3).max(about / 2e-5).sqrt());
        let alpha = (-pole_rad_per_s * PERIOD_S).exp();
        let alpha = if tick_idx == 0 { 0.0 } else { alpha };
        // What was met at the end of a first step is that of its start as far as it is linear.
        let met = contact.wrench + pushed(&stiffness, way);
        filtered = filtered * alpha + met * (1.0 - alpha);
        let after = rig.tool.body.twist;
        let changed = after - before.twist;
        let axes = before.pose.rotation_matrix();
        let momentum = Wrench::new(
            changed.linear * (0.3 / PERIOD_S),
            axes * inertia.body_kg_m2 * axes.transpose() * changed.angular / PERIOD_S,
        );
        let step = times(after, PERIOD_S);
        let slip = target_twist - after;
        let linear_damping = 2.0 * (0.3_f64 * 1300.0).sqrt();
        let angular_damping = 2.0 * (2e-5_f64 * 0.45).sqrt();
        let coupled = spring.wrench
            + Wrench::new(
                slip.linear * linear_damping - step.linear * spring.stiffness_n_per_m,
                slip.angular * angular_damping - step.angular * spring.stiffness_nm_per_rad,
            );
        let weight = Wrench::new(p.gravity_m_per_s2 * 0.3, DVec3::ZERO);
        // What gives way within the tick, and what contact damping takes, filter or not.
        let held =
            Mat6::ZERO.plus_scaled(1.0 - alpha, &stiffness).plus_scaled(1.0, &rubbing().stiffness);
        let damped = stiffness.plus_scaled(1.0, &rubbing().stiffness);
        let damping_s = 2.0 * 0.35 * (0.3 / along).sqrt();
        let relative = after - ground;
        let mut faces = Mat6::ZERO;
        for patch in contact.patches() {
            let moment = patch.arm_world.cross(patch.normal_world);
            let leaves = patch.normal_world.dot(relative.linear) + moment.dot(relative.angular);
            assert!(leaves < 0.0, "it presses, so its damper is whole");
            faces.add_outer(45.0, patch.normal_world, moment);
        }
        let forces = coupled + weight + filtered + rubbing().wrench
            - product(&held, relative) * PERIOD_S
            - product(&damped, relative) * damping_s
            - product(&faces, relative);
        assert_near(forces, momentum, 1e-9);

        // The arm feels the spring after the step, and a damper of its own.
        let stretched = rig.spring(target_pose);
        let felt = felt_damping(after - target_twist) - stretched.wrench;
        assert_near(pull.wrench, felt, 1e-12);
        let share = |one: DVec3, whole: DVec3| (one.length() / whole.length()).powi(2).min(1.0);
        let [linear_j, angular_j] = stretched.stored_j;
        // What is published is the contact at that end, and its friction; it holds energy too.
        let nears = times(ground - after, PERIOD_S);
        let nears = ObstacleMotion { linear: nears.linear, angular: nears.angular };
        let since = ObstacleMotion {
            linear: way.linear + nears.linear,
            angular: way.angular + nears.angular,
        };
        let ended = moved_on(contact, &since, DVec3::ZERO);
        let rubs = rubbing().wrench + pushed(&rubbing().stiffness, &nears);
        assert_near(touch.ended.wrench, ended.wrench + rubs, 1e-12);
        let pressed_j = 0.5 * ended.wrench.force.length() * ended.max_value_m;
        let expected_j = [
            pressed_j + linear_j * share(felt.force, stretched.wrench.force),
            angular_j * share(felt.torque, stretched.wrench.torque),
        ];
        for (stored, expected) in pull.stored_j.into_iter().zip(expected_j) {
            assert!((stored / expected - 1.0).abs() < 1e-12, "{stored} J, {expected} J");
        }
    }
}

#[test]
fn what_was_not_felt_in_free_space_comes_in_over_five_ticks_once_it_is_paid() {
    let mut p = generic();
    p.coupling.free_space = FreeSpace::Zero;
    let mut rig = Rig::new(p, 0.0);
    let unfelt = Wrench::new(DVec3::new(0.5, -0.4, 0.8), DVec3::new(0.01, 0.02, -0.03));
    rig.tool.unfelt = unfelt;
    rig.tool.tracks = true;
    let (target_pose, target_twist) = target();
    for (is_paid, kept) in [
        (false, 1.0),
        (true, 0.8),
        (true, 0.6),
        (false, 0.6),
        (true, 0.4),
        (true, 0.2),
        (true, 0.0),
    ] {
        let mut touch = rig.touch();
        assert!(touch.contact.contacts > 0);
        let pull = rig.follow(&mut touch, &FrictionWrench::ZERO, is_paid, target());
        let twist = rig.tool.body.twist - target_twist;
        let felt = felt_damping(twist) - rig.spring(target_pose).wrench - unfelt * kept;
        assert_near(pull.wrench, felt, 1e-9);
    }
}

#[test]
fn in_free_space_the_tool_stands_where_the_arm_is_lower_by_its_weight_and_nothing_is_felt() {
    let mut p = generic();
    p.coupling.free_space = FreeSpace::Zero;
    let mut rig = Rig::new(p, 4e-3);
    let sag = p.gravity_m_per_s2 * (0.3 / 1300.0);
    let first =
        skew_start(4e-3).stepped(DVec3::new(1e-4, 2e-4, -1e-4), DVec3::new(2e-3, 0.0, 1e-3));
    let second = first.stepped(DVec3::new(2e-4, -1e-4, 3e-4), DVec3::new(-1e-3, 2e-3, 3e-3));
    // The last way is half of it.
    let windowed =
        Twist { linear: DVec3::new(0.4, -0.2, 0.6), angular: DVec3::new(-2.0, 4.0, 6.0) };
    for (n, target) in [first, second].into_iter().enumerate() {
        rig.tool.keep_tracking((target, windowed), &rig.scene, &p);
        let mut touch = rig.touch();
        let pull = rig.follow(&mut touch, &FrictionWrench::ZERO, true, (target, windowed));
        assert_eq!((pull.wrench, pull.stored_j), (Wrench::ZERO, [0.0; 2]));
        assert!(rig.tool.tracks);
        let body = rig.tool.body;
        assert!((body.pose.translation - target.translation - sag).length() < 1e-15, "{n}");
        assert!(body.pose.rotation_to(target).length() < 1e-12, "{n}");
        // The sag is what will be missing when contact comes: the spring that it stretches.
        assert_near(rig.tool.unfelt, rig.spring(target).wrench * -1.0, 1e-9);
    }
    let twist = rig.tool.body.twist;
    assert!((twist.linear - DVec3::new(0.2, -0.1, 0.3)).length() < 1e-9, "{twist:?}");
    assert!((twist.angular - DVec3::new(-1.0, 2.0, 3.0)).length() < 1e-6, "{twist:?}");
    // One that is asked to leap comes by itself.
    let leap = second.stepped(DVec3::X * 0.1, DVec3::ZERO);
    rig.tool.keep_tracking((leap, windowed), &rig.scene, &p);
    assert!(!rig.tool.tracks && rig.tool.body.twist == twist);
}

#[test]
fn a_tool_tracks_no_further_than_it_may() {
    let start = skew_start(0.0);
    let target = start.stepped(DVec3::new(3e-3, 0.0, 4e-3), DVec3::new(0.0, 0.3, 0.0));
    let sag = DVec3::new(0.0, 0.0, -1e-3);
    let way_m = DVec3::new(3.0, 0.0, 3.0).length() * 1e-3;
    for (most_m, stands) in [(way_m + 0.3 * 0.02 + 1e-6, true), (way_m + 0.3 * 0.02 - 1e-6, false)]
    {
        let mut tool = VirtualTool::at(start);
        let faster = Twist { linear: DVec3::new(6.0, 0.0, 6.0), angular: DVec3::Y * 500.0 };
        assert_eq!(tool.track((target, faster), sag, (0.02, most_m), PERIOD_S), stands);
        let expected = if stands { target.translation + sag } else { start.translation };
        assert_eq!(tool.pose().translation, expected);
        let speed = if stands { DVec3::new(3.0, 0.0, 3.0) } else { DVec3::ZERO };
        assert!((tool.body.twist.linear - speed).length() < 1e-9);
        let turns = if stands { DVec3::Y * 300.0 } else { DVec3::ZERO };
        assert!((tool.body.twist.angular - turns).length() < 1e-6);
    }
}

#[test]
pub(crate) fn without_a_virtual_tool_the_arm_gets_the_contact_as_stiff_as_it_can_take() {
    let mut p = generic();
    p.coupling.mode = CouplingMode::Direct;
    p.filter.cutoff_hz = [f64::INFINITY; 2];
    for (bound_n_per_m, bound_nm_per_rad) in [(700.0, 1e9), (1e9, 0.03), (1e9, 1e9)] {
        p.coupling.bound_n_per_m = bound_n_per_m;
        p.coupling.bound_nm_per_rad = bound_nm_per_rad;
        let mut rig = Rig::new(p, 0.0);
        let mut touch = rig.touch();
        let held = rig.tool.held(&touch.contact, &rig.scene.tool.inertia).expect("finite");
        let (along, about) = held.plus_scaled(1.0, &rubbing().stiffness).bounds();
        let share = (bound_n_per_m / along).min(bound_nm_per_rad / about).min(1.0);
        let pull = rig.follow(&mut touch, &rubbing(), true, target());
        let expected = (touch.contact.wrench + rubbing().wrench) * share;
        assert_near(pull.wrench, expected, 1e-12);
        assert_eq!(pull.stored_j, [0.0; 2]);
        assert_eq!(rig.tool.pose(), skew_start(0.0));
    }
}

#[test]
fn the_constraint_coupling_stands_a_tool_on_a_face_that_moves() {
    let mut p = generic();
    p.coupling.mode = CouplingMode::Constraint;
    let motion = ObstacleMotion { linear: DVec3::new(2e-5, -1e-5, 3e-5), angular: DVec3::ZERO };
    let sag = p.gravity_m_per_s2 * (0.3 / 1300.0);
    let turning = ObstacleMotion { angular: DVec3::new(1e-3, -2e-3, 3e-3), ..motion };
    // In free space it is where the arm is, whatever moves.
    let mut rig = Rig::new(p, 4e-3);
    let target =
        rig.tool.pose().stepped(DVec3::new(1e-4, 2e-4, -1e-4), DVec3::new(2e-3, 0.0, 1e-3));
    rig.carry(turning);
    let mut touch = rig.touch();
    let pull = rig.follow(&mut touch, &FrictionWrench::ZERO, true, (target, Twist::ZERO));
    assert!((rig.tool.pose().translation - target.translation - sag).length() < 1e-12);
    assert!(rig.tool.pose().rotation_to(target).length() < 1e-9);
    assert!(pull.stored_j[0] > 0.0, "of the spring alone");
    // Pressed straight down, it goes with the face, and a tick takes half of what it is too deep.
    let mut rig = Rig::new(p, 0.0);
    let out = skew_block().transform_vector(DVec3::Z);
    let down = rig.tool.pose().stepped(out * -1e-3 - sag, DVec3::ZERO);
    let before = rig.tool.pose();
    rig.carry(motion);
    let mut touch = rig.touch();
    let depth_m = touch.contact.max_value_m;
    rig.follow(&mut touch, &FrictionWrench::ZERO, true, (down, Twist::ZERO));
    let after = rig.tool.pose();
    let shell_arms = [(-6.0, -4.0), (6.0, -4.0), (-6.0, 4.0), (6.0, 4.0)]
        .map(|(x, y)| DVec3::new(x, y, -5.0) * 1e-3);
    let deepest = |pose: Pose| {
        let depth = |arm: &DVec3| {
            20e-3 - skew_block().inverse().transform_point(pose.transform_point(*arm)).z
        };
        shell_arms.iter().map(depth).fold(0.0, f64::max)
    };
    assert!((deepest(before) - depth_m).abs() < 1e-6, "{} {depth_m}", deepest(before));
    let left_m = deepest(after) + motion.linear.dot(out) - depth_m;
    let removed_m = 0.5 * (depth_m - 1e-4);
    assert!((left_m + removed_m).abs() < 2e-6, "{left_m} m and not {} m", -removed_m);
}

#[test]
fn a_face_that_moves_drags_a_tool_that_stands() {
    let mut p = generic();
    p.contact.friction =
        crate::FrictionParameters { r#static: 5.0, dynamic: 0.4, stiffness_n_per_m: 2300.0 };
    let mut rig = Rig::new(p, 0.0);
    let touch = rig.touch();
    assert_eq!(rig.tool.rub(&touch, &p).wrench, Wrench::ZERO);
    let linear = DVec3::new(2e-5, -1e-5, 3e-5);
    let moved = PoseStep { center: DVec3::ZERO, linear, angular: DVec3::ZERO };
    rig.traversal.obstacle_poses_mut().pose_mut(0).expect("one").moved = moved;
    let touch = rig.touch();
    let normal = touch.contact.patches().next().expect("it touches").normal_world;
    let force = (linear - normal * normal.dot(linear)) * 2300.0;
    assert!((rig.tool.rub(&touch, &p).wrench.force - force).length() < 1e-9);
}

#[test]
pub(crate) fn a_brake_acts_along_the_way_out_of_what_is_ahead() {
    let mut p = generic();
    p.contact.braking = true;
    let mut rig = Rig::new(p, 0.6e-3);
    let mut braking = Braking::of(&rig.scene).expect("asked for");
    rig.tool.body.twist = Twist { angular: DVec3::ZERO, ..approach() };
    let touch = rig.look(Some(&mut braking), false);
    assert_eq!(touch.contact.contacts, 0);
    let damping = touch.brake.expect("it approaches").damping(0.3, PERIOD_S);
    // Half of the speed towards the face goes in a tick: (m + T b) v' = m v.
    let out = skew_block().transform_vector(DVec3::Z);
    let (force, _) = damping.mul(out, DVec3::ZERO);
    assert!((force - out * (0.3 / PERIOD_S)).length() < 1e-3 * force.length(), "{force}");
    rig.tool.body.twist = Twist { linear: out * 0.05, angular: DVec3::ZERO };
    let touch = rig.look(Some(&mut braking), false);
    assert!(touch.brake.is_none(), "it recedes");
}

#[test]
fn a_tick_is_bounded_by_what_the_contact_query_can_see() {
    let mut rig = Rig::new(generic(), 0.0);
    rig.touch();
    assert!((rig.tool.step_limit_m - 2.9e-3).abs() < 1e-9, "{}", rig.tool.step_limit_m);
    rig.look(None, true);
    assert!((rig.tool.step_limit_m - 2.65e-3).abs() < 1e-9, "{}", rig.tool.step_limit_m);
    let far = skew_start(0.0).stepped(DVec3::Z * 0.1, DVec3::ZERO);
    let twist = Twist { linear: DVec3::X, angular: DVec3::Y };
    rig.tool.stand_at((far, twist), &rig.scene);
    let went_m = (rig.tool.pose().translation - skew_start(0.0).translation).length();
    assert!((went_m - 2.65e-3).abs() < 1e-9, "{went_m} m");
}

#[test]
fn shares_energies_and_speeds_are_those_of_their_formulas() {
    let whole = DVec3::new(3.0, 0.0, -4.0);
    assert_eq!(squared_share(DVec3::ZERO, DVec3::ZERO), 0.0);
    assert!((squared_share(DVec3::Y * 2.0, whole) - 4.0 / 25.0).abs() < 1e-15);
    assert_eq!(squared_share(whole * 2.0, whole), 1.0);
    assert_eq!(within((100.0, 1.0), (200.0, 2.0)), 1.0);
    assert_eq!(within((400.0, 1.0), (200.0, 2.0)), 0.5);
    assert_eq!(within((400.0, 8.0), (200.0, 2.0)), 0.25);
    let mut rig = Rig::new(generic(), 0.0);
    let mut contact = rig.touch().contact;
    let half = contact.wrench.force.length() * contact.max_value_m / 2.0;
    assert!((pressed(&contact) - half).abs() < 1e-15);
    contact.max_value_m = -1.0;
    assert_eq!(pressed(&contact), 0.0);
    let turn = DMat3::from_quat(DQuat::from_scaled_axis(DVec3::new(0.5, 0.2, -0.7)));
    contact.wrench.force = turn * DVec3::Z * 7.0;
    contact.arm_world = turn * DVec3::new(0.03, 0.01, -0.02);
    // In the wall's own axes: 0.3 + 2 · (−0.02) along x, −1 · (−0.02) … along y, z does not count.
    let linear = DVec3::new(0.3, -0.1, 5.0);
    let angular = DVec3::new(1.0, 2.0, 3.0);
    let at = linear + angular.cross(DVec3::new(0.03, 0.01, -0.02));
    let twist = Twist { linear: turn * linear, angular: turn * angular };
    let expected = DVec3::new(at.x, at.y, 0.0).length();
    assert!((slide_speed(&contact, twist) - expected).abs() < 1e-12);
    contact.wrench.force = DVec3::ZERO;
    assert_eq!(slide_speed(&contact, twist), 0.0);
}

/// A block that was found deep in a face, as a step tries it, and went back.
#[test]
fn what_is_published_is_what_presses_where_the_step_ended() {
    let mut rig = Rig::new(generic(), -0.5e-3);
    let deep = rig.touch().contact;
    let out = skew_block().transform_vector(DVec3::Z);
    let way = |raised_m: f64| ObstacleMotion { linear: out * -raised_m, angular: DVec3::ZERO };
    for raised_m in [0.0, 1e-5, 1e-4, 3e-4] {
        rig.tool = VirtualTool::at(skew_start(raised_m - 0.5e-3));
        let there = rig.touch().contact;
        let moved = moved_on(&deep, &way(raised_m), DVec3::ZERO);
        let differs = moved.wrench - there.wrench;
        let force_n = there.wrench.force.length();
        assert!(differs.force.length() < 1e-2 * force_n, "{raised_m}: {differs:?}");
        // A face that lies askew presses farther down as it rises.
        let lever_m = differs.torque.length() / force_n;
        assert!(lever_m < 2.0 * raised_m + 1e-6, "{raised_m}: {differs:?}");
        assert!((moved.max_value_m - there.max_value_m).abs() < 1e-7, "{raised_m}");
    }
    // It left: nothing pulls, but for a rope.
    let rope = DVec3::new(0.1, -0.2, 0.3);
    let mut roped = deep;
    roped.add_rope(Wrench::new(rope, DVec3::ZERO), &Mat6::ZERO);
    let left = moved_on(&roped, &way(5e-3), rope);
    assert_near(left.wrench, Wrench::new(rope, DVec3::ZERO), 1e-12);
    assert_eq!(left.max_value_m, 0.0);
    let pressed = moved_on(&roped, &way(1e-4), rope).wrench - Wrench::new(rope, DVec3::ZERO);
    assert_near(pressed, moved_on(&deep, &way(1e-4), DVec3::ZERO).wrench, 1e-12);
}

#[test]
fn a_tool_that_lands_keeps_what_does_not_go_into_the_surface() {
    let mut rig = Rig::new(generic(), 0.0);
    let motion = ObstacleMotion { linear: DVec3::new(2e-5, -1e-5, 3e-5), angular: DVec3::ZERO };
    rig.carry(motion);
    let contact = rig.touch().contact;
    let inertia = rig.scene.tool.inertia;
    let normal = contact.wrench.force.normalize();
    let leaves = |twist: Twist| {
        let seen = twist - contact.obstacle_motion.over(PERIOD_S);
        normal.dot(seen.linear + seen.angular.cross(contact.arm_world))
    };
    assert!(leaves(approach()) < -0.01);
    rig.tool.body.twist = approach();
    rig.tool.end_approach(&contact, &inertia, PERIOD_S).expect("finite");
    let after = rig.tool.body.twist;
    assert!(leaves(after).abs() < 1e-12);
    // The blow goes through the contact, along its force.
    let blow = product(&inertia.in_world(rig.tool.pose().rotation_matrix()), after - approach());
    let along = blow.force.dot(normal);
    assert!(along > 0.0 && (blow.force - normal * along).length() < 1e-12, "{blow:?}");
    assert!((blow.torque - contact.arm_world.cross(blow.force)).length() < 1e-12, "{blow:?}");
    let away = times(approach(), -1.0);
    rig.tool.body.twist = away;
    rig.tool.end_approach(&contact, &inertia, PERIOD_S).expect("finite");
    assert!(leaves(away) > 0.0 && rig.tool.body.twist == away);
}

/// In free space, a hand that was so far from the tool in the tick before, and where it is now: some
/// 0.4 mm and 4 mrad on.
fn hand_ahead(lag: DVec3) -> (Rig, Pose) {
    let mut p = generic();
    p.coupling.free_space = FreeSpace::Zero;
    let mut rig = Rig::new(p, 4e-3);
    let before = rig.tool.pose().stepped(lag, DVec3::ZERO);
    rig.tool.target = Some(before);
    (rig, before.stepped(DVec3::new(2e-4, -1e-4, 3e-4), DVec3::new(-1e-3, 2e-3, 3e-3)))
}

#[test]
fn a_tool_that_catches_up_in_free_space_has_the_velocity_of_the_hand_s_way() {
    let (mut rig, target) = hand_ahead(DVec3::new(1e-4, 1e-4, 0.0));
    let mut touch = rig.touch();
    let windowed =
        Twist { linear: DVec3::new(0.4, -0.2, 0.6), angular: DVec3::new(-2.0, 4.0, 6.0) };
    rig.follow(&mut touch, &FrictionWrench::ZERO, true, (target, windowed));
    assert!(rig.tool.tracks);
    let Twist { linear, angular } = rig.tool.body.twist;
    assert!((linear - DVec3::new(0.2, -0.1, 0.3)).length() < 1e-9, "{linear}");
    assert!((angular - DVec3::new(-1.0, 2.0, 3.0)).length() < 1e-6, "{angular}");
}

#[test]
fn a_tool_that_lags_in_free_space_is_damped_by_the_hand_s_way_and_not_felt() {
    let (mut rig, target) = hand_ahead(DVec3::X * 0.1);
    let mut touch = rig.touch();
    let late = Twist { linear: DVec3::splat(9.0), angular: DVec3::splat(9.0) };
    let pull = rig.follow(&mut touch, &FrictionWrench::ZERO, true, (target, late));
    assert_eq!((pull.wrench, pull.stored_j), (Wrench::ZERO, [0.0; 2]));
    assert!(!rig.tool.tracks);
    let hand = Twist { linear: DVec3::new(0.2, -0.1, 0.3), angular: DVec3::new(-1.0, 2.0, 3.0) };
    let damper = felt_damping(rig.tool.body.twist - hand);
    assert_near(rig.tool.unfelt, damper - rig.spring(target).wrench, 1e-5);
}

#[test]
fn a_velocity_counts_as_far_as_the_last_tick_agrees() {
    let windowed = Twist { linear: DVec3::new(0.3, 0.0, -0.4), angular: DVec3::X * 3.0 };
    for (last, share) in [
        (DVec3::new(0.3, 0.0, -0.4), 1.0),
        // A step of the encoder: 7.5 · 0.3 is more than 0.25.
        (DVec3::X * 7.5, 1.0),
        // 0.06 + 0.04 of 0.25, and nothing that stands across counts.
        (DVec3::new(0.2, 5.0, -0.1), 0.4),
        (DVec3::ZERO, 0.0),
        (DVec3::new(-0.3, 0.0, 0.4), 0.0),
    ] {
        let found = as_far_as(windowed, Twist { linear: last, angular: DVec3::X * 1.5 });
        assert!((found.linear - windowed.linear * share).length() < 1e-12, "{last}: {found:?}");
        assert!((found.angular - windowed.angular * 0.5).length() < 1e-12, "{found:?}");
        assert_eq!(as_far_as(Twist::ZERO, Twist { linear: last, ..windowed }), Twist::ZERO);
    }
}

#[test]
fn a_tool_is_finite_in_its_pose_and_in_its_velocity() {
    let tool = VirtualTool::at(skew_start(0.0));
    assert!(tool.is_finite());
    let mut lost = tool.clone();
    lost.body.pose.translation.y = f64::NAN;
    let mut wild = tool;
    wild.body.twist.angular.z = f64::INFINITY;
    assert!(!lost.is_finite() && !wild.is_finite());
}

/// The damper c of one face acts on w · v, where v is the velocity as seen from the block. With S,
/// which resists velocities without it, w · v = w · v₀/(1 + T c w · S⁻¹ w): its inverse grows in
/// proportion to c.
#[test]
fn a_face_that_a_block_comes_towards_is_damped_by_the_speed_between_them() {
    let out = skew_block().transform_vector(DVec3::Z);
    let closes = |damping_n_s_per_m: f64| {
        let mut p = generic();
        p.contact.damping_n_s_per_m = damping_n_s_per_m;
        let mut scene = skew_scene(p);
        // So heavy to turn that it does not, and pushed straight out: all is linear.
        scene.tool.inertia.body_kg_m2 *= 1e9;
        scene.tool.inertia.least_kg_m2 *= 1e9;
        let out_body = skew_start(-0.2e-3).rotation.conjugate() * out;
        let points: Vec<_> =
            scene.tool.shell.points().map(|(point, _)| (point.as_dvec3(), out_body)).collect();
        scene.tool.shell = Shell::new(&points, 1e-3);
        // So deep that no point leaves.
        let mut rig = Rig::of(scene, -0.2e-3);
        // The tool is at rest, the block comes with 0.1 m/s.
        rig.carry(ObstacleMotion { linear: out * 1e-4, angular: DVec3::ZERO });
        let mut touch = rig.touch();
        let target = (rig.tool.pose(), Twist::ZERO);
        rig.follow(&mut touch, &FrictionWrench::ZERO, true, target);
        assert_eq!(touch.contact.patches().count(), 1);
        let patch = touch.contact.patches().next().expect("it touches");
        let moment = patch.arm_world.cross(patch.normal_world);
        let Twist { linear, angular } = rig.tool.body.twist;
        patch.normal_world.dot(linear - out * 0.1) + moment.dot(angular)
    };
    let [free, damped, twice] = [0.0, 300.0, 600.0].map(closes);
    assert!(free < 0.0 && damped / free < 0.7, "{free} {damped}");
    let grows = (1.0 / twice - 1.0 / damped) / (1.0 / damped - 1.0 / free);
    // The depths at the end of the step are of single precision.
    assert!((grows - 1.0).abs() < 1e-4, "{free} {damped} {twice}");
}
