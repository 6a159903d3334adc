//! Real meshes, found through `HAPTICD_MODELS`.

use std::path::PathBuf;

use vps::mesh::{self, TriangleMesh};

/// File names with metres per unit.
const MODELS: [(&str, f64); 15] = [
    ("factory_gear_base_tight_space_5e-4_subdiv_4x.obj", 1.0),
    ("factory_gear_medium_space_5e-4.obj", 1.0),
    ("factory_round_hole_8mm_subdiv_3x.obj", 1.0),
    ("factory_round_peg_8mm_tight.obj", 1.0),
    ("factory_round_peg_8mm_loose.obj", 1.0),
    ("factory_rectangular_hole_8mm_subdiv_3x.obj", 1.0),
    ("factory_rectangular_peg_8mm_tight_subdiv_3x.obj", 1.0),
    ("factory_bolt_m16_tight.obj", 1.0),
    ("factory_nut_m16_tight_subdiv_3x.obj", 1.0),
    ("stanford-bunny.obj", 1.0),
    ("rocker-arm.obj", 1.0),
    ("suzanne.obj", 1.0),
    ("ADIS16480.STL", 0.0254),
    ("featuretype.STL", 0.0254),
    ("busted.STL", 0.0254),
];

/// The folder of real meshes; says so and gives `None` where the variable is unset.
fn folder() -> Option<PathBuf> {
    let folder = std::env::var_os("HAPTICD_MODELS").map(PathBuf::from);
    if folder.is_none() {
        eprintln!("skipped: HAPTICD_MODELS not set");
    }
    folder
}

/// Loads every real mesh.
pub(crate) fn all() -> Vec<(&'static str, TriangleMesh)> {
    let Some(folder) = folder() else { return Vec::new() };
    MODELS
        .into_iter()
        .map(|(name, metres_per_unit)| {
            let mesh = mesh::load(&folder.join(name), metres_per_unit)
                .unwrap_or_else(|error| panic!("{name}: {error}"));
            (name, mesh)
        })
        .collect()
}
