//! Where the arm itself wants the tool: its device pose, seen in the world.
//!
//! The loop does not tell the zero of its indexing; whoever sees every record can know it: the pose of the arm in the tick that enabled.

use crate::haptics::{Drive, PortParameters};
use crate::spatial::{Axes, Pose};
use crate::telemetry::TickRecord;
use glam::{DQuat, DVec3};

/// Where arm and tool stood when force was enabled.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Anchor {
    /// `device_from_grip`.
    zero: Pose,
    /// `world_from_tool`.
    start: Pose,
}

/// Watches for it.
#[derive(Debug, Default)]
pub(super) struct Watcher {
    before: Drive,
    anchor: Option<Anchor>,
}

impl Watcher {
    /// The anchor of a record; `None` while no force may flow.
    pub(super) fn see(&mut self, record: &TickRecord) -> Option<Anchor> {
        let drive = record.output.drive;
        if drive == Drive::Enabling && self.before != Drive::Enabling {
            self.anchor = Some(Anchor { zero: record.input.sample.pose, start: record.output.world_from_tool });
        } else if !drive.has_force() {
            self.anchor = None;
        }
        self.before = drive;
        self.anchor
    }
}

impl Anchor {
    /// `world_from_tool` as the arm wants it.
    pub(super) fn wanted(&self, device_from_grip: Pose, port: &PortParameters, center_of_mass_tool: DVec3) -> Pose {
        let axes = port.world_from_device.rotation;
        let moved_device = keep(device_from_grip.translation - self.zero.translation, port.sensed, 0);
        let turn_device = device_from_grip.rotation * self.zero.rotation.conjugate();
        let turn_device = if port.sensed.contains(Axes::ROTATION) {
            turn_device
        } else {
            DQuat::from_scaled_axis(keep(turn_device.to_scaled_axis(), port.sensed, 3))
        };
        let start = self.start * Pose::from_translation(center_of_mass_tool);
        let body = Pose::new(
            (axes * turn_device * axes.conjugate() * start.rotation).normalize(),
            start.translation + axes * moved_device * port.scale,
        );
        body * Pose::from_translation(-center_of_mass_tool)
    }
}

fn keep(vector: DVec3, axes: Axes, first: usize) -> DVec3 {
    let one = |component: f64, idx: usize| if axes.has(first + idx) { component } else { 0.0 };
    DVec3::new(one(vector.x, 0), one(vector.y, 1), one(vector.z, 2))
}
