//! The driver at a link in memory.

use rtrb::RingBuffer;

use super::*;
use crate::attached::open::wired_parameters;
use crate::profile::{self, TransportKind};
use crate::protocol::{ArmReadings, Firmware, Outbox};
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
        Connection { link: Box::new(host), codec: real.protocol.codec(carriage), guard: Ok(None) };
    let parameters = WiredParameters {
        timebase,
        ..wired_parameters(&profile, real, PERIOD_S, IoPlacement::InLoop)
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
