//! What an arm of metal has beside what every arm has.

use glam::{DQuat, DVec3};

use crate::Thermal;
use crate::kinematics::Kinematics;
use crate::protocol::Protocol;
use crate::transmission::Transmission;
use crate::transport::Carriage;

/// How to find, speak to and drive a real arm.
#[derive(Clone, Debug, PartialEq)]
pub struct RealArm {
    /// What its bytes mean.
    pub protocol: Protocol,
    /// Where it is plugged in.
    pub matching: Match,
    /// How its joints move the grip.
    pub(crate) kinematics: Kinematics,
    /// Readings into joints, joint torques into commands.
    pub(crate) transmission: Transmission,
    /// Turns native vectors into device vectors: a permutation of axes with signs.
    pub device_from_native: DQuat,
    /// How it finds its zero.
    pub homing: Homing,
    /// A test on such an arm has shown that every motor pushes the way its encoder counts. Without
    /// it force stays below 0.5 N.
    pub signs_verified: bool,
    /// After its watchdog tripped, the next command does not enable the motors by itself.
    pub(crate) watchdog_latched: bool,
    /// What the arm does with a command that is too large.
    pub(crate) saturates_by: Saturation,
    /// Silence after which the arm is sent a frame that wakes it, ms; `None`: it needs none.
    pub(crate) kick_ms: Option<u32>,
    /// Heat of the motors, cold; a motor without a declared continuous command has no model.
    pub(crate) thermal: Thermal,
    /// Orientation is measured. Where it is not, it stays at its start value.
    pub(crate) orientation_sensed: bool,
    /// Button that has to be held for force, bit of the button word; `None`: no such rule.
    pub deadman_button: Option<u8>,
    /// What was measured on this very arm; `None`: nothing yet.
    pub(crate) identified: Option<Identified>,
    /// Known answers.
    pub(crate) checks: Vec<Check>,
}

impl RealArm {
    /// It says how fast it is pushed, not where it is: it has no place of its own.
    pub fn is_rate_input(&self) -> bool {
        matches!(self.kinematics, Kinematics::Rate(_))
    }
}

/// How the bytes of an arm travel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TransportKind {
    /// A hidraw node.
    Hid,
    /// A tty.
    Serial,
    /// USB bulk endpoints.
    Usb,
    /// A socket of another program on this machine.
    Socket,
    /// A WebSocket of another program that serves the arm.
    Service,
    /// A library of the arm's maker.
    Library,
}

impl TransportKind {
    /// One report at a time, or a stream of bytes.
    pub const fn carriage(self) -> Carriage {
        match self {
            Self::Hid | Self::Service | Self::Library => Carriage::Reports,
            Self::Serial | Self::Usb | Self::Socket => Carriage::Stream,
        }
    }
}

/// Vendor and product of a USB device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct UsbId {
    /// Vendor number.
    pub vendor: u16,
    /// Product number.
    pub product: u16,
}

/// Which nodes of the system can be this arm. Everything given has to fit.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Match {
    /// What kind of node.
    pub transport: TransportKind,
    /// Any of these; empty: the node has to be named by `by_id` or by the user.
    pub ids: Vec<UsbId>,
    /// HID usage page of the interface.
    pub(crate) usage_page: Option<u16>,
    /// HID usage of the interface.
    pub usage: Option<u16>,
    /// USB interface number.
    pub interface: Option<u8>,
    /// Serial number.
    pub serial: Option<String>,
    /// Part of the product string; never enough by itself.
    pub product: Option<String>,
    /// Part of the stable name of a port under `/dev/serial/by-id`.
    pub by_id: Option<String>,
    /// Baud rate of a tty; a USB device ignores it.
    pub(crate) baud: u32,
}

/// How an arm finds its zero.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum HomingMode {
    /// It needs none.
    #[default]
    None,
    /// Its counters are zero where it was switched on: it has to stand in its park pose then.
    PowerOnPose,
    /// The host keeps an offset.
    HostOffset,
    /// The host sets the counters of the arm.
    DeviceCommand,
    /// The arm finds it while a person moves it, and says when.
    DeviceProcedure,
}

/// Homing of an arm.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Homing {
    /// How.
    pub mode: HomingMode,
    /// What a person has to do, in a sentence.
    pub instruction: Option<String>,
}

/// What an arm does with a command above its limit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Saturation {
    /// It takes the limit.
    Clamp,
    /// It takes zero.
    Zero,
    /// The profile does not say.
    #[default]
    Undefined,
}

/// Measured with `hapticd devices probe PROFILE --identify`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Identified {
    /// Ticks from a command to the first sample that can show its force, less the one that every
    /// arm takes.
    pub(crate) round_trip_ticks: u32,
    /// Apparent mass at the grip, kg.
    pub(crate) mass_kg: f64,
    /// Viscosity at the grip, N·s/m.
    pub(crate) damping_n_s_per_m: f64,
    /// Apparent inertia, kg·m².
    pub(crate) inertia_kg_m2: Option<f64>,
    /// Rotational viscosity, N·m·s/rad.
    pub(crate) damping_nm_s_per_rad: Option<f64>,
}

/// A report, or readings, and where the grip is then.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Check {
    /// Bytes of a report as the host reads it, if given.
    pub(crate) frame: Option<Vec<u8>>,
    /// Readings, as many as are written, if any; beside a frame, what the frame has to say.
    pub(crate) readings: Option<Vec<f64>>,
    /// Grip in the native frame, m.
    pub(crate) position_native: DVec3,
    /// How far it may be off, m.
    pub(crate) tolerance_m: f64,
}
