//! Where a real arm is plugged in, what it speaks, how it finds its zero: `[match]`, `[protocol]`,
//! `[link]`, `[homing]` and what rests on them.

use std::path::Path;

use glam::{DMat3, DQuat, DVec3};

use super::written::{
    CodecWord, Identified as WrittenIdentified, ProfileFile, TransportWord, TurnWord,
};
use super::{
    Homing, HomingMode, Identified, Match, Profile, RealArm, Saturation, TransportKind, UsbId,
    ceilings, joints, known_answers, packet,
};
use crate::kinematics::Kinematics;
use crate::protocol::haply::ADDRESS;
use crate::protocol::{HapiBoard, HapiEncoder, HaplyService, Open6Arm, Protocol, Servo, Turn};
use crate::transport::Carriage;
use crate::vendor::{Family, VendorProtocol};
use document::{Checks, NOT_NEGATIVE, POSITIVE};
use vps::spatial::Axes;

/// Baud rate where a profile gives none: devices on USB ignore it.
const DEFAULT_BAUD: u32 = 115_200;

/// What a real arm has; `None` when too little of it is usable. Problems are noted in any case.
pub(super) fn real_arm(
    checks: &mut Checks<'_>,
    dir: &Path,
    written: &ProfileFile,
    codec: CodecWord,
    profile: &Profile,
) -> Option<RealArm> {
    let matching = matching(checks, written);
    let protocol = protocol(checks, dir, written, codec, profile);
    let device_from_native = frame(checks, written);
    let joints = joints::joints(checks, written, profile, device_from_native);
    let homing = homing(checks, written);
    let accepted = "false, until `hapticd devices probe PROFILE --sign-check` has passed on such \
        an arm; force stays below 0.5 N until then";
    let signs_verified =
        checks.given("device.signs_verified", written.device.signs_verified, accepted);
    let deadman_button = written.safety.as_ref().and_then(|safety| safety.deadman_button);
    let deadman_button = deadman_button
        .map(|button| checks.whole("safety.deadman_button", Some(button), 0, 0, 31) as u8);
    let identified =
        written.identified.as_ref().map(|identified| identified_of(checks, identified));
    let known = known_answers::read(checks, written);
    let matching = matching?;
    let protocol = protocol?;
    let joints = joints?;
    // What a codec of ours thinks of limits that are wrong already would only say it twice.
    let is_news = matches!(protocol, Protocol::Declarative(_)) || checks.is_clean();
    if let Some(error) = protocol.check().err().filter(|_| is_news) {
        checks.not_accepted(packet_or_protocol(&protocol), format_args!("sound: {error}"));
    }
    fit(checks, &matching, &protocol, profile);
    let joints::Joints { kinematics, transmission, thermal, n_readings, n_motors } = joints;
    if n_readings > protocol.n_readings() {
        let has = protocol.n_readings();
        checks.not_accepted(
            "device.kinematics",
            format_args!(
                "one of at most {has} readings, which is what `{}` sends{}",
                protocol.name(),
                if matches!(kinematics, Kinematics::Cartesian) {
                    "; cartesian takes 7 (x y z in m, then the quaternion x y z w)"
                } else {
                    ""
                }
            ),
        );
    }
    if n_motors > protocol.n_motors() {
        let has = protocol.n_motors();
        checks.not_accepted(
            "device.actuated",
            format_args!(
                "driven by at most {has} motors, which is what `{}` commands",
                protocol.name()
            ),
        );
    }
    let orientation_sensed = sensed_fits(checks, &kinematics, device_from_native, profile);
    let real = RealArm {
        protocol,
        matching,
        kinematics,
        transmission,
        device_from_native,
        homing,
        signs_verified: signs_verified.unwrap_or(false),
        watchdog_latched: written.link.watchdog_latched.unwrap_or(false),
        saturates_by: written.link.saturates_by.map_or(Saturation::Undefined, Into::into),
        kick_ms: written.link.kick_ms,
        thermal,
        orientation_sensed,
        deadman_button,
        identified,
        checks: known,
    };
    known_answers::judge(checks, &real);
    Some(real)
}

fn packet_or_protocol(protocol: &Protocol) -> &'static str {
    match protocol {
        Protocol::Declarative(_) => "packet",
        Protocol::Dynamixel2 { .. } => "joint",
        _ => "protocol",
    }
}

fn matching(checks: &mut Checks<'_>, written: &ProfileFile) -> Option<Match> {
    let accepted = "a table [match] with `transport` and what distinguishes this arm from others";
    let matching = checks.given("match", written.matching.as_ref(), accepted)?;
    let sixteen = |checks: &mut Checks<'_>, key: &str, number: Option<u32>| {
        number
            .map(|number| checks.whole(&format!("match.{key}"), Some(number), 0, 0, 0xFFFF) as u16)
    };
    let mut ids = Vec::new();
    match (
        sixteen(checks, "vendor_id", matching.vendor_id),
        sixteen(checks, "product_id", matching.product_id),
    ) {
        (Some(vendor), Some(product)) => ids.push(UsbId { vendor, product }),
        (Some(_), None) => checks.missing("match.product_id", "the product beside match.vendor_id"),
        (None, Some(_)) => checks.missing("match.vendor_id", "the vendor beside match.product_id"),
        (None, None) => {}
    }
    for (idx, id) in matching.ids.iter().flatten().enumerate() {
        let parsed = id.split_once(':').and_then(|(vendor, product)| {
            Some(UsbId {
                vendor: u16::from_str_radix(vendor, 16).ok()?,
                product: u16::from_str_radix(product, 16).ok()?,
            })
        });
        match parsed {
            Some(id) => ids.push(id),
            None => checks.not_accepted(
                &format!("match.ids[{idx}]"),
                "vendor and product in hexadecimal, such as \"256F:C635\"",
            ),
        }
    }
    let transport = match checks.given(
        "match.transport",
        matching.transport,
        "\"hid\", \"serial\", \"usb\", \"service\", \"library\" or \"none\"",
    )? {
        TransportWord::Hid => TransportKind::Hid,
        TransportWord::Serial => TransportKind::Serial,
        TransportWord::Usb => TransportKind::Usb,
        TransportWord::Service => TransportKind::Service,
        TransportWord::None => TransportKind::Socket,
        TransportWord::Library => TransportKind::Library,
    };
    let selects_hid = matching.usage_page.is_some() || matching.usage.is_some();
    if selects_hid && transport != TransportKind::Hid {
        checks.not_accepted("match.transport", "\"hid\": only HID interfaces have a usage");
    }
    if ids.is_empty() && matches!(transport, TransportKind::Hid | TransportKind::Usb) {
        checks.missing(
            "match.vendor_id",
            "vendor and product, since a name alone selects no USB device",
        );
    }
    Some(Match {
        transport,
        ids,
        usage_page: sixteen(checks, "usage_page", matching.usage_page),
        usage: sixteen(checks, "usage", matching.usage),
        interface: matching
            .interface
            .map(|number| checks.whole("match.interface", Some(number), 0, 0, 255) as u8),
        serial: matching.serial.clone(),
        product: matching.product.clone(),
        by_id: matching.by_id.clone(),
        baud: checks.whole("match.baud", matching.baud, DEFAULT_BAUD, 300, 12_000_000),
    })
}

fn protocol(
    checks: &mut Checks<'_>,
    dir: &Path,
    written: &ProfileFile,
    codec: CodecWord,
    profile: &Profile,
) -> Option<Protocol> {
    let nothing = super::written::Protocol::default();
    let given = written.protocol.as_ref().unwrap_or(&nothing);
    only_of(checks, given, codec);
    if written.packet.is_some() && codec != CodecWord::Declarative {
        checks.not_accepted("packet", "left out: only codec \"declarative\" is described by it");
    }
    Some(match codec {
        CodecWord::Sim => return None,
        CodecWord::WoodenhapticsHid8 | CodecWord::PolhemAscii64 => {
            Protocol::Declarative(packet::known(checks, codec, None, profile)?)
        }
        CodecWord::HaptikfabrikenHid14 => {
            let accepted = "\"mbed\" (reports of 14 bytes) or \"teensy-rawhid\" (of 64)";
            Protocol::HaptikfabrikenHid14 {
                carrier: checks.given("protocol.carrier", given.carrier, accepted)?.into(),
            }
        }
        CodecWord::HaptikfabrikenBrackets => {
            let accepted =
                "1 (Polhem 2022), 2 (vintage) or 3 (WoodenHaptics): what the arm calls itself";
            let model = checks.given("protocol.model", given.model, accepted)?;
            let model = checks.whole("protocol.model", Some(model), 0, 1, 3);
            Protocol::Declarative(packet::known(checks, codec, Some(model), profile)?)
        }
        CodecWord::HapiF32 => Protocol::HapiF32(board(checks, given)?),
        CodecWord::FalconNibble16 => {
            let image =
                given.firmware.as_ref().map(|name| checks.file("protocol.firmware", name, dir));
            Protocol::FalconNibble16 { image: image.flatten() }
        }
        CodecWord::HapkitAscii => Protocol::HapkitAscii,
        CodecWord::SpaceMouse => Protocol::SpaceMouse {
            dead_band: checks.whole("protocol.dead_band", given.dead_band, 10, 0, 300) as u16,
        },
        CodecWord::Spacenav => Protocol::Spacenav,
        CodecWord::Dynamixel2 => Protocol::Dynamixel2 { servos: servos(checks, written)? },
        CodecWord::HaplyService => Protocol::HaplyService(haply(checks, given, profile)),
        CodecWord::Open6 => Protocol::Open6(open6(checks, written, profile)?),
        CodecWord::ForceDimension => {
            Protocol::Vendor(vendor(checks, dir, written, profile, Family::ForceDimension)?)
        }
        CodecWord::Virtuose => {
            Protocol::Vendor(vendor(checks, dir, written, profile, Family::Virtuose)?)
        }
        CodecWord::OpenHaptics => {
            Protocol::Vendor(vendor(checks, dir, written, profile, Family::OpenHaptics)?)
        }
        CodecWord::Declarative => Protocol::Declarative(packet::written(checks, written, profile)?),
    })
}

/// Keys of [protocol] that another codec has.
fn only_of(checks: &mut Checks<'_>, given: &super::written::Protocol, codec: CodecWord) {
    let keys = [
        ("carrier", given.carrier.is_some(), CodecWord::HaptikfabrikenHid14),
        ("model", given.model.is_some(), CodecWord::HaptikfabrikenBrackets),
        ("firmware", given.firmware.is_some(), CodecWord::FalconNibble16),
        ("dead_band", given.dead_band.is_some(), CodecWord::SpaceMouse),
        ("device_id", given.device_id.is_some(), CodecWord::HapiF32),
        ("motor_direction", given.motor_direction.is_some(), CodecWord::HapiF32),
        ("encoder_direction", given.encoder_direction.is_some(), CodecWord::HapiF32),
        ("encoder_start_deg", given.encoder_start_deg.is_some(), CodecWord::HapiF32),
        ("encoder_counts_per_rev", given.encoder_counts_per_rev.is_some(), CodecWord::HapiF32),
        ("address", given.address.is_some(), CodecWord::HaplyService),
        ("arm", given.arm.is_some(), CodecWord::HaplyService),
        ("grip", given.grip.is_some(), CodecWord::HaplyService),
        ("service_version", given.service_version.is_some(), CodecWord::HaplyService),
    ];
    for (key, _, owner) in
        keys.into_iter().filter(|(_, is_written, owner)| *is_written && *owner != codec)
    {
        checks.not_accepted(
            &format!("protocol.{key}"),
            format_args!("left out: it belongs to codec \"{}\"", owner),
        );
    }
}

fn haply(
    checks: &mut Checks<'_>,
    given: &super::written::Protocol,
    profile: &Profile,
) -> HaplyService {
    let address = given.address.clone().unwrap_or_else(|| ADDRESS.to_owned());
    if !address
        .rsplit_once(':')
        .is_some_and(|(host, port)| !host.is_empty() && port.parse::<u16>().is_ok())
    {
        checks.not_accepted("protocol.address", "host and port, such as \"127.0.0.1:10001\"");
    }
    let version = given.service_version.as_ref().and_then(|text| {
        let version = text.parse().ok();
        if version.is_none() {
            checks.not_accepted("protocol.service_version", "major and minor, such as \"3.4\"");
        }
        version
    });
    HaplyService {
        address,
        arm: given.arm.clone(),
        grip: given.grip.clone(),
        has_grip: profile.sensed.contains(Axes::ROTATION),
        version,
    }
}

fn board(checks: &mut Checks<'_>, given: &super::written::Protocol) -> Option<HapiBoard> {
    let turn = |word: &TurnWord| Turn::from(*word);
    let (Some(motors), Some(directions), Some(starts), Some(counts)) = (
        &given.motor_direction,
        &given.encoder_direction,
        &given.encoder_start_deg,
        &given.encoder_counts_per_rev,
    ) else {
        checks.missing(
            "protocol",
            "motor_direction, encoder_direction, encoder_start_deg and encoder_counts_per_rev, \
                each in port order",
        );
        return None;
    };
    if starts.len() != directions.len() || counts.len() != directions.len() {
        let n = directions.len();
        checks.not_accepted(
            "protocol.encoder_direction",
            format_args!(
                "of the same length as encoder_start_deg and encoder_counts_per_rev, now {n}"
            ),
        );
        return None;
    }
    let encoders = directions.iter().zip(starts).zip(counts);
    Some(HapiBoard {
        device_id: checks.whole("protocol.device_id", given.device_id, 5, 1, 255) as u8,
        motors: motors.iter().map(turn).collect(),
        encoders: encoders
            .map(|((direction, start_deg), counts_per_rev)| HapiEncoder {
                direction: turn(direction),
                start_deg: *start_deg as f32,
                counts_per_rev: *counts_per_rev as f32,
            })
            .collect(),
    })
}

fn servos(checks: &mut Checks<'_>, written: &ProfileFile) -> Option<Vec<Servo>> {
    let mut servos = Vec::new();
    for (idx, joint) in written.joint.iter().enumerate() {
        match (joint.servo_id, joint.servo_model) {
            (Some(id), Some(model)) => {
                let id = checks.whole(&format!("joint[{idx}].servo_id"), Some(id), 0, 0, 252) as u8;
                servos.push(Servo { id, model: model.into() });
            }
            (None, _) => {
                checks.missing(&format!("joint[{idx}].servo_id"), "the id of the servo on the bus")
            }
            (_, None) => checks
                .missing(&format!("joint[{idx}].servo_model"), "\"XC330-T288\" or \"XM430-W210\""),
        }
    }
    (servos.len() == written.joint.len() && !servos.is_empty()).then_some(servos)
}

/// An arm behind a library of its maker. The library may be on another machine than the profile, so
/// that it is not looked for here.
fn vendor(
    checks: &mut Checks<'_>,
    dir: &Path,
    written: &ProfileFile,
    profile: &Profile,
    family: Family,
) -> Option<VendorProtocol> {
    let library = written
        .protocol
        .as_ref()
        .and_then(|given| given.library.as_ref())
        .map(|name| dir.join(name));
    Some(VendorProtocol { family, library, home: false, arm: open6(checks, written, profile)? })
}

fn open6(checks: &mut Checks<'_>, written: &ProfileFile, profile: &Profile) -> Option<Open6Arm> {
    let Some(watchdog_ms) = written.link.device_watchdog_ms else {
        checks.missing(
            "link.device_watchdog_ms",
            "a whole number of ms: an arm of this protocol has a watchdog",
        );
        return None;
    };
    Some(Open6Arm {
        name: profile.name.clone(),
        sensed: profile.sensed,
        actuated: profile.actuated,
        rate_hz: u16::try_from(profile.link.rate_hz).unwrap_or(u16::MAX),
        // Its range is that of every arm.
        watchdog_ms: watchdog_ms.min(ceilings::WATCHDOG_MS) as u16,
        force_n: profile.limits.force_n as f32,
        torque_nm: profile.limits.torque_nm as f32,
        workspace_radius_m: profile.limits.workspace_radius_m as f32,
    })
}

/// What the protocol says of itself against what the profile says.
fn fit(checks: &mut Checks<'_>, matching: &Match, protocol: &Protocol, profile: &Profile) {
    let carriage = matching.transport.carriage();
    let is_bulk = matches!(protocol, Protocol::FalconNibble16 { .. });
    let is_socket = matches!(protocol, Protocol::Spacenav);
    let is_service = matches!(protocol, Protocol::HaplyService(_));
    let is_library = matches!(protocol, Protocol::Vendor(_));
    let is_served = protocol.carriages().contains(&carriage)
        && is_bulk == (matching.transport == TransportKind::Usb)
        && is_socket == (matching.transport == TransportKind::Socket)
        && is_service == (matching.transport == TransportKind::Service)
        && is_library == (matching.transport == TransportKind::Library);
    if !is_served {
        let accepted: Vec<&str> = match (is_bulk, is_socket) {
            (true, _) => vec!["\"usb\""],
            (_, true) => vec!["\"none\""],
            _ if is_service => vec!["\"service\""],
            _ if is_library => vec!["\"library\""],
            _ => protocol
                .carriages()
                .iter()
                .map(
                    |carriage| {
                        if *carriage == Carriage::Reports { "\"hid\"" } else { "\"serial\"" }
                    },
                )
                .collect(),
        };
        checks.not_accepted(
            "match.transport",
            format_args!("{}: `{}` travels so", accepted.join(" or "), protocol.name()),
        );
    }
    if protocol.pacing() != profile.link.pacing {
        let pacing = match protocol.pacing() {
            crate::Pacing::PingPong => "ping-pong",
            crate::Pacing::Stream => "stream",
            crate::Pacing::Event => "event",
        };
        checks.not_accepted(
            "link.pacing",
            format_args!("\"{pacing}\": so does `{}` talk", protocol.name()),
        );
    }
}

/// The signed permutation of [frame], which has to be a rotation.
fn frame(checks: &mut Checks<'_>, written: &ProfileFile) -> DQuat {
    const KEY: &str = "frame.device_from_native";
    let Some(axes) = written.frame.as_ref().and_then(|frame| frame.device_from_native.as_ref())
    else {
        checks.missing(
            KEY,
            "the native axis along each device axis (x toward the operator, y right, z up), such \
                as [\"+x\", \"+y\", \"+z\"]",
        );
        return DQuat::IDENTITY;
    };
    let axis = |name: &str| {
        let (sign, axis) = name.split_at_checked(1)?;
        let axis = match axis {
            "x" => DVec3::X,
            "y" => DVec3::Y,
            "z" => DVec3::Z,
            _ => return None,
        };
        match sign {
            "+" => Some(axis),
            "-" => Some(-axis),
            _ => None,
        }
    };
    let parsed: Vec<DVec3> = axes.iter().filter_map(|name| axis(name)).collect();
    let [x, y, z] = parsed[..] else {
        checks.not_accepted(KEY, "three of \"+x\", \"-x\", \"+y\", \"-y\", \"+z\", \"-z\"");
        return DQuat::IDENTITY;
    };
    if axes.len() != 3 || DMat3::from_cols(x, y, z).determinant() != 1.0 {
        checks.not_accepted(
            KEY,
            "a proper rotation: each axis once, and a right-handed frame (turn one sign)",
        );
        return DQuat::IDENTITY;
    }
    // Row i is the native axis along device axis i.
    DQuat::from_mat3(&DMat3::from_cols(x, y, z).transpose()).normalize()
}

fn homing(checks: &mut Checks<'_>, written: &ProfileFile) -> Homing {
    let Some(homing) =
        checks.given("homing", written.homing.as_ref(), "a table [homing] with `mode`")
    else {
        return Homing::default();
    };
    let accepted =
        "\"none\", \"power-on-pose\", \"host-offset\", \"device-command\" or \"device-procedure\"";
    let mode =
        checks.given("homing.mode", homing.mode, accepted).map_or(HomingMode::None, Into::into);
    if mode != HomingMode::None && homing.instruction.is_none() {
        checks.missing("homing.instruction", "a sentence that says what the user has to do");
    }
    Homing { mode, instruction: homing.instruction.clone() }
}

fn identified_of(checks: &mut Checks<'_>, written: &WrittenIdentified) -> Identified {
    if written.round_trip_ticks.is_none() {
        checks.missing(
            "identified.round_trip_ticks",
            "a whole number of ticks, as `hapticd devices probe PROFILE --identify` writes it",
        );
    }
    Identified {
        round_trip_ticks: checks.whole(
            "identified.round_trip_ticks",
            written.round_trip_ticks,
            1,
            0,
            100,
        ),
        mass_kg: checks.required(
            "identified.mass_kg",
            written.mass_kg,
            POSITIVE.to(ceilings::MASS_KG).unit("kg"),
        ),
        damping_n_s_per_m: checks.required(
            "identified.damping_n_s_per_m",
            written.damping_n_s_per_m,
            NOT_NEGATIVE.to(ceilings::DAMPING_N_S_PER_M).unit("N·s/m"),
        ),
        inertia_kg_m2: checks.optional(
            "identified.inertia_kg_m2",
            written.inertia_kg_m2,
            POSITIVE.to(ceilings::INERTIA_KG_M2).unit("kg·m²"),
        ),
        damping_nm_s_per_rad: checks.optional(
            "identified.damping_nm_s_per_rad",
            written.damping_nm_s_per_rad,
            NOT_NEGATIVE.to(ceilings::DAMPING_NM_S_PER_RAD).unit("N·m·s/rad"),
        ),
    }
}

/// The axes that the profile claims against those that its joints determine. True where orientation
/// is measured.
fn sensed_fits(
    checks: &mut Checks<'_>,
    kinematics: &Kinematics,
    device_from_native: DQuat,
    profile: &Profile,
) -> bool {
    let native = kinematics.axes();
    let orientation_sensed = native.contains(Axes::ROTATION);
    if matches!(kinematics, Kinematics::Rate(_)) {
        return profile.sensed.contains(Axes::ROTATION);
    }
    let mut determined = if orientation_sensed { Axes::ROTATION } else { Axes::NONE };
    for (native_idx, axis) in
        DVec3::AXES.into_iter().enumerate().filter(|(native_idx, _)| native.has(*native_idx))
    {
        let along = (device_from_native * axis).abs().max_position();
        let name = Axes::NAMES.get(along).or(Axes::NAMES.get(native_idx));
        determined =
            determined.union(name.and_then(|name| Axes::from_name(name)).unwrap_or_default());
    }
    let grip = Axes::from_name("grip").unwrap_or_default();
    if !determined.union(grip).contains(profile.sensed) {
        let names: Vec<&str> = determined.names().collect();
        checks.not_accepted(
            "device.sensed",
            format_args!(
                "a subset of {}, which is what the joints of the arm determine",
                names.join(" ")
            ),
        );
    }
    orientation_sensed && profile.sensed.contains(Axes::ROTATION)
}
