//! Parameters that change while the tool is pressed against something and slides.

use std::sync::Arc;

use engine::servo::{Control, RunPlan, SceneControls, ServoLoop, Step};
use hapticd::config::SceneConfig;
use hapticd::daemon::prepare;
use hapticd::daemon::session::objects;
use haptics::{Faults, LiveParameter, Parameters};
use recording::TickRecord;
use rt::clock::VirtualClock;

use super::rig;

/// The hand presses the block onto the plane from here on.
const PRESSED_FROM: u64 = 1300;
/// A whole range takes half a second.
const SETTLED_AT: u64 = PRESSED_FROM + 600;
const N_TICKS: u64 = 2000;
/// Most that the command may change in a tick, N: what the hand does makes a third of it. The arm
/// has no encoder steps, which would hide the rest.
const STEP_N: f64 = 0.06;

/// The block on the plane; `turn` is asked before each tick.
fn play(
    config: &SceneConfig,
    change: impl Fn(&mut Parameters),
    mut turn: impl FnMut(u64, &mut SceneControls),
) -> Vec<TickRecord> {
    let (mut prepared, _) = prepare(config, |_| ()).expect("a scene");
    change(&mut prepared.scene.parameters);
    let (mut controls, commands) = SceneControls::new(&prepared.scene.parameters, objects(config));
    let (producer, mut consumer) = rtrb::RingBuffer::new(N_TICKS as usize + 1000);
    let plan = RunPlan { stop_at_tick: Some(N_TICKS), ..RunPlan::default() };
    let control = Arc::new(Control::enabled());
    let mut servo = ServoLoop::new(
        Arc::new(prepared.scene),
        prepared.device,
        VirtualClock::default(),
        control,
        plan,
        producer,
    )
    .with_commands(commands);
    servo.warm_up();
    for tick in 0.. {
        turn(tick, &mut controls);
        if servo.step() == Step::End {
            break;
        }
    }
    assert_eq!(servo.finish().faults, Faults::NONE);
    core::iter::from_fn(|| consumer.pop().ok()).collect()
}

fn force_n(records: &[TickRecord], tick: u64) -> f64 {
    records[tick as usize].output.command_device.force.length()
}

/// The hand pushes and rubs. An arm without encoder steps, which would hide what a parameter does.
fn rubbing() -> SceneConfig {
    let friction = "damping_ratio = 0.7\nfriction = { static = 0.3, dynamic = 0.2 }";
    let mut config = rig::rewritten("block-on-plane", &[("damping_ratio = 0.7", friction)]);
    let plant = &mut config.device.profile.plant;
    (plant.encoder_step_m, plant.encoder_step_rad) = (0.0, 0.0);
    let arm = &mut config.parameters.arm;
    (arm.encoder_step_m, arm.encoder_step_rad) = (0.0, 0.0);
    config
}

#[test]
fn every_knob_turned_to_both_ends_under_pressure_makes_no_step_and_no_energy() {
    let config = rubbing();
    let untouched = play(&config, |_| (), |_, _| ());
    let mut n_knobs = 0;
    for parameter in LiveParameter::ALL {
        let Some(range) = parameter.range(&config.parameters) else { continue };
        n_knobs += 1;
        for value in [range.least, range.most] {
            let records = play(
                &config,
                |_| (),
                |tick, controls| {
                    if tick == PRESSED_FROM {
                        controls.set(parameter.name(), value).expect("in range");
                    }
                },
            );
            assert_eq!(
                records[PRESSED_FROM as usize]
                    .input
                    .parameter_change
                    .map(|change| change.parameter),
                Some(parameter)
            );
            for tick in PRESSED_FROM..SETTLED_AT {
                let step_n = (force_n(&records, tick + 1) - force_n(&records, tick)).abs();
                assert!(step_n < STEP_N, "{parameter:?} to {value}: {step_n} N in tick {tick}");
            }
            let lowest_j = records.iter().map(|record| record.output.energy_j).fold(0.0, f64::min);
            assert!(lowest_j > -1e-3, "{parameter:?} to {value}: {lowest_j} J");
        }
    }
    assert!(n_knobs >= 9, "{n_knobs}");
    assert!(force_n(&untouched, PRESSED_FROM) > 0.3);
}

#[test]
fn a_knob_leads_to_where_a_scene_with_its_value_is() {
    let config = rubbing();
    let half = 0.5 * config.parameters.coupling.stiffness_n_per_m;
    let turned = play(
        &config,
        |_| (),
        |tick, controls| {
            if tick == PRESSED_FROM {
                controls.set(LiveParameter::CouplingTranslation.name(), half).expect("in range");
            }
        },
    );
    let set = play(&config, |p| p.coupling.stiffness_n_per_m = half, |_, _| ());
    let scene = play(&config, |_| (), |_, _| ());
    let at = SETTLED_AT;
    assert!(
        (force_n(&turned, at) - force_n(&set, at)).abs() < 0.02 * force_n(&set, at),
        "{} {}",
        force_n(&turned, at),
        force_n(&set, at)
    );
    assert!(
        (force_n(&scene, at) - force_n(&set, at)).abs() > 0.05 * force_n(&set, at),
        "the change is felt"
    );
}

#[test]
fn a_value_out_of_range_is_refused_and_changes_no_bit() {
    let config = rubbing();
    let untouched = play(&config, |_| (), |_, _| ());
    let refused = play(
        &config,
        |_| (),
        |tick, controls| {
            if tick == PRESSED_FROM {
                let error = controls.set("limit_force_n", 1e6).expect_err("too much").to_string();
                assert!(error.contains("limit_force_n") && error.contains("1000000"), "{error}");
            }
        },
    );
    let outputs =
        |records: &[TickRecord]| records.iter().map(|record| record.output).collect::<Vec<_>>();
    assert!(outputs(&untouched) == outputs(&refused));
}
