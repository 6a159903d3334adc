//! Points as plain text: one in each line.
//!
//! Numbers stand between blanks, commas or semicolons. Lines that begin with `#` or `//` are
//! comments; the first line may hold names of columns, or the number of points.

use std::path::Path;

use glam::DVec3;

use super::MeshError;
use super::points::Cloud;

/// Columns that are understood, in words.
const UNDERSTOOD: &str = "understood are 3 (x y z), 6 (x y z, and a normal or a colour from 0 to \
    255) and 9 (x y z, normal, colour)";

/// Reads the text; `path` is for messages only.
pub(super) fn parse(bytes: &[u8], path: &Path) -> Result<Cloud, MeshError> {
    let text = String::from_utf8_lossy(bytes);
    let text = text.trim_start_matches('\u{feff}');
    let refuse = |line: usize, what: String| MeshError::Parse {
        path: path.to_owned(),
        line: Some(line),
        what,
    };
    let mut cloud = Cloud::default();
    let mut more: Vec<DVec3> = Vec::new();
    let mut last: Vec<DVec3> = Vec::new();
    let mut n_columns = None;
    let mut may_be_heading = true;
    for (line_idx, line) in text.lines().enumerate() {
        let line = line.trim();
        if line.is_empty() || line.starts_with('#') || line.starts_with("//") {
            continue;
        }
        let words = || line.split([' ', '\t', ',', ';']).filter(|word| !word.is_empty());
        let is_heading = may_be_heading
            && (words().count() == 1 || words().all(|word| word.parse::<f64>().is_err()));
        may_be_heading = false;
        if is_heading {
            continue;
        }
        let mut numbers = [0.0; 9];
        let mut n_numbers = 0;
        for word in words() {
            let Ok(number) = word.parse() else {
                return Err(refuse(
                    line_idx + 1,
                    format!("`{}` is no number", word.chars().take(60).collect::<String>()),
                ));
            };
            if let Some(place) = numbers.get_mut(n_numbers) {
                *place = number;
            }
            n_numbers += 1;
        }
        match n_columns {
            Some(n_columns) if n_columns != n_numbers => {
                return Err(refuse(
                    line_idx + 1,
                    format!("{n_numbers} numbers, the lines before have {n_columns}"),
                ));
            }
            None if !matches!(n_numbers, 3 | 6 | 9) => {
                return Err(refuse(
                    line_idx + 1,
                    format!("{n_numbers} columns of numbers found, {UNDERSTOOD}"),
                ));
            }
            _ => n_columns = Some(n_numbers),
        }
        let position = DVec3::from_slice(&numbers);
        if !position.is_finite() {
            let vertex = cloud.positions.len() + 1;
            return Err(MeshError::NonFiniteVertex {
                path: path.to_owned(),
                vertex,
                line: Some(line_idx + 1),
            });
        }
        cloud.positions.push(position);
        if n_numbers > 3 {
            more.push(DVec3::from_slice(&numbers[3..]));
        }
        if n_numbers > 6 {
            last.push(DVec3::from_slice(&numbers[6..]));
        }
    }
    match n_columns {
        Some(9) => (cloud.normals, cloud.colors) = (Some(more), Some(colors(&last))),
        Some(6) if are_colors(&more) => cloud.colors = Some(colors(&more)),
        Some(6) => cloud.normals = Some(more),
        _ => {}
    }
    Ok(cloud)
}

/// Whole numbers up to 255, and longer than normals are.
fn are_colors(columns: &[DVec3]) -> bool {
    let is_color = |part: f64| (0.0..=255.0).contains(&part) && part.fract() == 0.0;
    columns.iter().all(|column| column.to_array().into_iter().all(is_color))
        && columns.iter().any(|column| column.length_squared() > 3.0)
}

fn colors(columns: &[DVec3]) -> Vec<[u8; 3]> {
    columns.iter().map(|column| column.to_array().map(|part| part.round() as u8)).collect()
}
