//! The channels of a recording, and what a message of each holds: `docs/reference/recordings.md`
//! has the same as a table.
//!
//! Everything that enters and leaves a tick is in one of them, so that a recording can be run again
//! and compared bit for bit.

use prost::Message;

use super::foxglove::POSE_IN_FRAME;
use super::wire::{
    CommandWrench, ContactWrench, DeviceSample, LoopTiming, ObjectPose, PoseInFrame,
    RenderedWrench, WireError, WirePart, WireType, schema,
};
use crate::TickRecord;
use crate::stamped_record::StampedRecord;

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
    pub(super) fn has_message(self, row: &StampedRecord) -> bool {
        self != Self::ObjectPose || row.record.output.object.is_some()
    }

    /// Name and bytes of the schema.
    pub(super) fn schema(self) -> (String, Vec<u8>) {
        match self {
            Self::DeviceSample => ours::<DeviceSample>(),
            Self::ToolPose => ("foxglove.PoseInFrame".to_owned(), POSE_IN_FRAME.to_owned()),
            Self::ObjectPose => ours::<ObjectPose>(),
            Self::ContactWrench => ours::<ContactWrench>(),
            Self::CommandWrench => ours::<CommandWrench>(),
            Self::RenderedWrench => ours::<RenderedWrench>(),
            Self::LoopTiming => ours::<LoopTiming>(),
        }
    }

    /// Puts the bytes of its message of a tick in place of others.
    pub(super) fn write(self, row: &StampedRecord, bytes: &mut Vec<u8>) {
        let TickRecord { input, output, .. } = &row.record;
        bytes.clear();
        match self {
            Self::DeviceSample => DeviceSample::of(input).encode_raw(bytes),
            Self::ToolPose => PoseInFrame::of(row).encode_raw(bytes),
            Self::ObjectPose => {
                ObjectPose::of(&output.object.unwrap_or_default()).encode_raw(bytes)
            }
            Self::ContactWrench => ContactWrench::of(output).encode_raw(bytes),
            Self::CommandWrench => CommandWrench::of(output).encode_raw(bytes),
            Self::RenderedWrench => RenderedWrench::of(&row.record).encode_raw(bytes),
            Self::LoopTiming => LoopTiming::of(row).encode_raw(bytes),
        }
    }

    pub(super) fn read(self, bytes: &[u8], row: &mut StampedRecord) -> Result<(), WireError> {
        let TickRecord { input, output, .. } = &mut row.record;
        match self {
            Self::DeviceSample => DeviceSample::read(bytes, input),
            Self::ToolPose => PoseInFrame::read(bytes, row),
            Self::ObjectPose => ObjectPose::read(bytes, output.object.get_or_insert_default()),
            Self::ContactWrench => ContactWrench::read(bytes, output),
            Self::CommandWrench => CommandWrench::read(bytes, output),
            Self::RenderedWrench => RenderedWrench::read(bytes, &mut row.record),
            Self::LoopTiming => LoopTiming::read(bytes, row),
        }
    }
}

fn ours<T: WireType>() -> (String, Vec<u8>) {
    (
        T::NAME.unwrap_or_default().to_owned(),
        schema::<T>(POSE_IN_FRAME, &["foxglove/Pose.proto", "foxglove/Vector3.proto"]),
    )
}
