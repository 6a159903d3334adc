//! A profile as it is written. Foreign units, nothing checked but names and types. The comments are
//! what editors show.

use schemars::JsonSchema;
use serde::Deserialize;
use serde::de::IgnoredAny;

use super::{HomingMode, Saturation};
use crate::Pacing;
use crate::kinematics::Gimbal;
use crate::protocol::layout::ChecksumKind;
use crate::protocol::{Hid14Carrier, ServoModel, Turn};
use document::{Numbers, words};

/// A device profile of hapticd.
#[derive(Debug, Default, Deserialize, JsonSchema)]
#[schemars(rename = "profile")]
#[serde(deny_unknown_fields, default, expecting = "a device profile")]
pub(super) struct ProfileFile {
    /// Format of the file: 1.
    #[serde(rename = "version")]
    #[schemars(with = "u32", extend("const" = 1))]
    pub(super) _version: Option<IgnoredAny>,
    pub(super) device: Device,
    #[serde(rename = "match")]
    pub(super) matching: Option<Match>,
    pub(super) protocol: Option<Protocol>,
    pub(super) link: Link,
    pub(super) frame: Option<WrittenFrame>,
    pub(super) homing: Option<Homing>,
    pub(super) geometry: Option<Geometry>,
    /// Joints of a chain, from base to grip.
    pub(super) joint: Vec<Joint>,
    pub(super) limits: Limits,
    pub(super) signal: Signal,
    pub(super) motors: Option<Motors>,
    pub(super) safety: Option<Safety>,
    pub(super) plant: Plant,
    pub(super) identified: Option<Identified>,
    pub(super) packet: Option<Packets>,
    /// Reports or readings with the position that they mean.
    pub(super) check: Vec<Check>,
}

/// What the arm is.
#[derive(Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default, expecting = "a table, written [device]")]
pub(super) struct Device {
    /// What scenes write.
    pub(super) name: Option<String>,
    /// Name for people.
    pub(super) title: Option<String>,
    /// Protocol that the arm speaks; "sim": the simulated arm.
    pub(super) codec: Option<CodecWord>,
    /// How its joints move the grip.
    pub(super) kinematics: Option<KinematicsWord>,
    /// Axes that are measured.
    #[schemars(extend("items" = {"enum": ["x", "y", "z", "rx", "ry", "rz", "grip"]}))]
    pub(super) sensed: Option<Vec<String>>,
    /// Axes with a motor, a subset of `sensed`.
    #[schemars(extend("items" = {"enum": ["x", "y", "z", "rx", "ry", "rz", "grip"]}))]
    pub(super) actuated: Option<Vec<String>>,
    /// A test on such an arm has shown that the motors push the way the encoders count.
    pub(super) signs_verified: Option<bool>,
}

/// Where the arm is plugged in.
#[derive(Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default, expecting = "a table, written [match]")]
pub(super) struct Match {
    /// How its bytes travel; "service": through a program of its maker; "library": a library of its
    /// maker; "none": a socket of another program.
    pub(super) transport: Option<TransportWord>,
    pub(super) vendor_id: Option<u32>,
    pub(super) product_id: Option<u32>,
    /// Several devices of one kind: "VVVV:PPPP" in hexadecimal.
    pub(super) ids: Option<Vec<String>>,
    /// HID usage page of the interface.
    pub(super) usage_page: Option<u32>,
    /// HID usage of the interface.
    pub(super) usage: Option<u32>,
    /// USB interface number.
    pub(super) interface: Option<u32>,
    pub(super) serial: Option<String>,
    /// Part of the product string.
    pub(super) product: Option<String>,
    /// Part of the stable name under /dev/serial/by-id.
    pub(super) by_id: Option<String>,
    /// Baud rate of a tty.
    pub(super) baud: Option<u32>,
}

/// What the protocol has to be reported.
#[derive(Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default, expecting = "a table, written [protocol]")]
pub(super) struct Protocol {
    /// haptikfabriken-hid14: board.
    pub(super) carrier: Option<CarrierWord>,
    /// haptikfabriken-brackets: 1 Polhem 2022, 2 vintage, 3 WoodenHaptics.
    pub(super) model: Option<u32>,
    /// force-dimension, open-haptics, virtuose: the library of the maker, where it is not in one of
    /// the usual places.
    pub(super) library: Option<String>,
    /// falcon-nibble16: firmware image that the user owns.
    pub(super) firmware: Option<String>,
    /// 3dconnexion-hid: counts that mean rest.
    pub(super) dead_band: Option<u32>,
    /// hapi-f32: id that the host gives the board.
    pub(super) device_id: Option<u32>,
    /// hapi-f32: direction of each motor, in port order.
    pub(super) motor_direction: Option<Vec<TurnWord>>,
    /// hapi-f32: direction of each encoder, in port order.
    pub(super) encoder_direction: Option<Vec<TurnWord>>,
    /// hapi-f32: angle of each encoder at setup, in port order.
    pub(super) encoder_start_deg: Option<Vec<f64>>,
    /// hapi-f32: counts per turn of each encoder, in port order.
    pub(super) encoder_counts_per_rev: Option<Vec<f64>>,
    /// haply-service: host and port of the service.
    pub(super) address: Option<String>,
    /// haply-service: id of the arm, where the service has several.
    pub(super) arm: Option<String>,
    /// haply-service: id of the grip, where the service has several.
    pub(super) grip: Option<String>,
    /// haply-service: version of the service, where it does not say it itself, such as "3.4".
    pub(super) service_version: Option<String>,
}

/// How reports and commands travel.
#[derive(Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default, expecting = "a table, written [link]")]
pub(super) struct Link {
    /// Who sets the rate.
    pub(super) pacing: Option<PacingWord>,
    /// Nominal rate.
    pub(super) rate_hz: Option<u32>,
    /// Silence after which the device lets go; leave out when it never does.
    pub(super) device_watchdog_ms: Option<u32>,
    /// After the watchdog tripped, the next command does not enable the motors by itself.
    pub(super) watchdog_latched: Option<bool>,
    /// The motors keep the last command when the link closes.
    pub(super) holds_last_command: Option<bool>,
    /// Largest current of each motor, in the order of the joints.
    pub(super) current_limit_ma: Option<Vec<f64>>,
    /// Largest command of each motor in the unit of the wire, in the order of the joints.
    pub(super) command_limit: Option<Vec<f64>>,
    /// What the arm does with a command above its limit.
    pub(super) saturates_by: Option<SaturationWord>,
    /// Silence after which the arm is woken.
    pub(super) kick_ms: Option<u32>,
}

/// Native frame.
#[derive(Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default, expecting = "a table, written [frame]")]
pub(super) struct WrittenFrame {
    /// Native axis along each of the device axes x (toward the operator), y (right), z (up).
    #[schemars(extend("items" = {"enum": ["+x", "-x", "+y", "-y", "+z", "-z"]}, "minItems" = 3, "maxItems" = 3))]
    pub(super) device_from_native: Option<Vec<String>>,
}

/// How the arm finds its zero.
#[derive(Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default, expecting = "a table, written [homing]")]
pub(super) struct Homing {
    pub(super) mode: Option<HomingWord>,
    /// What a person has to do, in a sentence.
    pub(super) instruction: Option<String>,
}

/// Lengths, gears, encoders and motors; which keys belong here is decided by `device.kinematics`.
#[derive(Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default, expecting = "a table, written [geometry]")]
pub(super) struct Geometry {
    /// Diameter of the capstan of each joint.
    pub(super) capstan_diameter_mm: Option<Vec<f64>>,
    /// Diameter of the body that it drives.
    pub(super) body_diameter_mm: Option<Vec<f64>>,
    /// Lengths of the links.
    pub(super) length_mm: Option<Vec<f64>>,
    /// Centre of the workspace in the frame of the geometry.
    pub(super) origin_m: Option<Numbers<3>>,
    /// Counts per turn of each encoder.
    pub(super) counts_per_rev: Option<Vec<f64>>,
    /// Torque constant of each motor.
    pub(super) torque_constant_nm_per_a: Option<Vec<f64>>,
    /// Command per N·m at the joint, for motors that do not take mA.
    pub(super) command_per_nm: Option<Vec<f64>>,
    /// +1 or −1 for each joint.
    pub(super) encoder_sign: Option<Vec<f64>>,
    /// +1 or −1 for each motor.
    pub(super) motor_sign: Option<Vec<f64>>,
    /// Counts that are added to the reading.
    pub(super) home_counts: Option<Vec<f64>>,
    /// Angle at the home counts.
    pub(super) joint_offset_rad: Option<Vec<f64>>,
    /// Real amperes per commanded ampere.
    pub(super) current_scale: Option<f64>,
    /// Axis of the first wrist joint; leave out without a wrist.
    pub(super) gimbal: Option<GimbalWord>,
    pub(super) gimbal_counts_per_rev: Option<Vec<f64>>,
    pub(super) gimbal_sign: Option<Vec<f64>>,
    pub(super) gimbal_home_counts: Option<Vec<f64>>,
    /// Hold the weight of the links.
    pub(super) gravity_compensation: Option<bool>,
    /// Mass of each link.
    pub(super) link_mass_g: Option<Vec<f64>>,
    /// Centre of mass along each link.
    pub(super) link_along_mm: Option<Vec<f64>>,
    /// Centre of mass across each link.
    pub(super) link_across_mm: Option<Vec<f64>>,
    /// pantograph: driven arm l.
    pub(super) inner_mm: Option<f64>,
    /// pantograph: outer arm L.
    pub(super) outer_mm: Option<f64>,
    /// pantograph: distance of the motors d.
    pub(super) distance_mm: Option<f64>,
    /// pantograph: port of arm 1 and arm 2.
    pub(super) arm_port: Option<Vec<u32>>,
    /// pantograph: commanded torque per physical torque.
    pub(super) torque_scale: Option<f64>,
    /// falcon-delta: a.
    pub(super) driven_mm: Option<f64>,
    /// falcon-delta: b.
    pub(super) rod_mm: Option<f64>,
    /// falcon-delta: c, d, e, f.
    pub(super) offset_mm: Option<Numbers<4>>,
    /// falcon-delta: r.
    pub(super) radius_mm: Option<f64>,
    /// falcon-delta: s.
    pub(super) shift_mm: Option<f64>,
    /// falcon-delta: azimuth of each leg.
    pub(super) azimuth_deg: Option<Numbers<3>>,
    /// chain: grip at zero angles.
    pub(super) grip_position_m: Option<Numbers<3>>,
    /// chain: grip at zero angles, x y z w.
    pub(super) grip_orientation_xyzw: Option<Numbers<4>>,
    /// one-axis: way of the handle per radian; 1 for a reading in metres.
    pub(super) m_per_rad: Option<f64>,
    /// none: reading at full deflection.
    pub(super) full_scale: Option<f64>,
    /// none: speed at full deflection.
    pub(super) linear_mm_per_s: Option<f64>,
    /// none: angular speed at full deflection.
    pub(super) angular_deg_per_s: Option<f64>,
}

/// One joint of a chain.
#[derive(Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default, expecting = "a table, written [[joint]]")]
pub(super) struct Joint {
    /// Axis at zero angles, native.
    pub(super) axis: Option<Numbers<3>>,
    /// A point on the axis at zero angles, native.
    pub(super) point_m: Option<Numbers<3>>,
    /// The joint slides along its axis.
    pub(super) slides: Option<bool>,
    /// +1 or −1: of encoder and motor.
    pub(super) sign: Option<f64>,
    /// Angle at the home reading.
    pub(super) offset_rad: Option<f64>,
    /// Added to the reading.
    pub(super) home_counts: Option<f64>,
    /// Counts per turn at the joint.
    pub(super) counts_per_rev: Option<f64>,
    /// Command per N·m at the joint; 0 for a joint without a motor.
    pub(super) counts_per_nm: Option<f64>,
    /// Largest command.
    pub(super) limit_counts: Option<f64>,
    /// Command that the motor carries for ever.
    pub(super) continuous_counts: Option<f64>,
    /// dynamixel2: id on the bus.
    pub(super) servo_id: Option<u32>,
    /// dynamixel2: model.
    pub(super) servo_model: Option<ServoWord>,
    /// Angle near the middle of the workspace.
    pub(super) home_rad: Option<f64>,
    /// Mass that moves with this joint and not with the next, for gravity compensation.
    pub(super) mass_g: Option<f64>,
    /// Its centre at zero angles, native.
    pub(super) center_m: Option<Numbers<3>>,
    /// Damping that is added to the torque of the motor.
    pub(super) damping_nm_s_per_rad: Option<f64>,
}

/// What the arm takes, as declared by its maker.
#[derive(Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default, expecting = "a table, written [limits]")]
pub(super) struct Limits {
    /// Largest |F|; 0 where no translation is actuated.
    pub(super) force_n: Option<f64>,
    /// Largest |torque|; 0 where no rotation is actuated.
    pub(super) torque_nm: Option<f64>,
    pub(super) stiffness_n_per_m: Option<f64>,
    pub(super) stiffness_nm_per_rad: Option<f64>,
    /// Largest rendered damping.
    pub(super) damping_n_s_per_m: Option<f64>,
    pub(super) damping_nm_s_per_rad: Option<f64>,
    /// Radius of the ball in which the grip moves.
    pub(super) workspace_radius_m: Option<f64>,
}

/// How samples are treated.
#[derive(Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default, expecting = "a table, written [signal]")]
pub(super) struct Signal {
    /// Windows over which position and orientation are differentiated.
    pub(super) velocity_window_ms: Option<Numbers<2>>,
}

/// Heat of the motors (I²t).
#[derive(Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default, expecting = "a table, written [motors]")]
pub(super) struct Motors {
    /// Current that each motor carries for ever, in the order of the joints.
    pub(super) continuous_current_ma: Option<Vec<f64>>,
    /// Command that each motor carries for ever, in the unit of the wire.
    pub(super) continuous_command: Option<Vec<f64>>,
    /// Time constant of the winding.
    pub(super) thermal_time_s: Option<f64>,
}

/// Rules of this arm beside those of every arm.
#[derive(Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default, expecting = "a table, written [safety]")]
pub(super) struct Safety {
    /// Button that has to be held for force, from 0.
    pub(super) deadman_button: Option<u32>,
}

/// What the simulated twin is made of.
#[derive(Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default, expecting = "a table, written [plant]")]
pub(super) struct Plant {
    /// Apparent mass at the grip.
    pub(super) mass_kg: Option<f64>,
    /// Viscosity.
    pub(super) damping_n_s_per_m: Option<f64>,
    pub(super) inertia_kg_m2: Option<f64>,
    pub(super) damping_nm_s_per_rad: Option<f64>,
    /// Coulomb friction.
    pub(super) coulomb_n: Option<f64>,
    pub(super) coulomb_nm: Option<f64>,
    /// Step of a measured position; 0: continuous.
    pub(super) encoder_step_mm: Option<f64>,
    pub(super) encoder_step_rad: Option<f64>,
    /// Ticks from a command to its force.
    pub(super) delay_ticks: Option<u32>,
}

/// What `hapticd devices probe --identify` measured on this arm.
#[derive(Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default, expecting = "a table, written [identified]")]
pub(super) struct Identified {
    pub(super) round_trip_ticks: Option<u32>,
    pub(super) mass_kg: Option<f64>,
    pub(super) damping_n_s_per_m: Option<f64>,
    pub(super) inertia_kg_m2: Option<f64>,
    pub(super) damping_nm_s_per_rad: Option<f64>,
}

/// Frames described as data, for codec "declarative".
#[derive(Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default, expecting = "a table, written [packet]")]
pub(super) struct Packets {
    /// Arm to host.
    pub(super) report: Option<Packet>,
    /// Host to arm.
    pub(super) command: Option<Packet>,
    /// Whole frame that wakes the arm and moves nothing, as hex bytes.
    pub(super) kick_hex: Option<String>,
}

/// One packet.
#[derive(Debug, Default, Deserialize, JsonSchema)]
#[serde(
    deny_unknown_fields,
    default,
    expecting = "a table, written [packet.report] or [packet.command]"
)]
pub(super) struct Packet {
    pub(super) framing: Option<FramingWord>,
    /// Bytes of the body, checksum included.
    pub(super) length: Option<u32>,
    /// report: ID of a numbered HID report.
    pub(super) report_id: Option<u32>,
    /// sync: fixed bytes before the body, as hex.
    pub(super) sync_hex: Option<String>,
    /// sync: the checksum covers the fixed bytes too.
    pub(super) checksum_covers_sync: Option<bool>,
    /// line: before the first number.
    pub(super) open: Option<String>,
    /// line: between numbers, one character.
    pub(super) separator: Option<String>,
    /// line: after the last number.
    pub(super) close: Option<String>,
    /// line: least bytes of a frame.
    pub(super) pad_length: Option<u32>,
    /// line: byte to pad with, 0 or 32.
    pub(super) pad_byte: Option<u32>,
    /// line: pad before `close`.
    pub(super) pad_before_close: Option<bool>,
    pub(super) checksum: Option<ChecksumWord>,
    /// High byte of the checksum first.
    pub(super) checksum_big_endian: Option<bool>,
    pub(super) fields: Vec<Field>,
}

/// One value of a packet.
#[derive(Debug, Default, Deserialize, JsonSchema)]
#[serde(
    deny_unknown_fields,
    default,
    expecting = "a table, such as { role = \"reading\", index = 0, offset = 0, type = \"i16\" }"
)]
pub(super) struct Field {
    pub(super) role: Option<RoleWord>,
    /// Which reading, rate, motor, or first button.
    pub(super) index: Option<u32>,
    /// First byte in the body; of a line, which number, from 0.
    pub(super) offset: Option<u32>,
    #[serde(rename = "type")]
    pub(super) kind: Option<NumberWord>,
    /// text: places after the point.
    pub(super) places: Option<u32>,
    pub(super) big_endian: Option<bool>,
    /// Reading, rate or motor = number · scale.
    pub(super) scale: Option<f64>,
    /// Bits that belong to the field.
    pub(super) mask: Option<u64>,
    /// The number is the low end of a longer count.
    pub(super) wraps: Option<bool>,
    /// constant: always this number.
    pub(super) value: Option<i64>,
    /// motor: largest number, either way. More is never sent.
    pub(super) limit: Option<f64>,
}

/// A report, or readings, and where the grip is then.
#[derive(Debug, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default, expecting = "a table, written [[check]]")]
pub(super) struct Check {
    /// Bytes of a report as the host reads it.
    pub(super) frame_hex: Option<String>,
    /// Readings.
    pub(super) readings: Option<Vec<f64>>,
    /// Grip in the native frame.
    pub(super) position_mm: Option<Numbers<3>>,
    pub(super) tolerance_mm: Option<f64>,
}

words! {
    CodecWord {
        Sim = "sim",
        WoodenhapticsHid8 = "woodenhaptics-hid8",
        HaptikfabrikenHid14 = "haptikfabriken-hid14",
        PolhemAscii64 = "polhem-ascii64",
        HaptikfabrikenBrackets = "haptikfabriken-brackets",
        HapiF32 = "hapi-f32",
        FalconNibble16 = "falcon-nibble16",
        HapkitAscii = "hapkit-ascii",
        SpaceMouse = "3dconnexion-hid",
        Spacenav = "spacenav",
        Dynamixel2 = "dynamixel2",
        Open6 = "open6",
        HaplyService = "haply-service",
        Declarative = "declarative",
        ForceDimension = "force-dimension",
        OpenHaptics = "open-haptics",
        Virtuose = "virtuose",
    }
    KinematicsWord {
        Cartesian = "cartesian",
        SerialCapstan = "serial-capstan",
        PolhemFiveLink = "polhem-five-link",
        Pantograph = "pantograph",
        FalconDelta = "falcon-delta",
        Chain = "chain",
        OneAxis = "one-axis",
        None = "none",
    }
    TransportWord { Hid = "hid", Serial = "serial", Usb = "usb", Service = "service", None = "none", Library = "library" }
    CarrierWord for Hid14Carrier { Mbed = "mbed", TeensyRawHid = "teensy-rawhid" }
    TurnWord for Turn { Clockwise = "cw", CounterClockwise = "ccw" }
    PacingWord for Pacing { PingPong = "ping-pong", Stream = "stream", Event = "event" }
    SaturationWord for Saturation { Clamp = "clamp", Zero = "zero", Undefined = "undefined" }
    HomingWord for HomingMode {
        None = "none",
        PowerOnPose = "power-on-pose",
        HostOffset = "host-offset",
        DeviceCommand = "device-command",
        DeviceProcedure = "device-procedure",
    }
    GimbalWord for Gimbal { Roll = "roll", Yaw = "yaw" }
    ServoWord for ServoModel { Xc330T288 = "XC330-T288", Xm430W210 = "XM430-W210" }
    FramingWord { Report = "report", Sync = "sync", Cobs = "cobs", Slip = "slip", Line = "line" }
    ChecksumWord for ChecksumKind {
        Sum8 = "sum8",
        Xor8 = "xor8",
        Crc8 = "crc8",
        Crc16Ccitt = "crc16-ccitt",
        Crc16Modbus = "crc16-modbus",
        Crc32 = "crc32",
    }
    RoleWord {
        Reading = "reading",
        Rate = "rate",
        Buttons = "buttons",
        Counter = "counter",
        Error = "error",
        Homed = "homed",
        Motor = "motor",
        Enabled = "enabled",
        Constant = "constant",
        Ignored = "ignored",
    }
    NumberWord {
        I8 = "i8",
        U8 = "u8",
        I16 = "i16",
        U16 = "u16",
        I32 = "i32",
        U32 = "u32",
        F32 = "f32",
        F64 = "f64",
        Text = "text",
    }
}
