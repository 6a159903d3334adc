//! Every arm under the trials of `hapticd devices probe`.

use core::sync::atomic::AtomicBool;
use core::time::Duration;

use super::wrong_signs::InStep;
use arms::attached::probe::{self, Answers, ProbeEnd, ProbePlan, ProbeResult, Push, Sign, Trial};
use arms_testing::TimedRig;
use arms_testing::rig::{InjectedFault, every_arm_as_shipped};
use rt::clock::{Clock, VirtualClock};
use vps::spatial::Axes;

/// Joints, encoder steps, whole numbers of motor current and a wire lie between what is fitted and
/// what moves.
#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn an_arm_on_a_wire_is_identified() {
    let quit = AtomicBool::new(false);
    for make in every_arm_as_shipped() {
        let rig = make(None, InjectedFault::None);
        let name = rig.name();
        let plant = rig.profile().plant;
        if !["novint-falcon", "haply-2diy", "woodenhaptics-v15", "open6-serial"]
            .contains(&name.as_str())
        {
            continue;
        }
        let mut trial =
            Trial::new(VirtualClock::default(), 1.0 / f64::from(rig.profile().link.rate_hz), &quit);
        let mut made = [None; 3];
        probe::identify(
            &mut InStep::new(rig, Axes::from_name("x").expect("an axis")),
            &mut trial,
            &mut made,
        )
        .expect("there");
        let made = made[0].expect("moved");
        let bound = made.damping_bound_n_s_per_m;
        let damping = plant.damping_n_s_per_m;
        assert!(
            bound <= 1.02 * damping && bound >= 0.6 * damping,
            "{name}: {damping} N·s/m, {made:?}"
        );
        assert!(
            (made.mass_kg / plant.mass_kg - 1.0).abs() < 0.1,
            "{name}: {} kg, {made:?}",
            plant.mass_kg
        );
    }
}

/// Waits, fits and pushes follow each other, and no watchdog of any shipped arm trips in between.
#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn every_arm_with_motors_is_tried_out_from_listening_to_shaking() {
    let quit = AtomicBool::new(false);
    let mut n_turned = 0;
    for make in every_arm_as_shipped() {
        let rig = make(None, InjectedFault::None);
        let profile = rig.profile().clone();
        if profile.actuated == Axes::NONE || profile.real.is_none() {
            continue;
        }
        let name = &profile.name;
        let mut arm = TimedRig::of(rig);
        let period_s = 1.0 / f64::from(profile.link.rate_hz);
        let mut trial =
            Trial::new(arm.clone(), period_s, &quit).with_torque(probe::torque_max_nm(&profile));
        // To shake takes long; every kind of link and of watchdog is here.
        let identify = ["leader-arm-6", "open6-serial", "woodenhaptics-v15", "hapkit"]
            .contains(&name.as_str());
        let plan = ProbePlan {
            listen: Duration::from_millis(200),
            push: Some(Push::of(&profile)),
            identify,
        };
        let mut found = ProbeResult::default();
        assert_eq!(
            probe::try_out(&mut arm, &mut trial, &plan, &mut found, |_| {}),
            Ok(()),
            "{name}: {found:?}"
        );
        found.fit(period_s);
        for axis_idx in 0..6 {
            let expected = profile.actuated.has(axis_idx).then_some(Sign::Right);
            assert_eq!(found.signs[axis_idx], expected, "{name}, axis {axis_idx}");
        }
        // No hand holds it: what the pushes sent out of reach does not move.
        assert_eq!(found.made.iter().any(Option::is_some), identify, "{name}: {found:?}");
        n_turned += u32::from(found.signs[5].is_some());
    }
    assert_eq!(
        n_turned, 8,
        "both open6 arms, the leader arm, sigma.7, lambda.7, both Premiums, the Virtuose"
    );
}

/// What a host that sleeps does to an arm whose watchdog latches: it is said, and nothing is
/// judged.
#[test]
fn an_arm_that_was_left_alone_for_too_long_is_not_said_to_stand_still() {
    let quit = AtomicBool::new(false);
    for make in every_arm_as_shipped() {
        let rig = make(None, InjectedFault::None);
        if rig.name() != "leader-arm-6" {
            continue;
        }
        let push = Push::of(rig.profile());
        let mut arm = TimedRig::of(rig);
        let mut trial = Trial::new(arm.clone(), 1e-3, &quit).with_torque(0.025);
        probe::listen(&mut arm, &mut trial, Duration::from_millis(100), &mut Answers::default())
            .expect("there");
        let now_ns = trial.clock.now_ns();
        trial.clock.sleep_until(now_ns + 60_000_000);
        let mut signs = [None; 6];
        let ended = probe::check_signs(&mut arm, &mut trial, &push, &mut signs);
        assert_eq!((ended, signs), (Err(ProbeEnd::Watchdog(61)), [None; 6]));
    }
}
