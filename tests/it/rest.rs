//! A scene, an arm and a hand, tick by tick on the virtual clock: does it come to rest, and what
//! did it come to?

use arms::Device;
use arms::simulated::hand::{HandMapping, HandPath};
use arms::simulated::{HandParameters, SimArm, SimParameters};
use glam::DVec3;
use hapticd::config::SceneConfig;
use haptics::{Drive, DriveRequest, Faults, RenderScene, State, TickInput, TickOutput, tick};

pub(crate) const T: f64 = 1e-3;

/// Hand stiffness N/m, damping N·s/m, mass g.
pub(crate) const HANDS: [(&str, [f64; 3]); 2] =
    [("stiff", [2000.0, 20.0, 200.0]), ("loose", [100.0, 1.5, 60.0])];

/// The arms that everything has to be at rest on.
pub(crate) const ARMS: [&str; 3] = ["sim-sigma7", "sim-touch", "sim-premium15-6dof"];

/// Ticks of delay beyond an arm's own.
pub(crate) const MORE_DELAY: [u32; 3] = [0, 1, 3];

/// Most that an arm may give more than it took, J. Judged behind the passivity controller; what is
/// left is encoder steps, and what is owed when contact is left (0.4 mJ at worst).
pub(crate) const OWED_J: f64 = 1e-3;

/// What one run came to.
#[derive(Debug)]
pub(crate) struct Outcome {
    /// Peak to peak of the force command while at rest, N.
    pub(crate) ripple_n: f64,
    /// Peak to peak of the torque command while at rest, N·m.
    pub(crate) ripple_nm: f64,
    /// Largest true speed of the grip while at rest, m/s.
    pub(crate) speed_m_per_s: f64,
    /// Deepest point ever, and while at rest, m.
    pub(crate) deepest_m: f64,
    pub(crate) rest_depth_m: f64,
    /// Largest |F| of the run, N.
    pub(crate) force_n: f64,
    /// Mean |F| at rest, N.
    pub(crate) rest_force_n: f64,
    pub(crate) lowest_j: f64,
    pub(crate) damped_ticks: usize,
    pub(crate) last: TickOutput,
    /// Where the arm stands at the end, as a displacement from its zero, m.
    arm_m: DVec3,
}

/// Plays a baked scene with the parameters, arm and hand of a configuration. The last `n_rest`
/// ticks have to be at rest.
///
/// In every tick: no fault, every number finite, command within the limits.
pub(crate) fn play(
    scene: &mut RenderScene,
    config: &SceneConfig,
    path: &HandPath,
    n_ticks: usize,
    n_rest: usize,
) -> Outcome {
    scene.parameters = config.parameters;
    let mut arm = arm(config, scene, path);
    let mut state = State::new(scene);
    let mut outputs = Vec::with_capacity(n_ticks);
    let mut speeds = Vec::with_capacity(n_ticks);
    let limits = config.parameters.limits;
    for n in 0..n_ticks {
        let sample = arm.read().expect("a sample");
        let output = tick(
            scene,
            &mut state,
            &TickInput { sample, request: DriveRequest::Enable, ..TickInput::default() },
        );
        arm.write(&output.command_device).expect("a finite command");
        assert_eq!(output.faults, Faults::NONE, "tick {n}: {output:?}");
        assert!(
            output.world_from_tool.is_finite()
                && output.contact_world.is_finite()
                && output.energy_j.is_finite(),
            "tick {n}"
        );
        assert!(
            output.command_device.force.length() <= limits.force_n * (1.0 + 1e-12),
            "tick {n}: {output:?}"
        );
        assert!(
            output.command_device.torque.length() <= limits.torque_nm * (1.0 + 1e-12),
            "tick {n}: {output:?}"
        );
        outputs.push(output);
        speeds.push(arm.true_twist().linear.length());
    }
    let rest = &outputs[n_ticks - n_rest..];
    let spread = |of: &dyn Fn(&TickOutput) -> DVec3| {
        let low = rest.iter().map(of).fold(DVec3::INFINITY, DVec3::min);
        (rest.iter().map(of).fold(DVec3::NEG_INFINITY, DVec3::max) - low).max_element()
    };
    let deepest = |outputs: &[TickOutput]| {
        outputs.iter().map(|output| output.max_depth_m).fold(0.0, f64::max)
    };
    assert_eq!(outputs[n_ticks - 1].drive, Drive::Enabled);
    Outcome {
        ripple_n: spread(&|output| output.command_device.force),
        ripple_nm: spread(&|output| output.command_device.torque),
        speed_m_per_s: speeds[n_ticks - n_rest..].iter().copied().fold(0.0, f64::max),
        deepest_m: deepest(&outputs),
        rest_depth_m: deepest(rest),
        force_n: outputs
            .iter()
            .map(|output| output.command_device.force.length())
            .fold(0.0, f64::max),
        rest_force_n: rest.iter().map(|output| output.command_device.force.length()).sum::<f64>()
            / n_rest as f64,
        lowest_j: outputs.iter().map(|output| output.energy_j).fold(0.0, f64::min),
        damped_ticks: outputs.iter().filter(|output| output.passivity_active).count(),
        last: outputs[n_ticks - 1],
        arm_m: arm.true_pose().translation,
    }
}

fn arm(config: &SceneConfig, scene: &RenderScene, path: &HandPath) -> SimArm {
    let profile = &config.device.profile;
    let mapping = &config.parameters.mapping;
    let mut plant = profile.plant;
    plant.delay_ticks = config.device.sim.delay_ticks.unwrap_or(plant.delay_ticks);
    let hand_mapping = HandMapping {
        world_from_device: mapping.world_from_device,
        scale: mapping.scale,
        start: mapping.start,
        grip_tool: scene.tool.center_of_mass_tool,
    };
    let sim = &config.device.sim;
    SimArm::new(SimParameters {
        plant,
        hand: Some(HandParameters {
            stiffness_n_per_m: sim.hand_stiffness_n_per_m,
            damping_n_s_per_m: sim.hand_damping_n_s_per_m,
            mass_kg: sim.hand_mass_kg,
            path: Some(path.to_device(hand_mapping)),
            ..HandParameters::default()
        }),
        sensed: profile.sensed,
        actuated: profile.actuated,
        force_limit_n: profile.limits.force_n,
        torque_limit_nm: profile.limits.torque_nm,
        ..SimParameters::ideal(T)
    })
    .expect("a hand that the plant can follow")
}

/// What may still move in a hand at rest.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Still {
    pub(crate) ripple_n: f64,
    pub(crate) ripple_nm: f64,
    pub(crate) speed_m_per_s: f64,
    /// Most that the arm may have given more than it took, in the whole run, J.
    pub(crate) owed_j: f64,
}

impl Still {
    /// An arm that stands between two encoder steps may see either: one step each of up to two
    /// axes, and the friction that holds it there.
    pub(crate) fn on(config: &SceneConfig) -> Self {
        let coupling = &config.parameters.coupling;
        let plant = &config.device.profile.plant;
        Self {
            ripple_n: 2.0 * plant.encoder_step_m * coupling.stiffness_n_per_m + 0.05,
            ripple_nm: 2.0 * plant.encoder_step_rad * coupling.stiffness_nm_per_rad + 0.001,
            speed_m_per_s: 1e-3,
            owed_j: OWED_J,
        }
    }
}

impl Outcome {
    /// No limit cycle, and no more given than taken.
    pub(crate) fn assert_still(&self, what: &str, still: &Still) {
        let Still { ripple_n, ripple_nm, speed_m_per_s, owed_j } = *still;
        assert!(
            self.ripple_n <= ripple_n && self.ripple_nm <= ripple_nm,
            "{what} trembles: {self}, allowed {ripple_n} N"
        );
        assert!(self.speed_m_per_s < speed_m_per_s, "{what} still moves: {self}");
        assert!(self.lowest_j > -owed_j, "{what} gave more than it took: {self}");
    }
}

impl core::fmt::Display for Outcome {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(
            f,
            "ripple {:.4} N {:.5} N·m, {:.2} mm/s, deepest {:.3} mm, at rest {:.3} mm, force {:.2} \
                N, at rest {:.2} N with the arm at {:.3} mm, lowest {:.5} mJ, damped {} ticks",
            self.ripple_n,
            self.ripple_nm,
            self.speed_m_per_s * 1e3,
            self.deepest_m * 1e3,
            self.rest_depth_m * 1e3,
            self.force_n,
            self.rest_force_n,
            self.arm_m.z * 1e3,
            self.lowest_j * 1e3,
            self.damped_ticks,
        )
    }
}
