//! 3D Systems' library, whose scheduler owns the clock: what it has and the others have not. Faults
//! and ends of it are with those of the others.

use std::time::{Duration, Instant};

use arms::Device as _;
use arms::attached::open::LinkNews;
use glam::DVec3;
use vps::spatial::Wrench;

use super::link::turn;
use super::maker::{HUNG, Library, n_ticks, play};

#[test]
fn a_push_moves_the_arm_its_way() {
    let _turn = turn();
    for (profile, axes) in [("touch", 3), ("premium15-6dof", 6)] {
        let library = Library::new(profile, &[]);
        let mut opened = library.open();
        let path = opened.path.display().to_string();
        assert!(path.contains("Mock Touch, serial number mock"), "{path}");
        opened.arm.set_enabled(true);
        for axis in DVec3::AXES {
            let before = play(&mut opened, &Wrench::ZERO, n_ticks(20)).sample.expect("there").pose;
            let after = play(&mut opened, &Wrench::new(axis * 0.4, DVec3::ZERO), n_ticks(80));
            let moved = after.sample.expect("there").pose.translation - before.translation;
            assert!((after.made.force - axis * 0.4).length() < 1e-6, "{profile} {axis}: {after:?}");
            // The others coast on from before.
            assert!(moved.dot(axis) > 2e-4, "{profile} {axis}: {moved}");
        }
        if axes == 6 {
            let before =
                play(&mut opened, &Wrench::ZERO, n_ticks(20)).sample.expect("there").pose.rotation;
            let after = play(&mut opened, &Wrench::new(DVec3::ZERO, DVec3::Z * 0.01), n_ticks(80));
            let turned =
                (after.sample.expect("there").pose.rotation * before.conjugate()).to_scaled_axis();
            assert!(after.made.torque.z > 0.0 && turned.z > 1e-3, "{profile}: {after:?} {turned}");
        }
    }
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn an_arm_that_does_not_open_is_reported_why() {
    let _turn = turn();
    let locked = Library::new("touch", &[]);
    locked.goes_wrong("no-device");
    let refused = locked.try_open().err().expect("locked").to_string();
    assert!(
        refused.contains("HD error 0x0303") && refused.contains("unplug it, wait and plug it in"),
        "{refused}"
    );
    let refused = Library::over("premium15-6dof", "touch", &[])
        .try_open()
        .err()
        .expect("another arm")
        .to_string();
    assert!(refused.contains("drives 3 axes, and the profile says six"), "{refused}");
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn an_arm_that_is_not_calibrated_says_what_to_do_and_is_homed_afterwards() {
    let _turn = turn();
    let library = Library::new("touch", &[]);
    library.goes_wrong("uncalibrated");
    let mut opened = library.open();
    let mut was_unhomed = false;
    play(&mut opened, &Wrench::ZERO, |ticked| {
        let homed = ticked.sample.filter(|_| ticked.is_fresh()).map(|sample| sample.homed);
        assert!(homed != Some(true) || was_unhomed, "it began homed");
        was_unhomed |= homed == Some(false);
        homed == Some(true)
    });
    let reported = opened.news.recv_timeout(HUNG).expect("told");
    assert!(
        matches!(&reported, LinkNews::Reported(text) if text.contains("inkwell") || text.contains("calibrated")),
        "{reported:?}"
    );
}

/// Where the arm is becomes its zero: no opening does that by itself.
#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn an_encoder_is_reset_only_where_a_person_said_that_the_arm_is_held_there() {
    let _turn = turn();
    for home in [false, true] {
        let mut library = Library::new("touch", &[]);
        library.goes_wrong("encoder-reset");
        assert!(!home || library.profile.let_find_zero().is_some());
        let mut opened = library.open();
        let begin = Instant::now();
        // The tick looks at the calibration ten times a second.
        let last = play(&mut opened, &Wrench::ZERO, |ticked| {
            let is_homed = ticked.is_fresh() && ticked.sample.is_some_and(|sample| sample.homed);
            is_homed || !home && begin.elapsed() > Duration::from_millis(400)
        });
        assert_eq!(last.sample.is_some_and(|sample| sample.homed), home);
        let is_asked = |news: &LinkNews| matches!(news, LinkNews::Reported(text) if text.contains("reset position") && text.contains("--home") != home);
        assert!(
            core::iter::from_fn(|| opened.news.recv_timeout(HUNG).ok()).any(|news| is_asked(&news)),
            "{home}: not asked for"
        );
    }
}
