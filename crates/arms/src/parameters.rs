//! What the driver needs to know of an arm.

use glam::DQuat;

use crate::Capabilities;
use crate::kinematics::Kinematics;
use crate::thermal::Thermal;
use crate::transmission::Transmission;

/// Where the time of samples comes from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Timebase {
    /// The machine's monotonic clock.
    #[default]
    Monotonic,
    /// One period per read, for arms that are simulated in the same loop.
    Counted,
}

/// Most that the motors may make at the grip.
#[derive(Clone, Copy, Debug)]
pub(super) struct MotorLimits {
    /// Largest |F|, N.
    pub(super) force_n: f64,
    /// Largest |τ|, N·m.
    pub(super) torque_nm: f64,
}

/// Everything that a profile says of a wired arm.
#[derive(Clone, Debug)]
pub(crate) struct WiredParameters {
    /// Joint angles to grip.
    pub(crate) kinematics: Kinematics,
    /// Readings to joint angles, torques to commands.
    pub(crate) transmission: Transmission,
    /// Step of motor commands on the wire, in their units.
    pub(crate) motor_step: f64,
    /// Rotation from the frame of the kinematics to the device frame.
    pub(crate) device_from_native: DQuat,
    /// What the arm can do.
    pub(crate) capabilities: Capabilities,
    /// A sign check has seen every motor push the way it is commanded.
    pub(crate) signs_verified: bool,
    /// Of the profile.
    pub(crate) limits: MotorLimits,
    /// What is left of them until then: they hold whichever motors push the wrong way.
    pub(crate) unverified_limits: MotorLimits,
    /// Windows of the linear and the angular velocity, s.
    pub(crate) velocity_window_s: [f64; 2],
    /// Silence after which the arm is woken, s; `None`: never.
    pub(crate) kick_s: Option<f64>,
    /// Round trip to report before one has been measured, ticks.
    pub(crate) delay_ticks: u32,
    /// Heat of the motors.
    pub(crate) thermal: Thermal,
    /// One tick, s.
    pub(crate) period_s: f64,
    /// Time of samples.
    pub(crate) timebase: Timebase,
    /// The arm is on another machine: silence after which the network between counts as lost, s.
    /// `None`: it is attached to this one.
    pub(crate) link_silence_s: Option<f64>,
}
