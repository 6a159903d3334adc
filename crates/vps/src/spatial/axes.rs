//! Which axes an arm has.

use glam::DVec3;

/// A subset of the six axes x y z rx ry rz plus the grip, in the device frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Axes(u8);

impl Axes {
    /// No axis.
    pub const NONE: Self = Self(0);
    /// x, y, z.
    pub const TRANSLATION: Self = Self(0b000_0111);
    /// rx, ry, rz.
    pub const ROTATION: Self = Self(0b011_1000);
    /// All six, no grip.
    pub const SIX: Self = Self(0b011_1111);
    /// The names that profiles use, in bit order.
    pub const NAMES: [&'static str; 7] = ["x", "y", "z", "rx", "ry", "rz", "grip"];

    /// The axis of that name as a set of one; `None` for an unknown name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::NAMES.iter().position(|known| *known == name).map(|bit| Self(1 << bit))
    }

    /// Both sets together.
    pub const fn union(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// True when every axis of `other` is in `self`.
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// True for axis number 0..=6 (x y z rx ry rz grip).
    pub const fn has(self, axis_idx: usize) -> bool {
        self.0 >> axis_idx & 1 == 1
    }

    /// 1 for each of x y z in the set, 0 for the others.
    pub fn linear_mask(self) -> DVec3 {
        self.mask(0)
    }

    /// 1 for each of rx ry rz in the set, 0 for the others.
    pub fn angular_mask(self) -> DVec3 {
        self.mask(3)
    }

    fn mask(self, first_axis: usize) -> DVec3 {
        let one_if = |axis_idx: usize| if self.has(axis_idx) { 1.0 } else { 0.0 };
        DVec3::new(one_if(first_axis), one_if(first_axis + 1), one_if(first_axis + 2))
    }

    /// How many axes, the grip included.
    pub const fn count(self) -> u32 {
        self.0.count_ones()
    }

    /// Names of the axes in the set.
    pub fn names(self) -> impl Iterator<Item = &'static str> {
        Self::NAMES
            .into_iter()
            .enumerate()
            .filter(move |(bit, _)| self.has(*bit))
            .map(|(_, name)| name)
    }
}
