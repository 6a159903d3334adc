//! Whether force flows: what the supervisor asks for, and where the drive stands.
//!
//! ```text
//!                 Enable, no gate shut                      gain = 1
//!   Disabled ───────────────────────────────► Enabling ───────────────► Enabled
//!    ▲ ▲                                         │  too fast              │ │
//!    │ │                                         ├────────►  Braking  ◄───┘ │
//!    │ │                                         │ Stop,          │         │ Stop, deadman let go,
//!    │ │                                         │ ...            │         │ overheated
//!    │ │ gain = 0                                ▼                │         ▼
//!    │ └────────────────────────────────────  Stopping  ◄─────────│─────────┘
//!    │                                           │                │ too fast: slow again, or brake_s over
//!    │ Disable request                           │ overheated: gain = 0
//!    │ deadman let go and pressed                ▼                ▼
//!    └──────────────────────────────────────   Fault  ◄─── any other fault, at once, from every state with force
//! ```
//! A `Disable` request leads from every state to `Disabled` at once. Force flows in `Enabling`,
//! `Enabled`, `Stopping` and `Braking` only; in `Braking` it is that of a damper.
//!
//! The gates between `Disabled` and `Enabling`, all of which have to be open: the deadman is held
//! (and was let go since the last fault), the arm is homed, no motor is overheated, the grip is
//! within the workspace, the sample is fresh. Then `Enabling` itself waits, with zero force, until
//! the wrench has been small for some ticks: a tool that stands pressed against something is not
//! switched on with a blow. It waits as long as that takes; the arm moves freely and ends it.
//!
//! A drive that the deadman switched off holds the tool's place: the tool stands where it stood,
//! and the arm's pose at the next enable is its new zero. After a `Disable` the tool stands at the
//! start of the scene.

/// What the supervisor wants of the servo.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DriveRequest {
    /// No force. Also acknowledges a fault.
    #[default]
    Disable,
    /// Ramp up and render. After a fault it takes a `Disable` first, or the deadman let go and
    /// pressed again.
    Enable,
    /// Ramp down to zero, then stay disabled.
    Stop,
}

/// Where the drive stands (CRTK: DISABLED, ENABLED + is_busy, ENABLED, ENABLED + is_busy, PAUSED,
/// FAULT).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Drive {
    /// Zero wrench.
    #[default]
    Disabled,
    /// Waiting for a small wrench, then ramping up from zero.
    Enabling,
    /// Rendering.
    Enabled,
    /// Ramping down to zero after a stop request.
    Stopping,
    /// Zero wrench until a `Disable` request, then `Enable`; with a deadman also until it is let go
    /// and pressed again.
    Fault,
    /// Damping without stiffness, for a moment after too much speed.
    Braking,
}

impl Drive {
    /// Force may flow.
    pub fn has_force(self) -> bool {
        self.renders() || self == Self::Braking
    }

    /// The scene is felt.
    pub(super) fn renders(self) -> bool {
        matches!(self, Self::Enabling | Self::Enabled | Self::Stopping)
    }

    /// On the way from one state to another (CRTK `is_busy`).
    pub const fn is_busy(self) -> bool {
        matches!(self, Self::Enabling | Self::Stopping)
    }

    /// The CRTK name of the state.
    pub const fn crtk_name(self) -> &'static str {
        match self {
            Self::Disabled => "DISABLED",
            Self::Enabling | Self::Enabled | Self::Stopping => "ENABLED",
            Self::Braking => "PAUSED",
            Self::Fault => "FAULT",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn states_are_those_of_crtk() {
        for (drive, name, renders, has_force, is_busy) in [
            (Drive::Disabled, "DISABLED", false, false, false),
            (Drive::Enabling, "ENABLED", true, true, true),
            (Drive::Enabled, "ENABLED", true, true, false),
            (Drive::Stopping, "ENABLED", true, true, true),
            (Drive::Braking, "PAUSED", false, true, false),
            (Drive::Fault, "FAULT", false, false, false),
        ] {
            assert_eq!(drive.crtk_name(), name);
            assert_eq!(
                (drive.renders(), drive.has_force(), drive.is_busy()),
                (renders, has_force, is_busy),
                "{name}"
            );
        }
    }
}
