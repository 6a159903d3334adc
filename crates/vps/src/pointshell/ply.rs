//! Export of a pointshell: binary little-endian PLY, float `x y z nx ny nz`, metres, normals
//! inward.

use std::io::{self, Write};
use std::path::Path;

use glam::DVec3;

use super::shell::Shell;
use crate::storage::whole_file::{Access, write_whole};

/// Writes the shell in the mesh file's own frame.
///
/// # Errors
/// Any error of the file system.
pub fn write(path: &Path, shell: &Shell, center_of_mass_tool: DVec3) -> io::Result<()> {
    write_whole(path, Access::Shared, |file| write_to(file, shell, center_of_mass_tool))
}

fn write_to(file: &mut impl Write, shell: &Shell, center_of_mass_tool: DVec3) -> io::Result<()> {
    write!(
        file,
        "ply\nformat binary_little_endian 1.0\ncomment pointshell, metres, normals inward\nelement \
            vertex {}\n",
        shell.len()
    )?;
    for property in ["x", "y", "z", "nx", "ny", "nz"] {
        writeln!(file, "property float {property}")?;
    }
    file.write_all(b"end_header\n")?;
    for (position, normal) in shell.points() {
        let position_tool = (position.as_dvec3() + center_of_mass_tool).as_vec3();
        for number in position_tool.to_array().into_iter().chain(normal.to_array()) {
            file.write_all(&number.to_le_bytes())?;
        }
    }
    Ok(())
}
