//! Where the simulated hand wants to be, over time.
//!
//! A hand file is CSV with the header `t_s,x_m,y_m,z_m,qx,qy,qz,qw`: poses of the tool frame in the
//! world, after indexing. Between lines the position is interpolated linearly and the orientation
//! by slerp; before the first line and after the last one it is held.

use std::path::Path;

use glam::DVec3;

use super::hand_control::Reach;
use document::poses::{self, PoseFileError, TimedPose};
use vps::spatial::Pose;

/// A path of poses over time: `world_from_tool` as read from a file.
#[derive(Clone, Debug, PartialEq)]
pub struct HandPath {
    /// `[n]`, strictly increasing, s.
    times_s: Box<[f64]>,
    /// `[n]`, n ≥ 1.
    poses: Box<[Pose]>,
    /// Time runs from the first line to the last one and back, again and again.
    turns: bool,
}

impl HandPath {
    /// Reads a hand file: a pose file whose time increases.
    ///
    /// # Errors
    /// See [`PoseFileError`]; every one names the file, and the line where there is one.
    pub fn read(path: &Path) -> Result<Self, PoseFileError> {
        Self::from_poses(&poses::read(path)?, path)
    }

    /// A path through poses whose time increases; `path` is for messages.
    ///
    /// # Errors
    /// The first pose that does not come after the one before.
    pub fn from_poses(poses: &[TimedPose], path: &Path) -> Result<Self, PoseFileError> {
        poses::check_order(poses, path)?;
        Ok(Self {
            times_s: poses.iter().map(|timed| timed.time_s).collect(),
            poses: poses.iter().map(|timed| timed.pose).collect(),
            turns: false,
        })
    }

    /// A path that stays where it is.
    pub fn fixed(pose: Pose) -> Self {
        Self { times_s: Box::new([0.0]), poses: Box::new([pose]), turns: false }
    }

    /// The same path, gone to its end and back to its first line, again and again.
    #[must_use]
    pub fn there_and_back(self) -> Self {
        Self { turns: true, ..self }
    }

    /// The poses of the file.
    pub fn poses(&self) -> &[Pose] {
        &self.poses
    }

    /// The pose at `time_s`. RT: safe; O(log n).
    pub fn sample(&self, time_s: f64) -> Pose {
        let time_s = if self.turns { self.turned(time_s) } else { time_s };
        // NaN compares false everywhere: it lands on the first pose.
        let after_idx = self.times_s.partition_point(|&t| t <= time_s);
        let (Some(&before), after) =
            (self.poses.get(after_idx.saturating_sub(1)), self.poses.get(after_idx))
        else {
            return Pose::IDENTITY;
        };
        match after {
            Some(&after) if after_idx > 0 => {
                let from_s = self.times_s[after_idx - 1];
                let to_s = self.times_s[after_idx];
                let share = (time_s - from_s) / (to_s - from_s);
                Pose::new(
                    before.rotation.slerp(after.rotation, share),
                    before.translation.lerp(after.translation, share),
                )
            }
            _ => before,
        }
    }

    /// Where on the path a time lies that turns round at its end and at its first line. Before the
    /// first line it is not changed.
    fn turned(&self, time_s: f64) -> f64 {
        let (Some(first_s), Some(last_s)) = (self.times_s.first(), self.times_s.last()) else {
            return time_s;
        };
        let length_s = last_s - first_s;
        if time_s <= *last_s || length_s <= 0.0 {
            return time_s;
        }
        let since_turn_s = (time_s - last_s) % (2.0 * length_s);
        first_s + (length_s - since_turn_s).abs()
    }

    /// The same path as the arm's grip sees it.
    pub fn to_device(&self, mapping: HandMapping) -> GripPath {
        GripPath { path: self.clone(), mapping, reach: Reach::default() }
    }
}

/// How the grip follows the tool: what is needed to turn a tool pose in the world into a grip pose
/// of the arm.
///
/// At enable the tool stands at `start` and the arm at its zero pose. From there on a grip
/// translation d moves the grip point by scale · R_wd · d in the world, and a grip rotation turns
/// the tool by the same rotation seen in world axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HandMapping {
    /// Where the arm stands; only its rotation matters here.
    pub world_from_device: Pose,
    /// World metres per device metre.
    pub scale: f64,
    /// `world_from_tool` at enable.
    pub start: Pose,
    /// The grip point in the tool frame: the tool's centre of mass, m.
    pub grip_tool: DVec3,
}

impl HandMapping {
    /// The grip pose, `device_from_grip`, that holds the tool at `world_from_tool`. RT: safe.
    fn device_from_grip(&self, world_from_tool: Pose) -> Pose {
        let device_from_world = self.world_from_device.rotation.conjugate();
        let travel_world = world_from_tool.transform_point(self.grip_tool)
            - self.start.transform_point(self.grip_tool);
        let turn_world = world_from_tool.rotation * self.start.rotation.conjugate();
        Pose::new(
            (device_from_world * turn_world * self.world_from_device.rotation).normalize(),
            device_from_world * travel_world / self.scale,
        )
    }
}

/// A hand path in the frame of the arm. Interpolates in the world and converts afterwards, so that
/// the tool follows exactly the path of the file even where it turns about a point away from its
/// centre of mass.
#[derive(Clone, Debug, PartialEq)]
pub struct GripPath {
    path: HandPath,
    mapping: HandMapping,
    reach: Reach,
}

impl GripPath {
    /// The target pose of the grip, `device_from_grip`, at `time_s`. RT: safe; O(log n).
    pub(crate) fn sample(&self, time_s: f64) -> Pose {
        self.grip_at(self.tool_at(time_s))
    }

    /// The pose of the tool, `world_from_tool`, at `time_s`. RT: safe; O(log n).
    pub(super) fn tool_at(&self, time_s: f64) -> Pose {
        self.path.sample(time_s)
    }

    /// The grip that holds the tool at a pose, `device_from_grip`. RT: safe.
    pub(super) fn grip_at(&self, world_from_tool: Pose) -> Pose {
        self.mapping.device_from_grip(world_from_tool)
    }

    /// Where the tool stands with the grip at its zero pose, `world_from_tool`.
    pub(super) fn start(&self) -> Pose {
        self.mapping.start
    }

    pub(super) fn set_start(&mut self, world_from_tool: Pose) {
        self.mapping.start = world_from_tool;
    }

    /// Time of the first and of the last pose, s.
    pub(super) fn span_s(&self) -> (f64, f64) {
        let times_s = &self.path.times_s;
        (times_s.first().copied().unwrap_or(0.0), times_s.last().copied().unwrap_or(0.0))
    }

    /// How far a hand that a client moves may be ahead of the tool.
    pub(super) fn reach(&self) -> Reach {
        self.reach
    }

    /// The same path, with a hand that has this reach where a client moves it.
    #[must_use]
    pub fn reaching(self, reach: Reach) -> Self {
        Self { reach, ..self }
    }

    /// The same path, begun so much later, s; until then the hand stays where it begins.
    #[must_use]
    pub fn delayed(mut self, delay_s: f64) -> Self {
        self.path.times_s.iter_mut().for_each(|time_s| *time_s += delay_s);
        self
    }

    /// A path given in the frame of the arm itself: the device stands in the world's origin and the
    /// tool is the grip.
    pub fn in_device_frame(path: HandPath) -> Self {
        let mapping = HandMapping {
            world_from_device: Pose::IDENTITY,
            scale: 1.0,
            start: Pose::IDENTITY,
            grip_tool: DVec3::ZERO,
        };
        Self { path, mapping, reach: Reach::default() }
    }
}

#[cfg(test)]
mod tests {
    use core::f64::consts::FRAC_PI_2;

    use glam::DQuat;

    use super::*;

    fn parse(body: &str) -> Result<HandPath, PoseFileError> {
        let path = Path::new("hands/x.csv");
        HandPath::from_poses(&poses::parse(&format!("{}\n{body}", poses::HEADER), path)?, path)
    }

    fn quarter_turn() -> HandPath {
        parse("0,0,0,0,0,0,0,1\n2,0.1,0,0,0,0,0.7071067811865476,0.7071067811865476\n")
            .expect("valid")
    }

    #[test]
    fn between_lines_the_path_is_linear_and_slerp() {
        let halfway = quarter_turn().sample(1.0);
        assert!((halfway.translation - DVec3::new(0.05, 0.0, 0.0)).length() < 1e-15);
        let turn = Pose::IDENTITY.rotation_to(halfway);
        assert!((turn - DVec3::new(0.0, 0.0, FRAC_PI_2 / 2.0)).length() < 1e-12);
    }

    #[test]
    fn a_path_that_repeats_goes_there_and_back_without_a_jump() {
        let path = quarter_turn().there_and_back();
        for (time_s, as_at_s) in [
            (-1.0, 0.0),
            (1.5, 1.5),
            (2.0, 2.0),
            (2.5, 1.5),
            (4.0, 0.0),
            (4.5, 0.5),
            (6.0, 2.0),
            (1e4, 0.0),
        ] {
            let now = path.sample(time_s);
            let then = quarter_turn().sample(as_at_s);
            assert!((now.translation - then.translation).length() < 1e-12, "{time_s}");
        }
        assert_eq!(path.sample(f64::NAN), path.sample(0.0));
        let stays = HandPath::fixed(Pose::from_translation(DVec3::X)).there_and_back();
        assert_eq!(stays.sample(5.0), stays.sample(0.0));
    }

    #[test]
    fn the_ends_are_held() {
        let path = quarter_turn();
        assert_eq!(path.sample(-1.0), path.sample(0.0));
        assert_eq!(path.sample(100.0), path.sample(2.0));
        assert_eq!(path.sample(2.0).translation, DVec3::new(0.1, 0.0, 0.0));
        assert_eq!(path.sample(f64::NAN), path.sample(0.0));
        let fixed = HandPath::fixed(Pose::from_translation(DVec3::X));
        assert_eq!(fixed.sample(-5.0), fixed.sample(5.0));
    }

    #[test]
    fn errors_name_file_and_line() {
        for (body, expected) in [
            (
                "0,0,0,0,0,0,0,1\n0,0,0,0,0,0,0,1",
                "hands/x.csv:3: t_s = 0 does not come after 0 on the line before",
            ),
            ("0,0,0,0,0,0,1", "hands/x.csv:2: 7 fields, expected 8"),
            ("0,0,inf,0,0,0,0,1", "hands/x.csv:2: `inf` is not a finite number (column y_m)"),
            ("0,a,0,0,0,0,0,1", "hands/x.csv:2: `a` is not a finite number (column x_m)"),
            ("\n0,0,0,0,0,0,0,0", "hands/x.csv:3: the quaternion has length 0"),
            ("", "hands/x.csv: no pose after the header"),
        ] {
            let message = parse(body).expect_err(body).to_string();
            assert!(message.starts_with(expected), "{message}");
        }
        let error = poses::parse("t,x\n", Path::new("h.csv")).expect_err("header").to_string();
        assert!(error.starts_with("h.csv:1: the header is `t,x`"), "{error}");
        let error =
            HandPath::read(Path::new("/nonexistent/h.csv")).expect_err("no file").to_string();
        assert!(error.contains("/nonexistent/h.csv"), "{error}");
    }

    #[test]
    fn windows_line_ends_and_a_byte_order_mark_are_fine() {
        let text = format!("\u{feff}{}\r\n0,0,0,0,0,0,0,1\r\n", poses::HEADER);
        assert!(poses::parse(&text, Path::new("h.csv")).is_ok());
    }

    #[test]
    fn at_the_start_pose_the_arm_stands_at_its_zero() {
        let mapping = HandMapping {
            world_from_device: Pose::new(DQuat::from_rotation_y(0.4), DVec3::new(1.0, 2.0, 3.0)),
            scale: 2.0,
            start: Pose::new(DQuat::from_rotation_x(1.1), DVec3::new(0.3, 0.0, 0.6)),
            grip_tool: DVec3::new(0.01, -0.02, 0.05),
        };
        let grip = mapping.device_from_grip(mapping.start);
        assert!(grip.translation.length() < 1e-15);
        assert!(Pose::IDENTITY.rotation_to(grip).length() < 1e-12);
    }

    #[test]
    fn the_grip_follows_the_centre_of_mass_and_the_world_turn() {
        // The device's x axis points along world y; two world metres per device metre; the grip is
        // 0.1 m above the tool's origin.
        let mapping = HandMapping {
            world_from_device: Pose::new(DQuat::from_rotation_z(FRAC_PI_2), DVec3::ZERO),
            scale: 2.0,
            start: Pose::IDENTITY,
            grip_tool: DVec3::new(0.0, 0.0, 0.1),
        };
        // A quarter turn about world x moves the grip point from (0, 0, 0.1) to (0, -0.1, 0).
        let grip =
            mapping.device_from_grip(Pose::new(DQuat::from_rotation_x(FRAC_PI_2), DVec3::ZERO));
        // World (0, -0.1, -0.1) is device (-0.1, 0, -0.1), halved.
        assert!((grip.translation - DVec3::new(-0.05, 0.0, -0.05)).length() < 1e-15, "{grip:?}");
        // World x is device -y.
        let turn = Pose::IDENTITY.rotation_to(grip);
        assert!((turn - DVec3::new(0.0, -FRAC_PI_2, 0.0)).length() < 1e-12, "{turn:?}");
    }
}
