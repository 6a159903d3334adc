//! How stiff an arm may be made to feel: stability and passivity of a sampled wall, and of the
//! virtual tool's own step.
//!
//! Data in: mass, damping, period and delay of one axis. Data out: a stiffness. Start-up only (root
//! tests by the hundred); the tick never calls it. All of it is per axis; for a rotation read kg·m²
//! for kg, N·m·s/rad for N·s/m and N·m/rad for N/m.
//!
//! The model: plant m x'' + b x' = F behind a zero-order hold of period T; wall F = −K x − B Δx/T
//! with the backward difference Δx; optionally the low-pass of the shaping filter; then a delay of
//! whole ticks.
#![expect(clippy::indexing_slicing, reason = "start-up only: the tick never comes here")]

use super::filter::low_pass_alpha;

/// Longest delay that the exact test handles, ticks; a longer one counts as unstable.
pub const MAX_DELAY_TICKS: u32 = 256;

/// Safety factor of the auto-limit, below the boundary of stability.
const MARGIN: f64 = 0.8;

/// Largest B T/m for which [`MARGIN`] times the linear rule stays below the exact boundary, by
/// delay in ticks.
const LINEAR_RULE_REACH: [(f64, f64); 6] =
    [(0.0, 0.22), (1.0, 0.17), (2.0, 0.13), (3.0, 0.10), (5.0, 0.07), (10.0, 0.04)];

/// (z−1)(z−a)(z−α) z^d has the highest degree, d + 3.
const MAX_COEFFICIENTS: usize = MAX_DELAY_TICKS as usize + 4;

/// One axis of an arm with a sampled wall: everything that bounds the stiffness but the stiffness
/// itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SampledWall {
    /// Effective mass of the arm m, kg.
    pub mass_kg: f64,
    /// Physical damping of the arm b, N·s/m.
    pub damping_n_s_per_m: f64,
    /// Virtual damping of the wall B, N·s/m. Credit it only when `delay_ticks` holds the delay of
    /// the window that its velocity comes from; otherwise 0.
    pub wall_damping_n_s_per_m: f64,
    /// Hold period T, s; with jitter the worst observed one, as a late frame holds the force.
    pub period_s: f64,
    /// Delay from sampling to force beyond the hold, in ticks, rounded up.
    pub delay_ticks: u32,
    /// Pole α of a low-pass on the wall force; 0 without one. Only where the filtered force goes to
    /// the arm directly.
    pub filter_alpha: f64,
}

impl SampledWall {
    /// Linear rule of stability: K (T/2 + t_d + t_f) < b + B, here solved for K in N/m; 0 when
    /// nothing damps.
    ///
    /// Good for short delay, fast sampling and low damping; optimistic for large B
    /// ([`stiffness_bound`](Self::stiffness_bound)).
    ///
    /// # Source
    /// Gil2009; the filter term t_f = T α/(1−α) is ours.
    fn linear_rule(&self) -> f64 {
        positive_or_zero((self.damping_n_s_per_m + self.wall_damping_n_s_per_m) / self.lag_s())
    }

    /// Largest K in N/m for which the wall with the arm's damping is passive: b > K (T/2 + t_d +
    /// t_f) + |B|; 0 when none is.
    ///
    /// Exact for a pure spring, with delay or with the filter; otherwise sufficient.
    ///
    /// # Source
    /// Colgate1997 for b > KT/2 + |B|, Diolaiti2006 for the delay; the terms together, and t_f, are
    /// ours.
    #[cfg(test)]
    pub(super) fn passive_stiffness(&self) -> f64 {
        positive_or_zero(
            (self.damping_n_s_per_m - self.wall_damping_n_s_per_m.abs()) / self.lag_s(),
        )
    }

    /// True when the sampled loop decays at that stiffness: every root of the characteristic
    /// polynomial (z−1)(z−a)(z−α) z^d + (1−α)(g1 z + g0)((K + B/T) z − B/T) lies inside the unit
    /// circle.
    ///
    /// a = e^(−δ), δ = bT/m, g1 = (m/b²)(δ−1+a), g0 = (m/b²)(1−a−δa); for b = 0 their limits 1,
    /// T²/2m, T²/2m. Without the filter (α = 0) this is the polynomial with z^(d+1). False for K =
    /// 0, which leaves the mass where it is put, and for parameters that are not finite, negative
    /// or beyond [`MAX_DELAY_TICKS`].
    ///
    /// # Source
    /// Our derivation; it reproduces the normalised region of Hulin for b = 0. The roots are
    /// counted by the Schur–Cohn recursion.
    pub fn is_stable(&self, stiffness_n_per_m: f64) -> bool {
        if !(self.is_physical()
            && self.delay_ticks <= MAX_DELAY_TICKS
            && stiffness_n_per_m.is_finite())
        {
            return false;
        }
        let delta = self.damping_n_s_per_m * self.period_s / self.mass_kg;
        let pole = (-delta).exp();
        let (phi1, phi0) = hold_coefficients(delta);
        let gain = (1.0 - self.filter_alpha) * self.period_s * self.period_s / self.mass_kg;
        let difference = self.wall_damping_n_s_per_m / self.period_s;
        let proportional = stiffness_n_per_m + difference;

        let alpha = self.filter_alpha;
        let plant_and_filter =
            [-pole * alpha, pole + alpha + pole * alpha, -(1.0 + pole + alpha), 1.0];
        let wall = [
            -gain * phi0 * difference,
            gain * (phi0 * proportional - phi1 * difference),
            gain * phi1 * proportional,
        ];

        let mut coefficients = [0.0; MAX_COEFFICIENTS];
        for (entry, value) in
            coefficients.iter_mut().skip(self.delay_ticks as usize).zip(plant_and_filter)
        {
            *entry += value;
        }
        for (entry, value) in coefficients.iter_mut().zip(wall) {
            *entry += value;
        }
        all_roots_inside(&mut coefficients, self.delay_ticks as usize + 3)
    }

    /// Largest K in N/m below which the loop is stable, by bisection on
    /// [`is_stable`](Self::is_stable) to 1e-12; 0 when no stiffness is.
    ///
    /// For B = 0, d = 0 and no filter it is (b²/m)(1−a)/(1−a(1+δ)), until at large δ the root at z
    /// = −1 leaves first, at (b²/m) 2(1+a)/(δ−2+a(2+δ)); for b = 0, d = 0 it is α < 2β(2−β)/(2+β)
    /// with α = KT²/m and β = BT/m.
    ///
    /// # Source
    /// Our derivation, see [`is_stable`](Self::is_stable).
    pub fn max_stiffness(&self) -> f64 {
        // Far enough below the boundary to lie in the stable interval, far enough from K = 0 to be
        // distinguished from it.
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

    /// The stiffness that the attached arm is allowed, N/m: 0.8 of the linear rule, or 0.8 of the
    /// exact boundary where B T/m is too large for that rule. 0 for parameters that are not finite
    /// or negative.
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

    /// Stiffness times lag that the arm can take without virtual damping, 0.8 b in N·s/m:
    /// [`stiffness_bound`](Self::stiffness_bound) is this over T/2 + t_d + t_f. For the tick, which
    /// learns the delay while it runs.
    pub fn stiffness_lag(&self) -> f64 {
        MARGIN * self.damping_n_s_per_m
    }

    /// Largest damping in N·s/m that may be injected for a while, when the velocity it is made of
    /// is a difference over `window_s`: half of what keeps a free mass from ringing. A velocity n
    /// ticks old gives v ← v − (B T/m) v_n, stable for B T/m < 2 sin(π/(4n + 2)); n counts the
    /// delay and half the window, rounded up.
    ///
    /// # Source
    /// Our derivation: a root on the unit circle at z = e^(iφ) needs (n + ½) φ = π/2.
    pub fn injectable_damping(&self, window_s: f64) -> f64 {
        positive_or_zero(
            damping_reach(self.velocity_age_ticks(window_s)) * self.mass_kg / self.period_s,
        )
    }

    /// How old a velocity is that is a difference over `window_s`, when the force made of it acts:
    /// the delay and half the window, ticks, rounded up.
    pub fn velocity_age_ticks(&self, window_s: f64) -> u32 {
        self.delay_ticks.saturating_add((0.5 * window_s / self.period_s).ceil() as u32)
    }

    /// Largest B T/m for which 0.8 of the linear rule is safe; between the known delays the next
    /// longer one counts.
    fn linear_rule_reach(&self) -> f64 {
        let lag_ticks = f64::from(self.delay_ticks) + alpha_lag_s(self.filter_alpha, 1.0);
        LINEAR_RULE_REACH
            .into_iter()
            .find(|(ticks, _)| lag_ticks <= *ticks)
            .map_or(0.0, |(_, reach)| reach)
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
        let finite =
            [self.mass_kg, self.period_s, self.damping_n_s_per_m, self.wall_damping_n_s_per_m];
        positive.into_iter().all(|value| value > 0.0)
            && finite.into_iter().all(f64::is_finite)
            && self.damping_n_s_per_m >= 0.0
            && (0.0..1.0).contains(&self.filter_alpha)
    }
}

/// B T/m up to which a velocity so many ticks old damps a free mass, with a factor of two to the
/// boundary: sin(π/(4n + 2)). RT: safe.
pub(super) fn damping_reach(ticks_old: u32) -> f64 {
    (core::f64::consts::PI / (4.0 * f64::from(ticks_old) + 2.0)).sin()
}

/// Lag t_f = T α/(1−α) of the shaping filter at that cut-off, s; 0 for an infinite cut-off.
///
/// It is the filter's delay at rest: exact in the passivity condition of a spring, slightly too
/// long in the stability rule.
///
/// # Source
/// Our derivation.
pub fn filter_delay_s(cutoff_hz: f64, period_s: f64) -> f64 {
    alpha_lag_s(low_pass_alpha(cutoff_hz, period_s), period_s)
}

fn alpha_lag_s(alpha: f64, period_s: f64) -> f64 {
    period_s * alpha / (1.0 - alpha)
}

/// NaN (0/0 of a plant without damping and without lag) counts as zero: no stiffness is known to be
/// safe.
fn positive_or_zero(value: f64) -> f64 {
    value.max(0.0)
}

/// ((δ−1+e^(−δ))/δ², (1−e^(−δ)−δe^(−δ))/δ²): the two coefficients of the held plant over T²/m.
///
/// Below 0.1 both differences lose digits (all of them at δ = 0), so the series takes over: Σ
/// (−δ)^n/(n+2)! and Σ (n+1)(−δ)^n/(n+2)!.
fn hold_coefficients(delta: f64) -> (f64, f64) {
    if delta > 0.1 {
        let pole = (-delta).exp();
        return (
            (delta - 1.0 + pole) / (delta * delta),
            (1.0 - pole - delta * pole) / (delta * delta),
        );
    }
    let mut phi1 = 0.0;
    let mut phi0 = 0.0;
    let mut term = 0.5;
    for n in 0..12 {
        phi1 += term;
        phi0 += f64::from(n + 1) * term;
        term *= -delta / f64::from(n + 3);
    }
    (phi1, phi0)
}

/// Schur–Cohn: true when the polynomial Σ c_i z^i, c_degree = 1, has all its roots inside the unit
/// circle.
///
/// Each step strips one degree: c_(i−1) ← (c_i − k c_(n−i))/(1 − k²) with k = c_0; the roots are
/// inside when every |k| < 1. The coefficients are overwritten.
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
mod tests;
