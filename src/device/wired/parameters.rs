//! What the driver is told of an arm.

use glam::DQuat;

use super::Thermal;
use crate::device::Capabilities;
use crate::device::kinematics::Kinematics;
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
pub struct WiredParameters {
    /// Joint angles to grip.
    pub kinematics: Kinematics,
    /// Readings to joint angles, torques to commands.
    pub transmission: Transmission,
    /// Rotation from the frame of the kinematics to the device frame.
    pub device_from_native: DQuat,
    /// What the arm can do.
    pub capabilities: Capabilities,
    /// Largest |F|, N.
    pub force_limit_n: f64,
    /// Largest |τ|, N·m.
    pub torque_limit_nm: f64,
    /// Windows of the linear and the angular velocity, s.
    pub velocity_window_s: [f64; 2],
    /// Silence after which the arm is woken, s; `None`: never.
    pub kick_s: Option<f64>,
    /// Round trip to report before one has been measured, ticks.
    pub delay_ticks: u32,
    /// Heat of the motors.
    pub thermal: Thermal,
    /// One tick, s.
    pub period_s: f64,
    /// Time of samples.
    pub timebase: Timebase,
    /// The arm is on another machine: silence after which the network between counts as lost, s. `None`: it hangs on this one.
    pub link_silence_s: Option<f64>,
}
