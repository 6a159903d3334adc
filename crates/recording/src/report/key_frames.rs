//! The moments of a run that a reader asks for first, and the path of the tool.

use std::collections::BTreeMap;

use glam::DVec3;

use crate::TickRecord;
use vps::spatial::Pose;

/// Poses of a path at most. Where there are more every second one goes.
const MOST_POSES: usize = 2000;
/// The tool has moved when its origin is this far from where it was counted last, m: noise of a
/// sample at rest is no movement.
const STEP_M: f64 = 1e-5;

/// Poses nearer than this look the same, m and rad.
const LIKE_M: f64 = 1e-4;
const LIKE_RAD: f64 = 1e-2;

/// The largest value of something.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Peak {
    /// SI.
    pub(super) value: f64,
    pub(super) time_s: f64,
    /// Origin of the tool's frame, m.
    pub(super) place_world: DVec3,
}

impl Peak {
    fn take(&mut self, value: f64, record: &TickRecord) -> bool {
        // What is not a number is not larger.
        let is_larger = value > self.value;
        if is_larger {
            let place_world = record.output.world_from_tool.translation;
            *self = Self { value, time_s: record.time_ns as f64 * 1e-9, place_world };
        }
        is_larger
    }
}

/// Where everything stood at one moment.
#[derive(Clone, Debug)]
pub struct KeyFrame {
    /// Number of the scene.
    pub scene_idx: u32,
    /// Loop time, s.
    pub time_s: f64,
    /// The tool.
    pub world_from_tool: Pose,
    /// Static objects that had moved from where their scene puts them, by their numbers:
    /// `world_from_object`.
    pub moved: BTreeMap<u32, Pose>,
    /// How deep the tool was, m; 0: it touched nothing.
    pub depth_m: f64,
    /// It was so deep at least: the field of an object ends there.
    pub depth_is_bound: bool,
}

/// A pose on the path of the tool.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathPose {
    /// The tool.
    pub world_from_tool: Pose,
    /// It touched something there, or between the pose before and there.
    pub touches: bool,
}

/// What stands out of a run.
#[derive(Debug, Default)]
pub(super) struct KeyFrames {
    pub(super) depth: Peak,
    pub(super) contact_force: Peak,
    pub(super) command_force: Peak,
    pub(super) contact_torque: Peak,
    pub(super) command_torque: Peak,
    /// s.
    pub(super) first_contact_s: Option<f64>,
    /// Ticks that began after their deadline.
    pub(super) late_ticks: u64,
    /// The deepest moment, else the last.
    pub(super) shown: Option<KeyFrame>,
    /// How far the tool's origin went, m.
    pub(super) arc_m: f64,
    moved: BTreeMap<u32, Pose>,
    /// The last tick whose pose is one.
    last: Option<KeyFrame>,
    scene_idx: u32,
    anchor: Option<DVec3>,
    paths: BTreeMap<u32, Path>,
}

impl KeyFrames {
    pub(super) fn add(&mut self, record: &TickRecord) {
        let output = &record.output;
        let time_s = record.time_ns as f64 * 1e-9;
        if record.scene_idx != self.scene_idx {
            (self.scene_idx, self.anchor) = (record.scene_idx, None);
            self.moved.clear();
        }
        if let Some(object) = output.object {
            self.moved.insert(object.obstacle_idx, object.world_from_map);
        }
        let touches = output.contacts > 0;
        if touches {
            self.first_contact_s.get_or_insert(time_s);
        }
        self.late_ticks += u64::from(record.input.overrun);
        self.contact_force.take(output.contact_world.force.length(), record);
        self.command_force.take(output.command_device.force.length(), record);
        self.contact_torque.take(output.contact_world.torque.length(), record);
        self.command_torque.take(output.command_device.torque.length(), record);
        if !output.world_from_tool.is_finite() {
            return;
        }
        // What moved is copied where the moment is kept.
        let moment = KeyFrame {
            scene_idx: self.scene_idx,
            time_s,
            world_from_tool: output.world_from_tool,
            moved: BTreeMap::new(),
            depth_m: output.max_depth_m.max(0.0),
            depth_is_bound: output.depth_is_bound,
        };
        // Without contact the last moment is shown.
        if self.depth.take(output.max_depth_m, record) || self.depth.value == 0.0 {
            self.shown = Some(KeyFrame { moved: self.moved.clone(), ..moment.clone() });
        }
        self.last = Some(moment);
        let place_world = output.world_from_tool.translation;
        let step_m = self.anchor.map_or(0.0, |anchor| anchor.distance(place_world));
        if self.anchor.is_none() || step_m >= STEP_M {
            self.arc_m += step_m;
            self.anchor = Some(place_world);
        }
        self.paths
            .entry(record.scene_idx)
            .or_default()
            .add(PathPose { world_from_tool: output.world_from_tool, touches });
    }

    /// The last moment, where the tool or an object was not as in the one that is shown.
    pub(super) fn end(&self) -> Option<KeyFrame> {
        let shown = self.shown.as_ref()?;
        let last = KeyFrame { moved: self.moved.clone(), ..self.last.clone()? };
        let is_near = |a: &Pose, b: &Pose| {
            a.translation.distance(b.translation) < LIKE_M
                && a.rotation.angle_between(b.rotation) < LIKE_RAD
        };
        let are_near = last.moved.len() == shown.moved.len()
            && last.moved.values().zip(shown.moved.values()).all(|(a, b)| is_near(a, b));
        let is_shown = last.scene_idx == shown.scene_idx
            && are_near
            && is_near(&last.world_from_tool, &shown.world_from_tool);
        (!is_shown).then_some(last)
    }

    /// The path of the tool through a scene.
    pub(super) fn path(&self, scene_idx: u32) -> &[PathPose] {
        self.paths.get(&scene_idx).map_or(&[], |path| &path.poses)
    }
}

/// Poses of equal numbers of ticks.
#[derive(Debug)]
struct Path {
    poses: Vec<PathPose>,
    ticks_each: u64,
    ticks_in_last: u64,
}

impl Default for Path {
    fn default() -> Self {
        Self { poses: Vec::new(), ticks_each: 1, ticks_in_last: 1 }
    }
}

impl Path {
    fn add(&mut self, pose: PathPose) {
        match self.poses.last_mut().filter(|_| self.ticks_in_last < self.ticks_each) {
            Some(last) => {
                *last = PathPose { touches: last.touches || pose.touches, ..pose };
                self.ticks_in_last += 1;
            }
            None => {
                self.poses.push(pose);
                self.ticks_in_last = 1;
            }
        }
        if self.poses.len() > MOST_POSES {
            let is_odd = !self.poses.len().is_multiple_of(2);
            let joined = |pair: &[PathPose]| {
                let touches = pair.iter().any(|pose| pose.touches);
                pair.last().map(|last| PathPose { touches, ..*last })
            };
            self.poses = self.poses.chunks(2).filter_map(joined).collect();
            self.ticks_in_last += if is_odd { 0 } else { self.ticks_each };
            self.ticks_each *= 2;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use haptics::{Placement, TickOutput};

    fn at(tick: u64, x_m: f64, depth_m: f64) -> TickRecord {
        let output = TickOutput {
            world_from_tool: Pose::from_translation(DVec3::X * x_m),
            max_depth_m: depth_m,
            contacts: u32::from(depth_m > 0.0),
            ..TickOutput::default()
        };
        TickRecord { tick, time_ns: tick as i64 * 1_000_000, output, ..TickRecord::default() }
    }

    #[test]
    fn the_deepest_moment_is_shown_with_what_had_moved_until_then() {
        let mut moments = KeyFrames::default();
        let place = |record: TickRecord, x_m: f64| {
            let object = Some(Placement {
                obstacle_idx: 3,
                world_from_map: Pose::from_translation(DVec3::X * x_m),
            });
            TickRecord { output: TickOutput { object, ..record.output }, ..record }
        };
        for (tick, record) in [
            at(0, 0.0, 0.0),
            place(at(1, 0.01, 0.0), 5.0),
            at(2, 0.02, 1e-3),
            at(3, 0.03, 2e-3),
            place(at(4, 0.04, 1e-3), 6.0),
            at(5, 0.05, f64::NAN),
        ]
        .into_iter()
        .enumerate()
        {
            moments.add(&record);
            let shown = moments.shown.as_ref().expect("a moment");
            assert_eq!(shown.time_s, tick.min(3) as f64 * 1e-3, "tick {tick}");
        }
        let end = moments.end().expect("another pose");
        assert_eq!(
            (end.time_s, end.world_from_tool.translation.x, end.moved[&3].translation.x),
            (5e-3, 0.05, 6.0)
        );
        let shown = moments.shown.expect("a moment");
        assert_eq!((shown.depth_m, shown.world_from_tool.translation.x), (2e-3, 0.03));
        assert_eq!(shown.moved[&3].translation.x, 5.0);
        assert_eq!(moments.first_contact_s, Some(2e-3));
        assert_eq!((moments.depth.value, moments.depth.time_s), (2e-3, 3e-3));
        assert!((moments.arc_m - 0.05).abs() < 1e-12);
    }

    #[test]
    fn noise_at_rest_is_no_movement_and_a_long_path_stays_small() {
        let mut moments = KeyFrames::default();
        (0..10_000).for_each(|tick| {
            moments.add(&at(tick, if tick.is_multiple_of(2) { 0.0 } else { 8e-6 }, 0.0))
        });
        assert_eq!(moments.arc_m, 0.0);
        (10_000..20_000).for_each(|tick| {
            moments.add(&at(
                tick,
                (tick - 10_000) as f64 * 1e-5,
                if tick == 12_345 { 1e-6 } else { 0.0 },
            ))
        });
        assert!((moments.arc_m - 0.099_99).abs() < 2e-5, "{}", moments.arc_m);
        let path = moments.path(0);
        assert!((MOST_POSES / 3..=MOST_POSES).contains(&path.len()), "{}", path.len());
        assert_eq!(path.iter().filter(|pose| pose.touches).count(), 1);
        assert!(moments.path(1).is_empty());
        let shown = moments.shown.as_ref().expect("a moment").world_from_tool.translation.x;
        assert!(moments.end().is_some_and(|end| end.world_from_tool.translation.x > shown + 0.05));
        moments.add(&at(20_000, shown + 5e-5, 0.0));
        assert!(moments.end().is_none(), "as deep a pose as the one that is shown");
    }
}
