//! Every host against its arm: what goes in comes out, in any pieces; no bytes do harm.

use std::cell::RefCell;

use proptest::prelude::*;
use proptest::test_runner::{Config, TestRunner};

use super::*;
use crate::Pacing;
use crate::protocol::layout::*;

/// Layouts of every framing, checksum and role.
pub(super) fn layouts() -> Vec<PacketLayout> {
    let numbers = |number: Number,
                   step: usize,
                   n: usize,
                   scale: f64,
                   role: fn(usize) -> Role|
     -> Vec<Field> {
        (0..n).map(|idx| Field { scale, ..Field::new(role(idx), step * idx, number) }).collect()
    };
    let check = |kind| Some(Checksum { kind, big_endian: false });
    let packet = |framing, checksum, fields: Vec<Field>| Packet { framing, checksum, fields };
    let layout = |report, command, pacing| PacketLayout {
        name: "declarative",
        report,
        command: Some(command),
        kick: None,
        pacing,
        watchdog_ms: Some(100),
    };

    let mut hid = numbers(Number::I16, 2, 3, 1.0, Role::Reading);
    hid.iter_mut().for_each(|field| field.wraps = true);
    hid.push(Field::new(Role::Counter, 6, Number::U16));
    let hid = layout(
        packet(Framing::Report { id: None, len: 8 }, None, hid),
        packet(
            Framing::Report { id: None, len: 8 },
            None,
            numbers(Number::I16, 2, 3, 1.0, Role::Motor),
        ),
        Pacing::Stream,
    );

    let mut numbered = numbers(Number::I32, 4, 2, 1.0, Role::Reading);
    numbered.iter_mut().for_each(|field| field.big_endian = true);
    numbered.extend([
        Field { mask: Some(0x0F), ..Field::new(Role::Buttons(0), 8, Number::U8) },
        Field { mask: Some(0x80), ..Field::new(Role::Homed, 8, Number::U8) },
        Field { mask: Some(0x70), ..Field::new(Role::Constant(5), 8, Number::U8) },
        Field::new(Role::Error, 9, Number::U8),
    ]);
    let numbered = layout(
        packet(
            Framing::Report { id: Some(7), len: 12 },
            check(ChecksumKind::Crc16Modbus),
            numbered,
        ),
        packet(
            Framing::Report { id: Some(8), len: 8 },
            check(ChecksumKind::Xor8),
            vec![
                Field::new(Role::Motor(0), 0, Number::I32),
                Field::new(Role::Motor(1), 4, Number::I16),
                Field::new(Role::Enabled, 6, Number::U8),
            ],
        ),
        Pacing::Event,
    );

    let mut rates = numbers(Number::F32, 4, 3, 1.0, Role::Reading);
    rates.extend((0..3).map(|idx| Field::new(Role::Rate(idx), 12 + 4 * idx, Number::F32)));
    let sync = |len, covers_sync| Framing::Sync { sync: vec![0xAA, 0x55], len, covers_sync };
    let crc = Some(Checksum { kind: ChecksumKind::Crc16Ccitt, big_endian: true });
    let synced = layout(
        packet(sync(26, true), crc, rates),
        packet(
            sync(10, false),
            check(ChecksumKind::Crc8),
            numbers(Number::I16, 2, 4, 1.0, Role::Motor),
        ),
        Pacing::PingPong,
    );
    let cobs = layout(
        packet(
            Framing::Cobs { len: 36 },
            check(ChecksumKind::Crc32),
            numbers(Number::F64, 8, 4, 1.0, Role::Reading),
        ),
        packet(
            Framing::Cobs { len: 12 },
            check(ChecksumKind::Crc32),
            numbers(Number::F32, 4, 2, 1.0, Role::Motor),
        ),
        Pacing::PingPong,
    );
    let slip = layout(
        packet(
            Framing::Slip { len: 5 },
            check(ChecksumKind::Sum8),
            numbers(Number::I16, 2, 2, 1.0, Role::Reading),
        ),
        packet(
            Framing::Slip { len: 3 },
            check(ChecksumKind::Sum8),
            numbers(Number::I16, 2, 1, 1.0, Role::Motor),
        ),
        Pacing::PingPong,
    );

    let line = |open: &str, separator, close: &str, pad| {
        Framing::Line(LineFraming {
            open: open.to_owned(),
            separator,
            close: close.to_owned(),
            pad,
        })
    };
    let whole = Number::Text { places: 0 };
    let mut brackets =
        vec![Field::new(Role::Constant(3), 0, whole), Field::new(Role::Error, 7, whole)];
    brackets.extend((0..6).map(|idx| Field::new(Role::Reading(idx), idx + 1, whole)));
    let brackets = PacketLayout {
        kick: Some(hex("5B 30 2C 30 2C 30 5D 00 00 00 00 00 00 00 00 00")),
        watchdog_ms: None,
        ..layout(
            packet(line("[", b',', "]", None), None, brackets),
            packet(
                line("[", b',', "]\n", Some(LinePad { byte: 0, len: 16, before_close: false })),
                None,
                numbers(whole, 1, 3, 1.0, Role::Motor),
            ),
            Pacing::PingPong,
        )
    };
    let tenths = Number::Text { places: 4 };
    let words = layout(
        packet(
            line("Prm ", b' ', "\n", None),
            None,
            vec![
                Field::new(Role::Reading(0), 0, tenths),
                Field::new(Role::Rate(0), 1, tenths),
                Field::new(Role::Ignored, 2, tenths),
                Field::new(Role::Buttons(0), 3, whole),
            ],
        ),
        packet(
            line("", b' ', "\n", Some(LinePad { byte: b' ', len: 64, before_close: true })),
            None,
            numbers(tenths, 1, 1, 1.0, Role::Motor),
        ),
        Pacing::Stream,
    );
    vec![hid, numbered, synced, cobs, slip, brackets, words]
}

/// What a step of a reading and of a motor is, so that the wire carries it exactly or nearly.
fn steps(protocol: &Protocol) -> (f64, f64) {
    match protocol {
        Protocol::HapiF32(_) => (360.0 / 13824.0, 1e-4),
        Protocol::HapkitAscii => (1e-5, 1e-5),
        Protocol::Open6(_) => (1e-5, 1e-4),
        _ => (1.0, 1.0),
    }
}

#[test]
fn what_goes_in_comes_out_at_the_other_end() {
    for (protocol, carriage) in every_protocol() {
        protocol.check().expect("sound");
        let (reading_step, motor_step) = steps(&protocol);
        let n_readings = protocol.n_readings();
        let n_motors = protocol.n_motors();
        let mut codec = protocol.codec(carriage);
        let mut link = Linked::new(protocol.firmware(carriage), carriage, arm_at(&[1.0; 6]));
        if matches!(protocol, Protocol::Open6(_)) {
            link.arm = arm_at(&[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]);
        }
        codec.start(&mut link).unwrap_or_else(|error| panic!("{}: {error}", protocol.name()));
        link.take();
        codec.resume();
        let state = RefCell::new((codec, link));
        let values = (
            proptest::array::uniform8(-900..=900_i32),
            proptest::array::uniform8(-900..=900_i32),
            0..4_u32,
        );
        let case = |(readings, motors, buttons): ([i32; 8], [i32; 8], u32)| {
            let (codec, link) = &mut *state.borrow_mut();
            for (idx, reading) in link.arm.readings.iter_mut().enumerate() {
                *reading =
                    if idx < n_readings { f64::from(readings[idx]) * reading_step } else { 0.0 };
            }
            let mut want_motors = [0.0; MAX_AXES];
            for (motor, count) in want_motors[..n_motors].iter_mut().zip(motors) {
                *motor = f64::from(count) * motor_step;
            }
            link.arm.buttons = buttons;
            if let Protocol::Open6(_) = protocol {
                // A unit quaternion; no motor at the grip.
                let half = 0.001 * f64::from(readings[3]);
                link.arm.readings[3..7].copy_from_slice(&[half.sin(), 0.0, 0.0, half.cos()]);
                want_motors[6] = 0.0;
            }
            let fed = link.exchange(&mut **codec, &want_motors, true);
            prop_assert_eq!((fed.corrupt, fed.gap, fed.repeated), (0, 0, 0));
            if protocol.pacing() != Pacing::Event {
                prop_assert_eq!(fed.reports, 1);
            }
            let report = codec.newest();
            for (found, want) in report.readings.iter().zip(link.arm.readings) {
                prop_assert!(
                    (found - want).abs() <= 1e-6 * (1.0 + want.abs()),
                    "{}: reading {found} for {want}",
                    protocol.name()
                );
            }
            for (found, want) in link.firmware.motors().iter().zip(want_motors) {
                // Toward zero, and at most one step.
                let near = (found - want).abs() <= motor_step.min(1e-4) + 1e-7
                    && found.abs() <= want.abs() + 1e-7;
                prop_assert!(near, "{}: motor {found} for {want}", protocol.name());
            }
            prop_assert_eq!(report.echo, codec.sequence());
            Ok(())
        };
        TestRunner::new(Config { cases: 200, failure_persistence: None, ..Config::default() })
            .run(&values, case)
            .unwrap_or_else(|error| panic!("{}: {error}", protocol.name()));
        let (codec, link) = &mut *state.borrow_mut();
        // The zero command is zero, and force stays off without enable where the arm knows such a
        // thing.
        link.exchange(&mut **codec, &[], false);
        assert_eq!(link.firmware.motors(), [0.0; MAX_AXES], "{}", protocol.name());
    }
}

#[test]
fn streams_may_be_cut_anywhere() {
    for (protocol, carriage) in
        every_protocol().into_iter().filter(|(_, carriage)| *carriage == Carriage::Stream)
    {
        let mut link = Linked::new(
            protocol.firmware(carriage),
            carriage,
            arm_at(&[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]),
        );
        let mut codec = protocol.codec(carriage);
        codec.start(&mut link).expect("an arm");
        link.take();
        let mut stream = Vec::new();
        for n in 1..=20 {
            link.arm.readings[0] = f64::from(n);
            link.now_s += 1e-3;
            let frame = encode(&mut *codec, &[]);
            link.here.send(&frame).expect("open");
            link.pump();
            stream.extend(link.take().concat());
        }
        let whole = {
            let mut codec = protocol.codec(carriage);
            let fed = codec.feed(&stream);
            (fed.reports, fed.corrupt, *codec.newest())
        };
        assert!(
            whole.0 == 20 && whole.1 == 0 && whole.2.readings[0] == 20.0,
            "{}: {whole:?}",
            protocol.name()
        );
        for size in [1, 2, 3, 5, 7, 11, 13, 31, 64, 100] {
            let mut codec = protocol.codec(carriage);
            let reports: u32 = stream.chunks(size).map(|chunk| codec.feed(chunk).reports).sum();
            assert_eq!(
                (reports, codec.newest()),
                (20, &whole.2),
                "{} in pieces of {size}",
                protocol.name()
            );
        }
    }
}

proptest! {
    #![proptest_config(Config { cases: 300, failure_persistence: None, ..Config::default() })]

    #[test]
    fn no_bytes_do_harm(bytes in proptest::collection::vec(any::<u8>(), 0..700), size in 1..80_usize, letters in any::<bool>()) {
        // Text protocols come further on text.
        let bytes: Vec<u8> = if letters { bytes.iter().map(|byte| b"[]<>PrmA0123456789,- \n\x00\xFF\xFD"[usize::from(*byte) % 25]).collect() } else { bytes };
        for (protocol, carriage) in every_protocol() {
            let mut codec = protocol.codec(carriage);
            let mut firmware = protocol.firmware(carriage);
            let mut out = Outbox::new();
            for chunk in bytes.chunks(size) {
                codec.feed(chunk);
                prop_assert!(codec.newest().readings.iter().all(|reading| reading.is_finite()), "{}", protocol.name());
                firmware.receive(chunk, 0.0, &arm_at(&[f64::NAN, 1e300, -1e300, f64::INFINITY, 0.0, 1.0]), &mut out);
                prop_assert!(firmware.motors().iter().all(|motor| motor.is_finite()), "{}", protocol.name());
                let frame = encode_enabled(&mut *codec, &[f64::NAN, f64::INFINITY, 1e300, -1e300, 1e-300, -0.0, f64::NAN, 1.0], true);
                prop_assert!(frame.len() <= 256);
            }
            firmware.advance(1.0, &arm_at(&[]), &mut out);
        }
    }
}

#[test]
fn watchdogs_of_the_arms_are_theirs() {
    for (protocol, carriage) in every_protocol() {
        let Some(watchdog) = protocol.watchdog() else { continue };
        let mut link = Linked::new(
            protocol.firmware(carriage),
            carriage,
            arm_at(&[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]),
        );
        let mut codec = protocol.codec(carriage);
        codec.start(&mut link).expect("an arm");
        link.take();
        codec.resume();
        let motors = [if matches!(protocol, Protocol::Open6(_)) { 0.25 } else { 9.0 }];
        link.exchange(&mut *codec, &[], false);
        link.exchange(&mut *codec, &motors, true);
        assert!(link.firmware.motors()[0] > 0.2, "{}", protocol.name());
        link.now_s += watchdog.as_secs_f64() - 1e-3;
        link.pump();
        assert!(link.firmware.motors()[0] > 0.2, "{}: not yet", protocol.name());
        link.now_s += 2e-3;
        link.pump();
        assert_eq!(link.firmware.motors(), [0.0; MAX_AXES], "{}", protocol.name());
        // Latched or not, the next command shows it.
        link.exchange(&mut *codec, &motors, true);
        let latched = matches!(protocol, Protocol::Open6(_) | Protocol::Dynamixel2 { .. });
        assert_eq!(link.firmware.motors()[0] == 0.0, latched, "{}", protocol.name());
        if matches!(protocol, Protocol::Open6(_)) {
            assert_eq!(codec.newest().error, open6::WATCHDOG_TRIPPED);
        }
        // What wakes it again moves nothing.
        let mut kick = Frame::default();
        assert!(codec.kick(&mut kick));
        link.here.send(kick.as_slice()).expect("open");
        link.pump();
        link.take();
        assert_eq!(link.firmware.motors(), [0.0; MAX_AXES], "{}", protocol.name());
        codec.resume();
        link.exchange(&mut *codec, &[], false);
        link.exchange(&mut *codec, &motors, true);
        assert!(
            link.firmware.motors()[0] > 0.2 && codec.newest().error == 0,
            "{}: awake again",
            protocol.name()
        );
    }
}

#[test]
fn described_frames_are_those_that_were_described() {
    let layouts = layouts();
    // Whole numbers, singles, four places; scaled, and of two sizes.
    let steps = [0, 3, 6].map(|idx: usize| layouts[idx].motor_step());
    assert_eq!(steps, [1.0, 0.0, 1e-4]);
    let mut scaled = layouts[0].clone();
    for (n_scaled, expected) in [(2, 0.0), (3, 0.25)] {
        let command = scaled.command.as_mut().expect("there");
        command.fields[..n_scaled].iter_mut().for_each(|field| field.scale = -0.25);
        assert_eq!(scaled.motor_step(), expected);
    }
    let golden = |idx: usize, motors: &[f64], command: &str, readings: &[f64], report: &str| {
        let protocol = Protocol::Declarative(layouts[idx].clone());
        let carriage = protocol.carriages()[0];
        let mut codec = protocol.codec(carriage);
        let frame = encode_enabled(&mut *codec, motors, true);
        assert_eq!(show(&frame), command, "layout {idx}");
        let mut link = Linked::new(protocol.firmware(carriage), carriage, arm_at(readings));
        link.arm.buttons = 0b1010;
        link.here.send(&frame).expect("open");
        link.pump();
        let bytes = link.take().concat();
        assert_eq!(show(&bytes), report, "layout {idx}");
        assert_eq!(codec.feed(&bytes), fed(1, 0));
        assert_eq!(codec.newest().readings[..readings.len()], *readings);
        // One bit wrong anywhere in the body is noticed.
        for at in 1..bytes.len() - 1 {
            let mut bad = bytes.clone();
            bad[at] ^= 4;
            let mut codec = protocol.codec(carriage);
            assert_eq!(codec.feed(&bad).reports, 0, "layout {idx}, byte {at}");
        }
    };
    // Checks computed with another program.
    golden(
        1,
        &[258.0, -2.0],
        "08 02 01 00 00 FE FF 01 03",
        &[258.0, -2.0],
        "07 00 00 01 02 FF FF FF FE DA 00 98 94",
    );
    golden(
        2,
        &[258.0, -2.0],
        "AA 55 02 01 FE FF 00 00 00 00 00 D5",
        &[1.0],
        "AA 55 00 00 80 3F 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 00 47 83",
    );
    golden(
        3,
        &[1.0],
        "01 01 03 80 3F 01 01 01 05 E6 E4 E3 58 00",
        &[1.0, -2.0],
        "01 01 01 01 01 01 03 F0 3F 01 01 01 01 01 01 02 C0 01 01 01 01 01 01 01 01 01 01 01 01 01 \
            01 01 05 F1 B9 3A 47 00",
    );
    golden(4, &[-16_192.0], "DB DC DB DC 80 C0", &[192.0, 219.0], "DB DC 00 DB DD 00 9B C0");
}

#[test]
fn layouts_that_cannot_be_spoken_are_refused_with_the_reason() {
    let good = layouts();
    for layout in &good {
        layout.check().expect("sound");
    }
    let refused = |change: &dyn Fn(&mut PacketLayout), idx: usize, expected: &str| {
        let mut layout = good[idx].clone();
        change(&mut layout);
        let text = layout.check().expect_err(expected).to_string();
        assert!(text.contains(expected), "{text:?} does not say {expected:?}");
    };
    refused(&|layout| layout.report.fields.clear(), 0, "0 fields");
    refused(&|layout| layout.report.fields[0].role = Role::Motor(0), 0, "does not belong");
    refused(&|layout| layout.report.fields[0].role = Role::Reading(8), 0, "the largest is 7");
    refused(&|layout| layout.report.fields[0].role = Role::Reading(5), 0, "without a hole");
    refused(&|layout| layout.report.fields[0].role = Role::Reading(1), 0, "there twice");
    refused(&|layout| layout.report.fields[0].offset = 7, 0, "behind the body");
    refused(&|layout| layout.report.fields[0].offset = usize::MAX, 0, "behind the body");
    refused(&|layout| layout.report.fields[0].scale = 0.0, 0, "other than 0");
    refused(&|layout| layout.report.fields[0].scale = f64::NAN, 0, "other than 0");
    refused(&|layout| layout.report.fields[0].limit = Some(1.0), 0, "only for motors");
    let limited = |limit| {
        move |layout: &mut PacketLayout| {
            let command = layout.command.as_mut().expect("there");
            command.fields[0].limit = Some(limit);
        }
    };
    for limit in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        refused(&limited(limit), 0, "a number above 0");
    }
    refused(
        &|layout| layout.report.fields[0].number = Number::Text { places: 0 },
        0,
        "text is for lines",
    );
    refused(&|layout| layout.report.fields[3].number = Number::I16, 0, "a counter is u8");
    refused(&|layout| layout.report.fields[3].wraps = true, 0, "only a reading");
    refused(&|layout| layout.report.framing = Framing::Slip { len: 8 }, 0, "one link");
    refused(
        &|layout| layout.report.framing = Framing::Report { id: None, len: 121 },
        0,
        "at most 120",
    );
    refused(&|layout| layout.kick = Some(vec![]), 0, "kick");
    let pushing = |layout: &mut PacketLayout| {
        let mut codec = Protocol::Declarative(layout.clone()).codec(Carriage::Stream);
        layout.kick = Some(encode_enabled(&mut *codec, &[3.0], true));
    };
    refused(&pushing, 0, "moves a motor");
    refused(&|layout| layout.report.fields[2].mask = Some(0x105), 1, "mask 0x105");
    refused(&|layout| layout.report.fields[2].mask = Some(0x05), 1, "has a hole");
    refused(&|layout| layout.report.fields[4].role = Role::Constant(8), 1, "does not fit its mask");
    refused(&|layout| layout.report.fields[2].role = Role::Buttons(32), 1, "the largest is 31");
    refused(
        &|layout| {
            layout.report.framing = Framing::Sync { sync: vec![], len: 26, covers_sync: false }
        },
        2,
        "0 sync bytes",
    );
    refused(&|layout| layout.report.fields[3].role = Role::Rate(7), 2, "no such reading");
    refused(&|layout| layout.report.fields[0].role = Role::Error, 2, "whole number");
    refused(
        &|layout| {
            layout.report.checksum = Some(Checksum { kind: ChecksumKind::Sum8, big_endian: false })
        },
        5,
        "lines have none",
    );
    refused(&|layout| layout.report.fields[0].offset = 1, 5, "two meanings");
    refused(&|layout| layout.report.fields[0].role = Role::Constant(1 << 40), 5, "does not fit");
    let Framing::Line(line) = good[5].report.framing.clone() else { panic!("a line") };
    let with = |change: &dyn Fn(&mut LineFraming)| {
        let mut line = line.clone();
        change(&mut line);
        Framing::Line(line)
    };
    refused(&|layout| layout.report.framing = with(&|line| line.close.clear()), 5, "close");
    refused(
        &|layout| layout.report.framing = with(&|line| line.separator = b'1'),
        5,
        "cannot be distinguished",
    );
    refused(&|layout| layout.report.framing = with(&|line| line.open = "«".to_owned()), 5, "ASCII");

    for (protocol, expected) in [
        (Protocol::Dynamixel2 { servos: vec![] }, "0 servos"),
        (
            Protocol::Dynamixel2 { servos: vec![Servo { id: 1, model: ServoModel::Xc330T288 }; 2] },
            "there twice",
        ),
        (
            Protocol::HapiF32(HapiBoard { device_id: 5, motors: vec![], encoders: vec![] }),
            "0 motors",
        ),
        (Protocol::Open6(Open6Arm { watchdog_ms: 0, ..open6_arm() }), "watchdog of 0"),
    ] {
        let text = protocol.check().expect_err(expected).to_string();
        assert!(text.contains(expected), "{text:?} does not say {expected:?}");
    }
}
