//! Start-up and shut-down dialogues.

use super::*;

fn started(
    protocol: &Protocol,
    carriage: Carriage,
    firmware: Box<dyn Firmware>,
) -> (Result<(), StartError>, Box<dyn Codec>, Linked) {
    let mut link = Linked::new(firmware, carriage, arm_at(&[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]));
    let mut codec = protocol.codec(carriage);
    (codec.start(&mut link), codec, link)
}

#[test]
fn nothing_moves_in_a_start() {
    for (protocol, carriage) in every_protocol() {
        let (result, codec, link) = started(&protocol, carriage, protocol.firmware(carriage));
        result.unwrap_or_else(|error| panic!("{}: {error}", protocol.name()));
        assert_eq!(link.firmware.motors(), [0.0; MAX_AXES], "{}", protocol.name());
        assert_eq!(codec.silence(), None);
    }
}

#[test]
fn a_lost_link_ends_every_start() {
    for (protocol, carriage) in every_protocol() {
        let mut link = Linked::new(protocol.firmware(carriage), carriage, arm_at(&[]));
        link.here.cut();
        let result = protocol.codec(carriage).start(&mut link.here);
        // An arm that reports on change is not waited for.
        if protocol.pacing() != crate::Pacing::Event {
            assert_eq!(
                result,
                Err(StartError::Transport(TransportError::Lost)),
                "{}",
                protocol.name()
            );
        }
    }
}

#[test]
fn an_arm_that_only_babbles_is_given_up() {
    let falcon = Protocol::FalconNibble16 { image: None };
    let mut link = Linked::new(
        Protocol::HapkitAscii.firmware(Carriage::Stream),
        Carriage::Stream,
        arm_at(&[]),
    );
    let result = falcon.codec(Carriage::Stream).start(&mut link);
    assert!(
        matches!(&result, Err(StartError::Refused(text)) if text.contains("answers no run frames")),
        "{result:?}"
    );
}

#[test]
fn boards_with_the_same_usb_ids_are_reported_apart() {
    let hid14 = Protocol::HaptikfabrikenHid14 { carrier: Hid14Carrier::Mbed };
    for (host, arm, says) in [
        (&shipped("woodenhaptics-v15"), &hid14, "reports of 14 bytes, and the profile describes 8"),
        (&hid14, &shipped("woodenhaptics-v15"), "woodenhaptics-hid8"),
        (&hid14, &Protocol::HaptikfabrikenHid14 { carrier: Hid14Carrier::TeensyRawHid }, "64"),
        (
            &shipped("woodenhaptics-2022"),
            &shipped("vintage-2022"),
            "the arm reports 2 where its profile has 3",
        ),
    ] {
        let carriage = host.carriages()[0];
        let (result, ..) = started(host, carriage, arm.firmware(carriage));
        let Err(StartError::Refused(text)) = result else { panic!("{result:?}") };
        assert!(text.contains(says), "{text}");
    }
}

#[test]
fn servos_are_checked_before_they_are_switched_on() {
    let servos =
        |model| vec![Servo { id: 1, model: ServoModel::Xc330T288 }, Servo { id: 9, model }];
    let wanted = Protocol::Dynamixel2 { servos: servos(ServoModel::Xm430W210) };
    let (result, mut codec, mut link) =
        started(&wanted, Carriage::Stream, wanted.firmware(Carriage::Stream));
    assert_eq!(result, Ok(()));
    assert_eq!(codec.identity().as_deref(), Some("servos 1 XC330-T288, 9 XM430-W210"));
    // The first exchange winds the watchdogs up anew, however late it comes.
    link.now_s += 60.0;
    link.pump();
    link.exchange(&mut *codec, &[5.0, -5.0], true);
    assert_eq!(link.firmware.motors()[..2], [5.0, -5.0]);
    codec.finish(&mut link);
    assert_eq!(link.firmware.motors(), [0.0; MAX_AXES]);
    let torque_off: Vec<_> = link.sent.iter().rev().take(2).map(|frame| frame[4]).collect();
    assert_eq!(torque_off, [9, 1]);
    link.exchange(&mut *codec, &[5.0, -5.0], true);
    assert_eq!(link.firmware.motors(), [0.0; MAX_AXES], "torque is off");

    let other = Protocol::Dynamixel2 { servos: servos(ServoModel::Xc330T288) };
    let (result, ..) = started(&wanted, Carriage::Stream, other.firmware(Carriage::Stream));
    assert!(
        matches!(&result, Err(StartError::Refused(text)) if text.contains("servo 9 is model 1220 (XC330-T288)")),
        "{result:?}"
    );
    let alone = Protocol::Dynamixel2 { servos: servos(ServoModel::Xm430W210)[..1].to_vec() };
    let (result, ..) = started(&wanted, Carriage::Stream, alone.firmware(Carriage::Stream));
    assert!(
        matches!(&result, Err(StartError::Refused(text)) if text.contains("servo 9") && text.contains("no answer")),
        "{result:?}"
    );
}

#[test]
fn a_hapi_board_is_set_up_once_and_left_without_torque() {
    let protocol = hapi();
    let (result, mut codec, mut link) =
        started(&protocol, Carriage::Stream, protocol.firmware(Carriage::Stream));
    assert_eq!(result, Ok(()));
    let setups = |link: &Linked| link.sent.iter().filter(|frame| frame[0] == 1).count();
    assert_eq!((setups(&link), codec.start(&mut link), setups(&link)), (1, Ok(()), 1));
    link.exchange(&mut *codec, &[0.1, 0.1], true);
    assert!(link.firmware.motors()[0] > 0.09);
    let before = link.sent.len();
    codec.finish(&mut link);
    assert_eq!(link.firmware.motors(), [0.0; MAX_AXES]);
    let zero = hex("02 05 00 00 00 00 00 00 00 00");
    assert_eq!(link.sent[before..], [zero.clone(), zero, hex("00 00")], "zero, reply, zero, reset");
}

/// The plug was never out: another setup would make a home pose of wherever the arm is when it
/// wakes.
#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn a_hapi_board_that_only_fell_silent_is_not_set_up_again() {
    let protocol = hapi();
    let mut link =
        Linked::new(protocol.firmware(Carriage::Stream), Carriage::Stream, arm_at(&[150.0, 45.0]));
    let mut codec = protocol.codec(Carriage::Stream);
    codec.start(&mut link).expect("it answers");
    link.exchange(&mut *codec, &[0.1, 0.1], true);
    // Lost and let go of: no torque is left, and no reset is sent.
    codec.finish_lost(&mut link);
    assert_eq!(link.firmware.motors(), [0.0; MAX_AXES]);
    let mut again = protocol.codec(Carriage::Stream);
    again.started_before(true);
    again.start(&mut link).expect("it answers");
    link.exchange(&mut *again, &[0.1, 0.1], true);
    assert!(link.firmware.motors()[0] > 0.09, "its motors can be reached");
    assert_eq!(link.sent.iter().filter(|frame| frame[0] == 1).count(), 1, "one setup");
    assert!(link.sent.iter().all(|frame| frame[0] != 0), "no reset");
    // One that does not answer is left alone too.
    let (mut here, mut there) = loopback(Carriage::Stream);
    let mut asleep = protocol.codec(Carriage::Stream);
    asleep.started_before(true);
    assert!(matches!(asleep.start(&mut here), Err(StartError::Silent { .. })));
    let mut buffer = [0; 128];
    let n = there.receive(&mut buffer).expect("open");
    let zero = "02 05 00 00 00 00 00 00 00 00";
    assert_eq!(show(&buffer[..n]), format!("{zero} {zero}"));
}

fn hapi() -> Protocol {
    let (protocol, _) = every_protocol()
        .into_iter()
        .find(|(protocol, _)| matches!(protocol, Protocol::HapiF32(_)))
        .expect("there");
    protocol
}

#[test]
fn a_hapi_board_that_is_opened_again_says_the_same() {
    let protocol = hapi();
    let mut link =
        Linked::new(protocol.firmware(Carriage::Stream), Carriage::Stream, arm_at(&[150.0, 45.0]));
    for _ in 0..3 {
        let mut codec = protocol.codec(Carriage::Stream);
        codec.start(&mut link).expect("it answers");
        link.exchange(&mut *codec, &[0.0, 0.0], false);
        let readings = codec.newest().readings;
        assert!(
            (readings[0] - 150.0).abs() < 0.1 && (readings[1] - 45.0).abs() < 0.1,
            "{readings:?}"
        );
        codec.finish(&mut link);
    }
}

#[test]
#[ignore = "takes long: `cargo test -- --include-ignored`"]
fn a_hapi_board_that_was_spoken_to_in_another_protocol_is_found_again() {
    let protocol = hapi();
    for foreign in [
        "00 03 01 08 01 06 6F 70 36 64 01 02 64 03 F4 76 00",
        "02 05 00",
        "FF FF FD 00 01 07 00 02 84 00 0A 00 15",
    ] {
        let mut link = Linked::new(
            protocol.firmware(Carriage::Stream),
            Carriage::Stream,
            arm_at(&[150.0, 45.0]),
        );
        link.send(&hex(foreign)).expect("open");
        let mut codec = protocol.codec(Carriage::Stream);
        assert_eq!(codec.start(&mut link), Ok(()), "{foreign}");
        link.exchange(&mut *codec, &[0.0, 0.0], false);
        assert!(
            (codec.newest().readings[0] - 150.0).abs() < 0.1,
            "{foreign}: {:?}",
            codec.newest()
        );
    }
}

#[test]
fn a_cold_falcon_is_loaded_with_the_users_image() {
    let image: Vec<u8> = (0..1000_u32).map(|at| (at * 7) as u8).collect();
    let file = tempfile::NamedTempFile::new().expect("a file");
    std::fs::write(file.path(), &image).expect("a file");
    let cold = || Box::new(super::super::falcon::ArmFirmware::switched_on(image.len()));
    let protocol = |image| Protocol::FalconNibble16 { image };
    let (result, _, link) =
        started(&protocol(Some(file.path().to_owned())), Carriage::Stream, cold());
    assert_eq!(result, Ok(()));
    let loaded: Vec<u8> = link
        .sent
        .iter()
        .skip_while(|frame| frame[..] != [0x41])
        .skip(1)
        .take(17)
        .flatten()
        .copied()
        .collect();
    assert_eq!(loaded, image, "17 chunks of at most 62 bytes");
    let bauds: Vec<_> = link
        .lines
        .iter()
        .filter_map(|line| if let Line::Baud(baud) = line { Some(*baud) } else { None })
        .collect();
    assert_eq!(bauds, [1_500_000, 9600, 142_857, 1_500_000]);
    assert!(link.lines.contains(&Line::LatencyMs(16)) && link.lines.contains(&Line::Dtr(true)));

    let refused = |image: Option<&str>| {
        let (result, ..) = started(&protocol(image.map(Into::into)), Carriage::Stream, cold());
        let Err(StartError::Refused(text)) = result else { panic!("{result:?}") };
        text
    };
    assert!(refused(None).contains("name the image"));
    assert!(refused(Some("/nowhere/falcon.bin")).contains("/nowhere/falcon.bin"));
    // One that is running already needs none.
    let (result, ..) =
        started(&protocol(None), Carriage::Stream, protocol(None).firmware(Carriage::Stream));
    assert_eq!(result, Ok(()));
}

#[test]
fn an_open6_arm_that_cannot_do_what_the_profile_says_is_refused() {
    for carriage in [Carriage::Reports, Carriage::Stream] {
        let wanted = Protocol::Open6(open6_arm());
        let (result, codec, _) = started(&wanted, carriage, wanted.firmware(carriage));
        assert_eq!(result, Ok(()));
        let identity = codec.identity().expect("it said so");
        assert!(identity.starts_with("test arm, open6 1.0, senses x y z rx ry rz"), "{identity}");
        for (arm, says) in [
            (Open6Arm { sensed: Axes::TRANSLATION, ..open6_arm() }, "senses x y z"),
            (Open6Arm { actuated: Axes::TRANSLATION, ..open6_arm() }, "drives x y z"),
        ] {
            let (result, ..) = started(&wanted, carriage, Protocol::Open6(arm).firmware(carriage));
            assert!(
                matches!(&result, Err(StartError::Refused(text)) if text.contains(says)),
                "{result:?}"
            );
        }
    }
}

#[test]
fn an_open6_arm_says_what_it_can_and_a_state_that_makes_no_sense_is_distinguished_from_a_garbled_one()
 {
    let protocol = Protocol::Open6(open6_arm());
    let (result, mut codec, mut link) =
        started(&protocol, Carriage::Stream, protocol.firmware(Carriage::Stream));
    assert_eq!(result, Ok(()));
    let declared = codec.declared().expect("it said so");
    assert_eq!((declared.rate_hz, declared.force_n, declared.torque_nm), (1000, 12.0, 0.5));
    assert!((declared.workspace_radius_m - 0.1).abs() < 1e-6);
    assert!(codec.identity().expect("it said so").contains("12.000 N, 0.5000 N·m, radius 0.100 m"));
    // An orientation that is none.
    link.arm = arm_at(&[0.0; 7]);
    let fed = link.exchange(&mut *codec, &[], false);
    assert_eq!((fed.reports, fed.corrupt, fed.refused), (0, 1, 1));
}
