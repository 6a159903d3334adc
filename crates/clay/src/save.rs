//! Samples as a file: binary little-endian PLY, `double x y z`, `float nx ny nz`, `uchar red green
//! blue`; metres, normals outward.

use std::io::{self, Write};
use std::path::Path;

use super::PointSet;
use vps::storage::whole_file::{Access, write_whole};

/// Writes samples. [`super::load()`] reads them back: positions and colours bit for bit, normals as
/// 32-bit numbers.
///
/// # Errors
/// Any error of the file system; what was there under that name is there still.
pub fn save(path: &Path, points: &PointSet) -> io::Result<()> {
    write_whole(path, Access::Shared, |file| write(file, points))
}

/// The same to any writer.
///
/// # Errors
/// Any error of the writer.
pub fn write(to: &mut impl Write, points: &PointSet) -> io::Result<()> {
    write!(
        to,
        "ply\nformat binary_little_endian 1.0\ncomment samples of a surface, metres, normals \
            outward\n"
    )?;
    writeln!(to, "element vertex {}", points.len())?;
    for (kind, names) in [
        ("double", ["x", "y", "z"]),
        ("float", ["nx", "ny", "nz"]),
        ("uchar", ["red", "green", "blue"]),
    ] {
        names.iter().try_for_each(|name| writeln!(to, "property {kind} {name}"))?;
    }
    writeln!(to, "end_header")?;
    for ((position_map, normal_map), color) in
        points.positions_map.iter().zip(&points.normals_map).zip(&points.colors)
    {
        for number in position_map.to_array() {
            to.write_all(&number.to_le_bytes())?;
        }
        for number in normal_map.as_vec3().to_array() {
            to.write_all(&number.to_le_bytes())?;
        }
        to.write_all(color)?;
    }
    Ok(())
}
