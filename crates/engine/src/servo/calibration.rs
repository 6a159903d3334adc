//! From the time that the contact queries of a tick may take to the count of points that fits into
//! each.
//!
//! Runs before the first tick, in the thread of the loop and on its processor: queries of the real
//! scene at poses where the tool overlaps what stands there, without the proofs of earlier ones.
//! The count is what a slow one of them (nine tenths are faster) would have managed in the time.
//!
//! Simulated time has no speed: there the count comes from [`NOMINAL_NS_PER_POINT`], the same on
//! every machine.

use haptics::{RenderScene, State};
use rt::clock::{Clock, ClockKind};
use vps::contact::Budget;

/// What a point is taken to cost under the virtual clock, and before anything is measured, ns.
const NOMINAL_NS_PER_POINT: f64 = 10.0;
/// Queries per round.
const QUERIES: usize = 128;
/// The first round runs with the nominal count, the next ones with what the one before gave.
const ROUNDS: usize = 2;
/// Fewer points make no contact query.
const POINTS_MIN: f64 = 64.0;

/// The count of points of each query for the time of a tick. Allocates; RT: start-up only. Cost: about 2 · 128 times the
/// time.
pub(super) fn budget<C: Clock>(
    scene: &RenderScene,
    state: &State,
    clock: &C,
    time_budget_s: f64,
) -> Budget {
    let n_queries = scene.parameters.coupling.mode.queries_per_tick();
    let time_ns = time_budget_s * 1e9 / f64::from(n_queries);
    let points_at =
        |ns_per_point: f64| Budget::Points((time_ns / ns_per_point).max(POINTS_MIN) as u32);
    let mut budget = points_at(NOMINAL_NS_PER_POINT);
    if clock.kind() == ClockKind::Virtual {
        return budget;
    }
    let mut rehearsal = state.clone();
    for round in 0..ROUNDS {
        rehearsal.set_budget(budget);
        let mut queries = [(0.0, 0_u32); QUERIES];
        for (turn, (time_ns, looked_at)) in (round * QUERIES..).zip(&mut queries) {
            let begin_ns = clock.stopwatch_ns();
            *looked_at = rehearsal.rehearse(scene, turn);
            *time_ns = (clock.stopwatch_ns() - begin_ns).max(1) as f64;
        }
        // Of those that looked at little, what does not depend on points is most of the time.
        let most = queries.iter().map(|(_, looked_at)| *looked_at).max().unwrap_or(0).max(1);
        let mut ns_per_point = queries.map(|(time_ns, looked_at)| {
            if looked_at >= most / 4 { time_ns / f64::from(looked_at.max(1)) } else { 0.0 }
        });
        let n_large = ns_per_point.iter().filter(|ns_per_point| **ns_per_point > 0.0).count();
        ns_per_point.sort_by(f64::total_cmp);
        let slow = QUERIES - 1 - n_large / 10;
        budget = points_at(ns_per_point.get(slow).copied().unwrap_or(NOMINAL_NS_PER_POINT));
    }
    budget
}

#[cfg(test)]
#[expect(clippy::disallowed_types, reason = "test code outside the loop")]
mod tests {
    use core::cell::Cell;
    use core::cmp::Ordering;

    use super::*;
    use crate::servo::testing::blocks_and_plate;
    use haptics::testing::empty_scene;
    use rt::clock::{RealClock, VirtualClock};

    /// A machine on which each query takes as long as it is set to.
    struct Machine {
        takes_ns: Vec<i64>,
        n_looks: Cell<usize>,
        now_ns: Cell<i64>,
    }

    impl Clock for Machine {
        fn kind(&self) -> ClockKind {
            ClockKind::Real
        }

        fn now_ns(&mut self) -> i64 {
            self.now_ns.get()
        }

        fn sleep_until(&mut self, _: i64) {}

        fn stopwatch_ns(&self) -> i64 {
            // Before and after each query.
            let n_looks = self.n_looks.replace(self.n_looks.get() + 1);
            if n_looks % 2 == 1 {
                let took_ns = self.takes_ns.get(n_looks / 2).copied().unwrap_or(0);
                self.now_ns.set(self.now_ns.get() + took_ns);
            }
            self.now_ns.get()
        }
    }

    /// A point costs 10 ns, but 100 ns in a tenth of the queries that look at much, 25 ns in one
    /// that is slower than all others of them, and 1000 ns in those that look at little.
    fn takes_ns(looked_at: &[u32]) -> Vec<i64> {
        let most = looked_at.iter().copied().max().unwrap_or(0).max(1);
        let is_large = |looked_at: u32| looked_at >= most / 4;
        let n_large = looked_at.iter().filter(|looked_at| is_large(**looked_at)).count();
        let mut n_before = 0_usize;
        let ns_per_point = |looked_at: u32| -> i64 {
            if is_large(looked_at) {
                n_before += 1;
                match n_before.cmp(&(n_large / 10 + 1)) {
                    Ordering::Less => 100,
                    Ordering::Equal => 25,
                    Ordering::Greater => 10,
                }
            } else {
                1000
            }
        };
        let costs_ns = looked_at.iter().copied().map(ns_per_point);
        costs_ns.zip(looked_at).map(|(ns, looked_at)| ns * i64::from(*looked_at).max(1)).collect()
    }

    #[test]
    fn simulated_time_has_a_fixed_rate() {
        let scene = empty_scene();
        let state = State::new(&scene);
        assert_eq!(
            budget(&scene, &state, &VirtualClock::default(), 300e-6),
            Budget::Points(15_000)
        );
        assert_eq!(budget(&scene, &state, &VirtualClock::default(), 1e-9), Budget::Points(64));
        // With nothing to query it still is a count.
        assert!(matches!(budget(&scene, &state, &RealClock, 300e-6), Budget::Points(64..)));
    }

    #[test]
    fn the_count_is_what_the_slow_ones_of_the_large_queries_manage() {
        // Without small ones, and with more of them than of the others.
        for n_small in [0, 2] {
            let scene = blocks_and_plate(n_small);
            let state = State::new(&scene);
            let mut rehearsal = state.clone();
            // What a query looks at depends on the count: the nominal one first, then what the
            // first round gives.
            let mut all_ns = Vec::new();
            for (turns, points) in [(0..QUERIES, 50_000), (QUERIES..2 * QUERIES, 20_000)] {
                rehearsal.set_budget(Budget::Points(points));
                let looked_at: Vec<u32> =
                    turns.map(|turn| rehearsal.rehearse(&scene, turn)).collect();
                all_ns.extend(takes_ns(&looked_at));
            }
            let machine =
                Machine { takes_ns: all_ns, n_looks: Cell::new(0), now_ns: Cell::new(1_000_000) };
            // 1 ms of 25 ns, half of it for each of two queries.
            assert_eq!(budget(&scene, &state, &machine, 1e-3), Budget::Points(20_000));
        }
    }
}
