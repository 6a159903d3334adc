//! The one step, in one place: sample check → contact sum → shaping filter → coupling → passivity → power → slew → magnitude →
//! finite check.
//!
//! ```text
//!                 Enable and a sound sample                 gain = 1
//!   Disabled ───────────────────────────────► Enabling ───────────────► Enabled
//!      ▲  ▲                                      │                        │
//!      │  │ gain = 0                       Stop  ▼                 Stop   ▼
//!      │  └─────────────────────────────────  Stopping ◄──────────────────┘
//!      │ Disable request                         │ any fault, from every state with force
//!      └───────────────────  Fault ◄─────────────┘
//! ```
//! A `Disable` request leads from every state to `Disabled` at once. Force flows in `Enabling`, `Enabled` and `Stopping` only.

use glam::DVec3;

use super::auto_limit::LoopDelay;
use super::constraint::{self, SLOP_VOXELS};
use super::contact::planes::DeepestContacts;
use super::contact::{Budget, Contact, ContactSum, Machine, Obstacle, Traversal, Way};
use super::coupling::{Body, Inertia, LinearContact, Pull, Spring};
use super::filter::{ShapingFilter, Slide};
use super::friction::{Friction, FrictionWrench};
use super::limits::{Limiter, Ramp};
use super::params::{CouplingMode, CouplingParameters, FreeSpace};
use super::passivity_control::PassivityController;
use super::port::Port;
use super::quasi_static::StaticBalance;
use super::sample::SampleMonitor;
use super::stability::filter_delay_s;
use super::{Faults, Parameters};
use crate::pointshell::shell::Shell;
use crate::spatial::{DeviceSample, Mat6, Pose, SampleStatus, Twist, Wrench};

/// What the supervisor wants of the servo.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DriveRequest {
    /// No force. Also acknowledges a fault.
    #[default]
    Disable,
    /// Ramp up and render. After a fault it takes a `Disable` first.
    Enable,
    /// Ramp down to zero, then stay disabled.
    Stop,
}

/// Where the drive stands (CRTK: DISABLED, ENABLED + is_busy, ENABLED, FAULT).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Drive {
    /// Zero wrench.
    #[default]
    Disabled,
    /// Ramping up from zero.
    Enabling,
    /// Rendering.
    Enabled,
    /// Ramping down to zero after a stop request.
    Stopping,
    /// Zero wrench until a `Disable` request, then `Enable`.
    Fault,
}

/// Everything that enters one tick from outside.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TickInput {
    /// Newest device sample.
    pub sample: DeviceSample,
    /// What the supervisor wants.
    pub request: DriveRequest,
    /// The loop woke up after its deadline had passed.
    pub overrun: bool,
}

/// Everything that leaves one tick.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TickOutput {
    /// Wrench to write to the arm (`rendered`): device axes, reduced at the grip point, limited, only actuated axes.
    pub command_device: Wrench,
    /// The same before axes that the arm cannot actuate were dropped (`commanded`).
    pub commanded_device: Wrench,
    /// Raw contact wrench on the tool, friction included, world axes, about the centre of mass, before filter and coupling.
    pub contact_world: Wrench,
    /// Pose of the tool (mesh file frame) in the world.
    pub world_from_tool: Pose,
    /// Points with V > 0.
    pub contacts: u32,
    /// Deepest penetration, m; 0 without contact.
    pub max_depth_m: f64,
    /// How far the tool is proven to be from contact, clipped at the band, m; negative: how deep it is.
    pub clearance_m: f64,
    /// Points that the contact query's budget left out, which others stood for.
    pub points_left_out: u32,
    /// Energy that the arm has taken from the hand since enable, J; negative means that it gave more than it took.
    pub energy_j: f64,
    /// The passivity controller damps in this tick.
    pub passivity_active: bool,
    /// Longest round trip measured since enable, ticks; 0 where the arm does not measure it.
    pub delay_ticks: u32,
    /// State of the drive after this tick.
    pub drive: Drive,
    /// Faults that are latched.
    pub faults: Faults,
}

/// The tool as the tick sees it.
#[derive(Debug)]
pub struct Tool {
    /// Points and normals about the centre of mass.
    pub shell: Shell,
    /// Mass properties.
    pub inertia: Inertia,
    /// Centre of mass, which is also the grip point, in the tool frame, m.
    pub center_of_mass_tool: DVec3,
}

/// The immutable scene: everything allocated and touched before the first tick.
#[derive(Debug)]
pub struct RenderScene {
    /// Parameters, SI.
    pub parameters: Parameters,
    /// The static objects.
    #[expect(clippy::disallowed_types, reason = "filled on the cold side, never resized")]
    pub obstacles: Vec<Obstacle>,
    /// The moving object.
    pub tool: Tool,
}

/// What the tick remembers from one call to the next. Everything it needs is allocated when it is made.
#[derive(Clone, Debug)]
pub struct State {
    drive: Drive,
    faults: Faults,
    monitor: SampleMonitor,
    overruns: u32,
    port: Port,
    body: Body,
    filter: ShapingFilter,
    friction: Friction,
    /// How far a point of the tool may go in the next tick, m.
    step_limit_m: f64,
    /// 0 in free space, 1 in contact, so that the coupling comes in over [`CONTACT_RISE_S`].
    contact_gain: Ramp,
    enable_gain: Ramp,
    limiter: Limiter,
    traversal: Traversal,
    passivity: PassivityController,
    delay: LoopDelay,
    balance: StaticBalance,
}

/// Time in which the coupling wrench comes in at first contact, s (decision: free space).
const CONTACT_RISE_S: f64 = 5e-3;

/// How far the shell may follow the arm in one tick without a virtual tool, voxels.
const SEEN_VOXELS: f64 = 2.9;

impl State {
    /// The state before the first tick of `scene`: disabled, the tool at its start pose.
    pub fn new(scene: &RenderScene) -> Self {
        Self {
            drive: Drive::Disabled,
            faults: Faults::NONE,
            monitor: SampleMonitor::default(),
            overruns: 0,
            port: Port::default(),
            body: Body { pose: scene.start(), twist: Twist::ZERO },
            filter: ShapingFilter::default(),
            friction: Friction::default(),
            step_limit_m: 0.0,
            contact_gain: Ramp::default(),
            enable_gain: Ramp::default(),
            limiter: Limiter::default(),
            traversal: Traversal::new(Machine::best(), Way::Tree, &scene.obstacles, &scene.tool.shell),
            passivity: PassivityController::default(),
            delay: LoopDelay::default(),
            balance: StaticBalance::default(),
        }
    }

    /// Limits what the contact query of a tick may look at. It is part of what enters the ticks: a recording that is to be replayed has to
    /// know it.
    pub fn set_budget(&mut self, budget: Budget) {
        self.traversal.set_budget(budget);
    }

    /// The limit.
    pub fn budget(&self) -> Budget {
        self.traversal.budget()
    }

    /// One contact query at a pose where the tool overlaps an obstacle, another one each `turn`, as if nothing were known from earlier ones;
    /// returns what it looked at. To learn what queries cost before the first tick; use a copy of the state.
    pub fn rehearse(&mut self, scene: &RenderScene, turn: usize) -> u32 {
        let (p, shell) = (&scene.parameters, &scene.tool.shell);
        let pose = self.traversal.overlapping_pose(&scene.obstacles, shell, turn).unwrap_or(self.body.pose);
        self.traversal.forget();
        ContactSum::of(&mut self.traversal, &scene.obstacles, shell, pose, &p.contact, &p.filter).looked_at
    }

    /// Forgets all motion and force; the drive state is the caller's.
    fn at_rest(&mut self, body: Pose) {
        self.body = Body { pose: body, twist: Twist::ZERO };
        self.filter.reset();
        self.friction.reset();
        self.step_limit_m = 0.0;
        self.balance = StaticBalance::default();
        self.contact_gain.reset();
        self.enable_gain.reset();
        self.limiter.reset();
    }

    fn fail(&mut self, faults: Faults) {
        self.faults |= faults;
        if !self.faults.is_empty() {
            self.drive = Drive::Fault;
            let body = self.body.pose;
            self.at_rest(body);
        }
    }
}

impl RenderScene {
    /// Start pose of the body axes (tool axes at the centre of mass).
    fn start(&self) -> Pose {
        self.parameters.port.start * Pose::from_translation(self.tool.center_of_mass_tool)
    }
}

/// One step of the loop.
///
/// RT: safe. Pure and total: same scene, state and input, same bits; no allocation, no panic. Anything that is not finite gives a
/// zero wrench and a fault. Cost: one walk over the shell's tree per obstacle plus a 6×6 solve.
pub fn tick(scene: &RenderScene, state: &mut State, input: &TickInput) -> TickOutput {
    let p = &scene.parameters;
    let check = state.monitor.check(&input.sample, &p.limits, p.period_s);
    state.overruns = if input.overrun { state.overruns.saturating_add(1) } else { 0 };
    let mut faults = check.faults;
    if p.limits.overrun_fault_ticks > 0 && state.overruns >= p.limits.overrun_fault_ticks {
        faults |= Faults::OVERRUN;
    }
    advance_drive(scene, state, input, faults);

    let moving = |state: &State| matches!(state.drive, Drive::Enabling | Drive::Enabled | Drive::Stopping);
    let target = state.port.target(&input.sample, &p.port, scene.start());
    if moving(state) && p.coupling.mode == CouplingMode::Direct {
        // No virtual tool: the shell stands where the arm is now, so contact has no delay of its own. Only what is too fast to be
        // seen in passing is followed more slowly.
        state.body = state.body.followed(target, scene.tool.shell.radius_m(), state.step_limit_m);
    }
    let (obstacles, shell, body) = (&scene.obstacles, &scene.tool.shell, state.body.pose);
    let mut deepest = (p.coupling.mode == CouplingMode::Constraint).then(DeepestContacts::default);
    let contact = match deepest.as_mut() {
        Some(deepest) => {
            let mut also = |obstacle_idx: usize, contact: &Contact| deepest.add(obstacle_idx, contact);
            ContactSum::of_with(&mut state.traversal, obstacles, shell, body, &p.contact, &p.filter, Some(&mut also))
        }
        None => ContactSum::of(&mut state.traversal, obstacles, shell, body, &p.contact, &p.filter),
    };
    // A point that goes no further than this is seen inside of a wall of three voxels.
    state.step_limit_m = contact.step_limit_m.max(SEEN_VOXELS * contact.voxel_size_m);
    if !contact.wrench.is_finite() || contact.max_value_m.is_nan() {
        state.fail(Faults::NON_FINITE);
    }
    let rubbing = if moving(state) {
        state.friction.update(contact.patches(), state.body.pose, &p.contact.friction)
    } else {
        FrictionWrench::ZERO
    };
    let mut commanded_device = Wrench::ZERO;
    let mut command_device = Wrench::ZERO;
    if moving(state) {
        state.delay.measure(input.sample.delay_ticks, p.period_s);
        let delay_ticks = input.sample.delay_ticks.max(p.arm.delay_ticks);
        state.passivity.observe(input.sample.pose, delay_ticks, p.period_s);
        let filter_lag_s =
            if p.coupling.mode == CouplingMode::Direct { filter_delay_s(p.filter.cutoff_hz[0], p.period_s) } else { 0.0 };
        let coupling = state.delay.limited(&p.coupling, &p.arm, filter_lag_s, p.period_s);
        let felt = match p.coupling.mode {
            CouplingMode::Direct => Some(direct(state, &contact, &rubbing, &coupling, p)),
            _ => coupled(scene, state, (&contact, &rubbing, deepest.as_ref()), &coupling, target),
        };
        match felt {
            None => state.fail(Faults::SOLVER),
            Some(_) if !(state.body.pose.is_finite() && state.body.twist.is_finite()) => state.fail(Faults::NON_FINITE),
            Some(felt_world) => {
                let up = state.drive != Drive::Stopping && !check.ramp_down;
                let gain = state.enable_gain.advance(up, p.limits.ramp_s, p.period_s);
                let wanted = p.port.wrench_device(felt_world);
                // Only what the motors give has power and is limited; the rest is reported and dropped.
                let actuated = p.port.actuated_part(wanted);
                let damped = state.passivity.damped(actuated, input.sample.twist, &p.arm, &p.limits, p.period_s);
                let damped = p.port.actuated_part(damped);
                let limited = state.limiter.apply(damped, input.sample.twist, gain, &p.limits, p.period_s);
                if limited.finite {
                    command_device = limited.wrench;
                    commanded_device = limited.wrench + (wanted - actuated) * gain;
                    state.drive = match state.drive {
                        Drive::Enabling if gain >= 1.0 => Drive::Enabled,
                        Drive::Stopping if gain <= 0.0 && command_device == Wrench::ZERO => Drive::Disabled,
                        drive => drive,
                    };
                } else {
                    state.fail(Faults::NON_FINITE);
                }
            }
        }
    }
    state.passivity.hold(command_device);
    let body_from_tool = Pose::from_translation(-scene.tool.center_of_mass_tool);
    TickOutput {
        command_device,
        commanded_device,
        contact_world: contact.wrench + rubbing.wrench,
        world_from_tool: state.body.pose * body_from_tool,
        contacts: contact.contacts,
        max_depth_m: contact.max_value_m.max(0.0),
        clearance_m: -contact.max_value_m,
        points_left_out: contact.left_out,
        energy_j: state.passivity.energy_j(),
        passivity_active: state.passivity.is_active(),
        delay_ticks: state.delay.worst_ticks(),
        drive: state.drive,
        faults: state.faults,
    }
}

/// Follows the supervisor's request; `faults` are those of this tick's sample.
fn advance_drive(scene: &RenderScene, state: &mut State, input: &TickInput, faults: Faults) {
    let with_force = matches!(state.drive, Drive::Enabling | Drive::Enabled | Drive::Stopping);
    if with_force && !faults.is_empty() {
        state.fail(faults);
        return;
    }
    match (state.drive, input.request) {
        (_, DriveRequest::Disable) => {
            let body = state.body.pose;
            state.at_rest(body);
            state.drive = Drive::Disabled;
            state.faults = Faults::NONE;
        }
        (Drive::Disabled, DriveRequest::Enable) if !faults.is_empty() => state.fail(faults),
        // A sample that is old, or never came, cannot be the zero of the indexing.
        (Drive::Disabled, DriveRequest::Enable) if input.sample.status == SampleStatus::Fresh => {
            state.at_rest(scene.start());
            state.port = Port::indexed(&input.sample);
            state.passivity.reset();
            state.delay = LoopDelay::starting_at(input.sample.delay_ticks);
            state.drive = Drive::Enabling;
        }
        (Drive::Enabling | Drive::Enabled, DriveRequest::Stop) => state.drive = Drive::Stopping,
        _ => {}
    }
}

/// Coupling with a virtual tool: steps the body, gives the wrench that the arm feels (world axes, about the grip point).
fn coupled(
    scene: &RenderScene,
    state: &mut State,
    (contact, rubbing, deepest): (&ContactSum, &FrictionWrench, Option<&DeepestContacts>),
    coupling: &CouplingParameters,
    target: (Pose, Twist),
) -> Option<Wrench> {
    let p = &scene.parameters;
    let radius_m = scene.tool.shell.radius_m();
    let (target_pose, target_twist) = target;
    let touching = contact.contacts > 0;

    let spring = |body: Pose| Spring::between(body, target_pose, coupling, &p.limits, contact.voxel_size_m, radius_m);
    let stretched = spring(state.body.pose);
    let weight = p.gravity_m_per_s2 * scene.tool.inertia.mass_kg;
    let twist = match (coupling.mode, deepest) {
        (CouplingMode::Static, _) => {
            let stiffness = contact.stiffness.plus_scaled(1.0, &rubbing.stiffness);
            let step = state.balance.step(&stretched, weight, contact.wrench + rubbing.wrench, &stiffness)?;
            Twist { linear: step.0 / p.period_s, angular: step.1 / p.period_s }
        }
        (CouplingMode::Constraint, Some(deepest)) => {
            let sag_m = weight / coupling.stiffness_n_per_m;
            let free = (target_pose.translation - state.body.pose.translation + sag_m, state.body.pose.rotation_to(target_pose));
            let body = state.body.pose;
            let way_out = |obstacle_idx: usize, contact: &Contact| match scene.obstacles.get(obstacle_idx) {
                Some(obstacle) => obstacle.way_out_world(body, contact),
                None => body.transform_vector(contact.normal_body.as_dvec3()),
            };
            let step = constraint::step(free, body, coupling, deepest, way_out, SLOP_VOXELS * contact.voxel_size_m)?;
            Twist { linear: step.0 / p.period_s, angular: step.1 / p.period_s }
        }
        _ => step_with_mass(scene, state, (contact, rubbing), coupling, (stretched, target_twist, weight))?,
    };
    state.body = state.body.moved(twist, p.period_s, radius_m, contact.step_limit_m);

    // The spring after the step: what the tool holds on to now is what the hand feels now.
    let damper = Wrench::new(
        (state.body.twist.linear - target_twist.linear) * coupling.felt_damping_n_s_per_m,
        (state.body.twist.angular - target_twist.angular) * coupling.felt_damping_nm_s_per_rad,
    );
    let felt = damper - spring(state.body.pose).wrench;
    Some(match coupling.free_space {
        FreeSpace::Drag => felt,
        FreeSpace::Zero => {
            let gain = state.contact_gain.advance(touching, CONTACT_RISE_S, p.period_s);
            if touching { felt * gain } else { Wrench::ZERO }
        }
    })
}

/// Velocity of a virtual tool with mass after one step. `None` on non-finite input.
fn step_with_mass(
    scene: &RenderScene,
    state: &mut State,
    (contact, rubbing): (&ContactSum, &FrictionWrench),
    coupling: &CouplingParameters,
    (spring, target_twist, weight): (Spring, Twist, DVec3),
) -> Option<Twist> {
    let p = &scene.parameters;
    let inertia = &scene.tool.inertia;
    let damping = Pull::critical_damping(coupling, inertia);
    let scale = match coupling.mode {
        CouplingMode::SemiImplicit => semi_implicit_share(contact, rubbing, p, inertia, damping),
        _ => 1.0,
    };
    let raw = contact.wrench * scale;
    let (along, about) = contact.stiffness.traces();
    let slide = Slide {
        speed_m_per_s: slide_speed(contact, state.body.twist),
        voxel_size_m: contact.voxel_size_m,
        step_stiffness: scale * p.period_s * p.period_s * (along / inertia.mass_kg).max(about / inertia.least_kg_m2),
    };
    let wrench = state.filter.update(raw, slide, contact.contacts > 0, &p.filter, p.period_s);
    // Friction is smooth by itself: it goes past the filter.
    let stiffness =
        Mat6::ZERO.plus_scaled(scale * (1.0 - state.filter.alpha()), &contact.stiffness).plus_scaled(scale, &rubbing.stiffness);
    let damping_s = if along > 0.0 { 2.0 * p.contact.damping_ratio * (inertia.mass_kg / along).sqrt() } else { 0.0 };

    let pull = Pull { spring, target_twist, weight, damping, period_s: p.period_s };
    let linear = LinearContact { wrench: wrench + rubbing.wrench * scale, stiffness, damping_s };
    match coupling.mode {
        CouplingMode::SemiImplicit => state.body.step_semi_implicit(&pull, &linear, inertia),
        _ => state.body.step_implicit(&pull, &linear, inertia),
    }
}

/// No virtual tool: the shell stands where the arm is, the arm gets the filtered contact wrench, its stiffness limited to what
/// the arm can take.
fn direct(
    state: &mut State,
    contact: &ContactSum,
    rubbing: &FrictionWrench,
    coupling: &CouplingParameters,
    p: &Parameters,
) -> Wrench {
    let share = within(
        contact.stiffness.plus_scaled(1.0, &rubbing.stiffness).traces(),
        (coupling.bound_n_per_m, coupling.bound_nm_per_rad),
    );
    let slide =
        Slide { speed_m_per_s: slide_speed(contact, state.body.twist), voxel_size_m: contact.voxel_size_m, step_stiffness: 0.0 };
    state.filter.update(contact.wrench * share, slide, contact.contacts > 0, &p.filter, p.period_s) + rubbing.wrench * share
}

/// The share of the contact stiffness that the semi-implicit step can take beside the coupling spring (algorithms, 7.2).
fn semi_implicit_share(
    contact: &ContactSum,
    rubbing: &FrictionWrench,
    p: &Parameters,
    inertia: &Inertia,
    damping: (f64, f64),
) -> f64 {
    use super::stability::semi_implicit_max_stiffness;
    // Half of the bound: it holds for one axis, and contact couples translation and rotation.
    let room =
        |mass: f64, damping: f64, spring: f64| (0.5 * semi_implicit_max_stiffness(mass, damping, p.period_s) - spring).max(0.0);
    within(
        contact.stiffness.plus_scaled(1.0, &rubbing.stiffness).traces(),
        (
            room(inertia.mass_kg, damping.0, p.coupling.stiffness_n_per_m),
            room(inertia.least_kg_m2, damping.1, p.coupling.stiffness_nm_per_rad),
        ),
    )
}

/// The largest factor up to 1 that keeps both stiffnesses within their bounds.
fn within(stiffness: (f64, f64), bounds: (f64, f64)) -> f64 {
    let share = |stiffness: f64, bound: f64| if stiffness > bound { bound / stiffness } else { 1.0 };
    share(stiffness.0, bounds.0).min(share(stiffness.1, bounds.1))
}

/// Speed of the contact along the surface, m/s: what excites the voxel line that the filter removes.
fn slide_speed(contact: &ContactSum, tool: Twist) -> f64 {
    let Some(normal) = contact.wrench.force.try_normalize() else { return 0.0 };
    let velocity = tool.linear + tool.angular.cross(contact.arm_world);
    (velocity - normal * velocity.dot(normal)).length()
}
