#![expect(clippy::float_cmp, reason = "exact zeros and exact delays are what is tested")]

use super::*;
use crate::simulated::hand::{GripPath, HandPath};
use crate::simulated::{HandParameters, fault};
use vps::spatial::Axes;

const T: f64 = 1e-3;

fn free_arm() -> SimParameters {
    let mut parameters = SimParameters::ideal(T);
    parameters.hand = None;
    parameters.plant.mass_kg = 0.3;
    parameters
}

fn arm(parameters: SimParameters) -> SimArm {
    let mut arm = SimArm::new(parameters).expect("valid parameters");
    arm.read().expect("the rest state");
    arm
}

fn x_at(offset_m: f64) -> GripPath {
    GripPath::in_device_frame(HandPath::fixed(Pose::from_translation(DVec3::new(
        offset_m, 0.0, 0.0,
    ))))
}

#[test]
fn a_free_motion_decays_as_viscous_friction_says() {
    let mut parameters = free_arm();
    parameters.plant.damping_n_s_per_m = 2.5;
    parameters.plant.damping_nm_s_per_rad = 2e-3;
    let mut arm = arm(parameters);
    arm.set_true_twist(Twist {
        linear: DVec3::new(0.1, 0.0, 0.0),
        angular: DVec3::new(0.0, 0.0, 2.0),
    });
    for n in 1..=400 {
        arm.read().expect("sample");
        let time_s = f64::from(n) * T;
        let speed = 0.1 * (-2.5 / 0.3 * time_s).exp();
        let travel = 0.1 * 0.3 / 2.5 * (1.0 - (-2.5 / 0.3 * time_s).exp());
        let spin = 2.0 * (-2e-3 / 2e-4 * time_s).exp();
        assert!((arm.true_twist().linear.x - speed).abs() < 0.01 * 0.1);
        assert!((arm.true_pose().translation.x - travel).abs() < 0.01 * travel);
        assert!((arm.true_twist().angular.z - spin).abs() < 0.01 * 2.0);
    }
}

#[test]
fn a_step_of_the_hand_rings_as_a_mass_on_a_spring_does() {
    let mut parameters = SimParameters::ideal(T);
    parameters.plant.mass_kg = 0.15;
    parameters.hand = Some(HandParameters { path: Some(x_at(0.01)), ..HandParameters::default() });
    let mut arm = arm(parameters);
    let m = 0.3;
    let b = 5.0;
    let k = 500.0;
    let decay = b / (2.0 * m);
    let ringing = f64::sqrt(k / m - decay * decay);
    for n in 1..=600 {
        arm.read().expect("sample");
        let time_s = f64::from(n) * T;
        let envelope = (-decay * time_s).exp();
        let x = 0.01
            * (1.0
                - envelope
                    * ((ringing * time_s).cos() + decay / ringing * (ringing * time_s).sin()));
        assert!((arm.true_pose().translation.x - x).abs() < 0.01 * 0.01, "{n}");
    }
}

#[test]
fn a_turn_of_the_hand_turns_the_grip() {
    let mut parameters = SimParameters::ideal(T);
    let goal = Pose::new(DQuat::from_scaled_axis(DVec3::new(0.3, -0.4, 0.2)), DVec3::ZERO);
    parameters.hand = Some(HandParameters {
        path: Some(GripPath::in_device_frame(HandPath::fixed(goal))),
        ..HandParameters::default()
    });
    let mut arm = arm(parameters);
    for _ in 0..2000 {
        arm.read().expect("sample");
    }
    assert!(arm.true_pose().rotation_to(goal).length() < 1e-6);
}

#[test]
fn static_friction_holds_to_the_last_bit_and_lets_go_above() {
    let mut parameters = free_arm();
    parameters.plant.coulomb_n = 0.2;
    parameters.plant.coulomb_nm = 0.01;
    let mut arm = arm(parameters);
    for _ in 0..1000 {
        arm.write(&Wrench::new(DVec3::new(0.1, 0.1, 0.1), DVec3::new(0.0, 0.009, 0.0)))
            .expect("written");
        arm.read().expect("sample");
    }
    assert_eq!(arm.true_pose(), Pose::IDENTITY);
    for _ in 0..100 {
        arm.write(&Wrench::new(DVec3::new(0.5, 0.0, 0.0), DVec3::ZERO)).expect("written");
        arm.read().expect("sample");
    }
    // (0.5 − 0.2) N on 0.3 kg for 0.1 s.
    assert!((arm.true_twist().linear.x - 0.1).abs() < 1e-9);
    // Left alone it comes to rest and stays there.
    for _ in 0..1000 {
        arm.write(&Wrench::ZERO).expect("written");
        arm.read().expect("sample");
    }
    let rest = arm.true_pose();
    assert_eq!(arm.true_twist().linear, DVec3::ZERO);
    for _ in 0..1000 {
        arm.write(&Wrench::ZERO).expect("written");
        arm.read().expect("sample");
    }
    assert_eq!(arm.true_pose(), rest);
}

#[test]
fn a_command_acts_after_exactly_the_delay() {
    for delay_ticks in [0, 1, 2, 7] {
        let mut parameters = free_arm();
        parameters.plant.delay_ticks = delay_ticks;
        let mut arm = arm(parameters);
        arm.write(&Wrench::new(DVec3::X, DVec3::ZERO)).expect("written");
        let mut quiet_reads = 0;
        while arm.read().is_ok() && arm.true_pose().translation.x == 0.0 {
            arm.write(&Wrench::ZERO).expect("written");
            quiet_reads += 1;
        }
        assert_eq!(quiet_reads, delay_ticks);
        // It acted for one period and no longer.
        let speed = arm.true_twist().linear.x;
        assert!((speed - T / 0.3).abs() < 1e-12);
        arm.write(&Wrench::ZERO).expect("written");
        arm.read().expect("sample");
        assert_eq!(arm.true_twist().linear.x, speed);
    }
}

#[test]
fn positions_come_in_encoder_steps() {
    let mut parameters = free_arm();
    parameters.plant.encoder_step_m = 4e-5;
    parameters.plant.encoder_step_rad = 6e-3;
    let mut arm = arm(parameters);
    arm.set_true_twist(Twist {
        linear: DVec3::new(0.0123, -0.02, 0.003),
        angular: DVec3::new(0.5, 0.1, -0.3),
    });
    for _ in 0..500 {
        let sample = arm.read().expect("sample");
        for (measured, exact, step) in [
            (sample.pose.translation, arm.true_pose().translation, 4e-5),
            (
                Pose::IDENTITY.rotation_to(sample.pose),
                Pose::IDENTITY.rotation_to(arm.true_pose()),
                6e-3,
            ),
        ] {
            let steps = measured / step;
            assert!((steps - steps.round()).length() < 1e-6);
            assert!((measured - exact).abs().max_element() <= 0.5 * step + 1e-12);
        }
    }
    // Far into a steady motion the window smooths the steps: at most one step per window.
    let sample = arm.read().expect("sample");
    assert!(
        (sample.twist.linear - arm.true_twist().linear).abs().max_element() <= 4e-5 / 0.015 + 1e-12
    );
    assert!(
        (sample.twist.angular - arm.true_twist().angular).abs().max_element() <= 2.0 * 6e-3 / 0.030
    );
}

#[test]
fn axes_without_a_motor_ignore_their_command_and_axes_without_a_joint_stay() {
    let mut parameters = free_arm();
    parameters.actuated = Axes::TRANSLATION;
    let mut arm_3 = arm(parameters.clone());
    arm_3.write(&Wrench::new(DVec3::X, DVec3::Z)).expect("written");
    assert_eq!(arm_3.command(), Wrench::new(DVec3::X, DVec3::ZERO));
    let plane = Axes::from_name("x").expect("axis").union(Axes::from_name("y").expect("axis"));
    parameters.sensed = plane;
    parameters.actuated = Axes::SIX;
    parameters.hand = Some(HandParameters {
        path: Some(GripPath::in_device_frame(HandPath::fixed(Pose::new(
            DQuat::from_rotation_x(0.5),
            DVec3::new(0.01, 0.01, 0.01),
        )))),
        ..HandParameters::default()
    });
    let mut arm_2 = arm(parameters);
    for _ in 0..100 {
        arm_2.read().expect("sample");
    }
    let pose = arm_2.true_pose();
    assert!(pose.translation.x > 0.0 && pose.translation.z == 0.0);
    assert_eq!(pose.rotation, DQuat::IDENTITY);
}

#[test]
fn the_motors_limit_the_magnitude_and_keep_the_direction() {
    let mut parameters = free_arm();
    parameters.force_limit_n = 5.0;
    parameters.torque_limit_nm = 0.1;
    let mut arm = arm(parameters);
    arm.write(&Wrench::new(DVec3::new(30.0, 40.0, 0.0), DVec3::new(0.0, 0.0, -7.0)))
        .expect("written");
    assert!((arm.command().force - DVec3::new(3.0, 4.0, 0.0)).length() < 1e-12);
    assert!((arm.command().torque - DVec3::new(0.0, 0.0, -0.1)).length() < 1e-12);
    let refused = arm.write(&Wrench::new(DVec3::new(f64::NAN, 0.0, 0.0), DVec3::ZERO));
    assert_eq!(refused, Err(DeviceError::NonFinite));
    assert_eq!(arm.command(), Wrench::ZERO);
}

#[test]
fn the_watchdog_drops_a_command_that_is_not_repeated() {
    let mut parameters = free_arm();
    parameters.watchdog_ms = Some(20);
    let mut arm = arm(parameters);
    arm.write(&Wrench::new(DVec3::X, DVec3::ZERO)).expect("written");
    for _ in 0..20 {
        arm.read().expect("sample");
    }
    let speed = arm.true_twist().linear.x;
    assert!((speed - 20.0 * T / 0.3).abs() < 1e-9);
    for _ in 0..50 {
        arm.read().expect("sample");
    }
    assert_eq!(arm.true_twist().linear.x, speed);
}

fn run(parameters: SimParameters, n: usize) -> Vec<Result<DeviceSample, DeviceError>> {
    let mut arm = SimArm::new(parameters).expect("valid");
    (0..n)
        .map(|_| {
            let sample = arm.read();
            if let Ok(sample) = sample {
                // A feedback loop, so that every bit of the sample matters.
                let _ = arm.write(&Wrench::new(
                    -200.0 * sample.pose.translation,
                    -0.5 * sample.twist.angular,
                ));
            }
            sample
        })
        .collect()
}

fn lively(fault: Option<&str>) -> SimParameters {
    let mut parameters = SimParameters::ideal(T);
    parameters.plant.mass_kg = 0.3;
    parameters.plant.encoder_step_m = 4e-5;
    parameters.plant.coulomb_n = 0.05;
    parameters.plant.delay_ticks = 1;
    parameters.hand = Some(HandParameters { path: Some(x_at(0.02)), ..HandParameters::default() });
    parameters.fault = fault.map(|text| fault::parse(text).expect("grammar"));
    parameters
}

#[test]
fn two_runs_are_bit_identical() {
    for fault in [None, Some("drop=10%"), Some("sign-flip@100ms")] {
        assert_eq!(run(lively(fault), 2000), run(lively(fault), 2000));
    }
}

#[test]
fn faults_begin_on_their_tick() {
    let at = 200; // 200 ms
    let clean = run(lively(None), 400);
    for (spec, check) in [
        (
            "nan@200ms",
            (|s, _| s.is_ok_and(|s| !s.pose.is_finite()))
                as fn(Result<DeviceSample, DeviceError>, DeviceSample) -> bool,
        ),
        ("jump@200ms", |s, clean| {
            s.is_ok_and(|s| s.pose.translation.x - clean.pose.translation.x > 0.04)
        }),
        ("unplug@200ms", |s, _| s == Err(DeviceError::Lost)),
        ("stall@200ms", |s, _| s.is_ok_and(|s| s.status == SampleStatus::Stale)),
    ] {
        let samples = run(lively(Some(spec)), 400);
        assert_eq!(samples[..at], clean[..at], "{spec}");
        assert!(check(samples[at], clean[at].expect("clean")), "{spec}: {:?}", samples[at]);
    }
    let stuck = run(lively(Some("stuck@20ms")), 40);
    assert_eq!(stuck[39].expect("sample").pose, stuck[20].expect("sample").pose);
    assert_eq!(stuck[39].expect("sample").sequence, 40);
    let flipped = run(lively(Some("sign-flip@200ms")), 400);
    assert_eq!(flipped[..at], clean[..at]);
    assert_ne!(flipped[at + 10], clean[at + 10]);
}

#[test]
fn faults_of_the_wire_and_of_the_motors_have_their_likeness_here() {
    let clean = run(lively(None), 400);
    for spec in ["garbage@200ms+3ms", "truncate@200ms+3ms", "lost-byte@200ms+3ms"] {
        let samples = run(lively(Some(spec)), 400);
        assert_eq!(samples[199], clean[199]);
        assert_eq!(samples[200..203], [Err(DeviceError::Packet); 3], "{spec}");
        assert!(samples[203].is_ok_and(|s| s.status == SampleStatus::Fresh), "{spec}");
    }
    // Four late ticks, then what was measured at the first of them.
    let slow = run(lively(Some("slow=4ms@200ms")), 400);
    assert!(slow[200..204].iter().all(|s| s.is_ok_and(|s| s.status == SampleStatus::Stale)));
    let late = slow[204].expect("late");
    let measured = clean[200].expect("clean");
    assert_eq!((late.status, late.pose), (SampleStatus::Fresh, measured.pose));
    let fresh =
        slow[200..].iter().filter(|s| s.is_ok_and(|s| s.status == SampleStatus::Fresh)).count();
    assert_eq!(fresh, 40, "one in five");
    for spec in ["repeat@200ms", "reorder@200ms"] {
        let fresh = run(lively(Some(spec)), 400)[200..]
            .iter()
            .filter(|s| s.is_ok_and(|s| s.status == SampleStatus::Fresh))
            .count();
        assert_eq!(fresh, 100, "{spec}: one in two");
    }
    // 1 N of 2 N: a quarter of the limit of 2 N acts, 0.5 N.
    let mut parameters = free_arm();
    parameters.force_limit_n = 2.0;
    parameters.fault = Some(fault::parse("saturate").expect("grammar"));
    let mut arm = arm(parameters);
    for _ in 0..100 {
        let reported = arm.write(&Wrench::new(DVec3::X, DVec3::ZERO)).expect("written");
        assert_eq!(reported.force, DVec3::X, "the arm does not say so");
        arm.read().expect("sample");
    }
    assert!((arm.true_twist().linear.x - 0.1 * 0.5 / 0.3).abs() < 1e-9);
}

#[test]
fn a_deaf_arm_speaks_and_does_not_hear() {
    let mut parameters = free_arm();
    parameters.fault = Some(fault::parse("deaf@50ms+20ms").expect("grammar"));
    let mut arm = arm(parameters);
    let push = Wrench::new(DVec3::X, DVec3::ZERO);
    for tick in 0..100 {
        assert_eq!(arm.read().expect("the link is up").status, SampleStatus::Fresh, "{tick}");
        // `arm` has read once.
        let is_deaf = (49..69).contains(&tick);
        let wrench = if is_deaf { Wrench::ZERO } else { push };
        arm.write(&wrench).expect("the link is up");
        if is_deaf {
            arm.stop();
        }
        assert_eq!(arm.command(), push, "what it is sent meanwhile is lost: {tick}");
    }
}

#[test]
fn a_fault_that_ends_leaves_a_sound_arm() {
    let clean = run(lively(None), 400);
    for spec in
        ["unplug@20ms+5ms", "stuck@20ms+5ms", "stall@20ms+5ms", "nan@20ms+5ms", "jump@20ms+5ms"]
    {
        let samples = run(lively(Some(spec)), 400);
        assert_ne!(samples[24], clean[24], "{spec}");
        let after = samples[25].expect(spec);
        assert!(after.status == SampleStatus::Fresh && after.pose.is_finite(), "{spec}");
        assert!(
            (after.pose.translation - clean[25].expect("clean").pose.translation).length() < 1e-3,
            "{spec}"
        );
    }
}

#[test]
fn samples_are_dropped_about_as_often_as_asked() {
    let stale = run(lively(Some("drop=10%")), 10_000)
        .into_iter()
        .filter(|s| s.is_ok_and(|s| s.status == SampleStatus::Stale))
        .count();
    assert!((900..1100).contains(&stale), "{stale}");
}

#[test]
fn values_that_cannot_be_simulated_are_refused_by_name() {
    let mut parameters = free_arm();
    parameters.plant.mass_kg = 0.0;
    assert!(
        SimArm::new(parameters)
            .expect_err("no mass")
            .to_string()
            .contains("mass_kg = 0 must be above zero")
    );
    let mut parameters = SimParameters::ideal(T);
    parameters.hand = Some(HandParameters { stiffness_n_per_m: 1e9, ..HandParameters::default() });
    assert!(SimArm::new(parameters).expect_err("too stiff").to_string().contains("too stiff"));
    let mut parameters = free_arm();
    parameters.plant.damping_n_s_per_m = f64::NAN;
    assert!(SimArm::new(parameters).is_err());
}
