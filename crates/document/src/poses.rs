//! Pose files: where a simulated hand wants to be over time, and where `eval` puts the tool.
//!
//! CSV with the header `t_s,x_m,y_m,z_m,qx,qy,qz,qw`, or `t_s,x_mm,y_mm,z_mm,qx,qy,qz,qw` for
//! positions in millimetres: poses of the tool frame in the world. What is read is in metres
//! whatever the header says.

use std::path::{Path, PathBuf};

use glam::{DQuat, DVec3};

use vps::spatial::Pose;
use vps::storage::regular;

/// Bytes of a pose file at most: half an hour at 1 kHz.
const LONGEST_FILE: u64 = 256 << 20;

/// The header of a pose file.
pub const HEADER: &str = "t_s,x_m,y_m,z_m,qx,qy,qz,qw";

/// The header of a pose file whose positions are in millimetres.
pub const HEADER_MM: &str = "t_s,x_mm,y_mm,z_mm,qx,qy,qz,qw";

/// How far the length of a quaternion may be from 1: printed digits, not mistakes.
const QUATERNION_LENGTH_TOLERANCE: f64 = 1e-2;

/// Why a pose file was refused.
#[derive(Debug, thiserror::Error)]
pub enum PoseFileError {
    /// The file cannot be read.
    #[error("cannot read pose file {}: {source}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
    /// A line is wrong.
    #[error("{}:{line}: {problem}", path.display())]
    Line {
        /// The file.
        path: PathBuf,
        /// Counts from 1.
        line: usize,
        /// What is wrong with it.
        problem: LineProblem,
    },
    /// There is a header and nothing else.
    #[error("{}: no pose after the header", path.display())]
    Empty {
        /// The file.
        path: PathBuf,
    },
}

/// What is wrong with one line of a pose file.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum LineProblem {
    /// The first line.
    #[error("the header is `{found}`, expected `{HEADER}` or, in millimetres, `{HEADER_MM}`")]
    Header {
        /// As found.
        found: String,
    },
    /// Too few or too many fields.
    #[error("{found} fields, expected 8 ({header})")]
    Fields {
        /// How many.
        found: usize,
        /// Names of the columns.
        header: &'static str,
    },
    /// A field that is not a finite number.
    #[error("`{found}` is not a finite number (column {column})")]
    Number {
        /// As found.
        found: String,
        /// Name of the column.
        column: &'static str,
    },
    /// Time does not increase.
    #[error("t_s = {time_s} does not come after {previous_s} on the line before")]
    Time {
        /// On this line.
        time_s: f64,
        /// On the line before.
        previous_s: f64,
    },
    /// The quaternion is not of unit length.
    #[error("the quaternion has length {length}, expected 1")]
    Quaternion {
        /// Its length.
        length: f64,
    },
}

/// One line of a pose file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimedPose {
    /// Time, s, as written; it grows from row to row.
    pub time_s: f64,
    /// Pose of the tool frame in the world, `world_from_tool`.
    pub pose: Pose,
    /// Line in the file, counted from 1.
    pub line: usize,
}

/// Reads a pose file; at least one pose.
///
/// # Errors
/// See [`PoseFileError`]; every one names the file, and the line where there is one.
pub fn read(path: &Path) -> Result<Vec<TimedPose>, PoseFileError> {
    let text = regular::text(path, LONGEST_FILE)
        .map_err(|source| PoseFileError::Read { path: path.to_owned(), source })?;
    parse(&text, path)
}

/// Reads the text of a pose file; `path` is for messages.
///
/// # Errors
/// As [`read`].
pub fn parse(text: &str, path: &Path) -> Result<Vec<TimedPose>, PoseFileError> {
    let at = |line: usize, problem| PoseFileError::Line { path: path.to_owned(), line, problem };
    let mut lines = text.trim_start_matches('\u{feff}').lines().map(str::trim).enumerate();
    let header = lines.next().map_or("", |(_, line)| line);
    let is_header = |known: &&(&str, f64)| header.split(',').map(str::trim).eq(known.0.split(','));
    let Some(&(header, metres)) = [(HEADER, 1.0), (HEADER_MM, 1e-3)].iter().find(is_header) else {
        return Err(at(1, LineProblem::Header { found: header.to_owned() }));
    };
    let mut poses = Vec::new();
    for (line_idx, line) in lines.filter(|(_, line)| !line.is_empty()) {
        let line_number = line_idx + 1;
        let (time_s, pose) =
            parse_line(line, header, metres).map_err(|problem| at(line_number, problem))?;
        poses.push(TimedPose { time_s, pose, line: line_number });
    }
    if poses.is_empty() {
        return Err(PoseFileError::Empty { path: path.to_owned() });
    }
    Ok(poses)
}

/// Checks that time increases from pose to pose.
///
/// # Errors
/// The first pose that does not come after the one before.
pub fn check_order(poses: &[TimedPose], path: &Path) -> Result<(), PoseFileError> {
    match poses.windows(2).find(|pair| pair[1].time_s <= pair[0].time_s) {
        None => Ok(()),
        Some(pair) => Err(PoseFileError::Line {
            path: path.to_owned(),
            line: pair[1].line,
            problem: LineProblem::Time { time_s: pair[1].time_s, previous_s: pair[0].time_s },
        }),
    }
}

/// `metres`: length of a unit of positions.
fn parse_line(line: &str, header: &'static str, metres: f64) -> Result<(f64, Pose), LineProblem> {
    let mut values = [0.0; 8];
    let n_fields = line.split(',').count();
    if n_fields != values.len() {
        return Err(LineProblem::Fields { found: n_fields, header });
    }
    for ((value, field), column) in values.iter_mut().zip(line.split(',')).zip(header.split(',')) {
        let field = field.trim();
        *value = match field.parse::<f64>() {
            Ok(number) if number.is_finite() => number,
            _ => return Err(LineProblem::Number { found: field.to_owned(), column }),
        };
    }
    let [time_s, x, y, z, qx, qy, qz, qw] = values;
    let rotation = DQuat::from_xyzw(qx, qy, qz, qw);
    let length = rotation.length();
    if (length - 1.0).abs() > QUATERNION_LENGTH_TOLERANCE {
        return Err(LineProblem::Quaternion { length });
    }
    Ok((time_s, Pose::new(rotation.normalize(), metres * DVec3::new(x, y, z))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_header_says_the_unit_of_positions() {
        let body = "0,1,-20,0.5,0,0,0,1\n";
        let read = |header: &str| parse(&format!("{header}\n{body}"), Path::new("h.csv"));
        let at_m = |header: &str| read(header).expect("a known header")[0].pose.translation;
        assert_eq!(at_m(HEADER), DVec3::new(1.0, -20.0, 0.5));
        assert!(
            (at_m("t_s, x_mm, y_mm, z_mm, qx, qy, qz, qw") - DVec3::new(0.001, -0.02, 0.0005))
                .length()
                < 1e-18
        );
        let refused = read("t_s,x_cm,y_cm,z_cm,qx,qy,qz,qw").expect_err("centimetres").to_string();
        assert!(
            refused.starts_with("h.csv:1: the header is `t_s,x_cm") && refused.contains(HEADER_MM),
            "{refused}"
        );
        let refused = parse(&format!("{HEADER_MM}\n0,1,y,0,0,0,0,1\n"), Path::new("h.csv"))
            .expect_err("no number")
            .to_string();
        assert!(
            refused.ends_with("h.csv:2: `y` is not a finite number (column y_mm)"),
            "{refused}"
        );
    }
}
