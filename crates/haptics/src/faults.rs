//! Named faults as a `Copy` bit set; their text is made on the cold side.

use core::ops::{BitOr, BitOrAssign};

/// A set of faults. Any of them gives a zero wrench until the operator enables again.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Faults(u32);

impl Faults {
    /// No fault.
    pub const NONE: Self = Self(0);
    /// A sample, a contact wrench or the command was NaN or infinite.
    pub const NON_FINITE: Self = Self(1);
    /// The device moved faster than `limits.speed_mm_per_s`.
    pub const SPEED: Self = Self(1 << 1);
    /// No fresh sample for longer than the stale limit.
    pub const STALE: Self = Self(1 << 2);
    /// The device is gone: it answered with an error, or not at all.
    pub const DEVICE_LOST: Self = Self(1 << 3);
    /// The loop was late too often in a row.
    pub const OVERRUN: Self = Self(1 << 4);
    /// The sampled pose jumped further in one tick than the arm can move.
    pub const POSITION_JUMP: Self = Self(1 << 5);
    /// The servo thread panicked.
    pub const PANIC: Self = Self(1 << 6);
    /// The 6×6 step of the implicit coupling had no solution.
    pub const SOLVER: Self = Self(1 << 7);
    /// Fresh samples repeat one pose although the arm was moving.
    pub const STUCK: Self = Self(1 << 8);
    /// The loop put more power into the hand than it may, over a window.
    pub const POWER: Self = Self(1 << 9);
    /// The arm no longer knows where its zero is.
    pub const NOT_HOMED: Self = Self(1 << 10);
    /// Too many packets were short, garbled or failed their check.
    pub const PROTOCOL: Self = Self(1 << 11);
    /// The arm itself reports an error.
    pub const DEVICE_ERROR: Self = Self(1 << 12);
    /// The arm's counter says that too many samples in a row were lost.
    pub const SEQUENCE_GAP: Self = Self(1 << 13);
    /// A motor is too hot.
    pub const THERMAL: Self = Self(1 << 14);
    /// The network to the machine beside the arm fell silent.
    pub const LINK: Self = Self(1 << 15);

    /// Every fault with its name on the wire and in plain words.
    pub const TABLE: [(Self, &'static str, &'static str); 16] = [
        (Self::NON_FINITE, "non-finite", "a pose or a force was not a number"),
        (Self::SPEED, "speed", "the arm moved faster than the speed limit"),
        (Self::STALE, "stale", "the arm sent no new sample for too long"),
        (Self::DEVICE_LOST, "disconnected", "the arm is gone"),
        (
            Self::OVERRUN,
            "overrun",
            "the loop was late too many times in a row, or stood still for longer than the scene \
                allows",
        ),
        (
            Self::POSITION_JUMP,
            "position-jump",
            "the sampled pose jumped further than the arm can move in one tick",
        ),
        (Self::PANIC, "panic", "the servo thread stopped on an internal error"),
        (Self::SOLVER, "solver", "the coupling step had no solution"),
        (
            Self::STUCK,
            "stuck",
            "the arm was moving, and then its samples repeated one pose for too long",
        ),
        (Self::POWER, "power", "the arm put more power into the hand than the power limit"),
        (Self::NOT_HOMED, "not-homed", "the arm lost its zero while force was on"),
        (Self::PROTOCOL, "protocol", "too many packets of the arm were garbled"),
        (Self::DEVICE_ERROR, "device-error", "the arm reported an error of its own"),
        (Self::SEQUENCE_GAP, "sequence-gap", "too many samples in a row were lost on the way"),
        (Self::THERMAL, "thermal", "a motor of the arm was too hot"),
        (Self::LINK, "link", "the network to the machine beside the arm was silent for too long"),
    ];

    /// True when no fault is set.
    pub const fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// True when every fault of `other` is set.
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// The faults of this set that are not in `other`.
    #[must_use]
    pub const fn without(self, other: Self) -> Self {
        Self(self.0 & !other.0)
    }

    /// The set as bits, for records.
    pub const fn bits(self) -> u32 {
        self.0
    }

    /// The set with these bits.
    pub const fn from_bits(bits: u32) -> Self {
        Self(bits)
    }

    /// Names of the set faults.
    pub fn names(self) -> impl Iterator<Item = &'static str> {
        Self::TABLE
            .into_iter()
            .filter(move |(fault, ..)| self.contains(*fault))
            .map(|(_, name, _)| name)
    }
}

impl BitOr for Faults {
    type Output = Self;
    fn bitor(self, rhs: Self) -> Self {
        Self(self.0 | rhs.0)
    }
}

impl BitOrAssign for Faults {
    fn bitor_assign(&mut self, rhs: Self) {
        self.0 |= rhs.0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_set_with_a_fault_that_it_has_is_the_same_set() {
        let both = Faults::SPEED | Faults::STALE;
        assert_eq!(both | Faults::SPEED, both);
        assert_eq!(both.without(Faults::STALE), Faults::SPEED);
        let mut more = both;
        more |= Faults::STALE;
        assert_eq!(more, both);
        assert!(both.contains(Faults::SPEED) && !both.contains(Faults::LINK));
        assert!(both.names().eq(["speed", "stale"]));
    }
}
