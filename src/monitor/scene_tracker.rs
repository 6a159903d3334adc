//! What the records of a run tell of its scene beside the newest one: where its objects stand, and
//! where the arm wants the tool.

use std::sync::Arc;

use super::encode::WireObject;
use super::feed::FeedRecord;
use super::hub::NewestState;
use crate::daemon::session::SceneView;
use haptics::RenderScene;
use recording::TickRecord;
use vps::spatial::Pose;

/// A scene, seen record by record.
pub(super) struct SceneTracker {
    view: SceneView,
    /// Where every static object stands.
    poses: Vec<Pose>,
}

impl SceneTracker {
    /// Everything stands where it starts.
    pub(super) fn new(view: SceneView) -> Self {
        let poses = starts(&view);
        Self { view, poses }
    }

    /// The scene and its parameters.
    pub(super) fn view(&self) -> &SceneView {
        &self.view
    }

    /// Where every static object stands, in their order.
    pub(super) fn poses(&self) -> &[Pose] {
        &self.poses
    }

    /// Follows what has changed in the session; gives what it showed before, and whether another
    /// scene is rendered now.
    pub(super) fn look_at(&mut self, view: SceneView) -> (SceneView, bool) {
        let before = core::mem::replace(&mut self.view, view);
        let is_first = before.scene.is_none() && self.view.scene.is_some();
        let is_another = is_first || before.scene_idx != self.view.scene_idx;
        if is_another {
            self.poses = starts(&self.view);
        }
        (before, is_another)
    }

    /// Every record, in turn.
    pub(super) fn see(&mut self, record: &TickRecord) {
        if let Some(placed) =
            record.output.object.filter(|_| record.scene_idx == self.view.scene_idx)
            && let Some(pose) = self.poses.get_mut(placed.obstacle_idx as usize)
        {
            *pose = placed.world_from_map;
        }
    }

    /// The scene, if the record is of it.
    pub(super) fn scene_of(&self, record: &TickRecord) -> Option<&Arc<RenderScene>> {
        self.view.scene.as_ref().filter(|_| record.scene_idx == self.view.scene_idx)
    }

    /// A record with everything that is known beside it.
    pub(super) fn newest(&self, fed: FeedRecord) -> NewestState {
        let mapping = &self.view.config.parameters.mapping;
        let wanted = match (self.scene_of(&fed.record), fed.index_origin) {
            (Some(scene), Some(index_origin)) => Some(index_origin.wanted(
                &fed.record.input.sample,
                mapping,
                scene.tool.center_of_mass_tool,
            )),
            _ => None,
        };
        let movable = self
            .view
            .config
            .statics
            .iter()
            .zip(&self.poses)
            .enumerate()
            .filter(|(_, (object, _))| object.movable);
        let objects = movable
            .map(|(idx, (_, pose))| WireObject { idx: idx as u32, pose: (*pose).into() })
            .collect();
        NewestState { fed, wanted, objects }
    }
}

fn starts(view: &SceneView) -> Vec<Pose> {
    view.config.statics.iter().map(|object| object.pose).collect()
}
