//! How stiff an arm may be made to feel: stability and passivity of a sampled wall, and of the virtual tool's own step.
//!
//! Data in: mass, damping, period and delay of one axis. Data out: a stiffness. Start-up only (root tests by the hundred); the
//! tick never calls it. All of it is per axis; for a rotation read kg·m² for kg, N·m·s/rad for N·s/m and N·m/rad for N/m.
//!
//! The model: plant m x'' + b x' = F behind a zero-order hold of period T; wall F = −K x − B Δx/T with the backward difference
//! Δx; optionally the low-pass of the shaping filter; then a delay of whole ticks.
#![expect(clippy::indexing_slicing, reason = "start-up only: the tick never comes here")]

use super::filter::low_pass_alpha;

/// Longest delay that the exact test handles, ticks; a longer one counts as unstable.
pub const MAX_DELAY_TICKS: u32 = 256;

/// Safety factor of the auto-limit, below the boundary of stability.
const MARGIN: f64 = 0.8;

/// Largest B T/m for which [`MARGIN`] times the linear rule stays below the exact boundary, by delay in ticks.
const LINEAR_RULE_REACH: [(f64, f64); 6] = [(0.0, 0.22), (1.0, 0.17), (2.0, 0.13), (3.0, 0.10), (5.0, 0.07), (10.0, 0.04)];

/// (z−1)(z−a)(z−α) z^d has the highest degree, d + 3.
const MAX_COEFFICIENTS: usize = MAX_DELAY_TICKS as usize + 4;

/// One axis of an arm with a sampled wall: everything that bounds the stiffness but the stiffness itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SampledWall {
    /// Effective mass of the arm m, kg.
    pub mass_kg: f64,
    /// Physical damping of the arm b, N·s/m.
    pub damping_n_s_per_m: f64,
    /// Virtual damping of the wall B, N·s/m. Credit it only when `delay_ticks` holds the delay of the window that its velocity
    /// comes from; otherwise 0.
    pub wall_damping_n_s_per_m: f64,
    /// Hold period T, s; with jitter the worst observed one, as a late frame holds the force.
    pub period_s: f64,
    /// Delay from sampling to force beyond the hold, in ticks, rounded up.
    pub delay_ticks: u32,
    /// Pole α of a low-pass on the wall force; 0 without one. Only where the filtered force goes to the arm directly.
    pub filter_alpha: f64,
}

impl SampledWall {
    /// Linear rule of stability: K (T/2 + t_d + t_f) < b + B, here solved for K in N/m; 0 when nothing damps.
    ///
    /// Good for short delay, fast sampling and low damping; optimistic for large B ([`stiffness_bound`](Self::stiffness_bound)).
    ///
    /// # Source
    /// Gil2009; the filter term t_f = T α/(1−α) is ours.
    pub fn linear_rule(&self) -> f64 {
        positive_or_zero((self.damping_n_s_per_m + self.wall_damping_n_s_per_m) / self.lag_s())
    }

    /// Largest K in N/m for which the wall with the arm's damping is passive: b > K (T/2 + t_d + t_f) + |B|; 0 when none is.
    ///
    /// Exact for a pure spring, with delay or with the filter; otherwise sufficient.
    ///
    /// # Source
    /// Colgate1997 for b > KT/2 + |B|, Diolaiti2006 for the delay; the terms together, and t_f, are ours.
    pub fn passive_stiffness(&self) -> f64 {
        positive_or_zero((self.damping_n_s_per_m - self.wall_damping_n_s_per_m.abs()) / self.lag_s())
    }

    /// True when the sampled loop decays at that stiffness: every root of the characteristic polynomial
    /// (z−1)(z−a)(z−α) z^d + (1−α)(g1 z + g0)((K + B/T) z − B/T) lies inside the unit circle.
    ///
    /// a = e^(−δ), δ = bT/m, g1 = (m/b²)(δ−1+a), g0 = (m/b²)(1−a−δa); for b = 0 their limits 1, T²/2m, T²/2m. Without the filter
    /// (α = 0) this is the polynomial with z^(d+1). False for K = 0, which leaves the mass where it is put, and for parameters
    /// that are not finite, negative or beyond [`MAX_DELAY_TICKS`].
    ///
    /// # Source
    /// Our derivation; it reproduces the normalised region of Hulin for b = 0. The roots are counted by the Schur–Cohn recursion.
    pub fn is_stable(&self, stiffness_n_per_m: f64) -> bool {
        if !(self.is_physical() && self.delay_ticks <= MAX_DELAY_TICKS && stiffness_n_per_m.is_finite()) {
            return false;
        }
        let delta = self.damping_n_s_per_m * self.period_s / self.mass_kg;
        let pole = (-delta).exp();
        let (phi1, phi0) = hold_coefficients(delta);
        let gain = (1.0 - self.filter_alpha) * self.period_s * self.period_s / self.mass_kg;
        let difference = self.wall_damping_n_s_per_m / self.period_s;
        let proportional = stiffness_n_per_m + difference;

        let alpha = self.filter_alpha;
        let plant_and_filter = [-pole * alpha, pole + alpha + pole * alpha, -(1.0 + pole + alpha), 1.0];
        let wall = [-gain * phi0 * difference, gain * (phi0 * proportional - phi1 * difference), gain * phi1 * proportional];

        let mut coefficients = [0.0; MAX_COEFFICIENTS];
        for (entry, value) in coefficients.iter_mut().skip(self.delay_ticks as usize).zip(plant_and_filter) {
            *entry += value;
        }
        for (entry, value) in coefficients.iter_mut().zip(wall) {
            *entry += value;
        }
        all_roots_inside(&mut coefficients, self.delay_ticks as usize + 3)
    }

    /// Largest K in N/m below which the loop is stable, by bisection on [`is_stable`](Self::is_stable) to 1e-12; 0 when no
    /// stiffness is.
    ///
    /// For B = 0, d = 0 and no filter it is (b²/m)(1−a)/(1−a(1+δ)), until at large δ the root at z = −1 leaves first,
    /// at (b²/m) 2(1+a)/(δ−2+a(2+δ)); for b = 0, d = 0 it is α < 2β(2−β)/(2+β) with α = KT²/m and
    /// β = BT/m.
    ///
    /// # Source
    /// Our derivation, see [`is_stable`](Self::is_stable).
    pub fn max_stiffness(&self) -> f64 {
        // Far enough below the boundary to lie in the stable interval, far enough from K = 0 to be told from it.
        let mut stable = 1e-6 * self.linear_rule();
        if !(stable > 0.0 && self.is_stable(stable)) {
            return 0.0;
        }
        let mut unstable = 2.0 * stable;
        while self.is_stable(unstable) {
            stable = unstable;
            unstable *= 2.0;
        }
        while unstable - stable > 1e-12 * stable {
            let middle = 0.5 * (stable + unstable);
            if self.is_stable(middle) {
                stable = middle;
            } else {
                unstable = middle;
            }
        }
        stable
    }

    /// The stiffness that the attached arm is allowed, N/m: 0.8 of the linear rule, or 0.8 of the exact boundary where B T/m is
    /// too large for that rule. 0 for parameters that are not finite or negative.
    ///
    /// # Source
    /// Our rule on top of Gil2009.
    pub fn stiffness_bound(&self) -> f64 {
        if !self.is_physical() {
            return 0.0;
        }
        let reach = self.linear_rule_reach();
        if self.wall_damping_n_s_per_m * self.period_s / self.mass_kg <= reach {
            MARGIN * self.linear_rule()
        } else {
            MARGIN * self.max_stiffness()
        }
    }

    /// Stiffness times lag that the arm can take without virtual damping, 0.8 b in N·s/m: [`stiffness_bound`](Self::stiffness_bound) is
    /// this over T/2 + t_d + t_f. For the tick, which learns the delay while it runs.
    pub fn stiffness_lag(&self) -> f64 {
        MARGIN * self.damping_n_s_per_m
    }

    /// Largest damping in N·s/m that may be injected for a while, when the velocity it is made of is a difference over `window_s`:
    /// half of what keeps a free mass from ringing. A velocity n ticks old gives v ← v − (B T/m) v_n, stable for
    /// B T/m < 2 sin(π/(4n + 2)); n counts the delay and half the window, rounded up.
    ///
    /// # Source
    /// Our derivation: a root on the unit circle at z = e^(iφ) needs (n + ½) φ = π/2.
    pub fn injectable_damping(&self, window_s: f64) -> f64 {
        positive_or_zero(damping_reach(self.velocity_age_ticks(window_s)) * self.mass_kg / self.period_s)
    }

    /// How old a velocity is that is a difference over `window_s`, when the force made of it acts: the delay and half the window, ticks, rounded up.
    pub fn velocity_age_ticks(&self, window_s: f64) -> u32 {
        self.delay_ticks.saturating_add((0.5 * window_s / self.period_s).ceil() as u32)
    }

    /// Largest B T/m for which 0.8 of the linear rule is safe; between the known delays the next longer one counts.
    fn linear_rule_reach(&self) -> f64 {
        let lag_ticks = f64::from(self.delay_ticks) + alpha_lag_s(self.filter_alpha, 1.0);
        LINEAR_RULE_REACH.into_iter().find(|(ticks, _)| lag_ticks <= *ticks).map_or(0.0, |(_, reach)| reach)
    }

    /// Lag t_f of the low-pass on a slow force, s.
    pub fn filter_lag_s(&self) -> f64 {
        alpha_lag_s(self.filter_alpha, self.period_s)
    }

    /// Lag of the wall force: half a period of the hold, the delay and the filter, s.
    fn lag_s(&self) -> f64 {
        (0.5 + f64::from(self.delay_ticks)) * self.period_s + self.filter_lag_s()
    }

    fn is_physical(&self) -> bool {
        let positive = [self.mass_kg, self.period_s];
        let finite = [self.mass_kg, self.period_s, self.damping_n_s_per_m, self.wall_damping_n_s_per_m];
        positive.into_iter().all(|value| value > 0.0)
            && finite.into_iter().all(f64::is_finite)
            && self.damping_n_s_per_m >= 0.0
            && (0.0..1.0).contains(&self.filter_alpha)
    }
}

/// B T/m up to which a velocity so many ticks old damps a free mass, with a factor of two to the boundary: sin(π/(4n + 2)). RT: safe.
pub(super) fn damping_reach(ticks_old: u32) -> f64 {
    (core::f64::consts::PI / (4.0 * f64::from(ticks_old) + 2.0)).sin()
}

/// Lag t_f = T α/(1−α) of the shaping filter at that cut-off, s; 0 for an infinite cut-off.
///
/// It is the filter's delay at rest: exact in the passivity condition of a spring, slightly too long in the stability rule.
///
/// # Source
/// Our derivation.
pub fn filter_delay_s(cutoff_hz: f64, period_s: f64) -> f64 {
    alpha_lag_s(low_pass_alpha(cutoff_hz, period_s), period_s)
}

/// Largest total stiffness in N/m that a semi-implicit step of the virtual tool takes with that damping: k h²/m + 2 b h/m < 4.
///
/// `damping_n_s_per_m` is the damping in the step itself, not that of the arm; the stiffness is the total, coupling plus
/// contacts. 0 where the damping alone is too much for the step.
///
/// # Source
/// Our derivation (Jury's conditions on the two-by-two step), checked by stepping it.
pub fn semi_implicit_max_stiffness(mass_kg: f64, damping_n_s_per_m: f64, period_s: f64) -> f64 {
    positive_or_zero((4.0 * mass_kg / period_s - 2.0 * damping_n_s_per_m) / period_s)
}

/// The same when the damping is critical for the total stiffness, b = 2 √(m k): k < (2√2 − 2)² m/h².
///
/// # Source
/// Our derivation, the inequality of [`semi_implicit_max_stiffness`] with that b.
pub fn semi_implicit_max_stiffness_critically_damped(mass_kg: f64, period_s: f64) -> f64 {
    let root = 2.0 * core::f64::consts::SQRT_2 - 2.0;
    root * root * mass_kg / (period_s * period_s)
}

fn alpha_lag_s(alpha: f64, period_s: f64) -> f64 {
    period_s * alpha / (1.0 - alpha)
}

/// NaN (0/0 of a plant without damping and without lag) counts as zero: no stiffness is known to be safe.
fn positive_or_zero(value: f64) -> f64 {
    value.max(0.0)
}

/// ((δ−1+e^(−δ))/δ², (1−e^(−δ)−δe^(−δ))/δ²): the two coefficients of the held plant over T²/m.
///
/// Below 0.1 both differences lose digits (all of them at δ = 0), so the series takes over: Σ (−δ)^n/(n+2)! and
/// Σ (n+1)(−δ)^n/(n+2)!.
fn hold_coefficients(delta: f64) -> (f64, f64) {
    if delta > 0.1 {
        let pole = (-delta).exp();
        return ((delta - 1.0 + pole) / (delta * delta), (1.0 - pole - delta * pole) / (delta * delta));
    }
    let (mut phi1, mut phi0) = (0.0, 0.0);
    let mut term = 0.5;
    for n in 0..12 {
        phi1 += term;
        phi0 += f64::from(n + 1) * term;
        term *= -delta / f64::from(n + 3);
    }
    (phi1, phi0)
}

/// Schur–Cohn: true when the polynomial Σ c_i z^i, c_degree = 1, has all its roots inside the unit circle.
///
/// Each step strips one degree: c_(i−1) ← (c_i − k c_(n−i))/(1 − k²) with k = c_0; the roots are inside when every |k| < 1.
/// The coefficients are overwritten.
fn all_roots_inside(coefficients: &mut [f64; MAX_COEFFICIENTS], degree: usize) -> bool {
    let mut n = degree;
    while n > 0 {
        let reflection = coefficients[0];
        if reflection.is_nan() || reflection.abs() >= 1.0 {
            return false;
        }
        let scale = 1.0 / ((1.0 - reflection) * (1.0 + reflection));
        let old = *coefficients;
        for i in 1..=n {
            coefficients[i - 1] = (old[i] - reflection * old[n - i]) * scale;
        }
        n -= 1;
    }
    true
}

#[cfg(test)]
#[expect(clippy::disallowed_types, clippy::disallowed_macros, reason = "test code")]
mod tests {
    use super::*;

    const PERIOD_S: f64 = 1e-3;

    /// m kg, b N·s/m, B N·s/m, d ticks; exact K_max and how many decimals of it are known, linear rule.
    const TABLE: [(f64, f64, f64, u32, f64, i32, f64); 15] = [
        (0.04, 0.8, 0.0, 0, 1605.35, 2, 1600.0),
        (0.1, 0.1, 0.0, 0, 200.033, 3, 200.0),
        (0.1, 1.0, 0.0, 0, 2003.34, 2, 2000.0),
        (1.0, 1.0, 0.0, 0, 2000.33, 2, 2000.0),
        (0.1, 0.1, 0.0, 1, 66.685, 3, 66.667),
        (0.1, 0.1, 0.0, 2, 40.017, 3, 40.0),
        (0.1, 1.0, 0.0, 1, 668.51, 2, 666.67),
        (0.1, 1.0, 0.0, 2, 401.72, 2, 400.0),
        (0.1, 1.0, 0.0, 5, 183.48, 2, 181.82),
        (0.1, 0.1, 1.0, 0, 2178.48, 2, 2200.0),
        (0.1, 0.1, 5.0, 0, 9704.30, 2, 10200.0),
        (0.1, 0.1, 20.0, 0, 32899.8, 1, 40200.0),
        (0.1, 0.1, 5.0, 1, 3211.43, 2, 3400.0),
        (1.0, 5.0, 10.0, 1, 9903.01, 2, 10000.0),
        (0.1, 0.0, 10.0, 0, 18095.24, 2, 20000.0),
    ];

    fn wall(mass_kg: f64, damping: f64, wall_damping: f64, delay_ticks: u32) -> SampledWall {
        SampledWall {
            mass_kg,
            damping_n_s_per_m: damping,
            wall_damping_n_s_per_m: wall_damping,
            period_s: PERIOD_S,
            delay_ticks,
            filter_alpha: 0.0,
        }
    }

    /// The loop itself, stepped in time: nothing of it comes from the characteristic polynomial.
    #[derive(Clone)]
    struct SimulatedLoop {
        wall: SampledWall,
        stiffness: f64,
        x: f64,
        v: f64,
        x_before: f64,
        filtered: f64,
        /// Forces that are still on their way, oldest first.
        underway: Vec<f64>,
    }

    impl SimulatedLoop {
        fn new(wall: SampledWall, stiffness: f64) -> Self {
            Self { wall, stiffness, x: 1e-3, v: 0.0, x_before: 1e-3, filtered: 0.0, underway: vec![0.0; wall.delay_ticks as usize] }
        }

        fn step(&mut self) {
            let SampledWall { mass_kg: m, damping_n_s_per_m: b, wall_damping_n_s_per_m, period_s: t, filter_alpha, .. } = self.wall;
            let raw = -self.stiffness * self.x - wall_damping_n_s_per_m * (self.x - self.x_before) / t;
            self.x_before = self.x;
            self.filtered = filter_alpha * self.filtered + (1.0 - filter_alpha) * raw;
            self.underway.push(self.filtered);
            let force = self.underway.remove(0);
            if b == 0.0 {
                self.x += self.v * t + 0.5 * force / m * t * t;
                self.v += force / m * t;
            } else {
                let decay = (-b * t / m).exp();
                let terminal = force / b;
                self.x += terminal * t + (self.v - terminal) * (1.0 - decay) * m / b;
                self.v = terminal + (self.v - terminal) * decay;
            }
        }

        fn state(&self) -> Vec<f64> {
            let mut state = vec![self.x, self.v, self.x_before, self.filtered];
            state.extend(&self.underway);
            state
        }

        fn set_state(&mut self, state: &[f64]) {
            (self.x, self.v, self.x_before, self.filtered) = (state[0], state[1], state[2], state[3]);
            self.underway.copy_from_slice(&state[4..]);
        }

        /// ln ρ of one tick: the step as a matrix (column by column out of `step`), squared 40 times.
        fn log_spectral_radius(&self) -> f64 {
            let n = self.state().len();
            let mut power = vec![vec![0.0; n]; n];
            for column in 0..n {
                let mut unit = vec![0.0; n];
                unit[column] = 1.0;
                let mut probe = self.clone();
                probe.set_state(&unit);
                probe.step();
                for (row, value) in power.iter_mut().zip(probe.state()) {
                    row[column] = value;
                }
            }
            let mut log_norm = 0.0_f64;
            for _ in 0..40 {
                let norm = power.iter().flatten().fold(0.0_f64, |norm, entry| norm.max(entry.abs()));
                for entry in power.iter_mut().flatten() {
                    *entry /= norm;
                }
                log_norm = 2.0 * (log_norm + norm.ln());
                let old = power.clone();
                for i in 0..n {
                    for j in 0..n {
                        power[i][j] = (0..n).map(|k| old[i][k] * old[k][j]).sum();
                    }
                }
            }
            log_norm / 2.0_f64.powi(40)
        }

        /// Envelope after a run of `n_ticks` over envelope before it, once a first such run has let the other modes die out.
        fn growth(&self, n_ticks: usize) -> f64 {
            const WINDOW: usize = 1000;
            let mut run = self.clone();
            let mut envelope = |n: usize| {
                (0..n).fold(0.0_f64, |envelope, _| {
                    run.step();
                    // An overflow ends in NaN, which `max` would drop.
                    if run.x.is_finite() { envelope.max(run.x.abs()) } else { f64::INFINITY }
                })
            };
            envelope(n_ticks);
            let start = envelope(WINDOW);
            envelope(n_ticks);
            let end = envelope(WINDOW);
            if end.is_finite() { end / start } else { f64::INFINITY }
        }
    }

    /// The loop decays at 0.98 and grows at 1.02 of that stiffness: by its spectral radius, and in time over the horizon that the
    /// spectral radius gives for a factor of 1000 (up to 7e5 ticks).
    fn assert_boundary(wall: SampledWall, stiffness: f64) {
        for (factor, grows) in [(0.98, false), (1.02, true)] {
            let simulated = SimulatedLoop::new(wall, factor * stiffness);
            let rate = simulated.log_spectral_radius();
            assert_eq!(rate > 0.0, grows, "{wall:?} at {factor} K_max: ln of the spectral radius {rate}");
            assert_eq!(wall.is_stable(factor * stiffness), !grows, "{wall:?} at {factor} K_max");
            let n_ticks = (1000.0_f64.ln() / rate.abs()).ceil() as usize;
            let growth = simulated.growth(n_ticks);
            assert!(if grows { growth > 10.0 } else { growth < 0.1 }, "{wall:?} at {factor} K_max: {growth} in {n_ticks} ticks");
        }
    }

    #[test]
    fn acceptance_20_every_row_of_the_table_is_the_boundary_of_the_simulated_loop() {
        for (m, b, wall_damping, delay_ticks, k_max, decimals, linear) in TABLE {
            let wall = wall(m, b, wall_damping, delay_ticks);
            let computed = wall.max_stiffness();
            let tolerance = 0.51 * 10.0_f64.powi(-decimals);
            assert!((computed - k_max).abs() <= tolerance, "{wall:?}: {computed} instead of {k_max}");
            assert!((wall.linear_rule() - linear).abs() <= 1e-5 * linear, "{wall:?}: linear rule {}", wall.linear_rule());
            assert_boundary(wall, k_max);
        }
    }

    #[test]
    fn acceptance_20_without_device_damping_the_boundary_is_the_normalised_region() {
        let mass_kg = 0.1;
        for point_idx in 1..=20 {
            let beta = 1.98 * f64::from(point_idx) / 20.0;
            let alpha = 2.0 * beta * (2.0 - beta) / (2.0 + beta);
            let wall = wall(mass_kg, 0.0, beta * mass_kg / PERIOD_S, 0);
            let k_max = alpha * mass_kg / (PERIOD_S * PERIOD_S);
            assert!((wall.max_stiffness() / k_max - 1.0).abs() < 1e-9, "beta {beta}: {} instead of {k_max}", wall.max_stiffness());
            assert_boundary(wall, k_max);
        }
        // The stated points, and the maximum 4 (3 − 2√2) at β = 2√2 − 2.
        let best = 2.0 * 2.0_f64.sqrt() - 2.0;
        for (beta, alpha) in [
            (0.1, 0.18095),
            (0.3, 0.44348),
            (0.5, 0.6),
            (1.0, 0.66667),
            (1.5, 0.42857),
            (1.9, 0.09744),
            (best, 4.0 * (3.0 - 8.0_f64.sqrt())),
        ] {
            let wall = wall(mass_kg, 0.0, beta * mass_kg / PERIOD_S, 0);
            assert!((wall.max_stiffness() * PERIOD_S * PERIOD_S / mass_kg - alpha).abs() < 6e-6, "beta {beta}");
        }
        assert_eq!(wall(mass_kg, 0.0, 0.0, 0).max_stiffness(), 0.0);
        assert_eq!(wall(mass_kg, 0.0, 2.01 * mass_kg / PERIOD_S, 0).max_stiffness(), 0.0);
    }

    #[test]
    fn without_wall_damping_and_delay_the_boundary_is_the_closed_form() {
        for delta in [1e-5, 1e-3, 0.02, 0.0999, 0.1001, 0.5, 3.0, 20.0] {
            let (m, b) = (0.1, delta * 0.1 / PERIOD_S);
            let a = f64::exp(-delta);
            // A heavily damped plant loses stability at z = −1 first, where the closed form of the oscillation does not look.
            let oscillation = b * b / m * (1.0 - a) / (1.0 - a * (1.0 + delta));
            let alternation = 2.0 * (1.0 + a) * b * b / m / (delta - 2.0 + a * (2.0 + delta));
            let closed = oscillation.min(alternation);
            let series = 2.0 * b / PERIOD_S * (1.0 + delta / 6.0);
            let expected = if delta < 1e-2 { series } else { closed };
            let relative = wall(m, b, 0.0, 0).max_stiffness() / expected - 1.0;
            assert!(relative.abs() < if delta < 1e-2 { 1e-6 } else { 1e-10 }, "delta {delta}: off by {relative}");
        }
    }

    #[test]
    fn the_boundary_holds_for_long_delays() {
        for delay_ticks in [10, 20, 60, MAX_DELAY_TICKS] {
            let wall = wall(0.1, 1.0, 0.0, delay_ticks);
            let k_max = wall.max_stiffness();
            assert!(k_max > wall.linear_rule() && k_max < 2.0 * wall.linear_rule(), "{delay_ticks}: {k_max}");
            if delay_ticks <= 20 {
                assert_boundary(wall, k_max);
            }
        }
        assert_eq!(wall(0.1, 1.0, 0.0, MAX_DELAY_TICKS + 1).max_stiffness(), 0.0);
    }

    #[test]
    fn the_filter_costs_its_delay_and_the_simulated_loop_agrees() {
        for (cutoff_hz, delay_ms, stable, passive) in [
            (f64::INFINITY, 0.0, 2003.3, 2000.0),
            (300.0, 0.179, 1479.1, 1472.7),
            (200.0, 0.398, 1121.7, 1113.8),
            (100.0, 1.144, 617.8, 608.4),
            (50.0, 2.709, 321.4, 311.6),
        ] {
            let wall = SampledWall { filter_alpha: low_pass_alpha(cutoff_hz, PERIOD_S), ..wall(0.1, 1.0, 0.0, 0) };
            assert!((filter_delay_s(cutoff_hz, PERIOD_S) * 1e3 - delay_ms).abs() < 6e-4, "{cutoff_hz} Hz");
            assert!((wall.max_stiffness() - stable).abs() < 0.06, "{cutoff_hz} Hz: {}", wall.max_stiffness());
            assert!((wall.passive_stiffness() - passive).abs() < 0.06, "{cutoff_hz} Hz: {}", wall.passive_stiffness());
            assert!((wall.linear_rule() - passive).abs() < 0.06);
            assert_boundary(wall, wall.max_stiffness());
        }
    }

    /// Damping that makes the loop passive by Colgate1997: sup over ω of (T/2)/(1−cos ωT) Re{(1−e^(−jωT)) H(e^(jωT))}.
    fn damping_needed(wall: &SampledWall, stiffness: f64) -> f64 {
        let difference = wall.wall_damping_n_s_per_m / PERIOD_S;
        (1..=20_000).map(|idx| f64::from(idx) / 20_000.0 * core::f64::consts::PI).fold(0.0_f64, |needed, angle| {
            let delay = f64::from(wall.delay_ticks);
            let alpha = wall.filter_alpha;
            // Re{(1−e^(−jθ)) (K + (B/T)(1−e^(−jθ))) e^(−jdθ) (1−α)/(1−αe^(−jθ))} with plain pairs (re, im).
            let times = |a: (f64, f64), b: (f64, f64)| (a.0 * b.0 - a.1 * b.1, a.0 * b.1 + a.1 * b.0);
            let step = (1.0 - angle.cos(), angle.sin());
            let low_pass_inverse = (1.0 - alpha * angle.cos(), alpha * angle.sin());
            let norm = low_pass_inverse.0.hypot(low_pass_inverse.1).powi(2) / (1.0 - alpha);
            let low_pass = (low_pass_inverse.0 / norm, -low_pass_inverse.1 / norm);
            let law = (stiffness + difference * step.0, difference * step.1);
            let late = ((delay * angle).cos(), -(delay * angle).sin());
            let product = times(times(step, law), times(late, low_pass));
            needed.max(0.5 * PERIOD_S / (1.0 - angle.cos()) * product.0)
        })
    }

    #[test]
    fn the_passive_stiffness_satisfies_the_frequency_condition_and_is_exact_for_a_spring() {
        for delay_ticks in [0, 1, 3, 10] {
            for filter_alpha in [0.0, 0.15, 0.5, 0.73, 0.95] {
                for wall_damping in [0.0, 0.3, -0.3, 0.9] {
                    let wall = SampledWall { filter_alpha, ..wall(0.1, 1.0, wall_damping, delay_ticks) };
                    let needed = damping_needed(&wall, wall.passive_stiffness());
                    assert!(needed <= 1.0 + 1e-6, "{wall:?}: {needed}");
                    if wall_damping == 0.0 {
                        assert!(needed > 1.0 - 1e-3, "{wall:?}: {needed}");
                    }
                    assert!(damping_needed(&wall, 1.0e-9 + 1.2 * wall.passive_stiffness()) > 1.0 || wall_damping != 0.0);
                }
            }
        }
        // The stated examples.
        let example = |wall_damping, period_s| SampledWall { period_s, ..wall(0.04, 0.8, wall_damping, 0) }.passive_stiffness();
        assert!((example(0.0, 1e-3) - 1600.0).abs() < 1e-9);
        assert!((example(0.4, 1e-3) - 800.0).abs() < 1e-9);
        assert!((example(0.0, 5e-3) - 320.0).abs() < 1e-9);
        assert_eq!(example(0.9, 1e-3), 0.0);
    }

    #[test]
    fn the_auto_limit_is_below_the_exact_boundary_everywhere() {
        let mut exact_used = 0;
        for delta in [0.0, 1e-4, 1e-3, 1e-2, 0.1, 0.5] {
            for beta in [0.0, 0.01, 0.04, 0.07, 0.10, 0.13, 0.17, 0.22, 0.3, 0.6, 1.0, 1.9, 2.5] {
                for delay_ticks in [0, 1, 2, 3, 4, 5, 7, 10, 15] {
                    for filter_alpha in [0.0, 0.2, 0.5, 0.73] {
                        let wall = SampledWall { filter_alpha, ..wall(0.1, delta * 100.0, beta * 100.0, delay_ticks) };
                        let (bound, k_max) = (wall.stiffness_bound(), wall.max_stiffness());
                        assert!(bound < k_max || bound == 0.0, "{wall:?}: bound {bound}, exact {k_max}");
                        assert!(k_max == 0.0 || bound > 0.0);
                        exact_used += u32::from(bound > 0.0 && (bound - MARGIN * k_max).abs() < 1e-9 * bound);
                    }
                }
            }
        }
        assert!(exact_used > 100, "the fall-back was never reached: {exact_used}");
        let plain = wall(0.1, 1.0, 0.0, 1);
        assert!((plain.stiffness_bound() - MARGIN * 1.0 / 1.5e-3).abs() < 1e-9);
    }

    #[test]
    fn acceptance_22_the_auto_limit_keeps_a_delayed_loop_stable_and_a_stiffer_one_diverges() {
        for delay_ticks in [1, 2, 5] {
            let wall = wall(0.1, 1.0, 0.0, delay_ticks);
            assert!(SimulatedLoop::new(wall, wall.stiffness_bound()).growth(100_000) < 1e-3);
            // The bound of the same loop without delay is what someone would set who ignores it.
            let ignorant = SampledWall { delay_ticks: 0, ..wall }.stiffness_bound();
            assert!(SimulatedLoop::new(wall, ignorant).growth(100_000) > 1e3);
        }
    }

    /// Stiffness and damping of a virtual tool stepped as v' = v + h a, x' = x + h v', with a = −(k x + b v)/m.
    fn semi_implicit_growth(mass_kg: f64, damping: f64, stiffness: f64) -> f64 {
        let (mut x, mut v) = (1e-3, 0.0);
        for _ in 0..20_000 {
            v += PERIOD_S * (-(stiffness * x + damping * v) / mass_kg);
            x += PERIOD_S * v;
            if x.abs() > 1.0 {
                break;
            }
        }
        x.abs() / 1e-3
    }

    #[test]
    fn acceptance_23_the_semi_implicit_tool_of_12_grams_is_stable_up_to_8235_newtons_per_metre() {
        let mass_kg = 0.012;
        let k_max = semi_implicit_max_stiffness_critically_damped(mass_kg, PERIOD_S);
        assert!((k_max - 8235.0).abs() < 0.5, "{k_max}");
        let critical = |stiffness: f64| 2.0 * (mass_kg * stiffness).sqrt();
        assert!(semi_implicit_growth(mass_kg, critical(0.98 * k_max), 0.98 * k_max) < 1e-3);
        assert!(semi_implicit_growth(mass_kg, critical(1.02 * k_max), 1.02 * k_max) > 1e3);
        // The closed form is the general inequality at its own damping.
        assert!((semi_implicit_max_stiffness(mass_kg, critical(k_max), PERIOD_S) / k_max - 1.0).abs() < 1e-12);
        // The general inequality: undamped, and damped for a coupling of 2000 N/m alone.
        assert!((semi_implicit_max_stiffness(mass_kg, 0.0, PERIOD_S) - 48_000.0).abs() < 1e-6);
        let damping = critical(2000.0);
        let general = semi_implicit_max_stiffness(mass_kg, damping, PERIOD_S);
        assert!((general - 28_404.0).abs() < 0.5, "{general}");
        assert!(semi_implicit_growth(mass_kg, damping, 0.98 * general) < 1e-3);
        assert!(semi_implicit_growth(mass_kg, damping, 1.02 * general) > 1e3);
        assert_eq!(semi_implicit_max_stiffness(mass_kg, 2.1 * mass_kg / PERIOD_S, PERIOD_S), 0.0);
    }

    #[test]
    fn senseless_parameters_allow_no_stiffness() {
        let sound = wall(0.1, 1.0, 0.0, 0);
        for broken in [
            SampledWall { mass_kg: 0.0, ..sound },
            SampledWall { mass_kg: f64::NAN, ..sound },
            SampledWall { damping_n_s_per_m: f64::NAN, ..sound },
            SampledWall { damping_n_s_per_m: -1.0, ..sound },
            SampledWall { period_s: 0.0, ..sound },
            SampledWall { filter_alpha: 1.0, ..sound },
            SampledWall { wall_damping_n_s_per_m: f64::INFINITY, ..sound },
        ] {
            assert_eq!((broken.max_stiffness(), broken.stiffness_bound()), (0.0, 0.0), "{broken:?}");
        }
        assert!(!sound.is_stable(0.0) && !sound.is_stable(-1.0) && !sound.is_stable(f64::NAN));
    }
}
