//! Golden frames and the list of malformed inputs.

use super::*;

/// A1–A4, and what is malformed.
#[test]
fn woodenhaptics_hid8() {
    let protocol = shipped("woodenhaptics-v15");
    let mut host = protocol.codec(Carriage::Reports);
    let mut arm = protocol.firmware(Carriage::Reports);
    let a1 = hex("64 00 38 FF 2C 01 07 00");
    assert_eq!(host.feed(&a1), fed(1, 0));
    assert_eq!(host.newest().readings[..4], [100.0, -200.0, 300.0, 0.0]);
    let mut out = Outbox::new();
    for _ in 0..7 {
        arm.advance(0.0, &arm_at(&[100.0, -200.0, 300.0]), &mut out);
    }
    assert_eq!(out[6], a1);

    for (motors, golden) in [
        ([0.0, 0.0, 0.0], "00 00 00 00 00 00 00 00 00"),
        ([250.9, -250.9, 1000.0], "00 FA 00 06 FF E8 03 00 00"),
        ([3000.0, -3000.0, 3000.0], "00 B8 0B 48 F4 B8 0B 00 00"),
    ] {
        let frame = encode(&mut *host, &motors);
        assert_eq!(show(&frame), golden);
        // With and without the 0 that stands for "no report ID".
        for frame in [&frame[..], &frame[1..]] {
            arm.receive(frame, 0.0, &arm_at(&[]), &mut out);
            assert_eq!(arm.motors()[..3], motors.map(f64::trunc));
        }
    }
    assert_eq!(
        encode(&mut *host, &[f64::NAN, 1e9, f64::NEG_INFINITY]),
        hex("00 00 00 FF 7F 01 80 00 00")
    );

    assert_eq!(host.feed(&a1[..7]), fed(0, 1));
    assert_eq!(host.feed(&[&a1[..], &[0]].concat()), fed(0, 1));
    assert_eq!(host.feed(&a1), FeedCounts { reports: 1, repeated: 1, ..FeedCounts::default() });
    assert_eq!(
        host.feed(&hex("64 00 38 FF 2C 01 0A 00")),
        FeedCounts { reports: 1, gap: 2, ..FeedCounts::default() }
    );
    // Over the end of 16 bits, there and back.
    for (count, low) in [
        (30_000, "30 75"),
        (40_000, "40 9C"),
        (30_000, "30 75"),
        (0, "00 00"),
        (-30_000, "D0 8A"),
        (-40_000, "C0 63"),
    ] {
        host.feed(&hex(&format!("{low} 00 00 00 00 00 00")));
        assert_eq!(host.newest().readings[0], f64::from(count));
    }
}

/// B1–B4.
#[test]
fn haptikfabriken_hid14() {
    let protocol = Protocol::HaptikfabrikenHid14 { carrier: Hid14Carrier::Mbed };
    let mut host = protocol.codec(Carriage::Reports);
    let mut firmware = protocol.firmware(Carriage::Reports);
    let b1 = hex("64 00 38 FF 2C 01 04 00 FB FF 06 00 00 00");
    let b2 = hex("64 00 38 FF 2C 01 14 27 FB FF 06 00 01 00");
    // D ← f, E ← e, F ← d.
    let readings = [100.0, -200.0, 300.0, 6.0, -5.0, 4.0];
    for (bytes, buttons) in [(&b1, 0), (&b2, 3), (&b1, 0)] {
        assert_eq!(host.feed(bytes), fed(1, 0));
        assert_eq!((&host.newest().readings[..6], host.newest().buttons), (&readings[..], buttons));
    }
    let mut out = Outbox::new();
    let mut arm = arm_at(&readings);
    firmware.advance(0.0, &arm, &mut out);
    firmware.advance(0.001, &arm, &mut out);
    arm.buttons = 3;
    let b3 = encode(&mut *host, &[250.0, -250.0, 1000.0]);
    assert_eq!(show(&b3), "00 FA 00 06 FF E8 03 00 00 00 00 00 00 00 00");
    firmware.receive(&b3, 0.002, &arm, &mut out);
    assert_eq!(out, [b1.clone(), b2], "speaks once, then when spoken to");
    assert_eq!(firmware.motors()[..3], [250.0, -250.0, 1000.0]);

    assert_eq!(host.feed(&b1[..13]), fed(0, 1));
    assert_eq!(host.feed(&[&b1[..], &[0]].concat()), fed(0, 1));
    let raw_hid = Protocol::HaptikfabrikenHid14 { carrier: Hid14Carrier::TeensyRawHid };
    let mut host = raw_hid.codec(Carriage::Reports);
    assert_eq!(encode(&mut *host, &[250.0, -250.0, 1000.0]), [&b3[..], &[0; 50]].concat());
    assert_eq!(host.feed(&[&b1[..], &[0; 50]].concat()), fed(1, 0));
    assert_eq!(host.newest().readings[..6], readings);
    assert_eq!(host.feed(&b1), fed(0, 1));
}

/// C1, C3.
#[test]
fn polhem_ascii64() {
    let protocol = shipped("polhem-2020");
    let mut counts = protocol.codec(Carriage::Stream);
    let line = |text: &str, blanks: usize| format!("{text}{}\n", " ".repeat(blanks)).into_bytes();
    let c1 = line("0 0 0 0 0 0 0", 50);
    let c3 = line("8298 -10771 19756 0 30 0 0", 37);
    assert_eq!([c1.len(), c3.len()], [64, 64]);
    assert_eq!(encode(&mut *counts, &[0.0; 3]), c1);
    let home = [8298.0, -10771.0, 19756.0, 0.0, 30.0, 0.0];
    assert_eq!(counts.feed(&c3), fed(1, 0));
    assert_eq!(counts.newest().readings[..6], home);

    let mut firmware = protocol.firmware(Carriage::Stream);
    let mut out = Outbox::new();
    firmware.receive(&c1, 0.0, &arm_at(&home), &mut out);
    assert_eq!(out, std::slice::from_ref(&c3));
    // A line that is none does not feed the watchdog.
    firmware.receive(b"1 1 1 0 0 0 0\n\n", 0.05, &arm_at(&home), &mut out);
    assert_eq!(firmware.motors()[..3], [1.0; 3]);
    firmware.receive(b"2 2 2\n", 0.14, &arm_at(&home), &mut out);
    firmware.advance(0.16, &arm_at(&home), &mut out);
    assert_eq!(firmware.motors(), [0.0; MAX_AXES]);
    // Out of range is zero, not clamped; a host never asks for it.
    firmware.receive(b"6001 1 -6001 0 0 0 0\n", 0.17, &arm_at(&home), &mut out);
    assert_eq!(firmware.motors()[..3], [0.0, 1.0, 0.0]);
    assert_eq!(encode(&mut *counts, &[1e9, f64::NAN, -1e9]), line("6000 0 -6000 0 0 0 0", 43));

    malformed_lines(
        &mut *counts,
        &c3,
        &[
            "8298 -10771 19756 0 30 0\n",
            "1 2 3 4 5 6 7 8\n",
            "a b c d e f g\n",
            "1 2 3 4 5 6 4294967296\n",
        ],
    );
}

/// A good line, each bad one, the good one in pieces, and two at once.
fn malformed_lines(codec: &mut dyn Codec, good: &[u8], bad: &[&str]) {
    for line in bad {
        assert_eq!(codec.feed(line.as_bytes()), fed(0, 1), "{line:?}");
        assert_eq!(codec.feed(good).reports, 1, "after {line:?}");
    }
    assert_eq!(codec.feed(&[good, good].concat()), fed(2, 0));
    let third = good.len() / 3;
    assert_eq!(codec.feed(&good[..third]), fed(0, 0));
    assert_eq!(codec.feed(&good[third..2 * third]), fed(0, 0));
    assert_eq!(codec.feed(&good[2 * third..]), fed(1, 0));
    // Longer than any line.
    assert_eq!(codec.feed(&[b'1'; 4000]), fed(0, 0));
    assert_eq!(codec.feed(good), fed(0, 1));
    assert_eq!(codec.feed(good), fed(1, 0));
}

/// D1–D7.
#[test]
fn haptikfabriken_brackets() {
    let arm_of = |model| {
        shipped(["polhem-2022", "vintage-2022", "woodenhaptics-2022"][usize::from(model) - 1])
    };
    let codec = |model: u8| arm_of(model).codec(Carriage::Stream);
    let mut host = codec(3);
    let mut wake = Frame::default();
    assert!(host.kick(&mut wake));
    assert_eq!(show(wake.as_slice()), "5B 30 2C 30 2C 30 5D 00 00 00 00 00 00 00 00 00");
    for (motors, golden) in [
        ([0.0, 0.0, 0.0], "5B 30 2C 30 2C 30 5D 0A 00 00 00 00 00 00 00 00"),
        ([250.0, -250.0, 1000.0], "5B 32 35 30 2C 2D 32 35 30 2C 31 30 30 30 5D 0A"),
        ([-1999.0, 1999.0, -1999.0], "5B 2D 31 39 39 39 2C 31 39 39 39 2C 2D 31 39 39 39 5D 0A"),
    ] {
        assert_eq!(show(&encode(&mut *host, &motors)), golden);
    }
    let d5 = hex("5B 33 2C 31 30 30 2C 2D 32 30 30 2C 33 30 30 2C 30 2C 30 2C 30 2C 30 5D 0A");
    let d6 = hex("5B 31 2C 31 30 30 2C 2D 32 30 30 2C 33 30 30 2C 34 2C 2D 35 2C 36 2C 30 5D 0A");
    let d7 = hex("5B 32 2C 31 30 30 2C 2D 32 30 30 2C 33 30 30 2C 34 2C 2D 35 2C 36 2C 33 5D 0A");
    for (model, bytes, readings, error) in [
        (3, &d5, [100.0, -200.0, 300.0, 0.0, 0.0, 0.0], 0),
        (1, &d6, [100.0, -200.0, 300.0, 4.0, -5.0, 6.0], 0),
        (2, &d7, [100.0, -200.0, 300.0, 4.0, -5.0, 6.0], 3),
    ] {
        let mut host = codec(model);
        assert_eq!(host.feed(bytes), fed(1, 0));
        assert_eq!((&host.newest().readings[..6], host.newest().error), (&readings[..], error));
        let mut firmware = arm_of(model).firmware(Carriage::Stream);
        let mut out = Outbox::new();
        // A frame after NULs of padding, as they come from one write after another.
        firmware.receive(wake.as_slice(), 0.0, &arm_at(&readings), &mut out);
        firmware.receive(
            &encode(&mut *host, &[1.0, -2.0, 3.0]),
            1000.0,
            &arm_at(&readings),
            &mut out,
        );
        firmware.advance(2000.0, &arm_at(&readings), &mut out);
        assert_eq!(firmware.motors()[..3], [1.0, -2.0, 3.0], "no watchdog");
        let n_answers = out.len();
        firmware.receive(wake.as_slice(), 3000.0, &arm_at(&readings), &mut out);
        assert_eq!(firmware.motors(), [0.0; MAX_AXES], "what wakes it is a zero");
        out.truncate(n_answers);
        if error == 0 {
            assert_eq!(out, [bytes.clone(), bytes.clone()]);
        }
    }
    // Of another model.
    assert_eq!(host.feed(&d6), fed(0, 1));
    let bad = [
        "3,1,2,3,4,5,6,0]\n",
        "[3,1,2,3,4,5,6]\n",
        "[3,1,2,3,4,5,6,7,8]\n",
        "[3,a,2,3,4,5,6,7]\n",
        "[3,2147483649,2,3,4,5,6,7]\n",
    ];
    malformed_lines(&mut *host, &d5, &bad);
    // A lost `]` costs its own frame and not the next one.
    assert_eq!(host.feed(&[b"[3,1,2,3,4,5,6,0\n", &d5[..]].concat()), fed(1, 1));
}

fn hapi(motors: [Turn; 2], encoders: [(Turn, f32); 2], counts_per_rev: f32) -> Protocol {
    Protocol::HapiF32(HapiBoard {
        device_id: 5,
        motors: motors.to_vec(),
        encoders: encoders
            .map(|(direction, start_deg)| HapiEncoder { direction, start_deg, counts_per_rev })
            .to_vec(),
    })
}

/// E1–E7.
#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn hapi_f32() {
    use Turn::{Clockwise as Cw, CounterClockwise as Ccw};
    let boards = [
        (
            hapi([Cw; 2], [(Cw, 180.0), (Cw, 0.0)], 13824.0),
            "01 05 03 00 00 03 00 00 00 00 00 00 34 43 00 00 58 46 00 00 00 00 00 00 58 46",
        ),
        (
            hapi([Ccw; 2], [(Ccw, 12.0), (Ccw, 168.0)], 4880.0),
            "01 05 03 01 01 03 01 01 00 00 00 00 40 41 00 80 98 45 00 00 28 43 00 80 98 45",
        ),
        (
            hapi([Cw, Ccw], [(Cw, -61.0), (Ccw, 241.0)], 10752.0),
            "01 05 03 00 01 03 00 01 00 00 00 00 74 C2 00 00 28 46 00 00 71 43 00 00 28 46",
        ),
    ];
    for (protocol, setup) in &boards {
        let (mut here, mut there) = loopback(Carriage::Stream);
        // No board answers: what was sent is there to be read.
        assert!(matches!(
            protocol.codec(Carriage::Stream).start(&mut here),
            Err(StartError::Silent { .. })
        ));
        let mut buffer = [0; 128];
        let n = there.receive(&mut buffer).expect("open");
        let once = format!("{setup} 02 05 00 00 00 00 00 00 00 00");
        assert_eq!(show(&buffer[..n]), format!("{once} {once}"), "and again after a silence");
    }
    let protocol = &boards[0].0;
    let mut host = protocol.codec(Carriage::Stream);
    let mut firmware = protocol.firmware(Carriage::Stream);
    let e4 = encode(&mut *host, &[0.0, 0.0]);
    let e5 = encode(&mut *host, &[0.05, -0.025]);
    assert_eq!(show(&e4), "02 05 00 00 00 00 00 00 00 00");
    assert_eq!(show(&e5), "02 05 CD CC 4C 3D CD CC CC BC");
    let e6 = hex("05 00 00 16 43 00 00 20 42");
    assert_eq!(host.feed(&e6), fed(1, 0));
    assert_eq!(host.newest().readings[..3], [150.0, 40.0, 0.0]);
    let mut out = Outbox::new();
    firmware.receive(&hex(boards[0].1), 0.0, &arm_at(&[150.0, 40.0]), &mut out);
    firmware.receive(&e5, 0.0, &arm_at(&[150.0, 40.0]), &mut out);
    assert_eq!(out, std::slice::from_ref(&e6));
    for (motor, expected) in firmware.motors().iter().zip([0.05, -0.025]) {
        assert!((motor - expected).abs() < 1e-8);
    }
    // After a reset the torque is still on, and nothing clears it.
    firmware.receive(&[0, 0], 0.0, &arm_at(&[]), &mut out);
    firmware.receive(&e4, 100.0, &arm_at(&[]), &mut out);
    firmware.advance(200.0, &arm_at(&[]), &mut out);
    assert!(firmware.motors()[0] > 0.04);

    // Wrong id: nothing more is sent until there was silence.
    assert_eq!(host.feed(&hex("06 00 00 16 43 00 00 20 42")), fed(0, 1));
    assert_eq!(
        (host.silence(), encode(&mut *host, &[0.0, 0.0])),
        (Some(Duration::from_millis(1200)), vec![])
    );
    assert_eq!(host.feed(&e6), fed(0, 0), "what comes then is thrown away");
    host.resume();
    assert_eq!((host.silence(), encode(&mut *host, &[0.0, 0.0])), (None, e4.clone()));
    assert_eq!(
        host.feed(&hex("05 00 00 C0 7F 00 00 20 42")),
        fed(1, 0),
        "an angle that is no number is reported"
    );
    assert!(host.newest().readings[0].is_nan() && host.newest().readings[1] == 40.0);
    // 8 of 9 bytes when the next command is due.
    assert_eq!(host.feed(&e6[..8]), fed(0, 0));
    assert!(encode(&mut *host, &[0.1, 0.1]).is_empty());
    assert!(host.silence().is_some());
    host.resume();
    assert_eq!(
        [host.feed(&e6[..2]), host.feed(&e6[2..8]), host.feed(&e6[8..])],
        [fed(0, 0), fed(0, 0), fed(1, 0)]
    );
}

/// H1, H2.
#[test]
fn hapkit_ascii() {
    let (mut host, mut firmware) = (
        Protocol::HapkitAscii.codec(Carriage::Stream),
        Protocol::HapkitAscii.firmware(Carriage::Stream),
    );
    let h1 = hex(
        "50 72 6D 20 30 2E 30 31 32 33 34 20 2D 30 2E 30 35 30 30 30 20 30 2E 30 30 30 30 30 20 31 \
            0A",
    );
    assert_eq!(host.feed(&h1), fed(1, 0));
    let report = host.newest();
    assert_eq!(
        (report.readings[0], report.rates.map(|rates| rates[0]), report.buttons),
        (0.01234, Some(-0.05), 1)
    );
    let h2 = encode(&mut *host, &[0.5]);
    assert_eq!(show(&h2), "50 31 20 30 2E 35 0A");
    let mut arm = arm_at(&[0.01234]);
    (arm.rates[0], arm.buttons) = (-0.05, 1);
    let mut out = Outbox::new();
    firmware.receive(&h2, 0.0, &arm, &mut out);
    firmware.advance(0.0, &arm, &mut out);
    assert_eq!(out, [b"Ok\n".to_vec(), h1.clone()]);
    assert_eq!(firmware.motors()[0], 0.5);
    assert_eq!(encode(&mut *host, &[-1e-9]), b"P1 0\n");
    assert_eq!(encode(&mut *host, &[f64::NAN]), b"P1 0\n");
    assert_eq!(host.feed(b"Ok\n"), fed(0, 0));
    malformed_lines(
        &mut *host,
        &h1,
        &["Prm 1 2 3\n", "Prm 1 2 3 4 5\n", "Prm a 2 3 4\n", "1 2 3 4\n"],
    );
}

/// A report with NaN is whole: the tick has to get it.
#[test]
fn hapkit_says_that_a_number_is_none() {
    let mut host = Protocol::HapkitAscii.codec(Carriage::Stream);
    for line in ["Prm nan 0.1 0 0\n", "Prm 0.1 NaN 0 0\n", "Prm -inf 0.1 0 0\n"] {
        assert_eq!(host.feed(line.as_bytes()), fed(1, 0), "{line}");
        assert!(!host.newest().readings[0].is_finite(), "{line}");
    }
    assert_eq!(host.feed(b"Prm 0.1 0.2 0 0\n"), fed(1, 0));
    assert_eq!(host.newest().readings[0], 0.1);
}

/// It receives its commands, and then not any more, while it goes on sending.
#[test]
fn hapkit_says_how_long_it_has_heard_nothing() {
    let mut host = Protocol::HapkitAscii.codec(Carriage::Stream);
    encode(&mut *host, &[0.5]);
    assert_eq!(host.unheard(), None, "a board need not answer");
    host.feed(b"Ok\n");
    assert_eq!(host.unheard(), Some(0));
    for n in 1..5 {
        encode(&mut *host, &[0.5]);
        host.feed(b"Prm 0.1 0.2 0 0\n");
        assert_eq!(host.unheard(), Some(n));
    }
    host.feed(b"Ok\n");
    assert_eq!(host.unheard(), Some(0));
}

/// What a zero does to a board whose place in the stream is unknown, for every number of bytes of a
/// command that it has.
#[test]
fn a_hapi_board_takes_a_zero_wherever_it_stands() {
    use Turn::Clockwise as Cw;
    let encoder = HapiEncoder { direction: Cw, start_deg: 0.0, counts_per_rev: 13824.0 };
    let protocol = Protocol::HapiF32(HapiBoard {
        device_id: 5,
        motors: vec![Cw; 2],
        encoders: vec![encoder; 2],
    });
    let setup =
        hex("01 05 03 01 01 03 01 01 00 00 00 00 34 43 00 00 58 46 00 00 00 00 00 00 58 46");
    let push = encode(&mut *protocol.codec(Carriage::Stream), &[0.1, 0.1]);
    let zero = encode(&mut *protocol.codec(Carriage::Stream), &[0.0, 0.0]);
    let mut host = protocol.codec(Carriage::Stream);
    let mut frame = Frame::default();
    host.zero_out_of_step(&mut frame);
    for missing in 0..push.len() {
        let mut firmware = protocol.firmware(Carriage::Stream);
        let mut out = Outbox::new();
        firmware.receive(&setup, 0.0, &arm_at(&[]), &mut out);
        firmware.receive(&push, 0.0, &arm_at(&[]), &mut out);
        assert!(firmware.motors()[0] > 0.09);
        if missing > 0 {
            firmware.receive(&push[..push.len() - missing], 0.001, &arm_at(&[]), &mut out);
        }
        for turn in 0..2 {
            firmware.receive(
                frame.as_slice(),
                0.002 + 0.001 * f64::from(turn),
                &arm_at(&[]),
                &mut out,
            );
        }
        let left = firmware.motors();
        // What was whole before stays; nothing gets larger, and in step everything goes.
        assert!(
            left[..2].iter().all(|motor| *motor == 0.0 || (0.09..0.11).contains(motor)),
            "{missing}: {left:?}"
        );
        assert!(missing != 0 || left == [0.0; MAX_AXES]);
        assert!(!(1..=4).contains(&missing) || left[1] == 0.0, "{missing}: {left:?}");
        // After the silence it still receives: it was not reset.
        firmware.receive(&zero, 2.0, &arm_at(&[]), &mut out);
        assert_eq!(firmware.motors(), [0.0; MAX_AXES], "{missing}");
    }
    // An id that is a command itself leaves nothing that is safe.
    let odd = Protocol::HapiF32(HapiBoard { device_id: 2, motors: vec![Cw; 2], encoders: vec![] });
    odd.codec(Carriage::Stream).zero_out_of_step(&mut frame);
    assert!(frame.is_empty());
}

/// I1–I6.
#[test]
fn space_mouse() {
    let mut host = Protocol::SpaceMouse { dead_band: 0 }.codec(Carriage::Reports);
    let i1 = hex("01 5E 01 51 FF 46 00");
    let i2 = hex("02 00 00 23 00 A2 FE");
    let i3 = hex("01 5E 01 51 FF 46 00 00 00 23 00 A2 FE");
    let all = [350.0, -175.0, 70.0, 0.0, 35.0, -350.0];
    assert_eq!(host.feed(&i1), fed(1, 0));
    assert_eq!(host.newest().readings[..6], [350.0, -175.0, 70.0, 0.0, 0.0, 0.0]);
    assert_eq!(host.feed(&i2), fed(1, 0));
    assert_eq!(host.newest().readings[..6], all);
    for (puck, expected) in [
        (super::super::space_mouse::Puck::new(false), vec![i1.clone(), i2.clone()]),
        (super::super::space_mouse::Puck::new(true), vec![i3.clone()]),
    ] {
        let mut puck = puck;
        let mut out = Outbox::new();
        puck.advance(0.0, &arm_at(&all), &mut out);
        puck.advance(0.001, &arm_at(&all), &mut out);
        assert_eq!(out, expected, "reports on change only");
        let mut arm = arm_at(&all);
        arm.buttons = 1;
        puck.advance(0.002, &arm, &mut out);
        assert_eq!(out[expected.len()..], [hex("03 01 00")]);
    }
    let mut host = Protocol::SpaceMouse { dead_band: 70 }.codec(Carriage::Reports);
    assert_eq!(host.feed(&i3), fed(1, 0));
    assert_eq!(host.newest().readings[..6], [350.0, -175.0, 0.0, 0.0, 0.0, -350.0]);
    assert_eq!(host.feed(&hex("03 01 00")), fed(1, 0));
    assert_eq!(host.newest().buttons, 1);
    assert_eq!(encode_enabled(&mut *host, &[], true), hex("04 01"));
    assert!(encode_enabled(&mut *host, &[], true).is_empty(), "the lamp is on already");
    assert_eq!(encode_enabled(&mut *host, &[], false), hex("04 00"));
    for short in [
        &i1[..6],
        &[&i1[..], &[0]].concat(),
        &i2[..6],
        &[&i2[..], &[0]].concat(),
        &i3[..12],
        &[3],
        &[],
        &[1; 8],
    ] {
        assert_eq!(host.feed(short), fed(0, 1), "{short:?}");
    }
    assert_eq!(host.feed(&hex("17 64")), fed(0, 0), "battery");

    let mut host = Protocol::Spacenav.codec(Carriage::Stream);
    let i6 = hex(
        "00 00 00 00 5E 01 00 00 51 FF FF FF 46 00 00 00 00 00 00 00 23 00 00 00 A2 FE FF FF 10 00 \
            00 00",
    );
    assert_eq!(host.feed(&i6), fed(1, 0));
    assert_eq!(host.newest().readings[..6], all);
    let mut out = Outbox::new();
    let mut puck = Protocol::Spacenav.firmware(Carriage::Stream);
    puck.advance(0.016, &arm_at(&all), &mut out);
    assert_eq!(out, [i6]);
}

/// G1–G5.
#[test]
fn falcon_nibble16() {
    let mut frame = Frame::default();
    for (motors, bits, golden) in [
        ([0, 0, 0], 0, "3C 41 41 41 41 41 41 41 41 41 41 41 41 41 41 3E"),
        ([0, 0, 0], 1, "3C 41 41 41 41 41 41 41 41 41 41 41 41 42 41 3E"),
        ([0, 0, 0], 9, "3C 41 41 41 41 41 41 41 41 41 41 41 41 4A 41 3E"),
        ([256, -256, 4096], 3, "3C 41 41 42 41 41 41 50 50 41 41 41 42 44 41 3E"),
    ] {
        super::super::falcon::put_frame(motors, bits, &mut frame);
        assert_eq!(show(frame.as_slice()), golden);
    }
    let protocol = Protocol::FalconNibble16 { image: None };
    let mut host = protocol.codec(Carriage::Stream);
    let mut firmware = protocol.firmware(Carriage::Stream);
    assert_eq!(
        show(&encode(&mut *host, &[0.0; 3])),
        "3C 41 41 41 41 41 41 41 41 41 41 41 41 4A 41 3E",
        "red: not homed"
    );
    let g4 = encode_enabled(&mut *host, &[256.0, -256.0, 1e9], true);
    assert_eq!(show(&g4), "3C 41 41 42 41 41 41 50 50 41 41 41 42 44 41 3E", "never above 4096");
    let g5 = hex("3C 45 47 41 41 49 44 50 50 4D 43 42 41 B5 41 3E");
    assert_eq!(host.feed(&g5), fed(1, 0));
    let report = *host.newest();
    assert_eq!(
        (&report.readings[..3], report.buttons, report.homed),
        (&[100.0, -200.0, 300.0][..], 4, Some(true))
    );
    let mut arm = arm_at(&[100.0, -200.0, 300.0]);
    arm.buttons = 4;
    let mut out = Outbox::new();
    firmware.receive(&g4, 0.0, &arm, &mut out);
    assert_eq!(out, std::slice::from_ref(&g5));
    assert_eq!(firmware.motors()[..3], [256.0, -256.0, 4096.0]);

    // `<` inside garbage, a broken word, and what does not belong there; each time the next frame
    // is found.
    let with = |at: usize, byte: u8| {
        let mut frame = g5.clone();
        frame[at] = byte;
        frame
    };
    assert_eq!(host.feed(&[b"x<yz<", &g5[..]].concat()), fed(1, 1));
    assert_eq!(host.feed(&with(13, 0xC0)), fed(1, 0));
    assert_eq!((host.newest().buttons, host.newest().homed), (15, Some(true)));
    for bad in
        [with(3, 0x40), with(9, 0x51), with(13, 0xC1), with(13, 0x40), with(15, b'x'), hex("01 60")]
    {
        assert_eq!(host.feed(&bad).reports, 0, "{}", show(&bad));
        let fed = host.feed(&g5);
        assert_eq!(fed.reports, 1, "after {}", show(&bad));
    }
    assert_eq!(host.feed(&with(3, 0x40)).corrupt, 1);
    assert_eq!(encode(&mut *host, &[0.0; 3])[13], 0x41 + 1 + 4, "blue: homed, force off");
}

/// J1–J9.
#[test]
fn dynamixel2() {
    use super::super::dynamixel::{PING, STATUS, WRITE, put_packet};
    use super::super::dynamixel_bus::ArmFirmware;
    let packet = |id: u8, instruction: u8, parameters: &[u8]| {
        let mut bytes = Vec::new();
        put_packet(id, instruction, parameters.iter().copied(), &mut |byte| bytes.push(byte));
        bytes
    };
    for (bytes, golden) in [
        (packet(1, PING, &[]), "FF FF FD 00 01 03 00 01 19 4E"),
        (packet(1, WRITE, &[11, 0, 0]), "FF FF FD 00 01 06 00 03 0B 00 00 42 E3"),
        (packet(1, WRITE, &[64, 0, 1]), "FF FF FD 00 01 06 00 03 40 00 01 DB 66"),
        (packet(1, WRITE, &[98, 0, 2]), "FF FF FD 00 01 06 00 03 62 00 02 79 64"),
    ] {
        assert_eq!(show(&bytes), golden);
    }
    let servos = |n: u8, model| -> Vec<Servo> { (1..=n).map(|id| Servo { id, model }).collect() };
    let protocol = |n, model| Protocol::Dynamixel2 { servos: servos(n, model) };
    let j5 = "FF FF FD 00 FE 0E 00 82 7E 00 0A 00 01 02 03 04 05 06 07 A0 98";
    let j9 = "FF FF FD 00 FE 1C 00 83 66 00 02 00 01 00 00 02 00 00 03 00 00 04 00 00 05 00 00 06 \
        00 00 07 00 00 F1 90";
    let mut seven = protocol(7, ServoModel::Xc330T288).codec(Carriage::Stream);
    assert_eq!(show(&encode(&mut *seven, &[0.0; 7])), format!("{j9} {j5}"));
    let mut two = protocol(2, ServoModel::Xm430W210).codec(Carriage::Stream);
    let j8 = hex("FF FF FD 00 FE 0D 00 83 66 00 02 00 01 64 00 02 9C FF E1 DB");
    let frame = encode(&mut *two, &[100.9, -100.9]);
    assert_eq!(frame[..j8.len()], j8);
    // Never beyond the table of the servo.
    assert_eq!(encode(&mut *two, &[1e9, f64::NAN])[13..18], [0xA9, 0x04, 2, 0, 0]);
    let mut firmware = ArmFirmware::new(&servos(2, ServoModel::Xm430W210));
    let mut out = Outbox::new();
    let idle = arm_at(&[]);
    for id in [1, 2] {
        for parameters in [[11, 0, 0], [64, 0, 1]] {
            firmware.receive(&packet(id, WRITE, &parameters), 0.0, &idle, &mut out);
        }
    }
    firmware.receive(&j8, 0.0, &idle, &mut out);
    assert_eq!(firmware.motors()[..2], [100.0, -100.0]);

    let j6 = hex("FF FF FD 00 01 0E 00 55 00 F4 FF FD FF FF FF 64 08 00 00 5C 2C");
    let j7 = hex("FF FF FD 00 01 0F 00 55 00 00 00 FF FF FF FF FD FD 00 00 00 DA 98");
    let mut one = protocol(1, ServoModel::Xc330T288).codec(Carriage::Stream);
    let unit = super::super::dynamixel::VELOCITY_UNIT;
    for (bytes, position, velocity) in [(&j6, 2148.0, -3.0), (&j7, 253.0, -1.0)] {
        assert_eq!(one.feed(bytes), fed(1, 0));
        assert_eq!(
            (one.newest().readings[0], one.newest().rates.map(|rates| rates[0])),
            (position, Some(velocity * unit))
        );
        // Whole again wherever it is cut, within the stuffing too.
        for at in 1..bytes.len() {
            assert_eq!(
                [one.feed(&bytes[..at]), one.feed(&bytes[at..])],
                [fed(0, 0), fed(1, 0)],
                "cut at {at}"
            );
        }
    }
    let mut servo = ArmFirmware::new(&servos(1, ServoModel::Xc330T288));
    let read = packet(0xFE, 0x82, &[126, 0, 10, 0, 1]);
    let mut turning = arm_at(&[253.0]);
    turning.rates[0] = -unit;
    out.clear();
    servo.receive(&read, 0.0, &turning, &mut out);
    assert_eq!(out, std::slice::from_ref(&j7));

    // CRC off by one; the echo of our own question.
    let mut bad = j6.clone();
    bad[19] ^= 1;
    assert_eq!(one.feed(&bad).reports, 0);
    assert_eq!(one.feed(&j6).reports, 1);
    assert_eq!(one.feed(&read), fed(0, 0));
    // Wrong order, a missing servo, an alert.
    let status = |id: u8, error: u8| packet(id, STATUS, &[error, 0, 0, 0, 0, 0, 0, id, 0, 0, 0]);
    let first = status(1, 0);
    let second = status(2, 0);
    assert_eq!(two.feed(&[&first[..], &second].concat()), fed(1, 0));
    assert_eq!(two.feed(&[&second[..], &first].concat()).reports, 0);
    assert_eq!(two.feed(&second), fed(1, 0), "the round that the first one began");
    two.resume();
    assert_eq!(two.feed(&first), fed(0, 0));
    encode(&mut *two, &[0.0, 0.0]);
    assert_eq!(two.feed(&[&first[..], &second].concat()), fed(1, 1), "the second one was missing");
    // A host that reads late has the rest of a round after its next command, every time; but not
    // after two.
    assert_eq!(two.feed(&first), fed(0, 0));
    for _ in 0..3 {
        encode(&mut *two, &[0.0, 0.0]);
        assert_eq!(two.feed(&[&second[..], &first].concat()), fed(1, 0));
    }
    encode(&mut *two, &[0.0, 0.0]);
    encode(&mut *two, &[0.0, 0.0]);
    assert_eq!(two.feed(&second), fed(0, 2), "a round without an end, an end without a round");
    two.resume();
    assert_eq!(two.feed(&packet(1, STATUS, &[0])), fed(0, 1), "an answer without numbers");
    assert_eq!(two.feed(&[&first[..], &status(2, 0x80)].concat()).reports, 1);
    assert_eq!(two.newest().error, 0x0280);
    let mut firmware = ArmFirmware::new(&servos(2, ServoModel::Xc330T288));
    firmware.alert(1);
    out.clear();
    firmware.receive(&packet(0xFE, 0x82, &[126, 0, 10, 0, 1, 2]), 0.0, &idle, &mut out);
    assert_eq!(two.feed(&out.concat()), fed(1, 0));
    assert_eq!(two.newest().error, 0x0280);
}
