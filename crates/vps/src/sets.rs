//! Disjoint sets of numbers, each known by its lowest member.

/// Sets of the numbers `0..n`, at first each by itself.
pub(crate) struct Sets(Vec<u32>);

impl Sets {
    pub(crate) fn new(n: usize) -> Self {
        Self((0..n as u32).collect())
    }

    /// The lowest member of the set of `member`.
    pub(crate) fn lowest(&mut self, mut member: u32) -> u32 {
        let parents = &mut self.0;
        while parents[member as usize] != member {
            // Halving the path keeps the trees flat.
            parents[member as usize] = parents[parents[member as usize] as usize];
            member = parents[member as usize];
        }
        member
    }

    pub(crate) fn join(&mut self, one: u32, other: u32) {
        let one = self.lowest(one);
        let other = self.lowest(other);
        self.0[one.max(other) as usize] = one.min(other);
    }
}
