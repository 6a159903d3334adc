//! The one step, in one place. This is the order; other pages refer to it:
//!
//! 1. sample check: faults and gates move the drive ([`drive`](crate::drive))
//! 2. encoder hold
//! 3. indexing
//! 4. contact sum
//! 5. friction and damping of faces
//! 6. shaping filter
//! 7. coupling
//! 8. passivity: a damper, and a share of the wrench while energy is owed
//! 9. ramp: rises over `ramp_s`, falls over
//!    [`ramp_down_s`](crate::LimitParameters::ramp_down_s). A disable and a fault never come so far:
//!    zero at once
//! 10. power
//! 11. slew: holds rises back. What the steps before it do not ask for any more goes from the limit
//!     to zero within [`FALL_S`](crate::LimitParameters::FALL_S) or faster, whatever the parameters are
//! 12. magnitude
//! 13. finite check
//!
//! No step after the ramp adds force.

mod advance;

use super::auto_limit::LoopDelay;
use super::braking::Braking;
use super::clay::{ClayForces, Held};
use super::damper;
use super::encoder_hold::EncoderHold;
use super::indexing::Indexing;
use super::interlock::{Interlock, is_outside};
use super::limits::{Limiter, Ramp};
use super::live_parameters::{ParameterChange, ParameterRamps};
use super::moving_obstacles::{MovingObstacles, Placement};
use super::params::CouplingMode;
use super::passivity_control::PassivityController;
use super::power_window::PowerWindow;
use super::sample::{SampleCheck, SampleMonitor};
use super::stability::filter_delay_s;
use super::virtual_tool::{Pull, Query, Touch, VirtualTool, squared_share};
use super::{Drive, DriveRequest, Faults, OffCause, Parameters, RenderScene};
use vps::contact::{Budget, ContactSum, SimdLevel, Traversal, TraversalMode};
use vps::density::DensityFrame;
use vps::spatial::{DeviceSample, Pose, Twist, Wrench};

/// Everything that enters one tick from outside.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TickInput {
    /// Newest device sample.
    pub sample: DeviceSample,
    /// Whether force shall flow.
    pub request: DriveRequest,
    /// The loop woke up after its deadline had passed.
    pub overrun: bool,
    /// No command was written for longer than
    /// [`LimitParameters::stall_s`](super::LimitParameters::stall_s), and the last one was not
    /// zero: the arm held it meanwhile.
    pub stalled: bool,
    /// Where an obstacle is asked to go from the next tick on.
    pub place: Option<Placement>,
    /// What a parameter is asked to become from the next tick on.
    pub parameter_change: Option<ParameterChange>,
    /// Which frame of the clay is touched, where there is clay: kept for the record, the frame
    /// itself is in the [`State`].
    pub clay: Option<FrameInUse>,
}

/// The frame of the clay that a tick touches.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FrameInUse {
    /// Number of the frame, counted from 1.
    pub sequence: u64,
    /// The simulation makes no more frames: it is the last one, and its rope is let go.
    pub is_last: bool,
}

/// Everything that leaves one tick.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TickOutput {
    /// Wrench to write to the arm (`rendered`): device axes, reduced at the grip point, limited,
    /// only actuated axes.
    pub command_device: Wrench,
    /// The same before axes that the arm cannot actuate were dropped (`commanded`).
    pub commanded_device: Wrench,
    /// Raw contact wrench on the tool where its step ended, friction, and the pull of a rope,
    /// included, world axes, about the centre of mass, before filter and coupling; in `constraint`
    /// what holds the tool back from where the coupling pulls it. The part of clay goes on smoothly
    /// from update to update.
    pub contact_world: Wrench,
    /// Pose of the tool (mesh file frame) in the world.
    pub world_from_tool: Pose,
    /// Points with V > 0.
    pub contacts: u32,
    /// Deepest penetration, m; 0 without contact.
    pub max_depth_m: f64,
    /// It may be deeper: the field of an obstacle ends there.
    pub depth_is_bound: bool,
    /// How far the tool is proven to be from contact, clipped at the band, m; negative: how deep it
    /// is. The query looks no closer than it must, so the tool may be much farther away than this.
    pub clearance_m: f64,
    /// Points that the contact query's budget left out, which others stood for.
    pub points_left_out: u32,
    /// Energy that the arm has taken from the hand since enable, J; negative means that it gave
    /// more than it took.
    pub energy_j: f64,
    /// Energy that moving obstacles have put into the hand through the command since enable, J:
    /// `energy_j` may be lower by so much.
    pub object_work_j: f64,
    /// Number of obstacles that are under way to another place.
    pub objects_moving: u32,
    /// Where one of them stands now, turn by turn.
    pub object: Option<Placement>,
    /// The passivity controller damps in this tick.
    pub passivity_active: bool,
    /// Longest round trip measured since enable, ticks; 0 where the arm does not measure it.
    pub delay_ticks: u32,
    /// State of the drive after this tick.
    pub drive: Drive,
    /// Faults that are active.
    pub faults: Faults,
    /// Why no force flows, or why it is on its way out; `None` while it flows or ramps up.
    pub off_cause: OffCause,
}

/// What the tick remembers from one call to the next. Everything it needs is allocated when it is
/// made.
#[derive(Clone, Debug)]
pub struct State {
    drive: Drive,
    faults: Faults,
    monitor: SampleMonitor,
    interlock: Interlock,
    overruns: u32,
    encoder_hold: EncoderHold,
    indexing: Indexing,
    /// Where the tool's body axes stood at enable.
    start: Pose,
    resume: Option<Resume>,
    /// Nothing was in the tool's way where it stood in the last tick.
    has_room: bool,
    tool: VirtualTool,
    /// Finds what touches, and knows where the obstacles stand.
    traversal: Traversal,
    moving_obstacles: MovingObstacles,
    parameter_ramps: ParameterRamps,
    /// Where the scene has some.
    clay: Option<Held>,
    /// Where the scene asks for it.
    braking: Option<Braking>,
    delay: LoopDelay,
    passivity: PassivityController,
    power: PowerWindow,
    enable_gain: Ramp,
    limiter: Limiter,
}

/// Where the tool is to stand at the next enable.
#[derive(Clone, Copy, Debug)]
struct Resume {
    body: Pose,
    /// Known after a tick there: nothing is in the way.
    has_room: Option<bool>,
}

/// What a scene has to know of the one whose place it takes.
#[derive(Clone, Copy, Debug)]
pub struct Handover {
    must_release: bool,
}

/// How deep the tool may stand in an obstacle at enable when it stays where it was, voxels: what
/// pressing leaves.
const RESUME_VOXELS: f64 = 0.5;

impl State {
    /// The state before the first tick of `scene`: disabled, the tool at its start pose.
    pub fn new(scene: &RenderScene) -> Self {
        Self {
            drive: Drive::Disabled,
            faults: Faults::NONE,
            monitor: SampleMonitor::default(),
            interlock: Interlock::default(),
            overruns: 0,
            encoder_hold: EncoderHold::default(),
            indexing: Indexing::default(),
            start: scene.start(),
            resume: None,
            has_room: false,
            tool: VirtualTool::at(scene.start()),
            traversal: traversal(scene),
            moving_obstacles: MovingObstacles::new(scene.obstacles.len()),
            parameter_ramps: ParameterRamps::default(),
            clay: scene.clay.as_ref().map(|clay| Held::new(clay, &scene.tool.shell)),
            braking: Braking::of(scene),
            delay: LoopDelay::default(),
            passivity: PassivityController::default(),
            power: PowerWindow::default(),
            enable_gain: Ramp::default(),
            limiter: Limiter::default(),
        }
    }

    /// Limits what the contact query of a tick may look at. It is part of what enters the ticks: a
    /// recording that is to be replayed has to know it.
    pub fn set_budget(&mut self, budget: Budget) {
        self.traversal.set_budget(budget);
    }

    /// What the contact query of a tick may look at.
    pub fn budget(&self) -> Budget {
        self.traversal.budget()
    }

    /// What a scene does that takes the place of another: a deadman that was to be let go first
    /// still is, and the tool stands at a pose at the next enable, instead of its start, unless it
    /// would stand inside an obstacle there; `None`: at its start. The arm's pose at that enable is
    /// the new zero, as always. RT: safe; before the first tick.
    pub fn resume_at(
        &mut self,
        scene: &RenderScene,
        world_from_tool: Option<Pose>,
        before: Handover,
    ) {
        self.interlock.must_release = before.must_release;
        let Some(world_from_tool) = world_from_tool else { return };
        let body = world_from_tool * Pose::from_translation(scene.tool.center_of_mass_tool);
        self.resume = Some(Resume { body, has_room: None });
        self.tool = VirtualTool::at(body);
    }

    /// Where grip and tool stood at the last enable, `device_from_grip` and `world_from_tool`: from
    /// there the motions of both count. RT: safe.
    pub fn indexed(&self, scene: &RenderScene) -> (Pose, Pose) {
        (self.indexing.zero(), self.start * Pose::from_translation(-scene.tool.center_of_mass_tool))
    }

    /// For the state of a scene that takes the place of this one. RT: safe.
    pub fn handover(&self) -> Handover {
        Handover { must_release: self.interlock.must_release }
    }

    /// Takes a newer frame of the clay, and gives back one that is not needed any more; without
    /// clay in the scene the very same. The next tick touches both, so that the force goes on
    /// without a step. RT: safe; pointers.
    #[expect(
        clippy::disallowed_types,
        reason = "made and freed on the cold side, exchanged as a pointer"
    )]
    pub fn exchange(&mut self, frame: Box<DensityFrame>) -> Box<DensityFrame> {
        match &mut self.clay {
            Some(held) => held.exchange(frame),
            None => frame,
        }
    }

    /// Number of the frame of the clay that the next tick touches; `None` without clay.
    pub fn frame_sequence(&self) -> Option<u64> {
        self.clay.as_ref().map(Held::sequence)
    }

    /// What the clay did to the tool in the last tick; nothing where there is none.
    pub fn clay_forces(&self) -> ClayForces {
        self.clay.as_ref().map_or(ClayForces::default(), Held::forces)
    }

    /// What the tool does in the clay is felt: force flows, and no ramp waits before it.
    pub fn feels_clay(&self) -> bool {
        self.drive.has_force() && self.interlock.is_engaged
    }

    /// Where an obstacle stands now.
    pub fn world_from_map(&self, obstacle_idx: usize) -> Option<Pose> {
        self.traversal.obstacle_poses().pose(obstacle_idx).map(|pose| pose.world_from_map)
    }

    /// One contact query at a pose where the tool overlaps an obstacle, another one each `turn`, as
    /// if nothing were known from earlier ones; returns what it looked at. To learn what queries
    /// cost before the first tick; use a copy of the state.
    pub fn rehearse(&mut self, scene: &RenderScene, turn: usize) -> u32 {
        let pose = self.move_into_contact(scene, turn);
        let law = scene.parameters.force_law();
        let shell = &scene.tool.shell;
        ContactSum::of(&mut self.traversal, &scene.obstacles, shell, pose, law, None).looked_at
    }

    /// Puts the virtual tool where it overlaps an obstacle, if there is one, at another place each
    /// `turn`, and gives its pose. To run a tick in contact before the first one; use a copy of the
    /// state.
    pub fn move_into_contact(&mut self, scene: &RenderScene, turn: usize) -> Pose {
        let pose = self
            .traversal
            .overlapping_pose(&scene.obstacles, &scene.tool.shell, turn)
            .unwrap_or(self.tool.pose());
        self.traversal.forget();
        self.tool = VirtualTool::at(pose);
        pose
    }

    /// Forgets all motion and force; the drive state is the caller's.
    fn at_rest(&mut self, body: Pose) {
        self.tool = VirtualTool::at(body);
        self.enable_gain.reset();
        self.limiter.reset();
        if let Some(clay) = &mut self.clay {
            clay.at_rest();
        }
    }

    fn fail(&mut self, faults: Faults) {
        self.faults |= faults;
        if !self.faults.is_empty() {
            self.drive = Drive::Fault;
            self.interlock.fail(self.faults);
            self.at_rest(self.tool.pose());
        }
    }
}

/// One step of the loop.
///
/// RT: safe. Pure and total: same scene, state and input, same bits; no allocation, no panic.
/// Anything that is not finite gives a zero wrench and a fault. Cost: one walk over the shell's
/// tree per obstacle plus a 6×6 solve.
pub fn tick(scene: &RenderScene, state: &mut State, input: &TickInput) -> TickOutput {
    let p = &state.parameter_ramps.next(
        &scene.parameters,
        input.parameter_change,
        state.drive.has_force(),
    );
    let check = state.monitor.check(&input.sample, &p.limits, &p.safety, p.period_s);
    state.overruns = if input.overrun { state.overruns.saturating_add(1) } else { 0 };
    let mut faults = check.faults;
    let has_many_overruns =
        p.limits.overrun_fault_ticks > 0 && state.overruns >= p.limits.overrun_fault_ticks;
    if has_many_overruns || input.stalled {
        faults |= Faults::OVERRUN;
    }
    advance::advance(scene, p, state, input, faults);
    state.moving_obstacles.advance(
        state.traversal.obstacle_poses_mut(),
        input.place,
        state.drive.has_force(),
        p,
    );

    let target = {
        if !state.drive.renders() {
            state.encoder_hold.reset();
        }
        let (pose, twist) = state.encoder_hold.steady(&input.sample, &p.arm, p.period_s);
        state.indexing.target(
            &DeviceSample { pose, twist, ..input.sample },
            &p.mapping,
            state.start,
        )
    };
    if state.drive.renders() && p.coupling.mode == CouplingMode::Direct {
        state.tool.stand_at(target, scene);
    } else if state.drive.renders() {
        state.tool.keep_tracking(target, scene, p);
    }
    let moving = state.moving_obstacles.n_under_way() > 0;
    if let (Some(clay), Some(FrameInUse { is_last: true, .. })) = (&mut state.clay, input.clay) {
        clay.let_go();
    }
    let mut query = Query { traversal: &mut state.traversal, scene, p };
    let clay = state.clay.as_mut();
    let mut touch = state.tool.touch(&mut query, clay, state.braking.as_mut(), moving);
    let contact = &touch.contact;
    // A tool that only tries where it could stand touches nothing yet.
    let tries = state.resume.is_some();
    state.has_room = contact.max_value_m <= RESUME_VOXELS * contact.voxel_size_m;
    if let Some(resume) = &mut state.resume {
        resume.has_room = Some(state.has_room);
    }
    if !contact.wrench.is_finite() || contact.max_value_m.is_nan() {
        state.fail(Faults::NON_FINITE);
    }
    let ramp_down = match check.ramp_down {
        OffCause::None if is_outside(&input.sample, &p.safety) => OffCause::Workspace,
        ramp_down => ramp_down,
    };
    let result = match state.drive {
        Drive::Braking => brake(p, state, input, check),
        drive if drive.renders() => render((scene, p), state, &mut touch, target, input, ramp_down),
        _ => Ok(Felt::default()),
    };
    let felt = result.unwrap_or_else(|faults| {
        state.fail(faults);
        Felt::default()
    });
    state.passivity.hold(felt.command_device);
    let contact = &touch.ended;
    let touching = TickOutput {
        contact_world: contact.wrench,
        contacts: contact.contacts,
        max_depth_m: contact.max_value_m.max(0.0),
        depth_is_bound: contact.depth_is_bound,
        clearance_m: -contact.max_value_m,
        points_left_out: contact.left_out,
        ..TickOutput::default()
    };
    let body_from_tool = Pose::from_translation(-scene.tool.center_of_mass_tool);
    TickOutput {
        command_device: felt.command_device,
        commanded_device: felt.commanded_device,
        world_from_tool: state.tool.pose() * body_from_tool,
        energy_j: state.passivity.energy_j,
        object_work_j: state.passivity.carried_j,
        objects_moving: state.moving_obstacles.n_under_way(),
        object: state.moving_obstacles.reported,
        passivity_active: state.drive.renders() && state.passivity.is_active,
        delay_ticks: state.delay.worst_ticks,
        drive: state.drive,
        faults: state.faults,
        off_cause: match state.drive {
            Drive::Enabling | Drive::Enabled => ramp_down,
            Drive::Disabled | Drive::Stopping | Drive::Braking | Drive::Fault => {
                state.interlock.cause
            }
        },
        ..if tries { TickOutput::default() } else { touching }
    }
}

/// What a tick with force gives.
#[derive(Clone, Copy, Default)]
struct Felt {
    command_device: Wrench,
    commanded_device: Wrench,
}

/// From contact to command: friction, coupling, passivity, limits. An error is a fault that leaves
/// no force.
fn render(
    (scene, p): (&RenderScene, &Parameters),
    state: &mut State,
    touch: &mut Touch,
    target: (Pose, Twist),
    input: &TickInput,
    ramp_down: OffCause,
) -> Result<Felt, Faults> {
    let sample = &input.sample;
    state.delay.measure(sample.delay_ticks, p.period_s);
    let delay_ticks = observe(p, state, sample)?;
    let (moved, turned) = p
        .mapping
        .way_device(touch.contact.obstacle_motion.linear, touch.contact.obstacle_motion.angular);
    state.passivity.carry(moved, turned, delay_ticks, spring_at_limit_j(p));
    let filter_lag_s = match p.coupling.mode {
        CouplingMode::Direct => filter_delay_s(p.filter.cutoff_hz[0], p.period_s),
        _ => 0.0,
    };
    let coupling = state.delay.limited(&p.coupling, &p.arm, filter_lag_s, p.period_s);
    let arm = &state.delay.damped(&p.arm);

    let rubbing = state.tool.rub(touch, p);
    let is_paid = state.passivity.is_paid(arm);
    let mut query = Query { traversal: &mut state.traversal, scene, p };
    let Pull { wrench: felt_world, stored_j } = state
        .tool
        .follow(&mut query, touch, &rubbing, (&coupling, is_paid), target)
        .ok_or(Faults::SOLVER)?;
    if !state.tool.is_finite() {
        return Err(Faults::NON_FINITE);
    }

    let wanted = p.mapping.wrench_device(felt_world);
    // Only what the motors give has power and is limited; the rest is reported and dropped.
    let actuated = p.mapping.actuated_part(wanted);
    // The tool is pushed out of the clay by itself while nothing is felt; what counts is where the
    // hand is.
    let is_in_clay = state.interlock.must_clear && {
        let clay = state.clay.as_mut().zip(scene.clay.as_ref());
        clay.is_some_and(|(held, clay)| held.is_inside(clay, &scene.tool.shell, target.0, p))
    };
    let engages = state.interlock.engages(actuated, is_in_clay, &p.limits, &p.safety);
    let up = state.drive != Drive::Stopping && ramp_down == OffCause::None && engages;
    let ramp_s = if up { p.limits.ramp_s } else { p.limits.ramp_down_s() };
    let gain = state.enable_gain.advance(up, ramp_s, p.period_s);
    let share = state.passivity.trusted_share(arm);
    let trusted = actuated * share;
    // Of the spring's energy what the motors will give back; the arm's ways are shorter than the
    // tool's by the scale, its turns are the same.
    let [along, about] = stored_j;
    let held = along * squared_share(actuated.force, wanted.force) / p.mapping.scale
        + about * squared_share(actuated.torque, wanted.torque);
    let held_j = held * share * gain;
    let damped =
        state.passivity.damped((trusted, held_j), sample.twist, arm, &p.limits, p.period_s);
    let mut ramped = p.mapping.actuated_part(damped) * gain;
    if state.drive == Drive::Enabling && up && actuated != Wrench::ZERO {
        // While the force rises the hand is steadied. Free space stays free.
        ramped = ramped + p.mapping.actuated_part(damper::strongest(sample.twist, arm, 1.0 - gain));
    }
    let limited = state.limiter.apply(ramped, sample.twist, &p.limits, p.period_s);
    if !limited.finite {
        return Err(Faults::NON_FINITE);
    }
    state.drive = match state.drive {
        Drive::Enabling if gain >= 1.0 => Drive::Enabled,
        Drive::Stopping if gain <= 0.0 && limited.wrench == Wrench::ZERO => {
            if !state.interlock.pending.is_empty() {
                return Err(state.interlock.pending);
            }
            Drive::Disabled
        }
        drive => drive,
    };
    Ok(Felt {
        command_device: limited.wrench,
        commanded_device: limited.wrench + (wanted - actuated) * gain,
    })
}

/// What the coupling spring holds at the force limit, J, as the arm gets it back: it feels scale ·
/// K.
fn spring_at_limit_j(p: &Parameters) -> f64 {
    0.5 * p.limits.force_n * p.limits.force_n / (p.coupling.stiffness_n_per_m * p.mapping.scale)
}

/// A damper on the arm, without a scene, until [`advance`] ends it with a fault.
fn brake(
    p: &Parameters,
    state: &mut State,
    input: &TickInput,
    check: SampleCheck,
) -> Result<Felt, Faults> {
    observe(p, state, &input.sample)?;
    // Old velocities would drive the arm.
    let wanted = if check.ramp_down == OffCause::None {
        p.mapping.actuated_part(damper::brake(input.sample.twist, &state.delay.damped(&p.arm)))
    } else {
        Wrench::ZERO
    };
    let limited = state.limiter.apply(wanted, input.sample.twist, &p.limits, p.period_s);
    if !limited.finite {
        return Err(Faults::NON_FINITE);
    }
    Ok(Felt { command_device: limited.wrench, commanded_device: limited.wrench })
}

/// Counts the energy of the tick that ends with this sample. Returns the delay of the command that
/// acted.
fn observe(p: &Parameters, state: &mut State, sample: &DeviceSample) -> Result<u32, Faults> {
    let delay_ticks = sample.delay_ticks.max(p.arm.delay_ticks);
    let given_j = state.passivity.observe(sample.pose, delay_ticks, p.period_s);
    if state.power.exceeds(given_j, p.limits.power_w, p.safety.power_window_s, p.period_s) {
        return Err(Faults::POWER);
    }
    Ok(delay_ticks)
}

/// Finds what the tool of a scene touches. `constraint` has edges as interpolation has them:
/// between planes, whose directions change at once, a square peg that jammed at the mouth of its
/// hole trembled.
pub(super) fn traversal(scene: &RenderScene) -> Traversal {
    let RenderScene { parameters, obstacles, tool, .. } = scene;
    let traversal = Traversal::new(SimdLevel::best(), TraversalMode::Tree, obstacles, &tool.shell);
    match parameters.coupling.mode {
        CouplingMode::Constraint => traversal.without_planes(),
        CouplingMode::Implicit | CouplingMode::Direct => traversal,
    }
}

#[cfg(test)]
#[expect(clippy::expect_used, reason = "test code")]
mod tests;

#[cfg(test)]
#[expect(
    clippy::disallowed_types,
    clippy::disallowed_macros,
    clippy::indexing_slicing,
    clippy::panic,
    reason = "test code"
)]
mod exploration;

#[cfg(test)]
#[expect(clippy::disallowed_macros, clippy::expect_used, reason = "test code")]
mod key_tests;
