//! An arm that goes deaf with its plug in, driven by the library alone: what it wakes to.
//!
//! Bounds on time are those of the campaign (`deaf/*`).

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use arms::attached::nodes::Selector;
use arms::attached::open::{LinkNews, OpenOptions, OpenedArm, open};
use arms::mock::builder::{self, MockSettings};
use arms::mock::pty::Pty;
use arms::mock::serve::{Serving, serve};
use arms::mock::{MockArm, MockReport};
use arms::simulated::hand::{GripPath, HandPath};
use arms::simulated::{HandParameters, fault};
use arms::transport::Carriage;
use arms::{Device, WiredArm, profile};
use glam::DVec3;
use vps::spatial::{Pose, SampleStatus, Wrench};

use super::link::turn;

/// A shipped arm behind a pseudo-terminal, on a thread of its own, with a fault of the grammar.
struct Behind {
    quit: Arc<AtomicBool>,
    thread: Option<JoinHandle<MockReport>>,
}

impl Behind {
    fn a_tty(name: &str, fault: &str, link: &Path) -> Self {
        let profile = profile::find(name, Path::new("")).expect(name);
        let path = GripPath::in_device_frame(HandPath::fixed(Pose::IDENTITY));
        let hand = HandParameters { path: Some(path), ..HandParameters::default() };
        let faults = vec![(fault.to_owned(), fault::parse(fault).expect("grammar"))];
        let settings =
            MockSettings { hand: Some(hand), hand_delay: Duration::ZERO, faults, seed: 1 };
        let (parameters, protocol) = builder::parameters(&profile, settings);
        let serving = Serving { period_s: parameters.period_s, ..Serving::default() };
        let mut tty = Pty::new(link).expect("a pty");
        let quit = Arc::new(AtomicBool::new(false));
        let reported = quit.clone();
        let thread = std::thread::spawn(move || {
            let mut arm =
                MockArm::new(parameters, protocol.firmware(Carriage::Stream)).expect("valid");
            serve(&mut arm, &mut tty, serving, None, || reported.load(Ordering::Relaxed))
                .expect("served");
            arm.report()
        });
        Self { quit, thread: Some(thread) }
    }

    fn report(mut self) -> MockReport {
        self.quit.store(true, Ordering::Relaxed);
        self.thread.take().expect("once").join().expect("no panic")
    }
}

/// Plays the servo with its rules for late samples: pushes while samples come and until it is sent
/// otherwise.
fn play(arm: &mut WiredArm, n: u32, mut pushes: bool) -> u32 {
    let mut stale = 0;
    let mut n_lost = 0;
    for _ in 0..n {
        match arm.read() {
            Ok(sample) => stale = if sample.status == SampleStatus::Fresh { 0 } else { stale + 1 },
            Err(_) => n_lost += 1,
        }
        // A fault is for the operator to acknowledge.
        pushes &= stale <= 20 && n_lost == 0;
        let push = Wrench::new(DVec3::new(0.2, 0.2, 0.0), DVec3::ZERO);
        let _ = arm.write(&if pushes { push } else { Wrench::ZERO });
        std::thread::sleep(Duration::from_millis(1));
    }
    n_lost
}

/// The port of an arm that fell silent is let go of with a zero, and opened again: nothing but
/// ourselves stands in the way.
#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn an_arm_that_was_deaf_reads_a_zero_and_comes_back() {
    let _turn = turn();
    let all = ["hapkit", "haply-2diy", "polhem-2022", "open6-serial", "leader-arm-6"];
    let plays = all.map(|name| {
        std::thread::spawn(move || {
            let folder = tempfile::tempdir().expect("folder");
            let link = folder.path().join("arm");
            let behind = Behind::a_tty(name, "deaf@2s+1500ms", &link);
            let profile = profile::find(name, Path::new("")).expect(name);
            let options = OpenOptions {
                selector: Some(Selector::Path(link)),
                io_request: None,
                period_s: 1e-3,
                guard: None,
            };
            let OpenedArm { mut arm, news, .. } =
                open(&profile, &options).unwrap_or_else(|error| panic!("{name}: {error}"));
            arm.set_enabled(true);
            let begin = Instant::now();
            while news.is_empty() {
                play(&mut arm, 10, true);
                assert!(begin.elapsed() < Duration::from_secs(30), "{name}: it was never lost");
            }
            assert_eq!(news.recv(), Ok(LinkNews::Lost), "{name}");
            arm.set_enabled(false);
            loop {
                play(&mut arm, 10, false);
                match news.try_recv() {
                    Ok(LinkNews::Back { .. }) => break,
                    // It is there, and does not receive.
                    Ok(LinkNews::Fails(_) | LinkNews::Reported(_) | LinkNews::Unguarded(_))
                    | Err(_) => {}
                    Ok(LinkNews::Lost) => panic!("{name}: lost once"),
                }
                assert!(begin.elapsed() < Duration::from_secs(60), "{name}: it never came back");
            }
            play(&mut arm, 300, false);
            arm.set_enabled(true);
            // A machine that is late is late again, and the arm may be lost and found once more: as
            // often as it takes.
            let mut n_fresh = 0;
            while n_fresh < 30 {
                play(&mut arm, 10, true);
                n_fresh +=
                    arm.read().map_or(0, |sample| u32::from(sample.status == SampleStatus::Fresh));
                assert!(
                    begin.elapsed() < Duration::from_secs(90),
                    "{name}: it does not speak again"
                );
            }
            let push = Wrench::new(DVec3::new(0.2, 0.2, 0.0), DVec3::ZERO);
            let host = (arm.read(), arm.write(&push), arm.write(&push));
            drop(arm);
            std::thread::sleep(Duration::from_millis(100));
            let report = behind.report();
            let felt = &report.faults[0];
            // How soon is for the campaign to say (`deaf/*`): a busy machine may be late by
            // seconds.
            let zero_after =
                felt.zero_after_ticks.unwrap_or_else(|| panic!("{name} read no zero: {felt:?}"));
            // Not with what was left of the old commands.
            let again = felt.force_again_after_ticks;
            assert!(again.is_none_or(|again| again > zero_after + 100), "{name}: {felt:?}");
            // The watchdog of some trips when this machine is late.
            let has_watchdog = profile.link.device_watchdog_ms.is_some();
            assert!(
                has_watchdog || again.is_some(),
                "{name} pushes again when it is ordered to: {felt:?} {host:?} {report:?}"
            );
            assert_eq!([report.last_command.fx_n, report.last_command.fy_n], [0.0; 2], "{name}");
        })
    });
    for play in plays {
        play.join().expect("no panic");
    }
}

/// A host that ends while the arm is deaf leaves it a zero to wake to.
#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn an_arm_that_is_deaf_when_the_host_ends_wakes_to_a_zero() {
    let _turn = turn();
    let profile = profile::find("hapkit", Path::new("")).expect("shipped");
    // A host that a busy machine holds up pushes too late: again.
    let pushed = (0..10).any(|_| {
        let folder = tempfile::tempdir().expect("folder");
        let link = folder.path().join("arm");
        let behind = Behind::a_tty("hapkit", "deaf@1s+1s", &link);
        let options = OpenOptions {
            selector: Some(Selector::Path(link)),
            io_request: None,
            period_s: 1e-3,
            guard: None,
        };
        let OpenedArm { mut arm, .. } = open(&profile, &options).expect("there");
        arm.set_enabled(true);
        let begin = Instant::now();
        // Deaf for some time, and not lost yet; the tick has seen no reason to let go.
        while begin.elapsed() < Duration::from_millis(1250) {
            let _ = arm.read();
            let _ = arm.write(&Wrench::new(DVec3::Y * 0.3, DVec3::ZERO));
            std::thread::sleep(Duration::from_millis(1));
        }
        drop(arm);
        std::thread::sleep(Duration::from_millis(1500));
        let report = behind.report();
        let felt = &report.faults[0];
        assert!(felt.zero_after_ticks.is_some(), "{felt:?}");
        assert_eq!(report.last_command.fy_n, 0.0, "{felt:?}");
        felt.force_before_n > 0.1
    });
    assert!(pushed, "the host never pushed before the arm went deaf");
}
