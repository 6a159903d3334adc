//! The stage by itself, on the mechanics of shipped arms.

use std::path::Path;

use glam::DVec3;
use proptest::prelude::*;

use super::*;
use crate::IoPlacement;
use crate::attached::open::wired_parameters;
use crate::profile::{self, Profile};
use vps::spatial::testing::Random;

const PERIOD_S: f64 = 1e-3;

/// An arm at a pose, and its stage.
struct Arm {
    parameters: WiredParameters,
    configuration: Configuration,
    joints: [f64; MAX_AXES],
    rates: [f64; MAX_AXES],
    twist: Twist,
    stage: MotorStage,
    sent: MotorCommand,
}

impl Arm {
    /// `round`: which pose around home; `None`: the arm cannot be there.
    fn at(profile: &Profile, round: u32) -> Option<Self> {
        let real = profile.real.as_ref().expect("a real arm");
        let parameters = wired_parameters(profile, real, PERIOD_S, IoPlacement::InLoop);
        let home = real.kinematics.home();
        let joints = if round == 0 { home } else { real.kinematics.around(&home, round) };
        let configuration = real.kinematics.solve(&joints, &Configuration::default())?;
        let rates = [0.0; MAX_AXES];
        let twist = Twist::ZERO;
        Some(Self {
            parameters,
            configuration,
            joints,
            rates,
            twist,
            stage: MotorStage::default(),
            sent: MotorCommand::ZERO,
        })
    }

    fn of(name: &str, is_verified: bool) -> Self {
        let mut profile = profile::find(name, Path::new("")).expect("shipped");
        profile.real.as_mut().expect("a real arm").signs_verified = is_verified;
        Self::at(&profile, 0).expect("at home")
    }

    fn tick(&mut self, force: DVec3) -> MotorWrenches {
        self.write(Wrench::new(force, DVec3::ZERO), true)
    }

    fn write(&mut self, wrench: Wrench, enabled: bool) -> MotorWrenches {
        let Self { parameters, configuration, joints, rates, twist, stage, sent } = self;
        let motion = Motion { configuration, joints, rates, twist: *twist };
        let (command, made) =
            stage.command(parameters, &motion, &wrench, enabled, sent.moves_nothing());
        stage.went_out();
        *sent = command;
        assert_eq!(command.is_enabled(), enabled && wrench.is_finite());
        made
    }

    fn settled(&mut self, force: DVec3) -> MotorWrenches {
        (0..200).map(|_| self.tick(force)).last().expect("ticks")
    }

    fn pushes(&self) -> [Wrench; MAX_AXES] {
        let WiredParameters { transmission, device_from_native, capabilities, .. } =
            &self.parameters;
        let has_motor = |idx: usize| transmission.joints[idx].motor.is_some();
        self.configuration
            .pushes(has_motor, *device_from_native, capabilities.actuated)
            .expect("finite")
    }

    /// What the motors make when these of them push the wrong way.
    fn made_with(&self, wrong: u32) -> Wrench {
        let mut torques = self.parameters.transmission.torques(self.sent.motors());
        for (_, torque) in torques.iter_mut().enumerate().filter(|(idx, _)| wrong >> idx & 1 == 1) {
            *torque = -*torque;
        }
        at_grip(&self.pushes(), &torques)
    }
}

fn real_arms() -> Vec<Profile> {
    profile::names()
        .map(|name| profile::find(name, Path::new("")).expect(name))
        .filter(|profile| profile.real.is_some())
        .collect()
}

#[test]
fn no_choice_of_wrong_signs_makes_more_than_the_cap() {
    let mut random = Random(20);
    let mut n_at_cap = 0;
    for profile in real_arms() {
        let cap = profile.limits_now();
        for round in 0..40 {
            let Some(mut arm) = Arm::at(&profile, round) else { continue };
            arm.stage.since_s = FULL_SLEW_S;
            let mut vector = || DVec3::new(random.signed(), random.signed(), random.signed());
            let wrench = Wrench::new(20.0 * vector(), vector());
            arm.twist = Twist { linear: 0.1 * vector(), angular: 0.1 * vector() };
            arm.rates = core::array::from_fn(|idx| 0.3 - 0.1 * idx as f64);
            arm.write(wrench, true);
            let made = |wrong| lengths(arm.made_with(wrong));
            let worst = (0..1 << MAX_AXES)
                .map(made)
                .fold([0.0_f64; 2], |worst, [n, nm]| [worst[0].max(n), worst[1].max(nm)]);
            let [within_n, within_nm] =
                [cap.force_n, cap.torque_nm].map(|limit| limit * (1.0 + 1e-9));
            assert!(
                worst[0] <= within_n && worst[1] <= within_nm,
                "{}, pose {round}: {worst:?}",
                profile.name
            );
            n_at_cap += u32::from(worst[0] > 0.99 * cap.force_n && cap.force_n > 0.0);
        }
    }
    assert!(n_at_cap > 300, "{n_at_cap}: nothing was pushed");
}

proptest! {
    #[test]
    fn the_worst_of_all_signs_is_found(
        parts in proptest::collection::vec(proptest::array::uniform6(-3.0..3.0f64), 0..=MAX_AXES),
        scale in -2.0..2.0f64,
    ) {
        let mut pushes = [Wrench::ZERO; MAX_AXES];
        for (push, [fx, fy, fz, tx, ty, tz]) in pushes.iter_mut().zip(parts) {
            *push = Wrench::new(DVec3::new(fx, fy, fz), DVec3::new(tx, ty, tz));
        }
        let torques = core::array::from_fn(|idx| scale * (idx as f64 - 2.0));
        let mut expected = [0.0_f64; 2];
        for wrong in 0..1_u32 << MAX_AXES {
            let turned = core::array::from_fn(|idx| if wrong >> idx & 1 == 1 { -1.0 } else { 1.0 } * torques[idx]);
            let [force_n, torque_nm] = lengths(at_grip(&pushes, &turned));
            expected = [expected[0].max(force_n), expected[1].max(torque_nm)];
        }
        let [force_n, torque_nm] = worst_of_signs(&pushes, &torques);
        prop_assert!((force_n - expected[0]).abs() < 1e-9 && (torque_nm - expected[1]).abs() < 1e-9);
    }
}

#[test]
fn what_is_no_number_and_force_that_is_off_move_nothing() {
    for name in ["polhem-2022", "leader-arm-6", "open6-serial", "haply-2diy"] {
        let mut arm = Arm::of(name, true);
        let is_driven = |arm: &mut Arm| {
            arm.settled(DVec3::new(0.3, 0.2, 0.0));
            assert!(!arm.sent.moves_nothing(), "{name}");
        };
        let rests = |arm: &Arm, made: MotorWrenches| {
            assert!(
                arm.sent.moves_nothing() && made == MotorWrenches::default(),
                "{name}: {made:?}"
            )
        };
        for odd in [f64::NAN, f64::INFINITY] {
            is_driven(&mut arm);
            let made = arm.tick(DVec3::X * odd);
            rests(&arm, made);
            is_driven(&mut arm);
            arm.twist.linear = DVec3::Y * odd;
            let made = arm.tick(DVec3::X);
            rests(&arm, made);
            arm.twist = Twist::ZERO;
            is_driven(&mut arm);
            arm.configuration.columns[0].linear.x = odd;
            let made = arm.tick(DVec3::X);
            rests(&arm, made);
            arm = Arm::of(name, true);
        }
        is_driven(&mut arm);
        let made = arm.write(Wrench::new(DVec3::X, DVec3::ZERO), false);
        rests(&arm, made);
    }
}

#[test]
fn the_sum_of_all_changes_by_a_tenth_of_the_limit_in_a_ms() {
    for name in ["polhem-2022", "leader-arm-6", "open6-serial"] {
        for is_verified in [true, false] {
            let mut arm = Arm::of(name, is_verified);
            let limit_n = if is_verified {
                arm.parameters.limits.force_n
            } else {
                arm.parameters.unverified_limits.force_n
            };
            let mut before = Wrench::ZERO;
            for n in 0..600 {
                let MotorWrenches { command, beside } =
                    arm.tick(DVec3::Y * if n / 100 % 2 == 0 { 1e3 } else { -1e3 });
                let made = command + beside;
                let step_n = (made.force - before.force).length();
                assert!(step_n <= 0.1 * limit_n * (1.0 + 1e-6), "{name}, tick {n}: {step_n} N");
                assert!(
                    made.force.length() <= limit_n * (1.0 + 1e-9),
                    "{name}, tick {n}: {made:?}"
                );
                before = made;
            }
            // A zero does not wait: nothing of the command is left, whatever it was.
            let made = arm.tick(DVec3::ZERO);
            assert_eq!(made.command, Wrench::ZERO, "{name}");
            assert!(is_verified || arm.sent.moves_nothing(), "{name}");
        }
    }
}

#[test]
fn a_command_that_was_kept_back_may_go_as_far_as_those_that_it_stands_for() {
    let mut arm = Arm::of("open6-serial", true);
    let step_n = 0.1 * arm.parameters.limits.force_n;
    let motion = Motion {
        configuration: &arm.configuration,
        joints: &arm.joints,
        rates: &arm.rates,
        twist: Twist::ZERO,
    };
    let wrench = Wrench::new(DVec3::X * 100.0, DVec3::ZERO);
    let mut of = |n: u32| {
        let made = (0..n)
            .map(|_| arm.stage.command(&arm.parameters, &motion, &wrench, true, true).1)
            .last()
            .expect("ticks");
        arm.stage.since_s = 0.0;
        made.command.force.x / step_n
    };
    for (n_kept, steps) in [(1, 1.0), (3, 3.0), (10, 10.0), (40, 10.0)] {
        assert!((of(n_kept) - steps).abs() < 1e-6, "{n_kept}");
    }
}

#[test]
fn the_power_of_the_motors_has_one_ceiling_for_every_source() {
    let mut arm = Arm::of("polhem-2022", true);
    let still = arm.settled(DVec3::Y * 3.0);
    assert!((still.command.force.y - 3.0).abs() < 1e-9, "{still:?}");
    arm.twist.linear = DVec3::new(0.0, 3.0, 3.0);
    let MotorWrenches { command, beside } = arm.settled(DVec3::Y * 3.0);
    let power_w = (command + beside).power(arm.twist);
    assert!((power_w - POWER_MAX_W).abs() < 1e-9, "{power_w} W");
    // What takes energy is not held back.
    arm.twist = Twist { linear: DVec3::Y * -5.0, angular: DVec3::ZERO };
    assert!((arm.settled(DVec3::Y * 3.0).command.force.y - 3.0).abs() < 1e-9);
    // Rates of joints say it too, where the grip seems to stand.
    let mut arm = Arm::of("leader-arm-6", true);
    arm.settled(DVec3::Y);
    let torques = arm.parameters.transmission.torques(arm.sent.motors());
    arm.rates = torques.map(|torque| 1e3 * torque);
    arm.settled(DVec3::Y);
    let torques = arm.parameters.transmission.torques(arm.sent.motors());
    let power_w: f64 = torques.iter().zip(arm.rates).map(|(torque, rate)| torque * rate).sum();
    assert!(power_w <= POWER_MAX_W * (1.0 + 1e-9), "{power_w} W");
}

#[test]
fn compensation_waits_for_verified_signs_rises_and_goes_at_once() {
    let mut arm = Arm::of("polhem-2022", false);
    assert_eq!(arm.settled(DVec3::ZERO).beside, Wrench::ZERO);
    let mut arm = Arm::of("polhem-2022", true);
    let rise: Vec<f64> = (0..150).map(|_| arm.tick(DVec3::ZERO).beside.force.length()).collect();
    assert!(
        (rise[49] / rise[149] - 0.5).abs() < 1e-9 && (rise[99] - rise[149]).abs() < 1e-12,
        "{rise:?}"
    );
    assert!((rise[149] - 1.149).abs() < 1e-3, "{} N hold the links at home", rise[149]);
    assert_eq!(arm.write(Wrench::ZERO, false), MotorWrenches::default());
    assert!(arm.sent.moves_nothing());
    // The next enable begins from nothing again.
    arm.stage.begin();
    assert!(arm.tick(DVec3::ZERO).beside.force.length() < 0.02);
    arm.stage.doubt_signs(true);
    assert_eq!(arm.settled(DVec3::ZERO).beside, Wrench::ZERO);
    arm.stage.doubt_signs(false);
    assert!((arm.settled(DVec3::ZERO).beside.force.length() - rise[149]).abs() < 1e-9);
}

#[test]
fn damping_of_joints_is_held_to_its_share() {
    let mut arm = Arm::of("leader-arm-6", true);
    let limit_n = arm.parameters.limits.force_n;
    arm.rates = [20.0, -20.0, 20.0, -20.0, 20.0, -20.0, 0.0, 0.0];
    let made = arm.settled(DVec3::ZERO);
    assert!(made.beside.force.length() <= BESIDE_SHARE * limit_n * (1.0 + 1e-9), "{made:?}");
    for wrong in 0..1 << 6 {
        let force_n = arm.made_with(wrong).force.length();
        assert!(force_n <= limit_n * (1.0 + 1e-9), "{force_n} N with wrong motors {wrong:#b}");
    }
}
