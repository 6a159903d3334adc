//! What every arm has to do, whatever it is made of: one suite, run on every shipped profile.
//! Simulated ones are driven as they are, real ones over a link in memory against their mock arm,
//! one of its periods per tick.

mod trials;
mod wrong_signs;

use arms::{DeviceError, Pacing};
use arms_testing::HELD_M;
use arms_testing::rig::{InjectedFault, Rig, every_arm, turned_arm};
use glam::DVec3;
use vps::spatial::{Axes, DeviceSample, SampleStatus, Wrench};

/// A force that every arm can make and no dry friction holds, N.
const PUSH_N: f64 = 0.4;

/// One tick of the servo: sample, command, and the arm's period. A packet that was thrown away is a
/// stale sample.
fn tick(rig: &mut dyn Rig, wrench: Wrench) -> Result<(DeviceSample, Wrench), DeviceError> {
    let sample = match rig.device().read() {
        Err(DeviceError::Packet) => DeviceSample { corrupt_packets: 1, ..DeviceSample::default() },
        other => other?,
    };
    let made = rig.device().write(&wrench)?;
    rig.advance();
    Ok((sample, made))
}

fn ticks(rig: &mut dyn Rig, n: u32, wrench: Wrench) -> (DeviceSample, Wrench) {
    let name = rig.name();
    (0..n)
        .map(|_| tick(rig, wrench).unwrap_or_else(|error| panic!("{name}: {error:?}")))
        .last()
        .expect("a tick")
}

fn mask(axes: Axes, first: usize) -> DVec3 {
    DVec3::from_array([0, 1, 2].map(|idx| f64::from(u8::from(axes.has(first + idx)))))
}

/// A push along all axes that have a motor.
fn push(rig: &dyn Rig) -> Wrench {
    let axes = mask(rig.profile().actuated, 0);
    Wrench::new((axes * DVec3::new(1.0, 2.0, -1.5)).normalize_or_zero() * PUSH_N, DVec3::ZERO)
}

/// What the arm says that its motors make.
#[derive(Clone, Copy, Debug, Default)]
struct Answer {
    /// Of the command.
    made: Wrench,
    /// Beside it.
    beside: Wrench,
}

/// What the motors make of a command, and what the arm answers: the mean over a while behind a
/// longer one. A wrist may go back and forth by a step of its encoder for ever.
fn settled(rig: &mut dyn Rig, asked: Wrench) -> (Wrench, Answer) {
    const WHILE: u32 = 200;
    ticks(rig, 400, asked);
    let mut felt = Wrench::ZERO;
    let mut made = Wrench::ZERO;
    let mut beside = Wrench::ZERO;
    for _ in 0..WHILE {
        made = made + ticks(rig, 1, asked).1;
        beside = beside + rig.device().beside_device();
        felt = felt + rig.felt();
    }
    let share = 1.0 / f64::from(WHILE);
    (felt * share, Answer { made: made * share, beside: beside * share })
}

/// The motors make what the arm answered, as far as the grip can move: a wrench that the structure
/// takes needs no motor. What is left of the weight of the links is felt.
fn assert_felt(rig: &dyn Rig, felt: &Wrench, answer: &Answer) {
    let of_felt = rig.torques(felt);
    let of_made = rig.torques(&answer.made);
    let of_beside = rig.torques(&answer.beside);
    assert_eq!(
        of_felt.is_empty(),
        rig.profile().actuated == Axes::NONE,
        "{}: where is the grip?",
        rig.name()
    );
    let largest = of_made
        .iter()
        .chain(&of_beside)
        .fold(0.0, |largest: f64, (torque, ..)| largest.max(torque.abs()));
    for (((felt_nm, step_nm, weight_nm), (made_nm, ..)), (beside_nm, ..)) in
        of_felt.iter().zip(&of_made).zip(&of_beside)
    {
        let expected_nm = made_nm + beside_nm - weight_nm;
        // An encoder step turns the columns of the Jacobian by less than half a percent.
        assert!(
            (felt_nm - expected_nm).abs() <= step_nm + 5e-3 * largest + 1e-9,
            "{}: the motors make {felt:?}, the arm said {answer:?}: {felt_nm} for {expected_nm} N·m",
            rig.name()
        );
    }
}

#[test]
fn a_sample_is_fresh_when_a_report_came_and_is_counted_then() {
    for make in every_arm() {
        let mut rig = make(None, InjectedFault::None);
        let name = rig.name();
        let is_simulated = rig.profile().real.is_none();
        let before = rig.device().capabilities();
        let mut sequence = 0;
        let mut n_fresh = 0;
        for n in 0..200 {
            let (sample, _) = tick(&mut *rig, Wrench::ZERO).expect("there");
            let is_fresh = sample.status == SampleStatus::Fresh;
            // A simulated arm and an input that rests have something to say at once.
            if n == 0 && !is_simulated && !rig.is_rate_input() {
                assert!(
                    !is_fresh && sample.status == SampleStatus::Stale && sample.sequence == 0,
                    "{name}: {sample:?}"
                );
            }
            sequence += u64::from(is_fresh);
            n_fresh += u32::from(is_fresh);
            assert_eq!(sample.sequence, sequence, "{name}, tick {n}");
            assert_eq!(
                (sample.corrupt_packets, sample.lost_packets, sample.device_error),
                (0, 0, 0),
                "{name}, tick {n}"
            );
        }
        assert!(n_fresh >= 199, "{name}: {n_fresh}");
        rig.device().set_enabled(true);
        ticks(&mut *rig, 10, Wrench::ZERO);
        assert_eq!(rig.device().capabilities(), before, "{name}");
        assert_eq!(
            (before.sensed, before.actuated),
            (rig.profile().sensed, rig.profile().actuated),
            "{name}"
        );
    }
}

fn assert_pose(rig: &mut dyn Rig) {
    let name = rig.name();
    let sensed = rig.profile().sensed;
    let (sample, _) = ticks(rig, 1500, Wrench::ZERO);
    let truth = rig.pose();
    let plant = rig.profile().plant;
    let off_m = (sample.pose.translation - truth.translation).abs().max_element();
    assert!(
        off_m <= 1.5 * plant.encoder_step_m + 1e-6,
        "{name}: {off_m} m, {:?} {:?}",
        sample.pose,
        truth
    );
    assert!((truth.translation - DVec3::ZERO).length() > 1e-3, "{name}: it is where it was");
    assert!(sample.twist.linear.length() < 1e-3, "{name}: {:?}", sample.twist);
    if mask(sensed, 3) == DVec3::ZERO {
        assert_eq!(sample.pose.rotation, glam::DQuat::IDENTITY, "{name}");
    } else {
        let off_rad = sample.pose.rotation_to(truth).length();
        assert!(
            off_rad <= 2.0 * plant.encoder_step_rad + 1e-6,
            "{name}: {off_rad} rad, {:?} {:?}",
            sample.pose,
            truth
        );
    }
}

#[test]
fn a_resting_arm_says_where_it_is() {
    for make in every_arm() {
        let mut rig = make(Some(HELD_M), InjectedFault::None);
        if !rig.is_rate_input() {
            assert_pose(&mut *rig);
        }
    }
    assert_pose(&mut *turned_arm());
}

#[test]
fn a_push_moves_the_grip_its_way_where_there_is_a_motor() {
    for make in every_arm() {
        for (idx, axis) in DVec3::AXES.into_iter().enumerate() {
            let mut rig = make(None, InjectedFault::None);
            let name = rig.name();
            let actuated = rig.profile().actuated;
            rig.device().set_enabled(true);
            ticks(&mut *rig, 5, Wrench::ZERO);
            let rest = rig.pose().translation;
            let (_, made) = ticks(&mut *rig, 60, Wrench::new(axis * PUSH_N, DVec3::ZERO));
            let moved = rig.pose().translation - rest;
            if actuated.has(idx) {
                assert!((made.force - axis * PUSH_N).length() < 1e-9, "{name}: {made:?}");
                let along = moved.dot(axis);
                let across = moved.reject_from(axis).length();
                // Steps of the motors bend its way.
                let bend = 0.1 + rig.rounding().0 / PUSH_N;
                assert!(along > 5e-4 && across < bend * along, "{name}, {axis}: {moved}");
            } else {
                assert_eq!((made, moved), (Wrench::ZERO, DVec3::ZERO), "{name}, {axis}");
            }
        }
    }
}

#[test]
fn the_answer_is_what_the_motors_make() {
    for make in every_arm() {
        let mut rig = make(Some(HELD_M), InjectedFault::None);
        let name = rig.name();
        let actuated = rig.profile().actuated;
        let limits = rig.profile().limits;
        rig.device().set_enabled(true);
        ticks(&mut *rig, 300, Wrench::ZERO);
        let small = push(&*rig);
        let torque = DVec3::new(0.3, -0.2, 0.25) * limits.torque_nm.max(0.1);
        for asked in [small, Wrench::new(small.force, torque), Wrench::new(DVec3::ZERO, torque)] {
            let (felt, answer) = settled(&mut *rig, asked);
            assert_felt(&*rig, &felt, &answer);
            let made = answer.made;
            let wanted = asked.torque * mask(actuated, 3);
            assert!(made.torque.length() <= wanted.length() + 1e-12, "{name}: {made:?}");
            if mask(actuated, 3) == DVec3::ZERO {
                assert_eq!(made.torque, DVec3::ZERO, "{name}");
            }
        }
        let far =
            Wrench::new(small.force.normalize_or_zero() * 100.0 * limits.force_n, torque * 100.0);
        let (felt, answer) = settled(&mut *rig, far);
        assert_felt(&*rig, &felt, &answer);
        let made = answer.made;
        let force_n = made.force.length();
        let torque_nm = made.torque.length();
        assert!(
            force_n <= limits.force_n * (1.0 + 1e-9)
                && torque_nm <= limits.torque_nm * (1.0 + 1e-9),
            "{name}: {made:?}"
        );
        if actuated != Axes::NONE {
            assert!(force_n > 0.05 * limits.force_n, "{name}: {made:?}");
            assert!(
                made.force.cross(far.force).length() < 1e-9 * far.force.length() * force_n,
                "{name}: {made:?}"
            );
        }
    }
}

#[test]
fn what_is_not_a_number_and_a_stop_leave_nothing_on_the_motors() {
    for make in every_arm() {
        let mut rig = make(Some(HELD_M), InjectedFault::None);
        let name = rig.name();
        let actuated = rig.profile().actuated;
        rig.device().set_enabled(true);
        let is_pushed = |rig: &mut dyn Rig| {
            let wrench = push(rig);
            ticks(rig, 4, wrench);
            assert_eq!(rig.is_driven(), actuated != Axes::NONE, "{name}");
        };
        for odd in [f64::NAN, f64::INFINITY] {
            for wrench in
                [Wrench::new(DVec3::Y * odd, DVec3::ZERO), Wrench::new(DVec3::ZERO, DVec3::Z * odd)]
            {
                is_pushed(&mut *rig);
                rig.device().read().expect("there");
                assert_eq!(rig.device().write(&wrench), Err(DeviceError::NonFinite), "{name}");
                rig.advance();
                assert!(!rig.is_driven(), "{name}: {:?}", rig.felt());
            }
        }
        is_pushed(&mut *rig);
        for _ in 0..2 {
            rig.device().stop();
            rig.advance();
            assert!(!rig.is_driven(), "{name}: {:?}", rig.felt());
        }
        // In the middle of an exchange.
        rig.device().set_enabled(true);
        is_pushed(&mut *rig);
        rig.device().read().expect("there");
        let wrench = push(&*rig);
        rig.device().write(&wrench).expect("there");
        rig.device().stop();
        rig.advance();
        assert!(!rig.is_driven(), "{name}: {:?}", rig.felt());
        rig.device().set_enabled(true);
        is_pushed(&mut *rig);
        rig.close();
        rig.advance();
        assert!(!rig.is_driven(), "{name}: {:?} after its end", rig.felt());
    }
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn a_lost_arm_stays_lost_until_it_is_plugged_in_again() {
    for make in every_arm() {
        for cut_before_write in [false, true] {
            let mut rig = make(Some(HELD_M), InjectedFault::Cut);
            let name = rig.name();
            let actuated = rig.profile().actuated;
            let before = rig.device().capabilities();
            rig.device().set_enabled(true);
            let wrench = push(&*rig);
            let (mut sound, _) = ticks(&mut *rig, 50, wrench);
            if cut_before_write && rig.profile().real.is_some() && actuated != Axes::NONE {
                sound = rig.device().read().expect("there");
                rig.raise_fault();
                assert_eq!(rig.device().write(&wrench), Err(DeviceError::Lost), "{name}");
            } else {
                rig.raise_fault();
            }
            for _ in 0..50 {
                assert_eq!(rig.device().read(), Err(DeviceError::Lost), "{name}");
                assert_eq!(rig.device().write(&wrench), Err(DeviceError::Lost), "{name}");
                rig.device().stop();
                rig.advance();
            }
            assert_eq!(rig.device().capabilities(), before, "{name}");
            if !rig.reconnect() {
                continue;
            }
            assert!(!rig.is_driven(), "{name}: {:?} after the start", rig.felt());
            let mut last = sound;
            for n in 0..50 {
                let sample =
                    rig.device().read().unwrap_or_else(|error| panic!("{name}: {error:?}"));
                rig.advance();
                assert!(!rig.is_driven(), "{name}: {:?} before a command", rig.felt());
                assert_eq!(
                    sample.sequence,
                    last.sequence + u64::from(sample.status == SampleStatus::Fresh),
                    "{name}, tick {n}"
                );
                last = sample;
                rig.device()
                    .write(&Wrench::ZERO)
                    .unwrap_or_else(|error| panic!("{name}: {error:?}"));
                rig.advance();
            }
            assert!(last.sequence > sound.sequence + 40, "{name}: {last:?}");
            if !rig.is_rate_input() {
                assert!(
                    (last.pose.translation - rig.pose().translation).length() < 1e-3,
                    "{name}: {last:?}"
                );
            }
            rig.device().set_enabled(true);
            let (felt, answer) = settled(&mut *rig, wrench);
            assert_felt(&*rig, &felt, &answer);
            assert_eq!(rig.is_driven(), actuated != Axes::NONE, "{name}");
            assert_eq!(rig.device().capabilities(), before, "{name}");
        }
    }
}

#[test]
fn what_is_garbled_is_counted_and_got_over() {
    for make in every_arm() {
        let mut rig = make(Some(HELD_M), InjectedFault::Cropped);
        let name = rig.name();
        if rig.is_rate_input() {
            continue;
        }
        ticks(&mut *rig, 50, Wrench::ZERO);
        rig.raise_fault();
        let mut corrupt = 0;
        let mut n_fresh = 0;
        for n in 0..20 {
            let (sample, _) =
                tick(&mut *rig, Wrench::ZERO).unwrap_or_else(|error| panic!("{name}: {error:?}"));
            corrupt += u32::from(sample.corrupt_packets);
            // What was under way before is whole.
            n_fresh += u32::from(n > 0 && sample.status == SampleStatus::Fresh);
        }
        rig.clear_fault();
        let mut last = SampleStatus::Stale;
        for _ in 0..1500 {
            let (sample, _) =
                tick(&mut *rig, Wrench::ZERO).unwrap_or_else(|error| panic!("{name}: {error:?}"));
            corrupt += u32::from(sample.corrupt_packets);
            last = sample.status;
        }
        assert!(corrupt > 0 && n_fresh == 0, "{name}: {corrupt} packets, {n_fresh} fresh samples");
        assert_eq!(last, SampleStatus::Fresh, "{name}");
        let (sample, _) = ticks(&mut *rig, 5, Wrench::ZERO);
        assert!(
            (sample.pose.translation - rig.pose().translation).length() < 1e-3,
            "{name}: {sample:?}"
        );
    }
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn one_command_is_under_way_however_late_the_answer_is() {
    for make in every_arm() {
        let mut rig = make(None, InjectedFault::Late);
        let name = rig.name();
        if rig.device().capabilities().pacing != Pacing::PingPong || rig.profile().real.is_none() {
            continue;
        }
        ticks(&mut *rig, 50, Wrench::ZERO);
        rig.raise_fault();
        let before = rig.n_sent();
        let mut n_fresh = 0;
        for _ in 0..100 {
            let (sample, _) =
                tick(&mut *rig, Wrench::ZERO).unwrap_or_else(|error| panic!("{name}: {error:?}"));
            n_fresh += u32::from(sample.status == SampleStatus::Fresh);
        }
        let n_sent = rig.n_sent() - before;
        assert!(
            n_fresh >= 20 && n_sent <= n_fresh + 1,
            "{name}: {n_sent} commands, {n_fresh} answers"
        );
    }
}
