//! The frames and the states of `docs/reference/protocol.md`.

use super::*;

const PAGE: &str = include_str!("../../../../../docs/reference/protocol.md");

/// The frame of that name on the page: its packet, and what of it goes over a serial line.
fn frame(name: &str) -> (Vec<u8>, Vec<u8>) {
    let row = PAGE
        .lines()
        .find(|line| line.starts_with(&format!("| {name} |")))
        .unwrap_or_else(|| panic!("no frame {name}"));
    let mut cells = row.split('`').skip(1).step_by(2).map(hex);
    (cells.next().expect("a packet"), cells.next().expect("as serial"))
}

/// A report of 64 bytes.
fn report(packet: &[u8]) -> Vec<u8> {
    let mut report = packet.to_vec();
    report.resize(64, 0);
    report
}

fn pose() -> ArmReadings {
    let mut arm = arm_at(&[0.01, -0.02, 0.03, 0.0, 0.0, 0.6, 0.8, 0.25]);
    arm.rates[..6].copy_from_slice(&[0.5, -0.25, 0.125, 1.0, -2.0, 0.5]);
    arm.buttons = 5;
    arm
}

/// Both carriages: the frames of the host as it makes them, answered as the page says.
#[test]
fn frames_are_those_of_the_page() {
    let protocol = Protocol::Open6(open6_arm());
    for carriage in [Carriage::Reports, Carriage::Stream] {
        let on_wire = |name: &str, from_host: bool| {
            let (packet, serial) = frame(name);
            match carriage {
                Carriage::Reports if from_host => [&[0][..], &report(&packet)].concat(),
                Carriage::Reports => report(&packet),
                Carriage::Stream => serial,
            }
        };
        let mut link = Linked::new(protocol.firmware(carriage), carriage, pose());
        let mut host = protocol.codec(carriage);
        host.start(&mut link).expect("an arm");
        let hello = on_wire("hello", true);
        assert_eq!(
            show(
                link.sent[0]
                    .strip_prefix(&[0][..])
                    .filter(|_| carriage == Carriage::Stream)
                    .unwrap_or(&link.sent[0])
            ),
            show(&hello)
        );
        let mut firmware = protocol.firmware(carriage);
        let mut out = Outbox::new();
        firmware.receive(&hello, 0.0, &pose(), &mut out);
        assert_eq!(show(&out[0]), show(&on_wire("capabilities", false)));
        for (motors, enabled, command, now_s, state) in [
            ([0.0; 7], false, "command, off", 0.001, "state, disabled"),
            ([1.5, -0.5, 2.0, 0.01, 0.0, -0.02, 0.0], true, "command, on", 0.002, "state, enabled"),
        ] {
            let bytes = encode_enabled(&mut *host, &motors, enabled);
            assert_eq!(show(&bytes), show(&on_wire(command, true)), "{command}");
            out.clear();
            firmware.receive(&bytes, now_s, &pose(), &mut out);
            assert_eq!(show(&out[0]), show(&on_wire(state, false)), "{state}");
            if carriage == Carriage::Stream {
                assert_eq!(protocol.exchange_bytes(), Some(bytes.len() + out[0].len()));
            }
            assert_eq!(host.feed(&out[0]), fed(1, 0));
            let report = host.newest();
            for (found, want) in report.readings.iter().zip(pose().readings) {
                assert!((found - want).abs() < 1e-7);
            }
            assert_eq!(
                (report.rates, report.buttons, report.homed, report.error),
                (Some(pose().rates), 5, Some(true), 0)
            );
            assert_eq!(report.echo, host.sequence());
        }
        assert!((firmware.motors()[2] - 2.0).abs() < 1e-6);
        host.finish(&mut link);
        let stop = on_wire("stop", true);
        assert_eq!(show(link.sent.last().expect("a frame")), show(&stop));
        out.clear();
        firmware.receive(&stop, 0.003, &pose(), &mut out);
        assert_eq!(show(&out[0]), show(&on_wire("state, stopped", false)));
        assert_eq!(firmware.motors(), [0.0; MAX_AXES]);
    }
}

#[test]
fn what_is_not_sound_is_dropped_and_counted() {
    let (packet, serial) = frame("state, enabled");
    let protocol = Protocol::Open6(open6_arm());
    let mut hid = protocol.codec(Carriage::Reports);
    let mut stream = protocol.codec(Carriage::Stream);
    let good = report(&packet);
    for at in 0..packet.len() {
        let mut bad = good.clone();
        bad[at] ^= 0x10;
        assert_eq!(hid.feed(&bad), fed(0, 1), "byte {at}");
    }
    assert_eq!(hid.feed(&good[..63]), fed(0, 1));
    assert_eq!(hid.feed(&[&good[..], &[0]].concat()), fed(0, 1));
    assert_eq!(hid.feed(&good), fed(1, 0));
    assert_eq!(hid.feed(&good), FeedCounts { reports: 1, repeated: 1, ..FeedCounts::default() });
    for at in 0..serial.len() - 1 {
        let mut bad = serial.clone();
        bad[at] ^= 0x10;
        let fed = stream.feed(&bad);
        assert!(fed.reports == 0 && fed.corrupt >= 1, "byte {at}: {fed:?}");
    }
    assert_eq!(stream.feed(&[&[0, 0, 0][..], &serial, &[0]].concat()), fed(1, 0));
    // The later one of the page, after one that was lost: 1, then 3.
    let mut host = protocol.codec(Carriage::Reports);
    assert_eq!(host.feed(&report(&frame("state, disabled").0)), fed(1, 0));
    assert_eq!(
        host.feed(&report(&frame("state, stopped").0)),
        FeedCounts { reports: 1, gap: 1, ..FeedCounts::default() }
    );
}

#[test]
fn motors_are_driven_in_one_state_alone() {
    let protocol = Protocol::Open6(open6_arm());
    let carriage = Carriage::Stream;
    let mut link = Linked::new(protocol.firmware(carriage), carriage, pose());
    let mut host = protocol.codec(carriage);
    let push = [1.0, 0.0, 0.0];
    assert_eq!(link.exchange(&mut *host, &push, true), fed(0, 0), "silent before hello");
    assert_eq!(link.firmware.motors(), [0.0; MAX_AXES]);
    host.start(&mut link).expect("an arm");
    link.take();
    link.arm.homed = false;
    link.exchange(&mut *host, &push, true);
    assert_eq!(
        (link.firmware.motors()[0], host.newest().error, host.newest().homed),
        (0.0, 1, Some(false))
    );
    link.arm.homed = true;
    link.exchange(&mut *host, &push, true);
    assert_eq!(link.firmware.motors()[0], 1.0);
    // A number that is none, from a host that is not ours: off, until a command without enable.
    let mut payload = [0_u8; open6::COMMAND_LEN];
    payload[..4].copy_from_slice(&f32::NAN.to_le_bytes());
    payload[28] = 1;
    let mut frame = Frame::default();
    open6::put_packet(carriage, true, open6::COMMAND, 9, &payload, &mut frame);
    link.here.send(frame.as_slice()).expect("open");
    link.pump();
    link.take();
    host.resume();
    link.exchange(&mut *host, &push, true);
    assert_eq!((link.firmware.motors()[0], host.newest().error), (0.0, 2));
    link.exchange(&mut *host, &[], false);
    link.exchange(&mut *host, &push, true);
    assert_eq!((link.firmware.motors()[0], host.newest().error), (1.0, 0));
    // Limits by magnitude, direction kept.
    link.exchange(&mut *host, &[30.0, 40.0, 0.0, 0.0, 0.0, 5.0, 1.0], true);
    let want = [7.2, 9.6, 0.0, 0.0, 0.0, 0.5, 0.0];
    assert!(
        link.firmware.motors().iter().zip(want).all(|(found, want)| (found - want).abs() < 1e-6),
        "{:?}",
        link.firmware.motors()
    );
    // A second hello: off again.
    host.start(&mut link).expect("an arm");
    assert_eq!(link.firmware.motors(), [0.0; MAX_AXES]);
}
