//! Why no force flows, or why it is on its way out: one word, `Copy`; the cold side prints its
//! name.

use super::Faults;

/// The reason that the drive does not render. The words are those of the devices reference, safety
/// rule 18, and `Workspace`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u8)]
pub enum OffCause {
    /// Force flows, or ramps up.
    #[default]
    None,
    /// The arm's own force switch is off. For drivers that know; the tick never says it.
    Button,
    /// The arm was too fast, or its pose jumped.
    Velocity,
    /// The arm's own watchdog tripped. For drivers that know; the tick never says it.
    Watchdog,
    /// The supervisor asks for no force, or the program itself failed.
    Software,
    /// The arm is gone.
    Disconnected,
    /// The deadman is not held, or was not let go since the last fault.
    Deadman,
    /// No new sample, or samples that repeat.
    Stale,
    /// A value was not a number.
    NonFinite,
    /// Too much power into the hand.
    Power,
    /// A motor is too hot.
    Thermal,
    /// The arm does not know where its zero is.
    NotHomed,
    /// A sign check is under way. For the command that does it; the tick never says it.
    SignCheck,
    /// Garbled or lost packets, or an error that the arm reports.
    Protocol,
    /// The loop was late too often.
    Overrun,
    /// The grip is outside of the profile's workspace.
    Workspace,
    /// The network to the arm's machine is silent.
    Link,
}

impl OffCause {
    /// Every cause, in the order of their numbers.
    pub const ALL: [Self; 17] = [
        Self::None,
        Self::Button,
        Self::Velocity,
        Self::Watchdog,
        Self::Software,
        Self::Disconnected,
        Self::Deadman,
        Self::Stale,
        Self::NonFinite,
        Self::Power,
        Self::Thermal,
        Self::NotHomed,
        Self::SignCheck,
        Self::Protocol,
        Self::Overrun,
        Self::Workspace,
        Self::Link,
    ];

    /// For messages and records.
    pub const fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Button => "button",
            Self::Velocity => "velocity",
            Self::Watchdog => "watchdog",
            Self::Software => "software",
            Self::Disconnected => "disconnected",
            Self::Deadman => "deadman",
            Self::Stale => "stale",
            Self::NonFinite => "non-finite",
            Self::Power => "power",
            Self::Thermal => "thermal",
            Self::NotHomed => "not-homed",
            Self::SignCheck => "sign-check",
            Self::Protocol => "protocol",
            Self::Overrun => "overrun",
            Self::Workspace => "workspace",
            Self::Link => "link",
        }
    }

    /// For people: what to do about it. Empty where there is nothing to say.
    pub const fn advice(self) -> &'static str {
        match self {
            Self::Deadman => "hold the deadman button; after a fault let it go first",
            Self::NotHomed => "the arm has not found its zero: home it",
            Self::Workspace => "move the grip into the arm's workspace",
            Self::Thermal => "a motor is too hot: let it cool",
            Self::Stale => "the arm sends no new samples",
            Self::Disconnected => "the arm is gone",
            Self::Link => "the network to the machine beside the arm is silent",
            Self::NonFinite => "the arm sends values that are not numbers",
            Self::Protocol => "the arm's packets are garbled or lost, or it reports an error",
            _ => "",
        }
    }

    /// What a set of faults comes down to: of several the one that explains most. RT: safe.
    pub(super) fn of(faults: Faults) -> Self {
        [
            (Faults::DEVICE_LOST, Self::Disconnected),
            (Faults::LINK, Self::Link),
            (Faults::NON_FINITE, Self::NonFinite),
            (Faults::DEVICE_ERROR, Self::Protocol),
            (Faults::PROTOCOL, Self::Protocol),
            (Faults::SEQUENCE_GAP, Self::Protocol),
            (Faults::NOT_HOMED, Self::NotHomed),
            (Faults::STALE, Self::Stale),
            (Faults::STUCK, Self::Stale),
            (Faults::OVERRUN, Self::Overrun),
            (Faults::THERMAL, Self::Thermal),
            (Faults::POSITION_JUMP, Self::Velocity),
            (Faults::SPEED, Self::Velocity),
            (Faults::POWER, Self::Power),
            (Faults::SOLVER, Self::Software),
            (Faults::PANIC, Self::Software),
        ]
        .into_iter()
        .find(|(fault, _)| faults.contains(*fault))
        .map_or(Self::None, |(_, cause)| cause)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_fault_has_a_cause_and_every_cause_another_name() {
        for (fault, name, _) in Faults::TABLE {
            assert_ne!(OffCause::of(fault), OffCause::None, "{name}");
        }
        assert_eq!(OffCause::of(Faults::NONE), OffCause::None);
        assert_eq!(OffCause::of(Faults::SPEED | Faults::DEVICE_LOST), OffCause::Disconnected);
        for (n, cause) in OffCause::ALL.into_iter().enumerate() {
            assert_eq!(cause as usize, n, "{}", cause.name());
        }
        let names = std::collections::BTreeSet::from(OffCause::ALL.map(OffCause::name));
        assert_eq!(names.len(), OffCause::ALL.len());
    }
}
