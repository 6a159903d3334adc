//! The guard: whatever becomes of the program, the arm gets zero.

use std::fs::File;
use std::io::{Read, Write as _};
use std::os::fd::OwnedFd;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use arms::attached::nodes::Selector;
use arms::attached::open::{self, LinkNews, OpenOptions, OpenedArm};
use arms::guard::{Guard, ZeroFrame};
use arms::mock::builder::{self, MockSettings};
use arms::mock::pty::Pty;
use arms::mock::serve::{Serving, serve};
use arms::mock::{MockArm, MockReport};
use arms::transport::Carriage;
use arms::{Device, DeviceError, profile};
use glam::DVec3;
use rustix::fs::{Mode, OFlags};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, tcgetattr, tcsetattr};
use tempfile::TempDir;
use vps::spatial::Wrench;

use super::link::{Bench, Ended, Running, is_lateness, repeat, turn};

/// Longer than any guard takes to end on a machine that computes something else.
const HUNG: Duration = Duration::from_secs(10);
const GUARD: &str = env!("CARGO_BIN_EXE_hapticd");

/// The guard of a process.
fn guard_of(host: u32) -> Option<u32> {
    let stat = |pid: u32| std::fs::read_to_string(format!("/proc/{pid}/stat")).ok();
    let pids = std::fs::read_dir("/proc")
        .expect("proc")
        .filter_map(|entry| entry.ok()?.file_name().to_str()?.parse().ok());
    let host = host.to_string();
    pids.into_iter().find(|pid| {
        // Number (name) state parent …: it may just be looking.
        stat(*pid).is_some_and(|stat| {
            let rest = stat.split_once("(haptic-guard) ").map(|(_, rest)| rest);
            rest.and_then(|rest| rest.split(' ').nth(1)) == Some(&*host)
        })
    })
}

fn is_alive(pid: u32) -> bool {
    // A zombie is not alive.
    std::fs::read_to_string(format!("/proc/{pid}/stat"))
        .is_ok_and(|stat| stat.contains("(haptic-guard)") && !stat.contains(") Z "))
}

fn ends(pid: u32) -> bool {
    let begin = Instant::now();
    while is_alive(pid) && begin.elapsed() < HUNG {
        std::thread::sleep(Duration::from_millis(5));
    }
    !is_alive(pid)
}

fn signal(name: &str, pid: u32) {
    assert!(
        Command::new("kill")
            .args([format!("-{name}"), pid.to_string()])
            .status()
            .expect("kill")
            .success(),
        "{name}"
    );
}

fn force_n(felt: &Ended) -> f64 {
    ["fx_n", "fy_n", "fz_n"]
        .map(|key| felt.json["last_command"][key].as_f64().expect("a number").powi(2))
        .iter()
        .sum::<f64>()
        .sqrt()
}

/// Lets the host press, does something to it and its guard, and gives what the arm felt until its
/// time was over, and whether the guard has gone.
fn pressed_then(
    bench: &Bench,
    mock_args: &[&str],
    mut act: impl FnMut(&Running, u32),
) -> (Ended, bool) {
    repeat(|| {
        let mock = bench.mock_with(&[&["--duration", "6s"], mock_args].concat());
        let mut host = bench.host(&["--enable"]);
        host.comes_to("state: enabled");
        // The hand begins after one second and presses from 1.2 s of its own time on.
        std::thread::sleep(Duration::from_millis(2600));
        let guard = guard_of(host.id());
        if let Some(guard) = guard {
            act(&host, guard);
        } else {
            host.signal("TERM");
        }
        let mock = mock.ended();
        if guard.is_some() {
            // One that stands still, too.
            host.signal("KILL");
        }
        let reported = host.ended().stderr;
        // A run that ended before it was killed had a fault: these arms have no other than lateness
        // here, whatever they call it.
        let is_late = reported.contains("fault: ");
        assert!(guard.is_some() || is_late, "a run without a guard:\n{reported}");
        ((mock, guard.is_some_and(ends)), is_late)
    })
}

/// The host is killed while it presses. Most of these arms hold their last command for ever; the
/// others say when their own watchdog was first.
fn hears_zero_of_a_dead_host(bench: &Bench, mock_args: &[&str]) {
    let profile = &bench.profile;
    let (felt, has_gone) = pressed_then(bench, mock_args, |host, _| host.signal("KILL"));
    assert!(felt.number("largest_force_n") > 0.1, "{profile}: it pressed: {}", felt.json);
    assert_eq!(
        (force_n(&felt), felt.number("watchdog_trips")),
        (0.0, 0.0),
        "{profile}: {}",
        felt.json
    );
    assert!(has_gone, "{profile}: nothing is left behind");
}

/// The other arms, and hosts that stand still: `kill/*` and `stopped/*` of the fault campaign.
#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn an_arm_hears_zero_of_a_dead_host() {
    hears_zero_of_a_dead_host(&Bench::verified("polhem-2020"), &[]);
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn without_a_guard_an_arm_without_a_watchdog_holds_the_last_force_of_a_dead_host() {
    // This is what the guard is for: there is no way out left in which a program that was killed
    // could write a zero.
    let bench = Bench::verified("polhem-2022");
    let (felt, _) = pressed_then(&bench, &[], |host, guard| {
        signal("KILL", guard);
        host.signal("KILL");
    });
    assert!(force_n(&felt) > 0.1, "{}", felt.json);
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn without_a_guard_an_arm_with_a_watchdog_lets_go_of_a_dead_host() {
    let (felt, _) = pressed_then(&Bench::viscous(), &[], |host, guard| {
        signal("KILL", guard);
        host.signal("KILL");
    });
    assert!(felt.number("largest_force_n") > 0.3, "{}", felt.json);
    assert_eq!((felt.number("watchdog_trips"), force_n(&felt)), (1.0, 0.0), "{}", felt.json);
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn signals_of_a_terminal_do_not_reach_the_guard() {
    let bench = Bench::viscous();
    let (host, has_outlived) = repeat(|| {
        let _mock = bench.mock(&[]);
        let mut host = bench.host(&["--enable", "--duration", "4s"]);
        host.comes_to("state: enabled");
        let guard = guard_of(host.id()).expect("a guard");
        let signals = [
            "HUP", "INT", "QUIT", "USR1", "USR2", "PIPE", "ALRM", "TERM", "TSTP", "ABRT", "SEGV",
            "XCPU",
        ];
        signals.into_iter().for_each(|name| signal(name, guard));
        std::thread::sleep(Duration::from_millis(100));
        let has_outlived = is_alive(guard);
        let host = host.ended();
        let is_late = host.faults().into_iter().any(is_lateness);
        ((host, has_outlived), is_late)
    });
    assert_eq!(
        (host.code(), host.faults(), has_outlived),
        (Some(0), Vec::new(), true),
        "{}",
        host.stderr
    );
    assert!(!host.stderr.contains("guard"), "nothing is said of it: {}", host.stderr);
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn a_run_that_ends_in_order_takes_its_guard_along() {
    let bench = Bench::viscous();
    let (host, has_gone) = repeat(|| {
        let _mock = bench.mock(&[]);
        let mut host = bench.host(&["--enable", "--duration", "2s"]);
        host.comes_to("state: enabled");
        let guard = guard_of(host.id()).expect("a guard");
        let host = host.ended();
        // At once: the run waits for it.
        let has_gone = !is_alive(guard);
        let is_late = host.faults().into_iter().any(is_lateness);
        ((host, has_gone), is_late)
    });
    assert_eq!((host.code(), has_gone), (Some(0), true), "{}", host.stderr);
}

#[test]
fn a_guard_is_no_command_for_people() {
    let output = Command::new(GUARD).args(["guard", "00"]).output().expect("starts");
    assert_eq!(output.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&output.stderr).contains("part of a run"), "{output:?}");
    assert!(output.stdout.is_empty(), "nothing of the frame is written: {output:?}");
}

/// A terminal: the arm's end, and the host's.
fn terminal() -> (File, OwnedFd) {
    let far =
        openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).expect("a terminal");
    grantpt(&far).expect("ours");
    unlockpt(&far).expect("ours");
    let name = ptsname(&far, Vec::new()).expect("a name");
    let near = rustix::fs::open(
        name.as_c_str(),
        OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC,
        Mode::empty(),
    )
    .expect("there");
    let mut settings = tcgetattr(&near).expect("a terminal");
    settings.make_raw();
    tcsetattr(&near, OptionalActions::Now, &settings).expect("set");
    rustix::fs::fcntl_setfl(&far, OFlags::NONBLOCK).expect("set");
    (File::from(far), near)
}

/// The same with a guard on the host's end.
fn guarded_terminal() -> (File, OwnedFd, Guard) {
    let (far, near) = terminal();
    let zero = ZeroFrame(b"zero\n".to_vec());
    let guard =
        Guard::start(Path::new(GUARD), near.try_clone().expect("a descriptor"), &zero, None)
            .expect("a guard");
    (far, near, guard)
}

/// What comes to the arm's end for so long, or until there is so much of it.
fn heard(far: &mut File, within: Duration, n_bytes: usize) -> Vec<u8> {
    let begin = Instant::now();
    let mut bytes = Vec::new();
    while begin.elapsed() < within && bytes.len() < n_bytes {
        let mut some = [0; 512];
        match far.read(&mut some) {
            Ok(n) => bytes.extend_from_slice(&some[..n]),
            Err(_) => std::thread::sleep(Duration::from_micros(200)),
        }
    }
    bytes
}

const BOTH: &[u8] = b"zero\nzero\n";
const SOON: Duration = Duration::from_millis(200);

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn beats_keep_a_guard_quiet_and_their_absence_counts_under_force_only() {
    repeat(|| {
        let (mut far, _near, mut guard) = guarded_terminal();
        let begin = Instant::now();
        let mut longest = Duration::ZERO;
        while begin.elapsed() < Duration::from_millis(500) {
            let beat = Instant::now();
            guard.beat(true);
            std::thread::sleep(Duration::from_millis(1));
            longest = longest.max(beat.elapsed());
        }
        guard.beat(false);
        let quiet = heard(&mut far, SOON, 1);
        let is_late = longest > Duration::from_millis(40);
        assert!(is_late || quiet.is_empty() && !guard.has_acted(), "{quiet:?}");
        // It stands still once more, under force.
        guard.has_acted();
        guard.beat(true);
        let begin = Instant::now();
        let zero = heard(&mut far, HUNG, BOTH.len());
        let took = begin.elapsed();
        assert!(zero == BOTH && took >= Duration::from_millis(50), "{zero:?} {took:?}");
        assert!(guard.has_acted() && !guard.has_acted(), "reported once");
        // Not again before the loop has gone on.
        assert!(heard(&mut far, SOON, 1).is_empty());
        guard.beat(false);
        drop(guard);
        assert!(heard(&mut far, SOON, 1).is_empty(), "it stands aside without a word");
        ((), is_late || took > Duration::from_millis(60))
    });
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn a_guard_that_is_dismissed_under_force_says_zero_first() {
    let (mut far, _near, mut guard) = guarded_terminal();
    guard.beat(true);
    drop(guard);
    assert_eq!(heard(&mut far, HUNG, BOTH.len()), BOTH);
}

/// Where the host of the next test finds its port.
const PORT_OF_HOST: &str = "HAPTICD_TEST_PORT";

#[test]
#[ignore = "no test by itself: a_host_that_takes_long_to_die_is_not_waited_for starts it by name, \
    as the host that it kills"]
fn large_host() {
    let Ok(port) = std::env::var(PORT_OF_HOST) else { return };
    let port = File::options().write(true).open(port).expect("the port");
    let zero = ZeroFrame(b"zero\n".to_vec());
    let arm = port.try_clone().expect("a descriptor").into();
    let mut guard = Guard::start(Path::new(GUARD), arm, &zero, Some(81)).expect("a guard");
    let memory = vec![1_u8; 1 << 30];
    guard.beat(true);
    (&port).write_all(b"ready").expect("open");
    loop {
        guard.beat(std::hint::black_box(&memory).len() > 1);
        std::thread::sleep(Duration::from_millis(1));
    }
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn a_host_that_takes_long_to_die_is_not_waited_for() {
    let took = repeat(|| {
        let (mut far, _near) = terminal();
        let port = ptsname(&far, Vec::new()).expect("a name").into_string().expect("text");
        let mut host = Command::new(std::env::current_exe().expect("this program"))
            .args(["guard::large_host", "--exact", "--ignored"])
            .env(PORT_OF_HOST, port)
            .stdout(Stdio::null())
            .spawn()
            .expect("starts");
        let ready = heard(&mut far, HUNG, 5);
        let begin = Instant::now();
        host.kill().expect("alive");
        let zero = heard(&mut far, HUNG, b"zero\n".len());
        let took = begin.elapsed();
        host.wait().expect("a child");
        assert!(ready == b"ready" && zero.starts_with(b"zero\n"), "{ready:?} {zero:?}");
        (took, took > Duration::from_millis(20))
    });
    assert!(took <= Duration::from_millis(20), "{took:?}");
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn what_waits_in_the_port_goes_before_the_zero() {
    let (mut far, near, mut guard) = guarded_terminal();
    // More than a terminal passes on before it is read.
    rustix::fs::fcntl_setfl(&near, OFlags::NONBLOCK).expect("set");
    let mut n_waiting = 0;
    while let Ok(n) = rustix::io::write(&near, &[b'x'; 64]) {
        n_waiting += n;
    }
    guard.beat(true);
    drop(guard);
    let heard = heard(&mut far, SOON, usize::MAX);
    assert!(heard.ends_with(BOTH) && heard.len() < n_waiting, "{} of {n_waiting}", heard.len());
}

#[test]
fn a_program_that_is_no_guard_is_an_error_in_words() {
    let (_far, near) = terminal();
    let start = |program: &str| {
        Guard::start(
            Path::new(program),
            near.try_clone().expect("a descriptor"),
            &ZeroFrame(vec![0]),
            None,
        )
    };
    assert_eq!(
        start("/no/such/program").expect_err("missing").kind(),
        std::io::ErrorKind::NotFound
    );
    let other = start("/bin/false").expect_err("another program").to_string();
    assert!(other.contains("/bin/false guard") && other.contains("exit status: 1"), "{other}");
}

/// A mock arm in a thread, and the driver of it in this process.
struct Driven {
    _folder: TempDir,
    node: PathBuf,
    quit: Arc<AtomicBool>,
    arm_side: JoinHandle<MockReport>,
    opened: OpenedArm,
}

impl Driven {
    fn new() -> Self {
        let folder = tempfile::tempdir().expect("a folder");
        let node: PathBuf = folder.path().join("arm");
        let profile = profile::find("polhem-2022", Path::new("")).expect("shipped");
        let settings =
            MockSettings { hand: None, hand_delay: Duration::ZERO, faults: Vec::new(), seed: 1 };
        let (parameters, protocol) = builder::parameters(&profile, settings);
        let serving =
            Serving { period_s: parameters.period_s, duration: None, until_host_gone: false };
        let mut mock =
            MockArm::new(parameters, protocol.firmware(Carriage::Stream)).expect("valid");
        let mut pty = Pty::new(&node).expect("a terminal");
        let quit = Arc::new(AtomicBool::new(false));
        let reported = quit.clone();
        let arm_side = std::thread::spawn(move || {
            serve(&mut mock, &mut pty, serving, None, || reported.load(Ordering::Relaxed))
                .expect("served");
            mock.report()
        });
        let options = OpenOptions {
            selector: Some(Selector::Path(node.clone())),
            io_request: None,
            period_s: 1e-3,
            guard: Some(GUARD.into()),
        };
        let opened = open::open(&profile, &options).expect("an arm");
        assert!(opened.news.try_recv().is_err(), "it has a guard");
        Self { _folder: folder, node, quit, arm_side, opened }
    }

    /// Pushes for 200 ticks.
    fn push(&mut self) {
        let arm = &mut self.opened.arm;
        arm.set_enabled(true);
        let mut rendered = Wrench::ZERO;
        for _ in 0..200 {
            arm.read().expect("an arm");
            rendered = arm.write(&PUSH).expect("an arm");
            std::thread::sleep(Duration::from_millis(1));
        }
        assert!(rendered.force.length() > 0.1, "{rendered:?}");
    }

    /// The guard that holds the port of this arm.
    fn guard(&self) -> Option<u32> {
        let port = std::fs::canonicalize(&self.node).ok()?;
        let pids = std::fs::read_dir("/proc").expect("proc");
        pids.filter_map(|entry| entry.ok()?.file_name().to_str()?.parse().ok()).find(|pid| {
            let holds = std::fs::read_link(format!("/proc/{pid}/fd/1"));
            is_alive(*pid) && holds.is_ok_and(|file| file == port)
        })
    }

    /// What the arm felt until now.
    fn ended(self) -> MockReport {
        self.quit.store(true, Ordering::Relaxed);
        self.arm_side.join().expect("no panic")
    }
}

const PUSH: Wrench = Wrench { force: DVec3::new(0.0, 0.0, 0.3), torque: DVec3::ZERO };

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn a_guard_that_is_stopped_or_dies_ends_the_force_and_another_one_takes_its_place() {
    let _turn = turn();
    for name in ["STOP", "KILL"] {
        let mut driven = Driven::new();
        driven.push();
        let guard = driven.guard().expect("a guard");
        signal(name, guard);
        let begin = Instant::now();
        let error = loop {
            let arm = &mut driven.opened.arm;
            if let Err(error) = arm.read().and_then(|_| arm.write(&PUSH)) {
                break error;
            }
            assert!(begin.elapsed() < HUNG, "{name}: the force goes on without a guard");
            std::thread::sleep(Duration::from_millis(1));
        };
        assert_eq!(error, DeviceError::Lost, "{name}");
        driven.opened.arm.set_enabled(false);
        let mut reported = Vec::new();
        while !reported.iter().any(|news| matches!(news, LinkNews::Back { .. })) {
            let arm = &mut driven.opened.arm;
            let _ = arm.read().and_then(|_| arm.write(&Wrench::ZERO));
            reported.extend(driven.opened.news.try_iter());
            assert!(begin.elapsed() < 2 * HUNG, "{name}: the arm does not come back");
            std::thread::sleep(Duration::from_millis(1));
        }
        let told = reported.iter().any(
            |news| matches!(news, LinkNews::Reported(text) if text.contains("its guard was stopped")),
        );
        assert!(told, "{name}: {reported:?}");
        assert!(!is_alive(guard), "{name}: the old one is gone");
        assert!(driven.guard().is_some_and(|other| other != guard), "{name}");
        let felt = driven.ended().last_command;
        assert_eq!([felt.fx_n, felt.fy_n, felt.fz_n], [0.0; 3], "{name}");
    }
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn a_driver_that_slept_sends_nothing_that_it_computed_before() {
    let mut driven = Driven::new();
    driven.push();
    std::thread::sleep(Duration::from_millis(200));
    // Between the tick and its write.
    assert_eq!(driven.opened.arm.write(&PUSH), Err(DeviceError::Stalled));
    std::thread::sleep(Duration::from_millis(50));
    let report = driven.ended();
    assert!(report.largest_force_n > 0.1, "{report:?}");
    let felt = report.last_command;
    assert_eq!([felt.fx_n, felt.fy_n, felt.fz_n], [0.0; 3], "the guard's zero stands");
}
