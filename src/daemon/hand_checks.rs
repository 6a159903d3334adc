//! What is likely wrong with the path of a hand, before anything runs: positions in millimetres or
//! out of reach, quaternions in another order, a first pose far from where the tool starts.
//!
//! A path that may be meant gets a warning; one that no arm can follow is refused.

use core::fmt;
use std::path::{Path, PathBuf};

use glam::{DQuat, DVec3};

use crate::config::SceneConfig;
use document::poses::{HEADER_MM, TimedPose};
use document::show;

/// A stretch of the hand's default spring that is a quarter of what a small arm can push, m.
const FAR_FROM_START_M: f64 = 5e-3;
/// A path is likely in millimetres where it goes so many times further than the arm, and a
/// thousandth of it does not.
const MILLIMETRES_FACTOR: f64 = 20.0;
/// A turn against the tool's start from which it is likely not meant, rad.
const TURNED_RAD: f64 = core::f64::consts::FRAC_PI_2;
/// A turn up to which another order of the quaternion explains it, rad.
const EXPLAINED_RAD: f64 = core::f64::consts::FRAC_PI_6;

/// One thing to look at in a hand file.
#[derive(Clone, Debug, PartialEq)]
pub struct HandProblem {
    /// The file.
    pub file: PathBuf,
    /// Counts from 1.
    pub line: usize,
    /// Which columns: `x`, `y`, `z`, or `qx,qy,qz,qw`.
    pub column: &'static str,
    /// What is there, in metres.
    pub value: String,
    /// What is wrong with it.
    pub what: String,
    /// What to do about it.
    pub remedy: String,
}

impl HandProblem {
    /// All of it in one line.
    pub fn with_remedy(&self) -> String {
        format!("{self}; {}", self.remedy)
    }
}

impl fmt::Display for HandProblem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { file, line, column, value, what, remedy: _ } = self;
        write!(f, "{}:{line}: {column} = {value}: {what}", file.display())
    }
}

impl std::error::Error for HandProblem {}

/// Looks at the path of a simulated arm's hand.
///
/// # Errors
/// A path that the arm cannot follow whatever was meant.
pub(super) fn check(
    poses: &[TimedPose],
    file: &Path,
    config: &SceneConfig,
) -> Result<Vec<HandProblem>, HandProblem> {
    let Some(first) = poses.first() else { return Ok(Vec::new()) };
    let mapping = &config.parameters.mapping;
    let reach_m = config.device.profile.limits.workspace_radius_m * mapping.scale;
    let start = mapping.start;
    let problem = |at: &TimedPose, column, value, what, remedy| HandProblem {
        file: file.to_owned(),
        line: at.line,
        column,
        value,
        what,
        remedy,
    };
    // The grip moves as the tool's origin does, but for turns about it: a hand's breadth at most.
    let away_m = |position: DVec3| (position - start.translation).length();
    let furthest = poses
        .iter()
        .max_by(|a, b| away_m(a.pose.translation).total_cmp(&away_m(b.pose.translation)))
        .unwrap_or(first);
    let (column, coordinate_m) =
        largest(furthest.pose.translation - start.translation, furthest.pose.translation);
    let furthest_m = away_m(furthest.pose.translation);
    let value = format!("{} m", show(coordinate_m));
    let out_of_reach = || {
        format!(
            "the hand goes {} mm away from `tool.start_position_mm`, and the workspace of {} \
                reaches {} mm",
            show(furthest_m * 1e3),
            config.device.profile.name,
            show(reach_m * 1e3)
        )
    };
    let mut warnings = Vec::new();
    let is_within =
        |factor: f64| poses.iter().all(|timed| away_m(factor * timed.pose.translation) <= reach_m);
    if furthest_m > MILLIMETRES_FACTOR * reach_m && is_within(1e-3) {
        let what = format!("{}: the positions are in millimetres", out_of_reach());
        return Err(problem(
            furthest,
            column,
            value,
            what,
            format!("write the header `{HEADER_MM}`"),
        ));
    }
    if furthest_m > reach_m {
        let scale = show(1.05 * furthest_m / config.device.profile.limits.workspace_radius_m);
        let remedy = format!(
            "no force flows there: shorten the path, or `device.world_from_device.scale = {scale}`"
        );
        warnings.push(problem(furthest, column, value, out_of_reach(), remedy));
    }
    let first_m = away_m(first.pose.translation);
    if first_m > FAR_FROM_START_M {
        let (column, coordinate_m) =
            largest(first.pose.translation - start.translation, first.pose.translation);
        let what = format!(
            "the hand begins {:.1} mm away from `tool.start_position_mm` and will pull the arm \
                there at once",
            first_m * 1e3
        );
        let remedy =
            "begin the path where the tool starts, or move `tool.start_position_mm`".to_owned();
        warnings.push(problem(first, column, format!("{} m", show(coordinate_m)), what, remedy));
    }
    let turn_rad = |rotation: DQuat| rotation.angle_between(start.rotation);
    let rotation = first.pose.rotation;
    let turns = (3..6).any(|axis| config.device.profile.sensed.has(axis));
    if turns && turn_rad(rotation) > TURNED_RAD {
        // What the columns say when the first one is w.
        let w_first = DQuat::from_xyzw(rotation.y, rotation.z, rotation.w, rotation.x);
        let value = rotation.to_array().map(|number| show(number).to_string()).join(", ");
        let what = format!(
            "the hand begins turned by {:.0}° against `tool.start_orientation_xyzw`",
            turn_rad(rotation).to_degrees()
        );
        let remedy = if turn_rad(w_first) < EXPLAINED_RAD {
            "is the file in the order w, x, y, z? the columns are qx, qy, qz, qw, and no turn is \
                0, 0, 0, 1"
        } else {
            "begin the path as the tool starts, or turn `tool.start_orientation_xyzw`"
        };
        warnings.push(problem(first, "qx,qy,qz,qw", value, what, remedy.to_owned()));
    }
    Ok(warnings)
}

/// The coordinate that is furthest off, by its name, and what it is.
fn largest(off: DVec3, position: DVec3) -> (&'static str, f64) {
    let axis = off.abs().max_position();
    (["x", "y", "z"][axis], position[axis])
}
