//! What the driver is told of an arm.

use glam::DQuat;

use super::Thermal;
use crate::device::Capabilities;
use crate::device::kinematics::Kinematics;
use crate::device::motor_stage::Limits;
use crate::device::transmission::Transmission;

/// Where the time of samples comes from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Timebase {
    /// The machine's monotonic clock.
    #[default]
    Monotonic,
    /// One period per read, for arms that are simulated in the same loop.
    Counted,
}

/// Everything that a profile says of a wired arm.
#[derive(Clone, Debug)]
pub(in crate::device) struct WiredParameters {
    /// Joint angles to grip.
    pub(in crate::device) kinematics: Kinematics,
    /// Readings to joint angles, torques to commands.
    pub(in crate::device) transmission: Transmission,
    /// Rotation from the frame of the kinematics to the device frame.
    pub(in crate::device) device_from_native: DQuat,
    /// What the arm can do.
    pub(in crate::device) capabilities: Capabilities,
    /// A sign check has seen every motor push the way it is told.
    pub(in crate::device) signs_verified: bool,
    /// Of the profile.
    pub(in crate::device) limits: Limits,
    /// What is left of them until then: they hold whichever motors push the wrong way.
    pub(in crate::device) unverified_limits: Limits,
    /// Windows of the linear and the angular velocity, s.
    pub(in crate::device) velocity_window_s: [f64; 2],
    /// Silence after which the arm is woken, s; `None`: never.
    pub(in crate::device) kick_s: Option<f64>,
    /// Round trip to report before one has been measured, ticks.
    pub(in crate::device) delay_ticks: u32,
    /// Heat of the motors.
    pub(in crate::device) thermal: Thermal,
    /// One tick, s.
    pub(in crate::device) period_s: f64,
    /// Time of samples.
    pub(in crate::device) timebase: Timebase,
    /// The arm is on another machine: silence after which the network between counts as lost, s. `None`: it hangs on this one.
    pub(in crate::device) link_silence_s: Option<f64>,
}
