//! An arm behind a service: what a service has and a tty has not. Faults and ends of it are with
//! those of makers' libraries.

use core::time::Duration;
use std::time::Instant;

use arms::attached::open::{self, LinkNews, OpenOptions, OpenedArm};
use arms::profile::Profile;
use arms::protocol::Protocol;
use arms::transport::running_service;
use arms::{Device, DeviceError};
use glam::DVec3;
use vps::spatial::{DeviceSample, SampleStatus, Wrench};

use super::maker::{HUNG, Service};

/// Pushes for some ticks of about a millisecond; the last sample and the last answer.
fn pushed(
    arm: &mut dyn Device,
    ticks: u32,
    force: DVec3,
) -> Result<(DeviceSample, Wrench), DeviceError> {
    arm.set_enabled(true);
    let mut last = (DeviceSample::default(), Wrench::ZERO);
    for _ in 0..ticks {
        last.0 = arm.read()?;
        last.1 = arm.write(&Wrench::new(force, DVec3::ZERO))?;
        std::thread::sleep(Duration::from_millis(1));
    }
    Ok(last)
}

#[test]
fn the_force_arrives_in_both_dialects_and_the_arm_says_who_it_is() {
    for (version, dialect) in [("3.5.0", "3.5"), ("3.4.2.0", "3.4"), ("3.1.0", "3.1")] {
        let served = Service::new(version, &[]);
        let OpenedArm { mut arm, news, .. } = served.open();
        assert_eq!(
            arm.identity().as_deref(),
            Some(
                format!("Inverse service {dialect}, inverse3 049D, firmware 7.4, grip 1402")
                    .as_str()
            )
        );
        let Ok(LinkNews::Reported(notice)) = news.try_recv() else {
            panic!("the filters are not neutral, and it is not said")
        };
        assert!(notice.contains("filters.force_gate.gain is 0.3"), "{notice}");
        // Toward the operator, right and up by turns, with what unverified signs leave.
        let mut reached = DVec3::ZERO;
        for axis in DVec3::AXES {
            let before = arm.read().expect("there").pose.translation;
            let (sample, made) = pushed(&mut arm, 60, axis * 0.4).expect("there");
            assert!((made.force - axis * 0.4).length() < 1e-9, "{version}, {axis}: {made:?}");
            reached += axis * (sample.pose.translation - before).dot(axis);
        }
        assert!(reached.min_element() > 1e-4, "{version}: {reached}");
        drop(arm);
        let felt = served.arm.ended();
        assert!((felt.largest_force_n - 0.4).abs() < 1e-6, "{version}: {felt:?}");
        assert_eq!(Wrench::from(felt.last_command), Wrench::ZERO, "{version}");
    }
}

#[test]
fn other_versions_other_programs_and_nothing_at_all_are_refused_in_words() {
    let served = Service::new("2.1.1", &[]);
    let refused = served.try_open().err().expect("refused").to_string();
    assert!(refused.contains("version 2.1; this program speaks 3.1 to 3.5"), "{refused}");
    let mut profile = served.profile.clone();
    served.arm.ended();
    let error = |profile: &Profile| {
        let options = OpenOptions { selector: None, io_request: None, period_s: 1e-3, guard: None };
        open::open(profile, &options).err().expect("refused").to_string()
    };
    let absent = error(&profile);
    assert!(
        absent.contains("no service answers at 127.0.0.1:") && absent.contains("protocol.address"),
        "{absent}"
    );
    // A program that hangs up.
    let other = std::net::TcpListener::bind("127.0.0.1:0").expect("a port");
    let address = other.local_addr().expect("bound").to_string();
    if let Some(Protocol::HaplyService(service)) =
        profile.real.as_mut().map(|real| &mut real.protocol)
    {
        service.address.clone_from(&address);
    }
    std::thread::spawn(move || while other.accept().is_ok() {});
    let foreign = error(&profile);
    assert!(
        foreign.contains("does not speak as the Inverse service")
            && foreign.contains("protocol.service_version"),
        "{foreign}"
    );
    assert_eq!(running_service(&address), None);
}

#[test]
fn a_service_that_goes_is_a_lost_arm_and_is_found_again() {
    let served = Service::new("3.5.0", &["unplug@300ms+400ms"]);
    let OpenedArm { mut arm, news, .. } = served.open();
    let begin = Instant::now();
    let lost = loop {
        match pushed(&mut arm, 1, DVec3::Z * 0.3) {
            Ok(_) => assert!(begin.elapsed() < HUNG, "it never goes"),
            Err(error) => break error,
        }
    };
    assert_eq!(lost, DeviceError::Lost);
    while arm.read().is_err() {
        assert!(begin.elapsed() < HUNG, "it never comes back");
        std::thread::sleep(Duration::from_millis(1));
    }
    let (sample, _) = pushed(&mut arm, 50, DVec3::ZERO).expect("back");
    assert_eq!(sample.status, SampleStatus::Fresh);
    let reported: Vec<LinkNews> = news.try_iter().collect();
    assert!(
        reported.contains(&LinkNews::Lost)
            && reported.iter().any(|news| matches!(news, LinkNews::Back { .. })),
        "{reported:?}"
    );
    drop(arm);
    let felt = served.arm.ended();
    assert!(felt.faults[0].zero_after_ticks.is_some(), "{felt:?}");
}

#[test]
fn a_grip_that_sleeps_is_an_error_of_the_arm_and_nothing_else_stands_still() {
    let served = Service::new("3.5.0", &["sleep@500ms+300ms"]);
    let OpenedArm { mut arm, .. } = served.open();
    let begin = Instant::now();
    let mut slept = 0;
    let protocol = &served.profile.real.as_ref().expect("real").protocol;
    loop {
        assert!(begin.elapsed() < HUNG, "{slept}");
        let (sample, _) = pushed(&mut arm, 1, DVec3::ZERO).expect("there");
        if sample.device_error == 0 && slept > 0 {
            break;
        }
        if sample.device_error != 0 {
            let text = protocol.error_text(sample.device_error).expect("has words");
            assert!(text.contains("the grip sleeps"), "{text}");
            slept += u32::from(sample.status == SampleStatus::Fresh);
        }
    }
    assert!(slept > 20, "positions go on: {slept}");
    drop(arm);
    served.arm.ended();
}
