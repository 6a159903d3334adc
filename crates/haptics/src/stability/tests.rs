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
        Self {
            wall,
            stiffness,
            x: 1e-3,
            v: 0.0,
            x_before: 1e-3,
            filtered: 0.0,
            underway: vec![0.0; wall.delay_ticks as usize],
        }
    }

    fn step(&mut self) {
        let SampledWall {
            mass_kg: m,
            damping_n_s_per_m: b,
            wall_damping_n_s_per_m,
            period_s: t,
            filter_alpha,
            ..
        } = self.wall;
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

    /// Envelope after a run of `n_ticks` over envelope before it, once a first such run has let the
    /// other modes die out.
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

/// The loop decays at 0.98 and grows at 1.02 of that stiffness: by its spectral radius, and in time
/// over the horizon that the spectral radius gives for a factor of 1000 (up to 7e5 ticks).
fn assert_boundary(wall: SampledWall, stiffness: f64) {
    for (factor, grows) in [(0.98, false), (1.02, true)] {
        let simulated = SimulatedLoop::new(wall, factor * stiffness);
        let rate = simulated.log_spectral_radius();
        assert_eq!(
            rate > 0.0,
            grows,
            "{wall:?} at {factor} K_max: ln of the spectral radius {rate}"
        );
        assert_eq!(wall.is_stable(factor * stiffness), !grows, "{wall:?} at {factor} K_max");
        let n_ticks = (1000.0_f64.ln() / rate.abs()).ceil() as usize;
        let growth = simulated.growth(n_ticks);
        assert!(
            if grows { growth > 10.0 } else { growth < 0.1 },
            "{wall:?} at {factor} K_max: {growth} in {n_ticks} ticks"
        );
    }
}

#[test]
fn acceptance_20_every_row_of_the_table_is_the_boundary_of_the_simulated_loop() {
    for (m, b, wall_damping, delay_ticks, k_max, decimals, linear) in TABLE {
        let wall = wall(m, b, wall_damping, delay_ticks);
        let computed = wall.max_stiffness();
        let tolerance = 0.51 * 10.0_f64.powi(-decimals);
        assert!((computed - k_max).abs() <= tolerance, "{wall:?}: {computed} instead of {k_max}");
        let rule = wall.linear_rule();
        assert!((rule - linear).abs() <= 1e-5 * linear, "{wall:?}: linear rule {rule}");
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
        let found = wall.max_stiffness();
        assert!((found / k_max - 1.0).abs() < 1e-9, "beta {beta}: {found} instead of {k_max}");
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
        let found = wall.max_stiffness() * PERIOD_S * PERIOD_S / mass_kg;
        assert!((found - alpha).abs() < 6e-6, "beta {beta}");
    }
    assert_eq!(wall(mass_kg, 0.0, 0.0, 0).max_stiffness(), 0.0);
    assert_eq!(wall(mass_kg, 0.0, 2.01 * mass_kg / PERIOD_S, 0).max_stiffness(), 0.0);
}

#[test]
fn without_wall_damping_and_delay_the_boundary_is_the_closed_form() {
    for delta in [1e-5, 1e-3, 0.02, 0.0999, 0.1001, 0.5, 3.0, 20.0] {
        let m = 0.1;
        let b = delta * 0.1 / PERIOD_S;
        let a = f64::exp(-delta);
        // A heavily damped plant loses stability at z = −1 first, where the closed form of the
        // oscillation does not look.
        let oscillation = b * b / m * (1.0 - a) / (1.0 - a * (1.0 + delta));
        let alternation = 2.0 * (1.0 + a) * b * b / m / (delta - 2.0 + a * (2.0 + delta));
        let closed = oscillation.min(alternation);
        let series = 2.0 * b / PERIOD_S * (1.0 + delta / 6.0);
        let expected = if delta < 1e-2 { series } else { closed };
        let relative = wall(m, b, 0.0, 0).max_stiffness() / expected - 1.0;
        assert!(
            relative.abs() < if delta < 1e-2 { 1e-6 } else { 1e-10 },
            "delta {delta}: off by {relative}"
        );
    }
}

#[test]
fn the_boundary_holds_for_long_delays() {
    for delay_ticks in [10, 20, 60, MAX_DELAY_TICKS] {
        let wall = wall(0.1, 1.0, 0.0, delay_ticks);
        let k_max = wall.max_stiffness();
        let rule = wall.linear_rule();
        assert!(k_max > rule && k_max < 2.0 * rule, "{delay_ticks}: {k_max}");
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
        let wall = SampledWall {
            filter_alpha: low_pass_alpha(cutoff_hz, PERIOD_S),
            ..wall(0.1, 1.0, 0.0, 0)
        };
        let delays_ms = filter_delay_s(cutoff_hz, PERIOD_S) * 1e3;
        assert!((delays_ms - delay_ms).abs() < 6e-4, "{cutoff_hz} Hz");
        for (found, expected) in [
            (wall.max_stiffness(), stable),
            (wall.passive_stiffness(), passive),
            (wall.linear_rule(), passive),
        ] {
            assert!((found - expected).abs() < 0.06, "{cutoff_hz} Hz: {found}, not {expected}");
        }
        assert_boundary(wall, wall.max_stiffness());
    }
}

/// Damping that makes the loop passive by Colgate1997: sup over ω of (T/2)/(1−cos ωT)
/// Re{(1−e^(−jωT)) H(e^(jωT))}.
fn damping_needed(wall: &SampledWall, stiffness: f64) -> f64 {
    let difference = wall.wall_damping_n_s_per_m / PERIOD_S;
    (1..=20_000).map(|idx| f64::from(idx) / 20_000.0 * core::f64::consts::PI).fold(
        0.0_f64,
        |needed, angle| {
            let delay = f64::from(wall.delay_ticks);
            let alpha = wall.filter_alpha;
            // Re{(1−e^(−jθ)) (K + (B/T)(1−e^(−jθ))) e^(−jdθ) (1−α)/(1−αe^(−jθ))} with plain pairs
            // (re, im).
            let times =
                |a: (f64, f64), b: (f64, f64)| (a.0 * b.0 - a.1 * b.1, a.0 * b.1 + a.1 * b.0);
            let step = (1.0 - angle.cos(), angle.sin());
            let low_pass_inverse = (1.0 - alpha * angle.cos(), alpha * angle.sin());
            let norm = low_pass_inverse.0.hypot(low_pass_inverse.1).powi(2) / (1.0 - alpha);
            let low_pass = (low_pass_inverse.0 / norm, -low_pass_inverse.1 / norm);
            let law = (stiffness + difference * step.0, difference * step.1);
            let late = ((delay * angle).cos(), -(delay * angle).sin());
            let product = times(times(step, law), times(late, low_pass));
            needed.max(0.5 * PERIOD_S / (1.0 - angle.cos()) * product.0)
        },
    )
}

#[test]
fn the_passive_stiffness_satisfies_the_frequency_condition_and_is_exact_for_a_spring() {
    for delay_ticks in [0, 1, 3, 10] {
        for filter_alpha in [0.0, 0.15, 0.5, 0.73, 0.95] {
            for wall_damping in [0.0, 0.3, -0.3, 0.9] {
                let wall =
                    SampledWall { filter_alpha, ..wall(0.1, 1.0, wall_damping, delay_ticks) };
                let needed = damping_needed(&wall, wall.passive_stiffness());
                assert!(needed <= 1.0 + 1e-6, "{wall:?}: {needed}");
                if wall_damping == 0.0 {
                    assert!(needed > 1.0 - 1e-3, "{wall:?}: {needed}");
                }
                assert!(
                    damping_needed(&wall, 1.0e-9 + 1.2 * wall.passive_stiffness()) > 1.0
                        || wall_damping != 0.0
                );
            }
        }
    }
    // The stated examples.
    let example = |wall_damping, period_s| {
        SampledWall { period_s, ..wall(0.04, 0.8, wall_damping, 0) }.passive_stiffness()
    };
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
                    let wall = SampledWall {
                        filter_alpha,
                        ..wall(0.1, delta * 100.0, beta * 100.0, delay_ticks)
                    };
                    let bound = wall.stiffness_bound();
                    let k_max = wall.max_stiffness();
                    assert!(
                        bound < k_max || bound == 0.0,
                        "{wall:?}: bound {bound}, exact {k_max}"
                    );
                    assert!(k_max == 0.0 || bound > 0.0);
                    exact_used +=
                        u32::from(bound > 0.0 && (bound - MARGIN * k_max).abs() < 1e-9 * bound);
                }
            }
        }
    }
    assert!(exact_used > 100, "the fall-back was never reached: {exact_used}");
    let plain = wall(0.1, 1.0, 0.0, 1);
    assert!((plain.stiffness_bound() - MARGIN * 1.0 / 1.5e-3).abs() < 1e-9);
}

#[test]
fn the_auto_limit_is_that_of_the_linear_rule_as_far_as_this_reaches() {
    // Without delay up to B T/m = 0.22: of B = 20 N·s/m it is 0.20, of 25 N·s/m 0.25.
    let within = wall(0.1, 0.1, 20.0, 0);
    let linear = (0.1 + 20.0) / 0.5e-3;
    assert!((within.stiffness_bound() / (0.8 * linear) - 1.0).abs() < 1e-12);
    assert!(within.max_stiffness() < 0.9 * linear);
    let beyond = wall(0.1, 0.1, 25.0, 0);
    assert!((beyond.stiffness_bound() / (0.8 * beyond.max_stiffness()) - 1.0).abs() < 1e-12);
}

#[test]
fn acceptance_22_the_auto_limit_keeps_a_delayed_loop_stable_and_a_stiffer_one_diverges() {
    for delay_ticks in [1, 2, 5] {
        let wall = wall(0.1, 1.0, 0.0, delay_ticks);
        assert!(SimulatedLoop::new(wall, wall.stiffness_bound()).growth(100_000) < 1e-3);
        // The bound of the same loop without delay is what a design gives that ignores it.
        let ignorant = SampledWall { delay_ticks: 0, ..wall }.stiffness_bound();
        assert!(SimulatedLoop::new(wall, ignorant).growth(100_000) > 1e3);
    }
}

/// Largest total stiffness in N/m that a semi-implicit step of the virtual tool takes with that
/// damping: k h²/m + 2 b h/m < 4.
///
/// `damping_n_s_per_m` is the damping in the step itself, not that of the arm; the stiffness is the
/// total, coupling plus contacts. 0 where the damping alone is too much for the step.
///
/// The virtual tool steps implicitly because of this bound: contact of many points exceeds it. Our
/// derivation (Jury's conditions on the two-by-two step).
fn semi_implicit_max_stiffness(mass_kg: f64, damping_n_s_per_m: f64, period_s: f64) -> f64 {
    positive_or_zero((4.0 * mass_kg / period_s - 2.0 * damping_n_s_per_m) / period_s)
}

/// The same when the damping is critical for the total stiffness, b = 2 √(m k): k < (2√2 − 2)²
/// m/h².
fn semi_implicit_max_stiffness_critically_damped(mass_kg: f64, period_s: f64) -> f64 {
    let root = 2.0 * core::f64::consts::SQRT_2 - 2.0;
    root * root * mass_kg / (period_s * period_s)
}

/// Stiffness and damping of a virtual tool stepped as v' = v + h a, x' = x + h v', with a = −(k x +
/// b v)/m.
fn semi_implicit_growth(mass_kg: f64, damping: f64, stiffness: f64) -> f64 {
    let mut x = 1e-3;
    let mut v = 0.0;
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
    assert!(
        (semi_implicit_max_stiffness(mass_kg, critical(k_max), PERIOD_S) / k_max - 1.0).abs()
            < 1e-12
    );
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

#[test]
fn what_the_tick_reads_is_what_the_rules_say() {
    let wall = wall(0.3, 1.5, 0.0, 3);
    assert!((wall.stiffness_lag() - 0.8 * 1.5).abs() < 1e-15);
    assert!((wall.stiffness_bound() - 1.2 / 3.5e-3).abs() < 1e-9);
    // Half a window of 15 ms rounded up, and the delay.
    assert_eq!(wall.velocity_age_ticks(15e-3), 11);
    let reach = (core::f64::consts::PI / 46.0).sin();
    assert!((wall.injectable_damping(15e-3) - reach * 0.3 / 1e-3).abs() < 1e-9);
}
