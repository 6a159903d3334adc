//! Every shipped scene on every simulated preset of an arm, in a stiff and a loose hand, with more
//! and less delay: stable as shipped. Each scene is baked once for all of its runs.

use arms::simulated::hand::HandPath;
use document::poses;
use hapticd::config::SceneConfig;
use hapticd::daemon::prepare;

use super::rest::{self, ARMS, HANDS, MORE_DELAY, Still};
use super::rig;

/// The hand stays where it is for so long, ticks; in the second half nothing may move.
const N_HELD: usize = 600;

/// A shipped scene, and how its hand is played.
struct Played {
    scene: &'static str,
    /// Another of the shipped hands.
    hand: Option<&'static str>,
    /// Where the hand stops.
    until_s: Option<f64>,
    /// Whether it has to touch something: a stiff hand leads the nut down the thread without.
    touches: bool,
}

const fn shipped(scene: &'static str) -> Played {
    Played { scene, hand: None, until_s: None, touches: true }
}

fn preset(
    scene: &str,
    arm: &str,
    [stiffness, damping, mass_g]: [f64; 3],
    delay_ticks: u32,
) -> SceneConfig {
    let sim = format!(
        "[device.sim]\nhand_stiffness_n_per_m = {stiffness}\nhand_damping_n_s_per_m = \
            {damping}\nhand_mass_g = {mass_g}\ndelay_ticks = {delay_ticks}\n\n[realtime]"
    );
    rig::rewritten(scene, &[("sim-sigma7", arm), ("[realtime]", &sim)])
}

/// What may still move. Beside the coupling, the damper of the passivity controller sees a step of
/// the encoder too: as the velocity of one step over its window. So a joint without friction (the
/// wrists here) may go back and forth between two steps, but no further.
fn still(config: &SceneConfig) -> Still {
    let arm = &config.parameters.arm;
    let profile = &config.device.profile;
    let [window_s, window_angular_s] = profile.velocity_window_ms.map(|window_ms| window_ms * 1e-3);
    let still = Still::on(config);
    Still {
        ripple_n: still.ripple_n + arm.injected_n_s_per_m * profile.plant.encoder_step_m / window_s,
        ripple_nm: still.ripple_nm
            + arm.injected_nm_s_per_rad * profile.plant.encoder_step_rad / window_angular_s,
        ..still
    }
}

/// Plays a scene on every preset until its hand stops, and a while longer with the hand held there.
fn is_stable(played: &Played) {
    let scene = played.scene;
    let shipped = rig::load(&rig::shipped(scene));
    let hand = match played.hand {
        None => shipped.device.hand.clone().expect("a hand"),
        Some(name) => rig::folder_of_scenes().join("hands").join(name),
    };
    let mut path = poses::read(&hand).expect("a hand file");
    path.retain(|pose| played.until_s.is_none_or(|until_s| pose.time_s <= until_s));
    let held_from_s = path.last().expect("a pose").time_s;
    let path = HandPath::from_poses(&path, &hand).expect("increasing times");
    let mut baked = prepare(&shipped, |_| ()).expect("prepared").0.scene;
    let n_ticks = (held_from_s / rest::T).round() as usize + N_HELD;
    for arm in ARMS {
        for (hand_name, hand) in HANDS {
            for more_delay in MORE_DELAY {
                let config = preset(scene, arm, hand, 1 + more_delay);
                let what = format!("{scene} {arm:18} {hand_name} +{more_delay}");
                let outcome = rest::play(&mut baked, &config, &path, n_ticks, N_HELD / 2);
                eprintln!("{what}: {outcome}");
                outcome.assert_still(&what, &still(&config));
                assert!(
                    !played.touches || outcome.force_n > 0.05,
                    "{what} touched nothing: {outcome}"
                );
            }
        }
    }
}

#[test]
fn block_on_plane_is_stable_on_every_preset() {
    is_stable(&shipped("block-on-plane"));
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn block_that_is_held_on_the_plane_is_stable_on_every_preset() {
    is_stable(&Played { until_s: Some(2.4), ..shipped("block-on-plane") });
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn peg_in_hole_is_stable_on_every_preset() {
    is_stable(&shipped("peg-in-hole"));
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn gear_on_shaft_is_stable_on_every_preset() {
    is_stable(&shipped("gear-on-shaft"));
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn nut_on_bolt_is_stable_on_every_preset() {
    is_stable(&Played { touches: false, ..shipped("nut-on-bolt") });
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn nut_that_is_pressed_is_stable_on_every_preset() {
    is_stable(&Played { hand: Some("nut-press.csv"), ..shipped("nut-on-bolt") });
}
