//! The messages of a tick as protobuf: one line per field gives its name, type and number, for
//! `prost` and for the schema, and its place in a record.
//!
//! Every field that is always there is `required`: `prost` then writes it also where it is zero.
//! Elsewhere it leaves out what compares equal to zero, and minus zero does. Numbers do not change;
//! a field is only ever added.

use glam::{DQuat, DVec3};
use prost::Message;
use prost_types::field_descriptor_proto::{Label, Type};
use prost_types::{
    DescriptorProto, EnumDescriptorProto, EnumValueDescriptorProto, FieldDescriptorProto,
    FileDescriptorProto, FileDescriptorSet,
};

use crate::TickRecord;
use crate::stamped_record::StampedRecord;
use haptics::{Drive, DriveRequest, Faults, LiveParameter, OffCause, TickInput, TickOutput};
use vps::spatial::{self, SampleStatus};

/// The package of our messages.
const PACKAGE: &str = "hapticd";

/// Why bytes are not the message that they should be.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub(super) enum WireError {
    #[error(transparent)]
    Bytes(#[from] prost::DecodeError),
    #[error("there is no {0} {1}")]
    Word(&'static str, i32),
    #[error("{0} is above 65535")]
    Wide(u32),
}

/// A message that stands for a value, or for a part of one.
pub(super) trait WirePart<V>: Message + Default {
    fn of(value: &V) -> Self;

    /// Writes the message into its part of the value.
    fn put(self, value: &mut V) -> Result<(), WireError>;

    /// Reads bytes into a value. What they lack stays as it is: they were written before that field
    /// existed.
    fn read(bytes: &[u8], value: &mut V) -> Result<(), WireError> {
        let mut message = Self::of(value);
        message.merge(bytes)?;
        message.put(value)
    }
}

/// A value as a field holds it.
trait Wire<F>: Sized {
    fn to_wire(&self) -> F;

    fn from_wire(field: F) -> Result<Self, WireError>;
}

/// A type of protobuf, as schemas describe it.
pub(super) trait WireType {
    const TYPE: Type;
    /// Of a message, with its package.
    const NAME: Option<&'static str> = None;

    /// Adds a message of ours, and those inside it before it, to a file that lacks it.
    fn describe(_: &mut FileDescriptorProto) {}
}

macro_rules! numbers {
    ($($number:ty => $type:ident),+) => {$(
        impl WireType for $number {
            const TYPE: Type = Type::$type;
        }

        impl Wire<$number> for $number {
            fn to_wire(&self) -> $number {
                *self
            }

            fn from_wire(number: $number) -> Result<Self, WireError> {
                Ok(number)
            }
        }
    )+};
}
numbers!(f64 => Double, u32 => Uint32, u64 => Uint64, i64 => Int64, bool => Bool);

impl<T: WireType> WireType for Option<T> {
    const TYPE: Type = T::TYPE;
    const NAME: Option<&'static str> = T::NAME;

    fn describe(file: &mut FileDescriptorProto) {
        T::describe(file);
    }
}

impl Wire<u32> for u16 {
    fn to_wire(&self) -> u32 {
        u32::from(*self)
    }

    fn from_wire(number: u32) -> Result<Self, WireError> {
        Self::try_from(number).map_err(|_| WireError::Wide(number))
    }
}

impl Wire<u32> for Faults {
    fn to_wire(&self) -> u32 {
        self.bits()
    }

    fn from_wire(bits: u32) -> Result<Self, WireError> {
        Ok(Self::from_bits(bits))
    }
}

impl<F, T: Wire<F>> Wire<Option<F>> for Option<T> {
    fn to_wire(&self) -> Option<F> {
        self.as_ref().map(T::to_wire)
    }

    fn from_wire(field: Option<F>) -> Result<Self, WireError> {
        field.map(T::from_wire).transpose()
    }
}

/// One of several words, which a message holds as a number.
trait Enumeration: Copy + PartialEq + 'static {
    const NAME: &'static str;
    /// In the order of their numbers.
    const ALL: &'static [Self];

    fn word(self) -> &'static str;
}

impl<T: Enumeration> Wire<i32> for T {
    fn to_wire(&self) -> i32 {
        Self::ALL.iter().position(|known| known == self).unwrap_or(0) as i32
    }

    fn from_wire(number: i32) -> Result<Self, WireError> {
        let known = usize::try_from(number).ok().and_then(|number| Self::ALL.get(number));
        known.copied().ok_or(WireError::Word(Self::NAME, number))
    }
}

/// Declares messages of a package, as a `.proto` file does, and after `=>` where each field is in
/// the value that a message stands for.
macro_rules! messages {
    (@describe $file:ident, $type:ty) => {{
        <$type>::describe($file);
        (<$type>::TYPE, <$type>::NAME.map(|name| format!(".{name}")))
    }};
    (@describe $file:ident, $type:ty, $words:ty) => {{
        describe_enumeration::<$words>($file);
        (Type::Enum, Some(format!(".{PACKAGE}.{}", <$words>::NAME)))
    }};
    ($package:literal $($message:ident for $value:ty {
        $($label:ident $kind:ident $field:ident: $type:ty = $number:literal $(of $words:ty)? => $($place:ident).+,)+
    })+) => {$(
        #[derive(Clone, PartialEq, prost::Message)]
        pub(super) struct $message {
            $(#[prost($kind, $label, tag = $number)] $field: $type,)+
        }

        impl WirePart<$value> for $message {
            fn of(value: &$value) -> Self {
                Self { $($field: value.$($place).+.to_wire(),)+ }
            }

            fn put(self, value: &mut $value) -> Result<(), WireError> {
                $(value.$($place).+ = Wire::from_wire(self.$field)?;)+
                Ok(())
            }
        }

        impl Wire<$message> for $value {
            fn to_wire(&self) -> $message {
                $message::of(self)
            }

            fn from_wire(message: $message) -> Result<Self, WireError> {
                let mut value = Self::default();
                message.put(&mut value)?;
                Ok(value)
            }
        }

        impl WireType for $message {
            const TYPE: Type = Type::Message;
            const NAME: Option<&'static str> = Some(concat!($package, ".", stringify!($message)));

            fn describe(file: &mut FileDescriptorProto) {
                let is_known = file.message_type.iter().any(|known| known.name() == stringify!($message));
                if $package != PACKAGE || is_known {
                    return;
                }
                let fields = [$((stringify!($field), $number, messages!(@describe file, $type $(, $words)?)),)+];
                let field = fields.map(|(name, number, (field_type, type_name))| FieldDescriptorProto {
                    name: Some(name.to_owned()),
                    number: Some(number),
                    // Every field may be missing, as far as the schema says.
                    label: Some(Label::Optional.into()),
                    r#type: Some(field_type.into()),
                    type_name,
                    ..FieldDescriptorProto::default()
                });
                let name = Some(stringify!($message).to_owned());
                file.message_type.push(DescriptorProto { name, field: field.into(), ..DescriptorProto::default() });
            }
        }
    )+};
}

messages! { "foxglove"
    Vector3 for DVec3 {
        required double x: f64 = 1 => x,
        required double y: f64 = 2 => y,
        required double z: f64 = 3 => z,
    }
    Quaternion for DQuat {
        required double x: f64 = 1 => x,
        required double y: f64 = 2 => y,
        required double z: f64 = 3 => z,
        required double w: f64 = 4 => w,
    }
    Pose for spatial::Pose {
        required message position: Vector3 = 1 => translation,
        required message orientation: Quaternion = 2 => rotation,
    }
}

messages! { "hapticd"
    DeviceSample for TickInput {
        required message pose: Pose = 1 => sample.pose,
        required message linear_velocity: Vector3 = 2 => sample.twist.linear,
        required message angular_velocity: Vector3 = 3 => sample.twist.angular,
        required double grip_rad: f64 = 4 => sample.grip_rad,
        required uint32 buttons: u32 = 5 => sample.buttons,
        required uint64 sequence: u64 = 6 => sample.sequence,
        required int32 status: i32 = 7 of SampleStatus => sample.status,
        required uint32 delay_ticks: u32 = 8 => sample.delay_ticks,
        required bool homed: bool = 9 => sample.homed,
        required uint32 corrupt_packets: u32 = 10 => sample.corrupt_packets,
        required uint32 lost_packets: u32 = 11 => sample.lost_packets,
        required uint32 device_error: u32 = 12 => sample.device_error,
        required bool overheated: bool = 13 => sample.overheated,
        required int32 request: i32 = 14 of DriveRequest => request,
        required bool overrun: bool = 15 => overrun,
        optional message place: Option<Placement> = 16 => place,
        optional message tune: Option<Tune> = 17 => parameter_change,
        optional message clay: Option<FrameInUse> = 18 => clay,
        required bool stalled: bool = 19 => stalled,
    }
    Placement for haptics::Placement {
        required uint32 object_idx: u32 = 1 => obstacle_idx,
        required message world_from_object: Pose = 2 => world_from_map,
    }
    ObjectPose for haptics::Placement {
        required uint32 object_idx: u32 = 1 => obstacle_idx,
        required message world_from_object: Pose = 2 => world_from_map,
    }
    Tune for haptics::ParameterChange {
        required int32 parameter: i32 = 1 of LiveParameter => parameter,
        required double value: f64 = 2 => value,
    }
    FrameInUse for haptics::FrameInUse {
        required uint64 sequence: u64 = 1 => sequence,
        required bool is_last: bool = 2 => is_last,
    }
    ContactWrench for TickOutput {
        required message force: Vector3 = 1 => contact_world.force,
        required message torque: Vector3 = 2 => contact_world.torque,
        required uint32 contacts: u32 = 3 => contacts,
        required double max_depth_m: f64 = 4 => max_depth_m,
        required double clearance_m: f64 = 5 => clearance_m,
        required uint32 points_left_out: u32 = 6 => points_left_out,
        required uint32 objects_moving: u32 = 7 => objects_moving,
        required bool depth_is_bound: bool = 8 => depth_is_bound,
    }
    CommandWrench for TickOutput {
        required message force: Vector3 = 1 => command_device.force,
        required message torque: Vector3 = 2 => command_device.torque,
        required message wanted_force: Vector3 = 3 => commanded_device.force,
        required message wanted_torque: Vector3 = 4 => commanded_device.torque,
        required int32 drive: i32 = 5 of Drive => drive,
        required uint32 faults: u32 = 6 => faults,
        required int32 off_cause: i32 = 7 of OffCause => off_cause,
        required double energy_j: f64 = 8 => energy_j,
        required double object_work_j: f64 = 9 => object_work_j,
        required bool passivity_active: bool = 10 => passivity_active,
        required uint32 delay_ticks: u32 = 11 => delay_ticks,
    }
    RenderedWrench for TickRecord {
        required message force: Vector3 = 1 => rendered_device.force,
        required message torque: Vector3 = 2 => rendered_device.torque,
        required message beside_force: Vector3 = 3 => beside_device.force,
        required message beside_torque: Vector3 = 4 => beside_device.torque,
    }
    LoopTiming for StampedRecord {
        required uint64 tick: u64 = 1 => record.tick,
        required uint32 scene_idx: u32 = 2 => record.scene_idx,
        required int64 time_ns: i64 = 3 => record.time_ns,
        required uint64 wakeup_ns: u64 = 4 => record.wakeup_ns,
        required uint64 compute_ns: u64 = 5 => record.compute_ns,
        required uint64 device_ns: u64 = 6 => record.device_ns,
        optional uint32 contact_budget_points: Option<u32> = 7 => record.contact_budget_points,
        required uint64 dropped_records: u64 = 8 => dropped,
    }
}

/// `google.protobuf.Timestamp`.
#[derive(Clone, PartialEq, prost::Message)]
pub(super) struct Timestamp {
    #[prost(int64, required, tag = 1)]
    seconds: i64,
    #[prost(uint32, required, tag = 2)]
    nanos: u32,
}

impl Timestamp {
    /// Of ns since 1970.
    pub(super) fn of(ns: u64) -> Self {
        const SECOND_NS: u64 = 1_000_000_000;
        Self { seconds: (ns / SECOND_NS) as i64, nanos: (ns % SECOND_NS) as u32 }
    }
}

/// `foxglove.PoseInFrame`, of the tool.
#[derive(Clone, PartialEq, prost::Message)]
pub(super) struct PoseInFrame {
    #[prost(message, required, tag = 1)]
    timestamp: Timestamp,
    #[prost(string, required, tag = 2)]
    frame_id: String,
    #[prost(message, required, tag = 3)]
    pose: Pose,
}

impl WirePart<StampedRecord> for PoseInFrame {
    fn of(row: &StampedRecord) -> Self {
        Self {
            timestamp: Timestamp::of(row.stamp_ns),
            frame_id: "world".to_owned(),
            pose: row.record.output.world_from_tool.to_wire(),
        }
    }

    fn put(self, row: &mut StampedRecord) -> Result<(), WireError> {
        row.record.output.world_from_tool = Wire::from_wire(self.pose)?;
        Ok(())
    }
}

fn describe_enumeration<T: Enumeration>(file: &mut FileDescriptorProto) {
    if file.enum_type.iter().any(|known| known.name() == T::NAME) {
        return;
    }
    let value = |(number, word): (i32, &T)| EnumValueDescriptorProto {
        // Words of enumerations share one space in a package.
        name: Some(format!("{}_{}", T::NAME, word.word()).to_uppercase().replace('-', "_")),
        number: Some(number),
        ..EnumValueDescriptorProto::default()
    };
    let value = (0..).zip(T::ALL).map(value).collect();
    file.enum_type.push(EnumDescriptorProto {
        name: Some(T::NAME.to_owned()),
        value,
        ..EnumDescriptorProto::default()
    });
}

/// The serialized `FileDescriptorSet` of a message of ours: `known` holds the files of the foreign
/// types that it may name, `imports` their names.
pub(super) fn schema<T: WireType>(known: &[u8], imports: &[&str]) -> Vec<u8> {
    let mut file = FileDescriptorProto {
        name: T::NAME.map(|name| format!("{}.proto", name.replace('.', "/"))),
        package: Some(PACKAGE.to_owned()),
        dependency: imports.iter().map(|import| (*import).to_owned()).collect(),
        syntax: Some("proto3".to_owned()),
        ..FileDescriptorProto::default()
    };
    T::describe(&mut file);
    // Sets in a row are one set.
    [known, &FileDescriptorSet { file: vec![file] }.encode_to_vec()].concat()
}

macro_rules! enumerations {
    ($($type:ident $name:literal { $($word:ident $said:literal),+ })+) => {$(
        impl Enumeration for $type {
            const NAME: &'static str = $name;
            const ALL: &'static [Self] = &[$(Self::$word),+];

            fn word(self) -> &'static str {
                match self {
                    $(Self::$word => $said,)+
                }
            }
        }
    )+};
    ($($type:ident $name:literal),+) => {$(
        impl Enumeration for $type {
            const NAME: &'static str = $name;
            const ALL: &'static [Self] = &Self::ALL;

            fn word(self) -> &'static str {
                self.name()
            }
        }
    )+};
}
enumerations! {
    SampleStatus "SampleStatus" { Fresh "fresh", Stale "stale", Lost "lost", LinkLost "link-lost" }
    DriveRequest "DriveRequest" { Disable "disable", Enable "enable", Stop "stop" }
    Drive "Drive" {
        Disabled "disabled", Enabling "enabling", Enabled "enabled", Stopping "stopping", Fault "fault", Braking "braking"
    }
}
enumerations!(OffCause "OffCause", LiveParameter "Parameter");
