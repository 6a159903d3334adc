//! Objects that follow paths over the loop's time.
#![expect(clippy::disallowed_types, reason = "filled on the cold side, never resized")]

use super::ControlError;
use super::commands::checked;
use arms::simulated::hand::HandPath;
use haptics::Placement;
use vps::spatial::Pose;

/// Poses over time for movable objects of one scene.
#[derive(Debug, Default)]
pub struct ObjectPaths {
    paths: Vec<(u32, HandPath)>,
    turn: usize,
    is_over: bool,
}

impl ObjectPaths {
    /// Paths for static objects of a scene in their order: name, and whether each may move. Cold.
    ///
    /// # Errors
    /// A path of an object that is not there or does not move, or that leads to where it cannot go;
    /// two paths for one object.
    pub fn new(
        objects: &[(String, bool)],
        paths: impl IntoIterator<Item = (String, HandPath)>,
    ) -> Result<Self, ControlError> {
        let mut checked_paths: Vec<(u32, HandPath)> = Vec::new();
        for (name, path) in paths {
            let obstacle_idx = checked(objects, &name, Pose::IDENTITY)?.obstacle_idx;
            for pose in path.poses() {
                checked(objects, &name, *pose)?;
            }
            if checked_paths.iter().any(|(known, _)| *known == obstacle_idx) {
                return Err(ControlError::Twice { name });
            }
            checked_paths.push((obstacle_idx, path));
        }
        Ok(Self { paths: checked_paths, turn: 0, is_over: false })
    }

    /// Another scene is rendered, which has other objects. RT: safe.
    pub(super) fn stop(&mut self) {
        self.is_over = true;
    }

    /// Where an object is to be at a time; the paths take turns. RT: safe; O(log n) in the length
    /// of a path.
    pub(super) fn next(&mut self, time_s: f64) -> Option<Placement> {
        if self.is_over {
            return None;
        }
        self.turn = if self.turn + 1 < self.paths.len() { self.turn + 1 } else { 0 };
        let (obstacle_idx, path) = self.paths.get(self.turn)?;
        Some(Placement { obstacle_idx: *obstacle_idx, world_from_map: path.sample(time_s) })
    }
}

#[cfg(test)]
#[expect(clippy::expect_used, reason = "test code")]
mod tests {
    use super::*;

    #[test]
    fn objects_of_another_scene_do_not_follow_them() {
        let objects = [("plate".to_owned(), true)];
        let path = HandPath::fixed(Pose::IDENTITY);
        let mut paths = ObjectPaths::new(&objects, [("plate".to_owned(), path)]).expect("sound");
        let there = Placement { obstacle_idx: 0, world_from_map: Pose::IDENTITY };
        assert_eq!((paths.next(0.0), paths.next(1.0)), (Some(there), Some(there)));
        paths.stop();
        assert_eq!(paths.next(2.0), None);
    }
}
