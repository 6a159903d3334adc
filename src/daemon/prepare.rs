//! From a checked scene to a baked one with its arm.

use std::path::PathBuf;
use std::sync::Arc;

use crossbeam::channel::Receiver;
use glam::DVec3;
use thiserror::Error;

use super::hand_checks::{self, HandProblem};
use super::remote::RemoteArm;
use crate::config::scene::DeviceConfig;
use crate::config::{ConfigErrors, SceneConfig};
use crate::scene::cache::Cache;
use crate::scene::{self, BakeEvent, BakeOptions, Built, LoadedClay, ObjectReport, SceneError};
use arms::Device;
use arms::attached::open::{self, LinkNews, OpenError, OpenOptions};
use arms::remote::LinkFigures;
use arms::simulated::fault::{self, FaultError, FaultPlan};
use arms::simulated::hand::{GripPath, HandMapping, HandPath};
use arms::simulated::{HandParameters, Reach, SimArm, SimError, SimParameters};
use document::poses::{self, PoseFileError};
use haptics::{DeviceMapping, RenderScene};
use rt::schedule::{self, RealtimeConfig, ThreadRequest};

/// A scene that is ready to be rendered.
pub struct Prepared {
    /// Baked, immutable.
    pub scene: RenderScene,
    /// Its clay as a clay model that can be worked, where it has some.
    pub model: Option<LoadedClay>,
    /// The opened arm.
    pub device: Box<dyn Device>,
    /// The node of a real arm.
    pub attached: Option<RealArmNode>,
    /// Scheduling.
    pub realtime: RealtimeConfig,
    /// Ticks per second.
    pub rate_hz: u32,
    /// What a contact query may take, s.
    pub time_budget_s: Option<f64>,
}

/// The node of a real arm.
#[derive(Debug)]
pub struct RealArmNode {
    /// Its node.
    pub node: PathBuf,
    /// What becomes of its link.
    pub news: Receiver<LinkNews>,
    /// How far away it is; `None`: it is attached to this machine.
    pub link: Option<Arc<LinkFigures>>,
}

/// Why a scene cannot be rendered.
#[derive(Debug, Error)]
pub enum PrepareError {
    /// The scene file.
    #[error("{0}")]
    Config(ConfigErrors),
    /// A mesh or a grid.
    #[error("{0}")]
    Scene(#[from] SceneError),
    /// The hand file.
    #[error("{0}")]
    Hand(#[from] PoseFileError),
    /// The path of the hand.
    #[error("{0}")]
    HandPath(Box<HandProblem>),
    /// The fault to inject.
    #[error("device.sim.fault = \"{written}\": {source}")]
    Fault {
        /// As written in the scene.
        written: String,
        /// Cause.
        source: FaultError,
    },
    /// The simulated arm.
    #[error("{0}")]
    Arm(#[from] SimError),
    /// The real arm.
    #[error("{0}")]
    Open(#[from] OpenError),
}

impl PrepareError {
    /// Why the scene cannot be built: the unit of a mesh, where it makes a part so large that
    /// little else can be wrong.
    pub fn of_scene(config: &SceneConfig, error: SceneError) -> Self {
        match scene::doubted_unit(config, &error) {
            Some(problem) => Self::Config(ConfigErrors::new(vec![problem])),
            None => Self::Scene(error),
        }
    }
}

/// What the simulated arm plays.
pub struct Inputs {
    /// Path of its hand.
    pub hand: Option<HandPath>,
    /// Its fault.
    pub fault: Option<FaultPlan>,
    /// What is likely wrong with the path.
    pub warnings: Vec<HandProblem>,
}

/// Reads and checks what the simulated arm plays, for `run` and `check` alike. Takes no time and
/// bakes nothing.
///
/// # Errors
/// A hand file or a fault that cannot be used.
pub fn inputs(config: &SceneConfig) -> Result<Inputs, PrepareError> {
    let mut hand = None;
    let mut warnings = Vec::new();
    if let Some(file) = config.device.hand.as_deref() {
        let poses = poses::read(file)?;
        let path = HandPath::from_poses(&poses, file)?;
        // A real arm is in a real hand.
        if config.device.profile.real.is_none() {
            warnings = hand_checks::check(&poses, file, config)
                .map_err(|problem| PrepareError::HandPath(Box::new(problem)))?;
        }
        hand = Some(if config.device.sim.hand_repeats { path.there_and_back() } else { path });
    }
    let fault = config.device.sim.fault.as_ref().map(|written| {
        fault::parse(written)
            .map_err(|source| PrepareError::Fault { written: written.clone(), source })
    });
    Ok(Inputs { hand, fault: fault.transpose()?, warnings })
}

/// Bakes the scene, without a cache and whatever memory it takes, and opens its arm.
///
/// # Errors
/// As [`prepare_with`].
pub fn prepare(
    config: &SceneConfig,
    watch: impl FnMut(BakeEvent<'_>),
) -> Result<(Prepared, Vec<ObjectReport>), PrepareError> {
    prepare_with(config, &mut BakeOptions::from(&mut Cache::off()), watch)
}

/// Bakes the scene or takes it from the cache, and opens its arm. What costs nothing is checked
/// before what takes long.
///
/// # Errors
/// A hand file, fault, mesh, grid or arm that cannot be used, or a bake that would take too much
/// memory.
pub fn prepare_with(
    config: &SceneConfig,
    options: &mut BakeOptions<'_>,
    watch: impl FnMut(BakeEvent<'_>),
) -> Result<(Prepared, Vec<ObjectReport>), PrepareError> {
    prepare_on(config, options, None, None, watch)
}

/// The same with an arm on another machine, if there is one: the scene's profile is that of its
/// arm; and with a program that is started as the [guard](arms::guard) of a real arm on this
/// machine.
///
/// # Errors
/// As [`prepare_with`].
pub fn prepare_on(
    config: &SceneConfig,
    options: &mut BakeOptions<'_>,
    remote: Option<&RemoteArm>,
    guard: Option<PathBuf>,
    watch: impl FnMut(BakeEvent<'_>),
) -> Result<(Prepared, Vec<ObjectReport>), PrepareError> {
    let Inputs { hand: path, fault, warnings } = inputs(config)?;
    let profile = &config.device.profile;
    let to_open = (remote.is_some() || profile.real.is_some()).then(|| open_options(config, guard));
    if let (Some(options), None) = (&to_open, remote) {
        open::look_for(profile, options)?;
    }
    let Built { scene, objects: mut reports, model } = scene::build_all(config, options, watch)
        .map_err(|error| PrepareError::of_scene(config, error))?;
    if let Some(tool) = reports.last_mut() {
        tool.warnings.extend(warnings.iter().map(HandProblem::with_remedy));
    }
    let period_s = config.parameters.period_s;
    // Only now: an arm that has been greeted is not to wait for a bake.
    let (device, attached): (Box<dyn Device>, _) = match (&to_open, remote) {
        (Some(options), Some(remote)) => {
            let (opened, link) = remote.open(profile, period_s, options.io_request)?;
            (
                Box::new(opened.arm),
                Some(RealArmNode { node: opened.path, news: opened.news, link: Some(link) }),
            )
        }
        (Some(options), None) => {
            let opened = open::open(profile, options)?;
            (
                Box::new(opened.arm),
                Some(RealArmNode { node: opened.path, news: opened.news, link: None }),
            )
        }
        (None, _) => {
            let mut arm = simulated_arm(
                &config.device,
                grip_path(config, path, scene.tool.center_of_mass_tool),
                period_s,
            );
            arm.fault = fault;
            (Box::new(SimArm::new(arm)?), None)
        }
    };
    let SceneConfig { realtime, rate_hz, time_budget_s, .. } = *config;
    Ok((Prepared { scene, model, device, attached, realtime, rate_hz, time_budget_s }, reports))
}

fn open_options(config: &SceneConfig, guard: Option<PathBuf>) -> OpenOptions {
    let RealtimeConfig { cpu, priority, .. } = config.realtime;
    OpenOptions {
        selector: config.device.selector.clone(),
        io_request: Some(ThreadRequest { cpu: schedule::loop_cpu(cpu), priority }.below()),
        period_s: config.parameters.period_s,
        guard,
    }
}

/// Share of what the motors can push that a hand pulls with where a client moves it: what stops the
/// tool stops the hand.
const PULL_SHARE: f64 = 0.7;

/// The path of the hand of a simulated arm in a scene, in the frame of the arm; without one the
/// hand stays at the tool's start. `None`: there is no such hand.
///
/// # Errors
/// A hand file that cannot be used.
pub(super) fn hand_of(
    config: &SceneConfig,
    center_of_mass_tool: DVec3,
) -> Result<Option<GripPath>, PrepareError> {
    let is_held = config.device.profile.real.is_none() && config.device.sim.hand_present;
    Ok(if is_held {
        Some(grip_path(config, inputs(config)?.hand, center_of_mass_tool))
    } else {
        None
    })
}

fn grip_path(config: &SceneConfig, path: Option<HandPath>, center_of_mass_tool: DVec3) -> GripPath {
    let DeviceMapping { world_from_device, scale, start, .. } = config.parameters.mapping;
    let mapping = HandMapping { world_from_device, scale, start, grip_tool: center_of_mass_tool };
    let limits = &config.parameters.limits;
    let coupling = &config.parameters.coupling;
    let most = &config.device.profile.limits;
    // Two springs in a row: of the hand and of the coupling.
    let stretch =
        |force: f64, hand: f64, coupling: f64| PULL_SHARE * force * (1.0 / hand + 1.0 / coupling);
    let force_n = limits.force_n.min(most.force_n);
    let torque_nm = limits.torque_nm.min(most.torque_nm);
    let most_m =
        stretch(force_n, config.device.sim.hand_stiffness_n_per_m, coupling.stiffness_n_per_m);
    let most_rad = stretch(
        torque_nm,
        HandParameters::default().stiffness_nm_per_rad,
        coupling.stiffness_nm_per_rad,
    );
    let or = |value: f64, otherwise: f64| {
        if value.is_finite() && value > 0.0 { value } else { otherwise }
    };
    let plain = Reach::default();
    let reach = Reach { most_m: or(most_m, plain.most_m), most_rad: or(most_rad, plain.most_rad) };
    path.unwrap_or_else(|| HandPath::fixed(start)).to_device(mapping).reaching(reach)
}

/// The profile's simulated arm with the scene's hand.
fn simulated_arm(device: &DeviceConfig, path: GripPath, period_s: f64) -> SimParameters {
    let DeviceConfig { profile, sim, .. } = device;
    let mut plant = profile.plant;
    plant.delay_ticks = sim.delay_ticks.unwrap_or(plant.delay_ticks);
    let hand = sim.hand_present.then(|| HandParameters {
        stiffness_n_per_m: sim.hand_stiffness_n_per_m,
        damping_n_s_per_m: sim.hand_damping_n_s_per_m,
        mass_kg: sim.hand_mass_kg,
        path: Some(path),
        ..HandParameters::default()
    });
    SimParameters { plant, ..SimParameters::of(profile, hand, period_s) }
}
