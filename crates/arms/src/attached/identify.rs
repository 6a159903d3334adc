//! What an axis of an arm is made of, from how it moved under known forces. Cold.
//!
//! The model is simulated beside the measurement, and what it is made of is changed until both move
//! alike:
//!
//! ```text
//! m·a + b·v + c·sign(v) + k·x = F + F₀
//! ```
//!
//! Nothing measured is ever differentiated, so the steps of an encoder hardly matter; and dry
//! friction is a part of the model, so it is not taken for viscosity: that would be the unsafe way
//! round, because viscosity is what a coupling may lean on.

use glam::DVec3;

use vps::spatial::{Mat6, Wrench};

/// Steps of the model in one period.
const SUBSTEPS: u32 = 4;
/// Rounds of the fit: it has long settled by then.
const ROUNDS: u32 = 40;
/// Share of the largest change of a number that still counts as one.
const SETTLED: f64 = 1e-7;
/// Displacement below which an axis has not moved, m.
const MOVED_M: f64 = 1e-4;
/// Longest delay beyond the one that is measured, ticks.
const EXTRA_DELAY_MAX: usize = 3;
/// Standard deviations between what was found and what may be relied on.
const DEVIATIONS: f64 = 2.0;

/// What an axis is made of.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AxisDynamics {
    /// Effective mass, kg.
    pub mass_kg: f64,
    /// Viscosity, N·s/m.
    pub damping_n_s_per_m: f64,
    /// Dry friction, N.
    pub coulomb_n: f64,
    /// Standard deviation of the mass over the trials, kg.
    pub mass_spread_kg: f64,
    /// The same of the viscosity, N·s/m.
    pub damping_spread_n_s_per_m: f64,
    /// Viscosity that may be relied on: what was found less twice its spread, N·s/m.
    pub damping_bound_n_s_per_m: f64,
}

/// One trial: a force and a position per tick.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Record {
    /// Force that was written in the tick, N.
    pub forces_n: Vec<f64>,
    /// Position that was read in it before, m; `None`: nothing new had come.
    pub(super) ways_m: Vec<Option<f64>>,
    /// Ticks from a force to the first sample that can show it, less the one that every arm takes.
    pub delay_ticks: usize,
}

/// Numbers of the model: m, b, c, k, F₀, and the velocity at the start.
#[derive(Clone, Copy, Debug)]
struct Model([f64; 6]);

impl Model {
    fn admitted(self) -> Self {
        let [mass, damping, coulomb, stiffness, force, velocity] = self.0;
        Self([
            mass.max(1e-4),
            damping.max(0.0),
            coulomb.max(0.0),
            stiffness.max(0.0),
            force,
            velocity,
        ])
    }

    /// Positions at the ticks of a record, from 0.
    fn ways(&self, record: &Record, period_s: f64) -> Vec<f64> {
        let [mass, damping, coulomb, stiffness, offset, mut velocity] = self.0;
        let h = period_s / f64::from(SUBSTEPS);
        let inertia = mass + h * damping;
        let mut way = 0.0;
        (0..record.ways_m.len())
            .map(|tick| {
                if tick > 0 {
                    let force = tick
                        .checked_sub(1 + record.delay_ticks)
                        .map_or(0.0, |at| record.forces_n[at])
                        + offset;
                    for _ in 0..SUBSTEPS {
                        // Dry friction takes what momentum is left, and never turns it round.
                        let sliding = mass * velocity + h * (force - stiffness * way);
                        let left = (sliding.abs() - h * coulomb).max(0.0);
                        velocity = left.copysign(sliding) / inertia;
                        way += h * velocity;
                    }
                }
                way
            })
            .collect()
    }

    /// Sum of the squares of what is off, the mean position apart.
    fn misses(&self, record: &Record, period_s: f64) -> Vec<Option<f64>> {
        let ways = self.ways(record, period_s);
        let misses: Vec<Option<f64>> = record
            .ways_m
            .iter()
            .zip(&ways)
            .map(|(measured, way)| measured.map(|measured| measured - way))
            .collect();
        let n = misses.iter().flatten().count().max(1) as f64;
        let mean = misses.iter().flatten().sum::<f64>() / n;
        misses.into_iter().map(|miss| miss.map(|miss| miss - mean)).collect()
    }
}

fn sum_of_squares(misses: &[Option<f64>]) -> f64 {
    misses.iter().flatten().map(|miss| miss * miss).sum()
}

fn has_moved(record: &Record) -> bool {
    let Some(first) = record.ways_m.iter().flatten().next() else { return false };
    record.ways_m.iter().flatten().any(|way| (way - first).abs() >= MOVED_M)
}

/// From a few guesses: far from the truth a model may stick where the arm slides.
fn guess(record: &Record, period_s: f64) -> Option<Model> {
    [0.05, 0.2, 0.6]
        .into_iter()
        .filter_map(|mass| {
            descend(Model([mass, 10.0 * mass, 0.0, 0.0, 0.0, 0.0]), record, period_s)
        })
        .min_by(|(a, _), (b, _)| a.total_cmp(b))
        .map(|(_, model)| model)
}

/// One model for each record, all with the delay that fits them best: what an arm takes from a
/// command to its force it does not say.
fn fit(records: &[Record], period_s: f64) -> Option<Vec<Model>> {
    let first = guess(records.first()?, period_s)?;
    let delayed = |extra: usize| -> Option<(f64, Vec<Model>)> {
        let mut sum = 0.0;
        let mut models = Vec::with_capacity(records.len());
        for record in records {
            let record = Record { delay_ticks: record.delay_ticks + extra, ..record.clone() };
            let (miss, model) = descend(first, &record, period_s)?;
            sum += miss;
            models.push(model);
        }
        Some((sum, models))
    };
    (0..=EXTRA_DELAY_MAX)
        .filter_map(delayed)
        .min_by(|(a, _), (b, _)| a.total_cmp(b))
        .map(|(_, models)| models)
}

/// Levenberg–Marquardt. Gives the sum of the squares of what is left.
fn descend(start: Model, record: &Record, period_s: f64) -> Option<(f64, Model)> {
    /// Sizes that the numbers of a model have: what a difference is taken over, and where a step is
    /// small.
    const SIZES: [f64; 6] = [0.1, 1.0, 0.05, 5.0, 0.02, 0.01];
    let mut model = start;
    let mut misses = model.misses(record, period_s);
    let mut sum = sum_of_squares(&misses);
    let mut damping = 1e-3;
    for _ in 0..ROUNDS {
        let columns: [Vec<Option<f64>>; 6] = core::array::from_fn(|idx| {
            let mut moved = model;
            let step = 1e-4 * SIZES[idx];
            moved.0[idx] += step;
            let there = moved.misses(record, period_s);
            // In units of the size of each number.
            misses
                .iter()
                .zip(there)
                .map(|(here, there)| Some((here.as_ref()? - there?) / 1e-4))
                .collect()
        });
        let mut normal = Mat6::ZERO;
        let mut right = Wrench::ZERO;
        for (tick, miss) in misses.iter().enumerate() {
            let Some(miss) = miss else { continue };
            let row: [f64; 6] = core::array::from_fn(|idx| columns[idx][tick].unwrap_or(0.0));
            let linear = DVec3::new(row[0], row[1], row[2]);
            let angular = DVec3::new(row[3], row[4], row[5]);
            normal.add_outer(1.0, linear, angular);
            right.force += linear * *miss;
            right.torque += angular * *miss;
        }
        let mut is_better = false;
        let mut largest: f64 = 0.0;
        while !is_better && damping < 1e9 {
            let mut damped = normal;
            for idx in 0..6 {
                damped.0[idx][idx] += damping * normal.0[idx][idx] + f64::MIN_POSITIVE;
            }
            let (linear, angular) = damped.solve_spd(right)?;
            let step = [linear.x, linear.y, linear.z, angular.x, angular.y, angular.z];
            let tried =
                Model(core::array::from_fn(|idx| model.0[idx] + step[idx] * SIZES[idx])).admitted();
            let tried_misses = tried.misses(record, period_s);
            let tried_sum = sum_of_squares(&tried_misses);
            if tried_sum < sum {
                largest = step.iter().fold(0.0, |largest: f64, step| largest.max(step.abs()));
                (model, misses, sum) = (tried, tried_misses, tried_sum);
                damping = (damping * 0.1).max(1e-12);
                is_better = true;
            } else {
                damping *= 10.0;
            }
        }
        if !is_better || largest < SETTLED {
            break;
        }
    }
    (sum.is_finite() && model.0.iter().all(|number| number.is_finite())).then_some((sum, model))
}

fn mean_and_spread(numbers: &[f64]) -> (f64, f64) {
    let n = numbers.len() as f64;
    let mean = numbers.iter().sum::<f64>() / n;
    let spread = (numbers.iter().map(|number| (number - mean).powi(2)).sum::<f64>()
        / (n - 1.0).max(1.0))
    .sqrt();
    (mean, spread)
}

/// What several trials of one axis say. `None`: in one of them it did not move, or nothing fits.
pub(super) fn made_of(records: &[Record], period_s: f64) -> Option<AxisDynamics> {
    if !records.iter().all(has_moved) {
        return None;
    }
    let models = fit(records, period_s)?;
    let of =
        |idx: usize| mean_and_spread(&models.iter().map(|model| model.0[idx]).collect::<Vec<_>>());
    let ((mass_kg, mass_spread_kg), (damping, damping_spread), (coulomb_n, _)) =
        (of(0), of(1), of(2));
    Some(AxisDynamics {
        mass_kg,
        damping_n_s_per_m: damping,
        coulomb_n,
        mass_spread_kg,
        damping_spread_n_s_per_m: damping_spread,
        damping_bound_n_s_per_m: (damping - DEVIATIONS * damping_spread).max(0.0),
    })
}
