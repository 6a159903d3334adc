//! Stand-ins as files, for the processes that are measured.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use vps::mesh::TriangleMesh;

/// Writes a binary STL in millimetres.
pub(super) fn write_stl(path: &Path, mesh: &TriangleMesh) -> io::Result<()> {
    let mut file = BufWriter::with_capacity(1 << 20, File::create(path)?);
    let mut header = [b' '; 80];
    header[..26].copy_from_slice(b"hapticd stand-in, unit: mm");
    file.write_all(&header)?;
    file.write_all(&(mesh.triangles.len() as u32).to_le_bytes())?;
    for triangle_idx in 0..mesh.triangles.len() {
        // Normals stay zero: readers take them from the corners.
        let mut facet = [0; 50];
        let numbers = mesh
            .corners(triangle_idx)
            .into_iter()
            .flat_map(|corner| (corner * 1e3).as_vec3().to_array());
        for (bytes, number) in facet[12..48].chunks_exact_mut(4).zip(numbers) {
            bytes.copy_from_slice(&number.to_le_bytes());
        }
        file.write_all(&facet)?;
    }
    file.flush()
}

/// A folder that goes away with its owner.
pub(super) struct TemporaryFolder(PathBuf);

impl TemporaryFolder {
    pub(super) fn create() -> io::Result<Self> {
        let path = std::env::temp_dir().join(format!("hapticd-bench-{}", std::process::id()));
        std::fs::create_dir_all(&path)?;
        Ok(Self(path))
    }

    pub(super) fn path(&self) -> &Path {
        &self.0
    }
}

impl Drop for TemporaryFolder {
    fn drop(&mut self) {
        // Nothing more can be done about a folder that stays.
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::stand_ins::StandIn;
    use vps::mesh::load;
    use vps::mesh::validate::inspect;

    #[test]
    fn a_stand_in_survives_its_file() {
        let folder = tempfile::tempdir().unwrap();
        for stand_in in [StandIn::Bracket, StandIn::Brake] {
            let mesh = stand_in.mesh(1);
            let path = folder.path().join("part.stl");
            write_stl(&path, &mesh).unwrap();
            let loaded = load(&path, 1e-3).unwrap();
            assert_eq!(loaded.triangles.len(), mesh.triangles.len());
            assert!(inspect(&loaded).closed, "{}", stand_in.name());
            let [(_, high), (_, loaded_high)] = [&mesh, &loaded].map(|mesh| mesh.bounds().unwrap());
            assert!(
                (high - loaded_high).abs().max_element() < 1e-7 && high.cmpgt(DVec3::ZERO).all()
            );
        }
    }

    #[test]
    fn the_folder_goes_away() {
        let folder = TemporaryFolder::create().unwrap();
        let path = folder.path().to_owned();
        std::fs::write(path.join("x"), "x").unwrap();
        drop(folder);
        assert!(!path.exists());
    }
}
