//! What crosses between an arm and the renderer: a pose sample one way (a wrench goes the other
//! way).

use super::{Pose, Twist};

/// How a sample came about.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum SampleStatus {
    /// New since the last tick.
    #[default]
    Fresh,
    /// No new report arrived; the values repeat the last one.
    Stale,
    /// The device is gone; the values mean nothing.
    Lost,
    /// The network to the machine beside the arm is silent; the values mean nothing.
    LinkLost,
}

impl SampleStatus {
    /// Nothing is known of the arm any more.
    pub const fn is_gone(self) -> bool {
        matches!(self, Self::Lost | Self::LinkLost)
    }
}

/// The newest state of an arm, as the device layer hands it to the tick. `Copy`, no heap.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DeviceSample {
    /// Grip pose in the device frame, `device_from_grip`.
    pub pose: Pose,
    /// Velocity of the grip point and angular velocity, device axes (`measured_cv`).
    pub twist: Twist,
    /// Gripper opening, rad; 0 where the arm has none.
    pub grip_rad: f64,
    /// Button states, bit 0 first.
    pub buttons: u32,
    /// Counts fresh samples from 1.
    pub sequence: u64,
    /// Whether the sample is new.
    pub status: SampleStatus,
    /// Measured round trip: ticks from a command to the first sample that can show its force, less
    /// the one that every arm takes. 0 where the arm does not measure it.
    pub delay_ticks: u32,
    /// The arm knows where its zero is; no force before it does.
    pub homed: bool,
    /// Reports of this read that were short, garbled or failed their check, and were thrown away;
    /// also of a read that gives no fresh sample.
    pub corrupt_packets: u16,
    /// Reports that the arm's own counter says were lost before this one. Means nothing in a stale
    /// sample.
    pub lost_packets: u16,
    /// Error that the arm itself reports; 0: none.
    pub device_error: u16,
    /// The thermal model of a motor has reached its limit.
    pub overheated: bool,
}

impl Default for DeviceSample {
    fn default() -> Self {
        Self {
            pose: Pose::IDENTITY,
            twist: Twist::ZERO,
            grip_rad: 0.0,
            buttons: 0,
            sequence: 0,
            status: SampleStatus::Stale,
            delay_ticks: 0,
            homed: true,
            corrupt_packets: 0,
            lost_packets: 0,
            device_error: 0,
            overheated: false,
        }
    }
}
