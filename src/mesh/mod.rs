//! Triangle meshes: readers, primitive shapes, validation, exact closest points.
//!
//! Data in: OBJ and STL files, shape parameters. Data out: one [`TriangleMesh`] in metres, a report on it
//! ([`validate::inspect`]) and its mass properties ([`mass::mass_properties`]).
//!
//! ```text
//!  .obj ─► obj ─┐
//!  .stl ─► stl ─┴► TriangleMesh ─► validate ─► mass
//!  Shape ─► primitives ─┘    └───► closest_point (asked by the pointshell)
//! ```
//!
//! Invariants: cold, nothing here runs while forces are rendered. Nothing here repairs a mesh: what is wrong with it is said,
//! and generation copes. Cost: every step is linear in the file; about a second per million triangles.

pub mod closest_point;
mod error;
pub mod mass;
mod obj;
pub(crate) mod polygon;
pub mod primitives;
mod stl;
pub mod validate;
mod weld;

use std::path::Path;

use glam::DVec3;

pub use error::MeshError;

/// File name extensions that [`load`] reads, lower case.
pub const EXTENSIONS: &[&str] = &["obj", "stl"];

/// Triangles over shared vertices, metres, in the mesh file's own frame.
#[derive(Clone, Debug, Default)]
pub struct TriangleMesh {
    /// `[n_vertices]`, metres.
    pub vertices: Vec<DVec3>,
    /// `[n_triangles]`, counter-clockwise seen from outside when the file is sound; every index is below `vertices.len()`.
    pub triangles: Vec<[u32; 3]>,
}

impl TriangleMesh {
    /// The three corners of triangle `triangle_idx`, metres.
    pub fn corners(&self, triangle_idx: usize) -> [DVec3; 3] {
        self.triangles[triangle_idx].map(|vertex| self.vertices[vertex as usize])
    }

    /// Lowest and highest corner of the box around the vertices that triangles use; `None` for an empty mesh.
    pub fn bounds(&self) -> Option<(DVec3, DVec3)> {
        let mut used = self.triangles.iter().flatten().map(|vertex| self.vertices[*vertex as usize]);
        let first = used.next()?;
        Some(used.fold((first, first), |(low, high), vertex| (low.min(vertex), high.max(vertex))))
    }
}

/// Reads a mesh file, the format chosen by its extension (any case), and scales it to metres.
///
/// Groups and objects of a file become one mesh. Materials, normals and texture coordinates are not read: normals of CAD files
/// are unreliable, and nothing here needs the others.
///
/// # Errors
/// [`MeshError`], naming the path and, where it is known, the line.
pub fn load(path: &Path, metres_per_unit: f64) -> Result<TriangleMesh, MeshError> {
    let extension = path.extension().map(|extension| extension.to_string_lossy().to_lowercase()).unwrap_or_default();
    let parse = match extension.as_str() {
        "obj" => obj::parse,
        "stl" => stl::parse,
        _ => return Err(MeshError::UnknownExtension { path: path.to_owned(), extension }),
    };
    let bytes = std::fs::read(path).map_err(|source| match source.kind() {
        std::io::ErrorKind::NotFound => MeshError::Missing { path: path.to_owned() },
        _ => MeshError::Unreadable { path: path.to_owned(), source },
    })?;
    let mut mesh = parse(&bytes, path)?;
    if mesh.triangles.is_empty() {
        return Err(MeshError::Empty { path: path.to_owned() });
    }
    for (vertex_idx, vertex) in mesh.vertices.iter_mut().enumerate() {
        *vertex *= metres_per_unit;
        if !vertex.is_finite() {
            return Err(MeshError::NonFiniteVertex { path: path.to_owned(), vertex: vertex_idx + 1, line: None });
        }
    }
    Ok(mesh)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn extension_decides_in_any_case_and_scales() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("corner.OBJ");
        std::fs::write(&path, "v 0 0 0\nv 1000 0 0\nv 0 1000 0\nf 1 2 3\n").unwrap();
        let mesh = load(&path, 1e-3).unwrap();
        assert_eq!(mesh.bounds(), Some((DVec3::ZERO, DVec3::new(1.0, 1.0, 0.0))));
        assert_eq!(mesh.corners(0)[1], DVec3::X);
    }

    #[test]
    fn files_that_cannot_be_used_say_why() {
        let dir = tempfile::tempdir().unwrap();
        let at = |name: &str, text: &str| {
            let path = dir.path().join(name);
            std::fs::write(&path, text).unwrap();
            load(&path, 1.0).unwrap_err()
        };
        assert!(matches!(load(&dir.path().join("none.stl"), 1.0), Err(MeshError::Missing { .. })));
        let error = at("part.step", "");
        assert!(error.to_string().ends_with("part.step: unknown mesh extension `step`, known: obj, stl"), "{error}");
        assert!(matches!(at("part", ""), MeshError::UnknownExtension { .. }));
        assert!(matches!(at("empty.obj", "# nothing\n"), MeshError::Empty { .. }));
        assert!(matches!(at("empty.stl", "solid nothing\nendsolid nothing\n"), MeshError::Empty { .. }));
        std::fs::create_dir(dir.path().join("folder.obj")).unwrap();
        let error = load(&dir.path().join("folder.obj"), 1.0).unwrap_err();
        assert!(matches!(error, MeshError::Unreadable { .. }) && error.hint().is_some(), "{error}");
        let path = dir.path().join("huge.obj");
        std::fs::write(&path, "v 0 0 0\nv 1e308 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
        assert!(matches!(load(&path, 1e3), Err(MeshError::NonFiniteVertex { vertex: 2, .. })));
    }

    proptest::proptest! {
        /// Damaged files give an error or a mesh with indices in range, never a panic.
        #[test]
        fn damaged_text_does_no_harm(text in "(v|f|l|solid|facet|vertex|endfacet|endsolid|[-0-9. /#\\\\]|nan|1e999|\n){0,80}") {
            for parse in [obj::parse, stl::parse] {
                for text in [text.clone(), format!("solid facet\n{text}"), format!("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 1\n{text}")] {
                    if let Ok(mesh) = parse(text.as_bytes(), Path::new("damaged")) {
                        let report = validate::inspect(&mesh);
                        mass::mass_properties_of_inspected(&mesh, &report);
                        proptest::prop_assert!(mesh.triangles.iter().flatten().all(|vertex| (*vertex as usize) < mesh.vertices.len()));
                    }
                }
            }
        }

        /// Any tangle of triangles over few vertices can be inspected.
        #[test]
        fn tangled_triangles_do_no_harm(
            triangles in proptest::collection::vec(proptest::array::uniform3(0..12_u32), 0..60),
            vertices in proptest::collection::vec(proptest::array::uniform3(-2..2_i8), 12),
        ) {
            let vertices = vertices.into_iter().map(|corner| DVec3::from_array(corner.map(f64::from))).collect();
            let mesh = TriangleMesh { vertices, triangles };
            let report = validate::inspect(&mesh);
            let mass = mass::mass_properties_of_inspected(&mesh, &report);
            proptest::prop_assert!(mass.center_m.is_finite() && mass.inertia_per_mass.is_finite());
            proptest::prop_assert!(report.boundary_loops.iter().all(|rim| rim.size_m.is_finite() && rim.center_m.is_finite()));
            proptest::prop_assert_eq!(report.boundary_loops.is_empty(), report.open_edges == 0);
        }
    }

    #[test]
    #[expect(clippy::print_stdout, reason = "the figures are for a reader; a test sets no limit on time")]
    fn millions_of_triangles_go_through() {
        let torus = primitives::Shape::Torus { major_m: 0.05, minor_m: 0.02 }.tessellate(0.0);
        let mut bytes = vec![0; 80];
        bytes.extend((torus.triangles.len() as u32).to_le_bytes());
        for triangle_idx in 0..torus.triangles.len() {
            bytes.extend([0; 12]);
            for corner in torus.corners(triangle_idx) {
                bytes.extend(corner.as_vec3().to_array().iter().flat_map(|number| number.to_le_bytes()));
            }
            bytes.extend([0; 2]);
        }
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("torus.stl");
        std::fs::write(&path, bytes).unwrap();
        let start = std::time::Instant::now();
        let mesh = load(&path, 1.0).unwrap();
        let loaded = start.elapsed();
        let report = validate::inspect(&mesh);
        println!("{} triangles: load {loaded:.2?}, inspect {:.2?}", mesh.triangles.len(), start.elapsed() - loaded);
        assert_eq!((mesh.vertices.len(), mesh.triangles.len()), (torus.vertices.len(), torus.triangles.len()));
        assert!(report.closed && report.inconsistent_edges == 0, "{:?}", report.warnings());
    }

    /// Triangle counts and closedness of real files, which are not part of the project. Closed means: after welding, which also
    /// closes files that repeat the corners of their faces.
    #[test]
    #[expect(clippy::print_stdout, reason = "says that it was skipped, and what the files contain")]
    fn real_meshes_load() {
        let Some(models) = std::env::var_os("HAPTICD_MODELS").map(std::path::PathBuf::from) else {
            println!("skipped: HAPTICD_MODELS not set");
            return;
        };
        let cases = [
            ("factory_gear_base_tight_space_5e-4_subdiv_4x.obj", 10_518, false),
            ("factory_gear_medium_space_5e-4.obj", 35_212, true),
            ("factory_round_hole_8mm_subdiv_3x.obj", 900, false),
            ("factory_round_peg_8mm_tight.obj", 1_152, true),
            ("factory_round_peg_8mm_loose.obj", 1_152, true),
            ("factory_rectangular_hole_8mm_subdiv_3x.obj", 1_040, false),
            ("factory_rectangular_peg_8mm_tight_subdiv_3x.obj", 1_792, true),
            ("factory_bolt_m16_tight.obj", 25_672, true),
            ("factory_nut_m16_tight_subdiv_3x.obj", 15_078, false),
            ("stanford-bunny.obj", 69_451, false),
            ("rocker-arm.obj", 20_088, true),
            ("suzanne.obj", 968, false),
            ("ADIS16480.STL", 7_436, true),
            ("featuretype.STL", 3_476, true),
            ("busted.STL", 3_878, true),
        ];
        for (name, triangles, closed) in cases {
            let path = models.join(name);
            if !path.is_file() {
                println!("skipped: {name} is not there");
                continue;
            }
            let start = std::time::Instant::now();
            let mesh = load(&path, 1.0).unwrap();
            let loaded = start.elapsed();
            let report = validate::inspect(&mesh);
            let inspected = start.elapsed() - loaded;
            let mass = mass::mass_properties(&mesh);
            println!(
                "{name}: {} vertices, {report:?}, load {loaded:.1?}, inspect {inspected:.1?}, {mass:?}, {:?}",
                mesh.vertices.len(),
                report.warnings()
            );
            assert_eq!(mesh.triangles.len(), triangles, "{name}");
            assert_eq!(report.closed, closed, "{name}");
            assert!(mass.center_m.is_finite() && mass.inertia_per_mass.is_finite(), "{name}");
        }
    }
}
