//! The frame of the guard: made without the codec that speaks with the arm, and sent whenever that
//! one no longer can.

use super::*;

/// Each arm that is shipped, with motors, and how its bytes travel.
fn every_arm_with_motors() -> Vec<(&'static str, Protocol, Carriage)> {
    let arms = profile::names().filter_map(|name| {
        Some((name, profile::find(name, Path::new("")).expect(name).real?.protocol))
    });
    let ways = arms.flat_map(|(name, protocol)| {
        protocol
            .carriages()
            .iter()
            .map(|carriage| (name, protocol.clone(), *carriage))
            .collect::<Vec<_>>()
    });
    ways.filter(|(_, protocol, _)| protocol.n_motors() > 0).collect()
}

/// An arm that was exchanged with for a while, force on.
fn pressed(protocol: &Protocol, carriage: Carriage) -> (Box<dyn Codec>, Linked) {
    let mut codec = protocol.codec(carriage);
    let mut link = Linked::new(
        protocol.firmware(carriage),
        carriage,
        arm_at(&[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]),
    );
    codec.start(&mut link).expect("an arm");
    link.take();
    codec.resume();
    link.exchange(&mut *codec, &[], false);
    (codec, link)
}

fn press(name: &str, protocol: &Protocol, codec: &mut dyn Codec, link: &mut Linked) {
    let motors = [if matches!(protocol, Protocol::Open6(_)) { 0.25 } else { 9.0 }; 2];
    for _ in 0..300 {
        link.exchange(codec, &motors[..protocol.n_motors().min(2)], true);
    }
    assert!(link.firmware.motors()[0] > 0.1, "{name} is pressed: {:?}", link.firmware.motors());
}

fn hears(link: &mut Linked, bytes: &[u8]) {
    link.here.send(bytes).expect("open");
    link.pump();
    link.now_s += 3e-3;
}

#[test]
fn the_frame_of_the_guard_stops_the_motors_of_every_shipped_arm() {
    let arms = every_arm_with_motors();
    assert!(arms.len() > 12, "{}", arms.len());
    for (name, protocol, carriage) in arms {
        let (mut codec, mut link) = pressed(&protocol, carriage);
        press(name, &protocol, &mut *codec, &mut link);
        let zero = protocol.zero_frame(carriage);
        hears(&mut link, zero.as_slice());
        assert_eq!(link.firmware.motors(), [0.0; MAX_AXES], "{name}");
        // Once more changes nothing.
        hears(&mut link, zero.as_slice());
        assert_eq!(link.firmware.motors(), [0.0; MAX_AXES], "{name}");
    }
}

#[test]
fn behind_half_a_frame_the_second_one_does() {
    // A board without marks between frames is not among them: what follows half a command of it is
    // the other half.
    let marked = every_arm_with_motors().into_iter().filter(|(_, protocol, carriage)| {
        *carriage == Carriage::Stream && !matches!(protocol, Protocol::HapiF32(_))
    });
    for (name, protocol, carriage) in marked {
        let zero = protocol.zero_frame(carriage);
        let (mut codec, mut link) = pressed(&protocol, carriage);
        let whole = encode_enabled(&mut *codec, &[0.2], true);
        for n in 1..whole.len() {
            press(name, &protocol, &mut *codec, &mut link);
            hears(&mut link, &whole[..n]);
            hears(&mut link, zero.as_slice());
            hears(&mut link, zero.as_slice());
            assert_eq!(
                link.firmware.motors(),
                [0.0; MAX_AXES],
                "{name}: {n} of {} bytes",
                whole.len()
            );
            link.take();
            codec.resume();
        }
    }
}

#[test]
fn an_input_without_motors_needs_no_guard() {
    for protocol in [Protocol::SpaceMouse { dead_band: 0 }, Protocol::Spacenav] {
        assert!(protocol.zero_frame(protocol.carriages()[0]).is_empty());
    }
}
