//! The driver at a link in memory.

use core::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

use proptest::prelude::*;
use rt::process::SharedPage;
use rtrb::RingBuffer;

use super::*;
use crate::attached::open::wired_parameters;
use crate::guard::Guard;
use crate::profile::{self, Profile, TransportKind};
use crate::protocol::{ArmReadings, Codec, Firmware, Outbox, Protocol};
use crate::transport::{Carriage, LoopbackEnd, Transport, loopback};

const PERIOD_S: f64 = 1e-3;

/// The board of a shipped arm, and its end of the link.
struct ControllerBoard {
    firmware: Box<dyn Firmware>,
    end: LoopbackEnd,
    now_s: f64,
    /// Counts of its first encoder, or the angle in its place.
    reading: f64,
    /// What is left of a frame to the host, bytes.
    crop: usize,
}

impl ControllerBoard {
    fn readings(&self) -> ArmReadings {
        let mut readings = [0.0; MAX_AXES];
        readings[0] = self.reading;
        ArmReadings { readings, rates: [0.0; MAX_AXES], buttons: 0, homed: true, asleep: false }
    }

    fn post(&mut self, out: Outbox) {
        for report in out {
            let n = report.len().min(self.crop);
            self.end.send(&report[..n]).expect("open");
        }
    }

    /// A period, in which the firmware may send. `heard`: whether that reaches the link.
    fn advance(&mut self, heard: bool) {
        self.now_s += PERIOD_S;
        let mut out = Outbox::new();
        self.firmware.advance(self.now_s, &self.readings(), &mut out);
        if heard {
            self.post(out);
        }
    }

    /// Takes what the host sent, and answers.
    fn listen(&mut self) {
        let mut buffer = [0; 256];
        let mut out = Outbox::new();
        while let Ok(n @ 1..) = self.end.receive(&mut buffer) {
            self.firmware.receive(&buffer[..n], self.now_s, &self.readings(), &mut out);
        }
        self.post(out);
    }

    fn is_driven(&self) -> bool {
        self.firmware.motors() != [0.0; MAX_AXES]
    }
}

/// Both ends of a way to new connections, as the reconnect thread holds them.
struct Lost {
    spent: rtrb::Consumer<Connection>,
    _fresh: rtrb::Producer<Connection>,
}

/// `timebase`: counted time passes with the reads of the arm alone.
fn attached(name: &str, timebase: Timebase) -> (WiredArm, ControllerBoard, Lost) {
    let profile = profile::find(name, std::path::Path::new("")).expect(name);
    attached_with(&profile, timebase, |host| Box::new(host), None)
}

/// The same with what `wrap` makes of the host's end, and a guard.
fn attached_with(
    profile: &Profile,
    timebase: Timebase,
    wrap: impl FnOnce(LoopbackEnd) -> Box<dyn Transport>,
    guard: Option<Guard>,
) -> (WiredArm, ControllerBoard, Lost) {
    let name = profile.name.as_str();
    let real = profile.real.as_ref().expect("a real arm");
    let carriage = if real.matching.transport == TransportKind::Hid {
        Carriage::Reports
    } else {
        Carriage::Stream
    };
    let (host, end) = loopback(carriage);
    let firmware = real.protocol.firmware(carriage);
    let mut board = ControllerBoard { firmware, end, now_s: 0.0, reading: 0.0, crop: usize::MAX };
    let connection =
        Connection { link: wrap(host), codec: real.protocol.codec(carriage), guard: Ok(guard) };
    let parameters = WiredParameters {
        timebase,
        ..wired_parameters(profile, real, PERIOD_S, IoPlacement::InLoop)
    };
    let ((fresh, to_arm), (spent, from_arm)) = (RingBuffer::new(1), RingBuffer::new(1));
    let lost = Lost { spent: from_arm, _fresh: fresh };
    if name.starts_with("haply") {
        // A board that was not set up does not answer.
        let setup = "01 05 03 01 00 03 01 01 00 00 00 00 34 43 00 00 58 46 00 00 00 00 00 00 58 46";
        let setup: Vec<u8> =
            setup.split(' ').map(|byte| u8::from_str_radix(byte, 16).expect("hex")).collect();
        board.firmware.receive(&setup, 0.0, &board.readings(), &mut Outbox::new());
    }
    (WiredArm::new(connection, Replacements { fresh: to_arm, spent }, parameters), board, lost)
}

const PUSH: Wrench = Wrench { force: DVec3::new(0.3, 0.3, 0.0), torque: DVec3::ZERO };

/// One tick against a board that sends and receives.
fn exchange(
    arm: &mut WiredArm,
    board: &mut ControllerBoard,
    wrench: &Wrench,
) -> Result<DeviceSample, DeviceError> {
    let sample = arm.read()?;
    arm.write(wrench)?;
    board.listen();
    board.advance(true);
    Ok(sample)
}

/// An arm that streams fills the queues while the program is still starting: what overflows then is
/// no loss of the link.
#[test]
fn what_came_before_the_first_tick_was_not_lost() {
    let (mut arm, mut board, _lost) = attached("woodenhaptics-v15", Timebase::Counted);
    for _ in 1..READS_MAX {
        board.advance(true);
    }
    for _ in 0..800 {
        board.advance(false);
    }
    for tick in 0..20 {
        board.advance(true);
        let sample = arm.read().expect("attached");
        assert_eq!((sample.lost_packets, sample.status), (0, SampleStatus::Fresh), "tick {tick}");
    }
    // From now on a gap is one.
    for _ in 0..30 {
        board.advance(false);
    }
    board.advance(true);
    assert_eq!(arm.read().expect("attached").lost_packets, 30);
}

#[test]
fn a_rate_input_has_no_zero_to_find() {
    let (mut arm, _board, _lost) = attached("spacemouse", Timebase::Counted);
    let sample = arm.read().expect("attached");
    assert!(sample.homed && sample.status == SampleStatus::Fresh);
}

/// An arm that streams may go on sending while it receives nothing: what it has not read must
/// neither grow nor stand before the zero.
#[test]
fn an_arm_that_hears_nothing_reads_a_zero_and_no_old_force_when_it_wakes() {
    let (mut arm, mut board, mut lost) = attached("hapkit", Timebase::Counted);
    arm.set_enabled(true);
    for _ in 0..50 {
        exchange(&mut arm, &mut board, &PUSH).expect("there");
    }
    assert!(board.is_driven());
    board.end.limit(4096);
    let mut stale_at = None;
    let mut lost_at = None;
    for tick in 0..2000 {
        match arm.read() {
            Ok(sample) if sample.status == SampleStatus::Stale => {
                stale_at.get_or_insert(tick);
            }
            Ok(_) => {}
            Err(error) => {
                assert_eq!(error, DeviceError::Lost);
                lost_at.get_or_insert(tick);
            }
        }
        // As a tick does after its rule for late samples.
        let wrench =
            if stale_at.is_some_and(|stale_at| tick > stale_at + 20) { Wrench::ZERO } else { PUSH };
        let _ = arm.write(&wrench);
        board.advance(true);
    }
    assert!((15..=25).contains(&stale_at.expect("it counts as silent")), "{stale_at:?}");
    assert!((490..=520).contains(&lost_at.expect("it is let go of")), "{lost_at:?}");
    // It wakes: the first thing that it reads takes the force away.
    let mut buffer = [0; 4096];
    let n = board.end.receive(&mut buffer).expect("open");
    let mut out = Outbox::new();
    let first = buffer[..n].iter().position(|byte| *byte == b'\n').expect("a line") + 1;
    board.firmware.receive(&buffer[..first], board.now_s, &board.readings(), &mut out);
    assert!(!board.is_driven(), "{}", String::from_utf8_lossy(&buffer[..n]));
    board.firmware.receive(&buffer[first..n], board.now_s, &board.readings(), &mut out);
    assert!(!board.is_driven());
    assert!(lost.spent.pop().is_ok(), "the reconnect thread has the port");
}

/// Forces that fill the line to its end: the zero does not wait for a free place.
#[test]
fn a_zero_finds_room_in_a_line_that_is_full() {
    let (mut arm, mut board, _lost) = attached("hapkit", Timebase::Counted);
    board.end.limit(64);
    arm.set_enabled(true);
    for _ in 0..15 {
        board.advance(true);
        arm.read().expect("there");
        arm.write(&PUSH).expect("there");
    }
    arm.read().expect("there");
    arm.write(&Wrench::ZERO).expect("there");
    board.listen();
    assert!(!board.is_driven());
    for _ in 0..15 {
        board.advance(true);
        arm.read().expect("there");
        arm.write(&PUSH).expect("there");
    }
    arm.stop();
    board.listen();
    assert!(!board.is_driven(), "after a stop too");
}

#[test]
fn an_arm_that_says_nothing_is_looked_for_and_reported_zero() {
    for name in ["hapkit", "haply-2diy", "polhem-2022", "polhem-2019"] {
        let (mut arm, mut board, mut lost) = attached(name, Timebase::Counted);
        arm.set_enabled(true);
        for _ in 0..50 {
            exchange(&mut arm, &mut board, &PUSH).expect(name);
        }
        let mut ticks = 0;
        let error = loop {
            ticks += 1;
            match arm.read() {
                Ok(_) => {
                    arm.write(&PUSH).expect(name);
                }
                Err(error) => break error,
            }
        };
        assert!(
            error == DeviceError::Lost && (499..=505).contains(&ticks),
            "{name}: {error:?} after {ticks} ticks"
        );
        assert_eq!(
            (arm.read(), arm.write(&PUSH)),
            (Err(DeviceError::Lost), Err(DeviceError::Lost)),
            "{name}"
        );
        board.listen();
        assert!(!board.is_driven(), "{name}");
        lost.spent.pop().expect(name).let_go();
        board.listen();
        assert!(!board.is_driven(), "{name}");
    }
    // A rate input rests for as long as the hand does.
    let (mut mouse, _board, _lost) = attached("spacemouse", Timebase::Counted);
    assert!((0..2000).all(|_| mouse.read().is_ok()));
}

/// `crop`: bytes of one reply that reach the host.
fn half_a_reply(crop: usize) -> (u32, u32) {
    let (mut arm, mut board, _lost) = attached("haply-2diy", Timebase::Counted);
    arm.set_enabled(true);
    for _ in 0..50 {
        exchange(&mut arm, &mut board, &PUSH).expect("there");
    }
    assert!(board.is_driven());
    board.crop = crop;
    exchange(&mut arm, &mut board, &PUSH).expect("there");
    board.crop = usize::MAX;
    let mut zero_at = None;
    let mut fresh_at = None;
    for tick in 0..3000 {
        let wrench = if zero_at.is_none() || fresh_at.is_some() { PUSH } else { Wrench::ZERO };
        let sample = exchange(&mut arm, &mut board, &wrench).expect("there");
        if !board.is_driven() {
            zero_at.get_or_insert(tick);
        }
        if zero_at.is_some() && tick > 100 && sample.status == SampleStatus::Fresh {
            fresh_at.get_or_insert(tick);
        }
    }
    assert!(board.is_driven(), "it goes on");
    (zero_at.expect("zero"), fresh_at.expect("comes back"))
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn half_a_reply_takes_the_force_away_at_once_and_the_silence_follows() {
    for crop in [8, 4, 1] {
        let (zero_at, fresh_at) = half_a_reply(crop);
        assert!(zero_at <= 7, "{crop} bytes: {zero_at} ticks to zero");
        assert!(
            (1200..1220).contains(&fresh_at),
            "{crop} bytes: {fresh_at} ticks until it speaks again"
        );
    }
}

#[test]
fn after_a_stall_no_sample_is_made_of_what_lay_in_the_queue() {
    for name in ["woodenhaptics-v15", "hapkit"] {
        let (mut arm, mut board, _lost) = attached(name, Timebase::Counted);
        for _ in 0..50 {
            exchange(&mut arm, &mut board, &Wrench::ZERO).expect(name);
        }
        let before = arm.read().expect(name);
        // The host sleeps, the grip moves.
        for _ in 0..300 {
            board.reading += 0.02;
            board.advance(true);
        }
        arm.n_reads += 300;
        let sample = exchange(&mut arm, &mut board, &Wrench::ZERO).expect(name);
        assert_eq!(
            (sample.status, sample.pose, sample.sequence),
            (SampleStatus::Stale, before.pose, before.sequence),
            "{name}"
        );
        let sample = exchange(&mut arm, &mut board, &Wrench::ZERO).expect(name);
        assert_eq!((sample.status, sample.lost_packets), (SampleStatus::Fresh, 0), "{name}");
        let there = sample.pose;
        let sample = exchange(&mut arm, &mut board, &Wrench::ZERO).expect(name);
        assert_eq!(
            (sample.status, sample.pose),
            (SampleStatus::Fresh, there),
            "{name}: that was where it is"
        );
    }
}

/// The reply that lay there is old, and the arm that waits for the next command has to get it.
#[test]
fn after_a_stall_an_arm_that_answers_is_asked_again() {
    let (mut arm, mut board, _lost) = attached("polhem-2022", Timebase::Counted);
    arm.set_enabled(true);
    for _ in 0..50 {
        exchange(&mut arm, &mut board, &PUSH).expect("there");
    }
    arm.n_reads += 300;
    let sample = exchange(&mut arm, &mut board, &PUSH).expect("there");
    assert_eq!(sample.status, SampleStatus::Stale);
    assert_eq!(exchange(&mut arm, &mut board, &PUSH).expect("there").status, SampleStatus::Fresh);
}

/// A thread of the link may bring the backlog after the first read.
#[test]
fn after_a_stall_a_backlog_that_comes_late_is_old_too() {
    let (mut arm, mut board, _lost) = attached("woodenhaptics-v15", Timebase::Counted);
    arm.io = IoPlacement::OwnThread;
    for _ in 0..50 {
        exchange(&mut arm, &mut board, &Wrench::ZERO).expect("there");
    }
    arm.n_reads += 300;
    let mut fresh_after = 0;
    while exchange(&mut arm, &mut board, &Wrench::ZERO).expect("there").status
        != SampleStatus::Fresh
    {
        fresh_after += 1;
    }
    assert!((5..=7).contains(&fresh_after), "{fresh_after}");
}

/// More than is taken in one tick is still there, and older than what comes behind it.
#[test]
fn what_cannot_be_read_to_its_end_is_no_sample() {
    let (mut arm, mut board, _lost) = attached("woodenhaptics-v15", Timebase::Counted);
    arm.read().expect("there");
    for _ in 0..READS_MAX + 8 {
        board.advance(true);
    }
    assert_eq!(arm.read().expect("there").status, SampleStatus::Stale);
    assert_eq!(arm.read().expect("there").status, SampleStatus::Fresh);
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    /// Whatever the arm goes on to say: what it has not read when it wakes is bounded, it is reported
    /// lost, and the last thing that it reads is a zero.
    #[test]
    fn an_arm_that_sends_and_does_not_read_is_lost_with_a_bounded_number_of_forces_unread(
        name in prop::sample::select(vec!["hapkit", "woodenhaptics-v15", "polhem-2022"]),
        pushes_for in 1_u32..80,
        forces_n in prop::collection::vec(0.1..0.4, 1..8),
    ) {
        let (mut arm, mut board, mut lost) = attached(name, Timebase::Counted);
        board.end.show_unread();
        arm.set_enabled(true);
        for _ in 0..pushes_for {
            exchange(&mut arm, &mut board, &PUSH).expect(name);
        }
        let mut ticks = 0;
        let error = loop {
            ticks += 1;
            // A link that brings reports which no command asked for.
            arm.owes_reply = false;
            board.advance(true);
            let ended = arm.read().and_then(|_| {
                let force_n = forces_n[ticks % forces_n.len()];
                arm.write(&Wrench::new(DVec3::new(force_n, force_n, 0.0), DVec3::ZERO))
            });
            if let Err(error) = ended {
                break error;
            }
            prop_assert!(ticks < 1000, "{} is never lost", name);
        };
        prop_assert_eq!(error, DeviceError::Lost);
        let mut frames = Vec::new();
        let mut buffer = [0; 256];
        while let Ok(n @ 1..) = board.end.receive(&mut buffer) {
            frames.push(buffer[..n].to_vec());
        }
        // 20 ms of commands, and the zeros of the loss; a stream comes in one piece.
        let n_bytes: usize = frames.iter().map(Vec::len).sum();
        prop_assert!(frames.len() <= 23 && n_bytes <= 23 * 70, "{} frames", frames.len());
        for frame in frames {
            board.firmware.receive(&frame, board.now_s, &board.readings(), &mut Outbox::new());
        }
        prop_assert!(!board.is_driven());
        prop_assert!(lost.spent.pop().is_ok(), "the reconnect thread has the link");
    }

    /// Each frame that moves something leaves after the guard was told that force is on.
    #[test]
    fn the_guard_hears_of_a_force_before_the_arm_does(
        name in prop::sample::select(vec!["hapkit", "polhem-2022", "woodenhaptics-v15"]),
        forces in prop::collection::vec(prop::sample::select(vec![0.0, 0.0, 0.3, -0.2]), 1..60),
    ) {
        let profile = profile::find(name, std::path::Path::new("")).expect(name);
        let (guard, page) = Guard::of_test();
        let page = Arc::new(page);
        let sent = Arc::new(Mutex::new(Vec::new()));
        let witness = |host| -> Box<dyn Transport> {
            Box::new(Witness { host, page: page.clone(), sent: sent.clone() })
        };
        let (mut arm, mut board, _lost) =
            attached_with(&profile, Timebase::Counted, witness, Some(guard));
        let mut judge = profile.real.as_ref().expect("real").protocol.firmware(
            profile.real.as_ref().expect("real").matching.transport.carriage(),
        );
        arm.set_enabled(true);
        for force in &forces {
            let push = Wrench::new(DVec3::new(*force, *force, 0.0), DVec3::ZERO);
            exchange(&mut arm, &mut board, &push).expect(name);
            page.words()[2].fetch_add(1, Ordering::Relaxed);
        }
        let mut n_forced = 0;
        for SentFrame { bytes, beats } in sent.lock().expect("no panic").iter() {
            judge.receive(bytes, 0.0, &board.readings(), &mut Outbox::new());
            if judge.motors() != [0.0; MAX_AXES] {
                n_forced += 1;
                prop_assert_eq!(beats & 1, 1, "{}: a force that the guard has not heard of", name);
            }
        }
        prop_assert!(n_forced > 0 || forces.iter().all(|force| *force == 0.0));
    }
}

/// The host's end of a link that writes down what its guard had been told when a frame left.
struct Witness {
    host: LoopbackEnd,
    page: Arc<SharedPage>,
    sent: Arc<Mutex<Vec<SentFrame>>>,
}

struct SentFrame {
    bytes: Vec<u8>,
    /// What the guard had been told.
    beats: u64,
}

impl Transport for Witness {
    fn receive(&mut self, buffer: &mut [u8]) -> Result<usize, TransportError> {
        self.host.receive(buffer)
    }

    fn send(&mut self, frame: &[u8]) -> Result<(), TransportError> {
        let beats: &AtomicU64 = &self.page.words()[0];
        let sent = SentFrame { bytes: frame.to_vec(), beats: beats.load(Ordering::Relaxed) };
        self.sent.lock().expect("no panic").push(sent);
        self.host.send(frame)
    }

    fn unread(&mut self) -> usize {
        self.host.unread()
    }
}

#[test]
fn force_ends_when_its_guard_looks_no_more_and_does_not_begin_without_one() {
    let profile = profile::find("hapkit", std::path::Path::new("")).expect("shipped");
    let guarded = || {
        let (guard, page) = Guard::of_test();
        let (mut arm, board, lost) =
            attached_with(&profile, Timebase::Counted, |host| Box::new(host), Some(guard));
        arm.set_enabled(true);
        (arm, board, lost, page)
    };
    let (mut arm, mut board, mut lost, page) = guarded();
    for tick in 0..1000 {
        // Every fifth tick, and once it comes late.
        if tick % 5 == 0 && !(300..480).contains(&tick) {
            page.words()[2].fetch_add(1, Ordering::Relaxed);
        }
        exchange(&mut arm, &mut board, &PUSH).expect("it is watched");
    }
    assert!(board.is_driven());
    let ends = (0..1000).find(|_| exchange(&mut arm, &mut board, &PUSH).is_err());
    assert!((180..=195).contains(&ends.expect("it is not watched any more")), "{ends:?}");
    board.listen();
    assert!(!board.is_driven(), "a zero is the last that it reads");
    assert!(lost.spent.pop().expect("given away").has_lost_guard());
    // One that was missing before force was on.
    let (mut arm, mut board, _lost, _page) = guarded();
    for _ in 0..500 {
        exchange(&mut arm, &mut board, &Wrench::ZERO).expect("no force needs no guard");
    }
    assert_eq!(exchange(&mut arm, &mut board, &PUSH), Err(DeviceError::Lost));
    board.listen();
    assert!(!board.is_driven());
}

/// An open6 arm that declares its own limits.
fn declares(change: impl FnOnce(&mut crate::protocol::Open6Arm)) -> Box<dyn Codec> {
    let profile = profile::find("open6-serial", std::path::Path::new("")).expect("shipped");
    let mut declared = crate::mock::builder::open6(&profile);
    change(&mut declared);
    let (mut host, mut end) = loopback(Carriage::Stream);
    let arm = std::thread::spawn(move || {
        let mut firmware = Protocol::Open6(declared).firmware(Carriage::Stream);
        let readings = ArmReadings {
            readings: [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0],
            rates: [0.0; MAX_AXES],
            buttons: 0,
            homed: true,
            asleep: false,
        };
        let mut buffer = [0; 256];
        let mut out = Outbox::new();
        while out.is_empty() {
            let n = end.receive(&mut buffer).expect("open");
            firmware.receive(&buffer[..n], 0.0, &readings, &mut out);
            std::thread::sleep(Duration::from_micros(100));
        }
        end.send(&out[0]).expect("open");
    });
    let mut codec = profile.real.as_ref().expect("real").protocol.codec(Carriage::Stream);
    codec.start(&mut host).expect("it answers");
    arm.join().expect("no panic");
    codec
}

#[test]
fn of_the_profile_and_what_an_arm_declares_the_lower_number_holds() {
    let profile = profile::find("open6-serial", std::path::Path::new("")).expect("shipped");
    let real = profile.real.as_ref().expect("real");
    let parameters = wired_parameters(&profile, real, PERIOD_S, IoPlacement::InLoop);
    let held = |codec: &dyn Codec| {
        let mut held = parameters.clone();
        held.hold_to(ArmLimits::of(&parameters).lowered_by(codec));
        held
    };
    let [force_n, torque_nm] = [profile.limits.force_n, profile.limits.torque_nm];
    let unverified = profile.unverified_limits();

    let less = declares(|arm| {
        arm.force_n = 0.25;
        arm.torque_nm = 0.001;
        arm.watchdog_ms = 20;
    });
    let lower = held(&*less);
    assert_eq!([lower.limits.force_n, lower.unverified_limits.force_n], [0.25; 2]);
    assert!((lower.limits.torque_nm - 0.001).abs() < 1e-9);
    assert_eq!(lower.capabilities.watchdog_ms, Some(20));
    let notice = judge_declared(&*less, parameters.limits, PERIOD_S).expect("can be met");
    let notice = notice.expect("it is said");
    assert!(
        notice.contains(&format!("limits.force_n = {force_n}, the arm declares 0.2500 N")),
        "{notice}"
    );

    let more = declares(|arm| {
        arm.force_n = 40.0;
        arm.torque_nm = 4.0;
    });
    let same = held(&*more);
    assert_eq!([same.limits.force_n, same.limits.torque_nm], [force_n, torque_nm]);
    assert_eq!(same.unverified_limits.force_n, unverified.force_n);
    assert_eq!(judge_declared(&*more, parameters.limits, PERIOD_S), Ok(None));
    // What the wire rounds is not lower.
    let rounded = declares(|arm| arm.force_n = f32::from_bits((force_n as f32).to_bits() - 1));
    assert_eq!(held(&*rounded).limits.force_n, force_n);
}

#[test]
fn an_arm_that_declares_what_the_loop_cannot_meet_is_refused_with_both_numbers() {
    let profile = profile::find("open6-serial", std::path::Path::new("")).expect("shipped");
    let limits = profile.limits.of_motors();
    let refused = |codec: Box<dyn Codec>, rate_hz: f64| {
        judge_declared(&*codec, limits, 1.0 / rate_hz).expect_err("refused").to_string()
    };
    let slow = refused(declares(|arm| arm.rate_hz = 500), 1000.0);
    assert!(slow.contains("500 Hz") && slow.contains("1000 Hz"), "{slow}");
    assert!(slow.contains("write 500 or less as rendering.rate_hz"), "{slow}");
    assert!(judge_declared(&*declares(|arm| arm.rate_hz = 500), limits, 2e-3).is_ok());
    let short = refused(declares(|arm| arm.watchdog_ms = 3), 500.0);
    assert!(
        short.contains("3 ms") && short.contains("500 Hz") && short.contains("4.0 ms"),
        "{short}"
    );
    let none = refused(declares(|arm| arm.force_n = f32::NAN), 1000.0);
    assert!(none.contains("NaN N"), "{none}");
}
