//! Arms that are driven by a library of their maker, which the user has and this program does not.
//!
//! ```text
//!   hapticd                                       worker (`hapticd vendor-arm`, `ps`: haptic-worker)
//!   WiredArm ─ open6 codec ─ PageLink             Exchange ─ open6 arm ─ VendorArm ─ the maker's library ─► arm
//!                │  newest frame each way: page │      ▲
//!                └── socket: a byte wakes, its end ends ┘
//! ```
//! The worker speaks `open6` like any arm with firmware of its own, so that everything above the
//! link is the driver of every other arm: limits, signs, staleness, reconnection. What differs is
//! that the firmware is a process with foreign code in it:
//!
//! | what happens | what follows |
//! |---|---|
//! | no command for the watchdog time of the profile | the worker sends zero, and again until a command without enable has come |
//! | hapticd dies, or lets go | the socket ends: zero, the library's stop, the worker ends |
//! | the library crashes, or calls `exit` | the socket ends: the arm is lost in the next tick |
//! | the library hangs, or the worker is stopped | no states: stale after 20 ms, lost after 0.5 s; then the worker is killed |
//!
//! In the last two the arm is left to the watchdog in its own firmware.
//!
//! | file | owns |
//! |---|---|
//! | `mod` | what a maker's arm has to do: `VendorArm`, `VendorSample`, `VendorFault` |
//! | [`Family`] in `family` | which library: its names, its places, its error words |
//! | `elf` | whether a file is a library that this process can load |
//! | `library` | `dlopen`, and every signature: the one file with `unsafe` |
//! | `page` | the shared page |
//! | `worker`, `host` | the two ends |
//! | `force_dimension`, `open_haptics`, `virtuose` | one family each |

mod elf;
mod family;
mod force_dimension;
mod host;
mod library;
mod open_haptics;
mod page;
mod virtuose;
mod worker;

pub(crate) use elf::unsuitable_file;
pub(crate) use family::Need;
pub use family::{Family, VendorProtocol};
pub use host::VendorError;
pub(crate) use host::{Words, look_for, start};
pub(crate) use virtuose::PORT as VIRTUOSE_PORT;
pub use worker::{Assignment, work};
pub(crate) use worker::{Exchange, HostLine};

use glam::{DQuat, DVec3};
use vps::spatial::Twist;

/// Name of a worker in `ps`. Not one that `pkill hapticd` means.
pub(crate) const NAME: &str = "haptic-worker";

/// What the maker's library says of the arm, in the device frame (x toward the operator, y right, z
/// up), SI.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct VendorSample {
    /// Of the grip, m.
    pub(crate) position: DVec3,
    /// Of the grip; identity where it is not measured.
    pub(crate) orientation: DQuat,
    /// Of the grip, m/s and rad/s.
    pub(crate) twist: Twist,
    /// Angle of the gripper, rad, and its rate.
    pub(crate) grip: [f64; 2],
    /// Bit 0 first.
    pub(crate) buttons: u16,
    /// The library repeats what it said before, because it was asked too soon or has nothing new:
    /// not a sample.
    pub(crate) is_repeat: bool,
    /// The arm has found its zero.
    pub(crate) homed: bool,
    /// What [`Family::fault_text`] has words for, 128 and above; 0: nothing. Force goes to zero and
    /// the arm is disabled.
    pub(crate) fault: u8,
}

impl Default for VendorSample {
    fn default() -> Self {
        Self {
            position: DVec3::ZERO,
            orientation: DQuat::IDENTITY,
            twist: Twist::default(),
            grip: [0.0; 2],
            buttons: 0,
            is_repeat: false,
            homed: false,
            fault: 0,
        }
    }
}

/// What the motors are to make, in the device frame: N, N·m at the grip point. A gripper has no
/// force.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct VendorCommand {
    pub(crate) force: DVec3,
    pub(crate) torque: DVec3,
    /// The host has enabled the motors. Where this is false everything above is 0.
    pub(crate) enabled: bool,
}

/// The arm is gone, or answers nothing that can be used: the worker ends, and the host tells this.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub(crate) struct VendorFault(pub(crate) String);

/// An open arm behind a maker's library. All of it runs in the worker; what hangs or crashes here
/// takes the worker along and nothing else.
pub(crate) trait VendorArm {
    /// What it is, in one line for people: model, serial number, versions.
    fn identity(&self) -> String;

    /// Sets the motors: called in every turn, also while nothing is commanded, since libraries
    /// compute gravity compensation with each command.
    ///
    /// # Errors
    /// The arm is lost.
    fn command(&mut self, command: &VendorCommand) -> Result<(), VendorFault>;

    /// Where it is now.
    ///
    /// # Errors
    /// The arm is lost.
    fn sample(&mut self) -> Result<VendorSample, VendorFault>;

    /// What there is to be reported since the last call, if anything: what a person has to do, or
    /// what the library has changed. Called by the worker's clock alone.
    fn news(&mut self) -> Option<String> {
        None
    }

    /// Exchanges with the host until it has gone. By the worker's clock: a turn for each command,
    /// and one when none came. A library that owns its clock calls [`Exchange::turn`] from its own
    /// callback and waits with [`HostLine::wait`] here, in the thread that started it.
    ///
    /// # Errors
    /// The arm is lost.
    fn run(&mut self, exchange: &mut Exchange, host: &mut HostLine) -> Result<(), VendorFault> {
        while host.wait(exchange.patience()) {
            exchange.turn(self)?;
            if let Some(news) = self.news() {
                host.tell(&news);
            }
        }
        Ok(())
    }

    /// Zero, the library's stop, and the end of it. The last call, on every way out that is left to
    /// the worker.
    fn close(&mut self);
}
