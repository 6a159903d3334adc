use glam::DVec3;

use super::*;

const N: usize = 15;
const MIDDLE: usize = (7 * N + 7) * N + 7;

fn material() -> Material<Quantity> {
    Material {
        mass_kg: Quantity::Constant(1e-4),
        damping_n_s_per_m: Quantity::Constant(0.5),
        stiffness_n_per_m: Quantity::Constant(100.0),
        creep_s: f64::INFINITY,
        acceleration_max_m_per_s2: f64::INFINITY,
    }
}

fn clay(material: Material<Quantity>, integrator: Integrator) -> Dynamics {
    let lattice = Lattice { origin_map: DVec3::ZERO, spacing_m: 1e-3, dims: [N; 3] };
    let mut raster = Raster::uniform(lattice, 0.0);
    for (node, value) in raster.values_m_mut().iter_mut().enumerate() {
        *value = 7e-3 - (node % N) as f32 * 1e-3;
    }
    Dynamics::new(raster, material, integrator)
}

/// Pulls with 1 N at the middle for a while; what the middle has moved by, m.
fn pulled(clay: &mut Dynamics, updates: usize, update_s: f64) -> f64 {
    let before = clay.now().values_m()[MIDDLE];
    for _ in 0..updates {
        clay.forces_n_mut().1[MIDDLE] += 1.0;
        let progress = clay.update(update_s);
        assert!(progress.speed_m_per_s.is_finite() && !progress.is_rough, "{progress:?}");
    }
    f64::from(clay.now().values_m()[MIDDLE] - before)
}

fn let_go(clay: &mut Dynamics) {
    for _ in 0..1000 {
        clay.update(4e-3);
    }
}

/// (K⁻¹)₀₀ of the lattice, by Gauss-Seidel in f64: what 1 N at the middle moves it by in the end.
fn compliance() -> f64 {
    let mut u = vec![0.0; N * N * N];
    for _ in 0..2000 {
        for x in 1..N - 1 {
            for y in 1..N - 1 {
                for z in 1..N - 1 {
                    let node = (x * N + y) * N + z;
                    let around = [1, N, N * N]
                        .into_iter()
                        .map(|stride| u[node - stride] + u[node + stride])
                        .sum::<f64>();
                    let force = if node == MIDDLE { 1.0 / 100.0 } else { 0.0 };
                    u[node] = (around + force) / 6.0;
                }
            }
        }
    }
    u[MIDDLE]
}

#[test]
fn a_force_moves_the_middle_by_what_the_springs_say() {
    let expected = compliance();
    for integrator in [Integrator::Explicit, Integrator::Implicit] {
        let moved = pulled(&mut clay(material(), integrator), 500, 4e-3);
        assert!((moved / expected - 1.0).abs() < 2e-3, "{integrator:?}: {moved} m, {expected} m");
    }
}

#[test]
fn at_rest_nothing_moves() {
    for integrator in [Integrator::Explicit, Integrator::Implicit] {
        let mut clay = clay(material(), integrator);
        let before = clay.now().clone();
        for _ in 0..10 {
            assert_eq!(clay.update(4e-3).speed_m_per_s, 0.0);
        }
        assert_eq!(clay.now(), &before);
    }
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn elastic_clay_springs_back_and_settled_clay_stays() {
    for integrator in [Integrator::Explicit, Integrator::Implicit] {
        for settles in [false, true] {
            let mut clay = clay(material(), integrator);
            let before = clay.now().clone();
            let moved = pulled(&mut clay, 100, 4e-3);
            if settles {
                clay.settle();
            }
            let_go(&mut clay);
            let left = f64::from(clay.now().values_m()[MIDDLE] - before.values_m()[MIDDLE]);
            let expected = if settles { moved } else { 0.0 };
            assert!(
                (left - expected).abs() < 0.01 * moved,
                "{integrator:?}, {settles}: {left} m of {moved} m"
            );
        }
    }
}

#[test]
fn clay_that_creeps_keeps_what_it_was_held_in() {
    let mut clay = clay(Material { creep_s: 0.05, ..material() }, Integrator::Implicit);
    let before = clay.now().values_m()[MIDDLE];
    let moved = pulled(&mut clay, 100, 4e-3);
    let_go(&mut clay);
    let left = f64::from(clay.now().values_m()[MIDDLE] - before);
    assert!(left > 0.8 * moved, "{left} m of {moved} m");
}

#[test]
fn the_implicit_step_is_stable_where_the_explicit_one_has_to_be_short() {
    let stiff = Material { stiffness_n_per_m: Quantity::Constant(1e6), ..material() };
    let mut implicit = clay(stiff.clone(), Integrator::Implicit);
    let moved = pulled(&mut implicit, 200, 1.0 / 60.0);
    assert!((moved * 1e4 / compliance() - 1.0).abs() < 0.01, "{moved}");

    let mut explicit = clay(stiff, Integrator::Explicit);
    explicit.forces_n_mut().1[MIDDLE] += 1.0;
    let progress = explicit.update(1.0 / 60.0);
    assert!(progress.time_s < 1.0 / 60.0 && progress.steps == STEPS_MAX, "{progress:?}");
    assert!(explicit.now().values_m().iter().all(|value| value.abs() < 1.0));
}

#[test]
fn explicit_steps_are_halved_where_the_acceleration_is_beyond_the_threshold() {
    let calm = clay(material(), Integrator::Explicit);
    let mut wild =
        clay(Material { acceleration_max_m_per_s2: 100.0, ..material() }, Integrator::Explicit);
    let steps = |mut clay: Dynamics| {
        clay.forces_n_mut().1[MIDDLE] += 1.0;
        clay.update(1e-3).steps
    };
    // 1 N on 0.1 g: 10⁴ m/s².
    let n_calm = steps(calm);
    wild.forces_n_mut().1[MIDDLE] += 1.0;
    let progress = wild.update(1e-3);
    assert!(progress.steps > n_calm, "{} steps against {n_calm}", progress.steps);
}

#[test]
fn steps_below_and_above_the_threshold_are_those_of_the_closed_form() {
    // A free mass point: an acceleration a of 10⁴ m/s² throughout. Steps h_i move it by a Σ h_i
    // (h_1 + … + h_i) = a (T² + Σ h_i²)/2: one step by a T², steps that halve down to T/1024, and
    // that one again, by a T² (2/3 + 4^-10/3).
    let time_s = 1e-4;
    let a = 1e4;
    for (acceleration_max_m_per_s2, steps, expected_m) in [
        (a * 1.001, 1, a * time_s * time_s),
        (a * 0.999, 11, a * time_s * time_s * (2.0 + 4.0_f64.powi(-10)) / 3.0),
    ] {
        let free = Material {
            damping_n_s_per_m: Quantity::Constant(0.0),
            stiffness_n_per_m: Quantity::Constant(1e-6),
            acceleration_max_m_per_s2,
            ..material()
        };
        let mut clay = clay(free, Integrator::Explicit);
        let before_m = f64::from(clay.now().values_m()[MIDDLE]);
        clay.forces_n_mut().1[MIDDLE] += 1.0;
        let progress = clay.update(time_s);
        assert_eq!(progress.steps, steps, "{progress:?}");
        assert!((progress.speed_m_per_s / (a * time_s) - 1.0).abs() < 1e-5, "{progress:?}");
        let moved_m = f64::from(clay.now().values_m()[MIDDLE]) - before_m;
        assert!((moved_m / expected_m - 1.0).abs() < 1e-4, "{moved_m} m instead of {expected_m}");
    }
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn painted_material_is_stiffer_where_it_was_painted() {
    let mut stiffness = Quantity::Constant(100.0);
    for x in 5..10 {
        for y in 5..10 {
            for z in 5..10 {
                stiffness.set((x * N + y) * N + z, N * N * N, 1000.0);
            }
        }
    }
    for integrator in [Integrator::Explicit, Integrator::Implicit] {
        let painted = Material { stiffness_n_per_m: stiffness.clone(), ..material() };
        let moved = pulled(&mut clay(painted, integrator), 500, 4e-3);
        assert!(moved < 0.3 * compliance(), "{integrator:?}: {moved}");
    }
}

#[test]
fn the_outermost_nodes_are_held() {
    let mut clay = clay(material(), Integrator::Implicit);
    let before = clay.now().clone();
    for _ in 0..50 {
        clay.forces_n_mut().1.fill(0.01);
        clay.update(4e-3);
    }
    for node in (0..N * N * N).filter(|node| {
        [node % N, node / N % N, node / N / N].iter().any(|n| *n == 0 || *n == N - 1)
    }) {
        assert_eq!(clay.now().values_m()[node], before.values_m()[node]);
    }
    assert_ne!(clay.now().values_m()[MIDDLE], before.values_m()[MIDDLE]);
}

#[test]
fn any_number_of_threads_gives_the_same_bits() {
    let on = |threads: usize| {
        rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap().install(|| {
            let mut clay = clay(material(), Integrator::Implicit);
            pulled(&mut clay, 20, 4e-3);
            clay.now().clone()
        })
    };
    assert_eq!(on(1), on(4));
}
