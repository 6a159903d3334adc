//! What the supervisor reports while it works.

use crate::record::TickRecord;
use arms::attached::open::LinkNews;
use haptics::{Drive, OffCause};
use rt::preflight::PreflightReport;

/// Where the program stands; see the picture in [`crate::supervisor`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// Nothing read yet.
    Init,
    /// Reading, checking and generating the scene.
    Baking,
    /// Loop ready or running, zero force.
    Disabled,
    /// Ramping up.
    Enabling,
    /// Rendering.
    Enabled,
    /// Ramping down.
    Stopping,
    /// A damper without stiffness.
    Braking,
    /// Zero force after a fault.
    Fault,
    /// At rest, done.
    Stopped,
}

impl Phase {
    /// For people.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Init => "init",
            Self::Baking => "baking",
            Self::Disabled => "disabled",
            Self::Enabling => "enabling",
            Self::Enabled => "enabled",
            Self::Stopping => "stopping",
            Self::Braking => "braking",
            Self::Fault => "fault",
            Self::Stopped => "stopped",
        }
    }

    pub(super) const fn of(drive: Drive) -> Self {
        match drive {
            Drive::Disabled => Self::Disabled,
            Drive::Enabling => Self::Enabling,
            Drive::Enabled => Self::Enabled,
            Drive::Stopping => Self::Stopping,
            Drive::Braking => Self::Braking,
            Drive::Fault => Self::Fault,
        }
    }
}

/// What the supervisor reports while it works.
#[derive(Debug)]
pub enum Notice<'a> {
    /// A new phase.
    Phase(Phase),
    /// What the machine offers; reported before the first tick.
    Preflight(&'a PreflightReport),
    /// The newest tick, about ten times a second.
    Status(&'a TickRecord),
    /// The tick in which a fault appeared.
    Fault(&'a TickRecord),
    /// The first tick of another scene.
    Scene(&'a TickRecord),
    /// What became of the link of a real arm.
    Link(&'a LinkNews),
    /// Force is wanted and does not flow: something that an operator can mend is in the way.
    Waiting(OffCause),
}
