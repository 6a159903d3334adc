//! The channels of a recording, and what a message of each holds: `docs/reference/recordings.md` has the same as a table.
//!
//! Everything that enters and leaves a tick is in one of them, so that a recording can be run again and compared bit for bit.

use foxglove::Encode as _;

use super::fields::{Fields, Garbled, Kind, Reader, Writer};
use super::schema;
use crate::TickRecord;
use haptics::{
    Drive, DriveRequest, Faults, FrameInUse, LiveParameter, OffCause, ParameterChange, Placement, TickInput, TickOutput,
};
use vps::spatial::{DeviceSample, SampleStatus};

/// One tick as it is recorded.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Row {
    pub(super) record: TickRecord,
    /// Records that the recorder had dropped when it took this one.
    pub(super) dropped: u64,
    /// Time of the messages: ns since 1970, or of the loop under the virtual clock.
    pub(super) stamp_ns: u64,
}

/// A topic with one message per tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Channel {
    DeviceSample,
    ToolPose,
    ObjectPose,
    ContactWrench,
    CommandWrench,
    RenderedWrench,
    /// The last one of its tick: with it the tick is whole.
    LoopTiming,
}

impl Channel {
    /// In the order in which they are written.
    pub(super) const ALL: [Self; 7] = [
        Self::DeviceSample,
        Self::ToolPose,
        Self::ObjectPose,
        Self::ContactWrench,
        Self::CommandWrench,
        Self::RenderedWrench,
        Self::LoopTiming,
    ];

    pub(super) const fn topic(self) -> &'static str {
        match self {
            Self::DeviceSample => "/device/sample",
            Self::ToolPose => "/tool/pose",
            Self::ObjectPose => "/object/pose",
            Self::ContactWrench => "/wrench/contact",
            Self::CommandWrench => "/wrench/command",
            Self::RenderedWrench => "/wrench/rendered",
            Self::LoopTiming => "/loop/timing",
        }
    }

    pub(super) fn of_topic(topic: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|channel| channel.topic() == topic)
    }

    /// Most ticks move no object.
    pub(super) fn has_message(self, row: &Row) -> bool {
        self != Self::ObjectPose || row.record.output.object.is_some()
    }

    /// Name and bytes of the schema.
    pub(super) fn schema(self) -> (String, Vec<u8>) {
        let foreign = foxglove::messages::PoseInFrame::get_schema().map_or_else(Vec::new, |schema| schema.data.into_owned());
        let type_name = match self {
            Self::ToolPose => return ("foxglove.PoseInFrame".to_owned(), foreign),
            Self::DeviceSample => "DeviceSample",
            Self::ObjectPose => "ObjectPose",
            Self::ContactWrench => "ContactWrench",
            Self::CommandWrench => "CommandWrench",
            Self::RenderedWrench => "RenderedWrench",
            Self::LoopTiming => "LoopTiming",
        };
        let bytes = schema::describe(type_name, &foreign, &["foxglove/Pose.proto", "foxglove/Vector3.proto"], |walk| {
            self.body(walk, &mut Row::default())
        });
        (format!("hapticd.{type_name}"), bytes)
    }

    pub(super) fn write(self, row: &Row, message: &mut Writer) {
        message.clear();
        self.body(message, &mut row.clone());
    }

    pub(super) fn read(self, bytes: &[u8], row: &mut Row) -> Result<(), Garbled> {
        let mut message = Reader::new(bytes)?;
        self.body(&mut message, row);
        message.finish()
    }

    /// What its message holds.
    pub(super) fn body<F: Fields>(self, f: &mut F, row: &mut Row) {
        match self {
            Self::DeviceSample => device_sample(f, &mut row.record.input),
            Self::ToolPose => tool_pose(f, row),
            Self::ObjectPose => object_pose(f, &mut row.record.output.object),
            Self::ContactWrench => contact_wrench(f, &mut row.record.output),
            Self::CommandWrench => command_wrench(f, &mut row.record.output),
            Self::RenderedWrench => {
                f.wrench(["force", "torque"], &mut row.record.rendered_device);
                f.wrench(["beside_force", "beside_torque"], &mut row.record.beside_device);
            }
            Self::LoopTiming => loop_timing(f, row),
        }
    }
}

const STATUSES: [(SampleStatus, &str); 4] = [
    (SampleStatus::Fresh, "FRESH"),
    (SampleStatus::Stale, "STALE"),
    (SampleStatus::Lost, "LOST"),
    (SampleStatus::LinkLost, "LINK_LOST"),
];
const REQUESTS: [(DriveRequest, &str); 4] = [
    (DriveRequest::Disable, "DISABLE"),
    (DriveRequest::Enable, "ENABLE"),
    (DriveRequest::Stop, "STOP"),
    (DriveRequest::Pause, "PAUSE"),
];
const DRIVES: [(Drive, &str); 6] = [
    (Drive::Disabled, "DISABLED"),
    (Drive::Enabling, "ENABLING"),
    (Drive::Enabled, "ENABLED"),
    (Drive::Stopping, "STOPPING"),
    (Drive::Fault, "FAULT"),
    (Drive::Braking, "BRAKING"),
];

/// Everything that enters the tick.
fn device_sample<F: Fields>(f: &mut F, input: &mut TickInput) {
    // By name: a field that is added to the input has to be recorded.
    let TickInput { sample, request, overrun, stalled, place, tune, clay } = input;
    let DeviceSample {
        pose,
        twist,
        grip_rad,
        buttons,
        sequence,
        status,
        delay_ticks,
        homed,
        corrupt_packets,
        lost_packets,
        device_error,
        overheated,
    } = sample;
    f.pose("pose", pose);
    f.twist(["linear_velocity", "angular_velocity"], twist);
    f.double("grip_rad", grip_rad);
    f.count("buttons", buttons);
    f.count("sequence", sequence);
    f.choice("status", "SampleStatus", &STATUSES, status);
    f.count("delay_ticks", delay_ticks);
    f.flag("homed", homed);
    f.count("corrupt_packets", corrupt_packets);
    f.count("lost_packets", lost_packets);
    f.count("device_error", device_error);
    f.flag("overheated", overheated);
    f.choice("request", "DriveRequest", &REQUESTS, request);
    f.flag("overrun", overrun);
    f.optional(place, |f, place| {
        f.message("place", "Placement", place, |f, place: &mut Placement| {
            f.count("object_idx", &mut place.obstacle_idx);
            f.pose("world_from_object", &mut place.world_from_map);
        });
    });
    let mut wish = tune.map(Wish::from);
    f.optional(&mut wish, |f, wish| f.message("tune", "Tune", wish, Wish::body));
    *tune = wish.map(Wish::into);
    f.optional(clay, |f, clay| {
        f.message("clay", "FrameInUse", clay, |f, clay: &mut FrameInUse| {
            f.count("sequence", &mut clay.sequence);
            f.flag("is_last", &mut clay.is_last);
        });
    });
    f.flag("stalled", stalled);
}

/// A [`ParameterChange`] that has a default.
#[derive(Clone, Copy)]
struct Wish {
    parameter: LiveParameter,
    value: f64,
}

impl Default for Wish {
    fn default() -> Self {
        Self { parameter: LiveParameter::ContactStiffness, value: 0.0 }
    }
}

impl From<ParameterChange> for Wish {
    fn from(ParameterChange { parameter, value }: ParameterChange) -> Self {
        Self { parameter, value }
    }
}

impl From<Wish> for ParameterChange {
    fn from(Wish { parameter, value }: Wish) -> Self {
        Self { parameter, value }
    }
}

impl Wish {
    fn body<F: Fields>(f: &mut F, wish: &mut Self) {
        f.choice("parameter", "Parameter", &LiveParameter::ALL.map(|parameter| (parameter, parameter.name())), &mut wish.parameter);
        f.double("value", &mut wish.value);
    }
}

/// `foxglove.PoseInFrame`.
fn tool_pose<F: Fields>(f: &mut F, row: &mut Row) {
    const SECOND_NS: u64 = 1_000_000_000;
    let mut stamp = (row.stamp_ns / SECOND_NS, row.stamp_ns % SECOND_NS);
    f.message("timestamp", ".google.protobuf.Timestamp", &mut stamp, |f, (seconds, nanos)| {
        f.whole("seconds", Kind::Signed, seconds);
        f.whole("nanos", Kind::Short, nanos);
    });
    f.text("frame_id", &mut "world".to_owned());
    f.pose("pose", &mut row.record.output.world_from_tool);
}

fn object_pose<F: Fields>(f: &mut F, object: &mut Option<Placement>) {
    let Placement { obstacle_idx, world_from_map } = object.get_or_insert_default();
    f.count("object_idx", obstacle_idx);
    f.pose("world_from_object", world_from_map);
}

/// What touches.
fn contact_wrench<F: Fields>(f: &mut F, output: &mut TickOutput) {
    f.wrench(["force", "torque"], &mut output.contact_world);
    f.count("contacts", &mut output.contacts);
    f.double("max_depth_m", &mut output.max_depth_m);
    f.double("clearance_m", &mut output.clearance_m);
    f.count("points_left_out", &mut output.points_left_out);
    f.count("objects_moving", &mut output.objects_moving);
}

/// What the tick decided.
fn command_wrench<F: Fields>(f: &mut F, output: &mut TickOutput) {
    // By name: a field that is added to the output has to be recorded.
    let TickOutput {
        command_device,
        commanded_device,
        energy_j,
        object_work_j,
        passivity_active,
        delay_ticks,
        drive,
        faults,
        off_cause,
        // In other channels.
        contact_world: _,
        world_from_tool: _,
        contacts: _,
        max_depth_m: _,
        clearance_m: _,
        points_left_out: _,
        objects_moving: _,
        object: _,
    } = output;
    f.wrench(["force", "torque"], command_device);
    f.wrench(["wanted_force", "wanted_torque"], commanded_device);
    f.choice("drive", "Drive", &DRIVES, drive);
    let mut bits = faults.bits();
    f.count("faults", &mut bits);
    *faults = Faults::from_bits(bits);
    f.choice("off_cause", "OffCause", &OffCause::ALL.map(|cause| (cause, cause.name())), off_cause);
    f.double("energy_j", energy_j);
    f.double("object_work_j", object_work_j);
    f.flag("passivity_active", passivity_active);
    f.count("delay_ticks", delay_ticks);
}

fn loop_timing<F: Fields>(f: &mut F, row: &mut Row) {
    let TickRecord { tick, scene_idx, time_ns, wakeup_ns, compute_ns, device_ns, contact_budget_points, .. } = &mut row.record;
    f.count("tick", tick);
    f.count("scene_idx", scene_idx);
    let mut bits = time_ns.cast_unsigned();
    f.whole("time_ns", Kind::Signed, &mut bits);
    *time_ns = bits.cast_signed();
    f.count("wakeup_ns", wakeup_ns);
    f.count("compute_ns", compute_ns);
    f.count("device_ns", device_ns);
    f.optional(contact_budget_points, |f, points| f.count("contact_budget_points", points));
    f.count("dropped_records", &mut row.dropped);
}
