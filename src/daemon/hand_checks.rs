//! What is likely wrong with the path of a hand, before anything runs: positions in millimetres or
//! out of reach, quaternions in another order, a first pose far from where the tool starts, times
//! of a clock or in another unit than seconds.
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

/// A hand that waits longer at its first pose, or begins so long before the loop, is likely not
/// meant, s.
const LATE_START_S: f64 = 60.0;
/// A longer path is likely not meant, s.
const LONG_S: f64 = 24.0 * 3600.0;
/// Times since 1970 in seconds, from 2001 on to the year 2286.
const SINCE_1970_S: core::ops::Range<f64> = 1e9..1e10;
/// From line to line, s, between a recording at 1 kHz and poses written by hand.
const USUAL_STEP_S: f64 = 0.01;

/// One thing to look at in a hand file.
#[derive(Clone, Debug, PartialEq)]
pub struct HandProblem {
    /// The file.
    pub file: PathBuf,
    /// Counts from 1.
    pub line: usize,
    /// Which columns: `x`, `y`, `z`, `qx,qy,qz,qw`, or `t_s`.
    pub column: &'static str,
    /// What is there, in metres or seconds.
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
    warnings.extend(unlikely_times(poses).map(|(at, what, remedy)| {
        problem(at, "t_s", format!("{} s", show(at.time_s)), what, remedy)
    }));
    Ok(warnings)
}

/// Times that begin far from 0 or last too long: where that stands, what is wrong, and what was
/// probably meant.
fn unlikely_times(poses: &[TimedPose]) -> Option<(&TimedPose, String, String)> {
    let first = poses.first()?;
    let last = poses.last()?;
    let length_s = last.time_s - first.time_s;
    let unit = unit_of_times(first.time_s, length_s, poses.len());
    let (at, what) = if first.time_s > LATE_START_S {
        (first, format!("the hand waits {} at its first pose", duration(first.time_s)))
    } else if length_s > LONG_S {
        (last, format!("the path of the hand lasts {}", duration(length_s)))
    } else if first.time_s < -LATE_START_S {
        (first, format!("the path begins {} before the loop", duration(-first.time_s)))
    } else {
        return None;
    };
    let is_late = first.time_s.abs() > LATE_START_S;
    let remedy = match (unit, is_late) {
        (Some((unit, per_s)), true) => format!(
            "the times are probably {unit}: subtract the first one from all, and divide by {per_s}"
        ),
        (Some((unit, per_s)), false) => {
            format!("the times are probably {unit}: divide them by {per_s}")
        }
        (None, true) if SINCE_1970_S.contains(&first.time_s) => {
            "the times are probably seconds since 1970: subtract the first one from all".to_owned()
        }
        (None, true) => "subtract the first time from all, so that the path begins at 0".to_owned(),
        (None, false) => "write the times in seconds".to_owned(),
    };
    Some((at, what, remedy))
}

/// The unit of times that are no seconds, and how many of it a second has: by the size of a clock
/// that counts since 1970, else by the steps of a path that is too long.
fn unit_of_times(first: f64, length: f64, n_poses: usize) -> Option<(&'static str, &'static str)> {
    const UNITS: [(&str, &str, f64); 3] =
        [("milliseconds", "1000", 1e3), ("microseconds", "1e6", 1e6), ("nanoseconds", "1e9", 1e9)];
    let of_clock = UNITS.iter().find(|(.., per_s)| SINCE_1970_S.contains(&(first / per_s)));
    let unlikely = |per_s: f64| {
        let step_s = length / (n_poses.max(2) - 1) as f64 / per_s;
        (step_s / USUAL_STEP_S).ln().abs()
    };
    let of_steps = || {
        let likeliest = UNITS.iter().min_by(|a, b| unlikely(a.2).total_cmp(&unlikely(b.2)));
        likeliest.filter(|_| length > LONG_S)
    };
    of_clock.or_else(of_steps).map(|(name, per_s, _)| (*name, *per_s))
}

/// A time in the unit in which it reads best.
fn duration(time_s: f64) -> String {
    const YEAR_S: f64 = 365.25 * 86400.0;
    match time_s {
        t if t >= 2.0 * YEAR_S => format!("{:.0} years", t / YEAR_S),
        t if t >= 2.0 * LONG_S => format!("{:.0} days", t / LONG_S),
        t if t >= 7200.0 => format!("{:.0} hours", t / 3600.0),
        t if t >= 120.0 => format!("{:.0} minutes", t / 60.0),
        t => format!("{t:.0} seconds"),
    }
}

/// The coordinate that is furthest off, by its name, and what it is.
fn largest(off: DVec3, position: DVec3) -> (&'static str, f64) {
    let axis = off.abs().max_position();
    (["x", "y", "z"][axis], position[axis])
}

#[cfg(test)]
mod tests {
    use super::*;
    use vps::spatial::Pose;

    /// What is said of the times of a path of 1000 lines, from `first` on in such steps.
    fn said(first: f64, step: f64) -> Option<(usize, String, String)> {
        let poses: Vec<_> = (0..1000)
            .map(|k| TimedPose {
                time_s: first + step * f64::from(k),
                pose: Pose::IDENTITY,
                line: k as usize + 2,
            })
            .collect();
        unlikely_times(&poses).map(|(at, what, remedy)| (at.line, what, remedy))
    }

    #[test]
    fn times_in_seconds_from_about_0_on_are_not_doubted() {
        for (first, step) in [(0.0, 1e-3), (0.0, 60.0), (-1.0, 0.01), (30.0, 0.1)] {
            assert_eq!(said(first, step), None);
        }
    }

    #[test]
    fn times_of_a_clock_are_warned_of_with_the_unit_that_was_meant() {
        let subtract = "subtract the first one from all";
        for (first, step, what, remedy) in [
            (1.7e9, 1e-3, "54 years", format!("seconds since 1970: {subtract}")),
            (1.7e12, 1.0, "53870 years", format!("milliseconds: {subtract}, and divide by 1000")),
            (1.7e15, 1e3, "years", format!("microseconds: {subtract}, and divide by 1e6")),
            (1.7e18, 1e6, "years", format!("nanoseconds: {subtract}, and divide by 1e9")),
            // A clock since the machine was switched on.
            (8000.0, 1e-3, "2 hours", "so that the path begins at 0".to_owned()),
            (86.4e12, 1e6, "years", format!("nanoseconds: {subtract}, and divide by 1e9")),
        ] {
            let (line, found, advice) = said(first, step).expect("a warning");
            assert_eq!(line, 2);
            assert!(
                found.starts_with("the hand waits ")
                    && found.ends_with(" at its first pose")
                    && found.contains(what)
                    && advice.ends_with(&remedy),
                "{found}: {advice}"
            );
        }
        let (line, found, _) = said(-3600.0, 1.0).expect("a warning");
        assert_eq!((line, &*found), (2, "the path begins 60 minutes before the loop"));
    }

    #[test]
    fn paths_of_more_than_a_day_are_warned_of_with_the_unit_that_was_meant() {
        for (step, what, remedy) in [
            (100.0, "28 hours", "milliseconds: divide them by 1000"),
            (1e3, "12 days", "microseconds: divide them by 1e6"),
            (33e3, "382 days", "microseconds: divide them by 1e6"),
            (1e6, "32 years", "nanoseconds: divide them by 1e9"),
        ] {
            let (line, found, advice) = said(0.0, step).expect("a warning");
            assert_eq!(line, 1001);
            assert_eq!(found, format!("the path of the hand lasts {what}"));
            assert_eq!(advice, format!("the times are probably {remedy}"));
        }
    }
}
