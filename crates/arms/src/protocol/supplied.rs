//! What a profile supplies to its protocol: carriers, boards, servos, limits. Plain data, in the
//! units of the wire.

use vps::spatial::Axes;

/// How the 14 bytes of [`Protocol::HaptikfabrikenHid14`](super::Protocol::HaptikfabrikenHid14)
/// travel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Hid14Carrier {
    /// mbed board: reports of 14 bytes.
    Mbed,
    /// Teensy RawHID: reports of 64 bytes, the rest zero.
    TeensyRawHid,
}

impl Hid14Carrier {
    /// Bytes of a report, its ID apart.
    pub(crate) const fn report_len(self) -> usize {
        match self {
            Self::Mbed => 14,
            Self::TeensyRawHid => 64,
        }
    }
}

/// Which way counts or turns, seen by a hAPI board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Turn {
    /// 0 on the wire.
    Clockwise,
    /// 1 on the wire.
    CounterClockwise,
}

/// An encoder port of a hAPI board.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HapiEncoder {
    /// Which way it counts.
    pub direction: Turn,
    /// Angle at the moment of setup, degrees.
    pub start_deg: f32,
    /// Counts per turn.
    pub counts_per_rev: f32,
}

/// A hAPI board: ports are contiguous from 1, and everything is in **port order**, whichever arm is
/// wired to a port.
#[derive(Clone, Debug, PartialEq)]
pub struct HapiBoard {
    /// Device id that the host chooses; 5 by convention.
    pub device_id: u8,
    /// Motor at port 1, 2, …: at most 4.
    pub motors: Vec<Turn>,
    /// Encoder at port 1, 2, …: at most 4.
    pub encoders: Vec<HapiEncoder>,
}

/// Models of servos whose table this program knows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ServoModel {
    /// XC330-T288.
    Xc330T288,
    /// XM430-W210.
    Xm430W210,
}

impl ServoModel {
    /// Every known model.
    pub(crate) const ALL: [Self; 2] = [Self::Xc330T288, Self::Xm430W210];

    /// Name as sold.
    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Xc330T288 => "XC330-T288",
            Self::Xm430W210 => "XM430-W210",
        }
    }

    /// What it answers to a ping.
    pub(crate) const fn number(self) -> u16 {
        match self {
            Self::Xc330T288 => 1220,
            Self::Xm430W210 => 1030,
        }
    }

    /// Largest goal current of the control table, counts.
    pub(crate) const fn limit_counts(self) -> i16 {
        match self {
            Self::Xc330T288 => 910,
            Self::Xm430W210 => 1193,
        }
    }

    /// Published counts per N·m; a constant, not a calibration.
    pub(crate) const fn counts_per_nm(self) -> f64 {
        match self {
            Self::Xc330T288 => 1158.73,
            Self::Xm430W210 => 371.7,
        }
    }
}

/// A servo on the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Servo {
    /// Its id, 0 to 252.
    pub id: u8,
    /// Its model; another one on that id is refused at the start.
    pub model: ServoModel,
}

/// An arm that speaks `open6`: what the profile expects of it, and what a simulated one says of
/// itself.
#[derive(Clone, Debug, PartialEq)]
pub struct Open6Arm {
    /// Name, at most [`Open6Arm::NAME_MAX`] bytes on the wire.
    pub name: String,
    /// Axes that it measures; an arm that measures less is refused.
    pub sensed: Axes,
    /// Axes with a motor; an arm with less is refused.
    pub actuated: Axes,
    /// Exchanges per second that it takes.
    pub rate_hz: u16,
    /// Its watchdog, ms: asked for at the start; an arm that grants a longer one is refused.
    pub watchdog_ms: u16,
    /// Largest force that it makes, N.
    pub force_n: f32,
    /// Largest torque, N·m.
    pub torque_nm: f32,
    /// Radius of its workspace, m.
    pub workspace_radius_m: f32,
}

impl Open6Arm {
    /// Bytes of a name.
    pub const NAME_MAX: usize = 32;
}

/// What is wrong with the data of a protocol: a lower-case fragment that names the value and what
/// is accepted.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct ProtocolError(pub String);
