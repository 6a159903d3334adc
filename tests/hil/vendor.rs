//! Arms behind libraries of their makers: force arrives, what the library reports has a name, and
//! whatever becomes of the worker the motors stop.

use std::path::Path;
use std::process::Command;

use arms::attached::nodes::Selector;
use arms::attached::open::{self, OpenOptions};
use arms::{Device as _, DeviceError};
use rt::clock::monotonic_ns;
use std::time::{Duration, Instant};
use vps::spatial::{SampleStatus, Wrench};

use super::ends::signal;
use super::link::{repeat, root, turn};
use super::maker::{
    Felt, LATENESS_MS, Library, PUSH, Serial, Service, Ticked, n_ticks, play, push,
};

const HAPTICD: &str = env!("CARGO_BIN_EXE_hapticd");
/// The watchdog of the mock arm's own firmware, which is what is left when its library can no
/// longer say zero, ms.
const WATCHDOG_MS: f64 = 50.0;

#[test]
fn an_arm_behind_a_makers_library_is_felt_and_let_go() {
    let _turn = turn();
    for (profile, title) in [
        ("omega7", "omega.7 (mock)"),
        ("virtuose-6d", "Virtuose of type 0"),
        ("touch", "Mock Touch"),
    ] {
        let library = Library::new(profile, &[]);
        let mut opened = library.open();
        assert!(opened.path.to_string_lossy().starts_with(title), "{}", opened.path.display());
        assert_eq!(opened.arm.capabilities().watchdog_ms, Some(50));
        play(&mut opened, &Wrench::ZERO, Ticked::is_fresh);
        push(&mut opened);
        let worker = library.worker().expect("a worker");
        let end_ns = monotonic_ns();
        drop(opened);
        assert!(!Path::new(&format!("/proc/{worker}")).exists(), "the worker has ended");
        std::thread::sleep(Duration::from_millis(20));
        let Felt { zero_ms, before_n, is_late } = library.arm.felt(end_ns, monotonic_ns());
        assert!(
            before_n > 0.3 && (is_late || zero_ms < LATENESS_MS),
            "{profile}: {before_n} N, zero after {zero_ms} ms"
        );
    }
}

#[test]
fn a_worker_that_is_stopped_does_not_outlive_its_arm() {
    let _turn = turn();
    for is_lost in [false, true] {
        let library = Library::new("omega6", &[]);
        let mut opened = library.open();
        play(&mut opened, &Wrench::ZERO, Ticked::is_fresh);
        push(&mut opened);
        let worker = library.worker().expect("a worker");
        signal("STOP", worker);
        if is_lost {
            play(&mut opened, &PUSH, |ticked| ticked.error == Some(DeviceError::Lost));
        }
        drop(opened);
        assert!(!Path::new(&format!("/proc/{worker}")).exists(), "lost: {is_lost}");
    }
}

#[test]
fn what_stands_in_the_way_of_a_makers_library_is_reported() {
    let _turn = turn();
    let bench = Library::new("omega6", &[]);
    for (fault, words) in [
        ("no-device", "finds no arm that it can open"),
        ("in-use", "device in use (DHD error 20)"),
        ("uninitialised", "hapticd devices probe PROFILE --home"),
        ("no-wrist", "has no wrist, and the profile says that it measures rx ry rz"),
    ] {
        bench.goes_wrong(fault);
        let reported = bench.try_open().err().expect("refused").to_string();
        assert!(reported.contains(words), "{fault}: {reported}");
    }
    let library = |path: &str| {
        let options = OpenOptions {
            selector: Some(Selector::Path(path.into())),
            io_request: None,
            period_s: 1e-3,
            guard: Some(bench.program()),
        };
        let error = open::open(&bench.profile, &options).err().expect("refused");
        format!("{error}\n{}", error.hint().unwrap_or_default())
    };
    let reported = library("/no/such/libdrd.so");
    assert!(
        reported.contains("there is no /no/such/libdrd.so") && reported.contains("install"),
        "{reported}"
    );
    let reported = library(root("Cargo.toml").to_str().expect("text"));
    assert!(reported.contains("is no library"), "{reported}");
    assert!(
        Command::new(HAPTICD)
            .args(["vendor-arm", "{}"])
            .output()
            .is_ok_and(|output| output.status.code() == Some(2))
    );
}

/// What a sample, or its absence, says of a fault.
enum Shows {
    /// An error code, in words.
    Error(&'static str),
    /// No new samples for 20 ms.
    Stale,
    /// The arm is gone.
    Lost,
    /// It is elsewhere at once.
    Elsewhere,
}

const IN_LIBRARY: [(&str, &[(&str, Shows)]); 3] = [
    (
        "omega6",
        &[
            ("button", Shows::Error("by the button")),
            ("velocity", Shows::Error("moved too fast")),
            ("time-guard", Shows::Stale),
            ("garbage", Shows::Elsewhere),
            ("com", Shows::Lost),
            ("exit", Shows::Lost),
            ("hang", Shows::Lost),
        ],
    ),
    (
        "virtuose-6d",
        &[
            ("emergency-stop", Shows::Error("emergency stop")),
            ("power", Shows::Error("no power")),
            ("failure", Shows::Error("failure")),
            ("overheat", Shows::Error("too hot")),
            ("garbage", Shows::Elsewhere),
            ("com", Shows::Lost),
            ("exit", Shows::Lost),
            ("hang", Shows::Lost),
        ],
    ),
    (
        "touch",
        &[
            ("warm", Shows::Error("too warm")),
            ("velocity", Shows::Error("moved too fast")),
            ("garbage", Shows::Elsewhere),
            ("com", Shows::Lost),
            ("exit", Shows::Lost),
            ("still", Shows::Lost),
            ("hang", Shows::Lost),
        ],
    ),
];

/// One fault in the library of an arm that pushes: it shows, the motors stop, and the arm comes
/// back without force.
fn goes_wrong(library: &Library, arm: &mut open::OpenedArm, fault: &str, shows: &Shows) {
    push(arm);
    let at_ns = monotonic_ns();
    let mut stale = 0;
    library.goes_wrong(fault);
    let last = play(arm, &PUSH, |ticked| {
        stale = if ticked.is_fresh() { 0 } else { stale + 1 };
        match shows {
            Shows::Error(_) => ticked.device_error() != 0,
            Shows::Stale => stale >= 20,
            Shows::Lost => ticked.error == Some(DeviceError::Lost),
            Shows::Elsewhere => {
                ticked.sample.is_some_and(|sample| sample.pose.translation.length() > 1.0)
            }
        }
    });
    // As the tick does after a fault.
    arm.arm.set_enabled(false);
    if let Shows::Error(words) = shows {
        let reported = library.error_text(last.device_error());
        assert!(reported.contains(words), "{fault}: {reported}");
    }
    play(arm, &Wrench::ZERO, n_ticks(20));
    library.goes_wrong("");
    // It comes back, without force.
    let mut quiet = 0;
    play(arm, &Wrench::ZERO, |ticked| {
        quiet = if ticked.is_fresh() && ticked.device_error() == 0 { quiet + 1 } else { 0 };
        quiet > 20
    });
    let Felt { zero_ms, before_n, is_late } = library.arm.felt(at_ns, monotonic_ns());
    // A library that hangs or has gone leaves the arm to its own watchdog; with the others the next
    // commands are zero, sooner than that.
    let is_in_time = is_late || zero_ms < WATCHDOG_MS + LATENESS_MS;
    assert!(
        before_n > 0.3 && is_in_time,
        "{}, {fault}: {before_n} N, zero after {zero_ms} ms",
        library.profile.name
    );
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn whatever_goes_wrong_in_a_makers_library_has_a_name_and_ends_the_force() {
    let _turn = turn();
    std::thread::scope(|scope| {
        for (name, faults) in &IN_LIBRARY {
            scope.spawn(move || {
                let library = Library::new(name, &[]);
                let mut arm = library.open();
                for (fault, shows) in *faults {
                    goes_wrong(&library, &mut arm, fault, shows);
                }
            });
        }
    });
}

/// Round trips from a command to the state that answers it, and times of a tick's two calls, µs,
/// ascending. `None` where a busy machine kept the mock arm silent for so long that it counted as
/// lost.
fn exchanges(mut opened: open::OpenedArm, n: usize) -> Option<[Vec<f64>; 2]> {
    play(&mut opened, &Wrench::ZERO, Ticked::is_fresh);
    let [mut trips_us, mut calls_us] = [Vec::with_capacity(n), Vec::with_capacity(n)];
    let mut next = Instant::now();
    while trips_us.len() < n {
        next += Duration::from_millis(1);
        let begin = Instant::now();
        opened.arm.write(&Wrench::ZERO).ok()?;
        let wrote = begin.elapsed();
        let (is_fresh, read) = loop {
            let begin_read = Instant::now();
            let sample = opened.arm.read().ok()?;
            let is_fresh = sample.status == SampleStatus::Fresh;
            let read = begin_read.elapsed();
            if is_fresh || begin.elapsed() > Duration::from_millis(4) {
                break (is_fresh, read);
            }
            std::thread::yield_now();
        };
        if is_fresh {
            trips_us.push(begin.elapsed().as_secs_f64() * 1e6);
            calls_us.push((wrote + read).as_secs_f64() * 1e6);
        }
        next = next.max(Instant::now());
        std::thread::sleep(next.saturating_duration_since(Instant::now()));
    }
    trips_us.sort_by(f64::total_cmp);
    calls_us.sort_by(f64::total_cmp);
    Some([trips_us, calls_us])
}

/// What a worker or a service adds to an exchange, beside a serial arm in the same run:
/// docs/reference/measured.md says how it is measured.
#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
#[expect(clippy::print_stdout, reason = "figures for people")]
fn what_a_worker_adds_to_an_exchange() {
    let n = std::env::var("HAPTICD_EXCHANGES")
        .map_or(200, |n| n.parse().expect("HAPTICD_EXCHANGES is a number"));
    let at = |sorted: &[f64], share: f64| sorted[(share * sorted.len() as f64) as usize];
    let tell = |what: &str, exchanges: &dyn Fn() -> Option<[Vec<f64>; 2]>| {
        let measured = repeat(|| {
            let measured = exchanges();
            let is_spoilt = measured.is_none();
            (measured, is_spoilt)
        });
        let [trips_us, calls_us] = measured.expect("an arm that stays");
        println!(
            "{what}: round trip median {:.0} us, p99.9 {:.0} us; write and read of a tick median \
                {:.1} us, p99.9 {:.1} us",
            at(&trips_us, 0.5),
            at(&trips_us, 0.999),
            at(&calls_us, 0.5),
            at(&calls_us, 0.999),
        );
    };
    let serial = Serial::new("open6-serial", &[]);
    tell("serial arm in this process", &|| exchanges(serial.open(), n));
    for name in ["omega6", "touch", "virtuose-6d"] {
        let library = Library::new(name, &[]);
        tell(&format!("{name}, its library in a worker"), &|| exchanges(library.open(), n));
    }
    let service = Service::new("3.5.0", &[]);
    tell("inverse3, by its service", &|| exchanges(service.open(), n));
}
