//! Everything a scene can set that the tick reads: SI, checked by `config::resolve`.

use glam::DVec3;

use vps::contact::{ForceLaw, Normalization};
use vps::spatial::{Axes, Pose};
use vps::voxmap::field::FieldKind;

/// How the tool follows the arm.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum CouplingMode {
    /// Virtual tool with mass, implicit Euler over linearised contact and coupling: stable for
    /// every stiffness.
    #[default]
    Implicit,
    /// Virtual tool without mass that stays on the surface: each tick the pose nearest to the arm's
    /// that the contact planes allow.
    Constraint,
    /// No virtual tool: the contact wrench goes to the arm, its stiffness limited to what the arm
    /// can take.
    Direct,
}

impl CouplingMode {
    /// The virtual tool has a mass, and so a velocity of its own.
    pub fn has_mass(self) -> bool {
        self == Self::Implicit
    }

    /// How often a tick looks for contact at most: a tool with mass once more where its step ends.
    pub fn queries_per_tick(self) -> u32 {
        if self.has_mass() { 2 } else { 1 }
    }
}

/// What the arm feels of the coupling while nothing touches.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum FreeSpace {
    /// Exactly zero.
    #[default]
    Zero,
    /// The coupling wrench: the virtual tool's inertia is felt.
    Drag,
}

/// How the coupling spring is bounded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SpringClamp {
    /// F_max · tanh(k x / F_max), smooth, below the device limit.
    #[default]
    Saturate,
    /// McNeely's rule: |F_spring| ≤ k_T s/2.
    HalfVoxel,
}

/// How depths become forces.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ContactParameters {
    /// Field look-up that gives the depth.
    pub field: FieldKind,
    /// Penalty stiffness of one point, N/m.
    pub stiffness_n_per_m: f64,
    /// Damping of the virtual tool in contact, as a fraction of critical damping of the summed
    /// contact stiffness.
    pub damping_ratio: f64,
    /// What many points that touch are worth together.
    pub normalization: Normalization,
    /// How faces that touch hold and slide.
    pub friction: FrictionParameters,
    /// Damping of each face that touches, along its normal, N·s/m; needs a virtual tool with mass.
    pub damping_n_s_per_m: f64,
    /// Points ahead of contact brake the virtual tool; needs one with mass.
    pub braking: bool,
}

impl ContactParameters {
    /// Interpolated depths, 1 N/mm, nothing else.
    pub const PLAIN: Self = Self {
        field: FieldKind::Trilinear,
        stiffness_n_per_m: 1000.0,
        damping_ratio: 0.0,
        normalization: Normalization::None,
        friction: FrictionParameters::NONE,
        damping_n_s_per_m: 0.0,
        braking: false,
    };

    /// What of them a contact query reads.
    pub fn force_law(&self) -> ForceLaw {
        ForceLaw {
            field: self.field,
            stiffness_n_per_m: self.stiffness_n_per_m,
            normalization: self.normalization,
        }
    }
}

/// Coulomb friction, see `friction`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FrictionParameters {
    /// Coefficient up to which a face holds.
    pub r#static: f64,
    /// Coefficient at which it slides; not above the other.
    pub dynamic: f64,
    /// Stiffness of a face that holds, N/m.
    pub stiffness_n_per_m: f64,
}

impl FrictionParameters {
    /// No friction.
    pub const NONE: Self = Self { r#static: 0.0, dynamic: 0.0, stiffness_n_per_m: 0.0 };

    /// False when nothing rubs.
    pub(super) fn acts(&self) -> bool {
        self.r#static > 0.0 && self.stiffness_n_per_m > 0.0
    }
}

/// Virtual coupling between arm and tool.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CouplingParameters {
    /// How the tool follows the arm.
    pub mode: CouplingMode,
    /// Translational stiffness k_T, N/m, in world units (after the device's `scale`).
    pub stiffness_n_per_m: f64,
    /// Rotational stiffness k_R, N·m/rad.
    pub stiffness_nm_per_rad: f64,
    /// Damping that the arm feels, N·s/m; 0 unless the scene asks for it.
    pub felt_damping_n_s_per_m: f64,
    /// Rotational damping that the arm feels, N·m·s/rad.
    pub felt_damping_nm_s_per_rad: f64,
    /// What the spring does at its largest force.
    pub clamp: SpringClamp,
    /// What the arm feels away from contact.
    pub free_space: FreeSpace,
    /// Largest translational stiffness the attached arm can take, N/m; infinite for an ideal arm.
    pub bound_n_per_m: f64,
    /// Largest rotational stiffness the attached arm can take, N·m/rad; infinite for an ideal arm.
    pub bound_nm_per_rad: f64,
}

impl CouplingParameters {
    /// Implicit, 1 N/mm and 0.2 N·m/rad, to an arm that bounds nothing.
    pub const PLAIN: Self = Self {
        mode: CouplingMode::Implicit,
        stiffness_n_per_m: 1000.0,
        stiffness_nm_per_rad: 0.2,
        felt_damping_n_s_per_m: 0.0,
        felt_damping_nm_s_per_rad: 0.0,
        clamp: SpringClamp::Saturate,
        free_space: FreeSpace::Zero,
        bound_n_per_m: f64::INFINITY,
        bound_nm_per_rad: f64::INFINITY,
    };
}

/// Dynamic shaping filter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FilterParameters {
    /// Cut-off range `[f_min, f_max]`, Hz; both infinite switches it off.
    pub cutoff_hz: [f64; 2],
}

/// Longest fall on a stop, a released deadman and every other ramp down, s: a person who lets go
/// does not wait for a slow rise that a scene asks for.
const MOST_RAMP_DOWN_S: f64 = 0.1;

/// Safety limits on what is written to the arm.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LimitParameters {
    /// Largest |F|, N: the lower of scene and profile.
    pub force_n: f64,
    /// Largest |τ|, N·m: the lower of scene and profile.
    pub torque_nm: f64,
    /// Speed of the grip above which the tick faults, m/s.
    pub speed_m_per_s: f64,
    /// Largest rise of |F|, N/s. A fall is at least as fast as [`Self::FALL_S`] says.
    pub slew_n_per_s: f64,
    /// Largest rise of |τ|, N·m/s.
    pub slew_nm_per_s: f64,
    /// Largest power put into the hand, W.
    pub power_w: f64,
    /// Rise time from zero on enable, s. A fall takes [`Self::ramp_down_s`].
    pub ramp_s: f64,
    /// Ticks without a fresh sample before the wrench ramps down.
    pub stale_ticks_max: u32,
    /// Ticks without a fresh sample before the tick faults.
    pub stale_fault_ticks: u32,
    /// Consecutive over-runs before the tick faults; 0 never.
    pub overrun_fault_ticks: u32,
    /// Longest time between two commands while force is on, s: a longer one is a fault, whatever
    /// the rate.
    pub stall_s: f64,
}

impl LimitParameters {
    /// Longest time in which the output stage lets a command fall from its limit to zero, s.
    pub const FALL_S: f64 = 0.010;

    /// Fall time of the whole wrench when force is taken away by a ramp, s: that of the rise, and
    /// never longer than a tenth of a second.
    pub fn ramp_down_s(&self) -> f64 {
        self.ramp_s.min(MOST_RAMP_DOWN_S)
    }

    /// Nothing is held back. For figures and tests: the parameters of a scene file always have
    /// limits.
    #[doc(hidden)]
    pub const NONE: Self = Self {
        force_n: f64::INFINITY,
        torque_nm: f64::INFINITY,
        speed_m_per_s: 10.0,
        slew_n_per_s: f64::INFINITY,
        slew_nm_per_s: f64::INFINITY,
        power_w: f64::INFINITY,
        ramp_s: 0.1,
        stale_ticks_max: 3,
        stale_fault_ticks: 20,
        overrun_fault_ticks: 0,
        stall_s: f64::INFINITY,
    };
}

/// What decides whether force may flow at all, next to the limits. The default asks for nothing:
/// every gate is open.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SafetyParameters {
    /// Number of the button that has to be held for force, 0..=31; `None`: no deadman.
    pub deadman: Option<u8>,
    /// Radius of the ball around the device origin within which force may flow, m; infinite:
    /// everywhere.
    pub workspace_radius_m: f64,
    /// Longest time of braking after too much speed, s.
    pub brake_s: f64,
    /// After enable the ramp begins once force and torque have been within this share of their
    /// limits, and a tool that starts in clay has been outside (infinite: whatever they are, and
    /// wherever it is) ...
    pub engage_share: f64,
    /// ... for more than so many ticks.
    pub engage_ticks: u32,
    /// Window over which the power into the hand is averaged, s. More than the power limit over it
    /// is a fault.
    pub power_window_s: f64,
    /// Smallest move from one sample to the next after which a pose that repeats is suspicious, m;
    /// infinite: never.
    pub stuck_move_m: f64,
    /// The same for a turn, rad.
    pub stuck_turn_rad: f64,
}

impl Default for SafetyParameters {
    fn default() -> Self {
        Self {
            deadman: None,
            workspace_radius_m: f64::INFINITY,
            brake_s: 0.1,
            engage_share: f64::INFINITY,
            engage_ticks: 0,
            power_window_s: 0.05,
            stuck_move_m: f64::INFINITY,
            stuck_turn_rad: f64::INFINITY,
        }
    }
}

/// How device coordinates become world coordinates, and which axes exist.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DeviceMapping {
    /// Where the arm stands: `world_from_device`.
    pub world_from_device: Pose,
    /// World metres per device metre; forces are not scaled.
    pub scale: f64,
    /// Axes the arm senses; an orientation that is not sensed stays at its start value.
    pub sensed: Axes,
    /// Axes the arm actuates; the rest of the wrench is dropped and reported.
    pub actuated: Axes,
    /// Where the tool stands at enable: `world_from_tool`, tool = mesh file frame.
    pub start: Pose,
}

impl DeviceMapping {
    /// The arm's axes are the world's, six of them sensed and actuated; the tool starts at the
    /// origin.
    pub const PLAIN: Self = Self {
        world_from_device: Pose::IDENTITY,
        scale: 1.0,
        sensed: Axes::SIX,
        actuated: Axes::SIX,
        start: Pose::IDENTITY,
    };
}

/// What the loop knows of the attached arm itself. The default is an ideal arm: nothing bounds it,
/// nothing is injected.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ArmParameters {
    /// Delay that the stiffness bounds already allow for, ticks. Only a longer measured one changes
    /// anything.
    pub delay_ticks: u32,
    /// Stiffness times lag that the arm can take in translation, N·s/m, in world units like the
    /// coupling: the stiffness bound is this over T/2 + delay. Infinite for an ideal arm.
    pub stiffness_lag_n_s_per_m: f64,
    /// The same in rotation, N·m·s/rad.
    pub stiffness_lag_nm_s_per_rad: f64,
    /// Largest damping that the passivity controller injects, N·s/m, device units; 0: it only
    /// observes.
    pub injected_n_s_per_m: f64,
    /// The same in rotation, N·m·s/rad.
    pub injected_nm_s_per_rad: f64,
    /// Largest damping that keeps still an arm without a hand at the delay above, N·s/m; infinite
    /// for an ideal arm. At a longer delay it is less, and what is injected with it.
    pub stable_damping_n_s_per_m: f64,
    /// The same in rotation, N·m·s/rad.
    pub stable_damping_nm_s_per_rad: f64,
    /// How old the velocity is that damping is made of, ticks, at the delay above: translation,
    /// rotation.
    pub velocity_age_ticks: [u32; 2],
    /// Step of a measured velocity, device units, m/s: one of the encoder over the window. What is
    /// below it may be rest, or go the other way.
    pub velocity_step_m_per_s: f64,
    /// The same in rotation, rad/s.
    pub velocity_step_rad_per_s: f64,
    /// One step of the encoder, device units, m; 0: continuous. A pose that goes back and forth by
    /// so much is at rest.
    pub encoder_step_m: f64,
    /// The same in rotation, rad.
    pub encoder_step_rad: f64,
}

impl Default for ArmParameters {
    fn default() -> Self {
        Self {
            delay_ticks: 0,
            stiffness_lag_n_s_per_m: f64::INFINITY,
            stiffness_lag_nm_s_per_rad: f64::INFINITY,
            injected_n_s_per_m: 0.0,
            injected_nm_s_per_rad: 0.0,
            stable_damping_n_s_per_m: f64::INFINITY,
            stable_damping_nm_s_per_rad: f64::INFINITY,
            velocity_age_ticks: [0; 2],
            velocity_step_m_per_s: 0.0,
            velocity_step_rad_per_s: 0.0,
            encoder_step_m: 0.0,
            encoder_step_rad: 0.0,
        }
    }
}

/// All parameters of one scene.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Parameters {
    /// Tick period T, s.
    pub period_s: f64,
    /// Gravity in world axes, m/s²; zero by default.
    pub gravity_m_per_s2: DVec3,
    /// Contact model.
    pub contact: ContactParameters,
    /// Coupling.
    pub coupling: CouplingParameters,
    /// Shaping filter.
    pub filter: FilterParameters,
    /// Limits.
    pub limits: LimitParameters,
    /// Gates.
    pub safety: SafetyParameters,
    /// How the device is mapped to the world.
    pub mapping: DeviceMapping,
    /// The arm of the device.
    pub arm: ArmParameters,
}

impl Parameters {
    /// What a contact query reads.
    pub fn force_law(&self) -> ForceLaw {
        self.contact.force_law()
    }

    /// A virtual tool in an implicit coupling, and no limit: for figures, tests, and scenes that no
    /// arm renders. Set `limits`, `safety` and `arm` for a person's hand.
    pub fn unlimited(period_s: f64) -> Self {
        Self {
            period_s,
            gravity_m_per_s2: DVec3::ZERO,
            contact: ContactParameters { damping_ratio: 0.7, ..ContactParameters::PLAIN },
            coupling: CouplingParameters::PLAIN,
            filter: FilterParameters { cutoff_hz: [50.0, 300.0] },
            limits: LimitParameters::NONE,
            safety: SafetyParameters::default(),
            mapping: DeviceMapping::PLAIN,
            arm: ArmParameters::default(),
        }
    }
}
