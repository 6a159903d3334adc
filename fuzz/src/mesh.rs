//! What the targets of the mesh readers do with their bytes. The tests of the program include this
//! file and replay the corpora.

use std::path::Path;

use vps::mesh::{self, Format, mass, validate};

/// Reads the bytes as a mesh file, and takes what comes out through inspection, as loading a part
/// does. True when a mesh came out.
///
/// # Panics
/// When a mesh is larger than its file can fill or when it is not sound.
pub(crate) fn exercise(bytes: &[u8], format: Format) -> bool {
    // Files named by a file are looked for beside it: in a folder that is not there.
    let Ok(mesh) = mesh::parse(bytes, format, Path::new("/nowhere/fuzz"), 1e-3) else {
        return false;
    };
    // A file that places copies of its parts may ask for as many as the reader allows.
    let most = if matches!(format, Format::Gltf | Format::ThreeMf) {
        100 * bytes.len() + (1 << 24)
    } else {
        bytes.len()
    };
    assert!(mesh.vertices.len() <= most && mesh.triangles.len() <= most, "more than the file has");
    assert!(mesh.vertices.iter().all(|vertex| vertex.is_finite()));
    assert!(mesh.triangles.iter().flatten().all(|vertex| (*vertex as usize) < mesh.vertices.len()));
    let report = validate::inspect(&mesh);
    let mass = mass::mass_properties_of_inspected(&mesh, &report);
    assert!(mass.center_m.is_finite() && mass.inertia_per_mass.is_finite());
    true
}
