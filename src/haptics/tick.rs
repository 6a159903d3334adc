//! The one step, in one place: sample check → contact sum → friction → shaping filter → coupling → passivity → power → slew →
//! magnitude → finite check.

use super::auto_limit::LoopDelay;
use super::braking::Braking;
use super::contact::{Budget, ContactSum, Machine, Traversal, Way};
use super::limits::{Limiter, Ramp};
use super::params::CouplingMode;
use super::passivity_control::PassivityController;
use super::placing::{Movers, Placement};
use super::port::Port;
use super::sample::SampleMonitor;
use super::stability::filter_delay_s;
use super::virtual_tool::{Touch, VirtualTool};
use super::{Drive, DriveRequest, Faults, RenderScene};
use crate::spatial::{DeviceSample, Pose, SampleStatus, Twist, Wrench};

/// Everything that enters one tick from outside.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TickInput {
    /// Newest device sample.
    pub sample: DeviceSample,
    /// What the supervisor wants.
    pub request: DriveRequest,
    /// The loop woke up after its deadline had passed.
    pub overrun: bool,
    /// Where an obstacle is asked to go from the next tick on.
    pub place: Option<Placement>,
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
    /// Energy that moving obstacles have put into the hand through the command since enable, J: `energy_j` may be lower by so much.
    pub object_work_j: f64,
    /// Obstacles under way.
    pub objects_moving: u32,
    /// The passivity controller damps in this tick.
    pub passivity_active: bool,
    /// Longest round trip measured since enable, ticks; 0 where the arm does not measure it.
    pub delay_ticks: u32,
    /// State of the drive after this tick.
    pub drive: Drive,
    /// Faults that are latched.
    pub faults: Faults,
}

/// What the tick remembers from one call to the next. Everything it needs is allocated when it is made.
#[derive(Clone, Debug)]
pub struct State {
    drive: Drive,
    faults: Faults,
    monitor: SampleMonitor,
    overruns: u32,
    port: Port,
    /// Where the tool's body axes stood at enable.
    start: Pose,
    resume: Option<Resume>,
    tool: VirtualTool,
    /// Finds what touches, and knows where the obstacles stand.
    traversal: Traversal,
    movers: Movers,
    /// Where the scene asks for it.
    braking: Option<Braking>,
    delay: LoopDelay,
    passivity: PassivityController,
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

/// How deep the tool may stand in an obstacle at enable when it stays where it was, voxels: what pressing leaves.
const RESUME_VOXELS: f64 = 0.5;

impl State {
    /// The state before the first tick of `scene`: disabled, the tool at its start pose.
    pub fn new(scene: &RenderScene) -> Self {
        Self {
            drive: Drive::Disabled,
            faults: Faults::NONE,
            monitor: SampleMonitor::default(),
            overruns: 0,
            port: Port::default(),
            start: scene.start(),
            resume: None,
            tool: VirtualTool::at(scene.start()),
            traversal: Traversal::new(Machine::best(), Way::Tree, &scene.obstacles, &scene.tool.shell),
            movers: Movers::new(scene.obstacles.len()),
            braking: Braking::of(scene),
            delay: LoopDelay::default(),
            passivity: PassivityController::default(),
            enable_gain: Ramp::default(),
            limiter: Limiter::default(),
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

    /// Lets the tool stand at a pose at the next enable, instead of its start, unless it would stand inside an obstacle there: what a
    /// scene does that takes the place of another. The arm's pose at that enable is the new zero, as always. RT: safe; before the first tick.
    pub fn resume_at(&mut self, scene: &RenderScene, world_from_tool: Pose) {
        let body = world_from_tool * Pose::from_translation(scene.tool.center_of_mass_tool);
        self.resume = Some(Resume { body, has_room: None });
        self.tool = VirtualTool::at(body);
    }

    /// Where an obstacle stands now.
    pub fn world_from_map(&self, obstacle_idx: usize) -> Option<Pose> {
        self.traversal.places().stand(obstacle_idx).map(|stand| stand.world_from_map)
    }

    /// One contact query at a pose where the tool overlaps an obstacle, another one each `turn`, as if nothing were known from earlier ones;
    /// returns what it looked at. To learn what queries cost before the first tick; use a copy of the state.
    pub fn rehearse(&mut self, scene: &RenderScene, turn: usize) -> u32 {
        let (p, shell) = (&scene.parameters, &scene.tool.shell);
        let pose = self.traversal.overlapping_pose(&scene.obstacles, shell, turn).unwrap_or(self.tool.pose());
        self.traversal.forget();
        ContactSum::of(&mut self.traversal, &scene.obstacles, shell, pose, &p.contact, &p.filter, None).looked_at
    }

    /// Forgets all motion and force; the drive state is the caller's.
    fn at_rest(&mut self, body: Pose) {
        self.tool = VirtualTool::at(body);
        self.enable_gain.reset();
        self.limiter.reset();
    }

    fn fail(&mut self, faults: Faults) {
        self.faults |= faults;
        if !self.faults.is_empty() {
            self.drive = Drive::Fault;
            self.at_rest(self.tool.pose());
        }
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
    state.movers.advance(state.traversal.places_mut(), input.place, state.drive.has_force(), p);

    let target = state.port.target(&input.sample, &p.port, state.start);
    if state.drive.has_force() && p.coupling.mode == CouplingMode::Direct {
        state.tool.stand_at(target, scene);
    }
    let moving = state.movers.n_under_way() > 0;
    let touch = state.tool.touch(&mut state.traversal, state.braking.as_mut(), scene, moving);
    let contact = &touch.contact;
    // A tool that only tries where it could stand touches nothing yet.
    let tries = state.resume.is_some();
    if let Some(resume) = &mut state.resume {
        resume.has_room = Some(contact.max_value_m <= RESUME_VOXELS * contact.voxel_size_m);
    }
    if !contact.wrench.is_finite() || contact.max_value_m.is_nan() {
        state.fail(Faults::NON_FINITE);
    }
    let mut felt = Felt::default();
    if state.drive.has_force() {
        match render(scene, state, &touch, target, input, check.ramp_down) {
            Ok(rendered) => felt = rendered,
            Err(faults) => state.fail(faults),
        }
    }
    state.passivity.hold(felt.command_device);
    let touching = TickOutput {
        contact_world: contact.wrench + felt.friction_world,
        contacts: contact.contacts,
        max_depth_m: contact.max_value_m.max(0.0),
        clearance_m: -contact.max_value_m,
        points_left_out: contact.left_out,
        ..TickOutput::default()
    };
    let body_from_tool = Pose::from_translation(-scene.tool.center_of_mass_tool);
    TickOutput {
        command_device: felt.command_device,
        commanded_device: felt.commanded_device,
        world_from_tool: state.tool.pose() * body_from_tool,
        energy_j: state.passivity.energy_j(),
        object_work_j: state.passivity.carried_j(),
        objects_moving: state.movers.n_under_way(),
        passivity_active: state.passivity.is_active(),
        delay_ticks: state.delay.worst_ticks(),
        drive: state.drive,
        faults: state.faults,
        ..if tries { TickOutput::default() } else { touching }
    }
}

/// What a tick with force gives.
#[derive(Clone, Copy, Default)]
struct Felt {
    command_device: Wrench,
    commanded_device: Wrench,
    friction_world: Wrench,
}

/// From contact to command: friction, coupling, passivity, limits. An error is a fault that leaves no force.
fn render(
    scene: &RenderScene,
    state: &mut State,
    touch: &Touch,
    target: (Pose, Twist),
    input: &TickInput,
    ramp_down: bool,
) -> Result<Felt, Faults> {
    let (p, sample) = (&scene.parameters, &input.sample);
    state.delay.measure(sample.delay_ticks, p.period_s);
    let delay_ticks = sample.delay_ticks.max(p.arm.delay_ticks);
    state.passivity.observe(sample.pose, delay_ticks, p.period_s);
    let (moved, turned) = p.port.way_device(touch.contact.carried.linear, touch.contact.carried.angular);
    let spring_j = 0.5 * p.limits.force_n * p.limits.force_n / p.coupling.stiffness_n_per_m;
    state.passivity.carry(moved, turned, delay_ticks, spring_j);
    let filter_lag_s = match p.coupling.mode {
        CouplingMode::Direct => filter_delay_s(p.filter.cutoff_hz[0], p.period_s),
        _ => 0.0,
    };
    let coupling = state.delay.limited(&p.coupling, &p.arm, filter_lag_s, p.period_s);

    let rubbing = state.tool.rub(touch, scene);
    let felt_world =
        state.tool.follow(scene, state.traversal.places(), touch, &rubbing, &coupling, target).ok_or(Faults::SOLVER)?;
    if !state.tool.is_finite() {
        return Err(Faults::NON_FINITE);
    }

    let up = state.drive != Drive::Stopping && !ramp_down;
    let gain = state.enable_gain.advance(up, p.limits.ramp_s, p.period_s);
    let wanted = p.port.wrench_device(felt_world);
    // Only what the motors give has power and is limited; the rest is reported and dropped.
    let actuated = p.port.actuated_part(wanted);
    let trusted = actuated * state.passivity.trusted_share(&p.arm);
    let damped = state.passivity.damped(trusted, sample.twist, &p.arm, &p.limits, p.period_s);
    let limited = state.limiter.apply(p.port.actuated_part(damped), sample.twist, gain, &p.limits, p.period_s);
    if !limited.finite {
        return Err(Faults::NON_FINITE);
    }
    state.drive = match state.drive {
        Drive::Enabling if gain >= 1.0 => Drive::Enabled,
        Drive::Stopping if gain <= 0.0 && limited.wrench == Wrench::ZERO => Drive::Disabled,
        drive => drive,
    };
    Ok(Felt {
        command_device: limited.wrench,
        commanded_device: limited.wrench + (wanted - actuated) * gain,
        friction_world: rubbing.wrench,
    })
}

/// Follows the supervisor's request; `faults` are those of this tick's sample.
fn advance_drive(scene: &RenderScene, state: &mut State, input: &TickInput, faults: Faults) {
    if state.drive.has_force() && !faults.is_empty() {
        state.fail(faults);
        return;
    }
    match (state.drive, input.request) {
        (_, DriveRequest::Disable) => {
            state.at_rest(state.tool.pose());
            state.drive = Drive::Disabled;
            state.faults = Faults::NONE;
        }
        (Drive::Disabled, DriveRequest::Enable) if !faults.is_empty() => state.fail(faults),
        // One tick shows whether there is room.
        (Drive::Disabled, DriveRequest::Enable) if state.resume.is_some_and(|resume| resume.has_room.is_none()) => {}
        // A sample that is old, or never came, cannot be the zero of the indexing.
        (Drive::Disabled, DriveRequest::Enable) if input.sample.status == SampleStatus::Fresh => {
            let resume = state.resume.take().filter(|resume| resume.has_room == Some(true));
            state.start = resume.map_or(scene.start(), |resume| resume.body);
            state.at_rest(state.start);
            state.port = Port::indexed(&input.sample);
            state.passivity.reset();
            state.delay = LoopDelay::starting_at(input.sample.delay_ticks);
            state.drive = Drive::Enabling;
        }
        (Drive::Enabling | Drive::Enabled, DriveRequest::Stop) => state.drive = Drive::Stopping,
        _ => {}
    }
}
