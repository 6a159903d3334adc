//! Motors that push the wrong way, masses that are wrong: what the grip feels then of arms that
//! compensate or damp.

use core::sync::atomic::AtomicBool;
use std::path::Path;

use arms::attached::probe::{self, Push, Trial};
use arms::inspection;
use arms::profile::{self, Profile};
use arms::{Capabilities, Device, DeviceError};
use arms_testing::rig::{Rig, WiredRig};
use glam::DVec3;
use rt::clock::VirtualClock;
use vps::spatial::{Axes, DeviceSample, Wrench};

use super::{HELD_M, mask, tick};

/// What the grip may move from the sample that a command was made of until it acts.
const LATE: f64 = 1.01;
/// Speed at which the tick takes the force away, m/s.
const FAULT_M_PER_S: f64 = 1.0;
/// Stiffness of what is pressed against, N/m.
const WALL_N_PER_M: f64 = 400.0;

/// Every shipped arm whose motors make something beside the command, and one of the capstan arms
/// with the masses that its profile names.
fn arms() -> Vec<Profile> {
    let shipped = |name: &str| profile::find(name, Path::new("")).expect("shipped");
    let makes_something =
        |profile: &Profile| profile.real.as_ref().is_some_and(inspection::compensates);
    let mut arms: Vec<Profile> = profile::names().map(shipped).filter(makes_something).collect();
    let names: Vec<&str> = arms.iter().map(|profile| profile.name.as_str()).collect();
    assert_eq!(names, ["leader-arm-6", "polhem-2019", "polhem-2020", "polhem-2022"]);
    let capstan = changed("woodenhaptics-v15", |text| {
        let begin = text.find("# Gravity of the links can be held with").expect("a comment");
        let end = begin + text[begin..].find('\n').expect("a line");
        let lines = "gravity_compensation = true\nlink_mass_g = [170.0, 110.0]\nlink_along_mm = \
            [51.0, 91.0]";
        text.replace_range(begin..end, lines);
    });
    assert!(makes_something(&capstan));
    arms.push(capstan);
    arms
}

/// A shipped profile with another text.
fn changed(name: &str, change: impl FnOnce(&mut String)) -> Profile {
    let mut text = profile::text(name, Path::new("")).expect("shipped");
    change(&mut text);
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("mine.toml");
    std::fs::write(&path, text).expect("written");
    profile::load(&path).unwrap_or_else(|errors| panic!("{errors}"))
}

fn verified(profile: &Profile, is_verified: bool) -> Profile {
    let mut profile = profile.clone();
    profile.real.as_mut().expect("real").signs_verified = is_verified;
    profile
}

/// The arm with these of its motors wired the wrong way round.
fn reversed(profile: &Profile, motors: &[usize]) -> Profile {
    let mut profile = profile.clone();
    inspection::reverse_motors(profile.real.as_mut().expect("real"), motors);
    profile
}

/// None, each by itself, all.
fn choices(profile: &Profile) -> Vec<Vec<usize>> {
    let motors = inspection::motors(profile.real.as_ref().expect("real"));
    let mut choices = vec![Vec::new()];
    choices.extend(motors.iter().map(|motor| vec![*motor]));
    choices.push(motors);
    choices
}

/// Largest force, N, and torque, N·m, of the motors so far, and the largest change of either in a
/// period.
#[derive(Clone, Copy, Debug, Default)]
struct Largest {
    force_n: f64,
    torque_nm: f64,
    step_n: f64,
    step_nm: f64,
    last: Wrench,
}

impl Largest {
    fn take(&mut self, made: Wrench) {
        let step = made - self.last;
        self.force_n = self.force_n.max(made.force.length());
        self.torque_nm = self.torque_nm.max(made.torque.length());
        self.step_n = self.step_n.max(step.force.length());
        self.step_nm = self.step_nm.max(step.torque.length());
        self.last = made;
    }
}

/// What a host does with an arm.
#[derive(Clone, Copy, Debug)]
enum Deed {
    /// Force is on, and nothing is touched.
    Idle,
    /// A wall that the hand presses on; with wrong signs it pulls.
    Press,
}

fn driven(rig: &mut WiredRig, deed: Deed, n: u32) -> Largest {
    let mut largest = Largest::default();
    let stiffness_nm = 0.1 * rig.profile().limits.torque_nm / 0.01;
    // The hand comes to where it stays, to less than a micrometre a second. The start, whose
    // periods depend on the clock of the machine, is forgotten by then.
    let mut n_resting = 0;
    for n in 0.. {
        assert!(n < 20_000, "{}: the hand does not come to rest", rig.name());
        let before_m = rig.pose().translation;
        tick(rig, Wrench::ZERO).expect("there");
        n_resting =
            if (rig.pose().translation - before_m).length() < 1e-9 { n_resting + 1 } else { 0 };
        if n_resting == 100 {
            break;
        }
    }
    rig.device().set_enabled(true);
    let mut wrench = Wrench::ZERO;
    for _ in 0..n {
        let (sample, _) = tick(rig, wrench).expect("there");
        largest.take(rig.made_by_motors());
        let is_away = sample.pose.translation.length() > rig.profile().limits.workspace_radius_m;
        if is_away || sample.twist.linear.length() > FAULT_M_PER_S {
            break;
        }
        if let Deed::Press = deed {
            let turned = sample.pose.rotation.to_scaled_axis();
            wrench = Wrench::new(
                -WALL_N_PER_M * (sample.pose.translation - 0.5 * HELD_M),
                -stiffness_nm * turned,
            );
        }
    }
    largest
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn motors_of_unverified_signs_never_make_more_than_the_cap() {
    for profile in arms() {
        let name = &profile.name;
        let cap = profile.limits_now();
        assert_eq!(cap.force_n, profile::UNVERIFIED_SIGNS_FORCE_N, "{name}");
        let mut hardest_n = 0.0_f64;
        for wrong in choices(&profile) {
            for hand in [Some(HELD_M), None] {
                for deed in [Deed::Idle, Deed::Press] {
                    let mut rig = WiredRig::miswired(&profile, &reversed(&profile, &wrong), hand);
                    let made = driven(&mut rig, deed, 600);
                    assert!(
                        made.force_n <= LATE * cap.force_n,
                        "{name} {wrong:?} {deed:?} {hand:?}: {made:?}"
                    );
                    assert!(
                        made.torque_nm <= LATE * cap.torque_nm,
                        "{name} {wrong:?} {deed:?} {hand:?}: {made:?}"
                    );
                    assert!(
                        matches!(deed, Deed::Press) || made.force_n == 0.0,
                        "{name}: {made:?} beside no command"
                    );
                    hardest_n = hardest_n.max(made.force_n);
                }
            }
        }
        assert!(hardest_n > 0.3, "{name}: {hardest_n} N tries nothing");
    }
}

/// The arm with a period of its mock after each command; takes note of what the motors make.
pub(super) struct InStep {
    rig: Box<dyn Rig>,
    actuated: Axes,
    made: Largest,
}

impl InStep {
    /// `actuated`: the axes that are tried.
    pub(super) fn new(rig: Box<dyn Rig>, actuated: Axes) -> Self {
        Self { rig, actuated, made: Largest::default() }
    }
}

impl Device for InStep {
    fn capabilities(&self) -> Capabilities {
        Capabilities { actuated: self.actuated, ..Capabilities::default() }
    }

    fn read(&mut self) -> Result<DeviceSample, DeviceError> {
        self.rig.device().read()
    }

    fn write(&mut self, wrench_device: &Wrench) -> Result<Wrench, DeviceError> {
        let rendered = self.rig.device().write(wrench_device);
        self.rig.advance();
        self.made.take(self.rig.made_by_motors());
        rendered
    }

    fn set_enabled(&mut self, enabled: bool) {
        self.rig.device().set_enabled(enabled);
    }

    fn doubt_signs(&mut self, doubted: bool) {
        self.rig.device().doubt_signs(doubted);
    }

    fn stop(&mut self) {
        self.rig.device().stop();
    }
}

/// Whatever the profile says of its signs: that is what is being tried.
#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn a_sign_check_pushes_no_harder_than_it_says_whatever_is_wrong() {
    let quit = AtomicBool::new(false);
    for profile in arms() {
        let name = &profile.name;
        for is_verified in [false, true] {
            let profile = verified(&profile, is_verified);
            for wrong in choices(&profile) {
                let mut rig = WiredRig::miswired(
                    &profile,
                    &reversed(&verified(&profile, false), &wrong),
                    Some(HELD_M),
                );
                // The hand comes to where it stays.
                for _ in 0..500 {
                    tick(&mut rig, Wrench::ZERO).expect("there");
                }
                let mut arm = InStep::new(Box::new(rig), profile.actuated);
                let mut trial = Trial::new(VirtualClock::default(), 1e-3, &quit)
                    .with_torque(probe::torque_max_nm(&profile));
                let mut signs = [None; 6];
                let ended =
                    probe::check_signs(&mut arm, &mut trial, &Push::of(&profile), &mut signs);
                let made = arm.made;
                assert!(
                    made.force_n <= LATE * probe::FORCE_MAX_N,
                    "{name} {wrong:?} {is_verified}: {made:?}, {ended:?}"
                );
                assert!(
                    made.torque_nm <= LATE * probe::torque_max_nm(&profile),
                    "{name} {wrong:?} {is_verified}: {made:?}"
                );
                assert!(made.force_n > 0.1, "{name} {wrong:?}: {made:?} tries nothing");
            }
        }
    }
}

#[test]
fn motors_of_verified_signs_that_push_the_wrong_way_stay_within_the_profile() {
    for profile in arms() {
        let profile = verified(&profile, true);
        let name = &profile.name;
        let limits = profile.limits;
        for wrong in choices(&profile) {
            for (deed, hand) in
                [(Deed::Idle, Some(HELD_M)), (Deed::Idle, None), (Deed::Press, Some(HELD_M))]
            {
                // Through one wrong motor the force of a scene comes out another way, and longer by
                // what the pose makes of it: a profile that says that the signs are verified is
                // believed there. And an arm without a hand on it runs off into a singular pose
                // within one sample.
                if wrong.len() != 1 || matches!((deed, hand), (Deed::Idle, Some(_))) {
                    let mut rig = WiredRig::miswired(&profile, &reversed(&profile, &wrong), hand);
                    let made = driven(&mut rig, deed, 600);
                    assert!(
                        made.force_n <= LATE * limits.force_n,
                        "{name} {wrong:?} {deed:?} {hand:?}: {made:?}"
                    );
                }
            }
        }
    }
}

#[test]
fn a_link_ten_times_too_heavy_does_not_push_beyond_the_profile() {
    let tenfold = |name: &str, from: &str, to: &str| {
        changed(name, |text| {
            assert!(text.contains(from), "{name}: {from}");
            *text = text.replacen(from, to, 1);
        })
    };
    let masses = "[157.64, 77.33, 97.67, 112.65]";
    let heavy = [
        (tenfold("polhem-2022", masses, "[1576.4, 77.33, 97.67, 112.65]"), false),
        (tenfold("polhem-2022", masses, "[157.64, 77.33, 976.7, 112.65]"), false),
        (tenfold("polhem-2022", masses, "[157.64, 77.33, 97.67, 1126.5]"), true),
        (tenfold("leader-arm-6", "mass_g = 140.0", "mass_g = 1400.0"), true),
        (tenfold("leader-arm-6", "mass_g = 90.0", "mass_g = 900.0"), true),
    ];
    for (profile, is_doubted) in heavy {
        let profile = verified(&profile, true);
        let name = &profile.name;
        let limits = profile.limits;
        for deed in [Deed::Idle, Deed::Press] {
            let mut rig = WiredRig::miswired(&profile, &profile, Some(HELD_M));
            let made = driven(&mut rig, deed, 600);
            assert!(
                made.force_n <= LATE * limits.force_n
                    && made.torque_nm <= LATE * limits.torque_nm.max(1e-9),
                "{name}: {made:?}"
            );
        }
        let plausibility_warnings = profile.plausibility_warnings();
        let is_named =
            plausibility_warnings.iter().any(|doubt| doubt.contains("gravity compensation makes"));
        assert_eq!(is_named, is_doubted, "{name}: {plausibility_warnings:?}");
    }
}

#[test]
fn what_is_beside_the_command_comes_in_slowly_and_is_reported() {
    for profile in arms() {
        let profile = verified(&profile, true);
        let name = &profile.name;
        let limits = profile.limits;
        let mut rig = WiredRig::miswired(&profile, &profile, Some(HELD_M));
        let made = driven(&mut rig, Deed::Idle, 400);
        let expected = rig.device().beside_device();
        assert!(made.force_n > 0.05, "{name}: {made:?}");
        // In a hundred ms, and the wire rounds.
        let step_n = 0.02 * made.force_n + rig.rounding().0;
        let step_nm = 0.02 * made.torque_nm + rig.rounding().1;
        assert!(made.step_n <= step_n && made.step_nm <= step_nm, "{name}: {made:?}");
        assert!(step_n <= 0.1 * limits.force_n, "{name}: {step_n}");
        let reported = expected.force - made.last.force;
        let rounding = rig.rounding().0;
        assert!(
            reported.length() <= 0.02 * made.force_n + rounding,
            "{name}: {expected:?}, the motors make {:?}",
            made.last
        );
        // And nothing of it is left in the tick after.
        rig.device().set_enabled(false);
        tick(&mut rig, Wrench::ZERO).expect("there");
        assert!(!rig.is_driven() && rig.device().beside_device() == Wrench::ZERO, "{name}");
    }
}

/// The shipped masses are held: nothing of the weight is left on the hand, and every arm has a
/// share of its limits to spare.
#[test]
fn right_masses_are_held_in_full() {
    for profile in arms() {
        let profile = verified(&profile, true);
        let name = &profile.name;
        assert!(
            profile
                .plausibility_warnings()
                .iter()
                .all(|doubt| !doubt.contains("gravity compensation")),
            "{name}: {:?}",
            profile.plausibility_warnings()
        );
        let mut rig = WiredRig::miswired(&profile, &profile, Some(DVec3::ZERO));
        let made = driven(&mut rig, Deed::Idle, 1000);
        let left = rig.felt();
        let rounding = rig.rounding();
        assert!(
            left.force.length() <= 0.01 * made.force_n + 2.0 * rounding.0 + 0.01,
            "{name}: {left:?} of {made:?}"
        );
        let forced = mask(profile.actuated, 0);
        assert!((made.last.force * (DVec3::ONE - forced)).length() < 1e-9, "{name}");
    }
}
