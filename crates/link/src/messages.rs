//! The messages that hapticd sends: fields in their order, type names, hashes.
//!
//! A hash is that of the type's definition (REP-2016, `RIHS01`).
//! `tests/fixtures/cdr/type_hashes.json` has them as another program computes them from the
//! definitions; docs/reference/ros2.md names where they are published.

use std::time::{SystemTime, UNIX_EPOCH};

use glam::{DQuat, DVec3};

use super::cdr::{CdrReader, CdrWriter};
use vps::spatial::{Pose, Twist, Wrench};

/// A type as ROS 2 knows it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MessageType {
    /// Package, such as `geometry_msgs`.
    pub package: &'static str,
    /// Name, such as `PoseStamped`.
    pub name: &'static str,
    /// Hash of its definition, with `RIHS01_` in front.
    pub hash: &'static str,
}

impl MessageType {
    /// The name that it has on a DDS wire, and in `rmw_zenoh`:
    /// `geometry_msgs::msg::dds_::PoseStamped_`.
    pub fn dds_name(&self) -> String {
        format!("{}::msg::dds_::{}_", self.package, self.name)
    }

    /// The name that people write: `geometry_msgs/msg/PoseStamped`.
    pub fn ros_name(&self) -> String {
        format!("{}/msg/{}", self.package, self.name)
    }
}

/// A message that can be sent.
pub trait Message {
    /// What it is.
    const TYPE: MessageType;

    /// Its bytes as CDR.
    fn to_cdr(&self) -> Vec<u8>;
}

macro_rules! message {
    ($message:ident in $package:literal, hash $hash:literal) => {
        impl Message for $message<'_> {
            const TYPE: MessageType = MessageType {
                package: $package,
                name: stringify!($message),
                hash: concat!("RIHS01_", $hash),
            };

            fn to_cdr(&self) -> Vec<u8> {
                let mut cdr = CdrWriter::new();
                self.write(&mut cdr);
                cdr.finish()
            }
        }
    };
}

/// `builtin_interfaces/Time`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Time {
    /// Seconds since 1970.
    pub sec: i32,
    /// Nanoseconds of the second.
    pub nanosec: u32,
}

impl From<SystemTime> for Time {
    /// A clock before 1970 counts as 1970, one after the year 2038 as the last second that there
    /// is.
    fn from(time: SystemTime) -> Self {
        let since = time.duration_since(UNIX_EPOCH).unwrap_or_default();
        Self { sec: since.as_secs().try_into().unwrap_or(i32::MAX), nanosec: since.subsec_nanos() }
    }
}

/// `std_msgs/Header`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Header<'a> {
    /// When the message left.
    pub stamp: Time,
    /// The frame of what follows.
    pub frame_id: &'a str,
}

impl Header<'_> {
    fn write(&self, cdr: &mut CdrWriter) {
        cdr.i32(self.stamp.sec);
        cdr.u32(self.stamp.nanosec);
        cdr.string(self.frame_id);
    }
}

impl<'a> Header<'a> {
    fn read(cdr: &mut CdrReader<'a>) -> Option<Self> {
        Some(Self { stamp: Time { sec: cdr.i32()?, nanosec: cdr.u32()? }, frame_id: cdr.string()? })
    }
}

/// `geometry_msgs/PoseStamped`.
#[derive(Clone, Copy, Debug)]
pub struct PoseStamped<'a> {
    /// When, and in which frame.
    pub header: Header<'a>,
    /// m, unit quaternion.
    pub pose: Pose,
}

message!(PoseStamped in "geometry_msgs", hash "10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8");

impl PoseStamped<'_> {
    fn write(&self, cdr: &mut CdrWriter) {
        self.header.write(cdr);
        let Pose { rotation, translation } = self.pose;
        translation
            .to_array()
            .into_iter()
            .chain(rotation.to_array())
            .for_each(|number| cdr.f64(number));
    }
}

impl<'a> PoseStamped<'a> {
    /// Reads one; the quaternion as it was written, not normalised. `None`: the bytes are no such
    /// message.
    pub fn from_cdr(message: &'a [u8]) -> Option<Self> {
        let mut cdr = CdrReader::new(message)?;
        let header = Header::read(&mut cdr)?;
        let translation = DVec3::new(cdr.f64()?, cdr.f64()?, cdr.f64()?);
        let rotation = DQuat::from_xyzw(cdr.f64()?, cdr.f64()?, cdr.f64()?, cdr.f64()?);
        Some(Self { header, pose: Pose { rotation, translation } })
    }
}

/// `geometry_msgs/TwistStamped`.
#[derive(Clone, Copy, Debug)]
pub struct TwistStamped<'a> {
    /// When, and in which frame.
    pub header: Header<'a>,
    /// m/s, rad/s.
    pub twist: Twist,
}

message!(TwistStamped in "geometry_msgs", hash "5f0fcd4f81d5d06ad9b4c4c63e3ea51b82d6ae4d0558f1d475229b1121db6f64");

impl TwistStamped<'_> {
    fn write(&self, cdr: &mut CdrWriter) {
        self.header.write(cdr);
        let Twist { linear, angular } = self.twist;
        linear.to_array().into_iter().chain(angular.to_array()).for_each(|number| cdr.f64(number));
    }
}

/// `geometry_msgs/WrenchStamped`.
#[derive(Clone, Copy, Debug)]
pub struct WrenchStamped<'a> {
    /// When, and in which frame.
    pub header: Header<'a>,
    /// N, N·m.
    pub wrench: Wrench,
}

message!(WrenchStamped in "geometry_msgs", hash "8dc3deaf06b2ab281f9f9a742a8961c328ca7cec16e3fd6586d3a5c83fa78f77");

impl WrenchStamped<'_> {
    fn write(&self, cdr: &mut CdrWriter) {
        self.header.write(cdr);
        let Wrench { force, torque } = self.wrench;
        force.to_array().into_iter().chain(torque.to_array()).for_each(|number| cdr.f64(number));
    }
}

/// `sensor_msgs/JointState`.
#[derive(Clone, Copy, Debug)]
pub struct JointState<'a> {
    /// When.
    pub header: Header<'a>,
    /// Of the joints.
    pub name: &'a [&'a str],
    /// rad or m; as many as names, or none.
    pub position: &'a [f64],
    /// rad/s or m/s; as many as names, or none.
    pub velocity: &'a [f64],
    /// N·m or N; as many as names, or none.
    pub effort: &'a [f64],
}

message!(JointState in "sensor_msgs", hash "a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e");

impl JointState<'_> {
    fn write(&self, cdr: &mut CdrWriter) {
        self.header.write(cdr);
        cdr.sequence(self.name, |cdr, name| cdr.string(name));
        for numbers in [self.position, self.velocity, self.effort] {
            cdr.sequence(numbers, |cdr, number| cdr.f64(*number));
        }
    }
}

/// `sensor_msgs/Joy`.
#[derive(Clone, Copy, Debug)]
pub struct Joy<'a> {
    /// When.
    pub header: Header<'a>,
    /// −1 to 1.
    pub axes: &'a [f32],
    /// 0 or 1.
    pub buttons: &'a [i32],
}

message!(Joy in "sensor_msgs", hash "0d356c79cad3401e35ffeb75a96a96e08be3ef896b8b83841d73e890989372c5");

impl Joy<'_> {
    fn write(&self, cdr: &mut CdrWriter) {
        self.header.write(cdr);
        cdr.sequence(self.axes, |cdr, axis| cdr.f32(*axis));
        cdr.sequence(self.buttons, |cdr, button| cdr.i32(*button));
    }
}

/// How bad it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum DiagnosticLevel {
    /// Nothing is wrong.
    Ok = 0,
    /// The user should know.
    Warn = 1,
    /// It does not work.
    Error = 2,
}

/// `diagnostic_msgs/DiagnosticStatus`.
#[derive(Clone, Debug)]
pub struct DiagnosticStatus<'a> {
    /// How bad it is.
    pub level: DiagnosticLevel,
    /// What is judged.
    pub name: &'a str,
    /// In words.
    pub message: String,
    /// Of which piece of hardware.
    pub hardware_id: &'a str,
    /// Keys and values.
    pub values: Vec<(&'a str, String)>,
}

/// `diagnostic_msgs/DiagnosticArray`.
#[derive(Clone, Debug)]
pub struct DiagnosticArray<'a> {
    /// When.
    pub header: Header<'a>,
    /// What is judged.
    pub status: Vec<DiagnosticStatus<'a>>,
}

message!(DiagnosticArray in "diagnostic_msgs", hash "5a8a36efb05fb25070fa0fb3810290c0e6cd4862b54a8fb975a1ee8dc55a333e");

impl DiagnosticArray<'_> {
    fn write(&self, cdr: &mut CdrWriter) {
        self.header.write(cdr);
        cdr.sequence(&self.status, |cdr, status| {
            cdr.u8(status.level as u8);
            [status.name, &status.message, status.hardware_id]
                .into_iter()
                .for_each(|text| cdr.string(text));
            cdr.sequence(&status.values, |cdr, (key, value)| {
                cdr.string(key);
                cdr.string(value);
            });
        });
    }
}

/// `crtk_msgs/OperatingState`.
#[derive(Clone, Copy, Debug)]
pub struct OperatingState<'a> {
    /// When.
    pub header: Header<'a>,
    /// `DISABLED`, `ENABLED`, `PAUSED` or `FAULT`.
    pub state: &'a str,
    /// The arm knows where its zero is.
    pub is_homed: bool,
    /// On its way to another state.
    pub is_busy: bool,
}

message!(OperatingState in "crtk_msgs", hash "5cc57eea589b217fe5194bf2735b91d4a7f2dd5ac1245ae657f7ea7590c2c80e");

impl OperatingState<'_> {
    fn write(&self, cdr: &mut CdrWriter) {
        self.header.write(cdr);
        cdr.string(self.state);
        cdr.bool(self.is_homed);
        cdr.bool(self.is_busy);
    }
}

#[cfg(test)]
mod tests;
