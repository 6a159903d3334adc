//! What takes speed from the virtual tool at a surface: braking ahead of it (acceptance test 13
//! under its number), dampers behind it.

use glam::{DQuat, DVec3};
use haptics::{CouplingMode, DriveRequest, RenderScene, State, TickInput, tick};
use vps::spatial::{DeviceSample, SampleStatus};

use super::friction::{HALF_M, MASS_KG, S, SLOPE_RAD, T, scene, slide};

/// Along the normal of the slope, m/s².
const G: f64 = 5.0;

fn up() -> DVec3 {
    DQuat::from_rotation_y(SLOPE_RAD) * DVec3::Z
}

/// A block that no hand holds, at a height over the slope, and pulled by `gravity` along its normal
/// and `along` the slope, m/s².
fn block(height_m: f64, gravity: f64, along: f64) -> RenderScene {
    let mut scene = scene(0.0);
    let p = &mut scene.parameters;
    p.mapping.start.translation = up() * (HALF_M + height_m);
    p.gravity_m_per_s2 = up() * gravity + DQuat::from_rotation_y(SLOPE_RAD) * DVec3::X * along;
    scene
}

/// Height over the slope and velocity after each tick.
fn fall(scene: &RenderScene, n_ticks: u64) -> Vec<(f64, DVec3)> {
    let mut before = scene.parameters.mapping.start.translation;
    let heights = slide(scene, n_ticks).map(|pose| {
        let velocity = (pose.translation - before) / T;
        before = pose.translation;
        (pose.translation.dot(up()) - HALF_M, velocity)
    });
    heights.collect()
}

#[test]
fn acceptance_13_approach_speed_halves_per_tick_just_ahead_of_a_surface() {
    let mode = CouplingMode::Implicit;
    // 3 mm down: 0.17 m/s, a third of a voxel per tick.
    let mut scene = block(3e-3, -G, 0.0);
    scene.parameters.coupling.mode = mode;
    let free = fall(&scene, 200);
    scene.parameters.contact.braking = true;
    let braked = fall(&scene, 400);
    let first =
        free.iter().zip(&braked).position(|(free, braked)| free != braked).expect("it brakes");
    let at_brake_m = braked[first - 1].0;
    assert!(at_brake_m > 0.0 && at_brake_m <= S, "{mode:?}: braked from {at_brake_m} m on");
    let mut n_halved = 0;
    for n in first..braked.len() {
        let before = braked[n - 1].1;
        let (height_m, now) = braked[n];
        // What touches at the end of the tick holds it as well.
        if height_m <= 0.0 {
            break;
        }
        // What falls gains g T per tick; the brake takes half of the sum.
        let before = before.dot(up()) - G * T;
        let now = now.dot(up());
        assert!((now / before - 0.5).abs() <= 0.025, "{mode:?}, tick {n}: {now} m/s of {before}");
        assert!(now < 0.0, "{mode:?}, tick {n}: turned round");
        n_halved += 1;
    }
    assert!(n_halved > 20, "{mode:?}: {n_halved} ticks");
    // Contact is reached all the same, at the speed at which gain and loss are equal.
    let lands = braked.iter().position(|(height_m, _)| *height_m <= 0.0).expect("it lands");
    let landing = braked[lands - 1].1;
    assert!((landing.dot(up()) / (-G * T) - 1.0).abs() < 0.05, "{mode:?}: lands at {landing} m/s");
    let hardest_m_per_s = free.iter().map(|(_, velocity)| -velocity.dot(up())).fold(0.0, f64::max);
    assert!(hardest_m_per_s > 20.0 * G * T);
}

/// From inside the layer: upwards, and along the slope. No bit differs from a fall without brakes.
#[test]
fn acceptance_13_what_recedes_or_passes_by_is_not_braked() {
    let mode = CouplingMode::Implicit;
    let mut scene = block(0.3 * S, G, 0.0);
    scene.parameters.coupling.mode = mode;
    let free = fall(&scene, 30);
    scene.parameters.contact.braking = true;
    assert!(fall(&scene, 30) == free, "{mode:?}: what recedes");
    assert!(free[29].0 > free[0].0 + 1e-3);

    // Near a surface no point may go faster than half a voxel per tick.
    let mut scene = block(0.3 * S, 0.0, G);
    scene.parameters.coupling.mode = mode;
    let free = fall(&scene, 40);
    scene.parameters.contact.braking = true;
    let braked = fall(&scene, 40);
    let free = free[39].1.length();
    let braked = braked[39].1.length();
    assert!(
        (braked / free - 1.0).abs() < 1e-3 && free > 0.15,
        "{mode:?}: {braked} m/s along the slope, {free} m/s without"
    );
}

#[test]
fn a_face_that_slides_on_a_floor_is_not_braked() {
    let mut scene = block(0.0, -G, 0.4);
    let speed = |scene: &RenderScene| {
        fall(scene, 300)[299].1.dot(DQuat::from_rotation_y(SLOPE_RAD) * DVec3::X)
    };
    let free = speed(&scene);
    scene.parameters.contact.braking = true;
    let braked = speed(&scene);
    assert!(
        (braked / free - 1.0).abs() < 0.01 && free > 0.1,
        "{braked} m/s, {free} m/s without brakes"
    );
}

/// Dropped from 1 mm, without any other damping: how fast it comes back, and the least force of
/// contact on the way, N.
fn bounce(mode: CouplingMode, damping_n_s_per_m: f64) -> (f64, f64) {
    let mut scene = block(1e-3, -G, 0.0);
    let p = &mut scene.parameters;
    p.coupling.mode = mode;
    (p.contact.damping_ratio, p.contact.damping_n_s_per_m) = (0.0, damping_n_s_per_m);
    p.filter.cutoff_hz = [f64::INFINITY; 2];
    let fallen = fall(&scene, 150);
    let speeds: Vec<f64> = fallen.iter().map(|(_, velocity)| velocity.dot(up())).collect();
    let force_n = |pair: &[f64]| MASS_KG * ((pair[1] - pair[0]) / T + G);
    let least_n = speeds.windows(2).map(force_n).fold(f64::INFINITY, f64::min);
    (speeds.iter().copied().fold(0.0, f64::max), least_n)
}

#[test]
fn dampers_take_energy_from_a_bounce_and_never_hold_on() {
    let mode = CouplingMode::Implicit;
    let bounces = [0.0, 2.0, 10.0, 50.0, 1000.0].map(|damping| bounce(mode, damping));
    eprintln!("{mode:?}: rebound m/s and least force N by damping: {bounces:.5?}");
    for pair in bounces.windows(2) {
        assert!(pair[1].0 < pair[0].0.max(f64::MIN_POSITIVE), "{mode:?}: {bounces:?}");
    }
    // An implicit spring may pull a little when it is left, whatever its damper does; the damper
    // adds nothing to that.
    let without_n = bounces[0].1.min(0.0);
    for (_, least_n) in bounces {
        assert!(
            least_n >= without_n - 1e-3,
            "{mode:?}: pulls with {least_n} N, {without_n} N without dampers"
        );
    }
}

/// Pressed by gravity, then lifted: the strongest damper lets go as soon as none.
#[test]
fn what_is_lifted_does_not_stick() {
    let ticks_to_leave = |damping_n_s_per_m: f64| {
        let mut scene = block(0.0, -G, 0.0);
        scene.parameters.contact.damping_n_s_per_m = damping_n_s_per_m;
        let mut state = State::new(&scene);
        let mut left = None;
        for sequence in 1..=1000 {
            if sequence == 500 {
                scene.parameters.gravity_m_per_s2 *= -1.0;
            }
            let sample =
                DeviceSample { sequence, status: SampleStatus::Fresh, ..DeviceSample::default() };
            let output = tick(
                &scene,
                &mut state,
                &TickInput { sample, request: DriveRequest::Enable, ..TickInput::default() },
            );
            assert!(!(100..500).contains(&sequence) || output.contacts > 0, "it rests");
            if sequence > 500 && output.contacts == 0 && left.is_none() {
                left = Some(sequence - 500);
            }
        }
        left.expect("it leaves")
    };
    let without = ticks_to_leave(0.0);
    for damping_n_s_per_m in [10.0, 1000.0] {
        let with = ticks_to_leave(damping_n_s_per_m);
        eprintln!("{damping_n_s_per_m} N·s/m: leaves after {with} ticks, {without} without");
        assert!(
            with <= without + 3,
            "{damping_n_s_per_m} N·s/m: leaves after {with} ticks, {without} without"
        );
    }
}
