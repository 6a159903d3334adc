//! Whether force flows: what the supervisor asks for, and where the drive stands.
//!
//! ```text
//!                 Enable and a sound sample                 gain = 1
//!   Disabled ───────────────────────────────► Enabling ───────────────► Enabled
//!      ▲  ▲                                      │                        │
//!      │  │ gain = 0                       Stop  ▼                 Stop   ▼
//!      │  └─────────────────────────────────  Stopping ◄──────────────────┘
//!      │ Disable request                         │ any fault, from every state with force
//!      └───────────────────  Fault ◄─────────────┘
//! ```
//! A `Disable` request leads from every state to `Disabled` at once. Force flows in `Enabling`, `Enabled` and `Stopping` only.

/// What the supervisor wants of the servo.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DriveRequest {
    /// No force. Also acknowledges a fault.
    #[default]
    Disable,
    /// Ramp up and render. After a fault it takes a `Disable` first.
    Enable,
    /// Ramp down to zero, then stay disabled.
    Stop,
}

/// Where the drive stands (CRTK: DISABLED, ENABLED + is_busy, ENABLED, FAULT).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Drive {
    /// Zero wrench.
    #[default]
    Disabled,
    /// Ramping up from zero.
    Enabling,
    /// Rendering.
    Enabled,
    /// Ramping down to zero after a stop request.
    Stopping,
    /// Zero wrench until a `Disable` request, then `Enable`.
    Fault,
}

impl Drive {
    /// Force may flow.
    pub fn has_force(self) -> bool {
        matches!(self, Self::Enabling | Self::Enabled | Self::Stopping)
    }
}
