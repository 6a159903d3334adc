//! Where the arm itself wants the tool: its device pose, seen in the world.
//!
//! The loop does not tell the zero of its indexing; all records together tell it: the pose of the
//! arm in the tick that enabled.

use glam::DVec3;

use haptics::{DeviceMapping, Drive, Indexing};
use recording::TickRecord;
use vps::spatial::{DeviceSample, Pose};

/// Where arm and tool stood when force was enabled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct IndexOrigin {
    indexing: Indexing,
    /// `world_from_tool`.
    start: Pose,
}

/// Watches for it.
#[derive(Debug, Default)]
pub(super) struct IndexOriginTracker {
    before: Drive,
    index_origin: Option<IndexOrigin>,
}

impl IndexOriginTracker {
    /// The index_origin of a record; `None` while no force may flow.
    pub(super) fn see(&mut self, record: &TickRecord) -> Option<IndexOrigin> {
        let drive = record.output.drive;
        if drive == Drive::Enabling && self.before != Drive::Enabling {
            self.index_origin = Some(IndexOrigin {
                indexing: Indexing::indexed(&record.input.sample),
                start: record.output.world_from_tool,
            });
        } else if !drive.has_force() {
            self.index_origin = None;
        }
        self.before = drive;
        self.index_origin
    }
}

impl IndexOrigin {
    /// `world_from_tool` as the arm wants it.
    pub(super) fn wanted(
        &self,
        sample: &DeviceSample,
        mapping: &DeviceMapping,
        center_of_mass_tool: DVec3,
    ) -> Pose {
        let start = self.start * Pose::from_translation(center_of_mass_tool);
        let (world_from_body, _) = self.indexing.target(sample, mapping, start);
        world_from_body * Pose::from_translation(-center_of_mass_tool)
    }
}
