//! How much a walk may look at in one tick, and what it does when that is not enough.
//!
//! A budget is a **count**, so that a recording replays bit for bit wherever it runs; a caller with
//! a time limit turns it into a count before the first tick. A point counts 1, a block of eight
//! spheres 8, or 1 when all of them are still clear since an earlier tick.
//!
//! Where the budget ends, a node is not refined: its representative stands for all points below it,
//! with their surface as weight, so the sum stays comparable. The walk refines level by level, so
//! what is left out is left out at the finest levels; of a level that fits in part, nodes below
//! which something touched in the last tick are refined first, the deepest of them before the
//! others; a quarter is kept for the others, evenly spread and other ones in the next tick, so that
//! new contacts are found. Of the leaves every one gives some of its points, evenly spread over it,
//! and those in which something touched as many as the budget allows: a leaf left out as a whole
//! would take a side of a contact away that another side balances.

use crate::pointshell::shell::LANES;
use crate::pointshell::tree::CHILDREN;

/// Points that may be looked at in one tick.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Budget {
    /// As many as it takes.
    #[default]
    Unlimited,
    /// So many.
    Points(u32),
}

impl Budget {
    /// The share of an obstacle when `n_left` obstacles, this one among them, and what is left are
    /// to be divided evenly.
    #[inline]
    pub(super) fn share(self, n_left: usize) -> Self {
        match self {
            Self::Unlimited => Self::Unlimited,
            Self::Points(points) => {
                Self::Points(points / u32::try_from(n_left.max(1)).unwrap_or(u32::MAX))
            }
        }
    }

    /// What is left of it.
    #[inline]
    pub(super) fn without(self, spent: u32) -> Self {
        match self {
            Self::Unlimited => Self::Unlimited,
            Self::Points(points) => Self::Points(points.saturating_sub(spent)),
        }
    }

    /// Of `n_open` nodes, how many may be refined, when every other one still costs its
    /// representative and every child that a refined one may open too.
    #[inline]
    pub(super) fn refinable(self, n_open: u32) -> u32 {
        match self {
            Self::Unlimited => n_open,
            Self::Points(points) => (points.saturating_sub(n_open) / WORST_CASE).min(n_open),
        }
    }

    /// How many points of each of `n_open` leaves may be looked at, a power of two of at most half
    /// of them, and of how many leaves twice as many.
    #[inline]
    pub(super) fn points_per_leaf(self, n_open: u32) -> (u32, u32) {
        let half = LANES as u32 / 2;
        let Self::Points(points) = self else { return (half, n_open) };
        let mut per_leaf = half;
        while per_leaf > 1 && per_leaf * n_open > points {
            per_leaf /= 2;
        }
        (per_leaf, (points.saturating_sub(per_leaf * n_open) / per_leaf).min(n_open))
    }
}

/// What refining a node may cost beyond its representative: eight spheres and the representatives
/// of eight children, or sixteen points, instead of the one point.
const WORST_CASE: u32 = 15;
const _: () = assert!(2 * CHILDREN == LANES && WORST_CASE as usize == LANES - 1);

/// Which nodes of a level are refined: evenly spread, other ones from tick to tick.
#[derive(Clone, Copy, Debug)]
pub(super) struct Selection {
    n_open: u64,
    n_refined: u64,
    turn: u64,
}

impl Selection {
    #[inline]
    pub(super) fn new(n_open: u32, n_refined: u32, turn: u64) -> Self {
        Self {
            n_open: u64::from(n_open.max(1)),
            n_refined: u64::from(n_refined),
            turn: turn % u64::from(n_open.max(1)),
        }
    }

    /// True for exactly `n_refined` of the `n_open` nodes.
    #[inline]
    pub(super) fn takes(self, idx: u32) -> bool {
        if self.n_refined == self.n_open {
            return true;
        }
        let at = (u64::from(idx) + self.turn) % self.n_open;
        at * self.n_refined / self.n_open != (at + 1) * self.n_refined / self.n_open
    }
}

/// Which nodes of a level are refined, those that matter most being listed first: most of them from
/// the front, a quarter from the others.
#[derive(Clone, Copy, Debug)]
pub(super) struct Choice {
    n_first: u32,
    others: Selection,
}

impl Choice {
    /// Every node.
    #[inline]
    pub(super) fn all(n_open: u32) -> Self {
        Self { n_first: n_open, others: Selection::new(0, 0, 0) }
    }

    #[inline]
    pub(super) fn new(n_open: u32, n_refined: u32, turn: u64) -> Self {
        let n_first = n_refined - n_refined / 4;
        Self { n_first, others: Selection::new(n_open - n_first, n_refined - n_first, turn) }
    }

    /// True for exactly `n_refined` of the `n_open` nodes.
    #[inline]
    pub(super) fn takes(self, idx: u32) -> bool {
        idx < self.n_first || self.others.takes(idx - self.n_first)
    }
}

#[cfg(test)]
#[expect(
    clippy::disallowed_types,
    clippy::disallowed_macros,
    clippy::indexing_slicing,
    reason = "test code"
)]
mod tests {
    use super::*;

    #[test]
    fn a_selection_takes_as_many_as_asked_evenly_and_everyone_in_turn() {
        for (n_open, n_refined) in [(1, 0), (1, 1), (7, 3), (100, 1), (100, 99), (1000, 137)] {
            let mut taken = vec![0_u32; n_open as usize];
            for turn in 0..u64::from(n_open) {
                let selection = Selection::new(n_open, n_refined, turn);
                let chosen: Vec<u32> = (0..n_open).filter(|idx| selection.takes(*idx)).collect();
                assert_eq!(chosen.len() as u32, n_refined);
                let gaps = chosen.windows(2).map(|pair| pair[1] - pair[0]);
                assert!(gaps.clone().max().unwrap_or(0) <= gaps.min().unwrap_or(0) + 1);
                chosen.into_iter().for_each(|idx| taken[idx as usize] += 1);
            }
            assert!(taken.iter().all(|times| *times == n_refined), "{n_open} {n_refined}");
        }
    }

    #[test]
    fn a_choice_takes_as_many_as_asked_most_of_them_from_the_front() {
        for (n_open, n_refined) in [(1, 0), (1, 1), (10, 4), (10, 9), (100, 40), (100, 99)] {
            let choice = Choice::new(n_open, n_refined, 3);
            let chosen: Vec<u32> = (0..n_open).filter(|idx| choice.takes(*idx)).collect();
            assert_eq!(chosen.len() as u32, n_refined);
            let n_front = n_refined - n_refined / 4;
            assert!(chosen.iter().take(n_front as usize).copied().eq(0..n_front));
        }
        assert!((0..7).all(|idx| Choice::all(7).takes(idx)));
    }

    #[test]
    fn what_a_choice_takes_of_the_others_is_a_selection_of_them() {
        // 4 of 10: three from the front, and one of the seven others.
        for turn in 0..7 {
            let choice = Choice::new(10, 4, turn);
            let others = Selection::new(7, 1, turn);
            assert!((0..7).all(|idx| choice.takes(3 + idx) == others.takes(idx)), "{turn}");
        }
    }

    #[test]
    fn leaves_share_what_is_left_evenly() {
        assert_eq!(Budget::Unlimited.points_per_leaf(9), (8, 9));
        for (points, n_open, expected) in [
            (160, 10, (8, 10)),
            (80, 10, (8, 0)),
            (79, 10, (4, 9)),
            (40, 10, (4, 0)),
            (25, 10, (2, 2)),
            (10, 10, (1, 0)),
            (10_000, 10, (8, 10)),
        ] {
            let (per_leaf, n_twice) = Budget::Points(points).points_per_leaf(n_open);
            assert_eq!((per_leaf, n_twice), expected, "{points}");
            assert!(per_leaf * (n_open + n_twice) <= points);
        }
        // One of each is looked at even where there are not so many.
        assert_eq!(Budget::Points(5).points_per_leaf(10), (1, 0));
    }

    #[test]
    fn a_budget_is_divided_evenly_and_is_never_less_than_nothing() {
        let budget = Budget::Points(100);
        // 100 / 3, rounded down.
        assert_eq!([0, 1, 3].map(|n| budget.share(n)), [100, 100, 33].map(Budget::Points));
        assert_eq!([30, 130].map(|spent| budget.without(spent)), [70, 0].map(Budget::Points));
        assert_eq!(Budget::Unlimited.share(3).without(30), Budget::Unlimited);
    }

    #[test]
    fn a_budget_is_never_exceeded_whatever_opens() {
        for points in [16, 17, 40, 100, 1000, 12345] {
            let mut left = points;
            let mut n_open = 1;
            for _ in 0..8 {
                let n = Budget::Points(left).refinable(n_open);
                // All children open.
                left -= 8 * n + (n_open - n);
                n_open = 8 * n;
                assert!(left >= n_open);
            }
        }
    }
}
