//! What the target of the protocols does with its bytes. The tests of the program include this file
//! and replay the corpus.

use std::path::Path;
use std::sync::OnceLock;

use arms::Pacing;
use arms::protocol::layout::{
    Checksum, ChecksumKind, Field, Framing, LineFraming, LinePad, Number, Packet, Role,
};
use arms::protocol::{
    ArmReadings, HapiBoard, HapiEncoder, Hid14Carrier, MAX_AXES, MotorCommand, Open6Arm, Outbox,
    PacketLayout, Protocol, Servo, ServoModel, Turn,
};
use arms::transport::{Carriage, FRAME_MAX, Frame};
use vps::spatial::Axes;

/// How many protocols there are to choose from.
pub(crate) const N: u8 = 20;

/// The protocol of that number. The last five are layouts, one per framing.
pub(crate) fn protocol(number: u8) -> (Protocol, Carriage) {
    let encoder =
        HapiEncoder { direction: Turn::Clockwise, start_deg: 180.0, counts_per_rev: 13824.0 };
    let reports = Carriage::Reports;
    let stream = Carriage::Stream;
    match number % N {
        0 => (shipped(0), reports),
        1 => (Protocol::HaptikfabrikenHid14 { carrier: Hid14Carrier::Mbed }, reports),
        2 => (Protocol::HaptikfabrikenHid14 { carrier: Hid14Carrier::TeensyRawHid }, reports),
        3..=5 => (shipped(usize::from(number % N) - 2), stream),
        6 => (
            Protocol::HapiF32(HapiBoard {
                device_id: 5,
                motors: vec![Turn::Clockwise; 2],
                encoders: vec![encoder; 2],
            }),
            stream,
        ),
        7 => (Protocol::FalconNibble16 { image: None }, stream),
        8 => (Protocol::HapkitAscii, stream),
        9 => (Protocol::SpaceMouse { dead_band: 10 }, reports),
        10 => (Protocol::Spacenav, stream),
        11 => (
            Protocol::Dynamixel2 {
                servos: (1..=7).map(|id| Servo { id, model: ServoModel::Xm430W210 }).collect(),
            },
            stream,
        ),
        12 => (
            Protocol::Dynamixel2 { servos: vec![Servo { id: 1, model: ServoModel::Xc330T288 }] },
            stream,
        ),
        13 | 14 => {
            let arm = Open6Arm {
                name: "test arm".to_owned(),
                sensed: Axes::SIX,
                actuated: Axes::SIX,
                rate_hz: 1000,
                watchdog_ms: 100,
                force_n: 12.0,
                torque_nm: 0.5,
                workspace_radius_m: 0.1,
            };
            (Protocol::Open6(arm), if number % N == 13 { reports } else { stream })
        }
        number => {
            let layout = layout(number - 15);
            let carriage = layout.carriages()[0];
            (Protocol::Declarative(layout), carriage)
        }
    }
}

/// What a shipped arm speaks whose codec is described as data.
fn shipped(idx: usize) -> Protocol {
    static PROTOCOLS: OnceLock<[Protocol; 4]> = OnceLock::new();
    let names = ["woodenhaptics-v15", "polhem-2020", "polhem-2022", "woodenhaptics-2022"];
    let read = |name| {
        let profile = arms::profile::find(name, Path::new("")).expect(name);
        profile.real.expect("real").protocol
    };
    PROTOCOLS.get_or_init(|| names.map(read))[idx].clone()
}

fn layout(number: u8) -> PacketLayout {
    let check = |kind, big_endian| Some(Checksum { kind, big_endian });
    let (framing, checksum) = match number {
        0 => (Framing::Report { id: Some(7), len: 14 }, check(ChecksumKind::Crc16Modbus, false)),
        1 => (
            Framing::Sync { sync: vec![0xAA, 0x55], len: 14, covers_sync: true },
            check(ChecksumKind::Crc16Ccitt, true),
        ),
        2 => (Framing::Cobs { len: 16 }, check(ChecksumKind::Crc32, false)),
        3 => (Framing::Slip { len: 13 }, check(ChecksumKind::Sum8, false)),
        _ => {
            let pad = Some(LinePad { byte: 0, len: 16, before_close: false });
            (
                Framing::Line(LineFraming {
                    open: "[".to_owned(),
                    separator: b',',
                    close: "]\n".to_owned(),
                    pad,
                }),
                None,
            )
        }
    };
    let is_line = matches!(framing, Framing::Line(_));
    let fields = |binary: [Field; 5]| -> Vec<Field> {
        let text = |(offset, field): (usize, Field)| Field {
            offset,
            number: Number::Text { places: 0 },
            mask: None,
            wraps: false,
            ..field
        };
        if is_line {
            binary
                .into_iter()
                .filter(|field| field.role != Role::Counter)
                .enumerate()
                .map(text)
                .collect()
        } else {
            binary.to_vec()
        }
    };
    let report = fields([
        Field { wraps: true, scale: 0.5, ..Field::new(Role::Reading(0), 0, Number::I16) },
        Field { big_endian: true, ..Field::new(Role::Reading(1), 2, Number::I32) },
        Field { mask: Some(0xF0), ..Field::new(Role::Buttons(3), 6, Number::U8) },
        Field::new(Role::Counter, 7, Number::U8),
        Field::new(Role::Rate(0), 8, if is_line { Number::I32 } else { Number::F32 }),
    ]);
    let command = fields([
        Field { scale: 2.0, ..Field::new(Role::Motor(0), 0, Number::I16) },
        Field::new(Role::Motor(1), 2, if is_line { Number::I32 } else { Number::F32 }),
        Field::new(Role::Enabled, 6, Number::U8),
        Field::new(Role::Constant(9), 7, Number::U16),
        Field::new(Role::Constant(-1), 9, Number::I8),
    ]);
    PacketLayout {
        name: "declarative",
        report: Packet { framing: framing.clone(), checksum, fields: report },
        command: Some(Packet { framing, checksum, fields: command }),
        kick: None,
        pacing: if number == 0 { Pacing::Event } else { Pacing::PingPong },
        watchdog_ms: Some(100),
    }
}

/// First byte: the protocol; second byte: the size of the pieces less one, 127 is all at once; the
/// top bit sends them to the arm instead of the host. The rest comes over the link. Gives how many
/// reports the host saw, or how many frames the arm answered.
///
/// # Panics
/// Whenever bytes lead to one, to numbers that are none, or to a frame that is too long.
pub(crate) fn exercise(bytes: &[u8]) -> usize {
    let [number, pieces, rest @ ..] = bytes else { return 0 };
    let (protocol, carriage) = protocol(*number);
    let size = match pieces & 0x7F {
        0x7F => usize::MAX,
        size => usize::from(size) + 1,
    };
    let arm = ArmReadings {
        readings: [0.1, -0.2, 0.3, 0.0, 0.0, 0.6, 0.8, 0.0],
        rates: [1.0; MAX_AXES],
        buttons: 5,
        homed: true,
        asleep: false,
    };
    if pieces & 0x80 != 0 {
        let mut firmware = protocol.firmware(carriage);
        let mut out = Outbox::new();
        for (idx, piece) in rest.chunks(size).enumerate() {
            firmware.receive(piece, idx as f64 * 1e-3, &arm, &mut out);
            assert!(
                firmware.motors().iter().all(|motor| motor.is_finite()),
                "a motor is driven with a number that is none"
            );
        }
        let n_answers = out.len();
        firmware.advance(1e3, &arm, &mut out);
        // A host understands whatever its arm says.
        let mut codec = protocol.codec(carriage);
        for frame in &out {
            codec.feed(frame);
        }
        return n_answers;
    }
    let mut codec = protocol.codec(carriage);
    let mut frame = Frame::default();
    let mut n_reports = 0;
    for piece in rest.chunks(size) {
        let fed = codec.feed(piece);
        n_reports += fed.reports as usize;
        let report = codec.newest();
        assert!(
            report.readings.iter().all(|reading| reading.is_finite()),
            "a reading is a number that is none"
        );
        assert!(
            report.rates.iter().flatten().all(|rate| rate.is_finite()),
            "a rate is a number that is none"
        );
        // Any command only where a fuzzer builds: elsewhere the motor stage alone makes one that
        // moves something.
        #[cfg(fuzzing)]
        let command = MotorCommand::of(report.readings, fed.corrupt == 0);
        #[cfg(not(fuzzing))]
        let command = MotorCommand::at_rest(fed.corrupt == 0);
        codec.encode(&command, &mut frame);
        assert!(frame.as_slice().len() <= FRAME_MAX);
        if codec.silence().is_some() {
            codec.resume();
        }
    }
    n_reports
}
