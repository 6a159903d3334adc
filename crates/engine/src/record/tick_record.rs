//! One tick, as it leaves the loop.

use haptics::{TickInput, TickOutput};
use vps::spatial::Wrench;

/// Everything that entered and left one tick, and how long it took. `Copy`, no heap: it is written
/// in place by the servo.
///
/// Input and output are enough to run the tick again and compare bits. The three durations are
/// measurements of this machine and never enter a tick.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct TickRecord {
    /// Number of the tick, from 0.
    pub tick: u64,
    /// Which scene: 0 the first, one more after each swap.
    pub scene_idx: u32,
    /// Loop time at which the tick began, ns since the loop began; simulated under the virtual
    /// clock.
    pub time_ns: i64,
    /// How late the tick began after the deadline that it waited for, ns.
    pub wakeup_ns: u64,
    /// Duration of the tick itself, ns.
    pub compute_ns: u64,
    /// Duration of reading from and writing to the arm together, ns.
    pub device_ns: u64,
    /// What entered the tick.
    pub input: TickInput,
    /// What left the tick.
    pub output: TickOutput,
    /// What the motors made of the command (`rendered`): device axes, reduced at the grip point.
    /// Torque that the arm has no motors for is gone from it, and all of it is smaller where a
    /// motor was at its limit.
    pub rendered_device: Wrench,
    /// What the motors made beside the command: gravity compensation and damping of joints. The
    /// hand feels it where it does not match the weight of the links.
    pub beside_device: Wrench,
    /// What the contact query might look at; `None`: everything. It enters the tick, and is the
    /// same throughout a scene.
    pub contact_budget_points: Option<u32>,
}
