//! Figures of both sides for display: written in the loop, read by any thread. Relaxed everywhere:
//! each number is a message of its own.

use core::sync::atomic::{AtomicI64, AtomicU8, AtomicU32, AtomicU64, Ordering::Relaxed};

/// Where the node stands; the picture is in `node`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LinkPhase {
    /// No host has greeted yet.
    #[default]
    Silent,
    /// A host is there; motors off.
    Disabled,
    /// Motors do what the host says.
    Enabled,
    /// The host fell silent: motors off until it has said *disabled*.
    Tripped,
    /// The host sent a number that is none: motors off until it has said *disabled*.
    Refusing,
}

impl LinkPhase {
    const ALL: [Self; 5] =
        [Self::Silent, Self::Disabled, Self::Enabled, Self::Tripped, Self::Refusing];

    /// For people.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Silent => "waits for a host",
            Self::Disabled => "disabled",
            Self::Enabled => "enabled",
            Self::Tripped => "link lost",
            Self::Refusing => "refusing",
        }
    }
}

/// Of the arm's side.
#[derive(Debug, Default)]
pub struct NodeFigures {
    phase: AtomicU8,
    /// Commands that were taken.
    pub(super) commands: AtomicU64,
    /// Packets that came after a newer one, or twice.
    pub(super) old: AtomicU64,
    /// Packets that never came, as far as their numbers show.
    pub(super) lost: AtomicU64,
    /// Packets of a host that this node does not listen to.
    pub(super) foreign_packets: AtomicU64,
    /// How often the link fell silent while force was on.
    pub(super) link_losses: AtomicU32,
    /// How long after the last command the motors were at zero, the last time, µs.
    pub(super) zero_after_us: AtomicU32,
    /// Longest time between two commands while force was on, µs.
    pub(super) longest_gap_us: AtomicU32,
    /// The arm behind the node is gone.
    pub(super) arm_losses: AtomicU32,
}

/// The same as numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct NodeReport {
    /// Commands that were taken.
    pub commands: u64,
    /// Packets that came after a newer one, or twice.
    pub old_packets: u64,
    /// Packets that never came.
    pub lost_packets: u64,
    /// Packets of other hosts.
    pub strange_packets: u64,
    /// How often the link fell silent while force was on.
    pub link_losses: u32,
    /// From the last command to motors at zero, the last time, ms.
    pub zero_after_ms: f64,
    /// Longest time between two commands while force was on, ms.
    pub longest_gap_ms: f64,
    /// How often the arm behind the node was lost.
    pub arm_losses: u32,
}

impl NodeFigures {
    pub(super) fn enter(&self, phase: LinkPhase) {
        self.phase.store(phase as u8, Relaxed);
    }

    /// Where the node stands.
    pub fn phase(&self) -> LinkPhase {
        LinkPhase::ALL.get(usize::from(self.phase.load(Relaxed))).copied().unwrap_or_default()
    }

    /// Everything else.
    pub fn report(&self) -> NodeReport {
        let ms = |us: &AtomicU32| f64::from(us.load(Relaxed)) * 1e-3;
        NodeReport {
            commands: self.commands.load(Relaxed),
            old_packets: self.old.load(Relaxed),
            lost_packets: self.lost.load(Relaxed),
            strange_packets: self.foreign_packets.load(Relaxed),
            link_losses: self.link_losses.load(Relaxed),
            zero_after_ms: ms(&self.zero_after_us),
            longest_gap_ms: ms(&self.longest_gap_us),
            arm_losses: self.arm_losses.load(Relaxed),
        }
    }
}

/// Of the host's side.
#[derive(Debug, Default)]
pub struct LinkFigures {
    pub(super) hold_ms: AtomicU32,
    pub(super) fade_ms: AtomicU32,
    pub(super) there_us: AtomicU32,
    pub(super) back_us: AtomicU32,
    pub(super) offset_us: AtomicI64,
    pub(super) old: AtomicU64,
    pub(super) lost: AtomicU64,
}

/// The same as numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct LinkReport {
    /// How long the node holds the last force when no command arrives, ms: what it says of itself.
    pub hold_ms: u32,
    /// Within what time it then fades to zero, ms.
    pub fade_ms: u32,
    /// Longest way of a command in the last seconds, ms.
    pub there_ms: f64,
    /// Longest way of a state in the last seconds, ms.
    pub back_ms: f64,
    /// What the node's clock is ahead of the host's, ms, both counted from when they began.
    pub clock_offset_ms: f64,
    /// States that came after a newer one, or twice.
    pub old_packets: u64,
    /// States that never came.
    pub lost_packets: u64,
}

impl LinkFigures {
    /// Everything.
    pub fn report(&self) -> LinkReport {
        LinkReport {
            hold_ms: self.hold_ms.load(Relaxed),
            fade_ms: self.fade_ms.load(Relaxed),
            there_ms: f64::from(self.there_us.load(Relaxed)) * 1e-3,
            back_ms: f64::from(self.back_us.load(Relaxed)) * 1e-3,
            clock_offset_ms: self.offset_us.load(Relaxed) as f64 * 1e-3,
            old_packets: self.old.load(Relaxed),
            lost_packets: self.lost.load(Relaxed),
        }
    }
}
