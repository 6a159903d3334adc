//! The two ways of projecting a point onto a triangle, on triangles and points that know nothing of
//! each other.
//!
//! # Source
//! Sagardia2008, section 4: the second method takes 37 % of the time of the first, for arbitrary
//! triangles and points.

use std::hint::black_box;

use glam::DVec3;

use super::super::Row;
use super::super::random::Random;
use super::super::statistics::median;
use super::points::{clamped, optimised};
use super::{Options, SEED, timed};
use vps::mesh::closest_point::Projection;

/// Share of the first way's time that the second takes in the paper, %.
pub(super) const PAPER_PERCENT: f64 = 37.0;

const N_TRIANGLES: usize = 1000;
const N_POINTS: usize = 200;
/// A round takes some milliseconds; the median of so many in turn, for each run.
const ROUNDS: usize = 5;

/// Time of one projection, ns.
#[derive(Clone, Copy, Debug, Default)]
pub struct Projections {
    /// The first way.
    pub clamped_ns: f64,
    /// The second way, the triangle prepared for every point.
    pub optimised_ns: f64,
    /// The second way, the triangle prepared once for all its points, as the pointshell does.
    pub prepared_ns: f64,
}

impl Projections {
    /// Time of the second way, %, of the first: prepared for every point, and once.
    pub fn percent(&self) -> [f64; 2] {
        [self.optimised_ns, self.prepared_ns].map(|ns| 100.0 * ns / self.clamped_ns)
    }

    pub(super) fn rows(&self) -> Vec<Row> {
        let group = "paper of 2008: one projection, arbitrary triangles and points";
        let [optimised, prepared] = self.percent();
        let share = |name: &str, percent| Row {
            paper: Some(PAPER_PERCENT),
            ..Row::new(group, name, percent, "%")
        };
        vec![
            Row::new(group, "first way", self.clamped_ns, "ns"),
            Row::new(group, "second way, prepared for every point", self.optimised_ns, "ns"),
            Row::new(group, "second way, prepared once for each triangle", self.prepared_ns, "ns"),
            share("second of the first, prepared for every point", optimised),
            share("second of the first, prepared once for each triangle", prepared),
        ]
    }
}

/// Measures the ways in turn.
pub(super) fn measure(options: Options) -> Projections {
    let mut random = Random::new(SEED);
    let mut vector = |size: f64| {
        DVec3::new(
            random.within(-size, size),
            random.within(-size, size),
            random.within(-size, size),
        )
    };
    let triangles: Vec<[DVec3; 3]> =
        (0..N_TRIANGLES).map(|_| [vector(1.0), vector(1.0), vector(1.0)]).collect();
    let points: Vec<DVec3> = (0..N_POINTS).map(|_| vector(1.5)).collect();
    let [mut clamped_ns, mut optimised_ns, mut prepared_ns] = [const { Vec::new() }; 3];
    for _ in 0..ROUNDS * options.n_runs {
        clamped_ns.push(each_ns(&triangles, &points, |corners, point| clamped(corners)(point)));
        optimised_ns.push(each_ns(&triangles, &points, |corners, point| optimised(corners)(point)));
        prepared_ns.push(one_ns(|| {
            let of = |corners: &[DVec3; 3]| {
                let project = optimised(black_box(corners));
                points.iter().map(|point| project(*point).distance_squared).sum::<f64>()
            };
            triangles.iter().map(of).sum()
        }));
    }
    let of = |ns: &[f64]| median(ns).unwrap_or_default();
    Projections {
        clamped_ns: of(&clamped_ns),
        optimised_ns: of(&optimised_ns),
        prepared_ns: of(&prepared_ns),
    }
}

fn each_ns(
    triangles: &[[DVec3; 3]],
    points: &[DVec3],
    project: impl Fn(&[DVec3; 3], DVec3) -> Projection,
) -> f64 {
    // A triangle is looked at anew for every point: nothing of it may be computed once and kept.
    let of = |corners| {
        points.iter().map(|point| project(black_box(corners), *point).distance_squared).sum::<f64>()
    };
    one_ns(|| triangles.iter().map(of).sum())
}

/// Time of one projection of a round, ns.
fn one_ns(round: impl FnOnce() -> f64) -> f64 {
    let (sum, seconds) = timed(round);
    black_box(sum);
    1e9 * seconds / (N_TRIANGLES * N_POINTS) as f64
}
