//! Arms that go away and come back, over pseudo-terminals.

use core::time::Duration;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Instant;

use glam::DVec3;

use super::*;
use crate::device::Device;
use crate::device::mock::profiled::{self, MockSettings};
use crate::device::mock::pty::Pty;
use crate::device::mock::serve::{Serving, serve};
use crate::device::mock::{MockArm, MockReport};
use crate::device::profile;
use crate::device::simulated::HandParameters;
use crate::device::simulated::fault;
use crate::device::simulated::hand::{GripPath, HandPath};
use crate::spatial::{Pose, SampleStatus, Wrench};

fn board(path: &str, serial: &str) -> Node {
    Node { vendor_id: 0x16c0, product_id: 0x0483, serial: serial.to_owned(), ..Node::at(Path::new(path)) }
}

#[test]
fn a_board_that_comes_back_under_another_name_is_known_by_what_it_is() {
    let first = board("/dev/ttyACM0", "77");
    let find = |attached: &[Node]| again(&first, Path::new("/dev/ttyACM0"), attached).map(|node| node.path);
    assert_eq!(find(&[]), None);
    assert_eq!(find(std::slice::from_ref(&first)), Some("/dev/ttyACM0".into()));
    assert_eq!(find(&[board("/dev/ttyACM1", "77")]), Some("/dev/ttyACM1".into()));
    // Another device has its name now.
    assert_eq!(find(&[board("/dev/ttyACM0", "78")]), None);
    assert_eq!(find(&[board("/dev/ttyACM0", "78"), board("/dev/ttyACM1", "77")]), Some("/dev/ttyACM1".into()));
    assert_eq!(find(&[Node { product_id: 0x0486, ..first.clone() }]), None);
}

#[test]
fn of_several_ports_of_one_device_the_one_of_the_same_name_is_taken() {
    let port = |path: &str, name: &str| Node { by_id: Some(name.into()), ..board(path, "77") };
    let first = port("/dev/ttyUSB0", "FT_77-port0");
    let moved = [port("/dev/ttyUSB4", "FT_77-port0"), port("/dev/ttyUSB5", "FT_77-port1")];
    let find = |first: &Node, attached: &[Node]| again(first, Path::new("/dev/ttyUSB0"), attached).map(|node| node.path);
    assert_eq!(find(&first, &moved), Some("/dev/ttyUSB4".into()));
    let swapped = [port("/dev/ttyUSB0", "FT_77-port1"), port("/dev/ttyUSB1", "FT_77-port0")];
    assert_eq!(find(&first, &swapped), Some("/dev/ttyUSB1".into()), "its path belongs to the other port now");
    assert_eq!(find(&Node { by_id: None, ..first.clone() }, &moved), None, "which of the two?");
    // A pseudo-terminal says nothing of itself: its path is all there is.
    assert_eq!(find(&Node::at(Path::new("/dev/pts/4")), &moved), Some("/dev/ttyUSB0".into()));
}

#[test]
fn a_port_that_is_held_says_by_whom() {
    let (far, near) = serialport::TTYPort::pair().expect("a pty");
    let path = PathBuf::from(serialport::SerialPort::name(&near).expect("has one"));
    let file = std::fs::File::open(&path).expect("a tty");
    drop(near);
    // A program of its own with the node open, which keeps the lock that it inherits.
    let lock = SerialLink::open(&path, 115_200).expect("free");
    let mut other =
        std::process::Command::new("sleep").arg("60").stdin(std::process::Stdio::from(file)).spawn().expect("a program");
    let busy = SerialLink::open(&path, 115_200).map(|_| ()).expect_err("held");
    let text = held(&path, busy.into()).to_string();
    let pid = other.id();
    other.kill().and_then(|()| other.wait()).expect("ours");
    assert!(text.contains(&format!("sleep (process {pid})")) && text.contains(&*path.to_string_lossy()), "{text}");
    // No other process: the words of the port.
    let busy = SerialLink::open(&path, 115_200).map(|_| ()).expect_err("held by ourselves");
    assert!(held(&path, busy.into()).to_string().contains("cannot open"));
    drop((lock, far));
}

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
        let settings = MockSettings { hand: Some(hand), hand_delay: Duration::ZERO, faults, seed: 1 };
        let (parameters, protocol) = profiled::parameters(&profile, settings);
        let serving = Serving { period_s: parameters.period_s, ..Serving::default() };
        let mut tty = Pty::new(link).expect("a pty");
        let quit = Arc::new(AtomicBool::new(false));
        let told = quit.clone();
        let thread = std::thread::spawn(move || {
            let mut arm = MockArm::new(parameters, protocol.firmware(Carriage::Stream)).expect("valid");
            serve(&mut arm, &mut tty, serving, None, || told.load(Ordering::Relaxed)).expect("served");
            arm.report()
        });
        Self { quit, thread: Some(thread) }
    }

    fn report(mut self) -> MockReport {
        self.quit.store(true, Ordering::Relaxed);
        self.thread.take().expect("once").join().expect("no panic")
    }
}

/// Plays the servo with its rules for late samples: pushes while samples come and until it is told otherwise.
fn play(arm: &mut WiredArm, n: u32, mut pushes: bool) -> u32 {
    let (mut stale, mut n_lost) = (0, 0);
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

/// The port of an arm that fell silent is let go of with a zero, and opened again: nothing but ourselves stands in the way.
#[test]
fn an_arm_that_was_deaf_reads_a_zero_and_comes_back() {
    let all = ["hapkit", "haply-2diy", "polhem-2022", "open6-serial", "leader-arm-6"];
    let plays = all.map(|name| {
        std::thread::spawn(move || {
            let folder = tempfile::tempdir().expect("folder");
            let link = folder.path().join("arm");
            let behind = Behind::a_tty(name, "deaf@2s+1500ms", &link);
            let profile = profile::find(name, Path::new("")).expect(name);
            let options = OpenOptions { selector: Some(Selector::Path(link)), io_request: None, period_s: 1e-3, guard: None };
            let Opened { mut arm, news, .. } = open(&profile, &options).unwrap_or_else(|error| panic!("{name}: {error}"));
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
                    // It is there, and does not hear.
                    Ok(LinkNews::Fails(_) | LinkNews::Unguarded(_)) | Err(_) => {}
                    Ok(LinkNews::Lost) => panic!("{name}: lost once"),
                }
                assert!(begin.elapsed() < Duration::from_secs(60), "{name}: it never came back");
            }
            play(&mut arm, 300, false);
            arm.set_enabled(true);
            // A machine that is late is late again, and the arm may be lost and found once more: as often as it takes.
            let mut n_fresh = 0;
            while n_fresh < 30 {
                play(&mut arm, 10, true);
                n_fresh += arm.read().map_or(0, |sample| u32::from(sample.status == SampleStatus::Fresh));
                assert!(begin.elapsed() < Duration::from_secs(90), "{name}: it does not speak again");
            }
            drop(arm);
            std::thread::sleep(Duration::from_millis(100));
            let report = behind.report();
            let felt = &report.faults[0];
            // How soon is for the campaign to say (`deaf/*`): a busy machine may be late by seconds.
            let zero_after = felt.zero_after_ticks.unwrap_or_else(|| panic!("{name} read no zero: {felt:?}"));
            // Not with what was left of the old commands.
            let again = felt.force_again_after_ticks;
            assert!(again.is_none_or(|again| again > zero_after + 100), "{name}: {felt:?}");
            // The watchdog of some trips when this machine is late.
            let has_watchdog = profile.link.device_watchdog_ms.is_some();
            assert!(has_watchdog || again.is_some(), "{name} pushes again when it is told to: {felt:?}");
            assert_eq!([report.last_command.fx_n, report.last_command.fy_n], [0.0; 2], "{name}");
        })
    });
    for play in plays {
        play.join().expect("no panic");
    }
}

/// A host that ends while the arm is deaf leaves it a zero to wake to.
#[test]
fn an_arm_that_is_deaf_when_the_host_ends_wakes_to_a_zero() {
    let profile = profile::find("hapkit", Path::new("")).expect("shipped");
    // A host that a busy machine holds up pushes too late: again.
    let pushed = (0..10).any(|_| {
        let folder = tempfile::tempdir().expect("folder");
        let link = folder.path().join("arm");
        let behind = Behind::a_tty("hapkit", "deaf@1s+1s", &link);
        let options = OpenOptions { selector: Some(Selector::Path(link)), io_request: None, period_s: 1e-3, guard: None };
        let Opened { mut arm, .. } = open(&profile, &options).expect("there");
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
